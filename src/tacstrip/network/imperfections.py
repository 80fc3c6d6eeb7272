"""How a real unit departs from the ideal one, and how it is read."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from tacstrip.arrays import FloatArray
from tacstrip.errors import NetworkError, one_of
from tacstrip.sensor.spec import Sensor

Layer = Literal["energised", "sensing"]
_LAYERS = ("energised", "sensing")


@dataclass(frozen=True)
class Break:
    """A strip that is cut through: strip, counted from 0, where [mm], and which of the two.

    Examples
    --------
    A strip that is cut below the contact reads Vref:

    >>> import tacstrip as ts
    >>> from tacstrip.network import Break, Imperfections
    >>> sensor = ts.Sensor(construction="crs-crs", strips=3, pitch_mm=10.0, length_mm=100.0)
    >>> contact = ts.Contact.polygon([(0, 40), (30, 40), (30, 60), (0, 60)])
    >>> cut = Imperfections(breaks=[Break(1, 20.0)])
    >>> ts.simulate(sensor, contact, model="network", imperfections=cut)["kh"].round(3)
    array([0.556, 1.   , 0.556])
    """

    strip: int
    y_mm: float
    layer: Layer = "energised"


@dataclass(frozen=True)
class Short:
    """A bridge from a strip to the next one: strip, counted from 0, where [mm], how many ohms, which layer.

    Examples
    --------
    >>> from tacstrip.network import Imperfections, Short
    >>> bridged = Imperfections(shorts=[Short(3, 130.0, 1000.0, layer="sensing")])
    >>> bridged.shorts[0].strip
    3
    """

    strip: int
    y_mm: float
    ohm: float
    layer: Layer = "energised"


@dataclass(frozen=True, eq=False)
class Imperfections:
    """Imperfections of a unit; the ideal one by default.

    Attributes
    ----------
    energised, sensing
        Resistivity of the strips over the nominal one: a number, (strips,), or (strips, pieces) in pieces
        of equal length from y = 0 upwards. A strip stretched over a part has more there.
    shift_mm
        How far each sensing strip lies above its partner [mm]: a number or (strips,). They touch only
        where they overlap.
    breaks, shorts
        Strips cut through, and bridges between neighbours.

    Examples
    --------
    A strip whose lower half has twice the resistance:

    >>> import tacstrip as ts
    >>> from tacstrip.network import Imperfections
    >>> sensor = ts.Sensor(construction="crs-m", strips=2, pitch_mm=10.0, length_mm=100.0)
    >>> uneven = Imperfections(energised=[[1.0, 1.0], [2.0, 1.0]])
    >>> contact = ts.Contact.points([(5, 50), (15, 50)])
    >>> ts.simulate(sensor, contact, model="network", imperfections=uneven)["k"].round(3)
    array([0.5  , 0.667])
    """

    energised: npt.ArrayLike = 1.0
    sensing: npt.ArrayLike = 1.0
    shift_mm: npt.ArrayLike = 0.0
    breaks: Sequence[Break] = ()
    shorts: Sequence[Short] = ()

    def profile(self, strip: int, layer: Layer) -> FloatArray:
        """Return one strip's resistivity over the nominal one, piece by piece (pieces,)."""
        given = np.asarray(self.energised if layer == "energised" else self.sensing, dtype=float)
        return np.atleast_1d(given[strip] if given.ndim else given)

    def shift(self, strip: int) -> float:
        """Return how far one sensing strip lies above its partner [mm]."""
        given = np.asarray(self.shift_mm, dtype=float)
        return float(given[strip] if given.ndim else given)

    def check(self, sensor: Sensor) -> None:
        """Refuse what cannot be on this sensor: `NetworkError` names it."""
        for name in ("energised", "sensing", "shift_mm"):
            given, shift = np.asarray(getattr(self, name), dtype=float), name == "shift_mm"
            if given.ndim > (1 if shift else 2) or (given.ndim and given.shape[0] != sensor.strips):
                pieces = "" if shift else f" or ({sensor.strips}, pieces)"
                wanted = f"a number, ({sensor.strips},){pieces}"
                raise NetworkError(f"{name}: an array of shape {given.shape}; give {wanted}")
            good = np.isfinite(given) & ((given > 0.0) | shift)
            if not good.all():
                strip = int(np.argwhere(~np.atleast_1d(good))[0][0])
                least = "" if shift else " above 0"
                raise NetworkError(f"{name}: strip {strip} has a value that is not a finite number{least}")
        faults: list[Break | Short] = [*self.breaks, *self.shorts]
        for fault in faults:
            last = sensor.strips - (2 if isinstance(fault, Short) else 1)
            if fault.layer not in _LAYERS:
                raise NetworkError(one_of("layer", fault.layer, _LAYERS))
            if not 0 <= fault.strip <= last or not 0.0 <= fault.y_mm <= sensor.length_mm:
                raise NetworkError(
                    f"{fault} is not on the sensor: strips 0 to {last}, y 0 to {sensor.length_mm:.6g} mm"
                )
            if isinstance(fault, Short) and not 0.0 < fault.ohm < math.inf:
                raise NetworkError(f"{fault}: ohm must be a finite number above 0")


@dataclass(frozen=True)
class Readout:
    """How a unit is wired and read; ideal by default.

    Attributes
    ----------
    strip_ohm
        Resistance of an energised strip from end to end; everything else is relative to it.
    mux_ohm
        On-resistance of a switch of the multiplexer: at either end of the energised strip where strips are
        switched in turn, else (CRS-CRS) between the sensing strip and the converter.
    supply_ohm
        Resistor between Vref and the switches where strips are switched in turn, which limits what a short draws.
    adc_ohm
        Input resistance of the converter, from each end that is read to ground.
    tied_grounds
        CRS-M: all strips' ground ends are joined for good, so that n + 2 connectors do. The strips that
        touch then load the sheet: the parallel path of figure 2.4.

    Examples
    --------
    The switches of a multiplexer lie in series with the strip:

    >>> import tacstrip as ts
    >>> from tacstrip.network import Readout
    >>> sensor = ts.Sensor(construction="crs-m", strips=1, pitch_mm=10.0, length_mm=100.0)
    >>> switched = Readout(strip_ohm=5000.0, mux_ohm=70.0)
    >>> ts.simulate(sensor, ts.Contact.points([5.0, 0.0]), model="network", readout=switched)["k"].round(4)
    array([0.0136])
    """

    strip_ohm: float = 10_000.0
    mux_ohm: float = 0.0
    supply_ohm: float = 0.0
    adc_ohm: float = math.inf
    tied_grounds: bool = False

    def __post_init__(self) -> None:
        for name, good in (
            ("strip_ohm", 0.0 < self.strip_ohm < math.inf),
            ("mux_ohm", 0.0 <= self.mux_ohm < math.inf),
            ("supply_ohm", 0.0 <= self.supply_ohm < math.inf),
            ("adc_ohm", self.adc_ohm > 0.0),
        ):
            if not good:
                least = "0 or more" if name in ("mux_ohm", "supply_ohm") else "above 0"
                raise NetworkError(f"{name} = {getattr(self, name)}: must be {least}")
