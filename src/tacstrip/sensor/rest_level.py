"""Recordings whose untouched strips have readings that the spec does not separate from those of a contact.

The sign: strips at a border read one level, k_h and k_l the same where there are both, and readings jump from
it. Of all contacts over every strip only a thin line with a block on it does so: the readings of a convex one are a
smooth curve with kinks, and its k_h lies above k_l.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.sensor.spec import Sensor

# Over Vref: untouched strips differ by less, with noise of P.U. profile II and their own offsets.
_BAND = 0.03
_JUMP = 0.05  # over Vref: from the level to the first strip that is touched
_STEEPER = 3.0  # such a jump over the next step: along an edge of a contact steps differ by less
_FEWEST = 6  # strips: with fewer, no hint is given
_SHARE = 0.5  # of the scans with a contact
_MOST_SCANS = 400  # of longer recordings, scans evenly spread are looked at
_EVERY = "every strip has a reading, so every strip counts as touched"


def rest_hint(
    sensor: Sensor, raw: Mapping[str, FloatArray], failed: bool = False, pressed: bool = False
) -> str:
    """Say that untouched strips have readings and what to write into the spec; nothing where all seems well.

    Parameters
    ----------
    sensor
        Its `rest_volt` and `touch_volt` did not separate touched from untouched strips.
    raw
        Raw readings over Vref by signature, (strips,) or (scans, strips), NaN where nothing touches.
    failed
        Whether no good shape came of them: then it is said, with an if, wherever all strips of all scans have readings.
    pressed
        Whether each scan is a press that was meant for all strips: where they read alike they were reached, and a
        single row in which they do not is a slip.
    """
    values = np.stack([np.atleast_2d(v) for v in raw.values()], axis=1)  # (scans, signatures, strips)
    whole = np.isfinite(values).all(axis=(1, 2))
    if not whole.any() or values.shape[2] < _FEWEST:
        return ""
    looked = values[whole][np.linspace(0, whole.sum() - 1, min(whole.sum(), _MOST_SCANS)).astype(int)]
    found = [_resting(scan) for scan in looked]
    sure = [f for f in found if f is not None and f.level is not None]
    decisive = found if pressed else [f for f in found if f is not None]
    if sure and len(sure) >= _SHARE * len(decisive):
        levels = np.array([f.level for f in sure])
        middle = float(np.median(levels))
        alike = np.abs(levels - middle) <= _BAND
        if alike.mean() >= _SHARE:
            return _hint(sensor, middle, [f for f, same in zip(sure, alike, strict=True) if same])
    return all_read_hint(sensor, raw) if failed else ""


def all_read_hint(sensor: Sensor, raw: Mapping[str, FloatArray]) -> str:
    """Say, with an if, that untouched strips may have readings: all strips of all scans have. Arguments likewise."""
    values = np.stack([np.atleast_2d(v) for v in raw.values()])
    if sensor.rest_volt is not None or values.shape[2] < _FEWEST or not np.isfinite(values).all():
        return ""
    return f"{_EVERY}: if untouched strips have readings too, set rest_volt and touch_volt in the spec"


@dataclass(frozen=True)
class _Rest:
    """The level of the strips at rest in one scan, None where none are; their number and largest deviation."""

    level: float | None = None
    count: int = 0
    off: float = 0.0


def _hint(sensor: Sensor, level: float, scans: list[_Rest]) -> str:
    n, vref = int(np.median([s.count for s in scans])), sensor.vref_volt
    off = max(abs((s.level or 0.0) - level) + s.off for s in scans)
    old = sensor.rest_volt, sensor.touch_volt
    now = "" if old[0] is None else f" in place of {old[0]:.4g} and {old[1]:.4g}"
    return (
        f"{_EVERY}; {n} of {sensor.strips} read about {level * vref:.3g} V, as untouched strips do: set "
        f"rest_volt = {level * vref:.3g} and touch_volt = {max(1.5 * off, 0.01) * vref:.2g} in the spec{now} "
        "(`tacstrip calibrate --touch` learns them)"
    )


def _resting(k: FloatArray) -> _Rest | None:
    """Find strips at rest in one scan (signatures, strips), all with readings; None where the scan does not decide."""
    middle = k.mean(axis=0)
    thin = np.ptp(k, axis=0) <= _BAND
    level = _commonest(middle[thin])
    if math.isnan(level):
        return _Rest()
    rest = thin & (np.abs(middle - level) <= _BAND / 2.0)
    count = int(rest.sum())
    if rest.all():
        return None  # no contact, or a line along all strips
    if count < (2 if len(k) > 1 else 3) or not (rest[:2].all() or rest[-2:].all()):
        return _Rest()
    jumps = _jumps(k, level, rest)
    if 2 * sum(jumps) < len(jumps):
        return _Rest()
    return _Rest(level, count, float(np.abs(k[:, rest] - level).max()))


def _commonest(values: FloatArray) -> float:
    """Return the middle of the band that holds most values; NaN where there are none."""
    if not len(values):
        return math.nan
    low = np.sort(values)
    held = np.searchsorted(low, low + _BAND, side="right") - np.arange(len(low))
    first = int(held.argmax())
    return float(low[first : first + held[first]].mean())


def _jumps(k: FloatArray, level: float, rest: BoolArray) -> list[bool]:
    """Return, for every border between strips at rest and others, whether readings jump there."""
    found = []
    # A convex contact that is level at both borders is so in between.
    both = rest[:2].all() and rest[-2:].all()
    for i in np.flatnonzero(rest[1:] != rest[:-1]):
        inner, step = (i + 1, 1) if rest[i] else (i, -1)  # the first strip in contact, and the way on
        jump = float(np.abs(k[:, inner] - level).max())
        after = inner + step
        if not 0 <= after < len(rest):  # one strip at the sensor's border: an edge may be as steep
            found.append(False)
            continue
        on = 0.0 if both or rest[after] else float(np.abs(k[:, after] - k[:, inner]).max())
        found.append(jump > max(_JUMP, _STEEPER * on))
    return found
