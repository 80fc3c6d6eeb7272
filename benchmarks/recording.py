"""Recording 100 strips, double measurement, at 1 kHz on one core: time, memory, disk, scans lost.

Wanted for 10 minutes: no scan lost, under 100 MB of memory, under 150 MB on disk. The first scene records all of the
600,000 scans, as fast as it goes, and reads them back; the others record a tenth and are multiplied by ten. The last
records at the real pace, with the shapes of Profile Reconstruction, and the very last with and without `durable`, in
the folder for temporary files: set TMPDIR to one of the disk that is to be measured.

Run: python benchmarks/recording.py [seconds of the first scene]
or at the real pace for 10 minutes: python benchmarks/recording.py 600 paced
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import tacstrip as ts
from tacstrip.simulation import readings
from tacstrip.stream import Drag, RawScan, Shape, paced
from tacstrip.stream.codes import top_code
from tacstrip.stream.recording import mcap_file
from tacstrip.stream.recording.recorder import with_shapes

STRIPS, RATE_HZ, BLOCK = 100, 1000, 200
SENSOR = ts.Sensor(construction="crs-crs", strips=STRIPS, pitch_mm=1.0, length_mm=100.0, adc_bits=12)
TEN_MINUTES = 600.0
SCENES = {  # name: strips touched, half-width of the noise over Vref, corners stored, seconds (0: as asked)
    "60 strips touched, +-0.2 %, a polygon of 4 corners a scan": (60, 0.002, True, 0.0),
    "60 strips touched, +-0.2 %, codes alone": (60, 0.002, False, 60.0),
    "100 strips touched, +-0.2 %, a polygon of 4 corners a scan": (100, 0.002, True, 60.0),
    "100 strips touched, +-0.05 %, a polygon of 4 corners a scan": (100, 0.0005, True, 60.0),
}
PACED_S = 20.0


def scans(touched: int, noise: float, corners: bool, count: int) -> Iterator[RawScan]:
    """Make scans of a tetragon that moves at 20 mm/s, every one with errors of its own."""
    half, random = touched / 2.0, np.random.default_rng(1)
    shape = np.array([(-half, -5.0), (0.0, -30.0), (half, 5.0), (5.0, 30.0)]) + 50.0
    top = top_code(SENSOR)
    for start in range(0, count, BLOCK):
        times = np.arange(start, min(start + BLOCK, count)) / RATE_HZ
        lift = 10.0 * np.sin(2.0 * times)
        contact = ts.Contact.polygon(shape)
        touch = ts.footprint(SENSOR, [contact.moved(0.0, dy) for dy in lift])
        values = readings(SENSOR, touch.l, touch.u, ts.Noise(positional=noise), random)
        codes = {name: np.nan_to_num(np.round(v * top)).astype("<u2") for name, v in values.items()}
        there = ~np.isnan(touch.l)
        for i, time_s in enumerate(times.tolist()):
            found = shape + np.array((0.0, lift[i])) + random.normal(0.0, 0.05, shape.shape)
            shapes = (Shape("ok", found),) if corners else ()
            row = {name: v[i] for name, v in codes.items()}
            yield RawScan(time_s, row, there[i], start + i, shapes=shapes)


def full_speed(scene: str, path: Path, seconds: float) -> None:
    """Record one scene and read it back."""
    touched, noise, corners, own_s = SCENES[scene]
    seconds = own_s or seconds
    count, times = round(seconds * RATE_HZ), TEN_MINUTES / seconds
    start = time.perf_counter()
    for _ in scans(touched, noise, corners, count):
        pass
    making = time.perf_counter() - start
    start, used = time.perf_counter(), time.process_time()
    with ts.Recorder(path, SENSOR, ("kh", "kl"), 0) as recorder:
        ts.record(scans(touched, noise, corners, count), recorder)
    took, used = time.perf_counter() - start, time.process_time() - used
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000.0
    size = path.stat().st_size / 1e6
    read, last, polygons = 0, -1, 0
    for raw in ts.Recording(path):
        read += raw.sequence == last + 1
        last = raw.sequence
        polygons += len(raw.shapes or ())
    said = "" if times == 1.0 else f" (x {times:g} = {size * times:.0f} MB for 10 minutes)"
    print(f"{scene}: {count} scans")
    print(f"  disk {size:.1f} MB{said}, memory at most {memory:.0f} MB")
    print(f"  {took:.1f} s, {used:.1f} s of a core, {making:.1f} s of it for making the scans; "
          f"{1e6 * (used - making) / count:.0f} us a scan, real time is 1000")  # fmt: skip
    print(f"  read back: {read} scans in order, {polygons} polygons, {count - read} lost")


def durable(path: Path, seconds: float) -> None:
    """Record in real time, as is and for power cuts, by turns: what waiting for the disk costs."""
    count = round(seconds * RATE_HZ)
    made = list(scans(60, 0.002, True, count))
    for sync_s in (None, mcap_file.SYNC_S, 0.0):
        mcap_file.SYNC_S = sync_s or 0.0
        waits, took = 0.0, np.zeros(count)
        used = time.process_time()
        with ts.Recorder(path, SENSOR, ("kh", "kl"), 0, force=True, durable=sync_s is not None) as recorder:
            for number, raw in enumerate(paced(made, idle=recorder.idle)):
                start = time.perf_counter()
                recorder.add(raw)
                took[number] = time.perf_counter() - start
        used, waits = time.process_time() - used, took.sum()
        how = (
            "not durable"
            if sync_s is None
            else f"durable, a wait every {sync_s:g} s"
            if sync_s
            else "every block"
        )
        print(f"{how}: {100.0 * used / seconds:.1f} % of a core, {100.0 * waits / seconds:.1f} % of the time in the "
              f"recorder, at worst {1e3 * took.max():.0f} ms for a scan")  # fmt: skip


def at_real_pace(path: Path, seconds: float) -> None:
    """Record at the real pace: simulated sensor, Profile Reconstruction, recorder, all on one core."""
    contact = ts.Contact.polygon([(-30, -5), (0, -30), (30, 5), (5, 30)])
    drag = Drag(contact, [(50, 40), (50, 60)], 1.0)
    count = round(seconds * RATE_HZ)
    source = ts.SimulatedSource(SENSOR, drag, RATE_HZ, count, ts.Noise(positional=0.002))
    late: list[float] = []
    start, used = time.monotonic(), time.process_time()
    with ts.Recorder(path, SENSOR, source.names, source.origin_ns) as recorder:
        for raw in paced(with_shapes(source, SENSOR, "profile"), idle=recorder.idle):
            recorder.add(raw)
            late.append(time.monotonic() - start - raw.time_s)
    used = time.process_time() - used
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000.0
    size = path.stat().st_size / 1e6
    read = sum(1 for _ in ts.Recording(path))
    p50, p99, worst = np.quantile(late, [0.5, 0.99, 1.0]) * 1e3
    print(f"at the real pace, {seconds:g} s, with profiles of 60 strips (120 corners): {count} scans")
    print(f"  {100.0 * used / seconds:.0f} % of a core, memory at most {memory:.0f} MB, {count - read} lost")
    print(f"  recorded {p50:.2f} ms (median), {p99:.2f} ms (99 %), {worst:.2f} ms (worst) after its time")
    print(
        f"  disk {size:.1f} MB (x {TEN_MINUTES / seconds:g} = {size * TEN_MINUTES / seconds:.0f} MB for 10 minutes)"
    )


def main() -> None:
    """Run every scene in a process of its own, on one core; or, asked by name, one of them here."""
    if len(sys.argv) == 3:
        if hasattr(os, "sched_setaffinity"):
            os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "a.mcap"
            if sys.argv[2] in SCENES:
                full_speed(sys.argv[2], path, float(sys.argv[1]))
            elif sys.argv[2] == "durable":
                durable(path, float(sys.argv[1]))
            else:
                at_real_pace(path, float(sys.argv[1]))
        return
    seconds = sys.argv[1] if len(sys.argv) > 1 else str(TEN_MINUTES)
    one_thread = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    for scene in (*SCENES, "paced", "durable"):
        lasts = seconds if scene in SCENES else str(PACED_S)
        subprocess.run([sys.executable, __file__, lasts, scene], check=True, env=one_thread)


if __name__ == "__main__":
    main()
