"""What a logger puts before the record of each line, and topics before what is sent."""

from __future__ import annotations

import json
import re
from collections import Counter

from tacstrip.io.log_import.fields import STAMP
from tacstrip.io.log_import.names import meaning
from tacstrip.io.log_import.records import STEADY
from tacstrip.io.log_import.table import CLOCK

Lines = list[tuple[int, str]]
_TOPIC = re.compile(
    rf"\s*(?:[\[(]?(?P<time>{STAMP}|\d+(?:\.\d+)?)[\])]?[\s,;:]+)?(?P<topic>/?[A-Za-z][\w.-]*(?:/[\w.-]+)+)[\s:,;=]+"
    r"(?P<sent>\{.*\}|\[.*\]|(?=.*[. n])(?:[-+]?\d+(?:\.\d+)?|nan)(?:[,;\s]+(?:[-+]?\d+(?:\.\d+)?|nan))+)\s*"
)
_BETWEEN = re.compile(r"[,;\s]+")
_LONGEST = 200  # characters before a record
# Words and no path, as of a level, before a record; no name to which it is given.
_FIRST = re.compile(
    r"\s*([EWIDV] (?=\(\d+\) ))?[\[(]?\s*(\d+(?:\.\d+)?)\s*[\])]?[:\s]"
)  # ESP-IDF's are milliseconds
_BEFORE = re.compile(r"[^{}/=]*[A-Za-z\d][^{}/=]*[\s:>|\]-]")
_NAN = re.compile(r"(?<![^\[:, ;])nan\b", re.IGNORECASE)


def without_prefix(text: str) -> str:
    r"""Return lines of a record behind what a logger puts before it, as records with the time that stands there.

    Examples
    --------
    >>> print(without_prefix("12:00:01.5 INFO pad: {'h': 2}\n12:00:02.5 INFO pad: {'h': 3}"))
    {'h': 2, "time stamp": "12:00:01.5"}
    {'h': 3, "time stamp": "12:00:02.5"}
    """
    lines = text.splitlines()
    heads = [line.partition("{")[0] if line.rstrip().endswith("}") else "" for line in lines]
    heads = [head if len(head) < _LONGEST and _BEFORE.fullmatch(head) else "" for head in heads]
    forms = Counter(_form(head) for head in heads if head).most_common(1)
    if not forms or forms[0][1] <= STEADY * sum(bool(re.search(r"\d", line)) for line in lines):
        return text
    made = []
    for line, head in zip(lines, heads, strict=True):
        if _form(head) != forms[0][0]:
            made.append(line)
            continue
        made.append(f"{line[len(head) :].rstrip()[:-1]}{_time_before(head)}}}")
    return "\n".join(made)


def _time_before(head: str) -> str:
    """Return as the end of a record what time stands before it: a time of day, or a number in brackets or first."""
    if stamp := re.search(STAMP, head):
        return f', "{CLOCK}": "{stamp.group().strip()}"'
    if first := _FIRST.match(head):
        return f', "time before each line{" [ms]" if first[1] else ""}": "{first[2]}"'
    return ""


def _form(before: str) -> str:
    return re.sub(r"\d+", "0", before)


def of_sent(text: str) -> str:
    r"""Return lines of a topic and a record in JSON as records with what the topic numbers and the time before it.

    Examples
    --------
    >>> print(of_sent("5.1 lab/strip/1 {\"h\": 2}\n5.2 lab/strip/2 {\"h\": 3}"))
    {"time": "5.1", "strip": "1", "h": 2}
    {"time": "5.2", "strip": "2", "h": 3}
    """
    lines = text.splitlines()
    found = [_TOPIC.fullmatch(line) for line in lines]
    topics = [m["topic"].strip("/").split("/") for m in found if m]
    if not topics or len(topics) <= STEADY * sum(bool(line.strip()) for line in lines):
        return text
    usual = Counter(map(len, topics)).most_common(1)[0][0]
    places = [n for n in range(usual) if len({t[n] for t in topics if len(t) == usual}) > 1]
    made = []
    for line, m in zip(lines, found, strict=True):
        parts = m["topic"].strip("/").split("/") if m else []
        try:
            plain = _NAN.sub("null", m["sent"]) if m else ""
            if plain[:1] not in ("{", "["):
                plain = "[" + ", ".join(_BETWEEN.split(plain)) + "]"
            sent = json.loads(plain) if m else None
        except ValueError:
            sent = None
        if m is None or sent is None or len(parts) != usual:
            made.append(line)
            continue
        above: dict[str, str] = {"time": m["time"].strip()} if m["time"] else {}
        for n in places:
            numbered = re.fullmatch(r"(\D*?)[_.-]?(\d+)", parts[n])
            name = (numbered[1] if numbered else "") or (parts[n - 1] if n and numbered else "")
            if numbered and name and not meaning(name).role and len(places) == 1:
                name = "strip"
            above[name or "topic"] = numbered[2] if numbered else parts[n]
        name = "value" if usual - 1 in places else parts[-1]
        made.append(json.dumps({**above, **(sent if isinstance(sent, dict) else {name: sent})}))
    return "\n".join(made)
