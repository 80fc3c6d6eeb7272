"""The page of speeds: our times, peers' in the same run, the limit, and growth; `make bench` writes it.

Peers are timed in turns with us, the least of some rounds each. Those that are not installed (JAX, pyEIT) are left out,
and the page says so. A limit is what no implementation can do without: the copy of the result.

Run: python benchmarks/speed.py [--quick] [--out docs/reference/speed.md]
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import _peers as peers
import growth
import numpy as np
from _kinks import FINDERS
from _protocol import Cell
from transitions import SEED, Score, score

import tacstrip as ts
from studies.sheet import Sheet, Touch, by_factor
from tacstrip.files import write_text
from tacstrip.network.strips.ladder import fast_readings

POSITIONAL = 0.004
NOISE = ts.Noise(positional=POSITIONAL)
DEFAULT = Path(__file__).parents[1] / "docs" / "reference" / "speed.md"
PICTURE = Path(__file__).parents[1] / "docs" / "pictures" / "growth.png"
Job = Callable[[], Any]


@dataclass(frozen=True)
class Contest:
    """One operation: our job, the peers', what the limit is and its job, and for how many results the times are."""

    name: str
    each: str
    count: int
    ours: Job
    peers: dict[str, tuple[Job | None, int]]
    limit: tuple[str, Job] | None = None


def in_turns(jobs: dict[str, Job], budget_s: float) -> dict[str, float]:
    """Return each job's least time [s], taken in turns, so that what else the machine does hits all alike."""
    took: dict[str, list[float]] = {name: [] for name in jobs}
    for job in jobs.values():
        job()
    begun = time.perf_counter()
    while min(map(len, took.values())) < 3 or time.perf_counter() - begun < budget_s:
        for name, job in jobs.items():
            start = time.perf_counter()
            job()
            took[name].append(time.perf_counter() - start)
    return {name: min(times) for name, times in took.items()}


