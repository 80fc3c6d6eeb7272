"""The polygon fit where the noise has a known bound, against least squares and the Gaussian bound.

A row per cell of the protocol: the share of right vertex counts by least squares, and by the fewest vertices that stay
within the bound; the root mean square error of the vertices over the Cramer-Rao bound's, where the vertices are right,
pooled over polygons, of least squares and of the set's mean; the share of true vertices in the 95 % regions of the
set; true vertices in their guaranteed regions, of those that have one; scans of which no polygon stays within the
bound; and milliseconds (process time) beyond least squares, and for the guaranteed regions.
Run: python benchmarks/bounded.py [--polygons 200] [--cells both:0.005:100 ...]
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass, field

import numpy as np
import shapely
from _protocol import Cell, Trial, trial
from transitions import REGION, SEED, cell_key, parse

import tacstrip as ts
from tacstrip.arrays import FloatArray
from tacstrip.reconstruct.polygon import fit_polygon
from tacstrip.reconstruct.result import RecoveredObject

CELLS = [Cell(kind, noise, n) for kind in ("both", "kh") for noise in (0.005, 0.01) for n in (100, 300, 1000)]
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
            found.append(fit_polygon(of.scan, cell.sensor, noise, bounded=bounded).objects[0])
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


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--polygons", type=int, default=200, help="a cell")
    options.add_argument(
        "--cells", nargs="+", type=parse, default=CELLS, help="kind:noise:strips, all by default"
    )
    options.add_argument("--seed", type=int, default=SEED)
    chosen = options.parse_args()
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
