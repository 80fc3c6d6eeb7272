r"""Records of a line per field below a line that numbers them, as databases print them: mysql's \G, psql's \x."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import replace

from tacstrip.io.log_import.fields import is_prose
from tacstrip.io.log_import.strays import numbered
from tacstrip.io.log_import.table import Table, of_records

_KIND = r"(?:row|record|rec|entry|item|reading|zeile|datensatz|ligne|enregistrement|fila|registro|linha|riga)"
_HEAD = re.compile(
    rf"\s*(?:[-*=#~_+]{{2,}}\s*[\[(]?|[-*=#]?\[)\s*(?:{_KIND}\W{{0,3}}\d+|\d+\W{{0,3}}{_KIND})[\s\])]*[-*=#~_+.:|]*\s*",
    re.IGNORECASE,
)
_FIELD = re.compile(r"\s*(?P<name>[^\s:|=][^:|=]*?)\s*(?P<mark>[:|=])(?:\s+(?P<value>.*?))?\s*")
_FEW = 2  # records, and fields of one
_MOSTLY = 0.8  # of the records have the names of all


def of_expanded(text: str) -> Table | None:
    r"""Return records below lines such as "*** 2. row ***" or "-[ RECORD 2 ]---" as a table; None where there are none.

    Examples
    --------
    >>> head, body = "-[ RECORD {} ]--\n", "strip | {}\nv_h | {}\n"
    >>> table = of_expanded("".join((head + body).format(n, n, 2 + n) for n in (1, 2)))
    >>> table.names, table.rows
    (('strip', 'v_h'), [['1', '3'], ['2', '4']])
    """
    lines = numbered(text)
    heads = [n for n, (_, line) in enumerate(lines) if _HEAD.fullmatch(line)]
    if len(heads) < _FEW:
        return None
    found: list[tuple[int, dict[str, str]]] = []
    odd: list[int] = []  # lines within a record that are no fields
    for start, end in zip(heads, [*heads[1:], len(lines)], strict=True):
        record: dict[str, str] = {}
        for number, line in lines[start + 1 : end]:
            field = _FIELD.fullmatch(line)
            if field and field["name"] not in record:
                record[field["name"]] = "" if field["value"] in (None, "NULL") else field["value"]
            elif line.strip():
                odd.append(number)
        found.append((lines[start][0], record))
    (names, many), *_ = Counter(tuple(r) for _, r in found).most_common(1)
    if len(names) < _FEW or many < _MOSTLY * len(found) - 1:
        return None
    texts = dict(lines)
    last = max((n for n, r in found if tuple(r) == names), default=0)
    broken = [n for n, r in found if tuple(r) != names]
    broken += [n for n in odd if re.search(r"\d", texts[n]) and (n < last or not _is_footer(texts[n]))]
    whole = [(n, r) for n, r in found if tuple(r) == names]
    table = of_records(
        [r for _, r in whole], [n for n, _ in whole], ".", "a record below each line that numbers it"
    )
    above = tuple(line.strip() for _, line in lines[: heads[0]] if line.strip())
    quotes = {n: texts[n].strip() for n in broken}
    return replace(table, broken=tuple(sorted(broken)), quotes=quotes, preamble=above)


def _is_footer(line: str) -> bool:
    return bool(re.fullmatch(r"\s*\(?\d+ \w+(?:\)| in set.*|)\s*", line)) or is_prose(line)
