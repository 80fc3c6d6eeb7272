"""Wiring faults: v_h and v_l exchanged or tied, Vref and ground or two strips exchanged."""

from __future__ import annotations

from collections.abc import Iterator, Sequence, Set
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import combinations

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.diagnose.neighbour_pairs import NeighbourPair, neighbour_pair
from tacstrip.diagnose.neighbour_prediction import Suspect, WorkingCopy, neighbour_residuals
from tacstrip.diagnose.regression import correlation, most_of, moved_to_and_fro, passes
from tacstrip.robust import robust_sigma
from tacstrip.sensor.exchanged import read_twice

_CROSSED = 0.01  # over Vref: k_h - k_l below minus this cannot be (3.3), (3.4)
_OFFSETS = 0.08  # over Vref: what a unit without calibration may add to k_h - k_l
_OWN_OFFSETS = 0.01, 0.04  # over Vref: least and largest deviation of a unit's own, as its strips tell it
_TURNS, _FALLS = 0.8, 0.5  # negative correlation of k_h - k_l with its prediction, alone and with such odds:
# Logarithm of the odds of the two offsets that a strip would have, with its wires exchanged and not.
_ODDS = 5.0
_PERHAPS, _SURELY = 3.0, 5.0  # deviations of a unit's offsets, for a question and for a finding
_USUAL = 2.0  # deviations of an offset that a strip may have
_BEYOND = 2.0  # times the deviation, of a prediction that is extrapolated
_STRIPS, _SURE = 4, 5.0  # on so many strips offsets differ; standard errors of their mean
_SHARE = 0.8  # of the places with a clear difference
# Over Vref: what k_h and k_l of tied wires differ by, and of a contact that is long; places.
_TIED, _LONG, _MANY = 0.004, 0.05, 16
_FLAT = 0.6  # times what an offset would leave
_FEW = 8  # places
_SOME = 4  # footprints that are better in another order, for a question
_PASSES = 4  # times that a contact came to an outermost strip
_MOVES, _ALONG = 0.2, 0.4  # over Vref, what neighbours must move; correlation
_OFF_LINE = 0.75  # of the slope around: largest offset of two strips from the line
# Different footprints of contacts that end between two strips, if all lie on one side, and at the sensor's edges.
_FOOTPRINTS, _FOOTPRINTS_AT_EDGE = 5, 3
_TOLD, _TOLD_AT_EDGE = 0.4, 0.25  # of the misfit, what is left with the two exchanged
_UNUSUAL = 2.0  # times the median misfit of all pairs
_AWAY = 0.2  # of a strip's places: it is touched away from the contact
_ELSEWHERE = 0.06  # over Vref: a strip this far off what its neighbours expect may be another
_CURVED = 2.0  # times the median strip's: what curved signatures leave at the most
_LEAVES = 0.35  # of what these strips and the next ones are off, in the right order
_ALIKE = 0.15  # over Vref: what neighbours differ by at the most
_COMPARED, _LONGEST = 300, 3  # places; strips in each other's places
# Over Vref, by which an order is better in a footprint; times these, where it is worse.
_CLEARLY, _WORSE = 0.01, 0.6
_ONE_CONTACT = 0.3  # over Vref: neighbours further apart are not under one contact


