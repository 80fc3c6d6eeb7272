"""Logs as people write them give the readings that are in them; what is composed at random never gives others."""
# ruff: noqa: E501 (a line is a form)

from __future__ import annotations

import json
import random
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import example, given, settings
from hypothesis import strategies as st

import tacstrip as ts
from tacstrip.cli import cli
from tacstrip.io.log_import.containers import read_table
from tacstrip.io.log_import.fields import array_of, clock_seconds, number_of, quantity
from tacstrip.io.log_import.guess import propose
from tacstrip.io.log_import.names import meaning, meanings
from tacstrip.io.log_import.questions import Unanswered
from tacstrip.io.log_import.records import items
from tacstrip.io.log_import.scans import scans
from tacstrip.io.log_import.text import of_text

TWO = ts.Sensor(construction="crs-crs", strips=5, pitch_mm=10.0, length_mm=50.0, vref_volt=5.0, adc_bits=10)
ONE = ts.Sensor(construction="crs-m", strips=5, pitch_mm=10.0, length_mm=50.0, vref_volt=3.3, adc_bits=12)
S, N = range(5), range(6)
SHAPE = ts.Contact.polygon([(-15, -12), (18, -8), (12, 15), (-14, 12)])


def _codes(sensor: ts.Sensor) -> dict[str, np.ndarray]:
    made = [ts.simulate(sensor, SHAPE.placed(22 + 0.5 * i, 24)) for i in N]
    most = 2 ** (sensor.adc_bits or 0) - 1
    return {
        name: np.round(np.stack([scan[name] for scan in made]) * most) / most for name in made[0].signatures
    }


K = _codes(TWO) | _codes(ONE)


def v(
    name: str, i: int, s: int, scale: float = 5.0, form: str = ".3f", nothing: str = "", comma: bool = False
) -> str:
    k = K[name][i, s]
    return nothing if np.isnan(k) else format(scale * k, form).replace(".", "," if comma else ".")


def c(name: str, i: int, s: int, nothing: str = "-1") -> str:
    return v(name, i, s, 1023.0, ".0f", nothing)


def hl(by: str, i: int, s: int, **way: object) -> str:
    return by.join(v(n, i, s, **way) for n in ("kh", "kl"))  # type: ignore[arg-type]


def each(line: Callable[[int, int], str], head: str = "", before: Callable[[int], str] = lambda i: "") -> str:
    """A line for each strip of each scan."""
    return head + "".join(before(i) + "".join(line(i, s) + "\n" for s in S) for i in N)


def scan(line: Callable[[int], str], head: str = "") -> str:
    return head + "".join(line(i) + "\n" for i in N)


