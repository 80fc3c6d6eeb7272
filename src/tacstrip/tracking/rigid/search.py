"""Shape and poses from the readings alone."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import shapely

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.core.rigid import RigidScans, equations, fit_poses, loss
from tacstrip.geometry.pose import in_frame, placed
from tacstrip.reconstruction.polygon.goodness_of_fit import chi_square_score
from tacstrip.tracking.rigid.corners import (
    FIRST,
    MOST_BAD,
    Fit,
    bad_scans,
    explored,
    fitted,
    poses_all_round,
    pruned,
    recounted,
    reflex,
    rescued,
    settled,
    unstuck,
)
from tacstrip.tracking.rigid.covariance import following
from tacstrip.tracking.rigid.hopping import hopped
from tacstrip.tracking.rigid.joined_paths import joined
from tacstrip.tracking.rigid.offsets import Offsets, channel_offsets, taken_off, without_needless_corners
from tacstrip.tracking.rigid.smooth_path import (
    Path,
    centres,
    circle,
    fit_path,
    one_after_another,
    spline_basis,
)

_TURNS, _FINE_TURNS = (tuple(range(-160, 161, step)) for step in (20, 10))  # degrees
_WHOLE_TURNS = tuple(sign * turn for turn in range(180, 561, 20) for sign in (1, -1))
_DENSE, _MANY_STRIPS, _SPARSE = 48, 20, 16  # scans that a search uses; of finer sensors fewer do
_KNOTS, _MORE_KNOTS = 4, 8
_ALIKE = 0.003  # of the area's root: outlines that differ by less are one
_LARGEST = 2.0  # diagonals of the sensor: no outline is larger
_SPLINES = (4, 6, 8, 11, 15, 20, 26)  # knots of poses that are tied to a spline
_FREER = 2  # steps up these: the freedom that errors allow the motion
_NEAR = 6  # fits that are tried on the best of them
LEAST_STRIPS = 3  # that a scan touches: fewer tell hardly more than a pose
FEW_STRIPS = 12  # that read an outline at few places, the same ones as long as it does not move across them
_KEPT, _KEPT_TIED = 3, 8  # paths that are made polygons of; of one signature of few strips
FEW_A_SCAN = (
    6  # strips: scans that touch fewer explain one another at many wrong turns, so that all are tried
)
_EXPLORED = 3  # rounds of looking beside a fit, as long as that finds a better one
# polygons that are settled, and of these recounted, where none of all turns explains the scans
_SETTLED, _RECOUNTED = 12, 3
_BASINS = 24  # polygons of all turns that are settled for rivals
_SATISFIED = 1.15  # of the freedom: a chi square that ends the search
_ALARM, _HARDLY_MORE = 3.5, 1.05  # deviations of chi square, and times the freedom
_WITHIN = 8.0  # of the best criterion: fits that explain the readings as well
_WITHIN_KINKS = 16.0  # likewise of concave ones, which seldom come to rest at their least cost
_UNLIKELY = 0.05  # odds of another count of corners, against the best fit, that are taken for none
_LOST = 0.5  # of the scans: a polygon that leaves more will not explain them once it is settled
_FEW_LOST, _EVERY_LOST = 0.3, 0.15  # likewise of a stretch that touches few strips, and polygons of all turns
_WORTH_SETTLING = 1.6  # times the freedom: fits that may, once they are settled
_NO_OFFSETS = 50.0  # likewise: offsets do not explain so much
_SOFT, _HARD = 0.25, 0.1  # pitches that an end of an outline is off
_COARSE, _FINER, _FINEST = 0.07, 0.023, 0.012  # tolerances of edges, over the outline's radius
_ROUGH, _SMOOTHER = 0.07, 0.09  # the radii's second differences, likewise
_ERRATIC = 0.2  # of the radius: a middle that is so far off any smooth path, in the median, moves along none
_REFERENCES = 3  # of a search without a path: scans that it begins with ...
_EASED = (0.04, 0.025, 0.016)  # ... and the tolerance of each round from one of them
_RANDOM_SCANS = 40
_JOINED = 3  # rivals of one stretch that another is tried with


def content(scans: RigidScans, fit: Fit, distribution: str) -> bool:
    """Whether the fit leaves no more of the readings than noise does, or hardly more where they are very many."""
    return within_noise(fit.costs, fit.freedom(scans), distribution)


def within_noise(costs: FloatArray, freedom: int, distribution: str) -> bool:
    """Whether what scans cost (T,) is what noise of so many degrees of freedom costs."""
    return (
        float(costs.sum()) <= _HARDLY_MORE * freedom
        or chi_square_score(np.sqrt(costs), freedom, distribution) <= _ALARM
    )


@dataclass(frozen=True, eq=False)
class Found:
    """What a search ended with.

    Attributes
    ----------
    fit
        Of all scans.
    chosen
        Scans that the rivals are fits of (K,).
    rivals
        Fits that explain these about as well, but for the best one, and how much worse their criterion is.
    offsets
        Of the channels, where the readings ask for them: the fits are of readings without these.
    starts
        What the search began with, for one that is more thorough.
    """

    fit: Fit
    chosen: IntArray
    rivals: tuple[tuple[Fit, float], ...] = ()
    offsets: Offsets | None = None
    starts: Starts | None = field(default=None, repr=False)

    def criterion(self, scans: RigidScans) -> float:
        """Return what searches are compared by: the fit's, and what the offsets cost."""
        return self.fit.criterion(scans) + (0.0 if self.offsets is None else self.offsets.cost)

    @property
    def others(self) -> list[tuple[FloatArray, float]]:
        """The rivals' corners in the fit's frame, each with its weight against all others, the fit's included."""
        odds = [math.exp(-0.5 * max(worse, 0.0)) for _, worse in self.rivals]
        total, poses = 1.0 + sum(odds), self.fit.poses[self.chosen]
        return [(carried(fit, poses), one / total) for (fit, _), one in zip(self.rivals, odds, strict=True)]

    @property
    def spread_mm(self) -> float:
        """How far the rivals' outlines are from the fit's, at most: Hausdorff's distance."""
        own = shapely.Polygon(self.fit.corners).buffer(0)
        return max(
            (float(shapely.Polygon(o).buffer(0).hausdorff_distance(own)) for o, _ in self.others), default=0.0
        )

    def unlike(self, scans: RigidScans, least_mm: float) -> list[Fit]:
        """Return the rivals with poses of all scans, each the one that is most unlike the fit and those before it."""
        others = [
            (fit, shapely.Polygon(o).buffer(0))
            for (fit, _), (o, _) in zip(self.rivals, self.others, strict=True)
        ]
        kept, shapes = list[Fit](), [shapely.Polygon(self.fit.corners).buffer(0)]
        apart = [float(shape.hausdorff_distance(shapes[0])) for _, shape in others]
        while apart and max(apart) > least_mm:
            fit, shape = others[int(np.argmax(apart))]
            kept.append(with_all_poses(scans, self.chosen, fit))
            apart = [
                min(a, float(s.hausdorff_distance(shape))) for a, (_, s) in zip(apart, others, strict=True)
            ]
        return kept

    def of_other_count(self, least_mm: float) -> int:
        """Return how many corners the likeliest rival has that has more or fewer and is off by so much; 0: none is.

        What is less likely than `_UNLIKELY` does not count, nor do `FIRST` corners and more: they stand for a curve.
        """
        own = shapely.Polygon(self.fit.corners).buffer(0)
        for (fit, worse), (outline, _) in zip(self.rivals, self.others, strict=True):
            far = float(shapely.Polygon(outline).buffer(0).hausdorff_distance(own))
            if (
                len(fit.corners) != len(self.fit.corners)
                and math.exp(-0.5 * worse) > _UNLIKELY
                and max(len(fit.corners), len(self.fit.corners)) < FIRST
                and far > least_mm
            ):
                return len(fit.corners)
        return 0


