"""Time of a live update of objects over time, beside the single-scan fit of the same scans, in one run.

An object slides and turns over 100 strips of 1 mm, k_h and k_l, .5 % noise. Every scan is given to a `Tracker` and to
`LiveTracks`; searches run in a thread of their own, as in the live pipeline, or at once and are then not counted.
Wanted: 99 % of the updates with a lag of 20 scans take at most 1.5 ms.

With --scenes: random shapes on random ways (`benchmarks/tracks.py`), the live outline beside that of `track` from the
same scans, and its squared error normalised by its covariance over its degrees of freedom: 1 where that is honest.

Run: python benchmarks/live_tracks.py [--scans 1500], or --scenes 12 [--strips 10] [--seed 1] [--at 48 72 150]
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import numpy as np
import tracks

import tacstrip as ts
from tacstrip.arrays import FloatArray
from tacstrip.tracking import Tracker

Found = TypeVar("Found")
SENSOR = ts.Sensor(construction="crs-crs", strips=100, pitch_mm=1.0, length_mm=100.0)
SHAPE = ts.Contact.polygon([(25, 34), (60, 24), (76, 54), (44, 74)])
NOISE = ts.Noise(positional=0.005)
RATE_HZ = 250.0


def contact(time_s: float) -> ts.Contact:
    """Return a quadrangle that wanders 6 mm and turns by 20 degrees, to and fro."""
    return SHAPE.moved(6.0 * math.sin(0.7 * time_s), 4.0 * math.sin(1.1 * time_s)).turned(
        0.35 * math.sin(0.5 * time_s)
    )


def main() -> None:
    """Print percentiles of the time of an update, by the wall clock and of this thread alone; or agreement."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--scans", type=int, default=1500)
    options.add_argument("--scenes", type=int, default=0)
    options.add_argument("--strips", type=int, default=10)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--at", type=int, nargs="+", default=[48, 72, 150])
    given = options.parse_args()
    if given.scenes:
        _agree(given.scenes, given.strips, given.seed, given.at)
        return
    count = given.scans
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
        found: tuple[ts.LiveTrack, ...] = ()
        for i, scan in enumerate(scans):
            if not at_once:  # searches have the time that they have live
                time.sleep(max(0.0, begun + i / RATE_HZ - time.perf_counter()))
            times["single-scan fit"].append(_timed(lambda: tracker.update(scan))[0])  # noqa: B023
            before = live.searches
            took, found = _timed(lambda: live.update(scan))  # noqa: B023
            if not at_once or live.searches == before:
                times["all scans"].append(took)
    where = "at once" if at_once else "in a thread"
    for what, both in times.items():
        for clock, values in zip(("wall", "thread"), 1e3 * np.array(both).T, strict=True):
            shown = " | ".join(f"{q:.2f}" for q in np.quantile(values, [0.5, 0.99, 0.999]))
            print(f"| {where} | {lag} | {what} | {clock} | {shown} |", flush=True)
    (one,) = found
    print(
        f"{one.status}, {one.scans} scans, corners known to {one.corner_deviation_mm:.3f} mm", file=sys.stderr
    )


def _timed(job: Callable[[], Found]) -> tuple[tuple[float, float], Found]:
    wall, own = time.perf_counter(), time.thread_time()
    found = job()
    return (time.perf_counter() - wall, time.thread_time() - own), found


def _agree(scenes: int, strips: int, seed: int, marks: list[int]) -> None:
    """Print how well live outlines do beside those of all scans at once."""
    sensor = ts.Sensor(construction="crs-crs", strips=strips, pitch_mm=100.0 / strips, length_mm=100.0)
    random = np.random.default_rng([seed, strips])
    rows: dict[int, list[tuple[float, float, float]]] = {mark: [] for mark in marks}
    for _ in range(scenes):
        shape, placed = _scene(random, strips, marks[-1])
        live, scans = ts.LiveTracks(sensor, NOISE), []
        for i, corners in enumerate(placed):
            number = int(random.integers(1 << 30))
            contact = ts.Contact.polygon(corners)
            scans.append(ts.simulate(sensor, contact, NOISE, rng=number, time_s=0.01 * i))
            found = live.update(scans[-1])
            if len(scans) in rows:
                batch, one = ts.track(scans, sensor, NOISE)[0], found[0] if found else None
                own = math.nan if one is None else tracks._error(one.outline, shape)
                square = math.nan if math.isnan(own) or one is None else _normalised(one, shape)
                rows[len(scans)].append((own, tracks._error(batch.outline, shape), square))
    print("| scans | count, live | at once | RMS, live | at once | ratio, median | normalised square |")
    print("| --- " * 7 + "|")
    for mark, measured in rows.items():
        own, whole, square = np.array(measured).T
        both = np.isfinite(own) & np.isfinite(whole)
        print(
            f"| {mark} | {np.isfinite(own).mean():.2f} | {np.isfinite(whole).mean():.2f} | {np.median(own[both]):.3f} "
            f"| {np.median(whole[both]):.3f} | {np.median(own[both] / whole[both]):.2f} | {np.nanmean(square):.2f} |"
        )


def _scene(random: np.random.Generator, strips: int, scans: int) -> tuple[FloatArray, FloatArray]:
    """Return corners (N, 2), and these on their way (scans, N, 2)."""
    while True:
        shape = tracks._polygon(random, (22.0, 30.0) if strips < 20 else (14.0, 20.0))
        placed = np.array([tracks._at(shape, pose) for pose in tracks._way(random, scans, "any", 0.0)])
        if placed.min() > 1.0 and placed.max() < 99.0:
            return shape, placed


def _normalised(one: ts.LiveTrack, true: FloatArray) -> float:
    """Return the squared error over its variance and degrees of freedom."""
    best, wanted = (math.inf, 0.0), true - true.mean(axis=0)
    assert one.covariance is not None
    for shift in range(len(true)):
        own = np.roll(one.outline - one.outline.mean(axis=0), shift, axis=0)
        u, _, v = np.linalg.svd(wanted.T @ own)
        off = (own - wanted @ u @ np.diag([1.0, np.sign(np.linalg.det(u @ v))]) @ v).ravel()
        value, vector = np.linalg.eigh(np.roll(one.covariance, (2 * shift, 2 * shift), axis=(0, 1)))
        kept = value > 1e-9 * value.max()
        square = float(((off @ vector[:, kept]) ** 2 / value[kept]).sum() / kept.sum())
        best = min(best, (float(off @ off), square))
    return best[1]


if __name__ == "__main__":
    main()
