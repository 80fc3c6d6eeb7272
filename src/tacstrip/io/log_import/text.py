"""A text log as a table: how it is encoded, what stands before its lines, what separates its fields, its blocks."""

from __future__ import annotations

import bisect
import contextlib
import csv
import itertools
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tacstrip.errors import ReadingError
from tacstrip.io.log_import.announced import with_announced
from tacstrip.io.log_import.changes import in_parts
from tacstrip.io.log_import.channel_names import (
    order_told_otherwise,
    strips_told_otherwise,
    with_channel_names,
)
from tacstrip.io.log_import.conversion import resolutions
from tacstrip.io.log_import.delimiters import (
    of_sent,
    of_slashes,
    without_ends,
    without_prefix,
    without_tag,
)
from tacstrip.io.log_import.dialects import of_dialect, of_displayed_scans, plain_rows, yaml_documents
from tacstrip.io.log_import.fields import STAMP, clock_seconds, is_prose, is_value, number_of, says_nothing
from tacstrip.io.log_import.groups import of_groups
from tacstrip.io.log_import.hexbytes import of_hex_bytes
from tacstrip.io.log_import.labels import with_labels
from tacstrip.io.log_import.literals import one_page, unwrapped
from tacstrip.io.log_import.names import OTHER_SCRIPT, meaning, meanings, pair_of
from tacstrip.io.log_import.nested import documents
from tacstrip.io.log_import.owners import with_owners
from tacstrip.io.log_import.pandas_print import of_pandas
from tacstrip.io.log_import.records import STEADY, Item, is_label, items, named_values, of_literals
from tacstrip.io.log_import.runs import of_runs
from tacstrip.io.log_import.sections import in_one_table
from tacstrip.io.log_import.series import without_other_series
from tacstrip.io.log_import.shape import in_normal_form
from tacstrip.io.log_import.sideways import upright
from tacstrip.io.log_import.strays import numbered, with_retries, without, without_messages
from tacstrip.io.log_import.table import CLOCK, GARBLED, ROW, ContradictionError, Table, decimal_mark, headed
from tacstrip.io.log_import.tags import without_other_tags
from tacstrip.io.log_import.thousands import without_thousands
from tacstrip.io.log_import.tree import of_tree

_WIDE = "  "  # two spaces or more
_SEPARATORS = (";", "\t", "|", ",", _WIDE, " ")
_COMMENT = ("#", "%", "//", "!")
_DAY_NAMED = r"(?:(?:[A-Z][a-z]{2},? )?[A-Z][a-z]{2} [ \d]\d )?"  # as "Sun Nov 22 "
_HOST = re.compile(r"[\w.-]+ [\w./-]+(?:\[\d+\])?: ")  # behind the time of a system's journal
# Such as "14:03:07.512 -> ", which the serial monitor of the Arduino IDE puts before each line, or "[14:03:07] ".
_STAMPED = re.compile(
    rf"\s*\[?{_DAY_NAMED}(?P<stamp>{STAMP})(?: \d{{4}}(?=\]))?\]?"
    r"(?!\s*[AaPp]\.?[Mm]\b)\s*(?:->|=>|>|\||:|\t|\s)\s*(?=\S)"
)
_LEVELS = (
    r"[\[(]?(?:TRACE|DEBUG|DBG|VERBOSE|INFO|INF|NOTICE|LOG|WARN|WARNING|WRN|ERROR|ERR|FATAL|CRITICAL)[\])]?"
)
_LEVEL = re.compile(rf"{_LEVELS}[\s:|-]\s*")
_LEVEL_FIRST = re.compile(rf"\A\s*{_LEVELS}\s*[:|-]?\s*(?=[\[(\d])")  # before a time, as ROS writes
_NODE = re.compile(r"\[[A-Za-z][\w./-]*\]:?\s+")
_ARRAY = re.compile(r"(?<![\"\w])\[[\d\s.,;eE+\-naNuloNe]*\](?!\")")
_BRACKETED = re.compile(r"\s*[\[({](.*)[\])}]\s*[,;]?\s*")  # a line such as "(20, [1, 2])"
_PREFIX = re.compile(r"\s*(?:[A-Za-z]+:|-)\s+(?=[-+.\d])")  # such as "RX: " before the fields of each line
_NAMED = re.compile(r"[^\W\d]\w*\s*[:=]")  # the name of what follows in a line
_CHECKED = re.compile(r"\*[\dA-Fa-f]{2}\s*\Z")  # the checksum of a sentence as of NMEA
_VALUE = r"[+-]?(?:\d+\.?\d*|\.\d+)|nan|NaN|NA|OL|-{1,3}|\."
_PAIRED = re.compile(
    rf"(?<![\w./:(-])\(?({_VALUE})\s?(?:/|,\s?(?=[^()]{{0,999}}\))|:)\s?({_VALUE})\)?(?![\w./:-])"
)
_TOPIC = re.compile(r"([A-Za-z][\w.-]*(?:/[\w.-]+)+)\s+(\S+)")
# Such as "[001200] " or "I (1200) ".
_COUNTED = re.compile(r"\s*(?:[A-Z]\s)?[\[(]\s*(?P<stamp>\d+(?:\.\d+)?)\s*[\])]:?\s*(?=\S)")
_ESP_IDF = re.compile(
    r"(?m)^[EWIDV] \(\d+\) [\w.-]+: "
)  # of which the manual says that it counts milliseconds
_REMARK = re.compile(r"(?<=[\d\w,;])\s+(?:#|//)\s+\S.*")  # behind the fields of a line
_SIGN_APART = re.compile(r"\A([+-])\s+(?=[\d.,])")  # as loggers write "+  2.862"
_REMARKED = re.compile(
    r"(?<!\s)(?:\s+[(\[][^()\[\]]{9,}[)\]]\s*|\s{2,}\S.*|\s+(?:--|#|//)\s.*)\Z"
)  # behind names in a comment
_ANNOUNCED = re.compile(
    r"\A(?:order|columns?|fields?|format|header|names?|cols?|spalten)\s*[:=]\s*", re.IGNORECASE
)
_RANGE = re.compile(
    r"\b([A-Za-z_]+) ?(\d+)\s*(?:\.\.+|\u2026|-|to)\s*([A-Za-z_]*) ?(\d+)\b"
)  # such as "A0..A3"
_SAID_OF = re.compile(r"\s+(?:=|are|:)\s.*\Z")  # what names are
_MOST_NAMES = 1000
_SHELL = re.compile(
    r"\s*(?:>>> (?!\s*[-+\d.]).*|> [A-Za-z.].*|\[\d+ rows x \d+ columns\]\s*|\(?\d+ rows?(?: in set.*|\)\s*))"
)  # around a printed DataFrame
_COUNT_OF_ROWS = re.compile(r"\s*\(?\d+ rows?(?:\)| in set.*)\s*")  # below what a database prints
_QUERIED = re.compile(
    r"\s*(?:Time: [\d.,]+ ms(?: \([\d:.]+\))?|Timing is o(?:n|ff)\.?|SET)\s*"
)  # psql, of its own
_R_ROW = re.compile(r"\s*\[\d+,\](?=\s)")  # before the rows of a matrix that R prints
_REMARK_NAMES = (
    r"notes?|remarks?|comments?|labels?|events?|bemerkung(?:en)?|notizen?|kommentare?|remarques?|notas?"
)
_RULE = re.compile(r"[\s\-=+|~*_:]+")  # a line drawn below names
_SEVERAL = re.compile(r"[\d-]\s+[-+]?\d")
_NUMBERED = re.compile(r"[A-Za-z_]+\d+\S*")  # a column's name, such as S1 or v2_h
_HALF_WIDTH = {c: c - 0xFEE0 for c in range(0xFF01, 0xFF5F)}  # of East Asian full-width letters and digits
_SAMPLE = 500  # lines at either end that tell what separates the fields
_HEAD = 40  # lines in which a log may say what separates its fields
_SEPARATED_BY = re.compile(
    r"(?:sep|separator|delimiter)[\s:=\"]+(tab|comma|semicolon|[;,|])\"?", re.IGNORECASE
)
_SAID_SEPARATORS = {"tab": "\t", "comma": ",", "semicolon": ";"}
_BETWEEN = r"[,;|\s]+"
_HEX = r"[\dA-Fa-f]{2,8}"
_MOSTLY = 0.6  # of the lines, where these have several fields
_MOST_BYTES = 2**30
_FEW_LINES = 4  # of fewer, the length of the last number tells nothing
_FEW_BLOCKS = 2
_ENCODINGS = ("gb18030", "big5", "shift_jis", "euc_kr", "cp1251", "koi8-r")
# Words of central Europe whose letters are other ones in Western Europe's encoding.
_EASTERN = re.compile(
    r"\b(?:kana\u0142\w*|d\u00f3\u0142|napi\u0119cie|warto\u015b\u0107|\u015bcie\u017cka|\u010das|nap\u011bt\u00ed|\u0159\u00e1dek|k\u00e1b\u011bl|fesz\u00fclts\u00e9g|id\u0151"
    r"|als\u00f3|fels\u0151|u\u0142amek|wy\u0142\u0105cz\w*|pomiar\u00f3w|pr\u00f3bka)\b",
    re.IGNORECASE,
)
_WORDS_KNOWN = 2  # of those that logs have: fewer may be there by chance
_WORDED = re.compile(
    r"[^\dA-Za-z]*[A-Za-z][^\t;|]*(?<!,)\Z|\s*([=*~<>-])\1+\s*\w[^\t;|]*\1{2,}\s*\Z"
)  # and without fields
_NUMBER_SIGN = re.compile(r"\s(?:n|no|nr|num)?[\u00b0\u00ba.]\s*(?=\d)", re.IGNORECASE)  # as "Messung Nr. 2"
_IN_TIME = re.compile(r"(?<![\w.,])(\d+(?:\.\d+)?)\s?(?:s|sec|ms|us)(?!\w)")
_TIME_SAID = re.compile(r"(?<![\w.,])(\d+),(\d+)(?=\s?(?:s|sec|ms|us|\u00b5s)(?!\w))")  # with a decimal comma
_THOUSANDS = re.compile(r"(?<=\d)[\u2009\u202f\xa0](?=\d{3}(?!\d))")
_BOUND = re.compile(r"(\d)\s?(?:\u00b1|\+/-)\s?\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?(?!\d|\s?(?:\u00b1|\+/-))")
_COLOUR = re.compile(r"\x1b\[[0-9;]*[A-Za-z]")  # of a terminal
_FEW_GARBLED, _GARBLED_LINES = 3, 0.05  # places with zeros, and part of the lines: of more, a file is no text
_CHANNEL_LINE = re.compile(
    r"\s*((?:\d+(?:\.\d+)?[\s,;]+)?)([A-Za-z_]+)\s*[:=]((?:[\s,;]+[-+\d.eEna]+)+)[\s,;]*\Z"
)
_LONG = 80  # characters: no label has as many
_ENDLESS = re.compile(r"(?<!\w)\w{10000}|[\[({]{1000}")  # the time of many patterns grows with its square


