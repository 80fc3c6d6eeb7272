"""Groups of objects that come together: what may be known of them, and what their shared scans add."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.core.rigid import RigidScans
from tacstrip.tracking.episodes import Episode, only
from tacstrip.tracking.objects import GUESS, Object, Readings
from tacstrip.tracking.rigid.recognition import recognised
from tacstrip.tracking.rigid.search import LEAST_STRIPS
from tacstrip.tracking.shared_strips.follow import follow
from tacstrip.tracking.shared_strips.lone_ends import lone_ends
from tacstrip.tracking.stretches import FEWEST


def together(
    objects: list[Object], unlike: list[Episode], stretches: list[Episode], read: Readings
) -> tuple[list[Object], list[Episode]]:
    """Return objects with what scans add in which they share strips, and the episodes that remain unexplained."""
    if not read.followable:
        return objects, unlike
    aside, objects = [o for o in objects if not o.followable], [o for o in objects if o.followable]
    touched, laid_out = read.touched, read.skin.laid_out
    for group in {id(e.group): e.group for e in stretches}.values():
        bent = [e for e in unlike if any(e is g for g in group) and len(e.scans) >= FEWEST]
        if not (bent or (objects and any(e.joint for e in group))):
            continue
        mine = {(s, run.start) for e in group for s, run in zip(e.scans, e.runs, strict=True)}
        if not bent and any(mine & o.places for o in aside):
            continue
        both = not objects and len(bent) == 1  # one object by itself shares strips with none
        parts = [part for e in bent for part in _parts(e, read, both=both)]
        readings = _of_group(group, read)
        first = min((s for e in group for s in e.joint), default=0)
        later = {place for place in mine if place[0] >= first}
        for known in _suppositions(objects, parts, group, later, read):
            if len(known) < 2:  # one by itself shares strips with none
                continue
            sigma = max(one.scans.sigma for one in known)
            alone = [o.alone for o in known]
            found = follow(alone, readings, touched, laid_out, read.names, sigma, read.distribution)
            shown = [s for f in found or () if f is not None for s in f.scans]
            # Objects that take turns without a scan in common are one that deforms.
            if found is not None and len(set(shown)) < len(shown):
                objects = [o if f is None else o.with_shared(f) for o, f in zip(known, found, strict=True)]
                unlike = [e for e in unlike if not any(e is g for g in group)]
                break
        else:
            objects = [o.unexplained if mine & o.places else o for o in objects]
    return [*objects, *aside], unlike


def _suppositions(
    objects: list[Object],
    parts: list[Object],
    group: list[Episode],
    later: set[tuple[int, int]],
    read: Readings,
) -> Iterator[list[Object]]:
    """Yield what may be known of the objects of a group that comes together, most likely first.

    Parts of episodes may be objects that are known already, and stretches that were taken for the same may be of two
    that look alike: then `later` places, after they first came together, do not count, and follow from the motion.
    """
    if parts:
        came = {episode.scans[0] for episode in group}
        begun = [part for part in parts if part.shown[0] in came]
        if objects and len(begun) < len(parts):  # what nobody saw come may be known objects, side by side
            yield _with_parts(objects, begun, read, True)
        together = _with_parts(objects, parts, read, True)
        yield together
        if len(together) < len(objects) + len(parts):
            yield _with_parts(objects, parts, read, False)
    elif objects:
        before = [b for o in objects if (b := o.without(later) if o.places & later else o) is not None]
        shortened = any(o.places & later for o in objects)
        if not (shortened and any(o.alike for o in objects if o.places & later)):
            yield objects
        if shortened and len(before) > 1:
            yield before
        # objects that come together and are lifted one after the other: the last of them is alone at the end
        stretches = {tuple(e.joint): e.joint_runs for e in group if len(e.joint) >= FEWEST}
        ends = [Episode(list(joint), runs) for joint, runs in stretches.items()]
        last = [part for e in ends for part in _parts(e, read, (True,))]
        if last:
            yield _with_parts(objects, last, read, True)


def _parts(
    episode: Episode, read: Readings, ends: tuple[bool, ...] = (False, True), *, both: bool = False
) -> list[Object]:
    """Return the objects that the first (False) and the last scans of an episode show by themselves."""
    every = RigidScans(
        read.skin.laid_out, read.names, episode.readings(read.k, read.skin.span), read.sigma or GUESS
    )
    if every.strips_touched < LEAST_STRIPS:
        return []
    return [
        Object(
            [episode.scans[i] for i in some],
            [],
            [episode.runs[i] for i in some],
            every.of(np.array(some)),
            found,
        )
        for some, found in lone_ends(every, read.distribution, ends, both=both)
    ]


def _with_parts(objects: list[Object], parts: list[Object], read: Readings, again: bool) -> list[Object]:
    """Return objects with those of parts of episodes, where wanted as the same if a shape is recognised."""
    known = list(objects)
    for part in parts:
        for i, one in enumerate(known) if again else ():
            fit = None
            if not set(part.shown) & set(one.shown):
                fit = recognised(one.scans, one.found.fit, part.scans, read.distribution)
            if fit is not None:
                every = replace(one.scans, k=np.concatenate([one.scans.k, part.scans.k]))
                known[i] = replace(
                    one,
                    shown=one.shown + part.shown,
                    runs=one.runs + part.runs,
                    scans=every,
                    found=replace(one.found, fit=fit),
                )
                break
        else:
            known.append(part)
    return known


def _of_group(group: list[Episode], read: Readings) -> dict[int, FloatArray]:
    """Return the readings of a group of episodes, scan by scan (S, strips of the skin), NaN where others touch."""
    found: dict[int, FloatArray] = {}
    for one in group:
        for scan, run in zip([*one.scans, *one.joint], [*one.runs, *one.joint_runs], strict=True):
            own = only(read.k[scan], run, read.skin.span)
            found[scan] = np.where(np.isfinite(own), own, found.get(scan, np.nan))
    return found
