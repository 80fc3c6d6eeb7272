"""`tacstrip noise`."""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import click

from tacstrip.cli import load_log, options, protect, warn, warn_of_log
from tacstrip.diagnose.learned_noise import LearnedNoise, learn_noise
from tacstrip.errors import OptionError, ReadingError, figures
from tacstrip.files import write_text
from tacstrip.reconstruction.noise_covariance import Averaging, reading_variance
from tacstrip.sensor.spec import Sensor, with_noise

_SHOWN = (1, 16, 64)  # scans averaged
_REPLACED = "; its [noise] table replaces the one that was there"


@click.command()
@click.argument("recording", type=options.FILE)
@click.argument("sensor", metavar="[SENSOR]", required=False)
@options.output("Write the spec with the noise to this file.", required=False)
@options.FORCE
@options.file("--write", metavar="SENSOR.toml",
              help="Put the noise into this spec; its other lines stay as they are.")  # fmt: skip
@options.option("--vertices", type=options.WholeRange(3, 40), help="Of the contact, where that is known.")
@options.plot("Picture of the Allan deviation (.png, .svg, .pdf).")
def command(
    recording: Path,
    sensor: str | None,
    output: Path | None,
    force: bool,
    write: Path | None,
    vertices: int | None,
    plot: Path | None,
) -> None:
    """Learn the parts of a sensor's noise from RECORDING: readings (CSV) or a recording (.mcap) of a still press.

    SENSOR, a spec file or a shipped spec, is left out where --write names it, and for a .mcap, which holds its own.
    A minute of a press that rests on many strips tells the contact's noise; untouched strips only the converter's.
    Exit code 1: it cannot be told, for the contact moves, or nothing touches; then no spec is written.

    Example: tacstrip noise still.csv --write sensor.toml --plot allan.png
    """
    protect(output, recording, force=force)
    protect(write, recording, force=True)  # the spec that it is to edit
    protect(plot, recording, sensor, output, write)
    spec = sensor or (None if write is None else str(write))
    log = load_log(recording, spec, f"tacstrip noise {recording} sensor.toml")
    warn(log.missing, file=recording)
    warn_of_log(recording, log)
    if not log.sensor.kind.closed_form:
        raise OptionError(
            f"a {log.sensor.construction} sensor's noise cannot be learned: it has no closed form (3.3)"
        )
    try:
        found = learn_noise(log, vertices)
    except ReadingError as error:
        click.echo(f"Error: {recording}: {error}", err=True)
        sys.exit(1)
    click.echo("\n".join(_lines(found, log.sensor)))
    if plot is not None:
        from tacstrip.plot.noise import allan_figure
        from tacstrip.plot.theme import save

        click.echo(f"{save(allan_figure(found), plot)}: picture")
    if not found.touched and (output or write):
        click.echo("Error: no spec is written: this is no noise of a contact", err=True)
        sys.exit(1)
    for target, text in ((write, write), (output, spec)):
        if target is not None:
            own = text and Path(text).is_file()
            given = Path(text).read_text(encoding="utf-8") if text and own else log.sensor.to_toml()
            write_text(target, with_noise(given, found.noise))
            had = target == write and "noise" in tomllib.loads(given)
            click.echo(f"{target} written" + (_REPLACED if had else ""))


def _lines(found: LearnedNoise, sensor: Sensor) -> Iterator[str]:
    """Say what was learned."""
    noise, sure = found.noise, found.sure

    def percent(sigma: float, part: str = "") -> str:
        about = f" +- {100.0 * min(sure[part], 9.99):.2g} % of it" if part in sure else ""
        return f"{100.0 * sigma:.3g} % of Vref ({figures(sigma * sensor.length_mm)} mm){about}"

    yield (
        f"{found.scans} scans over {found.period_s * (found.scans - 1):.4g} s, {len(found.channels)} channels; "
        "standard deviations"
    )
    yield f"White noise: {percent(noise.white, 'white')}, {100.0 * noise.white_shared:.0f} % of the variance shared"
    for sigma, time_s in noise.processes:
        slow = time_s > 10.0 * found.period_s * found.scans
        longer = "over longer than this recording, by the strips' differences"
        over = longer if slow else f"in some {time_s:.3g} s"
        yield f"Wander of the zero {over}: {percent(sigma, 'static' if slow else 'wander')}"
    if noise.processes:
        yield (
            f"All channels share {100.0 * noise.wander_shared:.0f} % of the wander's variance, the strips of one "
            f"signature {100.0 * noise.wander_by_signature:.0f} % more"
        )
    if noise.edge_mm:
        yield (
            f"Ends of the contact: {noise.edge_mm:.3g} mm +- {100.0 * sure['static']:.2g} % of it, correlated over "
            f"{noise.edge_correlation_mm:.3g} mm across the strips"
        )
    if noise.hum:
        yield f"Hum at {noise.hum_hz:g} Hz: {percent(noise.hum)}"
    yield f"Strays: {100.0 * noise.strays:.2g} % of the readings" + (
        f", of {percent(noise.stray_size)}" if noise.strays else ""
    )
    for count in _SHOWN:
        mean = Averaging(count, found.period_s * (count - 1))
        sigma = reading_variance(noise, sensor, mean) ** 0.5
        yield f"A mean of {count} scan(s) is off by {percent(sigma)}, edges not counted"
    for sentence in found.unidentifiable:
        yield f"Cannot tell {sentence}"
