"""Contacts that come and go: a channel that drops out while its neighbours stay under the same contact."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.diagnose.faults import Finding, Question
from tacstrip.diagnose.neighbour_prediction import (
    WorkingCopy,
    moved_across,
    predict_from_neighbours,
    strips_on_both_sides,
)
from tacstrip.diagnose.regression import passes

# Over Vref: a reading this far off its neighbours' line, at the level of a free wire, dropped out.
_FAR = 0.12
# Over Vref: a free wire's level is its rail's or the rest level, but for the channel's own offset.
_FREE = 0.04
_STILL = 0.05  # over Vref: what the neighbours may change while a reading jumps by more than _FAR
# To and fro, beside neighbours that stay; to or from untouched, as at a contact's rim.
_JUMPS, _JUMPS_SILENT = 3, 8
_FEWEST = 5  # scans that dropped out
_CLEAR, _MANY_CLEAR = 0.3, 8  # over Vref off the line, and scans, in which the contact moves:
_MOVES = 0.03  # over Vref
_PASSES_BY = 0.1  # over Vref: what neighbours move by beside a free wire's level
_MOST_ALONE = 8  # scans that a pointed contact touches one strip at its end
_ONE_WAY = 0.6  # of readings off the line, by which those to one side are more than those to the other
_LEAST, _MOST = 0.025, 0.7  # of the scans in which a dropout could be seen
_SHARE_CUT, _VISITS = 0.15, 2  # of these, on one side of a height, and times that contacts came: cut or loose
_OTHERS = 4.0  # times as many jumps as the third-worst strip: a contact's shape does the same to several
_LASTING = 0.98  # of a strip's readings on one rail: it is open at an end, and does not come and go
_FEW_OUT = 8  # scans on one rail, as those of a cut strip are
_MOST_ASKED = 2  # strips: more is no joint of a strip
_CUT_OR_LOOSE = ("open-strip", "intermittent")
_CUT = 0.12  # a cut strip drops out at some heights, which are all above or all below the others


def intermittent(work: WorkingCopy) -> tuple[list[Finding], list[Question]]:
    """Find channels that drop out and come back; what they read meanwhile is discarded from the working copy.

    Parameters
    ----------
    work
        A row for each scan.

    Returns
    -------
    findings, questions
        The latter of strips that did so once or twice, or under a contact that hardly moves across: there two
        objects may lie side by side, and the strip between them be touched by one or the other, and by neither.
    """
    jumps, away = _jumps(work)
    left, right = strips_on_both_sides(work.there)
    amid = away.any(axis=0) & (left > 0) & (right > 0)
    lines = [work.prediction(name)[0] for name in work.k]
    lasting = _never_good(work)
    jumps[:, lasting] = 0
    told = list(_often(work, lasting))
    findings = [f for f, causes in told if not causes]
    named = {i for f, causes in told if causes != _CUT_OR_LOOSE for i in f.strips}
    asked = [Question(f.strips, causes, f.evidence) for f, causes in told if causes]
    often = (jumps >= _JUMPS).any(axis=0) & ~np.isin(work.order, list(named))
    if often.sum() > _MOST_ASKED:  # a finger that hardly touches comes and goes on many strips
        jumps[:, often] = 0
    for strip in np.flatnonzero(jumps.any(axis=0)).tolist():
        if (number := int(work.order[strip])) in named or not _anywhere(work, lines, away, strip):
            continue
        count, gaps = int(jumps[:, strip].max()), int(away[:, :, strip].any(axis=0).sum())
        evidence = (
            f"goes from a reading that fits its neighbours to that of a free wire or back, {count} times from one "
            "scan to the next, while they stay"
        )
        if count >= _JUMPS:
            numbers = {"scans": float(gaps), "jumps": float(count)}
            findings.append(Finding("intermittent", (number,), evidence, numbers))
            for values, out in zip(work.k.values(), away, strict=True):
                values[out[:, strip], strip] = np.nan
        else:
            asked.append(Question((number,), ("intermittent",), evidence))
    place = np.argsort(work.order)
    still = [
        f for f in findings
        if (rows := amid[:, i := place[f.strips[0]]]).any() and not moved_across((right - left)[rows, i])
    ]  # fmt: skip
    asked += [Question(f.strips, ("intermittent",), f.evidence) for f in still]
    loose = {f.strips for f in findings} | {q.strips for q in asked if q.causes != _CUT_OR_LOOSE}
    asked = [q for q in asked if q.causes != _CUT_OR_LOOSE or q.strips not in loose]
    known = {i for f in findings for i in f.strips} | {i for q in asked for i in q.strips}
    asked += [q for q in _free_wires(work, lasting) if not known & set(q.strips)]
    return [f for f in findings if f not in still], asked if len(asked) <= _MOST_ASKED else []


def _anywhere(work: WorkingCopy, lines: list[FloatArray], away: BoolArray, strip: int) -> bool:
    """Whether a strip drops out at heights at which it reads well, too: a cut one does so on one side of the cut."""
    sides = np.pad(work.there, ((0, 0), (1, 1)))
    under = work.there[:, strip] | (sides[:, strip] & sides[:, strip + 2])
    rest = (work.sensor.rest_volt or 0.0) / work.sensor.vref_volt
    for line, gone, values in zip(lines, away[:, :, strip], work.k.values(), strict=True):
        out, good = gone & under, line[~gone, strip]
        line, high = line[:, strip], np.where(work.there[:, strip], values[:, strip], rest) >= 0.5
        below, above = line[out & ~high & (line > _FAR)], line[out & high & (line < 1.0 - _FAR)]
        if min(len(below), len(above)) >= _JUMPS and np.quantile(below, 0.9) < np.quantile(above, 0.1):
            return False  # on ground below the cut, on Vref above it
        for side in (out & high & (line < 1.0 - _CLEAR), out & ~high & (line > _CLEAR)):
            if np.isfinite(line[side]).sum() >= _FEW_OUT and not mixed_heights(line[side], good):
                return False
    return True


def _jumps(work: WorkingCopy) -> tuple[IntArray, BoolArray]:
    """Count from scan to scan how often a channel goes from a good reading to a free wire's level, or comes back.

    Before and after, the neighbours are under the same contact and stay where they are, far from that level. On the
    rim of a contact there is one neighbour: then both channels must be on one level, which no other contact does.

    Returns
    -------
    jumps, away
        By signature and strip; where a channel is at a free wire's level or untouched (signatures, scans, strips).
    """
    rest = (work.sensor.rest_volt or 0.0) / work.sensor.vref_volt
    near = max(_FREE, 5.0 * work.sigma)
    values = np.stack(list(work.k.values()))  # (signatures, scans, strips)
    level = np.full(values.shape, rest)
    for rail in (0.0, 1.0, rest):
        level = np.where(np.abs(values - rail) < near, rail, level)
    away = ~(work.there & (np.abs(values - level) >= near))
    same = (
        work.there & (away & (level == level[0])).all(axis=0)
        if len(values) > 1
        else np.zeros(work.there.shape, bool)
    )
    # A contact's rim, where it comes and goes, leaves the level of rest.
    same &= (np.abs(values - rest) >= near).all(axis=0)
    lasts = away.copy()  # not a stray
    lasts[:, 1:-1] &= away[:, 2:] | away[:, :-2]
    solid = away & (same | lasts)
    sides = np.pad(np.where(work.there, values, np.nan), ((0, 0), (0, 0), (1, 1)), constant_values=np.nan)
    sound = work.there & ~away
    jumps = np.zeros((len(values), work.strips), int)
    for gone, good in ((1, 0), (0, 1)):  # of two scans
        at = np.s_[:, gone : len(sound[0]) - good], np.s_[:, good : len(sound[0]) - gone]
        channel, scan, strip = np.nonzero(solid[at[0]] & sound[at[1]])
        out, back = scan + gone, scan + good
        # What both neighbours read (sides, jumps).
        then, now = (sides[channel, t, np.stack([strip, strip + 2])] for t in (out, back))
        free, own = level[channel, out, strip], values[channel, back, strip]
        off = (np.abs(then - now) > _STILL) | (np.abs(then - free) < _CLEAR)
        off |= (np.abs(now - own) > _FAR) | (np.abs(own - free) < _CLEAR)
        known = np.isfinite(then) & np.isfinite(now)
        rim = same[out, strip] & sound[:, back, strip].all(axis=0)
        seen = (known.all(axis=0) | (known.any(axis=0) & rim)) & ~(off & known).any(axis=0)
        np.add.at(jumps, (channel[seen], strip[seen]), 1)
    return jumps, away


def _never_good(work: WorkingCopy) -> BoolArray:
    """Return which strips (strips,) do not come and go: on one rail wherever touched, or touched where nothing is."""
    near = max(_FREE, 5.0 * work.sigma)
    on_rail = np.ones((2, work.strips), bool)
    for values in work.k.values():
        known = np.isfinite(values)
        for side, rail in enumerate((0.0, 1.0)):
            at = (known & (np.abs(values - rail) < near)).sum(axis=0)
            on_rail[side] &= at > _LASTING * np.maximum(known.sum(axis=0), 1)
    return np.asarray(on_rail.any(axis=0) | work.touched_without_contact())


def _often(work: WorkingCopy, lasting: BoolArray) -> Iterator[tuple[Finding, tuple[str, ...]]]:
    """Yield channels that drop out in many scans, and what else they may be; strips that are `lasting` do not."""
    gone = _gaps(work)
    found = {name: _ways_out(work, name, gone) for name in work.k}
    for strip in np.flatnonzero(~lasting).tolist():
        channels = [
            (name, *max(seen, key=lambda told: (not told[4], told[1])))
            for name, ways in found.items()
            if (seen := [(*told, w.out) for w in ways if (told := w.dropouts(work.k[name], gone, strip))])
        ]
        if not channels:
            continue
        channels = [c for c in channels if not c[5]] or channels
        certain = any(certain for *_, certain, _, _ in channels)
        causes = _CUT_OR_LOOSE if channels[0][5] else ("intermittent",) * (not certain)
        name, share, gaps, count, *_ = max(channels, key=lambda c: c[1])
        evidence = (
            f"drops out in {gaps} scans, {100 * share:.2g} % of those in which its neighbours stay under the contact, "
            f"and comes and goes {count} times"
        )
        numbers = {"share": share, "scans": float(gaps), "jumps": float(count)}
        signature = name if len(channels) == 1 and len(work.k) == 2 else None
        finding = Finding("intermittent", (int(work.order[strip]),), evidence, numbers, signature)
        yield finding, causes
        if causes == _CUT_OR_LOOSE:  # which is told by what it reads there
            continue
        for channel, *_, out in channels:
            work.k[channel][out[:, strip], strip] = np.nan
        work.there[gone[:, strip], strip] = True


def _ways_out(work: WorkingCopy, name: str, gone: BoolArray) -> list[_Seen]:
    """Return where a signature's channels may have dropped out, by three signs of it, the surest first.

    A reading of a free wire far off the neighbours' line; none, too, where the neighbours stay; and one off that line
    towards one rail. `gone`: where a strip counts as untouched between others (scans, strips).
    """
    values = work.k[name]
    rest = (work.sensor.rest_volt or 0.0) / work.sensor.vref_volt
    touch = (
        (work.sensor.touch_volt or 0.0) / work.sensor.vref_volt
        if work.sensor.rest_volt is not None
        else -np.inf
    )
    near = max(_FREE, 5.0 * work.sigma)
    e, both, gap = work.prediction(name)
    inner = both & (gap < 0.3)
    steady = inner.copy()
    steady[:, [0, -1]] = (np.isfinite(e) & (gap < 0.3))[:, [0, -1]]
    free = np.any([np.abs(values - level) < near for level in {0.0, rest, 1.0}], axis=0)
    with np.errstate(invalid="ignore"):
        # Beside a contact's rim, noise of a strip that rests makes it count as touched.
        noisy = np.abs(values - rest) < touch + 4.0 * work.sigma
        free[:, [0, -1]] &= ~noisy[:, [0, -1]]
        # A contact over a strip's end reads its rail, however steep the line.
        out = steady & free & (np.abs(values - np.clip(e, 0.0, 1.0)) > _FAR)
        good = steady & (np.abs(values - e) < _FAR / 2.0)
        clear = out & (np.abs(values - e) > _CLEAR)
    off_line = _Seen(out, good, e, clear, np.zeros_like(out))
    # A strip that counts as untouched has no reading; its neighbours' line spans the gap.
    silent = gone | (work.there & np.isnan(values) & np.isfinite(values).any(axis=0))
    if silent.any():
        spanned, both, gap = predict_from_neighbours(values, work.there | gone)
        e = np.where(silent, spanned, e)
        silent = silent & both & (gap < 0.3)
    if work.sensor.rest_volt is not None:
        # A contact may read as rest does; beside strips that rest, a free wire has its own level instead.
        silent &= np.abs(e - rest) > 2.0 * touch
        alone, rails = _alone(work.there), np.minimum(np.abs(values), np.abs(values - 1.0)) < near
        lone = alone & work.there & rails
        often = lone.sum(axis=0) > _MOST_ALONE
        silent |= lone & often
        good = good | (alone & ~work.there & often)
        e = np.where(alone, 0.0, e)
    # A bad joint has any resistance: readings leave the line towards one rail.
    with np.errstate(invalid="ignore"):
        off = steady & (np.abs(values - np.clip(e, 0.0, 1.0)) > _FAR)
        # Outermost strips are at a contact's rim: its shape does the same to others that are.
        for strip, turned in ((0, np.s_[:, :]), (-1, np.s_[:, ::-1])):
            share = off[:, strip].sum() / max(int(steady[:, strip].sum()), 1)
            off[:, strip] &= _OTHERS * _off_at_rims(values[turned], work.there[turned]) < share
        above = off & (values > e)
        one_way = np.abs(2 * above.sum(axis=0) - off.sum(axis=0)) >= _ONE_WAY * off.sum(axis=0)
    partly = silent | (off & one_way)
    nowhere = np.zeros_like(out)
    return [
        off_line,
        _Seen(out | silent, good, e, nowhere, silent),
        _Seen(out | partly, good, e, nowhere, partly),
    ]


def _off_at_rims(values: FloatArray, there: BoolArray) -> float:
    """Return in which share of a contact's left rims, but at the sensor's edge, its first strip is off the next two."""
    first, second, third = values[:, 1:-2], values[:, 2:-1], values[:, 3:]
    rim = there[:, 1:-2] & ~there[:, :-3] & (np.abs(second - third) < 0.3) & np.isfinite(first)
    off = rim & (np.abs(first - np.clip(2.0 * second - third, 0.0, 1.0)) > _FAR)
    return float(off.sum() / rim.sum()) if rim.sum() >= _FEWEST else 0.0


def _free_wires(work: WorkingCopy, lasting: BoolArray) -> Iterator[Question]:
    """Yield questions of strips that now and then read a free wire's level, far from neighbours that move by it.

    The neighbours may be on one side. No shape of one contact does so: what hangs over the sensor's end on one strip
    alone stays on its rail where neighbours do.
    """
    rest = (work.sensor.rest_volt or 0.0) / work.sensor.vref_volt
    touch = (work.sensor.touch_volt or 0.0) / work.sensor.vref_volt
    near = max(_FREE, 5.0 * work.sigma)
    asked = set[int]()
    with np.errstate(invalid="ignore"):
        at_rest = np.all([np.abs(v - rest) < touch + 4.0 * work.sigma for v in work.k.values()], axis=0)
        at_rest &= work.sensor.rest_volt is not None
    for name, values in work.k.items():
        e, _, gap = work.prediction(name)
        with np.errstate(invalid="ignore"):
            beside = (gap < 0.3) & ~at_rest
            free = np.any([np.abs(values - level) < near for level in {0.0, rest, 1.0}], axis=0)
            out = beside & free & (np.abs(values - np.clip(e, 0.0, 1.0)) > _CLEAR)
            good = beside & (np.abs(values - e) < _FAR / 2.0)
        count, well = out.sum(axis=0), good.sum(axis=0)
        usual = np.sort(count)[-3] if work.strips > 2 else 0
        often = (np.minimum(count, well) >= _FEWEST) & (count > _OTHERS * usual) & ~lasting
        for strip in np.flatnonzero(often).tolist():
            line = e[out[:, strip], strip]
            if strip in asked or np.ptp(line) < _PASSES_BY:
                continue
            asked.add(strip)
            mixed = mixed_heights(line, e[good[:, strip], strip])
            evidence = (
                f"reads what a free wire does in {count[strip]} scans, beside neighbours that move by "
                f"{100 * float(np.ptp(line)):.2g} % of Vref, and what they expect in {well[strip]}"
            )
            yield Question((int(work.order[strip]),), ("intermittent",) if mixed else _CUT_OR_LOOSE, evidence)


@dataclass(frozen=True, eq=False)
class _Seen:
    """Where a signature's channels drop out, where they read well, and what their neighbours expect (scans, strips).

    `clear`: dropouts that no contact's shape explains, between two neighbours that it leaves where they are; `silent`:
    those from touched to untouched or back.
    """

    out: BoolArray
    good: BoolArray
    expected: FloatArray
    clear: BoolArray
    silent: BoolArray

    @cached_property
    def jumps(self) -> FloatArray:
        """How often each channel drops out or comes back from one scan to the next while its neighbours stay."""
        with np.errstate(invalid="ignore"):
            same = np.abs(np.diff(self.expected, axis=0)) < _STILL
        out, good = self.out, self.good
        return np.asarray((same & ((out[1:] & good[:-1]) | (good[1:] & out[:-1]))).sum(axis=0))

    def dropouts(
        self, values: FloatArray, gone: BoolArray, strip: int
    ) -> tuple[float, int, int, bool, bool] | None:
        """Return the share of dropouts, in how many scans, the jumps of a loose channel, and whether they are many.

        And whether they all are on one side of a height, as those of a cut strip. None of a sound channel.
        """
        out, good, read = self.out[:, strip], self.good[:, strip], values[:, strip]
        gaps, under = int(out.sum()), int((good & np.isfinite(read)).sum())
        share = gaps / max(gaps + int(good.sum()), 1)
        usual = np.sort(self.jumps)[-4] if len(self.jumps) > 4 else 0.0
        least = _JUMPS_SILENT if (out & self.silent[:, strip]).sum() > 0.5 * gaps else _JUMPS
        clear = self.expected[self.clear[:, strip], strip]  # rare jumps: one or two passes over a strip
        many = self.jumps[strip] >= max(least, _OTHERS * usual + 1)
        if (
            min(under, gaps) < _FEWEST
            or not (many or len(clear) >= _MANY_CLEAR)
            or not _LEAST < share < _MOST
        ):
            return None
        inside = 0 < strip < self.out.shape[1] - 1  # an outermost strip has neighbours on one side
        many |= inside and len(clear) >= _MANY_CLEAR and np.ptp(clear) >= _MOVES
        read, line = np.where(gone[:, strip], np.nan, read), self.expected[:, strip]
        # Where the neighbours read as a free wire does, good readings prove nothing.
        levels = (read < 0.5, line > _FAR), (read >= 0.5, line < 1.0 - _FAR), (np.isnan(read), line > -1.0)
        mixed = [
            mixed_heights(line[out & side], line[good & apart])
            for side, apart in levels if (out & side).sum() >= _FEWEST
        ]  # fmt: skip
        cut = not (mixed and all(mixed))
        if cut and (
            not inside or share < _SHARE_CUT or passes(np.flatnonzero(self.clear[:, strip])) < _VISITS
        ):
            return None
        return share, gaps, int(self.jumps[strip]), bool(many), cut


def _gaps(work: WorkingCopy) -> BoolArray:
    """Return where a strip counts as untouched between two touched ones on either side (scans, strips).

    Nearer to a contact's rim, it may be its shape, or strips in the wrong order.
    """
    there = work.there
    gap = np.zeros_like(there)
    gap[:, 2:-2] = ~there[:, 2:-2] & there[:, :-4] & there[:, 1:-3] & there[:, 3:-1] & there[:, 4:]
    return gap


def _alone(there: BoolArray) -> BoolArray:
    """Return where both neighbours of a strip are untouched (scans, strips).

    Nowhere at the edge: a contact that hangs over it touches the outermost strip by itself.
    """
    padded = np.pad(there, ((0, 0), (1, 1)), constant_values=True)
    return np.asarray(~padded[:, :-2] & ~padded[:, 2:])


def mixed_heights(out: FloatArray, good: FloatArray) -> bool:
    """Whether dropouts come at the same heights as good readings do."""
    out, good = np.sort(out[np.isfinite(out)]), np.sort(good[np.isfinite(good)])
    if not len(out) or not len(good):
        return False
    below = float(np.searchsorted(good, out).mean()) / len(good)
    return _CUT < below < 1.0 - _CUT or float(np.ptp(np.concatenate([out, good]))) < 0.1
