"""Time, and who it is: a device whose clock is wrong, that starts anew unheard, or that is another one by now.

Nothing here waits: the computer's clock, the device and the line between them run on one clock of the test's.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

import tacstrip as ts
from live_devices import SENSOR, still
from one_clock import Clock
from tacstrip.stream import RawScan
from tacstrip.stream.device.clocks import DeviceClock, HostClock
from tacstrip.stream.device.protocol.frames import Kind, check_frame, encode_frame, parse_frame
from tacstrip.stream.device.protocol.messages import Command, Hello
from tacstrip.stream.device.virtual import VirtualDevice
from tacstrip.stream.live.pipeline import Live

RATE_HZ = 50.0


class Unit(VirtualDevice):
    """A device with a name."""

    def __init__(self, clock: Clock, name: str = "left", rate_hz: float = RATE_HZ) -> None:
        made = ts.SimulatedSource(SENSOR, still, rate_hz, 1)
        (scan,) = made
        super().__init__(SENSOR, lambda: iter(lambda: scan, None), rate_hz, 0.002, clock)
        self.name = name

    @property
    def hello(self) -> Hello:
        return replace(super().hello, unit_name=self.name)


class Bench:
    """A line to a unit: so many bytes of room, so much later than due, with the times of scans changed.

    `stamp` makes a device's time [us] of the true one; `late_s` is how much later than due a reader wakes up.
    """

    def __init__(
        self,
        clock: Clock,
        unit: Unit,
        stamp: Callable[[int], int] = int,
        late_s: Callable[[], float] = lambda: 0.0,
    ) -> None:
        self.clock, self.unit, self.stamp, self.late_s = clock, unit, stamp, late_s
        self.waits, self.reads = b"", 0
        self.gone = self.deaf = False

    def read(self, wait_s: float) -> bytes:
        self.reads += 1
        assert self.reads < 50_000  # nothing comes of it
        if self.gone:
            raise OSError(5, "gone")
        self._arrive()
        if not self.waits:
            self.clock.now_s += max(1e-4, min(wait_s, self.unit.wait_s())) + self.late_s()
            self._arrive()
        data, self.waits = self.waits, b""
        return data

    def _arrive(self) -> None:
        for piece in self.unit.send().split(b"\0"):
            if piece and len(self.waits) < 4096:
                plain = check_frame(piece)
                assert plain is not None
                frame = parse_frame(plain)
                self.waits += encode_frame(frame.kind, frame.body, frame.sequence, self.stamp(frame.time_us))

    def write(self, data: bytes) -> None:
        if not self.deaf:
            self.waits += self.unit.receive(data)

    def close(self) -> None:
        """Nothing is open."""


class Run:
    """A source on a bench, what it told, and when its scans were given out."""

    def __init__(self, bench: Bench, rate_hz: float | None = None) -> None:
        self.bench, self.said = bench, list[str]()
        self.source = ts.SerialSource(lambda: bench, SENSOR, rate_hz, on_message=self.said.append)
        self.scans = iter(self.source)
        self.times: list[float] = []
        self.given: list[float] = []
        self.numbers: list[int] = []

    def take(self, count: int, pause_s: Callable[[], float] = lambda: 0.0) -> None:
        for raw in islice(self.scans, count):
            self.times.append(raw.time_s)
            self.given.append(self.bench.clock.now_s)
            self.numbers.append(raw.sequence)
            self.bench.clock.now_s += pause_s()

    @property
    def troubles(self) -> list[str]:
        """What was told, but scans that found no room on the line."""
        return [text for text in self.said if not text.endswith("missing by their numbers")]

    def check_times(self) -> None:
        assert (np.diff(self.times) > 0.0).all()

    @property
    def late(self) -> np.ndarray:
        """How much later than its time each scan was given out (scans,) [s]."""
        late: np.ndarray = np.array(self.given) - np.array(self.times)
        return late


def _speed(part: float) -> Callable[[int], int]:
    return lambda us: round(part * us)


def _pauses(rng: np.random.Generator) -> Callable[[], float]:
    """A computer that is busy: mostly quick, sometimes for long."""
    return lambda: float(rng.choice([0.0, 0.001, 0.05, 3.0], p=[0.6, 0.3, 0.0975, 0.0025]))


HEALTHY: dict[str, Callable[[np.random.Generator], tuple[Callable[[int], int], Callable[[], float]]]] = {
    "exact": lambda rng: (int, lambda: 0.0),
    "USB": lambda rng: (int, lambda: rng.uniform(0.0, 0.016)),
    "slow adapter": lambda rng: (int, lambda: rng.uniform(0.0, 0.255)),
    "busy": lambda rng: (int, _pauses(rng)),
    "resonator + 1.5 %": lambda rng: (_speed(1.015), lambda: rng.uniform(0.0, 0.016)),
    "resonator - 1.5 %": lambda rng: (_speed(0.985), lambda: rng.uniform(0.0, 0.016)),
    "begins anew": lambda rng: (lambda us: us + 2**32 - 10_000_000, lambda: 0.0),
    "busy with a resonator": lambda rng: (_speed(1.01), _pauses(rng)),
}


@pytest.mark.parametrize("kind", HEALTHY)
def test_a_sound_clock_is_believed(clock: Clock, kind: str) -> None:
    """Nothing is told, and the device's own intervals are kept to the microsecond."""
    stamp, late_s = HEALTHY[kind](np.random.default_rng(1))
    run = Run(Bench(clock, Unit(clock), stamp, late_s))
    run.take(1000)
    assert run.troubles == []
    run.check_times()
    period_us = stamp(10**9 + 10**6) - stamp(10**9)
    steps = np.diff(run.times) / np.diff(run.numbers)
    np.testing.assert_allclose(steps[steps < 0.03], period_us / 1e6 / RATE_HZ, atol=3e-6)
    assert run.source.counts.restarts == 0


