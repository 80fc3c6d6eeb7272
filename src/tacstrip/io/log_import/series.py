"""Lines of other series between those of the strips: other topics of a broker, other measurements of a database."""

from __future__ import annotations

import re
from collections import Counter

from tacstrip.io.log_import.names import meaning
from tacstrip.io.log_import.strays import numbered, without

_MOST = 0.6  # of the lines are of the strips' series
_STEADY = 0.9  # of the lines have a series' form
_SHOWN = 5
_DEEP = 4  # levels at the end of a topic that may name a strip
_MOST_SERIES = 1000  # of more names, these are no series'
_INFLUX = re.compile(
    r"([A-Za-z_][\w.-]*)((?:,[\w.-]+=[^\s,]+)*) ([\w.-]+=[^\s,]+(?:,[\w.-]+=[^\s,]+)*)(?: \d{10,19})?\s*"
)
_TOPIC = re.compile(
    r"(?:(?=\S*\d)\S++\s++){0,3}/?([A-Za-z][\w.-]*(?:/[\w.-]+)+):?\s+(\S.*)"
)  # perhaps behind a time
_SAMPLED = re.compile(r"([A-Za-z][\w-]*(?:\.[\w-]+)+)\s+(\S+)(?=\s+1\d{9,18}\s*\Z).*")  # as Graphite has it
_KEY = re.compile(r"[A-Za-z_][\w.-]*(?=\"?\s*[:=])")


def without_other_series(text: str) -> tuple[str, str]:
    r"""Return a text without lines of series that name nothing of a strip, where others do, and a remark.

    Examples
    --------
    >>> text = "\n".join(["pad/strip/1 2.5", "pad/strip/2 2.4", "pad/temperature 23"] * 2)
    >>> without_other_series(text)[1]
    "line(s) 3, 6: of 'pad/temperature', no strip's; passed over"
    """
    lines = [(n, line.strip()) for n, line in numbered(text) if line.strip() and not line.startswith("#")]
    for form, keys_of in ((_INFLUX, _of_measurement), (_TOPIC, _of_topic), (_SAMPLED, _of_topic)):
        found = {n: m for n, line in lines if (m := form.fullmatch(line))}
        if len(found) < max(_STEADY * len(lines), 2):
            continue
        names = {n: m[1] for n, m in found.items()}
        if len({*names.values()}) > _MOST_SERIES:
            return text, ""
        of_strips = {n: keys_of(m) for n, m in found.items()}
        # A series is of strips in all of its lines, or in none.
        mixed = {names[n] for n in found if of_strips[n]} & {names[n] for n in found if not of_strips[n]}
        kept = {names[n] for n in found if of_strips[n]}  # of which the others may be cut
        other = {name for name in {*names.values()} if not any(k.startswith(name) for k in kept)} - mixed
        out = sorted(n for n in found if names[n] in other)
        if not out or sum(of_strips.values()) < _MOST * len(found):
            return text, ""
        others = [repr(name) for name, _ in Counter(names[n] for n in out).most_common(_SHOWN)]
        more = ", ..." if len(out) > _SHOWN else ""
        shown = ", ".join(map(str, out[:_SHOWN])) + more
        return without(
            text, frozenset(out)
        ), f"line(s) {shown}: of {', '.join(others)}, no strip's; passed over"
    return text, ""


def _of_measurement(line: re.Match[str]) -> bool:
    """Return whether a line of InfluxDB's protocol names a strip or a channel."""
    return any(map(_is_of_strip, [line[1], *_KEY.findall(f"{line[2][1:]},{line[3]}")]))


def _of_topic(line: re.Match[str]) -> bool:
    """Return whether the end of a topic, or the keys of what it carries, name a strip, a channel, a scan or a time."""
    parts = re.split(r"[/.]", line[1])[-_DEEP:]
    ends = [" ".join(parts[n:]) for n in range(len(parts))]
    said = any(meaning(end).role and re.search(r"[A-Za-z]{2}|\b[A-Za-z]\d", end) for end in ends)
    return said or any(map(_is_of_strip, _KEY.findall(line[2])))


def _is_of_strip(name: str) -> bool:
    said = meaning(name)
    return said.role == "strip" or (said.role == "reading" and bool(said.channel or said.strip is not None))
