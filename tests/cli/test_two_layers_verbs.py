"""A sensor of two layers at the command line: what takes it, and what says that it does not."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from tacstrip.cli import cli
from tacstrip.errors import TacstripError

SCENE = "GEOMETRYCOLLECTION (POLYGON ((20 20, 45 25, 30 50, 20 20)), POLYGON ((35 60, 70 55, 60 80, 35 60)))"


def run(*words: object) -> Result:
    done = CliRunner().invoke(cli, [str(word) for word in words])
    assert done.exception is None or isinstance(done.exception, SystemExit | TacstripError), done.exception
    return done


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("pair.wkt").write_text(SCENE)
    assert run("init", "two.toml", "--like", "layered-crs-crs").exit_code == 0
    return tmp_path


def test_from_spec_over_readings_and_recording_to_shapes(here: Path) -> None:
    noise = ("--positional", 0.005)
    done = run("simulate", "two.toml", "pair.wkt", "-o", "r.csv", *noise)
    assert "1 scan(s) of 64 strips, 35 of them touched" in done.output
    assert Path("r.csv").read_text().startswith("scan,time_s,layer,strip,v_h,v_l\n0,0,0,0,,\n")
    done = run("reconstruct", "two.toml", "r.csv", *noise, "-o", "o.geojson", "--plot", "o.png")
    assert "1 scan(s), 2 object(s); ok: 2" in done.output
    features = json.loads(Path("o.geojson").read_text())["features"]
    assert [f["properties"]["hidden"] for f in features] == [[False] * 3] * 2
    assert Path("o.png").read_bytes()[:4] == b"\x89PNG"
    assert run("record", "two.toml", "r.csv", "-o", "a.mcap", "--reconstruct", "polygon").exit_code == 0
    assert "2 likely" in run("replay", "a.mcap", "--summary").output
    assert run("convert", "a.mcap", "-o", "b.csv").exit_code == 0
    assert run("convert", "a.mcap", "-o", "b.toml").exit_code == 0
    done = run("reconstruct", "b.toml", "b.csv", *noise, "-o", "b.geojson")
    assert "ok: 2" in done.output


def test_limits_say_what_the_second_layer_buys(here: Path) -> None:
    text = run("limits", "two.toml", "pair.wkt", "--positional", 0.005).output
    assert "both layers       layer 0 alone       layer 1 alone" in text
    assert "Of 6 corners are determined by both layers 6" in text


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (
            "spice two.toml pair.wkt -o x.cir",
            "two.toml: is of two layers, and `tacstrip spice` takes a sensor of one",
        ),
        (
            "live --simulate --sensor two.toml --watch",
            "--watch is for a sensor of one layer, and this one has two",
        ),
        ("live --simulate --sensor two.toml --method pieces", 'two layers are reconstructed by "polygon"'),
        ("simulate two.toml pair.wkt -o x.csv --model network", "--model is for a sensor of one layer"),
        (
            "simulate two.toml pair.wkt -o x.csv --without 3:v_h",
            "write it into the spec: without = ['3:v_h']",
        ),
        ("reconstruct two.toml pair.csv --vertices 3", "--vertices is for a sensor of one layer"),
        ("limits two.toml pair.wkt --plot x.png", "--plot is for a sensor of one layer"),
    ],
)
def test_what_two_layers_do_not_go_with(here: Path, words: str, says: str) -> None:
    done = run(*words.split())
    assert says in str(done.exception)
    assert not list(here.glob("x.*"))
