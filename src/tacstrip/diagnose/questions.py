"""What the readings at hand cannot tell: a strip that disagrees with its neighbours, in too few places to judge."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.diagnose.faults import Question
from tacstrip.diagnose.neighbour_prediction import WorkingCopy

# Over Vref, and standard deviations: further from the neighbours' line is no contact's shape.
_FAR, _SURE = 0.15, 8.0
_STEEP = 0.2  # over Vref: largest difference of the two neighbours
_SHARE, _OTHERS = 0.6, 0.1  # of the places: on the strip that is asked about, and on the usual one
_RAIL = 0.04  # over Vref
_MOST = 2  # strips: more questions are about the contact's shape


def questions(work: WorkingCopy, named: set[int]) -> Iterator[Question]:
    """Ask about strips that disagree with their neighbours, with the one or two faults that would explain it.

    Parameters
    ----------
    work
        A row for each place, after repairs.
    named
        Strips that have a verdict.
    """
    far, clear, lines = {}, {}, {}
    for name, values in work.k.items():
        e, both, gap = work.prediction(name)
        known = both & np.isfinite(values) & (gap < _STEEP)
        far[name] = known & (np.abs(values - np.where(known, e, 0.0)) > max(_FAR, _SURE * work.sigma))
        clear[name], lines[name] = known, e
    share = {name: far[name].sum(axis=0) / np.maximum(clear[name].sum(axis=0), 1) for name in far}
    worst = np.max(list(share.values()), axis=0)
    touched = work.there.any(axis=0)
    if not touched.any() or float(np.median(worst[touched])) > _OTHERS:
        return
    # Beside a bad strip its neighbours' lines are off by half as much.
    peak = worst * np.max([_misfit(work.k[n], lines[n], far[n]) for n in far], axis=0)
    padded = np.pad(peak, 1)
    asked = np.flatnonzero((worst >= _SHARE) & (peak >= padded[:-2]) & (peak >= padded[2:])).tolist()
    asked = [
        i
        for i in asked
        if not {int(work.order[j]) for j in (i - 1, i, i + 1) if 0 <= j < work.strips} & named
    ]
    silent = [i for i in _silent(work) if int(work.order[i]) not in named and i not in asked]
    if not 0 < len(asked) + len(silent) <= _MOST:
        return
    for i in asked:
        bad = [name for name in far if share[name][i] >= _SHARE]
        causes = _causes(work, i, bad, far, lines)
        count = int(max(far[name][:, i].sum() for name in bad))
        off = max(float(np.median(np.abs(work.k[n] - lines[n])[far[n][:, i], i])) for n in bad)
        evidence = f"lies {100 * off:.3g} % of Vref off its neighbours' line in {count} place(s)"
        signature = bad[0] if len(bad) == 1 < len(work.k) else None
        yield Question((int(work.order[i]),), causes, evidence, signature)
    for i in silent:
        evidence = f"reads no contact in {int(work.there.any(axis=1).sum())} place(s), between strips that do"
        yield Question((int(work.order[i]),), ("dead", "open-strip"), evidence)


def _misfit(values: FloatArray, line: FloatArray, far: BoolArray) -> FloatArray:
    """Return the mean distance from the neighbours' line where it is large (strips,)."""
    off = np.where(far, np.abs(values - np.where(far, line, 0.0)), 0.0)
    return np.asarray(off.sum(axis=0) / np.maximum(far.sum(axis=0), 1))


def _silent(work: WorkingCopy) -> list[int]:
    """Return the strips that are never touched, though two or more on either side of them always are."""
    there = work.there[work.there.any(axis=1)]
    never = np.asarray(~there.any(axis=0))
    return [
        i for i in range(2, work.strips - 2)
        if never[i] and len(there) and there[:, [i - 2, i - 1, i + 1, i + 2]].all(axis=1).mean() > _SHARE
    ]  # fmt: skip


def _causes(
    work: WorkingCopy, strip: int, bad: list[str], far: dict[str, BoolArray], lines: dict[str, FloatArray]
) -> tuple[str, ...]:
    """Return the one or two faults that explain what a strip's bad channels read."""
    rest = (work.sensor.rest_volt or 0.0) / work.sensor.vref_volt
    read = {name: work.k[name][far[name][:, strip], strip] for name in bad}
    every = np.concatenate(list(read.values()))
    at_ground = float(np.mean((np.abs(every) < _RAIL) | (np.abs(every - rest) < _RAIL)))
    at_vref = float(np.mean(every > 1.0 - _RAIL))
    if len(bad) == len(work.k) and max(at_ground, at_vref) > _SHARE:
        return ("open-strip", "dead") if at_ground > at_vref else ("open-strip", "stuck")
    if at_ground > _SHARE:
        return "dead", "open-sensing"
    if at_vref > _SHARE:
        return ("stuck",)  # a strip in the wrong place is on no rail
    if len(bad) == len(work.k) and _fits_reversed(work, strip, lines):
        return ("swapped-ends",)
    if work.pair is not None:
        difference = work.pair[0][:, strip] - work.pair[1][:, strip]
        if np.isfinite(difference).any() and float(np.nanmedian(difference)) < -_RAIL:
            return ("swapped-wires",)
    # A stuck channel reads one value; one that saturates may have been seen at its ceiling alone.
    below = all(float(np.median(v - lines[n][far[n][:, strip], strip])) < 0.0 for n, v in read.items())
    return ("stuck", "saturation") if below else ("stuck", "swapped-strips")


def _fits_reversed(work: WorkingCopy, strip: int, lines: dict[str, FloatArray]) -> bool:
    turned = {"kh": "kl", "kl": "kh", "k": "k"}
    if any(turned[n] not in work.k for n in work.k):
        return False  # the other end is not read
    as_is, reversed_ends = (
        np.concatenate([np.abs(v[:, strip] - lines[n][:, strip]) for n, v in values.items()])
        for values in (work.k, {n: 1.0 - work.k[turned[n]] for n in work.k})
    )
    known = np.isfinite(as_is) & np.isfinite(reversed_ends)
    return bool(known.any() and reversed_ends[known].mean() < 0.3 * as_is[known].mean())
