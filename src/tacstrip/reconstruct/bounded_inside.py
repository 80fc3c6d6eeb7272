"""A first outline within the band, or the knowledge that there is none: branch and bound over the kinks' places."""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.reconstruct.bounded_centre import centre, interior
from tacstrip.reconstruct.bounded_lines import Band, Lines
from tacstrip.reconstruct.bounded_set import FeasibleSet, feasible_set

_MOST = 40  # parts looked at
_SCALE = 0.01  # of the strip length: far outside


def inside(
    band: Band, lines: Lines, zones: FloatArray, widths: FloatArray, start: FloatArray
) -> tuple[FloatArray, FloatArray] | None:
    """Return the analytic centre (P,) of a convex part of the set, and the barrier's curvature there (P, P).

    None where there is no such outline, or none was found in 40 parts. The set is not convex: where the outlines
    that all bounds but the pairs allow are not enough to tell, the widest zone is halved.

    Parameters
    ----------
    band, lines, zones, widths
        As for `feasible_set`.
    start
        Heights (P,) near the set.
    """
    scale = _SCALE * band.sensor.length_mm
    parts = [zones]
    for _ in range(_MOST):
        if not parts:
            return None
        part = parts.pop(0)
        bounds = feasible_set(band, lines, part, widths)
        middle, worst, _ = interior(bounds.a, bounds.b, start, scale)
        if worst >= 0.0:
            continue
        for at in (start, middle):
            found = _descend(bounds, at, scale)
            if found is not None:
                return found
        kinked = ((part[:, :1] < band.x) & (band.x < part[:, 1:])).sum(axis=1)
        if kinked.max(initial=0) > 0:
            parts += _halves(part, int(kinked.argmax()))
    return None


def _descend(bounds: FeasibleSet, at: FloatArray, scale: float) -> tuple[FloatArray, FloatArray] | None:
    """Keep of each pair the row that is met best, find the least violation, and again: it falls until it is 0 or stuck."""
    before = np.full(len(bounds.either_b), -1)
    while True:
        kept = (bounds.either_a @ at - bounds.either_b).argmin(axis=1)
        if len(kept) and np.array_equal(kept, before):
            return None
        a, b = bounds.part(kept)
        at, worst, _ = interior(a, b, at, scale)
        if worst < 0.0:
            return centre(a, b, at)
        if not len(kept):
            return None
        before = kept


def _halves(zones: FloatArray, kink: int) -> list[FloatArray]:
    middle = zones[kink].mean()
    lower, upper = zones.copy(), zones.copy()
    lower[kink, 1] = upper[kink, 0] = middle
    return [lower, upper]