CODES = "ms,strip,code_h,code_l\n"
HL = "ms,strip,h,l\n"
FORMS: dict[str, tuple[ts.Sensor, str, dict[str, str]]] = {
    # Lines that name their values.
    "serial plotter": (
        TWO,
        scan(lambda i: f"t:{20 * i} " + " ".join(f"H{s}:{c('kh', i, s)} L{s}:{c('kl', i, s)}" for s in S)),
        {},
    ),
    "key=value with units, logging module": (
        TWO,
        each(
            lambda i, s: (
                f"2026-03-04 10:00:00,{20 * i:03d} INFO tac: strip={s} "
                f"vh={v('kh', i, s, nothing='nan')}V vl={v('kl', i, s, nothing='nan')}V"
            )
        ),
        {},
    ),
    "labels above sentences": (
        TWO,
        each(
            lambda i, s: f"Strip {s + 1}: H={c('kh', i, s, '---')} L={c('kl', i, s, '---')}",
            before=lambda i: f"--- Scan {i}, t = {20 * i} ms ---\n",
        ),
        {},
    ),
    "several lines a scan": (
        ONE,
        "".join(
            f"TIME: {20 * i} ms\n" + "".join(f"  CH{s} = {v('k', i, s, 3.3, nothing='open')} V\n" for s in S)
            for i in N
        ),
        {},
    ),
    "two lists a line": (
        TWO,
        scan(
            lambda i: (
                f"{20 * i} ms H: "
                + " ".join(c("kh", i, s) for s in S)
                + " | L: "
                + " ".join(c("kl", i, s) for s in S)
            )
        ),
        {},
    ),
    "JSON lines, nested": (
        TWO,
        scan(
            lambda i: json.dumps(
                {
                    "ts": f"2026-03-04T10:00:00.{20 * i:03d}Z",
                    "strips": [
                        {
                            "id": s,
                            "high_mV": float(v("kh", i, s, 5e3, ".1f", "nan")),
                            "low_mV": float(v("kl", i, s, 5e3, ".1f", "nan")),
                        }
                        for s in S
                    ],
                }
            )
        ),
        {},
    ),
    "an object of columns": (
        ONE,
        json.dumps(
            {"time_s": [0.02 * i for i in N]}
            | {f"strip{s}_V": [float(v("k", i, s, 3.3, ".4f", "nan")) for i in N] for s in S}
        ),
        {},
    ),
    "tuples of Python": (
        ONE,
        scan(lambda i: f"({20 * i}, [{', '.join(v('k', i, s, 4095.0, '.0f', 'None') for s in S)}])"),
        {"unit": "code"},
    ),
    # Blocks.
    "rows below labels": (
        TWO,
        each(
            lambda i, s: f"{s}\t{hl(chr(9), i, s, nothing='-')}", before=lambda i: f"scan {i} t={20 * i}ms\n"
        ),
        {},
    ),
    "blocks below comments, decimal commas": (
        TWO,
        each(
            lambda i, s: f"{s + 1};{hl(';', i, s, nothing='-', comma=True)}",
            before=lambda i: f"# t = {0.02 * i:.2f} s\n",
        ),
        {},
    ),
    "blocks of as many lines": (
        TWO,
        "\n".join("".join(hl(" ", i, s, nothing="nan") + "\n" for s in S) for i in N),
        {"rate_hz": "50"},
    ),
    # Names in several lines, units in them.
    "two lines of names": (
        TWO,
        scan(
            lambda i: f"{20 * i};" + ";".join(hl(";", i, s, comma=True) for s in S),
            "t [ms];"
            + ";".join(f"Streifen {s + 1};" for s in S)
            + "\n;"
            + ";".join("oben;unten" for s in S)
            + "\n",
        ),
        {},
    ),
    "names of pandas in three lines": (
        TWO,
        scan(
            lambda i: f"{0.02 * i:.2f}," + ",".join(hl(",", i, s) for s in S),
            "strip,"
            + ",".join(f"{s},{s}" for s in S)
            + "\nchannel,"
            + ",".join("h,l" for s in S)
            + "\ntime,,,,,,,,,,\n",
        ),
        {},
    ),
    "LabVIEW": (
        ONE,
        scan(
            lambda i: (
                f"{0.02 * i:.6f}\t".replace(".", ",")
                + "\t".join(v("k", i, s, 3.3, ".6f", comma=True) for s in S)
            ),
            "LabVIEW Measurement\nSeparator\tTab\n***End_of_Header***\n\nChannels\t5\t\t\t\t\nY_Unit_Label"
            + "\tVolts" * 5
            + "\nX_Dimension"
            + "\tTime" * 5
            + "\n***End_of_Header***\nX_Value\t"
            + "\t".join(f"S{s}" for s in S)
            + "\n",
        ),
        {},
    ),
    "an oscilloscope": (
        ONE,
        scan(
            lambda i: f"{-0.04 + 0.02 * i:.5E}," + ",".join(v("k", i, s, 3.3, ".5E") for s in S),
            "Record Length,6,Points\nSample Interval,0.02,s\n,,\nTIME,"
            + ",".join(f"CH{s + 1}" for s in S)
            + "\nsecond"
            + ",Volt" * 5
            + "\n",
        ),
        {},
    ),
    "MATLAB": (
        TWO,
        each(lambda i, s: f"{0.02 * i:g},{s},{hl(',', i, s, nothing='NaN')}", "Time_s_,Strip,Vh_V_,Vl_V_\n"),
        {},
    ),
    "a rate above, no time": (
        ONE,
        scan(
            lambda i: f"{i};" + ";".join(v("k", i, s, 3.3) for s in S),
            "Sampling rate: 50 Hz\n\nSample;" + ";".join(f"AI{s} [V]" for s in S) + "\n",
        ),
        {},
    ),
    "modules before the inputs": (
        ONE,
        scan(
            lambda i: f"03/04/2026 10:00:00.{20 * i:03d}\t" + "\t".join(v("k", i, s, 3.3) for s in S),
            "time\t" + "\t".join(f"Dev1/ai{s} (V)" for s in S) + "\n",
        ),
        {},
    ),
    # Fields of another kind.
    "arrays in fields": (
        TWO,
        scan(
            lambda i: (
                f'{1772000000.5 + 0.02 * i:.2f},{i},"['
                + ", ".join(v("kh", i, s, 1.0, ".4f", "nan") for s in S)
                + ']","['
                + ", ".join(v("kl", i, s, 1.0, ".4f", "nan") for s in S)
                + ']"'
            ),
            "rosbagTimestamp,seq,kh,kl\n",
        ),
        {},
    ),
    "units in fields, mixed": (
        TWO,
        each(
            lambda i, s: (
                f"{20 * i}ms,#{s + 1},{v('kh', i, s, nothing='-')}V,{v('kl', i, s, 5e3, '.0f', '-')} mV".replace(
                    "-V", "-"
                )
            ),
            "t,strip,h,l\n",
        ),
        {},
    ),
    "hexadecimal": (
        TWO,
        each(
            lambda i, s: (
                f"{20 * i};{s};"
                + ";".join(hex(int(x)) if (x := c(n, i, s, "")) else "" for n in ("kh", "kl"))
            ),
            "ms;strip;H;L\n",
        ),
        {},
    ),
    "AM and PM, strips #1": (
        TWO,
        each(lambda i, s: f"12:00:00.{20 * i:03d} PM;#{s + 1};{hl(';', i, s)}", "Time;Strip;High;Low\n"),
        {},
    ),
    "minutes and seconds, S01": (
        ONE,
        each(
            lambda i, s: f"01:{2 + 0.02 * i:05.2f}\tS{s + 1:02d}\t{v('k', i, s, 3.3)}",
            "Zeit\tStreifen\tSpannung\n",
        ),
        {},
    ),
    "places in centimetres": (
        TWO,
        each(lambda i, s: f"{0.02 * i:.2f},{s:.1f},{hl(',', i, s)}", "t_s,x_cm,high_V,low_V\n"),
        {},
    ),
    "both channels at 0": (
        TWO,
        scan(lambda i: f"{20 * i}," + ",".join(f"{c('kh', i, s, '0')},{c('kl', i, s, '0')}" for s in S)),
        {},
    ),
    # Clocks.
    "micros that begin anew": (
        TWO,
        each(
            lambda i, s: f"{(2**32 - 50_000 + 20_000 * i) % 2**32}, {s}, {hl(', ', i, s, nothing='-1')}",
            "# micros, strip, high, low\n",
        ),
        {},
    ),
    "ticks of 16 bits": (
        ONE,
        scan(
            lambda i: f"{(65480 + 20 * i) % 65536}\t" + "\t".join(v("k", i, s, 3.3, nothing="--") for s in S),
            "time_ms\t" + "\t".join(f"strip{s}" for s in S) + "\n",
        ),
        {},
    ),
    "a reset, and the names again": (
        TWO,
        "".join(
            ("ms,strip,h_V,l_V\n" if i in (0, 3) else "")
            + "".join(f"{20 * (i % 3)},{s},{hl(',', i, s)}\n" for s in S)
            for i in N
        ),
        {},
    ),
    # Other shapes.
    "melted, strip after strip": (
        TWO,
        "".join(
            f"{n},{0.02 * i:.2f},{key}[{s}],{v(name, i, s)}\n"
            for n, (key, name, s, i) in enumerate(
                (key, name, s, i) for key, name in (("vh", "kh"), ("vl", "kl")) for s in S for i in N
            )
        ).join([",t,variable,value\n", ""]),
        {},
    ),
    "a line of each channel": (
        TWO,
        "".join(
            f"{20 * i},{e.upper()}," + ",".join(c(f"k{e}", i, s) for s in S) + "\n" for i in N for e in "hl"
        ),
        {},
    ),
    "channels 0 and 1": (
        TWO,
        "time_ms,strip,ch,adc\n"
        + "".join(f"{20 * i},{s},{e},{c(('kl', 'kh')[e], i, s, '')}\n" for i in N for s in S for e in (0, 1)),
        {},
    ),
    "only touched strips": (
        TWO,
        each(
            lambda i, s: f"{i},{0.02 * i:.2f},{s},{hl(',', i, s)}" if v("kh", i, s) else "",
            "scan,time_s,strip,v_h,v_l\n",
        )
        .replace("\n\n", "\n")
        .replace("\n\n", "\n"),
        {"strip_base": "0"},
    ),
    "codes and volts of the same": (
        ONE,
        each(
            lambda i, s: f"{0.02 * i:.2f};{s};{v('k', i, s, 4095.0, '.0f')};{v('k', i, s, 3.3)}",
            "t;strip;adc;volt\n",
        ),
        {},
    ),
    "codes of another converter": (
        ONE,
        scan(
            lambda i: f"{20 * i}," + ",".join(v("k", i, s, 16383.0, ".0f") for s in S),
            "t_ms," + ",".join(f"code_{s}" for s in S) + "\n",
        ),
        {"adc_bits": "14"},
    ),
    "a word before the names, pairs": (
        TWO,
        scan(
            lambda i: (
                f"{'HOLD' if i else 'PRESS'} t={0.02 * i:.2f}s | "
                + " | ".join(f"strip{s}: {hl('/', i, s, nothing='--')} V" for s in S)
            )
        ),
        {},
    ),
    "the same word before each line": (
        ONE,
        each(lambda i, s: f"[10:00:00.{20 * i:03d}] RX: {s},{v('k', i, s, 3.3)}"),
        {},
    ),
    "a comment above that is no name": (
        TWO,
        "# gain 1\n# rate 50 Hz\n"
        + "\n\n".join("".join(hl(" ", i, s, nothing="nan") + "\n" for s in S) for i in N),
        {},
    ),
    "a time of another language": (
        ONE,
        each(lambda i, s: f"{0.02 * i:.2f};{s};{v('k', i, s, 3.3)}", "Laikas;strip;volt\n"),
        {"time_unit": "s"},
    ),
    "the noise of open inputs, in both channels at once": (
        TWO,
        each(lambda i, s: f"{20 * i},{s},{c('kh', i, s, str(s % 3))},{c('kl', i, s, str(i % 2))}", HL),
        {},
    ),
    # As programs and instruments print.
    "tuples within lists": (
        TWO,
        scan(
            lambda i: str(
                (
                    0.02 * i,
                    [
                        None if np.isnan(K["kh"][i, s]) else tuple(float(v(k, i, s)) for k in ("kh", "kl"))
                        for s in S
                    ],
                )
            )
        ),
        {},
    ),
    "a data logger's inputs, with alarms and what is over its range": (
        ONE,
        scan(
            lambda i: (
                f"{i},03/04/2026 10:00:00:{20 * i:03d},"
                + ",".join(v("k", i, s, 3.3, ".6E", "9.9E+37") + ",0" for s in S)
            ),
            "Scan,Time," + ",".join(f"{101 + s} <S{s + 1}> (VDC),Alarm {101 + s}" for s in S) + "\n",
        ),
        {},
    ),
    "pairs of names that only count, a row of means": (
        TWO,
        scan(
            lambda i: f"{20 * i}," + ",".join(hl(",", i, s) for s in S),
            "ms," + ",".join(f"pad {s} rail side,pad {s} open side" for s in S) + "\n",
        )
        + "Mean,"
        + ",".join(["1.5"] * 10)
        + "\n",
        {},
    ),
    "letters": (
        ONE,
        scan(lambda i: f"{20 * i}," + ",".join(v("k", i, s, 3.3) for s in S), "ms,A,B,C,D,E\n"),
        {},
    ),
    "letters in lines": (
        TWO,
        each(lambda i, s: f"{20 * i}\t{'ABCDE'[s]}\t{hl(chr(9), i, s)}", "ms\tstrip\tH\tL\n"),
        {},
    ),
    "hexadecimal without a mark": (
        TWO,
        scan(
            lambda i: (
                f"[{20 * i:05d}] " + " ".join(f"{int(c(k, i, s, '0')):03X}" for s in S for k in ("kh", "kl"))
            )
        ),
        {},
    ),
    "a strip in each line, since 1970": (
        TWO,
        each(
            lambda i, s: (
                f"{1.77e9 + 0.02 * i:.2f} strip{s} H={v('kh', i, s, nothing='nan')} L={v('kl', i, s, nothing='nan')}"
            )
        ),
        {},
    ),
    "an index without a name": (
        TWO,
        '"t" "strip" "vh" "vl"\n'
        + "".join(
            f'"{5 * i + s + 1}" {0.02 * i:.2f} {s} {hl(" ", i, s, nothing="NA")}\n' for i in N for s in S
        ),
        {},
    ),
    "microvolts, a clock in two columns": (
        ONE,
        scan(
            lambda i: f"10:00:00,{20 * i}," + ",".join(v("k", i, s, 3.3e6, ".0f") for s in S),
            "Time,mSec," + ",".join(f"S{s} [µV]" for s in S) + "\n",
        ),
        {},
    ),
    "per mille, messages between": (
        ONE,
        scan(
            lambda i: (
                ("[WARN] 80% full\n" if i == 3 else "")
                + f"{20 * i};"
                + ";".join(v("k", i, s, 1e3, ".1f") for s in S)
            ),
            "ms;" + ";".join(f"S{s} [‰]" for s in S) + "\n",
        ),
        {},
    ),
    "names of no known word": (
        ONE,
        scan(
            lambda i: f"{20 * i}," + ",".join(v("k", i, s, 3.3) for s in S),
            "ms,thumb,index,middle,ring,little\n",
        ),
        {"readings": "thumb..little"},
    ),
    "boot messages": (
        TWO,
        each(
            lambda i, s: f"{800 + 20 * i}\t{s}\t{hl(chr(9), i, s, nothing='nan')}",
            "rst:0x1 (POWERON_RESET),boot:0x13\nCalibration done.\nms\tstrip\tVH\tVL\n",
        ),
        {},
    ),
}


