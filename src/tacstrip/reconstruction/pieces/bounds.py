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

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.core.convex_chain import CONTRADICTED, convex_cost, lower_hull
from tacstrip.core.convex_reach import convex_reach
from tacstrip.reconstruction.pieces.chain import Chain
from tacstrip.reconstruction.pieces.cover import Part, Read

_SLACK = 3.0  # deviations of a reading
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
    smallest = shapely.convex_hull(shapely.linestrings(np.concatenate([held, held[:1]])))
    if smallest.geom_type != "Polygon":
        smallest = smallest.buffer(_LEAST_MM, quad_segs=1)
    ring = shapely.get_coordinates(shapely.normalize(smallest))[-2::-1]  # counter-clockwise
    reached = convex_reach(ring, below, above, np.concatenate([np.zeros((0, 2)), *bodies]), edges)
    largest = shapely.Polygon(reached).simplify(_SAME_MM)
    return Bounds(ring, np.asarray(shapely.get_coordinates(largest)[:-1]))


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
