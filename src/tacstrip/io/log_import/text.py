"""A text log as a table: how it is encoded, what stands before its lines, what separates its fields, its blocks."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

from tacstrip.errors import ReadingError
from tacstrip.io.log_import.announced import with_announced
from tacstrip.io.log_import.box_print import upright_records, without_boxes
from tacstrip.io.log_import.by_content import of_content
from tacstrip.io.log_import.changes import in_parts
from tacstrip.io.log_import.channel_names import (
    order_told_otherwise,
    strips_told_otherwise,
    with_channel_names,
)
from tacstrip.io.log_import.conversion import resolutions
from tacstrip.io.log_import.cut import (
    refuse_cut_array,
    with_cut_lines_doubted,
    without_cut_end,
    without_cut_units,
)
from tacstrip.io.log_import.delimiters import of_sent, without_prefix
from tacstrip.io.log_import.dialects import of_dialect
from tacstrip.io.log_import.envelope import (
    bare,
    with_stamps,
    without_stamps,
    without_typed,
)
from tacstrip.io.log_import.gathered import named_values
from tacstrip.io.log_import.hexframes import refuse_frames
from tacstrip.io.log_import.json_records import of_literals
from tacstrip.io.log_import.labels import with_labels
from tacstrip.io.log_import.markup import dumped_tables, plain_rows
from tacstrip.io.log_import.owners import with_owners
from tacstrip.io.log_import.records import STEADY
from tacstrip.io.log_import.relations import joined
from tacstrip.io.log_import.runs import of_runs
from tacstrip.io.log_import.separated import separated
from tacstrip.io.log_import.shape import in_normal_form
from tacstrip.io.log_import.statements import untouched_said
from tacstrip.io.log_import.strays import numbered, with_retries, without, without_messages
from tacstrip.io.log_import.supply import other_supplies
from tacstrip.io.log_import.table import Table
from tacstrip.io.log_import.thousands import without_thousands
from tacstrip.io.log_import.wrapped import unwrapped, with_arrays_as_records

_COMMENT = ("#", "%", "//", "!")
_REMARK = re.compile(r"(;|!|//)\s*[^\s;].*")  # above a table
_RULE = re.compile(r"[\s\-=+|~*_:]+")  # a line drawn below names
_HALF_WIDTH = {c: c - 0xFEE0 for c in range(0xFF01, 0xFF5F)}  # of East Asian full-width letters and digits
_MOST_ABOVE = 12  # lines, in which what stands for no contact may be said
_LONG = 400  # characters of a line that may say something
_THOUSANDS = re.compile(r"(?<=\d)[\u2009\u202f\xa0](?=\d{3}(?!\d))")
_FORTRAN = re.compile(r"(?<!\w)([-+]?(?:\d+\.\d*|\.\d+))[DdQq]([+-]\d{2,3})(?!\w)")  # double precision
_SCALAR = re.compile(r"\b(?:np|numpy)\.(?:float|u?int)\d+\(([^()]*)\)")  # as NumPy 2 prints one in a list
_BOUND = re.compile(r"(\d)\s?(?:\u00b1|\+/-)\s?\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?(?!\d|\s?(?:\u00b1|\+/-))")
_COLOUR = re.compile(r"\x1b\[[0-9;]*[A-Za-z]")  # of a terminal
_FORMULA = re.compile(r"=\s*\d+\s*[*+]\s*\(?[A-Za-z]")  # as "ch = 2*strip"
_LINE_END = re.compile(
    r"(?m)(?:<CR>|<LF>|\[CR\]|\[LF\]|<0[DA]>|\[0[DA]\]|\\r|\\n|\u240d|\u240a)+(?=\r?$)"
)  # as monitors show it
# Between a word in Chinese, Japanese or Korean and one in Latin letters, as a unit, there may be no space.
_ASIAN = re.compile(
    r"(?<=[\u3040-\u30ff\u3400-\u9fff\uac00-\ud7af])(?=[A-Za-z])"
    r"|(?<=[A-Za-z])(?=[\u3040-\u30ff\u3400-\u9fff\uac00-\ud7af])"
)
_LABVIEW = "***End_of_Header***"
_SEGMENT = re.compile(r"^Channels\b|^\s*\n(?=[^\W\d])", re.MULTILINE)  # where its header begins
_ENDLESS = re.compile(r"(?<!\w)\w{10000}|[\[({]{1000}")  # the time of many patterns grows with its square


def of_text(text: str, path: str | Path = "the log") -> Table:
    """Return a text as a table in normal form; errors as of `read_table`."""
    text = _ASIAN.sub(" ", _LINE_END.sub("", text))
    if endless := _ENDLESS.search(text):
        raise ReadingError(
            f"{path}: line {text.count(chr(10), 0, endless.start()) + 1}: {len(endless.group())} characters and more "
            f"without an end ({endless.group()[:10]}...); damaged, or no log: take them out"
        )
    text = _with_marks_of_nothing(_with_one_mark(unwrapped(with_arrays_as_records(_without_headers(text)))))
    refuse_cut_array(text, path)
    table = with_retries(text, lambda strays: _with_lines(_announced(text, path, strays), text))
    return replace(table, of_content=lambda strips, channels: content_of(text, strips, channels))


def _without_headers(text: str) -> str:
    """Return a text with the headers of LabVIEW's file and segments commented out: their numbers are no readings."""
    *headed, rest = text.split(_LABVIEW)
    found = list[str]()
    for n, part in enumerate(headed):
        # Above a segment's header stand the readings of the one before.
        begin = max((m.start() for m in _SEGMENT.finditer(part)), default=0) if n else 0
        kept, header = part[:begin], part[begin:]
        found.append(kept + re.sub(r"(?m)^(?=.*\S)", "# ", header + _LABVIEW))
    return "".join(found) + rest


