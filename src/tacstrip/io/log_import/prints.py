"""What MATLAB, Octave and R save or print of their arrays."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from tacstrip.errors import ReadingError
from tacstrip.io.log_import.arrays import of_arrays
from tacstrip.io.log_import.fields import number_of, says_nothing
from tacstrip.io.log_import.table import Table

_SAVED = re.compile(r"(?m)^# name: (\w+)\n# type: (?:complex )?matrix\n((?:# .*\n)+)((?:[^#\n]*\n)+)")


def of_octave(text: str, path: str) -> Table | None:
    """Return what Octave saves as text: names, sizes, and the numbers below them."""
    arrays: dict[str, npt.NDArray[Any]] = {}
    for name, size, body in _SAVED.findall(text):
        values = vector(body.split())
        shape = [int(n) for n in re.findall(r"(?:rows|columns): (\d+)", size)]
        if values is None or len(values) != int(np.prod(shape)):
            raise ReadingError(f"{path}: {name} is said to be of {shape} numbers, and is not: is it cut?")
        arrays[name] = values.reshape(shape).squeeze()
    return of_arrays(arrays, path, {}, "matrices as Octave saves them") if arrays else None


def vector(fields: Sequence[str]) -> npt.NDArray[np.float64] | None:
    """Return fields as numbers; None where one is none, and does not say that nothing touches."""
    plain = [re.sub(r"(?<=\d)L\Z", "", f.strip().strip('"')) for f in fields]
    spread: list[float | None] = []
    for f in plain:
        if found := re.fullmatch(r"(\d+):(\d+)", f):
            spread += [float(v) for v in range(int(found[1]), int(found[2]) + 1)]
        else:
            spread.append(float("nan") if says_nothing(f) or f == "NA" else number_of(f))
    return None if None in spread else np.array(spread, dtype=np.float64)
