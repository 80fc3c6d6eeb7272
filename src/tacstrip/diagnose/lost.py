"""A strip that works and then reads no contact for a stretch of the recording, from there on, or now and then."""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.diagnose.faults import Finding, Question
from tacstrip.diagnose.intermittent import mixed_heights
from tacstrip.diagnose.neighbour_prediction import WorkingCopy, moved_across, strips_on_both_sides
from tacstrip.diagnose.regression import passes

_FEWEST = 8  # scans across the strip, in the stretch and outside
_ONE_CONTACT = 0.2  # over Vref: neighbours under one contact do not differ by more
_FAR_FROM_REST, _BENT = 2.5, 0.04  # times what counts as touched, and over Vref what a contact bends there
_AMID, _MANY, _VISITS = 2, 20, 3  # strips on either side, scans, and times that a contact came: a question
_STRAY = 0.1  # of the scans
_SOUND = 0.2  # of the scans across the strip outside the stretch: a gap between objects is not of one stretch
_MOST = 2  # strips: more are gaps between objects
# Of the scans across a strip: more is no gap now and then; times any other strip's gaps.
_OFTEN, _OTHERS = 0.7, 4.0


def lost(work: WorkingCopy) -> tuple[list[Finding], list[Question]]:
    """Find strips that read no contact for a stretch, while one contact moves over them and over both neighbours.

    Or now and then, where the other strips hardly ever do. One object has no gap there, and a gap between two stays
    between them: it moves with the contact's middle. What a strip lacks then is marked in the working copy as
    touched, without a reading.

    Parameters
    ----------
    work
        A row for each scan.

    Returns
    -------
    findings, questions
        The latter where the contact hardly moves across meanwhile, as two objects side by side do; beside its rim
        neither.
    """
    over, heights = _should_read(work), _heights(work)
    there = work.there.copy()  # strays last for one scan
    there[1:-1] &= there[2:] | there[:-2]
    left, right = strips_on_both_sides(work.there)
    found: list[tuple[int, slice, BoolArray, bool, bool]] = []
    for strip in np.flatnonzero((over & ~there).sum(axis=0) >= _FEWEST).tolist():
        stretch = _longest_silence(over[:, strip], there[:, strip])
        inside = np.zeros(len(over), dtype=bool)
        inside[stretch] = True
        gap = over[:, strip] & ~work.there[:, strip] & inside
        across = over[:, strip] & ~inside
        good = int((across & work.there[:, strip]).sum())
        if gap.sum() < _FEWEST or good < max(_FEWEST, (1.0 - _SOUND) * across.sum()):
            continue
        read = across & work.there[:, strip]
        if _cut(work, heights, strip, gap, read):
            continue
        amid = float(np.mean(np.minimum(left, right)[gap, strip] >= _AMID)) > 1.0 - _STRAY
        moved = moved_across((right - left)[gap, strip])
        often = min(int(gap.sum()), good) >= _MANY and passes(np.flatnonzero(gap)) >= _VISITS
        if moved or often:
            found.append((strip, stretch, gap, moved, amid))
    findings: list[Finding] = []
    asked: list[Question] = []
    found = found if len(found) <= _MOST else []
    for strip, stretch, gap, moved, amid in found:
        begin, end = float(work.time_s[stretch.start]), float(work.time_s[stretch.stop - 1])
        until = f"to {end:.4g} s" if stretch.stop < len(gap) else "on to the end"
        evidence = (
            f"reads no contact from {begin:.4g} s {until}, in {int(gap.sum())} scans in which one covers both its "
            "neighbours; it does before or after"
        )
        number = int(work.order[strip])
        if moved:
            numbers = {"scans": float(gap.sum()), "from_s": begin, "to_s": end}
            findings.append(Finding("intermittent", (number,), evidence, numbers))
        elif amid:
            asked.append(Question((number,), ("intermittent",), evidence))
        work.there[gap, strip] = True
    gaps = over & ~work.there
    count, named = gaps.sum(axis=0), [strip for strip, *_ in found]
    for strip in np.flatnonzero(count >= np.maximum(_FEWEST, _OTHERS * np.sort(count)[-1 - _MOST])).tolist():
        gap, read = gaps[:, strip], over[:, strip] & work.there[:, strip]
        share = count[strip] / over[:, strip].sum()
        if strip in named or share > _OFTEN or read.sum() < _FEWEST or _cut(work, heights, strip, gap, read):
            continue
        if moved_across((right - left)[gap, strip]):
            evidence = (
                f"reads no contact in {count[strip]} scans, {100 * share:.2g} % of those in which one covers both its "
                "neighbours, and moves across them; other strips hardly ever do"
            )
            numbers = {"scans": float(count[strip]), "share": float(share)}
            findings.append(Finding("intermittent", (int(work.order[strip]),), evidence, numbers))
            work.there[gap, strip] = True
    return findings, asked


def _cut(work: WorkingCopy, heights: list[FloatArray], strip: int, gap: BoolArray, read: BoolArray) -> bool:
    """Whether a strip may be cut: then of two channels one is never right, and a single one is not on one side."""
    if len(heights) == 1:
        return not mixed_heights(heights[0][gap, strip], heights[0][read, strip])
    off = [
        values[read, strip] - line[read, strip] for values, line in zip(work.k.values(), heights, strict=True)
    ]
    return float(np.mean(np.abs(off).max(axis=0) < _ONE_CONTACT)) < 1.0 - _SOUND


def _heights(work: WorkingCopy) -> list[FloatArray]:
    """Return what a strip's neighbours read on average, by signature (scans, strips)."""
    every = [
        np.pad(np.where(work.there, values, np.nan), ((0, 0), (1, 1)), constant_values=np.nan)
        for values in work.k.values()
    ]
    return [0.5 * (level[:, :-2] + level[:, 2:]) for level in every]


def _should_read(work: WorkingCopy) -> BoolArray:
    """Return where one contact covers both neighbours of a strip, far from the level of rest (scans, strips)."""
    padded = np.pad(work.there, ((0, 0), (1, 1)))
    between = padded[:, :-2] & padded[:, 2:]
    rest = (work.sensor.rest_volt or 0.0) / work.sensor.vref_volt
    touch = (work.sensor.touch_volt or 0.0) / work.sensor.vref_volt
    alike, far = np.ones_like(between), np.zeros_like(between)
    for values in work.k.values():
        level = np.pad(np.where(work.there, values - rest, np.nan), ((0, 0), (1, 1)), constant_values=np.nan)
        a, b = level[:, :-2], level[:, 2:]
        with np.errstate(invalid="ignore"):
            alike &= np.abs(a - b) < _ONE_CONTACT
            far |= (a * b > 0.0) & (np.minimum(np.abs(a), np.abs(b)) > _FAR_FROM_REST * touch + _BENT)
    return np.asarray(between & alike & (far if work.sensor.rest_volt is not None else True))


def _longest_silence(over: BoolArray, there: BoolArray) -> slice:
    """Return the scans (scans,) without a touch of the strip in which most contacts pass over it."""
    edges = np.concatenate([[-1], np.flatnonzero(there), [len(there)]])
    passed = np.concatenate([[0], np.cumsum(over)])
    count = passed[edges[1:]] - passed[edges[:-1] + 1]
    at = int(np.argmax(count))
    return slice(int(edges[at]) + 1, int(edges[at + 1]))
