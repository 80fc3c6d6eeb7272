"""The next scan of two layers: the polygons of the last one, brought to what both layers read now by least squares."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import shapely

from tacstrip.arrays import BoolArray
from tacstrip.contact.noise import Noise
from tacstrip.core.scene import Scene
from tacstrip.reconstruction.layered.estimate import covariance_of, level_of, scene_problem, strips_under
from tacstrip.reconstruction.layered.posterior import loosely_held
from tacstrip.reconstruction.layered.search import SHAKE
from tacstrip.reconstruction.noise_covariance import Averaging
from tacstrip.reconstruction.polygon.goodness_of_fit import chi_square_score
from tacstrip.reconstruction.result import Reconstruction, RecoveredObject
from tacstrip.robust import robust_sigma
from tacstrip.scan import Scan
from tacstrip.sensor.layers import LayeredSensor

_STEPS = 30
# Where that does not explain the readings: as soft [% of L], reach of a residual.
_FAR = (1.0, 4.0), (0.1, 6.0)
_SHAKES = 8  # restarts beside the kinks of the hull
_OUTLYING = 6.0  # times the residuals' spread
_EXCESS = 5.0  # standard deviations by which the squared residuals may exceed those that noise explains
_SIGMA_UPDATE = 0.02  # weight of a new scan in the running estimate of the noise


@dataclass(frozen=True, eq=False)
class SceneState:
    """What lay on both layers in the last scan.

    Attributes
    ----------
    objects
        A polygon each, in the order of the scene.
    scene
        The polygons.
    sigma
        Standard deviation of a reading [Vref].
    out
        Readings of each layer (S, n) that are not used.
    """

    objects: tuple[RecoveredObject, ...]
    scene: Scene
    sigma: float
    out: tuple[BoolArray, ...]


def begin(
    found: Reconstruction, scan: Scan, sensor: LayeredSensor, noise: Noise | None = None
) -> SceneState | None:
    """Return the state of what a search found in a scan; None where it is no polygons."""
    if not found.objects or not all(thing.found for thing in found.objects):
        return None
    scene = Scene.of([thing.vertices for thing in found.objects])
    sigma = level_of(scan, sensor, noise)
    problem = scene_problem(scan, sensor, sigma)
    off = [np.abs(r) for r in problem.residuals(scene)]
    read = np.concatenate(
        [r[p.problem.weight > 0.0].ravel() for r, p in zip(off, problem.layers, strict=True)]
    )
    limit = _OUTLYING * max(float(robust_sigma(read)), 1.0)
    out = tuple(r > limit for r in off)
    if noise is None:
        problem = problem.without(list(out))
        freedom = max(problem.readings - scene.corners.size, 1)
        sigma *= max(math.sqrt(problem.fitted(scene).cost / freedom), 0.5)
    return SceneState(found.objects, scene, sigma, out)


def follow(
    last: SceneState, scan: Scan, sensor: LayeredSensor, noise: Noise | None = None, detail: bool = False
) -> tuple[SceneState, bool]:
    """Return the state in the next scan, and whether the same polygons explain its readings.

    Parameters
    ----------
    last
        State in the scan before.
    scan, sensor, noise
        The next scan, its sensor, and the noise of its readings where it is known.
    detail
        Compute covariances too.
    """
    problem = scene_problem(scan, sensor, last.sigma).without(list(last.out))
    freedom = max(problem.readings - last.scene.corners.size, 1)

    def score(cost: float) -> float:
        return chi_square_score(np.sqrt(np.array([cost])), freedom, "normal")

    fitted = problem.refine(last.scene, _STEPS)
    if score(fitted.cost) > _EXCESS:
        scene = last.scene
        for soft, reach in _FAR:
            scene = problem.refine(scene, _STEPS, soft * 0.01 * problem.length_mm, reach).scene
        fitted = min(fitted, problem.refine(scene, _STEPS), key=lambda f: f.cost)
        random = np.random.default_rng(0)
        for _ in range(_SHAKES):
            if score(fitted.cost) <= _EXCESS:
                break
            moved = fitted.scene.moved(
                random.normal(0.0, SHAKE * problem.length_mm, fitted.scene.corners.shape)
            )
            fitted = min(fitted, problem.refine(moved, _STEPS), key=lambda f: f.cost)
    rings = fitted.scene.polygons
    if not all(shapely.Polygon(ring).is_valid for ring in rings):
        return last, False
    explained = score(fitted.cost) <= _EXCESS
    sigma = last.sigma
    if noise is None and explained:
        sigma *= math.sqrt(1.0 - _SIGMA_UPDATE + _SIGMA_UPDATE * fitted.cost / freedom)
    objects = [
        replace(thing, vertices=ring, covariance=None, strips=strips_under(sensor, ring))
        for thing, ring in zip(last.objects, rings, strict=True)
    ]
    if detail:
        own = loosely_held(problem, fitted.information + problem.end_information(fitted.scene))
        covariance, hidden = covariance_of(problem, fitted, own, noise, Averaging.of(scan))
        for k, (start, count) in enumerate(zip(fitted.scene.starts, fitted.scene.sizes, strict=True)):
            rows = slice(2 * start, 2 * (start + count))
            seen = hidden[start : start + count]
            objects[k] = replace(objects[k], covariance=covariance[rows, rows], hidden=seen)
    return SceneState(tuple(objects), fitted.scene, sigma, last.out), explained
