"""Drift and slow wander: a strip's readings that change with time, not with the contact or the other strips."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.diagnose.faults import Finding, Question
from tacstrip.diagnose.log import Log
from tacstrip.diagnose.neighbour_prediction import WorkingCopy, neighbour_residuals
from tacstrip.robust import robust_sigma

_DRIFT, _WANDER = (
    0.006,
    0.005,
)  # over Vref, over the recording, and as a standard deviation: less is not reported
_CERTAIN = 6.0  # standard deviations of a normal error that a change must exceed
_AT_EDGE = 2.0  # times as many for the outermost strips, where extrapolation magnifies what neighbours do
_TIMES = 4.0  # times the other strips' changes
_MORE = 8.0  # times the other strips' wander
_LOOKS, _LOOKS_TO_WANDER = 7, 10  # independent looks at a strip
_SMOOTH = 1.0  # von Neumann's ratio: 2 for independent looks, less for slow wander
_STRAIGHT = 0.5  # of the wander's variance: more in a line is drift
_BLOCKS, _FINE = 16, 4  # of time; as many looks in each
_RESTS = 4  # untouched readings in a block
_STRAYS, _STRAY_SHARE = 3, 0.003  # untouched readings that may jump
_PAUSE = 2  # rows between two visits
_SPAN, _FEWEST = 0.6, 24  # of the recording, rows
_PLAIN, _WITHIN = (
    0.03,
    3,
)  # over Vref, and strips known on either side: less may be the contact's shape, and is asked
_MOST_ASKED = 2  # strips: more questions are about the contact's shape
_OWN = 0.2  # of time's variance that place must not explain


@dataclass(frozen=True, eq=False)
class _Trend:
    """What strips do over the recording (strips,), NaN where it cannot be known.

    change, error: from start to end over Vref, and its standard error, as large as a normal one of equal doubt.
    wander: standard deviation of slow changes over Vref; smooth: von Neumann's ratio of successive looks.
    straight: share of the wander's variance that a line explains.
    """

    change: FloatArray
    error: FloatArray
    wander: FloatArray
    smooth: FloatArray
    straight: FloatArray

    @classmethod
    def unknown(cls, strips: int) -> _Trend:
        return cls(*(np.full(strips, np.nan) for _ in range(5)))

    def put(self, strip: int, values: tuple[float, float, float, float, float]) -> None:
        """Keep the more certain of two channels."""
        change, error = values[:2]
        if np.isfinite(change) and not abs(self.change[strip]) / self.error[strip] > abs(change) / error:
            self.change[strip], self.error[strip], self.straight[strip] = change, error, values[4]
        if np.isfinite(values[2]) and not self.wander[strip] > values[2]:
            self.wander[strip], self.smooth[strip] = values[2:4]


def drift(
    log: Log, work: WorkingCopy, time_s: FloatArray
) -> tuple[list[Finding], list[Question], list[Finding], BoolArray]:
    """Find strips that drift or wander against the others: untouched, or relative to neighbours under one contact.

    Parameters
    ----------
    log
        Its untouched readings show the drift at rest.
    work, time_s
        Places, repaired, and when they were (places,) [s]; strips that drift are dropped from it.

    Returns
    -------
    findings, questions, notes, checked
        Drift of single strips; those that move a little against their neighbours under a contact, as its shape may make
        them; drift of all together; and which strips could be looked at (strips,).
    """
    first, seconds = float(log.time_s.min()), float(np.ptp(log.time_s))
    nothing = np.zeros(log.sensor.strips, dtype=bool)
    if seconds <= 0.0:
        return [], [], [], nothing
    rest, common = _at_rest(log, work.order, (log.time_s - first) / seconds)
    checked = np.isfinite(rest.change)
    found = list(_outstanding(rest, "untouched", np.arange(log.sensor.strips), nothing, edges=False))
    notes = []
    if np.isfinite(common) and abs(common) > 2.0 * _DRIFT:
        evidence = f"untouched strips moved together by {100 * common:+.2g} % of Vref from start to end"
        notes.append(Finding("common-drift", (), evidence, {"change": common}))
    for finding in found:
        work.drop(int(np.flatnonzero(work.order == finding.strips[0])[0]))
    if not log.sensor.kind.closed_form:  # a sheet's strips shift each other
        return found, [], notes, checked
    tau = (time_s - first) / seconds
    trend, asked = _Trend.unknown(work.strips), []
    due: IntArray = np.arange(work.strips)
    for _ in range(work.strips):
        _look(work, tau, trend, due)
        checked[work.order[np.isfinite(trend.change)]] = True
        lost = ~np.any([np.isfinite(values).any(axis=0) for values in work.k.values()], axis=0)
        now = _outstanding(trend, "relative to its neighbours", work.order, lost, edges=True)
        if not now:
            break
        place = int(np.flatnonzero(work.order == now[0].strips[0])[0])
        known = np.isfinite(trend.change)
        within = min(int(known[:place].sum()), int(known[place + 1 :].sum())) >= _WITHIN
        if within and abs(now[0].numbers.get("change", 0.0)) > _PLAIN:
            found.append(now[0])
        else:
            asked.append(Question(now[0].strips, ("drift", "wander"), now[0].evidence))
        work.drop(place)
        due = np.arange(max(place - 4, 0), min(place + 5, work.strips))
        for values in (trend.change, trend.error, trend.wander, trend.smooth, trend.straight):
            values[due] = np.nan
    return found, asked if len(asked) <= _MOST_ASKED else [], notes, checked


def _outstanding(trend: _Trend, how: str, order: IntArray, lost: BoolArray, edges: bool) -> list[Finding]:
    """Return drifts and wanders that stand out of doubt, and of the other strips', the largest first.

    Strips that are `lost` (strips,) have no readings.
    """
    found: list[tuple[float, Finding]] = []
    with np.errstate(invalid="ignore", divide="ignore"):
        certain = np.abs(trend.change) / trend.error
    for i in np.flatnonzero(np.isfinite(trend.change)).tolist():
        others = np.delete(np.arange(len(order)), i)
        beside = [j for j in (i - 1, i + 1) if 0 <= j < len(order)]
        apart = np.setdiff1d(others, beside)
        need = _CERTAIN * (_AT_EDGE if edges and i in (0, len(order) - 1) else 1.0)
        usual = _spread_of(trend.change[apart])
        change, error = float(trend.change[i]), float(trend.error[i])
        near = max((abs(float(trend.change[j])) for j in beside if np.isfinite(trend.change[j])), default=0.0)
        stands_out = abs(change) > max(_DRIFT, _TIMES * usual) and certain[i] > need
        # At rest a contact that reads as rest does shows on neighbours too; a neighbour not known may be the one.
        share = 1.05 if edges else 0.5
        clear = not edges or all(np.isfinite(trend.change[j]) or lost[j] for j in beside)
        if stands_out and clear and not near > share * abs(change) and trend.straight[i] > _STRAIGHT:
            evidence = f"moved by {100 * change:+.3g} +- {100 * error:.2g} % of Vref from start to end, {how}"
            numbers = {"change": change, "error": error}
            found.append((abs(change), Finding("drift", (int(order[i]),), evidence, numbers)))
            continue
        calm = trend.wander[apart][np.isfinite(trend.wander[apart])]
        beyond = max((float(trend.wander[j]) for j in beside if np.isfinite(trend.wander[j])), default=0.0)
        size = float(trend.wander[i])
        if (
            len(calm) >= 3
            and size > max(_WANDER, _MORE * float(np.median(calm)), 1.5 * float(calm.max()))
            and (trend.smooth[i] < _SMOOTH or not edges)
            and not beyond > share * size
            and not (edges and i in (0, len(order) - 1))
        ):
            evidence = f"wanders by +-{100 * size:.2g} % of Vref, slowly, {how}, where the others do by "
            evidence += f"+-{100 * float(np.median(calm)):.2g} %"
            finding = Finding("wander", (int(order[i]),), evidence, {"wander": size})
            found.append((1.7 * size, finding))
    return [f for _, f in sorted(found, key=lambda pair: -pair[0])]


def _spread_of(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(robust_sigma(known)) if len(known) >= 3 else 0.0


def _at_rest(log: Log, order: IntArray, tau: FloatArray) -> tuple[_Trend, float]:
    """Return the trend of untouched readings against those of all strips, and the change that these share."""
    strips = log.sensor.strips
    near = np.empty_like(log.touched)
    near[:, order] = _near_touched(log.touched[:, order])
    block = np.minimum((tau * _BLOCKS).astype(int), _BLOCKS - 1)
    trend, shared = _Trend.unknown(strips), []
    for values in log.raw.values():
        rest = np.where(near, np.nan, values)
        if not np.isfinite(rest).any():
            continue
        level = np.full((_BLOCKS, strips), np.nan)
        for b in range(_BLOCKS):
            part = rest[block == b]
            enough = np.isfinite(part).sum(axis=0) >= _RESTS
            if enough.any():
                level[b, enough] = np.nanmedian(part[:, enough], axis=0)
        level -= np.where(
            np.isfinite(level).any(axis=0), np.nanmean(np.where(np.isfinite(level), level, 0.0), axis=0), 0.0
        )
        known = np.isfinite(level)
        center = np.array(
            [np.median(level[b, known[b]]) if known[b].sum() >= 3 else np.nan for b in range(_BLOCKS)]
        )
        middle = (np.arange(_BLOCKS) + 0.5) / _BLOCKS
        usable = np.isfinite(center)
        if usable.sum() >= _BLOCKS // 2:
            shared.append(float(np.polyfit(middle[usable], center[usable], 1)[0]))
        for strip in range(strips):
            own = level[:, strip] - np.where(usable, center, 0.0)
            there = np.isfinite(own)
            if there.sum() >= _LOOKS and np.ptp(middle[there]) >= _SPAN:
                change, error, wander, smooth, straight = _over_time(middle[there], own[there], 0)
                wander = np.nan if _jumps(rest[:, strip]) else wander
                trend.put(strip, (change, error, wander, smooth, straight))
    return trend, float(np.median(shared)) if shared else np.nan


def _jumps(rest: FloatArray) -> bool:
    """Whether readings (scans,) jump, as where a contact that reads nearly as rest passes for none."""
    step = np.diff(rest[np.isfinite(rest)])
    if not len(step):
        return True
    most = 6.0 * max(float(robust_sigma(step)), 1e-4)
    return bool(np.count_nonzero(np.abs(step) > most) > max(_STRAYS, _STRAY_SHARE * len(step)))


def _over_time(tau: FloatArray, looks: FloatArray, terms: int) -> tuple[float, float, float, float, float]:
    """Return the numbers of a `_Trend` from looks at times 0..1, after so many terms were fitted.

    Where successive looks err alike, there are fewer independent ones.
    """
    since = tau - tau.mean()
    looks = looks - looks.mean()
    change = float(since @ looks) / float(since @ since)
    left = looks - change * since
    whole = max(float(left @ left), 1e-12)
    alike = float(np.clip(float(left[1:] @ left[:-1]) / whole, 0.0, 0.9))
    free = max((len(looks) - 2 - terms) * (1.0 - alike) / (1.0 + alike), 1.0)
    error = np.sqrt(whole / free / float(since @ since) * len(looks) / (len(looks) - 2 - terms + 2.0))
    variance = max(float(looks @ looks) / len(looks), 1e-12)
    smooth = float(np.mean(np.diff(looks) ** 2)) / variance if len(looks) >= _LOOKS_TO_WANDER else 2.0
    straight = 1.0 - float(left @ left) / max(float(looks @ looks), 1e-12)
    return change, max(float(error), 1e-5) * _student(free), float(np.sqrt(variance)), smooth, straight


def _student(free: float) -> float:
    """Return how much larger Student's t is than a normal deviation of `_CERTAIN`, at so many degrees of freedom."""
    z = _CERTAIN
    return 1.0 + (z**2 + 1.0) / (4.0 * free) + (5.0 * z**4 + 16.0 * z**2 + 3.0) / (96.0 * free**2)


