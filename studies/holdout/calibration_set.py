"""Calibration of units of `units.py`: what is left on other readings, what ranges hold, what is refused."""

from __future__ import annotations

import csv
import re
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import tacstrip as ts
from studies.holdout import logs, units
from studies.holdout.doctor_set import command
from studies.holdout.logs import Bench
from studies.holdout.readings import Unit
from studies.holdout.units import METAL, Array, Build, Converter, Material

REPEATS = (1, 2, 3, 5)
ASKED = 0.3  # % of Vref that 95 % of the other readings keep
UNEVEN = "uneven rubber"
_VREF = 5.0
_TESTS = 120  # other contacts
_RUNGS = 56


@dataclass(frozen=True, eq=False)
class Maker:
    """A unit, its converter, and how its owner presses: half-width of a reading's noise, error of a place [mm]."""

    unit: Build
    converter: Converter
    noise: float
    normal: bool
    place_mm: float  # half-width; with `said`, the standard deviation
    said: bool  # the runs say so: l_sd_mm, w_sd_mm
    group: str

    @property
    def places(self) -> str:
        """How well places are known."""
        return "said to be uncertain" if self.said else f"exact to {self.place_mm:g} mm"

    def spec(self) -> str:
        """Return the spec before calibration: its ratio is that of the data sheet, and contact is ideal."""
        plain = Bench(self.unit, self.converter, Material(), None, False).spec()
        return "\n".join(x for x in plain.splitlines() if "ratio" not in x) + "\n"

    def codes(self, low: Array, high: Array, random: np.random.Generator | None) -> Array:
        """Return what contacts (contacts, strips) read, with noise or without."""
        volts = self.unit.read(low, high)
        if random is not None:
            error = (
                random.normal(0.0, 1.0 / np.sqrt(3.0), volts.shape)
                if self.normal
                else random.uniform(-1.0, 1.0, volts.shape)
            )
            volts = volts + self.noise * error
        return self.converter.codes(volts)


def maker(random: np.random.Generator, said: bool = False, metal: bool | None = None) -> Maker:
    """Return a unit drawn at random."""
    metal = bool(random.random() < 0.45) if metal is None else metal
    strips, pitch, length = (
        int(random.integers(5, 15)),
        round(random.uniform(4.0, 9.0), 1),
        round(random.uniform(100.0, 330.0)),
    )
    own = float(random.choice([0.0, 0.005, 0.025]))  # strips of one sheet, or of several
    unit = units.build(
        "crs-m" if metal else "crs-crs",
        strips,
        pitch,
        length,
        random,
        ohm=random.uniform(8e3, 3e4),
        ratio=random.uniform(0.85, 1.2),
        contact_lambda=random.uniform(0.002, 0.012) * length,
        each=own,
        clamp=0.0001,
    )
    assert isinstance(unit, Build)
    switches = metal and random.random() < 0.4
    unit = replace(unit, rungs=_RUNGS, switch=70.0 if switches or not metal else 1.0)
    converter = units.sound_converter(
        len(unit.names),
        strips,
        int(random.choice([10, 12, 12, 16])),
        random.choice([0.005, 0.02, 0.04]),
        0.01,
        random,
    )
    place = random.uniform(0.3, 1.0) if said else random.choice([0.0, 0.1])
    kind = (
        "places uncertain"
        if said
        else "70 ohm switches"
        if switches
        else "strips alike"
        if own < 0.01
        else "strips differ"
    )
    group = f"{unit.construction}, {kind}"
    return Maker(
        unit, converter, random.uniform(0.0005, 0.002), bool(random.random() < 0.5), float(place), said, group
    )


def plans(metal: bool) -> tuple[tuple[str, ...], ...]:
    """Return the plans that the software prints, as options of `calibrate --plan`."""
    told = command("calibrate", "--help")[1]
    most = "offset+gain+lambda" if metal else "offset+gain+ratios+lambda"
    return (
        (),
        ("--wanted", "0.1"),
        ("--wanted", "0.3"),
        ("--noise", "0.1"),
        ("--unit-mm", "5"),
        ("--model", most),
        *([("--uneven",)] if "--uneven" in told else []),
    )


def planned(spec: Path, folder: Path, options: tuple[str, ...]) -> tuple[list[dict[str, str]], float]:
    """Return the rows of a printed plan, and what it promises of other readings [% of Vref]."""
    out = folder / "plan.csv"
    code, printed, said = command("calibrate", "--plan", str(spec), "-o", str(out), *options)
    if code:
        raise RuntimeError(f"plan {options}: exit {code}: {said.strip()}")
    promise = re.search(r"within \+-([0-9.e-]+) % of Vref", printed)
    with out.open() as file:
        return list(csv.DictReader(file)), float(promise[1]) if promise else np.nan


