"""A channel whose field stays empty, and untouched strips that have readings where the spec gives no rest level."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.diagnose import Log, diagnose

SENSOR = ts.Sensor(construction="crs-crs", strips=8, pitch_mm=5.0, length_mm=100.0)


@pytest.fixture(scope="module")
def readings() -> dict[str, np.ndarray[tuple[int, ...], np.dtype[np.float64]]]:
    """Fifty scans of a bar that moves over all strips (scans, strips)."""
    heights = 45.0 + 25.0 * np.sin(np.linspace(0.0, 12.0, 50))
    bars = [ts.Contact.polygon([(0, y), (40, y + 5), (40, y + 20), (0, y + 12)]) for y in heights]
    scans = [ts.simulate(SENSOR, bar, ts.Noise(positional=0.002), rng=i) for i, bar in enumerate(bars)]
    return {name: np.stack([scan[name] for scan in scans]) for name in SENSOR.signatures}


@pytest.mark.parametrize(("name", "channel"), [("kh", "3:v_h"), ("kl", "3:v_l")])
def test_an_empty_channel_is_dead_unless_the_spec_leaves_it_out(
    readings: dict[str, np.ndarray[tuple[int, ...], np.dtype[np.float64]]], name: str, channel: str
) -> None:
    raw = readings | {name: readings[name].copy()}
    raw[name][:, 3] = np.nan
    times = 0.02 * np.arange(50.0)
    (found,) = diagnose(Log.of(SENSOR, times, raw)).findings
    assert (found.fault, found.strips, found.signature) == ("dead", (3,), name)
    report = diagnose(Log.of(replace(SENSOR, without=(channel,)), times, raw))
    assert not report.findings
    assert f"{channel}: left out by the spec (without)" in report.unchecked


@pytest.mark.parametrize("level", [np.nan, 0.4])
@pytest.mark.parametrize("strip", [0, -1])
def test_a_channel_of_the_outermost_strip_that_reads_nothing_or_one_value(
    strip: int, level: float, readings: dict[str, np.ndarray[tuple[int, ...], np.dtype[np.float64]]]
) -> None:
    raw = {name: values.copy() for name, values in readings.items()}
    raw["kh"][:, strip] = level
    (found,) = diagnose(Log.of(SENSOR, 0.02 * np.arange(50.0), raw)).findings
    fault = "dead" if np.isnan(level) else "stuck"
    assert (found.fault, found.strips, found.signature) == (fault, (strip % SENSOR.strips,), "kh")


def test_one_signature_alone_is_no_dead_channel(
    readings: dict[str, np.ndarray[tuple[int, ...], np.dtype[np.float64]]],
) -> None:
    assert not diagnose(Log.of(SENSOR, 0.02 * np.arange(50.0), {"kh": readings["kh"]})).findings


def test_strips_at_rest_do_not_come_and_go_where_the_rest_level_is_not_given() -> None:
    y = 40.0 + 10.0 * np.sin(np.linspace(0.0, 40.0, 200))
    x = 20.0 + 12.0 * np.sin(
        np.linspace(0.0, 30.0, 200)
    )  # over three strips or four, from one side to the other
    raw = {name: np.full((200, 8), 0.0006) for name in SENSOR.signatures}
    for i in range(200):
        bar = ts.Contact.polygon(
            [(x[i] - 8, y[i]), (x[i] + 8, y[i]), (x[i] + 8, y[i] + 20), (x[i] - 8, y[i] + 20)]
        )
        scan = ts.simulate(SENSOR, bar)
        for name, k in raw.items():
            k[i, scan.touched] = scan[name][scan.touched]
    report = diagnose(Log.of(SENSOR, 0.02 * np.arange(200.0), raw))
    assert "intermittent" not in {f.fault for f in report.findings}
    assert "intermittent contacts: the rest level is not given" in report.unchecked
    assert any(n.fault == "rest-level" for n in report.notes)
