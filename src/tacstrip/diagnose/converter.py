"""Faults of the A/D converter, its reference and the amplifier, from raw readings."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.diagnose.faults import Finding, Question
from tacstrip.diagnose.log import Log
from tacstrip.diagnose.regression import moved_to_and_fro
from tacstrip.robust import robust_sigma, shortest_half

_OVER = 0.02  # over Vref: what rounding and offsets may add
_FAR = 0.1  # over Vref: one reading so far out is enough
_BLOCKS = 16  # different settings of the higher bits, before a bit that never changes is called stuck
_VISITS, _APART = 2, 0.03  # of the end at Vref, and the part of the recording between two
# Of Vref: higher, clamps and a rim that no contact reaches do the same; below the first, no sound unit's do.
_SURE_CEILING, _NO_CEILING = 0.935, 0.955
_REST_MOVES = 0.012  # over Vref: what the contact's lowest reading changes while others stay at their ceiling
_LAGS = 200  # parts of a recording: a contact that does not move in one is held, and piles up anywhere
_ALONG, _ENOUGH = 0.4, 40  # over Vref, how far contacts move; readings of a strip
_BEYOND = 0.15  # of the readings at a strip's highest level: more above it, and it is not the highest
_OFTEN, _SEEN = 0.6, 0.4  # of the strips along which contacts move to and fro, and of all
_SOME, _SOME_SEEN = 0.4, 0.25  # the same for a question
_MOVING = 0.6  # of the strips' levels: the contact's lowest reading moves at the others
_SURE_ALIKE, _ALIKE = 0.03, 0.045  # over Vref: scatter of their levels; more than the first is a question
_PILE, _PILE_ASKED = 3.5, 2.5  # times as dense as below; for a question
_SLANTED = 0.75  # of the variance of their levels, in a line or a bow across the strips
# Steps and over Vref, of noise that would show; over Vref, of ends, where converters stop; readings at a level.
_RESOLVED, _LEAST_RESOLVED, _ENDS, _CUT_OFF = 1.2, 2e-4, 0.03, 8
_WHOLE = 0.02  # of a step: rounding of volts printed to four decimals


def stuck_bits(log: Log) -> tuple[list[Finding], str]:
    """Find bits that never change, in all channels together; else say why that could not be looked at."""
    bits = log.sensor.adc_bits
    if bits is None:
        return [], "A/D bits: the spec has no adc_bits"
    steps = np.concatenate([v[np.isfinite(v)] for v in log.raw.values()]) * (2.0**bits - 1.0)
    codes = np.unique(np.round(steps[(steps > 0.5) & (steps < 2.0**bits - 1.5)]).astype(np.int64))
    if len(steps) and float(np.abs(steps - np.round(steps)).max()) > _WHOLE:
        return [], "A/D bits: the readings are no whole codes of adc_bits; record the codes themselves"
    tested = [b for b in range(bits) if len(np.unique(codes >> (b + 1))) >= _BLOCKS]
    if not tested:
        return [], f"A/D bits: only {len(codes)} different codes; move the contact"
    stuck = [b for b in tested if len(np.unique((codes >> b) & 1)) == 1]
    seldom = f"A/D bits {max(tested) + 1} and above: they change too seldom"
    not_tested = seldom if max(tested) < bits - 1 else ""
    if not stuck:
        return [], not_tested
    at = [int(codes[0] >> b) & 1 for b in stuck]
    names = ", ".join(f"{b} at {v}" for b, v in zip(stuck, at, strict=True))
    left = f"; {bits - len(stuck)} of {bits} bits are left" if stuck == list(range(len(stuck))) else ""
    finding = Finding(
        "bits", (), f"bit(s) {names} in every one of {len(steps)} readings, {len(codes)} different codes{left}",
        {"stuck_bits": float(len(stuck)), "lowest": float(stuck[0]), "codes": float(len(codes))},
    )  # fmt: skip
    return [finding], not_tested


def wrong_reference(log: Log, sigma: float) -> tuple[list[Finding], list[Question], float]:
    """Find readings above Vref or below ground, and a common ceiling below Vref.

    Returns
    -------
    findings, questions, factor
        Readings over their own Vref are the log's divided by `factor`.
    """
    margin = max(_OVER, 3.0 * sigma)
    over, far = np.zeros((2, len(log.time_s), log.sensor.strips), dtype=bool)
    for values in log.raw.values():
        over |= (values > 1.0 + margin) | (values < -margin)
        far |= (values > 1.0 + _FAR) | (values < -_FAR)
    known = np.any([np.isfinite(v) for v in log.raw.values()], axis=0).sum(axis=0)
    often = over.sum(axis=0) >= np.maximum(2.0, 0.01 * known)
    every = np.concatenate([v[np.isfinite(v)] for v in log.raw.values()])
    top, least = float(every.max()), float(every.min())
    if often.sum() >= max(2.0, 0.3 * np.count_nonzero(known)):
        volts = log.sensor.vref_volt
        hint = "; millivolts?" if 200.0 < top < 1500.0 else ""
        finding = Finding(
            "wrong-vref", (),
            f"{int(over.sum())} readings on {int(often.sum())} strips lie outside 0 to Vref = {volts:.6g} V: "
            f"{least * volts:.5g} to {top * volts:.5g} V{hint}",
            {"factor": top, "readings": float(over.sum()), "strips": float(often.sum())},
        )  # fmt: skip
        return [finding], [], max(top - margin, 1.0)
    found = [
        Finding(
            "wrong-vref", (int(i),),
            f"{int(over[:, i].sum())} reading(s) lie outside 0 to Vref, the first in scan "
            f"{int(over[:, i].argmax())}, on this strip alone",
            {"readings": float(over[:, i].sum())},
        )
        for i in np.flatnonzero(often | far.any(axis=0))
    ]  # fmt: skip
    factor, sure = _end_level(log, sigma)
    if factor is None:
        return found, [], 1.0
    evidence = (
        f"{'all' if sure else 'several'} strips' readings pile up at {factor:.4g} of Vref, each time that a contact "
        "gets there, as at the end: "
        f"Vref is {factor * log.sensor.vref_volt:.4g} V, or the gain {factor:.4g}"
    )
    if factor > _SURE_CEILING or not sure:
        return (
            found,
            [Question((), ("wrong-vref",), f"{evidence}; a frame over the strips' ends does it too")],
            1.0,
        )
    return [Finding("wrong-vref", (), evidence, {"factor": factor}), *found], [], factor


def _end_level(log: Log, sigma: float) -> tuple[float | None, bool]:
    """Return the level below 1 at which strips' readings pile up, each at its own but alike, and whether most do.

    None without one.

    A contact that leaves over the end at Vref reads 1 (3.3), (3.8) all the while, whatever its length and wherever the
    rest of it goes. Others reach the same height on all strips only if they lie straight, or are not moved along them.
    """
    k = log.k
    top = k.get("kh", k.get("k"))
    if top is None or not log.sensor.kind.closed_form:
        return None, False
    lag = max(1, len(top) // _LAGS)
    every = np.concatenate([*k.values()], axis=1)
    filled, least = np.nan_to_num(every, nan=-1.0), max(0.01, 6.0 * sigma)
    moved = np.abs(filled[lag:] - filled[:-lag]) > least
    # A contact that is held piles up anywhere; it is put down and lifted, too.
    changed = np.zeros(len(top), dtype=bool)
    both = moved[lag:] & moved[:-lag]
    stray = both & ~(np.abs(filled[2 * lag :] - filled[: -2 * lag]) > least)  # goes and comes back
    changed[lag:-lag] = (moved[lag:] & ~stray).any(axis=1) & (moved[:-lag] & ~stray).any(axis=1)
    lowest = np.fmin.reduce(every, axis=1)
    wide = max(0.006, 2.0 * sigma)
    found: list[tuple[float, float, float, float]] = []
    seen, tested = 0, 0
    scans = np.zeros(len(top), dtype=bool)  # in which a strip is at its level
    for strip, values in enumerate(top.T):
        here = np.flatnonzero(np.isfinite(values) & changed)
        own = values[here]
        seen += len(own) >= 20
        if len(own) < _ENOUGH or not moved_to_and_fro(own, sigma, _ALONG):
            continue
        tested += 1
        near = np.sort(own[own > np.sort(own)[-3] - 0.12])
        count = np.searchsorted(near, near + 2.0 * wide) - np.arange(len(near))
        at = int(np.argmax(count))
        level = float(near[at]) + wide
        below = (
            np.count_nonzero((own > level - 0.1) & (own < level - 2.0 * wide))
            * 2.0
            * wide
            / (0.1 - 2.0 * wide)
        )
        if np.count_nonzero(own > level + 1.5 * wide) > _BEYOND * count[at]:
            continue
        there = np.abs(own - level) <= 1.001 * wide  # of rounding
        scans[here[there]] = True
        found.append((level, count[at] / max(below, 1.0), float(np.std(lowest[here[there]])), float(strip)))
    if len(found) < max(4, _SOME * tested, _SOME_SEEN * seen):
        return None, False
    sure = len(found) >= max(_OFTEN * tested, _SEEN * seen)
    level, pile, moves, across = np.array(found).T
    sure &= _in_a_curve(across, level) < _SLANTED
    middle = float(np.median(level))
    scatter = float(robust_sigma(level - middle))
    # One reference and like clamps: where contacts stop by themselves, the levels differ more.
    sure &= scatter < _SURE_ALIKE
    if not 0.4 < middle < _NO_CEILING - scatter / np.sqrt(len(level)) or scatter > _ALIKE:
        return None, False
    # A contact at the end of one strip is not there on the next: of all strips together.
    visits = np.count_nonzero(np.diff(np.flatnonzero(scans)) > _APART * len(top)) + 1
    dense = float(np.median(pile))
    moving = float(np.quantile(moves, _MOVING)) > _REST_MOVES
    piled = moving and visits >= _VISITS and dense > (_PILE_ASKED if sure else _PILE)
    return (middle, bool(sure and dense > _PILE)) if piled else (None, False)


def _in_a_curve(across: FloatArray, level: FloatArray) -> float:
    """Return the share of the variance of strips' levels (strips,) that a line, or a parabola but for chance, explains.

    Levels that rise from strip to strip are of a slanted contact that is lifted there; in a bow, of one that circles.
    """
    if np.ptp(level) == 0.0:
        return 0.0
    many, x = len(level), across - across.mean()
    left = [float(np.var(level - np.polyval(np.polyfit(x, level, n), x)) / np.var(level)) for n in (1, 2)]
    return max(1.0 - left[0], 1.0 - left[1] * (many - 1) / max(many - 3, 1))


def common_ceiling(log: Log, sigma: float) -> Iterator[Finding]:
    """Find a level that many strips' readings stop at: an amplifier that saturates cuts the noise off too."""
    if sigma < max(log.sensor.adc_step, 2e-4):
        return
    for sign, side in ((1.0, "above"), (-1.0, "below")):
        values = [sign * np.where(log.touched, v, np.nan) for v in log.raw.values()]
        level = float(np.fmax.reduce([np.fmax.reduce(v, axis=None) for v in values]))
        if not np.isfinite(level) or abs(level) < 0.015 or abs(level - 1.0) < 0.015 or level > 1.0:
            continue
        at, below, strips = _count_at_level(values, level, 0.6 * log.sensor.adc_step + 1e-9, 2.0 * sigma)
        if at >= 20 and at > 2 * below and strips >= 3:
            evidence = (
                f"{at} readings on {strips} strips are just {sign * level:.5g} Vref and none is {side}; noise alone "
                f"would spread them by {100 * sigma:.2g} %"
            )
            numbers = {"level": sign * level, "side": sign, "readings": float(at)}
            yield Finding("saturation", (), evidence, numbers)


