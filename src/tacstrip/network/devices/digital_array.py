"""The digital array of cross-switches (thesis, 2.2) as a network, and its phantoms over parallel paths (figure 2.4).

Tactel (i, j), row i and column j, has its centre at x = (j + 0.5) pitch, y = (i + 0.5) pitch. The circuit is in
`switches.py`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.errors import NetworkError, OptionError
from tacstrip.network.devices.switches import ISOLATIONS as ISOLATIONS
from tacstrip.network.devices.switches import Array
from tacstrip.network.devices.switches import ArrayWiring as ArrayWiring
from tacstrip.network.grid import MOST


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