@pytest.mark.parametrize("form", FORMS)
def test_a_form_gives_its_readings_after_its_only_question(form: str) -> None:
    sensor, text, answers = FORMS[form]
    if {*answers} - {"rate_hz"}:
        with pytest.raises(Unanswered) as asked:
            propose(of_text(text), sensor)
        assert {q.key for q in asked.value.questions} == set(answers)
        assert all(f"--answer {key}=" in str(asked.value) for key in answers)
    table = of_text(text)
    found = propose(table, sensor, answers)
    _check(found.scans, found.mapping.unit, sensor, found.mapping.adc_bits)
    _check(scans(table, found.mapping), found.mapping.unit, sensor, found.mapping.adc_bits)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (each(lambda i, s: f"t={20 * i} strip={s} H=2121 L=18{'2?' if i == s == 3 else '21'}"), "not like"),
        ("2.02;1.1;1.2;1.3;1.4;1.5\n" + scan(lambda i: f"{4.6e9 + 0.02 * i:.2f};1.1;1.2;1.3;1.4;1.{i}"), "is cut"),
    ],
)  # fmt: skip
def test_what_is_damaged_is_never_read_as_if_it_were_whole(text: str, says: str) -> None:
    with pytest.raises((Unanswered, ts.ReadingError), match=says):
        propose(of_text(text), TWO if "strip=" in text else ONE)


