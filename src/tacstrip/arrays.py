"""The array types that signatures of functions use, and arrays in a few words."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

FloatArray: TypeAlias = npt.NDArray[np.float64]
IntArray: TypeAlias = npt.NDArray[np.int64]
BoolArray: TypeAlias = npt.NDArray[np.bool_]


def plain(values: npt.ArrayLike, digits: int | None = None) -> Any:
    """Return an array as nested lists of numbers for JSON, rounded to `digits`, None for what is not finite."""
    array = np.asarray(values, dtype=float)
    numbers = np.array(array if digits is None else np.round(array, digits), dtype=object)
    numbers[~np.isfinite(array)] = None
    return numbers.tolist()


def numbers(values: npt.ArrayLike) -> FloatArray:
    """Return a copy as an array of numbers; `TypeError` for texts, in which NumPy takes 1_0 and any script's digits."""
    if not isinstance(values, np.ndarray) or values.dtype.kind in "USO":
        array = np.asarray(values)
        if array.dtype.kind in "US" or any(
            isinstance(v, str | bytes) for v in array.ravel() if array.dtype.kind == "O"
        ):
            raise TypeError("a text is no number")
    return np.array(values, dtype=float)


def finite_runs(points: FloatArray, least: int = 1) -> list[FloatArray]:
    """Return the parts (N, dimensions) of a line that NaN parts, those of `least` points or more."""
    known = np.isfinite(points).all(axis=1)
    edges = np.flatnonzero(np.diff(known.astype(np.int8), prepend=0, append=0))
    return [points[a:b] for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a >= least]


def extent(values: FloatArray) -> str:
    """Write the range of values in a few words, such as "0.2 to 0.51"; NaN does not count."""
    known = values[np.isfinite(values)]
    return f"{known.min():.3g} to {known.max():.3g}" if len(known) else "none"


def touched_strips(touched: BoolArray) -> str:
    """Write which strips are touched in a few words, such as "31 touched (9 to 39)", counted from 0."""
    which = np.flatnonzero(touched)
    return f"{len(which)} touched ({which[0]} to {which[-1]})" if len(which) else "none touched"
