"""The doctor on units and recordings of the workshop, which are made apart from the package's models."""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import tacstrip as ts
from studies.checkup import exercise, said
from studies.faults import faulty_log
from studies.workshop import bench
from tacstrip.arrays import FloatArray
from tacstrip.contact.noise import Noise
from tacstrip.diagnose import Log, diagnose, read_log
from tacstrip.io.readings import write_readings
from tacstrip.view.watch import Verdicts, watch

METAL = ts.Sensor(construction="crs-m", strips=12, pitch_mm=6.5, length_mm=250.0, adc_bits=12)


def _log(sensor: ts.Sensor = METAL, scans: int = 300) -> Log:
    contacts = exercise(sensor, np.random.default_rng(5), scans)
    return faulty_log(sensor, contacts, noise=Noise(positional=0.002), rate_hertz=220.0)


@pytest.mark.parametrize("seed", range(620, 628))
def test_nothing_is_named_on_units_as_built(seed: int) -> None:
    """Cold joints, soft edges that correlate, 1/f wander that strips share, strays, offsets and gains of strips."""
    assert said(diagnose(bench(seed).log)) == []


@pytest.mark.usefixtures("no_outline")
@pytest.mark.parametrize("level", [0.0, 1.0])
@pytest.mark.parametrize("share", [0.15, 0.45])
def test_an_intermittent_contact(level: float, share: float) -> None:
    log = _log()
    rng = np.random.default_rng(3)
    out = np.repeat(rng.random(60) < share, 5)
    k = log.raw["k"].copy()
    k[:, 6] = np.where(out & np.isfinite(k[:, 6]), level, k[:, 6])
    (found,) = diagnose(Log.of(METAL, log.time_s, {"k": k})).findings
    assert (found.fault, found.strips) == ("intermittent", (6,))
    assert found.numbers["share"] == pytest.approx(share, abs=0.2)


