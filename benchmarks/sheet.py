"""A new contact on a bare 100 x 100 sheet: by its Green block, by factoring anew, and by ngspice.

The contact is a disc in the middle, joined over resistors to a linear ramp of potentials, as a strip would be; wanted
are the potentials of the whole sheet. ngspice runs the same resistors as a netlist (its start-up is timed apart).
Run: python benchmarks/sheet.py
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
from _timing import median_seconds

from studies.sheet import MOST_BY_GREEN, Sheet, Touch, by_factor, by_green, solve
from tacstrip.arrays import FloatArray

SHEET = Sheet(100, 100)
SIZES = (1, 10, 30, 70, 100, 128, 129, 200, 356, 700, 1000, 2920, 9000)
_DENSE = 1000  # nodes: beyond, dense work is only slow


def disc(sheet: Sheet, count: int) -> Touch:
    """Touch the nodes nearest to the middle of the sheet."""
    column, row = (i.ravel() for i in np.indices((sheet.columns, sheet.rows)))
    far = np.hypot(column - 0.5 * sheet.columns, row - 0.5 * sheet.rows)
    near = np.argsort(far, kind="stable")[:count]
    return Touch(column[near], row[near], np.full(count, 0.7), row[near] / sheet.rows)


def by_ngspice(sheet: Sheet, touch: Touch, read: int) -> tuple[float, float, float]:
    """Return one node's potential, and how long ngspice took for it and for an empty circuit [s]."""
    network, held = sheet.network(touch)
    lines = ["sheet"]
    for i, (a, b, g) in enumerate(zip(network.start, network.end, network.siemens, strict=True)):
        lines.append(f"R{i} n{a} n{b} {1.0 / g:.17g}")
    lines += [f"V{i} n{a} 0 {v:.17g}" for i, (a, v) in enumerate(zip(held, touch.volt, strict=True))]
    run = [".control", "set numdgt=15", "op", f"print v(n{read})", "quit", ".endc", ".end", ""]
    _, seconds = _run("\n".join([*lines, *run]))
    _, start_up = _run("empty\nV1 n0 0 1\nR1 n0 0 1\n.control\nop\nquit\n.endc\n.end\n")
    text, _ = _run("\n".join([*lines, *run]))
    value = next(line for line in text.splitlines() if line.startswith(f"v(n{read})"))
    return float(value.split("=")[1]), seconds, start_up


def _run(deck: str) -> tuple[str, float]:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "deck.cir"
        file.write_text(deck, encoding="utf-8")
        start = time.perf_counter()
        done = subprocess.run(["ngspice", "-b", str(file)], capture_output=True, text=True, check=False)
        return done.stdout, time.perf_counter() - start


def in_turns(jobs: Sequence[Callable[[], object]], rounds: int) -> list[float]:
    """Return each job's median time [s]; taken in turns, so that what else the machine does hits all alike."""
    times = np.empty((rounds, len(jobs)))
    for i, j in product(range(rounds), range(len(jobs))):
        start = time.perf_counter()
        jobs[j]()
        times[i, j] = time.perf_counter() - start
    return [float(t) for t in np.median(times, axis=0)]


def table(sheet: Sheet) -> None:
    """Print both ways, and what `solve` takes, over the contact's size."""
    print(f"\nsheet {sheet.columns} x {sheet.rows}")
    print(
        f"{'nodes':>6} {'Green [ms]':>11} {'factor [ms]':>12} {'solve [ms]':>11} {'factor / solve':>15}  solve takes"
    )
    for count in (c for c in SIZES if c <= sheet.columns * sheet.rows):
        touch = disc(sheet, count)
        green = median_seconds(partial(by_green, sheet, touch), 5) if count <= _DENSE else np.nan
        factor, taken = in_turns([partial(by_factor, sheet, touch), partial(solve, sheet, touch)], 9)
        way = "Green" if count <= MOST_BY_GREEN else "factor"
        print(
            f"{count:6d} {1e3 * green:11.2f} {1e3 * factor:12.2f} {1e3 * taken:11.2f} {factor / taken:15.2f}  {way}"
        )


def against_ngspice(green: float, potentials: FloatArray, touch: Touch) -> None:
    """Print the same contact in ngspice, if it is there."""
    if shutil.which("ngspice") is None:
        print("ngspice: not on PATH, comparison skipped (Debian: apt-get install ngspice)")
        return
    value, seconds, start_up = by_ngspice(SHEET, touch, 0)
    print(
        f"ngspice              {1e3 * seconds:9.1f} ms   ratio {seconds / green:9,.0f}  (wanted: 1,000)   "
        f"start-up {1e3 * start_up:.0f} ms, without it ratio {(seconds - start_up) / green:,.0f}; "
        f"difference at a corner {abs(value - potentials[0, 0]):.1e} Vref"
    )


def main() -> None:
    """Print a contact of 70 nodes each way, then the tables."""
    touch = disc(SHEET, 70)
    start = time.perf_counter()
    by_green(SHEET, touch)
    first = time.perf_counter() - start
    green = median_seconds(lambda: by_green(SHEET, touch), 21)
    factor = median_seconds(lambda: by_factor(SHEET, touch), 9)
    potentials = by_green(SHEET, touch)
    off = np.abs(potentials - by_factor(SHEET, touch)).max()
    print(f"a new contact of 70 nodes on a sheet of 100 x 100; both ways agree to {off:.0e} Vref")
    print(
        f"Green block          {1e3 * green:9.2f} ms   (the first one, with imports and table: {1e3 * first:.0f} ms)"
    )
    print(f"factored anew        {1e3 * factor:9.1f} ms   ratio {factor / green:9.0f}  (wanted: 30)")
    against_ngspice(green, potentials, touch)
    for sheet in (Sheet(12, 12), SHEET, Sheet(200, 200)):
        table(sheet)


if __name__ == "__main__":
    main()
