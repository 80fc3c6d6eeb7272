"""Lines that stand within others: of a program in a logger's records, and of an array in a field between quotes."""

from __future__ import annotations

import csv
import datetime as dt
import io
import json
import re
from collections.abc import Sequence
from typing import Any

from tacstrip.io.log_import.fields import clock_seconds, number_of
from tacstrip.io.log_import.literals import literal
from tacstrip.io.log_import.names import meaning
from tacstrip.io.log_import.records import STEADY

_TEXT = re.compile(r"_?(?:message|msg|log|line|text|body|payload|data|event)", re.IGNORECASE)
_TIME = re.compile(r"time|date|(?:\b|_)ts\b", re.IGNORECASE)
_OWN_TIME = re.compile(r"@?(?:time|timestamp|ts)", re.IGNORECASE)
_ARRAY = re.compile(r"\s*(?:\w+\()?[\[(].*[\])]\s*", re.DOTALL)
_BETWEEN_NUMBERS = re.compile(r"(?<=[\w.\])])\s+(?=[-+\w.\[(])")  # as NumPy prints an array
_NUMBER = re.compile(r"\d+(?:\.\d+)?")
# Seconds since 1970, or thousandths of one, or thousandths of these, ...
_EPOCH, _STEPS, _PARTS = 1e9, 3, 1000.0


def with_arrays_as_records(text: str) -> str:
    r"""Return a CSV text whose quoted fields hold arrays, also over several lines, as JSON records; another as it is.

    Each record stands where its row begins.

    Examples
    --------
    >>> print(with_arrays_as_records('t,h\n0,"[2.5\n nan]"\n1,"[2.6 2.3]"').replace("\n", "|"))
    |{"t": "0", "h": [2.5, null]}||{"t": "1", "h": [2.6, 2.3]}
    """
    mark = re.search(r"([,;\t])\"\s*(?:\w+\()?[\[(]", text)
    if not mark:
        return text
    rows: list[tuple[int, list[str]]] = []
    reader, last = csv.reader(io.StringIO(text), delimiter=mark[1]), 0
    try:
        for row in reader:
            rows.append((last, row))
            last = reader.line_num
    except csv.Error:  # a field of more characters than any array has
        return text
    (_, names), *rest = [(n, row) for n, row in rows if any(row)] or [(0, [])]
    names = [name or "index" for name in names]
    whole = [row for _, row in rest if len(row) == len(names)]
    arrays = [
        n
        for n in range(len(names))
        if sum(bool(_ARRAY.fullmatch(row[n])) for row in whole) > STEADY * len(rest)
    ]
    if not arrays or len({*names}) < len(names) or any(number_of(name) is not None for name in names):
        return text
    lines = [""] * last
    for n, row in rest:
        values = {i: literal(_BETWEEN_NUMBERS.sub(", ", row[i])) for i in arrays if i < len(row)}
        if len(row) != len(names) or any(not isinstance(v, list | tuple) for v in values.values()):
            lines[n] = " ".join(" ".join(row).split())  # damaged
            continue
        lines[n] = json.dumps({name: values.get(i, row[i]) for i, name in enumerate(names)})
    return "\n".join(lines)


def unwrapped(text: str) -> str:
    r"""Return the lines that records in JSON hold, each behind its time; another text as it is.

    Examples
    --------
    >>> log = '{"log": "S1 2.5 1.9\\n", "time": "2026-05-04T10:00:00.5Z"}\n{"log": "S1 2.4 1.8\\n", "time": "10:00:01"}'
    >>> print(unwrapped(log))
    2026-05-04T10:00:00.5Z S1 2.5 1.9
    10:00:01 S1 2.4 1.8
    >>> unwrapped('{"__TIMESTAMP": "1777889520500000", "MESSAGE": "S1=2.5/1.9"}\n' * 2).split("\n")[0]
    '2026-05-04 10:12:00.500000 S1=2.5/1.9'
    """
    if not text.lstrip().startswith(("{", "[")):
        return text
    records = _records(text)
    if not records:
        return text
    names = dict.fromkeys(k for r in records for k in r)
    of_text = [n for n in names if _TEXT.fullmatch(n) and _hold_lines([r.get(n) for r in records])]
    others = [n for n in names if n not in of_text and meaning(n).role in ("reading", "strip")]
    if len(of_text) != 1 or others:
        return text
    times = [n for n in names if _TIME.search(n) and all(_stamp(r.get(n)) for r in records)]
    times.sort(key=lambda n: _OWN_TIME.fullmatch(n) is None)  # before when it came to another place
    return "\n".join(
        " ".join([*(_stamp(r[n]) for n in times[:1]), str(r.get(of_text[0]) or "").strip()]) for r in records
    )


def _records(text: str) -> list[dict[str, Any]]:
    """Return the records of JSON, in a list or each in a line; [] where it is none."""
    try:
        values = json.loads(text)
    except (ValueError, RecursionError):
        try:
            values = [json.loads(line) for line in text.splitlines() if line.strip()]
        except (ValueError, RecursionError):
            return []
    if isinstance(values, dict):
        values = next((v for v in values.values() if isinstance(v, list)), [])
    return values if isinstance(values, list) and all(isinstance(v, dict) for v in values) else []


def _hold_lines(values: Sequence[Any]) -> bool:
    """Return whether nearly all values are lines with several numbers, and no times or JSON."""
    texts = [v for v in values if isinstance(v, str) and v.strip()]
    lines = [
        v
        for v in texts
        if len(_NUMBER.findall(v)) > 1 and v.strip()[0] not in "{[" and clock_seconds(v) is None
    ]
    return len(lines) > STEADY * len(values)


def _stamp(value: Any) -> str:
    """Return a time as it may stand before a line, a number since 1970 as a date; "" of what is none."""
    number = number_of(str(value))
    if number is None:
        return str(value) if clock_seconds(str(value)) is not None else ""
    for step in range(_STEPS + 1):
        if 1.0 <= number / _PARTS**step / _EPOCH < 10.0:
            moment = dt.datetime.fromtimestamp(number / _PARTS**step, dt.UTC)
            return f"{moment:%Y-%m-%d %H:%M:%S.%f}"
    return f"[{value}]"
