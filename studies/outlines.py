"""Contacts of many kinds, on sensors of any number of strips: what estimates and their confidence are tuned on.

Drawn apart from the package: outlines are Shapely polygons, scaled to the sensor and put on it or over a border.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import affinity

import tacstrip as ts

Draw = Callable[[np.random.Generator], shapely.Polygon]
KINDS: dict[str, Draw] = {}


def _kind(function: Draw) -> Draw:
    KINDS[function.__name__.strip("_").replace("_", " ")] = function
    return function


def _ring(random: np.random.Generator, count: int, least: float = 0.25) -> shapely.Polygon:
    """Return a convex polygon about the origin with corners on an ellipse, turned anyhow."""
    while True:
        angle = np.sort(random.uniform(0.0, 2.0 * np.pi, count))
        gaps = np.diff(angle, append=angle[0] + 2.0 * np.pi)
        if gaps.min() > least and gaps.max() < 2.7:
            break
    flat = random.uniform(0.45, 1.0)
    ring = shapely.Polygon(np.stack([np.cos(angle), flat * np.sin(angle)], axis=1))
    return affinity.rotate(ring, random.uniform(0.0, 360.0), origin=(0, 0))


@_kind
def _polygon(random: np.random.Generator) -> shapely.Polygon:
    return _ring(random, int(random.integers(3, 8)))


@_kind
def _weak_corners(random: np.random.Generator) -> shapely.Polygon:
    """Return a polygon with one or two corners that hardly turn."""
    points = list(shapely.get_coordinates(_ring(random, int(random.integers(3, 6))).exterior)[:-1])
    for _ in range(int(random.integers(1, 3))):
        i = int(random.integers(len(points)))
        a, b = points[i], points[(i + 1) % len(points)]
        normal = np.array([b[1] - a[1], a[0] - b[0]])
        turn = random.uniform(0.01, 0.08)
        points.insert(i + 1, a + (b - a) * random.uniform(0.25, 0.75) + normal * turn)
    return shapely.MultiPoint(points).convex_hull


@_kind
def _upright_one(random: np.random.Generator) -> shapely.Polygon:
    """Return a polygon with one end upright, the other one pointed."""
    h, side = random.uniform(0.2, 1.0), random.choice([-1.0, 1.0])
    points = [(-1.0, -h), (-1.0, h), (1.0, random.uniform(-0.6, 0.6))]
    points += [
        (random.uniform(-0.5, 0.7), s * random.uniform(0.6, 1.2))
        for s in (-1.0, 1.0)
        if random.random() < 0.6
    ]
    return affinity.scale(shapely.MultiPoint(points).convex_hull, side, 1.0, origin=(0, 0))


@_kind
def _upright_both(random: np.random.Generator) -> shapely.Polygon:
    a, b, s, t = *random.uniform(0.2, 1.0, 2), *random.uniform(-0.4, 0.4, 2)
    return shapely.Polygon([(-1, s - a), (1, t - b), (1, t + b), (-1, s + a)])


@_kind
def _rectangle(random: np.random.Generator) -> shapely.Polygon:
    box = shapely.box(-1, -(h := random.uniform(0.25, 1.0)), 1, h)
    return affinity.rotate(box, random.uniform(0.0, 90.0) if random.random() < 0.5 else 0.0)


@_kind
def _over_left_or_right(random: np.random.Generator) -> shapely.Polygon:
    return _ring(random, int(random.integers(3, 7)))


@_kind
def _over_top_or_bottom(random: np.random.Generator) -> shapely.Polygon:
    return _ring(random, int(random.integers(3, 7)))


@_kind
def _rounded(random: np.random.Generator) -> shapely.Polygon:
    core = affinity.scale(_ring(random, int(random.integers(3, 6))), 0.8, 0.8)
    return core.buffer(random.uniform(0.05, 0.3), quad_segs=16)


@_kind
def _circle(random: np.random.Generator) -> shapely.Polygon:
    del random
    return shapely.Point(0, 0).buffer(1.0, quad_segs=45)


@_kind
def _ellipse(random: np.random.Generator) -> shapely.Polygon:
    oval = affinity.scale(shapely.Point(0, 0).buffer(1.0, quad_segs=45), 1.0, random.uniform(0.35, 0.9))
    return affinity.rotate(oval, random.uniform(0.0, 180.0))


@_kind
def _rounded_rectangle(random: np.random.Generator) -> shapely.Polygon:
    """Return a rectangle with corners rounded up to a stadium, upright or turned."""
    h = random.uniform(0.3, 1.0)
    r = h * random.choice([1.0 - 1e-6, random.uniform(0.1, 0.9)], p=[0.2, 0.8])
    box = shapely.box(r - 1, r - h, 1 - r, h - r).buffer(r, quad_segs=16)
    return affinity.rotate(box, random.choice([0.0, 90.0, random.uniform(0.0, 180.0)]))


@_kind
def _superellipse(random: np.random.Generator) -> shapely.Polygon:
    t, power = 2.0 * np.pi * np.arange(120) / 120, 2.0 / random.uniform(1.4, 6.0)
    x, y = (np.sign(v) * np.abs(v) ** power for v in (np.cos(t), np.sin(t)))
    return affinity.rotate(
        shapely.Polygon(np.stack([x, random.uniform(0.4, 1.0) * y], axis=1)),
        random.choice([0.0, random.uniform(0.0, 90.0)]),
    )


@_kind
def _cut_oval(random: np.random.Generator) -> shapely.Polygon:
    """Return what one straight cut leaves of an oval: a D, or nearly all of it."""
    part = _ellipse(random).intersection(shapely.box(-2, -2, random.uniform(-0.2, 0.9), 2))
    return affinity.rotate(part, random.choice([0.0, 90.0, 180.0, 270.0, random.uniform(0.0, 360.0)]))


@_kind
def _hull(random: np.random.Generator) -> shapely.Polygon:
    while True:
        found = shapely.MultiPoint(random.normal(size=(int(random.integers(4, 16)), 2))).convex_hull
        if found.area > 0.3 * found.envelope.area:
            return found


@_kind
def _many_corners(random: np.random.Generator) -> shapely.Polygon:
    return _ring(random, int(random.integers(8, 13)), 0.1)


@_kind
def _concave(random: np.random.Generator) -> shapely.Polygon:
    """Return a polygon with a notch, an L, a T or a star."""
    way = random.integers(4)
    if way == 0:
        ring = _ring(random, int(random.integers(4, 7)))
        p = shapely.get_coordinates(ring.exterior)[:-1]
        i = int(random.integers(len(p)))
        mid = 0.5 * (p[i] + p[(i + 1) % len(p)]) * random.uniform(0.1, 0.6)
        return shapely.Polygon(np.insert(p, i + 1, mid, axis=0))
    if way == 1:
        a, b = random.uniform(0.3, 0.9, 2)
        shape = shapely.Polygon([(-1, -1), (1, -1), (1, a - 1), (b - 1, a - 1), (b - 1, 1), (-1, 1)])
    elif way == 2:
        a, b = random.uniform(0.2, 0.6, 2)
        shape = shapely.Polygon(
            [(-1, 1 - a), (-b, 1 - a), (-b, -1), (b, -1), (b, 1 - a), (1, 1 - a), (1, 1), (-1, 1)]
        )
    else:
        t = np.arange(10) * math.pi / 5.0
        r = np.where(np.arange(10) % 2, random.uniform(0.4, 0.7), 1.0)
        shape = shapely.Polygon(np.stack([r * np.cos(t), r * np.sin(t)], axis=1))
    return affinity.rotate(shape, random.uniform(0.0, 360.0))


@_kind
def _pair(random: np.random.Generator) -> shapely.Polygon:
    """Refuse: two polygons that share strips are placed by `case`."""
    del random
    raise NotImplementedError


AS_DRAWN = ("rounded rectangle", "cut oval")  # of one scale along and across the strips: round stays round
ONE = [name for name in KINDS if name != "pair"]
CONVEX = [name for name in ONE if name != "concave"]


@dataclass(frozen=True, eq=False)
class Case:
    """A contact, its scan, and what is known of the noise."""

    kind: str
    truth: shapely.Geometry
    sensor: ts.Sensor
    scan: ts.Scan
    noise: ts.Noise
    known: bool
    touched: int

    @property
    def told(self) -> ts.Noise | None:
        """What a fit is told of the noise."""
        return self.noise if self.known else None

    def iou(self, vertices: np.ndarray) -> float:
        """Of an outline (N, 2) [mm] and what touched, or its hull along the strips where that is several pieces."""
        if len(vertices) < 3:
            return 0.0
        found = shapely.make_valid(shapely.Polygon(vertices))
        return float(found.intersection(self.truth).area / found.union(self.truth).area)


def _placed(
    random: np.random.Generator, shape: shapely.Polygon, kind: str, w: float, length: float
) -> shapely.Polygon:
    """Scale a shape to a part of the sensor, and put it somewhere on it, or over a border."""
    rx, ry = w * random.uniform(0.12, 0.45), length * random.uniform(0.1, 0.42)
    low = np.array(shape.bounds)
    scale = 2 * rx / (low[2] - low[0]), 2 * ry / (low[3] - low[1])
    if kind in AS_DRAWN:
        scale = min(scale), min(scale)
    shape = affinity.scale(shape, *scale, origin=(0, 0))
    x0, y0, x1, y1 = shape.bounds
    x, y = random.uniform(-x0, w - x1), random.uniform(-y0, length - y1)
    if kind == "over left or right":
        over = random.uniform(0.1, 0.6) * (x1 - x0)
        x = -x0 - over if random.random() < 0.5 else w - x1 + over
    if kind == "over top or bottom":
        over = random.uniform(0.1, 0.6) * (y1 - y0)
        y = -y0 - over if random.random() < 0.5 else length - y1 + over
    return affinity.translate(shape, x, y)


def case(
    random: np.random.Generator,
    kind: str,
    strips: int,
    noise: float,
    signatures: str = "both",
    known: bool = True,
    construction: str | None = None,
) -> Case:
    """Draw a case: `strips` in contact, about, a noise's half-width over Vref, "both", "kh", "kl" or "k"."""
    length = 100.0
    of = construction or ("crs-m" if signatures == "k" else "crs-crs")
    errors = ts.Noise(positional=noise, distribution="uniform" if random.random() < 0.5 else "normal")
    while True:
        width = 100.0
        if kind == "pair":
            a = _placed(random, _ring(random, int(random.integers(3, 7))), "", width, length)
            b = _placed(random, _ring(random, int(random.integers(3, 7))), "", width, length)
            shared = min(a.bounds[2], b.bounds[2]) - max(a.bounds[0], b.bounds[0])
            if a.intersects(b) or shared < 0.3 * min(a.bounds[2] - a.bounds[0], b.bounds[2] - b.bounds[0]):
                continue
            shape: shapely.Geometry = shapely.union_all([a, b])
        else:
            shape = _placed(random, KINDS[kind](random), kind, width, length)
        part = shape.intersection(shapely.box(0, 0, width, length))
        extent = part.bounds[2] - part.bounds[0]
        count = max(round(strips * width / extent), strips)
        sensor = ts.Sensor(
            construction=of, strips=count, pitch_mm=width / count, length_mm=length, adc_bits=12
        )
        polygons = part.geoms if hasattr(part, "geoms") else [part]
        contact = ts.Contact(tuple(p for p in polygons if p.area > 0.0))
        clean = ts.simulate(sensor, contact)
        if clean.touched.sum() >= 5 and len(clean.runs()) == 1:
            break
    scan = ts.simulate(sensor, contact, errors, rng=random)
    if signatures in ("kh", "kl"):
        scan = ts.Scan(kh=scan["kh"]) if signatures == "kh" else ts.Scan(kl=scan["kl"])
    return Case(kind, part, sensor, scan, errors, known, int(clean.touched.sum()))
