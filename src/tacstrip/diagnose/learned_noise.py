"""The parts of a sensor's noise, learned from a recording of a contact that rests.

What changes with time tells the white noise, the wander of the zero, hum and strays, and how much of them channels
share. What does not is told by the strips: the mean of all scans less the best polygon. There a wander slower than the
recording and errors of where the contact ends are weighed by their restricted likelihood, which knows what the fit
has absorbed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.contact.signature import signatures
from tacstrip.diagnose.allan import allan_deviation, processes, variogram
from tacstrip.diagnose.hum import MAINS
from tacstrip.diagnose.log import Log
from tacstrip.errors import ReadingError, TacstripError, figures
from tacstrip.geometry.outline import Outline
from tacstrip.reconstruction.cramer_rao import vertex_jacobian
from tacstrip.reconstruction.noise_covariance import Averaging, own_variance, reading_covariance
from tacstrip.reconstruction.polygon.estimate import fit_polygon
from tacstrip.reconstruction.result import RecoveredObject
from tacstrip.robust import robust_sigma
from tacstrip.scan import Scan, time_goes_back
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.noise import Noise

_FEWEST, _MINUTE_S = 24, 45.0  # scans; a recording that is shorter tells little of the wander
_TOUCHED = 0.95  # of the scans
_FAR_OUT = 10.0  # over Vref
_GRID = 1_000_000  # even times at most
_STRAY, _LEAST_STRAY = 6.0, 0.002  # standard deviations, and of Vref
_MOVED = 0.025  # of Vref: the median channel's slow change that is no wander
_CREEPS, _LEFT = 0.8, 2  # of slow change that is a motion; channels beyond what motions can explain, at least
_BLOCKS = 12  # means that tell slow change
_LINE = 14.0  # times the power at nearby frequencies: a line
# Time constant of what does not change at all, at least, and over the recording's length.
_SLOW_S, _SLOW = 3600.0, 30.0
_COUNTS = range(3, 9)  # vertices that are tried
_STRIPS = 60  # more are thinned
_LEVELS = np.geomspace(0.1, 3.0, 14)  # of what is tried, over the typical residual
_LENGTHS = (0.5, 1.0, 1.7, 3.0)  # correlation lengths tried, in pitches
_MOST_SHARED = 0.75  # of a wander's variance
_FREE = 5  # readings beyond the polygon's numbers, of which something can be told
_SMALL = 0.02  # of the variance known: less is nothing
_LEAST_SIGMA = 1e-6  # of Vref
_WORSE = 4.0  # times the typical residual of the best number of corners: not the contact's number
# Of Vref: errors that last and are larger are a wrong shape's, as ends further off than a pitch.
_MOST_LASTING = 0.02
_TOO_FEW = "too few strips are touched for its shape"
# Strips; correlation of neighbours, and deviations, from which it is sure.
_APART, _ALIKE, _SURELY = 5, 0.3, 5.0


@dataclass(frozen=True, eq=False)
class LearnedNoise:
    """What a recording tells of a sensor's noise.

    Attributes
    ----------
    noise
        Its parts.
    sure
        By the name of a part, its standard error over its value.
    counts, allan
        Numbers of scans averaged (A,) and the Allan deviation of each channel over so many (A, channels) [Vref].
    period_s, scans
        Time from scan to scan [s], and their number.
    channels
        Names of the channels, such as "k_h of strip 3".
    touched
        Whether a contact was there; else only the converter's noise was heard.
    unidentifiable
        What the recording cannot tell, a sentence each.

    Examples
    --------
    Of a recording `log`, `learn_noise(log).noise` goes into a spec: `dataclasses.replace(sensor, noise=...)`.

    >>> import numpy as np
    >>> import tacstrip as ts
    >>> from tacstrip.diagnose import Log, learn_noise
    >>> sensor = ts.Sensor(construction="crs-crs", strips=3, pitch_mm=10.0, length_mm=100.0)
    >>> nothing = {name: np.full((140, 3), np.nan) for name in ("kh", "kl")}
    >>> learn_noise(Log.of(sensor, 0.5 * np.arange(140), nothing))  # doctest: +IGNORE_EXCEPTION_DETAIL
    Traceback (most recent call last):
    ReadingError: no strip reads anything
    """

    noise: Noise
    sure: dict[str, float]
    counts: IntArray
    allan: FloatArray
    period_s: float
    scans: int
    channels: tuple[str, ...]
    touched: bool
    unidentifiable: tuple[str, ...]


def learn_noise(log: Log, vertices: int | None = None) -> LearnedNoise:
    """Learn the parts of the noise from a recording of a contact that rests, a minute or longer.

    Parameters
    ----------
    log
        The recording.
    vertices
        Of the contact, where that is known: then errors of its edges are not taken for corners.

    Raises
    ------
    ReadingError
        It is too short, its scans have no times, or the contact moves; the message says what to do.

    Examples
    --------
    >>> import numpy as np
    >>> import tacstrip as ts
    >>> from tacstrip.diagnose import Log, learn_noise
    >>> sensor = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0)
    >>> contact = ts.Contact.polygon([(22, 38), (62, 22), (80, 55), (45, 76)])
    >>> scans = [ts.simulate(sensor, contact, ts.Noise(white=0.004), rng=seed) for seed in range(140)]
    >>> raw = {name: np.stack([scan[name] for scan in scans]) for name in ("kh", "kl")}
    >>> learned = learn_noise(Log.of(sensor, 0.5 * np.arange(140), raw))
    >>> round(learned.noise.white, 3)
    0.004
    """
    period_s, channels, values, touched = _series(log)
    unidentifiable = []
    lasts_s = period_s * (len(values) - 1)
    if lasts_s < _MINUTE_S:
        unidentifiable.append(
            f"a wander of {figures(lasts_s, 3)} s or longer: record a minute or more of a still press"
        )
    strays, stray_size = _take_strays(values)
    hum, hum_hz = _take_hum(values, period_s)
    if hum < 0.0:
        unidentifiable.append(
            f"hum: {figures(1.0 / period_s, 3)} scans a second, over {figures(lasts_s, 3)} s, do not tell it from "
            "other noise"
        )
    _refuse_motion(values)
    lags, own, shared = variogram(values, [name.split()[0] for name in channels])
    variance, together, time_s = processes(np.asarray(lags * period_s, dtype=float), own, shared, lasts_s)
    step = log.sensor.adc_step**2 / 12.0
    white, slow = max(variance[0] - step, 0.0), variance[1:]
    every, of_signature = (_share(of[1:].sum(), slow.sum()) for of in together.T)
    noise = Noise(
        white=math.sqrt(white),
        white_shared=_share(together[0, 0], white),
        wander=tuple(map(_digits, np.sqrt(slow))) or 0.0,
        wander_s=tuple(map(_digits, time_s[1:])) or 60.0,
        wander_shared=every,
        wander_by_signature=max(of_signature - every, 0.0),
        hum=max(hum, 0.0),
        hum_hz=hum_hz,
        strays=strays,
        stray_size=stray_size,
    )
    sure, long_wander = _how_sure(values, lasts_s, time_s[1:])
    unidentifiable += long_wander
    if touched:
        _refuse_creep(log, values, channels, period_s)
        noise, more, not_told = _of_the_contact(
            log, noise, values, channels, period_s, white + step, vertices
        )
        sure |= more
        unidentifiable += not_told
    else:
        unidentifiable.insert(
            0,
            "anything of the contact: nothing touches, and untouched strips tell the converter's noise only",
        )
    rounded: dict[str, Any] = {name: _digits(getattr(noise, name)) for name in _ROUNDED}
    noise = replace(noise, **rounded)
    return LearnedNoise(
        noise, sure, *allan_deviation(values), period_s, len(values), channels, touched, tuple(unidentifiable)
    )


def _how_sure(values: FloatArray, lasts_s: float, wander_s: FloatArray) -> tuple[dict[str, float], list[str]]:
    """Return relative deviations of what was learned, and what of the wander was not."""
    sure = {"white": 1.0 / math.sqrt(2.0 * np.isfinite(values).sum())}
    if not len(wander_s):
        return sure, []
    longest_s = float(wander_s.max())
    looks = values.shape[1] * max(lasts_s / (2.0 * longest_s), 0.0)
    sure["wander"] = 1.0 / math.sqrt(2.0 * max(looks, 0.5))
    if lasts_s >= 3.0 * longest_s:
        return sure, []
    return sure, [
        f"how far the zero wanders in longer than {figures(lasts_s / 3.0)} s, but by the strips' differences"
    ]


def _of_the_contact(
    log: Log,
    noise: Noise,
    values: FloatArray,
    channels: tuple[str, ...],
    period_s: float,
    white: float,
    vertices: int | None,
) -> tuple[Noise, dict[str, float], list[str]]:
    """Return the noise with what the contact's outline tells, how sure that is, and what it does not tell."""
    not_told = []
    like = _like_neighbours(values, channels, white)
    if like:
        not_told.append(
            f"what of the slow change neighbouring strips share: theirs correlate by {like:.2f} more than those of "
            "strips far apart, as of a wander that neighbours share or a contact that creeps, which [noise] cannot "
            "describe; errors of where the contact ends are not told from it"
        )
    noise, sure, why_not = _static(log, noise, period_s, vertices, edges=not like)
    not_told.append(
        "a common offset of all channels, a gain's error, and how far all ends lie too far out: press known shapes"
    )
    if why_not:
        not_told.append(f"errors that do not change, such as of where the contact ends: {why_not}")
    return noise, sure, not_told


