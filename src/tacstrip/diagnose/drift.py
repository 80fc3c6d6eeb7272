"""Drift and slow wander: a strip's readings that change with time, not with the contact or the other strips."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Set
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import median_filter
from scipy.special import fdtrc, ndtri, stdtr  # scipy.stats takes half a second to import

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.diagnose.bend_model import BendModel, Explanation
from tacstrip.diagnose.faults import Finding, Question
from tacstrip.diagnose.log import Log
from tacstrip.diagnose.neighbour_prediction import WorkingCopy
from tacstrip.diagnose.rigid_contact import RigidContact, readings_joined

# Over Vref, from start to end, and as a standard deviation: less is not reported.
_DRIFT, _WANDER = 0.006, 0.004
_TIMES = 4.0  # times what the other strips do
_LASTS = 0.6  # of the mean square of independent levels' changes
_STRAIGHT = 0.7  # of the changes' variance in a line: more is drift
_BLOCKS, _RESTS = 32, 4  # of time at rest, and untouched readings in one
_VISIT = 5  # blocks
_NEAR = 2  # strips to either side that a contact at the ground end covers too
_LOOKS, _SPAN = 7, 0.6  # blocks, and the part of the recording that they span
_MEDIAN = 1.25  # times the standard deviation of a mean of normal errors: that of their median
_JUMP = 0.01  # over Vref: an untouched reading that far from its strip's usual one is a contact that reads as rest
_BEYOND_NOISE = 5.0  # standard deviations that noise gives a change: one of 100 strips has 3 by chance
_RESTLESS = 3.0  # times the other strips' changes from scan to scan: contacts that read as rest come and go
_STEPS, _STEP_NOISE = 4, 8.0  # scans beside a jump, twice; times the median change
_TERMS = 8  # functions of time: a line, and cosines of 1 to 4 periods
_USUAL = 0.02  # over Vref: prior standard deviation of each
_FEWEST, _FEWEST_STRIPS = 24, 5  # bends of a strip; strips with so many
_PAUSE, _STEP = 2, 0.12  # rows between two looks at a strip, and over Vref, how far its contact moves in one
_LOOKS_BESIDE, _MOST_IN_LOOK = 9, 6  # looks, and rows of one that count
_LEAST_CHANCE = float(np.exp(-700.0))  # that a float can hold, nearly
_CONSTANT = 3  # numbers of a strip's constant error
# A change stands out if it explains so much more than the next strip's does, and is certain (standard deviations).
# That is held against chance on any of some 20 strips and three signals: below 1 in 10,000. Less is a question.
_GAIN, _OUTSTANDING, _CLEARLY, _SIZE = 140.0, 2.1, 2.6, 0.0035
_GAIN_OF_LINE, _OUTSTANDING_LINE, _CERTAIN = 60.0, 3.0, 4.0
_GAIN_ASKED, _OUTSTANDING_ASKED, _CERTAIN_ASKED = 100.0, 1.4, 2.4
_GAIN_FAR_OUT, _FAR_OUT = 60.0, 3.0  # asked, whatever looks say: they are few
_GAIN_OF_LINE_ASKED, _OUTSTANDING_LINE_ASKED, _CERTAIN_OF_LINE_ASKED = 50.0, 2.5, 1.0
# Against one rigid outline under all strips, which holds the shape: what of it is left is far less than of bends.
_QUARTERS = 4  # of the recording
_BEYOND, _BEYOND_LINE = (100.0, 2.6, 0.005), (50.0, 3.5, 0.006)  # gain, times the next strip's, over Vref
_MOST_SEEN = 0.5  # of the strips: parts that no contact joins are outlines of their own
_FEWEST_BESIDE = 8  # readings of a strip that may have done what is seen of another
_BEYOND_ASKED, _BEYOND_LINE_ASKED = (80.0, 1.8, 0.005), (30.0, 2.4, 0.006)
_LINE = (0.35, 0.6)  # of a change's gain that a line explains: less is wander, more drift
_MOST_FOUND, _MOST_ASKED = 4, 2  # strips
_MIDDLE = (np.arange(_BLOCKS) + 0.5) / _BLOCKS


@dataclass(frozen=True)
class _Change:
    """What one strip does with time, relative to its neighbours.

    place: of the strip across. change: from start to end, size: standard deviation, over Vref. gain, gain_of_line: the
    misfit that it explains, in variances of a bend, and what a line explains of it. others, others_of_line: the most
    of another strip's. certain, certain_of_line: how unlikely its looks are to be chance, in standard deviations.
    """

    place: int
    change: float
    size: float
    gain: float
    others: float
    certain: float
    gain_of_line: float
    others_of_line: float
    certain_of_line: float
    looks: int


@dataclass(frozen=True, eq=False)
class Drifts:
    """What strips do with time.

    Attributes
    ----------
    findings, questions, notes
        Drift and wander of single strips; of those that move a little against their neighbours under a contact, as its
        shape may make them; drift of all together.
    least
        The least drift of each strip (strips,) that would be told, over Vref; infinite where none could be looked for.
    settled
        Strips whose verdict stands, or was doubted, without any quarter of the recording already.
    """

    findings: list[Finding]
    questions: list[Question]
    notes: list[Finding]
    least: FloatArray
    settled: frozenset[int] = frozenset()


def drift(log: Log, work: WorkingCopy, time_s: FloatArray, sought: Set[int] = frozenset()) -> Drifts:
    """Find strips that drift or wander against the others: untouched, or relative to neighbours under one contact.

    Parameters
    ----------
    log
        Its untouched readings show the drift at rest.
    work, time_s
        Places, repaired, and when they were (places,) [s]; strips that drift are dropped from it.
    sought
        Strips, if not all: under contacts no others are looked for once these have a verdict, and none against one
        outline under all strips, which settles its verdicts by itself.
    """
    first, seconds = float(log.time_s.min()), float(np.ptp(log.time_s))
    if seconds <= 0.0:
        return Drifts([], [], [], np.full(log.sensor.strips, np.inf))
    level, common, rests, untouched, noise = _levels_at_rest(log, work.order, (log.time_s - first) / seconds)
    checked = np.isfinite(level).sum(axis=0) >= _LOOKS
    least = np.where(checked, _DRIFT, np.inf)
    for i in np.flatnonzero(checked).tolist():
        least[i] = max(_DRIFT, _BEYOND_NOISE * _slope_sigma(level[:, i], noise[:, i]))
    found = [
        f
        for f in _outstanding_at_rest(level, untouched, noise, work.order)
        if f.fault == "drift" or not _steps(rests, int(np.flatnonzero(work.order == f.strips[0])[0]))
    ]
    notes = []
    if np.isfinite(common) and abs(common) > 2.0 * _DRIFT:
        evidence = f"untouched strips moved together by {100 * common:+.2g} % of Vref from start to end"
        notes.append(Finding("common-drift", (), evidence, {"change": common}))
    if not log.sensor.kind.closed_form:  # a sheet's strips shift each other
        return Drifts(found, [], notes, least)
    for finding in found:
        work.drop(int(np.flatnonzero(work.order == finding.strips[0])[0]))
    asked: list[Question] = []
    settled: set[int] = set()
    tau = (time_s - first) / seconds
    outline = not (sought or checked[log.touched.any(axis=0)].all())
    for _ in range(_MOST_FOUND):
        if sought and sought <= {i for some in (found, asked) for verdict in some for i in verdict.strips}:
            break
        # What bends show of a strip may be the contact's shape, which an outline knows.
        seen = _against_outline(work, tau) if outline else None
        outline = seen is not None
        place, verdict, shown = seen or _against_neighbours(work, tau)
        least[work.order] = np.minimum(least[work.order], shown)
        if verdict is None:
            break
        (found if isinstance(verdict, Finding) else asked).append(verdict)  # type: ignore[arg-type]
        if outline:  # one fit, and the strip that stands out most
            settled.update(verdict.strips)
            break
        work.drop(place)
    return Drifts(found, asked if len(asked) <= _MOST_ASKED else [], notes, least, frozenset(settled))


def _judged(one: _Change, strip: int) -> Finding | Question | None:
    """Return the verdict on the change that explains most, a question where it may be the contact's shape, or None."""
    stands_out = one.gain > max(_GAIN, _OUTSTANDING * one.others) and one.size > _SIZE
    in_line = one.gain_of_line > max(_GAIN_OF_LINE, _OUTSTANDING_LINE * one.others_of_line)
    in_line &= one.certain_of_line > _CERTAIN and abs(one.change) > _DRIFT
    perhaps = one.gain > max(_GAIN_ASKED, _OUTSTANDING_ASKED * one.others)
    perhaps &= max(one.certain, one.certain_of_line) > _CERTAIN_ASKED
    perhaps |= one.gain > max(_GAIN_FAR_OUT, _FAR_OUT * one.others)
    perhaps &= one.size > _SIZE
    line = one.gain_of_line > max(_GAIN_OF_LINE_ASKED, _OUTSTANDING_LINE_ASKED * one.others_of_line)
    perhaps |= line and one.certain_of_line > _CERTAIN_OF_LINE_ASKED and abs(one.change) > _DRIFT
    clear = stands_out and one.gain > _CLEARLY * one.others and one.certain > _CERTAIN
    straight = one.gain_of_line / max(one.gain, 1e-9)
    drifted = f"moved by {100 * one.change:+.2g} % of Vref from start to end, relative to its neighbours"
    wandered = (
        f"wanders by +-{100 * one.size:.2g} % of Vref relative to its neighbours, over {one.looks} looks"
    )
    if in_line or (clear and straight > _LINE[1]):
        return Finding("drift", (strip,), drifted, {"change": one.change})
    if clear and straight < _LINE[0]:
        return Finding("wander", (strip,), wandered, {"wander": one.size})
    if not (stands_out or perhaps):
        return None
    return Question((strip,), ("drift", "wander") if line else ("wander", "drift"), wandered)


