"""How one unit's raw readings become corrected ones: constants of its channels and its rubber, with provenance."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from tacstrip.arrays import FloatArray
from tacstrip.errors import SignatureError, SpecError, one_of
from tacstrip.sensor.channel import Channel, Numbers, Table, check_rising, numbers, piecewise_map, table
from tacstrip.sensor.closed_form import k_h, k_l, lower_and_width
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.input_load import MOST_LOAD, lost_to_load, without_load
from tacstrip.sensor.ratio_profile import under_contact

_TEXTS = ("made", "source", "model", "sensor", "unit", "zeroed", "touch")
_PERCENTS = ("before_percent", "after_percent")
# Over L: the contacts that a single signature, which does not tell their length, is corrected for on uneven rubber.
TYPICAL_LENGTHS = (0.0, 0.1, 0.2, 0.3)
_KNOTS = 33  # of that correction, from 0 to Vref
_ITERATIONS = 4  # of a contact's ends and the ratio under it
_MOST_PROFILE = 1.0  # of the log of a ratio
_MOST_END = 0.25  # of a strip's resistance: what clamps and leads may have, or a strip's end lie off


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """Constants of one unit; the `[calibration]` table of its spec file.

    Attributes
    ----------
    channels
        One per signature; a signature without one is passed on as it is.
    ratio
        Each strip's own ratio of resistivities over the spec's `resistivity_ratio` (strips,).
    profile
        How the log of that varies along each strip: coefficients of cosines (strips, cosines), see `ratio_profile`.
    warp_at, warp
        Places along y over L, from 0 to 1 (knots,), and the share of each strip's resistance that lies below them
        (strips, knots): rubber that is not uniform. From about 0, the clamp's share, to about 1.
    load
        The energised strips' mean resistance over that of a channel's input to ground, of k_h and k_l.
    made, source, model, sensor, unit
        When it was fitted, from which file, what was fitted, the sensor's fingerprint, the unit's name.
    before_percent, after_percent
        Root mean square of what readings are off by, before and after [% of Vref].
    zeroed, touch
        When and from what the drift and the untouched level were learned.

    Raises
    ------
    SpecError
        A value that cannot be; the message names the key.

    Examples
    --------
    >>> import tacstrip as ts
    >>> from tacstrip.sensor.channel import Channel
    >>> of_two_strips = Channel(signature="k", offset=(0.02, -0.01))
    >>> unit = ts.Calibration(channels=(of_two_strips,))
    >>> sensor = ts.Sensor(construction="crs-m", strips=2, pitch_mm=6.5, length_mm=325.0, calibration=unit)
    >>> sensor.calibration.channel("k").offset
    (0.02, -0.01)
    """

    channels: tuple[Channel, ...] = ()
    ratio: Numbers = ()
    profile: Table = ()
    warp_at: Numbers = ()
    warp: Table = ()
    load: float = 0.0
    made: str = ""
    source: str = ""
    model: str = ""
    sensor: str = ""
    unit: str = ""
    before_percent: float | None = None
    after_percent: float | None = None
    zeroed: str = ""
    touch: str = ""

    def __post_init__(self) -> None:
        for name in _TEXTS:
            value = getattr(self, name)
            if not isinstance(value, str) or not value.isprintable():
                raise SpecError(f"{name}: must be a text of one line")
        for name in _PERCENTS:
            if getattr(self, name) is not None:
                object.__setattr__(self, name, numbers(name, [getattr(self, name)])[0])
        for name in ("ratio", "warp_at"):
            object.__setattr__(self, name, numbers(name, getattr(self, name)))
        for name in ("profile", "warp"):
            object.__setattr__(self, name, table(name, getattr(self, name)))
        object.__setattr__(self, "channels", tuple(self.channels))
        object.__setattr__(self, "load", numbers("load", [self.load])[0])
        if not 0.0 <= self.load <= MOST_LOAD:
            raise SpecError(f"load: must be 0 to {MOST_LOAD:g}, a strip's resistance over that of the input")
        if any(r <= 0.0 for r in self.ratio):
            raise SpecError("ratio: every ratio must be above 0")
        cosines = {len(row) for row in self.profile}
        if len(cosines) > 1 or any(abs(v) > _MOST_PROFILE for row in self.profile for v in row):
            raise SpecError(f"profile: as many numbers for each strip, each within +-{_MOST_PROFILE:g}")
        check_rising("warp", self.warp_at, self.warp)
        if any(abs(row[0]) > _MOST_END or abs(row[-1] - 1.0) > _MOST_END for row in self.warp):
            raise SpecError(f"warp: every entry must rise from 0 to 1, each to +-{_MOST_END:g}")
        names = [c.signature for c in self.channels]
        if len(set(names)) < len(names):
            raise SpecError(f"signature {names[0]!r} has two channels")

    def channel(self, signature: str) -> Channel:
        """Return a signature's constants; `SignatureError` where there is no such signature."""
        for channel in self.channels:
            if channel.signature == signature:
                return channel
        if signature not in SIGNATURES:
            raise SignatureError(one_of("signature", signature, SIGNATURES))
        return Channel(signature=signature)

    def with_channels(self, new: Iterable[Channel], **keys: Any) -> Self:
        """Return it with these channels in place of those of their signatures, and with other texts."""
        new = tuple(new)
        names = {channel.signature for channel in new}
        kept = (channel for channel in self.channels if channel.signature not in names)
        return replace(self, channels=(*kept, *new), **keys)

    def correct(self, signature: str, k: npt.ArrayLike) -> FloatArray:
        """Return the corrected readings of raw ones, one signature on its own.

        Parameters
        ----------
        signature
            kh, kl or k.
        k
            Raw readings over Vref, (strips,) or (scans, strips).

        Returns
        -------
        FloatArray
            Of the same shape, clipped to 0..1; NaN stays NaN. A strip's own scale along y is taken as for contacts
            of `TYPICAL_LENGTHS`, a mean over them (k), or as for one without length (k_h or k_l alone), and its own
            ratio and the inputs' load are left out: `correct_pair` has all exactly.
        """
        k = self.channel(signature).correct(np.asarray(k, dtype=float))
        if self.warp:
            even, uneven = self._alone(signature)
            k = piecewise_map(k, uneven, even)
        return np.clip(k, 0.0, 1.0)

    def distort(self, signature: str, k: npt.ArrayLike) -> FloatArray:
        """Return the raw readings that `correct` turns into k, clipped to 0..1; arguments as there."""
        k = np.asarray(k, dtype=float)
        if self.warp:
            k = piecewise_map(k, *self._alone(signature))
        return np.clip(self.channel(signature).distort(k), 0.0, 1.0)

    def _alone(self, signature: str) -> tuple[FloatArray, FloatArray]:
        """Return what a strip of even rubber reads (knots,), and each strip of its own (strips, knots)."""
        at, warp = np.array(self.warp_at), np.array(self.warp)
        return _means(self.warp_at, self.warp) if signature == "k" else (at, warp)

    def correct_pair(
        self, kh: npt.ArrayLike, kl: npt.ArrayLike, ratio: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return corrected k_h and k_l of raw ones read together, as `correct`; `ratio` is the spec's."""
        given = (("kh", kh), ("kl", kl))
        high, low = (self.channel(name).correct(np.asarray(k, dtype=float)) for name, k in given)
        own: Any = ratio * np.array(self.ratio or 1.0)
        high, low = without_load(high, low, own, self.load)
        under = own
        for _ in range(_ITERATIONS if self.profile else 0):
            under = own * under_contact(np.array(self.profile), *lower_and_width(high, low, 1.0, under))
        high, low, _ = self._swap(high, low, under, ratio, self.warp, self.warp_at)
        return np.clip(high, 0.0, 1.0), np.clip(low, 0.0, 1.0)

    def distort_pair(
        self, kh: npt.ArrayLike, kl: npt.ArrayLike, ratio: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return the raw k_h and k_l that `correct_pair` turns into these."""
        high, low = np.asarray(kh, dtype=float), np.asarray(kl, dtype=float)
        own: Any = ratio * np.array(self.ratio or 1.0)
        high, low, own = self._swap(high, low, ratio, own, self.warp_at, self.warp, self.profile)
        if self.load:
            less = lost_to_load(*lower_and_width(high, low, 1.0, own), own, self.load)
            high, low = high - less[0], low - less[1]
        channels = ((self.channel("kh"), high), (self.channel("kl"), low))
        high, low = (np.clip(c.distort(k), 0.0, 1.0) for c, k in channels)
        return high, low

    def _swap(
        self, kh: FloatArray, kl: FloatArray, old: Any, new: Any, start: Any, end: Any, profile: Table = ()
    ) -> tuple[FloatArray, FloatArray, Any]:
        """Exchange the rubber under the contact, a strip's own and the spec's; not clipped.

        Readings go to the contact's electrical ends, over L, and back to readings. `old` and `new`: a ratio, one per
        strip or per reading; the new one follows a profile, and is returned too. Contact resistance only moves the
        electrical ends.
        """
        if not (self.ratio or self.warp or self.profile):
            return kh, kl, new
        l, w = lower_and_width(kh, kl, 1.0, old)
        u = l + w
        if self.warp:
            l, u = (piecewise_map(v, np.array(start), np.array(end)) for v in (l, u))
        if profile:
            new = new * under_contact(np.array(profile), l, u - l)
        return k_h(l, u - l, 1.0, new), k_l(l, u - l, 1.0, new), new

    def check(self, strips: int, signatures: tuple[str, ...], fingerprint: str) -> None:
        """Refuse a sensor that this calibration is not of: `SpecError` names what differs."""
        if self.sensor and self.sensor != fingerprint:
            raise SpecError(
                f"the calibration is of another sensor ({self.sensor}), and this one is {fingerprint}: calibrate it "
                "anew; where only the spec was put right, put `sensor` in [calibration] right too"
            )
        lists: dict[str, Any] = {"ratio": self.ratio, "profile": self.profile, "warp": self.warp}
        for channel in self.channels:
            if channel.signature not in signatures:
                raise SpecError(
                    f"calibration.{channel.signature}: this sensor has only {', '.join(signatures)}"
                )
            lists |= {f"{channel.signature}.{name}": values for name, values in channel.lists.items()}
        if self.load and "kh" not in signatures:
            raise SpecError(
                "calibration.load: only k_h and k_l together tell what an input's load takes from them"
            )
        if (self.ratio or self.profile) and "kh" not in signatures:
            raise SpecError("calibration.ratio: only a second layer of rubber has a ratio")
        for name, values in lists.items():
            if values and len(values) != strips:
                raise SpecError(f"calibration.{name}: {len(values)} entries for {strips} strips")

    @classmethod
    def from_dict(cls, raw: Any) -> Self:
        """Make a calibration from the `[calibration]` table of a spec file; errors as for the class."""
        if not isinstance(raw, Mapping):
            raise SpecError("calibration: must be a table")
        known = [f.name for f in fields(cls)][1:]
        if unknown := [key for key in raw if key not in known and key not in SIGNATURES]:
            names = ", ".join([*known, *SIGNATURES])
            raise SpecError(f"unknown key {f'calibration.{unknown[0]}'!r}; its keys are: {names}")
        try:
            channels = tuple(Channel.from_dict(name, raw[name]) for name in SIGNATURES if name in raw)
            return cls(channels=channels, **{key: raw[key] for key in known if key in raw})
        except SpecError as error:
            raise SpecError(
                str(error) if str(error).startswith("unknown") else f"calibration.{error}"
            ) from None

    def to_toml(self) -> str:
        """Return the `[calibration]` table's text; `from_dict` of it is this calibration, to the last bit."""
        parts = ["[calibration] # made by `tacstrip calibrate`; readings are over Vref, a number per strip"]
        parts += _lines(self, [f.name for f in fields(self)[1:] if f.name != "load" or self.load])
        for channel in self.channels:
            parts += ["", f"[calibration.{channel.signature}]"]
            parts += _lines(channel, [f.name for f in fields(channel)][1:])
        return "\n".join(parts) + "\n"


@lru_cache(maxsize=16)
def _means(warp_at: Numbers, warp: Table) -> tuple[FloatArray, FloatArray]:
    """Return readings of even rubber (knots,) and of the warped (strips, knots), mean over `TYPICAL_LENGTHS`."""
    even, at, place = np.linspace(0.0, 1.0, _KNOTS), np.array(warp_at), np.array(warp)
    total = np.zeros((len(place), _KNOTS))
    for w in TYPICAL_LENGTHS:
        l = even * (1.0 - w)  # the contact of this length that reads so
        ends = (np.broadcast_to(v[:, None], (_KNOTS, len(place))) for v in (l, l + w))
        low, high = (piecewise_map(end, at, place).T for end in ends)
        total += low / (1.0 - (high - low))
    return even, total / len(TYPICAL_LENGTHS)


def _lines(holder: Calibration | Channel, names: list[str]) -> list[str]:
    empty = ("", (), None)
    given = {n: getattr(holder, n) for n in names if getattr(holder, n) not in empty}
    return [f"{n} = {json.dumps(v, ensure_ascii=False)}" for n, v in given.items()]
