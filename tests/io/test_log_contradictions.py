"""Logs that contradict themselves, or fit two ways of reading: nothing of it passes without a word."""

from __future__ import annotations

import pytest

import tacstrip as ts
from tacstrip.io.log_import.guess import Proposal, propose
from tacstrip.io.log_import.questions import Unanswered
from tacstrip.io.log_import.text import of_text

_VOLTS = ts.Sensor(construction="crs-crs", strips=4, pitch_mm=8.0, length_mm=60.0, vref_volt=5.0)
_CODES = ts.Sensor(construction="crs-crs", strips=4, pitch_mm=8.0, length_mm=60.0, vref_volt=5.0, adc_bits=10)
_SCANS = 12


def _read(text: str, sensor: ts.Sensor = _VOLTS, **answers: str) -> Proposal:
    return propose(of_text(text), sensor, answers)


def _volts(names: str, above: str = "", below: str = "", amid: str = "") -> str:
    lines = [above] * bool(above) + [f"{names},strip,h [V],l [V]"]
    for n in range(_SCANS):
        lines += [amid] * (n == 5 and bool(amid))
        lines += [f"{20 * n},{s},{2.5 + 0.05 * n + 0.1 * s:.3f},{1.5 + 0.04 * n:.3f}" for s in range(4)]
    return "\n".join([*lines, *[below] * bool(below)]) + "\n"


def _codes(names: str = "t_ms,strip,upper,lower", size: int = 1, wide: bool = False) -> list[str]:
    lines = ["t_ms," + ",".join(f"h{s},l{s}" for s in range(4)) if wide else names]
    for n in range(_SCANS):
        row = [f"{200 * size + 7 * n + 5 * s},{130 * size + 6 * n + 5 * s}" for s in range(4)]
        lines += (
            [f"{20 * n},{','.join(row)}"] if wide else [f"{20 * n},{s},{both}" for s, both in enumerate(row)]
        )
    return lines


@pytest.mark.parametrize(
    "place",
    [
        {"above": "# sampled at 50 Hz"}, {"above": "# 50 Hz sampling rate"}, {"above": "# interval 20 ms"},
        {"below": "# sampled at 50 Hz"}, {"amid": "# sampled at 50 Hz"},
    ],
)  # fmt: skip
def test_a_time_that_contradicts_the_rate_is_asked(place: dict[str, str]) -> None:
    text = _volts("time (s)", **place)
    with pytest.raises(Unanswered) as asked:
        _read(text)
    (question,) = asked.value.questions
    assert (question.key, question.choices) == ("time_unit", ("ms", "s"))
    assert _read(text, time_unit="ms").scans[1].time_s == pytest.approx(0.02)
    assert _read(text, time_unit="s").scans[1].time_s == pytest.approx(20.0)


@pytest.mark.parametrize("above", ["# sampled at 50 Hz", "# sampling rate 1000 Hz", "# interval 20 ms", ""])
def test_a_rate_of_the_scans_or_of_their_samples_contradicts_nothing(above: str) -> None:
    assert not _read(_volts("t_ms", above)).doubts


@pytest.mark.parametrize("above", ["# sampled at 10 Hz", "# sampling rate: 90 kHz"])
def test_a_rate_that_the_time_has_in_no_unit_is_a_doubt(above: str) -> None:
    assert any("Hz" in doubt for doubt in _read(_volts("t_ms", above)).doubts)


def test_an_answered_rate_beside_a_time_is_used_or_named() -> None:
    found = _read(_volts("time (s)"), rate_hz="50")
    assert found.mapping.time_unit == "ms"
    assert any("50" in doubt for doubt in found.doubts)
    found = _read(_volts("t_ms"), rate_hz="30")
    assert found.mapping.time_unit == "ms"
    assert any("taken as it stands" in doubt for doubt in found.doubts)
    assert not _read(_volts("t_ms"), rate_hz="50").doubts


def test_whole_numbers_that_may_be_millivolts_or_codes_are_doubted_unless_told() -> None:
    text = "\n".join(_codes()) + "\n"
    found = _read(text, _CODES)
    assert found.mapping.unit == "code"
    assert any("unit=mV" in doubt for doubt in found.doubts)
    assert not _read(text, _CODES, unit="code").doubts
    assert not _read("# raw ADC counts\n" + text, _CODES).doubts
    assert not _read("\n".join(_codes(size=3)) + "\n", _CODES).doubts  # by its size


@pytest.mark.parametrize("wide", [True, False])
@pytest.mark.parametrize("lost", [0, 1, 2])
def test_a_line_of_codes_that_is_cut_in_its_last_number_is_a_doubt(lost: int, wide: bool) -> None:
    lines = _codes(size=3, wide=wide)
    cut = 6 if wide else 22
    lines[cut] = lines[cut][: len(lines[cut]) - lost]
    found = _read("\n".join(lines) + "\n", _CODES)
    assert [f"line {cut + 1} " in doubt and "cut there?" in doubt for doubt in found.doubts] == [True] * bool(
        lost
    )


def test_a_strip_that_comes_near_its_end_is_not_cut() -> None:
    lines = ["t_ms,strip,upper,lower"]
    for n, low in enumerate([150, 120, 101, 99, 80, 60, 99, 103, 130]):
        lines += [f"{20 * n},{s},{700 + n + s},{low + 200 * (s < 3)}" for s in range(4)]
    assert not _read("\n".join(lines) + "\n", _CODES).doubts
