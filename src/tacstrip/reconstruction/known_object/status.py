"""Whether readings are those of the known object at its pose, and how sure the pose is."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import shapely

from tacstrip.arrays import FloatArray
from tacstrip.reconstruction.known_object.readings import (
    GUESS,
    PoseFit,
    cost_of,
    freedom_of,
    from_beside,
    least_noise,
    noise_left,
    posed_at,
    readings_left,
)
from tacstrip.reconstruction.known_object.rivals import best_size, like_another, odds_of_another_size
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
# Where a reading was left out, the one of many whose absence explains the others best: their alarm, and by how many
# deviations it must contradict the object in other sizes, too.
_ALARM_WITHOUT, _FAULT = 2.5, 9.0
# Of the noise that the object leaves, where that is not known: so little leaves what does explain it.
_FAR_BETTER = 0.5
_TRIED, _STEPS = 4, 20  # poses of the mirror image, and steps of descents
_LARGER_OR_SMALLER = "the object in another size explains the readings better: it is another object"
_HARDLY_TOLD = 0.04  # of its size: a deviation for which 10 % more or less would read nearly alike
_ANY_SIZE = "its size is taken as drawn: 10 % more or less would read nearly alike"
_FLIPPED = "is the drawing flipped, as where its y points down?"


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """What may lie there: an outline, or its mirror image, at a pose.

    Attributes
    ----------
    fit
        Of the outline, or of its mirror image.
    pose, covariance
        Where (4,), and how surely (P, P).
    errors
        Of the readings, where they are not independent.
    weight
        The probability of this.
    mirrored
        Whether it is the mirror image.
    """

    fit: PoseFit
    pose: FloatArray
    covariance: FloatArray
    errors: CorrelatedErrors | None
    weight: float
    mirrored: bool


def explains(fit: PoseFit, pose: FloatArray, known: float | None, distribution: str) -> bool:
    """Whether a pose leaves no more of the readings than noise does."""
    left, freedom = readings_left(fit, pose), freedom_of(fit)
    level = noise_left(fit, pose) <= CEILING
    return level and (known is None or chi_square_score(left, freedom, distribution) <= ALARM)


def judged(
    fit: PoseFit,
    whole: PoseFit,
    best: Hypothesis,
    known: float | None,
    distribution: str,
    sure: float,
    mirrored: list[Hypothesis],
) -> tuple[Status, str, bool]:
    """Return the status of the likeliest pose, advice, and whether it explains the readings.

    `whole` is the fit with the reading that was left out, if one was; `sure` the probability that the outline overlaps
    the object as "ok" promises; `known` the noise, if given [Vref]; `mirrored` has the mirror image's poses.
    """
    pose, deviation = best.pose, 0.0
    unlike = _unlike(fit, whole, pose, known, distribution, best.errors)
    if not unlike and best.errors is None and not (fit.edge_mm or fit.wide):
        odds, deviation = odds_of_another_size(fit, pose, known)
        unlike = _LARGER_OR_SMALLER if odds > 1.0 else ""
    left_out = np.count_nonzero(fit.weight) < np.count_nonzero(whole.weight)
    if not unlike and left_out and like_another(fit, whole, pose, cost_of(fit, pose) + _FAULT**2):
        unlike = "all strips read nearly as the object does in another size, or as its mirror image"
    if unlike:
        return "doubtful", unlike + _what_explains(whole, pose, known, distribution, mirrored), False
    if sum(one.weight for one in mirrored) > 0.5:
        return "doubtful", f"the mirror image of this outline explains the readings better: {_FLIPPED}", True
    readings, level = int(np.count_nonzero(fit.weight)), noise_left(fit, pose)
    if known is None and len(fit.names) == 1 and (readings < _FEWEST_READINGS or level > _PLAUSIBLE):
        return "doubtful", (
            f"the readings are {100.0 * level:.2g} % of Vref from this object's on {readings} strips: one signature "
            "does not tell noise from another object; give the noise (noise=, --positional, or [noise] in "
            f"the spec), or {signature_advice(fit.sensor)}"
        ), True  # fmt: skip
    if sure < PROBABLE:
        return "doubtful", (
            f"the pose is not certain: the outline overlaps the object by 80 % with a probability of {sure:.2g}; see "
            "the alternatives, turn the object a little, average more scans, or "
            f"{signature_advice(fit.sensor) if len(fit.names) == 1 else 'use finer strips'}"
        ), True  # fmt: skip
    if fit.wide:
        return "likely", (
            "a strip that a corner or a steep edge lies on is modelled roughly: the pose may be off by a part of "
            "strip_width_mm, or turned"
        ), True  # fmt: skip
    return "ok", _ANY_SIZE if deviation > _HARDLY_TOLD else "", True


def _unlike(
    fit: PoseFit,
    whole: PoseFit,
    pose: FloatArray,
    known: float | None,
    distribution: str,
    errors: CorrelatedErrors | None,
) -> str:
    """Say why the readings are not of this object; "" where they may be."""
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
        return (
            f"at the best pose the readings are {100.0 * level:.2g} % of Vref from this object's: it is another "
            "object, pressed in part, or the noise is larger than given"
        )
    if (off := _off_at_the_ends(fit, pose)) > fit.sensor.pitch_mm:
        where = f"this object ends {off:.3g} mm from where the touched strips say"
        return f"{where}: it is another object, or there are two"
    return ""


def _off_at_the_ends(fit: PoseFit, pose: FloatArray) -> float:
    """Return by how much an outline ends elsewhere than the touched strips say [mm]."""
    x = posed_at(fit.corners, pose[None])[0, :, 0]
    beyond = max(x.min() - fit.x_mm[0], fit.x_mm[-1] - x.max())
    missing = max(fit.x_mm[0] - x.min() - fit.gaps[0], x.max() - fit.x_mm[-1] - fit.gaps[1])
    return float(max(beyond, missing))


def _what_explains(
    whole: PoseFit, pose: FloatArray, known: float | None, distribution: str, mirrored: list[Hypothesis]
) -> str:
    """Say what else than the outline as drawn explains the readings: its mirror image, or another size of it."""

    def does(fit: PoseFit, poses: FloatArray) -> bool:
        at = from_beside(fit, poses, _STEPS)[0]
        far = known is None and noise_left(fit, at) > _FAR_BETTER * left
        ends = _off_at_the_ends(fit, at) <= fit.sensor.pitch_mm
        return not far and ends and explains(fit, at, known, distribution)

    left = noise_left(whole, pose)
    if known is None:  # as much as the object leaves would hide what explains them
        whole = whole.with_sigma(min(left, GUESS))
    if mirrored and does(
        replace(mirrored[0].fit, weight=whole.weight), np.array([one.pose for one in mirrored[:_TRIED]])
    ):
        return f"; its mirror image does explain them: {_FLIPPED}"
    size, other, at = best_size(whole)
    larger = f"; {size:.3g} times as large it explains them: check its size, and that its unit is mm"
    return larger if does(other, at[None]) else ""


def _beyond_polygon(fit: PoseFit, pose: FloatArray) -> bool:
    """Whether a free polygon explains the readings so much better (F test) that they are of another object."""
    from scipy.special import fdtrc

    k = np.where(fit.weight > 0.0, fit.k, np.nan)
    free = fit_run(fit.sensor, fit.x_mm, dict(zip(fit.names, k, strict=True)))
    if free.model is None or free.freedom < _LEAST_FREEDOM or free.excluded.any():
        return False
    least = max(free.sigma, least_noise(fit.sensor)) ** 2
    more = freedom_of(fit) - free.freedom
    gain = noise_left(fit, pose) ** 2 * freedom_of(fit) - least * free.freedom
    return more > 0 and gain > 0.0 and float(fdtrc(more, free.freedom, gain / more / least)) < _CHANCE


def probability_of(found: list[Hypothesis]) -> float:
    """Return the probability that the first one's outline overlaps the truth by `_OVERLAP`."""
    random = np.random.default_rng(0)
    ends = np.cumsum([one.weight for one in found])
    outlines = [posed_at(found[0].fit.corners, found[0].pose[None])]
    for at in np.searchsorted(ends / ends[-1], (np.arange(_DRAWS) + 0.5) / _DRAWS):
        one = found[at]
        value, vector = np.linalg.eigh(one.covariance[:3, :3])
        draw = one.pose.copy()
        draw[:3] += vector @ (np.sqrt(np.maximum(value, 0.0)) * random.standard_normal(3))
        outlines.append(posed_at(one.fit.corners, draw[None]))
    first, *others = shapely.polygons(np.concatenate(outlines))
    common = shapely.area(shapely.intersection(first, others))
    return float((common >= _OVERLAP * (first.area + shapely.area(others) - common)).mean())
