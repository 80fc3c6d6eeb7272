"""The doctor names the fault, the strip and the size that were put in, and nothing on a healthy unit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import tacstrip as ts
from studies.checkup import Case, exercise, faulty, said
from studies.faults import Defect, faulty_log
from studies.holdout import doctor_set
from tacstrip.arrays import FloatArray
from tacstrip.contact.noise import Noise
from tacstrip.diagnose.doctor import diagnose, exchanged_strips
from tacstrip.diagnose.faults import Finding, Report
from tacstrip.diagnose.log import Log
from tacstrip.diagnose.noise import typical_contact
from tacstrip.diagnose.shorts import bridge_effect
from tacstrip.network import Imperfections, Short
from tacstrip.reconstruction.cramer_rao import vertex_covariance, vertex_rms

RUBBER = ts.Sensor(construction="crs-crs", strips=12, pitch_mm=6.5, length_mm=325.0, adc_bits=12)
METAL = ts.Sensor(construction="crs-m", strips=12, pitch_mm=6.5, length_mm=250.0, adc_bits=12)
CRP = ts.Sensor(
    construction="crs-crp",
    strips=6,
    pitch_mm=5.0,
    length_mm=60.0,
    resistivity_ratio=100.0,
    contact_lambda_mm=1.0,
)
PROFILE_I = Noise(positional=0.005)
FAINT = Noise(positional=0.001)
_SCANS = 118  # name most faults; from 120 places of the contact on an outline is fitted


def _examined(
    sensor: ts.Sensor, *defects: Defect, noise: Noise = FAINT, scans: int = _SCANS, seed: int = 5
) -> Report:
    contacts = exercise(sensor, np.random.default_rng(seed), scans)
    return diagnose(faulty_log(sensor, contacts, defects, noise, seed, 220.0))


def _only(report: Report, fault: str, *strips: int) -> Finding:
    assert said(report) == [(fault, strips)]
    return report.findings[0]


@pytest.mark.usefixtures("no_outline")
def test_a_cut_strip_and_where_it_is_cut() -> None:
    for sensor in (RUBBER, METAL):
        found = _only(_examined(sensor, Defect("open-strip", 7, 0.6), scans=240), "open-strip", 7)
        assert found.numbers["at_ground"] > 10
        assert found.numbers["at_vref"] > 10
        low, high = (float(w) for w in found.evidence.split("y = ")[1].split(" mm")[0].split(" to "))
        assert low - 30.0 < 0.6 * sensor.length_mm < high + 30.0


@pytest.mark.parametrize("sensor", [RUBBER, METAL])
@pytest.mark.parametrize(
    ("end", "words"), [(0.0, "open at its grounded end"), (1.0, "open at its end at Vref")]
)
@pytest.mark.parametrize("offset", [0.0, 0.03])
def test_an_open_end_is_a_clamp_and_not_two_dead_wires(
    sensor: ts.Sensor, end: float, words: str, offset: float
) -> None:
    """Wherever it is touched, all of the strip's channels are on one rail; offsets take them beside it."""
    log = faulty_log(sensor, exercise(sensor, np.random.default_rng(5), _SCANS), noise=FAINT)
    raw = {name: values.copy() for name, values in log.raw.items()}
    for name, values in raw.items():
        hangs = 1.0 - end + (0.5 - end) * (-offset if name == "kl" else -2.0 * offset)
        values[:, 7] = np.where(np.isfinite(values[:, 7]), hangs, np.nan)
    found = _only(diagnose(Log.of(sensor, log.time_s, raw)), "open-strip", 7)
    assert words in found.evidence


@pytest.mark.usefixtures("no_outline")
@pytest.mark.parametrize("strip", [0, 7])
def test_an_open_end_beside_strips_at_rest_does_not_come_and_go(strip: int) -> None:
    """It reads Vref under every contact and rests as the others do; a level that stays without contact is stuck."""
    sensor = replace(METAL, rest_volt=0.3, touch_volt=0.2)
    log = faulty_log(sensor, exercise(sensor, np.random.default_rng(5), 240), noise=FAINT)
    k = log.raw["k"].copy()
    k[log.touched[:, strip], strip] = 0.985
    _only(diagnose(Log.of(sensor, log.time_s, {"k": k})), "open-strip", strip)
    k[:, strip] = 0.985
    _only(diagnose(Log.of(sensor, log.time_s, {"k": k})), "stuck", strip)


