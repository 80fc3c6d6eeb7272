"""`tacstrip limits`."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np

from tacstrip.arrays import FloatArray, plain
from tacstrip.cli import load_layers, options, protect, warn
from tacstrip.cli.progress import progress_bar
from tacstrip.contact.noise import Noise
from tacstrip.contact.shape import Contact
from tacstrip.core.binding import exported
from tacstrip.design.area import area_limit, circle, is_round
from tacstrip.design.candidates import BITS, CONVERSION_S, FARAD, Design, candidates, designs
from tacstrip.design.check import check
from tacstrip.design.layers import layer_limits, outlines_of
from tacstrip.design.limits import ErrorMap, Limit, limit_map, limits, outline_of
from tacstrip.errors import OptionError, is_number
from tacstrip.files import write_text
from tacstrip.geometry.outline import Outline
from tacstrip.io.input_checks import unlikely_contact
from tacstrip.reconstruction.cramer_rao import reading_sigma, vertex_rms
from tacstrip.sensor.layers import AnySensor, LayeredSensor, unit_of
from tacstrip.sensor.spec import Sensor
from tacstrip.tracking.rigid.covariance import joint_bound

_MOST_LINES = 20
_MOST_FITS = 0.9  # of them within what is wanted
_CHECKED = 6  # designs at most, from the coarsest on, until one does
_CIRCLE = "circle:"
_BOUND = (
    "Bounds: a fit misses them by some part, often a fifth; --check 40 simulates 40 placements and fits them"
)


def _percent(_: click.Context, parameter: click.Parameter, text: str | None) -> float | None:
    """Return a share in %, written with its sign or without."""
    if text is None:
        return None
    if not is_number(number := text.removesuffix("%").strip()) or not 0.0 < float(number) < math.inf:
        raise OptionError(f"{parameter.opts[0]} {text}: give a number of % above 0, such as 8%")
    return float(number)


@click.command()
@options.SENSOR
@options.CONTACT
@options.AT
@options.TURN
@options.noise
@options.WITHOUT
@options.whole("--bits", help="Resolution of the A/D converter instead of the spec's.")
@options.option("--grid", type=options.WholeRange(2, 200), default=16, help="Places a side.")
@options.plot()
@options.output("All numbers, to a file (.json).", required=False)
@options.FORCE
@options.option("--scans", type=options.WholeRange(2), metavar="N",
                help="Also: what N scans of a moving object tell together.")  # fmt: skip
@options.number("--slide", default=0.0, metavar="MM", help="With --scans: its way across the strips.")
@options.number("--rotate", default=0.0, metavar="DEG", help="With --scans: how far it turns on the way.")
@options.number("--wanted-mm", help="Look for designs that reach this RMS vertex error.")
@options.option("--area-error", "area_percent", metavar="PERCENT", callback=_percent,
                help="Look for designs that reach this standard error of the area, such as 8%.")  # fmt: skip
@options.option("--check", "placements", type=options.WholeRange(1), metavar="N",
                help="Simulate and fit N placements: on SENSOR, or on designs from the coarsest on.")  # fmt: skip
@options.option("--construction", multiple=True,
                help="Design: try this one; repeat. Default: all flat, or all round.")  # fmt: skip
@options.number("--pitch", multiple=True, metavar="MM", help="Design: try this pitch; repeat.")
@options.number("--length", multiple=True, metavar="MM", help="Design: try this length; repeat.")
@options.whole("--try-bits", multiple=True, metavar="BITS", help="Design: try this A/D converter; repeat.")
@options.number("--picofarad", default=FARAD * 1e12, help="Design: input capacitance.")
@options.number("--conversion-us", default=CONVERSION_S * 1e6, help="Design: a conversion.")
def command(
    sensor: str,
    contact: Path,
    at: tuple[float, float] | None,
    turn: float,
    noise: Noise,
    without: tuple[str, ...],
    bits: int | None,
    grid: int,
    plot: Path | None,
    output: Path | None,
    force: bool,
    scans: int | None,
    slide: float,
    rotate: float,
    wanted_mm: float | None,
    area_percent: float | None,
    placements: int | None,
    **design: Any,
) -> None:
    """Say how well SENSOR (a spec file or a shipped spec) can locate the corners of CONTACT, and tell its area.

    CONTACT is a .wkt or .geojson file [mm], or circle:RADIUS. The Cramer-Rao bound: no unbiased method does better with
    normal noise of this variance, and a fit misses it by some part; --check says by how much. With --wanted-mm or
    --area-error also which designs reach an error, and which of Harmon's requirements (table 2.1) they fail; exit code
    1: none does.

    Example: tacstrip limits simulated-crs-crs object.wkt --at 500 400 --positional 0.005 --plot limits.png
    """
    protect(plot, sensor, contact)
    protect(output, sensor, contact, plot, force=force)
    options.belong(scans is not None, "is for many scans: give --scans as well", "slide", "rotate")
    sought = wanted_mm is not None or area_percent is not None
    options.belong(sought, "is for designs: give --wanted-mm or --area-error as well", *design)
    spec = load_layers(sensor, without)
    if isinstance(spec, LayeredSensor):
        why = "is for a sensor of one layer; two are compared with each alone"
        options.belong(
            False, why, "grid", "plot", "output", "scans", "wanted_mm", "area_percent", "placements"
        )
        layered = spec if bits is None else spec.changed(adc_bits=bits)
        _of_layers(layered, _placed(contact, at, turn, layered.unit), noise)
        return
    spec = spec if bits is None else replace(spec, adc_bits=bits)
    noise, shape = _noise(noise, spec), _placed(contact, at, turn, spec)
    warn(unlikely_contact(shape, spec))
    outline = outline_of(spec, shape)
    found = limits(spec, outline, noise)
    round_ = is_round(outline)
    options.belong(
        not round_, "is of corners, and this outline is round", "grid", "plot", "scans", "wanted_mm"
    )
    if not round_:
        _show_limits(spec, outline, found)
    _show_area(spec, outline, noise, found, round_)
    if scans is not None:
        _show_joint(spec, outline, scans, slide, math.radians(rotate), reading_sigma(noise, spec))
    over = None if round_ else limit_map(spec, outline, noise, grid, grid)
    if over is not None:
        _show_map(over)
    click.echo(_BOUND)
    judged = _judged(spec, outline, noise, wanted_mm, area_percent, **design) if sought else None
    _write(plot, output, spec, outline, found, over, judged)
    reached = _reached(judged, wanted_mm, area_percent, outline) if judged is not None else []
    if placements is not None and (reached or not sought):
        _show_check(_coarsest(reached) or [spec], outline, noise, placements, (wanted_mm, area_percent))
    if sought and not reached:
        sys.exit(1)


def _judged(
    spec: Sensor,
    outline: Outline,
    noise: Noise,
    wanted_mm: float | None,
    area_percent: float | None,
    **design: Any,
) -> list[Design]:
    """Return designs like the sensor, each with the errors it reaches."""
    sensors = list(candidates(spec, design["construction"] or None, design["pitch"], design["length"]))
    farad, conversion_s = design["picofarad"] * 1e-12, design["conversion_us"] * 1e-6
    tried_bits = design["try_bits"] or BITS
    return designs(
        sensors, outline, noise, wanted_mm, tried_bits, farad, conversion_s, area_percent=area_percent
    )


def _reached(
    judged: list[Design], wanted_mm: float | None, area_percent: float | None, outline: Outline
) -> list[Design]:
    """Show the designs, and return those that reach what is wanted."""
    mm, percent = (math.inf if v is None else v for v in (wanted_mm, area_percent))
    reached = [d for d in judged if d.noise > 0.0 and d.error_mm <= mm and d.area_percent <= percent]
    others = [d for d in judged if d.noise > 0.0 and d not in reached]
    errors = ((wanted_mm, "mm RMS"), (area_percent, "% of the area"))
    wanted = " and ".join(f"{value:.6g} {unit}" for value, unit in errors if value is not None)
    _show_designs(reached, others, judged, wanted, outline)
    return reached


def _placed(contact: Path, at: tuple[float, float] | None, turn: float, sensor: Sensor) -> Contact:
    """Return the contact where it lies; a circle in the middle where no place is given."""
    name = str(contact)
    if name.startswith(_CIRCLE):
        if not is_number(radius := name.removeprefix(_CIRCLE)) or not 0.0 < float(radius) < math.inf:
            raise OptionError(f"{name}: give the radius in mm, such as circle:15")
        shape = Contact.polygon(circle(float(radius)).vertices)
        return shape.placed(*(at or (0.5 * sensor.width_mm, 0.5 * sensor.length_mm)))
    return options.placed(contact, at, turn)


def _noise(given: Noise, sensor: AnySensor) -> Noise:
    """Return the noise that was given, or the spec's where none was."""
    if sensor.noise is not None and not options.given("quantisation", "positional"):
        return sensor.noise
    if reading_sigma(given, unit_of(sensor)) == 0.0:
        raise OptionError(
            "without errors of the readings there is no limit: give what they are, such as --positional 0.005, "
            "--quantisation 0.001 or --bits 12, or a [noise] table in the spec (`tacstrip noise`)"
        )
    return given


