"""Logs in which readings change their meaning, come from several senders, or stand between another device's values."""

from __future__ import annotations

import json

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.io.log_import.changes import tells_of_change
from tacstrip.io.log_import.guess import Proposal, propose
from tacstrip.io.log_import.questions import Unanswered
from tacstrip.io.log_import.scans import scans
from tacstrip.io.log_import.text import of_text

_SENSOR = ts.Sensor(construction="crs-crs", strips=4, pitch_mm=8.0, length_mm=60.0, vref_volt=5.0)
_SCANS = 6


def _high(scan: int, strip: int) -> float:
    """v_h; the low end is 1 V below it; strips above 2 are untouched."""
    return 2.5 + 0.1 * scan + 0.01 * strip if strip < 3 else float("nan")


def _read(text: str, **answers: str) -> Proposal:
    return propose(of_text(text), _SENSOR, answers)


def _assert_scans(found: Proposal, scans: list[int]) -> None:
    truth = np.array([[[_high(n, s), _high(n, s) - 1.0] for s in range(4)] for n in scans])
    assert np.stack([scan.values for scan in found.scans]) == pytest.approx(truth, abs=2e-3, nan_ok=True)


def _field(value: float) -> str:
    return "" if np.isnan(value) else f"{value:.3f}"


def _with_note(note: str, above: int = 3, long: bool = True) -> str:
    lines = ["t_s,strip,v_h,v_l"] if long else ["t_s," + ",".join(f"h{s},l{s}" for s in range(4))]
    for scan in range(_SCANS):
        lines += [note] if scan == above else []
        both = [[_field(_high(scan, s)), _field(_high(scan, s) - 1.0)] for s in range(4)]
        if long:
            lines += [f"{scan / 10:.1f},{s},{h},{v}" for s, (h, v) in enumerate(both)]
        else:
            lines.append(f"{scan / 10:.1f}," + ",".join(f"{h},{v}" for h, v in both))
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("long", [True, False])
@pytest.mark.parametrize(
    "note",
    [
        "changed the sketch: prints ratios now",
        "# reflashed, now in mV",
        "// from here on through the divider",
        "switched to another sensor pad",
        "ab hier mit Verst\u00e4rkung",
        "Stecker von Streifen vertauscht",
        "maintenant en millivolts",
        "cambiado el orden de las tiras",
        "trocados os fios das fitas",
        "scambiati i connettori delle strisce",
    ],
)
def test_a_note_that_readings_change_their_meaning_is_asked(note: str, long: bool) -> None:
    text = _with_note(note, long=long)
    with pytest.raises(Unanswered) as asked:
        _read(text)
    question = next(q for q in asked.value.questions if q.key == "part")
    assert note.strip("#/ ") in question.text
    above, below, both = question.choices
    scaled = {"scale": "1"} if "scale" in {q.key for q in asked.value.questions} else {}
    _assert_scans(_read(text, part=above, **scaled), [0, 1, 2])
    _assert_scans(_read(text, part=below, **scaled), [3, 4, 5])
    _assert_scans(_read(text, part=both, **scaled), [*range(_SCANS)])


@pytest.mark.parametrize(
    "note", ["changed the object: a ball", "# now pressing harder", "battery replaced", "neuer Versuch", "ok"]
)
def test_other_notes_ask_nothing(note: str) -> None:
    assert not tells_of_change(note)
    _assert_scans(_read(_with_note(note)), [*range(_SCANS)])


@pytest.mark.parametrize("long", [True, False])
@pytest.mark.parametrize(
    ("note", "above"),
    [
        ("skin fw 1.4 - output is now ratiometric", "skin fw 1.3"), ("fw 1.4 ratiometric", ""), ("mode: ratio", ""),
        ("I (1234) cfg: unit=mV", ""), ("[cfg] format=fraction", ""), ('{"event": "config", "unit": "mV"}', ""),
        ("gain set to 2", ""), ("scale x1000", ""), ("skin v1.4", "skin v1.3"), ("Ausgabe in mV", ""),
        ("skin fw 1.4\noutput: mV\nunit is mV", "skin fw 1.3"), ("salida en milivoltios", ""),
        ("wyj\u015bcie w mV", ""),
    ],
)  # fmt: skip
def test_a_message_of_how_readings_are_written_is_asked(note: str, above: str, long: bool) -> None:
    text = f"{above}\n" * bool(above) + _with_note(note, long=long)
    with pytest.raises(Unanswered) as asked:
        _read(text)
    question = next(q for q in asked.value.questions if q.key == "part")
    assert note.split("\n")[0] in question.text
    left_out = {"broken_lines": "skip"} if "v1" in note else {}  # the same line may be a damaged one
    _assert_scans(_read(text, part=question.choices[0]), [0, 1, 2])
    _assert_scans(_read(text, part=question.choices[1], **left_out), [3, 4, 5])


