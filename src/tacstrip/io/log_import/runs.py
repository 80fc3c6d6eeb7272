"""Lines with a pair of values for each strip behind its label, as "t=5 P0:512/300 P1:xx/xx", among others."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from tacstrip.io.log_import.fields import STAMP, is_prose, says_nothing
from tacstrip.io.log_import.names import READING_UNITS, UNITS, meaning
from tacstrip.io.log_import.statements import order_said
from tacstrip.io.log_import.table import Table

_LABEL = re.compile(
    r"(?<![\w.])(?P<word>[A-Za-z]{0,8})[ _-]?#?(?P<strip>\d{1,3})(?P<sign>\s*[:=\[({<]|(?=\s))"
)
_BARE = re.compile(r"(?<![\w.:])(?P<word>)#?(?P<strip>\d{1,3})(?P<sign>\s*[:=\[({<])")
_NUMBER = r"[-+]?(?:0[xX][\dA-Fa-f]+|\d+(?:\.\d+)?)"
_VOID = r"[A-Za-z][A-Za-z ./]{0,13}|[-.*_xX?~]{1,9}"
_UNIT = r"(?:\s?(?P<unit{}>mV|V|uV|%)(?![A-Za-z]))?"
_PAIR = re.compile(
    rf"[\s:=]*(?P<open>[\[({{<]?)\s*(?P<a>{_NUMBER}|{_VOID}){_UNIT.format(1)}(?:\s*[/,;|]\s*|\s+)"
    rf"(?P<b>{_NUMBER}|{_VOID}){_UNIT.format(2)}\s*(?P<close>[\])}}>]?)(?P<rest>.*)\Z"
)
_NOTHING = re.compile(rf"[\s:=]*(?P<open>[\[({{<]?)\s*(?P<a>{_VOID})\s*(?P<close>[\])}}>]?)(?P<rest>.*)\Z")
_CLOSES = {"": "", "[": "]", "(": ")", "{": "}", "<": ">"}
_BETWEEN = re.compile(r"[\s,;|]*")
_SLOT = re.compile(
    rf"(?P<address>\b\d+(?:\.\d+){{3}}\b)|(?P<clock>{STAMP})"
    r"|(?<![A-Za-z.\d])(?P<number>\d+(?:\.\d+)?)(?:\s?(?P<unit>ms|us|\u00b5s|s|sec)\b)?"
)
_WORD = re.compile(r"([A-Za-z_]+)[\s#=:+(@.]*\Z")
_ESP_IDF = re.compile(r"[EWIDV] \(\Z")  # of which the manual says that it counts milliseconds
_LEVEL = re.compile(r"\b(?:TRACE|DEBUG|INFO|NOTICE|WARN(?:ING)?|ERROR|[DIWE])\b")
_LAST_WORDS = re.compile(r"[\s:=]*([^\W\d_][^\d|;,:=]*)\Z")  # as in "t=0.3 | no contact"
_VOID_END = re.compile(
    r"[\s:=]*(?:[-.*_xX?~]{1,9}|\b(?:none|nothing|open|empty|idle)\b)?[\s.]*\Z", re.IGNORECASE
)
_USUAL = 0.6  # of the lines
_FEW = 2  # lines
_MARKS = " |,;:-([{"  # between what stands before the strips and the first of these
_WORDS = 4  # that may be the strips'
_SHOWN = 5


@dataclass(frozen=True)
class _Line:
    """A line: what stands before its first label, the fields in it, a pair for each strip, and what stands behind."""

    head: str
    form: str
    fields: tuple[tuple[str, str], ...]  # name and text
    pairs: dict[str, tuple[str, str]]
    marks: tuple[str, ...]
    rest: str


def of_runs(text: str) -> Table | None:
    """Return lines of labelled pairs as a table of a line per strip; None where the log is not of these.

    Other lines between are messages if they are words, and broken if they may hold readings.
    """
    every = [(n, line) for n, line in enumerate(text.splitlines(), 1) if line.strip()]
    label, best = _most_labelled(every)
    if len(best) < _FEW or not any("".join(p) for line in best.values() for p in line.pairs.values()):
        return None
    heads, _ = Counter(tuple(name for name, _ in line.fields) for line in best.values()).most_common(1)[0]
    strange = [n for n, line in best.items() if tuple(name for name, _ in line.fields) != heads]
    best = {n: line for n, line in best.items() if n not in strange}
    form, _ = Counter((line.form, line.rest) for line in best.values()).most_common(1)[0]
    sets = [tuple(line.pairs) for line in best.values()]
    usual, often = Counter(sets).most_common(1)[0]
    # Else lines with other strips are cut, and these are the first ones of the usual.
    touched_only = often <= _USUAL * len(best) or sum(s != usual[: len(s)] for s in sets) > _FEW
    cut = [n for n, line in best.items() if not touched_only and tuple(line.pairs) != usual]
    there = [(n, line) for n, line in every if touched_only and n not in best and n not in strange]
    # Of a single strip only where the others tell what stands before it.
    alone = {n: made for n, line in there if (made := _parsed(line, label, 1)) and made.form == form[0]}
    best |= {n: made for n, made in alone.items() if tuple(name for name, _ in made.fields) == heads}
    there = [(n, line) for n, line in there if n not in best]
    voids = {n: made for n, line in there if (made := _without_contact(line, usual[0], form[0])) is not None}
    best = dict(sorted((best | voids).items()))
    first = min({*best} - {*cut})
    odd = [(n, line) for n, line in every if n > first and n not in best]
    numeric = [n for n, line in odd if _may_be_cut(line, label, form[0])]
    numeric += [n for n, line in every if n < first and _holds_strips(line, label, usual)]
    broken = sorted({*numeric, *cut, *strange})
    if len(best) - len(cut) < max(_FEW, (1.0 - _USUAL) * (len(best) + len(numeric))):
        return None
    best = {n: line for n, line in best.items() if n not in cut}
    above = [line for n, line in every if n < first and n not in strange]
    around = [*above, *(line for n, line in odd if n not in broken)]
    return _table(
        best, dict(every), label, form, above, around, [n for n, _ in odd if n not in broken], broken, voids
    )


def _most_labelled(every: Sequence[tuple[int, str]]) -> tuple[str, dict[int, _Line]]:
    """Return the word before strips' numbers by which most lines are understood, and these lines."""
    words = Counter(w for _, line in every for w in {m["word"] for m in _LABEL.finditer(line)} - {""})
    best: dict[int, _Line] = {}
    label = ""
    for word in ["", *(word for word, _ in words.most_common(_WORDS))]:
        found = {n: made for n, line in every if (made := _parsed(line, word)) is not None}
        best = found if len(found) > len(best) else best
        label = word if best is found else label
    return label, best


