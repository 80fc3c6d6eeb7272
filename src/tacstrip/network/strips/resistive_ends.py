"""Where a contact on a thin strip would end that reads the same as one on a wide strip, with contact resistance.

The difference d of both layers' potentials obeys div grad d = d / lambda^2 under the contact and 0 beside it
(`resolved`); a field of 1 enters at one bar and leaves at the other, so d is L - u' at the upper bar and -l' at the
lower one, for the ideal contact on a thin strip that reads the same; `transfer_length` leads on to one of the same
lambda. One factor of that sheet gives both, and the potentials of a unit current into either bar: where the edge
moves outwards by n, l' or u' moves by the integral along the edge of d, that potential and n over lambda^2.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from scipy.linalg import solveh_banded

from tacstrip.arrays import FloatArray
from tacstrip.network.strips.resolved import Cells, cells, on_strip
from tacstrip.sensor.closed_form import width_from_ideal

_FEWEST, _MOST, _PER_LAMBDA = 12, 96, 4  # cells across
_POINTS = 2.0  # of the quadrature along edges, a cell
_SHORTEST = 1e-9  # of the width
_NEAR = 0.02  # of the width and of lambda: what vertices may move by, for ends off by some 1e-5 of L


@dataclass(frozen=True, eq=False)
class ResistiveEnds:
    """A contact on one strip.

    Attributes
    ----------
    ends
        l and u (2,) [mm] on a thin strip of the same lambda.
    """

    ends: FloatArray
    _lambda: float
    _reach: float  # of the slopes [mm]
    _vertices: FloatArray
    _grid: Cells
    _pull: FloatArray  # what either end moves by, a unit of area that is added (2, rows, columns) [1/mm]

    @classmethod
    def of(
        cls, vertices: FloatArray, x_mm: float, width_mm: float, length_mm: float, lambda_mm: float
    ) -> ResistiveEnds | None:
        """Return a polygon (V, 2) [mm] on a strip with its centre line at `x_mm`; None where it is off it."""
        contact = on_strip([shapely.Polygon(vertices)], x_mm, width_mm, length_mm)
        if contact.is_empty:
            return None
        across = int(np.clip(_PER_LAMBDA * width_mm / lambda_mm, _FEWEST, _MOST))
        grid = cells(contact, x_mm, width_mm, length_mm, across, min(width_mm, lambda_mm))
        lower, upper = _fed_bars(grid, grid.shares(contact) / lambda_mm**2)
        d = width_mm * (upper - lower)
        low, high = -d[0, 0], length_mm - d[-1, 0]
        wide = width_from_ideal(np.array([max(high - low, _SHORTEST * width_mm)]), lambda_mm)
        ends = 0.5 * (low + high + np.array([-1.0, 1.0]) * wide)
        pull = np.stack([lower, upper]) * d / lambda_mm**2
        return cls(ends, lambda_mm, _NEAR * min(width_mm, lambda_mm), vertices, grid, pull)

    def moved(self, vertices: FloatArray) -> FloatArray | None:
        """Return the ends (2,) [mm] of vertices (V, 2) [mm], by slopes; None where they are too far off for that."""
        if vertices.shape != self._vertices.shape or np.abs(vertices - self._vertices).max() > self._reach:
            return None
        return np.asarray(self.ends + self.slopes @ (vertices - self._vertices).ravel())

    @cached_property
    def slopes(self) -> FloatArray:
        """The slopes of l and u by `vertices.ravel()` (2, 2 V)."""
        begin, edge = self._vertices, np.roll(self._vertices, -1, axis=0) - self._vertices
        turn = 1.0 if shapely.LinearRing(self._vertices).is_ccw else -1.0
        found = np.zeros((2, len(begin), 2))
        side, after = self._grid.x[[0, -1]], np.roll(np.arange(len(begin)), -1)
        for i, ((x, y), (run, rise)) in enumerate(zip(begin, edge, strict=True)):
            low, high = np.clip(np.sort((side - x) / run), 0.0, 1.0) if run else (0.0, 1.0)
            if not low < high or (not run and not side[0] <= x <= side[1]):
                continue
            count = int(np.ceil(_POINTS * (high - low) * np.hypot(run, rise) / np.diff(self._grid.x)[0]))
            t = low + (high - low) * (np.arange(count) + 0.5) / count
            weight = turn * self._at(x + t * run, y + t * rise) * (high - low) / count  # (2, count)
            outwards = np.array([rise, -run])
            found[:, i] += (weight @ (1.0 - t))[:, None] * outwards
            found[:, after[i]] += (weight @ t)[:, None] * outwards
        l, u = found.reshape(2, -1)
        grows = (u - l) / np.tanh(0.5 * np.diff(self.ends) / self._lambda) ** 2  # as w - 2 T does
        return np.asarray(0.5 * (l + u + np.array([[-1.0], [1.0]]) * grows))

    def _at(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return `_pull` at points (P,), linear between nodes (2, P)."""
        places, shares = [], []
        for nodes, at in ((self._grid.y, y), (self._grid.x, x)):
            first = np.searchsorted(nodes, at).clip(1, len(nodes) - 1) - 1
            places.append(first)
            shares.append((at - nodes[first]) / (nodes[first + 1] - nodes[first]))
        (row, column), (up, right) = places, shares
        below, above = (
            (1.0 - right) * self._pull[:, r, column] + right * self._pull[:, r, column + 1]
            for r in (row, row + 1)
        )
        return np.asarray((1.0 - up) * below + up * above)


def _fed_bars(grid: Cells, leak: FloatArray) -> FloatArray:
    """Return the potentials of the nodes while a current of 1 flows into the lower or the upper bar (2, rows, columns).

    Nodes leak to ground (rows, columns). The rows between bars on 1 and on 0 are solved as a band; what leaves by the
    other bar and by the leaks is then what is fed, without a difference of nearly equal currents.
    """
    rows, columns = leak.shape
    along = grid.widths / np.diff(grid.y)[:, None]  # (rows - 1, columns)
    sideways = grid.heights[1:-1, None] / np.diff(grid.x)
    band = np.zeros((columns + 1, rows - 2, columns))  # the lower one, of a row after the other
    band[0] = along[:-1] + along[1:] + leak[1:-1]
    band[0, :, :-1] += sideways
    band[0, :, 1:] += sideways
    band[1, :, :-1] = -sideways
    band[columns, :-1] = -along[1:-1]
    right = np.zeros((rows - 2, columns, 2))
    right[0, :, 0], right[-1, :, 1] = along[0], along[-1]
    inner = solveh_banded(band.reshape(columns + 1, -1), right.reshape(-1, 2), lower=True, check_finite=False)
    on = np.zeros((2, rows, columns))  # the potentials for a bar on 1
    on[:, 1:-1] = inner.T.reshape(2, rows - 2, columns)
    on[0, 0] = on[1, -1] = 1.0
    across = float(along[-1] @ on[0, -2])
    leaks = (on * leak).sum(axis=(1, 2))
    of_bars = np.linalg.inv(np.diag(leaks) + across * np.array([[1.0, -1.0], [-1.0, 1.0]]))
    return np.asarray(np.einsum("kb,brc->krc", of_bars, on))
