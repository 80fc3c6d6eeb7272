"""Strips of finite width, resolved across it: each strip a sheet of resistors, the contact the shape that lies on it.

Whatever the shape, a strip reads as an ideal contact on some [l', u']. For with phi_0, phi_1 the potentials of the two
strips and R_0, R_1 their resistances per square, phi_0 / R_0 + phi_1 / R_1 grows evenly from bar to bar, and the
difference d = phi_0 - phi_1 obeys div grad d = d / lambda^2 under the contact and 0 beside it, whatever R_1 / R_0 is.
So l' and u' are the same on rubber and on metal. If the contact is long, over the width and lambda, either end has its
own: l + T and u - T at a straight edge (docs/decisions/, one closed form), and for a slanted edge under ideal contact
`slant_shift`.

The strip is cut into cells of equal width, with columns of nodes on its sides and between cells, and into rows that are
close together where the contact's edge crosses the strip. Beyond a strip width (or lambda) from there the rows grow
further apart: differences across the width die out with exp(-pi y / b), those across the contact with exp(-y / lambda).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from tacstrip.arguments import takes
from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.contact.footprint import on_sensor
from tacstrip.contact.resistive_ends import ResistiveEnds, edges_on
from tacstrip.contact.resolved_ends import resolved_ends
from tacstrip.contact.shape import Contact
from tacstrip.contact.signature import signatures
from tacstrip.errors import ContactError, NetworkError
from tacstrip.network.grid import check_count
from tacstrip.network.nodal import Measurement
from tacstrip.network.strips.measurements import solved
from tacstrip.network.wires import Wires
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.spec import Sensor

_SAME = 1e-9  # of a cell: closer positions are one node
_STEEP = 8  # an edge that runs further along the strip than this many widths gets longer cells
_FEWEST, _MOST, _PER_LAMBDA = 32, 128, 4  # by default
_SLIVER = 1e-10  # of the largest share of a contact; less is rounding


@dataclass(frozen=True, eq=False)
class Cells:
    """Nodes of one sheet of a strip: (rows, columns), the first and the last row being the electrode bars.

    Attributes
    ----------
    x
        Columns (columns,), the first and the last on the strip's sides [mm].
    y
        Rows (rows,), from 0 to the strip's length [mm].
    """

    x: FloatArray
    y: FloatArray

    @property
    def widths(self) -> FloatArray:
        """Widths of the columns' cells (columns,) [mm]."""
        return np.diff(_between(self.x))

    @property
    def heights(self) -> FloatArray:
        """Heights of the rows' cells (rows,) [mm]."""
        return np.diff(_between(self.y))

    def shares(self, area: BaseGeometry) -> FloatArray:
        """Return how much of an area falls to each node's cell (rows, columns) [mm^2], exactly but for rounding.

        Edge by edge: a column's part of an edge adds its width times the mean of min(y, level) to what lies below a
        level.
        """
        side, level = _between(self.x), _between(self.y)
        below = np.zeros((len(self.x), len(level)))
        for start, end in _edges(area):
            first, last = np.searchsorted(side, np.sort([start[0], end[0]]), side="right").clip(
                1, len(self.x)
            )
            column = slice(first - 1, last)
            a, b = (np.clip(at, side[:-1][column], side[1:][column])[:, None] for at in (start[0], end[0]))
            if start[0] == end[0]:
                continue
            slope = (end[1] - start[1]) / (end[0] - start[0])
            low, high = np.sort(
                [start[1] + slope * (a - start[0]), start[1] + slope * (b - start[0])], axis=0
            )
            over = np.clip(level, low, high) - low
            curved = np.divide(over**2, 2.0 * (high - low), out=np.zeros_like(over), where=high > low)
            below[column] += (a - b) * (np.minimum(level, low) + over - curved)
        found = np.diff(below).T
        return np.where(found > _SLIVER * found.max(), found, 0.0)


