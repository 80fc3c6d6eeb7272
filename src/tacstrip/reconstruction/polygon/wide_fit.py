"""The last descent of a polygon on wide strips: on what they read themselves, slopes at corners included.

To take the width's effect away and to fit again turns in circles where a corner lies on a strip: what a centre line
tells of its place, and what the strip does, differ. So from there on a polygon of so many vertices descends on the
readings of the wide strips themselves (Levenberg and Marquardt), and its covariance is by their slopes.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.contact.shape import Contact
from tacstrip.contact.signature import signatures
from tacstrip.contact.strip_width import wide_ends
from tacstrip.core.polygon_fit import PolygonFit
from tacstrip.core.swept_area import swept_share
from tacstrip.core.vertex_covariance import covariance_with_x_priors
from tacstrip.errors import ContactError
from tacstrip.geometry.outline import Outline
from tacstrip.reconstruction.noise_covariance import signature_jacobians
from tacstrip.reconstruction.polygon.run import MOST_SIGMA, ModelInMm, RunFit
from tacstrip.reconstruction.strip_width import OnWideStrips, remove_width_effect
from tacstrip.scan import Scan
from tacstrip.sensor.spec import Sensor

_ROUNDS, _SAME = 8, 0.1  # of taking away what the width adds, until it changes by less [sigma]
# Trials of a step; gains in chi square that end them, and that ask for new slopes.
_STEPS, _SETTLED, _CURVED = 16, 0.03, 1.0
_LEAST_DAMPING, _MOST_DAMPING = 1e-3, 1e5
_HARDER, _EASIER = 8.0, 0.1
_EXPLAINED = 4.0  # deviations that a reading of an outer strip may be off
_DRAWS = 24  # outlines that the covariance allows
_CORNERS = 12  # of more vertices a descent would take seconds
_TURN = 1e-9  # of the sensor's area: a corner that turns inwards by less is straight


@dataclass(frozen=True, eq=False)
class _Task:
    """What wide strips read: their places x (n,) [mm], names and values (S, n), and the run's weights and ends."""

    sensor: Sensor
    x: FloatArray
    names: tuple[str, ...]
    measured: FloatArray
    root_weight: FloatArray
    expected: tuple[float, float]  # x of the left and the right end [mm], known to a pitch

    def read(self, outline: Outline, near: OnWideStrips | None = None) -> tuple[OnWideStrips, FloatArray]:
        """Return the outline on the strips, and the readings (S, n); from those of one `near` by where these tell."""
        half, reach = 0.5 * self.sensor.strip_width, self.x[self.used][[0, -1]]
        if outline.lower[0, 0] > reach[0] + half or outline.lower[-1, 0] < reach[1] - half:
            raise ContactError("a strip that reads is not touched")
        wide = OnWideStrips(self.sensor, outline, self.x, near)
        made = signatures(self.sensor, *wide.ends)
        return wide, np.stack([made[name] for name in self.names])

    def off(self, outline: Outline, made: FloatArray) -> FloatArray:
        """Return all residuals over their sigma (S n + 2,), those of the ends' x last."""
        r = np.where(self.root_weight > 0.0, (self.measured - made) * self.root_weight, 0.0)
        ends = np.subtract(self.expected, outline.lower[[0, -1], 0]) * self.rate
        return np.concatenate([r.ravel(), ends])

    @property
    def used(self) -> BoolArray:
        """Which strips have a reading that counts (n,)."""
        return np.asarray((self.root_weight > 0.0).any(axis=0))

    @property
    def rate(self) -> float:
        """1 / the deviation of an end's x [1/mm]."""
        return math.sqrt(12.0) / self.sensor.pitch_mm

    def slopes(self, wide: OnWideStrips, free: IntArray, place: IntArray) -> FloatArray:
        """Return the slopes of the readings over their sigma by the free coordinates (S n, F) [1/mm]."""
        by_end = wide.slopes() @ np.equal(place[:, None], np.arange(len(free))).astype(float)
        of_ends = signature_jacobians(self.sensor, *wide.ends)
        by_reading = np.stack([np.einsum("en,enf->nf", np.stack(of_ends[n]), by_end) for n in self.names])
        weighted = np.where(self.root_weight > 0.0, self.root_weight, 0.0)[..., None] * by_reading
        return np.asarray(weighted.reshape(-1, len(free)))


