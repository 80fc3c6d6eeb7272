"""Live at 1 kHz, 100 strips, double measurement, through a pty, on one core: scans lost, latency, memory.

A virtual device runs in a process of its own and writes each scan when it is due. This process,
held to one core, reads, decodes, reconstructs and records. The latency is given twice: from
when the last byte was read, and from when the scan was due, less its minimum: with
what the device's process and the line add.
Wanted for 10 minutes: no scan lost, latency 1 ms (median) and 3 ms (99 %) at most, memory flat.

Run: python benchmarks/live.py [seconds, 60 by default, 600 for the whole]
"""

from __future__ import annotations

import gc
import itertools
import math
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import tacstrip as ts
from tacstrip.stream.device.port import SerialPort
from tacstrip.stream.device.source import SerialSource
from tacstrip.stream.device.virtual import PtyDevice, VirtualDevice
from tacstrip.stream.live.pipeline import Live
from tacstrip.stream.live.warmup import warm_up

RATE_HZ = 1000.0
SENSOR = ts.Sensor(construction="crs-crs", strips=100, pitch_mm=1.0, length_mm=100.0, adc_bits=12)
SHAPE = ts.Contact.polygon([(20, 38), (60, 20), (78, 56), (42, 76)])
NOISE = ts.Noise(positional=0.002)
MADE = 20_000  # scans, that the device sends forwards and backwards


def contact(time_s: float) -> ts.Contact:
    """Return a quadrangle that wanders 6 mm and turns by 20 degrees, to and fro."""
    return SHAPE.moved(6.0 * math.sin(0.7 * time_s), 4.0 * math.sin(1.1 * time_s)).turned(
        0.35 * math.sin(0.5 * time_s)
    )


def device() -> None:
    """Be the device until the input ends, on the cores that the host leaves."""
    if hasattr(os, "sched_setaffinity") and len(cores := os.sched_getaffinity(0)) > 1:
        os.sched_setaffinity(0, cores - {min(cores)})
    source = ts.SimulatedSource(SENSOR, contact, RATE_HZ, MADE, NOISE)
    scans = list(source)  # a device has no contact to work out, so it is done before, not in between
    there_and_back = [*scans, *scans[-2:0:-1]]
    virtual = VirtualDevice(SENSOR, lambda: itertools.cycle(there_and_back), RATE_HZ, 0.5 / RATE_HZ)
    gc.freeze()
    with PtyDevice(virtual) as served:
        print(served.path, flush=True)
        sys.stdin.read()
    print(virtual.hello.late, flush=True)


def memory_mb() -> float:
    """Return what this process holds now [MB]."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def host(path: str, seconds: float, file: Path) -> None:
    """Read the device for some seconds and say how it went."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    warm_up(SENSOR)
    source = SerialSource(lambda: SerialPort(path), SENSOR, on_message=print)
    live = Live(source, on_message=print)
    latency, due = np.full((2, int(1.2 * RATE_HZ * seconds)), np.nan)  # takes its memory now
    count, held = 0, [0.0]
    with live:
        live.record(file)
        box = live.subscribe(4096)
        used, start = time.process_time(), time.monotonic()
        while (passed := time.monotonic() - start) < seconds:
            if (frame := box.get(0.5)) is not None:
                latency[count] = frame.latency_s
                due[count] = frame.ready_s - frame.raw.time_s  # and an offset between two clocks
                count += 1
            if passed >= len(held) * seconds / 7.0:
                held.append(memory_mb())
        used = time.process_time() - used
    counts = source.counts
    latency, due = latency[:count], due[:count]
    due += latency.min() - due.min()
    saved = sum(1 for _ in ts.Recording(file))
    print(
        f"{seconds:g} s: {live.frames} scans, {counts.lost} lost, {counts.corrupt} corrupt; {saved} recorded"
    )
    for what, values in {"its last byte was read": latency, "it was due at the device": due}.items():
        p50, p99, p999, worst = 1e3 * np.quantile(values, [0.5, 0.99, 0.999, 1.0])
        print(f"from when {what} to the polygon: {p50:.2f} ms (median), {p99:.2f} (99 %), {p999:.2f} (99.9 %), "
              f"{worst:.2f} (worst)")  # fmt: skip
    print(f"{live.late} scans recorded without a polygon, {box.dropped} not looked at")
    print(f"{100.0 * used / seconds:.0f} % of one core; load of the computer {os.getloadavg()[0]:.1f}")
    print("memory: " + ", ".join(f"{m:.1f}" for m in held[1:]) + " MB, six times, evenly spread")


def main() -> None:
    """Run the device in another process, and the host here."""
    if sys.argv[1:] == ["device"]:
        device()
        return
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 60.0
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    child = subprocess.Popen(
        [sys.executable, __file__, "device"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=environment,
    )
    assert child.stdin is not None
    assert child.stdout is not None
    with tempfile.TemporaryDirectory() as folder:
        host(child.stdout.readline().strip(), seconds, Path(folder) / "a.mcap")
    child.stdin.close()
    print(f"the device was late for {child.stdout.read().strip()} scans, which it left out")
    child.wait()


if __name__ == "__main__":
    main()
