"""A device on a port as a source of scans: greets it, starts it, and finds it again when it was unplugged."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace

from tacstrip.arguments import takes
from tacstrip.errors import PortError
from tacstrip.sensor.spec import Sensor
from tacstrip.stream.greeting import OtherDeviceError, check_device, greet, sensor_of
from tacstrip.stream.port import Port
from tacstrip.stream.source import RawScan
from tacstrip.stream.wire import Counts, Decoder
from tacstrip.stream.wire_commands import Command
from tacstrip.stream.wire_frames import Kind
from tacstrip.stream.wire_messages import Hello
from tacstrip.stream.wire_scans import ScanBatch

_GREET_S = 5.0  # an Uno needs 2 to wake up
_READ_S = 0.1  # the longest wait for a byte before a stop is noticed
_SILENT_S = 1.0  # without a scan, or four periods: something is wrong
_RETRY_S = 0.3  # between two attempts to open a port that is gone


class SerialSource:
    """The scans of a device. Iterate it once, in one thread; `close` may come from another.

    Parameters
    ----------
    open_port
        Opens the line: called at once, and again after the device was unplugged.
    sensor
        Its spec; None: the shipped one of the same construction and strips.
    rate_hz
        Scans a second to ask for; None: what the device does by itself, 0: as fast as it goes.
    tell
        Called with what a user should know, a line each.
    greet_s
        How long to wait for the device to say who it is [s].

    Attributes
    ----------
    sensor, names, origin_ns
        As of every source.
    hello
        Who the device says it is.
    tell
        As given; whoever takes the source over may set another.
    arrived_s
        When the bytes of the last scan came, by `time.perf_counter` [s].
    waiting
        How many newer scans were read together with the last one: above 0 where the reader is behind.

    Raises
    ------
    PortError
        The port cannot be opened, nothing on it speaks the protocol, or the device is not of this spec; later
        too, when another device is plugged in.
    """

    @takes(sensor=Sensor)
    def __init__(
        self,
        open_port: Callable[[], Port],
        sensor: Sensor | None = None,
        rate_hz: float | None = None,
        tell: Callable[[str], None] = lambda text: None,
        greet_s: float = _GREET_S,
    ) -> None:
        self._open_port, self.tell, self._greet_s = open_port, tell, greet_s
        self._period_us = None if rate_hz is None else round(1e6 / rate_hz) if rate_hz else 0
        self._closed = False
        self._commands = 0
        self._past = Counts()
        self._port: Port | None = None
        self.arrived_s = 0.0
        self.waiting = 0
        self._wanted: Sensor | None = None
        self.hello = self._connect()
        self.sensor = self._wanted = sensor_of(self.hello, sensor)
        self.names = self.hello.signatures
        self.origin_ns, self._origin_s = time.time_ns(), time.monotonic()

    @property
    def counts(self) -> Counts:
        """What came in, and what was lost or spoilt, since the source was made."""
        return Counts(*(a + b for a, b in zip(self._past, self._decoder.counts, strict=True)))

    def __iter__(self) -> Iterator[RawScan]:
        last_s = -1.0
        while not self._closed:
            try:
                for raw in self._scans(last_s):
                    last_s = raw.time_s
                    yield raw
            except PortError:
                raise
            except OSError as error:
                if not self._closed:
                    self.tell(f"the device is gone ({error}); plug it in again and it goes on")
                    self._reconnect()
        self._release()

    def close(self) -> None:
        """End the stream: the thread that iterates stops the device and lets go of the port."""
        self._closed = True

    def _scans(self, last_s: float) -> Iterator[RawScan]:
        """Give the scans of one connection, their times by our clock."""
        assert self._port is not None
        self._start()
        offset_s: float | None = None
        restarts = self._decoder.counts.restarts
        patience_s = max(_SILENT_S, 4e-6 * self.hello.period_us)
        heard_s, said, corrupt = time.monotonic(), False, self._decoder.counts.corrupt
        while not self._closed:
            data = self._port.read(_READ_S)
            self.arrived_s = time.perf_counter()
            received = self._decoder.feed(data) if data else []
            self.waiting = sum(len(batch) for batch in received if isinstance(batch, ScanBatch))
            for message in received:
                if isinstance(message, Hello) and not message.streaming:
                    self.tell("the device started anew; it is told to send")
                    self._start()
                if not isinstance(message, ScanBatch):
                    continue
                self._check_batch(message)
                if offset_s is None or message.restarts != restarts:
                    restarts = message.restarts
                    now_s = time.monotonic() - self._origin_s
                    offset_s = max(
                        now_s - message.time_us[-1] * 1e-6, last_s + 1e-6 - message.time_us[0] * 1e-6
                    )
                heard_s, corrupt = time.monotonic(), self._decoder.counts.corrupt
                if said:
                    said = False
                    self.tell("scans come again")
                for raw in message.scans():
                    last_s = raw.time_s + offset_s
                    self.waiting -= 1
                    yield replace(raw, time_s=last_s)
            if time.monotonic() - heard_s > patience_s:
                heard_s = time.monotonic()
                self._start()
                if not said:
                    said = True
                    bad = self._decoder.counts.corrupt - corrupt
                    why = (
                        f"{bad} broken frames came: is the cable sound?"
                        if bad
                        else "it is told to send again"
                    )
                    self.tell(f"no scan came for {patience_s:.2g} s; {why}")

    def _connect(self) -> Hello:
        self._port, self._decoder = self._open_port(), Decoder()
        try:
            hello = greet(self._port, self._decoder, self._greet_s, lambda: self._closed)
            if self._wanted is not None:
                check_device(hello, self._wanted)
            return hello
        except BaseException:
            self._port.close()
            raise

    def _reconnect(self) -> None:
        self._past = self.counts
        self._decoder = Decoder()
        if self._port is not None:
            self._port.close()
            self._port = None
        while not self._closed:
            try:
                self.hello = self._connect()
            except (OSError, PortError) as error:
                if self._wanted is not None and isinstance(error, OtherDeviceError):
                    raise
                time.sleep(_RETRY_S)
            else:
                self.tell("the device is back")
                return

    def _start(self) -> None:
        assert self._port is not None
        if self._period_us is not None:
            self._port.write(self._command(Kind.RATE, self._period_us))
        self._port.write(self._command(Kind.START))

    def _release(self) -> None:
        if self._port is None:
            return
        with suppress(OSError, PortError):  # if it is gone, that stops it too
            self._port.write(self._command(Kind.STOP))
        self._port.close()

    def _command(self, kind: Kind, period_us: int | None = None) -> bytes:
        self._commands += 1
        return Command(kind, self._commands, period_us).encode()

    def _check_batch(self, batch: ScanBatch) -> None:
        same = batch.touched.shape[1] == self.sensor.strips and batch.adc_bits == self.sensor.adc_bits
        if not same or tuple(batch.codes) != self.names:
            raise OtherDeviceError(
                "the device sends other scans than its hello said; flash its firmware anew"
            )
