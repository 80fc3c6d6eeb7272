"""Logs as sessions at a bench leave them: footers, resets, monitors' prefixes, workbooks, exports with words around.

Run `python -m studies.holdout.import_sessions [NAME ...] [--keep FOLDER]`. Written before anything was mended for them
(2026-11-23); scored as `studies.holdout.import_forms` is, but for logs of which the last scan is cut: without it.
"""
# ruff: noqa: E501 (a line is a form)
# fmt: off

from __future__ import annotations

import argparse
import io
import itertools
import json
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from studies.holdout.import_forms import BENCHES, A, B, Bench, C, D, _at, _comma, _lines, _row, _t, score

_SCANS = range(14)
E = replace(B, volts=B.volts[:13])  # the last scan is cut
F = replace(C, volts=C.volts[:13])


def _kv(b: Bench, i: int, s: int, form: str = ".3f") -> str:
    return f"vh={b.text(i, s, 0, form, 'nan')} vl={b.text(i, s, 1, form, 'nan')}"


def _each(b: Bench, line: Callable[[int, int], str]) -> list[str]:
    return [line(i, s) for i in _SCANS for s in range(b.sensor.strips)]


def _fixed(b: Bench, number: int, end: str) -> str:
    """Return a table printed with `{:>w}`, empty cells, blanks within names."""
    names = ["time ms", *(f"strip {s + number} {c}".rstrip() for s in range(b.sensor.strips) for c in (("h", "l") if b.volts.shape[2] == 2 else ("",)))]
    rows = [[f"{20 * i}", *(b.text(i, s, c, ".3f", "") for s in range(b.sensor.strips) for c in range(b.volts.shape[2]))] for i in _SCANS]
    return _lines("Logger v1.2 on /dev/ttyUSB0 at 115200", "press Ctrl-C to stop", "", "".join(f"{n:>12}" for n in names),
                  *("".join(f"{c:>12}" for c in row) for row in rows)) + end


def _book(*sheets: tuple[str, list[list[object]], list[str]]) -> bytes:
    import openpyxl

    book = openpyxl.Workbook()
    book.remove(book.active)
    for title, rows, merged in sheets:
        sheet = book.create_sheet(title)
        for row in rows:
            sheet.append(row)
        for cells in merged:
            sheet.merge_cells(cells)
    buffer = io.BytesIO()
    book.save(buffer)
    return buffer.getvalue()


def _cells(b: Bench, i: int) -> list[object]:
    return [None if np.isnan(x) else round(float(x), 4) for x in b.volts[i].ravel()]


