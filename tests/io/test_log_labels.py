"""Lines among a log's readings that are none: they count scans, name sensors, or say what changes."""

from __future__ import annotations

import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

import tacstrip as ts
from tacstrip.io.log_import.containers import read_table
from tacstrip.io.log_import.guess import propose
from tacstrip.io.log_import.questions import Unanswered
from tacstrip.io.log_import.text import of_text

SENSOR = ts.Sensor(
    construction="crs-crs", strips=6, pitch_mm=8.0, length_mm=60.0, vref_volt=5.0, strip_base=1
)
FIRST = "strip 1: nothing\nstrip 2: top 1.97, bottom 1.68\nstrip 3: top 2.90, bottom 1.48\n" + "".join(
    f"strip {n}: nothing\n" for n in (4, 5, 6)
)
LAST = FIRST.replace("1.97", "2.07").replace("2.90", "2.81")
VOID = "".join(f"strip {n}: nothing\n" for n in range(1, 7))


@pytest.mark.parametrize("place", [0, 1, 2])
@pytest.mark.parametrize("word", ["PRESS", "Versuch", "## Toque"])
@pytest.mark.parametrize(
    "void", [VOID, VOID.replace("nothing", "no contact"), VOID.replace("nothing", "-"), ""]
)
def test_a_counted_scan_in_which_nothing_is_touched_keeps_its_place(place: int, word: str, void: str) -> None:
    blocks = [FIRST, LAST]
    blocks.insert(place, void)
    text = "".join(f"{word} {n} (on the pad)\n{block}\n" for n, block in enumerate(blocks, 1))
    found = propose(of_text(text), SENSOR, {"rate_hz": "50", "strip_base": "1"})
    touched = [bool((scan.values > 0.0).any()) for scan in found.scans]
    assert touched == [n != place for n in range(3)] or any("no reading follows" in d for d in found.doubts)
    assert void == "" or len(touched) == 3


@pytest.mark.parametrize("said", ["(t = {} s)", "at {} s", "- {} s", "nach {} s"])
def test_headings_that_count_scans_tell_their_times(said: str) -> None:
    table = "| strip | upper end | lower end |\n|--|--|--|\n| 1 | untouched | untouched |\n| 2 | 1.97 V | 1.68 V |\n"
    text = "".join(
        f"## Press {n} {said.format(t)}\n\n{table}\n" for n, t in enumerate(("0", "1.5", "9.0"), 1)
    )
    found = propose(of_text(text), replace(SENSOR, strips=2))
    assert [scan.time_s for scan in found.scans] == [0.0, 1.5, 9.0]


def test_a_duration_in_such_headings_is_no_time() -> None:
    text = "".join(f"PRESS {n} - 2 s\n{block}\n" for n, block in enumerate((FIRST, LAST), 1))
    with pytest.raises(Unanswered, match="rate_hz"):
        propose(of_text(text), SENSOR)


def _table_with(note: str, *, factor: float) -> str:
    row = "{:.1f},{:.3f},{:.3f},{:.3f},{:.3f}"
    lines = [row.format(0.1 * n, *(v * (factor if n > 3 else 1.0) for v in (3.0 + 0.01 * n, 1.8, 2.9, 1.7 + 0.01 * n)))
             for n in range(8)]  # fmt: skip
    return "\n".join(["time_s,h1,l1,h2,l2", *lines[:4], note, *lines[4:]]) + "\n"


@pytest.mark.parametrize(
    "note",
    [">> affichage en fraction de Vcc", ">> tu\u015f: \u015fimdi Vcc oran\u0131", ">> ratio mode",
     "mode button pressed", "MODE 2", "tryb wzgledny", "# \u663e\u793a\u6bd4\u4f8b"],
)  # fmt: skip
def test_a_line_of_words_where_all_readings_jump_is_asked(note: str) -> None:
    sensor = replace(SENSOR, strips=2)
    with pytest.raises(Unanswered, match="line 6 says"):
        propose(of_text(_table_with(note, factor=0.2)), sensor)


@pytest.mark.parametrize("note", ["looks ok", "wifi reconnected", ">> harder", "battery low"])
def test_words_at_which_nothing_jumps_cost_nothing(note: str) -> None:
    found = propose(of_text(_table_with(note, factor=1.0)), replace(SENSOR, strips=2))
    assert len(found.scans) == 8
    assert not found.doubts


