"""A jump of all readings by one factor, of which no line says a word: as where unit or supply change from there on."""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.io.log_import.scans import LogScan

_LEAST = 1.3  # times: readings that jump less may move so
_OTHERS = 2.0  # times the largest other step
_FEW = 3  # readings: of fewer, only a factor between two units is told
# Relative, in the median and at most: a contact that moves takes readings less alike.
_ALIKE, _MOST_APART = 0.03, 0.1
_NEAR, _ROUGHLY = 0.05, 0.1  # of a factor between two units, and of readings that move meanwhile
_FACTORS = (100.0, 1000.0)  # between V, mV, fractions and percent


def jump_of_all(rough: list[LogScan], vref: float) -> tuple[int, float]:
    """Return the line from which on all readings are a factor times those before, as nowhere else; (0, 1) where none.

    `vref` in volts is a factor between two units; 0 where it is not known.

    Examples
    --------
    >>> still = np.array([[2.0, 1.0], [3.0, 1.5]])
    >>> log = [LogScan(float(n), still / (3.3 if n > 3 else 1.0), n + 2) for n in range(8)]
    >>> line, times = jump_of_all(log, 3.3)
    >>> line, round(1.0 / times, 2)
    (6, 3.3)
    >>> jump_of_all(log[:4], 3.3)
    (0, 1.0)
    """
    if len(rough) < 2:
        return 0, 1.0
    values = np.stack([s.values for s in rough]).reshape(len(rough), -1)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.log(values[1:] / values[:-1])
    ratios = np.where(np.isfinite(ratios), ratios, np.nan)
    common = np.isfinite(ratios).sum(axis=1)
    steps = np.array([np.nanmedian(r) if n else 0.0 for r, n in zip(ratios, common, strict=True)])
    k = int(np.argmax(np.abs(steps)))
    others = float(np.abs(np.delete(steps, k)).max(initial=0.0))
    same = bool((np.isfinite(values[k]) == np.isfinite(values[k + 1])).all())
    if abs(steps[k]) > max(np.log(_LEAST), _OTHERS * others) and _is_one_factor(ratios[k], same, vref):
        return rough[k + 1].line, float(np.exp(steps[k]))
    return 0, 1.0


def _is_one_factor(ratios: FloatArray, same: bool, vref: float) -> bool:
    """Return whether logarithms of ratios are of one factor; less exactly so where it is one between two units."""
    ratios = ratios[np.isfinite(ratios)]
    step = float(np.median(ratios))
    apart = np.abs(ratios - step)
    units = [f for f in (*_FACTORS, vref, *(f / vref for f in _FACTORS if vref)) if f > _LEAST]
    if any(abs(abs(step) - np.log(f)) < _NEAR for f in units) and len(ratios) > 1:
        return bool(np.median(apart) < _ROUGHLY)
    alike = bool(np.median(apart) < _ALIKE and apart.max() < _MOST_APART)
    return same and len(ratios) >= _FEW and alike
