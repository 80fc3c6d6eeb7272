"""The errors that readings have: those of section 5.1, and of real rubber, contacts and converters."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, Literal, Self, TypeAlias

from tacstrip.arguments import refuse_positional
from tacstrip.errors import OptionError, SpecError, one_of

Several: TypeAlias = float | tuple[float, ...]

_DISTRIBUTIONS = ("uniform", "normal")
_OF_VREF = ("quantisation", "positional", "white", "offset", "gain", "hum", "strays", "stray_size")
_OTHER = ("transition_mm", "edge_mm", "edge_correlation_mm", "blur_mm", "hum_hz")
_SHARES = ("white_shared", "wander_shared", "wander_by_signature")
# The keys of a spec's [noise] table, with the comment that is written beside them.
COMMENTS = {
    "quantisation": "half-width of the combined quantisation error, over Vref",
    "positional": "half-width of the positional uncertainty, over Vref",
    "transition_mm": "half-width of the transition error",
    "distribution": "of these three: uniform or normal",
    "white": "standard deviation of a reading's own error in every scan, over Vref",
    "white_shared": "share of its variance that all channels of a scan have in common",
    "wander": "standard deviation of the zero's slow wander, over Vref; several: of as many processes",
    "wander_s": "time constants of the wander",
    "wander_shared": "share of its variance that all channels have in common",
    "wander_by_signature": "share of its variance that all strips of one signature have in common, beyond that",
    "offset": "standard deviation of one constant offset of all channels, over Vref",
    "gain": "standard deviation of each strip's gain about 1",
    "edge_mm": "standard deviation of where the contact ends on a strip, constant while it rests",
    "edge_correlation_mm": "distance across the strips over which these errors' correlation falls to 1/e",
    "blur_mm": "standard deviation by which all ends of a contact lie too far out, or in, together",
    "hum": "root mean square of the mains hum, over Vref",
    "hum_hz": "frequency of the mains",
    "strays": "share of readings that stray",
    "stray_size": "standard deviation of a stray, over Vref",
}


@dataclass(frozen=True, kw_only=True)
class Noise:
    """Errors of the readings, each part by its name: `Noise(positional=0.005)`. What is not given is 0.

    The first three are the thesis' half-widths; the others are measured by `tacstrip noise`, stand in the spec's
    `[noise]` table and are standard deviations. Readings are clipped at 0 and Vref after all of them.

    Attributes
    ----------
    quantisation
        Combined quantisation error C.Q.E. on every reading, as a fraction of Vref (5.1.1).
    positional
        Positional uncertainty P.U. on every reading, as a fraction of Vref (5.1.3).
    transition_mm
        Transition error T.E. on the x of every transition handed to a reconstruction [mm] (5.1.2).
    distribution
        Of these: "uniform" as in the thesis, or "normal" with sigma = half-width / sqrt(3), the same variance.
    white, white_shared
        Normal error of every reading in every scan, as a fraction of Vref, and the share of its variance, 0 to 1,
        that all channels of a scan have in common.
    wander, wander_s, wander_shared, wander_by_signature
        Each channel's zero wanders: Ornstein-Uhlenbeck processes of these standard deviations, as a fraction of
        Vref, and time constants [s]; one of either or as many. Averaging does not remove what is slower than it. The
        share of the variance that all channels have in common, and that which k_h, k_l and k each have for themselves
        on all strips: both leave nothing that neighbours tell.
    offset
        One constant offset of all channels, as a fraction of Vref.
    gain
        Every strip's readings are multiplied by 1 + an error of its own.
    edge_mm, edge_correlation_mm
        A soft contact ends where its pressure passes a threshold: errors of l and of u [mm] that stay as long as the
        contact rests, and the distance across the strips over which their correlation falls to 1/e [mm].
    blur_mm
        How far all ends lie too far outside, or inside, together [mm]: the threshold's own error.
    hum, hum_hz
        Root mean square of the mains hum, as a fraction of Vref, alike in all channels, and its frequency [Hz].
    strays, stray_size
        Share of the readings that stray, and by how much, as a fraction of Vref.

    Raises
    ------
    OptionError
        A number is below 0, or above 1 where it is a fraction; there is no such distribution; not as many time
        constants as processes.
    ArgumentError
        A value has no name.

    Examples
    --------
    >>> Noise(positional=0.005).positional
    0.005
    >>> Noise(white=0.0066, wander=(0.001, 0.002), wander_s=(5.0, 600.0)).processes
    ((0.001, 5.0), (0.002, 600.0))
    """

    quantisation: float = 0.0
    positional: float = 0.0
    transition_mm: float = 0.0
    distribution: Literal["uniform", "normal"] = "uniform"
    white: float = 0.0
    white_shared: float = 0.0
    wander: Several = 0.0
    wander_s: Several = 60.0
    wander_shared: float = 0.0
    wander_by_signature: float = 0.0
    offset: float = 0.0
    gain: float = 0.0
    edge_mm: float = 0.0
    edge_correlation_mm: float = 0.0
    blur_mm: float = 0.0
    hum: float = 0.0
    hum_hz: float = 50.0
    strays: float = 0.0
    stray_size: float = 0.0

    def __new__(cls, *values: object, **named: object) -> Self:
        """Refuse numbers without a name: `ArgumentError`."""
        refuse_positional("ts.Noise", values, "ts.Noise(positional=0.005), or quantisation=, transition_mm=")
        return super().__new__(cls)

    def __post_init__(self) -> None:
        if self.distribution not in _DISTRIBUTIONS:
            raise OptionError(one_of("distribution", self.distribution, _DISTRIBUTIONS))
        for name in ("wander", "wander_s"):
            if isinstance(value := getattr(self, name), list):
                object.__setattr__(self, name, tuple(value))
        for name in (*_OF_VREF, *_OTHER, *_SHARES, "wander", "wander_s"):
            value = getattr(self, name)
            for one in value if isinstance(value, tuple) and name in ("wander", "wander_s") else (value,):
                if isinstance(one, bool) or not isinstance(one, int | float) or not 0.0 <= one < math.inf:
                    raise OptionError(f"{name} = {one!r}: must be 0 or more")
                if one > 1.0 and name in (*_OF_VREF, "wander"):
                    raise OptionError(f"{name} = {one}: a fraction of Vref, 0.01 for 1 %")
                if one > 1.0 and name in _SHARES:
                    raise OptionError(f"{name} = {one}: a share of the variance, 0 to 1")
        if self.wander_shared + self.wander_by_signature > 1.0:
            raise OptionError(
                "wander_shared and wander_by_signature: together at most 1, all of the variance"
            )
        if any(time_s == 0.0 for _, time_s in self.processes):
            raise OptionError(
                "wander_s = 0: a time constant must be above 0; an error without one is `white`"
            )

    @cached_property
    def processes(self) -> tuple[tuple[float, float], ...]:
        """Standard deviation [Vref] and time constant [s] of every process of the wander."""
        sigmas, times_s = (v if isinstance(v, tuple) else (v,) for v in (self.wander, self.wander_s))
        if len(sigmas) != len(times_s):
            if len(times_s) > 1:
                raise OptionError(
                    f"wander has {len(sigmas)} processes and wander_s {len(times_s)} time constants"
                )
            times_s *= len(sigmas)
        return tuple((s, t) for s, t in zip(sigmas, times_s, strict=True) if s)

    @cached_property
    def independent(self) -> bool:
        """Whether every reading's error is its own, of one size, as in section 5.1: no other part is there."""
        lasting = self.processes or self.offset or self.gain or self.soft or self.hum
        return not (self.white or lasting or self.strays)

    @property
    def soft(self) -> bool:
        """Whether it is not sure where the contact ends."""
        return self.edge_mm > 0.0 or self.blur_mm > 0.0

    @classmethod
    def from_dict(cls, raw: Any) -> Self:
        """Make it from the `[noise]` table of a spec file: `SpecError` where that cannot be."""
        if not isinstance(raw, Mapping):
            raise SpecError("noise: must be a table")
        if unknown := [key for key in raw if key not in COMMENTS]:
            raise SpecError(f"unknown key {unknown[0]!r} in [noise]; the keys are: {', '.join(COMMENTS)}")
        try:
            return cls(**raw)
        except OptionError as error:
            raise SpecError(f"noise.{error}") from None

    def to_toml(self) -> str:
        """Return the `[noise]` table of a spec file: what is not as by default, with a comment each."""
        lines = ["[noise]"]
        for field in fields(self):
            value = getattr(self, field.name)
            if value == field.default:
                continue
            text = json.dumps(value)
            lines.append(f"{f'{field.name} = {text}':<32} # {COMMENTS[field.name]}")
        return "\n".join(lines) + "\n"