def carried(rival: Fit, poses: FloatArray) -> FloatArray:
    """Return a rival's corners as the frame has them whose poses in the same scans are these, in the median."""
    turns = np.angle(np.exp(1j * (rival.poses[:, 2] - poses[:, 2])))
    turn = turns[0] + np.median(np.angle(np.exp(1j * (turns - turns[0]))))
    middle = rival.corners.mean(axis=0)
    seen = [
        in_frame(placed(middle[None], own), pose)[0] for own, pose in zip(rival.poses, poses, strict=True)
    ]
    return placed(rival.corners - middle, np.array([*np.median(seen, axis=0), turn]))


@dataclass(eq=False)
class Starts:
    """Rough outlines on smooth paths, by total turn [deg], and the polygons that they become: each made once.

    Attributes
    ----------
    scans
        All of them.
    rough, refined
        Outlines on few knots, and the best of them on more.
    polygons
        With free poses, of ever fewer corners.
    """

    scans: RigidScans
    rough: dict[int, Path] = field(default_factory=dict)
    refined: dict[int, Path] = field(default_factory=dict)
    polygons: dict[int, list[Fit]] = field(default_factory=dict)

    @cached_property
    def chosen(self) -> IntArray:
        """Scans that a search uses."""
        return _chosen(self.scans)

    @cached_property
    def few(self) -> RigidScans:
        """These."""
        return self.scans.of(self.chosen)

    @cached_property
    def splines(self) -> list[FloatArray]:
        """Of few and of more knots, over these."""
        return [_spline(self.scans, self.chosen, knots) for knots in (_KNOTS, _MORE_KNOTS)]

    @property
    def erratic(self) -> bool:
        """Whether the contact's middle moves along no smooth path."""
        middle, area = centres(self.few)
        basis = self.splines[1]
        off = middle - basis @ np.linalg.lstsq(basis, middle, rcond=None)[0]
        return bool(np.median(np.hypot(*off.T)) > _ERRATIC * math.sqrt(float(np.median(area)) / math.pi))

    def best(self, turns: Sequence[int], kept: int) -> list[int]:
        """Return the turns that the best outlines come from."""
        for turn in turns:
            if turn not in self.rough:
                path = circle(self.few, self.splines[0], math.radians(turn))
                path = fit_path(self.few, path, 8, tolerance=_COARSE, cauchy=3.0, rough=_ROUGH, end=_SOFT)
                path = fit_path(self.few, path, 6, tolerance=_FINER, cauchy=3.0, rough=_ROUGH, end=_SOFT)
                self.rough[turn] = path
        near = sorted(turns, key=lambda t: self.rough[t].cost)[: 2 * kept]
        for turn in near:
            if turn not in self.refined:
                path = self.rough[turn].refined(self.splines[1])
                path = fit_path(self.few, path, 10, tolerance=_FINER, cauchy=3.0, rough=_ROUGH, end=_SOFT)
                path = fit_path(self.few, path, 6, tolerance=_FINEST, cauchy=3.0, rough=_SMOOTHER, end=_HARD)
                self.refined[turn] = path
        return sorted(near, key=lambda t: self.refined[t].cost)[:kept]

    def paths(self, turns: Sequence[int]) -> list[Path]:
        """Return the outlines of some turns."""
        return [self.refined[turn] for turn in turns]

    def pruned(self, turns: Sequence[int]) -> list[Fit]:
        """Return the polygons, with free poses, that the outlines of some turns become."""
        for turn, path in zip(turns, self.paths(turns), strict=True):
            if turn not in self.polygons:
                self.polygons[turn] = pruned(self.few, path.corners, path.poses)
        return [fit for turn in turns for fit in self.polygons[turn]]

    @cached_property
    def hopeless(self) -> bool:
        """Whether the best outlines leave most scans unexplained, as those of a rigid object hardly ever do."""
        return self.unexplained(self.best(_TURNS, _KEPT)) > _LOST

    @property
    def plain(self) -> bool:
        """Whether outlines on smooth paths tell if a rigid one explains the scans."""
        return not self.erratic and not needs_smooth_motion(self.scans)

    @property
    def promising(self) -> bool:
        """Whether a rigid outline may explain a stretch of scans, by the best on smooth paths."""
        few = self.scans.strips_touched < FEW_A_SCAN
        return not self.plain or self.unexplained(self.best(_TURNS, _KEPT)) <= (_FEW_LOST if few else _LOST)

    def unexplained(self, turns: Sequence[int]) -> float:
        """Return the share of the scans that the polygons of some turns leave unexplained, at least."""
        return min(len(bad_scans(self.few, f)) for f in self.pruned(turns)) / len(self.chosen)


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
    searched for without one first. `offsets`: of channels are looked for. `begun`: what a search that was not thorough
    found. `starts`: of these scans, where there are some. `round_and_round`: it may turn by more than the turns tried.
    """
    starts = starts or (begun and begun.starts) or Starts(scans)
    erratic, free, found = starts.erratic, None, begun
    few = needs_smooth_motion(scans) and scans.strips_touched < FEW_STRIPS

    def explained(one: Found) -> bool:
        return content(taken_off(scans, one.offsets), one.fit, distribution)

    def without_path() -> Found:
        fit = _hopped(scans, distribution) if erratic and few else _without_path(scans)
        return free or replace(_compared(scans, [fit], distribution), starts=starts)

    if found is None:
        if erratic:
            free = without_path()
            if few or explained(free):
                return free
        turns = starts.best(_TURNS, _KEPT)
        if needs_smooth_motion(scans):
            some = starts.best(_TURNS, _KEPT_TIED) if few else turns
            found = _with_offsets(starts, some, distribution, offsets, tied=True)
            if explained(found):
                return found if few else _on_as_many_knots_as_all_ask_for(scans, found)
        found = _with_offsets(starts, turns, distribution, offsets)
        if round_and_round and not explained(found) and starts.hopeless:
            beyond = starts.best(_WHOLE_TURNS, 1)
            if starts.rough[beyond[0]].cost < min(starts.rough[turn].cost for turn in turns):
                again = _with_offsets(starts, beyond, distribution, offsets)
                found = min(found, again, key=lambda f: f.criterion(scans))
    if not thorough or scans.strips_touched < LEAST_STRIPS:
        return found

    def on_more_turns() -> Found:
        return _with_offsets(starts, starts.best(_FINE_TURNS, 2 * _KEPT), distribution, offsets)

    if not round_and_round and not erratic:
        ways = [on_more_turns]
    elif len(bad_scans(taken_off(scans, found.offsets), found.fit)) > _LOST * len(scans.k):
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
    found = _compared(scans, every, distribution)
    for _ in range(_EXPLORED if content(scans, found.fit, distribution) else 0):
        fits, least = [found.fit, *(fit for fit, _ in found.rivals)], found.fit.criterion(scans)
        found = _compared(scans, [*fits, *explored(scans, found.fit)], distribution)
        if found.fit.criterion(scans) > least - 0.5:
            break
    rough = _roughly(starts, _BASINS)
    ends = [_on_all(scans, starts.chosen, fit) for fit in rough]
    return _compared(scans, [found.fit, *(f for f, _ in found.rivals), *ends], distribution, _WITHIN_KINKS)


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

    Of many strips its corners are counted only once it is known what the channels are off.
    """
    scans = starts.scans
    fits = _polygons(starts, scans, turns, distribution, tied)
    best = min(fits, key=lambda f: f.criterion(scans))
    # Corners and offsets explain the same where few strips are touched, and need not where either may do without.
    compete = not wanted or scans.strips_touched < FEW_STRIPS or content(scans, best, distribution)
    without = _compared(scans, fits, distribution) if compete else Found(best, np.arange(len(scans.k)))
    wanted &= without.fit.cost < _NO_OFFSETS * without.fit.freedom(scans)
    asked = channel_offsets(scans, without.fit) if wanted else None
    if asked is None or asked[1].cost > _WORTH_SETTLING * asked[1].freedom(scans):  # it is not offsets, then
        return replace(without if compete else _compared(scans, fits, distribution), starts=starts)
    offsets, _ = without_needless_corners(scans, *asked)
    fits = _polygons(starts, taken_off(scans, offsets), turns, distribution, tied)
    fits.sort(key=lambda f: f.criterion(scans))
    if compete:
        found = _compared(taken_off(scans, offsets), fits, distribution)
        fits = [found.fit, *(f for f, _ in found.rivals)]
    asked = channel_offsets(scans, fits[0], offsets)
    assert asked is not None
    offsets, best = without_needless_corners(scans, *asked)
    rest = taken_off(scans, offsets)
    again = [settled(rest, fitted(rest, f.corners, f.poses, basis=f.basis)) for f in (best, *fits)]
    free = replace(_compared(rest, again, distribution), offsets=offsets, starts=starts)
    return likelier(scans, free, without, distribution)


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


