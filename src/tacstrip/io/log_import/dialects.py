"""Text of known dialects: Teleplot, InfluxDB's line protocol, YAML, MATLAB's and R's print, HTML and LaTeX tables."""

from __future__ import annotations

import html
import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from tacstrip.errors import ReadingError
from tacstrip.io.log_import.arrays import of_arrays
from tacstrip.io.log_import.fields import number_of, says_nothing
from tacstrip.io.log_import.names import meaning
from tacstrip.io.log_import.records import of_values
from tacstrip.io.log_import.table import Table, of_records

_STEADY = 0.8  # of the lines
_FEW = 2  # records
_TELEPLOT = re.compile(r">([^:|§\d][^:|§]*):(\d+(?:\.\d+)?):([^:;|§]+)(?:§([^|]*))?(?:\|\w*)?")
_KEYS = r"[^,=\s]+=(?:\"[^\"]*\"|[^,\s\"]+)"
_INFLUX = re.compile(rf"[^,=\s]+((?:,{_KEYS})*) ({_KEYS}(?:,{_KEYS})*) (\d{{10,19}})")
_SAMPLE = re.compile(r"(\w+)\{([^{}]*)\} (\S+) (\d{10,19})\Z")  # of Prometheus
_ITEM = re.compile(r"\s*(?:- )*\s*(?:-|[\w.\"'/ -]+:(?:\s.*)?|- .*|---|\.\.\.|#.*)?")
_ASSIGNED = re.compile(r"([A-Za-z_][\w.]*)\s*=\s*(\[[^\]]*\]|[^;\n\[]+)\s*'?\s*;?")
_RANGE = re.compile(r"\(?([^:()]+):([^:()]+)(?::([^:()]+))?\)?(?:\s*\.?([*/])\s*(.+))?")
_PRINTED = re.compile(r"\s*\[(\d+)\]\s+(.*)")  # R's print of a vector
_NAMED = re.compile(r"(?:\$|>\s*(?:print\()?)\s*([A-Za-z][\w.$]*)\)?\s*")
_WITHIN = r"(?:[^()]|\((?:[^()]|\([^()]*\))*\))*"  # brackets in brackets, as of a CHECK
_CREATED = re.compile(
    rf"CREATE\s+TABLE\s+(?:IF\s+NOT\s+EXISTS\s+)?([^\s(]+)\s*\(({_WITHIN})\)", re.IGNORECASE
)
_INSERTED = re.compile(
    r"INSERT\s+INTO\s+(\S+?)\s+VALUES\s*((?:\((?:'[^']*'|[^()'])*\)[,\s]*)+);", re.IGNORECASE
)
_COPIED = re.compile(r"(?ms)^COPY\s+(\S+)\s*\(([^()]*)\)\s+FROM\s+stdin;\s*\n(.*?)^\\\.")
_CONSTRAINT = re.compile(r"\s*(?:PRIMARY|UNIQUE|FOREIGN|CONSTRAINT|CHECK|KEY|INDEX)\b", re.IGNORECASE)
_VECTOR = re.compile(r"`?([\w.]+)`?\s*=\s*c\(([^()]*)\)")

_HDF5_SET = re.compile(r'(DATASET|ATTRIBUTE) "([^"]+)" \{((?:[^{}]|\{[^{}]*\})*?)\n?\s*\}')
_HDF5_DATA = re.compile(r"DATASPACE\s+(?:SCALAR|SIMPLE \{ \(([\d, ]+)\)[^{}]*\})[\s\S]*?DATA \{([^{}]*)\}")
_SAVED = re.compile(r"(?m)^# name: (\w+)\n# type: (?:complex )?matrix\n((?:# .*\n)+)((?:[^#\n]*\n)+)")
_ENTRY = r"(?:[-+]?\d[\d.]*(?:[eE][-+]?\d+)?|(?i:nan)|NA)"
_MATRIX_ROW = rf"[ \t]*{_ENTRY}(?:[ \t]+{_ENTRY})*[ \t]*\n"
_MATRIX = re.compile(
    rf"(?m)^[ \t]*([A-Za-z]\w*) =[ \t]*\n\s*\n((?:{_MATRIX_ROW})+)"
)  # as MATLAB prints a matrix


