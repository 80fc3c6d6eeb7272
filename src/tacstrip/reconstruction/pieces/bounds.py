"""What a piece must hold and where it can reach, by the readings alone.

A piece is convex and holds what is surely its own, so it reaches a point only if the hull of both lies within what
every strip reads and meets no other piece. Each reading shuts out a cone behind itself, as seen from what is held.
Which strips are surely a piece's own follows from where else the readings would allow the cuts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.core.convex_chain import CONTRADICTED, convex_cost, lower_hull
from tacstrip.reconstruction.pieces.chain import Chain
from tacstrip.reconstruction.pieces.cover import Part, Read

_SLACK = 3.0  # deviations of a reading
_RAYS = 40  # evenly around
_ROUNDS = 3  # of looking for corners between the rays
_SAME_MM = 1e-3  # off a straight edge: no corner
_LEAST_MM = 1e-6  # in each direction: a straight edge that is all that shows is no line


@dataclass(frozen=True, eq=False)
class Bounds:
    """Outlines between which a piece lies (M, 2) [mm]; `smallest` is empty where no strip is surely its own."""

    smallest: FloatArray
    largest: FloatArray


def sure_strips(chain: Chain) -> BoolArray:
    """Return the strips (n,) that belong to their stretch wherever the readings would allow its cuts."""
    sure = np.isfinite(chain.y) & ~chain.left_out
    at = np.flatnonzero(sure)
    x, y, weight = chain.x[at], chain.y[at], chain.weight[at]
    cuts = [int(np.searchsorted(at, s.start)) for s in chain.stretches] + [len(at)]

    def cost(a: int, b: int) -> float:
        return convex_cost(x[a:b], y[a:b], weight[a:b]) if b - a > 2 else 0.0

    for a, c, b in zip(cuts[:-2], cuts[1:-1], cuts[2:], strict=True):
        here = cost(a, c) + cost(c, b)
        for step in (-1, 1):
            place = c + step
            while a <= place <= b and cost(a, place) + cost(place, b) < here + CONTRADICTED:
                sure[at[place if step < 0 else place - 1]] = False
                place += step
    return sure


def piece_bounds(
    group: Sequence[Part],
    others: Sequence[Sequence[Part]],
    chains: tuple[Chain, Chain],
    sure: tuple[BoolArray, BoolArray],
    read: Read,
    pitch: float,
    length: float,
) -> Bounds:
    """Return the bounds of the piece that `group` shows.

    Parameters
    ----------
    group, others
        What shows it, and the other pieces of its run.
    chains, sure
        Of l and of -u; `sure_strips` of each.
    read
        What the strips read.
    pitch, length
        Of the strips [mm].
    """
    held = _held(group, chains, sure, read)
    slack_l, slack_u = _SLACK * read.l_sigma, _SLACK * read.u_sigma
    below = np.column_stack([read.x, np.fmin(read.l, chains[0].y) - slack_l])
    above = np.column_stack([read.x, np.fmax(read.u, -chains[1].y) + slack_u])
    bodies = [_inside(_held(other, chains, sure, read), read, slack_l, slack_u) for other in others]
    edges = (read.x[0] - pitch, read.x[-1] + pitch, 0.0, length)
    if not len(held):
        return Bounds(held, shapely.get_coordinates(shapely.box(edges[0], edges[2], edges[1], edges[3]))[:-1])
    smallest = shapely.MultiPoint(held).convex_hull
    if smallest.geom_type != "Polygon":
        smallest = smallest.buffer(_LEAST_MM, quad_segs=1)
    ring = shapely.get_coordinates(shapely.normalize(smallest))[-2::-1]  # counter-clockwise
    return Bounds(ring, _reach(ring, below, above, np.concatenate([np.zeros((0, 2)), *bodies]), edges))


def _held(
    group: Sequence[Part], chains: tuple[Chain, Chain], sure: tuple[BoolArray, BoolArray], read: Read
) -> FloatArray:
    """Return the ends (M, 2) on strips that are surely the parts' own."""
    found = [np.zeros((0, 2))]
    for part in group:
        own = slice(part.stretch.start, part.stretch.stop)
        on = sure[part.side][own]
        y = np.maximum(part.stretch.at(read.x[own]), chains[part.side].y[own])[on]
        found.append(np.column_stack([read.x[own][on], y if part.side == 0 else -y]))
    return np.concatenate(found)


def _inside(held: FloatArray, read: Read, slack_l: FloatArray, slack_u: FloatArray) -> FloatArray:
    """Return points (M, 2) on strips that a piece surely covers."""
    if not len(held):
        return held
    on = (read.x >= held[:, 0].min()) & (read.x <= held[:, 0].max())
    low = lower_hull(held, read.x[on]) + slack_l[on]
    high = -lower_hull(held * (1.0, -1.0), read.x[on]) - slack_u[on]
    thick = low < high
    x = read.x[on][thick]
    return np.concatenate([np.column_stack([x, low[thick]]), np.column_stack([x, high[thick]])])