def _levels_at_rest(
    log: Log, order: IntArray, tau: FloatArray
) -> tuple[FloatArray, float, list[FloatArray], FloatArray, FloatArray]:
    """Return untouched levels over time less those of the other strips (blocks, strips), and the change these share.

    Then, by channel, the untouched readings of the strips across (scans, strips) that were used, and the levels of
    all untouched readings, used or not (channels, blocks, strips); and the standard deviations that noise gives the
    former levels (blocks, strips).

    Of two channels, their mean. A contact at the ground end can pass for none: next to a touched strip, and where a
    neighbour's untouched reading is far from its usual one, nothing counts.
    """
    strips = log.sensor.strips
    levels, shared, scatters, rests, untouched = [], [], [], [], []
    fewest = np.full((_BLOCKS, strips), np.inf)  # readings of a level
    block = np.minimum((tau * _BLOCKS).astype(int), _BLOCKS - 1)
    edges = np.searchsorted(block, np.arange(_BLOCKS + 1)) if (np.diff(block) >= 0).all() else None
    touched = log.touched[:, order]
    near = _beside(touched) | touched
    for values in log.raw.values():
        rest = np.where(touched, np.nan, values[:, order])
        every, _ = _block_medians(rest, block, edges)
        every -= _columns(np.nanmean, every)
        untouched.append(every - _columns(np.nanmedian, every.T)[:, None])
        moved = rest - _columns(np.nanmedian, rest)
        away = np.abs(moved - _columns(np.nanmedian, moved.T)[:, None]) > _JUMP
        rest = np.where(near | _beside(away), np.nan, rest)
        rests.append(rest)
        scatters.append(_columns(np.nanstd, np.diff(rest, axis=0)))
        level, counts = _block_medians(rest, block, edges)
        fewest = np.minimum(fewest, counts)
        level -= _columns(np.nanmean, level)
        many = np.isfinite(level).sum(axis=1) >= 3
        center = np.where(many, _columns(np.nanmedian, level.T), np.nan)
        if many.sum() >= _BLOCKS // 2:
            shared.append(float(np.polyfit(_MIDDLE[many], center[many], 1)[0]))
        levels.append(level - np.where(many, center, 0.0)[:, None])
    own = _columns(np.nanmean, np.stack(levels).reshape(len(levels), -1)).reshape(_BLOCKS, strips)
    scatter = np.fmax.reduce(scatters)
    out, noise = np.full_like(own, np.nan), np.full_like(own, np.nan)
    noise[:, order] = _MEDIAN * scatter / np.sqrt(2.0 * fewest)
    for place in (
        np.flatnonzero(~(scatter > _RESTLESS * np.nanmedian(scatter))) if np.isfinite(scatter).any() else []
    ):
        # A stray block is not a change.
        there = np.flatnonzero(np.isfinite(own[:, place]))
        if len(there) >= _LOOKS and np.ptp(_MIDDLE[there[1:-1]]) >= _SPAN:
            out[:, order[place]] = _without_strays(own[:, place])
    return out, float(np.median(shared)) if shared else np.nan, rests, np.stack(untouched), noise


