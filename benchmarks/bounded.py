"""The polygon fit where the noise has a known bound, against least squares and the Gaussian bound.

A row per cell of the protocol: the share of right vertex counts by least squares, and by the fewest vertices that stay
within the bound; the root mean square error of the vertices over the Cramer-Rao bound's, where the vertices are right,
pooled over polygons, of least squares and of the set's mean; the share of true vertices in the 95 % regions of the
set; true vertices in their guaranteed regions, of those that have one; scans of which no polygon stays within the
bound; and milliseconds (process time) beyond least squares, and for the guaranteed regions.
With --shapes, contacts of many kinds instead (`_shapes`): a row per kind over 6 to 1000 strips and three noises. Shares
that are "ok"; the root mean square of the area in which outline and truth differ, over the truth's, of those; the share
of areas in their 95 % region, of least squares and bounded; and process time beyond least squares.
Run: python benchmarks/bounded.py [--polygons 200] [--cells both:0.005:100 ...] [--shapes 4]
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass, field
from itertools import product

import numpy as np
import shapely
from _protocol import Cell, Trial, trial
from _shapes import KINDS, draw
from transitions import REGION, SEED, cell_key, parse

import tacstrip as ts
from tacstrip.arrays import FloatArray
from tacstrip.reconstruction.polygon.estimate import fit_polygon
from tacstrip.reconstruction.result import RecoveredObject

CELLS = [Cell(kind, noise, n) for kind in ("both", "kh") for noise in (0.005, 0.01) for n in (100, 300, 1000)]
SIZES, NOISES = (6, 10, 20, 50, 100, 300, 1000), (0.001, 0.004, 0.015)
_ON = 1e-9  # mm: a vertex on the edge of its region


@dataclass
class Score:
    """What came of one cell."""

    right: list[tuple[bool, bool]] = field(default_factory=list)
    squares: list[FloatArray] = field(default_factory=list)  # least squares, the set's mean, the bound [mm^2]
    inside: list[bool] = field(default_factory=list)
    held: list[bool] = field(default_factory=list)
    empty: int = 0
    seconds: list[tuple[float, float]] = field(default_factory=list)

    def row(self) -> str:
        """Return the table's cells."""
        counts = " | ".join(f"{share:.4f}" for share in np.mean(self.right, axis=0))
        total = np.sum(self.squares, axis=0)
        errors = " | ".join(f"{ratio:.2f}" for ratio in np.sqrt(total[:2] / total[2]))
        beyond, regions = 1e3 * np.median(self.seconds, axis=0)
        regions_held = f"{sum(self.held)} of {len(self.held)}"
        return (
            f"{counts} | {errors} | {np.mean(self.inside):.3f} | {regions_held} | {self.empty} | {beyond:.1f} | "
            f"{regions:.1f}"
        )


def score(cell: Cell, polygons: int, seed: int) -> Score:
    """Fit a cell's contacts by least squares and within the bound."""
    random = np.random.default_rng([seed, *cell_key(cell)])
    noise, got = ts.Noise(quantisation=cell.noise), Score()
    for _ in range(polygons):
        of = trial(cell, random)
        marks = [time.process_time()]
        found: list[RecoveredObject] = []
        for bounded in (False, True):
            found.append(
                fit_polygon(of.scan, cell.sensor, noise, bounded=bounded, assessment="none").objects[0]
            )
            marks.append(time.process_time())
        regions = found[1].guaranteed
        marks.append(time.process_time())
        fit, refined, last = np.diff(marks)
        got.seconds.append((refined - fit, last))
        right = [o.vertices.shape == of.truth.shape for o in found]
        got.right.append((right[0], right[1]))
        got.empty += found[1].guarantee is None
        if all(right):
            got.squares.append(
                np.array([*(((o.vertices - of.truth) ** 2).sum() for o in found), of.bound.trace()])
            )
        if right[1]:
            _add_regions(got, of, found[1], regions)
    return got