@pytest.mark.parametrize("way", ["by and by", "alone"])
def test_what_is_near_0_in_a_single_channel_is_asked(way: str) -> None:
    """A contact takes its reading to the end of a strip by and by; of two channels never both are there."""
    edge = {
        "by and by": [550, 410, 270, 130, 0, 1],
        "alone": [0, 1, 0, 1, 0, 2],
    }[way]
    rows = [f"{20 * i},{e},{600 + 9 * i},{620 - 9 * i}" for i, e in enumerate(edge)]
    table = of_text("# 10 bit\nms,code_0,code_1,code_2\n" + "\n".join(rows))
    with pytest.raises(Unanswered, match="untouched="):
        propose(table, THREE)


def _check(found: list, unit: str, sensor: ts.Sensor, bits: int) -> None:  # type: ignore[type-arg]
    most = 2 ** (bits or sensor.adc_bits or 0) - 1
    top = {
        "V": sensor.vref_volt, "mV": 1e3 * sensor.vref_volt, "uV": 1e6 * sensor.vref_volt, "permille": 1e3,
        "percent": 100.0, "fraction": 1.0, "code": most,
    }[unit]  # fmt: skip
    for n, name in enumerate(sensor.signatures):
        np.testing.assert_allclose(np.stack([one.values[:, n] for one in found]) / top, K[name], atol=3e-4)
    assert [one.time_s for one in found] == pytest.approx([0.02 * i for i in N], abs=1e-6)