def swapped_wires(work: WorkingCopy) -> Iterator[Suspect]:
    """Find strips with k_h below k_l: a contact's upper end is never lower than its lower end."""
    if work.pair is None:
        return
    difference = work.pair[0] - work.pair[1]
    clear_at = np.abs(difference) > max(_CROSSED, 3.0 * work.sigma)
    wrong = clear_at & (difference < 0.0)
    known = np.isfinite(difference).sum(axis=0)
    mean = np.nan_to_num(difference).sum(axis=0) / np.maximum(known, 1)
    clear = mean < -np.maximum(_CROSSED, 7.0 * work.sigma / np.sqrt(np.maximum(known, 1)))
    often = wrong.sum(axis=0) >= np.maximum(min(3, len(clear_at)), _SHARE * clear_at.sum(axis=0))
    (e_h, r_h), (e_l, r_l) = (neighbour_residuals(work, name) for name in ("kh", "kl"))
    as_is = np.abs(r_h) + np.abs(r_l)
    crossed = np.abs(work.pair[1] - e_h) + np.abs(work.pair[0] - e_l)
    exchanged = np.flatnonzero(clear & often).tolist()
    least = _OFFSETS if work.sensor.calibration is None else 2.0 * _CROSSED
    offsets = difference - e_h + e_l
    inside = work.prediction("kh")[1]
    touched = known > 0
    if len(exchanged) > max(2, 0.6 * np.count_nonzero(touched)) and _all_below(mean[touched], least):
        evidence = (
            f"v_h lies below v_l on {len(exchanged)} of {np.count_nonzero(touched)} strips that were touched, "
            "unless all readings are measured from Vref down (`tacstrip import ... --answer exchanged=from_vref`)"
        )
        numbers = {"strips": float(len(exchanged))}
        explained = -float(mean[exchanged].mean())
        yield work.suspect("swapped-wires", [], evidence, numbers, explained, repair=_swap_all_wires)
        return
    for strip in exchanged:
        at = np.isfinite(as_is[:, strip]) & clear_at[:, strip]
        now, then = (float(c[at, strip].mean()) if at.any() else 0.0 for c in (as_is, crossed))
        if then > now and at.any():  # one channel alone is off, by its neighbours' prediction
            continue
        below, predicted = float(mean[strip]), (e_h - e_l)[at, strip]
        spread = _spread_of_offsets(offsets[:, np.abs(np.arange(work.strips) - strip) > 1])
        doubt = spread if inside[at, strip].any() else _BEYOND * spread
        told = _sign_reversed(difference[at, strip], predicted, below, (least, doubt), work.sigma)
        if told is None:
            continue
        count, of = int(wrong[:, strip].sum()), int(clear_at[:, strip].sum())
        evidence = f"v_h lies {-100 * below:.3g} % of Vref below v_l, in {count} of {of} places with a clear difference"
        numbers = {"difference": below, "places": count, "of": of}
        explained, repair = max(now - then, 1e-3) / 2.0, partial(_swap_wires, strip=strip)
        suspect = work.suspect("swapped-wires", [strip], evidence, numbers, explained, repair=repair)
        yield replace(suspect, doubtful=not told)


def tied_wires(work: WorkingCopy) -> Iterator[Suspect]:
    """Find strips whose k_h is k_l under contacts that their neighbours show to be long."""
    if work.pair is None:
        return
    if read_twice(work.k):
        evidence = "on every strip they are equal to the last digit, as only a line reads"
        yield work.suspect(
            "tied-wires", [], evidence, {}, 1.0, repair=lambda work: work.drop(*range(work.strips))
        )
        return
    difference = np.abs(work.pair[0] - work.pair[1])
    (e_h, r_h), (e_l, r_l) = (neighbour_residuals(work, name) for name in ("kh", "kl"))
    # A contact that ends there may end in a corner, however long it is beside it.
    inside = work.prediction("kh")[1]
    long = inside & np.isfinite(r_h + r_l) & (e_h - e_l > max(_LONG, 10.0 * work.sigma))
    long &= (work.pair[0] > _OFFSETS) & (work.pair[1] < 1.0 - _OFFSETS)  # an open strip reads a rail twice
    alike = difference <= max(_TIED, 3.0 * work.sigma)
    for strip in range(work.strips):
        at = long[:, strip]
        if at.sum() < _MANY or alike[at, strip].mean() < _SHARE:
            continue
        most, predicted = float(difference[at, strip].max()), float((e_h - e_l)[at, strip].mean())
        evidence = (
            f"they differ by {100.0 * most:.2g} % of Vref at most in {at.sum()} places where the neighbours' differ by "
            f"{100.0 * predicted:.3g} % in the mean"
        )
        numbers = {"difference": most, "neighbours": predicted, "places": float(at.sum())}
        own, expected = (work.pair[0] - work.pair[1])[at, strip], (e_h - e_l)[at, strip]
        # Of contacts that are all of one length an offset may take the difference away.
        flat = float(np.std(own)) < _FLAT * float(np.std(own - expected))
        suspect = work.suspect("tied-wires", [strip], evidence, numbers, predicted / 2.0)
        yield replace(suspect, doubtful=predicted < _OFFSETS and not flat)


