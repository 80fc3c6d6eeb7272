"""Doctor, calibration and devices on units kept apart: `python -m studies.holdout.device_and_unit -h`."""

from __future__ import annotations

import argparse
import time
import traceback
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from typing import Any

from studies.holdout import calibration_set, device_set, device_wire, doctor_set
from studies.holdout.score import FINAL

Row = dict[str, Any]
SETS: dict[str, tuple[Callable[[int, int], Row], Callable[[list[Row]], list[str]], int]] = {
    "doctor": (doctor_set.score, doctor_set.table, 60),
    "calibration": (calibration_set.score, calibration_set.table, 12),
    "unaware": (partial(calibration_set.score, unaware=True), calibration_set.table, 12),
    "wrong": (calibration_set.score_wrong, calibration_set.table_wrong, 25),
    "device": (device_set.score, device_set.table, len(device_set.TROUBLES)),
    "wire": (device_wire.score, device_set.table, len(device_wire.TROUBLES)),
}


def attempt(which: str, seed: int, number: int) -> Row:
    """Score a case; what the software under test raises is a finding."""
    try:
        return SETS[which][0](seed, number)
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        return {
            "raised": f"case {number}: {type(error).__name__}: {error} ({where.name}, line {where.lineno})"
        }


def table(which: str, cases: int, seed: int = 0, jobs: int = 1, first: int = 0, step: int = 1) -> list[str]:
    """Score cases of a set and return its tables' lines."""
    work, numbers = partial(attempt, which, seed), range(first, first + cases * step, step)
    if jobs == 1:
        rows = [work(number) for number in numbers]
    else:
        with ProcessPoolExecutor(jobs) as workers:
            rows = list(workers.map(work, numbers))
    raised = [r["raised"] for r in rows if "raised" in r]
    lines = SETS[which][1]([r for r in rows if "raised" not in r])
    return [*lines, "", f"{len(raised)} raised", *(f"- {r}" for r in raised)]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables that the command line asks for."""
    parser = argparse.ArgumentParser(prog="python -m studies.holdout.device_and_unit", description=__doc__)
    parser.add_argument("--set", choices=SETS, default="doctor", dest="which")
    parser.add_argument(
        "--cases", type=int, help="how many; by default as many as show that a change runs at all"
    )
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument(
        "--step", type=int, default=1, help="from case to case: 44 keeps to one kind of the doctor's faults"
    )
    parser.add_argument("--seed", type=int, default=0, help=f"{FINAL} and above decide: not before the end")
    parser.add_argument("--jobs", type=int, default=1, help="processes; devices keep real time: leave them 1")
    parser.add_argument("--final", action="store_true", help=f"unlocks seeds of {FINAL} and above")
    asked = parser.parse_args(arguments)
    if asked.seed >= FINAL and not asked.final:
        parser.error(f"seeds of {FINAL} and above decide and are run once, at the end: --final")
    cases = SETS[asked.which][2] if asked.cases is None else asked.cases
    start = time.monotonic()
    lines = table(asked.which, cases, asked.seed, asked.jobs, asked.first, asked.step)
    took = time.monotonic() - start
    lines = [f"{asked.which}: {cases} cases from {asked.first}, seed {asked.seed}, {took:.0f} s", "", *lines]
    print("\n".join(lines))  # noqa: T201


if __name__ == "__main__":
    main()
