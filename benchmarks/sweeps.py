"""Sweeps: a million batches planned and listed; the share of the workers' time that is work.

Run: python benchmarks/sweeps.py [--designs 40] [--workers 2]
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
    options.add_argument("--designs", type=int, default=40)
    options.add_argument("--workers", type=int, default=2)
    given = options.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "study.toml")
        file.write_text(STUDY.format(samples=250_000, scans=1, more="batch_designs = 1"), encoding="utf-8")
        begun, used = time.perf_counter(), time.process_time()
        study = Sweep.load(file)
        count = len({batch.name for batch in study.batches()})
        there = len(batches_there(Path(folder)))
        took, used = time.perf_counter() - begun, time.process_time() - used
        print(f"{count} batches planned, {there} of them there: {took:.1f} s, {used:.1f} s of processor time")
        file.write_text(STUDY.format(samples=given.designs // 4, scans=20, more=""), encoding="utf-8")
        study = Sweep.load(file)
        begun = time.perf_counter()
        state = sweep(study, Path(folder, "out"), workers=given.workers)
        took = time.perf_counter() - begun
    print(
        f"{study.designs} designs in {state.done} batches on {given.workers} workers: {took:.1f} s, "
        f"{state.work_s / state.done:.1f} s each, {100.0 * state.work_s / state.paid_s:.0f} % of their time is work"
    )


if __name__ == "__main__":
    main()
