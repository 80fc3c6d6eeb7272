"""Finding the vertices of random polygons: the polygon fit against libraries that find kinks, and against the bound.

A row per cell and method: the share of right vertex counts; the median distance from a true transition to the nearest
one found, in % of the contact's width, and over the median that the Cramer-Rao bound implies; the root mean square
error of the vertices over the bound's, of the polygons with the right vertices (pooled: of all in mm, so that the
least certain ones weigh most; scaled: each over its own bound); the same of the least-squares fit that starts at the
truth, which no search can beat; the share of true vertices in their 95 % regions; and milliseconds.
Run: python benchmarks/transitions.py [--polygons 400] [--cells kh:0.005:100 ...] [--methods polygon savgol ...]
piecewise-regression, skchange and ruptures take part if they are installed.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from importlib.util import find_spec

import numpy as np
from _kinks import FINDERS, problem_of
from _protocol import SIGNATURES, Cell, Trial, trial

import tacstrip as ts
from tacstrip.arrays import FloatArray
from tacstrip.core.polygon_fit import PolygonFit, refine
from tacstrip.core.problem import FitProblem
from tacstrip.core.search import fit_counts
from tacstrip.geometry.outline import Outline
from tacstrip.reconstruction.cramer_rao import reading_sigma
from tacstrip.reconstruction.polygon.estimate import fit_polygon

SEED = 20260501
CELLS = [
    Cell(kind, noise, n) for kind in ("kh", "k", "both") for noise in (0.005, 0.01) for n in (100, 300, 1000)
]
REGION = 5.991  # chi square of two numbers at 95 %
_SLOW = {"piecewise-regression": 20, "skchange": 100, "ruptures": 100}  # polygons at most


@dataclass
class Score:
    """What one method did in one cell."""

    right: list[bool] = field(default_factory=list)
    away: list[float] = field(default_factory=list)  # of the width
    implied: list[float] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    squares: list[float] = field(default_factory=list)  # of the vertices' errors [mm^2]
    bounds: list[float] = field(default_factory=list)
    scaled: list[float] = field(default_factory=list)
    from_truth: list[tuple[float, float]] = field(
        default_factory=list
    )  # squares and scaled, started at the truth
    inside: list[bool] = field(default_factory=list)

    def row(self) -> str:
        """Return the table's cells."""
        median, implied = 100.0 * np.median(self.away), 100.0 * np.median(self.implied)
        first = f"{np.mean(self.right):.4f} | {median:.3f} | {median / implied:.2f}"
        vertices = "- | - | - | - | -"
        if self.squares:
            squares, scaled = np.transpose(self.from_truth)
            pooled, least = (np.sqrt(np.sum(s) / np.sum(self.bounds)) for s in (self.squares, squares))
            vertices = (
                f"{pooled:.2f} | {np.sqrt(np.mean(self.scaled)):.2f} | {least:.2f} | {np.sqrt(np.mean(scaled)):.2f} | "
                f"{np.mean(self.inside):.3f}"
            )
        return f"{first} | {vertices} | {1e3 * np.median(self.seconds):.2f}"


def score(cell: Cell, methods: Sequence[str], polygons: int, seed: int) -> dict[str, Score]:
    """Put all methods to the same contacts."""
    random = np.random.default_rng([seed, *cell_key(cell)])
    scores = {m: Score() for m in methods}
    noise = ts.Noise(quantisation=cell.noise)
    for number in range(polygons):
        of = trial(cell, random)
        sigma = np.sqrt(of.bound.diagonal())
        for method in (m for m in methods if number < _SLOW.get(m, polygons)):
            find, got = FINDERS[method][0], scores[method]
            start = time.perf_counter()
            x = find(cell, of)
            got.seconds.append(time.perf_counter() - start)
            got.right.append(len(x) == len(of.interior))
            width = np.ptp(of.truth[:, 0])
            far = np.abs(of.interior[:, None] - x).min(axis=1, initial=width)
            got.away += list(far / width)
            inner = np.isin(of.truth[:, 0], of.interior)
            draws = np.random.default_rng(number).normal(size=(20, inner.sum()))
            got.implied += list(np.abs(draws * sigma[::2][inner]).ravel() / width)
            if method == "polygon" and got.right[-1]:
                add_vertices(
                    got,
                    of,
                    fit_polygon(of.scan, cell.sensor, noise, bounded=False, assessment="none"),
                    from_truth(cell, of),
                )
    return scores


