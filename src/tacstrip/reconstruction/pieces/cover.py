"""The least number of convex pieces that the stretches of l and u can belong to, and which to which.

Two stretches are of one piece where the convex hull of what they show lies within what the strips read, and where
neither shows a strip on which the other one's jump says that their piece has not begun, or has ended.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import combinations, count

import numpy as np
import shapely

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.core.convex_chain import hull_ends
from tacstrip.reconstruction.pieces.chain import Chain, Stretch

_SLACK = 3.0  # deviations of a reading by which a hull may leave what the strips read
_NEAR = 1  # strips between two places that may be one
_FEW = 2  # strips of a part, of which none is left out
_COVERS = 12  # of one number of pieces that are compared
_MANY_PARTS = 14  # three objects have ten: noise that is larger than given makes more
_STEPS = 2000  # of the search for the fewest pieces: three objects of a hundred strips take some hundred


@dataclass(frozen=True, eq=False)
class Part:
    """A stretch of one end.

    Attributes
    ----------
    side
        0: of l, 1: of u.
    stretch
        Of l, or of -u.
    """

    side: int
    stretch: Stretch

    @property
    def sign(self) -> float:
        """The factor from y to the height of the stretch: 1 for l, -1 for u."""
        return -1.0 if self.side else 1.0

    @property
    def begins(self) -> bool:
        """Whether its piece begins where the stretch does."""
        return self.stretch.before is None or self.stretch.before.kind == "begins"

    @property
    def ends(self) -> bool:
        """Whether its piece ends where the stretch does."""
        return self.stretch.after is None or self.stretch.after.kind == "ends"


@dataclass(frozen=True, eq=False)
class Read:
    """What the strips of a run read: x, l, u and their deviations, each (n,) [mm], and which lie beside no cut."""

    x: FloatArray
    l: FloatArray
    u: FloatArray
    l_sigma: FloatArray
    u_sigma: FloatArray
    sure: BoolArray

    @cached_property
    def limits(self) -> tuple[FloatArray, FloatArray]:
        """Least and greatest y (n,) [mm] of a hull, some deviations outside l and u; infinite beside a cut."""
        low, high = self.l - _SLACK * self.l_sigma, self.u + _SLACK * self.u_sigma
        return np.where(self.sure, low, -np.inf), np.where(self.sure, high, np.inf)

    @cached_property
    def borders(self) -> FloatArray:
        """Half way between neighbouring strips (n - 1,) [mm]."""
        return 0.5 * (self.x[1:] + self.x[:-1])

    @cached_property
    def pitch(self) -> float:
        """From a strip to the next one [mm]."""
        return float(np.diff(self.x).min()) if len(self.x) > 1 else 1.0

    @classmethod
    def of(cls, x: FloatArray, chains: tuple[Chain, Chain]) -> Read:
        """Make it from the chains of l and of -u, evaluated at strips at x (n,) [mm], drawn on over those left out."""
        sure = np.ones(len(x), dtype=np.bool_)
        fitted = []
        for chain in chains:
            y = np.full(len(x), np.nan)
            for stretch in chain.stretches:
                y[stretch.start : stretch.stop] = stretch.shown
                if stretch.before is not None:
                    sure[max(stretch.start - 1, 0) : stretch.start + 1] = False
            known = np.isfinite(y)
            sure &= known
            fitted.append(y if known.all() else np.interp(x, x[known], y[known]))
        sigmas = [1.0 / np.sqrt(chain.weight) for chain in chains]
        return cls(x, fitted[0], -fitted[1], sigmas[0], sigmas[1], sure)


@dataclass(frozen=True, eq=False)
class Cover:
    """Which parts are of one piece.

    Attributes
    ----------
    parts
        All stretches of both ends.
    pieces
        Indices of the parts of each piece.
    others
        Covers by as many pieces.
    fewest
        Pieces that there must be; None: as many as these. Of very many parts, as noise makes that is larger than given,
        the fewest pieces are not searched for.
    """

    parts: list[Part]
    pieces: list[tuple[int, ...]]
    others: tuple[Cover, ...] = ()
    fewest: int | None = None

    def gap_mm(self, pitch: float) -> float:
        """Return the least distance [mm] between what the strips show of two pieces, infinite with one piece.

        Chains reach a pitch beyond the run, where a pointed piece closes. Where nothing jumps they reach half way into
        inward corners too, and meet there; next to a jump elsewhere a corner may hide another one.
        """
        corners = all(
            cut is None or cut.kind == "corner"
            for part in self.parts
            for cut in (part.stretch.before, part.stretch.after)
        )
        by = 0.5 * pitch if corners else 0.0
        reached = ([_reaching(self.parts[i], pitch, by) for i in piece] for piece in self.pieces)
        hulls = [shapely.convex_hull(shapely.linestrings(np.concatenate(points))) for points in reached]
        return min((float(a.distance(b)) for a, b in combinations(hulls, 2)), default=math.inf)


def least_cover(chains: tuple[Chain, Chain], read: Read, pitch: float, gap: float) -> Cover:
    """Return the cover of both ends by the fewest pieces; of several the plainest one, with the others.

    Parameters
    ----------
    chains
        Of l and of -u.
    read
        What the strips of the run read.
    pitch, gap
        Of the strips, and by which objects are apart, both [mm]. So high a jump may part the run's outer strips from
        their neighbours.
    """
    whole = [Part(side, stretch) for side, chain in enumerate(chains) for stretch in chain.stretches]

    @cache
    def shown(part: Part) -> FloatArray:
        return _surely_shown(part)

    @cache
    def one(a: Part, b: Part) -> bool:
        return _may_be_one(a, b) and _within(np.concatenate([shown(a), shown(b)]), read)

    found = _of_parts(whole, one)
    if len(found[0].pieces) == 1 or len(whole) > _MANY_PARTS:
        return found[0]
    places = {part.stretch: i for i, part in enumerate(whole)}
    loose = [
        (places[chain.stretches[-1 if right else 0]], [Part(side, stretch) for stretch in shed])
        for side, chain in enumerate(chains)
        for right in (False, True)
        if (shed := chain.shed(right, gap)) is not None
    ]
    for count_shed in range(1, len(loose) + 1):
        for chosen in combinations(loose, count_shed):
            if len({i for i, *_ in chosen}) < count_shed:
                continue  # both ends of one stretch
            parts = list(whole)
            for i, (kept, alone) in chosen:
                parts[i] = kept
                parts.append(alone)
            more = _of_parts(parts, one)
            if len(more[0].pieces) < len(found[0].pieces):
                found = more
            elif len(more[0].pieces) == len(found[0].pieces):
                found += more
    if len(split := _split_at_corners(whole, read.x, pitch, gap)) > len(whole):
        more = _of_parts(split, one)
        if len(more[0].pieces) < len(found[0].pieces):
            found = more
    # Of covers by as many pieces, those whose pieces lie apart come first: objects do.
    if len(found) > 1:
        found.sort(key=lambda cover: cover.gap_mm(pitch) < gap)
    return replace(found[0], others=tuple(found[1:]))


def _split_at_corners(parts: list[Part], x: FloatArray, pitch: float, gap: float) -> list[Part]:
    """Return the parts, those of the other side cut where an inward corner is that hides no gap.

    Pieces that meet in a corner, as those of one concave object do, may share the chain on the other side of it.
    """
    corners = [
        (1 - part.side, part.stretch.start)
        for part in parts
        if (cut := part.stretch.before) is not None and cut.kind == "corner" and cut.rise < gap
    ]
    for side, strip in corners:
        for i, part in enumerate(parts):
            if part.side == side and part.stretch.start + 1 < strip < part.stretch.stop - 1:
                left, right = part.stretch.split(strip, float(x[strip]) - 0.5 * pitch)
                parts = [*parts[:i], Part(side, left), Part(side, right), *parts[i + 1 :]]
                break
    return parts


def _of_parts(parts: list[Part], one: Callable[[Part, Part], bool]) -> list[Cover]:
    """Return the covers of parts by the fewest pieces, the plainest first; `one`: whether two may be of one piece."""
    n = len(parts)
    fits = [[False] * n for _ in range(n)]
    for i, j in combinations(range(n), 2):
        fits[i][j] = fits[j][i] = one(parts[i], parts[j])
    for most in count(1):
        found = _covers(fits, most)
        if found is None:
            return [Cover(parts, _first_fit(fits), fewest=most)]
        if found:
            ranked = sorted(found, key=lambda pieces: _strangeness(pieces, parts))
            return [Cover(parts, pieces) for pieces in ranked]
    raise AssertionError  # as many pieces as parts always do


def _covers(fits: list[list[bool]], most: int) -> list[list[tuple[int, ...]]] | None:
    """Return partitions into at most so many sets whose members all fit each other; None: the search is too long."""
    found: list[list[tuple[int, ...]]] = []
    steps = 0

    def add(i: int, pieces: list[tuple[int, ...]]) -> None:
        nonlocal steps
        steps += 1
        if len(found) >= _COVERS or steps > _STEPS:
            return
        if i == len(fits):
            found.append(list(pieces))
            return
        for k, piece in enumerate(pieces):
            if all(fits[i][j] for j in piece):
                add(i + 1, [*pieces[:k], (*piece, i), *pieces[k + 1 :]])
        if len(pieces) < most:
            add(i + 1, [*pieces, (i,)])

    add(0, [])
    return found if found or steps <= _STEPS else None


def _first_fit(fits: list[list[bool]]) -> list[tuple[int, ...]]:
    """Return a partition into sets whose members all fit each other, each part in the first set that takes it."""
    pieces: list[tuple[int, ...]] = []
    for i in range(len(fits)):
        k = next((k for k, piece in enumerate(pieces) if all(fits[i][j] for j in piece)), len(pieces))
        pieces[k : k + 1] = [(*pieces[k], i) if k < len(pieces) else (i,)]
    return pieces


def _may_be_one(a: Part, b: Part) -> bool:
    """Whether neither part shows a strip on which the other one's piece has not begun, or has ended."""
    first, last = sorted((a, b), key=lambda part: part.stretch.start)
    if last.begins and first.stretch.start < last.stretch.start - _NEAR:
        return False
    if first.begins and last.stretch.start < first.stretch.start - _NEAR:
        return False
    first, last = sorted((a, b), key=lambda part: part.stretch.stop)
    if first.ends and last.stretch.stop > first.stretch.stop + _NEAR:
        return False
    return a.side != b.side or (a.stretch.stop != b.stretch.start and b.stretch.stop != a.stretch.start)


