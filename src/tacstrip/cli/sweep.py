"""`tacstrip sweep`."""

from __future__ import annotations

from pathlib import Path

import click

from tacstrip.cli import note, options, own_folder, warn
from tacstrip.cli.progress import progress_bar
from tacstrip.dataset.measures import PROBLEM
from tacstrip.dataset.sweep import Sweep, batches_there, collect, error_column, pareto, sweep
from tacstrip.errors import OptionError
from tacstrip.io.input_checks import unlikely_lengths


def _shard(_: click.Context, __: click.Parameter, value: str | None) -> tuple[int, int]:
    """Return which part of the batches is meant."""
    if value is None:
        return 1, 1
    which, slash, count = value.partition("/")
    if not (slash and which.isascii() and count.isascii() and which.isdigit() and count.isdigit()):
        raise OptionError(f"--shard {value}: give I/N, such as 3/16: the third of sixteen")
    if not 1 <= int(which) <= int(count):
        raise OptionError(f"--shard {value}: there is no such shard; they are 1/{count} to {count}/{count}")
    return int(which), int(count)


@click.command()
@click.argument("study", type=options.FILE)
@options.file("--out", required=True, help="Folder of the results.")
@options.option(
    "--shard", callback=_shard, metavar="I/N", help="Only every N-th batch from the I-th on: for job arrays."
)
@options.option("--workers", type=options.WholeRange(1), help="Processes; by default one per core.")
@options.option(
    "--dask", metavar="ADDRESS", help="Scheduler of a Dask cluster to work on, such as tcp://host:8786."
)
@options.flag("--plan", help="Only count designs and batches, and those that are there.")
def command(
    study: Path, out: Path, shard: tuple[int, int], workers: int | None, dask: str | None, plan: bool
) -> None:
    """Measure the designs that STUDY (a TOML file) lists: bounds, accuracy, right counts, coverage, speed.

    Ended at any point, or divided among machines that share the folder, the same command goes on; the last one writes
    results.parquet, results.csv and report.html.

    Example: tacstrip sweep study.toml --out designs --shard 3/16
    """
    if not plan:  # which writes nothing
        own_folder(out, "batches")
    asked = Sweep.load(study)
    warn(unlikely_lengths(asked.base.sensor), file=study)
    if plan:
        there = batches_there(out)
        names = [batch.name for batch in asked.batches(shard)]
        done = sum(name in there for name in names)
        click.echo(
            f"{asked.designs} designs; {len(names)} batches of {asked.batch_designs}, {done} of them there"
        )
        return
    try:
        with progress_bar() as bar:
            task = bar.add_task("batches", total=None)
            state = sweep(
                asked, out, shard, workers, dask, lambda s: bar.update(task, completed=s.done, total=s.total)
            )
    except RuntimeError as error:  # what is there stays, and the same command goes on
        raise click.ClickException(f"{error}; is there enough memory?") from None
    click.echo(f"{out}: {state.done} of {state.total} batches are there")
    if state.paid_s:
        share = 100.0 * state.work_s / state.paid_s
        click.echo(f"{state.work_s:.1f} s of work, {share:.0f} % of the workers' time")
    results = collect(asked, out)
    if results is None:
        note("Batches of other shards are missing; the run that finds all of them writes the results.")
        return
    from tacstrip.report.sweep import write_report  # late, as all that loads Matplotlib

    page = write_report(asked, results, out)
    column = error_column(asked)
    if column is not None:
        front = pareto(results, column)
        click.echo(
            f"{len(front)} of {asked.designs} designs are on the Pareto front of error, strips, connectors, rate"
        )
    lack = sum(why is not None for why in results[PROBLEM])
    but = f", {lack} of them not or not wholly measured: the column {PROBLEM} says why" if lack else ""
    click.echo(f"{page}: the report\n{out / 'results.parquet'}, .csv: all {asked.designs} designs{but}")
