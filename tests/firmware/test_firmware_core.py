"""The firmware's core as a library for this computer: frames, scanning and commands against the Python side."""

from __future__ import annotations

import ctypes
import shutil
from binascii import crc_hqx
from pathlib import Path

import numpy as np
import pytest

from emulated import make, needs_compiler
from tacstrip.arrays import FloatArray
from tacstrip.stream.device.protocol.decoder import Decoder, Received
from tacstrip.stream.device.protocol.frames import CRC_BYTES, Kind, cobs_decode, cobs_encode, encode_frame
from tacstrip.stream.device.protocol.messages import Command, Hello, Reply, SelfTest, Status
from tacstrip.stream.device.protocol.scans import ScanBatch

pytestmark = needs_compiler
STRIPS = 40
TOP = 2**12 - 1


class Desk:
    """One device: voltages and bytes in, bytes out."""

    def __init__(self, library: Path) -> None:
        self.core = ctypes.CDLL(str(library))
        self.core.device_start()
        self.decoder = Decoder()

    def number(self, name: str) -> int:
        return ctypes.c_uint32.in_dll(self.core, name).value

    def touch(self, line: int, parts: FloatArray) -> None:
        """Put parts of Vref (strips,) on a line, NaN where nothing touches."""
        lines = ((ctypes.c_double * (STRIPS + 1)) * 2).in_dll(self.core, "desk_part")
        for strip, part in enumerate(parts):
            lines[line][strip] = -1.0 if np.isnan(part) else part

    def send(self, data: bytes) -> None:
        """Have bytes lie ready for the device."""
        room = (ctypes.c_uint8 * 4096).in_dll(self.core, "desk_received")
        at = self.number("desk_received_count")
        room[at : at + len(data)] = list(data)
        ctypes.c_uint32.in_dll(self.core, "desk_received_count").value = at + len(data)

    def turn(self, times: int = 1) -> list[Received]:
        """Let the device's main loop turn, and return what it says."""
        out: list[Received] = []
        for _ in range(times):
            self.core.device_turn()
            room = (ctypes.c_uint8 * 4096).in_dll(self.core, "desk_sent")
            out += self.decoder.feed(bytes(room[: self.number("desk_sent_count")]))
            ctypes.c_uint32.in_dll(self.core, "desk_sent_count").value = 0
            ctypes.c_uint32.in_dll(self.core, "desk_time_us").value += 10
        return out


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("desk")
    make("desk", folder, STRIPS=STRIPS, UNIT_NAME="bench", PERIOD_US=0)
    return folder / "desk.so"


@pytest.fixture
def desk(library: Path, tmp_path: Path) -> Desk:
    """A device of its own: a library of one name is loaded once, with its state."""
    return Desk(Path(shutil.copy(library, tmp_path)))


def test_says_hello_when_it_starts(desk: Desk) -> None:
    (hello,) = desk.turn()
    assert isinstance(hello, Hello)
    assert (hello.construction, hello.strips, hello.signatures) == ("crs-crs", STRIPS, ("kh", "kl"))
    assert (hello.unit_name, hello.adc_bits, hello.baud, hello.streaming) == ("bench", 12, 500_000, False)
    assert hello.cycle_us == STRIPS * (2 * (20 + 13) + 10 + 2 * 52)
    assert desk.decoder.counts.corrupt == 0


def test_scans_are_what_lies_on_the_lines(desk: Desk) -> None:
    random = np.random.default_rng(3)
    touched = random.random(STRIPS) < 0.6
    parts = {name: np.where(touched, random.random(STRIPS), np.nan) for name in ("kh", "kl")}
    desk.touch(0, parts["kh"])
    desk.touch(1, parts["kl"])
    desk.send(Command(Kind.START, 7).encode())
    hello, reply, batch, *_ = desk.turn(3)
    assert isinstance(hello, Hello)
    assert reply == Reply(Kind.START, 7, Status.DONE, 0)
    assert isinstance(batch, ScanBatch)
    scan = next(iter(batch.scans()))
    assert np.array_equal(scan.touched, touched)
    for name, wanted in parts.items():
        assert np.array_equal(scan.codes[name][touched], np.round(wanted[touched] * TOP))
    assert scan.strip_time_s is not None
    assert scan.strip_time_s[-1] == pytest.approx((STRIPS - 1) * 180e-6)
    assert desk.number("desk_misread") == 0
    later = [b for b in desk.turn(20) if isinstance(b, ScanBatch)]
    numbers = np.concatenate([b.sequence for b in later])
    assert np.array_equal(numbers, np.arange(3, 23))
    assert desk.decoder.counts.lost == 0


