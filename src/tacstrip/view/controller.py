"""What the page shows and controls: the stream, its recording, the simulator and the doctor."""

from __future__ import annotations

import json
import secrets
import time
from collections.abc import Mapping
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

from tacstrip.errors import OptionError
from tacstrip.reconstruction.methods import methods_of
from tacstrip.sensor.constructions import CONSTRUCTIONS
from tacstrip.sensor.layers import LayeredSensor
from tacstrip.stream.live.pipeline import Live
from tacstrip.stream.recording.recorder import Recorder
from tacstrip.stream.source import DeviceSource
from tacstrip.view.frame_json import frame_json, sensor_json
from tacstrip.view.health import Health
from tacstrip.view.simulator import Simulator

_VERSION = 1  # of the messages: docs/reference/protocol-page.md
_EXAMINE_S = 30.0  # between two examinations while a page is open
_LATENCY_QUANTILES = (0.5, 0.99)


class Controller:
    """Answers the page; the server calls its methods.

    Parameters
    ----------
    live
        The stream.
    executor
        Runs the doctor's examinations.
    simulator
        The simulated sensor, where there is one.
    folder
        Folder of the recordings that the page begins; None: the current one.
    """

    def __init__(
        self, live: Live, executor: Executor, simulator: Simulator | None = None, folder: Path | None = None
    ) -> None:
        self.live, self.simulator = live, simulator
        self.folder = folder or Path.cwd()
        self.health = Health(executor)
        self._queue = live.subscribe(detailed=True)
        self._examined_s = time.monotonic()
        self._session = secrets.token_hex(8)  # the messages' numbers begin anew with each
        self._recorder: Recorder | None = None  # of the recording that the page has begun

    def hello(self, control: bool) -> dict[str, Any]:
        """Return the first message to a new page."""
        return {
            "kind": "hello",
            "version": _VERSION,
            "control": control,
            "session": self._session,
            **self._about(),
        }

    def picture(self) -> str:
        """Return the newest frame as JSON; an empty text where there is none since the last call."""
        frame = self._queue.get()
        if frame is None:
            return ""
        self.health.add(frame)
        message = {"kind": "frame", **frame_json(frame)}
        if self.simulator is not None:
            message["truth"] = self.simulator.truth
        return json.dumps(message, allow_nan=False)

    def state(self) -> dict[str, Any]:
        """Return the state of the stream, as the page shows it."""
        live, source = self.live, self.live.source
        p50, p99 = live.meter.latency_s(*_LATENCY_QUANTILES)
        recorder = self._recorder if self._recorder in live.recordings else None
        return {
            "kind": "state",
            "running": live.running,
            "rate_hz": round(live.meter.rate_hz, 1),
            "latency_ms": [round(1e3 * p50, 2), round(1e3 * p99, 2)],
            "frames": live.frames,
            "late": live.late,
            "unreadable": live.unreadable,
            "wire": source.counts._asdict() if isinstance(source, DeviceSource) else {},
            "recording": None
            if recorder is None
            else {"path": str(recorder.path), "scans": recorder.scans, "bytes": recorder.size_bytes},
            "command_records": [str(one.path) for one in live.recordings if one is not recorder],
            "messages": list(live.messages),
            "problem": "" if self.simulator is None else self.simulator.problem,
            "health": self._health(),
            **self._about(),
        }

    def watched(self, anybody: bool) -> None:
        """Set whether a page is open: only then are covariances computed and scans examined."""
        self.live.want_detail(self, anybody)
        if not anybody:
            self._examined_s = time.monotonic()
        elif time.monotonic() - self._examined_s > _EXAMINE_S:
            self._examined_s = time.monotonic()
            self.health.examine()

    def do(self, wanted: Mapping[str, Any]) -> dict[str, Any] | None:
        """Carry out a request of a page; return the answer, if any.

        Raises
        ------
        TacstripError
            It cannot be carried out; the message says why.
        """
        match wanted:
            case {"do": "record"}:
                return self._record()
            case {"do": "stop recording"}:
                if self._recorder is not None:
                    self.live.stop_recording(self._recorder)
            case {"do": "examine"}:
                if reason := self.health.examine():
                    raise OptionError(reason)
            case {"do": "method", "method": method}:
                self.live.use(method)
            case {"do": "place", "objects": objects}:
                self._required_simulator().place(objects)
            case {"do": "set", "settings": settings}:
                if self._required_simulator().change(settings):
                    self.live.method = None  # the next sensor may not support it
                    self.live.source.close()  # the stream then asks for the next source
            case _:
                raise OptionError("unknown request")
        return None

    def _record(self) -> dict[str, Any]:
        if self._recorder in self.live.recordings:
            raise OptionError("the page is recording already")
        path = self.folder / time.strftime("tacstrip-%Y%m%d-%H%M%S.mcap")
        try:
            self._recorder = self.live.record(path)
        except OSError as error:
            raise OptionError(f"{path}: {error.strerror}; nothing is recorded") from None
        return {"kind": "notice", "text": f"recording to {path}"}

    def _required_simulator(self) -> Simulator:
        if self.simulator is None:
            raise OptionError("objects and settings can only be changed with `tacstrip live --simulate`")
        return self.simulator

    def _about(self) -> dict[str, Any]:
        about: dict[str, Any] = {"sensor": sensor_json(self.live.source.sensor)}
        about |= {
            "tracking": self.live.tracking,
            "method": self.live.method_name,
            "methods": list(methods_of(self.live.source.sensor)),
        }
        if self.simulator is not None:
            now = self.simulator.settings
            about["simulator"] = {"noise": now.noise.positional, "rate_hz": now.rate_hz}
            sensor = now.sensor
            if isinstance(sensor, LayeredSensor):
                offered = [sensor.construction]
            elif sensor.surface is None:
                offered = list(CONSTRUCTIONS)
            else:
                offered = [
                    n for n, kind in CONSTRUCTIONS.items() if kind.closed_form and not kind.cylindrical
                ]
            about["constructions"] = offered
        return about

    def _health(self) -> dict[str, Any]:
        state: dict[str, Any] = {"examining": self.health.examining, "problem": self.health.problem}
        if (report := self.health.report) is not None:
            state["strips"] = [s["condition"] for s in report["strips"]]
            state["faults"] = [s["faults"] for s in report["strips"]]
            state["findings"] = [f"{f['fault']}: {f['evidence']}" for f in report["findings"]][:5]
            state["sigma"] = report["noise"]["sigma"]
        return state
