"""One scan: what a sensor measured in one sampling cycle."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import isfinite
from numbers import Real
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from tacstrip.arrays import BoolArray, FloatArray, extent, numbers, touched_strips
from tacstrip.errors import ArgumentError, ReadingError, SignatureError
from tacstrip.notebook import Drawn, SvgPath, signature_paths
from tacstrip.robust import robust_sigma
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.creep import creep_rate, log_age
from tacstrip.sensor.layers import LayeredSensor
from tacstrip.sensor.left_out import leave_out
from tacstrip.sensor.spec import Sensor

# Of a converter that the spec does not give; of the coarsest that rounding counts of.
_BITS, _FEWEST_BITS = 16, 8
_STRAY, _STRAY_COUNT = 6.0, 8  # standard deviations; scans of which a stray can be told
_MOVED = 0.025  # of Vref: the median channel's change from the first half to the second that is no wander
_LEAST_STRAY = 0.002  # over Vref: nearer than that is none, however quiet the converter


_SINGLE = {"electrodes": None, "averaged": 1, "span_s": 0.0, "moved": 0.0}  # of a scan that is no mean


class Signatures:
    """Readings by signature, of one scan (strips,) or of many (scans, strips); NaN where nothing touches."""

    @cached_property
    def signatures(self) -> tuple[str, ...]:
        """Names of the signatures that were measured."""
        return tuple(name for name in SIGNATURES if getattr(self, name) is not None)

    @property
    def touched(self) -> BoolArray:
        """Whether each strip is touched, of the shape of the readings."""
        first, *others = (np.isnan(getattr(self, name)) for name in self.signatures)
        for nothing in others:
            first &= nothing
        return np.asarray(~first)


@dataclass(frozen=True, eq=False)
class Scan(Signatures, Drawn):
    """Readings of all strips over Vref, one array (strips,) per signature; NaN where nothing touches.

    A strip with one reading of two is touched, and counts with that one: its other channel is left out.

    `electrodes` (strips, 2 strips), for CRS-CRP only: what every electrode of the sheet read while each strip was
    energised, those at y = 0 first, then those at y = L; a row of NaN where nothing touches. k_l and k_h are its
    two diagonals.

    A reading beyond 0 or 1 by less than half a step of 16 bits is rounding, and is set to 0 or 1.

    A scan that is the mean of others, as `Scan.mean` makes it, says of how many and over what time: `averaged` and
    `span_s` [s]. Errors that every scan draws anew are then less, those that last are not. `moved` [Vref] is above 0
    where the contact did not rest meanwhile: half of the channels changed by so much or more, and results are doubted.

    Raises
    ------
    ReadingError
        No signature, arrays of different lengths, a value outside 0..1, or a time that is no finite number; the
        message names the strip, counted from 0.

    Examples
    --------
    >>> Scan(kh=[float("nan"), 0.4, 0.4], kl=[float("nan"), 0.2, 0.3]).touched.tolist()
    [False, True, True]
    """

    kh: FloatArray | None = None
    kl: FloatArray | None = None
    k: FloatArray | None = None
    time_s: float = 0.0
    electrodes: FloatArray | None = None
    averaged: Any = 1  # a whole number, and a number: typed so that Scan(**signatures) is accepted
    span_s: Any = 0.0
    moved: Any = 0.0

    def __post_init__(self) -> None:
        for name in SIGNATURES:
            if (values := getattr(self, name)) is not None:
                object.__setattr__(self, name, _readings(name, values))
        counts = isinstance(self.averaged, int | np.integer) and self.averaged >= 1
        if not (counts and isinstance(self.span_s, float | int) and 0.0 <= self.span_s < np.inf):
            raise ReadingError(
                f"averaged = {self.averaged}, span_s = {self.span_s}: a scan is made of 1 or more, over 0 s or more"
            )
        if not isinstance(self.time_s, Real) or not isfinite(self.time_s):
            raise ReadingError(f"time_s = {self.time_s!r}: must be a time in seconds, a finite number")
        names = self.signatures
        if not names:
            raise ReadingError("a scan needs at least one signature: kh, kl or k")
        first = self[names[0]]
        for name in names[1:]:
            if len(self[name]) != len(first):
                raise ReadingError(f"{names[0]} has {len(first)} strips and {name} has {len(self[name])}")
        if self.electrodes is not None:
            object.__setattr__(self, "electrodes", _electrodes(self.electrodes, self.touched))

    def __repr__(self) -> str:
        names = [n for n in (*SIGNATURES, "electrodes") if getattr(self, n) is not None]
        ranges = [f", {name} {extent(getattr(self, name))}" for name in names]
        strips = f"{len(self.touched)} strips at {self.time_s:.6g} s: {touched_strips(self.touched)}"
        return f"<Scan of {strips}{''.join(ranges)}>"

    def _paths(self) -> list[SvgPath]:
        return signature_paths([{name: self[name] for name in self.signatures}])

    @classmethod
    def mean(cls, scans: Sequence[Scan]) -> Scan:
        """Return the mean of scans of a contact that rests, with their number and the time from first to last.

        A strip counts as touched where most of the scans read it. Of eight scans and more, a reading further than
        6 standard deviations from its median is left out. Over five seconds and more, creep (`sensor.creep`) is taken
        out: the mean is as after the first second, and does not grow with the press.

        Raises
        ------
        ReadingError
            There is none, or they have different signatures or numbers of strips.
        ArgumentError
            They are no scans.

        Examples
        --------
        >>> mean = Scan.mean([Scan(k=[0.4, 0.1], time_s=0.0), Scan(k=[0.5, 0.2], time_s=0.1)])
        >>> mean.k.round(6).tolist(), mean.averaged, mean.span_s
        ([0.45, 0.15], 2, 0.1)
        """
        if not isinstance(scans, Sequence) or not all(isinstance(scan, Scan) for scan in scans):
            raise ArgumentError("Scan.mean takes scans, as in Scan.mean([scan, scan])")
        if not scans:
            raise ReadingError("there is no scan to average")
        names = scans[0].signatures
        if any(s.signatures != names or len(s.touched) != len(scans[0].touched) for s in scans):
            raise ReadingError("only scans of the same signatures and strips have a mean")
        electrodes = all(s.electrodes is not None for s in scans)
        seldom = 2 * np.sum([s.touched for s in scans], axis=0) <= len(scans)
        moved = max(
            _motion(np.concatenate([[s[n] for s in scans] for n in names], axis=1)), *(s.moved for s in scans)
        )
        growth = None if electrodes else _growth(scans, ~seldom)
        found = {}
        for name in (*names, *["electrodes"] * electrodes):
            k = np.stack([getattr(s, name) for s in scans])
            k[:, seldom] = np.nan
            if growth is not None:
                k -= growth[name]
            with np.errstate(invalid="ignore"), warnings.catch_warnings():
                warnings.simplefilter("ignore", RuntimeWarning)  # strips that nothing touches
                if len(scans) >= _STRAY_COUNT:
                    off = np.abs(k - np.nanmedian(k, axis=0))
                    k[off > np.maximum(_STRAY * robust_sigma(off, 0), _LEAST_STRAY)] = np.nan
                found[name] = np.clip(np.nanmean(k, axis=0), 0.0, 1.0)
        times = [s.time_s for s in scans]
        count = sum(s.averaged for s in scans)
        return cls(
            **found, time_s=float(np.mean(times)), averaged=count, span_s=max(times) - min(times), moved=moved
        )

    @classmethod
    def of_readings(cls, readings: Mapping[str, FloatArray], time_s: float = 0.0) -> Self:
        """Make a scan of a converter's readings, name to (strips,), within 0..1; nothing is checked or copied."""
        for k in readings.values():
            k.flags.writeable = False
        scan = cls.__new__(cls)
        scan.__dict__.update(dict.fromkeys(SIGNATURES), **readings, **_SINGLE, time_s=time_s)
        return scan

    @classmethod
    def of_electrodes(cls, electrodes: npt.ArrayLike, time_s: float = 0.0) -> Scan:
        """Make a CRS-CRP scan of all electrodes' readings (strips, 2 strips); errors as for `Scan`."""
        read = np.array(electrodes, dtype=float)
        if read.ndim != 2 or read.shape[1] != 2 * len(read):
            raise ReadingError(f"electrodes have shape {read.shape}; give (strips, 2 strips)")
        each = np.arange(len(read))
        return cls(kh=read[each, len(read) + each], kl=read[each, each], time_s=time_s, electrodes=read)

    def __getitem__(self, signature: str) -> FloatArray:
        """Return one signature's readings (strips,).

        Raises
        ------
        SignatureError
            The scan does not have it.
        """
        values: FloatArray | None = getattr(self, signature) if signature in SIGNATURES else None
        if values is None:
            raise SignatureError(f"the scan has no {signature!r}; it has: {', '.join(self.signatures)}")
        return values

    def reading(self, signature: str) -> FloatArray:
        """Return one signature's readings (strips,), NaN where the scan does not have it."""
        values: FloatArray | None = getattr(self, signature)
        return np.full(len(self.touched), np.nan) if values is None else values

    def read_on(self, strips: slice) -> Scan:
        """Return it without signatures that nothing reads on these strips, as where their channels are left out."""
        read = {name: self[name][strips] for name in self.signatures}
        lost = [name for name, k in read.items() if math.isnan(k[0]) and np.isnan(k).all()]
        none: dict[str, Any] = dict.fromkeys(lost)
        return replace(self, **none) if 0 < len(lost) < len(self.signatures) else self

    @property
    def half_read(self) -> BoolArray:
        """Whether each strip is touched and lacks one of its readings (strips,)."""
        return np.asarray(self.touched & np.any([np.isnan(self[name]) for name in self.signatures], axis=0))

    def runs(self) -> list[slice]:
        """Return the runs of neighbouring touched strips: a signature, an object each (4.2.4, step 1)."""
        at = self.touched.nonzero()[0]
        if len(at) and (last := int(at[-1])) - (first := int(at[0])) == len(at) - 1:
            return [slice(first, last + 1)]
        gaps = (at[1:] - at[:-1] > 1).nonzero()[0]
        begins, ends = at[[0, *gaps + 1]] if len(at) else at, at[[*gaps, -1]] if len(at) else at
        return [slice(a, b + 1) for a, b in zip(begins.tolist(), ends.tolist(), strict=True)]

    def check(self, sensor: Sensor) -> None:
        """Refuse a scan that this sensor cannot have made: `ReadingError` or `SignatureError`."""
        names = self.signatures
        if (strips := len(self[names[0]])) != sensor.strips:
            raise ReadingError(f"the scan has {strips} strips and the sensor has {sensor.strips}")
        for name in names:
            sensor.check_signature(name)
        if not sensor.kind.closed_form and len(half := np.flatnonzero(self.half_read)):
            raise ReadingError(
                f"strip {half[0] + sensor.strip_base} has only one of {' and '.join(self.signatures)}, and a "
                f"{sensor.construction} sensor needs all; leave the strip out as a whole"
            )

    def checked(self, sensor: Sensor) -> Scan:
        """Return what counts of the scan: without channels that the spec leaves out; errors as of `check`."""
        self.check(sensor)
        read = leave_out(sensor, {name: self[name] for name in self.signatures})
        alive = [name for name, k in read.items() if np.count_nonzero(k == k)]  # NaN is not itself
        if not sensor.without and len(alive) in (0, len(read)):
            return self
        kept: dict[str, Any] = {name: read[name] if name in alive or not alive else None for name in read}
        return replace(self, **kept)

    def split(self, sensor: LayeredSensor) -> tuple[Scan, ...]:
        """Return each layer's own scan; errors as of `check`.

        Examples
        --------
        >>> import tacstrip as ts
        >>> one = ts.Sensor(construction="crs-m", strips=2, pitch_mm=5.0, length_mm=10.0)
        >>> scan = ts.Scan(k=[0.5, float("nan"), 0.25, 0.75])
        >>> [layer.k.tolist() for layer in scan.split(ts.LayeredSensor.crossed(one))]
        [[0.5, nan], [0.25, 0.75]]
        """
        self.check(sensor.unit)
        found = []
        for part in sensor.slices:
            own: dict[str, Any] = {name: self[name][part] for name in self.signatures}
            found.append(replace(self, **own))
        return tuple(found)


