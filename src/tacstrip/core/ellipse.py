"""An ellipse as a rival of the polygon: five numbers explain a round contact, which no count of vertices fits best.

l and u are c + s t -+ b sqrt(1 - t^2), t from -1 to 1 over the contact: an ellipse in any position. From one
signature the polygon with the fewest vertices that explains an ellipse has a fifth of its area.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.core.binding import MAX_VERTICES, at, exported
from tacstrip.core.cost import terms
from tacstrip.core.polygon_fit import PolygonFit
from tacstrip.core.problem import FitProblem
from tacstrip.fisher import covariance
from tacstrip.sensor.spec import Sensor

_STEPS, _ENOUGH, _HOPE = 25, 1e-2, 4.0
_POINTS = 20  # interior points of either chain that draw it
_CHORD = np.pi / (_POINTS + 1)  # angle between two of them
_SAME_AREA = np.sqrt(_CHORD / np.sin(_CHORD))  # so much further out chords hold the ellipse's area
_STEEP = 0.03  # sqrt(1 - t^2) of the place nearest to an end where its slope is taken
_ALWAYS = 1e-9  # added to the normal matrix
_NEAR = 0.02  # of half a pitch: nearer to the inner bound of its window an end may step onto it
_PLACES, _REACH = 7, 4.0  # of an end's x that are integrated over, within so many deviations


@dataclass(frozen=True, eq=False)
class Ellipse:
    """An ellipse as outline model, in units of a `FitProblem`.

    Attributes
    ----------
    parameters
        Left end, right end, height c of the middle, rise s from there to the right end, half-height b (5,).
    cost
        Squared residuals over sigma^2, and what the prior of the ends' x adds.
    information
        J'J by the parameters (5, 5), the prior included.
    """

    parameters: FloatArray
    cost: float
    information: FloatArray

    @classmethod
    def fitted(cls, start: PolygonFit, problem: FitProblem) -> Ellipse:
        """Return the least-squares ellipse near an outline: `fit_ellipse`."""
        return fit_ellipse(start, problem)

    @property
    def n_parameters(self) -> int:
        """Numbers that the readings determine: three, for the ends' x have a prior."""
        return 3

    @property
    def kind(self) -> str:
        """What it is called."""
        return "ellipse"

    @property
    def complexity(self) -> int:
        """What it counts for in the criterion: one vertex."""
        return 1

    def residuals(self, problem: FitProblem) -> FloatArray:
        """Return measured minus fitted readings over sigma (S, n); 0 where a reading is left out."""
        left, right, c, s, b = self.parameters
        t = np.clip((2.0 * problem.x - left - right) / (right - left), -1.0, 1.0)
        middle, half = c + s * t, b * np.sqrt(1.0 - t * t)
        k = problem.readings_of(np.clip(middle - half, 0.0, 1.0), np.clip(middle + half, 0.0, 1.0))
        return np.asarray((problem.k - k) * problem.root_weight)

    def chains_mm(self, problem: FitProblem) -> tuple[FloatArray, FloatArray]:
        """Return lower and upper chain (22, 2) [mm], which together have 42 vertices."""
        left, right, c, s, b = self.parameters
        t, r = _drawn()
        x = 0.5 * (left + right) + 0.5 * (right - left) * t
        scale, origin = np.array((problem.width_mm, problem.length_mm)), (problem.origin_mm, 0.0)
        y = (np.clip(c + s * t + side * b * r, 0.0, 1.0) for side in (-1, 1))
        lower, upper = (np.stack([x, height], axis=1) * scale + origin for height in y)
        return lower, upper

    def covariance(self, problem: FitProblem, sensor: Sensor) -> FloatArray:
        """Return the covariance (84, 84) [mm^2] of the 42 vertices about the estimate.

        What touched strips leave of the ends' x is integrated over: heights bend with it by more than their slopes say.
        """
        return self._of_vertices(self._scatter(problem), problem)

    def disc_evidence(self, problem: FitProblem) -> float:
        """Return the log density, by slopes, of a disc's slant and ratio of axes; -inf where nothing is known of them.

        Ellipses of any slant and ratio have about 0 or less; what is a disc to a hundredth has 9.
        """
        left, right, _, rise, half = self.parameters
        width, height = 0.5 * (right - left) * problem.width_mm, half * problem.length_mm
        covariance = self._linear()
        if min(width, height) <= 0.0 or not np.isfinite(covariance).all():
            return -np.inf
        off = np.array([rise * problem.length_mm / width, np.log(height / width)])
        slopes = np.array([[0.0, 0.0, 0.0, problem.length_mm / width, 0.0], [1.0, -1.0, 0.0, 0.0, 0.0]])
        slopes[1] = slopes[1] / (right - left) + [0.0, 0.0, 0.0, 0.0, 1.0 / half]
        known = slopes @ covariance @ slopes.T
        return float(-0.5 * (off @ np.linalg.solve(known, off) + np.linalg.slogdet(known)[1]))

    def linear_covariance(self, problem: FitProblem, sensor: Sensor) -> FloatArray:
        """Return the covariance (84, 84) [mm^2] of the 42 vertices by slopes at the estimate."""
        return self._of_vertices(self._linear(), problem)

    def _of_vertices(self, of_parameters: FloatArray, problem: FitProblem) -> FloatArray:
        t, r = _drawn()
        t, r = np.concatenate([t, t[-2:0:-1]]), np.concatenate([-r, r[-2:0:-1]])  # (42,) counter-clockwise
        jacobian = np.zeros((len(t), 2, 5))
        jacobian[:, 0, 0], jacobian[:, 0, 1] = 0.5 * (1.0 - t), 0.5 * (1.0 + t)
        jacobian[:, 1, 2], jacobian[:, 1, 3], jacobian[:, 1, 4] = 1.0, t, r
        in_mm = (jacobian * np.array((problem.width_mm, problem.length_mm))[:, None]).reshape(-1, 5)
        return np.asarray(in_mm @ of_parameters @ in_mm.T)

    def _linear(self) -> FloatArray:
        value, vector = np.linalg.eigh(self.information)
        return covariance(np.sqrt(np.maximum(value, 0.0))[:, None] * vector.T)

    def _scatter(self, problem: FitProblem) -> FloatArray:
        """Return mean squared errors (5, 5) of the parameters: at places of both ends the best heights and theirs."""
        linear, half = self._linear(), 0.5 * problem.pitch
        reach = np.sqrt(linear.diagonal()[:2])
        from_x, to_x = (
            np.clip(self.parameters[:2] + side * _REACH * reach, *_window(half)) for side in (-1, 1)
        )
        if not np.isfinite(linear).all() or (to_x <= from_x).any():
            return linear
        node, part = np.polynomial.legendre.leggauss(_PLACES)
        at = 0.5 * (from_x + to_x)[:, None] + 0.5 * (to_x - from_x)[:, None] * node
        left, right = (x.reshape(-1, 1) for x in np.meshgrid(*at, indexing="ij"))  # (K, 1), K = _PLACES^2
        t = np.clip((2.0 * problem.x - left - right) / (right - left), -1.0, 1.0)
        r, one = np.sqrt(np.maximum(1.0 - t * t, 0.0)), np.ones_like(t)
        by_l, by_u = (np.stack([one, t, root], axis=1) for root in (-r, r))  # (K, 3, n)
        heights = np.tile(self.parameters[2:], (len(t), 1))

        def fit() -> tuple[FloatArray, FloatArray, FloatArray]:
            l, u = (np.clip((heights[:, None] @ by)[:, 0], 0.0, 1.0) for by in (by_l, by_u))
            ll, lu, uu, lr, ur, rr = (v[:, None] for v in terms(l, u, problem))
            matrix = (ll * by_l + lu * by_u) @ by_l.transpose(0, 2, 1)
            matrix += (lu * by_l + uu * by_u) @ by_u.transpose(0, 2, 1) + _ALWAYS * np.eye(3)
            return rr.sum(axis=2)[:, 0], matrix, (by_l * lr + by_u * ur).sum(axis=2)

        _, matrix, gradient = fit()
        heights += np.linalg.solve(matrix, gradient[..., None])[..., 0]
        heights[:, 2] = np.maximum(heights[:, 2], 0.0)
        cost, matrix, _ = fit()
        log = -0.5 * (cost + np.linalg.slogdet(matrix)[1])
        weight = np.outer(part, part).ravel() * np.exp(log - log.max())
        weight /= weight.sum()
        off = np.concatenate([left, right, heights], axis=1) - self.parameters
        found = (weight[:, None] * off).T @ off
        found[2:, 2:] += np.tensordot(weight, np.linalg.inv(matrix), axes=1)
        return np.asarray(found)


