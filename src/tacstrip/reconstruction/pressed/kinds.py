"""Whether readings hold the kind of object that was given: a score test against bodies that it is a special case of.

A body may be bent along its x, so that a cylinder becomes a ring and a plane a cylinder; an edge or a cone may have
another angle. One slope tells by how much the best of them would explain a scan better, and how well such a scan tells
them apart at all: chi square sees a misfit only once it is as large as all noise together.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.reconstruction.pressed.descent import STEP, jacobian
from tacstrip.reconstruction.pressed.poses import TURNS, Poses

_SLANT = 0.25 * math.pi  # bends along two lines so far apart are all there are, next to a radius or a depth


@dataclass(frozen=True)
class Held:
    """What readings say of the kind: `gain`, what another body leaves less of -2 log likelihood, by one unknown more.

    `bend` is the standard deviation of how much the body is bent, per 10 mm; inf where it is of a kind that is not.
    """

    gain: float
    bend: float

    @classmethod
    def of(cls, poses: Poses, values: FloatArray, scale: float) -> Held:
        """Return it of parameters (P,) where a descent ends; `scale` is as of `draw`."""
        kind = poses.solid.kind
        others = [("bend", 0.0)] if kind in ("cylinder", "edge") else []
        others += [("bend", 0.0), ("bend", _SLANT)] if kind in ("plane", "sphere") else []
        others += [("opening", poses.solid.size[0])] if kind in ("edge", "cone") else []
        if not others:
            return cls(0.0, math.inf)
        left = poses.residuals(values[None])
        told = 2 * poses.readings + len(poses.touched)  # the rest is what is known beforehand
        known, left = jacobian(poses.residuals, values[None], left)[0, :told], left[0, :told]
        basis = np.linalg.svd(known, full_matrices=False)[0]
        gain, bends = 0.0, []
        for name, at in others:
            column = _slope(poses, values, name, at)[:told]
            column = column - basis @ (basis.T @ column)
            size = float(column @ column)
            gain = max(gain, float(column @ left) ** 2 / max(size, 1e-12))
            bends += [math.sqrt(scale / max(size, 1e-12))] * (name == "bend")
        return cls(gain, max(bends, default=math.inf))


def _slope(poses: Poses, values: FloatArray, name: str, at: float) -> FloatArray:
    """Return the residuals' slope (R,) where a body is bent along a line turned by `at`, or opened from an angle."""
    turns = (at,) if name == "bend" and poses.solid.kind not in TURNS else ()
    more = replace(poses, names=(*poses.names, name, *["turn_rad" for _ in turns]))
    start = 0.0 if name == "bend" else at
    still, moved = more.residuals(np.array([[*values, start + step, *turns] for step in (0.0, STEP)]))
    return np.asarray((moved - still) / STEP)
