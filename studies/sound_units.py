"""What the doctor says of units that nothing is wrong with, drawn wider than `holdout` draws them.

Strips from 4 to 100, of uneven rubber, with cold joints and a frame over their ends; a supply 1 % off; noise of .05 to
1 % that differs from strip to strip, wander, hum of all, temperature; 24 ways to touch them. Readings are the closed
form over each strip's own resistance, apart from the package's models. `python -m studies.sound_units [units] [first]`
prints each finding, and counts: findings are false alarms, questions are asked in vain.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from dataclasses import dataclass

import numpy as np

from studies.holdout.first_order import first_order
from tacstrip.arrays import FloatArray
from tacstrip.diagnose.doctor import diagnose
from tacstrip.diagnose.log import Log
from tacstrip.sensor.spec import Sensor

USES = (
    "exercise", "short exercise", "long exercise", "drag", "scribble", "presses", "slow presses", "taps", "fast taps",
    "one press", "held", "roll", "rolls and lifts", "ball", "two objects", "three fingers", "sway at an edge",
    "ground end", "far end", "palm", "few scans", "nothing", "narrow slides", "same two places",
)  # fmt: skip
_KNOTS, _EDGE_KEEPS = 9, 0.97
_OUTLINES = 24  # corners of a round one
_TAU_S = (2.0, 9.0, 40.0, 180.0, 900.0)  # of the wander


@dataclass(frozen=True)
class _Unit:
    """A unit without a fault: what its user wrote down, and each strip's resistance below evenly spaced places."""

    sensor: Sensor
    below: FloatArray  # (strips, places), of a mean strip
    clamps: FloatArray  # (strips, 2)
    rim: float  # of the length, at either end, that nothing reaches
    offset: float
    gain: float
    supply: float


@dataclass(frozen=True)
class _Object:
    """An outline (corners, 2) and where it is: centre (scans, 2), angle, size, and whether it touches (scans,)."""

    outline: FloatArray
    at: FloatArray
    angle: FloatArray
    size: FloatArray
    down: FloatArray


