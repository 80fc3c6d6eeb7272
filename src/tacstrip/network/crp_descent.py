"""Levenberg-Marquardt on the CRS-CRP network: all l and u together, within their limits."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.errors import ReadingError
from tacstrip.network.crp_bound import Electrodes, checked_sigma, used_columns
from tacstrip.network.crp_limits import constrained_step, rules
from tacstrip.network.crp_mesh import SHORTEST, Mesh, Wiring
from tacstrip.network.crp_scan import Scan
from tacstrip.sensor.spec import Sensor

_WIDTHS = (0.25, 0.08, 0.6)  # of L: starts, the later ones where the earlier ones end badly
_STILL = 1e-12  # of L: a step that counts as none
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
        Whether the last step was too small to matter.
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
        own = (0, 1) if electrodes == "own" else (self.strip, sensor.strips + self.strip)
        each = np.arange(len(self.strip))
        self.middle = 0.5 * (self.readings[each, own[0]] + self.readings[each, own[1]]) * sensor.length_mm
        self.rules, self.least = rules(self.strip, sensor.length_mm, SHORTEST * sensor.length_mm, convex)

    def invert(self, most: int) -> Found:
        """Descend from one start after the other until one ends well; return the best, and all steps."""
        found = self._descend(self._start(_WIDTHS[0]), most)
        for width in _WIDTHS[1:]:
            if found.converged and found.cost <= POOR_FIT**2 * self.readings.size:
                break
            again = self._descend(self._start(width), most)
            better, steps = min(found, again, key=lambda f: f.cost), found.steps + again.steps
            found = replace(better, steps=steps)
        return found

    def _start(self, width: float) -> FloatArray:
        half = 0.5 * width * self.sensor.length_mm
        x = np.concatenate([self.middle - half, self.middle + half])
        return x + constrained_step(np.eye(len(x)), np.zeros(len(x)), self.rules, self.least - self.rules @ x)

    def _left_over(self, x: FloatArray) -> tuple[Scan, FloatArray]:
        """Return the network at x, and what the readings leave over (T E,) in units of sigma."""
        low, high = np.split(x, 2)
        scan = Scan(self.mesh, self.strip, self.mesh.hat_lengths(low, high), self.wiring)
        model = np.take_along_axis(scan.readings(), self.columns, axis=1)
        return scan, ((model - self.readings) / self.sigma).ravel()

    def _descend(self, x: FloatArray, most: int) -> Found:
        still = _STILL * self.sensor.length_mm
        scan, left = self._left_over(x)
        steps, damping, converged = 1, 1e-3, False
        while True:
            slope = scan.jacobian(x, self.columns).reshape(left.size, -1) / self.sigma
            cost = float(left @ left)
            curvature, downhill = slope.T @ slope, -(slope.T @ left)
            scale = np.diag(curvature) + _TINY * np.diag(curvature).max()
            while not converged and steps < most:
                room = self.least - self.rules @ x
                step = constrained_step(curvature + damping * np.diag(scale), downhill, self.rules, room)
                moved = float(np.abs(step).max())
                new_scan, new_left = self._left_over(x + step)
                steps += 1
                gain = cost - float(new_left @ new_left)
                damping = max(damping * 0.1, 1e-12) if gain > 0.0 else damping * 10.0
                # Too small a step or gain to matter, or a small step that rounding made worse: done.
                converged = moved <= still or (moved <= 1e5 * still and gain <= 1e-10 * cost)
                if gain > 0.0:
                    break
            else:
                return Found(x, slope, cost, steps, converged)
            x, scan, left = x + step, new_scan, new_left
