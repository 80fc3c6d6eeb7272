"""Logs whose lines name their values: JSON, and text such as "strip=3 vh=2.51V" or "H0:512 L0:300"."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from tacstrip.io.log_import.fields import says_nothing
from tacstrip.io.log_import.names import CHANNELS, UNITS, meaning

STEADY = 0.8  # of the lines: a form that as many have is that of the log
LABELS = frozenset({"time", "scan", "strip", "which"})
_WITH_TIME = re.compile(r"\d\s?(?:[mu]?s|min)\Z")
_OF_DAY = re.compile(r"(?:[\d./-]+,?[ T])?\d{1,2}:\d\d:\d\d(?:[.,]\d+)?")
_EPOCH = re.compile(r"1\d{9}(?:\.\d+|\d{3}|\d{6}|\d{9})?")  # since 1970
_ENDED = re.compile(r"\s*(?:[,;|/)]|\Z|\S*[A-Za-z]\S*\s*[:=])")  # behind a value: a mark, or the next name
_STRIP_THEN_NAME = re.compile(
    r"\b([A-Za-z]+\d+):\s*(?=[A-Za-z]\w*(?:\s*[=:]|\s+[-+\d.]))"
)  # as "S0:" in "S0:H=512 L=300"
_CALLED = re.compile(r"\A\s*[A-Za-z_]\w*\((.*=.*)\)\s*\Z")  # as a record that a program prints
_VOID = ("nan", "nil", "null", "none", "n/a")  # which are no ends
END_WORDS = frozenset({"end", "side", "ende", "seite", "edge"})  # behind the word that says which
_UNIT = "|".join(sorted((re.escape(u) for u in UNITS if len(u) < 8), key=len, reverse=True))
_FOREIGN = re.compile(  # a unit that is none of readings, behind a value
    r"\b([A-Za-z]\w*)(\s*[:=]\s*[-+]?\d[\d.]*)\s?([kMh]?Pa|m?bar|psi|[mk]?[Oo]hms?|[mnu\u00b5]?A|kV|[km]?N|[km]?g|deg[CF])"
    r"(?![\w=:]|\s*[=:])"
)
_TOKEN = re.compile(
    rf"""(?P<clock>(?<![\w.])(?:\d{{4}}-\d\d-\d\d[T ]|\d\d?[./]\d\d?[./]\d{{4}},?[ ])
        \d\d?:\d\d:\d\d(?:[.,]\d+)?(?:Z|[+-]\d\d:?\d\d)?(?!\w)
    | (?<![\w.])\d{{1,2}}:\d\d(?::\d\d(?:[.,]\d+)?|\.\d+)?(?!\d))
    | (?P<number>(?<![\w.])(?>0[xX][\dA-Fa-f]+|[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?
        (?:\s?(?i:{_UNIT})(?!\w|\s*(?:[\[(][^\])]*[\])]\s*)?[=:]))?))(?![\w])
    | (?P<word>(?:\d{{1,3}}(?=[A-Za-z]{{1,5}}\b))?
        [^\W\d][\w/.%-]*(?:\[\d+\])*(?:\s?[\[(][^\])\d]{{0,12}}[\])](?=\s*[:=]))?)
    | (?P<sign>[:=])
    | (?P<nothing>-{{1,9}}(?=(?:[mu\u00b5]?V|%)?(?:[\s,;|/)\]]|$))
        |(?<![^\s,;|/([:=])(?:\.{{1,9}}|[\u2013\u2014\u2026])(?=[\s,;|/)\]]|$))
    | (?P<mark>(?<=\s)[*_?]{{1,9}}(?=\s|$))
    | (?P<comma>(?<=\d),(?=\d))""",
    re.VERBOSE,
)
_AT_TIME = re.compile(r"\s+@\s*(\d+(?:\.\d+)?\s?(?:ms|us|s))\b")  # as in "H=2.5 @ 20 ms"


@dataclass(frozen=True)
class Item:
    """A name in a line, with the values that follow it."""

    name: str
    values: tuple[str, ...]
    told: bool  # by a colon or an equals sign


def items(line: str) -> list[Item]:
    """Return what a line names.

    Examples
    --------
    >>> [(i.name, i.values) for i in items("Strip 3: H=512 L=n/a")]
    [('Strip', ('3',)), ('H', ('512',)), ('L', ('n/a',))]
    """
    line = _undressed(line)
    garbled = re.search(r"\d[?~^$&!@\ufffd]|[?~^$&!@\ufffd][.\d]", line)
    if _lists_odd(line) or garbled or re.search(r"\d", _TOKEN.sub("", line)):  # not all of it would be read
        return []
    reading = _Reading(line)
    found = reading.found if all(map(reading.take, _TOKEN.finditer(line))) else []
    if any(i.told and not i.values and _is_reading(i.name) for i in found):
        return []  # a value that is not understood
    return _of_strips([i for i in found if i.values])


def _undressed(line: str) -> str:
    """Return a line without what is drawn around it and texts; what is nothing is written out."""
    if dressed := re.match(r"\s*[*#=~_<>-]{2,}\s*(?=\w)", line):  # as in "--- scan 3 ---"
        line = re.sub(r"[\s*#=~_<>-]+$", "", line[dressed.end() :])
    line = re.sub(r"\s*:\s*$", "", _CALLED.sub(r"\1", line))
    line = _STRIP_THEN_NAME.sub(lambda m: f"{m[1]} " if is_strip(m[1]) else m[0], line)
    line = re.sub(r"\b\w+=\"[^\"]*[A-Za-z][^\"]*\"", "", line)  # a text
    line = _AT_TIME.sub(r" t=\1", _FOREIGN.sub(r"\1 [\3]\2", line))
    return re.sub(r"=(?=\s*(?:[,;|]|$|\s[A-Za-z]\w*=))", "=nan", line)  # of which nothing is said


def _lists_odd(line: str) -> bool:
    """Return whether a list in a line holds words among numbers, so that the others would be taken for other strips."""
    for listed in re.findall(r"[:=]\s*((?:[^\s,;:=]+\s*,\s*){2,}[^\s,;:=]+)", line):
        parts = [p.strip(" ()[]{}") for p in listed.split(",")]
        odd = [n for n, p in enumerate(parts) if not (re.search(r"\d", p) or says_nothing(p))]
        if odd and len(odd) < len(parts) and (len(odd) > 1 or odd[0] < len(parts) - 1):
            return True
    return False


def _of_strips(found: list[Item]) -> list[Item]:
    """Return items with the strip in the names of those that follow it, where a line holds several strips."""
    places = [n for n, item in enumerate(found) if item.name == "strip"]
    if len(places) < 2:
        return found
    for place, end in zip(places, [*places[1:], len(found)], strict=True):  # each holds up to the next
        strip = found[place].values[0]
        bare = [n for n in range(place + 1, end) if not found[n].name]
        if len(bare) > 1:  # a pair such as 512/300
            found[bare[0]] = replace(found[bare[0]], values=tuple(v for n in bare for v in found[n].values))
            for n in bare[1:]:
                found[n] = replace(found[n], values=())
        for n in range(place + 1, end):
            found[n] = replace(found[n], name=f"strip {strip} {found[n].name}".rstrip())
    return [item for n, item in enumerate(found) if n not in places and item.values]


class _Reading:
    """What has been read of a line: items, words that may name the next one, and whether the last takes more values."""

    def __init__(self, line: str) -> None:
        self.line = line
        self.found: list[Item] = []
        self.words: list[str] = []
        self.end = 0  # of the last word
        self.open_name = False  # values of the last name may follow
        named = re.findall(r"[^\W\d_]+\d*", line)
        self.strips = any(is_strip(w) or meaning(w).role == "strip" for w in named)

    def take(self, token: re.Match[str]) -> bool:
        """Take a token; return False where the line cannot be read."""
        kind, text = str(token.lastgroup), token.group().strip()
        last = meaning(self.words[-1]) if self.words else None
        nothing = says_nothing(text) and (
            self.open_name
            or (last is not None and (last.channel in CHANNELS or is_strip(self.words[-1])))
            or (last is not None and bool(last.channel) and text.casefold() in _VOID)  # of "top nil"
        )
        if kind == "mark" and self.open_name:
            return False  # else the values behind it would be taken for other strips
        if kind == "mark" or (kind == "nothing" and text[0] != "-" and not nothing):
            return True
        if kind == "word" and not nothing:
            self._word(text, token)
        elif kind == "sign":
            self._sign()
        elif kind != "comma":
            self._value(text, token)
        return True

    def _close(self, name: str, told: bool) -> None:
        self.found.append(Item(name, (), told))
        self.words.clear()
        self.open_name = True

    def _word(self, text: str, token: re.Match[str]) -> None:
        found = self.found
        named = self.line[token.end() :].lstrip()[:1] in (":", "=") and token.end() < len(self.line)
        void = self.open_name and not named and not found[-1].values and _is_reading(found[-1].name)
        if void and _ENDED.match(self.line, token.end()):  # as in "H=OL L=OL"
            found[-1] = replace(found[-1], values=(text,))
            self.open_name = False
            return
        if self.open_name and not named and text.casefold() in UNITS and found and found[-1].values:
            return  # a unit apart from its number
        self.words.append(text)
        self.end = token.end()
        self.open_name = False

    def _sign(self) -> None:
        found, words = self.found, self.words
        if words:
            while len(words) > 1 and not meaning(words[0]).role:  # as the level before "t=20"
                del words[0]
            if len(words) > 1 and is_strip(words[0]):  # as in "strip0 H=512 L=300"
                found.append(Item("strip", (str(meaning(words.pop(0)).strip),), told=False))
            self._close(" ".join(words[-3:]), told=True)
        elif found and found[-1].name and len(found[-1].values) == 1 and not found[-1].told:
            found[-1] = replace(found[-1], told=True)  # as in "strip 3: 512 300"

    def _value(self, text: str, token: re.Match[str]) -> None:
        found = self.found
        if self.words:  # as in "strip 3" or "S3 H 512"
            self._name(text, token)
        elif not self.open_name:
            behind = bool(found) and meaning(found[-1].name).role in LABELS  # as in "Scan 3 @ 12:00:01"
            is_time = _WITH_TIME.search(text) or (behind and _OF_DAY.fullmatch(text))
            found.append(Item("time" if is_time else "", (), told=False))
        elif found[-1].values and (_EPOCH.fullmatch(text) or meaning(found[-1].name).role in LABELS):
            found.append(
                Item("time" if _EPOCH.fullmatch(text) else "", (), told=False)
            )  # a label has one value
        newest = found[-1]
        found[-1] = replace(newest, values=(*newest.values, text))
        # Of an end alone, as in "H 512 430 | L 300 210", a row of values follows.
        if not newest.told and (self.strips or meaning(newest.name).channel not in ("h", "l")):
            self.open_name = False

    def _name(self, text: str, token: re.Match[str]) -> None:
        """Name a value by the words before it, which no sign parts from it."""
        words = self.words
        self.found += [Item("strip", (str(meaning(w).strip),), told=False) for w in words[:-1] if is_strip(w)]
        last = meaning(words[-1])
        beside = self.line[self.end : token.start()].isspace()
        beside = beside and (last.strip is None or last.channel in CHANNELS)
        implied = last.role in LABELS and (last.role == "time" or not text[-1:].isalpha())
        implied = implied or bool(last.channel and beside)
        timed = "time" if _WITH_TIME.search(text) and len(words[-1]) < 4 else ""  # as in "at 20 ms"
        if is_strip(words[-1]) and not timed:  # as in "S1 512/300"
            self.found.append(Item("strip", (str(last.strip),), told=False))
        ends = len(words) > 1 and words[-1].casefold() in END_WORDS and meaning(words[-2]).channel
        self._close(" ".join(words[-2:]) if ends else words[-1] if implied else timed, told=False)


def is_strip(word: str) -> bool:
    """Return whether a word names a strip by its number, and no channel of it, as "S3"."""
    said = meaning(word)
    return said.role == "reading" and said.strip is not None and not said.channel and not said.unit


def _is_reading(name: str) -> bool:
    said = meaning(name)
    return said.role == "reading" and (said.channel in CHANNELS or said.strip is not None)


def is_label(found: Sequence[Item]) -> bool:
    """Return whether a line only says to which scan, time or strip the lines below it belong."""
    roles = {meaning(i.name).role for i in found}
    return bool(found) and roles <= LABELS and all(len(i.values) == 1 for i in found)
