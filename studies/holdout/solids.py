"""Solids pressed into a fingertip, found again by `ts.fit_solid`: skin, solids and strips apart from the package.

A case depends on the seed and its number alone. Strips are as wide as `WIDTH_MM`: nine lines across, of 2,000 cells,
and where they lie in the solid or not is asked cell by cell; an end is the lines' mean. Every second solid is a mesh
of flat faces round the one that is told. Patches are sums over the skin, pressure from how far along the normal a solid
goes, by halving. The noise is uniform, normal, triangular or Laplace's in turn, of one sigma; uniform is told.

Run: python -m studies.holdout.solids --seed 0 --presses 40 [--kinds plane cylinder edge sphere] [--wrong]
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from dataclasses import dataclass

import numpy as np

import tacstrip as ts
from studies.holdout.readings import Unit
from studies.holdout.shapes import Array

KINDS = ("plane", "cylinder", "edge", "sphere")
STRANGE = ("ellipsoid", "box", "cone", "wedge")
# What is pressed, and the family that it is fitted as, which is not right.
PAIRS = [
    (kind, family) for kind in (*STRANGE, *KINDS) for family in KINDS
    if kind != family and (kind, family) not in [("sphere", "plane"), ("plane", "sphere")]  # every patch is a cap
]  # fmt: skip
RADIUS, TIP, RIM, STRIPS, THICK, STIFF = 10.0, math.radians(12.0), math.radians(90.0), 16, 3.0, 0.1
LENGTH = RADIUS * (RIM - TIP)
UNIT = Unit(("kh", "kl"), STRIPS, 2.0 * math.pi * RADIUS / STRIPS, LENGTH)
WIDTH_MM, LINES, CELLS = 0.3, 9, 2000
GRID = (350, 700)  # of the skin, from pole to rim and round
HALF_WIDTH = 0.005
NOISES = ("uniform", "normal", "triangular", "laplace")
FACETS = 96  # of a mesh round a cylinder, rings of a ball
WRONG = {"area %": 10.0, "direction deg": 5.0, "force %": 20.0, "radius %": 25.0, "axis deg": 10.0}
FINAL = 1000  # seeds from here on are run once, by --final


@dataclass(frozen=True, eq=False)
class Pressed:
    """A solid: its lowest place (3,), axes x, y and out of the skin (3, 3), radius, and faces of a mesh or none."""

    kind: str
    at: Array
    axes: Array
    radius: float = math.nan
    faceted: bool = False
    sizes: tuple[float, ...] = ()

    def holds(self, points: Array) -> Array:
        """Return whether points (..., 3) lie in it, as numbers above 0."""
        x, y, z = np.moveaxis((points - self.at) @ self.axes.T, -1, 0)
        if self.kind == "plane":
            return np.asarray(z)
        if self.kind in (
            "edge",
            "wedge",
            "cone",
        ):  # 90 degrees, or of a wedge and a cone the cotangent of half
            aside = np.hypot(x, y) if self.kind == "cone" else np.abs(y)
            return np.asarray(z - aside * (self.sizes[0] if self.sizes else 1.0))
        if self.kind == "box":
            a, b, c = self.sizes
            return np.asarray(
                np.minimum(np.minimum(0.5 * a - np.abs(x), 0.5 * b - np.abs(y)), np.minimum(z, c - z))
            )
        if self.kind == "ellipsoid":
            a, b, c = self.sizes
            return np.asarray(1.0 - np.square(x / a) - np.square(y / b) - np.square(z / c - 1.0))
        if self.kind == "sphere":
            y = np.hypot(x, y)
        off = np.hypot(y, z - self.radius)
        if self.faceted:  # a prism of FACETS sides or a ball of so many rings, of the radius in the mean
            part = 2.0 * math.pi / FACETS
            turned = np.remainder(np.arctan2(y, self.radius - z), part) - 0.5 * part
            off = off * np.cos(turned) * (0.5 * part / math.sin(0.5 * part))
        return np.asarray(self.radius - off)


def skin(polar: Array, around: Array) -> Array:
    """Return unit vectors (..., 3) from the fingertip's centre."""
    sin = np.sin(polar)
    return np.stack(np.broadcast_arrays(sin * np.cos(around), sin * np.sin(around), np.cos(polar)), axis=-1)