@pytest.mark.parametrize("scans", [2, 3])
def test_lines_of_a_records_own_form_ask_nothing(scans: int) -> None:
    lines = []
    for n in range(scans):
        lines += [f"scan {n}, t = {n / 10} s"]
        lines += [f"output strip {s}: H={_high(n, s):.3f} L={_high(n, s) - 1.0:.3f}" for s in range(3)]
        lines += ["output strip 3: H=- L=-"]
    _assert_scans(_read("\n".join(lines)), [*range(scans)])


@pytest.mark.parametrize(
    "note",
    [
        "wifi: connected to lab",
        "W (1234) wifi: channel 6",
        "battery 3.9 V",
        "lost 3 packets",
        "skin fw 1.3",
        "W (3805) adc: calibration eFuse not burnt",
    ],
)
def test_a_message_of_something_else_asks_nothing(note: str) -> None:
    rows = [f"t={t} strip={s} h={h or '-'} l={v or '-'}" for t, s, h, v in _rows()]
    text = "\n".join(["skin fw 1.3", *rows[:12], note, *rows[12:]]) + "\n"
    _assert_scans(_read(text, time_unit="s"), [*range(_SCANS)])


def _rows() -> list[list[str]]:
    return [line.split(",") for line in _with_note("", above=-1).splitlines()[1:]]


@pytest.mark.parametrize("long", [True, False])
@pytest.mark.parametrize(
    "note",
    [
        "# moved to the left end", "# Vref = 5.00", "# VREF: 5000 mV", "# finger swapped for pen",
        "# now pressing strip 3", "# changed the pen for a ball", "# other object: steel ball",
        "# slid over to strip 2",
        "# now touching the sensor with two fingers", "# new press on the pad", "# moved 5 mm to the right",
        "# jetzt fester gedr\u00fcckt", "# zum linken Rand verschoben", "# maintenant plus fort", "# objet chang\u00e9",
        "# ahora m\u00e1s fuerte", "# agora com a caneta", "# adesso con la penna", "# nu harder gedrukt",
    ],
)  # fmt: skip
def test_a_note_of_what_touches_or_of_the_specs_vref_is_told_and_no_more(note: str, long: bool) -> None:
    found = _read(_with_note(note, long=long))
    _assert_scans(found, [*range(_SCANS)])
    assert not found.doubts
    assert "1 note(s) among the readings: none changes how they are read" in found.reasons


@pytest.mark.parametrize("long", [True, False])
@pytest.mark.parametrize(
    "note",
    [
        "# moved to the left pad", "# Vref = 3.30", "# swapped the ends", "# now left hand",
        "# left and right swapped", "# now pressing with gain 2", "# pressed, now in mV", "# unit: mV",
        "# strips reversed from here", "# sensor replaced, same pen", "# pressing harder, other board",
        "# neuer Sensor, gleicher Stift", "# now touching the other sensor",
        "# scale changed, same object", "# moved to the left hand",
    ],
)  # fmt: skip
def test_a_note_of_the_sensor_beside_one_of_what_touches_is_asked(note: str, long: bool) -> None:
    with pytest.raises(Unanswered) as asked:
        _read(_with_note(note, long=long))
    assert "part" in {q.key for q in asked.value.questions}


@pytest.mark.parametrize(
    "note",
    [
        "# from here on half",
        "# moved the plug to the left end",
        "# nuovo cavo",
        "# po nacisku inny wzmacniacz",
    ],
)
def test_a_note_with_a_word_that_is_not_known_stays_a_doubt(note: str) -> None:
    assert any("taken as notes" in doubt for doubt in _read(_with_note(note)).doubts)


def test_a_unit_that_the_names_say_is_no_change_and_another_is() -> None:
    named = _with_note("# values in V", long=True).replace("v_h,v_l", "v_h [V],v_l [V]")
    _assert_scans(_read(named), [*range(_SCANS)])
    with pytest.raises(Unanswered):
        _read(named.replace("values in V", "values in mV"))


def test_a_long_line_of_marks_is_read_once() -> None:
    """Not in the square of its length: 20,000 marks would take a minute so."""
    for mark in "#/;!":
        _assert_scans(_read(_with_note(mark * 20_000)), [*range(_SCANS)])


