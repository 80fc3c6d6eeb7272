"""Lines with a labelled pair of values for each strip, whatever their labels, marks, heads, and lines between them."""

from __future__ import annotations

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.errors import OptionError, ReadingError
from tacstrip.io.log_import.guess import Proposal, propose
from tacstrip.io.log_import.questions import Unanswered
from tacstrip.io.log_import.text import of_text

_STRIPS, _SCANS = 4, 6
_SENSOR = ts.Sensor(
    construction="crs-crs", strips=_STRIPS, pitch_mm=8.0, length_mm=60.0, vref_volt=5.0, adc_bits=10
)
_VALUES = np.array(
    [
        [
            [612 + 7 * n + 13 * s, 401 + 5 * n - 9 * s] if abs(s - n / 2) < 1.6 and n != 3 else [np.nan] * 2
            for s in range(4)
        ]
        for n in range(_SCANS)
    ]
)
_PAIRS = [
    ("P{s}:{h}/{l}", " ", "xx"), ("S{s}[{h}|{l}]", " ", "--"), ("{s}: {h},{l}", "; ", "free"),
    ("ch{s}={h},{l}", " | ", "...."), ("T{s} {h}/{l}", ", ", "open"), ("#{s} ({h} {l})", " ", "n/a"),
]  # fmt: skip
_HEADS = [
    "t={ms} ms ",
    "Scan #{n} @ {ms}ms: ",
    "Frame {n} (t+{s:.2f} s): ",
    "I ({ms}) SKIN: ",
    "[12:00:{s:06.3f}] ",
]
_STRAYS = [
    "freeRam=5120", "servo moved to 35 deg", "batt 3.71V 62%", "wifi: rssi -71 dBm", "> start",
    "Traceback (most recent call last):",
]  # fmt: skip


def _line(scan: int, pair: str, between: str, nothing: str, head: str) -> str:
    made = []
    for s, (high, low) in enumerate(_VALUES[scan]):
        both = (nothing, nothing) if np.isnan(high) else (f"{high:.0f}", f"{low:.0f}")
        made.append(pair.format(s=s, h=both[0], l=both[1]))
    return head.format(n=scan, ms=1000 + 50 * scan, s=1 + 0.05 * scan) + between.join(made)


def _read(text: str, **answers: str) -> Proposal:
    return propose(of_text(text), _SENSOR, answers)


def _assert_read(found: Proposal, scans: list[int]) -> None:
    assert np.stack([scan.values for scan in found.scans]) == pytest.approx(_VALUES[scans], nan_ok=True)
    times = np.array([scan.time_s for scan in found.scans])
    assert times - times[0] == pytest.approx(0.05 * (np.array(scans) - scans[0]), abs=1e-6)


@pytest.mark.parametrize(("pair", "between", "nothing"), _PAIRS)
@pytest.mark.parametrize("head", _HEADS)
def test_labelled_pairs_among_strays(pair: str, between: str, nothing: str, head: str) -> None:
    lines = ["Skin shield v0.9 (Mega 2560), order: high|low, 10 bit", "SD card ok, 7580 MB free"]
    for n in range(_SCANS):
        lines += [_line(n, pair, between, nothing, head), *([_STRAYS[n]] if n % 3 else [])]
    _assert_read(_read("\n".join(lines) + "\n", unit="code"), [*range(_SCANS)])


@pytest.mark.parametrize("stray", _STRAYS)
def test_one_stray_loses_no_scan(stray: str) -> None:
    lines = [_line(n, "S{s}[{h}|{l}]", " ", "--", "t={ms} ms ") for n in range(_SCANS)]
    for at in (1, 3, _SCANS):
        _assert_read(
            _read("\n".join(["10 bit", *lines[:at], stray, *lines[at:]]) + "\n", unit="code"),
            [*range(_SCANS)],
        )


def test_the_payload_of_a_capture_is_read_beside_its_columns() -> None:
    lines = ["No.\tTime\tSource\tLength\tInfo"]
    for n in range(_SCANS):
        lines.append(
            f"{2 * n + 1}\t{0.05 * n:.6f}\t10.0.0.7\t{80 + n}\t" + _line(n, "{s}={h},{l}", " ", "-", "adc ")
        )
        lines += [f"{2 * n + 2}\t{0.05 * n + 0.01:.6f}\t10.0.0.1\t60\tARP who-has 10.0.0.7"] if n == 2 else []
    _assert_read(_read("\n".join(lines) + "\n", unit="code"), [*range(_SCANS)])


# What must not be read without a word.


@pytest.mark.parametrize("cut", [12, 20, 30])
def test_a_line_that_is_cut_is_left_out_and_named(cut: int) -> None:
    lines = [_line(n, "S{s}[{h}|{l}]", " ", "--", "t={ms} ms ") for n in range(_SCANS)]
    lines[2] = lines[2][:cut]
    text = "\n".join(["10 bit", *lines]) + "\n"
    found = _read(text, unit="code")
    _assert_read(found, [n for n in range(_SCANS) if n != 2])
    assert any("left out: line 4" in doubt for doubt in found.doubts)
    found = _read(text, unit="code", broken_lines="skip")
    _assert_read(found, [0, 1, 3, 4, 5])
    assert found.doubts


def test_two_senders_in_the_lines_heads_are_asked() -> None:
    lines = [
        _line(n, "S{s}[{h}|{l}]", " ", "--", f"{('left', 'right')[n % 2]} t={{ms}} ms ")
        for n in range(_SCANS)
    ]
    with pytest.raises(Unanswered) as asked:
        _read("\n".join(lines) + "\n", unit="code")
    question = next(q for q in asked.value.questions if q.key == "source")
    _assert_read(_read("\n".join(lines) + "\n", unit="code", source=question.choices[0]), [0, 2, 4])


def test_low_before_high_is_told_by_the_readings() -> None:
    lines = [_line(n, "S{s}[{l}|{h}]", " ", "--", "t={ms} ms ") for n in range(_SCANS)]
    _assert_read(_read("\n".join(lines) + "\n", unit="code"), [*range(_SCANS)])


def test_three_values_for_a_strip_are_no_pairs() -> None:
    lines = [_line(n, "S{s}[{h}|{l}|7]", " ", "--", "t={ms} ms ") for n in range(_SCANS)]
    try:
        found = _read("\n".join(lines) + "\n", unit="code")
    except (Unanswered, ReadingError, OptionError):
        return
    assert found.doubts