def _without_strays(level: FloatArray) -> FloatArray:
    """Return levels (blocks,) as medians of three that follow each other, NaN at both ends."""
    out, there = np.full_like(level, np.nan), np.flatnonzero(np.isfinite(level))
    out[there[1:-1]] = median_filter(level[there], 3, mode="constant")[1:-1]
    return out


def _block_medians(
    rest: FloatArray, block: IntArray, edges: IntArray | None
) -> tuple[FloatArray, FloatArray]:
    """Return the medians (blocks, strips) of readings (scans, strips) in blocks of time, NaN where there are few.

    And of how many readings they are, 1 at least.
    """
    level, counts = np.full((_BLOCKS, rest.shape[1]), np.nan), np.ones((_BLOCKS, rest.shape[1]))
    for b in range(_BLOCKS):
        part = rest[block == b] if edges is None else rest[edges[b] : edges[b + 1]]
        counts[b] = np.maximum(np.isfinite(part).sum(axis=0), 1)
        enough = counts[b] >= _RESTS
        if enough.any():
            level[b, enough] = np.nanmedian(part[:, enough], axis=0)
    return level, counts


def _columns(statistic: Callable[..., FloatArray], values: FloatArray) -> FloatArray:
    """Return a statistic of each column that has numbers, NaN of the others (columns,)."""
    out = np.full(values.shape[1], np.nan)
    some = np.isfinite(values).any(axis=0)
    if some.any():
        out[some] = statistic(values[:, some], axis=0)
    return out


