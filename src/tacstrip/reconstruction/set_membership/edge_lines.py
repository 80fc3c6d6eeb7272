"""An outline as the lines of its edges, and what bounded noise lets each reading be."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.contact.noise import Noise
from tacstrip.core.binding import Band, Lines, Sendable
from tacstrip.core.binding import at as address
from tacstrip.geometry.outline import Outline
from tacstrip.sensor.closed_form import sensing_share
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.spec import Sensor


def reading_bound(noise: Noise, sensor: Sensor) -> tuple[float, float]:
    """Return how far a reading can be off [Vref], and up to where its error is equally likely.

    Errors uniform within +-a, +-b and half an A/D step add up to a trapezoid: flat up to the largest less the others,
    then falling to the sum of all. Of three errors that is nearly so.
    """
    parts = (noise.quantisation, noise.positional, sensor.adc_bound)
    return sum(parts), max(2.0 * max(parts) - sum(parts), 0.0)


@dataclass(frozen=True, eq=False)
class ReadingBounds(Sendable):
    """What the readings of neighbouring strips allow.

    Attributes
    ----------
    sensor
        The sensor.
    x
        Centre lines (n,) [mm].
    low, high
        Bounds of each signature, name to (n,) [Vref]; NaN leaves a reading out.
    edge
        Width at either bound [Vref] over which a reading becomes less likely.
    beyond_mm
        How much further out the ends lie than within a pitch of the outer strips.
    """

    sensor: Sensor
    x: FloatArray
    low: dict[str, FloatArray]
    high: dict[str, FloatArray]
    edge: float
    beyond_mm: float = 0.0

    @property
    def count(self) -> int:
        """How many readings there are."""
        return sum(int(np.isfinite(k).sum()) for k in self.low.values())

    @classmethod
    def of(
        cls,
        sensor: Sensor,
        x: FloatArray,
        readings: Mapping[str, FloatArray],
        noise: Noise,
        beyond_mm: float = 0.0,
    ) -> ReadingBounds:
        """Make the band of readings, name to (n,), that are off by no more than the noise's half-widths.

        A converter clips: what reads 0 or 1 may be further off, but no contact reads beyond.
        """
        reach, flat = reading_bound(noise, sensor)
        low = {name: np.maximum(k - reach, 0.0) for name, k in readings.items()}
        high = {name: np.minimum(k + reach, 1.0) for name, k in readings.items()}
        return cls(sensor, x, low, high, reach - flat, beyond_mm)

    @cached_property
    def compiled(self) -> Band:
        """What the compiled core takes."""
        sensor, n = self.sensor, len(self.x)
        bounds = [*self.low.values()], [*self.high.values()]
        x, low, high = (np.ascontiguousarray(v) for v in (self.x, *bounds))
        a = sensing_share(sensor.sensing_ratio)
        shares = [a if SIGNATURES[name].at_upper_end else 0.0 for name in self.low]
        windows = tuple(self.windows.ravel())
        constants = (1.0 - a, sensor.length_mm, sensor.contact_lambda_mm, self.edge, windows)
        made = Band(n, len(low), *map(address, (x, low, high)), (shares[0], shares[-1]), *constants)
        made.arrays = (x, low, high)
        return made

    @cached_property
    def windows(self) -> FloatArray:
        """Where the left and the right end of the contact lie (2, 2) [mm]: within a pitch of the outer strips."""
        near, far = self.beyond_mm, self.beyond_mm + self.sensor.pitch_mm
        return np.array([[self.x[0] - far, self.x[0] - near], [self.x[-1] + near, self.x[-1] + far]])


@dataclass(frozen=True, eq=False)
class EdgeLines(Sendable):
    """The edges of an outline but its vertical ones: lower chain, then upper, each left to right.

    Heights (2 Q,) [mm] say where they lie: of each line at its two abscissae.

    Attributes
    ----------
    reach
        Two abscissae per line (Q, 2) [mm].
    lower
        How many lines are of the lower chain.
    vertical
        Whether the left and the right end are vertical edges.
    turns
        Per kink, lower chain first, 1 where the slope rises and -1 where it falls (kinks,).
    """

    reach: FloatArray
    lower: int
    vertical: tuple[bool, bool]
    turns: IntArray

    @cached_property
    def compiled(self) -> Lines:
        """What the compiled core takes."""
        reach, turns = np.ascontiguousarray(self.reach), np.array(self.turns, dtype=np.int64)
        made = Lines(len(reach), self.lower, self.vertical, address(reach), address(turns))
        made.arrays = (reach, turns)
        return made

    @classmethod
    def of(cls, outline: Outline) -> tuple[EdgeLines, FloatArray]:
        """Return the lines of an outline and their heights (2 Q,) [mm]."""
        chains = (outline.lower, outline.upper)
        edges = np.concatenate([np.stack([c[:-1], c[1:]], axis=2) for c in chains])  # (Q, axis, end)
        reach, heights = edges[:, 0], edges[:, 1]
        slopes = [np.diff(c[:, 1]) / np.diff(c[:, 0]) for c in chains]
        turns = np.concatenate([np.where(np.diff(s) >= 0.0, 1, -1) for s in slopes])
        left, right = (bool(outline.lower[e, 1] != outline.upper[e, 1]) for e in (0, -1))
        return cls(reach, len(slopes[0]), (left, right), turns), heights.ravel()

    @property
    def crossings(self) -> IntArray:
        """Pairs of lines that cross (C, 2): at each kink, lower chain first, then at the left and the right end."""
        count = len(self.reach)
        inner = [(q, q + 1) for q in range(count - 1) if q != self.lower - 1]
        return np.array([*inner, (0, self.lower), (self.lower - 1, count - 1)])

    def share(self, line: IntArray, x: FloatArray) -> FloatArray:
        """Return the weight of a line's second height in its height at x, line (..., n) and x (n,): (..., n)."""
        ends = self.reach[line]
        return np.asarray((x - ends[..., 0]) / (ends[..., 1] - ends[..., 0]))

    def rows(self, line: IntArray, x: FloatArray) -> FloatArray:
        """Return the weights of all heights in the height of a line at x, both (n,): (n, 2 Q)."""
        share = self.share(line, x)
        rows = np.zeros((len(x), self.reach.size))
        at = np.arange(len(x))
        rows[at, 2 * line], rows[at, 2 * line + 1] = 1.0 - share, share
        return rows

    def at(self, heights: FloatArray, line: IntArray, x: FloatArray) -> FloatArray:
        """Return the heights of lines (..., C) at x (..., C) [mm], from all heights (..., 2 Q)."""
        e0, e1 = self.reach[line].T
        h = heights.reshape(*heights.shape[:-1], -1, 2)[..., line, :]
        return np.asarray(h[..., 0] + (h[..., 1] - h[..., 0]) * (x - e0) / (e1 - e0))

    def cross(self, heights: FloatArray) -> FloatArray:
        """Return x of the crossings (..., C) [mm]; not finite for parallel lines."""
        first, second = self.crossings.T
        origin = self.reach[first, 0]
        both = (origin, origin + 1.0)
        gap, next_gap = (self.at(heights, second, x) - self.at(heights, first, x) for x in both)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(origin - gap / (next_gap - gap))

    def chains(self, heights: FloatArray, vertical_x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the chains of vertices (..., M, 2), (..., N, 2) [mm]; vertical_x (..., 2) is x of vertical edges."""
        x = self.cross(heights)
        ends = np.where(self.vertical, vertical_x, x[..., -2:])
        kinks = np.split(x[..., :-2], [self.lower - 1], axis=-1)
        chains = []
        counts = (self.lower, len(self.reach) - self.lower)
        for start, count, inner in zip((0, self.lower), counts, kinks, strict=True):
            at = np.concatenate([ends[..., :1], inner, ends[..., 1:]], axis=-1)
            line = start + np.append(np.arange(count), count - 1)
            chains.append(np.stack([at, self.at(heights, line, at)], axis=-1))
        for end in (0, -1):
            if not self.vertical[end]:
                chains[1][..., end, :] = chains[0][..., end, :]
        return chains[0], chains[1]

    def density(self, heights: FloatArray, lower: FloatArray, upper: FloatArray) -> FloatArray:
        """Return, but for a constant, how much room in the vertices' places heights have (...,).

        It is the determinant of the vertices, `chains` (..., M, 2) and (..., N, 2), by the heights (..., 2 Q). Steep
        edges have much room in heights and hardly any in places.
        """
        run = np.concatenate([np.diff(lower[..., 0]), np.diff(upper[..., 0])], axis=-1)  # (..., Q)
        h = heights.reshape(*heights.shape[:-1], -1, 2)
        slope = (h[..., 1] - h[..., 0]) / np.diff(self.reach, axis=1)[:, 0]
        given = np.append(np.full(len(self.turns), True), ~np.array(self.vertical))
        first, second = self.crossings[given].T
        turn = np.abs(slope[..., second] - slope[..., first])
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.maximum(run, 0.0).prod(axis=-1) / turn.prod(axis=-1))
