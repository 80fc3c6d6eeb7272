"""`ts.live`: start a live stream in one call."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from tacstrip.arguments import takes
from tacstrip.contact.noise import Noise
from tacstrip.errors import OptionError
from tacstrip.sensor.layers import AnySensor, LayeredSensor
from tacstrip.sensor.spec import Sensor
from tacstrip.stream.device.port import BAUD, SerialPort
from tacstrip.stream.device.source import SerialSource
from tacstrip.stream.live.frame import Frame
from tacstrip.stream.live.pipeline import Live
from tacstrip.stream.live.sinks import Sink
from tacstrip.stream.live.warmup import warm_up
from tacstrip.stream.source import Source


@takes(sensor=Sensor | LayeredSensor, noise=Noise)
def live(
    port: str | None = None,
    *,
    source: Source | None = None,
    sensor: AnySensor | None = None,
    baud: int = BAUD,
    rate_hz: float | None = None,
    method: str | None = None,
    noise: Noise | None = None,
    speed: float = 1.0,
    record: str | Path | None = None,
    on_message: Callable[[str], None] | None = None,
    tracks: bool = True,
    on_frame: Callable[[Frame], object] | None = None,
) -> Live:
    """Return a live stream; iterating it, by `for` or `async for`, gives the newest frames.

    Nothing that is done with a frame holds the stream up: who is slow gets fewer of them.

    Parameters
    ----------
    port, baud, rate_hz
        Serial port of a device, speed of its line [baud], and the scan rate to request [Hz]; None: the device's own.
    source
        Any other source of scans: a `Recording`, a `SimulatedSource`, your own.
    sensor
        Spec of the device, of one layer or two; None: the shipped spec of its construction and number of strips.
    method
        "polygon", "vertex" or "profile"; None: the best for the sensor.
    noise
        Noise of the readings, where it is known.
    speed
        Playback speed of a source that is not a device, relative to its own times.
    record
        New file (.mcap) that all scans are recorded to.
    on_message
        Called, from any thread, with messages for the user; None: the logger "tacstrip".
    tracks
        Whether to fuse the scans of each object into one rigid outline, `Frame.tracks`.
    on_frame
        Called with the newest frames, in a thread of its own; an exception that it raises ends the calls with a
        message, not the stream.

    Returns
    -------
    Live
        Iterate it, or use it in `with`; with `on_frame`, `wait` for its end. Opening a port takes up to 5 s: in a
        program of asyncio write `await asyncio.to_thread(ts.live, port)`.

    Raises
    ------
    OptionError
        Not exactly one of `port` and `source` is given.
    PortError
        The port or the device on it cannot be used; while iterating: another device was plugged in. Any other
        exception of the source is raised while iterating too, after the last frame; a recording is then complete.
    RecordingError, OSError
        The recording cannot be made.

    Examples
    --------
    >>> import math
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0)
    >>> contact = ts.Contact.polygon([(22, 38), (62, 22), (80, 55), (45, 76)])
    >>> source = ts.SimulatedSource(sensor, lambda time_s: contact, rate_hz=200.0, scans=20)
    >>> for frame in ts.live(source=source, speed=math.inf):
    ...     ids = [one.id for one in frame.objects]
    >>> ids
    [1]

    In asyncio, and by a callback:

    >>> import asyncio
    >>> def again():
    ...     return ts.SimulatedSource(sensor, lambda time_s: contact, rate_hz=200.0, scans=20)
    >>> async def last_number():
    ...     async for frame in ts.live(source=again(), speed=math.inf):
    ...         number = frame.number
    ...     return number
    >>> asyncio.run(last_number())
    19
    >>> numbers = []
    >>> with ts.live(source=again(), speed=math.inf, on_frame=lambda frame: numbers.append(frame.number)) as stream:
    ...     ended = stream.wait()
    >>> ended, numbers[-1]
    (True, 19)
    """
    if (port is None) == (source is None):
        raise OptionError("give either a port or a source")
    if port is not None:
        name = port
        source = SerialSource(lambda: SerialPort(name, baud), sensor, rate_hz)
    assert source is not None
    try:
        warm_up(source.sensor, method)
        stream = Live(source, method, noise, speed=speed, on_message=on_message, tracks=tracks)
        if on_frame is not None:
            call = on_frame
            stream.at_end(Sink(stream, lambda frame, _: call(frame), 1, "the callback").close)
        if record is not None:
            stream.record(record)
    except BaseException:
        source.close()
        raise
    return stream
