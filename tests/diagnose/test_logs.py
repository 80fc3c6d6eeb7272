"""The doctor at the command line and on files, and the faults that it is shown."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import tacstrip as ts
from studies.checkup import exercise
from studies.faults import Defect, faulty_log
from tacstrip.contact.noise import Noise
from tacstrip.diagnose.doctor import diagnose
from tacstrip.diagnose.log import Log, read_log
from tacstrip.diagnose.neighbour_prediction import places, predict_from_neighbours, working_copy
from tacstrip.errors import OptionError, ReadingError, SignatureError
from tacstrip.network import Break, Imperfections, Short
from tacstrip.network.imperfections import Layer
from tacstrip.stream.source import RawScan
from verbs import run

SENSOR = ts.Sensor(
    construction="crs-crs", strips=10, pitch_mm=6.5, length_mm=325.0, adc_bits=12, strip_base=1
)
FAINT = Noise(positional=0.001)


def _write(path: Path, log: Log) -> None:
    lines = ["scan,time_s,strip,v_h,v_l"]
    for t, time_s in enumerate(log.time_s):
        for strip in range(log.sensor.strips):
            volts = [log.raw[n][t, strip] * log.sensor.vref_volt for n in ("kh", "kl")]
            fields = ["" if np.isnan(v) else f"{v:.9g}" for v in volts]
            lines.append(",".join([str(t), f"{time_s:.6g}", str(strip + log.sensor.strip_base), *fields]))
    path.write_text("\n".join(lines))


@pytest.fixture(scope="module")
def contacts() -> list[ts.Contact]:
    return exercise(SENSOR, np.random.default_rng(5), 240)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    SENSOR.save(tmp_path / "sensor.toml")
    return tmp_path


def test_exit_codes_words_picture_and_json(folder: Path, contacts: list[ts.Contact]) -> None:
    _write(folder / "good.csv", faulty_log(SENSOR, contacts, noise=FAINT))
    _write(folder / "bad.csv", faulty_log(SENSOR, contacts, [Defect("stuck", 4, 0.5, "kl")], FAINT))
    good = run(folder, "doctor", "good.csv", "--sensor", "sensor.toml")
    assert (good.returncode, good.stderr) == (0, "")
    assert "No fault found, as far as this recording shows" in good.stdout
    assert "within profile I" in good.stdout
    bad = run(folder, "doctor", "bad.csv", "--sensor", "sensor.toml", "--plot", "health.png")
    assert bad.returncode == 1
    assert "BROKEN: strip 5, v_l: stuck channel. Stays within" in bad.stdout
    assert "Check the multiplexer's address lines" in bad.stdout
    assert (folder / "health.png").read_bytes()[:4] == b"\x89PNG"
    assert "too low to separate noise from motion" in bad.stdout
    assert "--positional" not in bad.stdout  # a bound is not offered as a noise
    printed = bad.stdout.split("at most +-")[1].split(" %")[0]
    done = run(folder, "doctor", "bad.csv", "--sensor", "sensor.toml", "--json")
    report = json.loads(done.stdout)
    assert done.returncode == 1
    assert [(f["fault"], f["strips"], f["signature"]) for f in report["findings"]] == [("stuck", [5], "kl")]
    assert not report["healthy"]
    assert report["noise"]["profile"] == "I"
    assert float(printed) == pytest.approx(report["noise"]["half_width_percent"], rel=0.06)
    assert "is the noisiest" in bad.stdout
    assert len(report["strips"]) == 10


def test_a_recording_brings_its_sensor(folder: Path, contacts: list[ts.Contact]) -> None:
    _write(folder / "bad.csv", faulty_log(SENSOR, contacts, [Defect("swapped-wires", 6)], FAINT))
    assert run(folder, "record", "sensor.toml", "bad.csv", "-o", "bad.mcap").returncode == 0
    done = run(folder, "doctor", "bad.mcap")
    assert done.returncode == 1
    assert "BROKEN: strip 7: v_h and v_l exchanged." in done.stdout


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("scan,time_s,strip,v_h,v_l\n0,0,1,1,1\n", "scan 0 (from line 2) has no line for strip 2"),
        ("scan,time_s,strip,v_h,v_l\n0,0,1,1,1\n0,0,1,1,1\n", "strip 1 of scan 0 is already on line 2"),
        ("scan,time_s,strip,v_out\n0,0,1,1\n", "does not belong to a crs-crs sensor"),
        ("scan,time_s,strip,v_h\n0,0,1,abc\n", "line 2: v_h is 'abc', not a number"),
        ("scan,time_s,strip,v_h\n0,0,1,1e308\n", "line 2: v_h = 1e308 V is no voltage"),
        ("scan,time_s,strip,v_h\n", "a header but no readings"),
        ("scan,time_s,strip,v_h\n" + "".join(f"0,0,{i},\n" for i in range(1, 11)), "no reading in any scan"),
    ],
)
def test_bad_input_ends_with_2(folder: Path, text: str, said: str) -> None:
    (folder / "r.csv").write_text(text)
    done = run(folder, "doctor", "r.csv", "--sensor", "sensor.toml")
    assert (done.returncode, done.stdout) == (2, "")
    assert said in done.stderr


def test_a_readings_file_needs_its_sensor(folder: Path) -> None:
    done = run(folder, "doctor", "r.csv")
    assert done.returncode == 2
    assert "name its spec: --sensor sensor.toml" in done.stderr


def test_volts_that_cannot_be_are_read_and_named(folder: Path, contacts: list[ts.Contact]) -> None:
    """`read_readings` refuses such a file; here they are evidence."""
    log = faulty_log(SENSOR, contacts, [Defect("wrong-vref", size=1.2)], FAINT)
    _write(folder / "r.csv", log)
    with pytest.raises(ReadingError, match="outside 0 to 5 V"):
        ts.read_readings(folder / "r.csv", SENSOR)
    again = read_log(folder / "r.csv", SENSOR)
    for name, values in log.raw.items():
        np.testing.assert_allclose(again.raw[name], values, atol=1e-9)
    (found,) = diagnose(again).findings
    assert (found.fault, found.strips) == ("wrong-vref", ())


def test_half_a_strip_may_be_missing(folder: Path) -> None:
    rows = [
        f"{t},{t},{i},{'' if i == 3 else 1.0 + 0.01 * t},{0.9 + 0.01 * t}"
        for t in range(3)
        for i in range(1, 11)
    ]
    (folder / "r.csv").write_text("\n".join(["scan,time_s,strip,v_h,v_l", *rows]))
    log = read_log(folder / "r.csv", SENSOR)
    assert log.touched.all()
    assert np.isnan(log.raw["kh"][:, 2]).all()
    assert np.isfinite(log.raw["kl"]).all()


def test_codes_and_scans_make_the_same_log(contacts: list[ts.Contact]) -> None:
    scans = [
        ts.simulate(SENSOR, c, FAINT, rng=seed, time_s=0.01 * seed) for seed, c in enumerate(contacts[:30])
    ]
    log = Log.of_scans(SENSOR, scans)
    codes = [
        RawScan(
            s.time_s,
            {n: np.nan_to_num(np.round(s[n] * 4095.0)).astype(np.uint16) for n in s.signatures},
            s.touched,
        )
        for s in scans
    ]
    same = Log.of_codes(SENSOR, codes)
    np.testing.assert_array_equal(same.touched, log.touched)
    np.testing.assert_array_equal(same.time_s, log.time_s)
    for name, values in log.raw.items():
        np.testing.assert_allclose(same.raw[name], values, atol=1e-12)


def test_a_log_says_what_does_not_fit() -> None:
    time_s, values = np.zeros(2), np.zeros((2, 10))
    for bad, said in (
        ({"kh": values[:, :9]}, r"kh has shape \(2, 9\)"),
        ({"kh": np.full((2, 10), np.nan)}, "no reading"),
    ):
        with pytest.raises(ReadingError, match=said):
            Log.of(SENSOR, time_s, bad)
    with pytest.raises(SignatureError, match="no signature 'k'"):
        Log.of(SENSOR, time_s, {"k": values})
    with pytest.raises(ReadingError, match="no scan"):
        Log.of_scans(SENSOR, [])


def test_neighbours_expect_a_straight_line() -> None:
    there = np.ones((1, 6), dtype=bool)
    values = np.array([[0.1, 0.2, np.nan, 0.9, 0.5, 0.6]])
    line, both, gap = predict_from_neighbours(values, there)
    np.testing.assert_allclose(line[0], [-0.15, 1.1 / 3.0, 0.55, 0.4, 0.75, 0.1], atol=1e-12)
    assert both[0].tolist() == [False, True, True, True, True, False]
    assert gap[0, 2] == pytest.approx(0.7)
    apart = there.copy()
    apart[0, 2] = False  # two contacts: nothing reaches across
    assert not predict_from_neighbours(values, apart)[1][0, [1, 3]].any()


def test_a_contact_that_stands_is_one_place(contacts: list[ts.Contact]) -> None:
    log = faulty_log(SENSOR, [contacts[7]] * 20 + [contacts[20]] * 20, noise=FAINT)
    rows = places(working_copy(log, 0.0006))
    assert len(rows.there) == 2
    np.testing.assert_allclose(rows.k["kh"][0], log.raw["kh"][:20].mean(axis=0), atol=1e-12)


@pytest.mark.parametrize("construction", ["crs-crs", "crs-m"])
def test_defects_of_the_network_are_those_of_the_whole_sensor(construction: str) -> None:
    """`faulty_log` solves a piece of the sensor; the piece must not matter."""
    sensor = ts.Sensor(
        construction=construction, strips=6, pitch_mm=6.0, length_mm=100.0, contact_lambda_mm=1.0
    )
    contact = ts.Contact.polygon([(5.0, 30.0), (32.0, 42.0), (31.0, 60.0), (4.0, 55.0)])
    layer: Layer = "sensing" if construction == "crs-crs" else "energised"
    for defect, build in (
        (Defect("open-strip", 2, 0.2), Imperfections(breaks=[Break(2, 20.0)])),
        (Defect("short", 3, 0.7, sensor.signatures[0]), Imperfections(shorts=[Short(3, 70.0, 20.0, layer)])),
    ):
        whole = ts.simulate(sensor, contact, model="network", imperfections=build)
        log = faulty_log(sensor, [contact], [defect])
        for name in sensor.signatures:
            np.testing.assert_allclose(log.raw[name][0], whole[name], atol=1e-6)


@pytest.mark.parametrize(
    ("defect", "said"),
    [
        (Defect("rust", 1), "fault 'rust' does not exist; choose one of: open-strip"),
        (Defect("stuck"), "stuck needs a strip"),
        (Defect("short", 9), "the sensor has strips 0 to 9"),
    ],
)
def test_a_defect_that_cannot_be_is_refused(defect: Defect, said: str, contacts: list[ts.Contact]) -> None:
    with pytest.raises(OptionError, match=said):
        faulty_log(SENSOR, contacts[:2], [defect])
