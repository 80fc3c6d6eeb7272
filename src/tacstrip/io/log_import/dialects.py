"""Text of known dialects: Teleplot, InfluxDB's line protocol, Prometheus' samples, what Octave saves, YAML."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from tacstrip.errors import ReadingError
from tacstrip.io.log_import.arrays import of_arrays
from tacstrip.io.log_import.fields import number_of, says_nothing
from tacstrip.io.log_import.gathered import touched_vary
from tacstrip.io.log_import.strays import filled_lines
from tacstrip.io.log_import.table import Table, of_records
from tacstrip.io.log_import.yaml_text import of_yaml

_STEADY = 0.8  # of the lines
_TELEPLOT = re.compile(r">([^:|§\d][^:|§]*):(\d+(?:\.\d+)?):([^:;|§]+)(?:§([^|]*))?(?:\|\w*)?")
_KEYS = r"[^,=\s]+=(?:\"[^\"]*\"|[^,\s\"]+)"
_INFLUX = re.compile(rf"[^,=\s]+((?:,{_KEYS})*) ({_KEYS}(?:,{_KEYS})*) (\d{{10,19}})")
_SAVED = re.compile(
    r"(?m)^# name: (\w+)\n# type: (?:complex )?matrix\n((?:# .*\n)+)((?:[^#\n]*\n)+)"
)  # by Octave
_SAMPLE = re.compile(r"(\w+)\{([^{}]*)\} (\S+) (\d{10,19})\Z")  # of Prometheus


def of_dialect(text: str, path: str) -> Table | None:
    """Return a text of a known dialect as a table, not yet in normal form; None where it is of none."""
    readers: tuple[Callable[[str, str], Table | None], ...] = (
        _teleplot,
        _influx,
        _octave,
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


def _octave(text: str, path: str) -> Table | None:
    """Return what Octave saves as text: names, sizes, and the numbers below them."""
    arrays = {}
    for name, size, body in _SAVED.findall(text):
        values = [np.nan if says_nothing(f) or f == "NA" else number_of(f) for f in body.split()]
        shape = [int(n) for n in re.findall(r"(?:rows|columns): (\d+)", size)]
        if None in values or len(values) != int(np.prod(shape)):
            raise ReadingError(f"{path}: {name} is said to be of {shape} numbers, and is not: is it cut?")
        arrays[name] = np.array(values, dtype=np.float64).reshape(shape).squeeze()
    return of_arrays(arrays, path, {}, "matrices as Octave saves them") if arrays else None
