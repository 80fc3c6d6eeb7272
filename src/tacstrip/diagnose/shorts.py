"""Bridges between neighbouring strips or their wires."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.diagnose.beside import Beside, bridges, neighbours
from tacstrip.diagnose.finding import Finding
from tacstrip.diagnose.fits import came_back, without
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
_STRENGTH = (0.65, 2.0)  # times what a bridge does to readings
_PLAIN = (0.7, 1.4)
_OUTSTANDING = 1.5  # times what two strips lie off the line in the middle
_LEFT, _LEFT_PLAIN, _LEFT_AT_EDGE = (
    0.28,
    0.42,
    0.2,
)  # of what two strips lie off the line, squared: what a bridge may leave
_TURNED = 0.006  # over Vref a strip
_HIGH_AND_LOW = 0.5  # over L: a bridge adds on one side and takes away on the other, which must be seen
_LENGTH = 0.6  # over L: contacts jump by their length at a bridge, and longer ones tell nothing
_SHAPE = 0.7  # of the slope's variance: where the contact lies must not say more, for then its shape does


def shorts(view: View) -> list[Suspect]:
    """Find neighbours that are tied together.

    Tied sensing strips or wires read one voltage, whatever the slope of the contact. Over metal, where strips are
    energised in turn, a bridge between energised strips gives the current a second way to the sheet: both read too
    much for contacts below the bridge and too little above it. Between CRS-CRS's energised strips, all on one
    supply, a bridge changes next to nothing.
    """
    return _bridged(view) if view.sensor.sensing_ratio == 0.0 else _tied(view)


def _tied(view: View) -> list[Suspect]:
    found = []
    ends = _left_ends(view)
    signatures = [SIGNATURES[name] for name in view.k]
    pairs = {i: [neighbours(view.k[s.name], i) for s in signatures] for i in range(view.strips - 1)}
    free = {i: max([float(np.std(b.bent)) for b in of if b], default=0.0) for i, of in pairs.items()}
    usual = float(np.median(list(free.values()))) if free else 0.0
    for strip, of in pairs.items():
        if free[strip] < 0.5 * usual or not all(came_back(b.level, view.sigma) for b in of if b):
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


def _bridged(view: View) -> list[Suspect]:
    found = []
    fits = list(bridges(view))
    usual = float(np.median([bridge.off for _, _, bridge in fits])) if fits else 0.0
    for strip, pair, bridge in fits:
        inner = 0 < strip < view.strips - 2  # at the edges, lines go further astray
        clear = _PLAIN[0] < bridge.strength < _PLAIN[1] and bridge.size > _OUTSTANDING * usual
        strength, left = (_PLAIN, _LEFT_PLAIN) if clear else (_STRENGTH, _LEFT)
        if not strength[0] < bridge.strength < strength[1] or bridge.left > (
            left if inner else _LEFT_AT_EDGE
        ):
            continue
        if (
            bridge.size < max(0.003, view.sigma)
            or bridge.places < _MANY
            or bridge.high - bridge.low > _LENGTH
        ):
            continue
        if not came_back(pair.level, view.sigma, _HIGH_AND_LOW) or not (inner or _turned(pair, view.sigma)):
            continue
        finding = Finding(
            "short", _two(view, strip),
            f"both read {100 * bridge.most:+.3g} to {100 * bridge.least:+.3g} % of Vref beside their neighbours from "
            f"height to height, {bridge.strength:.2g} times what a bridge does; it leaves {100 * bridge.left:.2g} % "
            "of what they lie off",
            {"most": bridge.most, "least": bridge.least, "strength": bridge.strength, "left": bridge.left},
        )  # fmt: skip
        found.append(Suspect(finding, bridge.size, partial(_drop_two, strip=strip)))
    return found


def _turned(pair: Beside, sigma: float) -> bool:
    """Whether the line beside two strips had other slopes at one height.

    At the sensor's edge it is drawn beyond the strips that it goes through, and goes astray by the contact's shape:
    where that stayed the same, by an amount that goes with height, as a bridge's does.
    """
    return bool(np.std(without(pair.slope, pair.level, pair.level**2)) > max(_TURNED, 3.0 * sigma))


def _left_ends(view: View) -> IntArray:
    """Return where the contact on each strip begins (places, strips), a strip's number."""
    starts = view.there.copy()
    starts[:, 1:] &= ~view.there[:, :-1]
    numbers = np.where(starts, np.arange(view.strips), 0)
    return np.asarray(np.maximum.accumulate(numbers, axis=1))


def _explained(values: FloatArray, ends: IntArray) -> float:
    """Return which share of the variance of values the contact's left end explains."""
    group = np.unique(ends, return_inverse=True)[1]
    count, means = np.bincount(group), np.bincount(group, values) / np.bincount(group)
    free = len(values) - len(count)
    if free < 1 or not np.ptp(values):
        return 1.0
    within = float(np.sum((values - means[group]) ** 2)) / free
    return 1.0 - within / float(np.var(values, ddof=1))


def _two(view: View, strip: int) -> tuple[int, ...]:
    return tuple(sorted(int(i) for i in view.order[strip : strip + 2]))


def _drop_two(view: View, strip: int) -> None:
    view.drop(strip)
    view.drop(strip + 1)
