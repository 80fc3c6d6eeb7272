"""Frames of bytes in hex: read as a description in the log says; else refused, never byte by byte."""

from __future__ import annotations

import functools
import operator
import struct
from collections.abc import Callable

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.errors import ReadingError
from tacstrip.io.log_import.guess import Proposal, propose
from tacstrip.io.log_import.questions import Unanswered
from tacstrip.io.log_import.text import of_text

_STRIPS, _SCANS = 4, 6
_SENSOR = ts.Sensor(
    construction="crs-crs", strips=_STRIPS, pitch_mm=8.0, length_mm=60.0, vref_volt=3.3, adc_bits=12
)
_VALUES = np.array(
    [
        [
            [1612 + 77 * n + 130 * s, 701 + 59 * n - 93 * s]
            if abs(s - n / 2) < 1.6 and n != 3
            else [np.nan] * 2
            for s in range(_STRIPS)
        ]
        for n in range(_SCANS)
    ]
)
_CODES = np.where(np.isnan(_VALUES), 0xFFFF, _VALUES).astype(int)


def _spaced(data: bytes) -> str:
    return data.hex(" ").upper()


def _frame(n: int, order: str = ">", *, time: bool = True, blocks: bool = False) -> bytes:
    values = _CODES[n].T.ravel() if blocks else _CODES[n].ravel()
    body = (struct.pack(f"{order}H", 500 + 10 * n) if time else b"") + struct.pack(f"{order}8H", *values)
    return b"\xaa\x55" + body + bytes([functools.reduce(operator.xor, body)])


def _lines(order: str, line: Callable[[int, bytes], str] = lambda n, data: _spaced(data)) -> str:
    return "\n".join(line(n, _frame(n, order)) for n in range(_SCANS)) + "\n"


def _offsets(data: bytes, width: int = 16, first: str = "08x", group: int = 1, end: str = "  ......") -> str:
    rows = []
    for at in range(0, len(data), width):
        part = data[at : at + width].hex()
        groups = " ".join(part[g : g + 2 * group] for g in range(0, len(part), 2 * group))
        rows.append(f"{at:{first}} {groups}{end}")
    return "\n".join(rows) + "\n"


def _read(text: str, **answers: str) -> Proposal:
    return propose(of_text(text), _SENSOR, answers)


def _assert_read(
    found: Proposal, step: float | None = 0.01, scans: tuple[int, ...] = (0, 1, 2, 3, 4, 5)
) -> None:
    assert np.stack([scan.values for scan in found.scans]) == pytest.approx(_VALUES[[*scans]], nan_ok=True)
    if step is not None:
        times = np.array([scan.time_s for scan in found.scans])
        assert times - times[0] == pytest.approx(step * np.array(scans), abs=1e-6)


_LAYOUT = (
    "# AA 55 | time in ms, 2 bytes | strip 0..3: H (2 bytes), L (2 bytes) | XOR of all bytes after AA 55\n"
    "# FFFF = strip not touched. 12-bit ADC. {}\n"
)
_SAID = {
    ">": ("big endian", "high byte first", "MSB first"),
    "<": ("little-endian", "low byte first", "LSB first"),
}
_CAN_SAID = (
    "# ID 0x200 + strip (strips 0..3); bytes 0-1: V_H in mV, bytes 2-3: V_L in mV, both {}; FFFF FFFF = open\n"
    "# bytes 4-5: scan counter. 0x181 is the motor drive.\n"
)


@pytest.mark.parametrize("order", "><")
@pytest.mark.parametrize("said", range(3))
def test_frames_in_lines(order: str, said: int) -> None:
    _assert_read(_read(_LAYOUT.format(_SAID[order][said]) + _lines(order)))


@pytest.mark.parametrize(
    "line",
    [
        lambda n, data: " ".join(f"0x{b:02X}" for b in data),
        lambda n, data: ", ".join(f"0x{b:02x}" for b in data) + ",",
        lambda n, data: data.hex(),
        lambda n, data: f"10:00:0{n}.500 -> {_spaced(data)}",
        lambda n, data: f"RX: {_spaced(data)}",
        lambda n, data: f"[{', '.join(f'0x{b:02x}' for b in data)}]",
    ],
)
def test_however_the_bytes_are_written(line: Callable[[int, bytes], str]) -> None:
    _assert_read(_read(_LAYOUT.format("big endian") + _lines(">", line)))


@pytest.mark.parametrize(
    ("first", "group", "end", "width"),
    [("08x", 1, "  |.U......|", 16), ("08x", 1, "", 16), ("07x", 1, "  ....", 16), ("04x", 1, "", 8)],
)
def test_a_dump_of_a_stream(first: str, group: int, end: str, width: int) -> None:
    data = b"".join(_frame(n) for n in range(_SCANS))
    colon = "" if first == "08x" else ":"
    text = "\n".join(
        line.replace(" ", f"{colon} ", 1) for line in _offsets(data, width, first, group, end).splitlines()
    )
    _assert_read(_read(_LAYOUT.format("big endian") + text + "\n"))


