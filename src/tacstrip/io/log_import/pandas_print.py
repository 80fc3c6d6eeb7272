"""What pandas prints of a DataFrame: columns folded into blocks by a backslash, and an index of several levels."""

from __future__ import annotations

import re
from itertools import groupby, pairwise

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
    >>> of_pandas("           h    l\nt   strip        \n0.0 0    2.5  1.5\n    1    NaN  NaN\n0.1 0    2.6  1.6\n")
    't\tstrip\th\tl\n0.0\t0\t2.5\t1.5\n0.0\t1\tNaN\tNaN\n0.1\t0\t2.6\t1.6'
    """
    lines = text.splitlines()
    return _unfolded(lines) or _with_index(lines) or text


def _unfolded(lines: list[str]) -> str:
    if not any(re.search(r"\S\s+\\\s*\Z", line) for line in lines):
        return ""
    said = [line for line in lines if _PROMPT.fullmatch(line)]
    blocks = [
        [*part]
        for filled, part in groupby((x for x in lines if x not in said), key=lambda x: bool(x.strip()))
        if filled
    ]
    tables = [block for block in blocks if len(block) > 1 and _is_block(block)]
    around = [line for block in blocks if block not in tables for line in block]
    if len(tables) < 2 or len({len(block) for block in tables}) > 1:
        return ""
    split = [[line.rstrip(" \\").split() for line in block] for block in tables]
    if len({tuple(row[0] for row in part[1:]) for part in split}) > 1:
        return ""
    rows = [[cell for part in split for cell in part[n][n > 0 :]] for n in range(len(split[0]))]
    if len({len(row) for row in rows}) > 1:
        return ""
    remarks = [f"# {line.strip()}" for line in (*around, *(x for x in said if "#" in x)) if line.strip()]
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