def pressed(
    one: Maker, plan: list[dict[str, str]], repeats: int, random: np.random.Generator
) -> list[dict[str, str]]:
    """Return the plan's rows with readings, each press made anew `repeats` times where its owner could put it."""
    strips, rows = one.unit.strips, []
    for start in range(0, len(plan), strips):
        some = plan[start : start + strips]
        l = np.array([float(r["l_mm"]) for r in some])
        w = np.array([float(r["w_mm"]) for r in some])
        for _ in range(repeats):
            errors = random.normal(size=2) if one.said else random.uniform(-1.0, 1.0, 2)
            off, wider = one.place_mm * errors
            low = np.clip(l + off, 0.0, one.unit.length)
            high = np.clip(low + np.maximum(w + wider, 0.0) * (w > 0.0), low, one.unit.length)
            codes = one.codes(low[None], high[None], random)[:, 0]
            rows += [_filled(one, row, codes[:, i]) for i, row in enumerate(some)]
    return rows


def _filled(one: Maker, row: dict[str, str], codes: Array) -> dict[str, str]:
    columns = ["v_out"] if one.unit.construction in METAL else ["v_h", "v_l"]
    top = 2**one.converter.bits - 1
    row = row | {c: f"{_VREF * v / top:.5f}" for c, v in zip(columns, codes, strict=True)}
    if one.said:
        row |= {
            "l_sd_mm": f"{one.place_mm:.3f}",
            "w_sd_mm": f"{one.place_mm if float(row['w_mm']) else 0.0:.3f}",
        }
    return row


def save(path: Path, rows: list[dict[str, str]]) -> None:
    """Write runs."""
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys())
        writer.writeheader()
        writer.writerows(rows)