_ROUNDED = (
    "white",
    "white_shared",
    "wander_shared",
    "wander_by_signature",
    "edge_mm",
    "edge_correlation_mm",
    "hum",
    "strays",
    "stray_size",
)


def _digits(value: float) -> float:
    return float(f"{value:.3g}")


def _share(part: float, whole: float) -> float:
    return min(max(part / whole, 0.0), 1.0) if whole > 0.0 else 0.0


def _series(log: Log) -> tuple[float, tuple[str, ...], FloatArray, bool]:
    """Return the time from scan to scan [s], the channels' names and readings at even times, and if touched."""
    if told := time_goes_back(log.time_s):
        raise ReadingError(told)
    count = len(log.time_s)
    if count < _FEWEST:
        raise ReadingError(f"{count} scans tell nothing of the noise: record a minute of a still press")
    steps = np.diff(log.time_s)
    period_s = float(np.median(steps))
    if not period_s > 0.0:
        raise ReadingError("the scans have no times that ascend: time_s tells noise from wander")
    rows = np.round((log.time_s - log.time_s[0]) / period_s).astype(int)
    if rows[-1] > _GRID:
        raise ReadingError(
            "the scans' times do not ascend evenly: record a minute of a still press in one piece"
        )
    for name, raw in log.raw.items():
        if (most := float(np.nanmax(np.abs(raw), initial=0.0))) > _FAR_OUT:
            raise ReadingError(
                f"{SIGNATURES[name].volt_column} reads {most:.3g} times vref_volt: these are no volts of this "
                "sensor; is vref_volt right? `tacstrip doctor` says where"
            )
    still = log.touched.mean(axis=0) >= _TOUCHED
    if not still.any() and log.touched.any(axis=1).mean() > 1.0 - _TOUCHED:
        raise ReadingError(
            "no strip is touched all the time: the contact moves; record a minute of a still press"
        )
    source = log.k if still.any() else log.raw
    strips = np.flatnonzero(still if still.any() else ~log.touched.any(axis=0))
    columns, names = [], []
    for name, k in source.items():
        for strip in strips:
            known = k[np.isfinite(k[:, strip]), strip]
            if len(known) < _TOUCHED * count or np.ptp(known) == 0.0:
                continue  # never heard, or held at a rail: no noise
            column = np.full(rows[-1] + 1, np.nan)
            column[rows] = k[:, strip]
            columns.append(column - known.mean())
            names.append(f"{SIGNATURES[name].symbol} of strip {strip + log.sensor.strip_base}")
    if not columns:
        raise ReadingError("no channel's readings change at all: nothing can be said of the noise")
    return period_s, tuple(names), np.stack(columns, axis=1), bool(still.any())


