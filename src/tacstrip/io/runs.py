"""Calibration runs as CSV: contacts of known place and what the strips read, or are yet to read.

Columns: strip, l_mm, w_mm, readings as in a readings file (v_h, v_l, v_out or codes), and where places are uncertain
l_sd_mm and w_sd_mm, their standard deviations; empty is exact. Rows that repeat a contact are repeats. A row without
readings is a contact still to be made; one with readings and without l_mm and w_mm is the strip untouched. `sensor` and
`unit`, which a plan has, name the sensor and the unit that the file is of.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from tacstrip.arguments import takes
from tacstrip.arrays import FloatArray, IntArray, extent
from tacstrip.errors import ReadingError
from tacstrip.io.column_names import nearly
from tacstrip.io.columns import PLACE, finite, strip_index, value, value_columns
from tacstrip.io.csv_rows import Row, csv_writer, find, read_csv
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.left_out import left_out
from tacstrip.sensor.spec import Sensor

_MOST_DEVIATION = 0.05  # of the length: places that are known no better calibrate nothing


@dataclass(frozen=True, eq=False)
class Runs:
    """Contacts strip by strip: column i of each array is strip i, the rows its contacts in the file's order.

    Attributes
    ----------
    l_mm, w_mm
        Lower end and length of the contacts (contacts, strips) [mm]; NaN below a strip's last contact.
    raw
        Raw readings over Vref by signature, of the same shape.
    line
        The file's line of each contact, of the same shape, 0 below the last.
    rest
        Raw readings of untouched strips by signature (rows, strips), NaN below the last.
    source, unit
        Name of the file, and of the unit where the file has it.
    open
        Rows without readings.
    l_sd_mm, w_sd_mm
        Standard deviations of the places [mm], of the contacts' shape; None: exact.

    Examples
    --------
    >>> import numpy as np
    >>> import tacstrip as ts
    >>> l_mm = np.repeat([[50.0], [150.0], [250.0]], 2, axis=1)  # three contacts across two strips
    >>> ts.Runs(l_mm, np.zeros((3, 2)), {"k": l_mm / 325.0}, line=np.arange(2, 8).reshape(3, 2), rest={})
    <Runs: 6 contacts on 2 strips, k, l 50 to 250, w 0 to 0 mm>
    """

    l_mm: FloatArray
    w_mm: FloatArray
    raw: dict[str, FloatArray]
    line: IntArray
    rest: dict[str, FloatArray]
    source: str = ""
    unit: str = ""
    open: int = 0
    l_sd_mm: FloatArray | None = None
    w_sd_mm: FloatArray | None = None

    def __repr__(self) -> str:
        strips, names = f"{self.l_mm.shape[1]} strips", ", ".join(self.raw)
        return f"<Runs: {self.count} contacts on {strips}, {names}, l {extent(self.l_mm)}, w {extent(self.w_mm)} mm>"

    @property
    def signatures(self) -> tuple[str, ...]:
        """Names of the signatures that were read."""
        return tuple(self.raw)

    @property
    def count(self) -> int:
        """How many contacts there are."""
        return int(np.isfinite(self.l_mm).sum())


@takes(sensor=Sensor)
@takes(path=Path | str)
def read_runs(path: str | Path, sensor: Sensor, unit: str = "", force: bool = False) -> Runs:
    r"""Read calibration runs.

    Parameters
    ----------
    path, sensor
        The file and the sensor that it is of.
    unit
        Name of this very unit; the file's own name for it must agree. By default that of the calibration.
    force
        Take runs that say that they are of another sensor or unit.

    Raises
    ------
    ReadingError
        The file cannot be read, lacks a column, has a value that cannot be, or is of another unit; the message
        names the line and the remedy.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-m", strips=1, pitch_mm=6.5, length_mm=325.0, vref_volt=5.0)
    >>> file = pathlib.Path(tempfile.mkdtemp()) / "runs.csv"
    >>> _ = file.write_text("strip,l_mm,w_mm,v_out\n0,65,0,1.05\n0,130,0,2.03\n")
    >>> ts.read_runs(file, sensor)
    <Runs: 2 contacts on 1 strips, k, l 65 to 130, w 0 to 0 mm>
    """
    known = unit or (sensor.calibration.unit if sensor.calibration else "")
    example = ",".join(["strip", "l_mm", "w_mm", *(SIGNATURES[n].volt_column for n in sensor.signatures)])
    parse = partial(_runs, sensor=sensor, unit=known, force=force, source=Path(path).name)
    return read_csv(path, "runs", parse, example)


def write_plan(
    path: str | Path, sensor: Sensor, contacts: Sequence[tuple[int, float, float]], unit: str = ""
) -> None:
    """Write contacts (strip from 0, l and w [mm]) as runs whose readings are yet to be filled in."""
    columns = [SIGNATURES[n].volt_column for n in sensor.signatures]
    with csv_writer(path, ["strip", "l_mm", "w_mm", *columns, "sensor", "unit"]) as out:
        for strip, l, w in contacts:
            place = [strip + sensor.strip_base, f"{l:.9g}", f"{w:.9g}"]
            out.writerow([*place, *[""] * len(columns), sensor.fingerprint, unit])


def _runs(
    header: list[str], rows: Iterator[Row], sensor: Sensor, unit: str, force: bool, source: str
) -> Runs:
    at = {name: find(header, name) for name in ("strip", "l_mm", "w_mm")}
    deviations = [header.index(name) if name in header else None for name in ("l_sd_mm", "w_sd_mm")]
    if misspelt := nearly(header, ["l_sd_mm", "w_sd_mm"], {*PLACE, "l_sd_mm", "w_sd_mm"}):
        raise ReadingError(misspelt)
    columns = value_columns(header, sensor)
    left = left_out(sensor)
    none = np.zeros(sensor.strips, bool)
    out_of = np.array([left.get(c.signature, none) for c in columns])  # (columns, strips)
    out = np.asarray(out_of.any(axis=0))
    named = {name: header.index(name) for name in ("sensor", "unit") if name in header}
    # A row is l, w, line, their deviations and the readings; of an untouched strip the readings alone.
    contacts: list[list[list[float]]] = [[] for _ in range(sensor.strips)]
    rest: list[list[list[float]]] = [[] for _ in range(sensor.strips)]
    open_rows, found_unit = 0, ""
    for line, row in rows:
        if not any(row):
            continue
        wanted = {"sensor": sensor.fingerprint, "unit": unit or found_unit}
        for name, index in named.items():
            if row[index] and wanted[name] and row[index] != wanted[name] and not force:
                raise ReadingError(
                    f"line {line}: the runs are of {name} {row[index]!r} and this {name} is {wanted[name]!r}; a "
                    "calibration holds for the unit it was made with. If they are one and the same, give --force"
                )
        found_unit = found_unit or (row[named["unit"]] if "unit" in named else "")
        strip = strip_index(row[at["strip"]], line, sensor)
        fields = [value(row[c.index], line, c) for c in columns]
        place = _place(row[at["l_mm"]], row[at["w_mm"]], line, sensor)
        if all(np.isnan(fields)):
            open_rows += not out[strip]
            continue
        if out[strip]:
            fields = [np.nan if empty else v for empty, v in zip(out_of[:, strip], fields, strict=True)]
        elif any(np.isnan(fields)):
            have, lack = (columns[i].name for i in np.argsort(np.isnan(fields), kind="stable")[[0, -1]])
            raise ReadingError(f"line {line}: {have} is there but no {lack}; give both or neither")
        if place is None:
            rest[strip].append(fields)
        else:
            sd = [_deviation(row[i], line, header[i], sensor) if i is not None else 0.0 for i in deviations]
            contacts[strip].append([*place, line, *sd, *fields])
    if not any(contacts) and not any(rest):
        why = f"all {open_rows} rows have empty readings" if open_rows else "it has a header and nothing else"
        raise ReadingError(f"there are no readings: {why}; press each contact and write down what it reads")
    if lack := [
        i for i, made in enumerate(contacts, sensor.strip_base) if not (made or out[i - sensor.strip_base])
    ][:10]:
        names = ", ".join(map(str, lack))
        raise ReadingError(f"no contact on strip {names} has readings; every strip needs contacts of its own")
    signatures = [c.signature for c in columns]
    l, w, lines, l_sd, w_sd, *raw = _gather(contacts, 5 + len(columns))
    uncertain = any(i is not None for i in deviations)
    return Runs(
        l, w, dict(zip(signatures, raw, strict=True)), np.nan_to_num(lines).astype(np.int64),
        dict(zip(signatures, _gather(rest, len(columns)), strict=True)), source, unit or found_unit, open_rows,
        l_sd if uncertain else None, w_sd if uncertain else None,
    )  # fmt: skip


def _deviation(text: str, line: int, name: str, sensor: Sensor) -> float:
    """Return the standard deviation of a place [mm], 0 where the field is empty."""
    sd = finite(text, line, name) if text else 0.0
    if not 0.0 <= sd <= _MOST_DEVIATION * sensor.length_mm:
        raise ReadingError(
            f"line {line}: {name} = {text}: the standard deviation of a place is 0 mm (exact) to "
            f"{_MOST_DEVIATION * sensor.length_mm:.3g} mm; measure the places better"
        )
    return sd


def _place(l_text: str, w_text: str, line: int, sensor: Sensor) -> tuple[float, float] | None:
    """Return l and w [mm], None for an untouched strip."""
    if not l_text and not w_text:
        return None
    if not l_text or not w_text:
        lack = "w_mm" if l_text else "l_mm"
        raise ReadingError(
            f"line {line}: {lack} is empty; a point contact has w_mm = 0, an untouched strip neither"
        )
    l, w = finite(l_text, line, "l_mm"), finite(w_text, line, "w_mm")
    length = sensor.length_mm
    if l < 0.0 or w < 0.0 or l + w > length * (1.0 + 1e-9):
        raise ReadingError(
            f"line {line}: a contact from l_mm = {l_text} over w_mm = {w_text} is not on a strip of {length:.6g} mm; "
            "l is the lower end from the grounded end of the strip, both in millimetres"
        )
    if sensor.sensing_ratio == 0.0 and w >= length:
        raise ReadingError(
            f"line {line}: the contact ties both ends of the strip to the metal; nothing can be read"
        )
    return l, w


def _gather(strips: list[list[list[float]]], columns: int) -> FloatArray:
    """Return the rows of all strips as (columns, rows, strips), NaN below the last row of a strip."""
    full = np.full((columns, max(map(len, strips)), len(strips)), np.nan)
    for i, rows in enumerate(strips):
        full[:, : len(rows), i] = np.reshape(rows, (-1, columns)).T
    return full
