"""Keep a held contact from growing while its rubber creeps."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.scan import Scan
from tacstrip.sensor.creep import creep_rate, log_age

_BLOCK_S = 0.25  # of a mean that is kept
_MOST_BLOCKS = 480  # then every other is forgotten
_RATE_S = 1.0  # between two estimates
_MOSTLY = 0.5  # of the blocks, that a channel is read in to have a rate
_MOVED, _MOVED_SCANS = 0.03, 3  # Vref, scans in turn: a contact that is elsewhere is another


class CreepFilter:
    """Takes the creep of a contact that is held still out of its readings: they stay as after its first second.

    The rate is learned from the press itself (`sensor.creep`), over five seconds and more; before, and while a contact
    moves, scans are passed on as they are.
    """

    def __init__(self) -> None:
        self._restart(np.nan, np.zeros(0, dtype=bool))

    @property
    def creeping(self) -> bool:
        """Whether creep is taken out at present."""
        return bool(self._rate.any())

    def update(self, scan: Scan) -> Scan:
        """Return the scan without creep."""
        held = self._strips
        still = len(held) == len(scan.touched) and 2 * (held & scan.touched).sum() > held.sum()
        if not still or not held.any():
            self._restart(scan.time_s, scan.touched)
            held = self._strips
        age_s = scan.time_s - self._start_s
        if not held.any() or age_s < 0.0:
            return scan
        values = np.concatenate([scan[name][held] for name in scan.signatures])
        if self._has_moved(values - self._shift(age_s)):
            self._restart(scan.time_s, scan.touched)
            return scan
        self._keep(age_s, values)
        if not self.creeping:
            return scan
        shift = self._shift(age_s).reshape(len(scan.signatures), -1)
        found: dict[str, Any] = {}
        for name, change in zip(scan.signatures, shift, strict=True):
            k = scan[name].copy()
            k[held] = np.clip(k[held] - change, 0.0, 1.0)
            found[name] = k
        return replace(scan, **found)

    def _restart(self, start_s: float, strips: BoolArray) -> None:
        self._start_s, self._strips = start_s, strips.copy()
        self._blocks: list[tuple[float, FloatArray]] = []
        self._block: list[tuple[float, FloatArray]] = []
        self._rate, self._estimated_s, self._off = np.zeros(1), 0.0, 0

    def _shift(self, age_s: float) -> FloatArray:
        """Return what creep adds to the readings of the held strips, (signatures * strips,) or one 0."""
        return np.asarray(self._rate * max(float(log_age(np.array(age_s))), 0.0))

    def _has_moved(self, values: FloatArray) -> bool:
        """Whether the contact has been elsewhere than at first for some scans."""
        first = self._blocks[0][1] if self._blocks else values
        with np.errstate(invalid="ignore"):
            off = bool((np.abs(values - first) > _MOVED).any())
        self._off = self._off + 1 if off else 0
        return self._off >= _MOVED_SCANS

    def _keep(self, age_s: float, values: FloatArray) -> None:
        """Keep means over quarters of a second, and estimate the rate once a second."""
        self._block.append((age_s, values))
        if age_s - self._block[0][0] < _BLOCK_S:
            return
        self._blocks.append(
            (float(np.mean([a for a, _ in self._block])), np.mean([v for _, v in self._block], axis=0))
        )
        self._block = []
        if len(self._blocks) > _MOST_BLOCKS:
            self._blocks = [self._blocks[0], *self._blocks[2::2]]
        if age_s - self._estimated_s >= _RATE_S:
            self._estimated_s = age_s
            ages, means = (np.array(v) for v in zip(*self._blocks, strict=True))
            # A channel that is left out says nothing of the others.
            read = np.isfinite(means).mean(axis=0) > _MOSTLY
            self._rate = np.zeros(len(read))
            self._rate[read] = creep_rate(ages, means[:, read])
