"""How many polygons explain both layers, and which: pieces are cut, joined and dropped, and polygons lose corners.

The criterion is that of the polygon fit: the squared residuals, and what every corner costs.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import shapely

from tacstrip.arrays import FloatArray
from tacstrip.core.scene import Fitted, Scene, SceneProblem
from tacstrip.reconstruction.layered.pieces import cuts, outline, possible

_START_CORNERS = (6, 8, 5)
_MORE_STARTS = 8  # where none of these explains the readings
_STAGES = ((1.0, 4.0), (0.2, 5.0))  # first how soft [% of the strip length], and how far a residual counts
_STAGE_STEPS, _STEPS, _FULL_STEPS = 10, 15, 30
SHAKE = 0.004  # of the strip length: restarts beside the kinks of the hull
_SHAKES, _LAST_SHAKES, _LAST_MOVES = 3, 12, 80
_MOST_GROWN = 4  # corners that a scene gets which does not explain the readings
_FARTHEST = 6.0  # times that
_ENOUGH = 32  # strips of a layer that lead a search
_TRIED = 4  # corners whose loss is tried before the rest is taken for certain
_CERTAIN = 100.0  # squared deviations of a corner from the line past it: it is one
_LOOSE = 0.1  # of the strip length: deviation of a corner that nothing determines
_MOST = 6  # polygons
_CUTS_TRIED = 6
_CUT_CORNERS, _LESS_CORNERS = 5, 6
_JOINED_CORNERS, _JOINED_MOVES = (6, 8, 4), 20
_BETTER = 4.0  # by which a scene of other pieces must be
_OBJECT = 6.0  # what an object costs: two that touch often explain one nearly as well
_INWARD, _CROSSED = 6.0, 50.0  # what a corner that turns inwards and an outline that crosses itself cost
_STRAIGHT = 0.03  # sine of a turn that is none
_REFITTED = 20.0  # of the criterion: scenes that are worse by more are not fitted again
_CONDENSED, _CONDENSED_RIVALS = 15.0, 2  # of the criterion, and how many rivals
_PLAINLY = 3.0  # times the criterion: further refinement does not help
_SPREAD = 0.8  # variance of a uniform error's square over sigma^4


@dataclass(frozen=True, eq=False)
class Candidate:
    """A scene that was fitted to the end.

    Attributes
    ----------
    fitted
        The scene.
    pieces
        That it began with.
    criterion
        By which scenes are compared.
    """

    fitted: Fitted
    pieces: list[FloatArray]
    criterion: float

    @property
    def count(self) -> int:
        """Polygons."""
        return len(self.fitted.scene.sizes)


class Search:
    """The search for the scene of one scan.

    Parameters
    ----------
    problem
        The readings.
    thorough
        Whether to look for other scenes that explain the readings too.
    """

    def __init__(self, problem: SceneProblem, thorough: bool = True) -> None:
        self.problem, self.thorough = problem, thorough
        self.per_corner = 2.0 * float(np.log(max(problem.readings, 2)))
        self.found: list[Candidate] = []
        self._random = np.random.default_rng(0)

    def run(self) -> Candidate | None:
        """Return the best scene; None where the layers' touched strips do not cross.

        Many strips have many kinks, over which corners do not get: a search whose end the readings contradict begins
        again where some of the strips lead it.
        """
        best = self._found()
        if best is None:
            return None
        for problem in self.problem.coarser(_ENOUGH):
            if self.explains(best.fitted):
                break
            other = Search(problem, thorough=False)._found()
            if other is not None:
                again = self._candidate(self.pruned(other.fitted.scene), other.pieces)
                again = self._condensed(self._polished(self._simplified(again)))
                best = min(best, again, key=lambda c: c.criterion)
        return best

    def _found(self) -> Candidate | None:
        """Return the best scene of one search."""
        pieces = possible(self.problem)
        best = self._first(pieces[:_MOST]) if pieces else None
        if best is None:
            return None
        while not self._well(best.fitted):
            better = self._changed(best, cut=range(len(best.pieces)))
            if better is None:
                break
            best = better
        best = self._settled(best)
        return self._condensed(best) if self.thorough else best

    def _settled(self, best: Candidate) -> Candidate:
        """Return the scene with as many objects and corners as the readings pay for."""
        best = self._polished(self._simplified(best))  # what lacks a corner asks for no object more
        if self.thorough and (again := self._rechecked(best)) is not None:
            best = self._polished(self._simplified(again))
        return best

    def explains(self, fitted: Fitted, deviations: float = 4.0) -> bool:
        """Whether a scene leaves no more of the readings than noise does, to so many deviations."""
        freedom = max(self.problem.readings - fitted.scene.corners.size, 1)
        return bool(fitted.cost < freedom + deviations * np.sqrt(_SPREAD * freedom) + 1.5 * deviations)

    def _well(self, fitted: Fitted) -> bool:
        return self.explains(fitted, 2.0)

    def criterion(self, fitted: Fitted) -> float:
        """Return the squared residuals, and what corners and objects cost: few are likelier, and convex ones."""
        scene = fitted.scene
        crossed = sum(not shapely.Polygon(ring).is_valid for ring in scene.polygons)
        unlikely = _OBJECT * len(scene.sizes) + _INWARD * sum(inward_corners(scene)) + _CROSSED * crossed
        return fitted.cost + self.per_corner * len(scene.corners) + unlikely

    def refined(self, problem: SceneProblem, best: Candidate) -> Candidate:
        """Fit the best scenes again, to a problem of other readings, and return the best of these and their joins."""
        self.problem = problem
        near = [c for c in self.found if c.criterion < best.criterion + _REFITTED]
        self.found = []
        for c in near:
            self._candidate(self._shaken(c.fitted.scene, _FULL_STEPS), c.pieces)
        best = min(self.found, key=lambda c: c.criterion)
        return self._settled(self._candidate(self.pruned(best.fitted.scene), best.pieces))

    def _candidate(self, fitted: Fitted, pieces: list[FloatArray]) -> Candidate:
        made = Candidate(fitted, pieces, self.criterion(fitted))
        self.found.append(made)
        return made

    def _first(self, pieces: list[FloatArray]) -> Candidate | None:
        staged = [self._staged(pieces, corners) for corners in _START_CORNERS]
        tried = [self._candidate(self.pruned(s.scene), pieces) for s in staged if s is not None]
        for _ in range(_MORE_STARTS if tried else 0):
            best = min(tried, key=lambda c: c.criterion)
            if self.explains(best.fitted):
                break
            tried.append(self._candidate(self.pruned(self._smaller_start(pieces)), pieces))
        return min(tried, key=lambda c: c.criterion, default=None)

    def _smaller_start(self, pieces: list[FloatArray]) -> Scene:
        """Return polygons within the pieces, which hold more than the objects, at random."""
        rings = [outline(piece, int(self._random.integers(4, 8))) for piece in pieces]
        shrunk = []
        for ring in (r for r in rings if r is not None):
            towards = self._random.dirichlet(np.ones(len(ring))) @ ring
            shrunk.append(towards + self._random.uniform(0.6, 1.0) * (ring - towards))
        return self._approached(Scene.of(shrunk)).scene

    def _staged(self, pieces: list[FloatArray], corners: int) -> Fitted | None:
        """Return the polygons of pieces, brought near the readings softly at first."""
        rings = [ring for piece in pieces if (ring := outline(piece, corners)) is not None]
        return self._approached(Scene.of(rings)) if rings else None

    def _approached(self, scene: Scene) -> Fitted:
        for soft, reach in _STAGES:
            scene = self.problem.refine(
                scene, _STAGE_STEPS, soft * 0.01 * self.problem.length_mm, reach
            ).scene
        return self.problem.fitted(scene)

    def _shaken(self, scene: Scene, steps: int, shakes: int = _SHAKES) -> Fitted:
        """Return the best of descents from a scene and from beside it."""
        best, by = self.problem.refine(scene, steps), SHAKE * self.problem.length_mm
        for _ in range(shakes):
            moved = best.scene.moved(self._random.normal(0.0, by, best.scene.corners.shape))
            best = min(best, self.problem.refine(moved, steps), key=lambda f: f.cost)
        return best

    def _grown(self, fitted: Fitted) -> Fitted:
        """Return the scene with one more corner on an edge, and as few as the readings pay for."""
        scene = fitted.scene
        tried = [self._shaken(scene.with_corner(at), _STEPS) for at in range(len(scene.corners))]
        return self.pruned(min(tried, key=lambda f: f.cost).scene)

    def _any(self, scene: Scene) -> int:
        return int(self._random.integers(len(scene.sizes)))

    def _one_moved(self, scene: Scene, k: int) -> Fitted:
        """Return a descent from a scene with the corners of one polygon moved at random, by little or by much."""
        far = self._random.uniform(1.0, _FARTHEST)
        moved, own = np.zeros_like(scene.corners), slice(scene.starts[k], scene.starts[k] + scene.sizes[k])
        moved[own] = self._random.normal(0.0, far * SHAKE * self.problem.length_mm, moved[own].shape)
        return self.problem.refine(scene.moved(moved), _FULL_STEPS)

    def pruned(self, scene: Scene) -> Fitted:
        """Return the scene without corners that the readings do not pay for."""
        best = self._shaken(scene, _FULL_STEPS)
        while True:
            for at in self._doubtful_corners(best)[:_TRIED]:
                tried = self._shaken(best.scene.without_corner(at), _STEPS)
                if tried.cost < best.cost + self.per_corner:
                    best = tried
                    break
            else:
                return best

    def _polished(self, best: Candidate) -> Candidate:
        """Return the scene after more restarts, and without what corners these make needless."""
        fitted = self._shaken(best.fitted.scene, _FULL_STEPS, _LAST_SHAKES)
        for _ in range(_MOST_GROWN):
            if self._well(fitted):
                break
            grown = self._grown(fitted)
            if self.criterion(grown) >= self.criterion(fitted):
                break
            fitted = grown
        for _ in range(_LAST_MOVES):
            if self._well(fitted):
                break
            fitted = min(fitted, self._one_moved(fitted.scene, self._any(fitted.scene)), key=lambda f: f.cost)
        if fitted.cost < best.fitted.cost - 1.0:
            fitted = self.pruned(fitted.scene)
        polished = self._candidate(fitted, best.pieces)
        return min(best, polished, key=lambda c: c.criterion)

    def _doubtful_corners(self, fitted: Fitted) -> list[int]:
        """Return the corners that may be on the line past them, the likeliest first (Wald's test)."""
        scene = fitted.scene
        corners, before, after = scene.corners, scene.before, scene.following
        chord = corners[after] - corners[before]
        length = np.maximum(np.hypot(*chord.T), 1e-9)
        normal = np.stack([-chord[:, 1], chord[:, 0]], axis=1) / length[:, None]
        away = corners - corners[before]
        off = (away * normal).sum(axis=1)
        share = np.clip((away * chord).sum(axis=1) / length**2, 0.0, 1.0)
        each = np.arange(len(corners))
        slopes = np.zeros((len(corners), len(corners), 2))
        slopes[each, each] = normal
        slopes[each, before] = -(1.0 - share)[:, None] * normal
        slopes[each, after] = -share[:, None] * normal
        rows = slopes.reshape(len(corners), corners.size)
        loose = (_LOOSE * self.problem.length_mm) ** -2
        covariance = np.linalg.inv(fitted.information + loose * np.eye(corners.size))
        variance = np.einsum("ai,ij,aj->a", rows, covariance, rows)
        wald = off**2 / np.maximum(variance, 1e-12)
        sizes = np.repeat(scene.sizes, scene.sizes)
        return [int(k) for k in np.argsort(wald) if sizes[k] > 3 and wald[k] < _CERTAIN]

    def _changed(self, now: Candidate, cut: range) -> Candidate | None:
        """Return a better scene with a piece cut or dropped; None where there is none."""
        staged = [
            (fitted, pieces)
            for pieces, corners in self._ways(now, cut)
            if (fitted := self._staged(pieces, corners)) is not None
        ]
        staged.sort(key=lambda item: item[0].cost)
        better = None
        for fitted, pieces in staged[:_CUTS_TRIED]:
            tried = self._candidate(self.pruned(fitted.scene), pieces)
            least = now.criterion - _BETTER if better is None else better.criterion
            if tried.criterion < least:
                better = tried
        return better

    def _ways(self, now: Candidate, cut: range) -> Iterator[tuple[list[FloatArray], int]]:
        """Yield the pieces with one cut in two or dropped, and the corners to begin with."""
        for k in cut if len(now.pieces) < _MOST else ():
            for parts in cuts(now.pieces[k]):
                yield [*now.pieces[:k], *parts, *now.pieces[k + 1 :]], _CUT_CORNERS
        for k in range(len(now.pieces)) if len(now.pieces) > 1 else ():
            yield [*now.pieces[:k], *now.pieces[k + 1 :]], _LESS_CORNERS

    def _rechecked(self, best: Candidate) -> Candidate | None:
        """Return a better scene of more objects, each polygon being cut in two once; None where there is none."""
        polygons = best.fitted.scene.polygons
        pieces = [_points(ring) for ring in polygons]
        if len(pieces) >= _MOST:
            return None
        ways = []
        for k, piece in enumerate(pieces):
            rest = [*polygons[:k], *polygons[k + 1 :]]
            for parts in cuts(piece):
                rings = [outline(part, _CUT_CORNERS) for part in parts]
                if all(ring is not None for ring in rings):
                    ways.append(self._approached(Scene.of([*rest, *[r for r in rings if r is not None]])))
        ways.sort(key=lambda fitted: fitted.cost)
        tried = [self._candidate(self.pruned(fitted.scene), pieces) for fitted in ways[:_CUTS_TRIED]]
        better = min(tried, key=lambda c: c.criterion, default=best)
        return better if better.criterion < best.criterion else None

    def _simplified(self, best: Candidate) -> Candidate:
        """Return the scene with polygons joined or dropped where that explains the readings as well."""
        while best.count > 1 and (simpler := self._simpler(best)) is not None:
            best = simpler
        return best

    def _simpler(self, best: Candidate) -> Candidate | None:
        polygons = best.fitted.scene.polygons
        for i, j in itertools.combinations(range(best.count), 2):
            rest = [p for k, p in enumerate(polygons) if k not in (i, j)]
            for joined in _joined(polygons[i], polygons[j], rest):
                tried = self._near(Scene.of([*rest, joined]), best)
                if tried is not None and tried.criterion < best.criterion:
                    return tried
        for k in range(best.count):
            tried = self._near(Scene.of([p for m, p in enumerate(polygons) if m != k]), best)
            if tried is not None and tried.criterion < best.criterion:
                return tried
        return None

    def _condensed(self, best: Candidate) -> Candidate:
        """Return the best scene after rivals of more objects had theirs joined and dropped: another way to few."""
        rivals = [c for c in self.found if c.count > best.count and c.criterion < best.criterion + _CONDENSED]
        for rival in sorted(rivals, key=lambda c: c.criterion)[:_CONDENSED_RIVALS]:
            polygons = rival.fitted.scene.polygons
            for i, j in itertools.combinations(range(rival.count), 2):
                rest = [p for k, p in enumerate(polygons) if k not in (i, j)]
                for kept in ([polygons[i]], [polygons[j]], [np.concatenate([polygons[i], polygons[j]])]):
                    rings = [ring for p in kept if (ring := outline(p, _LESS_CORNERS)) is not None]
                    self._near(Scene.of([*rest, *rings]), best)
        lowest = min(self.found, key=lambda c: c.criterion)
        return lowest if lowest.count <= best.count and lowest.criterion < best.criterion else best

    def _near(self, scene: Scene, best: Candidate) -> Candidate | None:
        """Return a scene with fewer polygons, fitted; None where it is plainly worse."""
        near = self.problem.refine(self._approached(scene).scene, _STAGE_STEPS)
        if near.cost > _PLAINLY * best.criterion:
            return None
        near = self._shaken(near.scene, _STEPS, _LAST_SHAKES)
        for _ in range(_JOINED_MOVES):  # two polygons as one: kinks keep its corners from their places
            near = min(near, self._one_moved(near.scene, len(scene.sizes) - 1), key=lambda f: f.cost)
        return self._candidate(self.pruned(near.scene), best.pieces)


def _joined(one: FloatArray, other: FloatArray, rest: list[FloatArray]) -> Iterator[FloatArray]:
    """Yield outlines that hold two polygons, the whole and what the rest of the scene leaves of it."""
    both = np.concatenate([one, other])
    whole = shapely.convex_hull(shapely.MultiPoint(both))
    left = shapely.difference(
        whole, shapely.union_all(shapely.buffer([shapely.Polygon(p) for p in rest], 0.0))
    )
    largest = max(shapely.get_parts(left), key=shapely.area, default=whole)
    made = set()
    for points in (both, shapely.get_coordinates(largest)):
        for corners in _JOINED_CORNERS:
            ring = outline(points, corners)
            if ring is not None and ring.tobytes() not in made:
                made.add(ring.tobytes())
                yield ring


def inward_corners(scene: Scene) -> list[int]:
    """Return how many corners of each polygon turn inwards."""
    to, on = (scene.corners - scene.corners[scene.before], scene.corners[scene.following] - scene.corners)
    turn = to[:, 0] * on[:, 1] - to[:, 1] * on[:, 0]
    sine = turn / np.maximum(np.hypot(*to.T) * np.hypot(*on.T), 1e-12)
    ways = [np.sign(part.sum()) * part for part in np.split(sine, scene.starts[1:])]
    return [int((part < -_STRAIGHT).sum()) for part in ways]


def _points(ring: FloatArray) -> FloatArray:
    """Return points all over a polygon (P, 2) [mm]."""
    low, high = ring.min(axis=0), ring.max(axis=0)
    grid = np.stack(np.meshgrid(*np.linspace(low, high, 24).T), axis=-1).reshape(-1, 2)
    within = shapely.contains_xy(shapely.buffer(shapely.Polygon(ring), 0.0), grid)
    return np.asarray(grid[within])
