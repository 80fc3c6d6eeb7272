"""Data sets: complete, split by scene, read without tacstrip, and the same however often the work was interrupted."""

from __future__ import annotations

import errno
import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import tacstrip as ts
from tacstrip.cli import generate as verb
from tacstrip.cli.generate import command
from tacstrip.dataset import generation
from tacstrip.dataset.generation import DataSet, generate
from tacstrip.errors import OptionError, SpecError

pq = pytest.importorskip("pyarrow.parquet")
# Loaded where it is needed: every process that collects would wait for it.
pytestmark = pytest.mark.skipif(find_spec("zarr") is None, reason="needs zarr, of the group dev")

STUDY = """
name = "few"
seed = 5
licence = "CC0-1.0"
[sensor]
construction = "crs-crs"
strips = 12
pitch_mm = 5.0
length_mm = 60.0
[shapes]
n = 95
corners = [3, 5]
objects = [0, 2]
frames = 3
[noise]
positional = 0.005
[dataset]
formats = ["parquet", "zarr"]
part_scans = 20
split = {train = 0.7, validation = 0.1, test = 0.2}
"""


@pytest.fixture
def study(tmp_path: Path) -> DataSet:
    (tmp_path / "study.toml").write_text(STUDY, encoding="utf-8")
    return DataSet.load(tmp_path / "study.toml")


def _files(folder: Path) -> dict[str, bytes]:
    return {str(f.relative_to(folder)): f.read_bytes() for f in folder.rglob("*") if f.is_file()}


def test_a_data_set_is_whole_split_by_scene_and_read_without_tacstrip(study: DataSet, tmp_path: Path) -> None:
    zarr, out = pytest.importorskip("zarr"), tmp_path / "data"
    assert generate(study, out)
    scans = ts.simulate_many(study.sensor, study.shapes, study.noise, rng=5, dtype="float32")
    assert scans.labels is not None
    scenes, begin = {}, 0
    for split, count in study.counts.items():
        files = sorted((out / split).glob("*.parquet"))
        rows = [row for file in files for row in pq.ParquetFile(file).read().to_pylist()]
        assert [row["scan"] for row in rows] == list(range(begin, begin + count))
        part = slice(begin, begin + count)
        np.testing.assert_array_equal(np.array([row["kh"] for row in rows], np.float32), scans["kh"][part])
        group = zarr.open_group(out / f"{split}.zarr", mode="r")
        np.testing.assert_array_equal(group["kl"][:], scans["kl"][part])
        np.testing.assert_array_equal(group["vertices"][:], scans.labels.vertices[part])
        flat = np.array([row["vertices"] for row in rows], np.float32)
        np.testing.assert_array_equal(flat.reshape(count, 2, 5, 2), scans.labels.vertices[part])
        scenes[split] = {row["scene"] for row in rows}
        begin += count
    assert begin == 95
    assert [len(s) for s in scenes.values()] == [22, 4, 6]  # of 32 scenes of three scans
    assert not scenes["train"] & scenes["test"] | scenes["train"] & scenes["validation"]
    assert ts.Sensor.load(out / "sensor.toml") == study.sensor
    assert json.loads((out / "dataset.json").read_text(encoding="utf-8"))["seed"] == 5


def test_the_examples_read_both_formats_alike(study: DataSet, tmp_path: Path) -> None:
    """What the examples for PyTorch and JAX share; neither is installed here."""
    spec = spec_from_file_location("scans", Path(__file__).parents[2] / "examples" / "data_sets" / "scans.py")
    assert spec is not None
    assert spec.loader is not None
    example = module_from_spec(spec)
    spec.loader.exec_module(example)
    out = tmp_path / "data"
    generate(study, out)
    scans = ts.simulate_many(study.sensor, study.shapes, study.noise, rng=5, dtype="float32")
    assert scans.labels is not None
    by_zarr = example.inputs_and_targets(out, "train")
    shutil.rmtree(out / "train.zarr")
    for found in (by_zarr, example.inputs_and_targets(out, "train")):
        inputs, targets = found
        assert inputs.shape == (66, 3, 12)
        assert inputs.dtype == np.float32
        np.testing.assert_array_equal(inputs[:, 0], np.nan_to_num(scans["kh"][:66]))
        np.testing.assert_array_equal(inputs[:, 2] > 0.0, scans.touched[:66])
        np.testing.assert_array_equal(targets, scans.labels.pose[:66, 0, :2])