def time_goes_back(time_s: FloatArray) -> str:
    """Say where the times of successive scans (scans,) [s] go back, and what mends that; nothing where they do not."""
    back = np.flatnonzero(np.diff(time_s) < 0.0)
    if not len(back):
        return ""
    before, after = time_s[back[0]], time_s[back[0] + 1]
    more = f", and time goes back in {len(back) - 1} place(s) more" if len(back) > 1 else ""
    return (
        f"after the scan at {before:.12g} s comes one at {after:.12g} s{more}: sort the scans by time, or split the "
        "recording where the clock was set back or another recording begins"
    )


def _motion(k: FloatArray) -> float:
    """Return by how much half of the channels change from the first half of scans to the second (scans, channels).

    0 where noise and its wander may do so.
    """
    if len(k) < 2:
        return 0.0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # strips that nothing touches
        halves = [np.nanmean(part, axis=0) for part in np.array_split(k, 2)]
        changed = float(np.nan_to_num(np.nanmedian(np.abs(halves[1] - halves[0]))))
        noise = float(np.nan_to_num(np.nanstd(np.diff(k, axis=0)))) / np.sqrt(0.5 * len(k))
    return changed if changed > _MOVED + 4.0 * noise else 0.0


def max_rounding(adc_bits: int | None) -> float:
    """Return how far beyond 0 or 1 rounding can bring a reading over Vref: half a step of the converter."""
    return 0.5 / (2.0 ** max(_BITS if adc_bits is None else adc_bits, _FEWEST_BITS) - 1.0)


