"""`tacstrip reproduce`."""

from __future__ import annotations

from pathlib import Path

import click
from rich.progress import Progress

from tacstrip.cli import options
from tacstrip.thesis.reproduce import inside_counts, reproduce


@click.command()
@options.file("--out", default="reproduction", help="Folder.")
@options.option("--seeds", type=options.WholeRange(1), default=200, help="Draws per noisy cell.")
@options.option("--workers", type=options.WholeRange(1), help="Processes; by default one per core.")
@options.figure_format("Of the figures; svg and pdf are written beside those that the report shows.")
def command(out: Path, seeds: int, workers: int | None, kind: str) -> None:
    """Reproduce tables 5.2-5.14, 6.1-6.11 and the figures of chapters 2 to 6, with the printed values.

    Writes tables.json, report.html and figures/. Example: tacstrip reproduce --out reproduction --seeds 20
    """
    with Progress(transient=True) as bar:
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
