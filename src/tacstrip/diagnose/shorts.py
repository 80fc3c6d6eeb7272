"""Bridges between neighbouring strips or their wires."""

from __future__ import annotations

from functools import partial

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.diagnose.beside import Beside, neighbours
from tacstrip.diagnose.finding import Finding
from tacstrip.diagnose.fits import without
from tacstrip.diagnose.view import Suspect, View

_FEW, _MANY = 8, 30  # places
_FOLLOWS = 0.25  # of the slope around; 1 for two strips of their own, 0 for two that are tied
_ALONE = 0.75  # of the slope: what tied strips may lie off the line together; 1.5 beside a jump
_MOST = (
    0.9,
    0.5,
)  # of the places where the slope tells: those that differ little, and that lie near the line
_AT_EDGE = 0.85  # in place of the latter at the sensor's edges, where the line is drawn further
_UNUSUAL, _UNUSUAL_AT_EDGE = 3.0, 8.0  # times what four in five other pairs do together
_MOST_UNUSUAL = 1.6  # times what any other pair does
_SHAPE = 0.7  # of the slope's variance: where the contact lies must not say more, for then its shape does
_WINDOW = 2  # pairs to either side that see a pair's strips
_BINS = 5  # of height


def shorts(view: View) -> list[Suspect]:
    """Find neighbours that are tied together.

    Tied sensing strips or wires read one voltage, whatever the slope of the contact. Over metal, where strips are
    energised in turn, a bridge between energised strips gives the current a second way to the sheet: both read too
    much for contacts below the bridge and too little above it. Between CRS-CRS's energised strips, all on one
    supply, a bridge changes next to nothing.
    """
    return _second_way(view) if view.sensor.sensing_ratio == 0.0 else _tied(view)


def _tied(view: View) -> list[Suspect]:
    found = []
    for values in view.k.values():
        pairs = {
            i: b for i in range(view.strips - 1) if (b := neighbours(values, i)) and len(b.level) >= _FEW
        }
        free = {i: float(np.std(b.apart - b.slope)) for i, b in pairs.items()}
        for strip, pair in pairs.items():
            if free[strip] < 0.8 * float(np.median(list(free.values()))):
                continue
            edge, ends = strip in (0, view.strips - 2), _left_ends(view)
            above = pair.level >= np.median(pair.level)
            for part in (
                np.ones_like(above),
                ~above,
                above,
            ):  # a bridge half way up ties one end more than the other
                if part.sum() < _FEW:
                    continue
                d, e, both = (
                    _level_out(v[part], pair.level[part]) for v in (pair.apart, pair.slope, pair.together)
                )
                slope = float(np.std(e))
                tells = np.abs(e) > max(0.006, 3.0 * view.sigma)
                if (
                    tells.sum() < _MANY
                    or slope < 0.006
                    or _explained(e, ends[pair.rows[part], strip]) > _SHAPE
                ):
                    continue
                d, e, both = d[tells], e[tells], both[tells]
                follows = float(np.sum(d * e) / np.sum(e**2))
                # Two strips on one flat piece beside a jump differ as little, but then lie off the line together.
                little = float(np.mean(np.abs(d) < 0.35 * np.abs(e) + 2.0 * view.sigma))
                alone = float(np.mean(np.abs(both) < _ALONE * np.abs(e) + 1.5 * view.sigma))
                if abs(follows) > _FOLLOWS or little < _MOST[0] or alone < (_AT_EDGE if edge else _MOST[1]):
                    continue
                finding = Finding(
                    "short", _two(view, strip),
                    f"the two differ by {100 * np.mean(np.abs(d)):.2g} % of Vref where the strips around slope by "
                    f"+-{100 * slope:.2g} % a strip, over {len(d)} places: the difference follows the slope by "
                    f"{follows:.2f}, not 1",
                    {"follows": follows, "slope": slope, "places": len(d)},
                )  # fmt: skip
                found.append(Suspect(finding, free[strip], partial(_drop_two, strip=strip)))
    return found


def _level_out(values: FloatArray, level: FloatArray) -> FloatArray:
    """Return values without what changes smoothly with height, as offsets that fade at the ends do."""
    return without(values, level, level**2)


