"""The outline of a piece: what the strips show of it, and between, where another piece hides it, what may be there.

A hidden corner is put halfway to the furthest place that the lines of the visible edges, the readings and the other
pieces leave to it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.core.convex_chain import hull_ends
from tacstrip.reconstruction.pieces.cover import Part, Read

_HALFWAY = 0.5  # to the furthest corner
_SLIVER = 0.01  # of the way: a piece of which one straight edge is seen is no line
_STEPS = 24  # of looking how far an outline can reach
_WAYS = np.linspace(0.0, 1.0, _STEPS + 1)[1:, None]
_SAME = 1  # strips between the ends of l and of u that are one
_TURN = 1e-9  # of the squared size: less is no corner


@dataclass(frozen=True, eq=False)
class PieceOutline:
    """One piece.

    Attributes
    ----------
    vertices
        Corners (N, 2) [mm], counter-clockwise.
    hidden, hidden_edges
        Which of them, and which edges from each to the next one, the readings do not show (N,).
    covariance
        Of vertices.ravel() (2 N, 2 N) [mm^2]; NaN for hidden ones.
    """

    vertices: FloatArray
    hidden: BoolArray
    hidden_edges: BoolArray
    covariance: FloatArray


@dataclass(frozen=True, eq=False)
class _Arc:
    """What a part shows, in the ring's direction: points (M, 2), their covariance, and how the edge goes on outside."""

    side: int  # 0: of l, 1: of u
    points: FloatArray
    covariance: FloatArray
    exact: tuple[bool, bool]  # whether the piece begins, or ends, with its first and its last point
    # Directions in which the outline goes on before the first, after the last.
    onward: tuple[FloatArray, FloatArray]


def shown_hull(parts: Sequence[Part], read: Read) -> FloatArray:
    """Return lower and upper ends (2, n) of the hull of what parts show, NaN on strips that it does not reach."""
    points = np.concatenate([part.stretch.corners * (1.0, part.sign) for part in parts])
    return hull_ends(points, read.x)


def trace(parts: Sequence[Part], read: Read, others: Sequence[FloatArray], pitch: float) -> PieceOutline:
    """Return the outline of a piece.

    Parameters
    ----------
    parts
        What shows it.
    read
        What the strips read.
    others
        The other pieces' `shown_hull`.
    pitch
        Of the strips [mm].
    """
    arcs = _ring(parts, pitch)
    points, flags, edges, blocks = [], [], [], []
    for i, arc in enumerate(arcs):
        following = arcs[(i + 1) % len(arcs)]
        points.append(arc.points)
        flags.append(np.zeros(len(arc.points), dtype=np.bool_))
        flags[-1][[0, -1]] = [not arc.exact[0], not arc.exact[1]]
        edges.append(np.zeros(len(arc.points), dtype=np.bool_))
        blocks.append(arc.covariance)
        if arc.side == following.side or not (arc.exact[1] and following.exact[0]):
            edges[-1][-1] = True
            start, end = arc.points[-1], following.points[0]
            far = _furthest(start, arc.onward[1], end, following.onward[0], read, others)
            if far is not None:
                points.append((0.5 * (start + end) * (1.0 - _HALFWAY) + far * _HALFWAY)[None])
                flags.append(np.array([True]))
                edges.append(np.array([True]))
                blocks.append(np.full((2, 2), np.nan))
    ring, hidden, unseen = np.concatenate(points), np.concatenate(flags), np.concatenate(edges)
    covariance = np.zeros((2 * len(ring),) * 2)
    at = 0
    for block in blocks:
        covariance[at : at + len(block), at : at + len(block)] = block
        at += len(block)
    kept = _corners(ring)
    first = int(np.lexsort((ring[kept, 1], ring[kept, 0]))[0])
    kept = np.concatenate([kept[first:], kept[:first]])  # from the left-most
    upto = np.cumsum(np.concatenate([[0], unseen, unseen]))  # twice round
    behind = np.concatenate([kept[1:], kept[:1]])
    unseen_edges = upto[behind + len(ring) * (behind <= kept)] > upto[kept]
    both = (2 * kept[:, None] + [0, 1]).ravel()
    covariance = covariance[np.ix_(both, both)]
    of_hidden = np.repeat(hidden[kept], 2)
    covariance[of_hidden], covariance[:, of_hidden] = np.nan, np.nan
    return PieceOutline(ring[kept], hidden[kept], unseen_edges, covariance)