def _of_layers(sensor: LayeredSensor, contact: Contact, noise: Noise) -> None:
    """Print the bound of both layers and of each alone."""
    found = layer_limits(sensor, contact, _noise(noise, sensor))
    names = ["both layers", *(f"layer {limit.layers[0]} alone" for limit in found[1:])]
    click.echo("Least standard errors of x and y of each corner [mm]")
    click.echo(f"{'object':>6} {'x':>9} {'y':>9}" + "".join(f"{name:>20}" for name in names))
    row = 0
    for number, outline in enumerate(outlines_of(contact), 1):
        for x, y in outline:
            pairs = [limit.sigma[row] for limit in found]
            row += 1
            text = "".join(f"{a:>12.3g}{b:>8.3g}" for a, b in pairs)
            click.echo(f"{number:>6} {x:9.5g} {y:9.5g}{text}")
    seen = [int(np.isfinite(limit.sigma).all(axis=1).sum()) for limit in found]
    told = ", ".join(f"{name} {count}" for name, count in zip(names, seen, strict=True))
    click.echo(f"Of {row} corners are determined by {told}; inf: hidden by other objects, or too few strips")


def _show_area(sensor: Sensor, outline: Outline, noise: Noise, found: list[Limit], round_: bool) -> None:
    values = [100.0 * area_limit(sensor, outline, noise, limit) for limit in found]
    if round_:
        names = ", ".join("+".join(limit.signatures) for limit in found)
        click.echo(
            f"Round: it turns by 45 deg or less at each corner, so corners are not sought; area from {names}"
        )
    click.echo(
        "Area, std. error [%]"
        + "".join(f"{value:>{19 if not i else 20}.3g}" for i, value in enumerate(values))
    )


