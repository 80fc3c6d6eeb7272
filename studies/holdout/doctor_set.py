"""The doctor on units of `units.py`: sound ones in every use, and one fault each, wired where it is."""

from __future__ import annotations

import contextlib
import io
import json
import re
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from studies.holdout import logs, units
from studies.holdout.logs import Bench, Fault, Touching
from studies.holdout.units import METAL, Array, Bridge, Build

# What a fault may be called: a pattern that the finding's kind must match, and whether it must name the strip.
KINDS: dict[str, tuple[str, bool]] = {
    "dead channel": ("dead|stuck", True),
    "stuck channel": ("dead|stuck", True),
    "open strip": ("open-?(strip|end|clamp)?$", True),
    "open at one end": ("open-?(end|strip|clamp|wire)?", True),
    "open sensing strip": ("open-?sens|dead", True),
    "open sensing wire": ("open-?sens|dead|stuck|wire", True),
    "short, sensing": ("short", True),
    "short, metal": ("short", True),
    "short, metal edge pair": ("short", True),
    "v_h, v_l exchanged": ("swapped-wires|exchanged", True),
    "ends exchanged": ("swapped-ends", True),
    "strips exchanged": ("swapped-strips", True),
    "saturation": ("saturat", True),
    "wrong Vref": ("vref", False),
    "drift of 1-3 %": ("drift", True),
    "slow wander": ("drift|wander", True),
    "intermittent 10-50 %": ("intermittent|loose", True),
    "hum": ("hum", False),
    "excess noise": ("noise", True),
    "missing bit": ("bit", False),
    "pressure": ("pressure", False),
    "cut recording": ("cut", False),
}
CUT = re.compile(
    r"\b(cut|incomplete|truncat|partly|in part|damaged|ends? (early|within|in the middle|before)|unfinished)",
    re.I,
)
_SCANS = 900


def command(*arguments: str) -> tuple[int, str, str]:
    """Run the command line in this process; return exit code, standard output and standard error."""
    from tacstrip.cli import main

    out, err = io.StringIO(), io.StringIO()
    code: Any = 0
    before, sys.argv = sys.argv, ["tacstrip", *arguments]
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            main()
        except SystemExit as end:
            code = end.code
        except Exception as error:  # a traceback is a finding of its own
            code = 99
            err.write(f"Traceback: {type(error).__name__}: {error}")
        finally:
            sys.argv = before
    return int(code or 0), out.getvalue(), err.getvalue()


def healthy(random: np.random.Generator, number: int) -> tuple[Bench, Touching, Array, str]:
    """Return a sound unit in a use, and its log's codes."""
    use = logs.USES[number % len(logs.USES)]
    construction = str(random.choice(["crs-crs", "crs-m", "cyl-crs-m", "crs-crp"], p=[0.5, 0.3, 0.1, 0.1]))
    strips = 100 if use == "wide" else int(random.integers(8, 25))
    construction, strips = (
        ("crs-crs", strips) if use == "wide" and construction == "crs-crp" else (construction, strips)
    )
    construction = "crs-m" if use == "untouched" and construction == "crs-crp" else construction
    strips = min(strips, 12) if construction == "crs-crp" else strips
    one = logs.bench(random, construction, strips, rests=use == "untouched")
    scans = {"short": int(random.integers(15, 60)), "long": 2000, "wide": 500}.get(
        use, int(random.integers(300, 900))
    )
    scans = min(scans, 200) if construction == "crs-crp" else scans
    if use == "held":
        one = replace(one, material=replace(one.material, creep=random.uniform(0.0, 0.037)))
    touch = logs.touching(use, one.unit, scans, float(random.choice([7.3, 12.0, 20.0, 43.0])), random)
    wrong = None
    if use == "common drift":
        all_of_it = random.choice([-1.0, 1.0]) * random.uniform(0.005, 0.015)
        wrong = lambda volts, time_s: volts + all_of_it * time_s / time_s[-1, -1]  # noqa: E731
    return one, touch, logs.lines(one, touch, random, wrong), use


