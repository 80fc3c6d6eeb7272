"""A device as a source: the greeting, the stream, and all that can go wrong on the line."""

from __future__ import annotations

import os
import random
import time
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice, pairwise
from pathlib import Path

import numpy as np
import pytest

import tacstrip as ts
from live_devices import SENSOR, Line, LinkedPty, Noise, Stepped, device, with_strips
from one_clock import Clock
from tacstrip.stream.codes import decode
from tacstrip.stream.device.port import SerialPort
from tacstrip.stream.device.protocol.decoder import Decoder
from tacstrip.stream.device.protocol.frames import Kind
from tacstrip.stream.device.protocol.messages import Command, Hello, Reply, SelfTest, Status
from tacstrip.stream.device.protocol.scans import ScanBatch
from tacstrip.stream.device.virtual import Loopback, VirtualDevice


def _said(made: VirtualDevice, command: Command) -> object:
    (message,) = Decoder().feed(made.receive(command.encode()))
    return message


def test_a_virtual_device_answers_every_command() -> None:
    made = device(rate_hz=100.0)
    hello = _said(made, Command(Kind.IDENTIFY, 1))
    assert isinstance(hello, Hello)
    assert (hello.construction, hello.strips, hello.adc_bits) == ("crs-crs", 20, 12)
    assert (hello.signatures, hello.period_us, hello.streaming) == (("kh", "kl"), 10_000, False)
    rate = _said(made, Command(Kind.RATE, 2, 2500))
    assert isinstance(rate, Reply)
    assert (rate.command_sequence, rate.status, rate.value) == (2, Status.DONE, 2500)
    assert made.wait_s() == np.inf
    for kind in (Kind.START, Kind.STOP):
        assert isinstance(_said(made, Command(kind, 3)), Reply)
        assert (made.wait_s() < 1.0) == (kind == Kind.START)
    tested = _said(made, Command(Kind.TEST, 4))
    assert isinstance(tested, SelfTest)
    assert not any(flags.any() for flags in tested.held.values())


def test_a_virtual_device_sends_what_is_due_and_leaves_out_what_is_far_too_late() -> None:
    clock = Clock()
    noise = ts.Noise(positional=0.001)
    contact = ts.Contact.polygon([(20, 20), (80, 30), (50, 70)])
    made = VirtualDevice(
        SENSOR,
        lambda: iter(ts.SimulatedSource(SENSOR, lambda t: contact, 100, None, noise)),
        100.0,
        0.004,
        clock,
    )
    made.receive(Command(Kind.START).encode())
    decoder = Decoder()
    clock.now_s += 0.0955
    (batch,) = decoder.feed(made.send())
    assert isinstance(batch, ScanBatch)
    assert len(batch) == 10
    np.testing.assert_allclose(np.diff(batch.time_us), 10_000)
    assert set(batch.span_us) == {4000}
    assert made.wait_s() == pytest.approx(0.0045)
    clock.now_s += 10.0
    (batch,) = decoder.feed(made.send())
    assert isinstance(batch, ScanBatch)
    assert len(batch) == 256
    assert made.hello.late == 1000 - 256
    assert decoder.counts.lost == 0  # left out by the device, not on the line


def test_a_clock_that_steps_from_scan_to_scan_never_stands_still() -> None:
    """Told to start at .3 s, a device was 1e-11 us short of its second scan, for ever."""
    for begun_s in np.linspace(0.0, 3.0, 31):
        line = Stepped(500.0)
        line._now_s = float(begun_s)
        line.write(Command(Kind.START).encode())
        assert (
            sum(
                len(b)
                for b in Decoder().feed(b"".join(line.read(0.0) for _ in range(100)))
                if isinstance(b, ScanBatch)
            )
            >= 99
        )


