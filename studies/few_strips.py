"""What few strips do not tell: how often a confident outline of both signatures is of a concave object, or of two.

Run: python -m studies.few_strips [--cases 1000] [--seed 1]
Draws as many convex objects, concave ones and pairs on 3 to 11 strips, which count as `PRIOR` says. Prints how many are
`ok`, wrong, or right and doubted, what was right of what `confidence` said, and the log odds of
`polygon.few_strips` that fit these contacts best.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any
from unittest import mock

import numpy as np
import shapely
from scipy.optimize import minimize
from shapely import affinity

import tacstrip as ts
from studies.options import of_cases
from tacstrip.arrays import FloatArray
from tacstrip.reconstruction.polygon import few_strips, objects

# Nobody knows how often people press what is not convex; elsewhere, too, one object is four times as common as two.
PRIOR = {"convex": 3.5, "bar": 0.5, "concave": 1.0, "above": 0.5, "beside": 0.5}
GROUPS = tuple(PRIOR)
RIGHT, GOOD = 0.8, 0.9  # IoU
_NOISE = (0.001, 0.002, 0.005, 0.01)
_PULL, _SUREST = 0.02, 0.9995
_BINS = (0.0, 0.5, 0.7, 0.8, 0.85, 0.9, 0.95, 0.98, 1.01)
_Draw = Callable[[float], shapely.Geometry]


def _ring(*points: tuple[float, float]) -> shapely.Geometry:
    return shapely.Polygon(points)


def _disc(x: float, y: float, radius: float) -> shapely.Geometry:
    return shapely.Point(x, y).buffer(radius, 32)


def _regular(sides: int, inner: float | None = None) -> shapely.Geometry:
    """Return a regular polygon, or a star whose inner corners reach `inner`."""
    count = sides if inner is None else 2 * sides
    angle = 2.0 * np.pi * np.arange(count) / count
    reach = np.ones(count) if inner is None else np.where(np.arange(count) % 2, inner, 1.0)
    return shapely.Polygon(reach[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]))


def _arms(angles: Iterable[float], half: float) -> shapely.Geometry:
    arms = [affinity.rotate(shapely.box(0.0, -half, 1.0, half), a, origin=(0, 0)) for a in angles]
    return shapely.union_all([*arms, _disc(0.0, 0.0, half)])


def _bone(half: float) -> shapely.Geometry:
    return shapely.union_all([_disc(-0.8, 0, half), _disc(0.8, 0, half), shapely.box(-0.8, -0.18, 0.8, 0.18)])


# Of t, uniform in 0..1.
_PLAIN: dict[str, Sequence[_Draw]] = {
    "convex": (
        lambda t: _ring((0, 0), (1, 0), (0.2 + 0.6 * t, 0.8)),
        lambda t: _ring((0, 0), (1, 0), (0, 0.5 + t)),
        lambda t: _regular(4 + int(5 * t)),
        lambda t: _ring((0, 0), (1, 0), (0.5 + 0.4 * t, 0.8), (0.1, 0.8)),
        lambda t: shapely.box(0, 0, 1, 0.4 + 1.8 * t),
        lambda t: affinity.scale(_disc(0, 0, 1), 1.0, 0.4 + 0.6 * t),
        lambda t: shapely.LineString([(0, 0), (0.5 + 2 * t, 0)]).buffer(0.6, 16),
        lambda t: shapely.box(0, 0, 1, 1).buffer(0.15 + 0.5 * t, 16),
        lambda t: _disc(0, 0, 1).intersection(shapely.box(-2, -0.3 + 0.6 * t, 2, 2)),
        lambda t: _disc(-0.3 - 0.4 * t, 0, 1).intersection(_disc(0.3 + 0.4 * t, 0, 1)),
        lambda t: shapely.union(_disc(0, 0, 0.6), _disc(1 + 0.6 * t, 0, 1e-3)).convex_hull,
        lambda t: _ring((0, 0), (1, 0), (1, 1 - 0.2 - 0.4 * t), (1 - 0.2 - 0.4 * t, 1), (0, 1)),
        lambda t: _ring((-1, -1), (1, -1), (1, 0.5 * t), (0, 1.2), (-1, 0.5 * t)),
    ),
    "bar": (
        lambda t: shapely.box(0, 0, 1, 2.5 + 5.5 * t),
        lambda t: affinity.scale(_disc(0, 0, 1), 1.0, 0.15 + 0.25 * t),
        lambda t: shapely.LineString([(0, 0), (2.5 + 3.5 * t, 0)]).buffer(0.5, 16),
        lambda t: _ring((0, 0), (1, 0), (t, 2 + 3 * t)),
    ),
    "concave": (
        lambda t: _arms((0, 90, 180, 270), 0.2 + 0.2 * t),
        lambda t: _arms((90, 210, 330), 0.2 + 0.1 * t),
        lambda t: _ring((0, 0), (1, 0), (1, 0.3 + 0.3 * t), (0.45, 0.3 + 0.3 * t), (0.45, 1), (0, 1)),
        lambda t: shapely.union(shapely.box(-1, 0, 1, 0.6), shapely.box(-0.3, -0.6 - t, 0.3, 0.1)),
        lambda t: _regular(3 + int(4 * t), 0.4),
        lambda t: _ring((-1, -0.3), (0, -0.3), (0, -0.6 - 0.3 * t), (1, 0), (0, 0.6 + 0.3 * t), (0, 0.3), (-1, 0.3)),
        lambda t: _ring((-1, -1), (0, 0), (1, -1), (1, -0.7 + 0.4 * t), (0, 0.3 + 0.4 * t), (-1, -0.7 + 0.4 * t)),
        lambda t: _disc(0, 0, 1).difference(_disc(0, 0.9 + 0.4 * t, 0.65)),
        lambda t: _bone(0.35 + 0.15 * t),
    ),
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Contact:
    """What touches a sensor of both signatures, and noise: its half-width [Vref], and whether it is told."""

    objects: shapely.Geometry
    sensor: ts.Sensor
    half_width: float
    told: bool

    @property
    def touched(self) -> FloatArray:
        """Return lowest and highest y on each strip (2, strips) [mm], NaN where nothing touches."""
        found = np.full((2, self.sensor.strips), np.nan)
        for i, x in enumerate(self.sensor.x_mm):
            line = shapely.LineString([(x, -1.0), (x, self.sensor.length_mm + 1.0)])
            on = shapely.intersection(self.objects, line)
            if not on.is_empty and on.length > 0.0:
                found[:, i] = on.bounds[1], on.bounds[3]
        return found

    def scan(self, random: np.random.Generator) -> ts.Scan:
        """Return what it reads."""
        (low, high), length = self.touched, self.sensor.length_mm
        clean = ts.k_h(low, high - low, length), ts.k_l(low, high - low, length)
        kh, kl = (np.clip(k + random.uniform(-1, 1, len(k)) * self.half_width, 0.0, 1.0) for k in clean)
        return ts.Scan(kh=kh, kl=kl)


def contact(group: str, random: np.random.Generator) -> Contact:
    """Draw a contact of a group of `PRIOR` on 3 to 11 strips."""
    while True:
        wide = 10.0 * (random.integers(3, 12) - random.random())  # mm
        drawn = _of_breadth(group, wide, random) if group in _PLAIN else _pair(group, wide, random)
        if random.random() < 0.5:
            drawn = affinity.scale(drawn, 1.0, -1.0, origin=(0, 0))
        left, low, right, high = drawn.bounds
        length = (high - low) / random.uniform(0.2, 0.85)
        at = random.uniform(3.0, 15.0), random.uniform(0.02, 0.98) * (length - high + low)
        placed = affinity.translate(drawn, at[0] - left, at[1] - low)
        sensor = ts.Sensor(construction="crs-crs", strips=16, pitch_mm=10.0, length_mm=length)
        found = Contact(placed, sensor, float(random.choice(_NOISE)), bool(random.random() < 0.5))
        on = np.flatnonzero(np.isfinite(found.touched[0]))
        if 3 <= len(on) <= 11 and np.ptp(on) == len(on) - 1 and right - left < 140.0:
            return found


def _of_breadth(group: str, wide: float, random: np.random.Generator) -> shapely.Geometry:
    drawn = _PLAIN[group][int(random.integers(len(_PLAIN[group])))](random.random())
    angle = 90.0 * random.integers(4) if random.random() < 0.3 else random.uniform(0.0, 360.0)
    drawn = affinity.rotate(drawn, angle, origin=(0, 0))
    size = wide / (drawn.bounds[2] - drawn.bounds[0])
    return affinity.scale(drawn, size, size, origin=(0, 0))


def _pair(group: str, wide: float, random: np.random.Generator) -> shapely.Geometry:
    """Return two convex objects, one above the other or beside it."""
    share = random.uniform(0.3, 0.8)
    broad = (share, 1.1 - share) if group == "beside" else random.uniform(0.35, 1.0, 2)
    while True:
        first, second = (_of_breadth("convex", b * wide, random) for b in broad)
        (a, b), off = (first.bounds, second.bounds), random.uniform(-0.5, 0.5) * wide
        if group == "above":
            off += 0.5 * (a[0] + a[2] - b[0] - b[2])
            up = a[3] - b[1] + random.exponential(0.25) * wide - 0.2 * (a[3] - a[1])
        else:
            off = a[2] - b[0] + random.uniform(-15.0, 9.0)
            up = 0.5 * (a[1] + a[3] - b[1] - b[3]) + random.normal(0.0, 0.4) * wide
        second = affinity.translate(second, off, up)
        if first.distance(second) > 0.02 * wide:
            return shapely.MultiPolygon([first, second])


def judged(group: str, seed: int, number: int) -> dict[str, Any]:
    """Return what became of a contact: status, confidence before the odds of few strips and after, and their terms."""
    random = np.random.default_rng([GROUPS.index(group), seed, number])
    case = contact(group, random)
    noise = ts.Noise(positional=case.half_width) if case.told else None
    told: list[tuple[FloatArray, float]] = []

    def captured(terms: FloatArray) -> float:
        told.append((terms, few_strips.unlike_probability(terms)))
        return told[-1][1]

    with mock.patch.object(objects, "unlike_probability", captured):
        found = ts.fit_polygon(case.scan(random), case.sensor, noise, assessment="fast").objects
    best = max(found, key=lambda o: o.confidence or 0.0)
    outline = shapely.Polygon(best.vertices).buffer(0.0) if len(best.vertices) > 2 else shapely.Point()
    both = shapely.union(outline, case.objects).area
    iou = shapely.intersection(outline, case.objects).area / both
    right = iou >= RIGHT and len(found) == len(shapely.get_parts(case.objects))
    terms, unlike = told[0] if len(told) == 1 else (None, 0.0)
    return {
        "group": group, "iou": iou, "right": right, "ok": all(o.status == "ok" for o in found), "terms": terms,
        "confidence": best.confidence, "before": None if best.confidence is None else best.confidence / (1.0 - unlike),
        "strips": int(np.isfinite(case.touched[0]).sum()),
    }  # fmt: skip


def fitted(rows: Sequence[dict[str, Any]]) -> FloatArray:
    """Return the log odds by the terms with which `confidence` fits these contacts best."""
    weight = np.array([PRIOR[r["group"]] for r in rows])
    wrong = np.array([0.0 if r["right"] else 1.0 for r in rows])
    terms = np.stack([r["terms"] for r in rows])
    before = np.array([min(r["before"], _SUREST) for r in rows])

    def loss(odds: FloatArray) -> float:
        off = 1.0 - before / (1.0 + np.exp(terms @ odds))
        likely = np.where(wrong > 0.0, off, 1.0 - off)
        return float(-(weight * np.log(likely)).sum() + _PULL * (odds[1:] ** 2).sum())

    return np.asarray(minimize(loss, np.array([-3.8, *np.zeros(terms.shape[1] - 1)])).x)


def report(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Return the lines to print."""
    lines = []
    for least, most in ((3, 5), (6, 11)):
        for group in GROUPS:
            some = [r for r in rows if r["group"] == group and least <= r["strips"] <= most]
            ok = [r for r in some if r["ok"]]
            good = [r for r in some if r["iou"] >= GOOD and r["right"]]
            wrong, doubted = (sum(not r[key] for r in of) for key, of in (("right", ok), ("ok", good)))
            lines.append(
                f"{least}-{most} strips, {group:8}{len(some):6} ok {len(ok):5}, wrong {wrong:4}; "
                f"good {len(good):5}, doubted {doubted:4}"
            )
    said = [r for r in rows if r["confidence"] is not None]
    for low, high in pairwise(_BINS):
        some = [r for r in said if low <= r["confidence"] < high]
        if some:
            weight = [PRIOR[r["group"]] for r in some]
            mean, was = (
                np.average([r[key] for r in some], weights=weight) for key in ("confidence", "right")
            )
            lines.append(f"confidence {low:.2f}-{high:.2f}{len(some):6} said {mean:.3f} was {was:.3f}")
    sure = [r for r in said if r["terms"] is not None and r["before"] > 0.5]
    odds = ", ".join(f"{of:.2f}" for of in fitted(sure)) if sure else "too few contacts"
    return [*lines, f"log odds: {odds}"]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print what the command line asks for."""
    asked = of_cases("studies.few_strips", __doc__, 1000).parse_args(arguments)
    rows = [judged(group, asked.seed, number) for number in range(asked.cases) for group in GROUPS]
    print("\n".join(report(rows)))  # noqa: T201


if __name__ == "__main__":
    main()
