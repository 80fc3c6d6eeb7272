"""The clocks of the computer and of a device: convert the device's times, and detect a faulty device clock."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Sequence

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.stream.source import RawScan

TOLERANCE = 0.02  # relative speed error; a ceramic resonator keeps 0.005
SLACK_S = 0.5  # largest delay by a busy computer or a USB adapter, beyond the constant part
# Arrivals within a window are represented by the one with the least delay; so many make a window.
_WINDOW_S, _MIN_ARRIVALS = 0.14, 3
_MAX_WINDOWS = 800
# Windows in a row that lie on a line, to within this part of its rise, show another speed: a delay would be a step.
_LINE_WINDOWS, _OFF_LINE = (4, 6, 8, 12, 16, 32, 64, 128, 256), 0.2
# Slack of a line's rise: so much, or so many windows' length, and so many times the median delay within the windows.
_LINE_SLACK_S, _DELAYS, _LENGTHS = 0.02, 3.0, 0.1
_LEAP_S = 0.1  # ahead of what the delay of the scan before explains, once the delay is known
_SAME_S, _SAME_SCANS = 0.1, 8  # by the period, and in number: scans of one time are of a clock that stands
_BURST_S = 0.1  # scans further apart that arrive together have been delayed
_MIN_STEP_S = 1e-6  # from scan to scan
_WRAP_S = 2**32 / 1e6  # after which the device's clock restarts from 0
_MIN_SLEEP_S = 1.0


class HostClock:
    """Seconds since it was made, including the computer's sleep where the system counts that."""

    def __init__(self) -> None:
        self._asleep_s = 0.0
        self._ahead_s = _ahead_s()
        self._start_s = time.monotonic()

    def __call__(self) -> float:
        """Return the time [s]; it never decreases."""
        ahead_s = _ahead_s()
        if ahead_s > self._ahead_s + _MIN_SLEEP_S:
            self._asleep_s += ahead_s - self._ahead_s
            self._ahead_s = ahead_s
        return time.monotonic() - self._start_s + self._asleep_s


def _ahead_s() -> float:
    """Return how far the clock that includes sleep is ahead of the one that does not [s]."""
    clock = getattr(time, "CLOCK_BOOTTIME", None)
    return 0.0 if clock is None else time.clock_gettime(clock) - time.monotonic()


