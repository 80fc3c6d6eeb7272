"""What is joined to the wrong place: v_h with v_l, Vref with ground, one strip with another."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.diagnose.beside import neighbours
from tacstrip.diagnose.finding import Finding
from tacstrip.diagnose.fits import came_back
from tacstrip.diagnose.view import Suspect, View, residuals

_CROSSED = 0.01  # over Vref: k_h - k_l below minus this cannot be (3.3), (3.4)
_OFFSETS = 0.08  # over Vref: what a unit without calibration may add to k_h - k_l
_TURNS = 0.8  # correlation of k_h - k_l with what the neighbours want, its sign turned
_STRIPS, _SURE = 4, 5.0  # on so many strips offsets differ; standard errors of their mean
_SHARE = 0.8  # of the places that tell
_FEW = 8  # places
_MOVES, _ALONG = 0.2, 0.4  # over Vref, what neighbours must move; correlation
_OFF_LINE = 0.75  # of the slope around: what two strips may lie off it together
_FOOTPRINTS = 5  # different ones of contacts that end between two strips, if all lie on one side
_UNUSUAL = 2.0  # times what other pairs differ from the slope around them


def swapped_wires(view: View) -> list[Suspect]:
    """Find strips with k_h below k_l: a contact's upper end is never lower than its lower end."""
    if view.pair is None:
        return []
    found = []
    difference = view.pair[0] - view.pair[1]
    tell = np.abs(difference) > max(_CROSSED, 3.0 * view.sigma)
    wrong = tell & (difference < 0.0)
    known = np.isfinite(difference).sum(axis=0)
    mean = np.nan_to_num(difference).sum(axis=0) / np.maximum(known, 1)
    clear = mean < -np.maximum(_CROSSED, 7.0 * view.sigma / np.sqrt(np.maximum(known, 1)))
    often = wrong.sum(axis=0) >= np.maximum(min(3, len(tell)), _SHARE * tell.sum(axis=0))
    (e_h, r_h), (e_l, r_l) = (residuals(view, name) for name in ("kh", "kl"))
    as_is = np.abs(r_h) + np.abs(r_l)
    crossed = np.abs(view.pair[1] - e_h) + np.abs(view.pair[0] - e_l)
    exchanged = np.flatnonzero(clear & often)
    least = _OFFSETS if view.sensor.calibration is None else 2.0 * _CROSSED
    touched = known > 0
    if len(exchanged) > max(2, 0.6 * np.count_nonzero(touched)) and _all_below(mean[touched], least):
        told = (
            f"v_h lies below v_l on {len(exchanged)} of {np.count_nonzero(touched)} strips that were touched"
        )
        whole = Finding("swapped-wires", (), told, {"strips": len(exchanged)})
        return [Suspect(whole, -float(mean[exchanged].mean()), _swap_all_wires)]
    for strip in exchanged:
        at = np.isfinite(as_is[:, strip]) & tell[:, strip]
        now, then = (float(c[at, strip].mean()) if at.any() else 0.0 for c in (as_is, crossed))
        if then > now and at.any():  # a channel on its own is off: its neighbours know better
            continue
        if not _against(difference[at, strip], (e_h - e_l)[at, strip], float(mean[strip]), least, view.sigma):
            continue
        count, of = int(wrong[:, strip].sum()), int(tell[:, strip].sum())
        finding = Finding(
            "swapped-wires", (int(view.order[strip]),),
            f"v_h lies {-100 * mean[strip]:.3g} % of Vref below v_l, in {count} of {of} places that tell",
            {"difference": float(mean[strip]), "places": count, "of": of},
        )  # fmt: skip
        found.append(Suspect(finding, max(now - then, 1e-3) / 2.0, partial(_swap_wires, strip=int(strip))))
    return found


def _all_below(mean: FloatArray, least: float) -> bool:
    """Whether k_h - k_l (strips,) lies further below 0 than offsets take it: by much, or on all strips alike."""
    if np.median(mean) < -least:
        return True
    doubt = _SURE * float(np.std(mean)) / np.sqrt(len(mean))
    return len(mean) >= _STRIPS and float(np.mean(mean)) < -max(least / 2.0, doubt)


