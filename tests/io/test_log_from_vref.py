"""Logs of readings that are measured from Vref down."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import tacstrip as ts
from tacstrip.cli import cli

TRIANGLE = ts.Contact.polygon([(6, 10), (34, 25), (12, 70)])


def _log(folder: Path, construction: str, factor: float = 1.0) -> tuple[ts.Sensor, list[ts.Scan]]:
    """Write a spec, and a log of its readings as Vref less the voltage; return what was read."""
    sensor = ts.Sensor(
        construction=construction, strips=8, pitch_mm=5.0, length_mm=80.0, vref_volt=5.0, adc_bits=12
    )
    sensor.save(folder / "s.toml")
    scans = [ts.simulate(sensor, TRIANGLE.moved(0.2 * n, 0.4 * n), time_s=0.1 * n) for n in range(4)]
    names = scans[0].signatures
    columns = {"kh": "v_h", "kl": "v_l", "k": "v_out"}
    lines = [",".join(("t", "strip", *(columns[n] for n in names)))]
    for scan in scans:
        for strip in range(8):
            values = [factor * (5.0 - 5.0 * scan[n][strip]) for n in names]
            lines.append(
                f"{scan.time_s:.1f},{strip}," + ",".join("" if np.isnan(v) else f"{v:.6f}" for v in values)
            )
    (folder / "log.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return sensor, scans


def _import(folder: Path, *words: str) -> str:
    done = CliRunner().invoke(
        cli, ["import", str(folder / "log.csv"), str(folder / "s.toml"), "-o", str(folder / "r.csv"), *words]
    )
    return f"{done.output}{done.exception if isinstance(done.exception, ts.TacstripError) else ''}"


def test_the_question_names_both_and_an_answer_turns_them_right(tmp_path: Path) -> None:
    sensor, scans = _log(tmp_path, "crs-crs")
    said = _import(tmp_path)
    assert "are the columns exchanged, or all readings measured from Vref down?" in said
    assert "--answer exchanged=from_vref" in said
    _import(tmp_path, "--answer", "exchanged=from_vref")
    for read, made in zip(ts.read_readings(tmp_path / "r.csv", sensor), scans, strict=True):
        np.testing.assert_allclose(read["kh"], made["kh"], atol=1e-6)
        np.testing.assert_allclose(read["kl"], made["kl"], atol=1e-6)
    (tmp_path / "r.csv").unlink()  # the mapping says it for other logs of the form
    done = CliRunner().invoke(
        cli, ["import", str(tmp_path / "log.csv"), str(tmp_path / "s.toml"), "-o", str(tmp_path / "r.csv"),
              "--mapping", str(tmp_path / "r.mapping.toml")],
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    np.testing.assert_allclose(
        ts.read_readings(tmp_path / "r.csv", sensor)[0]["kh"], scans[0]["kh"], atol=1e-6
    )


@pytest.mark.parametrize("factor", [1.0, 1000.0])
def test_of_one_channel_nothing_tells_and_the_answer_is_taken(tmp_path: Path, factor: float) -> None:
    sensor, scans = _log(tmp_path, "crs-m", factor)
    unit = "V" if factor == 1.0 else "mV"
    _import(tmp_path, "--answer", "exchanged=from_vref", "--answer", f"unit={unit}")
    for read, made in zip(ts.read_readings(tmp_path / "r.csv", sensor), scans, strict=True):
        np.testing.assert_allclose(read["k"], made["k"], atol=1e-6)


def test_readings_of_own_form_are_told_of_both(tmp_path: Path) -> None:
    sensor, scans = _log(tmp_path, "crs-crs")
    turned = [ts.Scan(kh=1.0 - s["kh"], kl=1.0 - s["kl"], time_s=s.time_s) for s in scans]
    ts.write_readings(tmp_path / "t.csv", sensor, turned)
    with pytest.warns(ts.ReadingWarning, match="Or are all readings measured from Vref down"):
        ts.read_readings(tmp_path / "t.csv", sensor)
