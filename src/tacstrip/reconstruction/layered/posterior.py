"""How sure a scene is: other places of its corners that explain both layers, by descents beside it and Metropolis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from tacstrip.arrays import FloatArray
from tacstrip.core.scene import Fitted, Scene, SceneProblem
from tacstrip.reconstruction.layered.search import SHAKE

_STEPS, _KEPT = 900, 60
_STRIDE = 2.0  # over the root of the number of coordinates
_SEEN = 0.02  # of the strip length: deviation of an edge's middle from which it is unseen
_LOOSE = 0.05  # of the strip length: deviation of a corner that no reading determines
_DESCENTS, _DESCENT_STEPS, _FARTHEST = 60, 30, 6.0  # the last: times SHAKE
_NEAR = 9.0  # of the squared residuals: a minimum that is worse by more does not count
_SAME = 5e-4  # of the strip length: between minima that are one


@dataclass(frozen=True, eq=False)
class SceneDraws:
    """Scenes drawn: overlaps of every polygon with its own estimate (draws, K)."""

    iou: FloatArray

    def confidence(self, polygon: int, iou: float) -> float:
        """Return the probability that a polygon overlaps the true one by so much."""
        return float((self.iou[:, polygon] >= iou).mean())


def loosely_held(problem: SceneProblem, information: FloatArray) -> FloatArray:
    """Return the covariance (2 M, 2 M) [mm^2] of corners, those that nothing determines known to some % of L."""
    loose = (_LOOSE * problem.length_mm) ** -2
    return np.asarray(np.linalg.inv(information + loose * np.eye(len(information))))


def covariance_over_minima(problem: SceneProblem, fitted: Fitted) -> FloatArray:
    """Return the covariance (2 M, 2 M) [mm^2] of corners about a scene, over all minima beside it.

    An edge that few strips read makes kinks wherever its corner passes a strip: the minimum is one of several, and its
    own curvature may say tenths of a millimetre where the next one lies two beside it. Each counts by its residuals and
    the volume about it (Laplace's approximation).
    """
    random, scene = np.random.default_rng(0), fitted.scene
    owner = np.repeat(np.arange(len(scene.sizes)), scene.sizes)
    minima = [fitted]
    for i in range(_DESCENTS):
        far = random.uniform(1.0, _FARTHEST) * SHAKE * problem.length_mm
        moved = random.normal(0.0, far, scene.corners.shape)
        if i % 2:
            moved[owner != random.integers(len(scene.sizes))] = 0.0
        tried = problem.refine(scene.moved(moved), _DESCENT_STEPS)
        off = min(float(np.abs(tried.scene.corners - m.scene.corners).max()) for m in minima)
        if tried.cost < fitted.cost + _NEAR and off > _SAME * problem.length_mm:
            minima.append(tried)
    own = [loosely_held(problem, m.information + problem.end_information(m.scene)) for m in minima]
    likelihood = np.array(
        [0.5 * np.linalg.slogdet(c)[1] - 0.5 * m.cost for c, m in zip(own, minima, strict=True)]
    )
    weight = np.exp(likelihood - likelihood.max())
    off_mm = np.stack([(m.scene.corners - scene.corners).ravel() for m in minima])
    about = np.stack(own) + off_mm[:, :, None] * off_mm[:, None]
    return np.asarray(np.tensordot(weight / weight.sum(), about, 1))


def draw_scenes(problem: SceneProblem, scene: Scene) -> SceneDraws:
    """Draw scenes of as many polygons; an edge that no reading sees may bend in its middle."""
    random = np.random.default_rng(0)
    fitted = problem.fitted(_with_bends(problem, scene))
    loose = (_LOOSE * problem.length_mm) ** 2
    value, vector = np.linalg.eigh(loosely_held(problem, fitted.information))
    root = vector * np.sqrt(np.clip(value, 0.0, loose))
    size = len(value)
    steps = random.normal(size=(_STEPS, size)) @ root.T * (_STRIDE / np.sqrt(size))
    chance = np.log(random.random(_STEPS))
    here, cost = np.zeros(size), fitted.cost
    own = shapely.buffer([shapely.Polygon(p) for p in fitted.scene.polygons], 0.0)
    iou = []
    for i in range(_STEPS):
        there = here + steps[i]
        scene = fitted.scene.moved(there)
        new = problem.fitted(scene).cost + float(there @ there) / loose
        if chance[i] < 0.5 * (cost - new):
            here, cost = there, new
        if i % (_STEPS // _KEPT) == 0:
            drawn = shapely.buffer([shapely.Polygon(p) for p in fitted.scene.moved(here).polygons], 0.0)
            both = shapely.area(shapely.intersection(own, drawn))
            iou.append(both / np.maximum(shapely.area(own) + shapely.area(drawn) - both, 1e-12))
    return SceneDraws(np.array(iou))


def _with_bends(problem: SceneProblem, scene: Scene) -> Scene:
    """Return the scene with one more corner in the middle of every edge that no reading holds."""
    middles = 0.5 * (scene.corners + scene.corners[scene.following])
    along = scene.corners[scene.following] - scene.corners
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.maximum(np.hypot(*along.T), 1e-12)[:, None]
    owner = np.repeat(np.arange(len(scene.sizes)), scene.sizes)
    both = np.stack([scene.corners, middles], axis=1).reshape(-1, 2)
    information = problem.fitted(Scene(both, tuple(2 * n for n in scene.sizes))).information
    unseen = np.zeros(len(middles), dtype=bool)
    for k, across in enumerate(normal):
        rows = slice(4 * k + 2, 4 * k + 4)
        unseen[k] = across @ information[rows, rows] @ across < (_SEEN * problem.length_mm) ** -2
    kept = np.stack([np.ones(len(middles), dtype=bool), unseen], axis=1).ravel()
    sizes = tuple(int(n + unseen[owner == k].sum()) for k, n in enumerate(scene.sizes))
    return Scene(both[kept], sizes)