def _coarsest(reached: list[Design]) -> list[Sensor]:
    """Return the coarsest sensors among designs, each pitch, length and construction once, the coarsest first."""
    alike: dict[tuple[str, float, float], Sensor] = {}
    for d in sorted(reached, key=lambda d: (-d.sensor.pitch_mm, d.sensor.strips, -(d.sensor.adc_bits or 0))):
        alike.setdefault((d.sensor.construction, d.sensor.pitch_mm, d.sensor.length_mm), d.sensor)
    return list(alike.values())[:_CHECKED]


def _show_check(
    sensors: list[Sensor], outline: Outline, noise: Noise, placements: int,
    wanted: tuple[float | None, float | None],
) -> None:  # fmt: skip
    """Print what fits of simulated scans reach beside the bound."""
    round_, assessed = is_round(outline), exported("sample_outlines") is not None
    told = "as a round object" if round_ else f"{len(outline.vertices)} corners told"
    click.echo(
        f"What fits reach: {placements} random places each, simulated with the noise that you gave, {told}; median, "
        "and what nine of ten reach; inf: no outline, or another number of corners"
        + ("" if round_ else "; RMS of the bound and of the fits: over all these places")
        + ("" if assessed else "; ok ?: not assessed, as the compiled core is missing")
    )
    heads = "" if round_ else f"{'bound RMS':>11}{'fit RMS':>9}{'median':>8}{'9 of 10':>9}"
    click.echo(f"{'construction':<13}{'pitch':>7}{'length':>8}{heads}{'area %':>9}{'9 of 10':>9}{'ok':>6}")
    with progress_bar() as bar:
        task = bar.add_task("placements", total=placements * len(sensors))
        lines, reached, on_average = [], [], []
        for sensor in sensors:
            found = check(sensor, outline, noise, placements, progress=lambda: bar.advance(task))
            line = f"{sensor.construction:<13}{sensor.pitch_mm:>7.4g}{sensor.length_mm:>8.4g}"
            if not round_:
                bound, fit = (float(np.sqrt(np.mean(np.square(v)))) for v in (found.bound_mm, found.rms_mm))
                line += f"{bound:>11.3g}{fit:>9.3g}" + _middle_and_most(found.rms_mm, 8)
            sure = f"{100.0 * found.ok.mean():>5.0f}%" if assessed else f"{'?':>6}"
            lines.append(line + _middle_and_most(found.area_percent, 9) + sure)
            within, figures = np.ones(placements, dtype=bool), []
            for errors, most, unit in zip(
                (found.rms_mm, found.area_percent), wanted, ("mm", "% of the area"), strict=True
            ):
                if most is not None:
                    within &= errors <= most
                    figures.append((float(np.sqrt(np.mean(np.square(errors)))), most, _most(errors), unit))
            if wanted != (None, None) and within.mean() >= _MOST_FITS:
                reached.append(sensor)
                break
            if figures and all(rms <= most for rms, most, _, _ in figures):
                on_average.append((sensor, figures))
    click.echo("\n".join(lines))
    if wanted != (None, None):
        first = reached[0] if reached else None
        click.echo(
            "On none of these are nine fits of ten within what is wanted: try finer pitches"
            if first is None
            else f"Nine fits of ten are within what is wanted on pitch {first.pitch_mm:.4g} mm, {first.construction}"
        )
    if on_average:
        first, figures = on_average[0]
        both = ", ".join(f"{rms:.3g} {unit} (nine of ten: {nine:.3g})" for rms, _, nine, unit in figures)
        click.echo(
            f"The RMS of the fits is within it on pitch {first.pitch_mm:.4g} mm, {first.construction}: {both}"
        )


