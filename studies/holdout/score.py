"""Whether `ok` is right, doubts are due and regions hold, on cases kept apart: `python -m studies.holdout.score -h`."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from typing import Any, TypeAlias

import numpy as np
import shapely

import tacstrip as ts
from studies.holdout import cases
from studies.holdout.cases import FAULTS, SETS, Case
from studies.holdout.convexity import best_convex
from studies.holdout.material import KINDS, Press
from studies.holdout.readings import Unit
from studies.holdout.shapes import Array
from tacstrip.diagnose import Log, learn_noise

Row: TypeAlias = dict[str, Any]

# How the package is called: what changes when its names do.
MODES: dict[str, dict[str, Any]] = {
    "none": {"assessment": "none"},
    "thorough": {"assessment": "thorough"},
    "fast": {"assessment": "fast"},
}
CLAIMS = ("ok", "likely")  # a status that promises a right outline
SEVERAL = re.compile(r"\b(two|several|more than one) (objects|contacts|shapes)|concave", re.IGNORECASE)
PERIOD_S = 0.05  # from scan to scan: 1200 are a minute

# IoU that `ok` promises; that makes a doubt false; what tells two objects.
RIGHT, GOOD, LEAST_P = 0.8, 0.9, 1e-3
FINAL = 1000  # the first seed that decides
# 95 % of a number and of a point; axes this close have no direction.
_LEVEL, _CHI2, _ROUND = 1.959964, 5.991465, 1.02
_SCANS, _MEANS = 1200, (1, 16, 64)  # of a minute, and of the means that are judged


def fit(unit: Unit, scan: ts.Scan, noise: ts.Noise | None, **options: Any) -> ts.Reconstruction:
    """Call the estimator under test."""
    return ts.fit_polygon(scan, unit.sensor, noise, **options)


def told_noise(case: Case) -> ts.Noise | None:
    """Return what the estimator is told of a case's noise."""
    return ts.Noise(positional=case.half_width, distribution=case.distribution) if case.told else None  # type: ignore[arg-type]


def overlap(unit: Unit, vertices: Array, truth: Array) -> float:
    """Return the intersection over union of two outlines on the sensor: nothing is known of what lies beyond it."""
    if len(vertices) < 3:
        return 0.0
    sensor = shapely.box(0.0, 0.0, unit.strips * unit.pitch, unit.length)
    a, b = (shapely.Polygon(v).buffer(0.0).intersection(sensor) for v in (vertices, truth))
    union = a.union(b).area
    return float(a.intersection(b).area / union) if union else 0.0


def best_object(unit: Unit, result: ts.Reconstruction, truth: Array) -> tuple[float, Any]:
    """Return the highest overlap of a recovered object with the truth, and that object."""
    return max(
        ((overlap(unit, o.vertices, truth), o) for o in result.objects),
        key=lambda p: p[0],
        default=(0.0, None),
    )


def judged(case: Case, result: ts.Reconstruction) -> Row:
    """Return what the counts need of the object that overlaps the truth most."""
    iou, found = best_object(case.unit, result, case.outlines[0])
    return {
        "group": case.group,
        "names": "+".join(case.unit.names),
        "strips": case.strips,
        "of": case.unit.strips,
        "upright": bool((np.diff(case.outlines[0][:, 0], append=case.outlines[0][0, 0]) == 0.0).any()),
        "noise": case.half_width,
        "told": case.told,
        "weakest": case.weakest,
        "iou": iou,
        "ok": found is not None and found.status in CLAIMS,
        "confidence": getattr(found, "confidence", None),
        "objects": len(result.objects),
        "advice": result.advice,
    }


def score_convex(seed: int, mode: str, number: int, which: str = "convex") -> list[Row]:
    """Fit one convex shape, or one of the rounded families, or a set that is counted likewise."""
    case = getattr(cases, which)(cases.rng(which, seed, number))
    return [judged(case, fit(case.unit, case.unit.scan(case.read), told_noise(case), **MODES[mode]))]


def score_pairs(seed: int, mode: str, number: int, which: str = "pairs") -> list[Row]:
    """Fit two shapes or a concave one, and ask how far the readings are from every convex outline."""
    case = getattr(cases, which)(cases.rng(which, seed, number))
    row = judged(case, fit(case.unit, case.unit.scan(case.read), told_noise(case), **MODES[mode]))
    read = np.clip(case.read, 0.0, 1.0)
    row["p"] = best_convex(case.unit, read, case.unit.sigma(case.half_width), case.low, case.high).p
    return [row]