@pytest.mark.usefixtures("no_outline")
def test_a_contact_that_comes_and_goes_a_few_times() -> None:
    """From scan to scan, on ground, while the neighbours stay: once is a question; before, both were missed."""
    log = _log(scans=450)
    k = log.raw["k"].copy()
    beside = np.stack([k[:, 5], k[:, 7]])
    calm = (np.abs(k[:, 6] - beside) < 0.1).all(axis=0) & (k[:, 6] > 0.35)
    calm[1:] &= (np.abs(np.diff(beside, axis=1)) < 0.045).all(axis=0)
    runs = [i for i in range(1, 446) if calm[i - 1 : i + 3].all()]
    k[runs[0] : runs[0] + 2, 6] = 0.0
    once = diagnose(Log.of(METAL, log.time_s, {"k": k}))
    assert once.healthy
    assert [(q.causes, q.strips) for q in once.questions] == [(("intermittent",), (6,))]
    for start in (runs[len(runs) // 2], runs[-1]):
        k[start : start + 2, 6] = 0.0
    assert said(diagnose(Log.of(METAL, log.time_s, {"k": k}))) == [("intermittent", (6,))]


@pytest.mark.usefixtures("no_outline")
def test_a_strip_that_reads_a_free_wires_level_in_one_visit_is_asked_about() -> None:
    """Higher up than where it reads well, as a cut strip does; the neighbours move past that level meanwhile."""
    log = _log()
    k = log.raw["k"].copy()
    line = 0.5 * (k[:, 0] + k[:, 2])
    far = np.flatnonzero(np.isfinite(k[:, 1]) & (line > np.nanquantile(line, 0.75)))
    visit = max(np.split(far, np.flatnonzero(np.diff(far) > 1) + 1), key=lambda v: np.ptp(line[v]))
    assert len(visit) >= 8
    assert np.ptp(line[visit]) > 0.1
    k[visit, 1] = 0.0
    report = diagnose(Log.of(METAL, log.time_s, {"k": k}))
    assert report.healthy
    assert [(q.causes, q.strips) for q in report.questions] == [(("open-strip", "intermittent"), (1,))]


@pytest.mark.usefixtures("no_outline")
def test_a_bridge_shows_where_a_contact_ends_on_it() -> None:
    """A strip that nothing touches reads the bridge's height through the next one: before, most were missed."""
    log, strip = _log(), 5
    k = log.raw["k"].copy()
    pair = k[:, [strip, strip + 1]]
    fed = np.isnan(pair) & np.isfinite(pair[:, ::-1])
    k[:, [strip, strip + 1]] = np.where(fed, [0.31, 0.33], pair)
    report = diagnose(Log.of(METAL, log.time_s, {"k": k}))
    assert said(report) == [("short", (strip, strip + 1))]
    assert report.findings[0].numbers["level"] == pytest.approx(0.32, abs=0.01)


@pytest.mark.usefixtures("no_outline")
def test_a_sensor_that_reads_pressure_is_called_that() -> None:
    """A bell across the strips that grows and fades with each press: before, strips were called open."""
    x = np.arange(16.0)
    readings: list[FloatArray] = []
    for press in range(30):
        bell = np.exp(-0.5 * ((x - 3.0 - 10.0 * (press * 0.618 % 1.0)) / 2.0) ** 2)
        forces = bell * np.array([0.3, 0.7, 1.0, 1.0, 0.9, 0.6, 0.3, 0.0])[:, None]
        readings += list(np.where(forces > 0.06, 0.8 * forces, np.nan))
    sensor = replace(METAL, strips=16)
    log = Log.of(sensor, 0.02 * np.arange(float(len(readings))), {"k": np.asarray(readings, np.float64)})
    assert said(diagnose(log)) == [("pressure", ())]


@pytest.mark.usefixtures("no_outline")
@pytest.mark.parametrize("at", [0, 5])
def test_a_bridge_of_a_pair_at_the_edge_and_within(at: int) -> None:
    seed = 7 if at == 0 else 4
    unit = bench(seed, "short-edge" if at == 0 else "short", "exercise")
    report = diagnose(unit.log)
    if at == 0:  # by one quarter of the recording alone
        assert (("short",), unit.strips) in {(q.causes, q.strips) for q in report.questions}
    else:
        assert ("short", unit.strips) in said(report)


def test_drift_of_a_hundredth_and_slow_wander_at_rest() -> None:
    """Of a strip that rests, while others are pressed; what all strips share is neither."""
    rng = np.random.default_rng(1)
    sensor = replace(METAL, rest_volt=0.5, touch_volt=0.2)
    k = 0.1 + 0.002 * rng.normal(size=(400, 12)) + 0.01 * np.linspace(0.0, 1.0, 400)[:, None]
    k[np.arange(400) % 20 < 8, 1:6] += 0.4
    time_s = np.arange(400) / 100.0
    assert said(diagnose(Log.of(sensor, time_s, {"k": k}))) == []
    for fault, change in (
        ("drift", 0.01 * np.linspace(0.0, 1.0, 400)),
        ("wander", 0.015 * np.sin(np.linspace(0.0, 15.0, 400))),
    ):
        ill = k.copy()
        ill[:, 9] += change
        assert said(diagnose(Log.of(sensor, time_s, {"k": ill}))) == [(fault, (9,))]


def dragged_off_both_ends(scans: int = 600) -> Log:
    body = ts.Contact.polygon([(0, 0), (34, 8), (30, 70), (4, 60)])
    share = np.linspace(0.0, 1.0, scans)
    across, along = (np.abs(2.0 * ((n * share + s) % 1.0) - 1.0) for n, s in ((3.0, 0.2), (5.0, 0.1)))
    turn = 0.4 * np.sin(np.linspace(0.0, 25.0, scans))
    contacts = [
        body.turned(float(a)).placed(float(98.0 * x - 10.0), float(290.0 * y - 20.0))
        for a, x, y in zip(turn, across, along, strict=True)
    ]
    return faulty_log(METAL, contacts, noise=Noise(positional=0.002), rate_hertz=40.0)


def test_drift_wander_and_the_reference_stand_out_of_shape_and_offsets() -> None:
    """Under a contact, and at rest where a contact at the ground end passes for none: before, none of these."""
    log = dragged_off_both_ends()
    rng = np.random.default_rng(2)
    time, offsets = np.linspace(0.0, 1.0, 600), 0.02 * rng.uniform(-1.0, 1.0, 12)

    def named(k: FloatArray, sensor: ts.Sensor = METAL) -> list[tuple[str, tuple[int, ...]]]:
        return said(diagnose(Log.of(sensor, log.time_s, {"k": k})))

    def changed(k: FloatArray, strip: int, change: FloatArray) -> FloatArray:
        return np.asarray(k + np.where(np.arange(12) == strip, change[:, None], 0.0))

    k = log.raw["k"] + offsets
    assert named(k) == []
    assert named(0.9 * log.raw["k"] + offsets) == [("wrong-vref", ())]
    assert named(changed(k, 3, 0.02 * time)) == [("drift", (3,))]
    resting = replace(METAL, rest_volt=0.25, touch_volt=0.2)
    k = np.nan_to_num(log.raw["k"], nan=0.05) + 0.001 * rng.normal(size=(600, 12))
    assert named(k, resting) == []
    assert named(changed(k, 9, 0.012 * time**1.5), resting) == [("drift", (9,))]
    assert named(changed(k, 9, 0.012 * np.sin(20.0 * time)), resting) == [("wander", (9,))]


@pytest.mark.usefixtures("no_outline")
def test_pressure_of_a_block_that_covers_its_strips_at_once() -> None:
    """No rim of it fades, but it never reads high where it leaves: before, this was called a wrong reference."""
    middle = 5.5 + 6.0 * np.sin(np.linspace(0.0, 40.0, 600))[:, None]
    area = np.clip((3.2 - np.abs(np.arange(12) - middle)) / 1.2, 0.0, 1.0)
    force = area * (0.5 + 0.35 * np.sin(np.linspace(0.0, 23.0, 600)))[:, None]
    k = np.where(area > 0.0, force / (force + 0.3), np.nan)
    assert said(diagnose(Log.of(METAL, np.arange(600) / 20.0, {"k": k}))) == [("pressure", ())]


@pytest.mark.usefixtures("no_outline")
def test_a_gap_between_two_objects_is_no_dead_strip() -> None:
    rng = np.random.default_rng(1)
    time_s = np.arange(400) / 20.0
    k = np.full((400, 12), np.nan)
    k[:, 2:5], k[:, 6:10] = 0.2, 0.7 + 0.03 * np.sin(time_s)[:, None]
    k[::3, 2], k[1::5, 9], k[2::7, 8:10] = np.nan, np.nan, np.nan
    assert said(diagnose(Log.of(METAL, time_s, {"k": k + 0.001 * rng.normal(size=k.shape)}))) == []


def test_what_one_press_cannot_tell_is_a_question() -> None:
    contact = ts.Contact.polygon([(6.0, 90.0), (72.0, 100.0), (72.0, 160.0), (6.0, 150.0)])
    k = faulty_log(METAL, [contact] * 10, noise=Noise(positional=0.002)).raw["k"]
    k[:, 5] = 0.0
    report = diagnose(Log.of(METAL, 0.01 * np.arange(10.0), {"k": k}))
    assert report.healthy
    (question,) = report.questions
    assert (question.strips, question.causes) == ((5,), ("open-strip", "dead"))
    assert "Press strip 6 at three places" in question.ask(strip_base=1)
    assert report.to_json()["questions"][0]["causes"] == ["open-strip", "dead"]


def test_a_cut_file_and_lost_scans_are_told(tmp_path: Path) -> None:
    log = _log(scans=60)
    scans = [
        ts.Scan(k=np.clip(k, 0.0, 1.0), time_s=float(t))
        for k, t in zip(log.raw["k"], log.time_s, strict=True)
    ]
    path = tmp_path / "cut.csv"
    write_readings(path, METAL, [scan for i, scan in enumerate(scans) if not 20 <= i < 25])
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    path.write_text("".join(lines[:-5]), encoding="utf-8")
    report = diagnose(read_log(path, METAL))
    assert report.scans == 54
    assert any("last scan" in text and "7 of 12 strips" in text for text in report.unchecked)
    assert any(text.startswith("5 scans are missing in 1 gap") for text in report.unchecked)


def test_a_verdict_must_last_to_leave_a_channel_out_and_to_take_it_back() -> None:
    strips = [{"strip": i, "touched_scans": 40} for i in range(12)]
    dead = {"fault": "dead", "severity": "broken", "strips": [7], "signature": "kh"}
    ill, well = {"findings": [dead], "strips": strips}, {"findings": [], "strips": strips}
    unseen = {"findings": [], "strips": [{**row, "touched_scans": 0} for row in strips]}
    verdicts = Verdicts()
    assert verdicts.update(ill) == []
    assert verdicts.update(ill) == ["channel 7:v_h is left out: dead channel; it comes back when it heals"]
    for report in (well, well, unseen, ill, well, well):
        assert verdicts.update(report) == []
    assert list(verdicts.left_out) == ["7:v_h"]
    assert verdicts.update(well) == ["channel 7:v_h reads well again and is used"]
    assert not verdicts.left_out


def test_a_stream_does_without_a_channel_and_records_it() -> None:
    sensor = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0)
    contact = ts.Contact.polygon([(22, 38), (62, 22), (80, 55), (45, 76)])
    source = ts.SimulatedSource(sensor, lambda time_s: contact, rate_hz=200.0, scans=20)
    live = ts.Live(source, speed=sys.float_info.max)
    live.leave_out(("9:v_h",))
    frame = list(live)[-1]
    assert np.isnan(frame.scan["kh"][9])
    assert np.isfinite(frame.scan["kl"][9])
    assert frame.raw.codes["kh"][9] > 0
    assert frame.sensor.without == ("9:v_h",)


def test_a_stream_too_short_for_a_verdict_says_so() -> None:
    sensor = ts.Sensor(construction="crs-crs", strips=8, pitch_mm=5.0, length_mm=100.0)
    contact = ts.Contact.polygon([(2, 38), (38, 22), (30, 55)])
    said_: list[str] = []
    source = ts.SimulatedSource(sensor, lambda time_s: contact, rate_hz=200.0, scans=5)
    live = ts.Live(source, speed=sys.float_info.max, on_message=said_.append)
    with ThreadPoolExecutor(1) as executor:
        doctor = watch(live, executor)
        list(live)
        doctor.close()
    assert any("no verdict before the stream ended" in text for text in said_)
