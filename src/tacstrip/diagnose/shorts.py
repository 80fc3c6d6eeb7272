"""Bridges between neighbouring strips or their wires."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.diagnose.bend_model import BendModel
from tacstrip.diagnose.neighbour_pairs import NeighbourPair, neighbour_pair
from tacstrip.diagnose.neighbour_prediction import Suspect, WorkingCopy
from tacstrip.diagnose.regression import moved_to_and_fro, orthogonal_part, orthonormal
from tacstrip.sensor.constructions import SIGNATURES, Signature

_FEW, _MANY = 8, 25  # places
_HEIGHTS = np.linspace(0.0, 1.0, 9)  # over L, at which a bridge is looked for
_CLEAR = 0.1  # over Vref: contacts this far from a bridge lie wholly on one side
_FOLLOWS = 0.15  # of the slope around: 1 for two separate strips, 0 for two that are tied
_FOLLOWS_ELSEWHERE = 0.5  # of the slope: an extrapolated line says nothing where other pairs follow it less
_MOST_OFFSET = 0.75  # of the slope: largest offset of tied strips; 1.5 beside a jump
_MOST = (0.95, 0.35)  # of the places with a slope: those that differ little, and those that lie near the line
_STRENGTH = (0.45, 1.9)  # times what a bridge does to readings
# Misfit explained, in variances, and times that of other pairs; at the edges less: two pairs have few chances.
_GAIN, _TIMES = (80.0, 45.0), (3.0, 2.2)
_APART = 2  # strips: pairs further away are others
_CONFOUNDED = 0.05  # of its power: what a bridge must do beyond shape and constant errors
_LEAST = 0.005  # over Vref: standard deviation of what a bridge adds
_HIGH_AND_LOW = 0.5  # over L: a bridge adds on one side and takes away on the other, which must be seen
_LENGTH = 0.6  # over L: readings jump by the contact's length at a bridge; longer contacts show nothing
_GRID = np.linspace(0.0, 1.0, 11)
_PLACES = np.array([(a, b) for i, a in enumerate(_GRID) for b in _GRID[i:] if b - a <= _LENGTH]).T
_SHAPE = 0.7  # of the slope's variance: if the contact's place explains more, its shape does


def shorts(work: WorkingCopy) -> Iterator[Suspect]:
    """Find neighbours that are tied together.

    Tied sensing strips or wires read one voltage, whatever the slope of the contact. Over metal, where strips are
    energised in turn, a bridge between energised strips gives the current a second way to the sheet: both read too
    much for contacts below the bridge and too little above it. Between CRS-CRS's energised strips, all on one
    supply, a bridge changes next to nothing.
    """
    return _bridged_energised(work) if work.sensor.sensing_ratio == 0.0 else _tied_sensing(work)


def _tied_sensing(work: WorkingCopy) -> Iterator[Suspect]:
    ends = _left_ends(work)
    signatures = [SIGNATURES[name] for name in work.k]
    pairs = {i: [neighbour_pair(work.k[s.name], i) for s in signatures] for i in range(work.strips - 1)}
    free = {i: max([float(np.std(b.excess)) for b in of if b], default=0.0) for i, of in pairs.items()}
    usual = float(np.median(list(free.values()))) if free else 0.0
    for strip, of in pairs.items():
        if free[strip] < 0.5 * usual or not all(moved_to_and_fro(b.level, work.sigma) for b in of if b):
            continue
        found: list[Suspect] = []
        for height in _HEIGHTS:
            # A bridge ties v_h of contacts below it, and v_l of contacts above it.
            parts = [
                (b, (b.level < height - _CLEAR) if s.at_upper_end else (b.level > height + _CLEAR))
                for s, b in zip(signatures, of, strict=True)
                if b is not None
            ]
            there = [_Part.of(b, at, ends, strip) for b, at in parts if at.sum() >= _FEW]
            found += _tied_at(work, strip, there, free[strip])
        if found and not _shape_ties(work, strip, signatures, ends):
            yield max(found, key=lambda suspect: suspect.finding.numbers["places"])


def _shape_ties(work: WorkingCopy, strip: int, signatures: list[Signature], ends: IntArray) -> bool:
    """Whether, at an edge, the line extrapolated from one side ties other pairs of strips as well."""
    if 0 < strip < work.strips - 2:
        return False
    beyond = 1 if strip == 0 else -1
    others = range(3, work.strips - 3) if strip == 0 else range(2, work.strips - 4)
    follows = []
    for other in others[:: max(len(others) // 8, 1)]:
        pairs = [pair for s in signatures if (pair := neighbour_pair(work.k[s.name], other, beyond))]
        parts = [_Part.of(p, np.ones(len(p.level), bool), ends, other) for p in pairs if len(p.level) >= _FEW]
        d, e = (
            np.concatenate([getattr(p, n) for p in parts] or [np.zeros(0)]) for n in ("difference", "slope")
        )
        if len(e) >= _MANY:
            follows.append(float(np.sum(d * e) / max(np.sum(e**2), 1e-12)))
    return len(follows) < 2 or min(follows) < _FOLLOWS_ELSEWHERE


@dataclass(frozen=True, eq=False)
class _Part:
    """A pair of neighbours at some places, without what changes smoothly with height (places,)."""

    difference: FloatArray
    slope: FloatArray
    offset: FloatArray
    ends: IntArray

    @classmethod
    def of(cls, pair: NeighbourPair, at: BoolArray, ends: IntArray, strip: int) -> _Part:
        level = pair.level[at]  # offsets that fade at the ends do
        basis = orthonormal(np.ones(len(level)), level, level**2)
        d, e, both = (orthogonal_part(v[at], basis) for v in (pair.difference, pair.slope, pair.offset))
        return cls(d, e, both, ends[pair.rows[at], strip])


def _tied_at(work: WorkingCopy, strip: int, parts: list[_Part], explained: float) -> Iterator[Suspect]:
    """Judge the places where a bridge at some height would tie two strips."""
    if not parts:
        return
    d, e, both, ends = (
        np.concatenate([getattr(p, name) for p in parts])
        for name in ("difference", "slope", "offset", "ends")
    )
    slope = float(np.std(e))
    steep = np.abs(e) > max(0.006, 3.0 * work.sigma)
    many = _MANY if 0 < strip < work.strips - 2 else 2 * _MANY  # at an edge the line is extrapolated
    if steep.sum() < many or _explained(e, ends) > _SHAPE:
        return
    d, e, both = d[steep], e[steep], both[steep]
    follows = float(np.sum(d * e) / np.sum(e**2))
    # Two strips on one flat piece beside a jump differ as little, but both lie off the line.
    little = float(np.mean(np.abs(d) < 0.35 * np.abs(e) + 2.0 * work.sigma))
    near = float(np.mean(np.abs(both) < _MOST_OFFSET * np.abs(e) + 1.5 * work.sigma))
    if abs(follows) > _FOLLOWS or little < _MOST[0] or near < _MOST[1]:
        return
    evidence = (
        f"they differ by {100 * np.mean(np.abs(d)):.2g} % of Vref where the strips around slope by "
        f"+-{100 * slope:.2g} % a strip, over {len(d)} readings: they follow the slope by {follows:.2f}, not 1"
    )
    numbers = {"follows": follows, "slope": slope, "places": len(d)}
    yield work.suspect("short", [strip, strip + 1], evidence, numbers, explained)


def _bridged_energised(work: WorkingCopy) -> Iterator[Suspect]:
    (values,) = work.k.values()
    changes = []
    for i in range(work.strips - 1):
        change = bridge_effect(_level(values, i)[:, None], *_PLACES)
        changes.append([{i: change, i + 1: change}])
    for strip, bridge, others in _outstanding(work, changes):
        added = bridge.strength * changes[strip][0][strip][:, bridge.which]
        size, most, least = (float(f(added)) for f in (np.nanstd, np.nanmax, np.nanmin))
        if size > _LEAST and moved_to_and_fro(_known(_level(values, strip)), work.sigma, _HIGH_AND_LOW):
            evidence = (
                f"both read {100 * most:+.3g} to {100 * least:+.3g} % of Vref off their neighbours' line from height "
                f"to height, {bridge.strength:.2g} times the effect of an ideal bridge, which explains "
                f"{bridge.gain / max(others, 1e-9):.2g} times as much as between other strips"
            )
            numbers = {"most": most, "least": least, "strength": bridge.strength, "gain": bridge.gain}
            yield work.suspect("short", [strip, strip + 1], evidence, numbers, size)


@dataclass(frozen=True)
class _Bridge:
    """The bridge between two neighbours that explains most: times its ideal effect, misfit explained, which one."""

    strength: float
    gain: float
    which: int


def _outstanding(
    work: WorkingCopy, changes: Sequence[Sequence[Mapping[int, FloatArray]]]
) -> Iterator[tuple[int, _Bridge, float]]:
    """Yield pairs whose bridge explains much more than any between strips further away, and the most of these.

    `changes`, of each pair and signature: what alternative bridges do to each of its strips (places, alternatives).
    """
    models = [BendModel.of(work, name) for name in work.k]
    found = [_best(models, change) for change in changes]
    for strip, bridge in enumerate(found):
        others = max((b.gain for i, b in enumerate(found) if abs(i - strip) > _APART), default=math.inf)
        near = max((b.gain for i, b in enumerate(found) if 0 < abs(i - strip) <= _APART), default=0.0)
        at_edge = strip in (0, len(found) - 1)
        least = max(_GAIN[at_edge], _TIMES[at_edge] * others, near)
        if _STRENGTH[0] < bridge.strength < _STRENGTH[1] and bridge.gain > least:
            yield strip, bridge, others


def _best(models: Sequence[BendModel | None], changes: Sequence[Mapping[int, FloatArray]]) -> _Bridge:
    """Return the alternative that explains most of two strips' bends, all signatures together."""
    power, score, whole = np.zeros((3, next(iter(changes[0].values())).shape[1]))
    for model, change in zip(models, changes, strict=True):
        if model is not None:
            for total, part in zip((power, score, whole), model.alternatives(change), strict=True):
                total += part / model.sigma**2
    strength = np.where(power > _CONFOUNDED * whole, score / np.maximum(power, 1e-12), 0.0)
    gain = np.where(strength > 0.0, strength * score, 0.0)
    best = int(np.argmax(gain))
    return _Bridge(float(strength[best]), float(gain[best]), best)