def score_channels(seed: int, mode: str, number: int) -> list[Row]:
    """Fit a shape as it is, with a fault in one channel, and with that channel left out where that can be asked for."""
    random = cases.rng("channels", seed, number)
    case = cases.channels(random)
    fault, channel = FAULTS[number % len(FAULTS)], random.integers(len(case.unit.names))
    strip = random.choice(np.flatnonzero(np.isfinite(case.low)))
    read = case.read.copy()
    value, rail = read[channel, strip], random.random() < 0.5
    stuck = {
        "dead": 0.0,
        "stuck": random.random(),
        "saturated": 1.0 if rail else random.uniform(0.5, 0.95) * value,
    }
    read[channel, strip] = stuck[fault]
    scans = {"healthy": case.unit.scan(case.read), fault: case.unit.scan(read)}
    read[channel, strip] = np.nan
    scans[f"{fault}, left out"] = case.unit.scan(read)
    noise = told_noise(case)
    return [
        judged(case, fit(case.unit, scan, noise, **MODES[mode])) | {"state": state, "fault": fault}
        for state, scan in scans.items()
    ]


def score_regions(seed: int, mode: str, number: int) -> list[Row]:
    """Fit a shape by least squares, and within the noise's bound where it has one; ask what regions hold."""
    case = cases.regions(cases.rng("regions", seed, number))
    scan, rows = case.unit.scan(case.read), []
    for bounded in (False, True)[: 1 + (case.distribution == "uniform")]:
        result = fit(case.unit, scan, told_noise(case), bounded=bounded, **MODES[mode])
        rows.append(judged(case, result) | held(case, result) | {"bounded": bounded})
    return rows


def score_material(seed: int, mode: str, number: int) -> list[Row]:
    """Learn a unit's noise from a still press, then fit another press: one scan, and means of several."""
    random = cases.rng("material", seed, number)
    before, case = cases.regions(random), cases.regions(random, (12, 41))
    press = Press(case.unit, KINDS[number % len(KINDS)], cases.log_uniform(random, 0.001, 0.006))
    size = np.array([case.unit.strips * case.unit.pitch, case.unit.length])
    outline = before.outlines[0] - before.outlines[0].min(axis=0)
    outline = 0.1 * size + 0.8 * size * outline / np.ptp(outline, axis=0)
    still = press.scans(*case.unit.touched([outline]), _SCANS, random)
    noise = learned(case.unit.sensor, [case.unit.scan(s) for s in still])
    exact = replace(case.unit, bits=None)  # a mean lies between the converter's steps
    scans, rows = press.scans(case.low, case.high, max(_MEANS), random), []
    for count in _MEANS:
        scan = replace(exact.scan(scans[:count].mean(axis=0)), averaged=count, span_s=(count - 1) * PERIOD_S)
        result = fit(case.unit, scan, noise, **MODES[mode])
        rows.append(judged(case, result) | held(case, result) | {"kind": press.kind, "scans": count})
    return rows


def learned(sensor: ts.Sensor, scans: Sequence[ts.Scan]) -> ts.Noise:
    """Return the noise that a minute of a still press teaches."""
    raw = {name: np.stack([scan[name] for scan in scans]) for name in scans[0].signatures}
    return learn_noise(Log.of(sensor, np.arange(len(scans), dtype=float) * PERIOD_S, raw)).noise


