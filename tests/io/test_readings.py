"""Readings files: every form comes back, every fault is named."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import tacstrip as ts
from strategies import texts
from tacstrip.sensor.converter import Converter
from tacstrip.stream import ReadingsSource, decode, encode
from tacstrip.stream.export import write_csv

# Few strips and any numbers: what they warn of is tested beside the checks.
pytestmark = pytest.mark.filterwarnings("ignore::tacstrip.ReadingWarning")

NAN = float("nan")
CRS = ts.Sensor(construction="crs-crs", strips=3, pitch_mm=1.0, length_mm=10.0, vref_volt=6.05, adc_bits=12)
METAL = ts.Sensor(construction="crs-m", strips=3, pitch_mm=1.0, length_mm=10.0, strip_base=1)
HEAD = "scan,time_s,strip,v_h,v_l\n"


def _file(folder: Path, text: str | bytes) -> Path:
    path = folder / "readings.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def _read(folder: Path, text: str | bytes, sensor: ts.Sensor = CRS) -> list[ts.Scan]:
    return ts.read_readings(_file(folder, text), sensor)


@given(
    readings=st.lists(
        st.tuples(st.booleans(), st.floats(0.0, 1.0), st.floats(0.0, 1.0)), min_size=3, max_size=3
    ),
    scans=st.integers(1, 3),
)
@settings(
    derandomize=True,
    max_examples=30,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
def test_written_readings_come_back(
    tmp_path: Path, readings: list[tuple[bool, float, float]], scans: int
) -> None:
    touched = np.array([r[0] for r in readings])
    kh, kl = (np.where(touched, [r[i] for r in readings], np.nan) for i in (1, 2))
    given_scans = [ts.Scan(kh=kh, kl=kl, time_s=0.1 * i) for i in range(scans)]
    path = tmp_path / "out.csv"
    ts.write_readings(path, CRS, given_scans)
    back = ts.read_readings(path, CRS)
    assert [s.time_s for s in back] == pytest.approx([s.time_s for s in given_scans])
    for scan in back:
        np.testing.assert_allclose(scan["kh"], kh, atol=1e-8)
        np.testing.assert_allclose(scan["kl"], kl, atol=1e-8)


def test_every_form(tmp_path: Path) -> None:
    (volts,) = _read(tmp_path, HEAD + "0,0,0,6.05,0\n0,0,1,3.025,1.21\n0,0,2,,\n")
    np.testing.assert_allclose(volts["kh"], [1.0, 0.5, np.nan])
    np.testing.assert_allclose(volts["kl"], [0.0, 0.2, np.nan])  # 0 is a legal reading
    (codes,) = _read(tmp_path, "scan,time_s,strip,code_h,code_l\n0,0,0,4095,0\n0,0,1,2048,819\n0,0,2,,\n")
    np.testing.assert_allclose(codes["kh"], [1.0, 2048 / 4095, np.nan])
    (single,) = _read(tmp_path, "scan,time_s,strip,v_h\n0,0,0,1\n0,0,1,2\n0,0,2,\n")
    assert single.signatures == ("kh",)
    (metal,) = _read(tmp_path, "scan,time_s,strip,v_out\n0,0,1,1\n0,0,2,2\n0,0,3,\n", METAL)
    np.testing.assert_allclose(metal["k"], [0.2, 0.4, np.nan])
    shuffled = "note,strip,v_l,time_s,v_h,scan\nx,2,,7.5,,a\n\ny,0,1.21,7.5,3.025,a\nz,1,1.21,7.5,3.025,a\n"
    (any_order,) = _read(tmp_path, "﻿" + shuffled)  # columns and strips in any order, a spreadsheet's mark
    assert any_order.time_s == 7.5
    np.testing.assert_allclose(any_order["kl"], [0.2, 0.2, np.nan])


def test_volts_of_untouched_strips(tmp_path: Path) -> None:
    bench = ts.Sensor(
        construction="crs-crs", strips=3, pitch_mm=1.0, length_mm=10.0, rest_volt=0.1, touch_volt=0.05
    )
    (scan,) = _read(tmp_path, HEAD + "0,0,0,0.12,0.09\n0,0,1,2.5,0.11\n0,0,2,0.04,0.1\n", bench)
    np.testing.assert_array_equal(scan.touched, [False, True, True])


FAULTS: dict[str, tuple[str | bytes, str]] = {
    "empty file": ("", "the file is empty; readings need a header line"),
    "semicolons": (
        "scan;time_s;strip;v_h\n",
        "separated by ';'; separate them by commas, .* `tacstrip import LOG",
    ),
    "column twice": ("scan,time_s,strip,v_h,v_h\n", "column 'v_h' is there twice"),
    "decimal commas": (
        HEAD + "0,0,0,1,5,1,5\n",
        "line 2 has 7 fields and the header 5: are there decimal commas",
    ),
    "missing column": (
        "scan,strip,v_h,v_l\n0,0,1,1\n0,1,,\n1,0,1,1\n1,1,,\n",
        "column 'time_s' is missing: line 4 begins a second scan, 1; give every scan its time in seconds",
    ),
    "no readings column": ("scan,time_s,strip\n", "a column of readings is missing: v_h, v_l"),
    "both kinds": ("scan,time_s,strip,v_h,code_h\n", "the header has both volts and codes"),
    "foreign signature": ("scan,time_s,strip,v_out\n", "column 'v_out' does not belong to a crs-crs sensor"),
    "header only": (HEAD, "the file has a header but no readings"),
    "missing line": (HEAD + "0,0,0,1,1\n0,0,2,1,1\n", r"scan 0 \(from line 2\) has no line for strip 1"),
    "strip out of range": (
        HEAD + "0,0,3,1,1\n",
        "line 2: strip 3 is out of range 0 to 2; check strips and strip_base",
    ),
    "strip twice": (HEAD + "0,0,0,1,1\n0,0,0,1,1\n", "line 3: strip 0 of scan 0 is already on line 2"),
    "strip no number": (HEAD + "0,0,a,1,1\n", "line 2: strip is 'a', not a whole number"),
    "literal nan": (
        HEAD + "0,0,0,nan,1\n",
        "line 2: v_h is 'nan'; leave the field empty where nothing touches",
    ),
    "infinite": (HEAD + "0,0,0,1,inf\n", "line 2: v_l is 'inf'"),
    "no number": (HEAD + "0,0,0,1V,1\n", "line 2: v_h is '1V', not a number"),
    "number with an underscore": (HEAD + "0,0,0,1_0,1\n", "line 2: v_h is '1_0', not a number"),
    "number in other digits": (HEAD + "0,0,0,٣,1\n", "line 2: v_h is '٣', not a number"),
    "strip with an underscore": (HEAD + "0,0,0_1,1,1\n", "line 2: strip is '0_1', not a whole number"),
    "time": (HEAD + "0,soon,0,1,1\n", "line 2: time_s is 'soon', not a number"),
    "millivolts": (
        HEAD + "0,0,0,3025,1\n",
        "line 2: v_h = 3025 V is outside 0 to 6.05 V; is it in millivolts",
    ),
    "below ground": (
        HEAD + "0,0,0,-0.2,1\n",
        "line 2: v_h = -0.2 V is outside 0 to 6.05 V; check the wiring",
    ),
    "shuffled": (
        HEAD + "".join(f"{s},0,{i},1,1\n" for s, i in ((0, 1), (1, 0), (0, 0))),
        "scan 0 .from line 2. has no line for strip 0; .*all lines of a scan must be together",
    ),
    "cut off": (HEAD + "0,0,0,1,1\n0,0,1,1", "line 3 has 4 fields and the header 5: is the file cut off"),
    "scan comes back": (
        HEAD + "".join(f"{s},0,{i},1,1\n" for s in (0, 1) for i in range(3)) + "0,0,0,1,1\n",
        "line 8: scan 0 comes again",
    ),
    "cut off in quotes": (
        'scan,time_s,strip,v_h,v_l,note\n0,0,0,1,1,"of, "\n0,0,1,1,1,"of',
        "a field in quotes has no end; the last line has no line end: is the file cut off",
    ),
    "code too large": (
        "scan,time_s,strip,code_h\n0,0,0,5000\n",
        "code_h = 5000 is outside 0 to 4095; check adc_bits",
    ),
    "code with a fraction": ("scan,time_s,strip,code_h\n0,0,0,10.5\n", "code_h = 10.5 is not a whole number"),
    "binary": (
        b"\x89PNG\r\n\x1a\n\x00\xff\xfe",
        "not a text file in UTF-8; readings are CSV with a header line",
    ),
    "zero bytes": (b"scan,time_s\x00,strip\n", "line 1: not text"),
    "UTF-16": (HEAD.encode("utf-16"), "the text is in UTF-16; save it as UTF-8"),
    "underscore left out": (
        "scan,time_s,strip,vh,v_l\n",
        "column 'vh' is not known, and 'v_h' is missing: write 'v_h'",
    ),
    "another case": ("scan,time_s,strip,v_h,V_L\n", "column 'V_L' is not known, and 'v_l' is missing"),
    "with a unit": ("scan,time_s,strip,v_h,v_l (V)\n", "and 'v_l' is missing"),
    "a letter off": ("scan,time_s,strip,v_j,v_l\n", "column 'v_j' is not known, and 'v_h' is missing"),
    "letters exchanged": ("scan,time_s,strip,code_h,cdoe_l\n", "and 'code_l' is missing"),
    "strip in capitals": (
        "scan,time_s,Strip,v_h,v_l\n",
        "column 'Strip' is not known, and 'strip' is missing",
    ),
    "no header": (
        "0,0,0,1,1\n0,0,1,1,1\n",
        "the header line is missing: .* such as scan,time_s,strip,v_h,v_l",
    ),
    "cut between lines": (
        HEAD + "0,0,0,1,1\n0,0,1,1,1",
        "no line for strip 2; .* the last line has no line end: is the file cut off",
    ),
}


@pytest.mark.parametrize("name", FAULTS)
def test_faults_are_named(tmp_path: Path, name: str) -> None:
    text, message = FAULTS[name]
    with pytest.raises(ts.ReadingError, match=message) as caught:
        _read(tmp_path, text)
    assert "readings.csv" in str(caught.value)


def test_columns_that_nothing_is_missing_for_are_passed_over(tmp_path: Path) -> None:
    head = "scan,time_s,strip,v_h,v_l,V_H,v_x,code_k,strips,\n"
    (scan,) = _read(tmp_path, head + "".join(f"0,0,{i},1,1,a,b,c,d,\n" for i in range(3)))
    assert scan.signatures == ("kh", "kl")
    (single,) = _read(tmp_path, "scan,time_s,strip,v_l,note\n" + "".join(f"0,0,{i},1,a\n" for i in range(3)))
    assert single.signatures == ("kl",)


def test_a_file_is_not_called_cut_for_what_is_wrong_before_its_end(tmp_path: Path) -> None:
    whole = "".join(f"1,0,{i},1,1\n" for i in range(3))
    for text in (HEAD + "0,0,0,1,1\n" + whole, HEAD + "0,0,0,1,1\n" + whole.rstrip()):
        with pytest.raises(ts.ReadingError, match="no line for strip 1") as caught:
            _read(tmp_path, text)
        assert "cut off" not in str(caught.value)


def test_electrodes_with_a_misspelt_name(tmp_path: Path) -> None:
    sheet = ts.Sensor(
        construction="crs-crp", strips=3, pitch_mm=1.0, length_mm=10.0, contact_lambda_mm=0.1, strip_base=1
    )
    head = "scan,time_s,strip,v_l_1,v_l_2,v_l_3,v_h_1,vh_2,v_h_3\n"
    with pytest.raises(ts.ReadingError, match="column 'vh_2' is not known, and 'v_h_2' is missing"):
        _read(tmp_path, head, sheet)
    # Counted from 0 where the spec counts from 1: no name is misspelt.
    with pytest.raises(ts.ReadingError, match="column 'v_l_3' is missing: give all 6 electrodes"):
        _read(tmp_path, "scan,time_s,strip,v_l_0,v_l_1,v_l_2,v_h_0,v_h_1,v_h_2\n", sheet)
    with pytest.raises(ts.ReadingError, match="column 'V_L_1' is not known, and 'v_l_1' is missing"):
        _read(tmp_path, head.upper().replace("SCAN,TIME_S,STRIP", "scan,time_s,strip"), sheet)


def test_codes_need_bits(tmp_path: Path) -> None:
    with pytest.raises(ts.ReadingError, match="the spec has no adc_bits; add it, for example adc_bits = 12"):
        _read(tmp_path, "scan,time_s,strip,code\n0,0,1,5\n", METAL)


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(ts.ReadingError, match="no such file"):
        ts.read_readings(tmp_path / "none.csv", CRS)
    with pytest.raises(ts.ReadingError, match="cannot be read"):
        ts.read_readings(tmp_path, CRS)
    (tmp_path / "session.mcap").touch()
    with pytest.raises(ts.ReadingError, match=r"is a recording, .*`tacstrip convert .*session\.mcap -o"):
        ts.read_readings(tmp_path / "session.mcap", CRS)


@given(
    data=st.one_of(
        st.binary(max_size=300), texts(max_size=200).map(lambda t: (HEAD + t).encode(errors="ignore"))
    )
)
@settings(
    derandomize=True,
    max_examples=100,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
def test_any_bytes_give_scans_or_a_clear_error(tmp_path: Path, data: bytes) -> None:
    try:
        scans = _read(tmp_path, data)
    except ts.ReadingError:  # and nothing else
        return
    assert all(len(s.touched) == 3 for s in scans)


@pytest.mark.parametrize("began_s", [1763800000.0, 86400.0, -1.0])
def test_times_from_1970_and_of_long_runs_keep_a_millisecond(tmp_path: Path, began_s: float) -> None:
    sensor = replace(METAL, adc_bits=12)
    given_scans = [ts.Scan(k=np.array([0.5, 0.5, NAN]), time_s=began_s + 0.001 * i) for i in range(3)]
    ts.write_readings(tmp_path / "out.csv", sensor, given_scans)
    source = ReadingsSource(tmp_path / "out.csv", sensor)
    write_csv(tmp_path / "again.csv", source)
    back = [scan.time_s for scan in ts.read_readings(tmp_path / "again.csv", sensor)]
    assert np.subtract(back, began_s) == pytest.approx([0.0, 0.001, 0.002], abs=1e-5)


def test_electrodes_read_by_a_converter_with_wide_codes_come_back(tmp_path: Path) -> None:
    pico = Converter(wide_codes=(512, 1536), widths_lsb=(9.5, 9.0))
    sheet = ts.Sensor(construction="crs-crp", strips=4, pitch_mm=5.0, length_mm=30.0, resistivity_ratio=100.0,
                      adc_bits=12, contact_lambda_mm=0.5, converter=pico)  # fmt: skip
    contact = ts.Contact.polygon([(4, 6), (16, 8), (12, 22)])
    scan = ts.simulate(sheet, contact, electrodes="all")
    ts.write_readings(tmp_path / "r.csv", sheet, [scan])
    for back in (ts.read_readings(tmp_path / "r.csv", sheet)[0], decode(encode(scan, sheet), sheet)):
        assert scan.electrodes is not None
        assert back.electrodes is not None
        np.testing.assert_allclose(back.electrodes, scan.electrodes, atol=1e-8)


def test_times_that_count_from_1970_keep_their_microseconds(tmp_path: Path) -> None:
    sensor = ts.Sensor(construction="crs-m", strips=1, pitch_mm=5.0, length_mm=100.0)
    times = [1763851200.123456 + 2e-6 * i for i in range(3)]
    ts.write_readings(
        tmp_path / "r.csv", sensor, [ts.Scan(k=np.array([0.5]), time_s=time_s) for time_s in times]
    )
    back = ts.read_readings(tmp_path / "r.csv", sensor)
    assert [scan.time_s for scan in back] == pytest.approx(times, rel=0.0, abs=2e-7)
    with pytest.raises(ts.ReadingError, match="there is no scan to write"):
        ts.write_readings(tmp_path / "r.csv", sensor, [])


def test_a_time_of_a_later_strip_is_read_too(tmp_path: Path) -> None:
    sensor = ts.Sensor(construction="crs-m", strips=2, pitch_mm=5.0, length_mm=100.0)
    (tmp_path / "r.csv").write_text("scan,time_s,strip,v_out\n0,0,0,0.5\n0,oops,1,0.5\n")
    with pytest.raises(ts.ReadingError, match="line 3: time_s is 'oops', not a number"):
        ts.read_readings(tmp_path / "r.csv", sensor)


def test_a_single_scan_needs_no_time(tmp_path: Path) -> None:
    sensor = ts.Sensor(construction="crs-crs", strips=2, pitch_mm=5.0, length_mm=50.0)
    file = tmp_path / "readings.csv"
    file.write_text("scan,strip,v_h,v_l\n0,0,0.6,0.3\n0,1,,\n")
    (scan,) = ts.read_readings(file, sensor)
    assert scan.time_s == 0.0
    assert scan.touched.tolist() == [True, False]
    file.write_text("scan,times,strip,v_h,v_l\n0,0,0,0.6,0.3\n0,0,1,,\n")
    with pytest.raises(ts.ReadingError, match="time_s"):  # misspelt: probably meant
        ts.read_readings(file, sensor)
