"""`tacstrip calibrate`."""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import click
import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.calibrate.drift import rezero
from tacstrip.calibrate.plan import Plan, plan
from tacstrip.calibrate.touch import learn_touch, undetectable_mm
from tacstrip.calibrate.unit import Calibrated, calibrate_unit, one_line, require_closed_form, timestamp
from tacstrip.cli import load_sensor, note, options, own_folder, protect, warn
from tacstrip.contact.noise import Noise
from tacstrip.errors import OptionError
from tacstrip.io.input_checks import backwards, half_read, unfinished
from tacstrip.io.readings import read_unchecked
from tacstrip.io.runs import read_runs, write_plan
from tacstrip.sensor.rest_level import rest_hint
from tacstrip.sensor.spec import Sensor

_MOST_LINES = 20
_MANY = 60  # presses: a plan of more says why


@click.command()
@options.SENSOR
@click.argument("data", metavar="[RUNS]", type=options.FILE, required=False)
@options.output("Calibrated spec (.toml), or the plan (.csv).", required=False)
@options.OVERWRITE
@options.file("--report", help="Folder for report.html and its pictures.")
@options.plot("Picture of each strip's error before and after, the worst strips first (.png, .svg, .pdf).")
@options.option("--model", default="auto", metavar="auto|mean|PARTS", help="mean: the thesis' mean offsets. PARTS: of "
                "offset, gain, fade, ratio, ratios, lambda, ends, warp8, curve8, joined by +.")  # fmt: skip
@options.file("--touch", help="Readings (CSV) with nothing on the sensor: learn rest_volt and touch_volt.")
@options.option("--unit", default="", help="Name of this very unit, kept with its calibration.")
@options.flag("--force", help="Take runs that say that they are of another unit, or do not fit.")
@options.flag("--plan", "planned", help="Print the contacts to make; -o writes them as RUNS to fill in.")
@options.number("--wanted", default=0.2, help="For --plan: accuracy [%].")
@options.number("--noise", default=0.2, help="For --plan: half-width of a reading's error [%].")
@options.number("--place-mm", default=0.1, help="For --plan: half-width of a place's error [mm].")
@options.flag("--uneven", help="For --plan: the rubber may vary along y.")
@options.number("--unit-mm", help="For --plan: step of the places [mm]; by default L / 32.5.")
@options.flag("--rezero", "zeroed", help="SENSOR is a calibrated spec, and in place of RUNS stand "
              "readings (CSV) with nothing on the sensor: take the drift from them.")  # fmt: skip
@options.option("--reference", type=options.POINT, metavar="L W",
                help="For --rezero: this contact [mm] lies on the strips instead.")  # fmt: skip
def command(
    sensor: str,
    data: Path | None,
    output: Path | None,
    overwrite: bool,
    report: Path | None,
    plot: Path | None,
    model: str,
    touch: Path | None,
    unit: str,
    force: bool,
    planned: bool,
    zeroed: bool,
    reference: tuple[float, float] | None,
    **design: Any,
) -> None:
    """Calibrate SENSOR (a spec file or a shipped spec) from RUNS (CSV): contacts of known l and w on each strip.

    The calibrated spec stands in for SENSOR in all other verbs. `--plan` says which contacts to make, `--touch` learns
    what an untouched strip reads, `--rezero` removes drift. Exit code 2: the runs are wrong, in other units for
    example; 1: they do not describe this sensor, and no spec is written, or no plan reaches what is wanted.

    Example: tacstrip calibrate sensor.toml runs.csv -o calibrated.toml --report report
    """
    protect(output, sensor, data, touch, force=overwrite, flag="--overwrite")
    protect(plot, sensor, data, touch, output)
    if report is not None:
        own_folder(report, "figures/worst.png")
    _check_options(planned, zeroed, data is not None)
    spec = load_sensor(sensor)
    if planned:
        if not _planned(spec, output, "" if model == "auto" else model, unit, **design):
            sys.exit(1)
        return
    if data is None and touch is None:
        raise OptionError("give RUNS to calibrate from, or one of --touch, --plan, --rezero")
    if output is None:
        raise OptionError("name the spec to write with -o, for example -o calibrated.toml")
    if zeroed and data is not None:
        _rezeroed(spec, data, reference).save(output)
        click.echo(f"{output} written")
        return
    require_closed_form(spec)
    use = f": use it in place of {sensor}"
    if data is not None:
        result = _calibrated(data, spec, model, unit, force)
        spec, runs = result.sensor, result.runs
        if touch is None and all(len(v) for v in runs.rest.values()):
            spec = learn_touch(spec, runs.rest, source=f"{timestamp()}, {runs.source}")
        _write_pictures(result, report, plot)
        warn(result.advice)
        if result.status != "ok":
            if not force:
                note(f"Not calibrated: {output} is written with --force only")
                sys.exit(1)
            use = ", but its constants are doubtful"
    if touch is not None:
        spec = learn_touch(spec, _raw(touch, spec), source=_source(touch))
    if spec.touch_volt is not None and spec.calibration is not None and spec.calibration.touch:
        _show_touch(spec)
    spec.save(output)
    click.echo(f"{output} written{use}")


