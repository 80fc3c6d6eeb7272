"""Bridges between neighbouring strips or their wires."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.diagnose.beside import Beside, neighbours
from tacstrip.diagnose.finding import Finding
from tacstrip.diagnose.fits import without
from tacstrip.diagnose.view import Suspect, View
from tacstrip.sensor.constructions import SIGNATURES

_FEW, _MANY = 8, 25  # places
_HEIGHTS = np.linspace(0.0, 1.0, 9)  # over L, at which a bridge is looked for
_CLEAR = 0.1  # over Vref: contacts this far from a bridge lie wholly on one side
_FOLLOWS = 0.15  # of the slope around; 1 for two strips of their own, 0 for two that are tied
_ALONE = 0.75  # of the slope: what tied strips may lie off the line together; 1.5 beside a jump
_MOST = (
    0.95,
    0.35,
)  # of the places where the slope tells: those that differ little, and that lie near the line
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
    ends = _left_ends(view)
    signatures = [SIGNATURES[name] for name in view.k]
    pairs = {i: [neighbours(view.k[s.name], i) for s in signatures] for i in range(view.strips - 1)}
    free = {i: max([float(np.std(b.bent)) for b in of if b], default=0.0) for i, of in pairs.items()}
    usual = float(np.median(list(free.values()))) if free else 0.0
    for strip, of in pairs.items():
        if free[strip] < 0.8 * usual:
            continue
        best: Finding | None = None
        for height in _HEIGHTS:
            # A bridge ties v_h of contacts below it, and v_l of contacts above it.
            parts = [
                (b, (b.level < height - _CLEAR) if s.at_upper_end else (b.level > height + _CLEAR))
                for s, b in zip(signatures, of, strict=True)
                if b is not None
            ]
            finding = _tied_at(
                view, strip, [_Part.of(b, at, ends, strip) for b, at in parts if at.sum() >= _FEW]
            )
            if finding and (best is None or finding.numbers["places"] > best.numbers["places"]):
                best = finding
        if best is not None:
            found.append(Suspect(best, float(free[strip]), partial(_drop_two, strip=strip)))
    return found


@dataclass(frozen=True, eq=False)
class _Part:
    """Two neighbours beside the strips around, without what changes smoothly with height."""

    apart: FloatArray
    slope: FloatArray
    together: FloatArray
    ends: IntArray

    @classmethod
    def of(cls, beside: Beside, at: BoolArray, ends: IntArray, strip: int) -> _Part:
        level = beside.level[at]  # offsets that fade at the ends do
        d, e, both = (without(v[at], level, level**2) for v in (beside.apart, beside.slope, beside.together))
        return cls(d, e, both, ends[beside.rows[at], strip])


def _tied_at(view: View, strip: int, parts: list[_Part]) -> Finding | None:
    """Judge the places where a bridge at some height would tie two strips."""
    if not parts:
        return None
    d, e, both = (
        np.concatenate([getattr(p, name) for p in parts]) for name in ("apart", "slope", "together")
    )
    slope = float(np.std(e))
    tells = np.abs(e) > max(0.006, 3.0 * view.sigma)
    many = _MANY if 0 < strip < view.strips - 2 else 2 * _MANY  # at an edge the line is drawn further
    if tells.sum() < many or _explained(e, np.concatenate([p.ends for p in parts])) > _SHAPE:
        return None
    d, e, both = d[tells], e[tells], both[tells]
    follows = float(np.sum(d * e) / np.sum(e**2))
    # Two strips on one flat piece beside a jump differ as little, but then lie off the line together.
    little = float(np.mean(np.abs(d) < 0.35 * np.abs(e) + 2.0 * view.sigma))
    alone = float(np.mean(np.abs(both) < _ALONE * np.abs(e) + 1.5 * view.sigma))
    if abs(follows) > _FOLLOWS or little < _MOST[0] or alone < _MOST[1]:
        return None
    return Finding(
        "short", _two(view, strip),
        f"they differ by {100 * np.mean(np.abs(d)):.2g} % of Vref where the strips around slope by "
        f"+-{100 * slope:.2g} % a strip, over {len(d)} readings: they follow the slope by {follows:.2f}, not 1",
        {"follows": follows, "slope": slope, "places": len(d)},
    )  # fmt: skip


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
        plain = wide[row] and size[row] > max(0.003, 2.0 * view.sigma, 0.6 * left[row])
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
            if (
                len(here) >= _FEW
            ):  # a corner under one of the two bends them apart, a bridge does not: take the straighter
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
