"""A reading that contradicts all others: a faulty channel's, or that of a second object, or of an overhang.

Two readings tell both ends of the contact on a strip. A faulty channel moves both, for its error is none that a contact
makes; a second object, or an overhang, moves one. The strip's other reading decides: it agrees with all others, or not.
Where the contact ends, a narrow strip behind a notch, or of a second object, does as a fault does.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.core.convex_chain import convex_cost
from tacstrip.core.model_selection import per_vertex_penalty
from tacstrip.reconstruction.contact_ends import closed_ends, end_deviations
from tacstrip.reconstruction.polygon.chi_square import ALARM, squares_score
from tacstrip.reconstruction.polygon.convexity import NEAR_ENOUGH, ConvexFit, inward_corners, nearest_convex
from tacstrip.reconstruction.polygon.run import MOST_SIGMA, RunFit
from tacstrip.sensor.spec import Sensor

_GAP = 0.02  # of L: objects nearer to each other are one, and what moves an end by less may be a stray error
_STAYS, _RAIL = 4.0, 3.0  # deviations: an end is where it was; a reading is none of ground or Vref
# Deviations by which the end that moves less must be off, beyond those of the reading that was kept: likelihoods of a
# fault and of a second object are then as 90 to 1.
_ELSEWHERE = 3.0
_OUTER = 3  # strips at either end
MOST_STRIPS = 24  # on more, neighbours tell the noise whatever one channel reads
_ROUGHLY = 4.0  # of what noise leaves: l and u, whose errors go together, by themselves
_LEAST_SQUARES = 0.1  # of residuals, a degree of freedom: of fewer than these few by chance


def one_end_off(run: RunFit, sensor: Sensor, readings: Mapping[str, FloatArray]) -> bool:
    """Whether readings were left out of a strip where one end of the contact, and no more, would lie elsewhere.

    Or the same channel of two neighbours, or both of one strip. Amid strips that agree hardly any object moves one
    reading of a single strip; where few readings are left to check, nothing tells. (At the sensor's border a fault that
    leaves a reading off ground and Vref does so too, which is rare.)
    """
    if run.singled_out is not None:
        others = run.excluded.copy()
        others[run.singled_out] = False
        run = replace(run, excluded=others)
    if not np.count_nonzero(run.excluded):
        return False
    moved = _Moved.of(run, sensor, readings)
    read = np.stack([readings["kh"], readings["kl"]])
    rail = _RAIL * run.sigma
    with np.errstate(invalid="ignore"):
        railed = run.excluded & ((read <= rail) | (read >= 1.0 - rail))
        inside = (read[0] > read[1] - 2.0 * _STAYS * run.sigma) & ~railed.any(axis=0)
    left_out = run.excluded.any(axis=0) & inside
    one = moved.one_stays & (moved.deviations.max(axis=0) >= 2.0 * _STAYS)
    one &= np.abs(moved.off).max(axis=0) >= _GAP
    one |= _ends_there(run, sensor, readings)
    # Two channels are seldom faulty, and seldom neighbours; an object of two strips reads so.
    side = run.excluded & ~railed
    two = (side[:, 1:] & side[:, :-1]).any(axis=0)
    one |= np.append(two, False) | np.append(False, two)
    beside = np.pad(left_out & one, 1)
    # Two channels of one strip are seldom faulty at once: what moves both of its readings is a stem or a spike.
    one[_OUTER:-_OUTER] &= (beside[:-2] | beside[2:])[_OUTER:-_OUTER]
    one |= run.excluded.all(axis=0)
    if sensor.strip_width_mm and (run.excluded & ~railed)[:, [0, -1]].any():
        return True  # a wide strip at the rim may be covered by a sliver of the contact, which the others do not tell
    return bool((left_out & (one | (not run.checked))).any())


def contradictory(run: RunFit, sensor: Sensor, readings: Mapping[str, FloatArray]) -> BoolArray:
    """Return which readings left out (S, n) no contact makes: of strips whose other reading agrees with all strips.

    They move both ends of the contact, or its lower end above the upper one, and the contact does not just end there.
    None with one signature, nor where few readings are left to check.
    """
    if run.singled_out is not None:
        alone = np.zeros_like(run.excluded)
        alone[run.singled_out] = True
        return alone
    if len(run.excluded) < 2 or not np.count_nonzero(run.excluded) or not run.checked:
        return np.zeros_like(run.excluded)
    moved = _Moved.of(run, sensor, readings)
    with np.errstate(invalid="ignore"):
        crossed = readings["kh"] < readings["kl"] - 2.0 * _STAYS * run.sigma
        both = ~moved.one_stays & (np.abs(moved.off).max(axis=0) >= _GAP)
        none = crossed | (both & ~_ends_there(run, sensor, readings))
    return np.asarray(run.excluded & none & (run.excluded.sum(axis=0) == 1))


def _ends_there(run: RunFit, sensor: Sensor, readings: Mapping[str, FloatArray]) -> BoolArray:
    """Return on which strips (n,) at either end readings were left out that fit a contact that narrows there at once.

    By a notch, or as one of two objects goes on: put back, l and u are convex up to there, and one of them beyond, too.
    On an outermost strip that the contact covers further, as an L does, one of them goes straight on: of a fault, which
    moves both, that would be chance. A reading at ground or Vref shows its fault in itself.
    """
    read = np.stack([readings["kh"], readings["kl"]])
    x = run.problem.x * run.problem.width_mm
    n, rail = x.size, _RAIL * run.sigma
    found = np.zeros(n, dtype=np.bool_)
    with np.errstate(divide="ignore", invalid="ignore"):
        l, u = closed_ends(sensor, *read)
        railed = run.excluded & ((read <= rail) | (read >= 1.0 - rail))
        open_ = run.excluded.any(axis=0) & ~railed.any(axis=0) & (read[0] > read[1])
    weight = 1.0 / np.stack(end_deviations(sensor, l, u, run.sigma)) ** 2
    sound = ~run.excluded.any(axis=0) & np.isfinite(l + u)
    at = np.arange(n)
    for i in np.flatnonzero(open_).tolist():
        if (beyond := min(i, n - 1 - i)) >= _OUTER:
            continue
        inner = sound & ((at > i) if i == beyond else (at < i))
        chains = [(x, y, w) for y, w in zip((l, -u), weight, strict=True)]
        found[i] = all(_convex_with(*chain, inner, i, _STAYS) for chain in chains) and (
            beyond == 0 or any(_convex_with(*chain, sound, i, _STAYS) for chain in chains)
        )
        if beyond == 0:
            near = sound & (np.abs(at - i) <= _OUTER)
            found[i] |= any(_goes_straight_on(*chain, near, i) for chain in chains)
    return found


def _goes_straight_on(x: FloatArray, y: FloatArray, weight: FloatArray, near: BoolArray, i: int) -> bool:
    """Whether a chain y (n,) of the strips near to i, `_OUTER` of them, lies on a line with strip i."""
    return np.count_nonzero(near) == _OUTER and all(
        _convex_with(x, side * y, weight, near, i, _STAYS) for side in (1.0, -1.0)
    )


def _convex_with(
    x: FloatArray, y: FloatArray, weight: FloatArray, others: BoolArray, i: int, most: float
) -> bool:
    """Whether a chain y (n,) of others stays as near to a convex one with strip i, but for so many deviations."""
    both = others.copy()
    both[i] = True
    before, after = (convex_cost(x[of], y[of], weight[of]) for of in (others, both))
    return after - before <= most**2


def without_one(
    runs_of: Callable[[Sequence[Mapping[str, FloatArray]]], list[RunFit]],
    run: RunFit,
    sensor: Sensor,
    readings: Mapping[str, FloatArray],
    sigma_known: bool,
) -> RunFit:
    """Return a fit of few strips without the one reading that contradicts all others, where there is one; else `run`.

    On few strips a fault hides among its neighbours, which it makes look odd, and makes noise that is estimated look as
    large as itself; and no polygon of few corners follows a curve. So each reading is left out by itself: of the fault
    alone, one convex object explains all others.

    Parameters
    ----------
    runs_of
        Fits runs of such readings.
    run, sensor, readings
        The fit, of what; signature to (n,).
    sigma_known
        Whether the readings' sigma was given.
    """
    n, none = run.problem.x.size, np.zeros_like(run.excluded)
    if len(run.problem.k) == 1 or run.selection is None or n > MOST_STRIPS:
        return run
    if _content(run, sensor, readings, sigma_known):
        return run
    sigma = run.sigma if sigma_known else NEAR_ENOUGH
    whole = nearest_convex(run, sensor, readings, none, sigma)
    if whole is None or whole[1].explains:
        return run
    tried = []
    for i in _strips_to_leave_out(run, sensor, readings, sigma):
        for s in (0, 1):
            one = none.copy()
            one[s, i] = True
            if (nearest := nearest_convex(run, sensor, readings, one, sigma)) is not None:
                tried.append((nearest[1].chi_square, (s, i), nearest[1]))
    if not tried:
        return run
    tried.sort(key=lambda t: t[0])
    (least, at, ends), rivals = tried[0], tried[1:2]
    paid = per_vertex_penalty(run.problem.readings)
    if not ends.explains or any(rival.explains or chi < least + paid for chi, _, rival in rivals):
        return run
    alone = fit_without(runs_of, readings, at)
    if alone.selection is None:
        return run
    told = False
    if not sigma_known:  # what a polygon leaves over tells the noise better than few convex ends do
        told = bool(contradictory(replace(alone, singled_out=None), sensor, readings)[at])
        sigma *= math.sqrt(max(least / ends.freedom, _LEAST_SQUARES))
    told = told or _moves_both(at, ends, run, sensor, readings, sigma)
    return alone if told else run


def _strips_to_leave_out(
    run: RunFit, sensor: Sensor, readings: Mapping[str, FloatArray], sigma: float
) -> list[int]:
    """Return the strips without which l and u, each by itself, are roughly convex: of the others no reading can be."""
    x, chains = _chains(run, sensor, readings, sigma)
    there = np.isfinite(chains).all(axis=(0, 1))
    found = []
    for i in range(len(x)):
        others = there & (np.arange(len(x)) != i)
        left = sum(convex_cost(x[others], y[others], w[others]) for y, w in chains)
        if left <= _ROUGHLY * 2 * len(x):
            found.append(i)
    return found


def _chains(
    run: RunFit, sensor: Sensor, readings: Mapping[str, FloatArray], sigma: float
) -> tuple[FloatArray, FloatArray]:
    """Return x (n,) [mm], and l and -u [mm] with their weights (2, 2, n), strip by strip."""
    with np.errstate(divide="ignore", invalid="ignore"):
        l, u = closed_ends(sensor, readings["kh"], readings["kl"])
    weight = 1.0 / np.stack(end_deviations(sensor, l, u, sigma)) ** 2
    return run.problem.x * run.problem.width_mm, np.stack([np.stack([l, -u]), weight], axis=1)


def fit_without(
    runs_of: Callable[[Sequence[Mapping[str, FloatArray]]], list[RunFit]],
    readings: Mapping[str, FloatArray],
    at: tuple[int, int],
) -> RunFit:
    """Return the fit of all readings but one, which is singled out; arguments as of `without_one`."""
    left = {name: k.copy() for name, k in readings.items()}
    [*left.values()][at[0]][at[1]] = np.nan
    (alone,) = runs_of([left])
    alone.excluded[at] = True
    return replace(alone, singled_out=at)


def _moves_both(
    at: tuple[int, int],
    ends: ConvexFit,
    run: RunFit,
    sensor: Sensor,
    readings: Mapping[str, FloatArray],
    sigma: float,
) -> bool:
    """Whether a reading at (s, i) moves both ends from where convex ones go on, or l above u, as no contact does."""
    i = at[1]
    kh, kl = readings["kh"], readings["kl"]
    if sensor.strip_width_mm and i in (0, len(kh) - 1):
        return False  # it may be covered by a sliver of the contact, which the others do not tell
    if kh[i] < kl[i] - 2.0 * _STAYS * sigma:
        return True
    x, chains = _chains(run, sensor, readings, sigma)
    if np.abs(chains[:, 0, i] / sensor.length_mm - ends.ends[:, i] * (1.0, -1.0)).max() < _GAP:
        return False
    strips = np.arange(len(x))
    others = np.isfinite(chains).all(axis=(0, 1)) & (strips != i)
    near = others & (np.abs(strips - i) <= _OUTER)
    if i in (strips[0], strips[-1]) and any(_goes_straight_on(x, y, w, near, i) for y, w in chains):
        return False
    return not any(_convex_with(x, y, w, others, i, _ELSEWHERE) for y, w in chains)


def _content(run: RunFit, sensor: Sensor, readings: Mapping[str, FloatArray], sigma_known: bool) -> bool:
    """Whether a fit explains all readings but some that no contact makes, and not by a dent that a fault makes too."""
    if sigma_known and squares_score(run.residual_sums[0], run.freedom) > ALARM:
        return False
    if not sigma_known and not (run.sigma <= MOST_SIGMA and run.model_mm.height > 0.0):
        return False
    assert run.selection is not None
    sure = contradictory(run, sensor, readings)
    return bool((run.excluded == sure).all()) and not any(inward_corners(run.selection.chosen))


@dataclass(frozen=True, eq=False)
class _Moved:
    """How far readings move l and u of every strip from a fit's (2, n), over L and over what noise does.

    `others` (n,): how far a strip's readings that were not left out are from the fit's, over their deviation.
    """

    off: FloatArray
    deviations: FloatArray
    others: FloatArray

    @property
    def one_stays(self) -> BoolArray:
        """Return on which strips (n,) an end agrees with all others about as well as the reading that was kept does."""
        return np.asarray(self.deviations.min(axis=0) <= np.hypot(_ELSEWHERE, self.others))

    @classmethod
    def of(cls, run: RunFit, sensor: Sensor, readings: Mapping[str, FloatArray]) -> _Moved:
        problem, in_mm = run.problem, run.model_mm
        x = problem.x * problem.width_mm + problem.origin_mm
        l, u = (np.interp(x, *chain.T) / problem.length_mm for chain in (in_mm.lower, in_mm.upper))
        with np.errstate(divide="ignore", invalid="ignore"):
            read = np.stack([readings["kh"], readings["kl"]])
            off = np.stack(closed_ends(sensor, *read)) / sensor.length_mm - [l, u]
            by_l, by_u, k = problem.jacobian(l, u)
            others = np.where(run.excluded, 0.0, np.abs(read - k) / run.sigma).max(axis=0)
            # A column of the inverse Jacobian's rows: how far both readings' errors move l, and u.
            spread = np.stack([np.hypot(*by_u), np.hypot(*by_l)])
            spread /= np.abs(by_l[0] * by_u[1] - by_l[1] * by_u[0])
            return cls(off, np.abs(off) / (run.sigma * spread), others)