def held(case: Case, result: ts.Reconstruction) -> Row:
    """Return whether 95 % regions hold the truth, each a list; empty where the count is wrong or nothing is said."""
    truth, nothing = (
        case.outlines[0],
        {"counted": False, "vertices": [], "area": [], "centroid": [], "orientation": []},
    )
    _, found = best_object(case.unit, result, truth)
    oval = case.group == "ellipse"
    if (
        found is None
        or found.covariance is None
        or (len(found.vertices) < 20 if oval else len(found.vertices) != len(truth))
    ):
        return nothing
    off_area, off_centroid, off_angle = found.deviations
    area, centroid, angle, ratio = moments(truth)
    turned = (found.orientation - angle + 0.5 * np.pi) % np.pi - 0.5 * np.pi
    points = []
    if not oval:
        shifts = [np.roll(truth, -i, axis=0) - found.vertices for i in range(len(truth))]
        off = min(shifts, key=lambda d: float((d**2).sum()))
        tiny = 1e-10 * np.eye(2)  # mm^2: a vertex that is known along a line
        blocks = [found.covariance[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] + tiny for i in range(len(off))]
        points = [bool(d @ np.linalg.solve(c, d) <= _CHI2) for d, c in zip(off, blocks, strict=True)]
    return {
        "counted": True,
        "vertices": points,
        "area": [bool(abs(found.area - area) <= _LEVEL * off_area)],
        "centroid": [bool(b) for b in np.abs(found.centroid - centroid) <= _LEVEL * np.asarray(off_centroid)],
        "orientation": [] if ratio < _ROUND else [bool(abs(turned) <= _LEVEL * off_angle)],
    }


def moments(outline: Array) -> tuple[float, Array, float, float]:
    """Return area, centroid, direction of the longer axis [rad] and ratio of the axes, by a fan of triangles."""
    fan = np.stack([np.broadcast_to(outline[0], outline[1:-1].shape), outline[1:-1], outline[2:]], axis=1)
    (ax, ay), (bx, by) = (fan[:, 1] - fan[:, 0]).T, (fan[:, 2] - fan[:, 0]).T
    weights = 0.5 * (ax * by - ay * bx)
    area, centroid = weights.sum(), weights @ fan.mean(axis=1) / weights.sum()
    middles = 0.5 * (fan + np.roll(fan, 1, axis=1)) - centroid  # exact for squares, one third each
    second = np.einsum("t,tpi,tpj->ij", weights / 3.0, middles, middles)
    spread, axes = np.linalg.eigh(second)
    return (
        float(area),
        centroid,
        float(np.arctan2(axes[1, 1], axes[0, 1])),
        float(np.sqrt(spread[1] / spread[0])),
    )


def share(part: int, whole: int) -> str:
    """Return a share in percent."""
    return f"{100.0 * part / whole:6.1f}" if whole else "     -"


def counts(title: str, rows: Sequence[Row]) -> str:
    """Return a line: cases, `ok`, silent wrong of ok, IoU >= .9 and doubted of these, mean IoU."""
    ok = [r for r in rows if r["ok"]]
    silent, good = [r for r in ok if r["iou"] < RIGHT], [r for r in rows if r["iou"] >= GOOD]
    false = [r for r in good if not r["ok"]]
    mean = f"{np.mean([r['iou'] for r in rows]):6.3f}" if rows else "     -"
    return (
        f"{title:34}{len(rows):6}{len(ok):6}{len(silent):5}{share(len(silent), len(ok))}"
        f"{len(good):7}{len(false):5}{share(len(false), len(good))} {mean}"
    )


_COUNTS = f"{'':34}{'cases':>6}{'ok':>6}{'silent, %':>11}{'>= .9':>7}{'doubted, %':>11}{'IoU':>7}"


def by(rows: Iterable[Row], *keys: str) -> dict[tuple[Any, ...], list[Row]]:
    """Return rows by the values of some keys, in their order."""
    found: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        found.setdefault(tuple(row[k] for k in keys), []).append(row)
    return dict(sorted(found.items()))


def table_convex(rows: list[Row]) -> list[str]:
    """Return counts of both signatures and of one, and how `confidence` is calibrated."""
    lines = [_COUNTS]
    both, one = ([r for r in rows if ("+" in r["names"]) == b] for b in (True, False))
    for title, some in (("both", both), ("one", one)):
        low = [r for r in some if r["noise"] <= 0.01]
        many = [r for r in low if r["strips"] >= 12]
        lines += [counts(f"{title}, <= 1 %, >= 12 strips", many)]
        lines += [
            counts(f"  noise {'told' if told else 'unknown'}", g) for (told,), g in by(many, "told").items()
        ]
        lines += [counts(f"{title}, <= 1 %, 6-11 strips", [r for r in low if r["strips"] < 12])]
        lines += [
            counts(f"{title}, 2 %", [r for r in some if r["noise"] > 0.01]),
            counts(f"{title}, all", some),
        ]
        lines += [counts(f"  {name}", g) for (name,), g in by(some, "names").items() if title == "one"]
        lines += [counts(f"  {group}", g) for (group,), g in by(some, "group").items()]
    return [*lines, *calibration(rows)]


