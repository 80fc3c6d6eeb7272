"""Channels that are left out: dead, stuck or saturated ones, named "7:v_h" in the spec and on the command line.

A strip keeps what its other channel reads, which also tells whether it is touched; of "7" alone nothing is used.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.errors import SpecError, one_of
from tacstrip.sensor.constructions import SIGNATURES

if TYPE_CHECKING:
    from tacstrip.sensor.spec import Sensor


def channel_name(strip: int, signature: str, strip_base: int) -> str:
    """Return the name of a channel of a strip that is counted from 0, such as "7:v_h"."""
    return f"{strip + strip_base}:{SIGNATURES[signature].volt_column}"


def checked_names(sensor: Sensor) -> tuple[str, ...]:
    """Return the names of the channels left out, or raise `SpecError` where one is none of this sensor."""
    without: object = sensor.without
    if isinstance(without, str) or not isinstance(without, Sequence):
        raise SpecError(f'without = {without!r}: must be a list of channels, such as ["7:v_h"]')
    if without and not sensor.kind.closed_form:
        raise SpecError(
            f"without = {list(without)}: a {sensor.construction} sensor solves all strips together, each with both "
            "readings; leave all fields of the strip empty instead"
        )
    for name in without:
        _parsed(name, sensor)
    return tuple(without)


def leave_out(sensor: Sensor, readings: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Return readings by signature (..., strips) with NaN in the channels that the spec leaves out."""
    out = left_out(sensor)
    return {name: np.where(out[name], np.nan, k) if name in out else k for name, k in readings.items()}


def left_out(sensor: Sensor) -> dict[str, BoolArray]:
    """Return which strips' channels are left out (strips,), by signature; those without any are not there."""
    found: dict[str, BoolArray] = {}
    for name in sensor.without:
        strip, signatures = _parsed(name, sensor)
        for signature in signatures:
            found.setdefault(signature, np.zeros(sensor.strips, dtype=bool))[strip] = True
    return found


def left_out_wholly(sensor: Sensor) -> BoolArray:
    """Return the strips of which every channel is left out (strips,): nobody knows whether they are touched."""
    out = left_out(sensor)
    if any(name not in out for name in sensor.signatures):
        return np.zeros(sensor.strips, dtype=bool)
    return np.asarray(np.all([out[name] for name in sensor.signatures], axis=0))


def _parsed(name: object, sensor: Sensor) -> tuple[int, tuple[str, ...]]:
    """Return the strip, counted from 0, and the signatures that a name means."""
    base, strips = sensor.strip_base, sensor.strips
    number, colon, column = str(name).partition(":")
    columns = {SIGNATURES[s].volt_column: s for s in sensor.signatures}
    if not isinstance(name, str) or not number.isascii() or not number.isdigit():
        raise SpecError(f"without {name!r}: give strip:channel, such as 7:{next(iter(columns))}")
    strip = int(number) - base
    if not 0 <= strip < strips:
        last = strips + base - 1
        raise SpecError(f"without {name!r}: there is no strip {int(number)}; strips are {base} to {last}")
    if not colon:
        return strip, sensor.signatures
    if column not in columns:
        raise SpecError(f"without {name!r}: {one_of('channel', column, columns)}")
    return strip, (columns[column],)
