"""Which object a live track says it is, beside the truth: `python -m studies.holdout.tracks_live_identity -h`."""

from __future__ import annotations

import itertools
from collections import Counter

import numpy as np
import shapely

import tacstrip as ts
from studies.holdout.readings import Unit, white
from studies.holdout.score import CLAIMS
from studies.holdout.shapes import Array
from studies.holdout.tracks_bound import at
from studies.holdout.tracks_live_set import _APART_S, _LEVEL, _wrong
from studies.holdout.tracks_set import drawn_outline, drawn_way, scene_options, unlocked

_WIDE, _LONG, _STRIPS = 240.0, 150.0, 24  # the sensor [mm]
_PART = 45  # scans of each part of a scene
_MEETS = 30  # scans in which two objects come together, and in which they part
_LIFTED = 4  # scans without contact
_SLIGHTLY = (0.92, 0.95, 1.05, 1.08)  # times the size: another object that is hard to tell from the first
EVENTS = (
    "lifted, same", "lifted, alike", "lifted, another", "exchanged, alike", "exchanged, another",
    "exchanged and back", "meet", "pass", "twins meet", "twins pass",
)  # fmt: skip
Scene = list[dict[str, Array]]  # of every scan what touches, by its name


def _way(random: np.random.Generator, x: float, y: float) -> Array:
    return np.asarray(drawn_way("both", _PART, random) + np.array([x - 50.0, y - 50.0, 0.0]))


def _outline(random: np.random.Generator, area: float | None = None) -> Array:
    """Return an outline, of an area where one is given [mm^2]."""
    kind = str(random.choice(["convex", "long", "L"]))
    one = drawn_outline(kind, random, random.uniform(19.0, 26.0))
    return one if area is None else one * np.sqrt(area / shapely.Polygon(one).area)


def scene(event: str, random: np.random.Generator) -> Scene:
    """Return what touches in every scan."""
    while True:
        shown = _drawn(event, random)
        every = [o for scan in shown for o in scan.values()]
        reach = np.concatenate(every)
        inside = reach.min() > 1.0 and reach[:, 0].max() < _WIDE - 1.0 and reach[:, 1].max() < _LONG - 1.0
        apart = all(
            shapely.Polygon(a).distance(shapely.Polygon(b)) > 1.0
            for scan in shown
            for a, b in [tuple(scan.values())]
            if len(scan) == 2
        ) if event.endswith(("meet", "pass")) else True  # fmt: skip
        if inside and apart and min(np.ptp(o[:, 0]) for o in every) > 31.0:
            return shown


def _drawn(event: str, random: np.random.Generator) -> Scene:
    one = _outline(random)
    if event.startswith(("lifted", "exchanged")):
        other = one * random.choice(_SLIGHTLY)
        if "another" in event or "back" in event:
            other = _outline(random, shapely.Polygon(one).area)
        ways = [_way(random, 120.0, 75.0) for _ in range(3)]
        for before, after in itertools.pairwise(ways):
            if event.startswith("exchanged"):  # in the same place
                after += before[-1] - after[0]
        names = {"same": "aa", "back": "aba"}.get(event.split()[-1], "ab")
        gap: Scene = [{}] * (_LIFTED * event.startswith("lifted"))
        shown: Scene = []
        for name, way in zip(names, ways, strict=False):
            shown += [{name: at(one if name == "a" else other, p)} for p in way] + gap
        return shown
    other = one if "twins" in event else _outline(random)
    low, high = _way(random, 50.0, 40.0), _way(random, 190.0, 110.0)
    there = np.concatenate([np.linspace(0.0, 1.0, _MEETS - 5), np.ones(5)])
    back = there[::-1] if event.endswith("meet") else np.linspace(1.0, 2.0, _MEETS)
    moved = np.concatenate([there, back])[:, None] * np.array([70.0, 0.0, 0.0])
    ways = [
        np.concatenate([w, w[-1] + s * moved, np.tile(w[-1] + s * moved[-1], (_PART, 1))])
        for w, s in ((low, 1.0), (high, -1.0))
    ]
    for way in ways:  # after they parted each goes on by itself
        on = drawn_way("both", _PART, random)
        way[-_PART:] += on - on[0]
    return [{"a": at(one, p), "b": at(other, q)} for p, q in zip(*ways, strict=True)]


def counted(event: str, seed: int, number: int) -> Counter[str]:
    """Return how often what is said: scans `claimed`, with a `wrong` outline, the number of another object; `renamed`.

    Twins cannot be told after they parted: a number from before then is wrong, whether it happens to be right or not.
    """
    random = np.random.default_rng([79, EVENTS.index(event), seed, number])
    unit, named, seen = Unit(("kh", "kl"), _STRIPS, 10.0, _LONG), dict[int, str](), Counter[str]()
    live = ts.LiveTracks(unit.sensor, ts.Noise(positional=_LEVEL))
    for i, touching in enumerate(scene(event, random)):
        low, high = unit.touched(list(touching.values()))
        runs = np.count_nonzero(np.diff(np.isfinite(low).astype(int), prepend=0) == 1)
        if event.startswith("twins") and runs < len(touching):
            named = dict.fromkeys(named, "before")
        read = unit.read(low, high)
        read = read + white(read.shape, _LEVEL, "uniform", random)
        scan = ts.Scan(time_s=_APART_S * i, **dict(zip(unit.names, unit.digitised(read), strict=True)))
        for one in live.update(scan):
            seen["scans"] += 1
            if one.status not in CLAIMS:
                continue
            seen["claimed"] += 1
            shapes = {n: shapely.Polygon(o) for n, o in touching.items()}
            own = shapely.Polygon(one.placed).buffer(0)
            name = max(shapes, key=lambda n: own.intersection(shapes[n]).area, default="")
            if not name or _wrong(one, touching[name]):
                seen["wrong"] += 1
            if name and named.setdefault(one.id, name) != name:
                seen["another's number"] += 1
                seen["of these ok"] += one.status == "ok"
            elif name and any(n == name and number != one.id for number, n in named.items()):
                seen["renamed"] += 1
    return seen


_COLUMNS = ("scans", "claimed", "wrong", "another's number", "of these ok", "renamed")


def main() -> None:
    """Print a row for each event."""
    options = scene_options("Live tracks of objects that are lifted, exchanged, or meet.", scenes=10)
    options.add_argument("--events", nargs="+", choices=EVENTS, default=EVENTS)
    given = unlocked(options)
    print(f"| event | scenes | {' | '.join(_COLUMNS)} | scenes with another's number |")  # noqa: T201
    print("| --- " * (len(_COLUMNS) + 3) + "|", flush=True)  # noqa: T201
    for event in given.events:
        found = [counted(event, given.seed, number) for number in range(given.scenes)]
        cells = [sum(one[c] for one in found) for c in _COLUMNS]
        scenes = sum(one["another's number"] > 0 for one in found)
        print(f"| {event} | {len(found)} | {' | '.join(map(str, cells))} | {scenes} |", flush=True)  # noqa: T201


if __name__ == "__main__":
    main()