@pytest.mark.parametrize("kind", HEALTHY)
@pytest.mark.parametrize("rate_hz", [2.0, 400.0])
def test_a_sound_clock_is_believed_for_long(kind: str, rate_hz: float) -> None:
    """Up to a quarter of an hour each, in the clock alone; whatever came while the reader was away comes at once."""
    for seed in range(1 if kind in ("exact", "begins anew") else 2):  # where nothing is left to chance, once
        rng = np.random.default_rng(seed)
        stamp, late_s = HEALTHY[kind](rng)
        clock, now_s, number, last_s = DeviceClock(1.0 / rate_hz), 0.0, 0, -1.0
        while number < 2000:
            prompt = now_s < number / rate_hz
            now_s = max(now_s, number / rate_hz) + late_s()
            batch = range(number, max(number, int(now_s * rate_hz)) + 1)
            scans = [_raw(n, stamp(round(n * 1e6 / rate_hz)) / 1e6) for n in batch]
            number = batch.stop
            assert clock.n_of_same_run(scans, now_s) == len(scans)
            times = clock.times(scans, now_s, prompt)
            assert clock.fault == ""
            assert times[0] > last_s
            last_s = times[-1]


def _raw(number: int, time_s: float) -> RawScan:
    return RawScan(time_s, {}, np.zeros(0, dtype=bool), number)


@pytest.mark.parametrize(("rate_hz", "pause_s"), [(1.0, 2.0), (20.0, 0.08), (400.0, 0.004), (400.0, 2.0)])
def test_a_slow_taker_is_no_slow_clock(clock: Clock, rate_hz: float, pause_s: float) -> None:
    run = Run(Bench(clock, Unit(clock, rate_hz=rate_hz)))
    run.take(500, lambda: pause_s)
    assert run.troubles == []
    run.check_times()


def _random(rng: np.random.Generator) -> Callable[[int], int]:
    return lambda us: int(rng.integers(0, 2**32))


WRONG: dict[str, tuple[Callable[[int], int], str, float]] = {
    "half": (_speed(0.5), r"runs at (50|49)(\.\d)? % of its speed", 1.1),
    "double": (_speed(2.0), r"runs at (19|20)\d % of its speed", 1.1),
    "3 % slow": (_speed(0.97), r"runs at (97|96\.9|97\.1) % of its speed", 15.0),
    "5 % fast": (_speed(1.05), r"runs at (105|104) % of its speed", 5.0),
    "stands": (lambda us: 777, "stands still", 1.1),
    "backwards": (lambda us: 2**31 - us, "ran backwards", 0.1),
    "random": (_random(np.random.default_rng(3)), "(ran backwards|leapt ahead by)", 0.1),
    "leaps": (lambda us: us + 60_000_000 * (us > 2_000_000), "leapt ahead by 60 s", 2.5),
    "leaps back": (lambda us: us - 1_900_000 * (us > 2_000_000), "ran backwards", 2.5),
}