def of_dialect(text: str, path: str) -> Table | None:
    """Return a text of a known dialect as a table, not yet in normal form; None where it is of none."""
    readers: tuple[Callable[[str, str], Table | None], ...] = (
        _teleplot,
        _influx,
        _hdf5,
        _octave,
        _matlab,
        _of_r,
        _yaml,
    )
    return next((table for read in readers if (table := read(text, path)) is not None), None)


_MOST_SPANNED = 10_000  # rows or columns that a cell may span


def of_displayed_scans(text: str) -> str:
    r"""Return what MATLAB displays scan by scan, `ans = ...` and vectors, as lines of fields; another text as it is.

    Examples
    --------
    >>> of_displayed_scans("ans =\n\n  0.0\n\nvh =\n\n  2.5  NaN\n\nans =\n\n  0.1\n\nvh =\n\n  2.6  NaN\n")
    'ans\tvh 0\tvh 1\n0.0\t2.5\tNaN\n0.1\t2.6\tNaN\n'
    """
    found = [(m[1], m[2].split()) for m in _MATRIX.finditer(text + "\n") if "\n" not in m[2].strip()]
    names = list(dict.fromkeys(name for name, _ in found))
    scans = [found[n : n + len(names)] for n in range(0, len(found), len(names) or 1)]
    usual = [(name, len(values)) for name, values in scans[0]] if scans else []
    rest = re.sub(r"(?m)^>>.*$", "", _MATRIX.sub("", text + "\n"))
    if len(scans) < _FEW or any([(n, len(v)) for n, v in scan] != usual for scan in scans) or rest.strip():
        return text
    # What has no name is that which the command does not assign, as t(i) in ">> t(i), v = V(i,:)".
    pieces = re.split(r"[,;]\s|\n", "\n".join(re.findall(r"(?m)^>>(.*)$", text)))
    bare = [m[1] for piece in pieces if (m := re.fullmatch(r"\s*([A-Za-z]\w*)(?:\([^()]*\))?\s*", piece))]
    bare = [meaning(name).role for name in bare if meaning(name).role in ("time", "scan")]
    unnamed = bare[0] if len(bare) == 1 else "ans"
    called = [
        unnamed if name == "ans" else name if many == 1 else f"{name} {n}"
        for name, many in usual
        for n in range(many)
    ]
    rows = [[value for _, values in scan for value in values] for scan in scans]
    above = [line for line in text.splitlines() if line.startswith(">>") and line.strip(" >")]
    return "\n".join([*(f"% {line}" for line in above), *("\t".join(row) for row in [called, *rows])]) + "\n"


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
    elif inner := re.search(r"\\begin\{(?:tabular\w*|longtable|array)\}(.*)\\end\{", text, re.DOTALL):
        body = re.sub(r"\A(?:\[.*?\])?\s*\{[^{}]*\}", "", inner[1])
        body = re.sub(r"\\(?:top|mid|bottom|h|c)(?:rule|line)(?:\{[^}]*\})?|(?<!\\)%.*", "", body)
        rows = [re.sub(r"\\(?:text|math)\w*\{([^}]*)\}|[${}]", r"\1", row) for row in body.split(r"\\")]
        cells = [re.sub(r"\\[;, ]", " ", row).split("&") for row in rows if row.strip()]
    elif inserted := re.findall(
        r"INSERT INTO \S+ *\(([^()]*)\) *VALUES *((?:\([^()]*\)[,\s]*)+);", text, re.IGNORECASE
    ):
        if len({names for names, _ in inserted}) > 1:
            return text
        groups = [inserted[0][0], *(g for _, many in inserted for g in re.findall(r"\(([^()]*)\)", many))]
        cells = [[c.strip(" '\"`") for c in group.split(",")] for group in groups]
    elif dumped := _dumped(text):
        cells = dumped
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
                min(int(m[1]), _MOST_SPANNED)
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


