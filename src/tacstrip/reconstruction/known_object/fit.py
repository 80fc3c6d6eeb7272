"""The pose of a known rigid outline: x, y and angle from all strips, with covariance and the poses that remain.

Descents, all at once, begin at angles all round; what they end in are the poses that the readings leave, weighed by
their posterior (Laplace).
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from tacstrip.arguments import takes
from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.contact.noise import Noise
from tacstrip.contact.shape import Contact
from tacstrip.core.problem import FLOOR
from tacstrip.errors import ContactError, OptionError
from tacstrip.fisher import positive_part
from tacstrip.reconstruction.implausible import doubt_implausible
from tacstrip.reconstruction.known_object.readings import (
    GUESS,
    PoseFit,
    across_upright_edges,
    corners_of,
    distinct,
    freedom_of,
    from_beside,
    noise_left,
    posed_at,
    readings_left,
    turned_alike,
)
from tacstrip.reconstruction.known_object.rivals import FLIPPED, has_axis, log_evidence, mirror_image
from tacstrip.reconstruction.known_object.status import (
    PROBABLE,
    Hypothesis,
    explains,
    judged,
    probability_of,
)
from tacstrip.reconstruction.noise_covariance import (
    Averaging,
    CorrelatedErrors,
    correlated,
    fit_sigma,
    reading_covariance,
)
from tacstrip.reconstruction.on_surface import refuse_stretched
from tacstrip.reconstruction.polygon.run import CHECKS
from tacstrip.reconstruction.result import Alternative, Pose, Reconstruction, RecoveredObject
from tacstrip.reconstruction.seam import unrolled
from tacstrip.reconstruction.strip_width import PARTIAL_STRIPS
from tacstrip.scan import Scan
from tacstrip.sensor.constructions import check_closed_form
from tacstrip.sensor.left_out import left_out_wholly
from tacstrip.sensor.spec import Sensor

_STEPS, _FINE_STEPS = 30, 20  # of the descents
_BRIDGED = 3  # strips that may be missing inside a contact
_UNLIKELY = 1e-3  # weight below which an alternative is not named
_WIDTH_READ = 0.2  # of the width: by how much wide strips read other than their centre lines
_ENOUGH = 4  # wide strips: of fewer none is left out
_NEIGHBOURS = 0.4  # correlation of soft edges' errors on neighbouring strips, measured on pressed rubber
_SUSPECTS = 8  # readings that are left out by turns where no pose explains all


@takes(scan=Scan, sensor=Sensor, noise=Noise)
def fit_object(
    scan: Scan,
    sensor: Sensor,
    outline: npt.ArrayLike | Contact,
    noise: Noise | None = None,
    *,
    edge_mm: float = 0.0,
) -> Reconstruction:
    """Find where a known rigid object lies: the pose of its outline, with covariance.

    Parameters
    ----------
    scan, sensor
        What was measured, with what; both signatures or one. Where the spec gives `strip_width_mm`, strips read over
        it, roughly where a corner lies on them: "likely" at best.
    outline
        The object's corners (N, 2) [mm] in a frame of its own, convex or concave, either way round; or a contact of
        one polygon. It is turned and moved, not mirrored.
    noise
        Of the readings; None: the spec's `[noise]`, and without one estimated from what the fit leaves over. Parts that
        strips share or that last are in the covariance.
    edge_mm
        Standard deviation of where soft edges end [mm]: of the whole outline's growth, which is fitted along, and of
        every end. 0: hard edges. With a noise given, ends of neighbouring strips err alike: over its
        `edge_correlation_mm`, or with a correlation of .4.

    Returns
    -------
    Reconstruction
        An object per contact, with the posed outline as vertices, its covariance, `pose`, and `alternatives`: other
        poses that the readings leave, each with its weight, and without a pose the outline's mirror image, for one
        drawing in twenty is flipped. "doubtful": the outline overlaps the truth by IoU .8 or more with a
        probability below 90 %, or no pose explains the readings, as where it is another object, or its mirror image
        or another size of it does so better. A reading that does not fit is left out; "ok" then only where another
        size or the mirror image would not explain it.

    Raises
    ------
    ReadingError, SignatureError, OptionError
        The scan is not of this sensor, or the construction has no closed form.
    ContactError
        The outline is no polygon with an area.

    Examples
    --------
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-crs", strips=10, pitch_mm=10.0, length_mm=100.0)
    >>> shape = ts.Contact.polygon([(0, 0), (50, 0), (30, 40)])
    >>> pressed = shape.turned(0.4).placed(50, 45)
    >>> found = ts.fit_object(ts.simulate(sensor, pressed), sensor, shape).objects[0]
    >>> [round(v, 2) for v in (found.pose.x_mm, found.pose.y_mm, found.pose.angle)]
    [50.0, 45.0, 0.4]
    """
    scan = scan.checked(sensor)
    check_closed_form(sensor.kind, "fit_object")
    refuse_stretched(sensor, "fit_object")
    if not isinstance(edge_mm, int | float | np.number) or not 0.0 <= edge_mm < math.inf:
        raise OptionError(f"edge_mm = {edge_mm!r}: must be 0 (hard edges) or more")
    corners = corners_of(outline)
    reach = 2.0 * float(np.linalg.norm(corners, axis=1).max())
    runs: list[slice] = []
    laid_out, surface = unrolled(scan, sensor, _BRIDGED)
    silent = np.resize(left_out_wholly(sensor), surface.strips)  # of a closed tube, in both rounds
    for run in laid_out.runs():
        between = silent[runs[-1].stop : run.start] if runs else silent[:0]
        joint = runs and (len(between) <= _BRIDGED or between.all())
        if joint and (run.stop - runs[-1].start - 1) * sensor.pitch_mm <= reach:
            run = slice(runs.pop().start, run.stop)
        runs.append(run)
    noise = sensor.noise if noise is None else noise
    objects = tuple(
        _placed(laid_out.read_on(run), surface, corners, run, silent, noise, edge_mm, sensor.strips)
        for run in runs
    )
    return doubt_implausible(Reconstruction("object", objects, scan.time_s), scan, sensor)


def pose_covariance(
    sensor: Sensor, outline: npt.ArrayLike | Contact, pose: tuple[float, float, float], sigma: float
) -> FloatArray:
    """Return the Cramer-Rao bound (3, 3) of x [mm], y [mm] and angle [rad] of an outline at a pose.

    `sigma` [Vref] is a reading's standard deviation; the touched strips tell both ends as in `vertex_covariance`.
    """
    corners = corners_of(outline)
    at = np.array([[*pose, 0.0]])
    x = posed_at(corners, at)[0, :, 0]
    strips = np.flatnonzero((sensor.x_mm >= x.min()) & (sensor.x_mm <= x.max()))
    if not len(strips):
        raise ContactError("the outline touches no strip at this pose")
    run = slice(int(strips[0]), int(strips[-1]) + 1)
    none = np.zeros((len(sensor.signatures), len(strips)))
    fit = PoseFit(
        sensor, corners, run, sensor.x_mm[run], sensor.signatures, none, np.full_like(none, 1.0 / sigma), 0.0,
        left_out_wholly(sensor),
    )  # fmt: skip
    jacobian = fit.rows(at)[1][0, :, :3]
    return np.asarray(np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-13, hermitian=True))


def _placed(
    scan: Scan,
    sensor: Sensor,
    corners: FloatArray,
    run: slice,
    silent: BoolArray,
    noise: Noise | None,
    edge_mm: float,
    around: int,
) -> RecoveredObject:
    """Return the object of one run of strips; round a tube their numbers begin again after `around`."""
    averaging = Averaging.of(scan)
    hard = (
        noise if noise is None or not edge_mm else replace(noise, edge_mm=0.0, blur_mm=0.0)
    )  # counted by strip
    known = None if hard is None else max(fit_sigma(hard, sensor, averaging), FLOOR)
    distribution = noise.distribution if noise is not None and noise.independent else "normal"
    k = np.stack([scan[name][run] for name in scan.signatures])
    there = np.isfinite(k)
    wide = sensor.strip_width_mm is not None
    if wide and k.shape[1] >= _ENOUGH:  # the outer ones may be covered in part
        there[:, :PARTIAL_STRIPS] = there[:, -PARTIAL_STRIPS:] = False
    x, read, used = sensor.x_mm[run], np.where(there, k, 0.0), there.astype(float)
    fit = PoseFit(sensor, corners, run, x, scan.signatures, read, used, edge_mm, silent, wide)
    # Less than what soft edges read otherwise would let one pose of several seem to be the only one.
    fit = fit.with_sigma(math.hypot(known or max(GUESS, sensor.adc_step), edge_mm / sensor.length_mm))
    coarse = fit.thinned()
    if wide:  # centre lines are as far off as that
        coarse = coarse.with_sigma(max(known or GUESS, _WIDTH_READ * sensor.strip_width / sensor.length_mm))
    poses, cost = coarse.descend(coarse.starts(), _STEPS)
    poses = distinct(coarse, poses, cost)
    if edge_mm:
        fit = fit.with_sigma(known or GUESS, poses[0])
    poses, cost = fit.descend(np.concatenate([poses, turned_alike(fit, poses)]), _FINE_STEPS)
    before = fit.weight > 0.0
    fit, poses = _without_outlier(fit, distinct(fit, poses, cost), known, distribution)
    out = before & ~(fit.weight > 0.0)
    sigma = known or max(noise_left(fit, poses[0]), FLOOR, sensor.adc_step / math.sqrt(12.0))
    whole = replace(fit, weight=before.astype(float)).with_sigma(sigma, poses[0])
    if known is None:
        fit = fit.with_sigma(sigma, poses[0])
    poses, cost = fit.descend(poses, _FINE_STEPS)
    found = _weighed(fit, distinct(fit, poses, cost), known, noise, averaging)
    best, *others = found
    sure = probability_of(found)
    mirrored = [one for one in others if one.mirrored]
    status, advice, explained = judged(fit, whole, best, known, distribution, sure, mirrored)
    vertices, covariance = _vertices(corners, best.pose, _stated(best))
    l, u = (end[0] for end in fit.ends(best.pose[None])[:2])
    alternatives = tuple(
        Alternative(
            one.weight,
            _vertices(one.fit.corners, one.pose, one.covariance)[0],
            None if one.mirrored else _pose(one.pose, _stated(one)),
        )
        for one in others
        if explained and one.weight >= _UNLIKELY
    )
    notes = [advice]
    if out.any():
        where = (np.flatnonzero(out.any(axis=0)) + run.start) % around + sensor.strip_base
        names = ", ".join(map(str, where))
        why = "another object, or a faulty channel" if status == "doubtful" else "is a channel stuck?"
        notes.append(f"strip {names} does not fit the object and was left out: {why}")
    return RecoveredObject(
        run, vertices, (fit.x_mm, l, u), covariance, status, "; ".join(n for n in notes if n),
        confidence=sure if explained and (status == "ok" or sure < PROBABLE) else None,  # else it is not the question
        alternatives=alternatives, pose=_pose(best.pose, _stated(best)),
    )  # fmt: skip


def _weighed(
    fit: PoseFit, poses: FloatArray, known: float | None, noise: Noise | None, averaging: Averaging
) -> list[Hypothesis]:
    """Return what may lie there, each with its probability: first the outline at its likeliest pose."""
    tried = [(fit, pose, False) for pose in poses]
    if not has_axis(fit.corners):
        flipped, mirrored = mirror_image(fit)
        tried += [(flipped, pose, True) for pose in mirrored]
    found: list[Hypothesis] = []
    for one, at, is_mirrored in tried:
        errors, covariance = errors_at(one, at, noise, averaging), one.covariance(at)
        if errors is not None:
            covariance = errors.propagated(covariance)
        elif known is None:  # sigma is itself estimated
            covariance = covariance * region_of_unknown(fit.parameters, freedom_of(fit))
        weight = math.log(FLIPPED if is_mirrored else 1.0 - FLIPPED)
        weight += log_evidence(one, at, known, freedom_of(fit))
        weight += 0.5 * math.log(max(float(np.linalg.det(covariance)), 1e-300))
        found.append(Hypothesis(one, at, covariance, errors, weight, is_mirrored))
    weights = np.exp(np.array([one.weight for one in found]) - max(one.weight for one in found))
    weights /= weights.sum()
    found = [replace(one, weight=float(w)) for one, w in zip(found, weights, strict=True)]
    found.sort(key=lambda one: -one.weight)
    best = next(one for one in found if not one.mirrored)
    return [best, *(one for one in found if one is not best)]


def _stated(one: Hypothesis) -> FloatArray:
    """Return a pose's covariance, with what beside upright edges slopes do not tell."""
    if one.errors is None:
        return across_upright_edges(one.fit, one.pose, one.covariance)
    alone = one.fit.covariance(one.pose)
    return one.covariance + positive_part(across_upright_edges(one.fit, one.pose, alone) - alone)