def calibration(rows: Sequence[Row]) -> list[str]:
    """Return by tenths of `confidence` what was said and what was right."""
    said = [r for r in rows if r["confidence"] is not None]
    lines = ["", f"confidence: {len(said)} of {len(rows)} cases have one"]
    for (tenth,), some in by(
        [r | {"tenth": min(int(10 * r["confidence"]), 9)} for r in said], "tenth"
    ).items():
        mean, right = np.mean([r["confidence"] for r in some]), np.mean([r["iou"] >= RIGHT for r in some])
        lines.append(
            f"  {tenth / 10:.1f}-{tenth / 10 + 0.1:.1f}{len(some):7} said {mean:.3f} was {right:.3f}"
        )
    return lines


def table_pairs(rows: list[Row]) -> list[str]:
    """Return how many pairs are called one object, where the readings can tell and where not; concave shapes."""
    lines = [f"{'pairs':34}{'cases':>6}{'tell':>6}{'as one ok, %':>13}{'cannot tell':>13}{'as one ok':>10}"]
    two = [r for r in rows if r["group"] == "pair"]
    sized = [r | {"of": f"{r['of']} strips" if r["of"] in (10, 20) else "8-100 strips"} for r in two]
    for (names, size, told), some in (by(sized, "names", "of", "told") | {("all", "all", None): two}).items():
        title = f"{names}, {size}"
        title += "" if told is None else f", {'told' if told else 'unknown'}"
        clear, other = ([r for r in some if (r["p"] < LEAST_P) == c] for c in (True, False))
        merged, also = ([r for r in g if r["ok"] and r["objects"] < 2] for g in (clear, other))
        numbers = f"{len(merged):7}{share(len(merged), len(clear))}{len(other):13}{len(also):10}"
        lines.append(f"{title:34}{len(some):6}{len(clear):6}{numbers}")
    lines += ["", f"{_COUNTS}  doubted as several, %"]
    concave = [
        r | {"many": r["strips"] >= 12, "both": "+" in r["names"]} for r in rows if r["group"] != "pair"
    ]
    for (both, many), some in by(concave, "both", "many").items():
        several = sum(not r["ok"] and SEVERAL.search(r["advice"]) is not None for r in some)
        title = f"concave, {'both' if both else 'one'}, {'>= 12' if many else '< 12'} strips"
        lines.append(f"{counts(title, some)}{several:6}{share(several, len(some))}")
    return lines


def table_concave(rows: list[Row]) -> list[str]:
    """Return counts of concave shapes: by family, and where no convex outline explains the readings; confidence."""
    lines = [f"{_COUNTS}  doubted as several, %"]
    told = [r | {"tells": r["p"] < LEAST_P} for r in rows]
    groups = [("all", told)]
    groups += [(f"  convex: {'no' if tells else 'may be'}", g) for (tells,), g in by(told, "tells").items()]
    groups += [(f"  noise {'told' if k else 'unknown'}", g) for (k,), g in by(told, "told").items()]
    groups += [(f"  {family}", g) for (family,), g in by(told, "group").items()]
    for title, some in groups:
        several = sum(not r["ok"] and SEVERAL.search(r["advice"]) is not None for r in some)
        lines.append(f"{counts(title, some)}{several:6}{share(several, len(some))}")
    return [*lines, *calibration(rows)]


def table_channels(rows: list[Row]) -> list[str]:
    """Return how many shapes are `ok` and right with all channels, with a faulty one, and with that left out."""
    lines = [f"{'':24}{'state':24}{'cases':>6}{'ok, right':>10}{'of healthy, %':>14}{'silent':>7}"]
    for (names, fault), some in by(rows, "names", "fault").items():
        healthy = 0
        for state in ("healthy", fault, f"{fault}, left out"):
            these = [r for r in some if r["state"] == state]
            ok = [r for r in these if r["ok"]]
            right = sum(r["iou"] >= RIGHT for r in ok)
            healthy = right if state == "healthy" else healthy
            numbers = f"{right:10}{share(right, healthy):>14}{len(ok) - right:7}"
            lines += [f"{names:24}{state:24}{len(these):6}{numbers}"] if these else []
    return lines


