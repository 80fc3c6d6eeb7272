"""Broken lines: left out with a warning where no scan in the middle can be lost by that, else asked."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.errors import OptionError, ReadingError
from tacstrip.io.log_import.guess import Proposal, propose
from tacstrip.io.log_import.mapping import ColumnMapping
from tacstrip.io.log_import.questions import Unanswered
from tacstrip.io.log_import.text import of_text

_SENSOR = ts.Sensor(
    construction="crs-crs", strips=3, pitch_mm=8.0, length_mm=60.0, vref_volt=3.3, adc_bits=12
)
_SCANS = 9
_VOLTS = np.array([[[2.1 + n / 50 + s / 7, 1.1 + n / 60 + s / 9] for s in range(3)] for n in range(_SCANS)])
_NAMES = "t_ms,h0_V,l0_V,h1_V,l1_V,h2_V,l2_V"
_ROWS = [",".join([str(20 * n), *(f"{v:.4f}" for v in _VOLTS[n].ravel())]) for n in range(_SCANS)]


def _read(*lines: str, end: str = "\n", **answers: str) -> Proposal:
    return propose(of_text("\n".join(lines) + end), _SENSOR, answers)


def _assert_scans(found: Proposal, scans: list[int]) -> None:
    volts = np.stack([s.values for s in found.scans]) * (1e-3 if found.mapping.unit == "mV" else 1.0)
    assert volts == pytest.approx(_VOLTS[scans], abs=1e-4)
    assert [s.time_s for s in found.scans] == pytest.approx([0.02 * (n - scans[0]) for n in scans], abs=1e-6)


@pytest.mark.parametrize("cut", [5, 12, 19, 26, 33])
def test_a_last_line_that_is_cut_is_left_out_with_a_warning(cut: int) -> None:
    found = _read(_NAMES, *_ROWS[:-1], _ROWS[-1][:-cut], end="")
    _assert_scans(found, [*range(_SCANS - 1)])
    assert any("left out: line 10" in doubt for doubt in found.doubts)


@pytest.mark.parametrize(
    "words",
    [
        ("Mittelwert", "Max"),
        ("\u5e73\u5747", "\u6700\u5927"),
        ("keskiarvo", "suurin"),
        ("\u0441\u0440", "\u043c\u0430\u043a\u0441"),
    ],
)
def test_statistics_in_whichever_words_are_left_out(words: tuple[str, str]) -> None:
    below = [f"{words[0]}," + ",".join(f"{v:.4f}" for v in _VOLTS.mean(0).ravel())]
    below += [f"{words[1]}," + ",".join(f"{v:.4f}" for v in _VOLTS.max(0).ravel())]
    _assert_scans(_read(_NAMES, *_ROWS, *below), [*range(_SCANS)])


@pytest.mark.parametrize("line", ["WARN usb late by 4.1 ms", "rssi -71 dBm ch 6", "battery 3.71", "12 87"])
def test_a_line_between_even_scans_loses_none(line: str) -> None:
    _assert_scans(_read(_NAMES, *_ROWS[:4], line, *_ROWS[4:]), [*range(_SCANS)])


@pytest.mark.parametrize("cut", [7, 12, 26])
def test_a_scan_that_is_cut_in_the_middle_is_left_out_with_a_warning(cut: int) -> None:
    found = _read(_NAMES, *_ROWS[:4], _ROWS[4][:-cut], *_ROWS[5:])
    _assert_scans(found, [n for n in range(_SCANS) if n != 4])
    assert any("left out: line 6" in doubt for doubt in found.doubts)


def test_a_row_that_lacks_a_field_is_left_out_and_no_other_strip_is_read() -> None:
    rows = [row.replace(",", " ") for row in _ROWS]
    found = _read(
        _NAMES.replace(",", " "), *rows[:4], rows[4].replace(" ", "!", 1).partition("!")[2], *rows[5:]
    )
    _assert_scans(found, [n for n in range(_SCANS) if n != 4])


@pytest.mark.parametrize("line", ["80: no contact", "80;2.5;1.2;2.6;1.3;2.7;1.4"])
def test_a_line_that_may_be_a_whole_scan_is_asked(line: str) -> None:
    with pytest.raises(Unanswered, match="broken_lines"):
        _read(_NAMES, *_ROWS[:4], line, *_ROWS[5:])


def test_several_rows_of_numbers_of_another_form_at_the_end_are_asked() -> None:
    with pytest.raises(Unanswered, match="broken_lines"):
        _read(_NAMES, *_ROWS, "180,2.2,1.1,2.3", "200,2.3,1.2,2.4")


def test_a_line_that_lacks_its_time_is_not_cut() -> None:
    with pytest.raises(Unanswered):
        _read(_NAMES, *_ROWS[:-1], "," + ",".join(_ROWS[-1].split(",")[2:]))


@pytest.mark.parametrize("boot", [True, False])
def test_ticks_of_esp_idf_before_a_line_for_each_strip_are_the_time(boot: bool) -> None:
    rom = [
        "rst:0x1 (POWERON_RESET),boot:0x13",
        "mode:DIO, clock div:2",
        "load:0x3fff0030,len:7176",
        "entry 0x40080694",
    ]
    rows = [
        f"I ({1420 + 20 * n}) skin: strip {s} hi {1000 * h:.1f} mV, lo {1000 * low:.1f} mV"
        for n in range(_SCANS) for s, (h, low) in enumerate(_VOLTS[n])
    ]  # fmt: skip
    rows.insert(12, "I (1499) wifi:state: run -> init (0x6c0)")
    _assert_scans(_read(*rom * boot, "I (31) boot: ESP-IDF v5.1.2", *rows), [*range(_SCANS)])


def test_a_count_of_frames_and_their_length_are_no_sensors() -> None:
    names = "frame.number\tframe.time_relative\tframe.len\tdata.text"
    rows = [
        f"{n + n // 3 + 1}\t{0.02 * n:.6f}\t{98 + n % 3}\tmV "
        + " ".join(f"{s}:{1000 * h:.1f}/{1000 * low:.1f}" for s, (h, low) in enumerate(_VOLTS[n]))
        for n in range(_SCANS)
    ]
    rows.insert(4, "5\t0.057100\t87\t")
    _assert_scans(_read(names, *rows), [*range(_SCANS)])
    _assert_scans(_read(*rows), [*range(_SCANS)])


@pytest.mark.parametrize("said", ["Vref = 4,62 V", "Vcc: 4.62 V", "AREF 4620 mV"])
def test_another_vref_in_the_log_is_a_question_with_both(said: str) -> None:
    sensor = ts.Sensor(construction="crs-crs", strips=3, pitch_mm=8.0, length_mm=60.0, vref_volt=5.0)
    table = of_text("\n".join([f"# {said}", _NAMES, *_ROWS]) + "\n")
    with pytest.raises(Unanswered, match=r"vref_volt=4.62 or --answer vref_volt=5"):
        propose(table, sensor)
    assert propose(table, sensor, {"vref_volt": "4.62"}).mapping.vref_volt == 4.62
    assert propose(table, sensor, {"vref_volt": "5"}).mapping.vref_volt == 0.0  # that of the spec


@pytest.mark.parametrize("above", [0, 4])
def test_names_again_behind_the_times_of_a_terminal(above: int) -> None:
    boot = [
        "Welcome to minicom 2.8",
        "OPTIONS: I18n",
        "Port /dev/ttyUSB0, 09:14:20",
        "Press CTRL-A Z for help",
    ]
    rows = boot[:above]
    for n, row in enumerate(_ROWS):
        time = f"[2025-06-11 09:14:{32 + 0.02 * n:06.3f}] "
        rows += [time + "  h0   l0   h1   l1   h2   l2"] * (n % 4 == 0)
        rows.append(time + ("....  " * 6 if n == 2 else row.partition(",")[2].replace(",", "  ")))
    found = _read(*rows, unit="V")
    assert np.isnan(found.scans[2].values).all()
    found.scans[2].values[:] = _VOLTS[2]
    _assert_scans(found, [*range(_SCANS)])


def test_names_in_another_order_behind_a_time_are_not_passed_over() -> None:
    rows = []
    for n, row in enumerate(_ROWS):
        time = f"[2025-06-11 09:14:{32 + 0.02 * n:06.3f}] "
        rows += [time + ("h0 l0 h1 l1 h2 l2" if n < 4 else "l0 h0 l1 h1 l2 h2")] * (n % 4 == 0)
        values = row.split(",")[1:]
        values = values if n < 4 else [values[k] for k in (1, 0, 3, 2, 5, 4)]
        rows.append(time + " ".join(values))
    try:
        found = _read(*rows, unit="V")
    except (Unanswered, ReadingError):
        return
    _assert_scans(found, [*range(_SCANS)])


def _long(skip: tuple[tuple[int, int], ...] = (), nothing: bool = True) -> str:
    """Return a line for each strip, but for some; strip 2 is touched in no scan of an even number."""
    rows = ["t_ms,strip,h_V,l_V"]
    for n in range(_SCANS):
        for s, (high, low) in enumerate(_VOLTS[n]):
            idle = s == 2 and n % 2 == 0
            if (n, s) not in skip and (nothing or not idle):
                rows.append(f"{20 * n},{s}," + ("," if idle else f"{high:.4f},{low:.4f}"))
    return "\n".join(rows) + "\n"


def test_scans_that_lost_a_line_are_left_out_where_untouched_strips_have_theirs() -> None:
    found = propose(of_text(_long(((3, 1),))), _SENSOR)
    assert found.mapping.missing == "skip"
    assert [round(50.0 * s.time_s) for s in found.scans] == [0, 1, 2, 4, 5, 6, 7, 8]
    assert any("1 scan(s) left out, from line(s) 11" in doubt for doubt in found.doubts)
    with pytest.raises(Unanswered, match="missing=untouched"):  # it may be untouched, as others may
        propose(of_text(_long(((3, 1),), nothing=False)), _SENSOR)


def test_a_lost_pair_of_named_values_is_no_sign_of_no_contact() -> None:
    pairs = [[f"h{s}={h:.3f}V l{s}={low:.3f}V" for s, (h, low) in enumerate(scan)] for scan in _VOLTS]
    rows = [
        f"t={20 * n}ms bat=4.{n}V " + " ".join(scan[: 2 if n == 4 else 3]) for n, scan in enumerate(pairs)
    ]
    with pytest.raises(Unanswered):  # a line that is cut, in a log that has all strips elsewhere
        _read(*rows)
    many = [3, 3, 2, 1, 0, 0, 0, 1, 2]
    found = _read(*(f"t={20 * n}ms bat=4.{n}V " + " ".join(scan[: many[n]]) for n, scan in enumerate(pairs)))
    assert [int(np.isfinite(s.values).any(axis=1).sum()) for s in found.scans] == many


def test_a_tick_of_a_timer_is_a_unit_of_time(tmp_path: Path) -> None:
    rows = [",".join([str(8 * n), *row.split(",")[1:]]) for n, row in enumerate(_ROWS)]
    found = _read(_NAMES.replace("t_ms", "tick"), *rows, time_unit="2.5ms")
    _assert_scans(found, [*range(_SCANS)])
    found.mapping.save(tmp_path / "map.toml")
    assert ColumnMapping.load(tmp_path / "map.toml") == found.mapping
    _assert_scans(_read("# tick = 2.5 ms", _NAMES.replace("t_ms", "tick"), *rows), [*range(_SCANS)])
    with pytest.raises(OptionError, match="time_unit"):
        _read(_NAMES.replace("t_ms", "tick"), *rows, time_unit="2.5")


def test_exchanged_ends_of_some_scans_are_asked_in_frames_too() -> None:
    rows = [row.split(",") for row in _ROWS]
    rows[5:] = [[row[0], *(row[k] for k in (2, 1, 4, 3, 6, 5))] for row in rows[5:]]
    names = [name.replace("t_ms", "time_ms") for name in _NAMES.split(",")]
    frame = {name: [float(row[k]) for row in rows] for k, name in enumerate(names)}
    with pytest.raises(ReadingError, match="v_h is below v_l on strip 0"):
        ts.read_readings(Frame(frame), _SENSOR)


class Frame(dict[str, list[float]]):
    """What of a pandas DataFrame is used."""

    @property
    def columns(self) -> list[str]:
        return list(self)
