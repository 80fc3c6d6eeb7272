"""The rate of a live stream and the latency of its results."""

from __future__ import annotations

import time
from collections import deque

import numpy as np

_WINDOW = 2048  # scans
_STALE_S = 1.0


class LatencyMeter:
    """Collects arrival times and latencies of scans; may be read from any thread."""

    def __init__(self) -> None:
        self._arrivals: deque[float] = deque(maxlen=_WINDOW)
        self._latencies: deque[float] = deque(maxlen=_WINDOW)

    def arrived(self, at_s: float) -> None:
        """Add the arrival of a scan, by `time.perf_counter` [s]."""
        self._arrivals.append(at_s)

    def done(self, latency_s: float) -> None:
        """Add the time from a scan's arrival to its objects [s]."""
        self._latencies.append(latency_s)

    @property
    def rate_hz(self) -> float:
        """Mean rate of the last 2,048 scans [Hz]; 0 where none came for a second."""
        times = list(self._arrivals)
        if len(times) < 2 or times[-1] <= times[0] or time.perf_counter() - times[-1] > _STALE_S:
            return 0.0
        return (len(times) - 1) / (times[-1] - times[0])

    def latency_s(self, *quantiles: float) -> list[float]:
        """Return quantiles, 0 to 1, of the latencies of the last 2,048 scans [s]."""
        values = list(self._latencies) or [0.0]
        return [float(q) for q in np.quantile(values, quantiles)]
