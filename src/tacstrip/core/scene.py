"""Several polygons under crossed layers: what every strip reads of them, and least squares of all their corners.

A strip reads the hull [min l, max u] of all that touches it, so each end belongs to one edge of one polygon, and its
readings depend on the two corners of that edge. Which strips are touched at all is known for certain: a polygon
that ends short of a touched strip, or covers a silent one, is charged for the distance.
"""

from __future__ import annotations

import math
from ctypes import Array
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.core.binding import CrossedLayer, at, exported
from tacstrip.core.problem import FitProblem
from tacstrip.sensor.layers import Layer

TOUCH_END = 0.05  # of the pitch: deviation of where touch begins and ends
RIDGE = 1e-4  # 1/mm^2, of corners that no reading determines: they stay where they are
SLACKENED, TIGHTENED, SLACKEST, STUCK = 6.0, 8.0, 1e-7, 1e6  # of the damping
GAINS, GAINS_SHARE = 1e-3, 1e-5  # a step that gains less, or less than this share of the cost, ends a descent
NOWHERE, DAMPING = 1e-12, 1e-2
_LONGEST = 0.04  # of the strip length, a step of a corner at most


@dataclass(frozen=True, eq=False)
class Scene:
    """Polygons: their corners one after another.

    Attributes
    ----------
    corners
        (M, 2) [mm].
    sizes
        Corners of each polygon, 3 or more.
    """

    corners: FloatArray
    sizes: tuple[int, ...]

    @classmethod
    def of(cls, polygons: list[FloatArray]) -> Scene:
        """Make the scene of polygons (N, 2) [mm]."""
        return cls(np.concatenate(polygons), tuple(len(p) for p in polygons))

    @cached_property
    def polygons(self) -> list[FloatArray]:
        """Each polygon's corners (N, 2) [mm]."""
        return np.split(self.corners, self.starts[1:])

    @cached_property
    def starts(self) -> list[int]:
        """Where each polygon's corners begin."""
        return [0, *np.cumsum(self.sizes)[:-1].tolist()]

    @cached_property
    def following(self) -> IntArray:
        """The next corner round its polygon (M,)."""
        return np.concatenate(
            [a + np.roll(np.arange(n), -1) for a, n in zip(self.starts, self.sizes, strict=True)]
        )

    @cached_property
    def before(self) -> IntArray:
        """The corner before it (M,)."""
        return np.argsort(self.following)

    def without_corner(self, at: int) -> Scene:
        """Return the scene without one corner."""
        owner = int(np.searchsorted(self.starts, at, side="right")) - 1
        sizes = tuple(n - (k == owner) for k, n in enumerate(self.sizes))
        return Scene(np.delete(self.corners, at, axis=0), sizes)

    def with_corner(self, at: int) -> Scene:
        """Return the scene with one more corner in the middle of the edge from a corner to the next."""
        owner = int(np.searchsorted(self.starts, at, side="right")) - 1
        middle = 0.5 * (self.corners[at] + self.corners[self.following[at]])
        sizes = tuple(n + (k == owner) for k, n in enumerate(self.sizes))
        return Scene(np.insert(self.corners, at + 1, middle, axis=0), sizes)

    def moved(self, by: FloatArray) -> Scene:
        """Return the scene with its corners moved by (2 M,) or (M, 2) [mm]."""
        return replace(self, corners=self.corners + by.reshape(-1, 2))


@dataclass(frozen=True, eq=False)
class LayerReadings:
    """What one layer read.

    Attributes
    ----------
    layer
        Where it lies.
    problem
        Its readings, strip by strip, NaN with weight 0.
    touched
        Which strips are touched (n,).
    bounds_mm
        Between what the contact on each strip lies (2, n) [mm]: l and u as they read, where two readings tell them,
        else the whole strip; NaN where nothing touches.
    """

    layer: Layer
    problem: FitProblem
    touched: BoolArray
    bounds_mm: FloatArray

    @cached_property
    def x_mm(self) -> FloatArray:
        """Centre lines of its strips (n,) [mm]."""
        return np.ascontiguousarray(self.layer.sensor.x_mm)

    @cached_property
    def compiled(self) -> CrossedLayer:
        """What the compiled core takes; the arrays are its own."""
        problem, sensor = self.problem, self.layer.sensor
        k, weight = np.ascontiguousarray(problem.k), np.ascontiguousarray(problem.weight)
        touched = np.ascontiguousarray(self.touched)
        shares = (float(problem.shares[0]), float(problem.shares[-1]))
        made = CrossedLayer(
            len(self.x_mm), len(k), at(self.x_mm), at(k), at(weight), at(touched), sensor.pitch_mm, sensor.length_mm,
            shares, problem.narrow, problem.lam, tuple(self.layer.rotation.ravel()), tuple(self.layer.origin_mm),
        )  # fmt: skip
        made.arrays = (self.x_mm, k, weight, touched)
        return made

    @cached_property
    def root_weight(self) -> FloatArray:
        """1 / sigma of each reading (S, n)."""
        return self.problem.root_weight


