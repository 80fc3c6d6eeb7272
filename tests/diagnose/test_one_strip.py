"""One strip against the others: gone for a stretch, noisier, with hum of its own, its two wires exchanged."""

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.diagnose import Log, diagnose
from tacstrip.diagnose.channels import not_moving
from tacstrip.diagnose.drift import _outstanding_at_rest
from tacstrip.diagnose.hum import _mains_lines
from tacstrip.diagnose.lost import lost
from tacstrip.diagnose.neighbour_prediction import working_copy

pytestmark = pytest.mark.usefixtures("no_outline")
_STRIPS, _SCANS, _RATE_HZ = 16, 700, 43.0
_SENSOR = ts.Sensor(
    construction="crs-crs", strips=_STRIPS, pitch_mm=5.0, length_mm=100.0, rest_volt=0.1, touch_volt=0.15
)


def _recording(gap: bool = False, length: float = 0.08) -> tuple[np.ndarray, np.ndarray]:
    """Return times (scans,) and k_h, k_l over Vref (2, scans, strips) of a slanted bar dragged to and fro.

    `gap`: of two bars side by side, a strip apart; `length`: of the bar along the strips, of theirs.
    """
    rng = np.random.default_rng(3)
    share = np.linspace(0.0, 1.0, _SCANS)
    middle = 8.0 + 9.0 * np.sin(2.0 * np.pi * 4.0 * share)
    height = 0.5 + 0.25 * np.sin(2.0 * np.pi * 1.3 * share)
    slope = 0.015 * np.sin(2.0 * np.pi * 6.7 * share)
    off = np.arange(_STRIPS) + 0.5 - middle[:, None]
    middle_of_it = height[:, None] + slope[:, None] * off
    low, up = (np.clip(middle_of_it + side * length / 2.0, 0.0, 1.0) for side in (-1.0, 1.0))
    wide = up - low
    there = (np.abs(off) < 3.2) & ~(gap & (np.abs(off) < 0.5))
    whole = 1.0 - wide / 2.0  # sensing strips of the same rubber
    k = np.stack([(low + wide / 2.0) / whole, low / whole])
    k = np.where(there, k, 0.02) + 0.001 * rng.normal(size=k.shape)
    return np.arange(_SCANS) / _RATE_HZ, k


def _said(
    time_s: np.ndarray, k: np.ndarray
) -> tuple[list[tuple[str, tuple[int, ...]]], list[tuple[int, ...]]]:
    report = diagnose(Log.of(_SENSOR, time_s, {"kh": k[0], "kl": k[1]}))
    return [(f.fault, f.strips) for f in report.findings], [q.strips for q in report.questions]


@pytest.mark.parametrize("until", [0.7, 2.0])
def test_a_strip_that_is_gone_for_a_stretch_or_from_then_on(until: float) -> None:
    time_s, k = _recording()
    gone = (time_s > 0.4 * time_s[-1]) & (time_s < until * time_s[-1])
    k[:, gone, 6] = 0.02
    assert _said(time_s, k) == ([("intermittent", (6,))], [])


def test_a_gap_between_two_bars_is_no_strip_that_is_gone() -> None:
    assert _said(*_recording(gap=True))[0] == []


