"""`tacstrip reproduce`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
import numpy as np

from tacstrip.cli import options, own_folder
from tacstrip.cli.progress import progress_bar
from tacstrip.data.published import METRICS
from tacstrip.thesis.ranges import POINTS
from tacstrip.thesis.reproduce import inside_counts, reproduce, reproduce_table

_NONE, _RANGE = "none", "{median:.3f} ({p05:.3f} to {p95:.3f})"


@click.command()
@options.file("--out", default="reproduction", help="Folder.")
@options.option("--seeds", type=options.WholeRange(1), default=200, help="Draws per noisy cell.")
@options.option("--workers", type=options.WholeRange(1), help="Processes; by default one per core.")
@options.option(
    "--table", metavar="NUMBER", help="One table only, of 5.2-5.14, 6.2-6.4 or 6.6, printed here; no file."
)
@options.figure_format("Of the figures; svg and pdf are written beside those that the report shows.")
def command(out: Path, seeds: int, workers: int | None, table: str | None, kind: str) -> None:
    """Reproduce tables 5.2-5.14, 6.1-6.11 and the figures of chapters 2 to 6, with the printed values.

    Writes tables.json, report.html and figures/. Example: tacstrip reproduce --out reproduction --seeds 20; one table
    in some seconds: tacstrip reproduce --table 5.5
    """
    if table is not None:
        options.belong(False, "is for the whole: leave it or --table out", "out", "kind")
        with progress_bar() as bar:
            task = bar.add_task(f"table {table}", total=None)
            rows = reproduce_table(
                table, seeds, workers, lambda n, total: bar.update(task, completed=n, total=total)
            )
        click.echo("\n".join(_lines(rows, seeds)))
        return
    own_folder(out, "figures/figure_[2-6]_[0-9][0-9].png")
    with progress_bar() as bar:
        task = bar.add_task("cells and figures", total=None)
        tables = reproduce(
            out, seeds, workers, lambda n, total: bar.update(task, completed=n, total=total), kind
        )
    click.echo("Printed values inside our 5-95 % range:")
    counts = inside_counts(tables)
    for table, (good, total) in counts.items():
        click.echo(f"  table {table:<5} {good:3d} of {total}")
    good, total = (sum(c[i] for c in counts.values()) for i in (0, 1))
    click.echo(f"  all         {good} of {total}\n\nConclusions:")
    for claim in tables["claims"]:
        click.echo(f"  {claim['section']:<6} {claim['verdict']:<14} {claim['claim']}")
    click.echo(f"\n{out / 'report.html'}: the report\n{out / 'tables.json'}: the numbers")


def _lines(rows: list[dict[str, Any]], seeds: int) -> Iterator[str]:
    """Give a table with what is printed and ours side by side."""
    first, simulated = rows[0], "shape" in rows[0]
    of = f", {first['shape']}, {first['signature'] or 'both signatures'}" if simulated else ""
    yield f"Table {first['table']}: {first['algorithm']}, {first['sensor']}{of}"
    yield (
        f"Printed value, then our median (5 % to 95 %) of {seeds} draws; * printed outside our range, - printed so, "
        "? not readable; `none`: share of draws without a shape, in rows with P.U. if the transitions have to be found "
        "from the readings (the medians are of known ones)"
    )
    units = ("rad", "rad", "mm") if simulated else ("rad cm", "rad", "cm")
    heads = zip(("M.C.", "A.O.E.", "A.P.E."), units, strict=True)
    yield f"{'':<25}" + "".join(f"{f'{name} [{unit}]':<34}" for name, unit in heads) + "none"
    for row in rows:
        for position in range(len(np.atleast_1d(row["ours"]["failed"]))):
            about = (
                f"{row['noise'].removeprefix('quantisation + ')}, position {position + 1}"
                if simulated
                else f"{row['region']}, {row['signature'] or 'profile'}{'' if row['calibrated'] else ', raw'}"
            )
            cells = "".join(_cell(row, metric, position) for metric in METRICS)
            yield f"{about:<25}{cells}{np.atleast_1d(row['ours']['failed'])[position]:.0%}"
    good, total = inside_counts({"simulation": rows, "experiment": []})[first["table"]]
    yield f"{good} of {total} printed values are inside our range"


def _cell(row: dict[str, Any], metric: str, position: int) -> str:
    """Give a printed value and ours, 34 characters wide."""
    ours = {point: np.atleast_1d(row["ours"][metric][point])[position] for point in POINTS}
    inside = np.atleast_1d(row["ours"]["inside"][metric])[position]
    value = np.atleast_1d(row[metric])[position] if metric in row else None
    text = "?" if value is None else "-" if np.isnan(value) else f"{value:.3f}"
    text += "" if inside is None or inside else "*"
    return f"{text:<8}{_NONE if ours['median'] is None else _RANGE.format(**ours):<26}"
