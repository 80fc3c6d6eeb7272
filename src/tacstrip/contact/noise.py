"""The errors of section 5.1: combined quantisation, positional uncertainty, transition error, A/D bits."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, Self, TypeAlias

import numpy as np

from tacstrip.arguments import refuse_positional
from tacstrip.arrays import FloatArray
from tacstrip.errors import OptionError, one_of

Rng: TypeAlias = int | np.random.Generator

_DISTRIBUTIONS = ("uniform", "normal")


@dataclass(frozen=True, kw_only=True)
class Noise:
    """Half-widths of independent errors, each by its name: `Noise(positional=0.005)`.

    Attributes
    ----------
    quantisation
        Combined quantisation error C.Q.E. on every reading, as a fraction of Vref (5.1.1).
    positional
        Positional uncertainty P.U. on every reading, as a fraction of Vref (5.1.3).
    transition_mm
        Transition error T.E. on the x of every transition handed to a reconstruction [mm] (5.1.2).
    distribution
        "uniform" as in the thesis, or "normal" with sigma = half-width / sqrt(3), the same variance.

    Raises
    ------
    OptionError
        A half-width is below 0, or above 1 where it is a fraction of Vref; there is no such distribution.
    ArgumentError
        A value has no name.

    Examples
    --------
    >>> Noise(positional=0.005).positional
    0.005
    """

    quantisation: float = 0.0
    positional: float = 0.0
    transition_mm: float = 0.0
    distribution: Literal["uniform", "normal"] = "uniform"

    def __new__(cls, *values: object, **named: object) -> Self:
        """Refuse numbers without a name: `ArgumentError`."""
        refuse_positional("ts.Noise", values, "ts.Noise(positional=0.005), or quantisation=, transition_mm=")
        return super().__new__(cls)

    def __post_init__(self) -> None:
        if self.distribution not in _DISTRIBUTIONS:
            raise OptionError(one_of("distribution", self.distribution, _DISTRIBUTIONS))
        for name in ("quantisation", "positional", "transition_mm"):
            value = getattr(self, name)
            if not isinstance(value, int | float) or not 0.0 <= value < math.inf:
                raise OptionError(f"{name} = {value!r}: must be 0 or more")
        for name in ("quantisation", "positional"):
            if getattr(self, name) > 1.0:
                raise OptionError(f"{name} = {getattr(self, name)}: a fraction of Vref, 0.01 for 1 %")


def add_reading_errors(k: FloatArray, noise: Noise, rng: np.random.Generator) -> FloatArray:
    """Return readings with their errors added (5.1)-(5.3), any shape; not clipped. NaN stays NaN."""
    for half_width in (noise.quantisation, noise.positional):
        if half_width:
            k = k + _draw(half_width, noise.distribution, k.shape, rng)
    return k


def add_transition_errors(x_mm: FloatArray, noise: Noise, rng: np.random.Generator) -> FloatArray:
    """Return transitions [mm] with their error added (5.1.2)."""
    if not noise.transition_mm:
        return x_mm
    return np.asarray(x_mm + _draw(noise.transition_mm, noise.distribution, x_mm.shape, rng))


def digitise(k: FloatArray, bits: int | None) -> FloatArray:
    """Return readings as an A/D converter of so many bits gives them: clipped to 0..1, then rounded.

    Codes run from 0 to 2^bits - 1, which reads Vref. Without a converter, readings are only clipped.
    """
    k = np.clip(k, 0.0, 1.0)
    if bits is None:
        return k
    top = 2.0**bits - 1.0
    return np.asarray(np.round(k * top) / top)


def generator(rng: Rng) -> np.random.Generator:
    """Return the generator for a seed, 0 or above; a generator is returned as it is."""
    return rng if isinstance(rng, np.random.Generator) else np.random.default_rng(rng)


def _draw(
    half_width: float, distribution: str, shape: tuple[int, ...], rng: np.random.Generator
) -> FloatArray:
    if distribution == "normal":
        return rng.normal(0.0, half_width / math.sqrt(3.0), shape)
    return rng.uniform(-half_width, half_width, shape)