def decoded(file: Path) -> str:
    """Return a file's text, whatever its encoding; `ReadingError` where it is none."""
    raw = file.read_bytes() if file.stat().st_size <= _MOST_BYTES else b""
    if not raw and file.stat().st_size:
        raise ReadingError(f"{file}: more than a gigabyte of text; cut it into pieces, or use a recording")
    for mark, name in ((b"\xef\xbb\xbf", "utf-8-sig"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16")):
        if raw.startswith(mark):
            return _in_utf16(raw, file, name)
    if raw[:40].count(0) >= len(raw[:40]) // 2 - 1 > 2:
        return _in_utf16(raw, file, "utf-16-le" if raw[1] == 0 else "utf-16-be")
    text, many = re.subn(rb"\0+", GARBLED.encode(), raw.rstrip(b"\0"))  # as where a logger was switched off
    if many > max(_FEW_GARBLED, _GARBLED_LINES * text.count(b"\n")):
        raise ReadingError(f"{file}: not a text file (byte {raw.index(0)} is 0)")
    try:
        return text.decode()
    except UnicodeDecodeError:
        western = text.decode("cp1252", errors="replace")  # of a spreadsheet on Windows
    known: dict[str, int] = {}  # text -> letters of the words in it that logs have
    for name in _ENCODINGS:
        with contextlib.suppress(UnicodeDecodeError):
            other = text.decode(name)
            words = {*OTHER_SCRIPT.findall(other)}
            known[other] = sum(map(len, words)) if len(words) >= _WORDS_KNOWN else 0
    best = max(known, key=lambda other: known[other], default="")
    eastern = text.decode("cp1250", errors="replace")
    western = eastern if _EASTERN.search(eastern) and not _EASTERN.search(western) else western
    return best if known.get(best) else western


def _in_utf16(raw: bytes, file: Path, name: str) -> str:
    try:
        return raw.decode(name)
    except UnicodeDecodeError:
        raise ReadingError(f"{file}: its marks say {name}, and it is not; save it as UTF-8") from None


def of_text(text: str, path: str | Path = "the log") -> Table:
    """Return a text as a table in normal form; errors as of `read_table`."""
    if endless := _ENDLESS.search(text):
        raise ReadingError(
            f"{path}: line {text.count(chr(10), 0, endless.start()) + 1}: {len(endless.group())} characters and more "
            f"without an end ({endless.group()[:10]}...); damaged, or no log: take them out"
        )
    return with_retries(text, lambda strays: _with_lines(_announced(text, path, strays), text))


def _announced(text: str, path: str | Path, strays: frozenset[int]) -> Table:
    table = _of_lines(text, path, strays)
    table = with_announced(table, text, lambda other: _of_lines(other, path, strays))
    return with_owners(table, text)


def _with_lines(table: Table, text: str) -> Table:
    """Return a table with what the lines of the text say of the codes' resolution, and broken lines as they stand."""
    there = dict(numbered(text)) if table.broken else {}
    quotes = {i: there[i].strip() for i in table.broken if i in there}
    quotes = {i: q for i, q in quotes.items() if _is_said(table.quotes.get(i, q), q)}
    table = in_parts(table, text)
    return replace(
        table,
        resolutions=resolutions(text, frozenset(table.lines)),
        quotes={**table.quotes, **quotes},
        doubts=(*table.doubts, *order_told_otherwise(text, table.names)),
    )


def _is_said(quote: str, line: str) -> bool:
    """Return whether a quote is of a line's fields, whatever stands between these."""
    return re.sub(r"[\s,;|]+", "", quote) == re.sub(r"[\s,;|]+", "", line)


def _of_lines(text: str, path: str | Path, strays: frozenset[int]) -> Table:
    """Return a text as a table in normal form, as if some of its lines were not there."""
    if (dumped := of_hex_bytes(without(text, strays))) is not None:
        return in_normal_form(dumped)
    text, bounds = _BOUND.subn(r"\1", without_thousands(_THOUSANDS.sub("", of_pandas(without(text, strays)))))
    text, messages = without_messages(
        _COLOUR.sub("", plain_rows(of_displayed_scans(without(text, strays)).translate(_HALF_WIDTH)))
    )
    text, others = without_other_series(text)
    text, tagged = without_other_tags(text)
    bounded = "what stands behind \u00b1: no readings, passed over" if bounds > 1 else ""
    messages = "; ".join(filter(None, [messages, others, tagged, bounded]))
    if (nested := _of_nested(text)) is not None:
        return in_normal_form(replace(nested, remarks=(*filter(None, [messages]), *nested.remarks)))
    if (labelled := of_runs(text)) is not None:
        labelled = replace(labelled, remarks=(*filter(None, [messages]), *labelled.remarks))
        return in_normal_form(_without_cut_end(labelled, text))
    text = with_labels(with_channel_names(upright(_of_two_lines(of_sent(without_prefix(text))))))
    if (table := of_literals(text, path) or of_dialect(text, str(path))) is not None:
        return in_normal_form(replace(table, remarks=(*filter(None, [messages]), *table.remarks)))
    # The empty lines in between tell where blocks begin.
    every = [(i, line) for i, line in enumerate(re.split(r"\r\n|\r\r\n|\n|\r", text), 1)]
    every = one_page(unwrapped([(i, line) for i, line in every if i not in strays]))
    lines = [(i, line) for i, line in every if line.strip() and not _RULE.fullmatch(line)]
    around = {i for i, line in lines if _SHELL.fullmatch(line)}
    if any(_COUNT_OF_ROWS.fullmatch(line) for _, line in lines):
        around |= {i for i, line in lines if _QUERIED.fullmatch(line)}
    if 2 * len(around) <= len(lines):
        typed = [f"line {i} ({line.strip()!r})" for i, line in lines if i in around and line.startswith("> ")]
        said = f"{', '.join(typed)}: typed at a prompt, passed over" if typed else ""
        messages = "; ".join(filter(None, [messages, said]))
        lines = [(i, line) for i, line in lines if i not in around]
    if not lines:
        raise ReadingError(f"{path}: the file is empty")
    lines, stamps = _without_stamps(lines)
    lines = _named_once(lines) if stamps else lines
    lines, doubts = without_ends(without_tag(lines) if stamps else lines)
    levels = [bool(_LEVEL.match(line)) for _, line in lines]
    if 0 < sum(levels) < 0.5 * len(levels):  # messages between the readings
        usual = next(line for (_, line), level in zip(lines[::-1], levels[::-1], strict=True) if not level)
        every_line = lines
        bare = [(i, line[m.end() :] if (m := _LEVEL.match(line)) else line) for i, line in lines]
        lines = [
            (i, line)
            for (i, line), level in zip(bare, levels, strict=True)
            if not level or len(re.split(_BETWEEN, line)) == len(re.split(_BETWEEN, usual)) > 2
        ]
        kept = {i for i, _ in lines}
        out = ", ".join(str(i) for i, _ in every_line if i not in kept)
        messages = "; ".join(filter(None, [messages, f"line(s) {out}: messages, passed over" if out else ""]))
    if sum(bool(_CHECKED.search(line)) for _, line in lines) > STEADY * len(lines):
        lines = [(i, _CHECKED.sub("", line)) for i, line in lines]
    heads = Counter(m.group() if (m := _PREFIX.match(line)) else "" for _, line in lines)
    numbers = sum(bool(re.search(r"\d|nan", line)) for _, line in lines)
    for head, many in heads.most_common(1):
        wide = sum(len(re.split(_BETWEEN, line.strip())) > _FEW_LINES for _, line in lines) > STEADY * numbers
        # It is a name, and not to be lost, where others follow it in the line, or where it says which channel.
        name_too = sum(bool(_NAMED.search(line, len(head))) for _, line in lines) > (1.0 - STEADY) * numbers
        channel = meaning(head.strip(" :")).channel in ("h", "l")
        if (
            head
            and many > STEADY * numbers
            and not name_too
            and not channel
            and (wide or not meaning(head).role)
        ):
            lines = [(i, line.removeprefix(head)) for i, line in lines]
    if sum(bool(_R_ROW.match(line)) for _, line in lines) > _MOSTLY * len(lines):
        lines = [(i, _R_ROW.sub("", line)) for i, line in lines if not line.startswith("> ")]
    if sum(_BRACKETED.fullmatch(line) is not None for _, line in lines) > STEADY * len(lines):
        lines = [(i, _BRACKETED.sub(r"\1", line)) for i, line in lines]
    if sum(line.lstrip().startswith("#") for _, line in lines) > STEADY * len(lines):  # it numbers them
        lines = [(i, line.lstrip("# \t")) for i, line in lines]
    lines = in_one_table(_in_pairs(of_groups(of_slashes(_of_topics(lines)))))
    table = named_values([(i, line) for i, line in lines if not line.lstrip().startswith(_COMMENT)])
    if table is not None:
        remarked = [line for _, line in lines if line.lstrip().startswith(_COMMENT)]
        table = replace(table, preamble=(*table.preamble, *remarked))
    else:
        blank = {i for i, line in every if not line.strip() or _RULE.fullmatch(line)}
        table = _separated(lines, blank, path)
    table = _without_cut_end(table, text)
    if stamps:
        lacks = [i for i in table.lines if i not in stamps]
        if lacks:
            raise ReadingError(f"{path}: line {lacks[0]} has no time of day before it, and most have")
        name = "time before each line" if number_of(stamps[table.lines[0]]) is not None else CLOCK
        name += " [ms]" if name != CLOCK and len(_ESP_IDF.findall(text)) > STEADY * len(stamps) else ""
        said = (
            f"each line begins with a time, such as {stamps[table.lines[0]]}, as a serial monitor puts there"
        )
        rows = [[stamps[i], *row] for i, row in zip(table.lines, table.rows, strict=True)]
        table = replace(table, names=(name, *table.names), rows=rows, remarks=(said, *table.remarks))
    first = min(table.lines, default=0)
    above = [line for i, line in numbered(text) if i < first]
    table = replace(
        table,
        remarks=(*([messages] if messages else []), *table.remarks),
        doubts=(*table.doubts, *doubts, *strips_told_otherwise(above)),
    )
    return in_normal_form(table)


def _of_nested(text: str) -> Table | None:
    """Return a text of nested records as a table; None where it is none, or holds lines of another form beside them."""
    found, around = documents(text)
    if not found:
        found, around = yaml_documents(text)
    odd = [line for _, line in around if re.search(r"\d", line) and not line.lstrip().startswith(_COMMENT)]
    if not found or (len(found) > 1 and len(odd) >= len(found)) or any(not is_prose(line) for line in odd):
        return None
    return of_tree(found, [line for _, line in around], "nested records: a line per strip")


def _of_two_lines(text: str) -> str:
    """Return lines such as "50 H: 1 388 437", of one channel each, with fields in place of the channel's colon."""
    found = [(m, line) if (m := _CHANNEL_LINE.match(line)) else (None, line) for line in text.splitlines()]
    words = Counter(m[2].casefold() for m, _ in found if m)
    said = {meaning(w).channel for w in words}
    many = sum(words.values())
    numbers = sum(bool(re.search(r"\d", line)) for _, line in found)
    if len(words) != 2 or many < STEADY * numbers or not ({*said} == {"h", "l"} or pair_of(said)):
        return text
    if abs(words.most_common()[0][1] - words.most_common()[1][1]) > 1:
        return text
    rows = ["\t".join([*m[1].split(), m[2], *m[3].split()]) if m else line for m, line in found]
    width = Counter(row.count("\t") for row in rows if "\t" in row).most_common(1)[0][0]
    return text if width < _FEW_LINES else "\n".join(rows)


def _of_topics(lines: list[tuple[int, str]]) -> list[tuple[int, str]]:
    """Return lines of a path and a value, such as "lab/skin/3/high 2.5", with an equals sign between them."""
    found = [_TOPIC.fullmatch(line.strip()) for _, line in lines]
    if sum(bool(m) for m in found) <= STEADY * len(lines):
        return lines
    return [(i, f"{m[1]}={m[2]}" if m else line) for (i, line), m in zip(lines, found, strict=True)]


def _in_pairs(lines: list[tuple[int, str]]) -> list[tuple[int, str]]:
    """Return lines with spaces, or what else stands between fields, in pairs of values such as 512/300 or (2.5,1.1)."""
    many = Counter(len(_PAIRED.findall(line)) for _, line in lines)
    usual, often = many.most_common(1)[0]
    if usual < 2 or often < STEADY * sum(bool(re.search(r"\d", line)) for _, line in lines):
        return lines
    sample = next(line for _, line in lines[len(lines) // 2 :] if len(_PAIRED.findall(line)) == usual)
    if len(re.findall(r"[A-Za-z]\s*\d*\s*[=:]?\s*#", _PAIRED.sub("#", sample))) > 1:
        return lines  # these have names
    between = re.search(r"#([^#]*)#", _PAIRED.sub("#", sample))
    mark = (
        between[1] if between and not between[1].strip() else (between[1].strip() if between else "") or " "
    )
    if len(mark.strip()) > 1:
        return lines
    return [
        (i, _PAIRED.sub(rf"\1{mark}\2", line).replace("|", " " if not mark.strip() else "|"))
        for i, line in lines
    ]


def _without_stamps(lines: list[tuple[int, str]]) -> tuple[list[tuple[int, str]], dict[int, str]]:
    """Return lines without what a monitor or a logger puts before each: the time, by line, and a level."""
    levelled, lines = lines, [(i, _LEVEL_FIRST.sub("", line)) for i, line in lines]
    found = [_STAMPED.match(line) or _COUNTED.match(line) for _, line in lines]
    many, first = sum(m is not None for m in found), next((n for n, m in enumerate(found) if m), 0)
    if many <= STEADY * (len(lines) - first if 2 * first < len(lines) else len(lines)):
        return levelled, {}
    if any(m is None and _as_wide(line, lines[-1][1]) for (_, line), m in zip(lines, found, strict=True)):
        return levelled, {}  # a table, whose names count the time, too
    stamps = {i: m["stamp"].strip() for (i, _), m in zip(lines, found, strict=True) if m}
    counts = [number_of(stamp) for stamp in stamps.values()]
    falls = sum(b < a for a, b in itertools.pairwise(counts) if a is not None and b is not None)
    if falls > (1.0 - STEADY) * len(counts) or (falls and max(c or 0.0 for c in counts) < len(counts)):
        return levelled, {}  # numbers of strips
    rest = [(i, line[m.end() :] if m else line) for (i, line), m in zip(lines, found, strict=True)]
    for prefix in (_HOST, _LEVEL, _NODE):
        before = [prefix.match(line) for _, line in rest]
        if all(before) and (prefix is _LEVEL or len({m.group() for m in before if m}) == 1):
            rest = [(i, line[m.end() :]) for (i, line), m in zip(rest, before, strict=True) if m]
    return [(i, line) for i, line in rest if line.strip()], stamps


def _named_once(lines: list[tuple[int, str]]) -> list[tuple[int, str]]:
    """Return lines without names that come again behind other times, and what stands in brackets behind names apart."""
    again = {line for line, many in Counter(line.strip() for _, line in lines).items() if many > 1}
    named = {line for line in again if _names_alone(line.partition("(")[0])}
    made: list[tuple[int, str]] = []
    there: set[str] = set()
    for i, line in lines:
        if line.strip() not in named:
            made.append((i, line))
        elif line.strip() not in there:
            names, mark, remark = line.partition("(")
            made += [*([(i, f"# {remark.rstrip(' )')}")] if mark else []), (i, names.rstrip())]
            there.add(line.strip())
    return made


def _names_alone(line: str) -> bool:
    """Return whether a line holds nothing but names of readings, times and strips, and no value of any."""
    fields = [f for f in re.split(_BETWEEN, line) if f]
    plain = len(fields) > _FEW_BLOCKS and not re.search(r"[=:]", line)
    return plain and all(meaning(f).role for f in fields) and not any(map(says_nothing, fields))


def _as_wide(line: str, other: str) -> bool:
    return any(len(line.split(by)) == len(other.split(by)) > 2 for by in ("\t", "|", None))


def _without_cut_end(table: Table, text: str) -> Table:
    """Return a table whose last line is a broken one, if the log ends within its last number."""
    if text.endswith(("\n", "\r")) or len(table.rows) < _FEW_LINES:
        return table
    lines = re.split(r"\r\n|\r\r\n|\n|\r", text)
    *padded, end_line = [lines[i - 1] for i in table.lines]
    *others, last = [row[-1] for row in table.rows]
    longer = [len(cell) for cell in others if cell]
    if last or any(m.role == "strip" for m in meanings(table.names).values()):
        cut = bool(last and longer) and len(last) < min(longer)
    else:  # empty at the end, where the line before is not
        end = len(list(itertools.takewhile(lambda cell: not cell, reversed(table.rows[-1]))))
        cut = any(table.rows[-2][-end:])
    # Where blanks fill each line up to one width, a shorter one is cut, even behind a whole number.
    filled = len({*map(len, padded)}) == 1 and any("  " in line for line in padded)
    if not cut and not (filled and len(end_line) < len(padded[0])):
        return table
    broken = (*table.broken, table.lines[-1])
    return replace(table, rows=table.rows[:-1], lines=table.lines[:-1], broken=broken)


def _fields(line: str, separator: str) -> list[str]:
    if separator == _WIDE:
        return re.split(r"\s{2,}|\t", line.strip())
    if separator == " ":
        if '"' in line:
            line = " ".join(
                re.sub(r"\s+", "_", f) for f in next(csv.reader([line], delimiter=" ", skipinitialspace=True))
            )
        first, *others = re.sub(r"\[((?:[-+\s\d.eE]|nan)*)\]", r" \1 ", line).split() or [""]
        return [first[:-1] if others and re.fullmatch(r"\d+:", first) else first, *others]
    if "[" in line and '"' not in line:
        line = _ARRAY.sub(lambda m: f'"{m.group()}"', line)
    split = next(csv.reader([line], delimiter=separator, skipinitialspace=True))
    return [_SIGN_APART.sub(r"\1", f.strip()) for f in split]


def _separated(lines: list[tuple[int, str]], blank: set[int], path: str | Path) -> Table:
    """Return lines of fields with the separator that most of them share."""
    comments = [(i, line) for i, line in lines if line.lstrip().startswith(_COMMENT)]
    data = [(i, line) for i, line in lines if not line.lstrip().startswith(_COMMENT)]
    if not data:  # all of it is commented out
        data, comments = [(i, line.lstrip("#%/! \t")) for i, line in lines], []
    labels = _labels(lines)
    data = [(i, line) for i, line in data if i not in labels]
    if not data:
        raise ReadingError(f"{path}: nothing but comments")
    data = _without_columns_of_blanks(data)
    separator, width = _separator(data, path)
    remarked = [_REMARK.search(line) for _, line in data]
    if 0 < sum(map(bool, remarked)) < 0.5 * len(data):
        data = [
            (i, line[: m.start()] if m and len(_fields(line[: m.start()], separator)) == width else line)
            for (i, line), m in zip(data, remarked, strict=True)
        ]
    split = [(i, _fields(line, separator)) for i, line in data]
    if separator == _WIDE:  # names may stand nearer to each other than numbers
        near = {i: line.split() for i, line in data}
        split = [
            (i, row if len(row) == width or not _names_columns(near[i]) else near[i]) for i, row in split
        ]
    split = [(i, row[:-1] if len(row) == width + 1 and not row[-1] else row) for i, row in split]
    marks = [
        n
        for n in range(width)
        if all(re.fullmatch(r"[/|:&]", row[n]) for _, row in split[1:] if len(row) == width)
    ]
    if 0 < len(marks) < width and sum(len(row) == width for _, row in split) > 1:  # between fields, and none
        split = [
            (i, [c for n, c in enumerate(row) if n not in marks] if len(row) == width else row)
            for i, row in split
        ]
        width -= len(marks)
    split, width, lacking = _under_more_names(split, comments, width, separator)
    split, width, trimmed = (split, width, "") if lacking else _untrimmed(split, width)
    split = _in_decimals(_below_an_index(split, width), width)
    line, top = split[0]
    if separator.isspace() and len(top) > width > 1 and all(_NUMBERED.fullmatch(name) for name in top[1:]):
        raise ReadingError(
            f"{path}: line {line} names {len(top)} columns, and most lines have {width} fields: what stands for the "
            "others is not to be told from spaces; put commas or tabs between the fields"
        )
    full = [row for _, row in split if len(row) == width]
    _check_commas(top, width, separator, line)
    decimal = _decimal_of_quoted(full) if separator == "," else decimal_mark(full)
    said = {"\t": "tabs", " ": "spaces", _WIDE: "spaces"}.get(separator, repr(separator))
    remarks: tuple[str, ...] = (
        f"fields are separated by {said}" if width > 1 else "",
        "decimal commas" if decimal == "," else "",
        trimmed,
    )
    ends = min((len(row) - _filled(row) for _, row in split if len(row) == width), default=0)
    if ends and any(
        len(_fields(line.lstrip("#%/! \t"), separator)) == width - ends > 1 for _, line in comments
    ):
        split = [(i, row[:-ends] if len(row) == width else row) for i, row in split]
        width -= ends
    named = [(i, _fields(_names_said(line, width, separator), separator)) for i, line in comments]
    if separator == _WIDE:  # names may stand nearer to each other than numbers
        named = [(i, row if len(row) == width else " ".join(row).split()) for i, row in named]
    split, renamed = _under_first_names(split, named, width)
    above = [line for _, line in comments]
    out = [
        i for i, row in named
        if i > split[0][0] and len(row) == width > 1 and all(is_value(c, decimal) or not c for c in row)
    ]  # fmt: skip
    if out:
        remarks = (
            *remarks,
            f"line(s) {', '.join(map(str, out))}: readings that are commented out; passed over",
        )
    table = headed(split, width, decimal, tuple(filter(None, remarks)), named, above)
    table = replace(table, doubts=(*table.doubts, renamed)) if renamed else table
    if lacking and _are_remarks(lacking) and any(is_value(r[-1 - len(lacking)], decimal) for r in table.rows):
        said = f"no line has as many fields as there are names: taken as if {', '.join(lacking)} were missing"
        table = replace(table, doubts=(*table.doubts, said))
    else:
        table = replace(table, lacking=lacking)
    return _in_blocks(table, labels, blank)


def _names_said(line: str, width: int, separator: str) -> str:
    """Return a comment without what stands around as many names as there are fields: a word before, a remark behind.

    As in "# columns: t strip h l", "# scan strip volts   (touched strips only)" and "# t, A0..A3 = strips 1 to 4".
    """
    bare = line.lstrip("#%/! \t")
    for shorter in (
        bare,
        _REMARKED.sub("", bare),
        _ANNOUNCED.sub("", bare),
        _ANNOUNCED.sub("", _REMARKED.sub("", bare)),
    ):
        found = _fields(shorter, separator)
        if len(found) == width and not {*found} & {"=", ":", "->"}:
            return shorter
        listed = _SAID_OF.sub("", _ANNOUNCED.sub("", _REMARKED.sub("", shorter)))
        parts = [p.strip() for p in re.split(r"[,;]", _RANGE.sub(_in_full, listed))]
        if (
            len(parts) == width > _FEW_BLOCKS
            and all(parts)
            and (separator not in ",;" or _RANGE.search(listed))
        ):
            return (separator or " ").join(p.replace(" ", "_") for p in parts)
    return "" if len(_fields(bare, separator)) == width else bare


def _in_full(m: re.Match[str]) -> str:
    """Return the names of a range such as "A0..A3"."""
    first, last = int(m[2]), int(m[4])
    many = range(first, last + 1) if first < last < first + _MOST_NAMES else ()
    return ", ".join(f"{m[1]}{n}" for n in many) if m[3] in ("", m[1]) and many else m[0]


def _decimal_of_quoted(rows: Sequence[Sequence[str]]) -> str:
    """Return the decimal mark of fields between commas: a comma where quoted numbers have one, and none a point."""
    cells = [cell for row in rows for cell in row]
    commas = [cell for cell in cells if re.fullmatch(r"[+-]?\d+,\d+", cell)]
    if not commas or any(re.fullmatch(r"[+-]?[\d,]*\.\d+", cell) for cell in cells):
        return "."
    if all(re.fullmatch(r"[+-]?[1-9]\d{0,2},\d{3}", cell) for cell in commas):
        raise ReadingError(
            f"{commas[0]!r}: a decimal comma, or thousands? Write such numbers with a decimal point, "
            "without marks in between"
        )
    return decimal_mark(rows)


def _check_commas(names: list[str], width: int, separator: str, line: int) -> None:
    """Refuse decimal commas between commas: names, and about as many more fields as are numbers with decimals."""
    roles = [meaning(name).role for name in names]
    if separator != "," or not len(names) + 1 < width <= 2 * len(names) or not all(roles) or len(names) < 2:
        return
    raise ContradictionError(
        f"line {line} has {len(names)} names, and the lines below it {width} fields: decimal commas, and commas "
        "between fields, too? Save it with decimal points, or with semicolons between fields"
    )


def _under_more_names(
    split: list[tuple[int, list[str]]], comments: list[tuple[int, str]], width: int, separator: str
) -> tuple[list[tuple[int, list[str]]], int, tuple[str, ...]]:
    """Return rows filled up to the number of names, where these are more than any line has fields, and the last names.

    Which field is missing no line tells.
    """
    if separator.isspace() and separator != "\t":
        return split, width, ()
    tops = [n for n, (_, row) in enumerate(split) if len(row) > width and _names_columns(row)]
    first = tops[-1] + 1 if tops else 0
    said = [(i, _fields(line.lstrip("#%/! \t"), separator)) for i, line in comments if i < split[0][0]]
    top, names = split[first - 1] if tops else (said or [(0, [""])])[-1]
    wide = len(names)
    numbers = [row for _, row in split[first:] if sum(is_value(c, ".") or is_value(c, ",") for c in row) > 1]
    if wide <= width or not numbers or any(len(row) >= wide for row in numbers) or not _names_columns(names):
        return split, width, ()
    if 2 * sum(m.role != "" for m in meanings(names).values()) < wide:
        return split, width, ()
    filled = [(i, row + [""] * (wide - len(row)) if row in numbers else row) for i, row in split[first:]]
    return [*split[: max(first - 1, 0)], (top, names), *filled], wide, tuple(names[width:])


def _are_remarks(names: Sequence[str]) -> bool:
    return all(re.fullmatch(_REMARK_NAMES, name.strip(), re.IGNORECASE) for name in names)


def _untrimmed(
    split: list[tuple[int, list[str]]], width: int
) -> tuple[list[tuple[int, list[str]]], int, str]:
    """Return rows with the empty fields that were left out at their ends, the width of the names, and a remark.

    That is sure where no row ends with an empty field, and empty ones stand inside.
    """
    wide = max(_filled(row) for _, row in split)  # lines of a preamble may be filled up with empty fields
    top = next(n for n, (_, row) in enumerate(split) if _filled(row) == wide)
    names, below = split[top][1], split[top + 1 :]
    if any(len(row) > wide for _, row in below):
        return split, width, ""
    short = [row for _, row in below if len(row) < wide]
    if len(short) < 2 or not all(names) or any(is_value(cell, ".") for cell in names):
        return split, width, ""
    rows = [row for _, row in below]
    noted = [row[-1] for row in rows if len(row) == wide]  # a column of remarks, which few lines have
    if (
        wide == width + 1
        and noted
        and not any(is_value(t, ".") or is_value(t, ",") or says_nothing(t) for t in noted)
    ):
        filled = [(i, [*row, ""] if len(row) == width else row) for i, row in below]
        return split[: top + 1] + filled, wide, f"{names[-1]}: a remark on {len(noted)} line(s)"
    if not all(row[-1] and not says_nothing(row[-1]) for row in rows) or "" not in [
        c for r in rows for c in r
    ]:
        return split, width, ""
    if any(len(row) < 2 or sum(is_value(c, ".") or not c for c in row) < len(row) - 1 for row in short):
        return split, width, ""
    filled = [(i, row + [""] * (wide - len(row))) for i, row in below]
    return split[: top + 1] + filled, wide, f"{len(short)} line(s) end early: what is not there is empty"


def _filled(row: list[str]) -> int:
    """Return the fields of a row up to its last that is not empty."""
    return max((n for n, cell in enumerate(row, 1) if cell), default=0)


def _under_first_names(
    split: list[tuple[int, list[str]]], named: list[tuple[int, list[str]]], width: int
) -> tuple[list[tuple[int, list[str]]], str]:
    """Return rows in the order of the log's first names, where a line within it names columns anew, and a doubt.

    Raises
    ------
    ContradictionError
        It names others.
    """
    heads = [(i, row) for i, row in sorted([*split, *named]) if len(row) == width and _names_columns(row)]
    first = next((i for i, row in split if len(row) == width and sum(is_value(c, ".") for c in row) > 1), 0)
    above = [row for i, row in heads if i < first]
    others = [(i, row) for i, row in heads if i > first and above and row != above[-1]]
    if not others:
        return split, ""
    names, (line, new) = above[-1], others[0]
    for i, row in others:
        if sorted(row) != sorted(names) or len({*names}) < width:
            raise ContradictionError(
                f"line {i} names the columns {', '.join(row)}, and the first names are {', '.join(names)}: two "
                "tables in one log; save them as two files"
            )
    made, order = [], names
    heads_at = dict(heads)
    for i, row in sorted([*split, *((i, row) for i, row in others if (i, row) not in split)]):
        if i > first and i in heads_at:
            order = row
        else:
            made.append((i, [row[order.index(n)] for n in names] if len(row) == width else row))
    said = (
        f"line {line} names the columns in another order ({', '.join(new)}): taken so for the lines below it"
    )
    return made, said


def _names_columns(row: list[str]) -> bool:
    """Return whether a row is one of names: words only, at least two of which tell what a column is."""
    if not all(row) or len({*row}) < len(row) or any(is_value(c, ".") or says_nothing(c) for c in row):
        return False
    return sum(m.role != "" for m in meanings(row).values()) > 1


def _below_an_index(split: list[tuple[int, list[str]]], width: int) -> list[tuple[int, list[str]]]:
    """Return rows with a name for a column that only counts them, as R writes it, if the names lack one."""
    numbers = [number_of(row[0]) for _, row in split[1:] if len(row) == width]
    counts = (
        None not in numbers and len(numbers) > 1 and set(np.diff(np.array(numbers, dtype=float))) == {1.0}
    )
    if len(split[0][1]) == width - 1 and counts and not any(is_value(f, ".") for f in split[0][1]):
        split[0][1].insert(0, "index")
    return split


def _in_decimals(split: list[tuple[int, list[str]]], width: int) -> list[tuple[int, list[str]]]:
    """Mark as such the numbers of columns that are hexadecimal: of one length, some with letters."""
    full = [row for _, row in split if len(row) == width]
    body = full[len(full) // 10 + 1 :]
    there = {n: [row[n] for row in body if not says_nothing(row[n])] for n in range(width)}
    digits = [n for n, read in there.items() if read and all(re.fullmatch(_HEX, cell) for cell in read)]
    digits = [n for n in digits if len({*map(len, there[n])}) == 1]
    lettered = [row[n] for row in body for n in digits if re.search("[A-Fa-f]", row[n])]
    moving = [n for n in digits if len({row[n] for row in body}) > 1]
    if 2 * sum(any(re.search("[A-Fa-f]", row[n]) for row in body) for n in moving) < len(moving):
        return split  # numbers beside a checksum or a device's name
    if 10 * len(lettered) < len(body) or not any(
        re.search(r"[ABCDFabcdf]", f) and f[0].isdigit() for f in lettered
    ):
        return split
    digits = [n for n in digits if len(there[n][0]) == len(lettered[0])]
    for n in [n for n in digits if not any(re.search("[A-Fa-f]", cell) for cell in there[n])]:
        even = [_rises_evenly([int(cell, base) for cell in there[n]]) for base in (10, 16)]
        if even == [True, True]:
            raise ReadingError(
                f"{there[n][0]!r}: a hexadecimal number, as others on its line, or a decimal one? Write 0x before those"
            )
        digits = [d for d in digits if d != n] if even[0] else digits
    for _, row in split:
        for n in digits if len(row) == width else ():
            row[n] = f"0x{row[n]}" if re.fullmatch(_HEX, row[n]) else row[n]
    return split


def _rises_evenly(numbers: list[int]) -> bool:
    steps = np.diff(numbers)
    return len(steps) > 1 and bool((steps > 0).all()) and len({*steps.tolist()}) == 1


def _labels(lines: list[tuple[int, str]]) -> dict[int, list[Item]]:
    """Return the lines that only say to which scan or strip those below belong, if there are several alike."""
    worded = [(i, line.strip("#%/! \t")) for i, line in lines if len(line) < _LONG]
    worded = [(i, _TIME_SAID.sub(r"\1.\2", _NUMBER_SIGN.sub(" ", line))) for i, line in worded]
    timed = {i: items(f"t = {time}") for i, time in _timed(worded).items()}
    worded = [(i, line) for i, line in worded if _WORDED.match(line)]
    found = {i: parts for i, line in worded if is_label(parts := items(line))} or timed
    kinds = Counter(tuple(item.name for item in parts) for parts in found.values())
    return {i: parts for i, parts in found.items() if kinds[tuple(p.name for p in parts)] >= _FEW_BLOCKS}


def _timed(lines: list[tuple[int, str]]) -> dict[int, str]:
    """Return the times of lines of words of one form with a number and its unit of time, evenly above their blocks."""
    found = {
        i: m
        for i, line in lines
        if len(m := [*_IN_TIME.finditer(line)]) == 1 and not re.search(r"[;\t|]", line)
    }
    texts = dict(lines)
    forms = Counter(re.sub(r"\d+(?:\.\d+)?", "0", texts[i]) for i in found)
    if (
        not forms
        or len(forms) > 1
        or sum(forms.values()) < _FEW_BLOCKS
        or len(re.findall("0", next(iter(forms)))) > 2
    ):
        return {}
    first, *gaps = [b - a for a, b in itertools.pairwise(found)] or [0]
    times = [float(m[0][1]) for m in found.values()]
    # The first block may have names besides.
    even = len({*gaps}) == 1 and 0 <= first - gaps[0] <= 2 < gaps[0]
    even = even and all(a < b for a, b in itertools.pairwise(times))
    return {i: m[0].group() for i, m in found.items()} if even else {}


def _separator(data: list[tuple[int, str]], path: str | Path) -> tuple[str, int]:
    """Return what separates the fields, and how many there are in most lines."""
    ranked = []
    if said := next((m for _, line in data[:_HEAD] if (m := _SEPARATED_BY.fullmatch(line.strip()))), None):
        separator = _SAID_SEPARATORS.get(said[1].casefold(), said[1])
        width = Counter(len(_fields(line, separator)) for _, line in data[len(data) // 2 :]).most_common(1)[
            0
        ][0]
        if width > 1:
            return separator, width
    data = data if len(data) <= 2 * _SAMPLE else data[:_SAMPLE] + data[-_SAMPLE:]
    for separator in _SEPARATORS:
        try:
            split = [_fields(line, separator) for _, line in data]
        except csv.Error:
            continue
        width, many = max(Counter(map(len, split)).items(), key=lambda item: (item[0] > 1, item[1]))
        if width > 1:
            several = sum(
                _SEVERAL.search(f) is not None and not is_value(f, ".") and clock_seconds(f) is None
                for row in split for f in row
            )  # fmt: skip
            share = (many - several) / len(data)  # a field of two numbers is none
            ranked.append(
                (share if separator.strip() or separator == "\t" else 0.99 * share, separator, width)
            )
    if not ranked:
        if sum(number_of(line) is not None or says_nothing(line.strip()) for _, line in data) < STEADY * len(
            data
        ):
            raise ReadingError(f"{path}: no table: no line has two fields")
        return ",", 1
    share, separator, width = max(
        ranked, key=lambda r: (r[0] > STEADY, r[0] > 0.98, -_SEPARATORS.index(r[1]), r[0])
    )
    enough = 0.99 * (STEADY if width < _FEW_LINES else _MOSTLY)
    if share < enough and len(data) > _FEW_LINES:
        share, separator, width = _below_a_preamble(ranked, data)
    if share < enough and len(data) > _FEW_LINES:
        raise ReadingError(
            f"{path}: no separator gives lines of as many fields; save it as CSV with one line per reading"
        )
    return separator, width


def _without_columns_of_blanks(data: list[tuple[int, str]]) -> list[tuple[int, str]]:
    """Return lines with tabs between their fields, where these stand in columns of a fixed width and some are blank."""
    sample = [line.expandtabs() for _, line in data[len(data) // 2 :][:_SAMPLE]]
    counts = {len(line.split()) for line in sample}
    if sum(bool(re.search(r"[,;|\t]", line)) for _, line in data) > (1.0 - STEADY) * len(data):
        return data
    if below := _below_their_names(data):
        return below
    if len(counts) < 2 or any(re.search(r"[,;|\t]", line) for _, line in data):
        return data
    width = max(map(len, sample))
    blank = [all(line[n : n + 1] in ("", " ") for line in sample) for n in range(width)]
    ends = [n for n in range(1, width) if blank[n] and not blank[n - 1]]
    pieces = list(zip([0, *ends], [*ends, None], strict=True))
    if len(pieces) < max(counts) or max(counts) < 2:
        return data
    rows = [all(map(_is_bare, line.split())) for _, line in data]
    full = [
        line for (_, line), row in zip(data, rows, strict=True) if row and len(line.split()) >= len(pieces)
    ]
    if any(len(line[n - 1 : n + 1].strip()) == 2 for line in full for n in ends):  # a boundary within a word
        return data
    cut = [
        (
            i,
            [line.expandtabs()[a:b].strip() for a, b in pieces]
            if row or len(line.split()) != len(pieces)
            else line.split(),
        )
        for (i, line), row in zip(data, rows, strict=True)
    ]
    if any(piece and says_nothing(piece) for _, row in cut for piece in row):  # then a blank one is lost
        return data
    if any(re.search(r"\S\s\S", piece) for _, row in cut[len(cut) // 2 :] for piece in row):
        return data
    return [(i, "\t".join(row)) for i, row in cut]


def _below_their_names(data: list[tuple[int, str]]) -> list[tuple[int, str]]:
    """Return lines with tabs between fields that end, or begin, where their names do; none if blanks alone tell them.

    Names may hold single blanks, and fields may be empty; lines of words around the table stay as they are.
    """
    words = [list(re.finditer(r"\S+", line.expandtabs())) for _, line in data]
    bare = [len(found) > 1 and all(_is_bare(m.group()) for m in found) for found in words]
    first = bare.index(True) if True in bare else 0
    if not first or sum(bare) < _FEW_LINES:
        return []
    body = [n for n, is_row in enumerate(bare) if is_row]
    top = data[first - 1][1].expandtabs()
    many = {len(words[n]) for n in body}
    if many == {len(words[first - 1])}:
        return []
    for names in (list(re.finditer(r"\S+(?: \S+)*", top)), words[first - 1]):
        if len(names) < max(3, *many) or any(number_of(m.group()) is not None for m in names):
            continue
        for side in (re.Match.end, re.Match.start):
            places = [side(m) for m in names]
            if any(not {side(m) for m in words[n]} <= {*places} for n in body):
                continue
            made = list(data)
            alone = [n for n, m in enumerate(words) if n > first and len(m) == 1 and _is_bare(m[0].group())]
            for n in [first - 1, *body, *(n for n in alone if side(words[n][0]) in places)]:
                at = {side(m): m.group() for m in (names if n < first else words[n])}
                made[n] = (data[n][0], "\t".join(at.get(p, "") for p in places))
            return made
    return []


def _is_bare(word: str) -> bool:
    return number_of(word) is not None or says_nothing(word) or clock_seconds(word) is not None


def _below_a_preamble(
    ranked: list[tuple[float, str, int]], data: list[tuple[int, str]]
) -> tuple[float, str, int]:
    """Return the separator of the log's second half, where what stands above the table is as long as the table."""
    found = []
    for _, separator, _ in ranked:
        widths = [len(_fields(line, separator)) for _, line in data]
        width = widths[-1]
        run = next((n for n, w in enumerate(reversed(widths)) if w != width), len(widths)) if width > 1 else 0
        found.append((run, -_SEPARATORS.index(separator), separator, width))
    run, _, separator, width = max(found)
    return (
        (1.0 if run >= _FEW_LINES or (run == _FEW_LINES - 1 and width > _FEW_LINES) else 0.0),
        separator,
        width,
    )


def _in_blocks(table: Table, labels: dict[int, list[Item]], blank: set[int]) -> Table:
    """Return a table with what the lines between its blocks say as columns, and each line's place in its block."""
    if not table.rows:
        return table
    if labels:
        table = _with_empty_blocks(table, labels)
    marks = sorted(labels) if labels else sorted(i for i in blank if table.lines[0] < i < table.lines[-1])
    blocks = [bisect.bisect_right(marks, line) for line in table.lines]
    sizes = Counter(blocks)
    rows, names = table.rows, table.names
    if labels:
        keys = tuple(dict.fromkeys(item.name for found in labels.values() for item in found))
        state, columns = dict.fromkeys(keys, ""), []
        pending = iter(sorted(labels))
        following = next(pending, None)
        for line in table.lines:
            while following is not None and following <= line:
                state |= {item.name: item.values[0].replace(".", table.decimal) for item in labels[following]}
                following = next(pending, None)
            columns.append(list(state.values()))
        if any("" in column for column in columns):
            raise ReadingError(
                f"line {table.lines[0]}: no {' or '.join(keys)} above it, as there is above others"
            )
        rows = [[*column, *row] for column, row in zip(columns, rows, strict=True)]
        names = (*keys, *names)
    if not labels and _scans_of(table, blocks):
        told = f"{len(sizes)} blocks between empty lines: a scan each"
        rows = [[str(block), *row] for block, row in zip(blocks, rows, strict=True)]
        return replace(table, names=("scan", *names), rows=rows, remarks=(*table.remarks, told))
    if len(sizes) >= _FEW_BLOCKS and len(set(sizes.values())) == 1 and sizes[blocks[0]] > 1:
        places = [n % sizes[blocks[0]] for n in range(len(blocks))]
        rows = [[*row, str(place)] for row, place in zip(rows, places, strict=True)]
        names = (*names, ROW)
    if names == table.names:
        return table
    told = f"{len(sizes)} blocks" + (f", each below its {' and '.join(keys)}" if labels else "")
    return replace(table, names=names, rows=rows, remarks=(*table.remarks, told))


def _with_empty_blocks(table: Table, labels: dict[int, list[Item]]) -> Table:
    """Return a table with a row for each scan, or time, below which nothing stands before the next."""
    heading: dict[str, int] = {}  # labels below which no row has come yet, and their lines
    void = []
    for line in sorted([*labels, *table.lines]):
        named = {i.name for i in labels.get(line, []) if meaning(i.name).role in ("scan", "time")}
        if line not in labels or named & {*heading}:
            void += [min(heading.values())] if line in labels else []
            heading = {}
        heading |= dict.fromkeys(named, line)
    strips = [n for n, m in meanings(table.names).items() if m.role == "strip"]
    cut = [min(heading.values())] if heading else []  # the last: what stood below it may be cut
    if void and len(strips) != 1:
        void, cut = [], [*void, *cut]
    if not void:
        return replace(table, broken=(*table.broken, *cut))
    place = table.places[strips[0]]
    nothing = [table.rows[0][n] if n == place else "" for n in range(len(table.names))]
    both = sorted([*zip(table.lines, table.rows, strict=True), *((line, nothing) for line in void)])
    told = f"{len(void)} block(s) without a line: nothing touches in them"
    return replace(
        table, rows=[row for _, row in both], lines=[i for i, _ in both], remarks=(*table.remarks, told),
        broken=(*table.broken, *cut), empty=table.empty | {*void},
    )  # fmt: skip


def _scans_of(table: Table, blocks: list[int]) -> bool:
    """Return whether blocks between empty lines are scans of strips: none comes twice in one, and most come again."""
    said = meanings(table.names)
    strips = [n for n, m in said.items() if m.role == "strip"]
    roles = {m.role for m in said.values()}
    if len(strips) != 1 or roles & {"time", "scan", "which"} or len(set(blocks)) < _FEW_BLOCKS:
        return False
    there: dict[int, list[str]] = {}
    for block, strip in zip(blocks, table.column(strips[0]), strict=True):
        there.setdefault(block, []).append(strip)
    again = [bool({*a} & {*b}) for a, b in itertools.pairwise(there.values())]
    return all(len({*s}) == len(s) for s in there.values()) and 2 * sum(again) > len(again)