@pytest.mark.parametrize(
    ("text", "key"),
    [
        # A record of other names, or of other digits than those understood, is never passed over.
        (scan(lambda i: "".join(f"s{s}:{v('k', i, s, 3.3, nothing='-')} " for s in S[: 4 + (i > 0)])), "broken_lines"),
        ("t=0 s0=1 s1=2V7 s2=1 s3=1 s4=2\n" + "t=20 s0=1 s1=2.7 s2=1 s3=1 s4=2\n" * 9, "broken_lines"),
        # One channel by its name, the other perhaps by one that says nothing.
        (each(lambda i, s: f"{0.02 * i:.2f};{s};{hl(';', i, s)}", "t;strip;foo;low\n"), "foo"),
        # Codes above what the spec's converter gives.
        (
            each(lambda i, s: f"{20 * i},{s}," + ",".join(v(n, i, s, 4095.0, ".0f") for n in ("kh", "kl")), CODES),
            "adc_bits",
        ),
    ],
)  # fmt: skip
def test_what_was_once_read_wrong_without_a_word_is_asked(text: str, key: str) -> None:
    sensor = ONE if "s0" in text else TWO
    with pytest.raises(Unanswered) as asked:
        propose(of_text(text), sensor)
    assert key in {question.key for question in asked.value.questions}


THREE = ts.Sensor(construction="crs-m", strips=3, pitch_mm=10.0, length_mm=50.0, vref_volt=5.0)
RISING = "".join(f"{20 * i},{1.1 + 0.013 * i * i:.3f},1.3,{1.4 - 0.01 * i:.2f},4.96\n" for i in range(8))
NOISE = "t,s0,s1,s2\n" + "".join(f"{0.2 * i:.1f},1.1,1.2,0.0{12 + 7 * (i % 5)}\n" for i in range(8))


@pytest.mark.parametrize(
    ("text", "key"),
    [
        (
            "time_s,S0,S1,S2\n0,1134,1338,1529\n0.1,1177,2356,3330\n0.2,1180,2360,3200\n",
            "unit",
        ),  # mV or codes
        (RISING, "readings"),  # the time and the strips, or a count, the time, and so on
        (NOISE, "untouched"),
    ],
)
def test_what_two_readings_of_a_log_explain_is_asked(text: str, key: str) -> None:
    with pytest.raises(Unanswered) as asked:
        propose(of_text(text), THREE)
    assert key in {question.key for question in asked.value.questions}
    if key == "untouched":  # what is offered takes no reading
        assert 0.04 < float(re.search(r"untouched=<([\d.]+)", str(asked.value))[1]) < 1.1  # type: ignore[index]


def test_a_line_that_stands_twice_is_no_scan_of_its_own() -> None:
    lines = [f"{0.1 * i:.1f},{s},1.{s + 1}" for i in range(4) for s in range(3)]
    lines.insert(5, lines[4].replace("1.2", "1.25"))
    with pytest.raises(ts.ReadingError, match="strip 1 is already on line 6"):
        propose(of_text("\n".join(["t,strip,v_out", *lines])), THREE)


def test_what_has_a_default_is_not_asked_beside_the_columns() -> None:
    text = scan(lambda i: ",".join(v("k", i, s, 3.3) for s in S), "thumb,index,middle,ring,little\n")
    with pytest.raises(Unanswered) as asked:
        propose(of_text(text), ONE)
    assert [q.key for q in asked.value.questions] == ["readings"]
    answers = {"readings": asked.value.questions[0].choices[0], "rate_hz": "50"}
    _check(propose(of_text(text), ONE, answers).scans, "V", ONE, 0)
    with pytest.raises(ts.OptionError, match="these are 4 columns, and the sensor has 5 readings"):
        propose(of_text(text), ONE, {"readings": "thumb..ring"})


