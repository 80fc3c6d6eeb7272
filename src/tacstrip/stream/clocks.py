"""The computer's clock and the device's: how far the device's is believed, and what stands in where it is not."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Sequence

from tacstrip.stream.source import RawScan

TOLERANCE = 0.02  # of a clock's speed; a ceramic resonator keeps 0.005
SLACK_S = 0.5  # what a busy computer or a USB adapter may add to a scan's way, beyond what it always takes
_WINDOW_S, _LEAST = (
    0.5,
    5,
)  # of arrivals that are compared as one, the quickest standing for all; so many at least
_WINDOWS = 240
_TOGETHER_S = 0.1  # scans further apart that come at once have waited somewhere
_STEP_S = 1e-6  # from scan to scan at least
_ROUND_S = 2**32 / 1e6  # the device's clock begins anew
_ASLEEP_S = 1.0


class HostClock:
    """Seconds since it was made, those included in which the computer slept where the system counts them."""

    def __init__(self) -> None:
        self._asleep_s = 0.0
        self._ahead_s = _ahead_s()
        self._start_s = time.monotonic()

    def __call__(self) -> float:
        """Return the time [s]; it never runs backwards."""
        ahead_s = _ahead_s()
        if ahead_s > self._ahead_s + _ASLEEP_S:
            self._asleep_s += ahead_s - self._ahead_s
            self._ahead_s = ahead_s
        return time.monotonic() - self._start_s + self._asleep_s


def _ahead_s() -> float:
    """Return how far the clock that runs while the computer sleeps is ahead of the one that does not [s]."""
    clock = getattr(time, "CLOCK_BOOTTIME", None)
    return 0.0 if clock is None else time.clock_gettime(clock) - time.monotonic()


class DeviceClock:
    """Turns a device's times into the computer's; they never run backwards.

    While the device's clock is sound its own intervals are kept. It is not where it runs backwards, leaps from one
    scan to the next by more than the computer's time and the period explain, or differs in speed by more than
    `TOLERANCE`. Then the computer's clock is taken for good: scans end with their arrival, a period apart.

    Speed is judged by the quickest of the scans that arrive while the reader waits for them, so that neither a busy
    computer nor a slow reader is taken for a slow clock.

    Parameters
    ----------
    period_s
        From scan to scan [s], as far as it is known; else 0.

    Attributes
    ----------
    fault
        What is wrong with the device's clock, in words; empty while it is believed.
    last_s
        The last time that was given [s].
    """

    def __init__(self, period_s: float) -> None:
        self.fault = ""
        self.last_s = -1.0
        self._period_s = period_s
        self.restart()

    def restart(self) -> None:
        """Begin anew with a device that did; times go on."""
        self._offset_s: float | None = None
        self._number = 0  # of the last scan
        self._device_s: float | None = None  # its time, rounds and all
        self._arrived_s = 0.0
        self._rounds_s = 0.0
        self._window: list[tuple[float, float]] = []  # how far our clock is ahead of the device's, and when
        self._windows: deque[tuple[float, float]] = deque(maxlen=_WINDOWS)

    def goes_on(self, first: RawScan, now_s: float) -> bool:
        """Tell whether a scan whose number lies far off is of the same run, as after hours of sleep.

        Parameters
        ----------
        first
            The scan, its time by the device's clock of 32 bits.
        now_s
            When it came.
        """
        ahead = (first.sequence - self._number) % 2**32
        if self._device_s is None or self.fault or ahead >= 2**31:
            return False
        passed_s = now_s - self._arrived_s
        over_s = first.time_s - self._device_s - passed_s
        rounds_s = -round(over_s / _ROUND_S) * _ROUND_S
        if abs(over_s + rounds_s) > TOLERANCE * passed_s + SLACK_S:
            return False
        self._rounds_s, self._number = rounds_s, first.sequence - 1
        return True

    def of_this_run(self, scans: Sequence[RawScan], now_s: float) -> int:
        """Return how many of the scans, in order, can be of the run of those before; a fault of the clock is noted.

        Where scans are missing and time fits neither the computer's nor their number, the device began anew unseen.
        Where none is missing, it is its clock.
        """
        if self.fault:
            return len(scans)
        number, device_s, period_s = self._number, self._device_s, self._period_s
        for i, raw in enumerate(scans):
            own_s = raw.time_s + self._rounds_s
            if device_s is not None:
                passed_s, many = now_s - self._arrived_s, (raw.sequence - number) % 2**32
                if passed_s > _ROUND_S / 4.0:
                    turn_s = round((device_s + passed_s - own_s) / _ROUND_S) * _ROUND_S
                    self._rounds_s += turn_s
                    own_s += turn_s
                step_s = own_s - device_s
                # A tenth: a device that is as fast as it goes does not keep to its period.
                if not 0.0 <= step_s <= max(passed_s, 1.1 * many * period_s) + SLACK_S:
                    if many != 1:
                        return i
                    ran = "ran backwards" if step_s < 0.0 else f"leapt ahead by {step_s:.3g} s"
                    self.fault = f"the device's clock {ran}"
                    return len(scans)
                period_s = max(self._period_s, step_s / many)
            number, device_s = raw.sequence, own_s
        return len(scans)

    def times(self, scans: Sequence[RawScan], now_s: float, prompt: bool) -> list[float]:
        """Return when scans were read, by the computer's clock [s] (scans,).

        Parameters
        ----------
        scans
            Scans that came together, their times by the device's clock.
        now_s
            When they came.
        prompt
            Whether the reader had been waiting for them.
        """
        own = [raw.time_s + self._rounds_s for raw in scans]
        if prompt and not self.fault and own[-1] - own[0] <= _TOGETHER_S:
            self._compare(now_s - own[-1], now_s)
        if self.fault:
            step_s = max(0.0, min(self._period_s, (now_s - self.last_s) / len(scans)))
            times = [now_s - (len(scans) - 1 - i) * step_s for i in range(len(scans))]
        else:
            if self._offset_s is None:
                self._offset_s = max(now_s - own[-1], self.last_s + _STEP_S - own[0])
            times = [own_s + self._offset_s for own_s in own]
        for i, time_s in enumerate(times):
            times[i] = self.last_s = max(time_s, self.last_s + _STEP_S)
        self._number, self._device_s, self._arrived_s = scans[-1].sequence, own[-1], now_s
        return times

    def _compare(self, ahead_s: float, now_s: float) -> None:
        """Hold how far our clock is ahead of the device's against what it was up to two minutes ago."""
        self._window.append((ahead_s, now_s))
        if len(self._window) < _LEAST or now_s - self._window[0][1] < _WINDOW_S:
            return
        newest = min(self._window)
        self._window = []
        for ahead_s, then_s in self._windows:
            change_s, passed_s = newest[0] - ahead_s, newest[1] - then_s
            if abs(change_s) > TOLERANCE * passed_s + SLACK_S:
                speed = 1.0 - change_s / passed_s
                runs = (
                    "stands still"
                    if abs(speed) < TOLERANCE
                    else f"runs at {100.0 * speed:.3g} % of its speed"
                )
                self.fault = f"the device's clock {runs}"
                return
        self._windows.append(newest)