def _look(work: WorkingCopy, tau: FloatArray, trend: _Trend, due: IntArray) -> None:
    """Fill in the trend of some strips, relative to their neighbours, with the effect of place removed."""
    for name, values in work.k.items():
        line, r = neighbour_residuals(work, name)
        rise = np.diff(values, axis=1)
        for place in due.tolist():
            sides = [rise[:, i] for i in (place - 2, place + 1) if 0 <= i < rise.shape[1]]
            known = np.isfinite(r[:, place])
            if known.sum() < _FEWEST or np.ptp(tau[known]) < _SPAN:
                continue
            terms = [line[:, place], line[:, place] ** 2, *map(np.nan_to_num, sides)]
            if numbers := _without_place(
                r[known, place], tau[known], [t[known] for t in terms], np.flatnonzero(known)
            ):
                trend.put(place, numbers)


def _without_place(
    values: FloatArray, tau: FloatArray, terms: list[FloatArray], rows: IntArray
) -> tuple[float, float, float, float, float] | None:
    """Return the numbers of a `_Trend` from residuals (rows,) that depend on place too; None where it is not clear."""
    used = [t for t in terms if float(np.std(t)) > 0.003]
    keep = np.ones(len(values), dtype=bool)
    for trimming in (True, True, True, False):
        if keep.sum() < _FEWEST:
            return None
        basis = np.linalg.qr(np.column_stack([np.ones(int(keep.sum())), *(t[keep] for t in used)]))[0]
        own, rest = (v[keep] - basis @ (basis.T @ v[keep]) for v in (tau, values))
        power = float(own @ own)
        if power < _OWN * float(keep.sum()) * float(np.var(tau[keep])):
            return None  # the contact did not come back to where it was
        left = rest - float(own @ rest) / power * own
        limit = 4.0 * float(np.median(np.abs(left))) + 1e-5  # a passing corner of the contact is no drift
        beyond = np.flatnonzero(keep)[np.abs(left) > limit]
        if trimming:
            keep[beyond] = False
    at = rows[keep]
    visit = np.cumsum(np.diff(at, prepend=at[0]) > _PAUSE)
    part = np.minimum(tau[keep] * _BLOCKS * _FINE, _BLOCKS * _FINE - 1).astype(int)
    number = np.unique(visit * _BLOCKS * _FINE + part, return_inverse=True)[1]
    count = np.bincount(number)
    enough = count >= 2
    looks, when, raw = (np.bincount(number, v)[enough] / count[enough] for v in (rest, own, tau[keep]))
    if len(looks) < _LOOKS + len(used) or np.ptp(raw) < _SPAN:
        return None
    change, error, *_ = _over_time(when, looks, len(used))
    block = np.unique(np.minimum(raw * _BLOCKS, _BLOCKS - 1).astype(int), return_inverse=True)[1]
    weight = np.bincount(block)
    slow, then = (np.bincount(block, v) / weight for v in (looks, raw))
    if len(slow) < 4:
        return None
    _, _, wander, smooth, straight = _over_time(then, slow, 0)
    overall = float(np.polyfit(tau[keep], values[keep], 1)[0])  # whatever the place
    if abs(overall - change) > 0.6 * abs(change):
        change = 0.0
    return (
        change,
        error,
        wander,
        smooth,
        max(straight, _STRAIGHT + 0.01 if change and abs(change) > 6.0 * error else 0.0),
    )


def _near_touched(touched: BoolArray) -> BoolArray:
    """Return which strips are touched or next to one that is: a contact at the ground end can pass for none."""
    near = touched.copy()
    near[:, 1:] |= touched[:, :-1]
    near[:, :-1] |= touched[:, 1:]
    return near
