"""Draws from how likely poses are, where slopes at the best one do not tell: adaptive importance sampling.

Each round draws from Student's t about several centres, first the descents' ends, then draws of the rounds before; the
weight of every draw is its likelihood over the mean of what all rounds drew from (Cornuet and others, 2012).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.reconstruction.pressed.descent import jacobian
from tacstrip.reconstruction.pressed.poses import TOUCH_MM, TURNS, Poses

_ROUNDS, _DRAWS, _ENOUGH, _MOST_ROUNDS = 4, 240, 200.0, 12
_CENTRES, _SHRUNK = 40, 0.6  # of later rounds; their spread over the draws' own
# Even draws that the next centres are drawn from; of weights, to get so many.
_SPREAD, _LEAST_POWER = 60.0, 0.05
_FREEDOM, _WIDER = 4.0, 1.2  # of Student's t; of the descents' ends
_WIDEST = {"log_radius": 0.7, "turn_rad": 0.5}  # standard deviations that a descent's end is taken for
_FAR = 25.0  # cost by which another descent's end is no centre


@dataclass(frozen=True, eq=False)
class Draws:
    """Parameters (N, P) with weights (N,) that add up to 1; `effective` is how many even ones tell as much.

    `best` is the likeliest of them (P,).
    """

    values: FloatArray
    weights: FloatArray
    effective: float
    best: FloatArray

    def even(self, count: int, random: np.random.Generator) -> FloatArray:
        """Return as many draws of equal weight (count, P), by systematic resampling."""
        at = (np.arange(count) + random.uniform()) / count
        return np.asarray(
            self.values[np.searchsorted(np.cumsum(self.weights), at * self.weights.sum() * (1.0 - 1e-12))]
        )

    @property
    def mean(self) -> FloatArray:
        """Weighted mean (P,)."""
        return np.asarray(self.weights @ self.values)

    @property
    def covariance(self) -> FloatArray:
        """Weighted covariance (P, P)."""
        apart = self.values - self.mean
        return np.asarray((self.weights[:, None] * apart).T @ apart)


@dataclass(frozen=True, eq=False)
class _Mixture:
    """Student's t about centres (C, P) with weights (C,), of one shape each: roots of covariances (C, P, P)."""

    centres: FloatArray
    shares: FloatArray
    roots: FloatArray

    def draw(self, count: int, random: np.random.Generator) -> FloatArray:
        """Return draws (count, P)."""
        which = random.choice(len(self.shares), count, p=self.shares)
        normal = random.standard_normal((count, self.centres.shape[1]))
        normal /= np.sqrt(random.chisquare(_FREEDOM, count) / _FREEDOM)[:, None]
        return np.asarray(self.centres[which] + np.einsum("npq,nq->np", self.roots[which], normal))

    def log_density(self, values: FloatArray) -> FloatArray:
        """Return the logarithm of the density (N,), but for a constant that all mixtures share."""
        p = self.centres.shape[1]
        inverse = np.linalg.inv(self.roots)
        scaled = np.einsum("cpq,ncq->ncp", inverse, values[:, None] - self.centres)
        each = -0.5 * (_FREEDOM + p) * np.log1p(np.square(scaled).sum(axis=2) / _FREEDOM)
        each += np.log(np.abs(np.linalg.det(inverse))) + np.log(self.shares)
        top = each.max(axis=1)
        return np.asarray(top + np.log(np.exp(each - top[:, None]).sum(axis=1)))


