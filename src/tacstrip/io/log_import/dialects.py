"""Text of known dialects: Teleplot, InfluxDB's line protocol, Prometheus' samples, arrays, YAML."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from tacstrip.io.log_import.arrays import of_arrays
from tacstrip.io.log_import.fields import number_of, says_nothing
from tacstrip.io.log_import.gathered import touched_vary
from tacstrip.io.log_import.names import meaning
from tacstrip.io.log_import.strays import filled_lines
from tacstrip.io.log_import.table import ContradictionError, Table, of_records
from tacstrip.io.log_import.yaml_text import of_yaml

_STEADY = 0.8  # of the lines
_TELEPLOT = re.compile(r">([^:|§\d][^:|§]*):(\d+(?:\.\d+)?):([^:;|§]+)(?:§([^|]*))?(?:\|\w*)?")
_KEYS = r"[^,=\s]+=(?:\"[^\"]*\"|[^,\s\"]+)"
_INFLUX = re.compile(rf"[^,=\s]+((?:,{_KEYS})*) ({_KEYS}(?:,{_KEYS})*) (\d{{10,19}})")
_ARRAYS = (  # named arrays with their sizes, as Octave, h5dump and Igor Pro write them
    re.compile(
        r"(?m)^# name: (?P<name>\w+)\n# type: (?:complex )?matrix\n"
        r"(?P<shape>(?:# .*\n)+)(?P<body>(?:[^#\n]*\n)+)"
    ),
    re.compile(
        r"DATASET \"(?P<name>[^\"]+)\" \{[^{}]*(?:\{[^{}]*\}\s*)?DATASPACE\s+SIMPLE \{ \((?P<shape>[\d, ]+)\)"
        r"[^}]*\}\s*DATA \{(?P<body>[^}]*)\}(?P<behind>(?:(?!DATASET).)*)",
        re.DOTALL,
    ),
    re.compile(
        r"WAVES\S*?/N=\((?P<shape>[\d,]+)\)\S*\s+'?(?P<name>[\w ]+?)'?\s*[\r\n]+BEGIN\s(?P<body>.*?)\sEND\b",
        re.DOTALL,
    ),
)
_HEADED = re.compile(  # an array below a comment with its name, as np.savetxt writes each with its header
    r"(?m)^[#%]+[ \t]*(?P<name>[^\W\d]\w*(?:[ \t]*[\[(][^\])\n]*[\])])?)(?P<rest>[^\n]*)\n"
    r"(?P<body>(?:(?![#%])[^\n]*\S[^\n]*(?:\n|\Z))+)"
)
_RANGE = re.compile(  # of Octave
    r"(?m)^# name: (?P<name>\w+)\n# type: (?:double_)?range\n# base, limit, increment\n(?P<numbers>(?:\S+ ){2}\S+)$"
)
# A number or a text beside the arrays of Octave.
_BESIDE = re.compile(
    r"(?m)^# name: (?P<name>\w+)\n# type: (?:scalar|double|sq_string|string|bool)\n(?:# .*\n)*(?P<said>[^#\s].*)$"
)
_PLACE = re.compile(r"\(\d+(?:,\d+)*\):")  # of the number behind it, as h5dump writes
_STEP = re.compile(r"SetScale/P x [^,]+,([\d.eE+-]+),\"s\"")  # from scan to scan, of Igor
_UNIT_OF = re.compile(r"ATTRIBUTE \"units?\".*?\(0\): \"([^\s\"]+)", re.DOTALL)
_SAMPLE = re.compile(r"(\w+)\{([^{}]*)\} (\S+) (\d{10,19})\Z")  # of Prometheus


def of_dialect(text: str, path: str) -> Table | None:
    """Return a text of a known dialect as a table, not yet in normal form; None where it is of none."""
    readers: tuple[Callable[[str, str], Table | None], ...] = (
        _teleplot,
        _influx,
        _named_arrays,
        _headed_arrays,
        of_yaml,
    )
    return next((table for read in readers if (table := read(text, path)) is not None), None)


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
    return replace(of_records(records, lines, ".", told), varied=touched_vary(records) > 1)


def _teleplot(text: str, _: str) -> Table | None:
    lines = filled_lines(text)
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
    lines = [(i, _SAMPLE.sub(_as_influx, line)) for i, line in filled_lines(text) if not line.startswith("#")]
    found = [(i, m) for i, line in lines if (m := _INFLUX.fullmatch(line))]
    if len(found) < _STEADY * len(lines) or not found:
        return None
    entries = []
    for i, m in found:
        tags, fields = (dict(re.findall(r"([^,=]+)=(\"[^\"]*\"|[^,]+)", part)) for part in m.groups()[:2])
        values = {k: re.sub(r"(?<=\d)[iu]\Z", "", v).strip('"') for k, v in fields.items()}
        entries.append((i, {"time [ns]": _nanoseconds(m[3]), **tags}, values))
    table = _with_broken(_merged(entries, "InfluxDB's line protocol"), lines, _INFLUX)
    return replace(table, preamble=tuple(line for _, line in filled_lines(text) if line.startswith("#")))


def _as_influx(m: re.Match[str]) -> str:
    """Return a sample of Prometheus in InfluxDB's form."""
    labels = re.sub(r"\s|,\Z", "", m[2].replace('"', ""))
    return f"{m[1]}{',' * bool(labels)}{labels} value={m[3]} {m[4]}"


