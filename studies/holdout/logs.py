"""What a user records on a unit: how it is touched, what its converter gives, and the file that comes of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from studies.holdout import shapes, units
from studies.holdout.units import METAL, Array, Build, Converter, Material, SheetBuild

USES = (
    "exercise",
    "one press",
    "several presses",
    "slide",
    "roll",
    "ball",
    "untouched",
    "two objects",
    "edges",
    "short",
    "long",
    "wide",
    "common drift",
    "held",
)
_VREF = 5.0


@dataclass(frozen=True, eq=False)
class Touching:
    """Where a unit is touched: ends (scans, strips) [mm], NaN untouched, a gap between two objects, time [s]."""

    low: Array
    high: Array
    time_s: Array
    gap: tuple[Array, Array] | None = None


@dataclass(frozen=True, eq=False)
class Bench:
    """A unit with its converter and what its user wrote into the spec."""

    unit: Build | SheetBuild
    converter: Converter
    material: Material
    rest: float | None  # over Vref: lines of untouched strips are logged, at this level
    codes: bool  # the log has codes, not volts
    only: str | None = None  # single measurement: this name alone
    dwell: float = 0.0  # s from strip to strip

    def spec(self) -> str:
        """Return the spec file."""
        u = self.unit
        lines = ["format = 1", f'construction = "{u.construction}"', f"strips = {u.strips}"]
        lines += [f"pitch_mm = {u.pitch:g}", f"length_mm = {u.length:g}", f"adc_bits = {self.converter.bits}"]
        if u.construction == "crs-crs":
            ratio = u.below1[:, -1].mean() / u.below0[:, -1].mean() if isinstance(u, Build) else 1.0
            lines.append(f"resistivity_ratio = {ratio:.1f}")
        if u.construction == "crs-crp" and isinstance(u, SheetBuild):
            lines += [f"resistivity_ratio = {u.ratio:g}", f"contact_lambda_mm = {u.contact_lambda:g}"]
        if u.construction == "cyl-crs-m":
            lines.append(f"radius_mm = {1.002 * u.strips * u.pitch / (2.0 * np.pi):.6f}")
        if self.rest is not None:
            lines += [f"rest_volt = {_VREF * self.rest:.4f}", f"touch_volt = {_VREF * 0.04:.4f}"]
        return "\n".join(lines) + "\n"


@dataclass(frozen=True, eq=False)
class Fault:
    """A unit with something broken on some strips, all the time or where `away` of times (scans, strips) says so."""

    unit: Build
    strips: tuple[int, ...]
    away: Callable[[Array], Array] = lambda time_s: np.ones(time_s.shape, bool)


def bench(
    random: np.random.Generator, construction: str, strips: int, *, plain: bool = False, rests: bool = False
) -> Bench:
    """Return a sound unit drawn at random; `plain`: both channels, 12 bits; `rests`: it logs untouched strips."""
    pitch, length = random.uniform(3.0, 8.0), random.uniform(80.0, 320.0)
    rest = (
        float(random.uniform(0.03, 0.07))
        if (random.random() < 0.5 or rests) and construction != "crs-crp"
        else None
    )
    unit = units.build(
        construction,
        strips,
        round(pitch, 1),
        round(length),
        random,
        ohm=random.uniform(3e3, 3e4),
        ratio=float(random.choice([0.7, 1.0, 1.5])),
        contact_lambda=random.uniform(0.0, 0.008) * length,
        each=random.uniform(0.0, 0.08),
        uneven=random.uniform(0.0, 0.04),
        clamp=random.uniform(0.0005, 0.004),
        input_level=rest or 0.0,
    )
    bits = 12 if plain else int(random.choice([10, 12, 12, 14]))
    names = len(unit.names)
    converter = units.sound_converter(names, strips, bits, random.choice([0.003, 0.01, 0.03]), 0.005, random)
    white = 0.001 * np.exp(random.uniform(-0.7, 1.6))
    material = Material(
        white=white,
        wander=white * random.uniform(0.0, 0.4),
        common=white * random.uniform(0.0, 0.4),
        hum=white * random.uniform(0.0, 0.15),
        edge_mm=random.uniform(0.0, 0.3),
    )
    only = (
        str(random.choice(["kh", "kl"]))
        if construction == "crs-crs" and not plain and random.random() < 0.12
        else None
    )
    return Bench(
        unit, converter, material, rest, bool(random.random() < 0.4), only, random.uniform(0.5e-4, 3e-4)
    )


def _outline(random: np.random.Generator, wide: float, tall: float) -> Array:
    outline = shapes.draw(
        str(random.choice(["hull", "upright rectangle", "trapezoid", "ellipse", "rounded"])), random
    )
    outline = outline[:: max(1, len(outline) // 40)]
    outline = outline - 0.5 * (outline.min(axis=0) + outline.max(axis=0))
    return np.asarray(outline / np.ptp(outline, axis=0) * [wide, tall])


def _path(points: Array, scans: int) -> Array:
    """Return places (scans, 2) along a polyline, at one speed."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    at = np.linspace(0.0, along[-1], scans)
    return np.stack([np.interp(at, along, points[:, i]) for i in (0, 1)], axis=1)


