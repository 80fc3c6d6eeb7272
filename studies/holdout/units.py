"""A unit as the resistors it is made of, solved node by node, and its converter; written apart from the package's.

Rubber is a cumulated resistance along each strip, so that a ladder's nodes lie where they are needed: at the contact's
two ends, graded between them, and at the clamps. Faults are wired: a broken clamp is a large resistor, a bridge a
small one, a contact that comes and goes a conductance that does.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.sparse.linalg import splu

from studies.holdout.first_order import first_order

Array: TypeAlias = npt.NDArray[Any]
Link: TypeAlias = tuple[Array, Array, Array]  # nodes, nodes, conductances between them

METAL = ("crs-m", "cyl-crs-m")
_POINT = 0.05  # mm: what touches at least
_PULL = 100e3  # ohm: how the device asks whether a line is held, as docs/guide/build.md says
_HELD = 0.25  # of Vref: less than this between pull-up and pull-down
_LEAK = 1e-14  # S: a node that nothing holds is somewhere
_SYSTEMS = 5000  # ladders that are solved at once
_FINE = 401  # places at which the rubber is known


@dataclass(frozen=True)
class Bridge:
    """A resistor between two neighbouring strips `strip`, `strip + 1` of a layer (0 energised, 1 sensing) at y [mm]."""

    strip: int
    layer: int
    y: float
    ohm: float


@dataclass(frozen=True, eq=False)
class Build:
    """What a unit is made of: lengths [mm], resistances [ohm] of a whole strip, of clamps and wires.

    `below0`, `below1` (strips, places) are the resistances of a layer's strips below evenly spaced places, from 0 to
    the strip's own. `clamp0`, `clamp1` (strips, 2) are in series at the grounded and at the other end.
    """

    construction: str
    strips: int
    pitch: float
    length: float
    below0: Array
    below1: Array
    contact_lambda: float
    clamp0: Array
    clamp1: Array
    switch: float = 70.0  # of the multiplexers
    supply: float = 0.3  # of the driver and its wire, for all strips of a CRS-CRS sensor together
    input_ohm: float = 2e9
    input_level: float = 0.0  # where a free line goes
    bridges: tuple[Bridge, ...] = ()
    rungs: int = 28  # between the ends of a contact, closer near them

    @property
    def names(self) -> tuple[str, ...]:
        """The readings of a scan."""
        return ("k",) if self.construction in METAL else ("kh", "kl")

    @property
    def x(self) -> Array:
        """Centre lines (strips,) [mm]."""
        return np.asarray((np.arange(self.strips) + 0.5) * self.pitch)

    def conductance(self) -> float:
        """Of the contact, per length [S / mm]."""
        per_mm = float(np.median(self.below0[:, -1])) / self.length  # whatever a cut strip has
        per_mm += 0.0 if self.construction in METAL else float(np.median(self.below1[:, -1])) / self.length
        return float(1.0 / (per_mm * max(self.contact_lambda, 1e-3) ** 2))

    def read(self, low: Array, high: Array, gap: tuple[Array, Array] | None = None) -> Array:
        """Return the lines' potentials (names, scans, strips) over Vref, NaN where no contact holds a line.

        `low`, `high` (scans, strips) [mm] are NaN where nothing touches; within `gap` nothing does either.
        """
        scans = len(low)
        out = np.full((len(self.names), scans, self.strips), np.nan)
        held = np.isfinite(low)
        tied = {}
        for bridge in self.bridges:
            tied[bridge.strip], tied[bridge.strip + 1] = bridge, bridge
        alone = [i for i in range(self.strips) if i not in tied]
        where = np.argwhere(held[:, alone])
        for start in range(0, len(where), _SYSTEMS):
            scan, strip = where[start : start + _SYSTEMS].T
            strip = np.asarray(alone)[strip]
            holes = None if gap is None else tuple(g[scan, strip][:, None] for g in gap)
            out[:, scan, strip] = self._solve(
                strip[:, None], low[scan, strip][:, None], high[scan, strip][:, None], holes
            )[:, :, 0]
        for bridge in dict.fromkeys(self.bridges):
            pair = np.array([bridge.strip, bridge.strip + 1])
            some = np.flatnonzero(held[:, pair].any(axis=1))
            for start in range(0, len(some), _SYSTEMS // 2):
                scan = some[start : start + _SYSTEMS // 2]
                ends = low[scan][:, pair], high[scan][:, pair]
                strip = np.broadcast_to(pair, (len(scan), 2))
                holes = None if gap is None else tuple(g[scan][:, pair] for g in gap)
                solved = [self._solve(strip, *ends, holes, bridge, pull=p) for p in (None, 1.0, 0.0)]
                solved[0][:, np.abs(solved[1] - solved[2]).min(axis=0) > _HELD] = np.nan
                out[:, scan[:, None], pair] = solved[0]
        return out

    def open_lines(self, low: Array, high: Array) -> Array:
        """Return (scans, strips) whether the device takes a strip for untouched: its pulls move every line."""
        held = np.isfinite(low)
        out = ~held
        scan, strip = np.nonzero(held)
        for start in range(0, len(scan), _SYSTEMS):
            k, i = scan[start : start + _SYSTEMS], strip[start : start + _SYSTEMS]
            up, down = (
                self._solve(i[:, None], low[k, i][:, None], high[k, i][:, None], None, pull=p)
                for p in (1.0, 0.0)
            )
            out[k, i] = np.abs(up - down).min(axis=0)[:, 0] > _HELD
        return out

    def _solve(
        self,
        strip: Array,
        low: Array,
        high: Array,
        gap: tuple[Array, ...] | None,
        bridge: Bridge | None = None,
        pull: float | None = None,
    ) -> Array:
        """Return line potentials (names, systems, ladders) of systems of one ladder, or of a bridged pair."""
        systems, ladders = low.shape
        metal = self.construction in METAL
        grading = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, self.rungs + 1)))
        centre = np.where(np.isfinite(low), 0.5 * (low + high), 0.5 * self.length)
        half = np.where(np.isfinite(low), np.maximum(0.5 * (high - low), 0.5 * _POINT), 0.5 * _POINT)
        a, b = np.maximum(centre - half, 0.0), np.minimum(centre + half, self.length)
        y = np.concatenate(
            [
                np.zeros_like(a)[..., None],
                a[..., None] + (b - a)[..., None] * grading,
                np.full_like(a, self.length)[..., None],
            ],
            axis=2,
        )
        if bridge is not None:
            y = np.sort(np.concatenate([y, np.full_like(a, bridge.y)[..., None]], axis=2), axis=2)
        nodes = y.shape[2]
        middle = np.concatenate([y[..., :1], 0.5 * (y[..., 1:] + y[..., :-1]), y[..., -1:]], axis=2)
        inside = np.clip(middle, a[..., None], b[..., None])
        covered = np.diff(inside, axis=2)
        if gap is not None:
            hole = [np.nan_to_num(g, nan=-1.0)[..., None] for g in gap]
            covered -= np.clip(
                np.minimum(middle[..., 1:], hole[1]) - np.maximum(middle[..., :-1], hole[0]), 0.0, None
            )
        rung = np.where(np.isfinite(low)[..., None], self.conductance() * np.maximum(covered, 0.0), 0.0)

        first = np.arange(systems * ladders).reshape(systems, ladders) * (nodes if metal else 2 * nodes)
        step = 1 if metal else 2
        lower = first[..., None] + step * np.arange(nodes)
        count = systems * ladders * nodes * step
        sheet = count + np.arange(systems)  # one node of metal per system
        size = count + (systems if metal else 0)
        upper = np.broadcast_to(sheet[:, None, None], lower.shape) if metal else lower + 1
        links: list[Link] = [(lower, upper, rung)]
        links.append((lower[..., :-1], lower[..., 1:], self._rungs(self.below0, strip, y)))
        if not metal:
            links.append((upper[..., :-1], upper[..., 1:], self._rungs(self.below1, strip, y)))
        if bridge is not None:
            at = np.argmax(y == bridge.y, axis=2)
            layer = lower if bridge.layer == 0 or metal else upper
            ends = np.take_along_axis(layer, at[..., None], axis=2)[..., 0]
            links.append((ends[:, 0], ends[:, 1], np.full(systems, 1.0 / bridge.ohm)))
        line = [(sheet, None)] if metal else [(upper[..., -1], 1), (upper[..., 0], 0)]
        # What hangs on a line, seen from the converter's side of its wire: the input, and the pull where there is one.
        free = 1.0 / self.input_ohm + (0.0 if pull is None else 1.0 / _PULL)
        level = (self.input_level / self.input_ohm + (0.0 if pull is None else pull / _PULL)) / free
        series = [self.switch + (0.0 if end is None else self.clamp1[strip, end]) for _, end in line]
        ground = [
            (at, np.broadcast_to(1.0 / (1.0 / free + wire), at.shape), level)
            for (at, _), wire in zip(line, series, strict=True)
        ]
        switch = self.switch if metal else self.supply * self.strips  # a share of the common one each
        top, bottom = (1.0 / (self.clamp0[strip, end] + switch) for end in (1, 0))
        out = []
        for driven in range(ladders) if metal else [slice(None)]:
            feed = [
                (lower[:, driven, -1], top[:, driven], np.ones_like(top[:, driven])),
                (lower[:, driven, 0], bottom[:, driven], np.zeros_like(top[:, driven])),
            ]
            potential = _potentials(size, links, ground + feed)
            share = [
                free * wire / (1.0 + free * wire) for wire in series
            ]  # of the line's potential that its input makes
            out.append(
                np.stack(
                    [(1.0 - s) * potential[at] + s * level for (at, _), s in zip(line, share, strict=True)]
                )
            )
        return np.stack([o[:, :] for o in out], axis=2) if metal else out[0]

    def _rungs(self, below: Array, strip: Array, y: Array) -> Array:
        """Return conductances between places y (systems, ladders, nodes) of strips (systems, ladders)."""
        at = y / self.length * (below.shape[1] - 1)
        left = np.minimum(at.astype(int), below.shape[1] - 2)
        row = strip[..., None]
        value = below[row, left] + (at - left) * (below[row, left + 1] - below[row, left])
        return np.asarray(1.0 / np.maximum(np.diff(value, axis=2), 1e-7 * np.median(below[:, -1])))


def _potentials(size: int, links: list[Link], ground: list[tuple[Array, Array, Array | float]]) -> Array:
    """Return the potentials of nodes that links join, and resistors to known potentials hold."""
    diagonal, right = np.full(size, _LEAK), np.zeros(size)
    for node, g, level in ground:
        np.add.at(diagonal, np.ravel(node), np.ravel(np.broadcast_to(g, np.shape(node))))
        np.add.at(right, np.ravel(node), np.ravel(np.broadcast_to(g * level, np.shape(node))))
    return np.asarray(_factored(diagonal, links).solve(right))


def _factored(diagonal: Array, links: list[Link]) -> Any:
    """Return the factors of a network's matrix; `diagonal`: each node's conductance to known potentials, changed."""
    nodes = np.arange(len(diagonal))
    rows, columns, values = [nodes], [nodes], [diagonal]
    for a, b, g in links:
        a, b, g = (np.ravel(v) for v in np.broadcast_arrays(a, b, g))
        rows += [a, b]
        columns += [b, a]
        values += [-g, -g]
        np.add.at(diagonal, a, g)
        np.add.at(diagonal, b, g)
    entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    matrix = sparse.csc_matrix(entries, (len(nodes), len(nodes)))
    return splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})


@dataclass(frozen=True, eq=False)
class SheetBuild:
    """A CRS-CRP unit: strips under a sheet of rubber, with electrodes in line with the strips at both of its edges."""

    strips: int
    pitch: float
    length: float
    strip_ohm: Array  # (strips,)
    ratio: float  # of the sheet's resistivity to the strips'
    contact_lambda: float
    clamp: float
    columns: int = 3  # a pitch
    rows: int = 48
    names: tuple[str, ...] = ("kh", "kl")
    construction: str = "crs-crp"

    @property
    def x(self) -> Array:
        """Centre lines (strips,) [mm]."""
        return np.asarray((np.arange(self.strips) + 0.5) * self.pitch)

    def read(self, low: Array, high: Array, gap: object = None) -> Array:
        """Return own electrodes' potentials (2, scans, strips) over Vref; NaN where nothing touches."""
        wide, tall = self.columns * self.strips, self.rows + 1
        step_y, step_x = self.length / self.rows, self.pitch / self.columns
        sheet = np.arange(wide * tall).reshape(wide, tall)
        strip = wide * tall + np.arange(self.strips * tall).reshape(self.strips, tall)
        square = self.ratio * self.strip_ohm.mean() * self.pitch / self.length  # ohm a square
        across = np.full((wide - 1, tall), step_y / step_x / square)
        across[:, [0, -1]] *= 0.5
        along = np.full((wide, tall - 1), step_x / step_y / square)
        links = [(sheet[:-1], sheet[1:], across), (sheet[:, :-1], sheet[:, 1:], along)]
        links.append(
            (
                strip[:, :-1],
                strip[:, 1:],
                np.broadcast_to((self.rows / self.strip_ohm)[:, None], (self.strips, self.rows)),
            )
        )
        per_mm = self.strip_ohm.mean() / self.length * (1.0 + self.ratio)
        g = 1.0 / (per_mm * self.contact_lambda**2)
        edges = np.clip((np.arange(tall + 1) - 0.5) * step_y, 0.0, self.length)
        middle = sheet[self.columns // 2 :: self.columns]
        sides = [sheet[c :: self.columns] for c in range(self.columns)]
        out = np.full((2, len(low), self.strips), np.nan)
        for scan in range(len(low)):
            on = np.flatnonzero(np.isfinite(low[scan]))
            if not len(on):
                continue
            a, b = low[scan][:, None], high[scan][:, None]
            b, a = np.maximum(b, a + _POINT), np.minimum(a, self.length - _POINT)
            cover = np.nan_to_num(np.clip(np.minimum(edges[1:], b) - np.maximum(edges[:-1], a), 0.0, None))
            touch = [(strip, side, g / self.columns * cover) for side in sides]
            size = (wide + self.strips) * tall
            solver = _factored(np.full(size, 1e-12), links + touch)
            right = np.zeros((size, len(on)))
            right[strip[on, -1], np.arange(len(on))] = (
                1.0  # a current in at one end of one strip, out at the other
            )
            right[strip[on, 0], np.arange(len(on))] = -1.0
            potential = solver.solve(right)
            bottom = potential[strip[on, 0], np.arange(len(on))] - self.clamp
            top = potential[strip[on, -1], np.arange(len(on))] + self.clamp
            for name, end in ((0, -1), (1, 0)):
                out[name, scan, on] = (potential[middle[on, end], np.arange(len(on))] - bottom) / (
                    top - bottom
                )
        return out


def rubber(
    strips: int,
    ohm: float,
    random: np.random.Generator,
    each: float = 0.05,
    uneven: float = 0.0,
    pieces: int = 12,
) -> Array:
    """Return resistances below evenly spaced places: strips differ by `each`, and along themselves by `uneven` (sd)."""
    own = ohm * np.exp(random.normal(0.0, each, strips))
    knots = np.exp(uneven * random.normal(size=(strips, pieces + 1)))
    at = np.linspace(0.0, pieces, _FINE)
    density = np.stack([np.interp(at, np.arange(pieces + 1), k) for k in knots])
    below = np.concatenate(
        [np.zeros((strips, 1)), np.cumsum(0.5 * (density[:, 1:] + density[:, :-1]), axis=1)], axis=1
    )
    return np.asarray(own[:, None] * below / below[:, -1:])


def build(
    construction: str,
    strips: int,
    pitch: float,
    length: float,
    random: np.random.Generator,
    *,
    ohm: float = 8e3,
    ratio: float = 1.0,
    contact_lambda: float = 1.0,
    each: float = 0.05,
    uneven: float = 0.0,
    clamp: float = 0.002,
    input_level: float = 0.0,
) -> Build | SheetBuild:
    """Return a sound unit: clamps have up to `clamp` of a strip's resistance."""
    if construction == "crs-crp":
        return SheetBuild(
            strips,
            pitch,
            length,
            ohm * np.exp(random.normal(0.0, each, strips)),
            100.0,
            max(contact_lambda, 1.0),
            clamp * ohm,
        )
    below0, below1 = (rubber(strips, o, random, each, uneven) for o in (ohm, ratio * ohm))
    clamp0, clamp1 = (random.uniform(0.2, 1.0, (strips, 2)) * clamp * o for o in (ohm, ratio * ohm))
    return Build(
        construction,
        strips,
        pitch,
        length,
        below0,
        below1,
        contact_lambda,
        clamp0,
        clamp1,
        input_level=input_level,
    )


def broken(unit: Build, strip: int, y: float, layer: int = 0, ohm: float = 1e13) -> Build:
    """Return the unit with a strip cut at y [mm]."""
    name = f"below{layer}"
    below = getattr(unit, name).copy()
    below[strip] += np.where(np.linspace(0.0, unit.length, below.shape[1]) > y, ohm, 0.0)
    return replace(unit, **{name: below})


def unclamped(unit: Build, strip: int, end: int, layer: int = 0, ohm: float = 1e13) -> Build:
    """Return the unit with a broken wire at the grounded end (0) or the other (1) of a strip."""
    name = f"clamp{layer}"
    clamps = getattr(unit, name).copy()
    clamps[strip, end] += ohm
    return replace(unit, **{name: clamps})


WANDER_S = (3.0, 12.0, 50.0, 200.0, 800.0)  # s: together a flicker


@dataclass(frozen=True)
class Material:
    """What rubber, soft edges and the surroundings add, over Vref, as findings 7 measured it on other sensors."""

    white: float = 0.001  # standard deviations
    wander: float = 0.0  # of each strip's zero
    common: float = 0.0  # of all strips' together
    hum: float = 0.0
    hum_hz: float = 50.0
    stray: float = 0.0003  # share of readings, one or two in a row
    edge_mm: float = 0.0  # where a soft contact ends, alike on neighbours by 0.4
    creep: float = 0.0  # of the contact's length in 15 s, then 4 times as much a decade


@dataclass(frozen=True, eq=False)
class Converter:
    """Amplifiers and converter: raw = gain k + offset, limited, rounded."""

    offset: Array  # (names, strips), over Vref
    gain: Array  # (names, strips)
    bits: int = 12
    ceiling: Array = field(default_factory=lambda: np.array(1.0))  # over Vref, of each channel
    floor: Array = field(default_factory=lambda: np.array(0.0))

    def codes(self, volts: Array) -> Array:
        """Return codes of readings (names, scans, strips) over Vref; -1 for NaN."""
        raw = self.gain[:, None] * volts + self.offset[:, None]
        raw = np.clip(
            raw, *(np.broadcast_to(v, self.gain.shape)[:, None] for v in (self.floor, self.ceiling))
        )
        return self.rounded(raw)

    def rounded(self, raw: Array) -> Array:
        """Return codes, clipped at 0 and Vref."""
        top = 2**self.bits - 1
        return np.where(np.isnan(raw), -1, np.round(np.clip(np.nan_to_num(raw), 0.0, 1.0) * top)).astype(
            np.int64
        )


def sound_converter(
    names: int, strips: int, bits: int, offset: float, gain: float, random: np.random.Generator
) -> Converter:
    """Return one with offsets and gains of these half-widths."""
    return Converter(
        random.uniform(-offset, offset, (names, strips)),
        1.0 + random.uniform(-gain, gain, (names, strips)),
        bits,
    )


def material_error(
    material: Material, shape: tuple[int, int, int], time_s: Array, random: np.random.Generator
) -> Array:
    """Return errors (names, scans, strips) over Vref at times (scans, strips)."""
    error = material.white * random.normal(size=shape)
    if material.wander:
        error += material.wander * flicker(shape, time_s[:, 0], random)
    if material.common:
        error += material.common * flicker((1, shape[1], 1), time_s[:, 0], random)
    if material.hum:
        error += (
            material.hum
            * np.sqrt(2.0)
            * np.sin(2.0 * np.pi * material.hum_hz * time_s + random.uniform(0.0, 6.3))
        )
    hit = random.random(shape) < material.stray
    error += hit * random.uniform(0.02, 0.2, shape) * random.choice([-1.0, 1.0], shape)
    return np.asarray(error)


def flicker(shape: tuple[int, int, int], time_s: Array, random: np.random.Generator) -> Array:
    """Return a process (names, scans, strips) of standard deviation 1 whose Allan deviation is flat from 3 to 800 s."""
    total = np.zeros(shape)
    gap = np.diff(time_s, prepend=time_s[0])
    for one in WANDER_S:
        keep = np.exp(-gap / one)
        first = random.normal(size=(shape[0], shape[2]))
        new = np.sqrt(1.0 - keep[:, None, None] ** 2) * random.normal(size=shape).swapaxes(0, 1)
        new[0] = first
        total += first_order(new, keep).swapaxes(0, 1)
    return np.asarray(total / np.sqrt(len(WANDER_S)))


def soft_ends(
    low: Array, high: Array, time_s: Array, length: float, material: Material, random: np.random.Generator
) -> tuple[Array, Array]:
    """Return where a contact (scans, strips) really ends: edges err alike on neighbours and all the time, and creep."""
    if material.edge_mm:
        off = np.asarray(random.normal(0.0, np.sqrt(1.0 - 0.4**2), (2, low.shape[1])))
        for i in range(1, low.shape[1]):
            off[:, i] += 0.4 * off[:, i - 1]
        low, high = low - material.edge_mm * off[0], high + material.edge_mm * off[1]
    if material.creep:
        held = np.maximum(time_s[:, :1] - time_s[0, 0], 0.0)
        grown = (
            material.creep
            * (high - low)
            * (1.0 - np.exp(-held / 5.0) + 4.0 * np.log10(1.0 + held / 15.0))
            / 2.0
        )
        low, high = low - grown, high + grown
    low, high = np.minimum(low, high), np.maximum(low, high)
    return np.clip(low, 0.0, length), np.clip(high, 0.0, length)


def moving(outline: Array, at: Array, turn: Array, x: Array, length: float) -> tuple[Array, Array]:
    """Return low and high ends (scans, strips) [mm] of an outline (N, 2) turned by `turn`, put at `at` (scans, 2)."""
    c, s = np.cos(turn)[:, None], np.sin(turn)[:, None]
    px = c * outline[:, 0] - s * outline[:, 1] + at[:, :1]  # (scans, N)
    py = s * outline[:, 0] + c * outline[:, 1] + at[:, 1:]
    low, high = np.full((len(at), len(x)), np.inf), np.full((len(at), len(x)), -np.inf)
    for i in range(len(outline)):
        x0, x1, y0, y1 = (v[:, [j]] for v in (px, py) for j in (i, (i + 1) % len(outline)))
        with np.errstate(divide="ignore", invalid="ignore"):
            y = y0 + (y1 - y0) * (x - x0) / (x1 - x0)
        crossed = (np.minimum(x0, x1) <= x) & (x <= np.maximum(x0, x1)) & np.isfinite(y)
        low = np.minimum(low, np.where(crossed, y, np.inf))
        high = np.maximum(high, np.where(crossed, y, -np.inf))
    low, high = np.maximum(low, 0.0), np.minimum(high, length)
    touched = low <= high
    return np.where(touched, low, np.nan), np.where(touched, high, np.nan)
