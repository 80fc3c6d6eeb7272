"""`tacstrip live`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from tacstrip.cli import new_file
from tacstrip.contact.noise import Noise
from tacstrip.errors import OptionError, TacstripError
from tacstrip.sensor.spec import Sensor
from tacstrip.stream.interrupt import Interrupt
from tacstrip.stream.live import Live
from tacstrip.stream.port import BAUD, SerialPort
from tacstrip.stream.replay import open_source
from tacstrip.stream.serial_source import SerialSource
from tacstrip.stream.source import Source

_HTTP = 8360


@click.command()
@click.argument("files", metavar="[[SENSOR] INPUT]", nargs=-1)
@click.option("--port", help="Serial port of the device, such as /dev/ttyACM0.")
@click.option("--baud", type=int, default=BAUD, show_default=True, help="Speed of the line.")
@click.option("--simulate", is_flag=True, help="A virtual device, and a playground on the page.")
@click.option("--sensor", metavar="SENSOR", help="Spec of the device or of the playground.")
@click.option("--rate", type=float, help="Scans a second to ask for. Playground: 1000 by default.")
@click.option("--method", help="Recover shapes by this: polygon, vertex or profile.")
@click.option("--noise", type=float, help="Half-width of the readings' errors over Vref, where it is known.")
@click.option("--speed", type=float, default=1.0, show_default=True, help="INPUT: times its own pace.")
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Record to this file (.mcap).")
@click.option("--force", is_flag=True, help="Write over a file that is there.")
@click.option("--no-view", is_flag=True, help="No page.")
@click.option("--http", type=int, default=_HTTP, show_default=True, help="The page's port; 0: any.")
@click.option("--host", default="127.0.0.1", show_default=True,
              help="The page's address; 0.0.0.0 lets the local network in, with a token.")  # fmt: skip
@click.option("--json", "lines", is_flag=True, help="Objects as JSON lines on standard output.")
@click.option("--osc", metavar="HOST:PORT", help="Objects as TUIO 1.1 blobs (/tuio/2Dblb) over UDP.")
@click.option("--seconds", type=float, help="End after so long.")
@click.option("--device", is_flag=True, help="Be the virtual device on a new serial port, for another program.")
def command(files: tuple[str, ...], **given: Any) -> None:
    """Show shapes as they touch the sensor, on a page of this computer; record and pass them on.

    Scans come from a device (--port), from a virtual one (--simulate), or from INPUT, a recording (.mcap) or
    readings (.csv) of SENSOR. Ctrl-C ends; a recording is then complete. Exit code 1: the stream broke off.

    Example: tacstrip live --simulate
    """
    tell = _tell
    ways = bool(files) + bool(given["port"]) + given["simulate"] + given["device"]
    if ways != 1:
        raise OptionError("give one of: --port PORT, --simulate, --device, or a recording or readings file")
    raise SystemExit(_run(files, given, tell))


def _run(files: tuple[str, ...], given: dict[str, Any], tell: Any) -> int:
    from tacstrip.stream.warm import warm_up
    from tacstrip.view.access import Access
    from tacstrip.view.playground import Playground, Settings
    from tacstrip.view.server import Server
    from tacstrip.view.stage import Stage

    sensor = Sensor.load(given["sensor"]) if given["sensor"] else None
    playground = None
    if given["simulate"]:
        playground = Playground(
            Settings(sensor or Sensor(construction="crs-crs", strips=100, pitch_mm=1.0, length_mm=100.0, adc_bits=12),
                     given["rate"] or 1000.0)
        )
        source: Source = playground.source(tell)
    elif given["port"]:
        source = SerialSource(lambda: SerialPort(given["port"], given["baud"]), sensor, given["rate"], tell)
    else:
        source = open_source(files[-1], Sensor.load(files[0]) if len(files) == 2 else sensor)
    noise = None if given["noise"] is None else Noise(positional=given["noise"])
    tell("loading what recovers shapes")
    warm_up(source.sensor, given["method"])
    stage_box: list[Stage] = []
    live = Live(source, given["method"], noise, speed=given["speed"],
                then=lambda: stage_box[0].next_source() if stage_box else None, tell=tell)
    server = None
    stage = Stage(live, playground)
    stage_box.append(stage)
    if not given["no_view"]:
        server = Server(stage, Access(given["host"]), given["http"])
        for what, url in server.urls.items():
            tell(f"{url}  ({what})")
    with Interrupt() as stop, live:
        import time
        end = time.monotonic() + (given["seconds"] or float("inf"))
        while live.running and not stop() and time.monotonic() < end:
            time.sleep(0.1)
    if server:
        server.close()
    stage.health.close()
    return 1 if live.error else 0


def _tell(text: str) -> None:
    click.echo(text, err=True)
