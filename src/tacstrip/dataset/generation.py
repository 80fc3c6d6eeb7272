"""Labelled data sets on disk: parts that are made once and the same whenever, and a card that says of what.

Parquet files, one a part, take their names when they are whole. A Zarr group is made in the hidden folder `.work`,
where a finished part leaves a mark, and takes its name when all parts are there. A run that was ended goes on with the
parts that are missing; nothing that is written depends on when or in which order.
"""

from __future__ import annotations

import errno
import json
import shutil
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import asdict, dataclass
from functools import cached_property, partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tacstrip.contact.noise import Noise
from tacstrip.dataset.batches import available_cores, simulate_many
from tacstrip.dataset.scans import Scans
from tacstrip.dataset.shapes import KINDS, Shapes
from tacstrip.dataset.study import Study, fingerprint, optional
from tacstrip.errors import OptionError, SpecError, one_of
from tacstrip.files import replacing, write_text
from tacstrip.sensor.spec import Sensor

KEYS = ("name", "seed", "licence", "sensor", "shapes", "noise", "dataset")
FORMATS = ("parquet", "zarr")
SPLITS = ("train", "validation", "test")
_OF_DATASET = ("formats", "split", "dtype", "part_scans", "model")
_COMPRESSED = 10  # times: hardly any data set takes less of the disk than this part of the memory
_PART_BYTES = 2**25  # of readings and labels together, where the study gives no number of scans
# Scans of a part at most where strips of some width are resolved one by one, up to seconds each.
_RESOLVED = 1000
_BLOCK, _RESOLVED_BLOCK = 4096, 1  # scans that are made between two looks whether the end was asked for
_ROW_GROUP = 8192  # rows of a Parquet file that are read together
_WORK, _PLAN, _CARD = ".work", "plan.json", "dataset.json"
# What a column holds, and its unit.
_COLUMNS = {
    "scan": "number of the scan",
    "scene": "number of the scene: the same objects, moving; a scene is in one split only",
    "time_s": "time from the beginning of the scene [s]",
    "kh": "voltage at the upper end of the sensing strip over Vref, a number a strip; NaN: not touched",
    "kl": "voltage at its lower end over Vref",
    "k": "voltage of the metal sheet over Vref",
    "l": "lower end of the contact on each strip [mm]; NaN: not touched",
    "u": "upper end of the contact [mm]",
    "kind": "of each object: " + ", ".join(f"{i} {name}" for i, name in enumerate(KINDS[:4])),
    "corners": "number of corners of each object",
    "pose": "x, y [mm] and angle [rad] of each object's ellipse; NaN: no object",
    "axes": "half its long and its short axis [mm]",
    "vertices": "x, y [mm] of each object's corners, counter-clockwise; NaN beyond its number",
}


@dataclass(frozen=True)
class Part:
    """Neighbouring scans of one split: its number in the split, its first scan, and how many."""

    split: str
    number: int
    first: int
    scans: int


