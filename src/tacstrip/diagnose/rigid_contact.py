"""One rigid outline that touches all strips, where it lay at each place, and each strip's constant error.

A contact that moves as a rigid body reads on several strips what three numbers a place explain. What one strip does
with time beyond that is far better known than against its two neighbours, whose bends hold the contact's shape.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import sparse
from scipy.interpolate import BSpline
from scipy.linalg import cho_factor, cho_solve, cholesky, cholesky_banded, solve_triangular
from scipy.linalg.lapack import dtbtrs

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.diagnose.bend_model import Explanation
from tacstrip.diagnose.neighbour_prediction import WorkingCopy
from tacstrip.robust import robust_sigma
from tacstrip.sensor.closed_form import fraction, lower_and_width, reading_jacobian, sensing_share
from tacstrip.sensor.constructions import SIGNATURES

_VERTICES, _KNOTS = 24, 7  # of the outline; of the unevenness along a strip
_OWN = 5 + _KNOTS  # numbers of a channel: offset, gain, share, unevenness
_MOST_PLACES, _MOST_JOINED, _FEWEST_PLACES = 200, 600, 60  # of a half, of all, and of a half at least
_MOST_STRIPS = 40  # those of larger units lie closer: there bends are small
_FREE_AT_FIRST = 2  # numbers of a channel: offset and gain, while outline and poses are searched for
_ROUNDS, _PATIENT, _GAINED = 40, 4, 0.98  # when to stop
_STEPS = 0.5, 0.03, 0.1, 0.1  # least damping of x [pitch], y [L], angle; of a vertex [half the contact]
_LESS_DAMPED, _MORE_DAMPED, _LEAST_DAMPING, _WORSE = 0.35, 4.0, 0.03, 1.1
_MOST_STEP = 1.0, 0.1, 0.25  # of x [pitch], y [L], angle
_ROBUST = 2.5  # deviations, from which a reading loses weight (Cauchy)
_TALL = 1.4  # times the contact's height, to start with: tilts of a tall one go the right way
_FITS_LOOSELY, _FITS = 5.0, 1.5  # times the noise that a start, and a fit, leave at the most
_BESIDE = 0.3  # of a pitch: how well an untouched strip beside a touched one tells where the contact ends
_BLURRED = 0.01  # of a pitch: strips are straight no better than that, which counts on steep edges
_STEEPEST = 1.0  # L per pitch
# Prior standard deviations of a channel's own: over Vref, of 1, of the share of a contact's resistance that the strip
# keeps, and over L of where contacts end on it and of its unevenness.
_OFFSET, _GAIN, _SHARE, _EDGE, _UNEVEN = 0.02, 0.01, 0.03, 0.003, 0.01
_SMOOTH = 0.3  # of half the contact: prior standard deviation of a vertex from between its neighbours
_LOOSE = 30.0  # times `_STEPS`: prior standard deviation of a pose
_USUAL_HEIGHT = 0.27  # of L, where one signature does not tell
_MOVED = 1.0, 0.1  # pitches across and L along: standard deviations of a contact that shows its shape
_STILL, _STAYS = 2.5, 0.4  # deviations, that noise alone makes readings change; of the places
_ORDER = 4  # of a smooth path's splines: so many numbers tell a pose
# Places a knot of a smooth path, of a half and of all; stays shorter than it; times the usual step between two stays.
_PLACES_A_KNOT, _PLACES_A_KNOT_OF_ALL, _SHORT, _PAUSE = 2, 3, 5, 4.0
_FREE = 0.05  # of L: what a contact leaves free at least
_SECOND_DIFFERENCES = np.eye(_VERTICES) - 0.5 * (
    np.roll(np.eye(_VERTICES), 1, 0) + np.roll(np.eye(_VERTICES), -1, 0)
)
_BEND = _SECOND_DIFFERENCES.T @ _SECOND_DIFFERENCES


@dataclass(frozen=True, eq=False)
class _Equations:
    """Readings linearised about a fit: a row for each strip touched at a place.

    The last channel is where the contact ends beside the row's strip, in units of which readings' noise is as likely.

    Attributes
    ----------
    shape
        Derivatives by the place's pose and by the outline (rows, channels, 3 + 2 V).
    own
        Those by the constant numbers of all channels of the row's strip (rows, channels, numbers).
    left, weight, most
        What is left of the readings over Vref, their weights, and the weights of no outlier (rows, channels).
    sigma
        Robust standard deviation of what is left, over Vref.
    """

    shape: FloatArray
    own: FloatArray
    left: FloatArray
    weight: FloatArray
    most: FloatArray
    sigma: float


@dataclass(frozen=True, eq=False)
class RigidContact:
    """The fit of an outline to places of a working copy.

    Attributes
    ----------
    place, strip
        The working copy's row and the place across of each strip that was used (rows,).
    """

    work: WorkingCopy
    place: IntArray
    strip: IntArray
    _pose_of: IntArray  # (rows,)
    _half: FloatArray  # half the contact's extent (2,) [mm]
    _outline: FloatArray  # (V, 2) [mm], in its own frame
    _poses: FloatArray  # x, y [mm], angle (P, 3)
    _constant: FloatArray  # (strips, channels, numbers)
    _path: sparse.csr_matrix  # (P, C): poses of the numbers of a smooth path
    _free: int  # numbers of a channel that are fitted, the first ones

    @classmethod
    def fit(cls, work: WorkingCopy, part: int = 0) -> RigidContact | None:
        """Fit evenly spread places, of one `part` (0 or 1) of them; None where there are too few, or too many strips.

        So it is where the contact mostly stays, and the fit's own errors repeat. Of each channel's own numbers only
        offset and gain are fitted: a start for `joined`. Its path is smooth while the contact stays: places with poses
        of their own end in wrong minima.

        Source: damped Gauss-Newton, iteratively reweighted, with poses eliminated place by place (Schur complement).
        """
        known, rows = _usable(work)
        if len(rows) < 2 * _FEWEST_PLACES or work.strips > _MOST_STRIPS:
            return None
        rows = rows[np.linspace(0, len(rows) - 1, min(2 * _MOST_PLACES, len(rows))).astype(int)[part::2]]
        if _stays(work, rows):
            return None
        at, strip = np.nonzero(known[rows])
        half, poses = _start(work, rows, known[rows])
        angle = 2.0 * np.pi * np.arange(_VERTICES) / _VERTICES
        circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        constant = np.zeros((work.strips, len(work.k), _OWN))
        path, poses = _smooth_path(work.time_s[rows], poses, _PLACES_A_KNOT)
        outline = half * (1.0, _TALL) * circle
        start = cls(work, rows[at], strip, at, half, outline, poses, constant, path, _FREE_AT_FIRST)
        return start._converged()

    def joined(self) -> RigidContact:
        """Return the fit of all numbers to all places, evenly spread."""
        work, (row, strip) = self.work, readings_joined(self.work)
        rows, at = np.unique(row, return_inverse=True)
        mine = np.zeros(len(self._poses), dtype=int)
        mine[self._pose_of] = self.place
        nearest = np.abs(work.time_s[rows, None] - work.time_s[mine]).argmin(axis=1)
        path, poses = _smooth_path(work.time_s[rows], self._poses[nearest], _PLACES_A_KNOT_OF_ALL)
        start = replace(self, place=row, strip=strip, _pose_of=at, _poses=poses, _path=path, _free=_OWN)
        return start._converged()

    @classmethod
    def of(cls, work: WorkingCopy, part: int) -> RigidContact | None:
        """Return the fit to all places that begins on one `part`; None where none leaves noise alone, or nothing moves.

        It is made once until readings change.
        """

        def made() -> RigidContact | None:
            half = cls.fit(work, part)
            if half is None or half.sigma > _FITS_LOOSELY * work.sigma or not half.moves():
                return None
            model = half.joined()
            return model if model.sigma <= _FITS * work.sigma else None

        return work.once(("outline", part), made)

    def _converged(self) -> RigidContact:
        """Return the best of some rounds; a few without a gain are the last."""
        fit = kept = self
        damping, sigmas = 1.0, list[float]()
        for round_ in range(_ROUNDS):
            if fit.sigma > _WORSE * kept.sigma:
                fit, damping = kept, damping * _MORE_DAMPED
            else:
                damping = max(damping * _LESS_DAMPED, _LEAST_DAMPING) if round_ > 2 else damping
            kept = fit if fit.sigma <= kept.sigma else kept
            sigmas.append(kept.sigma)
            if round_ > _PATIENT and kept.sigma > _GAINED * sigmas[-_PATIENT]:
                break
            fit = fit._stepped(damping)
        return kept

    @property
    def sigma(self) -> float:
        """Robust standard deviation of what is left of the readings, over Vref."""
        return self._equations.sigma

    @property
    def strips(self) -> int:
        """Number of strips."""
        return self.work.strips

    def moves(self) -> bool:
        """Whether the contact moved across and along."""
        return bool((self._poses[:, :2].std(axis=0) >= self._units[:2] * _MOVED).all())

    def half_apart(self, bridges: FloatArray) -> FloatArray:
        """Return what ties of sensing strips do, at heights over L: half of what two neighbours read apart, over Vref.

        A bridge ties v_h of contacts below it, and v_l of contacts above it. Of each row, by its strip being the left
        one of a pair and the right one (rows, channels, 2 * bridges).
        """
        (lower, *_), (upper, *_) = self._ends()
        length, out = self.work.sensor.length_mm, []
        row = np.full((len(self._poses), self.strips + 2), -1)
        row[self._pose_of, self.strip + 1] = np.arange(len(self.strip))
        expected = np.stack([read[self.place, self.strip] for read in self.work.k.values()], axis=1)
        expected = expected - self._equations.left[:, :-1]
        for side in (2, 0):
            other = row[self._pose_of, self.strip + side]
            half = np.where(other[:, None] >= 0, expected[other] - expected, 0.0) / 2.0
            below = np.maximum(upper, upper[other])[:, None] < bridges * length
            above = np.minimum(lower, lower[other])[:, None] > bridges * length
            tied = np.stack([below if SIGNATURES[n].at_upper_end else above for n in self.work.k], axis=1)
            out.append(half[:, :, None] * tied)
        return np.concatenate(out, axis=2)

    def part(self, number: int, of: int) -> slice:
        """Return the places of a part of the recording."""
        return slice(len(self._poses) * number // of, len(self._poses) * (number + 1) // of)

    def explain(self, change: FloatArray, trusted: int = -1, without: slice = slice(0, 0)) -> Explanation:
        """Return what changes of each strip's readings explain beyond outline, poses and constant errors.

        Parameters
        ----------
        change
            Of each row and channel, several terms (rows, channels or 1, terms); the columns are (strips * terms).
        trusted
            A strip of which no reading loses weight as an outlier: what it does is its change.
        without
            Places that do not count.
        """
        equations, terms = self._equations, change.shape[2]
        weight = np.where((self.strip == trusted)[:, None], equations.most, equations.weight)
        counts = np.ones(len(self._poses))
        counts[without] = 0.0
        weight = weight * counts[self._pose_of, None]
        changed = np.zeros((*weight.shape, terms))
        changed[:, :-1] = change
        own = np.concatenate([equations.own, changed], axis=2)
        normal, right, _ = self._without_poses(replace(equations, own=own, weight=weight), 0.0)
        # Those of outline and constant errors, then those of the changes.
        number = self._outline.size + np.arange(self.strips * own.shape[2]).reshape(self.strips, -1)
        first = np.concatenate([np.arange(self._outline.size), number[:, :-terms].ravel()])
        last = number[:, -terms:].ravel()
        precise, score = normal[np.ix_(first, first)], right[first]
        self._add_prior(precise, score)
        root = cholesky(precise, lower=True, check_finite=False)
        beside = np.column_stack([normal[np.ix_(first, last)], score])
        reduced = solve_triangular(root, beside, lower=True, check_finite=False)
        score = right[last] - reduced[:, :-1].T @ reduced[:, -1]
        return Explanation(normal[np.ix_(last, last)], score, reduced[:, :-1])

    def _stepped(self, damping: float) -> RigidContact:
        normal, right, eliminated = self._without_poses(self._equations, damping)
        self._add_prior(normal, right)
        corner = np.arange(self._outline.size)
        normal[corner, corner] += damping * np.tile((self.sigma / (_STEPS[3] * self._half)) ** 2, _VERTICES)
        factor = cho_factor(normal, check_finite=False)
        step = cho_solve(factor, right, check_finite=False)
        most = np.array(_MOST_STEP) * self._units
        poses = self._poses + np.clip(eliminated(step), -most, most)
        outline = self._outline + step[corner].reshape(-1, 2)
        constant = self._constant.copy()
        constant[:, :, : self._free] += step[len(corner) :].reshape(self.strips, -1, self._free)
        return replace(self, _poses=poses, _outline=outline, _constant=constant)

    @property
    def _units(self) -> FloatArray:
        """What x, y and the angle are measured in."""
        return np.array([self.work.sensor.pitch_mm, self.work.sensor.length_mm, 1.0])

    @cached_property
    def _equations(self) -> _Equations:
        sensor, length, channels = self.work.sensor, self.work.sensor.length_mm, len(self.work.k)
        (l, lower, slope_l), (u, upper, slope_u) = self._ends()
        w = np.clip(u - l, 0.0, (1.0 - _FREE) * length)
        share, hats = sensing_share(sensor.sensing_ratio), (_hats(l / length), _hats(u / length))
        shape, left, blur = [], [], []
        free = self._free
        own = np.zeros((len(self.strip), channels, channels * free))
        for channel, (name, read) in enumerate(self.work.k.items()):
            at_upper = SIGNATURES[name].at_upper_end
            numerator, d = fraction(l, w, length, share if at_upper else 0.0, 1.0 - share)
            k = numerator / d
            to_l, to_u = reading_jacobian(k, w, length, at_upper, sensor.sensing_ratio)
            uneven = length * (to_l[:, None] * hats[0] + to_u[:, None] * hats[1])
            by_share = (at_upper - k) * w / d * (sensor.sensing_ratio > 0.0)
            mine = np.column_stack([np.ones(len(k)), k - 0.5, by_share, length * to_l, length * to_u, uneven])
            own[:, channel, channel * free : (channel + 1) * free] = mine[:, :free]
            error = np.sum(mine * self._constant[self.strip, channel], axis=1)
            left.append(read[self.place, self.strip] - k - error)
            shape.append(to_l[:, None] * lower + to_u[:, None] * upper)
            blur.append((to_l * slope_l) ** 2 + (to_u * slope_u) ** 2)
        rest = np.stack(left, axis=1)
        sigma = max(float(robust_sigma(rest)), 0.5 * self.work.sigma)
        variance = 1.0 + np.stack(blur, axis=1) * (_BLURRED * sensor.pitch_mm / sigma) ** 2
        beside, by_sides, known = self._sides()
        units = sigma / (_BESIDE * sensor.pitch_mm)
        rest = np.column_stack([rest, units * beside])
        most = np.column_stack([1.0 / variance, known])
        weight = most / (1.0 + most * (rest / (_ROBUST * sigma)) ** 2)
        return _Equations(
            np.stack([*shape, units * by_sides], axis=1),
            np.pad(own, ((0, 0), (0, 1), (0, 0))),
            rest,
            weight,
            most,
            sigma,
        )

    def _sides(self) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return how far the outermost strips that it touches are from where the outline ends (rows,) [mm].

        Derivatives by pose and outline (rows, 3 + 2 V), and where that is known: on the outermost strip of a place, if
        the next one is untouched and the outline's corner on the sensor.
        """
        sensor, outline, row = self.work.sensor, self._outline, np.arange(len(self.strip))
        c, s = np.cos(self._poses[:, 2:]), np.sin(self._poses[:, 2:])
        x, y = c * outline[:, 0] - s * outline[:, 1], s * outline[:, 0] + c * outline[:, 1]
        off, known, by = np.zeros(len(row)), np.zeros(len(row), bool), np.zeros((len(row), 3 + outline.size))
        there = np.pad(self.work.there, ((0, 0), (1, 1)), constant_values=True)[self.place]
        for side, corner in ((0, x.argmin(axis=1)), (1, x.argmax(axis=1))):
            pose, at = self._pose_of, corner[self._pose_of]
            height = y[pose, at] + self._poses[pose, 1]
            here = ~there[row, self.strip + 2 * side] & (height > 0.0) & (height < sensor.length_mm)
            off[here] = ((self.strip + side) * sensor.pitch_mm - self._poses[pose, 0] - x[pose, at])[here]
            by[here] = 0.0  # of a strip touched alone, the right side counts
            by[here, 0], by[here, 2] = 1.0, -y[pose, at][here]
            by[row[here], 3 + 2 * at[here]], by[row[here], 4 + 2 * at[here]] = (
                c[pose[here], 0],
                -s[pose[here], 0],
            )
            known |= here
        return off, by, known

    def _ends(self) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
        """Return the lower and the upper end: y [mm], derivatives by pose and outline (rows, 3 + 2 V), the slope."""
        length, outline, many = self.work.sensor.length_mm, self._outline, _VERTICES
        c, s = np.cos(self._poses[:, 2:]), np.sin(self._poses[:, 2:])
        x0, y0 = c * outline[:, 0] - s * outline[:, 1], s * outline[:, 0] + c * outline[:, 1]  # (P, V)
        dx, dy = (np.roll(v, -1, axis=1) - v for v in (x0, y0))
        x0, y0, dx, dy, poses = (v[self._pose_of] for v in (x0, y0, dx, dy, self._poses))  # (rows, ...)
        c, s = c[self._pose_of, 0], s[self._pose_of, 0]
        across = (self.strip + 0.5) * self.work.sensor.pitch_mm - poses[:, 0]
        tiny = 1e-6 * self.work.sensor.pitch_mm
        x = np.clip(across, x0.min(axis=1) + tiny, x0.max(axis=1) - tiny)
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (x[:, None] - x0) / dx
            y = y0 + t * dy
        crossed = (t >= 0.0) & (t <= 1.0)
        row, steepest, ends = np.arange(len(x)), _STEEPEST * length / self.work.sensor.pitch_mm, []
        for edge in (
            np.argmin(np.where(crossed, y, np.inf), axis=1),
            np.argmax(np.where(crossed, y, -np.inf), axis=1),
        ):
            share, here, slope = t[row, edge, None], y[row, edge], dy[row, edge] / dx[row, edge]
            # A strip beside the outline reads its outermost corner.
            bounded = np.where(x == across, np.clip(slope, -steepest, steepest), 0.0)
            place = here + poses[:, 1]
            free = ((place > 0.0) & (place < length)).astype(float)
            derivatives = np.zeros((len(x), 3 + 2 * many))
            derivatives[:, :3] = np.stack([-bounded, np.ones_like(x), x + bounded * here], axis=1)
            by_corners, by_corner = (
                derivatives[:, 3:].reshape(-1, many, 2),
                np.stack([s - bounded * c, c + bounded * s], axis=1),
            )
            by_corners[row, edge], by_corners[row, (edge + 1) % many] = (
                (1.0 - share) * by_corner,
                share * by_corner,
            )
            ends.append((np.clip(place, 0.0, length), derivatives * free[:, None], slope * free))
        return ends

    def _without_poses(
        self, equations: _Equations, damping: float
    ) -> tuple[FloatArray, FloatArray, Callable[[FloatArray], FloatArray]]:
        """Return normal equations of all but the poses, outline first, and what gives these of a solution (P, 3)."""
        weight, by_pose, by_outline = equations.weight[:, :, None], *np.split(equations.shape, [3], axis=2)
        common = np.concatenate([by_outline, equations.left[:, :, None]], axis=2)
        corners, each = by_outline.shape[2], equations.own.shape[2]
        many = corners + self.strips * each
        shared = np.r_[:corners, many]  # of all strips; the right-hand side is the last column
        order = np.argsort(self.strip, kind="stable")
        edges = np.searchsorted(self.strip[order], np.arange(self.strips + 1))
        root = np.sqrt(weight[order])
        of_all, own = (root * part[order] for part in (common, equations.own))
        normal = np.zeros((many + 1, many + 1))
        normal[np.ix_(shared, shared)] = np.tensordot(of_all, of_all, ((0, 1), (0, 1)))
        for strip in range(self.strips):
            at, rows = corners + strip * each + np.arange(each), slice(edges[strip], edges[strip + 1])
            mine = own[rows].reshape((rows.stop - rows.start) * own.shape[1], each)
            normal[at[:, None], at] = mine.T @ mine
            product = of_all[rows].reshape(-1, len(shared)).T @ mine
            normal[shared[:, None], at], normal[at[:, None], shared] = product, product.T

        weighted = (weight * by_pose).transpose(0, 2, 1)
        first = np.flatnonzero(np.diff(self._pose_of, prepend=-1))
        places = len(first)
        total = sparse.csr_matrix((np.ones(len(order)), np.arange(len(order)), np.r_[first, len(order)]))
        blocks, by_shared = (
            (total @ (weighted @ part).reshape(len(order), -1)).reshape(places, 3, -1)
            for part in (by_pose, common)
        )
        by_own = np.zeros((places, 3, self.strips, each))
        by_own[self._pose_of, :, self.strip] = weighted @ equations.own
        cross = np.concatenate(
            [by_shared[:, :, :-1], by_own.reshape(places, 3, -1), by_shared[:, :, -1:]], axis=2
        )
        loose = (self.sigma / (np.array(_STEPS[:3]) * self._units)) ** 2 * (damping + _LOOSE**-2)
        path = self._path.toarray()
        bands = [
            np.tensordot(path[:, : path.shape[1] - d] * path[:, d:], blocks, (0, 0)) for d in range(_ORDER)
        ]
        bands[0] = bands[0] + np.diag(loose)
        root = cholesky_banded(_banded(bands), lower=True, check_finite=False)
        cross = (self._path.T @ cross.reshape(places, -1)).reshape(-1, many + 1)
        reduced = dtbtrs(root, cross, uplo="L")[0]
        normal -= reduced.T @ reduced

        def poses(step: FloatArray) -> FloatArray:
            right = reduced[:, -1:] - reduced[:, :-1] @ step[:, None]
            return np.asarray(self._path @ dtbtrs(root, right, uplo="L", trans="T")[0].reshape(-1, 3))

        return normal[:-1, :-1], normal[:-1, -1], poses

    def _add_prior(self, normal: FloatArray, right: FloatArray) -> None:
        """Add to normal equations what is known of outline and constant errors, where readings have weight 1."""
        corners, variance = self._outline.size, self.sigma**2
        for i, half in enumerate(self._half):
            precision = variance * _BEND / (_SMOOTH * half) ** 2
            normal[i:corners:2, i:corners:2] += precision
            right[i:corners:2] -= precision @ self._outline[:, i]
        constant = self._constant[:, :, : self._free]
        deviation = np.array([_OFFSET, _GAIN, _SHARE, _EDGE, _EDGE, *[_UNEVEN] * _KNOTS])[: self._free]
        own = np.tile(variance / deviation**2, constant.size // self._free)
        np.einsum("ii->i", normal)[corners:] += own
        right[corners:] -= own * constant.ravel()


def _usable(work: WorkingCopy) -> tuple[BoolArray, IntArray]:
    """Return which readings are known (places, strips), and the places with more of them than a pose has numbers."""
    known = np.asarray(np.isfinite(np.stack(list(work.k.values()))).all(axis=0))
    return known, np.flatnonzero(known.sum(axis=1) >= 4 - len(work.k))


def readings_joined(work: WorkingCopy) -> tuple[IntArray, IntArray]:
    """Return the row in the working copy and the strip of each reading of `RigidContact.joined` (rows,)."""
    known, rows = _usable(work)
    rows = rows[np.linspace(0, len(rows) - 1, min(_MOST_JOINED, len(rows))).astype(int)]
    at, strip = np.nonzero(known[rows])
    return rows[at], strip


def _smooth_path(
    time_s: FloatArray, poses: FloatArray, places_a_knot: int
) -> tuple[sparse.csr_matrix, FloatArray]:
    """Return cubic splines over time (places,) [s], of each stay of the contact (places, numbers), nearest to poses.

    And the poses (places, 3) that they give.
    """
    step = np.diff(time_s)
    parts = []
    for stay in np.split(time_s, np.flatnonzero((step > _PAUSE * np.median(step)) | (step < 0.0)) + 1):
        number = np.arange(len(stay), dtype=float)
        if len(stay) < _SHORT:
            parts.append(sparse.identity(len(stay)))
            continue
        along = stay if (np.diff(stay) > 0.0).all() else number
        # Places lie between any two knots.
        knots = np.interp(np.linspace(0.0, number[-1], len(stay) // places_a_knot + 1), number, along)
        parts.append(BSpline.design_matrix(along, np.pad(knots, _ORDER - 1, "edge"), _ORDER - 1))
    path = sparse.block_diag(parts, "csr")
    return path, path @ sparse.linalg.spsolve((path.T @ path).tocsc(), path.T @ poses)


def _stays(work: WorkingCopy, rows: IntArray) -> bool:
    """Whether readings change from one of these rows to the next by little more than noise, often."""
    change = np.diff(np.stack([values[rows] for values in work.k.values()]), axis=1)
    both = np.isfinite(change).sum(axis=(0, 2))
    still = np.nansum(change**2, axis=(0, 2)) < (_STILL * work.sigma) ** 2 * both
    return bool(still.mean() > _STAYS)


def _start(work: WorkingCopy, rows: IntArray, known: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Return half the contact's extent (2,) and poses (P, 3) to start from, at rows of the working copy."""
    pitch, length, last = work.sensor.pitch_mm, work.sensor.length_mm, work.strips - 1
    wide = float(np.quantile(known.sum(axis=1), 0.9)) * pitch
    left, right = known.argmax(axis=1), last - known[:, ::-1].argmax(axis=1)
    x = 0.5 * pitch * (left + right + 1)
    # Beyond the border lies the rest of it.
    x = np.where((left == 0) & (right < last), (right + 1) * pitch - 0.5 * wide, x)
    x = np.where((right == last) & (left > 0), left * pitch + 0.5 * wide, x)
    if work.pair is not None:
        kh, kl = (v[rows] for v in work.pair)
        both = lower_and_width(kh, kl, length, work.sensor.sensing_ratio)
        l, w = (np.where(known, v, np.nan) for v in both)
        bottom, top = np.nanmin(l, axis=1), np.nanmax(l + w, axis=1)
        high = float(np.quantile(np.nanmax(w, axis=1), 0.7))
        cut, end = top - bottom < 0.9 * high, 0.03 * length
        y = np.where(cut & (bottom < end), top - 0.5 * high, 0.5 * (bottom + top))
        y = np.where(cut & (top > length - end), bottom + 0.5 * high, y)
    else:
        (name, read), high = next(iter(work.k.items())), _USUAL_HEIGHT * length
        share = sensing_share(work.sensor.sensing_ratio)
        level = np.nanmedian(np.where(known, read[rows], np.nan), axis=1)
        y = level * (length - (1.0 - share) * high) + (0.5 - share * SIGNATURES[name].at_upper_end) * high
    return 0.5 * np.array([1.05 * wide, high]), np.stack([x, y, np.zeros(len(rows))], axis=1)


def _hats(y: FloatArray) -> FloatArray:
    """Return the weights of the inner knots (rows, knots) in linear interpolation at places y from 0 to 1 (rows,)."""
    return np.maximum(1.0 - np.abs(y[:, None] * (_KNOTS + 1) - np.arange(1, _KNOTS + 1)), 0.0)


def _banded(blocks: Sequence[FloatArray]) -> FloatArray:
    """Return the lower bands of a symmetric matrix by those of its blocks (n - d, 3, 3), each d below the diagonal."""
    out = np.zeros((3 * len(blocks), 3 * len(blocks[0])))
    for d, block in enumerate(blocks):
        for row, column in np.ndindex(3, 3):
            if (below := 3 * d + row - column) >= 0:
                out[below, column : 3 * len(block) : 3] = block[:, column, row]
    return out