def exercise(unit: Build | SheetBuild, scans: int, rate: float, random: np.random.Generator) -> Touching:
    """Return what docs/guide/doctor.md asks for: an object dragged across and along, off the ends, and turned."""
    wide, length = unit.strips * unit.pitch, unit.length
    size = unit.pitch * random.uniform(4.5, min(7.0, 0.6 * unit.strips)), length * random.uniform(0.2, 0.35)
    outline = _outline(random, *size)
    ways = []
    for i, level in enumerate(random.permutation([0.12, 0.37, 0.62, 0.88])):
        sides = [-0.8 * size[0], wide + 0.8 * size[0]][:: 1 if i % 2 == 0 else -1]
        ways += [(sides[0], level * length), (sides[1], (level + random.uniform(-0.1, 0.1)) * length)]
    for i, column in enumerate(random.permutation(np.linspace(0.12, 0.88, 4))):
        ends = [-0.7 * size[1], length + 0.7 * size[1]][:: 1 if i % 2 == 0 else -1]
        ways += [(column * wide, ends[0]), ((column + random.uniform(-0.08, 0.08)) * wide, ends[1])]
    at = _path(np.array(ways), scans)
    turn = np.radians(25.0) * np.sin(
        np.linspace(0.0, random.uniform(18.0, 30.0), scans) + random.uniform(0.0, 6.0)
    )
    return Touching(*units.moving(outline, at, turn, unit.x, length), np.arange(scans) / rate)


