"""Noise as rubber, soft edges and converters have it: white, a zero that wanders, edges whose errors correlate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from studies.holdout.first_order import first_order
from studies.holdout.readings import Unit
from studies.holdout.shapes import Array

KINDS = ("white", "wander", "edges", "all")  # each with what the ones before it have
_TIMES = (8.0, 40.0, 200.0, 1000.0)  # scans: together a flicker, whose Allan deviation has a floor
# Standard deviation of each of them over the white noise's: a strip's own, all strips'.
_OWN, _COMMON = 0.16, 0.12
# An edge's error [white noise times L], and its correlation with the next strip's.
_EDGE, _NEIGHBOUR = 1.0, 0.4
_OFFSET = 0.3  # of all strips of a channel, over the white noise's deviation


@dataclass(frozen=True, eq=False)
class Press:
    """A still contact on a unit: what its scans read, one after the other.

    The zero wanders from scan to scan and between strips (Allan deviation: white down to a fifth at 30 scans, then
    flat); an edge lies where the pressure passes a threshold, which errs alike on neighbouring strips and stays for
    as long as the press.
    """

    unit: Unit
    kind: str
    sigma: float  # of the white noise [Vref]

    def scans(self, low: Array, high: Array, count: int, random: np.random.Generator) -> Array:
        """Return `count` scans (count, names, strips) of contacts from `low` to `high` [mm], digitised."""
        level = KINDS.index(self.kind)
        if level >= 2:
            low, high = (y + self._edge(random) for y in (low, high))
            low, high = np.minimum(low, high), np.maximum(low, high)
            low, high = np.clip(low, 0.0, self.unit.length), np.clip(high, 0.0, self.unit.length)
        shape = (count, len(self.unit.names), self.unit.strips)
        error = random.normal(0.0, 1.0, shape)
        if level >= 1:
            error += _OWN * _flicker(shape, random) + _COMMON * _flicker((*shape[:2], 1), random)
        if level >= 3:
            error += _OFFSET * random.normal(size=(1, shape[1], 1))
        return self.unit.digitised(self.unit.read(low, high) + self.sigma * error)

    def _edge(self, random: np.random.Generator) -> Array:
        new = random.normal(0.0, np.sqrt(1.0 - _NEIGHBOUR**2), self.unit.strips)
        new[0] = random.normal()
        return _EDGE * self.sigma * self.unit.length * first_order(new, _NEIGHBOUR)


def _flicker(shape: tuple[int, ...], random: np.random.Generator) -> Array:
    """Return the sum of first-order processes of several times, each of variance 1, along the first axis."""
    total = np.zeros(shape)
    for time in _TIMES:
        keep = np.exp(-1.0 / time)
        new = random.normal(0.0, np.sqrt(1.0 - keep**2), shape)
        new[0] = random.normal(size=shape[1:])
        total += first_order(new, keep)
    return total