def test_the_examples_of_the_card_run(
    study: DataSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those whose packages are installed; pyarrow is."""
    out = tmp_path / "data"
    generate(study, out)
    monkeypatch.chdir(out)
    card = Path("README.md").read_text(encoding="utf-8")
    ran = 0
    for example in re.findall(r"```python\n(.*?)```", card, re.DOTALL):
        if all(find_spec(name) for name in re.findall(r"^import (\w+)", example, re.MULTILINE)):
            names: dict[str, np.ndarray] = {}
            exec(example, names)
            assert names["readings"].shape[1] == 12
            ran += 1
    assert ran >= 1


class _Killed(BaseException):
    """In place of a kill: nothing handles it."""


def _stops_after(scans: int) -> Callable[[int, int], None]:
    def progress(done: int, _: int) -> None:
        if done >= scans:
            raise _Killed

    return progress


def test_an_interrupted_run_goes_on_to_the_same_bytes(study: DataSet, tmp_path: Path) -> None:
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    generate(study, whole, workers=1)
    for scans in (1, 40, 90):
        with pytest.raises(_Killed):
            generate(study, broken, workers=2, progress=_stops_after(scans))
        assert not (broken / "dataset.json").exists()
        assert all(name in _files(whole) for name in _files(broken) if name.endswith(".parquet"))
    (broken / "test").mkdir(exist_ok=True)
    (broken / "test" / ".tacstrip-12345678.part").write_bytes(b"half")  # what a kill leaves
    last = max((broken / ".work").glob("*.done"))
    last.unlink()
    split, _, number = last.stem.partition("-")
    chunk = broken / ".work" / f"{split}.zarr" / "kh" / "c" / str(int(number)) / "0"
    chunk.write_bytes(chunk.read_bytes()[:50])
    assert generate(study, broken)
    assert _files(broken) == _files(whole)
    assert not generate(study, broken)


def test_the_end_is_heeded_within_a_part(
    study: DataSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Blocks change no byte, and one part of all scans is left at its first block."""
    generate(study, tmp_path / "whole", workers=1)
    monkeypatch.setattr(generation, "_BLOCK", 5)
    generate(study, tmp_path / "blocks", workers=1)
    assert _files(tmp_path / "blocks") == _files(tmp_path / "whole")
    seen: list[int] = []

    def stop(done: int, _: int) -> None:
        seen.append(done)
        raise _Killed

    with pytest.raises(_Killed):
        generate(replace(study, part_scans=95), tmp_path / "left", workers=1, progress=stop)
    assert seen == [6]  # two scenes


def test_another_data_set_is_not_written_over(study: DataSet, tmp_path: Path) -> None:
    out = tmp_path / "data"
    generate(study, out)
    (tmp_path / "study.toml").write_text(STUDY.replace("seed = 5", "seed = 6"), encoding="utf-8")
    other = DataSet.load(tmp_path / "study.toml")
    with pytest.raises(OptionError, match="holds another data set"):
        generate(other, out)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").touch()
    with pytest.raises(OptionError, match="is no data set"):
        generate(other, tmp_path / "mine")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('name = "few"', "colour = 3", "unknown key 'colour'"),
        ("n = 95", "n = 95.5", r"\[shapes\]: n = 95.5: must be a whole number"),
        ("n = 95", "n = 95.0", r"\[shapes\]: n = 95.0: must be a whole number"),
        ("[shapes]", "[shape]", "unknown key 'shape'"),
        ("corners = [3, 5]", "size_mm = 400", r"\[shapes\]: size_mm up to 400: the sensor"),
        ("positional = 0.005", "positional = 5", "a fraction of Vref"),
        ("train = 0.7", "train = 0.9", "whose sum is 1"),
        ('"zarr"]', '"csv"]', "choose one of: parquet, zarr"),
        ("part_scans = 20", "part_scans = 0", "part_scans = 0"),
        ("strips = 12", "", "key 'strips' is missing"),
        ("seed = 5", "seed = -1", "0 or more"),
    ],
)
def test_what_a_study_cannot_ask_for_is_named(old: str, new: str, words: str, tmp_path: Path) -> None:
    assert old in STUDY
    (tmp_path / "study.toml").write_text(STUDY.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(SpecError, match=words) as found:
        DataSet.load(tmp_path / "study.toml")
    assert "study.toml" in str(found.value)


def test_more_than_the_disk_takes_is_refused_before_anything_is_written(
    study: DataSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage._replace(free=100))
    with pytest.raises(OSError, match=r"95 scans take \S+ GB or more, and 1e-07 GB are free") as found:
        generate(study, tmp_path / "set")
    assert found.value.errno == errno.ENOSPC
    assert not (tmp_path / "set").exists()


def test_the_verb_writes_and_says_what(tmp_path: Path) -> None:
    (tmp_path / "study.toml").write_text(STUDY.replace('"parquet", ', ""), encoding="utf-8")
    arguments = [str(tmp_path / "study.toml"), "--out", str(tmp_path / "data")]
    first, second = (CliRunner().invoke(command, arguments) for _ in range(2))
    assert first.exit_code == 0, first.output
    assert "95 scans of 12 strips (66 train, 12 validation, 17 test)\n" in first.output
    assert "complete already" in second.output


@pytest.mark.parametrize(("each_s", "says"), [(0.001, ""), (0.1, "this takes some 33 minutes on one core")])
def test_a_long_job_is_announced_by_what_a_scan_takes_once_all_is_loaded(
    study: DataSet,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    each_s: float,
    says: str,
) -> None:
    clock, loading_s = [0.0], [0.5]

    def slow(sensor: ts.Sensor, shapes: ts.Shapes, **options: Any) -> ts.Scans:
        clock[0] += each_s * shapes.n + (loading_s.pop() if loading_s else 0.0)
        return ts.simulate_many(sensor, shapes, **options)

    monkeypatch.setattr(verb, "simulate_many", slow)
    monkeypatch.setattr("tacstrip.cli.generate.time.perf_counter", lambda: clock[0])
    wide = replace(study.sensor, strip_width_mm=3.0)
    shapes = replace(study.shapes, n=20_000, objects=1)
    verb._look(replace(study, sensor=wide, model="closed", shapes=shapes))
    said = capsys.readouterr().err
    assert says in said
    assert bool(says) == bool(said)
    assert "resolved" not in said  # which closed forms are not
