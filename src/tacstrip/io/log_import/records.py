"""Logs whose lines name their values: JSON, and text such as "strip=3 vh=2.51V" or "H0:512 L0:300"."""

from __future__ import annotations

import itertools
import json
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from tacstrip.errors import ReadingError
from tacstrip.io.log_import.fields import is_prose, says_nothing
from tacstrip.io.log_import.literals import literal, literals
from tacstrip.io.log_import.names import CHANNELS, UNITS, meaning
from tacstrip.io.log_import.table import Table, flattened, of_records, said_above

STEADY = 0.8  # of the lines: a form that as many have is that of the log
_LABELS = frozenset({"time", "scan", "strip", "which"})
_FEW_KINDS = 0.5  # of the records: as many name the same values, or all do as they like
_COMMA = re.compile(r"(?<![\d,.:])\d+,\d+(?![\d,.])")
_WITH_TIME = re.compile(r"\d\s?(?:[mu]?s|min)\Z")
_OF_DAY = re.compile(r"(?:[\d-]+[ T])?\d{1,2}:\d\d:\d\d(?:[.,]\d+)?")
_EPOCH = re.compile(r"1\d{9}(?:\.\d+|\d{3}|\d{6}|\d{9})?")  # since 1970
_ENDED = re.compile(r"\s*(?:[,;|/)]|\Z|\S*[A-Za-z]\S*\s*[:=])")  # behind a value: a mark, or the next name
_STRIP_NAMED = re.compile(r"(\D*?)(\d+)(.*)\Z")  # a name with a strip's number in it
_STRIP_THEN_NAME = re.compile(
    r"\b([A-Za-z]+\d+):\s*(?=[A-Za-z]\w*(?:\s*[=:]|\s+[-+\d.]))"
)  # as "S0:" in "S0:H=512 L=300"
_CALLED = re.compile(r"\A\s*[A-Za-z_]\w*\((.*=.*)\)\s*\Z")  # as a record that a program prints
_END_WORDS = frozenset({"end", "side", "ende", "seite", "edge"})  # behind the word that says which
_SAMPLE = 200  # lines that tell whether all are of a kind
_UNIT = "|".join(sorted((re.escape(u) for u in UNITS if len(u) < 8), key=len, reverse=True))
_FOREIGN = re.compile(  # a unit that is none of readings, behind a value
    r"\b([A-Za-z]\w*)(\s*[:=]\s*[-+]?\d[\d.]*)\s?([kMh]?Pa|m?bar|psi|[mk]?[Oo]hms?|[mnu\u00b5]?A|kV|[km]?N|[km]?g|deg[CF])"
    r"(?![\w=:]|\s*[=:])"
)
_TOKEN = re.compile(
    rf"""(?P<clock>(?<![\w.])\d{{4}}-\d\d-\d\d[T ]\d\d:\d\d:\d\d(?:[.,]\d+)?(?:Z|[+-]\d\d:?\d\d)?(?!\w)
    | (?<![\w.])\d{{1,2}}:\d\d(?::\d\d(?:[.,]\d+)?|\.\d+)?(?!\d))
    | (?P<number>(?<![\w.])(?>0[xX][\dA-Fa-f]+|[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?
        (?:\s?(?i:{_UNIT})(?!\w|\s*(?:[\[(][^\])]*[\])]\s*)?[=:]))?))(?![\w])
    | (?P<word>(?:\d{{1,3}}(?=[A-Za-z]{{1,5}}\b))?
        [A-Za-zµ_\u00c0-\u024f][\w/.%-]*(?:\[\d+\])*(?:\s?[\[(][^\])\d]{{0,12}}[\])](?=\s*[:=]))?)
    | (?P<sign>[:=])
    | (?P<nothing>-{{1,9}}(?=[\s,;|/)\]]|$))
    | (?P<comma>(?<=\d),(?=\d))""",
    re.VERBOSE,
)
_ONLY_WORD = re.compile(
    r"(?P<said>(?:.*[\s,;|>])?(?P<strip>[A-Za-z]+)[\s=#:_]{0,2}\d+)\b[\s,;:|=(\[]+(?:-+\s+)?(?P<word>[^\d=:]*?)[\s)\]]*"
)
_VALUE_SAID = re.compile(rf"(?<=[=:\s])[-+]?\d[\d.]*(?:\s?(?:{_UNIT}))?(?=[\s,;|)\]]|\Z)")


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
    if dressed := re.match(r"\s*[*#=~_<>-]{2,}\s*(?=\w)", line):  # as in "--- scan 3 ---"
        line = re.sub(r"[\s*#=~_<>-]+$", "", line[dressed.end() :])
    line = re.sub(r"\s*:\s*$", "", _CALLED.sub(r"\1", line))
    line = _STRIP_THEN_NAME.sub(lambda m: f"{m[1]} " if _is_strip(m[1]) else m[0], line)
    line = re.sub(r"\b\w+=\"[^\"]*[A-Za-z][^\"]*\"", "", line)  # a text
    line = _FOREIGN.sub(r"\1 [\3]\2", line)
    line = re.sub(r"=(?=\s*(?:[,;|]|$|\s[A-Za-z]\w*=))", "=nan", line)  # of which nothing is said
    for listed in re.findall(r"[:=]\s*((?:[^\s,;:=]+\s*,\s*){2,}[^\s,;:=]+)", line):
        parts = [p.strip(" ()[]{}") for p in listed.split(",")]
        odd = [n for n, p in enumerate(parts) if not (re.search(r"\d", p) or says_nothing(p))]
        if odd and len(odd) < len(parts) and (len(odd) > 1 or odd[0] < len(parts) - 1):
            return []  # else the others would be taken for other strips
    garbled = re.search(r"\d[?~^$&!@\ufffd]|[?~^$&!@\ufffd][.\d]", line)
    if garbled or re.search(r"\d", _TOKEN.sub("", line)):  # not all of it would be read
        return []
    found: list[Item] = []
    words: list[str] = []
    end = 0  # of the last word
    open_name = False  # values of the last name may follow

    def close(name: str, told: bool) -> None:
        nonlocal open_name
        found.append(Item(name, (), told))
        words.clear()
        open_name = True

    for token in _TOKEN.finditer(line):
        kind, text = str(token.lastgroup), token.group().strip()
        nothing = says_nothing(text) and (
            open_name or (words and (meaning(words[-1]).channel in CHANNELS or _is_strip(words[-1])))
        )
        if kind == "word" and not nothing:
            named = line[token.end() :].lstrip()[:1] in (":", "=") and token.end() < len(line)
            void = open_name and not named and not found[-1].values and _is_reading(found[-1].name)
            if void and _ENDED.match(line, token.end()):  # as in "H=OL L=OL"
                found[-1] = replace(found[-1], values=(text,))
                open_name = False
                continue
            if open_name and not named and text.casefold() in UNITS and found and found[-1].values:
                continue  # a unit apart from its number
            words.append(text)
            end = token.end()
            open_name = False
        elif kind == "sign":
            if words:
                while len(words) > 1 and not meaning(words[0]).role:  # as the level before "t=20"
                    del words[0]
                if len(words) > 1 and _is_strip(words[0]):  # as in "strip0 H=512 L=300"
                    found.append(Item("strip", (str(meaning(words.pop(0)).strip),), told=False))
                close(" ".join(words[-3:]), told=True)
            elif found and found[-1].name and len(found[-1].values) == 1 and not found[-1].told:
                found[-1] = replace(found[-1], told=True)  # as in "strip 3: 512 300"
        elif kind != "comma":
            if words:  # as in "strip 3" or "S3 H 512"
                found += [
                    Item("strip", (str(meaning(w).strip),), told=False) for w in words[:-1] if _is_strip(w)
                ]
                last_word = meaning(words[-1])
                beside = line[end : token.start()].isspace()
                beside = beside and (last_word.strip is None or last_word.channel in CHANNELS)
                implied = last_word.role in _LABELS and (last_word.role == "time" or not text[-1:].isalpha())
                implied = implied or bool(last_word.channel and beside)
                timed = "time" if _WITH_TIME.search(text) and len(words[-1]) < 4 else ""  # as in "at 20 ms"
                if _is_strip(words[-1]) and not timed:  # as in "S1 512/300"
                    found.append(Item("strip", (str(last_word.strip),), told=False))
                ends = len(words) > 1 and words[-1].casefold() in _END_WORDS and meaning(words[-2]).channel
                close(" ".join(words[-2:]) if ends else words[-1] if implied else timed, told=False)
            elif not open_name:
                behind = bool(found) and meaning(found[-1].name).role in _LABELS  # as in "Scan 3 @ 12:00:01"
                is_time = _WITH_TIME.search(text) or (behind and _OF_DAY.fullmatch(text))
                found.append(Item("time" if is_time else "", (), told=False))
            elif found[-1].values and (_EPOCH.fullmatch(text) or meaning(found[-1].name).role in _LABELS):
                found.append(
                    Item("time" if _EPOCH.fullmatch(text) else "", (), told=False)
                )  # a label has one value
            last = found[-1]
            found[-1] = replace(last, values=(*last.values, text))
            if not last.told:
                open_name = False
    found = [i for i in found if i.values]
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


