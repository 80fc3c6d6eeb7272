"""Drift: readings that change with time and not with the contact."""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.diagnose.faults import Finding
from tacstrip.diagnose.log import Log
from tacstrip.diagnose.neighbour_prediction import WorkingCopy, neighbour_residuals
from tacstrip.diagnose.regression import median_crossings, moved_to_and_fro, regress_out

_DRIFT = 0.012  # over Vref, over the recording: less is not reported
_FEWEST = 40  # scans; an eighth of them in each third of the recording
_OWN = 0.2  # of time's variance that place must not explain
_OPPOSITE = 1.05  # times the neighbour's change, with the opposite sign: ideally twice
_BLOCKS, _STRAIGHT = 8, 10.0  # of untouched readings, and standard errors
_SPAN = 0.8  # of the recording that untouched readings must cover
_BACK = 3  # times that the contact must cross back: one passage cannot be separated from time
_STANDS = 1.2  # times sigma: the prediction from two neighbours scatters less while the contact rests
_PLACES = 6  # different heights that a strip must be touched at, and one more for each term
_VISITS, _PAUSE = 6, 2  # independent looks, and one more for each term; scans between two visits
_CERTAIN, _AT_EDGE = (7.0, 2.0)  # standard errors, and times as many for the outermost strips


def drift(log: Log, work: WorkingCopy) -> tuple[list[Finding], BoolArray]:
    """Find strips whose readings drift: untouched, or relative to neighbours under the same contact.

    Parameters
    ----------
    log
        Its untouched readings show the drift at rest.
    view
        All scans, repaired; strips that drift are dropped from it.

    Returns
    -------
    findings, checked
        And which strips could be looked at (strips,).
    """
    seconds = float(np.ptp(log.time_s))
    tau = (log.time_s - log.time_s.min()) / seconds if seconds > 0.0 else np.zeros_like(log.time_s)
    found, rest = _untouched_drift(log, work.order, tau)
    checked = np.isfinite(rest)
    for finding in found:
        for strip in finding.strips:
            work.drop(int(np.flatnonzero(work.order == strip)[0]))
    # A sheet's strips shift each other, so neighbours do not predict them; a common drift is reported once.
    while log.sensor.kind.closed_form and not any(not f.strips for f in found):
        changes, errors = _touched_drift(work, tau)  # (strips,) in the view's order
        checked[work.order[np.isfinite(changes)]] = True
        certain = np.full(len(changes), _CERTAIN)
        certain[[0, -1]] *= _AT_EDGE
        sure = np.abs(changes) > np.maximum(max(_DRIFT, 1.5 * work.sigma), certain * errors)
        if not sure.any():
            break
        if sure[1:-1].any():
            sure[[0, -1]] = False  # extrapolation magnifies their neighbours' drift
        place = _drifting_strip(changes, errors, int(np.argmax(np.where(sure, np.abs(changes), 0.0))))
        change = float(changes[place])
        evidence = (
            f"moved by {100 * change:+.3g} +- {100 * errors[place]:.2g} % of Vref from start to end, relative to its "
            "neighbours"
        )
        numbers = {"change": change, "error": float(errors[place])}
        found.append(Finding("drift", (int(work.order[place]),), evidence, numbers))
        work.drop(place)
    return found, checked


def _untouched_drift(log: Log, order: IntArray, tau: FloatArray) -> tuple[list[Finding], FloatArray]:
    """Return the drift of untouched readings, and each strip's change (strips,), NaN where it has none."""
    change, slopes, errors = (np.full(log.sensor.strips, np.nan) for _ in range(3))
    near = np.empty_like(log.touched)
    near[:, order] = _near_touched(log.touched[:, order])
    for values in log.raw.values():
        rest = np.where(near, np.nan, values)
        for strip in range(log.sensor.strips):
            known = np.isfinite(rest[:, strip])
            # A contact that slides past near rest must not pass for drift.
            if not _spread_out(tau[known]) or known.sum() < 2 * _FEWEST or np.ptp(tau[known]) < _SPAN:
                continue
            slope, error = _slope_of_medians(tau[known], rest[known, strip])
            if not errors[strip] < error:
                slopes[strip], errors[strip] = slope, error
            sure = slope if abs(slope) > _STRAIGHT * error else 0.0
            if not abs(change[strip]) > abs(sure):
                change[strip] = sure
    moved = np.abs(change) > _DRIFT
    mean, sharing = _common_drift(slopes, errors)
    if sharing:
        at_rest = f"{sharing} of {np.isfinite(slopes).sum()} strips at rest"
        evidence = f"moved by {100 * mean:+.3g} % of Vref from start to end, {at_rest}"
        return [Finding("drift", (), evidence, {"change": mean, "strips": float(sharing)})], change
    evidence = "moved by {:+.3g} % of Vref from start to end, untouched"
    return [
        Finding("drift", (int(i),), evidence.format(100 * change[i]), {"change": float(change[i])})
        for i in np.flatnonzero(moved)
    ], change


