"""Objects over time from many scans: one rigid outline each, known better than from any single scan, and its poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tacstrip.arguments import takes
from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.contact.noise import Noise
from tacstrip.core.problem import FLOOR
from tacstrip.errors import ReadingError, SignatureError
from tacstrip.geometry.pose import placed
from tacstrip.reconstruction.implausible import doubted, scale_hint
from tacstrip.reconstruction.noise_covariance import Averaging, fit_sigma
from tacstrip.reconstruction.on_surface import refuse_stretched
from tacstrip.reconstruction.polygon.estimate import fit_polygon
from tacstrip.reconstruction.seam import BRIDGED
from tacstrip.scan import Scan, time_goes_back
from tacstrip.sensor.constructions import check_closed_form
from tacstrip.sensor.left_out import left_out
from tacstrip.sensor.spec import Sensor
from tacstrip.tracking.episodes import Episode, episodes, spanned
from tacstrip.tracking.objects import Object, Readings, Skin
from tacstrip.tracking.result import STANDS, Track
from tacstrip.tracking.stretches import explained_too, searched, with_stretches
from tacstrip.tracking.summary import of_one_scan, summarised
from tacstrip.tracking.together import together
from tacstrip.tracking.wide_strips import tracked_on_wide_strips

_LOOKS = 3  # single scans that are asked whether strips between touched ones are dead


@takes(scans=(Scan,), sensor=Sensor, noise=Noise)
def track(scans: Sequence[Scan], sensor: Sensor, noise: Noise | None = None) -> list[Track]:
    """Find the objects of a whole recording: one rigid outline each, and where it lies in every scan.

    Fifty scans of an object that slides or turns tell ten times more of its shape than one does. What does not move
    across the strips or turn stays as unknown as in a single scan, and that is said.

    Parameters
    ----------
    scans
        Of one sensor, in the order of time.
    sensor
        That made them, of a construction with a closed form.
    noise
        Of the readings; None: the spec's `[noise]`, and without one estimated from what the fits leave over.

    Returns
    -------
    list of Track
        In the order of appearance, from left to right. An object that is lifted and pressed again keeps its number
        where its shape is recognised, and one that shares strips with others where it was alone before or after.

    Raises
    ------
    ReadingError
        There is no scan, one is not of this sensor, or they are not in the order of time; the message names it.
    SignatureError
        The construction has no closed form.

    Examples
    --------
    >>> import numpy as np
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-crs", strips=10, pitch_mm=10.0, length_mm=100.0)
    >>> shape, noise = ts.Contact.polygon([(-25, -20), (20, -25), (25, 20), (-10, 25)]), ts.Noise(positional=0.002)
    >>> scans = [
    ...     ts.simulate(sensor, shape.turned(0.02 * i).placed(35 + 0.8 * i, 50), noise, rng=100 + i, time_s=0.01 * i)
    ...     for i in range(30)
    ... ]
    >>> (one,) = ts.track(scans, sensor, noise)
    >>> one.status, len(one.outline), bool(abs(one.poses[-1, 2] - one.poses[0, 2] - 0.58) < 0.02)
    ('ok', 4, True)
    """
    check_closed_form(sensor.kind, "track")
    refuse_stretched(sensor, "track")
    scans = list(scans)
    read = [_checked(i, scan, sensor) for i, scan in enumerate(scans)]
    if not read:
        raise ReadingError("there is no scan: give those of a recording, in the order of time")
    times = np.array([scan.time_s for scan in read])
    if told := time_goes_back(times):
        raise ReadingError(told)
    own = scans[0].signatures
    for i, scan in enumerate(scans):
        if scan.signatures != own:
            raise ReadingError(
                f"scan {i} has {' and '.join(scan.signatures)}, and scan 0 {' and '.join(own)}: give scans alike"
            )
    # a scan that touches only strips whose other channel is left out lacks a signature that others have
    names = tuple(name for name in own if any(np.isfinite(scan.reading(name)).any() for scan in read)) or own
    noise = sensor.noise if noise is None else noise
    sigma = None
    if noise is not None:  # strays are set aside
        steady = replace(noise, strays=0.0, stray_size=0.0)
        sigma = max(fit_sigma(steady, sensor, Averaging.of(read[0])), FLOOR)

    def of_lines(lines: list[Scan], thin: Sensor) -> list[Track]:
        return _tracked(lines, thin, noise, sigma, names)

    if sensor.strip_width_mm is None:
        tracks = of_lines(read, sensor)
    else:
        tracks = tracked_on_wide_strips(read, sensor, noise, sigma, of_lines)
    standing = STANDS if len(times) > 1 and not np.diff(times).any() else ""
    outlines = [placed(t.outline, t.poses[i]) for t in tracks for i in np.flatnonzero(t.present)]
    scale = scale_hint(read, outlines, sensor)
    first = [int(np.argmax(t.present)) for t in tracks]
    done = []
    for i, (_, t) in enumerate(
        sorted(zip(first, tracks, strict=True), key=lambda p: (p[0], p[1].poses[p[0], 0])), 1
    ):
        status, advice = doubted(t.status, t.advice, scale)
        advice = "; ".join(filter(None, [advice, standing]))
        velocities = _velocities(t.poses, times)
        done.append(replace(t, id=i, times_s=times, velocities=velocities, status=status, advice=advice))
    return done


def _tracked(
    read: list[Scan], sensor: Sensor, noise: Noise | None, sigma: float | None, names: tuple[str, ...]
) -> list[Track]:
    """Return the tracks of scans of strips that are lines, in any order."""
    k = np.stack([np.stack([scan.reading(name) for name in names]) for scan in read])
    distribution = "normal" if noise is None or not noise.independent else noise.distribution
    silent = _silent(read, sensor, noise)
    stretches = episodes(k, sensor.closed, silent)
    readings = Readings(
        k, Skin(sensor, spanned(stretches, sensor.strips), silent), names, sigma, distribution
    )
    left, unlike, objects = sorted(stretches, key=lambda e: -len(e.scans)), list[Episode](), list[Object]()
    tried: dict[int, Object | None] = {}
    while left:
        one = left.pop(0)
        hurried = readings.followable and not any(e.joint for e in one.group)
        seen = searched(one, readings, thorough=not hurried)
        if seen is None or not seen.explained(distribution):
            unlike.append(one)
            tried[id(one)] = seen
        else:
            new = with_stretches(seen, one, left, readings)
            objects = explained_too(new, objects, readings)
    bent = [e for e in unlike if len(e.group) == 1 and (seen := tried[id(e)]) and seen.found.strains_evenly]
    others = [e for e in unlike if not any(e is b for b in bent)]
    objects, others = together(objects, others, stretches, readings)
    unlike = [*bent, *others]
    tracks: list[Track] = []
    while unlike:
        one = unlike.pop(0)
        seen = tried[id(one)]
        if seen is not None and seen.begun and not seen.found.strains:
            seen = searched(one, readings, begun=seen)
        if seen is None:
            tracks.append(of_one_scan(one, read, sensor, noise))
        else:
            objects = explained_too(with_stretches(seen, one, unlike, readings), objects, readings)
    return [*tracks, *(summarised(each, read, readings, noise) for each in objects)]


def _velocities(poses: FloatArray, times: FloatArray) -> FloatArray:
    """Return the slopes (T, 3) of poses by time, by neighbouring scans; NaN where there are none."""
    found = np.full(poses.shape, np.nan)
    at = np.flatnonzero(np.isfinite(poses[:, 0]))
    for stretch in np.split(at, np.flatnonzero(np.diff(at) > 1) + 1):
        if len(stretch) > 1 and (np.diff(times[stretch]) > 0.0).all():
            found[stretch] = np.gradient(poses[stretch], times[stretch], axis=0)
    return found


def _silent(scans: list[Scan], sensor: Sensor, noise: Noise | None) -> BoolArray:
    """Return the strips of which nothing is known (n,): those left out as a whole, and dead ones within a contact.

    A few neighbours that no scan touches may be dead, or lie between two objects: single scans tell which.
    """
    n = sensor.strips
    out = left_out(sensor)
    silent: BoolArray = np.all([out.get(s, np.zeros(n, dtype=bool)) for s in scans[0].signatures], axis=0)
    touched = np.stack([scan.touched for scan in scans])
    ever = touched.any(axis=0)
    at = np.flatnonzero(ever)
    for i, left in enumerate(at):
        right = at[i + 1] if i + 1 < len(at) else at[0] + n if sensor.closed else left
        gap = np.arange(left + 1, right) % n
        if not 0 < len(gap) <= BRIDGED or silent[gap].all():
            continue
        both = np.flatnonzero(touched[:, left] & touched[:, right % n])
        some = (
            both[np.unique(np.linspace(0, max(len(both) - 1, 0), _LOOKS).astype(int))] if len(both) else both
        )
        fits = (fit_polygon(scans[j], sensor, noise, bounded=False, assessment="none") for j in some)
        across = [
            any(np.isin(gap, np.arange(*o.strips.indices(2 * n)) % n).all() for o in f.objects) for f in fits
        ]
        silent[gap] |= 2 * sum(across) > len(across)
    return silent


def _checked(number: int, scan: Scan, sensor: Sensor) -> Scan:
    try:
        return scan.checked(sensor)
    except (ReadingError, SignatureError) as error:
        raise type(error)(f"scan {number}: {error}") from None
