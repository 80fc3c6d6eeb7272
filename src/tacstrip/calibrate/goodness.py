"""Goodness of fit: whether constants describe a unit, by their residual against the noise and by their values."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.calibrate.fit import ModelFit, usable_rows
from tacstrip.calibrate.model import apply
from tacstrip.calibrate.residuals import residuals
from tacstrip.contact.noise import Noise
from tacstrip.errors import figures
from tacstrip.io.runs import Runs
from tacstrip.reconstruction.cramer_rao import reading_sigma
from tacstrip.robust import robust_sigma
from tacstrip.sensor.spec import Sensor

_PROFILE_I = 0.003  # over Vref: P.U. profile I (5.1.3) as a standard deviation, for runs without repeats
_FAR = 5.0  # times the noise
_MOST, _MOST_OF_STRIP = 0.02, 0.03  # over Vref: what uneven rubber and few presses leave at worst
_SURELY, _SURELY_FAR = 0.008, 10.0  # the same where repeats tell the noise: over Vref, and times it
_ROWS = 0.75  # of the rows must be described: the others may be spoilt
_WHOLE, _STRIPS, _PRESSES = 0.9, 3, 0.1  # of a press's strips, of so many at least; of the presses
_NAMED = 8  # lines
_LOUD = 0.03  # over Vref: repeats further apart are no repeats
_ALIKE, _FEWEST_STRIPS = 4.0, 5  # times what noise makes of repeats that differ in one way; strips
_LEAST_NOISE = 2e-4  # of repeats, over Vref: an A/D converter's step
_QUARTILE = 1.15  # standard deviations: three quarters of normal errors are smaller
# Of a sound unit: its strips' median offset [Vref], any strip's, median gain, ratio over the spec's, lambda / L.
_OFFSET, _ANY_OFFSET, _GAIN, _RATIO, _LAMBDA = 0.1, 0.25, 1.25, 10.0, 0.1


@dataclass(frozen=True, eq=False)
class Goodness:
    """How well constants describe the runs' readings.

    Attributes
    ----------
    noise
        Standard deviation of a reading over Vref, from repeats, at least that of the converter's step, and that of
        stated errors of the places.
    repeated
        Whether there were repeats to estimate it from; else it is P.U. profile I.
    residual
        Residual of the median strip, as `strips`.
    strips
        Residual of each strip (strips,), NaN of those left out, as a standard deviation over Vref that a quarter of
        spoilt rows cannot raise.
    implausible
        Which constant has a value that no sound unit has, in words; "" where none.
    spoilt
        Which rows contradict the others, in words: another unit's, or too many; "" where none.
    changed
        Which strips read otherwise from some row on, or contradict themselves, in words; "" where none.
    """

    noise: float
    repeated: bool
    residual: float
    strips: FloatArray
    implausible: str = ""
    spoilt: str = ""
    changed: str = ""

    @property
    def beyond_noise(self) -> bool:
        """Whether the residual is larger than noise explains."""
        return self.residual > (2.0 if self.repeated else 1.0) * self.noise

    @property
    def most(self) -> float:
        """The largest residual of constants that may be used."""
        surely = max(_SURELY, _SURELY_FAR * self.noise) if self.repeated else _MOST
        return max(min(_MOST, surely), _FAR * self.noise)

    @property
    def doubt(self) -> str:
        """Why these constants must not be used, on any strip; "" where they may."""
        if self.implausible or self.spoilt:
            return self.implausible or self.spoilt
        if self.noise > _LOUD:
            return f"repeats of one place differ by {100.0 * self.noise:.2g} % of Vref"
        if self.residual > self.most:
            source = "by its repeats" if self.repeated else "hardly more than"
            noise = f"the readings' noise is {source} {100.0 * self.noise:.2g} %"
            return f"the residual is {100.0 * self.residual:.2g} % of Vref, and {noise}"
        return ""

    @property
    def poor_strips(self) -> list[int]:
        """The strips, from 0, that the constants do not describe, though they describe the others."""
        limit = max(_MOST_OF_STRIP, _FAR * self.noise)
        return [int(i) for i in np.flatnonzero(self.strips > limit)]


def assess(sensor: Sensor, calibrated: Sensor, runs: Runs, fit: ModelFit | None = None) -> Goodness:
    """Return the goodness of a calibration on its runs.

    Parameters
    ----------
    sensor, calibrated
        Without and with its constants.
    runs
        What they were fitted to.
    fit
        Where there was one, its constants are checked.
    """
    off = np.stack(list(residuals(calibrated, runs).values()))
    if fit is not None and fit.constants.model.has("points"):  # of which the correction knows nothing
        off = fit.residual
    row = np.where(usable_rows(runs), np.sqrt(np.mean(off**2, axis=0)), np.nan)
    repeats = repeat_noise(runs)
    noise = max(_PROFILE_I if repeats is None else repeats, reading_sigma(Noise(), sensor))
    places = [np.nanmedian(sd) / sensor.length_mm for sd in (runs.l_sd_mm, runs.w_sd_mm) if sd is not None]
    noise = float(np.hypot(noise, max(places, default=0.0)))
    strips = np.array([_upper_quartile(column[np.isfinite(column)]) for column in row.T])
    implausible = "" if fit is None else _implausible(fit)
    return Goodness(noise, repeats is not None, float(np.nanmedian(strips)), strips, implausible)


def spoilt(runs: Runs, fit: ModelFit | None) -> str:
    """Say which rows contradict the others: presses, more than a quarter of all, or another unit's; "" if none."""
    usable = usable_rows(runs)
    out = usable & ~(fit.weight > 0.0) if fit is not None else np.zeros_like(usable)
    # A bar slips once; presses that no strip agrees with are of another sensor, or read in another way.
    made = usable.sum(axis=1)
    whole = (made >= _STRIPS) & (out.sum(axis=1) >= _WHOLE * made)
    if whole.sum() > max(1.0, _PRESSES * np.count_nonzero(made)) or out.sum() > (1.0 - _ROWS) * usable.sum():
        lines = ", ".join(map(str, np.sort(runs.line[out])[:_NAMED]))
        return (
            f"{out.sum()} of {usable.sum()} rows would have to be excluded for the others to agree, {whole.sum()} "
            f"presses on all strips (lines {lines}{' ...' if out.sum() > _NAMED else ''})"
        )
    return _two_units(runs, usable, out) or _far_press(runs, usable & ~out, fit)


