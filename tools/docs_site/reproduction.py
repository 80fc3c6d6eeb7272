"""Chapters 2 to 6 a page each: the directives `{printed-table} 5.5`, `{thesis-figures} 5.5` and `{claims} 5`.

The figures are drawn while the site is built. The tables come from docs/reproduction/results.json, which
`python tools/docs_site/reproduction.py reproduction/tables.json` writes from what `tacstrip reproduce` has written.
"""

from __future__ import annotations

import json
import math
import re
import sys
from functools import cache
from pathlib import Path
from typing import Any

from docutils import nodes
from matplotlib.figure import Figure
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from docs_site.legible import refuse_small_letters

RESULTS = Path(__file__).parents[2] / "docs" / "reproduction" / "results.json"
_METRICS = {"mc": "M.C. [rad]", "aoe": "A.O.E. [rad]", "ape": "A.P.E. [units]"}
_KEPT = ("median", "p05", "p95")


def summarised(tables: dict[str, Any]) -> dict[str, Any]:
    """Return what the pages show of `tables.json`, in numbers of four digits."""

    def kept(row: dict[str, Any], metrics: tuple[str, ...]) -> dict[str, Any]:
        names = (
            "table",
            "figure",
            "sensor",
            "algorithm",
            "signature",
            "shape",
            "noise",
            "region",
            "calibrated",
        )
        own = row["ours"]
        short: dict[str, Any] = {n: row[n] for n in names if n in row}
        short["printed"] = {m: row.get(m) for m in metrics if m in row}
        short["ours"] = {m: {k: _rounded(own[m][k]) for k in _KEPT} for m in metrics}
        short["inside"] = {m: own["inside"][m] for m in metrics}
        return short

    return {
        "seeds": tables["seeds"],
        "claims": tables["claims"],
        "simulation": [kept(row, tuple(_METRICS)) for row in tables["simulation"]],
        "experiment": [kept(row, ("mc", "mc_rad", "aoe", "ape")) for row in tables["experiment"]],
        "calibration": [
            {
                "table": row["table"],
                "sensor": row["sensor"],
                "signature": row["signature"],
                "printed": row["offset_volt"],
                "ours": {k: _rounded(row["ours"]["offset_volt"][k]) for k in _KEPT},
                "inside": row["ours"]["offset_volt"]["inside"],
            }
            for row in tables["calibration"]
        ],
    }


def _rounded(value: Any) -> Any:
    if isinstance(value, list):
        return [_rounded(v) for v in value]
    return None if value is None else float(f"{0.0 if abs(value) < 1e-9 else value:.4g}")


@cache
def _results() -> dict[str, Any]:
    found: dict[str, Any] = json.loads(RESULTS.read_text(encoding="utf-8"))
    return found


def printed_table(number: str) -> str:
    """Return a table of chapter 5 or 6 in Markdown: the printed value, then our median and 5 % to 95 % range."""
    simulated = [row for row in _results()["simulation"] if row["table"] == number]
    if simulated:
        lines = ["| noise | | " + " | ".join(f"position {p}" for p in range(1, 6)) + " |", "| --- " * 7 + "|"]
        for row in simulated:
            for metric, name in _METRICS.items():
                cells = [_cell(row, metric, p) for p in range(5)]
                lines.append(f"| {row['noise']} | {name} | " + " | ".join(cells) + " |")
        return "\n".join(lines)
    lines = [
        "| figure | region | " + " | ".join(_METRICS.values()).replace("units", "cm") + " |",
        "| --- " * 5 + "|",
    ]
    for row in _results()["experiment"]:
        if row["table"] == number:
            region = row["region"] + ("" if row["calibrated"] else ", not calibrated")
            cells = [_cell(row, metric, None) for metric in ("mc", "aoe", "ape")]
            lines.append(f"| {row['figure']} | {region} | " + " | ".join(cells) + " |")
    if len(lines) > 2:
        return "\n".join(lines)
    lines = ["| strip | printed [V] | ours [V] |", "| --- | --- | --- |"]
    for row in _results()["calibration"]:
        if row["table"] == number:
            for i, value in enumerate(row["printed"]):
                ours = " ".join(_range(*(row["ours"][k][i] for k in _KEPT)))
                name = f"{row['signature']}, {i + 1}"
                lines.append(f"| {name} | {_bold(f'{value:.3f}', row['inside'][i])} | {ours} |")
    if len(lines) == 2:
        raise KeyError(f"there is no table {number} in {RESULTS.name}")
    return "\n".join(lines)


