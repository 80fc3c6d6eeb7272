"""Frames of bytes in hex, of which several make a reading: refused, never read byte by byte."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.errors import ReadingError
from tacstrip.io.log_import.guess import propose
from tacstrip.io.log_import.questions import Unanswered
from tacstrip.io.log_import.text import of_text

_SENSOR = ts.Sensor(
    construction="crs-crs", strips=4, pitch_mm=8.0, length_mm=60.0, vref_volt=3.3, adc_bits=12
)
_SAID = (
    "# AA 55 | time in ms, 2 bytes | strip 0..3: H (2 bytes), L (2 bytes); big endian; FFFF = not touched\n"
)
_FRAMES = [
    bytes.fromhex("AA55") + (500 + 10 * n).to_bytes(2) + b"".join(
        (v if abs(s - n / 2) < 1.6 else 0xFFFF).to_bytes(2)
        for s in range(4) for v in (1612 + 77 * n + 130 * s, 701 + 59 * n - 93 * s)
    )
    for n in range(6)
]  # fmt: skip


@pytest.mark.parametrize(
    "line",
    [
        lambda n, data: data.hex(" ").upper(),
        lambda n, data: " ".join(f"0x{b:02X}" for b in data),
        lambda n, data: ", ".join(f"0x{b:02x}" for b in data) + ",",
        lambda n, data: data.hex(),
        lambda n, data: f"10:00:0{n}.500 -> {data.hex(' ')}",
        lambda n, data: f"[{', '.join(f'0x{b:02x}' for b in data)}]",
        lambda n, data: f"{18 * n:08x}  {data.hex(' ')}  |.U......|",
        lambda n, data: f"{18 * n:08x}: {data.hex(' ', 2)}  .U....",
        lambda n, data: f" (1718040000.{n}00000)  can0  {0x200 + n:03X}   [8]  {data[2:10].hex(' ').upper()}",
        lambda n, data: f"(1718040000.{n}00000) can0 {0x200 + n:03X}#{data[2:10].hex().upper()}",
    ],
)
def test_frames_are_refused_however_written(line: Callable[[int, bytes], str]) -> None:
    log = "\n".join(line(n, data) for n, data in enumerate(_FRAMES)) + "\n"
    with pytest.raises(ReadingError, match="bytes in hex"):
        propose(of_text(_SAID + log), _SENSOR)
    with pytest.raises((ReadingError, Unanswered)):  # without a word on them
        propose(of_text(log), _SENSOR)


def test_single_bytes_of_a_converter_of_8_bits_are_read() -> None:
    sensor = ts.Sensor(
        construction="crs-crs", strips=2, pitch_mm=8.0, length_mm=60.0, vref_volt=3.3, adc_bits=8
    )
    text = "h0,l0,h1,l1\n" + "\n".join(
        f"{200 + n:02X},{0x6C + n * n:02X},{0xAB + n:02X},{0x5C + n:02X}" for n in range(6)
    )
    found = propose(of_text(text + "\n"), sensor, {"rate_hz": "50", "unit": "code"})
    assert found.scans[0].values == pytest.approx(np.array([[200, 0x6C], [0xAB, 0x5C]]))