def _take_strays(values: FloatArray) -> tuple[float, float]:
    """Take strays out of readings (scans, channels); return their share and their standard deviation."""
    each = np.arange(len(values))[:, None]
    # The first and last scans have theirs on one side.
    five = np.clip(each - 2, 0, len(values) - 5) + np.arange(5)
    around = values[five[five != each].reshape(-1, 4)]  # (scans, 4, channels)
    with np.errstate(invalid="ignore"):
        off = values - np.median(np.nan_to_num(around), axis=1)
    stray = np.abs(off) > np.maximum(_STRAY * robust_sigma(off, 0), _LEAST_STRAY)
    count = int(stray.sum())
    size = float(np.sqrt(np.mean(off[stray] ** 2))) if count else 0.0
    values[stray] = np.nan
    return count / max(int(np.isfinite(values).sum()), 1), size


def _take_hum(values: FloatArray, period_s: float) -> tuple[float, float]:
    """Take mains hum out of readings; return its root mean square, -1 where it cannot be told, and [Hz]."""
    time_s = period_s * np.arange(len(values))
    lasts_s, filled, told = float(time_s[-1]), np.nan_to_num(values), False
    for mains in MAINS:
        folded = abs(mains - round(mains * period_s) / period_s)
        if folded < 10.0 / lasts_s or 0.5 / period_s - folded < 10.0 / lasts_s:
            continue
        told = True
        near = np.concatenate([np.arange(-9, -3), np.arange(4, 10)]) / lasts_s
        turns = np.exp(-2j * np.pi * np.outer(np.append(near, 0.0) + mains, time_s))
        power = (np.abs(turns @ filled) ** 2).mean(axis=1) * 2.0 / len(values) ** 2  # mean squares
        if power[-1] > _LINE * np.median(power[:-1]):
            both = np.stack([turns[-1].real, turns[-1].imag], axis=1)
            values -= both @ np.linalg.lstsq(both, filled, rcond=None)[0]
            return math.sqrt(power[-1]), mains
    return (0.0 if told else -1.0), MAINS[0]


