"""What pandas and R print of a data frame: columns in blocks below each other, an index of several levels."""

from __future__ import annotations

import re
from itertools import chain, pairwise, takewhile

from tacstrip.io.log_import.fields import number_of

_PROMPT = re.compile(
    r"\s*(?:(?:In|Out) ?\[\d*\]:|Out:|>>>|\.\.\.(?!\.)).*|\s*\[\d+ rows x \d+ columns\]\s*|\s*(?:import|from) \w+.*"
    r"|\s*\w+ = .*\(.*\).*|\s*print\(.*\).*"
)
_CELL = re.compile(r"\S+")


def of_pandas(text: str) -> str:
    r"""Return a text with each row of a printed DataFrame in one line of tabs; another text as it is.

    Examples
    --------
    >>> of_pandas("     t   h0  \\\n0  0.0  2.5   \n1  0.1  NaN   \n\n    l0  \n0  1.5  \n1  NaN  \n")
    't\th0\tl0\n0.0\t2.5\t1.5\n0.1\tNaN\tNaN'
    >>> of_pandas("> d\n    t  h0\n1 0.0 2.5\n2 0.1  NA\n   l0\n1 1.5\n2  NA\n")
    '# > d\nt\th0\tl0\n0.0\t2.5\t1.5\n0.1\tNA\tNA'
    >>> of_pandas("           h    l\nt   strip        \n0.0 0    2.5  1.5\n    1    NaN  NaN\n0.1 0    2.6  1.6\n")
    't\tstrip\th\tl\n0.0\t0\t2.5\t1.5\n0.0\t1\tNaN\tNaN\n0.1\t0\t2.6\t1.6'
    """
    lines = text.splitlines()
    return _unfolded(lines) or _with_index(lines) or text


def _unfolded(lines: list[str]) -> str:
    tables: list[range] = []  # names, and the rows below them
    for n in range(len(lines) - 1):
        if _is_block(lines[n : n + 2]):
            names, places = lines[n], range(n + 1, len(lines))
            below = takewhile(lambda k: _is_block([names, lines[k]]), places)  # noqa: B023, used at once
            tables.append(range(n, n + 1 + sum(1 for _ in below)))
    if len(tables) < 2 or len({*map(len, tables)}) > 1:
        return ""
    split = [[lines[k].rstrip(" \\").split() for k in table] for table in tables]
    if len({tuple(row[0] for row in part[1:]) for part in split}) > 1:
        return ""
    rows = [[cell for part in split for cell in part[n][n > 0 :]] for n in range(len(split[0]))]
    marked = any(
        re.search(r"\S\s+\\\s*\Z", line) for line in lines
    )  # by pandas; R only prints the rows' names again
    between = [lines[k] for a, b in pairwise(tables) for k in range(a.stop, b.start)]
    if (
        len({len(row) for row in rows}) > 1
        or len({*rows[0]}) < len(rows[0])
        or (not marked and any(map(str.strip, between)))
    ):
        return ""
    taken = {*chain(*tables)}
    around = [
        line
        for k, line in enumerate(lines)
        if k not in taken and (not _PROMPT.fullmatch(line) or "#" in line)
    ]
    remarks = [f"# {line.strip()}" for line in around if line.strip()]
    return "\n".join([*remarks, *("\t".join(row) for row in rows)])


def _is_block(block: list[str]) -> bool:
    """Return whether lines are of names, and of a number of the row and as many fields."""
    names, rows = block[0].rstrip(" \\").split(), [line.split() for line in block[1:]]
    return (
        all(len(row) == len(names) + 1 and row[0].isdigit() for row in rows) and number_of(names[0]) is None
    )


def _with_index(lines: list[str]) -> str:
    """Return rows with each level of their index, which pandas prints only where it changes."""
    for n, (top, below) in enumerate(pairwise(lines)):
        columns, levels = [*_CELL.finditer(top)], [*_CELL.finditer(below)]
        if len(levels) < 2 or not columns or not re.fullmatch(r"[A-Za-z_]\w*(?: .*)?", below.strip()):
            continue
        if (
            columns[0].start() < levels[-1].end()
            or re.search(r"\d", below)
            or below[levels[-1].end() :].strip()
        ):
            continue
        rows: list[list[str]] = []
        body = []
        for line in lines[n + 2 :]:
            fields = line.split()
            if not fields or len(fields) > len(levels) + len(columns):
                break
            # What a level leaves out is where it stands in the line above.
            index = [
                line[a.start() : b].strip()
                for a, b in zip(levels, [*(m.start() for m in levels[1:]), None], strict=True)
            ]
            left = index[:-1]
            values = line[levels[-1].start() :].split()
            if len(values) != 1 + len(columns) or (not rows and not all(left)):
                return ""
            filled = any(left)
            kept = [value or rows[-1][k] for k, value in enumerate(left)] if rows else left
            if filled and not all(left[next(k for k, v in enumerate(left) if v) :]):
                return ""
            rows.append([*kept, *values])
            body.append(line)
        if len(rows) < 2 or all(all(line[m.start() : m.end()].strip() for m in levels) for line in body):
            continue
        around = [
            x for x in (*lines[:n], *lines[n + 2 + len(rows) :]) if x.strip() and not _PROMPT.fullmatch(x)
        ]
        names = [*(m.group() for m in levels), *(m.group() for m in columns)]
        return "\n".join([*(f"# {x.strip()}" for x in around), *("\t".join(row) for row in [names, *rows])])
    return ""
