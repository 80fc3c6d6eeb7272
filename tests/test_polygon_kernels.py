"""The compiled kernels of the polygon fit do what their NumPy version does."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from tacstrip.reconstruct.polygon_cholesky import cholesky, solve_cholesky
from tacstrip.reconstruct.polygon_descent import descend, sort_vertices
from tacstrip.reconstruct.polygon_score import OWN, TRIED, places

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.core.ellipse import fit_ellipse
from tacstrip.core.fit import ENDS, Data, Model, normal_equations, with_prior
from tacstrip.core.search import fit_counts
from tacstrip.core.signal import Signal
from tacstrip.reconstruct import polygon_compiled, polygon_plain
from tacstrip.sensor.circuit import k_h, k_l, k_metal
from tacstrip.sensor.spec import Sensor

MODELS = (
    ("both", 1.0, 0.0),
    ("both", 5.0, 0.02),
    ("upper", 1.0, 0.0),
    ("upper", 0.2, 0.05),
    ("lower", 1.0, 0.01),
    ("metal", 0.0, 0.0),
    ("metal", 0.0, 0.03),
)


def _model(kind: str, ratio: float, lam: float) -> Model:
    a = ratio / (1.0 + ratio)
    shares = {"both": [a, 0.0], "upper": [a], "lower": [0.0], "metal": [0.0]}[kind]
    return np.array(shares), 1.0 - a, lam


def _case(
    seed: int, model: Model, blunt: tuple[int, int], n: int = 60
) -> tuple[FloatArray, IntArray, IntArray, Data]:
    """Draw a fit with vertices on both chains, and readings near it."""
    random = np.random.default_rng(seed)
    m = int(random.integers(1, 6))
    x = np.sort(random.uniform(0.05, 0.95, m))
    chain = random.integers(0, 2, m)
    y = np.where(chain == 1, random.uniform(0.55, 0.8, m), random.uniform(0.15, 0.45, m))
    left, right = random.uniform(0.45, 0.55, 2)
    ends = [0.002, left, left + 0.1 * blunt[0], 0.997, right, right + 0.1 * blunt[1]]
    theta = np.concatenate([ends, np.stack([x, y], axis=1).ravel()])
    strips = (np.arange(n) + 0.5) / n
    shape = (len(model[0]), n)
    weight = np.where(random.uniform(size=shape) < 0.1, 0.0, random.uniform(0.5, 2.0, shape)) / 0.005**2
    sides = np.array(blunt, dtype=np.int64)
    (l, _), (u, _) = polygon_plain.heights(theta, chain, sides, strips)
    data = (strips, _readings(model, l, u) + random.normal(0.0, 0.005, shape), weight, 1.0 / n)
    return theta, chain, sides, data


def _readings(model: Model, l: FloatArray, u: FloatArray) -> FloatArray:
    """Return the readings by the closed forms of `sensor.circuit`."""
    shares, narrow, lam = model
    if narrow == 1.0:
        return k_metal(l, u - l, 1.0, lam)[None]
    ratio = (1.0 - narrow) / narrow
    forms = [k_h if share > 0.0 else k_l for share in shares]
    return np.stack([form(l, u - l, 1.0, ratio, lam) for form in forms])


@pytest.mark.parametrize("blunt", [(0, 0), (1, 0), (1, 1)])
@pytest.mark.parametrize("which", MODELS)
def test_plain_slopes_are_those_of_the_closed_forms(
    which: tuple[str, float, float], blunt: tuple[int, int]
) -> None:
    model = _model(*which)
    theta, chain, sides, data = _case(1, model, blunt)
    slopes, off, _ = polygon_plain.rows(theta, chain, sides, data, model)
    root = np.sqrt(data[2])
    used = root.ravel() > 0.0

    def residuals(at: FloatArray) -> FloatArray:
        (l, _), (u, _) = polygon_plain.heights(at, chain, sides, data[0])
        return np.asarray((root * (data[1] - _readings(model, l, u))).ravel())

    readings = used.size
    np.testing.assert_allclose(off[:readings], residuals(theta), atol=1e-9)
    for i in polygon_plain.free_entries(len(chain), sides):
        step = np.zeros_like(theta)
        step[i] = 1e-6
        if i in (1, 4) and not sides[i // 3]:
            step[i + 1] = 1e-6
        by_difference = -(residuals(theta + step) - residuals(theta - step)) / 2e-6
        np.testing.assert_allclose(slopes[:readings, i], by_difference, atol=3e-4 * root.max())


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("which", MODELS)
def test_normal_equations_agree(which: tuple[str, float, float], seed: int) -> None:
    model = _model(*which)
    theta, chain, blunt, data = _case(seed, model, (seed % 2, seed // 3))
    if seed > 3:  # chains that cross
        theta[ENDS + 1 :: 2] = 1.0 - theta[ENDS + 1 :: 2]
    matrix, gradient = np.empty((len(theta), len(theta))), np.empty(len(theta))
    cost = normal_equations(theta, chain, len(chain), blunt, data, model, matrix, gradient)
    cost += with_prior(theta, blunt, data[3], matrix, gradient)
    wanted = polygon_plain.normal_equations(theta, chain, blunt, data, model)
    assert cost == pytest.approx(wanted[0], rel=1e-10)
    np.testing.assert_allclose(matrix, wanted[1], rtol=1e-9, atol=1e-9 * np.abs(wanted[1]).max())
    np.testing.assert_allclose(gradient, wanted[2], rtol=1e-9, atol=1e-9 * np.abs(wanted[2]).max())


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("which", MODELS)
def test_descents_agree(which: tuple[str, float, float], seed: int) -> None:
    model = _model(*which)
    theta, chain, blunt, data = _case(seed, model, (seed % 2, seed // 4))
    random = np.random.default_rng(seed)
    theta[ENDS:] += random.normal(0.0, 0.02, len(theta) - ENDS)
    fits = []
    for run in (descend, polygon_plain.descend):
        start, kinds = theta.copy(), chain.copy()
        cost = run(start, kinds, len(chain), blunt, data, model, 12, 1e-6, np.inf)
        fits.append((cost, start, kinds))
    assert fits[0][0] == pytest.approx(fits[1][0], rel=1e-6)
    np.testing.assert_array_equal(fits[0][2], fits[1][2])
    np.testing.assert_allclose(fits[0][1], fits[1][1], atol=1e-5)


def test_a_descent_ends_in_a_minimum() -> None:
    model = _model("both", 1.0, 0.0)
    theta, chain, blunt, data = _case(2, model, (0, 0))
    cost = descend(theta, chain, len(chain), blunt, data, model, 60, 1e-9, np.inf)
    random = np.random.default_rng(0)
    for _ in range(200):
        near = theta + random.normal(0.0, 1e-3, len(theta))
        near[[2, 5]] = near[[1, 4]]
        assert polygon_plain.normal_equations(near, chain, blunt, data, model)[0] >= cost


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("which", MODELS)
def test_the_score_test_finds_the_best_places(which: tuple[str, float, float], seed: int) -> None:
    model = _model(*which)
    theta, chain, blunt, data = _case(seed, model, (0, 0))
    m = len(chain) - 1
    theta, chain = theta[: ENDS + 2 * m].copy(), chain[:m].copy()  # a vertex is missing
    descend(theta, chain, m, blunt, data, model, 30, 1e-6, np.inf)
    starts, kinds = np.empty((TRIED, ENDS + 2 * m + 2)), np.empty((TRIED, m + 1), dtype=np.int64)
    count = places(theta, chain, m, blunt, False, data, model, starts, kinds)
    assert count > 0
    gains = {}
    for upper in (0, 1):
        knots = np.concatenate([theta[:1], theta[ENDS::2][chain == upper], theta[3:4]])
        for x in data[0][1:-1]:
            if np.abs(knots - x).min() >= data[3]:
                gain, _, new = polygon_plain.gain_of_vertex(theta, chain, blunt, data, model, x, upper)
                gains[float(x), upper] = gain if new > OWN else 0.0
    found = [gains[float(s[-2]), int(c[-1])] for s, c in zip(starts[:count], kinds[:count], strict=True)]
    assert max(found) == pytest.approx(max(gains.values()), rel=1e-3)


def test_vertices_are_brought_into_order_with_their_chains() -> None:
    theta = np.array([0.0, 0.5, 0.5, 1.0, 0.5, 0.5, 0.7, 0.1, 0.2, 0.9, 0.4, 0.3])
    chain = np.array([0, 1, 0])
    sort_vertices(theta, chain, 3)
    assert theta[ENDS:].tolist() == [0.2, 0.9, 0.4, 0.3, 0.7, 0.1]
    assert chain.tolist() == [1, 0, 0]


def test_small_systems_are_solved() -> None:
    random = np.random.default_rng(3)
    root, b = random.normal(size=(7, 7)), random.normal(size=7)
    matrix = root @ root.T
    factor, x = matrix.copy(), b.copy()
    assert cholesky(factor, 7)
    solve_cholesky(factor, 7, x)
    np.testing.assert_allclose(matrix @ x, b, atol=1e-9)
    assert not cholesky(-matrix, 7)


def test_the_information_of_an_oval_is_that_of_its_readings() -> None:
    sensor = Sensor(construction="crs-crs", strips=80, pitch_mm=1.0, length_mm=60.0, resistivity_ratio=2.0)
    t = np.linspace(-79 / 80, 79 / 80, 80)
    middle, half = 0.5 + 0.1 * t, 0.2 * np.sqrt(1.0 - t * t)
    x = sensor.x_mm
    empty = Signal.of(sensor, x, {"kh": np.zeros(80), "kl": np.zeros(80)}, 0.002)
    k = empty.slopes(middle - half, middle + half)[2] + np.random.default_rng(1).normal(0.0, 0.002, (2, 80))
    signal = Signal.of(sensor, x, {"kh": k[0], "kl": k[1]}, 0.002)
    oval = fit_ellipse(fit_counts(signal).chosen, signal)
    np.testing.assert_allclose(oval.parameters[2:], [0.5, 0.1, 0.2], atol=0.003)
    for i in (2, 3, 4):  # the ends' x move strips in and out, where differences do not exist
        sides = []
        for sign in (-1.0, 1.0):
            p = oval.parameters.copy()
            p[i] += sign * 1e-6
            sides.append(type(oval)(p, 0.0, oval.information).residuals(signal).ravel())
        slope = (sides[1] - sides[0]) / 2e-6
        assert oval.information[i, i] == pytest.approx(slope @ slope, rel=1e-5)


def test_machine_code_of_an_edited_kernel_is_thrown_away(tmp_path: Path) -> None:
    cache = tmp_path / "__pycache__"
    cache.mkdir()
    for name in polygon_compiled._FILES:
        (tmp_path / f"{name}.py").write_text("")
        os.utime(tmp_path / f"{name}.py", (1000, 1000))
    old, other = cache / "polygon_moves.improve-58.py311.nbi", cache / "somebody_else.f-1.py311.nbi"
    for file in (old, other):
        file.write_text("")
        os.utime(file, (2000, 2000))
    polygon_compiled._forget(tmp_path)
    assert old.exists()
    os.utime(tmp_path / "kernels.py", (3000, 3000))
    polygon_compiled._forget(tmp_path)
    assert not old.exists()
    assert other.exists()
