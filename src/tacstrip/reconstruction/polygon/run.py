"""One run of touched strips: its noise, its outliers, its polygon."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.core.binding import MAX_VERTICES, RUN, SIZE, RunTask, at, exported, search_workspace
from tacstrip.core.ellipse import Ellipse, fit_ellipse
from tacstrip.core.model_selection import complexity_penalty, deviance, per_vertex_penalty
from tacstrip.core.outliers import isolated_outliers, spikes
from tacstrip.core.outline_model import OutlineModel
from tacstrip.core.polygon_fit import FoundPolygons
from tacstrip.core.problem import FLOOR, FitProblem
from tacstrip.core.search import ModelSelection, fit_counts
from tacstrip.core.swept_area import DRAWS, draws_by_size
from tacstrip.geometry.outline import Outline, max_height
from tacstrip.reconstruction.sections import reading_noise
from tacstrip.robust import robust_sigma
from tacstrip.sensor.spec import Sensor

CHECKS = 6  # readings beyond the numbers fitted: with fewer little can be tested
MOST_SIGMA = 0.02  # of Vref: no noise that is not given is larger
_BEYOND = 0.5  # a reading that noise may drive so far beyond 0 or 1 is still one
_ROUNDS = 3  # of leaving outliers out, and of estimating sigma anew
_SURER = 0.3  # so much less noise than first thought is worth another fit
_NEAR = 6.0  # spreads from the polygon that was made without it: no outlier
_BARELY = 0.5  # of the spread with all readings: few residuals can be small by chance
_ALONE = 8  # suspects at most that are left out one by one
_LEAST_SCALE = 1e-3  # of sigma: a spread of residuals
_BARE = 4  # readings that an outline without corners between its ends determines
_SPARE = 1  # readings beyond the numbers fitted, without which nothing can be tested


@dataclass(frozen=True, eq=False)
class ModelInMm:
    """A model in mm, and what the core told of it.

    Attributes
    ----------
    lower, upper
        Chains (M, 2), (N, 2) [mm].
    height
        The greatest distance between them in y [mm].
    covariance
        Of its vertices (2 V, 2 V) [mm^2], None where that was not told.
    swept
        Its `swept_share`, told with the covariance.
    inward
        Whether a corner turns inwards; None where that was not told.
    """

    lower: FloatArray
    upper: FloatArray
    height: float
    covariance: FloatArray | None = None
    swept: float = np.inf
    inward: bool | None = None

    @classmethod
    def of(cls, model: OutlineModel, problem: FitProblem) -> ModelInMm:
        """Return a model's chains and height."""
        lower, upper = model.chains_mm(problem)
        return cls(lower, upper, max_height(lower, upper))


@dataclass(frozen=True, eq=False)
class RunFit:
    """Polygons, and an ellipse, fitted to one run of strips.

    Attributes
    ----------
    problem
        Readings, with weights 1 / sigma^2; sigma is the given one, or estimated from the residuals.
    selection
        The polygons compared, and the chosen one; None where the readings are too few.
    sigma
        Standard deviation of a reading [Vref].
    excluded
        Readings that were there but not used (S, n).
    ellipse
        An ellipse that was fitted too.
    ellipse_advantage
        How much better the ellipse's criterion is than the polygon's; -inf where none was fitted.
    singled_out
        Signature and strip of the one reading without which one convex object explains all others, where there is one.
    """

    problem: FitProblem
    selection: ModelSelection | None
    sigma: float
    excluded: BoolArray
    ellipse: Ellipse | None = None
    ellipse_advantage: float = -np.inf
    singled_out: tuple[int, int] | None = None

    @property
    def model(self) -> OutlineModel | None:
        """The model that explains the readings best; None where they are too few."""
        if self.ellipse is not None and self.ellipse_advantage > 0.0:
            return self.ellipse
        return None if self.selection is None else self.selection.chosen

    @property
    def complexity(self) -> int:
        """Vertices that the criterion counts the model for."""
        return 0 if self.model is None else self.model.complexity

    @property
    def freedom(self) -> int:
        """Degrees of freedom: readings beyond the numbers that they determine."""
        return self.problem.readings - (0 if self.model is None else self.model.n_parameters)

    @property
    def checked(self) -> bool:
        """Whether enough readings are left to tell that those excluded contradict all others.

        One that was singled out has been a check itself.
        """
        return self.freedom >= CHECKS - (self.singled_out is not None)

    @cached_property
    def model_mm(self) -> ModelInMm:
        """The model in mm, where there is one."""
        assert self.model is not None
        return ModelInMm.of(self.model, self.problem)

    @property
    def outline(self) -> Outline | None:
        """The model's outline [mm], if there is one and it is no line."""
        if self.model is None or self.model_mm.height <= 0.0:
            return None
        return Outline(self.model_mm.lower, self.model_mm.upper)

    @cached_property
    def residual_sums(self) -> tuple[float, float]:
        """Those of its residuals."""
        return residual_sums(self.residuals)

    @cached_property
    def residuals(self) -> FloatArray:
        """Measured minus fitted readings over sigma (S, n)."""
        return np.zeros_like(self.problem.k) if self.model is None else self.model.residuals(self.problem)

    def residual_scale(self, sigma_known: bool) -> float:
        """Return the residuals' spread, over the sigma that the problem was given: 1 if that is known."""
        if sigma_known or self.selection is None:
            return 1.0
        used = self.residuals[self.problem.weight > 0.0]
        return max(float(robust_sigma(used)), _LEAST_SCALE) if len(used) else 1.0

    def penalised_cost(self, scale: float) -> float:
        """Return what vertices and readings left out cost, with the deviance at a spread of residuals; inf: no fit.

        A reading left out costs as much as a vertex: a notch one strip wide has at least three, a fault one or two
        readings, and a corner cut off a whole side.
        """
        if self.selection is None:
            return np.inf
        chosen, each = self.selection.chosen, per_vertex_penalty(self.problem.readings)
        paid = chosen.n_interior + int(chosen.vertical_ends.sum()) + int(self.excluded.sum())
        return chosen.cost / scale**2 + each * paid

    @property
    def squares(self) -> float:
        """Squared residuals [Vref^2]."""
        return float((self.residuals**2).sum()) * self.sigma**2


