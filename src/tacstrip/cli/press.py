"""`tacstrip press`."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import click
import numpy as np

from tacstrip.arrays import plain
from tacstrip.cli import load_sensor, options, protect, warn
from tacstrip.contact.noise import Noise, NoiseProcess
from tacstrip.contact.press.patch import Patch, patch_at, press
from tacstrip.contact.press.solid import Solid
from tacstrip.errors import OptionError, TacstripError, number
from tacstrip.files import write_text
from tacstrip.io.input_checks import unlikely_places
from tacstrip.io.poses import read_poses
from tacstrip.io.readings import write_readings
from tacstrip.sensor.spec import Sensor
from tacstrip.simulation import simulate

_POSE = (options.NUMBER,) * 6
_SIZES = {"plane": 0, "sphere": 1, "cylinder": 1, "edge": 1, "cone": 1, "box": 3}  # numbers after the name
_NUMBERS = {0: "no number", 1: "one number, as in sphere:5", 3: "three numbers, as in box:20x10x5"}
_MESHES = (".stl", ".obj", ".ply", ".off", ".glb")


@click.command()
@options.SENSOR
@click.argument("solid", metavar="OBJECT")
@options.output("Readings file (CSV).")
@options.OVERWRITE
@options.option("--pose", type=_POSE, metavar="X Y Z DX DY DZ",
                help="Where the object's lowest place is [mm], and the direction in which it is pressed.")  # fmt: skip
@options.file("--path", help="Poses from scan to scan (.csv: x_mm, y_mm, z_mm, dx, dy, dz, and time_s, turn_deg, "
              "depth_mm or force_n).")  # fmt: skip
@options.number("--turn", default=0.0, metavar="DEG", help="Turn it about that direction.")
@options.number("--depth", metavar="MM", help="How far, from its first touch.")
@options.number("--force", metavar="N", help="How hard, by the skin's stiffness.")
@options.number("--rate", default=100.0, callback=options.finite_above_0,
                help="Scans a second of a path without time_s [Hz].")  # fmt: skip
@options.option("--unit", default="mm", help="Of a mesh: mm, cm, m or inch.")
@options.noise
@options.SEED
@options.file("--patch", help="Write what is touched: l, u, area, force, outline (JSON).")
@options.plot("Picture of skin, object and patch (.png, .svg, .pdf).")
def command(
    sensor: str,
    solid: str,
    output: Path,
    overwrite: bool,
    pose: tuple[float, ...] | None,
    path: Path | None,
    turn: float,
    depth: float | None,
    force: float | None,
    rate: float,
    unit: str,
    noise: Noise,
    seed: int,
    patch: Path | None,
    plot: Path | None,
) -> None:
    """Press OBJECT into the skin of SENSOR (a spec file or a shipped spec) and write the readings.

    OBJECT is plane, sphere:R, cylinder:R, edge:DEG, cone:DEG, box:AxBxC (mm), or a mesh (.stl, .obj, .ply). Along a
    --path it is pressed from each pose by depth or force, or where the file has neither and no option says so, it is
    where it is.

    Example: tacstrip press fingertip cylinder:4 --pose 8 0 8 -1 0 -1 --depth 1.5 -o readings.csv --plot press.png
    """
    mesh = Path(solid) if Path(solid).suffix.lower() in _MESHES else None
    protect(output, sensor, mesh, path, force=overwrite, flag="--overwrite")
    protect(patch, sensor, mesh, path, output, force=overwrite, flag="--overwrite")
    protect(plot, sensor, mesh, path, output, patch)
    options.belong(mesh, "is for a mesh", "unit")
    options.belong(path, "needs --path: there is one scan only", "rate")
    options.belong(path is None, "goes with --pose; in a path it is the column turn_deg", "turn")
    if (pose is None) == (path is None):
        raise OptionError("give one of --pose, where the object is, and --path, a file of poses")
    if (depth is None) == (force is None) and (path is None or depth is not None):
        raise OptionError("give one of --depth, how far [mm], and --force, how hard [N]")
    spec, thing = load_sensor(sensor), Solid.from_mesh(mesh, unit) if mesh else _solid(solid)
    if path is not None:
        times, found = _along(spec, thing, path, depth, force, rate)
    else:
        assert pose is not None
        placed = thing.at(pose[:3], pose[3:], math.radians(turn))
        warn(unlikely_places(np.array([pose[:3]]), spec))
        times, found = [0.0], [press(spec, placed, depth_mm=depth, force_n=force)]
    process = NoiseProcess(noise, spec, seed)
    scans = [simulate(spec, p, process=process, time_s=t) for t, p in zip(times, found, strict=True)]
    write_readings(output, spec, scans)
    if patch is not None:
        shown = [_as_json(p) for p in found]
        write_text(patch, json.dumps(shown if path else shown[0], indent=1) + "\n")
    touched = int(np.any([p.touched for p in found], axis=0).sum())
    most = max(found, key=lambda p: p.force_n)
    click.echo(
        f"{output}: {f'{len(scans)} scans, ' if path else ''}{touched} of {spec.strips} strips touched, "
        f"{'up to ' if path else ''}{most.area_mm2:.4g} mm2, {most.force_n:.4g} N, "
        f"{most.max_indentation_mm if path else most.depth_mm:.4g} mm deep"
        f"{'; readings without noise: give --positional 0.005 or the like' if noise == Noise() else ''}"
    )
    if not touched:
        warn("no strip is touched: the object lies between centre lines, or where the skin has no strips")
    if plot is not None:
        from tacstrip.plot.skins import film_figure, press_figure
        from tacstrip.plot.theme import save

        figure = film_figure(spec, times, found) if path else press_figure(spec, found[0])
        click.echo(f"{save(figure, plot)}: picture")


def _along(
    sensor: Sensor, solid: Solid, path: Path, depth: float | None, force: float | None, rate: float
) -> tuple[list[float], list[Patch]]:
    """Return times [s] and patches of a path of poses; errors name the file and its line."""
    times, found = [], []
    poses = read_poses(path, solid)
    warn(unlikely_places(np.array([one.solid.position_mm for one in poses]), sensor), file=path)
    for i, one in enumerate(poses):
        own = one.depth_mm, one.force_n
        if own != (None, None) and (depth, force) != (None, None):
            raise OptionError(f"{path} says how far or how hard to press: leave --depth and --force out")
        by_depth, by_force = own if own != (None, None) else (depth, force)
        try:
            if by_depth is None and by_force is None:
                found.append(patch_at(sensor, one.solid))
            else:
                found.append(press(sensor, one.solid, depth_mm=by_depth, force_n=by_force))
        except TacstripError as error:
            raise type(error)(f"{path}: line {one.line}: {error}") from None
        times.append(i / rate if one.time_s is None else one.time_s)
    return times, found


def _solid(text: str) -> Solid:
    """Return the object of a name and its sizes, such as box:20x10x5."""
    name, _, rest = text.partition(":")
    if name not in _SIZES:
        raise OptionError(
            f"OBJECT {text}: is none of {', '.join(_SIZES)}, nor a mesh ({', '.join(_MESHES)}); write sphere:5 or "
            "box:20x10x5"
        )
    try:
        sizes = [number(part) for part in rest.split("x")] if rest else []
    except ValueError:
        sizes = [math.nan]
    if len(sizes) != _SIZES[name] or not np.isfinite(sizes).all():
        raise OptionError(f"OBJECT {text}: a {name} has {_NUMBERS[_SIZES[name]]}")
    if name in ("edge", "cone"):
        if not 0.0 < sizes[0] < 180.0:
            raise OptionError(f"OBJECT {text}: its angle is between 0 and 180 degrees, as in {name}:90")
        sizes = [math.radians(sizes[0])]
    make: Callable[..., Solid] = getattr(Solid, name)
    return make(sizes) if name == "box" else make(*sizes)


def _as_json(patch: Patch) -> dict[str, object]:
    """Return a patch for JSON, null for what is not there."""
    solid = patch.solid
    return {
        "object": {"kind": solid.kind, "size": list(solid.size), "position_mm": plain(solid.position_mm),
                   "toward": plain(solid.toward), "axes": plain(solid.axes)},
        "depth_mm": patch.depth_mm, "max_indentation_mm": patch.max_indentation_mm,
        "area_mm2": patch.area_mm2, "force_n": patch.force_n, "force_xyz_n": plain(patch.force_xyz),
        "moment_xyz_nmm": plain(patch.moment_xyz), "centroid_xyz_mm": plain(patch.centroid_xyz),
        "normal": plain(patch.normal), "l_mm": plain(patch.l), "u_mm": plain(patch.u),
        "outline_xyz_mm": plain(patch.outline_xyz),
    }  # fmt: skip
