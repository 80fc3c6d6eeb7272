"""Outlines drawn from the posterior of one run of strips, and how they overlap."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.core.binding import END_ENTRIES, MAX_VERTICES
from tacstrip.core.ellipse import Ellipse
from tacstrip.core.model_selection import per_vertex_penalty
from tacstrip.core.outline_model import OutlineModel
from tacstrip.core.polygon_fit import PolygonFit, refine
from tacstrip.core.posterior import (
    HEAT,
    OutlinePrior,
    Samples,
    chains,
    outline_ends,
    outline_record,
    sample_outlines,
    vertex_counts,
    vertex_log_prior,
)
from tacstrip.core.problem import FitProblem
from tacstrip.geometry.metrics import column_iou
from tacstrip.geometry.outline import Outline, uncrossed
from tacstrip.reconstruction.polygon.run import RunFit
from tacstrip.sensor.spec import Sensor

_COLUMNS = 64  # that overlaps are computed on
# How often ends are pointed, upright left, upright right, both; and upright where the sensor ends.
_ENDS, _AT_BORDER = (0.65, 0.10, 0.10, 0.15), 0.8
_REFLEX = math.log(0.02)  # of a corner that turns inwards, with two signatures
_CEILING = 0.02 / math.sqrt(3.0)  # of sigma that is not known [Vref]
_NO_ELLIPSE = -12.0  # of the criterion: an ellipse that is so much worse does not count
_CLIPPED = 4  # corners that come with cutting an outline at the strips' ends
_SETTLED = 0.9  # IoU with the draw that the least-squares outline near it must have
_OPENED = 0.1  # how far pointed ends are opened along the family of outlines that read alike
_END_KINDS = ((0, 0), (0, 1), (1, 0), (1, 1))  # which ends are upright
_HEAT_OF_ONE = (1.0, 2.0, 4.0)  # with one signature: outlines that explain it lie close to each other
_BETWEEN = 0.05  # how often counts beside the known one are met
_AWAY = 1e-9  # from half a pitch beyond the strips touched: nearer, the sensor ends
_INSIDE = 0.98  # of its window: where an end begins


@dataclass(frozen=True, eq=False)
class Draws:
    """Outlines, as often as readings and prior make them likely.

    Attributes
    ----------
    problem
        What x and y are in units of.
    x
        Middles of columns (G,).
    ends
        l and u there (K, 2, G), within the sensor; both 0 outside the outline.
    weight
        Of each outline (K,), 1 in all.
    samples, ellipses
        Polygons, and after them ellipses.
    window
        Between which x the left end may lie, and the right one (4,).
    """

    problem: FitProblem
    x: FloatArray
    ends: FloatArray
    weight: FloatArray
    samples: Samples
    ellipses: tuple[Ellipse, ...] = ()
    window: tuple[float, float, float, float] = (0.0, 0.0, 1.0, 1.0)

    @property
    def at_border(self) -> bool:
        """Whether an end is nearer to the sensor's first or last strip than to where the next one would be."""
        half = 0.5 * self.problem.pitch
        return self.window[0] > _AWAY - half or self.window[3] < 1.0 + half - _AWAY

    @property
    def misfit(self) -> float:
        """Squared residuals over sigma^2 that the best polygon leaves, a reading: about 1 where noise explains them."""
        return float(self.samples.squares.min()) / self.problem.readings

    def share(self, which: BoolArray) -> float:
        """Return the weight of some outlines (K,); rounding takes that of all beyond 1."""
        return min(float(which @ self.weight), 1.0)

    def ends_of(self, lower: FloatArray, upper: FloatArray) -> FloatArray:
        """Return l and u (2, G) in the columns, of chains [mm]."""
        return column_ends(self.problem, self.x, lower, upper)

    def outline(self, k: int) -> Outline:
        """Return one outline [mm], without what lies beyond the sensor."""
        polygons, problem = len(self.samples.outlines), self.problem
        if k >= polygons:
            return Outline(*self.ellipses[k - polygons].chains_mm(problem))
        scale, origin = np.array([problem.width_mm, problem.length_mm]), np.array([problem.origin_mm, 0.0])
        lower, upper = (within_strips(c) * scale + origin for c in chains(self.samples.outlines[k]))
        return Outline(*uncrossed(lower, upper))

    def model(self, k: int, problem: FitProblem) -> OutlineModel:
        """Return one outline as a model of all readings; of ellipses the best one."""
        if k >= len(self.samples.outlines):
            return self.ellipses[0]
        drawn = PolygonFit.of(self.outline(k), problem)
        settled = refine(drawn, problem)  # a draw is as far from the mean as the truth is: go there
        lower, upper = settled.chains
        if np.abs(settled.theta[[0, 3]] - (0.0, 1.0)).max() > 0.5 * problem.pitch:
            return drawn
        if any((np.diff(c[:, 0]) <= 0.0).any() for c in (lower, upper)):
            return drawn
        ends = self.ends_of(*settled.chains_mm(problem))
        return settled if column_iou(ends, self.ends[k]) > _SETTLED else drawn

    def fitting(self, known_count: int | None) -> BoolArray:
        """Return which outlines (K,) a fit can have: of few corners, or of as many as are known.

        Those that strips' ends cut have more corners, and count only where there are no others.
        """
        if known_count is not None:
            outlines = self.samples.outlines
            fits = np.asarray(vertex_counts(outlines) == known_count)
            corner = np.arange(outlines["y"].shape[2]) < outlines["count"][..., None]
            beyond = corner & ((outlines["y"] < 0.0) | (outlines["y"] > 1.0))
            whole = fits & ~beyond.any(axis=(1, 2))
            return whole if whole.any() else fits
        few = self.samples.outlines["count"].sum(axis=1) - 4 <= MAX_VERTICES - _CLIPPED
        return np.concatenate([few, np.ones(len(self.ellipses), dtype=bool)])

    def overlap(self, ends: FloatArray) -> FloatArray:
        """Return intersection over union (K,) of the outlines with l and u (2, G)."""
        return column_iou(self.ends, ends)


