"""Regular outlines that explain the readings of one signature: discs, ellipses, segments, rectangles, trapezoids.

Polygons that read alike differ by their heights, for one signature is one number a strip. A regular outline keeps its
proportions: where a disc begins and ends tells how high it is. So outlines of each kind, inside the sensor and over its
border, are drawn by sequential Monte Carlo (Del Moral, Doucet and Jasra 2006), which tells how likely that kind makes
the readings. y follows by linear least squares, for k (1 - n w) = l + a w is linear in l.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.core.problem import FitProblem
from tacstrip.geometry.metrics import column_iou
from tacstrip.reconstruction.posterior.family_outline import FamilyOutline

_Floats: TypeAlias = npt.NDArray[np.floating[Any]]  # of the precision that is enough

_KINDS = (
    "like a disc",
    "like an ellipse",
    "like a segment of a disc",
    "like an upright rectangle",
    "like a rectangle",
    "like an upright trapezoid",
    "like a trapezoid",
)
_DISC, _ELLIPSE, _SEGMENT, _UPRIGHT, _, _TRAPEZOID, _TURNED = range(7)
_FREE = (0, 2, 2, 2, 3, 3, 4)  # numbers that make one, besides its ends
# Numbers uniform in 0 to 1: the ends, ratio of the axes, turn, two of the kind, and which part is over which border.
_NUMBERS = 8
_LEFT, _RIGHT, _RATIO, _TURN, _A, _B, _PART, _BORDER = range(_NUMBERS)
_FLATTEST = 0.35
_OVER = 0.1  # outlines over a border for one inside
_PARTICLES, _FIRST, _SWEEPS, _LEVELS = 48, 4, 3, 40
_HALF = 0.5  # of the particles, that a level leaves
_OCCAM = 25.0  # what a polygon's free corners cost it, of log likelihood
_HOPELESS = 8.0  # of the log evidence, by which a kind is given up
_KEPT = 200
_STRIPS = 32  # that readings are averaged to
_LOWEST, _HIGHEST = 0.02, 0.97  # of an outline's height, over the strip
_UNTOUCHED = 1e3  # half chi square of a strip that an outline misses; one may lie on an end
_DRAWN_AT = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, 33))  # parts of the extent where curves have vertices
_NONE = 1e-30  # length that an edge without any counts as
_STRAIGHT = 1e-3  # of the strip: a vertex that is off the line through its neighbours by less is none


@dataclass(frozen=True, eq=False)
class _Polygons:
    """Convex polygons, counter-clockwise, swept by discs: corners x, y (K, 4) and radii (K,), in own units."""

    x: FloatArray
    y: FloatArray
    radius: FloatArray

    @classmethod
    def of(cls, kind: IntArray, z: FloatArray) -> _Polygons:
        high = np.exp(math.log(_FLATTEST) - z[:, _RATIO] * math.log(_FLATTEST**2))
        turned = (kind == _TURNED) | (kind == _UPRIGHT + 1)
        quarter = np.where(kind == _TRAPEZOID, 0.5 * np.pi * np.floor(4.0 * z[:, _TURN]), 0.0)
        turn = np.where(turned, 2.0 * np.pi * z[:, _TURN], quarter)
        rectangle = kind < _TRAPEZOID
        # Corners are sharp in a quarter of the rectangles, and ends half discs in a few.
        radius = np.where(rectangle, np.clip(1.5 * z[:, _A] - 0.4, 0.0, 1.0) * np.minimum(1.0, high), 0.0)
        a, b, top = 1.0 - radius, high - radius, 0.2 + 1.6 * z[:, _A]
        begin = np.where(rectangle, -a, -1.6 + (3.2 - top) * z[:, _B])
        end = np.where(rectangle, a, begin + top)
        x, y = np.stack([-a, a, end, begin], axis=1), np.stack([-b, -b, b, b], axis=1)
        c, s = np.cos(turn)[:, None], np.sin(turn)[:, None]
        return cls(c * x - s * y, s * x + c * y, radius)

    @property
    def box(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        x, y, r = self.x, self.y, self.radius
        return x.min(axis=1) - r, x.max(axis=1) + r, y.min(axis=1) - r, y.max(axis=1) + r

    @property
    def marks(self) -> FloatArray:
        """Where edges begin and end (K, 8)."""
        dx, dy = (np.roll(v, -1, axis=1) - v for v in (self.x, self.y))
        off = self.radius[:, None] * dy / (np.hypot(dx, dy) + _NONE)
        return np.concatenate([self.x + off, self.x + off + dx], axis=1)

    def ends(self, at: _Floats) -> tuple[_Floats, _Floats]:
        """Return the lowest and highest y (K, G) at x (K, G); inf and -inf outside."""
        x, y, r = (v.astype(at.dtype) for v in (self.x, self.y, self.radius[:, None]))
        low, high = np.full_like(at, np.inf), np.full_like(at, -np.inf)
        for i in range(4):
            x0, y0 = x[:, i, None], y[:, i, None]
            dx, dy = x[:, (i + 1) % 4, None] - x0, y[:, (i + 1) % 4, None] - y0
            length = np.hypot(dx, dy) + _NONE
            from_x = x0 + r * dy / length
            upright = np.abs(dx) < 1e-6 * length
            line = y0 - r * dx / length + dy / np.where(upright, 1.0, dx) * (at - from_x)
            first, last = from_x + np.minimum(dx, 0.0), from_x + np.maximum(dx, 0.0)
            on = (at > first - 1e-6) & (at < last + 1e-6) & ~upright
            np.minimum(low, np.where(on & (dx > 0.0), line, np.inf), out=low)
            np.maximum(high, np.where(on & (dx < 0.0), line, -np.inf), out=high)
            if r.any():
                square = r**2 - (at - x0) ** 2
                half = np.where(square >= 0.0, np.sqrt(np.maximum(square, 0.0)), -np.inf)
                np.minimum(low, y0 - half, out=low)
                np.maximum(high, y0 + half, out=high)
        return low, high


@dataclass(frozen=True, eq=False)
class _Ovals:
    """Ellipses about 0, half axes 1 and `flat`, the first one along (c, s), and cut across it at `cut` (K,)."""

    flat: FloatArray
    c: FloatArray
    s: FloatArray
    cut: FloatArray

    @classmethod
    def of(cls, kind: IntArray, z: FloatArray) -> _Ovals:
        turn = np.pi * z[:, _TURN] * np.where(kind == _SEGMENT, 2.0, 1.0)
        cut = np.where(kind == _SEGMENT, -0.6 + 1.5 * z[:, _A], 2.0)
        flat = np.where(kind == _ELLIPSE, _FLATTEST ** z[:, _RATIO], 1.0)
        return cls(flat, np.cos(turn), np.sin(turn), cut)

    def _extent(self, along: FloatArray, across: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return how far they reach back and forth in the direction of these parts along and across the first axis."""
        reach, at = np.hypot(along, self.flat * across), np.minimum(self.cut, 1.0)
        chord, half = at * along, np.abs(self.flat * np.sqrt(1.0 - at**2) * across)
        first = along / reach  # of the farthest point, along the first axis
        return (
            np.where(-first <= self.cut, -reach, chord - half),
            np.where(first <= self.cut, reach, chord + half),
        )

    @property
    def box(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        return *self._extent(self.c, -self.s), *self._extent(self.s, self.c)

    @property
    def marks(self) -> FloatArray:
        """Where the cut begins and ends (K, 2), within the extent."""
        at = np.minimum(self.cut, 1.0)
        half = self.flat * np.sqrt(1.0 - at**2) * self.s
        return np.stack([at * self.c - half, at * self.c + half], axis=1)

    def ends(self, at: _Floats) -> tuple[_Floats, _Floats]:
        """Return the lowest and highest y (K, G) at x (K, G) within the extent."""
        flat, c, s, cut = (v.astype(at.dtype)[:, None] for v in (self.flat, self.c, self.s, self.cut))
        square = c**2 + (flat * s) ** 2
        half = np.sqrt(np.maximum(square - at**2, 0.0)) * (flat / square)
        middle = at * (c * s * (1.0 - flat**2) / square)
        low, high = middle - half, middle + half
        with np.errstate(divide="ignore", invalid="ignore"):
            line = (cut - at * c) / s
        return np.where(s < -1e-6, np.fmax(low, line), low), np.where(s > 1e-6, np.fmin(high, line), high)


@dataclass(frozen=True, eq=False)
class _Outlines:
    """Outlines by kind (K,), whether over a border (K,), and their numbers (K, 8)."""

    kind: IntArray
    over: BoolArray
    z: FloatArray

    def at(self, which: IntArray) -> _Outlines:
        return _Outlines(self.kind[which], self.over[which], self.z[which])


@dataclass(frozen=True, eq=False)
class _Placed:
    """Outlines (K,) on the sensor, over the strip's length above their lowest point.

    `border` 0 to 3: over the first strip, the last one, the ground end, the other one, by `part` of their extent.
    """

    lower: _Floats
    upper: _Floats
    there: BoolArray
    left: FloatArray
    right: FloatArray
    height: FloatArray
    border: IntArray
    part: FloatArray


@dataclass(frozen=True, eq=False)
class _Seen:
    """Readings of `_STRIPS` strips or fewer, their weights, and where outlines may lie."""

    problem: FitProblem
    window: tuple[float, float, float, float]
    x: _Floats
    k: _Floats
    weight: _Floats
    borders: IntArray

    @classmethod
    def of(cls, p: FitProblem, window: tuple[float, float, float, float]) -> _Seen:
        starts = np.arange(0, len(p.x), -(-len(p.x) // _STRIPS))
        weight = np.add.reduceat(p.weight[0], starts)
        k = np.add.reduceat(p.weight[0] * p.k[0], starts) / np.where(weight > 0.0, weight, 1.0)
        x = np.add.reduceat(p.x, starts) / np.diff(np.append(starts, len(p.x)))
        beyond = 0.5 * p.pitch - 1e-9  # an end that cannot lie so far out is at the sensor's side
        borders = np.flatnonzero([-window[0] < beyond, window[3] - 1.0 < beyond, True, True])
        single = np.float32
        return cls(p, window, x.astype(single), k.astype(single), weight.astype(single), borders)

    def placed(self, some: _Outlines, at: _Floats) -> _Placed:
        """Return outlines at x (G,) or (K, G)."""
        z, p, (begin, begun, end, ended) = some.z, self.problem, self.window
        left, right = begin + (begun - begin) * z[:, _LEFT], end + (ended - end) * z[:, _RIGHT]
        part = 0.1 + 0.4 * z[:, _PART]
        border = np.where(some.over, self.borders[(z[:, _BORDER] * len(self.borders)).astype(int)], -1)
        whole = (right - left) / (1.0 - part)
        left, right = np.where(border == 0, right - whole, left), np.where(border == 1, left + whole, right)
        lower, upper = (np.empty((len(z), at.shape[-1]), dtype=at.dtype) for _ in range(2))
        height = np.empty(len(z))
        for make, which in ((_Ovals, some.kind < _UPRIGHT), (_Polygons, some.kind >= _UPRIGHT)):
            i = np.flatnonzero(which)
            shape = make.of(some.kind[i], z[i])
            first, last, low, high = shape.box
            scale = (last - first) / (right[i] - left[i])
            own = first[:, None] + (np.broadcast_to(at, lower.shape)[i] - left[i, None]) * scale[:, None]
            tall = p.width_mm / p.length_mm / scale
            ends = shape.ends(own.astype(at.dtype))
            lower[i], upper[i] = ((v - low[:, None]) * tall[:, None] for v in ends)
            height[i] = (high - low) * tall
        there = (at >= left[:, None]) & (at <= right[:, None]) & (upper >= lower)
        return _Placed(lower, upper, there, left, right, height, border, part)

    def weighed(self, some: _Outlines) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return log prior, half chi square, and the lowest point (K,) over the strip that the readings want."""
        on, p = self.placed(some, self.x), self.problem
        lower, width = np.where(on.there, on.lower, 0.0), np.where(on.there, on.upper - on.lower, 0.0)
        lost, within = self._eroded(width)
        d = 1.0 - p.narrow * within
        linear = self.weight * d**2
        total = linear.sum(axis=1)
        lowest = ((self.k * d - p.shares[0] * within - lost - lower) * linear).sum(axis=1) / total
        room = 1.0 - on.height
        lowest = np.clip(lowest, 0.0, np.maximum(room, 0.0))
        lowest = np.where(on.border == 2, -on.part * on.height, lowest)
        lowest = np.where(on.border == 3, room + on.part * on.height, lowest)
        l = lowest[:, None].astype(np.float32) + lower
        cut = on.border >= 2
        l, u = np.clip(l, 0.0, 1.0), np.clip(l + width, 0.0, 1.0)
        lost[cut], within[cut] = self._eroded((u - l)[cut])
        read = (l + lost + p.shares[0] * within) / np.maximum(1.0 - p.narrow * within, 1e-3)
        missed = np.count_nonzero((self.weight > 0.0) & (~on.there | (u <= l)), axis=1)
        misfit = 0.5 * ((read - self.k) ** 2 @ self.weight) + np.where(missed > 1, _UNTOUCHED * missed, 0.0)
        # Places along the strip are as likely: their integral is that of the likelihood.
        log = np.where(cut, 0.0, -0.5 * np.log(total / (2.0 * np.pi)) - np.log(np.maximum(room, _LOWEST)))
        fits = (on.height > _LOWEST) & (on.height < _HIGHEST)
        return np.where(fits, log, -1e9), misfit.astype(np.float64), lowest

    def _eroded(self, width: _Floats) -> tuple[_Floats, _Floats]:
        """Return the transfer length of contacts, and what it leaves of their width."""
        lam = self.problem.lam
        lost = lam * np.tanh(width / (2.0 * lam)) if lam > 0.0 else np.zeros_like(width)
        return lost, width - 2.0 * lost

    def ends(self, some: _Outlines, lowest: FloatArray, at: FloatArray) -> FloatArray:
        """Return l and u (K, 2, G) at x (G,) or (K, G) within the strip; both 0 outside the outline."""
        on = self.placed(some, at)
        ends = np.clip(np.stack([on.lower, on.upper], axis=1) + lowest[:, None, None], 0.0, 1.0)
        return np.where(on.there[:, None], ends, 0.0)


@dataclass(frozen=True, eq=False)
class RegularDraws:
    """Regular outlines, as often as the readings make them likely.

    Attributes
    ----------
    ends
        l and u (K, 2, G) in the columns; both 0 outside.
    advantage
        Log evidence of the readings under all kinds, or what they had reached when they were given up, over the log
        likelihood of the best polygon; 0 would be much, for its free corners cost a polygon some `_OCCAM`.
    misfit
        Squared residuals over sigma^2 that the best one leaves, a reading: about 1 where noise explains them.
    """

    ends: FloatArray
    advantage: float
    misfit: float
    _seen: _Seen
    _outlines: _Outlines
    _lowest: FloatArray
    _half_chi_square: FloatArray

    def overlap(self, ends: FloatArray) -> FloatArray:
        """Return intersection over union (K,) of all with l and u (2, G)."""
        return column_iou(self.ends, ends)

    def commonest(self) -> int:
        """Return the outline that the others overlap best."""
        return int(np.argmax(column_iou(self.ends[:, None], self.ends[None]).sum(axis=1)))

    def outline(self, best: int) -> FamilyOutline:
        """Return one of the outlines as a model; the others at the same parts of their extents tell how sure it is."""
        seen, (left, right) = self._seen, self._extents()
        corners = self._corners(best, float(left[best]), float(right[best]))
        part = np.unique(np.concatenate([_DRAWN_AT, corners]))
        x = left[:, None] + (right - left)[:, None] * part
        ends = seen.ends(self._outlines, self._lowest, x)
        ends[:, 0] = np.minimum(ends[:, 0], ends[:, 1])
        chains = []
        for y in (ends[:, 0], ends[:, 1]):
            keep = _vertices(part, y[best])
            chain = np.stack([x[:, keep], y[:, keep]], axis=-1)
            chains.append((chain[best], (chain - chain[best]) / math.sqrt(len(chain))))
        (lower, lower_off), (upper, upper_off) = chains
        cost = 2.0 * float(self._half_chi_square[best])
        return FamilyOutline(_KINDS[self._outlines.kind[best]], lower, upper, lower_off, upper_off, cost)

    def _extents(self) -> tuple[FloatArray, FloatArray]:
        """Return between which x (K,) the outlines are seen, just within."""
        on, window = self._seen.placed(self._outlines, self._seen.x), self._seen.window
        left, right = np.maximum(on.left, window[0]), np.minimum(on.right, window[3])
        inside = 1e-7 * (right - left)
        return left + inside, right - inside

    def _corners(self, best: int, left: float, right: float) -> FloatArray:
        """Return at which parts of what is seen of an outline, from left to right, its edges begin and end."""
        one = self._outlines.at(np.array([best]))
        shape = (_Ovals if one.kind[0] < _UPRIGHT else _Polygons).of(one.kind, one.z)
        on, (first, last) = self._seen.placed(one, self._seen.x), shape.box[:2]
        x = on.left + (on.right - on.left) * (shape.marks[0] - first) / (last - first)
        part = np.round((x - left) / (right - left), 6)
        return np.asarray(part[(part > 0.0) & (part < 1.0)])


def draw_regular(
    problem: FitProblem,
    window: tuple[float, float, float, float],
    columns: FloatArray,
    least_chi_square: float,
    seed: int = 0,
) -> RegularDraws:
    """Draw regular outlines that explain the readings of one signature.

    Parameters
    ----------
    problem
        One signature's readings.
    window
        Between which x the left end lies, and the right one.
    columns
        Places (G,) where l and u are wanted.
    least_chi_square
        Of polygons a reading: kinds that cannot do as well are given up.
    seed
        0 or more.
    """
    random, seen = np.random.default_rng(seed), _Seen.of(problem, window)
    readings = max(int(np.count_nonzero(seen.weight)), 1)
    polygon = -0.5 * least_chi_square * readings
    done, given_up = _sampled(seen, random, polygon - _OCCAM)
    populations = done or given_up
    evidence = np.array([p.log_evidence + (math.log(_OVER) if p.over else 0.0) for p in populations])
    share = np.exp(evidence - evidence.max())
    log_evidence, share = float(np.log(share.sum()) + evidence.max()), share / share.sum()
    which, at = random.choice(len(populations), _KEPT, p=share), random.integers(_PARTICLES, size=_KEPT)
    kept = _Outlines(
        np.array([p.kind for p in populations])[which],
        np.array([p.over for p in populations])[which],
        np.stack([p.z for p in populations])[which, at],
    )
    _, half, lowest = seen.weighed(kept)
    misfit = 2.0 * min(float(p.misfit.min()) for p in populations) / readings
    return RegularDraws(
        seen.ends(kept, lowest, columns), log_evidence - polygon, misfit, seen, kept, lowest, half
    )


@dataclass(frozen=True, eq=False)
class _Population:
    """Particles of one kind: numbers (P, 8), half chi squares (P,), and the log evidence up to where it is."""

    kind: int
    over: bool
    z: FloatArray
    misfit: FloatArray
    log_evidence: float


def _sampled(
    seen: _Seen, random: np.random.Generator, best: float
) -> tuple[list[_Population], list[_Population]]:
    """Return populations of the posterior, and those given up on the way: by sequential Monte Carlo, all at once."""
    kind, over = np.repeat(np.arange(len(_KINDS)), 2), np.tile([False, True], len(_KINDS))
    free, count = np.array(_FREE)[kind] + 2.0, _FIRST * _PARTICLES
    z = random.random((len(kind), count, _NUMBERS))
    log, misfit = _weights(seen, kind, over, z)
    power, evidence, first = np.zeros(len(kind)), np.zeros(len(kind)), log
    done: list[_Population] = []
    given_up: list[_Population] = []
    for _ in range(_LEVELS):
        step, weight = _next_level(first, misfit, 1.0 - power)
        most = weight.max(axis=1, keepdims=True)
        share = np.exp(weight - most)
        evidence = evidence + most[:, 0] + np.log(share.mean(axis=1))
        share /= share.sum(axis=1, keepdims=True)
        power = np.minimum(power + step, 1.0)
        at = (random.random((len(kind), 1)) + np.arange(_PARTICLES)) / _PARTICLES
        at = np.minimum((at[:, :, None] > np.cumsum(share, axis=1)[:, None]).sum(axis=2), share.shape[1] - 1)
        z = np.take_along_axis(z, at[:, :, None], axis=1)
        log, misfit = (np.take_along_axis(v, at, axis=1) for v in (log, misfit))
        first = np.zeros_like(log)
        for _ in range(_SWEEPS):
            trial = _moved(z, random)
            trial_log, trial_misfit = _weights(seen, kind, over, trial)
            gain = trial_log - log - power[:, None] * (trial_misfit - misfit)
            taken = np.log(random.random(log.shape)) < gain
            z = np.where(taken[..., None], trial, z)
            log, misfit = np.where(taken, trial_log, log), np.where(taken, trial_misfit, misfit)
        finished = power > 1.0 - 1e-9
        best = max(best, evidence[finished].max(initial=-np.inf))
        # What is left to gain: misfits are above their least by 1/2 a number at this temperature, here twice that.
        hope = evidence - (1.0 - power) * np.maximum(misfit.min(axis=1) - free / power, 0.0)
        go_on = ~finished & (hope > best - _HOPELESS)
        for i in np.flatnonzero(~go_on):
            left = (1.0 - power[i]) * float(misfit[i].mean())
            of = _Population(int(kind[i]), bool(over[i]), z[i], misfit[i], float(evidence[i] - left))
            (done if finished[i] else given_up).append(of)
        kind, over, free, z, log, misfit, power, evidence, first = (
            v[go_on] for v in (kind, over, free, z, log, misfit, power, evidence, first)
        )
        if not len(kind):
            break
    return done, given_up


def _weights(seen: _Seen, kind: IntArray, over: BoolArray, z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return log prior and half chi square (C, P) of populations' numbers (C, P, 8)."""
    each = z.shape[1]
    log, misfit, _ = seen.weighed(
        _Outlines(np.repeat(kind, each), np.repeat(over, each), z.reshape(-1, _NUMBERS))
    )
    return log.reshape(z.shape[:2]), misfit.reshape(z.shape[:2])


def _next_level(log: FloatArray, misfit: FloatArray, left: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return by how much (C,) the likelihood's power rises so that half of the particles count, and log weights."""

    def count(step: FloatArray) -> FloatArray:
        weight = log - step[:, None] * misfit
        share = np.exp(weight - weight.max(axis=1, keepdims=True))
        return np.asarray(share.sum(axis=1) ** 2 / (share**2).sum(axis=1))

    low, high = np.full_like(left, 1e-12), left
    enough = count(left) >= _HALF * _PARTICLES
    for _ in range(25):
        half = 0.5 * (low + high)
        more = count(half) >= _HALF * _PARTICLES
        low, high = np.where(more, half, low), np.where(more, high, half)
    step = np.where(enough, left, low)
    return step, log - step[:, None] * misfit


def _moved(z: FloatArray, random: np.random.Generator) -> FloatArray:
    """Return other numbers (C, P, 8), by differences of two particles, or a few of them by any size."""
    several = z.shape[:2]
    a, b = (np.take_along_axis(z, random.integers(_PARTICLES, size=(*several, 1)), axis=1) for _ in range(2))
    differ = a - b
    differ[..., _TURN] = (differ[..., _TURN] + 0.5) % 1.0 - 0.5
    jump = np.exp(random.uniform(math.log(0.03), math.log(2.0), (*several, 1))) * differ
    jump += 1e-5 * random.normal(size=z.shape)
    size = np.exp(random.uniform(math.log(1e-3), math.log(0.5), (*several, 1)))
    few = (random.random(z.shape) < 0.3) * size * random.normal(size=z.shape)
    moved = z + np.where(random.random((*several, 1)) < 0.75, jump, few)
    turn, border = moved[..., _TURN] % 1.0, moved[..., _BORDER] % 1.0
    moved = np.abs(moved) % 2.0
    moved = np.where(moved > 1.0, 2.0 - moved, moved)
    moved[..., _TURN], moved[..., _BORDER] = turn, border
    return np.minimum(moved, 1.0 - 1e-12)


def _vertices(x: FloatArray, y: FloatArray) -> IntArray:
    """Return which points of a chain are off the line through the ones kept before and next, or are its ends."""
    kept = [0]
    for i in range(1, len(x) - 1):
        a, b = kept[-1], i + 1
        line = y[a] + (y[b] - y[a]) * (x[i] - x[a]) / (x[b] - x[a])
        if abs(y[i] - line) > _STRAIGHT * (y.max() - y.min() + _STRAIGHT):
            kept.append(i)
    return np.array([*kept, len(x) - 1])
