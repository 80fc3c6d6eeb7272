"""Logs in Arrow's types and in frames; messages among readings; scans whose strips have times of their own."""

from __future__ import annotations

import decimal
import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.io.log_import.containers import read_table
from tacstrip.io.log_import.guess import Proposal, propose
from tacstrip.io.log_import.names import meaning
from tacstrip.io.log_import.questions import Unanswered
from tacstrip.io.log_import.text import of_text

pa = pytest.importorskip("pyarrow")
parquet = pytest.importorskip("pyarrow.parquet")

STRIPS, SCANS = 4, 24
RUBBER = ts.Sensor(construction="crs-crs", strips=STRIPS, pitch_mm=8.0, length_mm=150.0, vref_volt=5.0)
N, S = np.ogrid[:SCANS, :STRIPS]
OPEN = (N - 3 * S < 2) | (N - 3 * S > 13)
HIGH = np.where(OPEN, np.nan, np.round(1.6 + 0.05 * N + 0.03 * S, 3))
LOW = np.where(OPEN, np.nan, np.round(1.1 + 0.05 * N - 0.02 * S, 3))
BOTH = np.stack([HIGH, LOW], axis=2)
NANOSECONDS = [1_712_045_523_123_430_513 + 20_003_117 * n for n in range(SCANS)]
STEP = 0.020003117


def values(found: Proposal) -> np.ndarray:
    return np.stack([scan.values for scan in found.scans])


def times(found: Proposal) -> list[float]:
    return [scan.time_s for scan in found.scans]


def field(value: float, none: str, form: str = ".3f") -> str:
    return none if np.isnan(value) else format(value, form)


def of_parquet(folder: Path, stamps: Any, kind: Any = None, convert: Any = lambda v: v) -> Proposal:
    """Return what is proposed for a file with a column of times and one of each strip and end, of an Arrow type."""
    columns = {"stamp": stamps}
    for s, (end, read) in itertools.product(range(STRIPS), (("high", HIGH), ("low", LOW))):
        column = [None if np.isnan(v) else convert(float(v)) for v in read[:, s]]
        columns[f"strip_{s}.{end}"] = pa.array(column, kind)
    parquet.write_table(pa.table(columns), folder / "log.parquet")
    return propose(read_table(folder / "log.parquet"), RUBBER)


@pytest.mark.parametrize(
    "kind",
    [
        *(pa.timestamp("ns"), pa.timestamp("ns", "UTC"), pa.timestamp("ns", "+02:00")),
        *(pa.duration("ns"), pa.time64("ns")),
    ],
)
def test_times_in_nanoseconds_are_read(kind: Any, tmp_path: Path) -> None:
    first = NANOSECONDS[0] if pa.types.is_timestamp(kind) else NANOSECONDS[0] % 86_400_000_000_000
    first = 0 if pa.types.is_duration(kind) else first
    found = of_parquet(tmp_path, pa.array([first + n - NANOSECONDS[0] for n in NANOSECONDS], kind))
    np.testing.assert_allclose(times(found), STEP * np.arange(SCANS), atol=2e-6)
    np.testing.assert_allclose(values(found), BOTH, atol=1e-9)


def test_durations_go_on_through_a_day(tmp_path: Path) -> None:
    found = of_parquet(
        tmp_path, pa.array([86_400_000 - 200 + 20 * n for n in range(SCANS)], pa.duration("ms"))
    )
    np.testing.assert_allclose(times(found), 0.02 * np.arange(SCANS), atol=1e-6)


@pytest.mark.parametrize(
    ("kind", "convert"),
    [
        (pa.decimal128(10, 3), lambda v: decimal.Decimal(f"{v:.3f}")),
        (pa.large_string(), lambda v: f"{v:.3f}"),
        (pa.float16(), np.float16),
        (pa.dictionary(pa.int32(), pa.string()), lambda v: f"{v:.3f}"),
    ],
)
def test_values_of_other_types_are_read(kind: Any, convert: Any, tmp_path: Path) -> None:
    found = of_parquet(tmp_path, pa.array(NANOSECONDS, pa.timestamp("ns", "UTC")), kind, convert)
    np.testing.assert_allclose(values(found), BOTH, rtol=1e-3)


def records(n: int, **ends: np.ndarray) -> list[dict[str, Any]]:
    """Return the touched strips of a scan as records."""
    return [
        {"strip": s} | {e: float(v[n, s]) for e, v in ends.items()} for s in range(STRIPS) if not OPEN[n, s]
    ]


