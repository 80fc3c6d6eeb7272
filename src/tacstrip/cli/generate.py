"""`tacstrip generate`."""

from __future__ import annotations

from pathlib import Path

import click
from rich.progress import Progress

from tacstrip.cli import options
from tacstrip.dataset.generation import DataSet, generate


@click.command()
@click.argument("study", type=options.FILE)
@click.option("--out", type=options.FILE, required=True, help="Folder of the data set.")
@click.option("--workers", type=options.WholeRange(1), help="Threads; by default one per core.")
def command(study: Path, out: Path, workers: int | None) -> None:
    """Write a labelled data set as STUDY (a TOML file) asks for, with a card that says what is in it.

    Ended at any point, the same command goes on; the result is the same.

    Example: tacstrip generate study.toml --out data
    """
    data = DataSet.load(study)
    with Progress(transient=True) as bar:
        task = bar.add_task("scans", total=data.shapes.n)
        written = generate(data, out, workers, lambda n, total: bar.update(task, completed=n, total=total))
    counts = ", ".join(f"{count} {name}" for name, count in data.counts.items() if count)
    click.echo(f"{out}: {data.shapes.n} scans of {data.sensor.strips} strips ({counts})"
               + ("" if written else "; it was complete already"))  # fmt: skip
    click.echo(f"{out / 'README.md'}: what is in it, and how to read it")
