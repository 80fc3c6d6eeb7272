"""Tables in HTML, LaTeX or SQL as lines of fields."""

from __future__ import annotations

import html
import re

_WITHIN = r"(?:[^()]|\((?:[^()]|\([^()]*\))*\))*"  # brackets in brackets, as of a CHECK
_CREATED = re.compile(
    rf"CREATE\s+TABLE\s+(?:IF\s+NOT\s+EXISTS\s+)?([^\s(]+)\s*\(({_WITHIN})\)", re.IGNORECASE
)
_INSERTED = re.compile(
    r"INSERT\s+INTO\s+([^\s(]+)\s*(?:\(([^()]*)\)\s*)?VALUES\s*((?:\((?:'[^']*'|[^()'])*\)[,\s]*)+);",
    re.IGNORECASE,
)
_COPIED = re.compile(r"(?ms)^COPY\s+(\S+)\s*\(([^()]*)\)\s+FROM\s+stdin;\s*\n(.*?)^\\\.")
_CONSTRAINT = re.compile(r"\s*(?:PRIMARY|UNIQUE|FOREIGN|CONSTRAINT|CHECK|KEY|INDEX)\b", re.IGNORECASE)
_LATEX = r"\\begin\{(?:tabular\w*|longtable|array)\}"  # of several, each may be a scan
_MOST_SPANNED = {"row": 65_534, "col": 1000}  # that a cell may span, as HTML limits it


def plain_rows(text: str) -> str:
    r"""Return the rows of an HTML or LaTeX table with tabs between their cells; another text as it is.

    Examples
    --------
    >>> plain_rows("<tr><th>t</th><th>h</th></tr> <tr><td>0</td><td>&nbsp;</td></tr>")
    't\th\n0\t'
    >>> plain_rows(r"\begin{tabular}{rr} $t$/s & $v_h$/V \\ \midrule 0 & 2.5 \\ \end{tabular}")
    't/s\tv_h/V\n0\t2.5'
    """
    if re.search(r"<tr\b.*</t[dh]>", text, re.IGNORECASE | re.DOTALL):
        rows = re.findall(r"<tr\b.*?>(.*?)</tr>", text, re.IGNORECASE | re.DOTALL)
        cells = _spread(rows)
    elif len(re.findall(_LATEX, text)) == 1 and (
        inner := re.search(rf"{_LATEX}(.*)\\end\{{", text, re.DOTALL)
    ):
        body = re.sub(r"\A(?:\[.*?\])?\s*\{[^{}]*\}", "", inner[1])
        body = re.sub(r"\\(?:top|mid|bottom|h|c)(?:rule|line)(?:\{[^}]*\})?|(?<!\\)%.*", "", body)
        rows = [re.sub(r"\\(?:text|math)\w*\{([^}]*)\}|[${}]", r"\1", row) for row in body.split(r"\\")]
        cells = [re.sub(r"\\[;, ]", " ", row).split("&") for row in rows if row.strip()]
    elif dumped := dumped_tables(text):
        cells = max(dumped.values(), key=len)
    else:
        return text
    return "\n".join("\t".join(" ".join(c.split()) for c in row) for row in cells)


def _spread(rows: list[str]) -> list[list[str]]:
    """Return the cells of an HTML table's rows, those that span several rows or columns in each of them."""
    cells: list[list[str]] = []
    below: dict[int, tuple[int, str]] = {}  # column -> rows that its cell spans yet, and that cell
    for row in rows:
        made: list[str] = []
        for opened, inner in re.findall(r"<t[dh]\b(.*?)>(.*?)</t[dh]>", row, re.IGNORECASE | re.DOTALL):
            _fill(made, below)
            tall, wide = (
                min(int(m[1]), _MOST_SPANNED[s])
                if (m := re.search(rf"{s}span\s*=\s*[\"']?(\d+)", opened, re.IGNORECASE))
                else 1
                for s in ("row", "col")
            )
            cell = html.unescape(re.sub(r"<[^>]*>", "", inner))
            below |= {len(made) + n: (tall - 1, cell) for n in range(wide) if tall > 1}
            made += [cell] * wide
        _fill(made, below)
        cells.append(made)
    return cells


def _fill(row: list[str], below: dict[int, tuple[int, str]]) -> None:
    """Add to a row of cells those from above that stand next in it."""
    while len(row) in below:
        more, cell = below.pop(len(row))
        below |= {len(row): (more - 1, cell)} if more > 1 else {}
        row.append(cell)


def dumped_tables(text: str) -> dict[str, list[list[str]]]:
    """Return the tables of a dump of SQL: the names of the columns, and the rows.

    Nothing where those of one change within it.
    """
    quotes = " '\"`[]"
    names = {
        table.strip(quotes): [
            column.split()[0].strip(quotes)
            for column in _columns_of(inner)
            if column.split() and not _CONSTRAINT.match(column)
        ]
        for table, inner in _CREATED.findall(text)
    }
    found: dict[str, list[list[str]]] = {}
    for table, inner, many in _INSERTED.findall(text):
        table = table.strip(quotes)
        if inner:
            columns = [column.strip(quotes) for column in inner.split(",")]
            if table in found and names[table] != columns:
                return {}
            names[table] = columns
        groups = re.findall(r"\(((?:'[^']*'|[^()'])*)\)", many)
        split = [re.findall(r"\s*('[^']*'|[^,]*)(?:,|\Z)", group)[: group.count(",") + 1] for group in groups]
        found.setdefault(table, []).extend([c.strip(" '\"") for c in row] for row in split)
    for table, inner, rows in _COPIED.findall(text):
        names[table] = [column.strip(quotes) for column in inner.split(",")]
        found[table] = [line.replace("\\N", "").split("\t") for line in rows.splitlines() if line.strip()]
    return {table: [names[table], *rows] for table, rows in found.items() if rows and names.get(table)}


def _columns_of(inner: str) -> list[str]:
    r"""Return the columns that a table is created with, without remarks.

    Examples
    --------
    >>> _columns_of("t INTEGER, -- millis(), of the board\n e TEXT CHECK(e IN ('HI','LO')), v REAL")
    ['t INTEGER', "e TEXT CHECK(e IN ('HI','LO'))", 'v REAL']
    """
    plain = re.sub(r"--[^\n]*|/\*.*?\*/", "", inner)
    parts = [""]
    depth = 0
    for c in plain:
        depth += (c == "(") - (c == ")")
        if c == "," and not depth:
            parts.append("")
        else:
            parts[-1] += c
    return [" ".join(part.split()) for part in parts]