def _outstanding_at_rest(
    level: FloatArray, every: FloatArray, noise: FloatArray, order: IntArray
) -> Iterator[Finding]:
    """Yield what strips do at rest that others do not; levels and their noise (blocks, strips) by the file's strips.

    `every` (channels, blocks, strips): of the strips across, the levels of all their untouched readings, used or not.
    """
    known = np.flatnonzero(np.isfinite(level).sum(axis=0) >= _LOOKS - 2)
    if len(known) < 4:
        return
    size = np.array([np.nanstd(level[:, i]) for i in known])
    line = np.array([_line(level[:, i]) for i in known])  # (strips, 2): change, and its share of the variance
    for row, i in enumerate(known.tolist()):
        # A contact that reads as rest does shows on neighbours too.
        at = int(np.flatnonzero(order == i)[0])
        beside = [
            int(np.flatnonzero(known == j)[0])
            for j in order[max(at - 1, 0) : at + 2]
            if j != i and j in known
        ]
        others = np.delete(size, [row, *beside])
        # Where a contact reads as rest, the neighbours' levels move with the strip's: with its course without strays,
        # and, as a wander may be that contact's own course, with all that was read, too.
        near = [(v[:, at], v[:, j]) for v in every for j in _around(at, len(order))]
        shared = max((_goes_with(level[:, i], _without_strays(other)) for _, other in near), default=0.0)
        with_strays = max((_goes_with(own, other) for own, other in near), default=0.0)
        if len(others) < 2 or max(shared, 0.0, *size[beside]) > 0.5 * size[row]:
            continue
        # A line is held against others' lines: what blocks of time err by has little of one.
        usual, usual_line = (
            max(float(np.median(v)) * _TIMES, float(np.quantile(v, 0.9)) * _TIMES / 2.0)
            for v in (others, np.delete(np.abs(line[:, 0]), [row, *beside]))
        )
        change, straight = line[row]
        levels = float(np.isfinite(level[:, i]).sum())
        least = max(_DRIFT, usual_line, _BEYOND_NOISE * _slope_sigma(level[:, i], noise[:, i]))
        if straight > _STRAIGHT and abs(change) > least:
            evidence = f"moved by {100 * change:+.3g} % of Vref from start to end, untouched, the others by "
            evidence += f"{100 * float(np.median(np.abs(np.delete(line[:, 0], row)))):.2g} %"
            yield Finding("drift", (i,), evidence, {"change": float(change), "levels_at_rest": levels})
        elif (
            straight <= _STRAIGHT
            and size[row] > max(_WANDER, usual)
            and with_strays <= 0.5 * size[row]
            and _slow(level[:, i])
            and _lasting(level[:, i]) > usual
        ):
            evidence = f"wanders by +-{100 * size[row]:.2g} % of Vref, slowly, untouched, the others by "
            evidence += f"+-{100 * float(np.median(others)):.2g} %"
            yield Finding("wander", (i,), evidence, {"wander": float(size[row]), "levels_at_rest": levels})


