"""Creep: a held contact does not grow, one that moves is not held back, and one at rest is left alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.arrays import FloatArray
from tacstrip.sensor.creep import creep_rate, log_age
from tacstrip.stream.live.creep import CreepFilter

AGE = np.arange(0.0, 60.0, 0.1)
GROWTH = np.array([[0.003], [-0.003]])  # of k_h and of k_l: both ends move outwards


def scans(change: FloatArray, seed: int = 0, wander: float = 0.0005) -> list[ts.Scan]:
    """Return scans of three held strips of five, whose k_h and k_l change (scans, 2), with noise that wanders."""
    rng = np.random.default_rng(seed)
    shape = (len(AGE), 2, 3)
    slow = np.cumsum(rng.normal(0.0, wander * 0.05, shape), axis=0)  # a random walk
    k = np.array([[0.6], [0.3]]) + change[:, :, None] + slow + rng.normal(0.0, 0.001, shape)
    pad = np.full((len(AGE), 2, 1), np.nan)
    k = np.concatenate([pad, k, pad], axis=2)
    return [ts.Scan(kh=h, kl=l, time_s=t) for (h, l), t in zip(k, AGE, strict=True)]


def test_the_mean_of_a_long_press_is_its_first_seconds() -> None:
    held = ts.Scan.mean(scans((log_age(AGE) * GROWTH).T))
    np.testing.assert_allclose(held["kh"][1:4], 0.6, atol=1.5e-3)
    np.testing.assert_allclose(held["kl"][1:4], 0.3, atol=1.5e-3)
    grown = 0.003 * float(log_age(AGE).mean())
    assert grown > 5e-3  # what the mean was off by


@pytest.mark.parametrize("seed", range(8))
def test_a_zero_that_wanders_and_a_contact_that_slides_are_no_creep(seed: int) -> None:
    rest = scans(np.zeros((len(AGE), 2)), seed, 0.002)
    slide = scans(np.outer(AGE, (0.0005, 0.0005)), seed)
    for made in (rest, slide):
        k = np.array([np.concatenate([s["kh"][1:4], s["kl"][1:4]]) for s in made])
        assert not creep_rate(AGE, k).any()


def test_a_live_press_of_a_minute_does_not_grow() -> None:
    creep, one_left_out, late = CreepFilter(), CreepFilter(), []
    for scan in scans((log_age(AGE) * GROWTH).T):
        found = creep.update(scan)
        less = one_left_out.update(replace(scan, kl=np.where(np.arange(5) == 2, np.nan, scan["kl"])))
        if scan.time_s > 30.0:
            late.append(found["kh"][1:4] - found["kl"][1:4])
    assert creep.creeping
    np.testing.assert_allclose(less["kh"], found["kh"], atol=1e-3)  # the others are as well known
    np.testing.assert_allclose(np.mean(late, axis=0), 0.3, atol=3e-3)  # 0.32 without
    # Put down elsewhere, it is another contact at once.
    for i in range(5):
        moved = creep.update(ts.Scan(kh=np.full(5, 0.8), kl=np.full(5, 0.5), time_s=60.0 + 0.1 * i))
    assert moved["kh"][2] == pytest.approx(0.8)
    assert not creep.creeping


def test_a_sliding_contact_is_passed_on_as_it_is() -> None:
    creep = CreepFilter()
    for scan in scans(np.outer(AGE, (0.002, 0.002))):
        assert creep.update(scan) is scan
