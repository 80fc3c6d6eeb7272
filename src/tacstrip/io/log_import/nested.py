"""What nested text holds, whatever writes it: XML, protobuf's text, JSON or Python's records over several lines."""

from __future__ import annotations

import json
import re
from typing import Any
from xml.etree import ElementTree as ET

from tacstrip.io.log_import.literals import literal

Documents = list[tuple[int, Any]]  # line, value
_MOST_LINES = 400_000
_TOKEN = re.compile(
    r"\s+|#[^\n]*|(?P<end>\})[;,]?|(?P<name>[A-Za-z_][\w.]*)\s*(?::\s*)?(?P<open>\{)"
    r"|(?P<key>[A-Za-z_][\w.]*)\s*:\s*(?P<value>\"[^\"\n]*\"|'[^'\n]*'|\[[^\[\]{}]*\]|[^\s{}#\",;]+)[;,]?"
)
_PROTOBUF = re.compile(r"(?m)^\s*[A-Za-z_]\w*\s*:?\s*\{\s*(?:$|[A-Za-z_]\w*\s*[:{])")
_OPENS = re.compile(r"\s*(?:[A-Za-z_]\w*\s*=\s*)?[\[{]")
_QUOTED = re.compile(r"\"(?:[^\"\\]|\\.)*\"|'(?:[^'\\]|\\.)*'")


def documents(text: str) -> tuple[Documents, list[tuple[int, str]]]:
    r"""Return the values that a text holds with their lines, and the lines around them; nothing where it is not nested.

    Examples
    --------
    >>> documents("{'t': 1,\n 'h': [2.5,\n  None]}\n")[0]
    [(1, {'t': 1, 'h': [2.5, None]})]
    >>> documents("scan { t: 1 strip { id: 0 high: 2.5 } }")[0]
    [(1, {'scan': {'t': '1', 'strip': {'id': '0', 'high': '2.5'}}})]
    >>> documents('<log><scan t="1"><strip id="0" h="2.5"/></scan></log>')[0]
    [(1, {'scan': {'t': '1', 'strip': {'id': '0', 'h': '2.5'}}})]
    """
    if text.count("\n") > _MOST_LINES or not re.search(r"[{\[<]", text):
        return [], []
    if re.match(r"\s*<[?!A-Za-z]", text):
        return _of_xml(text)
    if _PROTOBUF.search(text) and (found := _of_protobuf(text)):
        remarks = [(i, line) for i, line in enumerate(text.splitlines(), 1) if line.lstrip().startswith("#")]
        return [(1, found)], remarks
    return _of_brackets(text)


def _of_xml(text: str) -> tuple[Documents, list[tuple[int, str]]]:
    if re.search(r"<!(?:DOCTYPE|ENTITY)|<tr\b|<html", text, re.IGNORECASE):
        return [], []
    try:
        root = ET.fromstring(text.strip())
    except (ET.ParseError, ValueError, RecursionError):
        try:
            root = ET.fromstring(f"<log>{re.sub(r'<[?].*?[?]>', '', text)}</log>")
        except (ET.ParseError, ValueError, RecursionError):
            return [], []
    value = _of_element(root)
    remarks = [" ".join(said.split()) for said in re.findall(r"<!--(.*?)-->", text, re.DOTALL)]
    return ([(1, _unlisted(value))] if isinstance(value, dict) else []), [
        (1, f"# {said}") for said in remarks
    ]


def _of_element(element: ET.Element) -> Any:
    """Return an element as its text, or as a record of its attributes and of lists of its inner elements."""
    said = (element.text or "").strip()
    if not element.attrib and not len(element):
        return said
    made: dict[str, Any] = {_bare(key): value for key, value in element.attrib.items()}
    for inner in element:
        name, value = _bare(inner.tag), _of_element(inner)
        if isinstance(value, dict):
            made.setdefault(name, [])
        if isinstance(made.get(name), list):
            made[name].append(value)
        elif name in made:
            made[name] = [made[name], value]
        else:
            made[name] = value
    return made | ({"value": said} if said else {})


def _bare(name: str) -> str:
    return name.rpartition("}")[2]


def _of_protobuf(text: str) -> dict[str, Any]:
    """Return a message in protobuf's text; {} where the text is none."""
    top: dict[str, Any] = {}
    stack, at = [top], 0
    while at < len(text):
        token = _TOKEN.match(text, at)
        if token is None:
            return {}
        at = token.end()
        if token["end"]:
            if len(stack) == 1:
                return {}
            stack.pop()
        elif token["open"]:
            inner: dict[str, Any] = {}
            many = stack[-1].setdefault(token["name"], [])
            if not isinstance(many, list):
                return {}
            many.append(inner)
            stack.append(inner)
        elif token["key"]:
            value: Any = token["value"].strip("\"'")
            if value.startswith("["):
                value = [part.strip("\"' ") for part in value[1:-1].split(",")]
            before = stack[-1].get(token["key"])
            known = [] if before is None else before if isinstance(before, list) else [before]
            stack[-1][token["key"]] = value if before is None else [*known, value]
    return _unlisted(top) if len(stack) == 1 else {}


def _unlisted(record: dict[str, Any]) -> dict[str, Any]:
    """Return a record without the lists of those inner ones that are never several."""
    most: dict[tuple[str, ...], int] = {}

    def count(value: Any, path: tuple[str, ...]) -> None:
        for key, inner in value.items() if isinstance(value, dict) else ():
            here = (*path, key)
            if isinstance(inner, list):
                most[here] = max(most.get(here, 0), len(inner))
            for element in inner if isinstance(inner, list) else [inner]:
                count(element, here)

    def made(value: Any, path: tuple[str, ...]) -> Any:
        if isinstance(value, list):
            parts = [made(element, path) for element in value]
            return parts[0] if most.get(path) == 1 else parts
        if isinstance(value, dict):
            return {key: made(inner, (*path, key)) for key, inner in value.items()}
        return value

    count(record, ())
    plain: dict[str, Any] = made(record, ())
    return plain


def _of_brackets(text: str) -> tuple[Documents, list[tuple[int, str]]]:
    """Return records and lists in JSON's or Python's form, each on one line or over several, and the other lines."""
    found: Documents = []
    around: list[tuple[int, str]] = []
    open_, depth, first = [], 0, 0  # type: list[str], int, int
    for number, line in enumerate(text.splitlines(), 1):
        if not open_ and not _OPENS.match(line):
            around += [(number, line)] if line.strip() else []
            continue
        first = first if open_ else number
        open_.append(line)
        bare = _QUOTED.sub("", line)
        depth += sum(bare.count(c) for c in "[{(") - sum(bare.count(c) for c in "]})")
        if depth <= 0:
            value = _value("\n".join(open_))
            if isinstance(value, dict | list | tuple):
                found.append((first, value))
            else:
                around += [(first + n, part) for n, part in enumerate(open_)]
            open_, depth = [], 0
    return found, around + [(first + n, part) for n, part in enumerate(open_)]


def _value(text: str) -> Any:
    plain = re.sub(r"(?<=[:\[, ])-?(?:NaN|Infinity)\b", "null", text.strip().rstrip(","))
    try:
        return json.loads(plain)
    except (ValueError, RecursionError):
        return literal(text.strip())