def _all_below(mean: FloatArray, least: float) -> bool:
    """Whether k_h - k_l (strips,) lies further below 0 than offsets take it: by much, or on all strips alike."""
    if np.median(mean) < -least:
        return True
    doubt = _SURE * float(np.std(mean)) / np.sqrt(len(mean))
    return len(mean) >= _STRIPS and float(np.mean(mean)) < -max(least / 2.0, doubt)


def _sign_reversed(
    difference: FloatArray, predicted: FloatArray, mean: float, offsets: tuple[float, float], sigma: float
) -> bool | None:
    """Whether k_h - k_l (places,) has the opposite sign of its prediction; None if not, False if an offset may do it.

    An offset adds one number to all places. Exchanged wires reverse the sign: where the contact is long, the
    difference lies far below 0, and where it grows the difference falls. Of a contact that stays as it is there is one
    difference and one prediction, and the two offsets that the strip would have, exchanged or not, are weighed by
    what other strips have. `offsets`: the largest of a unit without calibration, and the deviation of this one's.
    """
    least, spread = offsets
    if not len(predicted):
        return True if mean < -least else None
    level = float(predicted.mean())
    least_asked, least = min(_PERHAPS * spread, least), min(_SURELY * spread, least)
    below = -2.0 * mean > least_asked and mean - level < -least_asked and -mean > level / 2.0
    grows = float(np.std(predicted))
    as_is, exchanged = mean - level, mean + level  # the offset that the strip has
    weighed = (as_is**2 - exchanged**2) / (2.0 * spread**2) > _ODDS
    weighed &= -2.0 * mean > least and as_is < -least
    weighed &= abs(exchanged) < _USUAL * spread  # else neither explains what is read
    if len(predicted) < _FEW or grows < 3.0 * sigma or not np.ptp(difference):
        return weighed if below else None
    along = correlation(predicted, difference)
    if along < -_FALLS and (weighed or (along < -_TURNS and grows >= 2.0 * _CROSSED)):
        return True
    if grows >= 2.0 * _CROSSED and along >= 0.0:
        return None
    return weighed if below else None


def _spread_of_offsets(off: FloatArray) -> float:
    """Return the deviation of strips' offsets over Vref, from k_h - k_l less its prediction (places, strips).

    Of strips away from the one in doubt, which spoils its neighbours' predictions.
    """
    known = np.isfinite(off)
    enough = known.sum(axis=0) >= min(_FEW, len(off))
    many = int(enough.sum())
    if many < _STRIPS:
        return _OWN_OFFSETS[1]
    each = np.nanmedian(off[:, enough], axis=0)
    few = max(2 * _STRIPS / many, 1.0)  # of which a deviation is hardly known
    return float(np.clip(few * robust_sigma(each - np.median(each)), *_OWN_OFFSETS))


def _swap_wires(work: WorkingCopy, strip: int) -> None:
    kh, kl = work.k["kh"], work.k["kl"]
    kh[:, strip], kl[:, strip] = kl[:, strip].copy(), kh[:, strip].copy()


def _swap_all_wires(work: WorkingCopy) -> None:
    work.k["kh"], work.k["kl"] = work.k["kl"], work.k["kh"]


