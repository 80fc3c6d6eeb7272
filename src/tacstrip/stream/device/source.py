"""A device on a port as a source of scans; it survives being unplugged and plugged in again."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import cast

import numpy as np

from tacstrip.arguments import takes
from tacstrip.errors import PortError, figures
from tacstrip.sensor.layers import AnySensor, LayeredSensor, unit_of
from tacstrip.sensor.spec import Sensor
from tacstrip.stream.device.clocks import DeviceClock, HostClock
from tacstrip.stream.device.handshake import (
    WrongDeviceError,
    check_alone,
    check_device,
    check_unit,
    handshake,
    sensor_of,
)
from tacstrip.stream.device.port import Port
from tacstrip.stream.device.protocol.decoder import Counts, Decoder
from tacstrip.stream.device.protocol.frames import Kind
from tacstrip.stream.device.protocol.messages import Command, Hello
from tacstrip.stream.device.protocol.order import MAX_AHEAD
from tacstrip.stream.device.protocol.scans import ScanBatch
from tacstrip.stream.device.troubles import Troubles
from tacstrip.stream.source import LOGGER, RawScan

_HANDSHAKE_S = 5.0  # an Arduino Uno needs 2 to boot
_READ_S = 0.1  # longest wait for a byte before a stop is noticed
_SILENT_S = 0.8  # the least time without a scan, and four periods, that count as silence
_RETRY_S = 0.3  # between two attempts to reopen a port
_ASK_S = 0.5  # between two requests to identify itself
# Between two requests to a device that sends, if they take a hundredth of its line at most: a hello has 760 bits.
_CONFIRM_S, _CONFIRM_BITS = 0.75, 76_000
_LATE = 1.9  # periods from one scan to the next: the device began a period too late
_START_S = 0.2  # between two commands to start after a hello, least
_ODD_SCANS = 20  # of another layout than the hello's, in a row, that end the stream
_FLOOD, _FLOOD_S, _FLOOD_SCANS = 1.5, 0.4, 20  # times the rate asked for, in two windows in a row
_SLOW, _SLOW_SCANS = 1.5, 4  # times the period asked for, likewise
_GAP = 16  # missing scans in a row, after which another device may send
_LONG = 1.5  # times the period that reading the strips may take
_OTHER_SUPPLY = 0.2  # of Vref: a device measures its supply by a reference of 10 %, and USB gives 5 V to 10 %
# A reader that waited for a fifth of a period, within these limits [s], was waiting for the scans.
_PROMPT_S = (0.0002, 0.02)


@dataclass
class _HeldScans:
    """Scans held back until the device has identified itself, the time of the first request [s], and their number."""

    since_s: float
    asked: int = 1
    scans: list[RawScan] = field(default_factory=list)


@dataclass
class _Silence:
    """Since when no scan came or the device was told to send [s], the broken frames before, and if it was reported."""

    since_s: float
    corrupt: int
    reported: bool = False


@dataclass(frozen=True)
class _WindowStart:
    """A scan's number and time by both clocks [s], and which run of the device it is of."""

    number: int
    device_s: float
    now_s: float
    run: int


