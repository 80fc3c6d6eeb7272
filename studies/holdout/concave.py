"""Concave outlines as people draw them: sides, thicknesses and pose at random, none a family of `shapes.CONCAVE`."""

from __future__ import annotations

import numpy as np
import shapely

from studies.holdout.shapes import Array, turned

FAMILIES = (
    *("angle", "tee", "channel", "arrow", "cross"),
    *("bean", "moon", "arrowhead", "burst", "keyhole"),
)
_UPRIGHT = 0.2  # how often it lies along the strips
_HOLLOW = 1.03  # area of the convex hull over its own, at least


def draw(family: str, random: np.random.Generator) -> Array:
    """Return an outline of `FAMILIES` (N, 2), about 1 in size, in any pose."""
    while True:
        shape = _drawn(family, random)
        whole = shape.geom_type == "Polygon" and shape.is_valid and not shape.interiors
        if whole and shape.convex_hull.area > _HOLLOW * shape.area:
            break
    turn = random.uniform(0.0, 2.0 * np.pi)
    if random.random() < _UPRIGHT:
        turn = 0.5 * np.pi * float(random.integers(4))
    mirrored = np.array(shape.exterior.coords)[:-1] * [random.choice([-1.0, 1.0]), 1.0]
    return turned(mirrored, turn)


def _drawn(family: str, random: np.random.Generator) -> shapely.Geometry:
    wide, high = 1.0, random.uniform(0.6, 1.6)
    a, b, c = random.uniform(0.2, 0.5, 3)
    box = shapely.box
    match family:
        case "angle":  # two arms of a corner
            return shapely.union_all([box(0, 0, wide, a * high), box(0, 0, b, high)])
        case "tee":
            at = random.uniform(0.0, 1.0 - a)
            return shapely.union_all([box(0, high * (1.0 - b), wide, high), box(at, 0, at + a, high)])
        case "channel":  # two arms and a web
            arms = [box(0, 0, 0.8 * a, high), box(1.0 - 0.8 * b, 0, wide, random.uniform(0.6, 1.0) * high)]
            return shapely.union_all([*arms, box(0, 0, wide, c * high)])
        case "cross":
            across, up = random.uniform(0.0, 1.0 - 0.8 * a), random.uniform(0.0, 1.0 - 0.8 * b)
            bars = box(across, 0, across + 0.8 * a, high), box(0, up * high, wide, (up + 0.8 * b) * high)
            return shapely.union_all(bars)
        case "arrow":
            head, shaft = random.uniform(0.3, 0.6), 0.5 * a
            tip = shapely.Polygon([(1.0 - head, -0.5 * high), (1.0, 0.0), (1.0 - head, 0.5 * high)])
            return shapely.union(tip, box(0, -0.5 * shaft * high, 1.0 - head, 0.5 * shaft * high))
        case "arrowhead":
            notch, off = random.uniform(0.15, 0.6), random.uniform(-0.25, 0.25)
            return shapely.Polygon([(0, -0.5 * high), (1, off), (0, 0.5 * high), (notch, off)])
        case "bean":
            angle = 2.0 * np.pi * np.arange(144) / 144
            waves = (random.normal() / n**1.5 * np.cos(n * angle + random.uniform(0, 7)) for n in (2, 3, 4))
            reach = np.maximum(1.0 + 0.3 * sum(waves), 0.2)
            return shapely.Polygon(reach[:, None] * np.column_stack([np.cos(angle), high * np.sin(angle)]))
        case "moon":
            bite = shapely.Point(random.uniform(0.5, 1.1), random.uniform(-0.3, 0.3))
            return shapely.Point(0, 0).buffer(1.0, 48) - bite.buffer(random.uniform(0.5, 1.0), 48)
        case "burst":
            n = 2 * int(random.integers(4, 8))
            angle = 2.0 * np.pi * (np.arange(n) + random.uniform(-0.25, 0.25, n)) / n
            reach = np.where(np.arange(n) % 2, random.uniform(0.4, 0.75), 1.0) * random.uniform(0.85, 1.0, n)
            return shapely.Polygon(reach[:, None] * np.column_stack([np.cos(angle), high * np.sin(angle)]))
        case "keyhole":  # a disc on a wedge
            disc = shapely.Point(0, 0).buffer(0.5, 48)
            wedge = [(-0.4 * a, 0), (0.4 * a, 0), (b, -1.2 * high), (-b, -1.2 * high)]
            return shapely.union(disc, shapely.Polygon(wedge))
        case _:
            raise ValueError(family)