def from_truth(cell: Cell, of: Trial) -> FloatArray:
    """Return the vertices of the least-squares fit that starts at the true ones."""
    start = PolygonFit.of(Outline.of(of.truth), problem_of(cell, of))
    return Outline(*refine(start, problem_of(cell, of)).chains_mm(problem_of(cell, of))).vertices


def add_vertices(got: Score, of: Trial, found: ts.Reconstruction, from_truth: FloatArray) -> None:
    """Note the vertices' errors where the polygon has the right ones."""
    first = found.objects[0]
    if not first.vertices.shape == of.truth.shape == from_truth.shape or first.covariance is None:
        return
    best = (from_truth - of.truth) ** 2
    got.from_truth.append((float(best.sum()), float(np.mean(best.ravel() / of.bound.diagonal()))))
    error = first.vertices - of.truth
    got.squares.append(float((error**2).sum()))
    got.bounds.append(float(of.bound.trace()))
    got.scaled.append(float(np.mean(error.ravel() ** 2 / of.bound.diagonal())))
    for i, e in enumerate(error):
        block = first.covariance[2 * i : 2 * i + 2, 2 * i : 2 * i + 2]
        got.inside.append(bool(e @ np.linalg.solve(block, e) <= REGION))


def speeds(cell: Cell, seed: int, contacts: int = 60) -> str:
    """Return milliseconds of a cold fit, of a warm one from the scan before, and of all of `fit_polygon`."""
    random = np.random.default_rng([seed, *cell_key(cell)])
    sensor, noise = cell.sensor, ts.Noise(quantisation=cell.noise)
    times = []
    for _ in range(contacts):
        of = trial(cell, random)
        problems = []
        for _ in range(2):
            again = ts.simulate(sensor, ts.Contact.polygon(of.truth), noise, rng=random)
            readings = {name: again[name][again.touched] for name in SIGNATURES[cell.kind]}
            problems.append(FitProblem.of(sensor, of.x, readings, reading_sigma(noise, sensor)))
        before = fit_counts(problems[0]).chosen
        jobs: list[Callable[[], object]] = [
            partial(fit_counts, problems[1]),
            partial(refine, before, problems[1]),
            partial(fit_polygon, of.scan, sensor, noise, bounded=False),
        ]
        times.append([min(_seconds(job) for _ in range(3)) for job in jobs])
    return " | ".join(f"{1e3 * t:.3f}" for t in np.median(times, axis=0))


def _seconds(job: Callable[[], object]) -> float:
    start = time.perf_counter()
    job()
    return time.perf_counter() - start


def cell_key(cell: Cell) -> tuple[int, int, int]:
    """Return whole numbers that a generator can be seeded with."""
    return sorted(SIGNATURES).index(cell.kind), round(1e6 * cell.noise), cell.strips


def parse(text: str) -> Cell:
    """Read a cell written as kind:noise:strips."""
    kind, noise, strips = text.split(":")
    if kind not in SIGNATURES:
        raise argparse.ArgumentTypeError(f"{kind!r} is none of {', '.join(SIGNATURES)}")
    return Cell(kind, float(noise), int(strips))


def main() -> None:
    """Print the table."""
    there = [m for m, (_, needs) in FINDERS.items() if not needs or find_spec(needs)]
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--polygons", type=int, default=400, help="a cell")
    options.add_argument(
        "--cells", nargs="+", type=parse, default=CELLS, help="kind:noise:strips, all by default"
    )
    options.add_argument("--methods", nargs="+", choices=there, default=there)
    options.add_argument("--seed", type=int, default=SEED)
    chosen = options.parse_args()
    print(
        "| signature | noise | strips | method | right | median % | / bound | RMS pooled | scaled | "
        "from the truth | scaled | in 95 % | ms |"
    )
    print("|" + " --- |" * 13)
    for cell in chosen.cells:
        for method, got in score(cell, chosen.methods, chosen.polygons, chosen.seed).items():
            print(f"| {cell.kind} | {cell.noise:g} | {cell.strips} | {method} | {got.row()} |", flush=True)
    print("\nOne core, milliseconds, the best of three of each contact, median:\n")
    print(
        "| signature | noise | strips | cold fit | warm fit | fit_polygon |\n| --- | --- | --- | --- | --- | --- |"
    )
    for cell in chosen.cells:
        print(f"| {cell.kind} | {cell.noise:g} | {cell.strips} | {speeds(cell, chosen.seed)} |", flush=True)


if __name__ == "__main__":
    main()
