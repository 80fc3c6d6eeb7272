"""A first outline within the band, or the knowledge that there is none: branch and bound over the kinks' places."""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.reconstruct.bounded_centre import centre, interior
from tacstrip.reconstruct.bounded_lines import Band, Lines
from tacstrip.reconstruct.bounded_set import FeasibleSet, feasible_set

_MOST = 16  # parts looked at
_GAIN = 1e-4  # of the scale: a fall by less is none
_SCALE = 0.01  # of the strip length: far outside


def inside(
    whole: FeasibleSet, band: Band, lines: Lines, widths: FloatArray, start: FloatArray
) -> tuple[FloatArray, FloatArray] | None:
    """Return the analytic centre (P,) of a convex part of the set, and the barrier's curvature there (P, P).

    None where there is no such outline, or none was found in 16 parts. The set is not convex: where the outlines
    that all bounds but the pairs allow are not enough to tell, the widest zone is halved.

    Parameters
    ----------
    whole
        The set.
    band, lines, widths
        What it was made of: as for `feasible_set`.
    start
        Heights (P,) near the set.
    """
    scale = _SCALE * band.sensor.length_mm
    zones = [whole.zones[: len(lines.turns)]]
    for number in range(_MOST):
        if not zones:
            return None
        part = zones.pop(0)
        bounds = whole if number == 0 else feasible_set(band, lines, part, widths)
        middle, worst, _ = interior(bounds.a, bounds.b, start, scale)
        if worst >= 0.0:
            continue
        for at in (start, middle):
            found = _descend(bounds, at, scale)
            if found is not None:
                return found
        kinked = ((part[:, :1] < band.x) & (band.x < part[:, 1:])).sum(axis=1)
        if kinked.max(initial=0) > 0:
            zones += _halves(part, int(kinked.argmax()))
    return None


def _descend(bounds: FeasibleSet, at: FloatArray, scale: float) -> tuple[FloatArray, FloatArray] | None:
    """Keep of each pair the row that is met best, find the least violation, and so on while it falls."""
    before = np.inf
    for _ in range(_MOST):
        kept = (bounds.either_a @ at - bounds.either_b).argmin(axis=1)
        a, b = bounds.part(kept)
        at, worst, _ = interior(a, b, at, scale)
        if worst < 0.0:
            return centre(a, b, at)
        if not len(kept) or not worst <= before - _GAIN * scale:  # NaN too
            return None
        before = worst
    return None


def _halves(zones: FloatArray, kink: int) -> list[FloatArray]:
    middle = zones[kink].mean()
    lower, upper = zones.copy(), zones.copy()
    lower[kink, 1] = upper[kink, 0] = middle
    return [lower, upper]
