"""What changes with time and not with the contact."""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.diagnose.expected import View, residuals
from tacstrip.diagnose.finding import Finding
from tacstrip.diagnose.log import Log
from tacstrip.diagnose.regression import came_back, returns, without

_DRIFT = 0.012  # over Vref, over the recording: less is not worth a word
_FEWEST = 40  # scans; an eighth of them in each third of the recording
_OWN = 0.2  # of time's variance, that place must leave over
_BLAME = 1.05  # times as far, the other way: it should be twice
_BLOCKS, _STRAIGHT = 8, 10.0  # of untouched readings, and standard errors
_SPAN = 0.8  # of the recording, that untouched readings must cover
_BACK = 3  # times that the contact must come back across: a passage in one direction is time itself
_STANDS = 1.2  # times sigma: what the line through two neighbours scatters by is less, of a contact at rest
_PLACES = 6  # different heights that a strip must be touched at, beside one for each term
_VISITS, _PAUSE = 6, 2  # looks beside one for each term, and the scans between two visits
_CERTAIN, _AT_EDGE = (
    7.0,
    2.0,
)  # standard errors; more of them where lines are drawn beyond the last strip but one


def drift(log: Log, view: View) -> tuple[list[Finding], BoolArray]:
    """Find strips whose readings wander: at rest, or beside neighbours that see the same contact.

    Parameters
    ----------
    log
        Its untouched readings tell the drift at rest.
    view
        All scans, repaired; strips that wander are dropped from it.

    Returns
    -------
    findings, checked
        And which strips could be looked at (strips,).
    """
    seconds = float(np.ptp(log.time_s))
    tau = (log.time_s - log.time_s.min()) / seconds if seconds > 0.0 else np.zeros_like(log.time_s)
    found, rest = _at_rest(log, view.order, tau)
    checked = np.isfinite(rest)
    for finding in found:
        for strip in finding.strips:
            view.drop(int(np.flatnonzero(view.order == strip)[0]))
    # A sheet's strips shift each other, so their neighbours know nothing of them; a common drift is told once.
    while log.sensor.kind.closed_form and not any(not f.strips for f in found):
        changes, errors = _beside_neighbours(view, tau)  # (strips,) in the view's order
        checked[view.order[np.isfinite(changes)]] = True
        certain = np.full(len(changes), _CERTAIN)
        certain[[0, -1]] *= _AT_EDGE
        sure = np.abs(changes) > np.maximum(max(_DRIFT, 1.5 * view.sigma), certain * errors)
        if not sure.any():
            break
        if sure[1:-1].any():
            sure[[0, -1]] = False  # lines drawn beyond the last strip but one magnify what wanders there
        place = _blamed(changes, errors, int(np.argmax(np.where(sure, np.abs(changes), 0.0))))
        change = float(changes[place])
        found.append(
            Finding(
                "drift", (int(view.order[place]),),
                f"moved by {100 * change:+.3g} +- {100 * errors[place]:.2g} % of Vref from start to end, beside others",
                {"change": change, "error": float(errors[place])},
            )
        )  # fmt: skip
        view.drop(place)
    return found, checked


def _at_rest(log: Log, order: IntArray, tau: FloatArray) -> tuple[list[Finding], FloatArray]:
    """Return what untouched readings tell, and each strip's change (strips,), NaN where it has none."""
    change, slopes, errors = (np.full(log.sensor.strips, np.nan) for _ in range(3))
    near = np.empty_like(log.touched)
    near[:, order] = _near(log.touched[:, order])
    for values in log.raw.values():
        rest = np.where(near, np.nan, values)
        for strip in range(log.sensor.strips):
            known = np.isfinite(rest[:, strip])
            # A contact near rest that slides past says more than its time on the strip can hold.
            if not _spread_out(tau[known]) or known.sum() < 2 * _FEWEST or np.ptp(tau[known]) < _SPAN:
                continue
            slope, error = _of_blocks(tau[known], rest[known, strip])
            if not errors[strip] < error:
                slopes[strip], errors[strip] = slope, error
            sure = slope if abs(slope) > _STRAIGHT * error else 0.0
            if not abs(change[strip]) > abs(sure):
                change[strip] = sure
    moved = np.abs(change) > _DRIFT
    mean, alike = _together(slopes, errors)
    if alike:
        known = np.isfinite(slopes).sum()
        told = f"moved by {100 * mean:+.3g} % of Vref from start to end, {alike} of {known} strips at rest"
        return [Finding("drift", (), told, {"change": mean, "strips": float(alike)})], change
    told = "moved by {:+.3g} % of Vref from start to end, untouched"
    return [
        Finding("drift", (int(i),), told.format(100 * change[i]), {"change": float(change[i])})
        for i in np.flatnonzero(moved)
    ], change