def swapped_ends(work: WorkingCopy) -> Iterator[Suspect]:
    """Find strips that fit their neighbours with the ends exchanged: 1 - k_l for k_h, 1 - k_h for k_l, 1 - k for k."""
    turned = {"kh": "kl", "kl": "kh", "k": "k"}
    as_is, reversed_ends, moves = [], [], []
    for name in work.k:
        e, r = neighbour_residuals(work, name)
        other = 1.0 - work.k.get(turned[name], work.k[name])
        as_is.append(np.abs(r))
        reversed_ends.append(np.abs(other - e))
        moves.append([_correlates(e[:, i], other[:, i]) for i in range(work.strips)])
    now, then = (np.mean(costs, axis=0) for costs in (as_is, reversed_ends))
    known = np.isfinite(now) & np.isfinite(then)
    for strip in np.flatnonzero(known.any(axis=0) & np.all(moves, axis=0)).tolist():
        count = int(known[:, strip].sum())
        a, b = (float(misfit[known[:, strip], strip].mean()) for misfit in (now, then))
        if a > (0.15 if count > 2 else 0.3) and b < 0.35 * a:
            evidence = (
                f"lies {100 * a:.3g} % of Vref from its neighbours' prediction, and with the ends exchanged "
                f"{100 * b:.2g} %, over {count} place(s)"
            )
            numbers = {"misfit": a, "reversed_ends": b, "places": float(count)}
            repair = partial(_turn, strip=strip)
            suspect = work.suspect("swapped-ends", [strip], evidence, numbers, a - b, repair=repair)
            # A corner that ends there may do so in some presses.
            few = strip in (0, work.strips - 1) and passes(np.flatnonzero(known[:, strip])) < _PASSES
            yield replace(suspect, doubtful=few)


def _correlates(expected: FloatArray, values: FloatArray) -> bool:
    """Whether values rise with their prediction: at one height alone, another contact may read the same reversed."""
    known = np.isfinite(expected) & np.isfinite(values)
    e, v = expected[known], values[known]
    if len(e) < _FEW or np.ptp(most_of(e)) < _MOVES or not np.ptp(v):
        return False
    return correlation(e, v) > _ALONG


def _turn(work: WorkingCopy, strip: int) -> None:
    if work.pair is not None:
        _swap_wires(work, strip)
    for values in work.k.values():
        values[:, strip] = 1.0 - values[:, strip]


def swapped_strips(work: WorkingCopy) -> Iterator[Suspect]:
    """Find strips that read what is over another, and neighbours in the wrong order.

    The latter by the edges of contacts and by the slope of signatures across them.
    """
    beside = list(_neighbours_exchanged(work))
    sure = {s.finding.place for s in beside if not s.doubtful}
    yield from (s for s in out_of_order(work) if not s.doubtful or s.finding.place not in sure)
    yield from beside


def _neighbours_exchanged(work: WorkingCopy) -> Iterator[Suspect]:
    """Find neighbours in the wrong order, by contacts that end between them and by the slope across them."""
    slopes = {
        i: _Slope([p for v in work.k.values() if (p := neighbour_pair(v, i))], work.sigma)
        for i in range(work.strips - 1)
    }
    usual = float(np.median([t.misfit for t in slopes.values() if t.places] or [0.0]))
    away = touched_elsewhere(work)
    for strip, slope in slopes.items():
        against, left, right, gaps = _edges(work, strip)
        at_edge = strip in (0, work.strips - 2)  # contacts go on to one side of the two only
        misfit, exchanged = slope.misfit, slope.misfit_exchanged
        one_sided = min(left, right) == 0 and not (slope.places >= _FEW and exchanged < 0.6 * misfit)
        often = left + right >= 2 * _FEW and against == 0
        if often and (at_edge or exchanged > 0.9 * misfit):
            # A contact that stays has one gap, however long it stays.
            least = _FOOTPRINTS_AT_EDGE if at_edge else _FOOTPRINTS
            often = len(np.unique(gaps, axis=0)) >= least
        edges = left + right >= 4 and left + right >= 5 * against and (often or not one_sided)
        clearly = slope.clear and exchanged < (_TOLD_AT_EDGE if at_edge else _TOLD) * misfit
        runs_back = clearly and misfit > _UNUSUAL * usual and slope.to_and_fro
        if runs_back or (edges and not (slope.clear and misfit < 0.7 * exchanged)):
            evidence = []
            if runs_back:
                evidence.append(
                    f"their difference is opposite to the slope around: {100 * misfit:.3g} % of Vref off in "
                    f"{slope.places} places, {100 * exchanged:.2g} % with the two exchanged"
                )
            if edges:
                evidence.append(
                    f"contacts that end there have a gap in {left + right} places, and none with the two exchanged"
                )
            numbers = {
                "misfit": misfit,
                "exchanged": exchanged,
                "places": slope.places,
                "edges": left + right,
            }
            two, explained = [strip, strip + 1], max(misfit - exchanged, 0.03)
            repair = partial(_exchange, one=strip, other=strip + 1)
            suspect = work.suspect(
                "swapped-strips", two, "; ".join(evidence), numbers, explained, repair=repair
            )
            # Further from where the contact is than one strip, it is no neighbour's place.
            yield replace(suspect, doubtful=bool(away[two].any()))


