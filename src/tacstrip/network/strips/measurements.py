"""CRS-CRS, CRS-M and Cyl-CRS-M sensors as networks: what one scan asks of them, strip by strip.

Each touched strip is a chain of resistors with nodes at its ends and along its contact. The sensing layer is a
second chain (rubber) or one node (metal). Over a contact the two are joined by the contact's conductance, lumped at
the nodes by the trapezoid rule, so that readings converge with the second power of the cell; an ideal contact joins
the nodes themselves. Contacts are the footprint's separate pieces, not their hull.
Every way to solve a strip starts from its `StripMesh`: where there are nodes, and what lies between them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.contact.footprint import footprint
from tacstrip.contact.shape import Contact
from tacstrip.errors import NetworkError
from tacstrip.network.imperfections import Imperfections, Layer, Readout
from tacstrip.network.nodal import Measurement, solve_measurement
from tacstrip.network.wires import Wires
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.spec import Sensor

_CELLS_PER_LAMBDA = 40
_FEWEST, _MOST = 16, 20_000
_SAME_Y = 1e-12  # of the strip length


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


def network_readings(
    sensor: Sensor,
    contact: Contact,
    imperfections: Imperfections | None = None,
    readout: Readout | None = None,
    cells: int | None = None,
) -> dict[str, FloatArray]:
    """Return what every strip reads over Vref, signature to (strips,), NaN where nothing touches.

    Arguments and errors as for `measurements`.
    """
    return solved(sensor, measurements(sensor, contact, imperfections, readout, cells))


def solved(sensor: Sensor, asked: dict[int, Measurement]) -> dict[str, FloatArray]:
    """Return the readings of measurements by strip, signature to (strips,), NaN where there is none."""
    result = {name: np.full(sensor.strips, np.nan) for name in sensor.signatures}
    for strip, measurement in asked.items():
        for name, value in solve_measurement(measurement).items():
            result[name][strip] = value
    return result


def measurements(
    sensor: Sensor,
    contact: Contact,
    imperfections: Imperfections | None = None,
    readout: Readout | None = None,
    cells: int | None = None,
) -> dict[int, Measurement]:
    """Return the scan as measurements on networks: touched strip, counted from 0, to its measurement.

    Every measurement has a network of its own, with what can carry current while that strip is read. CRS-CRS strips
    all lie on Vref and ground (2n + 2 connectors, 3.1); over metal their ends are switched in turn and the other
    strips float, unless their grounds are tied.

    Parameters
    ----------
    sensor, contact
        What touches what; each separate piece of the contact counts.
    imperfections
        The unit's imperfections.
    readout
        Its wiring and electronics.
    cells
        Cells over each piece of contact; by default 40 per lambda.

    Returns
    -------
    dict
        Readings are named by signature: kh and kl, or k.

    Raises
    ------
    NetworkError
        A fault is not on the sensor, or a resistance is not above 0.
    ContactError
        The contact lies outside the sensor.
    """
    mesh = make_mesh(sensor, contact, imperfections, readout, cells)
    return {strip: measurement_of(mesh, strip) for strip in mesh.pieces}


@dataclass(frozen=True)
class _Chain:
    """A strip's nodes by position, lowest first."""

    y: FloatArray
    node: IntArray

    def nodes(self, y: FloatArray) -> IntArray:
        """Return the nodes nearest to positions (N,) [mm]."""
        after = np.searchsorted(self.y, y).clip(1, len(self.y) - 1)
        return np.asarray(self.node[after - (y - self.y[after - 1] < self.y[after] - y)])