@pytest.mark.usefixtures("no_outline")
def test_an_open_end_that_noise_makes_touched() -> None:
    """On ground, next to the level of rest, a scan counts as touched now and then; before, nothing was found."""
    sensor = replace(METAL, rest_volt=0.3, touch_volt=0.2)
    k = faulty_log(sensor, exercise(sensor, np.random.default_rng(5), 240), noise=FAINT).raw["k"].copy()
    k[:, 6] = np.where(np.arange(240) % 16, 0.06, 0.0)
    _only(diagnose(Log.of(sensor, np.arange(240) / 200.0, {"k": k})), "open-strip", 6)


@pytest.mark.usefixtures("no_outline")
def test_a_cut_under_a_long_contact_is_no_loose_joint() -> None:
    """Contacts bridge it at most places: it is on ground below them and on Vref above."""
    k = faulty_log(METAL, exercise(METAL, np.random.default_rng(5), 240), noise=FAINT).raw["k"].copy()
    k[:, 7] = np.where(k[:, 7] < 0.25, 0.0, np.where(k[:, 7] > 0.76, 1.0, k[:, 7]))
    report = diagnose(Log.of(METAL, np.arange(240) / 200.0, {"k": k}))
    assert [(f.fault, f.strips) for f in report.findings] == [("open-strip", (7,))]


def test_an_open_end_in_a_few_presses() -> None:
    contact = ts.Contact.polygon([(0.0, 0.0), (40.0, 10.0), (40.0, 90.0), (0.0, 60.0)])
    presses = [contact.placed(39.0, y) for y in (80.0, 130.0, 180.0, 230.0) for _ in range(15)]
    log = faulty_log(RUBBER, presses, [Defect("open-strip", 6, 0.0)], FAINT)
    assert "open at its grounded end" in _only(diagnose(log), "open-strip", 6).evidence


def test_an_open_end_that_reads_as_untouched() -> None:
    """Rest is ground: the strip is never touched, while its neighbours are, and its wires are not all dead."""
    resting = replace(RUBBER, rest_volt=0.0, touch_volt=0.1)
    log = faulty_log(resting, exercise(resting, np.random.default_rng(5), _SCANS), noise=FAINT)
    raw = {name: np.clip(values, 0.0, 1.0) for name, values in log.raw.items()}
    for values in raw.values():
        values[:, 6] = 0.0
    found = _only(diagnose(Log.of(resting, log.time_s, raw)), "open-strip", 6)
    assert "open at its end at Vref" in found.evidence


def test_a_cut_sensing_strip() -> None:
    found = _only(_examined(RUBBER, Defect("open-sensing", 3, 0.5)), "open-sensing", 3)
    assert min(found.numbers.values()) > 5


@pytest.mark.usefixtures("no_outline")
def test_shorts_of_wires_and_over_metal() -> None:
    tied = _only(_examined(RUBBER, Defect("short", 4, 1.0, "kh")), "short", 4, 5)
    assert tied.numbers["differ"] < 0.3 * tied.numbers["others"]
    bridged = _only(_examined(METAL, Defect("short", 4, 0.4), scans=240), "short", 4, 5)
    assert bridged.numbers["most"] - bridged.numbers["least"] > 0.02


def test_a_bridge_over_metal_gives_the_current_a_second_way() -> None:
    """The closed form that the doctor fits is what the network says, but for the bridge's own 20 ohm."""
    for y, low, high in ((60.0, 0.6, 0.6), (180.0, 0.6, 0.6)):
        edge = [(7.0, y), (38.0, y), (38.0, y + 0.2), (7.0, y + 0.2)]
        contact = ts.Contact.polygon(edge)
        bridged = ts.simulate(
            METAL, contact, model="network", imperfections=Imperfections(shorts=[Short(2, 150.0, 1e-3)])
        )
        ideal = ts.simulate(METAL, contact)["k"][2:4]
        np.testing.assert_allclose(bridged["k"][2:4] - ideal, bridge_effect(ideal, low, high), atol=2e-3)


