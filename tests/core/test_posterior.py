"""The sampler of outlines: against importance sampling, against a grid of sigma, and the same for the same seed."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.core.binding import MOST_CORNERS, exported
from tacstrip.core.posterior import (
    OutlinePrior,
    Samples,
    outline_ends,
    outline_record,
    sample_outlines,
)
from tacstrip.core.problem import FitProblem

pytestmark = pytest.mark.skipif(exported("sample_outlines") is None, reason="only the compiled core samples")

LOW, HIGH = -0.6, 1.6  # where heights may lie
START = outline_record(np.array([(0, 0.5), (0.5, 0.4), (1, 0.5)]), np.array([(0, 0.5), (0.5, 0.6), (1, 0.5)]))


def problem_of(kinds: str, strips: int, sigma: float, lam: float = 0.0) -> FitProblem:
    """Readings of a slanted lens, k_h and k_l or one of them, without noise."""
    construction = "crs-m" if kinds == "k" else "crs-crs"
    sensor = ts.Sensor(
        construction=construction, strips=strips, pitch_mm=1.0, length_mm=1.0, contact_lambda_mm=lam
    )
    x = (sensor.x_mm / strips - 0.5) * 2.0
    l, u = 0.45 + 0.1 * x - 0.25 * (1 - x**2), 0.5 + 0.1 * x + 0.2 * (1 - x**2)
    names = {"both": ("kh", "kl")}.get(kinds, (kinds,))
    readings = {name: values for name, values in ts.signatures(sensor, l, u).items() if name in names}
    return FitProblem.of(sensor, sensor.x_mm, readings, sigma)


def drawn_from_prior(
    random: np.random.Generator, inner: int, upright: tuple[int, int], window: float, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Outlines as lower and upper points (count, 2, inner + 2, 2), NaN for points of the other chain, and weights.

    Weights are prior density over density drawn: height^-(N - 2) is drawn, by lowest and highest points.
    """
    many, rows, room = inner + 2 + sum(upright), np.arange(count), HIGH - LOW
    y, extreme = random.random((count, many)), random.random((count, many)).argsort(axis=1)
    y[rows, extreme[:, 0]], y[rows, extreme[:, 1]] = 0.0, 1.0
    height = random.uniform(0.0, room, count)
    y = y * height[:, None] + (LOW + random.random(count) * (room - height))[:, None]
    weight = many * (many - 1) * room * (room - height)
    last = [1 + upright[0], 2 + sum(upright)]  # of y: the left end's, the right end's, the others
    ends = [np.sort(y[:, [0, last[0] - 1]], axis=1), np.sort(y[:, [last[0], last[1] - 1]], axis=1)]
    x = np.stack(
        [random.uniform(-window, window, count), random.uniform(1 - window, 1 + window, count)], axis=1
    )
    inside = np.sort(random.uniform(0.0, 1.0, (count, inner)), axis=1) * (x[:, 1:] - x[:, :1]) + x[:, :1]
    side = random.integers(0, 2, (count, inner))
    weight *= (x[:, 1] - x[:, 0]) ** inner * (2 * window) ** 2 * 2.0**inner / math.factorial(inner)
    weight /= 2.0 ** sum(upright)
    chains = []
    for c in (0, 1):
        px = np.concatenate([x[:, :1], np.where(side == c, inside, np.nan), x[:, 1:]], axis=1)
        py = np.concatenate(
            [ends[0][:, [c]], np.where(side == c, y[:, last[1] :], np.nan), ends[1][:, [c]]], axis=1
        )
        chains.append(np.stack([px, py], axis=2))
    return np.stack(chains, axis=1), weight


