"""Sweeps: a million batches planned and listed; the share of the workers' time that is work.

Time is the clock's, and work is what workers were at, so that other load on the machine disturbs both alike. What
dealing out costs is the processor time of the first process.

Run: python benchmarks/sweeps.py [--quick] [--designs 2000] [--scans 4] [--workers 2]
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

from tacstrip.dataset.sweep import Sweep, batches_there, sweep

STUDY = """
[sensor]
construction = "crs-crs"
strips = 50
pitch_mm = 2.0
length_mm = 100.0
adc_bits = 12
[shapes]
corners = [3, 5]
size_mm = [30, 70]
[vary.sensor]
adc_bits = [8, 10, 12, 14]
[latin]
samples = {samples}
[latin.sensor]
length_mm = {{from = 80.0, to = 400.0, log = true}}
[latin.noise]
positional = {{from = 0.0005, to = 0.01, log = true}}
[measure]
what = ["bound", "polygon", "right", "coverage"]
scans = {scans}
{more}
"""


def main() -> None:
    """Print both."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--quick", action="store_true", help="40 designs, and a plan of 100,000")
    options.add_argument("--designs", type=int, default=2000)
    options.add_argument("--scans", type=int, default=4)
    options.add_argument("--workers", type=int, default=2)
    given = options.parse_args()
    designs = 40 if given.quick else given.designs
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "study.toml")
        file.write_text(
            STUDY.format(samples=25_000 if given.quick else 250_000, scans=1, more="batch_designs = 1"),
            encoding="utf-8",
        )
        begun, used = time.perf_counter(), time.process_time()
        study = Sweep.load(file)
        count = len({batch.name for batch in study.batches()})
        there = len(batches_there(Path(folder)))
        took, used = time.perf_counter() - begun, time.process_time() - used
        print(f"{count} batches planned, {there} of them there: {took:.1f} s, {used:.1f} s of processor time")
        file.write_text(STUDY.format(samples=designs // 4, scans=given.scans, more=""), encoding="utf-8")
        study = Sweep.load(file)
        begun, used = time.perf_counter(), time.process_time()
        state = sweep(study, Path(folder, "out"), workers=given.workers)
        took, used = time.perf_counter() - begun, time.process_time() - used
    print(
        f"{study.designs} designs in {state.done} batches on {given.workers} workers: {took:.1f} s, "
        f"{state.work_s / state.done:.1f} s each, {100.0 * state.work_s / state.paid_s:.1f} % of their time is work; "
        f"dealing out took {used:.1f} s of processor time, {1e3 * used / state.done:.0f} ms a batch"
    )


if __name__ == "__main__":
    main()