def _is_strip(word: str) -> bool:
    said = meaning(word)
    return said.role == "reading" and said.strip is not None and not said.channel and not said.unit


def _is_reading(name: str) -> bool:
    said = meaning(name)
    return said.role == "reading" and (said.channel in CHANNELS or said.strip is not None)


def is_label(found: Sequence[Item]) -> bool:
    """Return whether a line only says to which scan, time or strip the lines below it belong."""
    roles = {meaning(i.name).role for i in found}
    return bool(found) and roles <= _LABELS and all(len(i.values) == 1 for i in found)


def _with_names_of_nothing(lines: list[tuple[int, str]]) -> list[tuple[int, str]]:
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
    return _is_strip(f"{word}1") or meaning(word).role == "strip"


def named_values(lines: list[tuple[int, str]]) -> Table | None:
    """Return lines that name their values as a table; None where the log is none of that kind."""
    lines = _with_names_of_nothing(lines)
    if len(lines) > _SAMPLE and named_values(lines[:_SAMPLE]) is None:
        return None
    parsed = [(i, items(line)) for i, line in lines]
    said = [p for (_, p), (_, line) in zip(parsed, lines, strict=True) if re.search(r"\d", line)]
    told = [p for p in said if is_label(p) or any(i.told for i in p) or _pairs(p)]
    if len(told) < max(STEADY * len(said), 1) or all(is_label(p) for p in told):
        return None
    pointed = _with_points(lines)
    parsed = parsed if pointed is lines else [(i, items(line)) for i, line in pointed]
    return _gathered(parsed, dict(pointed))