def _refuse_motion(values: FloatArray) -> None:
    means = [
        np.nanmean(part, axis=0)
        for part in np.array_split(values, _BLOCKS)
        if np.isfinite(part).any(axis=0).all()
    ]
    changed = float(np.median(np.ptp(means, axis=0))) if means else 0.0
    if changed > _MOVED + 4.0 * float(np.nanstd(np.diff(values, axis=0))) / math.sqrt(len(values) / _BLOCKS):
        raise ReadingError(
            f"the contact moves, or creeps: half of the channels change by {100.0 * changed:.2g} % of Vref or more; "
            "record a minute of a press that rests, some seconds after it was made"
        )


def _refuse_creep(log: Log, values: FloatArray, channels: Sequence[str], period_s: float) -> None:
    """Refuse a recording of which nearly all slow change grows evenly, and as where outlines are shifted and turned.

    What all strips of a signature share is left aside: a shift along the strips hardly differs from a common wander.
    """
    means = np.nan_to_num(np.stack([np.nanmean(part, axis=0) for part in np.array_split(values, _BLOCKS)]))
    names = np.array([name.split()[0] for name in channels])
    shared, _ = np.linalg.qr((names[:, None] == np.unique(names)).astype(float))
    slow, moved = (
        each - shared @ (shared.T @ each)
        for each in ((means - means.mean(axis=0)).T, _motions(log, channels, period_s))
    )
    basis, size, _ = np.linalg.svd(moved, full_matrices=False)
    basis = basis[:, size > 1e-4 * size.max(initial=0.0)]
    if len(channels) - shared.shape[1] - basis.shape[1] < _LEFT:
        return
    time = np.arange(_BLOCKS) - 0.5 * (_BLOCKS - 1.0)
    share = float(((basis.T @ slow @ time) ** 2).sum()) / float(time @ time * max((slow**2).sum(), 1e-30))
    if share > _CREEPS:
        raise ReadingError(
            f"the contact creeps: {100.0 * share:.0f} % of the slow change is as of an outline that shifts or turns "
            "evenly; record a minute of a press that rests, some seconds after it was made"
        )


