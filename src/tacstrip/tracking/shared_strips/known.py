"""What is known of objects that share strips: from scans alone, and what the others add."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tacstrip.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class Alone:
    """What is known of an object from scans in which it is alone.

    Attributes
    ----------
    corners
        Its outline (N, 2) [mm], in a frame of its own.
    scans
        Numbers of these scans, ascending.
    poses
        In these (M, 3).
    readings
        Its own (M, S, n), NaN elsewhere.
    rivals
        Other outlines that explain these about as well, each in a frame of its own, and their poses (M, 3): those most
        unlike first.
    """

    corners: FloatArray
    scans: list[int]
    poses: FloatArray
    readings: FloatArray
    rivals: tuple[tuple[FloatArray, FloatArray], ...] = ()


@dataclass(frozen=True, eq=False)
class Shared:
    """What scans together with others add.

    Attributes
    ----------
    corners
        As `Alone.corners`, better known.
    again
        Numbers of scans alone whose poses were fitted along, and these (M, 3).
    scans, poses, covariances
        Numbers of scans that show it with others about, its poses there (J, 3) and their covariances (J, 3, 3).
    joint
        Those in which it shares strips with one of them.
    rivals
        Those of `Alone.rivals` that explain all scans as well, fitted to them, and how much worse their criterion is.
    advice
        What is doubtful there; empty when all is well.
    """

    corners: FloatArray
    again: dict[int, FloatArray]
    scans: list[int] = field(default_factory=list)
    poses: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    covariances: FloatArray = field(default_factory=lambda: np.empty((0, 3, 3)))
    joint: tuple[int, ...] = ()
    rivals: tuple[tuple[FloatArray, float], ...] = ()
    advice: str = ""
