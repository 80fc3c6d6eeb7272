"""Two convex objects beside each other, which share few strips or none: both l and u turn inwards where they meet.

On the strips that they share, one lies above the other; l of the contact changes from one object to the other at one
end of these, u at the other. One object that is narrow there, as an hourglass, has corners in place of jumps, which
few strips hardly tell.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product

from tacstrip.reconstruction.pieces.pair import (
    ChainFits,
    Chains,
    Ends,
    Pair,
    Places,
    at_any_angle,
    rises_beyond,
    shown,
)

_MOST_SHARED = 3  # strips
_NEAR = 3  # strips from an inward corner to where an object begins or ends
_FEWEST = 3  # strips of an object
# Log odds of two objects where both ends of a contact turn inwards at one place, fitted to drawn contacts, of which two
# objects are as common as a concave one: a constant, if both are seen to do so, and what log odds of the jumps tell.
_CONSTANT, _BY_JUMPS = 1.5, 0.5
_LEAST = 0.01  # probability, from which two objects are told


def pair_beside(ends: Ends, corners: Sequence[Sequence[int]], left_out: Sequence[int] = ()) -> Pair | None:
    """Return the likeliest two objects beside each other; None where no waist shows, or where they are hardly likely.

    Parameters
    ----------
    ends
        Of the run.
    corners
        Strips right of the inward corners of l, and of u, of the outline of one object.
    left_out
        Strips that this outline passes by: l or u may turn inwards there.
    """
    hidden = [strip + after for strip in left_out for after in (0, 1)]
    fits, best, found = (
        ChainFits(ends, [[*of, *hidden] for of in corners]),
        math.log(_LEAST / (1.0 - _LEAST)),
        None,
    )
    for cuts, told in sorted(_meetings(len(ends.x), corners, hidden).items()):
        both = _placed(len(ends.x), cuts)
        parts: Chains = ([], [])
        more = -fits.of_one(both)
        for (side, place), inside in product(enumerate(both), (True, False)):
            fitted, chi_square = fits.chain(side, *place, inside)
            parts[side].append(fitted)
            more += chi_square
        odds = told + _BY_JUMPS * (_of_jumps(ends, cuts, both, parts) - 0.5 * max(more, 0.0))
        if odds > best and (hulls := shown(ends, both, parts)) is not None:
            best, found = odds, (hulls, cuts)
    if found is None:
        return None
    hulls, (first, last) = found[0], sorted(found[1])
    meeting = float(ends.x[first - 1]), float(ends.x[last])
    return Pair(*hulls, 1.0 / (1.0 + math.exp(-best)), meeting_mm=meeting, shared=last - first)


def _meetings(
    n: int, corners: Sequence[Sequence[int]], hidden: Sequence[int]
) -> dict[tuple[int, int], float]:
    """Return strips before which l, and u, may change from one object to the other, and log odds of that."""
    of_l, of_u = ({at + off for at in of for off in range(-_NEAR, _NEAR + 1)} for of in corners)
    found = dict.fromkeys([*product(of_l, hidden), *product(hidden, of_u)], 0.0)
    found |= dict.fromkeys(product(of_l, of_u), _CONSTANT)
    return {
        cuts: told
        for cuts, told in found.items()
        if max(cuts) - min(cuts) <= _MOST_SHARED and min(cuts) >= _FEWEST and n - max(cuts) >= _FEWEST
    }


def _placed(n: int, cuts: tuple[int, int]) -> Places:
    """Return the strips of the lower and of the upper object: the left one is lower where l changes last."""
    of_l, of_u = cuts
    return ((0, of_l), (of_u, n)) if of_l >= of_u else ((of_l, n), (0, of_u))


def _of_jumps(ends: Ends, cuts: tuple[int, int], both: Places, parts: Chains) -> float:
    """Return the log odds of two objects to a concave one by how l and u change from one side to the other.

    One of two objects begins at any height beside the other. A corner of one object lies anywhere within a pitch, so
    that the end rises by anything between what the lines beside it say; else an edge of any direction joins them.
    """
    height, odds = float(ends.y[1].max() - ends.y[0].min()), 0.0
    for side, strip in enumerate(cuts):
        rises, run = rises_beyond(ends, side, strip, both[side], parts[side])
        if min(rises) < 0.0 < max(rises):
            density = 1.0 / math.hypot(max(rises) - min(rises), 0.5 * math.pi * run)
        else:
            density = at_any_angle(min(map(abs, rises)), run)
        odds -= math.log(density * height)
    return odds