def test_scans_have_the_time_of_every_strip_and_codes_that_decode() -> None:
    begun_s = time.time()
    source = ts.SerialSource(lambda: Stepped(500.0), SENSOR)
    stream = iter(source)
    scans = [next(stream)]
    arrived_s = time.time()
    scans += islice(stream, 59)
    source.close()
    for raw in scans:
        assert raw.strip_time_s is not None
        np.testing.assert_allclose(raw.strip_time_s, np.linspace(0.0, 0.001, 20), atol=1e-6)
        found = decode(raw, source.sensor).touched
        assert found[5:15].all()
        assert not found[:4].any()
    np.testing.assert_allclose(np.diff([raw.time_s for raw in scans]), 0.002, atol=1e-6)
    assert begun_s < source.origin_ns * 1e-9 + scans[0].time_s < arrived_s + 0.01
    assert source.counts.lost == source.counts.corrupt == 0


def test_rate_and_stop_reach_the_device() -> None:
    line = Stepped(100.0)
    source = ts.SerialSource(lambda: line, SENSOR, rate_hz=400.0)
    scans = iter(source)
    times = [next(scans).time_s for _ in range(5)]
    np.testing.assert_allclose(np.diff(times), 0.0025, atol=1e-6)
    assert line.device.hello.streaming
    source.close()
    assert list(scans) is not None
    assert not line.device.hello.streaming


def test_without_a_spec_the_shipped_one_is_taken() -> None:
    shipped = replace(ts.Sensor.load("prototype-crs-crs"), adc_bits=10)
    contact = ts.Contact.polygon([(10, 100), (50, 90), (40, 200)])
    made = device(shipped, contact=lambda t: contact)
    said: list[str] = []
    source = ts.SerialSource(lambda: Loopback(made), on_message=said.append)
    assert source.sensor == shipped
    next(iter(source))
    source.close()
    assert said[0].startswith(
        "no spec was given, and the device does not tell its lengths: 6.5 mm of pitch and 325"
    )
    with pytest.raises(
        ts.PortError, match=r"crs-crs sensor of 20 strips, and no shipped spec .* `tacstrip init"
    ):
        ts.SerialSource(lambda: Loopback(device()))


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        (with_strips(12), r"strips = 20 and the spec 12: name the right spec with --sensor"),
        (replace(SENSOR, adc_bits=10), r"adc_bits = 12 and the spec 10"),
        (
            ts.Sensor(construction="crs-m", strips=20, pitch_mm=5.0, length_mm=100.0),
            r"construction = crs-crs and the spec crs-m",
        ),
    ],
)
def test_a_device_of_another_spec_is_refused(spec: ts.Sensor, message: str) -> None:
    with pytest.raises(ts.PortError, match=message):
        ts.SerialSource(lambda: Loopback(device()), spec)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", r"nothing came: is the firmware on it"),
        (b"Arduino says hello\r\n", r"bytes came and no frame among them: another device, or another --baud"),
        (random.Random(1).randbytes(500), r"bytes came and no frame among them"),
    ],
)
def test_what_is_no_device_is_named(data: bytes, message: str) -> None:
    with pytest.raises(ts.PortError, match=message):
        ts.SerialSource(lambda: Noise(data), SENSOR, handshake_s=0.05)


def test_a_port_that_is_not_there_is_named() -> None:
    with pytest.raises(ts.PortError, match=r"/dev/none: no such port. There are: "):
        ts.SerialSource(lambda: SerialPort("/dev/none"), SENSOR)


def test_pulled_out_within_a_frame_and_plugged_in_again() -> None:
    said: list[str] = []
    lines = iter([Line(device(), cut=1000), Line(device())])
    failures = [True]

    def plug() -> Line:
        if said and failures and failures.pop():
            raise ts.PortError("no such port")
        return next(lines)

    source = ts.SerialSource(plug, SENSOR, on_message=said.append)
    scans = list(islice(source, 40))
    assert [text.partition(" (")[0] for text in said] == ["the device is gone", "the device is back"]
    assert all(a.time_s < b.time_s for a, b in pairwise(scans))
    assert [raw.sequence for raw in scans].count(0) == 2  # both began to count at 0
    assert source.counts.lost == 0
    assert scans[-1].time_s - scans[0].time_s > 0.3  # the time that it was gone counts


