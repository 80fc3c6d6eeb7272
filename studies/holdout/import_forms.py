"""Logs as instruments, loggers and scripts write them, made from known readings, and how `tacstrip import` reads them.

Run `python -m studies.holdout.import_forms [NAME ...] [--keep FOLDER]`. A log is right where each reading and time
comes back; answers are those that the questions themselves suggest (and the true rate), all in one round.
"""
# ruff: noqa: E501, T201 (a line is a form; it prints its table)
# fmt: off

from __future__ import annotations

import argparse
import datetime as dt
import io
import itertools
import json
import random
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import tacstrip as ts
from tacstrip.io.log_import.containers import SeveralSheets, read_table
from tacstrip.io.log_import.guess import Proposal, propose
from tacstrip.io.log_import.questions import Unanswered
from tacstrip.io.log_import.write import as_readings

_RATE_HZ = 50.0
_SCANS = range(14)
_SHAPE = ts.Contact.polygon([(-15, -22), (18, -18), (12, 25), (-14, 22)])
_START = dt.datetime(2026, 3, 14, 9, 26, 53, 580_000)


@dataclass(frozen=True, eq=False)
class Bench:
    """A sensor and what it read: volts (scans, strips, channels), NaN untouched, at `_RATE_HZ`."""

    sensor: ts.Sensor
    volts: np.ndarray

    def text(self, i: int, s: int, c: int, form: str = ".3f", nothing: str = "", scale: float = 1.0) -> str:
        """Return a reading as text."""
        v = self.volts[i, s, c]
        return nothing if np.isnan(v) else format(scale * v, form)

    def code(self, i: int, s: int, c: int, nothing: str = "0", bits: int = 12) -> str:
        """Return a reading as a code."""
        return self.text(i, s, c, ".0f", nothing, (2**bits - 1) / self.sensor.vref_volt)


def _bench(construction: str, strips: int, vref: float, bits: int | None, seed: int, base: int = 0) -> Bench:
    sensor = ts.Sensor(
        construction=construction,
        strips=strips,
        pitch_mm=6.0,
        length_mm=120.0,
        vref_volt=vref,
        adc_bits=bits,
        strip_base=base,
    )
    rng = np.random.default_rng(seed)
    scans = [ts.simulate(sensor, _SHAPE.placed(14 + 1.1 * i, 45 + 1.7 * i)) for i in _SCANS]
    ratios = np.stack([np.stack([scan[n] for n in scan.signatures], axis=-1) for scan in scans])
    ratios += 0.0004 * rng.standard_normal(ratios.shape)
    if bits:
        ratios = np.round(ratios * (2**bits - 1)) / (2**bits - 1)
    return Bench(sensor, vref * ratios)


A = _bench("crs-crs", 8, 5.0, None, 1)
B = _bench("crs-m", 6, 3.3, 12, 2)
C = _bench("crs-crs", 7, 5.0, 10, 3, base=1)
D = _bench("crs-m", 8, 5.0, None, 4, base=1)
BENCHES = {"A": A, "B": B, "C": C, "D": D}


def _t(i: int, unit: float = 1.0) -> float:
    return i / _RATE_HZ * unit


def _at(i: int) -> dt.datetime:
    return _START + dt.timedelta(seconds=_t(i))


def _lines(*lines: str, end: str = "\n") -> str:
    return end.join(lines) + end


def _strips(b: Bench) -> range:
    return range(b.sensor.strips)


def _row(b: Bench, i: int, by: str = ",", form: str = ".3f", nothing: str = "", scale: float = 1.0) -> str:
    cells = [b.text(i, s, c, form, nothing, scale) for s in _strips(b) for c in range(b.volts.shape[2])]
    return by.join(cells)


def _wide(b: Bench, head: str, time: Callable[[int], str], by: str = ",", **way: object) -> str:
    return _lines(*([head] if head else []), *(time(i) + by + _row(b, i, by, **way) for i in _SCANS))  # type: ignore[arg-type]


