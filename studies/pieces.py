"""Convex pieces from one scan: pictures of what it shows and what stays hidden; how often the count is right.

Run: python -m studies.pieces --seed 0 (seeds of 1000 and above decide, and are run once).
"""

from __future__ import annotations

import time

import numpy as np
import shapely
from matplotlib.figure import Figure
from scipy.optimize import linear_sum_assignment
from shapely.affinity import translate

import tacstrip as ts
from studies.options import of_cases
from tacstrip.arrays import FloatArray
from tacstrip.plot.scene import draw_contact, draw_piece
from tacstrip.plot.theme import OTHERS, RECOVERED, new_panels
from tacstrip.reconstruction.contact_ends import end_deviations
from tacstrip.reconstruction.methods import reconstruct

_SENSOR = ts.Sensor(construction="crs-crs", strips=100, pitch_mm=1.0, length_mm=100.0)
_NOISE = ts.Noise(positional=0.005)
_LOW = shapely.Polygon([(15, 30), (32, 12), (60, 16), (58, 34), (38, 42)])
_HIGH = shapely.Polygon([(36, 62), (62, 48), (86, 60), (72, 86), (46, 82)])
_SMALL = shapely.Polygon([(52, 30), (88, 8), (94, 24), (74, 38)])
_BAR = shapely.box(15, 20, 85, 32)
_RING = shapely.Point(50, 50).buffer(34, 24).difference(shapely.Point(50, 50).buffer(24, 24))
_FEW = 20  # strips
_SCENES = {
    "two objects": (_LOW, _HIGH),
    "three objects": (translate(_LOW, -8), translate(_HIGH, -6, 8), translate(_SMALL, 2, -6)),
    "a concave object": (shapely.Polygon([(15, 20), (85, 20), (85, 38), (42, 38), (42, 80), (15, 80)]),),
    "a notch": (shapely.Polygon([(15, 45), (32, 15), (50, 36), (70, 15), (86, 45), (50, 84)]),),
}
_HIDDEN = {
    "a hole": (_RING,),
    "an object inside a ring": (_RING, shapely.Point(52, 48).buffer(12, 3)),
    "parallel bars": (_BAR, translate(_BAR, 0, 45)),
    "hidden on all its strips": (_LOW, _HIGH, shapely.Polygon([(42, 47), (50, 44), (49, 52)])),
}


def _draw(scenes: dict[str, tuple[shapely.Polygon, ...]]) -> Figure:
    figure, panels = new_panels(7.0, 7.4, 2, 2)
    for axes, (name, shapes) in zip(panels, scenes.items(), strict=True):
        contact = ts.Contact(shapes)
        found = reconstruct(ts.simulate(_SENSOR, contact, _NOISE, rng=1), _SENSOR, _NOISE, method="pieces")
        for shape in shapes:
            draw_contact(axes, ts.Contact((shape,)))
            for hole in shape.interiors:
                axes.fill(*np.array(hole.coords).T, color="white", zorder=1)
        for piece, colour in zip(found.objects, (RECOVERED, *OTHERS), strict=False):
            draw_piece(axes, piece, colour)
        count = len(found.objects)
        axes.set(aspect="equal", xlim=(0, 100), ylim=(0, 100), xlabel="x [mm]")
        axes.set_title(f"{name}: at least {count} piece{'s' if count > 1 else ''}", fontsize=10.0)
    for left in panels[::2]:
        left.set_ylabel("y [mm]")
    return figure


FIGURES = {"pieces": lambda: _draw(_SCENES), "pieces_hidden": lambda: _draw(_HIDDEN)}


def convex(random: np.random.Generator, radius: tuple[float, float]) -> FloatArray:
    """Draw a convex polygon of 3 to 6 clear corners around the origin (N, 2) [mm]."""
    while True:
        angles = np.sort(random.uniform(0.0, 2.0 * np.pi, random.integers(3, 7)))
        gaps = np.diff(np.append(angles, angles[0] + 2.0 * np.pi))
        corners = random.uniform(*radius) * np.column_stack(
            [np.cos(angles), random.uniform(0.7, 1.0) * np.sin(angles)]
        )
        edges = np.roll(corners, -1, axis=0) - corners
        heading = np.arctan2(edges[:, 1], edges[:, 0])
        turns = (np.roll(heading, -1) - heading + np.pi) % (2.0 * np.pi) - np.pi
        if gaps.min() >= 0.5 and gaps.max() <= 2.6 and turns.min() >= 0.35:
            return np.asarray(corners)


