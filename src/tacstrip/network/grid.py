"""How a contact meets a rectangle of nodes or of switches: the sheets of 2.1 and the array of 2.2."""

from __future__ import annotations

import math
import operator
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.contact.shape import Contact
from tacstrip.errors import OptionError

MOST = 1000  # cells, rows or columns each way
_ON_EDGE = 1e-9  # of a cell or a pitch


def cut_to_surface(
    contact: Contact, width_mm: float, height_mm: float, name: str
) -> tuple[list[BaseGeometry], bool]:
    """Cut a contact to a surface that spans x 0 to width and y 0 to height [mm].

    Areas that overlap become one. An area that only grazes the edge is off it.

    Returns
    -------
    tuple
        The polygons, lines and points that are left, and whether anything was cut away.

    Raises
    ------
    ContactError
        The contact lies wholly outside; `name` is what the message calls the surface.
    """
    surface = shapely.box(0.0, 0.0, width_mm, height_mm)
    areas = shapely.union_all([s for s in contact.shapes if s.area > 0.0])
    whole = [*shapely.get_parts(areas), *(s for s in contact.shapes if s.area == 0.0)]
    inside = list(Contact(tuple(whole)).clipped(width_mm, height_mm, name).shapes)
    clipped = not all(shapely.covers(surface, shape) for shape in whole)
    return inside, clipped


@dataclass(frozen=True, eq=False)
class Grid:
    """Nodes of one sheet, (ny + 1, nx + 1); those of the bottom sheet count on from there."""

    width: float
    height: float
    nx: int
    ny: int

    @property
    def dx(self) -> float:
        """Width of a cell [mm]."""
        return self.width / self.nx

    @property
    def dy(self) -> float:
        """Height of a cell [mm]."""
        return self.height / self.ny

    @property
    def nodes(self) -> int:
        """Nodes of one sheet."""
        return (self.nx + 1) * (self.ny + 1)

    def numbers(self, bottom: bool) -> IntArray:
        """Return the numbers of a sheet's nodes (ny + 1, nx + 1)."""
        top = np.arange(self.nodes).reshape(self.ny + 1, self.nx + 1)
        return top + self.nodes if bottom else top

    def sheet(self, bottom: bool, squares: float) -> tuple[IntArray, IntArray, FloatArray]:
        """Return start, end and conductance of a sheet's resistors; those on its edges stand for half a cell."""
        node = self.numbers(bottom)
        along = np.full((self.ny + 1, self.nx), self.dy / self.dx / squares)
        along[[0, -1]] *= 0.5
        up = np.full((self.ny, self.nx + 1), self.dx / self.dy / squares)
        up[:, [0, -1]] *= 0.5
        start = np.concatenate([node[:, :-1].ravel(), node[:-1].ravel()])
        end = np.concatenate([node[:, 1:].ravel(), node[1:].ravel()])
        return start, end, np.concatenate([along.ravel(), up.ravel()])

    def nearest(self, xy: FloatArray) -> IntArray:
        """Return the different top nodes nearest to points (P, 2) [mm]."""
        i = np.clip(np.rint(xy[:, 0] / self.dx), 0, self.nx).astype(np.int64)
        j = np.clip(np.rint(xy[:, 1] / self.dy), 0, self.ny).astype(np.int64)
        return np.unique(j * (self.nx + 1) + i)


def joints(grid: Grid, shapes: list[BaseGeometry], area: float, thin: float) -> FloatArray:
    """Return the conductance from each top node to the bottom node below it (nodes,): infinite where ideal.

    `area` is the conductance of a mm^2 of an area, `thin` that of a point or a line as a whole.
    """
    to_bottom = np.zeros(grid.nodes)
    for shape in shapes:
        if shape.area == 0.0:
            nodes = grid.nearest(_along(shape, grid))
            to_bottom[nodes] += thin / len(nodes)
        elif math.isfinite(area):
            to_bottom += area * _shares(grid, shape)
        else:
            covered = _covered(grid, shape)
            to_bottom[covered if covered.any() else grid.nearest(_along(shape.exterior, grid))] = math.inf
    return to_bottom


def _along(shape: BaseGeometry, grid: Grid) -> FloatArray:
    """Return points along a line closer than half a cell (P, 2) [mm]; a point's own coordinates."""
    line = shapely.segmentize(shape, 0.49 * min(grid.dx, grid.dy)) if shape.length else shape
    return np.asarray(shapely.get_coordinates(line), dtype=float)


def _covered(grid: Grid, area: BaseGeometry) -> BoolArray:
    """Tell which nodes an area covers (nodes,), those on its edge included."""
    j, i = np.divmod(np.arange(grid.nodes), grid.nx + 1)
    wider = shapely.buffer(area, _ON_EDGE * min(grid.dx, grid.dy), join_style="mitre")
    shapely.prepare(wider)
    return np.asarray(shapely.intersects_xy(wider, i * grid.dx, j * grid.dy), dtype=bool)


def _shares(grid: Grid, area: BaseGeometry) -> FloatArray:
    """Return how much of an area falls to each node (nodes,) [mm^2]: the part within half a cell of it."""
    j, i = np.divmod(np.arange(grid.nodes), grid.nx + 1)
    x, y = (np.clip([at - 0.5, at + 0.5], 0, most) for at, most in ((i, grid.nx), (j, grid.ny)))
    cells = shapely.box(x[0] * grid.dx, y[0] * grid.dy, x[1] * grid.dx, y[1] * grid.dy)
    shapely.prepare(area)
    inside, meets = shapely.covers(area, cells), shapely.intersects(area, cells)
    share = np.where(inside, shapely.area(cells), 0.0)
    edge = meets & ~inside
    share[edge] = shapely.area(shapely.intersection(area, cells[edge]))
    return share


def tactels(contact: Contact, rows: int, columns: int, pitch_mm: float) -> BoolArray:
    """Return which switches a contact closes (rows, columns).

    An area closes the tactels whose centre it covers, edges included; a point or a line those whose square it
    touches.

    Raises
    ------
    ContactError
        The contact lies wholly outside the array.
    OptionError
        A count or the pitch cannot be.
    """
    check_mm(pitch_mm=pitch_mm)
    rows, columns = check_count("rows", rows, MOST), check_count("columns", columns, MOST)
    shapes, _ = cut_to_surface(contact, columns * pitch_mm, rows * pitch_mm, "array")
    i, j = np.indices((rows, columns))
    closed = np.zeros((rows, columns), dtype=bool)
    for shape in shapes:
        wider = shapely.buffer(shape, _ON_EDGE * pitch_mm)
        shapely.prepare(wider)
        if shape.area > 0.0:
            closed |= shapely.intersects_xy(wider, (j + 0.5) * pitch_mm, (i + 0.5) * pitch_mm)
        else:
            squares = shapely.box(j * pitch_mm, i * pitch_mm, (j + 1) * pitch_mm, (i + 1) * pitch_mm)
            closed |= shapely.intersects(wider, squares)
    return closed


def check_mm(**lengths: float) -> None:
    """Refuse lengths that are not finite and above 0: `OptionError` names the first."""
    for name, value in lengths.items():
        if not 0.0 < value < math.inf:
            raise OptionError(f"{name} = {value}: must be a finite number of mm above 0")


def check_count(name: str, value: object, most: int) -> int:
    """Return a whole number of 1 to `most`, or raise `OptionError`."""
    try:
        number = operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        number = 0
    if isinstance(value, bool | np.bool_) or not 1 <= number <= most:
        raise OptionError(f"{name} = {value!r}: must be a whole number, 1 to {most}")
    return number