def test_a_bridge_between_energised_rubber_strips_does_next_to_nothing() -> None:
    """docs/guide/doctor.md says so: it cannot be found, and need not be."""
    contacts = exercise(RUBBER, np.random.default_rng(5), 30)
    build = Imperfections(shorts=[Short(4, 160.0, 20.0)])
    for contact in contacts:
        ideal = ts.simulate(RUBBER, contact)
        bridged = ts.simulate(RUBBER, contact, model="network", imperfections=build)
        both = ideal.touched[4] and ideal.touched[5]
        for name in ("kh", "kl"):
            off = np.nanmax(np.abs(bridged[name] - ideal[name])[[4, 5]], initial=0.0)
            assert off < (0.02 if both else 0.03)


@pytest.mark.parametrize("sensor", [RUBBER, METAL])
def test_crossed_connections(sensor: ts.Sensor) -> None:
    _only(_examined(sensor, Defect("swapped-strips", 6)), "swapped-strips", 6, 7)
    for ends in (0.0, 1.0):
        _only(_examined(sensor, Defect("swapped-ends", 5, ends)), "swapped-ends", 5)


def test_crossed_wires_of_one_strip_and_of_all() -> None:
    found = _only(_examined(RUBBER, Defect("swapped-wires", 8)), "swapped-wires", 8)
    assert found.numbers["difference"] < -0.01
    log = faulty_log(RUBBER, exercise(RUBBER, np.random.default_rng(5), _SCANS), noise=FAINT)
    _only(diagnose(Log.of(RUBBER, log.time_s, {"kh": log.raw["kl"], "kl": log.raw["kh"]})), "swapped-wires")


@pytest.mark.parametrize("seed", range(6))
def test_offsets_are_not_crossed_wires(seed: int) -> None:
    """One thin press, each channel off by up to 1 % on its own: some v_h lie below their v_l, and nothing is wrong."""
    rng = np.random.default_rng(seed)
    bar = ts.Contact.polygon([(6.0, 150.0), (72.0, 156.0), (72.0, 157.0 + seed), (6.0, 151.0 + seed)])
    for scans in (1, 40):
        log = faulty_log(RUBBER, [bar] * scans, noise=FAINT)
        raw = {name: values + rng.choice([-0.01, 0.01], 12) for name, values in log.raw.items()}
        assert (raw["kh"] < raw["kl"] - 0.005).any()
        assert said(diagnose(Log.of(RUBBER, log.time_s, raw))) == []


def test_an_offset_between_the_wires_is_no_exchange_and_an_exchange_with_an_offset_is() -> None:
    log = faulty_log(RUBBER, exercise(RUBBER, np.random.default_rng(5), _SCANS), noise=FAINT)
    for crossed in (False, True):
        raw = {name: values.copy() for name, values in log.raw.items()}
        if crossed:
            for name, other in (("kh", "kl"), ("kl", "kh")):
                raw[name][:, 8] = log.raw[other][:, 8]
        raw["kh"][:, 8] = np.clip(raw["kh"][:, 8] - 0.03, 0.0, 1.0)
        raw["kl"][:, 8] = np.clip(raw["kl"][:, 8] + 0.02, 0.0, 1.0)
        report = diagnose(Log.of(RUBBER, log.time_s, raw))
        assert said(report) == ([("swapped-wires", (8,))] if crossed else [])


@pytest.mark.parametrize("sigma", [0.0, 0.001])
def test_tied_wires_of_one_strip_and_of_all(sigma: float) -> None:
    log = faulty_log(RUBBER, exercise(RUBBER, np.random.default_rng(5), _SCANS), noise=FAINT)
    kh, kl = log.raw["kh"], log.raw["kl"].copy()
    kl[:, 7] = kh[:, 7] + sigma * np.random.default_rng(3).standard_normal(len(kh))
    found = _only(diagnose(Log.of(RUBBER, log.time_s, {"kh": kh, "kl": kl})), "tied-wires", 7)
    assert found.numbers["neighbours"] > 0.05 > 0.01 > found.numbers["difference"]
    _only(diagnose(Log.of(RUBBER, log.time_s, {"kh": kh, "kl": kh})), "tied-wires")


