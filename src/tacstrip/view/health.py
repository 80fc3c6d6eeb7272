"""The doctor beside a live stream: the last scans, examined now and then in a process of its own."""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import suppress
from multiprocessing import get_context
from typing import Any

from tacstrip.diagnose.log import Log
from tacstrip.errors import TacstripError
from tacstrip.sensor.spec import Sensor
from tacstrip.stream.live.frame import Frame
from tacstrip.stream.source import RawScan

_KEPT = 400  # scans
_APART_S = 0.02  # between two that are kept
_LEAST = 50  # scans without which nothing is examined


class Health:
    """Keeps scans and has them examined; results are the doctor's report as JSON.

    Attributes
    ----------
    report
        The last one; None before.
    trouble
        Why the last examination failed, in words; empty when it did not.
    """

    def __init__(self) -> None:
        self.report: dict[str, Any] | None = None
        self.trouble = ""
        self._kept: deque[RawScan] = deque(maxlen=_KEPT)
        self._sensor: Sensor | None = None
        self._last_s = -1.0
        self._lock = threading.Lock()
        self._pool: ProcessPoolExecutor | None = None
        self._running: Future[dict[str, Any]] | None = None

    def add(self, frame: Frame) -> None:
        """Keep a frame's scan, where the last kept one is old enough."""
        if self._sensor is None or frame.sensor.fingerprint != self._sensor.fingerprint:
            self._kept.clear()
            self.report, self._last_s = None, -1.0
        self._sensor = frame.sensor
        if not 0.0 <= frame.raw.time_s - self._last_s < _APART_S:
            self._last_s = frame.raw.time_s
            self._kept.append(frame.raw)

    @property
    def examining(self) -> bool:
        """Whether an examination is under way."""
        return self._running is not None and not self._running.done()

    def examine(self, done: Callable[[], None]) -> str:
        """Begin an examination; return why not, or an empty text. `done` is called, in any thread, at its end."""
        if self.examining:
            return "the examination is under way"
        scans, sensor = list(self._kept), self._sensor
        if sensor is None or len(scans) < _LEAST:
            return f"{len(scans)} scans are too few to examine; {_LEAST} are needed"
        if self._pool is None:
            self._pool = ProcessPoolExecutor(1, mp_context=get_context("spawn"), initializer=_gently)
        self._running = self._pool.submit(examined, sensor, scans)
        self._running.add_done_callback(lambda future: self._finish(future, done))
        return ""

    def close(self) -> None:
        """End the process."""
        if self._pool is not None:
            self._pool.shutdown(wait=False, cancel_futures=True)

    def _finish(self, future: Future[dict[str, Any]], done: Callable[[], None]) -> None:
        if future.cancelled():
            return
        error = future.exception()
        with self._lock:
            self.trouble = "" if error is None else str(error)
            if error is None:
                self.report = future.result()
        done()


def examined(sensor: Sensor, scans: list[RawScan]) -> dict[str, Any]:
    """Return the doctor's report on some scans, as JSON."""
    from tacstrip.diagnose.doctor import diagnose

    try:
        return diagnose(Log.of_codes(sensor, scans)).to_json()
    except TacstripError as error:
        raise RuntimeError(str(error)) from None  # errors with arguments of their own do not cross processes


def _gently() -> None:
    """Let the live stream go first."""
    with suppress(AttributeError, OSError):
        os.nice(10)
