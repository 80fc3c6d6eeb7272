"""Records and lists of JSON, XML, YAML or Python as a table."""

from __future__ import annotations

import itertools
import json
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from tacstrip.errors import ReadingError
from tacstrip.io.log_import.channel_names import tell_strips
from tacstrip.io.log_import.fields import is_prose
from tacstrip.io.log_import.gathered import touched_vary
from tacstrip.io.log_import.literals import literal, literals
from tacstrip.io.log_import.names import meaning
from tacstrip.io.log_import.nested import regular
from tacstrip.io.log_import.strays import numbered
from tacstrip.io.log_import.table import CLOCK, Table, flattened, of_records, said_above
from tacstrip.io.log_import.xml_records import of_xml

# Of a record that describes a column: what its name and its unit are called.
_DESCRIBED = (("name", "label", "channel", "field", "key", "id"), ("unit", "units"))
_WORD, _FEW_WORDS = re.compile(r"(?<!\S)[^\W\d_]{2,}[.,;:]?(?!\S)"), 2  # of a sentence; of no more than these
_FEW_ROWS = 5  # of the longest series: fewer pairs may be of strips
_MOST_KEYS = 64  # of a strip
_TUPLES = re.compile(r"(?m)^\(.*,\s*\(.*\)\)\s*$")  # within each other


def of_literals(text: str, path: str | Path) -> Table | None:
    """Return JSON or what Python prints as a table: lines of objects or lists, an array of them, an object of columns.

    None where it is none of these.
    """
    inner, comments = of_xml(text)
    if inner and (table := of_values(inner, path, "records in XML")) is not None:
        return replace(table, preamble=(*comments, *table.preamble))
    if "[" not in text and "{" not in text and not _TUPLES.search(text):
        return None
    found, broken = _json(text, path) if text.lstrip()[:1] in ("{", "[") else ([], [])
    around: list[tuple[int, str]] = []
    if found is None or not any(isinstance(value, dict | list) for _, value in found):
        found, around = literals(text)
        broken = [i for i, line in around if re.search(r"\d", line) and not is_prose(line)]
    else:
        texts = dict(numbered(text))
        broken = [i for i in broken if not (is_prose(texts[i]) and len(_WORD.findall(texts[i])) > _FEW_WORDS)]
    found, messages = _without_messages(found)
    if len(found) == 1 and isinstance(found[0][1], dict):
        table = of_values(found[0][1], path)
    else:
        table = of_values(found, path, numbered=True)
    if table is None:
        return None
    above = [line for i, line in around if found and i < found[0][0]]
    if messages:
        above += [line for row in messages for line in said_above(row)]
        said = f"{len(messages)} object(s) that share no name with the others are taken for messages"
        table = replace(table, remarks=(*table.remarks, said))
    quotes = {i: line for i, line in around if i in broken}
    return replace(table, broken=tuple(broken), quotes=quotes, preamble=(*above, *table.preamble))


def of_values(
    value: Any, path: str | Path, told: str = "records in JSON", *, numbered: bool = False
) -> Table | None:
    """Return records, lists or an object of columns as a table; None where they are none. Perhaps with their lines."""
    if numbered:
        rows_, above = regular([row for _, row in value])
        value = [(i, row) for (i, _), row in zip(value, rows_, strict=True)]
    else:
        value, above = regular(value)
    found = value if numbered else list(enumerate(_rows_of(_named_within(value) or value), 1))
    if not numbered and isinstance(value, dict) and found[0][1] is not value:
        above += said_above({k: v for k, v in value.items() if not isinstance(v, list)})
    rows = [(i, row) for i, row in found if isinstance(row, list | tuple)]
    if rows and len(rows) == len(found):
        table = _of_lists(rows)
        return table and replace(table, preamble=above)
    found, same = _without_descriptions(_with_untouched(found))
    above += same
    records, lines = [], []
    empty: set[int] = set()
    exploded = [(i, row, _exploded(row)) for i, row in found if isinstance(row, dict)]
    kinds = Counter(key for _, row, _ in exploded if (key := _list_within(row)))
    inner = kinds.most_common(1)[0][0] if kinds else ""
    names = {n: "" for _, _, many in exploded for r in many for n in r if n.startswith(f"{inner}.")}
    strip = [n for n in names if meaning(n).role == "strip"]
    shown = next((r[strip[0]] for _, _, many in exploded for r in many if strip and strip[0] in r), "")
    beside = Counter(frozenset({*_unfolded("", row)} - {inner}) for _, row, many in exploded if len(many) > 1)
    usual = beside.most_common(1)[0][0] if beside else frozenset()
    for number, row, many in exploded:
        parts = _unfolded("", row)
        void = parts.get(inner) == [] or (inner not in parts and usual and {*parts} == usual)
        if inner and shown and void:  # nothing touches in it
            parts.pop(inner, None)
            many = [flattened("", parts) | names | {strip[0]: shown}]
            empty.add(number)
        records += many
        lines += [number] * len(many)
    if not records:
        return None
    varied = touched_vary(records) > 1 and all(all(r.values()) for r in records)
    remarks = [f"{len(empty)} scan(s) with an empty list: nothing touches in them"] if empty else []
    table = of_records(records, lines, ".", told, *remarks)
    return replace(
        table, names=_described(table.names, above), preamble=above, varied=varied, empty=frozenset(empty)
    )