def _messages(key: str, names: list[str], force: bool = False) -> str:
    made = []
    for scan in range(_SCANS):
        both = [
            [None if np.isnan(v := _high(scan, s) - d) else round(v, 3) for s in range(4)] for d in (0.0, 1.0)
        ]
        if force:
            made.append({"t_s": scan / 10, key: names[1], "force": [0.1, 9.8]})
        name = names[0] if force else names[scan % len(names)]
        made.append({"t_s": scan / 10, key: name, "high": both[0], "low": both[1]})
    return "\n".join(map(json.dumps, made)) + "\n"


@pytest.mark.parametrize("key", ["frame_id", "topic", "source", "node", "who"])
def test_readings_of_two_senders_are_asked_and_each_answer_leads_to_one(key: str) -> None:
    text = _messages(key, ["left", "right_one"])
    with pytest.raises(Unanswered) as asked:
        _read(text)
    question = next(q for q in asked.value.questions if q.key == key)
    assert {"left", "right_one"} <= {*question.choices}
    _assert_scans(_read(text, **{key: "right_one"}), [1, 3, 5])


def test_messages_of_another_sensor_are_no_scans() -> None:
    found = _read(_messages("frame_id", ["skin", "wrist"], force=True), missing="untouched")
    _assert_scans(found, [*range(_SCANS)])
    assert [scan.time_s for scan in found.scans] == pytest.approx([n / 10 for n in range(_SCANS)])


@pytest.mark.parametrize("nothing", ["-1", "open", "nan"])
@pytest.mark.parametrize("before", [True, False])
def test_rows_of_another_device_in_a_merged_table_are_no_scans(nothing: str, before: bool) -> None:
    lines = [
        "time,"
        + "imu_x," * before
        + ",".join(f"h{s} [V],l{s} [V]" for s in range(4))
        + ",temp" * (not before)
    ]
    for scan in range(_SCANS):
        lines.append(f"{scan / 10:.2f}," + "0.1," * before + "," * 7 + ",21.5" * (not before))
        fields = [_field(v) or nothing for s in range(4) for v in (_high(scan, s), _high(scan, s) - 1.0)]
        lines.append(f"{scan / 10 + 0.05:.2f}," + "," * before + ",".join(fields) + "," * (not before))
    found = _read("\n".join(lines) + "\n")
    _assert_scans(found, [*range(_SCANS)])
    assert any("nothing of a strip" in reason for reason in found.reasons)


def test_an_empty_scan_stays_where_untouched_strips_are_empty() -> None:
    text = _with_note("", long=False).replace("0.3,2.8", "0.25,,,,,,,,\n0.3,2.8")
    assert len(_read(text).scans) == _SCANS + 1


def noted(note: str, factor: float, step: float = 0.01) -> str:
    """Return a log of which readings are multiplied by a factor below a comment."""
    lines = ["t,strip,high,low"]
    for n in range(12):
        f = factor if n >= 6 else 1.0
        lines += [note] if n == 6 else []
        high, low = 3.0 + step * n, 2.0 + step * n
        lines += [f"{0.05 * n:.2f},{s},{f * (high + 0.1 * s):.4f},{f * low:.4f}" for s in range(3)]
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("note", "factor"),
    [
        ("# od tego miejsca jako ułamek Vref", 0.2), ("# от сюда в % ", 20.0), ("# buradan sonra oran", 0.2),
        ("# itt felére csökken minden", 0.5), ("// ここから半分", 0.5), ("# ab hier mV", 1.0),
    ],
)  # fmt: skip
def test_a_note_with_a_unit_or_a_jump_is_asked_in_whichever_language(note: str, factor: float) -> None:
    pad = ts.Sensor(construction="crs-crs", strips=3, pitch_mm=6.0, length_mm=80.0, vref_volt=5.0)
    table = of_text(noted(note, factor))
    with pytest.raises(Unanswered) as error:
        propose(table, pad)
    (question,) = error.value.questions
    assert question.choices == ("above line 20", "below line 20", "skip")
    first = propose(table, pad, {"part": "above line 20"})
    assert [s.values[0, 0] for s in first.scans] == pytest.approx([3.0 + 0.01 * n for n in range(6)])
    again = scans(of_text(noted(note, factor)), first.mapping)
    assert len(again) == 6


@pytest.mark.parametrize("note", ["# palec zeslizgnal sie", "# Kabel berührt, 2. Versuch", "# battery 3.3 V"])
def test_a_note_without_a_jump_is_a_doubt(note: str) -> None:
    pad = ts.Sensor(construction="crs-crs", strips=3, pitch_mm=6.0, length_mm=80.0, vref_volt=5.0)
    found = propose(of_text(noted(note, 1.0)), pad)
    assert len(found.scans) == 12
    assert sum("taken as notes" in d for d in found.doubts) == 1