def residual_sums(r: FloatArray) -> tuple[float, float]:
    """Return the sums of residuals' squares (S, n), and of the products of neighbouring ones."""
    return float((r**2).sum()), float((r[:, 1:] * r[:, :-1]).sum())


def fit_run(
    sensor: Sensor,
    x_mm: FloatArray,
    readings: Mapping[str, FloatArray],
    sigma: float | None = None,
    max_vertices: int = MAX_VERTICES,
    n_vertices: int | None = None,
    margin_mm: float = 0.0,
) -> RunFit:
    """Fit polygons to one run of strips.

    Parameters
    ----------
    sensor
        Its pitch, length and closed form.
    x_mm
        Centre lines of neighbouring strips (n,) [mm], ascending.
    readings
        Over Vref, signature to (n,); what is not finite, or far outside 0..1, is left out.
    sigma
        Standard deviation of a reading [Vref]; None: estimated from what the fit leaves over.
    max_vertices
        Interior vertices at most.
    n_vertices
        Vertices in all, where that is known.
    margin_mm
        How much further out the ends lie than within half a pitch of the outer strips.
    """
    task = RunReadings(x_mm, readings, sigma, margin_mm)
    return fit_runs(sensor, [task], max_vertices, n_vertices)[0]


@dataclass(frozen=True, eq=False)
class RunReadings:
    """What one run is fitted to; as for `fit_run`."""

    x_mm: FloatArray
    readings: Mapping[str, FloatArray]
    sigma: float | None
    margin_mm: float = 0.0


def fit_runs(
    sensor: Sensor,
    runs: Sequence[RunReadings],
    max_vertices: int = MAX_VERTICES,
    n_vertices: int | None = None,
) -> list[RunFit]:
    """Fit polygons to many runs in one call of the core, during which other threads run; otherwise as `fit_run`."""
    core = exported("fit_runs")
    if core is None:
        return [
            plain_fit_run(sensor, r.x_mm, r.readings, r.sigma, max_vertices, n_vertices, r.margin_mm)
            for r in runs
        ]
    records, tasks, made = np.empty(len(runs), RUN), (RunTask * len(runs))(), []
    first, longest, x_mm = at(records), 0, sensor.x_mm
    every = at(x_mm), len(x_mm)
    for i, run in enumerate(runs):
        raw = np.array([*run.readings.values()], dtype=np.float64)
        k, weight, residuals = fitted = np.empty((3, *raw.shape))
        excluded, begin, size = np.empty(raw.shape, dtype=np.bool_), at(fitted), raw.nbytes
        problem = FitProblem.of_strips(sensor, run.x_mm, tuple(run.readings), k, weight, run.margin_mm)
        sigma = 0.0 if run.sigma is None else max(run.sigma, FLOOR)
        longest = max(longest, raw.size + 2 * len(raw[0]))
        in_mm = problem.origin_mm, problem.width_mm, problem.length_mm
        places = first + i * RUN.itemsize, begin, begin + size, begin + 2 * size, at(excluded)
        tasks[i] = RunTask(problem.compiled, sigma, in_mm, *every, *places)
        tasks[i].problem.k = at(raw)
        made.append((problem, excluded, residuals, raw))
    normal, _ = draws_by_size()
    workspace = search_workspace(max(2 * longest, (SIZE + 2) * (SIZE + 3 + DRAWS) + DRAWS))
    step = sensor.adc_step / math.sqrt(12.0)
    core(
        ctypes.addressof(tasks), len(runs), step, max_vertices, n_vertices or 0, normal, DRAWS, at(workspace)
    )
    numbers = zip(*(records[name].tolist() for name in _NUMBERS), strict=True)
    return [
        _of_record(problem, records[i], of_run, *rest[:2])
        for i, ((problem, *rest), of_run) in enumerate(zip(made, numbers, strict=True))
    ]


