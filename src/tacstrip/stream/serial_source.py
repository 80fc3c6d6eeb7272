"""A device on a port as a source of scans: greets it, starts it, and finds it again when it was unplugged."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace

from tacstrip.arguments import takes
from tacstrip.errors import PortError
from tacstrip.sensor.spec import Sensor
from tacstrip.stream.clocks import DeviceClock, HostClock
from tacstrip.stream.greeting import OtherDeviceError, check_device, check_unit, greet, sensor_of
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
_ASK_S = 0.5  # between two questions who the device is
# A reader had been waiting for scans where it waited for a fifth of a period, within these limits [s].
_PROMPT_S = (0.0002, 0.02)


@dataclass
class _Unsure:
    """Scans of a device that may be another one, since when it is asked who it is [s], and how often."""

    since_s: float
    asked: int = 1
    scans: list[RawScan] = field(default_factory=list)


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
        The port cannot be opened, nothing on it speaks the protocol, or the device is not of this spec. Later: another
        device is plugged in, or one that started anew does not say who it is.
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
        self.origin_ns, self._host = time.time_ns(), HostClock()
        period_us = self.hello.period_us if self._period_us is None else self._period_us
        self._period_s = max(period_us, self.hello.cycle_us) * 1e-6
        self._clock = DeviceClock(self._period_s)
        self._run = 0  # restarts by the last scan
        self._unsure: _Unsure | None = None

    @property
    def counts(self) -> Counts:
        """What came in, and what was lost or spoilt, since the source was made."""
        return Counts(*(a + b for a, b in zip(self._past, self._decoder.counts, strict=True)))

    def __iter__(self) -> Iterator[RawScan]:
        while not self._closed:
            try:
                yield from self._scans()
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

    def _scans(self) -> Iterator[RawScan]:
        """Give the scans of one connection, their times by our clock."""
        assert self._port is not None
        self._clock.restart()
        self._start()
        self._unsure = None
        self._run = self._decoder.counts.restarts
        patience_s = max(_SILENT_S, 4e-6 * self.hello.period_us)
        prompt_s = min(max(_PROMPT_S[0], self._period_s / 5.0), _PROMPT_S[1])
        heard_s, came, said, corrupt = self._host(), False, False, self._decoder.counts.corrupt
        greeted = False  # the device started anew, said hello, and sent nothing since
        while not self._closed:
            began_s = self._host()
            data = self._port.read(_READ_S)
            self.arrived_s, now_s = time.perf_counter(), self._host()
            received = self._decoder.feed(data) if data else []
            self.waiting = sum(len(batch) for batch in received if isinstance(batch, ScanBatch))
            for message in received:
                if isinstance(message, Hello):
                    check_unit(message, self.hello)
                    if not message.streaming:
                        greeted = True
                        if came:
                            self.tell("the device started anew; it is told to send")
                        self._start()
                    if self._unsure is not None:
                        held, self._unsure = self._unsure.scans, None
                        yield from self._given(held)
                if not isinstance(message, ScanBatch):
                    continue
                self._check_batch(message)
                came, corrupt = True, self._decoder.counts.corrupt
                if said:
                    said = False
                    self.tell("scans come again")
                yield from self._given(self._timed(message, now_s, now_s - began_s > prompt_s, greeted))
                greeted, heard_s = False, self._host()  # whoever takes the scans may have taken long
            if self._unsure is not None:
                self._ask_again()
            if self._host() - heard_s > patience_s:
                heard_s = self._host()
                self._start()
                self._doubt()  # who it is: the silence may have been a change of cables
                if not said:
                    said = True
                    bad = self._decoder.counts.corrupt - corrupt
                    why = (
                        f"{bad} broken frames came: is the cable sound?"
                        if bad
                        else "it is told to send again"
                    )
                    self.tell(f"no scan came for {patience_s:.2g} s; {why}")

    def _timed(self, batch: ScanBatch, now_s: float, prompt: bool, greeted: bool) -> list[RawScan]:
        """Return a batch's scans with their times by our clock; begin to doubt the unit where they are of a new run.

        `greeted`: the device has said since its last scan that it started anew, and who it is.
        """
        scans = list(batch.scans())
        believed = not self._clock.fault
        out: list[RawScan] = []
        if batch.restarts != self._run:
            self._run = batch.restarts
            if not greeted:
                self._doubt()
            if not self._clock.goes_on(scans[0], now_s):
                self._begin_anew(greeted)
        while scans:
            many = self._clock.of_this_run(scans, now_s)
            if many < len(scans):
                prompt = False
            if part := scans[:many]:
                out += self._with_times(part, now_s, prompt)
            scans = scans[many:]
            if scans:
                self._doubt()
                self._begin_anew(greeted=False)
        if believed and self._clock.fault:
            self.tell(f"{self._clock.fault}; from now on times are the computer's")
        return out

    def _with_times(self, scans: list[RawScan], now_s: float, prompt: bool) -> list[RawScan]:
        times = self._clock.times(scans, now_s, prompt)
        return [replace(raw, time_s=time_s) for raw, time_s in zip(scans, times, strict=True)]

    def _given(self, scans: list[RawScan]) -> Iterator[RawScan]:
        """Give scans, or keep them until it is known whose they are."""
        if self._unsure is not None:
            self._unsure.scans += scans
            return
        self.waiting = max(self.waiting, len(scans))
        for raw in scans:
            self.waiting -= 1
            yield raw

    def _begin_anew(self, greeted: bool) -> None:
        self._clock.restart()
        if not greeted:
            self.tell("the device started anew without a word, or is another one; it is asked who it is")

    def _doubt(self) -> None:
        """Keep scans back until the device has said who it is."""
        if self._unsure is None:
            self._unsure = _Unsure(self._host())
            self._write(Kind.IDENTIFY)

    def _ask_again(self) -> None:
        assert self._unsure is not None
        since_s = self._host() - self._unsure.since_s
        if self._unsure.scans and since_s > self._greet_s:
            raise PortError(
                f"the device began anew and has not said for {self._greet_s:g} s who it is: {len(self._unsure.scans)} "
                "scan(s) are left out, for they may be another unit's. Is its receiving line connected?"
            )
        if since_s > _ASK_S * self._unsure.asked:
            self._unsure.asked += 1
            self._write(Kind.IDENTIFY)

    def _connect(self) -> Hello:
        self._port, self._decoder = self._open_port(), Decoder()
        try:
            hello = greet(self._port, self._decoder, self._greet_s, lambda: self._closed)
            if self._wanted is not None:
                check_device(hello, self._wanted)
                check_unit(hello, self.hello)
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
        if self._period_us is not None:
            self._write(Kind.RATE, self._period_us)
        self._write(Kind.START)

    def _release(self) -> None:
        if self._port is None:
            return
        with suppress(OSError, PortError):  # if it is gone, that stops it too
            self._write(Kind.STOP)
        self._port.close()

    def _write(self, kind: Kind, period_us: int | None = None) -> None:
        assert self._port is not None
        self._commands += 1
        self._port.write(Command(kind, self._commands, period_us).encode())

    def _check_batch(self, batch: ScanBatch) -> None:
        same = batch.touched.shape[1] == self.sensor.strips and batch.adc_bits == self.sensor.adc_bits
        if not same or tuple(batch.codes) != self.names:
            raise OtherDeviceError(
                "the device sends other scans than its hello said; flash its firmware anew"
            )