@dataclass(frozen=True)
class DataSet:
    """What a study file asks for.

    Raises
    ------
    SpecError
        The study cannot be: an unknown key, an impossible value, objects that the sensor has no room for.
    """

    name: str
    seed: int
    licence: str
    sensor: Sensor
    shapes: Shapes
    noise: Noise
    formats: tuple[str, ...]
    split: dict[str, float]
    dtype: str
    part_scans: int
    model: str | None

    @classmethod
    def load(cls, path: Path) -> DataSet:
        """Read a study file."""
        study = Study.load(path, KEYS)
        sensor = study.sensor()
        with study.naming("shapes"):
            shapes = Shapes.from_dict(study.table("shapes", needed=True))
            shapes.laws(sensor)
        given = study.table("dataset", _OF_DATASET)
        with study.naming("dataset"):
            formats = _formats(given.get("formats", ["parquet"]))
            split = _split(given.get("split", {"train": 0.8, "validation": 0.1, "test": 0.1}))
            dtype, model = given.get("dtype", "float32"), given.get("model")
            if dtype not in ("float32", "float64"):
                raise OptionError(one_of("dtype", dtype, ("float32", "float64")))
            if model not in (None, "closed", "network"):
                raise OptionError(one_of("model", model, ("closed", "network")))
            most = _RESOLVED if resolved(sensor, model) else _PART_BYTES
            part = given.get("part_scans", max(min(_PART_BYTES // _scan_bytes(sensor, dtype), most), 1))
            if not isinstance(part, int) or isinstance(part, bool) or part < 1:
                raise OptionError(f"part_scans = {part!r}: must be a whole number, 1 or more")
        licence = study.text("licence", "CC-BY-4.0")
        return cls(
            study.text("name", path.stem), study.whole("seed", 0), licence, sensor, shapes, study.noise(sensor),
            formats, split, dtype, part, model,
        )  # fmt: skip

    @cached_property
    def parts(self) -> list[Part]:
        """All parts, split by split: whole scenes only, each in one split."""
        edges = np.round(np.cumsum([0.0, *(self.split[name] for name in SPLITS)]) * self.shapes.scenes)
        scans = np.minimum(edges.astype(int) * self.shapes.frames, self.shapes.n).tolist()
        return [
            Part(name, i, first, min(self.part_scans, end - first))
            for name, begin, end in zip(SPLITS, scans[:-1], scans[1:], strict=True)
            for i, first in enumerate(range(begin, end, self.part_scans))
        ]

    @cached_property
    def counts(self) -> dict[str, int]:
        """Scans of each split."""
        return {name: sum(p.scans for p in self.parts if p.split == name) for name in SPLITS}

    @cached_property
    def content(self) -> dict[str, Any]:
        """What decides every byte, for the card and for the fingerprint."""
        return {
            "name": self.name, "seed": self.seed, "licence": self.licence, "sensor": self.sensor.to_toml(),
            "shapes": self.shapes.to_dict(), "noise": asdict(self.noise), "formats": list(self.formats),
            "split": self.split, "dtype": self.dtype, "part_scans": self.part_scans, "model": self.model,
            "tacstrip": version("tacstrip"),
        }  # fmt: skip

    def blocks(self, part: Part) -> Iterator[Scans]:
        """Make a part's scans with their labels, some whole scenes at a time."""
        frames, begin, end = self.shapes.frames, part.first, part.first + part.scans
        scenes = -(-(_RESOLVED_BLOCK if resolved(self.sensor, self.model) else _BLOCK) // frames)
        while begin < end:
            stop = min((begin // frames + scenes) * frames, end)
            yield self._simulate(begin, stop - begin)
            begin = stop

    def columns(
        self, part: Part, made: Callable[[int], object] = lambda _: None
    ) -> dict[str, npt.NDArray[Any]]:
        """Return a part's columns, an array with a row a scan each; `made` is called with the scans of each block."""
        blocks = []
        for scans in self.blocks(part):
            blocks.append(_columns(scans))
            made(len(scans))
        found = {key: np.concatenate([block[key] for block in blocks]) for key in blocks[0]}
        return {"scan": np.arange(part.first, part.first + part.scans), **found}

    def first_columns(self) -> dict[str, npt.NDArray[Any]]:
        """Return the columns of the first scan."""
        return {"scan": np.arange(1), **_columns(self._simulate(self.parts[0].first, 1))}

    def _simulate(self, first: int, scans: int) -> Scans:
        shapes = Shapes.from_dict(self.shapes.to_dict() | {"n": scans})
        model: Any = self.model
        return simulate_many(
            self.sensor, shapes, self.noise, rng=self.seed, dtype=self.dtype, model=model, first=first, workers=1
        )  # fmt: skip


class _EndedError(Exception):
    """The end was asked for: nothing more is made."""


def generate(
    data: DataSet, out: Path, workers: int | None = None, progress: Callable[[int, int], object] | None = None
) -> bool:
    """Write a data set into a folder, or what is missing of it there.

    Parameters
    ----------
    data
        What to write.
    out
        The folder: new, empty, or one with a part of the same data set.
    workers
        Threads, by default one a core. Each holds two parts at most.
    progress
        Called with the scans that are there and those that will be.

    Returns
    -------
    bool
        Whether anything was missing.

    Raises
    ------
    OptionError
        The folder holds something else, or pyarrow or zarr is not installed.
    OSError
        The disk has not the room.
    """
    for name in data.formats:
        optional({"parquet": "pyarrow.parquet", "zarr": "zarr"}[name])
    card = {"fingerprint": fingerprint(data.content), **data.content, "scans": data.counts}
    _check_room(data, out)
    if not _begin(out, card):
        return False
    work = out / _WORK
    writers: list[tuple[Callable[[Part], Path], Callable[[Part, dict[str, npt.NDArray[Any]]], None]]] = []
    if "parquet" in data.formats:
        writers.append(
            (partial(_parquet_file, out), partial(_write_parquet, out, json.dumps(card["fingerprint"])))
        )
    if "zarr" in data.formats:
        _create_zarr(data, out)
        writers.append((partial(_zarr_mark, out), partial(_write_zarr, out, data)))

    def missing(part: Part) -> list[Callable[[Part, dict[str, npt.NDArray[Any]]], None]]:
        return [write for done, write in writers if not done(part).exists()]

    ended, lock = threading.Event(), threading.Lock()
    total, done, tell = data.shapes.n, 0, progress or (lambda *_: None)

    def count(scans: int) -> None:
        nonlocal done
        if ended.is_set():
            raise _EndedError
        with lock:
            done += scans
            tell(done, total)

    def make(part: Part) -> None:
        writing = missing(part)
        if not writing:
            count(part.scans)
            return
        columns = data.columns(part, count)
        for write in writing:
            write(part, columns)

    _in_threads(make, data.parts, available_cores() if workers is None else workers, ended)
    for split in SPLITS:
        if "zarr" in data.formats and (made := work / f"{split}.zarr").exists():
            made.replace(out / f"{split}.zarr")
    write_text(out / "sensor.toml", data.sensor.to_toml())
    write_text(out / "README.md", _readme(data))
    write_text(out / _CARD, json.dumps(card, indent=1) + "\n")
    shutil.rmtree(work)
    return True


def parts_there(data: DataSet, out: Path) -> int:
    """Return how many parts of a data set are whole in its folder, in every format."""
    of = {"parquet": _parquet_file, "zarr": _zarr_mark}
    return sum(all(of[name](out, part).exists() for name in data.formats) for part in data.parts)


def _in_threads(
    make: Callable[[Part], None], parts: list[Part], workers: int, ended: threading.Event
) -> None:
    """Make all parts; none is begun, and what is begun is left, once one fails or the end is asked for."""

    def run(part: Part) -> None:
        try:
            if not ended.is_set():
                make(part)
        except _EndedError:
            pass
        except BaseException:
            ended.set()  # here, for this thread may begin the next part before the one that waits knows
            raise

    with ThreadPoolExecutor(max(workers, 1)) as threads:
        waiting: set[Future[None]] = set()
        try:
            for part in parts:
                if len(waiting) > workers:
                    done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                    for future in done:
                        future.result()
                waiting.add(threads.submit(run, part))
            for future in waiting:
                future.result()
        except BaseException:
            ended.set()
            threads.shutdown(cancel_futures=True)
            raise


def resolved(sensor: Sensor, model: str | None) -> bool:
    """Whether scans are resolved one by one: by a network, or as no closed form covers them."""
    wide = model is None and sensor.strip_width_mm is not None
    return model == "network" or wide or not sensor.kind.closed_form


def _begin(out: Path, card: dict[str, Any]) -> bool:
    """Make the folder, or see what of this data set is there; return whether any of it is missing."""
    plan, finished = out / _WORK / _PLAN, out / _CARD
    there = next((file for file in (finished, plan) if file.exists()), None)
    if there is not None:
        try:
            held = json.loads(there.read_text(encoding="utf-8"))["fingerprint"]
        except (ValueError, KeyError, TypeError):
            held = None
        if held != card["fingerprint"]:
            raise OptionError(
                f"{out} holds another data set, of other settings or another version; choose another folder"
            )
        if there == finished:
            shutil.rmtree(out / _WORK, ignore_errors=True)
            return False
    elif out.exists() and (not out.is_dir() or any(p.name != _WORK for p in out.iterdir())):
        raise OptionError(f"{out} exists and is no data set; choose another folder")
    (out / _WORK).mkdir(parents=True, exist_ok=True)
    write_text(plan, json.dumps(card) + "\n")
    for split in SPLITS:
        for left in (out / split).glob(".tacstrip-*.part"):  # of a run that was killed
            left.unlink()
    return True


def _scan_bytes(sensor: Sensor, dtype: str) -> int:
    """Return how many bytes a scan with its labels takes in memory."""
    return (5 + len(sensor.signatures)) * sensor.strips * (4 if dtype == "float32" else 8)


def _check_room(data: DataSet, out: Path) -> None:
    """Refuse what will not fit on the disk, however well it is compressed: `OSError`."""
    bytes_each = _scan_bytes(data.sensor, data.dtype) * len(data.formats) / _COMPRESSED
    least = bytes_each * (data.shapes.n - parts_there(data, out) * data.part_scans)
    free = shutil.disk_usage(next(p for p in (out, *out.absolute().parents) if p.exists())).free
    if least > free:
        raise OSError(
            errno.ENOSPC,
            f"{data.shapes.n} scans take {least / 1e9:.3g} GB or more, and {free / 1e9:.3g} GB are free",
            str(out),
        )


def _columns(scans: Scans) -> dict[str, npt.NDArray[Any]]:
    """Return the columns but the scans' numbers, an array with a row a scan each."""
    assert scans.labels is not None
    assert scans.l is not None
    found = {"scene": scans.labels.scene, "time_s": np.asarray(scans.time_s)}
    found |= {name: scans[name] for name in scans.signatures}
    found |= {"l": scans.l, "u": np.asarray(scans.u)}
    return found | {name: values for name, values in vars(scans.labels).items() if name != "scene"}


def _parquet_file(out: Path, part: Part) -> Path:
    return out / part.split / f"part-{part.number:05d}.parquet"


def _write_parquet(out: Path, name: str, part: Part, columns: dict[str, npt.NDArray[Any]]) -> None:
    """Write a part: a row a scan, arrays as lists of one length; their shapes are in the schema's metadata."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    arrays = {}
    for key, values in columns.items():
        flat = pa.array(np.ascontiguousarray(values).reshape(-1))
        size = values[0].size
        arrays[key] = flat if values.ndim == 1 else pa.FixedSizeListArray.from_arrays(flat, size)
    shapes = {key: list(values.shape[1:]) for key, values in columns.items()}
    table = pa.table(arrays).replace_schema_metadata({"shapes": json.dumps(shapes), "data set": name})
    file = _parquet_file(out, part)
    file.parent.mkdir(exist_ok=True)
    with replacing(file) as new:
        pq.write_table(
            table, new, compression="zstd", compression_level=1, use_dictionary=False, write_statistics=False,
            row_group_size=_ROW_GROUP,
        )  # fmt: skip


def _zarr_group(out: Path, split: str) -> Path:
    return out / _WORK / f"{split}.zarr"


def _zarr_mark(out: Path, part: Part) -> Path:
    """Return the file that says that a part of the Zarr group is whole; a group with its name has all."""
    final = out / f"{part.split}.zarr"
    return final if final.exists() else out / _WORK / f"{part.split}-{part.number:05d}.done"


def _create_zarr(data: DataSet, out: Path) -> None:
    """Make the groups with empty arrays; a run that goes on finds them."""
    import zarr

    for split, count in data.counts.items():
        path = _zarr_group(out, split)
        if not count or path.exists() or (out / f"{split}.zarr").exists():
            continue
        new = path.with_suffix(".new")
        shutil.rmtree(new, ignore_errors=True)
        group = zarr.open_group(new, mode="w", attributes={"data set": fingerprint(data.content)})
        for key, values in data.first_columns().items():
            group.create_array(
                key,
                shape=(count, *values.shape[1:]),
                chunks=(min(data.part_scans, count), *values.shape[1:]),
                dtype=values.dtype,
                dimension_names=_dimensions(key, values.ndim),
                attributes={"description": _COLUMNS[key]},
                fill_value=np.nan if values.dtype.kind == "f" else 0,
            )
        new.replace(path)


def _dimensions(column: str, count: int) -> list[str]:
    if column in ("kh", "kl", "k", "l", "u"):
        return ["scan_row", "strip"]
    last = {"pose": "pose_entry", "axes": "axis", "vertices": "xy"}.get(column, "")
    return ["scan_row", "object", *(["corner"] if column == "vertices" else []), last][:count]


def _write_zarr(out: Path, data: DataSet, part: Part, columns: dict[str, npt.NDArray[Any]]) -> None:
    """Write a part, which is one chunk of every array, and mark it."""
    import zarr

    group = zarr.open_group(_zarr_group(out, part.split), mode="r+")
    begin = part.number * data.part_scans
    for key, values in columns.items():
        array = group[key]
        assert isinstance(array, zarr.Array)
        array[begin : begin + part.scans] = values
    _zarr_mark(out, part).touch()


def _readme(data: DataSet) -> str:
    """Return the data card: front matter that data hubs read, and what a reader needs without tacstrip."""
    first = data.first_columns()
    shape = "x".join(str(s) for s in first["vertices"].shape[1:])
    rows = "\n".join(
        f"| `{key}` | {values.dtype} | {'x'.join(str(s) for s in values.shape[1:]) or 'number'} | {_COLUMNS[key]} |"
        for key, values in first.items()
    )
    drawn = "\n".join(f"- `{key} = {json.dumps(value)}`" for key, value in data.shapes.to_dict().items())
    counts = ", ".join(f"{count} {name}" for name, count in data.counts.items())
    errors = {key: value for key, value in asdict(data.noise).items() if value != getattr(Noise(), key)}
    which, corners, objects = data.sensor.signatures[0], *first["vertices"].shape[1:3][::-1]
    return f"""---
license: {data.licence.lower()}
pretty_name: {data.name}
tags: [tactile, simulation]
---

# {data.name}

Simulated scans of a resistive hybrid tactile sensor, with what touched it: {data.shapes.n} scans ({counts}) of
{data.shapes.scenes} scenes. A scene, and so an object, is in one split only. Made by tacstrip {version("tacstrip")}
from seed {data.seed}; the same study makes the same bytes with the same versions of tacstrip and of the libraries that
write them. Licence: {data.licence}.

## Columns

Lengths in millimetres: x across the strips, y along them from the grounded end. Strip i, from 0, has its centre line at
x = (i + 0.5) {data.sensor.pitch_mm:g}. In Parquet, arrays of several dimensions are flat lists, the last index fastest.

| name | type | shape of a row | what |
| --- | --- | --- | --- |
{rows}

## How it was drawn

Numbers between two are uniform. Errors of readings: {json.dumps(errors) if errors else "none"} (over Vref).

{drawn}

The sensor is in `sensor.toml`, everything together in `dataset.json`.

## Reading it

Corners of a scan's first object: a row of `vertices` ({shape}), of which `corners` says how many count.

{chr(10).join(_examples(data.formats, which, objects, corners))}"""


def _examples(formats: Sequence[str], which: str, objects: int, corners: int) -> Iterator[str]:
    """Give a snippet for each form that shows how `which` signature, and outlines (objects, corners), are read."""
    if "parquet" in formats:
        yield f"""```python
import numpy as np
import pandas as pd  # pip install pandas pyarrow; run beside this file; lists become NumPy arrays

table = pd.read_parquet("train")
readings = np.stack(table["{which}"])  # (scans, strips)
vertices = np.stack(table["vertices"]).reshape(-1, {objects}, {corners}, 2)
```

```python
import pyarrow.parquet as pq  # without pandas, and for PyTorch and JAX

column = pq.read_table("train", columns=["{which}"])["{which}"].combine_chunks()
readings = column.flatten().to_numpy().reshape(len(column), -1)
# torch.from_numpy(readings.copy()), or jax.numpy.asarray(readings)
```
"""
    if "zarr" in formats:
        yield f"""```python
import xarray as xr  # or zarr.open("train.zarr")

scans = xr.open_zarr("train.zarr", consolidated=False)
readings = scans["{which}"]  # dimensions scan_row, strip; loaded when used
```
"""


def _formats(given: Any) -> tuple[str, ...]:
    found = [given] if isinstance(given, str) else given
    if not isinstance(found, list) or not found:
        raise OptionError(f'formats = {given!r}: give a list, such as ["parquet"]')
    for name in found:
        if name not in FORMATS:
            raise OptionError(one_of("format", name, FORMATS))
    return tuple(found)


def _split(given: Any) -> dict[str, float]:
    good = isinstance(given, dict) and all(
        isinstance(v, int | float) and not isinstance(v, bool) and 0.0 <= v <= 1.0 for v in given.values()
    )
    if not good or abs(sum(given.values()) - 1.0) > 1e-9 or any(name not in SPLITS for name in given):
        raise SpecError(
            f"split = {given!r}: give shares of {', '.join(SPLITS)} whose sum is 1, such as "
            "{train = 0.8, validation = 0.1, test = 0.1}"
        )
    return {name: float(given.get(name, 0.0)) for name in SPLITS}