def _far_press(runs: Runs, counted: BoolArray, fit: ModelFit | None) -> str:
    """Say which press is further off than uneven rubber makes it on strips together; "" if none, or runs state errors.

    Few presses of two units leave a residual that is small on the whole: strips' constants follow most of them.
    """
    if fit is None or runs.l_sd_mm is not None or runs.w_sd_mm is not None:
        return ""
    count = counted.sum(axis=1)
    square = np.where(counted, np.mean(fit.residual**2, axis=0), 0.0).sum(axis=1)
    off = np.sqrt(square / np.maximum(count, 1)) * (count >= _STRIPS)
    worst = int(np.argmax(off))
    if off[worst] <= _MOST:
        return ""
    line = runs.line[worst][counted[worst]].min()
    return (
        f"the press that begins in line {line} is off by {100.0 * off[worst]:.2g} % of Vref on {count[worst]} strips "
        "together, more than uneven rubber makes it"
    )


def _two_units(runs: Runs, usable: BoolArray, out: BoolArray) -> str:
    """Say which presses read as another unit's: repeats of one place that differ in one way, strip by strip.

    A bar that lies elsewhere, or slanted, differs by a line across the strips; noise differs each time. Presses of
    which the fit excludes less than half (`out`) have single readings spoilt, and do not count.
    """
    few = out.any(axis=1) & (2 * out.sum(axis=1) < usable.sum(axis=1))
    usable = usable & ~few[:, None]
    there = usable.any(axis=0)
    usable, line_of = usable[:, there], runs.line[:, there]
    l, w = (np.where(np.isfinite(v), v, -1.0)[:, there] for v in (runs.l_mm, runs.w_mm))
    press = usable.all(axis=1)
    number = np.unique(np.concatenate([l, w], axis=1)[press], axis=0, return_inverse=True)[1].ravel()
    count = np.bincount(number)
    repeated = count[number] > 1
    if usable.shape[1] < _FEWEST_STRIPS or repeated.sum() < _FEWEST_STRIPS:
        return ""
    across = np.linspace(-1.0, 1.0, usable.shape[1])
    line = np.linalg.qr(np.stack([np.ones_like(across), across], axis=1))[0]
    off = []
    for values in runs.raw.values():
        read = values[press][:, there]
        mean = np.stack([np.bincount(number, v) / count for v in read.T], axis=1)
        different = (read - mean[number])[repeated]
        off.append(different - different @ line @ line.T)
    rows = np.concatenate(off, axis=1)
    free = len(rows) - len(np.unique(number[repeated])), rows.shape[1] - 2 * len(off)
    score, size, _ = np.linalg.svd(rows, full_matrices=False)
    rest = max(float(np.sum(size[1:] ** 2)) / max((free[0] - 1) * (free[1] - 1), 1), _LEAST_NOISE**2)
    usual = np.sqrt(rest) * (np.sqrt(free[0]) + np.sqrt(free[1]))  # of a matrix of noise
    if size[0] < _ALIKE * usual:
        return ""
    lines = line_of[press][repeated].min(axis=1)
    other = np.abs(score[:, 0]) > 0.5 * np.abs(score[:, 0]).max()
    sides = [np.flatnonzero(other & (np.sign(score[:, 0]) == side)) for side in (-1.0, 1.0)]
    fewer = min((s for s in sides if len(s)), key=len)
    names = ", ".join(map(str, lines[fewer][:_NAMED]))
    return (
        f"repeats of one place differ from strip to strip in one way, by up to {100.0 * np.abs(rows).max():.2g} % of "
        f"Vref, as those of two units do: look at the presses that begin in lines {names}"
        f"{' ...' if len(fewer) > _NAMED else ''}"
    )


