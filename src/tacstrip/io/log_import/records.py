"""Logs whose lines name their values: JSON, and text such as "strip=3 vh=2.51V" or "H0:512 L0:300"."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from tacstrip.errors import ReadingError
from tacstrip.io.log_import.fields import says_nothing
from tacstrip.io.log_import.names import UNITS, meaning
from tacstrip.io.log_import.table import Table, flattened, of_records

STEADY = 0.8  # of the lines: a form that as many have is that of the log
_LABELS = frozenset({"time", "scan", "strip", "which"})
_FEW_KINDS = 0.5  # of the records: as many name the same values, or all do as they like
_COMMA = re.compile(r"(?<![\d,.:])\d+,\d+(?![\d,.])")
_WITH_TIME = re.compile(r"\d\s?(?:[mu]?s|min)\Z")
_SAMPLE = 200  # lines that tell whether all are of a kind
_UNIT = "|".join(sorted((re.escape(u) for u in UNITS if len(u) < 8), key=len, reverse=True))
_TOKEN = re.compile(
    rf"""(?P<clock>(?<![\w.])\d{{1,2}}:\d\d(?::\d\d(?:[.,]\d+)?|\.\d+)?(?!\d))
    | (?P<number>(?<![\w.])(?>[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?(?:\s?(?i:{_UNIT})(?![\w=:]))?))(?![\w])
    | (?P<word>[A-Za-zµ_\u00c0-\u024f][\w/.%-]*(?:\[\d+\])*(?:\s?[\[(][^\])\d]{{0,12}}[\])](?=\s*[:=]))?)
    | (?P<sign>[:=])
    | (?P<nothing>-{{1,9}}(?=[\s,;|]|$))
    | (?P<comma>(?<=\d),(?=\d))""",
    re.VERBOSE,
)


@dataclass(frozen=True)
class Item:
    """A name in a line, with the values that follow it."""

    name: str
    values: tuple[str, ...]
    told: bool  # by a colon or an equals sign


def items(line: str) -> list[Item]:
    """Return what a line names.

    Examples
    --------
    >>> [(i.name, i.values) for i in items("Strip 3: H=512 L=n/a")]
    [('Strip', ('3',)), ('H', ('512',)), ('L', ('n/a',))]
    """
    if dressed := re.match(r"\s*[*#=~_<>-]{2,}\s*(?=\w)", line):  # as in "--- scan 3 ---"
        line = re.sub(r"[\s*#=~_<>-]+$", "", line[dressed.end() :])
    if re.search(r"\d", _TOKEN.sub("", line)):  # not all of it would be read
        return []
    found: list[Item] = []
    words: list[str] = []
    end = 0  # of the last word
    open_name = False  # values of the last name may follow

    def close(name: str, told: bool) -> None:
        nonlocal open_name
        found.append(Item(name, (), told))
        words.clear()
        open_name = True

    for token in _TOKEN.finditer(line):
        kind, text = str(token.lastgroup), token.group().strip()
        if kind == "word" and (not open_name or not says_nothing(text)):
            named = line[token.end() :].lstrip()[:1] in (":", "=") and token.end() < len(line)
            if open_name and not named and text.casefold() in UNITS and found and found[-1].values:
                continue  # a unit apart from its number
            words.append(text)
            end = token.end()
            open_name = False
        elif kind == "sign":
            if words:
                close(" ".join(words[-3:]), told=True)
            elif found and found[-1].name and len(found[-1].values) == 1 and not found[-1].told:
                found[-1] = replace(found[-1], told=True)  # as in "strip 3: 512 300"
        elif kind != "comma":
            if words:  # as in "strip 3" or "S3 H 512"
                strips = [
                    m.strip for w in words[:-1] if (m := meaning(w)).role == "reading" and not m.channel
                ]
                found += [Item("strip", (str(n),), told=False) for n in strips if n is not None]
                last_word = meaning(words[-1])
                beside = line[end : token.start()].isspace() and last_word.strip is None
                implied = last_word.role in _LABELS or (last_word.channel and beside)
                close(words[-1] if implied else "", told=False)
            elif not open_name:
                found.append(Item("time" if _WITH_TIME.search(text) else "", (), told=False))
            last = found[-1]
            found[-1] = replace(last, values=(*last.values, text))
            if not last.told:
                open_name = False
    return [i for i in found if i.values]


def is_label(found: Sequence[Item]) -> bool:
    """Return whether a line only says to which scan, time or strip the lines below it belong."""
    roles = {meaning(i.name).role for i in found}
    return bool(found) and roles <= _LABELS and all(len(i.values) == 1 for i in found)


def named_values(lines: list[tuple[int, str]]) -> Table | None:
    """Return lines that name their values as a table; None where the log is none of that kind."""
    if len(lines) > _SAMPLE and named_values(lines[:_SAMPLE]) is None:
        return None
    parsed = [(i, items(line)) for i, line in lines]
    said = [p for (_, p), (_, line) in zip(parsed, lines, strict=True) if re.search(r"\d", line)]
    told = [p for p in said if is_label(p) or any(i.told for i in p) or _pairs(p)]
    if len(told) < max(STEADY * len(said), 1) or all(is_label(p) for p in told):
        return None
    pointed = _with_points(lines)
    parsed = parsed if pointed is lines else [(i, items(line)) for i, line in pointed]
    return _gathered(parsed, dict(pointed))


def _pairs(found: Sequence[Item]) -> bool:
    """Return whether a line is of words and numbers in turn, such as "S3 H 512 L 300"."""
    return all(i.name for i in found) and any(meaning(i.name).channel for i in found)


def _with_points(lines: list[tuple[int, str]]) -> list[tuple[int, str]]:
    """Return lines with decimal points where they have decimal commas; `ReadingError` where these may be lists."""
    pairs = [p for _, line in lines for p in _COMMA.findall(line)]
    if not pairs or any(re.search(r"\d\.\d|\d,\d+,\d|[,;] ?[A-Za-z]", line) for _, line in lines):
        return lines
    sizes: dict[str, set[int]] = {}  # with how many values each name stands
    for _, line in lines:
        for item in items(line):
            sizes.setdefault(item.name, set()).add(len(item.values))
    places = {len(p.partition(",")[2]) for p in pairs}
    alike = len(places) == 1 and (max(places) <= 2 or all(p.find(",") <= 2 for p in pairs))
    single = alike and any(found == {1, 2} for found in sizes.values())
    if not (single or any(re.search(r"\A0,|,0\d", p) for p in pairs)):
        raise ReadingError(
            f"{pairs[0]!r}: a decimal comma, or two values? Write such numbers with a decimal point"
        )
    return [(i, re.sub(r"(?<=\d),(?=\d)", ".", line)) for i, line in lines]


def _fields(found: Sequence[Item]) -> dict[str, str]:
    """Return a line's values by name; those without a name are counted."""
    fields: dict[str, str] = {}
    unnamed = 0
    for item in found:
        name = item.name
        if not name:
            unnamed += 1
            name = f"value {unnamed}"
        if len(item.values) == 1:
            fields[name] = item.values[0]
        else:
            fields |= {f"{name}[{n}]": value for n, value in enumerate(item.values)}
    return fields


