"""Sound units touched by what `sound_units` has not: concave and thin things, parts of a strip, every protocol.

Bars, rings, angles, combs, rolling fingers, two objects, palms over a corner; held, slid, tapped, still for long,
rolled, in recordings of 20 scans to 6,000; 4 to 100 strips of every construction, 8 to 14 bits, noise that is normal,
uniform, heavy-tailed, slow or of the contact, mains at any scan rate, drift of all, rubber that is uneven by up to 5 %,
switches of 70 ohm. A strip has a width here: it is touched where any of it is. `python -m studies.sound_scenes [units]
[first]` prints what the doctor says; each finding is a false alarm.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from dataclasses import replace

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.contact.shape import Contact
from tacstrip.diagnose.doctor import diagnose
from tacstrip.diagnose.log import Log
from tacstrip.sensor.spec import Sensor
from tacstrip.simulation import simulate

PROTOCOLS = ("held", "held for long", "slide", "to and fro", "taps", "steps", "roll", "rock", "grow", "circles",
             "exercise", "few")  # fmt: skip
THINGS = ("bar", "ring", "angle", "comb", "finger", "block", "wedge", "two", "corner", "disc", "cross")
_ACROSS = (-0.4, 0.0, 0.4)  # of a pitch: lines of a strip's width
_ROUND = np.linspace(0.0, 2.0 * np.pi, 25)[:-1]
_HAND_HZ = 5.0  # no hand moves faster
_MOST_READINGS, _SHEET_SCANS = 120_000, 90

Outlines = list[FloatArray]  # each (corners, 2), on the unit square about 0


def _outlines(rng: np.random.Generator, thing: str) -> Outlines:
    """Return what touches, of size 1 about 0."""
    circle = 0.5 * np.stack([np.cos(_ROUND), np.sin(_ROUND)], axis=1)
    thick = rng.uniform(0.12, 0.4)
    square = np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])
    match thing:
        case "ring":
            open_at = int(rng.integers(0, 24))
            arc = np.roll(circle, open_at, axis=0)[: int(rng.integers(14, 24))]
            return [np.concatenate([arc, (1.0 - thick) * arc[::-1]])]
        case "angle":
            return [
                square * (1.0, thick) + (0.0, thick / 2 - 0.5),
                square * (thick, 1.0) + (thick / 2 - 0.5, 0.0),
            ]
        case "comb":
            teeth = int(rng.integers(2, 5))
            places = np.linspace(-0.5 + thick / 4, 0.5 - thick / 4, teeth)
            return [square * (1.0, 0.2) - (0.0, 0.4), *(square * (thick / 2, 1.0) + (x, 0.0) for x in places)]
        case "cross":
            return [square * (1.0, thick), square * (thick, 1.0)]
        case "wedge":
            return [
                np.array(
                    [(-0.5, -0.5), (0.5, rng.uniform(-0.5, 0.2)), (0.5, 0.5), (-0.5, rng.uniform(-0.4, 0.5))]
                )
            ]
        case "two":
            return [
                circle * rng.uniform(0.3, 0.6) - rng.uniform(0.1, 0.3, 2),
                square * rng.uniform(0.2, 0.5, 2) + 0.25,
            ]
        case "finger" | "disc":
            return [circle]
        case _:
            return [square]


def _size(rng: np.random.Generator, thing: str, sensor: Sensor) -> FloatArray:
    """Return width and height [mm]."""
    wide, tall = sensor.width_mm, sensor.length_mm
    match thing:
        case "bar":
            size = np.array([rng.uniform(0.3, 1.5) * wide, rng.uniform(0.01, 0.06) * tall])
            return (
                size
                if rng.random() < 0.7
                else np.array([rng.uniform(0.8, 2.5) * sensor.pitch_mm, 0.7 * tall])
            )
        case "finger":
            return rng.uniform(1.5, 4.0) * sensor.pitch_mm * np.array([1.0, rng.uniform(0.8, 1.8)])
        case "corner":
            return rng.uniform(0.5, 1.3, 2) * (wide, tall)
        case "disc":
            return np.full(2, rng.uniform(0.2, 0.6) * min(wide, tall))
        case _:
            return np.array([rng.uniform(0.15, 0.9) * wide, rng.uniform(0.08, 0.5) * tall])


def _way(
    rng: np.random.Generator, protocol: str, thing: str, sensor: Sensor, scans: int, seconds: float
) -> tuple[FloatArray, ...]:
    """Return centre (scans, 2) [mm], angle, scale and whether it is down (scans,)."""
    span = np.array([sensor.width_mm, sensor.length_mm])
    ones, share = np.ones(scans), np.linspace(0.0, 1.0, scans)
    here = rng.uniform(0.15, 0.85, 2)
    if thing == "corner":
        here = rng.integers(0, 2, 2) + rng.uniform(-0.2, 0.2, 2)
    at, angle = np.tile(here, (scans, 1)), rng.uniform(-1.6, 1.6) * ones
    scale, down = ones, ones
    many = int(np.clip(rng.integers(2, 30), 1.0, 1.0 + _HAND_HZ * seconds))
    match protocol:
        case "held" | "held for long" | "few" if protocol != "few" or rng.random() < 0.5:
            at = at + rng.choice([0.0, 1e-4, 2e-3]) * np.cumsum(
                rng.normal(size=(scans, 2)), axis=0
            ) / np.sqrt(scans)
            down = ((share > rng.choice([-1.0, 0.1, 0.3])) & (share < rng.choice([2.0, 0.8]))).astype(float)
            scale = 1.0 + rng.choice([0.0, 0.01, 0.04]) * np.log1p(20.0 * share) / np.log(21.0)
        case "slide" | "few":
            at = here + share[:, None] * (rng.uniform(-0.1, 1.1, 2) - here)
            angle = angle + share * rng.choice([0.0, 0.0, 1.0])
        case "to and fro":
            swing = np.sin(np.pi * many * share)[:, None] * rng.uniform(-0.7, 0.7, 2)
            at = at + swing
        case "taps" | "steps":
            number = np.minimum((share * many).astype(int), many - 1)
            at = rng.uniform(-0.02, 1.02, (many, 2))[number]
            angle = rng.uniform(-1.6, 1.6, many)[number]
            down = (
                ((share * many) % 1.0 < rng.uniform(0.3, 0.9)).astype(float) if protocol == "taps" else ones
            )
        case "roll":
            at = np.stack(
                [here[0] * ones, np.interp(share * many % 2.0, (0.0, 1.0, 2.0), (0.0, 1.0, 0.0))], axis=1
            )
            angle = rng.normal(0.0, 0.1) * ones
        case "rock":  # a finger rolls about its own axis: its place and its size change together
            turn = np.sin(np.pi * many * share)
            at = at + turn[:, None] * rng.uniform(-0.08, 0.08, 2)
            scale = 1.0 - rng.uniform(0.1, 0.5) * turn**2
        case "grow":
            each = (share * many) % 1.0
            scale = np.sqrt(np.clip(np.minimum(each, 1.0 - each) * rng.uniform(2.0, 8.0), 0.0, 1.0))
            at = rng.uniform(0.1, 0.9, (many, 2))[np.minimum((share * many).astype(int), many - 1)]
        case "circles":
            phase = 2.0 * np.pi * min(rng.uniform(1.0, 12.0), _HAND_HZ * seconds) * share
            at = at + np.stack([np.cos(phase), np.sin(phase)], axis=1) * rng.uniform(0.02, 0.5, 2)
            angle = angle + rng.choice([0.0, 0.3]) * np.sin(0.7 * phase)
        case "exercise":
            lanes = rng.permutation(np.linspace(0.1, 0.9, int(rng.integers(3, 9))))
            stops = [(-0.2, lanes[0])]
            for i, lane in enumerate(lanes):
                stops += [(1.2 if i % 2 else -0.2, lane), (-0.2 if i % 2 else 1.2, lane)]
                stops += [(lane, 1.15 if i % 2 else -0.15), (lane, -0.15 if i % 2 else 1.15)]
            at = np.stack([np.interp(share * (len(stops) - 1), range(len(stops)), axis)
                           for axis in np.array(stops).T], axis=1)  # fmt: skip
            angle = angle + 0.5 * np.sin(np.pi * many * share)
    return at * span, angle, scale, down


def _placed(outline: FloatArray, size: FloatArray, way: tuple[FloatArray, ...]) -> FloatArray:
    """Return an outline's corners wherever it is (scans, corners, 2) [mm]."""
    at, angle, scale, _ = way
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    x, y = np.moveaxis((outline * size)[None] * scale[:, None, None], 2, 0)
    return np.stack([c * x - s * y, s * x + c * y], axis=2) + at[:, None]