def _corners(ring: FloatArray) -> IntArray:
    """Return which points of a ring (N, 2) are corners: not the same as the one before, and none that turns inwards."""
    kept, points = list(range(len(ring))), ring.tolist()  # a ring is small: lists are faster than arrays
    least = _TURN * float(np.ptp(ring, axis=0).max()) ** 2

    def turn(i: int) -> float:
        (ax, ay), (x, y), (bx, by) = (points[kept[j % len(kept)]] for j in (i - 1, i, i + 1))
        return float((x - ax) * (by - y) - (y - ay) * (bx - x))

    turns = [turn(i) for i in range(len(kept))]
    while len(kept) > 3 and (lowest := min(turns)) <= least:
        at = turns.index(lowest)
        del kept[at], turns[at]
        for beside in (at - 1, at % len(kept)):
            turns[beside] = turn(beside)
    return np.array(kept)


def _ring(parts: Sequence[Part], pitch: float) -> list[_Arc]:
    """Return the arcs of the outline, counter-clockwise: l from left to right, u back."""
    lower = sorted((p for p in parts if p.side == 0), key=lambda p: p.stretch.start)
    upper = sorted((p for p in parts if p.side == 1), key=lambda p: p.stretch.start)
    start, stop = min(p.stretch.start for p in parts), max(p.stretch.stop for p in parts)
    chains = [[_points(p, pitch) for p in side] for side in (lower, upper)]
    known = [
        [
            (p.begins and p.stretch.start <= start + _SAME, p.ends and p.stretch.stop >= stop - _SAME)
            for p in side
        ]
        for side in (lower, upper)
    ]
    for right in (False, True) if lower and upper else ():
        at = -1 if right else 0
        if known[0][at][at] and known[1][at][at]:
            _join(chains[0][at][0], chains[1][at][0], right, pitch)
    arcs = [_arc(*chain, exact, 1.0) for chain, exact in zip(chains[0], known[0], strict=True)]
    back = [_arc(*chain, exact, -1.0) for chain, exact in zip(chains[1], known[1], strict=True)]
    return arcs + back[::-1]


def _points(part: Part, pitch: float) -> tuple[FloatArray, FloatArray]:
    """Return the corners of a part (M + 1, 2), left to right, and their covariance."""
    stretch, sign = part.stretch, part.sign
    corners = stretch.corners * (1.0, sign)
    (x, slope, middle), last = (c.tolist() for c in (stretch.x, *stretch.lines.T[1:])), len(stretch.lines)
    by = np.zeros((2 * len(corners), 2 * last))  # of corners by height and slope of the lines
    for i in range(1, last):
        steeper = slope[i - 1] - slope[i]
        by_lines = np.array([-1.0, middle[i - 1] - x[i], 1.0, x[i] - middle[i]]) / steeper
        at = slice(2 * i - 2, 2 * i + 2)
        by[2 * i, at] = by_lines
        by[2 * i + 1, at] = (sign * slope[i - 1]) * by_lines
        by[2 * i + 1, 2 * i - 2] += sign
        by[2 * i + 1, 2 * i - 1] += sign * (x[i] - middle[i - 1])
    for i, line in ((0, 0), (last, last - 1)):
        by[2 * i + 1, 2 * line], by[2 * i + 1, 2 * line + 1] = sign, sign * (x[i] - middle[line])
    covariance = (by * stretch.variances.ravel()) @ by.T
    anywhere = pitch**2 / 12.0
    for i, line in ((0, 0), (last, last - 1)):  # an end lies anywhere within a pitch
        at_x, at_y, steep = 2 * i, 2 * i + 1, sign * slope[line]
        covariance[at_x, at_x] += anywhere
        covariance[at_x, at_y] += anywhere * steep
        covariance[at_y, at_x] += anywhere * steep
        covariance[at_y, at_y] += anywhere * steep**2
    return corners, covariance


