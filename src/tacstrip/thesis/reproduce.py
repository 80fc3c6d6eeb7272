"""Chapters 5 and 6 reproduced: all cells, all figures, `tables.json` and `report.html` in one folder."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from tacstrip.data.published import METRICS, experiments, published, rows
from tacstrip.files import write_text
from tacstrip.plot.style import save
from tacstrip.report.page import Picture, write_report
from tacstrip.thesis import chapter2, chapter3, chapter4
from tacstrip.thesis.chapter5 import error_figures
from tacstrip.thesis.chapter5.claims import judge_claims
from tacstrip.thesis.chapter5.recovery_figures import (
    AMBIGUOUS,
    NOISY,
    ambiguity,
    ambiguity_caption,
    noisy_signature,
    noisy_signature_caption,
    recovery,
    recovery_caption,
)
from tacstrip.thesis.chapter5.tables import Cell, run_cell, summarise
from tacstrip.thesis.chapter6 import prototype_figures, recovery_figures
from tacstrip.thesis.chapter6.calibration import calibration_rows, prototype_rows, residual_rows
from tacstrip.thesis.chapter6.claims import judge_chapter6
from tacstrip.thesis.chapter6.tables import run_experiment
from tacstrip.thesis.shapes import POSITIONS

_CAPTIONED = (recovery_figures, prototype_figures)  # files whose `caption` knows each figure's words
_DRAWN: dict[str, Callable[[], Figure]] = {
    **chapter2.FIGURES, **chapter3.FIGURES, **chapter4.FIGURES, **error_figures.FIGURES,
    **recovery_figures.FIGURES, **prototype_figures.FIGURES,
}  # fmt: skip
_OFFSETS = ("calibration", 0)  # a task
Progress = Callable[[int, int], None]


def reproduce(out: Path, seeds: int, workers: int | None, progress: Progress) -> dict[str, Any]:
    """Reproduce tables 5.2-5.14, 6.1-6.11 and the figures of chapters 2 to 6.

    Parameters
    ----------
    out
        Folder for `tables.json`, `report.html` and `figures/`; made if it is missing.
    seeds
        Draws of the errors per noisy cell, and of the rectangle's place per experiment of chapter 6.
    workers
        Processes; None: one per core.
    progress
        Called with the number of tasks done and of all tasks.

    Returns
    -------
    dict
        What `tables.json` holds.
    """
    folder = out / "figures"
    folder.mkdir(parents=True, exist_ok=True)
    cells = [(number, position) for number in range(len(rows())) for position in range(POSITIONS)]
    trials = [("experiment", number) for number in range(len(experiments()))]
    total = len(cells) + len(rows()) + len(_DRAWN) + len(NOISY) + len(AMBIGUOUS) + len(trials) + 1
    done: dict[Any, Any] = {}
    with ProcessPoolExecutor(max_workers=workers or os.cpu_count()) as pool:
        tasks: dict[Future[Any], Any] = {pool.submit(run_cell, *c, seeds): c for c in cells}
        tasks |= {pool.submit(run_experiment, task[1], seeds): task for task in trials}
        tasks[pool.submit(calibration_rows, seeds)] = _OFFSETS
        for future in _finished(pool, tasks, folder):
            done[tasks[future]] = future.result()
            progress(len(done), total)
    by_row = [[done[number, position] for position in range(POSITIONS)] for number in range(len(rows()))]
    ours = [summarise(number, row_cells) for number, row_cells in enumerate(by_row)]
    experiment = [done[task] for task in trials]
    claims = judge_claims(ours, {figure: done["figure", figure] for figure in AMBIGUOUS})
    claims += judge_chapter6(experiment)
    found = {"simulation": ours, "experiment": experiment, "calibration": done[_OFFSETS]}
    tables = _tables(found | {"residual": residual_rows(), "prototype": prototype_rows()}, claims, seeds)
    text = json.dumps(_jsonable(tables), indent=1, allow_nan=False)
    write_text(out / "tables.json", text + "\n")
    write_report(out / "report.html", tables, _pictures(folder))
    return tables


def inside_counts(tables: dict[str, Any]) -> dict[str, tuple[int, int]]:
    """Return table number to (printed values inside our range, printed values compared)."""
    counts: dict[str, tuple[int, int]] = {}
    for row in tables["simulation"]:
        judged = [v for m in METRICS for v in row["ours"]["inside"][m] if v is not None]
        good, total = counts.get(row["table"], (0, 0))
        counts[row["table"]] = good + sum(judged), total + len(judged)
    for row in tables["experiment"]:
        good, total = counts.get(row["table"], (0, 0))
        judged = [row["ours"]["inside"][m] for m in METRICS]
        counts[row["table"]] = good + sum(map(bool, judged)), total + len(judged)
    return counts


def _finished(pool: Executor, tasks: dict[Future[Any], Any], folder: Path) -> Iterator[Future[Any]]:
    """Yield tasks as they finish; a row's figure is drawn once its five cells are there."""
    samples: dict[int, dict[int, Cell]] = {}
    for figure in (*_DRAWN, *NOISY, *AMBIGUOUS):
        tasks[pool.submit(_draw, figure, folder)] = ("figure", figure)
    waiting = set(tasks)
    while waiting:
        future = next(as_completed(waiting))
        waiting.remove(future)
        task = tasks[future]
        if isinstance(task[0], int):
            number, position = task
            row = samples.setdefault(number, {})
            row[position] = future.result()
            if len(row) == POSITIONS:
                shapes = [row[p].sample for p in range(POSITIONS)]
                drawing = pool.submit(_draw_row, number, shapes, folder)
                tasks[drawing] = ("figure", rows()[number].figure)
                waiting.add(drawing)
        yield future