def _ends(corners: FloatArray, sensor: Sensor) -> tuple[FloatArray, FloatArray]:
    """Return the lowest and the highest touched place of each strip over L (scans, strips), beyond the ends too."""
    lines = (np.arange(sensor.strips)[:, None] + 0.5 + np.array(_ACROSS)).ravel() * sensor.pitch_mm
    low, up = np.full((len(corners), len(lines)), np.inf), np.full((len(corners), len(lines)), -np.inf)
    for one, two in zip(
        np.moveaxis(corners, 1, 0), np.moveaxis(np.roll(corners, -1, axis=1), 1, 0), strict=True
    ):
        x0, y0, x1, y1 = one[:, :1], one[:, 1:], two[:, :1], two[:, 1:]
        with np.errstate(divide="ignore", invalid="ignore"):
            y = y0 + (y1 - y0) * (lines - x0) / (x1 - x0)
        on = (np.minimum(x0, x1) <= lines) & (lines <= np.maximum(x0, x1)) & np.isfinite(y)
        low, up = np.where(on, np.minimum(low, y), low), np.where(on, np.maximum(up, y), up)
    low, up = (v.reshape(len(corners), sensor.strips, len(_ACROSS)) / sensor.length_mm for v in (low, up))
    return low.min(axis=2), up.max(axis=2)