def _says_no_contact(line: str) -> bool:
    """Return whether a line says in words that nothing touches, as in `t=3 msg="no contact"`."""
    words = re.findall(r"\"([^\"]+)\"|[=:]\s*([A-Za-z][A-Za-z _/-]*)|((?:[A-Za-z_/-]+\s*)+)\Z", line)
    return any(says_nothing(said.strip()) for found in words for said in found if said)


def _pairs(found: Sequence[Item]) -> bool:
    """Return whether a line is of words and numbers in turn, such as "S3 H 512 L 300" or "S1 512/300 | S2 480/270"."""
    strips = sum(i.name.startswith("strip ") for i in found)
    return strips > 1 or (all(i.name for i in found) and any(meaning(i.name).channel for i in found))


def _with_points(lines: list[tuple[int, str]]) -> list[tuple[int, str]]:
    """Return lines with decimal points where they have decimal commas; `ReadingError` where these may be lists."""
    pairs = [p for _, line in lines for p in _COMMA.findall(line)]
    if not pairs or any(re.search(r"\d\.\d|\d,\d+,\d|[,;] ?[A-Za-z]", line) for _, line in lines):
        return lines
    sizes: dict[str, set[int]] = {}  # with how many values each name stands
    for _, line in lines:
        for item in items(line):
            sizes.setdefault(item.name, set()).add(len(item.values))
    places = {len(p.partition(",")[2]) for p in pairs}
    alike = len(places) == 1 and (max(places) <= 2 or all(p.find(",") <= 2 for p in pairs))
    single = alike and any(found == {1, 2} for found in sizes.values())
    if not (single or any(re.search(r"\A0,|,0\d", p) for p in pairs)):
        raise ReadingError(
            f"{pairs[0]!r}: a decimal comma, or two values? Write such numbers with a decimal point"
        )
    return [(i, re.sub(r"(?<=\d),(?=\d)", ".", line)) for i, line in lines]


def _fields(found: Sequence[Item]) -> dict[str, str]:
    """Return a line's values by name; those without a name are counted."""
    fields: dict[str, str] = {}
    unnamed = 0
    for item in found:
        name = item.name
        if not name:
            unnamed += 1
            name = f"column {unnamed}"
        if len(item.values) == 1:
            fields[name] = item.values[0]
        else:
            fields |= {f"{name}[{n}]": value for n, value in enumerate(item.values)}
    return fields


