"""Lines of a text as values, times, words and marks, whatever their form; lines of one form are rows of one kind."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

from tacstrip.io.log_import.fields import STAMP, says_nothing
from tacstrip.io.log_import.names import UNITS

VALUE, TIME, WORD = "#", "@", "w"
_UNITS = "|".join(sorted((re.escape(u) for u in UNITS if len(u) < 8), key=len, reverse=True))
_DATE = r"\d{4}-\d\d-\d\d|\d\d?[./]\d\d?[./]\d{4}"
_OF_DAY = r"(?:\d+:)?\d\d?:\d\d(?:[.,]\d+)?"
_HEX = r"0[xX][\dA-Fa-f]+|(?=[\dA-Fa-f]*\d)(?=[\dA-Fa-f]*[A-Fa-f])[\dA-Fa-f]{3,8}(?![eE]?[-+.])|[A-F]{3,8}"
_MARKS = (
    r"(?<![^\s,;|/:=(\[{<>'\"])"
    r"(?:-{1,5}(?!>)|\*{1,9}|_{1,5}|\.{1,5}|\?{1,3}|\+{2,9}|[-+]?\u221e|\u2013|\u2014)"
    r"(?![^\s,;|/:)\]}>'\"])"
    r"|(?<=[A-Za-z])(?:-{2,5}|\*{2,5}|\?{2,5})(?=[A-Z\s,;|/:]|\Z)"  # as in "H----L----"
    r"|(?<=[/:|])-{2,5}(?=>)"  # the last of a frame
)
_SEPARATORS = ";|,"
_AROUND = frozenset("[](){}<>,;")  # a row, of which the first and the last have others
_PAIRS = "/:|~"
_FEW = 3  # lines of one form
_MOST_FORMS = 4  # of which the values may be the readings


def _pattern(decimal: str) -> re.Pattern[str]:
    number = rf"(?:(?<![\w.])[+-])?(?:\d+(?:\{decimal}\d*)?|\{decimal}\d+)(?:[eE][+-]?\d+)?"
    return re.compile(
        rf"(?P<time>(?<![\w.])(?:{STAMP}|(?:{_DATE})(?:[T ]{_OF_DAY})?|{_OF_DAY})(?![\w]))"
        rf"|(?P<hex>(?<![\w.])(?:{_HEX})(?![\w.])|(?<=\b[G-Zg-z])[\dA-Fa-f]{{6,8}}(?![\w.]))"
        rf"|(?P<value>{number}(?:\s?(?!S)(?i:{_UNITS})(?![\w]))?)"
        rf"|(?P<none>{_MARKS})"
        # A cross may stand between letters, as in "HxLx".
        r"|(?P<word>[A-Z](?=(?:x|nan|NaN)(?:[A-Z](?:x|nan|NaN))*(?![^\W\d_]))|(?<=[A-Z])(?:x|nan|NaN)(?![a-z])|[nN]/[aA](?!\w)|\b(?:[^\W\d_]\.){2,}|[^\W\d_]+)"
        r"|(?P<other>\S)"
    )


_PATTERNS = {decimal: _pattern(decimal) for decimal in ".,"}


@dataclass(frozen=True)
class Line:
    """A line's number, what it consists of (`VALUE`, `TIME`, `WORD` or the mark itself), and the texts of these.

    And the numbers of further lines that are of the same record.
    """

    number: int
    form: str
    texts: tuple[str, ...]
    others: tuple[int, ...] = ()


def parted(number: int, text: str, decimal: str = ".") -> Line:
    """Return what a line consists of.

    Examples
    --------
    >>> line = parted(1, "[10:00:01] S3: H=2.5V L=--- ok")
    >>> line.form, line.texts[5:11]
    ('@]w#:w=#w=#w', ('H', '=', '2.5V', 'L', '=', '---'))
    >>> parted(1, "1;;2,5", ",").texts
    ('1', ';', '', ';', '2,5')
    """
    if "\t" in text.strip("\r\n"):
        return _of_tabs(number, text.strip("\r\n"), decimal)
    by = next((mark for mark in _SEPARATORS if mark in text and mark != decimal), "")
    form: list[str] = []
    texts: list[str] = []

    def add(symbol: str, what: str) -> None:
        if symbol == by and (not form or form[-1] == by):  # nothing stands between two separators
            add(VALUE, "")
        if form and symbol == form[-1] == WORD and len(what) > 1 < len(texts[-1]):
            texts[-1] += f" {what}"
            return
        form.append(symbol)
        texts.append(what)

    for token in _PATTERNS[decimal].finditer(text):
        kind, what = token.lastgroup, token[0].strip()
        if (
            kind == "word"
            and form[-1:] == [VALUE]
            and what.casefold() in UNITS
            and says_nothing(texts[-1])
            and texts[-1]
        ):
            continue  # as in "nan V"
        if kind == "word" and (says_nothing(what) or what in ("x", "X")):
            kind = "none"
        add({"time": TIME, "word": WORD, "other": what}.get(kind or "", VALUE), what)
    if form[-1:] == [by] and form[-2:-1] in ([VALUE], [WORD], [by]):
        add(VALUE, "")
    while form and form[0] in _AROUND:
        form, texts = form[1:], texts[1:]
    while form and form[-1] in _AROUND:
        form, texts = form[:-1], texts[:-1]
    return Line(number, "".join(form), tuple(texts))


def _of_tabs(number: int, text: str, decimal: str) -> Line:
    """Return what a line consists of whose fields tabs separate."""
    form, texts = "", ()
    for n, field in enumerate(text.split("\t")):
        part = parted(number, field, decimal) if field.strip() else Line(number, VALUE, ("",))
        mark = ("", ()) if n == 0 else ("\t", ("\t",))
        form, texts = form + mark[0] + part.form, (*texts, *mark[1], *part.texts)
    return Line(number, form, texts)


def in_pairs(lines: Sequence[Line]) -> list[Line]:
    """Return lines with two values for each one that says nothing alone where others have a pair, as 2.5/1.1."""
    many = Counter(mark for line in lines for mark in _PAIRS for _ in range(line.form.count(f"#{mark}#")))
    if not many or many.most_common(1)[0][1] < _FEW * _FEW:
        return list(lines)
    mark = many.most_common(1)[0][0]
    if all(_is_label(line.form, mark) for line in lines if f"#{mark}#" in line.form):
        return list(lines)
    made = [_paired(line, mark) for line in lines]
    return made if _most_alike(made) > _most_alike(lines) else list(lines)


def _most_alike(lines: Sequence[Line]) -> int:
    return max(Counter(line.form for line in lines).values())


def _is_label(form: str, mark: str) -> bool:
    """Return whether a mark only parts the first number of a line from the others, as in "5: 2.5 1.9"."""
    return form.startswith(f"#{mark}#") and form.count(mark) == 1 and form.count(VALUE) > 2


def _paired(line: Line, mark: str) -> Line:
    form, texts = "", []
    for n, (symbol, text) in enumerate(zip(line.form, line.texts, strict=True)):
        alone = (
            symbol == VALUE
            and says_nothing(text) | (text in "xX")
            and mark not in line.form[max(n - 1, 0) : n + 2]
        )
        form += f"#{mark}#" if alone else symbol
        texts += [text, mark, text] if alone else [text]
    return replace(line, form=form, texts=tuple(texts))


def kinds_of_rows(lines: Sequence[Line]) -> list[list[Line]]:
    """Return the lines of each form that many have, those that hold the most values first.

    Words in the place of a value, and remarks behind all else, are of the form without them.
    """
    lines = with_marks(lines)
    many = Counter(line.form for line in lines)
    forms = [f for f, often in many.items() if often >= _FEW and VALUE in f]
    forms.sort(key=lambda f: -many[f] * f.count(VALUE))
    found: list[list[Line]] = []
    for form in forms[:_MOST_FORMS]:
        rows = [row for line in lines if (row := _as_of(line, form)) is not None]
        if not any({r.number for r in rows} <= {r.number for r in other} for other in found):
            found.append(rows)
    return found


def with_marks(lines: Sequence[Line]) -> list[Line]:
    """Return lines with a value for each word that stands in many lines where others of the same form have one."""
    alike: dict[str, list[Line]] = {}
    for line in lines:
        alike.setdefault(line.form.replace(WORD, VALUE), []).append(line)
    often: Counter[str] = Counter()
    for group in alike.values():
        mixed = [{*symbols} == {WORD, VALUE} for symbols in zip(*(g.form for g in group), strict=True)]
        for g in group:  # a line of units or names has its words in no other
            places = zip(g.form, g.texts, mixed, strict=True)
            often.update({text for symbol, text, so in places if so and symbol == WORD})
    marks = {text for text, many in often.items() if many >= _FEW}
    return [
        replace(
            line,
            form="".join(
                VALUE if symbol == WORD and text in marks else symbol
                for symbol, text in zip(line.form, line.texts, strict=True)
            ),
        )
        for line in lines
    ]


def _as_of(line: Line, form: str) -> Line | None:
    """Return a line as one of a form; None where it is none."""
    if line.form == form:
        return line
    if line.form.startswith(form) and WORD in line.form[len(form) :] and VALUE not in line.form[len(form) :]:
        return replace(line, form=form, texts=line.texts[: len(form)])
    if len(line.form) != len(form) or not {VALUE, TIME} & {*line.form}:  # units or names below each other
        return None
    unlike = [(a, b) for a, b in zip(line.form, form, strict=True) if a != b]
    alike = sum(a == b != WORD for a, b in zip(line.form, form, strict=True))
    if all((a, b) in ((WORD, VALUE), (VALUE, WORD)) for a, b in unlike) and alike > len(unlike):
        return replace(line, form=form)
    return None