def _dumped(text: str) -> list[list[str]]:
    """Return the names and the rows of the longest table of a dump of SQL that names columns only once; else none."""
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
    for table, many in _INSERTED.findall(text):
        groups = re.findall(r"\(((?:'[^']*'|[^()'])*)\)", many)
        split = [re.findall(r"\s*('[^']*'|[^,]*)(?:,|\Z)", group)[: group.count(",") + 1] for group in groups]
        found.setdefault(table.strip(quotes), []).extend([c.strip(" '\"") for c in row] for row in split)
    for table, inner, rows in _COPIED.findall(text):
        names[table] = [column.strip(quotes) for column in inner.split(",")]
        found[table] = [line.replace("\\N", "").split("\t") for line in rows.splitlines() if line.strip()]
    longest = max(found, key=lambda table: len(found[table]), default="")
    if not found.get(longest) or not names.get(longest):
        return []
    return [names[longest], *found[longest]]


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


def _lines(text: str) -> list[tuple[int, str]]:
    return [(i, line.strip()) for i, line in enumerate(text.splitlines(), 1) if line.strip()]


def _merged(entries: Iterable[tuple[int, Mapping[str, str], Mapping[str, str]]], told: str) -> Table:
    """Return values below labels as records: a new one begins with other labels, or a name that comes again."""
    records: list[dict[str, str]] = []
    lines: list[int] = []
    last: Mapping[str, str] | None = None
    for line, labels, values in entries:
        if labels != last or any(name in records[-1] for name in values):
            records.append(dict(labels))
            lines.append(line)
            last = labels
        records[-1] |= values
    return of_records(records, lines, ".", told)


def _teleplot(text: str, _: str) -> Table | None:
    lines = _lines(text)
    found = [(i, m) for i, line in lines if (m := _TELEPLOT.fullmatch(line))]
    if len(found) < _STEADY * len(lines) or len(found) < 2:
        return None
    entries = []
    for i, m in found:
        name, time, value, unit = (part.strip() if part else "" for part in m.groups())
        if number_of(value) is not None or says_nothing(value):
            entries.append((i, {"time [ms]": time}, {f"{name} [{unit}]" if unit else name: value}))
    table = _merged(entries, "Teleplot's lines: name, milliseconds, value")
    return _with_broken(table, [(i, x) for i, x in lines if x.startswith(">") and ":ok" not in x], _TELEPLOT)


def _influx(text: str, _: str) -> Table | None:
    lines = [(i, _SAMPLE.sub(_as_influx, line)) for i, line in _lines(text) if not line.startswith("#")]
    found = [(i, m) for i, line in lines if (m := _INFLUX.fullmatch(line))]
    if len(found) < _STEADY * len(lines) or not found:
        return None
    entries = []
    for i, m in found:
        tags, fields = (dict(re.findall(r"([^,=]+)=(\"[^\"]*\"|[^,]+)", part)) for part in m.groups()[:2])
        values = {k: re.sub(r"(?<=\d)[iu]\Z", "", v).strip('"') for k, v in fields.items()}
        entries.append((i, {"time [ns]": _nanoseconds(m[3]), **tags}, values))
    return _with_broken(_merged(entries, "InfluxDB's line protocol"), lines, _INFLUX)


def _as_influx(m: re.Match[str]) -> str:
    """Return a sample of Prometheus in InfluxDB's form."""
    labels = re.sub(r"\s|,\Z", "", m[2].replace('"', ""))
    return f"{m[1]}{',' * bool(labels)}{labels} value={m[3]} {m[4]}"


def _nanoseconds(stamp: str) -> str:
    return stamp + "0" * {10: 9, 13: 6, 16: 3}.get(len(stamp), 0)


def _with_broken(table: Table, lines: Sequence[tuple[int, str]], form: re.Pattern[str]) -> Table:
    broken = {i: line for i, line in lines if not form.fullmatch(line)}
    return replace(table, broken=tuple(broken), quotes=broken)


def _hdf5(text: str, path: str) -> Table | None:
    """Return what h5dump prints of data sets of numbers."""
    if not re.match(r'\s*HDF5 "', text):
        return None
    arrays: dict[str, npt.NDArray[Any]] = {}
    numbers: dict[str, float] = {}
    for kind, name, inner in _HDF5_SET.findall(text):
        found = _HDF5_DATA.search(inner)
        fields = (
            re.split(r"[,\s]+", re.sub(r"\(\d+(?:,\d+)*\):", " ", found[2]).strip(", \n")) if found else []
        )
        values = _vector(fields) if found else None
        if found is None or values is None:
            continue
        shape = [int(n) for n in re.findall(r"\d+", found[1] or "")]
        if kind == "ATTRIBUTE" or not shape:
            numbers |= {name: float(values[0])} if len(values) == 1 else {}
        elif len(values) != int(np.prod(shape)):
            raise ReadingError(
                f"{path}: {name} holds {len(values)} numbers, and {found[1].strip()} are said: is it cut?"
            )
        else:
            arrays[name] = values.reshape(shape)
    return of_arrays(arrays, path, numbers, "data sets as h5dump prints them") if arrays else None