def _motions(log: Log, channels: Sequence[str], period_s: float) -> FloatArray:
    """Return how channels change where a contact is shifted along x and y and turned (channels, 3 per contact)."""
    sensor, scan = replace(log.sensor, noise=None), _mean_scan(log, period_s)
    columns = [np.zeros((len(channels), 0))]
    for found in fit_polygon(scan, sensor, assessment="none").objects:
        try:
            outline = Outline.of(found.vertices)
        except TacstripError:
            continue
        x = sensor.x_mm[found.strips]
        x = x[outline.touches(x)]
        strips = np.round(x / sensor.pitch_mm - 0.5).astype(int) + sensor.strip_base
        along_x, along_y = np.broadcast_to(np.eye(2)[:, None], (2, *outline.vertices.shape))
        turned = (outline.vertices - outline.vertices.mean(axis=0)) @ [[0.0, 1.0], [-1.0, 0.0]]
        steps = np.stack([step.ravel() for step in (along_x, along_y, turned)], axis=1)
        changes = vertex_jacobian(outline, sensor, scan.signatures, x) @ steps
        places = [f"{SIGNATURES[name].symbol} of strip {i}" for name in scan.signatures for i in strips]
        by_place = dict(zip(places, changes, strict=True))
        columns.append(np.stack([by_place.get(channel, np.zeros(3)) for channel in channels]))
    return np.concatenate(columns, axis=1)


def _mean_scan(log: Log, period_s: float) -> Scan:
    """Return the mean of a recording's scans, without strays."""
    seldom = log.touched.mean(axis=0) < _TOUCHED
    mean: dict[str, FloatArray] = {}
    for name, k in log.k.items():
        middle = np.nanmedian(np.where(seldom, 0.0, k), axis=0)
        off = np.abs(k - middle)
        near = off <= np.maximum(_STRAY * robust_sigma(np.where(seldom, 0.0, off), 0), _LEAST_STRAY)
        sums, many = np.where(near, k, 0.0).sum(axis=0), near.sum(axis=0)
        mean[name] = np.where(seldom, np.nan, sums / np.maximum(many, 1))
    return Scan(
        **mean, time_s=float(log.time_s[0]), averaged=len(log.time_s), span_s=period_s * (len(log.time_s) - 1)
    )


def _like_neighbours(values: FloatArray, channels: Sequence[str], white: float) -> float:
    """Return by how much slow changes of neighbours correlate beyond those of strips far apart; 0 if none is sure.

    Of the means (blocks, channels) of the recording's parts, less their mean over time; `white` is the variance that
    a reading brings along.
    """
    parts = np.array_split(values, _BLOCKS)
    names, strips = zip(*(name.rsplit(" ", 1) for name in channels), strict=True)
    place = np.array(strips, dtype=int)
    near = far = own = 0.0
    many = np.zeros(2)
    for name in sorted(set(names)):
        at = np.flatnonzero(np.array(names) == name)
        if len(at) < _APART + 3:
            continue
        means = np.stack([np.nanmean(part[:, at], axis=0) for part in parts])
        means = np.nan_to_num(means - means.mean(axis=0))
        product = means.T @ means / (_BLOCKS - 1.0)  # (channels, channels)
        gap = np.abs(place[at][:, None] - place[at])
        near += float(product[gap == 1].sum()) / 2.0
        far += float(product[gap >= _APART].sum()) / 2.0
        many += np.count_nonzero(gap == 1) / 2.0, np.count_nonzero(gap >= _APART) / 2.0
        own += float(np.trace(product)) / len(at)
    own /= max(len(set(names)), 1)
    if not many.all() or own <= 0.0:
        return 0.0
    beyond = near / many[0] - far / many[1]
    slow = own - white * _BLOCKS / len(values)
    sure = beyond > _SURELY * own / math.sqrt(many[0] * (_BLOCKS - 1.0))
    return min(beyond / slow, 1.0) if sure and beyond > _ALIKE * slow > 0.0 else 0.0


