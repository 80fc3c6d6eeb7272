"""A device that misbehaves: every intact scan is recorded once and in order, every trouble named, no time goes back."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

import tacstrip as ts
from one_clock import Clock
from rogue_device import BITS, STRIPS, Rogue, Trouble, frame
from tacstrip.stream import RawScan
from tacstrip.stream.device.protocol.frames import check_frame, encode_frame

SENSOR = ts.Sensor(construction="crs-crs", strips=STRIPS, pitch_mm=10.0, length_mm=100.0, adc_bits=BITS)
SCANS = 300


def nothing(device: Rogue, n: int) -> None:
    """After scan n."""


def recorded(
    device: Rogue, folder: Path, rate_hz: float | None = None, then: Callable[[Rogue, int], None] = nothing
) -> tuple[list[int], list[RawScan], list[str]]:
    """Record scans and read them back: which they are, the scans, and what was told."""
    said: list[str] = []
    source = ts.SerialSource(lambda: device, SENSOR, rate_hz, on_message=said.append)
    with ts.Recorder(folder / "a.mcap", source.sensor, source.names, source.origin_ns) as recorder:
        for n, raw in enumerate(islice(source, SCANS)):
            recorder.add(raw)
            then(device, n)
    found = list(ts.Recording(folder / "a.mcap"))
    return [int(r.codes["kh"][0]) + 1000 * int(r.codes["kh"][1]) for r in found], found, said


def every(n: int, spoil: Callable[[Rogue, int, bytes], list[bytes]]) -> Trouble:
    return lambda device, i, data: spoil(device, i, data) if i % n == n - 3 else [data]


def changed(device: Rogue, i: int, data: bytes) -> list[bytes]:
    bad = bytearray(data)
    bad[int(device.random.integers(1, len(data) - 1))] ^= int(device.random.integers(1, 256))
    return [bytes(bad)]


def again(device: Rogue, i: int, data: bytes) -> list[bytes]:
    """The scan, and the one that had its turn here before."""
    device.keep.append(data)
    return [data, device.keep[-2] if len(device.keep) > 1 else b""]


def block(device: Rogue, i: int, data: bytes) -> list[bytes]:
    """The scan, and now and then twenty old ones after it."""
    device.keep.append(data)
    return [data, *device.keep[-30:-10]] if i % 40 == 35 else [data]


def late(by: int) -> Trouble:
    """Every tenth scan comes after the next `by`."""

    def spoil(device: Rogue, i: int, data: bytes) -> list[bytes]:
        device.keep.append(data)
        if i % 10 == 3:
            return []
        if i % 10 == 3 + by:
            device.keep, kept = [], device.keep
            return [*kept[1:], kept[0]] if i % 20 < 10 else [kept[-1], *kept[:-1]]
        if i % 10 > 3 and i % 10 < 3 + by:
            return []
        device.keep.clear()
        return [data]

    return spoil


def out_of_range(device: Rogue, i: int, data: bytes) -> list[bytes]:
    return [device.scan(i, np.full(2 * STRIPS, 2**BITS, "<u2"))]


CLEAN: dict[str, tuple[Trouble, str]] = {  # nothing is lost; what is told
    "twice": (every(7, lambda d, i, data: [data, data]), r"\d+ scan\(s\) came again and are taken once"),
    "four times": (every(50, lambda d, i, data: [data] * 4), r"\d+ scan\(s\) came again"),
    "old ones again": (every(9, again), "came again"),
    "a block again": (block, "came again"),
    "late by 1": (late(1), r"scan\(s\) came after later ones"),
    "late by 4": (late(4), r"scan\(s\) came after later ones"),
    "garbage": (every(5, lambda d, i, data: [d.random.bytes(40), data]), "broken frame"),
    "a flood of garbage": (every(50, lambda d, i, data: [d.random.bytes(100_000), data]), "broken frame"),
    "no zero for long": (every(50, lambda d, i, data: [b"\x55" * 100_000, data]), "broken frame"),
    "zeros": (every(5, lambda d, i, data: [bytes(500), data]), ""),
    "other kinds": (every(9, lambda d, i, data: [frame(9, i, 0, b"hello"), data]), "another version"),
    "other versions": (every(9, lambda d, i, data: [frame(1, i, 0, b"x" * 30, 2), data]), "another version"),
    "short bodies": (every(9, lambda d, i, data: [frame(1, i, 0, b"\3\0"), data]), "another version, kind or length"),
    "padding": (lambda d, i, data: [d.scan(i, padding=0xC0)], ""),
    "spans of an hour": (every(9, lambda d, i, data: [d.scan(i, span_us=2**32 - 1)]), "4.29e.03 s, scans say"),
    "echoes": (every(9, lambda d, i, data: [frame(0x82, i, 0, b""), data]), "commands come back on the line"),
    "replies": (every(9, lambda d, i, data: [frame(3, i, 0, bytes(10)), data]), "answers a command that was not sent"),
    "hellos": (lambda d, i, data: [d.hello()] * 5 + [data], ""),
    "hellos that lie": (every(9, lambda d, i, data: [d.hello(streaming=False, number=0), data]), "the device"),
}  # fmt: skip


@pytest.mark.parametrize("kind", CLEAN)
def test_every_scan_is_recorded_in_order_and_the_trouble_named(
    clock: Clock, tmp_path: Path, kind: str
) -> None:
    trouble, what = CLEAN[kind]
    which, scans, said = recorded(Rogue(clock, trouble), tmp_path)
    assert which == list(range(SCANS))
    assert (np.diff([r.time_s for r in scans]) > 0.0).all()
    assert any(re.search(what, text) for text in said) if what else said == []
    assert len(said) <= 3  # and not again and again
    delays = np.array([r.arrival_s for r in scans], dtype=float) - [r.time_s for r in scans]
    assert -1e-4 < delays.min() <= delays.max() < 0.06


LOSSES: dict[str, tuple[Trouble, str]] = {  # what each tenth scan is lost by
    "changed": (every(10, changed), "broken frame"),
    "cut": (every(10, lambda d, i, data: [data[:20]]), "broken frame"),
    "without its start": (every(10, lambda d, i, data: [data[20:]]), "broken frame"),
    "missing": (every(10, lambda d, i, data: []), r"scan\(s\) are missing by their numbers"),
    "other strips": (every(10, lambda d, i, data: [d.scan(i, strips=3)]), "left out; the device is asked who it is"),
    "codes out of range": (every(10, out_of_range), "have codes above the converter's bits"),
}  # fmt: skip


@pytest.mark.parametrize("kind", LOSSES)
def test_only_what_is_not_intact_is_lost(clock: Clock, tmp_path: Path, kind: str) -> None:
    trouble, what = LOSSES[kind]
    which, scans, said = recorded(Rogue(clock, trouble), tmp_path)
    assert which == [i for i in range(which[-1] + 1) if i % 10 != 7]
    assert (np.diff([r.time_s for r in scans]) > 0.0).all()
    assert any(re.search(what, text) for text in said)


NUMBERS: dict[str, Callable[[int], int]] = {
    "stand": lambda i: 7 if i > 50 else i,
    "fall": lambda i: 2**31 - i,
    "random": lambda i: i * 2654435761,
    "of 8 bits": lambda i: i % 256,
    "of 3": lambda i: i % 3,
    "wrap": lambda i: 2**32 - 300 + i,
    "leap once": lambda i: i + 10**6 * (i > 200),
    "fall once": lambda i: 5000 + i - 3000 * (i > 200),
}


@pytest.mark.parametrize("kind", NUMBERS)
def test_whatever_the_numbers_every_scan_is_recorded(clock: Clock, tmp_path: Path, kind: str) -> None:
    which, scans, said = recorded(Rogue(clock, number=NUMBERS[kind]), tmp_path)
    assert which == list(range(SCANS))
    assert (np.diff([r.time_s for r in scans]) > 0.0).all()
    assert (said == []) == (kind == "wrap")
    assert len(said) <= 3


CLOCKS: dict[str, tuple[Callable[[int], int], str]] = {
    "stands": (lambda us: 77, "stands still"),
    "stands after a while": (lambda us: min(us, 6_000_000), "stands still|runs at"),
    "half": (lambda us: us // 2, "runs at .* % of its speed"),
    "double": (lambda us: us * 2, "runs at .* % of its speed"),
    "20 % slow": (lambda us: us * 4 // 5, "runs at .* % of its speed"),
    "random": (lambda us: us * 2654435761, "ran backwards|leapt ahead"),
    "jumps back": (lambda us: us - 1_000_000 * (us > 6_000_000), "ran backwards"),
    "jumps ahead": (lambda us: us + 300_000 * (us > 6_000_000), "leapt ahead"),
    "backwards": (lambda us: -us, "ran backwards"),
    "zero": (lambda us: 0, "stands still"),
    "steps of 0.3 s": (lambda us: us // 300_000 * 300_000, "stands still"),
}


@pytest.mark.parametrize(
    ("kind", "period_us"), [*((kind, 20_000) for kind in CLOCKS), ("stands", 5_000), ("half", 5_000)]
)
def test_a_clock_that_lies_is_told_within_a_second(clock: Clock, kind: str, period_us: int) -> None:
    stamp, what = CLOCKS[kind]
    told: list[float] = []
    device = Rogue(clock, period_us=period_us, stamp=stamp)
    said: list[str] = []

    def tell(text: str) -> None:
        said.append(text)
        told.append(clock.now_s)

    source = ts.SerialSource(lambda: device, SENSOR, on_message=tell)
    lies_s = clock.now_s + (6.0 - 3.21 if "jumps" in kind or "after" in kind else 0.0)
    scans = list(islice(source, 2 * SCANS))
    assert re.search(what, said[0])
    assert told[0] - lies_s < 1.0
    assert len(said) == 1
    times = np.array([r.time_s for r in scans])
    assert (np.diff(times) > 0.0).all()
    arrived = np.array([r.arrival_s for r in scans], dtype=float)
    assert np.abs(times - arrived)[-100:].max() < 0.03
    assert len(scans) == device.i


def test_silence_is_told_within_a_second_and_its_end(clock: Clock) -> None:
    told: list[tuple[str, float]] = []
    device = Rogue(clock)

    def wake(text: str) -> None:
        told.append((text, clock.now_s))
        device.silent = False

    for n, _ in enumerate(islice(ts.SerialSource(lambda: device, SENSOR, on_message=wake), 200)):
        if n == 100:
            device.silent, began_s = True, clock.now_s
    (silence, at_s), (end, _) = told
    assert silence == "no scan came for 0.8 s; it is told to send again"
    assert end == "scans come again"
    assert at_s - began_s < 1.0


def test_a_flood_is_told(clock: Clock, tmp_path: Path) -> None:
    device = Rogue(clock)
    device.deaf_to = {0x84}  # RATE
    which, _, said = recorded(device, tmp_path, rate_hz=20.0)
    assert which == list(range(SCANS))
    assert said[0] == "the device did not answer RATE within 0.5 s"
    assert re.fullmatch(r"the device sends \d+ scans a second, and 20 were asked for", said[1])
    assert device.commands.count(0x84) == 2


@pytest.mark.parametrize("hertz", [8, 20])
def test_a_device_that_is_slow_is_told_once(clock: Clock, tmp_path: Path, hertz: int) -> None:
    device = Rogue(clock, period_us=1_000_000 // hertz)
    device.deaf_to = {0x84}
    which, _, said = recorded(device, tmp_path, rate_hz=100.0)
    assert which == list(range(SCANS))
    assert sorted(said) == [
        "the device did not answer RATE within 0.5 s",
        f"the device sends only {hertz} scans a second, and 100 were asked for",
    ]


def test_strips_times_that_cannot_be_are_left_out(clock: Clock, tmp_path: Path) -> None:
    trouble = every(9, lambda d, i, data: [d.scan(i, span_us=40_000)])
    _, scans, _ = recorded(Rogue(clock, trouble), tmp_path)
    assert [r.strip_time_s is None for r in scans] == [i % 9 == 6 for i in range(SCANS)]


def test_a_refusal_is_told(clock: Clock, tmp_path: Path) -> None:
    device = Rogue(clock)
    device.refuses = {0x84}
    which, _, said = recorded(device, tmp_path, rate_hz=100.0)
    assert which == list(range(SCANS))
    assert said == ["the device refuses RATE: it finds its body invalid"]


@pytest.mark.parametrize(("supply_mv", "told"), [(0, False), (4500, False), (5500, False), (3300, True)])
def test_a_supply_that_cannot_be_the_specs_is_told(
    clock: Clock, tmp_path: Path, supply_mv: int, told: bool
) -> None:
    device = Rogue(clock)
    device.supply_mv = supply_mv
    which, _, said = recorded(device, tmp_path)
    assert which == list(range(SCANS))
    text = "the device's supply is 3.3 V, and the spec says vref_volt = 5"
    assert [s.partition(":")[0] for s in said] == [text] * told


def test_another_unit_that_goes_on_where_the_first_was_is_refused_by_its_hello(
    clock: Clock, tmp_path: Path
) -> None:
    def then(device: Rogue, n: int) -> None:
        if n == 150:
            device.out += device.hello(name=b"right")

    with pytest.raises(ts.PortError, match="unit_name = 'right'"):
        recorded(Rogue(clock), tmp_path, then=then)
    # Asked every .75 s who it is, it last was the known one at scan 75; later ones may be of either.
    assert len(list(ts.Recording(tmp_path / "a.mcap"))) == 76


OTHERS: dict[str, tuple[int, int]] = {  # how far another unit's numbers, and its clock [us], are ahead
    "number and time near": (40, 350_000),
    "number near": (40, 5_000_000),
    "number that is due": (0, 2_000_000),
    "number that is due, earlier": (0, -300_000),
}


@pytest.mark.parametrize("kind", OTHERS)
def test_no_scan_of_another_unit_is_recorded_whatever_its_number(
    clock: Clock, tmp_path: Path, kind: str
) -> None:
    ahead, ahead_us = OTHERS[kind]

    def then(device: Rogue, n: int) -> None:
        if n == 150:
            device.name, device.number = b"right", lambda i: i + ahead
            device.stamp = lambda us: us + ahead_us

    with pytest.raises(ts.PortError, match="unit_name = 'right'"):
        recorded(Rogue(clock), tmp_path, then=then)
    assert len(list(ts.Recording(tmp_path / "a.mcap"))) == 151


class BothAnswer(Rogue):
    """A line that a second unit sends on too: it answers what the first one answers."""

    def write(self, data: bytes) -> None:
        asked = self.commands.count(0x81)
        super().write(data)
        self.out += self.hello(name=b"right") * (self.commands.count(0x81) - asked)


def test_two_units_on_one_line_are_named(clock: Clock, tmp_path: Path) -> None:
    def also_sends(device: Rogue, i: int, data: bytes) -> list[bytes]:
        return [data, device.scan(i + 5000)]

    with pytest.raises(ts.PortError, match="two units answer on one line, 'left' and 'right'"):
        recorded(BothAnswer(clock, also_sends), tmp_path)


class BehindAnOldHello(Rogue):
    """A unit whose first answer comes behind, or is lost but for, an old hello of another, left in the adapter."""

    def __init__(self, clock: Clock, lost: bool) -> None:
        super().__init__(clock, name=b"right")
        self.lost = lost

    def write(self, data: bytes) -> None:
        first = 0x81 not in self.commands
        super().write(data)
        if first:
            self.out = self.hello(name=b"left") + (b"" if self.lost else self.out)


@pytest.mark.parametrize("lost", [False, True])
def test_another_unit_behind_an_old_hello_is_not_recorded(clock: Clock, tmp_path: Path, lost: bool) -> None:
    with pytest.raises(ts.PortError, match="'left'"):
        recorded(BehindAnOldHello(clock, lost), tmp_path)
    assert not (tmp_path / "a.mcap").exists() or not len(list(ts.Recording(tmp_path / "a.mcap")))


def test_a_test_that_nobody_asked_for_is_told(clock: Clock, tmp_path: Path) -> None:
    tested = frame(4, 7, 0, struct.pack("<HHI", STRIPS, 5000, 0) + bytes(STRIPS))
    which, _, said = recorded(Rogue(clock, every(40, lambda d, i, data: [tested, data])), tmp_path)
    assert which == list(range(SCANS))
    assert said == ["the device tells of a test that was not asked for"]


def test_scans_that_the_device_began_too_late_are_told_by_its_count(clock: Clock, tmp_path: Path) -> None:
    def stalls(device: Rogue, i: int, data: bytes) -> list[bytes]:
        if i % 40 == 39:
            device.late += 2
            device.start_s += 0.02
        return [data]

    device = Rogue(clock, stalls)
    which, scans, said = recorded(device, tmp_path)
    assert which == list(range(SCANS))
    assert (np.diff([r.time_s for r in scans]) > 0.0).all()
    assert re.search(r"2 scan\(s\) began a period or more too late, says the device", said[0])
    assert len(said) == 1
    assert device.commands.count(0x81) <= 1 + SCANS // 40


def test_after_a_gap_the_same_unit_goes_on(clock: Clock, tmp_path: Path) -> None:
    def trouble(device: Rogue, i: int, data: bytes) -> list[bytes]:
        return [] if i % 60 in range(30, 50) else [data]

    device = Rogue(clock, trouble)
    which, scans, said = recorded(device, tmp_path)
    assert which == [i for i in range(which[-1] + 1) if i % 60 not in range(30, 50)]
    assert (np.diff([r.time_s for r in scans]) > 0.0).all()
    assert device.commands.count(0x81) == 2 + (which[-1] + 10) // 60  # two before the first scan
    assert all("missing" in text for text in said)


@pytest.mark.parametrize("seed", range(4))
def test_all_at_once(clock: Clock, tmp_path: Path, seed: int) -> None:
    """Every trouble at random, a third of the scans: intact ones are recorded once, in order of their numbers."""
    intact: list[int] = []

    def spoil(device: Rogue, i: int, data: bytes) -> list[bytes]:
        kind = int(device.random.integers(0, 24))
        if kind == 0:
            return changed(device, i, data)
        if kind in (1, 2):
            return [data[: 25 * (2 - kind)]]
        intact.append(i)
        held, device.keep = device.keep, []
        around = {
            3: [data, data],
            4: [device.random.bytes(60), data],
            5: [frame(9, i, 0, b""), data],
            6: [device.hello(), data],
        }
        if kind == 7:
            device.keep = [*held, data]  # it comes after the next one
            return []
        return [*around.get(kind, [data]), *held]

    device = Rogue(clock, spoil)
    device.random = np.random.default_rng(seed)
    which, scans, said = recorded(device, tmp_path)
    assert which == [i for i in intact if i <= which[-1]]
    assert (np.diff([r.time_s for r in scans]) > 0.0).all()
    for word in ("broken", "missing", "came again", "after later ones", "another version"):
        assert any(word in text for text in said)
    assert not any("anew" in text or "clock" in text for text in said)


def test_a_unit_is_not_read_with_the_calibration_of_another(clock: Clock) -> None:
    def calibrated(unit: str) -> ts.Sensor:
        return replace(SENSOR, calibration=ts.Calibration(unit=unit))

    for unit in ("left", "", "the third one of March, with the long cable"):  # of the last no device can be
        assert ts.SerialSource(lambda: Rogue(clock), calibrated(unit)).hello.unit_name == "left"
    with pytest.raises(ts.PortError, match="calibration is of the unit 'right', and the device is 'left'"):
        ts.SerialSource(lambda: Rogue(clock), calibrated("right"))


def test_a_full_last_block_may_be_followed_by_an_empty_one(clock: Clock) -> None:
    """docs/reference/protocol.md: none is sent; both are taken."""
    for length in range(600):
        body = bytes([7]) * length
        plain = b"\x01\x09" + bytes([5]) * 8 + body
        for data in (frame(9, 0x05050505, 0x05050505, body, empty_block=more) for more in (False, True)):
            assert check_frame(data[1:-1]) == plain
        assert encode_frame(9, body, 0x05050505, 0x05050505) == frame(9, 0x05050505, 0x05050505, body)
