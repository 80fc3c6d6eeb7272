"""Errors that fade: a first-order process, whatever its steps and its memory are."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]


def first_order(new: Array, keep: Array | float) -> Array:
    """Return y (scans, ...) of y_0 = new_0 and y_i = keep_i y_(i-1) + new_i.

    As scipy.signal.lfilter does where `keep` (scans,) is one number, to the bit; that takes a second to import.
    """
    out, keep = new.copy(), np.broadcast_to(keep, len(new))
    for i in range(1, len(out)):
        out[i] += keep[i] * out[i - 1]
    return out
