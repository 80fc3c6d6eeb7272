"""Faults on demand, for teaching labs and for testing the doctor: what a unit with known defects would read.

Cut strips and bridges go through the network of resistors, a piece of the sensor at a time; crossed wires, stuck
values, noise and the converter's faults are done to the readings.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.contact.footprint import footprint
from tacstrip.contact.noise import Noise, add_reading_errors, digitise, generator
from tacstrip.contact.shape import Contact
from tacstrip.diagnose.faults import FAULTS
from tacstrip.diagnose.log import Log
from tacstrip.errors import OptionError, one_of
from tacstrip.network.imperfections import Break, Imperfections, Layer, Readout, Short
from tacstrip.network.strips.measurements import network_readings
from tacstrip.sensor.spec import Sensor
from tacstrip.simulation import readings

_LOAD_OHM = 1e9  # what keeps a cut sensing strip's wire on ground
_NETWORK = ("open-strip", "open-sensing", "short")
_WHOLE = ("bits", "wrong-vref")


@dataclass(frozen=True)
class Defect:
    """A fault to make.

    Attributes
    ----------
    fault
        A fault's name in `diagnose.faults.FAULTS`.
    strip
        Where, counted from 0; of two neighbours the first. None, all strips: saturation, drift, hum, noise;
        always so for bits and wrong-vref.
    size
        open-strip, open-sensing, short: where along the strip, over L. dead, stuck: the value over Vref. saturation:
        the highest value over Vref. wrong-vref: measured over true volts. drift: the change from start to end over
        Vref. hum: its amplitude over Vref. noise: its standard deviation over Vref. bits: the number of low bits that
        are missing. swapped-ends: 0, the pair of strips lies the wrong way round; 1, its Vref and ground alone.
    signature
        The channel of dead, stuck and saturation: "kh", "kl", "k"; all by default.
    hertz, ohm
        Of hum, and of a short.
    """

    fault: str
    strip: int | None = None
    size: float = 0.0
    signature: str | None = None
    hertz: float = 50.0
    ohm: float = 20.0

    def strips(self) -> tuple[int, ...]:
        """Return the strips that a diagnosis should name; none for the whole sensor."""
        if self.strip is None or self.fault in _WHOLE:
            return ()
        return (self.strip, self.strip + 1) if self.fault in ("short", "swapped-strips") else (self.strip,)

    def check(self, sensor: Sensor) -> None:
        """Refuse what cannot be done to this sensor: `OptionError` names it."""
        kinds = [name for name, fault in FAULTS.items() if fault.severity != "note"]
        if self.fault not in kinds:
            raise OptionError(one_of("fault", self.fault, kinds))
        whole = (*_WHOLE, "saturation", "drift", "hum", "noise")
        if self.strip is None and self.fault not in whole:
            raise OptionError(f"{self.fault} needs a strip; all strips together can have: {', '.join(whole)}")
        if any(not 0 <= i < sensor.strips for i in self.strips()):
            raise OptionError(
                f"{self.fault} of strip {self.strip}: the sensor has strips 0 to {sensor.strips - 1}"
            )
        if self.signature is not None:
            sensor.check_signature(self.signature)
        if self.fault == "bits" and sensor.adc_bits is None:
            raise OptionError("bits: the sensor has no adc_bits to lose")


def faulty_log(
    sensor: Sensor,
    contacts: Sequence[Contact],
    defects: Sequence[Defect] = (),
    noise: Noise | None = None,
    rng: int | np.random.Generator = 0,
    rate_hertz: float = 200.0,
    offsets: FloatArray | None = None,
) -> Log:
    """Return what a unit with defects reads of contacts, one scan each.

    Where the spec has `rest_volt`, untouched strips rest there, with noise; else they have no reading.

    Parameters
    ----------
    offsets
        What each strip reads too much half way up (strips,), over Vref: a unit without calibration.

    Raises
    ------
    OptionError
        A defect cannot be on this sensor.
    """
    for defect in defects:
        defect.check(sensor)
    random = generator(rng)
    time_s = np.arange(len(contacts)) / rate_hertz
    k = readings(replace(sensor, adc_bits=None, calibration=None), *footprint(sensor, contacts))
    for defect in defects:
        if defect.fault in _NETWORK:
            _through_network(sensor, contacts, defect, k)
    for name in k:
        if offsets is not None:  # they fade at the ends (6.1.1), where rubber or not the reading is 0 or Vref
            k[name] = k[name] + offsets * (1.0 - k[name] ** 6) * (1.0 - (1.0 - k[name]) ** 6)
        if sensor.rest_volt is not None:
            k[name] = np.where(np.isnan(k[name]), sensor.rest_volt / sensor.vref_volt, k[name])
    for stage in (_wired, _wandering):
        for defect in defects:
            stage(k, defect, time_s)
    k = {name: add_reading_errors(v, noise or Noise(), random) for name, v in k.items()}
    for defect in (d for d in defects if d.fault == "noise"):
        for values in k.values():
            at = slice(None) if defect.strip is None else defect.strip
            values[:, at] += random.normal(0.0, defect.size, values[:, at].shape)
    return Log.of(sensor, time_s, _converted(sensor, k, defects))


def _through_network(
    sensor: Sensor, contacts: Sequence[Contact], defect: Defect, k: dict[str, FloatArray]
) -> None:
    """Put the network's readings of the strips concerned in place; the others do not know of the defect."""
    strips, y = defect.strips(), defect.size * sensor.length_mm
    layer: Layer = (
        "sensing"
        if defect.fault == "open-sensing" or (defect.signature and sensor.sensing_ratio)
        else "energised"
    )
    imperfections = Imperfections(
        breaks=[Break(0, y, layer)] if len(strips) == 1 else (),
        shorts=[Short(0, y, defect.ohm, layer)] if len(strips) == 2 else (),
    )
    readout = Readout(adc_ohm=_LOAD_OHM if defect.fault == "open-sensing" else np.inf)
    piece = replace(sensor, strips=len(strips), adc_bits=None, calibration=None)
    touch = footprint(sensor, contacts).l
    for scan, contact in enumerate(contacts):
        moved = contact.moved(-strips[0] * sensor.pitch_mm, 0.0)
        if np.isnan(touch[scan, list(strips)]).all():
            continue
        read = network_readings(piece, moved, imperfections, readout)
        for name in k:
            k[name][scan, list(strips)] = read[name]