def coverage(title: str, rows: Sequence[Row]) -> str:
    """Return a line: of fits with the right count, the share of truths in their 95 % regions."""
    of = [r for r in rows if r["counted"]]
    line = f"{title:50}{len(rows):6}{len(of):6}{sum(r['ok'] for r in of):5}"
    for name in ("vertices", "area", "centroid", "orientation"):
        inside = [inside for r in of for inside in r[name]]
        line += f"{share(sum(inside), len(inside)):>8}"
    return line


_COVERAGE = (
    f"{'held, %':50}{'cases':>6}{'count':>6}{'ok':>5}{'vertex':>8}{'area':>8}{'centre':>8}{'angle':>8}"
)


def table_regions(rows: list[Row]) -> list[str]:
    """Return what 95 % regions hold, for right counts: by kind of outline, signatures and estimate."""
    lines = [_COVERAGE]
    rows = [r | {"shape": _kind(r), "both": "both" if "+" in r["names"] else "one"} for r in rows]
    for (bounded, shape, both), some in by(rows, "bounded", "shape", "both").items():
        lines.append(coverage(f"{shape}, {both}, {'bounded' if bounded else 'least squares'}", some))
    return lines


def _kind(row: Row) -> str:
    if row["group"] == "ellipse":
        return "ovals"
    return "upright sides" if row["upright"] else f"polygons{', weakest < 8' if row['weakest'] < 8.0 else ''}"


def table_material(rows: list[Row]) -> list[str]:
    """Return what 95 % regions hold on noise as materials have it."""
    groups = sorted(
        by((r for r in rows if r["weakest"] >= 8.0), "kind", "scans").items(),
        key=lambda g: (KINDS.index(g[0][0]), g[0][1]),
    )
    return [_COVERAGE, *(coverage(f"{kind}, mean of {scans}", g) for (kind, scans), g in groups)]


SCORES: dict[str, tuple[Callable[[int, str, int], list[Row]], Callable[[list[Row]], list[str]]]] = {
    "convex": (score_convex, table_convex),
    "pairs": (score_pairs, table_pairs),
    "channels": (score_channels, table_channels),
    "regions": (score_regions, table_regions),
    "material": (score_material, table_material),
    "rounded": (partial(score_convex, which="rounded"), table_convex),
    "unusual": (partial(score_convex, which="unusual"), table_convex),
    "wide": (partial(score_convex, which="wide"), table_convex),
    "beside": (partial(score_pairs, which="beside"), table_pairs),
    "concave": (partial(score_pairs, which="concave"), table_concave),
}


def attempt(which: str, seed: int, mode: str, number: int) -> list[Row]:
    """Score a case; the estimator's own errors are rows that say so."""
    try:
        return SCORES[which][0](seed, mode, number)
    except Exception as error:  # whatever it raises is a finding, and one must not end the run
        return [{"error": f"case {number}: {type(error).__name__}: {error}"}]


def table(which: str, count: int, seed: int = 0, mode: str = "none", jobs: int = 1) -> list[str]:
    """Score `count` cases of a set of `SETS` and return its table's lines."""
    work = partial(attempt, which, seed, mode)
    if jobs == 1:
        rows = [row for number in range(count) for row in work(number)]
    else:
        with ProcessPoolExecutor(jobs) as workers:
            rows = [row for some in workers.map(work, range(count), chunksize=4) for row in some]
    errors = [row["error"] for row in rows if "error" in row]
    lines = SCORES[which][1]([row for row in rows if "error" not in row])
    return [*lines, "", f"{len(errors)} errors", *errors[:10]]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables that the command line asks for."""
    parser = argparse.ArgumentParser(prog="python -m studies.holdout.score", description=__doc__)
    parser.add_argument("--set", choices=SETS, default="convex", dest="which")
    parser.add_argument("--cases", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0, help=f"{FINAL} and above decide: not before the end")
    parser.add_argument("--mode", choices=MODES, default="none")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--final", action="store_true", help=f"unlocks seeds of {FINAL} and above")
    asked = parser.parse_args(arguments)
    if asked.seed >= FINAL and not asked.final:
        parser.error(f"seeds of {FINAL} and above decide and are run once, at the end: --final")
    print(f"{asked.which}, {asked.cases} cases, seed {asked.seed}, mode {asked.mode}")  # noqa: T201
    print("\n".join(table(asked.which, asked.cases, asked.seed, asked.mode, asked.jobs)))  # noqa: T201


if __name__ == "__main__":
    main()