def scene(random: np.random.Generator, count: int, radius: tuple[float, float]) -> list[shapely.Polygon]:
    """Draw convex shapes .5 mm apart or more, each of which shares 3 mm of strips or more with those to its left."""
    while True:
        shapes = [
            translate(shapely.Polygon(convex(random, radius)), *random.uniform(22.0, 78.0, 2))
            for _ in range(count)
        ]
        shapes.sort(key=lambda s: s.bounds[0])
        x0, y0, x1, y1 = np.array([s.bounds for s in shapes]).T
        near = [a.distance(b) for i, a in enumerate(shapes) for b in shapes[:i]]
        on = min(x0.min(), y0.min()) >= 1.0 and max(x1.max(), y1.max()) <= 99.0
        if on and min(near, default=1.0) >= 0.5 and (x0[1:] <= np.maximum.accumulate(x1)[:-1] - 3.0).all():
            return shapes


def score(seed: int, strips: int, count: int, cases: int, half_width: float = 0.005) -> str:
    """Return a line: how often so many shapes were counted right, what was said, and the time a scan took."""
    random = np.random.default_rng([seed, strips, count])
    sensor = ts.Sensor(construction="crs-crs", strips=strips, pitch_mm=100.0 / strips, length_mm=100.0)
    noise = ts.Noise(positional=half_width)
    radius = _radius(strips, count)
    off, said, took_s = [], [], []
    for _ in range(cases):
        scan = ts.simulate(sensor, ts.Contact(tuple(scene(random, count, radius))), noise, rng=random)
        begun = time.process_time()
        found = ts.pieces(scan, sensor, noise)
        took_s.append(time.process_time() - begun)
        off.append(len(found) - count)
        worst = max(found, key=lambda p: ("ok", "likely", "doubtful").index(p.status))
        said.append(worst.status)
    wrong, states = np.array(off), np.array(said)
    shares = " ".join(
        f"{state} {(states == state).mean():.3f} (wrong {((states == state) & (wrong != 0)).mean():.3f})"
        for state in ("ok", "likely", "doubtful")
    )
    right, less, more = (wrong == 0).mean(), (wrong < 0).mean(), (wrong > 0).mean()
    ms = 1e3 * float(np.median(took_s))
    return (
        f"{strips} strips, {count}: right {right:.3f} fewer {less:.3f} more {more:.3f}; {shares}; {ms:.1f} ms"
    )


def _iou(shape: shapely.Polygon, outline: FloatArray) -> float:
    """Return intersection over union; 0 of an outline that is a line."""
    whole = shapely.Polygon(outline if len(outline) > 2 else None).buffer(0.0)
    return float(shapely.area(shape & whole) / shapely.area(shape | whole))


def score_bounds(seed: int, strips: int, count: int, cases: int, half_width: float) -> str:
    """Return a line: how often a shape leaves `largest` by a deviation and .1 mm, and is silently wrong (IoU < .8)."""
    random = np.random.default_rng([seed, strips, count, int(half_width * 1e5)])
    sensor = ts.Sensor(construction="crs-crs", strips=strips, pitch_mm=100.0 / strips, length_mm=100.0)
    noise, radius = ts.Noise(positional=half_width), _radius(strips, count)
    out, said, wrong, right, total = 0, 0, 0, 0, 0
    for _ in range(cases):
        shapes = scene(random, count, radius)
        found = ts.pieces(ts.simulate(sensor, ts.Contact(tuple(shapes)), noise, rng=random), sensor, noise)
        overlap = np.array([[_iou(s, p.outline) for s in shapes] for p in found])
        for i, j in zip(*linear_sum_assignment(-overlap), strict=True):
            piece, total = found[i], total + 1
            told = piece.status != "doubtful"
            said, wrong = said + told, wrong + (told and overlap[i, j] < 0.8)
            if len(found) == count:
                right += 1
                edge = np.array(shapely.segmentize(shapes[j].exterior, 1.0).coords)
                off = shapely.distance(shapely.Polygon(piece.largest), shapely.points(edge))
                y = edge[off.argmax(), 1:]
                out += bool(
                    off.max() > 0.1 + float(np.max(end_deviations(sensor, y, y, half_width / np.sqrt(3.0))))
                )
    return (
        f"{strips} strips, {count}, +-{half_width}: out {out / max(right, 1):.3f} of {right}; ok or likely {said} of "
        f"{total}, of these wrong {wrong}"
    )


def _radius(strips: int, count: int) -> tuple[float, float]:
    if strips > 20:
        return (14.0, 22.0) if count < 3 else (9.0, 16.0)
    return (20.0, 30.0) if count < 3 else (14.0, 20.0)


def main() -> None:
    """Print the table of docs/guide/several-objects.md."""
    asked = of_cases("studies.pieces", __doc__, 200, 0).parse_args()
    for strips in (100, 32, 10):
        for count in (1, 2, 3):
            print(score(asked.seed, strips, count, asked.cases), flush=True)  # noqa: T201
    for strips in (40, 20, 10):
        for count in (2, 3):
            for half_width in (0.0005, 0.005):
                print(score_bounds(asked.seed, strips, count, asked.cases, half_width), flush=True)  # noqa: T201


if __name__ == "__main__":
    main()