@pytest.mark.parametrize("kind", WRONG)
@pytest.mark.parametrize("late_s", [0.0, 0.016])
def test_a_wrong_clock_is_told_once_and_the_computers_taken(clock: Clock, kind: str, late_s: float) -> None:
    stamp, what, within_s = WRONG[kind]
    rng = np.random.default_rng(5)
    run = Run(Bench(clock, Unit(clock, rate_hz=20.0), stamp, lambda: rng.uniform(0.0, late_s)))
    began_s = clock.now_s
    while not run.said:
        run.take(1)
        assert clock.now_s - began_s < within_s
    run.take(300)
    (text,) = run.said
    assert re.fullmatch(rf"the device's clock {what}.*; from now on times are the computer's", text)
    run.check_times()
    settled = run.late[-150:]  # once the computer's clock has caught up with what one too fast had said
    assert settled.min() > -1e-5  # no time lies ahead
    assert settled.max() < 0.02
    np.testing.assert_allclose(np.diff(run.times[-150:]).mean(), 1.0 / 20.0, rtol=0.01)


def test_a_day_of_rounds_with_scans_lost_at_every_one(clock: Clock) -> None:
    """A scan a minute, and none for half an hour or three hours about each of the 20 times that 32 bits begin anew."""
    bench = Bench(clock, unit := Unit(clock))
    run = Run(bench, rate_hz=1.0 / 60.0)
    run.take(5)
    began_s, first_s = run.given[-1], run.times[-1]
    for gap_s in (1800.0, 10_800.0) * 10:
        clock.now_s += gap_s  # nobody reads; the line has no room
        unit.send()
        bench.waits = b""
        run.take(3)
        assert run.times[-1] - first_s == pytest.approx(clock.now_s - began_s, abs=1.0)
    run.check_times()
    assert run.troubles == []


def test_hours_of_sleep_are_no_restart(clock: Clock) -> None:
    bench = Bench(clock, unit := Unit(clock))
    run = Run(bench)
    run.take(100)
    clock.now_s += 3600.0
    unit.send()
    unit._number += 3600 * int(RATE_HZ)
    bench.waits = b""
    run.take(100)
    assert run.said == ["the scans' numbers leapt to 180356, and their time went on"]
    assert run.times[-1] - run.times[0] == pytest.approx(3600.0 + 199 / RATE_HZ, abs=0.1)


def test_the_computers_clock_counts_its_sleep(monkeypatch: pytest.MonkeyPatch) -> None:
    awake, asleep = [5.0], [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: awake[0])
    monkeypatch.setattr(time, "CLOCK_BOOTTIME", 7, raising=False)
    monkeypatch.setattr(time, "clock_gettime", lambda which: awake[0] + asleep[0])
    clock = HostClock()
    awake[0] += 2.0
    assert clock() == pytest.approx(2.0)
    asleep[0] += 3600.0
    awake[0] += 0.5
    assert clock() == pytest.approx(3602.5)
    asleep[0] -= 1.0  # a switch between the two looks
    assert clock() == pytest.approx(3602.5)


@pytest.mark.parametrize("before", [3, 186, 900])
def test_a_restart_without_a_word_is_told_and_loses_no_scan(clock: Clock, before: int) -> None:
    bench = Bench(clock, Unit(clock))
    run = Run(bench)
    run.take(before)
    bench.unit = Unit(clock)
    clock.now_s += 0.3
    bench.unit.receive(Command(Kind.START).encode())  # its hello is lost
    began_s = clock.now_s
    while not run.said:
        run.take(1)
    assert clock.now_s - began_s < 1.0
    run.take(400)
    assert run.said == ["the device started anew without a word, or is another one; it is asked who it is"]
    at = run.numbers.index(0, 1)
    assert run.numbers[at:] == list(range(len(run.numbers) - at))
    run.check_times()
    assert run.late[at + 10 :].max() < 0.05
    assert run.source.counts.restarts == 1
    assert run.source.counts.lost == run.source.counts.out_of_order == 0