def recording(seed: int) -> tuple[Log, str]:
    """Draw a sound unit and what is done with it; return what it reads."""
    rng = np.random.default_rng([seed, 4711])
    protocol, thing = str(rng.choice(PROTOCOLS)), str(rng.choice(THINGS))
    sensor = _sensor(rng)
    rate = float(rng.choice([4.0, 9.7, 15.0, 25.0, 33.3, 48.0, 75.0, 100.0, 210.0, 450.0, 1000.0]))
    scans = {"few": int(rng.integers(20, 51)), "held for long": int(rng.integers(2000, 6001))}.get(
        protocol, int(rng.integers(60, 1500))
    )
    scans = min(scans, _MOST_READINGS // sensor.strips)
    scans = min(scans, _SHEET_SCANS) if sensor.construction == "crs-crp" else scans
    size, way = _size(rng, thing, sensor), _way(rng, protocol, thing, sensor, scans, scans / rate)
    corners = [_placed(outline, size, way) for outline in _outlines(rng, thing)]
    down = way[3] > 0.5
    time_s = np.arange(scans) / rate
    low, up = np.full((scans, sensor.strips), np.inf), np.full((scans, sensor.strips), -np.inf)
    for one in corners:
        own = _ends(one, sensor)
        low, up = np.minimum(low, own[0]), np.maximum(up, own[1])
    low, up = np.clip(low, 0.0, 1.0), np.clip(up, 0.0, 1.0)
    on = (up - low > rng.choice([0.001, 0.005, 0.02])) & down[:, None]
    if not on.any():
        return recording(seed + 1_000_000)
    low, up = np.where(on, low, np.nan), np.where(on, up, np.nan)
    k = _sheet(sensor, low, up) if sensor.construction == "crs-crp" else _strips(rng, sensor, low, up)
    _disturb(rng, k, time_s, on, rate, (sensor.rest_volt or 0.0) / sensor.vref_volt)
    steps = 2.0 ** (sensor.adc_bits or 12) - 1.0
    for name, values in k.items():
        digital = np.round(np.clip(values, 0.0, 1.0) * steps) / steps
        k[name] = digital if sensor.rest_volt is not None else np.where(on, digital, np.nan)
    about = f"{protocol}, {thing}, {sensor.construction} of {sensor.strips}, {sensor.adc_bits} bits"
    return Log.of(sensor, time_s, k), about


def _sensor(rng: np.random.Generator) -> Sensor:
    kind = str(rng.choice(["crs-crs", "crs-m", "cyl-crs-m", "crs-crp"], p=[0.5, 0.28, 0.12, 0.1]))
    strips = int(
        rng.choice([4, 6, 8, 10, 12] if kind == "crs-crp" else [4, 5, 7, 9, 12, 16, 20, 24, 30, 48, 64, 100])
    )
    pitch = float(rng.uniform(1.5, 9.0))
    rest = float(rng.choice([0.0, 0.08, 0.2, 0.4])) if rng.random() < 0.45 and kind != "crs-crp" else None
    length = float(rng.uniform(0.5, 3.0) * min(max(strips, 8), 30) * pitch)
    return Sensor(
        construction=kind, strips=strips, pitch_mm=pitch, length_mm=length,
        radius_mm=strips * pitch / 6.0 if "cyl" in kind else None,
        resistivity_ratio=float(rng.choice([0.5, 1.0, 2.0])) if kind in ("crs-crs", "crs-crp") else 1.0,
        contact_lambda_mm=float(rng.choice([0.0, 0.002, 0.008])) * length + 0.1 * (kind == "crs-crp"),
        adc_bits=int(rng.choice([8, 10, 12, 14], p=[0.15, 0.3, 0.4, 0.15])), rest_volt=rest,
        touch_volt=None if rest is None else float(rng.uniform(0.1, 0.3)),
    )  # fmt: skip


def _strips(
    rng: np.random.Generator, sensor: Sensor, low: FloatArray, up: FloatArray
) -> dict[str, FloatArray]:
    """Return readings over Vref, the rest level where nothing touches, by the circuit of each strip's own rubber."""
    strips = sensor.strips
    y = np.linspace(0.0, 1.0, 61)
    uneven = float(rng.choice([0.0, 0.01, 0.05]))
    waves = sum(rng.normal(size=(strips, 1)) * np.sin(np.pi * n * y + rng.uniform(0.0, 6.3, (strips, 1))) / n
                for n in (1, 2, 3, 5))  # fmt: skip
    density = np.exp(uneven * (waves + 0.7 * rng.normal(size=(strips, 1))))
    below = np.concatenate(
        [np.zeros((strips, 1)), np.cumsum((density[:, 1:] + density[:, :-1]) / 120.0, axis=1)], axis=1
    )
    bottom, top = (
        np.stack([np.interp(v[:, i], y, below[i]) for i in range(strips)], axis=1) for v in (low, up)
    )
    lam = sensor.contact_lambda_mm / sensor.length_mm
    if lam:
        cut = lam * np.tanh((top - bottom) / (2.0 * lam))
        bottom, top = bottom + cut, top - cut
    switch = 70.0 / float(np.exp(rng.uniform(np.log(2e3), np.log(4e4)))) * bool(rng.random() < 0.7)
    ratio = sensor.resistivity_ratio if sensor.construction == "crs-crs" else 0.0
    joints = rng.uniform(0.0, 0.004, (2, strips))
    first, last = switch + joints
    whole = first + below[:, -1] + last - (top - bottom) / (1.0 + ratio)
    k = {
        "kl": (first + bottom) / whole,
        "kh": (first + bottom + (top - bottom) * ratio / (1.0 + ratio)) / whole,
    }
    rest = (sensor.rest_volt or 0.0) / sensor.vref_volt
    offset, gain = float(rng.choice([0.0, 0.002, 0.01, 0.03])), float(rng.choice([0.0, 0.003, 0.01]))
    if sensor.touch_volt is not None:  # which its user has set by what untouched strips read
        offset = min(offset, 0.4 * sensor.touch_volt / sensor.vref_volt)
    out = {}
    for name, values in (k if ratio else {"k": k["kl"]}).items():
        values = np.where(np.isfinite(values), values, rest)
        out[name] = values * (1.0 + gain * rng.uniform(-1.0, 1.0, strips)) + offset * rng.uniform(
            -1.0, 1.0, strips
        )
    return out


def _sheet(sensor: Sensor, low: FloatArray, up: FloatArray) -> dict[str, FloatArray]:
    """Return a sheet's readings over Vref of a bar on each strip between the ends, 0 where nothing touches."""
    out = {name: np.zeros(low.shape) for name in sensor.signatures}
    ideal = replace(sensor, adc_bits=None)
    for scan in np.flatnonzero(np.isfinite(low).any(axis=1)).tolist():
        bars = [
            _bar(sensor, i, low[scan, i], up[scan, i])
            for i in np.flatnonzero(np.isfinite(low[scan])).tolist()
        ]
        read = simulate(ideal, sum(bars[1:], start=bars[0]))
        for name in out:
            out[name][scan] = np.nan_to_num(read[name])
    return out


def _bar(sensor: Sensor, strip: int, low: float, up: float) -> Contact:
    left, right = ((strip + side) * sensor.pitch_mm for side in (0.1, 0.9))
    bottom, top = low * sensor.length_mm, up * sensor.length_mm
    return Contact.polygon([(left, bottom), (right, bottom), (right, top), (left, top)])


def _disturb(
    rng: np.random.Generator,
    k: dict[str, FloatArray],
    time_s: FloatArray,
    on: FloatArray,
    rate: float,
    rest: float,
) -> None:
    """Add a noise of some kind, mains, and what all channels do together."""
    scans, strips = on.shape
    kind = str(rng.choice(["normal", "uniform", "heavy", "slow", "contact"]))
    size = float(np.exp(rng.uniform(np.log(3e-4), np.log(6e-3)))) * np.exp(rng.normal(0.0, 0.15, strips))
    mains, hertz = float(rng.choice([0.0, 2e-4, 5e-4])), float(rng.choice([50.0, 60.0]))
    at = time_s[:, None] + rng.uniform(0.1, 0.8) / (rate * strips) * np.arange(strips)
    course = np.linspace(0.0, 1.0, scans)[:, None] ** rng.uniform(0.5, 2.0)
    shift, stretch = (
        rng.choice([0.0, 0.004, 0.012]) * rng.uniform(-1.0, 1.0),
        rng.choice([0.0, 0.01]) * rng.normal(),
    )
    for name, values in k.items():
        normal = rng.normal(size=(scans, strips))
        match kind:
            case "uniform":
                noise = rng.uniform(-1.73, 1.73, (scans, strips))
            case "heavy":
                noise = rng.standard_t(3.0, (scans, strips)) / 1.73
            case "slow":
                walk = np.cumsum(rng.normal(size=(scans, strips)), axis=0) / np.sqrt(scans)
                noise = 0.9 * normal + 0.4 * (walk - walk.mean(axis=0))
            case "contact":  # of a current through grains: less where nothing touches and near the rails
                noise = normal * np.where(on, 0.3 + 4.0 * values * (1.0 - values), 0.3)
            case _:
                noise = normal
        values = values + size * noise + mains * np.sin(2.0 * np.pi * hertz * at + 0.3)
        k[name] = values + shift * course + stretch * course * (values - rest)


def main(units: int, first: int) -> None:
    """Examine units and print what was said of them."""
    start, said = time.process_time(), Counter[str]()
    for seed in range(first, first + units):
        log, about = recording(seed)
        report = diagnose(log)
        said["alarms"] += bool(report.findings)
        said["asked"] += bool(report.questions and not report.findings)
        entries = [(f.fault, f.strips, f.evidence) for f in report.findings]
        entries += [("? " + ", ".join(q.causes), q.strips, q.evidence) for q in report.questions]
        for names, strips, evidence in entries:
            sys.stdout.write(f"{seed} {about}: {names} {strips}: {evidence}\n")
            sys.stdout.flush()
    took = time.process_time() - start
    sys.stdout.write(
        f"{units} sound units: {said['alarms']} alarms, {said['asked']} asked, {took:.0f} s of CPU\n"
    )


if __name__ == "__main__":
    main(*(int(a) for a in (*sys.argv[1:], *("300", "0")[len(sys.argv) - 1 :])))
