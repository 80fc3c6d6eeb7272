"""Cases: an outline or two, the unit that they lie on, and what it reads of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
import shapely

import tacstrip as ts
from studies.holdout import concave as concave_shapes
from studies.holdout.readings import Unit, white
from studies.holdout.shapes import CONCAVE, CONVEX, PLAIN, ROUNDED, UNUSUAL, WAISTED, Array, draw, is_convex

SETS = (
    "convex",
    "pairs",
    "channels",
    "regions",
    "material",
    "rounded",
    "unusual",
    "wide",
    "beside",
    "concave",
)
# Plain shapes whose unit is not what the estimator is told.
MISTOLD = ("noise half told", "noise twice told", "supply", "offset", "ratio", "one contact")
FAULTS = ("dead", "stuck", "saturated")
_T = TypeVar("_T")
_CORRELATED = 0.5  # of errors of neighbouring strips
_NEARER = 60  # moves of an outline towards another one
_TURNS = 200  # tries to place something before another outline is drawn


@dataclass(frozen=True, eq=False)
class Case:
    """One case.

    Attributes
    ----------
    group
        Category of the outline; "pair" of two.
    unit, outlines, low, high
        What touches what, and from where to where [mm] on each strip.
    read
        Readings (names, strips) over Vref with their errors, not yet clipped.
    half_width, distribution, told
        Of the errors, and whether the estimator is told.
    weakest
        Deviations by which the weakest corner shows; inf where none was looked for.
    """

    group: str
    unit: Unit
    outlines: list[Array]
    low: Array
    high: Array
    read: Array
    half_width: float
    distribution: str
    told: bool
    weakest: float = np.inf

    @property
    def strips(self) -> int:
        """How many are touched."""
        return int(np.isfinite(self.low).sum())


def rng(which: str, seed: int, number: int) -> np.random.Generator:
    """Return the generator of a case."""
    return np.random.default_rng([SETS.index(which), seed, number])


def convex(random: np.random.Generator) -> Case:
    """Draw a convex shape, its unit and its noise."""
    strips = int(log_uniform(random, *_choose(random, {(6, 12): 0.3, (12, 101): 0.5, (100, 1001): 0.2})))
    return single(random, str(random.choice(CONVEX)), strips, _some_names(random), _half_width(random))


def rounded(random: np.random.Generator) -> Case:
    """Draw a rounded shape, as `convex` does."""
    strips = int(log_uniform(random, 12, 101))
    half_width = log_uniform(random, 0.0005, 0.01)
    return single(random, str(random.choice(ROUNDED)), strips, _some_names(random), half_width)


def unusual(random: np.random.Generator) -> Case:
    """Draw what no other set has: shapes, filled along the strips, wider than the sensor, or units not as told."""
    strips, half_width = int(log_uniform(random, 8, 101)), log_uniform(random, 0.0005, 0.01)
    kind, names = str(random.choice([*UNUSUAL, *MISTOLD, "over both borders"])), _some_names(random)
    if kind in UNUSUAL:
        case = single(random, kind, strips, names, half_width)
        return replace(case, outlines=[filled(case.unit, case.outlines[0])])
    case = single(random, str(random.choice(PLAIN)), strips, names, half_width)
    unit, (outline,) = case.unit, case.outlines
    if kind == "over both borders":
        first = int(np.flatnonzero(np.isfinite(case.low))[0] + random.integers(1, 2 + case.strips // 8))
        unit = replace(unit, strips=case.strips - int(random.integers(2, 3 + case.strips // 4)))
        return _noisy(random, kind, unit, [outline - [first * unit.pitch, 0.0]], half_width)
    of_unit, error = unit, case.read - unit.read(case.low, case.high)
    if kind.startswith("noise"):
        said = half_width * (0.5 if kind == "noise half told" else 2.0)
        return replace(case, group=kind, half_width=said, told=True)
    if kind == "ratio" and names != ("k",):
        of_unit = replace(unit, ratio=unit.ratio * random.choice([0.9, 1.1]))
    elif kind == "one contact":
        of_unit = replace(unit, contact_lambda=unit.contact_lambda + 0.02 * unit.length)
    read = of_unit.read(case.low, case.high)
    if kind == "one contact":
        others = np.arange(unit.strips) != random.choice(np.flatnonzero(np.isfinite(case.low)))
        read = np.where(others, unit.read(case.low, case.high), read)
    read = read * (random.choice([0.99, 1.01]) if kind == "supply" else 1.0)
    read = read + (random.choice([-0.005, 0.005], (len(names), 1)) if kind == "offset" else 0.0)
    return replace(case, group=kind, read=read + error)


def wide(random: np.random.Generator) -> Case:
    """Draw a convex shape on strips of metal as wide as .9 of the pitch, resolved across by the package itself."""
    strips, half_width = int(log_uniform(random, 12, 61)), log_uniform(random, 0.0005, 0.005)
    case = single(random, str(random.choice(CONVEX)), strips, ("k",), half_width)
    unit = replace(case.unit, width=0.9 * case.unit.pitch, contact_lambda=0.25 * case.unit.pitch)
    ideal = ts.simulate(replace(unit, bits=None).sensor, ts.Contact.polygon(case.outlines[0]))["k"][None]
    read = ideal + white(ideal.shape, half_width, case.distribution, random)
    return replace(case, unit=unit, read=read)


def filled(unit: Unit, outline: Array) -> Array:
    """Return an outline filled along the strips: all that readings can tell of it."""
    fine = replace(unit, strips=32 * unit.strips, pitch=unit.pitch / 32)
    low, high = fine.touched([outline])
    on = np.isfinite(low)
    lower, upper = (np.column_stack([fine.x[on], y[on]]) for y in (low, high))
    return np.concatenate([lower, upper[::-1]])


def pairs(random: np.random.Generator) -> Case:
    """Draw two convex shapes on shared strips, or, one time in three, a concave one."""
    strips = int(_choose(random, {10: 0.25, 20: 0.35, int(log_uniform(random, 8, 101)): 0.4}))
    half_width = log_uniform(random, 0.0005, 0.02)
    names = _choose(random, {("kh", "kl"): 0.6, ("k",): 0.2, ("kh",): 0.1, ("kl",): 0.1})
    if random.random() < 1 / 3:
        return single(random, str(random.choice(CONCAVE)), strips, names, half_width)
    return pair(random, strips, names, half_width)


def pair(random: np.random.Generator, strips: int, names: tuple[str, ...], half_width: float) -> Case:
    """Draw two convex shapes apart that share two strips or more."""
    while True:
        unit = _unit(random, names, strips, strips, random.uniform(0.6, 1.6) * strips)
        size = np.array([unit.x[-1], unit.length])
        for _ in range(_TURNS):
            outlines = []
            for _ in range(2):
                outline = draw(str(random.choice([*PLAIN, "rounded"])), random)
                outline = outline * (random.uniform(0.2, 0.8) * size / np.ptp(outline, axis=0)).min()
                room = size - np.ptp(outline, axis=0)
                outlines.append(outline - outline.min(axis=0) + random.uniform(0.01, 0.99, 2) * room)
            a, b = (np.isfinite(unit.touched([outline])[0]) for outline in outlines)
            apart = shapely.Polygon(outlines[0]).distance(shapely.Polygon(outlines[1]))
            if min(a.sum(), b.sum()) >= 3 and (a & b).sum() >= 2 and apart > 0.02 * unit.length:
                return _noisy(random, "pair", unit, outlines, half_width)


def beside(random: np.random.Generator) -> Case:
    """Draw two convex shapes beside each other, or, one time in three, a concave one, often with a waist."""
    strips, half_width = int(random.integers(8, 25)), log_uniform(random, 0.002, 0.01)
    names = _choose(random, {("kh", "kl"): 0.7, ("k",): 0.1, ("kh",): 0.1, ("kl",): 0.1})
    if random.random() < 1 / 3:
        return single(random, str(random.choice([*CONCAVE, *WAISTED, *WAISTED])), strips, names, half_width)
    return neighbours(random, strips, names, half_width)


def concave(random: np.random.Generator) -> Case:
    """Draw one of `concave.FAMILIES` on 12 to 40 strips, read by both signatures; of a quarter errors correlate.

    What is told of the noise is its size alone.
    """
    strips, half_width = int(log_uniform(random, 12, 41)), log_uniform(random, 0.001, 0.01)
    family = str(random.choice(concave_shapes.FAMILIES))
    case = single(random, family, strips, ("kh", "kl"), half_width)
    if random.random() < 0.25:
        ideal = case.unit.read(case.low, case.high)
        error, kept = random.normal(0.0, half_width / np.sqrt(3.0), ideal.shape), _CORRELATED
        for i in range(1, error.shape[1]):
            error[:, i] = kept * error[:, i - 1] + np.sqrt(1.0 - kept**2) * error[:, i]
        case = replace(case, read=ideal + error, distribution="normal")
    return case


def neighbours(random: np.random.Generator, strips: int, names: tuple[str, ...], half_width: float) -> Case:
    """Draw two convex shapes that share none to three of about so many strips, with no untouched one between.

    They lie apart by any distance along the strips, or, one time in four, nearly touch.
    """
    shared, nearly = int(random.integers(4)), random.random() < 0.25
    while True:
        unit = _unit(random, names, strips + 2, strips + 2, random.uniform(0.4, 1.2) * strips)
        left, right = _two_across(random, unit, strips, shared)
        if nearly:
            right = _nearer(left, right, 0.002 * unit.length)
        if right[:, 0].max() > unit.strips * unit.pitch:
            continue
        outlines = [left, right]
        if random.random() < 0.5:
            outlines = [
                outline * [-1.0, 1.0] + np.array([unit.strips * unit.pitch, 0.0]) for outline in outlines
            ]
        a, b = (np.isfinite(unit.touched([outline])[0]) for outline in outlines)
        inside = all(o[:, 1].min() > 0.0 and o[:, 1].max() < unit.length for o in outlines)
        apart = shapely.Polygon(left).distance(shapely.Polygon(right)) > 0.0
        if not inside or not apart or min(a.sum(), b.sum()) < 3 or (a & b).sum() != shared:
            continue
        if np.ptp(np.flatnonzero(a | b)) == (a | b).sum() - 1:
            return _noisy(random, "pair", unit, outlines, half_width)


def _two_across(random: np.random.Generator, unit: Unit, strips: int, shared: int) -> tuple[Array, Array]:
    """Return two convex outlines that cross about so many strips together, and `shared` of these both."""
    first = random.uniform(0.25, 0.75) * (strips + shared)
    outlines = []
    for across in (first, strips + shared - first):
        outline = draw(str(random.choice([*PLAIN, "rounded"])), random)
        outline = (outline - outline.min(axis=0)) * across * unit.pitch / np.ptp(outline[:, 0])
        outline *= [1.0, min(1.0, 0.9 * unit.length / np.ptp(outline[:, 1]))]
        outline[:, 1] += random.random() * (unit.length - np.ptp(outline[:, 1]))
        outlines.append(outline)
    left, right = outlines
    left[:, 0] += random.uniform(0.0, 2.0) * unit.pitch
    right[:, 0] += left[:, 0].max() - (shared - random.uniform(0.0, 1.0)) * unit.pitch
    return left, right


def _nearer(fixed: Array, moved: Array, least: float) -> Array:
    """Return an outline moved along the strips to within `least` of another, where they meet."""
    at = moved.copy()
    for _ in range(_NEARER):
        distance = shapely.Polygon(fixed).distance(shapely.Polygon(at))
        if distance <= least:
            break
        at[:, 1] += np.sign(fixed[:, 1].mean() - at[:, 1].mean()) * 0.7 * max(distance, least)
    return at


def channels(random: np.random.Generator) -> Case:
    """Draw a convex shape on most of ten strips."""
    names = _choose(random, {("kh", "kl"): 0.7, ("k",): 0.3})
    return single(
        random,
        str(random.choice(PLAIN)),
        int(random.integers(7, 11)),
        names,
        log_uniform(random, 0.0005, 0.01),
        10,
    )


def regions(random: np.random.Generator, strips: tuple[int, int] = (12, 101)) -> Case:
    """Draw a plain shape whose noise is told."""
    case = single(
        random,
        str(random.choice(PLAIN)),
        int(log_uniform(random, *strips)),
        _some_names(random),
        log_uniform(random, 0.001, 0.01),
    )
    return replace(case, told=True, weakest=weakest_corner(case.unit, case.outlines[0], case.half_width))


def single(
    random: np.random.Generator,
    category: str,
    strips: int,
    names: tuple[str, ...],
    half_width: float,
    of: int | None = None,
) -> Case:
    """Draw one shape on about `strips` strips, of a sensor with so many where `of` says it."""
    while True:
        outline = (concave_shapes.draw if category in concave_shapes.FAMILIES else draw)(category, random)
        across, along = np.ptp(outline, axis=0)
        outside = random.uniform(0.1, 0.5) if category.startswith("over") else 0.0
        extent = strips - random.uniform(0.1, 0.9)  # in pitches
        extent /= 1.0 - outside if category == "over left or right" else 1.0
        unit = _unit(
            random,
            names,
            strips,
            of or strips + int(random.integers(0, strips // 2 + 3)),
            along / across * extent,
        )
        outline = (outline - outline.min(axis=0)) * extent * unit.pitch / across
        room = np.array([unit.strips * unit.pitch, unit.length]) - np.ptp(outline, axis=0)
        place = random.uniform(0.02, 0.98, 2) * room
        if outside:
            axis = int(category == "over top or bottom")
            over = outside * np.ptp(outline, axis=0)[axis]
            place[axis] = random.choice([-over, room[axis] + over])
        outline = outline + place
        weakest = np.inf
        if category == "weak corner":
            weakest = random.uniform(0.5, 8.0)
            outline = _with_weak_corner(random, unit, outline, unit.sigma(half_width), weakest)
        if len(outline) and np.isfinite(unit.touched([outline])[0]).sum() >= min(strips, 6):
            return replace(_noisy(random, category, unit, [outline], half_width), weakest=weakest)


def log_uniform(random: np.random.Generator, low: float, high: float) -> float:
    """Draw a number whose logarithm is uniform."""
    return float(np.exp(random.uniform(np.log(low), np.log(high))))


def weakest_corner(unit: Unit, outline: Array, half_width: float) -> float:
    """Return by how many deviations the readings miss the weakest corner between the ends; inf: too few corners."""
    if not 4 <= len(outline) <= 20:
        return np.inf
    ends = {int(outline[:, 0].argmin()), int(outline[:, 0].argmax())}
    corners = [i for i in range(len(outline)) if i not in ends]
    sigma = unit.sigma(half_width)
    return min(_strength(unit, np.delete(outline, i, axis=0), outline) for i in corners) / sigma


def _strength(unit: Unit, without: Array, outline: Array) -> float:
    """Return the part of a corner's effect that no small move of the others brings about: a norm [Vref]."""
    at = unit.read(*unit.touched([without]))
    step = 1e-5 * float(np.ptp(without))
    moves = np.eye(without.size).reshape(-1, *without.shape)
    slopes = [(unit.read(*unit.touched([without + step * m])) - at).ravel() / step for m in moves]
    effect = (unit.read(*unit.touched([outline])) - at).ravel()
    matrix = np.nan_to_num(np.column_stack(slopes)[np.isfinite(effect)])
    effect = effect[np.isfinite(effect)]
    return float(np.linalg.norm(effect - matrix @ np.linalg.lstsq(matrix, effect, rcond=1e-9)[0]))


