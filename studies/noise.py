"""How well 95 % regions hold on noise learned from a minute of a still press, and what tells a common offset.

Errors come from `tests/noise_generator.py`, which shares no code with the package: wander from its spectrum, soft edges
by smoothing. `PYTHONPATH=tests python -m studies.noise` prints the table of docs/guide/noise.md, in some ten minutes.
"""

from __future__ import annotations

import sys
from collections import Counter

import numpy as np

import tacstrip as ts
from noise_generator import Rubber
from tacstrip.arrays import FloatArray
from tacstrip.diagnose import Log, learn_noise
from tacstrip.geometry.moments import moments
from tacstrip.reconstruction.cramer_rao import vertex_jacobian

SENSOR = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0)
SHAPES = (
    np.array([(14.0, 36.0), (62.0, 21.0), (83.0, 58.0), (40.0, 80.0)]),
    np.array([(22.0, 30.0), (71.0, 41.0), (48.0, 79.0)]),
    np.array([(12.0, 44.0), (45.0, 18.0), (80.0, 33.0), (72.0, 66.0), (35.0, 71.0)]),
)
RUBBERS = {
    "white .5 %": Rubber(white=0.005),
    "white .66 %, wander .33 % of 18 s": Rubber(lorentz=0.0033, lorentz_s=18.0),
    "white .66 %, 1/f with a floor of .11 %, strays": Rubber(flicker=0.0011, strays=0.0003, slowest_s=3600.0),
    "white .2 %, edges .5 mm over 5 mm": Rubber(white=0.002, edge_mm=0.5),
    "1/f, strays and edges": Rubber(flicker=0.0011, strays=0.0003, edge_mm=0.5, slowest_s=3600.0),
}
COUNTS = (1, 16, 64)
PERIOD_S, MINUTE_S = 0.5, 60.0
_INSIDE = 5.991  # chi square of two numbers: 95 %


def coverage(
    rubber: Rubber, learnings: int, presses: int, seed: int = 0
) -> dict[int, tuple[float, float, Counter[str]]]:
    """Return how often regions of corners and of the area hold, by scans averaged, and how often each status came.

    Every learning is from another press of another sensor; the presses that follow have edges and wander of their own.
    """
    found: dict[int, tuple[list[bool], list[bool], Counter[str]]] = {n: ([], [], Counter()) for n in COUNTS}
    for i in range(learnings):
        random = np.random.default_rng((seed, i))
        still = rubber.scans(
            random, SENSOR, ts.Contact.polygon(SHAPES[i % 3]), int(MINUTE_S / PERIOD_S), PERIOD_S
        )
        noise = learn_noise(Log.of_scans(SENSOR, still)).noise
        for j in range(presses):
            truth = SHAPES[j % 3]
            for count, (corners, areas, status) in found.items():
                scans = rubber.scans(random, SENSOR, ts.Contact.polygon(truth), count, PERIOD_S)
                _judge(
                    ts.fit_polygon(ts.Scan.mean(scans), SENSOR, noise).objects[0],
                    truth,
                    corners,
                    areas,
                    status,
                )
    return {n: (float(np.mean(c)), float(np.mean(a)), s) for n, (c, a, s) in found.items()}


def _judge(
    found: ts.RecoveredObject, truth: FloatArray, corners: list[bool], areas: list[bool], status: Counter[str]
) -> None:
    status[found.status] += 1
    if len(found.vertices) != len(truth) or found.covariance is None or found.deviations is None:
        return
    for i, off in enumerate(found.vertices - truth):
        own = found.covariance[2 * i : 2 * i + 2, 2 * i : 2 * i + 2]
        corners.append(bool(off @ np.linalg.solve(own, off) < _INSIDE))
    areas.append(bool(abs(found.area - moments(truth)[0]) < 1.96 * found.deviations[0]))


def least_offset(strips: int, truth: FloatArray, signatures: tuple[str, ...], sigma: float = 0.001) -> float:
    """Return the common offset of all readings [Vref] that is 3.5 standard errors from none, where a polygon is fitted.

    A constant added to k_h and k_l moves l by -b (L - w / 2) and u likewise: nearly another polygon with the same
    kinks. What is left of it once the corners have given way tells it.
    """
    sensor = ts.Sensor(construction="crs-crs", strips=strips, pitch_mm=100.0 / strips, length_mm=100.0)
    slopes = vertex_jacobian(ts.Outline.of(truth), sensor, signatures)
    left, size, _ = np.linalg.svd(slopes, full_matrices=False)
    left = left[:, size > 1e-4 * size[0]]
    offset = np.ones(len(slopes))
    seen = float(np.linalg.norm(offset - left @ (left.T @ offset)))
    return 3.5 * sigma / seen if seen > 1e-9 else np.inf


def main() -> None:
    """Print both tables."""
    lines = []
    for name, rubber in RUBBERS.items():
        for count, (corners, areas, status) in coverage(rubber, 18, 4).items():
            lines.append(
                f"{name:48} mean of {count:2}: corners {corners:.3f}, area {areas:.3f}, {dict(status)}"
            )
    for strips in (10, 20, 40, 100):
        for names in (("kh", "kl"), ("kh",)):
            least = [100.0 * least_offset(strips, truth, names) for truth in SHAPES]
            told = f"offset told from {np.round(least, 1)} % of Vref"
            lines.append(f"{strips:3} strips, {'+'.join(names):5}, noise .1 %: {told}")
    sys.stdout.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