def _gathered(parsed: list[tuple[int, list[Item]]], texts: Mapping[int, str]) -> Table | None:
    """Gather lines to records: labels hold for the lines below, and a name that comes again begins the next record."""
    records: list[dict[str, str]] = []
    lines: list[int] = []
    labels: dict[str, str] = {}
    record: dict[str, str] = {}
    start = 0
    strange = []

    def flush() -> None:
        nonlocal record
        if record:
            records.append(labels | record)
            lines.append(start)
        record = {}

    for number, found in parsed:
        if not any(i.told or i.name for i in found):
            strange += [number] * bool(found or re.search(r"\d", texts[number]))
            continue
        fields = _fields(found)
        told = {name: f for name, f in fields.items() if meaning(name).role in _LABELS}
        if told or any(name in record for name in fields):
            flush()
        labels = labels | told
        if rest := {name: f for name, f in fields.items() if name not in told}:
            start = start if record else number
            record |= rest
    flush()
    if not records:
        return None
    kinds = Counter(frozenset(r) for r in records)
    usual, many = kinds.most_common(1)[0]
    if many >= _FEW_KINDS * len(records):
        strange += [i for i, r in zip(lines, records, strict=True) if frozenset(r) != usual]
        kept = [(i, r) for i, r in zip(lines, records, strict=True) if frozenset(r) == usual]
        lines, records = [i for i, _ in kept], [r for _, r in kept]
    first = min(lines)
    above = [texts[i] for i in strange if i < first]
    strange = [i for i in strange if i > first]
    told = [f"{len(above)} line(s) above passed over"] if above else []
    table = of_records(records, lines, ".", "each line names its values", *told)
    return replace(table, broken=tuple(sorted(strange)), preamble=tuple(above))


