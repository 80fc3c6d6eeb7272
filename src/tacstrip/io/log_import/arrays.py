"""Named arrays as a table: their first axis is the scans, others are strips and channels."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy.typing as npt

from tacstrip.errors import ReadingError
from tacstrip.io.log_import.names import meanings
from tacstrip.io.log_import.table import Table, flattened, said_above


def of_arrays(
    arrays: dict[str, npt.NDArray[Any]], path: str | Path, numbers: Mapping[str, Any], *told: str
) -> Table:
    """Return arrays of as many scans as a table; `numbers` that stand beside them are as lines above it.

    Raises
    ------
    ReadingError
        There is none, or one is as long as wide, so that nothing tells its scans from its strips.
    """
    lengths = Counter(a.shape[0] for a in arrays.values() if 1 <= a.ndim <= 3)
    if not lengths:
        raise ReadingError(f"{path}: no array of scans (scans,) or (scans, strips) in it")
    clocks = [len(a) for name, a in arrays.items() if a.ndim == 1 and meanings([name])[name].role == "time"]
    scans = clocks[0] if clocks else max(lengths.items(), key=lambda item: (item[1], item[0]))[0]
    arrays = {
        name: a.T if a.ndim == 2 and a.shape[0] != scans == a.shape[1] else a for name, a in arrays.items()
    }
    if square := [
        name for name, a in arrays.items() if a.ndim == 2 and a.shape == (scans, scans) and scans > 1
    ]:
        raise ReadingError(
            f"{path}: {square[0]} is {scans} by {scans}, so nothing tells the scans from the strips; save it with one "
            "scan more or less, or a column for each strip"
        )
    used = {name: a for name, a in arrays.items() if 1 <= a.ndim <= 3 and a.shape[0] == scans}
    passed = [name for name in arrays if name not in used]
    widths = {a.shape[1:]: name for name, a in used.items() if a.ndim > 1}
    for name in passed:
        if arrays[name].ndim > 1 and (beside := widths.get(arrays[name].shape[1:])):
            raise ReadingError(
                f"{path}: {name} has {len(arrays[name])} rows, and {beside} has {scans}: is a row lost?"
            )
    records = [
        {key: text for name, a in used.items() for key, text in flattened(name, a[n].tolist()).items()}
        for n in range(scans)
    ]
    if not records or not records[0]:
        raise ReadingError(f"{path}: its arrays hold nothing")
    remarks = (*told, *([f"arrays of another length passed over: {', '.join(passed)}"] if passed else []))
    names = tuple(records[0])
    return Table(
        names, [list(r.values()) for r in records], list(range(1, scans + 1)), remarks=remarks,
        preamble=said_above(numbers),
    )  # fmt: skip