def score(seed: int, number: int, unaware: bool = False) -> dict[str, Any]:
    """Calibrate one unit; every fourth has places that are uncertain and says so.

    Uneven rubber is pressed by the plan for it, or, `unaware`, every unit's is, and by the others.
    """
    random = np.random.default_rng([14, 2, seed, number])
    one = maker(random, said=number % 4 == 3 and not unaware)
    choices = [p for p in plans(len(one.unit.names) == 1) if not unaware or "--uneven" not in p]
    options = choices[(number + number // 4) % len(choices)]
    repeats = REPEATS[(number + number // 4 + number // 24) % len(REPEATS)]
    if unaware or "--uneven" in options:
        u, spread = one.unit, random.uniform(0.005 if unaware else 0.03, 0.06)
        below0, below1 = (
            units.rubber(u.strips, b[:, -1].mean(), random, 0.01, spread) for b in (u.below0, u.below1)
        )
        unit = replace(u, below0=below0, below1=below1)
        one = replace(one, unit=unit, group=f"{u.construction}, {UNEVEN}")
    row = {
        "group": one.group,
        "plan": " ".join(options) or "default",
        "repeats": repeats,
        "said": one.said,
        "places": one.places,
    }
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        spec, runs = folder / "sensor.toml", folder / "runs.csv"
        spec.write_text(one.spec())
        plan, promise = planned(spec, folder, options)
        save(runs, pressed(one, plan, repeats, random))
        sensor = ts.Sensor.load(spec)
        done = ts.calibrate_unit(sensor, ts.read_runs(runs, sensor))
        row |= {
            "status": done.status,
            "advice": done.advice,
            "model": done.model,
            "promise": promise,
            "stated": done.accuracy_percent,
            "presses": len(plan) // one.unit.strips,
        }
        row["error"] = other_readings(one, done.sensor, folder, random)
    row["held"] = [
        (p.name, bool(abs(p.value - t) <= 2.0 * p.sigma), (p.value - t) / p.sigma)
        for p, t in true_values(one, done)
    ]
    return row


def other_readings(one: Maker, calibrated: ts.Sensor, folder: Path, random: np.random.Generator) -> float:
    """Return the 95 % quantile of corrected less expected readings of other contacts, noise-free [% of Vref]."""
    u = one.unit
    width = random.uniform(0.0, 0.45, _TESTS) * u.length * (random.random(_TESTS) > 0.15)
    low = random.uniform(0.02 * u.length, 0.98 * u.length - width)
    low, high = (np.broadcast_to(v[:, None], (_TESTS, u.strips)) for v in (low, low + width))
    fine = replace(one, converter=replace(one.converter, bits=16))  # no step of its own
    codes = fine.codes(low, high, None)
    log = Bench(u, fine.converter, Material(), None, False)
    logs.write(folder / "others.csv", log, codes, np.arange(_TESTS) / 10.0)
    scans = ts.read_readings(folder / "others.csv", calibrated)
    ideal = Unit(
        u.names, u.strips, u.pitch, u.length, calibrated.contact_lambda_mm, calibrated.resistivity_ratio
    )
    got = np.stack([[getattr(s, n) for s in scans] for n in u.names])
    off = np.abs(got - ideal.read(low, high))[(codes > 0) & (codes < 2**16 - 1)]
    return 100.0 * float(np.quantile(off, 0.95))


def true_values(one: Maker, done: ts.Calibrated) -> Iterator[tuple[Any, float]]:
    """Yield printed parameters with their truth, where the unit has them in the same definition.

    Clamps and switches in series scale and shift a strip's potentials, which offset and gain take up as long as they
    are small: with switches of 70 ohm a contact that bridges a part of the strip changes the share, so that no constant
    is the unit's.
    """
    if one.group.endswith(("switches", UNEVEN)):
        return
    u, parts = one.unit, done.model.split("+")
    strip_ohm = u.below0[:, -1]
    switch = u.switch if len(u.names) == 1 else u.supply * u.strips
    ends = u.clamp0 + switch
    whole = strip_ohm + ends.sum(axis=1)
    ratios = u.below1[:, -1] / strip_ohm
    per_mm = (strip_ohm if len(u.names) == 1 else strip_ohm + u.below1[:, -1]) / u.length
    for p in done.parameters:
        if p.name == "contact lambda":
            yield (
                p,
                float(np.mean(1.0 / np.sqrt(per_mm * u.conductance()))),
            )  # each strip's own is a little another
        elif p.name.startswith("offset ") and "gain" in parts and "fade" not in parts:
            c = u.names.index(p.name.split()[1])
            scale = _VREF if p.unit == "V" else 1.0
            yield (
                p,
                scale
                * float(
                    one.converter.offset[c, p.strip]
                    + one.converter.gain[c, p.strip] * (ends[:, 0] / whole)[p.strip]
                ),
            )
        elif p.name.startswith("gain ") and "offset" in parts and "fade" not in parts:
            c = u.names.index(p.name.split()[1])
            yield p, float(one.converter.gain[c, p.strip] * (strip_ohm / whole)[p.strip])
        elif p.name == "resistivity ratio":
            yield p, float(ratios.mean() if p.strip is None else ratios[p.strip])


# What must be refused: what the owner did to the runs (rows, the maker, a generator), or to the spec.
Rows = list[dict[str, str]]


def _scaled(factor: float) -> Callable[[Rows, Maker, np.random.Generator], Rows]:
    return lambda rows, *_: [r | {k: f"{factor * float(r[k]):.5f}" for k in ("l_mm", "w_mm")} for r in rows]


def _volts(factor: float) -> Callable[[Rows, Maker, np.random.Generator], Rows]:
    return lambda rows, *_: [
        r | {k: f"{factor * float(r[k]):.6f}" for k in r if k.startswith("v_")} for r in rows
    ]


def _swapped(a: str, b: str) -> Callable[[Rows, Maker, np.random.Generator], Rows]:
    return lambda rows, *_: [r | {a: r[b], b: r[a]} for r in rows]


def _moved(order: Callable[[int, int], int]) -> Callable[[Rows, Maker, np.random.Generator], Rows]:
    """Return a change that numbers strips otherwise; the places, which the owner measured, stay."""

    def change(rows: Rows, one: Maker, _: np.random.Generator) -> Rows:
        n, out = one.unit.strips, []
        for start in range(0, len(rows), n):
            some = rows[start : start + n]
            out += [
                row | {k: some[order(i, n)][k] for k in row if k.startswith("v_")}
                for i, row in enumerate(some)
            ]
        return out

    return change


def _places(rows: Rows, lower: Callable[[float, float], str]) -> Rows:
    return [r | {"l_mm": lower(float(r["l_mm"]), float(r["w_mm"]))} for r in rows]


def _mixed(rows: Rows, one: Maker, random: np.random.Generator) -> Rows:
    """Half of the presses are of another unit."""
    while True:
        other = maker(random, metal=len(one.unit.names) == 1)
        other = replace(
            other,
            converter=units.sound_converter(
                len(one.unit.names), one.unit.strips, one.converter.bits, 0.05, 0.01, random
            ),
        )
        below = [
            units.rubber(one.unit.strips, b[:, -1].mean(), random, 0.03)
            for b in (other.unit.below0, other.unit.below1)
        ]
        unit = replace(
            one.unit, below0=below[0], below1=below[1], contact_lambda=4.0 * one.unit.contact_lambda
        )
        strange, n = replace(other, unit=unit), one.unit.strips
        if np.abs(strange.converter.offset - one.converter.offset).mean() > 0.015:
            break
    again = pressed(strange, [r | {"v_h": "", "v_l": ""} for r in rows], 1, random)
    pick = random.permutation(np.arange(len(rows) // n) % 2 == 0)
    keys = list(rows[0])
    return [{k: (again if pick[i // n] else rows)[i][k] for k in keys} for i in range(len(rows))]


WRONG: dict[str, Callable[[Rows, Maker, np.random.Generator], Rows]] = {
    "places in cm": _scaled(0.1),
    "places in m": _scaled(0.001),
    "places in inches": _scaled(1.0 / 25.4),
    "v_h and v_l exchanged": _swapped("v_h", "v_l"),
    "l and w exchanged": _swapped("l_mm", "w_mm"),
    "w is the upper end": lambda rows, *_: [
        r | {"w_mm": f"{float(r['l_mm']) + float(r['w_mm']):.4f}"} for r in rows
    ],
    "l from the end at Vref": lambda rows, one, _: _places(
        rows, lambda l, w: f"{one.unit.length - l - w:.4f}"
    ),
    "l is the upper end": lambda rows, *_: _places(rows, lambda l, w: f"{l + w:.4f}"),
    "strips reversed": _moved(lambda i, n: n - 1 - i),
    "strips shifted": _moved(lambda i, n: (i + 2) % n),
    "another unit's runs mixed in": _mixed,
    "fractions for volts": _volts(1.0 / _VREF),
    "millivolts for volts": _volts(1000.0),
    "volts of a 3.3 V converter": _volts(0.66),
}
FILES = (
    "another construction",
    "another length",
    "another unit's name",
    "readings",
    "spec",
    "recording",
    "empty",
    "picture",
    "shapes",
)


def score_wrong(seed: int, number: int) -> dict[str, Any]:
    """Calibrate with runs that are wrong in one way: exit code 1 or 2 and no spec is asked for."""
    random = np.random.default_rng([14, 3, seed, number])
    kind = [*WRONG, *FILES][number % (len(WRONG) + len(FILES))]
    one = maker(random, metal=False if "v_h" in kind else None)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        spec, runs, out = folder / "sensor.toml", folder / "runs.csv", folder / "calibrated.toml"
        spec.write_text(one.spec())
        plan, _ = planned(spec, folder, random.permutation(np.array([(), ("--wanted", "0.1")], object))[0])
        if kind.startswith("strips"):  # bars that lie slanted, or nothing could tell
            slope = random.choice([-1.0, 1.0]) * random.uniform(0.15, 0.3) * one.unit.length / one.unit.strips
            for row in plan:
                at = float(row["l_mm"]) + slope * (int(row["strip"]) - 0.5 * one.unit.strips)
                row["l_mm"] = f"{np.clip(at, 0.0, 0.98 * one.unit.length - float(row['w_mm'])):.4f}"
        rows = pressed(one, plan, int(random.integers(1, 4)), random)
        extra: tuple[str, ...] = ()
        if kind in WRONG:
            save(runs, WRONG[kind](rows, one, random))
        else:
            save(runs, rows)
            runs, extra = _file(kind, folder, runs, spec, one, random)
        code, said, err = command("calibrate", str(spec), str(runs), "-o", str(out), *extra)
        return {
            "kind": kind,
            "group": one.unit.construction,
            "code": code,
            "refused": code in (1, 2) and not out.exists(),
            "said": (err.strip() or said.strip())[-220:].replace("\n", " "),
        }


def _file(
    kind: str, folder: Path, runs: Path, spec: Path, one: Maker, random: np.random.Generator
) -> tuple[Path, tuple[str, ...]]:
    """Put a file of another kind in place of the runs, or another spec."""
    path = folder / "other.csv"
    match kind:
        case "another construction":  # with the columns renamed by hand, and the plan's own remark cut away
            with runs.open() as file:
                rows = [
                    {k: v for k, v in r.items() if k not in ("sensor", "unit")} for r in csv.DictReader(file)
                ]
            metal = one.unit.construction in METAL
            spec.write_text(
                spec.read_text().replace("crs-m" if metal else "crs-crs", "crs-crs" if metal else "crs-m")
            )
            if metal:
                rows = [
                    {k: v for k, v in r.items() if k != "v_out"} | {"v_h": r["v_out"], "v_l": r["v_out"]}
                    for r in rows
                ]
            else:
                rows = [
                    {k: v for k, v in r.items() if not k.startswith("v_")} | {"v_out": r["v_h"]} for r in rows
                ]
            save(path, rows)
        case "another length":
            spec.write_text(
                spec.read_text().replace(
                    f"length_mm = {one.unit.length:g}", f"length_mm = {1.6 * one.unit.length:g}"
                )
            )
            return runs, ()
        case "another unit's name":
            with runs.open() as file:
                save(path, [r | {"unit": "left-hand"} for r in csv.DictReader(file)])
            return path, ("--unit", "right-hand")
        case "readings" | "recording":
            low = np.broadcast_to(random.uniform(0.1, 0.5, (20, 1)) * one.unit.length, (20, one.unit.strips))
            codes = one.codes(low, low + 0.2 * one.unit.length, random)
            logs.write(
                path, Bench(one.unit, one.converter, Material(), None, False), codes, np.arange(20) / 10.0
            )
            if kind == "recording":
                command("convert", str(spec), str(path), "-o", str(folder / "other.mcap"))
                return folder / "other.mcap", ()
        case "spec":
            return spec, ()
        case "empty":
            path.write_text(str(random.choice(["", "strip,l_mm,w_mm,v_h,v_l\n"])))
        case "picture":
            path.write_bytes(b"\x89PNG\r\n\x1a\n" + random.bytes(4000))
        case "shapes":
            path.write_text('{"type": "FeatureCollection", "features": []}')
    return path, ()


def table(rows: list[dict[str, Any]]) -> list[str]:
    """Return what is left on other readings, and what ranges hold."""
    rows = [r for r in rows if "error" in r and not isinstance(r["error"], str)]
    head = (
        f"| units | cases | ok | within {ASKED} % | within the plan's promise | within what is stated "
        "| median, % of Vref | worst |"
    )
    lines = [head, "|" + " --- |" * 8]

    def line(title: str, some: list[dict[str, Any]]) -> str:
        e = [r["error"] for r in some]
        return (
            f"| {title} | {len(some)} | {sum(r['status'] == 'ok' for r in some)} | {sum(x <= ASKED for x in e)}"
            f" | {sum(r['error'] <= r['promise'] for r in some)} | {sum(r['error'] <= r['stated'] for r in some)}"
            f" | {np.median(e):.3f} | {max(e):.3f} |"
        )

    for key in ("group", "plan", "repeats", "places"):
        for value in sorted({r[key] for r in rows}, key=str):
            title = str(value) if key == "group" else f"{key}: {value}"
            lines += [line(title, [r for r in rows if r[key] == value])]
    lines.append(line("all with exact places", [r for r in rows if not r["said"]] or rows))
    lines += [
        "",
        "| two-sigma ranges | values | held, % | rms of (value - truth) / sigma |",
        "|" + " --- |" * 4,
    ]
    for places in [*sorted({r["places"] for r in rows}), "all"]:
        held = [h for r in rows if places in ("all", r["places"]) for h in r["held"]]
        for name in [*sorted({h[0].split()[0] for h in held}), "all"]:
            some = [h for h in held if name in ("all", h[0].split()[0])]
            if some:
                spread = np.sqrt(np.mean([h[2] ** 2 for h in some]))
                lines.append(
                    f"| {places}: {name} | {len(some)} | {100.0 * np.mean([h[1] for h in some]):.1f} | {spread:.2f} |"
                )
    lines += ["", f"above {ASKED} % or not ok:"]
    for r in (r for r in rows if r["error"] > ASKED or r["status"] != "ok"):
        plan = f"plan {r['plan']} ({r['presses']} presses, {r['repeats']} times)"
        lines.append(f"- {r['group']}, {plan}: {r['error']:.2f} %, {r['status']}, {r['model']}")
    return lines


def table_wrong(rows: list[dict[str, Any]]) -> list[str]:
    """Return how many wrong cases were refused, by kind."""
    lines = ["| wrong | cases | refused | exit codes |", "|" + " --- |" * 4]
    for kind in [*dict.fromkeys(r["kind"] for r in rows), "all"]:
        some = [r for r in rows if kind in ("all", r["kind"])]
        codes = " ".join(str(r["code"]) for r in some) if kind != "all" else ""
        lines.append(f"| {kind} | {len(some)} | {sum(r['refused'] for r in some)} | {codes} |")
    lines += ["", "taken, or worse:"]
    return lines + [
        f"- {r['kind']} ({r['group']}): exit {r['code']}: {r['said']}" for r in rows if not r["refused"]
    ]