def test_touch_is_told_by_what_the_pulls_move(desk: Desk) -> None:
    """0 and Vref are readings like others: a strip there is touched, an open line is not."""
    parts = np.full(STRIPS, np.nan)
    parts[:3] = 0.0, 1.0, 0.5
    desk.touch(0, parts)
    desk.touch(1, parts)
    desk.send(Command(Kind.START).encode())
    batch = desk.turn()[-1]
    assert isinstance(batch, ScanBatch)
    assert np.flatnonzero(batch.touched[0]).tolist() == [0, 1, 2]
    assert batch.codes["kh"][0, :3].tolist() == [0, TOP, 2048]


def test_the_rate_is_kept_and_lateness_counted(desk: Desk) -> None:
    desk.send(Command(Kind.RATE, 1, 50_000).encode() + Command(Kind.START, 2).encode())
    out = desk.turn(40_000)
    assert Reply(Kind.RATE, 1, Status.DONE, 50_000) in out
    times = np.concatenate([b.time_us for b in out if isinstance(b, ScanBatch)])
    assert len(times) > 5
    assert np.abs(np.diff(times) - 50_000).max() <= 10
    desk.send(Command(Kind.RATE, 3, 100).encode() + Command(Kind.IDENTIFY, 4).encode())
    desk.turn(3)
    desk.send(Command(Kind.IDENTIFY, 5).encode())
    (hello,) = (x for x in desk.turn() if isinstance(x, Hello))
    assert (hello.period_us, hello.streaming) == (100, True)
    assert hello.late >= 2


def test_stops(desk: Desk) -> None:
    desk.send(Command(Kind.START, 1).encode())
    desk.turn(3)
    desk.send(Command(Kind.STOP, 2).encode())
    assert desk.turn(5) == [Reply(Kind.STOP, 2, Status.DONE, 0)]


def test_the_self_test_finds_what_holds_a_line(desk: Desk) -> None:
    held = {"kh": np.zeros(STRIPS, bool), "kl": np.zeros(STRIPS, bool), "k": np.zeros(STRIPS, bool)}
    held["kh"][4] = held["kl"][39] = True
    for line, name in enumerate(("kh", "kl")):
        desk.touch(line, np.where(held[name], 0.3, np.nan))
    desk.turn()
    desk.send(Command(Kind.TEST).encode())
    (found,) = desk.turn()
    assert isinstance(found, SelfTest)
    assert {name: v.tolist() for name, v in found.held.items()} == {k: v.tolist() for k, v in held.items()}


@pytest.mark.parametrize(
    ("data", "reply"),
    [
        (encode_frame(0x99, b"", 5), Reply(0x99, 5, Status.UNKNOWN, 0)),
        (encode_frame(Kind.SCAN, b"", 5), Reply(Kind.SCAN, 5, Status.UNKNOWN, 0)),
        (encode_frame(Kind.RATE, b"\1\2\3", 6), Reply(Kind.RATE, 6, Status.BAD_BODY, 3)),
        (encode_frame(Kind.START, b"\1", 6), Reply(Kind.START, 6, Status.BAD_BODY, 1)),
        (encode_frame(Kind.RATE, b"\xff" * 4, 6), Reply(Kind.RATE, 6, Status.BAD_BODY, 60_000_000)),
    ],
)
def test_commands_that_cannot_be_are_answered_so(desk: Desk, data: bytes, reply: Reply) -> None:
    desk.turn()
    desk.send(data)
    assert desk.turn() == [reply]


def test_a_command_of_another_version_is_answered_so(desk: Desk) -> None:
    plain = bytes([9, Kind.START, 4, 0, 0, 0, 0, 0, 0, 0])
    plain += crc_hqx(plain, 0xFFFF).to_bytes(2, "big")
    desk.turn()
    desk.send(b"\0" + cobs_encode(plain) + b"\0")
    assert desk.turn() == [Reply(Kind.START, 4, Status.OTHER_VERSION, 1)]