def faulty(random: np.random.Generator, kind: str) -> tuple[Bench, Touching, Array, tuple[int, ...]]:
    """Return a unit with one fault in the recommended use, its log's codes, and the strips that have it."""
    sensing = kind in ("open sensing strip", "open sensing wire", "short, sensing", "v_h, v_l exchanged")
    metal = kind.startswith("short, metal")
    construction = (
        "crs-crs"
        if sensing
        else "crs-m"
        if metal
        else str(random.choice(["crs-crs", "crs-crs", "crs-m", "cyl-crs-m"]))
    )
    strips = int(random.integers(12 if metal else 10, 25))
    one = logs.bench(random, construction, strips, plain=True)
    one = replace(one, codes=one.codes or kind == "missing bit")
    white = one.material.white
    unit = one.unit
    assert isinstance(unit, Build)
    rate = random.uniform(11.0, 19.0)
    while any(abs(hz / rate - round(hz / rate)) < 0.1 for hz in (50.0, 60.0)):  # not in step with mains
        rate = random.uniform(11.0, 19.0)
    touch = logs.exercise(unit, _SCANS, rate, random)
    strip, length = int(random.integers(0, strips)), unit.length
    channel, until = int(random.integers(len(unit.names))), float(touch.time_s[-1])
    level, at = random.uniform(0.0, 1.0), random.uniform(0.25, 0.75) * length
    fault: Fault | None = None
    mine: tuple[int, ...] = (strip,)
    wrong: Callable[[Array, Array], Array] | None = None

    def one_channel(change: Callable[[Array, Array], Array]) -> Callable[[Array, Array], Array]:
        def changed(volts: Array, time_s: Array) -> Array:
            volts = volts.copy()
            volts[channel, :, strip] = change(volts[channel, :, strip], time_s[:, strip])
            return volts

        return changed

    def whole_strip(change: Callable[[Array, Array], Array]) -> Callable[[Array, Array], Array]:
        def changed(volts: Array, time_s: Array) -> Array:
            volts = volts.copy()
            volts[:, :, strip] = change(volts[:, :, strip], time_s[:, strip])
            return volts

        return changed

    def turned(change: Callable[[Array], Array]) -> Callable[[Array, Array], Array]:
        def changed(volts: Array, time_s: Array) -> Array:
            volts = volts.copy()
            volts[:, :, strip] = change(volts[::-1, :, strip])
            return volts

        return changed

    match kind:
        case "dead channel":
            wrong = one_channel(lambda v, t: 0.0 * v)
        case "stuck channel":
            wrong = one_channel(lambda v, t: level + 0.2 * white * random.normal(size=v.shape))
        case "open strip":
            fault = Fault(units.broken(unit, strip, at), mine)
        case "open at one end":
            fault = Fault(units.unclamped(unit, strip, int(random.integers(2))), mine)
        case "open sensing strip":
            fault = Fault(units.broken(unit, strip, at, layer=1), mine)
        case "open sensing wire":
            fault = Fault(units.unclamped(unit, strip, int(random.integers(2)), layer=1), mine)
        case "short, sensing" | "short, metal" | "short, metal edge pair":
            strip = int(random.integers(1, strips - 2))
            if "edge" in kind:
                strip = int(random.choice([0, strips - 2]))
            mine = (strip, strip + 1)
            place = (
                random.choice([0.0, length])
                if sensing and random.random() < 0.3
                else random.uniform(0.1, 0.9) * length
            )
            if metal:  # half way along it does least, as the page says
                place = float(random.choice([random.uniform(0.1, 0.4), random.uniform(0.6, 0.9)])) * length
            bridge = Bridge(
                strip, int(sensing), float(place), float(np.exp(random.uniform(0.0, np.log(200.0))))
            )
            fault = Fault(replace(unit, bridges=(bridge,)), mine)
        case "v_h, v_l exchanged":
            wrong = turned(lambda v: v)
        case "ends exchanged":  # Vref and ground of a strip, or the pair laid the wrong way round
            if len(unit.names) == 2 and level < 0.5:
                wrong = turned(lambda v: 1.0 - v)
            else:
                wrong = whole_strip(lambda v, t: 1.0 - v)
        case "strips exchanged":
            strip = int(random.integers(0, strips - 1))
            mine = (strip, strip + 1)
        case "saturation":
            top = level < 0.6
            limit = random.uniform(0.55, 0.9) if top else random.uniform(0.1, 0.4)
            wrong = one_channel(lambda v, t: np.minimum(v, limit) if top else np.maximum(v, limit))
        case (
            "wrong Vref"
        ):  # the converter's reference lies above the strips' supply: 3.3 V read with 5 V, or a bad wire
            scale = 0.66 if level < 0.3 else random.uniform(0.85, 0.95)
            wrong = lambda v, t: scale * v  # noqa: E731
        case "drift of 1-3 %":
            size = random.choice([-1.0, 1.0]) * random.uniform(0.01, 0.03)
            bend = random.uniform(0.7, 1.5)
            wrong = whole_strip(lambda v, t: v + size * (t / until) ** bend)
        case "slow wander":
            size = random.uniform(0.01, 0.02)
            slow = size * _slow(touch.time_s, random)
            wrong = whole_strip(lambda v, t: v + slow)
        case "intermittent 10-50 %":
            away = _telegraph(touch.time_s, random.uniform(0.1, 0.5), random.uniform(0.15, 1.5), random)
            where = random.integers(3 if construction == "crs-crs" else 2)
            gone = units.unclamped(unit, strip, int(where) % 2, layer=int(where == 2))
            fault = Fault(gone, mine, lambda time_s: np.broadcast_to(away[:, None], time_s.shape))
        case "hum":
            one = replace(
                one,
                material=replace(
                    one.material,
                    hum=max(2.0 * white, random.uniform(0.004, 0.012)),
                    hum_hz=float(random.choice([50.0, 60.0])),
                ),
            )
        case "excess noise":
            more = max(5.0 * white, 0.012) * random.uniform(1.0, 2.0)
            wrong = one_channel(lambda v, t: v + more * random.normal(size=v.shape))
        case "pressure":
            press = _force(touch, random)
            wrong = lambda v, t: press + 0.01 * (v - v.mean())  # noqa: E731
    if kind == "cut recording":
        mine = ()
    codes = logs.lines(one, touch, random, wrong, fault)
    if kind == "strips exchanged":
        codes[:, :, [strip, strip + 1]] = codes[:, :, [strip + 1, strip]]
    if kind == "missing bit":
        bit = 1 << int(random.integers(0, one.converter.bits - 4))
        codes = np.where(codes < 0, codes, codes & ~bit if level < 0.5 else codes | bit)
    return one, touch, codes, mine


