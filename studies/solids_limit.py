"""How well a cylinder's radius can be known from one scan of the hold-out's fingertip: the Cramer-Rao bound.

Slopes are differences of the hold-out's own readings at the true cylinder (`studies.holdout.solids`), its noise
counts by its variance, silent strips and touch tell nothing. Beside it, what `ts.fit_solid` is off by.

Run: python -m studies.solids_limit --seeds 10 11 12 --presses 50
"""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import replace

import numpy as np

import tacstrip as ts
from studies.holdout import solids
from studies.holdout.shapes import Array

STEPS = (0.04, 0.02, 0.01)  # mm, rad, or of the radius's logarithm: shorter where a strip comes or goes
WIDE = np.array(
    [10.0, 10.0, 0.5 * math.pi, 3.0, 1.5]
)  # known beforehand: place, turn, depth, logarithm of the radius


def moved(solid: solids.Pressed, by: Array) -> solids.Pressed:
    """Return a solid moved south and east along the skin [mm], turned [rad], sunk [mm], with a radius grown by e^by."""
    x, _, out = solid.axes
    polar, around = math.acos(out[2]), math.atan2(out[1], out[0])
    south, east = _along(polar, around)
    turn, depth = math.atan2(x @ east, x @ south) + by[2], solids.RADIUS - float(solid.at @ out) + by[3]
    polar, around = polar + by[0] / solids.RADIUS, around + by[1] / (solids.RADIUS * math.sin(polar))
    out, (south, east) = solids.skin(np.array(polar), np.array(around)), _along(polar, around)
    x = math.cos(turn) * south + math.sin(turn) * east
    axes = np.stack([x, np.cross(out, x), out])
    return replace(solid, at=(solids.RADIUS - depth) * out, axes=axes, radius=solid.radius * math.exp(by[4]))


def bound(solid: solids.Pressed) -> float:
    """Return the least standard deviation of a cylinder's radius, relative."""
    here, columns = _read(solid), []
    for axis in np.eye(5):
        slope = np.full(here.shape, math.nan)
        for step in STEPS:
            high, low = (_read(moved(solid, sign * step * axis)) for sign in (1.0, -1.0))
            for found in ((high - low) / (2.0 * step), (high - here) / step, (here - low) / step):
                slope = np.where(np.isnan(slope), found, slope)
        columns.append(slope[~np.isnan(here)])
    slopes = np.nan_to_num(np.stack(columns, axis=1)) / (solids.HALF_WIDTH / math.sqrt(3.0))
    return math.sqrt(np.linalg.inv(slopes.T @ slopes + np.diag(WIDE**-2.0))[4, 4])


def _along(polar: float, around: float) -> tuple[Array, Array]:
    south = solids.skin(np.array(polar + 0.5 * math.pi), np.array(around))
    return south, np.array([-math.sin(around), math.cos(around), 0.0])


def _read(solid: solids.Pressed) -> Array:
    low, high = (solids.share(v) * solids.LENGTH for v in solids.ends(solid))
    return np.asarray(solids.UNIT.read(low, high))


def main() -> None:
    """Print what the bound allows and what fits are off by."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--seeds", type=int, nargs="+", default=[10, 11, 12])
    options.add_argument("--presses", type=int, default=50)
    given = options.parse_args()
    if max(given.seeds) >= solids.FINAL:
        raise SystemExit(
            f"seeds of {solids.FINAL} and above decide: they are for studies.holdout.solids --final"
        )
    least: list[float] = []
    errors: list[float] = []
    for seed in given.seeds:
        for number in range(given.presses):
            random = np.random.default_rng([seed, solids.KINDS.index("cylinder"), number])
            solid = solids.draw("cylinder", number, random)
            scan = solids.scan_of(solid, solids.NOISES[number // 2 % len(solids.NOISES)], random)
            noise = ts.Noise(positional=solids.HALF_WIDTH)
            found = ts.fit_solid(scan, ts.Sensor.load("fingertip"), solids.FAMILIES["cylinder"], noise)
            least.append(bound(solid))
            errors.append(abs(found.radius_mm / solid.radius - 1.0))
    even = np.abs(np.random.default_rng(0).standard_normal((400, len(least)))) * least
    off = np.nan_to_num(errors, nan=math.inf)
    rows = {
        "bound's own error, %": 100.0 * even,
        "error of fits, %": 100.0 * off,
        "error / bound": off / least,
    }
    for name, values in rows.items():
        median, most = np.quantile(values, (0.5, 0.9))
        sys.stdout.write(f"{name}: median {median:.2g}, p90 {most:.2g}\n")


if __name__ == "__main__":
    main()
