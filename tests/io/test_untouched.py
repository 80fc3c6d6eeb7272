"""Untouched strips with readings and no rest level in the spec: every verb tells, and is silent on healthy readings."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import tacstrip as ts
from tacstrip.arrays import FloatArray
from tacstrip.cli import cli
from tacstrip.contact.noise import add_reading_errors
from tacstrip.diagnose.doctor import diagnose
from tacstrip.diagnose.log import Log
from tacstrip.sensor import apply_calibration
from tacstrip.sensor.constructions import CONSTRUCTIONS
from tacstrip.sensor.rest_level import rest_hint
from tacstrip.simulation import readings
from tacstrip.stream import encode

FIX = re.compile(r"set rest_volt = ([\d.e-]+) and touch_volt = ([\d.e-]+) in the spec")
FLAT = [name for name, kind in CONSTRUCTIONS.items() if kind.closed_form]


def _sensor(name: str, strips: int = 24) -> ts.Sensor:
    radius = 20.0 * strips / 24.0 if CONSTRUCTIONS[name].cylindrical else None
    return ts.Sensor(
        construction=name, strips=strips, pitch_mm=4.0, length_mm=120.0, radius_mm=radius, adc_bits=12
    )


def _outline(random: np.random.Generator) -> FloatArray:
    """Draw a convex polygon that fills the unit square."""
    while True:
        angle = np.sort(random.uniform(0.0, 2.0 * np.pi, random.integers(3, 9)))
        if np.diff(angle, append=angle[0] + 2.0 * np.pi).max() < 0.95 * np.pi:
            corners = np.stack([np.cos(angle), np.sin(angle)], axis=1)
            return np.asarray((corners - corners.min(axis=0)) / np.ptp(corners, axis=0))


def _read(
    sensor: ts.Sensor, contacts: list[ts.Contact], half: float, random: np.random.Generator, level: float
) -> dict[str, FloatArray]:
    """Return readings (scans, strips), `level` where nothing touches."""
    k = readings(replace(sensor, adc_bits=None), *ts.footprint(sensor, contacts))
    noise = ts.Noise(positional=half)
    return {
        n: np.clip(add_reading_errors(np.where(np.isnan(v), level, v), noise, random), 0.0, 1.0)
        for n, v in k.items()
    }


def _small(random: np.random.Generator, sensor: ts.Sensor) -> ts.Contact:
    size = [random.uniform(0.3, 0.6) * sensor.width_mm, random.uniform(20.0, 60.0)]
    place = (0.5 * sensor.width_mm, random.uniform(40.0, 80.0))
    return ts.Contact.polygon(_outline(random) * size).placed(*place).turned(random.uniform(0.0, 1.0))


@pytest.mark.parametrize(
    ("name", "level"),
    [("crs-crs", 0.0), ("crs-crs", 0.37), ("crs-m", 0.37), ("crs-m", 1.0), ("cyl-crs-m", 0.37)],
)
def test_a_shape_of_untouched_strips_is_doubted_and_says_what_to_do(name: str, level: float) -> None:
    random, sensor = np.random.default_rng(1), _sensor(name)
    advised = good = 0
    for _ in range(6):
        k = _read(sensor, [_small(random, sensor)], 0.002, random, level)
        found = ts.fit_polygon(
            ts.Scan(k["kh"][0], k["kl"][0]) if len(k) > 1 else ts.Scan(k=k["k"][0]),
            sensor,
            assessment="fast",
        )
        assert "rest_volt and touch_volt" in found.advice or FIX.search(found.advice)
        assert found.status not in ("ok", "likely")
        if told := FIX.search(found.advice):
            advised += 1
            mended = replace(sensor, rest_volt=float(told[1]), touch_volt=float(told[2]))
            assert float(told[1]) == pytest.approx(5.0 * level, abs=0.02)
            right = apply_calibration(mended, {n: v[0] for n, v in k.items()})
            scan = ts.Scan(right.get("kh"), right.get("kl"), right.get("k"))
            found = ts.fit_polygon(scan, mended, assessment="fast")
            good += found.status in ("ok", "likely", "doubtful") and not scan.touched.all()
    assert advised >= 5
    assert good == advised


def test_contacts_over_all_strips_are_not_taken_for_untouched_ones() -> None:
    """Pressed and dragged, from 6 to 100 strips, with all noise profiles: 1 false alarm in 300 at most."""
    random = np.random.default_rng(2)
    count = alarms = 0
    while count < 600:
        sensor = _sensor(FLAT[count % len(FLAT)], int(random.choice([6, 8, 10, 16, 24, 100])))
        wide, high = random.uniform(1.0, 1.6) * sensor.width_mm, random.uniform(0.05, 0.9) * sensor.length_mm
        corners = _outline(random) * [wide + 1e-6, high] + [(sensor.width_mm - wide) * random.uniform(), 0.0]
        contact = ts.Contact.polygon(corners).moved(
            0.0, random.uniform(0.0, 0.9 * sensor.length_mm - high / 2)
        )
        if count % 2:
            contact = ts.Contact.polygon(
                [
                    (-1.0, 9.0),
                    (sensor.width_mm + 1.0, 9.0),
                    (sensor.width_mm + 1.0, 9.0 + high),
                    (-1.0, 9.0 + high),
                ]
            )
        steps = random.integers(1, 4)
        drag = random.uniform(-0.1, 0.1, 2) * [sensor.width_mm, sensor.length_mm]
        try:
            places = [contact.moved(*(drag * i)) for i in range(steps)]
            k = _read(sensor, places, float(random.choice([0.0, 0.001, 0.005, 0.01])), random, np.nan)
        except ts.ContactError:  # dragged off
            continue
        count += 1
        alarms += bool(rest_hint(sensor, k))
    assert alarms <= 2


def test_a_good_shape_over_all_strips_stays_good() -> None:
    sensor = _sensor("crs-crs")
    w = sensor.width_mm
    contact = ts.Contact.polygon([(-1, 20), (w / 2, 12), (w + 1, 25), (w + 1, 70), (w / 3, 95), (-1, 60)])
    assert ts.fit_polygon(ts.simulate(sensor, contact), sensor).status == "ok"


def test_round_and_pointed_ones_over_all_strips_stay_good() -> None:
    """Of what is round advice names two objects, too; a tip's first strips read nearly alike."""
    sensor, noise = _sensor("crs-crs", 16), ts.Noise(positional=0.002)
    w, angle = sensor.width_mm, np.linspace(0.0, 2.0 * np.pi, 96, endpoint=False)
    disc = np.column_stack([0.5 * w + 0.6 * w * np.cos(angle), 50.0 + 35.0 * np.sin(angle)])
    tip = np.array([(0.0, 20.0), (w, 20.0 + 0.7 * sensor.length_mm), (w, 20.0 + 0.16 * sensor.length_mm)])
    for outline in (disc, tip):
        scan = ts.simulate(sensor, ts.Contact.polygon(outline), noise, rng=0)
        found = ts.fit_polygon(scan, sensor, noise, assessment="fast")
        assert (found.status, "rest_volt" in found.advice) == ("ok", False)


