"""Bridges between neighbouring strips or their wires."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.diagnose.bend_model import BendModel
from tacstrip.diagnose.neighbour_prediction import Suspect, WorkingCopy
from tacstrip.diagnose.regression import most_of, moved_to_and_fro, passes, repeats
from tacstrip.diagnose.rigid_contact import RigidContact
from tacstrip.sensor.constructions import SIGNATURES

_HEIGHTS = np.linspace(0.25, 1.0, 6)  # over L, at which a bridge is looked for: of contacts on one side of it
_CLEAR = 0.1  # over Vref: contacts this far from a bridge lie wholly on one side
_MANY, _PASSES = 25, 4  # places, and times that the contact came there
_FEWEST_PAIRS, _OTHER_PAIRS = 5, 3  # that a pair is held against
_MOST, _WIDTH = 0.85, 1.44  # of the places; such a share of normal errors lies within so many deviations
_GAINS = 0.05  # by which two channels' gains differ at most: a dead one differs by all of the other's reading
_NOISE, _SEEN_TIED = 1.4, 1.25  # times what noise makes of a difference; of all that a bridge ties
# Such a pair's gain (below), times other pairs'; times that it is seen.
_BENT, _BENT_TIMES, _BENT_PASSES = 50.0, 2.0, 3
# Times the least that other pairs differ; of the slope around, which a pair follows.
_TIED, _SLOPE = 0.45, 0.75
# Of a tied pair: logarithm of the odds against a pair that follows half the slope around; where that is extrapolated;
# and the gain of a pair that is told by the bends around it. Less is a question.
_ODDS_TIED, _ODDS, _ODDS_AT_EDGE, _BENT_SURELY = 0.5, 2.0, 20.0, 100.0
_BENDS = 1.2  # times noise: less may be chance
_LOOKS, _FEWEST_LOOKS = 3, 15  # places of a pass that count: they err alike; places
_JUMP, _RESOLVED = 0.04, 0.004  # over Vref: from the next strip; of a level
_ONE_LEVEL = 0.06  # over Vref: offsets of two strips that read one level
_FEW, _COMES, _OFTEN = 4, 2, 6  # places; times that the contact comes to an end; to both
_RISES = 0.35  # over Vref, what the contact moves meanwhile
_STRENGTH = (0.45, 1.9)  # times what a bridge does to readings
_LEAST_BENT = 0.3  # times: of half of a slope that is extrapolated, or of a bridge with some resistance
# Misfit explained, in variances, inside and at the edges; times other pairs', and for a question.
_GAIN, _TIMES, _TIMES_ASKED = (80.0, 45.0), 4.5, 1.6
_APART = 2  # strips: pairs further away are others
_CONFOUNDED = 0.05  # of its power: what a bridge must do beyond shape and constant errors
_LEAST = 0.005  # over Vref: standard deviation of what a bridge adds
_HIGH_AND_LOW = 0.5  # over L: a bridge adds on one side and takes away on the other, which must be seen
_LENGTH = 0.6  # over L: readings jump by the contact's length at a bridge; longer contacts show nothing
_GRID = np.linspace(0.0, 1.0, 11)
# Against one rigid outline under all strips: gain, times other pairs', and of its power, what is not confounded.
_BRIDGES, _QUARTERS = np.linspace(0.0, 1.0, 7), 4  # over L; of the recording
_GAIN_TIED, _GAIN_TIED_ASKED, _TIMES_TIED, _KNOWN_TIED = 80.0, 40.0, 4.0, 0.15
_GAIN_IN_QUARTERS, _TIMES_IN_QUARTERS = 20.0, 2.0
_PLACES = np.array([(a, b) for i, a in enumerate(_GRID) for b in _GRID[i:] if b - a <= _LENGTH]).T


def shorts(work: WorkingCopy) -> Iterator[Suspect]:
    """Find neighbours that are tied together.

    Tied sensing strips or wires read one voltage, whatever the slope of the contact. Over metal, where strips are
    energised in turn, a bridge between energised strips gives the current a second way to the sheet: both read too
    much for contacts below the bridge and too little above it, and one that nothing touches reads the bridge's height
    through the other. Between CRS-CRS's energised strips, all on one supply, a bridge changes next to nothing.
    """
    if work.sensor.sensing_ratio:
        yield from _not_repeated(work, _tied_sensing(work))
        return
    held = list(_held_by_a_bridge(work))
    yield from held or _not_repeated(work, _bridged_energised(work))


def tied_under_outline(work: WorkingCopy) -> Suspect | None:
    """Return the pair of sensing strips that is tied, by what one rigid outline under all strips expects of the two.

    Fits that begin on either half of the places have to blame it, and, unless it is doubtful, without any quarter.
    """
    suspects: list[tuple[int, Suspect]] = []
    for part in range(2):
        if (model := RigidContact.of(work, part)) is None:
            return None
        pair, bridge, others = _tied_pair(model, slice(0, 0))
        if bridge.gain <= max(_GAIN_TIED_ASKED, _TIMES_TIED * others):
            return None
        stands = bridge.gain > _GAIN_TIED
        for quarter in range(_QUARTERS):
            other, left, usual = _tied_pair(model, model.part(quarter, _QUARTERS))
            stands &= other == pair and left.gain > max(_GAIN_IN_QUARTERS, _TIMES_IN_QUARTERS * usual)
        evidence = (
            f"{bridge.strength:.2g} times as flat as one conductor, against one rigid contact under all strips, "
            f"{_held_against(bridge, max(others, 1.0))}"
        )
        suspect = work.suspect("short", [pair, pair + 1], evidence, {"gain": bridge.gain}, bridge.gain)
        suspects.append((pair, replace(suspect, doubtful=not stands)))
    (one, suspect), (two, also) = suspects
    return replace(suspect, doubtful=suspect.doubtful or also.doubtful) if one == two else None


def _tied_pair(model: RigidContact, without: slice) -> tuple[int, _Bridge, float]:
    """Return the pair whose tie explains most beyond an outline without some places, it, and what others explain."""
    many = len(_BRIDGES)
    found = model.explain(model.half_apart(_BRIDGES), without=without)
    score = found.score.reshape(-1, 2, many)
    alone = np.diag(found.whole).reshape(-1, 2, many)
    reduced = found.reduced.reshape(-1, *score.shape)
    whole, score = (v[:-1, 0] + v[1:, 1] for v in (alone, score))
    power = whole - np.sum((reduced[:, :-1, 0] + reduced[:, 1:, 1]) ** 2, axis=0)
    strength = np.where(power > _KNOWN_TIED * whole, score / np.maximum(power, 1e-12), 0.0)
    usual = (strength > _LEAST_BENT) & (strength < _STRENGTH[1])
    gain = np.where(strength > 0.0, strength * score, 0.0) / model.sigma**2
    pair, which = np.unravel_index(np.argmax(np.where(usual, gain, 0.0)), gain.shape)
    apart = np.abs(np.arange(len(gain)) - pair) > 1
    bridge = _Bridge(float(strength[pair, which]), float((gain * usual)[pair, which]), int(which))
    return int(pair), bridge, float(gain[apart].max(initial=0.0))


def _not_repeated(work: WorkingCopy, found: Iterator[tuple[int, Suspect]]) -> Iterator[Suspect]:
    """Yield suspects of pairs; doubtful where all that came there is one movement, again and again."""
    for strip, suspect in found:
        rows = np.flatnonzero(work.there[:, strip : strip + 2].all(axis=1))
        again = repeats(np.concatenate(list(work.k.values()), axis=1), rows, work.sigma)
        yield replace(suspect, doubtful=suspect.doubtful or again)


def _tied_sensing(work: WorkingCopy) -> Iterator[tuple[int, Suspect]]:
    """Find pairs whose difference is noise and offset alone, where that of all other pairs changes with the contact."""
    best: dict[int, tuple[float, Suspect]] = {}
    alike: dict[
        int, tuple[float, float, int]
    ] = {}  # pairs that differ as noise does, by what, in how many places
    for name, values in work.k.items():
        difference, level = np.diff(values, axis=1), (values[:, 1:] + values[:, :-1]) / 2.0
        pairs = difference.shape[1]
        if pairs < _FEWEST_PAIRS:
            return
        around = np.full_like(
            difference, np.nan
        )  # the slope from the strips on either side, of the next two at edges
        around[:, 1:-1] = (values[:, 3:] - values[:, :-3]) / 3.0
        around[:, 0], around[:, -1] = difference[:, 2], difference[:, -3]
        for height in _HEIGHTS:
            # A bridge ties v_h of contacts below it, and v_l of contacts above it.
            at = level < height - _CLEAR if SIGNATURES[name].at_upper_end else level > 1.0 - height + _CLEAR
            own = _scatter(difference, level, at)
            noise = _WIDTH * np.sqrt(2.0) * work.sigma
            for pair in np.flatnonzero(own < _NOISE * noise).tolist():
                others = np.delete(own, [i for i in (pair - 1, pair, pair + 1) if 0 <= i < pairs])
                others = others[np.isfinite(others)]
                rows = np.flatnonzero(at[:, pair] & np.isfinite(difference[:, pair]))
                if len(others) < _OTHER_PAIRS or passes(rows) < _BENT_PASSES:
                    continue
                alike[pair] = min(
                    alike.get(pair, (np.inf, 0.0, 0)), (float(own[pair]), float(np.median(others)), len(rows))
                )
                if passes(rows) < _PASSES or own[pair] > _TIED * max(float(others.min()), 1e-9):
                    continue
                slope = float(_scatter(around[:, [pair]], level[:, [pair]], at[:, [pair]])[0])
                least = np.fmin(float(others.min()), _SLOPE * slope)
                ratio = float(own[pair]) / max(float(least), 1e-9)
                if ratio > _TIED or ratio >= best.get(pair, (1.0,))[0]:
                    continue
                usual = float(np.median(others))
                evidence = (
                    f"they read one voltage: beside their offsets they differ by {100 * own[pair]:.2g} % of Vref, as "
                    f"noise does, over {len(rows)} places, where other neighbours differ by {100 * usual:.2g} %"
                )
                numbers = {"differ": float(own[pair]), "others": usual, "places": float(len(rows))}
                best[pair] = ratio, work.suspect("short", [pair, pair + 1], evidence, numbers, usual)
    best = {
        pair: (
            ratio,
            replace(
                suspect,
                doubtful=_odds_of_flat(work, pair) < _least_odds(work, pair, _ODDS_TIED)
                or not _tied_on_both_sides(work, pair),
            ),
        )
        for pair, (ratio, suspect) in best.items()
    }
    yield from ((pair, suspect) for pair, (_, suspect) in best.items())
    if alike.keys() - best.keys():
        yield from _flattened(work, {pair: seen for pair, seen in alike.items() if pair not in best})


def _flattened(
    work: WorkingCopy, alike: Mapping[int, tuple[float, float, int]]
) -> Iterator[tuple[int, Suspect]]:
    """Find which of the pairs that differ as noise does are flat where the signature around them is not."""

    def flat(i: int) -> list[dict[int, FloatArray]]:
        upper, lower = _ends(work, i)
        changes = []
        for name, values in work.k.items():
            half = _slope(values, i)[:, None] / 2.0
            tied = upper[:, None] < _GRID if SIGNATURES[name].at_upper_end else lower[:, None] > _GRID
            change = np.where(tied, half, 0.0)
            changes.append({i: change, i + 1: -change})
        return changes

    for strip, bridge, others in _outstanding(work, flat, alike, (_BENT, _BENT), _BENT_TIMES, _LEAST_BENT):
        own, usual, places = alike[strip]
        evidence = (
            f"they read one voltage: beside their offsets they differ by {100 * own:.2g} % of Vref, as noise does, "
            f"over {places} places, {bridge.strength:.2g} times as flat as one conductor, "
            f"{_held_against(bridge, others)}"
        )
        numbers = {"differ": own, "others": usual, "places": float(places), "gain": bridge.gain}
        doubtful = bridge.gain < _BENT_SURELY or not others
        doubtful |= _odds_of_flat(work, strip) < _least_odds(work, strip, _ODDS)
        suspect = work.suspect("short", [strip, strip + 1], evidence, numbers, usual)
        yield strip, replace(suspect, doubtful=doubtful)


def _tied_on_both_sides(work: WorkingCopy, strip: int) -> bool:
    """Whether a bridge at some height ties v_h of all contacts below it, and v_l of all above it, as far as seen."""
    (above, over), (below, under) = (
        (np.diff(values, axis=1)[:, [strip]], (values[:, [strip + 1]] + values[:, [strip]]) / 2.0)
        for values in (work.k["kh"], work.k["kl"])
    )
    tied = _SEEN_TIED * _WIDTH * np.sqrt(2.0) * work.sigma
    return any(
        not _scatter(above, over, over < height - _CLEAR)[0] > tied
        and not _scatter(below, under, under > height + _CLEAR)[0] > tied
        for height in _GRID
    )


def _least_odds(work: WorkingCopy, strip: int, inside: float) -> float:
    return inside if 0 < strip < work.strips - 2 else _ODDS_AT_EDGE


def _odds_of_flat(work: WorkingCopy, strip: int) -> float:
    """Return the logarithm of the odds that a pair differs by noise alone, and not by half the slope around it.

    By what either leaves beside offset and gain, in the signature and on the side of a bridge where most speaks for
    it; places of one pass err alike. A pair that is noisy, or flat because the contact is, does not tell: 0.
    """
    best, noise = 0.0, np.sqrt(2.0) * work.sigma
    for name, values in work.k.items():
        difference, slope = values[:, strip + 1] - values[:, strip], _slope(values, strip)
        level = (values[:, strip + 1] + values[:, strip]) / 2.0
        known = np.isfinite(difference) & np.isfinite(slope)
        for height in _HEIGHTS:
            below = level < height - _CLEAR
            at = known & (below if SIGNATURES[name].at_upper_end else level > 1.0 - height + _CLEAR)
            rows = np.flatnonzero(at)
            if len(rows) < _FEWEST_LOOKS:
                continue
            flat, half = (_left(y[rows], level[rows]) for y in (difference, difference - slope / 2.0))
            if flat < _NOISE * noise and half > _BENDS * max(flat, noise):
                looks = min(len(rows), _LOOKS * passes(rows))
                best = max(best, looks * math.log(half / max(flat, noise)))
    return best


def _left(values: FloatArray, level: FloatArray) -> float:
    """Return how far values (places,) lie off a line of their level that gains can explain, as a deviation."""
    values, level = values - values.mean(), level - level.mean()
    gain = np.clip(values @ level / max(float(level @ level), 1e-9), -_GAINS, _GAINS)
    return float(np.quantile(np.abs(values - gain * level), _MOST)) / _WIDTH


def _slope(values: FloatArray, strip: int) -> FloatArray:
    """Return a signature's slope across two strips by the strips around them, of the next two at an edge (places,)."""
    last = values.shape[1] - 1
    if 0 < strip < last - 1:
        return np.asarray((values[:, strip + 2] - values[:, strip - 1]) / 3.0)
    a = strip + 2 if strip == 0 else strip - 2
    return np.asarray(values[:, a + 1] - values[:, a])


