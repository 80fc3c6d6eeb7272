"""The digital array of cross-switches (thesis, 2.2) as a network, and its phantoms over parallel paths (figure 2.4).

Tactel (i, j), row i and column j, has its centre at x = (j + 0.5) pitch, y = (i + 0.5) pitch. A row is
driven at its first column's end, a column is read at its last row's end.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.errors import NetworkError, OptionError, one_of
from tacstrip.network.grid import MOST
from tacstrip.network.nodal import Factored, Network

ISOLATIONS = {
    "none": "the other rows float, every column has its load: figure 2.4's parallel path",
    "diodes": "as none, with an ideal diode in every switch: current flows from row to column only",
    "zero-potential": "the other rows are grounded, the columns held at 0 V and their currents read",
}
_FORWARD = 1e-12  # Vref; less across a diode is rounding
_SWITCHINGS = 1000
_FAR_APART = 1e10  # conductances further apart than this add up to the greater one


@dataclass(frozen=True)
class ArrayWiring:
    """What an array is made of and read with.

    The defaults are what a designer would take: conductive rubber closes at some 100 ohm, a load a thousand times
    that costs a closed switch 0.1 % of Vref, and half of Vref is where a logic input decides.

    Attributes
    ----------
    contact_ohm
        Resistance of a closed switch.
    wire_ohm
        Resistance of a row or column wire from one tactel to the next; 0: ideal.
    load_ohm
        From the end of each column to ground. "zero-potential" has none.
    threshold
        A tactel reads closed above this: of Vref, or of the current that one closed switch carries.

    Raises
    ------
    NetworkError
        A resistance cannot be, or the threshold lies above what a closed switch alone would read.

    Examples
    --------
    >>> from tacstrip.network import ArrayWiring, scan_array
    >>> wiring = ArrayWiring(load_ohm=100.0, threshold=0.4)  # a load as low as a switch's resistance
    >>> scan_array([[1, 0], [1, 1]], wiring=wiring).closed
    array([[ True, False],
           [ True,  True]])
    """

    contact_ohm: float = 100.0
    wire_ohm: float = 0.0
    load_ohm: float = 100_000.0
    threshold: float = 0.5

    def __post_init__(self) -> None:
        for name in ("contact_ohm", "wire_ohm", "load_ohm"):
            value = getattr(self, name)
            if not (0.0 < value < math.inf or (name == "wire_ohm" and value == 0.0)):
                least = "0 (ideal) or more" if name == "wire_ohm" else "above 0"
                raise NetworkError(f"{name} = {value}: must be a finite number, {least}")
        ohms = [self.contact_ohm, self.load_ohm, self.wire_ohm or self.contact_ohm]
        if max(ohms) > _FAR_APART * min(ohms):
            raise NetworkError(
                f"contact_ohm = {self.contact_ohm:g}, wire_ohm = {self.wire_ohm:g}, load_ohm = {self.load_ohm:g}: "
                f"further apart than a factor of {_FAR_APART:g}: bring them together, or take wire_ohm = 0"
            )
        alone = self.load_ohm / (self.load_ohm + self.contact_ohm)
        if not 0.0 < self.threshold < alone:
            raise NetworkError(
                f"threshold = {self.threshold}: must be above 0 and below {alone:.6g}, which a closed switch alone "
                "reads over its load; lower it or raise load_ohm"
            )


class Array:
    """The network of a pattern. Resistors: closed switches first, then wires, then loads."""

    def __init__(self, pattern: BoolArray, wiring: ArrayWiring) -> None:
        self.wiring = wiring
        self.rows, self.columns = pattern.shape
        self.i, self.j = np.nonzero(pattern)
        every = np.arange(pattern.size).reshape(pattern.shape)
        row_of, column_of = (np.asarray(n, dtype=np.int64) for n in np.indices(pattern.shape))
        wires: list[tuple[IntArray, IntArray]] = []
        if wiring.wire_ohm == 0.0:
            row_node, column_node = row_of, self.rows + column_of
        else:
            row_node, column_node = every, pattern.size + every
            wires = [(row_node[:, :-1], row_node[:, 1:]), (column_node[:-1], column_node[1:])]
        self.row_end, self.column_end = row_node[:, 0], column_node[-1]
        self.from_row, self.to_column = row_node[pattern], column_node[pattern]
        self.ground = int(column_node.max()) + 1
        self._wires = [(a.ravel(), b.ravel(), np.full(a.size, 1.0 / wiring.wire_ohm)) for a, b in wires]

    def network(self, conducting: BoolArray | slice = slice(None), loads: bool = True) -> Network:
        """Return the resistors, with those of the closed switches that conduct."""
        a, b = self.from_row[conducting], self.to_column[conducting]
        parts = [(a, b, np.full(len(a), 1.0 / self.wiring.contact_ohm)), *self._wires]
        if loads:
            to_ground = np.full(self.columns, self.ground)
            parts.append((self.column_end, to_ground, np.full(self.columns, 1.0 / self.wiring.load_ohm)))
        start, end, siemens = (np.concatenate([p[k] for p in parts]) for k in range(3))
        return Network(self.ground + 1, start, end, siemens)

    def potentials(self, isolation: str, driven: IntArray) -> FloatArray:
        """Return the potentials over Vref (nodes, driven), a row driven at a time; NaN where a node floats."""
        if isolation == "none":
            return self._floating(driven)
        if isolation == "diodes":
            return np.stack([self.rectified(int(row))[1] for row in driven], axis=1)
        if isolation == "zero-potential":
            ends = np.concatenate([self.row_end, self.column_end])
            volts = (ends[:, None] == self.row_end[driven]).astype(float)
            return Factored(self.network(loads=False), ends).solve(volts)
        raise OptionError(one_of("isolation", isolation, ISOLATIONS))

    def _floating(self, driven: IntArray) -> FloatArray:
        """Drive each row by 1 A, all with one factor, and scale to Vref."""
        factored = Factored(self.network(), [self.ground])
        fed, which = self.row_end[driven], np.arange(len(driven))
        amperes = np.zeros((self.ground + 1, len(driven)))
        amperes[fed, which] = 1.0
        volts = factored.solve(np.zeros((1, len(driven))), amperes)
        alone = factored.floating[fed]  # no switch closed in this row: nothing else moves
        volts /= np.where(alone, 1.0, volts[fed, which])
        volts[fed[alone], which[alone]] = 1.0
        return volts

    def rectified(self, row: int) -> tuple[BoolArray, FloatArray]:
        """Find the diodes that conduct, and the potentials (nodes,) over Vref.

        Each that conducts has forward current, each that blocks reverse voltage.

        Rows whose diodes all block float at some potential below their columns', and carry nothing.
        """
        conducting = np.ones(len(self.i), dtype=bool)
        for _ in range(_SWITCHINGS):
            held = [int(self.row_end[row]), self.ground]
            volts = Factored(self.network(conducting), held).solve([1.0, 0.0])
            forward = volts[self.from_row] > volts[self.to_column] + _FORWARD
            if np.array_equal(forward, conducting):
                return conducting, volts
            conducting = forward
        raise NetworkError(f"row {row}: its diodes did not settle in {_SWITCHINGS} steps")  # not seen so far

    def flow(self, potentials: FloatArray, isolation: str) -> FloatArray:
        """Return the currents of the closed switches (closed, driven) over Vref / contact_ohm."""
        across = potentials[self.from_row] - potentials[self.to_column]
        flow = np.nan_to_num(across)  # what floats carries none
        return np.asarray(np.maximum(flow, 0.0) if isolation == "diodes" else flow)

    def readings(self, potentials: FloatArray, isolation: str) -> FloatArray:
        """Return what the columns read (driven, columns)."""
        if isolation != "zero-potential":
            return np.asarray(potentials[self.column_end].T)
        total = np.zeros((self.columns, potentials.shape[1]))
        # A column's whole current leaves at its end.
        np.add.at(total, self.j, self.flow(potentials, isolation))
        return total.T


@dataclass(frozen=True, eq=False)
class ArrayScan:
    """One scan of all rows.

    Attributes
    ----------
    closed
        What is read as closed (rows, columns).
    volts
        What the columns read while each row is driven (rows, columns): voltage over Vref or, for "zero-potential",
        current over that of one closed switch.

    Examples
    --------
    >>> from tacstrip.network import scan_array
    >>> scan = scan_array([[1, 0], [1, 1]])
    >>> int(scan.closed.sum()), bool(scan.volts[0, 1] < scan.volts[0, 0] < 1.0)
    (4, True)
    """

    closed: BoolArray
    volts: FloatArray


_IDEAL = ArrayWiring()


def scan_array(pattern: npt.ArrayLike, *, isolation: str = "none", wiring: ArrayWiring = _IDEAL) -> ArrayScan:
    """Scan an array row by row (2.2).

    Parameters
    ----------
    pattern
        Which switches are closed (rows, columns), true or 1.
    isolation
        What keeps current from parallel paths; one of `ISOLATIONS`.
    wiring
        Resistances and the threshold.

    Raises
    ------
    OptionError
        There is no such isolation.
    NetworkError
        The pattern is not a two-dimensional array of true and false, or has more than 1000 rows or columns.

    Examples
    --------
    Three switches of a square close the fourth, unless currents are kept from the parallel path:

    >>> from tacstrip.network import scan_array
    >>> scan_array([[1, 0], [1, 1]]).closed
    array([[ True,  True],
           [ True,  True]])
    >>> scan_array([[1, 0], [1, 1]], isolation="diodes").closed
    array([[ True, False],
           [ True,  True]])
    """
    array = Array(as_pattern(pattern), wiring)
    volts = array.readings(array.potentials(isolation, np.arange(array.rows)), isolation)
    return ArrayScan(volts > wiring.threshold, volts)


def phantoms(pattern: npt.ArrayLike, *, isolation: str = "none", wiring: ArrayWiring = _IDEAL) -> int:
    """Count the open tactels that read closed; arguments and errors as for `scan_array`.

    Examples
    --------
    >>> from tacstrip.network import phantoms
    >>> phantoms([[1, 0], [1, 1]]), phantoms([[1, 0], [1, 1]], isolation="zero-potential")
    (1, 0)
    """
    return int(np.sum(scan_array(pattern, isolation=isolation, wiring=wiring).closed & ~as_pattern(pattern)))


def switch_currents(
    pattern: npt.ArrayLike, row: int, isolation: str = "none", wiring: ArrayWiring = _IDEAL
) -> FloatArray:
    """Return the currents from row to column through all switches (rows, columns) while one row is driven.

    They are over Vref / contact_ohm; 0 where a switch is open. Arguments and errors as for `scan_array`, and
    `OptionError` for a row that does not exist.
    """
    array = Array(as_pattern(pattern), wiring)
    if not 0 <= row < array.rows:
        raise OptionError(f"row = {row}: the array has rows 0 to {array.rows - 1}")
    flow = np.zeros((array.rows, array.columns))
    flow[array.i, array.j] = array.flow(array.potentials(isolation, np.array([row])), isolation)[:, 0]
    return flow


def as_pattern(pattern: npt.ArrayLike) -> BoolArray:
    """Return which switches are closed (rows, columns); `NetworkError` where that is not what is given."""
    try:
        given = np.asarray(pattern)
    except ValueError:
        raise NetworkError(
            "pattern: its rows differ in length; give (rows, columns) of true and false"
        ) from None
    if given.ndim != 2 or min(given.shape) < 1 or max(given.shape) > MOST:
        raise NetworkError(
            f"pattern: an array of shape {given.shape}; give (rows, columns) of true and false, 1 to {MOST} each"
        )
    if given.dtype.kind not in "biuf" or not np.all((given == 0) | (given == 1)):
        raise NetworkError("pattern: holds something else than true and false (or 1 and 0)")
    return np.asarray(given == 1)
