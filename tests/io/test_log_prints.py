"""What pandas, spreadsheets, prompts and databases print around and within a table of readings."""

from __future__ import annotations

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.errors import OptionError, ReadingError
from tacstrip.io.log_import.guess import Proposal, propose
from tacstrip.io.log_import.questions import Unanswered
from tacstrip.io.log_import.text import of_text

_STRIPS, _SCANS = 3, 6
_SENSOR = ts.Sensor(construction="crs-crs", strips=_STRIPS, pitch_mm=8.0, length_mm=60.0, vref_volt=5.0)
_MV = np.array(
    [
        [[1950 + 123 * n + 31 * s, 940 + 57 * n - 9 * s] if s != n % 4 else [np.nan] * 2 for s in range(3)]
        for n in range(_SCANS)
    ]
)  # fmt: skip


def _read(text: str, **answers: str) -> Proposal:
    return propose(of_text(text), _SENSOR, answers)


def _assert_read(text: str, scale: float = 1.0, step_s: float = 0.05, **answers: str) -> None:
    found = _read(text, **answers)
    assert np.stack([scan.values for scan in found.scans]) == pytest.approx(_MV * scale, nan_ok=True)
    times = [scan.time_s for scan in found.scans]
    assert np.array(times) - times[0] == pytest.approx(step_s * np.arange(_SCANS), abs=1e-6)


def _thousands(unit: str, end: str = "", step: str = "{}") -> str:
    def cell(value: float) -> str:
        return "none" if np.isnan(value) else f'"{value:,.0f}"' if value >= 1000 else f"{value:.0f}"

    head = "Time (s)," + ",".join(f"Strip {s} {e} ({unit})" for s in range(3) for e in ("high", "low"))
    rows = [f"{step.format(n)}," + ",".join(cell(v) for v in _MV[n].ravel()) for n in range(_SCANS)]
    return "\n".join([head, *rows, *([end] if end else [])]) + "\n"


def test_thousands_in_quotes_where_the_names_say_millivolts() -> None:
    _assert_read(_thousands("mV"), step_s=1.0)


@pytest.mark.parametrize("unit", ["V", "Volt"])
def test_thousands_that_may_be_decimals_are_refused(unit: str) -> None:
    with pytest.raises((ReadingError, Unanswered, OptionError)):
        _read(_thousands(unit))


@pytest.mark.parametrize(
    "word",
    ["Mean", "Std Dev.", "Mittelwert", "Standardabweichung", "Moyenne", "\u00c9cart-type", "M\u00e9dia",
     "Desvio padr\u00e3o", "Promedio", "Desviaci\u00f3n", "Media", "Gemiddelde", "M\u00e1ximo"],
)  # fmt: skip
def test_rows_of_statistics_below_the_table(word: str) -> None:
    _assert_read(_thousands("mV", f'{word},"1,900",900,"1,910",910,"1,920",920'), step_s=1.0)


@pytest.mark.parametrize("head", ["{} {}", "({}, {})", "{}: {}", "[{}, {}]"])
@pytest.mark.parametrize("nothing", [None, (None, None)])
def test_lists_behind_a_time_among_prompts(head: str, nothing: object) -> None:
    lines = [
        ">>> %Run -c $EDITOR_CONTENT",
        "MPY: soft reboot",
        "Raspberry Pi Pico, (high, low) of 3 strips in mV",
    ]
    for n in range(_SCANS):
        pairs = [nothing if np.isnan(h) else (int(h), int(v)) for h, v in _MV[n]]
        lines.append(head.format(48213 + 50 * n, pairs))
    lines += [
        "Traceback (most recent call last):",
        '  File "<stdin>", line 31, in <module>',
        "KeyboardInterrupt: ",
        ">>> ",
    ]
    _assert_read("\n".join(lines) + "\n", unit="mV")


@pytest.mark.parametrize("check", ["CHECK(e IN ('HI','LO'))", "NOT NULL DEFAULT ('HI')", "-- high, or low"])
def test_a_dump_of_two_tables_with_checks(check: str) -> None:
    column = f"  e TEXT, {check}\n" if check.startswith("--") else f"  e TEXT {check},\n"
    text = "CREATE TABLE motor (ms INTEGER, ma REAL);\nINSERT INTO motor VALUES(1000,412.5);\n"
    text += "CREATE TABLE taps (\n  id INTEGER PRIMARY KEY,\n  ms INTEGER, -- millis(), since boot\n"
    text += f"  strip INTEGER,\n{column}  mv INTEGER\n);\n"
    rows = [(n, s, e) for n in range(_SCANS) for s in range(3) for e in (0, 1)]
    for k, (n, s, e) in enumerate(rows):
        value = "NULL" if np.isnan(_MV[n, s, e]) else f"{_MV[n, s, e]:.0f}"
        text += f"INSERT INTO taps VALUES({k},{1000 + 50 * n},{s},'{'LO' if e else 'HI'}',{value});\n"
    _assert_read(text + "CREATE INDEX i ON taps(ms);\nCOMMIT;\n", unit="mV")