def recording(seed: int, use: str = "") -> tuple[Log, str]:
    """Draw a sound unit, and how it is touched; return what it reads."""
    rng = np.random.default_rng([seed, 77])
    use = use or USES[seed % len(USES)]
    unit = _unit(rng, logs_rest=use == "nothing")
    strips = unit.sensor.strips
    rate = float(rng.choice([5.0, 11.3, 20.0, 37.0, 60.0, 130.0, 220.0]))
    scans = {"short exercise": 60, "long exercise": 2500, "few scans": int(rng.integers(2, 16))}.get(
        use, int(rng.integers(150, 900))
    )
    scans = min(scans, 40_000 // strips)
    time_s = np.arange(scans) / rate
    low, up = np.full((2, scans, strips), np.nan)
    for thing in _things(rng, use, unit.sensor, scans):
        one_low, one_up = _ends(thing, unit.sensor)
        low, up = np.fmin(low, one_low), np.fmax(up, one_up)
    low, up = _soft(rng, low, up, time_s, unit.rim, creeps=use in ("held", "one press", "palm"))
    k = _readings(rng, unit, low, up)
    _disturb(rng, k, time_s, unit)
    steps = 2.0 ** (unit.sensor.adc_bits or 12) - 1.0
    touched = np.isfinite(low)
    for name in k:
        logged = np.isfinite(k[name])
        k[name] = np.where(logged, np.round(np.clip(k[name], 0.0, 1.0) * steps) / steps, np.nan)
        if unit.sensor.rest_volt is None:
            k[name][~touched] = np.nan
    return Log.of(unit.sensor, time_s, k), use


def _unit(rng: np.random.Generator, *, logs_rest: bool) -> _Unit:
    kind = str(rng.choice(["crs-crs", "crs-m", "cyl-crs-m"], p=[0.55, 0.3, 0.15]))
    strips = int(rng.choice([4, 5, 6, 8, 10, 12, 16, 20, 24, 32, 48, 64, 100]))
    pitch = float(rng.uniform(2.0, 10.0))
    length = float(rng.uniform(0.6, 4.0) * min(strips, 30) * pitch)
    rest = float(rng.choice([0.0, 0.15, 0.3, 0.5])) if logs_rest or rng.random() < 0.5 else None
    sensor = Sensor(
        construction=kind, strips=strips, pitch_mm=pitch, length_mm=length,
        radius_mm=strips * pitch / 5.0 if "cyl" in kind else None,
        resistivity_ratio=float(np.exp(rng.uniform(-1.0, 1.0))) if kind == "crs-crs" else 1.0,
        contact_lambda_mm=float(rng.uniform(0.0, 0.012)) * length if rng.random() < 0.6 else 0.0,
        adc_bits=int(rng.choice([10, 12, 14, 16])), rest_volt=rest,
        touch_volt=None if rest is None else float(rng.uniform(0.1, 0.25)),
    )  # fmt: skip
    density = np.exp(rng.uniform(0.0, 0.06) * rng.normal(size=(strips, _KNOTS)))
    y = np.linspace(0.0, _KNOTS - 1.0, 201)
    density = np.stack([np.interp(y, np.arange(_KNOTS), d) for d in density])
    below = np.concatenate(
        [np.zeros((strips, 1)), np.cumsum((density[:, 1:] + density[:, :-1]) / 400.0, axis=1)], axis=1
    )
    return _Unit(
        sensor,
        below,
        clamps=rng.uniform(0.0, rng.uniform(0.0, 0.012), (strips, 2)),
        rim=float(rng.choice([0.0, 0.0, 0.01, 0.02])),
        offset=float(rng.choice([0.0, 0.003, 0.01, 0.02])),
        gain=float(rng.uniform(0.0, 0.015)),
        supply=1.0 + float(rng.uniform(-0.01, 0.01)),
    )


def _outline(rng: np.random.Generator, wide: float, tall: float) -> FloatArray:
    """Return a convex outline (corners, 2) [mm], round or with 3 to 7 corners, upright or not."""
    kind = rng.choice(["round", "corners", "block", "slanted"])
    angle = np.linspace(0.0, 2.0 * np.pi, _OUTLINES, endpoint=False)
    if kind == "corners":
        angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, int(rng.integers(5, 9))))
    points = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    if kind == "block":
        points = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    if kind == "slanted":
        points = np.array([(-1.0, -1.0), (1.0, -0.4), (0.8, 1.0), (-0.7, 0.6)])
    points = points - (points.max(axis=0) + points.min(axis=0)) / 2.0
    return np.asarray(points / np.ptp(points, axis=0) * (wide, tall))


def _along(points: FloatArray, scans: int) -> FloatArray:
    """Return places (scans, 2) along a polyline at one speed."""
    far = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    at = np.linspace(0.0, far[-1], scans)
    return np.stack([np.interp(at, far, p) for p in points.T], axis=1)


