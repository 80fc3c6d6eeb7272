"""`tacstrip simulate`."""

from __future__ import annotations

import math
from pathlib import Path

import click
import numpy as np
import shapely
from click.core import ParameterSource

from tacstrip.cli import load_sensor, protect, warn
from tacstrip.contact.footprint import footprint
from tacstrip.contact.noise import Noise, NoiseProcess
from tacstrip.errors import OptionError
from tacstrip.files import write_text
from tacstrip.io.geometry import read_contact
from tacstrip.io.input_checks import contact_in_metres
from tacstrip.io.readings import write_readings
from tacstrip.simulation import simulate

_POINT = (float, float)


@click.command()
@click.argument("sensor", metavar="SENSOR")
@click.argument("contact", metavar="CONTACT", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True, help="Readings file (CSV).")
@click.option("--at", type=_POINT, metavar="X Y", help="Put the contact's centroid here [mm].")
@click.option("--turn", type=float, default=0.0, metavar="DEG", help="Turn it counter-clockwise.")
@click.option(
    "--drag", type=_POINT, multiple=True, metavar="X Y", help="Drag it on to here; repeat for a path."
)
@click.option("--steps", type=int, default=5, show_default=True, help="Scans along the path.")
@click.option("--still", type=click.IntRange(1), metavar="N", help="N scans of the contact at rest.")
@click.option("--turn-per-step", type=float, default=0.0, metavar="DEG", help="Turn it while dragging.")
@click.option("--rate", type=float, default=100.0, show_default=True, help="Scans a second, of several [Hz].")
@click.option("--quantisation", type=float, default=0.0, help="C.Q.E., half-width over Vref (thesis: 0.001).")
@click.option(
    "--positional", type=float, default=0.0, help="P.U., half-width over Vref (thesis: 0.005, 0.01)."
)
@click.option("--distribution", default="uniform", show_default=True, help="uniform or normal.")
@click.option("--noisy", is_flag=True, help="Errors as the spec's [noise] says, lasting from scan to scan.")
@click.option("--model", help="closed or network; by default closed where the construction has closed forms.")
@click.option("--electrodes", default="own", show_default=True, help="CRS-CRP: own or all.")
@click.option("--seed", type=int, default=0, show_default=True, help="Of the errors.")
@click.option(
    "--placed",
    type=click.Path(path_type=Path),
    help="Write the contact as placed (.wkt), for reconstruct --truth.",
)
@click.option("--plot", type=click.Path(path_type=Path), help="Picture to write (.png, .svg, .pdf).")
def command(
    sensor: str,
    contact: Path,
    output: Path,
    at: tuple[float, float] | None,
    turn: float,
    drag: tuple[tuple[float, float], ...],
    steps: int,
    still: int | None,
    turn_per_step: float,
    rate: float,
    quantisation: float,
    positional: float,
    distribution: str,
    noisy: bool,
    model: str | None,
    electrodes: str,
    seed: int,
    placed: Path | None,
    plot: Path | None,
) -> None:
    """Press CONTACT (.wkt or .geojson, mm) on SENSOR (a spec file or a shipped spec) and write the readings.

    Example: tacstrip simulate prototype-crs-crs object.wkt -o readings.csv --at 32 160 --positional 0.005
    """
    protect(output, sensor, contact)
    protect(placed, sensor, contact, output)
    protect(plot, sensor, contact, output)
    if placed is not None and drag:
        raise OptionError("--placed writes one place; leave --drag out")
    if plot is not None:
        from tacstrip.plot.style import check_picture

        check_picture(plot)
    spec = load_sensor(sensor)
    noise = Noise(quantisation=quantisation, positional=positional, distribution=distribution)  # type: ignore[arg-type]
    if noisy:
        if spec.noise is None:
            raise OptionError(f"--noisy: {sensor} has no [noise] table; `tacstrip noise` writes one")
        if noise != Noise(distribution=noise.distribution):
            raise OptionError("--noisy takes the spec's noise: leave --quantisation and --positional out")
        noise = spec.noise
    if seed < 0 or not rate > 0.0:
        bad = f"--seed {seed}: must be 0 or more" if seed < 0 else f"--rate {rate}: must be above 0"
        raise OptionError(bad)
    given = click.get_current_context().get_parameter_source
    if still and drag:
        raise OptionError("--still and --drag: a contact rests or moves; leave one out")
    for option in ("steps", "turn_per_step", "rate"):
        if not (drag or (still and option == "rate")) and given(option) is ParameterSource.COMMANDLINE:
            raise OptionError(f"--{option.replace('_', '-')} needs --drag: there is one scan only")
    shape = read_contact(contact)
    shape = (shape.placed(*at) if at else shape).turned(math.radians(turn))
    start = tuple(shape.centroid)
    places = (
        shape.dragged([start, *drag], steps, math.radians(turn_per_step)) if drag else [shape] * (still or 1)
    )
    touch = footprint(spec, places)
    process = NoiseProcess(noise, spec, seed)
    scans = [
        simulate(spec, c, process=process, model=model, time_s=i / rate, electrodes=electrodes)  # type: ignore[arg-type]
        for i, c in enumerate(places)
    ]
    write_readings(output, spec, scans)
    if placed is not None:
        write_text(placed, shapely.GeometryCollection(list(shape.shapes)).wkt + "\n")
    touched, split = (int(strips.any(axis=0).sum()) for strips in (np.isfinite(touch.l), touch.pieces > 1))
    click.echo(f"{output}: {len(scans)} scan(s) of {spec.strips} strips, {touched} of them touched")
    if touched == 0:
        small = contact_in_metres(shape, spec)
        warn("no strip is touched: the contact falls between centre lines" + (f"; {small}" if small else ""))
    if touch.clipped:
        warn("a part of the contact lies off the sensor and was cut away")
    if split:
        warn(f"{split} strip(s) see several pieces of the contact as one, from end to end")
    if plot is not None:
        from tacstrip.plot.result import reconstruction_figure
        from tacstrip.plot.style import save

        click.echo(f"{save(reconstruction_figure(spec, scans, {}, places), plot)}: picture")
