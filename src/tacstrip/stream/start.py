"""`ts.live`: a running stream in one call."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from tacstrip.arguments import takes
from tacstrip.contact.noise import Noise
from tacstrip.errors import OptionError
from tacstrip.sensor.spec import Sensor
from tacstrip.stream.live import Live
from tacstrip.stream.port import BAUD, SerialPort
from tacstrip.stream.serial_source import SerialSource
from tacstrip.stream.source import Source
from tacstrip.stream.warm import warm_up


@takes(sensor=Sensor, noise=Noise)
def live(
    port: str | None = None,
    *,
    source: Source | None = None,
    sensor: Sensor | None = None,
    baud: int = BAUD,
    rate_hz: float | None = None,
    method: str | None = None,
    noise: Noise | None = None,
    speed: float = 1.0,
    record: str | Path | None = None,
    tell: Callable[[str], None] = lambda text: None,
) -> Live:
    """Return a stream to iterate: `for frame in ts.live("/dev/ttyACM0"): ...` gives the newest frames.

    Parameters
    ----------
    port, baud, rate_hz
        A device's serial port, the speed of its line, and the scans a second to ask it for.
    source
        Or any source of scans: a `Recording`, a `SimulatedSource`, your own.
    sensor
        The device's spec; None: the shipped one of its construction and strips.
    method, noise
        "polygon", "vertex" or "profile", by default the best; and the readings' noise where it is known.
    speed
        Of a source that is no device: times its own pace.
    record
        Write all scans, none left out, to this new file (.mcap).
    tell
        Called, from any thread, with what a user should know.

    Raises
    ------
    PortError
        The port, or what is on it, cannot be used; while it is iterated: another device was plugged in. Whatever else
        the source raises, iterating raises too, after the last frame; a recording is then closed whole.
    OptionError
        Not exactly one of `port` and `source`.
    RecordingError, OSError
        The recording cannot be made.
    """
    if (port is None) == (source is None):
        raise OptionError("give either a port or a source")
    if port is not None:
        name = port
        source = SerialSource(lambda: SerialPort(name, baud), sensor, rate_hz, tell)
    assert source is not None
    try:
        warm_up(source.sensor, method)
        stream = Live(source, method, noise, speed=speed, tell=tell)
        if record is not None:
            stream.record(record)
    except BaseException:
        source.close()
        raise
    return stream