def _static(
    log: Log, noise: Noise, period_s: float, vertices: int | None, edges: bool = True
) -> tuple[Noise, dict[str, float], str]:
    """Return the noise with what does not change in time, from the mean scan's distance from the best polygon.

    Also how sure that is, and why nothing was told, if so: a misfit is an error only if no further corner explains it.
    """
    sensor, scan = replace(log.sensor, noise=None), _mean_scan(log, period_s)
    told: dict[int, list[tuple[float, ...]]] = {}
    typical: dict[int, float] = {}
    free, beyond = 0, False  # a count of corners whose outline leaves too few readings to judge
    # A mean's corners lie far above its noise, and pass for faulty readings where the fit has to find that itself.
    for tried in _COUNTS if vertices is None else (vertices,):
        fits: list[list[_Part]] = []
        for given in (noise, None):
            objects = fit_polygon(scan, sensor, given, vertices=tried, assessment="none").objects
            if vertices is None and any(len(found.vertices) != tried for found in objects):
                continue
            fits += [parts] if (parts := list(_projections(log, scan, objects))) else []
            beyond |= not parts
        if fits:
            parts = min(fits, key=_typical)
            told[tried], typical[tried] = _likelihoods(log, scan, noise, parts, edges), _typical(parts)
            free = free or sum(len(p.residuals) - p.slopes.shape[1] for p in parts)
    # Long smooth errors of ends could make any outline of a triangle; where more corners do much better, it is none.
    least = min(typical.values(), default=0.0)
    told = {tried: rows for tried, rows in told.items() if typical[tried] <= _WORSE * least}
    if not told:
        return noise, {}, _TOO_FEW
    likeliest = min(told, key=lambda tried: min(told[tried]))
    more = f"{_TOO_FEW}, and more than {likeliest} corners cannot be ruled out; --vertices says how many"
    if vertices is None and likeliest + 1 not in told:
        return noise, {}, more
    deviance, own, edge, length = np.array([row for rows in told.values() for row in rows]).T
    weight = np.exp(-0.5 * (deviance - deviance.min()))
    weight /= weight.sum()
    # Means over all that the residuals leave possible: the likeliest variance is too small half of the time.
    lasting, soft = math.sqrt(weight @ own**2), math.sqrt(weight @ edge**2)
    if lasting > _MOST_LASTING or soft > sensor.pitch_mm:
        off = f"{100.0 * lasting:.2g} % of Vref, or ends by {soft:.2g} mm"
        far = f"the readings lie off the best outline by {off}, too far for noise; is it a polygon?"
        return noise, {}, more if beyond else far
    if lasting**2 > _SMALL * own_variance(noise, sensor, Averaging.of(scan)):
        lasts = max(_SLOW_S, _SLOW * scan.span_s)
        shared = min(noise.wander_shared + noise.wander_by_signature, _MOST_SHARED)
        lasting /= math.sqrt(1.0 - shared)  # residuals tell what is not shared
        sigmas, times_s = zip(*noise.processes, (_digits(lasting), _digits(lasts)), strict=True)
        noise = replace(noise, wander=sigmas, wander_s=times_s)
    noise = replace(
        noise, edge_mm=soft, edge_correlation_mm=float(weight * edge**2 @ length) / max(soft**2, 1e-30)
    )
    return noise, {"static": 1.0 / math.sqrt(2.0 * free)}, ""


@dataclass(frozen=True, eq=False)
class _Part:
    """One contact: its residuals (R,) and slopes (R, P), and where the strips and the contact's ends lie (n,)."""

    residuals: FloatArray
    slopes: FloatArray
    x_mm: FloatArray
    ends_mm: tuple[FloatArray, FloatArray]


