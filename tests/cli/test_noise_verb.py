"""`tacstrip noise`, from a still press to regions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

import tacstrip as ts
from noise_generator import Rubber
from tacstrip.cli import cli
from tacstrip.cli.reconstruct import _only
from tacstrip.diagnose.log import Log

SENSOR = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0, adc_bits=12)
CONTACT = ts.Contact.polygon([(14.0, 36.0), (62.0, 21.0), (83.0, 58.0), (40.0, 80.0)])


def run(*words: object) -> Result:
    return CliRunner().invoke(cli, [str(w) for w in words])


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "sensor.toml").write_text("# mine\n" + SENSOR.to_toml())
    scans = Rubber(white=0.004, lorentz=0.003, lorentz_s=5.0).scans(
        np.random.default_rng(0), SENSOR, CONTACT, 200, 0.3
    )
    ts.write_readings(tmp_path / "still.csv", SENSOR, scans)
    (tmp_path / "contact.wkt").write_text("POLYGON ((14 36, 62 21, 83 58, 40 80, 14 36))")
    return tmp_path


def test_a_still_press_becomes_a_table_that_everything_takes(folder: Path) -> None:
    spec, picture = folder / "sensor.toml", folder / "allan.png"
    done = run("noise", folder / "still.csv", "--write", spec, "--plot", picture)
    assert done.exit_code == 0, done.output
    assert float(done.output.split("White noise: ")[1].split(" % of Vref")[0]) == pytest.approx(0.4, rel=0.1)
    assert "A mean of 64 scan(s) is off by" in done.output
    assert "Cannot tell a common offset of all channels" in done.output
    assert picture.stat().st_size > 5000
    assert "replaces" not in done.output
    text = spec.read_text()
    assert text.startswith("# mine\n")
    assert text.count("[noise]") == 1
    noise = ts.Sensor.load(spec).noise
    assert noise is not None
    assert noise.white == pytest.approx(0.004, rel=0.1)
    again = run("noise", folder / "still.csv", spec, "-o", folder / "new.toml", "--vertices", 4)
    assert again.exit_code == 0, again.output
    assert (folder / "new.toml").read_text().count("[noise]") == 1
    twice = run("noise", folder / "still.csv", "--write", spec, "--vertices", 4)
    assert "sensor.toml written; its [noise] table replaces the one that was there" in twice.output

    made = run(
        "simulate",
        spec,
        folder / "contact.wkt",
        "-o",
        folder / "more.csv",
        "--noisy",
        "--still",
        32,
        "--rate",
        3,
    )
    assert made.exit_code == 0, made.output
    log = Log.of_scans(SENSOR, ts.read_readings(folder / "more.csv", SENSOR))
    assert np.nanstd(np.diff(log.k["kh"], axis=0)) / np.sqrt(2.0) == pytest.approx(0.004, rel=0.25)
    found = run("reconstruct", spec, folder / "more.csv", "--average", 16, "-o", folder / "found.geojson")
    assert "2 scan(s), 2 object(s)" in found.output
    found = run("reconstruct", spec, folder / "more.csv", "--average", 20, "-o", folder / "again.geojson")
    assert "the last 12 of 32 scans are too few for a mean" in found.output
    bound = run("limits", spec, folder / "contact.wkt", "--grid", 2)
    assert bound.exit_code == 0, bound.output


def test_what_cannot_be_told_is_exit_code_1_and_writes_nothing(folder: Path) -> None:
    moving = [
        ts.simulate(SENSOR, CONTACT.moved(0.0, 0.15 * i), ts.Noise(white=0.003), rng=i, time_s=0.5 * i)
        for i in range(120)
    ]
    ts.write_readings(folder / "moving.csv", SENSOR, moving)
    before = (folder / "sensor.toml").read_text()
    done = run("noise", folder / "moving.csv", "--write", folder / "sensor.toml")
    assert done.exit_code == 1
    assert "the contact moves, or creeps" in done.output
    assert (folder / "sensor.toml").read_text() == before


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("noise", "{}/still.csv"), "/still.csv sensor.toml"),
        (("noise", "{}/still.csv", "{}/sensor.toml", "--plot", "{}/a.txt"), "a picture is a file"),
        (("noise", "{}/still.csv", "{}/sensor.toml", "-o", "{}/still.csv"), "would be written over"),
        (("reconstruct", "{}/sensor.toml", "{}/still.csv", "--average", "999"), "--average 999"),
        (("simulate", "{}/sensor.toml", "{}/contact.wkt", "-o", "{}/a.csv", "--noisy"), "has no [noise] table"),
        (("simulate", "{}/sensor.toml", "{}/contact.wkt", "-o", "{}/a.csv", "--rate", "3"), "--rate needs"),
    ],
)  # fmt: skip
def test_wrong_options_get_a_sentence(folder: Path, words: tuple[str, ...], message: str) -> None:
    done = run(*(w.format(folder) for w in words))
    assert message in str(done.exception)


def test_one_signature_of_a_mean_still_tells_that_the_contact_moved() -> None:
    scans = [ts.simulate(SENSOR, CONTACT.moved(0.0, 2.0 * i), time_s=0.1 * i) for i in range(8)]
    mean = ts.Scan.mean(scans)
    one = _only(mean, "kh")
    assert one.signatures == ("kh",)
    assert one.moved == mean.moved > 0.0
    assert (one.averaged, one.span_s) == (mean.averaged, mean.span_s)