def _pose(pose: FloatArray, covariance: FloatArray) -> Pose:
    angle = math.remainder(float(pose[2]), 2.0 * math.pi)
    return Pose(float(pose[0]), float(pose[1]), angle, covariance[:3, :3])


def _without_outlier(
    fit: PoseFit, poses: FloatArray, known: float | None, distribution: str
) -> tuple[PoseFit, FloatArray]:
    """Return the fit, and its poses, without the one reading that no pose explains while one does all others.

    None is left out where hardly any would be left to check the others: there another object's outline passes, too.
    """
    if explains(fit, poses[0], known, distribution):
        return fit, poses
    further = from_beside(fit, poses, _FINE_STEPS)
    if explains(fit, further[0], known, distribution):
        return fit, further
    if freedom_of(fit) < CHECKS:
        return fit, poses
    found, every = (fit, poses), np.concatenate([poses, further])
    least = math.inf
    for at in np.argsort(-np.abs(readings_left(fit, poses[0])), axis=None)[:_SUSPECTS]:
        weight = fit.weight.copy()
        weight.flat[at] = 0.0
        trial = replace(fit, weight=weight)
        ended, cost = trial.descend(every, _FINE_STEPS)
        best = int(cost.argmin())
        if cost[best] < least and explains(trial, ended[best], known, distribution):
            least, found = cost[best], (trial, distinct(trial, ended, cost))
    return found