def told_by_slope(work: WorkingCopy) -> set[int]:
    """Return the places that the slope across them would show to be exchanged with the next one."""
    slopes = [
        _Slope([p for v in work.k.values() if (p := neighbour_pair(v, i))], work.sigma)
        for i in range(work.strips - 1)
    ]
    usual = float(np.median([t.misfit for t in slopes if t.places] or [0.0]))
    edges = {0, work.strips - 2}
    return {
        i
        for i, t in enumerate(slopes)
        if t.clear
        and t.misfit < (_TOLD_AT_EDGE if i in edges else _TOLD) * t.misfit_exchanged
        and t.misfit_exchanged > _UNUSUAL * usual
        and t.to_and_fro
    }


@dataclass(frozen=True, eq=False)
class _Slope:
    """Two neighbours' difference D against the slope E around them, over Vref, by signature."""

    pairs: Sequence[NeighbourPair]
    sigma: float

    @cached_property
    def misfit(self) -> float:
        """Standard deviation of D - E, whose mean holds an uncalibrated sensor's offsets."""
        return _deviation([p.excess for p in self.pairs])

    @cached_property
    def misfit_exchanged(self) -> float:
        """The same of D + E."""
        return _deviation([p.difference + p.slope for p in self.pairs])

    @property
    def places(self) -> int:
        """In how many places both are known."""
        return min((len(p.slope) for p in self.pairs), default=0)

    @cached_property
    def clear(self) -> bool:
        """Whether E changed by enough, in enough places, and the two lie on the line around them."""
        slope = _deviation([p.slope for p in self.pairs])
        if self.places < _FEW or slope <= max(0.004, 4.0 * self.sigma):
            return False
        off = np.concatenate([np.abs(p.offset - np.median(p.offset)) for p in self.pairs])
        return float(np.median(off)) < _OFF_LINE * slope

    @property
    def to_and_fro(self) -> bool:
        """Whether the contact moved to and fro along the strips."""
        return all(moved_to_and_fro(p.level, self.sigma) for p in self.pairs)


def _deviation(values: Sequence[FloatArray]) -> float:
    """Return the standard deviation of values of several signatures (places,); 0 of none."""
    return float(np.sqrt(np.mean([np.var(v) for v in values]))) if values else 0.0


def _exchange(work: WorkingCopy, one: int, other: int) -> None:
    for array in (*work.k.values(), work.there):
        array[:, [one, other]] = array[:, [other, one]]
    work.order[[one, other]] = work.order[[other, one]]