def _middle_and_most(errors: FloatArray, width: int) -> str:
    """Give the median of errors, and what nine of ten reach."""
    return f"{np.sort(errors)[len(errors) // 2]:>{width}.3g}{_most(errors):>9.3g}"


def _most(errors: FloatArray) -> float:
    """Return what nine of ten errors are within; some may be inf."""
    return float(np.sort(errors)[math.ceil(_MOST_FITS * len(errors)) - 1])


def _why_open(outline: Outline, pitch_mm: float) -> str:
    """Say why readings of all signatures do not determine an outline, and which pitch does."""
    across = np.abs(np.diff(outline.vertices[:, 0], append=outline.vertices[0, 0]))
    shortest = float(across[across > 1e-6 * across.max()].min())
    if pitch_mm <= 0.5 * shortest:
        return "the strips in contact do not determine it; a finer pitch or a wider contact would"
    return (
        f"the {len(outline.vertices)} corners are known where each edge crosses two strips, and the shortest spans "
        f"{shortest:.3g} mm across them: a pitch of {0.5 * shortest:.2g} mm or less does; for the area of a round "
        "object give circle:RADIUS, or corners that turn by 45 deg at most"
    )


def _show_limits(sensor: Sensor, outline: Outline, found: list[Limit]) -> None:
    names = ["+".join(limit.signatures) for limit in found]
    click.echo("Least standard errors of x and y of each vertex [mm], from " + ", ".join(names))
    click.echo("      vertex       " + "".join(f"{name:>20}" for name in names))
    click.echo(f"{'x':>9} {'y':>9}" + "".join(f"{'x':>11}{'y':>9}" for _ in names))
    for i, (x, y) in enumerate(outline.vertices):
        pairs = [limit.sigma[i] for limit in found]
        click.echo(f"{x:9.6g} {y:9.6g}" + "".join(f"{a:>11.3g}{b:>9.3g}" for a, b in pairs))
    click.echo("RMS over vertices  " + "".join(f"{limit.rms:>20.3g}" for limit in found))
    if not all(math.isfinite(limit.rms) for limit in found):
        alone = math.isfinite(found[-1].rms)
        why = "one signature alone does not determine it" if alone else _why_open(outline, sensor.pitch_mm)
        click.echo(f"inf: {why}")


def _show_joint(
    sensor: Sensor, outline: Outline, scans: int, slide_mm: float, turn: float, sigma: float
) -> None:
    """Say how well many scans of a moving object tell its corners."""
    rms = vertex_rms(joint_bound(sensor, outline.vertices, scans, slide_mm, turn, sigma))
    click.echo(
        f"{scans} scans in which it slides {slide_mm:g} mm across the strips and turns {math.degrees(turn):g} deg, all "
        f"signatures: {rms:.3g} mm RMS of the shape (`tacstrip track`)"
    )


