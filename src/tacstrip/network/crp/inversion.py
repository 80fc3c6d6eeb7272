"""CRS-CRP inverted: l and u of all touched strips from what the sheet's electrodes read.

There is no closed form (3.3), and neighbours shift a reading by up to a tenth of Vref, so all strips are solved
together: Levenberg-Marquardt on the network itself with its adjoint Jacobian (`factored`), first on a coarser mesh,
started from bands that read about the same. Every step keeps to 0 <= l <= u <= L and, if asked to, to convex contacts.

A step d minimises d C d / 2 - f d under G d >= h. With C = R' R this is the point of a polyhedron that lies nearest
to the origin, which non-negative least squares finds: C. L. Lawson and R. J. Hanson, Solving Least Squares Problems
(1974), chapter 23, problem LDP.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.errors import ReadingError
from tacstrip.fisher import checked_sigma
from tacstrip.fisher import covariance as covariance_bound
from tacstrip.network.crp.cramer_rao import Electrodes, embed_touched, used_columns
from tacstrip.network.crp.factored import FactoredScan
from tacstrip.network.crp.mesh import SHORTEST, SheetMesh, Wiring
from tacstrip.sensor.spec import Sensor


def linear_constraints(
    strip: IntArray, length: float, shortest: float, convex: bool
) -> tuple[FloatArray, FloatArray]:
    """Return G (C, 2 T) and h (C,) of G x >= h for the ends x = l, then u, of the touched strips (T,).

    0 <= l, l + shortest <= u, u <= length; and, for convex contacts, l bends up only and u down only over any
    three strips in a row.
    """
    one = np.eye(len(strip))
    none = np.zeros_like(one)
    left = [np.hstack([one, none]), np.hstack([-one, one]), np.hstack([none, -one])]
    right = [np.zeros(len(strip)), np.full(len(strip), shortest), np.full(len(strip), -length)]
    if convex:
        inner = np.flatnonzero((np.diff(strip[:-1]) == 1) & (np.diff(strip[1:]) == 1))
        bend = one[inner] - 2.0 * one[inner + 1] + one[inner + 2] if len(inner) else none[:0]
        left += [np.hstack([bend, none[: len(inner)]]), np.hstack([none[: len(inner)], -bend])]
        right.append(np.zeros(2 * len(inner)))
    return np.concatenate(left), np.concatenate(right)


def constrained_step(
    curvature: FloatArray, descent: FloatArray, constraints: FloatArray, limits: FloatArray
) -> FloatArray:
    """Return the d that minimises d C d / 2 - f d under G d >= h.

    Parameters
    ----------
    curvature, descent
        C (N, N), positive definite, and f (N,).
    constraints, limits
        G (constraints, N) and h (constraints,); at least one d must satisfy them.
    """
    from scipy.linalg import cholesky, solve_triangular
    from scipy.optimize import nnls

    scale = 1.0 / np.sqrt(np.diag(curvature))
    root = cholesky(curvature * np.outer(scale, scale))  # upper
    free = solve_triangular(root, descent * scale, trans="T")
    step = scale * solve_triangular(root, free)
    if np.all(constraints @ step >= limits):
        return np.asarray(step)
    # In z = R d / scale - free: the nearest point to the origin with G z >= h.
    tilted = solve_triangular(root, (constraints * scale).T, trans="T").T
    norm = np.linalg.norm(tilted, axis=1)
    tilted, lack = tilted / norm[:, None], (limits - constraints @ step) / norm
    far = np.abs(lack[lack > 0.0]).max()
    system = np.vstack([tilted.T, lack / far])
    aim = np.zeros(len(system))
    aim[-1] = 1.0
    weight, _ = nnls(system, aim, maxiter=10 * len(lack))
    rest = system @ weight - aim
    z = -rest[:-1] / rest[-1] * far
    return np.asarray(scale * solve_triangular(root, free + z))


_TRIAL_WIDTHS = (0.1, 0.25, 0.6, 0.9)  # of L: bands whose readings tell from how long a contact to start
_WIDTHS = (0.08, 0.6)  # of L: further starts, one width for all strips, where the first one ends badly
# Least cells per lambda of the mesh to try bands on and of the coarser one, and least rows of both.
_ROUGH, _COARSE, _FEWEST = 0.25, 0.5, 25
_COARSER = 4  # times fewer rows on the coarser mesh
# Distance [L] or gain [of the cost] that may remain: on the coarser mesh, which is some 1e-3 L off itself, and in
# the end, where such a gain moves l and u by some 1e-2 of their standard errors; short contacts would creep on.
_COARSE_TOLERANCE = 3e-4, 1e-3
_FINAL_TOLERANCE = 1e-10, 1e-6
_SAME = 1e-5  # of the cost: two starts that differ by less ended alike
_ROUNDING = 1e-7  # of L: so short a step that brings no gain is the end
_DAMPING = 1e-3  # of the curvature, to begin with
_TINY = 1e-14  # of the largest curvature: a direction that the readings do not identify
POOR_FIT = 5.0  # times sigma: a root mean square of residuals that says a start ended badly


@dataclass(frozen=True, eq=False)
class DescentResult:
    """Where a descent ended.

    Attributes
    ----------
    x
        l, then u, of the touched strips (2 T,) [mm].
    jacobian
        Of the readings (T E, 2 T), in units of sigma.
    cost
        Sum of squares of the residuals, in units of sigma.
    steps
        Networks that were factored.
    converged
        Whether the remaining distance or gain was within tolerance.
    """

    x: FloatArray
    jacobian: FloatArray
    cost: float
    steps: int
    converged: bool


class InversionProblem:
    """Least squares of the readings; unknowns x = l, then u, of the touched strips (2 T,) [mm]."""

    def __init__(
        self,
        sensor: Sensor,
        readings: FloatArray,
        electrodes: Electrodes,
        sigma: float,
        convex: bool,
        rows: int | None,
        wiring: Wiring | None,
    ) -> None:
        self.sensor, self.sigma = sensor, checked_sigma(sigma)
        self.mesh = SheetMesh.of(sensor, rows, wiring)
        there = np.isfinite(readings)
        self.strip = np.flatnonzero(there.any(axis=1))
        broken = np.flatnonzero((there.any(axis=1) != there.all(axis=1)) | np.isinf(readings).any(axis=1))
        if len(broken):
            raise ReadingError(
                f"strip {broken[0]}: some readings are finite and some are not; give all or none"
            )
        if not len(self.strip):
            raise ReadingError("no strip reads a contact: there is nothing to invert")
        self.readings = readings[self.strip]
        self.columns = used_columns(sensor, self.strip, electrodes)
        # Of each strip's own electrodes, at y = L and y = 0: columns of a scan's readings (2, T), and what was read.
        self.own = np.stack([sensor.strips + self.strip, self.strip])
        among = np.argmax(self.columns == self.own[:, :, None], axis=2)
        self.kh, self.kl = np.take_along_axis(self.readings, among.T, axis=1).T
        length = sensor.length_mm
        self.constraints, self.limits = linear_constraints(self.strip, length, SHORTEST * length, convex)

    def invert(self, max_networks: int) -> DescentResult:
        """Descend from one start after the other until one ends well; return the best, and all steps."""
        start, tried = self._initial()
        found = self._descend_twice(start, max_networks - tried)
        steps = tried + found.steps
        for width in _WIDTHS:
            if found.converged and found.cost <= POOR_FIT**2 * self.readings.size:
                break
            again = self._descend_twice(self._uniform_width(width), max_networks)
            same = np.isclose(again.cost, found.cost, rtol=_SAME, atol=0.0)
            found, steps = min(found, again, key=lambda f: f.cost), steps + again.steps
            if same and again.converged:
                break  # the readings are what is wrong
        return replace(found, steps=steps)

    def _initial(self) -> tuple[FloatArray, int]:
        """Return a start at which each strip reads about what it should, and the networks that this took.

        kh - kl grows with a contact's width, and (kh + kl) / 2 goes with its middle.
        """
        mesh = self._coarse(min(self._mesh_rows(_ROUGH), self.mesh.rows))
        each = np.arange(len(self.strip))
        scans = (self._scan(mesh, self._uniform_width(width)) for width in _TRIAL_WIDTHS)
        kh, kl = np.stack([scan.readings()[each, self.own] for scan in scans], axis=1)  # each (bands, T)
        difference, middle = np.maximum.accumulate(kh - kl), 0.5 * (kh + kl)
        width, shift = np.empty((2, len(each)))
        for t in each:
            width[t] = np.interp(self.kh[t] - self.kl[t], [0.0, *difference[:, t]], [0.0, *_TRIAL_WIDTHS])
            shift[t] = 0.5 * (self.kh[t] + self.kl[t]) - np.interp(width[t], _TRIAL_WIDTHS, middle[:, t])
        return self._uniform_width(np.maximum(width, 0.5 * _TRIAL_WIDTHS[0]), shift), len(_TRIAL_WIDTHS)

    def _uniform_width(self, width: float | FloatArray, shift: float | FloatArray = 0.0) -> FloatArray:
        """Return ends about the middle that the readings give, shifted [L], of a width [L], within the limits."""
        length = self.sensor.length_mm
        middle = (0.5 * (self.kh + self.kl) + shift) * length
        x = np.concatenate([middle - 0.5 * width * length, middle + 0.5 * width * length])
        slack = self.limits - self.constraints @ x
        return x + constrained_step(np.eye(len(x)), np.zeros(len(x)), self.constraints, slack)

    def _coarse(self, rows: int) -> SheetMesh:
        return SheetMesh.of(self.sensor, rows, self.mesh.wiring, coarse=True)

    def _scan(self, mesh: SheetMesh, x: FloatArray) -> FactoredScan:
        return FactoredScan(mesh, self.strip, mesh.hat_lengths(*np.split(x, 2)))

    def _residual(self, scan: FactoredScan) -> FloatArray:
        """Return the residuals, predicted less measured readings (T E,), in units of sigma."""
        model = np.take_along_axis(scan.readings(), self.columns, axis=1)
        return np.asarray(((model - self.readings) / self.sigma).ravel())

    def _mesh_rows(self, cells: float) -> int:
        """Return the rows of a mesh with so many cells to a lambda, at least 25."""
        return max(int(np.ceil(cells * self.sensor.length_mm / self.sensor.contact_lambda_mm)), _FEWEST)

    def _descend_twice(self, x: FloatArray, max_networks: int) -> DescentResult:
        """Descend on the coarser mesh, where there is one, and finish on the full one."""
        rows = max(self.mesh.rows // _COARSER, self._mesh_rows(_COARSE))
        if rows > self.mesh.rows // 2:
            return self._descend(self.mesh, x, max_networks, _FINAL_TOLERANCE)
        coarse = self._descend(self._coarse(rows), x, max_networks // 2, _COARSE_TOLERANCE)
        left = max_networks - coarse.steps
        found = self._descend(self.mesh, coarse.x, left, _FINAL_TOLERANCE, coarse.jacobian)
        return replace(found, steps=coarse.steps + found.steps)

    def _descend(
        self,
        mesh: SheetMesh,
        x: FloatArray,
        max_networks: int,
        tolerance: tuple[float, float],
        coarse_jacobian: FloatArray | None = None,
    ) -> DescentResult:
        """Descend to within `tolerance`; the first step may use the Jacobian of a coarser mesh."""
        scan = self._scan(mesh, x)
        residual, jacobian = self._residual(scan), coarse_jacobian
        steps, damping, last_size = 1, _DAMPING if coarse_jacobian is None else _DAMPING * 1e-3, 0.0
        while True:
            exact = jacobian is None
            if jacobian is None:
                jacobian = scan.jacobian(x, self.columns).reshape(residual.size, -1) / self.sigma
            cost = float(residual @ residual)
            curvature, descent = jacobian.T @ jacobian, -(jacobian.T @ residual)
            scale = np.diag(curvature) + _TINY * np.diag(curvature).max()
            slack, may_stop = self.limits - self.constraints @ x, exact
            while True:
                damped = curvature + damping * np.diag(scale)
                step = constrained_step(damped, descent, self.constraints, slack)
                step_size = float(np.abs(step).max()) / self.sensor.length_mm
                predicted_cost = float(np.sum((residual + jacobian @ step) ** 2))
                # Steps go on to shrink at least as fast as they just did, so no more than this remains after this one.
                remaining = step_size * step_size / max(step_size, last_size)
                if may_stop and (remaining <= tolerance[0] or cost - predicted_cost <= tolerance[1] * cost):
                    return DescentResult(x + step, jacobian, predicted_cost, steps, True)
                if steps >= max_networks:
                    return DescentResult(x, jacobian, cost, steps, False)
                new_scan = self._scan(mesh, x + step)
                new_residual = self._residual(new_scan)
                steps += 1
                improved = float(new_residual @ new_residual) < cost
                if improved or not exact:
                    break
                if step_size <= _ROUNDING:
                    return DescentResult(x, jacobian, cost, steps, True)
                damping, may_stop = damping * 10.0, False  # a step is now short for its damping
            if improved:
                x, scan, residual, last_size = x + step, new_scan, new_residual, step_size
                damping = max(damping * 0.1, 1e-12)
            jacobian = None


StripStatus: TypeAlias = Literal["ok", "no contact", "short contact", "not converged"]

SHORT = 0.05  # of L: below, l and u are poorly known one by one, only their middle is well known


@dataclass(frozen=True, eq=False)
class InversionResult:
    """The l and u of one scan, with their uncertainty.

    Attributes
    ----------
    l, u
        Ends of the contact (strips,) [mm]; NaN on untouched strips.
    covariance
        Of l of all strips, then u of all strips (2 strips, 2 strips) [mm^2]: the inverse of the Fisher information
        of the readings at l and u, without constraints, and the mesh's own error; NaN on untouched strips.
    status
        Per strip: "ok", "no contact", "short contact" (w < 5 % of L) or "not converged".
    advice
        In words, what to do; empty when all is well.
    iterations
        Networks that were factored, those of coarser meshes included.
    residual_rms
        Root mean square of the residuals, in units of sigma: about 1, or 0 with own electrodes,
        where there are as many readings as unknowns.
    """

    l: FloatArray
    u: FloatArray
    covariance: FloatArray
    status: tuple[StripStatus, ...]
    advice: str
    iterations: int
    residual_rms: float


def invert(
    sensor: Sensor,
    kh: FloatArray,
    kl: FloatArray,
    sigma: float = 1e-3,
    convex: bool = False,
    rows: int | None = None,
    wiring: Wiring | None = None,
    max_networks: int = 60,
) -> InversionResult:
    """Find l and u of all strips from each strip's own two electrodes.

    Parameters
    ----------
    sensor
        The sensor; what matters most is a right `contact_lambda_mm`.
    kh, kl
        Readings at y = L and y = 0 while each strip is energised (strips,) [Vref]; NaN where untouched.
    sigma
        Standard deviation of a reading's noise [Vref]; it scales covariance and residual_rms, not l and u.
    convex
        Whether each run of touched strips is taken for one convex contact: l(x) bends up only, u(x) down only.
    rows, wiring
        Cells of the mesh over the length, by default 4 per lambda, 100 to 400; what the other strips and the sheet's
        edges are joined to, nothing by default.
    max_networks
        Networks to factor at most, for each of three starts.

    Raises
    ------
    SpecError
        The sensor cannot be: ratio or lambda is not above 0.
    ReadingError
        No strip reads a contact, or shapes or NaN do not fit.
    """
    kh, kl = np.asarray(kh, dtype=float), np.asarray(kl, dtype=float)
    if kh.shape != (sensor.strips,) or kl.shape != (sensor.strips,):
        raise ReadingError(f"kh and kl have shapes {kh.shape} and {kl.shape}; give two of ({sensor.strips},)")
    readings = np.stack([kh, kl], axis=1)
    return _invert(InversionProblem(sensor, readings, "own", sigma, convex, rows, wiring), max_networks)


def invert_all(
    sensor: Sensor,
    readings: FloatArray,
    sigma: float = 1e-3,
    convex: bool = False,
    rows: int | None = None,
    wiring: Wiring | None = None,
    max_networks: int = 60,
) -> InversionResult:
    """Find l and u of all strips from all electrodes, read while each strip is energised.

    `readings` (strips, 2 strips) [Vref] are in the order of `contact_electrodes`, a row of NaN where a strip is
    untouched. The rest is as for `invert`.
    """
    readings = np.asarray(readings, dtype=float)
    if readings.shape != (sensor.strips, 2 * sensor.strips):
        raise ReadingError(
            f"readings have shape {readings.shape}; give ({sensor.strips}, {2 * sensor.strips}): "
            "all electrodes at y = 0, then all at y = L, a row per energised strip"
        )
    return _invert(InversionProblem(sensor, readings, "all", sigma, convex, rows, wiring), max_networks)


def _invert(problem: InversionProblem, max_networks: int) -> InversionResult:
    found, strips, length = problem.invert(max_networks), problem.sensor.strips, problem.sensor.length_mm
    l, u = np.full((2, strips), np.nan)
    l[problem.strip], u[problem.strip] = np.split(found.x, 2)
    own = covariance_bound(found.jacobian) + problem.mesh.error_mm**2 * np.eye(len(found.x))
    bound = embed_touched(own, problem.strip, strips)
    residual_rms = float(np.sqrt(found.cost / problem.readings.size))
    status = _statuses(l, u, length, found.converged)
    return InversionResult(l, u, bound, status, _advice(status, residual_rms), found.steps, residual_rms)


def _statuses(l: FloatArray, u: FloatArray, length: float, converged: bool) -> tuple[StripStatus, ...]:
    touched: list[StripStatus] = ["ok", "short contact"] if converged else ["not converged"] * 2
    return tuple("no contact" if np.isnan(w) else touched[int(w < SHORT * length)] for w in u - l)


def _advice(status: Sequence[StripStatus], residual_rms: float) -> str:
    lines = []
    if "not converged" in status:
        lines.append(
            "the iteration stopped early; try a larger `max_networks`, or check contact_lambda_mm and the ratio"
        )
    elif residual_rms > POOR_FIT:
        lines.append(
            f"the model misses the readings by {residual_rms:.3g} sigma; check contact_lambda_mm, "
            "resistivity_ratio and sigma"
        )
    if short := status.count("short contact"):
        lines.append(
            f"{short} strips have a contact shorter than 5 % of their length: only its middle is well known"
        )
    return "\n".join(lines)
