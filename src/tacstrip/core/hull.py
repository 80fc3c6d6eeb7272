"""Several rigid outlines on the same strips: least squares for all corners, and for all poses in each scan.

A strip reads from the lowest to the highest point of all outlines that it crosses. Compiled only: NumPy would take
minutes for what is over in a second.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.core.binding import HULL_OBJECTS, Loss, at, exported
from tacstrip.core.rigid import Equations, RigidScans

MOST_OBJECTS = HULL_OBJECTS


def available() -> bool:
    """Whether the compiled core is there."""
    return exported("hull_equations") is not None


@dataclass(frozen=True, eq=False)
class HullScans:
    """Readings of several objects.

    Attributes
    ----------
    scans
        Readings, NaN where there is none.
    known
        1 where a strip without readings is one that nothing touches, 0 where it may be anything (T, n).
    """

    scans: RigidScans
    known: FloatArray

    def of(self, scans: Sequence[int] | IntArray | slice) -> HullScans:
        """Return some of the scans."""
        return HullScans(self.scans.of(scans), self.known[scans])

    def with_sigma(self, sigma: float) -> HullScans:
        """Return the same readings, taken for as uncertain as that."""
        return replace(self, scans=self.scans.with_sigma(sigma))


def hull_equations(
    scans: HullScans, outlines: Sequence[FloatArray], poses: FloatArray, present: BoolArray, how: Loss
) -> Equations:
    """Return the normal equations of outlines (N_k, 2) [mm] at poses (T, K, 3), where present (T, K)."""
    core = exported("hull_equations")
    assert core is not None, "compiled only"
    assert len(outlines) <= MOST_OBJECTS
    corners, counts = _joined(outlines)
    many, width, size = len(poses), 3 * len(outlines), corners.size
    shapes = ((many, width, width), (many, width, size), (size, size), (many, width), (size,), (many,))
    found = Equations(*(np.empty(shape) for shape in shapes))
    poses, present, known = (np.ascontiguousarray(a, dtype=float) for a in (poses, present, scans.known))
    core(
        scans.scans.compiled, how, at(known), len(counts), at(counts), at(corners), at(present), at(poses),
        *map(at, vars(found).values()),
    )  # fmt: skip
    return found


def fit_hull_poses(
    scans: HullScans,
    outlines: Sequence[FloatArray],
    starts: FloatArray,
    expected: FloatArray,
    weight: FloatArray,
    how: Loss,
    steps: int = 12,
) -> tuple[FloatArray, FloatArray]:
    """Return where descents from poses (T, M, K, 3) end, each scan and start by itself, and their costs (T, M).

    The cost includes (pose - expected)^2 weight, both broadcast to the starts.
    """
    core = exported("hull_poses")
    assert core is not None, "compiled only"
    assert len(outlines) <= MOST_OBJECTS
    corners, counts = _joined(outlines)
    poses, costs = np.array(starts, dtype=float, order="C"), np.empty(starts.shape[:2])
    expected, weight = (
        np.array(np.broadcast_to(a, starts.shape), dtype=float, order="C") for a in (expected, weight)
    )
    known = np.ascontiguousarray(scans.known)
    core(
        scans.scans.compiled, how, at(known), len(counts), at(counts), at(corners), at(poses), at(expected),
        at(weight), poses.shape[1], steps, at(costs),
    )  # fmt: skip
    return poses, costs


def _joined(outlines: Sequence[FloatArray]) -> tuple[FloatArray, IntArray]:
    counts = np.array([len(o) for o in outlines], dtype=np.int64)
    return np.concatenate(outlines), counts