def test_names_of_more_columns_than_lines_have_are_not_passed_over() -> None:
    lines = [
        f"{0.02 * i:.2f}" + ("    1.1   1.2      " if i % 3 else "          1.4   1.2") for i in range(8)
    ]
    with pytest.raises(ts.ReadingError, match="line 1 names 4 columns, and most lines have 3 fields"):
        propose(of_text("\n".join(["t/s      S1    S2    S3", *lines])), THREE)


def test_readings_in_frames_of_another_form_and_what_they_leave_open() -> None:
    class Frame(dict[str, list[object]]):
        columns = property(list)

    frame = Frame(
        {"t_ms": [20 * i for i in N]}
        | {f"{end}{s} (V)": list(5.0 * K[f"k{end}"][:, s]) for s in S for end in "hl"}
    )
    read = ts.read_readings(frame, TWO)
    np.testing.assert_allclose(np.stack([one["kl"] for one in read]), K["kl"], atol=1e-9)
    assert [one.time_s for one in read] == pytest.approx([0.02 * i for i in N])
    untimed = ts.read_readings(Frame({k: w for k, w in frame.items() if k != "t_ms"}), TWO)
    assert [one.time_s for one in untimed] == [0.0 for _ in N]
    with pytest.raises(ts.ReadingError, match="in which unit"):
        ts.read_readings(
            Frame({k.replace("_ms", ""): w for k, w in frame.items()} | {"t": [5.0 * i for i in N]}), TWO
        )


def _composed(seed: int) -> tuple[str, np.ndarray, float, str]:
    """Return a log of a random form, its readings over Vref, their tolerance, and the unit that it is in."""
    r = random.Random(seed)
    unit, places = r.choice([("V", 3), ("mV", 1), ("code", 0), ("fraction", 4), ("percent", 2)])
    scale = {"V": 5.0, "mV": 5e3, "code": 1023.0, "fraction": 1.0, "percent": 100.0}[unit]
    comma = r.random() < 0.4
    by = r.choice([";", "\t", " ", "|"] if comma else [",", ";", "\t", " ", "|"])
    nothing = r.choice(["nan", "-", "n/a", "-1", "0"])
    base, wide, head = r.choice([0, 1]), r.random() < 0.5, r.random() < 0.8
    ends = r.choice([("h", "l"), ("l", "h")])
    names = {"h": r.choice(["h", "high", "oben", "v_h"])}
    names["l"] = {"h": "l", "high": "low", "oben": "unten", "v_h": "v_l"}[names["h"]]
    said = {"percent": "%"}.get(unit, unit) if r.random() < 0.6 and unit not in ("code", "fraction") else ""
    of = {end: names[end] + (f"[{said}]" if said else "") for end in "hl"}
    clock = r.choice(["{:.0f}", "{:.2f}", "10:00:{:06.3f}"])

    def value(end: str, i: int, s: int) -> str:
        return v(f"k{end}", i, s, scale, f".{places}f", nothing, comma)

    def time(i: int) -> str:
        text = clock.format(20 * i if clock == "{:.0f}" else 0.02 * i)
        return text.replace(".", ",") if comma else text

    columns = (
        [(s, end) for s in S for end in ends] if r.random() < 0.5 else [(s, end) for end in ends for s in S]
    )
    if wide:
        top = by.join(["time", *(f"S{s + base}_{of[end]}" for s, end in columns)])
        lines = [by.join([time(i), *(value(end, i, s) for s, end in columns)]) for i in N]
    else:
        top = by.join(["time", "strip", *(of[end] for end in ends)])
        lines = [by.join([time(i), str(s + base), *(value(end, i, s) for end in ends)]) for i in N for s in S]
    text = "\n".join(r.choice([[], ["# bench 7"], ["Operator: KB", ""]]) + [top] * head + lines) + "\n"
    return text, np.stack([K["kh"], K["kl"]], axis=-1), 0.51 * 10.0**-places / scale, unit


def test_what_is_composed_at_random_is_read_right_or_asked_never_otherwise() -> None:
    right = 0
    for seed in range(40):
        text, readings, tolerance, unit = _composed(seed)
        try:
            found = propose(of_text(text), TWO)
        except (Unanswered, ts.ReadingError):
            continue
        assert found.mapping.unit == unit, text
        top = {"V": 5.0, "mV": 5e3, "code": 1023.0, "fraction": 1.0, "percent": 100.0}[unit]
        read = np.stack([one.values for one in found.scans]) / top
        np.testing.assert_allclose(read, readings, atol=tolerance, err_msg=text)
        assert [one.time_s for one in found.scans] == pytest.approx([0.02 * i for i in N], abs=1e-6), text
        right += 1
    assert right > 24


TRIO = ts.Sensor(construction="crs-crs", strips=3, pitch_mm=10.0, length_mm=50.0, vref_volt=5.0, adc_bits=12)
_HEAD = "time_s,vh0,vl0,vh1,vl1,vh2,vl2\n"
_TWO_SCANS = "0.00,2.513,1.204,,,,\n0.05,2.541,1.233,2.713,1.322,,\n"