def measurement_of(mesh: StripMesh, strip: int, along: bool = False) -> Measurement:
    """Return the network that carries current while one strip is energised, and what is read on it.

    With `along`, the potential of every node along the strip is read too, as "<layer> <y in mm>".
    """
    chains: dict[tuple[int, Layer], _Chain] = {}
    sensor, readout, wires = mesh.sensor, mesh.readout, Wires()
    ground, source = int(wires.new()[0]), int(wires.new()[0])
    metal = int(wires.new()[0]) if mesh.metal else None
    for other in _island(mesh, strip):
        chains.update(_pair(mesh, wires, other, metal))
    for short in mesh.imperfections.shorts:
        ends = [chains.get((short.strip + i, short.layer)) for i in (0, 1)]
        if ends[0] and ends[1]:
            a, b = (c.nodes(np.array([short.y_mm])) for c in ends if c)
            wires.join(a, b, np.array([1.0 / short.ohm]))
    held = {ground: 0.0, source: 1.0}
    together = sensor.kind.common_supply
    for (number, layer), chain in chains.items():
        if layer == "energised" and (together or number == strip):
            wires.tie(ground, int(chain.node[0]), 0.0 if together else readout.mux_ohm)
            wires.tie(source, int(chain.node[-1]), 0.0 if together else readout.mux_ohm + readout.supply_ohm)
        elif layer == "energised" and readout.tied_grounds:
            wires.tie(ground, int(chain.node[0]), 0.0)
    read = {}
    for name in sensor.signatures:
        sensing = chains.get((strip, "sensing"))
        end = metal if sensing is None else int(sensing.node[-1 if SIGNATURES[name].at_upper_end else 0])
        read[name] = int(wires.new()[0])
        wires.tie(read[name], int(end or 0), readout.mux_ohm if together else 0.0)
        if readout.adc_ohm < np.inf:
            wires.tie(read[name], ground, readout.adc_ohm)
    for (number, layer), chain in chains.items() if along else ():
        if number == strip:
            places = zip(chain.y.tolist(), chain.node.tolist(), strict=True)
            read |= {f"{layer} {y!r}": node for y, node in places}
    return wires.measurement(held, read, strip)


def _island(mesh: StripMesh, strip: int) -> list[int]:
    """Return the strips that can carry current while this one is read."""
    reached = {strip, *mesh.pieces} if mesh.readout.tied_grounds and mesh.metal else {strip}
    while True:
        bridges = ({short.strip, short.strip + 1} for short in mesh.imperfections.shorts)
        grown = reached.union(*(b for b in bridges if b & reached))
        if grown == reached:
            return sorted(reached)
        reached = grown


def _pair(mesh: StripMesh, wires: Wires, strip: int, metal: int | None) -> dict[tuple[int, Layer], _Chain]:
    """Add a strip, its sensing layer and their contact."""
    pieces = mesh.nodes(strip)
    chains: dict[tuple[int, Layer], _Chain] = {}
    chains[strip, "energised"] = _chain(mesh, wires, strip, "energised", pieces)
    if metal is None:
        chains[strip, "sensing"] = _chain(mesh, wires, strip, "sensing", pieces)
    for y in pieces:
        ours = chains[strip, "energised"].nodes(y)
        theirs = chains[strip, "sensing"].nodes(y) if metal is None else np.full_like(ours, metal)
        siemens = mesh.siemens(y)
        if siemens is None:
            wires.same.append((ours, theirs))
        else:
            wires.join(ours, theirs, siemens)
    return chains


def _chain(mesh: StripMesh, wires: Wires, strip: int, layer: Layer, pieces: list[FloatArray]) -> _Chain:
    """Add one strip of one layer, with nodes at its ends, its contacts and its shorts."""
    length, low = mesh.sensor.length_mm, mesh.low(strip, layer)
    own = [s for s in mesh.imperfections.shorts if s.layer == layer and strip in (s.strip, s.strip + 1)]
    shorts = [s.y_mm for s in own]
    y = np.concatenate([[low, low + length], np.clip(shorts, low, low + length), *pieces])
    y = np.unique(np.round(y / (_SAME_Y * length)) * (_SAME_Y * length))
    node = wires.new(len(y))
    ohm = mesh.ohm(strip, layer, y)
    whole = np.ones(len(ohm), dtype=bool)
    for cut in mesh.imperfections.breaks:
        if (cut.strip, cut.layer) == (strip, layer):
            whole[np.clip(np.searchsorted(y, cut.y_mm, side="right") - 1, 0, len(ohm) - 1)] = False
    wires.join(node[:-1][whole], node[1:][whole], 1.0 / ohm[whole])
    return _Chain(y, node)