def assess_fit(sensor: Sensor, fit: ModelFit, runs: Runs) -> Goodness:
    """Return the goodness of a fit on its runs; `SpecError` where its constants make no calibration."""
    return assess(sensor, apply(fit.constants, sensor), runs, fit)


def repeat_noise(runs: Runs) -> float | None:
    """Return the robust standard deviation of repeats over Vref; None where nothing was repeated."""
    deviations: list[FloatArray] = []
    usable = usable_rows(runs)
    for strip in np.flatnonzero(usable.any(axis=0)):
        rows = usable[:, strip]
        place = np.stack([runs.l_mm[rows, strip], runs.w_mm[rows, strip]], axis=1)
        _, group, count = np.unique(place, axis=0, return_inverse=True, return_counts=True)
        group, count = group.ravel(), count.astype(float)
        # The mean of few follows each of them.
        enlarged = np.sqrt(count / np.maximum(count - 1.0, 1.0))[group]
        for values in runs.raw.values():
            read = values[rows, strip]
            deviation = (read - (np.bincount(group, read) / count)[group]) * enlarged
            deviations.append(deviation[count[group] > 1.0])
    every = np.concatenate(deviations)
    return float(robust_sigma(every)) if len(every) else None


def _upper_quartile(rows: FloatArray) -> float:
    return float(np.quantile(rows, _ROWS, method="lower")) / _QUARTILE if len(rows) else np.nan


def _implausible(fit: ModelFit) -> str:
    """Say which constant has a value that no sound unit has; "" where none."""
    c = fit.constants
    for name in c.signatures:
        if c.model.has("offset"):
            offset = c.value(f"offset {name}")
            worst = max(np.median(offset) * _ANY_OFFSET / _OFFSET, offset[np.abs(offset).argmax()], key=abs)
            if abs(worst) > _ANY_OFFSET:
                most = offset[np.abs(offset).argmax()]
                return f"offsets would have to be up to {100.0 * most:+.0f} % of Vref"
        gain = float(np.median(1.0 + c.value(f"gain {name}")))
        if not 1.0 / _GAIN <= gain <= _GAIN:
            return (
                f"readings would have to be {figures(gain)} times what the spec's strips give; are length_mm, "
                "vref_volt and adc_bits in the spec right, and is it this sensor's?"
            )
        if c.model.has("curve"):
            bend = np.median(c.curve(name) - c.model.knots, axis=0)
            if np.abs(bend).max() > _OFFSET:
                worst = 100.0 * bend[np.abs(bend).argmax()]
                return f"curves would have to be up to {worst:+.0f} % of Vref off"
    ratio = float(np.exp(np.median(c.value("ratios" if c.model.has("ratios") else "ratio"))))
    if not 1.0 / _RATIO <= ratio <= _RATIO:
        return f"the ratio of resistivities would have to be {figures(ratio)} times the spec's"
    if c.value("lambda") > _LAMBDA:
        return f"contact_lambda_mm would have to be {100.0 * c.value('lambda'):.0f} % of the strips' length"
    return ""
