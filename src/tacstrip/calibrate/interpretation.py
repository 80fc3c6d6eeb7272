"""Other ways to read runs that do not fit: units, exchanged columns, the other end, strips from the other side."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.calibrate.fit import ModelFit, fit_model
from tacstrip.calibrate.goodness import Goodness, assess_fit
from tacstrip.calibrate.linearised import jacobian
from tacstrip.calibrate.model import PARTS, Constants, initial_constants, predict
from tacstrip.calibrate.model_selection import fit_planned, planned_model, select_model
from tacstrip.calibrate.residuals import residuals
from tacstrip.errors import SpecError
from tacstrip.io.runs import Runs
from tacstrip.sensor.spec import Sensor

_FAR_BETTER = 1.0 / 3.0  # of the residual as the runs are read: another interpretation must leave less
# Times the residual of a usable fit: where the planned model leaves more, no part of it is usable.
_HOPELESS = 2.0
_LEAST = 0.003  # over Vref: a residual below this is no misreading
_SLANTED = 0.1  # of the length, from strip to strip: a press that tells strips apart
_ASSIGNMENTS = 3  # fits at most
_SURELY_MOVED = 20.0  # variances of the noise that another place must leave less
_LIKELIER = 10.0  # the logarithm of how many times: single places that contradict themselves make less
_LEAST_PRIOR = 1e-3  # of Vref: what the prior's rows weigh, as a noise
_EXCHANGED = 0.01  # over Vref: a strip whose readings are another's is further off
_UNITS = {
    10.0: "centimetres",
    1e3: "metres",
    25.4: "inches",
    0.1: "tenths of a millimetre",
    1e-3: "micrometres",
}


def misread(sensor: Sensor, runs: Runs, as_read: Goodness) -> str:
    """Say how the runs must be read instead, where that leaves a far smaller residual; "" otherwise.

    Parameters
    ----------
    sensor
        The spec, without a calibration.
    as_read
        Goodness of fit of the runs as they are.
    """
    if not as_read.implausible and not (as_read.beyond_noise and as_read.residual > _LEAST):
        return ""
    best: tuple[float, str] | None = None
    for words, other in _interpretations(sensor, runs):
        if _hopeless(sensor, other):
            continue
        try:
            found = assess_fit(sensor, fit_planned(sensor, other), other)
        except SpecError:
            continue
        if found.implausible or found.doubt or found.poor_strips:
            continue
        enough = found.residual < _FAR_BETTER * as_read.residual or (
            bool(as_read.implausible) and found.residual < max(as_read.residual, found.noise)
        )
        if enough and (best is None or found.residual < best[0]):
            best = found.residual, words
    if best is None:
        return ""
    residual, words = best
    return (
        f"{words}: read so, the fit leaves {100.0 * residual:.2g} % of Vref, and {100.0 * as_read.residual:.2g} % as "
        "the runs are" + (f" ({as_read.implausible})" if as_read.implausible else "")
    )


def _hopeless(sensor: Sensor, runs: Runs) -> bool:
    """Tell by one fit, of the planned model, that none of the smaller ones that it holds can be used either."""
    try:
        whole = assess_fit(sensor, fit_model(planned_model(sensor), sensor, runs), runs)
    except SpecError:
        return False
    return whole.residual > _HOPELESS * whole.most


def reversed_order(sensor: Sensor, runs: Runs) -> str:
    """Say that the strips are in reversed order, by the calibration that the spec has; "" where it has none or agrees.

    Presses across all strips cannot tell: every strip then has the same places.
    """
    if sensor.calibration is None:
        return ""
    as_is, reversed_ = (
        float(np.nanmedian(np.abs(np.stack(list(residuals(sensor, r).values())))))
        for r in (runs, replace(_reversed_strips(runs), l_mm=runs.l_mm[:, ::-1], w_mm=runs.w_mm[:, ::-1]))
    )
    if as_is < _LEAST or reversed_ > _FAR_BETTER * as_is:
        return ""
    return (
        "the strips are in reversed order: by the calibration that the spec has, readings are off by "
        f"{100.0 * as_is:.2g} % of Vref as the runs are, and by {100.0 * reversed_:.2g} % with strips counted from "
        "the other side"
    )


def exchanged_strips(sensor: Sensor, runs: Runs, fit: ModelFit) -> str:
    """Say which strips' readings are exchanged, by presses that lie slanted across the strips; "" where none are.

    Bars that lie straight give every strip the same places, and each strip's own constants take up what it reads.
    A slanted press among them contradicts these constants, and agrees with those of the strip that it was read on. It
    touches a wide strip not in a point, but over the rise from one strip to the next, which is no contradiction.
    """
    there = np.isfinite(runs.l_mm).all(axis=1)
    slanted = there & (np.ptp(np.nan_to_num(runs.l_mm), axis=1) > _SLANTED * sensor.length_mm)
    if not slanted.any() or (there & ~slanted).sum() <= slanted.sum():
        return ""
    constants, strips = fit.constants, sensor.strips
    off = np.zeros((strips, strips))  # squares, of each strip's readings at each strip's places
    for place in range(strips):
        l, w = (np.repeat(v[slanted, place][:, None], strips, axis=1) for v in (runs.l_mm, runs.w_mm))
        found = predict(constants, sensor, l, w)
        off[:, place] = np.mean([(runs.raw[n][slanted] - k) ** 2 for n, k in found.items()], axis=(0, 1))
    right = linear_sum_assignment(off)[1]
    moved = np.flatnonzero(right != np.arange(strips))
    rise = np.abs(np.diff(runs.l_mm[slanted])).mean() / sensor.length_mm
    alike = max(_EXCHANGED, 0.5 * rise, *(5.0 * sigma for sigma in fit.sigma.values()))
    if not len(moved) or np.sqrt(off[np.arange(strips), right].max()) > alike:
        return ""
    if np.sqrt(np.diag(off)[moved].min()) < alike:
        return ""
    if np.array_equal(right, np.arange(strips)[::-1]):
        return (
            "the presses that lie slanted across the strips lie the other way than the runs say: were their l entered "
            "from the wrong side, or are the strips counted from the other side?"
        )
    return f"strips are exchanged, by the presses that lie slanted across them: {_pairs(right, sensor.strip_base)}"


@dataclass(frozen=True, eq=False)
class Assignment:
    """Runs with strips' readings at other strips' places, which the planned model describes better there.

    Attributes
    ----------
    right
        The strip whose places each strip's readings belong to (strips,).
    runs, fit
        The runs as then meant, and the planned model's fit to them.
    """

    right: IntArray
    runs: Runs
    fit: ModelFit

    def words(self, base: int) -> str:
        """Say which strips are exchanged."""
        if np.array_equal(self.right, np.arange(len(self.right))[::-1]):
            return "the strips are in reversed order: they are counted from the other side"
        return f"strips are exchanged: {_pairs(self.right, base)}"


def other_assignment(sensor: Sensor, runs: Runs, noise: float) -> Assignment | None:
    """Return the best assignment of readings to strips' places; None where it is that of the runs.

    Bars that lie straight cannot tell. Slanted ones do, though each strip's offset and gain take up most of what its
    places are off by: assignments are compared by what the planned model, linearised, leaves of each strip's readings
    at each strip's places (the Hungarian method, Kuhn 1955), with the constants that strips share fitted in turn.
    """
    strips = np.flatnonzero(np.isfinite(runs.l_mm).any(axis=0))
    there = np.asarray(np.isfinite(runs.l_mm[:, strips]).all(axis=1))
    if len(strips) < 2 or not np.ptp(np.stack([runs.l_mm, runs.w_mm])[:, there][:, :, strips], axis=2).any():
        return None
    constants = initial_constants(planned_model(sensor), sensor, runs.signatures)
    found: Assignment | None = None
    for _ in range(_ASSIGNMENTS):
        left = _left_at_places(sensor, runs, constants, there)[np.ix_(strips, strips)]
        left += _SURELY_MOVED * noise**2 * (1.0 - np.eye(len(strips)))
        right = np.arange(sensor.strips)
        right[strips] = strips[linear_sum_assignment(left)[1]]
        if found and np.array_equal(right, found.right):
            break
        if np.array_equal(right, np.arange(sensor.strips)):
            return None
        order = np.argsort(right)
        other = replace(runs, raw={name: values[:, order] for name, values in runs.raw.items()})
        found = Assignment(right, other, fit_planned(sensor, other))
        shared = [found.fit.constants.value(part) for part in constants.model.shared]
        constants = replace(constants, shared=np.array(shared))
    return found


def exchanged_places(sensor: Sensor, as_read: Goodness, other: Assignment) -> str:
    """Say that strips are exchanged where another assignment leaves far less of their readings; "" otherwise."""
    moved = other.right != np.arange(sensor.strips)
    try:
        found = assess_fit(sensor, other.fit, other.runs)
    except SpecError:
        return ""
    as_is, as_moved = (float(np.sqrt(np.mean(g.strips[moved] ** 2))) for g in (as_read, found))
    beyond = as_is > (2.0 if as_read.repeated else 1.0) * as_read.noise
    if found.doubt or found.poor_strips or not beyond or as_moved > _FAR_BETTER * as_is:
        return ""
    return (
        f"{other.words(sensor.strip_base)}: read so, the fit leaves {100.0 * as_moved:.2g} % of Vref on them, and "
        f"{100.0 * as_is:.2g} % as the runs are"
    )


def likelier_assignment(sensor: Sensor, fit: ModelFit, other: Assignment) -> str:
    """Say that strips are exchanged where the best model makes the readings far likelier so; "" otherwise.

    Uneven rubber leaves much of either, and parts that describe it take up what places are off by.
    """
    times = select_model(sensor, other.runs)[0].evidence - fit.evidence
    if times < _LIKELIER:
        return ""
    return f"{other.words(sensor.strip_base)}: read so, the runs are e^{times:.0f} times likelier"


def _left_at_places(sensor: Sensor, runs: Runs, constants: Constants, there: BoolArray) -> FloatArray:
    """Return the squares that the linearised model leaves of strips' readings at strips' places (readings, places)."""
    l, w = (np.where(np.isfinite(v), v, 0.0)[there] for v in (runs.l_mm, runs.w_mm))
    plain = replace(constants, own=np.zeros_like(constants.own))
    by = jacobian(sensor, plain, l, w)  # (signatures, contacts, strips, parameters)
    names = (*constants.model.shared, *constants.names)
    prior = np.diag([1.0 / PARTS[n.split()[0]].prior for n in names])
    predicted = np.stack(list(predict(plain, sensor, l, w).values()))
    read = np.nan_to_num(np.stack([runs.raw[n][there] for n in runs.signatures])).reshape(-1, sensor.strips)
    left = np.zeros((sensor.strips, sensor.strips))
    for place in range(sensor.strips):
        off = read - predicted[:, :, place].reshape(-1, 1)
        rows = np.concatenate([by[:, :, place].reshape(len(off), -1), _LEAST_PRIOR * prior])
        q = np.linalg.qr(rows)[0][: len(off)]
        left[:, place] = (off**2).sum(axis=0) - ((q.T @ off) ** 2).sum(axis=0)
    return left


def _pairs(right: IntArray, base: int) -> str:
    """Return which strip's place each strip's readings belong to, of those that are another's."""
    moved = np.flatnonzero(right != np.arange(len(right)))
    return "strip " + ", ".join(f"{i + base} is {right[i] + base}" for i in moved)


