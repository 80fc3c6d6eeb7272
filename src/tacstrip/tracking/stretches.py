"""The shape of one stretch of scans, and the other stretches that it explains."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from tacstrip.core.problem import FLOOR
from tacstrip.core.rigid import RigidScans
from tacstrip.tracking.episodes import Episode
from tacstrip.tracking.objects import GUESS, Object, Readings
from tacstrip.tracking.rigid.corners import posed
from tacstrip.tracking.rigid.covariance import following
from tacstrip.tracking.rigid.curved import rigid_curve
from tacstrip.tracking.rigid.found import Found, content, with_all_poses
from tacstrip.tracking.rigid.offsets import taken_off
from tacstrip.tracking.rigid.recognition import recognised, recognised_on_path
from tacstrip.tracking.rigid.search import FEW_STRIPS, compared_again, counted_among_followers, search
from tacstrip.tracking.rigid.starts import Starts, needs_smooth_motion
from tacstrip.tracking.scan_noise import SURE, noise_between_scans
from tacstrip.tracking.strays import set_aside, strays_from_fit

FEWEST = 5  # scans of one stretch that a shape is searched in
MOST = 200  # scans that a shape is fitted to; the others only have their poses fitted
_CEILING = 0.02 / math.sqrt(3.0)  # of sigma that is not known [Vref]
_ROUGHLY = 1.7  # times the noise that scans show, either way: what a search by smaller noise leaves
_ALIKE = 1.25  # times a guess of sigma: found again, it is believed
_ROUNDS = 3  # of finding sigma
_CLEANED = 2  # further searches, each without the readings that stray


def searched(
    episode: Episode,
    read: Readings,
    *,
    offsets: bool = True,
    thorough: bool = True,
    begun: Object | None = None,
) -> Object | None:
    """Return the object of an episode; None where its scans are too few for a shape over time.

    Where readings stray from one scan to the next, only what is left without them is searched thoroughly. `begun`: what
    a search that was not thorough ended with.
    """
    if len(episode.scans) < FEWEST:
        return None
    level = read.sigma or max(GUESS, read.skin.sensor.adc_step)
    every = RigidScans(read.skin.laid_out, read.names, episode.readings(read.k, read.skin.span), level)
    kept = episode.readings(read.without_strays, read.skin.span)
    stray = bool(np.isfinite(kept).sum() < every.readings.sum())
    known, deep = begun.begun if begun else (), thorough and not stray
    one = begun if begun and stray else None
    if one is None:
        one = _searched(episode, every, read, offsets, thorough=deep, beyond=not stray, begun=known[:1])
    settled = bool(read.sigma) and one.within_noise(read.distribution)
    settled &= (
        one is not begun or one.scans.sigma == read.sigma
    )  # else of a noise that is found, and not thoroughly
    if read.sigma and not settled and (louder := _louder(episode, one, read, offsets, thorough=thorough)):
        return louder
    best, quick, known = one, one.begun, known[1:2] if stray else ()
    for _ in range(0 if settled else _CLEANED):
        kept = set_aside(kept, strays_from_fit(one.scans, one.found.fit))
        if np.isfinite(kept).sum() == one.scans.readings.sum():
            break
        few = needs_smooth_motion(one.scans) and one.scans.strips_touched < FEW_STRIPS
        if few and Starts(one.scans).erratic:  # such a search takes long, and goes on from any outline
            known = (replace(one.found, starts=None),)
        one = _searched(episode, replace(every, k=kept), read, offsets, thorough=thorough, begun=known)
        if one.explained(read.distribution) and (read.sigma or one.scans.sigma < best.scans.sigma / _ALIKE):
            return one
        quick, known = quick + one.begun, ()
    return replace(best, begun=() if thorough else quick)


def _louder(episode: Episode, one: Object, read: Readings, offsets: bool, *, thorough: bool) -> Object | None:
    """Return the object of readings whose noise is larger than given, as they show by themselves; else None.

    What a rigid outline leaves of them is no more than that, and does not follow from scan to scan as what a body
    leaves does that moves smoothly and deforms.
    """
    every = replace(one.scans, k=episode.readings(read.k, read.skin.span))
    shown, unsure = noise_between_scans(every.k)
    larger = math.sqrt(1.0 + SURE * unsure)
    if (
        shown < larger * (read.sigma or one.scans.sigma)
        or not shown / _ROUGHLY < one.left_over < _ROUGHLY * shown
    ):
        return None
    unknown = replace(read, sigma=None)
    one = _searched(episode, every.with_sigma(shown), unknown, offsets, thorough=thorough)
    fit = one.judged_fit
    white = following(one.scans, fit.corners, fit.poses) == 1.0
    explained = one.left_over < larger * shown and one.within_noise(read.distribution)
    return one if white and explained else None


def _searched(
    episode: Episode,
    every: RigidScans,
    read: Readings,
    offsets: bool,
    *,
    thorough: bool,
    beyond: bool = True,
    begun: tuple[Found, ...] = (),
) -> Object:
    """Do as `searched` with the episode's readings; turns `beyond` half a turn are tried, too."""
    before, step = begun[0] if begun else None, read.skin.sensor.adc_step
    if before and before.starts:
        every = every.with_sigma(before.starts.scans.sigma)
    level = every.sigma
    few = np.unique(np.linspace(0, len(every.k) - 1, min(len(every.k), MOST)).astype(int))
    least = max(step / math.sqrt(12.0), FLOOR)
    for _ in range(_ROUNDS):
        ended = search(
            every.of(few),
            read.distribution,
            offsets=offsets,
            thorough=thorough,
            begun=before,
            round_and_round=beyond,
        )
        left = level * math.sqrt(ended.fit.cost / ended.fit.freedom(every.of(few)))
        if read.sigma or level / _ALIKE < left < level * _ALIKE:
            break
        level, before = float(np.clip(left, least, _CEILING)), None
        every = every.with_sigma(level)
    rest = taken_off(every.of(few), ended.offsets)
    if ended.fit.basis is None and content(rest, ended.fit, read.distribution):
        ended = counted_among_followers(rest, ended, read.distribution)
    raw, every = every, taken_off(every, ended.offsets)
    fit = with_all_poses(every, few, ended.fit)
    found = replace(ended, fit=fit, chosen=few[ended.chosen], starts=None)
    quick = () if thorough else (ended,)
    one = Object(episode.scans, episode.joint, episode.runs, every, found, begun=quick)
    # live shapes are polygons; offsets may be made of what a polygon leaves of a curve
    for scans, known in ((raw, None), (every, ended.offsets)) if offsets and fit.basis is None else ():
        beside = None if known else ended.offsets  # of the polygon alone
        curve = rigid_curve(scans, fit, few, read.distribution, beside)
        if curve is not None:
            return replace(one, scans=scans, found=replace(found, offsets=known), curve=curve)
        if ended.offsets is None:
            break
    return one


