"""Where frames go apart from the page: each sink in a thread of its own, which nothing else waits for."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from typing import IO, Any

import numpy as np

from tacstrip.errors import in_words
from tacstrip.stream.frame import Frame
from tacstrip.stream.live import Live
from tacstrip.stream.osc import Tuio

LINES_WAITING = 1000  # frames that wait for whoever reads the lines; then the oldest go
_TUIO_HZ = 100.0


class Sink:
    """Takes the frames of a stream, the oldest of which go when it is slow.

    Parameters
    ----------
    live
        The stream.
    take
        Called with every frame that is not dropped, and with how many were; what it raises ends the sink.
    waiting
        How many frames may wait.
    name
        In words, for messages.
    release
        Called when it has ended.

    Attributes
    ----------
    error
        What ended it before the stream did; None where nothing did.
    """

    def __init__(
        self,
        live: Live,
        take: Callable[[Frame, int], None],
        waiting: int,
        name: str,
        release: Callable[[], None] = lambda: None,
    ) -> None:
        self._live, self._take, self._name, self._release = live, take, name, release
        self.error: Exception | None = None
        self._box = live.outlet(waiting)
        self._thread = threading.Thread(target=self._run, name=f"tacstrip {name}", daemon=True)
        self._thread.start()

    @property
    def dropped(self) -> int:
        """Frames that went because it was slow."""
        return self._box.dropped

    @property
    def ended(self) -> bool:
        """Whether it takes no more."""
        return not self._thread.is_alive()

    def close(self) -> None:
        """Let it take what waits, and end."""
        self._box.close()
        self._thread.join(timeout=2.0)  # a reader that hangs holds nobody up

    def _run(self) -> None:
        try:
            self._pass()
        finally:
            self._release()

    def _pass(self) -> None:
        while not self._box.closed or len(self._box):
            if (frame := self._box.get(0.1)) is None:
                continue
            try:
                self._take(frame, self._box.dropped)
            except Exception as error:
                self.error = error
                self._box.close()
                self._live.tell(f"{self._name} ended: {in_words(error)}")
                return


def json_sink(live: Live, file: IO[str]) -> Sink:
    """Write a line of JSON for every frame: its objects [mm], and how many frames were dropped before."""

    def write(frame: Frame, dropped: int) -> None:
        file.write(json.dumps(line(frame, dropped), allow_nan=False) + "\n")
        file.flush()

    return Sink(live, write, LINES_WAITING, "the output of JSON lines")


def tuio_sink(live: Live, target: str) -> Sink:
    """Send the newest frame as TUIO blobs, 100 times a second at most."""
    tuio = Tuio(target)
    pause = threading.Event()

    def send(frame: Frame, dropped: int) -> None:
        tuio.send(frame)
        pause.wait(1.0 / _TUIO_HZ)

    return Sink(live, send, 1, "TUIO", tuio.close)


def line(frame: Frame, dropped: int) -> dict[str, Any]:
    """Return what a line of JSON says of a frame."""
    return {
        "scan": frame.number,
        "sequence": frame.raw.sequence,
        "time_s": round(frame.raw.time_s, 6),
        "latency_ms": round(1e3 * frame.latency_s, 3),
        "dropped": dropped,
        "objects": [
            {
                "id": one.id,
                "status": one.shape.status,
                "vertices_mm": np.round(one.shape.vertices, 4).tolist(),
                "advice": one.shape.advice,
            }
            for one in frame.objects
        ],
    }
