"""Logs of values within each other, and of what programs print as it is: one regular form, with no question."""
# ruff: noqa: E501 (a line is a log's)

from __future__ import annotations

import contextlib
import datetime as dt
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import tacstrip as ts
from tacstrip.cli import cli
from tacstrip.io.log_import.containers import read_table
from tacstrip.io.log_import.guess import Proposal, propose
from tacstrip.io.log_import.nested import regular
from tacstrip.io.log_import.questions import Unanswered
from tacstrip.io.log_import.runs import of_runs
from tacstrip.io.log_import.text import of_text
from tacstrip.io.log_import.turns import turns
from tacstrip.io.log_import.wrapped import unwrapped

Ends = tuple[float, float] | None
STRIPS = 4
TWO = ts.Sensor(construction="crs-crs", strips=STRIPS, pitch_mm=10.0, length_mm=50.0, vref_volt=3.3)
ONE = ts.Sensor(
    construction="crs-m", strips=STRIPS, pitch_mm=10.0, length_mm=50.0, vref_volt=3.3, adc_bits=12
)
START = dt.datetime(2026, 5, 4, 10, 12)
MOST = 4095


def _scan(i: int) -> list[Ends]:
    """Return the ends of a contact that moves over the strips and is gone in some scans."""
    at = i / 5.0 - 0.5
    return [
        (round(2.0 + 0.02 * i - 0.2 * abs(s - at), 3), round(1.2 + 0.03 * i + 0.1 * abs(s - at), 3))
        if abs(s - at) < 1.2 and i % 6
        else None
        for s in range(STRIPS)
    ]


SCANS = [_scan(i) for i in range(24)]
TRUTH = np.array([[pair or (np.nan, np.nan) for pair in scan] for scan in SCANS])


def _at(i: int, form: str = "%H:%M:%S.%f") -> str:
    return (START + dt.timedelta(seconds=i / 20)).strftime(form)


def _lines(line: Callable[[int, list[Ends]], str]) -> str:
    return "".join(f"{line(i, scan)}\n" for i, scan in enumerate(SCANS))


def _touched(scan: list[Ends], names: str, *, milli: bool = False) -> dict[str, dict[str, float]]:
    times = 1000.0 if milli else 1.0
    return {
        names[s]: {"hi": round(times * pair[0], 3), "lo": round(times * pair[1], 3)}
        for s, pair in enumerate(scan) if pair
    }  # fmt: skip


def _ends(scan: list[Ends], end: int) -> list[float | None]:
    return [pair and pair[end] for pair in scan]


def _by_identifiers() -> str:
    records = {f"-Nx{i:03d}aZ": {"ts": 1777889520000 + 50 * i} for i in range(24)}
    for record, scan in zip(records.values(), SCANS, strict=True):
        record |= {"strips": {f"s{k}": of for k, of in _touched(scan, "1234").items()}} if any(scan) else {}  # type: ignore[dict-item]
    return json.dumps({"device": "glove", "readings": records, "config": {"unit": "V"}})


def _letters() -> str:
    frames = [{"t": 50.0 * i, "strips": _touched(scan, "ABCD", milli=True)} for i, scan in enumerate(SCANS)]
    return json.dumps({"settings": {"unit": "mV", "timebase": "ms", "strips": [*"ABCD"]}, "frames": frames})


def _hits() -> str:
    hits = [
        {"_index": "skin", "_score": None, "sort": [i], "_source": {"@timestamp": f"{_at(i, '%Y-%m-%dT%H:%M:%S.%f')}Z",
         "skin": {"strip": s, "v_high": pair and pair[0], "v_low": pair and pair[1]}}}
        for i, scan in enumerate(SCANS) for s, pair in enumerate(scan)
    ]  # fmt: skip
    return json.dumps({"took": 3, "hits": {"total": {"value": 96}, "max_score": None, "hits": hits}})


def _payload(i: int, scan: list[Ends]) -> str:
    payload = json.dumps({"t_ms": 50 * i, "vh": _ends(scan, 0), "vl": _ends(scan, 1)})
    return json.dumps({"device": "pi", "body": payload})


