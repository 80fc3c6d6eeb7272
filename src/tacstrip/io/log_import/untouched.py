"""Lines that say in words, in place of the readings, that nothing touches a strip."""

from __future__ import annotations

import re
from collections import Counter

from tacstrip.io.log_import.fields import says_nothing
from tacstrip.io.log_import.names import UNITS, meaning
from tacstrip.io.log_import.records import is_strip

_LABELS = frozenset({"time", "scan", "strip", "which"})
_UNIT = "|".join(sorted((re.escape(u) for u in UNITS if len(u) < 8), key=len, reverse=True))
_ONLY_WORD = re.compile(
    r"(?P<said>(?:.*[\s,;|>])?(?P<strip>[A-Za-z]+)[\s=#:_]{0,2}\d+)\b[\s,;:|=(\[]+(?:-+\s+)?(?P<word>[^\d=:]*?)[\s)\]]*"
)
_VALUE_SAID = re.compile(rf"(?<=[=:\s])[-+]?\d[\d.]*(?:\s?(?:{_UNIT}))?(?=[\s,;|)\]]|\Z)")


def with_names_of_nothing(lines: list[tuple[int, str]]) -> list[tuple[int, str]]:
    """Return lines such as "strip=3 untouched" or "S03 no contact" with what others have behind the strip, as "h=nan".

    A word that is not known stands for the values, so that it is asked what it means.
    """
    void = {
        i: m for i, line in lines if (m := _ONLY_WORD.fullmatch(line.strip())) and _is_of_strip(m["strip"])
    }
    words = Counter(m["word"].casefold() for m in void.values())
    void = {
        i: m for i, m in void.items()
        if says_nothing(m["word"]) or (words[m["word"].casefold()] > 1 and m["word"].isalpha())
    }  # fmt: skip
    void = {i: m for i, m in void.items() if m["word"]}
    if not void:
        return lines
    strip = Counter(m["strip"] for m in void.values()).most_common(1)[0][0]
    said = re.compile(rf"(?:.*?[\s,;|>])?{strip}[\s=#:_]{{0,2}}\d+\b[\s,;:|(\[-]+(.*\d.*)")
    behind = Counter(
        _VALUE_SAID.sub("nan", m[1])
        for i, line in lines
        if i not in void and (m := said.fullmatch(line.strip()))
    )
    form = behind.most_common(1)[0][0] if behind else ""
    if not re.search("[A-Za-z]", form.replace("nan", "")) or re.search(rf"\b{strip}[\s=#:_]{{0,2}}\d", form):
        return lines  # the strip itself is the name of a value, or there are several in a line
    if "nan" not in form or any(
        meaning(n).role in _LABELS for n in re.findall(r"([A-Za-z]\w*)\s*[=:]", form)
    ):
        return lines
    made = {
        i: f"{m['said']} {form if says_nothing(m['word']) else form.replace('nan', m['word'])}"
        for i, m in void.items() if m["strip"] == strip
    }  # fmt: skip
    return [(i, made.get(i, line)) for i, line in lines]


def _is_of_strip(word: str) -> bool:
    return is_strip(f"{word}1") or meaning(word).role == "strip"