def _growth(scans: Sequence[Scan], held: BoolArray) -> dict[str, FloatArray]:
    """Return what creep adds to each reading (scans, strips) by signature."""
    time_s = np.array([s.time_s for s in scans])
    order, age = np.argsort(time_s), time_s - time_s.min()
    names = scans[0].signatures
    k = np.stack([np.concatenate([s[name] for name in names]) for s in scans])
    there = np.isfinite(k).all(axis=0) & np.tile(held, len(names))
    rate = np.zeros(k.shape[1])
    if there.any():
        rate[there] = creep_rate(age[order], k[order][:, there])
    return dict(zip(names, np.split(log_age(age)[:, None] * rate, len(names), axis=1), strict=True))


def _readings(name: str, values: npt.ArrayLike) -> FloatArray:
    try:
        array = numbers(values)
    except (TypeError, ValueError):
        raise ReadingError(f"{name} needs one number per strip, NaN where nothing touches") from None
    if array.ndim != 1 or not len(array):
        raise ReadingError(f"{name} needs one value per strip, not an array of shape {array.shape}")
    if np.fmin.reduce(array) >= 0.0 and np.fmax.reduce(array) <= 1.0:  # as nearly always
        array.flags.writeable = False
        return array
    array = _without_rounding(array)
    if len(bad := np.flatnonzero((array < 0.0) | (array > 1.0))):
        raise ReadingError(
            f"{name} of strip {bad[0]} is {array[bad[0]]:.6g}, outside 0..1: it is a voltage over Vref"
        )
    array.flags.writeable = False
    return array


def _without_rounding(array: FloatArray) -> FloatArray:
    """Return readings with those set to 0 or 1 that are beyond by no more than rounding."""
    slack = max_rounding(None)
    near = (array >= -slack) & (array <= 1.0 + slack)
    return np.where(near, np.clip(array, 0.0, 1.0), array)


def _electrodes(values: npt.ArrayLike, touched: BoolArray) -> FloatArray:
    array = _without_rounding(numbers(values))
    if array.shape != (len(touched), 2 * len(touched)):
        raise ReadingError(
            f"electrodes have shape {array.shape}; give ({len(touched)}, {2 * len(touched)}): all electrodes at "
            "y = 0, then all at y = L, a row per energised strip"
        )
    wrong = (array < 0.0) | (array > 1.0) | (np.isnan(array) == touched[:, None])
    if len(bad := np.argwhere(wrong)):
        strip, electrode = bad[0]
        raise ReadingError(
            f"electrode {electrode} read {array[strip, electrode]:.6g} while strip {strip} was energised; give "
            "0..1, a voltage over Vref, and NaN for all of an untouched strip"
        )
    array.flags.writeable = False
    return array