def _ends(work: WorkingCopy, strip: int) -> tuple[FloatArray, FloatArray]:
    """Return u and l over L of the contact at two strips (places,); a signature alone stands for both."""
    if work.pair is None:
        (values,) = work.k.values()
        return _level(values, strip), _level(values, strip)
    kh, kl = (_level(values, strip) for values in work.pair)
    return (2.0 * kh - kl) / (1.0 + kh - kl), kl / (1.0 + kh - kl)


def _scatter(values: FloatArray, level: FloatArray, at: BoolArray) -> FloatArray:
    """Return how far values (places, pairs) lie off a line over their level, 85 % of those at some places (pairs,).

    NaN where there are few. The line, fitted twice, is what offsets and gains do.
    """
    use = at & np.isfinite(values)
    enough = use.sum(axis=0) >= _MANY
    off = _off_line(values, level, at, use)
    off = _off_line(values, level, at, off <= 3.0 * _columns(off, 0.5))
    return np.where(enough, _columns(off, _MOST), np.nan)


def _off_line(values: FloatArray, level: FloatArray, at: BoolArray, use: BoolArray) -> FloatArray:
    """Return how far values (places, pairs) lie off a line over their level that is fitted to some, NaN but `at`."""
    count = np.maximum(use.sum(axis=0), 1)
    x, y = (np.where(use, v, 0.0) for v in (level, values))
    x0, y0 = x.sum(axis=0) / count, y.sum(axis=0) / count
    across = np.where(use, level - x0, 0.0)
    slope = np.clip((across * y).sum(axis=0) / np.maximum((across**2).sum(axis=0), 1e-9), -_GAINS, _GAINS)
    return np.where(at, np.abs(values - y0 - slope * (level - x0)), np.nan)


