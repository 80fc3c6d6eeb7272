"""Readings of another scale than the spec's: over Vref where it says volts, codes of fewer bits than it says."""

from dataclasses import replace

import pytest

import tacstrip as ts
from tacstrip.reconstruction.implausible import SCALE, doubt_scale

SENSOR = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0, adc_bits=12)
NOISE = ts.Noise(positional=0.003)
SHAPES = {
    "quadrangle": ts.Contact.polygon([(22, 18), (70, 34), (62, 72), (30, 66)]),
    "high": ts.Contact.polygon([(12, 60), (48, 55), (40, 95)]),
}


def scaled(scan: ts.Scan, by: float) -> ts.Scan:
    return ts.Scan(**{name: scan[name] * by for name in scan.signatures}, time_s=scan.time_s)


@pytest.mark.parametrize("method", ["polygon", "profile", "vertex", "pieces"])
@pytest.mark.parametrize("shape", SHAPES)
def test_fractions_read_as_volts_are_doubtful_by_every_method(method: str, shape: str) -> None:
    scan = ts.simulate(SENSOR, SHAPES[shape], NOISE, rng=3)
    found = ts.reconstruct(scaled(scan, 0.2), SENSOR, method=method)
    assert found.status not in ("ok", "likely")
    assert "write vref_volt = 1" in found.advice
    assert SCALE not in ts.reconstruct(scan, SENSOR, method=method).advice


@pytest.mark.parametrize(("bits", "fewer"), [(12, 10), (16, 12), (10, 8)])
def test_codes_of_fewer_bits_are_doubtful_and_the_bits_are_named(bits: int, fewer: int) -> None:
    sensor = replace(SENSOR, adc_bits=bits, vref_volt=1.0)
    scan = scaled(ts.simulate(sensor, SHAPES["quadrangle"], NOISE, rng=4), 2.0 ** (fewer - bits))
    found = ts.reconstruct(scan, sensor)
    assert found.status == "doubtful"
    assert f"write adc_bits = {fewer}" in found.advice
    assert "vref_volt" not in found.advice  # 1 V is the same over Vref


def test_contacts_near_the_grounded_end_are_not_doubted() -> None:
    low = {
        "small": [(40, 5), (58, 4), (60, 17), (42, 18)],
        "over the border": [(20, -20), (70, -22), (66, 14), (25, 12)],
        "on one strip": [(51, 8), (54, 8), (54, 12), (51, 12)],
        "two": [(10, 4), (28, 5), (25, 18), (12, 17)],
    }
    for name, corners in low.items():
        contact = ts.Contact.polygon(corners)
        if name == "two":
            contact = ts.Contact((*contact.shapes, *contact.moved(60, 0).shapes))
        found = ts.reconstruct(ts.simulate(SENSOR, contact, NOISE, rng=6), SENSOR)
        assert SCALE not in found.advice, name


def test_a_file_is_doubted_as_a_whole_where_one_scan_says_too_little() -> None:
    """A small object that is put all over the sensor: read so, it never leaves a low stripe, and is flat."""
    sensor = replace(SENSOR, strips=40, pitch_mm=2.5, vref_volt=3.3, adc_bits=None)
    small = ts.Contact.polygon([(-8, -10), (9, -9), (8, 11), (-9, 10)])
    scans = [
        scaled(ts.simulate(sensor, small.placed(x, y), NOISE, rng=i), 1 / 3.3)
        for i, (x, y) in enumerate([(20, 20), (50, 85), (75, 50), (30, 60)])
    ]
    alone = [ts.reconstruct(scan, sensor, method="profile") for scan in scans]
    assert any(SCALE not in found.advice for found in alone)
    together = doubt_scale(alone, scans, sensor)
    assert all(found.status == "doubtful" and found.advice.count(SCALE) == 1 for found in together)
    healthy = [scaled(scan, 3.3) for scan in scans]
    assert doubt_scale(alone, healthy, sensor) == alone


def test_tracks_are_doubted_too() -> None:
    scans = [
        scaled(
            ts.simulate(
                SENSOR, SHAPES["quadrangle"].turned(0.03 * i).moved(0.3 * i, 0), NOISE, rng=i, time_s=0.01 * i
            ),
            0.2,
        )
        for i in range(5)
    ]
    live = ts.LiveTracks(SENSOR, NOISE)
    shown = [one for scan in scans for one in live.update(scan)]
    said = [(t.status, t.advice) for t in ts.track(scans, SENSOR, NOISE)]
    said += [(one.status, one.advice) for one in shown if len(one.outline)]
    assert all(status == "doubtful" and "write vref_volt = 1" in advice for status, advice in said)


def test_every_scale_that_the_readings_leave_is_named() -> None:
    """A third of the volts and a quarter of the codes look alike: the advice must not mend the wrong one."""
    sensor = ts.Sensor(
        construction="crs-crs", strips=12, pitch_mm=5.0, length_mm=80.0, vref_volt=3.3, adc_bits=12
    )
    shape = ts.Contact.polygon([(12, 30), (44, 22), (48, 60), (20, 66)])
    (found,) = ts.reconstruct(scaled(ts.simulate(sensor, shape), 0.25), sensor, NOISE).objects
    assert found.status == "doubtful"
    assert "write vref_volt = 1" in found.advice
    assert "write adc_bits = 10" in found.advice
