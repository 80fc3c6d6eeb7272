"""Tables drawn with lines, as Julia's DataFrames and Polars print them; records drawn below each other."""

from __future__ import annotations

import re

from tacstrip.io.log_import.strays import numbered

_BAR = re.compile("[\u2502\u2503\u2506\u250a\u2551]")
_RULE = re.compile("[\\s\u2500-\u257f]+")
_TYPE = re.compile(
    r"(?:(?:Union|Vector)\{.*\}|U?Int\d*|[ui]\d+|f(?:32|64)|Float\d*|String\d*|str|Symbol|Date(?:Time)?|Time|Any"
    r"|Bool|Missing)\??"
)
_ROW_NUMBERED = re.compile("\\s*Row \u2502")
_SHAPE = re.compile(r"\s*(?:\d+\u00d7\d+ DataFrame|shape: \(.*\))\s*")
# Above each record, as psql prints it behind \\x, and mysql behind \\G.
_RECORD = re.compile(r"-\[ RECORD \d+ \][-+]*|\*{5,} \d+\. row \*{5,}")
_FIELD = re.compile(r"\s*(\w[\w ]*?)\s*[|:](?:\s(.*))?")


def upright_records(text: str) -> str:
    r"""Return records that a database's prompt shows, a field in a line, as documents in YAML; another text as it is.

    Examples
    --------
    >>> upright_records("=> select\n-[ RECORD 1 ]--\nt   | 0\nv_h | 2.5\n-[ RECORD 2 ]--\nt   | 1\nv_h | \n")
    '\n---\nt: 0\nv_h: 2.5\n---\nt: 1\nv_h: \n'
    """
    lines = [line for _, line in numbered(text)]
    begins = [n for n, line in enumerate(lines) if _RECORD.fullmatch(line.strip())]
    if len(begins) < 2:
        return text
    made = ["" if n < begins[0] else line for n, line in enumerate(lines)]
    for n in range(begins[0], len(lines)):
        field = _FIELD.fullmatch(lines[n])
        made[n] = f"{field[1]}: {(field[2] or '').replace('NULL', '')}" if field else ""
    for n in begins:
        made[n] = "---"
    return "\n".join(made)


def without_boxes(text: str) -> str:
    r"""Return a drawn table as fields between bars or blanks, without rules, types of columns, and Julia's row numbers.

    Examples
    --------
    >>> text = " Row \u2502 t    h\n     \u2502 Int64  Float64?\n   1 \u2502 0  2.5\n   2 \u2502 1  2.4\n"
    >>> [line.strip() for line in without_boxes(text).split("\n")]
    ['t    h', '', '0  2.5', '1  2.4', '']
    """
    lines = numbered(text)
    drawn = [line for _, line in lines if _BAR.search(line)]
    if len(drawn) < 2 or 2 * len(drawn) < sum(bool(line.strip()) for _, line in lines):
        return text
    julia = any(_ROW_NUMBERED.match(line) for line in drawn)
    made = []
    for _, line in lines:
        plain = (
            _BAR.split(line, maxsplit=1)[-1]
            if julia and _BAR.search(line)
            else _BAR.sub("|", line).strip(" |")
        )
        types = re.split(r"[\s|]+", plain.strip())
        skipped = _RULE.fullmatch(line) or _SHAPE.fullmatch(line) or all(map(_TYPE.fullmatch, types))
        made.append("" if skipped or re.fullmatch(r"[\s|-]*", plain) else plain)
    return "\n".join(made)