def _columns(values: FloatArray, share: float) -> FloatArray:
    """Return a quantile of each column's numbers (columns,), inf where there are none."""
    count = np.isfinite(values).sum(axis=0)
    ordered = np.sort(np.where(np.isfinite(values), values, np.inf), axis=0)
    return np.asarray(ordered[(share * np.maximum(count - 1, 0)).astype(int), np.arange(values.shape[1])])


def _held_by_a_bridge(work: WorkingCopy) -> Iterator[Suspect]:
    """Find energised pairs of which either one reads one level where a contact lies on the other alone."""
    (values,) = work.k.values()
    rest = (work.sensor.rest_volt or 0.0) / work.sensor.vref_volt
    there = np.pad(work.there, ((0, 0), (1, 1)))
    for strip in range(work.strips - 1):
        both = np.isfinite(values[:, strip : strip + 2]).all(axis=1)
        ends = (strip, strip + 1, there[:, strip]), (strip + 1, strip, there[:, strip + 3])
        held = [_Held.of(values[:, a], values[:, b], both & ~beyond, work.sigma) for a, b, beyond in ends]
        left, right = held
        if left is None or right is None or left.comes + right.comes < _OFTEN:
            continue
        level, places = (left.level + right.level) / 2.0, left.places + right.places
        # A free wire keeps a level too.
        if (
            abs(left.level - right.level) > _ONE_LEVEL
            or min(abs(level - v) for v in (0.0, rest, 1.0)) < _JUMP
        ):
            continue
        evidence = (
            f"where a contact ends on them, the outer one reads {left.level:.3g} and {right.level:.3g} Vref in "
            f"{places} places, while the other reads {left.low:.2g} to {left.high:.2g}: it is fed through the other, "
            f"by a bridge near y = {level * work.sensor.length_mm:.3g} mm"
        )
        numbers = {"level": level, "places": float(places)}
        yield work.suspect("short", [strip, strip + 1], evidence, numbers, left.off + right.off)


