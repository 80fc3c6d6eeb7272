"""Several objects under two crossed layers, on scenes kept apart: `python -m studies.holdout.layers -h`.

Readings are those of `readings.py`, each layer's in its own frame; the package is called through `ts.LayeredSensor`,
`ts.Scan` and `ts.reconstruct` only. Seeds 0 to 9 are for tuning; those from 1000 on decide, once (`--final`).
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterable
from typing import TypeAlias

import numpy as np
import shapely
from scipy.optimize import linear_sum_assignment

import tacstrip as ts
from studies.holdout.readings import Unit
from studies.holdout.score import CLAIMS, FINAL, RIGHT
from studies.holdout.shapes import Array

Row: TypeAlias = dict[str, float]

SIDE, APART, INSIDE = 100.0, 1.5, 1.0  # mm: of the square, between objects, and from its border
SHARED, CLEAR = 3.0, 4.0  # mm of strips that two objects share in a layer; and that part those that do not
SETS = (
    "alone",
    "one",
    "both",
    "triple",
    "ring",
)  # pairs share strips of one layer or of both; triples of both


def convex(random: np.random.Generator, low: float, high: float) -> Array:
    """Draw a convex outline of 3 to 6 clear corners (N, 2) about 0 [mm], its radius between two."""
    while True:
        angles = np.sort(random.uniform(0.0, 2.0 * np.pi, random.integers(3, 7)))
        gaps = np.diff(np.append(angles, angles[0] + 2.0 * np.pi))
        radius, flat, turn = random.uniform(low, high), random.uniform(0.7, 1.0), random.uniform(0.0, np.pi)
        outline = radius * np.stack([np.cos(angles), flat * np.sin(angles)], axis=1)
        edges = np.roll(outline, -1, axis=0) - outline
        heading = np.arctan2(edges[:, 1], edges[:, 0])
        bend = (np.roll(heading, -1) - heading + np.pi) % (2.0 * np.pi) - np.pi
        if gaps.min() > 0.5 and gaps.max() < 2.6 and bend.min() > 0.35:
            c, s = np.cos(turn), np.sin(turn)
            return np.asarray((outline - outline.mean(axis=0)) @ np.array([[c, s], [-s, c]]))


def scene(kind: str, random: np.random.Generator) -> list[Array]:
    """Draw the outlines of a scene of `SETS` [mm]."""
    count, (low, high) = {
        "alone": (1, (10.0, 20.0)),
        "triple": (3, (9.0, 14.0)),
        "ring": (4, (8.0, 12.0)),
    }.get(kind, (2, (10.0, 17.0)))
    while True:
        places = random.uniform(18.0, SIDE - 18.0, (count, 2))
        if kind == "ring":
            around = np.pi / 2.0 * np.arange(4) + random.uniform(0.0, np.pi / 2.0)
            places = SIDE / 2.0 + random.uniform(24.0, 30.0) * np.stack(
                [np.cos(around), np.sin(around)], axis=1
            )
        found = [convex(random, low, high) + place for place in places]
        within = min(o.min() for o in found) > INSIDE and max(o.max() for o in found) < SIDE - INSIDE
        if (
            within
            and _apart(found)
            and (kind in ("alone", "ring") or _sharing(found) == kind.replace("triple", "both"))
        ):
            return found


def _apart(found: list[Array]) -> bool:
    shapes = [shapely.Polygon(o) for o in found]
    return all(a.distance(b) > APART for i, a in enumerate(shapes) for b in shapes[:i])


def _sharing(found: list[Array]) -> str:
    kind = "none"
    for i, a in enumerate(found):
        for b in found[:i]:
            common = np.minimum(a.max(axis=0), b.max(axis=0)) - np.maximum(a.min(axis=0), b.min(axis=0))
            if common.min() > SHARED:
                return "both"
            if common.max() > SHARED:
                kind = "one" if common.min() < -CLEAR else "near"
    return kind


def read(
    found: list[Array], strips: int, half_width: float, random: np.random.Generator
) -> tuple[ts.LayeredSensor, ts.Scan]:
    """Return two crossed layers of a square and what they read of outlines."""
    unit = Unit(("kh", "kl"), strips, SIDE / strips, SIDE)
    parts = []
    for turned in (
        False,
        True,
    ):  # the second layer: its x is the square's y, its y runs back along the square's x
        own = [np.stack([o[:, 1], SIDE - o[:, 0]], axis=1) if turned else o for o in found]
        ideal = unit.read(*unit.touched(own))
        parts.append(np.clip(ideal + random.uniform(-half_width, half_width, ideal.shape), 0.0, 1.0))
    k = np.concatenate(parts, axis=1)
    return ts.LayeredSensor.crossed(unit.sensor), ts.Scan(kh=k[0], kl=k[1])


def judged(found: list[Array], result: ts.Reconstruction, seconds: float) -> tuple[Row, list[Row]]:
    """Return what is right of a scene, and of the corners of matched objects whose count of corners is right."""
    shapes = [shapely.Polygon(o) for o in found]
    guesses = [shapely.Polygon(o.vertices).buffer(0.0) for o in result.objects if o.found]
    overlap = np.array([[g.intersection(s).area / g.union(s).area for s in shapes] for g in guesses])
    matched = list(zip(*linear_sum_assignment(-overlap), strict=True)) if guesses else []
    claimed = result.status in CLAIMS
    right = len(guesses) == len(shapes)
    overlaps = [overlap[i, j] for i, j in matched] + [0.0] * (len(shapes) - len(matched))
    row = {
        "right": float(right),
        "silent": float(claimed and not right),
        "claimed": float(claimed),
        "iou": float(np.mean(overlaps)),
        "seconds": seconds,
    }
    kept = [o for o in result.objects if o.found]
    row["wrong_claims"] = float(sum(kept[i].status in CLAIMS and overlap[i, j] < RIGHT for i, j in matched))
    row["claims"] = float(sum(o.status in CLAIMS for o in kept))
    corners = []
    for i, j in matched if right else ():
        vertices, hidden = kept[i].vertices, kept[i].hidden
        if len(vertices) != len(found[j]) or hidden is None:
            continue
        ways = [np.roll(found[j], shift, axis=0) for shift in range(len(vertices))]
        errors = min((np.hypot(*(vertices - way).T) for way in ways), key=lambda e: float(e.sum()))
        deviation = np.sqrt(np.diag(kept[i].covariance).reshape(-1, 2).sum(axis=1))
        corners += [
            {"error": e, "hidden": float(h), "deviation": d}
            for e, h, d in zip(errors, hidden, deviation, strict=True)
        ]
    return row, corners


def scores(
    kind: str, strips: int, half_width: float, seed: int, cases: Iterable[int]
) -> tuple[list[Row], list[Row]]:
    """Return the rows of scenes and of corners."""
    rows, corners = [], []
    for case in cases:
        random = np.random.default_rng([seed, case, SETS.index(kind)])
        found = scene(kind, random)
        sensor, scan = read(found, strips, half_width, random)
        begun = time.process_time()
        noise = ts.Noise(positional=half_width)
        row, own = judged(found, ts.reconstruct(scan, sensor, noise), time.process_time() - begun)
        rows.append(row)
        corners += own
    return rows, corners


def report(kind: str, strips: int, half_width: float, rows: list[Row], corners: list[Row]) -> str:
    """Return a line of figures."""
    mean = {key: float(np.mean([row[key] for row in rows])) for key in rows[0]}
    seen = [c["error"] for c in corners if not c["hidden"]]
    sizes = [c["error"] ** 2 / c["deviation"] ** 2 for c in corners if not c["hidden"]]
    median, p90 = np.quantile(seen, [0.5, 0.9]) if seen else (np.nan, np.nan)
    return (
        f"{strips}+{strips} strips, {100 * half_width:g} %, {kind:6}: count right {mean['right']:.3f}, claimed "
        f"{mean['claimed']:.3f}, silently wrong {mean['silent']:.3f}, IoU {mean['iou']:.3f}, claims under {RIGHT} "
        f"{sum(r['wrong_claims'] for r in rows):.0f} of {sum(r['claims'] for r in rows):.0f}, corners seen "
        f"{len(seen)} of {len(corners)}: {median:.2f} median {p90:.2f} p90 mm, "
        f"{np.median(sizes) if seen else np.nan:.2f} median squared deviation, {mean['seconds']:.2f} s"
    )


def main() -> None:
    """Print the figures of sets of scenes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sets", nargs="+", choices=SETS, default=SETS)
    parser.add_argument("--strips", nargs="+", type=int, default=[32])
    parser.add_argument("--half-width", nargs="+", type=float, default=[0.005])
    parser.add_argument("--cases", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--final", action="store_true")
    chosen = parser.parse_args()
    if chosen.seed >= FINAL and not chosen.final:
        parser.error(f"seeds from {FINAL} on decide, and are run once: --final")
    for strips in chosen.strips:
        for half_width in chosen.half_width:
            for kind in chosen.sets:
                found = scores(kind, strips, half_width, chosen.seed, range(chosen.cases))
                print(report(kind, strips, half_width, *found), flush=True)  # noqa: T201


if __name__ == "__main__":
    main()
