"""`tacstrip simulate`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np
import shapely

from tacstrip.cli import load_layers, options, protect, save_picture, warn
from tacstrip.contact.footprint import footprint
from tacstrip.contact.noise import Noise, NoiseProcess
from tacstrip.contact.shape import Contact
from tacstrip.errors import OptionError
from tacstrip.files import write_text
from tacstrip.io.input_checks import unlikely_contact
from tacstrip.io.readings import write_readings
from tacstrip.sensor.layers import AnySensor, LayeredSensor, unit_of
from tacstrip.simulation import simulate


@click.command()
@options.SENSOR
@options.CONTACT
@options.output("Readings file (CSV).")
@options.FORCE
@options.AT
@options.TURN
@options.option("--drag", type=options.POINT, multiple=True, metavar="X Y",
                help="Drag it on to here; repeat for a path.")  # fmt: skip
@options.whole("--steps", default=5, help="Scans along the path.")
@options.option("--still", type=options.WholeRange(1), metavar="N", help="N scans of the contact at rest.")
@options.number("--turn-per-step", default=0.0, metavar="DEG", help="Turn it while dragging.")
@options.number("--rate", default=100.0, callback=options.rate, help="Scans a second, of several [Hz].")
@options.noise
@options.WITHOUT
@options.flag("--noisy", help="Errors as the spec's [noise] says, lasting from scan to scan.")
@options.MODEL
@options.ELECTRODES
@options.SEED
@options.file("--placed", help="Write the contact as placed (.wkt): a --truth.")
@options.plot()
def command(
    sensor: str,
    contact: Path,
    output: Path,
    force: bool,
    at: tuple[float, float] | None,
    turn: float,
    drag: tuple[tuple[float, float], ...],
    steps: int,
    still: int | None,
    turn_per_step: float,
    rate: float,
    noise: Noise,
    without: tuple[str, ...],
    noisy: bool,
    seed: int,
    placed: Path | None,
    plot: Path | None,
    **model: Any,
) -> None:
    """Press CONTACT (.wkt or .geojson, mm) on SENSOR (a spec file or a shipped spec) and write the readings.

    Example: tacstrip simulate prototype-crs-crs object.wkt -o readings.csv --at 32 160 --positional 0.005
    """
    protect(output, sensor, contact, force=force)
    protect(placed, sensor, contact, output, force=force)
    protect(plot, sensor, contact, output)
    if placed is not None and drag:
        raise OptionError("--placed writes one place; leave --drag out")
    options.belong(drag, "needs --drag: there is one scan only", "steps", "turn_per_step")
    spec = load_layers(sensor, without)
    options.belong(drag or still, "needs --drag or --still: there is one scan only", "rate")
    if still and drag:
        raise OptionError("--still and --drag: a contact rests or moves; leave one out")
    if noisy:
        if spec.noise is None:
            raise OptionError(f"--noisy: {sensor} has no [noise] table; `tacstrip noise` writes one")
        options.belong(
            False, "does not go with --noisy, which takes the spec's noise", "quantisation", "positional"
        )
        noise = spec.noise
    shape = options.placed(contact, at, turn)
    start = tuple(shape.centroid)
    places = (
        shape.dragged([start, *drag], steps, math.radians(turn_per_step)) if drag else [shape] * (still or 1)
    )
    if isinstance(spec, LayeredSensor):
        options.belong(False, "is for a sensor of one layer", "model", "electrodes")
        model = {}
    touched, split, clipped = _touch(spec, places)
    process = NoiseProcess(noise, unit_of(spec), seed)
    scans = [simulate(spec, c, process=process, time_s=i / rate, **model) for i, c in enumerate(places)]
    write_readings(output, spec, scans)
    if placed is not None:
        write_text(placed, shapely.GeometryCollection(list(shape.shapes)).wkt + "\n")
    click.echo(f"{output}: {len(scans)} scan(s) of {spec.strips} strips, {touched} of them touched")
    if touched == 0:
        warn("no strip is touched: the contact falls between centre lines")
    warn(unlikely_contact(shape, spec.layers[0].sensor if isinstance(spec, LayeredSensor) else spec))
    if clipped:
        warn("a part of the contact lies off the sensor and was cut away")
    if split:
        warn(f"{split} strip(s) see several pieces of the contact as one, from end to end")
    if plot is not None:
        click.echo(f"{save_picture(plot, spec, scans, {}, places)}: picture")


def _touch(sensor: AnySensor, places: Sequence[Contact]) -> tuple[int, int, bool]:
    """Return how many strips contacts touch, on how many they have gaps unseen, and whether parts are off."""
    if isinstance(sensor, LayeredSensor):
        ideal = [simulate(sensor, place) for place in places]
        both = shapely.union_all([shapely.Polygon(layer.corners_mm) for layer in sensor.layers])
        off = any(not shapely.covers(both, shape) for place in places for shape in place.shapes)
        return int(np.any([scan.touched for scan in ideal], axis=0).sum()), 0, off
    found = footprint(sensor, places)
    touched, split = (int(strips.any(axis=0).sum()) for strips in (np.isfinite(found.l), found.pieces > 1))
    return touched, split, found.clipped