def _with_untouched(found: Sequence[tuple[int, Any]]) -> list[tuple[int, Any]]:
    """Return records with a record for each null in a list of these, which has the number of the strip in its place.

    Examples
    --------
    >>> _with_untouched([(1, {"strips": [None, {"id": 2, "h": 5}, {"id": 3, "h": 5}]})])[0][1]["strips"][:2]
    [{'id': 1, 'h': None}, {'id': 2, 'h': 5}]
    >>> _with_untouched([(1, {"strips": [None, {"h": 5}]})])
    [(1, {'strips': [{'h': None, 'strip': 0}, {'h': 5, 'strip': 1}]})]
    """
    lists = [
        (k, v) for _, row in found if isinstance(row, dict) for k, v in row.items()
        if isinstance(v, list) and v and all(e is None or isinstance(e, dict) for e in v)
    ]  # fmt: skip
    names = {k for k, _ in lists}
    there = [(n, e) for _, v in lists for n, e in enumerate(v) if e is not None]
    if len(names) != 1 or not there or all(e is not None for _, v in lists for e in v):
        return [*found]
    keys = dict.fromkeys(key for _, e in there for key in e)
    if len(keys) > _MOST_KEYS:
        return [*found]
    shifts = {key: {e[key] - n if isinstance(e.get(key), int) else None for n, e in there} for key in keys}
    counts = {key: shift for key, (shift, *others) in shifts.items() if shift is not None and not others}
    several = len({n for n, _ in there}) > 1
    name, shift = next(iter(counts.items()), ("strip", 0)) if several else ("strip", 0)
    empty = dict.fromkeys(keys)

    def whole(place: int, element: Any) -> Any:
        return (element or empty) | {name: place + shift}

    return [
        (i, {k: [whole(n, e) for n, e in enumerate(v)] if k in names else v for k, v in row.items()})
        if isinstance(row, dict) else (i, row)
        for i, row in found
    ]  # fmt: skip


def _without_descriptions(found: Sequence[tuple[int, Any]]) -> tuple[list[tuple[int, Any]], tuple[str, ...]]:
    """Return records without lists of records that are the same in each, as a message's layout; and what these say.

    Examples
    --------
    >>> _without_descriptions([(n, {"dim": [{"label": "strip"}], "data": [n, 5]}) for n in (1, 2)])
    ([(1, {'data': [1, 5]}), (2, {'data': [2, 5]})], ('label: strip',))
    """
    rows = [row for _, row in found if isinstance(row, dict)]
    parts = [_unfolded("", row) for row in rows]
    same = [
        k for k, v in (parts[0] if len(rows) > 1 else {}).items()
        if isinstance(v, list) and v and all(isinstance(e, dict) and _describes(e) for e in v)
        and all(k in p and p[k] == v for p in parts)
    ]  # fmt: skip
    # A sensor that nothing touches lists the same in each record, too: then no other list holds numbers.
    lists = [v for p in parts for v in p.values() if isinstance(v, list)]
    if not same or not any(isinstance(e, int | float | str) for v in lists for e in v):
        return [*found], ()
    kept: list[tuple[int, Any]] = [
        (i, {k: v for k, v in _unfolded("", row).items() if k not in same} if isinstance(row, dict) else row)
        for i, row in found
    ]
    return kept, tuple(line for k in same for element in parts[0][k] for line in said_above(element))


