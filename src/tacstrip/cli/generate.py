"""`tacstrip generate`."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np

from tacstrip.cli import options, warn
from tacstrip.cli.progress import progress_bar
from tacstrip.dataset.batches import simulate_many
from tacstrip.dataset.generation import DataSet, generate, parts_there, resolved
from tacstrip.io.input_checks import unlikely_lengths

# Scans that are looked at first, from one on ever more, in so long at most.
_SOME, _MORE, _LOOK_S = 500, 5, 2.0
_MUCH, _LONG_S = 0.01, 60.0  # share of scans that no strip feels, and time, that are worth a word


@click.command()
@click.argument("study", type=options.FILE)
@options.file("--out", required=True, help="Folder of the data set.")
@options.option("--workers", type=options.WholeRange(1), help="Threads; by default one per core.")
def command(study: Path, out: Path, workers: int | None) -> None:
    """Write a labelled data set as STUDY (a TOML file) asks for, with a card that says what is in it.

    Ended at any point, the same command goes on; the result is the same.

    Example: tacstrip generate study.toml --out data
    """
    data = DataSet.load(study)
    warn(unlikely_lengths(data.sensor), file=study)
    _look(data)
    with progress_bar() as bar:
        task = bar.add_task("scans", total=data.shapes.n)
        try:
            written = generate(
                data, out, workers, lambda n, total: bar.update(task, completed=n, total=total)
            )
        except KeyboardInterrupt:
            bar.stop()
            kept = f"{parts_there(data, out)} of {len(data.parts)} parts are whole and kept in {out}"
            click.echo(f"ended; {kept}: the same command goes on", err=True)
            raise
    counts = ", ".join(f"{count} {name}" for name, count in data.counts.items() if count)
    click.echo(f"{out}: {data.shapes.n} scans of {data.sensor.strips} strips ({counts})"
               + ("" if written else "; it was complete already"))  # fmt: skip
    click.echo(f"{out / 'README.md'}: what is in it, and how to read it")


def _look(data: DataSet) -> None:
    """Warn, by some scans, where many would be empty, or where it would take long."""
    model: Any = data.model
    count, each_s = 1, 0.0  # the first scan also loads what it needs: of quick ones more are looked at
    while True:
        some = replace(data.shapes, n=min(data.shapes.n, count))
        begun = time.perf_counter()
        scans = simulate_many(data.sensor, some, rng=data.seed, model=model, workers=1)
        each_s = (time.perf_counter() - begun) / some.n
        if some.n < count or count >= _SOME or (count > 1 and _MORE * count * each_s > _LOOK_S):
            break
        count = 2 if count == 1 else _MORE * count
    assert scans.labels is not None
    pressed = (scans.labels.kind > 0).any(axis=1)
    unseen = int((pressed & ~np.isfinite(scans[data.sensor.signatures[0]]).any(axis=1)).sum())
    if unseen > _MUCH * some.n:
        warn(
            f"{unseen} of the first {some.n} scans have an object and touch no strip, as it lies between two: make "
            "size_mm larger, or the pitch finer"
        )
    if each_s * data.shapes.n > _LONG_S:
        wide = '; strips of strip_width_mm are resolved one by one: model = "closed" in [dataset] takes their edges'
        why = wide if data.sensor.strip_width_mm is not None and resolved(data.sensor, data.model) else ""
        warn(f"this takes some {each_s * data.shapes.n / 60.0:.0f} minutes on one core{why}")