def _forms() -> Iterator[tuple[str, str | Bench, str, str | bytes]]:
    """Yield name, bench, ending and content."""
    wide = "time_s," + ",".join(f"v{s}" for s in range(6))
    rows = [f"{_t(i):.2f},{_row(B, i)}" for i in _SCANS]
    long_a = "ms,strip,v_h,v_l"
    lines_a = _each(A, lambda i, s: f"{20 * i},{s},{A.text(i, s, 0)},{A.text(i, s, 1)}")
    # Footers.
    yield "footer, dashes", "B", ".csv", _lines(wide, *rows, "-- end of log, 14 scans --")
    yield "footer, total", "A", ".csv", _lines(long_a, *lines_a, "", "Total samples: 112")
    yield "footer, statistics", "A", ".log", _lines(*_each(A, lambda i, s: f"t={20 * i} strip={s} {_kv(A, i, s)}"), "", "--- statistics ---", "scans: 14", "lost: 0", "mean rate: 50.0 Hz", "elapsed: 0.26 s")
    yield "footer, min and max in words", "B", ".csv", _lines(wide, *rows, "", "min 0.312 V, max 2.950 V over 14 scans", "saved to /home/pi/run_07.csv in 0.3 s")
    yield "footer, python done", "B", ".txt", _lines("t_s " + " ".join(f"s{s}" for s in range(6)), *(f"{_t(i):.2f} " + _row(B, i, " ", nothing="nan") for i in _SCANS), "Done. 14 samples, 84 values, 0 errors (0.0 %)")
    # Fixed width.
    yield "fixed width, ctrl-c", "B", ".txt", _fixed(B, 0, "^C\n")
    yield "fixed width, keyboard interrupt", "D", ".txt", _fixed(D, 1, "^CTraceback (most recent call last):\n  File \"/home/pi/log.py\", line 31, in <module>\n    main()\n  File \"/home/pi/log.py\", line 24, in main\n    line = port.readline()\nKeyboardInterrupt\n")
    yield "fixed width, both channels", "A", ".txt", _fixed(A, 0, "\nKeyboardInterrupt\n")
    yield "fixed width, left", "B", ".txt", _lines("skin log", "".join(f"{n:<10}" for n in ["Time [s]", *(f"Strip {s}" for s in range(6))]).rstrip(), *("".join(f"{c:<10}" for c in [f"{_t(i):.2f}", *(B.text(i, s, 0) for s in range(6))]).rstrip() for i in _SCANS), "stopped by user")
    # Workbooks.
    table: list[list[object]] = [["time_s", *(f"v{s}" for s in range(6))], *([_t(i), *_cells(B, i)] for i in _SCANS)]
    notes: list[list[object]] = [["Notes"], ["Sensor 3, foam pad 4 mm"], ["Pressed by hand from scan 0 on, 2 people"], ["Reference: 3.30 V"]]
    yield "workbook, notes behind", "B", ".xlsx", _book(("Data", table, []), ("Notes", notes, []))
    yield "workbook, data second, merged", "A", ".xlsx", _book(
        ("Cover", [["Tactile test"], ["Date", _at(0)], ["Operator", "JK"], ["Vref", 5]], []),
        ("Run 1", [["Test of pad"], [], ["t", *(x for s in range(8) for x in (f"Strip {s}", None))], [None, *["high", "low"] * 8], ["ms", *["V"] * 16],
                   *([20 * i, *_cells(A, i)] for i in _SCANS), [], ["Average", *[1.2] * 16], ["Max", *[4.2] * 16]], ["A1:E1", *(f"{x}3:{y}3" for x, y in zip("BDFHJLNP", "CEGIKMOQ", strict=True))]))
    yield "workbook, dates", "B", ".xlsx", _book(("Sheet1", [["Measurement of 14 March"], ["Timestamp", *(f"Ch {s} (V)" for s in range(6))], *([_at(i), *_cells(B, i)] for i in _SCANS)], ["A1:G1"]))
    yield "workbook, chart data and footer", "D", ".xlsx", _book(("Tabelle1", [["Zeit", *(f"Streifen {s + 1}" for s in range(8))], ["[s]", *["[V]"] * 8], *([_t(i), *_cells(D, i)] for i in _SCANS), ["Anzahl:", 14], ["geprüft: JK"]], []), ("Tabelle2", [["x", "y"], [1, 2], [2, 4]], []))
    # Messages of brokers, buses and systems.
    yield "time, topic, json", "A", ".log", _lines(*_each(A, lambda i, s: f"{_at(i):%Y-%m-%dT%H:%M:%S.%f}Z lab/skin/strip/{s} " + json.dumps({"vh": None if np.isnan(A.volts[i, s, 0]) else round(float(A.volts[i, s, 0]), 3), "vl": None if np.isnan(A.volts[i, s, 1]) else round(float(A.volts[i, s, 1]), 3)})))
    yield "epoch, topic, value", "B", ".log", _lines(*_each(B, lambda i, s: f"{1.77e9 + _t(i):.6f} lab/pad/strip{s}/volts {B.text(i, s, 0, nothing='nan')}"))
    yield "topic, json with time", "A", ".log", _lines(*_each(A, lambda i, s: f"lab/skin/{s} {{\"t_ms\": {20 * i}, \"h\": {A.text(i, s, 0, nothing='null')}, \"l\": {A.text(i, s, 1, nothing='null')}}}"))
    yield "topic, list of volts", "B", ".log", _lines(*(f"{_at(i):%Y-%m-%dT%H:%M:%S.%f}+0100 pad/volts [{_row(B, i, ', ', nothing='null')}]" for i in _SCANS))
    yield "influx", "A", ".lp", _lines(*_each(A, lambda i, s: f"skin,host=pi4,strip={s} v_h={A.text(i, s, 0)},v_l={A.text(i, s, 1)} {1_770_000_000_000_000_000 + 20_000_000 * i}" if not np.isnan(A.volts[i, s, 0]) else f"skin,host=pi4,strip={s} touched=0i {1_770_000_000_000_000_000 + 20_000_000 * i}"))
    yield "ros2 topic echo, joint state", "B", ".yaml", "---\n".join(f"header:\n  stamp:\n    sec: 1770000000\n    nanosec: {20_000_000 * i}\n  frame_id: skin\nname:\n" + "".join(f"- strip_{s}\n" for s in range(6)) + "position: []\nvelocity: []\neffort:\n" + "".join(f"- {B.text(i, s, 0, nothing='.nan')}\n" for s in range(6)) for i in _SCANS) + "---\n"
    yield "journalctl iso precise", "A", ".log", _lines("-- Boot 8f3ac0c4a5e94b0c8e6c1 --", *_each(A, lambda i, s: f"{_at(i):%Y-%m-%dT%H:%M:%S.%f}+0100 raspberrypi skin[812]: strip {s} {_kv(A, i, s)}"))
    yield "journalctl, messages between", "A", ".log", _lines(*(x for i in _SCANS for x in ([f"{_at(i):%b %d %H:%M:%S.%f} raspi systemd[1]: Started Session {i} of user pi."] if i in (3, 9) else []) + [f"{_at(i):%b %d %H:%M:%S.%f} raspi skin[812]: strip={s} {_kv(A, i, s)}" for s in range(8)]))
    yield "esp-idf", "C", ".log", _lines("ESP-ROM:esp32c3-api1-20210207", "I (24) boot: ESP-IDF v5.1 2nd stage bootloader", "I (31) cpu_start: Pro cpu up.", *(x for i in _SCANS for x in ([f"W (38{i:02}) adc: calibration eFuse not burnt"] if i == 5 else []) + [f"I ({3800 + 20 * i}) skin: strip {s + 1}: h={C.code(i, s, 0, '-', 10)} l={C.code(i, s, 1, '-', 10)}" for s in range(7)]))
    yield "serial plotter", "C", ".txt", _lines(*("t:" + f"{20 * i}," + ",".join(f"h{s + 1}:{C.code(i, s, 0, '-1', 10)},l{s + 1}:{C.code(i, s, 1, '-1', 10)}" for s in range(7)) for i in _SCANS))
    yield "serial plotter, tabs, no time", "C", ".txt", _lines(*("\t".join(f"h{s + 1}:{C.code(i, s, 0, '-1', 10)}\tl{s + 1}:{C.code(i, s, 1, '-1', 10)}" for s in range(7)) for i in _SCANS))
    # What scripts print.
    yield "micropython dicts", "A", ".txt", _lines("MPY: soft reboot", "main.py: 8 strips, Vref 5.0", *("{'t_ms': " + f"{20 * i}, 'strips': [" + ", ".join("None" if np.isnan(A.volts[i, s, 0]) else f"({A.text(i, s, 0)}, {A.text(i, s, 1)})" for s in range(8)) + "]}" for i in _SCANS), "Traceback (most recent call last):", '  File "main.py", line 17, in <module>', "KeyboardInterrupt: ", ">>> ")
    yield "micropython tuples", "B", ".txt", _lines("MicroPython v1.22.1 on 2024-01-05; Raspberry Pi Pico with RP2040", *(f"({20 * i}, [{_row(B, i, ', ', nothing='None')}])" for i in _SCANS))
    yield "json lines nested", "A", ".jsonl", _lines(*(json.dumps({"ts": 1_770_000_000_000 + 20 * i, "dev": {"id": "pad-3", "fw": "1.4.2"}, "frame": {"n": i, "strips": [{"id": s, "h": None if np.isnan(A.volts[i, s, 0]) else round(float(A.volts[i, s, 0]), 4), "l": None if np.isnan(A.volts[i, s, 1]) else round(float(A.volts[i, s, 1]), 4)} for s in range(8)]}}) for i in _SCANS))
    yield "json array of scans", "B", ".json", json.dumps({"meta": {"sensor": "pad 3", "vref": 3.3}, "scans": [{"time_ms": 20 * i, "volts": [None if np.isnan(x) else round(float(x), 4) for x in B.volts[i, :, 0]]} for i in _SCANS]}, indent=1)
    yield "csv, quoted decimal commas", "B", ".csv", _lines('"Zeit [s]",' + ",".join(f'"Kanal {s} [V]"' for s in range(6)), *(f'"{_comma(f"{_t(i):.2f}")}",' + ",".join(f'"{_comma(B.text(i, s, 0))}"' for s in range(6)) for i in _SCANS), end="\r\n")
    yield "pandas to_csv, two levels", "A", ".csv", _lines(",".join(["", *["h"] * 8, *["l"] * 8]), ",".join(["strip", *map(str, [*range(8), *range(8)])]), "time_s" + "," * 16, *(f"{_t(i):.2f}," + ",".join(A.text(i, s, c) for c in (0, 1) for s in range(8)) for i in _SCANS))
    yield "pandas to_string", "A", ".txt", _lines("      time_s  strip       h       l", *(f"{n:<5}{_t(n // 8):>7.2f}{n % 8:>7}{A.text(n // 8, n % 8, 0, '.4f', 'NaN'):>8}{A.text(n // 8, n % 8, 1, '.4f', 'NaN'):>8}" for n in range(112)), "", "[112 rows x 4 columns]")
    yield "markdown", "B", ".md", _lines("# Run 7", "", "Some words about the run, 14 scans.", "", "| t (ms) | " + " | ".join(f"strip {s}" for s in range(6)) + " |", "|---:|" + "---:|" * 6, *(f"| {20 * i} | {_row(B, i, ' | ')} |" for i in _SCANS), "", "All in volts.")
    yield "numpy savetxt", "A", ".txt", _lines("# pad 3, Vref 5 V, written by numpy", "# t[s] " + " ".join(f"h{s} l{s}" for s in range(8)), *(f"{_t(i):.18e} " + _row(A, i, " ", ".18e", "nan") for i in _SCANS))
    yield "matlab dump", "B", ".txt", "t =\n\n" + "".join(f"    {_t(i):.4f}\n" for i in _SCANS) + "\nV =\n\n" + "".join("    " + "    ".join(B.text(i, s, 0, ".4f", "   NaN") for s in range(6)) + "\n" for i in _SCANS) + "\n"
    # Exports of instruments.
    lvm = ["LabVIEW Measurement\t", "Writer_Version\t2", "Reader_Version\t2", "Separator\tTab", "Decimal_Separator\t.", "Multi_Headings\tNo", "X_Columns\tOne", "Time_Pref\tRelative", "Operator\tlab", "Date\t2026/03/14", "Time\t09:26:53.58", "***End_of_Header***\t", "", "Channels\t6\t\t\t\t\t\t", "Samples\t" + "14\t" * 6, "Date\t" + "2026/03/14\t" * 6, "Time\t" + "09:26:53.58\t" * 6, "Y_Unit_Label\t" + "Volts\t" * 6, "X_Dimension\t" + "Time\t" * 6, "X0\t" + "0.0\t" * 6, "Delta_X\t" + "0.02\t" * 6, "***End_of_Header***\t" + "\t" * 6, "X_Value\t" + "\t".join(f"Voltage_{s}" if s else "Voltage" for s in range(6)) + "\tComment"]
    yield "labview lvm", "B", ".lvm", _lines(*lvm, *(f"{_t(i):.6f}\t" + _row(B, i, "\t", ".6f", "NaN") + ("\tpress" if i == 0 else "") for i in _SCANS), end="\r\n")
    yield "tdms to text", "B", ".txt", _lines("Root Name\tpad 3", "Title\t", "Group\tSkin", "Description\t", "", "Channel\tTime\t" + "\t".join(f"AI{s}" for s in range(6)), "Unit\ts\t" + "\t".join(["V"] * 6), "Samples\t" + "\t".join(["14"] * 7), *(f"{i + 1}\t{_t(i):.3f}\t" + _row(B, i, "\t", ".5f", "NaN") for i in _SCANS))
    yield "tektronix", "B", ".csv", _lines("Model,MSO46", "Firmware Version,1.28.6", "", "Waveform Type,ANALOG", "Point Format,Y", "Horizontal Units,s", "Horizontal Scale,0.04", "Sample Interval,0.02", "Record Length,14", "Zero Index,0", "Vertical Units" + ",V" * 6, "Label" + ",Label" * 6, "TIME," + ",".join(f"CH{s + 1}" for s in range(6)), *(f"{_t(i) - 0.14:.5e}," + _row(B, i, ",", ".5f", "NaN") for i in _SCANS), end="\r\n")
    yield "saleae", "B", ".csv", _lines("Time [s]," + ",".join(f"Channel {s}" for s in range(6)), *(f"{_t(i):.9f}," + _row(B, i, ",", ".15f", "nan") for i in _SCANS))
    yield "picoscope", "B", ".csv", _lines("Time," + ",".join(f"Channel {c}" for c in "ABCDEF"), "(ms),(V)" + ",(V)" * 5, "", *(f"{20 * i:.8f}," + _row(B, i, ",", ".8f", "") for i in _SCANS), end="\r\n")
    yield "keysight scope", "B", ".csv", _lines("x-axis,1,2,3,4,5,6", "second,Volt,Volt,Volt,Volt,Volt,Volt", *(f"{_t(i) - 0.14:+.6E}," + _row(B, i, ",", "+.4E", "") for i in _SCANS), end="\r\n")
    # Encodings and damage.
    yield "excel german, thousands", "A", ".csv", ("Zeit [ms];" + ";".join(f"Streifen {s} {w} [mV]" for s in range(8) for w in ("oben", "unten")) + "\r\n" + "".join(f"{20 * i};" + ";".join("" if np.isnan(x) else f"{1000 * x:,.1f}".translate(str.maketrans(",.", ".,")) for x in A.volts[i].ravel()) + "\r\n" for i in _SCANS)).encode("latin-1")
    yield "unicode text of excel", "B", ".txt", _lines("Time (s)\t" + "\t".join(f"Strip {s} (V)" for s in range(6)), *(f"{_t(i):.2f}\t" + _row(B, i, "\t") for i in _SCANS), end="\r\n").encode("utf-16")
    yield "latin-1 units", "B", ".csv", _lines("Zeit [µs];Temp. [°C];" + ";".join(f"U{s} [V]" for s in range(6)), *(f"{20_000 * i};{_comma('23.4')};" + _comma(_row(B, i, ";")) for i in _SCANS), end="\r\n").encode("latin-1")
    boot = ["", "*** tactile pad, firmware 1.4 ***", "ADC 10 bit, 7 strips", "ms,strip,adc_h,adc_l"]
    body = [[f"{20 * (i % 7)},{s + 1},{C.code(i, s, 0, '', 10)},{C.code(i, s, 1, '', 10)}" for s in range(7)] for i in _SCANS]
    yield "two boots", "C", ".csv", _lines(*boot, *(x for r in body[:7] for x in r), *boot, *(x for r in body[7:] for x in r))
    clock = [[f"{20 * i},{s + 1},{C.code(i, s, 0, '', 10)},{C.code(i, s, 1, '', 10)}" for s in range(7)] for i in _SCANS]
    yield "reset without a clock's", "C", ".csv", _lines(*boot, *(x for r in clock[:7] for x in r), *boot, *(x for r in clock[7:] for x in r))
    yield "nul bytes between", "B", ".csv", _lines(wide, *rows[:6], "\0" * 37, *rows[6:])
    yield "trap, zeros at a line's start", "B", ".csv", _lines(wide, *rows[:6], "\0\0\0" + rows[6], *rows[7:])
    yield "last line overwritten", E, ".csv", _lines(wide, *rows[:13], rows[13][:14] + rows[2][:9])
    yield "last strip cut", F, ".csv", _lines(boot[3], *(x for r in clock[:13] for x in r), *clock[13][:4]) + clock[13][4][:6]
    # Names and numbers.
    yield "voltage beside voltage1", "B", ".csv", _lines("time_s,voltage," + ",".join(f"voltage{s + 1}" for s in range(5)), *rows)
    yield "supply voltage beside", "B", ".csv", _lines("time_s,voltage," + ",".join(f"voltage{s}" for s in range(6)), *(f"{_t(i):.2f},3.301,{_row(B, i)}" for i in _SCANS))


