"""One run of touched strips: both ends cut into convex stretches, and the pieces that these are of."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.errors import SignatureError
from tacstrip.reconstruction.contact_ends import end_deviations
from tacstrip.reconstruction.pieces.chain import Chain, Cut, split_chain
from tacstrip.reconstruction.pieces.cover import Cover, Read, least_cover
from tacstrip.reconstruction.pieces.pair import Ends, Pair, Seen, pair_at_the_ends
from tacstrip.reconstruction.sections import reading_noise
from tacstrip.sensor.spec import Sensor

GAP = 0.02  # of L: objects nearer to each other are one
FEW_STRIPS = 12  # fewer do not resolve every jump
LEAST_SIGMA = 5e-4  # of Vref, of noise that few strips tell
_EXACT = 1e-5  # of Vref: no reading is taken for more exact
_NARROW = 0.25  # of the width beside it: a strip that may show one of two objects alone
_ALARM = 3.09  # deviations of chi square: p = .001


@dataclass(frozen=True, eq=False)
class RunPieces:
    """The pieces of one run.

    Attributes
    ----------
    chains
        Of l and of -u.
    read
        What the strips read, as the chains have it.
    cover
        Which stretches are of one piece.
    pitch, gap
        Of the strips, and by which objects are apart, both [mm].
    """

    chains: tuple[Chain, Chain]
    read: Read
    cover: Cover
    pitch: float
    gap: float

    @property
    def count(self) -> int:
        """Convex pieces, at least."""
        return len(self.cover.pieces) if self.cover.fewest is None else self.cover.fewest

    @property
    def cuts(self) -> list[tuple[int, Cut]]:
        """The cuts of l (0) and of u (1), from left to right."""
        every = ((side, s.before) for side, chain in enumerate(self.chains) for s in chain.stretches)
        found = [(side, cut) for side, cut in every if cut is not None]
        return sorted(found, key=lambda cut: (cut[1].strip, cut[0]))

    @cached_property
    def open_mm(self) -> float:
        """Deviation of the contact's length on a strip [mm] by what noise leaves open of the lines."""
        return sum(
            _median(sigma)
            * math.sqrt(min(2.0 * sum(len(s.lines) for s in chain.stretches) / len(sigma), 1.0))
            for chain, sigma in zip(self.chains, (self.read.l_sigma, self.read.u_sigma), strict=True)
        )

    @property
    def left_over(self) -> tuple[float, int, int]:
        """Chi square that the lines leave, of how many ends, and how many numbers the lines have."""
        n = sum(int((~chain.left_out).sum()) for chain in self.chains)
        stretches = [s for c in self.chains for s in c.stretches]
        return sum(s.chi_square for s in stretches), n, 2 * sum(len(s.lines) for s in stretches)

    @property
    def explains(self) -> bool:
        """Whether noise explains what convex stretches leave over of the readings."""
        chi_square, n, numbers = self.left_over
        freedom = max(n - numbers, 1)
        small = 2.0 / (9.0 * freedom)
        return bool(((chi_square / freedom) ** (1.0 / 3.0) - (1.0 - small)) / math.sqrt(small) <= _ALARM)

    @cached_property
    def may_be_two(self) -> bool:
        """Whether one piece was found that may well be two objects, of which the outer strips show one alone.

        A steep edge of one object crosses its outer strip at any height. That it does so near to the other end at both
        sides is a coincidence; that either of two objects begins and ends there by itself is not.
        """
        if self.count > 1 or any(len(chain.stretches) > 1 for chain in self.chains):
            return False
        wide = -self.chains[1].y - self.chains[0].y
        return len(wide) > 1 and all(
            wide[end] < _NARROW * wide[beside]
            and any(chain.shed(right, self.gap) is not None for chain in self.chains)
            for right, end, beside in ((False, 0, 1), (True, -1, -2))
        )

    @property
    def known(self) -> BoolArray:
        """Which strips have both ends (n,)."""
        return np.isfinite(self.chains[0].y)

    @property
    def ends(self) -> Ends:
        """What the strips read that have both ends."""
        (of_l, of_u), known = self.chains, self.known
        y, sigma = np.stack([of_l.y, -of_u.y]), 1.0 / np.sqrt([of_l.weight, of_u.weight])
        return Ends(of_l.x[known], y[:, known], sigma[:, known], self.pitch)

    @cached_property
    def pair(self) -> Pair | None:
        """Two objects that one convex piece may be, None where it is hardly two."""
        return None if self.cuts else pair_at_the_ends(self.ends)

    @cached_property
    def distance_mm(self) -> float:
        """Least distance [mm] between what the strips show of two pieces; 0 of one.

        The pieces of an inward corner touch there, and those of an overhang where both come from.
        """
        # The first is the widest.
        return self.cover.gap_mm(self.pitch) if self.count > 1 else 0.0

    @property
    def seen(self) -> Seen:
        """How they look as wholes."""
        height = float(np.ptp([self.read.l.min(), self.read.u.max()]))
        rise = max((cut.rise for _, cut in self.cuts if cut.kind != "corner"), default=0.0)
        length, breadth = self.gap / GAP, len(self.read.x) * self.pitch
        return Seen(self.distance_mm / length, rise / height, height / breadth)

    @property
    def apart(self) -> bool:
        """Whether convex objects that touch nowhere may read so."""
        return self.distance_mm >= self.gap


def _median(values: FloatArray) -> float:
    """Return the median of some numbers: NumPy's takes ten times as long."""
    found: list[float] = np.sort(values).tolist()
    return 0.5 * (found[(len(found) - 1) // 2] + found[len(found) // 2])


def noise_level(k: FloatArray, sensor: Sensor) -> float:
    """Return the deviation [Vref] of readings (S, n) that second differences show, and the converter's steps."""
    levels = [reading_noise(values[np.isfinite(values)]) for values in k]
    least = LEAST_SIGMA if k.shape[1] < FEW_STRIPS else 0.0
    return float(max(np.sqrt(np.mean(np.square(levels))), sensor.adc_step / np.sqrt(12.0), least))


def split_run(
    sensor: Sensor, x_mm: FloatArray, l_mm: FloatArray, u_mm: FloatArray, sigma: float
) -> RunPieces:
    """Find the pieces of neighbouring strips at x (n,) from their l and u (n,) [mm], NaN where nothing is known.

    `sigma` is the deviation of a reading [Vref].
    """
    known = np.isfinite(l_mm + u_mm)
    if not known.any():
        raise SignatureError(
            "a contact lies on strips of which one channel is left out: nobody knows its ends there, nor pieces; take "
            "the polygon"
        )
    filled = [np.interp(x_mm, x_mm[known], y[known]) for y in (l_mm, u_mm)]
    sigmas = end_deviations(sensor, filled[0], filled[1], max(sigma, _EXACT))
    pitch, gap = sensor.pitch_mm, GAP * sensor.length_mm
    chains = split_chain(x_mm, l_mm, sigmas[0], pitch), split_chain(x_mm, -u_mm, sigmas[1], pitch)
    read = Read.of(x_mm, chains)
    return RunPieces(chains, read, least_cover(chains, read, pitch, gap), pitch, gap)