def test_records_within_columns_are_read(tmp_path: Path) -> None:
    time = 0.05 * np.arange(SCANS)
    lists = pa.table({"t_s": time, "contacts": [records(n, v_high=HIGH, v_low=LOW) for n in range(SCANS)]})
    none = [[None if np.isnan(v) else float(v) for v in pair] for pair in BOTH.reshape(-1, 2)]
    ends = [dict(zip(("high", "low"), pair, strict=True)) for pair in none]
    structs = pa.table({"t_s": time} | {f"strip_{s}": ends[s::STRIPS] for s in range(STRIPS)})
    for table in (lists, structs):
        parquet.write_table(table, tmp_path / "log.parquet")
        found = propose(read_table(tmp_path / "log.parquet"), RUBBER)
        np.testing.assert_allclose(values(found), BOTH, atol=1e-9)


class Series(list[Any]):
    """What a column of Polars is: a list within it is a column, which is no list."""

    def __iter__(self) -> Any:
        return (Series(v) if isinstance(v, list) else v for v in super().__iter__())

    def __bool__(self) -> bool:
        raise TypeError("the truth value of a Series is ambiguous")

    def __ne__(self, other: object) -> Any:
        return Series()

    def to_list(self) -> list[Any]:
        return [*super().__iter__()]


class Frame(dict[str, Any]):
    """What a frame is to `read_readings`."""

    columns = property(list)
    index: Any = None


class Levels:
    """An index of two levels, as of pandas."""

    names = ("t_s", "strip")

    def get_level_values(self, place: int) -> list[float]:
        return [(n * 0.05, s)[place] for n in range(SCANS) for s in range(STRIPS)]


def test_frames_with_lists_and_with_levels_are_read() -> None:
    lists = Frame(
        t_s=Series(0.05 * n for n in range(SCANS)), v_h=Series(HIGH.tolist()), v_l=Series(LOW.tolist())
    )
    levels = Frame(v_h=HIGH.ravel().tolist(), v_l=LOW.ravel().tolist())
    levels.index = Levels()
    for frame in (lists, levels):
        scans = ts.read_readings(frame, RUBBER)
        np.testing.assert_allclose([scan["kh"] * 5.0 for scan in scans], HIGH, atol=1e-9)
        np.testing.assert_allclose([scan.time_s for scan in scans], 0.05 * np.arange(SCANS), atol=1e-9)


def monitored(message: str, prefix: str) -> str:
    """Return a log of a line per scan and strip, with a message in the tenth scan."""
    lines: list[str] = []
    for n in range(SCANS):
        lines += [prefix.format(520 + 100 * n) + f"scan {n}", *([message] if n == 10 else [])]
        for s in range(STRIPS):
            ends = f"vh={1000 * HIGH[n, s]:.0f} mV vl={1000 * LOW[n, s]:.0f} mV"
            lines.append(
                prefix.format(521 + 100 * n) + f"  strip {s}: {'no contact' if OPEN[n, s] else ends}"
            )
    return "\n".join([*lines, ""])


@pytest.mark.parametrize(
    ("message", "prefix"),
    [
        ("wifi: link up idx=0 tid=0 ssn=4", ""),
        ("W (1681) wifi:<ba-add>idx:0 (ifx:0, aa:bb:cc:dd:ee:ff), tid:0, ssn:4, winSize:64", "I ({}) TACT: "),
    ],
)
def test_a_message_with_labels_costs_no_scan(message: str, prefix: str) -> None:
    table = of_text(monitored(message, prefix))
    assert (len(table.rows), table.broken) == (SCANS * STRIPS, ())
    found = propose(table, RUBBER, {"rate_hz": "10"})
    np.testing.assert_allclose(values(found), 1000.0 * BOTH)


@pytest.mark.parametrize("late", [0.0, 0.004])
def test_entities_with_times_of_their_own_are_put_together(late: float) -> None:
    rows = [
        f"sensor.skin_strip_{s + 1}_{end},{field(read[n, s], 'unknown')},"
        f"2024-09-01T17:22:{n + 10 + late * (2 * s + e):06.3f}Z"
        for s, (e, (end, read)) in itertools.product(range(STRIPS), enumerate((("high", HIGH), ("low", LOW))))
        for n in range(SCANS)
    ]
    found = propose(of_text("\n".join(["entity_id,state,last_changed", *rows, ""])), RUBBER)
    np.testing.assert_allclose(values(found), BOTH)
    np.testing.assert_allclose(times(found), np.arange(SCANS))


def grouped(prefix: str, head: str = "") -> str:
    """Return a log of a line per scan that lists ends by the strip's number, of both ends or of none."""
    rows = (
        prefix.format(time=f"21:33:{40 + 0.1 * n:06.3f}")
        + " ".join(
            f"{s + 1}:{'--' if OPEN[n, s] else f'{HIGH[n, s]:.3f},{LOW[n, s]:.3f}'}" for s in range(STRIPS)
        )
        + f" \u6e29\u5ea6:{26.3 + 0.1 * (n // 9):.1f}"
        for n in range(SCANS)
    )
    return "\n".join([*([prefix.format(time="21:33:39.120") + head] if head else []), *rows, ""])


