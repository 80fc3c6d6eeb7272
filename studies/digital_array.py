"""The digital array as measurements on networks, row by row: for the plain solver and for ngspice."""

from __future__ import annotations

import numpy.typing as npt

from tacstrip.errors import OptionError, one_of
from tacstrip.network.devices.digital_array import ISOLATIONS, Array, ArrayWiring, as_pattern
from tacstrip.network.nodal import Measurement

_IDEAL = ArrayWiring()


def array_measurements(
    pattern: npt.ArrayLike, isolation: str = "none", wiring: ArrayWiring = _IDEAL
) -> dict[int, Measurement]:
    """Return the scan as measurements on networks, row to its measurement.

    Readings are `vcolumn<j>` [Vref] or, for "zero-potential", the currents `icolumn<j>` [Vref / ohm]. A diode that
    blocks is left out, one that conducts is a closed switch. Arguments and errors as for `scan_array`.
    """
    array = Array(as_pattern(pattern), wiring)
    return {row: _measurement(array, isolation, row) for row in range(array.rows)}


def _measurement(array: Array, isolation: str, row: int) -> Measurement:
    names, ends = [f"column{j}" for j in range(array.columns)], array.column_end.tolist()
    if isolation == "zero-potential":
        held = dict.fromkeys([*array.row_end.tolist(), *ends], 0.0) | {int(array.row_end[row]): 1.0}
        metered = {f"i{name}": end for name, end in zip(names, ends, strict=True)}
        return Measurement(array.network(loads=False), held, {}, metered)
    if isolation not in ISOLATIONS:
        raise OptionError(one_of("isolation", isolation, ISOLATIONS))
    network = array.network(array.rectified(row)[0]) if isolation == "diodes" else array.network()
    read = {f"v{name}": end for name, end in zip(names, ends, strict=True)}
    return Measurement(network, {int(array.row_end[row]): 1.0, array.ground: 0.0}, read)