def test_another_device_plugged_in_ends_the_stream() -> None:
    other = with_strips(30)
    lines = iter([Line(device(), cut=1000), Line(device(other))])
    source = ts.SerialSource(lambda: next(lines), SENSOR)
    with pytest.raises(ts.PortError, match="strips = 30 and the spec 20"):
        list(source)


class _Deaf(Loopback):
    """Stops in the middle of the stream, until it is told to start again."""

    stops = 1

    def read(self, wait_s: float) -> bytes:
        data = super().read(wait_s)
        if self.stops and self.device._number > 20:
            self.stops -= 1
            self.device.receive(Command(Kind.STOP).encode())
        return data


def test_a_silent_device_is_told_to_send_again() -> None:
    said: list[str] = []
    source = ts.SerialSource(lambda: _Deaf(device()), SENSOR, on_message=said.append)
    assert len(list(islice(source, 60))) == 60
    assert said == ["no scan came for 0.8 s; it is told to send again", "scans come again"]


class _Spoilt(Loopback):
    """Changes a byte of the first frame read after ten more were sent, however many a read brings."""

    _spoilt = 0

    def read(self, wait_s: float) -> bytes:
        data = bytearray(super().read(wait_s))
        if len(data) > 50 and self.device._number >= self._spoilt + 10:
            self._spoilt = self.device._number
            data[30] ^= 0x55
        return bytes(data)


def test_spoilt_frames_are_counted_and_the_others_come() -> None:
    source = ts.SerialSource(lambda: _Spoilt(device(rate_hz=1000.0)), SENSOR)
    numbers = []
    for raw in source:
        numbers.append(raw.sequence)
        if len(numbers) >= 300 and source.waiting == 0:  # else frames are counted whose scans were not taken
            break
    assert numbers == sorted(set(numbers))
    assert source.counts.corrupt > 0
    assert source.counts.lost == numbers[-1] + 1 - len(numbers) - numbers[0]


@pytest.fixture
def served(tmp_path: Path) -> Iterator[LinkedPty]:
    with LinkedPty(device(), tmp_path / "ttyTEST") as one:
        yield one


def test_a_device_behind_a_serial_port(served: LinkedPty, tmp_path: Path) -> None:
    said: list[str] = []
    source = ts.SerialSource(lambda: SerialPort(served.path), SENSOR, on_message=said.append)
    scans = iter(source)
    numbers = [next(scans).sequence for _ in range(50)]
    assert numbers == list(range(50))
    with pytest.raises(ts.PortError, match="another program has it open"):
        SerialPort(served.path)
    served.close()
    with LinkedPty(device(), tmp_path / "ttyTEST"):
        more = [raw.sequence for raw in islice(scans, 60)]
    assert 0 in more
    assert [text.partition(" (")[0] for text in said] == ["the device is gone", "the device is back"]
    assert source.counts.corrupt == 0
    source.close()


def test_a_port_that_is_gone_says_so_and_not_that_it_cannot_be_configured() -> None:
    end, line = pytest.importorskip("pty").openpty()
    port = SerialPort(os.ttyname(line))
    os.close(line)
    assert port.read(0.0) == b""
    os.close(end)
    with pytest.raises(OSError, match="disconnected"):
        port.read(0.0)
    port.close()


def test_where_a_contact_cannot_be_nothing_is_touched() -> None:
    place = [SENSOR.width_mm * 3.0]
    made = device(
        rate_hz=500.0, contact=lambda t: ts.Contact.polygon([(0, 10), (30, 20), (10, 60)]).moved(place[0], 0)
    )
    source = ts.SerialSource(lambda: Loopback(made), SENSOR)
    scans = iter(source)
    assert not next(scans).touched.any()
    assert "outside the sensor" in made.problem
    place[0] = 20.0
    assert any(next(scans).touched.any() for _ in range(100))
    assert made.problem == ""
    source.close()