def _edges(area: BaseGeometry) -> Iterator[FloatArray]:
    """Make the edges (2, 2) [mm] of an area's rings, outer ones anticlockwise and holes clockwise."""
    for part in shapely.get_parts(area):
        if shapely.get_type_id(part) != shapely.GeometryType.POLYGON:
            continue
        for number, ring in enumerate((part.exterior, *part.interiors)):
            at = shapely.get_coordinates(ring)[:: 1 if ring.is_ccw == (number == 0) else -1]
            yield from np.stack([at[:-1], at[1:]], axis=1)


def _between(places: FloatArray) -> FloatArray:
    """Return where one node's cell ends and the next one's begins (N + 1,); the first and last cells are halves."""
    return np.concatenate([places[:1], 0.5 * (places[1:] + places[:-1]), places[-1:]])


@dataclass(frozen=True, eq=False)
class Chains:
    """Nodes along parallel lines, those of the grid and those where the contact's edge cuts between them.

    Attributes
    ----------
    line
        Line of each node (N,), ascending.
    at
        Its position along the line (N,) [mm], ascending on each.
    node
        Its number on the grid, row * columns + column (N,); -1 where the edge cuts.
    touched
        Whether it lies in the contact, edges included (N,).
    """

    line: IntArray
    at: FloatArray
    node: IntArray
    touched: BoolArray


def cells(
    contact: BaseGeometry, x_mm: float, width: float, length: float, across: int, decay: float
) -> Cells:
    """Cut a strip with its centre line at `x_mm` into `across` cells, and into rows by the contact on it.

    `decay` is the distance from the edge over which rows keep their distance [mm].
    """
    h = width / across
    rows = _rows(_zones(contact, x_mm, width), length, h, decay, _STEEP * across)
    inside = 0.5 - _SAME  # a contact that ends at the strip's side covers the side's nodes, rounded or not
    return Cells(x_mm + width * np.linspace(-inside, inside, across + 1), rows)


def on_strip(shapes: Sequence[BaseGeometry], x_mm: float, width: float, length: float) -> BaseGeometry:
    """Cut shapes to a strip; empty where none is on it. What only grazes the strip's side is off it."""
    whole, inner = (_band(x_mm, part * width, 0.0, length) for part in (1.0, 1.0 - 2.0 * _SAME))
    parts = []
    for shape in shapes:
        size = shapely.area if shape.area > 0.0 else shapely.length
        cut = shapely.get_parts(shapely.intersection(shape, whole))
        parts.append(cut[size(shapely.intersection(cut, inner)) > 0.0])
    return shapely.union_all(np.concatenate(parts))


def _band(x_mm: float, width: float, low: float, high: float) -> BaseGeometry:
    return shapely.box(x_mm - 0.5 * width, low, x_mm + 0.5 * width, high)


