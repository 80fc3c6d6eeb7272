"""Outlines (N, 2), counter-clockwise, of any size and place: convex, rounded, concave, and what others draw."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt
import shapely

Array: TypeAlias = npt.NDArray[np.float64]

PLAIN = ("hull", "triangle", "upright rectangle", "rotated rectangle", "trapezoid", "ellipse")
CONVEX = (
    *PLAIN,
    "weak corner",
    "one upright side",
    "over left or right",
    "over top or bottom",
    "rounded",
    "circle",
)
ROUNDED = (
    "superellipse",
    "stadium",
    "egg",
    "Reuleaux",
    "segment",
    "lens",
    "teardrop",
    "rounded triangle",
    "rounded pentagon",
)
CONCAVE = ("L", "dart", "star", "notched", "crescent")
UNUSUAL = ("letter", "touching", "bowed", "bar")
WAISTED = ("hourglass", "joined")  # narrow in the middle, where two objects beside each other meet
# Boxes (left, bottom, right, top) that letters are made of.
_LETTERS = (
    ((0.0, 0.75, 1.0, 1.0), (0.35, 0.0, 0.65, 1.0)),  # T
    ((0.0, 0.0, 0.3, 1.0), (0.7, 0.0, 1.0, 1.0), (0.0, 0.35, 1.0, 0.65)),  # H
    ((0.0, 0.0, 0.3, 1.0), (0.7, 0.0, 1.0, 1.0), (0.0, 0.0, 1.0, 0.3)),  # U
    ((0.0, 0.0, 0.3, 1.0), (0.0, 0.0, 0.8, 0.2), (0.0, 0.4, 0.8, 0.6), (0.0, 0.8, 0.8, 1.0)),  # E
    ((0.0, 0.0, 0.65, 0.4), (0.35, 0.3, 0.65, 0.7), (0.35, 0.6, 1.0, 1.0)),  # Z
    ((0.35, 0.0, 0.65, 1.0), (0.0, 0.35, 1.0, 0.65)),  # a plus
)
_LEAST_FILL = 0.25  # of the bounding box: no slivers


def draw(category: str, random: np.random.Generator) -> Array:
    """Return an outline of a category of `CONVEX`, `ROUNDED`, `CONCAVE` or `UNUSUAL`, about 1 in size.

    A weak corner is added, and a border crossed, once the sensor is known: here these are hulls, or plain shapes.
    """
    of_family = _rounded if category in ROUNDED else _unusual if category in UNUSUAL else _draw
    while True:
        outline = counter_clockwise(of_family(category, random))
        if category == "bar" or shapely.Polygon(outline).area > _LEAST_FILL * float(
            np.prod(np.ptp(outline, axis=0))
        ):
            return outline


def _draw(category: str, random: np.random.Generator) -> Array:
    if category.startswith("over"):
        return _draw(str(random.choice(PLAIN)), random)
    height = np.exp(random.uniform(-1.0, 0.7))
    turn = random.uniform(0.06, 0.5 * np.pi - 0.06)
    of_family = _concave if category in CONCAVE else _waisted if category in WAISTED else _convex
    return of_family(category, random, height, turn)


def _rectangle(height: float) -> Array:
    return np.array([(0.0, 0.0), (1.0, 0.0), (1.0, height), (0.0, height)])


def _convex(category: str, random: np.random.Generator, height: float, turn: float) -> Array:
    rectangle = _rectangle(height)
    match category:
        case "triangle":
            return random.normal(size=(3, 2))
        case "upright rectangle":
            return rectangle
        case "rotated rectangle":
            return turned(rectangle, turn)
        case "trapezoid":
            top = random.uniform(0.15, 0.85)
            rectangle[2:, 0] = random.uniform(-0.3, 1.3 - top) + np.array([top, 0.0])
            return turned(rectangle, random.choice([0.0, 0.5 * np.pi, np.pi, 4.0 * turn]))
        case "one upright side":
            outline = _hull(random)
            low, high = outline[:, 0].min(), outline[:, 0].max()
            cut = low + random.uniform(0.15, 0.5) * (high - low)
            kept = np.array(
                shapely.clip_by_rect(shapely.Polygon(outline), cut, -9.0, 9.0, 9.0).exterior.coords
            )[:-1]
            return np.asarray(kept * [random.choice([-1.0, 1.0]), 1.0])
        case "rounded":
            radius = random.uniform(0.1, 0.45) * min(1.0, height)
            core = shapely.Polygon(rectangle).buffer(-radius).buffer(radius, quad_segs=24)
            return turned(np.array(core.exterior.coords)[:-1], random.choice([0.0, turn]))
        case "ellipse" | "circle":
            angle = 2.0 * np.pi * np.arange(256) / 256
            height = 1.0 if category == "circle" else height
            return turned(np.column_stack([np.cos(angle), height * np.sin(angle)]), turn)
        case _:
            return _hull(random)


def _concave(category: str, random: np.random.Generator, height: float, turn: float) -> Array:
    rectangle = _rectangle(height)
    match category:
        case "L":
            a, b = random.uniform(0.25, 0.65, 2)
            return turned(
                np.array([(0, 0), (1, 0), (1, a * height), (b, a * height), (b, height), (0, height)]),
                4.0 * turn,
            )
        case "dart":
            return turned(np.array([(0, 0), (random.uniform(0.2, 0.6), 0.5), (0, 1), (1.2, 0.5)]), 4.0 * turn)
        case "star":
            points = np.pi * np.arange(10) / 5.0 + turn
            reach = np.where(np.arange(10) % 2, random.uniform(0.4, 0.7), 1.0)[:, None]
            return np.asarray(reach * np.column_stack([np.cos(points), np.sin(points)]))
        case "notched":
            at, deep = random.uniform(0.35, 0.65), random.uniform(0.3, 0.7)
            notch = [(at + 0.2, height), (at, (1.0 - deep) * height), (at - 0.2, height)]
            return turned(np.vstack([rectangle[:3], notch, rectangle[3:]]), 4.0 * turn)
        case _:
            disc, bite = (
                shapely.Point(0, 0).buffer(1.0, 48),
                shapely.Point(random.uniform(0.5, 0.9), 0).buffer(0.8, 48),
            )
            return turned(np.array(disc.difference(bite).exterior.coords)[:-1], 4.0 * turn)


def _waisted(category: str, random: np.random.Generator, height: float, turn: float) -> Array:
    if category == "hourglass":
        deep = random.uniform(0.1, 0.45, 2) * height
        (low, high), wide = random.uniform(0.3, 0.7, 2), random.uniform(0.1, 0.3, 2)
        below = [(low - wide[0], 0.0), (low, deep[0]), (low + wide[0], 0.0)]
        above = [(high + wide[1], height), (high, height - deep[1]), (high - wide[1], height)]
        corners = _rectangle(height)
        return turned(np.vstack([corners[:1], below, corners[1:3], above, corners[3:]]), 4.0 * turn)
    first, second = (_draw(str(random.choice(PLAIN)), random) for _ in range(2))
    second = second * random.uniform(0.5, 1.0) * np.ptp(first) / np.ptp(second)
    along = turned(np.array([[1.0, 0.0]]), 4.0 * turn)[0]
    off = (first @ along).max() - (second @ along).min() - random.uniform(0.02, 0.3) * np.ptp(first)
    side = np.array([-along[1], along[0]])
    off_side = (first @ side).mean() - (second @ side).mean() + random.uniform(-0.3, 0.3) * np.ptp(first)
    both = [shapely.Polygon(o) for o in (first, second + off * along + off_side * side)]
    whole = shapely.union_all([o.buffer(0.0) for o in both])
    if whole.geom_type != "Polygon":
        return _draw(category, random)
    return np.array(whole.exterior.coords)[:-1]


def _rounded(category: str, random: np.random.Generator) -> Array:
    """Return what people press: thumbs, caps, erasers, half coins."""
    angle = 2.0 * np.pi * np.arange(192) / 192
    c, s = np.cos(angle), np.sin(angle)
    flat = np.exp(random.uniform(-1.0, 0.0))
    match category:
        case "superellipse":
            power = 2.0 / random.uniform(2.1, 3.0)
            outline = np.column_stack(
                [np.sign(c) * np.abs(c) ** power, flat * np.sign(s) * np.abs(s) ** power]
            )
        case "stadium":
            core = shapely.LineString([(0.0, 0.0), (random.uniform(0.3, 2.0), 0.0)])
            outline = np.array(core.buffer(0.5, quad_segs=48).exterior.coords)[:-1]
        case "egg":
            outline = np.column_stack([c, flat * s * (1.0 + random.uniform(0.1, 0.4) * c)])
        case "Reuleaux":
            corners = [shapely.Point(np.cos(a), np.sin(a)) for a in 2.0 * np.pi * np.arange(3) / 3]
            inner, radius = random.uniform(0.0, 0.4), np.sqrt(3.0)
            discs = [corner.buffer(radius - inner, quad_segs=64) for corner in corners]
            shape = shapely.intersection_all(discs).buffer(inner, quad_segs=24)
            outline = np.array(shape.exterior.coords)[:-1]
        case "segment":
            disc = shapely.Point(0.0, 0.0).buffer(1.0, quad_segs=64)
            part = shapely.clip_by_rect(disc, random.uniform(-0.6, 0.4), -2.0, 2.0, 2.0)
            outline = np.array(part.exterior.coords)[:-1]
        case "lens":
            off = random.uniform(0.3, 0.7)
            discs = [shapely.Point(side * off, 0.0).buffer(1.0, quad_segs=64) for side in (-1.0, 1.0)]
            outline = np.array(shapely.intersection_all(discs).exterior.coords)[:-1]
        case "teardrop":
            disc = shapely.Point(0.0, 0.0).buffer(0.5, quad_segs=48)
            tip = shapely.Point(random.uniform(0.7, 1.3), 0.0)
            outline = np.array(shapely.union(disc, tip).convex_hull.exterior.coords)[:-1]
        case _:
            count = 3 if category == "rounded triangle" else 5
            at = 2.0 * np.pi * (np.arange(count) + random.uniform(-0.25, 0.25, count)) / count
            core = shapely.Polygon(np.column_stack([np.cos(at), flat * np.sin(at)]))
            outline = np.array(core.buffer(random.uniform(0.1, 0.6) * flat, quad_segs=24).exterior.coords)[
                :-1
            ]
    return turned(outline, random.uniform(0.0, 2.0 * np.pi) if random.random() < 0.7 else 0.0)


def _unusual(category: str, random: np.random.Generator) -> Array:
    """Return what others draw first."""
    turn, first = random.uniform(0.0, 2.0 * np.pi), _draw(str(random.choice(PLAIN)), random)
    match category:
        case "letter":
            boxes = _LETTERS[random.integers(len(_LETTERS))]
            outline = np.array(shapely.union_all([shapely.box(*box) for box in boxes]).exterior.coords)[:-1]
            turn = 0.5 * np.pi * random.integers(4) if random.random() < 0.5 else turn
            return turned(outline * [1.0, random.uniform(0.7, 1.5)], turn)
        case "touching":  # the middle of a second one lies on the first one's edge
            second = _draw(str(random.choice(PLAIN)), random)
            at = shapely.Polygon(first).exterior.interpolate(random.random(), normalized=True)
            size = random.uniform(0.3, 1.0) * np.ptp(first, axis=0).min() / np.ptp(second, axis=0).max()
            both = size * (second - second.mean(axis=0)) + np.array([at.x, at.y]), first
            return np.array(shapely.union_all([shapely.Polygon(o) for o in both]).exterior.coords)[:-1]
        case "bowed":  # edges are arcs, outward or, fewer, inward
            corners = counter_clockwise(_draw(str(random.choice(["triangle", "trapezoid"])), random))
            along, edge = np.arange(16)[:, None] / 16, np.roll(corners, -1, axis=0) - corners
            bow = random.uniform(-0.06, 0.1, (len(corners), 1)) * np.stack([edge[:, 1], -edge[:, 0]], axis=1)
            arcs = corners[:, None] + along * edge[:, None] + 4.0 * along * (1.0 - along) * bow[:, None]
            return arcs.reshape(-1, 2)
        case _:
            thin = np.exp(random.uniform(np.log(0.02), np.log(0.2)))
            return turned(np.array([(0.0, 0.0), (1.0, 0.0), (1.0, thin), (0.0, thin)]), turn)


def _hull(random: np.random.Generator) -> Array:
    points = random.normal(size=(random.integers(4, 13), 2)) * [1.0, np.exp(random.uniform(-0.7, 0.7))]
    return np.array(
        shapely.MultiPoint(turned(points, random.uniform(0.0, np.pi))).convex_hull.exterior.coords
    )[:-1]


def turned(outline: Array, angle: float) -> Array:
    """Return it turned counter-clockwise [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    return np.asarray(outline @ np.array([[c, s], [-s, c]]))


def counter_clockwise(outline: Array) -> Array:
    """Return it in counter-clockwise order."""
    x, y = outline.T
    return outline if x @ np.roll(y, -1) > y @ np.roll(x, -1) else outline[::-1]


def is_convex(outline: Array) -> bool:
    """Whether a counter-clockwise outline turns left at every corner."""
    step = np.roll(outline, -1, axis=0) - outline
    following = np.roll(step, -1, axis=0)
    return bool((step[:, 0] * following[:, 1] > step[:, 1] * following[:, 0]).all())