def _common_drift(slopes: FloatArray, errors: FloatArray) -> tuple[float, int]:
    """Return the common drift of all strips, and how many share it; 0 and 0 where there is none."""
    known = np.isfinite(slopes)
    if known.sum() < 3:
        return 0.0, 0
    slopes, errors = slopes[known], np.maximum(errors[known], 1e-5)
    mean = float(np.average(slopes, weights=errors**-2.0))
    alike = np.abs(slopes - mean) < 0.3 * abs(mean) + 3.0 * errors
    sure = abs(mean) > max(_DRIFT, _STRAIGHT * float(np.sum(errors**-2.0)) ** -0.5)
    several = np.count_nonzero(np.abs(slopes) > 4.0 * errors) >= 3
    return (mean, int(alike.sum())) if sure and several and alike.mean() > 0.7 else (0.0, 0)


def _drifting_strip(changes: FloatArray, errors: FloatArray, place: int) -> int:
    """Return the strip that drifts: its neighbours seem to drift half as far the other way.

    An outermost strip has one neighbour, and seems to drift twice as far as that one does: it is the one only if the
    neighbour's other neighbour does not drift.
    """
    last = len(changes) - 1
    found = place
    for neighbour, beyond in ((place - 1, place + 1), (place + 1, place - 1)):
        if not 0 <= neighbour <= last or changes[neighbour] * changes[place] >= 0.0:
            continue
        still = 0 <= beyond <= last and abs(changes[beyond]) < 0.25 * abs(changes[place])
        least = _CERTAIN * (1.0 if neighbour in (0, last) else 0.5) * errors[neighbour]
        sure = abs(changes[neighbour]) > max(_OPPOSITE * abs(changes[found]), least)
        if sure and (still or neighbour not in (0, last)):
            found = neighbour
    return found