def out_of_order(work: WorkingCopy) -> Iterator[Suspect]:
    """Find two strips, or three, that are in each other's places: in the right order neighbours are most alike.

    Only where a strip disagrees with its neighbours, and all strips agree in the order found.
    """
    was = _misfits(work)
    if not (was[1:-1] > _ELSEWHERE).any():
        return
    order = _most_alike(work, set(np.flatnonzero(was > _ELSEWHERE).tolist()))
    tried = replace(work, k=dict(work.k), there=work.there, order=work.order)
    _arrange(tried, order)
    now = _misfits(tried)
    moved = order != np.arange(len(order))
    known = [np.isfinite(tried.prediction(name)[0] + v).sum(axis=0) for name, v in tried.k.items()]
    usual, around = _CURVED * float(np.median(now)), moved | _beside(moved)
    before, after = (float(np.maximum(m[around] - usual, 0.0).sum()) for m in (was, now))
    if not moved.any() or after > _LEAVES * before or np.max(known, axis=0)[moved].min() < _FEW:
        return
    # A contact that stays, and one between others, tells an order of its own.
    _, footprint = np.unique(work.there, axis=0, return_inverse=True)
    gain = np.bincount(footprint.ravel(), _unlike(work) - _unlike(tried)) / np.bincount(footprint.ravel())
    better, worse = (int(np.count_nonzero(side > _CLEARLY)) for side in (gain, -gain))
    if better < _SOME or worse > _WORSE * better:
        return
    share, cycles = after / max(before, 1e-9), list(_cycles(order))
    for cycle in cycles if max(map(len, cycles)) <= _LONGEST else []:  # more: another object, another order
        another = "the other" if len(cycle) == 2 else "another"
        evidence = (
            f"each reads what the neighbours of {another} expect: in the order in which neighbours are most alike, "
            f"they leave {100 * share:.2g} % of what they and the next strips are off their neighbours' lines"
        )
        only = np.arange(len(order))
        only[cycle] = order[cycle]
        repair = partial(_arrange, order=only)
        explained = (1.0 - share) * float(was.sum())
        suspect = work.suspect("swapped-strips", cycle, evidence, {"left": share}, explained, repair=repair)
        yield replace(suspect, doubtful=better < _FEW)


def _unlike(work: WorkingCopy) -> FloatArray:
    """Return what neighbours' readings differ by, as in `_most_alike`, over strips and signatures (places,)."""
    one = work.there[:, 1:] != work.there[:, :-1]
    each = [np.minimum(np.abs(np.diff(values, axis=1)), _ALIKE) for values in work.k.values()]
    return np.asarray(np.sum([np.where(one, _ALIKE, np.nan_to_num(off)) for off in each], axis=(0, 2)))


def _beside(there: BoolArray) -> BoolArray:
    """Return which strips (strips,) are next to one of these."""
    padded = np.pad(there, 1)
    return np.asarray(padded[:-2] | padded[2:])


def _cycles(order: IntArray) -> Iterator[list[int]]:
    """Yield the places that exchange their strips in a new order (strips,)."""
    left = set(np.flatnonzero(order != np.arange(len(order))).tolist())
    while left:
        cycle = [min(left)]
        while (after := int(order[cycle[-1]])) != cycle[0]:
            cycle.append(after)
        left -= set(cycle)
        yield cycle


def _most_alike(work: WorkingCopy, astray: Set[int]) -> IntArray:
    """Return the order of the strips (strips,) in which the readings of neighbours differ least, over all places.

    Where one of two strips is touched, and the other not, they differ by `_ALIKE`. Source: local search for the
    shortest path through all strips, from the order at hand, by exchanges of two places, and moves from one to another,
    of which one at least is `astray`.
    """
    n, some = work.strips, np.linspace(0, len(work.there) - 1, min(len(work.there), _COMPARED)).astype(int)
    apart, there = np.zeros((n, n)), work.there[some]
    for values in (one[some] for one in work.k.values()):
        for i in range(n):
            off = np.minimum(np.abs(values - values[:, [i]]), _ALIKE)
            apart[i] += np.where(there != there[:, [i]], _ALIKE, np.nan_to_num(off)).sum(axis=0)
    order = np.arange(n)
    pairs = [pair for pair in combinations(range(n), 2) if astray & set(pair)]
    steps = np.tile(order, (3 * len(pairs) + 1, 1))  # the last changes nothing
    for move, (i, j) in enumerate(pairs):
        exchange, up, down = steps[3 * move : 3 * move + 3]
        exchange[[i, j]] = j, i
        up[i:j], up[j] = order[i + 1 : j + 1], i
        down[i + 1 : j + 1], down[i] = order[i:j], j
    while True:
        tried = order[steps]
        length = apart[tried[:, :-1], tried[:, 1:]].sum(axis=1)
        if length.min() >= length[-1]:
            return order
        order = tried[int(np.argmin(length))]