def test_a_restart_whose_numbers_lie_ahead_shows_in_its_time(clock: Clock) -> None:
    bench = Bench(clock, Unit(clock))
    run = Run(bench)
    run.take(500)
    bench.unit = Unit(clock)
    bench.unit.receive(Command(Kind.START).encode())
    bench.unit._number = 700
    run.take(100)
    assert run.troubles == [
        "the device started anew without a word, or is another one; it is asked who it is"
    ]
    assert run.numbers[-1] > 700
    run.check_times()
    assert run.late[-50:].max() < 0.05


def _switch_with_a_hello(bench: Bench, other: Unit) -> None:
    bench.unit, bench.waits = other, other.hello.encode()


def _switch_unheard(bench: Bench, other: Unit) -> None:
    bench.unit = other
    other.receive(Command(Kind.START).encode())


def _switch_ahead(bench: Bench, other: Unit) -> None:
    ahead = bench.unit._number + 30
    _switch_unheard(bench, other)
    other._number = ahead


def _switch_in_silence(bench: Bench, other: Unit) -> None:
    """Its numbers and its time go on where the first one's ended."""
    other._number, other._boot_s = bench.unit._number, bench.unit._boot_s
    bench.unit = other


def _switch_the_plug(bench: Bench, other: Unit) -> None:
    bench.gone, bench.unit = True, other


SWITCHES = [_switch_with_a_hello, _switch_unheard, _switch_ahead, _switch_in_silence, _switch_the_plug]


class Plugs:
    """Opens the bench, which comes back where it was gone."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench

    def __call__(self) -> Bench:
        self.bench.gone = False
        return self.bench


@pytest.mark.parametrize(
    ("switch", "before"), [*((switch, 1100) for switch in SWITCHES), (_switch_unheard, 30)]
)
def test_another_unit_ends_the_stream_before_its_first_scan(
    clock: Clock, switch: Callable[[Bench, Unit], None], before: int
) -> None:
    bench = Bench(clock, Unit(clock))
    source = ts.SerialSource(Plugs(bench), SENSOR)
    scans = iter(source)
    assert len(list(islice(scans, before))) == before
    switch(bench, Unit(clock, "right"))
    began_s = clock.now_s
    left: list[RawScan] = []
    with pytest.raises(ts.PortError, match=r"unit_name = 'right', and the stream began with 'left'"):
        left.extend(islice(scans, 100))
    assert left == []
    assert clock.now_s - began_s < 2.0


@pytest.mark.parametrize("switch", SWITCHES)
def test_the_same_unit_again_goes_on(clock: Clock, switch: Callable[[Bench, Unit], None]) -> None:
    bench = Bench(clock, Unit(clock))
    source = ts.SerialSource(Plugs(bench), SENSOR)
    scans = iter(source)
    times = [raw.time_s for raw in islice(scans, 100)]
    switch(bench, Unit(clock))
    times += [raw.time_s for raw in islice(scans, 100)]
    assert (np.diff(times) > 0.0).all()
    assert clock.now_s - times[-1] < 0.1


def test_a_unit_that_does_not_say_who_it_is_is_not_believed(clock: Clock) -> None:
    bench = Bench(clock, Unit(clock))
    run = Run(bench)
    run.take(50)
    _switch_unheard(bench, Unit(clock))
    bench.deaf = True
    with pytest.raises(ts.PortError, match=r"has not said for 5 s who it is: \d+ scan\(s\) are left out"):
        run.take(1)


def test_a_recording_ends_with_its_unit(clock: Clock, tmp_path: Path) -> None:
    bench = Bench(clock, Unit(clock))
    stream = Live(_Switching(bench))
    stream.record(tmp_path / "a.mcap")
    with pytest.raises(ts.PortError, match="another device is on the port"):
        list(stream)
    assert [raw.sequence for raw in ts.Recording(tmp_path / "a.mcap")] == list(range(60))


class _Switching(ts.SerialSource):
    """Has its unit changed after 60 scans."""

    def __init__(self, bench: Bench) -> None:
        super().__init__(lambda: bench, SENSOR)
        self.bench = bench

    def __iter__(self) -> Iterator[RawScan]:
        for number, raw in enumerate(super().__iter__(), start=1):
            yield raw
            if number == 60:
                _switch_unheard(self.bench, Unit(self.bench.clock, "right"))