def _check_options(planned: bool, zeroed: bool, data: bool) -> None:
    """Refuse options that do not belong to the job that was asked for."""
    if planned and zeroed:
        raise OptionError("--plan and --rezero are two jobs; give one of them")
    if planned and data:
        raise OptionError("--plan takes no RUNS: it says which to make; leave them out")
    if zeroed and not data:
        raise OptionError(
            "--rezero needs readings: tacstrip calibrate --rezero CALIBRATED.toml READINGS.csv -o NEW.toml"
        )
    options.belong(planned, "is for --plan; leave it out", "wanted", "noise", "unit_mm", "uneven", "place_mm")
    options.belong(zeroed, "is for --rezero; leave it out", "reference")
    calibrates = data and not zeroed
    options.belong(calibrates, "is of a calibration: give RUNS", "report", "plot", "force")
    options.belong(calibrates or planned, "is of a calibration: give RUNS, or --plan", "model", "unit")
    options.belong(not (planned or zeroed), "is a job of its own, or of a calibration: leave it out", "touch")


def _calibrated(data: Path, spec: Sensor, model: str, unit: str, force: bool) -> Calibrated:
    """Calibrate by the runs of a file, with warnings of what is odd in it, and show what was found."""
    runs = read_runs(data, spec, unit, force)
    warn(half_read(data, spec, runs.signatures), unfinished(data))
    warn(rest_hint(spec, runs.raw, pressed=True), file=data)
    if model == "auto":
        note("Comparing models; this may take some seconds")
    result = calibrate_unit(spec, runs, model=model, unit=unit, force=force)
    _show_result(result)
    return result


def _write_pictures(result: Calibrated, report: Path | None, plot: Path | None) -> None:
    if report is not None:
        from tacstrip.report.calibration import write_report

        click.echo(f"{write_report(result, report)}: report")
    if plot is not None:
        from tacstrip.plot.calibrations import calibration
        from tacstrip.plot.theme import save_axes

        click.echo(f"{save_axes(calibration(result), plot)}: picture")


def _planned(
    spec: Sensor,
    output: Path | None,
    model: str,
    unit: str,
    *,
    wanted: float,
    noise: float,
    place_mm: float,
    unit_mm: float | None,
    uneven: bool,
) -> bool:
    """Show and write the contacts to make, and say whether they reach what is wanted."""
    planned_for = partial(plan, spec, wanted, Noise(positional=noise / 100.0), model, unit_mm, uneven=uneven)
    made = planned_for(place_mm=place_mm)
    _show_plan(made, spec, wanted, place_mm)
    if made.count > _MANY:
        finer_mm = place_mm / 5.0
        if (fewer := planned_for(place_mm=finer_mm).count) < made.count / 2:
            note(
                f"So many because an error of {place_mm:g} mm is {100.0 * place_mm / spec.length_mm:.2g} % of a strip: "
                f"{fewer} do where places are exact to {finer_mm:g} mm (--place-mm)"
            )
    if output is not None:
        places = [
            (s, l, w) for l, w, times in made.contacts for _ in range(times) for s in range(spec.strips)
        ] + [(s, l, 0.0) for s, l in enumerate(made.slanted_mm)]
        write_plan(output, spec, places, unit)
        click.echo(
            f"{output}: fill in the readings, then: tacstrip calibrate SENSOR {output} -o calibrated.toml"
        )
    return made.reached


def _show_plan(made: Plan, spec: Sensor, wanted: float, place_mm: float) -> None:
    tube = spec.kind.cylindrical
    across = "Rings round the tube" if tube else "Contacts across all strips"
    click.echo(f"{across}, from l over w, for a model {made.model}:\n     l [mm]    w [mm]  times")
    for l, w, times in made.contacts:
        click.echo(f"{l:11.4g}{w:10.4g}{times:7d}")
    if made.slanted_mm:
        thin = "a thread wound round it as a helix" if tube else "a thin one, slanted"
        click.echo(
            f"and {thin}: from l = {made.slanted_mm[0]:.4g} on the first strip to "
            f"{made.slanted_mm[-1]:.4g} on the last, which shows exchanged strips; fill in where it lies"
        )
    click.echo(
        f"{made.count + bool(made.slanted_mm)} contacts on each of {spec.strips} strips; corrected readings then lie "
        f"within +-{made.promise_percent:.2g} % of Vref (95 %) with places exact to {place_mm:g} mm, the reading's own "
        "noise not counted"
    )
    if made.floor_percent > wanted:
        warn(
            f"+-{wanted:g} % is not reached, and no number of presses reaches it: one signature does not tell how long "
            f"a contact is, and what rubber that varies by 6 % does depends on that. +-{made.floor_percent:.2g} % "
            "remains; two layers of rubber (CRS-CRS) have no such limit"
        )
    elif not made.reached:
        warn(
            f"+-{wanted:g} % is not reached; take less noisy readings, the mean of several, and measure places more "
            "exactly"
        )