def _things(rng: np.random.Generator, use: str, sensor: Sensor, scans: int) -> list[_Object]:
    """Return the objects of a use."""
    size = np.array([sensor.width_mm, sensor.length_mm])
    pitch, ones = sensor.pitch_mm, np.ones(scans)
    wide = rng.uniform(2.5, max(3.0, 0.7 * sensor.strips)) * pitch
    tall = rng.uniform(0.06, 0.45) * sensor.length_mm
    turn = rng.uniform(0.0, 1.0) * np.sin(
        np.linspace(0.0, rng.uniform(3.0, 30.0), scans) + rng.uniform(0.0, 6.0)
    )
    still = rng.uniform(-0.8, 0.8) * ones
    here = np.tile(rng.uniform(0.2, 0.8, 2) * size, (scans, 1))

    def one(
        at: FloatArray, angle: FloatArray = turn, grown: FloatArray = ones, down: FloatArray = ones
    ) -> _Object:
        return _Object(_outline(rng, wide, tall), at, angle, grown, down)

    if use == "nothing":
        return []
    if "exercise" in use:
        wide, tall = (
            rng.uniform(4.5, max(5.0, min(9.0, 0.6 * sensor.strips))) * pitch,
            rng.uniform(0.15, 0.35) * size[1],
        )
        ways = []
        for i, level in enumerate(rng.permutation(np.linspace(0.1, 0.9, int(rng.integers(2, 6))))):
            ends = (-0.1, 1.1) if i % 2 else (1.1, -0.1)
            ways += [(e, level + rng.uniform(-0.1, 0.1)) for e in ends]
        for i, column in enumerate(rng.permutation(np.linspace(0.1, 0.9, int(rng.integers(2, 8))))):
            ends = (-0.15, 1.15) if i % 2 else (1.15, -0.15)
            ways += [(column + rng.uniform(-0.08, 0.08), e) for e in ends]
        return [one(_along(np.array(ways) * size, scans))]
    if use in ("drag", "scribble", "ball"):
        stops = rng.uniform(-0.05, 1.05, (int(rng.integers(2, 5 if use == "drag" else 25)), 2)) * size
        if use == "ball":
            wide = tall = rng.uniform(1.5, 4.0) * pitch
        return [one(_along(stops, scans))]
    if use in ("presses", "slow presses", "taps", "fast taps", "few scans", "same two places"):
        each = {"slow presses": 60, "taps": 12, "fast taps": 4, "few scans": int(rng.integers(1, 4))}.get(
            use, 30
        )
        number = np.minimum(np.arange(scans) // each, 10**6)
        part = (np.arange(scans) % each + 0.5) / each
        count = int(number[-1]) + 1
        places = rng.uniform((0.0, 0.03), (1.0, 0.97), (count, 2))
        if use == "same two places":
            places = rng.uniform(0.15, 0.85, (2, 2))[np.arange(count) % 2] + rng.normal(
                0.0, 0.003, (count, 2)
            )
        grown = ones
        if use == "slow presses":  # a soft contact grows with the force, from its middle
            grown = (
                np.sqrt(np.clip(np.minimum(part, 0.85 - part) / 0.3, 0.0, 1.0))
                * rng.uniform(0.8, 1.1, count)[number]
            )
        down = (part < 0.75).astype(float) if each > 3 else ones
        return [one((places * size)[number], rng.uniform(-1.0, 1.0, count)[number], grown, down)]
    if use in ("one press", "held", "palm"):
        if use == "palm":
            wide, tall = rng.uniform(0.9, 1.4) * size[0], rng.uniform(0.3, 0.8) * size[1]
        start = rng.uniform(0.0, 0.3) if rng.random() < 0.6 else -1.0
        share = np.linspace(0.0, 1.0, scans)
        sway = 0.01 * tall * rng.normal(size=2) * np.sin(share * rng.uniform(1.0, 20.0))[:, None]
        return [
            one(here + sway, still, down=((share > start) & (share < rng.uniform(0.8, 1.5))).astype(float))
        ]
    if use in ("roll", "rolls and lifts"):
        wide, tall = rng.uniform(0.5, 1.4) * size[0], rng.uniform(0.02, 0.08) * size[1]
        turns = np.resize([rng.uniform(-0.05, 0.1), rng.uniform(0.9, 1.05)], int(rng.integers(2, 7)))
        at = _along(np.stack([np.full(len(turns), rng.uniform(0.4, 0.6)), turns], axis=1) * size, scans)
        part = np.arange(scans) * (len(turns) - 1) / scans % 1.0
        lifted = (part > 0.85) & (use == "rolls and lifts")
        return [one(at, rng.uniform(-0.25, 0.25) * ones, down=(~lifted).astype(float))]
    if use == "two objects":
        other = np.tile(rng.uniform(0.1, 0.9, 2) * size, (scans, 1))
        other += (
            0.05
            * size
            * np.sin(np.linspace(0.0, rng.uniform(3.0, 20.0), scans))[:, None]
            * rng.normal(size=2)
        )
        first = one(here, still)
        wide, tall = 0.6 * wide, 0.5 * tall
        return [first, one(other, still)]
    if use == "three fingers":
        wide, tall = rng.uniform(2.0, 4.0) * pitch, rng.uniform(0.05, 0.15) * size[1]
        way = _along(rng.uniform(0.2, 0.8, (int(rng.integers(2, 9)), 2)) * size, scans)
        return [one(way + rng.normal(0.0, 0.25, 2) * size, still) for _ in range(3)]
    if use in ("sway at an edge", "ground end", "far end"):
        end = {"ground end": 0.0, "far end": 1.0}.get(use, float(rng.integers(2)))
        x = float(rng.integers(2)) if use == "sway at an edge" else rng.uniform(0.1, 0.9)
        sway = rng.uniform(0.02, 0.2, 2) * np.sin(np.linspace(0.0, rng.uniform(3.0, 25.0), scans))[:, None]
        return [one((np.array([x, end]) + sway) * size)]
    wide = rng.uniform(1.2, 2.4) * pitch  # narrow slides
    lanes = np.repeat(rng.uniform(0.05, 0.95, int(rng.integers(2, 9))), 2)
    turned = np.resize([0.05, 0.95, 0.95, 0.05], len(lanes))
    return [one(_along(np.stack([lanes, turned], axis=1) * size, scans), still)]


def _ends(thing: _Object, sensor: Sensor) -> tuple[FloatArray, FloatArray]:
    """Return l and u over L (scans, strips) of an object on the sensor's lines, beyond the ends too."""
    c, s = np.cos(thing.angle)[:, None], np.sin(thing.angle)[:, None]
    scaled = thing.outline[None] * np.maximum(thing.size, 1e-6)[:, None, None]
    px = c * scaled[..., 0] - s * scaled[..., 1] + thing.at[:, :1]
    py = s * scaled[..., 0] + c * scaled[..., 1] + thing.at[:, 1:]
    x = (np.arange(sensor.strips) + 0.5) * sensor.pitch_mm
    low, up = np.full((len(px), len(x)), np.inf), np.full((len(px), len(x)), -np.inf)
    corners = px.shape[1]
    for i in range(corners):
        x0, x1, y0, y1 = (v[:, [j % corners]] for v in (px, py) for j in (i, i + 1))
        with np.errstate(divide="ignore", invalid="ignore"):
            y = y0 + (y1 - y0) * (x - x0) / (x1 - x0)
        crossed = (np.minimum(x0, x1) <= x) & (x <= np.maximum(x0, x1)) & np.isfinite(y)
        low, up = np.where(crossed, np.minimum(low, y), low), np.where(crossed, np.maximum(up, y), up)
    on = (low < up) & (thing.down[:, None] > 0.5) & (thing.size[:, None] > 0.05)
    return tuple(np.where(on, v / sensor.length_mm, np.nan) for v in (low, up))  # type: ignore[return-value]


def _soft(
    rng: np.random.Generator, low: FloatArray, up: FloatArray, time_s: FloatArray, rim: float, *, creeps: bool
) -> tuple[FloatArray, FloatArray]:
    """Let ends err, alike on neighbours and for a while, and grow while held; cut them at the frame."""
    scans, strips = low.shape
    size = float(rng.choice([0.0, 0.001, 0.003, 0.006]))
    there = np.asarray(np.isfinite(low).any(axis=1))
    fresh = there & ~np.concatenate([[False], there[:-1]])
    press, thin = np.cumsum(fresh), 0.3 * (up - low)
    for sign, values in ((-1.0, low), (1.0, up)):
        own = 0.9 * rng.normal(size=(press[-1] + 1, strips))[press] + 0.4 * _passing(
            rng, scans, strips, _EDGE_KEEPS
        )
        beside = (np.roll(own, 1, axis=1) + np.roll(own, -1, axis=1)) * 0.25
        # Where a contact hardly reaches, its two ends do not err past each other.
        values += np.clip(size * (0.9 * own + beside), -thin, thin)
        if creeps:
            grown = rng.uniform(0.0, 0.02) * np.log1p((time_s - time_s[0]) / 3.0)[:, None]
            values += sign * grown * np.nanmean(up - low if np.isfinite(low).any() else np.zeros(1))
    low, up = np.clip(low, rim, 1.0), np.clip(up, 0.0, 1.0 - rim)
    with np.errstate(invalid="ignore"):
        off = ~(up - low > 0.002)
    return np.where(off, np.nan, low), np.where(off, np.nan, up)


def _readings(
    rng: np.random.Generator, unit: _Unit, low: FloatArray, up: FloatArray
) -> dict[str, FloatArray]:
    """Return what amplifiers get over the Vref of the spec, the rest level where nothing touches."""
    sensor, strips = unit.sensor, unit.sensor.strips
    y = np.linspace(0.0, 1.0, unit.below.shape[1])
    s_low, s_up = (
        np.stack([np.interp(v[:, i], y, unit.below[i]) for i in range(strips)], axis=1) for v in (low, up)
    )
    lam = sensor.contact_lambda_mm / sensor.length_mm
    if lam:
        cut = lam * np.tanh((s_up - s_low) / (2.0 * lam))
        s_low, s_up = s_low + cut, s_up - cut
    ratio = sensor.resistivity_ratio if sensor.construction == "crs-crs" else 0.0
    ground, top = unit.clamps.T
    width = s_up - s_low
    whole = ground + unit.below[:, -1] + top - width / (1.0 + ratio)
    k = {"kl": (ground + s_low) / whole, "kh": (ground + s_low + width * ratio / (1.0 + ratio)) / whole}
    k = k if ratio else {"k": k["kl"]}
    rest = (sensor.rest_volt or 0.0) / sensor.vref_volt
    for name, values in k.items():
        values = np.where(np.isfinite(values), values * unit.supply, rest)
        gain, offset = (
            1.0 + rng.uniform(-unit.gain, unit.gain, strips),
            rng.uniform(-unit.offset, unit.offset, strips),
        )
        k[name] = values * gain + offset
    return k


def _disturb(rng: np.random.Generator, k: dict[str, FloatArray], time_s: FloatArray, unit: _Unit) -> None:
    """Add noise, a zero that wanders, hum and temperature that all strips share, and strays."""
    scans, strips = next(iter(k.values())).shape
    white = float(np.exp(rng.uniform(np.log(0.0005), np.log(0.01)))) * np.exp(rng.normal(0.0, 0.2, strips))
    wander = float(rng.uniform(0.0, 0.35)) * np.minimum(white, 0.004) * np.exp(rng.normal(0.0, 0.2, strips))
    common = float(rng.uniform(0.0, 0.5) * min(np.median(white), 0.004))
    hum, hertz = float(rng.uniform(0.0, 0.001)), float(rng.choice([50.0, 60.0]))
    course = (time_s - time_s[0]) / max(float(np.ptp(time_s)), 1e-9)
    course = course ** rng.uniform(0.5, 1.5)
    shift, scale = rng.uniform(-0.012, 0.012, 2) * (rng.random(2) < 0.35)
    for name in k:
        values = k[name] * (1.0 + scale * course[:, None]) + shift * course[:, None]
        values += white * rng.normal(size=(scans, strips)) + wander * _flicker(rng, time_s, strips)
        values += common * _flicker(rng, time_s, 1)
        values += hum * np.sin(2.0 * np.pi * hertz * (time_s[:, None] + 2e-4 * np.arange(strips)))
        stray = rng.random((scans, strips)) < 3e-4
        values[stray] += rng.uniform(0.02, 0.2, int(stray.sum())) * rng.choice([-1.0, 1.0], int(stray.sum()))
        k[name] = values


def _flicker(rng: np.random.Generator, time_s: FloatArray, channels: int) -> FloatArray:
    """Return processes (scans, channels) of standard deviation 1, flat in their Allan deviation."""
    period = max(float(np.median(np.diff(time_s))), 1e-9)
    parts = [_passing(rng, len(time_s), channels, float(np.exp(-period / tau))) for tau in _TAU_S]
    return np.asarray(np.sum(parts, axis=0) / np.sqrt(len(_TAU_S)))


def _passing(rng: np.random.Generator, scans: int, channels: int, keep: float) -> FloatArray:
    """Return first-order processes (scans, channels) of standard deviation 1."""
    new = np.sqrt(1.0 - keep**2) * rng.normal(size=(scans, channels))
    new[0] = rng.normal(size=channels)
    return first_order(new, keep)


def main(units: int, first: int) -> None:
    """Examine units and print what was said of them."""
    start, said = time.process_time(), Counter[str]()
    for seed in range(first, first + units):
        log, use = recording(seed)
        report = diagnose(log)
        said["alarms"] += bool(report.findings)
        said["asked"] += bool(report.questions and not report.findings)
        about = f"{seed} {use}, {log.sensor.construction} of {log.sensor.strips}"
        entries = [(f.fault, f.strips, f.evidence) for f in report.findings]
        entries += [("? " + ", ".join(q.causes), q.strips, q.evidence) for q in report.questions]
        for names, strips, evidence in entries:
            sys.stdout.write(f"{about}: {names} {strips}: {evidence}\n")
    took = time.process_time() - start
    sys.stdout.write(
        f"{units} sound units: {said['alarms']} alarms, {said['asked']} asked, {took:.0f} s of CPU\n"
    )


if __name__ == "__main__":
    main(*(int(a) for a in (*sys.argv[1:], *("240", "0")[len(sys.argv) - 1 :])))
