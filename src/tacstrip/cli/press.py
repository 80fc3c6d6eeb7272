"""`tacstrip press`."""

from __future__ import annotations

import json
import math
from pathlib import Path

import click
import numpy as np

from tacstrip.arrays import plain
from tacstrip.cli import load_sensor, options, protect, warn
from tacstrip.contact.noise import Noise
from tacstrip.contact.press.patch import Patch, press
from tacstrip.contact.press.solid import Solid
from tacstrip.errors import OptionError, number
from tacstrip.files import write_text
from tacstrip.io.readings import write_readings
from tacstrip.simulation import simulate

_POSE = (options.NUMBER,) * 6
_SIZES = {"plane": 0, "sphere": 1, "cylinder": 1, "edge": 1, "box": 3}  # numbers after the name
_MESHES = (".stl", ".obj", ".ply", ".off", ".glb")


@click.command()
@options.SENSOR
@click.argument("solid", metavar="OBJECT")
@options.output("Readings file (CSV).")
@click.option("--pose", type=_POSE, required=True, metavar="X Y Z DX DY DZ",
              help="Where the object's lowest place is [mm], and the direction in which it is pressed.")  # fmt: skip
@click.option("--turn", type=options.NUMBER, default=0.0, metavar="DEG", help="Turn it about that direction.")
@click.option("--depth", type=options.NUMBER, metavar="MM", help="How far, from its first touch.")
@click.option("--force", type=options.NUMBER, metavar="N", help="How hard, by the skin's stiffness.")
@click.option("--unit", default="mm", show_default=True, help="Of a mesh: mm, cm, m or inch.")
@options.noise
@options.SEED
@click.option("--patch", type=options.FILE, help="Write what is touched: l, u, area, force, outline (JSON).")
@options.plot("Picture of skin, object and patch (.png, .svg, .pdf).")
def command(
    sensor: str,
    solid: str,
    output: Path,
    pose: tuple[float, ...],
    turn: float,
    depth: float | None,
    force: float | None,
    unit: str,
    noise: Noise,
    seed: int,
    patch: Path | None,
    plot: Path | None,
) -> None:
    """Press OBJECT into the skin of SENSOR (a spec file or a shipped spec) and write the readings.

    OBJECT is plane, sphere:R, cylinder:R, edge:DEG, box:AxBxC (mm), or a mesh (.stl, .obj, .ply).

    Example: tacstrip press fingertip cylinder:4 --pose 8 0 8 -1 0 -1 --depth 1.5 -o readings.csv --plot press.png
    """
    mesh = Path(solid) if Path(solid).suffix.lower() in _MESHES else None
    protect(output, sensor, mesh)
    protect(patch, sensor, mesh, output)
    protect(plot, sensor, mesh, output, patch)
    options.belong(mesh, "is for a mesh", "unit")
    if (depth is None) == (force is None):
        raise OptionError("give one of --depth, how far [mm], and --force, how hard [N]")
    spec = load_sensor(sensor)
    thing = (Solid.from_mesh(mesh, unit) if mesh else _solid(solid)).at(
        pose[:3], pose[3:], math.radians(turn)
    )
    found = press(spec, thing, depth_mm=depth, force_n=force)
    scan = simulate(spec, found, noise, rng=seed)
    write_readings(output, spec, [scan])
    if patch is not None:
        write_text(patch, json.dumps(_as_json(found), indent=1) + "\n")
    touched = int(found.touched.sum())
    click.echo(
        f"{output}: {touched} of {spec.strips} strips touched, {found.area_mm2:.4g} mm2, {found.force_n:.4g} N, "
        f"{found.depth_mm:.4g} mm deep"
    )
    if not touched:
        warn("no strip is touched: the object lies between centre lines, or where the skin has no strips")
    if plot is not None:
        from tacstrip.plot.skins import press_figure
        from tacstrip.plot.theme import save

        click.echo(f"{save(press_figure(spec, found), plot)}: picture")


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
        wanted = {0: "no number", 1: "one number, as in sphere:5", 3: "three numbers, as in box:20x10x5"}[
            _SIZES[name]
        ]
        raise OptionError(f"OBJECT {text}: a {name} has {wanted}")
    if name == "box":
        return Solid.box(sizes)
    if name == "edge":
        return Solid.edge(math.radians(sizes[0]))
    if name == "plane":
        return Solid.plane()
    return Solid.sphere(sizes[0]) if name == "sphere" else Solid.cylinder(sizes[0])


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
