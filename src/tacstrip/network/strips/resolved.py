"""Strips of finite width, resolved across it: each strip a sheet of resistors, the contact the shape that lies on it.

Whatever the shape, a strip reads as an ideal contact on some [l', u']. For with phi_0, phi_1 the potentials of the two
strips and R_0, R_1 their resistances per square, phi_0 / R_0 + phi_1 / R_1 grows evenly from bar to bar, and the
difference d = phi_0 - phi_1 obeys div grad d = d / lambda^2 under the contact and 0 beside it, whatever R_1 / R_0 is.
So l' and u' are the same on rubber and on metal. If the contact is long, over the width and lambda, either end has its
own: l + T and u - T at a straight edge (docs/decisions/, one closed form), and for a slanted edge under ideal contact
`slant_shift`.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from tacstrip.arguments import takes
from tacstrip.arrays import FloatArray, IntArray
from tacstrip.contact.footprint import on_sensor
from tacstrip.contact.shape import Contact
from tacstrip.errors import ContactError, NetworkError
from tacstrip.network.grid import check_count
from tacstrip.network.nodal import Measurement
from tacstrip.network.strips.measurements import solved
from tacstrip.network.strips.resolved_mesh import Cells, Chains, cells, chains, on_strip
from tacstrip.network.wires import Wires
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.spec import Sensor

MOST = 256  # cells across
_FEWEST, _MOST, _PER_LAMBDA = 32, 128, 4  # by default
_SLIVER = 1e-10  # of the largest share of a contact; less is rounding


@takes(sensor=Sensor, contact=Contact)
def wide_readings(
    sensor: Sensor, contact: Contact, *, across: int | None = None, strips: Iterable[int] | None = None
) -> dict[str, FloatArray]:
    """Return what every strip reads over Vref, signature to (strips,), NaN where nothing touches.

    A strip is touched where any part of its width is. Arguments and errors as for `wide_measurements`.

    Examples
    --------
    A straight edge across the strips reads as the closed form says, a slanted one longer:

    >>> import tacstrip as ts
    >>> from tacstrip.network import wide_readings
    >>> sensor = ts.Sensor(construction="crs-m", strips=1, pitch_mm=10.0, length_mm=100.0)
    >>> straight = ts.Contact.polygon([(0, 40), (10, 40), (10, 80), (0, 80)])
    >>> slanted = ts.Contact.polygon([(0, 35), (10, 45), (10, 80), (0, 80)])
    >>> [wide_readings(sensor, c, across=8)["k"].round(3) for c in (straight, slanted)]
    [array([0.667]), array([0.653])]
    """
    return solved(sensor, wide_measurements(sensor, contact, across, strips=strips))


def wide_measurements(
    sensor: Sensor, contact: Contact, across: int | None = None, *, strips: Iterable[int] | None = None
) -> dict[int, Measurement]:
    """Return the scan as measurements on networks: touched strip, counted from 0, to its measurement.

    Parameters
    ----------
    sensor
        Its `strip_width` counts; lambda = 1 / sqrt((R_0 + R_1) g), with g the contact's conductance per area.
    contact
        Areas; under ideal contact lines too, which join the layers along them.
    across
        Cells over the width of a strip; by default 32, or 4 per lambda where that is more, at most 128.
    strips
        Those to solve; all by default.

    Raises
    ------
    ContactError
        The contact lies outside the sensor, or has parts without area that conduct nothing.
    NetworkError
        The construction's strips cannot be taken one by one, or the contact joins both ends of one to the metal.
    OptionError
        `across` is not a whole number, 1 to 256.
    """
    if not sensor.kind.closed_form:
        raise NetworkError(
            f"a {sensor.kind.name} sensor's strips are coupled by the sheet: no strip stands alone"
        )
    lam, width = sensor.contact_lambda_mm, sensor.strip_width
    if across is None:
        across = int(np.clip(_PER_LAMBDA * width / lam if lam else 0.0, _FEWEST, _MOST))
    across = check_count("across", across, MOST)
    thin = [s for s in contact.shapes if s.area == 0.0 and (lam > 0.0 or s.length == 0.0)]
    if thin:
        what = "point" if thin[0].length == 0.0 else "line"
        why = "has no area to conduct over" if thin[0].length else "reads its own y on a strip of any width"
        raise ContactError(f"a {what} {why}: give an area, or take footprint() and the centre-line model")
    shapes = on_sensor(sensor, contact).shapes
    result = {}
    for strip in map(int, range(sensor.strips) if strips is None else strips):
        x = float(sensor.x_mm[strip])
        measurement = _measurement(sensor, strip, on_strip(shapes, x, width, sensor.length_mm), across)
        if measurement is not None:
            result[strip] = measurement
    return result


def _measurement(sensor: Sensor, strip: int, contact: BaseGeometry, across: int) -> Measurement | None:
    """Return the network of a strip's layers and their contact, and what is read; None where nothing touches."""
    if contact.is_empty:
        return None
    lam, width, ratio = sensor.contact_lambda_mm, sensor.strip_width, sensor.sensing_ratio
    x, decay = float(sensor.x_mm[strip]), min(width, lam or width)
    grid = cells(contact, x, width, sensor.length_mm, across, decay)
    wires = Wires()
    squares = [1.0, ratio] if ratio else [1.0]  # of the layers that are rubber [ohm per square]
    layers = [_nodes(wires, grid) for _ in squares]
    metal = None if ratio else int(wires.new()[0])
    for along in (True, False):
        chain = chains(shapely.Point() if lam else contact, grid, along)
        touched = [_sheet(wires, grid, chain, along, *each) for each in zip(layers, squares, strict=True)]
        wires.same.append((touched[0], np.full_like(touched[0], metal) if metal is not None else touched[1]))
    if lam:
        share = grid.shares(contact).ravel()
        real = share > _SLIVER * share.max()
        ends = [layer[real] for layer in layers]
        siemens = share[real] / ((1.0 + ratio) * lam**2)
        wires.join(ends[0], np.full_like(ends[0], metal) if metal is not None else ends[1], siemens)
    elif not any(len(nodes) for nodes, _ in wires.same):  # a speck
        return None
    sensing = [metal, metal] if metal is not None else [int(layers[1][0]), int(layers[1][-1])]
    read = {name: sensing[SIGNATURES[name].at_upper_end] for name in sensor.signatures}
    return wires.measurement({int(layers[0][0]): 0.0, int(layers[0][-1]): 1.0}, read, strip)


def _nodes(wires: Wires, grid: Cells) -> IntArray:
    """Return new nodes for a layer (rows * columns,); the first and the last row are a bar, one node each."""
    columns = len(grid.x)
    low, high = wires.new(2)
    inner = wires.new((len(grid.y) - 2) * columns)
    return np.concatenate([np.full(columns, low), inner, np.full(columns, high)])


def _sheet(wires: Wires, grid: Cells, chain: Chains, along: bool, layer: IntArray, square: float) -> IntArray:
    """Add a layer's resistors along or across, cut where the contact's edge crosses; return the touched nodes."""
    rubber = grid.widths if along else grid.heights
    bars = [] if along else [0, len(rubber) - 1]
    real = (chain.line[1:] == chain.line[:-1]) & ~np.isin(chain.line[:-1], bars)
    cut = chain.node < 0
    node = layer[chain.node]
    node[cut] = wires.new(int(cut.sum()))
    siemens = rubber[chain.line[:-1]][real] / np.diff(chain.at)[real] / square
    wires.join(node[:-1][real], node[1:][real], siemens)
    return node[chain.touched]
