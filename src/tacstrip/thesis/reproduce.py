"""Chapters 5 and 6 reproduced: all cells, all figures, `tables.json` and `report.html` in one folder."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from concurrent.futures import as_completed
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from tacstrip.data.published import METRICS, experiments, published, rows
from tacstrip.errors import OptionError, one_of
from tacstrip.files import write_text
from tacstrip.interrupt import worker_processes
from tacstrip.plot.theme import save
from tacstrip.report.page import Picture, write_report
from tacstrip.thesis import chapter2, chapter3, chapter4
from tacstrip.thesis.captions import caption
from tacstrip.thesis.chapter5 import figures as chapter5
from tacstrip.thesis.chapter5.claims import judge_claims
from tacstrip.thesis.chapter5.tables import run_cell, summarise
from tacstrip.thesis.chapter6 import figures as chapter6
from tacstrip.thesis.chapter6.claims import judge_chapter6
from tacstrip.thesis.chapter6.tables import calibration_rows, prototype_rows, residual_rows, run_experiment
from tacstrip.thesis.shapes import POSITIONS

_FILES = (chapter2, chapter3, chapter4, chapter5, chapter6)
_DRAWN = {figure: draw for file in _FILES for figure, draw in file.FIGURES.items()}
Progress = Callable[[int, int], None]


def reproduce(
    out: Path, seeds: int, workers: int | None, progress: Progress, kind: str = "png"
) -> dict[str, Any]:
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
    kind
        "svg" or "pdf": the figures as such files too; the page shows those that are "png".

    Returns
    -------
    dict
        What `tables.json` holds.
    """
    folder = out / "figures"
    folder.mkdir(parents=True, exist_ok=True)
    numbers = {"simulation": range(len(rows())), "experiment": range(len(experiments()))}
    tasks: dict[Any, tuple[Any, ...]] = {"calibration": (calibration_rows, seeds)}
    tasks |= {("simulation", n): (_run_row, n, seeds, folder, kind) for n in numbers["simulation"]}
    tasks |= {("experiment", n): (run_experiment, n, seeds) for n in numbers["experiment"]}
    tasks |= {figure: (_draw, figure, folder, kind) for figure in _DRAWN}
    done = _all(tasks, workers, progress)
    found = {key: [done[key, number] for number in each] for key, each in numbers.items()}
    claims = judge_claims(found["simulation"]) + judge_chapter6(found["experiment"])
    found |= {"calibration": done["calibration"], "residual": residual_rows(), "prototype": prototype_rows()}
    tables: dict[str, Any] = {"seeds": seeds, "claims": claims}
    for key, ours in found.items():
        tables[key] = [{**row, "ours": own} for row, own in zip(published()[key], ours, strict=True)]
    text = json.dumps(_jsonable(tables), indent=1, allow_nan=False)
    write_text(out / "tables.json", text + "\n")
    write_report(out / "report.html", tables, _pictures(folder))
    return tables


def reproduce_table(table: str, seeds: int, workers: int | None, progress: Progress) -> list[dict[str, Any]]:
    """Reproduce one table of 5.2 to 5.14, or one of 6.2, 6.3, 6.4 and 6.6, without a file.

    Returns
    -------
    list of dict
        Its rows as in `tables.json`: what is printed, and `ours`.

    Raises
    ------
    OptionError
        There is no such table.
    """
    run = {"simulation": _summary, "experiment": run_experiment}
    tasks = {
        (key, number): (of, number, seeds)
        for key, of in run.items()
        for number, row in enumerate(published()[key])
        if row["table"] == table
    }
    if not tasks:
        tables = dict.fromkeys(row["table"] for key in run for row in published()[key])
        raise OptionError(one_of("--table", table, list(tables)))
    done = _all(tasks, workers, progress)
    return [{**published()[key][number], "ours": done[key, number]} for key, number in tasks]


def _all(tasks: dict[Any, tuple[Any, ...]], workers: int | None, progress: Progress) -> dict[Any, Any]:
    """Do tasks, each a function and its arguments, in worker processes; return what comes of them by key."""
    done: dict[Any, Any] = {}
    with worker_processes(workers) as pool:
        futures = {pool.submit(*task): key for key, task in tasks.items()}
        for future in as_completed(futures):
            done[futures[future]] = future.result()
            progress(len(done), len(tasks))
    return done


def inside_counts(tables: dict[str, Any]) -> dict[str, tuple[int, int]]:
    """Return table number to (printed values inside our range, printed values compared)."""
    counts: dict[str, tuple[int, int]] = {}
    for row in (*tables["simulation"], *tables["experiment"]):
        inside = [value for m in METRICS for value in np.atleast_1d(row["ours"]["inside"][m])]
        judged = [value for value in inside if value is not None]
        good, total = counts.get(row["table"], (0, 0))
        counts[row["table"]] = good + sum(judged), total + len(judged)
    return counts


def _run_row(number: int, seeds: int, folder: Path, kind: str) -> dict[str, Any]:
    """Run a row's cells, draw its figure, and return its results."""
    cells = [run_cell(number, position, seeds) for position in range(POSITIONS)]
    row = rows()[number]
    _save(chapter5.recovery(row, [cell.sample for cell in cells]), folder, row.figure, kind)
    return summarise(number, cells)


def _summary(number: int, seeds: int) -> dict[str, Any]:
    return summarise(number, [run_cell(number, position, seeds) for position in range(POSITIONS)])


def _draw(figure: str, folder: Path, kind: str) -> None:
    _save(_DRAWN[figure](), folder, figure, kind)


def _save(drawn: Figure, folder: Path, figure: str, kind: str) -> None:
    """Write a figure for the page, and as the kind of file that was asked for."""
    file = save(drawn, _file(folder, figure))
    if kind != "png":
        save(drawn, file.with_suffix(f".{kind}"))


def _file(folder: Path, figure: str) -> Path:
    chapter, number = figure.split(".")
    return folder / f"figure_{chapter}_{int(number):02d}.png"


def _pictures(folder: Path) -> list[Picture]:
    captions = {figure: caption(draw) for figure, draw in _DRAWN.items()}
    captions |= {row.figure: chapter5.recovery_caption(row) for row in rows()}
    ordered = sorted(captions, key=lambda f: tuple(int(part) for part in f.split(".")))
    return [Picture(f, f"Figure {f}: {captions[f].replace('$', '')}", _file(folder, f)) for f in ordered]


def _jsonable(value: Any) -> Any:
    """Replace NaN, which JSON does not have, by None."""
    if isinstance(value, dict):
        return {k: _jsonable(v) for k, v in value.items()}
    if isinstance(value, list):
        return [_jsonable(v) for v in value]
    return None if isinstance(value, float) and math.isnan(value) else value