def _long(b: Bench, line: Callable[[int, int], str], *head: str) -> str:
    return _lines(*head, *(text for i in _SCANS for s in _strips(b) if (text := line(i, s))))


def _comma(text: str) -> str:
    return text.replace(".", ",")


def _forms() -> Iterator[tuple[str, str, str, str | bytes]]:
    """Yield name, bench, ending and content."""
    rnd = random.Random(7)
    six = [f"ch{s}" for s in _strips(B)]
    # Instruments.
    yield "keithley 2700", "B", ".csv", _lines(
        "Instrument,2700", "Channels,101:106", "", "Index,Time," + ",".join(f"{101 + s} (VDC)" for s in _strips(B)),
        *(f"{i + 1},{_t(i):.6f}," + _row(B, i, ",", "+.6E", "+9.900000E+37") for i in _SCANS), end="\r\n",
    )  # fmt: skip
    yield "keysight benchvue", "B", ".csv", _lines(
        "BenchVue DAQ export", "Start,3/14/2026 9:26:53 AM", "Sweep #,Time," + ",".join(f"Chan {101 + s} (VDC)" for s in _strips(B)),
        *(f"{i + 1},{_at(i):%m/%d/%Y %H:%M:%S.%f}," + _row(B, i, ",", ".6f", "OVLD") for i in _SCANS),
    )  # fmt: skip
    yield "keysight named", "B", ".csv", _lines(
        "Scan,Time," + ",".join(f"{101 + s} <H{s + 1}> (VDC),Alarm {101 + s}" for s in _strips(B)),
        *(f"{i + 1},{_at(i):%m/%d/%Y %H:%M:%S:%f}"[:-3] + "," + ",".join(B.text(i, s, 0, ".6E", "9.9E+37") + ",0" for s in _strips(B)) for i in _SCANS),
    )  # fmt: skip
    yield "picolog", "B", ".csv", _wide(
        B, "," + ",".join(f"Channel {s + 1} Last (V)" for s in _strips(B)), lambda i: f"{_at(i).isoformat(timespec='milliseconds')}+01:00", nothing="******"
    )  # fmt: skip
    yield "picoscope", "B", ".csv", _lines(
        "Time," + ",".join(f"Channel {c}" for c in "ABCDEF"), "(ms)," + ",".join(["(mV)"] * 6), "",
        *(f"{_t(i, 1e3):.8f}," + _row(B, i, ",", ".8f", "NaN", 1e3) for i in _SCANS),
    )  # fmt: skip
    yield "tektronix", "B", ".csv", _lines(
        "Model,MSO46", "Label," + ",".join(six), "Vertical Units," + ",".join(["V"] * 6), "Horizontal Units,s", "Sample Interval,2.0E-2",
        "Record Length,14", "", "TIME," + ",".join(f"CH{s + 1}" for s in _strips(B)),
        *(f"{_t(i) - 0.1:.5E}," + _row(B, i, ",", ".5E", "0.00000E+00") for i in _SCANS),
    )  # fmt: skip
    yield (
        "saleae analog",
        "B",
        ".csv",
        _wide(
            B,
            "Time [s]," + ",".join(f"Channel {s}" for s in _strips(B)),
            lambda i: f"{_t(i):.9f}",
            form=".9f",
            nothing="0.000000000",
        ),
    )
    yield (
        "ni daqexpress",
        "A",
        ".txt",
        _wide(
            A,
            "\t".join(["Time", *(f"cDAQ1Mod1_ai{n} (V)" for n in range(16))]),
            lambda i: f"{_at(i):%m/%d/%Y %I:%M:%S.%f %p}",
            "\t",
            nothing="NaN",
        ),
    )
    yield "labview decimal comma", "B", ".lvm", _lines(
        "LabVIEW Measurement\t", "Decimal_Separator\t,", "***End_of_Header***\t", "X_Value\t" + "\t".join(f"Voltage_{s}" for s in _strips(B)) + "\tComment",
        *(_comma(f"{_t(i):.6f}\t" + _row(B, i, "\t", ".6f", "0.000000")) for i in _SCANS), end="\r\n",
    )  # fmt: skip
    yield "dataq windaq", "B", ".csv", _lines(
        "Relative Time," + ",".join(f"ch {s + 1}" for s in _strips(B)), "sec," + ",".join(["V"] * 6), *(f"{_t(i):.3f}," + _row(B, i, nothing="-0.001") for i in _SCANS)
    )  # fmt: skip
    yield "campbell toa5", "A", ".dat", _lines(
        '"TOA5","CR6","CR6","1234"', '"TIMESTAMP","RECORD",' + ",".join(f'"VH({s + 1})"' for s in _strips(A)) + "," + ",".join(f'"VL({s + 1})"' for s in _strips(A)),
        '"TS","RN",' + ",".join(['"mV"'] * 16), '"","",' + ",".join(['"Smp"'] * 16),
        *(f'"{_at(i):%Y-%m-%d %H:%M:%S.%f}",{700 + i},' + ",".join(A.text(i, s, c, ".1f", '"NAN"', 1e3) for c in (0, 1) for s in _strips(A)) for i in _SCANS),
    )  # fmt: skip
    yield "yokogawa", "B", ".csv", _lines(
        "Date,Time,mSec," + ",".join(f"CH{s + 1:03d}" for s in _strips(B)), ",,," + ",".join(["V"] * 6),
        *(f"{_at(i):%Y/%m/%d,%H:%M:%S},{_at(i).microsecond // 1000}," + _row(B, i, ",", ".4f", "-OVER") for i in _SCANS),
    )  # fmt: skip
    yield (
        "multimeter with µV",
        "B",
        ".csv",
        _wide(
            B,
            "t (s)," + ",".join(f"S{s + 1} (µV)" for s in _strips(B)),
            lambda i: f"{_t(i):.2f}",
            form=".0f",
            scale=1e6,
        ),
    )
    # Serial text.
    yield (
        "plotter labels",
        "C",
        ".txt",
        _lines(
            *(
                "\t".join(
                    f"H{s + 1}:{C.code(i, s, 0, '0', 10)}\tL{s + 1}:{C.code(i, s, 1, '0', 10)}"
                    for s in _strips(C)
                )
                for i in _SCANS
            )
        ),
    )
    yield (
        "ide time stamp, tabs",
        "C",
        ".txt",
        _lines(
            *(
                f"{_at(i):%H:%M:%S.%f}"[:-3]
                + " -> "
                + "\t".join(C.code(i, s, c, "0", 10) for s in _strips(C) for c in (0, 1))
                for i in _SCANS
            )
        ),
    )
    yield (
        "epoch, strip in lines",
        "A",
        ".log",
        _long(
            A,
            lambda i, s: (
                f"{1.77e9 + _t(i):.3f} strip{s} H={A.text(i, s, 0, '.3f', 'nan')} L={A.text(i, s, 1, '.3f', 'nan')}"
            ),
        ),
    )
    yield (
        "ros2 topic echo",
        "B",
        ".txt",
        "".join(
            "data:\n" + "".join(f"- {B.text(i, s, 0, '.4f', '.nan')}\n" for s in _strips(B)) + "---\n"
            for i in _SCANS
        ),
    )
    yield (
        "bag csv, dots",
        "A",
        ".csv",
        _wide(
            A,
            ",".join(["timestamp", *(f".data.{n}" for n in range(16))]),
            lambda i: f"{1_770_000_000_000_000_000 + i * 20_000_000}",
            nothing="nan",
        ),
    )
    yield (
        "bag csv, slashes",
        "B",
        ".csv",
        _wide(
            B,
            ",".join(["__time", *(f"/strips/data[{s}]" for s in _strips(B))]),
            lambda i: f"{1_770_000_000 + _t(i):.6f}",
        ),
    )
    yield (
        "esp log",
        "A",
        ".log",
        _long(
            A,
            lambda i, s: (
                f"I ({1200 + 20 * i}) tac: strip {s}, high {A.text(i, s, 0, '.0f', '-1', 1e3)} mV, low {A.text(i, s, 1, '.0f', '-1', 1e3)} mV"
            ),
        ),
    )
    yield (
        "candump-like hex",
        "C",
        ".log",
        _lines(
            *(
                f"({1.77e9 + _t(i):.6f}) "
                + " ".join(f"{int(C.code(i, s, c, '0', 10)):03X}" for s in _strips(C) for c in (0, 1))
                for i in _SCANS
            )
        ),
    )
    yield (
        "semicolons, debugging between",
        "B",
        ".txt",
        _lines(
            "setup done",
            *(
                x
                for i in _SCANS
                for x in ([f"heap {20000 - 8 * i}"] if i % 5 == 2 else [])
                + [f"{20 * i};" + ";".join(B.code(i, s, 0) for s in _strips(B))]
            ),
        ),
    )
    yield (
        "trailing comments",
        "B",
        ".txt",
        _wide(B, "ms " + " ".join(six), lambda i: f"{20 * i}", " ", nothing="nan")
        .replace("\n100 ", "\n100 ", 1)
        .replace("\n140 ", "\n140 ")
        .replace("\n", "  # press\n", 4)
        .replace("  # press\n", "\n", 1),
    )
    yield (
        "scan sentences",
        "A",
        ".txt",
        "".join(
            f"Scan {i + 1} at {20 * i} ms:\n"
            + "".join(
                f"  strip {s}: high={A.text(i, s, 0, '.3f', 'n/a')} low={A.text(i, s, 1, '.3f', 'n/a')}\n"
                for s in _strips(A)
            )
            for i in _SCANS
        ),
    )
    yield (
        "csv in brackets, pairs",
        "A",
        ".txt",
        _lines(
            *(
                f"t={_t(i):.3f} "
                + " ".join(
                    f"({A.text(i, s, 0, '.3f', '-')},{A.text(i, s, 1, '.3f', '-')})" for s in _strips(A)
                )
                for i in _SCANS
            )
        ),
    )
    yield (
        "H then L lines",
        "A",
        ".txt",
        _lines(
            *(
                x
                for i in _SCANS
                for x in (
                    f"[{20 * i:06d}] H " + " ".join(A.text(i, s, 0, ".3f", "-.---") for s in _strips(A)),
                    f"[{20 * i:06d}] L " + " ".join(A.text(i, s, 1, ".3f", "-.---") for s in _strips(A)),
                )
            )
        ),
    )
    yield (
        "nmea-like",
        "C",
        ".txt",
        _lines(
            *(
                f"$TAC,{20 * i},"
                + ",".join(C.code(i, s, c, "", 10) for s in _strips(C) for c in (0, 1))
                + f"*{rnd.randrange(256):02X}"
                for i in _SCANS
            )
        ),
    )
    # Scripts.
    tuples = [
        (
            round(_t(i), 3),
            [
                None if np.isnan(A.volts[i, s, 0]) else tuple(np.round(A.volts[i, s], 3).tolist())
                for s in _strips(A)
            ],
        )
        for i in _SCANS
    ]
    yield "python tuples", "A", ".txt", _lines(*map(str, tuples))
    yield (
        "python list of dicts",
        "A",
        ".txt",
        "log = "
        + str(
            [
                {
                    "t": t,
                    "strips": {s: None if p is None else {"h": p[0], "l": p[1]} for s, p in enumerate(ps)},
                }
                for t, ps in tuples
            ]
        )
        + "\n",
    )
    with np.printoptions(precision=4, linewidth=50, suppress=True):
        yield (
            "numpy rows, wrapped",
            "A",
            ".txt",
            _lines(*(f"{_t(i):.2f} {A.volts[i, :, 0]} {A.volts[i, :, 1]}" for i in _SCANS)),
        )
        yield (
            "numpy array of rows",
            "B",
            ".txt",
            f"{np.column_stack([[_t(i) for i in _SCANS], B.volts[:, :, 0]])}\n",
        )
    yield (
        "numpy savetxt",
        "B",
        ".txt",
        _lines(
            "# time strip0 strip1 strip2 strip3 strip4 strip5",
            *(f"{_t(i):.18e} " + _row(B, i, " ", ".18e", "nan") for i in _SCANS),
        ),
    )
    yield (
        "pandas print",
        "B",
        ".txt",
        _lines(
            "      time     " + "      ".join(f"s{s}" for s in _strips(B)),
            *(
                f"{i:<4}{_t(i):6.2f}" + "".join(f"{B.text(i, s, 0, '.3f', 'NaN'):>8}" for s in _strips(B))
                for i in _SCANS
            ),
        ),
    )
    yield (
        "pandas multi-index",
        "A",
        ".csv",
        _lines(
            ",".join(["strip", *(str(s) for s in _strips(A) for _ in "hl")]),
            ",".join(["end", *("high", "low") * 8]),
            "time" + "," * 16,
            *(f"{_t(i):.2f}," + _row(A, i) for i in _SCANS),
        ),
    )
    yield (
        "pandas describe behind",
        "B",
        ".csv",
        _wide(B, "t," + ",".join(six), lambda i: f"{_t(i):.2f}")
        + _lines("mean," + ",".join(["1.5"] * 6), "std," + ",".join(["0.1"] * 6)),
    )
    yield (
        "pandas melted",
        "B",
        ".csv",
        _lines(
            "time,variable,value",
            *(f"{_t(i):.2f},s{s},{B.text(i, s, 0)}" for s in _strips(B) for i in _SCANS),
        ),
    )
    yield (
        "json array",
        "A",
        ".json",
        json.dumps(
            [
                {
                    "time": _t(i),
                    "high": [A.text(i, s, 0, ".4f", "nan") for s in _strips(A)],
                    "low": [A.text(i, s, 1, ".4f", "nan") for s in _strips(A)],
                }
                for i in _SCANS
            ]
        ),
    )
    yield (
        "json of strips",
        "B",
        ".json",
        json.dumps(
            {
                "rate_hz": 50,
                "strips": [
                    [None if np.isnan(x) else round(float(x), 4) for x in B.volts[:, s, 0]]
                    for s in _strips(B)
                ],
            }
        ),
    )
    yield (
        "json lines, per reading",
        "A",
        ".jsonl",
        _lines(
            *(
                json.dumps(
                    {
                        "ts": 1_770_000_000_000 + 20 * i,
                        "strip": s,
                        "channel": "hl"[c],
                        "value": None if np.isnan(A.volts[i, s, c]) else round(float(A.volts[i, s, c]), 4),
                    }
                )
                for i in _SCANS
                for s in _strips(A)
                for c in (0, 1)
            )
        ),
    )
    yield (
        "influx line protocol",
        "A",
        ".txt",
        _long(
            A,
            lambda i, s: (
                f"tactile,strip={s} high={A.text(i, s, 0)},low={A.text(i, s, 1)} {1_770_000_000_000_000_000 + i * 20_000_000}"
                if A.text(i, s, 0)
                else ""
            ),
        ),
    )
    yield (
        "matlab disp",
        "B",
        ".txt",
        _lines(
            "",
            "data =",
            "",
            "   1.0e+03 *",
            "",
            *(
                "".join(
                    f"{'NaN' if np.isnan(x) else f'{x:.4f}':>10}" for x in [20 * i / 1e3, *(B.volts[i, :, 0])]
                )
                for i in _SCANS
            ),
            "",
        ),
    )
    yield (
        "matlab table",
        "B",
        ".txt",
        _lines(
            "    Time     " + "    ".join(f"Strip{s + 1}" for s in _strips(B)),
            "    ____    " + "    ".join(["_____"] * 6),
            "",
            *(
                f"    {_t(i):4.2f}    "
                + "    ".join(f"{B.text(i, s, 0, '.4f', 'NaN'):>6}" for s in _strips(B))
                for i in _SCANS
            ),
        ),
    )
    yield (
        "octave pages",
        "A",
        ".txt",
        _lines(
            " Columns 1 through 8:",
            "",
            *("".join(f"{A.text(i, s, 0, '.5f', 'NaN'):>10}" for s in _strips(A)) for i in _SCANS),
            "",
            " Columns 9 through 16:",
            "",
            *("".join(f"{A.text(i, s, 1, '.5f', 'NaN'):>10}" for s in _strips(A)) for i in _SCANS),
        ),
    )
    yield (
        "R write.table",
        "A",
        ".txt",
        _lines(
            '"time" "strip" "vh" "vl"',
            *(
                f'"{n + 1}" {_t(i):.2f} {s} {A.text(i, s, 0, ".4f", "NA")} {A.text(i, s, 1, ".4f", "NA")}'
                for n, (i, s) in enumerate(itertools.product(_SCANS, _strips(A)))
            ),
        ),
    )
    yield (
        "latex table",
        "B",
        ".tex",
        _lines(*(f"{_t(i):.2f} & " + _row(B, i, " & ", nothing="--") + r" \\" for i in _SCANS)),
    )
    # Spreadsheets and locales.
    yield (
        "german, thousands",
        "A",
        ".csv",
        "\ufeff"
        + _lines(
            "Zeit [ms];Streifen;oben [mV];unten [mV]",
            *(
                f"{20 * i};{s};"
                + ";".join(
                    A.text(i, s, c, ",.1f", "-", 1e3).translate(str.maketrans(",.", ".,")) for c in (0, 1)
                )
                for i in _SCANS
                for s in _strips(A)
            ),
            end="\r\n",
        ),
    )
    yield (
        "utf-16 with AM and PM",
        "A",
        ".txt",
        _lines(
            "Time\tStrip\tHigh (V)\tLow (V)",
            *(
                f"{_at(i):%I:%M:%S.%f}"[:-3] + f" AM\t{s + 1}\t{A.text(i, s, 0)}\t{A.text(i, s, 1)}"
                for i in _SCANS
                for s in _strips(A)
            ),
        ).encode("utf-16"),
    )
    yield (
        "serial days",
        "B",
        ".csv",
        _wide(
            B,
            "Date/Time;" + ";".join(f"U{s} / V" for s in _strips(B)),
            lambda i: _comma(f"{46095.3936756 + _t(i) / 86400:.10f}"),
            ";",
        ).replace(".", ","),
    )
    yield (
        "per mille",
        "D",
        ".csv",
        _wide(
            D,
            "t_ms," + ",".join(f"S{s + 1} [‰]" for s in _strips(D)),
            lambda i: f"{20 * i}",
            form=".1f",
            scale=200.0,
        ),
    )
    yield (
        "over Vref",
        "A",
        ".csv",
        _lines(
            "# normalised to Vref",
            "time [s]," + ",".join(f"h{s}/Vref,l{s}/Vref" for s in _strips(A)),
            *(f"{_t(i):.2f}," + _row(A, i, ",", ".4f", "nan", 0.2) for i in _SCANS),
        ),
    )
    yield (
        "columns in a mixed order",
        "A",
        ".csv",
        _lines(
            "t [ms]," + ",".join(f"L{s},H{s}" for s in (5, 0, 3, 1, 7, 2, 6, 4)),
            *(
                f"{20 * i}," + ",".join(A.text(i, s, c) for s in (5, 0, 3, 1, 7, 2, 6, 4) for c in (1, 0))
                for i in _SCANS
            ),
        ),
    )
    yield (
        "words of fingers",
        "B",
        ".csv",
        _wide(B, "time_ms,thumb,index,middle,ring,little,palm", lambda i: f"{20 * i}"),
    )
    yield (
        "near and far of pads",
        "A",
        ".csv",
        _wide(
            A,
            "ms," + ",".join(f"pad {s + 1} {e}" for s in _strips(A) for e in ("rail side", "open side")),
            lambda i: f"{20 * i}",
        ),
    )
    yield (
        "letters and ends",
        "A",
        ".csv",
        _wide(
            A, "ms," + ",".join(f"{chr(65 + s)}{e}" for s in _strips(A) for e in "HL"), lambda i: f"{20 * i}"
        ),
    )
    yield (
        "strips A to H in lines",
        "A",
        ".tsv",
        _long(
            A,
            lambda i, s: f"{20 * i}\t{chr(65 + s)}\t{A.text(i, s, 0)}\t{A.text(i, s, 1)}",
            "ms\tstrip\thigh\tlow",
        ),
    )
    yield (
        "position in mm",
        "A",
        ".csv",
        _long(
            A,
            lambda i, s: f"{_t(i):.2f},{6 * s + 3},{A.text(i, s, 0)},{A.text(i, s, 1)}",
            "t_s,x_mm,v_high,v_low",
        ),
    )
    yield (
        "quoted remarks",
        "B",
        ".csv",
        _lines(
            "time_s,note," + ",".join(six), *(f'{_t(i):.2f},"press, hard {i}",' + _row(B, i) for i in _SCANS)
        ),
    )
    yield (
        "temperature beside, summary",
        "B",
        ".csv",
        _lines(
            "t [s],Temp [C]," + ",".join(f"S{s} [V]" for s in _strips(B)) + ",Vcc [V]",
            *(f"{_t(i):.2f},23.{i % 3}," + _row(B, i) + ",3.31" for i in _SCANS),
            "",
            "Max,23.2," + ",".join(["2.5"] * 6) + ",3.31",
        ),
    )
    yield (
        "micros that wrap",
        "C",
        ".csv",
        _lines(
            "micros," + ",".join(f"h{s + 1},l{s + 1}" for s in _strips(C)),
            *(
                f"{(2**32 - 90_000 + 20_000 * i) % 2**32},"
                + ",".join(C.code(i, s, c, "-1", 10) for s in _strips(C) for c in (0, 1))
                for i in _SCANS
            ),
        ),
    )
    yield (
        "a reset with names again",
        "C",
        ".csv",
        "".join(
            ("ms,strip,high,low\n" if i in (0, 7) else "")
            + "".join(
                f"{20 * (i % 7)},{s + 1},{C.code(i, s, 0, '', 10)},{C.code(i, s, 1, '', 10)}\n"
                for s in _strips(C)
            )
            for i in _SCANS
        ),
    )
    yield "workbook, two header rows and mean", "A", ".xlsx", _workbook()
    yield "workbook, text and commas", "B", ".xlsx", _workbook_of_text()
    yield (
        "no names, epoch ms",
        "B",
        ".csv",
        _wide(B, "", lambda i: f"{1_770_000_000_000 + 20 * i}", form=".3f", nothing=""),
    )
    yield (
        "averaged codes",
        "C",
        ".csv",
        _lines(
            "ms,strip,adc_h,adc_l",
            *(
                f"{20 * i},{s + 1},{C.text(i, s, 0, '.2f', 'nan', 1023 / 5)},{C.text(i, s, 1, '.2f', 'nan', 1023 / 5)}"
                for i in _SCANS
                for s in _strips(C)
            ),
        ),
    )
    yield (
        "two clocks, raw and volts",
        "B",
        ".csv",
        _long(
            B,
            lambda i, s: f"{_at(i):%H:%M:%S},{20 * i},{s},{B.code(i, s, 0, '')},{B.text(i, s, 0)}",
            "wall,millis,strip,raw,volts",
        ),
    )


