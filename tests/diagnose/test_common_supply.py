"""A ground or supply wire that all strips lose together, told from contacts that jump."""

import numpy as np
import pytest

from tacstrip.arrays import FloatArray
from tacstrip.diagnose import Log
from tacstrip.diagnose.common_supply import loose_supply
from tacstrip.sensor.spec import Sensor

_SCANS, _STRIPS, _LENGTH_MM = 240, 6, 100.0
_SENSOR = Sensor(construction="crs-crs", strips=_STRIPS, pitch_mm=5.0, length_mm=_LENGTH_MM)
_METAL = Sensor(construction="crs-m", strips=_STRIPS, pitch_mm=5.0, length_mm=_LENGTH_MM)
_TIME_S = np.linspace(0.0, 0.01 * (_SCANS - 1), _SCANS)
_LOST = (np.arange(_SCANS) // 12) % 3 == 2  # 12 of 36 scans


def _readings(low: FloatArray, length: FloatArray) -> FloatArray:
    """k_h and k_l of (3.3), (3.4) (2, scans, strips), with noise."""
    k = np.stack([low + length, low]) / (2.0 * _LENGTH_MM - length)
    return np.asarray(k + np.random.default_rng(3).normal(0.0, 0.002, k.shape))


def _slide() -> tuple[FloatArray, FloatArray]:
    """Lower ends and lengths (scans, strips) [mm] of a round contact that goes to and fro along the strips."""
    middle = 45.0 + 30.0 * np.sin(np.linspace(0.0, 11.0, _SCANS))[:, None]
    half = np.broadcast_to(np.array([4.0, 9.0, 11.0, 10.0, 7.0, 3.0]), (_SCANS, _STRIPS))
    return middle - half, 2.0 * half


@pytest.mark.parametrize(("fault", "rail"), [("loose-ground", 1.0), ("loose-supply", 0.0)])
@pytest.mark.parametrize("sensor", [_SENSOR, _METAL])
def test_a_wire_that_all_strips_lose_is_named(sensor: Sensor, fault: str, rail: float) -> None:
    low, length = _slide()
    k = _readings(low, length) if sensor is _SENSOR else (low / (_LENGTH_MM - length))[None]
    k = np.where(_LOST[:, None], k + 0.2 * (rail - k), k)
    log = Log.of(sensor, _TIME_S, dict(zip(sensor.signatures, k, strict=True)))
    findings, questions, unchecked = loose_supply(log)
    assert [(f.fault, f.strips) for f in findings] == [(fault, ())]
    assert findings[0].numbers["share"] == pytest.approx(0.2, abs=0.01)
    assert not questions
    assert not unchecked


def test_one_strip_that_loses_its_ground_is_not_all_of_them() -> None:
    k = _readings(*_slide())
    k[:, _LOST, 2] = 0.2 + 0.8 * k[:, _LOST, 2]
    findings, questions, _ = loose_supply(Log.of(_SENSOR, _TIME_S, {"kh": k[0], "kl": k[1]}))
    assert not findings
    assert not questions


@pytest.mark.parametrize("grown", [1.0, 0.7])
def test_a_contact_that_jumps_or_is_let_go_by_half_is_no_loose_wire(grown: float) -> None:
    low, length = _slide()
    low = low + np.where(_LOST, 20.0 if grown == 1.0 else 0.0, 0.0)[:, None]
    length = length * np.where(_LOST, grown, 1.0)[:, None]
    k = _readings(low, length)
    findings, questions, unchecked = loose_supply(Log.of(_SENSOR, _TIME_S, {"kh": k[0], "kl": k[1]}))
    assert not findings
    assert not questions
    assert "push a contact over both ends" in unchecked


def test_a_wire_lost_and_found_once_is_a_question() -> None:
    k = _readings(*_slide())
    k[:, 100:140] = 0.2 + 0.8 * k[:, 100:140]
    findings, questions, _ = loose_supply(Log.of(_SENSOR, _TIME_S, {"kh": k[0], "kl": k[1]}))
    assert not findings
    assert [(q.strips, q.causes) for q in questions] == [((), ("loose-ground",))]
    assert "Press at three heights in turn while you move the wires" in questions[0].ask()