def _slow(time_s: Array, random: np.random.Generator) -> Array:
    """Return a wander of deviation 1 over a few periods of the recording, of no form that repeats."""
    phase = np.linspace(0.0, 1.0, len(time_s))
    parts = [
        random.normal() * np.sin(2.0 * np.pi * f * phase + random.uniform(0.0, 6.3))
        for f in random.uniform(0.8, 5.0, 5)
    ]
    total = np.sum(parts, axis=0)
    return np.asarray((total - total.mean()) / total.std())


def _telegraph(time_s: Array, share: float, dwell_s: float, random: np.random.Generator) -> Array:
    """Return (scans,) whether a contact is away, a share of the time, for `dwell_s` at a time on average."""
    away = np.zeros(len(time_s), bool)
    state = random.random() < share
    for i, gap in enumerate(np.diff(time_s, prepend=time_s[0])):
        leave = dwell_s if state else dwell_s * (1.0 - share) / share
        if random.random() < 1.0 - np.exp(-gap / leave):
            state = not state
        away[i] = state
    return away


def _force(touch: Touching, random: np.random.Generator) -> Array:
    """Return what all channels of a sensor of pressure read: how hard and how widely a strip is touched, wherever."""
    hard = 0.5 + 0.35 * np.sin(np.cumsum(np.diff(touch.time_s, prepend=0.0)) * random.uniform(0.5, 2.0))
    area = np.nan_to_num(touch.high - touch.low) / max(1e-9, float(np.nanmax(touch.high - touch.low)))
    return np.asarray(area * hard[:, None] / (area * hard[:, None] + 0.3))