def ends(solid: Pressed) -> tuple[Array, Array]:
    """Return l and u (strips,) [mm], means over a strip's width; NaN where less than half of it is touched."""
    y = (np.arange(CELLS) + 0.5) * LENGTH / CELLS
    polar = TIP + y / RADIUS
    low, high = np.full(STRIPS, np.nan), np.full(STRIPS, np.nan)
    aside = WIDTH_MM * ((np.arange(LINES) + 0.5) / LINES - 0.5)
    for strip in range(STRIPS):
        around = (strip + 0.5) * 2.0 * math.pi / STRIPS + aside[:, None] / (RADIUS * np.sin(polar))
        on = solid.holds(RADIUS * skin(polar, around)) > 0.0
        lines = on.any(axis=1)
        if lines.sum() * 2 > LINES:
            first, last = on.argmax(axis=1)[lines], CELLS - on[:, ::-1].argmax(axis=1)[lines]
            low[strip], high[strip] = (v.mean() * LENGTH / CELLS for v in (first, last))
    return low, high


def share(y: Array) -> Array:
    """Return the share of a strip's resistance that lies below y [mm]: its width grows as the parallel's radius."""
    begin, end = (math.log(math.tan(0.5 * a)) for a in (TIP, RIM))
    return np.asarray((np.log(np.tan(0.5 * (TIP + y / RADIUS))) - begin) / (end - begin))


def load(solid: Pressed) -> tuple[float, float]:
    """Return area [mm^2] and force [N] along the way that a solid is pressed, of the skin down to the rim."""
    cos = 1.0 - (np.arange(GRID[0]) + 0.5) / GRID[0]  # even in cos: cells of one size
    around = (np.arange(GRID[1]) + 0.5) * 2.0 * math.pi / GRID[1]
    out = skin(np.arccos(cos)[:, None], around)
    out = out[solid.holds(RADIUS * out) > 0.0]
    cell = 2.0 * math.pi * RADIUS**2 / math.prod(GRID)
    low, high = np.zeros(len(out)), np.full(len(out), 2.0 * THICK)
    for _ in range(18):
        middle = 0.5 * (low + high)
        inside = solid.holds((RADIUS - middle)[:, None] * out) > 0.0
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return cell * len(out), float(STIFF * cell * (low * (out @ solid.axes[2])).sum())


def draw(kind: str, number: int, random: np.random.Generator) -> Pressed:
    """Return a solid pressed along the skin's normal."""
    polar = random.uniform(0.35, 1.0 if kind in ("plane", "sphere") else 0.9)
    around, turn = random.uniform(0.0, 2.0 * math.pi), random.uniform(0.0, math.pi)
    out = skin(np.array(polar), np.array(around))
    south = skin(np.array(polar + 0.5 * math.pi), np.array(around))
    east = np.array([-math.sin(around), math.cos(around), 0.0])
    x = math.cos(turn) * south + math.sin(turn) * east
    sizes: tuple[float, ...] = ()
    if kind == "ellipsoid":
        sizes = (random.uniform(4.0, 15.0), random.uniform(3.0, 8.0), random.uniform(3.0, 8.0))
    elif kind == "box":
        sizes = (random.uniform(6.0, 16.0), random.uniform(4.0, 12.0), 10.0)
    elif kind in ("cone", "wedge"):  # 60 to 75, or 110 to 140 degrees
        sizes = (
            1.0
            / math.tan(0.5 * math.radians(random.choice([random.uniform(60, 75), random.uniform(110, 140)]))),
        )
    depth, radius = {
        "plane": (random.uniform(0.6, 2.0), math.nan),
        "cylinder": (random.uniform(1.0, 2.0), random.uniform(3.0, 8.0)),
        "edge": (random.uniform(1.0, 2.5), math.nan),
        "sphere": (random.uniform(1.0, 2.0), random.uniform(4.0, 15.0)),
        "ellipsoid": (random.uniform(1.0, 2.0), math.nan),
        "box": (random.uniform(0.6, 2.0), math.nan),
        "cone": (random.uniform(1.0, 2.5), math.nan),
        "wedge": (random.uniform(1.0, 2.5), math.nan),
    }[kind]
    return Pressed(
        kind, (RADIUS - depth) * out, np.stack([x, np.cross(out, x), out]), radius, bool(number % 2), sizes
    )