def _workbook() -> bytes:
    import openpyxl

    book = openpyxl.Workbook()
    sheet = book.active
    sheet.append(["Pad 3"])
    sheet.append([])
    sheet.append(["Time", *(x for s in _strips(A) for x in (f"Strip {s + 1}", None))])
    sheet.append(["ms", *["H (V)", "L (V)"] * 8])
    for i in _SCANS:
        sheet.append([20 * i, *(None if np.isnan(x) else round(float(x), 4) for x in A.volts[i].ravel())])
    sheet.append(["Mean", *[1.5] * 16])
    buffer = io.BytesIO()
    book.save(buffer)
    return buffer.getvalue()


def _workbook_of_text() -> bytes:
    import openpyxl

    book = openpyxl.Workbook()
    sheet = book.active
    sheet.append(["Nr.", "Zeit", *(f"Streifen {s + 1}" for s in _strips(B)), "Bemerkung"])
    for i in _SCANS:
        sheet.append(
            [
                i + 1,
                _comma(f"{_t(i):.2f}"),
                *(_comma(B.text(i, s, 0, ".3f", "offen")) for s in _strips(B)),
                "los" if i == 0 else None,
            ]
        )
    buffer = io.BytesIO()
    book.save(buffer)
    return buffer.getvalue()


def _wrong(found: Proposal, bench: Bench) -> str:
    """Return what is not as it was; "" where all is."""
    sensor, volts = bench.sensor, bench.volts
    head, rows = as_readings(found.scans, found.mapping, sensor.vref_volt, sensor.strip_base)
    scale = sensor.vref_volt / (2.0 ** (sensor.adc_bits or 0) - 1.0) if "code" in head[-1] else 1.0
    read = np.array([[float(x or "nan") for x in row[3:]] for row in rows]) * scale
    if read.size != volts.size:
        return f"{len(found.scans)} scans of {len(read)} lines and {read.shape[-1]} channels"
    off = np.abs(read.reshape(volts.shape) - volts)
    lost = np.isnan(read.reshape(volts.shape)) != np.isnan(volts)
    times = np.array([s.time_s for s in found.scans])
    late = np.abs(times - times[0] - np.arange(len(times)) / _RATE_HZ).max()
    if lost.any():
        return f"{int(lost.sum())} readings where nothing touched, or none where something did"
    if np.nanmax(off) > 0.0055:
        return f"readings are off by up to {np.nanmax(off):.3g} V"
    return f"times are off by up to {late:.3g} s" if late > 1.1e-3 and found.mapping.timed else ""


