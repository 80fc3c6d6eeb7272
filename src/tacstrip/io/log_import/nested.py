"""Values within each other in one regular form: maps by identifiers as lists, strips by number, nothing around them."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from tacstrip.errors import ReadingError
from tacstrip.io.log_import.fields import clock_seconds, number_of
from tacstrip.io.log_import.names import meaning
from tacstrip.io.log_import.table import TOO_DEEP

_FEW = 3  # records, or names of strips
_MOST_OF_STRIP = 6  # values of a strip: its ends, and what may stand beside them
_EPOCH = 1e9  # a number of a time since 1970 is larger, whatever its unit
_NAMED = ("time", "scan", "strip", "reading")


def regular(value: Any) -> tuple[Any, tuple[str, ...]]:
    """Return a value in regular form, and what it says of the strips' numbers, as lines above it.

    Texts that hold JSON are what they hold. Records by identifiers are a list of them. Strips with letters, or with
    names that a list tells, have numbers from 0. What is empty throughout, and has neither a name of a reading nor one
    that is another's but for its number, is left out, and so is a record's only inner record that holds all that has
    such a name.

    Raises
    ------
    ReadingError
        Of more levels than can be followed.

    Examples
    --------
    >>> regular({"log": {"-Nx1": {"t": 0, "h": 5}, "-Nx2": {"t": 1, "h": 5}, "-Nx3": {"t": 2, "h": 6}}})[0]
    {'log': [{'t': 0, 'h': 5}, {'t': 1, 'h': 5}, {'t': 2, 'h': 6}]}
    >>> regular([{"t": 0, "s": {"A": {"h": 5}, "C": {"h": 5}}}, {"t": 1, "s": {"B": {"h": 6}}}])[1]
    ('strips from 0: A',)
    >>> regular([{"id": 7, "field1": None, "field2": "2.5"}, {"id": 8, "field1": None, "field2": "2.6"}])[0][0]
    {'id': 7, 'field1': None, 'field2': '2.5'}
    >>> regular([{"host": "a", "doc": '{"t": 0, "h": 5}'}, {"host": "b", "doc": '{"t": 1, "h": 6}'}])[0]
    [{'host': 'a', 't': 0, 'h': 5}, {'host': 'b', 't': 1, 'h': 6}]
    """
    try:
        value = _unpacked(value)
        form = _Form([names for names in _lists_of(value) if _name_strips(names)])
        return form.of([value])[0], tuple(form.told)
    except RecursionError:
        raise ReadingError(TOO_DEEP) from None


def _unpacked(value: Any) -> Any:
    """Return a value with what texts in JSON hold in their place."""
    if isinstance(value, str) and value.lstrip()[:1] in ("{", "["):
        try:
            return _unpacked(json.loads(value))
        except (ValueError, RecursionError):
            return value
    if isinstance(value, dict):
        return {k: _unpacked(v) for k, v in value.items()}
    return [_unpacked(v) for v in value] if isinstance(value, list) else value


def _lists_of(value: Any) -> Iterator[list[Any]]:
    if isinstance(value, list) and value and not isinstance(value[0], list | dict):
        yield value
    elif isinstance(value, dict | list):
        for inner in value.values() if isinstance(value, dict) else value:
            yield from _lists_of(inner)


def _name_strips(names: Sequence[Any]) -> bool:
    """Return whether a list is of different names, none of them known, or of letters from the first on."""
    if len(names) < _FEW or not all(isinstance(n, str) for n in names) or len({*names}) < len(names):
        return False
    alphabet = [chr(ord("a") + n) for n in range(len(names))]
    return [n.casefold() for n in names] == alphabet or not any(meaning(n).role or len(n) < 2 for n in names)


def _are_ends(value: Any) -> bool:
    """Return whether a value may be of a strip: its ends in a record or a list, or nothing."""
    parts = [*value.values()] if isinstance(value, dict) else value if isinstance(value, list) else []
    plain = not any(isinstance(p, dict | list) for p in parts)
    return value is None or (isinstance(value, dict | list) and plain and len(parts) <= _MOST_OF_STRIP)


@dataclass
class _Form:
    """What brings all values of one place, those with the same names around them, into regular form."""

    lists: list[list[str]]  # names, in their order
    told: list[str] = field(default_factory=list)

    def of(self, group: Sequence[Any]) -> list[Any]:
        """Return the values of one place in regular form."""
        made = [*group]
        lists = {
            n: v
            for n, v in enumerate(group)
            if isinstance(v, list) and any(isinstance(e, dict | list) for e in v)
        }
        elements = iter(self.of([e for v in lists.values() for e in v]) if lists else ())
        for n, v in lists.items():
            made[n] = [next(elements) for _ in v]
        records = {n: v for n, v in enumerate(group) if isinstance(v, dict)}
        for n, v in zip(records, self._of_records([*records.values()]) if records else (), strict=True):
            made[n] = v
        return made

    def _of_records(self, records: list[dict[str, Any]]) -> list[Any]:
        names = list(dict.fromkeys(str(k) for r in records for k in r))
        inner = [v for r in records for v in r.values()]
        if _are_identifiers(names, inner):
            parts = iter(self.of(inner))
            return [[_with_key(str(key), next(parts)) for key in r] for r in records]
        if numbers := self._numbers(names, inner):
            parts = iter(self.of(inner))
            return [{f"strip{numbers[str(key)]}": next(parts) for key in r} for r in records]
        columns = {
            name: self.of([r[name] for r in records if name in r])
            for name in dict.fromkeys(k for r in records for k in r)
        }
        filled = {_without_number(k) for k, v in columns.items() if any(e is not None for e in v)}
        some = {k: v for k, v in columns.items() if meaning(str(k)).role or _without_number(k) in filled}
        columns = some or columns
        taken = {k: iter(v) for k, v in columns.items()}
        return _without_wrapper([{k: next(taken[k]) for k in r if k in taken} for r in records])

    def _numbers(self, names: list[str], inner: list[Any]) -> dict[str, int]:
        """Return the numbers of strips that letters name, or names in the order of a list; {} where none do."""
        if len(names) < 2 or any(meaning(n).strip is not None for n in names):
            return {}
        listed = next((v for v in self.lists if {*names} <= {*v}), [])
        letters = all(re.fullmatch("[A-Z]", n) for n in names) and len(names) >= _FEW
        if not (listed or letters) or not all(map(_are_ends, inner)):
            return {}
        listed = listed or [chr(c) for c in range(ord("A"), ord("Z") + 1)]
        said = f"strips from 0: {listed[0]}"
        self.told += [] if said in self.told else [said]
        return {name: listed.index(name) for name in names}


def _without_number(name: object) -> str:
    return re.sub(r"\d+", "0", str(name))


def _are_identifiers(names: Sequence[str], inner: Sequence[Any]) -> bool:
    """Return whether names only tell records apart: each has a number in it, and what they name tells its scan."""
    if len(names) < _FEW or not all(isinstance(v, dict) and v for v in inner):
        return False
    if not all(re.search(r"\d", n) for n in names) or any(
        meaning(n).role for n in names if number_of(n) is None
    ):
        return False
    common = set.intersection(*({str(k) for k in v} for v in inner))
    told = [m for k in common if (m := meaning(k)).role]
    # Small numbers may be those of strips.
    large = not any((number := number_of(n)) is not None and number < _EPOCH for n in names)
    several = large and any(isinstance(v, dict | list) for record in inner for v in record.values())
    return bool(told) and (several or any(m.role != "reading" or m.strip is not None for m in told))


def _with_key(key: str, record: Any) -> Any:
    """Return a record with its key, if that is a time or a count and the record has none."""
    roles = {meaning(str(k)).role for k in record} if isinstance(record, dict) else set(_NAMED)
    number = number_of(key)
    if "time" not in roles and (clock_seconds(key) is not None or (number or 0.0) > _EPOCH):
        return {"time": key} | record
    return {"scan": key} | record if number is not None and not roles & {"time", "scan"} else record


def _without_wrapper(records: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return records with what is in their only inner record in its place, where nothing else has a known name."""
    names = list(dict.fromkeys(k for r in records for k in r))
    within = [n for n in names if all(isinstance(r.get(n), dict) for r in records)]
    others = {n for n in names if n not in within}
    if len(records) < 2 or len(within) != 1 or any(meaning(str(n)).role in _NAMED for n in names):
        return records
    inner = [r[within[0]] for r in records]
    roles = {meaning(str(k)).role for r in inner for k in r}
    if ("time" not in roles and "scan" not in roles) or others & {k for r in inner for k in r}:
        return records
    return [{k: v for k, v in r.items() if k != within[0]} | r[within[0]] for r in records]
