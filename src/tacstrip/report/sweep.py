"""A sweep as one self-contained HTML page: the Pareto front, pictures, and what could not be measured."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tacstrip.dataset.measures import PROBLEM, columns
from tacstrip.dataset.sweep import Sweep, error_column, pareto
from tacstrip.plot.sweep import draw_sweep
from tacstrip.report.page import Picture, write_page

_MOST_ROWS = 60


def write_report(study: Sweep, results: Mapping[str, Sequence[Any]], folder: Path) -> Path:
    """Write report.html and its pictures into a folder; return the page."""
    error = error_column(study)
    front = [] if error is None else pareto(results, error)
    pictures = []
    if error is not None and any(v is not None for v in results[error]):
        made = draw_sweep(results, study.parameters, error, front, folder / "figures")
        pictures = [Picture("", caption, file) for caption, file in made]
    names = ["design", *study.parameters, *columns(study.measures)]
    file = folder / "report.html"
    whys = [p for p in results[PROBLEM] if p is not None]
    write_page(
        file, "sweep.html.j2", study=study, error=error, names=names, pictures=pictures,
        rows=[[_cell(results[name][i]) for name in names] for i in front[:_MOST_ROWS]], on_front=len(front),
        problems=Counter(whys).most_common(20), unmeasured=len(whys),
    )  # fmt: skip
    return file


def _cell(value: Any) -> str:
    if value is None:
        return "-"
    return value if isinstance(value, str) else f"{value:.4g}" if isinstance(value, float) else str(value)
