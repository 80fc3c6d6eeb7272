"""Studies of designs: what varies, batches by name, shards, lost workers, the Pareto front and the report."""

from __future__ import annotations

import math
import os
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import tacstrip as ts
from tacstrip.cli.sweep import command
from tacstrip.dataset import sweep as module
from tacstrip.dataset.measures import Case, measure
from tacstrip.dataset.sweep import Progress, Sweep, Work, batches_there, changed, collect, do, pareto, sweep
from tacstrip.errors import OptionError, SpecError
from tacstrip.plot.sweep import draw_sweep

pq = pytest.importorskip("pyarrow.parquet")

STUDY = """
seed = 3
[sensor]
construction = "crs-crs"
strips = 20
pitch_mm = 5.0
length_mm = 100.0
adc_bits = 12
[shapes]
corners = 4
size_mm = [50, 70]
[vary.sensor]
pitch_mm = [2.5, 5.0]
width_mm = [100.0]
construction = ["crs-crs", "crs-m"]
[latin]
samples = 3
[latin.noise]
positional = {from = 0.0005, to = 0.005, log = true}
[measure]
what = ["bound"]
scans = 2
batch_designs = 2
"""


def _study(folder: Path, text: str = STUDY) -> Sweep:
    (folder / "study.toml").write_text(text, encoding="utf-8")
    return Sweep.load(folder / "study.toml")


def test_a_range_of_lengths_is_of_whole_numbers_only_where_that_is_asked_for(tmp_path: Path) -> None:
    ranges = "pitch_mm = {from = 1, to = 4, steps = 7}\nadc_bits = {from = 8, to = 14, steps = 3}"
    given = STUDY.replace("pitch_mm = [2.5, 5.0]", ranges)
    vary = _study(tmp_path, given).vary
    assert vary["sensor.pitch_mm"] == (1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0)
    assert vary["sensor.adc_bits"] == (8, 11, 14)
    whole = _study(tmp_path, given.replace("steps = 7", "steps = 7, whole = true")).vary
    assert whole["sensor.pitch_mm"] == (1, 2, 3, 4)


def test_designs_are_all_combinations_in_batches_that_keep_their_names(tmp_path: Path) -> None:
    study = _study(tmp_path)
    assert study.designs == 12
    designs = [study.design(i) for i in range(12)]
    assert len({tuple(d.items()) for d in designs}) == 12
    assert [d["sensor.pitch_mm"] for d in designs] == [2.5] * 6 + [5.0] * 6
    latin = sorted({d["noise.positional"] for d in designs})
    assert len(latin) == 3
    strata = np.log(np.array(latin) / 0.0005) / np.log(10.0) * 3.0
    assert np.floor(strata).tolist() == [0.0, 1.0, 2.0]  # one of each third
    names = [batch.name for batch in study.batches()]
    assert len(set(names)) == 6
    more = _study(tmp_path, STUDY.replace("[2.5, 5.0]", "[2.5, 5.0, 10.0]"))
    assert {b.name for b in more.batches()} > set(names)  # a study that grows keeps what it has
    other = _study(tmp_path, STUDY.replace("seed = 3", "seed = 4"))
    assert not {b.name for b in other.batches()} & set(names)
    shards = [[b.name for b in study.batches((i, 4))] for i in (1, 2, 3, 4)]
    assert sorted(n for shard in shards for n in shard) == sorted(names)


def test_parameters_change_the_design(tmp_path: Path) -> None:
    base = _study(tmp_path).base
    case = changed(base, {"sensor.pitch_mm": 2.5, "sensor.width_mm": 100.0, "noise.white": 0.01})
    assert (case.sensor.strips, case.sensor.pitch_mm, case.noise.white) == (40, 2.5, 0.01)
    tube = changed(
        base, {"sensor.construction": "cyl-crs-m", "sensor.radius_mm": 40.0, "shapes.corners": [3, 5]}
    )
    assert (tube.sensor.radius_mm, tube.shapes.corners) == (40.0, (3, 5))
    unequal = Case(ts.Sensor(construction="crs-crs", strips=4, pitch_mm=5.0, length_mm=9.0, resistivity_ratio=3.0),
                   base.shapes, base.noise)  # fmt: skip
    assert changed(unequal, {"sensor.construction": "crs-m"}).sensor.resistivity_ratio == 1.0