def _window(half: float) -> tuple[FloatArray, FloatArray]:
    """Return the least and greatest x (2,) of both ends: half a pitch to either side."""
    return np.array([-half, 1.0 - half]), np.array([half, 1.0 + half])


def _drawn() -> tuple[FloatArray, FloatArray]:
    """Return t and sqrt(1 - t^2) (22,) of the places that draw a chain, both larger by one factor.

    Together the places are the affine image of a regular polygon: area, centroid and orientation are the ellipse's.
    """
    angle = np.linspace(0.0, np.pi, _POINTS + 2)
    r = _SAME_AREA * np.sin(angle)
    r[[0, -1]] = 0.0
    return -_SAME_AREA * np.cos(angle), r


def fit_ellipse(start: PolygonFit, problem: FitProblem, wanted: float = np.inf) -> Ellipse:
    """Fit an ellipse by least squares from where a polygon was found; in vain if it cannot cost less than `wanted`."""
    core = exported("fit_ellipse")
    if core is None:
        return plain_fit_ellipse(start, problem, wanted)
    matrix = np.empty((5, 5))
    if start.n_interior > MAX_VERTICES:  # an ellipse's outline, from the scan before
        record, p = None, _begin(start)
    else:
        record, p = start.record, np.empty(5)
    cost: float = core(problem.compiled, None if record is None else at(record), wanted, at(p), at(matrix))
    return Ellipse(p, cost, matrix)