# Of a `RUN`.
_NUMBERS = (
    "count", "best", "equal", "sigma", "advantage", "ellipse_cost",
    "squares", "pairs", "inward", "told", "height", "swept",
)  # fmt: skip


def _of_record(
    problem: FitProblem,
    record: np.void,
    numbers: tuple[Any, ...],
    excluded: BoolArray,
    residuals: FloatArray,
) -> RunFit:
    """Return what the compiled core left in a `RUN`, of which all single numbers are read already."""
    count, best, equal, sigma, advantage, ellipse_cost, squares, pairs, inward, told, height, swept = numbers
    selection, ellipse = None, None
    if count:
        fits = FoundPolygons(record["found"][:count].copy())
        selection = ModelSelection(fits, fits.scores, best, equal)
    if advantage > -np.inf:
        ellipse = Ellipse(record["ellipse"], ellipse_cost, record["information"])
    run = RunFit(problem, selection, sigma, excluded, ellipse, advantage)
    own = run.__dict__  # the cached properties' place
    own["residuals"], own["residual_sums"] = residuals, (squares, pairs)
    if selection is not None and not advantage > 0.0:
        chosen = selection.chosen
        size, low = 2 * chosen.n_vertices, 2 + chosen.n_interior - sum(chosen.chain.tolist())
        points = record["points"][: 2 * chosen.n_interior + 8].copy().reshape(-1, 2)
        covariance = record["covariance"][: size * size].copy().reshape(size, size) if told else None
        own["model_mm"] = ModelInMm(points[:low], points[low:], height, covariance, swept, bool(inward))
    return run


def plain_fit_run(
    sensor: Sensor,
    x_mm: FloatArray,
    readings: Mapping[str, FloatArray],
    sigma: float | None = None,
    max_vertices: int = MAX_VERTICES,
    n_vertices: int | None = None,
    margin_mm: float = 0.0,
) -> RunFit:
    """Do as `fit_run`, step by step."""
    raw = np.stack([np.asarray(values, dtype=np.float64) for values in readings.values()])
    there = (raw >= -_BEYOND) & (raw <= 1.0 + _BEYOND)
    raw = np.where(there, raw, np.nan)
    fitter = _RunFitter(
        sensor, x_mm, tuple(readings), raw, there, sigma is not None, max_vertices, n_vertices, margin_mm
    )
    if sigma is not None:
        return fitter.fit(max(sigma, FLOOR))
    start = max(_initial_sigma(sensor, raw), FLOOR)
    for _ in range(_ROUNDS):
        run = fitter.fit(start)
        if run.sigma > _SURER * start:
            break
        start = run.sigma  # curvature passed for noise, and made what is known of the ends weigh too much
    return run