def _moved(outline: Outline, by: FloatArray) -> Outline:
    """Return an outline with its vertices moved (2 V,) [mm]; ContactError where it is none then."""
    vertices = outline.vertices + by.reshape(-1, 2)
    lower, upper = outline.indices
    return Outline(vertices[lower], vertices[upper])


def _free(outline: Outline) -> tuple[IntArray, IntArray]:
    """Return which of `vertices.ravel()` are free (F,), and which of these each is (2 V,); a vertical end has one x."""
    column = np.arange(outline.vertices.size)
    lower, upper = outline.indices
    for end in (0, -1):
        column[2 * upper[end]] = column[2 * lower[end]]
    return np.unique(column, return_inverse=True)


def fitted_to_wide_strips(
    fit: Callable[[dict[str, FloatArray]], RunFit],
    run: RunFit,
    sensor: Sensor,
    x_mm: FloatArray,
    measured: dict[str, FloatArray],
    fitted: slice,
    sigma_known: bool,
) -> tuple[RunFit, dict[str, FloatArray]]:
    """Return the fit to wide strips, and their readings without what the width adds to those of its outline.

    Parameters
    ----------
    fit
        Fits readings of lines.
    run
        What it made of the readings as measured.
    sensor, x_mm, measured
        The contact's wide strips, at x_mm (n,), and their readings (n,).
    fitted
        Those that `fit` takes.
    sigma_known
        Whether sigma is no estimate.
    """
    readings = inner = {name: k[fitted] for name, k in measured.items()}
    if _hopeless(run, sensor):
        return run, readings
    for _ in range(_ROUNDS):
        wide = _of_wide_strips(run, sensor, x_mm, measured, fitted)
        outline = run.outline if wide is None else wide.outline
        if outline is None:
            break
        thin = remove_width_effect(sensor, outline, x_mm[fitted], inner, corners=True)
        change = max(float(np.nan_to_num(np.abs(thin[name] - k)).max()) for name, k in readings.items())
        if wide is None and change < _SAME * run.sigma:
            break
        before, readings = run, thin
        run = fit(thin)
        if wide is not None and _alike(run, before):
            if not sigma_known:
                problem = wide.problem.scaled(run.sigma / wide.sigma)
                wide = _of_wide_strips(
                    replace(wide, problem=problem, sigma=run.sigma), sensor, x_mm, measured, fitted
                )
            return wide or run, readings
    return run, readings


def contradicted_by_outer_strip(
    scan: Scan,
    sensor: Sensor,
    strips: slice,
    fitted: slice,
    outline: Outline,
    covariance: FloatArray,
    sigma: float,
) -> str:
    """Say which of the strips that were left out of the fit reads no such outline; "" where none does.

    How far its readings scatter over what the covariance (2 V, 2 V) [mm^2] allows counts as an error of them.
    """
    out = [*range(strips.start, fitted.start), *range(fitted.stop, strips.stop)]
    if not out or sensor.surface is not None or not np.isfinite(covariance).all():
        return ""
    moves = np.random.default_rng(0).multivariate_normal(
        np.zeros(len(covariance)), covariance, _DRAWS, check_valid="ignore"
    )
    contacts = []
    for moved in (np.zeros(len(covariance)), *moves):
        with contextlib.suppress(ContactError):  # one that crosses itself is no contact
            contacts.append(Contact.polygon(outline.vertices + moved.reshape(-1, 2)))
    if len(contacts) < _DRAWS // 2:
        return ""
    ends = wide_ends(sensor, contacts)
    made = np.stack([*signatures(sensor, ends.l[:, out], ends.u[:, out]).values()])  # (S, contacts, out)
    read = np.stack([scan[name][out] for name in scan.signatures])
    spread = np.nanstd(made, axis=1) if np.isfinite(made).any() else np.zeros_like(read)
    resolved = signatures(sensor, *OnWideStrips(sensor, outline, sensor.x_mm[out]).ends)
    off = np.nan_to_num(np.abs(read - np.stack([*resolved.values()])))
    if (off <= _EXPLAINED * np.hypot(sigma, np.nan_to_num(spread))).all():
        return ""
    strip = out[int(off.max(axis=0).argmax())] + sensor.strip_base
    return (
        f"strip {strip}, which the contact covers in part, reads {100.0 * off.max():.2g} % of Vref otherwise than this "
        "outline: it ends in another way there"
    )


