"""record, replay, recover, convert as a user meets them."""

from __future__ import annotations

import json
import re
import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
from mcap.reader import make_reader

import tacstrip as ts
from recordings import make, sensor
from tacstrip.cli import main
from tacstrip.cli.record import _duration
from tacstrip.stream.codes import decode
from waiting import HANG_S

RECTANGLE = "POLYGON ((-15 -10, 15 -10, 15 10, -15 10, -15 -10))"
RECORD = ("record", "s.toml", "o.wkt", "-o", "a.mcap", "--at", "15", "40", "--drag", "15", "60", "--rate", "500",
          "--seconds", "0.2", "--positional", "0.002")  # fmt: skip
Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Give what runs a command in a folder with a spec and a contact: exit code, output, errors."""
    monkeypatch.chdir(tmp_path)
    sensor().save("s.toml")
    Path("o.wkt").write_text(RECTANGLE)

    def _run(*words: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["tacstrip", *words])
        with pytest.raises(SystemExit) as left:
            main()
        out = capsys.readouterr()
        assert "Traceback" not in out.err
        return int(left.value.code or 0), out.out, out.err

    return _run


def _good(went: tuple[int, str, str]) -> str:
    code, out, error = went
    assert code == 0, error
    assert not error
    return out


def test_record_and_replay(run: Run) -> None:
    assert "a.mcap: 100 scan(s) of 30 strips, 100 shape(s)" in _good(run(*RECORD, "--reconstruct", "profile"))
    lines = [json.loads(line) for line in _good(run("replay", "a.mcap", "--fast")).splitlines()]
    assert [line["scan"] for line in lines] == list(range(100))
    assert lines[-1]["time_s"] == pytest.approx(0.198)
    file = ts.Recording("a.mcap")
    for line, raw in zip(lines, file, strict=True):
        scan = decode(raw, file.sensor)
        kh = np.array([np.nan if k is None else k for k in line["kh"]])
        np.testing.assert_allclose(kh, scan["kh"], atol=1e-9)
        (shape,) = line["shapes"]
        assert shape["status"] == "ok"
        np.testing.assert_allclose(shape["vertices_mm"], (raw.shapes or ())[0].vertices, atol=1e-6)
    out = _good(run("replay", "a.mcap", "--summary"))
    assert "crs-crs, 30 strips, codes kh, kl of 12 bits" in out
    assert "100 scan(s), 100 of them touched, 0 lost" in out
    assert "500 scans a second" in out
    assert "shapes: 100 ok" in out
    assert "method: profile" in out


def test_replay_with_another_spec_and_method_and_a_picture(run: Run) -> None:
    _good(run(*RECORD))
    longer = ts.Sensor.load("s.toml")
    ts.Sensor(**{**{k: getattr(longer, k) for k in ("construction", "strips", "pitch_mm", "adc_bits")},
                 "length_mm": 200.0}).save("long.toml")  # fmt: skip
    code, out, error = run("replay", "a.mcap", "--speed", "10", "--sensor", "long.toml", "--reconstruct", "profile",
                           "--plot", "last.png")  # fmt: skip
    assert (code, error) == (0, "last.png written\n")
    y = np.array(json.loads(out.splitlines()[-1])["shapes"][0]["vertices_mm"])[:, 1]
    assert y.mean() == pytest.approx(2.0 * 60.0, abs=2.0)  # twice as long: twice as high
    assert Path("last.png").read_bytes()[:4] == b"\x89PNG"


def test_recover_a_cut_file(run: Run) -> None:
    _good(run(*RECORD, "--reconstruct", "profile"))
    data = Path("a.mcap").read_bytes()
    Path("cut.mcap").write_bytes(data[: len(data) // 2])
    code, out, error = run("replay", "cut.mcap", "--summary")
    assert code == 0
    assert "cut.mcap was cut" in error
    assert "`tacstrip recover`" in error
    with patch("tacstrip.cli.track.track", lambda *_: []):
        assert "cut.mcap was cut" in run("track", "cut.mcap")[2]
    assert "cut.mcap was cut" in run("live", "cut.mcap", "--no-view", "--speed", "1000")[2]
    assert "cut.mcap: the recording is cut" in run("noise", "cut.mcap")[2]
    out = _good(run("recover", "cut.mcap"))
    assert "cut-recovered.mcap: " in out
    count = len(list(ts.Recording("cut-recovered.mcap")))
    assert 0 < count < 100
    assert f"/tacstrip/scan: {count}, /tacstrip/polygon: {count}" in out
    assert "Lost: an unknown number of messages" in out
    assert f"what was cut off the end, and of the {len(data) // 2} bytes that are left the last" in out
    assert "Nothing was lost: every message of a.mcap is in it" in _good(
        run("recover", "a.mcap", "-o", "b.mcap")
    )
    assert len(list(ts.Recording("b.mcap"))) == 100


def test_recover_past_damage(run: Run) -> None:
    """The head of a chunk in the middle is gone: all others come back, and it is told in one place what does not."""
    _good(run(*RECORD))
    data = bytearray(Path("a.mcap").read_bytes())
    with Path("a.mcap").open("rb") as stream:
        index = make_reader(stream).get_summary()
    assert index is not None
    at = index.chunk_indexes[2].chunk_start_offset
    data[at - 25 : at + 25] = bytes(b ^ 0xFF for b in data[at - 25 : at + 25])
    Path("bad.mcap").write_bytes(data)
    code, _, error = run("replay", "bad.mcap", "--summary")
    assert code == 2
    assert "are damaged; `tacstrip recover` keeps what is whole" in error
    assert "cut" not in error
    out = _good(run("recover", "bad.mcap"))
    count = len(list(ts.Recording("bad-recovered.mcap")))
    assert 50 < count < 100
    assert f"Lost: {100 - count} of 100 messages\n  " in out
    assert re.search(r"\n  \d+ bytes from byte \d+ on are damaged\n$", out)


def test_from_recording_to_csv_and_back(run: Run) -> None:
    _good(run(*RECORD))
    first = list(ts.Recording("a.mcap"))
    for words in ([], ["--codes"]):
        _good(run("convert", "a.mcap", "-o", "a.csv", "--force", *words))
        _good(run("convert", "s.toml", "a.csv", "-o", "b.mcap", "--force"))
        for one, other in zip(first, ts.Recording("b.mcap"), strict=True):
            assert one.time_s == pytest.approx(other.time_s, abs=1e-9)
            np.testing.assert_array_equal(one.touched, other.touched)
            for name, codes in one.codes.items():
                np.testing.assert_array_equal(codes[one.touched], other.codes[name][one.touched])
    header, line = Path("a.csv").read_text().splitlines()[:2]
    assert header == "scan,time_s,strip,code_h,code_l"
    assert line == f"0,0,0,{first[0].codes['kh'][0]},{first[0].codes['kl'][0]}"


def test_to_numpy(run: Run) -> None:
    _good(run(*RECORD, "--reconstruct", "profile"))
    _good(run("convert", "a.mcap", "-o", "a.npz"))
    data = np.load("a.npz")
    file = ts.Recording("a.mcap")
    raws = list(file)
    np.testing.assert_allclose(data["time_s"], [raw.time_s for raw in raws], atol=1e-9)
    for name in ("kh", "kl"):
        np.testing.assert_array_equal(data[name], [decode(raw, file.sensor)[name] for raw in raws])
        np.testing.assert_array_equal(data[f"code_{name}"], [raw.codes[name] for raw in raws])
    np.testing.assert_array_equal(data["touched"], [raw.touched for raw in raws])
    start = data["polygon_start"]
    for i, raw in enumerate(raws):
        assert data["polygon_scan"][i] == i
        corners = data["polygon_vertices_mm"][start[i] : start[i + 1]]
        np.testing.assert_array_equal(corners, (raw.shapes or ())[0].vertices)
    Path("again.toml").write_text(str(data["sensor_toml"]))
    assert ts.Sensor.load("again.toml") == file.sensor


def test_to_geojson_and_spec(run: Run) -> None:
    _good(run(*RECORD, "--reconstruct", "profile"))
    assert "100 shape(s)" in _good(run("convert", "a.mcap", "-o", "a.geojson"))
    features = json.loads(Path("a.geojson").read_text())["features"]
    raws = list(ts.Recording("a.mcap"))
    for feature, raw in zip(features, raws, strict=True):
        assert feature["properties"]["method"] == "profile"
        assert feature["properties"]["status"] == "ok"
        assert feature["properties"]["time_s"] == raw.time_s
        ring = np.array(feature["geometry"]["coordinates"][0])
        np.testing.assert_allclose(ring[:-1], (raw.shapes or ())[0].vertices, atol=1e-9)
    _good(run("convert", "a.mcap", "-o", "again.toml"))
    assert ts.Sensor.load("again.toml") == sensor()


def test_a_recording_recorded_again_keeps_its_shapes_and_time(run: Run) -> None:
    _good(run(*RECORD, "--reconstruct", "profile"))
    _good(run("record", "a.mcap", "-o", "b.mcap"))
    one, other = ts.Recording("a.mcap"), ts.Recording("b.mcap")
    assert one.origin_ns == other.origin_ns
    assert other.about["method"] == "profile"
    for a, b in zip(one, other, strict=True):
        assert a.time_s == b.time_s
        np.testing.assert_allclose((a.shapes or ())[0].vertices, (b.shapes or ())[0].vertices, atol=1e-6)
    _good(run("record", "a.mcap", "-o", "c.mcap", "--reconstruct", "vertex"))
    file = ts.Recording("c.mcap")
    assert file.about["method"] == "vertex"
    file.close()


def test_what_is_stored_otherwise_than_it_came_is_told(run: Run) -> None:
    Path("v.csv").write_text("scan,time_s,strip,v_out\n0,0,0,1.2345\n0,0,1,\n")
    spec = ts.Sensor(construction="crs-m", strips=2, pitch_mm=1.0, length_mm=50.0)
    spec.save("none.toml")
    code, _, error = run("record", "none.toml", "v.csv", "-o", "v.mcap")
    assert code == 0
    assert "none.toml has no adc_bits: the recording holds codes of 16 bits" in error
    ts.Sensor(construction="crs-m", strips=2, pitch_mm=1.0, length_mm=50.0, adc_bits=8).save("eight.toml")
    code, _, error = run("record", "eight.toml", "v.csv", "-o", "w.mcap")
    assert code == 0
    assert "v.csv has readings between the codes of 8 bits; they are rounded" in error


def test_half_of_the_readings_and_metres_are_told(run: Run) -> None:
    Path("v.csv").write_text("scan,time_s,strip,code_l\n" + "".join(f"0,0,{i},9\n" for i in range(30)))
    code, _, error = run("record", "s.toml", "v.csv", "-o", "v.mcap")
    assert (code, error) == (0, "Warning: using v_l only: v.csv has no v_h (or code_h)\n")
    Path("m.wkt").write_text("POLYGON ((0.02 0.03, 0.07 0.025, 0.06 0.08, 0.02 0.03))")
    code, _, error = run("record", "s.toml", "m.wkt", "-o", "m.mcap")
    assert code == 0
    assert "Warning: the contact is 0.055 mm large, on a sensor of 30 x 100 mm: is it in metres?" in error


def test_much_work_is_told_before_it_begins(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    assert not run(*RECORD, "--force")[2]
    monkeypatch.setattr("tacstrip.cli.record._LONG_S", 0.0)
    code, out, error = run(*RECORD, "--force")
    assert code == 0
    assert "a.mcap: 100 scan(s)" in out
    assert re.fullmatch(r"100 scans: some [\d.e-]+ min of work and 0 MB\. Ctrl-C ends it, .*\n", error)
    assert [raw.sequence for raw in ts.Recording("a.mcap")] == list(range(100))


@pytest.mark.parametrize(("seconds", "words"), [(90.0, "1.5 min"), (14400.0, "4 h"), (864000.0, "10 days")])
def test_durations(seconds: float, words: str) -> None:
    assert _duration(seconds) == words


@pytest.mark.parametrize("words", [("replay", "a.mcap", "--fast"), ("replay", "a.mcap", "--summary")])
def test_a_reader_that_stops_is_no_error(run: Run, words: tuple[str, ...]) -> None:
    _good(run(*RECORD))
    line = [sys.executable, "-c", "from tacstrip.cli import main; main()", *words]
    with subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert not process.stderr.read()
    assert process.returncode == 0


def test_full_disk(tmp_path: Path) -> None:
    """The operating system's own limit on a file's size stands for the end of the disk."""
    sensor().save(tmp_path / "s.toml")
    (tmp_path / "o.wkt").write_text(RECTANGLE)
    done = subprocess.run(
        [sys.executable, "-B", "-c", "from tacstrip.cli import main; main()", *RECORD],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        timeout=HANG_S,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (12_000, 12_000)),
    )
    assert done.returncode == 1, done.stderr
    assert "Error: a.mcap: File too large." in done.stderr
    file = ts.Recording(tmp_path / "a.mcap")
    read = list(file)
    assert file.condition.whole
    assert 0 < len(read) < 100
    assert f"{len(read)} scan(s) are saved in it" in done.stderr


BAD: dict[str, tuple[tuple[str, ...], str]] = {
    "there already": (("record", "a.mcap", "-o", "b.mcap"), "b.mcap exists already"),
    "over itself": (
        ("record", "a.mcap", "-o", "a.mcap", "--force"),
        "a.mcap is read here and would be written over",
    ),
    "no spec": (("record", "o.wkt", "-o", "c.mcap"), "o.wkt: a contact needs a SENSOR to touch"),
    "no ending": (("record", "a.mcap", "-o", "c.bag"), "-o c.bag: a recording is a file that ends in .mcap"),
    "three files": (("record", "s.toml", "a.mcap", "c", "-o", "c.mcap"), "c: one INPUT only"),
    "contact options": (
        ("record", "a.mcap", "-o", "c.mcap", "--rate", "5"),
        "--rate is for a contact",
    ),
    "no rate": (
        (*RECORD[:3], "-o", "c.mcap", "--rate", "0"),
        "--rate 0: give scans a second [Hz], from 1e-6 to 1e6",
    ),
    "nan seconds": ((*RECORD[:3], "-o", "c.mcap", "--seconds", "nan"), "'--seconds': 'nan' is not a number"),
    "negative seed": ((*RECORD[:3], "-o", "c.mcap", "--seed", "-1"), "--seed -1: must be 0 or more"),
    "no method": (
        ("record", "a.mcap", "-o", "c.mcap", "--reconstruct", "magic"),
        "method 'magic' does not exist",
    ),
    "off the sensor": (
        ("record", "s.toml", "o.wkt", "-o", "c.mcap", "--at", "500", "5"),
        "lies outside the sensor",
    ),
    "no folder": (("record", "a.mcap", "-o", "no/c.mcap"), "no/c.mcap: No such file or directory"),
    "replay nothing": (("replay", "none.mcap"), "none.mcap: no such file"),
    "replay a spec": (("replay", "s.toml"), "s.toml: not a recording"),
    "replay backwards": (("replay", "a.mcap", "--speed", "-1"), "--speed -1.0: must be above 0"),
    "replay fast and slow": (
        ("replay", "a.mcap", "--fast", "--speed", "0.5"),
        "--speed is the pace of scans",
    ),
    "another sensor": (
        ("replay", "a.mcap", "--sensor", "prototype-crs-m"),
        "construction = crs-crs, and the",
    ),
    "picture": (("replay", "a.mcap", "--plot", "p.bmp"), "p.bmp: a picture is a file that ends in .png"),
    "recover a spec": (("recover", "s.toml"), "s.toml: not a recording"),
    "recover over": (("recover", "a.mcap", "-o", "b.mcap"), "b.mcap exists already"),
    "to nothing": (
        ("convert", "a.mcap", "-o", "a.doc"),
        "ending '.doc' does not exist; choose one of: .mcap, .csv",
    ),
    "recover into no folder": (
        ("recover", "a.mcap", "-o", "no/c.mcap"),
        "no/c.mcap: No such file or directory (is there such a folder?)",
    ),
    "profile of a metal": (
        (
            "record",
            "prototype-crs-m",
            "o.wkt",
            "-o",
            "c.mcap",
            "--at",
            "20",
            "90",
            "--reconstruct",
            "profile",
        ),
        "--reconstruct profile needs both k_h and k_l, and here is k alone; take --reconstruct polygon",
    ),
    "polygon of a sheet": (
        ("record", "sheet.toml", "o.wkt", "-o", "c.mcap", "--at", "4", "50", "--reconstruct", "polygon"),
        "--reconstruct polygon is not for a crs-crp sensor, whose strips shift each other's readings (3.3); take "
        "--reconstruct profile",
    ),
    "no shapes": (
        ("convert", "a.mcap", "-o", "a.geojson"),
        "a.mcap: it holds no polygons; `tacstrip record a.mcap",
    ),
    "shapes of readings": (("convert", "s.toml", "r.csv", "-o", "r.geojson"), "r.csv holds no shapes"),
    "readings without spec": (
        ("convert", "r.csv", "-o", "r.mcap"),
        "r.csv: a readings file does not say what sensor",
    ),
    "codes to numpy": (("convert", "a.mcap", "-o", "a.npz", "--codes"), "--codes is for a .csv"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_gets_a_clear_error(run: Run, name: str) -> None:
    make(Path("a.mcap"), sensor(), 3, None)
    sensor("crs-crp", 8).save("sheet.toml")
    Path("b.mcap").write_text("precious")
    Path("r.csv").write_text(
        "scan,time_s,strip,code_h,code_l\n" + "".join(f"0,0,{i},9,8\n" for i in range(30))
    )
    words, told = BAD[name]
    code, _, error = run(*words)
    assert code == 2, error
    assert told in error
    assert Path("b.mcap").read_text() == "precious"
    assert not Path("c.mcap").exists()


@pytest.mark.parametrize(
    "words", ["convert cut.mcap -o a.csv", "record cut.mcap -o b.mcap", "doctor cut.mcap", "noise cut.mcap",
              "track cut.mcap", "replay cut.mcap", "live cut.mcap --no-view"],
)  # fmt: skip
def test_a_recording_that_is_cut_before_its_first_scan_is_refused(run: Run, words: str) -> None:
    run(*RECORD)
    Path("cut.mcap").write_bytes(Path("a.mcap").read_bytes()[:2500])
    before = set(Path().iterdir())
    code, _, error = run(*words.split())
    assert code == 2
    assert "cut.mcap: there is no scan in it: it was cut before its first whole chunk" in error
    assert set(Path().iterdir()) == before


def test_a_command_in_a_message_can_be_copied_whatever_the_file_is_called(run: Run) -> None:
    run(*RECORD)
    Path("my notes").mkdir()
    Path("a.mcap").rename("my notes/a.mcap")
    _, _, error = run("reconstruct", "s.toml", "my notes/a.mcap")
    assert "`tacstrip convert 'my notes/a.mcap' -o readings.csv`" in error