def _around(at: int, strips: int) -> list[int]:
    """Return the places across that one contact covers with one at the ground end of this one."""
    return [j for j in range(max(at - _NEAR, 0), min(at + _NEAR + 1, strips)) if j != at]


def _goes_with(level: FloatArray, other: FloatArray) -> float:
    """Return the deviation of what another strip's levels (blocks,) have in common with these."""
    both = np.isfinite(level) & np.isfinite(other)
    if both.sum() < _LOOKS:
        return 0.0
    one, two = level[both] - level[both].mean(), other[both] - other[both].mean()
    return float(abs(one @ two) / np.sqrt(len(one) * max(float(one @ one), 1e-18)))


def _lasting(level: FloatArray) -> float:
    """Return the least deviation of a strip's levels (blocks,) without a visit: one contact that reads as rest."""
    return float(min(np.nanstd(np.delete(level, slice(b, b + _VISIT))) for b in range(_BLOCKS)))


def _slow(level: FloatArray) -> bool:
    """Whether levels (blocks,) change little from one to the next: von Neumann's ratio is 1 where they do not last."""
    return bool(np.nanmean(np.diff(level) ** 2) < _LASTS * 2.0 * np.nanvar(level))


def _steps(rests: list[FloatArray], place: int) -> bool:
    """Whether an untouched strip's level jumps: contacts that read as rest does come and go, and nothing wanders so."""
    for values in rests:
        three = np.median(sliding_window_view(values[:, place], 3), axis=1)  # past strays
        step = np.abs(three[3:] - three[:-3])
        step = step[np.isfinite(step)]
        if len(step) and np.count_nonzero(step > max(_JUMP, _STEP_NOISE * float(np.median(step)))) >= _STEPS:
            return True
    return False


def _line(level: FloatArray) -> tuple[float, float]:
    """Return the change of a strip's levels (blocks,) from start to end, and the share of their variance in a line."""
    there = np.isfinite(level)
    slope, start = np.polyfit(_MIDDLE[there], level[there], 1)
    left = level[there] - slope * _MIDDLE[there] - start
    return float(slope), 1.0 - float(np.var(left)) / max(float(np.var(level[there])), 1e-12)


def _slope_sigma(level: FloatArray, noise: FloatArray) -> float:
    """Return the standard deviation that noise gives the change of a strip's levels (blocks,) from start to end."""
    there = np.isfinite(level)
    apart = _MIDDLE[there] - _MIDDLE[there].mean()
    return float(np.sqrt(np.mean(noise[there] ** 2) / max(float(apart @ apart), 1e-12)))


def _beside(there: BoolArray) -> BoolArray:
    """Return which strips (rows, strips) are next to one of these."""
    near = np.zeros_like(there)
    near[:, 1:] |= there[:, :-1]
    near[:, :-1] |= there[:, 1:]
    return near