def _with_one_mark(text: str) -> str:
    """Return a text with "#" before the remarks that it begins with, whatever their mark, and no ">" before lines."""
    lines = text.split("\n")
    filled = [line for line in lines if line.strip() and not _REMARK.match(line)]
    if sum(line.startswith("> ") for line in filled) > STEADY * len(filled):
        lines = [line.removeprefix("> ") for line in lines]
    mark = next((m[1] for line in lines if (m := _REMARK.match(line))), "")
    for n, line in enumerate(lines):
        if line.strip() and not (mark and line.startswith(mark) and _REMARK.match(line)):
            break
        lines[n] = f"# {line.removeprefix(mark).lstrip()}" if line.strip() else line
    return "\n".join(lines)


def _with_marks_of_nothing(text: str) -> str:
    """Return a text with "nan" for what remarks above it say to stand for no contact, if that is a word or a mark."""
    lines = text.split("\n")
    told = {n: said for n, line in enumerate(lines[:_MOST_ABOVE]) if (said := untouched_said([line[:_LONG]]))}
    words = [re.escape(w.strip("'\"")) for said in told.values() for w in said if not re.search(r"\d", w)]
    mark = re.compile(rf"(?<![^\s,;|/:=(\[{{<>~])(?:{'|'.join(words)})(?![^\s,;|/:)\]}}<>~])")
    return "\n".join(
        mark.sub("nan", line) if words and n not in told else line for n, line in enumerate(lines)
    )


def content_of(text: str, strips: int, channels: int) -> Table | None:
    """Return a text's table by what it holds, with what its lines say; None where that tells nothing."""
    table = of_content(_COLOUR.sub("", without_thousands(text)), strips, channels)
    return None if table is None else _with_lines(in_normal_form(table), text)


def _announced(text: str, path: str | Path, strays: frozenset[int]) -> Table:
    table = _of_lines(text, path, strays)
    table = with_announced(table, without_typed(text), lambda other: _of_lines(other, path, strays))
    return with_owners(table, text)


def _with_lines(table: Table, text: str) -> Table:
    """Return a table with what the lines of the text say of the codes' resolution, and broken lines as they stand."""
    there = dict(numbered(text)) if table.broken else {}
    quotes = {i: there[i].strip() for i in table.broken if i in there}
    quotes = {i: q for i, q in quotes.items() if _is_said(table.quotes.get(i, q), q)}
    table = in_parts(table, text)
    return replace(
        table,
        preamble=(*table.preamble, *other_supplies(text, table.preamble)),
        resolutions=resolutions(text, frozenset(table.lines)),
        quotes={**table.quotes, **quotes},
        doubts=(*table.doubts, *order_told_otherwise(text, table.names)),
    )


