"""What touches a sensor of two layers: polygons fitted to both layers' readings together.

A gap between objects along a strip of one layer is seen across it by the other. How many objects there are is chosen by
a criterion; other scenes that explain the readings nearly as well are named, and then no object is "ok".
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import shapely

from tacstrip.arguments import takes
from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.contact.noise import Noise
from tacstrip.core.outliers import isolated_outliers, spikes
from tacstrip.core.problem import FitProblem
from tacstrip.core.scene import Fitted, LayerReadings, Scene, SceneProblem
from tacstrip.errors import OptionError
from tacstrip.reconstruction.contact_ends import closed_ends
from tacstrip.reconstruction.implausible import doubt_implausible
from tacstrip.reconstruction.layered.posterior import covariance_over_minima, draw_scenes
from tacstrip.reconstruction.layered.search import Candidate, Search, inward_corners
from tacstrip.reconstruction.noise_covariance import Averaging, common_variance, fit_sigma, signature_variance
from tacstrip.reconstruction.polygon.chi_square import ALARM
from tacstrip.reconstruction.polygon.goodness_of_fit import chi_square_score
from tacstrip.reconstruction.posterior.assessment import ENOUGH, PROMISED_IOU, Effort, check_effort
from tacstrip.reconstruction.result import Reconstruction, RecoveredObject, Status
from tacstrip.reconstruction.sections import reading_noise
from tacstrip.scan import Scan
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.layers import LayeredSensor

_METHOD = "polygon"
_LEAST_SIGMA = 3e-4  # of Vref: readings are never taken for more exact, or corners are hunted for without end
_HIDDEN = 0.01  # of the strip length: a corner less certain than that is hidden
_RIVAL = 8.0  # of the criterion: a scene that is worse by less is told
_SAME = 0.7  # IoU from which two polygons are one and the same
_MOST_RIVALS = 3
_MERGED = "two of its corners or more turn inwards: it may be several objects taken for one"
_NAMED = 5  # channels that advice names
_MOST_LONE = 2  # readings left out as standing out: more are no faults but a wrong scene
_ROUNDS = 2  # of leaving out what lies alone
# Of sigma: an estimate from the readings that the fit corrects by more is used for another search.
_UNKNOWN = 0.3


@takes(scan=Scan, sensor=LayeredSensor, noise=Noise)
def fit_layers(
    scan: Scan, sensor: LayeredSensor, noise: Noise | None = None, *, assessment: Effort = "thorough"
) -> Reconstruction:
    """Recover polygons from the readings of both layers of a sensor.

    Parameters
    ----------
    scan, sensor
        What was measured, with what.
    noise
        Of the readings. None: the spec's `[noise]`, and without one estimated from the readings.
    assessment
        "thorough"; with "fast" and "none" neither how sure each shape is nor which other scenes explain the readings
        is looked for, and "likely" is the best status.

    Returns
    -------
    Reconstruction
        An object per polygon, left to right, in the frame of the whole; `alternatives` are other scenes that explain
        the readings. Corners that neither layer determines are marked in `hidden`.

    Raises
    ------
    ReadingError, SignatureError, OptionError
        The scan is not of this sensor, its strips have a width, or there is no such assessment.

    Examples
    --------
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor.load("layered-crs-crs")
    >>> contact = ts.Contact.polygon([(20, 20), (45, 25), (30, 50)])
    >>> contact += ts.Contact.polygon([(35, 60), (70, 55), (60, 80)])
    >>> noise = ts.Noise(positional=0.002)
    >>> found = ts.reconstruct(ts.simulate(sensor, contact, noise, rng=1), sensor, noise)
    >>> found.status, [len(o.vertices) for o in found.objects]
    ('ok', [3, 3])
    """
    check_effort(assessment)
    if any(layer.sensor.strip_width_mm for layer in sensor.layers):
        raise OptionError(
            "strip_width_mm: reconstruction from two layers takes strips as their centre lines; leave the key out"
        )
    scan = scan.checked(sensor.unit)
    noise = sensor.noise if noise is None else noise
    if not scan.touched.any():
        return Reconstruction(_METHOD, (), scan.time_s)
    parts = scan.split(sensor)
    silent = [number for number, part in enumerate(parts) if not part.touched.any()]
    if silent:
        why = f"no strip of layer {silent[0]} is touched: does the contact lie on both layers? One alone is not enough"
        return _without_shape(scan, sensor, why)
    thorough = assessment == "thorough"
    search, best, out = _searched(scan, sensor, noise, thorough)
    if best is None:
        why = "the touched strips of one layer cross none of the other's: is a strip dead, or an angle wrong?"
        return _without_shape(scan, sensor, why)
    problem, fitted = search.problem, best.fitted
    wrong = _misfit(search, fitted, noise)
    rivals = _rivals(search, best) if thorough else []
    covariance, hidden = covariance_of(
        problem, fitted, covariance_over_minima(problem, fitted), noise, Averaging.of(scan)
    )
    confident = draw_scenes(problem, fitted.scene).confidence if thorough and not wrong else None
    shared = [wrong, _rivals_advice(best, rivals), *_left_out(out, sensor, scan)]
    objects = []
    inwards = inward_corners(fitted.scene)
    for k, (ring, start) in enumerate(zip(fitted.scene.polygons, fitted.scene.starts, strict=True)):
        rows = slice(start, start + len(ring))
        made = _object(
            ring, covariance[2 * rows.start : 2 * rows.stop, 2 * rows.start : 2 * rows.stop], hidden[rows]
        )
        confidence = None if confident is None else confident(k, PROMISED_IOU)
        own = _MERGED if inwards[k] > 1 else _advice(made, confidence)
        doubtful = bool(wrong or rivals or own)
        status: Status = "doubtful" if doubtful else "ok" if confidence is not None else "likely"
        advice = "; ".join(filter(None, [*shared[:2], own, *shared[2:]]))
        strips = strips_under(sensor, ring)
        objects.append(replace(made, strips=strips, status=status, advice=advice, confidence=confidence))
    result = Reconstruction(
        _METHOD,
        tuple(sorted(objects, key=lambda o: float(o.vertices[:, 0].min()))),
        scan.time_s,
        tuple(tuple(rival.fitted.scene.polygons) for rival in rivals),
    )
    return doubt_implausible(result, scan, sensor.unit)


def scene_problem(scan: Scan, sensor: LayeredSensor, sigma: float) -> SceneProblem:
    """Return what the polygons of a scene are fitted to."""
    parts = []
    for layer, own in zip(sensor.layers, scan.split(sensor), strict=True):
        readings = {name: own[name] for name in own.signatures}
        problem = FitProblem.of(layer.sensor, layer.sensor.x_mm, readings, sigma)
        bounds = np.where(own.touched, np.array([[0.0], [layer.sensor.length_mm]]), np.nan)
        if {"kh", "kl"} <= set(own.signatures):
            known = own.touched & ~own.half_read
            bounds[:, known] = np.stack(closed_ends(layer.sensor, own["kh"][known], own["kl"][known]))
        parts.append(LayerReadings(layer, problem, own.touched, bounds))
    return SceneProblem(tuple(parts), sigma)


def _searched(
    scan: Scan, sensor: LayeredSensor, noise: Noise | None, thorough: bool
) -> tuple[Search, Candidate | None, list[BoolArray]]:
    """Return the search, its best scene, and which readings of each layer (S, n) were left out as outliers."""
    whole = scene_problem(scan, sensor, level_of(scan, sensor, noise))
    out = [_lone_spikes(part, whole.sigma) for part in whole.layers]
    problem = whole.without(out)
    search = Search(problem, thorough)
    best = search.run()
    if best is not None and any(o.any() for o in out):
        off = whole.residuals(best.fitted.scene)
        suspects = [o & isolated_outliers(r) for o, r in zip(out, off, strict=True)]
        if sum(int(o.sum()) for o in suspects) > _MOST_LONE:
            suspects = [np.zeros_like(o) for o in suspects]
        for out in ([np.zeros_like(o) for o in suspects], suspects):  # do all readings fit, or all but these?
            problem = whole.without(out)
            best = search.refined(problem, best)
            if search.explains(best.fitted):
                break
    for _ in range(_ROUNDS):
        if best is None:
            break
        if noise is None:
            freedom = max(problem.readings - best.fitted.scene.corners.size, 1)
            factor = max(math.sqrt(best.fitted.cost / freedom), _LEAST_SIGMA / problem.sigma)
            if abs(factor - 1.0) > _UNKNOWN:
                search = Search(problem := problem.scaled(factor), thorough)
                best = search.run()
                continue
        if search.explains(best.fitted):
            break
        found = [
            isolated_outliers(r) & ~o for r, o in zip(problem.residuals(best.fitted.scene), out, strict=True)
        ]
        if not 0 < sum(int(f.sum()) for f in found) <= _MOST_LONE:
            break
        out = [o | f for o, f in zip(out, found, strict=True)]
        search = Search(problem := problem.without(found), thorough)
        best = search.run()
    return search, best, out


def _lone_spikes(part: LayerReadings, sigma: float) -> BoolArray:
    """Return readings (S, n) that stand out from their neighbours alone: where a hull jumps, both of a strip do."""
    k = np.where(part.problem.weight > 0.0, part.problem.k, np.nan)
    out = np.zeros(k.shape, dtype=bool)
    edges = np.flatnonzero(np.diff(part.touched.astype(np.int8), prepend=0, append=0))
    for first, last in edges.reshape(-1, 2):
        out[:, first:last] = [spikes(values, sigma) for values in k[:, first:last]]
    out &= np.isfinite(k)
    return np.asarray(out & (out.sum(axis=0) == 1)) if len(k) > 1 else np.zeros_like(out)


def level_of(scan: Scan, sensor: LayeredSensor, noise: Noise | None) -> float:
    """Return the standard deviation of a reading [Vref]: the noise's, or as far as the readings tell."""
    if noise is not None:
        averaging = Averaging.of(scan)
        return max(_LEAST_SIGMA, *(fit_sigma(noise, layer.sensor, averaging) for layer in sensor.layers))
    levels = [
        reading_noise(part[name][run][np.isfinite(part[name][run])])
        for part in scan.split(sensor)
        for run in part.runs()
        for name in part.signatures
    ]
    return max(
        _LEAST_SIGMA, sensor.unit.adc_step / math.sqrt(12.0), float(np.sqrt(np.mean(np.square(levels))))
    )