def _against_neighbours(
    work: WorkingCopy, tau: FloatArray
) -> tuple[int, Finding | Question | None, FloatArray]:
    """Return the verdict on what explains most of what bends do with time: its place, it, and the least drift told.

    That of each strip (strips,) over Vref.
    """
    time = _courses(tau)
    seen = np.zeros(work.strips, dtype=bool)
    signals = list(work.k.values())
    every: list[_Change] = []
    least = np.full(work.strips, np.inf)
    for values in (*signals, *([np.mean(signals, axis=0)] if len(signals) > 1 else [])):
        model = BendModel.fit(work, values, contact=True)
        if model is None:
            continue
        columns = model.rows.effect(time)
        found = model.explain(columns)
        power = found.power_of_groups(_TERMS)
        gain, line = (_gains(found, power, terms, model.sigma) for terms in (_TERMS, 1))
        shown = _shown_at(work.strips)
        seen |= (
            (np.diff(model.rows.edges) >= _FEWEST)
            & _spans(work.strips, model.rows.strip, tau[model.rows.place])
        )[shown]
        gain[~seen], line[~seen] = 0.0, 0.0
        least = np.minimum(least, _least(power, line, seen, model.sigma, (_GAIN_OF_LINE, _OUTSTANDING_LINE)))
        for by in {int(np.argmax(gain)), int(np.argmax(line))}:
            change = _looked_at(model, found, columns, by, tau, work)
            if change is None:
                continue
            others, others_line = (
                _others(found, power, by, terms, model.sigma, seen) for terms in (_TERMS, 1)
            )
            slope, certain, certain_of_line, looks = change
            size = _size(power[by], float(gain[by]), model.sigma)
            every.append(_Change(by, slope, size, float(gain[by]), others, certain, float(line[by]), others_line,
                                 certain_of_line, looks))  # fmt: skip
    # Of fewer strips there are no others to hold one against.
    if seen.sum() < _FEWEST_STRIPS:
        return 0, None, np.full(work.strips, np.inf)
    every.sort(key=lambda one: -one.gain)
    judged = ((one.place, _judged(one, int(work.order[one.place]))) for one in every)
    return *next((pair for pair in judged if pair[1]), (0, None)), least


def _courses(tau: FloatArray) -> FloatArray:
    """Return functions of time from 0 to 1 (places, terms), of mean square 1: a line, and cosines."""
    waves = (np.sqrt(2.0) * np.cos(np.pi * k * tau) for k in range(2, _TERMS + 1))
    return np.stack([np.sqrt(12.0) * (tau - 0.5), *waves], axis=1)


def _against_outline(
    work: WorkingCopy, tau: FloatArray
) -> tuple[int, Finding | Question | None, FloatArray] | None:
    """Return what one strip does beyond a rigid outline under all: its place, the verdict, and the least drift told.

    None where no outline leaves noise alone. Two fits, begun on halves of the places, have to blame one strip: a fit
    may end in a wrong minimum.
    """
    row, strip = readings_joined(work)
    seen = (np.bincount(strip, minlength=work.strips) >= _FEWEST) & _spans(work.strips, strip, tau[row])
    if seen.sum() < max(_FEWEST_STRIPS, _MOST_SEEN * work.strips):
        return None
    one = _beyond_outline(work, tau, seen, 0)
    if one is None or one[1] is None:
        return one
    other = _beyond_outline(work, tau, seen, 1)
    if other is None or other[1] is None:
        return other
    if one[0] != other[0]:
        return 0, None, np.full(work.strips, np.inf)
    if isinstance(one[1], Finding) and isinstance(other[1], Finding):
        return one
    return one[0], Question(one[1].strips, ("drift", "wander"), one[1].evidence), one[2]


def _beyond_outline(
    work: WorkingCopy, tau: FloatArray, seen: BoolArray, part: int
) -> tuple[int, Finding | Question | None, FloatArray] | None:
    """Return the same of an outline that was fitted to one half of the places first."""
    model = RigidContact.of(work, part)
    if model is None:
        return None
    place, verdict, least = _outstanding(model, tau, seen, None)
    if verdict is not None:
        stands = [_outstanding(model, tau, seen, quarter)[0] == place for quarter in range(_QUARTERS)]
        if not all(stands):
            doubt = Question(verdict.strips, ("drift", "wander"), verdict.evidence)
            verdict = doubt if any(stands) else None
    return place, verdict, least