def test_a_wrong_rest_level_is_told_too() -> None:
    random = np.random.default_rng(3)
    sensor = replace(_sensor("crs-crs"), rest_volt=0.0, touch_volt=0.05)
    k = _read(sensor, [_small(random, sensor)], 0.002, random, 0.5)
    assert "in the spec in place of 0 and 0.05" in rest_hint(sensor, k)
    right = replace(sensor, rest_volt=2.5, touch_volt=0.05)
    assert not rest_hint(right, apply_calibration(right, k))


def test_one_slip_among_presses_is_no_rest_level() -> None:
    random, sensor = np.random.default_rng(5), _sensor("crs-m", 8)
    l_mm = np.repeat([[20.0], [60.0], [100.0], [40.0], [80.0], [30.0]], 8, axis=1)
    k = ts.signatures(sensor, l_mm, l_mm)["k"] + 0.001 * random.normal(size=l_mm.shape)
    k[2, 4] -= 0.2
    assert not rest_hint(sensor, {"k": k}, pressed=True)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give a folder with readings, a recording and runs; of healthy ones see test_every_verb_tells.py."""
    folder, random, sensor = (
        tmp_path_factory.mktemp("verbs"),
        np.random.default_rng(4),
        _sensor("crs-crs", 12),
    )
    sensor.save(folder / "s.toml")
    contact = _small(random, sensor)
    places = [contact.moved(0.0, 0.5 * i) for i in range(10)]
    k = _read(sensor, places, 0.001, random, 0.3)
    scans = [
        ts.Scan(kh=h, kl=l, time_s=0.01 * i) for i, (h, l) in enumerate(zip(k["kh"], k["kl"], strict=True))
    ]
    ts.write_readings(folder / "r.csv", sensor, scans)
    with ts.Recorder(folder / "r.mcap", sensor, ("kh", "kl"), 0) as recorder:
        for number, scan in enumerate(scans):
            recorder.add(encode(scan, sensor, number))
    # The block reaches over some strips only, and all were written down.
    across = [[(11.0, y), (38.0, y), (38.0, y + 30.0), (11.0, y + 30.0)] for y in np.linspace(5.0, 80.0, 8)]
    runs = _read(sensor, [ts.Contact.polygon(c) for c in across], 0.001, random, 0.3)
    with (folder / "runs.csv").open("w") as file:
        file.write("strip,l_mm,w_mm,v_h,v_l\n")
        for i, corners in enumerate(across):
            for strip in range(12):
                volts = ",".join(f"{5.0 * runs[n][i, strip]:.6f}" for n in ("kh", "kl"))
                file.write(f"{strip},{corners[0][1]},30,{volts}\n")
    return folder


VERBS = [
    "reconstruct s.toml r.csv --method profile",
    "record s.toml r.csv -o a.mcap --force",
    "record r.mcap -o a.mcap --force",
    "convert r.mcap -o a.csv --force",
    "convert s.toml r.csv -o a.mcap --force",
    "replay r.mcap --fast",
    "calibrate s.toml runs.csv --model mean -o c.toml",
    "live s.toml r.csv --no-view --method profile --speed 100",
    "live r.mcap --no-view --method profile --speed 100",
]


@pytest.mark.parametrize("words", VERBS)
def test_every_verb_that_takes_readings_tells(
    files: Path, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(files)
    said = CliRunner().invoke(cli, words.split()).stderr
    file = next(w for w in words.split() if w.startswith("r") and "." in w)
    told = re.search(
        rf"Warning: {file}: every strip has a reading.* set rest_volt = ([\d.]+) and touch_volt", said
    )
    assert told, said
    assert float(told[1]) == pytest.approx(1.5, abs=0.02)


def test_the_doctor_says_the_same(files: Path) -> None:
    sensor = ts.Sensor.load(files / "s.toml")
    with pytest.warns(ts.ReadingWarning) as told:
        scans = ts.read_readings(files / "r.csv", sensor)
    assert FIX.search(str(told[0].message))
    report = diagnose(Log.of_scans(sensor, scans))
    (note,) = (n for n in report.notes if n.fault == "rest-level")
    assert FIX.search(note.evidence)
    scan = ts.simulate(sensor, ts.Contact.polygon([(9.0, 30.0), (31.0, 22.0), (36.0, 60.0)]))
    assert "rest-level" not in {n.fault for n in diagnose(Log.of_scans(sensor, [scan] * 10)).notes}
