"""Whether readings are those of the known object at its pose, and how sure the pose is."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import shapely

from tacstrip.arrays import FloatArray
from tacstrip.reconstruction.known_object.readings import (
    PoseFit,
    freedom_of,
    noise_left,
    posed_at,
    readings_left,
)
from tacstrip.reconstruction.noise_covariance import CorrelatedErrors, signature_advice
from tacstrip.reconstruction.polygon.goodness_of_fit import autocorrelation_score, chi_square_score
from tacstrip.reconstruction.polygon.run import fit_run
from tacstrip.reconstruction.result import Status

ALARM = 3.5  # standard deviations of a test's statistic
_OVERLAP, PROBABLE = 0.8, 0.9  # IoU with the truth that "ok" promises, and its least probability
_DRAWS = 64  # of the posterior, for that probability
# Of Vref: sigma of noise of 2 %, and its estimate's error; what fits worse is another object.
CEILING = 0.014
_FEWEST_READINGS = 6  # of one signature, below which ...
# ... or above which level (P.U. profile I, estimated) [Vref] another object may explain it.
_PLAUSIBLE = 0.0035
_CHANCE, _LEAST_FREEDOM = 1e-3, 3  # of the F test, and of a polygon that it is made with
_LEAST_NOISE = 2e-4  # of Vref: sensors that read better are compared with that
# Where a reading was left out, the one of many whose absence explains the others best: their alarm, and by how many
# deviations it must contradict the object in other sizes, too.
_ALARM_WITHOUT, _FAULT = 2.5, 9.0
_OTHER_SIZE = (
    0.1  # of the root of its area: standard deviation of how far another object's edges lie elsewhere
)
_OTHER_POSES, _COARSE_STEPS, _STEPS = 8, 15, 20


def judged(
    fit: PoseFit,
    whole: PoseFit,
    pose: FloatArray,
    known: float | None,
    distribution: str,
    sure: float,
    errors: CorrelatedErrors | None,
) -> tuple[Status, str]:
    """Return the status of the likeliest pose (4,), and advice.

    `whole` is the fit with the reading that was left out, if one was; `sure` the probability that the outline overlaps
    the object as "ok" promises; `known` the noise, if given [Vref].
    """
    left = readings_left(fit, pose)
    readings = int(np.count_nonzero(fit.weight))
    left_out = readings < np.count_nonzero(whole.weight)
    freedom = max(readings + sum(gap < math.inf for gap in fit.gaps) - 3, 1)
    level = noise_left(fit, pose)
    if errors is not None:
        left, freedom = errors.whitened(fit.covariance(pose))
    if (
        chi_square_score(left, freedom, distribution) > (_ALARM_WITHOUT if left_out else ALARM)
        or (readings > 6 and autocorrelation_score(left, readings) > ALARM)
        or (known is None and (level > CEILING or (not fit.edge_mm and _beyond_polygon(fit, pose))))
    ):
        return "doubtful", (
            f"at the best pose the readings are {100.0 * level:.2g} % of Vref from this object's: it is another "
            "object, pressed in part, or the noise is larger than given"
        )
    x = posed_at(fit.corners, pose[None])[0, :, 0]
    beyond = max(x.min() - fit.x_mm[0], fit.x_mm[-1] - x.max())
    missing = max(fit.x_mm[0] - x.min() - fit.gaps[0], x.max() - fit.x_mm[-1] - fit.gaps[1])
    if max(beyond, missing) > fit.sensor.pitch_mm:
        return "doubtful", (
            f"this object ends {max(beyond, missing):.3g} mm from where the touched strips say: it is another object, "
            "or there are two"
        )
    independent = known is not None and errors is None and not (fit.edge_mm or fit.wide)
    if independent and _least_of_all_sizes(fit, pose[None]) < _cost(fit, pose) - ALARM**2:
        return "doubtful", "the object in another size explains the readings better: it is another object"
    if left_out and _like_another(fit, whole, pose):
        return "doubtful", "all strips read nearly as the object does in another size, or as its mirror image"
    if known is None and len(fit.names) == 1 and (readings < _FEWEST_READINGS or level > _PLAUSIBLE):
        return "doubtful", (
            f"the readings are {100.0 * level:.2g} % of Vref from this object's on {readings} strips: one signature "
            "does not tell noise from another object; give the noise (noise=, --positional, or [noise] in "
            f"the spec), or {signature_advice(fit.sensor)}"
        )
    if sure < PROBABLE:
        return "doubtful", (
            f"the pose is not certain: the outline overlaps the object by 80 % with a probability of {sure:.2g}; see "
            "the alternatives, turn the object a little, average more scans, or "
            f"{signature_advice(fit.sensor) if len(fit.names) == 1 else 'use finer strips'}"
        )
    if fit.wide:
        return "likely", (
            "a strip that a corner or a steep edge lies on is modelled roughly: the pose may be off by a part of "
            "strip_width_mm, or turned"
        )
    return "ok", ""


def _like_another(fit: PoseFit, whole: PoseFit, pose: FloatArray) -> bool:
    """Whether the reading that was left out is nearly explained by the outline, or its mirror image, in another size.

    A faulty channel contradicts these as it does the object; another object does so only where it differs.
    """
    for corners in (fit.corners, (fit.corners * [-1.0, 1.0])[::-1]):
        other = replace(whole, corners=corners)
        coarse = other.thinned()
        poses, cost = coarse.descend(coarse.starts(), _COARSE_STEPS)
        poses = np.concatenate([pose[None], poses[np.argsort(cost)[:_OTHER_POSES]]])
        if _least_of_all_sizes(other, poses) < _cost(fit, pose) + _FAULT**2:
            return True
    return False


def _cost(fit: PoseFit, pose: FloatArray) -> float:
    return float((fit.rows(pose[None])[0] ** 2).sum())


def _least_of_all_sizes(fit: PoseFit, poses: FloatArray) -> float:
    """Return the least cost that descents from poses (B, 4) end with where the outline may grow or shrink, too."""
    deviation = _OTHER_SIZE * math.sqrt(shapely.Polygon(fit.corners).area)
    free = replace(fit, edge_mm=max(fit.edge_mm, deviation))
    return float(free.descend(poses, _STEPS)[1].min())


def _beyond_polygon(fit: PoseFit, pose: FloatArray) -> bool:
    """Whether a free polygon explains the readings so much better (F test) that they are of another object."""
    from scipy.special import fdtrc

    k = np.where(fit.weight > 0.0, fit.k, np.nan)
    free = fit_run(fit.sensor, fit.x_mm, dict(zip(fit.names, k, strict=True)))
    if free.model is None or free.freedom < _LEAST_FREEDOM or free.excluded.any():
        return False
    least = max(free.sigma, _LEAST_NOISE, fit.sensor.adc_step / math.sqrt(12.0)) ** 2
    more = freedom_of(fit) - free.freedom
    gain = noise_left(fit, pose) ** 2 * freedom_of(fit) - least * free.freedom
    return more > 0 and gain > 0.0 and float(fdtrc(more, free.freedom, gain / more / least)) < _CHANCE


def probability_of(
    corners: FloatArray, poses: FloatArray, covariances: list[FloatArray], weight: FloatArray
) -> float:
    """Return the probability that the first pose's outline overlaps the truth by `_OVERLAP`."""
    random = np.random.default_rng(0)
    which = np.searchsorted(np.cumsum(weight) / weight.sum(), (np.arange(_DRAWS) + 0.5) / _DRAWS)
    draws = poses[which].copy()
    for i, at in enumerate(which):
        value, vector = np.linalg.eigh(covariances[at][:3, :3])
        draws[i, :3] += vector @ (np.sqrt(np.maximum(value, 0.0)) * random.standard_normal(3))
    first, *others = shapely.polygons(posed_at(corners, np.concatenate([poses[:1], draws])))
    common = shapely.area(shapely.intersection(first, others))
    return float((common >= _OVERLAP * (first.area + shapely.area(others) - common)).mean())