def _second_way(view: View) -> list[Suspect]:
    (values,) = view.k.values()
    pairs = {
        i: b for i in range(view.strips - 1) if (b := neighbours(values, i)) and len(b.level) >= 2 * _FEW
    }
    together, scatter = _by_height(list(pairs.values()), "together")  # (pairs, heights)
    apart, _ = _by_height(list(pairs.values()), "bent")
    wide = np.isfinite(together).sum(axis=1) >= 3
    if wide.sum() < 4:
        return []
    # What does not change with height is a unit without calibration.
    size, alone = (np.nanstd(np.where(wide[:, None], v, 0.0), axis=1) for v in (together, apart))
    left = np.sqrt(np.mean(np.nan_to_num(scatter) ** 2, axis=1))
    at = np.array(list(pairs))
    inner = wide & (at > 0) & (at < view.strips - 2)  # at the edges, lines go further astray
    found = []
    for row, strip in enumerate(pairs):
        heights = together[row][np.isfinite(together[row])]
        usual, most = _of_others(size, at, inner, strip)
        above = size[row] / max(usual, 1e-6)
        plain = wide[row] and size[row] > max(0.008, 3.0 * view.sigma, 0.6 * left[row])
        if (
            not plain
            or above < (_UNUSUAL if inner[row] else _UNUSUAL_AT_EDGE)
            or size[row] < _MOST_UNUSUAL * most
        ):
            continue
        if alone[row] > 0.45 * size[row] or not _falls(heights):
            continue
        if not _both_ways(pairs[strip].level, _left_ends(view)[pairs[strip].rows, strip]):
            continue
        finding = Finding(
            "short", _two(view, strip),
            f"both read {100 * heights.max():+.3g} to {100 * heights.min():+.3g} % of Vref beside their neighbours "
            f"from height to height, {above:.3g} times what other pairs do",
            {"most": float(heights.max()), "least": float(heights.min()), "times_others": above},
        )  # fmt: skip
        found.append(Suspect(finding, float(size[row]), partial(_drop_two, strip=strip)))
    return found


def _of_others(size: FloatArray, at: IntArray, inner: BoolArray, strip: int) -> tuple[float, float]:
    """Return what four in five other pairs do at most, and what all do but one that may be a second short."""
    others = inner & (np.abs(at - strip) > _WINDOW)
    if not others.any():
        return np.inf, np.inf
    worst = at[others][np.argmax(size[others])]
    rest = others & (np.abs(at - worst) > _WINDOW)
    return float(np.quantile(size[others], 0.8)), float(size[rest].max()) if rest.any() else 0.0


def _falls(heights: FloatArray) -> bool:
    """Whether what is read too much turns into too little as the contact goes up, at two heights or more."""
    clear = heights[np.abs(heights) > 0.15 * np.abs(heights).max()]
    return len(clear) >= 2 and bool((np.diff(np.sign(clear)) <= 0.0).all())


def _by_height(pairs: list[Beside], name: str) -> tuple[FloatArray, FloatArray]:
    """Return pairs' means over Vref beside what is usual among them (pairs, heights), and what scatters about them.

    Corners of the contact average out over places, or are alike for all pairs; NaN where there are few places.
    """
    edges = np.linspace(0.0, 1.0, _BINS + 1)[1:-1]
    means = np.full((len(pairs), _BINS), np.nan)
    scatter = np.full_like(means, np.nan)
    for row, pair in enumerate(pairs):
        height = np.searchsorted(edges, pair.level)
        aside = np.abs(pair.bent - np.median(pair.bent))
        for b in range(_BINS):
            here = np.flatnonzero(height == b)
            if len(here) >= _FEW:  # a corner under one of the two bends them apart, a bridge does not: take the straighter
                at = getattr(pair, name)[here[np.argsort(aside[here])[: len(here) // 2]]]
                means[row, b], scatter[row, b] = at.mean(), at.std()
    columns = (c[np.isfinite(c)] for c in means.T)
    return means - [np.median(c) if len(c) else np.nan for c in columns], scatter


def _left_ends(view: View) -> IntArray:
    """Return where the contact on each strip begins (places, strips), a strip's number."""
    starts = view.there.copy()
    starts[:, 1:] &= ~view.there[:, :-1]
    numbers = np.where(starts, np.arange(view.strips), 0)
    return np.asarray(np.maximum.accumulate(numbers, axis=1))


def _explained(values: FloatArray, ends: IntArray) -> float:
    """Return which share of the variance of values the contact's left end explains."""
    groups = [values[ends == e] for e in np.unique(ends)]
    free = len(values) - len(groups)
    if free < 1 or not np.ptp(values):
        return 1.0
    within = sum(float(np.sum((g - g.mean()) ** 2)) for g in groups) / free
    return 1.0 - within / float(np.var(values, ddof=1))


def _both_ways(level: FloatArray, ends: IntArray) -> bool:
    """Whether the contact moved across and along the strips, and not along one line, on which its shape is height."""
    return float(np.std(ends)) >= 0.3 and float(np.std(level)) >= 0.02 and _explained(level, ends) < _SHAPE


def _two(view: View, strip: int) -> tuple[int, ...]:
    return tuple(sorted(int(i) for i in view.order[strip : strip + 2]))


def _drop_two(view: View, strip: int) -> None:
    view.drop(strip)
    view.drop(strip + 1)