@dataclass(frozen=True, eq=False)
class _RunFitter:
    """What is fitted, as for `fit_run`: readings (S, n), which are there, and whether their sigma is known."""

    sensor: Sensor
    x_mm: FloatArray
    names: tuple[str, ...]
    raw: FloatArray
    there: BoolArray
    sigma_known: bool
    max_vertices: int
    n_vertices: int | None
    margin_mm: float

    def fit(self, start: float) -> RunFit:
        """Leave outliers out and fit; `start` is sigma, or where it is not known a first idea of it."""
        certain = _on_the_wrong_rail(self.raw, start)
        alone = np.where(certain, np.nan, self.raw)
        suspected = certain | (np.stack([spikes(values, start) for values in alone]) & self.there)
        run = self._fit_without_outliers(start, suspected)
        if suspected.any():
            # Corners and steep ends are not predicted by neighbours either: are polygons of more readings cheaper?
            # Nor are a fault's neighbours: is it one of the suspects alone?
            others = [certain]
            for at in np.flatnonzero(suspected & ~certain)[:_ALONE] if suspected.sum() > 1 else ():
                others.append(certain.copy())
                others[-1].flat[at] = True
            if run.selection is not None:
                off = np.abs(self.raw - run.selection.chosen.readings(run.problem))
                others.append(suspected & (off > _NEAR * start * run.residual_scale(self.sigma_known)))
            others = [out for out in others if (out != suspected).any()]
            runs = [run, *(self._fit_without_outliers(start, out) for out in others)]
            scale = max(
                run.residual_scale(self.sigma_known), runs[-1].residual_scale(self.sigma_known) * _BARELY
            )
            run = min(reversed(runs), key=lambda r: r.penalised_cost(scale))
        if self.n_vertices is None:
            run = _with_ellipse(run, self.sigma_known)
        if self.sigma_known or run.selection is None:
            return run
        freedom = max(run.freedom, 1)
        found = max(start * float(np.sqrt((run.residuals**2).sum() / freedom)), FLOOR)
        return replace(run, problem=run.problem.scaled(found / start), sigma=found)

    def _fit_without_outliers(self, start: float, out: BoolArray) -> RunFit:
        """Fit without some readings (S, n), and then without those that lie alone far from the polygon."""
        out, few = out | ~self.there, 2 * len(self.raw) + _SPARE + (2 if len(self.raw) == 1 else 0)
        readings = dict(zip(self.names, self.raw, strict=True))
        for _ in range(_ROUNDS):
            problem = FitProblem.of(self.sensor, self.x_mm, readings, start, out, self.margin_mm)
            if problem.readings < few:
                return RunFit(problem, None, start, out & self.there)
            fits = fit_counts(problem, self.sigma_known, self.max_vertices, n_vertices=self.n_vertices)
            run = RunFit(problem, fits, start, out & self.there)
            new = isolated_outliers(run.residuals / run.residual_scale(self.sigma_known))
            # Of corners that are told, more than the readings hold may explain them all.
            if not new.any() or (self.n_vertices is not None and problem.readings - new.sum() < few):
                break
            out = out | new
        return run


def _on_the_wrong_rail(raw: FloatArray, sigma: float) -> BoolArray:
    """Find readings (2, n) that lie on ground or Vref where the strip's other reading says that none can.

    k_h is never below k_l: a k_h on ground, or a k_l on Vref, beside another reading is a dead or saturated channel.
    """
    out = np.zeros(raw.shape, dtype=np.bool_)
    if len(raw) == 2:
        near = _NEAR * sigma
        with np.errstate(invalid="ignore"):
            below = raw[0] < raw[1] - 2.0 * near
            out[0], out[1] = below & (raw[0] <= near), below & (raw[1] >= 1.0 - near)
    return out


def _with_ellipse(run: RunFit, sigma_known: bool) -> RunFit:
    problem, selection = run.problem, run.selection
    if selection is None or not selection.chosen.n_interior:
        return run
    score = selection.scores[selection.best] - complexity_penalty(problem, 1, sigma_known)
    ellipse = fit_ellipse(selection.chosen, problem, score if sigma_known else np.inf)
    return replace(
        run, ellipse=ellipse, ellipse_advantage=score - deviance(ellipse.cost, problem, sigma_known)
    )


def gain_of_one(left: RunFit, right: RunFit, joint: RunFit) -> float:
    """Return by how much one contact, with strips missing in it, explains two runs better than two; by the criterion.

    -inf where none is fitted to both.
    """
    if joint.selection is None:
        return -math.inf
    variance = max(left.sigma, right.sigma) ** 2
    penalty = per_vertex_penalty(joint.problem.readings)

    def price(run: RunFit) -> float:
        return run.squares / variance + penalty * (run.complexity + np.count_nonzero(run.excluded))

    def alone(run: RunFit) -> float:
        # Readings of few strips hold few corners: an outline with one at each leaves nothing, and costs no more.
        return min(price(run), penalty * max(run.problem.readings - _BARE, 0))

    two_ends = 2.0 * penalty  # they become none
    return float(alone(left) + alone(right) + two_ends - price(joint))


def _initial_sigma(sensor: Sensor, raw: FloatArray) -> float:
    """Return a first idea of sigma: from second differences, and at least what the A/D converter's steps make."""
    levels = [reading_noise(values[np.isfinite(values)]) for values in raw]
    return float(max(np.sqrt(np.mean(np.square(levels))), sensor.adc_step / np.sqrt(12.0)))