@dataclass(frozen=True, eq=False)
class Fitted:
    """A scene and how well it explains the readings.

    Attributes
    ----------
    scene
        The polygons.
    cost
        Squared residuals, summed.
    information
        Of the corners (2 M, 2 M) [1/mm^2].
    gradient
        Jacobian times residuals (2 M,) [1/mm].
    """

    scene: Scene
    cost: float
    information: FloatArray
    gradient: FloatArray


@dataclass(frozen=True, eq=False)
class SceneProblem:
    """The readings of all layers.

    Attributes
    ----------
    layers
        What each read.
    sigma
        Standard deviation of a reading [Vref].
    """

    layers: tuple[LayerReadings, ...]
    sigma: float

    @cached_property
    def readings(self) -> int:
        """Readings that count."""
        return sum(part.problem.readings for part in self.layers)

    @cached_property
    def length_mm(self) -> float:
        """Length of the longest strips [mm]."""
        return max(part.layer.sensor.length_mm for part in self.layers)

    def scaled(self, factor: float) -> SceneProblem:
        """Return the problem with sigma times a factor."""
        parts = tuple(replace(part, problem=part.problem.scaled(factor)) for part in self.layers)
        return SceneProblem(parts, self.sigma * factor)

    def without(self, out: list[BoolArray]) -> SceneProblem:
        """Return the problem with readings left out, each layer's (S, n)."""
        parts = tuple(
            replace(part, problem=part.problem.without(o)) for part, o in zip(self.layers, out, strict=True)
        )
        return SceneProblem(parts, self.sigma)

    def coarser(self, enough: int) -> list[SceneProblem]:
        """Return the problems of about so many strips of each layer, evenly spread; none of fewer than twice that."""
        step = max(len(part.x_mm) for part in self.layers) // enough
        return [
            self.without(
                [np.tile(np.arange(len(p.x_mm)) % step != first, (len(p.problem.k), 1)) for p in self.layers]
            )
            for first in range(step if step > 1 else 0)
        ]

    def fitted(self, scene: Scene) -> Fitted:
        """Return how well a scene explains the readings."""
        return self.refine(scene, 0)

    def end_information(self, scene: Scene) -> FloatArray:
        """Return what silent strips beside an end tell of its corner (2 M, 2 M) [1/mm^2]: where it lies to a pitch."""
        found = np.zeros((scene.corners.size,) * 2)
        for part in self.layers:
            corners, n = part.layer.to_layer(scene.corners), len(part.x_mm)
            pitch = part.layer.sensor.pitch_mm
            across = part.layer.rotation[:, 0]
            for start, size in zip(scene.starts, scene.sizes, strict=True):
                x = corners[start : start + size, 0]
                for corner, side in ((start + int(x.argmin()), -1), (start + int(x.argmax()), 1)):
                    place = corners[corner, 0] / pitch - 0.5
                    beside = math.ceil(place) if side > 0 else math.floor(place)
                    if 0 <= beside < n and not part.touched[beside]:
                        rows = slice(2 * corner, 2 * corner + 2)
                        found[rows, rows] += 12.0 / pitch**2 * np.outer(across, across)
        return found

    def of_offset(self, fitted: Fitted) -> FloatArray:
        """Return J'W 1 (2 M,) [1/mm/Vref]: how an error that all readings share pulls at the corners."""
        step = self.sigma
        moved = tuple(
            replace(part, problem=replace(part.problem, k=part.problem.k + step)) for part in self.layers
        )
        shifted = SceneProblem(moved, self.sigma).fitted(fitted.scene).gradient
        return np.asarray((shifted - fitted.gradient) / step)

    def residuals(self, scene: Scene) -> list[FloatArray]:
        """Return each layer's readings minus predicted over sigma (S, n), 0 where there is none."""
        found = []
        for part in self.layers:
            l, u, _, _ = _hull(part, scene)
            with np.errstate(invalid="ignore"):
                off = (part.problem.k - part.problem.readings_of(l, u)) * part.root_weight
            found.append(np.nan_to_num(off))
        return found

    def refine(self, scene: Scene, steps: int, soft_mm: float = 0.0, reach: float = 0.0) -> Fitted:
        """Return the least squares of all corners near a scene, by Levenberg-Marquardt.

        Parameters
        ----------
        scene
            The polygons to begin with.
        steps
            At most.
        soft_mm
            By so much more uncertain than they are do readings count, and ends of touch: far starts find their way.
        reach
            Standard deviations after which a residual counts ever less (Cauchy); 0: never.
        """
        core, longest = exported("refine_scene"), _LONGEST * self.length_mm
        if core is None:
            return plain_refine(self.layers, scene, steps, soft_mm, reach, longest)
        size = scene.corners.size
        corners = np.array(scene.corners)
        matrix, gradient = np.empty((size, size)), np.empty(size)
        workspace, sizes = np.empty(4 * size + 2 * size**2), np.array(scene.sizes, dtype=np.int64)
        cost = core(
            self._compiled, len(self.layers), at(sizes), len(sizes), soft_mm, reach, steps, DAMPING, longest,
            at(corners), at(matrix), at(gradient), at(workspace),
        )  # fmt: skip
        return Fitted(Scene(corners, scene.sizes), cost, matrix, gradient)

    @cached_property
    def _compiled(self) -> Array[CrossedLayer]:
        return (CrossedLayer * len(self.layers))(*[part.compiled for part in self.layers])


