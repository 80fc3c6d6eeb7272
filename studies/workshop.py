"""Units as makers build them and recordings as they make them, apart from the package's models, to tune the doctor on.

Readings are the closed form of strips with clamps, cold joints and a resistivity that varies; shorts between strips of
rubber are a ladder of resistors. Contacts are fingers with soft edges, bars and blocks that are pressed slowly or fast,
dragged or tapped; readings carry 1/f wander that strips share, strays, offsets, gains and the converter's rounding.
Faults are of wires, strips, clamps and inputs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.diagnose.log import Log
from tacstrip.sensor.spec import Sensor

FAULTS = (
    "dead", "stuck", "open-low", "open-high", "open-inside", "short", "short-edge", "swapped-wires", "swapped-ends",
    "swapped-strips", "saturation", "drift", "wander", "intermittent", "hum", "noise", "pressure",
)  # fmt: skip
RECORDINGS = ("one press", "presses", "slow presses", "drag", "exercise", "fast", "few", "some strips")
_NODES = 41  # of a strip in the network


@dataclass(frozen=True)
class Bench:
    """A unit, what was recorded of it and what is wrong with it."""

    seed: int
    fault: str
    strips: tuple[int, ...]
    recording: str
    size: float
    log: Log
    about: str
    shown: int = 0  # scans in which the fault changes a reading by much


def bench(seed: int, fault: str = "", recording: str = "", strips: int | None = None) -> Bench:
    """Draw a unit with a fault, "" for none, and a recording of it."""
    rng = np.random.default_rng([seed, 14])
    sensor = _sensor(rng, strips, fault)
    recording = recording or str(rng.choice(RECORDINGS))
    rate = float(rng.choice([7.0, 23.0, 47.0, 110.0, 220.0, 430.0, 1000.0]))
    if fault == "hum":
        rate = float(rng.choice([110.0, 220.0, 430.0, 1000.0]))
    if recording != "one press":
        rate = min(rate, 220.0)  # nobody taps more often
    n = sensor.strips
    # An edge pair of metal has neighbours on one side only.
    at = int(rng.choice([0, n - 2])) if fault == "short-edge" else int(rng.integers(0, n - 1))
    low, up, force = _contacts(rng, sensor, recording, at, rate)
    scans = len(low)
    low, up, _ = _soft(rng, sensor, low, up, force)
    k = _readings(rng, sensor, low, up)
    where: tuple[int, ...] = (at,)
    size, about = 0.0, ""
    clean = {name: values.copy() for name, values in k.items()}
    if fault:
        size, where, about = _fail(rng, sensor, k, low, up, force, fault, at)
    shown = _differing(k, clean, where, fault)
    touched = np.isfinite(low)
    rest = np.nan if sensor.rest_volt is None else sensor.rest_volt / sensor.vref_volt
    for name in k:
        k[name] = np.where(touched, k[name], rest)
    noise = _noise(rng, k, rate, scans, n)
    clean = {name: values.copy() for name, values in k.items()}
    if fault:
        size, about = _ail(rng, sensor, k, rate, fault, at, size, about, noise)
    shown += _differing(k, clean, where, fault)
    steps = 2.0 ** (sensor.adc_bits or 12) - 1.0
    clip = bool(rng.random() < 0.97)
    for name in k:
        values = np.round(k[name] * steps) / steps
        k[name] = np.clip(values, 0.0, 1.0) if clip else values
    time_s = np.arange(scans) / rate
    if recording == "few" and rng.random() < 0.5:
        time_s = np.zeros(scans)
    return Bench(
        seed, fault, where, recording, size, Log.of(sensor, time_s, k), f"{about} noise {noise:.4f}", shown
    )


def _differing(a: dict[str, FloatArray], b: dict[str, FloatArray], strips: Sequence[int], fault: str) -> int:
    """Return in how many scans a fault changed a reading of its strips."""
    least = (
        0.01 if fault.startswith("short") else 0.004 if fault in ("drift", "wander", "hum", "noise") else 0.08
    )
    at = list(strips)
    off = np.any(
        [(np.abs(a[n] - b[n])[:, at] > least) | (np.isnan(a[n]) != np.isnan(b[n]))[:, at] for n in a], axis=0
    )
    return int(off.any(axis=1).sum())


def _sensor(rng: np.random.Generator, strips: int | None, fault: str) -> Sensor:
    two = fault in ("swapped-wires", "dead", "stuck") and rng.random() < 0.8
    kinds = (
        ["crs-m"]
        if fault == "short-edge"
        else ["crs-crs"]
        if two
        else ["crs-crs", "crs-crs", "crs-m", "cyl-crs-m"]
    )
    if fault == "swapped-wires":
        kinds = ["crs-crs"]
    kind = str(rng.choice(kinds))
    n = strips or int(rng.choice([10, 10, 12, 16, 20, 24, 32, 50]))
    pitch = float(rng.choice([2.0, 3.25, 5.0, 6.5, 10.0]))
    length = float(rng.uniform(0.7, 4.0) * n * pitch) if n < 30 else float(rng.uniform(0.7, 1.5) * n * pitch)
    rest = float(rng.choice([0.0, 0.0, 0.25, 0.5])) if rng.random() < 0.5 else None
    return Sensor(
        construction=kind, strips=n, pitch_mm=pitch, length_mm=length,
        radius_mm=n * pitch / 5.0 if "cyl" in kind else None,
        resistivity_ratio=float(rng.choice([0.3, 1.0, 1.0, 3.0])) if kind == "crs-crs" else 1.0,
        contact_lambda_mm=float(rng.choice([0.0, 0.0, 0.01])) * length,
        adc_bits=int(rng.choice([10, 10, 12, 14])), rest_volt=rest, touch_volt=None if rest is None else 0.15,
    )  # fmt: skip


def _contacts(
    rng: np.random.Generator, sensor: Sensor, recording: str, at: int, rate: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return l and u [over L] and a force (scans, strips), NaN where untouched."""
    n = sensor.strips
    kind = str(rng.choice(["finger", "finger", "block", "bar", "triangle"]))
    wide = float(rng.uniform(3.0, 7.0) if kind == "finger" else rng.uniform(4.0, max(5.0, 0.7 * n)))
    tall = float(rng.uniform(0.12, 0.45))
    spots: list[tuple[float, float, float, float, float]] = []  # x [strips], y [L], angle, force, scale

    def press(x: float, y: float, scans: int, angle: float, onset: float, pause: int) -> None:
        strength, grown = rng.uniform(0.6, 1.0), rng.uniform(0.85, 1.1)
        ramp = max(1, int(onset * scans))
        for t in range(scans):
            f = strength * min(1.0, (t + 1) / ramp, (scans - t) / max(1, ramp // 2))
            spots.append((x, y, angle, f, grown))
        spots.extend([(x, y, angle, 0.0, 1.0)] * pause)

    def around() -> float:  # so that the strip in question is under most presses
        return float(np.clip(at + 0.5 + rng.uniform(-0.6, 0.6) * wide, 0.0, n))

    if recording == "one press":
        press(around(), rng.uniform(0.2, 0.8), int(rng.integers(10, 200)), rng.uniform(-0.5, 0.5), 0.1, 5)
    elif recording == "few":
        for _ in range(int(rng.integers(3, 12))):
            press(around(), rng.uniform(0.1, 0.9), 1, rng.uniform(-0.5, 0.5), 0.1, 0)
    elif recording in ("presses", "slow presses", "fast", "some strips"):
        count = int(rng.integers(8, 30))
        long = {"fast": 6, "slow presses": 60}.get(recording, 25)
        for _ in range(count):
            near = recording == "some strips" or rng.random() < 0.5
            x = around() if near else rng.uniform(0.0, n)
            onset = 0.4 if recording == "slow presses" else 0.05
            press(x, rng.uniform(0.05, 0.95), int(long * rng.uniform(0.6, 1.4)), rng.uniform(-0.6, 0.6), onset,
                  int(rng.integers(2, 12)))  # fmt: skip
    else:
        scans = int(rng.integers(300, 900))
        share = np.linspace(0.0, 1.0, scans)
        slow = recording == "drag"
        cycles = (rng.uniform(1.0, 3.0), rng.uniform(1.5, 4.0), 2.0) if slow else (3.0, 5.0, 8.0)
        across, along, turn = (np.abs(2.0 * ((c * share + rng.uniform()) % 1.0) - 1.0) for c in cycles)
        tilt = rng.uniform(0.2, 0.6) * (2.0 * turn - 1.0)
        pushed = 0.8 + 0.2 * np.sin(share * rng.uniform(5.0, 40.0))
        spots = [(float(a) * n, 0.05 + 0.9 * float(b), float(c), float(d), 1.0)
                 for a, b, c, d in zip(across, along, tilt, pushed, strict=True)]  # fmt: skip
    x, y, angle, f, grown = np.array(spots).T[:, :, None]
    aspect = sensor.length_mm / sensor.pitch_mm  # strips a length
    dx = np.arange(n) + 0.5 - x
    size = np.sqrt(np.maximum(f, 0.0)) if kind == "finger" else np.where(f > 0.02, 1.0, 0.0)
    a, b = wide / 2.0 * size * grown, tall / 2.0 * size * grown
    sheer = np.tan(angle) / aspect
    with np.errstate(invalid="ignore", divide="ignore"):
        rel = np.abs(dx) / a
        if kind == "finger":
            half = b * np.sqrt(1.0 - rel**2)
            middle = y + dx * sheer
            low, up = middle - half, middle + half
        elif kind == "triangle":
            side = (dx / a + 1.0) / 2.0
            low = y - b + dx * sheer
            up = low + 2.0 * b * np.where(
                (side >= 0.0) & (side <= 1.0), np.minimum(side / 0.4, (1.0 - side) / 0.6), np.nan
            )
        else:
            thin = 0.3 if kind == "bar" else 1.0
            skew = 0.15 * dx / a * b
            low, up = y + dx * sheer - b * thin + skew, y + dx * sheer + b * thin - skew
            low = np.where(rel <= 1.0, low, np.nan)
    off = ~(f > 0.02) | ~np.isfinite(low + up) | (up < 0.02) | (low > 0.98) | (up - low < 0.005)
    top = 0.98 if sensor.construction != "crs-crs" else 1.0
    low, up = (
        np.where(off, np.nan, np.clip(low, 1.0 - top, 1.0)),
        np.where(off, np.nan, np.clip(up, 0.0, top)),
    )
    with np.errstate(invalid="ignore"):
        bad = ~(up - low > 0.003)
    low[bad] = up[bad] = np.nan
    bell = np.where(
        np.isfinite(low), f * np.sqrt(np.maximum(1.0 - (dx / np.maximum(a, 0.3)) ** 2, 0.0)), np.nan
    )
    return low, up, bell


def _soft(
    rng: np.random.Generator, sensor: Sensor, low: FloatArray, up: FloatArray, force: FloatArray
) -> tuple[FloatArray, FloatArray, float]:
    """Let edges be soft: errors of neighbouring strips correlate .4, and change slowly while a contact rests."""
    scans, n = low.shape
    edge = float(rng.choice([0.0, 0.002, 0.006, 0.012]))  # over L
    there = np.isfinite(low)
    fresh = np.ones(scans, dtype=bool)
    some = np.asarray(there.any(axis=1))
    fresh[1:] = some[1:] & ~some[:-1]
    for values in (low, up):
        own = np.zeros((scans, n))
        state = rng.normal(size=n)
        for t in range(scans):
            new = rng.normal(size=n)
            state = new if fresh[t] else 0.97 * state + np.sqrt(1 - 0.97**2) * new
            own[t] = state
        own = 0.7 * own + 0.55 * np.roll(own, 1, axis=1) + 0.3 * np.roll(own, -1, axis=1)
        values += edge * own
    np.clip(low, 0.0, 1.0, out=low)
    np.clip(up, 0.0, 1.0, out=up)
    with np.errstate(invalid="ignore"):
        bad = ~(up - low > 0.002)
    low[bad] = up[bad] = np.nan
    force[bad] = np.nan
    return low, up, edge


def _readings(
    rng: np.random.Generator, sensor: Sensor, low: FloatArray, up: FloatArray
) -> dict[str, FloatArray]:
    """Return k of strips as built: clamps, a cold joint on some, resistivity that varies, offsets and gains."""
    n = sensor.strips
    ratio = 0.0 if sensor.construction != "crs-crs" else sensor.resistivity_ratio
    y = np.linspace(0.0, 1.0, _NODES)
    wobble = float(rng.choice([0.0, 0.01, 0.03]))
    clamps = float(rng.choice([0.0, 0.005, 0.02]))
    s_low, s_up, total = np.full_like(low, np.nan), np.full_like(up, np.nan), np.ones(n)
    for i in range(n):
        density = 1.0 + wobble * np.interp(y, np.linspace(0, 1, 6), rng.normal(size=6))
        s = np.concatenate([[0.0], np.cumsum((density[1:] + density[:-1]) / 2.0) / (_NODES - 1)])
        ground, top = rng.uniform(0.0, clamps, 2)
        s_low[:, i], s_up[:, i] = np.interp(low[:, i], y, s) + ground, np.interp(up[:, i], y, s) + ground
        s_low[~np.isfinite(low[:, i]), i] = s_up[~np.isfinite(low[:, i]), i] = np.nan
        total[i] = ground + s[-1] + top
    lam = sensor.contact_lambda_mm / sensor.length_mm
    if lam:
        cut = lam * np.tanh((s_up - s_low) / (2.0 * lam))
        s_low, s_up = s_low + cut, s_up - cut
    w = s_up - s_low
    whole = total - w / (1.0 + ratio)
    own = {"kl": s_low / whole, "kh": (s_low + w * ratio / (1.0 + ratio)) / whole}
    k = own if ratio else {"k": own["kl"]}
    offset = float(rng.choice([0.0, 0.003, 0.01]))
    gain = float(rng.choice([0.0, 0.005, 0.02]))
    for name in k:
        k[name] = k[name] * (1.0 + gain * rng.uniform(-1.0, 1.0, n)) + offset * rng.uniform(-1.0, 1.0, n)
    return k


def _noise(rng: np.random.Generator, k: dict[str, FloatArray], rate: float, scans: int, n: int) -> float:
    """Add white noise, wander with a 1/f spectrum, part of it shared, and strays; return the white sigma."""
    white = float(rng.choice([0.0005, 0.001, 0.002, 0.004, 0.0066]))
    floor = float(rng.choice([0.0, 0.0005, 0.0011, 0.002]))
    share = float(rng.uniform(0.0, 0.6))
    common = _pink(rng, scans, 1)[:, 0]
    creep = float(rng.choice([0.0, 0.0, 0.01])) * rng.uniform(-1.0, 1.0)
    for name in k:
        values = k[name]
        values += white * rng.normal(size=(scans, n))
        values += floor * (np.sqrt(1.0 - share) * _pink(rng, scans, n) + np.sqrt(share) * common[:, None])
        values += creep * np.linspace(0.0, 1.0, scans)[:, None]
        stray = rng.random((scans, n)) < 3e-4
        values[stray] += rng.normal(size=int(stray.sum())) * 0.05
    return white


def _pink(rng: np.random.Generator, scans: int, n: int) -> FloatArray:
    """Return 1/f noise (scans, n) with a standard deviation of 1."""
    spectrum = np.fft.rfft(rng.normal(size=(max(scans, 8), n)), axis=0)
    f = np.arange(len(spectrum), dtype=float)
    f[0] = np.inf
    out = np.fft.irfft(spectrum / np.sqrt(f)[:, None], max(scans, 8), axis=0)[:scans]
    return np.asarray(out / max(float(out.std()), 1e-12))


def _fail(
    rng: np.random.Generator, sensor: Sensor, k: dict[str, FloatArray], low: FloatArray, up: FloatArray,
    force: FloatArray, fault: str, at: int,
) -> tuple[float, tuple[int, ...], str]:  # fmt: skip
    """Do to the true readings what a broken strip, clamp or wire does; return size, strips and what it is."""
    if fault.startswith("open"):
        cut = {"open-low": 0.0, "open-high": 1.0}.get(fault, float(rng.uniform(0.15, 0.85)))
        leak = float(rng.choice([0.0, 0.004]))
        for name in k:
            own = k[name][:, at]
            own = np.where(up[:, at] <= cut, leak, own)
            k[name][:, at] = np.where(low[:, at] >= cut, 1.0 - leak, own)
        return cut, (at,), f"cut {cut:.2f}"
    if fault in ("short", "short-edge"):
        place = float(rng.uniform(0.05, 0.95))
        if "k" in k:
            _bridge_metal(rng, k["k"], low, up, at, place)
            return place, (at, at + 1), f"metal at {place:.2f}"
        if rng.random() < 0.5:  # of wires
            name = str(rng.choice(["kh", "kl"]))
            both = np.isfinite(k[name][:, at]) & np.isfinite(k[name][:, at + 1])
            mean = (k[name][:, at] + k[name][:, at + 1]) / 2.0
            for i in (at, at + 1):
                k[name][both, i] = mean[both]
            return -1.0, (at, at + 1), f"wires {name}"
        _bridge_rubber(sensor, k, low, up, at, place)
        return place, (at, at + 1), f"sensing strips at {place:.2f}"
    if fault == "swapped-wires":
        k["kh"][:, at], k["kl"][:, at] = k["kl"][:, at].copy(), k["kh"][:, at].copy()
    elif fault == "swapped-ends":
        turned = {name: 1.0 - k[{"kh": "kl", "kl": "kh", "k": "k"}[name]][:, at] for name in k}
        for name in k:
            k[name][:, at] = turned[name]
    elif fault == "swapped-strips":
        for values in (*k.values(), low, up):  # the columns, touched or not
            values[:, [at, at + 1]] = values[:, [at + 1, at]]
        return 0.0, (at, at + 1), ""
    elif fault == "pressure":
        gain = float(rng.uniform(0.4, 0.9))
        for name in k:
            k[name][:] = np.clip(gain * force * (1.0 + 0.1 * rng.normal(size=sensor.strips)), 0.0, 1.0)
        return gain, (), ""
    return 0.0, (at,), ""


def _bridge_metal(
    rng: np.random.Generator, k: FloatArray, low: FloatArray, up: FloatArray, at: int, place: float
) -> None:
    """Energise each of two strips in turn, joined at a place by a few per cent of a strip's resistance."""
    ohm = float(rng.choice([1e-3, 1e-3, 0.03]))
    for i, j in ((at, at + 1), (at + 1, at)):
        for t in np.flatnonzero(np.isfinite(low[:, i])):
            # Nodes: ground 0, Vref 1, sheet 2, bridge on i 3, bridge on j 4.
            g = np.zeros((5, 5))

            def join(a: int, b: int, length: float, g: FloatArray = g) -> None:
                c = 1.0 / max(length, 1e-4)
                g[a, a] += c
                g[b, b] += c
                g[a, b] -= c
                g[b, a] -= c

            l, u = low[t, i], up[t, i]
            if place < l:
                parts = [(0, 3, place), (3, 2, l - place), (2, 1, 1.0 - u)]
            elif place > u:
                parts = [(0, 2, l), (2, 3, place - u), (3, 1, 1.0 - place)]
            else:
                parts = [(0, 2, l), (2, 1, 1.0 - u), (2, 3, 0.0)]
            for part in (*parts, (3, 4, ohm)):
                join(*part)
            if np.isfinite(low[t, j]):
                a, b = low[t, j], up[t, j]
                join(4, 2, max(a - place, place - b, 0.0))
            v = np.linalg.solve(g[2:, 2:] + 1e-9 * np.eye(3), -g[2:, 1])
            k[t, i] += v[0] - l / max(1.0 - (u - l), 1e-3)  # what the bridge changes


def _bridge_rubber(
    sensor: Sensor, k: dict[str, FloatArray], low: FloatArray, up: FloatArray, at: int, place: float
) -> None:
    """Join the sensing strips of two neighbours at a place; both ladders are resolved."""
    n, ratio = _NODES, sensor.resistivity_ratio
    y = np.linspace(0.0, 1.0, n)
    there = np.flatnonzero(np.isfinite(low[:, at]) | np.isfinite(low[:, at + 1]))
    if not len(there):
        return
    base = np.zeros((4 * n, 4 * n))

    def join(g: FloatArray, a: int, b: int, c: float) -> None:
        g[a, a] += c
        g[b, b] += c
        g[a, b] -= c
        g[b, a] -= c

    for strip in range(2):
        for i in range(n - 1):
            join(base, 2 * strip * n + i, 2 * strip * n + i + 1, float(n - 1))
            join(base, (2 * strip + 1) * n + i, (2 * strip + 1) * n + i + 1, (n - 1) / ratio)
    node = round(place * (n - 1))
    for t in there:
        solved = []
        for bridged in (False, True):
            g = base.copy()
            for strip in range(2):
                l, u = low[t, at + strip], up[t, at + strip]
                if np.isfinite(l):
                    cover = np.clip(np.minimum(y + 0.5 / n, u) - np.maximum(y - 0.5 / n, l), 0.0, 1.0 / n) * n
                    for i in np.flatnonzero(cover > 0.01).tolist():
                        join(g, 2 * strip * n + i, (2 * strip + 1) * n + i, 3e4 * float(cover[i]))
            if bridged:
                join(g, n + node, 3 * n + node, 1e3)
            g += 1e-7 * np.eye(4 * n)
            rhs = np.zeros(4 * n)
            for strip in range(2):
                g[2 * strip * n, 2 * strip * n] += 1e7
                g[2 * strip * n + n - 1, 2 * strip * n + n - 1] += 1e7
                rhs[2 * strip * n + n - 1] = 1e7
            solved.append(np.linalg.solve(g, rhs))
        change = solved[1] - solved[0]
        for strip in range(2):
            if np.isfinite(low[t, at + strip]):
                k["kl"][t, at + strip] += change[(2 * strip + 1) * n]
                k["kh"][t, at + strip] += change[(2 * strip + 1) * n + n - 1]


def _ail(
    rng: np.random.Generator, sensor: Sensor, k: dict[str, FloatArray], rate: float, fault: str, at: int, size: float,
    about: str, noise: float,
) -> tuple[float, str]:  # fmt: skip
    """Do to the signals what bad wires, inputs and rubber do; return the size and what it is."""
    scans = len(next(iter(k.values())))
    names = list(k)
    one = [str(rng.choice(names))] if len(names) == 2 and rng.random() < 0.7 else names
    rest = (sensor.rest_volt or 0.0) / sensor.vref_volt
    t = np.arange(scans) / rate
    if fault in ("dead", "stuck"):
        level = float(rng.choice([0.0, rest])) if fault == "dead" else float(rng.uniform(0.08, 0.92))
        for name in one:
            own = k[name][:, at]
            k[name][:, at] = np.where(
                np.isfinite(own),
                level + (0.0005 if rng.random() < 0.5 else 0.0) * rng.normal(size=scans),
                np.nan,
            )
        return level, f"{one} at {level:.2f}"
    if fault == "saturation":
        every = np.concatenate([k[name][:, at] for name in one])
        every = every[np.isfinite(every)]
        level = float(np.quantile(every, rng.uniform(0.35, 0.75))) if len(every) else 0.5
        level = float(np.clip(level, 0.25, 0.9))
        for name in one:
            k[name][:, at] = np.minimum(k[name][:, at], level)
        return level, f"{one} at {level:.2f}"
    if fault == "drift":
        size = float(rng.choice([-1.0, 1.0]) * rng.choice([0.01, 0.015, 0.02, 0.03, 0.05]))
        shape = t / t[-1] if t[-1] else t
        if rng.random() < 0.3:
            shape = (1.0 - np.exp(-3.0 * shape)) / (1.0 - np.exp(-3.0))
        for name in names:
            k[name][:, at] += size * shape
        return size, f"{size:+.3f}"
    if fault == "wander":
        size = float(rng.choice([0.008, 0.012, 0.02, 0.03]))
        tau = float(rng.uniform(0.05, 0.25)) * scans
        own, state = np.zeros(scans), rng.normal()
        for i in range(scans):
            state = state * np.exp(-1.0 / tau) + np.sqrt(1.0 - np.exp(-2.0 / tau)) * rng.normal()
            own[i] = state
        own = own - own.mean()
        own *= size / max(own.std(), 1e-9)
        for name in names:
            k[name][:, at] += own
        return size, f"{size:.3f} tau {tau:.0f}"
    if fault == "intermittent":
        share, mean = float(rng.uniform(0.1, 0.5)), float(rng.choice([1.5, 5.0, 20.0]))
        out, gone = np.zeros(scans, dtype=bool), bool(rng.random() < share)
        for i in range(scans):
            if rng.random() < (1.0 / mean if gone else share / (1.0 - share) / mean):
                gone = not gone
            out[i] = gone
        level = float(rng.choice([0.0, rest, 1.0, np.nan]))
        if np.isnan(level) and sensor.rest_volt is not None:
            level = rest
        for name in one if np.isfinite(level) else names:
            own = k[name][:, at]
            k[name][:, at] = np.where(out & np.isfinite(own), level, own)
        return share, f"{one} {share:.2f} of the time at {level:.2f}, for {mean} scans"
    if fault == "hum":
        size, hertz = float(rng.choice([0.005, 0.01, 0.02])), float(rng.choice([50.0, 60.0]))
        size = max(size, 1.5 * noise)
        for name in names:
            k[name][:, at] += size * np.sin(2 * np.pi * hertz * t + 1.0)
        return size, f"{size:.3f} {hertz}"
    if fault == "noise":
        size = max(0.02, 6.0 * noise)
        for name in names:
            k[name][:, at] += size * rng.normal(size=scans)
        return size, f"{size:.3f}"
    return size, about
