"""Live tracks beside the truth when something happens: `python -m studies.holdout.tracks_live_set -h`."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import shapely

import tacstrip as ts
from studies.holdout.readings import Unit, white
from studies.holdout.score import CLAIMS, RIGHT
from studies.holdout.shapes import Array
from studies.holdout.tracks_bound import at
from studies.holdout.tracks_set import drawn_outline, drawn_way, hausdorff_mm, scene_options, unlocked

_SIDE, _STRIPS, _LEVEL, _APART_S = (
    100.0,
    10,
    0.005,
    0.01,
)  # the sensor [mm]; noise over Vref; from scan to scan
_BEFORE, _GAP, _AFTER = 40, 4, 40  # scans before, without contact, and after
_TOLD, _OF_SIZE, _SIGMAS = 0.1, 0.01, 4.0  # as in `tracks_set`
EVENTS = ("goes on", "stops", "jumps", "lifted", "swapped", "lifted, another", "swapped, alike", "creeps")


@dataclass
class Seen:
    """Of a scan: what is said of an object, whether that claims it, and whether it is wrong."""

    after: int
    status: str
    wrong: bool

    @property
    def claimed(self) -> bool:
        """Whether it is `ok` or `likely`."""
        return self.status in CLAIMS


def outlines(event: str, random: np.random.Generator) -> list[Array | None]:
    """Return what touches in every scan (N, 2) [mm], None where nothing does."""
    while True:
        size = random.uniform(18.0, 28.0)
        one = drawn_outline(str(random.choice(["convex", "long", "L"])), random, size)
        way = drawn_way("both", _BEFORE + _AFTER, random)
        other = one
        if event in ("swapped", "lifted, another"):
            other = drawn_outline("convex", random, random.uniform(18.0, 28.0))
        elif event == "swapped, alike":
            other = one * random.choice([0.85, 1.15])
        if event == "stops":
            way[_BEFORE:] = way[_BEFORE]
        elif event == "jumps":
            way[_BEFORE:] += random.normal(0.0, [4.0, 4.0, 0.3])
        elif event.startswith("lifted"):
            way[_BEFORE:, 2] += random.uniform(-3.0, 3.0)
        grown = np.ones(len(way))
        if event == "creeps":
            grown[_BEFORE:] += np.linspace(0.0, random.uniform(0.1, 0.2), _AFTER)
        placed = [
            at((one if i < _BEFORE else other) * g, p)
            for i, (g, p) in enumerate(zip(grown, way, strict=True))
        ]
        reach = np.concatenate(placed)
        if reach.min() > 1.0 and reach.max() < _SIDE - 1.0 and min(np.ptp(o[:, 0]) for o in placed) > 31.0:
            gap = [None] * (_GAP * event.startswith("lifted"))
            return [*placed[:_BEFORE], *gap, *placed[_BEFORE:]]


def followed(event: str, seed: int, number: int) -> list[Seen]:
    """Return what the live tracker says scan by scan."""
    random = np.random.default_rng([78, EVENTS.index(event), seed, number])
    unit = Unit(("kh", "kl"), _STRIPS, _SIDE / _STRIPS, _SIDE)
    live, seen = ts.LiveTracks(unit.sensor, ts.Noise(positional=_LEVEL)), list[Seen]()
    for i, true in enumerate(outlines(event, random)):
        low, high = unit.touched([] if true is None else [true])
        read = unit.read(low, high)
        read = read + white(read.shape, _LEVEL, "uniform", random)
        scan = ts.Scan(time_s=_APART_S * i, **dict(zip(unit.names, unit.digitised(read), strict=True)))
        for one in live.update(scan):
            wrong = one.status in CLAIMS and (true is None or _wrong(one, true))
            seen.append(Seen(i - _BEFORE, one.status, wrong))
    return seen


def _wrong(one: ts.LiveTrack, true: Array) -> bool:
    if not np.isfinite(one.pose[0]) or one.covariance is None:
        return True
    most = max(
        _SIGMAS * _deviation_mm(one, one.covariance),
        _TOLD * _SIDE / _STRIPS,
        _OF_SIZE * float(np.ptp(true, axis=0).max()),
    )
    found, what = shapely.Polygon(one.placed).buffer(0), shapely.Polygon(true)
    iou = found.intersection(what).area / max(found.union(what).area, 1e-9)
    return bool(iou < RIGHT or hausdorff_mm(one.placed, true) > most)


def _deviation_mm(one: ts.LiveTrack, shape: Array) -> float:
    """Return the stated deviation of the corner whose place on the sensor is known least [mm]."""
    x, y = (one.placed - one.pose[:2]).T
    by_pose = np.stack(np.broadcast_arrays([[1.0], [0.0]], [[0.0], [1.0]], [-y, x]), axis=2)  # (2, N, 3)
    moved = np.einsum("inj,jk,ink->n", by_pose, one.pose_covariance, by_pose)
    return math.sqrt(float((shape.diagonal().reshape(-1, 2).sum(axis=1) + moved).max()))


HEAD = (
    "| event | scenes | before: ok | claimed | wrong | of these ok | after: ok | claimed | wrong | of these ok "
    "| scenes with 3 and more wrong |\n" + "| --- " * 11 + "|"
)


def line(event: str, found: list[list[Seen]]) -> str:
    """Return a row of the table."""
    cells = [event, str(len(found))]
    for after in (False, True):
        part = [s for one in found for s in one if (s.after >= 0) is after]
        wrong = [s for s in part if s.wrong]
        cells += [
            f"{np.mean([s.status == 'ok' for s in part]):.2f}",
            f"{np.mean([s.claimed for s in part]):.2f}",
        ]
        cells += [str(len(wrong)), str(sum(s.status == "ok" for s in wrong))]
    cells.append(str(sum(sum(s.wrong for s in one) >= 3 for one in found)))
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    """Print a row for each event."""
    options = scene_options("Live tracks when an object stops, jumps, is lifted, swapped.", scenes=20)
    options.add_argument("--verbose", action="store_true", help="scans that are wrong, a line a scene")
    given = unlocked(options)
    print(HEAD, flush=True)  # noqa: T201
    for event in EVENTS:
        found = [followed(event, given.seed, number) for number in range(given.scenes)]
        for number, one in enumerate(found if given.verbose else ()):
            if wrong := [s.after for s in one if s.wrong]:
                print(f"{event} {number}: {wrong}")  # noqa: T201
        print(line(event, found), flush=True)  # noqa: T201


if __name__ == "__main__":
    main()
