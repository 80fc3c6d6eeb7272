"""The firmware, built for the Uno and run in simavr on voltages of ours; see firmware/emulator/main.c."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.arrays import FloatArray
from tacstrip.stream import RawScan
from tacstrip.stream.device.protocol.decoder import Decoder, Received
from tacstrip.stream.device.protocol.frames import Kind
from tacstrip.stream.device.protocol.messages import Command
from tacstrip.stream.device.protocol.scans import ScanBatch

FIRMWARE = Path(__file__).parents[1] / "firmware"
VREF_VOLT = 5.0
STARTED_S = 0.05  # by then a unit of any size has said hello

needs_compiler = pytest.mark.skipif(
    shutil.which("cc") is None or shutil.which("make") is None, reason="needs cc and make"
)
needs_simavr = pytest.mark.skipif(
    shutil.which("avr-gcc") is None or not list(Path("/usr/include").glob("simavr/sim_avr.h")),
    reason="needs avr-gcc and simavr: apt-get install gcc-avr avr-libc libsimavr-dev",
)


def make(target: str, folder: Path, **settings: object) -> str:
    """Build a target of the firmware's Makefile into a folder and return what it printed."""
    words = [f"{name}={value}" for name, value in settings.items()]
    command = ["make", "--no-print-directory", "-C", str(FIRMWARE), target, f"BUILD={folder}", *words]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@cache
def _emulator() -> TemporaryDirectory[str]:
    """Build the emulator, which is the same for every firmware, into a folder that goes with the process."""
    folder = TemporaryDirectory()
    make("emulator", Path(folder.name))
    return folder


def volts_line(at_s: float, lines: Iterable[FloatArray]) -> str:
    """Return the scenario's line that sets all strips' volts (strips,) of every line, NaN where nothing touches."""
    values = " ".join(f"{v:.6f}" for line in lines for v in line)
    return f"volts {at_s * 1e6:.0f} {values}\n"


def ohms_line(at_s: float, lines: Iterable[FloatArray]) -> str:
    """Return the scenario's line that sets the resistances behind all strips' volts (strips,) of every line [ohm]."""
    return volts_line(at_s, lines).replace("volts", "ohms")


def scan_line(at_s: float, scan: ts.Scan) -> str:
    """Return the scenario's line that puts a scan on the sensor."""
    return volts_line(at_s, [scan[name] * VREF_VOLT for name in scan.signatures])


def command_line(at_s: float, *commands: Command) -> str:
    """Return the scenario's line in which the host sends commands."""
    return f"bytes {at_s * 1e6:.0f} {b''.join(c.encode() for c in commands).hex()}\n"


def memory_line(folder: Path, at_s: float, symbol: str, value: int, size: int = 4) -> str:
    """Return the scenario's line that sets a variable of a folder's firmware."""
    done = subprocess.run(["avr-nm", str(folder / "uno.elf")], capture_output=True, text=True, check=True)
    (address,) = (line.split()[0] for line in done.stdout.splitlines() if line.split()[-1] == symbol)
    return f"memory {at_s * 1e6:.0f} {address} {value.to_bytes(size, 'little').hex()}\n"


def start_line(period_us: int) -> str:
    """Return the line that asks for a rate and starts the stream."""
    return command_line(STARTED_S, Command(Kind.RATE, 1, period_us), Command(Kind.START, 2))


def run(
    folder: Path, scenario: Iterable[str], seconds: float, strips: int, lines: int = 2, ways: int = 16,
    source_ohm: float = 5e3, node_pf: float = 100.0,
) -> bytes:  # fmt: skip
    """Run a folder's firmware through a scenario and return what it sent."""
    options = [seconds, strips, lines, ways, source_ohm, node_pf]
    command = [f"{_emulator().name}/emulator", str(folder / "uno.elf"), *map(str, options)]
    done = subprocess.run(command, input="".join(scenario).encode(), capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()
    return done.stdout


def heard(data: bytes) -> tuple[list[Received], list[RawScan], Decoder]:
    """Return messages, scans and the decoder of a stream; its last frame may be cut."""
    decoder = Decoder()
    received = decoder.feed(data)
    scans = [s for batch in received if isinstance(batch, ScanBatch) for s in batch.scans()]
    return [x for x in received if not isinstance(x, ScanBatch)], scans, decoder


def scans_per_second(scans: list[RawScan]) -> float:
    """Return the rate of scans, those of the first moments left out."""
    times = np.array([s.time_s for s in scans[5:]])
    return float((len(times) - 1) / (times[-1] - times[0]))
