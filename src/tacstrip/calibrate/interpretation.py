"""Other ways to read runs that do not fit: units, exchanged columns, the other end, strips from the other side."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.calibrate.choose import told
from tacstrip.calibrate.goodness import Goodness, judge_fit
from tacstrip.calibrate.residuals import residuals
from tacstrip.errors import SpecError
from tacstrip.io.runs import Runs
from tacstrip.sensor.spec import Sensor

_FAR_BETTER = 1.0 / 3.0  # of what is left as the runs are read: another way to read them must leave less
_LEAST = 0.003  # over Vref: a misfit below this is no misreading
_UNITS = {
    10.0: "centimetres",
    1000.0: "metres",
    25.4: "inches",
    0.1: "tenths of a millimetre",
    0.001: "micrometres",
}


def misread(sensor: Sensor, runs: Runs, as_read: Goodness) -> str:
    """Say how the runs must be read instead, where that leaves far less; "" where nothing is told.

    Parameters
    ----------
    sensor
        The spec, without a calibration.
    as_read
        What the fit of the runs as they are leaves.
    """
    if not as_read.implausible and not (as_read.beyond_noise and as_read.left > _LEAST):
        return ""
    best: tuple[float, str] | None = None
    for words, other in _readings(sensor, runs):
        try:
            found = judge_fit(sensor, told(sensor, other), other)
        except SpecError:
            continue
        if found.implausible or found.doubt or found.ill_strips():
            continue
        enough = found.left < _FAR_BETTER * as_read.left or (
            bool(as_read.implausible) and found.left < max(as_read.left, found.noise)
        )
        if enough and (best is None or found.left < best[0]):
            best = found.left, words
    if best is None:
        return ""
    left, words = best
    return (
        f"{words}: read so, the fit leaves {100.0 * left:.2g} % of Vref, and {100.0 * as_read.left:.2g} % as the runs "
        "are" + (f" ({as_read.implausible})" if as_read.implausible else "")
    )


def other_order(sensor: Sensor, runs: Runs) -> str:
    """Say that the strips are in reversed order, by the calibration that the spec has; "" where it has none or agrees.

    Presses across all strips cannot tell: every strip then has the same places.
    """
    if sensor.calibration is None:
        return ""
    as_is, reversed_ = (
        float(np.nanmedian(np.abs(np.stack(list(residuals(sensor, r).values())))))
        for r in (runs, replace(_backwards(runs), l_mm=runs.l_mm[:, ::-1], w_mm=runs.w_mm[:, ::-1]))
    )
    if as_is < _LEAST or reversed_ > _FAR_BETTER * as_is:
        return ""
    return (
        "the strips are in reversed order: by the calibration that the spec has, readings are off by "
        f"{100.0 * as_is:.2g} % of Vref as the runs are, and by {100.0 * reversed_:.2g} % with strips counted from "
        "the other side"
    )


def _readings(sensor: Sensor, runs: Runs) -> Iterator[tuple[str, Runs]]:
    """Give what people get wrong, in words, and the runs as then meant; only those that lie on the strips."""
    l, w, length = runs.l_mm, runs.w_mm, sensor.length_mm
    for factor, unit in _UNITS.items():
        yield from _placed(
            runs, sensor, l * factor, w * factor, f"l_mm and w_mm are in {unit}, not in millimetres"
        )
    yield from _placed(runs, sensor, w, l, "the columns l_mm and w_mm are exchanged")
    yield from _placed(runs, sensor, l, w - l, "w_mm holds the contact's upper end, not its length")
    yield from _placed(runs, sensor, l - w / 2.0, w, "l_mm holds the contact's middle, not its lower end")
    yield from _placed(runs, sensor, l - w, w, "l_mm holds the contact's upper end, not its lower one")
    mirrored = list(
        _placed(runs, sensor, length - l - w, w, "l_mm is counted from the end at Vref, not from ground")
    )
    yield from mirrored
    if "kh" in runs.raw and "kl" in runs.raw:
        yield "the columns of v_h and v_l are exchanged, or the wires are", _crossed(runs)
        for _, other in mirrored:
            yield (
                "Vref and ground are exchanged on the unit, or l_mm is counted from the end at Vref",
                _crossed(other),
            )
    yield "the strips are in reversed order: they are counted from the other side", _backwards(runs)


def _placed(
    runs: Runs, sensor: Sensor, l: FloatArray, w: FloatArray, words: str
) -> Iterator[tuple[str, Runs]]:
    """Give the runs with other places, where all of these lie on the strips and can be read."""
    length = sensor.length_mm
    slack = 1e-6 * length
    longest = length - slack if sensor.sensing_ratio == 0.0 else length  # metal from end to end reads nothing
    if (
        np.nanmin(l) >= -slack
        and -slack <= np.nanmin(w) <= np.nanmax(w) <= longest
        and np.nanmax(l + w) <= length + slack
    ):
        l = np.clip(l, 0.0, length)
        yield words, replace(runs, l_mm=l, w_mm=np.clip(w, 0.0, length - l))


def _crossed(runs: Runs) -> Runs:
    return replace(runs, raw={"kh": runs.raw["kl"], "kl": runs.raw["kh"]})


def _backwards(runs: Runs) -> Runs:
    """Return the runs with each strip's readings given to the strip as far from the other side."""
    if not (np.isfinite(runs.l_mm) == np.isfinite(runs.l_mm[:, ::-1])).all():
        return runs
    return replace(runs, raw={name: values[:, ::-1] for name, values in runs.raw.items()})
