"""What changes with time and not with the contact."""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.diagnose.finding import Finding
from tacstrip.diagnose.fits import without
from tacstrip.diagnose.log import Log
from tacstrip.diagnose.view import View, residuals

_DRIFT = 0.012  # over Vref, over the recording: less is not worth a word
_FEWEST = 40  # scans; an eighth of them in each third of the recording
_OWN = 0.2  # of time's variance, that place must leave over
_BLAME = 1.05  # times as far, the other way: it should be twice
_BLOCKS, _STRAIGHT = 8, 10.0  # of untouched readings, and standard errors
_BACK = (
    3  # times that the contact must come back to the same height: a passage in one direction is time itself
)
_PLACES = 6  # different heights that a strip must be touched at, beside one for each term
_VISITS, _PAUSE = 5, 2  # visits of a contact to a strip, and the scans between two
_CERTAIN = 7.0  # standard errors


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
        sure = np.abs(changes) > np.maximum(max(_DRIFT, 1.5 * view.sigma), _CERTAIN * errors)
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
    change = np.full(log.sensor.strips, np.nan)
    near = np.empty_like(log.touched)
    near[:, order] = _near(log.touched[:, order])
    for values in log.raw.values():
        rest = np.where(near, np.nan, values)
        for strip in range(log.sensor.strips):
            known = np.isfinite(rest[:, strip])
            if not _spread_out(tau[known]) or known.sum() < 2 * _FEWEST:
                continue
            slope, error = _of_blocks(tau[known], rest[known, strip])
            sure = slope if abs(slope) > _STRAIGHT * error else 0.0
            if not abs(change[strip]) > abs(sure):
                change[strip] = sure
    known, moved = np.isfinite(change), np.abs(change) > _DRIFT
    if known.sum() >= 3 and moved.sum() > 0.6 * known.sum():
        mean = float(np.median(change[known]))
        told = f"moved by {100 * mean:+.3g} % of Vref from start to end, {moved.sum()} of {known.sum()} strips at rest"
        return [Finding("drift", (), told, {"change": mean, "strips": float(moved.sum())})], change
    told = "moved by {:+.3g} % of Vref from start to end, untouched"
    return [
        Finding("drift", (int(i),), told.format(100 * change[i]), {"change": float(change[i])})
        for i in np.flatnonzero(moved)
    ], change


def _blamed(changes: FloatArray, errors: FloatArray, place: int) -> int:
    """Return the strip that wanders: its neighbours seem to wander half as far the other way."""
    beside = [
        i for i in (place - 1, place + 1) if 0 <= i < len(changes) and changes[i] * changes[place] < 0.0
    ]
    beside = [
        i for i in beside if abs(changes[i]) > max(_BLAME * abs(changes[place]), 0.5 * _CERTAIN * errors[i])
    ]
    return max([place, *beside], key=lambda i: abs(changes[i]))


def _beside_neighbours(view: View, tau: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return each strip's change beside what place explains, and its standard error (strips,), NaN where not known."""
    change, error = np.full(view.strips, np.nan), np.full(view.strips, np.nan)
    numbers = np.where(view.there, np.arange(view.strips), 0).sum(axis=1) / np.maximum(
        view.there.sum(axis=1), 1
    )
    across = numbers[view.there.any(axis=1)]
    if len(across) and np.std(across) > 0.5 and _returns(across, 0.5) < _BACK:
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
        back = _returns(terms[:, 0], max(0.01, 3.0 * sigma)) if terms.shape[1] else int(known.sum())
        places = len(np.unique(np.round(level / max(0.01, 4.0 * sigma)))) if terms.shape[1] else _PLACES + 1
        own, rest = (without(v[known], *terms.T) for v in (tau, values))
        if back < _BACK or places < _PLACES + terms.shape[1] or own @ own < _OWN * len(own) / 12.0:
            return np.nan, np.nan
        left = rest - float(rest @ own / (own @ own)) * own
        limit = 4.0 * float(np.median(np.abs(left))) + 1e-5  # a corner of the contact that passes is no drift
        known[np.flatnonzero(known)[np.abs(left) > limit]] = False
    change, error = _of_visits(
        np.flatnonzero(known), *(without(v[known], *terms[known[before]].T) for v in (tau, values))
    )
    plainly = tau[known] - tau[known].mean()
    seen = float(plainly @ values[known]) / float(plainly @ plainly)  # without regard to place
    return (change, error) if abs(seen - change) < 0.6 * abs(change) else (0.0, error)


def _of_visits(rows: IntArray, own: FloatArray, rest: FloatArray) -> tuple[float, float]:
    """Return the slope of rest by own, and its error, from the means of visits: neighbouring scans err alike."""
    visit = np.cumsum(np.diff(rows, prepend=rows[0]) > _PAUSE)
    visit = np.unique(visit * _BLOCKS + np.arange(len(rows)) * _BLOCKS // len(rows), return_inverse=True)[1]
    count = np.bincount(visit)
    means = [np.bincount(visit, v)[count >= 3] / count[count >= 3] for v in (own, rest)]
    if len(means[0]) < _VISITS:
        return np.nan, np.nan
    return _slope(means[0] - means[0].mean(), means[1], 2, len(means[0]))


def _returns(values: FloatArray, least: float) -> int:
    """Count how often values cross their middle, going beyond it by `least` on both sides."""
    aside = values - np.median(values)
    return int(np.count_nonzero(np.diff(np.sign(aside[np.abs(aside) > least]))))


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
