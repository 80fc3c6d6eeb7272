"""Concave shapes and pairs of objects that one signature cannot tell from a convex outline: the outline is looked for.

Run: python -m studies.convex_twins [--cases 200] [--seed 1]

Concave shapes and pairs of the hold-out, of k_h, k_l or k on 12 strips or more, noise of .05 to 1 %. Of each a convex
outline on the same strips is fitted twice: to the readings as drawn ("as near": its chi square is no more than the true
shape's own), and to the readings without noise, where its distance is all that the best test between the two has to go
by: at one deviation that is wrong in 31 of 100. The search is a local one, so that there may be more. Then what the
package trusts (`ok`) and is wrong: of those as near no rule can doubt one and trust the convex outline that reads so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely

import tacstrip as ts
from studies.holdout import cases
from studies.holdout.cases import Case
from studies.holdout.convexity import BestConvex, best_convex
from studies.holdout.score import CLAIMS, RIGHT, best_object, told_noise
from studies.holdout.shapes import CONCAVE, Array
from studies.options import of_cases
from tacstrip.reconstruction.posterior.assessment import Effort

ONE = ("kh", "kl", "k")
_STRIPS, _NOISE = (12, 61), (0.0005, 0.01)
_HEIGHTS = (1.0, 0.3, 0.6, 1.4)  # over the true ones, from which a search begins


@dataclass(frozen=True)
class Twin:
    """How a convex outline compares with what really touched.

    Attributes
    ----------
    kind, signature
        Of the contact.
    surplus
        Chi square of the readings with it, less that with the true shape.
    deviations
        Between the readings of both without noise: the root of the sum of squares over sigma^2.
    iou
        Of the twin of the readings without noise with the true shape.
    """

    kind: str
    signature: str
    surplus: float
    deviations: float
    iou: float


def drawn(random: np.random.Generator, kind: str) -> Case:
    """Return a concave shape of a kind, or a "pair" of convex ones, read by one signature."""
    name = str(random.choice(ONE))
    while True:
        strips, half_width = int(cases.log_uniform(random, *_STRIPS)), cases.log_uniform(random, *_NOISE)
        if kind != "pair":
            case = cases.single(random, kind, strips, (name,), half_width)
        else:
            case = cases.pair(random, strips, (name,), half_width)
        if case.strips >= _STRIPS[0]:
            return replace(case, unit=replace(case.unit, bits=None))


def twin(case: Case) -> Twin:
    """Look for the convex outline that reads most like a case."""
    unit, on, sigma = case.unit, np.isfinite(case.low), case.unit.sigma(case.half_width)
    clean = unit.read(case.low, case.high)
    own = float((((case.read - clean)[:, on] / sigma) ** 2).sum())
    of_readings, of_truth = (_nearest(case, read, sigma) for read in (case.read, clean))
    return Twin(
        case.group,
        unit.names[0],
        of_readings.chi_square - own,
        float(np.sqrt(of_truth.chi_square)),
        _iou(case, of_truth),
    )


def _nearest(case: Case, read: Array, sigma: float) -> BestConvex:
    middle, half = 0.5 * (case.low + case.high), 0.5 * (case.high - case.low)
    found = (best_convex(case.unit, read, sigma, middle - s * half, middle + s * half) for s in _HEIGHTS)
    return min(found, key=lambda f: f.chi_square)


def _iou(case: Case, found: BestConvex) -> float:
    x = case.unit.x[np.isfinite(case.low)]
    ends = np.concatenate([np.column_stack([x, end]) for end in (found.low, found.high)])
    return _overlap(case, shapely.MultiPoint(ends).convex_hull)


def _overlap(case: Case, outline: shapely.Geometry) -> float:
    truth = shapely.union_all([shapely.Polygon(o) for o in case.outlines])
    return float(outline.intersection(truth).area / outline.union(truth).area)


def trusted_and_wrong(case: Case, effort: Effort) -> bool:
    """Whether the package trusts an outline of it that is wrong."""
    result = ts.fit_polygon(case.unit.scan(case.read), case.unit.sensor, told_noise(case), assessment=effort)
    iou, found = best_object(case.unit, result, case.outlines[0])
    if found is None or found.status not in CLAIMS:
        return False
    if case.group == "pair":  # an outline of both would be no wrong one
        iou = max(iou, _overlap(case, shapely.Polygon(found.vertices)))
    return iou < RIGHT


def table(count: int, seed: int, effort: Effort = "thorough") -> list[str]:
    """Return how many have a convex twin, by kind, and how many of those that are trusted and wrong."""
    kinds, found = (*CONCAVE, "pair"), []
    for number in range(count):
        case = drawn(np.random.default_rng([seed, number]), kinds[number % len(kinds)])
        found.append((twin(case), trusted_and_wrong(case, effort)))
    heads = ("cases", "as near", "within 1 deviation", "IoU < .8", "ok, wrong", "as near")
    lines = [f"{'':10}" + "".join(f"  {h}" for h in heads)]
    for title, some in (
        *((kind, [f for f in found if f[0].kind == kind]) for kind in kinds),
        *((name, [f for f in found if f[0].signature == name]) for name in ONE),
        ("all", found),
    ):
        alike = [t for t, _ in some if t.deviations <= 1.0]
        wrong = [t for t, wrong in some if wrong]
        numbers = (
            len(some),
            sum(t.surplus <= 0.0 for t, _ in some),
            len(alike),
            sum(t.iou < RIGHT for t in alike),
            len(wrong),
            sum(t.surplus <= 0.0 for t in wrong),
        )
        lines.append(f"{title:10}" + "".join(f"  {n:{len(h)}}" for h, n in zip(heads, numbers, strict=True)))
    return lines


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table that the command line asks for."""
    parser = of_cases("studies.convex_twins", __doc__, 200)
    parser.add_argument("--assessment", default="thorough", choices=("thorough", "fast"))
    asked = parser.parse_args(arguments)
    print("\n".join(table(asked.cases, asked.seed, asked.assessment)))  # noqa: T201


if __name__ == "__main__":
    main()