def _arrange(work: WorkingCopy, order: IntArray) -> None:
    work.k = {name: np.ascontiguousarray(values[:, order]) for name, values in work.k.items()}
    work.there, work.order = np.ascontiguousarray(work.there[:, order]), work.order[order]


def _misfits(work: WorkingCopy) -> FloatArray:
    """Return how far strips lie from what their neighbours under one contact expect, over Vref (strips,).

    One that counts as untouched there is as far off as any, but at the sensor's edges, which a contact may not reach.
    """
    total = np.zeros(work.strips)
    for name, values in work.k.items():
        e, both, gap = work.prediction(name)
        over = both & (gap < _ONE_CONTACT) & np.isfinite(values).any(axis=0)  # but of dropped channels
        over[:, [0, -1]] = np.isfinite(e + values)[:, [0, -1]]
        off = np.nan_to_num(np.abs(values - e), nan=_ONE_CONTACT)
        count = over.sum(axis=0)
        mean = (over * np.minimum(off, _ONE_CONTACT)).sum(axis=0) / np.maximum(count, 1)
        total += np.where(count >= _FEW, mean, 0.0) / len(work.k)
    return total


def touched_elsewhere(work: WorkingCopy) -> BoolArray:
    """Return which strips (strips,) are often touched where no contact is beside them."""
    return np.asarray(_away_from_contact(work.there) > _AWAY)


def _away_from_contact(there: BoolArray) -> FloatArray:
    """Return in which share of its places a strip is touched and none of the next two on either side (strips,)."""
    padded = np.pad(there, ((0, 0), (2, 2)))
    beside = np.any([padded[:, i : i + there.shape[1]] for i in (0, 1, 3, 4)], axis=0)
    alone = there & ~beside & (there.sum(axis=1, keepdims=True) > 1)
    return np.asarray(alone.sum(axis=0) / np.maximum(there.sum(axis=0), 1))


def _edges(work: WorkingCopy, strip: int) -> tuple[int, int, int, BoolArray]:
    """Count the places where a contact ends between two neighbours, and those where it would with the two exchanged.

    The latter for contacts to the left of the two and to the right, and the footprints of these (places, strips): a
    contact with a gap has it on one side, and moves it along.
    """
    clear = _clear(work, slice(max(strip - 1, 0), strip + 3))
    padded = np.pad(work.there, ((0, 0), (1, 1)))
    a, b, c, d = padded[clear, strip : strip + 4].T
    first, last = (strip == 0, strip == work.strips - 2)  # nothing lies beyond them
    ends = (a & b & ~c & ~d) | (~a & ~b & c & d) | (first & b & ~c & ~d) | (last & c & ~b & ~a)
    left = (a | first) & ~b & c & ~d
    right = ~a & b & ~c & (d | last)
    return int(ends.sum()), int(left.sum()), int(right.sum()), work.there[clear][left | right]


def _clear(work: WorkingCopy, window: slice) -> BoolArray:
    """Return the places where all touched strips of the window read far enough from rest not to go unnoticed."""
    if work.sensor.rest_volt is None or work.sensor.touch_volt is None:
        return np.ones(len(work.there), dtype=bool)
    rest, touch = (v / work.sensor.vref_volt for v in (work.sensor.rest_volt, work.sensor.touch_volt))
    away = np.min([np.abs(v[:, window] - rest) for v in work.k.values()], axis=0)
    return np.asarray(~((away < 3.0 * touch) & work.there[:, window]).any(axis=1))