def _table(
    best: Mapping[int, _Line], texts: Mapping[int, str], label: str, form: tuple[str, str], above: Sequence[str],
    around: Sequence[str], messages: Sequence[int], broken: Sequence[int], voids: Mapping[int, _Line],
) -> Table:  # fmt: skip
    """Return lines as a table of a line per strip; others are `above` them or `around`, messages or broken."""
    order = order_said([*around, form[1]])
    first = min(best)
    titles = _names(above, best[first], texts[first])
    names, kept = _of_fields(titles, [line.fields for line in best.values()])
    unit = _unit_of(best, f"{form[0]} {form[1]}")
    counted = not any(meaning(name).role in ("time", "scan") for name in names)
    senders = Counter(_LEVEL.sub("", line.form) for line in best.values())
    several = sum(many >= _FEW for many in senders.values()) > 1  # as "left 0:5/4" and "right 0:5/4"
    labels = [
        [*[str(count)] * counted, *[_LEVEL.sub("", line.form)] * several, *(line.fields[k][1] for k in kept)]
        for count, line in enumerate(best.values())
    ]
    rows = [
        [*of, strip, *pair]
        for of, line in zip(labels, best.values(), strict=True)
        for strip, pair in line.pairs.items()
    ]
    lines = [n for n, line in best.items() for _ in line.pairs]
    strip, values = max(best[first].pairs.items(), key=lambda item: len("".join(item[1])))  # not 0 and 0
    told = [
        f"each line has a pair of values for each strip, such as {' and '.join(values)} of strip {label}{strip}; the "
        f"{'two' if order else 'first is called a, the second b'}"
    ]
    if messages:
        shown = ", ".join(map(str, messages[:_SHOWN])) + (", ..." if len(messages) > _SHOWN else "")
        told.append(f"line(s) {shown}: messages among the readings, passed over")
    ends = [f"{end}{unit}" for end in order or "ab"]
    return Table(
        (*["scan"] * counted, *["source"] * several, *names, "strip", *ends), rows, lines, ".", True, tuple(told),
        tuple(broken),
        (*around, form[1].strip()), quotes={n: texts[n].strip() for n in broken}, empty=frozenset(voids),
    )  # fmt: skip