def columns(problem: FitProblem) -> FloatArray:
    """Return the middles (G,) of columns from where the left end may lie to where the right end may."""
    half = 0.5 * problem.pitch
    return np.linspace(-half, 1.0 + half, 2 * _COLUMNS + 1)[1::2]


def column_ends(problem: FitProblem, x: FloatArray, lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Return l and u (..., 2, G) over the strip length at x (G,) of chains (..., M, 2) [mm]; both 0 outside."""
    at = x * problem.width_mm + problem.origin_mm
    inside = (at >= lower[..., :1, 0]) & (at <= lower[..., -1:, 0])
    ends = np.stack([_heights(at, chain) for chain in (lower, upper)], axis=-2) / problem.length_mm
    return np.where(inside[..., None, :], np.clip(ends, 0.0, 1.0), 0.0)


def _heights(at: FloatArray, chain: FloatArray) -> FloatArray:
    """Return y (..., G) at x = `at` (G,) of chains (..., M, 2), all at once: `np.interp` takes one."""
    x, y = chain[..., 0], chain[..., 1]
    edge = (at[:, None] >= x[..., None, 1:-1]).sum(axis=-1)
    (x0, x1), (y0, y1) = ([np.take_along_axis(v, edge + i, axis=-1) for i in (0, 1)] for v in (x, y))
    run = x1 - x0
    return np.asarray(y0 + (y1 - y0) * (at - x0) / np.where(run == 0.0, 1.0, run))


def within_strips(chain: FloatArray) -> FloatArray:
    """Return a chain (M, 2) held to y from 0 to 1, with points where it passes."""
    x, y = chain.T
    cut = [x]
    for level in (0.0, 1.0):
        a, b = y[:-1] - level, y[1:] - level
        at = np.flatnonzero(a * b < 0.0)
        cut.append(x[at] + (x[at + 1] - x[at]) * a[at] / (a[at] - b[at]))
    at_x = np.unique(np.concatenate(cut))
    return np.stack([at_x, np.clip(np.interp(at_x, x, y), 0.0, 1.0)], axis=1)


def draw(
    run: RunFit,
    sensor: Sensor,
    sigma_known: bool,
    evaluations: int,
    kept: int,
    area_mm2: tuple[float, float] | None = None,
    known_count: int | None = None,
    seed: int = 0,
) -> Draws | None:
    """Draw outlines that explain a run's readings; None without a compiled core.

    Parameters
    ----------
    run, sensor
        A fit, of what.
    sigma_known
        Whether the run's sigma was given, or estimated.
    evaluations
        Outlines that are tried.
    kept
        Outlines to return.
    area_mm2
        Mean and standard deviation of the contact's area, where that is known.
    known_count
        Its vertices, where that is known: only outlines of so many have a weight, if there are any.
    seed
        0 or more.
    """
    problem = run.problem.thinned()
    prior = _prior(run, sensor, problem, sigma_known, area_mm2)
    if known_count is not None:
        prior = replace(prior, vertices=vertex_log_prior(_about(known_count)))
    heat = _HEAT_OF_ONE if len(problem.k) == 1 else HEAT
    starts = _starts(run, problem, prior)
    samples = sample_outlines(problem, prior, starts, evaluations // len(heat), kept, seed, heat)
    if samples is None:
        return None
    x = columns(problem)
    ends = outline_ends(samples.outlines, x)
    there = np.ones(len(ends), dtype=bool)
    if known_count is not None:
        there = vertex_counts(samples.outlines) == known_count
        there |= not there.any()
    weight = there / there.sum()
    ellipses = () if known_count is not None else _ellipses(run, kept // 4, seed)
    if ellipses:
        share = 1.0 / (1.0 + math.exp(min(-0.5 * run.ellipse_advantage, 700.0)))
        round_ends = np.stack([column_ends(problem, x, *one.chains_mm(problem)) for one in ellipses])
        ends = np.concatenate([ends, round_ends])
        weight = np.concatenate([(1.0 - share) * weight, np.full(len(ellipses), share / len(ellipses))])
    return Draws(problem, x, ends, weight, samples, ellipses, prior.window)


def _about(count: int) -> dict[int, float]:
    """Return how often counts are met where one is known: those beside it are only ways from one outline to another."""
    return {count - 1: _BETWEEN, count: 1.0, count + 1: _BETWEEN}


def _ellipses(run: RunFit, count: int, seed: int) -> tuple[Ellipse, ...]:
    """Return ellipses as likely as the readings make them; none where they do not matter."""
    if run.ellipse is None or run.ellipse_advantage < _NO_ELLIPSE:
        return ()
    random, p = np.random.default_rng(seed), run.ellipse.parameters
    value, vector = np.linalg.eigh(run.ellipse.information)
    off = random.normal(size=(count, 5)) / np.sqrt(np.maximum(value, 1.0)) @ vector.T
    off[0] = 0.0
    found = p + off
    found[:, 4] = np.clip(found[:, 4], 0.0, 0.5)
    return tuple(replace(run.ellipse, parameters=row) for row in found)


def _prior(
    run: RunFit, sensor: Sensor, problem: FitProblem, sigma_known: bool, area_mm2: tuple[float, float] | None
) -> OutlinePrior:
    half = 0.5 * run.problem.pitch
    first, last = ((x - problem.origin_mm) / problem.width_mm for x in (0.0, sensor.width_mm))
    window = (max(-half, first), half, 1.0 - half, min(1.0 + half, last))
    share = np.array(_ENDS).reshape(2, 2)  # by the right end, by the left one
    if window[0] > _AWAY - half:
        share = share.sum(axis=1, keepdims=True) * (1.0 - _AT_BORDER, _AT_BORDER)
    if window[3] < 1.0 + half - _AWAY:
        share = share.sum(axis=0, keepdims=True) * [[1.0 - _AT_BORDER], [_AT_BORDER]]
    ends = np.log(share).ravel().tolist()
    low = max(sensor.adc_step / math.sqrt(12.0), 1e-5)
    sigma = (1.0, 1.0) if sigma_known else (low / run.sigma, max(_CEILING, 2.0 * low) / run.sigma)
    unit = problem.width_mm * problem.length_mm
    area = (0.0, 0.0) if area_mm2 is None else (area_mm2[0] / unit, area_mm2[1] / unit)
    reflex = -math.inf if len(problem.k) == 1 else _REFLEX
    return OutlinePrior(window, (ends[0], ends[1], ends[2], ends[3]), reflex, sigma, *area)


def _starts(run: RunFit, problem: FitProblem, prior: OutlinePrior) -> list[npt.NDArray[np.void]]:
    """Return outlines that the prior allows, the best first, no two of the same kind of ends while there are others."""
    if run.selection is None:
        return [_about_readings(problem, prior)]
    price = per_vertex_penalty(problem.readings)
    found: list[tuple[float, tuple[int, int], npt.NDArray[np.void]]] = []
    for fit in run.selection.fits:
        for ends in _END_KINDS if len(problem.k) == 1 else (None,):
            one = fit if ends is None else _with_ends(fit, ends, problem)
            start = _allowed(*one.chains, prior, problem)
            if start is not None:
                kind = (int(one.vertical_ends[0]), int(one.vertical_ends[1]))
                odds = 2.0 * (prior.ends[kind[0] + 2 * kind[1]] - prior.ends[0])
                found.append(
                    (one.cost + price * one.n_interior + 0.5 * price * sum(kind) - odds, kind, start)
                )
    if not found:
        return [_about_readings(problem, prior)]
    found.sort(key=lambda s: s[0])
    first = [next(s for s in found if s[1] == kind) for kind in dict.fromkeys(s[1] for s in found)]
    return [s[2] for s in (*first, *(s for s in found if s not in first))]


def _with_ends(fit: PolygonFit, ends: tuple[int, int], problem: FitProblem) -> PolygonFit:
    """Return the least-squares fit with upright ends that begins where the readings are those of `fit`."""
    if not any(ends):
        return refine(fit, problem)
    theta = fit.theta.copy()
    upper = np.concatenate([[False, False, True, False, False, True], np.repeat(fit.chain == 1, 2)])
    heights = np.ones(len(theta), dtype=bool)
    heights[[0, 3]] = heights[END_ENTRIES::2] = False
    share, narrow = float(problem.shares[0]), problem.narrow
    theta[heights & ~upper] -= _OPENED * (share / narrow + theta[heights & ~upper])
    theta[heights & upper] += _OPENED * ((1.0 - share) / narrow - theta[heights & upper])
    for end, up in enumerate(ends):
        if not up:
            theta[3 * end + 1 : 3 * end + 3] = theta[3 * end + 1 : 3 * end + 3].mean()
    return refine(PolygonFit(theta, fit.chain, np.array(ends, dtype=np.int64), np.inf), problem)


def _allowed(
    lower: FloatArray, upper: FloatArray, prior: OutlinePrior, problem: FitProblem
) -> npt.NDArray[np.void] | None:
    """Return chains as a start, moved into the prior's windows and made convex; None where nothing is left."""
    left = float(np.clip(lower[0, 0], *_middle(prior.window[:2])))
    right = float(np.clip(lower[-1, 0], *_middle(prior.window[2:])))
    made = []
    for chain, side in ((lower, 1.0), (upper, -1.0)):
        inner = chain[1:-1][(chain[1:-1, 0] > left + 1e-6) & (chain[1:-1, 0] < right - 1e-6)]
        inner = inner[np.diff(inner[:, 0], prepend=-1.0) > 1e-6]
        points = np.concatenate([[(left, chain[0, 1])], inner, [(right, chain[-1, 1])]])
        points[:, 1] = np.clip(points[:, 1], -0.05, 1.05)
        made.append(_convex(points, side) if prior.reflex == -math.inf else points)
    for end in (0, -1):
        if made[1][end, 1] < made[0][end, 1]:
            made[1][end, 1] = made[0][end, 1] = 0.5 * (made[1][end, 1] + made[0][end, 1])
    few = len(made[0]) + len(made[1]) == 4 and all(made[0][end, 1] == made[1][end, 1] for end in (0, -1))
    x = np.unique(np.concatenate([made[0][:, 0], made[1][:, 0], problem.x]))
    room = np.interp(x, *made[1].T) - np.interp(x, *made[0].T)
    if few or room.min() < -1e-12 or max(map(len, made)) > 15:
        return None
    return outline_record(made[0], made[1])


def _middle(window: tuple[float, ...]) -> tuple[float, float]:
    centre, half = 0.5 * (window[0] + window[1]), 0.5 * (window[1] - window[0])
    return centre - _INSIDE * half, centre + _INSIDE * half


def _convex(points: FloatArray, side: float) -> FloatArray:
    """Return the lower (side 1) or upper (-1) hull of points ascending in x."""
    kept: list[FloatArray] = []
    for p in points:
        while len(kept) > 1:
            (ax, ay), (bx, by) = kept[-1] - kept[-2], p - kept[-2]
            if side * (ax * by - ay * bx) > 0.0:
                break
            kept.pop()
        kept.append(p)
    return np.array(kept)


def _about_readings(problem: FitProblem, prior: OutlinePrior) -> npt.NDArray[np.void]:
    """Return a thin outline with upright ends along the readings."""
    (left, right), k = (sum(prior.window[i : i + 2]) / 2.0 for i in (0, 2)), np.clip(problem.k[0], 0.02, 0.98)
    lower = np.array([(left, k[0] - 0.01), (right, k[-1] - 0.01)])
    return outline_record(lower, lower + np.array([0.0, 0.02]))
