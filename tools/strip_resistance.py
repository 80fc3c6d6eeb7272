"""Table of docs/science/electronics.md: rubber for the ten-strip sensor. `python tools/strip_resistance.py`."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np

import tacstrip as ts
from tacstrip.arrays import FloatArray
from tacstrip.contact.signature import signatures
from tacstrip.network import Readout
from tacstrip.network.timing import settling_s, source_ohm

SETTINGS = (Path(__file__).parents[1] / "firmware" / "core" / "settings.h").read_text(encoding="utf-8")
WIDTH_MM, THICK_MM, LENGTH_MM, STRIPS = 6.0, 1.0, 100.0, 10
PULL_OHM, SWITCH_OHM, NODE_FARAD, VREF_VOLT, BITS = 100e3, 70.0, 100e-12, 5.0, 10
SERIES_OHM = 100.0  # CRS-M: in the multiplexer's 5 V, so that a shorted strip draws what a switch bears
SHORTEST_MM = 5.0  # of a contact along the strips, for its place
SAMPLER_FARAD, SAMPLE_S = 14e-12, 1.5 / 250e3  # of the ATmega328P's converter, at its clock of 250 kHz
RESISTIVITIES = (0.03, 0.1, 0.3, 1.0, 1.5, 2.0, 4.0, 10.0)  # [ohm m]
FEW_CODES = 1.0  # the converter itself promises 2


def setting(name: str) -> float:
    """Return a number that the firmware is built with."""
    (value,) = re.findall(rf"#define {name} (\d+)", SETTINGS)
    return float(value)


def strip_ohm(resistivity: float) -> float:
    """Return a strip's resistance between its clamps [ohm], of a resistivity [ohm m]."""
    return resistivity * LENGTH_MM / (WIDTH_MM * THICK_MM) * 1e3


def sensor(construction: str) -> ts.Sensor:
    """Return the guide's sensor."""
    return ts.Sensor(
        construction=construction, strips=STRIPS, pitch_mm=10.0, length_mm=LENGTH_MM, adc_bits=BITS
    )


def readout(ohm: float) -> Readout:
    """Return the guide's electronics about strips of so many ohm."""
    return Readout(ohm, SWITCH_OHM, supply_ohm=SERIES_OHM)


def grid() -> tuple[FloatArray, FloatArray]:
    """Return lower and upper ends of contacts of any place and length (contacts,) [mm]."""
    ends = np.linspace(0.0, LENGTH_MM, 101)
    l, u = np.meshgrid(ends, ends)
    return l[l <= u], u[l <= u]


def touch_is_detected(construction: str, ohm: float) -> bool:
    """Tell whether the pulls of a touched line lie close enough together, wherever it is touched."""
    seen = float(source_ohm(sensor(construction), readout(ohm), *grid()).max())
    return seen / (seen + PULL_OHM) < 1.0 / setting("TOUCH_PART")


def unsettled_codes(construction: str, ohm: float) -> float:
    """Return how far a reading may be from its line as it should be [codes], at the worst contact.

    The line comes back from its pull for the firmware's pause. Then the converter's own capacitor is joined to it,
    which has what was converted before: the pulled line, or the strip's other end.
    """
    unit, (l, u) = sensor(construction), grid()
    seen = source_ohm(unit, readout(ohm), l, u)
    pulled = seen / (seen + PULL_OHM)
    back = pulled * np.exp(-setting("RELEASED_US") * 1e-6 / (seen * NODE_FARAD))
    joined = SAMPLER_FARAD / (NODE_FARAD + SAMPLER_FARAD)
    sampled = np.exp(-SAMPLE_S / (seen * (NODE_FARAD + SAMPLER_FARAD)))
    off = ((1.0 - joined) * back + joined * pulled) * sampled
    if not unit.kind.common_supply:
        return float(off.max()) * (2.0**BITS - 1.0)
    ideal = signatures(unit, l, u)
    other = joined * np.abs(ideal["kh"] - ideal["kl"]) * sampled
    return max(float(off.max()), float(other.max())) * (2.0**BITS - 1.0)