@pytest.mark.parametrize(
    "note",
    [
        "# alimentation: sur batterie, 4,1 V",
        "# \u6539\u7528\u7535\u6c60\u4f9b\u7535\uff0c4,1 V",
        "# runs on lipo now",
        "# jetzt am Akku",
    ],
)
def test_another_supply_among_the_readings_is_asked_in_any_language(note: str) -> None:
    with pytest.raises(Unanswered, match="line 6 says"):
        propose(of_text(_table_with(note, factor=0.9)), replace(SENSOR, strips=2))
    part = propose(
        of_text(_table_with(note, factor=0.9)), replace(SENSOR, strips=2), {"part": "above line 6"}
    )
    assert len(part.scans) == 4


@pytest.mark.parametrize("bits", [8, 10])
def test_whole_numbers_up_to_a_hundred_are_codes_or_percent(bits: int) -> None:
    text = "t,h1,l1,h2,l2\n" + "".join(f"{0.1 * n:.1f},{57 + n},30,{51 + n},{27 + n}\n" for n in range(8))
    sensor = replace(SENSOR, strips=2, adc_bits=bits)
    with pytest.raises(Unanswered, match="unit=percent"):
        propose(of_text(text), sensor)
    assert propose(of_text("# raw ADC codes\n" + text), sensor).mapping.unit == "code"


BLOCK = "strip 0  high=none  low=none\nstrip 1  high={:.2f}V  low=1.65V\nstrip 2  high=2.79V  low=1.26V\n"


def _in_blocks(labels: tuple[str, ...]) -> str:
    return "".join(f"{labels[n % len(labels)]}\n{BLOCK.format(2.2 + 0.05 * n)}" for n in range(8))


@pytest.mark.parametrize(
    "labels",
    [("--- left hand pad ---", "--- right hand pad ---"), ("# thumb", "# index finger"),
     ("Sensor links", "Sensor rechts"), ("== L ==", "== R ==")],
)  # fmt: skip
def test_labels_that_take_turns_above_blocks_name_sensors(labels: tuple[str, ...]) -> None:
    sensor = replace(SENSOR, strips=3, strip_base=0)
    with pytest.raises(Unanswered, match="are these of 2 sensors") as asked:
        propose(of_text(_in_blocks(labels)), sensor, {"rate_hz": "50"})
    (question,) = asked.value.questions
    one, other, every = (
        propose(of_text(_in_blocks(labels)), sensor, {"rate_hz": "50", question.key: choice}).scans
        for choice in question.choices
    )
    assert (len(one), len(other), len(every)) == (4, 4, 8)


@pytest.mark.parametrize("label", ["--- pad ---", "scan", "next"])
def test_one_label_above_all_blocks_names_no_sensor(label: str) -> None:
    found = propose(of_text(_in_blocks((label,))), replace(SENSOR, strips=3, strip_base=0), {"rate_hz": "50"})
    assert len(found.scans) == 8


def test_a_column_of_two_words_is_asked_as_that_of_the_ends() -> None:
    text = "t;strip;end;reading_mV\n" + "".join(
        f"{0.1 * n:.1f};{strip};{end};{volts + n}\n"
        for n in range(6) for strip in (0, 1) for end, volts in (("supply side", 2800), ("ground side", 1700))
    )  # fmt: skip
    sensor = replace(SENSOR, strips=2, strip_base=0)
    with pytest.raises(Unanswered, match="does it say which end") as asked:
        propose(of_text(text), sensor)
    assert asked.value.questions[0].choices == ("which", "skip")
    found = propose(of_text(text), sensor, {"end": "which"})
    assert (
        found.scans[0].values[0].tolist() == pytest.approx([2.8, 1.7], rel=1e-3) or found.mapping.unit == "mV"
    )