def _misfit(search: Search, fitted: Fitted, noise: Noise | None) -> str:
    """Return advice where the scene does not explain the readings, else nothing."""
    distribution = "normal" if noise is None or not noise.independent else noise.distribution
    problem = search.problem
    freedom = problem.readings - fitted.scene.corners.size
    residuals = np.sqrt(np.array([fitted.cost]))  # what polygons miss of touched and silent strips is in it
    if chi_square_score(residuals, freedom, distribution) <= ALARM:
        return ""
    times = math.sqrt(fitted.cost / max(freedom, 1))
    return (
        f"the readings are {times:.3g} times as far from the best scene as the noise explains: there may be more "
        "objects, hidden ones or others, or the noise is larger than given"
    )


def _rivals(search: Search, best: Candidate) -> list[Candidate]:
    """Return other scenes that explain the readings nearly as well, best first."""
    kept = [best]
    for other in sorted(search.found, key=lambda c: c.criterion):
        if other.criterion > best.criterion + _RIVAL or len(kept) > _MOST_RIVALS:
            break
        if not any(_same(other.fitted.scene, k.fitted.scene) for k in kept):
            kept.append(other)
    return kept[1:]


def _same(one: Scene, other: Scene) -> bool:
    if len(one.sizes) != len(other.sizes):
        return False
    a, b = ([shapely.buffer(shapely.Polygon(p), 0.0) for p in scene.polygons] for scene in (one, other))
    overlap = np.array([[shapely.area(shapely.intersection(p, q)) for q in b] for p in a])
    areas = [shapely.area(p) for p in (a, b)]
    iou = overlap / np.maximum(areas[0][:, None] + areas[1] - overlap, 1e-12)
    return bool((iou.max(axis=1) >= _SAME).all() and (iou.max(axis=0) >= _SAME).all())


