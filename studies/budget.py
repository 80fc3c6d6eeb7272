"""The budget of positional uncertainty: what each imperfection costs, and how much of it profile I allows.

Open question 1 of the thesis (7.5): which build keeps the errors small. Contacts are drawn at random on the published
CRS-CRS and CRS-M prototypes; an imperfection's cost is the 95 % point of its error over strips and contacts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure

from tacstrip.contact.shape import Contact
from tacstrip.network.imperfections import Imperfections, Readout
from tacstrip.network.strips.ladder import fast_readings
from tacstrip.plot.theme import COLOURS, new_axes
from tacstrip.sensor.spec import Sensor

PROFILE_I, PROFILE_II = 0.005, 0.01  # of Vref, table 5.1
_CONTACTS, _PIECES = 12, 13
_CELLS = 64


@dataclass(frozen=True)
class Imperfection:
    """One way in which a unit departs from the ideal, by a size in a unit.

    Attributes
    ----------
    name, unit
        For tables.
    unit_at
        Size to (spec, imperfections, readout), drawn with the generator where it is random.
    largest
        Where the search for the tolerance ends.
    """

    name: str
    unit: str
    unit_at: Callable[[Sensor, float, np.random.Generator], tuple[Sensor, Imperfections, Readout]]
    largest: float


def _uneven(
    sensor: Sensor, size: float, random: np.random.Generator
) -> tuple[Sensor, Imperfections, Readout]:
    shape = (sensor.strips, _PIECES)
    energised, sensing = (1.0 + size / 100.0 * random.uniform(-1.0, 1.0, shape) for _ in range(2))
    return sensor, Imperfections(energised, sensing), Readout()


def _unequal(
    sensor: Sensor, size: float, random: np.random.Generator
) -> tuple[Sensor, Imperfections, Readout]:
    return sensor, Imperfections(sensing=1.0 + size / 100.0), Readout()


def _resistive(
    sensor: Sensor, size: float, random: np.random.Generator
) -> tuple[Sensor, Imperfections, Readout]:
    return replace(sensor, contact_lambda_mm=size), Imperfections(), Readout()


def _switches(
    sensor: Sensor, size: float, random: np.random.Generator
) -> tuple[Sensor, Imperfections, Readout]:
    return sensor, Imperfections(), Readout(mux_ohm=size / 100.0 * Readout().strip_ohm)


def _leaky(sensor: Sensor, size: float, random: np.random.Generator) -> tuple[Sensor, Imperfections, Readout]:
    return sensor, Imperfections(), Readout(adc_ohm=100.0 / size * Readout().strip_ohm)


IMPERFECTIONS = (
    Imperfection("resistivity uneven along strips, in 13 pieces", "+-% of nominal", _uneven, 50.0),
    Imperfection("sensing strips more resistive than energised ones", "%", _unequal, 300.0),
    Imperfection("contact resistance not known, lambda", "mm", _resistive, 50.0),
    Imperfection("on-resistance of switches over a strip's", "%", _switches, 20.0),
    Imperfection("a strip's resistance over the A/D input's", "%", _leaky, 50.0),
)


def cost(sensor: Sensor, imperfection: Imperfection, size: float, seed: int = 0) -> float:
    """Return the 95 % point of the error that an imperfection of a size makes, over Vref."""
    random = np.random.default_rng(seed)
    errors = []
    for _ in range(_CONTACTS):
        contact = _contact(sensor, random)
        spec, imperfections, readout = imperfection.unit_at(sensor, size, random)
        ideal = fast_readings(sensor, contact, cells=_CELLS)
        real = fast_readings(spec, contact, imperfections, readout, cells=_CELLS)
        errors += [np.abs(real[name] - ideal[name]) for name in ideal]
    return float(np.nanpercentile(np.concatenate(errors), 95.0))


def tolerance(sensor: Sensor, imperfection: Imperfection, limit: float = PROFILE_I) -> float | None:
    """Return the size whose cost is the limit, to 1 %; None where the largest size does not reach it."""
    low, high = 0.0, imperfection.largest
    if cost(sensor, imperfection, high) < limit:
        return None
    while high - low > 0.01 * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if cost(sensor, imperfection, middle) < limit else (low, middle)
    return high


def budget() -> list[dict[str, object]]:
    """Return, per imperfection, its tolerance for profile I on either prototype; None: no limit found."""
    sensors = {name: Sensor.load(f"prototype-{name}") for name in ("crs-crs", "crs-m")}
    return [
        {
            "imperfection": i.name,
            "unit": i.unit,
            **{name: tolerance(sensor, i) for name, sensor in sensors.items()},
        }
        for i in IMPERFECTIONS
    ]


def budget_figure() -> Figure:
    """Cost of each imperfection as it grows: where a line crosses 0.5 %, profile I is spent on it alone."""
    figure, axes = new_axes(6.4, 5.0)
    sensor = Sensor.load("prototype-crs-m")
    crs = Sensor.load("prototype-crs-crs")
    colours = (*COLOURS.values(), "#b8860b")
    for imperfection, colour, marker in zip(IMPERFECTIONS, colours, "os^Dv", strict=False):
        sizes = np.geomspace(0.1, 20.0, 9)
        shown = crs if cost(crs, imperfection, 20.0) > 1e-9 else sensor
        label = f"{imperfection.name} [{imperfection.unit}], {shown.construction}"
        costs = [100.0 * cost(shown, imperfection, s) for s in sizes if s <= imperfection.largest]
        axes.loglog(sizes[: len(costs)], costs, marker + "-", color=colour, markersize=4.0, label=label)
    for level, name in ((PROFILE_I, "P.U. profile I"), (PROFILE_II, "profile II")):
        axes.axhline(100.0 * level, color="#999999", linestyle=":")
        axes.annotate(name, (0.1, 105.0 * level), fontsize=8.0, color="#666666")
    axes.set_xlabel("size of the imperfection, in its unit")
    axes.set_ylabel("error, 95 % point [% of Vref]")
    axes.set_ylim(1e-3, 30.0)
    figure.legend(loc="outside lower left", frameon=False, fontsize=8.0)
    return figure


def _contact(sensor: Sensor, random: np.random.Generator) -> Contact:
    """Draw a quadrilateral over most strips, up to a third of their length high."""
    width, length = sensor.width_mm, sensor.length_mm
    height = random.uniform(0.05, 0.33) * length
    low = random.uniform(0.02, 0.98) * (length - 2.0 * height) + height
    y = low + height * random.uniform(-0.5, 0.5, 2)
    left, right = 0.02 * width, 0.98 * width
    return Contact.polygon(
        [(left, y[0] - height / 3), (right, y[1] - height / 3), (right, y[1]), (left, y[0] + height / 3)]
    )