def test_a_dump_of_xxd() -> None:
    text = _offsets(b"".join(_frame(n) for n in range(_SCANS)), 16, "08x", 2, "  .U....")
    text = "\n".join(line.replace(" ", ": ", 1) for line in text.splitlines())
    _assert_read(_read(_LAYOUT.format("big endian") + text + "\n"))


def _candump(order: str, line: str) -> str:
    rows = []
    for n in range(_SCANS):
        for s in range(_STRIPS):
            data = struct.pack(f"{order}3H", *_CODES[n, s], 310 + n)
            rows.append(
                line.format(
                    t=1718040000 + 0.02 * n + 0.0003 * s,
                    id=0x200 + s,
                    apart=_spaced(data),
                    solid=data.hex().upper(),
                )
            )
        if n % 2:
            rows.append(
                line.format(
                    t=1718040000.011 + 0.02 * n, id=0x181, apart="37 06 00 00 00 A4", solid="3706000000A4"
                )
            )
    return "\n".join(rows) + "\n"


@pytest.mark.parametrize("order", "><")
@pytest.mark.parametrize(
    "line",
    [
        " ({t:.6f})  can0  {id:03X}   [6]  {apart}",
        "({t:.6f}) can0 {id:03X}#{solid}",
        "(000.{t:.0f}) can0 {id:03X} [6] {apart}",
    ],
)
def test_frames_of_a_can_bus(order: str, line: str) -> None:
    found = _read(_CAN_SAID.format(_SAID[order][0]) + _candump(order, line.replace("000.{t:.0f}", "{t:.4f}")))
    _assert_read(found, 0.02)


@pytest.mark.parametrize(
    ("said", "blocks"),
    [
        ("# strips 0-3, two bytes big endian each, H then L, raw codes, FFFF = open", False),
        ("# uint16 big endian, all H of strips 0 to 3, then all L, ADC codes; FFFF = not touched", True),
        (
            "// high byte first, 2 bytes per value: V_H, V_L of strip 0 to 3, codes, 0xFFFF means untouched",
            False,
        ),
    ],
)
def test_two_bytes_each_as_one_line_says(said: str, blocks: bool) -> None:
    rows = [_spaced(_frame(n, time=False, blocks=blocks)[2:-1]) for n in range(_SCANS)]
    _assert_read(_read(said + "\n" + "\n".join(rows) + "\n", rate_hz="100"))


def test_a_damaged_frame_is_left_out() -> None:
    rows = [_spaced(_frame(n)) for n in range(_SCANS)]
    rows[2] = rows[2][:20] + ("3" if rows[2][20] != "3" else "4") + rows[2][21:]
    text = _LAYOUT.format("big endian") + "\n".join(rows) + "\n"
    with pytest.raises(Unanswered, match="broken_lines"):
        _read(text)
    _assert_read(_read(text, broken_lines="skip"), scans=(0, 1, 3, 4, 5))


@pytest.mark.parametrize(
    "said",
    [
        "",
        "# frames from the skin",
        _LAYOUT.format(""),
        _LAYOUT.format("big endian, the counter little endian"),
        "# two bytes each, big endian\n",
        "# two bytes each, H then L of strips 0 to 3, and a time; big endian\n",
        "# 2 bytes each, big endian, H then L of strips 0 to 5\n",
    ],
)
def test_bytes_without_a_full_description_are_never_readings(said: str) -> None:
    with pytest.raises((ReadingError, Unanswered)):
        _read(said + "\n" + _lines(">"))


@pytest.mark.parametrize(
    "said",
    ["", "# candump\n", "# bytes 0-1: V_H, bytes 2-3: V_L, in mV, big endian\n", _CAN_SAID.format("in mV")],
)
def test_identifiers_are_never_readings(said: str) -> None:
    with pytest.raises(ReadingError, match=r"hex|identifiers"):
        _read(said + _candump(">", " ({t:.6f})  can0  {id:03X}   [6]  {apart}"), order="alternating")


def test_single_bytes_of_a_converter_of_8_bits_are_read_as_before() -> None:
    sensor = ts.Sensor(
        construction="crs-crs", strips=2, pitch_mm=8.0, length_mm=60.0, vref_volt=3.3, adc_bits=8
    )
    text = "h0,l0,h1,l1\n" + "\n".join(
        f"{200 + n:02X},{0x6C + n * n:02X},{0xAB + n:02X},{0x5C + n:02X}" for n in range(6)
    )
    found = propose(of_text(text + "\n"), sensor, {"rate_hz": "50", "unit": "code"})
    assert found.scans[0].values == pytest.approx(np.array([[200, 0x6C], [0xAB, 0x5C]]))