def _within(points: FloatArray, read: Read) -> bool:
    """Whether the hull of points (M, 2) lies within what the strips read."""
    (low, high), (least, most) = hull_ends(points, read.x), read.limits
    return not ((low < least) | (high > most)).any()


def _reaching(part: Part, outside: float, inside: float) -> FloatArray:
    """Return a part's points (M, 2) on its strips, extended by `outside` [mm] at the run's ends, `inside` at cuts."""
    at, stretch = part.stretch.strips_x, part.stretch
    first, last = (inside if cut else outside for cut in (stretch.before, stretch.after))
    at = np.concatenate([[at[0] - first], at, [at[-1] + last]])
    return np.column_stack([at, part.sign * stretch.at(at)])


def _surely_shown(part: Part) -> FloatArray:
    """Return the readings (M, 2) of a part, without the strips beside a cut: they may be its neighbour's."""
    stretch = part.stretch
    found = np.column_stack([stretch.strips_x, part.sign * stretch.shown])
    if len(found) <= _FEW:
        return found
    return found[int(stretch.before is not None) : len(found) - int(stretch.after is not None)]


def _strangeness(pieces: list[tuple[int, ...]], parts: list[Part]) -> int:
    """Return how many pieces show l alone or u alone: of two covers the one with fewer is preferred."""
    return sum(len({parts[i].side for i in piece}) == 1 for piece in pieces)
