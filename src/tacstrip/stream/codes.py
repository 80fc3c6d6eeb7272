"""Convert scans to raw A/D codes and back.

Codes run from 0 to 2^adc_bits - 1, which reads Vref, as `contact.noise.digitise` makes them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, TypeVar, cast

import numpy as np

from tacstrip.arguments import takes
from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.errors import ReadingError, RecordingError
from tacstrip.scan import Scan
from tacstrip.sensor.layers import AnySensor, LayeredSensor, unit_of
from tacstrip.sensor.left_out import channel_name, left_out
from tacstrip.sensor.raw import apply_calibration, invert_calibration
from tacstrip.sensor.spec import Sensor
from tacstrip.stream.source import CodeArray, RawScan

ELECTRODES = "electrodes"
_Sensor = TypeVar("_Sensor", bound="AnySensor")
UNSET_BITS = 16  # where the spec has no adc_bits


def with_converter(sensor: _Sensor) -> _Sensor:
    """Return the sensor with the resolution of its stored codes: 16 bits where the spec gives none."""
    if sensor.adc_bits is not None:
        return sensor
    if isinstance(sensor, LayeredSensor):
        return cast(_Sensor, sensor.changed(adc_bits=UNSET_BITS))
    return replace(sensor, adc_bits=UNSET_BITS)


def top_code(sensor: AnySensor) -> int:
    """Return the code that reads Vref."""
    return int(2 ** (sensor.adc_bits or UNSET_BITS) - 1)


def code_type(sensor: AnySensor) -> np.dtype[np.unsignedinteger[Any]]:
    """Return the unsigned type that holds the sensor's codes, of 16 or 32 bits."""
    return np.dtype("<u2" if top_code(sensor) < 2**16 else "<u4")


def code_shape(sensor: AnySensor, name: str) -> tuple[int, ...]:
    """Return the shape of one scan's codes of a name."""
    return (sensor.strips, 2 * sensor.strips) if name == ELECTRODES else (sensor.strips,)


@takes(scan=Scan, sensor=Sensor | LayeredSensor)
def encode(scan: Scan, sensor: AnySensor, sequence: int = 0) -> RawScan:
    """Return a scan as A/D codes, each reading rounded to the nearest code; 0 where nothing touches.

    A calibration of the sensor is inverted, so that the codes are those that its converter would read.

    Parameters
    ----------
    scan
        The readings over Vref.
    sensor
        The sensor that the scan was made with; a spec without `adc_bits` gives codes of 16 bits.
    sequence
        Number of the scan.

    Returns
    -------
    RawScan
        The codes, 0 to 2^adc_bits - 1.

    Raises
    ------
    ReadingError, SignatureError
        The scan is not of this sensor, or lacks a reading of a touched strip that the spec does not leave out.

    Examples
    --------
    >>> import tacstrip as ts
    >>> from tacstrip.stream import encode
    >>> sensor = ts.Sensor(construction="crs-m", strips=2, pitch_mm=5.0, length_mm=100.0, adc_bits=10)
    >>> raw = encode(ts.Scan(k=[0.5, float("nan")]), sensor)
    >>> raw.codes["k"].tolist(), raw.touched.tolist()
    ([512, 0], [True, False])
    """
    sensor = unit_of(sensor)
    scan.check(sensor)
    for name in scan.signatures:
        lost = scan.half_read & np.isnan(scan[name]) & ~left_out(sensor).get(name, np.array(False))
        if len(at := np.flatnonzero(lost)):
            channel = channel_name(int(at[0]), name, sensor.strip_base)
            raise ReadingError(
                f"{channel} has no reading where the strip's other channel has one, and codes cannot say that: "
                f'write without = ["{channel}"] into the spec'
            )
    return RawScan(scan.time_s, to_codes(_raw(scan, sensor), sensor), scan.touched, sequence)


def to_codes(raw: Mapping[str, FloatArray], sensor: Sensor) -> dict[str, CodeArray]:
    """Return raw readings over Vref of any shape as codes, 0 for NaN."""
    kind, top = code_type(sensor), top_code(sensor)
    return {name: np.nan_to_num(np.round(values * top)).astype(kind) for name, values in raw.items()}


def quantisation_error(scan: Scan, sensor: AnySensor) -> float:
    """Return the largest distance of a reading from its code, in steps of the converter, 0 to 0.5."""
    sensor = unit_of(sensor)
    steps = np.concatenate([v.ravel() for v in _raw(scan, sensor).values()]) * top_code(sensor)
    return float(np.nanmax(np.abs(steps - np.round(steps)), initial=0.0))


@takes(raw=RawScan, sensor=Sensor | LayeredSensor)
def decode(raw: RawScan, sensor: AnySensor) -> Scan:
    """Return the readings of A/D codes: over Vref, calibrated, NaN where nothing touches.

    Where the spec has `rest_volt`, strips whose every reading is within `touch_volt` of it are untouched too.

    Parameters
    ----------
    raw
        The codes.
    sensor
        The sensor, with its `adc_bits` and calibration.

    Raises
    ------
    RecordingError
        A code is above the converter's range.
    ReadingError
        The codes do not form a scan.

    Examples
    --------
    >>> import tacstrip as ts
    >>> from tacstrip.stream import decode, encode
    >>> sensor = ts.Sensor(construction="crs-m", strips=2, pitch_mm=5.0, length_mm=100.0, adc_bits=1)
    >>> decode(encode(ts.Scan(k=[1.0, float("nan")]), sensor), sensor).k
    array([ 1., nan])
    """
    read = over_vref(raw.codes, raw.touched, sensor)
    if ELECTRODES in read:
        return Scan.of_electrodes(read[ELECTRODES], raw.time_s)
    return Scan(**read, time_s=raw.time_s)


def over_vref(codes: Mapping[str, CodeArray], touched: BoolArray, sensor: AnySensor) -> dict[str, FloatArray]:
    """Return the calibrated readings of A/D codes over Vref, NaN where nothing touches.

    `touched`, the codes and the results have the shape (strips,) or (scans, strips); electrodes have a further axis of
    2 strips. Errors as of `decode`.
    """
    sensor = unit_of(sensor)
    top = top_code(sensor)
    if (most := max(int(values.max(initial=0)) for values in codes.values())) > top:
        raise RecordingError(
            f"a scan has the code {most}, above {top}: adc_bits = {sensor.adc_bits} of the spec is wrong"
        )
    if ELECTRODES not in codes:
        raw = {name: np.where(touched, values / top, np.nan) for name, values in codes.items()}
        return apply_calibration(sensor, raw)
    columns = np.moveaxis(codes[ELECTRODES], -1, 0)  # (2 strips, ..., strips)
    raw = {str(i): np.where(touched, column / top, np.nan) for i, column in enumerate(columns)}
    return {ELECTRODES: np.stack(list(apply_calibration(sensor, raw).values()), axis=-1)}


def _raw(scan: Scan, sensor: Sensor) -> dict[str, FloatArray]:
    read = {name: scan[name] for name in scan.signatures}
    return invert_calibration(sensor, read if scan.electrodes is None else {ELECTRODES: scan.electrodes})
