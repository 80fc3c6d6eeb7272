"""Mains hum: a spectral line at 50 or 60 Hz, or its alias."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.diagnose.faults import Finding
from tacstrip.diagnose.log import Log
from tacstrip.diagnose.regression import regress_out

MAINS = (50.0, 60.0)  # Hz
_LINE = 14.0  # times the power at nearby frequencies: a line, not noise
_HUM = 0.0015  # over Vref: amplitude below which hum does not matter
_SHORTEST, _LONGEST = 32, 1024  # scans of a stretch
_APART = 4.0  # over a stretch's duration: frequencies that a Hann window separates


def hum(log: Log, sigma: float) -> tuple[list[Finding], str]:
    """Find mains hum in touched and in untouched readings; else say why it could not be looked for.

    On one strip alone its amplitude must exceed `sigma`, the standard deviation of a reading over Vref.
    """
    step = np.diff(log.time_s)
    if len(step) < _SHORTEST or float(np.median(step)) <= 0.0:
        return [], f"hum: needs {_SHORTEST} scans or more that follow each other in time"
    period = float(np.median(step))
    power = np.zeros((len(MAINS), 2, log.sensor.strips))  # on the line, and near it
    weight = np.zeros((len(MAINS), log.sensor.strips))
    for strip, time_s, values in _stretches(log, period):
        lasts = time_s[-1] - time_s[0]
        window = np.hanning(len(time_s) + 2)[1:-1]
        share = np.linspace(-1.0, 1.0, len(values))
        flat = regress_out(values, share, share**2)
        for i, mains in enumerate(MAINS):
            if not _resolvable(mains, period, lasts):
                continue
            other = MAINS[1 - i]
            shifts = np.concatenate([np.arange(-12, -3), np.arange(4, 13)]) / lasts
            nearby = mains + shifts[np.abs(mains + shifts - other) > _APART / lasts]
            amplitudes = _amplitudes(flat * window, time_s, np.append(nearby, mains)) * 2.0 / window.sum()
            if amplitudes[-1] > sigma and not _persistent(flat, time_s, mains):
                amplitudes[-1] = 0.0
            power[i, 0, strip] += amplitudes[-1] ** 2 * len(time_s)
            power[i, 1, strip] += float(np.median(amplitudes[:-1] ** 2)) * len(time_s)
            weight[i, strip] += len(time_s)
    if not weight.any():
        lines = " and ".join(f"{m:g}" for m in MAINS)
        return (
            [],
            f"hum at {lines} Hz: scans come too seldom, at {1.0 / period:.4g} a second, or the contacts are too short",
        )
    return list(_mains_lines(power, weight, sigma)), ""


def _mains_lines(power: FloatArray, weight: FloatArray, sigma: float) -> Iterator[Finding]:
    """Yield findings from the power on and near each line (2, 2, strips): for all strips together, or one by one."""
    with np.errstate(invalid="ignore", divide="ignore"):
        amplitude = np.sqrt(power[:, 0] / weight)
        ratio = power[:, 0] / np.maximum(power[:, 1], 1e-18)
        every = power[:, 0].sum(axis=1) / np.maximum(power[:, 1].sum(axis=1), 1e-18)
    loud = (ratio > _LINE) & (amplitude > _HUM)  # (mains, strips)
    known = (weight > 0.0).any(axis=0)
    i = int(np.argmax(np.where(weight.any(axis=1), every, -1.0)))
    level = float(np.sqrt(power[i, 0].sum() / weight[i].sum()))
    every_strip = every[i] > _LINE / 2.0 and (ratio[i, known] > 3.0).mean() > 0.7 and level > _HUM
    if every_strip or loud[i].sum() > 0.5 * known.sum():
        yield Finding(
            "hum", (), f"{MAINS[i]:g} Hz of +-{100 * level:.2g} % of Vref on all strips, "
            f"{every[i]:.3g} times the power at nearby frequencies",
            {"hertz": MAINS[i], "amplitude": level, "ratio": float(every[i])},
        )  # fmt: skip
        return
    loud &= amplitude > 1.5 * sigma
    for strip in np.flatnonzero(loud.any(axis=0)):
        j = int(np.argmax(np.where(loud[:, strip], ratio[:, strip], 0.0)))
        yield Finding(
            "hum", (int(strip),),
            f"{MAINS[j]:g} Hz of +-{100 * amplitude[j, strip]:.2g} % of Vref, {ratio[j, strip]:.3g} times the power "
            "at nearby frequencies",
            {"hertz": MAINS[j], "amplitude": float(amplitude[j, strip])},
        )  # fmt: skip


def _stretches(log: Log, period: float) -> Iterator[tuple[int, FloatArray, FloatArray]]:
    """Yield every strip's unbroken stretches, touched or untouched: strip, times and readings."""
    gap = np.append(np.diff(log.time_s) > 1.5 * period, True)
    for values in log.raw.values():
        for strip in range(log.sensor.strips):
            alive = np.isfinite(values[:, strip])
            for first, last in _runs(alive, log.touched[:, strip], gap):
                for start in range(first, last - _SHORTEST + 1, _LONGEST):
                    part = slice(start, min(start + _LONGEST, last))
                    if part.stop - part.start >= _SHORTEST:
                        yield strip, log.time_s[part], values[part, strip]


def _runs(alive: BoolArray, touched: BoolArray, gap: BoolArray) -> Iterator[tuple[int, int]]:
    """Yield the first and one past the last scan of unbroken runs."""
    breaks = gap.copy()
    breaks[:-1] |= (alive[1:] != alive[:-1]) | (touched[1:] != touched[:-1])
    first = 0
    for end in np.flatnonzero(breaks) + 1:
        if alive[first]:
            yield first, int(end)
        first = int(end)


def _resolvable(mains: float, period: float, lasts: float) -> bool:
    """Whether a line, or its alias, is far enough from 0 Hz and from half the sampling rate."""
    rate = 1.0 / period
    folded = abs(mains - rate * round(mains / rate))
    return folded > 5.0 / lasts and rate / 2.0 - folded > _APART / 2.0 / lasts


def _persistent(values: FloatArray, time_s: FloatArray, mains: float) -> bool:
    """Whether a line persists, rather than a few jumps: third differences are smaller without it."""
    turn = 2.0 * np.pi * mains * (time_s - time_s[0])
    with_line, without_line = (
        np.median(np.abs(np.diff(v, n=3))) for v in (values, regress_out(values, np.sin(turn), np.cos(turn)))
    )
    return bool(without_line < 0.85 * with_line)


def _amplitudes(values: FloatArray, time_s: FloatArray, hertz: npt.ArrayLike) -> FloatArray:
    turns = np.exp(-2j * np.pi * np.outer(np.asarray(hertz), time_s - time_s[0]))
    return np.asarray(np.abs(np.einsum("ft,t->f", turns, values)))  # without BLAS and its threads
