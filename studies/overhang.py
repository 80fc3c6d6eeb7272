"""What hides behind overhangs: how often it is more than `ok` allows, by what may hide.

Run: python -m studies.overhang [--cases 4000] [--seed 1]

Concave outlines of the hold-out (`shapes.CONCAVE`, `concave.FAMILIES`) by turns, both signatures on 12 to 40 strips,
noise of .1 to 1 %. Of those whose l or u jumps `widest_overhang` says what may hide at most; what does hide is known:
the outline filled along the strips reads alike. The two numbers of `Overhang.probability` are fitted to which hide more
than .2. The table's are fitted to the other families each, and what they say is held against what was.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import shapely
from scipy.optimize import minimize

from studies.holdout import cases, concave
from studies.holdout.score import RIGHT
from studies.holdout.shapes import CONCAVE, Array
from studies.options import of_cases
from tacstrip.arrays import BoolArray
from tacstrip.reconstruction.contact_ends import closed_ends
from tacstrip.reconstruction.pieces.overhang import widest_overhang
from tacstrip.reconstruction.pieces.run import split_run

_FAMILIES = (*CONCAVE, *concave.FAMILIES)
_STRIPS, _NOISE = (12, 41), (0.001, 0.01)
_LEAST, _MOST = 0.002, 0.9  # probability
_EDGES = (0.0, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0)  # of what the table's lines count


class Overhangs(NamedTuple):
    """Share that may hide, jumps, whether more hides than `ok` allows, and family, each (N,)."""

    share: Array
    jumps: Array
    hides: BoolArray
    family: npt.NDArray[np.str_]


def overhangs(count: int, seed: int) -> Overhangs:
    """Draw concave outlines, and keep those whose ends jump."""
    found = []
    for number in range(count):
        random, family = np.random.default_rng([seed, number]), _FAMILIES[number % len(_FAMILIES)]
        strips, half_width = int(cases.log_uniform(random, *_STRIPS)), cases.log_uniform(random, *_NOISE)
        case = cases.single(random, family, strips, ("kh", "kl"), half_width)
        unit, on = case.unit, np.isfinite(case.low)
        with np.errstate(divide="ignore", invalid="ignore"):
            l, u = closed_ends(unit.sensor, *unit.digitised(case.read)[:, on])
        if not np.isfinite(l + u).any():
            continue
        widest = widest_overhang(split_run(unit.sensor, unit.x[on], l, u, unit.sigma(case.half_width)))
        if widest is not None:
            outline = case.outlines[0]
            touched = shapely.Polygon(outline).area / shapely.Polygon(cases.filled(unit, outline)).area
            found.append((widest.share, widest.jumps, touched < RIGHT, family))
    share, jumps, hides, family_of = zip(*found, strict=True)
    return Overhangs(np.array(share), np.array(jumps, float), np.array(hides), np.array(family_of))


def probability(numbers: Array, share: Array, jumps: Array) -> Array:
    """Return what `Overhang.probability` says (N,) by a factor and a power."""
    return np.asarray(np.clip(numbers[0] * share ** numbers[1] / jumps, _LEAST, _MOST))


def fitted(drawn: Overhangs, which: BoolArray) -> Array:
    """Return the factor and the power that make what was likeliest."""
    share, jumps, hides = drawn.share[which], drawn.jumps[which], drawn.hides[which]

    def loss(numbers: Array) -> float:
        said = probability(numbers, share, jumps)
        return -float(np.log(np.where(hides, said, 1.0 - said)).mean())

    return np.asarray(minimize(loss, [1.0, 2.5], method="Nelder-Mead").x)


def table(count: int, seed: int) -> list[str]:
    """Return the numbers fitted to all, and how others' are calibrated: by what they say, and by family."""
    drawn = overhangs(count, seed)
    factor, power = fitted(drawn, np.ones_like(drawn.hides))
    said = np.zeros(len(drawn.share))
    for family in _FAMILIES:
        own = drawn.family == family
        said[own] = probability(fitted(drawn, ~own), drawn.share[own], drawn.jumps[own])
    lines = [
        f"{len(said)} of {count} outlines jump, {drawn.hides.sum()} hide more than {1.0 - RIGHT:.1f}: "
        f"factor {factor:.2f}, power {power:.2f}",
        f"{'by other families':24}{'cases':>7}{'said':>8}{'was':>8}",
    ]
    ranges = [(f"{low:.2f}-{high:.2f}", (low <= said) & (said < high)) for low, high in pairwise(_EDGES)]
    for name, some in (*ranges, *((family, drawn.family == family) for family in _FAMILIES)):
        if some.any():
            lines.append(f"{name:24}{some.sum():7}{said[some].mean():8.3f}{drawn.hides[some].mean():8.3f}")
    return lines


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table that the command line asks for."""
    asked = of_cases("studies.overhang", __doc__, 4000).parse_args(arguments)
    print("\n".join(table(asked.cases, asked.seed)))  # noqa: T201


if __name__ == "__main__":
    main()