@pytest.mark.parametrize("prefix", ["[{time}]\u6536\u2190\u25c6", "[{time}] "])
def test_ends_by_the_number_of_the_strip(prefix: str) -> None:
    head = "\u89e6\u89c9\u4f20\u611f\u5668 V1.2 \u6761\u6570=4 \u53c2\u8003\u7535\u538b=5.00V"
    found = propose(of_text(grouped(prefix, head)), RUBBER)
    np.testing.assert_allclose(values(found), BOTH)
    np.testing.assert_allclose(times(found), 0.1 * np.arange(SCANS), atol=1e-6)  # not from the line above on


def octave(vref: str = "5", time: str = "") -> str:
    """Return what Octave's `save -text` writes of a number, matrices and a text."""

    def matrix(name: str, rows: list[list[str]]) -> str:
        lines = "\n".join(" " + " ".join(row) for row in rows)
        return (
            f"# name: {name}\n# type: matrix\n# rows: {len(rows)}\n# columns: {len(rows[0])}\n{lines}\n\n\n"
        )

    parts = [
        matrix(n, [[field(v, "NaN") for v in row] for row in read]) for n, read in (("Vh", HIGH), ("Vl", LOW))
    ]
    return (
        f"# Created by Octave 8.4.0\n# name: Vref\n# type: scalar\n{vref}\n\n\n{''.join(parts)}"
        + (time or matrix("t", [[f"{0.05 * n:.2f}"] for n in range(SCANS)]))
        + "# name: note\n# type: string\n# elements: 1\n# length: 6\nt in s\n\n\n"
    )


def test_numbers_texts_and_ranges_beside_matrices() -> None:
    ranged = "# name: t\n# type: double_range\n# base, limit, increment\n0 1.15 0.05\n\n\n"
    for log in (octave(), octave(time=ranged)):
        found = propose(of_text(log), RUBBER)
        np.testing.assert_allclose(values(found), BOTH)
        np.testing.assert_allclose(times(found), 0.05 * np.arange(SCANS), atol=1e-9)
    with pytest.raises(Unanswered, match=r"the log says Vref = 3.3 V, and the spec vref_volt = 5"):
        propose(of_text(octave("3.3")), RUBBER)


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("VH_over_Vref_1", "fraction"), ("Uh/Uref 1", "fraction"), ("vhOverVref1", "fraction"),
        ("hi_frac 1", "fraction"), ("h1/Vref [%]", "percent"), ("h1 over Vcc (V)", "V"), ("h1", ""),
    ],
)  # fmt: skip
def test_a_name_over_the_reference_is_of_a_fraction(name: str, unit: str) -> None:
    assert (meaning(name).channel, meaning(name).strip, meaning(name).unit) == ("h", 1, unit)
    assert meaning("vref").role == ""


@pytest.mark.parametrize(("bits", "asked"), [(10, False), (None, True), (12, True)])
def test_readings_that_stay_at_full_scale_are_codes(bits: int | None, asked: bool) -> None:
    sensor = ts.Sensor(
        construction="crs-m", strips=3, pitch_mm=8.0, length_mm=150.0, vref_volt=3.3, adc_bits=bits,
        rest_volt=3.3, touch_volt=0.1,
    )  # fmt: skip
    rows = [
        f"{0.1 * n:.1f},{1023 if n < 8 else 139 + 7 * n},{1023 if n < 9 else 140 + 7 * n},1023"
        for n in range(60)
    ]
    log = of_text("\n".join(["Time (seconds),strip1,strip2,strip3", *rows, ""]))
    if asked:  # other converters stay at 1023 mV, in a range of 1.024 V
        with pytest.raises(Unanswered, match="in which unit"):
            propose(log, sensor)
        return
    found = propose(log, sensor)
    assert found.mapping.unit == "code"
    assert any("1023 again and again" in doubt for doubt in found.doubts)


def test_what_all_columns_are_called_names_no_strip() -> None:
    names = ",".join(f"Run 1: Strip {s + 1} {end} (V)" for s in range(STRIPS) for end in ("high", "low"))
    rows = (",".join([f"{0.05 * n:.2f}", *(field(v, "") for v in BOTH[n].ravel())]) for n in range(SCANS))
    found = propose(of_text("\n".join([f"Run 1: Time (s),{names}", *rows, ""])), RUBBER)
    np.testing.assert_allclose(values(found), BOTH)


def test_lines_of_many_whole_scans_are_not_lost_in_silence() -> None:
    rows = (  # a time in hexadecimal digits, which few lines have in decimal ones
        f"e9eda97e.{n:02d}{'000000' if n % 3 == 0 else 'eb851e'} /skin/strip/{s} ff "
        f"{field(HIGH[n, s], 'nan')} {field(LOW[n, s], 'nan')}"
        for n in range(SCANS)
        for s in range(STRIPS)
    )
    with pytest.raises(Unanswered, match="the 5 columns have no names"):
        propose(of_text("\n".join([*rows, ""])), RUBBER)