def scan_of(solid: Pressed, noise: str, random: np.random.Generator) -> ts.Scan:
    """Return what the fingertip reads."""
    low, high = (share(v) * LENGTH for v in ends(solid))
    read = UNIT.read(low, high)
    sigma = HALF_WIDTH / math.sqrt(3.0)
    error = {
        "uniform": lambda: random.uniform(-HALF_WIDTH, HALF_WIDTH, read.shape),
        "normal": lambda: sigma * random.standard_normal(read.shape),
        "triangular": lambda: random.triangular(-math.sqrt(6.0), 0.0, math.sqrt(6.0), read.shape) * sigma,
        "laplace": lambda: random.laplace(0.0, sigma / math.sqrt(2.0), read.shape),
    }[noise]()
    return ts.Scan(**dict(zip(UNIT.names, np.clip(read + error, 0.0, 1.0), strict=True)))


FAMILIES = {
    "plane": ts.Solid.plane(), "cylinder": ts.Solid.cylinder(5.0), "edge": ts.Solid.edge(),
    "sphere": ts.Solid.sphere(7.0),
}  # fmt: skip


def judge(solid: Pressed, found: ts.SolidFit) -> tuple[dict[str, float], dict[str, float]]:
    """Return errors (as the names say) and how far they are from the edge of what holds with 95 %, of what is told."""
    assert found.solid is not None
    assert found.direction is not None
    area, force = load(solid)
    tilt = math.acos(min(1.0, float(found.direction @ solid.axes[2])))
    axis = math.asin(min(1.0, float(np.linalg.norm(np.cross(found.solid.axes[0], solid.axes[0])))))
    errors = {
        "area %": 100.0 * abs(found.area_mm2 / area - 1.0), "direction deg": math.degrees(tilt),
        "force %": 100.0 * abs(found.force_n / force - 1.0),
        "radius %": 100.0 * abs(found.radius_mm / solid.radius - 1.0),
        "axis deg": math.degrees(axis) if solid.kind in ("cylinder", "edge") else math.nan,
    }  # fmt: skip
    about = abs(float(solid.axes[0] @ found.solid.axes[1]))  # the axis about the direction

    def beyond(name: str, off: float) -> float:
        """Return how far beside the middle of its 95 % an error is, 1 at their edge."""
        low, high = found.intervals.get(name, (math.nan, math.nan))
        return max(off - high, low - off) / (0.5 * (high - low)) + 1.0

    held = {
        "area %": beyond("area_mm2", area), "direction deg": beyond("direction_rad", tilt),
        "force %": beyond("force_n", force), "radius %": beyond("radius_mm", solid.radius),
        "axis deg": beyond("axis_rad", math.asin(min(about, 1.0))),
    }  # fmt: skip
    return errors, {name: value if math.isfinite(errors[name]) else math.nan for name, value in held.items()}


