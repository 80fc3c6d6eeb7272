"""How sure an outline is beside others that explain the readings about as well."""

from __future__ import annotations

import math

import numpy as np
import shapely
import shapely.affinity

from tacstrip.arrays import FloatArray
from tacstrip.core.rigid import RigidScans
from tacstrip.tracking.rigid.corners import (
    Fit,
    corners_cut,
    edges_and_turns,
    fitted,
    posed,
    reflex,
    settled,
)
from tacstrip.tracking.rigid.covariance import covariances, information, rigid_motions
from tacstrip.tracking.rigid.found import Found, carried
from tacstrip.tracking.rigid.offsets import with_offsets
from tacstrip.tracking.rigid.pose_spread import beyond_the_bound
from tacstrip.tracking.rigid.search import freer_spline

_STEPS, _SETTLED = 10, 3  # of each descent from a corner cut off, and how many of these are settled
_GAIN = 1.0  # of chi square, by an edge that is open: noise gives its two numbers two on average
# Of the extent, and radians: edges and corners that stand for themselves.
_CLEAR_EDGE, _CLEAR_TURN = 0.12, 0.26
_TURNS = ((math.pi, 73), (0.09, 19), (0.01, 11))  # radians, to either side, and how many: coarse to fine
_TURNED = 0.5  # radians: a rival is not another pose, but another corner called the first


def beside_rivals(scans: RigidScans, found: Found, shape: FloatArray, deviation: float) -> FloatArray:
    """Return the covariance (2 N, 2 N) [mm^2] of the fit's corners, `shape` where there are no rivals of as many.

    Strips read an outline at few places, so that its cost has kinks, and more than one best fit: the error is that of a
    mixture of normal distributions about these, each as likely as its criterion says. `deviation`: of offsets.
    """
    fit, total, summed = found.fit, 1.0, shape.copy()
    own = fit.corners - fit.corners.mean(axis=0)
    for rival, worse in found.rivals:
        if rival.corners.shape != own.shape or len(rival.poses) != len(fit.poses):
            continue
        first, turn, moved = onto(rival.corners, own)
        equations = information(scans, rival.corners, rival.poses)
        if deviation:
            equations = with_offsets(scans, rival, equations, deviation)
        theirs = covariances(equations, rival.corners, rival.poses, freer_spline(rival.basis))[0]
        order = np.roll(np.arange(own.size).reshape(-1, 2), first, axis=0).ravel()
        spin = np.kron(np.eye(len(own)), turn)
        theirs = spin @ theirs[np.ix_(order, order)] @ spin.T
        odds, off = math.exp(-0.5 * max(worse, 0.0)), (moved - own).ravel()
        total, summed = total + odds, summed + odds * (theirs + np.outer(off, off))
    motions = rigid_motions(own)  # moved and turned as a whole it is the same shape
    inner = np.eye(own.size) - motions @ np.linalg.pinv(motions)
    return np.asarray(inner @ summed @ inner.T / total)


def poses_beside_rivals(scans: RigidScans, found: Found, covariances: FloatArray) -> FloatArray:
    """Return covariances (T, 3, 3) of the fit's poses, `covariances` where the readings leave each but one place.

    Free poses with the spread of all that explain their scan, and about the poses of rivals, likewise of mixtures.
    """
    fit = found.fit
    every = covariances if fit.basis is not None else covariances + beyond_the_bound(scans, fit)
    own, middle = fit.corners - fit.corners.mean(axis=0), fit.corners.mean(axis=0)
    total, spread = 1.0, np.zeros_like(covariances)
    for rival, worse_by in found.rivals:
        if rival.corners.shape != own.shape or len(rival.poses) != len(fit.poses):
            continue
        turn = onto(rival.corners, own)[1]
        origin = rival.corners.mean(axis=0) - middle @ turn  # the fit's, in the rival's frame
        (x, y), cos, sin = origin, np.cos(rival.poses[:, 2]), np.sin(rival.poses[:, 2])
        there = rival.poses[:, :2] + np.column_stack([cos * x - sin * y, sin * x + cos * y])
        angle = rival.poses[:, 2] - math.atan2(turn[1, 0], turn[0, 0]) - fit.poses[:, 2]
        step = np.column_stack([there - fit.poses[:, :2], np.angle(np.exp(1j * angle))])
        if np.median(np.abs(step[:, 2])) > _TURNED:  # the same outline, turned onto itself
            continue
        likely = math.exp(-0.5 * max(worse_by, 0.0))
        total, spread = total + likely, spread + likely * _squares(step)
    return np.asarray(every + spread / total)


