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

from tacstrip.arrays import plain
from tacstrip.cli import load_layers, options, protect, warn
from tacstrip.contact.noise import Noise
from tacstrip.contact.shape import Contact
from tacstrip.design.candidates import BITS, CONVERSION_S, FARAD, Design, candidates, designs
from tacstrip.design.layers import layer_limits, outlines_of
from tacstrip.design.limits import ErrorMap, Limit, limit_map, limits, outline_of
from tacstrip.errors import OptionError
from tacstrip.files import write_text
from tacstrip.geometry.outline import Outline
from tacstrip.io.input_checks import unlikely_contact
from tacstrip.reconstruction.cramer_rao import reading_sigma, vertex_rms
from tacstrip.sensor.layers import AnySensor, LayeredSensor, unit_of
from tacstrip.sensor.spec import Sensor
from tacstrip.tracking.rigid.covariance import joint_bound

_MOST_LINES = 20


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
@options.option("--scans", type=options.WholeRange(2), metavar="N",
                help="Also: what N scans of a moving object tell together.")  # fmt: skip
@options.number("--slide", default=0.0, metavar="MM", help="With --scans: its way across the strips.")
@options.number("--rotate", default=0.0, metavar="DEG", help="With --scans: how far it turns on the way.")
@options.number("--wanted-mm", help="Look for designs that reach this RMS vertex error.")
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
    scans: int | None,
    slide: float,
    rotate: float,
    wanted_mm: float | None,
    **design: Any,
) -> None:
    """Say how well SENSOR (a spec file or a shipped spec) can locate the corners of CONTACT (.wkt or .geojson, mm).

    The Cramer-Rao bound: no unbiased method does better with normal noise of this variance. With --wanted-mm also
    which designs reach an error, and which of Harmon's requirements (table 2.1) they fail; exit code 1: none does.

    Example: tacstrip limits simulated-crs-crs object.wkt --at 500 400 --positional 0.005 --plot limits.png
    """
    protect(plot, sensor, contact)
    protect(output, sensor, contact, plot)
    options.belong(scans is not None, "is for many scans: give --scans as well", "slide", "rotate")
    options.belong(wanted_mm is not None, "is for designs: give --wanted-mm as well", *design)
    spec = load_layers(sensor, without)
    if isinstance(spec, LayeredSensor):
        why = "is for a sensor of one layer; two are compared with each alone"
        options.belong(False, why, "grid", "plot", "output", "scans", "wanted_mm")
        spec = spec if bits is None else spec.changed(adc_bits=bits)
        _of_layers(spec, options.placed(contact, at, turn), noise)
        return
    spec = spec if bits is None else replace(spec, adc_bits=bits)
    noise, shape = _noise(noise, spec), options.placed(contact, at, turn)
    warn(unlikely_contact(shape, spec))
    outline = outline_of(spec, shape)
    found = limits(spec, outline, noise)
    _show_limits(outline, found)
    if scans is not None:
        _show_joint(spec, outline, scans, slide, math.radians(rotate), reading_sigma(noise, spec))
    over = limit_map(spec, outline, noise, grid, grid)
    _show_map(over)
    judged = None
    if wanted_mm is not None:
        sensors = list(candidates(spec, design["construction"] or None, design["pitch"], design["length"]))
        farad, conversion_s = design["picofarad"] * 1e-12, design["conversion_us"] * 1e-6
        judged = designs(sensors, outline, noise, wanted_mm, design["try_bits"] or BITS, farad, conversion_s)
    if plot is not None:
        from tacstrip.plot.bounds import limits_figure
        from tacstrip.plot.theme import save

        click.echo(f"{save(limits_figure(spec, outline, found, over), plot)}: picture")
    if output is not None:
        write_text(output, json.dumps(_record(outline, found, over, judged), indent=1))
        click.echo(f"{output}: numbers")
    if judged is not None and wanted_mm is not None:
        reached = [d for d in judged if d.noise > 0.0 and d.error_mm <= wanted_mm]
        _show_designs(
            reached, [d for d in judged if d.noise > 0.0 and d not in reached], len(judged), wanted_mm
        )
        if not reached:
            sys.exit(1)


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


def _show_limits(outline: Outline, found: list[Limit]) -> None:
    names = ["+".join(limit.signatures) for limit in found]
    click.echo("Least standard errors of x and y of each vertex [mm], from " + ", ".join(names))
    click.echo("      vertex       " + "".join(f"{name:>20}" for name in names))
    click.echo(f"{'x':>9} {'y':>9}" + "".join(f"{'x':>11}{'y':>9}" for _ in names))
    for i, (x, y) in enumerate(outline.vertices):
        pairs = [limit.sigma[i] for limit in found]
        click.echo(f"{x:9.6g} {y:9.6g}" + "".join(f"{a:>11.3g}{b:>9.3g}" for a, b in pairs))
    click.echo("RMS over vertices  " + "".join(f"{limit.rms:>20.3g}" for limit in found))
    if not all(math.isfinite(limit.rms) for limit in found):
        click.echo("inf: the strips in contact do not determine it; a finer pitch or a wider contact would")


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


def _show_designs(reached: list[Design], others: list[Design], tried: int, wanted_mm: float) -> None:
    """Print the designs that reach the wanted error with the noise that was given, or those that do with less."""
    click.echo(
        f"{len(reached)} of {tried} designs reach {wanted_mm:.6g} mm RMS at nine places of ten with the noise that you "
        "gave"
    )
    if not reached:
        click.echo("Try a longer --length list, finer --pitch, more --try-bits, or a larger error")
    if others:
        click.echo(f"{len(others)} more reach it with less noise{'' if reached else ', in `noise %`'}")
    if not (reached or others):
        return
    if reached:
        best = max(reached, key=lambda d: (d.sensor.pitch_mm, -d.sensor.strips, d.noise)).sensor
        click.echo(
            f"The coarsest that does: pitch {best.pitch_mm:.4g} mm, {best.strips} strips {best.length_mm:.4g} mm long, "
            f"{best.construction}, {best.adc_bits} bits"
        )
    reached = reached or others
    click.echo(
        "`error`: with the noise that you gave; `noise %`: the largest that still reaches it (half-width, % of Vref)"
    )
    click.echo(
        f"{'construction':<13}{'strips':>7}{'pitch':>8}{'length':>8}{'bits':>5}{'error':>9}{'noise %':>9}  fails"
    )
    for d in reached[:_MOST_LINES]:
        s = d.sensor
        click.echo(
            f"{s.construction:<13}{s.strips:>7}{s.pitch_mm:>8.4g}{s.length_mm:>8.4g}{s.adc_bits:>5}"
            f"{d.error_mm:>9.3g}{100.0 * d.noise:>9.3g}  {', '.join(d.unmet) or 'none'}"
        )
    if len(reached) > _MOST_LINES:
        click.echo(f"... and {len(reached) - _MOST_LINES} more; -o writes all of them")
    click.echo(
        "`fails` are of Harmon's requirements (table 2.1); surface and sensitivity are not in the model"
    )


def _record(
    outline: Outline, found: list[Limit], over: ErrorMap, judged: list[Design] | None
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
        "map": {"x_mm": over.x_mm.tolist(), "y_mm": over.y_mm.tolist(), "rms_mm": plain(over.rms_mm)},
    }
    if judged is not None:
        keys = ("construction", "strips", "pitch_mm", "length_mm", "adc_bits")
        record["designs"] = [
            {key: getattr(d.sensor, key) for key in keys}
            | {"error_mm": plain(d.error_mm), "largest_noise": d.noise, "unmet": d.unmet}
            for d in judged
        ]
    return record
