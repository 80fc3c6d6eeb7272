"""Logs of other forms become the readings that they hold, or a question; never other numbers."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

import tacstrip as ts
from tacstrip.cli import cli
from tacstrip.io.log_import.containers import read_table
from tacstrip.io.log_import.guess import propose
from tacstrip.io.log_import.mapping import ColumnMapping
from tacstrip.io.log_import.questions import Unanswered
from tacstrip.io.log_import.scans import scans
from tacstrip.io.log_import.table import Table
from tacstrip.io.log_import.text import of_text

RUBBER = ts.Sensor(
    construction="crs-crs", strips=5, pitch_mm=10.0, length_mm=50.0, vref_volt=5.0, adc_bits=10
)
METAL = ts.Sensor(construction="crs-m", strips=5, pitch_mm=10.0, length_mm=50.0, vref_volt=3.3, adc_bits=12)
SHAPE = ts.Contact.polygon([(-15, -12), (18, -8), (12, 15), (-14, 12)])
STRIPS, SCANS = range(5), range(4)


def _pressed(sensor: ts.Sensor) -> dict[str, np.ndarray]:
    made = [ts.simulate(sensor, SHAPE.placed(22 + 0.5 * i, 24)) for i in SCANS]
    return {name: np.stack([scan[name] for scan in made]) for name in made[0].signatures}


K = _pressed(RUBBER) | _pressed(METAL)


def volts(name: str, i: int, s: int, scale: float = 5.0, nothing: str = "", form: str = ".3f") -> str:
    k = K[name][i, s]
    return nothing if np.isnan(k) else format(scale * k, form)


def long(sep: str, line: Callable[[int, int], list[str]], head: str = "") -> str:
    return head + "".join(sep.join(line(i, s)) + "\n" for i in SCANS for s in STRIPS)


def wide(sep: str, line: Callable[[int], list[str]], head: str = "") -> str:
    return head + "".join(sep.join(line(i)) + "\n" for i in SCANS)


def code(name: str, i: int, s: int) -> str:
    return volts(name, i, s, 1023.0, "-1", ".0f")


FORMS: dict[str, tuple[ts.Sensor, str]] = {
    "a spreadsheet's, with decimal commas and lines above": (RUBBER, long(
        ";", lambda i, s: [str(i), str(20 * i), str(s + 1), *(volts(n, i, s).replace(".", ",") for n in ("kh", "kl"))],
        "Gerät;Matte 3\nDatum;1.2.2026\n\nScan;Zeit [ms];Streifen;U_h [V];U_l [V]\n")),
    "a serial monitor's": (RUBBER, wide(
        " ", lambda i: [f"12:00:00.{20 * i:03d} ->", *(code(n, i, s) for s in STRIPS for n in ("kh", "kl"))])),
    "a column per strip and channel, tabs": (RUBBER, wide(
        "\t", lambda i: [str(900 + 20 * i), *(volts(n, i, s) for n in ("kh", "kl") for s in STRIPS)],
        "millis\t" + "\t".join(f"{n}{s}" for n in ("vh", "vl") for s in STRIPS) + "\n")),
    "named values": (RUBBER, long(
        " ", lambda i, s: [f"t:{20 * i}", f"strip:{s}", f"high:{code('kh', i, s)}", f"low:{code('kl', i, s)}"])),
    "millivolts of analog pins": (METAL, wide(
        ",", lambda i: [f"{0.02 * i:.2f}", *(volts("k", i, s, 3300.0, "", ".1f") for s in STRIPS)],
        "time_s," + ",".join(f"A{s} (mV)" for s in STRIPS) + "\n")),
    "channels a and b in percent": (RUBBER, long(
        ",", lambda i, s: [str(i), f"{0.02 * i:.2f}", str(s), *(volts(n, i, s, 100.0, "NaN") for n in ("kl", "kh"))],
        "# made by hand\nframe,t,strip,a [%],b [%]\n")),
    "a line for each reading, dates": (RUBBER, "timestamp,strip,end,value\n" + "".join(
        f"2026-03-04T10:00:00.{20 * i:03d},S{s},{end},{volts('k' + end, i, s)}\n"
        for i in SCANS for s in STRIPS for end in "hl")),
    "a line of units": (RUBBER, long(
        "|", lambda i, s: [f"{0.02 * i:.2f}", str(s), volts("kh", i, s, 5.0, "--"), volts("kl", i, s, 5.0, "--")],
        "t|ch|high|low\ns||V|V\n")),
    "nothing but numbers": (METAL, wide(
        ",", lambda i: [f"{0.02 * i:.2f}", *(volts("k", i, s, 3.3) for s in STRIPS)])),
}  # fmt: skip


@pytest.mark.parametrize("form", FORMS)
def test_a_log_gives_the_readings_that_are_in_it(form: str) -> None:
    sensor, text = FORMS[form]
    # Whole numbers without a name may be codes or millivolts: that is asked.
    found = propose(
        of_text(text), sensor, {"unit": "code"} if form in ("a serial monitor's", "named values") else None
    )
    mapping, names = found.mapping, ("kh", "kl") if sensor is RUBBER else ("k",)
    top = {"V": sensor.vref_volt, "mV": 1000.0 * sensor.vref_volt, "percent": 100.0, "code": 1023.0}[
        mapping.unit
    ]
    for n, name in enumerate(names):
        read = np.stack([scan.values[:, n] for scan in found.scans]) / top
        np.testing.assert_allclose(read, K[name], atol=0.6 / 1023)
    assert [s.time_s for s in found.scans] == pytest.approx([0.02 * i for i in SCANS], abs=1e-6)
    assert all(found.reasons)


PINS = "t_ms," + ",".join(f"A{s}" for s in STRIPS)


def codes(last: str) -> str:
    return (
        PINS.replace(",A", ",raw")
        + "\n"
        + "".join(f"{20 * i},-1,{400 + i},{500 + i},{600 + i},-1\n" for i in SCANS)
        + last
    )


@pytest.mark.parametrize(
    ("text", "sensor", "says"),
    [
        (
            "strip,voltage,pose0,pose7,pose14,pose21\n"
            + "".join(
                f"{s},{end},{u},{u},{u},{u}\n" for s in STRIPS for end, u in (("high", 2.5), ("low", 1.5))
            ),
            RUBBER,
            "strips are numbered 0 to 21",
        ),
        (
            PINS.replace(",A", ",mV A") + "\n" + "".join(f"{20 * i},,1.757,2.{i}57,1.900,\n" for i in SCANS),
            METAL,
            "thousands",
        ),
        (
            PINS + "\n" + "".join(f"{20 * i},,611,32{i},300,\n" for i in SCANS),
            METAL,
            "in which unit.*unit=mV or --answer unit=code",
        ),
        (
            "time_s,strip,value\n"
            + "".join(f"{0.1 * i},{s}{end},1.5\n" for i in SCANS for s in STRIPS for end in "QZ"),
            RUBBER,
            "'0Q' elsewhere: both strip 0",
        ),
    ],
)
def test_what_would_give_other_numbers_is_no_guess(text: str, sensor: ts.Sensor, says: str) -> None:
    with pytest.raises((Unanswered, ts.ReadingError), match=says):
        propose(of_text(text), sensor)


def test_a_line_that_comes_twice_is_left_out_and_told() -> None:
    found = propose(of_text(codes("60,-1,403,503,603,-1\n")), METAL, {"unit": "code"})
    assert len(found.scans) == len(SCANS)
    assert any("line 6 is line 5 again" in doubt for doubt in found.doubts)


def test_columns_passed_over_may_not_hold_most_readings() -> None:
    text = "strip,voltage,p0,p7,p14\n" + "".join(
        f"{s},{end},{u},{u},{u}\n" for s in STRIPS for end, u in (("high", 2.5), ("low", 1.5))
    )
    answers = {"strip": "strip", "p7": "skip", "p14": "skip"}
    with pytest.raises(ts.ReadingError, match=r"p7, p14: passed over, with 20 numbers.*from 10"):
        propose(of_text(text), RUBBER, answers)


@pytest.mark.parametrize("word", ["no contact", "open", "---"])
def test_a_word_behind_a_strip_stands_for_its_values(word: str) -> None:
    text = "".join(
        f"--- scan {n} @ {2000 + 100 * n} ms ---\nS00 {word}\n"
        + "".join(f"S{s:02d} hi={500 + 10 * s + n} lo={300 + 10 * s + n}\n" for s in (1, 2, 3))
        + f"S04 {word}\n"
        for n in SCANS
    )
    found = propose(of_text("Skin reader v0.3, 5 strips\n" + text), RUBBER, {"unit": "code"})
    values = np.stack([s.values for s in found.scans])
    assert np.isnan(values[:, [0, 4]]).all()
    assert values[2, 3].tolist() == [532.0, 332.0]


def test_whole_numbers_of_an_unknown_converter_may_be_millivolts() -> None:
    text = "time_s,strip,high,low\n" + "".join(
        f"{0.05 * n:.2f},{s},{700 + 10 * s + n},{400 + s}\n" for n in SCANS for s in STRIPS
    )
    plain = ts.Sensor(construction="crs-crs", strips=5, pitch_mm=10.0, length_mm=50.0, vref_volt=5.0)
    with pytest.raises(Unanswered) as asked:
        propose(of_text(text), plain)
    open_ = {q.key: q for q in asked.value.questions}
    assert [*open_] == ["unit"]
    assert open_["unit"].choices == ("mV", "10bit", "12bit", "14bit")
    of_ten = propose(of_text(text), plain, {"unit": "10bit"}).mapping
    assert (of_ten.unit, of_ten.adc_bits) == ("code", 10)
    assert propose(of_text(text), plain, {"unit": "mV"}).mapping.unit == "mV"
    codes_of_ten = propose(of_text(text), plain, {"adc_bits": "10"})
    assert codes_of_ten.mapping.unit == "code"
    assert any("unit=mV" in doubt for doubt in codes_of_ten.doubts)


def test_a_topic_called_raw_tells_codes_that_fit_the_converter() -> None:
    lines = [
        f'{{"topic": "lab/skin/{{}}", "ts": {1778580843000 + 100 * n}, "high": {[611 + n] * 5}, "low": {[400] * 5}}}'
        for n in SCANS
    ]
    twelve = ts.Sensor(
        construction="crs-crs", strips=5, pitch_mm=10.0, length_mm=50.0, vref_volt=3.3, adc_bits=12
    )
    told = propose(of_text("\n".join(lines).replace("{}", "raw")), twelve)
    assert told.mapping.unit == "code"
    assert any("says raw" in reason for reason in told.reasons)
    with pytest.raises(Unanswered, match="in which unit"):
        propose(of_text("\n".join(lines).replace("{}", "data")), twelve)


def test_cells_above_an_empty_row_are_no_names(tmp_path: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    above = [["Versorgung:", "5 V"], [], ["Zeit / s", "Streifen Nr.", "U oben / V", "U unten / V"]]
    for row in [*above, *([0.5 * n, s, 2.5 + 0.1 * s, 1.5] for n in SCANS for s in STRIPS)]:
        book.active.append(row)
    book.save(tmp_path / "log.xlsx")
    found = propose(read_table(tmp_path / "log.xlsx"), RUBBER)
    assert found.mapping.strip == "Streifen Nr."
    assert found.scans[1].values[2].tolist() == [2.7, 1.5]


HEAD = "scan,time_s,strip,v_h,v_l\n"


def own(*names: str, scale: float = 5.0, nothing: str = "", head: str = HEAD, index: bool = True) -> str:
    """Readings in our own form, but for what is changed."""
    return long(
        ",",
        lambda i, s: [
            *([str(i), str(i)] if index else []),
            str(s),
            *(volts(n, i, s, scale, nothing) for n in names),
        ],
        head,
    )


def clocked(name: str, above: str = "") -> str:
    """Readings of which the time is 14:00, 14:05, ..."""
    return above + long(
        ",",
        lambda i, s: [f"14:{5 * i:02d}", str(s), volts("kh", i, s), volts("kl", i, s)],
        f"{name},strip,v_h,v_l\n",
    )


def test_a_clock_of_two_numbers_behind_a_date_is_hours_and_minutes() -> None:
    found = propose(of_text(clocked("time").replace("14:", "2026-03-14 14:")), RUBBER)
    np.testing.assert_allclose([s.time_s for s in found.scans], 300.0 * np.arange(4))


@pytest.mark.parametrize("way", ["hh:mm", "mm:ss"])
def test_a_clock_of_two_numbers_that_nothing_tells_is_asked(way: str) -> None:
    with pytest.raises(Unanswered, match="hours and minutes"):
        propose(of_text(clocked("time")), RUBBER)
    found = propose(of_text(clocked("time")), RUBBER, {"time_unit": way})
    assert found.mapping.time_unit == way
    assert found.scans[1].time_s == (300.0 if way == "hh:mm" else 5.0)


def grouped(line: Callable[[int], str], above: str) -> str:
    return above + "".join(line(i) + "\n" for i in SCANS)


def pair(i: int, s: int, form: str) -> str:
    return form.format(s, volts("kh", i, s, nothing="--"), volts("kl", i, s, nothing="--"))


def melted_with_temperature() -> str:
    rows = [
        f"{0.1 * i:.1f},{s + 1}{e.upper()},{volts('k' + e, i, s, 5000.0, form='.0f')},mV\n"
        + f"{0.1 * i:.1f},TEMP,23.{i},C\n" * (s == 4 and e == "l")
        for i in SCANS for s in STRIPS for e in "hl"
    ]  # fmt: skip
    return "time_s,channel,value,unit\n" + "".join(rows)


@pytest.mark.parametrize(
    "text",
    [
        grouped(lambda i: f"scan {i} @ {0.1 * i:.1f} s: " + " ".join(pair(i, s, "#{} ({}, {})") for s in STRIPS), ""),
        "# ms, then low and high of strips 0 to 4, volts, -9 where open\n" + wide(
            " ", lambda i: [str(20 * i), *(volts(n, i, s, nothing="-9") for s in STRIPS for n in ("kl", "kh"))]
        ),
        melted_with_temperature(),
        "# y = U / Uref * L, L = 5 cm\n" + long(
            ",", lambda i, s: [f"{0.1 * i:.1f}", str(s), volts("kh", i, s, form=".4f"), volts("kl", i, s, form=".4f")],
            "time_s,strip,y_high (cm),y_low (cm)\n",
        ),
        '"peau no 12, L = 5 cm"\n"position = U / Uref x L, en cm"\n' + long(
            ";", lambda i, s: [f"{0.1 * i:.1f}", str(s), volts("kh", i, s, form=".4f"), volts("kl", i, s, form=".4f")],
            "temps (s);bande;haut (cm);bas (cm)\n",
        ),
    ],
    ids=["brackets", "a comment", "rows of no strip", "centimetres", "centimetres in French"],
)  # fmt: skip
def test_groups_comments_and_lengths_give_the_readings(text: str) -> None:
    found = propose(of_text(text), RUBBER)
    unit = {"V": 0.2, "mV": 0.0002, "fraction": 1.0}[found.mapping.unit] * found.mapping.scale
    read = np.stack([scan.values for scan in found.scans]) * unit
    np.testing.assert_allclose(read, np.stack([K["kh"], K["kl"]], axis=-1), atol=2e-3)


def test_one_round_asks_what_later_answers_would_open() -> None:
    text = long(
        ",",
        lambda i, s: [str(i), str(s), volts("kh", i, s), volts("kl", i, s), str(7 + s)],
        "t,strip,foo,bar,baz\n",
    )
    with pytest.raises(Unanswered, match="then: t rises by 1") as asked:
        propose(of_text(text), RUBBER)
    assert {"foo", "bar", "baz", "time_unit"} <= {q.key for q in asked.value.questions}
    answers = {"foo": "h", "bar": "l", "baz": "skip", "time_unit": "s"}
    read = np.stack([scan.values[:, 0] for scan in propose(of_text(text), RUBBER, answers).scans]) / 5.0
    np.testing.assert_allclose(read, K["kh"], atol=1e-3)


def test_readings_are_named_in_any_order() -> None:
    names = ("red", "white", "blue, dark", "green", "grey")
    text = wide(
        ";", lambda i: [str(i), *(volts("k", i, s, 3.3) for s in STRIPS)], f"time_s;{';'.join(names)}\n"
    )
    found = propose(of_text(text), METAL, {"readings": "grey,green,blue, dark,white,red"})
    read = np.stack([scan.values[:, 0] for scan in found.scans]) / 3.3
    np.testing.assert_allclose(read, K["k"][:, ::-1], atol=1e-3)
    with pytest.raises(ts.OptionError, match="'pink' is no column"):
        propose(of_text(text), METAL, {"readings": "pink,green,blue, dark,white,red"})


def test_a_decimal_time_beside_hexadecimal_codes_stays_decimal() -> None:
    text = wide(" ", lambda i: [str(4060 + 20 * i), *(f"{0x1A9C + 371 * i + 7 * s:04X}" for s in STRIPS)])
    found = propose(of_text(text), DIGITS, {"unit": "code", "time_unit": "ms"})
    np.testing.assert_allclose([s.time_s for s in found.scans], 0.02 * np.arange(4))
    assert found.scans[0].values[0, 0] == 0x1A9C


def without_empty_lines() -> str:
    return "".join(line + "\n" for line in own("kh", "kl").splitlines() if not line.endswith(",,"))


@pytest.mark.parametrize(
    ("text", "key", "answer"),
    [
        (own("kl", "kh"), "exchanged", "yes"),
        (own("kh", "kl", head=HEAD.replace("time_s", "t")), "time_unit", "ms"),
        (own("kh", "kl", scale=1.0), "unit", "fraction"),
        (without_empty_lines(), "missing", "untouched"),
        (own("kh", "kl", nothing="sat"), "untouched", "sat"),
    ],
)
def test_what_a_log_does_not_say_is_asked_and_the_answer_taken(text: str, key: str, answer: str) -> None:
    with pytest.raises(Unanswered) as asked:
        propose(of_text(text), RUBBER)
    assert key in [q.key for q in asked.value.questions] or key == "missing"
    answers = {key: answer} | ({"strip_base": "0"} if key == "missing" else {})
    found = propose(of_text(text), RUBBER, answers)
    vref = 1.0 if key == "unit" else 5.0
    read = np.stack([scan.values[:, 0] for scan in found.scans]) / vref
    np.testing.assert_allclose(read, K["kh"], atol=2e-3)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "empty"),
        ("hello\nworld\n", "no table"),
        ("scan;t;strip;v_h;v_l\n0;0.1;0;1,5;2.5\n0;0.1;1;1,5;2.5\n", "decimal points .* and decimal commas"),
        (HEAD + "0,0,0,2,1\n0,0,1,2,1\n0,0,7,2,1\n", "numbered 0 to 7, and the sensor has 5"),
        (
            HEAD.replace("v_h", "v_h [V]") + "0,0,0,9.5,1.5\n0,0,1,2,1\n0,0,2,2,1\n0,0,3,2,1\n0,0,4,2,1\n",
            "9.5 is above 5",
        ),
        (HEAD + "".join(f"{i},{-i},{s},2.5,1.5\n" for i in range(3) for s in STRIPS), "the time falls"),
    ],
)
def test_what_cannot_be_readings_is_refused_with_its_place(text: str, says: str) -> None:
    with pytest.raises(ts.ReadingError, match=says):
        propose(of_text(text), RUBBER)


def test_a_mapping_is_written_and_reads_the_next_log(tmp_path: Path) -> None:
    sensor, text = FORMS["a spreadsheet's, with decimal commas and lines above"]
    found = propose(of_text(text), sensor)
    found.mapping.save(tmp_path / "map.toml")
    again = ColumnMapping.load(tmp_path / "map.toml")
    assert again == found.mapping
    for one, other in zip(scans(of_text(text), again), found.scans, strict=True):
        np.testing.assert_array_equal(one.values, other.values)
    with pytest.raises(ts.ReadingError, match="column 'U_h"):
        scans(of_text(HEAD + "0,0,0,1,1\n"), again)
    (tmp_path / "bad.toml").write_text('unit = "furlong"\nstrips = 5\n[columns]\nv = "h"\n')
    with pytest.raises(ts.OptionError, match="furlong"):
        ColumnMapping.load(tmp_path / "bad.toml")


@pytest.mark.parametrize("number", ["--1", "\u00b2", "\u0663", "1_0", ""])
def test_a_mapping_with_a_strip_that_is_no_number_is_refused(tmp_path: Path, number: str) -> None:
    (tmp_path / "bad.toml").write_text(
        f'format = 1\nunit = "V"\nstrips = 4\n[columns]\na = "{number}:h"\n', encoding="utf-8"
    )
    with pytest.raises(ts.OptionError, match='or "3:h" for a column of strip 3'):
        ColumnMapping.load(tmp_path / "bad.toml")


def test_a_mapping_with_a_column_that_is_a_number_is_refused(tmp_path: Path) -> None:
    (tmp_path / "bad.toml").write_text('unit = "V"\nstrips = 4\n[columns]\na = "h"\nformat = 1\n')
    with pytest.raises(ts.OptionError, match="columns: format = 1 is no text"):
        ColumnMapping.load(tmp_path / "bad.toml")


def test_the_verb_writes_readings_a_recording_and_the_mapping(tmp_path: Path) -> None:
    sensor, text = FORMS["channels a and b in percent"]
    sensor.save(tmp_path / "s.toml")
    log, out = tmp_path / "bench.log", tmp_path / "r.csv"
    log.write_text(text)
    done = CliRunner().invoke(cli, ["import", str(log), str(tmp_path / "s.toml"), "-o", str(out)])
    assert done.exit_code == 0, done.output
    assert "b [%]: v_h, for it is the larger" in done.stderr
    read = ts.read_readings(out, sensor)
    np.testing.assert_allclose(np.stack([s["kl"] for s in read]), K["kl"], atol=1e-4)
    words = ["import", str(log), str(tmp_path / "s.toml"), "--mapping", str(tmp_path / "r.mapping.toml")]
    done = CliRunner().invoke(cli, [*words, "-o", str(tmp_path / "r.mcap")])
    assert done.exit_code == 0, done.output
    assert len(list(ts.Recording(tmp_path / "r.mcap"))) == len(SCANS)
    log.write_text("frame,t,strip,a,b\n0,0,2,10,20\n")
    done = CliRunner().invoke(cli, ["import", str(log), "-o", str(tmp_path / "q.csv")])
    assert done.exit_code == 1
    assert "--answer strip_base=0 or --answer strip_base=1" in done.stderr
    assert "--answer a=h or --answer a=l" in done.stderr  # all that is open is asked at once
    assert not (tmp_path / "q.csv").exists()


def test_arrays_of_numpy_workbooks_and_parquet(tmp_path: Path) -> None:
    np.savez(tmp_path / "log.npz", t=0.02 * np.arange(4), kh=K["kh"], kl=K["kl"], note=np.array("x"))
    found = propose(read_table(tmp_path / "log.npz"), RUBBER)
    assert found.mapping.unit == "fraction"
    np.testing.assert_allclose(found.scans[2].values[:, 1], K["kl"][2])
    columns: dict[str, list[float]] = {
        "scan": [i for i in SCANS for _ in STRIPS],
        "t [s]": [0.02 * i for i in SCANS for _ in STRIPS],
    }
    columns |= {"strip": [s for _ in SCANS for s in STRIPS], "v_out [mV]": list(3300.0 * K["k"].ravel())}
    _as_parquet(tmp_path / "log.parquet", columns)
    _as_workbook(tmp_path / "log.xlsx", columns)
    for name in ("log.parquet", "log.xlsx"):
        found = propose(read_table(tmp_path / name), METAL)
        np.testing.assert_allclose([s.values[:, 0] for s in found.scans], 3300.0 * K["k"], atol=1e-6)
    for name in ("no.npz", "no.xlsx", "no.parquet"):
        (tmp_path / name).write_bytes(b"PK\x03\x04 no archive")
        with pytest.raises(ts.ReadingError, match=name):
            read_table(tmp_path / name)


def _as_parquet(path: Path, columns: dict[str, list[float]]) -> None:
    import pyarrow as pa
    from pyarrow import parquet

    parquet.write_table(pa.table(columns), path)


def _as_workbook(path: Path, columns: dict[str, list[float]]) -> None:
    import openpyxl

    book = openpyxl.Workbook()
    book.active.append(["Bench 3"])
    book.active.append(list(columns))
    for row in zip(*columns.values(), strict=True):
        book.active.append([None if v != v else v for v in row])
    book.save(path)


class _Frame(dict[str, list[Any]]):
    """What a pandas DataFrame is to `read_readings`."""

    columns = property(list)


def test_a_data_frame_is_read_as_a_file_of_the_same_columns() -> None:
    frame = _Frame(
        scan=[0] * 5,
        time_s=[0.0] * 5,
        strip=[0.0, 1.0, 2.0, 3.0, 4.0],
        v_out=list(3.3 * K["k"][0]),
        note=["a", None, "b", "c", "d"],  # columns that nobody asks for are passed over, as in a file
    )
    (scan,) = ts.read_readings(frame, METAL)
    np.testing.assert_allclose(scan["k"], K["k"][0], atol=1e-12)
    frame["v_out"][2] = 9.0
    with pytest.raises(ts.ReadingError, match=r"line 3: v_out = 9 V is outside"):
        ts.read_readings(frame, METAL)


@given(st.text(alphabet="0123456789.,;:|\t\n -#abhlstvV_%[]>", max_size=300))
@settings(derandomize=True, max_examples=60, deadline=None)
def test_any_text_gives_scans_a_question_or_a_clear_error(text: str) -> None:
    try:
        found = propose(of_text(text), RUBBER)
    except (ts.TacstripError, Unanswered):
        return
    assert all(scan.values.shape[0] == 5 for scan in found.scans)


@given(
    st.lists(st.lists(st.one_of(st.none(), st.floats(0, 1)), min_size=5, max_size=5), min_size=2, max_size=4)
)
@settings(derandomize=True, max_examples=25, deadline=None)
def test_a_table_in_our_own_form_comes_back_unchanged(values: list[list[float | None]]) -> None:
    rows = [
        [str(i), f"{0.1 * i:.1f}", str(s), "" if v is None else f"{v:.4f}"]
        for i, line in enumerate(values)
        for s, v in enumerate(line)
    ]
    table = Table(("scan", "time_s", "strip", "v_out [V]"), rows, list(range(len(rows))))
    found = propose(table, METAL, {"untouched": "none", "unit": "V"})
    expected = [[np.nan if v is None else round(v, 4) for v in line] for line in values]
    np.testing.assert_allclose([s.values[:, 0] for s in found.scans], expected, atol=1e-12)


COUNTS = 1500 + 37 * np.arange(20)[:, None] + np.arange(5)
DIGITS = ts.Sensor(construction="crs-m", strips=5, pitch_mm=10.0, length_mm=50.0, vref_volt=5.0, adc_bits=16)


@pytest.mark.parametrize(
    "line",
    [
        lambda i, values: f"{20 * i},{values},{0x1A9C + 371 * i:04X}",
        lambda i, values: f"10:00:{i // 2:02d}.{500 * (i % 2):03d},{values}",
    ],
    ids=["a checksum of letters", "a clock of two scans a second"],
)
def test_what_looks_like_another_form_is_not_taken_for_it(
    line: Callable[[int, str], str], tmp_path: Path
) -> None:
    """Codes are not hexadecimal for one lettered column, a clock no strips."""
    log, spec, out = tmp_path / "a.log", tmp_path / "sensor.toml", tmp_path / "out.csv"
    head = "time," + ",".join(f"s{i}" for i in STRIPS)
    body = [line(i, ",".join(map(str, row))) for i, row in enumerate(COUNTS)]
    log.write_text("\n".join([head + ",crc" * (body[0].count(",") > 5), *body]) + "\n")
    DIGITS.save(spec)
    words = ["import", str(log), str(spec), "-o", str(out), "--answer", "unit=code", "--answer", "crc=skip"]
    done = CliRunner().invoke(cli, words if ",crc" in log.read_text() else words[:-2])
    assert done.exit_code == 0, done.output
    with pytest.warns(ts.ReadingWarning, match=r"above 0\.034 of Vref"):
        read = ts.read_readings(out, DIGITS)
    np.testing.assert_allclose([scan["k"] for scan in read], COUNTS / 65535.0, atol=1e-5)


def test_a_log_without_times_gives_readings_without_them(tmp_path: Path) -> None:
    log, out, spec = tmp_path / "log.csv", tmp_path / "readings.csv", tmp_path / "sensor.toml"
    log.write_text(own("kh", "kl", head="strip,v_h,v_l\n", index=False))
    RUBBER.save(spec)
    done = CliRunner().invoke(cli, ["import", str(log), str(spec), "-o", str(out)])
    assert done.exit_code == 0
    assert "the log has no time: time_s is left empty" in done.output
    assert [line.split(",")[1] for line in out.read_text().splitlines()[1:]] == [""] * K["kh"].size
    read = ts.read_readings(out, RUBBER)
    np.testing.assert_allclose([scan["kh"] for scan in read], K["kh"], atol=2e-3)
    assert {scan.time_s for scan in read} == {0.0}
    again = tmp_path / "again.csv"
    mapping = str(out.with_suffix(".mapping.toml"))
    assert (
        CliRunner()
        .invoke(cli, ["import", str(log), str(spec), "-o", str(again), "--mapping", mapping])
        .exit_code
        == 0
    )
    assert again.read_text() == out.read_text()
    assert propose(of_text(log.read_text()), RUBBER, {"rate_hz": "50"}).scans[1].time_s == 0.02
    lines = out.read_text().splitlines()
    out.write_text("\n".join([*lines[:-1], lines[-1].replace(",,", ",0.3,", 1)]) + "\n")
    with pytest.raises(ts.ReadingError, match="has a time, and those above it none"):
        ts.read_readings(out, RUBBER)


@pytest.mark.parametrize("adc_bits", [None, 10])
def test_a_wire_that_is_off_leaves_its_cells_empty_but_no_recording(
    adc_bits: int | None, tmp_path: Path
) -> None:
    sensor = replace(RUBBER, adc_bits=adc_bits)
    (tmp_path / "sensor.toml").write_text(sensor.to_toml(), encoding="utf-8")
    top = ("v_h", "v_l", 5.0) if adc_bits is None else ("code_h", "code_l", 1023.0)
    form = ".3f" if adc_bits is None else ".0f"

    def log(*ends: str) -> None:
        def one(name: str, i: int, s: int) -> str:
            return "" if f"{name}{s}" in ends else volts(name, i, s, top[2], "", form)

        text = long(",", lambda i, s: [str(i), str(i / 50), str(s), one("kh", i, s), one("kl", i, s)])
        (tmp_path / "log.csv").write_text(f"scan,time_s,strip,{top[0]},{top[1]}\n{text}", encoding="utf-8")

    def run(out: str) -> Any:
        return CliRunner().invoke(
            cli,
            [
                *map(
                    str,
                    (
                        "import",
                        "--force",
                        tmp_path / "log.csv",
                        tmp_path / "sensor.toml",
                        "-o",
                        tmp_path / out,
                    ),
                )
            ],
        )

    log("kh2")
    told = run("out.csv")
    assert told.exit_code == 0, told.output
    assert "2:v_h is empty" in told.output
    with pytest.warns(ts.ReadingWarning, match="2:v_h is empty"):
        made = ts.read_readings(tmp_path / "out.csv", sensor)
    for i in SCANS:
        assert np.isnan(made[i]["kh"][2])
        np.testing.assert_allclose(made[i]["kl"], K["kl"][i], atol=1e-3)
    refused = run("out.mcap")
    assert isinstance(refused.exception, ts.ReadingError)
    assert "save as .csv" in str(refused.exception)
    log("kh1", "kl2", "kh3")  # as of columns in another order
    assert "columns of other strips" in str(run("other.csv").exception)


def test_lines_of_another_quantity_are_passed_over_by_their_unit() -> None:
    rows = [
        f"{i / 50},strip_{s}/{end},{volts(name, i, s, 5000.0, '', '.1f')},mV\n"
        + (f"{i / 50},board/temp,24.{i},degC\n" if (s, end) == (4, "low") else "")
        for i in SCANS for s in STRIPS for end, name in (("high", "kh"), ("low", "kl"))
    ]  # fmt: skip
    found = propose(of_text("time_s,channel,value,unit\n" + "".join(rows), "log.csv"), RUBBER)
    assert len(found.scans) == len(SCANS)
    np.testing.assert_allclose(found.scans[2].values[:, 0], 5000.0 * K["kh"][2], atol=0.1)
    lines = []
    for i in SCANS:
        read = [v and f"{v} V" for v in (volts("k", i, s, 3.3) for s in STRIPS)]
        lines.append(",".join([str(i / 50), *read, f"{30 + i % 3}.5 \u00b0C"]))
    cells = "\n".join(["time_s," + ",".join(f"Strip {s}" for s in STRIPS) + ",Board temp", *lines])
    assert len(propose(of_text(cells, "log.csv"), METAL).scans) == len(SCANS)


def test_only_touched_strips_have_lines_though_the_last_is_torn() -> None:
    text = "".join(
        f"# scan {i} t={20 * i} ms\n"
        + "".join(
            f"S{s + i // 4} H={code('kh', i % 4, s)} L={code('kl', i % 4, s)}\n"
            for s in STRIPS if not np.isnan(K["kh"][i % 4, s])
        )
        for i in range(8)
    )  # fmt: skip
    log = of_text(text + "# scan 8 t=160 ms\nS2 H=635 L=315\nS3 H=60", "log.txt")
    found = propose(log, RUBBER, {"strip_base": "0"})
    assert found.mapping.missing == "untouched"
    assert len(found.scans) == 8


def test_a_messages_layout_is_no_scan_and_low_may_stand_first() -> None:
    head = (
        "layout:\n  dim:\n  - label: strip\n    size: 5\n  - label: 'v_low, v_high [V]'\n    size: 2\ndata:\n"
    )
    text = "---\n".join(
        head + "".join(f"- {volts(n, i, s, nothing='.nan')}\n" for s in STRIPS for n in ("kl", "kh"))
        for i in SCANS
    )
    found = propose(of_text(text, "log.txt"), RUBBER)
    assert len(found.scans) == len(SCANS)
    np.testing.assert_allclose(found.scans[2].values[:, 0], 5.0 * K["kh"][2], atol=1e-3)


def test_records_that_describe_columns_name_them_however_deep() -> None:
    sensors = [{"name": f"s{s}_{end}", "units": "V"} for s in STRIPS for end in ("hi", "lo")]
    values = [
        [float(volts(n, i, s, nothing="0")) for s in STRIPS for n in ("kh", "kl")] + [9.8] for i in SCANS
    ]
    payload = {"interval_ms": 20, "sensors": [*sensors, {"name": "accZ", "units": "m/s2"}], "values": values}
    text = json.dumps({"signature": "00", "payload": payload})
    found = propose(of_text(text, "log.json"), replace(RUBBER, rest_volt=0.0, touch_volt=0.02))
    assert [scan.time_s for scan in found.scans] == pytest.approx([0.02 * i for i in SCANS])
    np.testing.assert_allclose(found.scans[2].values[:, 1], np.nan_to_num(5.0 * K["kl"][2]), atol=1e-3)


def test_ticks_and_volts_of_a_code_are_one_answer_each() -> None:
    ticks = [0, 126, 252, 377]
    head = "Top," + ",".join(f"S{s} {end}" for s in STRIPS for end in ("high", "low")) + "\n"

    def row(i: int) -> list[str]:
        return [str(ticks[i]), *(volts(n, i, s, 40000.0, "", ".0f") for s in STRIPS for n in ("kh", "kl"))]

    text = wide(",", row, head)
    sensor = replace(RUBBER, adc_bits=None)
    with pytest.raises(Unanswered, match="time_unit"):
        propose(of_text(text, "log.csv"), sensor, {"unit": "0.125mV"})
    found = propose(of_text(text, "log.csv"), sensor, {"unit": "0.125mV", "time_unit": "0.4ms"})
    assert [scan.time_s for scan in found.scans] == pytest.approx([0.0004 * t for t in ticks])
    np.testing.assert_allclose(
        found.mapping.scale * found.scans[1].values[:, 0], 5000.0 * K["kh"][1], atol=0.1
    )
    assert found.mapping.unit == "mV"


def test_a_line_cut_behind_its_strip_costs_its_scan() -> None:
    lines = []
    for i in range(8):
        lines += [f"FRAME {i} @ {50 * i} ms"]
        read = [s for s in STRIPS if not np.isnan(K["kh"][i % 4, s])]
        lines += [f"  strip {s}: up {volts('kh', i % 4, s)} V, down {volts('kl', i % 4, s)} V" for s in read]
    at = lines.index("FRAME 4 @ 200 ms") - 1
    whole = propose(of_text("\n".join(lines), "log.txt"), RUBBER, {"strip_base": "0", "missing": "untouched"})
    lines[at] = lines[at][:9]
    found = propose(of_text("\n".join(lines), "log.txt"), RUBBER, {"strip_base": "0", "missing": "untouched"})
    kept = {scan.time_s: scan.values for scan in whole.scans}
    assert 0 < len(found.scans) < len(whole.scans)
    for scan in found.scans:
        np.testing.assert_array_equal(scan.values, kept[scan.time_s])