def of_json(text: str, path: str | Path) -> Table | None:
    """Return JSON as a table: lines of objects, an array of them, or an object of columns; None where it is no JSON."""
    if text.lstrip()[:1] not in ("{", "["):
        return None
    plain = re.sub(r"(?<=[:\[, ])-?(?:NaN|Infinity)\b", "null", text)
    found: list[tuple[int, Any]] = []
    broken = []
    try:
        whole = json.loads(plain)
    except RecursionError:
        raise ReadingError(f"{path}: JSON of too many levels") from None
    except ValueError:
        for number, line in enumerate(plain.splitlines(), 1):
            try:
                found += [(number, _loaded(line))] if line.strip() else []
            except (ValueError, RecursionError):
                broken.append(number)
        if not any(isinstance(value, dict) for _, value in found) or len(found) < len(broken):
            return None
    else:
        found = [(n, r) for n, r in enumerate(_rows_of(whole), 1)]
        if found and all(isinstance(r, list) for _, r in found) and len({len(r) for _, r in found}) == 1:
            rows = [list(flattened("", r).values()) for _, r in found]
            names = tuple(f"column {n + 1}" for n in range(len(rows[0])))
            if len({len(r) for r in rows}) == 1:
                return Table(names, rows, [n for n, _ in found], named=False, remarks=("rows in JSON",))
        if not any(isinstance(r, dict) for _, r in found):
            return None
    records, lines = [], []
    for number, value in found:
        for record in _exploded(value) if isinstance(value, dict) else []:
            records.append(record)
            lines.append(number)
    if not records:
        raise ReadingError(f"{path}: JSON without readings")
    return replace(of_records(records, lines, ".", "records in JSON"), broken=tuple(broken))


def _loaded(line: str) -> Any:
    """Return a line of JSON, or of Python's form."""
    try:
        return json.loads(line)
    except ValueError:
        return json.loads(re.sub(r"\bNone\b|\bnan\b", "null", line.replace("'", '"')))


def _rows_of(value: Any) -> list[Any]:
    """Return a JSON value as records: itself, the list in it, or its columns turned."""
    if isinstance(value, list):
        return value
    lists = {k: v for k, v in value.items() if isinstance(v, list)} if isinstance(value, dict) else {}
    tables = [v for v in lists.values() if v and all(isinstance(r, dict) for r in v)]
    if len(tables) == 1 and len(lists) == 1 and len(tables[0]) > 1:
        return tables[0]
    if isinstance(value, dict) and any(
        k not in lists and meaning(k).role in ("time", "scan") and not isinstance(v, dict)
        for k, v in value.items()
    ):
        return [value]  # one scan
    columns = lists
    if isinstance(value, dict) and len(value) > 1 and all(isinstance(v, dict) for v in value.values()):
        columns = {k: list(v.values()) for k, v in value.items()}  # as pandas writes it
    if len(columns) > 1 and len({len(v) for v in columns.values()}) == 1:
        return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    return [value]


def _exploded(record: Mapping[str, Any]) -> list[dict[str, str]]:
    """Return a record as rows: one, or one for each element of the list of records that is in it."""
    inner = [
        k for k, v in record.items() if isinstance(v, list) and v and all(isinstance(e, dict) for e in v)
    ]
    if len(inner) != 1:
        return [flattened("", dict(record))]
    outer = flattened("", {k: v for k, v in record.items() if k != inner[0]})
    return [outer | flattened(inner[0], element) for element in record[inner[0]]]
