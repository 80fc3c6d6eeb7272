"""A recording with one row per place of the contact, the prediction of each strip from its neighbours, and repairs."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.diagnose.faults import Finding
from tacstrip.diagnose.log import Log
from tacstrip.sensor.spec import Sensor

Array = TypeVar("Array", FloatArray, BoolArray)
Made = TypeVar("Made")

# Strips, twice what the middle of a contact moves across, but for strays: of the rows.
_ACROSS, _STRAY = 3, 0.1
_REACH = 3  # strips to either side that may stand in for a neighbour
_MOVED = 0.01  # over Vref: a contact that changes a reading by this is at another place
_ONE_CONTACT = 0.3  # over Vref: neighbours further apart are not taken to be under one contact
_RAIL = 0.02  # over Vref
_OFTEN_ALONE, _ALWAYS = 20, 0.97  # rows in which a strip's neighbours are untouched; of all rows
_MOST_PLACES, _MOST_READINGS = 4000, 200_000


@dataclass(eq=False)
class WorkingCopy:
    """A copy of the readings that tests examine and repairs change.

    Attributes
    ----------
    k
        Corrected readings over Vref by signature (places, strips); NaN where untouched or not to be used.
    there
        Whether a strip is touched, with readings or without (places, strips).
    sigma
        Standard deviation of a reading over Vref.
    order
        The file's strip at each place across (strips,), counted from 0.
    on_rail
        Whether the file's strips (strips,) read ground or Vref, rather than nothing, where they count as untouched.
    time_s
        When the rows were (places,) [s].
    """

    sensor: Sensor
    k: dict[str, FloatArray]
    there: BoolArray
    sigma: float
    order: IntArray
    on_rail: BoolArray
    time_s: FloatArray
    _made: dict[Hashable, Any] = field(default_factory=dict, init=False)

    @property
    def pair(self) -> tuple[FloatArray, FloatArray] | None:
        """k_h and k_l where both were read."""
        return (self.k["kh"], self.k["kl"]) if {"kh", "kl"} <= set(self.k) else None

    @property
    def strips(self) -> int:
        """Number of strips."""
        return len(self.order)

    def drop(self, *strips: int, signature: str | None = None) -> None:
        """Discard strips' readings, or one signature's; their neighbours are then each other's nearest."""
        self.changed()
        for strip in strips:
            for name in self.k if signature is None else (signature,):
                self.k[name][:, strip] = np.nan
            if signature is None and not self.there[:, strip].all():
                between = _shift(self.there, -1, False) & _shift(self.there, 1, False)
                self.there[:, strip] |= between[:, strip]

    def touched_without_contact(self) -> BoolArray:
        """Return which strips (strips,) count as touched where no contact is: their level is not that of rest."""
        padded = np.pad(self.there, ((0, 0), (1, 1)))
        alone = ~padded[:, :-2] & ~padded[:, 2:]
        count = (alone & self.there).sum(axis=0)
        return np.asarray((count >= _OFTEN_ALONE) & (self.there.mean(axis=0) > _ALWAYS))

    def changed(self) -> None:
        """Forget what was made of readings that have changed."""
        self._made.clear()

    def once(self, name: Hashable, make: Callable[[], Made]) -> Made:
        """Return what is made of the readings; it is made once until they change, and nobody may alter it."""
        if name not in self._made:
            self._made[name] = make()
        made: Made = self._made[name]
        return made

    def prediction(self, name: str) -> tuple[FloatArray, BoolArray, FloatArray]:
        """Return `predict_from_neighbours` of a signature."""
        return self.once(("prediction", name), lambda: predict_from_neighbours(self.k[name], self.there))

    def suspect(
        self, fault: str, strips: Sequence[int], evidence: str, numbers: Mapping[str, float], explained: float,
        signature: str | None = None, repair: Callable[[WorkingCopy], None] | None = None,
    ) -> Suspect:  # fmt: skip
        """Return a fault of the strips at these places; without another `repair` their readings are discarded."""
        files = tuple(sorted(int(self.order[i]) for i in strips))
        finding = Finding(fault, files, evidence, numbers, signature)
        return Suspect(finding, explained, repair or (lambda work: work.drop(*strips, signature=signature)))


@dataclass(frozen=True, eq=False)
class Suspect:
    """A fault that explains a misfit.

    Attributes
    ----------
    explained
        Mean misfit that it explains, over Vref: the largest is taken first, because it disturbs its neighbours.
    repair
        Undoes it on a working copy.
    doubtful
        Whether a sound unit may look like this: a question, then, and no finding.
    """

    finding: Finding
    explained: float
    repair: Callable[[WorkingCopy], None]
    doubtful: bool = False


def working_copy(log: Log, sigma: float) -> WorkingCopy:
    """Return a working copy of a recording, a row for each scan."""
    rest = None if log.sensor.rest_volt is None else log.sensor.rest_volt / log.sensor.vref_volt
    rail = rest is not None and min(rest, 1.0 - rest) <= _RAIL
    there = np.isfinite(np.stack(list(log.raw.values()))).all(axis=(0, 1))
    across = np.arange(log.sensor.strips)
    on_rail = np.asarray(there & rail)
    return WorkingCopy(log.sensor, dict(log.k), log.touched.copy(), sigma, across, on_rail, log.time_s)