@dataclass(frozen=True)
class _Held:
    """A level that a strip keeps at a contact's end: in how many places and times, what the next strip reads then.

    off: their mean difference.
    """

    level: float
    places: int
    comes: int
    low: float
    high: float
    off: float

    @classmethod
    def of(cls, outer: FloatArray, inner: FloatArray, at: BoolArray, sigma: float) -> _Held | None:
        """Return it of two strips' readings at some places (places,); None where there is no such level."""
        rows = np.flatnonzero(at & (np.abs(outer - inner) > max(_JUMP, 8.0 * sigma)))
        if len(rows) < _FEW:
            return None
        near, ordered = 3.0 * sigma + _RESOLVED, np.sort(outer[rows])
        count = np.searchsorted(ordered, ordered + 2.0 * near) - np.arange(len(ordered))
        most = int(np.argmax(count))
        level = float(ordered[most : most + count[most]].mean())
        rows = rows[np.abs(outer[rows] - level) <= near]
        low, high = most_of(inner[rows])
        comes = passes(rows)
        if len(rows) < _FEW or comes < _COMES or high - low < _RISES:
            return None
        return cls(level, len(rows), comes, low, high, float(np.abs(inner[rows] - level).mean()))


def _bridged_energised(work: WorkingCopy) -> Iterator[tuple[int, Suspect]]:
    (values,) = work.k.values()

    def bridged(i: int) -> list[dict[int, FloatArray]]:
        change = bridge_effect(_level(values, i)[:, None], *_PLACES)
        return [{i: change, i + 1: change}]

    every = range(work.strips - 1)
    for strip, bridge, others in _outstanding(work, bridged, every, _GAIN, _TIMES_ASKED, _LEAST_BENT):
        clearly = bridge.gain >= _TIMES * others and bool(others)
        if (
            bridge.strength < _STRENGTH[0] and not clearly
        ):  # of one near an end the strips' own bow takes a part
            continue
        added = bridge.strength * bridged(strip)[0][strip][:, bridge.which]
        size, most, least = (float(f(added)) for f in (np.nanstd, np.nanmax, np.nanmin))
        if size > _LEAST and moved_to_and_fro(_known(_level(values, strip)), work.sigma, _HIGH_AND_LOW):
            evidence = (
                f"both read {100 * most:+.3g} to {100 * least:+.3g} % of Vref off their neighbours' line from height "
                f"to height, {bridge.strength:.2g} times the effect of an ideal bridge, {_held_against(bridge, others)}"
            )
            numbers = {"most": most, "least": least, "strength": bridge.strength, "gain": bridge.gain}
            suspect = work.suspect("short", [strip, strip + 1], evidence, numbers, size)
            yield strip, replace(suspect, doubtful=not clearly)