def _is_said(quote: str, line: str) -> bool:
    """Return whether a quote is of a line's fields, whatever stands between these."""
    return re.sub(r"[\s,;|]+", "", quote) == re.sub(r"[\s,;|]+", "", line)


def _of_lines(text: str, path: str | Path, strays: frozenset[int]) -> Table:
    """Return a text as a table in normal form, as if some of its lines were not there."""
    refuse_frames(without(text, strays))
    if (related := _of_relations(without(text, strays))) is not None:
        return in_normal_form(related)
    text = upright_records(without_boxes(_FORTRAN.sub(r"\1E\2", _SCALAR.sub(r"\1", text))))
    text, bounds = _BOUND.subn(r"\1", without_thousands(_THOUSANDS.sub("", without(text, strays))))
    whole = _COLOUR.sub("", plain_rows(without(text, strays).translate(_HALF_WIDTH)))
    text, messages = without_messages(whole)
    of_others = [
        (a[0], a[1]) for a, b in zip(numbered(whole), numbered(text), strict=True) if a[1] and not b[1]
    ]
    bounded = "what stands behind \u00b1: no readings, passed over" if bounds > 1 else ""
    messages = "; ".join(filter(None, [messages, bounded]))
    structured = of_dialect(text, str(path)) or of_literals(text, path)
    if structured is None and (labelled := of_runs(text)) is not None:
        labelled = replace(labelled, remarks=(*filter(None, [messages]), *labelled.remarks))
        return in_normal_form(without_cut_end(labelled, text))
    text = with_labels(with_channel_names(of_sent(without_prefix(text))))
    if (table := structured or of_literals(text, path)) is not None:
        return in_normal_form(replace(table, remarks=(*filter(None, [messages]), *table.remarks)))
    # The empty lines in between tell where blocks begin.
    every = [(i, line) for i, line in enumerate(re.split(r"\r\n|\r\r\n|\n|\r", text), 1)]
    every = [(i, line) for i, line in every if i not in strays]
    lines = [(i, line) for i, line in every if line.strip() and not _RULE.fullmatch(line)]
    if not lines:
        raise ReadingError(f"{path}: the file is empty")
    lines, stamps = without_stamps(lines)
    lines = bare(lines)
    beside = [line.lstrip().startswith(_COMMENT) or bool(_FORMULA.search(line)) for _, line in lines]
    remarked = [line for (_, line), so in zip(lines, beside, strict=True) if so]
    table = named_values([line for line, so in zip(lines, beside, strict=True) if not so], stamps)
    if table is not None:
        table = replace(table, preamble=(*table.preamble, *remarked))
    else:
        blank = {i for i, line in every if not line.strip() or _RULE.fullmatch(line)}
        table = separated(lines, blank, path)
    table = with_cut_lines_doubted(without_cut_units(without_cut_end(table, text)))
    table = with_stamps(table, stamps, text, path) if stamps else table
    first = min(table.lines, default=0)
    above = [line for i, line in numbered(text) if i < first]
    table = replace(
        table,
        # What another logger says above the readings is said of all.
        preamble=(*table.preamble, *(line for i, line in of_others if i < first)),
        remarks=(*([messages] if messages else []), *table.remarks),
        doubts=(*table.doubts, *strips_told_otherwise(above)),
    )
    return in_normal_form(table)


def _of_relations(text: str) -> Table | None:
    """Return a dump of a database as the table of its readings, with the times of the table that these refer to."""
    dumped = dumped_tables(text)
    tables = {
        n: Table(tuple(names), [r for r in rows if len(r) == len(names)], [*range(1, len(rows) + 1)])
        for n, (names, *rows) in dumped.items() if all(len(r) == len(names) for r in rows)
    }  # fmt: skip
    return joined(tables) if len(tables) > 1 else None
