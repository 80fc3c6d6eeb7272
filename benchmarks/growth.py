"""How time and memory grow with strips, scans, corners, nodes and workers: a table, exponents, and log-log plots.

Times are processor times of the process, the least of some rounds. An exponent is the slope of the line through the
upper half of the points, where what every call costs no longer counts. Wanted: no exponent above the algorithm's own
(strips 1, scans 1, nodes of a sheet 1.5), and memory flat in the number of scans.

Run: python benchmarks/growth.py [--quick] [--picture growth.png]
"""

from __future__ import annotations

import argparse
import sys
import time
import tracemalloc
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.ticker import NullLocator

import tacstrip as ts
from studies.sheet import Sheet, Touch, by_factor
from tacstrip.geometry.outline import Outline
from tacstrip.network.strips.ladder import fast_readings
from tacstrip.plot.theme import COLOURS, legend_above, new_panels, plain_ticks, save

NOISE = ts.Noise(positional=0.004)
_COLOURS = [*COLOURS.values(), "#b8860b"]
PIECE = 50_000  # scans that are in memory at once


@dataclass(frozen=True)
class Grown:
    """What an operation took [s] over a size, and the exponent of its algorithm."""

    over: str
    name: str
    sizes: tuple[int, ...]
    took_s: tuple[float, ...]
    own: float
    megabytes: tuple[float, ...] = ()

    @property
    def exponent(self) -> float:
        """The slope over the upper half of the sizes."""
        upper = slice(-max(2, (len(self.sizes) + 1) // 2), None)
        return float(np.polyfit(np.log(self.sizes[upper]), np.log(self.took_s[upper]), 1)[0])


def least(
    job: Callable[[], object], budget_s: float = 0.3, clock: Callable[[], float] = time.process_time
) -> float:
    """Return the least time of a job [s], of two rounds and of as many as the budget allows."""
    found: list[float] = []
    while len(found) < 2 or (sum(found) < budget_s and len(found) < 200):
        begun = clock()
        job()
        found.append(max(clock() - begun, 1e-9))
    return min(found)


def a_sensor(strips: int) -> ts.Sensor:
    """Return a sensor of 1 m by 1 m."""
    return ts.Sensor(
        construction="crs-crs", strips=strips, pitch_mm=1000.0 / strips, length_mm=1000.0, adc_bits=16
    )


def drawn(strips: int, corners: int = 5, scans: int = 8) -> tuple[ts.Sensor, ts.Scans, list[ts.Contact]]:
    """Return a sensor, scans of polygons, and the contacts that made them."""
    sensor = a_sensor(strips)
    scans_ = ts.simulate_many(sensor, ts.Shapes(n=scans, corners=corners), NOISE, rng=1)
    return sensor, scans_, [scans_.contact(i) for i in range(scans)]


def batch_of(
    sensor: ts.Sensor, scans: int, corners: int | tuple[int, int] = (3, 8), workers: int = 1
) -> None:
    """Simulate scans with labels, a piece after the other."""
    for first in range(0, scans, PIECE):
        shapes = ts.Shapes(n=min(PIECE, scans - first), corners=corners)
        ts.simulate_many(sensor, shapes, NOISE, rng=1, dtype="float32", first=first, workers=workers)


def over_strips(strips: int) -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield what is timed over strips."""
    sensor, scans, contacts = drawn(strips)
    outline = Outline.of(contacts[0].vertices)
    yield "simulate_many, 500 scans", partial(batch_of, sensor, 500)
    yield "footprint, 8 polygons", partial(ts.footprint, sensor, contacts)
    yield "simulate, a scan", partial(ts.simulate, sensor, contacts[0], NOISE, rng=1)
    yield "profile_reconstruction", partial(ts.profile_reconstruction, scans[0], sensor)
    yield "vertex_covariance (bound)", partial(ts.vertex_covariance, outline, sensor, 0.002)
    yield "fit_polygon", partial(ts.fit_polygon, scans[0], sensor, NOISE, assessment="none")


def over_corners(corners: int) -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield what is timed over corners."""
    sensor, scans, contacts = drawn(300, corners)
    yield "simulate_many, 500 scans", partial(batch_of, sensor, 500, corners)
    yield "footprint, 8 polygons", partial(ts.footprint, sensor, contacts)
    yield (
        "vertex_covariance (bound)",
        partial(ts.vertex_covariance, Outline.of(contacts[0].vertices), sensor, 0.002),
    )
    yield "fit_polygon", partial(ts.fit_polygon, scans[0], sensor, NOISE, assessment="none")


def over_nodes(nodes: int) -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield what is timed over nodes: a square sheet, and the strips' ladders."""
    side = round(nodes**0.5)
    middle = np.full(1, side // 2)
    touch = Touch(middle, middle, np.full(1, 0.7), np.full(1, 0.5))
    yield "a sheet, factored", partial(by_factor, Sheet(side, side), touch)
    sensor, _, contacts = drawn(10)
    lossy = replace(sensor, contact_lambda_mm=20.0)
    yield "ladders of 10 strips", partial(fast_readings, lossy, contacts[0], cells=nodes // 20)


def grown(
    over: str,
    sizes: Sequence[int],
    jobs: Callable[[int], Iterator[tuple[str, Callable[[], object]]]],
    own: dict[str, float],
    budget_s: float,
) -> list[Grown]:
    """Time every operation over all sizes."""
    took: dict[str, list[float]] = {}
    for size in sizes:
        for name, job in jobs(size):
            took.setdefault(name, []).append(least(job, budget_s))
    return [Grown(over, name, tuple(sizes), tuple(t), own.get(name, 1.0)) for name, t in took.items()]


def over_scans(most: int, budget_s: float) -> Grown:
    """Time batches of 100 strips in pieces over scans, and see how much memory they take [MB]."""
    sensor, sizes = a_sensor(100), [10**i for i in range(len(str(most)))]
    took = [least(partial(batch_of, sensor, n), budget_s) for n in sizes]
    peaks = []
    for n in sizes:
        tracemalloc.start()
        batch_of(sensor, n)
        peaks.append(tracemalloc.get_traced_memory()[1] / 1e6)
        tracemalloc.stop()
    return Grown("scans", "simulate_many, 100 strips", tuple(sizes), tuple(took), 1.0, tuple(peaks))


def over_workers(budget_s: float) -> Grown:
    """Time batches on more threads, by the clock: the exponent of as many cores would be -1."""
    sensor, workers = a_sensor(100), (1, 2, 4)
    took = [least(partial(batch_of, sensor, 40_000, workers=w), budget_s, time.perf_counter) for w in workers]
    return Grown("workers", "simulate_many, 40,000 scans", workers, tuple(took), -1.0)


def measure(quick: bool) -> list[Grown]:
    """Measure all of it; quick: smaller, in half a minute."""
    budget_s = 0.05 if quick else 0.5
    strips = (10, 100, 1000) if quick else (10, 30, 100, 300, 1000, 3000, 10_000)
    nodes = (1000, 10_000) if quick else (1000, 3000, 10_000, 30_000, 100_000, 300_000, 1_000_000)
    own = {"fit_polygon": 3.0, "vertex_covariance (bound)": 2.0}
    return [
        *grown("strips", strips, over_strips, {}, budget_s),
        over_scans(10_000 if quick else 1_000_000, budget_s),
        *grown("corners", (3, 4, 6, 8, 12), over_corners, own, budget_s),
        *grown("nodes", nodes, over_nodes, {"a sheet, factored": 1.5}, 0.0),
        over_workers(budget_s),
    ]  # fmt: skip


def table(all_grown: Sequence[Grown]) -> list[str]:
    """Return the lines of a table in Markdown."""
    lines = [
        "| over | operation | sizes | least to greatest | exponent | the algorithm's |",
        "| --- " * 6 + "|",
    ]
    for g in all_grown:
        sizes = f"{g.sizes[0]:,} to {g.sizes[-1]:,}"
        took = f"{words(g.took_s[0])} to {words(g.took_s[-1])}"
        lines.append(f"| {g.over} | {g.name} | {sizes} | {took} | {g.exponent:.2f} | {g.own:g} |")
    lines.append("")
    for g in all_grown:
        if g.megabytes:
            peaks = ", ".join(f"{m:.3g}" for m in g.megabytes)
            lines.append(
                f"Memory of {g.name} over {g.sizes[0]:,} to {g.sizes[-1]:,} {g.over}, {PIECE:,} at a time: {peaks} MB."
            )
    return lines


def words(seconds: float) -> str:
    """Write a time in the unit that reads best."""
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6)):
        if seconds >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds * 1e9:.3g} ns"


def draw(all_grown: Sequence[Grown], file: Path) -> None:
    """Draw time over size, a panel for each of what grows."""
    overs = list(dict.fromkeys(g.over for g in all_grown))
    rows = -(-len(overs) // 2)
    figure, panels = new_panels(7.0, 3.3 * rows, rows, 2)
    for axes in panels[len(overs) :]:
        axes.axis("off")
    for axes, over in zip(panels, overs, strict=False):
        for g, colour in zip((g for g in all_grown if g.over == over), _COLOURS, strict=False):
            axes.plot(
                g.sizes, g.took_s, "o-", color=colour, markersize=3.5, label=f"{g.name}: {g.exponent:.2f}"
            )
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlabel(over)
        axes.set_ylabel("time [s]")
        legend_above(axes, 1)
        plain_ticks(axes.yaxis)
        sizes = sorted({size for g in all_grown if g.over == over for size in g.sizes})
        axes.set_xticks(sizes[:: -(-len(sizes) // 4)], [f"{s:,}" for s in sizes[:: -(-len(sizes) // 4)]])
        axes.xaxis.set_minor_locator(NullLocator())
    save(figure, file)


def main() -> None:
    """Print the table, and draw where asked."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--quick", action="store_true")
    options.add_argument("--picture", type=Path)
    given = options.parse_args()
    found = measure(given.quick)
    sys.stdout.write("\n".join(table(found)) + "\n")
    if given.picture:
        draw(found, given.picture)


if __name__ == "__main__":
    main()