def needs_smooth_motion(scans: RigidScans) -> bool:
    """Whether a scan tells hardly more than a pose: one signature."""
    return len(scans.read) == 1


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


def _chosen(scans: RigidScans) -> IntArray:
    """Return the scans that a search uses."""
    many = _SPARSE if scans.k.shape[2] > _MANY_STRIPS else _DENSE
    return np.unique(np.linspace(0, len(scans.k) - 1, min(len(scans.k), many)).astype(int))


def _spline(scans: RigidScans, chosen: IntArray, knots: int) -> FloatArray:
    return spline_basis(chosen / max(len(scans.k) - 1, 1), min(knots, len(chosen)), straight=True)


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
    every = sorted(fits, key=lambda f: f.criterion(scans))
    best = every[0]
    if best.cost < _WORTH_SETTLING * best.freedom(scans):
        best, counts = recounted(scans, best)
        every += counts
        concave = bool(reflex(best.corners).any())
        if concave or scans.strips_touched < FEW_STRIPS:
            first, *others = explored(scans, best)
            best, counts = recounted(scans, first) if first is not best else (best, [])
            every = [*every, *others, *counts]
            within = _WITHIN_KINKS if concave else within
    rivals = list[tuple[Fit, float]]()
    for fit in sorted(every, key=lambda f: f.criterion(scans)):
        worse = fit.criterion(scans) - best.criterion(scans)
        unlike = not any(_same(fit, f) for f in (best, *(r for r, _ in rivals)))
        if worse <= within and unlike and content(scans, fit, distribution):
            rivals.append((fit, worse))
    return Found(best, np.arange(len(scans.k)), tuple(rivals))