def _interpretations(sensor: Sensor, runs: Runs) -> Iterator[tuple[str, Runs]]:
    """Yield common mistakes, in words, and the runs as then meant; only those whose contacts lie on the strips."""
    l, w, length = runs.l_mm, runs.w_mm, sensor.length_mm
    mirrored = "l_mm is counted from the end at Vref, not from ground"
    places = {
        f"l_mm and w_mm are in {unit}, not in millimetres": (l * factor, w * factor)
        for factor, unit in _UNITS.items()
    } | {
        "the columns l_mm and w_mm are exchanged": (w, l),
        "w_mm holds the contact's upper end, not its length": (l, w - l),
        "l_mm holds the contact's middle, not its lower end": (l - w / 2.0, w),
        "l_mm holds the contact's upper end, not its lower one": (l - w, w),
        mirrored: (length - l - w, w),
    }
    moved = {words: _with_places(runs, sensor, *place) for words, place in places.items()}
    possible = {words: other for words, other in moved.items() if other}
    yield from possible.items()
    if "kh" in runs.raw and "kl" in runs.raw:
        yield "the columns of v_h and v_l are exchanged, or the wires are", _exchanged(runs)
        if other := possible.get(mirrored):
            words = "Vref and ground are exchanged on the unit, or l_mm is counted from the end at Vref"
            yield words, _exchanged(other)


def _with_places(runs: Runs, sensor: Sensor, l: FloatArray, w: FloatArray) -> Runs | None:
    """Return the runs with other places; None unless all of them lie on the strips and can be read."""
    length = sensor.length_mm
    slack = 1e-6 * length
    longest = length - slack if sensor.sensing_ratio == 0.0 else length  # metal from end to end reads nothing
    on_strips = np.nanmin(l) >= -slack and np.nanmax(l + w) <= length + slack
    if not on_strips or not -slack <= np.nanmin(w) <= np.nanmax(w) <= longest:
        return None
    l = np.clip(l, 0.0, length)
    return replace(runs, l_mm=l, w_mm=np.clip(w, 0.0, length - l))


def _exchanged(runs: Runs) -> Runs:
    return replace(runs, raw={"kh": runs.raw["kl"], "kl": runs.raw["kh"]})


def _reversed_strips(runs: Runs) -> Runs:
    """Return the runs with the strips' readings in reversed order."""
    if not (np.isfinite(runs.l_mm) == np.isfinite(runs.l_mm[:, ::-1])).all():
        return runs
    return replace(runs, raw={name: values[:, ::-1] for name, values in runs.raw.items()})
