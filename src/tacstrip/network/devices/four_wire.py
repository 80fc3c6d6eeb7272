"""The analog four-wire sensor (thesis, 2.1) as a network: two resistive sheets that a contact joins.

Each sheet is a grid of resistors between nodes. The top sheet has its electrode bars at x = 0 and x = W, the bottom
sheet at y = 0 and y = H; a bar is one node. An ideal contact joins the sheets' nodes under it.

It reports one point, whatever touches: the mean of the touched places with the weights M^-1 1 / (1' M^-1 1), where
M = T + B are the resistances between those places over both sheets, bars grounded, and R of each place on M's
diagonal. With both bars tied these weights are the same for x and for y, so two places read on the line between them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from tacstrip.arguments import takes
from tacstrip.arrays import FloatArray, IntArray
from tacstrip.contact.shape import Contact
from tacstrip.errors import ContactError, NetworkError, OptionError, one_of
from tacstrip.network.grid import MOST, Grid, check_count, check_mm, cut_to_surface, joints
from tacstrip.network.nodal import Measurement, solve_measurement
from tacstrip.network.wires import Wires

Read: TypeAlias = Literal["both", "low", "high"]
_READS = ("both", "low", "high")
_FAR_APART = 1e10  # conductances further apart than this add up to the greater one


@dataclass(frozen=True)
class FourWire:
    """What a four-wire sensor reports: one point.

    Attributes
    ----------
    x_mm, y_mm
        The point [mm].
    x_volt, y_volt
        The two raw voltages it comes from, over Vref: read on the bottom sheet while the top one is driven
        along x, and on the top sheet while the bottom one is driven along y.
    clipped
        Whether a part of the contact lay off the sheets and was cut away.

    Examples
    --------
    >>> import tacstrip as ts
    >>> from tacstrip.network import four_wire
    >>> point = four_wire(100.0, 80.0, ts.Contact.points([20.0, 30.0]), cells=(20, 16))
    >>> round(point.x_volt, 3), point.clipped
    (0.2, False)
    """

    x_mm: float
    y_mm: float
    x_volt: float
    y_volt: float
    clipped: bool = False


@takes(contact=Contact)
def four_wire(
    width_mm: float,
    height_mm: float,
    contact: Contact,
    *,
    cells: int | tuple[int, int] = 60,
    sheet_ratio: float = 1.0,
    contact_lambda_mm: float = 0.0,
    point_squares: float = 0.0,
    read: Read = "both",
) -> FourWire:
    """Return the one point that a four-wire sensor reports for any contact (2.1).

    Parameters
    ----------
    width_mm, height_mm
        Size of the sheets along x and y [mm].
    contact
        What touches. An area joins the nodes that it covers, edges included; a point its nearest node; a line,
        and an area too thin to cover a node, the nodes nearest to it.
    cells
        Cells of the grid along x and along y, or along the longer side; at most 1000.
    sheet_ratio
        Resistance per square of the bottom sheet over the top sheet's.
    contact_lambda_mm
        Decay length of an area's contact resistance, 1 / sqrt((R_top + R_bottom) g) with R per square and g the
        conductance per area [mm]; 0: ideal.
    point_squares
        Resistance of a point, or of a line as a whole, over the top sheet's resistance per square; 0: ideal.
    read
        Which bar of the sheet that is not driven is read: "low" (x or y = 0), "high", or "both", tied together. It
        matters only where several places are in touch.

    Raises
    ------
    ContactError
        The contact lies off the sheets, or shorts Vref to ground over the bars.
    NetworkError
        A resistance cannot be.
    OptionError
        A size, `cells` or `read` cannot be.

    Examples
    --------
    Two points read as one, on the line between them:

    >>> import tacstrip as ts
    >>> from tacstrip.network import four_wire
    >>> point = four_wire(100.0, 80.0, ts.Contact.points([(20, 30), (60, 30)]), cells=(20, 16))
    >>> 20.0 < point.x_mm < 60.0, round(point.y_mm, 3)
    (True, 30.0)
    """
    check_mm(width_mm=width_mm, height_mm=height_mm)
    _check(sheet_ratio, contact_lambda_mm, point_squares, read)
    grid = Grid(float(width_mm), float(height_mm), *_cells(cells, width_mm, height_mm))
    shapes, clipped = cut_to_surface(contact, grid.width, grid.height, "sheets")
    area_ohm, point_ohm = contact_lambda_mm**2 * (1.0 + sheet_ratio), point_squares  # sheet: 1 ohm per square
    joined = joints(grid, shapes, _inverse(area_ohm), _inverse(point_ohm))
    top, bottom = grid.numbers(bottom=False), grid.numbers(bottom=True)
    sheets = [grid.sheet(bottom=False, squares=1.0), grid.sheet(bottom=True, squares=sheet_ratio)]
    over_x, over_y = (top[:, 0], top[:, -1]), (bottom[0], bottom[-1])
    x = _measure(grid, sheets, joined, over_x, over_y, read)
    y = _measure(grid, sheets, joined, over_y, over_x, read)
    return FourWire(x * grid.width, y * grid.height, x, y, clipped)


def _check(ratio: float, contact_lambda: float, squares: float, read: str) -> None:
    if not 0.0 < ratio < math.inf:
        raise NetworkError(f"sheet_ratio = {ratio}: must be a finite number above 0")
    for name, value in (("contact_lambda_mm", contact_lambda), ("point_squares", squares)):
        if not 0.0 <= value < math.inf:
            raise NetworkError(f"{name} = {value}: must be 0 (ideal) or a finite number above 0")
    if read not in _READS:
        raise OptionError(one_of("read", read, _READS))


def _inverse(ohm: float) -> float:
    return 1.0 / ohm if ohm > 1e-300 else math.inf


def _cells(cells: int | tuple[int, int], width: float, height: float) -> tuple[int, int]:
    if isinstance(cells, tuple | list):
        if len(cells) != 2:
            raise OptionError(f"cells = {cells!r}: give one number, or two: (along x, along y)")
        return check_count("cells[0]", cells[0], MOST), check_count("cells[1]", cells[1], MOST)
    number, longer = check_count("cells", cells, MOST), max(width, height)
    return max(1, round(number * width / longer)), max(1, round(number * height / longer))


def _measure(
    grid: Grid,
    sheets: list[tuple[IntArray, IntArray, FloatArray]],
    joined: FloatArray,
    driven: tuple[IntArray, IntArray],
    passive: tuple[IntArray, IntArray],
    read: Read,
) -> float:
    """Drive one sheet, ground to Vref over its two bars, and return what the other sheet's bars read over Vref."""
    top = np.arange(grid.nodes)
    ideal = np.isinf(joined)
    finite = np.where(ideal, 0.0, joined)
    resistive = finite > finite.max() / _FAR_APART  # the rest are slivers
    parts = [*sheets, (top[resistive], top[resistive] + grid.nodes, joined[resistive])]
    same = [(bar[:1], bar) for bar in (*driven, *passive)] + [(top[ideal], top[ideal] + grid.nodes)]
    if read == "both":
        same.append((passive[0][:1], passive[1][:1]))
    network, name = Wires(2 * grid.nodes, parts, same).merged()
    ground, supply = name[driven[0][0]], name[driven[1][0]]
    if ground == supply:
        raise ContactError(
            "the contact joins both driven bars to a bar of the other sheet: that shorts Vref to ground, and "
            "nothing can be read; keep it off the sheets' edges, or give it a resistance "
            "(contact_lambda_mm for areas, point_squares for points and lines)"
        )
    spread = network.siemens.max() / network.siemens.min()
    if not spread <= _FAR_APART:
        raise NetworkError(
            f"the network's resistances lie a factor of {spread:.3g} apart, and the smaller ones are lost against the "
            "others: bring sheet_ratio, contact_lambda_mm, point_squares and the cells' shape nearer to 1, or take 0 "
            "for an ideal contact"
        )
    bar = name[passive[1][0] if read == "high" else passive[0][0]]
    asked = Measurement(network, {int(ground): 0.0, int(supply): 1.0}, {"bar": int(bar)})
    return solve_measurement(asked)["bar"]
