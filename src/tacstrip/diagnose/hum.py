"""Mains hum: a spectral line at 50 or 60 Hz, or its alias."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.diagnose.faults import Finding
from tacstrip.diagnose.log import Log

MAINS = (50.0, 60.0)  # Hz
_LINE, _LINE_ONCE = 14.0, 20.0  # times the power at nearby frequencies: a line, not noise; of one segment
_LINE_ALONE = 100.0  # times, on some strips only: jumps of a contact's ends make 60 on a sound strip
_LINE_APART, _APART = 20.0, 6.0  # times, and times any other strip's: jumps of a contact are on several
_LINE_WIDE, _LOUDER = 8.0, 4.0  # times the power near it, and times the amplitude on any other strip
_OTHERS = 2  # strips read as long: of one, or two at a contact's rim, jumps may be on no other
_HALF = 4.0  # times, in each half of the recording: a few jumps are no line
_HUM = 0.0015  # over Vref: amplitude below which hum does not matter
_SEGMENT_S = 1.0  # in which a line keeps its phase, whatever the clock and the mains do
# Of one witness: a contact that moves evenly makes a line, too, next to that of the mains.
_SEGMENT_SHEET_S = 5.0
_SHORTEST = 32  # scans of a segment
_FEWEST = 24  # readings of a strip
_CLIP = 5.0  # times the median: jumps
_BELOW = 2  # nearby frequencies
_NEAR = np.setdiff1d(np.arange(-14, 15), np.arange(-2, 3)) * 0.7  # nearby frequencies, in 1 / visit


def hum(log: Log, sigma: float) -> tuple[list[Finding], str]:
    """Find mains hum in touched and in untouched readings; else say why it could not be looked for.

    On one strip alone its amplitude must exceed half of `sigma`, the standard deviation of a reading over Vref.
    """
    step = np.diff(log.time_s)
    if len(step) < _SHORTEST or float(np.median(step)) <= 0.0:
        return [], f"hum: needs {_SHORTEST} scans or more that follow each other in time"
    period = float(np.median(step))
    if log.sensor.kind.closed_form:
        long = max(min(int(_SEGMENT_S / period), len(log.time_s) // 4), 2 * _SHORTEST)
    else:
        long = max(int(_SEGMENT_SHEET_S / period), 2 * _SHORTEST)
    segments = max(len(log.time_s) // long, 1)
    lines = [
        _line(log, mains, period, np.linspace(0, len(log.time_s), segments + 1).astype(int))
        for mains in MAINS
    ]
    hidden = [f"{mains:g}" for mains, (_, count) in zip(MAINS, lines, strict=True) if not count.any()]
    rate = f"{1.0 / period:.4g} scans a second"
    unchecked = f"hum at {' and '.join(hidden)} Hz: not to be told at {rate}, or the contacts are too short"
    if len(hidden) == len(MAINS):
        return [], unchecked
    power, counts = ([line[part] for line in lines] for part in (0, 1))
    found = list(_mains_lines(power, counts, sigma, log.sensor.kind.closed_form))
    return found, unchecked if hidden and not found else ""


def _line(log: Log, mains: float, period: float, edges: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return squared amplitudes on a line and near it (2, segments, strips), and the readings used, likewise.

    A reading less the mean of those half a turn before and after it doubles the line and removes motion.
    """
    rate = 1.0 / period
    folded = abs(mains - rate * round(mains / rate))
    strips, segments = log.sensor.strips, len(edges) - 1
    power, counts = np.zeros((2, segments, strips)), np.zeros((segments, strips))
    lasts = (edges[1] - edges[0]) * period
    # Near half the scan rate the line's phase goes round over the segments.
    if folded * lasts < 5.0 or (rate / 2.0 - folded) * period * len(log.time_s) < 1.0:
        return power, counts
    lag = max(1, round(rate / (2.0 * folded)))
    gain = 1.0 - np.cos(2.0 * np.pi * folded * period * lag)
    other = MAINS[1 - MAINS.index(mains)]
    resolved = min(_typical_visit(log) * period, lasts)  # shorter visits widen a line
    nearby = mains + _NEAR / resolved
    nearby = nearby[(np.abs(nearby - other) > 3.0 / resolved) & (nearby > 5.0 / resolved)]
    aside = np.abs(nearby - rate * np.round(nearby / rate))
    gains = 1.0 - np.cos(2.0 * np.pi * aside * period * lag)
    use = gains > 0.3 * gain
    below = aside[use] < folded
    # Motion has the more power the lower the frequency: what it has at the line lies between both sides' power.
    if use.sum() < 5 or below.sum() < _BELOW:
        return power, counts
    hertz = np.concatenate([mains + np.array([-0.4, 0.0, 0.4]) / lasts, nearby[use]])
    gains = np.concatenate([np.full(3, gain), gains[use]])
    slot = np.round((log.time_s - log.time_s[0]) / period).astype(int)
    even = np.abs(slot[2 * lag :] - slot[: -2 * lag] - 2 * lag) < 1
    for values in log.raw.values():
        bend = np.full_like(values, np.nan)
        bend[lag:-lag] = values[lag:-lag] - (values[: -2 * lag] + values[2 * lag :]) / 2.0
        same = (log.touched[lag:-lag] == log.touched[: -2 * lag]) & (
            log.touched[lag:-lag] == log.touched[2 * lag :]
        )
        bend[lag:-lag][~(same & even[:, None])] = np.nan
        known = np.isfinite(bend)
        bend = np.where(known, bend, 0.0)
        size = np.abs(bend).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
        bend = np.clip(bend, -_CLIP * size, _CLIP * size)
        for s, (a, b) in enumerate(pairwise(edges.tolist())):
            at = slot[a:b] - slot[a]
            long = 4 * (b - a)
            inside = (at >= 0) & (at < long)
            if not inside.all():  # a pause
                at, a, b = at[inside], a, a + int(inside.sum())
            grid = np.zeros((long, strips))
            grid[at] = bend[a : a + len(at)]
            spectrum = np.fft.rfft(grid, axis=0)
            bins = np.round(np.abs(hertz - rate * np.round(hertz / rate)) * period * long).astype(int)
            count = known[a:b].sum(axis=0)
            found = 4.0 * np.abs(spectrum[bins]) ** 2 / (gains[:, None] * np.maximum(count, 1)) ** 2
            count = np.where(count >= _FEWEST, count, 0)
            power[0, s] += found[:3].max(axis=0) * count
            sides = [np.median(found[3:][side], axis=0) for side in (below, ~below) if side.any()]
            power[1, s] += np.prod(sides, axis=0) ** (1.0 / len(sides)) * count
            counts[s] += count
    return power, counts