def test_channels_that_do_not_move() -> None:
    assert _only(_examined(RUBBER, Defect("dead", 4, 0.0, "kl")), "dead", 4).signature == "kl"
    stuck = _only(_examined(RUBBER, Defect("stuck", 9, 0.37, "kh")), "stuck", 9)
    assert stuck.signature == "kh"
    assert stuck.numbers["level"] == pytest.approx(0.37, abs=1e-3)


def test_a_strip_that_never_reads_a_contact() -> None:
    log = faulty_log(RUBBER, exercise(RUBBER, np.random.default_rng(5), _SCANS), noise=FAINT)
    raw = {name: values.copy() for name, values in log.raw.items()}
    for values in raw.values():
        values[:, 5] = np.nan
    report = diagnose(Log.of(RUBBER, log.time_s, raw))
    _only(report, "dead", 5)
    # It was reached where both neighbours read a contact: no advice to move the contact over it.
    assert not any("strip 5: never touched" in reason for reason in report.unchecked)


def test_saturation_of_one_channel_and_of_all() -> None:
    one = _only(_examined(METAL, Defect("saturation", 4, 0.7)), "saturation", 4)
    assert one.numbers["level"] == pytest.approx(0.7, abs=2e-3)
    every = _only(_examined(METAL, Defect("saturation", None, 0.7)), "saturation")
    assert every.numbers["level"] == pytest.approx(0.7, abs=2e-3)


@pytest.mark.parametrize("factor", [0.85, 1.15])
def test_wrong_vref(factor: float) -> None:
    found = _only(_examined(RUBBER, Defect("wrong-vref", size=factor)), "wrong-vref")
    assert found.numbers["factor"] == pytest.approx(factor, abs=0.02)


def test_drift_of_one_strip_and_at_rest() -> None:
    one = _only(_examined(RUBBER, Defect("drift", 6, 0.05), scans=240), "drift", 6)
    assert one.numbers["change"] == pytest.approx(0.05, abs=0.01)
    resting = replace(RUBBER, rest_volt=0.3, touch_volt=0.2)
    report = _examined(resting, Defect("drift", None, -0.03), scans=240)
    assert report.healthy  # all together: a note
    (every,) = (note for note in report.notes if note.fault == "common-drift")
    assert every.numbers["change"] == pytest.approx(-0.03, abs=0.003)


@pytest.mark.usefixtures("no_outline")
def test_hum_of_one_strip_and_of_all() -> None:
    for hertz, strip, strips in ((50.0, 6, (6,)), (60.0, None, ())):
        found = _only(_examined(RUBBER, Defect("hum", strip, 0.02, hertz=hertz), scans=300), "hum", *strips)
        assert found.numbers["hertz"] == hertz
        assert found.numbers["amplitude"] == pytest.approx(0.02, rel=0.3)


@pytest.mark.usefixtures("no_outline")
def test_hum_that_sampling_hides_is_listed_as_unchecked() -> None:
    contacts = exercise(RUBBER, np.random.default_rng(5), 480)
    report = diagnose(faulty_log(RUBBER, contacts, [Defect("hum", size=0.02)], FAINT, 0, rate_hertz=10.0))
    assert "hum" not in {f.fault for f in report.findings}
    assert any("hum at 50 and 60 Hz" in reason for reason in report.unchecked)


@pytest.mark.usefixtures("no_outline")
def test_excess_noise_of_one_strip_and_of_all() -> None:
    one = _only(_examined(RUBBER, Defect("noise", 6, 0.03)), "noise", 6)
    assert one.numbers["sigma"] == pytest.approx(0.03, rel=0.3)
    _only(_examined(RUBBER, Defect("noise", None, 0.02), scans=480), "noise")