def _unit_of(best: Mapping[int, _Line], around: str) -> str:
    """Return " [V]" or the like: the unit that the pairs, or else words around these, say; "" where not one does."""
    said = {mark for line in best.values() for mark in line.marks} or {
        unit
        for w in re.findall(r"[^\W\d_]+", around)
        if (unit := UNITS.get(w.casefold(), "")) in READING_UNITS
    }
    return f" [{said.pop()}]" if len(said) == 1 else ""


def _may_be_cut(line: str, word: str, form: str) -> bool:
    """Return whether a line may be left of one of the readings: it has a strip's label, or begins as they do."""
    if not re.search(r"\d", line):
        return False
    labels = (_LABEL if word else _BARE).finditer(re.sub(STAMP, "", line, count=1))
    if any(m["word"] == word and m["sign"].strip() for m in labels):
        return True
    begin = " ".join(_SLOT.sub("0", line).split())
    return (
        form.startswith(begin)
        or (
            bool(form)
            and begin.startswith(form)
            and bool(re.search(r"\d", begin[len(form) :]) or not is_prose(line))
        )
        or not re.search(r"[^\W\d_]{2}", line)
    )


def _holds_strips(line: str, word: str, usual: Sequence[str]) -> bool:
    """Return whether a line has the labels of the usual strips, and numbers behind some, whatever stands between."""
    form = _LABEL if word else _BARE
    found = [m["strip"] for m in form.finditer(line) if m["word"] == word and m["sign"].strip()]
    return found == [*usual] and bool(re.search(r"\d", form.sub("", line[line.index(found[0]) :])))


def _parsed(line: str, word: str, fewest: int = 2) -> _Line | None:
    """Return a line's parts; None where it has not as many labels or more that count up, each with a pair or a void."""
    labels = [m for m in _LABEL.finditer(line) if m["word"] == word] if word else [*_BARE.finditer(line)]
    runs: list[list[re.Match[str]]] = []
    for m in labels:
        if runs and int(m["strip"]) > int(runs[-1][-1]["strip"]):
            runs[-1].append(m)
        else:
            runs.append([m])
    run = max(runs[::-1], key=len, default=[])  # of runs as long the last: before it stands a time
    while len(run) >= fewest:  # what stands before may look like a label, as a time in "5 0: 1/2 1: 3/4"
        made = _of_run(line, run)
        if made is not None:
            return made
        run = [] if word else run[1:]
    return None