class SerialSource:
    """The scans of a device. Iterate it once, in one thread; `close` may be called from another.

    Parameters
    ----------
    open_port
        Opens the line: called at once, and again after the device was unplugged.
    sensor
        Its spec, of one layer or two; None: the shipped spec of the same construction and number of strips,
        whose lengths may not be the device's, which is said.
    rate_hz
        Scan rate to request [Hz]; None: the device's own, 0: as fast as possible.
    on_message
        Called with messages for the user, a line each; by default those of the logger "tacstrip".
    handshake_s
        Longest time to wait for the device to identify itself [s].

    Attributes
    ----------
    sensor, names, origin_ns
        As of every source.
    hello
        The device's latest identification.
    on_message, arrived_s, waiting
        As of every `DeviceSource`.

    Raises
    ------
    PortError
        The port cannot be opened, nothing on it speaks the protocol, or the device is not the one of the spec. While
        iterating: another device was plugged in, or a restarted one does not identify itself.

    Examples
    --------
    A virtual device in place of one on a port:

    >>> import tacstrip as ts
    >>> from tacstrip.stream import VirtualDevice
    >>> from tacstrip.stream.device.virtual import Loopback
    >>> sensor = ts.Sensor(construction="crs-m", strips=8, pitch_mm=5.0, length_mm=100.0, adc_bits=10)
    >>> contact = ts.Contact.polygon([(8, 40), (32, 40), (20, 70)])
    >>> scans = ts.SimulatedSource(sensor, lambda time_s: contact)
    >>> device = VirtualDevice(sensor, lambda: iter(scans), rate_hz=100.0)
    >>> source = ts.SerialSource(lambda: Loopback(device), sensor)
    >>> source.hello.strips, source.names
    (8, ('k',))
    >>> int(next(iter(source)).touched.sum())
    4
    """

    @takes(sensor=Sensor | LayeredSensor)
    def __init__(
        self,
        open_port: Callable[[], Port],
        sensor: AnySensor | None = None,
        rate_hz: float | None = None,
        on_message: Callable[[str], None] = LOGGER.warning,
        handshake_s: float = _HANDSHAKE_S,
    ) -> None:
        self._open_port, self.on_message, self._handshake_s = open_port, on_message, handshake_s
        self._period_us = None if rate_hz is None else round(1e6 / rate_hz) if rate_hz else 0
        self._closed = False
        self._commands = 0
        self._previous_counts = Counts()
        self.arrived_s = 0.0
        self.waiting = 0
        self._wanted: Sensor | None = None  # what the device must be
        self.hello = self._connect()
        own = sensor_of(self.hello, sensor)
        self.sensor, self._wanted = cast(Sensor, own), unit_of(own)  # of two layers what takes one refuses it
        self._assumed = sensor is None
        self.names = self.hello.signatures
        self.origin_ns, self._host = time.time_ns(), HostClock()
        self._period_s = max(self._wanted_period_us, self.hello.cycle_us) * 1e-6
        self._clock = DeviceClock(self._period_s)
        self._run = 0  # the decoder's count of restarts at the last scan
        self._due: int | None = None  # the number after the last scan's
        self._held: _HeldScans | None = None
        self._troubles = Troubles(lambda text: self.on_message(text))
        self._odd = 0
        self._started_s = -_START_S
        self._flood_s, self._flood_scans, self._flooded = 0.0, 0, False
        self._slow_from: _WindowStart | None = None
        self._slow_windows = 0  # in a row
        self._last_us = 0  # the last scan's time by the device's clock
        self._overslept = False  # a scan began a period too late, since the device last said how many did
        self._own_s = 0.0  # when the device last identified itself
        self._asked_s = 0.0  # when it was last asked to, without a reason
        self._unconfirmed = 0  # scans handed on since

    @property
    def clock(self) -> str:
        """Whose clock the scans' times go by: "device", or "computer" where the device's is faulty."""
        return "computer" if self._clock.fault else "device"

    @property
    def device(self) -> str:
        """The unit's name."""
        return self.hello.unit_name

    @property
    def _wanted_period_us(self) -> int:
        """The period asked for, else the device's own [us]; 0: as fast as possible."""
        return self.hello.period_us if self._period_us is None else self._period_us

    @property
    def counts(self) -> Counts:
        """Frames that came, and that were lost or corrupt, since the source was made."""
        return Counts(*(a + b for a, b in zip(self._previous_counts, self._decoder.counts, strict=True)))

    def __iter__(self) -> Iterator[RawScan]:
        if self._assumed:
            unit = unit_of(self.sensor)
            self.on_message(
                f"no spec was given, and the device does not tell its lengths: {unit.pitch_mm:g} mm of pitch and "
                f"{unit.length_mm:g} mm of length are those of a shipped spec with as many strips. Millimetres and "
                "shapes are wrong if yours has others: name your spec with --sensor (in Python sensor=)"
            )
        self._check_calibration()
        while not self._closed:
            try:
                yield from self._scans()
            except PortError:
                raise
            except OSError as error:
                if not self._closed:
                    self.on_message(f"the device is gone ({error}); plug it in again and it goes on")
                    self._reconnect()
        self._troubles.check_counts(self.counts, self._host(), last=True)
        with suppress(OSError):  # if the device is gone, that stops it too
            self._write(Kind.STOP)
        self._port.close()

    def close(self) -> None:
        """End the stream: the thread that iterates stops the device and closes the port."""
        self._closed = True

    def _scans(self) -> Iterator[RawScan]:
        """Yield the scans of one connection, their times by the computer's clock."""
        self._clock.restart()
        self._troubles.reconnected()
        self._check_supply(self.hello, self._host())
        self._start()
        self._held = None
        self._hold_scans()  # the hello of the handshake may have waited on the line, of a unit that is gone
        self._run, self._due = self._decoder.counts.restarts, None
        prompt_s = min(max(_PROMPT_S[0], self._period_s / 5.0), _PROMPT_S[1])
        self._own_s, self._unconfirmed, self._overslept = self._host(), 0, False
        streaming, silence = False, _Silence(self._host(), self._decoder.counts.corrupt)
        line_was_empty = False  # since the last scans
        identified = False  # the device restarted, identified itself, and has sent no scan since
        gone: OSError | None = None
        while not self._closed and gone is None:
            began_s, data = self._host(), b""
            try:
                data = self._port.read(_READ_S)
            except OSError as error:
                gone = error  # scans that wait for a missing one come first
            self.arrived_s, now_s = time.perf_counter(), self._host()
            line_was_empty |= not data or now_s - began_s > prompt_s
            received = self._decoder.feed(data)
            self.waiting = sum(len(batch) for batch in received if isinstance(batch, ScanBatch))
            if self._held is not None:  # before they are handed on: may they be of two units?
                for message in received:
                    if isinstance(message, Hello):
                        self._check_identity(message, now_s)
            for message in received:
                self._troubles.check_message(message, now_s)
                if isinstance(message, Hello):
                    self._check_identity(message, now_s)
                    if not message.streaming:
                        identified = True
                        if streaming:
                            self._troubles.say("anew", "the device started anew; it is told to send", now_s)
                        if now_s - self._started_s >= _START_S:
                            self._start()
                    if self._held is not None:
                        held, self._held = self._held.scans, None
                        yield from self._release_scans(held)
                        silence.since_s = self._host()  # the consumer may have taken long
                if not isinstance(message, ScanBatch) or not self._matches(message, now_s):
                    continue
                streaming = True
                if silence.reported:
                    self.on_message("scans come again")
                self._check_rate(len(message), now_s)
                prompt = now_s - began_s > prompt_s
                self._check_slowness(message, now_s, line_was_empty)
                self._check_lateness(message, line_was_empty)
                for scans in self._timed(message, now_s, prompt, identified):
                    yield from self._release_scans(scans)
                if self._held is None:
                    self._confirm_identity(self._host())
                identified = line_was_empty = False
                silence = _Silence(self._host(), self._decoder.counts.corrupt)  # likewise
            self._troubles.check_counts(self.counts, now_s)
            if gone is not None:
                raise gone
            if now_s - began_s > _PROMPT_S[0]:  # the line was empty
                self._repeat_commands(now_s)
            if self._held is not None:
                self._ask_identity()
            self._check_silence(silence)

    def _check_silence(self, silence: _Silence) -> None:
        """Tell a device that has been silent for long to send, again and again."""
        patience_s = max(_SILENT_S, 4.0 * self._period_s)
        if self._host() - silence.since_s <= patience_s:
            return
        silence.since_s = self._host()
        self._start()
        self._hold_scans()  # the silence may have been a change of cables
        if not silence.reported:
            silence.reported = True
            n_corrupt = self._decoder.counts.corrupt - silence.corrupt
            broken = f"{n_corrupt} broken frames came: is the cable sound?"
            reason = broken if n_corrupt else "it is told to send again"
            self.on_message(f"no scan came for {patience_s:.2g} s; {reason}")

    def _timed(
        self, batch: ScanBatch, now_s: float, prompt: bool, identified: bool
    ) -> Iterator[list[RawScan]]:
        """Yield a batch's scans with their times by the computer's clock; hold back those that may be another device's.

        `identified`: since its last scan the device has restarted and identified itself. In parts: a part is handed on
        before the next one is held back.
        """
        scans = self._with_possible_spans(batch, now_s)
        trusted = not self._clock.fault
        if batch.restarts != self._run:
            self._run, self._due = batch.restarts, None
            if not identified:
                self._hold_scans()
            if self._clock.continues_run(scans[0], now_s):
                text = f"the scans' numbers leapt to {scans[0].sequence}, and their time went on"
                self._troubles.say("leap", text, now_s)
            else:
                self._restart_clock(identified, now_s)
        for rest in self._between_gaps(scans):
            prompt &= len(rest) == len(scans)
            while rest:
                n_same = self._clock.n_of_same_run(rest, now_s)
                prompt &= n_same == len(rest)
                if part := rest[:n_same]:
                    timed = zip(part, self._clock.times(part, now_s, prompt), strict=True)
                    yield [replace(raw, time_s=time_s, arrival_s=now_s) for raw, time_s in timed]
                if rest := rest[n_same:]:
                    self._hold_scans()
                    if not self._clock.fault:
                        self._restart_clock(False, now_s)
        if trusted and self._clock.fault:
            self.on_message(f"{self._clock.fault}; from now on times are the computer's")

    def _between_gaps(self, scans: list[RawScan]) -> Iterator[list[RawScan]]:
        """Yield scans in parts that follow each other; hold back those after a gap long enough to change the device."""
        start = 0
        for i, raw in enumerate(scans):
            if self._due is not None and _GAP <= (raw.sequence - self._due) % 2**32 < MAX_AHEAD:
                if i > start:
                    yield scans[start:i]
                start = i
                self._hold_scans()
            self._due = raw.sequence + 1
        yield scans[start:]

    def _with_possible_spans(self, batch: ScanBatch, now_s: float) -> list[RawScan]:
        """Return a batch's scans, without the strips' times where reading them took longer than to the next scan."""
        scans = list(batch.scans())
        too_long = batch.span_us > _LONG * 1e6 * self._period_s
        if self._period_s == 0.0 or not too_long.any():
            return scans
        span_s = 1e-6 * float(batch.span_us.max())
        text = (
            f"reading the strips took {span_s:.3g} s, scans say, and they come every {self._period_s:.3g} s"
        )
        self._troubles.say("span", f"{text}; the strips' times are left out", now_s)
        none = zip(scans, too_long.tolist(), strict=True)
        return [replace(raw, strip_time_s=None) if out else raw for raw, out in none]

    def _release_scans(self, scans: list[RawScan]) -> Iterator[RawScan]:
        """Yield scans, or hold them back until the device has identified itself."""
        if self._held is not None:
            self._held.scans += scans
            return
        self.waiting = max(self.waiting, len(scans))
        for raw in scans:
            self.waiting -= 1
            self._unconfirmed += 1
            yield raw

    def _restart_clock(self, identified: bool, now_s: float) -> None:
        self._clock.restart()
        if not identified:
            text = "the device started anew without a word, or is another one; it is asked who it is"
            self._troubles.say("unheard", text, now_s)

    def _hold_scans(self) -> None:
        """Hold scans back until the device has identified itself."""
        if self._held is None:
            self._held = _HeldScans(self._host())
            self._write(Kind.IDENTIFY)

    def _ask_identity(self) -> None:
        assert self._held is not None
        now_s = self._host()
        since_s = now_s - self._held.since_s
        if self._held.scans and since_s > self._handshake_s:
            raise PortError(
                f"the device began anew and has not said for {self._handshake_s:g} s who it is: "
                f"{len(self._held.scans)} scan(s) are left out, as they may be another unit's. Is its receiving line "
                "connected?"
            )
        if since_s > _ASK_S * self._held.asked:
            if self._held.scans:
                text = "the device does not say who it is; its scans wait until it does"
                self._troubles.say("mute", text, now_s)
            self._held.asked += 1
            self._write(Kind.IDENTIFY)

    def _confirm_identity(self, now_s: float) -> None:
        """Ask a device that sends who it is, now and then: nothing else shows a unit that goes on where one ended."""
        baud = self.hello.baud  # 0: USB
        every_s = max(_CONFIRM_S, _CONFIRM_BITS / baud) if baud else _CONFIRM_S
        if now_s - max(self._own_s, self._asked_s) > every_s:
            self._asked_s = now_s
            self._write(Kind.IDENTIFY)

    def _connect(self) -> Hello:
        self._port, self._decoder = self._open_port(), Decoder()
        try:
            hello = handshake(self._port, self._decoder, self._handshake_s, lambda: self._closed)
            if self._wanted is not None:
                check_device(hello, self._wanted)
                check_unit(hello, self.hello)
            return hello
        except BaseException:
            self._port.close()
            raise

    def _reconnect(self) -> None:
        self._previous_counts, self._decoder = self.counts, Decoder()
        self._port.close()
        while not self._closed:
            try:
                self.hello = self._connect()
            except WrongDeviceError:
                raise
            except OSError:
                time.sleep(_RETRY_S)
            else:
                self.on_message("the device is back")
                return

    def _start(self) -> None:
        self._started_s = self._host()
        if self._period_us is not None:
            self._write(Kind.RATE, self._period_us)
        self._write(Kind.START)

    def _write(self, kind: Kind, period_us: int | None = None) -> None:
        self._commands += 1
        command = Command(kind, self._commands, period_us)
        self._troubles.asked(command, self._host())
        self._port.write(command.encode())

    def _repeat_commands(self, now_s: float) -> None:
        """Ask once more for the rate where no reply has come."""
        for command in self._troubles.unanswered(now_s):
            if command.kind == Kind.RATE and command.sequence <= 2:
                self._write(Kind.RATE, command.period_us)

    def _check_identity(self, hello: Hello, now_s: float) -> None:
        """Refuse another unit; report a supply that cannot be, and scans that began late."""
        try:
            check_alone(hello, self.hello, now_s - self._own_s)
            check_unit(hello, self.hello)
        except WrongDeviceError as error:
            # Where none are held, and its number is the one that is due, it may have sent the last scans.
            follows = self._due is not None and (hello.number - self._due) % 2**32 < _GAP
            if self._held is not None or not follows:
                raise
            text = f"{error}. {self._unconfirmed} scan(s) may be of either: recordings leave them out"
            raise WrongDeviceError(text, self._unconfirmed) from None
        self._own_s, self._unconfirmed = now_s, 0
        self._check_supply(hello, now_s)
        if hello.streaming:
            self._troubles.check_late(hello.late, self._overslept, now_s)
            self._overslept = False

    def _check_calibration(self) -> None:
        """Report a calibration of which nobody can say whether it is this unit's; that of another is refused."""
        calibration = unit_of(self.sensor).calibration
        if calibration is not None and calibration.unit != self.hello.unit_name:
            self.on_message(
                f"the spec's calibration names no unit: whether it is that of {self.device!r} cannot be checked. "
                f'Write unit = "{self.device}" into its [calibration] if it is'
            )

    def _check_supply(self, hello: Hello, now_s: float) -> None:
        """Report a supply that cannot be the spec's Vref; 0 is one that was not measured."""
        vref_volt, supply_volt = unit_of(self.sensor).vref_volt, 1e-3 * hello.supply_mv
        if supply_volt and abs(supply_volt / vref_volt - 1.0) > _OTHER_SUPPLY:
            text = f"the device's supply is {supply_volt:.3g} V, and the spec says vref_volt = {vref_volt:g}"
            self._troubles.say("supply", f"{text}: all volts go by the spec; mend it, or the supply", now_s)

    def _check_rate(self, scans: int, now_s: float) -> None:
        """Report a device that sends more scans than it was asked for, for longer than what had waited takes."""
        self._flood_scans += scans
        passed_s = now_s - self._flood_s
        if passed_s >= _FLOOD_S:
            wanted = passed_s / self._period_s if self._period_us != 0 and self._period_s else float("inf")
            flooded = self._flood_scans > _FLOOD * wanted + _FLOOD_SCANS
            if flooded and self._flooded:
                sent, asked = self._flood_scans / passed_s, 1.0 / self._period_s
                rates = f"{figures(sent, 3)} scans a second, and {figures(asked, 3)}"
                self._troubles.say("flood", f"the device sends {rates} were asked for", now_s)
            self._flood_s, self._flood_scans, self._flooded = now_s, 0, flooded

    def _check_lateness(self, batch: ScanBatch, line_was_empty: bool) -> None:
        """Note scans that began a period too late though the reader was waiting, so that the device is asked."""
        if line_was_empty and self._wanted_period_us and self._due is not None:
            times_us = np.concatenate([[self._last_us], batch.time_us])
            numbers = np.concatenate([[self._due - 1], batch.sequence])
            late = np.diff(times_us) >= _LATE * 1e6 * self._period_s
            self._overslept |= bool((late & (np.diff(numbers) == 1)).any())
        self._last_us = int(batch.time_us[-1])

    def _check_slowness(self, batch: ScanBatch, now_s: float, line_was_empty: bool) -> None:
        """Report a device that scans more slowly than it was asked to, by its own clock and the computer's.

        `line_was_empty`: the reader was waiting for these scans. Else the device may have waited for the reader.
        """
        period_us = self._wanted_period_us
        newest = _WindowStart(int(batch.sequence[-1]), 1e-6 * int(batch.time_us[-1]), now_s, batch.restarts)
        start = self._slow_from
        if not line_was_empty or start is None or start.run != newest.run or self._clock.fault:
            self._slow_from, self._slow_windows = newest, 0
            return
        count = (newest.number - start.number) % 2**32
        passed_s = min(newest.device_s - start.device_s, newest.now_s - start.now_s)
        if passed_s < _FLOOD_S or count < _SLOW_SCANS:
            return
        slow = bool(period_us) and passed_s > _SLOW * 1e-6 * period_us * count
        self._slow_from, self._slow_windows = newest, self._slow_windows + 1 if slow else 0
        if self._slow_windows == 2:  # once, until it keeps the rate again
            rates = f"{figures(count / passed_s, 3)} scans a second, and {figures(1e6 / period_us, 3)}"
            self._troubles.say("slow", f"the device sends only {rates} were asked for", now_s)

    def _matches(self, batch: ScanBatch, now_s: float) -> bool:
        """Return whether scans are of the layout that the hello said; else have the device identify itself."""
        same = batch.touched.shape[1] == self.sensor.strips and batch.adc_bits == self.sensor.adc_bits
        if same and tuple(batch.codes) == self.names:
            self._odd = 0
            return True
        self._odd += len(batch)
        if self._odd >= _ODD_SCANS:
            raise WrongDeviceError(
                "the device sends other scans than its hello said; flash its firmware anew"
            )
        self._hold_scans()
        text = "scans of other strips, signatures or bits than the hello said came and are left out"
        self._troubles.say("layout", f"{text}; the device is asked who it is", now_s)
        return False
