"""Linear programs over a polytope A z <= b, and its analytic centre.

Of the thousands of rows a few dozen decide: all work on those, and check against all. The core takes the rows beside
each other; an A (M, P) that is the transpose of a contiguous array is not copied.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.core.binding import SIZE, exported
from tacstrip.core.binding import at as address

Bounds: TypeAlias = tuple[FloatArray, FloatArray]  # coefficients and right sides
MOST_DIMENSIONS = SIZE
_ROUNDING = 1e-9
_SLANTED = 1e-7  # a row less against the direction than this depends on the met ones; to pass it by is safe
_ROUNDS = 12  # of adding the rows that are broken most
_FIRST_ROWS, _MORE_ROWS = 6, 2  # rows to begin with and to add, per dimension
_USED_ROWS = _FIRST_ROWS + _ROUNDS * _MORE_ROWS
_FLAT = 1e-8  # of the scale: a polytope as thin has no inside
_NEAREST = 24  # rows per dimension that the centre keeps away from
_SELECTIONS, _STEPS = 3, 10
_CENTRED = 1e-3  # squared Newton decrement
_GAIN = 1e-4  # of the scale: a fall by less is none


def lowest(form: FloatArray, a: FloatArray, slack: FloatArray, at: FloatArray, active: IntArray) -> float:
    """Return the least of form z where a z <= slack, in rows of a (M, P); -inf where none was found.

    By an active set: downhill along the rows that are met, which are given up where their multiplier is negative.
    at (P,) is a point inside and active (P,) its met rows, -1 for none; both are moved to the lowest point.
    """
    core = exported("lowest")
    rows, size = a.shape
    if core is None:
        return plain_lowest(form, a, slack, at, active)
    given = (*(np.ascontiguousarray(values) for values in (form, a.T, slack)), at, active)
    workspace = np.empty(2 * size * size + 2 * size + 3 * rows)
    value: float = core(*map(address, given), rows, size, address(workspace))
    return value


def plain_lowest(
    form: FloatArray, a: FloatArray, slack: FloatArray, at: FloatArray, active: IntArray
) -> float:
    """Do as `lowest`, in NumPy."""
    size, scale = a.shape[1], np.abs(form).max(initial=0.0)
    for _ in range(40 * size):
        met = active[active >= 0]
        basis, root = np.linalg.qr(a[met].T)
        shares = -(basis.T @ form)
        direction = -form - basis @ shares
        # Twice: a short rest leans on the met rows by the rounding of the whole form; one that they carry is met anew.
        more = basis.T @ direction
        shares, direction = shares + more, direction - basis @ more
        length = np.abs(direction).max()
        if len(met) == size or length <= _ROUNDING * scale:
            multiplier = np.linalg.solve(root, shares)
            worst = int(multiplier.argmin()) if len(met) else 0
            if not len(met) or multiplier[worst] >= -_ROUNDING * scale:
                # Of the dual: a bound despite rounding.
                return -float(np.maximum(multiplier, 0.0) @ slack[met])
            active[:] = [*np.delete(met, worst), *[-1] * (size - len(met) + 1)]
            continue
        along, room = a @ direction, np.maximum(slack - a @ at, 0.0)
        along[met] = 0.0
        towards = along > _SLANTED * length
        if not towards.any():
            return -np.inf
        steps = np.divide(room, along, out=np.full(len(room), np.inf), where=towards)
        row = int(steps.argmin())
        at += steps[row] * direction
        active[len(met)] = row
    return -np.inf


def minimax(a: FloatArray, b: FloatArray, start: FloatArray, scale: float) -> tuple[FloatArray, float, bool]:
    """Look for a point strictly inside: the minimax fit over as many rows as it takes to know.

    Parameters
    ----------
    a, b
        The polytope (M, P) and (M,).
    start
        A point (P,).
    scale
        What counts as far outside, in units of b; deeper inside than that is not looked for.

    Returns
    -------
    tuple
        A point (P,); how far it is outside at most, in units of b, below 0 inside; and whether the polytope is
        known to be empty, or thinner than rounding.
    """
    core = exported("minimax")
    rows, size = a.shape
    if core is None or size > MOST_DIMENSIONS:
        return plain_minimax(a, b, start, scale)
    at, outside, workspace = start.copy(), np.empty(1), np.empty(_minimax_workspace(rows, size))
    given = np.ascontiguousarray(a.T), np.ascontiguousarray(b)
    empty = core(*map(address, (*given, at)), scale, rows, size, address(outside), address(workspace))
    return at, float(outside[0]), bool(empty)


def plain_minimax(
    a: FloatArray, b: FloatArray, start: FloatArray, scale: float
) -> tuple[FloatArray, float, bool]:
    """Do as `minimax`, in NumPy."""
    size = len(start)
    at = start
    broken = a @ at - b
    worst = float(broken.max())
    if worst < 0.0 or not np.isfinite(worst):
        return at, worst, not worst < 0.0
    used = largest(broken, _FIRST_ROWS * size)
    form = np.append(np.zeros(size), 1.0)
    for _ in range(_ROUNDS):
        # Least t with A h - t <= b over the rows in use, and t >= -scale.
        rows = np.vstack([np.hstack([a[used], -np.ones((len(used), 1))]), -form])
        slack = np.append(-broken[used], scale)
        point, active = np.append(np.zeros(size), worst), np.full(size + 1, -1)
        least = plain_lowest(form, rows, slack, point, active)
        if not least > -np.inf:  # rounding led it astray
            return at, worst, False
        if least > -_FLAT * scale:
            return at + point[:-1], max(worst, 0.0), True
        at = at + point[:-1]
        broken = a @ at - b
        worst = float(broken.max())
        if worst < 0.0 or np.isnan(worst):
            return at, worst, False
        used = np.union1d(used, largest(broken, _MORE_ROWS * size))
    return at, worst, False


def analytic_centre(a: FloatArray, b: FloatArray, start: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the analytic centre (P,) from a point strictly inside, and the barrier's curvature there (P, P).

    It maximises the product of the slacks b - A h of the rows that are nearest.
    """
    core = exported("analytic_centre")
    rows, size = a.shape
    if core is None or size > MOST_DIMENSIONS:
        return plain_analytic_centre(a, b, start)
    at, curvature, workspace = start.copy(), np.empty((size, size)), np.empty(_centre_workspace(rows, size))
    given = np.ascontiguousarray(a.T), np.ascontiguousarray(b)
    core(*map(address, (*given, at, curvature)), rows, size, address(workspace))
    return at, curvature


