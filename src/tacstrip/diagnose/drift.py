"""What changes with time and not with the contact."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.diagnose.finding import Finding
from tacstrip.diagnose.log import Log
from tacstrip.diagnose.view import View, residuals

_DRIFT = 0.01  # over Vref, over the recording: less is not worth a word
_FEWEST = 40  # scans; an eighth of them in each quarter of the recording
_OWN = 0.2  # of time's variance, that place must leave over
_EXPLAINED = 0.6  # of what place leaves over
_NOISY = 2.0  # times sigma: what may be left in the end


def drift(log: Log, view: View) -> tuple[list[Finding], BoolArray]:
    """Find strips whose readings wander: at rest, or beside neighbours that see the same contact.

    Parameters
    ----------
    log
        Its untouched readings tell the drift at rest.
    view
        All scans, repaired.

    Returns
    -------
    findings, checked
        And which strips could be looked at (strips,).
    """
    seconds = float(np.ptp(log.time_s))
    tau = (log.time_s - log.time_s.min()) / seconds if seconds > 0.0 else np.zeros_like(log.time_s)
    wander = np.full((2, view.strips), np.nan)  # at rest, beside its neighbours
    for name, values in view.k.items():
        rest = np.where(_near(log.touched), np.nan, log.raw[name])
        line, _ = residuals(view, name)
        rise = np.diff(values, axis=1)
        for place, strip in enumerate(view.order):
            sides = [rise[:, i] for i in (place - 2, place + 1) if 0 <= i < rise.shape[1]]
            terms = np.column_stack([line[:, place], line[:, place] ** 2, *map(np.nan_to_num, sides)])
            at_rest = _change(rest[:, strip], np.empty((len(tau), 0)), tau, view.sigma)
            beside = _change(values[:, place] - line[:, place], terms, tau, view.sigma)
            for row, change in enumerate((at_rest, beside)):
                if not abs(wander[row, strip]) > abs(change):
                    wander[row, strip] = change
    return list(_wandering(wander)), np.isfinite(wander).any(axis=0)


def _wandering(wander: FloatArray) -> Iterator[Finding]:
    """Turn changes at rest and beside neighbours (2, strips) into findings: all strips together, or each."""
    rest, beside = wander
    known, moved = np.isfinite(rest), np.abs(rest) > _DRIFT
    if known.sum() >= 3 and moved.sum() > 0.6 * known.sum():
        mean = float(np.median(rest[known]))
        yield Finding(
            "drift", (), f"untouched strips moved by {100 * mean:+.3g} % of Vref from start to end, {int(moved.sum())} of "
            f"{int(known.sum())} strips", {"change": mean, "strips": float(moved.sum())},
        )  # fmt: skip
        return
    for strip in np.flatnonzero(moved | (np.abs(beside) > _DRIFT)):
        change, how = (rest[strip], "untouched") if moved[strip] else (beside[strip], "beside its neighbours")
        yield Finding(
            "drift", (int(strip),), f"moved by {100 * change:+.3g} % of Vref from start to end, {how}",
            {"change": float(change)},
        )  # fmt: skip


def _change(values: FloatArray, place: FloatArray, tau: FloatArray, sigma: float) -> float:
    """Return what values (scans,) change by over tau 0..1, beside what place (scans, terms) explains.

    0 where nothing is certain; NaN where it cannot be told: too few scans, too short a part of the recording, or a
    contact that moved one way all the time, so that place and time say the same.
    """
    known = np.isfinite(values) & np.isfinite(place).all(axis=1)
    for _ in range(3):
        quarters = np.bincount(np.minimum(tau[known] * 4.0, 3.0).astype(int), minlength=4)
        if known.sum() < _FEWEST or quarters.min() < _FEWEST / 8:
            return np.nan
        terms = place[known]
        terms = terms[:, terms.std(axis=0) > max(0.003, 3.0 * sigma)]
        terms = np.column_stack([np.ones(len(terms)), terms])
        own, rest = (_beside(v[known], terms) for v in (tau, values))
        if own @ own < _OWN * len(own) / 12.0:
            return np.nan
        change = float(rest @ own / (own @ own))
        left = rest - change * own
        limit = 4.0 * float(np.median(np.abs(left))) + 1e-5  # a corner of the contact that passes is no drift
        known[np.flatnonzero(known)[np.abs(left) > limit]] = False
    plainly = tau[known] - tau[known].mean()
    seen = float(plainly @ values[known]) / float(plainly @ plainly)  # without regard to place
    quiet = abs(seen - change) < 0.5 * abs(change) and float(np.std(left)) < _NOISY * max(sigma, 0.0005)
    explained = 1.0 - float(left @ left) / float(rest @ rest) if rest.any() else 0.0
    return change if quiet and explained > _EXPLAINED else 0.0


def _beside(values: FloatArray, terms: FloatArray) -> FloatArray:
    return np.asarray(values - terms @ np.linalg.lstsq(terms, values, rcond=None)[0])


def _near(touched: BoolArray) -> BoolArray:
    """Return which strips are touched or beside one that is: a contact at the ground end can pass for none."""
    near = touched.copy()
    near[:, 1:] |= touched[:, :-1]
    near[:, :-1] |= touched[:, 1:]
    return near