def _octave(text: str, path: str) -> Table | None:
    """Return what Octave saves as text: names, sizes, and the numbers below them."""
    arrays: dict[str, npt.NDArray[Any]] = {}
    for name, size, body in _SAVED.findall(text):
        values = _vector(body.split())
        shape = [int(n) for n in re.findall(r"(?:rows|columns): (\d+)", size)]
        if values is None or len(values) != int(np.prod(shape)):
            raise ReadingError(f"{path}: {name} is said to be of {shape} numbers, and is not: is it cut?")
        arrays[name] = values.reshape(shape).squeeze()
    return of_arrays(arrays, path, {}, "matrices as Octave saves them") if arrays else None


# YAML


def yaml_documents(text: str) -> tuple[list[tuple[int, Any]], list[tuple[int, str]]]:
    """Return the documents of a text in YAML with their lines, and its comments; nothing where it is none."""
    comments = [
        (i, line.strip()) for i, line in enumerate(text.splitlines(), 1) if re.search(r"(?:\A|\s)#\s", line)
    ]
    documents: list[tuple[int, list[str]]] = [(0, [])]
    for i, line in enumerate(text.splitlines(), 1):
        plain = re.sub(r"(?:\A|\s+)#\s.*", "", line).rstrip()
        if plain in ("---", "...") or re.fullmatch(r"\s.*\w---", plain):  # as behind a message that ROS lost
            documents.append((0, []))
        elif plain and (plain.startswith("\t") or not (":" in plain or plain.lstrip().startswith("-"))):
            comments.append((i, plain.strip()))  # no line of YAML
        elif plain:
            first, doc = documents[-1]
            documents[-1] = (first or i, [*doc, plain])
    every = [line for _, doc in documents for line in doc]
    if not (
        all(map(_ITEM.fullmatch, every))
        and any(re.fullmatch(r"\s*(?:- )?[\w.\"' -]+:", line) for line in every)
    ):
        return [], []
    try:
        return [(i, _block(doc)[0]) for i, doc in documents if doc], comments
    except (ValueError, RecursionError):
        return [], []