def _projections(log: Log, scan: Scan, objects: Sequence[RecoveredObject]) -> Iterator[_Part]:
    """Yield the contacts of which enough readings are left to tell errors from shape."""
    for found in objects:
        try:
            outline = Outline.of(found.vertices)
        except TacstripError:
            continue
        x = log.sensor.x_mm[found.strips]
        x = x[outline.touches(x)][:: max(1, math.ceil(len(x) / _STRIPS))]
        at = np.round(x / log.sensor.pitch_mm - 0.5).astype(int)
        ends = outline.ends(x)
        model = signatures(log.sensor, *ends)
        residuals = np.concatenate([scan[name][at] - model[name] for name in scan.signatures])
        slopes = vertex_jacobian(outline, log.sensor, scan.signatures, x)
        left, size, _ = np.linalg.svd(slopes, full_matrices=False)
        slopes = left[:, size > 1e-4 * size.max(initial=0.0)]
        if len(residuals) >= slopes.shape[1] + _FREE and np.isfinite(residuals).all():
            yield _Part(residuals, slopes, x, ends)


def _typical(parts: list[_Part]) -> float:
    """Return the residuals' root mean square by what the fit leaves free."""
    free = sum(len(p.residuals) - p.slopes.shape[1] for p in parts)
    squares = sum(float(((p.residuals - p.slopes @ (p.slopes.T @ p.residuals)) ** 2).sum()) for p in parts)
    return math.sqrt(squares / free)


def _likelihoods(
    log: Log, scan: Scan, noise: Noise, parts: list[_Part], edges: bool
) -> list[tuple[float, ...]]:
    """Return minus twice the log likelihood of errors that do not change in time, as (it, own, edge, length).

    Either each reading's own [Vref], or of the contact's ends [mm] with a correlation length [mm].
    """
    averaging, sensor = Averaging.of(scan), replace(log.sensor, adc_bits=None)
    typical = _typical(parts)

    def covariances(of: Noise) -> list[FloatArray]:
        return [reading_covariance(of, sensor, p.x_mm, p.ends_mm, scan.signatures, averaging) for p in parts]

    least = _LEAST_SIGMA**2 + own_variance(Noise(), log.sensor, Averaging())
    base = [b + least * np.eye(len(b)) for b in covariances(noise)]
    # Nothing, errors of each reading and errors of the ends are equally likely before the residuals are seen.
    nothing = sum(float(_deviance(p, b)) for p, b in zip(parts, base, strict=True))
    found: list[tuple[float, ...]] = [(nothing - 2.0 * math.log(len(_LEVELS)), 0.0, 0.0, 0.0)]
    own = [np.eye(len(b)) for b in base]
    for pitches in (None, *(_LENGTHS if edges else ())):
        length = (pitches or 0.0) * sensor.pitch_mm
        shapes = own if pitches is None else covariances(Noise(edge_mm=1.0, edge_correlation_mm=length))
        unit = math.sqrt(float(np.mean([np.trace(s) / len(s) for s in shapes])))
        levels = _LEVELS * typical / unit
        both = zip(parts, base, shapes, strict=True)
        deviances = np.sum([_deviance(p, b + levels[:, None, None] ** 2 * s) for p, b, s in both], axis=0)
        if pitches is None:
            found += [(deviance, level, 0.0, 0.0) for deviance, level in zip(deviances, levels, strict=True)]
            continue
        deviances += 2.0 * math.log(len(_LENGTHS))  # own errors are as likely as all lengths
        found += [(deviance, 0.0, level, length) for deviance, level in zip(deviances, levels, strict=True)]
    return found


def _deviance(part: _Part, covariance: FloatArray) -> FloatArray:
    """Return minus twice the log likelihood of residuals (...), whatever the step along the slopes (readings of 0..1).

    `covariance`: (..., R, R).
    """
    root = np.linalg.cholesky(covariance)
    white = np.linalg.solve(root, np.column_stack([part.residuals, part.slopes]))
    along, size = np.linalg.qr(white[..., 1:])
    left = white[..., :1] - along @ (along.mT @ white[..., :1])
    diagonal, restricted = (np.abs(np.diagonal(m, axis1=-2, axis2=-1)) for m in (root, size))
    return np.asarray(
        np.sum(left[..., 0] ** 2, axis=-1)
        + 2.0 * (np.log(diagonal).sum(axis=-1) + np.log(restricted).sum(axis=-1))
        - math.log(2.0 * math.pi) * part.slopes.shape[1]
    )