def plain_fit_ellipse(start: PolygonFit, problem: FitProblem, wanted: float = np.inf) -> Ellipse:
    """Do as `fit_ellipse`, in NumPy."""
    p = _begin(start)
    half, damping = 0.5 * problem.pitch, 1e-3
    cost, matrix, gradient = _normal_equations(p, problem)
    least, most = _window(half)
    for _ in range(_STEPS):
        small, step = matrix + np.diag(damping * matrix.diagonal() + _ALWAYS), gradient.copy()
        for i in np.flatnonzero(np.where(gradient[:2] < 0.0, p[:2] <= least, p[:2] >= most)):
            small[i], small[:, i], small[i, i], step[i] = 0.0, 0.0, 1.0, 0.0
        goal = p + np.linalg.solve(small, step)
        trial = np.clip(
            goal,
            (-half, _towards(1.0 - half, p[1], half), 0.0, -np.inf, 0.5 * p[4]),
            (_towards(half, p[0], half), 1.0 + half, 1.0, np.inf, 0.5),
        )
        on_its_way = (trial[:2] != goal[:2]).any()
        room = min(trial[2], 1.0 - trial[2])
        trial[3] = np.clip(trial[3], -room, room)
        new = _normal_equations(trial, problem)
        gain = cost - new[0]
        if gain >= 0.0:
            p = trial
            cost, matrix, gradient = new
            damping = max(0.1 * damping, 1e-9)
            if gain < _ENOUGH or (cost - _HOPE * gain > wanted and not on_its_way):
                break
        else:
            damping *= 8.0
            if damping > 1e8:
                break
    return Ellipse(p, cost, matrix)


def _towards(bound: float, at: float, half: float) -> float:
    """Return how near to the inner bound of its window an end may go: half of the way, and there when nearly there.

    Outer strips that the ellipse no longer covers would tell no more where it is.
    """
    middle = 0.5 * (at + bound)
    return bound if abs(bound - middle) < _NEAR * half else middle


def _normal_equations(p: FloatArray, problem: FitProblem) -> tuple[float, FloatArray, FloatArray]:
    left, right, c, s, b = p
    t = np.clip((2.0 * problem.x - left - right) / (right - left), -1.0, 1.0)
    r = np.sqrt(np.maximum(1.0 - t * t, 0.0))
    l = np.clip(c + s * t - b * r, 0.0, 1.0)
    u = np.minimum(np.maximum(c + s * t + b * r, l), 1.0)
    bend, one = b * t / np.maximum(r, _STEEP), np.ones_like(t)
    of_left, of_right = (t - 1.0) / (right - left), (-1.0 - t) / (right - left)
    slopes = ((s + bend, -r), (s - bend, r))
    by_l, by_u = (np.stack([by_t * of_left, by_t * of_right, one, t, root], axis=1) for by_t, root in slopes)
    ll, lu, uu, lr, ur, rr = terms(l, u, problem)
    matrix = by_l.T @ (ll[:, None] * by_l + lu[:, None] * by_u)
    matrix += by_u.T @ (lu[:, None] * by_l + uu[:, None] * by_u)
    prior, off = 12.0 / problem.pitch**2, p[:2] - (0.0, 1.0)
    matrix[[0, 1], [0, 1]] += prior
    gradient = by_l.T @ lr + by_u.T @ ur
    gradient[:2] -= prior * off
    return float(rr.sum() + prior * (off @ off)), matrix, gradient


def _begin(start: PolygonFit) -> FloatArray:
    """Return an ellipse (5,) where a polygon is."""
    l, u = start.ends(np.array([0.0, 0.25, 0.5, 0.75, 1.0]))
    middle = 0.5 * (l + u)
    rise, half = 0.5 * (middle[4] - middle[0]), min(max(0.5 * float((u - l).max()), 0.15), 0.4)
    return np.array([0.0, 1.0, min(max(middle.mean(), 0.05), 0.95), rise, half])