def places(work: WorkingCopy, most: int = 1 << 30) -> WorkingCopy:
    """Average successive scans with the contact at one place; drop those without a contact.

    A contact that moves by less than the noise stays at one place, so that all rows carry equal information; it is
    another place after so many scans at the `most`.
    """
    values = np.stack(list(work.k.values()), axis=2)  # (scans, strips, signatures)
    threshold = max(_MOVED, 6.0 * work.sigma)
    group = np.zeros(len(values), dtype=int)
    start, number = 0, 0
    for t in range(1, len(values)):
        moved = np.fmax.reduce(np.abs(values[t] - values[start]), axis=None, initial=0.0) > threshold
        if moved or t - start >= most or not (work.there[t] == work.there[start]).all():
            start, number = t, number + 1
        group[t] = number
    first = np.flatnonzero(np.diff(group, prepend=-1))
    sums = np.add.reduceat(np.nan_to_num(values), first, axis=0)
    counts = np.add.reduceat(np.isfinite(values).astype(int), first, axis=0)
    means = np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)
    keep = np.flatnonzero(work.there[first].any(axis=1))
    count = min(len(keep), _MOST_PLACES, max(_MOST_READINGS // work.strips, 1000))
    keep = keep[np.linspace(0, len(keep) - 1, count).astype(int)]
    parts = {name: np.ascontiguousarray(means[keep, :, i]) for i, name in enumerate(work.k)}
    times = work.time_s[first][keep]
    return replace(work, k=parts, there=work.there[first][keep], order=work.order.copy(), time_s=times)


def predict_from_neighbours(values: FloatArray, there: BoolArray) -> tuple[FloatArray, BoolArray, FloatArray]:
    """Return the prediction of every strip from its neighbours (rows, strips).

    A straight line through the nearest usable strip on either side, up to three away and with nothing untouched in
    between, or through the two nearest on one side; NaN where there are none. The signatures of (4.1) are smooth but
    for their kinks.

    Returns
    -------
    prediction, both, gap
        Over Vref; whether there are neighbours on both sides; by how much the two neighbours differ.
    """
    (near_l, d_l, far_l, e_l), (near_r, d_r, far_r, e_r) = (_side(values, there, step) for step in (-1, 1))
    both = np.isfinite(near_l) & np.isfinite(near_r)
    with np.errstate(invalid="ignore", divide="ignore"):
        between = (near_l * d_r + near_r * d_l) / (d_l + d_r)
        left = near_l + (near_l - far_l) * d_l / (e_l - d_l)
        right = near_r + (near_r - far_r) * d_r / (e_r - d_r)
    use_left = np.isfinite(left)
    beyond = np.where(use_left, left, right)
    gap = np.where(both, near_l - near_r, np.where(use_left, near_l - far_l, near_r - far_r))
    return np.where(both, between, beyond), both, np.abs(gap)


def neighbour_residuals(work: WorkingCopy, name: str) -> tuple[FloatArray, FloatArray]:
    """Return each strip's prediction from its neighbours and its residual (places, strips), NaN where not known.

    A strip that is ever between two others counts only where it is: extrapolation is inaccurate. So is interpolation
    between two contacts.
    """

    def made() -> tuple[FloatArray, FloatArray]:
        values = work.k[name]
        e, both, gap = work.prediction(name)
        known = np.isfinite(e) & np.isfinite(values) & ~(gap > _ONE_CONTACT)
        inside = both & known
        e = np.where(inside | (known & ~inside.any(axis=0)), e, np.nan)
        return e, values - e

    return work.once(("residuals", name), made)


def strips_beside(there: BoolArray) -> FloatArray:
    """Return how many strips that are touched lie to the left of each without a gap (rows, strips)."""
    out = np.zeros(there.shape)
    for i in range(1, there.shape[1]):
        out[:, i] = np.where(there[:, i - 1], out[:, i - 1] + 1.0, 0.0)
    return out


def strips_on_both_sides(there: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Return how many touched strips lie to the left and to the right of each without a gap (rows, strips)."""
    return strips_beside(there), strips_beside(there[:, ::-1])[:, ::-1]


def moved_across(right_less_left: FloatArray) -> bool:
    """Whether a contact moved across a strip, by how many more touched strips lie right of it than left (rows,)."""
    low, high = np.quantile(right_less_left, [_STRAY, 1.0 - _STRAY])
    return bool(high - low >= _ACROSS)


def _side(
    values: FloatArray, there: BoolArray, step: int
) -> tuple[FloatArray, IntArray, FloatArray, IntArray]:
    """Return the nearest usable value on one side and its distance, then those of the next one (rows, strips).

    NaN and 0 where there is none.
    """
    near, far = np.full((2, *values.shape), np.nan)
    d_near, d_far = np.zeros((2, *values.shape), dtype=int)
    alive, no_near, no_far = np.ones((3, *values.shape), dtype=bool)
    for distance in range(1, _REACH + 2):
        alive &= _shift(there, step * distance, False)
        value = _shift(values, step * distance, np.nan)
        usable = alive & np.isfinite(value)
        first, second = usable & no_near & (distance <= _REACH), usable & ~no_near & no_far
        for mask, none, kept, at in ((first, no_near, near, d_near), (second, no_far, far, d_far)):
            np.copyto(kept, value, where=mask)
            np.copyto(at, distance, where=mask)
            none &= ~mask
        if not (alive & no_far).any():
            break
    return near, d_near, far, d_far


def _shift(array: Array, by: int, fill: float) -> Array:
    """Return the array whose column i is column i + by, `fill` beyond the edges."""
    out = np.full_like(array, fill)
    if abs(by) < array.shape[1]:
        if by > 0:
            out[:, :-by] = array[:, by:]
        else:
            out[:, -by:] = array[:, :by]
    return out
