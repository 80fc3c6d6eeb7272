"""Bridges between neighbouring strips or their wires."""

from __future__ import annotations

from functools import partial

import numpy as np

from tacstrip.diagnose.beside import Beside, neighbours
from tacstrip.diagnose.finding import Finding
from tacstrip.diagnose.view import Suspect, View

_FEW = 8  # places
_FOLLOWS = 0.35  # of the slope around; 1 for two strips of their own, 0 for two that are tied
_ALONE = 0.75  # of the slope: what tied strips may lie off the line together; 1.5 beside a jump
_UNUSUAL = 2.0  # times what other pairs differ from the slope around them
_EXCESS = 4.0  # times what other pairs do


def shorts(view: View) -> list[Suspect]:
    """Find neighbours that are tied together.

    Tied sensing strips or wires read one voltage, whatever the slope of the contact. Over metal, where strips are
    energised in turn, a bridge between energised strips gives the current a second way to the sheet: both read too
    much for contacts below the bridge and too little above it. Between CRS-CRS's energised strips, all on one
    supply, a bridge changes next to nothing.
    """
    return [*_tied(view), *(_second_way(view) if view.sensor.sensing_ratio == 0.0 else [])]


def _tied(view: View) -> list[Suspect]:
    found = []
    for values in view.k.values():
        pairs = {i: b for i in range(view.strips - 1) if (b := neighbours(values, i)) and len(b.level) >= _FEW}
        free = {i: float(np.std(b.apart - b.slope)) for i, b in pairs.items()}
        for strip, pair in pairs.items():
            if free[strip] < _UNUSUAL * float(np.median(list(free.values()))):
                continue
            above = pair.level >= np.median(pair.level)
            for part in (np.ones_like(above), ~above, above):  # a bridge half way up ties one end more than the other
                d, e, both = pair.apart[part], pair.slope[part], pair.together[part]
                slope = float(np.std(e))
                if len(d) < _FEW or slope < max(0.006, 5.0 * view.sigma):
                    continue
                follows = float(np.sum((d - d.mean()) * (e - e.mean())) / np.sum((e - e.mean()) ** 2))
                # Two strips on one flat piece beside a jump differ as little, but then lie off the line together.
                if abs(follows) > _FOLLOWS or np.std(d) > 0.5 * np.std(d - e) or np.std(both) > _ALONE * slope:
                    continue
                finding = Finding(
                    "short", _two(view, strip),
                    f"the two differ by {100 * np.mean(np.abs(d)):.2g} % of Vref where the strips around slope by "
                    f"+-{100 * slope:.2g} % a strip, over {len(d)} places: the difference follows the slope by "
                    f"{follows:.2f}, not 1",
                    {"follows": follows, "slope": slope, "places": float(len(d))},
                )  # fmt: skip
                found.append(Suspect(finding, free[strip], partial(_drop_two, strip=strip)))
    return found


def _second_way(view: View) -> list[Suspect]:
    pairs: dict[int, Beside] = {}
    for strip in range(view.strips - 1):
        for values in view.k.values():
            beside = neighbours(values, strip)
            if beside is not None and len(beside.level) >= _FEW:
                pairs[strip] = beside
    if not pairs:
        return []
    usual = float(np.median([np.std(p.together) for p in pairs.values()]))
    found = []
    for strip, pair in pairs.items():
        common, size = pair.together, float(np.std(pair.together))
        alone = float(np.std(pair.apart - pair.slope))
        if size > max(0.015, 5.0 * view.sigma, _EXCESS * usual) and alone < 0.25 * size:
            low, high = (float(common[i]) for i in (np.argmin(pair.level), np.argmax(pair.level)))
            finding = Finding(
                "short", _two(view, strip),
                f"both read {100 * common.min():+.3g} to {100 * common.max():+.3g} % of Vref beside their neighbours, "
                f"{100 * low:+.3g} % for the lowest contact and {100 * high:+.3g} % for the highest: other pairs scatter by "
                f"{100 * usual:.2g} %",
                {"low": low, "high": high, "scatter": size, "others": usual, "places": float(len(common))},
            )  # fmt: skip
            found.append(Suspect(finding, size, partial(_drop_two, strip=strip)))
    return found


def _two(view: View, strip: int) -> tuple[int, ...]:
    return tuple(sorted(int(i) for i in view.order[strip : strip + 2]))


def _drop_two(view: View, strip: int) -> None:
    view.drop(strip)
    view.drop(strip + 1)
