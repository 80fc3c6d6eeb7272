"""Contacts of many kinds, drawn and read without the package: what a strip meets is found on its centre line."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import tacstrip as ts
from tacstrip.arrays import FloatArray

_CURVED = 720  # points that draw a curve
KINDS: dict[str, Callable[[np.random.Generator], FloatArray]] = {}


@dataclass(frozen=True)
class Drawn:
    """One contact: its outline (N, 2) [mm] within the sensor, counter-clockwise, its sensor and its scan."""

    outline: FloatArray
    sensor: ts.Sensor
    scan: ts.Scan


def _kind(draw: Callable[[np.random.Generator], FloatArray]) -> Callable[[np.random.Generator], FloatArray]:
    KINDS[draw.__name__.strip("_")] = draw
    return draw


def _turned(points: FloatArray, angle: float) -> FloatArray:
    c, s = np.cos(angle), np.sin(angle)
    return np.asarray(points @ np.array([[c, s], [-s, c]]))


@_kind
def _polygon(random: np.random.Generator) -> FloatArray:
    """Return a convex polygon of 3 to 12 corners on an ellipse."""
    while True:
        angle = np.sort(random.uniform(0.0, 2.0 * np.pi, random.integers(3, 13)))
        gaps = np.diff(np.append(angle, angle[0] + 2.0 * np.pi))
        if gaps.max() < 0.9 * np.pi and gaps.min() > 0.15:
            break
    return _turned(
        np.stack([np.cos(angle), random.uniform(0.3, 1.0) * np.sin(angle)], axis=1),
        random.uniform(0.0, np.pi),
    )


@_kind
def _upright(random: np.random.Generator) -> FloatArray:
    """Return a trapezoid with two vertical ends."""
    left, right = random.uniform(0.2, 1.0, 2)
    up, down = random.uniform(-0.3, 0.3, 2)
    return np.array([(-1.0, up - left), (1.0, down - right), (1.0, down + right), (-1.0, up + left)])


@_kind
def _rectangle(random: np.random.Generator) -> FloatArray:
    """Return a rectangle along the strips."""
    h = random.uniform(0.2, 1.5)
    return np.array([(-1.0, -h), (1.0, -h), (1.0, h), (-1.0, h)])


@_kind
def _tilted(random: np.random.Generator) -> FloatArray:
    """Return a rectangle turned by so little that its ends cross few strips."""
    return _turned(_rectangle(random), random.choice([-1.0, 1.0]) * 10.0 ** random.uniform(-2.5, -0.7))


@_kind
def _slim(random: np.random.Generator) -> FloatArray:
    """Return a triangle whose one end is a narrow angle."""
    return _turned(
        np.array([(-1.0, 0.0), (1.0, -random.uniform(0.02, 0.3)), (1.0, random.uniform(0.02, 0.3))]),
        random.uniform(-0.7, 0.7) + random.integers(2) * np.pi,
    )


@_kind
def _rounded(random: np.random.Generator) -> FloatArray:
    """Return a rectangle with rounded corners, turned."""
    h, share = random.uniform(0.4, 1.0), random.uniform(0.1, 0.9)
    r = share * h
    turn = np.linspace(0.0, 0.5 * np.pi, _CURVED // 4)
    arcs = [
        np.stack([sx * (1.0 - r) + r * np.cos(turn + o), sy * (h - r) + r * np.sin(turn + o)], axis=1)
        for sx, sy, o in ((1, 1, 0.0), (-1, 1, 0.5 * np.pi), (-1, -1, np.pi), (1, -1, 1.5 * np.pi))
    ]
    return _turned(np.concatenate(arcs), random.choice([0.0, random.uniform(0.0, np.pi)]))


@_kind
def _circle(random: np.random.Generator) -> FloatArray:
    """Return a circle."""
    turn = 2.0 * np.pi * (np.arange(_CURVED) + random.random()) / _CURVED
    return np.stack([np.cos(turn), np.sin(turn)], axis=1)


@_kind
def _oval(random: np.random.Generator) -> FloatArray:
    """Return an ellipse, turned."""
    return _turned(_circle(random) * (1.0, random.uniform(0.3, 1.0)), random.uniform(0.0, np.pi))


@_kind
def _star(random: np.random.Generator) -> FloatArray:
    """Return a star: l and u along the strips are its hull's in y."""
    tips = int(random.integers(4, 9))
    turn = np.pi * np.arange(2 * tips) / tips + random.uniform(0.0, np.pi)
    r = np.where(np.arange(2 * tips) % 2, random.uniform(0.4, 0.8), 1.0)
    return np.stack([r * np.cos(turn), r * np.sin(turn)], axis=1)


