"""Concave shapes: what is doubted as several objects, or `ok` and wrong, for another shape reads alike.

Run: python -m studies.several_limit [--cases 200] [--seed 1]

Concave shapes of the hold-out on 12 strips or more, both signatures, noise of .2 to 2 %, told or not. Of those that are
doubted the likeliest pair of convex objects is looked for, with every strip (of more than 36: those near inward
corners) as a place where one may begin or end, and moved by least squares. Where its own readings are as near to what
was read as the true shape's, "two explain"; "and apart" counts those that are .02 of L apart, as all pairs of the
hold-out are. "As one" are doubted though told to be one object. Nothing in the readings can tell where the outline is
`ok` and wrong: each strip reads from the lowest place of contact to the highest, and the shape filled so reads alike to
the last bit; if it overlaps the true one by less than `ok` promises, gaps that open across the strips hide too much
("filled alike"). Else a convex outline may explain the readings ("convex explains").
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from functools import partial

import numpy as np
import shapely
from scipy.optimize import least_squares
from scipy.special import chdtri  # scipy.stats takes half a second to import

import tacstrip as ts
from studies.holdout import cases
from studies.holdout.cases import Case
from studies.holdout.convexity import best_convex
from studies.holdout.score import LEAST_P, RIGHT, SEVERAL, best_object, overlap, told_noise
from studies.holdout.shapes import CONCAVE, Array
from studies.options import of_cases
from tacstrip.reconstruction.contact_ends import closed_ends, end_deviations
from tacstrip.reconstruction.pieces.pair import Ends, likeliest_pair
from tacstrip.reconstruction.pieces.run import GAP

_STRIPS, _NOISE = (12, 101), (0.002, 0.02)
_ALL, _NEAR = 36, 3  # strips: of more, places within so many of an inward corner
_AS_WELL = 9.0  # of chi square beyond the truth's
_MISSED, _STEP, _ROUNDS = 30.0, 1e-4, 12  # deviations of a strip not touched; over L; of least squares
_OVERLAP = 0.01  # of the smaller one's area: apart but for noise
_COLUMNS = 400  # of a filled outline
_SAME = 1e-9  # of L: of second differences of straight edges


def explaining(case: Case) -> list[Array] | None:
    """Return two convex objects whose readings are as near to a case's as its true shape's; None: none found."""
    unit, on = case.unit, np.isfinite(case.low)
    read, sigma = unit.digitised(case.read)[:, on], unit.sigma(case.half_width)
    low, high = case.low[on], case.high[on]
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.stack(closed_ends(unit.sensor, *read))
    known = np.isfinite(ends).all(axis=0)
    deviations = np.stack(end_deviations(unit.sensor, low, high, sigma))
    corners = [_inward(chain[known], _SAME * unit.length) for chain in (low, -high)]
    strips = range(1, int(known.sum()))
    places = [
        [i for i in strips if len(strips) < _ALL or any(abs(i - c) <= _NEAR for c in (1, strips[-1], *at))]
        for at in corners
    ]
    run = Ends(unit.x[on][known], ends[:, known], deviations[:, known], unit.pitch)
    pair = likeliest_pair(run, places, corners)
    if pair is None:
        return None
    whole = float((((unit.read(low, high) - read) / sigma) ** 2).sum())
    enough = min(whole + _AS_WELL, float(chdtri(read.size, LEAST_P)))
    outlines, start = [pair.lower, pair.upper], np.concatenate([pair.lower, pair.upper])
    cut = len(pair.lower)

    def hulls(points: Array) -> list[Array]:
        return [_hull(points.reshape(-1, 2)[part]) for part in (slice(None, cut), slice(cut, None))]

    def residuals(points: Array) -> Array:
        off = unit.read(*(end[on] for end in unit.touched(hulls(points)))) - read
        return np.asarray(np.nan_to_num(off / sigma, nan=_MISSED).ravel())

    if float((residuals(start.ravel()) ** 2).sum()) > enough:  # chains were fitted each by itself
        step = _STEP * unit.length / np.maximum(np.abs(start.ravel()), _STEP)
        outlines = hulls(least_squares(residuals, start.ravel(), diff_step=step, max_nfev=_ROUNDS).x)
    off = (unit.read(*(end[on] for end in unit.touched(outlines))) - read) / sigma
    apart = shapely.Polygon(outlines[0]).intersection(shapely.Polygon(outlines[1])).area < _OVERLAP * min(
        shapely.Polygon(outline).area for outline in outlines
    )
    return outlines if apart and float((off**2).sum()) <= enough else None


def filled(outline: Array) -> Array:
    """Return an outline filled along the strips, from its lowest to its highest place at every x: it reads alike."""
    polygon = shapely.Polygon(outline)
    left, low, right, high = polygon.bounds
    x = np.linspace(left, right, _COLUMNS + 2)[1:-1]
    lines = shapely.linestrings([[(at, low - 1.0), (at, high + 1.0)] for at in x])
    ends = shapely.bounds(shapely.intersection(polygon, lines))
    return np.vstack([ends[:, :2], np.column_stack([x, ends[:, 3]])[::-1]])


def why_wrong(case: Case) -> str:
    """Return what hides the true shape of an outline that is `ok` and wrong."""
    if overlap(case.unit, filled(case.outlines[0]), case.outlines[0]) < RIGHT:
        return "filled alike"
    read, sigma = np.clip(case.read, 0.0, 1.0), case.unit.sigma(case.half_width)
    explained = best_convex(case.unit, read, sigma, case.low, case.high)[1] >= LEAST_P
    return "convex explains" if explained else "other wrong"


def _hull(points: Array) -> Array:
    ring = shapely.get_coordinates(shapely.convex_hull(shapely.multipoints(points)))[:-1]
    return np.asarray(ring)


def _inward(chain: Array, least: float) -> list[int]:
    """Return the strips at which, and after which, a chain turns inwards."""
    found = np.flatnonzero(np.diff(chain, 2) < -least) + 1
    return sorted({int(i) + more for i in found for more in (0, 1)})


def table(count: int, seed: int) -> list[str]:
    """Return how many concave shapes are doubted as several, or `ok` and wrong, and what other shapes read alike."""
    found: dict[str, Counter[str]] = {}
    for number in range(count):
        random = np.random.default_rng([seed, number])
        kind = CONCAVE[number % len(CONCAVE)]
        strips, half_width = int(cases.log_uniform(random, *_STRIPS)), cases.log_uniform(random, *_NOISE)
        case = cases.single(random, kind, strips, ("kh", "kl"), half_width)
        fit = partial(
            ts.fit_polygon, case.unit.scan(case.read), case.unit.sensor, told_noise(case), assessment="fast"
        )
        result = fit()
        counter = found.setdefault(kind, Counter())
        counter["cases"] += 1
        right = best_object(case.unit, result, case.outlines[0])[0] >= RIGHT
        if result.status == "ok":
            counter["called ok"] += 1
            if not right:
                counter[why_wrong(case)] += 1
        if result.status == "ok" or SEVERAL.search(result.advice) is None:
            continue
        counter["doubted"] += 1
        counter["as one"] += fit(one_object=True).status != "ok"
        if (two := explaining(case)) is not None:
            counter["two explain"] += 1
            counter["and apart"] += shapely.distance(*map(shapely.Polygon, two)) >= GAP * case.unit.length
        else:
            counter["outline right" if right else "outline wrong"] += 1
    doubted = ("doubted", "as one", "two explain", "and apart", "outline wrong", "outline right")
    names = ("cases", *doubted, "called ok", "filled alike", "convex explains", "other wrong")
    rows = [*sorted(found.items()), ("all", sum(found.values(), Counter()))]
    return [
        f"{'':10}" + "".join(f" {n}" for n in names),
        *(f"{kind:10}" + "".join(f"{of[n]:{len(n) + 1}}" for n in names) for kind, of in rows),
    ]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table that the command line asks for."""
    asked = of_cases("studies.several_limit", __doc__, 200).parse_args(arguments)
    print("\n".join(table(asked.cases, asked.seed)))  # noqa: T201


if __name__ == "__main__":
    main()