def test_missing_bits() -> None:
    found = _only(_examined(RUBBER, Defect("bits", size=3)), "bits")
    assert found.numbers["stuck_bits"] == 3.0
    assert "9 of 12 bits are left" in found.evidence


@pytest.mark.usefixtures("no_outline")
@pytest.mark.parametrize(("half_width", "profile"), [(0.002, "I"), (0.0075, "II")])
def test_noise_in_the_terms_of_the_thesis(half_width: float, profile: str) -> None:
    report = _examined(RUBBER, noise=Noise(positional=half_width), scans=480)
    noise = report.quality
    assert report.healthy
    assert noise.half_width_percent == pytest.approx(100.0 * half_width, rel=0.2)
    assert noise.profile == profile
    bound = vertex_rms(vertex_covariance(typical_contact(RUBBER), RUBBER, half_width / np.sqrt(3.0)))
    assert noise.vertex_rms_mm == pytest.approx(bound, rel=0.2)


@pytest.mark.usefixtures("no_outline")
def test_a_unit_without_calibration_is_not_broken_but_is_told_so() -> None:
    offsets = (
        np.array([0.345, 0.016, 0.353, 0.317, 0.080, 0.161, 0.070, 0.261, 0.168, 0.291]) / 6.05
    )  # table 6.1
    sensor = ts.Sensor.load("prototype-crs-crs")
    contacts = exercise(sensor, np.random.default_rng(1), 240)
    report = diagnose(faulty_log(sensor, contacts, noise=FAINT, offsets=offsets))
    assert report.healthy
    assert {f.fault for f in report.notes} == {"calibration"}
    low = next(f for f in report.notes if f.strips == (1,))
    assert low.numbers["offset"] < -0.02


def test_a_strip_that_the_spec_leaves_out_is_not_named() -> None:
    dead = _examined(METAL, Defect("dead", 5, 0.0))
    assert 5 in {i for f in dead.findings for i in f.strips}
    left_out = _examined(replace(METAL, without=("5",)), Defect("dead", 5, 0.0))
    assert left_out.healthy
    assert not left_out.questions
    assert "strip 5: left out by the spec (without)" in left_out.unchecked
    assert left_out.condition(5) == "unchecked"


def test_what_was_not_touched_is_not_called_healthy() -> None:
    contact = ts.Contact.polygon([(20.0, 100.0), (45.0, 110.0), (45.0, 150.0), (20.0, 140.0)])
    report = diagnose(
        Log.of_scans(RUBBER, [ts.simulate(RUBBER, contact, FAINT, rng=seed) for seed in range(20)])
    )
    assert report.healthy
    assert report.condition(0) == "unchecked"
    assert report.condition(4) == "ok"
    assert "strips 0-2, 7-11: never touched; move the contact over them" in report.unchecked
    assert any("the contact stood at 1 place(s)" in reason for reason in report.unchecked)


def test_strips_are_named_as_the_file_counts_them() -> None:
    from_one = replace(RUBBER, strip_base=1)
    report = _examined(from_one, Defect("stuck", 4, 0.5, "kl"))
    entry = report.to_json()["findings"][0]
    assert entry["strips"] == [5]
    assert report.where(report.findings[0]) == "strip 5, v_l"
    assert report.to_json()["strips"][4] == {
        "strip": 5, "condition": "broken", "touched_scans": int(report.touched_scans[4]),
        "sigma": pytest.approx(report.quality.strips[4]), "faults": ["stuck"],
    }  # fmt: skip


def test_a_sheet_is_examined_as_far_as_its_channels_go() -> None:
    square = ts.Contact.polygon([(6.0, 20.0), (24.0, 20.0), (24.0, 40.0), (6.0, 40.0)])
    scan = ts.simulate(CRP, square)
    report = diagnose(Log.of_scans(CRP, [scan] * 3))
    assert report.healthy
    assert any("CRS-CRP" in reason for reason in report.unchecked)


