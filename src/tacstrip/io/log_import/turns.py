"""Several sensors that write to one log in turn, which no column tells apart: seen from the readings themselves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.io.log_import.mapping import ColumnMapping
from tacstrip.io.log_import.questions import Clues
from tacstrip.io.log_import.scans import LogScan, in_turn

_MOST = 4  # sensors
_ROUNDS = 3  # of all sensors: of fewer, nothing is told
# Of the distance from scan to scan: a sensor's own scans are nearer, and clearly so where times come in turns, too.
_NEARER, _NEARER_IN_TURNS = 0.4, 0.7
_STEPS = 3.0  # times: so much longer is the pause after the last sensor
_TOUCHED = 0.5  # of a sensor's scans
_EVEN = 0.3  # relative: steps of one place in the turn
# Of the distance from the middle of the scans next to one: so near is it to that of its own turn, and how often.
_SMOOTHER, _MOSTLY = 0.3, 0.75
_AS_FAR = 0.02  # of the largest reading: nearer to the middle, readings are as smooth as their last digit


def with_turn(
    clues: Clues, mapping: ColumnMapping, rough: list[LogScan]
) -> tuple[ColumnMapping, list[LogScan]]:
    """Return the mapping and the scans of the one sensor that is meant, where several take turns; which one is asked.

    Raises
    ------
    OptionError
        The answer names no turn.
    """
    answer = clues.answers.get("turn", "")
    if answer == "all":
        return mapping, rough
    if answer:
        mapping = replace(mapping, turn=answer)
        mapping.check(f"--answer turn={answer}")
        clues.because(f"of the scans, which come in turns, those of turn {answer}")
        return mapping, in_turn(rough, answer)
    if many := turns(np.stack([s.values for s in rough]), np.array([s.time_s for s in rough])):
        clues.ask(
            "turn",
            f"each scan is like the one {many} before it, and unlike the one before it: do {many} sensors write to "
            f"the log in turn, and which is meant (the first: 1/{many})? If it is one sensor, all",
            *(f"{n + 1}/{many}" for n in range(many)), "all",
        )  # fmt: skip
    return mapping, rough


def turns(values: FloatArray, times: FloatArray) -> int:
    """Return how many sensors take turns in scans, (scans, strips, channels), by readings and times; 0: one only.

    Examples
    --------
    >>> one, other = np.full((9, 2, 1), 1.0), np.full((9, 2, 1), 2.0)
    >>> both = np.stack([one, other], axis=1).reshape(18, 2, 1) + 0.01 * np.arange(18)[:, None, None]
    >>> turns(both, np.arange(18.0)), turns(np.sort(both, axis=0), np.arange(18.0))
    (2, 0)
    """
    across = _apart(values, 1)
    for many in range(2, _MOST + 1):
        if len(values) < _ROUNDS * many:
            break
        touched = np.asarray(np.isfinite(values).any(axis=(1, 2)))
        if any(touched[n::many].mean() < _TOUCHED for n in range(many)):
            continue  # presses and what lies between them
        within = _apart(values, many)
        if min(np.median(across[n::many]) for n in range(many)) < np.median(within):
            continue  # a reading that is held for several scans
        if _in_turns(times, many):
            nearer = bool(np.median(within) < _NEARER_IN_TURNS * np.median(across))
        else:
            nearer = bool(np.quantile(within, 0.8) < _NEARER * np.quantile(across, 0.2))
            nearer = nearer or _smoother(values, many)
        if nearer:
            return many
    return 0


def _smoother(values: FloatArray, many: int) -> bool:
    """Return whether readings lie between those of their own turn, and not between those of the scans next to them.

    So are those of several contacts that move, and may meet on the way; noise is as far from both.
    """
    own, next_ = _off_middle(values, many), _off_middle(values, 1)
    next_ = next_[many - 1 : len(next_) - many + 1]
    both = np.isfinite(own) & np.isfinite(next_)
    if both.sum() < _ROUNDS * many:
        return False
    own, next_ = own[both], next_[both]
    usual = float(np.median(next_))
    return bool(
        usual > _AS_FAR * np.nanmax(np.abs(values), initial=0.0)
        and np.median(own) < _SMOOTHER * usual
        and (own < next_).mean() > _MOSTLY
    )


def _off_middle(values: FloatArray, lag: int) -> FloatArray:
    """Return how far each scan is from the middle of those `lag` before and after it, in the mean, (scans - 2 lag,)."""
    off = np.abs(values[lag:-lag] - 0.5 * (values[2 * lag :] + values[: -2 * lag]))
    there = np.isfinite(off)
    many = there.sum(axis=(1, 2))
    return np.where(many > 0, np.where(there, off, 0.0).sum(axis=(1, 2)) / np.maximum(many, 1), np.nan)


def _apart(values: FloatArray, lag: int) -> FloatArray:
    """Return how far scans are from those `lag` before, over the largest reading, (scans - lag,).

    A strip that is touched in one of both only is as far as can be.
    """
    top = float(np.nanmax(np.abs(values), initial=0.0)) or 1.0
    steps = np.abs(values[lag:] - values[:-lag]) / top
    either = np.isfinite(values[lag:]) | np.isfinite(values[:-lag])
    far = np.where(np.isnan(steps) & either, 1.0, np.nan_to_num(steps))
    return np.asarray(far.sum(axis=(1, 2)) / np.maximum(either.sum(axis=(1, 2)), 1))


def _in_turns(times: FloatArray, many: int) -> bool:
    """Return whether the steps of the time come in turns of so many, one far longer than another."""
    steps = np.diff(times)
    usual = np.array([np.median(steps[n::many]) for n in range(many)])
    even = all((np.abs(steps[n::many] - u) <= _EVEN * max(u, 1e-9)).all() for n, u in enumerate(usual))
    return even and bool(usual.max() > _STEPS * usual.min())