def switch_error(ohm: float) -> float:
    """Return how far CRS-M's k is off for its switches, before calibration [Vref]: points along the strips."""
    unit = replace(sensor("crs-m"), adc_bits=None)
    ys = np.linspace(0.0, LENGTH_MM, 5)
    errors = []
    for y in ys.tolist():
        touch = ts.Contact.points([(45.0, y)])
        real = ts.simulate(unit, touch, model="network", readout=readout(ohm))
        errors.append(float(np.nanmax(np.abs(real["k"] - ts.simulate(unit, touch)["k"]))))
    return max(errors)


def settles_us(construction: str, ohm: float) -> float:
    """Return how long a line takes to half a code at the worst contact [us]."""
    seen = float(source_ohm(sensor(construction), readout(ohm), *grid()).max())
    return 1e6 * settling_s(seen, NODE_FARAD + SAMPLER_FARAD, BITS)


def position_error_mm(construction: str, ohm: float) -> float:
    """Return how far an end of a contact may be off [mm], at the worst contact: what has not settled, and half a code.

    On CRS-M the mean of both ends, and its errors of the switches before calibration too.
    """
    off = (unsettled_codes(construction, ohm) + 0.5) / (2.0**BITS - 1.0)
    if construction == "crs-m":
        return LENGTH_MM * (off + switch_error(ohm))
    unit, (l, u) = sensor(construction), grid()
    long = u - l >= SHORTEST_MM
    ideal = signatures(unit, l[long], u[long])
    worst = 0.0
    for up, down in ((off, off), (off, -off)):
        kh, kl = ideal["kh"] + up, ideal["kl"] + down
        found = LENGTH_MM * np.array([kl, 2.0 * kh - kl]) / (1.0 + kh - kl)
        worst = max(worst, float(np.abs(found - [l[long], u[long]]).max()))
    return worst


def short_ma(construction: str) -> float:
    """Return what a strip that is shorted from end to end draws [mA], while it is selected."""
    return 1e3 * VREF_VOLT / (2.0 * SWITCH_OHM + SERIES_OHM) if construction == "crs-m" else math.inf


def verdict(construction: str, ohm: float) -> str:
    """Return in words whether such strips can be used."""
    if not touch_is_detected(construction, ohm):
        return "no: touch is missed"
    if (codes := unsettled_codes(construction, ohm)) > FEW_CODES:
        return f"no: {rounded(codes)} codes unsettled"
    return "yes"


def rounded(value: float) -> str:
    """Return a number with two digits that count."""
    return f"{float(f'{value:.2g}'):g}"


def rows() -> list[tuple[str, ...]]:
    """Return the table's cells."""
    table: list[tuple[str, ...]] = []
    for resistivity in RESISTIVITIES:
        ohm = strip_ohm(resistivity)
        table.append(
            (
                f"{resistivity:g} ({100.0 * resistivity:g})",
                f"{rounded(ohm / 1e3)} kΩ",
                f"{rounded(1e3 * STRIPS * VREF_VOLT / ohm)} mA",
                *(
                    cell
                    for kind in ("crs-crs", "crs-m")
                    for cell in (
                        f"{rounded(settles_us(kind, ohm))} µs",
                        f"{rounded(position_error_mm(kind, ohm))} mm",
                        verdict(kind, ohm),
                    )
                ),
            )
        )
    return table


def largest_ohm(construction: str) -> float:
    """Return the largest strip that can be used [ohm]."""
    low, high = 100.0, 1e6
    while high / low > 1.001:
        middle = math.sqrt(low * high)
        low, high = (middle, high) if verdict(construction, middle) == "yes" else (low, middle)
    return low


def main() -> None:
    """Print the table, and where it ends."""
    for row in rows():
        print(f"| {' | '.join(row)} |")
    print(f"a shorted CRS-M strip: {short_ma('crs-m'):.3g} mA")
    for construction in ("crs-crs", "crs-m"):
        print(f"{construction}: up to {largest_ohm(construction) / 1e3:.3g} kΩ")


if __name__ == "__main__":
    main()