def _describes(record: Mapping[str, Any]) -> bool:
    """Return whether a record holds no reading that never changes: no decimal, and no name of one."""
    return not any(
        isinstance(v, float | list | dict) or meaning(k).role in ("reading", "strip")
        for k, v in record.items()
    )


def _without_messages(
    found: Sequence[tuple[int, Any]],
) -> tuple[list[tuple[int, Any]], list[dict[str, Any]]]:
    """Return the values without objects that share no key but the clock with most lines; and these objects.

    Examples
    --------
    >>> _without_messages([(1, {"info": "12 bit"}), (2, {"t": 0, "h": [5]}), (3, {"t": 1, "h": [6]})])
    ([(2, {'t': 0, 'h': [5]}), (3, {'t': 1, 'h': [6]})], [{'info': '12 bit'}])
    """
    forms = Counter(tuple(row) for _, row in found if isinstance(row, dict))
    form, many = forms.most_common(1)[0] if forms else ((), 0)
    if 2 * many <= len(found):
        return [*found], []
    apart = [i for i, row in found if isinstance(row, dict) and not {*row} & {*form} - {CLOCK}]
    kept = [(i, row) for i, row in found if i not in apart]
    return kept, [row for i, row in found if i in apart]


def _described(names: tuple[str, ...], above: Sequence[str]) -> tuple[str, ...]:
    """Return names with what stands beside them above in their place, if that tells strips and ends.

    Examples
    --------
    >>> _described(("t", "f1", "f2", "f3", "f4"), ("f1: 1 high", "f2: 1 low", "f3: 2 high", "f4: 2 low"))
    ('t', '1 high', '1 low', '2 high', '2 low')
    """
    said = {name: what for name, _, what in (line.partition(": ") for line in above) if name in names}
    said = {name: what for name, what in said.items() if meaning(what).strip is not None}
    return tuple(said.get(n, n) for n in names) if tell_strips([*said.values()]) else names


def _of_lists(rows: Sequence[tuple[int, Any]]) -> Table | None:
    """Return lists of lists as a table without names, in the order of their places; None where the log is no table."""
    table = of_records([flattened("", list(value)) for _, value in rows], [i for i, _ in rows])
    order = sorted(table.names, key=lambda key: [int(n) for n in re.findall(r"\d+", key)])
    if len(order) < 2 or any(re.search(r"[^\[\]\d]", key) for key in order):
        return None
    fields = [list(row) for row in zip(*(table.column(key) for key in order), strict=True)]
    names = tuple(f"column {n + 1}" for n in range(len(order)))
    return Table(names, fields, table.lines, named=False, remarks=("rows of lists",))


def _json(text: str, path: str | Path) -> tuple[list[tuple[int, Any]] | None, list[int]]:
    """Return the values of JSON, whole or in lines, with their lines, and the broken lines; None where it is none."""
    plain = re.sub(r"(?<=[:\[, ])-?(?:NaN|Infinity)\b", "null", text)
    found: list[tuple[int, Any]] = []
    broken = []
    try:
        whole = json.loads(plain)
    except RecursionError:
        raise ReadingError(f"{path}: JSON of too many levels") from None
    except ValueError:
        if isinstance(whole := literal(text), list | tuple) and len(whole) > 1:
            return list(enumerate(whole, 1)), []
        for number, line in enumerate(plain.splitlines(), 1):
            try:
                found += [(number, json.loads(line.rstrip().rstrip(",")))] if line.strip() else []
            except (ValueError, RecursionError):
                value = literal(line)
                if value is None:
                    broken.append(number)
                else:
                    found.append((number, value))
        if not any(isinstance(value, dict) for _, value in found) or len(found) < len(broken):
            return None, []
        if broken and broken[0] < found[0][0] and not plain.lstrip().startswith("{"):
            del broken[0]  # the log begins in the middle of it
        return found, broken
    if isinstance(whole, dict):
        return [(1, whole)], []
    rows = list(enumerate(_rows_of(whole), 1))
    if rows and not any(isinstance(r, dict | list) for _, r in rows):
        return None, []
    return rows, []