def _rivals_advice(best: Candidate, rivals: list[Candidate]) -> str:
    if not rivals:
        return ""
    counts = sorted({r.count for r in rivals} - {best.count})
    others = f"{' or '.join(map(str, counts))} objects" if counts else "others at other places"
    best_is = "1 object explains" if best.count == 1 else f"{best.count} objects explain"
    return (
        f"{best_is} the readings best, but {others} nearly as well (alternatives): move the objects, or average more "
        "scans"
    )


def covariance_of(
    problem: SceneProblem, fitted: Fitted, own: FloatArray, noise: Noise | None, averaging: Averaging
) -> tuple[FloatArray, BoolArray]:
    """Return the covariance of all corners (2 M, 2 M) [mm^2], and which of them no reading determines (M,).

    `own` is the covariance by the errors that each reading has for itself.
    """
    deviation = np.sqrt(np.diag(own).reshape(-1, 2).sum(axis=1))
    hidden = deviation > _HIDDEN * problem.length_mm
    common = 0.0
    if noise is not None:  # what the strips of one signature share is taken for all strips'
        common = common_variance(noise, averaging) + signature_variance(noise, averaging)
    if common > 0.0:
        by = own @ problem.of_offset(fitted)
        own = own + common * np.outer(by, by)
    return own, hidden


