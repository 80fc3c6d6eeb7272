"""Time of a live update of objects over time, beside the single-scan fit of the same scans, in one run.

An object slides and turns over 100 strips of 1 mm, k_h and k_l, .5 % noise. Every scan is given to a `Tracker` and to
`LiveTracks`; searches run in a thread of their own, as in the live pipeline, or at once and are then not counted.
Wanted: 99 % of the updates with a lag of 20 scans take at most 1.5 ms.

Run: python benchmarks/live_tracks.py [scans, 1500 by default]
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import numpy as np

import tacstrip as ts
from tacstrip.tracking import Tracker

SENSOR = ts.Sensor(construction="crs-crs", strips=100, pitch_mm=1.0, length_mm=100.0)
SHAPE = ts.Contact.polygon([(25, 34), (60, 24), (76, 54), (44, 74)])
NOISE = ts.Noise(positional=0.005)
RATE_HZ = 250.0


def contact(time_s: float) -> ts.Contact:
    """Return a quadrangle that wanders 6 mm and turns by 20 degrees, to and fro."""
    return SHAPE.moved(6.0 * math.sin(0.7 * time_s), 4.0 * math.sin(1.1 * time_s)).turned(
        0.35 * math.sin(0.5 * time_s)
    )


_Result = TypeVar("_Result")


def main() -> None:
    """Print percentiles of the time of an update, by the wall clock and of this thread alone."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 1500
    scans = [
        ts.simulate(SENSOR, contact(i / RATE_HZ), NOISE, rng=i, time_s=i / RATE_HZ) for i in range(count)
    ]
    print("| searches | lag | what | clock | median | 99 % | 99.9 % |")
    print("| --- " * 7 + "|")
    for lag in (5, 20, 50):
        _run(scans, lag, at_once=True)
    _run(scans, 20, at_once=False)


def _run(scans: list[ts.Scan], lag: int, at_once: bool) -> None:
    with ThreadPoolExecutor(1) as single, ThreadPoolExecutor(1) as fusing:
        tracker = Tracker(SENSOR, noise=NOISE, executor=single)
        live = ts.LiveTracks(SENSOR, NOISE, lag, None if at_once else fusing)
        times: dict[str, list[tuple[float, float]]] = {"single-scan fit": [], "all scans": []}
        begun = time.perf_counter()
        tracks: tuple[ts.LiveTrack, ...] = ()
        for i, scan in enumerate(scans):
            if not at_once:  # searches have the time that they have live
                time.sleep(max(0.0, begun + i / RATE_HZ - time.perf_counter()))
            times["single-scan fit"].append(_timed(lambda: tracker.update(scan))[0])  # noqa: B023
            before = live.searches
            took, tracks = _timed(lambda: live.update(scan))  # noqa: B023
            if not at_once or live.searches == before:
                times["all scans"].append(took)
    where = "at once" if at_once else "in a thread"
    for what, both in times.items():
        for clock, values in zip(("wall", "thread"), 1e3 * np.array(both).T, strict=True):
            shown = " | ".join(f"{q:.2f}" for q in np.quantile(values, [0.5, 0.99, 0.999]))
            print(f"| {where} | {lag} | {what} | {clock} | {shown} |", flush=True)
    (one,) = tracks
    print(
        f"{one.status}, {one.scans} scans, corners known to {one.corner_deviation_mm:.3f} mm", file=sys.stderr
    )


def _timed(job: Callable[[], _Result]) -> tuple[tuple[float, float], _Result]:
    wall, own = time.perf_counter(), time.thread_time()
    found = job()
    return (time.perf_counter() - wall, time.thread_time() - own), found


if __name__ == "__main__":
    main()
