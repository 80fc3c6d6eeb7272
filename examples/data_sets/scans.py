"""Read a data set that `tacstrip generate` wrote, without tacstrip: Parquet by PyArrow or Zarr, to NumPy arrays."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float32]
READINGS, TARGET = ("kh", "kl", "k"), "pose"


def columns(folder: Path, split: str) -> dict[str, npt.NDArray[Any]]:
    """Return readings (scans, strips) by name, and `pose` (scans, objects, 3), from whichever format is there."""
    if (folder / f"{split}.zarr").exists():
        import zarr

        group = zarr.open_group(folder / f"{split}.zarr", mode="r")
        return {name: np.asarray(group[name]) for name in (*READINGS, TARGET) if name in group}
    import pyarrow.parquet as pq

    names = [name for name in (*READINGS, TARGET) if name in pq.ParquetDataset(folder / split).schema.names]
    table = pq.read_table(folder / split, columns=names)
    flat = {name: table[name].combine_chunks().flatten().to_numpy() for name in names}
    found = {name: values.reshape(len(table), -1) for name, values in flat.items()}
    return found | {TARGET: found[TARGET].reshape(len(table), -1, 3)}


def inputs_and_targets(folder: Path, split: str) -> tuple[Floats, Floats]:
    """Return what a network is given and what it is to find.

    Inputs are (scans, channels, strips): each signature, 0 where nothing touches, and last whether a strip is touched.
    Targets (scans, 2) are x and y [mm] of the first object's centre.
    """
    found = columns(folder, split)
    signatures = [found[name] for name in READINGS if name in found]
    touched = ~np.isnan(signatures[0])
    channels = [np.nan_to_num(k) for k in signatures] + [touched]
    inputs = np.stack(channels, axis=1).astype(np.float32)
    return inputs, np.ascontiguousarray(found[TARGET][:, 0, :2], dtype=np.float32)
