"""A recording on the bench: one row per place of the contact, what a strip's neighbours expect of it, and repairs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.diagnose.finding import Finding
from tacstrip.diagnose.log import Log
from tacstrip.sensor.spec import Sensor

Array = TypeVar("Array", FloatArray, BoolArray)

_REACH = 3  # strips to either side that may stand in for a neighbour
_MOVED = 0.01  # over Vref: a contact that changes a reading by this is at another place
_ONE_CONTACT = 0.3  # over Vref: neighbours further apart are not taken to be under one contact
_GROUND = 0.02  # over Vref
_MOST_PLACES = 4000


@dataclass(eq=False)
class View:
    """Readings that hypotheses are tried on; repairs change it.

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
    at_ground
        Whether the file's strips (strips,) read ground, and no open input, where they count as untouched.
    """

    sensor: Sensor
    k: dict[str, FloatArray]
    there: BoolArray
    sigma: float
    order: IntArray
    at_ground: BoolArray

    @property
    def pair(self) -> tuple[FloatArray, FloatArray] | None:
        """k_h and k_l where both were read."""
        return (self.k["kh"], self.k["kl"]) if {"kh", "kl"} <= set(self.k) else None

    @property
    def strips(self) -> int:
        """Number of strips."""
        return len(self.order)

    def drop(self, strip: int, signature: str | None = None) -> None:
        """Use a strip's readings, or one signature's, no more; its neighbours reach across."""
        for name in self.k if signature is None else (signature,):
            self.k[name][:, strip] = np.nan
        if signature is None and not self.there[:, strip].all():
            self.there[:, strip] |= _between(self.there)[:, strip]


@dataclass(frozen=True, eq=False)
class Suspect:
    """A fault that explains a misfit.

    Attributes
    ----------
    gain
        Mean misfit that it explains, over Vref: the largest is taken first, for it disturbs others' neighbours.
    repair
        Undoes it on a view.
    """

    finding: Finding
    gain: float
    repair: Callable[[View], None]


def view_of(log: Log, sigma: float) -> View:
    """Put every scan of a recording on the bench, a row each."""
    rest = log.sensor.rest_volt
    grounded = rest is not None and rest <= _GROUND * log.sensor.vref_volt
    there = np.isfinite(np.stack(list(log.raw.values()))).all(axis=(0, 1))
    across = np.arange(log.sensor.strips)
    return View(log.sensor, dict(log.k), log.touched.copy(), sigma, across, np.asarray(there & grounded))


def places(view: View) -> View:
    """Average scans that follow each other with the contact in one place; leave out those without a contact.

    A contact moved by less than the noise shows counts as in one place, so that every row is worth the same.
    """
    values = np.stack(list(view.k.values()), axis=2)  # (scans, strips, signatures)
    threshold = max(_MOVED, 6.0 * view.sigma)
    group = np.zeros(len(values), dtype=int)
    start, number = 0, 0
    for t in range(1, len(values)):
        moved = np.nanmax(np.abs(values[t] - values[start]), initial=0.0) > threshold
        if moved or not (view.there[t] == view.there[start]).all():
            start, number = t, number + 1
        group[t] = number
    first = np.flatnonzero(np.diff(group, prepend=-1))
    sums = np.add.reduceat(np.nan_to_num(values), first, axis=0)
    counts = np.add.reduceat(np.isfinite(values).astype(int), first, axis=0)
    means = np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)
    keep = np.flatnonzero(view.there[first].any(axis=1))
    keep = keep[np.linspace(0, len(keep) - 1, min(len(keep), _MOST_PLACES)).astype(int)]
    parts = {name: np.ascontiguousarray(means[keep, :, i]) for i, name in enumerate(view.k)}
    return View(view.sensor, parts, view.there[first][keep], view.sigma, view.order.copy(), view.at_ground)


def expected(values: FloatArray, there: BoolArray) -> tuple[FloatArray, BoolArray, FloatArray]:
    """Return what neighbours expect of every strip, whether they stand on both sides, how they differ (rows, strips).

    The nearest usable strip on either side, up to three away and with nothing untouched in between, or the two
    nearest of one side; NaN where there are none. A straight line through them: (4.1)'s signatures are smooth but for
    their kinks.
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


def residuals(view: View, name: str) -> tuple[FloatArray, FloatArray]:
    """Return what neighbours expect of every strip and what it reads above that (places, strips), where both are known.

    A strip that ever is between two others counts only where it is: beyond the last strip lines go astray. So they do
    between two contacts.
    """
    values = view.k[name]
    e, both, gap = expected(values, view.there)
    known = np.isfinite(e) & np.isfinite(values) & ~(gap > _ONE_CONTACT)
    inside = both & known
    e = np.where(inside | (known & ~inside.any(axis=0)), e, np.nan)
    return e, values - e


def _side(
    values: FloatArray, there: BoolArray, step: int
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the nearest usable value on one side and its distance, then the next one's (rows, strips)."""
    near, far = np.full_like(values, np.nan), np.full_like(values, np.nan)
    d_near, d_far = np.full_like(values, np.nan), np.full_like(values, np.nan)
    alive = np.ones_like(there)
    for distance in range(1, _REACH + 2):
        alive = alive & _shift(there, step * distance, False)
        value = _shift(values, step * distance, np.nan)
        usable = alive & np.isfinite(value)
        second = usable & np.isfinite(near) & np.isnan(far)
        first = usable & np.isnan(near)
        if distance > _REACH:
            first[:] = False
        for mask, kept, at in ((first, near, d_near), (second, far, d_far)):
            kept[mask] = value[mask]
            at[mask] = distance
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


def _between(there: BoolArray) -> BoolArray:
    return np.asarray(_shift(there, -1, False) & _shift(there, 1, False))