@pytest.mark.parametrize("pitch_mm", [1e-320, 0.0, "wide"])
def test_a_pitch_that_cannot_be_is_a_designs_problem(tmp_path: Path, pitch_mm: Any) -> None:
    base = _study(tmp_path).base
    with pytest.raises(SpecError, match="no number of strips"):
        changed(base, {"sensor.width_mm": 100.0, "sensor.pitch_mm": pitch_mm})


def test_a_number_that_no_column_of_whole_numbers_holds_is_a_designs_problem(tmp_path: Path) -> None:
    huge = "pitch_mm = [99999999999999999999, 5.0]"
    study = _study(tmp_path, STUDY.replace("pitch_mm = [2.5, 5.0]", huge))
    sweep(study, tmp_path / "out", workers=1)
    done = collect(study, tmp_path / "out")
    assert done is not None
    problems = [bool(problem) for problem in done["problem"]]
    assert problems == [pitch > 1e3 for pitch in done["sensor.pitch_mm"]]


def test_measures_are_what_they_say(tmp_path: Path) -> None:
    """Of ten presses at little noise: the fit is as good as the bound, and counts corners right."""
    base = _study(tmp_path).base
    case = changed(base, {"shapes.n": 10, "noise.positional": 0.001, "noise.distribution": "normal"})
    case = changed(case, {"sensor.pitch_mm": 2.0, "sensor.width_mm": 100.0})
    row: dict[str, Any] = measure(case, ("bound", "polygon", "profile", "right", "coverage", "speed"), 1)
    assert row["strips"] == 50.0
    assert row["connectors"] == 102.0
    assert 0.3 < row["polygon_mm"] / row["bound_mm"] < 3.0
    assert row["bound_mm"] <= row["bound_p90_mm"]
    assert row["polygon_iou"] > 0.98
    assert row["right"] >= 0.8
    assert row["coverage"] >= 0.7
    assert row["profile_mm"] > row["polygon_mm"]  # a profile cuts corners at the strips
    assert row["polygon_ms"] > 0.0
    assert row["problem"] is None
    metal = measure(changed(case, {"sensor.construction": "crs-m", "shapes.n": 1}), ("bound", "profile"), 1)
    assert metal["bound_mm"] is not None
    assert "profile: " in str(metal["problem"])


def test_what_was_not_found_counts(tmp_path: Path) -> None:
    """Objects of some three pitches, of which the fit gives no outline for a part: the medians know of them."""
    case = changed(_study(tmp_path).base, {"shapes.n": 13, "shapes.size_mm": (14.0, 14.0)})
    row: dict[str, Any] = measure(case, ("polygon",), 1)
    assert 0.0 < row["polygon_found"] < 0.9
    assert row["polygon_p90_mm"] == math.inf  # more than a tenth has none
    scans = ts.simulate_many(case.sensor, case.shapes, case.noise, rng=1, workers=1)
    overlaps = []
    for i, scan in enumerate(scans):
        (truth,) = scans.contact(i).shapes
        found = ts.fit_polygon(scan, case.sensor, case.noise, assessment="fast").objects
        one = len(found) == 1 and found[0].found
        overlaps.append(ts.mismatch(truth.exterior.coords, found[0].vertices).iou if one else 0.0)
    assert row["polygon_iou"] == pytest.approx(np.median(overlaps), abs=0.05)


def test_the_overlap_has_a_picture(tmp_path: Path) -> None:
    table: dict[str, list[Any]] = {
        "polygon_mm": [1.0, 2.0, math.inf, None], "polygon_iou": [0.9, 0.8, 0.0, None], "connectors": [8.0] * 4,
        "strips": [6.0] * 4, "rate_hz": [None] * 4, "sensor.pitch_mm": [1.0, 2.0, 3.0, 4.0],
    }  # fmt: skip
    front = pareto(table, "polygon_mm")
    made = draw_sweep(table, ["sensor.pitch_mm"], "polygon_mm", front, tmp_path)
    assert [file.name for _, file in made] == ["pareto.png", "parameters.png", "overlap.png"]
    assert all(file.stat().st_size > 5000 for _, file in made)


