"""One scan: what a sensor measured in one sampling cycle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tacstrip.arrays import BoolArray, FloatArray, extent, touched_strips
from tacstrip.errors import ReadingError, SignatureError
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.spec import Sensor

# Of Vref: sums and quotients of a handful of numbers end so far beyond 0 or 1.
_ROUNDING = 16.0 * np.finfo(float).eps


@dataclass(frozen=True, eq=False)
class Scan:
    """Readings of all strips over Vref, one array (strips,) per signature; NaN where nothing touches.

    `electrodes` (strips, 2 strips), for CRS-CRP only: what every electrode of the sheet read while each strip was
    energised, those at y = 0 first, then those at y = L; a row of NaN where nothing touches. k_l and k_h are its
    two diagonals.

    Raises
    ------
    ReadingError
        No signature, arrays of different lengths, a value outside 0..1, or a strip with one reading of
        two; the message names the strip, counted from 0.

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

    def __post_init__(self) -> None:
        for name in SIGNATURES:
            if (values := getattr(self, name)) is not None:
                object.__setattr__(self, name, _readings(name, values))
        names = self.signatures
        if not names:
            raise ReadingError("a scan needs at least one signature: kh, kl or k")
        first = self[names[0]]
        for name in names[1:]:
            if len(self[name]) != len(first):
                raise ReadingError(f"{names[0]} has {len(first)} strips and {name} has {len(self[name])}")
            half = np.flatnonzero(np.isnan(self[name]) != np.isnan(first))
            if len(half):
                raise ReadingError(
                    f"strip {half[0]} has only one of {names[0]} and {name}; "
                    "give both, or NaN for both where nothing touches"
                )
        if self.electrodes is not None:
            object.__setattr__(self, "electrodes", _electrodes(self.electrodes, self.touched))

    def __repr__(self) -> str:
        names = [n for n in (*SIGNATURES, "electrodes") if getattr(self, n) is not None]
        ranges = [f", {name} {extent(getattr(self, name))}" for name in names]
        strips = f"{len(self.touched)} strips at {self.time_s:.6g} s: {touched_strips(self.touched)}"
        return f"<Scan of {strips}{''.join(ranges)}>"

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

    @property
    def signatures(self) -> tuple[str, ...]:
        """Names of the signatures that were measured."""
        return tuple(name for name in SIGNATURES if getattr(self, name) is not None)

    @property
    def touched(self) -> BoolArray:
        """Whether each strip is touched (strips,)."""
        return ~np.isnan(self[self.signatures[0]])

    def runs(self) -> list[slice]:
        """Return the runs of neighbouring touched strips: a signature, an object each (4.2.4, step 1)."""
        edges = np.diff(np.concatenate(([0], self.touched.astype(np.int8), [0])))
        begins, ends = np.flatnonzero(edges == 1).tolist(), np.flatnonzero(edges == -1).tolist()
        return [slice(a, b) for a, b in zip(begins, ends, strict=True)]

    def check(self, sensor: Sensor) -> None:
        """Refuse a scan that this sensor cannot have made: `ReadingError` or `SignatureError`."""
        if len(self.touched) != sensor.strips:
            raise ReadingError(f"the scan has {len(self.touched)} strips and the sensor has {sensor.strips}")
        for name in self.signatures:
            sensor.check_signature(name)


def _readings(name: str, values: npt.ArrayLike) -> FloatArray:
    try:
        array = np.array(values, dtype=float)
    except (TypeError, ValueError):
        raise ReadingError(f"{name} needs one number per strip, NaN where nothing touches") from None
    if array.ndim != 1 or not len(array):
        raise ReadingError(f"{name} needs one value per strip, not an array of shape {array.shape}")
    array = _without_rounding(array)
    if len(bad := np.flatnonzero((array < 0.0) | (array > 1.0))):
        raise ReadingError(
            f"{name} of strip {bad[0]} is {array[bad[0]]:.6g}, outside 0..1: it is a voltage over Vref"
        )
    array.flags.writeable = False
    return array


def _without_rounding(array: FloatArray) -> FloatArray:
    """Return readings with those set to 0 or 1 that are beyond by no more than rounding."""
    near = (array >= -_ROUNDING) & (array <= 1.0 + _ROUNDING)
    return np.where(near, np.clip(array, 0.0, 1.0), array)


def _electrodes(values: npt.ArrayLike, touched: BoolArray) -> FloatArray:
    array = _without_rounding(np.array(values, dtype=float))
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