def _reach(
    ring: FloatArray,
    below: FloatArray,
    above: FloatArray,
    bodies: FloatArray,
    edges: tuple[float, float, float, float],
) -> FloatArray:
    """Return the places (M, 2) up to which a convex body may reach that holds a convex ring (N, 2).

    It holds no point of `bodies` (B, 2), nor one straight below those of `below`, or above those of `above` (n, 2).
    """
    points = np.concatenate([below, above, bodies])
    middle = ring.mean(axis=0)
    to = points - middle
    # Directions away from the ring, and along what is shut out (P, N + 1, 2): the cone of places behind a point.
    onward = np.concatenate(
        [np.tile([0.0, -1.0], (len(below), 1)), np.tile([0.0, 1.0], (len(above), 1)), bodies - ring[0]]
    )
    to_ring = np.concatenate([points[:, None] - ring, onward[:, None]], axis=1)
    across = to[:, :1] * to_ring[..., 1] - to[:, 1:] * to_ring[..., 0]
    along = to[:, :1] * to_ring[..., 0] + to[:, 1:] * to_ring[..., 1]
    turn = across / (np.abs(across) + np.abs(along))  # grows with the angle, -2 to 2 for -pi to pi
    turn = np.where(along < 0.0, np.copysign(2.0, across) - turn, turn)
    rows = np.arange(len(points))
    first, last = turn.argmin(axis=1), turn.argmax(axis=1)
    # As seen from without, what is held takes less than half a turn.
    low, high = across[rows, first], across[rows, last]
    outside = (low <= 0.0) & (high >= 0.0) & (turn[rows, last] - turn[rows, first] < 2.0)
    to = to[outside]
    right, left = (to_ring[rows, i][outside] for i in (first, last))  # the cone's edges
    low, high = np.minimum(edges[::2], ring.min(axis=0)), np.maximum(edges[1::2], ring.max(axis=0))
    walls = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    room = np.abs(np.array([high[0], low[0], high[1], low[1]]) - np.repeat(middle, 2))
    # A point is in a cone where it is left of the right edge and right of the left one: (2, P) half planes.
    normals = np.concatenate(
        [
            np.stack(
                [np.column_stack([-right[:, 1], right[:, 0]]), np.column_stack([left[:, 1], -left[:, 0]])]
            ),
            np.stack([walls, walls]),
        ],
        axis=1,
    )
    gap = np.concatenate([(normals[:, : len(to)] * to).sum(axis=2), np.stack([room, room])], axis=1)
    theta = np.linspace(-np.pi, np.pi, _RAYS, endpoint=False)
    _, active = _first_shut(theta, normals, gap)
    # Of the cones those count that stop a ray; without the others it is the larger.
    kept = np.unique(np.append(active // 2, np.arange(len(to), len(to) + len(walls))))
    normals, gap = normals[:, kept], gap[:, kept]
    tips = to[kept[kept < len(to)]]
    theta = np.sort(np.concatenate([theta, np.arctan2(tips[:, 1], tips[:, 0])]))
    radius, active = _first_shut(theta, normals, gap)
    # Where two lines bound what neighbouring rays reach, a corner is between, or several.
    for _ in range(_ROUNDS):
        change = np.flatnonzero(active != np.roll(active, -1))
        now, then = active[change], np.roll(active, -1)[change]
        n, m = normals[now % 2, now // 2], normals[then % 2, then // 2]
        a, b = gap[now % 2, now // 2], gap[then % 2, then // 2]
        sign = np.sign(n[:, 0] * m[:, 1] - n[:, 1] * m[:, 0])
        corners = np.arctan2((n[:, 0] * b - m[:, 0] * a) * sign, (a * m[:, 1] - b * n[:, 1]) * sign)
        width = (np.roll(theta, -1)[change] - theta[change]) % (2.0 * np.pi)
        after = (corners - theta[change]) % (2.0 * np.pi)
        after = np.where((sign != 0.0) & (after < width), after, 0.5 * width)
        theta = np.unique(np.concatenate([theta, (theta[change] + after + np.pi) % (2.0 * np.pi) - np.pi]))
        radius, active = _first_shut(theta, normals, gap)
    reached = middle + radius[:, None] * np.column_stack([np.cos(theta), np.sin(theta)])
    outline = shapely.Polygon(reached).simplify(_SAME_MM)
    return np.asarray(shapely.get_coordinates(outline)[:-1])


def _first_shut(theta: FloatArray, normals: FloatArray, gap: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return how far rays at angles (D,) reach until both half planes of a cone hold them, and which one was last.

    Half planes n y >= gap, (2, P, 2) and (2, P); the last one of cone p counted as 2 p, or 2 p + 1.
    """
    speed = normals @ np.stack([np.cos(theta), np.sin(theta)])  # (2, P, D)
    with np.errstate(divide="ignore", invalid="ignore"):
        enters = np.where(speed > 1e-12, gap[..., None] / speed, np.inf)
    both = enters.max(axis=0)
    cone = both.argmin(axis=0)
    rays = np.arange(len(theta))
    return both[cone, rays], 2 * cone + enters[:, cone, rays].argmax(axis=0)
