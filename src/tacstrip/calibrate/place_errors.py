"""Places that are not exact: the contacts' errors along y as parameters of the fit, with their prior.

Errors are drawn for each row on its own, or once for all strips of a press, for all repeats of a place, or for all
contacts of a length, which one bar makes. The runs do not say which; the fit's evidence does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.io.runs import Runs

_UNKNOWN = (1.5e-4, 5e-4, 1.5e-3)  # of L: errors that are tried where the runs state none
_BARS = 5e-3  # of L: the same of all bars' lengths alike
_ALL_BARS = "all bars"
_MOST = 200  # errors that strips share: more are drawn row by row


@dataclass(frozen=True, eq=False)
class PlaceErrors:
    """Errors of the contacts' places.

    Attributes
    ----------
    sd_mm
        Standard deviations of l and w (2, contacts, strips) [mm].
    group
        Number of each contact's error in l and w (2, contacts, strips), from 0; None: each row has its own.
    name
        In words, what shares an error.
    stated
        Whether the runs state the deviations, or one of several was guessed.
    """

    sd_mm: FloatArray
    group: IntArray | None
    name: str
    stated: bool = True

    def same(self, other: PlaceErrors) -> bool:
        """Whether the other one says the same of the runs' places."""
        return self.name == other.name and np.array_equal(self.sd_mm, other.sd_mm)

    @property
    def count(self) -> int:
        """How many errors contacts share."""
        return 0 if self.group is None else int(self.group.max()) + 1

    def columns(self, by_place: FloatArray) -> FloatArray:
        """Return the derivatives of readings by the shared errors over their standard deviations.

        From those by l and w [1/mm] (signatures, contacts, strips, 2) to (signatures, contacts, strips, errors).
        """
        found = np.zeros((*by_place.shape[:3], self.count))
        if self.group is not None:
            for which in (0, 1):
                move = by_place[..., which] * self.sd_mm[which]
                np.put_along_axis(found, self.group[which][None, :, :, None], move[..., None], axis=3)
        return found

    def longer_mm(self, errors: FloatArray) -> float:
        """Return by how much contacts with a length are longer [mm], by errors of `one_for_all_bars`; 0 of others."""
        return float(self.sd_mm.max() * errors[0]) if self.name == _ALL_BARS else 0.0

    def own(self, by_place: FloatArray) -> FloatArray:
        """Return the same for the errors of each row's own (signatures, contacts, strips, 2); 0 where shared."""
        if self.group is not None:
            return np.zeros_like(by_place)
        return by_place * np.moveaxis(self.sd_mm, 0, -1)


def possible_errors(runs: Runs, length_mm: float) -> list[PlaceErrors]:
    """Return what the errors of the runs' places may be, exact places (no error) not counted."""
    there = np.isfinite(runs.l_mm)
    l, w = (np.where(there, v, -1.0) for v in (runs.l_mm, runs.w_mm))
    place = place_numbers(runs)
    press = _numbers(place, _occurrence(place))
    if runs.l_sd_mm is None and runs.w_sd_mm is None:
        exact = there * np.stack([np.ones_like(l), (w > 0.0).astype(float)]) * length_mm
        group = _both(press, press)
        tried = _UNKNOWN if group.max() < _MOST else ()
        return [PlaceErrors(exact * sd, group, "press", stated=False) for sd in tried]
    zero = np.zeros_like(l)
    sd = np.stack([zero if v is None else np.where(there, v, 0.0) for v in (runs.l_sd_mm, runs.w_sd_mm)])
    found = [PlaceErrors(sd, None, "row")]
    bar = _numbers(w)
    shared = {
        "press": (press, press),
        "place": (place, place),
        "bar": (place, bar),
        "bar and press": (press, bar),
    }
    for name, (l_group, w_group) in shared.items():
        group = _both(l_group, w_group)
        known = any(other.group is not None and np.array_equal(other.group, group) for other in found)
        if group.max() < _MOST and not known:
            found.append(PlaceErrors(sd, group, name))
    return found


def one_for_all_bars(runs: Runs, length_mm: float) -> PlaceErrors:
    """Return one error of w for all contacts with a length, their lower ends exact: bars longer than written."""
    with_length = np.isfinite(runs.l_mm) & (np.nan_to_num(runs.w_mm) > 0.0)
    sd = np.stack([np.zeros_like(runs.l_mm), _BARS * length_mm * with_length])
    return PlaceErrors(sd, np.zeros(sd.shape, dtype=np.intp), _ALL_BARS, stated=False)


def place_numbers(runs: Runs) -> IntArray:
    """Return the number of each contact's place (contacts, strips), from 0.

    Where the file has press after press, each on all strips, a press is at one place: a bar that lies slanted across
    the strips is one bar, and what it is off by the strips share.
    """
    l, w = (np.nan_to_num(v, nan=-1.0) for v in (runs.l_mm, runs.w_mm))
    there = np.isfinite(runs.l_mm).any(axis=0)
    line = runs.line[:, there]
    if np.isfinite(runs.l_mm[:, there]).all() and (line[:-1].max(axis=1) < line[1:].min(axis=1)).all():
        number = np.unique(np.concatenate([l, w], axis=1), axis=0, return_inverse=True)[1]
        return np.asarray(np.broadcast_to(number.reshape(-1, 1), l.shape))
    return _numbers(l, w)


def _both(l_group: IntArray, w_group: IntArray) -> IntArray:
    return np.stack([l_group, w_group + l_group.max() + 1])


def _numbers(*values: FloatArray | IntArray) -> IntArray:
    """Return the number of each combination of values (contacts, strips), from 0."""
    rows = np.stack([v.ravel() for v in values], axis=1)
    return np.asarray(np.unique(rows, axis=0, return_inverse=True)[1].reshape(values[0].shape))


def _occurrence(number: IntArray) -> IntArray:
    """Return how often each strip has had the number before (contacts, strips)."""
    before = np.zeros_like(number)
    for strip, column in enumerate(number.T):
        order = np.argsort(column, kind="stable")
        first = np.searchsorted(column[order], column[order])
        before[order, strip] = np.arange(len(order)) - first
    return before
