"""How sure an outline is beside others that explain the readings about as well."""

from __future__ import annotations

import math

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.core.rigid import RigidScans
from tacstrip.tracking.rigid.covariance import covariances, information, rigid_motions
from tacstrip.tracking.rigid.offsets import with_offsets
from tacstrip.tracking.rigid.search import Found


def beside_rivals(scans: RigidScans, found: Found, shape: FloatArray, deviation: float) -> FloatArray:
    """Return the covariance (2 N, 2 N) [mm^2] of the fit's corners, `shape` where there are no rivals of as many.

    Strips read an outline at few places, so that its cost has kinks, and more than one best fit: the error is that of a
    mixture of normal distributions about these, each as likely as its criterion says. `deviation`: of offsets.
    """
    fit, total, summed = found.fit, 1.0, shape.copy()
    own = fit.corners - fit.corners.mean(axis=0)
    for rival, worse in found.rivals:
        if rival.corners.shape != own.shape or len(rival.poses) != len(fit.poses) or rival.basis is not None:
            continue
        first, turn, moved = _onto(rival.corners, own)
        equations = information(scans, rival.corners, rival.poses)
        if deviation:
            equations = with_offsets(scans, rival, equations, deviation)
        theirs = covariances(equations, rival.corners, rival.poses)[0]
        order = np.roll(np.arange(own.size).reshape(-1, 2), first, axis=0).ravel()
        spin = np.kron(np.eye(len(own)), turn)
        theirs = spin @ theirs[np.ix_(order, order)] @ spin.T
        odds, off = math.exp(-0.5 * max(worse, 0.0)), (moved - own).ravel()
        total, summed = total + odds, summed + odds * (theirs + np.outer(off, off))
    motions = rigid_motions(own)  # moved and turned as a whole it is the same shape
    inner = np.eye(own.size) - motions @ np.linalg.pinv(motions)
    return np.asarray(inner @ summed @ inner.T / total)


def _onto(corners: FloatArray, to: FloatArray) -> tuple[int, FloatArray, FloatArray]:
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