def _against(difference: FloatArray, wanted: FloatArray, mean: float, least: float, sigma: float) -> bool:
    """Whether k_h - k_l runs against what a strip's neighbours want of it (places,), and no offset explains that.

    An offset adds one number to all places. Exchanged wires turn the sign: what is thick on the neighbours lies far
    below 0, and where contacts grow the difference falls.
    """
    if not len(wanted):
        return mean < -least
    level = float(wanted.mean())
    below = -2.0 * mean > least and mean - level < -least and -mean > level / 2.0
    grows = float(np.std(wanted))
    if len(wanted) < _FEW or grows < max(2.0 * _CROSSED, 3.0 * sigma) or not np.ptp(difference):
        return below
    along = float(np.corrcoef(wanted, difference)[0, 1])
    return along < -_TURNS or (below and along < 0.0)


def _swap_wires(view: View, strip: int) -> None:
    kh, kl = view.k["kh"], view.k["kl"]
    kh[:, strip], kl[:, strip] = kl[:, strip].copy(), kh[:, strip].copy()


def _swap_all_wires(view: View) -> None:
    view.k["kh"], view.k["kl"] = view.k["kl"], view.k["kh"]


def swapped_ends(view: View) -> list[Suspect]:
    """Find strips that fit their neighbours upside down: 1 - k_l for k_h, 1 - k_h for k_l, 1 - k for k."""
    found = []
    turned = {"kh": "kl", "kl": "kh", "k": "k"}
    as_is, upside_down, moves = [], [], []
    for name in view.k:
        e, r = residuals(view, name)
        other = 1.0 - view.k.get(turned[name], view.k[name])
        as_is.append(np.abs(r))
        upside_down.append(np.abs(other - e))
        moves.append([_goes_along(e[:, i], other[:, i]) for i in range(view.strips)])
    now, then = (np.mean(costs, axis=0) for costs in (as_is, upside_down))
    known = np.isfinite(now) & np.isfinite(then)
    for strip in np.flatnonzero(known.any(axis=0) & np.all(moves, axis=0)):
        a, b = now[known[:, strip], strip], then[known[:, strip], strip]
        worth = float(a.mean() - b.mean())
        if a.mean() > (0.15 if len(a) > 2 else 0.3) and b.mean() < 0.35 * a.mean():
            found.append(
                Suspect(
                    Finding(
                        "swapped-ends", (int(view.order[strip]),),
                        f"lies {100 * a.mean():.3g} % of Vref from what its neighbours expect, and upside down "
                        f"{100 * b.mean():.2g} %, over {len(a)} place(s)",
                        {"misfit": float(a.mean()), "upside_down": float(b.mean()), "places": float(len(a))},
                    ),
                    worth,
                    partial(_turn, strip=int(strip)),
                )
            )  # fmt: skip
    return found


def _goes_along(expected: FloatArray, values: FloatArray) -> bool:
    """Whether values rise where they should: at one height alone, another contact may read the same upside down."""
    known = np.isfinite(expected) & np.isfinite(values)
    e, v = expected[known], values[known]
    if len(e) < _FEW or np.ptp(np.percentile(e, [5.0, 95.0])) < _MOVES or not np.ptp(v):
        return False
    return bool(np.corrcoef(e, v)[0, 1] > _ALONG)


def _turn(view: View, strip: int) -> None:
    if view.pair is not None:
        _swap_wires(view, strip)
    for values in view.k.values():
        values[:, strip] = 1.0 - values[:, strip]


