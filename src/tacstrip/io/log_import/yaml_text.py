"""YAML as records."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from tacstrip.io.log_import.json_records import of_values
from tacstrip.io.log_import.literals import literal
from tacstrip.io.log_import.table import Table

_FEW = 2  # records
_ITEM = re.compile(r"\s*(?:- )*\s*(?:-|[\w.\"'/ -]+:(?:\s.*)?|- .*|---|\.\.\.|#.*)?")

Lines = list[tuple[int, str]]


def _documents(text: str) -> tuple[list[Lines], Lines]:
    """Return the lines of each document of a text in YAML, and its comments; nothing where it is none."""
    comments = [
        (i, line.strip()) for i, line in enumerate(text.splitlines(), 1) if re.search(r"(?:\A|\s)#\s", line)
    ]
    documents: list[Lines] = [[]]
    for i, line in enumerate(text.splitlines(), 1):
        plain = re.sub(r"(?:\A|\s+)#\s.*", "", line).rstrip()
        if plain in ("---", "...") or re.fullmatch(r"\s.*\w---", plain):  # as behind a message that ROS lost
            documents.append([])
        elif plain and (plain.startswith("\t") or not (":" in plain or plain.lstrip().startswith("-"))):
            comments.append((i, plain.strip()))  # no line of YAML
        elif plain:
            documents[-1].append((i, plain))
    every = [line for doc in documents for _, line in doc]
    if not all(map(_ITEM.fullmatch, every)) or not any(
        re.fullmatch(r"\s*(?:- )?[\w.\"' -]+:", line) or re.match(r"\s*- (?:\w+:|\S+\Z)", line)
        for line in every
    ):
        return [], []
    return [doc for doc in documents if doc], comments


def yaml_documents(text: str) -> tuple[list[tuple[int, Any]], Lines]:
    """Return the values of a text in YAML with their lines, and its comments; nothing where it is none."""
    documents, comments = _documents(text)
    try:
        return [(doc[0][0], _block([line for _, line in doc])[0]) for doc in documents], comments
    except (ValueError, RecursionError):
        return [], []


def of_yaml(text: str, path: str) -> Table | None:
    """Return records in YAML as a table; None where the text is none."""
    found, _ = yaml_documents(text)
    if not found:
        return None
    if len(found) == 1:
        return of_values(found[0][1], path, "documents in YAML")
    keys = [set(_paths(value)) for _, value in found]
    last = [len(doc[-1][1].strip()) for doc in _documents(text)[0]]
    within = not text.endswith(("\n", "\r")) and last[-1] < min(
        last[:-1]
    )  # the log ends within its last line
    cut = len(found) > _FEW and (keys[-1] < set.intersection(*keys[:-1]) or within or _lacks(found[-1][1]))
    table = of_values(found[: len(found) - cut], path, "documents in YAML", numbered=True)
    return (
        replace(table, broken=(found[-1][0],), quotes={found[-1][0]: "the last record"})
        if table and cut
        else table
    )


def _lacks(value: Any) -> bool:
    """Return whether the last record of a value's last list lacks what all others in it have.

    Examples
    --------
    >>> _lacks({"strips": [{"h": 5, "l": 4}, {"h": 5}]}), _lacks([{"h": 5}, {"h": 5, "l": 4}])
    (True, False)
    """
    if isinstance(value, dict):
        return bool(value) and _lacks([*value.values()][-1])
    if not isinstance(value, list) or not value:
        return False
    records = [set(v) for v in value if isinstance(v, dict)]
    if len(records) == len(value) > 1 and records[-1] < set.intersection(*records[:-1]):
        return True
    return _lacks(value[-1])


def _paths(value: Any, before: str = "") -> Iterable[str]:
    """Yield the keys of all levels of a record."""
    parts = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in parts:
        yield f"{before}{key}"
        yield from _paths(inner, f"{before}{key}.")


def _block(lines: list[str], start: int = 0) -> tuple[Any, int]:
    """Return the value that begins at a line of YAML, and the line after it; `ValueError` where it is none."""
    if start == len(lines):  # the log ends within it
        return "", start
    depth = len(lines[start]) - len(lines[start].lstrip())
    listed = lines[start].lstrip().startswith("-")
    many: list[Any] = []
    named: dict[str, Any] = {}
    n = start
    while n < len(lines):
        text = lines[n].lstrip()
        inside = len(lines[n]) - len(text)
        if inside < depth or (inside == depth and text.startswith("-") != listed):
            break
        if inside > depth:
            raise ValueError(lines[n])
        if listed:
            rest = text[1:].lstrip()
            if re.match(r"[\w.\"'-]+:(?:\s|\Z)", rest) or rest.startswith(
                "- "
            ):  # a record begins behind the dash
                lines = [*lines[:n], " " * (inside + len(text) - len(rest)) + rest, *lines[n + 1 :]]
                value, n = _block(lines, n)
            elif rest:
                value, n = _scalar(rest), n + 1
            else:
                value, n = _block(lines, n + 1)
            many.append(value)
            continue
        key, colon, rest = text.partition(":")
        if not colon:
            raise ValueError(text)
        n += 1
        value = _scalar(rest.strip()) if rest.strip() else None
        if not rest.strip() and n < len(lines):
            below = lines[n].lstrip()
            if len(lines[n]) - len(below) > depth or (
                len(lines[n]) - len(below) == depth and below.startswith("-")
            ):
                value, n = _block(lines, n)
        named[key.strip("\"' ")] = value
    return (many if listed else named), n


def _scalar(text: str) -> Any:
    plain = re.sub(r"\s+#.*", "", text)
    if plain[:1] in "[{":
        value = literal(
            re.sub(r"(?<![\w.\"])(?:[.](?=nan|NaN|inf)|~)", lambda m: "null" * (m[0] == "~"), plain),
            words=True,
        )
        if value is None:
            raise ValueError(plain)
        return value
    return None if plain in ("~", "null") else plain.strip("\"'")