def _cell(row: dict[str, Any], metric: str, position: int | None) -> str:
    def at(value: Any) -> Any:
        return value if position is None or value is None else value[position]

    printed = at(row["printed"].get(metric)) if metric in row["printed"] else "not readable"
    ours = _range(*(at(row["ours"][metric][k]) for k in _KEPT))
    text = printed if isinstance(printed, str) else _number(printed)
    return f"{_bold(text, at(row['inside'][metric]))}; {' '.join(ours)}"


def _bold(text: str, inside: bool | None) -> str:
    return f"**{text}**" if inside else text


def _range(median: float | None, low: float | None, high: float | None) -> tuple[str, ...]:
    return (_number(median),) if low == high else (_number(median), f"({_number(low)} to {_number(high)})")


def _number(value: float | None) -> str:
    return "-" if value is None or math.isnan(value) else f"{value:.3f}"


def claims(chapter: str) -> str:
    """Return the thesis' conclusions of a chapter with our verdicts, in Markdown."""
    lines = ["| section | the thesis says | verdict | evidence |", "| --- | --- | --- | --- |"]
    for one in _results()["claims"]:
        if one["section"].startswith(chapter):
            cells = (one["section"], one["claim"], f"**{one['verdict']}**", one["evidence"])
            lines.append("| " + " | ".join(str(c).replace("|", "\\|") for c in cells) + " |")
    return "\n".join(lines)


def figure_numbers(docs: Path) -> list[str]:
    """Return the numbers of the figures that the chapters' pages show."""
    pages = sorted((docs / "reproduction").glob("*.md"))
    lists = re.findall(r"\{thesis-figures\} (.*)", "\n".join(p.read_text(encoding="utf-8") for p in pages))
    return " ".join(lists).split()


def draw_figure(number: str, docs: Path) -> tuple[Path, str]:
    """Draw a figure unless it is there; return its file and its caption."""
    from tacstrip.data.published import rows
    from tacstrip.plot.theme import save
    from tacstrip.thesis.captions import caption
    from tacstrip.thesis.chapter5 import figures
    from tacstrip.thesis.chapter5.tables import run_cell
    from tacstrip.thesis.reproduce import _DRAWN
    from tacstrip.thesis.shapes import POSITIONS

    def drawn(figure: Figure) -> None:
        save(figure, file, dpi=110)
        refuse_small_letters(figure, file.name)

    folder = docs / "reproduction" / "figures"
    folder.mkdir(exist_ok=True)
    file = folder / f"figure_{number.replace('.', '_')}.png"
    recovered = {row.figure: n for n, row in enumerate(rows())}
    if number in _DRAWN:
        if not file.exists():
            drawn(_DRAWN[number]())
        return file, caption(_DRAWN[number])
    row = rows()[recovered[number]]
    if not file.exists():
        cells = [run_cell(recovered[number], p, 1) for p in range(POSITIONS)]
        drawn(figures.recovery(row, [cell.sample for cell in cells]))
    return file, figures.recovery_caption(row)


class _Table(SphinxDirective):
    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        return self.parse_text_to_nodes(printed_table(self.arguments[0]))


class _Claims(SphinxDirective):
    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        return self.parse_text_to_nodes(claims(self.arguments[0]))


class _Figures(SphinxDirective):
    """Figures by their numbers in the thesis, each with its caption."""

    required_arguments = 1
    final_argument_whitespace = True

    def run(self) -> list[nodes.Node]:
        made: list[nodes.Node] = []
        for number in self.arguments[0].split():
            file, text = draw_figure(number, Path(self.env.srcdir))
            text = f"Figure {number}: {text.replace('$', '')}"
            image = nodes.image(uri=f"figures/{file.name}", alt=text)
            made.append(nodes.figure("", image, nodes.caption("", text)))
        return made


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directives."""
    app.add_directive("printed-table", _Table)
    app.add_directive("claims", _Claims)
    app.add_directive("thesis-figures", _Figures)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


if __name__ == "__main__":
    stored = json.dumps(summarised(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))), indent=0)
    RESULTS.write_text(stored + "\n", encoding="utf-8")