def _hopeless(run: RunFit, sensor: Sensor) -> bool:
    """Whether the outline is off by more than noise and width can add: readings that are no polygon's."""
    left = math.sqrt(run.residual_sums[0] / max(run.freedom, 1)) * run.sigma
    return left > max(MOST_SIGMA, sensor.strip_width / sensor.length_mm)


def _alike(run: RunFit, other: RunFit) -> bool:
    """Whether both have the same vertices and left out the same readings."""
    a, b = run.model, other.model
    if not (isinstance(a, PolygonFit) and isinstance(b, PolygonFit)):
        return False
    alike = np.array_equal(a.chain, b.chain) and np.array_equal(a.vertical_ends, b.vertical_ends)
    return alike and np.array_equal(run.excluded, other.excluded)


def _of_wide_strips(
    run: RunFit, sensor: Sensor, x_mm: FloatArray, measured: Mapping[str, FloatArray], fitted: slice
) -> RunFit | None:
    """Return a run whose polygon is the least-squares one on wide strips, near that of the run given.

    None where it has no polygon with an area, or too many vertices, reaches the border, or of one signature would
    become concave.
    """
    if not isinstance(run.model, PolygonFit) or run.selection is None or run.outline is None:
        return None
    if run.model.n_vertices > _CORNERS:
        return None
    outline, problem, selection = run.outline, run.problem, run.selection
    y = outline.vertices[:, 1]
    border = 0.5 * sensor.strip_width
    if y.min() < border or y.max() > sensor.length_mm - border:  # perhaps cut: an outer strip tells no corner
        return None
    known = np.stack([*measured.values()])
    weight = np.zeros(known.shape)
    weight[:, fitted] = np.where(np.isfinite(known[:, fitted]), problem.root_weight, 0.0)
    expected = problem.origin_mm, problem.origin_mm + problem.width_mm
    task = _Task(sensor, x_mm, tuple(measured), np.nan_to_num(known), weight, expected)
    try:
        outline, slopes, place = _with_outer_strips(task, outline, np.isfinite(known), 1.0 / run.sigma)
    except ContactError:
        return None
    if len(known) == 1 and not _convex(outline, sensor):
        return None
    jacobian = np.zeros((len(slopes), len(place)))
    jacobian[:, np.unique(place, return_index=True)[1]] = slopes
    covariance = covariance_with_x_priors(outline, sensor, jacobian)
    inner = {name: k[fitted] for name, k in measured.items()}
    thin = np.stack([*remove_width_effect(sensor, outline, x_mm[fitted], inner, corners=True).values()])
    problem = replace(problem, k=np.where(weight[:, fitted] > 0.0, thin, problem.k))
    fit = PolygonFit.of(outline, problem)
    fit = replace(fit, cost=float((fit.residuals(problem) ** 2).sum()))
    fits = [fit if number == selection.best else one for number, one in enumerate(selection.fits)]
    found = replace(run, problem=problem, selection=replace(selection, fits=fits))
    swept = swept_share(outline.vertices, covariance) if np.isfinite(covariance).all() else math.inf
    in_mm = replace(ModelInMm.of(fit, problem), covariance=covariance, swept=swept)
    found.__dict__["model_mm"] = in_mm  # the cached property's place
    return found