def test_garbage_to_the_device_hides_no_command(desk: Desk) -> None:
    random = np.random.default_rng(8)
    desk.turn()
    for i in range(30):
        bad = bytearray(Command(Kind.RATE, i, 1000).encode())
        bad[int(random.integers(2, len(bad) - 3))] ^= 0x20
        desk.send(random.bytes(int(random.integers(0, 40))) + bytes(bad) + Command(Kind.STOP, i).encode())
        answers = desk.turn()
        assert answers[-1] == Reply(Kind.STOP, i, Status.DONE, 0)
        assert len(answers) == 1


class Frame(ctypes.Structure):
    _fields_ = (("count", ctypes.c_uint16), ("bytes", ctypes.c_uint8 * 1000))


def test_seals_and_unstuffs_as_the_python_side(tmp_path: Path) -> None:
    """Bodies of every length and of few zeros, so that blocks of 254 bytes without one occur, at the end too."""
    make("desk", tmp_path, STRIPS=200)
    core = ctypes.CDLL(str(tmp_path / "desk.so"))
    core.frame_crc.restype = ctypes.c_uint16
    random = np.random.default_rng(2)
    wire = (ctypes.c_uint8 * 1100)()
    for length in [*range(40), *range(230, 270), *range(480, 540), 819]:
        for rarity in (2, 50, 10_000):
            plain = random.integers(1, 256, length, np.uint8)
            plain[random.integers(0, rarity, length) == 0] = 0
            frame = Frame(length, (ctypes.c_uint8 * 1000)(*plain.tolist()))
            count = core.frame_seal(ctypes.byref(frame), wire) & 0xFFFF
            crc = crc_hqx(plain.tobytes(), 0xFFFF).to_bytes(CRC_BYTES, "big")
            whole = plain.tobytes() + crc
            assert bytes(wire[:count]) == b"\0" + cobs_encode(whole) + b"\0"
            assert cobs_decode(bytes(wire[1 : count - 1])) == whole
            if (
                len(whole) >= 254 and cobs_encode(whole)[-255] == 0xFF
            ):  # a full last block: an empty one may follow
                more = (ctypes.c_uint8 * 1101)(*wire[1 : count - 1], 1)
                assert core.frame_unstuff(more, count - 1) & 0xFFFF == len(whole)
            back = (ctypes.c_uint8 * 1100)(*wire[1 : count - 1])
            assert core.frame_unstuff(back, count - 2) & 0xFFFF == len(whole)
            assert bytes(back[: len(whole)]) == whole
            assert core.frame_crc(back, len(whole)) == 0


def _clock(desk: Desk, overflows: int, ticks: int, pending: bool) -> int:
    told: int = desk.core.desk_clock_us(ctypes.c_uint32(overflows), ctypes.c_uint16(ticks), pending)
    return told % 2**32


def test_the_clock_has_all_of_its_32_bits(desk: Desk) -> None:
    """Any moment within two of its rounds, told of the overflow at once or not yet."""
    wraps = [k << 16 for k in (1, 2, 2**15, 2**16, 2**17, 3 << 16, 2**18)]  # ticks of half a us
    moments = [at + d for at in wraps for d in (-(2**15), -2, -1, 0, 1, 2, 2**15 - 1)]
    for moment in [*moments, *np.random.default_rng(9).integers(0, 2**34, 2000).tolist()]:
        overflows, ticks = moment >> 16, moment & 0xFFFF
        wanted = (moment >> 1) % 2**32
        assert _clock(desk, overflows, ticks, pending=False) == wanted
        if ticks < 2**15 and overflows:  # it has overflowed, and the interrupt waits
            assert _clock(desk, overflows - 1, ticks, pending=True) == wanted
        elif ticks >= 2**15:  # the ticks were read before, the flag after the overflow
            assert _clock(desk, overflows, ticks, pending=True) == wanted


@pytest.mark.parametrize("wrap", [2**31, 2**32])
def test_the_rate_is_kept_where_the_clock_begins_anew(desk: Desk, wrap: int) -> None:
    desk.turn()
    ctypes.c_uint32.in_dll(desk.core, "desk_time_us").value = wrap - 200_000
    desk.send(Command(Kind.RATE, 1, 20_000).encode() + Command(Kind.START, 2).encode())
    times = np.concatenate([b.time_us for b in desk.turn(40_000) if isinstance(b, ScanBatch)])
    assert times[0] < wrap < times[-1]  # the host counts on
    assert len(times) >= 20
    assert np.abs(np.diff(times) - 20_000).max() <= 10
    desk.send(Command(Kind.IDENTIFY, 5).encode())
    (hello,) = (x for x in desk.turn() if isinstance(x, Hello))
    assert hello.late == 0