def _together(slopes: FloatArray, errors: FloatArray) -> tuple[float, int]:
    """Return by how much strips moved as one (strips,), and how many did; none where they did not."""
    known = np.isfinite(slopes)
    if known.sum() < 3:
        return 0.0, 0
    slopes, errors = slopes[known], np.maximum(errors[known], 1e-5)
    mean = float(np.average(slopes, weights=errors**-2.0))
    alike = np.abs(slopes - mean) < 0.3 * abs(mean) + 3.0 * errors
    sure = abs(mean) > max(_DRIFT, _STRAIGHT * float(np.sum(errors**-2.0)) ** -0.5)
    several = np.count_nonzero(np.abs(slopes) > 4.0 * errors) >= 3
    return (mean, int(alike.sum())) if sure and several and alike.mean() > 0.7 else (0.0, 0)


def _blamed(changes: FloatArray, errors: FloatArray, place: int) -> int:
    """Return the strip that wanders: its neighbours seem to wander half as far the other way.

    The last strip of all has one neighbour, and seems to wander twice as far as that one does: it is blamed only if
    the neighbour's other neighbour stands still.
    """
    last = len(changes) - 1
    found = place
    for beside, beyond in ((place - 1, place + 1), (place + 1, place - 1)):
        if not 0 <= beside <= last or changes[beside] * changes[place] >= 0.0:
            continue
        still = 0 <= beyond <= last and abs(changes[beyond]) < 0.25 * abs(changes[place])
        least = _CERTAIN * (1.0 if beside in (0, last) else 0.5) * errors[beside]
        sure = abs(changes[beside]) > max(_BLAME * abs(changes[found]), least)
        if sure and (still or beside not in (0, last)):
            found = beside
    return found


def _beside_neighbours(view: View, tau: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return each strip's change beside what place explains, and its standard error (strips,), NaN where not known."""
    change, error = np.full(view.strips, np.nan), np.full(view.strips, np.nan)
    numbers = np.where(view.there, np.arange(view.strips), 0).sum(axis=1) / np.maximum(
        view.there.sum(axis=1), 1
    )
    across = numbers[view.there.any(axis=1)]
    if len(across) and np.std(across) > 0.5 and returns(across, 0.5) < _BACK:
        return change, error
    for name, values in view.k.items():
        line, r = residuals(view, name)
        rise = np.diff(values, axis=1)
        for place in range(view.strips):
            sides = [rise[:, i] for i in (place - 2, place + 1) if 0 <= i < rise.shape[1]]
            terms = np.column_stack([line[:, place], line[:, place] ** 2, *map(np.nan_to_num, sides)])
            c, e = _change(r[:, place], terms, tau, view.sigma)
            if np.isfinite(c) and not abs(change[place]) / error[place] > abs(c) / e:
                change[place], error[place] = c, e
    return change, error


def _change(values: FloatArray, place: FloatArray, tau: FloatArray, sigma: float) -> tuple[float, float]:
    """Return what values (scans,) change by over tau 0..1 beside what place (scans, terms) explains, and its error.

    NaN where it cannot be told: too few scans, too short a part of the recording, or a contact that did not come back
    to where it was, so that place and time say the same.
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
        own, rest = (without(v[known], *terms.T) for v in (tau, values))
        if (
            not (stands or came_back(level, sigma))
            or places < _PLACES + terms.shape[1]
            or own @ own < _OWN * len(own) / 12.0
        ):
            return np.nan, np.nan
        left = rest - float(rest @ own / (own @ own)) * own
        limit = 4.0 * float(np.median(np.abs(left))) + 1e-5  # a corner of the contact that passes is no drift
        known[np.flatnonzero(known)[np.abs(left) > limit]] = False
    terms = terms[known[before]]
    visit = _looks(np.flatnonzero(known), place[known, 0] if terms.shape[1] else None, max(0.01, 3.0 * sigma))
    own, rest = (without(v[known], *terms.T) for v in (tau, values))
    count = np.bincount(visit)
    own, rest = (np.bincount(visit, v)[count >= 3] / count[count >= 3] for v in (own, rest))
    if len(own) < _VISITS + terms.shape[1]:
        return np.nan, np.nan
    change, error = _slope(own - own.mean(), rest, 2 + terms.shape[1], len(own))
    plainly = tau[known] - tau[known].mean()
    seen = float(plainly @ values[known]) / float(plainly @ plainly)  # without regard to place
    return (change, error) if abs(seen - change) < 0.6 * abs(change) else (0.0, error)


def _looks(rows: IntArray, level: FloatArray | None, least: float) -> IntArray:
    """Return numbers of the looks that are worth one each: visits of the contact, in eight parts of the recording.

    A contact that stands on one height, `level`, is one look however long it stands.
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


def _of_blocks(tau: FloatArray, values: FloatArray) -> tuple[float, float]:
    """Return the slope of values by tau, and its error, from eight medians: low contacts pass for rest."""
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


def _near(touched: BoolArray) -> BoolArray:
    """Return which strips are touched or beside one that is: a contact at the ground end can pass for none."""
    near = touched.copy()
    near[:, 1:] |= touched[:, :-1]
    near[:, :-1] |= touched[:, 1:]
    return near