def test_a_strip_that_is_gone_now_and_then_under_a_contact_that_moves() -> None:
    time_s, k = _recording()
    k[:, (np.arange(_SCANS) // 5) % 4 == 0, 6] = 0.02
    findings, questions = lost(working_copy(Log.of(_SENSOR, time_s, {"kh": k[0], "kl": k[1]}), 0.001))
    assert [(f.fault, f.strips) for f in findings] == [("intermittent", (6,))]
    assert findings[0].numbers["share"] == pytest.approx(0.25, abs=0.05)
    assert questions == []


def test_one_strip_has_four_times_the_noise() -> None:
    time_s, k = _recording()
    k[:, :, 9] += np.sqrt(15.0) * 0.001 * np.random.default_rng(5).normal(size=k.shape[:2])
    assert _said(time_s, k) == ([("noise", (9,))], [])


def test_hum_on_one_strip_in_short_visits() -> None:
    time_s, k = _recording()
    k[:, :, 4] += 0.004 * np.sin(2.0 * np.pi * 60.0 * time_s)
    assert ("hum", (4,)) in _said(time_s, k)[0]


@pytest.mark.parametrize("strip", [0, 7, _STRIPS - 1])
def test_exchanged_wires_of_small_contacts(strip: int) -> None:
    time_s, k = _recording()
    k[:, :, strip] = k[::-1, :, strip].copy()
    findings, asked = _said(time_s, k)
    assert findings == [("swapped-wires", (strip,))] or (strip != 7 and asked == [(strip,)])


def test_exchanged_wires_of_contacts_that_hang_over_an_end() -> None:
    time_s, k = _recording(length=0.7)
    k[:, :, 6] = k[::-1, :, 6].copy()
    assert _said(time_s, k)[0] == [("swapped-wires", (6,))]


def test_exchanged_strips_that_are_no_neighbours() -> None:
    time_s, k = _recording()
    k[:, :, [4, 11]] = k[:, :, [11, 4]]
    assert _said(time_s, k) == ([("swapped-strips", (4, 11))], [])


def test_three_strips_in_the_wrong_order() -> None:
    time_s, k = _recording()
    k[:, :, [5, 6, 7]] = k[:, :, [6, 7, 5]]
    assert _said(time_s, k) == ([("swapped-strips", (5, 6, 7))], [])


def test_a_joint_that_drops_out_by_a_part() -> None:
    time_s, k = _recording()
    rng = np.random.default_rng(8)
    out = (rng.random(_SCANS) < 0.1) & (k[0, :, 6] > 0.1)
    k[0, out, 6] = rng.uniform(0.06, 0.2, int(out.sum()))
    findings, asked = _said(time_s, k)
    assert findings == [("intermittent", (6,))] or asked == [(6,)]


def test_the_same_recording_without_a_fault() -> None:
    assert _said(*_recording()) == ([], [])


def test_drift_at_rest_beside_a_strip_with_one_stray_level() -> None:
    rng = np.random.default_rng(3)
    level = rng.normal(0.0, 0.0006, (32, 12))
    level[:, 5] += 0.011 * (np.arange(32.0) / 31.0 - 0.5)
    every = level[None].copy()
    every[0, 30, 4] = -0.05  # a contact at the ground end
    found = list(_outstanding_at_rest(level, every, np.full(level.shape, 0.0006), np.arange(12)))
    assert [(f.fault, f.strips) for f in found] == [("drift", (5,))]


@pytest.mark.parametrize("others", [0.0007, 0.005])
def test_a_line_that_short_visits_widen_is_louder_than_on_other_strips(others: float) -> None:
    size = np.full(10, others)
    size[4] = 0.007
    near = np.where(np.arange(10) == 4, 0.007**2 / 12.0, others**2)
    power = np.repeat(np.stack([size**2, near])[:, None], 8, axis=1) * 50.0  # (2, segments, strips)
    nothing = np.zeros_like(power)
    found = _mains_lines([power, nothing], [np.full((8, 10), 50.0), nothing[0]], 0.001, True)
    assert [f.strips for f in found] == ([(4,)] if others < 0.001 else [])


@pytest.mark.parametrize("rests", [True, False])
def test_a_strip_that_keeps_its_reading_beside_strips_that_do(rests: bool) -> None:
    rng = np.random.default_rng(4)
    moves = rng.uniform(0.6, 0.99, 60)
    k = np.full((60, 13), np.nan)
    k[:, 2:8] = 0.56 if rests else moves[:, None]
    k[:, 8:10], k[:, 10] = moves[:, None], 0.625
    k += rng.normal(0.0, 0.001, k.shape)
    sensor = ts.Sensor(construction="crs-m", strips=13, pitch_mm=6.0, length_mm=275.0)
    log = Log.of(sensor, np.arange(60.0), {"k": k})
    found = [s.finding.strips for s in not_moving(working_copy(log, 0.001))]
    assert found == ([] if rests else [(10,)])
