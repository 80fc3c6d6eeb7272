"""One end of a contact along the strips: the convex function nearest to it, and where no convex function goes on.

Strips x (n,), ascending, the end there y (n,), and weights (n,), one over its variance.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.core.binding import at, exported

SPARE = 1e-9  # of the largest gradient: none is left
# Of chi square, times the logarithm of the strips, and beside it: what one more line costs.
PER_LINE, ALSO = 3.0, 8.0
CONTRADICTED = 18.0  # of chi square: by so much a convex chain explains the readings worse
BESIDE = 0.25  # pitches beyond the strips at either side where lines that meet make a corner
ROUNDED = 1e-9  # of chi square: by so much the same lines may differ
PER_STEP = 4.0  # of chi square, times the logarithm of a step in deviations: lower ones are likelier


def convex_regression(
    x: FloatArray, y: FloatArray, weight: FloatArray, sign: float = 1.0
) -> tuple[FloatArray, int]:
    """Return the convex function (sign 1; -1: concave) nearest to y (n,), and its number of kinks.

    By least squares, as a line and hinges of positive weight (Lawson and Hanson's active set).
    """
    core = exported("convex_regression")
    if core is None:
        return _plain_regression(x, y, weight, sign)
    x, y, weight, places, room = _sent(x, y, weight)
    found, n = np.empty(len(x)), len(x)
    kinks = core(at(x), at(y), at(weight), n, sign, at(found), at(places), at(room))
    return found, kinks


def convex_cost(x: FloatArray, y: FloatArray, weight: FloatArray) -> float:
    """Return chi square of the nearest convex function."""
    return float((weight * (y - convex_regression(x, y, weight)[0]) ** 2).sum())


def straight_lines(x: FloatArray, y: FloatArray, weight: FloatArray) -> IntArray:
    """Return the strips where the straight lines begin that explain y best (L + 1,), with the end of all.

    Every line costs its parameters; which ones, dynamic programming finds exactly.
    """
    return best_lines(x, y, weight, _per_line(len(x)))[0]


def best_lines(
    x: FloatArray, y: FloatArray, weight: FloatArray, per_line: float, single: float = 0.0
) -> tuple[IntArray, float]:
    """Return where the best lines begin (L + 1,), with the end of all, and their cost; `single`: less for one strip."""
    core = exported("best_lines")
    if core is None:
        return _plain_best_lines(x, y, weight, per_line, single)
    x, y, weight, places, room = _sent(x, y, weight)
    n, cost = len(x), np.empty(1)
    begins = np.empty(n + 1, dtype=np.int64)
    lines = core(at(x), at(y), at(weight), n, per_line, single, at(begins), at(cost), at(places), at(room))
    return begins[: lines + 1], float(cost[0])


def convex_cuts(x: FloatArray, y: FloatArray, weight: FloatArray) -> tuple[list[int], list[float]]:
    """Return where convex stretches begin, with the end of all, and the gain of each cut between two of them."""
    core = exported("convex_cuts")
    if core is None:
        return _plain_cuts(x, y, weight)
    x, y, weight, places, room = _sent(x, y, weight)
    n = len(x)
    cuts, gains = np.empty(n + 1, dtype=np.int64), np.empty(n)
    stretches = core(at(x), at(y), at(weight), n, at(cuts), at(gains), at(places), at(room))
    return cuts[: stretches + 1].tolist(), gains[: stretches - 1].tolist()


def polyline(
    x: FloatArray, y: FloatArray, weight: FloatArray, pitch: float
) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Return the convex polyline through a stretch's strips.

    Returns
    -------
    borders
        Of its L lines (L + 1,), from half a pitch before the first strip to half a pitch after the last.
    lines
        Height at the middle of each, slope, and middle (L, 3).
    variances
        Of height and slope (L, 2), which are independent at the middle.
    chi_square
        What the nearest convex function leaves over.
    """
    if len(x) == 1:
        ends, flat = x[[0, -1]] + [-0.5 * pitch, 0.5 * pitch], np.array([[y[0], 0.0, x[0]]])
        return ends, flat, np.array([[1.0 / weight[0], (y[0] / pitch) ** 2]]), 0.0
    core = exported("convex_polyline")
    if core is None:
        return _plain_polyline(x, y, weight, pitch)
    x, y, weight, places, room = _sent(x, y, weight)
    n = len(x)
    borders, lines, chi_square = np.empty(n + 1), np.empty((n, 5)), np.empty(1)
    many = core(
        at(x), at(y), at(weight), n, pitch, at(borders), at(lines), at(chi_square), at(places), at(room)
    )
    return borders[: many + 1], lines[:many, :3], lines[:many, 3:], float(chi_square[0])


def sure_strips(x: FloatArray, y: FloatArray, weight: FloatArray, cuts: list[int]) -> BoolArray:
    """Return which strips (n,) belong to their stretch wherever the readings allow the cuts (C,), with the end."""
    core = exported("sure_strips")
    if core is None:
        return _plain_sure_strips(x, y, weight, cuts)
    x, y, weight, places, room = _sent(x, y, weight)
    begins, found = np.array(cuts, dtype=np.int64), np.empty(len(x), dtype=np.int64)
    core(at(x), at(y), at(weight), len(x), at(begins), len(cuts) - 1, at(found), at(places), at(room))
    return np.asarray(found != 0)


def hull_ends(points: FloatArray, x: FloatArray) -> FloatArray:
    """Return the lower and the upper end (2, n) of the convex hull of points (m, 2) at x (n,), NaN beside it."""
    core = exported("hull_ends")
    if core is None:
        return np.stack([_plain_lower_hull(points, x), -_plain_lower_hull(points * (1.0, -1.0), x)])
    found, room = np.empty((2, len(x))), np.empty(4 * len(points))
    points, x = np.ascontiguousarray(points), np.ascontiguousarray(x)
    core(at(points), len(points), at(x), len(x), at(found), at(room))
    return found


def height(line: FloatArray, x: float) -> float:
    """Return a line's height at x."""
    return float(line[0] + line[1] * (x - line[2]))


def _sent(
    x: FloatArray, y: FloatArray, weight: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, IntArray, FloatArray]:
    """Return an end as the core takes it, and what it works in."""
    n = len(x)
    x, y, weight = (np.ascontiguousarray(a, dtype=np.float64) for a in (x, y, weight))
    return x, y, weight, np.empty(2 * n + 2, dtype=np.int64), np.empty(9 * n + 7)


def _per_line(strips: int) -> float:
    return float(PER_LINE * np.log(max(strips, 2)) + ALSO)


def _plain_lower_hull(points: FloatArray, x: FloatArray) -> FloatArray:
    points = points[np.lexsort((points[:, 1], points[:, 0]))]
    hull: list[tuple[float, float]] = []
    for px, py in points[
        np.append(True, np.diff(points[:, 0]) > 0.0)
    ].tolist():  # of those on one x the lowest
        while len(hull) > 1 and (hull[-1][0] - hull[-2][0]) * (py - hull[-2][1]) <= (px - hull[-2][0]) * (
            hull[-1][1] - hull[-2][1]
        ):
            hull.pop()
        hull.append((px, py))
    found = np.array(hull)
    return np.asarray(np.interp(x, found[:, 0], found[:, 1], left=np.nan, right=np.nan))


def _plain_sure_strips(x: FloatArray, y: FloatArray, weight: FloatArray, cuts: list[int]) -> BoolArray:
    """Do as `sure_strips`."""
    sure = np.ones(len(x), dtype=np.bool_)

    def cost(a: int, b: int) -> float:
        return convex_cost(x[a:b], y[a:b], weight[a:b]) if b - a > 2 else 0.0

    for a, c, b in zip(cuts[:-2], cuts[1:-1], cuts[2:], strict=True):
        here = cost(a, c) + cost(c, b)
        for step in (-1, 1):
            place = c + step
            while a <= place <= b and cost(a, place) + cost(place, b) < here + CONTRADICTED:
                sure[place if step < 0 else place - 1] = False
                place += step
    return sure


def _plain_regression(
    x: FloatArray, y: FloatArray, weight: FloatArray, sign: float
) -> tuple[FloatArray, int]:
    """Do as `convex_regression`."""
    if len(x) < 3:
        return y.copy(), 0
    root = np.sqrt(weight)
    centre = x.mean()
    line = np.stack([np.ones_like(x), x - centre], axis=1)
    hinge = sign * np.maximum(x[:, None] - x[None, 1:-1], 0.0)
    every = np.concatenate([line, hinge], axis=1) * root[:, None]
    target, active = y * root, [0, 1]
    squared, onto = every.T @ every, every.T @ target

    def solved() -> FloatArray:
        """Return the least squares of the active columns, by normal equations: the last of all is exact."""
        try:
            return np.linalg.solve(squared[np.ix_(active, active)], onto[active])
        except np.linalg.LinAlgError:
            return np.asarray(np.linalg.lstsq(every[:, active], target, rcond=None)[0])

    value = np.zeros(every.shape[1])
    value[active] = solved()
    for _ in range(3 * len(x)):
        gradient = every.T @ (target - every @ value)
        gradient[active] = -np.inf
        best = int(np.argmax(gradient[2:])) + 2 if len(gradient) > 2 else 0
        if best == 0 or gradient[best] <= SPARE * max(np.abs(target).sum(), 1e-300):
            break
        active.append(best)
        while True:
            trial = solved()
            low = [i for i, a in enumerate(active) if a > 1 and trial[i] <= 0.0]
            if not low:
                break
            now = value[active]
            step = min(now[i] / max(now[i] - trial[i], 1e-300) for i in low)
            value[active] = now + step * (trial - now)
            gone = {active[i] for i in low if value[active[i]] <= 1e-15 + 1e-12 * abs(now[i])} or {
                active[low[0]]
            }
            value[list(gone)] = 0.0
            active = [a for a in active if a not in gone]
        value[:] = 0.0
        value[active] = trial
    value[active] = np.linalg.lstsq(every[:, active], target, rcond=None)[0]
    return line @ value[:2] + hinge @ value[2:], len(active) - 2


def _plain_best_lines(
    x: FloatArray, y: FloatArray, weight: FloatArray, per_line: float, single: float
) -> tuple[IntArray, float]:
    """Do as `best_lines`."""
    n = len(x)
    x, y = x - x.mean(), y - y.mean()
    sums = np.zeros((6, n + 1))
    np.cumsum(weight * np.stack([np.ones(n), x, x * x, y, x * y, y * y]), axis=1, out=sums[:, 1:])
    best, back = np.zeros(n + 1), np.zeros(n + 1, dtype=np.int64)
    # From the row's strip to before the column's.
    s, sx, sxx, sy, sxy, syy = sums[:, None, :] - sums[:, :, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        own = s * sxx - sx * sx
        cost = syy - sy * sy / s - np.where(own > 1e-12 * s * sxx, (s * sxy - sx * sy) ** 2 / (own * s), 0.0)
    cost[np.tri(n + 1, k=2, dtype=bool)] = 0.0  # exactly, or rounding chooses among lines of two strips
    for stop in range(1, n + 1):
        totals = best[:stop] + np.maximum(cost[:stop, stop], 0.0)
        totals[-1] -= single
        back[stop] = totals.argmin()
        best[stop] = totals[back[stop]] + per_line
    found = [n]
    while found[-1]:
        found.append(int(back[found[-1]]))
    return np.array(found[::-1]), float(best[-1])


def _line(x: FloatArray, y: FloatArray, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return height at the middle, slope and middle (3,) of the line through points, and the variances (2,) of two."""
    total = weight.sum()
    middle = float(weight @ x / total)
    spread = float(weight @ (x - middle) ** 2)
    slope = float(weight @ ((x - middle) * y)) / spread
    return np.array([weight @ y / total, slope, middle]), np.array([1.0 / total, 1.0 / spread])


def _goes_on(x: FloatArray, y: FloatArray, weight: FloatArray, a: int, c: int, b: int) -> bool:
    """Whether the lines of strips a to c and c to b plainly meet in a convex corner between the two."""
    if min(c - a, b - c) < 2:
        return False
    (left, _), (right, _) = _line(x[a:c], y[a:c], weight[a:c]), _line(x[c:b], y[c:b], weight[c:b])
    beside = BESIDE * (x[c] - x[c - 1])
    differ = [height(right, at) - height(left, at) for at in (x[c - 1] - beside, x[c] + beside)]
    return bool(right[1] > left[1] and differ[0] < 0.0 < differ[1])


def _plain_cuts(x: FloatArray, y: FloatArray, weight: FloatArray) -> tuple[list[int], list[float]]:
    """Do as `convex_cuts`."""
    lines = straight_lines(x, y, weight)
    cuts = [
        0,
        *(
            c
            for a, c, b in zip(lines[:-2], lines[1:-1], lines[2:], strict=True)
            if not _goes_on(x, y, weight, a, c, b)
        ),
        len(x),
    ]
    cost: dict[tuple[int, int], float] = {}

    def chi_square(a: int, b: int) -> float:
        if (a, b) not in cost:
            cost[a, b] = convex_cost(x[a:b], y[a:b], weight[a:b])
        return cost[a, b]

    while True:
        gains = {
            c: chi_square(a, b) - chi_square(a, c) - chi_square(c, b)
            for a, c, b in zip(cuts[:-2], cuts[1:-1], cuts[2:], strict=True)
        }
        least = min(gains, key=lambda c: gains[c], default=None)
        if least is None or gains[least] >= CONTRADICTED:
            break
        cuts.remove(least)

    # A convex chain takes the first strip of the next one for an edge so steep that one strip shows it: the strips
    # beside a cut go to the side that explains them with fewer lines, and lower steps.
    per_line = _per_line(len(x))

    def cost_of(a: int, b: int, right: bool) -> float:
        lines, cost = best_lines(x[a:b], y[a:b], weight[a:b], per_line, per_line / 3.0)
        if len(lines) > 2 and lines[-1] - lines[-2] <= 2 if right else len(lines) > 2 and lines[1] <= 2:
            p, q = a + (lines[-3:-1] if right else lines[1:3])
            end = b - 1 if right else a
            level = height(_line(x[p:q], y[p:q], weight[p:q])[0], x[end]) if q - p > 1 else y[p]
            cost += PER_STEP * float(np.log1p(abs(y[end] - level) * np.sqrt(weight[end])))
        return chi_square(a, b) + cost

    for i in range(1, len(cuts) - 1):
        a, c, b = cuts[i - 1 : i + 2]
        lowest = np.inf
        for place in (c, c - 1, c + 1):
            if (
                a < place < b
                and (here := cost_of(a, place, True) + cost_of(place, b, False)) < lowest - ROUNDED
            ):
                lowest, cuts[i] = here, int(place)
    return cuts, list(gains.values())


def _plain_polyline(
    x: FloatArray, y: FloatArray, weight: FloatArray, pitch: float
) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Do as `polyline`, of two strips or more."""
    fitted, _ = convex_regression(x, y, weight)
    chi_square = float((weight * (y - fitted) ** 2).sum())
    ends = x[[0, -1]] + [-0.5 * pitch, 0.5 * pitch]
    cuts = list(straight_lines(x, y, weight))
    while True:
        found = []
        for a, b in pairwise(cuts):
            a, b = (a, b) if b - a > 1 else (a, b + 1) if a == 0 else (a - 1, b)
            found.append(_line(x[a:b], y[a:b], weight[a:b]))
        lines = np.stack([line for line, _ in found])
        level, slope, middle = lines.T
        with np.errstate(divide="ignore", invalid="ignore"):
            meet = np.diff(slope * middle - level) / np.diff(slope)
        borders = np.concatenate([ends[:1], meet, ends[1:]])
        wrong = np.flatnonzero((np.diff(slope) <= 0.0) | ~np.isfinite(meet))
        late = np.flatnonzero(~(np.diff(borders) > 0.0))
        if not len(wrong) and not len(late):
            return borders, lines, np.stack([variances for _, variances in found]), chi_square
        # Lines that make no convex chain are one: the pair that costs least.
        places = wrong if len(wrong) else np.unique(np.clip([late - 1, late], 0, len(meet) - 1))
        worse = [_joint_cost(x, y, weight, cuts[i], cuts[i + 2]) for i in places]
        del cuts[places[int(np.argmin(worse))] + 1]


def _joint_cost(x: FloatArray, y: FloatArray, weight: FloatArray, a: int, b: int) -> float:
    line, _ = _line(x[a:b], y[a:b], weight[a:b])
    return float((weight[a:b] * (y[a:b] - line[0] - line[1] * (x[a:b] - line[2])) ** 2).sum())