def _message(i: int, scan: list[Ends]) -> str:
    said = " ".join(f"s{s + 1}={p[0]}/{p[1]}" if p else f"s{s + 1}=-" for s, p in enumerate(scan))
    return json.dumps(
        {"__TIMESTAMP": str(1777889520000000 + 50000 * i), "PID": "8", "MESSAGE": f"scan {i} {said}"}
    )


def _rust(i: int, scan: list[Ends]) -> str:
    ends = ", ".join(f"Some(({p[0]}, {p[1]}))" if p else "None" for p in scan)
    return f"Scan {{ t_us: {50000 * i + 7}, readings: [{ends}] }}"


def _objects(i: int, scan: list[Ends]) -> str:
    high, low = (", ".join("nan" if v is None else str(v) for v in _ends(scan, end)) for end in (0, 1))
    return f"Scan(time={START + dt.timedelta(seconds=i / 20)!r}, high=array([{high}], dtype=float32), low=array([{low}]))"


def _console(i: int, scan: list[Ends]) -> str:
    ends = ", ".join(f"[ {p[0]}, {p[1]} ]" if p else "null" for p in scan)
    return f"{{ time_s: {i / 20}, strips: [ {ends} ] }}"


def _yaml(i: int, scan: list[Ends]) -> str:
    ends = ", ".join(f"{s + 1}: [{p[0]}, {p[1]}]" for s, p in enumerate(scan) if p)
    return f"- t: {i / 20:.2f}\n  strips: {{{ends}}}"


def _report(i: int, scan: list[Ends]) -> str:
    of = [f"  strip {s + 1}: high {p[0]} V, low {p[1]} V\n" for s, p in enumerate(scan) if p]
    return f"--- scan {i} @ {i / 20:.2f} s ---\n" + ("".join(of) or "  (nothing)\n").rstrip("\n")


def _turned() -> str:
    ends = [(s, e) for s in range(STRIPS) for e in (0, 1)]
    rows = [
        [
            f"strip {s + 1} {('high', 'low')[e]}",
            *("" if v is None else str(v) for v in (_ends(x, e)[s] for x in SCANS)),
        ]
        for s, e in ends
    ]
    return "".join(",".join(row) + "\n" for row in [["t (s)", *(f"{i / 20:.2f}" for i in range(24))], *rows])


def _row(mark: str, nothing: str, scan: list[Ends]) -> str:
    return mark.join(nothing if p is None else str(v) for p in scan for v in p or (0.0, 0.0))


NAMES = [f"Strip {s + 1} {end}" for s in range(STRIPS) for end in ("high", "low")]
FORMS = {
    "records by identifiers": _by_identifiers(),
    "strips by letters": _letters(),
    "an answer of Elasticsearch": _hits(),
    "JSON in a text": _lines(_payload),
    "lines in records": _lines(_message),
    "ends as U and L": _lines(lambda i, s: json.dumps({"t_s": i / 20, "U": _ends(s, 0), "L": _ends(s, 1)})),
    "records by times": json.dumps({str(1777889520000 + 50 * i): {"h": _ends(s, 0), "l": _ends(s, 1)} for i, s in enumerate(SCANS)}),
    "Ruby's hashes": _lines(lambda i, s: f"{{:uptime_ms=>{50 * i}, :h=>{_ends(s, 0)}, :l=>{_ends(s, 1)}}}".replace("None", "nil")),
    "records of a database's prompt": "skin=> select\n" + "".join(
        f"-[ RECORD {4 * i + s} ]----\nts    | {_at(i, '%Y-%m-%d %H:%M:%S.%f')}\nstrip | {s}\nv_h   | {p and p[0]}\nv_l   | {p and p[1]}\n".replace("None", "")
        for i, scan in enumerate(SCANS) for s, p in enumerate(scan)
    ),
    "Rust's structs": _lines(_rust),
    "Python's objects": _lines(_objects),
    "JavaScript's console": "> node log.js\n" + _lines(_console),
    "maps of YAML in a line": "unit: V\nsamples:\n" + _lines(_yaml),
    "a report whose title names strips": "Skin test, Vref 3.30 V, strips 1-4\n" + _lines(_report),
    "lines that begin with names": _turned(),
    "Serial Studio's times": f"RX Date/Time,{','.join(NAMES)}\n" + _lines(lambda i, s: f"{_at(i, '%Y/%m/%d/ %H:%M:%S::%f')[:-3]},{_row(',', 'nan', s)}"),
    "a remark on one line": f"Time (s)\t{chr(9).join(NAMES)}\tComment\n" + _lines(lambda i, s: f"{i / 20}\t{_row(chr(9), 'NaN', s)}" + "\tforce on" * (i == 7)),
    "units in Chinese": "\u67d4\u6027\u4f20\u611f\u5668 \u5355\u4f4dmV\n" + _lines(lambda i, s: f"[{_at(i)[:-3]}] " + " ".join(f"{k + 1}:{1000 * p[0]:.0f},{1000 * p[1]:.0f}" if p else f"{k + 1}:--,--" for k, p in enumerate(s))),
}  # fmt: skip