def plain_equations(layers: tuple[LayerReadings, ...], scene: Scene, soft_mm: float, reach: float) -> Fitted:
    """Return a scene's cost and normal equations."""
    parts = [_residuals(part, scene, soft_mm) for part in layers]
    r, j = (np.concatenate([block for part in parts for block in part[i]]) for i in range(2))
    if reach:
        loss = 1.0 + (r / reach) ** 2
        cost = float(reach**2 * np.log(loss).sum())
        root = 1.0 / np.sqrt(loss)
        r, j = r * root, j * root[:, None]
    else:
        cost = float(r @ r)
    return Fitted(scene, cost, j.T @ j, j.T @ r)


def plain_refine(
    layers: tuple[LayerReadings, ...],
    scene: Scene,
    steps: int,
    soft_mm: float,
    reach: float,
    longest_mm: float,
) -> Fitted:
    """Do as `SceneProblem.refine`, in NumPy."""
    now, damping = plain_equations(layers, scene, soft_mm, reach), DAMPING
    for _ in range(steps):
        held = now.information + np.diag(damping * np.diagonal(now.information) + RIDGE)
        step = np.asarray(np.linalg.solve(held, now.gradient))
        step *= min(1.0, longest_mm / max(float(np.abs(step).max()), NOWHERE))
        tried = plain_equations(layers, now.scene.moved(step), soft_mm, reach)
        if tried.cost < now.cost:
            done = now.cost - tried.cost < max(GAINS, GAINS_SHARE * now.cost)
            now, damping = tried, max(damping / SLACKENED, SLACKEST)
            if done:
                break
        else:
            damping *= TIGHTENED
            if damping > STUCK:
                break
    return now


def _hull(
    part: LayerReadings, scene: Scene
) -> tuple[FloatArray, FloatArray, tuple[IntArray, IntArray], FloatArray]:
    """Return l and u over L (n,), NaN where nothing touches, the edges that make them, and the corners in the layer."""
    corners = part.layer.to_layer(scene.corners)
    x, length = part.x_mm, part.layer.sensor.length_mm
    xa, ya = corners.T
    xb, yb = corners[scene.following].T
    crosses = (np.minimum(xa, xb)[:, None] <= x) & (x < np.maximum(xa, xb)[:, None])
    run = xb - xa
    slope = (yb - ya) / np.where(run == 0.0, 1.0, run)
    y = ya[:, None] + slope[:, None] * (x - xa[:, None])  # (M, n)
    low, high = np.where(crosses, y, np.inf), np.where(crosses, y, -np.inf)
    edges = low.argmin(axis=0), high.argmax(axis=0)
    l, u = low.min(axis=0) / length, high.max(axis=0) / length
    outside = ~np.isfinite(l)
    l[outside] = u[outside] = np.nan
    return l, u, edges, corners


