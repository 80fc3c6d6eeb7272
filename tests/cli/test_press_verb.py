"""`tacstrip press`, as a user calls it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import tacstrip as ts
from tacstrip.cli import cli
from tacstrip.errors import TacstripError

POSE = ["--pose", "8", "1", "8", "-1", "0", "-1"]


def test_skin_object_and_patch_come_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    run = CliRunner().invoke
    hint = run(cli, ["init", "tip.toml", "--like", "fingertip"], catch_exceptions=False).output
    first = hint.partition("then: tacstrip ")[2].split()
    assert first[0] == "press"
    assert "3 of 16 strips touched" in run(cli, first, catch_exceptions=False).output
    words = ["press", "tip.toml", "cylinder:4", *POSE, "--turn", "30", "--depth", "1.5", "-o", "r.csv"]
    done = run(cli, [*words, "--patch", "p.json", "--plot", "p.png"], catch_exceptions=False)
    assert "3 of 16 strips touched" in done.output
    assert "readings without noise: give --positional" in done.output
    sensor = ts.Sensor.load("tip.toml")
    (scan,) = ts.read_readings("r.csv", sensor)
    patch = json.loads(Path("p.json").read_text())
    l = np.array(patch["l_mm"], dtype=float)
    np.testing.assert_array_equal(np.isfinite(l), scan.touched)
    profile = ts.profile_reconstruction(scan, sensor).objects[0].profile
    assert profile is not None
    np.testing.assert_allclose(np.sort(profile[1]), np.sort(l[np.isfinite(l)]), atol=1e-5)
    assert patch["force_n"] > 1.0
    assert Path("p.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (
            ["ball", *POSE, "--depth", "1"],
            "OBJECT ball: is none of plane, sphere, cylinder, edge, cone, box, nor a mesh",
        ),
        (["box:3", *POSE, "--depth", "1"], "OBJECT box:3: a box has three numbers, as in box:20x10x5"),
        (["edge:270", *POSE, "--depth", "1"], "OBJECT edge:270: its angle is between 0 and 180 degrees"),
        (["plane", *POSE], "give one of --depth, how far [mm], and --force, how hard [N]"),
        (["plane", *POSE, "--depth", "5"], "the object sinks 5 mm into a skin of 3 mm"),
        (["no.stl", *POSE, "--depth", "1"], "no.stl: no such file"),
        (["plane", *POSE, "--depth", "1", "--unit", "m"], "--unit is for a mesh"),
    ],
)
def test_bad_input_gets_a_sentence_and_no_file(
    words: list[str], text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(cli, ["press", "fingertip", *words, "-o", "r.csv"])
    assert isinstance(done.exception, TacstripError)
    assert text in str(done.exception)
    assert not Path("r.csv").exists()


def test_a_path_is_pressed_scan_by_scan(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    header = "time_s,x_mm,y_mm,z_mm,dx,dy,dz,turn_deg"
    rows = ["0,8,1,8,-1,0,-1,30", "0.5,6,6,8,-1,-1,-1,0"]
    Path("path.csv").write_text("\n".join([f"{header},depth_mm", f"{rows[0]},1.5", f"{rows[1]},1"]) + "\n")
    words = ["press", "fingertip", "cylinder:4", "--path"]
    run = CliRunner().invoke
    done = run(
        cli,
        [*words, "path.csv", "-o", "r.csv", "--patch", "p.json", "--plot", "f.png"],
        catch_exceptions=False,
    )
    assert "r.csv: 2 scans, " in done.output
    sensor = ts.Sensor.load("fingertip")
    scans = ts.read_readings("r.csv", sensor)
    assert [scan.time_s for scan in scans] == [0.0, 0.5]
    cylinder = ts.Solid.cylinder(4.0)
    right = ts.press(sensor, cylinder.at((8, 1, 8), (-1, 0, -1), np.radians(30.0)), depth_mm=1.5)
    np.testing.assert_allclose(scans[0]["kh"], ts.simulate(sensor, right)["kh"], atol=1e-8)
    assert [round(p["depth_mm"], 9) for p in json.loads(Path("p.json").read_text())] == [1.5, 1.0]
    assert Path("f.png").stat().st_size > 10_000
    # Without depth and force it is where it is: here 20 mm beside the skin, then 1 mm in it.
    Path("is.csv").write_text(header.removesuffix(",turn_deg") + "\n0,0,0,30,0,0,-1\n1,0,0,9,0.3,0,-1\n")
    run(cli, ["press", "fingertip", "plane", "--path", "is.csv", "-o", "i.csv"], catch_exceptions=False)
    beside, within = ts.read_readings("i.csv", sensor)
    assert not beside.touched.any()
    assert within.touched.any()
    for text, more, said in (
        (f"{header}\n{rows[0]}\n{rows[0]}\n", [], "bad.csv: line 3: time_s = 0 does not come after 0"),
        (f"{header}\n{rows[0]}\n", ["--depth", "9"], "bad.csv: line 2: the object sinks"),
        (f"{header},depth_mm\n{rows[0]},1\n", ["--force", "1"], "leave --depth and --force out"),
        ("x_mm,y_mm,z_mm,dx,dy\n", [], "column 'dz' is missing"),
        (f"{header},colour\n", [], "column 'colour' is unknown"),
        (f"{header}\n", [], "a header and no poses"),
    ):
        Path("bad.csv").write_text(text)
        error = run(cli, [*words, "bad.csv", "-o", "b.csv", *more]).exception
        assert isinstance(error, TacstripError)
        assert said in str(error)
        assert not Path("b.csv").exists()