@pytest.mark.usefixtures("no_outline")
def test_a_long_recording_is_examined_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tacstrip.diagnose.doctor._MOST_SCANS", 1000)
    case = faulty(2, scans=300, faults=["stuck"])
    assert isinstance(case, Case)
    log = faulty_log(case.sensor, case.contacts, case.defects, case.noise, case.seed)
    many = 4
    long = Log(
        log.sensor, np.arange(300 * many) / 220.0, {n: np.tile(v, (many, 1)) for n, v in log.raw.items()},
        np.tile(log.touched, (many, 1)),
    )  # fmt: skip
    report = diagnose(long)
    assert report.scans == 300 * many
    assert ("stuck", case.defects[0].strips()) in said(report)


def test_one_reading_far_outside_is_told() -> None:
    """`reconstruct` refuses such a file; the doctor says where it is."""
    sensor = ts.Sensor(construction="crs-crs", strips=12, pitch_mm=4.0, length_mm=100.0)
    contact = ts.Contact.polygon([(8, 20), (40, 30), (30, 80)])
    noise = ts.Noise(positional=0.002)
    scans = [
        ts.simulate(sensor, contact.moved(0.02 * i, 0.0), noise, rng=i, time_s=0.01 * i) for i in range(100)
    ]
    raw = {name: np.stack([s[name] for s in scans]) for name in ("kh", "kl")}
    raw["kh"][57, 5] = 1.46
    log = Log.of(sensor, np.array([s.time_s for s in scans]), raw)
    (asked,) = [q for q in diagnose(log).questions if q.causes == ("wrong-vref",)]
    assert asked.strips == (5,)
    assert "1 reading(s) lie outside 0 to Vref, the first in scan 57" in asked.evidence


def _parallelogram(scans: int, scale: float = 1.0) -> tuple[ts.Sensor, FloatArray, FloatArray]:
    """Return a sensor, times and readings (scans, strips) of a slanted contact on it that goes up and down."""
    sensor = ts.Sensor(construction="crs-m", strips=12, pitch_mm=5.0, length_mm=100.0, adc_bits=12)
    time_s = np.arange(scans) / 20.0
    first = 1.0 + np.sin(0.31 * time_s)
    at = np.arange(12.0) - first[:, None]
    low = 27.0 + 25.0 * np.sin(0.7 * time_s)[:, None] + 1.5 * at
    low = np.where((at > -0.5) & (at < 9.5), low, np.nan)
    k = scale * ts.signatures(sensor, low, low + 20.0)["k"]
    return sensor, time_s, k + np.random.default_rng(3).normal(0.0, 0.001 * scale, k.shape)


def test_readings_of_another_scale_are_noted() -> None:
    for scale in (0.2, 1.0):  # over Vref, where the spec says volts
        sensor, time_s, k = _parallelogram(120, scale)
        report = diagnose(Log.of(sensor, time_s, {"k": k}))
        assert report.healthy
        notes = [n.evidence for n in report.notes if n.fault == "scale"]
        assert ["write vref_volt = 1" in n for n in notes] == [True] * (scale < 1.0)


@pytest.mark.usefixtures("no_outline")
def test_a_joint_that_is_open_during_one_pass_may_be_loose() -> None:
    """Without the quarter of the recording that this pass is in, nothing is left of it: a question."""
    sensor, time_s, k = _parallelogram(300)
    under = np.flatnonzero(np.isfinite(k[:, 3:8]).all(axis=1) & (k[:, 5] < 0.6))
    k[under[5:25], 5] = 0.999
    report = diagnose(Log.of(sensor, time_s, {"k": k}))
    assert report.healthy
    (asked,) = report.questions
    assert (asked.causes, asked.strips) == (("intermittent",), (5,))


def test_a_doubtful_strip_of_one_press_on_one_channel_is_asked_about() -> None:
    presses = [ts.Contact.polygon([(9.0, 60.0), (69.0, 70.0), (69.0, 180.0), (9.0, 150.0)])] * 6
    log = faulty_log(RUBBER, presses, noise=FAINT)
    read = log.raw["kl"].copy()
    read[:, 5] -= 0.2
    report = diagnose(Log.of(RUBBER, log.time_s, {"kl": read}))
    assert [q.strips for q in report.questions] == [(5,)]
    assert [report.condition(i) for i in (4, 5)] == ["ok", "asked"]


