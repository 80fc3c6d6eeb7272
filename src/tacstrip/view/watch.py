"""The doctor beside a live stream: faulty channels are left out while they are faulty, and back when they heal."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import replace
from typing import Any

from tacstrip.diagnose.faults import FAULTS
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.stream.live.frame import Frame
from tacstrip.stream.live.pipeline import Live
from tacstrip.stream.live.sinks import Sink
from tacstrip.view.health import Health

EVERY_S = 5.0  # between two examinations
_ILL, _WELL = 2, 3  # successive examinations that leave a channel out, and that take it back
_MOST = 1.0 / 3.0  # of the strips: more is no fault of channels


class Verdicts:
    """Which channels are faulty, with a hysteresis against verdicts that come and go.

    Attributes
    ----------
    left_out
        Fault by channel, such as "7:v_h", or "7" for a strip.
    """

    def __init__(self) -> None:
        self.left_out: dict[str, str] = {}
        self._ill: Counter[str] = Counter()
        self._well: Counter[str] = Counter()

    def update(self, report: Mapping[str, Any]) -> list[str]:
        """Take another report of the doctor, as JSON; return what changed, a line each."""
        faults = {name: finding["fault"] for finding in report["findings"] for name in _channels(finding)}
        if len({name.partition(":")[0] for name in faults}) > _MOST * len(report["strips"]):
            return []
        looked_at = {str(row["strip"]) for row in report["strips"] if row["touched_scans"]}
        said = []
        for name in {*faults, *self.left_out, *self._ill}:
            if name in faults:
                self._ill[name] += 1
                self._well[name] = 0
            elif name.partition(":")[0] in looked_at:
                self._well[name] += 1
                self._ill[name] = 0
            if name not in self.left_out and self._ill[name] >= _ILL:
                self.left_out[name] = faults[name]
                said.append(
                    f"channel {name} is left out: {FAULTS[faults[name]].title}; it comes back when it heals"
                )
            elif name in self.left_out and self._well[name] >= _WELL:
                del self.left_out[name]
                said.append(f"channel {name} reads well again and is used")
        return sorted(said)


def _channels(finding: Mapping[str, Any]) -> list[str]:
    """Return the channels that a finding, as JSON, condemns."""
    if finding["severity"] != "broken":
        return []
    strips = [str(strip) for strip in finding["strips"]]
    signature = finding["signature"]
    return strips if signature is None else [f"{s}:{SIGNATURES[signature].volt_column}" for s in strips]


def watch(live: Live, executor: Executor, every_s: float = EVERY_S) -> Sink:
    """Examine the latest scans of a stream again and again, in `executor`, and leave faulty channels out of it."""
    watched = _Watch(live, executor, every_s)
    return Sink(live, watched.take, 1, "the doctor of the stream", watched.end)


class _Watch:
    def __init__(self, live: Live, executor: Executor, every_s: float) -> None:
        self._live, self._every_s = live, every_s
        self._health, self._verdicts = Health(executor), Verdicts()
        self._sensor, self._report = live.source.sensor, self._health.report
        self._since, self._heard = time.monotonic(), False

    def take(self, frame: Frame, _: int) -> None:
        """Keep a frame's scan; begin an examination when one is due, and heed the last one."""
        sensor = self._live.source.sensor
        if sensor is not self._sensor:  # the stream went on to another one
            self._sensor, self._verdicts = sensor, Verdicts()
        if not sensor.kind.closed_form:
            return
        health = self._health
        health.add(replace(frame, sensor=replace(frame.sensor, without=sensor.without)))
        if health.report is not None and health.report is not self._report:
            self._heard = True
            for text in self._verdicts.update(health.report):
                self._live.notify(text)
            self._live.leave_out(tuple(self._verdicts.left_out))
        self._report = health.report
        if time.monotonic() - self._since >= self._every_s and not health.examining:
            self._since = time.monotonic()
            health.examine()

    def end(self) -> None:
        """Say at the end that there was no verdict, where there was none: silence would read as "no fault"."""
        if not self._live.source.sensor.kind.closed_form:
            self._live.notify(
                "the doctor leaves no channel out of a CRS-CRP stream: its strips are solved together"
            )
        elif not self._heard:
            why = f": {self._health.problem}" if self._health.problem else ""
            self._live.notify(
                f"the doctor had no verdict before the stream ended{why}. It looks at 50 scans or more every "
                f"{EVERY_S:g} s; examine a recording with `tacstrip doctor FILE`"
            )