def _with_outer_strips(
    task: _Task, outline: Outline, there: BoolArray, rate: float
) -> tuple[Outline, FloatArray, IntArray]:
    """Do as `_descended`, with the readings of the outer strips too where an outline explains them.

    Covered in part, they tell where the contact ends.
    """
    outer = ~task.used
    if outer.any():
        weight = np.where(there & outer, rate, task.root_weight)
        wider = replace(task, root_weight=weight)
        for start in (outline, *_leaning(outline, 0.5 * task.sensor.strip_width)):
            with contextlib.suppress(ContactError):
                found = _descended(wider, start)
                off = wider.off(found[0], wider.read(found[0])[1])[: weight.size].reshape(weight.shape)
                if np.abs(off[:, outer]).max(initial=0.0) < _EXPLAINED:
                    return found
    return _descended(task, outline)


def _leaning(outline: Outline, by_mm: float) -> Iterator[Outline]:
    """Make outlines with one vertical edge the less: one of its vertices moved inwards."""
    chains = outline.lower, outline.upper
    for end, sign in ((0, 1.0), (-1, -1.0)):
        if chains[0][end, 1] == chains[1][end, 1]:
            continue
        for side in (0, 1):
            moved, tip = chains[side].copy(), chains[1 - side][end]
            moved[end, 0] += sign * by_mm
            moved = np.insert(moved, len(moved) if end else 0, tip, axis=0)
            with contextlib.suppress(ContactError):
                yield Outline(*((chains[0], moved) if side else (moved, chains[1])))


def _descended(task: _Task, outline: Outline) -> tuple[Outline, FloatArray, IntArray]:
    """Return the outline with the least residuals near one, the slopes there, and which coordinate each is."""
    free, place = _free(outline)
    prior = np.zeros((2, len(free)))
    prior[[0, 1], place[2 * outline.indices[0][[0, -1]]]] = task.rate
    wide, made = task.read(outline)
    off, damping, tried = task.off(outline, made), _LEAST_DAMPING, 0
    slopes = task.slopes(wide, free, place)
    while tried < _STEPS:
        full = np.concatenate([slopes, prior])
        matrix, gradient = full.T @ full, full.T @ off
        scale = np.diag(matrix) + 1e-6 * np.diag(matrix).max()
        better = False
        while not better and tried < _STEPS and damping < _MOST_DAMPING:
            tried += 1
            step = np.linalg.solve(matrix + damping * np.diag(scale), gradient)
            try:
                there = _moved(outline, step[place])
                if np.ptp([*there.vertices[:, 1], 0.0, task.sensor.length_mm]) > task.sensor.length_mm:
                    raise ContactError("a corner is off the sensor")
                wide, made = task.read(there, wide)
                left = task.off(there, made)
                better = bool(left @ left < off @ off)
            except ContactError:
                better = False
            if not better:
                damping *= _HARDER
        if not better:
            break
        gain = float(off @ off - left @ left)
        outline, off, damping = there, left, damping * _EASIER
        if gain < _SETTLED:
            break
        if gain > _CURVED:  # nearer, slopes are as they were
            slopes = task.slopes(wide, free, place)
    return outline, slopes, place


def _convex(outline: Outline, sensor: Sensor) -> bool:
    edge = np.roll(outline.vertices, -1, axis=0) - outline.vertices
    after = np.roll(edge, -1, axis=0)
    turn = edge[:, 0] * after[:, 1] - edge[:, 1] * after[:, 0]
    return bool(turn.min() > -_TURN * sensor.length_mm * sensor.width_mm)
