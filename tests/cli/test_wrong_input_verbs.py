"""What a new user gives by mistake gets one sentence with the way on."""

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from mcap.writer import Writer

import tacstrip as ts
from tacstrip.cli import cli
from tacstrip.sensor.converter import Converter

SENSOR = ts.Sensor(construction="crs-crs", strips=10, pitch_mm=10.0, length_mm=100.0)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    SENSOR.save("s.toml")
    Path("o.wkt").write_text("POLYGON ((22 18, 70 34, 62 72, 30 66, 22 18))\n", encoding="utf-8")
    ts.write_readings("r.csv", SENSOR, [ts.simulate(SENSOR, ts.Contact.from_wkt(Path("o.wkt").read_text()))])
    Path("log.csv").write_text("time,ch0,ch1\n0,1.2,2\n", encoding="utf-8")
    with Path("other.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel(
            "/skin", "json", writer.register_schema("skin", "jsonschema", b"{}")
        )
        writer.add_message(channel, 0, b'{"t": 0}', 0)
        writer.finish()  # type: ignore[no-untyped-call]
    Path("cm.toml").write_text(Path("s.toml").read_text().replace("length_mm = 100.0", "length_mm = 10.0"))
    return tmp_path


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (
            "reconstruct r.csv s.toml",
            "where the sensor's spec (.toml) belongs: tacstrip reconstruct SENSOR READINGS",
        ),
        ("reconstruct s.toml o.wkt", "o.wkt: is a contact, not readings"),
        ("reconstruct s.toml log.csv", "`tacstrip import LOG SENSOR -o READINGS`"),
        ("replay r.csv", "`tacstrip record SENSOR READINGS -o FILE.mcap` makes one"),
        (
            "reconstruct r.csv",
            "Missing argument 'READINGS'. For example: tacstrip reconstruct sensor.toml readings.csv",
        ),
        ("import log.csv", "For example: tacstrip import bench.txt sensor.toml -o readings.csv"),
        ("import other.mcap -o x.csv", "mcap cat --json other.mcap > other.jsonl"),
        (
            "live other.mcap",
            "not a recording of tacstrip; `tacstrip import other.mcap SENSOR -o readings.csv`",
        ),
        ("live log.jsonl", "or .csv. A log of another form? `tacstrip import LOG SENSOR -o READINGS`"),
        ("track r.csv", "tacstrip track sensor.toml r.csv (`tacstrip init` begins one)"),
        ("doctor r.csv", "--sensor sensor.toml (`tacstrip init` begins one)"),
        ("convert r.csv -o x.npz", "name its spec before it: sensor.toml r.csv (`tacstrip init` begins one)"),
        ("recontruct s.toml r.csv", "Did you mean 'reconstruct'?"),
        (
            "press fingertip plane --pose 0 0 20 -1 0 -1 --depth 9 -o p.csv",
            "the object sinks 9 mm into a skin of 3 mm: press less",
        ),
    ],
)
def test_what_cannot_be_is_answered_by_what_can(folder: Path, words: str, says: str) -> None:
    done = CliRunner().invoke(cli, words.split())
    assert says in done.output + str(done.exception)
    assert done.exit_code == 2 or isinstance(done.exception, ts.TacstripError)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("simulate s.toml o.wkt -o q.csv --positional 0.5", "--positional 0.5: is 50 % of Vref"),
        ("reconstruct cm.toml r.csv -o x.geojson", "write length_mm = 100"),
    ],
)
def test_what_is_hardly_meant_is_warned_of(folder: Path, words: str, says: str) -> None:
    done = CliRunner().invoke(cli, words.split())
    assert done.exit_code == 0
    assert says in done.output


def test_plans_ask_for_places_that_can_be_set(folder: Path) -> None:
    done = CliRunner().invoke(cli, ["calibrate", "s.toml", "--plan", "-o", "plan.csv"])
    assert done.exit_code == 0
    rows = [line.split(",")[1:3] for line in Path("plan.csv").read_text().splitlines()[1:]]
    places = 10.0 * np.array(rows, dtype=float)
    assert len(places)
    np.testing.assert_allclose(places, np.round(places), atol=1e-6)


def test_tiny_objects_that_no_strip_feels_are_counted(folder: Path) -> None:
    spec = 'construction = "crs-crs"\nstrips = 10\npitch_mm = 10.0\nlength_mm = 100.0\n'
    Path("study.toml").write_text(f"[sensor]\n{spec}[shapes]\nn = 40\nsize_mm = 4.0\n", encoding="utf-8")
    done = CliRunner().invoke(cli, ["generate", "study.toml", "--out", "data"])
    assert "of the first 40 scans have an object and touch no strip" in done.output


def test_simulated_codes_are_as_wide_as_the_spec_says() -> None:
    """Every reading within the wide code reads as its middle."""
    pico = Converter(wide_codes=(512,), widths_lsb=(40.0,))
    sensor = ts.Sensor(
        construction="crs-crs", strips=200, pitch_mm=1.0, length_mm=100.0, adc_bits=12, converter=pico
    )
    ideal = ts.Sensor(construction="crs-crs", strips=200, pitch_mm=1.0, length_mm=100.0)
    contact = ts.Contact.polygon([(2, 2), (198, 2), (198, 98)])
    truth = ts.simulate(ideal, contact)["kh"]
    for read in (ts.simulate(sensor, contact)["kh"], ts.simulate_many(sensor, [contact])["kh"][0]):
        off = 4095.0 * np.abs(read - truth)
        inside = 4095.0 * np.abs(truth - pico.correct(512 / 4095, 12)) < 19.0
        assert inside.any()
        assert np.ptp(read[inside]) < 1e-12
        assert np.nanmax(off[~inside]) < 1.5 < off[inside].max() < 20.5
