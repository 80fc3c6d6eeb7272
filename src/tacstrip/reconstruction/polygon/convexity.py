"""Is a contact that both signatures tell one convex object? Convex l and u nearest to the readings."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.core.convex_chain import convex_regression
from tacstrip.core.polygon_fit import PolygonFit
from tacstrip.core.problem import FitProblem
from tacstrip.geometry.metrics import column_iou
from tacstrip.geometry.outline import Outline
from tacstrip.reconstruction.contact_ends import closed_ends
from tacstrip.reconstruction.pieces.run import noise_level
from tacstrip.reconstruction.polygon.chi_square import squares_score
from tacstrip.reconstruction.polygon.run import MOST_SIGMA, RunFit
from tacstrip.sensor.spec import Sensor

_POINTS = 60  # at most, that the regression sees: a mean of a convex function's neighbours is convex too
_ROUNDS = 3  # of l with u as it is, and u with l
_HELD = 1e4  # times the largest weight: of an end where l and u meet
_NEARLY = 0.9  # IoU with ends that explain the readings
NEAR_ENOUGH = 0.006  # of Vref: the deviation of 1 % noise, as rubber has it
_ALARM = 3.09  # deviations of chi square: p = .001


@dataclass(frozen=True, eq=False)
class ConvexFit:
    """The convex l and the concave u that explain both signatures best.

    Attributes
    ----------
    x, ends
        Places (n,), and l and u there (2, n), in units of the problem.
    chi_square, freedom
        Squared residuals over sigma^2, and their degrees of freedom.
    """

    x: FloatArray
    ends: FloatArray
    chi_square: float
    freedom: int

    @property
    def explains(self) -> bool:
        """Whether noise explains what it leaves over of the readings."""
        return squares_score(self.chi_square, self.freedom) <= _ALARM


def fit_convex(problem: FitProblem, l: FloatArray, u: FloatArray) -> ConvexFit:
    """Fit a convex l and a concave u, whatever their kinks, by least squares.

    Parameters
    ----------
    problem
        Readings and weights of two signatures.
    l, u
        A fit (n,), in units of the problem, near which readings are taken for linear.
    """
    by_l, by_u, k = problem.jacobian(l, u)
    jacobian = np.stack([by_l, by_u], axis=-1)  # (S, n, 2)
    weighted = problem.weight[..., None] * jacobian
    matrix = np.einsum("sni,snj->nij", weighted, jacobian)
    slope = np.einsum("sni,sn->ni", weighted, problem.k - k)
    cuts = np.linspace(0, len(l), min(len(l), _POINTS) + 1).round().astype(int)[1:-1]
    groups = np.split(np.arange(len(l)), cuts)
    x = np.array([problem.x[g].mean() for g in groups])
    m = np.stack([matrix[g].sum(axis=0) for g in groups])
    near = np.stack([l, u], axis=1)
    total = np.stack([(slope[g] + np.einsum("nij,nj->ni", matrix[g], near[g])).sum(axis=0) for g in groups])
    # Where a strip has one reading, or none, l and u stay near in what it does not tell.
    z = np.array([near[g].mean(axis=0) for g in groups])
    told = total - np.einsum("nij,nj->ni", m, z)
    z += np.einsum("nij,nj->ni", np.linalg.pinv(m, rcond=1e-10, hermitian=True), told)
    found, kinks = z.copy(), [0, 0]
    meets: dict[int, float] = {}
    for _ in range(3):  # with ends free, with one where they meet, with both
        for _ in range(_ROUNDS):
            for c, sign in ((0, 1.0), (1, -1.0)):
                own = np.maximum(m[:, c, c], np.finfo(float).tiny)
                target = z[:, c] - m[:, c, 1 - c] / own * (found[:, 1 - c] - z[:, 1 - c])
                for end, y in meets.items():
                    target[end], own[end] = y, _HELD * own.max()
                found[:, c], kinks[c] = convex_regression(x, target, own, sign)
        # u - l is concave: where it is below 0 it is so at an end, and the contact is pointed there.
        crossed = [end for end in (0, -1) if end not in meets and found[end, 0] > found[end, 1]]
        if not crossed:
            break
        for end in crossed:
            meets[end] = float((m[end] @ z[end]).sum() / max(m[end].sum(), np.finfo(float).tiny))
    off = found - z
    chi = max(float(np.einsum("ni,nij,nj->", off, m, off)), 0.0)  # rounding may leave it below
    measured = sum(int((problem.weight[:, g] > 0.0).any(axis=1).sum()) for g in groups)
    return ConvexFit(x, found.T, chi, max(measured - sum(kinks) - 4, 1))


@dataclass(frozen=True, eq=False)
class OneConvex:
    """One convex object that explains the readings of both signatures of a run.

    Attributes
    ----------
    run
        Of all readings but those of a faulty channel, also of what a polygon left out; without an ellipse, which was
        compared with that polygon.
    ends
        Convex l and u on its strips.
    """

    run: RunFit
    ends: ConvexFit

    def like(self, outline: Outline, sensor: Sensor) -> bool:
        """Whether an outline hardly differs from these ends on the strips."""
        return like(outline, self.ends, self.run, sensor)


def explained_by_convex(
    run: RunFit,
    distribution: str | None,
    outline: Outline,
    sensor: Sensor,
    readings: Mapping[str, FloatArray],
    faulty: BoolArray,
) -> OneConvex | None:
    """Return the convex l and u that explain all readings, also those left out; None where noise does not allow any.

    What a corner or a curve between few strips reads passes for an outlier, for a polygon of as many corners as so few
    readings tell. It is none, nor a second object's, where it is convex with all others. Arguments as of `second_look`,
    and which readings (2, n) are not asked, as a faulty channel's.
    """
    if len(run.problem.k) == 1 or run.selection is None:
        return None
    sigma = deviation(run, distribution, sensor, readings)
    nearest = nearest_convex(run, sensor, readings, faulty, sigma, outline)
    if nearest is None:
        return None
    problem, found = nearest
    # Of two objects both an estimate and what convex ends leave over are large. Where the polygon itself is off by more
    # than noise, as of curves on few strips, these ends must be so near that no noise need be made up for them.
    most = MOST_SIGMA if run.sigma < MOST_SIGMA else NEAR_ENOUGH
    if distribution is None and found.chi_square * sigma**2 > most**2 * found.freedom:
        return None
    if not found.explains:
        return None
    whole = replace(
        run, problem=problem, sigma=sigma, excluded=faulty, ellipse=None, ellipse_advantage=-np.inf
    )
    return OneConvex(whole, found)


def nearest_convex(
    run: RunFit,
    sensor: Sensor,
    readings: Mapping[str, FloatArray],
    faulty: BoolArray,
    sigma: float,
    outline: Outline | None = None,
) -> tuple[FitProblem, ConvexFit] | None:
    """Return the convex l and u nearest to both signatures without `faulty` readings (2, n), and what they solve.

    `sigma` is a reading's deviation [Vref]. Where a strip has one reading its ends are about those of `outline`, or of
    the strips beside it. None where a strip has neither.
    """
    k, x = np.where(faulty, np.nan, np.stack([readings["kh"], readings["kl"]])), run.problem.x
    read = np.isfinite(k)
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.stack(closed_ends(sensor, *k)) / sensor.length_mm
    one = read.any(axis=0) & ~read.all(axis=0)  # there an end's place is the other's, too
    if outline is not None:
        ends[:, one] = _on_strips(outline, run, sensor, x[one])
    elif not one.all():
        ends[:, one] = [np.interp(x[one], x[~one], end[~one]) for end in ends]
    if not np.isfinite(ends).all():
        return None
    problem = replace(run.problem, k=np.where(read, k, 0.0), weight=np.where(read, 1.0 / sigma**2, 0.0))
    found = fit_convex(problem, *ends)
    if one.any() and len(found.x) == len(x):  # once more, nearer to where these are
        ends[:, one] = found.ends[:, one]
        found = fit_convex(problem, *ends)
    return problem, found


def deviation(
    run: RunFit, distribution: str | None, sensor: Sensor, readings: Mapping[str, FloatArray]
) -> float:
    """Return the readings' deviation: as given, or as the fit has it, but no more than neighbours differ by."""
    return run.sigma if distribution is not None else min(run.sigma, scatter(sensor, readings))