def _rows_of(value: Any) -> list[Any]:
    """Return a JSON value as records: itself, the list in it, or its columns turned."""
    if isinstance(value, list):
        return value
    if columns := columns_within(value):
        return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    value = _with_names(value) if isinstance(value, dict) else value
    parts = _unfolded("", value) if isinstance(value, dict) else {}
    tables = [
        v
        for v in parts.values()
        if isinstance(v, list) and len(v) > 1 and all(isinstance(r, dict) for r in v)
    ]
    if len(tables) == 1 == sum(isinstance(v, list) for v in parts.values()) and not _series_within(tables[0]):
        return tables[0]
    lists = {k: v for k, v in value.items() if isinstance(v, list)} if isinstance(value, dict) else {}
    tables = [v for v in lists.values() if v and all(isinstance(r, dict) for r in v)]
    if len(tables) == 1 and len(lists) == 1 and len(tables[0]) > 1:
        return tables[0]
    if isinstance(value, dict) and any(
        k not in lists and meaning(k).role in ("time", "scan") and not isinstance(v, dict)
        for k, v in value.items()
    ):
        return [value]  # one scan
    rows = [(k, v) for k, v in lists.items() if len(v) > 1 and all(isinstance(r, list) for r in v)]
    if len(rows) == len(lists) == 1 and len({len(r) for r in rows[0][1]}) == 1:  # one matrix
        key, matrix = rows[0]
        return [list(c) for c in zip(*matrix, strict=True)] if meaning(key).role == "strip" else matrix
    columns = lists
    if isinstance(value, dict) and len(value) > 1 and all(isinstance(v, dict) for v in value.values()):
        columns = {k: list(v.values()) for k, v in value.items()}  # as pandas writes it
    if len(columns) > 1 and len({len(v) for v in columns.values()}) == 1:
        return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    return [value]


def columns_within(value: Any) -> dict[str, list[Any]]:
    """Return the lists of numbers in an object, however deep, if there are several, all as long; else none.

    Examples
    --------
    >>> columns_within({"fs": 20, "data": {"t": [0, 1], "s0": {"hi": [2.5, None], "lo": [1.9, None]}}})
    {'data.t': [0, 1], 'data.s0.hi': [2.5, None], 'data.s0.lo': [1.9, None]}
    """
    parts = _unfolded("", value) if isinstance(value, dict) else {}
    lists = {k: v for k, v in parts.items() if isinstance(v, list) and v}
    plain = not any(isinstance(e, dict | list | str) for v in lists.values() for e in v)
    return lists if plain and len(lists) > 2 and len({*map(len, lists.values())}) == 1 else {}


def _with_names(record: Mapping[str, Any]) -> dict[str, Any]:
    """Return a record with records in place of lists of as many values as a list of names beside them has.

    A name may be of several levels, or a record with a unit; what stands beside has a value of each.

    Examples
    --------
    >>> _with_names({"columns": ["strip", "h"], "data": [[0, 2.5], [1, 2.4]]})
    {'entry': [{'strip': 0, 'h': 2.5}, {'strip': 1, 'h': 2.4}]}
    >>> _with_names({"columns": [["h", 0], ["h", 1], ["h", 2]], "t": [0, 1], "data": [[5, 4, 3], [4, 3, 2]]})
    {'entry': [{'t': 0, 'h 0': 5, 'h 1': 4, 'h 2': 3}, {'t': 1, 'h 0': 4, 'h 1': 3, 'h 2': 2}]}
    """
    lists = {k: v for k, v in record.items() if isinstance(v, list) and v}
    named = {k: names for k, v in lists.items() if len(v) > 1 and all(names := [_name(name) for name in v])}
    key, names = next(iter(named.items()), ("", []))
    rows = [
        k for k, v in lists.items()
        if k != key and all(isinstance(row, list) and len(row) == len(names) for row in v)
    ]  # fmt: skip
    if len(named) != 1 or len(rows) != 1 or len({*names}) < len(names):
        return dict(record)
    many = len(lists[rows[0]])
    beside = {
        k: v for k, v in lists.items() if len(v) == many and k not in (key, rows[0])
        and not any(isinstance(e, list | dict) for e in v)
    }  # fmt: skip
    others = {k: v for k, v in record.items() if k not in (key, rows[0], *beside)}
    return others | {
        "entry": [
            {k: v[n] for k, v in beside.items()} | dict(zip(names, row, strict=True))
            for n, row in enumerate(lists[rows[0]])
        ]
    }