def _add_regions(got: Score, of: Trial, found: RecoveredObject, regions: list[FloatArray] | None) -> None:
    """Note which true vertices lie in their 95 % and guaranteed regions."""
    assert found.covariance is not None
    for i, error in enumerate(found.vertices - of.truth):
        block = found.covariance[2 * i : 2 * i + 2, 2 * i : 2 * i + 2]
        got.inside.append(bool(error @ np.linalg.solve(block, error) <= REGION))
    for region, vertex in zip(regions or [], of.truth, strict=False):
        got.held.append(bool(shapely.Polygon(region).distance(shapely.Point(vertex)) < _ON))


def of_kind(kind: str, contacts: int, seed: int) -> tuple[str, list[float]]:
    """Return a row of the table of shapes, and the milliseconds that each contact took beyond least squares."""
    random = np.random.default_rng([seed, sorted(KINDS).index(kind)])
    ok: list[list[bool]] = []
    off: list[list[float]] = []
    inside: list[list[bool]] = []
    times: list[float] = []
    for strips, a, _ in product(SIZES, NOISES, range(contacts)):
        drawn, noise, found, marks = (
            draw(kind, strips, a, random),
            ts.Noise(positional=a),
            [],
            [time.process_time()],
        )
        for bounded in (False, True):
            found.append(
                fit_polygon(drawn.scan, drawn.sensor, noise, bounded=bounded, assessment="none").objects[0]
            )
            marks.append(time.process_time())
        times.append(1e3 * float(np.diff(marks, 2)[0]))
        ok.append([o.status == "likely" for o in found])
        if all(ok[-1]):
            truth = shapely.make_valid(shapely.Polygon(drawn.outline))
            shapes = [shapely.make_valid(shapely.Polygon(o.vertices)) for o in found]
            off.append([truth.symmetric_difference(s).area / truth.area for s in shapes])
            sigma = [o.deviations[0] for o in found if o.deviations is not None]
            errors = np.subtract([s.area for s in shapes], truth.area)
            inside.append(list(np.abs(errors) < 1.96 * np.array(sigma)))
    parts = (np.mean(ok, axis=0), np.sqrt(np.mean(np.square(off), axis=0)), np.mean(inside, axis=0))
    row = " | ".join(f"{value:.3f}" for part in parts for value in np.atleast_1d(part))
    return f"{row} | {spread(times)}", times


def spread(times: list[float]) -> str:
    """Return median, 99 % and the most."""
    return " | ".join(f"{t:.0f}" for t in np.quantile(times, [0.5, 0.99, 1.0]))


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--polygons", type=int, default=200, help="a cell")
    options.add_argument(
        "--cells", nargs="+", type=parse, default=CELLS, help="kind:noise:strips, all by default"
    )
    options.add_argument("--seed", type=int, default=SEED)
    options.add_argument(
        "--shapes", type=int, metavar="N", help="contacts of each kind, size and noise, instead"
    )
    chosen = options.parse_args()
    if chosen.shapes:
        print(
            "| kind | ok | ok, bounded | off | off, bounded | area in 95 % | bounded | ms p50 | p99 | most |"
        )
        print("| --- " * 10 + "|")
        every: list[float] = []
        of_kind("polygon", 1, 0)  # compiles
        for kind in KINDS:
            row, times = of_kind(kind, chosen.shapes, chosen.seed)
            every += times
            print(f"| {kind} | {row} |", flush=True)
        print(f"| all | | | | | | | {spread(every)} |")
        return
    print(
        "| signature | noise | strips | right, least squares | right, bounded | RMS, least squares | RMS, bounded "
        "| in 95 % | guaranteed | empty | ms more | ms regions |"
    )
    print("| --- " * 12 + "|")
    score(CELLS[0], 1, 0)  # loads
    for cell in chosen.cells:
        row = score(cell, chosen.polygons, chosen.seed).row()
        print(f"| {cell.kind} | {cell.noise:g} | {cell.strips} | {row} |", flush=True)


if __name__ == "__main__":
    main()
