"""Lines as systems log them, as journald's JSON, Android's logcat and Apple's console, in one plain form."""

from __future__ import annotations

import json
import re
from datetime import UTC, datetime
from typing import Any

from tacstrip.io.log_import.fields import STAMP
from tacstrip.io.log_import.strays import numbered

_FORMS = {
    "logcat": re.compile(
        r"(?:\d\d-\d\d )?(?P<stamp>\d\d:\d\d:\d\d\.\d+)\s+\d+\s+\d+\s+[VDIWEF]\s+(?P<tag>[\w.-]+)\s*:\s(?P<rest>.*)"
    ),
    "console": re.compile(
        rf"(?P<stamp>{STAMP})\s+(?P<tag>[A-Za-z][\w.-]*)\[\d+:[\da-fA-F]+\]\s+(?P<rest>.*)"
    ),
}  # fmt: skip
_CATEGORY = re.compile(r"\[(?P<name>[A-Za-z][\w.:-]*)\]\s+")
_MESSAGE = ("MESSAGE", "message", "msg", "log", "line", "text", "payload")
_TIME = (
    "__REALTIME_TIMESTAMP",
    "_SOURCE_REALTIME_TIMESTAMP",
    "@timestamp",
    "timestamp",
    "time",
    "ts",
    "asctime",
)
_SENDER = ("SYSLOG_IDENTIFIER", "logger", "name", "tag", "unit", "container", "module")
_EPOCH_DIGITS = {10: 1.0, 13: 1e3, 16: 1e6, 19: 1e9}  # since 1970: of a second
_MOSTLY = 0.8  # of the lines


def of_system_log(text: str) -> str:
    r"""Return a system's log as lines of a time, a level, who wrote it, and what; another text as it is.

    Examples
    --------
    >>> print(of_system_log("11-20 10:15:03.000  48  50 D Skin: S1 h=5\n11-20 10:15:03.100  48  50 D Skin: S2 h=4\n"))
    10:15:03.000 INFO Skin: S1 h=5
    10:15:03.100 INFO Skin: S2 h=4
    <BLANKLINE>
    >>> of_system_log('{"ts": 1795166103.5, "msg": "S1 h=5"}\n{"ts": 1795166103.6, "msg": "S2 h=4"}').split("\n")[1]
    '2026-11-20 09:15:03.600000 INFO log: S2 h=4'
    """
    lines = [(n, line) for n, line in numbered(text) if line.strip()]
    made: dict[int, str] = {}
    for form in _FORMS.values():
        found = {n: m for n, line in lines if (m := form.fullmatch(line.rstrip()))}
        if len(found) >= max(2, _MOSTLY * len(lines)):
            made = {n: f"{m['stamp']} INFO {_named(m['tag'], m['rest'])}" for n, m in found.items()}
    if not made and lines and lines[0][1].lstrip().startswith("{"):
        records = {n: r for n, line in lines if (r := _record(line)) is not None}
        if len(records) >= max(2, _MOSTLY * len(lines)):
            made = _of_messages(records)
    return "\n".join(made.get(n, line) for n, line in numbered(text)) if made else text


def _named(tag: str, rest: str) -> str:
    """Return who wrote a line, with the category in brackets that it may begin with, and the line."""
    category = _CATEGORY.match(rest)
    return f"{tag}.{category['name']}: {rest[category.end() :]}" if category else f"{tag}: {rest}"


def _record(line: str) -> dict[str, Any] | None:
    try:
        value = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return value if isinstance(value, dict) else None


def _of_messages(records: dict[int, dict[str, Any]]) -> dict[int, str]:
    """Return the messages of records that hold no readings themselves, each behind its time and its sender."""
    kept = [
        k
        for k in _MESSAGE
        if sum(isinstance(r.get(k), str) for r in records.values()) >= _MOSTLY * len(records)
    ]
    times = [k for k in _TIME if all(_clock(r.get(k)) for r in records.values())]
    if not kept or not times:
        return {}
    numeric = sum(bool(re.search(r"[A-Za-z].*\d", str(r.get(kept[0])))) for r in records.values())
    if 2 * numeric < len(records):
        return {}
    senders = [k for k in _SENDER if all(isinstance(r.get(k), str) for r in records.values())]
    sender = senders[0] if senders else ""
    return {
        n: f"{_clock(r[times[0]])} INFO {_word(r.get(sender, 'log'))}: {r.get(kept[0], '')}"
        for n, r in records.items()
    }


def _word(name: Any) -> str:
    return re.sub(r"[^\w.-]", "_", str(name)) if re.match(r"[A-Za-z]", str(name)) else "log"


def _clock(value: Any) -> str:
    """Return a time of a record, in digits since 1970 or as a date and a time of day, as the latter; "": none."""
    if isinstance(value, str) and re.fullmatch(STAMP, value):
        return value
    found = re.fullmatch(r"(\d{10,19})(\.\d+)?", str(value)) if isinstance(value, str | int | float) else None
    if found is None or len(found[1]) not in _EPOCH_DIGITS:
        return ""
    seconds = float(str(value)) / _EPOCH_DIGITS[len(found[1])]
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%d %H:%M:%S.%f")