def heights_of(chains: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """l and u (count, 2, strips) of chains (count, 2, P, 2), and which are convex with l <= u at both ends."""
    found = np.full((len(chains), 2, len(x)), np.nan)
    good = np.all(chains[:, 0, [0, -1], 1] <= chains[:, 1, [0, -1], 1], axis=1)
    for c in (0, 1):
        at, before = chains[:, c, 0], np.full(len(chains), np.nan)
        for nxt in np.moveaxis(chains[:, c, 1:], 1, 0):
            there = np.isfinite(nxt[:, 0])
            slope = np.where(there, (nxt[:, 1] - at[:, 1]) / (nxt[:, 0] - at[:, 0]), before)
            good &= ~((slope - before) * (1 - 2 * c) < 0.0)
            on = there[:, None] & (x >= at[:, :1]) & (x <= nxt[:, :1])
            found[:, c] = np.where(on, at[:, 1:] + slope[:, None] * (x - at[:, :1]), found[:, c])
            at, before = np.where(there[:, None], nxt, at), slope
    return found, good


def importance(
    problem: FitProblem,
    prior: OutlinePrior,
    window: float,
    kinds: list[tuple[int, tuple[int, int]]],
    count: int,
) -> tuple[np.ndarray, float]:
    """The share of each kind of outline, and the mean area, by weighing draws from the prior."""
    random, share, area = np.random.default_rng(5), [], 0.0
    for inner, upright in kinds:
        chains, weight = drawn_from_prior(random, inner, upright, window, count)
        (ends, good), n = heights_of(chains, problem.x), inner + 2 + sum(upright)
        good &= ~((ends[:, 1] < 0.0) | (ends[:, 0] > 1.0)).any(axis=1)
        l, u = np.clip(ends[:, 0], 0.0, 1.0), np.clip(ends[:, 1], 0.0, 1.0)
        k = problem.readings_of(l, u)
        off = ((problem.k - k) ** 2 * problem.weight).sum(axis=(1, 2))
        log = -0.5 * off + prior.vertices[sum(upright), n] + prior.ends[upright[0] + 2 * upright[1]]
        total = np.where(good, weight * np.exp(log), 0.0) / count
        share.append(total.sum())
        area += float((total * (u - l).mean(axis=1)).sum())
    return np.array(share) / sum(share), area / sum(share)


def kinds_of(samples: Samples) -> list[tuple[int, tuple[int, int]]]:
    found = []
    for outline in samples.outlines:
        count, y = outline["count"], outline["y"]
        upright = (int(y[1, 0] > y[0, 0]), int(y[1, count[1] - 1] > y[0, count[0] - 1]))
        found.append((int(count.sum()) - 4, upright))
    return found


@pytest.mark.parametrize(
    ("kinds", "sigma", "lam"),
    [("kh", 1e3, 0.0), ("kh", 0.2, 0.0), ("k", 0.2, 0.0), ("kl", 0.3, 0.05), ("both", 0.2, 0.0)],
)
def test_samples_are_as_frequent_as_readings_and_prior_make_them(
    kinds: str, sigma: float, lam: float
) -> None:
    """Counts of vertices, pointed and upright ends, and the area; a sigma of 1000 leaves the prior alone."""
    problem, window = problem_of(kinds, 8, sigma, lam), 0.05
    vertices = np.full((3, MOST_CORNERS + 1), -np.inf)
    vertices[:, 3:6] = 0.0, 1.5, 3.0
    prior = OutlinePrior((-window, window, 1 - window, 1 + window), (0.0, 0.3, -0.5, 0.2), vertices=vertices)
    space = [(i, (a, b)) for i, a, b in product(range(4), (0, 1), (0, 1)) if 3 <= i + 2 + a + b <= 5]
    share, area = importance(problem, prior, window, space, 30_000)
    samples = sample_outlines(problem, prior, [START], 400_000, 5_000, heat=(1.0, 4.0))
    assert samples is not None
    assert len(samples.squares) == 5_000
    found = kinds_of(samples)
    counted = np.array([found.count(kind) for kind in space]) / len(found)
    assert counted == pytest.approx(share, abs=0.06)
    ends = outline_ends(samples.outlines, problem.x)
    assert (ends[:, 1] - ends[:, 0]).mean() == pytest.approx(area, abs=0.045)


def test_sigma_that_is_not_known_is_found() -> None:
    """Of noise of one tenth of what the weights say, and within the bounds that are given."""
    problem, random = problem_of("both", 40, 0.01), np.random.default_rng(2)
    clean = problem.readings_of(*outline_ends(START, problem.x)[0])
    noisy = replace(problem, k=clean + random.normal(0.0, 0.004, clean.shape))
    prior = OutlinePrior((-0.02, 0.02, 0.98, 1.02), sigma=(0.05, 1.5))
    samples = sample_outlines(noisy, prior, [START], 20_000, 500)
    assert samples is not None
    assert np.median(samples.sigma) == pytest.approx(0.4, rel=0.2)
    held = sample_outlines(noisy, replace(prior, sigma=(0.8, 1.5)), [START], 20_000, 500)
    assert held is not None
    assert held.sigma.min() >= 0.8
    assert np.median(held.sigma) < 0.9


def test_the_same_seed_gives_the_same_samples_and_a_start_that_is_not_allowed_none() -> None:
    problem, prior = problem_of("kh", 20, 0.01), OutlinePrior((-0.025, 0.025, 0.975, 1.025))
    first, again, other = (sample_outlines(problem, prior, [START], 2_000, 50, seed=s) for s in (3, 3, 4))
    assert first is not None
    assert again is not None
    assert other is not None
    assert np.array_equal(first.outlines["y"], again.outlines["y"])
    assert not np.array_equal(first.outlines["y"], other.outlines["y"])
    assert sample_outlines(problem, replace(prior, window=(0.1, 0.2, 0.8, 0.9)), [START], 10, 1) is None


def test_the_readings_hold_the_samples() -> None:
    """Chi square of samples is as many as there are readings, with one signature and with both."""
    for kinds in ("kh", "kl", "k", "both"):
        problem, random = problem_of(kinds, 60, 0.004), np.random.default_rng(1)
        noisy = replace(problem, k=problem.k + random.normal(0.0, 0.004, problem.k.shape))
        samples = sample_outlines(noisy, OutlinePrior((-0.02, 0.02, 0.98, 1.02)), [START], 20_000, 200)
        assert samples is not None
        assert np.median(samples.squares) == pytest.approx(noisy.k.size, rel=0.3)
