"""Wide strips: how far simulate, fits, limits and calibration are off the resolved strip, and this off networks.

`python -m studies.wide_uses [SEED]` prints the table of docs/science/estimation.md [1e-6 Vref].
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from typing import Any

import numpy as np

import tacstrip as ts
from studies.wide_fits import corners
from tacstrip.arrays import FloatArray
from tacstrip.errors import ContactError
from tacstrip.geometry.outline import Outline
from tacstrip.network.strips.resolved import mesh_limit, wide_readings
from tacstrip.reconstruction.cramer_rao import vertex_covariance, vertex_jacobian
from tacstrip.reconstruction.strip_width import OnWideStrips

CONSTRUCTIONS = ("crs-crs", "crs-m", "cyl-crs-m")
LAMBDAS = (0.0, 0.05, 0.2, 0.5, 2.0)  # over the width
SHARES = (0.3, 0.6, 0.98)  # of the pitch
USES = ("simulate", "fit", "limits", "calibrate", "networks")
KINDS = ("corners", "steep", "narrow", "border")
_STRIPS, _LENGTH, _NOISE = 20, 100.0, 0.003
# Of a vertex, for differences [mm]: slivers bend within the longer; where the number of elements changes readings jump
# by some 1e-6, which counts in the shorter.
_STEPS = 0.004, 0.02
_FARTHEST = 1.0  # what counts of a vertex' deviation [mm]
_MESHES, _RESOLVED = (12, 24, 48), 0.1  # cells across, and lambdas over the width that these resolve
_ASKEW = np.tan(np.deg2rad(4.0))


def a_sensor(construction: str, decay: float, share: float) -> ts.Sensor:
    """Make a sensor with strips every 5 % of L, lambda over their width."""
    pitch = _LENGTH / _STRIPS
    tube: dict[str, Any] = {"radius_mm": _STRIPS * pitch} if construction == "cyl-crs-m" else {}
    return ts.Sensor(
        construction=construction, strips=_STRIPS, pitch_mm=pitch, length_mm=_LENGTH, strip_width_mm=share * pitch,
        contact_lambda_mm=decay * share * pitch, **tube,
    )  # fmt: skip


def drawn(sensor: ts.Sensor, kind: str, random: np.random.Generator) -> FloatArray:
    """Draw a polygon (V, 2) [mm]: any, slanted by 1 to 4, some strip widths long, or with an edge near the border."""
    b, wide = sensor.strip_width, sensor.width_mm
    if kind == "corners":
        return corners(sensor, random)
    x0, x1 = wide * random.uniform((0.3, 0.55), (0.45, 0.7))
    if kind == "steep":
        slope = random.choice([-1.0, 1.0]) * random.uniform(1.0, 2.0)
        low = 0.5 * (_LENGTH - slope * (x1 - x0)) - 12.0
        return np.array(
            [(x0, low), (x1, low + slope * (x1 - x0)), (x1, low + slope * (x1 - x0) + 20), (x0, low + 26)]
        )
    tilt = random.uniform(-0.4, 0.4, 2) * (x1 - x0)
    thick = random.uniform(1.0, 4.0) * b
    low = random.uniform(0.05, 0.8) * b if kind == "border" else random.uniform(0.4, 0.5) * _LENGTH
    height = np.array([0.0, tilt[0], thick + tilt[1], thick])
    height[2] = max(height[2], height[1] + 0.3 * b)
    return np.stack([[x0, x1, x1, x0], low + height - height.min()], axis=1)


def limits(sensor: ts.Sensor, outline: Outline) -> float:
    """Return how far readings are off that move with each vertex by its deviation, or 1 mm."""
    slope = vertex_jacobian(outline, sensor)
    deviation = np.sqrt(np.diag(vertex_covariance(outline, sensor, _NOISE)))
    worst = 0.0
    for at in range(outline.vertices.size):
        off = [_off_differences(sensor, outline, slope[:, at], at, step) for step in _STEPS]
        worst = max(worst, min(off) * min(float(deviation[at]), _FARTHEST))
    return worst


def differences(sensor: ts.Sensor, outline: Outline, at: int, step: float) -> FloatArray | None:
    """Return slopes of resolved readings by one coordinate [1/mm]; None where a strip is touched on one side only."""
    read = []
    for sign in (1.0, -1.0):
        moved = outline.vertices.ravel().copy()
        moved[at] += sign * step
        k = wide_readings(sensor, ts.Contact.polygon(moved.reshape(-1, 2)))
        read.append(np.concatenate([k[name][~np.isnan(k[name])] for name in sensor.signatures]))
    return (read[0] - read[1]) / (2.0 * step) if len(read[0]) == len(read[1]) else None


def _off_differences(sensor: ts.Sensor, outline: Outline, slope: FloatArray, at: int, step: float) -> float:
    """Return how far slopes (readings,) by one coordinate are off differences of resolved strips [Vref/mm].

    0 where a strip is touched on one side only.
    """
    found = differences(sensor, outline, at, step)
    if found is None or len(found) != len(slope):
        return 0.0
    return float(np.abs(slope - found).max())


def calibrate(sensor: ts.Sensor) -> float:
    """Return how far bars, level and 4 degrees askew, read off what calibration takes: their place on centre lines."""
    worst = 0.0
    for rise in (0.0, _ASKEW):
        y = np.array([40.0, 40.0 + rise * sensor.width_mm, 50.0 + rise * sensor.width_mm, 50.0])
        bar = np.stack([[0.0, sensor.width_mm, sensor.width_mm, 0.0], y], axis=1)
        made = ts.signatures(sensor, *ts.footprint(sensor, ts.Contact.polygon(bar)))
        read = wide_readings(sensor, ts.Contact.polygon(bar))
        worst = max(worst, *(float(np.nanmax(np.abs(made[name] - k))) for name, k in read.items()))
    return worst


def errors(construction: str, decay: float, seed: int) -> dict[str, float]:
    """Return the worst error of each use [Vref]; that of networks where these resolve lambda."""
    worst: dict[str, float] = {}
    for share, kind, case in _cases(2):
        sensor = a_sensor(construction, decay, share)
        random = np.random.default_rng([seed, SHARES.index(share), KINDS.index(kind), case])
        try:
            outline = Outline.of(drawn(sensor, kind, random))
        except ContactError:
            continue
        contact = ts.Contact.polygon(outline.vertices)
        read, made = wide_readings(sensor, contact), ts.simulate(sensor, contact)
        on = np.flatnonzero(np.isfinite(next(iter(read.values()))))
        known = np.stack([k[on] for k in read.values()])
        fit = ts.signatures(sensor, *OnWideStrips(sensor, outline, sensor.x_mm[on]).ends)
        found = {
            "simulate": np.abs(np.stack([made[name][on] for name in read]) - known).max(),
            "fit": np.abs(np.stack([fit[name] for name in read]) - known).max(),
        }
        if not case:
            found["limits"] = limits(sensor, outline)
            found["calibrate"] = calibrate(sensor)
            if decay >= _RESOLVED and share == SHARES[-1]:
                some = on[:: max(1, len(on) // 2)].tolist()
                every = [wide_readings(sensor, contact, across=n, strips=some) for n in _MESHES]
                limit = {name: mesh_limit(*(each[name] for each in every)) for name in read}
                found["networks"] = max(np.abs(limit[name][some] - read[name][some]).max() for name in read)
        for use, off in found.items():
            worst[use] = max(worst.get(use, 0.0), float(off))
    return worst


def _cases(each: int) -> Iterator[tuple[float, str, int]]:
    for share in SHARES:
        for kind in KINDS:
            for case in range(each):
                yield share, kind, case


def main() -> None:
    """Print a row per construction and lambda."""
    seed = int(sys.argv[1]) if sys.argv[1:] else 943
    sys.stdout.write(
        f"| construction | lambda over b | {' | '.join(USES)} |\n{'| --- ' * (2 + len(USES))}|\n"
    )
    for construction in CONSTRUCTIONS:
        for decay in LAMBDAS:
            worst = errors(construction, decay, seed)
            cells = (f"{1e6 * worst[use]:.0f}" if use in worst else "-" for use in USES)
            sys.stdout.write(f"| {construction} | {decay:g} | {' | '.join(cells)} |\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
