"""Levenberg-Marquardt on the CRS-CRP network: all l and u together, within their limits.

Most of the way is gone on a coarser mesh, from widths that bands tried on a rough one suggest.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.errors import ReadingError
from tacstrip.fisher import checked_sigma
from tacstrip.network.crp.constraints import constrained_step, rules
from tacstrip.network.crp.cramer_rao import Electrodes, used_columns
from tacstrip.network.crp.factored import Scan
from tacstrip.network.crp.mesh import SHORTEST, Mesh, Wiring
from tacstrip.sensor.spec import Sensor

_TRIED = (0.1, 0.25, 0.6, 0.9)  # of L: bands whose readings tell from how long a contact to start
_WIDTHS = (0.08, 0.6)  # of L: further starts, one width for all strips, where the first one ends badly
# Cells to a lambda, and rows, at the least: of the mesh to try bands on, and of that to go most of the way on.
_ROUGH, _COARSE, _FEWEST = 0.25, 0.5, 25
_COARSER = 4  # times fewer rows to go most of the way on
# What may be left to go [L], or to gain [of the cost]: on the coarser mesh, which is some 1e-3 L off itself, and in
# the end, where such a gain moves l and u by some 1e-4 of their standard errors.
_NEAR = 3e-4, 1e-3
_THERE = 1e-10, 1e-8
_SAME = 1e-5  # of the cost: two starts that differ by less ended alike
_ROUNDING = 1e-7  # of L: so short a step that brings no gain is the end
_DAMPING = 1e-3  # of the curvature, to begin with
_TINY = 1e-14  # of the largest curvature: what the readings do not tell at all
POOR_FIT = 5.0  # times sigma: a root mean square of what is left over that says a start ended badly


@dataclass(frozen=True, eq=False)
class Found:
    """Where a descent ended.

    Attributes
    ----------
    x
        l, then u, of the touched strips (2 T,) [mm].
    slope
        Of the readings (T E, 2 T), in units of sigma.
    cost
        Sum of squares of what is left over, in units of sigma.
    steps
        Networks that were factored.
    converged
        Whether what was left to go was too little to matter.
    """

    x: FloatArray
    slope: FloatArray
    cost: float
    steps: int
    converged: bool


class Problem:
    """The readings that are to be met; unknowns x = l, then u, of the touched strips (2 T,) [mm]."""

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
        self.sensor, self.wiring, self.sigma = sensor, wiring or Wiring(), checked_sigma(sigma)
        self.mesh = Mesh.of(sensor, rows)
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
        self.rules, self.least = rules(self.strip, sensor.length_mm, SHORTEST * sensor.length_mm, convex)

    def invert(self, most: int) -> Found:
        """Descend from one start after the other until one ends well; return the best, and all steps."""
        start, tried = self._likely_start()
        found = self._from(start, most - tried)
        steps = tried + found.steps
        for width in _WIDTHS:
            if found.converged and found.cost <= POOR_FIT**2 * self.readings.size:
                break
            again = self._from(self._band(width), most)
            same = np.isclose(again.cost, found.cost, rtol=_SAME, atol=0.0)
            found, steps = min(found, again, key=lambda f: f.cost), steps + again.steps
            if same and again.converged:
                break  # the readings are what is wrong
        return replace(found, steps=steps)

    def _likely_start(self) -> tuple[FloatArray, int]:
        """Return a start at which each strip reads about what it should, and the networks that this took.

        kh - kl grows with a contact's width, and (kh + kl) / 2 goes with its middle.
        """
        mesh = Mesh.of(self.sensor, min(self._rows(_ROUGH), self.mesh.rows))
        each = np.arange(len(self.strip))
        scans = (self._scan(mesh, self._band(width)) for width in _TRIED)
        kh, kl = np.stack([scan.readings()[each, self.own] for scan in scans], axis=1)  # each (bands, T)
        apart, middle = np.maximum.accumulate(kh - kl), 0.5 * (kh + kl)
        width, shift = np.empty((2, len(each)))
        for t in each:
            width[t] = np.interp(self.kh[t] - self.kl[t], [0.0, *apart[:, t]], [0.0, *_TRIED])
            shift[t] = 0.5 * (self.kh[t] + self.kl[t]) - np.interp(width[t], _TRIED, middle[:, t])
        return self._band(np.maximum(width, 0.5 * _TRIED[0]), shift), len(_TRIED)

    def _band(self, width: float | FloatArray, shift: float | FloatArray = 0.0) -> FloatArray:
        """Return ends about the middle that the readings give, shifted [L], of a width [L], within the limits."""
        length = self.sensor.length_mm
        middle = (0.5 * (self.kh + self.kl) + shift) * length
        x = np.concatenate([middle - 0.5 * width * length, middle + 0.5 * width * length])
        return x + constrained_step(np.eye(len(x)), np.zeros(len(x)), self.rules, self.least - self.rules @ x)

    def _scan(self, mesh: Mesh, x: FloatArray) -> Scan:
        return Scan(mesh, self.strip, mesh.hat_lengths(*np.split(x, 2)), self.wiring)

    def _left_over(self, scan: Scan) -> FloatArray:
        """Return what the readings leave over (T E,) in units of sigma."""
        model = np.take_along_axis(scan.readings(), self.columns, axis=1)
        return np.asarray(((model - self.readings) / self.sigma).ravel())

    def _rows(self, cells: float) -> int:
        """Return the rows of a mesh with so many cells to a lambda, at the least."""
        return max(int(np.ceil(cells * self.sensor.length_mm / self.sensor.contact_lambda_mm)), _FEWEST)

    def _from(self, x: FloatArray, most: int) -> Found:
        """Descend on the coarser mesh, where there is one, and finish on the full one."""
        rows = max(self.mesh.rows // _COARSER, self._rows(_COARSE))
        if rows > self.mesh.rows // 2:
            return self._descend(self.mesh, x, most, _THERE)
        coarse = self._descend(Mesh.of(self.sensor, rows), x, most // 2, _NEAR)
        found = self._descend(self.mesh, coarse.x, most - coarse.steps, _THERE, coarse.slope)
        return replace(found, steps=coarse.steps + found.steps)

    def _descend(
        self,
        mesh: Mesh,
        x: FloatArray,
        most: int,
        enough: tuple[float, float],
        borrowed: FloatArray | None = None,
    ) -> Found:
        """Go downhill until at most `enough` is left; the first step may borrow another mesh's slope."""
        scan = self._scan(mesh, x)
        left, slope = self._left_over(scan), borrowed
        steps, damping, before = 1, _DAMPING if borrowed is None else _DAMPING * 1e-3, 0.0
        while True:
            ours = slope is None
            if slope is None:
                slope = scan.jacobian(x, self.columns).reshape(left.size, -1) / self.sigma
            cost = float(left @ left)
            curvature, downhill = slope.T @ slope, -(slope.T @ left)
            scale = np.diag(curvature) + _TINY * np.diag(curvature).max()
            room, may_end = self.least - self.rules @ x, ours
            while True:
                step = constrained_step(curvature + damping * np.diag(scale), downhill, self.rules, room)
                moved = float(np.abs(step).max()) / self.sensor.length_mm
                after = float(np.sum((left + slope @ step) ** 2))
                # Steps go on to shrink at least as fast as they just did, so no more than this is left after it.
                ahead = moved * moved / max(moved, before)
                if may_end and (ahead <= enough[0] or cost - after <= enough[1] * cost):
                    return Found(x + step, slope, after, steps, True)
                if steps >= most:
                    return Found(x, slope, cost, steps, False)
                new_scan = self._scan(mesh, x + step)
                new_left = self._left_over(new_scan)
                steps += 1
                downwards = float(new_left @ new_left) < cost
                if downwards or not ours:
                    break
                if moved <= _ROUNDING:
                    return Found(x, slope, cost, steps, True)
                damping, may_end = damping * 10.0, False  # a step is now short for its damping
            if downwards:
                x, scan, left, before = x + step, new_scan, new_left, moved
                damping = max(damping * 0.1, 1e-12)
            slope = None