def _gathered(parsed: list[tuple[int, list[Item]]], texts: Mapping[int, str]) -> Table | None:
    """Gather lines to records: labels hold for the lines below, and a name that comes again begins the next record."""
    records: list[dict[str, str]] = []
    above: list[int] = []
    lines: list[int] = []
    labels: dict[str, str] = {}
    record: dict[str, str] = {}
    start = begin = 0
    begins: list[int] = []  # of each record: its first line, or that of its label
    strange = []
    parts: list[tuple[int, set[str]]] = []  # of the record: its lines, and what they name
    pieces: list[list[tuple[int, set[str]]]] = []
    heading: dict[str, int] = {}  # labels of a scan below which no record has come yet, and their lines
    void: list[
        tuple[int, int, dict[str, str]]
    ] = []  # scans without a line: before which record, line, labels

    def flush() -> None:
        nonlocal record, parts
        if record:
            records.append(labels | record)
            lines.append(start)
            begins.append(begin)
            pieces.append(parts)
        record, parts = {}, []

    # What a line that is cut before its first number could hold.
    words = {m.group() for text in texts.values() if (m := re.match(r"[A-Za-z]{2,}", text.strip()))}
    starts = {
        word[:n]
        for word in words
        if sum(t.strip().startswith(word) for t in texts.values()) > 2
        for n in range(2, len(word) + 1)
    }
    for number, found in parsed:
        if not any(i.told or i.name for i in found):
            if not records and not record:
                above.append(number)
            elif found or re.search(r"\d", texts[number]) or texts[number].strip() in starts:
                strange.append(number)
            continue
        fields = _fields(found)
        told = {name: f for name, f in fields.items() if meaning(name).role in _LABELS}
        if any(labels.get(n) != f for n, f in told.items()) or any(name in record for name in fields):
            flush()
        alone = len(told) == len(fields)  # a line that only says which scan the next ones are of
        if heading and not alone and {*heading} <= {*told} and any(told[n] != labels[n] for n in heading):
            # The lines below have a time of their own, another one.
            at = min(heading.values())
            if _says_no_contact(texts[at]):
                void.append((len(records), at, dict(labels)))
            else:
                strange.append(at)
            heading = {}
        if anew := [n for n in told if n in heading and alone]:
            void.append((len(records), heading[anew[0]], dict(labels)))
            heading = {}
        labels = labels | told
        heading |= {n: number for n in told if alone and meaning(n).role in ("scan", "time")}
        if rest := {name: f for name, f in fields.items() if name not in told}:
            start, begin = (start, begin) if record else (number, min([number, *heading.values()]))
            record |= rest
            parts.append((number, {*rest}))
            heading = {}
    flush()
    if not records:
        return None
    kinds = Counter(frozenset(r) for r in records)
    usual, many = kinds.most_common(1)[0]
    strange += [i for i in above if any(re.search(rf"\b{re.escape(n)}\s*[:=]", texts[i]) for n in usual)]
    varied = touched_vary(records)
    for n, (r, lines_of) in enumerate(zip(records, pieces, strict=True)):
        # A line of other names behind those of a record, as of a debugging message, is none of it.
        other = [(i, named) for i, named in lines_of if not (varied or named & usual)]
        if frozenset(r) > usual and other and {*r} - set().union(*(named for _, named in other)) == usual:
            strange += [i for i, _ in other]
            records[n] = {name: f for name, f in r.items() if name in usual}
    empty: set[int] = set()
    strips = [n for n in usual if meaning(n).role == "strip"]
    if heading:
        last = (len(records), min(heading.values()), dict(labels))
        ended = parsed[-1][0] > max(heading.values()) or (void and void[-1][0] == len(records))
        ended = ended or _says_no_contact(texts[last[1]])
        void += [last] if ended else []  # else it may be cut
        strange += [] if ended else [last[1]]
    if void and varied:
        for place, line, told in reversed(void):
            records.insert(place, dict(told))
            lines.insert(place, line)
            begins.insert(place, line)
            pieces.insert(place, [])
    elif void and not strips:
        strange += [line for _, line, _ in void]
    elif void:
        inner = next(list(r) for r in records if frozenset(r) == usual)
        shown = next(r[strips[0]] for r in records if strips[0] in r)
        for place, line, told in reversed(void):
            if {*told} <= usual:
                records.insert(place, dict.fromkeys(inner, "") | told | {strips[0]: shown})
                lines.insert(place, line)
                pieces.insert(place, [])
                empty.add(line)
            else:
                strange.append(line)
    if varied:  # what a line that is not understood says of its scan is not known
        spans = list(zip(begins, [*begins[1:], parsed[-1][0] + 1], strict=True))
        words = {w.casefold() for n in usual for w in re.findall(r"[A-Za-z]+", n)}
        lost = [i for i in strange if not is_prose(texts[i], words)]
        hit = [any(a <= i < b for i in lost) for a, b in spans]
        strange += [i for out, lines_of in zip(hit, pieces, strict=True) for i, _ in lines_of if out]
        records = [r for r, out in zip(records, hit, strict=True) if not out]
        lines = [i for i, out in zip(lines, hit, strict=True) if not out]
        if not records:
            return None
    elif many >= _FEW_KINDS * len(records):
        named = {i: [n for n, _ in lines_of] for i, lines_of in zip(lines, pieces, strict=True)}
        odd = [(i, r) for i, r in zip(lines, records, strict=True) if frozenset(r) != usual]
        kept = [(i, r) for i, r in zip(lines, records, strict=True) if frozenset(r) == usual]
        lines, records = [i for i, _ in kept], [r for _, r in kept]
        names = list(records[0])
        # Of other names altogether, or the end of a line in the middle of which the log begins.
        above += [i for i, r in odd if i < lines[0] and (not usual & {*r} or list(r) == names[-len(r) :])]
        strange += [n for i, _ in odd if i not in above for n in named[i] or [i]]
    above = [i for i in above if i not in strange]
    words = {w.casefold() for n in usual for w in re.findall(r"[A-Za-z]+", n)}
    prose = [i for i in strange if is_prose(texts[i], words)]
    strange = [i for i in strange if i not in prose]
    said = [f"{len(above)} line(s) above passed over"] if above else []
    said += [f"line(s) {', '.join(map(str, prose))}: messages, passed over"] if prose else []
    table = of_records(records, lines, ".", "each line names its values", *said)
    quotes = {i: texts[i].strip() for i in strange}
    if empty:
        table = replace(
            table, remarks=(*table.remarks, f"{len(empty)} scan(s) without a line: nothing touches in them")
        )
    return replace(
        table,
        broken=tuple(sorted({*strange})),
        preamble=tuple(texts[i] for i in above),
        quotes=quotes,
        empty=frozenset(empty),
        varied=varied > 1,
    )