def _show_result(result: Calibrated) -> None:
    click.echo(
        f"{result.runs.count} contacts, model {result.model}: {result.rms_percent(result.before):.3g} % of Vref rms "
        f"before, {result.rms_percent(result.mean):.3g} % after mean offsets, "
        f"{result.rms_percent(result.after):.3g} % after this"
    )
    if np.isfinite(result.accuracy_percent):
        click.echo(
            f"  other corrected readings lie within +-{result.accuracy_percent:.2g} % of Vref (95 %), their own noise "
            "not counted"
        )
    from tacstrip.report.calibration import wrongest  # late, as all that loads Matplotlib

    for when, after in (("furthest off before", False), ("largest residuals, after", True)):
        worst = wrongest(result, 3, after=after)
        click.echo(f"  {when}: {', '.join(f'strip {strip} ({percent:.2g} %)' for strip, percent in worst)}")
    for p in result.parameters:
        if p.strip is None:
            click.echo(f"  {p.name} = {_with_deviation(p.value, p.sigma)} {p.unit}".rstrip())
    refused: dict[str, list[str]] = {}
    for trial in result.trials:
        if trial.verdict.startswith("refused"):
            refused.setdefault(trial.verdict.removeprefix("refused: "), []).append(trial.name)
    for why, names in list(refused.items())[:_MOST_LINES]:
        note(f"  not fitted: {', '.join(names)}: {why}")
    for row in result.excluded[:_MOST_LINES]:
        strip = row.strip + result.uncalibrated.strip_base
        note(f"  line {row.line}, strip {strip}: excluded, {row.why}")
    if len(result.excluded) > _MOST_LINES:
        note(f"  ... and {len(result.excluded) - _MOST_LINES} more rows")


def _with_deviation(value: float, sigma: float) -> str:
    """Write a value to the digits of its deviation, of which two are shown."""
    if not (math.isfinite(sigma) and sigma > 0.0):
        return f"{value:.5g} +- {sigma:.2g}"
    decimals = max(0, 1 - math.floor(math.log10(sigma)))
    return f"{value:.{decimals}f} +- {sigma:.2g}"


def _show_touch(spec: Sensor) -> None:
    low, high = undetectable_mm(spec)
    click.echo(f"rest_volt = {spec.rest_volt:.4g}, touch_volt = {spec.touch_volt:.4g} learned")
    if np.isfinite(low).any():
        worst = int(np.nanargmax(high - low))
        warn(
            f"a point contact between y = {low[worst]:.3g} and {high[worst]:.3g} mm on strip "
            f"{worst + spec.strip_base} reads as untouched"
        )


def _rezeroed(spec: Sensor, readings: Path, reference: tuple[float, float] | None) -> Sensor:
    require_closed_form(spec)
    sensor, measured = rezero(spec, _raw(readings, spec), source=_source(readings), reference=reference)
    kept = [str(i + spec.strip_base) for i in np.flatnonzero(~measured)]
    click.echo(f"{int(measured.sum())} of {spec.strips} strips re-zeroed")
    if kept:
        strips = ", ".join(kept[:_MOST_LINES])
        warn(f"strips {strips} are touched, vary or moved too far, and keep their drift")
    for channel in sensor.calibration.channels if sensor.calibration else ():
        worst = max(channel.drift, key=abs, default=0.0)
        click.echo(f"  {channel.signature}: drift up to {100.0 * worst:+.3g} % of Vref")
    return sensor


def _raw(path: Path, spec: Sensor) -> dict[str, FloatArray]:
    """Return the raw readings of a readings file by signature (scans, strips)."""
    scans = read_unchecked(path, replace(spec, calibration=None, rest_volt=None, touch_volt=None))
    warn(half_read(path, spec, scans[0].signatures))
    if path.is_file():  # a pipe is read once
        warn(backwards(path, spec), unfinished(path))
    return {name: np.stack([scan[name] for scan in scans]) for name in scans[0].signatures}


def _source(path: Path) -> str:
    return f"{timestamp()}, {one_line(path.name)}"