def touching(
    use: str, unit: Build | SheetBuild, scans: int, rate: float, random: np.random.Generator
) -> Touching:
    """Return how a unit is touched in one of the `USES`."""
    wide, length = unit.strips * unit.pitch, unit.length
    time_s = np.arange(scans) / rate
    size = unit.pitch * random.uniform(3.0, max(3.5, 0.6 * unit.strips)), length * random.uniform(0.08, 0.5)
    place = np.array([random.uniform(0.3, 0.7) * wide, random.uniform(0.3, 0.7) * length])
    outline, still = _outline(random, *size), np.zeros(scans)
    if use in ("exercise", "wide", "long", "common drift", "short"):
        return exercise(unit, scans, rate, random)
    if use == "untouched":
        nothing = np.full((scans, unit.strips), np.nan)
        return Touching(nothing, nothing, time_s)
    if use == "slide":
        there = np.array([random.uniform(-0.1, 1.1) * wide, random.uniform(0.1, 0.9) * length])
        return Touching(
            *units.moving(
                outline,
                _path(np.array([place, there]), scans),
                np.linspace(0.0, random.uniform(-1.5, 1.5), scans),
                unit.x,
                length,
            ),
            time_s,
        )
    if use == "roll":  # a bar across all or some strips that rolls along them, to and fro
        bar = _outline(random, wide * random.uniform(0.6, 1.3), length * random.uniform(0.02, 0.06))
        way = _path(np.array([(0.5 * wide, a * length) for a in (0.05, 0.95, 0.1, 0.9)]), scans)
        return Touching(*units.moving(bar, way, still + random.uniform(-0.2, 0.2), unit.x, length), time_s)
    if use == "ball":
        way = _path(np.vstack([random.uniform([0.0, 0.0], [wide, length]) for _ in range(5)]), scans)
        disc = shapes.turned(
            np.column_stack([np.cos(np.arange(40) * 0.157), np.sin(np.arange(40) * 0.157)]), 0.1
        )
        return Touching(
            *units.moving(disc * unit.pitch * random.uniform(1.2, 3.0), way, still, unit.x, length), time_s
        )
    if use == "edges":
        corner = random.choice([0.0, 1.0], 2) * [wide, length]
        return Touching(
            *units.moving(
                outline, np.tile(corner * 0.9 + place * 0.1, (scans, 1)), 0.2 * np.sin(time_s), unit.x, length
            ),
            time_s,
        )
    low, high = units.moving(
        outline, np.tile(place, (scans, 1)), still + random.uniform(0.0, 3.0), unit.x, length
    )
    if use == "two objects":
        other = _outline(random, size[0] * 0.7, size[1] * 0.4)
        there = place + np.array([0.2 * wide, 0.45 * length * random.choice([-1.0, 1.0])])
        low2, high2 = units.moving(
            other,
            np.tile(there, (scans, 1)) + np.stack([still, 0.03 * length * np.sin(time_s)], axis=1),
            still,
            unit.x,
            length,
        )
        gap = np.minimum(high, high2), np.maximum(low, low2)
        empty = ~(gap[0] < gap[1])
        return Touching(
            np.fmin(low, low2),
            np.fmax(high, high2),
            time_s,
            (np.where(empty, -1.0, gap[0]), np.where(empty, -1.0, gap[1])),
        )
    if use == "several presses":
        each = max(1, scans // int(random.integers(5, 16)))
        press = np.arange(scans) // each
        places = random.uniform([0.0, 0.05 * length], [wide, 0.95 * length], (press[-1] + 1, 2))[press]
        turns = random.uniform(0.0, 3.0, press[-1] + 1)[press]
        low, high = units.moving(outline, places, turns, unit.x, length)
        lifted = np.arange(scans) % each > 0.7 * each
        return Touching(
            np.where(lifted[:, None], np.nan, low), np.where(lifted[:, None], np.nan, high), time_s
        )
    if use == "one press":  # put down after a while and lifted again, or not
        off = time_s < 0.1 * time_s[-1] if random.random() < 0.5 else np.zeros(scans, bool)
        return Touching(np.where(off[:, None], np.nan, low), np.where(off[:, None], np.nan, high), time_s)
    return Touching(low, high, time_s)  # held


def lines(
    bench_: Bench,
    touching_: Touching,
    random: np.random.Generator,
    wrong: Callable[[Array, Array], Array] | None = None,
    fault: Fault | None = None,
) -> Array:
    """Return codes (names, scans, strips), -1 where the log has nothing.

    `wrong` changes what the amplifiers get (names, scans, strips) at times (scans, strips); `fault` is in the wiring.
    """
    unit, t = bench_.unit, touching_
    low, high = units.soft_ends(t.low, t.high, t.time_s[:, None], unit.length, bench_.material, random)
    time_s = t.time_s[:, None] + bench_.dwell * np.arange(unit.strips)
    volts = unit.read(low, high, t.gap)
    on = np.isfinite(volts[0])
    if fault is not None and isinstance(unit, Build):
        strips = np.array(fault.strips)
        mine = np.full_like(low, np.nan), np.full_like(high, np.nan)
        mine[0][:, strips], mine[1][:, strips] = low[:, strips], high[:, strips]
        broken = fault.unit.read(*mine)[:, :, strips]
        away = fault.away(time_s[:, strips])
        volts[:, :, strips] = np.where(away, broken, volts[:, :, strips])
        if not fault.unit.bridges:  # which asks for itself
            broken[:, fault.unit.open_lines(*mine)[:, strips]] = np.nan
        on[:, strips] = np.where(away, np.isfinite(broken[0]), on[:, strips])
    volts = volts + units.material_error(bench_.material, volts.shape, time_s, random)
    rest = np.broadcast_to(
        unit.input_level if isinstance(unit, Build) else 0.0, volts.shape
    ) + units.material_error(replace(bench_.material, stray=0.0), volts.shape, time_s, random)
    volts = np.where(np.isnan(volts), rest, volts)
    if wrong is not None:
        volts = wrong(volts, time_s)
    codes = bench_.converter.codes(volts)
    return codes if bench_.rest is not None else np.where(on, codes, -1)


def write(path: Path, bench_: Bench, codes: Array, time_s: Array) -> None:
    """Write a log (CSV) of codes (names, scans, strips)."""
    names = bench_.unit.names
    keep = [i for i, n in enumerate(names) if bench_.only in (None, n)]
    metal = bench_.unit.construction in METAL
    stem = "code" if bench_.codes else "v"
    columns = ["code" if bench_.codes else "v_out"] if metal else [f"{stem}_{names[i][1]}" for i in keep]
    top = 2**bench_.converter.bits - 1
    rows = [",".join(["scan", "time_s", "strip", *columns])]
    for scan in range(codes.shape[1]):
        for strip in range(codes.shape[2]):
            values = [int(codes[i, scan, strip]) for i in keep]
            texts = ["" if v < 0 else str(v) if bench_.codes else f"{_VREF * v / top:.5f}" for v in values]
            rows.append(",".join([str(scan), f"{time_s[scan]:.6f}", str(strip), *texts]))
    path.write_text("\n".join(rows) + "\n")