def _with_weak_corner(
    random: np.random.Generator, unit: Unit, outline: Array, sigma: float, deviations: float
) -> Array:
    """Return the outline with one more corner that shows by so many deviations; (0, 2) where it takes none."""
    for edge in random.permutation(len(outline)):
        a, b = outline[edge], outline[(edge + 1) % len(outline)]
        outward = np.array([b[1] - a[1], a[0] - b[0]])
        foot, height = a + random.uniform(0.25, 0.75) * (b - a), 1e-3
        for _ in range(4):
            corner = np.insert(outline, edge + 1, foot + height * outward, axis=0)
            if not is_convex(corner) or not 0.0 < corner[edge + 1, 1] < unit.length:
                break
            if (strength := _strength(unit, outline, corner)) <= 0.0:
                break
            if abs(strength / sigma / deviations - 1.0) < 0.02:
                return corner
            height *= deviations * sigma / strength
    return np.empty((0, 2))


def _unit(random: np.random.Generator, names: tuple[str, ...], strips: int, of: int, height: float) -> Unit:
    """Draw a unit on which a shape `height` pitches high fits along the strips."""
    pitch = log_uniform(random, 0.8, 8.0)
    length = height * pitch / log_uniform(random, min(0.85, max(0.08, height / (6.0 * strips))), 0.9)
    decay = random.choice([0.0, min(random.uniform(1.0, 4.0), 0.05 * length)])
    ratio = 1.0 if random.random() < 0.7 else random.uniform(0.5, 2.0)
    bits = 12 if random.random() < 1 / 3 else None
    return Unit(names, of, pitch, length, float(decay), ratio, bits)


def _noisy(
    random: np.random.Generator, group: str, unit: Unit, outlines: Sequence[Array], half_width: float
) -> Case:
    low, high = unit.touched(outlines)
    kind = str(random.choice(["uniform", "normal"]))
    ideal = unit.read(low, high)
    read = ideal + white(ideal.shape, half_width, kind, random)
    return Case(group, unit, list(outlines), low, high, read, half_width, kind, bool(random.random() < 0.5))


def _half_width(random: np.random.Generator) -> float:
    return 0.02 if random.random() < 0.2 else log_uniform(random, 0.0005, 0.01)


def _some_names(random: np.random.Generator) -> tuple[str, ...]:
    return _choose(random, {("kh", "kl"): 0.45, ("kh",): 0.2, ("kl",): 0.15, ("k",): 0.2})


def _choose(random: np.random.Generator, shares: dict[_T, float]) -> _T:
    weights = np.array(list(shares.values()))
    return list(shares)[random.choice(len(shares), p=weights / weights.sum())]