def test_a_silent_strip_in_question_is_not_called_never_touched() -> None:
    presses = [ts.Contact.polygon([(9.0, 60.0), (69.0, 70.0), (69.0, 180.0), (9.0, 150.0)])] * 6
    log = faulty_log(RUBBER, presses, noise=FAINT)
    raw = {name: values.copy() for name, values in log.raw.items()}
    for values in raw.values():
        values[:, 5] = np.nan
    report = diagnose(Log.of(RUBBER, log.time_s, raw))
    assert [q.strips for q in report.questions] == [(5,)]
    never = next(said for said in report.unchecked if "never touched" in said)
    assert " 5" not in never


def test_one_channel_on_vref_under_one_press_is_asked_about_as_stuck() -> None:
    presses = [ts.Contact.polygon([(9.0, 60.0), (69.0, 70.0), (69.0, 180.0), (9.0, 150.0)])] * 6
    log = faulty_log(RUBBER, presses, noise=FAINT)
    raw = {name: values.copy() for name, values in log.raw.items()}
    raw["kh"][:, 5] = 1.0
    (question,) = diagnose(Log.of(RUBBER, log.time_s, raw)).questions
    assert (question.strips, question.signature, question.causes) == ((5,), "kh", ("stuck",))


@pytest.mark.parametrize(
    ("seed", "number", "why"),
    [
        (410, 383, "wander under contacts that turn, against one outline"),
        (1, 13, "tied sensing strips where the contact lies nearly straight, against one outline"),
        (
            410,
            777,
            "drift at rest, where contacts come to the strip's neighbours in the same stretches of time",
        ),
    ],
)
def test_faults_that_an_outline_tells_are_named(seed: int, number: int, why: str) -> None:
    assert doctor_set.score(seed, number)["verdict"] == "named", why


@pytest.mark.usefixtures("no_outline")
@pytest.mark.parametrize(
    ("seed", "number", "why"),
    [
        (2, 5, "a cut strip that counts as untouched below the cut"),
        (5, 63, "exchanged wires of a short contact, by the unit's own offsets"),
        (8, 71, "a wrong Vref of contacts that come to each strip's end once"),
        (7, 79, "hum within a cycle or two of half the scan rate"),
        (9, 79, "hum of strips that are visited in one half of the recording"),
    ],
)
def test_faults_of_units_that_are_kept_apart_are_named(seed: int, number: int, why: str) -> None:
    assert doctor_set.score(seed, number)["verdict"] == "named", why


@pytest.mark.usefixtures("no_outline")
@pytest.mark.parametrize(
    ("seed", "number", "verdict", "why"),
    [
        (771, 77, "asked", "an outermost strip over metal that drops out and comes back"),
        (774, 33, "asked", "a strip on Vref for most contacts of its upper half: cut or loose"),
        (775, 53, "named", "a cut sensing strip, mostly seen at contacts' rims"),
        (775, 9, "named", "another, which without one quarter is a dead channel"),
    ],
)
def test_faults_of_which_little_is_seen(seed: int, number: int, verdict: str, why: str) -> None:
    assert doctor_set.score(seed, number)["verdict"] == verdict, why


@pytest.mark.parametrize(
    ("number", "why"),
    [
        (210, "an object that lies still on a strip beside one that moves: no stuck channel"),
        (378, "the same over the end at Vref: no open end"),
    ],
)
def test_sound_units_that_are_kept_apart_have_no_finding(number: int, why: str) -> None:
    assert doctor_set.score(440, number)["verdict"] != "alarm", why


@pytest.mark.usefixtures("no_outline")
def test_a_fault_that_hangs_on_one_quarter_of_the_recording_is_asked_about() -> None:
    """A cut strip with an offset, so that ground is not 0."""
    assert doctor_set.score(12, 49)["verdict"] == "asked"


def test_drift_by_few_looks_is_a_question() -> None:
    """Among the strips and signals that are looked at, one of 500 passes is as much by chance (z = 2.7)."""
    assert doctor_set.score(0, 73)["verdict"] == "asked"


