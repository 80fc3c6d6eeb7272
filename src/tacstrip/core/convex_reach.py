"""How far a convex body that contains a given ring may extend: each reading excludes a cone behind itself."""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.core.binding import at, exported

RAYS = 40  # evenly around
ROUNDS = 3  # of looking for corners between the rays
PARALLEL = 1e-12  # component of a unit direction below which a ray never meets a line
SAME = 1e-9  # radians: a corner this close to a ray needs no ray of its own
_MOST_RAYS = 2 * RAYS << ROUNDS
_CONE, _WALLS = 8, 4  # doubles of a cone, and walls


def convex_reach(
    ring: FloatArray,
    below: FloatArray,
    above: FloatArray,
    bodies: FloatArray,
    edges: tuple[float, float, float, float],
    within: float,
) -> FloatArray:
    """Return the outline (M, 2) [mm] of what convex bodies around a convex ring (N, 2) may cover, counter-clockwise.

    The body contains no point of `bodies` (B, 2), nor one straight below those of `below`, or above those of `above`
    (n, 2), and stays within `edges`: left, right, bottom, top [mm]. The outline is found along rays from the ring's
    middle, with the corners between them; corners that change it by `within` [mm] at most are left out.
    """
    core = exported("convex_reach")
    if core is None:
        return _simplified(_plain_reach(ring, below, above, bodies, edges), within)
    ring, points = np.ascontiguousarray(ring), np.concatenate([below, above, bodies])
    walls, reached, room = (
        np.array(edges),
        np.empty((_MOST_RAYS, 2)),
        np.empty(_CONE * (len(points) + _WALLS)),
    )
    rays = core(
        at(ring), len(ring), at(points), len(below), len(above), len(bodies), at(walls), within, at(reached),
        at(room),
    )  # fmt: skip
    return reached[:rays]


def _plain_reach(
    ring: FloatArray,
    below: FloatArray,
    above: FloatArray,
    bodies: FloatArray,
    edges: tuple[float, float, float, float],
) -> FloatArray:
    """Return what `convex_reach` does before it is simplified, in NumPy."""
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
    turn = np.where(along < 0.0, np.where(across < 0.0, -2.0, 2.0) - turn, turn)
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
    theta = np.linspace(-np.pi, np.pi, RAYS, endpoint=False)
    _, active = _first_shut(theta, normals, gap)
    # Of the cones those count that stop a ray; without the others it is the larger.
    kept = np.unique(np.append(active // 2, np.arange(len(to), len(to) + len(walls))))
    normals, gap = normals[:, kept], gap[:, kept]
    tips = to[kept[kept < len(to)]]
    theta = np.sort(np.concatenate([theta, np.arctan2(tips[:, 1], tips[:, 0])]))
    radius, active = _first_shut(theta, normals, gap)
    # Where two lines bound what neighbouring rays reach, a corner is between, or several.
    for _ in range(ROUNDS):
        change = np.flatnonzero(active != np.roll(active, -1))
        now, then = active[change], np.roll(active, -1)[change]
        n, m = normals[now % 2, now // 2], normals[then % 2, then // 2]
        a, b = gap[now % 2, now // 2], gap[then % 2, then // 2]
        sign = np.sign(n[:, 0] * m[:, 1] - n[:, 1] * m[:, 0])
        corners = np.arctan2((n[:, 0] * b - m[:, 0] * a) * sign, (a * m[:, 1] - b * n[:, 1]) * sign)
        width = (np.roll(theta, -1)[change] - theta[change]) % (2.0 * np.pi)
        after = (corners - theta[change]) % (2.0 * np.pi)
        after = np.where((sign != 0.0) & (after > SAME) & (after < width - SAME), after, 0.5 * width)
        theta = np.unique(np.concatenate([theta, (theta[change] + after + np.pi) % (2.0 * np.pi) - np.pi]))
        radius, active = _first_shut(theta, normals, gap)
    # Of rays that one line stops, the outer ones.
    outer = (active != np.roll(active, 1)) | (active != np.roll(active, -1))
    return np.asarray(middle + (radius[:, None] * np.column_stack([np.cos(theta), np.sin(theta)]))[outer])


def _simplified(ring: FloatArray, within: float) -> FloatArray:
    """Return a ring without corners that change it by so much at most (Douglas and Peucker), the first one at last."""
    closed = np.concatenate([ring, ring[:1]])

    def kept(start: int, stop: int) -> list[int]:
        off = _distances(closed[start + 1 : stop], closed[start], closed[stop])
        if off.max(initial=within) <= within:
            return [start]
        at = start + 1 + int(off.argmax())
        return [*kept(start, at), *kept(at, stop)]

    found = ring[kept(0, len(ring))]
    needless = len(found) > 3 and _distances(found[:1], found[-1], found[1])[0] <= within
    return found[1:] if needless else found


def _distances(points: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """Return how far points (n, 2) lie from the line between two."""
    along = b - a
    size = float(along @ along)
    share = np.clip((points - a) @ along / size, 0.0, 1.0) if size > 0.0 else np.zeros(len(points))
    return np.asarray(np.hypot(*(points - a - share[:, None] * along).T))


def _first_shut(theta: FloatArray, normals: FloatArray, gap: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return how far rays at angles (D,) reach until both half planes of a cone hold them, and which one was last.

    Half planes n y >= gap, (2, P, 2) and (2, P); the last one of cone p counted as 2 p, or 2 p + 1.
    """
    speed = normals @ np.stack([np.cos(theta), np.sin(theta)])  # (2, P, D)
    with np.errstate(divide="ignore", invalid="ignore"):
        enters = np.where(speed > PARALLEL, gap[..., None] / speed, np.inf)
    both = enters.max(axis=0)
    cone = both.argmin(axis=0)
    rays = np.arange(len(theta))
    return both[cone, rays], 2 * cone + enters[:, cone, rays].argmax(axis=0)