def _show_map(over: ErrorMap) -> None:
    best, worst = over.rms_mm.min(), over.rms_mm.max()
    click.echo(
        f"Over the sensor, {over.rms_mm.size} places, all signatures: {best:.3g} to {worst:.3g} mm RMS, "
        f"median {np.median(over.rms_mm):.3g}"
    )


def _show_designs(
    reached: list[Design], others: list[Design], judged: list[Design], wanted: str, outline: Outline
) -> None:
    """Print the designs that reach the wanted error with the noise that was given, or those that do with less."""
    click.echo(
        f"By the bound {len(reached)} of {len(judged)} designs reach {wanted} at nine places of ten with the noise "
        "that you gave"
    )
    if (
        not reached
        and judged
        and not any(math.isfinite(d.error_mm) for d in judged)
        and not is_round(outline)
    ):
        finest = min(d.sensor.pitch_mm for d in judged)
        click.echo(f"No noise is small enough: {_why_open(outline, finest)}")
    elif not reached:
        click.echo("Try a longer --length list, finer --pitch, more --try-bits, or a larger error")
    if others:
        click.echo(f"{len(others)} more reach it with less noise{'' if reached else ', in `noise %`'}")
    if not (reached or others):
        return
    if reached:
        best = max(reached, key=lambda d: (d.sensor.pitch_mm, -d.sensor.strips, d.noise)).sensor
        click.echo(
            f"The coarsest that does, by the bound: pitch {best.pitch_mm:.4g} mm, {best.strips} strips "
            f"{best.length_mm:.4g} mm long, {best.construction}, {best.adc_bits} bits"
        )
    reached = reached or others
    click.echo(
        "`error` [mm RMS], `area %`: bounds with the noise that you gave, of nine places of ten; `noise %`: the "
        "largest that still reaches what is wanted (half-width, % of Vref)"
    )
    click.echo(
        f"{'construction':<13}{'strips':>7}{'pitch':>8}{'length':>8}{'bits':>5}{'error':>9}{'area %':>8}{'noise %':>9}"
        "  fails"
    )
    for d in reached[:_MOST_LINES]:
        s = d.sensor
        click.echo(
            f"{s.construction:<13}{s.strips:>7}{s.pitch_mm:>8.4g}{s.length_mm:>8.4g}{s.adc_bits:>5}"
            f"{d.error_mm:>9.3g}{d.area_percent:>8.3g}{100.0 * d.noise:>9.3g}  {', '.join(d.unmet) or 'none'}"
        )
    if len(reached) > _MOST_LINES:
        click.echo(f"... and {len(reached) - _MOST_LINES} more; -o writes all of them")
    click.echo(
        "`fails` are of Harmon's requirements (table 2.1); surface and sensitivity are not in the model"
    )


def _write(
    plot: Path | None, output: Path | None, sensor: Sensor, outline: Outline, found: list[Limit], over: ErrorMap | None,
    judged: list[Design] | None,
) -> None:  # fmt: skip
    """Write the picture and the numbers that were asked for; of a round outline there is no picture."""
    if plot is not None and over is not None:
        from tacstrip.plot.bounds import limits_figure
        from tacstrip.plot.theme import save

        click.echo(f"{save(limits_figure(sensor, outline, found, over), plot)}: picture")
    if output is not None:
        write_text(output, json.dumps(_record(outline, found, over, judged), indent=1))
        click.echo(f"{output}: numbers")


def _record(
    outline: Outline, found: list[Limit], over: ErrorMap | None, judged: list[Design] | None
) -> dict[str, Any]:
    """Return what goes into the file; null stands for what the readings do not determine."""
    record: dict[str, Any] = {
        "vertices_mm": outline.vertices.tolist(),
        "limits": [
            {
                "signatures": limit.signatures,
                "rms_mm": plain(limit.rms),
                "sigma_mm": plain(limit.sigma),
                "covariance_mm2": plain(limit.covariance),
            }
            for limit in found
        ],
    }
    if over is not None:
        record["map"] = {"x_mm": over.x_mm.tolist(), "y_mm": over.y_mm.tolist(), "rms_mm": plain(over.rms_mm)}
    if judged is not None:
        keys = ("construction", "strips", "pitch_mm", "length_mm", "adc_bits")
        record["designs"] = [
            {key: getattr(d.sensor, key) for key in keys}
            | {
                "error_mm": plain(d.error_mm),
                "area_percent": plain(d.area_percent),
                "largest_noise": d.noise,
                "unmet": d.unmet,
            }
            for d in judged
        ]
    return record
