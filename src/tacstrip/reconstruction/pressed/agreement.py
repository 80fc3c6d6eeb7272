"""Whether an object in its pose explains a scan: chi square of the readings, and which strips it touches."""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.reconstruction.polygon.chi_square import ALARM
from tacstrip.reconstruction.polygon.goodness_of_fit import chi_square_score
from tacstrip.reconstruction.pressed.poses import TOUCH_MM, Poses

_BELIEF = 8.0  # readings that the noise given counts for, against what is left over
RIVAL = 4.0  # chi square by which another pose is no rival
LOST_MM = 0.1  # depth by which touch and silence may contradict the object


def noise_scale(squares: float, freedom: int, unknown: bool) -> float:
    """Return by what the readings' variance is larger than given, from squares left over and degrees of freedom."""
    if unknown and freedom >= 3:  # sigma is what is left over
        return max(squares / freedom, 1e-6)
    # Strips, skin and object are never quite those of the model: what they leave over counts as noise.
    return max(1.0, (_BELIEF + squares) / (_BELIEF + max(freedom, 0)))


def explains(poses: Poses, values: FloatArray) -> bool:
    """Whether an object (1, P) touches the strips that read and no others, and chi square is one of the noise."""
    return contradiction(poses, values) <= LOST_MM and in_noise(poses, values)


def in_noise(poses: Poses, values: FloatArray) -> bool:
    """Whether chi square of an object (1, P) is one of the noise; True where that is not known, or nothing is left."""
    left, freedom = poses.residuals(values)[0][: poses.readings], poses.readings - len(poses.names)
    # By normal noise also where it is uniform, whose squares spread less: the model is not exact enough for that.
    return poses.noise is None or freedom < 1 or chi_square_score(left, freedom, "normal") <= ALARM


def contradiction(poses: Poses, values: FloatArray) -> float:
    """Return the most depth [mm] that strips touched or silent lack or have too much."""
    deepest = poses.ends(values, TOUCH_MM)[2][0]
    return float(np.where(poses.touched, -deepest, np.where(poses.silent, deepest, 0.0)).max())