def _yaml(text: str, path: str) -> Table | None:
    numbered = [
        (i, line.rstrip())
        for i, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    lines = [line for _, line in numbered]
    blocks = any(re.fullmatch(r"\s*(?:- )?[\w.-]+:", line) for line in lines) or lines[:1] == ["---"]
    lists = [line for line in lines if re.match(r"\s*- ", line)]
    if not (blocks or lists) or not all(_ITEM.fullmatch(line) for line in lines):
        return None
    if not any(re.match(r"\s*- (?:\w+:|\S+\Z)", line) for line in lists):
        return None
    documents: list[tuple[int, list[str]]] = [(0, [])]
    for i, line in numbered:
        if line in ("---", "..."):
            documents.append((0, []))
        else:
            first, doc = documents[-1]
            doc.append(line)
            documents[-1] = (first or i, doc)
    try:
        found = [(i, _block(doc)[0]) for i, doc in documents if doc]
    except ValueError:
        return None
    if len(found) == 1:
        value = found[0][1]
        return of_values(value if isinstance(value, list) else [value], path, "documents in YAML")
    keys = [set(_paths(value)) for _, value in found]
    cut = len(found) > _FEW and (keys[-1] < set.intersection(*keys[:-1]) or _ends_within(text, documents))
    table = of_values(found[: len(found) - cut], path, "documents in YAML", numbered=True)
    return (
        replace(table, broken=(found[-1][0],), quotes={found[-1][0]: "the last record"})
        if table and cut
        else table
    )


def _ends_within(text: str, documents: Sequence[tuple[int, list[str]]]) -> bool:
    """Return whether a text ends within its last line: that is shorter than the last lines of all other documents."""
    last = [len(doc[-1].strip()) for _, doc in documents if doc]
    return not text.endswith(("\n", "\r")) and last[-1] < min(last[:-1])


def _paths(value: Any, before: str = "") -> Iterable[str]:
    """Yield the keys of all levels of a record."""
    parts = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in parts:
        yield f"{before}{key}"
        yield from _paths(inner, f"{before}{key}.")


def _block(lines: list[str], start: int = 0) -> tuple[Any, int]:
    """Return the value that begins at a line of YAML, and the line after it; `ValueError` where it is none."""
    if start == len(lines):  # the log ends within it
        return "", start
    depth = len(lines[start]) - len(lines[start].lstrip())
    listed = lines[start].lstrip().startswith("-")
    many: list[Any] = []
    named: dict[str, Any] = {}
    n = start
    while n < len(lines):
        text = lines[n].lstrip()
        inside = len(lines[n]) - len(text)
        if inside < depth or (inside == depth and text.startswith("-") != listed):
            break
        if inside > depth:
            raise ValueError(lines[n])
        if listed:
            rest = text[1:].lstrip()
            if re.match(r"[\w.\"'-]+:(?:\s|\Z)", rest) or rest.startswith(
                "- "
            ):  # a record begins behind the dash
                lines = [*lines[:n], " " * (inside + len(text) - len(rest)) + rest, *lines[n + 1 :]]
                value, n = _block(lines, n)
            elif rest:
                value, n = _scalar(rest), n + 1
            else:
                value, n = _block(lines, n + 1)
            many.append(value)
            continue
        key, colon, rest = text.partition(":")
        if not colon:
            raise ValueError(text)
        n += 1
        value = _scalar(rest.strip()) if rest.strip() else None
        if not rest.strip() and n < len(lines):
            below = lines[n].lstrip()
            if len(lines[n]) - len(below) > depth or (
                len(lines[n]) - len(below) == depth and below.startswith("-")
            ):
                value, n = _block(lines, n)
        named[key.strip("\"' ")] = value
    return (many if listed else named), n


def _scalar(text: str) -> Any:
    plain = re.sub(r"\s+#.*", "", text)
    if plain[:1] in "[{":
        quoted = re.sub(r"(?<![\w.\"])([A-Za-z_][\w.-]*)(?=\s*:)", r'"\1"', plain)
        quoted = re.sub(r"(?<![\w\"])(?:[.]nan|nan|NaN|[.]NaN|None|~)(?![\w\"])", "null", quoted)
        return json.loads(quoted)
    return None if plain in ("~", "null") else plain.strip("\"'")


# Scripts and prints of MATLAB, Octave, Julia and R


def _matlab(text: str, path: str) -> Table | None:
    plain = re.sub(r"(?m)%.*$|^\s*//.*$", "", text)
    plain = re.sub(r"\.\.\.[^\n]*\n", " ", plain)
    if len(_MATRIX.findall(plain)) > 1:
        plain = _MATRIX.sub(r"\1 = [\2];\n", plain)
    if not re.search(r"(?m)^\s*[A-Za-z_][\w.]*\s*=\s*\[", plain):
        return None
    found = [(m[1].rpartition(".")[2], m[2].strip()) for m in _ASSIGNED.finditer(plain)]
    rest = _ASSIGNED.sub("", plain)
    if re.search(r"\d", rest) or len({name for name, _ in found}) < len(found):
        return None
    arrays: dict[str, npt.NDArray[Any]] = {}
    numbers: dict[str, float] = {}
    for name, value in found:
        if value.startswith("["):
            array = _matrix(value[1:-1])
            if array is None:
                return None
            arrays[name] = array
        elif (number := number_of(value)) is not None:
            numbers[name] = number
        elif (steps := _range(value, numbers)) is not None:
            arrays[name] = steps
    if not arrays:
        return None
    table = of_arrays(_in_columns(arrays), path, numbers, "a script's matrices")
    said = [line for line in text.splitlines() if re.match(r"\s*(?:>>|%|//)", line) or "%" in line]
    return replace(table, preamble=(*table.preamble, *said))


def _matrix(text: str) -> npt.NDArray[np.float64] | None:
    """Return a matrix as MATLAB writes it; None where something in it is no number."""
    rows = [re.split(r"[,\s]+", row.strip(" \t,")) for row in re.split(r"[;\n]", text) if row.strip(" \t,")]
    read = [[float("nan") if says_nothing(f) else number_of(f) for f in row] for row in rows]
    if not rows or len({len(row) for row in rows}) > 1 or any(v is None for row in read for v in row):
        return None
    return np.array(read, dtype=np.float64)


def _in_columns(arrays: Mapping[str, npt.NDArray[Any]]) -> dict[str, npt.NDArray[Any]]:
    """Return arrays with vectors of one row or column as such."""
    return {name: a.ravel() if a.ndim == 2 and 1 in a.shape else a for name, a in arrays.items()}


def _range(text: str, numbers: Mapping[str, float]) -> npt.NDArray[np.float64] | None:
    """Return the numbers of a range such as "0:0.05:1" or "(0:11)/fs"; None where it is none."""

    def of(part: str | None) -> float | None:
        part = (part or "").strip(" ()'")
        sums = part.partition("-")
        if sums[1] and sums[0].strip() in numbers:  # as in 0:n-1
            less = number_of(sums[2].strip())
            return None if less is None else numbers[sums[0].strip()] - less
        return numbers.get(part, number_of(part))

    found = _RANGE.fullmatch(text.strip(" ;'"))
    if not found:
        return None
    first, second, third = of(found[1]), of(found[2]), of(found[3])
    factor = of(found[5]) if found[5] else 1.0
    if first is None or second is None or not factor or (found[3] and third is None):
        return None
    step, last = (1.0, second) if third is None else (second, third)
    if not step or not 0.0 <= (last - first) / step < 1e7:
        return None
    made = first + step * np.arange(int((last - first) / step + 1e-9) + 1)
    return np.asarray(made / factor if found[4] == "/" else made * factor)


def _of_r(text: str, path: str) -> Table | None:
    """Return vectors that R printed or dumped, or a matrix that it printed."""
    if re.match(r"\s*(?:\w+\s*(?:<-|=)\s*)?(?:structure\()?(?:list|data\.frame)\(", text):
        vectors = {
            n: v for n, v in _VECTOR.findall(text) if n not in ("row.names", "class", "names", ".Names")
        }
        arrays = {name: _vector(inner.split(",")) for name, inner in vectors.items()}
        kept = {name: a for name, a in arrays.items() if a is not None}
        return of_arrays(kept, path, {}, "vectors of R") if len(kept) > 1 else None
    lines = _lines(text)
    printed = [(i, _PRINTED.fullmatch(line), _NAMED.fullmatch(line)) for i, line in lines]
    if next((p[1] for _, p, _ in printed if p), "") != "1" or not all(p or n for _, p, n in printed):
        return None
    series: list[tuple[int, str, list[str]]] = []
    name = ""
    for i, values, named in printed:
        if named:
            name = named[1]
        elif values and values[1] == "1":
            series.append((i, name, values[2].split()))
            name = ""
        elif values and series:
            series[-1][2].extend(values[2].split())
    if all(n for _, n, _ in series) and len({n for _, n, _ in series}) == len(series) > 1:
        read = {n: _vector(fields) for _, n, fields in series}
        kept = {n: a for n, a in read.items() if a is not None}
        return of_arrays(kept, path, {}, "vectors of R") if len(kept) == len(read) else None
    if any(n for _, n, _ in series) or len({len(f) for _, _, f in series}) > 1:
        return None
    names = tuple(f"column {n + 1}" for n in range(len(series[0][2])))
    rows = [[f.strip('"') for f in fields] for _, _, fields in series]
    return Table(names, rows, [i for i, _, _ in series], named=False, remarks=("R's print of vectors",))


def _vector(fields: Sequence[str]) -> npt.NDArray[np.float64] | None:
    plain = [re.sub(r"(?<=\d)L\Z", "", f.strip().strip('"')) for f in fields]
    spread: list[float | None] = []
    for f in plain:
        if found := re.fullmatch(r"(\d+):(\d+)", f):
            spread += [float(v) for v in range(int(found[1]), int(found[2]) + 1)]
        else:
            spread.append(float("nan") if says_nothing(f) or f == "NA" else number_of(f))
    return None if None in spread else np.array(spread, dtype=np.float64)