def compared_again(scans: RigidScans, found: Found, fit: Fit, distribution: str) -> Found:
    """Return what was found of some scans as of these and more, about a fit of all: counted and compared anew."""
    others = [
        settled(scans, fitted(scans, corners, fit.poses, basis=fit.basis)) for corners, _ in found.others
    ]
    return _compared(scans, [unstuck(scans, fit), *others], distribution)


def _on_the_best_spline(scans: RigidScans, chosen: IntArray, fits: list[Fit]) -> list[Fit]:
    """Return the fits that may be right on splines of as many knots as the readings ask for, the best first."""
    few, best, worse = scans.of(chosen), fits[0], 0
    for knots in _SPLINES:
        if knots > len(chosen) // 2 or worse == 2:
            break
        basis = _spline(scans, chosen, knots)
        fit = fitted(few, fits[0].corners, fits[0].poses, 20, basis=basis)
        best, worse = (fit, 0) if fit.criterion(few) < best.criterion(few) else (best, worse + 1)
    near = [f for f in fits if f.cost < _WORTH_SETTLING * fits[0].freedom(few)]
    again = [fitted(few, f.corners, f.poses, 20, basis=best.basis) for f in near[:_NEAR]]
    return sorted([best, *again], key=lambda f: f.criterion(few))


