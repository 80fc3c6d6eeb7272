"""`tacstrip live`."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import click

from tacstrip.cli import check_method, load_sensor, new_file, warn, warn_untouched
from tacstrip.contact.noise import Noise
from tacstrip.errors import OptionError, PortError
from tacstrip.io.suspicions import half_read
from tacstrip.sensor.spec import Sensor
from tacstrip.stream.interrupt import Interrupt
from tacstrip.stream.live import Live
from tacstrip.stream.port import BAUD, SerialPort
from tacstrip.stream.pty_device import PtyDevice
from tacstrip.stream.replay import ReadingsSource, open_source
from tacstrip.stream.serial_source import SerialSource
from tacstrip.stream.sinks import Sink, json_sink, tuio_sink
from tacstrip.stream.source import Source
from tacstrip.stream.warm import warm_up
from tacstrip.view.access import Access, check_port
from tacstrip.view.playground import Playground, Settings
from tacstrip.view.server import Server
from tacstrip.view.stage import Stage

_HTTP = 8360
_NAP_S = 0.1
_OWN = Sensor(
    construction="crs-crs", strips=50, pitch_mm=2.0, length_mm=100.0, adc_bits=12
)  # the playground's
_RATE_HZ = 1000.0


@click.command()
@click.argument("files", metavar="[[SENSOR] INPUT]", nargs=-1)
@click.option("--port", help="Serial port of the device, such as /dev/ttyACM0.")
@click.option("--baud", type=int, default=BAUD, show_default=True, help="Speed of the line.")
@click.option("--simulate", is_flag=True, help="A virtual device, and a playground on the page.")
@click.option("--device", is_flag=True, help="Be a virtual device on a serial port, for another program.")
@click.option("--sensor", metavar="SENSOR", help="Spec of the device, the playground or the recording.")
@click.option("--rate", type=float, help="Scans a second to ask the device for; the playground's are 1000.")
@click.option("--method", help="Recover shapes by this: polygon, vertex or profile.")
@click.option("--noise", type=float, help="Half-width of the readings' errors over Vref, where it is known.")
@click.option("--no-drift", is_flag=True, help="Do not follow drift, as a calibrated sensor's otherwise is.")
@click.option("--speed", type=float, default=1.0, show_default=True, help="INPUT: times its own pace.")
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Record to this file (.mcap).")
@click.option("--force", is_flag=True, help="Write over a file that is there.")
@click.option("--no-view", is_flag=True, help="No page.")
@click.option("--http", type=int, default=_HTTP, show_default=True, help="The page's port; 0: any.")
@click.option("--host", default="127.0.0.1", show_default=True,
              help="Where the page listens; 0.0.0.0 lets the local network in, with a token.")  # fmt: skip
@click.option("--json", "lines", is_flag=True, help="Objects as JSON lines on standard output.")
@click.option("--osc", metavar="HOST:PORT", help="Objects as TUIO 1.1 blobs over UDP.")
@click.option("--seconds", type=float, default=math.inf, help="End after so long.")
def command(files: tuple[str, ...], **given: Any) -> None:
    """Show shapes as they touch the sensor, on a page of this computer; record them and pass them on.

    Scans come from a device (--port), a virtual one (--simulate), or INPUT: a recording (.mcap), or readings (.csv)
    of SENSOR. Ctrl-C ends it, and a recording is then complete. Exit code 1: the stream or the recording broke off.

    Example: tacstrip live --simulate
    """
    ways = (bool(files), bool(given["port"]), given["simulate"], given["device"])
    if sum(ways) != 1:
        raise OptionError("give one of --port PORT, --simulate, --device, or a recording or readings file")
    if len(files) > 2:
        raise OptionError(f"{files[2]}: one INPUT only, with its SENSOR before it")
    for name in ("rate", "speed", "seconds"):
        if given[name] is not None and not given[name] > 0.0:
            raise OptionError(f"--{name} {given[name]}: must be above 0")
    check_port(given["http"], "--http")
    if given["output"] is not None:
        if given["output"].suffix.lower() != ".mcap":
            raise OptionError(f"-o {given['output']}: a recording is a file that ends in .mcap")
        new_file(given["output"], given["force"], *files)
    spec = files[0] if len(files) == 2 else given["sensor"]
    sensor = load_sensor(spec) if spec else None
    with Interrupt() as stop:
        asked = _Asked(given, stop)
        if given["device"]:
            _be_device(Playground(Settings(sensor or _OWN, given["rate"] or _RATE_HZ)), asked)
            return
        try:
            bad = _stream(files, sensor, asked)
        except PortError as error:
            click.echo(f"Error: {error}", err=True)
            bad = True
    sys.exit(1 if bad else 0)


@dataclass
class _Asked:
    """The options, and when to end."""

    given: dict[str, Any]
    stop: Callable[[], bool]
    _end_s: float = field(init=False)

    def __post_init__(self) -> None:
        self._end_s = time.monotonic() + self.given["seconds"]

    def going(self) -> bool:
        """Wait a little; tell whether to go on."""
        time.sleep(_NAP_S)
        return not self.stop() and time.monotonic() < self._end_s


def _tell(text: str) -> None:
    click.echo(text, err=True)


def _be_device(playground: Playground, asked: _Asked) -> None:
    with PtyDevice(playground.virtual_device()) as served:
        _tell(
            f"a virtual {playground.settings.sensor.construction} device is on {served.path}; Ctrl-C pulls it out"
        )
        while asked.going():
            pass


def _stream(files: tuple[str, ...], sensor: Sensor | None, asked: _Asked) -> bool:
    """Run the stream to its end; return whether it, or its recording, broke off."""
    given = asked.given
    playground = (
        Playground(Settings(sensor or _OWN, given["rate"] or _RATE_HZ)) if given["simulate"] else None
    )
    source: Source
    if playground is not None:
        source = playground.source(_tell)
    elif given["port"]:
        source = SerialSource(lambda: SerialPort(given["port"], given["baud"]), sensor, given["rate"], _tell)
    else:
        source = open_source(files[-1], sensor)
    check_method("--method", given["method"], source.sensor, source.names)
    if isinstance(source, ReadingsSource):
        warn(half_read(files[-1], source.sensor, source.names))
    if files:
        warn_untouched(files[-1], source)
    warm_up(source.sensor, given["method"])
    noise = None if given["noise"] is None else Noise(positional=given["noise"])
    live = Live(
        source, given["method"], noise, not given["no_drift"], given["speed"], _next(playground), tell=_tell
    )
    with ExitStack() as stack:
        # What may not be had comes first: no file is begun for nothing.
        sinks = list(_sinks(live, given))
        for sink in sinks:
            stack.callback(sink.close)
        if not given["no_view"]:
            stack.enter_context(_page(live, playground, given))
        if given["output"] is not None:
            live.record(given["output"], force=given["force"])
        with live:
            while live.running and asked.going() and not (sinks and all(sink.ended for sink in sinks)):
                pass
    # A reader of the lines that goes ends them as it likes.
    cut = any(sink.error and not isinstance(sink.error, BrokenPipeError) for sink in sinks)
    return cut or live.recording_failed or live.error is not None


def _next(playground: Playground | None) -> Callable[[], Source | None]:
    """Return what gives the source after one that ended: a playground's, whose settings were changed."""
    return (lambda: None) if playground is None else lambda: playground.source(_tell)


def _sinks(live: Live, given: dict[str, Any]) -> Iterator[Sink]:
    if given["lines"]:
        yield json_sink(live, sys.stdout)
    if given["osc"]:
        yield tuio_sink(live, given["osc"])


@contextmanager
def _page(live: Live, playground: Playground | None, given: dict[str, Any]) -> Iterator[None]:
    stage = Stage(live, playground)
    server = Server(stage, Access(given["host"]), given["http"])
    urls = server.urls
    _tell(f"see it on {urls.pop('control')}")
    for url in urls.values():
        _tell(f"to look only: {url}")
    try:
        yield
    finally:
        server.close()
        stage.close()
