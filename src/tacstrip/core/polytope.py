"""A walk through a set of bounds, and the least value of a linear form in a polytope."""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.core.binding import at as address
from tacstrip.core.binding import exported

_ROUNDING = 1e-9
_SLANTED = 1e-7  # a row less against the direction than this depends on the met ones; to pass it by is safe


def walk(
    a: FloatArray,
    slack: FloatArray,
    edge: FloatArray,
    pair_a: FloatArray,
    pair_slack: FloatArray,
    pair_edge: FloatArray,
    draws: FloatArray,
    out: FloatArray,
) -> None:
    """Walk from z = 0, where rows have `slack`; the arrays are contiguous, and slacks are changed in place.

    Parameters
    ----------
    a, slack, edge
        By coordinate and row (P, M), and (M,): slack - z a stays above 0; edge is over how much of it a reading
        becomes less likely.
    pair_a, pair_slack, pair_edge
        The same of pairs (P, E, 2), (E, 2), (E,), of which one at least holds.
    draws
        Uniform random numbers (sweeps, M + E + P).
    out
        Filled with the points (sweeps, P).
    """
    core = exported("walk")
    if core is None:
        plain_walk(a, slack, edge, pair_a, pair_slack, pair_edge, draws, out)
        return
    given = (
        a,
        slack,
        np.ascontiguousarray(edge),
        pair_a,
        pair_slack,
        np.ascontiguousarray(pair_edge),
        draws,
        out,
    )
    sizes = len(out), a.shape[1], pair_a.shape[1], len(a)
    workspace = np.empty(sum(sizes[1:]))
    core(*map(address, given), *sizes, address(workspace))


def plain_walk(
    a: FloatArray,
    slack: FloatArray,
    edge: FloatArray,
    pair_a: FloatArray,
    pair_slack: FloatArray,
    pair_edge: FloatArray,
    draws: FloatArray,
    out: FloatArray,
) -> None:
    """Do as `walk`, in NumPy."""
    size, rows = a.shape
    z = np.zeros(size)
    with np.errstate(divide="ignore", invalid="ignore"):
        for sweep, draw in enumerate(draws):
            for_rows, for_pairs, for_steps = draw[:rows], draw[rows:-size], draw[-size:]
            cut = for_rows * np.minimum(edge, slack)
            pair_cut = (for_pairs * np.minimum(pair_edge, pair_slack.max(axis=1)))[:, None]
            for j, share in enumerate(for_steps):
                ways, room = a[j] / (slack - cut), pair_slack - pair_cut
                high, low = 1.0 / max(ways.max(), 1e-300), 1.0 / min(ways.min(), -1e-300)
                high = _held(room, pair_a[j]).min(initial=high)
                low = (-_held(room, -pair_a[j])).max(initial=low)
                step = low + (high - low) * share
                z[j] += step
                slack -= step * a[j]
                pair_slack -= step * pair_a[j]
            out[sweep] = z


def _held(slack: FloatArray, row: FloatArray) -> FloatArray:
    """Return how far one can go from d = 0 on while one of two slacks - d row (E, 2) is not below 0 (E,)."""
    swap = (slack[:, 0] < slack[:, 1])[:, None]
    (s, t), (r, q) = np.where(swap, slack[:, ::-1], slack).T, np.where(swap, row[:, ::-1], row).T
    reach = np.where(r > 0.0, np.maximum(s, 0.0) / r, np.inf)
    longer = np.maximum(reach, np.where(q > 0.0, t / q, np.inf))
    return np.where(t >= 0.0, longer, np.where((q < 0.0) & (t / q <= reach), np.inf, reach))


def lowest(form: FloatArray, a: FloatArray, slack: FloatArray, at: FloatArray, active: IntArray) -> float:
    """Return the least of form z where a z <= slack, in rows of a (M, P); -inf where none was found.

    By an active set: downhill along the rows that are met, which are given up where their multiplier is negative.
    at (P,) is a point inside and active (P,) its met rows, -1 for none; both are moved to the lowest point.
    """
    core = exported("lowest")
    if core is None:
        return plain_lowest(form, a, slack, at, active)
    rows, size = a.shape
    given = (*(np.ascontiguousarray(values) for values in (form, a, slack)), at, active)
    workspace = np.empty(2 * size * size + 2 * size + rows)
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
        length = np.abs(direction).max()
        if len(met) == size or length <= _ROUNDING * scale:
            multiplier = np.linalg.solve(root, shares)
            worst = int(multiplier.argmin()) if len(met) else 0
            if not len(met) or multiplier[worst] >= -_ROUNDING * scale:
                return -float(
                    np.maximum(multiplier, 0.0) @ slack[met]
                )  # of the dual: a bound whatever the rounding
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