def test_a_last_label_without_readings_is_left_out_and_costs_no_other_scan() -> None:
    strips = [
        f"strip {s}: hi={2 + 0.1 * n + 0.2 * s:.1f}V lo={1 + 0.1 * n:.1f}V"
        for n in range(3)
        for s in range(3)
    ]
    frames = [f"FRAME {n} t={9 * n}ms\n" + "\n".join(strips[3 * n : 3 * n + 3]) for n in range(3)]
    found = propose(of_text("\n".join([*frames, "FRAME 3 t=27ms"])), TRIO)
    assert [round(scan.time_s, 3) for scan in found.scans] == [0.0, 0.009, 0.018]
    assert any(
        "line 13 ('FRAME 3 t=27ms'), the last, says nothing of a strip" in doubt for doubt in found.doubts
    )


@pytest.mark.parametrize(
    ("log", "said"),
    [
        (_HEAD.replace("v", "") + _TWO_SCANS + "0.10,,,2740,1.355,3.010,1.721\n", "line 4, h1: 2740"),
        ("t_ms,strip,vh,vl\n0,0,2513,1204\n0,1,2713,1322\n0,2,,\n50,0,2541,1233\n50,1,2.722,1.333\n50,2,,\n", "line 6, vh"),
        ("t_ms,strip,vh,vl\n0,0,2.513,1.204\n0,1,,\n0,2,,\n50,0,2541,1233\n50,1,2713,1322\n50,2,,\n", "line 2, vh: 2.513"),
        (_HEAD.replace("vh", "h").replace("vl", "l") + "0,0.513,0.204,,,,\n0.05,0.541,0.233,0.913,0.322,,\n", "unit=V or"),
        (re.sub(r"([vhl]+\d)", r"\1 [mA]", _HEAD) + _TWO_SCANS, "'mA' is no unit"),
        (re.sub(r"([vhl]+\d)", r"\1 [10 mV]", _HEAD) + _TWO_SCANS, "'10 mV' is no unit"),
        (re.sub(r"([vhl]+\d)", r"\1 x10 [V]", _HEAD) + _TWO_SCANS, "'x10' is no unit"),
        ("time_s,strip,v_mid,v_sigma\n0,0,1.858,1.309\n0,1,,\n0,2,,\n1,0,1.9,1.3\n1,1,2.0,1.4\n1,2,,\n", "'v_mid' is called"),
        (_HEAD + _TWO_SCANS + "0.10,,,2.740,1.355,,\n0.15,,,2.7,1.3,,\n,2.527,1.219,2.727,1.339,,\n", "line(s) 6 (',2.527"),
        ("# Vref = 3.3 V\n" + _HEAD + _TWO_SCANS, "the log says Vref = 3.3 V"),
        ("# ADC 10 bit\n" + _HEAD.replace("v", "code_") + "0,513,204,,,,\n0.1,541,233,713,322,,\n", "the log says 10 bit"),
        ("vref," + _HEAD + "5.0,0,2.5,1.2,,,,\n4.5,0.1,2.5,1.2,2.7,1.3,,\n", "line 3: the log says Vref = 4.5 V"),
        ("t_ms,strip,vh,vl,valid\n0,0,2.5,1.2,1\n0,1,2.9,1.5,0\n0,2,2.9,1.5,0\n50,0,2.5,1.2,1\n50,1,2.7,1.3,1\n50,2,2.9,1.5,0\n", "valid=skip"),
        (_HEAD + "0,2.513,1.204\n0.05,2.5,1.2,2.7,1.3,3.0,1.7\n0.1,2.6,1.2,2.7,1.3,3.0,1.7\n", "line(s) 2 ('0,2.513"),
        ("FRAME 1 t=0ms\nstrip 0: hi=1V lo=.5V\nstrip 1: hi=2V lo=1V\nstrip 0; hi 2143\nFRAME 2 t=9ms\nstrip 0: hi=1.1V lo=.6V\n"
         "strip 1: hi=2V lo=1V\nFRAME 3 t=18ms\nstrip 1: hi=2.1V lo=1V\n", "line 6 has no line for strip 2"),
    ],
)  # fmt: skip
def test_what_contradicts_itself_is_asked_or_refused_with_its_place(log: str, said: str) -> None:
    with pytest.raises((Unanswered, ts.ReadingError), match=re.escape(said)):
        propose(of_text(log), TRIO)


