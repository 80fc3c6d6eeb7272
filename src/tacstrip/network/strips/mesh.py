"""Where a strip's network has nodes, and what lies between them: shared by every way to solve it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.contact.footprint import footprint
from tacstrip.contact.shape import Contact
from tacstrip.errors import NetworkError
from tacstrip.network.imperfections import Imperfections, Layer, Readout
from tacstrip.sensor.spec import Sensor

_CELLS_PER_LAMBDA = 40
_FEWEST, _MOST = 16, 20_000


@dataclass(frozen=True, eq=False)
class StripMesh:
    """A unit, its readout and the contact on it, cut into cells; see `make_mesh`.

    Attributes
    ----------
    pieces
        Touched strip, counted from 0, to its separate pieces of contact (P, 2), low and high end [mm].
    cells
        Cells over each piece; None: 40 per lambda.
    """

    sensor: Sensor
    imperfections: Imperfections
    readout: Readout
    cells: int | None
    pieces: dict[int, FloatArray]

    @property
    def metal(self) -> bool:
        """Whether the sensing layer is one node."""
        return self.sensor.sensing_ratio == 0.0

    def low(self, strip: int, layer: Layer) -> float:
        """Return where a strip's lower end lies [mm]."""
        return 0.0 if layer == "energised" or self.metal else self.imperfections.shift(strip)

    def nodes(self, strip: int) -> list[FloatArray]:
        """Return the nodes of each piece of contact on a strip, positions (N,) [mm]; a point has one."""
        pieces = self.pieces.get(strip, np.empty((0, 2)))
        return [np.linspace(a, b, self._count(b - a) + 1) if b > a else np.array([a]) for a, b in pieces]

    def ohm(self, strip: int, layer: Layer, y: FloatArray) -> FloatArray:
        """Return a strip's resistance between neighbouring positions (N,): (N - 1,) [ohm]."""
        relative = self.imperfections.profile(strip, layer)
        ratio = self.sensor.sensing_ratio if layer == "sensing" else 1.0
        if self.sensor.surface is not None:
            low = self.low(strip, layer)
            zones = np.linspace(0.0, self.sensor.length_mm, len(relative) + 1)
            at, ends = (self.sensor.surface.accumulated_resistance(v) for v in (y - low, zones))
            below = np.concatenate(([0.0], np.cumsum(relative * np.diff(ends))))
            return np.asarray(self.readout.strip_ohm * ratio * np.diff(np.interp(at, ends, below)))
        if len(relative) == 1:
            per_mm = self.readout.strip_ohm * ratio * relative[0] / self.sensor.length_mm
            return np.asarray(per_mm * np.diff(y))
        edges = self.low(strip, layer) + np.linspace(0.0, self.sensor.length_mm, len(relative) + 1)
        below = np.concatenate(([0.0], np.cumsum(relative))) / len(relative)  # of a nominal strip
        return np.asarray(self.readout.strip_ohm * ratio * np.diff(np.interp(y, edges, below)))

    def siemens(self, y: FloatArray) -> FloatArray | None:
        """Return the conductance of a piece of contact at its nodes (N,), by the trapezoid rule; None: ideal.

        lambda = 1 / sqrt((r0 + r1) g) gives g. A point has no length to conduct over and counts as ideal:
        with no load on the sensing layer that is the limit of short contacts.
        """
        lam = self.sensor.contact_lambda_mm
        if lam == 0.0 or len(y) < 2:
            return None
        r0 = self.readout.strip_ohm / self.sensor.length_mm
        weight = np.full(len(y), y[1] - y[0])
        weight[[0, -1]] *= 0.5
        if (surface := self.sensor.surface) is not None and not surface.even:  # wider strips conduct better
            weight = weight * surface.meridian(y)[0] * surface.resistance / self.sensor.length_mm
        return np.asarray(weight / (r0 * (1.0 + self.sensor.sensing_ratio) * lam**2))

    def _count(self, length_mm: float) -> int:
        lam = self.sensor.contact_lambda_mm
        wanted = np.ceil(_CELLS_PER_LAMBDA * length_mm / lam) if lam else 0.0
        return max(self.cells, 1) if self.cells is not None else int(np.clip(wanted, _FEWEST, _MOST))


def make_mesh(
    sensor: Sensor,
    contact: Contact,
    imperfections: Imperfections | None,
    readout: Readout | None,
    cells: int | None,
) -> StripMesh:
    """Lay a contact on a unit; pieces are kept where they lie on both layers.

    Raises
    ------
    NetworkError
        A fault is not on the sensor.
    ContactError
        The contact lies outside the sensor.
    """
    if sensor.surface is not None and sensor.surface.along == "parallels":
        raise NetworkError(
            "strips along parallels have no network model yet: leave the model out, or take meridians"
        )
    imperfections, readout = imperfections or Imperfections(), readout or Readout()
    imperfections.check(sensor)
    mesh = StripMesh(sensor, imperfections, readout, cells, {})
    strip, low, high = footprint(sensor, contact).intervals[0]
    numbers, first = np.unique(strip, return_index=True)
    each = np.split(np.stack([low, high], axis=1), first)[1:]
    for number, pieces in zip(numbers.tolist(), each, strict=True):
        start = mesh.low(number, "sensing")
        bottom, top = max(0.0, start), sensor.length_mm + min(0.0, start)
        on_both = (pieces[:, 1] >= bottom) & (pieces[:, 0] <= top)
        if on_both.any():
            mesh.pieces[number] = np.clip(pieces[on_both], bottom, top)
    return mesh
