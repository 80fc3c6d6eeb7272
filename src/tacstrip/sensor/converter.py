"""A converter with codes that are wider than others, as the RP2040's (its erratum E11): a spec's `[adc]` table."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from tacstrip.arguments import refuse_positional
from tacstrip.arrays import FloatArray
from tacstrip.errors import ReadingError, SpecError

_NEAR = 32  # codes on either side that a code's count is compared with
_ENOUGH = 25  # readings a code on average, for a count that is known to a fifth
_WIDE = 3.0  # widths of its neighbours: then a code is a wide one
_WIDEST = 64.0  # LSB; no converter that is worth its name has a wider one


@dataclass(frozen=True, kw_only=True)
class Converter:
    """The wide codes of one unit's A/D converter; all others share evenly what is left of the range.

    Attributes
    ----------
    wide_codes
        The codes, ascending.
    widths_lsb
        How wide each is, in steps of a converter with equal ones.

    Raises
    ------
    SpecError
        Not as many widths as codes; codes that do not ascend, or widths that cannot be.

    Examples
    --------
    >>> pico = Converter(wide_codes=(512, 1536, 2560, 3584), widths_lsb=(9.5, 9.0, 10.0, 8.5))
    >>> corrected = pico.correct([511 / 4095, 512 / 4095, 513 / 4095], 12) * 4095
    >>> [round(float(code), 1) for code in corrected]  # in steps of equal codes
    [506.9, 512.1, 517.4]
    """

    wide_codes: tuple[int, ...] = ()
    widths_lsb: tuple[float, ...] = ()

    def __new__(cls, *values: object, **named: object) -> Self:
        """Refuse values without a name: `ArgumentError`."""
        refuse_positional("Converter", values, "Converter(wide_codes=(512, 1536), widths_lsb=(9.5, 9.0))")
        return super().__new__(cls)

    def __post_init__(self) -> None:
        codes, widths = self.wide_codes, self.widths_lsb
        for name, values, kind in (("wide_codes", codes, int), ("widths_lsb", widths, (int, float))):
            if not isinstance(values, list | tuple) or any(
                isinstance(v, bool) or not isinstance(v, kind) for v in values
            ):
                raise SpecError(f"[adc] {name} = {values!r}: must be a list of numbers, such as [512, 1536]")
            object.__setattr__(self, name, tuple(values))
        if len(codes) != len(widths):
            raise SpecError(f"[adc] has {len(codes)} wide_codes and {len(widths)} widths_lsb: one for each")
        if any(b <= a for a, b in zip((-1, *codes), codes, strict=False)):
            raise SpecError(f"[adc] wide_codes = {list(codes)}: must ascend from 0 on")
        if any(not 0.0 < w <= _WIDEST for w in widths):
            raise SpecError(f"[adc] widths_lsb = {list(widths)}: must be above 0, to {_WIDEST:g}")

    @classmethod
    def measured(cls, codes: npt.ArrayLike, bits: int = 12) -> Self:
        """Return the converter that has read these codes from a voltage that swept slowly over the range.

        Parameters
        ----------
        codes
            Any shape; a code's width is its count over the median count of the 32 on either side, so the sweep need
            not be even.
        bits
            Of the converter.

        Raises
        ------
        ReadingError
            Too few codes, or a sweep that left out parts of the range.
        """
        count = np.bincount(np.asarray(codes).ravel(), minlength=2**bits).astype(float)
        near = np.lib.stride_tricks.sliding_window_view(np.pad(count, _NEAR, mode="reflect"), 2 * _NEAR + 1)
        usual = np.median(near, axis=1)  # (codes,)
        inside = slice(_NEAR, 2**bits - _NEAR)  # what lies beyond the ends of the range is read as these
        if len(count) > 2**bits:
            raise ReadingError(f"the code {len(count) - 1} is above 2^{bits} - 1: give the converter's bits")
        few = int(np.argmin(usual[inside]))
        if usual[inside][few] < _ENOUGH:
            raise ReadingError(
                f"codes near {few + _NEAR} were read {usual[inside][few]:.0f} times each, and {_ENOUGH} times are "
                "needed: sweep the whole range more slowly"
            )
        width = count / np.maximum(usual, 1.0)
        wide = _NEAR + np.flatnonzero(width[inside] > _WIDE)
        share = len(count) / float((len(count) - len(wide)) + width[wide].sum())  # of a usual code, in steps
        return cls(
            wide_codes=tuple(int(c) for c in wide), widths_lsb=tuple(float(w) for w in width[wide] * share)
        )

    def check(self, bits: int | None) -> None:
        """Refuse codes that a converter of so many bits has not: `SpecError`."""
        if bits is None or (self.wide_codes and self.wide_codes[-1] >= 2**bits):
            raise SpecError(f"[adc] wide_codes = {list(self.wide_codes)}: must be codes of adc_bits = {bits}")
        if self._usual_width(bits) <= 0.0:
            raise SpecError(
                f"[adc] widths_lsb = {list(self.widths_lsb)}: nothing is left for the other codes"
            )

    def correct(self, k: npt.ArrayLike, bits: int) -> FloatArray:
        """Return what a converter with equal codes would read, for readings over Vref of any shape."""
        codes, steps = self._edges(bits)
        return _mapped(k, codes, steps, bits)

    def distort(self, k: npt.ArrayLike, bits: int) -> FloatArray:
        """Return what this converter reads, for readings of one with equal codes; the inverse of `correct`."""
        codes, steps = self._edges(bits)
        return _mapped(k, steps, codes, bits)

    def sigma(self, k: npt.ArrayLike, bits: int) -> FloatArray:
        """Return the standard deviation of the rounding of raw readings over Vref [Vref]: a code's width / sqrt(12)."""
        codes = np.rint(np.asarray(k, dtype=float) * (2**bits - 1))
        width = np.full(codes.shape, self._usual_width(bits))
        for code, wide in zip(self.wide_codes, self.widths_lsb, strict=True):
            width = np.where(codes == code, wide, width)
        return np.asarray(np.where(np.isnan(codes), np.nan, width) / (math.sqrt(12.0) * (2**bits - 1)))

    def mean_square(self, bits: int) -> float:
        """Return the mean square of the rounding over that of equal codes, for voltages all over the range."""
        usual = self._usual_width(bits)
        cubes = sum(w**3 for w in self.widths_lsb) + (2**bits - len(self.wide_codes)) * usual**3
        return float(cubes / 2**bits)

    @cached_property
    def widest_lsb(self) -> float:
        """The width of the widest code, in steps of equal ones; 1 where there is no wide one."""
        return max((1.0, *self.widths_lsb))

    def _usual_width(self, bits: int) -> float:
        return float((2**bits - sum(self.widths_lsb)) / (2**bits - len(self.wide_codes)))

    def _edges(self, bits: int) -> tuple[FloatArray, FloatArray]:
        """Return where wide codes begin and end: by their numbers, and in steps of equal codes (2 codes + 2,)."""
        usual = self._usual_width(bits)
        codes, steps = [0.0], [0.0]
        for code, wide in zip(self.wide_codes, self.widths_lsb, strict=True):
            for edge, width in ((float(code), usual), (code + 1.0, wide)):
                steps.append(steps[-1] + (edge - codes[-1]) * width)
                codes.append(edge)
        return np.array([*codes, 2.0**bits]), np.array([*steps, 2.0**bits])

    @classmethod
    def from_dict(cls, raw: Mapping[str, Any]) -> Self:
        """Make one from the `[adc]` table's keys and values; errors as of the class."""
        names = [field.name for field in fields(cls)]
        if not isinstance(raw, Mapping) or (unknown := [key for key in raw if key not in names]):
            what = "no table" if not isinstance(raw, Mapping) else f"an unknown key {unknown[0]!r}"
            raise SpecError(f"[adc] is or has {what}; its keys are: {', '.join(names)}")
        return cls(**raw)

    def to_toml(self) -> str:
        """Return the `[adc]` table."""
        widths = json.dumps([round(w, 4) for w in self.widths_lsb])
        return (
            "[adc] # codes of the A/D converter that are wider than the others\n"
            f"wide_codes = {json.dumps(self.wide_codes)}\n"
            f"widths_lsb = {widths} # in steps of a converter with equal codes\n"
        )


def _mapped(k: npt.ArrayLike, at: FloatArray, to: FloatArray, bits: int) -> FloatArray:
    """Map readings over Vref piecewise; a code c stands for the middle of what lies between c and c + 1."""
    top = 2**bits - 1
    place = np.asarray(k, dtype=float) * top + 0.5
    return np.asarray(np.clip((np.interp(place, at, to) - 0.5) / top, 0.0, 1.0))