def _of_run(line: str, run: Sequence[re.Match[str]]) -> _Line | None:
    ends = [*(m.start() for m in run[1:]), len(line)]
    pairs, marks, rest = {}, [], ""
    steps = {int(b["strip"]) - int(a["strip"]) for a, b in pairwise(run)}
    if min(steps, default=1) < 1:
        return None
    for m, end in zip(run, ends, strict=True):
        start = m.end() - len((m["sign"] or "").lstrip()) if m["sign"].strip() not in (":", "=") else m.end()
        inner = line[start:end]
        void = _NOTHING.fullmatch(inner)
        found = void if void and not re.search(r"\d", void["a"]) and _plain(void) else _PAIR.fullmatch(inner)
        if found is None or _CLOSES[found["open"]] != found["close"]:
            return None
        if end == len(line):
            rest = found["rest"]
            if re.search(r"\d", rest):
                return None
        elif not _BETWEEN.fullmatch(found["rest"]):
            return None
        both = (found["a"],) if found is void else (found["a"], found["b"])
        if not all(both) or (found is not void and not _is_pair(both)):
            return None
        marks += [found[f"unit{n}"] for n in (1, 2) if found is not void and found[f"unit{n}"]]
        values = ["" if _says_nothing(v.strip()) else v.strip() for v in both]
        pairs[m["strip"]] = (values[0], values[-1])
    head = line[: run[0].start()]
    form, fields = _of_head(head)
    return _Line(head, form, fields, pairs, tuple(marks), rest)


def _of_head(head: str) -> tuple[str, tuple[tuple[str, str], ...]]:
    """Return the form of what stands before a line's first label, and its fields: name and text."""
    fields, form, at = [], "", 0
    for slot in _SLOT.finditer(head):
        before = head[at : slot.start()]
        form += before + "0"
        at = slot.end()
        named = _WORD.search(before)
        name = named[1] if named and not _ESP_IDF.search(before) else ""
        if slot["clock"]:
            name = "time stamp"
        elif unit := "ms" if _ESP_IDF.search(before) else slot["unit"]:
            name = f"{name if meaning(name).role == 'time' else 'time'} [{unit}]"
        fields.append((name, slot["clock"] or slot["address"] or slot["number"]))
    return " ".join((form + head[at:]).split()), tuple(fields)


def _without_contact(line: str, strip: str, form: str) -> _Line | None:
    """Return a line that has nothing, or a mark for it, where others have strips, as one of an untouched strip."""
    said = _LAST_WORDS.search(line)
    head = (
        line[: said.start()] if said and says_nothing(said[1].strip(" ()[]{}.!")) else _VOID_END.sub("", line)
    )
    head = head.rstrip()
    made, fields = _of_head(head.rstrip(_MARKS))
    alike = made == form.rstrip(_MARKS)  # what parts it from the first strip may be missing
    return _Line(head, form, fields, {strip: ("", "")}, (), "") if fields and alike else None


def _plain(void: re.Match[str]) -> bool:
    return void["rest"].strip(" ,;|") == "" or void["rest"].lstrip()[:1] == "("


def _is_pair(values: Sequence[str]) -> bool:
    return all(re.match(_NUMBER, v) or _says_nothing(v) or v == values[0] for v in values)


def _says_nothing(text: str) -> bool:
    return says_nothing(text) or re.fullmatch(r"[-.*_?~]+|([xX])\1*", text) is not None


def _names(above: Sequence[str], line: _Line, text: str) -> list[str]:
    """Return the names of what stands before the first label: own ones, or those of a line above of as many fields."""
    for mark in ("\t", ";", ","):
        parts = text.split(mark)
        for row in reversed(above):
            names = [name.strip() for name in row.split(mark)]
            if len(names) == len(parts) > 1 and sum(bool(_SLOT.search(p)) for p in parts[:-1]) == len(
                line.fields
            ):
                return [n for n, p in zip(names, parts[:-1], strict=False) if _SLOT.search(p)]
    return [name for name, _ in line.fields]


def _of_fields(
    names: list[str], fields: Sequence[tuple[tuple[str, str], ...]]
) -> tuple[list[str], list[int]]:
    """Return the names of the fields that say something of scans, not always the same, and their places."""
    kept = [n for n in range(len(names)) if len({row[n][1] for row in fields}) > 1]
    named = [names[n] or f"column {n + 1}" for n in kept]
    if len(kept) == 1 and not names[kept[0]]:
        named = ["time"]
    twice = Counter(named)
    named = [f"{name} ({n})" if twice[name] > 1 else name for n, name in enumerate(named)]
    return [name if not UNITS.get(name) else f"time [{UNITS[name]}]" for name in named], kept