def _alternatives(scans: RigidScans, fits: list[Fit], distribution: str) -> list[Fit]:
    """Return the best fit and those that explain the readings about as well, each outline once, the best first."""
    best = settled(scans, fits[0])
    found = [best]
    for fit in fits[1:]:
        if fit.cost > _WORTH_SETTLING * fit.freedom(scans):
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
    p, q = (shapely.Polygon(o).buffer(0) for o in (carried(a, b.poses), b.corners))
    return bool(p.hausdorff_distance(q) < _ALIKE * math.sqrt(q.area))


def _plausible(scans: RigidScans, fit: Fit) -> bool:
    sensor = scans.sensor
    return bool(np.ptp(fit.corners, axis=0).max() < _LARGEST * math.hypot(sensor.width_mm, sensor.length_mm))


def _on_all(scans: RigidScans, chosen: IntArray, fit: Fit) -> Fit:
    """Return a fit of some scans as one of all, settled and recounted."""
    poses = fit.poses
    if fit.basis is not None:
        basis = _spline(scans, np.arange(len(scans.k)), fit.basis.shape[1])
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
    if fit.basis is None and len(bad_scans(scans, fit)) > _LOST * len(scans.k):
        return fit
    return unstuck(scans, settled(scans, fit))


def _without_path(scans: RigidScans) -> Fit:
    """Return a fit that takes poses for independent: a scan's own outline, poses of all others on it, and again."""
    total = len(scans.k)
    chosen = np.unique(np.linspace(0, total - 1, min(total, _RANDOM_SCANS)).astype(int))
    few = scans.of(chosen)
    order = np.argsort(-few.readings, kind="stable")
    references = order[:: max(1, len(order) // (2 * _REFERENCES))][:_REFERENCES]
    free, best = np.eye(len(chosen)), None
    for reference in references:
        alone = few.of([reference])
        path = circle(alone, np.ones((1, 1)), 0.0)
        path = fit_path(alone, path, 20, tolerance=_FINER, cauchy=3.0, rough=_ROUGH, end=0.25)
        for tolerance in _EASED:
            near = poses_all_round(few, path.corners, tolerance * float(path.radii.mean()), 24, 3)[0]
            path = Path(path.radii, _wrapped(near[:, 0]), free, np.inf)
            path = fit_path(few, path, 10, tolerance=tolerance, cauchy=3.0, rough=_ROUGH, end=0.1)
        fit = min(pruned(few, path.corners, path.poses), key=lambda f: f.criterion(few))
        hopeless = len(bad_scans(few, fit)) > MOST_BAD * len(chosen)
        if not hopeless:
            fit = settled(few, rescued(few, fit))
        if best is None or fit.criterion(few) < best.criterion(few):
            best = fit
        # one scan of many strips shows an outline that explains others, if it is rigid
        if fit.cost < _SATISFIED * fit.freedom(few) or (hopeless and scans.k.shape[2] > _MANY_STRIPS):
            break
    assert best is not None
    if len(chosen) < total:
        poses = poses_all_round(scans, best.corners, 0.05 * scans.sensor.pitch_mm)[0][:, 0]
        best = settled(scans, fitted(scans, best.corners, poses))
    return best if best.cost > _WORTH_SETTLING * best.freedom(scans) else unstuck(scans, best)


def _hopped(scans: RigidScans, distribution: str) -> Fit:
    """Return a fit that takes poses for independent, of one signature of few strips."""
    chosen = np.unique(np.linspace(0, len(scans.k) - 1, min(len(scans.k), _DENSE)).astype(int))
    few = scans.of(chosen)
    fit = hopped(few, lambda f: content(few, f, distribution))
    if len(chosen) < len(scans.k):
        poses = poses_all_round(scans, fit.corners, 0.05 * scans.sensor.pitch_mm)[0][:, 0]
        fit = settled(scans, fitted(scans, fit.corners, poses))
    return fit if fit.cost > _WORTH_SETTLING * fit.freedom(scans) else unstuck(scans, fit)


def _wrapped(poses: FloatArray) -> FloatArray:
    return np.column_stack([poses[:, :2], (poses[:, 2] + np.pi) % (2.0 * np.pi) - np.pi])


def with_all_poses(scans: RigidScans, chosen: IntArray, fit: Fit) -> Fit:
    """Return a fit of some scans with the poses of all: from those next to it, and all round where that fails."""
    if len(chosen) == len(scans.k):
        return fit
    if fit.basis is not None:
        basis = _spline(scans, np.arange(len(scans.k)), fit.basis.shape[1])
        poses = basis @ np.linalg.lstsq(basis[chosen], fit.poses, rcond=None)[0]
        return Fit(fit.corners, poses, equations(scans, fit.corners, poses, loss(scans)).costs, basis)
    start = np.stack(
        [np.interp(np.arange(len(scans.k)), chosen, p) for p in np.unwrap(fit.poses, axis=0).T], axis=1
    )
    poses, costs = fit_poses(
        scans, fit.corners, start[:, None], loss(scans, 0.05 * scans.sensor.pitch_mm, 5.0), 8
    )
    poses, costs = fit_poses(scans, fit.corners, poses, loss(scans), 12)
    found = Fit(fit.corners, poses[:, 0], costs[:, 0])
    bad = bad_scans(scans, found)
    if len(bad):
        others, cost = poses_all_round(scans.of(bad), fit.corners, 0.05 * scans.sensor.pitch_mm)
        better = cost[:, 0] < found.costs[bad]
        found.poses[bad[better]], found.costs[bad[better]] = others[better, 0], cost[better, 0]
    return found


def recognised(known: RigidScans, fit: Fit, scans: RigidScans, distribution: str) -> Fit | None:
    """Return the fit of known scans and further ones, where the known outline explains these too; else None."""
    middle, last = len(scans.k) // 2, len(scans.k)
    soft, exact = loss(scans, 0.05 * scans.sensor.pitch_mm, 6.0), loss(scans)
    best, least = None, np.inf
    for start in poses_all_round(scans.of([middle]), fit.corners, 0.05 * scans.sensor.pitch_mm, kept=8)[0][0]:
        poses, costs = np.empty((last, 3)), np.empty(last)
        for way in (range(middle, last), range(middle, -1, -1)):
            pose = start
            for i in way:
                one = scans.of([i])
                found = fit_poses(one, fit.corners, pose[None, None], soft, 5)[0]
                found, cost = fit_poses(one, fit.corners, found, exact, 8)
                pose = poses[i] = found[0, 0]
                costs[i] = cost[0, 0]
        if costs.sum() < least:
            best, least = poses, float(costs.sum())
    assert best is not None
    together = replace(known, k=np.concatenate([known.k, scans.k]))
    joint = fitted(together, fit.corners, np.concatenate([fit.poses, best]), 10, cauchy=5.0)
    joint = settled(together, rescued(together, fitted(together, joint.corners, joint.poses)))
    return _explaining_both(together, [joint], scans, distribution)


def recognised_on_path(known: RigidScans, found: Found, scans: RigidScans, distribution: str) -> Fit | None:
    """Return the fit of known scans and further ones, of poses on a spline each; None where none explains both.

    Known scans leave much open: which of the outlines that explain them is right, the further ones may decide.
    """
    together = replace(known, k=np.concatenate([known.k, scans.k]))
    every = len(found.chosen) == len(known.k)
    fits = [found.fit, *(fit for fit, _ in found.rivals[:_JOINED] if every)]
    return _explaining_both(together, joined(known, fits, scans), scans, distribution)


def _explaining_both(
    together: RigidScans, fits: Iterable[Fit], last: RigidScans, distribution: str
) -> Fit | None:
    """Return the first of fits that explains the last scans by themselves and all, or one from the best; else None."""

    def both_explained(fit: Fit) -> bool:
        count = len(last.k)
        basis = None if fit.basis is None else fit.basis[-count:]
        if basis is not None:
            basis = basis[:, (basis != 0.0).any(axis=0)]
        part = Fit(fit.corners, fit.poses[-count:], fit.costs[-count:], basis)
        return content(last, part, distribution) and content(together, fit, distribution)

    tried = list[Fit]()
    for fit in fits:
        if both_explained(fit):
            return fit
        tried.append(fit)
    fit = min(tried, key=lambda f: f.criterion(together))
    # Too few scans may have told a corner too few, or an outline that is off along what they left open.
    for further in (unstuck, lambda every, fit: explored(every, fit)[0]):
        if fit.cost > _WORTH_SETTLING * fit.freedom(together):
            break
        fit = recounted(together, further(together, fit))[0]
        if both_explained(fit):
            return fit
    return None