def _file(folder: Path, figure: str) -> Path:
    chapter, number = figure.split(".")
    return folder / f"figure_{chapter}_{int(number):02d}.png"


def _draw(figure: str, folder: Path) -> Any:
    """Draw one figure that needs no cells; return the facts of an ambiguity figure."""
    facts = None
    if figure in AMBIGUOUS:
        drawing, facts = ambiguity(figure)
    else:
        drawing = noisy_signature(figure) if figure in NOISY else _DRAWN[figure]()
    save(drawing, _file(folder, figure))
    return facts


def _draw_row(number: int, samples: list[Any], folder: Path) -> None:
    save(recovery(rows()[number], samples), _file(folder, rows()[number].figure))


def _pictures(folder: Path) -> list[Picture]:
    captions = {f: f"Figure {f}: {(draw.__doc__ or '').splitlines()[0]}" for f, draw in _DRAWN.items()}
    captions |= {f: file.caption(f) for file in _CAPTIONED for f in file.FIGURES}
    captions |= {f: noisy_signature_caption(f) for f in NOISY}
    captions |= {f: ambiguity_caption(f) for f in AMBIGUOUS}
    captions |= {row.figure: recovery_caption(row) for row in rows()}
    ordered = sorted(captions, key=lambda f: tuple(int(part) for part in f.split(".")))
    return [Picture(f, captions[f].replace("$", ""), _file(folder, f)) for f in ordered]


def _tables(
    found: dict[str, list[dict[str, Any]]], claims: list[dict[str, str]], seeds: int
) -> dict[str, Any]:
    """Return the keys of published.toml, each row with `ours`, and the claims."""
    tables: dict[str, Any] = {"seeds": seeds, "claims": claims}
    for key, ours in found.items():
        tables[key] = [{**row, "ours": own} for row, own in zip(published()[key], ours, strict=True)]
    return tables


def _jsonable(value: Any) -> Any:
    """Replace NaN, which JSON does not have, by None."""
    if isinstance(value, dict):
        return {k: _jsonable(v) for k, v in value.items()}
    if isinstance(value, list):
        return [_jsonable(v) for v in value]
    return None if isinstance(value, float) and math.isnan(value) else value