def _named_within(value: Any) -> dict[str, Any] | None:
    """Return the innermost record, however deep, in which a list of names stands beside the rows that it names."""
    if not isinstance(value, dict):
        return None
    inner = (found for v in value.values() if (found := _named_within(v)) is not None)
    return next(inner, value if _with_names(value) != value else None)


def _name(value: Any) -> str:
    """Return a name, also of several levels, or of a record with its unit; "" of what is none.

    Examples
    --------
    >>> _name("h"), _name(["h", 0]), _name({"name": "h0", "units": "V"}), _name(5)
    ('h', 'h 0', 'h0 [V]', '')
    """
    if isinstance(value, dict):
        name, unit = (next((v for k, v in value.items() if k.casefold() in keys), "") for keys in _DESCRIBED)
        said = isinstance(name, str) and isinstance(unit, str)
        said &= not any(isinstance(v, float | list | dict) for v in value.values())  # else it holds a reading
        return (f"{name} [{unit}]" if unit else name) if said and name else ""
    if isinstance(value, list) and value and isinstance(value[0], str):
        return " ".join(map(str, value)) if all(isinstance(v, str | int) for v in value) else ""
    return value if isinstance(value, str) else ""


def _exploded(record: Mapping[str, Any]) -> list[dict[str, str]]:
    """Return a record as rows: one, or one for each element of the only list of records that is in it."""
    record = _with_names(record)
    inner, parts = _list_within(record), _unfolded("", record)
    if not inner:
        return [flattened("", dict(record))]
    outer = flattened("", {k: v for k, v in parts.items() if k != inner})
    if key := _series_within(parts[inner]):
        labels = [(element, {k: v for k, v in element.items() if k != key}) for element in parts[inner]]
        rows = [
            (time, outer | flattened("", said | {"time": time, "value": value}))
            for element, said in labels
            for time, value in element[key]
        ]
        return [row for _, row in sorted(rows, key=lambda r: r[0])]
    return [outer | flattened(inner, element) for element in parts[inner]]


def _series_within(records: Sequence[Mapping[str, Any]]) -> str:
    """Return the name of what each of several records has as a list of times that rise, with a value each; or "".

    Examples
    --------
    >>> _series_within([{"strip": s, "values": [[t, str(0.1 * t)] for t in range(9)]} for s in (1, 2)])
    'values'
    """
    keys = {k for r in records for k, v in r.items() if isinstance(v, list)}
    lists: list[Any] = [r.get(k) for r in records for k in keys]
    series = len(records) > 1 == len(keys) and all(map(_is_series, lists))
    return keys.pop() if series and max(map(len, lists)) >= _FEW_ROWS else ""


def _is_series(rows: Any) -> bool:
    if not isinstance(rows, list) or not all(isinstance(r, list) and len(r) == 2 for r in rows):
        return False
    times: list[Any] = [r[0] for r in rows]
    return all(isinstance(t, int | float) for t in times) and all(a < b for a, b in itertools.pairwise(times))


def _list_within(record: Mapping[str, Any]) -> str:
    """Return the name of the only list of records that is in a record; "" where there is none, or several."""
    parts = _unfolded("", _with_names(record))
    inner = [k for k, v in parts.items() if isinstance(v, list) and v and all(isinstance(e, dict) for e in v)]
    return inner[0] if len(inner) == 1 else ""


def _unfolded(name: str, record: Mapping[str, Any]) -> dict[str, Any]:
    """Return a record with the parts of the records in it beside its own."""
    parts: dict[str, Any] = {}
    for key, value in record.items():
        key = f"{name}.{key}" if name else str(key)
        parts |= _unfolded(key, value) if isinstance(value, dict) and value else {key: value}
    return parts