def touched_vary(records: Sequence[Mapping[str, str]]) -> int:
    """Return whether records name other strips from one to the next, each with all of its channels.

    2 if so because others are touched; 1 if strips are missing as where lines are cut, too; 0 if not, or if one record
    is cut.

    Examples
    --------
    >>> touched_vary([{"h1": "5", "l1": "4", "h2": "3", "l2": "2"}, {"h2": "5", "l2": "4", "h3": "3", "l3": "2"}])
    2
    >>> touched_vary([{"h1": "5", "l1": "4", "h2": "3", "l2": "2"}, {"h1": "5", "l1": "4", "h2": "3"}])
    0
    """
    if len({frozenset(r) for r in records}) < 2:
        return 0
    split = {n: m.groups() for n in {*itertools.chain(*records)} if (m := _STRIP_NAMED.match(n))}
    vary = {(a, c) for n, (a, _, c) in split.items() if not all(n in r for r in records)}
    split = {n: (a, number, c) for n, (a, number, c) in split.items() if (a, c) in vary}
    common = [n for n in {*itertools.chain(*records)} if n not in split]
    ends = {(a, c) for a, _, c in split.values()}
    sets: list[frozenset[int]] = []
    for record in records:
        if any(n not in record for n in common):
            return 0
        many_of = Counter(int(split[n][1]) for n in record if n in split)
        if any(many != len(ends) for many in many_of.values()):
            return 0
        sets.append(frozenset(many_of))
    usual = Counter(sets).most_common(1)[0][0]
    if not usual:
        return 0
    cut = []
    for n, there in enumerate(sets):
        if there == usual:
            continue
        run = bool(there) and max(there) - min(there) == len(there) - 1
        cut.append(not run or (there < usual and (n == 0 or max(there) < max(usual))))
    return 0 if len(cut) == sum(cut) == 1 else 1 + (not all(cut))