def _join(lower: FloatArray, upper: FloatArray, right: bool, pitch: float) -> None:
    """Let both chains of a piece end in one point where they meet within a pitch, else on one x, in place."""
    at, inner = (-1, -2) if right else (0, 1)
    (xa, ya), (xb, yb) = lower[at], upper[at]
    slopes = [float((c[at, 1] - c[inner, 1]) / (c[at, 0] - c[inner, 0])) for c in (lower, upper)]
    end = max(xa, xb) if right else min(xa, xb)
    gap = (yb + slopes[1] * (end - xb)) - (ya + slopes[0] * (end - xa))
    closing = slopes[0] - slopes[1]
    meet = end + gap / closing if closing != 0.0 else np.inf
    if abs(meet - end) <= 0.5 * pitch:
        end = meet
    lower[at] = end, ya + slopes[0] * (end - xa)
    upper[at] = end, yb + slopes[1] * (end - xb)
    if upper[at, 1] < lower[at, 1]:
        lower[at, 1] = upper[at, 1] = 0.5 * (lower[at, 1] + upper[at, 1])


def _arc(points: FloatArray, covariance: FloatArray, exact: tuple[bool, bool], turn: float) -> _Arc:
    """Return a chain's part as an arc; turn 1: of l, from left to right, -1: of u, back.

    Beyond the end of a piece its outline goes on straight up or down; elsewhere as its last edge.
    """
    first, last = points[0] - points[1], points[-1] - points[-2]
    before = np.array([0.0, turn]) if exact[0] else first
    after = np.array([0.0, turn]) if exact[1] else last
    if turn > 0.0:
        return _Arc(0, points, covariance, exact, (before, after))
    n = len(points)
    flipped = covariance.reshape(n, 2, n, 2)[::-1, :, ::-1].reshape(2 * n, 2 * n)
    return _Arc(1, points[::-1], flipped, exact[::-1], (after, before))


def _furthest(
    start: FloatArray,
    leaving: FloatArray,
    end: FloatArray,
    arriving: FloatArray,
    read: Read,
    others: Sequence[FloatArray],
) -> FloatArray | None:
    """Return the furthest corner that an outline can have between two points; None where there is no room.

    It lies within both edges' lines, and so far out as strips and other pieces allow.
    """
    middle = 0.5 * (start + end)
    (px, py), (qx, qy), (gx, gy) = leaving.tolist(), arriving.tolist(), (end - start).tolist()
    long, short = math.hypot(px, py), math.hypot(qx, qy)
    across = py * qx - px * qy
    if (
        abs(across) > _TURN * long * short
        and (ahead := (gy * qx - gx * qy) / across) > 0.0
        and (px * gy - py * gx) / across > 0.0
    ):
        reach = start + ahead * leaving - middle
    else:  # the edges never meet
        outward = leaving / long + arriving / short
        if not np.linalg.norm(outward) > 0.0:
            outward = np.array([gy, -gx])
        size = max(float(np.ptp(read.x)), float(np.nanmax(read.u) - np.nanmin(read.l)))
        reach = outward / np.linalg.norm(outward) * size
    if not gx * float(reach[1]) - gy * float(reach[0]) < 0.0:
        return None  # inwards
    best = middle + _SLIVER * reach if np.array_equal(leaving, arriving) else None  # one end alone shows it
    tips = middle + _WAYS * reach
    beside = np.concatenate([tips, 0.5 * (start + tips), 0.5 * (end + tips)])
    there = _allowed(beside, read, others).reshape(3, _STEPS).all(axis=0)
    reached = int(there.argmin()) if not there.all() else _STEPS
    return tips[reached - 1] if reached else best


def _allowed(points: FloatArray, read: Read, others: Sequence[FloatArray]) -> BoolArray:
    """Return which points (M, 2) lie within what the strips beside them read, and in no other piece."""
    x, y = points.T
    strip = np.searchsorted(read.borders, x)
    inside = (np.abs(read.x[strip] - x) <= 0.5 * read.pitch) & (read.l[strip] <= y) & (y <= read.u[strip])
    for low, high in others:
        inside &= ~((low[strip] < y) & (y < high[strip]))
    return np.asarray(inside)