class DeviceClock:
    """Converts a device's times to the computer's clock; the results never decrease.

    While the device's clock is sound its intervals are kept. It is faulty where it runs backwards, leaps from one
    scan to the next by more than the computer's time and the period explain, or differs in speed by more than
    `TOLERANCE`. From then on the computer's clock is used: scans end with their arrival, a period apart.

    Speed is judged by the least delayed of the scans that arrive while the reader waits for them, so that neither a
    busy computer nor a slow reader looks like a slow clock. Least delays that rise or fall on a line are another
    speed; a line that becomes slower makes a step.

    Parameters
    ----------
    period_s
        Time from scan to scan [s]; 0 where it is not known.

    Attributes
    ----------
    fault
        What is wrong with the device's clock; empty while it is trusted.
    last_s
        The latest converted time [s].
    """

    def __init__(self, period_s: float) -> None:
        self.fault = ""
        self.last_s = -1.0
        self._period_s = period_s
        self.restart()

    def restart(self) -> None:
        """Forget the device's clock, which has restarted; converted times continue."""
        self._offset_s: float | None = None
        self._number = 0  # of the last scan
        self._same = 0  # scans in a row of the same time
        self._device_s: float | None = None  # its time, unwrapped
        self._arrived_s = 0.0
        self._wrapped_s = 0.0
        self._ahead_s = 0.0  # of our clock, by the last scan
        self._window: list[tuple[float, float]] = []  # offset of our clock from the device's, and when
        # The same of the least delayed, and how much the median's was more.
        self._windows: deque[tuple[float, float, float]] = deque(maxlen=_MAX_WINDOWS)

    def continues_run(self, first: RawScan, now_s: float) -> bool:
        """Return whether a scan whose number is far off is of the same run, as after hours of sleep.

        Parameters
        ----------
        first
            The scan, its time by the device's 32-bit clock.
        now_s
            Its arrival [s].
        """
        ahead = (first.sequence - self._number) % 2**32
        if self._device_s is None or self.fault or ahead >= 2**31:
            return False
        passed_s = now_s - self._arrived_s
        over_s = first.time_s - self._device_s - passed_s
        wrapped_s = -round(over_s / _WRAP_S) * _WRAP_S
        if abs(over_s + wrapped_s) > TOLERANCE * passed_s + SLACK_S:
            return False
        self._wrapped_s, self._number = wrapped_s, first.sequence - 1
        return True

    def n_of_same_run(self, scans: Sequence[RawScan], now_s: float) -> int:
        """Return how many of the scans, in order, belong to the same run as those before; detect a faulty clock.

        Where scans are missing and the times fit neither the computer's clock nor their number, the device restarted
        unnoticed. Where none is missing, its clock is faulty, or it is another device: from that scan on they count
        with the next call.
        """
        if self.fault:
            return len(scans)
        number, device_s, period_s = self._number, self._device_s, self._period_s
        for i, raw in enumerate(scans):
            own_s = raw.time_s + self._wrapped_s
            if device_s is not None:
                passed_s, count = now_s - self._arrived_s, (raw.sequence - number) % 2**32
                if i == 0 and passed_s > _WRAP_S / 4.0:
                    wrap_s = round((device_s + passed_s - own_s) / _WRAP_S) * _WRAP_S
                    self._wrapped_s += wrap_s
                    own_s += wrap_s
                step_s = own_s - device_s
                # 1.1: a device that runs as fast as it can does not keep to its period.
                if not 0.0 <= step_s <= max(passed_s, 1.1 * count * period_s) + self._slack_s(count):
                    if count != 1:
                        return i
                    ran = "ran backwards" if step_s < 0.0 else f"leapt ahead by {step_s:.3g} s"
                    self.fault = f"the device's clock {ran}"
                    return i
                self._same = self._same + count if step_s == 0.0 else 0
                if self._same >= max(_SAME_SCANS, _SAME_S / max(self._period_s, 1e-9)):
                    self.fault = "the device's clock stands still"
                    return len(scans)
                period_s = max(self._period_s, step_s / max(count, 1))
            number, device_s = raw.sequence, own_s
        return len(scans)

    def times(self, scans: Sequence[RawScan], now_s: float, prompt: bool) -> list[float]:
        """Return the times of scans by the computer's clock [s] (scans,).

        Parameters
        ----------
        scans
            Scans that arrived together, their times by the device's clock.
        now_s
            Their arrival [s].
        prompt
            Whether the reader was waiting for them.
        """
        own = [raw.time_s + self._wrapped_s for raw in scans]
        if prompt and not self.fault and own[-1] - own[0] <= _BURST_S:
            self._compare(now_s - own[-1], now_s)
        if self.fault:
            step_s = max(0.0, min(self._period_s, (now_s - self.last_s) / len(scans)))
            times = [now_s - (len(scans) - 1 - i) * step_s for i in range(len(scans))]
        else:
            if self._offset_s is None:
                self._offset_s = max(now_s - own[-1], self.last_s + _MIN_STEP_S - own[0])
            times = [own_s + self._offset_s for own_s in own]
        for i, time_s in enumerate(times):
            times[i] = self.last_s = max(time_s, self.last_s + _MIN_STEP_S)
        self._number, self._device_s, self._arrived_s = scans[-1].sequence, own[-1], now_s
        self._ahead_s = now_s - own[-1]
        return times

    def _compare(self, ahead_s: float, now_s: float) -> None:
        """Compare the offset between the clocks with that of up to two minutes ago."""
        self._window.append((ahead_s, now_s))
        if len(self._window) < _MIN_ARRIVALS or now_s - self._window[0][1] < _WINDOW_S:
            return
        least_s, then_s = min(self._window)
        self._windows.append((least_s, then_s, sorted(self._window)[len(self._window) // 2][0] - least_s))
        self._window = []
        aheads, times, delays = np.array(self._windows).T  # (windows,) [s]
        speed = _line_speed(aheads, times, delays)
        change_s, passed_s = aheads[-1] - aheads[:-1], times[-1] - times[:-1]
        wrong = np.flatnonzero(np.abs(change_s) > TOLERANCE * passed_s + SLACK_S)
        if speed is None and len(wrong):
            speed = 1.0 - float(change_s[wrong[0]] / passed_s[wrong[0]])
        if speed is not None:
            still = abs(speed) < TOLERANCE
            runs = "stands still" if still else f"runs at {100.0 * speed:.3g} % of its speed"
            self.fault = f"the device's clock {runs}"

    def _slack_s(self, count: int) -> float:
        """Return how far a step may be ahead of the computer's time [s], `count` scans after the last."""
        if count != 1 or len(self._windows) < _LINE_WINDOWS[0]:
            return SLACK_S
        recent = list(self._windows)[-_LINE_WINDOWS[1] :]
        delay_s = self._ahead_s - min(least_s for least_s, _, _ in recent)
        return min(SLACK_S, _LEAP_S + max(0.0, delay_s))


def _line_speed(aheads: FloatArray, times: FloatArray, delays: FloatArray) -> float | None:
    """Return the speed of a device's clock where windows in a row show that it is wrong, else None."""
    delay_s = _DELAYS * float(delays.max())
    for count in _LINE_WINDOWS:
        if count > len(times):
            break
        y, x = aheads[-count:], times[-count:]
        span_s, mean_s = float(x[-1] - x[0]), x - x.sum() / count  # mean() takes four times as long
        slope = float(mean_s @ y / (mean_s @ mean_s))
        slack_s = delay_s + max(_LINE_SLACK_S, _LENGTHS * span_s / (count - 1))
        off_s = float(np.abs(y - y.sum() / count - slope * mean_s).max())
        if abs(slope) * span_s > TOLERANCE * span_s + slack_s and off_s < _OFF_LINE * abs(slope) * span_s:
            return 1.0 - slope
    return None