@dataclass(frozen=True)
class _Bridge:
    """The bridge between two neighbours that explains most: times its ideal effect, misfit explained, which one."""

    strength: float
    gain: float
    which: int


def _held_against(bridge: _Bridge, others: float) -> str:
    if not others:
        return "but no other strips bend that it could be held against"
    return f"which explains {bridge.gain / others:.2g} times as much as between other strips"


def _outstanding(
    work: WorkingCopy,
    changes: Callable[[int], Sequence[Mapping[int, FloatArray]]],
    among: Collection[int],
    gains: tuple[float, float],
    times: float,
    weakest: float,
) -> Iterator[tuple[int, _Bridge, float]]:
    """Yield pairs whose bridge explains much more than any between strips further away, and the most of these.

    `changes`, of a pair, by signature: what alternative bridges do to each of its strips (places, alternatives);
    `among`: the pairs that may be yielded; `gains`: the least, inside and at the edges; `times`: of those of pairs
    further away; `weakest`: the least of a bridge's ideal effect.
    """
    models = [BendModel.fit(work, values) for values in work.k.values()]
    found = _best(models, [changes(i) for i in range(work.strips - 1)])
    gain = np.array([bridge.gain for bridge in found])
    for strip in sorted(among):
        bridge, apart = found[strip], np.abs(np.arange(len(found)) - strip)
        at_edge = strip in (0, len(found) - 1)
        if not weakest < bridge.strength < _STRENGTH[1] or bridge.gain <= gains[at_edge]:
            continue
        others = float(gain[apart > _APART].max()) if (apart > _APART).any() else math.inf
        near = gain[(apart > 0) & (apart <= _APART)].max(initial=0.0)
        if bridge.gain > max(times * others, near):
            yield strip, bridge, others


def _best(
    models: Sequence[BendModel | None], changes: Sequence[Sequence[Mapping[int, FloatArray]]]
) -> list[_Bridge]:
    """Return of each pair the alternative that explains most of its strips' bends, all signatures together."""
    power, score, whole = np.zeros((3, len(changes), next(iter(changes[0][0].values())).shape[1]))
    for model, of_pairs in zip(models, zip(*changes, strict=True), strict=True):
        if model is not None:
            for total, part in zip((power, score, whole), model.alternatives(of_pairs), strict=True):
                total += part / model.sigma**2
    strength = np.where(power > _CONFOUNDED * whole, score / np.maximum(power, 1e-12), 0.0)
    gain = np.where(strength > 0.0, strength * score, 0.0)
    best = np.argmax(gain, axis=1)
    return [_Bridge(float(strength[i, b]), float(gain[i, b]), int(b)) for i, b in enumerate(best)]


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
