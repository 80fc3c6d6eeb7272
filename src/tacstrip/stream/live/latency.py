"""How fast a stream is, and how late its results are."""

from __future__ import annotations

import time
from collections import deque

import numpy as np

_KEPT = 2048  # scans
_STALE_S = 1.0


class Meter:
    """Takes the time of every scan; may be asked from any thread."""

    def __init__(self) -> None:
        self._arrived: deque[float] = deque(maxlen=_KEPT)
        self._latency: deque[float] = deque(maxlen=_KEPT)

    def arrived(self, at_s: float) -> None:
        """Note when a scan came, by `time.perf_counter` [s]."""
        self._arrived.append(at_s)

    def done(self, latency_s: float) -> None:
        """Note how long its objects took [s]."""
        self._latency.append(latency_s)

    @property
    def rate_hz(self) -> float:
        """Scans a second, lately; 0 where none came for a second."""
        times = list(self._arrived)
        if len(times) < 2 or times[-1] <= times[0] or time.perf_counter() - times[-1] > _STALE_S:
            return 0.0
        return (len(times) - 1) / (times[-1] - times[0])

    def latency_s(self, *parts: float) -> list[float]:
        """Return quantiles of the latency of the last 2,048 scans [s]."""
        values = list(self._latency)
        return [float(q) for q in np.quantile(values, parts)] if values else [0.0] * len(parts)