def _vertices(corners: FloatArray, pose: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the posed outline (N, 2) [mm], counter-clockwise from the left-most, and its covariance (2N, 2N)."""
    posed = posed_at(corners, pose[None])[0]
    posed = np.roll(posed, -int(np.lexsort((posed[:, 1], posed[:, 0]))[0]), axis=0)
    slope = np.zeros((len(posed), 2, 3))
    slope[:, 0, 0] = slope[:, 1, 1] = 1.0
    slope[:, 0, 2], slope[:, 1, 2] = pose[1] - posed[:, 1], posed[:, 0] - pose[0]
    flat = slope.reshape(-1, 3)
    return posed, np.asarray(flat @ covariance[:3, :3] @ flat.T)


def region_of_unknown(numbers: int, freedom: int) -> float:
    """Return by how much a 95 % region grows where `freedom` residuals tell sigma: F over chi square."""
    from scipy.special import chdtri, fdtri

    return float(numbers * fdtri(numbers, max(freedom, 3), 0.95) / chdtri(numbers, 0.05))


def errors_at(
    fit: PoseFit, pose: FloatArray, noise: Noise | None, averaging: Averaging
) -> CorrelatedErrors | None:
    """Return the readings' errors at a pose, over their weights, where they are not independent."""
    if noise is not None and fit.edge_mm:  # the growth of all ends is fitted along
        apart = noise.edge_correlation_mm or -fit.sensor.pitch_mm / math.log(_NEIGHBOURS)
        noise = replace(noise, edge_mm=fit.edge_mm, edge_correlation_mm=apart, blur_mm=0.0)
    if noise is None or not correlated(noise, averaging):
        return None
    used, ends = fit.weight > 0.0, fit.ends(pose[None])[:2]
    matrix = reading_covariance(noise, fit.sensor, fit.x_mm, (ends[0][0], ends[1][0]), fit.names, averaging)
    at, weight = used.ravel(), fit.weight[used]
    residuals, slopes = (rows[0, : at.size][at] for rows in fit.rows(pose[None]))
    matrix = matrix[np.ix_(at, at)] * np.outer(weight, weight)
    return CorrelatedErrors(matrix, 1.0, slopes[:, : fit.parameters], residuals, used)