def with_a_corner_cut(scans: RigidScans, fit: Fit, least_mm: float) -> Fit | None:
    """Return the fit of an outline of which an edge cuts one corner off, if it explains the scans better; else None.

    Of clear corners, and off by so much. The criterion prefers fewer corners by far more than such an edge may
    gain where few readings meet it: it tells which outline is simpler, not that there is no edge.
    """
    tries = [fitted(scans, cut, fit.poses, _STEPS, basis=fit.basis) for cut in corners_cut(fit.corners)]
    size, own = float(np.ptp(fit.corners, axis=0).max()), shapely.Polygon(fit.corners).buffer(0)
    for near in sorted(tries, key=lambda f: f.cost)[:_SETTLED]:
        cut_off = settled(scans, near, 2)
        edges, turns = edges_and_turns(cut_off.corners)
        clear = edges.min() > _CLEAR_EDGE * size and turns.min() > _CLEAR_TURN
        if clear and cut_off.cost <= fit.cost - _GAIN:
            there = shapely.Polygon(carried(cut_off, fit.poses)).buffer(0)
            if there.hausdorff_distance(own) > least_mm:
                return cut_off
    return None


def notch_gain(scans: RigidScans, fit: Fit, far_mm: float) -> float:
    """Return the least that chi square grows by as a notch's corner moves on along one of its edges by so much.

    The poses follow. A strip reads an outline from its lowest to its highest place, so that a notch behind an overhang
    may go on at no cost; the bound at a corner that ends where that begins, beside a kink, does not know.
    """
    corners, least = fit.corners, math.inf
    for i in np.flatnonzero(reflex(corners)):
        for beside in (i - 1, (i + 1) % len(corners)):
            deeper, edge = corners.copy(), corners[i] - corners[beside]
            deeper[i] += edge * (far_mm / max(math.hypot(*edge), 1e-9))
            least = min(least, posed(scans, Fit(deeper, fit.poses, fit.costs)).cost - fit.cost)
    return least


def _squares(steps: FloatArray) -> FloatArray:
    return np.asarray(steps[..., :, None] * steps[..., None, :])


def onto(corners: FloatArray, to: FloatArray) -> tuple[int, FloatArray, FloatArray]:
    """Return by how many corners to roll an outline, and its turn (2, 2), so that it lies on another about its mean."""
    best, least = (0, np.eye(2), corners), math.inf
    for first in range(len(to)):
        a = np.roll(corners - corners.mean(axis=0), first, axis=0)
        angle = math.atan2((a[:, 0] * to[:, 1] - a[:, 1] * to[:, 0]).sum(), (a * to).sum())
        cos, sin = math.cos(angle), math.sin(angle)
        turn = np.array([[cos, -sin], [sin, cos]])
        far = float(((a @ turn.T - to) ** 2).sum())
        if far < least:
            best, least = (first, turn, a @ turn.T), far
    return best


def apart_mm(one: FloatArray, other: FloatArray) -> float:
    """Return how far two outlines (N, 2) and (M, 2) [mm] are from each other, laid on each other: Hausdorff's distance.

    About their centroids, at the turn where it is least.
    """
    own, fixed = (shapely.Polygon(o).buffer(0) for o in (one, other))
    centred = one - np.array(own.centroid.coords[0])
    fixed = shapely.affinity.translate(fixed, -fixed.centroid.x, -fixed.centroid.y)
    turn, least = 0.0, math.inf
    for reach, count in _TURNS:
        angles = turn + np.linspace(-reach, reach, count)
        cos, sin = np.cos(angles), np.sin(angles)
        turned = centred @ np.stack([np.stack([cos, sin], axis=1), np.stack([-sin, cos], axis=1)], axis=1)
        far = shapely.hausdorff_distance(shapely.polygons(turned), fixed)
        turn, least = float(angles[far.argmin()]), min(least, float(far.min()))
    return least
