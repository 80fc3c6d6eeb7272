"""Particles of each kind of regular outline, by sequential Monte Carlo (Del Moral, Doucet and Jasra 2006).

It tells how likely that kind makes the readings, too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.reconstruction.posterior.regular.kinds import BORDER, FREE, KINDS, NUMBERS, TURN, Outlines
from tacstrip.reconstruction.posterior.regular.likelihood import Likelihood

PARTICLES = 48
_FIRST, _SWEEPS, _LEVELS = 4, 3, 40
_HALF = 0.5  # of the particles, that a level leaves
_SMALLEST, _HALVINGS = 1e-12, 13  # of the power's rise
_HOPELESS = 8.0  # of the log evidence, by which a kind is given up


@dataclass(frozen=True, eq=False)
class Population:
    """Particles of one kind: numbers (P, 8), half chi squares (P,), and the log evidence up to where it is."""

    kind: int
    over: bool
    z: FloatArray
    misfit: FloatArray
    log_evidence: float


def sampled(
    likelihood: Likelihood, random: np.random.Generator, best: float
) -> tuple[list[Population], list[Population]]:
    """Return populations of the posterior, and those given up on the way: by sequential Monte Carlo, all at once."""
    kind, over = np.repeat(np.arange(len(KINDS)), 2), np.tile([False, True], len(KINDS))
    free, count = np.array(FREE)[kind] + 2.0, _FIRST * PARTICLES
    z = random.random((len(kind), count, NUMBERS))
    log, misfit = _weights(likelihood, kind, over, z)
    power, evidence, first = np.zeros(len(kind)), np.zeros(len(kind)), log
    done: list[Population] = []
    given_up: list[Population] = []
    for _ in range(_LEVELS):
        step, weight = _next_level(first, misfit, 1.0 - power)
        most = weight.max(axis=1, keepdims=True)
        share = np.exp(weight - most)
        evidence = evidence + most[:, 0] + np.log(share.mean(axis=1))
        share /= share.sum(axis=1, keepdims=True)
        power = np.minimum(power + step, 1.0)
        at = (random.random((len(kind), 1)) + np.arange(PARTICLES)) / PARTICLES
        at = np.minimum((at[:, :, None] > np.cumsum(share, axis=1)[:, None]).sum(axis=2), share.shape[1] - 1)
        z = np.take_along_axis(z, at[:, :, None], axis=1)
        log, misfit = (np.take_along_axis(v, at, axis=1) for v in (log, misfit))
        first = np.zeros_like(log)
        for _ in range(_SWEEPS):
            trial = _moved(z, random)
            trial_log, trial_misfit = _weights(likelihood, kind, over, trial)
            gain = trial_log - log - power[:, None] * (trial_misfit - misfit)
            taken = -random.standard_exponential(log.shape) < gain
            z = np.where(taken[..., None], trial, z)
            log, misfit = np.where(taken, trial_log, log), np.where(taken, trial_misfit, misfit)
        finished = power > 1.0 - 1e-9
        best = max(best, evidence[finished].max(initial=-np.inf))
        # What is left to gain: misfits are above their least by 1/2 a number at this temperature, here twice that.
        hope = evidence - (1.0 - power) * np.maximum(misfit.min(axis=1) - free / power, 0.0)
        go_on = ~finished & (hope > best - _HOPELESS)
        for i in np.flatnonzero(~go_on):
            left = (1.0 - power[i]) * float(misfit[i].mean())
            of = Population(int(kind[i]), bool(over[i]), z[i], misfit[i], float(evidence[i] - left))
            (done if finished[i] else given_up).append(of)
        kind, over, free, z, log, misfit, power, evidence, first = (
            v[go_on] for v in (kind, over, free, z, log, misfit, power, evidence, first)
        )
        if not len(kind):
            break
    return done, given_up


def _weights(
    likelihood: Likelihood, kind: IntArray, over: BoolArray, z: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return log prior and half chi square (C, P) of populations' numbers (C, P, 8)."""
    each = z.shape[1]
    log, misfit, _ = likelihood.weighed(
        Outlines(np.repeat(kind, each), np.repeat(over, each), z.reshape(-1, NUMBERS))
    )
    return log.reshape(z.shape[:2]), misfit.reshape(z.shape[:2])


def _next_level(log: FloatArray, misfit: FloatArray, left: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return by how much (C,) the likelihood's power rises so that half of the particles count, and log weights."""

    def count(step: FloatArray) -> FloatArray:
        weight = log - step[:, None] * misfit
        share = np.exp(weight - weight.max(axis=1, keepdims=True))
        return np.asarray(share.sum(axis=1) ** 2 / (share**2).sum(axis=1))

    low, high = np.full_like(left, _SMALLEST), left
    enough = count(left) >= _HALF * PARTICLES
    for _ in range(_HALVINGS):
        half = np.sqrt(low * high)
        more = count(half) >= _HALF * PARTICLES
        low, high = np.where(more, half, low), np.where(more, high, half)
    step = np.where(enough, left, low)
    return step, log - step[:, None] * misfit


def _moved(z: FloatArray, random: np.random.Generator) -> FloatArray:
    """Return other numbers (C, P, 8), by differences of two particles, or a few of them by any size."""
    several, row = z.shape[:2], np.arange(len(z))[:, None]
    a, b = random.integers(PARTICLES, size=(2, *several))
    differ = z[row, a] - z[row, b]
    differ[..., TURN] -= np.rint(differ[..., TURN])
    normal, kind = random.normal(size=z.shape), random.random((*several, 1))
    jump = np.exp(random.uniform(math.log(0.03), math.log(2.0), (*several, 1))) * differ + 1e-5 * normal
    size = np.exp(random.uniform(math.log(1e-3), math.log(0.5), (*several, 1)))
    few = np.where(random.random(z.shape) < 0.3, size * normal, 0.0)
    moved = z + np.where(kind < 0.75, jump, few)
    folded = moved - 2.0 * np.floor(0.5 * moved)
    folded = np.minimum(folded, 2.0 - folded)
    for around in (TURN, BORDER):
        folded[..., around] = moved[..., around] - np.floor(moved[..., around])
    return np.minimum(folded, 1.0 - 1e-12)
