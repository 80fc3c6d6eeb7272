"""What can be read and is probably not meant is told by every verb, and by none where all is well."""

from __future__ import annotations

import importlib
from dataclasses import replace
from pathlib import Path

import click
import numpy as np
import pytest
from click.testing import CliRunner

import tacstrip as ts
from studies.mutations import NO_NUMBERS, SENSOR, SHAPE, make_inputs
from tacstrip.cli import VERBS, cli
from tacstrip.cli.options import NUMBER, WHOLE, WholeRange
from tacstrip.stream.bridges.tuio import Tuio

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
# Readings of nothing tell no exchange, and `import` asks about one.
ALSO_IN_ORDER = [
    "calibrate s.toml --touch r.csv -o out.toml --overwrite",
    "calibrate unit.toml r.csv --rezero -o out.toml --overwrite",
    "import r.csv s.toml -o out.csv --force",
]
# Lengths in centimetres or metres, wherever they enter.
OTHER_UNITS = {
    "simulate s.toml cm.wkt -o out.csv --force": "is it in centimetres?",
    "record s.toml cm.wkt -o out.mcap --force --seconds 0.05": "is it in centimetres?",
    "spice s.toml cm.wkt -o out.cir": "is it in centimetres?",
    "limits s.toml cm.wkt --grid 2": "is it in centimetres?",
    "reconstruct s.toml r.csv --method profile --truth cm.wkt": "is it in centimetres?",
    "press skin.toml sphere:4 --path m.csv -o out.csv --overwrite": "is that in metres?",
    "press skin.toml sphere:4 --pose 0.008 0 0.008 -1 0 -1 --depth 1 -o out.csv --overwrite": "is that in metres?",
    "sweep cm_designs.toml --out out.d --plan": "mm, not cm?",
    "generate cm_study.toml --out out.d2 --workers 1": "mm, not cm?",
}


@pytest.fixture(scope="module")
def files(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    folder = tmp_path_factory.mktemp(request.param)
    make_inputs(folder)
    scans = ts.read_readings(folder / "r.csv", SENSOR)
    if request.param in ("exchanged", "clock"):
        half_s = scans[len(scans) // 2].time_s
        scans = [
            ts.Scan(kh=scan.kl, kl=scan.kh, time_s=scan.time_s)
            if request.param == "exchanged"
            else replace(scan, time_s=scan.time_s % half_s)
            for scan in scans
        ]
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
        *(("clock", words) for words in (*READ, "track s.toml r.csv", "track r.mcap")),
        # Recordings have no order of lines.
        *(("backwards", words) for words in (*READ, *ALSO_IN_ORDER) if "r.csv" in words),
    ],
    indirect=["files"],
)
def test_every_verb_that_takes_readings_tells(
    files: tuple[Path, str], words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, what = files
    monkeypatch.chdir(folder)
    done = CliRunner().invoke(cli, words.split())
    said = f"{done.output}{done.exception or ''}"
    told = "are the columns exchanged?" in said or "v_h and v_l exchanged" in said
    assert told == (what == "exchanged"), said
    assert ("count the strips down, from 7 to 0" in said) == (what == "backwards"), said
    assert said.count("sort the scans by time, or split the recording") == (what == "clock"), said
    if what == "well":
        assert "Warning" not in said


@pytest.fixture(scope="module")
def other_units(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("units")
    make_inputs(folder)
    small = SHAPE.vertices / 10.0
    (folder / "cm.wkt").write_text(ts.Contact.polygon(small).shapes[0].wkt + "\n")
    (folder / "m.csv").write_text(
        "x_mm,y_mm,z_mm,dx,dy,dz,depth_mm\n.008,0,.008,-1,0,-1,1\n.008,.001,.008,-1,0,-1,1\n"
    )
    replace(SENSOR, pitch_mm=0.5, length_mm=10.0).save(folder / "cm.toml")
    for name, text in (("designs.toml", "[20.0, 30.0]"), ("study.toml", "[20.0, 30.0]")):
        told = (folder / name).read_text().replace("s.toml", "cm.toml").replace(text, "[2.0, 3.0]")
        (folder / f"cm_{name}").write_text(told)
    return folder


@pytest.mark.parametrize("words", OTHER_UNITS)
def test_lengths_in_other_units_are_asked_about(
    other_units: Path, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(other_units)
    done = CliRunner().invoke(cli, words.split())
    assert OTHER_UNITS[words] in done.output, (done.output, done.exception)


@pytest.mark.parametrize("files", ["backwards"], indirect=True)
def test_lines_in_any_order_are_placed_by_their_strips_number(files: tuple[Path, str]) -> None:
    folder, _ = files
    of_same_scans = ts.read_readings(folder / "codes.csv", SENSOR)
    with pytest.warns(ts.ReadingWarning, match="count the strips down"):
        scans = ts.read_readings(folder / "r.csv", SENSOR)
    for one, other in zip(scans, of_same_scans, strict=True):
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


def test_a_port_in_other_digits_is_no_target() -> None:
    with pytest.raises(ts.TacstripError, match="must be HOST:PORT"):
        Tuio("127.0.0.1:33\N{ARABIC-INDIC DIGIT THREE}3")
