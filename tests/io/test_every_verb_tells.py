"""What can be read and is probably not meant is told by every verb, and by none where all is well."""

from __future__ import annotations

import importlib
from pathlib import Path

import click
import numpy as np
import pytest
from click.testing import CliRunner

import tacstrip as ts
from studies.mutations import NO_NUMBERS, SENSOR, make_inputs
from tacstrip.cli import VERBS, cli
from tacstrip.cli.options import NUMBER, WHOLE, WholeRange

READ = [
    "reconstruct s.toml r.csv --method profile",
    "record s.toml r.csv -o out.mcap --force",
    "convert s.toml r.csv -o out.npz --force",
    "convert s.toml r.csv -o out.mcap --force",
    "live s.toml r.csv --no-view --speed 1000",
    "doctor r.csv --sensor s.toml",
    "noise r.csv s.toml",
    "record r.mcap -o out.mcap --force",
    "convert r.mcap -o out.csv --force",
    "replay r.mcap --fast",
    "live r.mcap --no-view --speed 1000",
    "doctor r.mcap",
    "noise r.mcap",
]


@pytest.fixture(scope="module")
def files(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    folder = tmp_path_factory.mktemp(request.param)
    make_inputs(folder)
    scans = ts.read_readings(folder / "r.csv", SENSOR)
    if request.param == "exchanged":
        scans = [ts.Scan(kh=scan.kl, kl=scan.kh, time_s=scan.time_s) for scan in scans]
        ts.write_readings(folder / "r.csv", SENSOR, scans)
        (folder / "r.mcap").unlink()
        CliRunner().invoke(cli, f"record {folder}/s.toml {folder}/r.csv -o {folder}/r.mcap".split())
    if request.param == "backwards":
        header, *lines = (folder / "r.csv").read_text().splitlines(keepends=True)
        scan = [lines[i : i + SENSOR.strips][::-1] for i in range(0, len(lines), SENSOR.strips)]
        (folder / "r.csv").write_text(header + "".join(map("".join, scan)))
    return folder, request.param


@pytest.mark.parametrize(
    ("files", "words"),
    [
        *((what, words) for what in ("well", "exchanged") for words in READ),
        *(("backwards", words) for words in READ if "r.csv" in words),  # recordings have no order of lines
    ],
    indirect=["files"],
)
def test_every_verb_that_takes_readings_tells(
    files: tuple[Path, str], words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, what = files
    monkeypatch.chdir(folder)
    said = CliRunner().invoke(cli, words.split()).output
    told = "are the columns exchanged?" in said or "v_h and v_l exchanged" in said
    assert told == (what == "exchanged"), said
    assert ("count the strips down, from 7 to 0" in said) == (what == "backwards"), said
    if what == "well":
        assert "Warning" not in said


@pytest.mark.parametrize("files", ["backwards"], indirect=True)
def test_lines_in_any_order_are_placed_by_their_strips_number(files: tuple[Path, str]) -> None:
    folder, _ = files
    of_same_scans = ts.read_readings(folder / "codes.csv", SENSOR)
    for one, other in zip(ts.read_readings(folder / "r.csv", SENSOR), of_same_scans, strict=True):
        np.testing.assert_allclose(one["kh"], other["kh"], atol=SENSOR.adc_step)


@pytest.mark.parametrize("verb", VERBS)
def test_no_option_takes_what_only_python_calls_a_number(verb: str) -> None:
    for parameter in importlib.import_module(f"tacstrip.cli.{verb}").command.params:
        kinds = parameter.type.types if isinstance(parameter.type, click.Tuple) else [parameter.type]
        for kind in kinds:
            if isinstance(kind, click.types.FloatParamType | click.types.IntParamType):
                assert isinstance(kind, WholeRange) or kind in (NUMBER, WHOLE), parameter.name


@pytest.mark.parametrize("text", [t for t in NO_NUMBERS if t not in ("-inf", "1e999")])
def test_an_option_that_is_no_number_is_named(text: str) -> None:
    done = CliRunner().invoke(cli, ["init", "-", "--pitch", text])
    assert done.exit_code == 2
    assert "--pitch" in done.output
