"""Whether constants describe a unit: what they leave beside the noise, and whether any unit can have them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.calibrate.fit import Fit, at_rail
from tacstrip.calibrate.model import apply
from tacstrip.calibrate.residuals import residuals
from tacstrip.io.runs import Runs
from tacstrip.robust import robust_sigma
from tacstrip.sensor.spec import Sensor

_PLAUSIBLE_NOISE = (
    0.003  # over Vref: where nothing was repeated, P.U. profile I (5.1.3) as a standard deviation
)
_FAR = 5.0  # times the noise
_MOST, _MOST_OF_STRIP = 0.02, 0.03  # over Vref: what uneven rubber and few presses leave at worst
_ROWS = 0.75  # of the rows must be described: the others may be spoilt
_LOUD = 0.03  # over Vref: repeats further apart are no repeats
_QUARTILE = 1.15  # standard deviations: three quarters of normal errors are smaller
# Of a sound unit: its strips' median offset [Vref], any strip's, median gain, ratio over the spec's, lambda / L.
_OFFSET, _ANY_OFFSET, _GAIN, _RATIO, _LAMBDA = 0.1, 0.25, 1.25, 10.0, 0.1


@dataclass(frozen=True, eq=False)
class Goodness:
    """What constants leave of the runs' readings.

    Attributes
    ----------
    noise
        Standard deviation of a reading over Vref, by repeats, of the converter's step at least.
    repeated
        Whether there were repeats to tell it; else it is what is plausible.
    left
        What is left on the median strip, as `strips`.
    strips
        What is left of each strip (strips,), as a standard deviation over Vref that a quarter of spoilt rows cannot
        raise.
    implausible
        Which constant no sound unit has, in words; "" where none.
    """

    noise: float
    repeated: bool
    left: float
    strips: FloatArray
    implausible: str = ""

    @property
    def beyond_noise(self) -> bool:
        """Whether more is left than noise explains."""
        return self.left > (2.0 if self.repeated else 1.0) * self.noise

    @property
    def doubt(self) -> str:
        """Why these constants must not be used, without which strip; "" where they may."""
        if self.implausible:
            return self.implausible
        if self.noise > _LOUD:
            return f"repeats of one place differ by {100.0 * self.noise:.2g} % of Vref"
        if self.left > max(_MOST, _FAR * self.noise):
            return f"{100.0 * self.left:.2g} % of Vref is left, and the readings' noise is {self._noise()}"
        return ""

    def ill_strips(self) -> list[int]:
        """Return the strips that the constants do not describe, though they do the others."""
        limit = max(_MOST_OF_STRIP, _FAR * self.noise)
        return [int(i) for i in np.flatnonzero(self.strips > limit)]

    def _noise(self) -> str:
        known = "by its repeats" if self.repeated else "hardly more than"
        return f"{known} {100.0 * self.noise:.2g} %"


def judge(sensor: Sensor, done: Sensor, runs: Runs, found: Fit | None = None) -> Goodness:
    """Judge a calibration by its runs.

    Parameters
    ----------
    sensor, done
        As it was, and with its constants.
    runs
        What they were fitted to.
    found
        The fit, where there was one: its constants are looked at.
    """
    there = np.isfinite(runs.l_mm) & ~at_rail(runs)
    off = np.stack(list(residuals(done, runs).values()))
    row = np.where(there, np.sqrt(np.mean(off**2, axis=0)), np.nan)
    repeats = repeat_noise(runs)
    noise = max(_PLAUSIBLE_NOISE if repeats is None else repeats, sensor.adc_step / np.sqrt(12.0))
    strips = np.array([_spread(column[np.isfinite(column)]) for column in row.T])
    implausible = _implausible(found) if found is not None else ""
    return Goodness(noise, repeats is not None, float(np.median(strips)), strips, implausible)


def judge_fit(sensor: Sensor, found: Fit, runs: Runs) -> Goodness:
    """Judge a fit by its runs."""
    return judge(sensor, apply(found.constants, sensor), runs, found)


def repeat_noise(runs: Runs) -> float | None:
    """Return the standard deviation of repeats over Vref, by their median; None where nothing was repeated."""
    aside: list[FloatArray] = []
    there = np.isfinite(runs.l_mm) & ~at_rail(runs)
    for strip in range(there.shape[1]):
        rows = there[:, strip]
        place = np.stack([runs.l_mm[rows, strip], runs.w_mm[rows, strip]], axis=1)
        _, group, count = np.unique(place, axis=0, return_inverse=True, return_counts=True)
        group, count = group.ravel(), count.astype(float)
        grown = np.sqrt(count / np.maximum(count - 1.0, 1.0))[group]  # a mean of few follows each of them
        for values in runs.raw.values():
            read = values[rows, strip]
            off = np.abs(read - (np.bincount(group, read) / count)[group]) * grown
            aside.append(off[count[group] > 1.0])
    every = np.concatenate(aside)
    return float(robust_sigma(every)) if len(every) else None


def _spread(rows: FloatArray) -> float:
    return float(np.quantile(rows, _ROWS, method="lower")) / _QUARTILE if len(rows) else 0.0


def _implausible(found: Fit) -> str:
    """Say which constant no sound unit has."""
    c = found.constants
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
                f"readings would have to be {gain:.2g} times what the spec's strips give; are length_mm and vref_volt "
                "in the spec right, and is it this sensor's?"
            )
        if c.model.has("curve"):
            bend = np.median(c.curve(name) - c.model.knots, axis=0)
            if np.abs(bend).max() > _OFFSET:
                return (
                    f"curves would have to be up to {100.0 * bend[np.abs(bend).argmax()]:+.0f} % of Vref off"
                )
    ratio = float(np.exp(np.median(np.atleast_1d(c.value("ratio") + c.value("ratios")))))
    if not 1.0 / _RATIO <= ratio <= _RATIO:
        return f"the ratio of resistivities would have to be {ratio:.2g} times the spec's"
    if c.value("lambda") > _LAMBDA:
        return f"contact_lambda_mm would have to be {100.0 * c.value('lambda'):.0f} % of the strips' length"
    return ""
