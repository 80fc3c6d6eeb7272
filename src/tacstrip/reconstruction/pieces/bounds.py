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
from tacstrip.core.convex_chain import hull_ends, sure_strips
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


def piece_bounds(
    groups: Sequence[Sequence[Part]],
    chains: tuple[Chain, Chain],
    read: Read,
    pitch: float,
    length: float,
) -> list[Bounds]:
    """Return the bounds of the pieces of a run.

    Parameters
    ----------
    groups
        What shows each.
    chains
        Of l and of -u.
    read
        What the strips read.
    pitch, length
        Of the strips [mm].
    """
    sure = _sure(chains[0]), _sure(chains[1])
    slack_l, slack_u = _SLACK * read.l_sigma, _SLACK * read.u_sigma
    below = np.column_stack([read.x, np.fmin(read.l, chains[0].y) - slack_l])
    above = np.column_stack([read.x, np.fmax(read.u, -chains[1].y) + slack_u])
    held = [_held(group, chains, sure, read) for group in groups]
    bodies = [_inside(points, read, slack_l, slack_u) for points in held]
    edges = (read.x[0] - pitch, read.x[-1] + pitch, 0.0, length)
    found = []
    for i, own in enumerate(held):
        if not len(own):
            whole = shapely.get_coordinates(shapely.box(edges[0], edges[2], edges[1], edges[3]))[:-1]
            found.append(Bounds(own, whole))
            continue
        smallest = shapely.convex_hull(shapely.linestrings(np.concatenate([own, own[:1]])))
        if smallest.geom_type != "Polygon":
            smallest = smallest.buffer(_LEAST_MM, quad_segs=1)
        ring = shapely.get_coordinates(shapely.normalize(smallest))[-2::-1]  # counter-clockwise
        others = np.concatenate([np.zeros((0, 2)), *bodies[:i], *bodies[i + 1 :]])
        found.append(Bounds(ring, convex_reach(ring, below, above, others, edges, _SAME_MM)))
    return found


def _sure(chain: Chain) -> BoolArray:
    """Return the strips (n,) that belong to their stretch wherever the readings would allow its cuts."""
    sure = np.isfinite(chain.y) & ~chain.left_out
    at = np.flatnonzero(sure)
    cuts = [int(np.searchsorted(at, s.start)) for s in chain.stretches] + [len(at)]
    sure[at] = sure_strips(chain.x[at], chain.y[at], chain.weight[at], cuts)
    return sure


def _held(
    group: Sequence[Part], chains: tuple[Chain, Chain], sure: tuple[BoolArray, BoolArray], read: Read
) -> FloatArray:
    """Return the ends (M, 2) on strips that are surely the parts' own."""
    found = [np.zeros((0, 2))]
    for part in group:
        own = slice(part.stretch.start, part.stretch.stop)
        on = sure[part.side][own]
        y = np.maximum(part.stretch.shown, chains[part.side].y[own])[on]
        found.append(np.column_stack([read.x[own][on], part.sign * y]))
    return np.concatenate(found)


def _inside(held: FloatArray, read: Read, slack_l: FloatArray, slack_u: FloatArray) -> FloatArray:
    """Return points (M, 2) on strips that a piece surely covers."""
    if not len(held):
        return held
    low, high = hull_ends(held, read.x)
    low, high = low + slack_l, high - slack_u
    thick = low < high
    x = read.x[thick]
    return np.concatenate([np.column_stack([x, low[thick]]), np.column_stack([x, high[thick]])])