def run(kind: str, seed: int, presses: int, verbose: bool = False) -> str:
    """Return a table's line for a kind of solid."""
    errors, sigmas, ok, wrong, doubted, spent = [], [], 0, 0, 0, 0.0
    for number in range(presses):
        random = np.random.default_rng([seed, KINDS.index(kind), number])
        solid = draw(kind, number, random)
        scan = scan_of(solid, NOISES[(number // 2) % len(NOISES)], random)
        began = time.process_time()
        found = ts.fit_solid(
            scan, ts.Sensor.load("fingertip"), FAMILIES[kind], ts.Noise(positional=HALF_WIDTH)
        )
        spent += time.process_time() - began
        if found.solid is None:
            doubted += 1
            continue
        off, by = judge(solid, found)
        bad = any(off[name] > limit for name, limit in WRONG.items())
        ok += found.status == "ok"
        wrong += bad and found.status == "ok"
        doubted += not bad and found.status != "ok"
        errors.append(list(off.values()))
        sigmas.append(list(by.values()))
        if verbose:
            touched = int(scan.touched.sum())
            shown = (f"{name} {v:.2g} ({by[name]:.1f})" for name, v in off.items() if math.isfinite(v))
            _write(f"{number:3d} {found.status:8s} {touched:2d} strips {', '.join(shown)} {found.advice}")
    told = np.asarray(np.isfinite(errors).any(axis=0)).tolist()
    quantiles = (
        np.quantile(np.nan_to_num(errors, nan=np.inf), q, axis=0, method="higher") for q in (0.5, 0.9)
    )
    cells = [f"{a:.2g} ({b:.2g})" if t else "" for a, b, t in zip(*quantiles, told, strict=True)]
    held = [
        f"{100.0 * np.mean(v[np.isfinite(v)] <= 1.0):.0f}" if t else "-"
        for v, t in zip(np.array(sigmas).T, told, strict=True)
    ]
    return "| " + " | ".join(
        [kind, f"{ok} of {presses}", str(wrong), str(doubted), *cells, ", ".join(held), f"{spent / presses:.2f}"]
    ) + " |"  # fmt: skip


def wrong(kind: str, family: str, seed: int, presses: int, verbose: bool = False) -> str:
    """Return a table's line of a kind of solid that is fitted as another family."""
    count = dict.fromkeys(("ok and right", "ok and wrong", "doubtful and right", "doubtful and wrong"), 0)
    for number in range(presses):
        random = np.random.default_rng([seed, (KINDS + STRANGE).index(kind), number])
        solid = draw(kind, number, random)
        scan = scan_of(solid, NOISES[(number // 2) % len(NOISES)], random)
        found = ts.fit_solid(
            scan, ts.Sensor.load("fingertip"), FAMILIES[family], ts.Noise(positional=HALF_WIDTH)
        )
        assert found.direction is not None
        area, force = load(solid)
        off = (
            100.0 * abs(found.area_mm2 / area - 1.0),
            math.degrees(math.acos(min(1.0, float(found.direction @ solid.axes[2])))),
            100.0 * abs(found.force_n / force - 1.0),  # NaN is not told, and so not wrong
        )
        bad = any(v > limit for v, limit in zip(off, WRONG.values(), strict=False))
        count[f"{'ok' if found.status == 'ok' else 'doubtful'} and {'wrong' if bad else 'right'}"] += 1
        if verbose:
            shown = ", ".join(f"{name} {v:.2g}" for name, v in zip(WRONG, off, strict=False))
            _write(
                f"{number:3d} {found.status:8s} {int(scan.touched.sum()):2d} strips {shown} {found.advice}"
            )
    return "| " + " | ".join([kind, family, *map(str, count.values())]) + " |"


def _write(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def main() -> None:
    """Print a table, a line a kind of solid."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--presses", type=int, default=40)
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--final", action="store_true")
    options.add_argument("--verbose", action="store_true")
    options.add_argument(
        "--wrong", action="store_true", help="solids fitted as families that they are not of"
    )
    options.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS)
    given = options.parse_args()
    if given.seed >= FINAL and not given.final:
        raise SystemExit(f"seeds of {FINAL} and above decide: run each once, with --final")
    if given.wrong:
        _write(
            "| solid | fitted as | ok and right | ok and wrong | doubtful and right | doubtful and wrong |\n"
            + "| --- " * 6
            + "|"
        )
        for kind, family in PAIRS:
            if family in given.kinds:
                _write(wrong(kind, family, given.seed, given.presses, given.verbose))
        return
    names = ("solid", "ok", "silent wrong", "false doubt", *WRONG, "within 95 % (in that order)", "CPU s")
    _write("| " + " | ".join(names) + " |\n" + "| --- " * len(names) + "|")
    for kind in given.kinds:
        _write(run(kind, given.seed, given.presses, given.verbose))


if __name__ == "__main__":
    main()
