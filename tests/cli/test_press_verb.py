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
    assert run(cli, ["init", "tip.toml", "--like", "fingertip"], catch_exceptions=False).exit_code == 0
    words = ["press", "tip.toml", "cylinder:4", *POSE, "--turn", "30", "--depth", "1.5", "-o", "r.csv"]
    done = run(cli, [*words, "--patch", "p.json", "--plot", "p.png"], catch_exceptions=False)
    assert "3 of 16 strips touched" in done.output
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
            "OBJECT ball: is none of plane, sphere, cylinder, edge, box, nor a mesh",
        ),
        (["box:3", *POSE, "--depth", "1"], "OBJECT box:3: a box has three numbers, as in box:20x10x5"),
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