def of_literals(text: str, path: str | Path) -> Table | None:
    """Return JSON or what Python prints as a table: lines of objects or lists, an array of them, an object of columns.

    None where it is none of these.
    """
    if "[" not in text and "{" not in text:
        return None
    found, broken = _json(text, path) if text.lstrip()[:1] in ("{", "[") else ([], [])
    around: list[tuple[int, str]] = []
    if found is None or not any(isinstance(value, dict | list) for _, value in found):
        found, around = literals(text)
        broken = [i for i, line in around if re.search(r"\d", line) and not is_prose(line)]
    if len(found) == 1 and isinstance(found[0][1], dict):
        table = of_values(found[0][1], path)
    else:
        table = of_values(found, path, numbered=True)
    if table is None:
        return None
    above = tuple(line for i, line in around if found and i < found[0][0])
    quotes = {i: line for i, line in around if i in broken}
    return replace(table, broken=tuple(broken), quotes=quotes, preamble=(*above, *table.preamble))


def of_values(
    value: Any, path: str | Path, told: str = "records in JSON", *, numbered: bool = False
) -> Table | None:
    """Return records, lists or an object of columns as a table; None where they are none. Perhaps with their lines."""
    above: tuple[str, ...] = ()
    found = value if numbered else list(enumerate(_rows_of(value), 1))
    if not numbered and isinstance(value, dict) and found[0][1] is not value:
        above = said_above({k: v for k, v in value.items() if not isinstance(v, list)})
    rows = [(i, row) for i, row in found if isinstance(row, list | tuple)]
    if rows and len(rows) == len(found):
        table = _of_lists(rows)
        return table and replace(table, preamble=above)
    records, lines = [], []
    empty: set[int] = set()
    exploded = [(i, row, _exploded(row)) for i, row in found if isinstance(row, dict)]
    kinds = Counter(key for _, row, _ in exploded if (key := _list_within(row)))
    inner = kinds.most_common(1)[0][0] if kinds else ""
    names = {n: "" for _, _, many in exploded for r in many for n in r if n.startswith(f"{inner}.")}
    strip = [n for n in names if meaning(n).role == "strip"]
    shown = next((r[strip[0]] for _, _, many in exploded for r in many if strip and strip[0] in r), "")
    for number, row, many in exploded:
        parts = _unfolded("", row)
        if inner and shown and parts.get(inner) == []:  # nothing touches in it
            del parts[inner]
            many = [flattened("", parts) | names | {strip[0]: shown}]
            empty.add(number)
        records += many
        lines += [number] * len(many)
    if not records:
        return None
    varied = touched_vary(records) > 1 and all(all(r.values()) for r in records)
    remarks = [f"{len(empty)} scan(s) with an empty list: nothing touches in them"] if empty else []
    table = of_records(records, lines, ".", told, *remarks)
    return replace(table, preamble=above, varied=varied, empty=frozenset(empty))


def _of_lists(rows: Sequence[tuple[int, Any]]) -> Table | None:
    """Return lists of lists as a table without names, in the order of their places; None where the log is no table."""
    table = of_records([flattened("", list(value)) for _, value in rows], [i for i, _ in rows])
    order = sorted(table.names, key=lambda key: [int(n) for n in re.findall(r"\d+", key)])
    if len(order) < 2 or any(re.search(r"[^\[\]\d]", key) for key in order):
        return None
    fields = [list(row) for row in zip(*(table.column(key) for key in order), strict=True)]
    names = tuple(f"column {n + 1}" for n in range(len(order)))
    return Table(names, fields, table.lines, named=False, remarks=("rows of lists",))


