"""One self-contained HTML page: claims, tables with the printed figures, pictures inside."""

from __future__ import annotations

import base64
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tacstrip.data import data_path
from tacstrip.files import write_text

METRIC_NAMES = {"mc": "M.C. [rad]", "aoe": "A.O.E. [rad]", "ape": "A.P.E. [units]"}
EXPERIMENT_NAMES = {  # ours: (what it is, the printed one)
    "mc": ("M.C. times mean perimeter [rad cm]", "mc"),
    "mc_rad": ("M.C. [rad]", "mc"),
    "aoe": ("A.O.E. [rad]", "aoe"),
    "ape": ("A.P.E. [cm]", "ape"),
}
_CONCLUSIONS = {"5": "Conclusions of sections 5.4 and 5.6", "6": "Conclusions of chapter 6"}


@dataclass(frozen=True)
class Picture:
    """A figure on disk with its caption."""

    figure: str
    caption: str
    file: Path

    @property
    def source(self) -> str:
        """The picture as a data address, so that the page needs no other file."""
        return "data:image/png;base64," + base64.b64encode(self.file.read_bytes()).decode("ascii")


def write_page(path: Path, template: str, **values: object) -> None:
    """Write a page from the packaged template of that name and its values."""
    import jinja2

    strict = jinja2.StrictUndefined
    environment = jinja2.Environment(autoescape=True, undefined=strict, trim_blocks=True, lstrip_blocks=True)
    environment.filters["number"] = _number
    source = data_path(template).read_text(encoding="utf-8")
    write_text(path, environment.from_string(source).render(values))


def write_report(path: Path, tables: dict[str, Any], pictures: list[Picture]) -> None:
    """Write the page for `tables` as `reproduce` makes them."""
    write_page(
        path,
        "report.html.j2",
        seeds=tables["seeds"],
        conclusions={
            title: [c for c in tables["claims"] if c["section"].startswith(chapter)]
            for chapter, title in _CONCLUSIONS.items()
        },
        tables=_by_table(tables["simulation"]),
        chapters=_by_chapter(pictures),
        metric_names=METRIC_NAMES,
        experiment_names=EXPERIMENT_NAMES,
        **{key: tables[key] for key in ("experiment", "calibration", "residual", "prototype")},
    )


def _number(value: float | None, digits: int = 3) -> str:
    """Print as the thesis does, with so many decimals; a dash where there is no number."""
    return "-" if value is None or math.isnan(value) else f"{value:.{digits}f}"


def _by_table(simulation: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Group the rows by table, with the count of printed values inside our range."""
    grouped: dict[str, list[dict[str, Any]]] = {}
    for row in simulation:
        grouped.setdefault(row["table"], []).append(row)
    result = []
    for number, table_rows in grouped.items():
        inside = [row["ours"]["inside"] for row in table_rows]
        judged = [v for of in inside for metric in METRIC_NAMES for v in of[metric] if v is not None]
        first = table_rows[0]
        method = f"V.R. with {first['signature']}" if first["signature"] else "P.R."
        title = f"Table {number}: {first['shape']}, {first['sensor']}, {method}"
        result.append({"title": title, "rows": table_rows, "good": sum(judged), "total": len(judged)})
    return result


def _by_chapter(pictures: list[Picture]) -> dict[str, list[Picture]]:
    grouped: dict[str, list[Picture]] = {}
    for picture in pictures:
        grouped.setdefault(picture.figure.split(".")[0], []).append(picture)
    return grouped