@pytest.mark.parametrize(
    ("log", "times", "touched", "largest"),
    [
        (_HEAD.replace("time_s", "time [h]") + _TWO_SCANS, [0.0, 180.0], [1, 2], 2.713),
        (_HEAD.replace("time_s", "t [d]") + _TWO_SCANS.replace("0.05", "0.0005"), [0.0, 43.2], [1, 2], 2.713),
        ('{"t": 0.0, "unit": "V", "h": [2.5, null, null], "l": [1.2, null, null]}\n'
         '{"t": 0.1, "unit": "mV", "h": [2541, 2713, null], "l": [1233, 1322, null]}\n', [0.0, 0.1], [1, 2], 2.713),
        (_HEAD.replace("time_s", "date") + "11/12/2026 23:59:59.9,2.5,1.2,,,,\n12/12/2026 00:00:00.0,2.5,1.2,2.7,1.3,,\n", [0.0, 0.1], [1, 2], 2.7),
        (_HEAD.replace("time_s", "date") + "12/11/2026 23:59:59.9,2.5,1.2,,,,\n12/12/2026 00:00:00.0,2.5,1.2,2.7,1.3,,\n", [0.0, 0.1], [1, 2], 2.7),
        ("FRAME 0 t=0ms\nFRAME 1 t=50ms\nstrip 0: hi=1V lo=.5V\nFRAME 2 t=100ms\nFRAME 3 t=150ms\nstrip 0: hi=1.2V lo=.4V\n"
         "strip 1: hi=2V lo=1V\nFRAME 4 t=200ms\nEND\n", [0.0, 0.05, 0.1, 0.15, 0.2], [0, 1, 0, 2, 0], 2.0),
        ("time_s,vh0 [V],vl0 [V],vh1 [V],vl1 [V],vh2 [V],vl2 [V]\n0,2.91,0.00318,,,,\n0.1,2.99,0.00201,1.5,0.00151,,\n", [0.0, 0.1], [1, 2], 2.99),
        (">>> df\n   time  strip  v_hi  v_lo\n0  0.00      0  2.50  1.50\n1  0.00      1   NaN   NaN\n2  0.00      2   NaN   NaN\n"
         "3  0.05      0  2.60  1.60\n4  0.05      1  2.70  1.70\n5  0.05      2   NaN   NaN\n\n[6 rows x 4 columns]\n", [0.0, 0.05], [1, 2], 2.7),
        ("t_ms,strip,vh,vl\n0,0,2.5,1.5\n0,1,,\n0,2,,\n0,mean,2.5,1.5\n50,0,2.6,1.6\n50,1,2.7,1.7\n50,2,,\n50,mean,2.65,1.65\n", [0.0, 0.05], [1, 2], 2.7),
    ],
)  # fmt: skip
def test_long_units_and_scans_without_a_line(
    log: str, times: list[float], touched: list[int], largest: float
) -> None:
    found = propose(of_text(log), TRIO)
    values = np.stack([one.values for one in found.scans])
    assert [one.time_s for one in found.scans] == pytest.approx(times)
    assert np.isfinite(values).all(axis=2).sum(axis=1).tolist() == touched
    assert np.nanmax(values) == pytest.approx(largest)
    assert found.mapping.unit == "V"


_LOG_LIKE = st.text(alphabet="0123456789.,;:|=\t\n -#abchlmnostvAV_%[]{}\"'/>µ", max_size=120)


@given(_LOG_LIKE)
@example("[1, [2, 3]")
@example('{"t": 1}\n{"t": [2]}')
@example("strip 1: H=\n")
@settings(derandomize=True, max_examples=60, deadline=None)
def test_parsers_take_any_text(text: str) -> None:
    for field in text.split():
        assert (quantity(field) or (0.0, ""))[0] == (number_of(field) or 0.0)
        assert (clock_seconds(field) or 0.0) >= 0.0 or "-" in field or "." in field or "/" in field
        array_of(field)
        assert meaning(field) == meaning(field.strip())
    meanings(text.split(","))
    for line in text.splitlines():
        assert all(item.values for item in items(line))
    try:
        found = propose(of_text(text), ONE)
    except (ts.TacstripError, Unanswered):
        return
    assert all(one.values.shape == (5, 1) for one in found.scans)


@given(st.binary(max_size=80))
@settings(derandomize=True, max_examples=30, deadline=None)
def test_any_bytes_are_a_table_or_a_clear_error(tmp_path_factory: pytest.TempPathFactory, raw: bytes) -> None:
    for ending in (".csv", ".json", ".xlsx"):
        file: Path = tmp_path_factory.getbasetemp() / f"any{ending}"
        file.write_bytes(raw)
        try:
            assert read_table(file).names
        except ts.ReadingError as error:
            assert str(error)  # noqa: PT017


def test_the_page_shows_what_the_verbs_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = (Path(__file__).parents[2] / "docs" / "guide" / "import.md").read_text(encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    Path("bench.log").write_text(page.partition("```text\n")[2].partition("```")[0])
    for shown in page.split("```console\n")[1:]:
        for part in shown.partition("```")[0].split("$ tacstrip ")[1:]:
            words, _, printed = part.partition("\n")
            done = CliRunner().invoke(cli, words.split())
            assert done.output == printed
            assert done.exit_code == ("Error" in printed)
    known = ["--construction", "crs-crs", "--vref", "5", "--bits", "10"]
    done = CliRunner().invoke(cli, ["init", "open.toml", "--from", "bench.log", *known])
    call = "tacstrip import bench.log open.toml -o readings.csv"
    assert done.stdout == f"open.toml begun. Fill in what stands as '?': pitch_mm, length_mm; then: {call}\n"
    with pytest.raises(
        ts.SpecError, match=r"open.toml: pitch_mm, length_mm: still to be filled in, where '\?'"
    ):
        ts.Sensor.load("open.toml")