def chains(contact: BaseGeometry, cells: Cells, along: bool) -> Chains:
    """Lay the contact on the grid's lines, along the strip (one per column) or across it (one per row)."""
    places, lines = (cells.y, cells.x) if along else (cells.x, cells.y)
    ends = np.array([[places[0], places[-1]]] * len(lines))
    levels = np.repeat(lines[:, None], 2, axis=1)
    xy = np.stack([levels, ends] if along else [ends, levels], axis=-1)
    met = shapely.intersection(shapely.linestrings(xy), contact)
    parts, line = shapely.get_parts(met, return_index=True)
    there = ~shapely.is_empty(parts)
    bounds, line = shapely.bounds(parts[there]), line[there]
    low, high = (bounds[:, 1], bounds[:, 3]) if along else (bounds[:, 0], bounds[:, 2])
    low, high = _snapped(low, places), _snapped(high, places)
    grid = np.arange(len(lines) * len(places))
    every_line, every_at = np.divmod(grid, len(places))
    ends_at = np.stack([np.concatenate([line, line]), np.concatenate([low, high])])
    cut = np.unique(ends_at[:, ~np.isin(ends_at[1], places)], axis=1)
    where = np.concatenate([every_line, cut[0].astype(np.int64)])
    at = np.concatenate([places[every_at], cut[1]])
    node = np.concatenate([grid, np.full(cut.shape[1], -1)])
    if along:
        node = np.where(node < 0, node, node % len(places) * len(lines) + node // len(places))
    order = np.lexsort((at, where))
    where, at, node = where[order], at[order], node[order]
    # A node is touched while more pieces have begun than ended before it: the lines put end to end.
    step = 2.0 * (places[-1] - places[0]) + 1.0
    key, begin, end = where * step + at, np.sort(line * step + low), np.sort(line * step + high)
    touched = np.searchsorted(begin, key, side="right") > np.searchsorted(end, key, side="left")
    return Chains(where, at, node, touched)


def _snapped(at: FloatArray, places: FloatArray) -> FloatArray:
    """Move positions that lie on a node but for rounding onto it."""
    after = np.searchsorted(places, at).clip(1, len(places) - 1)
    before = places[after - 1]
    nearest = np.where(at - before < places[after] - at, before, places[after])
    return np.asarray(np.where(np.abs(at - nearest) < _SAME * (places[after] - before), nearest, at))


def _zones(contact: BaseGeometry, x_mm: float, width: float) -> FloatArray:
    """Return where along the strip the contact's edge crosses it: (zones, 2), ascending, apart [mm]."""
    parts = shapely.get_parts(contact)
    rims = np.where(shapely.area(parts) > 0.0, shapely.boundary(parts), parts)
    _, bottom, _, top = contact.bounds
    # An edge along the strip's own side crosses nothing.
    inside = shapely.intersection(rims, _band(x_mm, (1.0 - 2.0 * _SAME) * width, bottom - 1.0, top + 1.0))
    pieces = shapely.get_parts(inside)
    bounds = shapely.bounds(pieces[~shapely.is_empty(pieces)])[:, [1, 3]]
    low, high = bounds[np.argsort(bounds[:, 0])].T
    first = np.flatnonzero(np.append(True, low[1:] > np.maximum.accumulate(high)[:-1]))
    return np.stack([low[first], np.maximum.reduceat(high, first)], axis=1)


def _rows(zones: FloatArray, length: float, h: float, decay: float, most: int) -> FloatArray:
    """Return rows h apart in the zones, and further and further apart away from them."""
    rows = []
    for low, high in zones:
        count = max(2, int(np.ceil((high - low) / h)))  # a row within, however small the contact
        rows.append(np.linspace(low, high, min(count, most) + 1))
    rows.append(zones[0, 0] - _steps(zones[0, 0], h, decay))
    rows.append(zones[-1, 1] + _steps(length - zones[-1, 1], h, decay))
    for below, above in zip(zones[:-1, 1], zones[1:, 0], strict=True):
        half = _steps(0.5 * (above - below), h, decay)
        rows += [below + half, above - half]
    y = np.unique(np.clip(np.concatenate([[0.0, length], *rows]), 0.0, length))
    return np.asarray(y[np.concatenate([[True], np.diff(y) > 1e-6 * h])])


def _steps(distance: float, h: float, decay: float) -> FloatArray:
    """Return places from 0 up to a distance, h apart up to `decay`, then growing with the distance."""
    if distance <= 0.0:
        return np.zeros(1)
    near = np.arange(0.0, decay + h, h)
    growth = 1.0 + h / decay
    count = max(0, int(np.ceil(np.log(max(distance / near[-1], 1.0)) / np.log(growth))))
    places = np.concatenate([near, near[-1] * growth ** np.arange(1, count + 1)])
    last = int(np.searchsorted(places, distance * (1.0 - 1e-12)))
    return np.asarray(places[: last + 1] * (distance / places[last]))


MOST = 256  # cells across


@takes(sensor=Sensor, contact=Contact)
def wide_readings(
    sensor: Sensor, contact: Contact, *, across: int | None = None, strips: Iterable[int] | None = None
) -> dict[str, FloatArray]:
    """Return what every strip reads over Vref, signature to (strips,), NaN where nothing touches.

    A strip is touched where any part of its width is. Arguments and errors as for `wide_measurements`, but that without
    `across` readings are those of the limit of fine cells: ideal contact by boundary integrals (`resolved_ends`),
    contact resistance extrapolated from the default, half and a quarter as many cells.

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
    if across is not None:
        return solved(sensor, wide_measurements(sensor, contact, across, strips=strips))
    strips = range(sensor.strips) if strips is None else list(strips)
    l, u = np.full((2, sensor.strips), np.nan)
    shapes = _conducting(sensor, contact)
    (_by_cosines if sensor.contact_lambda_mm > 0.0 else _by_charges)(sensor, shapes, strips, l, u)
    rest = [strip for strip in strips if np.isnan(l[strip])]
    empty = {name: np.full(sensor.strips, np.nan) for name in sensor.signatures}
    read = signatures(sensor, l, u) if len(rest) < sensor.strips else empty
    if sensor.contact_lambda_mm > 0.0 or not rest:
        return read
    meshes = (_FEWEST // 4, _FEWEST // 2, _FEWEST)
    coarse, middle, fine = (
        solved(sensor, wide_measurements(sensor, contact, n, strips=rest)) for n in meshes
    )
    return {
        name: np.where(np.isnan(k), mesh_limit(coarse[name], middle[name], fine[name]), k)
        for name, k in read.items()
    }


def _by_cosines(
    sensor: Sensor, shapes: Sequence[BaseGeometry], strips: Sequence[int], l: FloatArray, u: FloatArray
) -> None:
    """Set l and u (strips,) [mm] on thin strips of the same lambda that read the same, of `strips` that are touched."""
    width, length = sensor.strip_width, sensor.length_mm
    on = {i: on_strip(shapes, float(sensor.x_mm[i]), width, length) for i in strips}
    touched = [i for i, area in on.items() if not area.is_empty]
    if touched:
        left = np.stack([sensor.x_mm[touched] - 0.5 * width, np.zeros(len(touched))], axis=1)
        edges = (edges_on([on[i] for i in touched]) - left[:, None, None]) / width
        l[touched], u[touched] = (
            width * ResistiveEnds.on(edges, length / width, sensor.contact_lambda_mm / width).ends
        )


def _by_charges(
    sensor: Sensor, shapes: Sequence[BaseGeometry], strips: Sequence[int], l: FloatArray, u: FloatArray
) -> None:
    """Set l and u (strips,) [mm] of ideal contact on a thin strip, of those of `strips` where charges serve."""
    for i in strips:
        ends = resolved_ends(shapes, float(sensor.x_mm[i]), sensor.strip_width, sensor.length_mm)
        if ends is not None:
            l[i], u[i] = ends


def _conducting(sensor: Sensor, contact: Contact) -> tuple[BaseGeometry, ...]:
    """Return what of a contact is on the sensor; errors as of `wide_measurements`."""
    if not sensor.kind.closed_form:
        raise NetworkError(
            f"a {sensor.kind.name} sensor's strips are coupled by the sheet: no strip stands alone"
        )
    lam = sensor.contact_lambda_mm
    thin = [s for s in contact.shapes if s.area == 0.0 and (lam > 0.0 or s.length == 0.0)]
    if thin:
        what = "point" if thin[0].length == 0.0 else "line"
        why = "has no area to conduct over" if thin[0].length else "reads its own y on a strip of any width"
        raise ContactError(f"a {what} {why}: give an area, or take footprint() and the centre-line model")
    return on_sensor(sensor, contact).shapes


def mesh_limit(coarse: FloatArray, middle: FloatArray, fine: FloatArray) -> FloatArray:
    """Return the limit of readings of three meshes, each of half the cells; between the orders 1 and 2."""
    last = fine - middle
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.clip((middle - coarse) / last, 2.0, 4.0)
    step = np.where(np.isfinite(ratio), last / (ratio - 1.0), 0.0)
    return np.asarray(fine + np.where(np.isfinite(step), step, 0.0))


def _cells_across(sensor: Sensor) -> int:
    """Return how many cells there are across a strip by default."""
    lam = sensor.contact_lambda_mm
    return int(np.clip(_PER_LAMBDA * sensor.strip_width / lam if lam else 0.0, _FEWEST, _MOST))


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
    width = sensor.strip_width
    shapes = _conducting(sensor, contact)
    across = check_count("across", _cells_across(sensor) if across is None else across, MOST)
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
        real = share > 0.0
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