def _touched_drift(work: WorkingCopy, tau: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return each strip's change that place does not explain, and its standard error (strips,), NaN where not known."""
    change, error = np.full(work.strips, np.nan), np.full(work.strips, np.nan)
    count = np.maximum(work.there.sum(axis=1), 1)
    numbers = np.where(work.there, np.arange(work.strips), 0).sum(axis=1) / count
    across = numbers[work.there.any(axis=1)]
    if len(across) and np.std(across) > 0.5 and median_crossings(across, 0.5) < _BACK:
        return change, error
    for name, values in work.k.items():
        line, r = neighbour_residuals(work, name)
        rise = np.diff(values, axis=1)
        for place in range(work.strips):
            sides = [rise[:, i] for i in (place - 2, place + 1) if 0 <= i < rise.shape[1]]
            terms = np.column_stack([line[:, place], line[:, place] ** 2, *map(np.nan_to_num, sides)])
            c, e = _change(r[:, place], terms, tau, work.sigma)
            if np.isfinite(c) and not abs(change[place]) / error[place] > abs(c) / e:
                change[place], error[place] = c, e
    return change, error


def _change(values: FloatArray, place: FloatArray, tau: FloatArray, sigma: float) -> tuple[float, float]:
    """Return what values (scans,) change by over tau 0..1 that place (scans, terms) does not explain, and its error.

    NaN where it is not identifiable: too few scans, too short a part of the recording, or a contact that did not come
    back to where it was, so that place and time cannot be separated.
    """
    known = np.isfinite(values) & np.isfinite(place).all(axis=1)
    for _ in range(3):
        before = known.copy()
        if not _spread_out(tau[known]):
            return np.nan, np.nan
        terms = place[known]
        level = terms[:, 0] - np.median(terms[:, 0])
        terms = terms[:, terms.std(axis=0) > max(0.003, 3.0 * sigma)]
        stands = bool(np.std(level) < max(0.002, _STANDS * sigma))
        places = len(np.unique(np.round(level / max(0.01, 4.0 * sigma)))) if terms.shape[1] else _PLACES + 1
        own, rest = (regress_out(v[known], *terms.T) for v in (tau, values))
        if (
            not (stands or moved_to_and_fro(level, sigma))
            or places < _PLACES + terms.shape[1]
            or own @ own < _OWN * len(own) / 12.0
        ):
            return np.nan, np.nan
        left = rest - float(rest @ own / (own @ own)) * own
        limit = 4.0 * float(np.median(np.abs(left))) + 1e-5  # a passing corner of the contact is no drift
        known[np.flatnonzero(known)[np.abs(left) > limit]] = False
    terms = terms[known[before]]
    visit = _independent_looks(
        np.flatnonzero(known), place[known, 0] if terms.shape[1] else None, max(0.01, 3.0 * sigma)
    )
    own, rest = (regress_out(v[known], *terms.T) for v in (tau, values))
    count = np.bincount(visit)
    own, rest = (np.bincount(visit, v)[count >= 3] / count[count >= 3] for v in (own, rest))
    if len(own) < _VISITS + terms.shape[1]:
        return np.nan, np.nan
    change, error = _slope(own - own.mean(), rest, 2 + terms.shape[1], len(own))
    since = tau[known] - tau[known].mean()
    overall = float(since @ values[known]) / float(since @ since)  # whatever the place
    return (change, error) if abs(overall - change) < 0.6 * abs(change) else (0.0, error)


def _independent_looks(rows: IntArray, level: FloatArray | None, least: float) -> IntArray:
    """Return the number of the independent look that each row belongs to: visits, in eight parts of the recording.

    A contact that rests at one height, `level`, is one look however long it rests.
    """
    visit = np.cumsum(np.diff(rows, prepend=rows[0]) > _PAUSE)
    number = visit * _BLOCKS + np.arange(len(rows)) * _BLOCKS // len(rows)
    if level is not None:
        lag = max(3, len(rows) // 64)
        moved = np.ones(len(rows), dtype=bool)
        moved[lag:] = np.abs(level[lag:] - level[:-lag]) > least
        moved[1:] |= visit[1:] != visit[:-1]
        number = number[np.maximum.accumulate(np.where(moved, np.arange(len(rows)), 0))]
    return np.asarray(np.unique(number, return_inverse=True)[1])


def _spread_out(tau: FloatArray) -> bool:
    """Whether there are enough scans, in every third of the recording."""
    thirds = np.bincount(np.minimum(tau * 3.0, 2.0).astype(int), minlength=3)
    return bool(len(tau) >= _FEWEST and thirds.min() >= _FEWEST / 8)


def _slope_of_medians(tau: FloatArray, values: FloatArray) -> tuple[float, float]:
    """Return the slope of values by tau, and its error, from eight medians, as low contacts pass for untouched."""
    parts = np.array_split(np.arange(len(tau)), _BLOCKS)
    middle = np.array([np.median(tau[p]) for p in parts])
    level = np.array([np.median(values[p]) for p in parts])
    return _slope(middle - middle.mean(), level, 1, _BLOCKS)


def _slope(own: FloatArray, rest: FloatArray, terms: int, looks: int) -> tuple[float, float]:
    """Return the slope of rest by own, both without mean, and its standard error for so many independent looks."""
    rest = rest - rest.mean()
    change = float(rest @ own / (own @ own))
    spread = float(np.std(rest - change * own))
    return change, max(spread, 1e-5) / (float(np.std(own)) * float(np.sqrt(max(looks - terms, 1))))


def _near_touched(touched: BoolArray) -> BoolArray:
    """Return which strips are touched or next to one that is: a contact at the ground end can pass for none."""
    near = touched.copy()
    near[:, 1:] |= touched[:, :-1]
    near[:, :-1] |= touched[:, 1:]
    return near
