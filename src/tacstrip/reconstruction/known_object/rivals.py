"""What else may explain the readings: the outline in another size, or its mirror image, as of a drawing with y down."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import shapely

from tacstrip.arrays import FloatArray
from tacstrip.reconstruction.known_object.readings import (
    STARTS,
    PoseFit,
    cost_of,
    distinct,
    freedom_of,
    least_cost,
    least_noise,
    noise_left,
    posed_at,
    readings_left,
)

FLIPPED = 0.05  # probability that a drawing is flipped
# IoU of an outline with its mirror image, and its farthest corners, if it has an axis.
_ALIKE, _FARTHEST = 0.98, 0.99
# Standard deviation of another object's size, and the probability that it is that.
_SIZE, _OTHER_SIZE = 0.1, 0.1
# Of the root of its area: standard deviation of how far the edges lie elsewhere of an object that one strip disproves.
_ELSEWHERE = 0.1
# Logarithms of odds: so much less is hardly worse, so much more is the most that counts.
_ALARM, _MOST = 2.0, 50.0
_COARSE_STEPS, _STEPS = 30, 20
_SIZE_STEP, _MOST_SIZES = 1.4, 12  # of the search for a size
_OVER_BORDER = 3.0  # times what is touched: as far as an object over the border is looked for


def has_axis(corners: FloatArray) -> bool:
    """Whether an outline (N, 2) about its centroid is its own mirror image, turned."""
    z = corners @ [1.0, 1.0j]
    far = int(np.abs(z).argmax())
    images = z.conj()
    turn = z[far] / images[np.abs(z) >= _FARTHEST * abs(z[far])]
    turned = images * (turn / np.abs(turn))[:, None]
    one, others = shapely.Polygon(corners), shapely.polygons(np.stack([turned.real, turned.imag], axis=-1))
    common = shapely.area(shapely.intersection(one, others))
    return bool((common >= _ALIKE * (2.0 * one.area - common)).any())


def mirror_image(fit: PoseFit) -> tuple[PoseFit, FloatArray]:
    """Return the fit of the mirror image, and the poses (B, 4) where its descents end, the best first."""
    other = replace(fit, corners=(fit.corners * [-1.0, 1.0])[::-1])
    return other, _searched(other, STARTS)


def log_evidence(fit: PoseFit, pose: FloatArray, known: float | None, freedom: int) -> float:
    """Return the logarithm of a pose's likelihood, but for a constant; of unknown noise over all that it may be."""
    cost, of_readings = cost_of(fit, pose), float((readings_left(fit, pose) ** 2).sum())
    if known is not None:
        return -0.5 * cost
    return -0.5 * (cost - of_readings + freedom * math.log(max(of_readings, least_cost(fit))))


def odds_of_another_size(fit: PoseFit, pose: FloatArray, known: float | None) -> tuple[float, float]:
    """Return the odds that the object has another size, and how surely the readings say which: its deviation [1]."""
    free = replace(fit, log_size=_SIZE)
    larger = pose + np.outer([-1.0, -0.5, 0.0, 0.5, 1.0], [0.0, 0.0, 0.0, _SIZE])
    poses = np.concatenate([larger, _searched(free, STARTS // 2)])
    if known is None:
        level = min(noise_left(free, at) for at in poses)
        free = free.with_sigma(max(level, least_noise(fit.sensor)))
    poses, _ = free.descend(poses, _STEPS)
    deviations = np.sqrt(free.covariances(poses)[:, 3, 3])
    freedom = freedom_of(fit) - 1
    free = replace(free, weight=fit.weight)
    gains = np.array([log_evidence(free, other, known, freedom) for other in poses])
    gains = np.minimum(gains - log_evidence(fit, pose, known, freedom), _MOST)
    odds = _OTHER_SIZE / (1.0 - _OTHER_SIZE) * float((np.exp(gains) * deviations).max()) / _SIZE
    read_alike = gains > -_ALARM
    off = np.maximum(deviations, 0.5 * np.abs(poses[:, 3]))[read_alike]
    return odds, float(off.max(initial=0.0))


def like_another(fit: PoseFit, whole: PoseFit, pose: FloatArray, most: float) -> bool:
    """Whether the outline, or its mirror image, in another size leaves less than `most` of all readings.

    A faulty channel contradicts these as it does the object; another object does so only where it differs.
    """
    for other, poses in ((whole, _searched(whole, STARTS)), mirror_image(whole)):
        deviation = _ELSEWHERE * math.sqrt(shapely.Polygon(fit.corners).area)
        free = replace(other, edge_mm=max(fit.edge_mm, deviation))
        if free.descend(np.concatenate([pose[None], poses]), _STEPS)[1].min() < most:
            return True
    return False


def best_size(fit: PoseFit) -> tuple[float, PoseFit, FloatArray]:
    """Return how many times as large the outline explains the readings best, the fit of that, and its pose (4,)."""
    across = np.ptp(posed_at(fit.corners, fit.starts())[..., 0], axis=1)
    touched = float(np.ptp(fit.x_mm))
    most = touched + sum(
        g if g < math.inf else _OVER_BORDER * (touched + fit.sensor.pitch_mm) for g in fit.gaps
    )
    least = max(touched, 0.5 * fit.sensor.pitch_mm) / across.max()
    sizes = math.ceil(math.log(most / across.min() / least) / math.log(_SIZE_STEP)) + 1
    found = []
    for size in least * _SIZE_STEP ** np.arange(min(sizes, _MOST_SIZES)):
        other = replace(fit, corners=size * fit.corners, log_size=math.log(_SIZE_STEP))
        pose = _searched(other, STARTS // 3)[0]
        found.append((cost_of(other, pose), size * math.exp(pose[3]), pose))
    _, size, pose = min(found, key=lambda one: one[0])
    return size, replace(fit, corners=size * fit.corners), pose * [1.0, 1.0, 1.0, 0.0]


def _searched(fit: PoseFit, starts: int) -> FloatArray:
    """Return the poses (B, 4) where descents from so many angles end, the best first."""
    coarse = fit.thinned()
    begin = coarse.starts()[:: STARTS // starts]
    poses = distinct(coarse, *coarse.descend(begin, _COARSE_STEPS))
    return distinct(fit, *fit.descend(poses, _STEPS))