def _object(ring: FloatArray, covariance: FloatArray, hidden: BoolArray) -> RecoveredObject:
    """Return an object with its corners counter-clockwise from the left-most."""
    x, y = ring.T
    order = np.arange(len(ring))
    if (x * np.roll(y, -1) - np.roll(x, -1) * y).sum() < 0.0:
        order = order[::-1]
    order = np.roll(order, -int(np.lexsort((y[order], x[order]))[0]))
    places = np.stack([2 * order, 2 * order + 1], axis=1).ravel()
    return RecoveredObject(
        slice(0, 0), ring[order], covariance=covariance[np.ix_(places, places)], hidden=hidden[order]
    )


def _advice(made: RecoveredObject, confidence: float | None) -> str:
    """Return what is doubtful of one object's own shape."""
    if not shapely.Polygon(made.vertices).is_valid:
        return "its outline crosses itself: most of it is hidden, and no shape is known"
    if confidence is None or confidence >= ENOUGH:
        return ""
    unseen = int(made.hidden.sum()) if made.hidden is not None else 0
    why = f", {unseen} of its {len(made.vertices)} corners being hidden by others" if unseen else ""
    return (
        f"with a probability of {confidence:.2f} only it overlaps the true outline by an IoU of {PROMISED_IOU} or "
        f"more{why}"
    )


def strips_under(sensor: LayeredSensor, ring: FloatArray) -> slice:
    """Return the strips of layer 0 that an object lies on."""
    layer = sensor.layers[0]
    x = layer.to_layer(ring)[:, 0] / layer.sensor.pitch_mm
    first, last = np.clip([math.ceil(x.min() - 0.5), math.floor(x.max() - 0.5)], 0, layer.sensor.strips - 1)
    return slice(int(first), max(int(last), int(first)) + 1)


def _left_out(out: list[BoolArray], sensor: LayeredSensor, scan: Scan) -> list[str]:
    """Name the readings that were left out."""
    names = [
        f"{sensor.where(int(i) + part.start)} ({SIGNATURES[scan.signatures[s]].symbol})"
        for part, o in zip(sensor.slices, out, strict=True)
        for s, i in np.argwhere(o)
    ]
    if not names:
        return []
    listed = ", ".join(names[:_NAMED]) + (", ..." if len(names) > _NAMED else "")
    return [f"{listed} does not fit its neighbours and was left out: is a channel stuck?"]


def _without_shape(scan: Scan, sensor: LayeredSensor, why: str) -> Reconstruction:
    """Return an object without a shape, of the strips that are touched."""
    touched = np.flatnonzero(scan.touched[sensor.slices[0]])
    first, last = (int(touched[0]), int(touched[-1])) if len(touched) else (0, 0)
    lone = RecoveredObject(slice(first, last + 1), status="too few strips", advice=why)
    return Reconstruction(_METHOD, (lone,), scan.time_s)
