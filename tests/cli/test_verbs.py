"""The command line as a user meets it: what it writes, what it says, how it ends."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path
from subprocess import CompletedProcess
from unittest.mock import patch

import pytest
from click.testing import CliRunner

import tacstrip as ts
from tacstrip.cli.reconstruct import command as reconstruct
from verbs import run

RECTANGLE = "POLYGON ((-25 -17.5, 25 -17.5, 25 17.5, -25 17.5, -25 -17.5))"
HEAD = "scan,time_s,strip,v_h,v_l\n"


def _good(done: CompletedProcess[str]) -> CompletedProcess[str]:
    assert done.returncode == 0, done.stderr
    return done


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "rectangle.wkt").write_text(RECTANGLE)
    (tmp_path / "small.toml").write_text(
        ts.Sensor(construction="crs-crs", strips=3, pitch_mm=10.0, length_mm=100.0, vref_volt=5.0).to_toml()
    )
    ts.Sensor(
        construction="crs-crp",
        strips=5,
        pitch_mm=10.0,
        length_mm=100.0,
        contact_lambda_mm=2.0,
        resistivity_ratio=100.0,
    ).save(tmp_path / "sheet.toml")
    return tmp_path


def test_from_spec_to_shape(folder: Path) -> None:
    _good(run(folder, "init", "mine.toml", "--strips", 60, "--pitch", 1.1, "--length", 300))
    assert ts.Sensor.load(folder / "mine.toml").strips == 60
    done = _good(run(folder, "simulate", "mine.toml", "rectangle.wkt", "-o", "r.csv", "--at", 33, 150, "--turn", 30,
                      "--plot", "sim.png"))  # fmt: skip
    assert "1 scan(s) of 60 strips, 56 of them touched" in done.stdout
    done = _good(run(folder, "reconstruct", "mine.toml", "r.csv", "-o", "o.geojson", "--plot", "o.png"))
    assert "scan 0, polygon: ok" in done.stderr
    (feature,) = json.loads((folder / "o.geojson").read_text())["features"]
    assert feature["properties"]["area_mm2"] == pytest.approx(50.0 * 35.0, rel=0.03)
    assert "outermost strips" not in done.stderr
    assert "with 2 mm the smallest object here, 34.6 mm along the strips, is 4 mm longer" in done.stderr
    _good(run(folder, "simulate", "mine.toml", "rectangle.wkt", "-o", "r.csv", "--at", 5, 150, "--turn", 90,
              "--force"))  # fmt: skip
    done = _good(run(folder, "reconstruct", "mine.toml", "r.csv", "-o", "o2.geojson"))
    assert "1 object(s) reach the sensor's outermost strips: they may hang over its edge" in done.stderr
    assert "contact_lambda_mm" not in done.stderr
    for picture in ("sim.png", "o.png"):
        assert (folder / picture).read_bytes()[:4] == b"\x89PNG"


def test_dragging_turning_and_noise(folder: Path) -> None:
    words = ["simulate", "prototype-crs-m", "rectangle.wkt", "-o", "r.csv", "--at", 20, 60, "--drag", 20, 180,
             "--steps", 4, "--turn-per-step", 20, "--rate", 50, "--positional", 0.005, "--force"]  # fmt: skip
    done = _good(run(folder, *words, "--seed", 3))
    assert "a part of the contact lies off the sensor" in done.stderr
    first = (folder / "r.csv").read_text()
    sensor = ts.Sensor.load("prototype-crs-m")
    scans = ts.read_readings(folder / "r.csv", sensor)
    assert [s.time_s for s in scans] == pytest.approx([0.0, 0.02, 0.04, 0.06])
    _good(run(folder, *words, "--seed", 3))
    assert (folder / "r.csv").read_text() == first
    _good(run(folder, *words, "--seed", 4))
    assert (folder / "r.csv").read_text() != first


def test_method_signature_transitions_and_truth(folder: Path) -> None:
    polygon = "POLYGON ((100.5 500, 300.5 380, 420.5 520, 250.5 640, 100.5 500))"
    (folder / "shape.wkt").write_text(polygon)
    _good(run(folder, "simulate", "simulated-crs-crs", "shape.wkt", "-o", "r.csv"))
    done = _good(run(folder, "reconstruct", "simulated-crs-crs", "r.csv", "--method", "vertex", "--signature", "kh",
                      "--transitions", "100.5,250.5,300.5,420.5", "--truth", "shape.wkt"))  # fmt: skip
    (feature,) = json.loads(done.stdout)["features"]
    assert feature["properties"]["method"] == "vertex"
    assert len(feature["geometry"]["coordinates"][0]) == 5
    assert "M.C." in done.stderr
    assert "IoU 1.000" in done.stderr


def test_truth_with_several_polygons_as_placed(folder: Path) -> None:
    (folder / "two.wkt").write_text("MULTIPOLYGON (((0 0, 20 0, 8 30, 0 0)), ((60 10, 90 20, 70 60, 60 10)))")
    _good(run(folder, "simulate", "simulated-crs-crs", "two.wkt", "-o", "r.csv", "--at", 500, 400, "--turn", 20,
               "--placed", "placed.wkt"))  # fmt: skip
    done = _good(
        run(folder, "reconstruct", "simulated-crs-crs", "r.csv", "-o", "o.geojson", "--truth", "placed.wkt")
    )
    overlaps = [float(v) for v in re.findall(r"IoU ([\d.]+)", done.stderr)]
    assert "polygon 2: " in done.stderr  # numbered as in the picture
    assert len(overlaps) == 2
    assert min(overlaps) > 0.9
    (folder / "line.wkt").write_text("LINESTRING (0 0, 5 5)")
    done = run(folder, "reconstruct", "simulated-crs-crs", "r.csv", "--truth", "line.wkt")
    assert done.returncode == 2
    assert "--truth line.wkt: holds no polygon to compare with" in done.stderr


def test_what_could_not_be_recovered_ends_with_1(folder: Path) -> None:
    _good(
        run(
            folder,
            "simulate",
            "simulated-crs-crs",
            "rectangle.wkt",
            "-o",
            "r.csv",
            "--at",
            500,
            500,
            "--turn",
            30,
        )
    )
    done = run(
        folder, "reconstruct", "simulated-crs-crs", "r.csv", "--method", "vertex", "--transitions", "470,530"
    )
    assert done.returncode == 1
    assert "too few transitions" in done.stderr
    (feature,) = json.loads(done.stdout)["features"]
    assert feature["geometry"] is None


def _write(name: str, data: str | bytes) -> tuple[str, bytes]:
    return name, data if isinstance(data, bytes) else data.encode()


_SIM = ("simulate", "small.toml", "c.wkt", "-o", "r.csv")
_REC = ("reconstruct", "small.toml", "r.csv")
BAD = {
    "missing column": (_REC, _write("r.csv", "time_s,strip,v_h,v_l\n"), "column 'scan' is missing"),
    "missing line": (_REC, _write("r.csv", HEAD + "0,0,0,1,1\n"), "has no line for strip 1"),
    "unknown key": (
        ("simulate", "s.toml", "rectangle.wkt", "-o", "r.csv"),
        _write(
            "s.toml",
            'format = 1\nconstruction = "crs-m"\nstrips = 3\npitch_mm = 1\nlength_mm = 9\nwidth = 3\n',
        ),
        "s.toml: unknown key 'width'; the keys are: format, construction",
    ),
    "volts outside 0..Vref": (
        _REC,
        _write("r.csv", HEAD + "0,0,0,5.5,1\n"),
        "v_h = 5.5 V is outside 0 to 5 V",
    ),
    "all-empty scan": (
        _REC,
        _write("r.csv", HEAD + "".join(f"0,0,{i},,\n" for i in range(3))),
        "no strip is touched in any of 1 scan(s)",
    ),
    "strip out of range": (_REC, _write("r.csv", HEAD + "0,0,7,1,1\n"), "strip 7 is out of range 0 to 2"),
    "binary file": (_REC, _write("r.csv", b"\x00\x01\xff\xfe" * 50), "not a text file"),
    "polygon crossing itself": (
        _SIM,
        _write("c.wkt", "POLYGON ((0 0, 20 20, 20 0, 0 20, 0 0))"),
        "c.wkt: shape 1 of 1: crosses itself at [10 10]; list its corners in order round it",
    ),
    "contact outside the sensor": (
        _SIM,
        _write("c.wkt", "POINT (300 5)"),
        "lies outside the sensor (x 0 to 30, y 0 to 100 mm); move it, or check its unit: mm",
    ),
    "distribution of no noise": (
        (*_REC, "--distribution", "normal"),
        _write("r.csv", HEAD),
        "--distribution is of noise that is given: add --positional",
    ),
    "signature not there": (
        ("reconstruct", "small.toml", "r.csv", "--method", "vertex", "--signature", "k"),
        _write("r.csv", HEAD + "".join(f"0,0,{i},1,1\n" for i in range(3))),
        "a crs-crs sensor has no signature 'k'; it has: kh, kl",
    ),
    "empty file": (_REC, _write("r.csv", ""), "r.csv: the file is empty"),
    "truncated JSON": (
        ("simulate", "small.toml", "c.geojson", "-o", "r.csv"),
        _write("c.geojson", '{"type": "Polygon", "coordinates": [[[0, 0], [5,'),
        "c.geojson: not JSON",
    ),
    "no such spec": (
        ("simulate", "none.toml", "c.wkt", "-o", "r.csv"),
        _write("c.wkt", "POINT (1 1)"),
        "no such file",
    ),
    "no such method": (
        (*_REC, "--method", "magic"),
        _write("r.csv", HEAD + "".join(f"0,0,{i},1,1\n" for i in range(3))),
        "method 'magic' does not exist; choose one of: polygon, vertex, profile",
    ),
    "profile of one signature": (
        (*_REC, "--method", "profile"),
        _write("r.csv", "scan,time_s,strip,v_h\n" + "".join(f"0,0,{i},1\n" for i in range(3))),
        "--method profile needs both k_h and k_l, and here is kh alone; take --method polygon",
    ),
    "transitions": (
        (*_REC, "--method", "vertex", "--transitions", "1,b"),
        _write("r.csv", HEAD + "".join(f"0,0,{i},1,1\n" for i in range(3))),
        "--transitions 1,b: give auto, gradient, or numbers",
    ),
    "folder to write to": (
        ("simulate", "small.toml", "c.wkt", "-o", "no/such/r.csv"),
        _write("c.wkt", "POINT (5 5)"),
        "no/such/r.csv: No such file or directory (is there such a folder?)",
    ),
    "folder of a picture": (
        (*_REC, "--plot", "no/such/r.png"),
        _write("r.csv", HEAD + "".join(f"0,0,{i},1,1\n" for i in range(3))),
        "no/such/r.png: No such file or directory (is there such a folder?)",
    ),
    "folder of a picture of the doctor's": (
        ("doctor", "r.csv", "--sensor", "small.toml", "--plot", "no/r.png"),
        _write("r.csv", HEAD + "".join(f"0,0,{i},1,1\n" for i in range(3))),
        "no/r.png: No such file or directory (is there such a folder?)",
    ),
    "folder of a picture of limits": (
        ("limits", "small.toml", "rectangle.wkt", "--plot", "no/r.png"),
        _write("x", ""),
        "no/r.png: No such file or directory (is there such a folder?)",
    ),
    "folder of a spec": (("init", "no/n.toml"), _write("x", ""), "(is there such a folder?)"),
    "limits without noise": (
        ("limits", "small.toml", "rectangle.wkt"),
        _write("x", ""),
        "such as --positional 0.005, --quantisation 0.001 or --bits 12",
    ),
    "polygon of a sheet": (
        ("reconstruct", "sheet.toml", "r.csv", "--method", "polygon"),
        _write("r.csv", HEAD + "".join(f"0,0,{i},2,1\n" for i in range(5))),
        "--method polygon is not for a crs-crp sensor, whose strips shift each other's readings (3.3); "
        "take --method profile",
    ),
    "signature of a sheet": (
        ("reconstruct", "sheet.toml", "r.csv", "--signature", "kh"),
        _write("r.csv", HEAD + "".join(f"0,0,{i},2,1\n" for i in range(5))),
        "--signature is for --method polygon or vertex; leave it out",
    ),
    "misspelt column": (
        _REC,
        _write("r.csv", "scan,time_s,strip,vh,v_l\n"),
        "r.csv: column 'vh' is not known, and 'v_h' is missing: write 'v_h'",
    ),
    "noise in percent": (
        (*_SIM, "--positional", "1.5"),
        _write("c.wkt", "POINT (5 5)"),
        "positional = 1.5: a fraction of Vref, 0.01 for 1 %",
    ),
    "rate at which no scan ever comes": (
        (*_SIM, "--still", "2", "--rate", "1e-320"),
        _write("c.wkt", "POINT (5 5)"),
        "--rate 9.99989e-321: give scans a second [Hz], from 1e-6 to 1e6",
    ),
    "output is input": (
        ("simulate", "small.toml", "c.wkt", "-o", "small.toml"),
        _write("c.wkt", "POINT (5 5)"),
        "small.toml is read here and would be written over",
    ),
    "picture's ending": (
        (*_SIM, "--plot", "c.bmp"),
        _write("c.wkt", "POINT (5 5)"),
        "c.bmp: a picture is a file that ends in .png, .svg, .pdf",
    ),
    "moved by nan": (
        (*_SIM, "--at", "nan", "4"),
        _write("c.wkt", "POINT (5 5)"),
        "'nan' is not a number; write it in the digits 0 to 9",
    ),
    "steps without a path": ((*_SIM, "--steps", "3"), _write("c.wkt", "POINT (5 5)"), "--steps needs --drag"),
    "transitions of a profile": (
        (*_REC, "--method", "profile", "--transitions", "1,2,3"),
        _write("r.csv", HEAD + "".join(f"0,0,{i},1,1\n" for i in range(3))),
        "--transitions is for --method vertex; leave it out for profile",
    ),
    "vertices of a profile": (
        (*_REC, "--method", "profile", "--vertices", "4"),
        _write("r.csv", HEAD + "".join(f"0,0,{i},1,1\n" for i in range(3))),
        "--vertices is for --method polygon; leave it out for profile",
    ),
    "one object of a profile": (
        (*_REC, "--method", "profile", "--one-object"),
        _write("r.csv", HEAD + "".join(f"0,0,{i},1,1\n" for i in range(3))),
        "--one-object is for --method polygon; leave it out for profile",
    ),
    "two vertices": (
        (*_REC, "--vertices", "2"),
        _write("r.csv", HEAD + "".join(f"0,0,{i},1,1\n" for i in range(3))),
        "vertices = 2: a polygon has 3 or more",
    ),
    "copied and shaped": (
        ("init", "n.toml", "--like", "prototype-crs-m", "--strips", "40"),
        _write("x", ""),
        "--like copies",
    ),
    "spec exists": (("init", "small.toml"), _write("x", ""), "small.toml exists already"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_gets_a_clear_error(folder: Path, name: str) -> None:
    words, (file, data), message = BAD[name]
    (folder / file).write_bytes(data)
    done = run(folder, *words)
    assert done.returncode == 2, (done.returncode, done.stdout, done.stderr)
    assert message in done.stderr
    assert "Traceback" not in done.stderr


def test_a_full_disk_is_not_bad_input(folder: Path) -> None:
    (folder / "c.wkt").write_text("POINT (5 5)")
    done = run(folder, "simulate", "small.toml", "c.wkt", "-o", "/dev/full")
    assert done.returncode == 1
    assert done.stderr == (
        "Error: /dev/full: No space left on device; nothing is written there: make room, or choose another disk\n"
    )


def test_bad_input_leaves_what_was_written_alone(folder: Path) -> None:
    _good(run(folder, "simulate", "prototype-crs-crs", "rectangle.wkt", "-o", "r.csv", "--at", 32, 160))
    before = (folder / "r.csv").read_bytes()
    assert (
        run(
            folder, "simulate", "prototype-crs-crs", "rectangle.wkt", "-o", "r.csv", "--at", 900, 0
        ).returncode
        == 2
    )
    assert (folder / "r.csv").read_bytes() == before


def test_help_shows_an_example_for_every_verb(tmp_path: Path) -> None:
    from tacstrip.cli import VERBS, cli

    overview = _good(run(tmp_path, "--help")).stdout
    for verb in VERBS:
        assert verb in overview
        done = CliRunner().invoke(cli, [verb, "--help"])
        assert done.exit_code == 0
        assert "Example: tacstrip " + verb in " ".join(done.stdout.split())


def test_linear_algebra_has_one_thread_unless_the_environment_says_how_many(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = ("OPENBLAS_NUM_THREADS", "GOTO_NUM_THREADS", "OMP_NUM_THREADS")
    for said, ours in ({}, "1"), ({"OMP_NUM_THREADS": "3"}, None), ({"OPENBLAS_NUM_THREADS": "2"}, "2"):
        for name in names:
            monkeypatch.setenv(name, said.get(name, ""))
        _good(run(tmp_path, "--help"))
        assert (os.environ[names[0]] or None, os.environ[names[2]]) == (ours, said.get(names[2], ""))


def test_a_sheet_is_recovered_by_the_method_for_it(folder: Path) -> None:
    _good(run(folder, "simulate", "sheet.toml", "rectangle.wkt", "-o", "r.csv", "--at", 25, 50))
    done = _good(run(folder, "reconstruct", "sheet.toml", "r.csv", "-o", "o.geojson"))
    assert "scan 0, profile: " in done.stderr


_VOLTS = [(2.0, 1.0), (2.1, 1.0), (2.2, 1.1), (2.1, 1.2), (2.0, 1.2)]


def _readings(folder: Path, columns: str, volts: list[tuple[float, float]] = _VOLTS) -> None:
    """Write r.csv, and five.toml of the sensor that it is of."""
    ts.Sensor(construction="crs-crs", strips=5, pitch_mm=10.0, length_mm=100.0).save(folder / "five.toml")
    picked = [["v_h", "v_l"].index(c) for c in columns.split(",")]
    lines = [f"0,0,{i},{','.join(str(v[p]) for p in picked)}\n" for i, v in enumerate(volts)]
    (folder / "r.csv").write_text(f"scan,time_s,strip,{columns}\n" + "".join(lines))


def test_half_of_the_readings_is_told(folder: Path) -> None:
    _readings(folder, "v_l")
    for words in (("reconstruct", "five.toml", "r.csv"), ("doctor", "r.csv", "--sensor", "five.toml")):
        assert "Warning: using v_l only: r.csv has no v_h (or code_h)" in run(folder, *words).stderr
    _readings(folder, "v_h,v_l")
    assert "Warning" not in run(folder, "reconstruct", "five.toml", "r.csv").stderr


def test_exchanged_columns_are_told(folder: Path) -> None:
    _readings(folder, "v_h,v_l", [(low, high) for high, low in _VOLTS])
    assert (
        "Warning: r.csv: k_h is below k_l on 5 of 5 strips: are the columns exchanged? "
        "Then exchange their names, or the two wires"
    ) in run(folder, "reconstruct", "five.toml", "r.csv").stderr


def test_readings_over_vref_are_told(folder: Path) -> None:
    _readings(folder, "v_h,v_l", [(high / 5.0, low / 5.0) for high, low in _VOLTS])
    for words in (("reconstruct", "five.toml", "r.csv"), ("doctor", "r.csv", "--sensor", "five.toml")):
        told = run(folder, *words).stderr
        assert "Warning: r.csv: no reading is above 1 V, and vref_volt is 5: are they over Vref?" in told


def test_an_ending_that_no_file_of_results_has(folder: Path) -> None:
    done = run(folder, "reconstruct", "small.toml", "new.csv", "-o", "x.txt")
    assert done.returncode == 2
    assert "ending '.txt' does not exist" in done.stderr


def test_init_prints_what_import_will_ask(folder: Path) -> None:
    rows = [f"{100 * n},0,0,{760 + n},{300 + n},{771 + n},{310 - n},0,0" for n in range(12)]
    names = ",".join(f"top{n},bot{n}" for n in range(1, 5))
    (folder / "wide.csv").write_text("\n".join([f"millis,{names}", *rows]) + "\n")
    given = (
        "--construction",
        "crs-crs",
        "--strips",
        4,
        "--pitch",
        8,
        "--length",
        90,
        "--vref",
        3.3,
        "--bits",
        10,
    )
    done = _good(run(folder, "init", "wide.toml", "--from", "wide.csv", *given))
    assert "--answer unit=mV or --answer unit=code" in done.stdout
    asked = run(folder, "import", "wide.csv", "wide.toml", "-o", "out.csv")
    assert (asked.returncode, "--answer unit=mV or --answer unit=code" in asked.stderr) == (1, True)


def test_v_h_below_v_l_on_many_strips_is_asked_and_no_file_written(folder: Path) -> None:
    rows = [
        f"{n / 10},{s},{2.5 + n / 99:.3f},{2.5 - n / 99 + (n > 20):.3f}" for n in range(30) for s in range(3)
    ]
    (folder / "turned.csv").write_text("\n".join(["time_s,strip,v_h,v_l", *rows]) + "\n")
    asked = run(folder, "import", "turned.csv", "small.toml", "-o", "turned.out.csv")
    assert (asked.returncode, (folder / "turned.out.csv").exists()) == (1, False), asked.stderr
    assert "v_h is below v_l on strip 0 of the scan from line" in asked.stderr
    assert asked.stderr.rstrip().endswith("--answer exchanged=no")
    _good(
        run(folder, "import", "turned.csv", "small.toml", "-o", "turned.out.csv", "--answer", "exchanged=no")
    )


def test_metres_are_told(folder: Path) -> None:
    done = _good(run(folder, "init", "metres.toml", "--pitch", 0.004, "--length", 0.12))
    assert "Warning: pitch_mm = 0.004, length_mm = 0.12: mm, not m?" in done.stderr
    (folder / "m.wkt").write_text("POLYGON ((0.02 0.03, 0.07 0.025, 0.06 0.08, 0.02 0.03))")
    done = _good(run(folder, "simulate", "small.toml", "m.wkt", "-o", "r.csv"))
    assert (
        "no strip is touched: the contact falls between centre lines\nWarning: the contact is 0.055 mm"
        in done.stderr
    )
    done = _good(run(folder, "simulate", "metres.toml", "m.wkt", "-o", "r.csv", "--force"))
    assert "Warning: metres.toml: pitch_mm = 0.004" in done.stderr
    (folder / "gap.wkt").write_text("POLYGON ((6 30, 14 30, 14 40, 6 30))")
    done = _good(run(folder, "simulate", "small.toml", "gap.wkt", "-o", "r.csv", "--force"))
    assert "metres" not in done.stderr


@pytest.mark.parametrize("words", [("spice",), ("simulate", "--model", "network")])
def test_a_contact_between_centre_lines_is_told(folder: Path, words: tuple[str, ...]) -> None:
    (folder / "gap.wkt").write_text("POLYGON ((6 30, 14 30, 14 40, 6 30))")
    done = _good(run(folder, words[0], "small.toml", "gap.wkt", "-o", "out", *words[1:]))
    assert "Warning: no strip is touched" in done.stderr


def test_a_spec_on_the_output(folder: Path) -> None:
    done = _good(run(folder, "init", "-", "--strips", 7))
    assert not (folder / "-").exists()
    (folder / "printed.toml").write_text(done.stdout)
    assert ts.Sensor.load(folder / "printed.toml").strips == 7


def test_the_table_of_limits_has_heads(folder: Path) -> None:
    words = ("limits", "prototype-crs-crs", "rectangle.wkt", "--at", 32, 160, "--turn", 20, "--grid", 2)
    done = _good(run(folder, *words, "--positional", 0.01))
    assert done.stdout.splitlines()[2].split() == ["x", "y"] * 4


def test_a_reader_that_stops_costs_no_picture(folder: Path) -> None:
    _good(run(folder, "simulate", "simulated-crs-crs", "rectangle.wkt", "-o", "r.csv", "--at", 500, 400))

    def closed(*_: object, err: bool = False, **__: object) -> None:
        if not err:
            raise BrokenPipeError

    words = ["simulated-crs-crs", str(folder / "r.csv"), "--assessment", "none", "--plot"]
    with patch("tacstrip.cli.reconstruct.click.echo", closed):
        done = CliRunner().invoke(reconstruct, [*words, str(folder / "p.png")])
    assert isinstance(done.exception, BrokenPipeError)
    assert (folder / "p.png").exists()