def _json(text: str, path: str | Path) -> tuple[list[tuple[int, Any]] | None, list[int]]:
    """Return the values of JSON, whole or in lines, with their lines, and the broken lines; None where it is none."""
    plain = re.sub(r"(?<=[:\[, ])-?(?:NaN|Infinity)\b", "null", text)
    found: list[tuple[int, Any]] = []
    broken = []
    try:
        whole = json.loads(plain)
    except RecursionError:
        raise ReadingError(f"{path}: JSON of too many levels") from None
    except ValueError:
        for number, line in enumerate(plain.splitlines(), 1):
            try:
                found += [(number, json.loads(line.rstrip().rstrip(",")))] if line.strip() else []
            except (ValueError, RecursionError):
                value = literal(line)
                if value is None:
                    broken.append(number)
                else:
                    found.append((number, value))
        if not any(isinstance(value, dict) for _, value in found) or len(found) < len(broken):
            return None, []
        if broken and broken[0] < found[0][0] and not plain.lstrip().startswith("{"):
            del broken[0]  # the log begins in the middle of it
        return found, broken
    if isinstance(whole, dict):
        return [(1, whole)], []
    rows = list(enumerate(_rows_of(whole), 1))
    if rows and not any(isinstance(r, dict | list) for _, r in rows):
        return None, []
    return rows, []


def _rows_of(value: Any) -> list[Any]:
    """Return a JSON value as records: itself, the list in it, or its columns turned."""
    if isinstance(value, list):
        return value
    value = _with_names(value) if isinstance(value, dict) else value
    lists = {k: v for k, v in value.items() if isinstance(v, list)} if isinstance(value, dict) else {}
    tables = [v for v in lists.values() if v and all(isinstance(r, dict) for r in v)]
    if len(tables) == 1 and len(lists) == 1 and len(tables[0]) > 1:
        return tables[0]
    if isinstance(value, dict) and any(
        k not in lists and meaning(k).role in ("time", "scan") and not isinstance(v, dict)
        for k, v in value.items()
    ):
        return [value]  # one scan
    rows = [(k, v) for k, v in lists.items() if len(v) > 1 and all(isinstance(r, list) for r in v)]
    if len(rows) == len(lists) == 1 and len({len(r) for r in rows[0][1]}) == 1:  # one matrix
        key, matrix = rows[0]
        return [list(c) for c in zip(*matrix, strict=True)] if meaning(key).role == "strip" else matrix
    columns = lists
    if isinstance(value, dict) and len(value) > 1 and all(isinstance(v, dict) for v in value.values()):
        columns = {k: list(v.values()) for k, v in value.items()}  # as pandas writes it
    if len(columns) > 1 and len({len(v) for v in columns.values()}) == 1:
        return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    return [value]


def _with_names(record: Mapping[str, Any]) -> dict[str, Any]:
    """Return a record with records in place of lists of as many values as a list of names beside them has.

    Examples
    --------
    >>> _with_names({"columns": ["strip", "h"], "data": [[0, 2.5], [1, 2.4]]})
    {'entry': [{'strip': 0, 'h': 2.5}, {'strip': 1, 'h': 2.4}]}
    """
    lists = {k: v for k, v in record.items() if isinstance(v, list) and v}
    named = [k for k, v in lists.items() if len(v) > 1 and all(isinstance(name, str) for name in v)]
    rows = [
        k for k, v in lists.items()
        if len(named) == 1 and all(isinstance(row, list) and len(row) == len(lists[named[0]]) for row in v)
    ]  # fmt: skip
    if len(named) != 1 or len(rows) != 1 or len({*lists[named[0]]}) < len(lists[named[0]]):
        return dict(record)
    others = {k: v for k, v in record.items() if k not in (named[0], rows[0])}
    return others | {"entry": [dict(zip(lists[named[0]], row, strict=True)) for row in lists[rows[0]]]}


def _exploded(record: Mapping[str, Any]) -> list[dict[str, str]]:
    """Return a record as rows: one, or one for each element of the only list of records that is in it."""
    record = _with_names(record)
    inner, parts = _list_within(record), _unfolded("", record)
    if not inner:
        return [flattened("", dict(record))]
    outer = flattened("", {k: v for k, v in parts.items() if k != inner})
    return [outer | flattened(inner, element) for element in parts[inner]]


def _list_within(record: Mapping[str, Any]) -> str:
    """Return the name of the only list of records that is in a record; "" where there is none, or several."""
    parts = _unfolded("", _with_names(record))
    inner = [k for k, v in parts.items() if isinstance(v, list) and v and all(isinstance(e, dict) for e in v)]
    return inner[0] if len(inner) == 1 else ""


def _unfolded(name: str, record: Mapping[str, Any]) -> dict[str, Any]:
    """Return a record with the parts of the records in it beside its own."""
    parts: dict[str, Any] = {}
    for key, value in record.items():
        key = f"{name}.{key}" if name else str(key)
        parts |= _unfolded(key, value) if isinstance(value, dict) and value else {key: value}
    return parts
