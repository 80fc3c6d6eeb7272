"""CRS-CRS, CRS-M and Cyl-CRS-M sensors as networks: what one scan asks of them, strip by strip.

Each touched strip is a chain of resistors with nodes at its ends and along its contact. The sensing layer is a
second chain (rubber) or one node (metal). Over a contact the two are joined by the contact's conductance, lumped at
the nodes by the trapezoid rule, so that readings converge with the second power of the cell; an ideal contact joins
the nodes themselves. Contacts are the footprint's separate pieces, not their hull.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.contact.shape import Contact
from tacstrip.network.imperfections import Imperfections, Layer, Readout
from tacstrip.network.nodal import Measurement, solve_measurement
from tacstrip.network.strips.mesh import StripMesh, make_mesh
from tacstrip.network.wires import Wires
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.spec import Sensor

_SAME_Y = 1e-12  # of the strip length


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
