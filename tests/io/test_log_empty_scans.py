"""Scans in which nothing touches, strips that labels above a table name, and logs in which nothing is untouched."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import tacstrip as ts
from tacstrip.cli import cli
from tacstrip.io.log_import.guess import Proposal, propose
from tacstrip.io.log_import.text import of_text

_SENSOR = ts.Sensor(construction="crs-crs", strips=9, pitch_mm=8.0, length_mm=100.0, vref_volt=5.0)
# The scan after the empty one begins above the strips of the one before: only its time tells them apart.
_TOUCHED = {0.0: (0, 1, 2), 0.1: (1, 2, 3), 0.2: (), 0.3: (4, 5, 6), 0.4: (3, 4, 5)}


def _volts(time: float, strip: int) -> tuple[float, float]:
    return 2.5 + time + 0.01 * strip, 1.5 + time - 0.01 * strip


def _xml(empty: str) -> str:
    scans = []
    for time, strips in _TOUCHED.items():
        inner = "".join(
            f'    <strip nr="{s}" high="{_volts(time, s)[0]:.4f}" low="{_volts(time, s)[1]:.4f}"/>\n'
            for s in strips
        )
        scans.append(f'  <scan time="{time:.3f}">\n{inner}  </scan>\n' if strips else empty)
    return '<?xml version="1.0"?>\n<recording unit="V">\n' + "".join(scans) + "</recording>\n"


def _lines(empty: str) -> str:
    return "".join(
        "".join(
            f"ts=2026-03-01T12:00:0{time:.3f}Z level=info strip={s} "
            f"vh={_volts(time, s)[0]:.4f}V vl={_volts(time, s)[1]:.4f}V\n"
            for s in strips
        )
        or f"ts=2026-03-01T12:00:0{time:.3f}Z level=info {empty}\n"
        for time, strips in _TOUCHED.items()
    )


def _blocks() -> str:
    return "# strip  v_h [V]  v_l [V]\n" + "".join(
        f"# t = {time:.3f} s\n"
        + "".join(f"  {s}  {_volts(time, s)[0]:.4f}  {_volts(time, s)[1]:.4f}\n" for s in strips)
        + "\n\n"
        for time, strips in _TOUCHED.items()
    )


def _json() -> str:
    return "".join(
        json.dumps(
            {"t": t, "strips": [{"id": s, "vh": _volts(t, s)[0], "vl": _volts(t, s)[1]} for s in strips]}
        )
        + "\n"
        for t, strips in _TOUCHED.items()
    )


def _read(text: str, **answers: str) -> Proposal:
    return propose(of_text(text), _SENSOR, {"strip_base": "0", **answers}, frozenset({"vref_volt"}))


@pytest.mark.parametrize(
    "text",
    [
        _xml('  <scan time="0.200">\n  </scan>\n'),
        _xml('  <scan time="0.200"/>\n'),
        _lines('msg="no contact"'),
        _blocks(),
        _json(),
    ],
    ids=["xml", "xml-closed", "lines", "blocks", "json"],
)
def test_an_empty_scan_is_one_at_its_own_time(text: str) -> None:
    found = _read(text).scans
    np.testing.assert_allclose([s.time_s for s in found], [*_TOUCHED], atol=1e-9)
    for scan, (time, strips) in zip(found, _TOUCHED.items(), strict=True):
        assert tuple(np.flatnonzero(np.isfinite(scan.values).all(axis=1))) == strips
        for strip in strips:
            np.testing.assert_allclose(scan.values[strip], _volts(time, strip), atol=1e-4)


@pytest.mark.parametrize("line_s", [0.0, 0.005])
def test_scans_of_other_strips_are_told_apart_by_their_times(line_s: float) -> None:
    touched = {0.0: (0, 1, 2), 0.1: (1, 2, 3), 0.2: (4, 5, 6), 0.3: (3, 4, 5), 0.4: (3, 4)}
    text = "time_s,strip,v_h,v_l\n" + "".join(
        f"{time + line_s * s:.3f},{s},{_volts(time, s)[0]:.3f},{_volts(time, s)[1]:.3f}\n"
        for time, strips in touched.items()
        for s in strips
    )
    found = _read(text).scans
    assert [tuple(np.flatnonzero(np.isfinite(s.values[:, 0]))) for s in found] == [*touched.values()]


def test_a_time_without_readings_and_without_a_word_of_no_contact_is_told() -> None:
    text = _lines("msg=restarted")
    table = of_text(text)
    line = next(n for n, said in enumerate(text.splitlines(), 1) if "restarted" in said)
    assert line in table.broken or any(f"line(s) {line}" in said for said in table.remarks)


def test_a_block_that_may_be_cut_is_broken() -> None:
    text = _blocks() + "# t = 0.500 s\n"
    assert of_text(text).broken == (len(text.splitlines()),)


def test_labels_above_a_table_tell_the_strips_of_numbered_columns() -> None:
    strips = [5, 4, 3, 2, 1, 0]
    labels = [f"Label,{101 + n},Strip {s + 1} V_high" for n, s in enumerate(strips)]
    labels += [f"Label,{107 + n},Strip {s + 1} V_low" for n, s in enumerate(strips)]
    head = "Scan,Elapsed (s)," + ",".join(f"{101 + n} (VDC)" for n in range(12))
    rows = [
        f"{n + 1},{0.5 * n:.3f}," + ",".join(f"{_volts(n / 9, s)[c]:.6E}" for c in (0, 1) for s in strips)
        for n in range(5)
    ]
    text = "\n".join(["Instrument,DAQ6510,SN 04511234", *labels, "", head, *rows]) + "\n"
    sensor = ts.Sensor(construction="crs-crs", strips=6, pitch_mm=8.0, length_mm=100.0, vref_volt=5.0)
    found = propose(of_text(text), sensor, {"time_unit": "s"}, frozenset({"vref_volt"})).scans
    for n, scan in enumerate(found):
        np.testing.assert_allclose(scan.values, [_volts(n / 9, s) for s in range(6)], atol=1e-5)


@pytest.mark.parametrize("untouched", [False, True])
def test_a_log_in_which_nothing_is_untouched_gets_a_warning(tmp_path: Path, untouched: bool) -> None:
    rng = np.random.default_rng(5)
    lines = ["time_s,strip,v_h,v_l"]
    for scan in range(4):
        for strip in range(9):
            low, high = sorted(rng.uniform(0.8, 4.0, 2))
            none = untouched and scan == 2 and strip == 8
            lines.append(f"{scan / 10},{strip}," + ("," if none else f"{high:.3f},{low:.3f}"))
    (tmp_path / "e.csv").write_text("\n".join(lines) + "\n")
    _SENSOR.save(tmp_path / "s.toml")
    called = ["import", str(tmp_path / "e.csv"), str(tmp_path / "s.toml"), "-o", str(tmp_path / "o.csv")]
    result = CliRunner().invoke(cli, called)
    assert result.exit_code == 0, result.output
    said = "every strip has a reading" in result.output and "set rest_volt and touch_volt" in result.output
    assert said is not untouched


def test_a_vref_beside_the_unit_millivolts_is_in_millivolts() -> None:
    frames = [
        {"t_us": 100000 * n, "high": [2500.5 + n + s for s in range(9)], "low": [1500.5 + n] * 9}
        for n in range(4)
    ]
    log = {"meta": {"units": "mV", "vref": 5000}, "frames": frames}
    assert _read(json.dumps(log, indent=1)).mapping.unit == "mV"


def test_analog_read_in_a_comment_tells_codes() -> None:
    rows = [",".join(f"H{s}:{2500 + 9 * n + s},L{s}:{1400 + 7 * n + s}" for s in range(9)) for n in range(5)]
    text = "# sampled at 50 Hz, analogRead 12 bit\n" + "\n".join(rows) + "\n"
    mapping = _read(text).mapping
    assert (mapping.unit, mapping.adc_bits) == ("code", 12)
