"""A simulated device: it answers commands and sends scans as the firmware does (docs/reference/protocol.md).

On Linux and macOS other programs find it on a pseudo-terminal, as a serial port.
"""

from __future__ import annotations

import os
import select
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Self

import numpy as np

from tacstrip.arguments import takes
from tacstrip.errors import ContactError, PortError
from tacstrip.sensor.layers import AnySensor, LayeredSensor, unit_of
from tacstrip.sensor.spec import Sensor
from tacstrip.stream.codes import code_type, top_code, with_converter
from tacstrip.stream.device.protocol.decoder import Decoder
from tacstrip.stream.device.protocol.frames import Kind
from tacstrip.stream.device.protocol.messages import (
    MAX_PERIOD_US,
    Command,
    Hello,
    Reply,
    SelfTest,
    Status,
    is_name,
)
from tacstrip.stream.device.protocol.scans import encode_scan
from tacstrip.stream.source import RawScan

_MAX_BURST = 256  # scans sent at once; older ones are skipped and counted as `late`
_WAIT_S = 0.05
_BYTES = 4096


class VirtualDevice:
    """A simulated device. It turns received bytes into bytes to send; a port is not part of it.

    Parameters
    ----------
    sensor
        The sensor; a spec without `adc_bits` gets a converter of 16 bits. Of two layers the device sends the strips of
        both, one layer after the other.
    scans
        Returns an endless iterator of scans; their times and numbers are replaced by the device's own. While it
        raises `ContactError`, nothing is touched.
    rate_hz
        Scan rate until the host asks for another [Hz].
    span_s
        Time from the reading of the first strip to that of the last [s].
    clock
        The device's clock [s].

    Attributes
    ----------
    problem
        Why the contact cannot be simulated; empty where it can.

    Examples
    --------
    >>> import tacstrip as ts
    >>> from tacstrip.stream import VirtualDevice
    >>> from tacstrip.stream.device.virtual import Loopback
    >>> sensor = ts.Sensor(construction="crs-crs", strips=10, pitch_mm=6.5, length_mm=365.0)
    >>> contact = ts.Contact.polygon([(10, 100), (50, 100), (30, 200)])
    >>> scans = ts.SimulatedSource(sensor, lambda time_s: contact, rate_hz=200.0)
    >>> device = VirtualDevice(sensor, lambda: iter(scans), rate_hz=200.0)
    >>> source = ts.SerialSource(lambda: Loopback(device), sensor)
    >>> int(next(iter(source)).touched.sum())
    6
    """

    @takes(sensor=Sensor | LayeredSensor)
    def __init__(
        self,
        sensor: AnySensor,
        scans: Callable[[], Iterator[RawScan]],
        rate_hz: float,
        span_s: float = 0.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.sensor = with_converter(unit_of(sensor))
        self.problem = ""
        self._begin = scans
        self._scans: Iterator[RawScan] = iter(())
        self._span_s, self._clock = span_s, clock
        self._period_us = round(1e6 / rate_hz)
        self._start_s = self._boot_s = clock()
        # Scans due since the start, sent since the reset, and skipped.
        self._due = self._number = self._late = 0
        self._streaming = False
        self._decoder = Decoder()
        assert self.sensor.adc_bits is not None
        self._bits = self.sensor.adc_bits
        unit = "" if self.sensor.calibration is None else self.sensor.calibration.unit
        self._name = unit if is_name(unit) else "virtual"
        self._offsets = np.linspace(0.0, span_s, self.sensor.strips)
        self._untouched = np.zeros(self.sensor.strips, dtype=bool)
        rest = 0.5 if self.sensor.rest_volt is None else self.sensor.rest_volt / self.sensor.vref_volt
        self._rest = code_type(self.sensor).type(rest * top_code(self.sensor))  # the code of an open line
        self._untouched_codes = {n: np.full(self.sensor.strips, self._rest) for n in self.sensor.signatures}

    @property
    def hello(self) -> Hello:
        """The message that identifies it."""
        return Hello(
            construction=self.sensor.construction, strips=self.sensor.strips, signatures=self.sensor.signatures,
            adc_bits=self._bits, streaming=self._streaming, supply_mv=round(1e3 * self.sensor.vref_volt),
            period_us=self._period_us, cycle_us=round(1e6 * self._span_s), late=self._late, unit_name=self._name,
        )  # fmt: skip

    def receive(self, data: bytes) -> bytes:
        """Execute the commands in bytes from the host; return the replies."""
        received = self._decoder.feed(data)
        return b"".join(self._execute(command) for command in received if isinstance(command, Command))

    def send(self) -> bytes:
        """Return the scans that are due by now."""
        if not self._streaming:
            return b""
        # A clock that steps to when a scan is due may be a rounding error short of it, and would stand still.
        passed_us = round((self._clock() - self._start_s) * 1e6, 3)
        due = int(passed_us / self._period_us) + 1 - self._due if self._period_us else 1
        skipped = max(0, due - _MAX_BURST)
        self._late += skipped
        self._due += skipped
        out = []
        for _ in range(due - skipped):
            at_us = self._due * self._period_us if self._period_us else passed_us
            out.append(self._frame(self._start_s + at_us * 1e-6 - self._boot_s))
            self._due += 1
        return b"".join(out)

    def wait_s(self) -> float:
        """Return the time until the next scan [s]; infinite while it sends none."""
        if not self._streaming:
            return float("inf")
        return max(0.0, self._start_s + self._due * self._period_us * 1e-6 - self._clock())

    def _frame(self, time_s: float) -> bytes:
        raw = self._next_scan()
        codes = {name: np.where(raw.touched, values, self._rest) for name, values in raw.codes.items()}
        raw = RawScan(time_s, codes, raw.touched, strip_time_s=self._offsets)
        frame = encode_scan(raw, self._bits, self._number)
        self._number += 1
        return frame

    def _next_scan(self) -> RawScan:
        """Return the next scan; untouched while the contact cannot be simulated."""
        self.problem = ""
        try:
            return next(self._scans)
        except (ContactError, StopIteration):  # the iterator has ended
            try:
                self._scans = self._begin()
                return next(self._scans)
            except ContactError as error:
                self.problem = str(error)
                return RawScan(0.0, self._untouched_codes, self._untouched)

    def _execute(self, command: Command) -> bytes:
        now_us = round((self._clock() - self._boot_s) * 1e6)
        status, value = Status.DONE, self._period_us
        match command.kind:
            case Kind.IDENTIFY:
                return self.hello.encode(self._number, now_us)
            case Kind.TEST:
                held = dict.fromkeys(self.sensor.signatures, self._untouched)
                return SelfTest(self.hello.supply_mv, self._late, held).encode(self._number, now_us)
            case Kind.START:
                self._streaming, self._start_s, self._due, self._late = True, self._clock(), 0, 0
            case Kind.STOP:
                self._streaming = False
            case Kind.RATE if command.period_us is not None and command.period_us <= MAX_PERIOD_US:
                self._period_us = value = command.period_us
                self._start_s, self._due = self._clock(), 0
        return Reply(command.kind, command.sequence, status, value).encode(self._number, now_us)


class Loopback:
    """The line to a virtual device in the same program, as of `tacstrip live --simulate`."""

    def __init__(self, device: VirtualDevice) -> None:
        self.device = device
        self._answers = b""
        self._open = True

    def read(self, wait_s: float) -> bytes:
        """Return the bytes that the device has sent."""
        if not self._open:
            raise PortError("the virtual device is closed")
        if not self._answers and (wait := min(wait_s, self.device.wait_s())) > 0.0:
            time.sleep(wait)
        data, self._answers = self._answers + self.device.send(), b""
        return data

    def write(self, data: bytes) -> None:
        """Send commands to the device."""
        self._answers += self.device.receive(data)

    def close(self) -> None:
        """Close the line."""
        self._open = False


class PtyDevice:
    """Serves a virtual device on a pseudo-terminal until it is closed; use it in `with`.

    Parameters
    ----------
    device
        The device.

    Attributes
    ----------
    path
        Name of the port.

    Raises
    ------
    PortError
        This system has no pseudo-terminals.
    """

    def __init__(self, device: VirtualDevice) -> None:
        try:
            import tty
        except ImportError:
            raise PortError("virtual serial ports need Linux or macOS; use --simulate instead") from None
        self.device = device
        self._master, self._slave = os.openpty()  # the slave stays open here, so that a host may come and go
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.path = os.ttyname(self._slave)
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._run, name="tacstrip device", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Unplug it; may be called twice."""
        if self._closed.is_set():
            return
        self._closed.set()
        self._thread.join()
        for end in (self._master, self._slave):
            os.close(end)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _run(self) -> None:
        out = b""
        while not self._closed.is_set():
            wait = 0.0 if out else min(_WAIT_S, self.device.wait_s())
            readable, _, _ = select.select([self._master], [], [], wait)
            if readable:
                out += self.device.receive(os.read(self._master, _BYTES))
            out += self.device.send()
            if out:
                select.select([], [self._master], [], _WAIT_S)
                # Where the host does not read, this does not wait for it, as a device would not.
                with suppress(BlockingIOError):
                    out = out[os.write(self._master, out) :]
            if len(out) > 64 * _BYTES:
                out = b""
