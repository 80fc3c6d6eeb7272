"""All outlines that stay within the bounds of every reading, in terms of the heights of their edges' lines.

Once it is known which edge lies on which strip, a bound of a reading is linear in the heights:
c_l l + c_u u <= k L (`circuit.end_weights`), so the set is a polytope. A kink is where two lines cross; on the
strips of the zone where it may lie, the edge is the greater of two lines (the slope rises) or the smaller. A bound
that holds for both lines is linear again; one that either may meet is kept as a pair, "either or".

A first outline within them, or the knowledge that there is none, comes from branch and bound over the kinks' places.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.core.binding import at as address
from tacstrip.core.binding import exported
from tacstrip.core.polytope import feasible_part, minimax
from tacstrip.reconstruction.set_membership.edge_lines import EdgeLines, ReadingBounds
from tacstrip.sensor.closed_form import end_weights, sensing_share, transfer_length
from tacstrip.sensor.constructions import SIGNATURES

_LOST = 2  # the turn on a strip in two zones of one chain: any of three lines
_PARTS = 16  # looked at, at most
_DESCENTS = 8  # rounds of one
_SCALE = 0.01  # of the strip length: far outside


@dataclass(frozen=True, eq=False)
class FeasibleSet:
    """Heights h [mm] of lines with A h <= b, and of each pair of rows E h <= e at least one.

    Without the pairs it is a polytope that holds the set.

    Attributes
    ----------
    zones
        Where each crossing may lie (C, 2) [mm]: kinks, then the ends' windows.
    a, b
        (M, P) and (M,) [mm].
    edge
        By how much a row's slack falls [mm] while its reading goes from likely to impossible (M,); 0 where the row
        is no bound of a reading.
    either_a, either_b, either_edge
        The same of the pairs (E, 2, P), (E, 2) and (E,).
    """

    zones: FloatArray
    a: FloatArray
    b: FloatArray
    edge: FloatArray
    either_a: FloatArray
    either_b: FloatArray
    either_edge: FloatArray

    @property
    def rows(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The rows that all hold: a, b and edge."""
        return self.a, self.b, self.edge

    @property
    def pairs(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The pairs of which one row holds at least: either_a, either_b and either_edge."""
        return self.either_a, self.either_b, self.either_edge


def feasible_set(band: ReadingBounds, lines: EdgeLines, zones: FloatArray, widths: FloatArray) -> FeasibleSet:
    """Return the outlines within the band whose kinks lie in their zones, and turn as the lines do.

    None is lost; on the rare strips in two zones of one chain, or where both chains have a choice in one bound,
    a bound is left out.

    Parameters
    ----------
    band, lines
        The readings' bounds, and which edges there are.
    zones
        Of the kinks (kinks, 2) [mm], in the order of `crossings`.
    widths
        Length of the contact on each strip, expected, least and greatest (3, n) [mm]: contact resistance needs them.
    """
    core = exported("feasible_set")
    if core is None:
        return plain_feasible_set(band, lines, zones, widths)
    zones, widths = np.ascontiguousarray(zones), np.ascontiguousarray(widths)
    counts, workspace, size = np.zeros(2, dtype=np.int64), np.empty(14 * len(band.x)), lines.reach.size
    given = lines.compiled, band.compiled, address(zones), address(widths), address(counts)
    core(*given, *[None] * 6, address(workspace))
    rows, pairs = counts.tolist()
    shapes = (size, rows), (rows,), (rows,), (size, 2, pairs), (2, pairs), (pairs,)
    made = [np.empty(shape) for shape in shapes]
    core(*given, *map(address, made), address(workspace))
    return FeasibleSet(np.concatenate([zones, band.windows]), *(part.T for part in made))


def plain_feasible_set(
    band: ReadingBounds, lines: EdgeLines, zones: FloatArray, widths: FloatArray
) -> FeasibleSet:
    """Do as `feasible_set`, in NumPy."""
    sensor, x = band.sensor, band.x
    split = lines.lower - 1
    l_first, l_second, l_turn = _lines_at(x, zones[:split], lines.turns[:split], 0)
    u_first, u_second, u_turn = _lines_at(x, zones[split:], lines.turns[split:], lines.lower)
    l_line, u_line = np.stack([l_first, l_second]), np.stack([u_first, u_second])
    l_share, u_share = lines.share(l_line, x), lines.share(u_line, x)
    eaten, per_width, bent = _transfer_length(widths, sensor.contact_lambda_mm)
    # A bound k L - c_l l - c_u u changes by D dk.
    narrow = 1.0 - sensing_share(sensor.sensing_ratio)
    edge = band.edge * (sensor.length_mm - narrow * (widths[0] - 2.0 * eaten))
    # Upper bounds of all signatures, then lower ones (B, n).
    k = np.stack([*band.high.values(), *band.low.values()])
    sign = np.repeat([1, -1], len(band.low))[:, None]
    upper_end = np.tile([SIGNATURES[name].at_upper_end for name in band.low], 2)[:, None]
    c_l, c_u = end_weights(k, upper_end, sensor.sensing_ratio)
    # With contact resistance c_l (l + T) + c_u (u - T) <= k L, and T = eaten + per_width (w - widths) + bent.
    lean = (c_l - c_u) * per_width
    fixed = k * sensor.length_mm - (c_l - c_u) * eaten + lean * widths[0]
    room = sign * fixed + np.maximum(-sign * (c_l - c_u) * bent, 0.0)
    c_l, c_u = sign * (c_l - lean), sign * (c_u + lean)

    def rows(
        i: IntArray, j: IntArray, at: IntArray, by_l: FloatArray, by_u: FloatArray, more: FloatArray
    ) -> FloatArray:
        # Of a row two heights of either chain's line count. The core takes rows beside each other.
        transposed = np.zeros((lines.reach.size, len(at) + len(more)))
        column = np.arange(len(at))
        for line, share, by in ((l_line[i, at], l_share[i, at], by_l), (u_line[j, at], u_share[j, at], by_u)):
            transposed[2 * line, column] = by * (1.0 - share)
            transposed[2 * line + 1, column] = by * share
        transposed[:, len(at) :] = more.T
        return transposed

    # A rising kink is the greater of two lines: an upper bound holds for both, a lower one for either.
    known = np.isfinite(k) & (l_turn != _LOST) & (u_turn != _LOST)
    l_or, u_or = l_turn == -sign, u_turn == -sign
    sure = _indices(
        (i, j, known & ~l_or & ~u_or & ((i == 0) | (l_turn != 0)) & ((j == 0) | (u_turn != 0)))
        for i, j in np.ndindex(2, 2)
    )
    l_pairs, u_pairs = known & l_or & ~u_or, known & u_or & ~l_or
    either = []
    for i in range(2):
        either.append((0, i, 1, i, l_pairs & ((i == 0) | (u_turn != 0))))
        either.append((i, 0, i, 1, u_pairs & ((i == 0) | (l_turn != 0))))
    first, second, bound, at = sure
    l_sure, u_sure, both = (np.flatnonzero(_corners(turn)) for turn in (l_turn, u_turn, l_turn | u_turn))
    # Lower lines are not below 0, upper ones not above L, and the lower is not above the upper.
    bare = np.concatenate([l_sure, u_sure, both])
    parts = np.repeat([0, 1, 2], [len(l_sure), len(u_sure), len(both)])
    crossing = _crossing_rows(lines, zones, band.windows)
    none = np.zeros(len(bare), dtype=np.int64)
    a = rows(
        np.concatenate([first, none]),
        np.concatenate([second, none]),
        np.concatenate([at, bare]),
        np.concatenate([c_l[bound, at], np.array([-1.0, 0.0, 1.0])[parts]]),
        np.concatenate([c_u[bound, at], np.array([0.0, 1.0, -1.0])[parts]]),
        crossing,
    ).T
    bare_room = np.array([0.0, sensor.length_mm, 0.0])[parts]
    b = np.concatenate([room[bound, at], bare_room, np.zeros(len(crossing))])
    edges = np.concatenate([edge[at], np.zeros(len(bare) + len(crossing))])
    nothing = np.zeros((0, lines.reach.size))
    sides = []
    for side in (0, 2):
        first, second, bound, at = _indices((choice[side], choice[side + 1], choice[4]) for choice in either)
        sides.append(rows(first, second, at, c_l[bound, at], c_u[bound, at], nothing))
    either_a = np.stack(sides, axis=1).T
    either_b, either_edge = np.stack([room[bound, at]] * 2).T, edge[at]
    return FeasibleSet(np.concatenate([zones, band.windows]), a, b, edges, either_a, either_b, either_edge)


def _indices(chosen: Iterable[tuple[int, int, BoolArray]]) -> tuple[IntArray, IntArray, IntArray, IntArray]:
    """Return the lines of both chains, bounds and strips, all (N,), of choices of lines and where (B, n) they hold."""
    parts = []
    for i, j, where in chosen:
        bound, at = np.nonzero(where)
        parts.append(np.stack([np.full(len(at), i), np.full(len(at), j), bound, at]))
    first, second, bound, at = np.concatenate(parts, axis=1)
    return first, second, bound, at


def _transfer_length(widths: FloatArray, contact_lambda: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return T at the expected width, its slope there, and how far T falls below that tangent, each (n,)."""
    expected, least, greatest = widths
    eaten = transfer_length(expected, contact_lambda)
    if contact_lambda == 0.0:
        return eaten, eaten, eaten
    slope = 0.5 * (1.0 - (eaten / contact_lambda) ** 2)
    below = [transfer_length(w, contact_lambda) - eaten - slope * (w - expected) for w in (least, greatest)]
    return eaten, slope, np.minimum(*below)


def _lines_at(
    x: FloatArray, zones: FloatArray, turns: IntArray, base: int
) -> tuple[IntArray, IntArray, IntArray]:
    """Return a chain's line at each x, the next one, and how they turn where either may be the edge: 0 for sure."""
    inside = (zones[:, :1] < x) & (x < zones[:, 1:])  # (kinks, n)
    first = base + (zones[:, 1:] <= x).sum(axis=0)
    turn = (inside * turns[:, None]).sum(axis=0)
    turn[inside.sum(axis=0) > 1] = _LOST
    return first, np.minimum(first + 1, base + len(zones)), turn


def _corners(turn: IntArray) -> BoolArray:
    """Return the strips with a sure line that lie first, last or beside a kink: there a line is lowest or highest."""
    sure = turn == 0
    beside = np.ones_like(sure)
    beside[1:-1] = ~(sure[:-2] & sure[2:])
    return np.asarray(sure & beside)


def _crossing_rows(lines: EdgeLines, zones: FloatArray, windows: FloatArray) -> FloatArray:
    """Return rows r with r h <= 0: two lines cross within their zone, and turn as they do."""
    pairs, turns = lines.crossings, np.concatenate([lines.turns, [1, -1]])
    inside = np.concatenate([zones, windows])
    given = np.concatenate([np.full(len(zones), True), ~np.array(lines.vertical)])
    pairs, turns, inside = pairs[given], turns[given], inside[given]
    rows = []
    for end, sign in ((0, 1.0), (1, -1.0)):
        gap = lines.rows(pairs[:, 1], inside[:, end]) - lines.rows(pairs[:, 0], inside[:, end])
        rows.append(sign * turns[:, None] * gap)
    return np.concatenate(rows)


class Effort:
    """How much searching is left, counted in work and not in time: the same on every computer.

    A linear program of P heights takes P^2 of it; a set of n strips to be written down P n / 8.
    """

    def __init__(self, left: float) -> None:
        self.left = left

    def spend(self, work: float) -> bool:
        """Take what a step costs, and say whether there was as much left."""
        self.left -= work
        return self.left >= 0.0


def feasible_point(
    whole: FeasibleSet,
    band: ReadingBounds,
    lines: EdgeLines,
    widths: FloatArray,
    start: FloatArray,
    effort: Effort,
) -> tuple[FloatArray, FloatArray] | None:
    """Return the analytic centre (P,) of a convex part of the set, and the barrier's curvature there (P, P).

    None where there is no such outline, or none was found in 16 parts or with the effort. The set is not convex: where
    the outlines that all bounds but the pairs allow are not enough to tell, the widest zone is halved.

    Parameters
    ----------
    whole
        The set.
    band, lines, widths
        What it was made of: as for `feasible_set`.
    start
        Heights (P,) near the set.
    effort
        What may be spent; it is less afterwards.
    """
    scale, size = _SCALE * band.sensor.length_mm, len(start)
    zones = [whole.zones[: len(lines.turns)]]
    for number in range(_PARTS):
        if not zones or not effort.spend(size**2 + number * size * len(band.x) / 8):
            return None
        part = zones.pop(0)
        bounds = whole if number == 0 else feasible_set(band, lines, part, widths)
        middle, worst, _ = minimax(bounds.a, bounds.b, start, scale)
        if worst >= 0.0:
            continue
        for at in (start, middle):
            found = _descend(bounds, at, scale, effort)
            if found is not None:
                return found
        kinked = ((part[:, :1] < band.x) & (band.x < part[:, 1:])).sum(axis=1)
        if kinked.max(initial=0) > 0:
            for end in (1, 0):  # the widest zone's lower half, then its upper one
                zones.append(part.copy())
                zones[-1][kinked.argmax(), end] = part[kinked.argmax()].mean()
    return None


def _descend(
    bounds: FeasibleSet, at: FloatArray, scale: float, effort: Effort
) -> tuple[FloatArray, FloatArray] | None:
    """Look from a point for a convex part that has an inside, with what effort is left."""
    work = len(at) ** 2
    most = min(_DESCENTS, int(effort.left // work))
    if most < 1:
        return None
    found, rounds = feasible_part((bounds.a, bounds.b), (bounds.either_a, bounds.either_b), at, scale, most)
    effort.spend(rounds * work)
    return found
