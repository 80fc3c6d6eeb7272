"""Contacts that come and go: a channel that drops out while its neighbours stay under the same contact."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.diagnose.faults import Finding
from tacstrip.diagnose.neighbour_prediction import WorkingCopy, predict_from_neighbours

_FAR = (
    0.12  # over Vref: a reading this far off its neighbours' line, at the level of a free wire, dropped out
)
_STILL = 0.05  # over Vref: what the neighbours may change while a reading jumps by more than _FAR
_JUMPS, _JUMPS_SILENT = 3, 8  # to and fro, beside neighbours that stay; to untouched, as at a contact's rim
_FEWEST = 5  # scans that dropped out
_MOST_ALONE = 8  # scans that a pointed contact touches one strip at its end
_LEAST, _MOST = 0.04, 0.7  # of the scans in which a dropout could be seen
_OTHERS = 4.0  # times as many jumps as the third-worst strip: a contact's shape does the same to several
_CUT = 0.12  # a cut strip drops out at some heights, which are all above or all below the others


def intermittent(work: WorkingCopy) -> Iterator[Finding]:
    """Find channels that drop out and come back; what they read meanwhile is discarded from the working copy.

    Parameters
    ----------
    work
        A row for each scan.
    """
    rest = (work.sensor.rest_volt or 0.0) / work.sensor.vref_volt
    near = max(0.02, 5.0 * work.sigma)
    expected = {name: predict_from_neighbours(values, work.there) for name, values in work.k.items()}
    gone = _gaps(work)
    found: dict[str, tuple[BoolArray, BoolArray, FloatArray]] = {}
    for name, values in work.k.items():
        e, both, gap = expected[name]
        both[:, [0, -1]] = np.isfinite(e[:, [0, -1]])
        steady = both & (gap < 0.3)
        free = np.any([np.abs(values - level) < near for level in {0.0, rest, 1.0}], axis=0)
        with np.errstate(invalid="ignore"):
            out = steady & free & (np.abs(values - e) > _FAR)
            good = steady & (np.abs(values - e) < _FAR / 2.0)
        found[name] = out, good, e
    # A strip that counts as untouched has no reading; its neighbours' line spans the gap.
    for name, values in work.k.items():
        out, good, e = found[name]
        lost = work.there & np.isnan(values) & np.isfinite(values).any(axis=0)
        silent = gone | lost
        if silent.any():
            spanned, both, gap = predict_from_neighbours(values, work.there | gone)
            e = np.where(silent, spanned, e)
            silent = silent & both & (gap < 0.3)
        if work.sensor.rest_volt is not None:  # a contact may read as rest does
            silent &= np.abs(e - rest) > 2.0 * (work.sensor.touch_volt or 0.0) / work.sensor.vref_volt
        if work.sensor.rest_volt is not None:  # the wire's level instead of rest, beside strips that rest
            alone = _alone(work.there)
            lone = (
                alone & work.there & np.any([np.abs(values - level) < near for level in (0.0, 1.0)], axis=0)
            )
            often = lone.sum(axis=0) > _MOST_ALONE
            silent |= lone & often
            good = good | (alone & ~work.there & often)
            e = np.where(alone, 0.0, e)
        found[name] = out | silent, good, e
    jumps = np.zeros((len(work.k), work.strips))
    for row, (out, good, e) in enumerate(found.values()):
        with np.errstate(invalid="ignore"):
            same = np.abs(np.diff(e, axis=0)) < _STILL
        jumps[row] = (same & ((out[1:] & good[:-1]) | (good[1:] & out[:-1]))).sum(axis=0)
    usual = np.sort(jumps, axis=1)[:, -4] if work.strips > 4 else np.zeros(len(work.k))
    for strip in range(work.strips):
        channels = []
        for row, (name, (out, good, e)) in enumerate(found.items()):
            gaps, fine = int(out[:, strip].sum()), int(good[:, strip].sum())
            share = gaps / max(gaps + fine, 1)
            under = work.there[:, strip] & np.isfinite(work.k[name][:, strip]) & good[:, strip]
            if under.sum() < _FEWEST:
                continue  # it never reads a contact
            least = _JUMPS_SILENT if (out & np.isnan(work.k[name]))[:, strip].sum() > 0.5 * gaps else _JUMPS
            few = jumps[row, strip] < max(least, _OTHERS * usual[row] + 1)
            if gaps < _FEWEST or few or not _LEAST < share < _MOST:
                continue
            read = np.where(gone[:, strip], np.nan, work.k[name][:, strip])
            line, fine_at = e[:, strip], good[:, strip]
            # Where the neighbours read as a free wire does, good readings prove nothing.
            levels = (
                (read < 0.5, line > _FAR),
                (read >= 0.5, line < 1.0 - _FAR),
                (np.isnan(read), line > -1.0),
            )
            mixed = [
                _mixed(line[out[:, strip] & side], line[fine_at & apart])
                for side, apart in levels if (out[:, strip] & side).sum() >= _FEWEST
            ]  # fmt: skip
            if not mixed or not all(mixed):
                continue
            channels.append((name, share, gaps, int(jumps[row, strip])))
        if not channels:
            continue
        name, share, gaps, count = max(channels, key=lambda c: c[1])
        evidence = (
            f"drops out in {gaps} scans, {100 * share:.2g} % of those in which its neighbours stay under the contact, "
            f"and comes and goes {count} times"
        )
        numbers = {"share": share, "scans": float(gaps), "jumps": float(count)}
        yield Finding("intermittent", (int(work.order[strip]),), evidence, numbers,
                      name if len(channels) == 1 and len(work.k) == 2 else None)  # fmt: skip
        for channel, *_ in channels:
            work.k[channel][found[channel][0][:, strip], strip] = np.nan
        work.there[gone[:, strip], strip] = True


def _gaps(work: WorkingCopy) -> BoolArray:
    """Return where a strip counts as untouched between two touched ones on either side (scans, strips).

    Nearer to a contact's rim, it may be its shape, or strips in the wrong order.
    """
    there = work.there
    gap = np.zeros_like(there)
    gap[:, 2:-2] = ~there[:, 2:-2] & there[:, :-4] & there[:, 1:-3] & there[:, 3:-1] & there[:, 4:]
    return gap


def _alone(there: BoolArray) -> BoolArray:
    """Return where both neighbours of a strip are untouched (scans, strips)."""
    padded = np.pad(there, ((0, 0), (1, 1)))
    return np.asarray(~padded[:, :-2] & ~padded[:, 2:])


def _mixed(out: FloatArray, good: FloatArray) -> bool:
    """Whether dropouts come at the same heights as good readings do."""
    out, good = np.sort(out[np.isfinite(out)]), np.sort(good[np.isfinite(good)])
    if not len(out) or not len(good):
        return False
    below = float(np.searchsorted(good, out).mean()) / len(good)
    return _CUT < below < 1.0 - _CUT or float(np.ptp(np.concatenate([out, good]))) < 0.1