def test_matrices_that_octave_saves_as_text_are_read_whatever_the_ending(tmp_path: Path) -> None:
    rows = "\n".join(" ".join(f"{v + 0.01 * n:.4f}" for v in (2.8, 2.9)) for n in range(6))
    low = rows.replace("2.", "1.")
    text = f"# Created by Octave 8.4.0\n# name: Vhigh\n# type: matrix\n# rows: 6\n# columns: 2\n{rows}\n\n\n"
    text += f"# name: Vlow\n# type: matrix\n# rows: 6\n# columns: 2\n{low}\n"
    (tmp_path / "x.mat").write_text(text)
    (tmp_path / "x.txt").write_text(text)
    one, other = (read_table(tmp_path / name) for name in ("x.mat", "x.txt"))
    assert one.rows == other.rows
    (tmp_path / "binary.mat").write_bytes(b"MATLAB 5.0 MAT-file" + bytes(200))
    with pytest.raises(ts.ReadingError, match="damaged"):
        read_table(tmp_path / "binary.mat")
    (tmp_path / "new.mat").write_bytes(b"MATLAB 7.3 MAT-file" + bytes(200))
    with pytest.raises(ts.ReadingError, match="-v7"):
        read_table(tmp_path / "new.mat")
    low_high = {
        "t": np.arange(6.0)[:, None],
        "Vh": np.full((6, 2), 2.5),
        "Vl": np.full((6, 2), 1.5),
        "Vref": 5.0,
    }
    savemat(tmp_path / "saved.mat", low_high)
    saved = read_table(tmp_path / "saved.mat")
    assert (saved.names[0], len(saved.names), saved.rows[1][:2]) == ("t", 5, ["1", "2.5"])


def test_cells_of_an_open_document_are_read_as_often_as_they_are_repeated(tmp_path: Path) -> None:
    table, office = (
        "urn:oasis:names:tc:opendocument:xmlns:table:1.0",
        "urn:oasis:names:tc:opendocument:xmlns:office:1.0",
    )
    text = "urn:oasis:names:tc:opendocument:xmlns:text:1.0"
    names = "".join(
        f"<t:table-cell><x:p>{n}</x:p></t:table-cell>" for n in ("t (s)", "strip", "high (V)", "low (V)")
    )
    rows = "".join(
        f"<t:table-row><t:table-cell o:value='{n}'/><t:table-cell o:value='{s}'/>"
        "<t:table-cell o:value='2.5' t:number-columns-repeated='2'><x:p>2,5</x:p></t:table-cell>"
        "<t:table-cell t:number-columns-repeated='16380'/></t:table-row>"
        for n in range(4) for s in range(2)
    )  # fmt: skip
    empty = "<t:table-row t:number-rows-repeated='1048000'>"
    empty += "<t:table-cell t:number-columns-repeated='16384'/></t:table-row>"
    sheet = f"<t:table t:name='A'><t:table-row>{names}</t:table-row>{rows}{empty}</t:table>"
    path = tmp_path / "log.ods"
    with zipfile.ZipFile(path, "w") as packed:
        packed.writestr(
            "content.xml", f"<o:doc xmlns:o='{office}' xmlns:t='{table}' xmlns:x='{text}'>{sheet}</o:doc>"
        )
    read = read_table(path)
    assert (len(read.rows), read.rows[-1]) == (8, ["3", "1", "2.5", "2.5"])
    path.write_bytes(path.read_bytes()[:-30])
    with pytest.raises(ts.ReadingError, match="damaged"):
        read_table(path)


@pytest.mark.parametrize("day", ["03/05/24", "03/05/2024", "2024-03-05"])
def test_the_blank_before_pm_is_within_a_field(day: str) -> None:
    rows = "".join(f"{n + 1},{day} 02:14:0{n} PM,{2.8 + 0.1 * n:.3f},1.7,2.9,1.6\n" for n in range(6))
    found = propose(of_text(f"No,Date Time,h1,l1,h2,l2\n{rows}"), replace(SENSOR, strips=2))
    assert [s.time_s - found.scans[0].time_s for s in found.scans] == pytest.approx(range(6))
    assert found.scans[0].values.ravel().tolist() == pytest.approx([2.8, 1.7, 2.9, 1.6])


def test_an_event_at_the_end_that_is_read_as_an_empty_scan_is_doubted() -> None:
    rows = "".join(f"0.{n},{2.8 + 0.1 * n:.3f},1.7,2.9,1.6,\n" for n in range(6))
    found = propose(of_text(f"t,h1,l1,h2,l2,stopped\n{rows}0.6,,,,,Logged\n"), replace(SENSOR, strips=2))
    assert len(found.scans) == 6 or any("Logged" in doubt for doubt in found.doubts)