def _proposed(text: str, sensor: ts.Sensor = TWO) -> Proposal:
    return propose(of_text(text), sensor, {}, frozenset({"vref_volt"}))


@pytest.mark.parametrize("text", FORMS.values(), ids=FORMS)
def test_read_without_a_question(text: str) -> None:
    found = _proposed(text)
    scale = {"mV": 1e-3}.get(found.mapping.unit, 1.0)
    np.testing.assert_allclose(scale * np.stack([s.values for s in found.scans]), TRUTH, atol=6e-4)
    times = np.array([s.time_s for s in found.scans])
    np.testing.assert_allclose(times - times[0], np.arange(24) / 20, atol=1e-3)


def test_no_line_of_strips_is_passed_over_above_the_first_that_is_understood() -> None:
    """Where nothing touches the last strip, what stands behind it is taken for its value, and not understood."""
    lines = _lines(
        lambda i, s: (
            f'"{i} ' + " ".join(f"s{k}={p[0]}/{p[1]}" if p else f"s{k}=-" for k, p in enumerate(s)) + '"}'
        )
    )
    table = of_runs(lines)
    assert table is not None
    assert {i + 1 for i in range(24) if any(SCANS[i])} <= {*table.lines, *table.broken}


@pytest.mark.parametrize("nothing", [str(MOST), "unknown"])
def test_what_whole_scans_of_one_signature_show_is_no_contact(nothing: str) -> None:
    codes = [[nothing if p is None else f"{1600 * p[0]:.0f}" for p in scan] for scan in SCANS]
    text = "ms,s1,s2,s3,s4\n" + "".join(f"{50 * i},{','.join(row)}\n" for i, row in enumerate(codes))
    found = _proposed(text, ONE)
    np.testing.assert_array_equal(np.isnan([s.values[:, 0] for s in found.scans]), np.isnan(TRUTH[:, :, 0]))


def test_a_word_within_a_contact_is_asked_about() -> None:
    rows = [["2.5", "unknown", "2.4", "unknown"]] * 8 + [["unknown"] * 4] * 4
    text = "ms,s1,s2,s3,s4\n" + "".join(f"{50 * i},{','.join(row)}\n" for i, row in enumerate(rows))
    with pytest.raises(Unanswered, match="untouched=unknown"):
        _proposed(text, ONE)


def test_a_reading_that_is_held_is_of_one_sensor() -> None:
    steps = 1.0 + 0.2 * np.repeat(np.arange(12.0), 2)[:, None, None] * np.ones((1, 2, 1))
    assert turns(steps + 1e-3 * np.arange(24.0)[:, None, None], np.arange(24.0)) == 0


def test_a_number_that_lacks_the_unit_of_all_others_is_cut() -> None:
    rows = [
        f"{50 * i} S1h:{50 - i}.25% S1l:{40 - i}.75% S2h:{51 - i}.25% S2l:{41 - i}.75%" for i in range(24)
    ]
    rows[9] = rows[9].removesuffix(".75%")
    assert of_text("\n".join(rows)).broken == (10,)


