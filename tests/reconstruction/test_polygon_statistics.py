"""How often the polygon fit is right, and how often the truth lies where it says."""

from __future__ import annotations

from typing import Literal, TypeAlias

import numpy as np
import pytest

from polygons import convex_polygon, from_left, many_fits
from tacstrip.contact.noise import Noise
from tacstrip.contact.shape import Contact
from tacstrip.reconstruction.polygon.estimate import fit_polygon
from tacstrip.scan import Scan
from tacstrip.sensor.spec import Sensor
from tacstrip.simulation import simulate

pytestmark = many_fits

Kind: TypeAlias = Literal["uniform", "normal"]

REGION = 5.991  # chi square of two numbers at 95 %
SETTINGS: list[tuple[str, tuple[str, ...], Kind, bool]] = [
    ("crs-crs", ("kh", "kl"), "uniform", True),
    ("crs-crs", ("kh",), "normal", True),
    ("crs-crs", ("kl",), "uniform", False),
    ("crs-m", ("k",), "normal", True),
]


def _trials(
    construction: str, names: tuple[str, ...], kind: Kind, known: bool, trials: int
) -> tuple[float, float]:
    """Return the share of right vertex counts, and of true vertices inside their 95 % regions."""
    sensor = Sensor(construction=construction, strips=200, pitch_mm=5.0, length_mm=1000.0, adc_bits=12)
    noise = Noise(quantisation=0.003, distribution=kind)
    right, inside = [], []
    for seed in range(trials):
        random = np.random.default_rng(seed)
        shape = convex_polygon(seed % 40, 3 + seed % 3, least_gap=60.0) + random.uniform(-3.0, 3.0, 2)
        truth = from_left(shape)
        scan = simulate(sensor, Contact.polygon(truth), noise, rng=random)
        kh, kl, k = (scan[n] if n in names else None for n in ("kh", "kl", "k"))
        (found,) = fit_polygon(Scan(kh, kl, k), sensor, noise if known else None, assessment="none").objects
        right.append(found.vertices.shape == truth.shape)
        if right[-1] and found.covariance is not None:
            for i, e in enumerate(found.vertices - truth):
                block = found.covariance[2 * i : 2 * i + 2, 2 * i : 2 * i + 2]
                inside.append(e @ np.linalg.solve(block, e) <= REGION)
    return float(np.mean(right)), float(np.mean(inside))


@pytest.mark.parametrize(("construction", "names", "kind", "known"), SETTINGS)
def test_regions_hold_the_truth(construction: str, names: tuple[str, ...], kind: Kind, known: bool) -> None:
    right, inside = _trials(construction, names, kind, known, 150)
    assert right >= 0.96
    assert 0.92 <= inside <= 0.985


@pytest.mark.slow
@pytest.mark.parametrize(("construction", "names", "kind", "known"), SETTINGS)
def test_regions_hold_the_truth_in_93_to_97_percent(
    construction: str, names: tuple[str, ...], kind: Kind, known: bool
) -> None:
    right, inside = _trials(construction, names, kind, known, 2000)
    assert right >= 0.97  # their kinks may be weak: benchmarks/transitions.py has counts where they are not
    assert 0.93 <= inside <= 0.97


@pytest.mark.parametrize("pitch", [8.0, 10.0])
def test_corners_hold_where_an_edge_crosses_one_strip(pitch: float) -> None:
    """A line through that strip and the one beside its corner seems to tell to .2 mm where the corner is."""
    random = np.random.default_rng(1)
    sensor = Sensor(construction="crs-crs", strips=int(100 / pitch), pitch_mm=pitch, length_mm=100.0)
    noise = Noise(positional=0.005)
    inside = []
    for _ in range(40):
        true = np.array([(22.0, 18.0), (70.0, 34.0), (62.0, 72.0), (30.0, 66.0)]) + random.uniform(-3, 3, 2)
        scan = simulate(sensor, Contact.polygon(true), noise, rng=random)
        found = fit_polygon(scan, sensor, noise, bounded=False, assessment="none").objects[0]
        for i, vertex in enumerate(found.vertices if len(found.vertices) == 4 else ()):
            assert found.covariance is not None
            off = vertex - true[np.linalg.norm(true - vertex, axis=1).argmin()]
            own = found.covariance[2 * i : 2 * i + 2, 2 * i : 2 * i + 2]
            inside.append(off @ np.linalg.solve(own, off) < 5.99)
    assert len(inside) > 100
    assert np.mean(inside) > 0.9
