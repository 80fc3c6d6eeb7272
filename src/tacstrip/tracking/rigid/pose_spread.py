"""How far a scan's pose may be off: the spread of all poses that explain its readings.

The bound at the best pose is that of straight lines through it. Strips read an outline at few places: beside a kink,
where a corner passes a strip, the cost may hardly rise over millimetres, and noise decides at which side of it, or
where between two strips, the best pose lies.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.core.rigid import LEAST, RigidScans, fit_poses, loss
from tacstrip.tracking.rigid.corners import Fit
from tacstrip.tracking.rigid.covariance import FREE, information
from tacstrip.tracking.rigid.search import FEW_STRIPS

_BLOCK = 256  # scans that are sampled at a time
_BESIDE, _BESIDE_TURNED = 0.2, 0.3  # pitches, along an axis and of the outline's corners: poses at no kink
_DRAWS = 192  # poses of a scan that are drawn in a round
_LEAST_FEW, _LEAST, _MOST = 2, 1, 6  # rounds, at least of few strips and of others, and at most
_ENOUGH, _FEWEST = 100.0, 24.0  # effective draws that end a scan's rounds, and that the next is drawn by
_TAIL, _WIDER = 4.0, 1.5  # degrees of freedom of what is drawn from; times the covariance known so far
_EVENED, _EVENINGS = 0.6, 9  # exponent of weights of which too few count, and how often it is taken
NO_LESS_MM2 = 1e-10  # of a covariance that is drawn from: exact readings leave hardly any


@dataclass
class _Draws:
    """Poses of T scans that were drawn, off the fit's.

    Attributes
    ----------
    off
        Of each from the fit's pose (T, M, 3).
    costs, density
        What it costs, and of how many draws the like was expected (T, M), up to a factor.
    drawn_from
        Of each round: mean (T, 3), inverse root of the covariance (T, 3, 3) and density at the mean (T,).
    """

    off: FloatArray
    costs: FloatArray
    density: FloatArray
    drawn_from: list[tuple[FloatArray, FloatArray, FloatArray]]

    def of(self, some: BoolArray) -> _Draws:
        """Return those of some of the scans."""
        rounds = [(mean[some], root[some], peak[some]) for mean, root, peak in self.drawn_from]
        return _Draws(self.off[some], self.costs[some], self.density[some], rounds)

    def log_weights(self) -> FloatArray:
        """Return how likely the readings make each (T, M), over how often it was drawn: all rounds as one mixture."""
        found = -0.5 * self.costs - np.log(self.density)
        return np.asarray(found - found.max(axis=1, keepdims=True))


def beyond_the_bound(scans: RigidScans, fit: Fit) -> FloatArray:
    """Return what all poses that explain a scan add to its pose's bound at the fit (T, 3, 3), were the outline known.

    That is mean squares about the fit's pose, by adaptive importance sampling (Cornuet, Marin, Mira and Robert 2012:
    Adaptive Multiple Importance Sampling).
    """
    every = np.arange(len(fit.poses))
    some = [every[i : i + _BLOCK] for i in range(0, len(every), _BLOCK)]
    return np.concatenate([_beyond_the_bound(scans.of(own), fit.of(own)) for own in some])


def _beyond_the_bound(scans: RigidScans, fit: Fit) -> FloatArray:
    random, total = np.random.default_rng(0), len(fit.poses)
    bound, covariance = bounds_beside(scans, fit)
    mean, squares, left = np.zeros((total, 3)), np.zeros((total, 3, 3)), np.arange(total)
    least = _LEAST_FEW if scans.strips_touched < FEW_STRIPS else _LEAST
    empty = np.empty((total, 0))
    draws = _Draws(np.empty((total, 0, 3)), empty, empty, [])
    for count in range(1, _MOST + 1):
        chi_square = random.chisquare(_TAIL, size=(_DRAWS // 2, 1))
        student = random.normal(size=(_DRAWS // 2, 3)) * np.sqrt(_TAIL / chi_square)
        part = Fit(fit.corners, fit.poses[left], fit.costs[left])
        draws = _with_more(draws, scans.of(left), part, mean, covariance, np.concatenate([student, -student]))
        logarithms = draws.log_weights()
        weights, effective = _weights(logarithms)
        mean, covariance = _moments(draws.off, weights)
        squares[left] = covariance + mean[:, :, None] * mean[:, None]
        again = (effective < _ENOUGH) | (count < least)
        if not again.any():
            break
        draws, left, logarithms = draws.of(again), left[again], logarithms[again]
        for _ in range(_EVENINGS):
            weights, effective = _weights(logarithms)
            if not (few := effective < _FEWEST).any():
                break
            logarithms[few] *= _EVENED
        mean, covariance = _moments(draws.off, weights)
    value, vector = np.linalg.eigh(squares - bound)  # a region is no smaller for what else may be
    return np.asarray((vector * np.maximum(value, 0.0)[:, None]) @ vector.transpose(0, 2, 1))


def bounds_beside(scans: RigidScans, fit: Fit) -> tuple[FloatArray, FloatArray]:
    """Return the bound at the fit's poses, the outline known, and the mean of those beside them (T, 3, 3).

    At a kink the fit's own may be much narrower than what is likely.
    """
    radius = float(np.hypot(*(fit.corners - fit.corners.mean(axis=0)).T).max())
    axes = scans.sensor.pitch_mm * np.diag([_BESIDE, _BESIDE, _BESIDE_TURNED / radius])
    poses = fit.poses[:, None] + np.vstack([np.zeros(3), axes, -axes])
    total, count = poses.shape[:2]
    again = scans.of(np.repeat(np.arange(total), count))
    known = information(again, fit.corners, poses.reshape(-1, 3)).pose.reshape(total, count, 3, 3)
    known = known + np.diag(FREE * np.array([1.0, 1.0, 0.0]) / scans.sensor.pitch_mm**2) + LEAST * np.eye(3)
    bounds = np.asarray(np.linalg.inv(known), dtype=np.float64)
    return bounds[:, 0], np.asarray(bounds.mean(axis=1))


def _with_more(
    draws: _Draws, scans: RigidScans, fit: Fit, mean: FloatArray, covariance: FloatArray, student: FloatArray
) -> _Draws:
    """Return the draws with as many more as of Student's distribution (M, 3), moved and stretched to a mean."""
    root = np.linalg.cholesky(_WIDER * covariance + NO_LESS_MM2 * np.eye(3))
    peak = 1.0 / np.diagonal(root, axis1=1, axis2=2).prod(axis=1)
    new = mean[:, None] + student @ root.transpose(0, 2, 1)
    costs = fit_poses(scans, fit.corners, fit.poses[:, None] + new, loss(scans), 0)[1]
    rounds = [*draws.drawn_from, (mean, np.linalg.inv(root), peak)]
    before = draws.density + _density(draws.off, *rounds[-1])
    density = np.concatenate([before, sum(_density(new, *one) for one in rounds)], axis=1)
    return _Draws(
        np.concatenate([draws.off, new], axis=1),
        np.concatenate([draws.costs, costs], axis=1),
        density,
        rounds,
    )


def _density(off: FloatArray, mean: FloatArray, inverse_root: FloatArray, peak: FloatArray) -> FloatArray:
    """Return Student's density (T, M), up to a factor, of poses (T, M, 3)."""
    squared = (((off - mean[:, None]) @ inverse_root.transpose(0, 2, 1)) ** 2).sum(axis=2)
    return np.asarray(peak[:, None] * (1.0 + squared / _TAIL) ** (-0.5 * (_TAIL + 3.0)))


def _weights(logarithms: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return weights (T, M), their sum 1, and how many draws they are worth (T,)."""
    weights = np.exp(logarithms)
    weights /= weights.sum(axis=1, keepdims=True)
    return weights, 1.0 / (weights**2).sum(axis=1)


def _moments(off: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the mean (T, 3) and covariance (T, 3, 3) of poses (T, M, 3)."""
    mean = np.einsum("tm,tmi->ti", weights, off)
    apart = off - mean[:, None]
    return mean, np.asarray((apart * weights[..., None]).transpose(0, 2, 1) @ apart)
