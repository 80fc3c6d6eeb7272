"""How well `ts.fit_solid` finds solids pressed into a fingertip of 16 meridians, at .5 % uniform noise.

Run: python benchmarks/pressed_solids.py [--presses 200] [--kinds plane cylinder edge sphere]
"""

from __future__ import annotations

import argparse
import math
import time

import numpy as np

import tacstrip as ts

NOISE = ts.Noise(positional=0.005)
KINDS = ("plane", "cylinder", "edge", "sphere")


def main() -> None:
    """Print a line for every kind of solid."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--presses", type=int, default=200)
    options.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS)
    given = options.parse_args()
    columns = (
        "solid, ok, area %, direction deg, force %, radius %, axis deg, in 95 % (area force radius), CPU ms"
    )
    print("|", columns.replace(",", " |"), "|")
    print("| --- " * 9 + "|")
    for kind in given.kinds:
        print(_row(kind, given.presses), flush=True)


def _row(kind: str, presses: int) -> str:
    sensor, random = ts.Sensor.load("fingertip"), np.random.default_rng([7, KINDS.index(kind)])
    errors, held, ok, spent = [], [], 0, 0.0
    for number in range(presses):
        solid, depth = _draw(kind, random)
        patch = ts.press(sensor, solid, depth_mm=depth)
        scan = ts.simulate(sensor, patch, NOISE, rng=number)
        family = {"plane": ts.Solid.plane(), "cylinder": ts.Solid.cylinder(5.0), "edge": ts.Solid.edge(),
                  "sphere": ts.Solid.sphere(7.0)}[kind]  # fmt: skip
        began = time.process_time()
        found = ts.fit_solid(scan, sensor, family, NOISE)
        spent += time.process_time() - began
        if found.solid is None or found.direction is None:
            continue
        ok += found.status == "ok"
        tilt = math.degrees(math.acos(min(1.0, float(-found.direction @ solid.toward))))
        axis = math.degrees(
            math.asin(min(1.0, float(np.linalg.norm(np.cross(found.solid.axes[0], solid.axes[0])))))
        )
        radius = solid.size[0] if kind == "cylinder" else math.nan
        row = (found.area_mm2 / patch.area_mm2, found.force_n / patch.force_n, found.radius_mm / radius)
        errors.append([*(100.0 * abs(v - 1.0) for v in row), tilt, axis])
        held.append([
            abs(found.area_mm2 - patch.area_mm2) < 1.96 * found.area_sigma_mm2,
            abs(found.force_n - patch.force_n) < 1.96 * found.force_sigma_n,
            abs(found.radius_mm - radius) < 1.96 * found.radius_sigma_mm,
        ])  # fmt: skip
    untold = np.nan_to_num(errors, nan=np.inf)
    median, ninth = (np.quantile(untold, q, axis=0, method="higher") for q in (0.5, 0.9))
    shown = [f"{a:.2g} ({b:.2g})" if np.isfinite(a) else "-" for a, b in zip(median, ninth, strict=True)]
    if kind not in ("cylinder", "edge"):
        shown[4] = "-"
    shares = ", ".join(f"{100.0 * s:.0f}" for s in np.mean(held, axis=0))
    return (
        f"| {kind} | {ok} of {presses} | {shown[0]} | {shown[3]} | {shown[1]} | {shown[2]} | {shown[4]} | {shares} | "
        f"{1e3 * spent / presses:.0f} |"
    )


def _draw(kind: str, random: np.random.Generator) -> tuple[ts.Solid, float]:
    """Return a solid at a pose beside the fingertip, and how deep it is pressed [mm]."""
    polar, around = (
        random.uniform(0.35, 1.0 if kind in ("plane", "sphere") else 0.9),
        random.uniform(0.0, 2.0 * math.pi),
    )
    out = np.array([math.sin(polar) * math.cos(around), math.sin(polar) * math.sin(around), math.cos(polar)])
    solid, depth = {
        "plane": (ts.Solid.plane(), random.uniform(0.6, 2.0)),
        "cylinder": (ts.Solid.cylinder(random.uniform(3.0, 8.0)), random.uniform(1.0, 2.0)),
        "edge": (ts.Solid.edge(), random.uniform(1.0, 2.5)),
        "sphere": (ts.Solid.sphere(random.uniform(4.0, 15.0)), random.uniform(1.0, 2.0)),
    }[kind]
    return solid.at(12.0 * out, -out, random.uniform(-1.2, 1.2)), depth


if __name__ == "__main__":
    main()
