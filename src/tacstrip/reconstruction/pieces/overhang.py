"""What may not be touched behind an overhang: strips read from the lowest to the highest place of contact.

Where an end jumps and one object explains it, one of its arms begins or ends beside another. Between both there may be
an opening along the strips' row, which no strip shows: each crosses both arms. It reaches no further than the other
arm's edge, lengthened over the strips that cross both; or there is none, and the jump is an edge along the strips.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tacstrip.reconstruction.pieces.chain import Cut, Stretch
from tacstrip.reconstruction.pieces.run import RunPieces

# Probability that an opening takes more of the outline than `ok` allows: of one that may take all of it, the power of
# the share that it may take, and at most; of several jumps one at most has such (`studies/overhang.py` fits them).
_OF_ALL, _POWER, _MOST = 1.7, 3.1, 0.9


@dataclass(frozen=True)
class Overhang:
    """The jump behind which most may not be touched.

    Attributes
    ----------
    rise
        By how much the end jumps [mm].
    share
        Of the outline, which is not touched at most.
    jumps
        Of both ends.
    """

    rise: float
    share: float
    jumps: int

    @property
    def probability(self) -> float:
        """Of so much that is not touched that the outline overlaps the true one by less than `ok` promises."""
        return min(_OF_ALL * math.pow(self.share, _POWER) / self.jumps, _MOST)


def widest_overhang(pieces: RunPieces) -> Overhang | None:
    """Return the jump of one object's ends behind which most may not be touched; None: no end jumps."""
    jumps = [
        (side, cut, before, after)
        for side, chain in enumerate(pieces.chains)
        for before, after in pairwise(chain.stretches)
        if (cut := after.before) is not None and cut.kind != "corner"
    ]
    if not jumps:
        return None
    share, rise = max(_opening(pieces, *jump) for jump in jumps)
    return Overhang(rise, share, len(jumps))


def _opening(pieces: RunPieces, side: int, cut: Cut, before: Stretch, after: Stretch) -> tuple[float, float]:
    """Return what share of an outline lies between an arm that begins or ends at a jump, and the other; the jump."""
    read = pieces.read
    low, high = (read.l, read.u) if side == 0 else (-read.u, -read.l)
    rise = float(abs(after.shown[0] - before.shown[-1]))
    behind, other = (
        (slice(cut.strip, None), before) if cut.kind == "begins" else (slice(cut.strip - 1, None, -1), after)
    )
    wide = np.minimum(other.at(read.x[behind]), high[behind]) - low[behind]
    opening = np.minimum(wide, rise)[np.cumsum(wide <= 0.0) == 0]  # no higher than at its mouth
    return float(opening.sum() / np.maximum(high - low, 0.0).sum()), rise