def _round(file: Path, bench: Bench, answers: dict[str, str]) -> tuple[str, str, list[list[tuple[str, str]]]]:
    """Import once: what became of it, why, and the answers that are suggested."""
    try:
        found = propose(read_table(file, answers.get("sheet")), bench.sensor, answers)
    except Unanswered as asked:
        rate = {"rate_hz": [f"{_RATE_HZ:g}"]}
        ways = [[(q.key, a) for a in rate.get(q.key, q.choices)] for q in asked.questions]
        return "asked", " | ".join(map(str, asked.questions)), ways
    except SeveralSheets as asked:
        return "asked", str(asked), [[("sheet", name)] for name in str(asked).split(", ")]
    except ts.TacstripError as error:
        return "refused", str(error), []
    off = _wrong(found, bench)
    return "WRONG" if off else "right" if found.mapping.timed else "no time", off, []


def score(file: Path, bench: Bench) -> tuple[str, str]:
    """Return "right", "no time" (where the log has none), "one answer", "one round", "asked again", "refused" or "WRONG" (without a word), and why."""
    kind, why, ways = _round(file, bench, {})
    if kind != "asked":
        return kind, why
    for answers in itertools.islice(itertools.product(*ways), 64):
        if _round(file, bench, dict(answers))[0] == "right":
            return "one answer" if len(answers) == 1 else "one round", why
    return "asked again", why


def main() -> None:
    """Print what becomes of each form, and how many of each kind there are."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--keep", type=Path, help="write the logs there")
    parser.add_argument("names", nargs="*")
    given = parser.parse_args()
    counted: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        for name, bench, ending, content in _forms():
            if given.names and name not in given.names:
                continue
            file = (given.keep or Path(folder)) / (name.replace(" ", "-").replace(",", "") + ending)
            file.write_bytes(content if isinstance(content, bytes) else content.encode())
            kind, why = score(file, BENCHES[bench])
            counted[kind] += 1
            print(f"{kind:12} {name}{': ' + why if why else ''}")
    print(dict(counted))


if __name__ == "__main__":
    main()