def test_the_thesis_simulation_is_a_study() -> None:
    study = Sweep.load(Path(__file__).parents[2] / "studies" / "thesis_simulation.toml")
    assert study.designs == 24
    assert changed(study.base, study.design(23)).sensor.strips == 20
    assert changed(study.base, study.design(0)).sensor.strips == 1000


def test_shards_and_extensions_give_the_table_of_one_run(tmp_path: Path) -> None:
    study, alone, shared = _study(tmp_path), tmp_path / "alone", tmp_path / "shared"
    sweep(study, alone, workers=1)
    assert collect(study, shared) is None
    sweep(study, shared, (2, 2), workers=1)
    assert collect(study, shared) is None
    assert len(batches_there(shared)) == 3
    state = sweep(study, shared, workers=1)
    assert (state.done, state.total) == (6, 6)
    assert collect(study, shared) == collect(study, alone)
    assert (shared / "results.parquet").read_bytes() == (alone / "results.parquet").read_bytes()
    table = pq.ParquetFile(shared / "results.parquet").read().to_pydict()
    assert table["design"] == list(range(12))
    expected = do(Work(study.base, (study.design(5),), study.measures, study.seed))[0][0]
    assert {name: table[name][5] for name in expected} == expected
    assert table["sensor.construction"][3] == "crs-m"


def _lost_once(work: Work) -> Any:
    """Measure, but the first worker that meets the third design is killed."""
    mark = Path(os.environ["TACSTRIP_TEST_MARK"])
    if work.parameters[0]["sensor.construction"] == "crs-m" and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return do(work)


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="there is no such signal here")
def test_a_lost_worker_costs_its_batch_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    study, whole, lossy = _study(tmp_path), tmp_path / "whole", tmp_path / "lossy"
    sweep(study, whole, workers=1)
    monkeypatch.setenv("TACSTRIP_TEST_MARK", str(tmp_path / "mark"))
    monkeypatch.setattr(module, "do", _lost_once)
    state = sweep(study, lossy, workers=2)
    assert (tmp_path / "mark").exists()
    assert state.done == 6
    assert collect(study, lossy) == collect(study, whole)


def _always_lost(_: Work) -> Any:
    os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="there is no such signal here")
def test_a_batch_that_kills_every_worker_ends_the_sweep(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "do", _always_lost)
    with pytest.raises(RuntimeError, match="from design 0 on, lost its worker 3 times"):
        sweep(_study(tmp_path), tmp_path / "out", workers=1)