def single_ceilings(log: Log, sigma: float) -> Iterator[Finding]:
    """Find channels that stop at a level of their own, where noise is cut off, too, as no contact does."""
    if sigma < max(_RESOLVED * log.sensor.adc_step, _LEAST_RESOLVED):
        return
    for name, raw in log.raw.items():
        touched = np.pad(np.where(log.touched, raw, np.nan), ((0, 0), (1, 1)), constant_values=np.nan)
        for strip in np.flatnonzero(log.touched.any(axis=0)).tolist():
            values, beside = touched[:, strip + 1], touched[:, [strip, strip + 2]]
            beside, values = beside[np.isfinite(values)], values[np.isfinite(values)]
            for sign, side in ((1.0, "above"), (-1.0, "below")) if len(values) >= _ENOUGH else ():
                level = float((sign * values).max())
                if not _ENDS < sign * level < 1.0 - _ENDS:
                    continue
                tie = 0.6 * log.sensor.adc_step + 1e-9
                at, below, _ = _count_at_level([sign * values[:, None]], level, tie, 3.0 * sigma)
                if (
                    at >= _CUT_OFF
                    and at > 3 * below
                    and _scatter(beside[sign * values >= level - tie], sigma)
                ):
                    evidence = (
                        f"{at} readings are just {sign * level:.5g} Vref and none is {side}; noise alone would "
                        f"spread them by {100 * sigma:.2g} %"
                    )
                    numbers = {"level": sign * level, "readings": float(at)}
                    yield Finding("saturation", (strip,), evidence, numbers, name)


def _scatter(beside: FloatArray, sigma: float) -> bool:
    """Whether a strip beside (scans, 2) does; strips that are covered wholly stay, with less noise than sigma."""
    known = [v[(v > _ENDS) & (v < 1.0 - _ENDS)] for v in beside.T]  # off the rails, which cut off noise, too
    lengths = [shortest_half(v) for v in known if len(v) >= _CUT_OFF // 2]
    return not lengths or max(lengths) > sigma / 2.0


def _count_at_level(values: list[FloatArray], level: float, tie: float, near: float) -> tuple[int, int, int]:
    """Count the readings at a level and those just below it, and the strips that have some at it."""
    at = [v >= level - tie for v in values]
    below = sum(int(((v < level - tie) & (v >= level - near)).sum()) for v in values)
    return sum(int(a.sum()) for a in at), below, int(np.any([a.any(axis=0) for a in at], axis=0).sum())