def with_stretches(one: Object, start: Episode, left: list[Episode], read: Readings) -> Object:
    """Return the object with those of other stretches that its shape explains, which are taken away."""
    others = (e for e in start.group if e is not start and set(e.scans) & set(one.shown))
    one = joined = replace(one, alike=any(_recognise(one, e, read) is not None for e in others))
    for other in list(left):
        again = None if set(other.scans) & set(joined.shown) else _recognise(joined, other, read)
        if again is not None:
            joined = again
            left.remove(other)
    return one if joined is one else _counted_again(joined, one, read)


def explained_too(new: Object, objects: list[Object], read: Readings) -> list[Object]:
    """Return the objects and a new one, which takes in those that its shape explains: theirs were too little told."""
    kept, joined = list[Object](), new
    for other in objects:
        apart = not (set(other.shown) & set(joined.shown) or other.joint or joined.joint)
        again = _recognise(joined, Episode(other.shown, other.runs), read) if apart else None
        joined, kept = (joined, [*kept, other]) if again is None else (again, kept)
    return [*kept, new if joined is new else _counted_again(joined, new, read)]


def _recognise(one: Object, other: Episode, read: Readings) -> Object | None:
    """Return the object with another stretch of scans too, where its shape explains them; else None."""
    if not content(one.scans, one.found.fit, read.distribution):
        return None
    more = taken_off(replace(one.scans, k=other.readings(read.k, read.skin.span)), one.found.offsets)
    if one.found.fit.basis is None:
        fit = recognised(one.scans, one.found.fit, more, read.distribution)
    else:
        fit = recognised_on_path(one.scans, one.found, more, read.distribution)
    if fit is None:
        return None
    every = replace(one.scans, k=np.concatenate([one.scans.k, more.k]))
    return replace(
        one,
        shown=one.shown + other.scans,
        joint=one.joint + other.joint,
        runs=one.runs + other.runs,
        scans=every,
        found=replace(one.found, fit=fit),
        curve=None,
    )


def _counted_again(one: Object, before: Object, read: Readings) -> Object:
    """Return an object of several stretches with its corners counted over all of them, and what rivals remain.

    `before`: the first alone. Where that is curved, so may all of them be.
    """
    order = np.argsort(one.shown)
    scans, fit = one.scans.of(order), one.found.fit
    fit = fit.of(order)
    few = np.unique(np.linspace(0, len(order) - 1, min(len(order), MOST)).astype(int))
    some = scans.of(few)
    found = compared_again(some, before.found, fit.of(few), read.distribution)
    if fit.basis is None:
        found = counted_among_followers(some, found, read.distribution)
    found = replace(found, chosen=few, offsets=before.found.offsets)
    if len(few) < len(order):
        found = replace(found, fit=posed(scans, replace(fit, corners=found.fit.corners)))
    shown, runs = [one.shown[i] for i in order], [one.runs[i] for i in order]
    curve = rigid_curve(scans, found.fit, few, read.distribution) if before.curve else None
    return replace(one, shown=shown, runs=runs, scans=scans, found=found, curve=curve)
