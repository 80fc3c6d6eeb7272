"""XML as records: an element is its text, or what its attributes and its inner elements say."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from typing import Any
from xml.etree import ElementTree as ET


def of_xml(text: str) -> tuple[dict[str, Any], list[str]]:
    """Return what a text in XML holds, and its comments; nothing where it is none, or a table of HTML.

    Examples
    --------
    >>> of_xml('<log><!-- volts --><scan t="1"><strip id="0" h="2.5"/><strip id="1"/></scan></log>')
    ({'scan': {'t': '1', 'strip': [{'id': '0', 'h': '2.5'}, {'id': '1'}]}}, ['volts'])
    """
    if not re.match(r"\s*<[?!A-Za-z]", text) or re.search(r"<!(?:DOCTYPE|ENTITY)|<tr\b|<html", text, re.I):
        return {}, []
    for whole in (text.strip(), f"<log>{re.sub(r'<[?].*?[?]>', '', text)}</log>"):
        try:
            root = ET.fromstring(whole)
        except (ET.ParseError, ValueError, RecursionError):
            continue
        many = [Counter((e.tag, inner.tag) for inner in e) for e in root.iter()]
        value = _of_element(root, {key: max(c[key] for c in many) for one in many for key in one})
        said = re.findall(r"<!--(.*?)-->", text, re.DOTALL)
        return (value if isinstance(value, dict) else {}), [" ".join(s.split()) for s in said]
    return {}, []


def _of_element(element: ET.Element, most: Mapping[tuple[str, str], int]) -> Any:
    said = (element.text or "").strip()
    if not element.attrib and not len(element):
        return said
    made: dict[str, Any] = {_bare(key): value for key, value in element.attrib.items()}
    for tag in dict.fromkeys(inner.tag for inner in element):
        values = [_of_element(inner, most) for inner in element if inner.tag == tag]
        made[_bare(tag)] = values if most[element.tag, tag] > 1 else values[0]
    return made | ({"value": said} if said else {})


def _bare(name: str) -> str:
    return name.rpartition("}")[2]
