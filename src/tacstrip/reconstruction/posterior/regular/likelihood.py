"""How likely regular outlines make the readings of one signature.

y follows by linear least squares, for k (1 - n w) = l + a w is linear in l.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.core.problem import FitProblem
from tacstrip.reconstruction.posterior.regular.kinds import Floats, Outlines
from tacstrip.reconstruction.posterior.regular.placement import Placement

_STRIPS = 32  # that readings are averaged to
_LOWEST, _HIGHEST = 0.02, 0.97  # of an outline's height, over the strip
_UNTOUCHED = 1e3  # half chi square of a strip that an outline misses; one may lie on an end


@dataclass(frozen=True, eq=False)
class Likelihood:
    """Readings of `_STRIPS` strips or fewer, their places and weights (G,), and where outlines may lie."""

    problem: FitProblem
    placement: Placement
    x: Floats
    k: Floats
    weight: Floats

    @classmethod
    def of(cls, problem: FitProblem, window: tuple[float, float, float, float]) -> Likelihood:
        """Average the readings; `window`: between which x the left end lies, and the right one."""
        p = problem
        starts = np.arange(0, len(p.x), -(-len(p.x) // _STRIPS))
        weight = np.add.reduceat(p.weight[0], starts)
        k = np.add.reduceat(p.weight[0] * p.k[0], starts) / np.where(weight > 0.0, weight, 1.0)
        x = np.add.reduceat(p.x, starts) / np.diff(np.append(starts, len(p.x)))
        single = np.float32
        return cls(p, Placement.of(p, window), x.astype(single), k.astype(single), weight.astype(single))

    def weighed(self, some: Outlines) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return log prior, half chi square, and the lowest point (K,) over the strip that the readings want."""
        on, p = self.placement.placed(some, self.x), self.problem
        lower, width = np.where(on.there, on.lower, 0.0), np.where(on.there, on.upper - on.lower, 0.0)
        lost, within = self._eroded(width)
        d = 1.0 - p.narrow * within
        linear = self.weight * d**2
        total = linear.sum(axis=1)
        lowest = ((self.k * d - p.shares[0] * within - lost - lower) * linear).sum(axis=1) / total
        room = 1.0 - on.height
        lowest = np.clip(lowest, 0.0, np.maximum(room, 0.0))
        lowest = np.where(on.border == 2, -on.part * on.height, lowest)
        lowest = np.where(on.border == 3, room + on.part * on.height, lowest)
        l = lowest[:, None].astype(np.float32) + lower
        cut = on.border >= 2
        l, u = np.clip(l, 0.0, 1.0), np.clip(l + width, 0.0, 1.0)
        lost[cut], within[cut] = self._eroded((u - l)[cut])
        read = (l + lost + p.shares[0] * within) / np.maximum(1.0 - p.narrow * within, 1e-3)
        missed = np.count_nonzero((self.weight > 0.0) & (~on.there | (u <= l)), axis=1)
        misfit = 0.5 * ((read - self.k) ** 2 @ self.weight) + np.where(missed > 1, _UNTOUCHED * missed, 0.0)
        # Places along the strip are as likely: their integral is that of the likelihood.
        log = np.where(cut, 0.0, -0.5 * np.log(total / (2.0 * np.pi)) - np.log(np.maximum(room, _LOWEST)))
        fits = (on.height > _LOWEST) & (on.height < _HIGHEST)
        return np.where(fits, log, -1e9), misfit.astype(np.float64), lowest

    def _eroded(self, width: Floats) -> tuple[Floats, Floats]:
        """Return the transfer length of contacts, and what it leaves of their width."""
        lam = self.problem.lam
        lost = lam * np.tanh(width / (2.0 * lam)) if lam > 0.0 else np.zeros_like(width)
        return lost, width - 2.0 * lost