def plain_analytic_centre(a: FloatArray, b: FloatArray, start: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Do as `analytic_centre`, in NumPy."""
    at, slack = start, b - a @ start
    near = largest(-slack, _NEAREST * len(start))
    for _ in range(_SELECTIONS):
        for _ in range(_STEPS):
            scaled = a[near] / slack[near, None]
            gradient, curvature = scaled.sum(axis=0), scaled.T @ scaled
            scale, lower = _factor_scaled(curvature)
            if lower is None:
                return at, curvature
            step = -scale * np.linalg.solve(lower.T, np.linalg.solve(lower, scale * gradient))
            along = a @ step
            size = min(1.0, 0.7 / max(float((along / slack).max()), 1e-300))
            left = slack - size * along
            if left.min() <= 0.0:  # as far as rounding lets one go
                break
            at, slack = at + size * step, left
            if -gradient @ step < _CENTRED:
                break
        # Near is what is few steps of the barrier's own size away, in whichever direction.
        scaled = a[near] / slack[near, None]
        curvature = scaled.T @ scaled
        scale, lower = _factor_scaled(curvature)
        if lower is None:
            return at, curvature
        reach = np.linalg.norm(np.linalg.solve(lower, (a * scale).T), axis=0)
        near = largest(reach / slack, _NEAREST * len(start))
    scaled = a[near] / slack[near, None]
    return at, scaled.T @ scaled


def _factor_scaled(curvature: FloatArray) -> tuple[FloatArray, FloatArray | None]:
    """Return what makes the diagonal 1, and the lower Cholesky factor then; None where there is none."""
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = 1.0 / np.sqrt(np.diag(curvature))
        try:
            scaled = curvature * np.outer(scale, scale) + 1e-13 * np.eye(len(curvature))
            return scale, np.asarray(np.linalg.cholesky(scaled), dtype=np.float64)
        except np.linalg.LinAlgError:
            return scale, None


def feasible_part(
    rows: Bounds, pairs: Bounds, start: FloatArray, scale: float, most: int
) -> tuple[tuple[FloatArray, FloatArray] | None, int]:
    """Look for a convex part with an inside, of a set where all rows hold and of each pair one at least.

    Of each pair the row that is met best is kept, the least violation found, and so on while it falls.

    Parameters
    ----------
    rows
        A and b (M, P) and (M,).
    pairs
        The same of the pairs (E, 2, P) and (E, 2).
    start
        A point (P,).
    scale
        As for `minimax`.
    most
        Rounds at most.

    Returns
    -------
    tuple
        The part's analytic centre (P,) and the barrier's curvature there (P, P), or None; and the rounds that it took.
    """
    core = exported("feasible_part")
    count, size = rows[0].shape
    if core is None or size > MOST_DIMENSIONS:
        return plain_feasible_part(rows, pairs, start, scale, most)
    either = len(pairs[1])
    total = count + either
    given = [np.ascontiguousarray(part.T) for part in (*rows, *pairs)]
    at, curvature = start.copy(), np.empty((size, size))
    inner = max(_minimax_workspace(total, size), _centre_workspace(total, size))
    workspace = np.empty(total * (size + 1) + 2 * either + inner)
    arrays = map(address, (*given, at, curvature))
    rounds = int(core(*arrays, scale, most, count, either, size, address(workspace)))
    return (at, curvature) if rounds > 0 else None, abs(rounds)


def plain_feasible_part(
    rows: Bounds, pairs: Bounds, start: FloatArray, scale: float, most: int
) -> tuple[tuple[FloatArray, FloatArray] | None, int]:
    """Do as `feasible_part`, in NumPy."""
    at, before, every = start, np.inf, np.arange(len(pairs[1]))
    for number in range(1, most + 1):
        kept = (pairs[0] @ at - pairs[1]).argmin(axis=1)
        a, b = (np.concatenate([row, pair[every, kept]]) for row, pair in zip(rows, pairs, strict=True))
        at, worst, _ = plain_minimax(a, b, at, scale)
        if worst < 0.0:
            return plain_analytic_centre(a, b, at), number
        if not len(every) or not worst <= before - _GAIN * scale:  # NaN too
            return None, number
        before = worst
    return None, most


def largest(values: FloatArray, count: int) -> IntArray:
    """Return the places of the largest values, ascending: of equal ones the first, whatever the processor."""
    if count >= len(values):
        return np.arange(len(values))
    least = np.partition(values, len(values) - count)[len(values) - count]
    above, equal = np.flatnonzero(values > least), np.flatnonzero(values == least)
    return np.sort(np.concatenate([above, equal[: count - len(above)]]))


def _minimax_workspace(rows: int, size: int) -> int:
    return 3 * rows + (size + 5) * (min(rows, _USED_ROWS * size) + 1) + 2 * (size + 1) * (size + 2)


def _centre_workspace(rows: int, size: int) -> int:
    return 4 * rows + 64 * size + size * (min(rows, _NEAREST * size) + 4)
