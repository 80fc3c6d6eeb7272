"""A first outline within the band, or the knowledge that there is none: branch and bound over the kinks' places."""

from __future__ import annotations

from tacstrip.arrays import FloatArray
from tacstrip.core.polytope import feasible_part, minimax
from tacstrip.reconstruction.set_membership.edge_lines import EdgeLines, ReadingBounds
from tacstrip.reconstruction.set_membership.feasible_set import FeasibleSet, feasible_set

_PARTS = 16  # looked at, at most
_DESCENTS = 8  # rounds of one
_SCALE = 0.01  # of the strip length: far outside


class Effort:
    """How much searching is left, counted in work and not in time: the same on every computer.

    A linear program of P heights takes P^2 of it; a set of n strips to be written down P n / 8.
    """

    def __init__(self, left: float) -> None:
        self.left = left

    def spend(self, work: float) -> bool:
        """Take what a step costs, and say whether there was as much left."""
        self.left -= work
        return self.left >= 0.0


def feasible_point(
    whole: FeasibleSet,
    band: ReadingBounds,
    lines: EdgeLines,
    widths: FloatArray,
    start: FloatArray,
    effort: Effort,
) -> tuple[FloatArray, FloatArray] | None:
    """Return the analytic centre (P,) of a convex part of the set, and the barrier's curvature there (P, P).

    None where there is no such outline, or none was found in 16 parts or with the effort. The set is not convex: where
    the outlines that all bounds but the pairs allow are not enough to tell, the widest zone is halved.

    Parameters
    ----------
    whole
        The set.
    band, lines, widths
        What it was made of: as for `feasible_set`.
    start
        Heights (P,) near the set.
    effort
        What may be spent; it is less afterwards.
    """
    scale, size = _SCALE * band.sensor.length_mm, len(start)
    zones = [whole.zones[: len(lines.turns)]]
    for number in range(_PARTS):
        if not zones or not effort.spend(size**2 + number * size * len(band.x) / 8):
            return None
        part = zones.pop(0)
        bounds = whole if number == 0 else feasible_set(band, lines, part, widths)
        middle, worst, _ = minimax(bounds.a, bounds.b, start, scale)
        if worst >= 0.0:
            continue
        for at in (start, middle):
            found = _descend(bounds, at, scale, effort)
            if found is not None:
                return found
        kinked = ((part[:, :1] < band.x) & (band.x < part[:, 1:])).sum(axis=1)
        if kinked.max(initial=0) > 0:
            for end in (1, 0):  # the widest zone's lower half, then its upper one
                zones.append(part.copy())
                zones[-1][kinked.argmax(), end] = part[kinked.argmax()].mean()
    return None


def _descend(
    bounds: FeasibleSet, at: FloatArray, scale: float, effort: Effort
) -> tuple[FloatArray, FloatArray] | None:
    """Look from a point for a convex part that has an inside, with what effort is left."""
    work = len(at) ** 2
    most = min(_DESCENTS, int(effort.left // work))
    if most < 1:
        return None
    found, rounds = feasible_part((bounds.a, bounds.b), (bounds.either_a, bounds.either_b), at, scale, most)
    effort.spend(rounds * work)
    return found
