"""How large a corner more may be that the readings do not show."""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.core.binding import RIGID_CORNERS
from tacstrip.core.rigid import RigidScans
from tacstrip.tracking.rigid.corners import Fit, edges_and_turns
from tacstrip.tracking.rigid.covariance import information, of_numbers, without_poses
from tacstrip.tracking.rigid.offsets import with_offsets

_SHARES = 6  # of an edge: places of the corner more, but for the ends
_DEVIATIONS = 2.0
_FOLLOW = 1e-10  # eigenvalue over the largest: below, the readings do not hold what is to follow


def unseen_corner_mm(scans: RigidScans, fit: Fit, deviation: float = 0.0, wider: float = 1.0) -> FloatArray:
    """Return for each edge how far one corner more may stand out of it, or be cut off at its ends, unseen (N,) [mm].

    At two standard deviations, from the bound of its height over its two neighbours at places along the edge, where
    corners, poses and channels' offsets of some `deviation` [Vref] follow. Beyond the places that strips read there is
    a tip that may be cut off, to its depth. The corner lies over no strip that is not touched, and leaves a convex
    outline one: it is no farther out than where the edges beside meet. `wider`: times the readings' own uncertainty.
    """
    corners, after = fit.corners, np.roll(fit.corners, -1, axis=0) - fit.corners
    count = len(corners)
    places = max(1, min(_SHARES, RIGID_CORNERS // count - 1))
    shares = np.arange(1, places + 1) / (places + 1)
    nodes = np.concatenate([[0.0], shares])
    every = (corners[:, None] + nodes[:, None] * after[:, None]).reshape(-1, 2)
    laid = Fit(every, fit.poses, fit.costs, fit.basis)
    found = information(scans, every, fit.poses)
    if deviation:
        found = with_offsets(scans, laid, found, deviation)
    matrix, slope, _, _ = without_poses(of_numbers(found, _hats(after, nodes)), fit.basis)
    height = np.arange(2 * count, 2 * count + count * places)
    rest = np.delete(np.arange(len(matrix)), height)
    follow = np.linalg.pinv(matrix[np.ix_(rest, rest)], rcond=_FOLLOW, hermitian=True)
    across = matrix[np.ix_(height, rest)] @ follow
    known = matrix[height, height] - (across * matrix[np.ix_(height, rest)]).sum(axis=1)
    asked = slope[height] - across @ slope[rest]
    known = np.maximum(known, 1e-12)
    begins, ends = read_from(scans, fit)
    place = np.tile(shares, (count, 1))
    seen = (place >= begins[:, None]) & (place <= 1.0 - ends[:, None])
    high = np.abs(asked / known) + _DEVIATIONS * wider / np.sqrt(known)
    # A scan's pose is known about as its readings are.
    one = _DEVIATIONS * wider * scans.sigma * scans.sensor.length_mm
    high = np.minimum(high.reshape(count, places), _short_of_untouched(scans, fit, shares) + one)
    high = np.minimum(np.where(seen, high, 0.0).max(axis=1), _farthest_out(corners))
    tips = unread_tips_mm(scans, fit)
    return np.asarray(np.maximum(high, np.maximum(tips, np.roll(tips, -1))))


def _short_of_untouched(scans: RigidScans, fit: Fit, shares: FloatArray) -> FloatArray:
    """Return how far out of places of edges the first strip is that some scan does not touch (N, P) [mm]."""
    after = np.roll(fit.corners, -1, axis=0) - fit.corners
    touched, x_mm = np.asarray(np.isfinite(scans.k).any(axis=1)), scans.x_mm
    first, last = touched.argmax(axis=1), touched.shape[1] - 1 - touched[:, ::-1].argmax(axis=1)
    right = (x_mm[last] + scans.gaps_mm[1, last])[:, None, None]
    left = (x_mm[first] - scans.gaps_mm[0, first])[:, None, None]
    cos, sin = np.cos(fit.poses[:, 2]), np.sin(fit.poses[:, 2])
    point = fit.corners[:, None] + shares[:, None] * after[:, None]  # (N, P, 2)
    x = fit.poses[:, 0, None, None] + cos[:, None, None] * point[..., 0] - sin[:, None, None] * point[..., 1]
    # Of the way out of each edge, in x (T, N).
    out = (np.outer(cos, after[:, 1]) + np.outer(sin, after[:, 0])) / np.hypot(*after.T)
    room = np.where(out[..., None] > 0.0, right - x, x - left) / np.maximum(np.abs(out), 1e-9)[..., None]
    return np.asarray(np.maximum(room.min(axis=0), 0.0))


def _farthest_out(corners: FloatArray) -> FloatArray:
    """Return how far out of each edge the edges beside it meet (N,) [mm]; where they do not, the outline's extent."""
    length, turn = edges_and_turns(corners)
    after, extent = np.roll(turn, -1), float(np.ptp(corners, axis=0).max())
    meet = (turn > 0.0) & (after > 0.0) & (turn + after < np.pi)
    out = length * np.sin(turn) * np.sin(after) / np.where(meet, np.sin(turn + after), 1.0)
    return np.asarray(np.minimum(np.where(meet, out, extent), extent))


def _hats(after: FloatArray, nodes: FloatArray) -> FloatArray:
    """Return how nodes on all edges (N M, 2) follow corners and heights: (2 N M, 2 N + N (M - 1))."""
    count, many = len(after), len(nodes)
    outside = np.stack([after[:, 1], -after[:, 0]], axis=1) / np.maximum(np.hypot(*after.T), 1e-9)[:, None]
    by = np.zeros((count, many, 2, 2 * count + count * (many - 1)))
    for i in range(count):
        for axis in (0, 1):
            by[i, :, axis, 2 * i + axis] = 1.0 - nodes
            by[i, :, axis, 2 * ((i + 1) % count) + axis] = nodes
        for k, peak in enumerate(nodes[1:]):
            hat = np.minimum(nodes / peak, (1.0 - nodes) / (1.0 - peak))
            by[i, :, :, 2 * count + i * (many - 1) + k] = hat[:, None] * outside[i]
    return by.reshape(2 * count * many, -1)


def unread_tips_mm(scans: RigidScans, fit: Fit) -> FloatArray:
    """Return how much of each corner no strip reads in any scan (N,) [mm]; it may be cut off there.

    That is from the corner to the line between the places on its edges that are read nearest to it.
    """
    begins, ends = read_from(scans, fit)
    after = np.roll(fit.corners, -1, axis=0) - fit.corners
    one, other = begins[:, None] * after, np.roll(-ends[:, None] * after, 1, axis=0)  # from each corner
    across = one - other
    twice = np.abs(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0])
    return np.asarray(twice / np.maximum(np.hypot(*across.T), 1e-9))


def read_from(scans: RigidScans, fit: Fit) -> tuple[FloatArray, FloatArray]:
    """Return the shares of edges (N,) that no strip reads in any scan at their beginning, and at their end."""
    x = (
        fit.poses[:, :1]
        + np.cos(fit.poses[:, 2:]) * fit.corners[:, 0]
        - np.sin(fit.poses[:, 2:]) * fit.corners[:, 1]
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (scans.x_mm - x[..., None]) / (np.roll(x, -1, axis=1) - x)[..., None]  # of an edge (T, N, n)
    touched: BoolArray = np.asarray(np.isfinite(scans.k).any(axis=1))
    read = touched[:, None] & (share >= 0.0) & (share <= 1.0)
    begins, ends = (np.where(read, s, 1.0).min(axis=(0, 2)) for s in (share, 1.0 - share))
    return begins, ends