def scatter(sensor: Sensor, readings: Mapping[str, FloatArray]) -> float:
    """Return the deviation [Vref] that neighbouring strips' second differences show."""
    return noise_level(np.stack([readings["kh"], readings["kl"]]), sensor)


def like(outline: Outline, convex: ConvexFit, run: RunFit, sensor: Sensor) -> bool:
    """Whether an outline hardly differs from convex ends on the strips."""
    own = _on_strips(outline, run, sensor, convex.x)
    return nearly(own, convex.ends)


def nearly(own: FloatArray, ends: FloatArray) -> bool:
    """Whether an outline's l and u (2, n) hardly differ from ends that explain the readings."""
    return float(column_iou(own, np.sort(ends, axis=0))) >= _NEARLY


def _on_strips(outline: Outline, run: RunFit, sensor: Sensor, x: FloatArray) -> FloatArray:
    """Return l and u (2, n) of an outline at x (n,), all in units of the run's problem."""
    in_mm = x * run.problem.width_mm + run.problem.origin_mm
    return np.stack(
        [np.interp(in_mm, *chain.T) / sensor.length_mm for chain in (outline.lower, outline.upper)]
    )


def inward_corners(fit: PolygonFit) -> tuple[list[float], list[float]]:
    """Return x of the corners of l, and of u, that turn inwards, in units of the problem."""
    found: tuple[list[float], list[float]] = ([], [])
    for sign, chain, at in zip((1.0, -1.0), fit.chains, found, strict=True):
        points = chain.tolist()
        slopes = [sign * _slope(x1 - x0, y1 - y0) for (x0, y0), (x1, y1) in pairwise(points)]
        at += [points[i + 1][0] for i, (before, after) in enumerate(pairwise(slopes)) if after < before]
    return found


def _slope(run: float, rise: float) -> float:
    return rise / run if run else math.copysign(math.inf, rise) if rise else math.nan