def bridge_effect(level: FloatArray, low: float | FloatArray, high: float | FloatArray) -> FloatArray:
    """Return what a bridge adds to readings over Vref, of contacts that read `level`.

    Between contact and bridge the neighbour is parallel to the strip, which halves the resistance there. A contact
    has some length: its readings go from `low` to `high` while it lies on the bridge, which then has no effect.
    """
    below = np.minimum(level, low)
    above = np.maximum(level, high)
    return np.asarray(
        below / (1.0 - (low - below) / 2.0)
        - below
        + (high + (above - high) / 2.0) / (1.0 - (above - high) / 2.0)
        - above
    )


def _level(values: FloatArray, strip: int) -> FloatArray:
    """Return the level of two strips by the next ones on either side, their own where there are none (places,)."""
    sides = [values[:, i] for i in (strip - 1, strip + 2) if 0 <= i < values.shape[1]]
    known = [np.isfinite(side) for side in sides]
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.sum([np.nan_to_num(s) for s in sides], axis=0) / np.sum(known, axis=0)
    own = (values[:, strip] + values[:, strip + 1]) / 2.0
    return np.asarray(np.clip(np.where(np.isfinite(mean), mean, own), 0.0, 1.0))


def _known(values: FloatArray) -> FloatArray:
    return values[np.isfinite(values)]


def _left_ends(work: WorkingCopy) -> IntArray:
    """Return where the contact on each strip begins (places, strips), a strip's number."""
    starts = work.there.copy()
    starts[:, 1:] &= ~work.there[:, :-1]
    numbers = np.where(starts, np.arange(work.strips), 0)
    return np.asarray(np.maximum.accumulate(numbers, axis=1))


def _explained(values: FloatArray, ends: IntArray) -> float:
    """Return which share of the variance of values the contact's left end explains."""
    group = np.unique(ends, return_inverse=True)[1]
    count, means = np.bincount(group), np.bincount(group, values) / np.bincount(group)
    free = len(values) - len(count)
    if free < 1 or not np.ptp(values):
        return 1.0
    within = float(np.sum((values - means[group]) ** 2)) / free
    return 1.0 - within / float(np.var(values, ddof=1))