def _outstanding(
    model: RigidContact, tau: FloatArray, seen: BoolArray, quarter: int | None
) -> tuple[int, Finding | Question | None, FloatArray]:
    """Return the verdict on what one strip does beyond an outline, its place, -1 of none, and the least drift told.

    Without a quarter of the recording, if one is given: what hangs on one visit does not show in each of these.
    """
    work, courses = model.work, _courses(tau)[model.place]
    without = slice(0, 0) if quarter is None else model.part(quarter, _QUARTERS)
    found = model.explain(courses[:, None], without=without)
    power = found.power_of_groups(_TERMS)
    some = np.bincount(model.strip, minlength=work.strips) >= _FEWEST_BESIDE
    gain, line = (np.where(some, _gains(found, power, terms, model.sigma), 0.0) for terms in (_TERMS, 1))
    by, by_line = int(np.argmax(gain)), int(np.argmax(line))
    others, others_line = (
        _others(found, power, at, terms, model.sigma, some) for at, terms in ((by, _TERMS), (by_line, 1))
    )
    alone = {
        at: model.explain(courses[:, None], trusted=at) if quarter is None else found for at in {by, by_line}
    }
    read = courses[model.strip == by]
    size = float(np.std(read @ _known_terms(alone[by], by, _TERMS, model.sigma)))
    change = float(np.sqrt(12.0) * _known_terms(alone[by_line], by_line, 1, model.sigma)[0])
    any_size = 0.0 if quarter is None else np.inf  # a part of the recording tells it less well
    whole, straight = (
        (gain[by], gain[by] / max(others, 1e-9), size + any_size),
        float(line[by] / max(gain[by], 1e-9)),
    )
    lines = line[by_line], line[by_line] / max(others_line, 1e-9), abs(change) + any_size
    least = _least(power, line, seen, model.sigma, _BEYOND_LINE[:2])
    against = "against one rigid contact under all strips"
    drifted = f"moved by about {100 * change:+.1g} % of Vref from start to end, {against}"
    wandered = f"wanders by +-{100 * size:.2g} % of Vref {against}"
    in_line = seen[by_line] and _beyond(lines, _BEYOND_LINE)
    if seen[by] and _beyond(whole, _BEYOND) and (straight < _LINE[0] or not in_line):
        return by, Finding("wander", (int(work.order[by]),), wandered, {"wander": size}), least
    if in_line:
        return by_line, Finding("drift", (int(work.order[by_line]),), drifted, {"change": change}), least
    if _beyond(lines, _BEYOND_LINE_ASKED):
        return by_line, Question((int(work.order[by_line]),), ("drift", "wander"), drifted), least
    if _beyond(whole, _BEYOND_ASKED):
        return by, Question((int(work.order[by]),), ("drift", "wander"), wandered), least
    return -1, None, least


def _least(
    power: FloatArray, line: FloatArray, seen: BoolArray, sigma: float, clear: tuple[float, ...]
) -> FloatArray:
    """Return the least drift that would be told of each strip (strips,) over Vref, infinite of those not seen.

    `clear`: the gain of a line that is told, and how many times the next strip's, which noise and shape make.
    """
    gain = max(clear[0], clear[1] * float(line.max()))
    return np.where(seen, sigma * np.sqrt(12.0 * gain / np.maximum(power[:, 0, 0], 1e-12)), np.inf)


def _beyond(shown: tuple[float, ...], least: tuple[float, ...]) -> bool:
    return all(a > b for a, b in zip(shown, least, strict=True))


def _shown_at(strips: int) -> IntArray:
    """Return the strips (strips,) whose bends show each strip's change best: its own, or next to the border."""
    return np.clip(np.arange(strips), 1, strips - 2)


def _scores(found: Explanation, terms: int) -> FloatArray:
    """Return the score of the first terms of each strip (strips, terms)."""
    return found.score.reshape(-1, _TERMS)[:, :terms]


def _gains(found: Explanation, power: FloatArray, terms: int, sigma: float) -> FloatArray:
    """Return the misfit that each strip's first terms explain, in variances of a bend (strips,).

    `power`: of each strip's terms (strips, terms, terms).
    """
    score, each = _scores(found, terms), power[:, :terms, :terms] + np.eye(terms) * (sigma / _USUAL) ** 2
    return np.asarray(
        np.einsum("ia,ia->i", score, np.linalg.solve(each, score[..., None])[..., 0]) / sigma**2
    )


def _known_terms(found: Explanation, by: int, terms: int, sigma: float) -> FloatArray:
    """Return a strip's first terms (terms,) over Vref, by what is usual and what it explains."""
    power = found.power_of_groups(_TERMS)[by, :terms, :terms] + np.eye(terms) * (sigma / _USUAL) ** 2
    return np.asarray(np.linalg.solve(power, _scores(found, terms)[by]))


