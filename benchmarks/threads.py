"""`fit_polygons` on one thread and on two, in turn; the least of many rounds counts.

Two threads want two cores that do nothing else, and that are two: of virtual ones that share a real one each gets
little more than half. So each line says too, of the same run, how many times as much two threads get done of a C loop
that touches no memory (the machine), and of the core alone, without any Python; and the fits' share of the machine's.
How much of a fit's processor time is spent in calls during which other Python threads run bounds what they can gain
too: of a share s two are at most 1 / (1 - s) times as fast, and twice.

Run: python benchmarks/threads.py [--seconds 10]
"""

from __future__ import annotations

import argparse
import ctypes
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import tacstrip as ts
from tacstrip.core import binding
from tacstrip.reconstruction.polygon.estimate import fit_polygons
from tacstrip.reconstruction.polygon.run import RunReadings, fit_runs

CONTACT = ts.Contact.polygon([(100, 400), (350, 200), (800, 250), (850, 600), (500, 800)])
SCANS, SIGMA = 64, 0.0023
# Eight sums side by side keep a processor's arithmetic busy, as the core's lanes do, and never leave its registers.
LOOP = """
double work(long long steps) {
  double a = 1, b = 2, c = 3, d = 4, e = 5, f = 6, g = 7, h = 8, by = 0.999999, more = 1e-6;
  for (long long i = 0; i < steps; i++) {
    a = a * by + more; b = b * by + more; c = c * by + more; d = d * by + more;
    e = e * by + more; f = f * by + more; g = g * by + more; h = h * by + more;
  }
  return a + b + c + d + e + f + g + h;
}
"""
STEPS = 1_000_000


def c_loop() -> Callable[[], object]:
    """Return a C loop that leaves memory and Python alone; ctypes lets go of the lock meanwhile."""
    sys.path.append(str(Path(__file__).parents[1] / "tools"))
    import build_core

    compiler = build_core.cc()
    if compiler is None:
        raise SystemExit("what two threads gain on this machine is measured in C: install a compiler")
    with tempfile.TemporaryDirectory() as folder:
        source, library = Path(folder, "loop.c"), Path(folder, f"loop{build_core.SUFFIX}")
        source.write_text(LOOP, encoding="utf-8")
        compiler.compile(library, [source], (*build_core.FAST, *build_core.SHARED[:2]))
        work = ctypes.CDLL(str(library)).work
    work.restype, work.argtypes = ctypes.c_double, [ctypes.c_longlong]
    return partial(work, STEPS)


def unlocked_share(work: Callable[[], object]) -> float:
    """Return the share of processor time in the core's calls that let other threads run; the most of five."""
    inside, exported = [0.0], binding.exported

    def timed(name: str) -> Any:
        function = exported(name)
        if function is None or name not in binding._LONG:
            return function

        def call(*given: Any) -> Any:
            begun = time.thread_time()
            result = function(*given)
            inside[0] += time.thread_time() - begun
            return result

        return call

    modules = [m for m in sys.modules.values() if getattr(m, "exported", None) is exported]
    shares = []
    for _ in range(5):
        inside[0] = 0.0
        for module in modules:
            module.exported = timed  # type: ignore[attr-defined]
        begun = time.thread_time()
        work()
        shares.append(inside[0] / (time.thread_time() - begun))
        for module in modules:
            module.exported = exported  # type: ignore[attr-defined]
    return max(shares)


def at_once(work: Callable[[], object]) -> None:
    """Do the same work in two threads at once."""
    other = threading.Thread(target=work)
    other.start()
    work()
    other.join()


def main() -> None:
    """Print milliseconds per scan, their ratio, and what bounds it."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--seconds", type=float, default=10.0, help="per line")
    seconds = options.parse_args().seconds
    loop = c_loop()
    print(
        "| strips | noise | ms, one thread | two | times as fast | without the lock, % | at most | the core alone "
        "| the machine | of that, % |"
    )
    print("| --- " * 10 + "|")
    for strips in (100, 1000):
        sensor = ts.Sensor(
            construction="crs-crs", strips=strips, pitch_mm=1000.0 / strips, length_mm=1000.0, adc_bits=12
        )
        for distribution in ("normal", "uniform"):
            noise = ts.Noise(positional=0.004, distribution=distribution)
            scans = [ts.simulate(sensor, CONTACT, noise, rng=seed) for seed in range(SCANS)]
            runs = [
                RunReadings(sensor.x_mm[run], {name: scan[name][run] for name in scan.signatures}, SIGMA)
                for scan in scans
                for run in scan.runs()
            ]
            core = partial(fit_runs, sensor, runs)
            jobs: list[Callable[[], object]] = [
                partial(fit_polygons, scans, sensor, noise, workers=n) for n in (1, 2)
            ]
            jobs += [core, partial(at_once, core), loop, partial(at_once, loop)]
            least, end = [float("inf")] * len(jobs), time.perf_counter() + seconds
            while time.perf_counter() < end:
                for i, job in enumerate(jobs):
                    begun = time.perf_counter()
                    job()
                    least[i] = min(least[i], time.perf_counter() - begun)
            one, two = (1e3 * value / SCANS for value in least[:2])
            ratio, share = one / two, unlocked_share(lambda: fit_polygons(scans, sensor, noise))  # noqa: B023
            most = min(2.0, 1.0 / (1.0 - share))
            times = f"{one:.2f} | {two:.2f} | {ratio:.2f} | {100.0 * share:.0f} | {most:.2f}"
            alone, machine = (2.0 * least[i] / least[i + 1] for i in (2, 4))
            of_machine = f"{alone:.2f} | {machine:.2f} | {100.0 * ratio / machine:.0f}"
            print(f"| {strips} | {distribution} | {times} | {of_machine} |", flush=True)


if __name__ == "__main__":
    main()
