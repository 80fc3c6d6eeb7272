"""Shape and poses from the readings alone."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import shapely

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.core.rigid import RigidScans
from tacstrip.geometry.moments import area
from tacstrip.tracking.rigid.corners import (
    FIRST,
    Fit,
    bad_scans,
    explored,
    fitted,
    pruned,
    recounted,
    reflex,
    rescued,
    settled,
    unstuck,
)
from tacstrip.tracking.rigid.covariance import following
from tacstrip.tracking.rigid.found import WORTH_SETTLING, Found, carried, content
from tacstrip.tracking.rigid.offsets import (
    EVIDENCE,
    Offsets,
    channel_offsets,
    offsets_of_all,
    taken_off,
    without_needless_corners,
)
from tacstrip.tracking.rigid.smooth_path import one_after_another, spline_basis
from tacstrip.tracking.rigid.starts import (
    FEW_A_SCAN,
    KEPT,
    LOST,
    TURNS,
    Starts,
    needs_smooth_motion,
    spline_over,
)
from tacstrip.tracking.rigid.strain import strain_share
from tacstrip.tracking.rigid.without_path import best_without_path, hopped_fit

_FINE_TURNS = tuple(range(-160, 161, 10))  # degrees
_WHOLE_TURNS = tuple(sign * turn for turn in range(180, 561, 20) for sign in (1, -1))
_KEPT_TIED = 8  # paths that are made polygons of, of one signature of few strips
_EVERY_LOST = 0.15  # of the scans, that polygons of all turns may leave
_ALIKE = 0.003  # of the area's root: outlines that differ by less are one
_LARGEST = 2.0  # diagonals of the sensor: no outline is larger
_SPLINES = (4, 6, 8, 11, 15, 20, 26)  # knots of poses that are tied to a spline
_FREER = 2  # steps up these: the freedom that errors allow the motion
_NEAR = 6  # fits that are tried on the best of them
LEAST_STRIPS = 3  # that a scan touches: fewer tell hardly more than a pose
FEW_STRIPS = 12  # that read an outline at few places, the same ones as long as it does not move across them
_EXPLORED = 3  # rounds of looking beside a fit, as long as that finds a better one
# polygons that are settled, and of these recounted, where none of all turns explains the scans
_SETTLED, _RECOUNTED = 12, 3
_BASINS = 24  # polygons of all turns that are settled for rivals
_WITHIN = 8.0  # of the best criterion: fits that explain the readings as well
_WITHIN_KINKS = 16.0  # likewise of concave ones, which seldom come to rest at their least cost
_NO_OFFSETS = 50.0  # times the freedom: offsets do not explain so much
_SURE_OFFSETS = 60.0  # of the criterion: no other count of corners makes up for so much


def search(
    scans: RigidScans,
    distribution: str,
    *,
    offsets: bool = True,
    thorough: bool = True,
    begun: Found | None = None,
    starts: Starts | None = None,
    round_and_round: bool = True,
) -> Found:
    """Return the fit of all scans that explains them best, and what else does.

    One signature of few strips tells little more than a pose of each scan: there the poses are a spline, as long as
    one explains the readings. Else along a smooth path first, whose poses are free in the end; where that explains
    the readings badly, and if thorough, with more turns, then without a path. What moves along no smooth path is
    searched for without one first. Where a strain over time explains most of what the best outline leaves, no other is
    looked for: what deforms is no rigid object that was not found. `offsets`: of channels are looked for. `begun`: what
    a search that was not thorough found. `starts`: of these scans, where there are some. `round_and_round`: it may turn
    by more than the turns tried.
    """
    starts = starts or (begun and begun.starts) or Starts(scans)
    erratic, free, found = starts.erratic, None, begun
    few = needs_smooth_motion(scans) and scans.strips_touched < FEW_STRIPS

    def explained(one: Found) -> bool:
        return content(taken_off(scans, one.offsets), one.fit, distribution)

    def without_path() -> Found:
        if free is not None:
            return free
        known = None if begun is None else begun.fit.corners
        fit = hopped_fit(scans, distribution, known) if erratic and few else best_without_path(scans)
        return replace(_compared(scans, [fit], distribution), starts=starts)

    if erratic and few:
        return without_path()
    if found is None:
        if erratic:
            free = without_path()
            if explained(free):
                return free
        turns = starts.best(TURNS, KEPT)
        if needs_smooth_motion(scans):
            some = starts.best(TURNS, _KEPT_TIED) if few else turns
            found = _with_offsets(starts, some, distribution, offsets, tied=True)
            if explained(found):
                return found if few else _on_as_many_knots_as_all_ask_for(scans, found)
        found = _with_offsets(starts, turns, distribution, offsets)
        if starts.plain and not explained(found):
            found = replace(
                found, strained=strain_share(taken_off(scans, found.offsets), found.fit, found.offsets)
            )
        if round_and_round and not (explained(found) or found.strains) and starts.hopeless:
            beyond = starts.best(_WHOLE_TURNS, 1)
            if starts.rough[beyond[0]].cost < min(starts.rough[turn].cost for turn in turns):
                again = _with_offsets(starts, beyond, distribution, offsets)
                found = min(found, again, key=lambda f: f.criterion(scans))
    if not thorough or found.strains or scans.strips_touched < LEAST_STRIPS:
        return found

    def on_more_turns() -> Found:
        return _with_offsets(starts, starts.best(_FINE_TURNS, 2 * KEPT), distribution, offsets)

    if not round_and_round and not erratic:
        ways = [on_more_turns]
    elif len(bad_scans(taken_off(scans, found.offsets), found.fit)) > LOST * len(scans.k):
        ways = [without_path, on_more_turns]
    else:
        ways = [on_more_turns, without_path]
    for way in ways:
        if not explained(found):
            found = min(found, way(), key=lambda f: f.criterion(scans))
    return found


def rigid_stretch(starts: Starts, distribution: str, effort: int = 0) -> Found | None:
    """Return the fit of all scans that were started with; None where no rigid outline explains them.

    Efforts: a quick look (0), a whole search (1), and, where that failed, the corners of many rough outlines counted
    (2). Where few strips are touched and the quick look leaves many scans unexplained, more effort is not spent.
    """
    scans = starts.scans
    few = starts.plain and scans.strips_touched < FEW_A_SCAN
    if (few or effort == 0) and not starts.promising:
        return None
    if effort > 1:
        found = _counted(starts, distribution) if few else None
    elif effort > 0 and few:
        found = _on_all_turns(starts, distribution)
    else:
        found = search(
            scans, distribution, offsets=False, thorough=effort > 0, starts=starts, round_and_round=False
        )
    return found if found is not None and content(scans, found.fit, distribution) else None


def _on_all_turns(starts: Starts, distribution: str) -> Found | None:
    """Return the best fit from the outlines of all turns, however badly these explain the scans while they are rough.

    Then from beside it, too: which side of a strip a corner passes, few strips hardly tell. Rivals may be worse than
    elsewhere: few strips decide little, and scans with others about may decide. None where all are far from it.
    """
    scans, turns = starts.scans, starts.best(_FINE_TURNS, len(_FINE_TURNS))
    if starts.unexplained(turns) > _EVERY_LOST:
        return None
    every = _polygons(starts, scans, turns, distribution)
    best = min(every, key=lambda f: f.criterion(scans))
    best, tried = _improved(scans, best, _EXPLORED if content(scans, best, distribution) else 1)
    ends = [_on_all(scans, starts.chosen, fit) for fit in _roughly(starts, _BASINS)]
    new = min(ends, key=lambda f: f.criterion(scans), default=best)
    if new.criterion(scans) < best.criterion(scans) - 0.5:
        best, more = _improved(scans, new)
        tried += more
    return _among(scans, best, [*every, *tried, *ends], distribution, _WITHIN_KINKS)


def _roughly(starts: Starts, kept: int) -> list[Fit]:
    """Return the best polygons of all turns, not settled yet."""
    fits = starts.pruned(starts.best(_FINE_TURNS, len(_FINE_TURNS)))
    return sorted((f for f in fits if _plausible(starts.few, f)), key=lambda f: f.criterion(starts.few))[
        :kept
    ]


def _counted(starts: Starts, distribution: str) -> Found | None:
    """Return the first fit that explains the scans, of the best of all turns with corners counted one by one.

    With a corner too many or too few they stay far from any good fit. `FIRST` corners and more explain anything.
    """
    scans, rough = starts.scans, _roughly(starts, _SETTLED)
    fits = sorted((_on_all(scans, starts.chosen, f) for f in rough), key=lambda f: f.criterion(scans))
    for settled_fit in fits[:_RECOUNTED]:
        fit = recounted(scans, settled_fit)[0]
        if len(fit.corners) < FIRST and content(scans, fit, distribution):
            return _compared(scans, [fit], distribution)
    return None


def _with_offsets(
    starts: Starts, turns: list[int], distribution: str, wanted: bool, tied: bool = False
) -> Found:
    """Return the polygon that rough outlines become, of readings without what the channels are off.

    Its corners are counted once it is known what the channels are off, and without that where they may do without.
    """
    scans = starts.scans
    fits = _polygons(starts, scans, turns, distribution, tied)
    best = min(fits, key=lambda f: f.criterion(scans))
    wanted &= best.cost < _NO_OFFSETS * best.freedom(scans)
    asked = _asked_for(starts, turns, best) if wanted and not tied else []
    # Corners and offsets explain the same where few strips are touched, and need not where either may do without.
    compete = not wanted or scans.strips_touched < FEW_STRIPS or content(scans, best, distribution)
    compete &= not asked or _criterion(scans, *asked[0]) > best.criterion(scans) - _SURE_OFFSETS
    without = _compared(scans, fits, distribution) if compete else Found(best, np.arange(len(scans.k)))
    if asked and _criterion(scans, *asked[0]) > without.criterion(scans) - EVIDENCE:
        asked = []
    if wanted and not asked and (alone := channel_offsets(scans, without.fit)) is not None:
        asked = [alone]
    # else it is not offsets
    if not asked or asked[0][1].cost > WORTH_SETTLING * asked[0][1].freedom(scans):
        return replace(without if compete else _compared(scans, fits, distribution), starts=starts)
    offsets, fit = without_needless_corners(scans, *asked[0])
    rest = taken_off(scans, offsets)
    others = [one for _, one in asked[1:]] or _polygons(starts, rest, turns, distribution, tied)
    counted = _compared(rest, [fit, *others], distribution)
    free = replace(_with_offsets_again(scans, counted, offsets, distribution), starts=starts)
    return likelier(scans, free, without, distribution)


def _asked_for(starts: Starts, turns: list[int], without: Fit) -> list[tuple[Offsets, Fit]]:
    """Return offsets and fits of all scans that polygons of all counts become along with them, the best first.

    None where the fit without offsets explains the readings far better.
    """
    scans, chosen, ends = starts.scans, starts.chosen, list[tuple[Offsets, Fit]]()
    least = without.of(chosen).criterion(starts.few)
    for offsets, fit in offsets_of_all(starts.few, starts.pruned(turns), least):
        end = channel_offsets(scans, _on_all(taken_off(scans, offsets), chosen, fit), offsets)
        assert end is not None
        ends.append(end)
    return sorted(ends, key=lambda end: _criterion(scans, *end))


def _with_offsets_again(scans: RigidScans, found: Found, offsets: Offsets, distribution: str) -> Found:
    """Return what was found of readings without offsets, with these as its outline asks for them."""
    asked = channel_offsets(scans, found.fit, offsets)
    assert asked is not None
    offsets, best = without_needless_corners(scans, *asked)
    rest = taken_off(scans, offsets)
    rivals = [found.fit, *(fit for fit, _ in found.rivals)]
    fits = [settled(rest, fitted(rest, f.corners, f.poses, basis=f.basis)) for f in (best, *rivals)]
    best = min(fits, key=lambda f: f.criterion(rest))
    counted = len(best.corners) == len(found.fit.corners)
    again = _among(rest, best, fits, distribution) if counted else _compared(rest, fits, distribution)
    return replace(again, offsets=offsets)


def _criterion(scans: RigidScans, offsets: Offsets, fit: Fit) -> float:
    """Return what fits with offsets are compared by."""
    return fit.criterion(scans) + offsets.cost


def likelier(scans: RigidScans, a: Found, b: Found, distribution: str) -> Found:
    """Return what explains the scans better, with and without offsets, and the other as its rival where it may be."""
    best, other = sorted((a, b), key=lambda f: f.criterion(scans))
    worse = other.criterion(scans) - best.criterion(scans)
    if worse > _WITHIN or not content(taken_off(scans, other.offsets), other.fit, distribution):
        return best
    return replace(best, rivals=(*best.rivals, (other.fit, worse)))


def counted_among_followers(scans: RigidScans, found: Found, distribution: str) -> Found:
    """Return what was found with as many corners as errors ask for that follow each other from scan to scan.

    Such errors move the readings of many scans alike, as a corner does: what a corner gains counts as for so much
    larger errors of which each scan has its own. The same where they do not follow each other.
    """
    wider = following(scans, found.fit.corners, found.fit.poses)
    if wider == 1.0:
        return found
    larger = scans.with_sigma(wider * scans.sigma)
    again = _compared(
        larger, [_scaled(f, wider) for f in (found.fit, *(f for f, _ in found.rivals))], distribution
    )
    fit = _scaled(again.fit, 1.0 / wider)
    if not content(scans, fit, distribution):
        return found
    return replace(found, fit=fit, rivals=tuple((_scaled(f, 1.0 / wider), w) for f, w in again.rivals))


def _scaled(fit: Fit, larger: float) -> Fit:
    """Return a fit as of readings so many times as uncertain."""
    return replace(fit, costs=fit.costs / larger**2)


def freer_spline(basis: FloatArray | None) -> FloatArray | None:
    """Return a spline of more knots over the same scans: what the readings do not rule out, errors must allow for.

    The motion is no spline; that one of few knots explains the readings says only how smooth it is about. Of a spline
    for each of several stretches, each is freer.
    """
    if basis is None:
        return None
    every = np.arange(len(basis))
    there = basis != 0.0
    first, last = there.argmax(axis=0), len(basis) - 1 - there[::-1].argmax(axis=0)
    begins = [int(i) for i in every if not ((first < i) & (last >= i)).any()]
    parts = list[FloatArray]()
    for begin, end in zip(begins, [*begins[1:], len(basis)], strict=True):
        scans, knots = end - begin, int(((first >= begin) & (first < end)).sum())
        more = min([k for k in _SPLINES if k > knots][:_FREER] or [2 * knots], key=lambda k: -k)
        parts.append(spline_basis(np.arange(scans) / max(scans - 1, 1), min(more, scans)))
    return one_after_another(parts)


def _on_as_many_knots_as_all_ask_for(scans: RigidScans, found: Found) -> Found:
    """Return what was found of some scans with its poses on the spline that all of them ask for.

    Few scans ask for few knots, and poses on these rest where no step of so stiff a path gets across a kink, degrees
    off and by many deviations: the path is loosened first, then stiffened again. Akaike's criterion weighs errors of
    the spline as those of noise; BIC lets them grow. Not of few strips, where more knots cost more than they mend.
    """
    rest, fit = taken_off(scans, found.offsets), found.fit
    assert fit.basis is not None
    every, tries = np.arange(len(scans.k)), [fit]
    for knots in reversed([k for k in _SPLINES if fit.basis.shape[1] <= k <= len(every) // 2]):
        basis = spline_basis(every / (len(every) - 1), knots)
        tries.append(fitted(rest, tries[-1].corners, tries[-1].poses, basis=basis))
    fit = min(tries[1:] or tries, key=lambda t: t.cost + 2.0 * (rest.readings.sum() - t.freedom(rest)))
    others = [fitted(rest, f.corners, f.poses, basis=fit.basis) for f, _ in found.rivals]
    worse = [other.criterion(rest) - fit.criterion(rest) for other in others]
    return replace(found, fit=fit, rivals=tuple(zip(others, worse, strict=True)))


def _polygons(
    starts: Starts, scans: RigidScans, turns: list[int], distribution: str, tied: bool = False
) -> list[Fit]:
    """Return the polygons of all scans that rough outlines become; their poses free, or tied to a spline.

    `scans` are those of the starts, or these without what the channels are off.
    """
    chosen = starts.chosen
    if scans is starts.scans and not tied:
        few, fits = starts.few, starts.pruned(turns)
    else:
        few, fits = scans.of(chosen), []
        paths = starts.paths(turns)
        for basis in starts.splines if tied else [None]:  # the smoothest motion first
            fits += [fit for path in paths for fit in pruned(few, path.corners, path.poses, basis)]
            if any(content(few, fit, distribution) for fit in fits):
                break
    fits = [f for f in fits if _plausible(few, f)] or fits
    fits = sorted(fits, key=lambda f: f.criterion(few))
    if tied:
        fits = _on_the_best_spline(scans, chosen, fits)
    fits = _alternatives(few, fits, distribution)
    return [_on_all(scans, chosen, f) for f in fits]


def _compared(scans: RigidScans, fits: list[Fit], distribution: str, within: float = _WITHIN) -> Found:
    """Return the best of fits of all scans, without corners that it does not need, and those that are about as good."""
    best, tried = _improved(scans, min(fits, key=lambda f: f.criterion(scans)))
    return _among(scans, best, [*fits, *tried], distribution, within)


def _improved(scans: RigidScans, fit: Fit, rounds: int = 1) -> tuple[Fit, list[Fit]]:
    """Return the fit with as many corners as it needs, or a better one from beside it, and all that was tried.

    The fit itself where it is far from the readings. `rounds`: of looking beside it, as long as corners are counted
    anew from there.
    """
    if fit.cost >= WORTH_SETTLING * fit.freedom(scans):
        return fit, [fit]
    best, counts = recounted(scans, fit)
    tried = [fit, best, *counts]
    for _ in range(rounds if reflex(best.corners).any() or scans.strips_touched < FEW_STRIPS else 0):
        first, *others = explored(scans, best)
        tried += others
        if first is best:
            break
        best, counts = recounted(scans, first)
        tried += [best, *counts]
        if best is first:  # which has been looked beside
            break
    return best, tried


def _among(
    scans: RigidScans, best: Fit, fits: list[Fit], distribution: str, within: float = _WITHIN
) -> Found:
    """Return the best fit with those among fits that are about as good."""
    if best.cost < WORTH_SETTLING * best.freedom(scans) and reflex(best.corners).any():
        within = _WITHIN_KINKS
    rivals = list[tuple[Fit, float]]()
    for fit in sorted(fits, key=lambda f: f.criterion(scans)):
        worse = fit.criterion(scans) - best.criterion(scans)
        unlike = not any(_same(fit, f) for f in (best, *(r for r, _ in rivals)))
        if worse <= within and unlike and content(scans, fit, distribution):
            rivals.append((fit, worse))
    return Found(best, np.arange(len(scans.k)), tuple(rivals))


def compared_again(scans: RigidScans, found: Found, fit: Fit, distribution: str) -> Found:
    """Return what was found of some scans as of these and more, about a fit of all: counted and compared anew."""
    others = [
        settled(scans, fitted(scans, corners, fit.poses, basis=fit.basis)) for corners in found.outlines
    ]
    return _compared(scans, [unstuck(scans, fit), *others], distribution)


def _on_the_best_spline(scans: RigidScans, chosen: IntArray, fits: list[Fit]) -> list[Fit]:
    """Return the fits that may be right on splines of as many knots as the readings ask for, the best first."""
    few, best, worse = scans.of(chosen), fits[0], 0
    for knots in _SPLINES:
        if knots > len(chosen) // 2 or worse == 2:
            break
        basis = spline_over(scans, chosen, knots)
        fit = fitted(few, fits[0].corners, fits[0].poses, 20, basis=basis)
        best, worse = (fit, 0) if fit.criterion(few) < best.criterion(few) else (best, worse + 1)
    near = [f for f in fits if f.cost < WORTH_SETTLING * fits[0].freedom(few)]
    again = [fitted(few, f.corners, f.poses, 20, basis=best.basis) for f in near[:_NEAR]]
    return sorted([best, *again], key=lambda f: f.criterion(few))


def _alternatives(scans: RigidScans, fits: list[Fit], distribution: str) -> list[Fit]:
    """Return the best fit and those that explain the readings about as well, each outline once, the best first."""
    best = settled(scans, fits[0])
    found = [best]
    for fit in fits[1:]:
        if fit.cost > WORTH_SETTLING * fit.freedom(scans):
            continue
        fit = settled(scans, fit)
        worse = fit.criterion(scans) - min(f.criterion(scans) for f in found)
        if worse <= _WITHIN and content(scans, fit, distribution) and not any(_same(fit, f) for f in found):
            found.append(fit)
    return sorted(found, key=lambda f: f.criterion(scans))


def _same(a: Fit, b: Fit) -> bool:
    """Whether two fits of the same scans have one outline."""
    if len(a.corners) != len(b.corners):
        return False
    longest = [float(np.hypot(*(o[:, None] - o).T).max()) for o in (a.corners, b.corners)]
    if abs(longest[1] - longest[0]) > 2.0 * _ALIKE * longest[1]:  # whichever way they lie
        return False
    areas = [abs(area(o.corners)) for o in (a, b)]
    far = _ALIKE * math.sqrt(areas[1])
    around = max(float(np.hypot(*(np.roll(o.corners, -1, axis=0) - o.corners).T).sum()) for o in (a, b))
    if abs(areas[1] - areas[0]) > 2.0 * far * around:
        return False
    p, q = (shapely.Polygon(o).buffer(0) for o in (carried(a, b.poses), b.corners))
    return bool(p.hausdorff_distance(q) < _ALIKE * math.sqrt(q.area))


def _plausible(scans: RigidScans, fit: Fit) -> bool:
    sensor = scans.sensor
    return bool(np.ptp(fit.corners, axis=0).max() < _LARGEST * math.hypot(sensor.width_mm, sensor.length_mm))


def _on_all(scans: RigidScans, chosen: IntArray, fit: Fit) -> Fit:
    """Return a fit of some scans as one of all, settled and recounted."""
    poses = fit.poses
    if fit.basis is not None:
        basis = spline_over(scans, np.arange(len(scans.k)), fit.basis.shape[1])
        knots = np.linalg.lstsq(fit.basis, poses, rcond=None)[0]
        return fitted(scans, fit.corners, basis @ knots, basis=basis)
    if len(chosen) < len(scans.k):
        from scipy.interpolate import CubicSpline  # late: `live` would start a third of a second later

        poses = CubicSpline(chosen, poses)(np.arange(len(scans.k)))
        rough = fitted(scans, fit.corners, poses, 6, 0.05 * scans.sensor.pitch_mm, 5.0)
        fit = fitted(scans, rough.corners, rough.poses)
    else:
        fit = fitted(scans, fit.corners, poses)
    fit = rescued(scans, fit)
    if fit.basis is None and len(bad_scans(scans, fit)) > LOST * len(scans.k):
        return fit
    return unstuck(scans, settled(scans, fit))
