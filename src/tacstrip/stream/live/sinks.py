"""Consumers of a live stream other than the page: JSON lines, TUIO, Foxglove and ROS 2, each in a thread of its own."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from typing import IO, Any

from tacstrip.arrays import plain
from tacstrip.errors import in_words
from tacstrip.stream.bridges.foxglove.bridge import Foxglove
from tacstrip.stream.bridges.ros2 import Ros2
from tacstrip.stream.bridges.tuio import Tuio
from tacstrip.stream.export import tracks_fields
from tacstrip.stream.live.frame import Frame
from tacstrip.stream.live.pipeline import Live

_QUEUE_LINES = 1000  # frames that wait for the reader of the lines, or for ROS 2; then the oldest is dropped
_TUIO_HZ = 100.0


class Sink:
    """Passes the frames of a stream to a function, in a thread of its own; drops the oldest while it is slow.

    Parameters
    ----------
    live
        The stream.
    take
        Called with each frame and the number of frames dropped so far; an exception ends the sink.
    waiting
        Largest number of frames that wait.
    name
        Its name in messages.
    release
        Called when the sink has ended.

    Attributes
    ----------
    error
        The exception that ended it before the stream did; None where there was none.
    """

    def __init__(
        self,
        live: Live,
        take: Callable[[Frame, int], object],
        waiting: int,
        name: str,
        release: Callable[[], None] = lambda: None,
    ) -> None:
        self._live, self._take, self._name, self._release = live, take, name, release
        self.error: Exception | None = None
        self._queue = live.subscribe(waiting)
        self._thread = threading.Thread(target=self._run, name=f"tacstrip {name}", daemon=True)
        self._thread.start()

    @property
    def ended(self) -> bool:
        """Whether it takes no more frames."""
        return not self._thread.is_alive()

    def close(self) -> None:
        """Pass on the frames that wait, and end."""
        self._queue.close()
        if threading.current_thread() is not self._thread:
            self._thread.join(timeout=2.0)  # a reader that hangs must not block the end of the stream

    def _run(self) -> None:
        try:
            for frame in self._queue:
                self._take(frame, self._queue.dropped)
        except Exception as error:
            self.error = error
            self._queue.close()
            self._live.notify(f"{self._name} ended: {in_words(error)}")
        finally:
            self._release()


def json_sink(live: Live, file: IO[str]) -> Sink:
    """Write a line of JSON per frame: its objects [mm], and the number of frames dropped before it."""

    def write(frame: Frame, dropped: int) -> None:
        file.write(json.dumps(_fields(frame, dropped), allow_nan=False) + "\n")
        file.flush()

    return Sink(live, write, _QUEUE_LINES, "the output of JSON lines")


def tuio_sink(live: Live, target: str) -> Sink:
    """Send the newest frame as TUIO blobs to HOST:PORT, at most 100 times a second."""
    tuio = Tuio(target)
    pause = threading.Event()

    def send(frame: Frame, dropped: int) -> None:
        tuio.send(frame)
        pause.wait(1.0 / _TUIO_HZ)

    return Sink(live, send, 1, "TUIO", tuio.close)


def ros2_sink(live: Live, **options: Any) -> Sink:
    """Publish every frame as topics of ROS 2; options and errors as of `Ros2`."""
    ros2 = Ros2(live, **options)
    return Sink(live, ros2.send, _QUEUE_LINES, "ROS 2", ros2.close)


def foxglove_sink(live: Live, host: str, port: int) -> tuple[Sink, int]:
    """Send all frames to the viewers of a server on host and port (0: any free one); return its port, too."""
    bridge = Foxglove(live, host, port)
    return Sink(
        live, lambda frame, _: bridge.send(frame), _QUEUE_LINES, "Foxglove", bridge.close
    ), bridge.server.port


def _fields(frame: Frame, dropped: int) -> dict[str, Any]:
    """Return the fields of a frame's line of JSON."""
    return {
        "scan": frame.number,
        "sequence": frame.raw.sequence,
        "time_s": round(frame.raw.time_s, 6),
        "time_ns": frame.time_ns,
        "clock": frame.clock,
        "frame_id": frame.frame_id,
        "unit": frame.unit,
        "latency_ms": round(1e3 * frame.latency_s, 3),
        "dropped": dropped,
        "status": frame.status,
        "objects": [
            {
                "id": o.id,
                "status": o.shape.status,
                "vertices_mm": plain(o.shape.vertices, 4),
                "centroid_mm": plain(o.shape.centroid, 4) if len(o.shape.vertices) > 2 else None,
                "area_mm2": round(o.shape.area, 3) if len(o.shape.vertices) > 2 else None,
                "advice": o.shape.advice,
            }
            for o in frame.objects
        ],
    } | tracks_fields(frame.tracks, frame.searching)
