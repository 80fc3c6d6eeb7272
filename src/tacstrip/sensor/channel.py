"""The constants of one signature's channel: what lies between a strip's reading and its raw reading, and back."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, Self

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.errors import SpecError, one_of
from tacstrip.sensor.constructions import SIGNATURES

Numbers = tuple[float, ...]
Table = tuple[Numbers, ...]


@dataclass(frozen=True, kw_only=True)
class Channel:
    """One signature's constants, a number per strip, over Vref; an empty tuple is "none".

    Raw = drift + gain k + offset fade(k), or drift + curve(k).

    Attributes
    ----------
    signature
        kh, kl or k.
    offset, gain
        Added to the reading, as in (6.3)-(6.5), and its factor.
    fade
        The offset fades to 0 over this share of Vref at both ends of the scale, 0 to 0.5; 0: it does not.
    curve_at, curve
        Readings from 0 to 1 (knots,), and the raw reading at each (strips, knots), rising; straight between knots
        and beyond the last; in place of offset and gain.
    drift
        Added since the calibration was made: what re-zeroing found.
    rest, noise
        Raw level of the untouched strip, and the standard deviation of a raw reading.

    Raises
    ------
    SpecError
        A value that cannot be; the message names the key.
    """

    signature: str
    offset: Numbers = ()
    gain: Numbers = ()
    fade: float = 0.0
    curve_at: Numbers = ()
    curve: Table = ()
    drift: Numbers = ()
    rest: Numbers = ()
    noise: Numbers = ()

    def __post_init__(self) -> None:
        if self.signature not in SIGNATURES:
            raise SpecError(one_of("signature", self.signature, SIGNATURES))
        for name in ("offset", "gain", "curve_at", "drift", "rest", "noise"):
            object.__setattr__(self, name, numbers(f"{self.signature}.{name}", getattr(self, name)))
        object.__setattr__(self, "fade", numbers(f"{self.signature}.fade", [self.fade])[0])
        object.__setattr__(self, "curve", table(f"{self.signature}.curve", self.curve))
        self._check()

    def _check(self) -> None:
        gain = np.array(self.gain or 1.0)
        offset = np.array(self.offset or 0.0)
        good_shape = not (self.gain and self.offset) or len(self.gain) == len(self.offset)
        fades = not good_shape or self.fade == 0.0 or bool((np.abs(offset) < gain * self.fade).all())
        falling = (
            "an offset that fades must be smaller than fade times gain, or readings would fall where k rises"
        )
        one_kind = not self.curve or not (self.offset or self.gain or self.fade)
        limits = (
            ("gain", bool((gain > 0.0).all()), "every gain must be above 0"),
            ("fade", 0.0 <= self.fade <= 0.5, "must be 0 to 0.5, a share of Vref"),
            ("offset", good_shape, "must have as many entries as gain"),
            ("offset", fades, falling),
            ("noise", all(s >= 0.0 for s in self.noise), "must be 0 or more"),
            ("curve", one_kind, "a curve stands in place of offset, gain and fade; leave one kind out"),
        )
        for key, good, advice in limits:
            if not good:
                raise SpecError(f"{self.signature}.{key}: {advice}")
        check_rising(f"{self.signature}.curve", self.curve_at, self.curve)

    @property
    def lists(self) -> dict[str, Numbers | Table]:
        """The constants that have an entry per strip, by name."""
        names = ("offset", "gain", "curve", "drift", "rest", "noise")
        return {name: getattr(self, name) for name in names}

    @cached_property
    def arrays(self) -> dict[str, FloatArray]:
        """The constants as arrays; those not given as the neutral number, 0 or 1."""
        return {
            "offset": np.array(self.offset or 0.0),
            "gain": np.array(self.gain or 1.0),
            "drift": np.array(self.drift or 0.0),
            "curve_at": np.array(self.curve_at),
            "curve": np.array(self.curve),
        }

    def correct(self, raw: FloatArray) -> FloatArray:
        """Return the corrected readings of raw ones, (strips,) or (scans, strips); not clipped, NaN stays NaN."""
        c = self.arrays
        v = raw - c["drift"]
        if self.curve:
            return piecewise_map(v, c["curve"], c["curve_at"])
        gain, offset, fade = c["gain"], c["offset"], self.fade
        if not fade:
            return np.asarray((v - offset) / gain)
        slope = offset / fade
        low, high = v / (gain + slope), (v - slope) / (gain - slope)
        middle = (v - offset) / gain
        return np.where(low < fade, low, np.where(high > 1.0 - fade, high, middle))

    def distort(self, k: FloatArray) -> FloatArray:
        """Return the raw readings that `correct` turns into k."""
        c = self.arrays
        if self.curve:
            return np.asarray(piecewise_map(k, c["curve_at"], c["curve"]) + c["drift"])
        return np.asarray(c["gain"] * k + c["offset"] * fading(k, self.fade) + c["drift"])

    @classmethod
    def from_dict(cls, signature: str, raw: Any) -> Self:
        """Make a channel from its table in a spec file; errors as for the class."""
        if not isinstance(raw, dict):
            raise SpecError(f"{signature}: must be a table")
        known = [f.name for f in fields(cls)][1:]
        if unknown := [key for key in raw if key not in known]:
            raise SpecError(f"unknown key {f'{signature}.{unknown[0]}'!r}; its keys are: {', '.join(known)}")
        return cls(signature=signature, **raw)


def fading(k: FloatArray, fade: float) -> FloatArray:
    """Return the share of an offset that acts at a reading k: 1, falling to 0 towards both ends of the scale."""
    if not fade:
        return np.ones_like(k)
    return np.asarray(np.minimum(np.minimum(k, 1.0 - k) / fade, 1.0))


def piecewise_map(values: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """Interpolate values (.., strips) linearly through the knots (start, end); the outer pieces go on beyond them.

    Each of start and end is (knots,) or (strips, knots), rising.
    """
    if start.ndim == 1:
        piece = np.searchsorted(start[1:-1], values, side="right")
    else:
        piece = (values[..., None] >= start[:, 1:-1]).sum(axis=-1)  # (.., strips)
    strip = np.arange(values.shape[-1])

    def at(knots: FloatArray, which: IntArray) -> FloatArray:
        return np.asarray(knots[which] if knots.ndim == 1 else knots[strip, which])

    x0, y0 = at(start, piece), at(end, piece)
    return np.asarray(y0 + (values - x0) * ((at(end, piece + 1) - y0) / (at(start, piece + 1) - x0)))


def check_rising(key: str, at: Numbers, rows: Table) -> None:
    """Refuse knots that are not from 0 to 1 and rising, or rows that do not fit them or do not rise."""
    if bool(at) != bool(rows):
        raise SpecError(f"{key}_at and {key} belong together; give both or neither")
    if not rows:
        return
    if len(at) < 2 or (at[0], at[-1]) != (0.0, 1.0) or not bool((np.diff(at) > 0.0).all()):
        raise SpecError(f"{key}_at: must rise from 0 to 1")
    for strip, row in enumerate(rows):
        if len(row) != len(at):
            raise SpecError(f"{key}: entry {strip} has {len(row)} numbers for the {len(at)} of {key}_at")
        if not bool((np.diff(row) > 0.0).all()):
            raise SpecError(f"{key}: entry {strip} must rise from number to number")


def numbers(key: str, values: Any) -> Numbers:
    """Return values as plain numbers, or raise `SpecError` that names the key."""
    try:
        if any(isinstance(v, bool | str) for v in values):
            raise TypeError
        found = tuple(float(v) for v in values)
    except (TypeError, ValueError, OverflowError):
        raise SpecError(f"{key}: must be a list of numbers") from None
    if not all(math.isfinite(v) for v in found):
        raise SpecError(f"{key}: every number must be finite")
    return found


def table(key: str, rows: Any) -> Table:
    """Return rows of numbers, or raise `SpecError` that names the key."""
    try:
        return tuple(numbers(key, row) for row in rows)
    except TypeError:
        raise SpecError(f"{key}: must be a list of lists of numbers") from None