def draw(
    poses: Poses, ends: FloatArray, costs: FloatArray, ridge: tuple[FloatArray, FloatArray],
    random: np.random.Generator, scale: float,
) -> Draws:  # fmt: skip
    """Return draws from the likelihood, with descents' ends (M, P), their costs (M,) and a ridge to begin with.

    `scale` is by what the readings' variance is larger than `poses` takes it for.
    """
    covariances = _laplace(poses, ends) * scale
    if (at := poses.column("log_radius")) is not None:
        covariances = np.concatenate([covariances, _along(poses, ridge[0], at, scale)])
        ends, costs = np.concatenate([ends, ridge[0]]), np.concatenate([costs, ridge[1]])
    near = costs - costs[0] < _FAR * scale
    ends, costs, covariances = ends[near], costs[near], covariances[near]
    share = -0.5 * (costs - costs[0]) / scale + 0.5 * np.linalg.slogdet(covariances)[1]
    share = np.exp(share - share.max())
    share = 0.7 * share / share.sum() + 0.3 / len(share)
    proposals = [_Mixture(ends, share / share.sum(), _WIDER * np.asarray(np.linalg.cholesky(covariances)))]
    values, log_likelihood = np.empty((0, ends.shape[1])), np.empty(0)
    draws = Draws(values, log_likelihood, 0.0, ends[0])
    for number in range(_MOST_ROUNDS):
        new = proposals[-1].draw(_DRAWS, random)
        values = np.concatenate([values, new])
        left = np.square(poses.residuals(new))
        left[:, : poses.readings] /= scale
        log_likelihood = np.concatenate([log_likelihood, -0.5 * left.sum(axis=1)])
        drawn = np.logaddexp.reduce([p.log_density(values) for p in proposals], axis=0) - math.log(
            len(proposals)
        )
        # Depths are alike by their logarithm, as radii are: by their size, small objects pressed deep have more poses.
        log_target = log_likelihood - np.log(np.maximum(values[:, 2], TOUCH_MM))
        weights = _normal(log_target - drawn)
        best = values[int(np.argmax(log_likelihood))]
        wrapped = _wrapped(poses, values, best)
        draws = Draws(wrapped, weights, float(1.0 / np.square(weights).sum()), best)
        if number + 1 >= _ROUNDS and draws.effective >= _ENOUGH:
            break
        power = 1.0  # less while few draws outweigh all others, so that the next ones reach further
        while power > _LEAST_POWER and 1.0 / np.square(weights).sum() < _SPREAD:
            power *= 0.7
            weights = _normal(power * (log_target - drawn))
        root = np.linalg.cholesky(
            Draws(wrapped, weights, 0.0, best).covariance + 1e-12 * np.eye(values.shape[1])
        )
        centres = Draws(values, weights, 0.0, best).even(_CENTRES, random)
        proposals.append(
            _Mixture(
                centres, np.full(_CENTRES, 1.0 / _CENTRES), np.repeat(_SHRUNK * root[None], _CENTRES, axis=0)
            )
        )
    return draws


def _normal(log_weights: FloatArray) -> FloatArray:
    """Return weights (N,) that add up to 1."""
    weights = np.exp(log_weights - log_weights.max())
    return np.asarray(weights / weights.sum())


def _laplace(poses: Poses, ends: FloatArray) -> FloatArray:
    """Return the covariances (M, P, P) that slopes at poses tell."""
    slopes = jacobian(poses.residuals, ends, poses.residuals(ends))
    normal = np.einsum("mrp,mrq->mpq", slopes, slopes)
    widest = np.array([_WIDEST.get(name, 0.5 * poses.skin.thickness_mm) for name in poses.names])
    return np.linalg.inv(normal + np.diag(widest**-2.0))


def _along(poses: Poses, values: FloatArray, at: int, scale: float) -> FloatArray:
    """Return covariances (M, P, P) about poses of a ridge (M, P): one across it, of slopes, and its steps along it."""
    along = 0.5 * np.gradient(values, axis=0)
    slopes = np.delete(jacobian(poses.residuals, values, poses.residuals(values)), at, axis=2)
    rest = np.delete(np.arange(values.shape[1]), at)
    widest = np.array([_WIDEST.get(poses.names[i], 0.5 * poses.skin.thickness_mm) for i in rest])
    own = np.linalg.inv(np.einsum("mrp,mrq->mpq", slopes, slopes) + np.diag(widest**-2.0)) * scale
    covariances = along[:, :, None] * along[:, None, :]
    covariances[:, rest[:, None], rest] += own
    return np.asarray(covariances)


def _wrapped(poses: Poses, values: FloatArray, best: FloatArray) -> FloatArray:
    """Return parameters (N, P) with turns as near to the best one's as turns that are alike allow."""
    if (at := poses.column("turn_rad")) is None:
        return values
    values, period = values.copy(), TURNS[poses.solid.kind]
    values[:, at] = best[at] + np.remainder(values[:, at] - best[at] + 0.5 * period, period) - 0.5 * period
    return values