def _nanoseconds(stamp: str) -> str:
    return stamp + "0" * {10: 9, 13: 6, 16: 3}.get(len(stamp), 0)


def _with_broken(table: Table, lines: Sequence[tuple[int, str]], form: re.Pattern[str]) -> Table:
    broken = {i: line for i, line in lines if not form.fullmatch(line)}
    return replace(table, broken=tuple(broken), quotes=broken)


def _named_arrays(text: str, path: str) -> Table | None:
    """Return arrays that a program saved as text: names, sizes, and the numbers; other lines as lines above."""
    arrays: dict[str, npt.NDArray[np.float64]] = {}
    around, begins = text, dict[int, int]()  # the line with which an array of as many lines begins
    for m in (m for form in _ARRAYS for m in form.finditer(text)):
        name, shape = m["name"], [int(n) for n in re.findall(r"\d+", m["shape"])]
        fields = _PLACE.sub(" ", m["body"]).replace(",", " ").split()
        values = [np.nan if says_nothing(f) or f == "NA" else number_of(f) for f in fields]
        if None in values or len(values) != int(np.prod(shape)):
            raise ContradictionError(
                f"{path}: {name} is said to be of {shape} numbers, and is not: is it cut?"
            )
        unit = _UNIT_OF.search(m.groupdict().get("behind") or "")
        arrays[f"{name} [{unit[1]}]" if unit else name] = (
            np.array(values, dtype=np.float64).reshape(shape).squeeze()
        )
        around = around.replace(m["body"], "\n")
        begins.setdefault(m["body"].strip().count("\n") + 1, text.count("\n", 0, m.start("body")) + 1)
    if not arrays:
        return None
    for m in _RANGE.finditer(text):
        base, limit, by = (number_of(f) or 0.0 for f in m["numbers"].split())
        many = round((limit - base) / by) + 1 if by else 0
        if 0 < many <= text.count("\n"):  # of as many scans as there are lines
            arrays[m["name"]] = base + by * np.arange(many, dtype=np.float64)
    step = _STEP.search(text)
    said = {
        m["name"]: v if (v := number_of(m["said"])) is not None else m["said"] for m in _BESIDE.finditer(text)
    }
    told = said | ({"dt_s": float(step[1])} if step else {})
    table = of_arrays(arrays, path, told, "arrays with names and sizes")
    # Rows that wrap have no lines of their own; nothing that stands in between is of some only.
    first = begins.get(len(table.rows), 0)
    lines = [first + n if first else min(begins.values()) for n in range(len(table.rows))]
    table = replace(table, lines=lines)
    beside = [] if _ARRAYS[0].search(text) else filled_lines(around)  # Octave's are variables, too
    return replace(table, preamble=(*table.preamble, *(line for _, line in beside)))


def _headed_arrays(text: str, path: str) -> Table | None:
    """Return arrays one below the other, each below a comment that names its channel, or the time."""
    blocks = [m for m in _HEADED.finditer(text) if len(m["body"].splitlines()) > 1]
    said = [meaning(m["name"]) for m in blocks]
    ends = [s.channel for s in said if s.channel]
    apart = len({*ends}) == len(ends) > 1 and all(s.channel or s.role == "time" for s in said)
    rows = [_fields_of(m["body"]) for m in blocks]
    numbers = sum(len(block) for block in rows)
    if not apart or numbers != sum(not line.startswith(("#", "%")) for _, line in filled_lines(text)):
        return None
    if any(len({*map(len, block)}) > 1 for block in rows):
        return None  # names of columns, or a line that is torn
    arrays = {
        m["name"]: np.array(block, dtype=np.float64).squeeze() for m, block in zip(blocks, rows, strict=True)
    }
    table = of_arrays(arrays, path, {}, "arrays one below the other, each below its name")
    comments = [line.lstrip("#% \t") for _, line in filled_lines(text) if line.startswith(("#", "%"))]
    return replace(table, preamble=(*table.preamble, *comments))


def _fields_of(body: str) -> list[list[float]]:
    """Return the numbers of an array's lines, NaN for nothing; no rows where a field is neither."""
    rows = [re.split(r"[\s,;]+", line.strip()) for line in body.splitlines()]
    read = [[np.nan if says_nothing(f) else number_of(f) for f in row] for row in rows]
    known = [[v for v in row if v is not None] for row in read]
    return known if known == read else []