def batches(scans: int) -> list[Contest]:
    """Simulate labelled scans of 100 strips: one thread against NumPy, all cores against JAX, which takes them."""
    sensor = ts.Sensor(construction="crs-crs", strips=100, pitch_mm=10.0, length_mm=1000.0, adc_bits=12)
    shapes, some = ts.Shapes(n=scans), max(scans // 20, 100)

    def ours(workers: int) -> ts.Scans:
        return ts.simulate_many(sensor, shapes, NOISE, rng=1, dtype="float32", workers=workers)

    result = ours(1)
    assert result.labels is not None
    arrays = [result["kh"], result["kl"], result.l, result.u, *vars(result.labels).values()]
    copy = ("copy of the result", lambda: [np.array(a) for a in arrays])
    cores = os.cpu_count() or 1
    rivals: list[tuple[int, str, tuple[Job | None, int]]] = [
        (1, "NumPy, vectorised", (peers.numpy_batch(sensor, shapes, POSITIONAL, some), some)),
        (cores, "JAX, compiled, one device", (peers.jax_batch(sensor, POSITIONAL, scans), scans)),
    ]
    name = "`simulate_many`, 100 strips, errors and labels, float32"
    return [
        Contest(f"{name}, threads: {threads}", "scan", scans, partial(ours, threads), {peer: job}, copy)
        for threads, peer, job in rivals
    ]


def footprints() -> Contest:
    """Find l and u of 200 polygons on 100 strips, against Shapely."""
    sensor = ts.Sensor(construction="crs-crs", strips=100, pitch_mm=10.0, length_mm=1000.0)
    drawn = ts.simulate_many(sensor, ts.Shapes(n=200), rng=1)
    contacts = [drawn.contact(i) for i in range(200)]
    l, u = ts.footprint(sensor, contacts)
    others: dict[str, tuple[Job | None, int]] = {"Shapely": (peers.shapely_footprints(sensor, contacts), 200)}
    copy = ("copy of the result", lambda: (l.copy(), u.copy()))
    return Contest(
        "`footprint`, 100 strips", "polygon", 200, partial(ts.footprint, sensor, contacts), others, copy
    )


def fits() -> Contest:
    """Fit a tetragon, against SciPy's least squares that starts near; both know the count."""
    sensor = ts.Sensor(construction="crs-crs", strips=100, pitch_mm=1.0, length_mm=100.0, adc_bits=12)
    corners = np.array([[12.0, 45.0], [50.0, 20.0], [88.0, 55.0], [40.0, 80.0]])
    scan = ts.simulate(sensor, ts.Contact.polygon(corners), ts.Noise(positional=0.002), rng=1)
    job = peers.scipy_fit(sensor, scan, corners)
    ours = partial(
        ts.fit_polygon, scan, sensor, ts.Noise(positional=0.002), vertices=4, bounded=False, assessment="none"
    )
    far = ours().objects[0].vertices
    theirs = job().x.reshape(4, 2)
    off = [np.linalg.norm(v[:, None] - corners, axis=2).min(axis=0).max() for v in (far, theirs)]
    name = f"SciPy `least_squares`, start given (worst corner off {off[1]:.2f} mm, ours {off[0]:.2f})"
    return Contest(
        "`fit_polygon` by least squares, 100 strips, both signatures, count given",
        "fit",
        1,
        ours,
        {name: (job, 1)},
    )


def kinks(quick: bool) -> list[str]:
    """Return a row per library that finds the kinks of a signature; `benchmarks/transitions.py` has more."""
    cell, methods = (
        Cell("kh", 0.005, 100),
        [m for m, (_, needs) in FINDERS.items() if not needs or find_spec(needs)],
    )
    found = score(cell, methods, 3 if quick else 60, SEED)
    ours = found.pop("polygon")

    def words(of: Score) -> str:
        right, off = 100.0 * np.mean(of.right), 100.0 * np.median(of.away)
        return f"count right in {right:.0f} %, off by {off:.2f} % of the width"

    own = float(np.median(ours.seconds))
    return [
        f"| the fit's search, k_h of 100 strips, count unknown ({words(ours)}) | {growth.words(own)} a signature | "
        f"{name} ({words(of)}) | {growth.words(float(np.median(of.seconds)))} | "
        f"{np.median(of.seconds) / own:.3g} | - |"
        for name, of in found.items()
    ]


def ladders(folder: Path) -> Contest:
    """Solve the network of 20 strips, against ngspice."""
    sensor = ts.Sensor(
        construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0, contact_lambda_mm=2.0
    )
    contact = ts.Contact.polygon([(0, 20), (50, 5), (100, 30), (100, 80), (40, 95), (0, 60)])
    others = {"ngspice": (peers.ngspice_scan(sensor, contact, 500, folder), 1)}
    ours = partial(fast_readings, sensor, contact, cells=500)
    return Contest("the strips' network, 20 strips of 1,000 nodes", "scan", 1, ours, others)


def sheets() -> Contest:
    """Factor and solve a sheet anew, against pyEIT's forward problem of as many nodes."""
    found = peers.pyeit_forward(2500)
    side = 50 if found is None else round(found[1] ** 0.5)
    middle = np.full(1, side // 2)
    touch = Touch(middle, middle, np.full(1, 0.7), np.full(1, 0.5))
    job = None if found is None else found[0]
    return Contest(
        f"a sheet of {side * side:,} nodes, factored and solved", "solution", 1,
        partial(by_factor, Sheet(side, side), touch), {"pyEIT, forward": (job, 1)},
    )  # fmt: skip


def contests(quick: bool, folder: Path) -> list[Contest]:
    """Return all of them."""
    return [*batches(4000 if quick else 20_000), footprints(), fits(), ladders(folder), sheets()]


def table(quick: bool) -> list[str]:
    """Return the lines of the table of peers, in Markdown."""
    lines = ["| operation | ours | peer | the peer's | times | limit |", "| --- " * 6 + "|"]
    missing = []
    with tempfile.TemporaryDirectory() as folder:
        for contest in contests(quick, Path(folder)):
            jobs = {"ours": contest.ours}
            jobs |= {name: job for name, (job, _) in contest.peers.items() if job is not None}
            missing += [name.partition(",")[0] for name, (job, _) in contest.peers.items() if job is None]
            if contest.limit:
                jobs["limit"] = contest.limit[1]
            took = in_turns(jobs, 0.3 if quick else 3.0)
            ours = took["ours"] / contest.count
            limit = "-"
            if contest.limit:
                limit = f"{took['ours'] / took['limit']:.1f} times the {contest.limit[0]}"
            for name, (job, count) in contest.peers.items():
                if job is not None:
                    theirs = took[name] / count
                    lines.append(
                        f"| {contest.name} | {growth.words(ours)} a {contest.each} | {name} | "
                        f"{growth.words(theirs)} | {theirs / ours:.3g} | {limit} |"
                    )
        lines += kinks(quick)
    missing += [m for m, (_, needs) in FINDERS.items() if needs and not find_spec(needs)]
    if missing:
        lines += ["", f"Not installed here, and so left out: {', '.join(missing)}."]
    return lines


def page(quick: bool, picture: Path, folder: Path) -> str:
    """Measure, draw, and return the page, whose links are from a folder."""
    found = growth.measure(quick)
    growth.draw(found, picture)
    load = f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "unknown"
    text = [
        "# Speed beside others, and growth",
        "",
        "How fast the main operations are beside other tools in the same run, and how their time grows with the size. "
        f"Written by `make bench`{' (quick)' if quick else ''}: Python {platform.python_version()}, NumPy "
        f"{np.__version__}, {platform.machine()}, {os.cpu_count()} cores, load {load}; least times of rounds, ours and "
        "peers' in turns. Times of single operations: [speed](../science/speed.md).",
        "",
        "## Beside others",
        "",
        *table(quick),
        "",
        "## Growth",
        "",
        "An exponent is the slope of the time in log-log scale over the upper half of the sizes: what every call costs "
        "makes it less than the algorithm's own.",
        "",
        f"![Time over strips, scans, corners, nodes and workers]({os.path.relpath(picture, folder)})",
        "",
        *growth.table(found),
        "",
    ]
    return "\n".join(text)


def main() -> None:
    """Write the page, or print the table of peers."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--quick", action="store_true", help="smaller, in a minute")
    options.add_argument("--out", type=Path, help="the page; without it the table of peers is printed")
    given = options.parse_args()
    if given.out is None:
        sys.stdout.write("\n".join(table(given.quick)) + "\n")
        return
    picture = PICTURE if given.out.resolve() == DEFAULT else given.out.with_suffix(".png")
    write_text(given.out, page(given.quick, picture, given.out.parent))


if __name__ == "__main__":
    main()