def swapped_strips(view: View) -> list[Suspect]:
    """Find neighbours in the wrong order, by the edges of contacts and by the slope of signatures across them."""
    tells = {i: _Slope.of(view, i) for i in range(view.strips - 1)}
    usual = float(np.median([t.right for t in tells.values() if t.places] or [0.0]))
    found = []
    for strip, slope in tells.items():
        against, left, right, footprints = _edges(view, strip)
        one_sided = min(left, right) == 0 and not (slope.places >= _FEW and slope.wrong < 0.6 * slope.right)
        alike = footprints < _FOOTPRINTS and not _at_edge(view, strip) and slope.wrong > 0.9 * slope.right
        often = left + right >= 2 * _FEW and against == 0 and not alike
        edges = left + right >= 4 and left + right >= 5 * against and (often or not one_sided)
        runs_back = (
            slope.clear
            and slope.wrong < (0.25 if _at_edge(view, strip) else 0.4) * slope.right
            and slope.right > _UNUSUAL * usual
            and slope.back
        )
        if runs_back or (edges and not (slope.clear and slope.right < 0.7 * slope.wrong)):
            told = []
            if runs_back:
                told.append(
                    f"their difference runs against the slope around: {100 * slope.right:.3g} % of Vref off in "
                    f"{slope.places} places, {100 * slope.wrong:.2g} % with the two exchanged"
                )
            if edges:
                told.append(
                    f"contacts that end there have a gap in {left + right} places, and none with the two exchanged"
                )
            finding = Finding(
                "swapped-strips", tuple(sorted(int(i) for i in view.order[strip : strip + 2])), "; ".join(told),
                {"misfit": slope.right, "exchanged": slope.wrong, "places": slope.places, "edges": left + right},
            )  # fmt: skip
            found.append(
                Suspect(finding, max(slope.right - slope.wrong, 0.03), partial(_exchange, strip=strip))
            )
    return found


@dataclass(frozen=True)
class _Slope:
    """Two neighbours' difference D against the slope E around them, over Vref.

    right, wrong: root mean square of D - E and of D + E, without their means: these take up what a sensor without
    calibration adds. clear: whether E changed by enough, in enough places, and the two lie on the line around them.
    back: whether the contact came back to its heights.
    """

    right: float
    wrong: float
    places: int
    clear: bool
    back: bool

    @classmethod
    def of(cls, view: View, strip: int) -> _Slope:
        pairs = [b for values in view.k.values() if (b := neighbours(values, strip))]
        if not pairs:
            return cls(0.0, 0.0, 0, False, False)
        right, wrong, slope = (
            float(np.sqrt(np.mean([np.var(v) for v in values])))
            for values in (
                [p.bent for p in pairs],
                [p.apart + p.slope for p in pairs],
                [p.slope for p in pairs],
            )
        )
        off = float(np.median(np.concatenate([np.abs(p.together - np.median(p.together)) for p in pairs])))
        places = min(len(p.slope) for p in pairs)
        clear = places >= _FEW and slope > max(0.004, 4.0 * view.sigma) and off < _OFF_LINE * slope
        return cls(right, wrong, places, clear, all(came_back(p.level, view.sigma) for p in pairs))


def _exchange(view: View, strip: int) -> None:
    for array in (*view.k.values(), view.there):
        array[:, [strip, strip + 1]] = array[:, [strip + 1, strip]]
    view.order[[strip, strip + 1]] = view.order[[strip + 1, strip]]


def _at_edge(view: View, strip: int) -> bool:
    """Whether contacts go on to one side of two neighbours only."""
    return strip in (0, view.strips - 2)


def _edges(view: View, strip: int) -> tuple[int, int, int, int]:
    """Count the places where a contact ends between two neighbours, and those where it would with the two exchanged.

    The latter for contacts to the left of the two and to the right, and how many different footprints these had: a
    contact with a gap has it on one side, and moves it along.
    """
    clear = _clear(view, slice(max(strip - 1, 0), strip + 3))
    padded = np.pad(view.there, ((0, 0), (1, 1)))
    a, b, c, d = padded[clear, strip : strip + 4].T
    first, last = (
        strip == 0,
        strip == view.strips - 2,
    )  # beside them lies nothing that a contact could go on to
    ends = (a & b & ~c & ~d) | (~a & ~b & c & d) | (first & b & ~c & ~d) | (last & c & ~b & ~a)
    left = (a | first) & ~b & c & ~d
    right = ~a & b & ~c & (d | last)
    footprints = len(np.unique(view.there[clear][left | right], axis=0))
    return int(ends.sum()), int(left.sum()), int(right.sum()), footprints


def _clear(view: View, window: slice) -> BoolArray:
    """Return the places where what touches a few strips reads so far from rest that no strip of it goes unnoticed."""
    if view.sensor.rest_volt is None or view.sensor.touch_volt is None:
        return np.ones(len(view.there), dtype=bool)
    rest, touch = (v / view.sensor.vref_volt for v in (view.sensor.rest_volt, view.sensor.touch_volt))
    away = np.min([np.abs(v[:, window] - rest) for v in view.k.values()], axis=0)
    return np.asarray(~((away < 3.0 * touch) & view.there[:, window]).any(axis=1))
