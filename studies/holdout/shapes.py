"""Outlines (N, 2), counter-clockwise, of any size and place: convex in twelve categories, and concave."""

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
CONCAVE = ("L", "dart", "star", "notched", "crescent")
_LEAST_FILL = 0.25  # of the bounding box: no slivers


def draw(category: str, random: np.random.Generator) -> Array:
    """Return an outline of a category of `CONVEX` or `CONCAVE`, about 1 in size.

    A weak corner is added, and a border crossed, once the sensor is known: here these are hulls, or plain shapes.
    """
    while True:
        outline = counter_clockwise(_draw(category, random))
        if shapely.Polygon(outline).area > _LEAST_FILL * float(np.prod(np.ptp(outline, axis=0))):
            return outline


def _draw(category: str, random: np.random.Generator) -> Array:
    if category.startswith("over"):
        return _draw(str(random.choice(PLAIN)), random)
    height = np.exp(random.uniform(-1.0, 0.7))
    turn = random.uniform(0.06, 0.5 * np.pi - 0.06)
    rectangle = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, height), (0.0, height)])
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
        case "crescent":
            disc, bite = (
                shapely.Point(0, 0).buffer(1.0, 48),
                shapely.Point(random.uniform(0.5, 0.9), 0).buffer(0.8, 48),
            )
            return turned(np.array(disc.difference(bite).exterior.coords)[:-1], 4.0 * turn)
        case _:
            return _hull(random)


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