def _size(power: FloatArray, gain: float, sigma: float) -> float:
    """Return the standard deviation over time of what explains so much, mostly of its terms that are well known."""
    return float(np.sqrt(gain * _TERMS / max(float(np.trace(power)), 1e-12)) * sigma)


def _others(
    found: Explanation, power: FloatArray, by: int, terms: int, sigma: float, seen: BoolArray
) -> float:
    """Return the largest gain of another strip after one strip's change was taken out."""
    score, prior = _scores(found, terms), np.eye(terms) * (sigma / _USUAL) ** 2
    common = found.power(slice(by * _TERMS, by * _TERMS + terms)).reshape(-1, _TERMS, terms)[:, :terms]
    solved = np.linalg.solve(common[by] + prior, np.c_[score[by], common.reshape(-1, terms).T])
    left = score - np.einsum("iab,b->ia", common, solved[:, 0])
    cross = solved[:, 1:].reshape(terms, len(score), terms)
    each = power[:, :terms, :terms] - np.einsum("iac,cib->iab", common, cross) + prior
    gains = np.einsum("ia,ia->i", left, np.linalg.solve(each, left[..., None])[..., 0]) / sigma**2
    gains[~seen] = 0.0
    gains[by] = 0.0
    return float(gains.max(initial=0.0))


def _spans(strips: int, strip: IntArray, tau: FloatArray) -> BoolArray:
    """Return which of so many strips have rows early and late (strips,), by each row's strip and time from 0 to 1."""
    first, last = np.full(strips, np.inf), np.full(strips, -np.inf)
    np.minimum.at(first, strip, tau)
    np.maximum.at(last, strip, tau)
    return np.asarray(last - first >= _SPAN)


def _looked_at(
    model: BendModel,
    found: Explanation,
    columns: FloatArray,
    by: int,
    tau: FloatArray,
    work: WorkingCopy,
) -> tuple[float, float, float, int] | None:
    """Return a strip's change, certainty, certainty of a line, and the number of looks; None of too few.

    A look is a stay of the contact at one height: what shape leaves is alike then. Successive looks are independent.
    """
    shown = int(_shown_at(work.strips)[by])
    rows = model.rows.of_strips(range(shown, shown + 1))
    place = model.rows.place[rows]
    if len(place) < _FEWEST:
        return None
    own = model.beyond(found, columns, by, shown)
    height = np.nanmean(
        np.stack([v[place][:, [shown - 1, shown + 1]].mean(axis=1) for v in work.k.values()]), axis=0
    )
    look = np.zeros(len(place), dtype=int)
    start = height[0]
    for row in range(1, len(place)):
        apart = place[row] - place[row - 1] > _PAUSE or abs(height[row] - start) > _STEP
        look[row] = look[row - 1] + apart
        start = height[row] if apart else start
    weight = model.weight[rows]
    count, total = np.bincount(look), np.bincount(look, weight)
    some = count >= 2
    if some.sum() < _LOOKS_BESIDE or np.ptp((np.bincount(look, tau[place]) / count)[some]) < _SPAN:
        return None
    root = np.sqrt(np.minimum(count[some], _MOST_IN_LOOK))
    mean = (np.bincount(look, weight * model.residual[rows]) / total)[some] * root
    terms = np.stack([(np.bincount(look, weight * c) / total)[some] * root for c in own.T], axis=1)
    free = len(mean) - _CONSTANT
    line = terms[:, 0]
    slope = float(line @ mean) / max(float(line @ line), 1e-12)
    left = mean - slope * line
    t = abs(slope) / np.sqrt(
        max(float(left @ left), 1e-18) / max(free - 1, 1) / max(float(line @ line), 1e-12)
    )
    many = min(_TERMS, len(mean) // 4)
    basis = np.linalg.qr(terms[:, :many])[0]
    explained = float(np.sum((basis.T @ mean) ** 2))
    rest = max(float(mean @ mean) - explained, 1e-18)
    ratio = explained / many / (rest / max(free - many, 1))
    return (
        slope * float(np.sqrt(12.0)),
        _normal(fdtrc(many, max(free - many, 1), ratio)),
        _normal(2.0 * stdtr(max(free - 1, 1), -t)),
        len(mean),
    )


def _normal(chance: float) -> float:
    """Return the deviations of a normal error that are as unlikely."""
    return -float(ndtri(max(chance, _LEAST_CHANCE)))
