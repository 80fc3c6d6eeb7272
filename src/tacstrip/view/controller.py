"""What the page shows and may do: the stream, the playground if there is one, the doctor, the recording."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tacstrip.errors import OptionError
from tacstrip.reconstruction.methods import METHODS, chosen_method
from tacstrip.sensor.constructions import CONSTRUCTIONS
from tacstrip.stream.live.pipeline import Live
from tacstrip.view.drawing import frame_json, sensor_json
from tacstrip.view.health import Health
from tacstrip.view.simulator import Playground

_EXAMINE_S = 30.0  # between two examinations while somebody watches
_LATENCY = (0.5, 0.99)


class Stage:
    """Everything behind the page; its methods are called by the server.

    Parameters
    ----------
    live
        The stream; its pictures are drawn from here.
    playground
        Where the sensor is simulated.
    folder
        Where recordings go that the page begins.
    """

    def __init__(self, live: Live, playground: Playground | None = None, folder: Path | None = None) -> None:
        self.live, self.playground = live, playground
        self.folder = folder or Path.cwd()
        self.health = Health()
        self._box = live.outlet(detailed=True)
        self._examined_s = time.monotonic()

    def hello(self, control: bool) -> dict[str, Any]:
        """Return what a new page must know."""
        return {"kind": "hello", "control": control, **self._about()}

    def picture(self) -> str:
        """Return the newest frame as JSON, or an empty text where there is none since the last call."""
        frame = self._box.get()
        if frame is None:
            return ""
        self.health.add(frame)
        told = {"kind": "frame", **frame_json(frame)}
        if self.playground is not None:
            told["truth"] = self.playground.objects
        return json.dumps(told, allow_nan=False)

    def state(self) -> dict[str, Any]:
        """Return the numbers beside the picture."""
        live, source = self.live, self.live.source
        p50, p99 = live.meter.latency_s(*_LATENCY)
        writer = live.recording
        counts = getattr(source, "counts", None)
        return {
            "kind": "state",
            "running": live.running,
            "rate_hz": round(live.meter.rate_hz, 1),
            "latency_ms": [round(1e3 * p50, 2), round(1e3 * p99, 2)],
            "frames": live.frames,
            "late": live.late,
            "unreadable": live.unreadable,
            "wire": {} if counts is None else {k: v for k, v in counts._asdict().items() if k != "frames"},
            "recording": None
            if writer is None
            else {"path": str(writer.path), "scans": writer.scans, "bytes": writer.size_bytes},
            "messages": list(live.messages)[-4:],
            "trouble": "" if self.playground is None else self.playground.trouble,
            "health": self._health(),
            **self._about(),
        }

    def watched(self, anybody: bool) -> None:
        """Say whether a page is open: only then are covariances worked out, and the doctor called."""
        self.live.detail = anybody
        if not anybody:
            self._examined_s = time.monotonic()
        elif time.monotonic() - self._examined_s > _EXAMINE_S:
            self._examined_s = time.monotonic()
            self.health.examine(lambda: None)

    def do(self, wanted: Mapping[str, Any]) -> dict[str, Any] | None:
        """Do what a page asks for; return what to answer.

        Raises
        ------
        TacstripError
            It cannot be done; the message says why.
        """
        match wanted:
            case {"do": "record"}:
                return self._record()
            case {"do": "stop recording"}:
                self.live.stop_recording()
            case {"do": "examine"}:
                if why := self.health.examine(lambda: None):
                    raise OptionError(why)
            case {"do": "method", "method": method}:
                chosen_method(method, self.live.source.sensor)
                self.live.use(method)
            case {"do": "place", "objects": objects}:
                self._needed().place(objects)
            case {"do": "set", "settings": settings}:
                if self._needed().change(settings):
                    self.live.method = None  # the next sensor may not allow it
                    self.live.source.close()  # then the stream asks for the next one
            case _:
                raise OptionError("there is no such thing to do")
        return None

    def close(self) -> None:
        """Let go of the doctor."""
        self.health.close()

    def _record(self) -> dict[str, Any]:
        path = self.folder / time.strftime("tacstrip-%Y%m%d-%H%M%S.mcap")
        try:
            self.live.record(path)
        except OSError as error:
            raise OptionError(f"{path}: {error.strerror}; nothing is recorded") from None
        return {"kind": "told", "text": f"recording to {path}"}

    def _needed(self) -> Playground:
        if self.playground is None:
            raise OptionError("this sensor is real: objects and settings are for `tacstrip live --simulate`")
        return self.playground

    def _about(self) -> dict[str, Any]:
        about: dict[str, Any] = {
            "sensor": sensor_json(self.live.source.sensor),
            "method": self.live.method_name,
        }
        if self.playground is not None:
            now = self.playground.settings
            about["playground"] = {"noise": now.noise.positional, "rate_hz": now.rate_hz}
            about["constructions"] = list(CONSTRUCTIONS)
        about["methods"] = list(METHODS)
        return about

    def _health(self) -> dict[str, Any]:
        report = self.health.report
        told: dict[str, Any] = {"examining": self.health.examining, "trouble": self.health.trouble}
        if report is not None:
            told["strips"] = [s["condition"] for s in report["strips"]]
            told["faults"] = [s["faults"] for s in report["strips"]]
            told["findings"] = [f"{f['fault']}: {f['evidence']}" for f in report["findings"]][:5]
            told["sigma"] = report["noise"]["sigma"]
        return told
