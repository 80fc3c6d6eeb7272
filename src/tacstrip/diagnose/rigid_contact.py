"""One rigid outline that touches all strips, where it lay at each place, and each strip's constant error.

A contact that moves as a rigid body reads on several strips what three numbers a place explain. What one strip does
with time beyond that is far better known than against its two neighbours, whose bends hold the contact's shape.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse
from scipy.interpolate import BSpline
from scipy.linalg import cho_factor, cho_solve, cholesky, solve_triangular

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.diagnose.bend_model import Explanation
from tacstrip.diagnose.neighbour_prediction import WorkingCopy
from tacstrip.robust import robust_sigma
from tacstrip.sensor.closed_form import fraction, lower_and_width, reading_jacobian, sensing_share
from tacstrip.sensor.constructions import SIGNATURES

_VERTICES, _KNOTS = 24, 7  # of the outline; of the unevenness along a strip
_OWN = 2 + _KNOTS  # numbers of a channel: offset, gain, unevenness
_MOST_PLACES, _MOST_JOINED, _FEWEST_PLACES = 200, 600, 60  # of a half, of all, and of a half at least
_MOST_STRIPS = 40  # those of larger units lie closer: there bends are small
_ROUNDS, _ROUNDS_JOINED, _GAINED = 60, 25, 0.98  # when to stop
_STEPS = 0.5, 0.03, 0.1, 0.1  # least damping of x [pitch], y [L], angle; of a vertex [half the contact]
_LESS_DAMPED, _MORE_DAMPED, _LEAST_DAMPING, _WORSE = 0.35, 4.0, 0.03, 1.1
_MOST_STEP = 1.0, 0.1, 0.25  # of x [pitch], y [L], angle
_ROBUST = 2.5  # deviations, from which a reading loses weight (Cauchy)
_BLURRED = 0.01  # of a pitch: strips are straight no better than that, which counts on steep edges
_STEEPEST = 1.0  # L per pitch
_OFFSET, _GAIN, _UNEVEN = 0.02, 0.01, 0.01  # prior standard deviations over Vref, of 1, over L
_SMOOTH = 0.3  # of half the contact: prior standard deviation of a vertex from between its neighbours
_LOOSE = 30.0  # times `_STEPS`: prior standard deviation of a pose
_USUAL_HEIGHT = 0.27  # of L, where one signature does not tell
_MOVED = 1.0, 0.1  # pitches across and L along: standard deviations of a contact that shows its shape
_STILL, _STAYS = 2.5, 0.4  # deviations, that noise alone makes readings change; of the places
_PLACES_A_KNOT, _SHORT, _PAUSE = 4, 5, 4.0  # of a smooth path; places without one; times the usual step
_FREE = 0.05  # of L: what a contact leaves free at least

_Equations = tuple[sparse.csr_matrix, FloatArray, FloatArray, FloatArray]


@dataclass(eq=False)
class RigidContact:
    """The fit of an outline to places of a working copy.

    Attributes
    ----------
    place, strip
        The working copy's row and the place across of each strip that was used (rows,).
    sigma
        Robust standard deviation of what is left of the readings, over Vref.
    """

    work: WorkingCopy
    place: IntArray
    strip: IntArray
    sigma: float
    _pose_of: IntArray  # (rows,)
    _half: FloatArray  # half the contact's extent (2,) [mm]
    _outline: FloatArray  # (V, 2) [mm], in its own frame
    _poses: FloatArray  # x, y [mm], angle (P, 3)
    _constant: FloatArray  # (strips, channels, numbers)
    _path: sparse.csr_matrix | None = None  # (3 P, 3 C): poses of the numbers of a smooth path

    @classmethod
    def fit(cls, work: WorkingCopy, part: int = 0) -> RigidContact | None:
        """Fit evenly spread places, of one `part` (0 or 1) of them; None where there are too few, or too many strips.

        So it is where the contact mostly stays, and the fit's own errors repeat.

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
        outline = half * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        constant = np.zeros((work.strips, len(work.k), _OWN))
        fit = cls(work, rows[at], strip, np.inf, at, half, outline, poses, constant)
        return fit._converged(_ROUNDS)

    def joined(self) -> RigidContact:
        """Return the fit to all places, evenly spread, on a path that is smooth while the contact stays.

        Most of what three free numbers a place take away is given back to what strips do with time.
        """
        work, known, rows = self.work, *_usable(self.work)
        rows = rows[np.linspace(0, len(rows) - 1, min(_MOST_JOINED, len(rows))).astype(int)]
        at, strip = np.nonzero(known[rows])
        mine = np.zeros(len(self._poses), dtype=int)
        mine[self._pose_of] = self.place
        nearest = np.abs(work.time_s[rows, None] - work.time_s[mine]).argmin(axis=1)
        smooth = _smooth_path(work.time_s[rows])
        poses = smooth @ sparse.linalg.spsolve((smooth.T @ smooth).tocsc(), smooth.T @ self._poses[nearest])
        path = sparse.kron(smooth, sparse.identity(3), "csr")
        start = replace(self, place=rows[at], strip=strip, _pose_of=at, _poses=poses, _path=path)
        return start._converged(_ROUNDS_JOINED)

    def _converged(self, rounds: int) -> RigidContact:
        """Return the best of so many rounds; a fifth of them without a gain are the last."""
        fit = kept = self
        damping, sigmas = 1.0, list[float]()
        for round_ in range(rounds):
            equations = fit._equations()
            if fit.sigma > _WORSE * kept.sigma:
                fit, damping = kept, damping * _MORE_DAMPED
                equations = fit._equations()
            else:
                damping = max(damping * _LESS_DAMPED, _LEAST_DAMPING) if round_ > 2 else damping
            kept = fit if fit.sigma <= kept.sigma else kept
            sigmas.append(kept.sigma)
            if round_ > rounds // 5 and kept.sigma > _GAINED * sigmas[-(rounds // 5)]:
                break
            fit = fit._stepped(equations, damping)
        kept._equations()
        return kept

    @property
    def strips(self) -> int:
        """Number of strips."""
        return self.work.strips

    def moves(self) -> bool:
        """Whether the contact moved across and along."""
        return bool((self._poses[:, :2].std(axis=0) >= self._units[:2] * _MOVED).all())

    def part(self, number: int, of: int) -> slice:
        """Return the places of a part of the recording."""
        return slice(len(self._poses) * number // of, len(self._poses) * (number + 1) // of)

    def explain(self, change: FloatArray, trusted: int = -1, without: slice = slice(0, 0)) -> Explanation:
        """Return what changes of each strip's readings explain beyond outline, poses and constant errors.

        Parameters
        ----------
        change
            By the working copy's rows, several terms (places, terms); the columns are (strips * terms).
        trusted
            A strip of which no reading loses weight as an outlier: what it does is its change.
        without
            Places that do not count.
        """
        jacobian, left, weight, full = self._equations()
        counts = np.ones(len(self._poses))
        counts[without] = 0.0
        weight = np.where(np.repeat(self.strip == trusted, len(self.work.k)), full, weight)
        weight = weight * np.repeat(counts[self._pose_of], len(self.work.k))
        terms, many = change.shape[1], jacobian.shape[1] - self._poses.size
        strip = np.repeat(self.strip, len(self.work.k))
        column = strip[:, None] * terms + np.arange(terms)
        added = _sparse(
            np.repeat(change[self.place], len(self.work.k), axis=0), column, self.work.strips * terms
        )
        normal, right, _ = self._without_poses(sparse.hstack([jacobian, added], "csr"), left, weight, 0.0)
        prior, now = self._prior()
        root = cholesky(normal[:many, :many] + prior, lower=True, check_finite=False)
        beside = np.column_stack([normal[:many, many:], right[:many] - prior @ now])
        reduced = solve_triangular(root, beside, lower=True, check_finite=False)
        score = right[many:] - reduced[:, :-1].T @ reduced[:, -1]
        return Explanation(normal[many:, many:], score, reduced[:, :-1])

    def _stepped(self, equations: _Equations, damping: float) -> RigidContact:
        jacobian, left, weight, _ = equations
        normal, right, eliminated = self._without_poses(jacobian, left, weight, damping)
        prior, now = self._prior()
        normal += prior
        corner = np.arange(self._outline.size)
        normal[corner, corner] += damping * np.tile((self.sigma / (_STEPS[3] * self._half)) ** 2, _VERTICES)
        factor = cho_factor(normal, check_finite=False)
        step = cho_solve(factor, right - prior @ now, check_finite=False)
        most = np.array(_MOST_STEP) * self._units
        poses = self._poses + np.clip(eliminated(step), -most, most)
        outline = self._outline + step[corner].reshape(-1, 2)
        constant = self._constant + step[len(corner) :].reshape(self._constant.shape)
        return replace(self, _poses=poses, _outline=outline, _constant=constant)

    @property
    def _units(self) -> FloatArray:
        """What x, y and the angle are measured in."""
        return np.array([self.work.sensor.pitch_mm, self.work.sensor.length_mm, 1.0])

    def _equations(self) -> _Equations:
        """Return the readings' Jacobian (rows * channels, all), what is left of them, weights, and weights at most.

        And set `sigma`.
        """
        sensor, rows = self.work.sensor, len(self.strip)
        length = sensor.length_mm
        (l, *lower), (u, *upper) = self._ends()
        w = np.clip(u - l, 0.0, (1.0 - _FREE) * length)
        share, pose = sensing_share(sensor.sensing_ratio), 3 * self._pose_of[:, None] + np.arange(3)
        values, columns, left, blur = [], [], [], []
        for channel, (name, read) in enumerate(self.work.k.items()):
            at_upper = SIGNATURES[name].at_upper_end
            numerator, d = fraction(l, w, length, share if at_upper else 0.0, 1.0 - share)
            k = numerator / d
            to_l, to_u = reading_jacobian(k, w, length, at_upper, sensor.sensing_ratio)
            uneven = length * (to_l[:, None] * _hats(l / length) + to_u[:, None] * _hats(u / length))
            own = np.column_stack([np.ones(rows), k - 0.5, uneven])
            left.append(
                read[self.place, self.strip] - k - np.sum(own * self._constant[self.strip, channel], axis=1)
            )
            by_pose = to_l[:, None] * lower[0] + to_u[:, None] * upper[0]
            values.append(np.hstack([by_pose, to_l[:, None] * lower[1], to_u[:, None] * upper[1], own]))
            number = (self.strip * len(self.work.k) + channel)[:, None] * _OWN + np.arange(_OWN)
            first = self._poses.size
            columns.append(
                np.hstack([pose, first + lower[2], first + upper[2], first + self._outline.size + number])
            )
            blur.append((to_l * lower[3]) ** 2 + (to_u * upper[3]) ** 2)
        rest = np.stack(left, axis=1).ravel()
        self.sigma = max(float(robust_sigma(rest)), 0.5 * self.work.sigma)
        variance = 1.0 + np.stack(blur, axis=1).ravel() * (_BLURRED * sensor.pitch_mm / self.sigma) ** 2
        weight = 1.0 / (variance + (rest / (_ROBUST * self.sigma)) ** 2)
        many = self._poses.size + self._outline.size + self._constant.size
        value, column = (np.stack(v, axis=1).reshape(len(rest), -1) for v in (values, columns))
        return _sparse(value, column, many), rest, weight, 1.0 / variance

    def _ends(self) -> list[tuple[FloatArray, FloatArray, FloatArray, IntArray, FloatArray]]:
        """Return the lower and the upper end: y [mm], derivatives by pose, by corners, these' columns, the slope."""
        length, outline, poses = self.work.sensor.length_mm, self._outline, self._poses[self._pose_of]
        c, s = np.cos(poses[:, 2:]), np.sin(poses[:, 2:])
        x0, y0 = c * outline[:, 0] - s * outline[:, 1], s * outline[:, 0] + c * outline[:, 1]  # (rows, V)
        x1, y1 = np.roll(x0, -1, axis=1), np.roll(y0, -1, axis=1)
        across = (self.strip + 0.5) * self.work.sensor.pitch_mm - poses[:, 0]
        tiny = 1e-6 * self.work.sensor.pitch_mm
        x = np.clip(across, x0.min(axis=1) + tiny, x0.max(axis=1) - tiny)
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (x[:, None] - x0) / (x1 - x0)
            y, slopes = y0 + t * (y1 - y0), (y1 - y0) / (x1 - x0)
        crossed = (t >= 0.0) & (t <= 1.0)
        row, steepest, ends = np.arange(len(x)), _STEEPEST * length / self.work.sensor.pitch_mm, []
        for edge in (
            np.argmin(np.where(crossed, y, np.inf), axis=1),
            np.argmax(np.where(crossed, y, -np.inf), axis=1),
        ):
            share, here, slope = t[row, edge], y[row, edge], slopes[row, edge]
            # A strip beside the outline reads its outermost corner.
            bounded = np.where(x == across, np.clip(slope, -steepest, steepest), 0.0)
            place = here + poses[:, 1]
            free = ((place > 0.0) & (place < length)).astype(float)
            by_pose = np.stack([-bounded, np.ones_like(x), x + bounded * here], axis=1)
            by_x, by_y = s[:, 0] - bounded * c[:, 0], c[:, 0] + bounded * s[:, 0]
            by_corner = np.stack(
                [(1.0 - share) * by_x, (1.0 - share) * by_y, share * by_x, share * by_y], axis=1
            )
            corner = 2 * np.stack([edge, edge, (edge + 1) % _VERTICES, (edge + 1) % _VERTICES], axis=1) + [
                0,
                1,
                0,
                1,
            ]
            ends.append(
                (
                    np.clip(place, 0.0, length),
                    by_pose * free[:, None],
                    by_corner * free[:, None],
                    corner,
                    slope * free,
                )
            )
        return ends

    def _without_poses(
        self, jacobian: sparse.csr_matrix, left: FloatArray, weight: FloatArray, damping: float
    ) -> tuple[FloatArray, FloatArray, Callable[[FloatArray], FloatArray]]:
        """Return normal equations of all but the poses, and what gives these of a solution (P, 3)."""
        many = self._poses.size
        loose = (self.sigma / (np.array(_STEPS[:3]) * self._units)) ** 2 * (damping + _LOOSE**-2)
        if self._path is not None:
            jacobian = sparse.hstack([jacobian[:, :many] @ self._path, jacobian[:, many:]], "csr")
            many = self._path.shape[1]
        weighted = jacobian.T.multiply(weight).tocsr()
        normal, right = weighted @ jacobian, weighted @ left
        pose = np.arange(many).reshape(-1, 3)
        cross = np.column_stack([normal[:many, many:].toarray(), right[:many]])
        if self._path is None:
            sides = [[np.asarray(normal[pose[:, a], pose[:, b]])[0] for b in range(3)] for a in range(3)]
            blocks = np.moveaxis(np.array(sides), 2, 0) + np.diag(loose)
            solved = (np.linalg.inv(blocks) @ cross.reshape(len(pose), 3, -1)).reshape(many, -1)
        else:
            block = normal[:many, :many].toarray() + np.diag(np.tile(loose, len(pose)))
            solved = cho_solve(cho_factor(block, check_finite=False), cross, check_finite=False)
        beyond = np.column_stack([normal[many:, many:].toarray(), right[many:]]) - cross[:, :-1].T @ solved

        def poses(step: FloatArray) -> FloatArray:
            numbers = solved[:, -1] - solved[:, :-1] @ step
            return np.asarray(numbers if self._path is None else self._path @ numbers).reshape(-1, 3)

        return beyond[:, :-1], beyond[:, -1], poses

    def _prior(self) -> tuple[FloatArray, FloatArray]:
        """Return the precision of outline and constant errors, for readings of weight 1, and what these are."""
        corners, now = self._outline.size, np.concatenate([self._outline.ravel(), self._constant.ravel()])
        own = 1.0 / np.array([_OFFSET, _GAIN, *[_UNEVEN] * _KNOTS]) ** 2
        out = np.diag(np.concatenate([np.zeros(corners), np.tile(own, self._constant.size // _OWN)]))
        bend = np.eye(_VERTICES) - 0.5 * (
            np.roll(np.eye(_VERTICES), 1, 0) + np.roll(np.eye(_VERTICES), -1, 0)
        )
        for i, half in enumerate(self._half):
            out[i:corners:2, i:corners:2] = bend.T @ bend / (_SMOOTH * half) ** 2
        return out * self.sigma**2, now


def _usable(work: WorkingCopy) -> tuple[BoolArray, IntArray]:
    """Return which readings are known (places, strips), and the places with more of them than a pose has numbers."""
    known = np.asarray(np.isfinite(np.stack(list(work.k.values()))).all(axis=0))
    return known, np.flatnonzero(known.sum(axis=1) >= 4 - len(work.k))


def _smooth_path(time_s: FloatArray) -> sparse.csr_matrix:
    """Return cubic splines over time (places,) [s], of each stay of the contact (places, numbers)."""
    step = np.diff(time_s)
    parts = []
    for stay in np.split(time_s, np.flatnonzero((step > _PAUSE * np.median(step)) | (step < 0.0)) + 1):
        number = np.arange(len(stay), dtype=float)
        if len(stay) < _SHORT:
            parts.append(sparse.identity(len(stay)))
            continue
        along = stay if (np.diff(stay) > 0.0).all() else number
        # Places lie between any two knots.
        knots = np.interp(np.linspace(0.0, number[-1], len(stay) // _PLACES_A_KNOT + 1), number, along)
        parts.append(BSpline.design_matrix(along, np.pad(knots, 3, "edge"), 3))
    return sparse.block_diag(parts, "csr")


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


def _sparse(values: FloatArray, columns: IntArray, many: int) -> sparse.csr_matrix:
    """Return a matrix (rows, many) of some values in each row (rows, values), at columns that may be equal."""
    rows = np.repeat(np.arange(len(values)), values.shape[1])
    return sparse.coo_matrix((values.ravel(), (rows, columns.ravel())), (len(values), many)).tocsr()
