"""Lines that say where a scan begins and ends, topics before what is sent, and marks between values."""

from __future__ import annotations

import json
import re
from collections import Counter

from tacstrip.io.log_import.fields import STAMP
from tacstrip.io.log_import.names import meaning
from tacstrip.io.log_import.records import STEADY
from tacstrip.io.log_import.table import CLOCK

Lines = list[tuple[int, str]]
_END = re.compile(
    r"\W*(?:end (?:of )?)(scan|frame|sweep|cycle)\W*(\d+)\b.*"
    r"|\W*(scan|frame|sweep|cycle)\W*(\d+)\W*(?:end|ended|done|finished|complete|completed|stop|stopped|over)\b.*",
    re.IGNORECASE,
)
_BEGIN = re.compile(
    r"\W*(?:(?:begin|start) (?:of )?)?(scan|frame|sweep|cycle)\W*(\d+)\W*(?:begin|begins|start|starts|started)?\W*",
    re.IGNORECASE,
)
_NO_END = "scan {} has no line that ends it, as others have: is the log cut there?"
_COUNT = re.compile(r"\b(\d+)\s+(?:\w+ )?(?:strips?|lines?|readings?|touched)\b", re.IGNORECASE)
_TAG = re.compile(r"([A-Za-z][\w.-]*): (?=\S)")
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
_VALUE = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:\s?[A-Za-z%]{1,3})?|nan|n/a|-{1,3}"


def without_ends(lines: Lines) -> tuple[Lines, list[str]]:
    """Return lines without those that end a scan, each scan below a line that numbers it, and doubts.

    Examples
    --------
    >>> lines = [(1, "scan 0 begin"), (2, "s=1 h=5"), (3, "scan 0 end, 2 strips"), (4, "s=1 h=6"), (5, "scan 1 end")]
    >>> without_ends(lines)[0]
    [(1, 'scan 0'), (2, 's=1 h=5'), (4, 'scan 1'), (4, 's=1 h=6')]
    >>> for doubt in without_ends(lines)[1]:
    ...     print(doubt)
    line 3 says 2 strips, and its scan has 1 line(s): is one lost?
    line 5 ends scan 1, and no line begins it: taken as that of the lines from line 4
    """
    ends = sum(_END.fullmatch(line) is not None for _, line in lines)
    if ends < 2:
        return lines, []
    made: Lines = []
    doubts = []
    start, open_ = 0, ""  # of the scan: where it begins in what is made, and its number
    for i, line in lines:
        if end := _END.fullmatch(line):
            number = end[2] or end[4]
            inner = made[start:]
            if number != open_ and inner:
                made.insert(start, (inner[0][0], f"{end[1] or end[3]} {number}"))
                doubts.append(
                    f"line {i} ends {end[1] or end[3]} {number}, and no line begins it: taken as that of the lines "
                    f"from line {inner[0][0]}"
                )
            many = sum(bool(re.search(r"\d", text)) for _, text in inner) - (number == open_)
            if (told := _COUNT.search(line, end.end(2) if end[2] else end.end(4))) and int(told[1]) != many:
                doubts.append(f"line {i} says {told[0]}, and its scan has {many} line(s): is one lost?")
            start, open_ = len(made), ""
        elif begin := _BEGIN.fullmatch(line):
            doubts += [_NO_END.format(open_)] if open_ else []
            start, open_ = len(made), begin[2]
            made.append((i, f"{begin[1]} {begin[2]}"))
        else:
            made.append((i, line))
    return made, [*doubts, *([_NO_END.format(open_)] if open_ else [])]


def without_tag(lines: Lines) -> Lines:
    """Return lines without the tag that nearly all of them begin with.

    Examples
    --------
    >>> without_tag([(1, "skin: scan 0"), (2, "skin: h=5"), (3, "skin: h=6"), (4, "skin: h=7")])[1]
    (2, 'h=5')
    """
    tags = Counter(m[1] for _, line in lines if (m := _TAG.match(line)))
    tag, many = tags.most_common(1)[0] if tags else ("", 0)
    if many <= STEADY * len(lines) or meaning(tag).role:
        return lines
    return [(i, line.removeprefix(f"{tag}: ")) for i, line in lines]


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