def test_an_answer_to_nothing_is_told_what_is_asked() -> None:
    text = "ms,h1,l1,h2,l2\n" + "".join(f"{i},0.8,0.7,0.8,0.7\n" for i in range(9))
    sensor = ts.Sensor(construction="crs-crs", strips=2, pitch_mm=10.0, length_mm=50.0, vref_volt=3.3)
    with pytest.raises(ts.OptionError, match=r"no question has the key 'foo'.*the log asks for: .*unit"):
        propose(of_text(text), sensor, {"foo": "bar"})
    with pytest.raises(ts.OptionError, match="asks nothing: leave it out"):
        propose(of_text(FORMS["Rust's structs"]), TWO, {"foo": "bar"})


def test_import_without_a_sensor_says_that_one_would_help(tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    log.write_text("a,b\n" + "".join(f"{i % 5},{7 * i % 3}\n" for i in range(30)))
    assert read_table(log).names == ("a", "b")
    made = CliRunner().invoke(cli, ["import", str(log), "-o", str(tmp_path / "out.csv")])
    assert made.exit_code != 0
    assert "name a SENSOR" in f"{made.output}{made.exception}"


@pytest.mark.parametrize("names", [["t", "h", "l"], ["temp", "hum", "batt"], ["left", "right", "both"]])
def test_names_of_columns_or_sensors_are_no_strips(names: list[str]) -> None:
    arrays = {names[1]: {"hi": [1.5, 1.4], "lo": [1.2, 1.1]}, names[2]: {"hi": [1.5, 1.4], "lo": [1.2, 1.1]}}
    for record in ({names[0]: 0.5, names[1]: 2.5, names[2]: 1.5}, arrays):
        value = {"columns": names, "rows": [record, dict(record)]}
        assert regular(value) == (value, ())


def test_a_number_in_milliseconds_that_rises_unevenly_is_the_time() -> None:
    at = np.cumsum([40 + 37 * i % 90 for i in range(24)])
    text = f"board_ms,{','.join(NAMES)}\n" + _lines(lambda i, s: f"{at[i]},{_row(',', '', s)}")
    assert np.array([s.time_s for s in _proposed(text).scans]) == pytest.approx((at - at[0]) / 1000.0)


def test_a_cut_record_that_is_a_scan_costs_no_other() -> None:
    lines = _lines(
        lambda i, s: (
            f"{_at(i)[:-3]} pi skin[7]: frame {i} "
            + (" ".join(f"| {k}: {p[0]}/{p[1]} V" for k, p in enumerate(s) if p) or "(no touch)")
        )
    ).splitlines()
    lines[9] = lines[9][: lines[9].rindex("/")]
    found = _proposed("\n".join(lines) + "\n")
    np.testing.assert_allclose(np.stack([s.values for s in found.scans]), np.delete(TRUTH, 9, axis=0))


@pytest.mark.parametrize(
    "text",
    [
        "{[1]: 2}\n" * 4,
        "(-'a', 1)\n" * 4,
        "(datetime.datetime('a', 'b', 'c'), 1.0)\n" * 4,
        "(datetime.datetime(2026, 5, 4, 99999999999999999999), 1.0)\n" * 4,
        '{"message": "S1 2.5 1.9", "time": 1' + "0" * 400 + "}\n",
        '{"a": ' * 600 + "1" + "}" * 600,
        "[" * 900 + "1" + "]" * 900,
    ],
    ids=["key", "sign", "date", "hour", "time", "records", "lists"],
)
def test_values_that_cannot_be_end_in_no_traceback(text: str) -> None:
    with contextlib.suppress(ts.ReadingError):
        of_text(text)


def test_a_record_of_a_logger_without_a_text_is_an_empty_line() -> None:
    texts = ["S1 2.5 1.9 S2 2.4 1.8"] * 30 + [None]
    log = "\n".join(json.dumps({"message": text, "time": f"10:00:{i:02}"}) for i, text in enumerate(texts))
    assert unwrapped(log).splitlines()[-1].strip() == "10:00:30"