def test_a_dask_cluster_gives_the_same_table(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    study, local, remote = _study(tmp_path), tmp_path / "local", tmp_path / "remote"
    sweep(study, local, workers=1)
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=2, processes=False, dashboard_address=":0", protocol="inproc"
    ) as cluster:
        sweep(study, remote, dask=cluster.scheduler_address)
    assert collect(study, remote) == collect(study, local)
    with pytest.raises(OptionError, match="no Dask scheduler answers at nowhere"):
        sweep(_study(tmp_path, STUDY.replace("seed = 3", "seed = 9")), remote, dask="nowhere")


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="there is no such signal here")
def test_a_cluster_of_four_workers_one_killed_midway_gives_the_same_table(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    text = STUDY.replace("samples = 3", "samples = 12").replace("batch_designs = 2", "batch_designs = 1")
    study, local, remote = _study(tmp_path, text), tmp_path / "local", tmp_path / "remote"
    sweep(study, local, workers=2)
    with distributed.LocalCluster(n_workers=4, threads_per_worker=1, dashboard_address=":0") as cluster:
        first: list[int] = [nanny.pid for nanny in cluster.workers.values()]

        def kill_one(state: Progress) -> None:
            if state.done >= state.total // 3 and len(first) == 4:
                os.kill(first.pop(), signal.SIGKILL)

        state = sweep(study, remote, dask=cluster.scheduler_address, progress=kill_one)
    assert len(first) == 3
    assert state.done == state.total == 48
    assert collect(study, remote) == collect(study, local)
    assert (remote / "results.parquet").read_bytes() == (local / "results.parquet").read_bytes()


def test_the_pareto_front_is_that_of_all_pairs() -> None:
    random = np.random.default_rng(1)
    table = {
        name: random.integers(1, 8, 60).astype(float).tolist()
        for name in ("e", "strips", "connectors", "rate_hz")
    }
    table["e"][3], table["e"][4] = None, float("inf")
    goals = np.array([[np.inf if v is None else v for v in table["e"]], table["strips"], table["connectors"],
                      [-v for v in table["rate_hz"]]])  # fmt: skip
    best = [
        i for i in range(60)
        if np.isfinite(goals[:, i]).all()
        and not any((goals[:, j] <= goals[:, i]).all() and (goals[:, j] < goals[:, i]).any() for j in range(60))
    ]  # fmt: skip
    assert sorted(pareto(table, "e")) == best


def test_the_pareto_front_is_drawn_where_rates_are_not_known(tmp_path: Path) -> None:
    """Without a converter there is no rate, and errors span two powers of ten."""
    study = _study(tmp_path, STUDY.replace("adc_bits = 12", "").replace("0.0005", "0.00001"))
    sweep(study, tmp_path / "out", workers=1)
    results = collect(study, tmp_path / "out")
    assert results is not None
    assert set(results["rate_hz"]) == {None}
    made = draw_sweep(results, study.parameters, "bound_mm", pareto(results, "bound_mm"), tmp_path)
    assert made[0][0] == "Error of all designs over connectors, and the Pareto front"
    assert all(picture.stat().st_size > 0 for _, picture in made)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("pitch_mm = [2.5, 5.0]", "pitchmm = [2.5]", "unknown parameter sensor.pitchmm"),
        ("pitch_mm = [2.5, 5.0]", "pitch_mm = 2.5", "give a list, or a range"),
        ("[vary.sensor]", "[vary.camera]", r"\[vary\]: camera: give parameters by table"),
        ("from = 0.0005", "from = 0.0", "a logarithmic range lies above 0"),
        ("from = 0.0005, ", "", "a range needs two numbers"),
        ('what = ["bound"]', 'what = ["beauty"]', "choose one of: bound, polygon"),
        ("scans = 2", "scans = 0", "scans = 0: must be a whole number"),
        ("scans = 2", "scans = 2147483648", "scans = 2147483648: must be a whole number from 1 to 1000000"),
        ("corners = 4", "n = 4", "is `scans` in"),
        ("[latin.noise]\npositional", "[latin.sensor]\npitch_mm", "stands in .vary. and in .latin."),
        ("[measure]", "[measured]", "unknown key 'measured'"),
    ],
)
def test_what_a_study_cannot_ask_for_is_named(old: str, new: str, words: str, tmp_path: Path) -> None:
    assert old in STUDY
    with pytest.raises(SpecError, match=words):
        _study(tmp_path, STUDY.replace(old, new, 1))


def test_batches_are_planned_without_measuring(tmp_path: Path) -> None:
    """A thousand; benchmarks/sweeps.py times a million."""
    text = STUDY.replace("samples = 3", "samples = 250").replace("batch_designs = 2", "batch_designs = 1")
    (tmp_path / "study.toml").write_text(text, encoding="utf-8")
    said = CliRunner().invoke(
        command, [str(tmp_path / "study.toml"), "--out", str(tmp_path / "out"), "--plan"]
    )
    assert said.output == "1000 designs; 1000 batches of 1, 0 of them there\n"
    assert not (tmp_path / "out").exists()


def test_the_verb_writes_a_report(tmp_path: Path) -> None:
    _study(tmp_path)
    arguments = [str(tmp_path / "study.toml"), "--out", str(tmp_path / "out")]
    first = CliRunner().invoke(command, [*arguments, "--shard", "1/2", "--workers", "1"])
    assert first.exit_code == 0, first.output
    assert "Batches of other shards are missing" in first.output
    said = CliRunner().invoke(command, [*arguments, "--workers", "1"])
    assert said.exit_code == 0, said.output
    assert "of 12 designs are on the Pareto front" in said.output
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert page.count("<figure>") == 2
    assert "noise.positional" in page
    for shard in ("0/2", "3/2", "a", "1/2/3"):
        assert isinstance(CliRunner().invoke(command, [*arguments, "--shard", shard]).exception, OptionError)