@pytest.mark.parametrize("number", [1041, 1085])
def test_a_line_that_stands_out_is_asked_about_however_few_the_looks(number: int) -> None:
    """A drift of 1.5 to 2 %, under contacts only, that explains five times what any other strip's line does."""
    assert doctor_set.score(411 if number == 1041 else 410, number)["verdict"] == "asked"


def test_a_contact_at_the_border_that_reads_as_rest_and_sways_does_not_wander() -> None:
    """Its levels jump from one stretch of time to the next; a zero that wanders slowly does not."""
    assert doctor_set.score(430, 212)["verdict"] == "ok"


def _at_rest(log: Log, rest: float) -> Log:
    """Return the log of a unit whose untouched strips, and wires that nothing holds, read this over Vref."""
    sensor = replace(
        log.sensor, rest_volt=rest * log.sensor.vref_volt, touch_volt=0.04 * log.sensor.vref_volt
    )
    noise = np.random.default_rng(1).normal(0.0, 0.001, log.touched.shape)
    raw = {name: np.where(log.touched, values, rest + noise) for name, values in log.raw.items()}
    return Log.of(sensor, log.time_s, raw)


@pytest.fixture(scope="module", params=[RUBBER, METAL])
def sound_and_cut(request: pytest.FixtureRequest) -> tuple[Log, Log]:
    """Return the logs of a sound unit and of one whose strip 7 is cut."""
    contacts = exercise(request.param, np.random.default_rng(5), _SCANS)
    cut = Defect("open-strip", 7, 0.6)
    sound, faulty = (faulty_log(request.param, contacts, put, FAINT, 5, 220.0) for put in ((), (cut,)))
    return sound, faulty


@pytest.mark.parametrize("rest", [0.0, 0.1, 0.5, 1.0])
def test_any_level_of_rest(sound_and_cut: tuple[Log, Log], rest: float) -> None:
    sound, cut = sound_and_cut
    assert diagnose(_at_rest(sound, rest)).findings == ()
    _only(diagnose(_at_rest(cut, rest)), "open-strip", 7)
    name = next(iter(sound.raw))
    unheld = _at_rest(sound, rest)
    read = {**unheld.raw, name: unheld.raw[name].copy()}
    read[name][:, 4] = rest
    (found,) = diagnose(Log.of(unheld.sensor, unheld.time_s, read)).findings
    assert (found.fault, found.strips) == ("dead" if sound.sensor is RUBBER else "open-strip", (4,))


def _dragged(strips: tuple[int, int], rows: int) -> Log:
    """Return the log of a contact that goes to and fro over ten strips of which two are exchanged."""
    sensor = ts.Sensor(construction="crs-crs", strips=10, pitch_mm=10.0, length_mm=100.0)
    shape = ts.Contact.polygon([(-22, -14), (17, -20), (24, 9), (-6, 23)])
    scans = []
    for i, f in enumerate(np.linspace(0.0, 1.0, rows)):
        x, y = 50 + 40 * np.sin(6 * np.pi * f + 0.3), 50 + 25 * np.sin(4 * np.pi * f + 1.0)
        there = shape.turned(0.4 * np.sin(15 * f)).moved(x, y)
        scans.append(ts.simulate(sensor, there, ts.Noise(positional=0.003), rng=i, time_s=0.02 * i))
    order = np.arange(10)
    order[list(strips)] = strips[::-1]
    return Log.of_scans(
        sensor, [ts.Scan(kh=s["kh"][order], kl=s["kl"][order], time_s=s.time_s) for s in scans]
    )


@pytest.mark.usefixtures("no_outline")
def test_two_exchanged_strips_are_both_named_and_none_between_them() -> None:
    assert exchanged_strips(_dragged((3, 3), 60)) is None
    for strips in ((3, 4), (2, 7), (0, 3)):
        log = _dragged(strips, 60)
        report = diagnose(log)
        assert {f.strips for f in report.findings} | {q.strips for q in report.questions} == {strips}
        found = exchanged_strips(log)
        assert found is not None
        assert found[0] == strips
