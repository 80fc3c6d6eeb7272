"""Measurements on networks as a netlist that ngspice runs as it is."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tacstrip.errors import NetworkError
from tacstrip.network.nodal import Measurement


def deck(title: str, measurements: Mapping[str, Measurement], vref_volt: float = 1.0) -> str:
    """Return a netlist in which every measurement is a circuit of its own, and which prints every reading.

    What floats is left out: ngspice would call the circuit singular.

    Parameters
    ----------
    title
        The deck's first line.
    measurements
        Suffix to measurement: reading `kh` of the measurement with suffix `3` is printed as `vh_3`; see `READS`.
    vref_volt
        The potential that 1 stands for [V].

    Returns
    -------
    str
        Run it with `ngspice -b FILE`: it prints a line `name = volts` per reading, amperes for a current.

    Raises
    ------
    NetworkError
        A node that is read floats.
    """
    lines = [f"* {title}", "* node n<measurement>_<number>; 0 is ground for all of them"]
    prints = []
    for number, (suffix, measurement) in enumerate(measurements.items()):
        network, metered = measurement.network, set(measurement.metered.values())
        grounded = {n for n, volt in measurement.held.items() if volt == 0.0} - metered
        floating = network.floating(np.array(list(measurement.held)))

        def name(node: int, number: int = number, grounded: set[int] = grounded) -> str:
            return "0" if node in grounded else f"n{number}_{node}"

        for node, volt in measurement.held.items():
            if node not in grounded:
                lines.append(f"V{number}_{node} {name(node)} 0 DC {volt * vref_volt:.17g}")
        for i, (a, b, g) in enumerate(zip(network.start, network.end, network.siemens, strict=True)):
            if not ({int(a), int(b)} <= grounded or floating[a]):
                lines.append(f"R{number}_{i} {name(int(a))} {name(int(b))} {1.0 / g:.17g}")
        for reading, node in measurement.read.items():
            if floating[node]:
                raise NetworkError(f"{reading} of {suffix} floats: no resistor joins it to a held node")
            node_name = name(node)
            value = "0" if node_name == "0" else f"v({node_name})"
            prints.append((f"{READS.get(reading, reading)}_{suffix}", value))
        for reading, node in measurement.metered.items():
            prints.append((f"{reading}_{suffix}", f"i(V{number}_{node})"))
    lines += [".options numdgt=12 gmin=1e-18", ".control", "set numdgt=12", "op"]
    for printed, value in prints:
        lines += [f"let {printed} = {value}", f"print {printed}"]
    return "\n".join([*lines, ".endc", ".end"]) + "\n"


# Signature to the name that its voltage has in a deck.
READS = {"kh": "vh", "kl": "vl", "k": "vout"}