def _wired(k: dict[str, FloatArray], defect: Defect, time_s: FloatArray) -> None:
    i = defect.strip
    if i is None:
        return
    if defect.fault == "swapped-strips":
        for values in k.values():
            values[:, [i, i + 1]] = values[:, [i + 1, i]]
    crossed = defect.fault == "swapped-wires" or (defect.fault == "swapped-ends" and not defect.size)
    if crossed and "kl" in k:
        k["kh"][:, i], k["kl"][:, i] = k["kl"][:, i].copy(), k["kh"][:, i].copy()
    if defect.fault == "swapped-ends":
        for values in k.values():
            values[:, i] = 1.0 - values[:, i]
    if defect.fault == "tied-wires":
        k["kh"][:, i] = k["kl"][:, i] = 0.5 * (k["kh"][:, i] + k["kl"][:, i])


def _wandering(k: dict[str, FloatArray], defect: Defect, time_s: FloatArray) -> None:
    at = slice(None) if defect.strip is None else slice(defect.strip, defect.strip + 1)
    if defect.fault == "drift":
        change = defect.size * time_s / max(time_s[-1], 1e-9)
    elif defect.fault == "hum":
        change = defect.size * np.sin(2.0 * np.pi * defect.hertz * time_s + 0.7)
    else:
        return
    for values in k.values():
        values[:, at] += change[:, None]


def _converted(sensor: Sensor, k: dict[str, FloatArray], defects: Sequence[Defect]) -> dict[str, FloatArray]:
    """Put readings through the amplifier, the multiplexer and the converter."""
    for defect in defects:
        at = slice(None) if defect.strip is None else defect.strip
        for name in k if defect.signature is None else (defect.signature,):
            if defect.fault == "saturation":
                k[name][:, at] = np.minimum(k[name][:, at], defect.size)
            elif defect.fault in ("dead", "stuck"):
                alive = np.isfinite(k[name][:, at])
                k[name][:, at] = np.where(alive, defect.size, np.nan)
    factor = float(np.prod([d.size for d in defects if d.fault == "wrong-vref"]))
    reach = max(factor, 1.0)  # the converter's own reference lies above what the spec calls Vref
    top = 2.0 ** (sensor.adc_bits or 0) - 1.0
    k = {name: digitise(values * factor / reach, sensor.adc_bits) * reach for name, values in k.items()}
    for defect in (d for d in defects if d.fault == "bits"):
        step = reach * 2.0**defect.size / top
        k = {name: np.floor(values / step + 1e-6) * step for name, values in k.items()}
    return k