def _later() -> Iterator[tuple[str, str | Bench, str, str | bytes]]:
    """Yield forms that were written after the first had been mended for, and before any of these was tried."""
    def col(cells: list[str], widths: list[int], left: bool = False) -> str:
        return "".join(f"{c:<{w}}" if left else f"{c:>{w}}" for c, w in zip(cells, widths, strict=True))

    many = range(6)
    yield "fixed, units and rule", "B", ".txt", _lines("Pad 3, run 7", "", col(["Time", *(f"Strip {s}" for s in many)], [10] * 7, left=True), col(["ms", *["V"] * 6], [10] * 7, left=True), "-" * 70, *(col([f"{20 * i}", *(B.text(i, s, 0) for s in many)], [10] * 7, left=True) for i in _SCANS), "(14 rows)")
    yield "fixed, line per strip", "A", ".txt", _lines("opened COM4, 115200 baud", col(["Time (ms)", "Strip no.", "V high (V)", "V low (V)"], [12] * 4), *_each(A, lambda i, s: col([f"{20 * i}", f"{s}", A.text(i, s, 0), A.text(i, s, 1)], [12] * 4)), "^C")
    yield "fixed, void, commas above", "B", ".txt", _lines("Logger, v2, 2026-03-14, room 12", "12 bits, 3.3 V, 6 strips", col(["t [s]", *(f"ch {s} [V]" for s in many)], [11] * 7), *(col([f"{_t(i):.2f}", *(B.text(i, s, 0, ".3f", "n/a") for s in many)], [11] * 7) for i in _SCANS), "KeyboardInterrupt")
    yield "fixed, psql", "A", ".txt", _lines(" time_s | strip |  v_h  |  v_l  ", "--------+-------+-------+-------", *_each(A, lambda i, s: f" {_t(i):6.2f} | {s:5} | {A.text(i, s, 0):>5} | {A.text(i, s, 1):>5} "), "(112 rows)", "")
    yield "book, readme first, margin", "B", ".xlsx", _book(("Readme", [["Column", "Meaning"], ["t", "time in ms"], ["s0", "strip 0, volts"], ["version", 3]], []), ("Data", [[None, "Pad test, 14 March", None], [None], [None, "t_ms", *(f"s{s}" for s in many)], *([None, 20 * i, *_cells(B, i)] for i in _SCANS)], ["B1:H1"]))
    yield "book, date and time", "B", ".xlsx", _book(("Log", [["Date", "Time", *(f"Strip {s} [V]" for s in many)], *([_at(i).date(), _at(i).time(), *_cells(B, i)] for i in _SCANS)], []))
    yield "book, totals and words below", "A", ".xlsx", _book(("Log", [["Time (s)", *(f"Strip {s} {c}" for s in range(8) for c in ("high", "low"))], *([_t(i), *_cells(A, i)] for i in _SCANS), [], ["Min", *[0.4] * 16], ["Max", *[4.4] * 16], [], ["Measured by JK on 14 March, checked by TR"], ["Pad 3 with 4 mm foam"]], []))
    yield "book, remarks beside", "B", ".xlsx", _book(("Log", [["t/s", *(f"U{s}/V" for s in many), "Remark", None], *([_t(i), *_cells(B, i), "pressed 2x" if i == 4 else None, "see photo 12" if i == 9 else None] for i in _SCANS)], []))
    def js(i: int, s: int) -> str:
        return json.dumps({c: None if np.isnan(v) else round(float(v), 3) for c, v in zip("hl", A.volts[i, s], strict=True)})

    yield "mosquitto -v json", "A", ".log", _lines(*_each(A, lambda i, s: f"skin/{s} {js(i, s)}"))
    yield "mosquitto -F scalars", "A", ".log", _lines(*(f"{_at(i):%Y-%m-%dT%H:%M:%S}.{20 * i % 1000 + 580:03d}+0100 lab/skin/{s}/{c} {A.text(i, s, n, nothing='nan')}" for i in _SCANS for s in range(8) for n, c in enumerate(("vh", "vl"))))
    yield "bracketed time, topic, colon", "A", ".log", _lines(*_each(A, lambda i, s: f"[{_at(i):%Y-%m-%d %H:%M:%S.%f}] lab/skin/{s}: {js(i, s)}"))
    yield "epoch, topic, two numbers", "A", ".log", _lines(*_each(A, lambda i, s: f"{1.77e9 + _t(i):.3f} skin/{s} {A.text(i, s, 0, nothing='nan')},{A.text(i, s, 1, nothing='nan')}"))
    yield "journalctl monotonic", "A", ".log", _lines(*_each(A, lambda i, s: f"[{1234 + _t(i):12.6f}] raspi skin[812]: strip={s} {_kv(A, i, s)}"))
    yield "zephyr", "A", ".log", _lines("*** Booting Zephyr OS build v3.5.0 ***", *_each(A, lambda i, s: f"[00:00:{1 + _t(i):06.3f},000] <inf> skin: strip {s}: h={A.text(i, s, 0, '.0f', 'nan', 1000)} mV l={A.text(i, s, 1, '.0f', 'nan', 1000)} mV"))
    yield "esp-idf, colours, lists", "B", ".log", _lines(*(f"\x1b[0;32mI ({3800 + 20 * i}) skin: v=[{_row(B, i, ', ', nothing='nan')}]\x1b[0m" for i in _SCANS))
    yield "plotter with constant lines", "B", ".txt", _lines(*(f"Min:0,Max:5,t_ms:{20 * i}," + ",".join(f"s{s}:{B.text(i, s, 0, nothing='nan')}" for s in many) for i in _SCANS))
    yield "python logging", "A", ".log", _lines("2026-03-14 09:26:52,100 - skin - INFO - opened /dev/ttyACM0", *_each(A, lambda i, s: f"{_at(i):%Y-%m-%d %H:%M:%S},{580 + 20 * i if i < 21 else 0:03d} - skin - INFO - strip={s} {_kv(A, i, s)}"))
    yield "dataclass repr", "A", ".txt", _lines(*_each(A, lambda i, s: f"Reading(t={_t(i):.2f}, strip={s}, h={A.text(i, s, 0, nothing='None')}, l={A.text(i, s, 1, nothing='None')})"))
    yield "node-red", "A", ".jsonl", _lines(*_each(A, lambda i, s: f'{{"_msgid": "{i:04x}{s:x}c2", "topic": "skin/{s}", "ts": {1_770_000_000_000 + 20 * i}, "payload": {js(i, s)}}}'))
    yield "influx csv", "B", ".csv", _lines("#group,false,false,false,false,true,true", "#datatype,string,long,dateTime:RFC3339Nano,double,string,string", "#default,_result,,,,,", ",result,table,_time,_value,_field,strip", *(f",,{s},{_at(i):%Y-%m-%dT%H:%M:%S.%f}Z,{B.text(i, s, 0)},volts,{s}" for s in many for i in _SCANS if not np.isnan(B.volts[i, s, 0])), "", end="\r\n")
    yield "grafana", "B", ".csv", _lines('"Time",' + ",".join(f'"strip {s}"' for s in many), *(f'"{_at(i):%Y-%m-%d %H:%M:%S.%f}",' + ",".join(f'"{t} V"' if (t := B.text(i, s, 0)) else "" for s in many) for i in _SCANS))
    yield "picoscope mV", "B", ".csv", _lines("Time," + ",".join(f"Channel {c}" for c in "ABCDEF"), "(ms)" + ",(mV)" * 6, "", *(f"{20 * i - 140:.8f}," + _row(B, i, ",", ".4f", "", 1000.0) for i in _SCANS), end="\r\n")
    yield "rigol", "B", ".csv", _lines("X," + ",".join(f"CH{s + 1}" for s in many) + ",Start,Increment,", "Sequence," + ",".join(["Volt"] * 6) + ",0.000000e+00,2.000000e-02", *(f"{i}," + _row(B, i, ",", ".4e", "") + "," for i in _SCANS), end="\r\n")
    yield "excel sep line", "B", ".csv", ("\ufeff" + _lines("sep=;", "Zeit (s);" + ";".join(f"Streifen {s + 1}" for s in many), *(_comma(f"{_t(i):.2f};{_row(B, i, ';')}") for i in _SCANS), end="\r\n")).encode()
    yield "r write.table", "A", ".txt", _lines('"time_s" "strip" "v_h" "v_l"', *(f'"{n + 1}" {_t(n // 8):.2f} {n % 8} {A.text(n // 8, n % 8, 0, nothing="NA")} {A.text(n // 8, n % 8, 1, nothing="NA")}' for n in range(112)))
    rows = [[f"{20 * i},{s + 1},{C.code(i, s, 0, '', 10)},{C.code(i, s, 1, '', 10)}" for s in range(7)] for i in _SCANS]
    yield "reset with garbage", "C", ".csv", _lines("boot v1.4", "ms,strip,adc_h,adc_l", *(x for r in rows[:7] for x in r), "\xff\xfe\x80\xf8boot v1.4", "ms,strip,adc_h,adc_l", *(x for r in rows[7:] for x in r)).encode("latin-1")
    yield "names again with blanks", "B", ".csv", _lines("time_s,v0,v1,v2,v3,v4,v5", *(f"{_t(i):.2f},{_row(B, i)}" for i in range(7)), "time_s, v0, v1, v2, v3, v4, v5", *(f"{_t(i):.2f},{_row(B, i)}" for i in range(7, 14)))
    yield "lines with cr cr lf", "B", ".csv", _lines("time_s,v0,v1,v2,v3,v4,v5,", *(f"{_t(i):.2f},{_row(B, i)}," for i in _SCANS), end="\r\r\n").encode("utf-8-sig")
    yield "footer, stopped and summary", "A", ".log", _lines("# skin log", *_each(A, lambda i, s: f"t={20 * i} strip={s} {_kv(A, i, s)}"), "*** logging stopped at 09:27:10 ***", "Summary: min=0.41 V max=4.38 V, 14 scans, 0 lost")
    yield "footer, hash end", "B", ".csv", _lines("time_s,v0,v1,v2,v3,v4,v5", *(f"{_t(i):.2f},{_row(B, i)}" for i in _SCANS), "# END 14 scans", "EOF")
    yield "footer, record count", "A", ".csv", _lines("ms;strip;v_h;v_l", *_each(A, lambda i, s: f"{20 * i};{s};{A.text(i, s, 0)};{A.text(i, s, 1)}"), "112 records written;;;")
    # Not to be known: refused or asked is right.
    yield "trap, candump", "B", ".log", _lines(*(f"({1.77e9 + _t(i):.6f}) can0 {0x100 + s:03X}#{int(B.code(i, s, 0)):04X}" for i in _SCANS for s in many))
    yield "trap, kilopascals", "B", ".log", _lines(*(f"t={20 * i} strip={s} p={B.text(i, s, 0, nothing='0.0')} kPa" for i in _SCANS for s in many))
    yield "trap, zeros in a number", "B", ".csv", _lines("time_s,v0,v1,v2,v3,v4,v5", *(f"{_t(i):.2f},{_row(B, i)}" for i in range(13)), f"0.26,{_row(B, 13)}".replace("1.9", "1.\0\0", 1))
    yield "trap, strips from 3 on", "B", ".csv", _lines("t_ms,strip,volts", *(f"{20 * i},{s},{B.text(i, s, 0)}" for i in _SCANS for s in (3, 4)))


def main() -> None:
    """Print what becomes of each form, and how many of each kind there are."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--keep", type=Path, help="write the logs there")
    parser.add_argument("names", nargs="*")
    given = parser.parse_args()
    counted: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        for name, bench, ending, content in itertools.chain(_forms(), _later()):
            if given.names and name not in given.names:
                continue
            file = (given.keep or Path(folder)) / (name.replace(" ", "-").replace(",", "") + ending)
            file.write_bytes(content if isinstance(content, bytes) else content.encode())
            kind, why = score(file, bench if isinstance(bench, Bench) else BENCHES[bench])
            counted[kind] += 1
            print(f"{kind:12} {name}{': ' + why if why else ''}")  # noqa: T201
    print(dict(counted))  # noqa: T201


if __name__ == "__main__":
    main()
