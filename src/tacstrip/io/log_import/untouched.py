"""Lines that say in words, in place of the readings, that nothing touches a strip."""

from __future__ import annotations

import re
from collections import Counter

from tacstrip.io.log_import.fields import says_nothing
from tacstrip.io.log_import.names import UNITS, meaning
from tacstrip.io.log_import.records import LABELS, is_strip
from tacstrip.io.log_import.untouched_phrases import says_no_contact

Lines = list[tuple[int, str]]
_UNIT = "|".join(sorted((re.escape(u) for u in UNITS if len(u) < 8), key=len, reverse=True))
_LABEL = r"(?<![\w.])[\[(<#]?(?P<strip>{})[\s=#:_.-]{{0,2}}\d+(?![\w.])[\])>]?"
_NAME = r"[^\W\d_]+"
_SAYS = re.compile(
    rf"(?P<said>(?:.*[\s,;|>])?{_LABEL.format(_NAME)})[\s,;:|=(\[>]+"
    r"(?P<words>(?:[^\W\d_]+\s*[=:]\s*)?[^\d=:]*[^\W\d_][^\d=:]*?|-{1,3})[\s)\]]*"
)
_VALUE = re.compile(rf"(?<![\w.])[-+]?\d[\d.]*(?:[eE][-+]?\d+)?(?i:\s?(?:{_UNIT}))?(?=[\s,;|/)\]]|\Z)")
_PLAIN = r"[^\W\d_]+(?: [^\W\d_]+){0,2}"  # words that may stand for readings
_NOT_TOUCHED = re.compile(
    r"(?:touch\w*|contact|press\w*|active)\s*[=:]\s*(?:false|no|none|off)", re.IGNORECASE
)
_OFTEN = 0.5  # of the lines with readings: a form that as many have is the log's


def with_names_of_nothing(lines: Lines) -> tuple[Lines, dict[str, int]]:
    """Return lines such as "strip=3 untouched" with what others have behind the strip, as "h=nan", and unknown words.

    These, with the first line of each, stand for the values, as it is not known what they mean.

    Examples
    --------
    >>> with_names_of_nothing([(1, "[S0] not pressed"), (2, "[S1] hi:0.4 lo:0.2"), (3, "[S2] hi:0.5 lo:0.3")])[0][0]
    (1, '[S0] hi:nan lo:nan')
    >>> with_names_of_nothing([(1, "S0 h=4"), (2, "S1 h=3"), (3, "S2 sensor fault"), (4, "S2 sensor fault")])[1]
    {'sensor fault': 3}
    """
    found = {i: m for i, line in lines if (m := _SAYS.fullmatch(line.strip())) and _is_of_strip(m["strip"])}
    if not found:
        return lines, {}
    strip = Counter(m["strip"] for m in found.values()).most_common(1)[0][0]
    label = re.compile(rf"(?:.*?[\s,;|>])?{_LABEL.format(re.escape(strip))}(?P<gap>[\s,;:|(>-]+)(?P<body>.*)")
    there = {i: m for i, line in lines if (m := label.fullmatch(line.strip()))}
    bodies = [(m["gap"], _VALUE.sub("nan", m["body"])) for m in there.values() if re.search(r"\d", m["body"])]
    (gap, form), many = Counter(bodies).most_common(1)[0] if bodies else (("", ""), 0)
    if many < _OFTEN * len(bodies) or not _is_of_readings(form, strip):
        return lines, {}
    words = Counter(m["words"].casefold() for m in found.values())
    # As in "top nil, bottom nil (volts)": each value is a word for nothing.
    written = re.compile(re.escape(form).replace("nan", r"([^\W\d_]+|-{1,3})"))
    made: dict[int, str] = {}
    unknown: dict[str, int] = {}
    for i, m in found.items():
        whole = there.get(i)
        each = written.fullmatch(whole["body"]) if whole else None
        if m["strip"] != strip:
            continue
        if _says_nothing(m["words"]) or (each and all(map(_says_nothing, each.groups()))):
            made[i] = f"{m['said']}{gap}{form}"
        elif words[m["words"].casefold()] > 1 and re.fullmatch(_PLAIN, m["words"]):
            unknown.setdefault(m["words"], i)
            made[i] = f"{m['said']}{gap}{form.replace('nan', m['words'].replace(' ', '_'))}"
    return [(i, made.get(i, line)) for i, line in lines], unknown


def _is_of_readings(form: str, strip: str) -> bool:
    """Return whether what stands behind a strip holds values, and neither another strip nor a time or a scan."""
    named = {meaning(n).role for n in re.findall(r"([A-Za-z]\w*)\s*[=:]", form)}
    several = re.search(_LABEL.format(re.escape(strip)), form)  # or the strip itself is the name of a value
    worded = re.search("[A-Za-z]", form.replace("nan", ""))  # else a sign for nothing is no value
    return "nan" in form and bool(worded) and not (several or LABELS & named or re.search(r"\d", form))


def _says_nothing(words: str) -> bool:
    said = re.split(r"[=:]", words)[-1].strip()  # as in "state=open"
    return bool(_NOT_TOUCHED.fullmatch(words.strip())) or says_nothing(said) or says_no_contact(said)


def _is_of_strip(word: str) -> bool:
    return is_strip(f"{word}1") or meaning(word).role == "strip"
