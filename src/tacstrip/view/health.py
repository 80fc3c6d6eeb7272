"""The doctor of a live stream: the latest scans, examined in the background."""

from __future__ import annotations

from collections import deque
from concurrent.futures import Executor, Future
from contextlib import AbstractContextManager
from typing import Any

from tacstrip.diagnose.log import Log
from tacstrip.errors import TacstripError
from tacstrip.interrupt import worker_processes
from tacstrip.sensor.layers import AnySensor, LayeredSensor
from tacstrip.sensor.spec import Sensor
from tacstrip.stream.live.frame import Frame
from tacstrip.stream.source import RawScan

_KEPT = 400  # scans
_SAMPLE_S = 0.02  # between two scans that are kept
_MIN_SCANS = 50  # for an examination


class Health:
    """Keeps the latest scans and examines them.

    Parameters
    ----------
    executor
        Runs the examinations.

    Attributes
    ----------
    report
        The doctor's latest report as JSON; None before the first.
    problem
        Why the latest examination failed; empty where it did not.
    """

    def __init__(self, executor: Executor) -> None:
        self._executor = executor
        self.report: dict[str, Any] | None = None
        self.problem = ""
        self._kept: deque[RawScan] = deque(maxlen=_KEPT)
        self._sensor: AnySensor | None = None
        self._last_s = -1.0
        self._running: Future[dict[str, Any]] | None = None

    def add(self, frame: Frame) -> None:
        """Keep a frame's scan, unless the last kept one is too recent."""
        if self._sensor is None or frame.sensor.fingerprint != self._sensor.fingerprint:
            self._kept.clear()
            self.report, self._last_s = None, -1.0
        self._sensor = frame.sensor
        if not 0.0 <= frame.raw.time_s - self._last_s < _SAMPLE_S:
            self._last_s = frame.raw.time_s
            self._kept.append(frame.raw)

    @property
    def examining(self) -> bool:
        """Whether an examination is in progress."""
        return self._running is not None and not self._running.done()

    def examine(self) -> str:
        """Begin an examination; return the reason where that is not possible, else an empty text."""
        if self.examining:
            return "the examination is under way"
        scans, sensor = list(self._kept), self._sensor
        if isinstance(sensor, LayeredSensor):
            return "the doctor examines sensors of one layer, and this one has two"
        if sensor is None or len(scans) < _MIN_SCANS:
            return f"{len(scans)} scans are too few to examine; {_MIN_SCANS} are needed"
        self._running = self._executor.submit(examined, sensor, scans)
        self._running.add_done_callback(self._finish)
        return ""

    def _finish(self, future: Future[dict[str, Any]]) -> None:
        if future.cancelled():
            return
        error = future.exception()
        self.problem = "" if error is None else str(error)
        if error is None:
            self.report = future.result()


def background_process() -> AbstractContextManager[Executor]:
    """Return an executor for `Health`: one process of low priority, started with the first examination."""
    return worker_processes(1, 10, "spawn")


def examined(sensor: Sensor, scans: list[RawScan]) -> dict[str, Any]:
    """Return the doctor's report on scans as JSON."""
    from tacstrip.diagnose.doctor import diagnose

    try:
        return diagnose(Log.of_codes(sensor, scans)).to_json()
    except TacstripError as error:
        raise RuntimeError(str(error)) from None  # ours cannot be passed between processes