def score(seed: int, number: int) -> dict[str, Any]:
    """Let the doctor examine a recording: odd numbers are faulty units."""
    random = np.random.default_rng([14, 1, seed, number])
    with tempfile.TemporaryDirectory() as folder:
        file, spec = Path(folder) / "readings.csv", Path(folder) / "sensor.toml"
        sound = number % 2 == 0
        if sound:
            one, touch, codes, kind = healthy(random, number // 2)
            mine: tuple[int, ...] = ()
        else:
            kind = list(KINDS)[number // 2 % len(KINDS)]
            one, touch, codes, mine = faulty(random, kind)
        spec.write_text(one.spec())
        logs.write(file, one, codes, touch.time_s)
        examined, packed = file, random.random() < 0.25 or kind == "cut recording"
        if packed and (kind != "cut recording" or random.random() < 0.6):
            examined = Path(folder) / "readings.mcap"
            code, _, said = command("convert", str(spec), str(file), "-o", str(examined))
            if code:
                return {
                    "sound": sound,
                    "kind": kind,
                    "verdict": "error",
                    "said": f"convert: {said.strip()[-200:]}",
                }
        if kind == "cut recording":
            data = examined.read_bytes()
            examined.write_bytes(data[: int(random.uniform(0.3, 0.95) * len(data))])
        asked = ["doctor", str(examined), "--json", *(["--sensor", str(spec)] if examined is file else [])]
        code, out, err = command(*asked)
    row = {
        "sound": sound,
        "kind": kind,
        "strips": one.unit.strips,
        "construction": one.unit.construction,
        "mine": mine,
    }
    return row | verdict(kind, mine, sound, code, out, err, one.unit.construction in METAL)


def verdict(
    kind: str, mine: tuple[int, ...], sound: bool, code: int, out: str, err: str, metal: bool = False
) -> dict[str, Any]:
    """Return `verdict` (named, asked, missed, or ok, alarm, asked), and what was said besides."""
    if kind == "cut recording":
        said = CUT.search(out + err) is not None
        return {"verdict": "named" if said and code != 99 else "missed", "said": (err + out)[:150].strip()}
    if code not in (0, 1):
        return {"verdict": "error", "said": f"exit {code}: {err.strip()[-200:]}"}
    report = json.loads(out)
    entries: list[dict[str, Any]] = []
    for key in ("findings", "questions", "notes"):
        entries += [e | {"from": key} for e in report.get(key, [])]
    asks = [e for e in entries if e["from"] == "questions" or e.get("severity") == "question"]
    finds = [e for e in entries if e["from"] == "findings" and e not in asks]
    words = "; ".join(f"{'? ' * (e in asks)}{e.get('fault')} {e.get('strips')}" for e in [*finds, *asks])
    if sound:
        return {
            "verdict": "alarm" if finds or (code == 1 and not asks) else "asked" if asks else "ok",
            "said": words,
        }
    pattern, place = KINDS[kind]

    def right(entry: dict[str, Any]) -> bool:
        names = [entry.get("fault", ""), *causes(entry)]
        if kind == "dead channel" and metal:  # a sheet that stays on ground, as docs/guide/doctor.md says
            names = [re.sub("^open.*", "dead", str(n)) for n in names]
        strips = set(entry.get("strips") or ())
        here = not place or (bool(strips & set(mine)) and strips <= set(mine))
        return here and any(re.search(pattern, str(n)) for n in names) and len(causes(entry)) <= 2

    state = "named" if any(map(right, finds)) else "asked" if any(map(right, asks)) else "missed"
    return {"verdict": state, "said": words, "others": sum(not right(e) for e in finds)}


def causes(entry: dict[str, Any]) -> list[str]:
    """Return the causes that a question offers, by whatever name they go."""
    for key in ("causes", "faults", "either", "may_be", "candidates", "kinds"):
        if isinstance(entry.get(key), list):
            return [c.get("fault", str(c)) if isinstance(c, dict) else str(c) for c in entry[key]]
    return []


def table(rows: list[dict[str, Any]]) -> list[str]:
    """Return two tables: faults by kind, sound units by use."""
    bad, good = ([r for r in rows if r["sound"] == s] for s in (False, True))
    lines = [
        "| fault | units | named | asked | missed | error | named or asked, % | other findings |",
        "|" + " --- |" * 8,
    ]
    for kind in [*dict.fromkeys(r["kind"] for r in bad), "all"]:
        some = [r for r in bad if kind in ("all", r["kind"])]
        count = [sum(r["verdict"] == v for r in some) for v in ("named", "asked", "missed", "error")]
        share = 100.0 * (count[0] + count[1]) / max(1, len(some))
        lines.append(
            f"| {kind} | {len(some)} | "
            + " | ".join(map(str, count))
            + f" | {share:.1f} | {sum(r.get('others', 0) for r in some)} |"
        )
    lines += ["", "| sound units | recordings | no fault | false alarm | asked | error |", "|" + " --- |" * 6]
    for use in [*dict.fromkeys(r["kind"] for r in good), "all"]:
        some = [r for r in good if use in ("all", r["kind"])]
        count = [sum(r["verdict"] == v for r in some) for v in ("ok", "alarm", "asked", "error")]
        lines.append(f"| {use} | {len(some)} | " + " | ".join(map(str, count)) + " |")
    wrong = [r for r in rows if r["verdict"] in ("missed", "alarm", "error")]
    lines += ["", "missed, alarmed, failed:"]
    for r in wrong:
        unit = f"{r.get('construction')}, {r.get('mine')} of {r.get('strips')}"
        lines.append(f"- {r['kind']} ({unit}): {r['verdict']}: {r['said'][:160]}")
    return lines