def _typical_visit(log: Log) -> float:
    """Return the median number of scans that a strip stays as it is, touched or untouched, weighted by itself."""
    changes = np.diff(log.touched, axis=0)
    runs = [np.diff(np.flatnonzero(np.concatenate([[True], c, [True]]))) for c in changes.T]
    each = np.sort(np.concatenate(runs))
    return float(each[np.searchsorted(np.cumsum(each), each.sum() / 2.0)])


def _mains_lines(
    powers: list[FloatArray], counts: list[FloatArray], sigma: float, apart: bool
) -> Iterator[Finding]:
    """Yield findings from power on and near each line: for all strips together, or one by one.

    `apart`: whether a strip's readings depend on its own contact alone.
    """
    sums = np.stack([p.sum(axis=1) for p in powers])  # (mains, on or near, strips)
    weight = np.stack([c.sum(axis=0) for c in counts])
    with np.errstate(invalid="ignore", divide="ignore"):
        amplitude = np.sqrt(sums[:, 0] / weight)
        ratio = sums[:, 0] / np.maximum(sums[:, 1], 1e-18)
        every = sums[:, 0].sum(axis=1) / np.maximum(sums[:, 1].sum(axis=1), 1e-18)
        lasting = np.stack([_lasting(p, c) for p, c in zip(powers, counts, strict=True)])
    once = np.stack([(c > 0.0).sum(axis=0) < 2 for c in counts])
    loud = (
        (ratio > np.where(once, _LINE_ONCE, _LINE)) & (amplitude > _HUM) & (lasting | once)
    )  # (mains, strips)
    known = np.asarray((weight > 0.0).any(axis=0))
    i = int(np.argmax(np.where(weight.any(axis=1), every, -1.0)))
    level = float(np.sqrt(sums[i, 0].sum() / weight[i].sum()))
    # A sheet's strips shift each other's readings: they are one witness.
    shared = (
        every[i] > (_LINE / 2.0 if apart else _LINE_ONCE)
        and np.mean(ratio[i, known] > 3.0) > 0.7
        and level > _HUM
    )
    seen = known & ~once[i]
    together = _lasting(powers[i].sum(axis=2)[..., None], counts[i].sum(axis=1)[:, None])
    shared = shared and bool(np.mean(lasting[i, seen]) > 0.5 if seen.sum() > 2 else together.all())
    if known.sum() > 2 and (shared or (apart and np.sum(loud, axis=1)[i] > 0.5 * known.sum())):
        evidence = f"{MAINS[i]:g} Hz of +-{100 * level:.2g} % of Vref on all strips, "
        evidence += f"{every[i]:.3g} times the power near it"
        numbers = {"hertz": MAINS[i], "amplitude": level, "ratio": float(every[i])}
        yield Finding("hum", (), evidence, numbers)
        return
    ratio = np.where(weight > 0.0, ratio, 0.0)
    amplitude = np.where(weight > 0.0, amplitude, 0.0)
    next_loud, next_amplitude = (
        np.stack([np.delete(v, i, axis=1).max(axis=1, initial=0.0) for i in range(v.shape[1])], axis=1)
        for v in (ratio, amplitude)
    )
    outstanding = ~once & lasting & (ratio > _APART * next_loud) & (amplitude > max(_HUM, sigma))
    outstanding &= (weight > 0.0).sum(axis=1, keepdims=True) > _OTHERS
    # Short visits widen a line: it stands out of what is near it by less, and of other strips as much.
    outstanding &= (ratio > _LINE_APART) | ((ratio > _LINE_WIDE) & (amplitude > _LOUDER * next_amplitude))
    loud &= (amplitude > 0.5 * sigma) & (ratio > _LINE_ALONE)
    loud |= apart & outstanding
    for strip in np.flatnonzero(loud.any(axis=0)):
        j = int(np.argmax(np.where(loud[:, strip], ratio[:, strip], 0.0)))
        size, times = amplitude[j, strip], ratio[j, strip]
        evidence = f"{MAINS[j]:g} Hz of +-{100 * size:.2g} % of Vref, {times:.3g} times the power near it"
        yield Finding("hum", (int(strip),), evidence, {"hertz": MAINS[j], "amplitude": float(size)})


def _lasting(power: FloatArray, counts: FloatArray) -> BoolArray:
    """Return whether a line (2, segments, strips) stands out in both halves of each strip's readings (strips,)."""
    first = np.cumsum(counts, axis=0) - 0.5 * counts < 0.5 * counts.sum(axis=0)
    halves = np.stack([(power * half).sum(axis=1) for half in (first, ~first)])
    return np.asarray((halves[:, 0] > _HALF * halves[:, 1]).all(axis=0))
