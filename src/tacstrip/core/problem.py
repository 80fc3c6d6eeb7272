"""One run of strips as the polygon fit sees it: x and y from 0 to 1, readings, weights, the sensor's constants."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.core.binding import Problem, Sendable, at
from tacstrip.sensor.closed_form import fraction, reading_jacobian, sensing_share
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.spec import Sensor

FLOOR = 1e-7  # of Vref: readings are never taken for more exact
LEAST_D = 1e-3  # of L: a metal sheet under a whole strip would divide by zero
_STRIPS = 100  # the search makes longer runs as short as that


@dataclass(frozen=True, eq=False)
class FitProblem(Sendable):
    """The readings of neighbouring strips, of S signatures.

    Attributes
    ----------
    x
        Centre lines (n,), ascending; 0 and 1 are where the ends are expected, half a pitch outside the outer ones.
    k
        Readings (S, n).
    weight
        1 / sigma^2 of each reading (S, n); 0 leaves it out.
    pitch
        Of the strips, in units of x.
    shares, narrow, lam
        The closed form (3.3)-(3.8) with contact resistance: c_u of a contact without width per signature (S,),
        1 - a, and lambda over L. See `sensor.closed_form`.
    origin_mm, width_mm, length_mm
        x = 0, the extent of x from 0 to 1, and L.
    """

    x: FloatArray
    k: FloatArray
    weight: FloatArray
    pitch: float
    shares: FloatArray
    narrow: float
    lam: float
    origin_mm: float
    width_mm: float
    length_mm: float

    @classmethod
    def of(
        cls,
        sensor: Sensor,
        x_mm: FloatArray,
        readings: Mapping[str, FloatArray],
        sigma: float,
        excluded: BoolArray | None = None,
        margin_mm: float = 0.0,
    ) -> FitProblem:
        """Make the problem of strips at x_mm (n,), ascending.

        Parameters
        ----------
        sensor
            Its pitch, length and closed form.
        x_mm, readings
            Centre lines [mm] and readings over Vref, name to (n,). What is not finite is left out.
        sigma
            Standard deviation of a reading [Vref].
        excluded
            Readings not to be used (S, n), in the order of `readings`.
        margin_mm
            How much further out the ends lie than within half a pitch of the outer strips.
        """
        raw = np.stack([np.asarray(values, dtype=np.float64) for values in readings.values()])
        use = np.isfinite(raw) if excluded is None else np.isfinite(raw) & ~excluded
        k = np.empty_like(raw)
        for row, values, used in zip(k, raw, use, strict=True):  # starts read all strips, fits the used ones
            if not used.all():
                values = np.interp(x_mm, x_mm[used], values[used]) if used.any() else np.zeros_like(values)
            row[:] = values
        weight = np.where(use, 1.0 / sigma**2, 0.0)
        return cls.of_strips(sensor, x_mm, tuple(readings), np.clip(k, -1.0, 2.0), weight, margin_mm)

    @classmethod
    def of_strips(
        cls,
        sensor: Sensor,
        x_mm: FloatArray,
        names: tuple[str, ...],
        k: FloatArray,
        weight: FloatArray,
        margin_mm: float = 0.0,
    ) -> FitProblem:
        """Make the problem of readings k (S, n) of the signatures `names`, with their weights (S, n)."""
        a = sensing_share(sensor.sensing_ratio)
        out = 0.5 * sensor.pitch_mm + margin_mm
        origin, width = float(x_mm[0]) - out, float(x_mm[-1] - x_mm[0]) + 2.0 * out
        shares = np.array([a if SIGNATURES[name].at_upper_end else 0.0 for name in names])
        closed_form = shares, 1.0 - a, sensor.contact_lambda_mm / sensor.length_mm
        in_mm = origin, width, sensor.length_mm
        return cls((x_mm - origin) / width, k, weight, sensor.pitch_mm / width, *closed_form, *in_mm)

    @cached_property
    def readings(self) -> int:
        """Readings that count."""
        return int(np.count_nonzero(self.weight))

    def straight(self) -> FloatArray:
        """Return x, l, u of both ends (6,) to begin with: as they read, or with both signatures a line through each.

        Between two pointed ends heights alone would begin without any width, where descents go astray.
        """
        if len(self.k) == 1:
            left, right = self.k[0, [0, 0]], self.k[0, [-1, -1]]
        else:
            middle = self.x.mean()
            off = self.x - middle
            slope, mean = self.k @ off / max(float(off @ off), 1e-12), self.k.mean(axis=1)
            left, right = (np.sort(np.clip(mean + slope * (end - middle), 0.0, 1.0)) for end in (0.0, 1.0))
        return np.array([0.0, *left[[0, -1]], 1.0, *right[[0, -1]]])

    @cached_property
    def compiled(self) -> Problem:
        """What the compiled core takes; the arrays are this problem's own."""
        shares = (float(self.shares[0]), float(self.shares[-1]))
        k, weight = np.ascontiguousarray(self.k), np.ascontiguousarray(self.weight)
        x = np.ascontiguousarray(self.x)
        made = Problem(len(x), len(k), at(x), at(k), at(weight), self.pitch, shares, self.narrow, self.lam)
        made.arrays = (x, k, weight)
        return made

    @cached_property
    def root_weight(self) -> FloatArray:
        """1 / sigma of each reading (S, n)."""
        return np.sqrt(self.weight)

    def jacobian(self, l: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return dk/dl and dk/du of all readings, and the readings k (..., S, n), of contacts l to u (..., n)."""
        l, w, share = l[..., None, :], (u - l)[..., None, :], self.shares[:, None]
        numerator, d = fraction(l, w, 1.0, share, self.narrow, self.lam)
        k = numerator / np.maximum(d, LEAST_D)
        length = 1.0 + np.maximum(LEAST_D - d, 0.0)  # where D would be less the strip counts as longer
        by_l, by_u = reading_jacobian(k, w, length, share > 0.0, 1.0 / self.narrow - 1.0, self.lam)
        return by_l, by_u, k

    def readings_of(self, l: FloatArray, u: FloatArray) -> FloatArray:
        """Return the readings (S, n) of contacts from l to u (n,)."""
        return self.jacobian(l, u)[2]

    @property
    def sigma(self) -> float:
        """Standard deviation of the most certain reading."""
        return float(1.0 / np.sqrt(max(self.weight.max(initial=0.0), np.finfo(float).tiny)))

    def thinned(self) -> FitProblem:
        """Return a long run as some `_STRIPS` strips.

        Neighbours are averaged as far as the noise hides that, then every so many are taken. Averaging over
        s pitches rounds a kink by its jump times s pitch / 8; jumps are about 1.
        """
        n = len(self.x)
        wanted = n // _STRIPS if 2 * n >= 3 * _STRIPS else 1
        hidden, size = (8.0 * self.sigma / self.pitch) ** 2, 1
        while size < wanted and (size + 1) ** 3 <= hidden:
            size += 1
        if wanted == 1:
            return self
        if size == 1:
            return self._every(wanted)
        starts = np.arange(0, n, size)
        counts = np.diff(np.append(starts, n))
        weight = np.add.reduceat(self.weight, starts, axis=1)
        used = np.where(weight > 0.0, weight, 1.0)
        k = np.add.reduceat(self.k * self.weight, starts, axis=1) / used
        plain = np.add.reduceat(self.k, starts, axis=1) / counts
        x = np.add.reduceat(self.x, starts) / counts
        return replace(self, x=x, k=np.where(weight > 0.0, k, plain), weight=weight)._every(wanted // size)

    def _every(self, stride: int) -> FitProblem:
        if stride == 1:
            return self
        at = slice(stride // 2, None, stride)
        x, k, weight = (np.ascontiguousarray(values[..., at]) for values in (self.x, self.k, self.weight))
        return replace(self, x=x, k=k, weight=weight)

    def scaled(self, factor: float) -> FitProblem:
        """Return the problem with sigma times a factor."""
        return replace(self, weight=self.weight / factor**2)

    def without(self, out: BoolArray) -> FitProblem:
        """Return the problem with the readings `out` (S, n) left out."""
        return replace(self, weight=np.where(out, 0.0, self.weight))