@_kind
def _border(random: np.random.Generator) -> FloatArray:
    """Return a polygon that lies over y = 0 or y = L; `draw` moves it there."""
    return _polygon(random)


@_kind
def _touching(random: np.random.Generator) -> FloatArray:
    """Return a polygon whose lowest or highest corner lies on y = 0 or y = L; `draw` moves it there."""
    return _polygon(random)


def ends_of(outline: FloatArray, x: FloatArray, length_mm: float) -> tuple[FloatArray, FloatArray]:
    """Return l and u (n,) [mm] on lines at x (n,), by where they cross the outline's edges; NaN outside."""
    a, b = outline, np.roll(outline, -1, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (x[:, None] - a[:, 0]) / (b[:, 0] - a[:, 0])
        y = np.where((t >= 0.0) & (t <= 1.0), a[:, 1] + t * (b[:, 1] - a[:, 1]), np.nan)
    there = np.isfinite(y).any(axis=1)
    l, u = np.full(len(x), np.nan), np.full(len(x), np.nan)
    l[there] = np.clip(np.nanmin(y[there], axis=1), 0.0, length_mm)
    u[there] = np.clip(np.nanmax(y[there], axis=1), 0.0, length_mm)
    return l, u


def draw(
    kind: str,
    strips: int,
    noise: float,
    random: np.random.Generator,
    signatures: tuple[str, ...] = ("kh", "kl"),
    pitch_mm: float = 1.0,
) -> Drawn:
    """Draw a contact over so many strips of CRS-CRS, and read it with errors uniform within +-noise [Vref]."""
    shape = KINDS[kind](random)
    width = (strips + random.uniform(-0.5, 0.5)) * pitch_mm  # either end anywhere within a pitch
    shape = (shape - shape.min(axis=0)) / np.ptp(shape, axis=0)
    height = random.uniform(0.1, 0.6)
    low = random.uniform(0.02, 0.98 - height)
    if kind in ("border", "touching"):
        low = -random.uniform(0.1, 0.6) * height if kind == "border" else 0.0
        if random.random() < 0.5:
            low = 1.0 - height - low
    length = 1.2 * width
    outline = np.stack(
        [
            pitch_mm * (1.0 + random.random()) + shape[:, 0] * width,
            (low + shape[:, 1] * height) * length,
        ],
        axis=1,
    )
    sensor = ts.Sensor(construction="crs-crs", strips=strips + 3, pitch_mm=pitch_mm, length_mm=length)
    x: FloatArray = (np.arange(strips + 3.0) + 0.5) * pitch_mm
    l, u = ends_of(outline, x, length)
    w = u - l
    ideal = {"kh": (l + 0.5 * w) / (length - 0.5 * w), "kl": l / (length - 0.5 * w)}
    read = {
        name: np.clip(ideal[name] + random.uniform(-noise, noise, len(x)), 0.0, 1.0) for name in signatures
    }
    if kind == "border":
        outline = clipped(outline, length)
    return Drawn(outline, sensor, ts.Scan(kh=read.get("kh"), kl=read.get("kl")))


def clipped(outline: FloatArray, length_mm: float) -> FloatArray:
    """Return the part of an outline that lies on strips from 0 to length_mm."""
    for sign, limit in ((1.0, 0.0), (-1.0, -length_mm)):
        kept = []
        for a, b in zip(outline, np.roll(outline, -1, axis=0), strict=True):
            inside = [sign * p[1] >= limit for p in (a, b)]
            if inside[0]:
                kept.append(a)
            if inside[0] != inside[1]:
                kept.append(a + (sign * limit - a[1]) / (b[1] - a[1]) * (b - a))
        outline = np.array(kept)
    return outline
