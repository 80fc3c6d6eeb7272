"""Nested records: JSON, Python's prints, keys in any depth and language; read, or asked about."""

from __future__ import annotations

import contextlib
import json
import pprint
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.errors import OptionError, ReadingError
from tacstrip.io.log_import.guess import Proposal, propose
from tacstrip.io.log_import.questions import Unanswered
from tacstrip.io.log_import.text import of_text

_STRIPS, _SCANS = 5, 6
_SENSOR = ts.Sensor(construction="crs-crs", strips=_STRIPS, pitch_mm=8.0, length_mm=60.0, vref_volt=5.0)


def _touched(scan: int, strip: int) -> bool:
    return scan != 3 and abs(strip - 1 - scan // 2) < 2


def _high(scan: int, strip: int) -> float:
    return round(2.5 + 0.1 * scan + 0.017 * strip, 3)


def _low(scan: int, strip: int) -> float:
    return round(_high(scan, strip) - 1.0 - 0.01 * strip, 3)


def _truth(scans: list[int]) -> np.ndarray:
    nan = float("nan")
    return np.array(
        [[[_high(n, s), _low(n, s)] if _touched(n, s) else [nan, nan] for s in range(_STRIPS)] for n in scans]
    )


def _read(text: str, **answers: str) -> Proposal:
    return propose(of_text(text), _SENSOR, answers)


def _assert_read(text: str, scale: float = 1.0) -> Proposal:
    found = _read(text)
    made = np.stack([scan.values for scan in found.scans])
    assert made.shape == (_SCANS, _STRIPS, 2)
    assert made == pytest.approx(_truth([*range(_SCANS)]) * scale, abs=1e-6, nan_ok=True)
    times = np.array([scan.time_s for scan in found.scans])
    assert times - times[0] == pytest.approx(0.05 * np.arange(_SCANS), abs=1e-6)
    return found


def _strips(scan: int, make: Callable[[int, float | None, float | None], Any]) -> list[Any]:
    return [
        make(s, _high(scan, s), _low(scan, s)) if _touched(scan, s) else make(s, None, None)
        for s in range(_STRIPS)
    ]


def _read_or_not(text: str) -> None:
    """Assert that a log is read as it is, or asked about, or refused."""
    with contextlib.suppress(Unanswered, ReadingError, OptionError):
        _assert_read(text)


def _as_list(scan: int) -> Any:
    return _strips(scan, lambda s, h, v: {"id": s, "hi": h, "lo": v})


def _with_flags(scan: int) -> Any:
    return _strips(
        scan,
        lambda s, h, v: {"n": s, "touched": h is not None, "ends": {"high": h or 0.02, "low": v or 0.01}},
    )


def _by_name(scan: int) -> Any:
    rows = _strips(
        scan, lambda s, h, v: (f"strip_{s}", {"contact": False} if h is None else {"v_h": h, "v_l": v})
    )
    return dict(rows)


def _pairs(scan: int) -> Any:
    return dict(_strips(scan, lambda s, h, v: (str(s), "open" if h is None else [h, v])))


def _by_channel(scan: int) -> Any:
    rows = _strips(scan, lambda s, h, v: (h, v))
    return {"haut": [h for h, _ in rows], "bas": [v for _, v in rows]}


_STRIPS_OF = [_as_list, _with_flags, _by_name, _pairs, _by_channel]


@pytest.mark.parametrize("strips", _STRIPS_OF)
@pytest.mark.parametrize("write", ["lines", "indented", "array", "object", "pprint", "repr"])
@pytest.mark.parametrize("time", ["flat", "deep", "parts"])
def test_records_in_any_form_of_text(strips: Callable[[int], Any], write: str, time: str) -> None:
    made = []
    for n in range(_SCANS):
        at: dict[str, Any] = {"t_ms": 50 * n}
        if time == "deep":
            at = {"meta": {"fw": "2.1", "clock": {"ms": 50 * n}}}
        elif time == "parts":
            at = {"stamp": {"sec": 1718040000, "nanosec": 50_000_000 * n}}
        made.append({"kind": "skin", **at, "data": {"unit": "V", "pads": strips(n)}})
    text = {
        "lines": lambda: "\n".join(map(json.dumps, made)),
        "indented": lambda: "\n".join(json.dumps(m, indent=2) for m in made),
        "array": lambda: json.dumps(made, indent=1),
        "object": lambda: json.dumps({"user": "Ana", "log": {"scans": made}}),
        "pprint": lambda: "\n".join(pprint.pformat(m, width=60) for m in made),
        "repr": lambda: "\n".join(map(repr, made)),
    }[write]()
    _read_or_not(text + "\n")


@pytest.mark.parametrize(
    "other", [{"volts": 7.2, "percent": 61}, {"imu": {"ax": 0.1, "ay": 0.2}}, {"force": [1, 2, 3]}, {}]
)
@pytest.mark.parametrize("key", ["type", "kind", "topic", "msg"])
def test_messages_of_another_kind_are_no_scans(key: str, other: dict[str, Any]) -> None:
    lines = []
    for n in range(_SCANS):
        lines.append(json.dumps({key: "skin", "t_s": 0.05 * n, "strips": _as_list(n)}))
        if n % 2:
            lines.append(json.dumps({key: "other", "t_s": 0.05 * n + 0.01, **other}))
    _read_or_not("\n".join(lines) + "\n")


def _xml(attributes: bool) -> str:
    scans = []
    for n in range(_SCANS):
        inner = ""
        for s in range(_STRIPS):
            if not _touched(n, s):
                inner += f'  <taxel nr="{s}"/>\n'
            elif attributes:
                inner += f'  <taxel nr="{s}" high="{_high(n, s)}" low="{_low(n, s)}"/>\n'
            else:
                inner += f'  <taxel nr="{s}"><high>{_high(n, s)}</high><low>{_low(n, s)}</low></taxel>\n'
        scans.append(f' <frame t="{0.05 * n:.2f}" temp="24.{n}">\n{inner} </frame>\n')
    return '<?xml version="1.0"?>\n<log><!-- volts -->\n' + "".join(scans) + "</log>\n"


def test_a_message_that_ros_lost_damages_no_time() -> None:
    text = "WARNING: topic [/skin] does not appear to be published yet\n"
    for n in range(_SCANS):
        text += "A message was lost!!!\n\ttotal count change:1\n\ttotal count: 1---\n" if n == 2 else ""
        text += f"header:\n  stamp:\n    sec: 1741096801\n    nanosec: {50_000_000 * n}\n  frame_id: pad\nstrips:\n"
        for s in range(_STRIPS):
            h, v = (_high(n, s), _low(n, s)) if _touched(n, s) else (".nan", ".nan")
            text += f"- id: {s}\n  v_high: {h}\n  v_low: {v}\n"
        text += "temperature: 24.5\n---\n"
    _assert_read(text)


# What must not be read without a word.


def _not_silent(text: str) -> None:
    try:
        found = _read(text)
    except (Unanswered, ReadingError, OptionError):
        return
    assert found.doubts


def test_two_senders_are_asked() -> None:
    lines = [
        json.dumps({"t_s": 0.05 * n, "frame": f"pad_{'ab'[n % 2]}", "strips": _as_list(n)})
        for n in range(_SCANS)
    ]
    with pytest.raises(Unanswered) as asked:
        _read("\n".join(lines))
    assert "frame" in {q.key for q in asked.value.questions}


def test_two_sets_of_readings_in_one_record_are_no_guess() -> None:
    lines = [
        json.dumps({"t_s": 0.05 * n, "raw": _as_list(n), "filtered": _as_list(n)}) for n in range(_SCANS)
    ]
    _not_silent("\n".join(lines))


def test_a_unit_that_changes_holds_for_its_records() -> None:
    lines = []
    for n in range(_SCANS):
        k, unit = (1000.0, "mV") if n > 3 else (1.0, "V")
        strips = [{c: v and (v if c == "id" else k * v) for c, v in row.items()} for row in _as_list(n)]
        lines.append(json.dumps({"t_s": 0.05 * n, "unit": unit, "strips": strips}))
    _assert_read("\n".join(lines))


@pytest.mark.parametrize("text", [_xml(True), _xml(False)])
def test_a_log_that_is_cut_is_not_read_in_silence(text: str) -> None:
    _not_silent(text[: int(0.7 * len(text))])


def test_a_list_of_times_for_each_strip_is_no_pair() -> None:
    series = [[_high(n, s) for n in range(_SCANS)] for s in range(_STRIPS)]
    sensor = ts.Sensor(construction="crs-m", strips=_STRIPS, pitch_mm=8.0, length_mm=60.0, vref_volt=5.0)
    found = propose(of_text(json.dumps({"rate_hz": 20, "strips": series})), sensor)
    assert np.stack([scan.values[:, 0] for scan in found.scans]) == pytest.approx(np.array(series).T)