def _residuals(
    part: LayerReadings, scene: Scene, soft_mm: float
) -> tuple[list[FloatArray], list[FloatArray]]:
    """Return the residuals of one layer, and minus their Jacobian by all corners."""
    l, u, edges, corners = _hull(part, scene)
    sensor, x = part.layer.sensor, part.x_mm
    covered = np.isfinite(l)
    at = np.flatnonzero(covered & part.touched)
    count = scene.corners.size
    held = [np.clip(e[at], 0.0, 1.0) for e in (l, u)]  # what lies beyond the border is not read
    by_l, by_u, k = part.problem.jacobian(*held)
    by_l = np.where((l[at] >= 0.0) & (l[at] <= 1.0), by_l, 0.0) / sensor.length_mm
    by_u = np.where((u[at] >= 0.0) & (u[at] <= 1.0), by_u, 0.0) / sensor.length_mm
    root = part.root_weight[:, at]
    if soft_mm:
        root = root / np.sqrt(1.0 + (root * soft_mm / sensor.length_mm) ** 2)
    of_l, of_u = (_end_slopes(part, scene, edge[at], corners, x[at]) for edge in edges)
    rows = root[..., None] * (by_l[..., None] * of_l + by_u[..., None] * of_u)  # (S, a, 2 M)
    off = root * (part.problem.k[:, at] - k)
    residuals, jacobian = [off.ravel()], [rows.reshape(-1, count)]
    for away, corner, sign in _touch_errors(part, scene, corners, covered):
        weight = 1.0 / (TOUCH_END * sensor.pitch_mm + soft_mm)
        row = np.zeros((len(away), count))
        i = np.arange(len(away))
        across = part.layer.rotation[:, 0] * weight
        row[i, 2 * corner], row[i, 2 * corner + 1] = sign * across[0], sign * across[1]
        residuals.append(away * weight)
        jacobian.append(row)
    return residuals, jacobian


def _end_slopes(
    part: LayerReadings, scene: Scene, edge: IntArray, corners: FloatArray, x: FloatArray
) -> FloatArray:
    """Return how the height of edges over x (a,) moves with all corners of the whole (a, 2 M)."""
    a, b = edge, scene.following[edge]
    run = corners[b, 0] - corners[a, 0]
    share = (x - corners[a, 0]) / run
    slope = (corners[b, 1] - corners[a, 1]) / run
    across, along = part.layer.rotation.T  # directions of the layer in the whole
    by = along - slope[:, None] * across  # (a, 2)
    found = np.zeros((len(x), len(corners), 2))
    row = np.arange(len(x))
    found[row, a] = (1.0 - share)[:, None] * by
    found[row, b] = share[:, None] * by
    return found.reshape(len(x), corners.size)


def _touch_errors(
    part: LayerReadings, scene: Scene, corners: FloatArray, covered: BoolArray
) -> list[tuple[FloatArray, IntArray, FloatArray]]:
    """Return by how much polygons end short of touched strips or cover silent ones [mm], and the corners to move."""
    short, silent = np.flatnonzero(part.touched & ~covered), np.flatnonzero(~part.touched & covered)
    if not (len(short) or len(silent)):
        return []
    x = corners[:, 0]
    bounds = list(zip(scene.starts, scene.sizes, strict=True))
    left = np.array([a + x[a : a + n].argmin() for a, n in bounds])
    right = np.array([a + x[a : a + n].argmax() for a, n in bounds])
    found = []
    if len(short):
        at = part.x_mm[short]
        gap = np.concatenate([at[:, None] - x[right], x[left] - at[:, None]], axis=1)  # (a, 2 K)
        gap = np.where(gap >= 0.0, gap, np.inf)
        nearest = gap.argmin(axis=1)
        sign = np.where(nearest < len(bounds), 1.0, -1.0)
        away = gap[np.arange(len(at)), nearest]
        away = np.where(np.isfinite(away), away, 0.0)
        found.append((away, np.concatenate([right, left])[nearest], sign))
    if len(silent):
        at = part.x_mm[silent]
        from_left, from_right = at[:, None] - x[left], x[right] - at[:, None]
        inside = (from_left >= 0.0) & (from_right >= 0.0)
        strip, polygon = np.nonzero(inside)
        a, b = from_left[strip, polygon], from_right[strip, polygon]
        at_left = a < b  # the end that has the shorter way to go
        found.append(
            (np.minimum(a, b), np.where(at_left, left[polygon], right[polygon]), np.where(at_left, 1.0, -1.0))
        )
    return found
