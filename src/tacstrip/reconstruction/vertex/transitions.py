"""Where the vertices lie across the strips: given by the caller, fitted, or found by the gradient rule.

The gradient rule, a stand-in for the thesis' "simple detection method" (5.4.1), which it does not print:

1. At every strip, a straight line is fitted to the `reach` strips on either side, the strip itself in both;
   g is the right slope minus the left. reach is an eighth of the strips in contact, between 2 and 40, and
   less near the ends.
2. The noise is the median absolute second difference of the signature over sqrt(6), made a standard
   deviation; g's own follows from it and the reach.
3. A transition is a peak of |g| that is the highest within half a reach, stands out from the valleys on
   both sides by 0.3 of its height and by 4 of g's standard deviations (a curved section has a high |g|
   all along), and has a twentieth of the highest peak's height.
4. Its x is where the two lines cross, at most one strip away.
5. Curved sections bend g as a kink does. So sections are fitted between the transitions, and the one is
   dropped whose two sections one fit can replace at the least cost, as long as that adds less than 25 of
   the noise's variances to the squared residuals.
6. The end vertices lie half a pitch outside the first and the last touched strip, on average.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.contact.noise import Noise
from tacstrip.errors import OptionError, one_of
from tacstrip.reconstruction.sections import fit_sections, reading_noise
from tacstrip.scan import Scan
from tacstrip.sensor.spec import Sensor

_SIGNIFICANT = 4.0  # standard deviations of g
_PROMINENT = 0.3  # of the peak's own height
_SMALLEST = 0.05  # of the highest peak
_NEEDED = 25.0  # of the noise's variances
_RULES = ("auto", "gradient")


def transitions_of_runs(
    scan: Scan, sensor: Sensor, signature: str, transitions: str | npt.ArrayLike, noise: Noise | None = None
) -> list[FloatArray]:
    """Return, for each run of touched strips, the x of all its vertices [mm], ends included.

    Parameters
    ----------
    scan, sensor, signature
        What was measured, and which signature to look at.
    transitions
        "auto" (those of the polygon that fits all strips best), "gradient", or ascending x of all vertices of
        all objects; an x goes to the nearest run.
    noise
        The readings' errors, for "auto"; None: estimated.

    Raises
    ------
    OptionError
        The rule does not exist, or the given x are not finite numbers in ascending order.
    """
    runs, x = scan.runs(), sensor.x_mm
    if isinstance(transitions, str):
        if transitions not in _RULES:
            choices = (*_RULES, "or an ascending list of x")
            raise OptionError(one_of("transitions", transitions, choices))
        if transitions == "auto":
            # Late: that one uses this file's runs.
            from tacstrip.reconstruction.polygon.estimate import fitted_transitions

            return fitted_transitions(scan, sensor, signature, noise)
        pitch, ratio = sensor.pitch_mm, sensor.sensing_ratio
        read = [np.isfinite(scan[signature][run]) for run in runs]
        each = [(x[run][there], scan[signature][run][there]) for run, there in zip(runs, read, strict=True)]
        return [by_gradient(*of_run, pitch, ratio) for of_run in each]
    given = np.asarray(transitions, dtype=float)
    if given.ndim != 1 or not np.all(np.isfinite(given)) or np.any(np.diff(given) < 0.0):
        raise OptionError("transitions must be a list of finite x [mm] of all vertices, in ascending order")
    if len(given) and not 0.0 <= given.min() <= given.max() <= sensor.width_mm:
        off = given.min() if given.min() < 0.0 else given.max()
        raise OptionError(
            f"the transition at {off:.6g} mm is off the sensor: x runs from 0 to {sensor.width_mm:.6g} mm"
        )
    if not runs:
        return []
    first, last = (np.array([x[run][end] for run in runs]) for end in (0, -1))
    away = np.maximum(np.maximum(first - given[:, None], given[:, None] - last), 0.0)  # (x, runs)
    nearest = away.argmin(axis=1)
    return [given[nearest == i] for i in range(len(runs))]


def by_gradient(x: FloatArray, k: FloatArray, pitch_mm: float, ratio: float = 1.0) -> FloatArray:
    """Find the transitions of one signature: x [mm], ends included, by the rule above.

    Parameters
    ----------
    x, k
        Centre lines [mm] and readings of the neighbouring strips in contact (n,).
    pitch_mm
        Pitch of the strips [mm].
    ratio
        Resistivity of the sensing layer over the strip's, which bounds a section's curvature.
    """
    ends = (x[0] - pitch_mm / 2.0, x[-1] + pitch_mm / 2.0)
    n = len(k)
    if n < 5:
        return np.array(ends)
    reach = np.minimum(np.clip(round(n / 8), 2, 40), np.minimum(np.arange(n), np.arange(n)[::-1]))
    left, left_at = _lines(k, reach, -1)
    right, right_at = _lines(k, reach, +1)
    g = np.where(reach >= 2, right - left, 0.0)  # per strip
    sigma = reading_noise(k)
    size = reach + 1.0
    deviation = sigma * np.sqrt(24.0 / np.maximum(size**3 - size, 1.0))
    peaks = _peaks(np.abs(g), int(reach.max()), _SIGNIFICANT * deviation)
    tallest = max((abs(g[i]) for i in peaks), default=0.0)
    found = [
        x[i] + pitch_mm * np.clip((left_at[i] - right_at[i]) / g[i], -1.0, 1.0)
        for i in peaks
        if abs(g[i]) >= _SMALLEST * tallest
    ]
    return _needed(x, k, np.array([ends[0], *found, ends[1]]), sigma**2, ratio)


def _needed(
    x: FloatArray, k: FloatArray, transitions: FloatArray, variance: float, ratio: float
) -> FloatArray:
    """Drop the transitions, the least needed first, without which the sections fit as well."""

    def left_over(chosen: FloatArray) -> FloatArray:
        return np.array([s.squared_residuals if s else 0.0 for s in fit_sections(x, k, chosen, ratio)])

    while len(transitions) > 2:
        apart = left_over(transitions)
        joined = [left_over(transitions[[i - 1, i + 1]])[0] for i in range(1, len(transitions) - 1)]
        cost = np.array(joined) - apart[:-1] - apart[1:]
        if cost.min() > _NEEDED * variance:
            break
        transitions = np.delete(transitions, cost.argmin() + 1)
    return transitions


def _lines(k: FloatArray, reach: IntArray, towards: int) -> tuple[FloatArray, FloatArray]:
    """Fit a line to every strip and its `reach` neighbours to one side: slope per strip, value there."""
    at = np.arange(len(k))
    first, last = (at, at + reach) if towards > 0 else (at - reach, at)
    centred = at - at.mean()
    sum_k = np.concatenate(([0.0], np.cumsum(k)))
    sum_jk = np.concatenate(([0.0], np.cumsum(centred * k)))
    size = reach + 1.0
    total, moment = sum_k[last + 1] - sum_k[first], sum_jk[last + 1] - sum_jk[first]
    middle = 0.5 * (first + last) - at.mean()
    slope = 12.0 * (moment - middle * total) / np.maximum(size**3 - size, 1.0)
    return slope, total / size - slope * (middle - centred)


def _peaks(height: FloatArray, reach: int, least: FloatArray) -> list[int]:
    """Return the strips where the height peaks: highest near by, standing out by `least` (n,) on both sides."""
    found: list[int] = []
    near = max(1, reach // 2)
    for i in range(1, len(height) - 1):
        window = height[max(0, i - near) : i + near + 1]
        if height[i] <= 0.0 or height[i] < window.max() or (found and i - found[-1] <= near):
            continue
        higher = np.flatnonzero(height > height[i])
        left = height[(higher[higher < i].max(initial=-1) + 1) : i].min()
        right = height[i + 1 : (higher[higher > i].min(initial=len(height)))].min()
        if height[i] - max(left, right) >= max(_PROMINENT * height[i], least[i]):
            found.append(i)
    return found
