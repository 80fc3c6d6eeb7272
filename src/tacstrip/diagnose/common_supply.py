"""A loose ground or supply wire of all strips: their readings jump together, to one share of Vref and back.

A ground that is lifted by the share g makes k into g + (1 - g) k, a supply that is lowered by it k into (1 - g) k. So
all distances to the rail that holds, 1 - k or k, shrink by one factor. A contact that moves along the strips changes
the readings of both its ends by one amount instead, wherever it is; one that grows moves them apart.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.diagnose.faults import Finding, Question
from tacstrip.diagnose.log import Log

# The faults, and the rail that readings then move to.
LOOSE = {"loose-ground": "Vref", "loose-supply": "ground"}
_FEWEST, _STRIPS = 2, 3  # readings that tell a factor; strips that have jumped by it
# Logarithms of factors: of a share of 4 % to 90 %. Contacts off an end are on its rail.
_LEAST, _MOST = 0.04, 2.3
_FAR = 0.15  # over Vref: readings nearer to the rail that holds tell no factor
_LARGE = 4.0  # times what readings mostly do from one scan to the next: a jump
_LEFT = 0.2  # of a jump: what one factor may leave
_SAME, _NEAR = 0.1, 0.02  # of a logarithm, and of 1: factors that are one
_TIMES, _ASKED = 5, 2  # jumps of this factor: a finding, if two are to and two back; a question
_SHARE = 0.6  # of readings in jumps that a factor explains: those in jumps of this one
_OF_LARGE = 0.25  # the same, of readings in all jumps of half its size or more
_TURNS = 0.3  # of these, less one: that undo the one before, where none is unseen while nothing touches
_BETTER, _SURE = 4.0, 10.0  # times as much is left by a movement along the strips: a question, and a finding
_AT_END, _PARTS = 0.06, 3  # over Vref: a contact is at an end; of the recording, in the first and the last


@dataclass(frozen=True, eq=False)
class _Jumps:
    """Large changes from one scan to the next.

    before, after: distances to a rail over Vref (jumps, channels), either carried on for half a scan; 0 unless known;
    log_factor: of the one factor between them (jumps,); explained: whether that leaves little of the jump (jumps,).
    """

    before: FloatArray
    after: FloatArray
    known: BoolArray
    log_factor: FloatArray
    explained: BoolArray


def loose_supply(log: Log) -> tuple[list[Finding], list[Question], str]:
    """Find a ground or a supply that is lost now and then by all strips together.

    Returns
    -------
    findings, questions, unchecked
        One at most of the former two; and what was not to be seen in this recording, in words.
    """
    readings = np.concatenate(list(log.k.values()), axis=1)
    told: list[tuple[float, Finding | Question]] = []
    for fault, distance in (("loose-ground", 1.0 - readings), ("loose-supply", readings)):
        seen = _one_factor(_jumps(distance, log.time_s), log.sensor.strips)
        if seen is None:
            continue
        size, away, back, better, sure = seen
        share = 1.0 - float(np.exp(-size))
        evidence = (
            f"all readings go {100.0 * share:.2g} % of the way to {LOOSE[fault]} from one scan to the next, together, "
            f"{away} times, and come back {back} times; a movement along the strips leaves {better:.2g} times as much"
        )
        if sure:
            numbers = {"share": share, "jumps": float(away + back)}
            told.append((better, Finding(fault, (), evidence, numbers)))
        else:
            told.append((better, Question((), (fault,), evidence)))
    best = max(told, key=lambda one: one[0])[1] if told else None
    return (
        [best] if isinstance(best, Finding) else [],
        [best] if isinstance(best, Question) else [],
        "" if best else _lasting(log, readings),
    )


def _jumps(distance: FloatArray, time_s: FloatArray) -> _Jumps:
    """Return the large changes of distances to a rail (scans, channels), where four scans follow each other."""
    step = np.diff(time_s)
    even = step <= 1.5 * np.median(step) if len(step) else np.zeros(0, bool)
    before, after = 1.5 * distance[1:-2] - 0.5 * distance[:-3], 1.5 * distance[2:-1] - 0.5 * distance[3:]
    known = np.isfinite(before) & np.isfinite(after) & (even[:-2] & even[1:-1] & even[2:])[:, None]
    before, after, count = np.where(known, before, 0.0), np.where(known, after, 0.0), known.sum(axis=1)
    middle, told = 0.5 * (before + after), count >= _FEWEST
    with np.errstate(divide="ignore", invalid="ignore"):
        log_factor = np.log((after * middle).sum(axis=1) / (before * middle).sum(axis=1))
        size, far = (np.sqrt((v**2).sum(axis=1) / count) for v in (after - before, middle))
        root = np.exp(0.5 * log_factor)[:, None]
        left = np.sqrt(((after / root - before * root) ** 2).sum(axis=1) / count)
    size = np.where(told, size, 0.0)
    around = np.pad(size, 1)
    large = told & (np.abs(log_factor) > _LEAST) & (np.abs(log_factor) < _MOST) & (far > _FAR)
    large &= size >= np.maximum(around[:-2], around[2:])
    large &= size > _LARGE * np.median(size[told] if told.any() else 0.0)
    explained = left[large] < _LEFT * size[large]
    return _Jumps(before[large], after[large], known[large], log_factor[large], explained)


def _one_factor(jumps: _Jumps, strips: int) -> tuple[float, int, int, float, bool] | None:
    """Return the logarithm of the factor of most jumps, how many go and come back, how well it fits and if surely.

    It fits by the ratio of the variances that are left by jumps of one amount and of one factor.
    """
    sizes, weight = np.abs(jumps.log_factor), jumps.known.sum(axis=1)
    if not jumps.explained.any():
        return None
    told = sizes[jumps.explained]
    alike = np.abs(told[:, None] - told) <= np.maximum(_NEAR, _SAME * told)[:, None]
    size = float(np.median(told[alike[np.argmax(alike @ weight[jumps.explained])]]))
    ours = jumps.explained & (np.abs(sizes - size) <= max(_NEAR, _SAME * size))
    away = jumps.log_factor[ours] < 0.0
    count, turns = len(away), int(np.count_nonzero(np.diff(away)))
    if count < _ASKED or turns < max(1.0, _TURNS * (count - 1)):
        return None
    of_explained, of_large = weight[jumps.explained].sum(), weight[sizes > 0.5 * size].sum()
    if weight[ours].sum() < max(_SHARE * of_explained, _OF_LARGE * of_large):
        return None
    sound, lost = jumps.before[ours].copy(), jumps.after[ours].copy()
    sound[~away], lost[~away] = jumps.after[ours][~away], jumps.before[ours][~away]
    known = jumps.known[ours]
    if known.reshape(-1, strips).any(axis=0).sum() < _STRIPS:
        return None  # a strip of its own
    change = np.where(known, sound - lost, 0.0)
    factor = np.sum(change * sound) / np.sum(sound**2)
    left = max(float(np.sum((change - factor * sound)[known] ** 2)), 1e-12)
    better = float(np.sum((change[known] - change[known].mean()) ** 2)) / left
    # Between the same two places each reading changes by an amount of its own.
    times, same = known.sum(axis=0), change.sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    apart = np.inf
    if (free := int((times - 1)[times > 0].sum())) > 0:
        apart = float(np.sum((change - same)[known] ** 2)) / left * times.sum() / free
    sure = better > _SURE and apart > _BETTER and count >= _TIMES
    gone, back = int(away.sum()), int((~away).sum())
    return (size, gone, back, better, bool(sure and min(gone, back) >= _ASKED)) if better > _BETTER else None


def _lasting(log: Log, readings: FloatArray) -> str:
    """Say that a loss for good may not be seen: nothing came to both ends of the strips, early and late."""
    touched = np.flatnonzero(log.touched.any(axis=1))
    parts = [readings[rows] for rows in np.array_split(touched, _PARTS)[:: _PARTS - 1]]
    if all(
        len(p) and np.nanmin(p, initial=1.0) < _AT_END and np.nanmax(p, initial=0.0) > 1.0 - _AT_END
        for p in parts
    ):
        return ""
    return (
        "a ground or supply wire of all strips that is lost for good, or while nothing touches: push a contact over "
        "both ends of the strips, early and late in the recording"
    )
