"""`tacstrip live`."""

from __future__ import annotations

import contextlib
import logging
import math
import socket
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import click

from tacstrip.cli import check_method, load_layers, note, options, protect, warn_of_input
from tacstrip.cli.replay import warn_of_cut
from tacstrip.contact.noise import Noise
from tacstrip.errors import OptionError, PortError, figures
from tacstrip.files import write_text
from tacstrip.interrupt import deferred_interrupt, worker_processes
from tacstrip.reconstruction.methods import chosen_method
from tacstrip.sensor.layers import AnySensor
from tacstrip.sensor.spec import Sensor
from tacstrip.stream.bridges.foxglove.bridge import PORT as FOXGLOVE_PORT
from tacstrip.stream.bridges.foxglove.layout import layout_text
from tacstrip.stream.device.port import BAUD, SerialPort
from tacstrip.stream.device.source import SerialSource
from tacstrip.stream.device.virtual import PtyDevice
from tacstrip.stream.http_server import check_port
from tacstrip.stream.live.pipeline import Live
from tacstrip.stream.live.service import Service
from tacstrip.stream.live.sinks import Sink, foxglove_sink, json_sink, ros2_sink, tuio_sink
from tacstrip.stream.live.warmup import warm_up
from tacstrip.stream.replay import open_source
from tacstrip.stream.source import LOGGER, Source
from tacstrip.tracking.live_contact import LiveTrack
from tacstrip.view.controller import Controller
from tacstrip.view.health import background_process
from tacstrip.view.server import Access, Server
from tacstrip.view.simulator import Settings, Simulator
from tacstrip.view.watch import watch

_HTTP = 8360
_ROS2 = {"ros_domain": "domain", "ros_name": "name", "ros_frame": "frame_id", "ros_interface": "interface"}
_OF_STREAM = ("output", "lines", "osc", "ros2", "foxglove", "watched", "method", "creep")  # a device has none
_ONE_LAYER = ("watched", "creep", "osc", "ros2", "foxglove")
_POLL_S = 0.1
# The simulator's, where no spec is given.
_SENSOR = Sensor(construction="crs-crs", strips=50, pitch_mm=2.0, length_mm=100.0, adc_bits=12)
_RATE_HZ, _LAYERED_HZ = 1000.0, 100.0
_LOCAL_READERS = (
    "; readers on this computer find them if they look there: ROS_LOCALHOST_ONLY=1, from Iron on "
    "ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST, or give --ros-interface auto here"
)


@click.command()
@options.sensor_and_input("[[SENSOR] INPUT]", required=False)
@options.option("--port", help="Serial port of the device, such as /dev/ttyACM0.")
@options.whole("--baud", default=BAUD, help="Speed of the line.")
@options.flag("--simulate", help="A simulated device, controlled from the page.")
@options.flag("--device", help="Serve a simulated device on a serial port, for another program.")
@options.option("--sensor", metavar="SENSOR", help="Spec of the device, the simulator or the recording.")
@options.number("--rate", callback=options.rate,
                help="Scan rate to ask the device for; the simulator's is 1000, of two layers 100 [Hz].")  # fmt: skip
@options.option("--method", help="Method of reconstruction: polygon, vertex, profile or pieces.")
@options.number("--noise", help=f"Of the readings, where it is known: {options.HALF_WIDTH}.")
@options.flag("--no-drift", help="Do not remove the drift of a calibrated sensor.")
@options.flag("--creep", help="Take the creep of contacts that are held still out.")
@options.flag("--no-tracks", help="Do not fuse the scans of each object into one rigid outline.")
@options.flag("--watch", "watched",
              help="Let the doctor look at the latest 50 scans or more, every 5 s, and leave channels out while "
              "they are faulty.")  # fmt: skip
@options.number("--speed", default=1.0, callback=options.above_0,
                help="INPUT: speed relative to its own times.")  # fmt: skip
@options.output("Record to this file (.mcap).", required=False)
@options.FORCE
@options.DURABLE
@options.flag("--no-view", help="No page.")
@options.whole("--http", default=_HTTP, help="The page's port; 0: any free one.")
@options.option("--host", default="127.0.0.1",
                help="Address of the page; 0.0.0.0 lets the local network in, with a token.")  # fmt: skip
@options.flag("--json", "lines", help="Objects as JSON lines on standard output.")
@options.option("--osc", metavar="HOST:PORT", help="Objects as TUIO 1.1 blobs over UDP.")
@options.flag("--ros2", help="Polygons, readings and state as topics of ROS 2, without ROS.")
@options.whole("--ros-domain", help="Domain id of ROS 2; else ROS_DOMAIN_ID, else 0.")
@options.option("--ros-name", metavar="NAME", help="Namespace of the topics; else tacstrip.")
@options.option("--ros-frame", metavar="FRAME", help="Frame id of the polygons; else the namespace.")
@options.option("--ros-interface", metavar="INTERFACE", help="Network interface for ROS 2, by name or address; auto: "
                "any. Else only this computer.")  # fmt: skip
@options.whole("--foxglove", metavar="[PORT]", is_flag=False, flag_value=FOXGLOVE_PORT,
               help=f"Serve Foxglove and Lichtblick on PORT, {FOXGLOVE_PORT} by default; 0: any free one.")  # fmt: skip
@options.option("--foxglove-host", default="127.0.0.1",
                help="Address for Foxglove; 0.0.0.0 lets the local network look, without a token.")  # fmt: skip
@options.file("--foxglove-layout", metavar="FILE", help="Write a layout (.json) for Foxglove and Lichtblick.")
@options.number("--seconds", default=math.inf, callback=options.above_0, show_default=False,
                help="End after so many seconds.")  # fmt: skip
def command(files: tuple[str, ...], **given: Any) -> None:
    """Show the shapes that touch the sensor on a page of this computer; record them and pass them on.

    Scans come from a device (--port), a simulated one (--simulate), or INPUT: a recording (.mcap), or readings (.csv)
    of SENSOR. Ctrl-C ends it, and a recording is then complete. Exit code 1: the stream or the recording failed.

    Example: tacstrip live --simulate
    """
    ways = (bool(files), bool(given["port"]), given["simulate"], given["device"])
    if sum(ways) != 1:
        raise OptionError("give one of --port PORT, --simulate, --device, or a recording or readings file")
    options.belong(
        not given["device"], "is not for --device, which only serves scans to another program", *_OF_STREAM
    )
    options.belong(files, "is for INPUT, whose pace it changes", "speed")
    options.belong(not files, "is for a device; --speed changes the pace of INPUT", "rate")
    options.belong(
        len(files) < 2, f"names the sensor a second time, after {files[0] if files else ''}", "sensor"
    )
    check_port(given["http"], "--http")
    if given["output"] is not None:
        if given["output"].suffix.lower() != ".mcap":
            raise OptionError(f"-o {given['output']}: a recording is a file that ends in .mcap")
        protect(given["output"], *files, force=given["force"])
    options.belong(given["output"], "is for a recording: give -o as well", "durable")
    options.belong(given["ros2"], "is for --ros2: give that as well", *_ROS2)
    options.belong(given["foxglove"] is not None, "is for --foxglove: give that as well",
                   "foxglove_host", "foxglove_layout")  # fmt: skip
    if given["foxglove"] is not None:
        check_port(given["foxglove"], "--foxglove")
    if (layout := given["foxglove_layout"]) is not None:
        if layout.suffix.lower() != ".json":
            raise OptionError(f"--foxglove-layout {layout}: a layout is a file that ends in .json")
        protect(layout, *files, given["output"], force=given["force"])
    spec = files[0] if len(files) == 2 else given["sensor"]
    sensor = load_layers(spec) if spec else None
    with deferred_interrupt() as stop, _log_on_stderr():
        end_s = time.monotonic() + given["seconds"]

        def running() -> bool:
            time.sleep(_POLL_S)
            return not stop() and time.monotonic() < end_s

        if given["device"]:
            _serve_device(_simulator(sensor, given), running)
            return
        try:
            failed = _stream(files, sensor, given, running)
        except PortError as error:
            note(f"Error: {error}")
            failed = True
    sys.exit(1 if failed else 0)


@contextmanager
def _log_on_stderr() -> Iterator[None]:
    """Show what the rooms below say to their logger."""
    handler = logging.StreamHandler()
    LOGGER.addHandler(handler)
    LOGGER.setLevel(logging.INFO)
    try:
        yield
    finally:
        LOGGER.removeHandler(handler)


def _simulator(sensor: AnySensor | None, given: dict[str, Any]) -> Simulator:
    usual_hz = _RATE_HZ if sensor is None or isinstance(sensor, Sensor) else _LAYERED_HZ
    return Simulator(Settings(sensor or _SENSOR, given["rate"] or usual_hz))


def _serve_device(simulator: Simulator, running: Callable[[], bool]) -> None:
    with PtyDevice(simulator.virtual_device()) as served:
        construction = simulator.settings.sensor.construction
        note(f"a simulated {construction} device is on {served.path}; Ctrl-C unplugs it")
        while running():
            pass


def _stream(
    files: tuple[str, ...], sensor: AnySensor | None, given: dict[str, Any], running: Callable[[], bool]
) -> bool:
    """Run the stream to its end; return whether it, or its recording, failed."""
    simulator = _simulator(sensor, given) if given["simulate"] else None
    source: Source
    if simulator is not None:
        source = simulator.source()
    elif given["port"]:
        source = SerialSource(lambda: SerialPort(given["port"], given["baud"]), sensor, given["rate"])
    else:
        source = open_source(files[-1], sensor)
    if isinstance(source.sensor, Sensor):
        check_method("--method", given["method"], source.sensor, source.names)
    else:
        chosen_method(given["method"], source.sensor)
        options.belong(False, "is for a sensor of one layer, and this one has two", *_ONE_LAYER)
    if files:
        warn_of_input(files[-1], source)
    warm_up(source.sensor, given["method"])
    noise = None if given["noise"] is None else Noise(positional=given["noise"])
    # The next source is that of a simulator whose settings were changed.
    next_source = (lambda: None) if simulator is None else simulator.source
    with ExitStack() as stack:
        searches = None
        if not isinstance(source.sensor, Sensor):
            searches = stack.enter_context(worker_processes(1, start_method="spawn"))
            searches.submit(warm_up, source.sensor).result()
        live = Live(source, given["method"], noise, not given["no_drift"], given["speed"], next_source,
                    creep=given["creep"], tracks=not given["no_tracks"], searches=searches)  # fmt: skip
        # The page and the sinks come first: where they fail, no recording has been begun.
        sinks = list(_sinks(live, given))
        for sink in sinks:
            stack.callback(sink.close)
        if given["watched"]:
            executor = stack.enter_context(background_process())
            stack.callback(watch(live, executor).close)
        if not given["no_view"]:
            stack.enter_context(_page(live, simulator, given))
        if given["output"] is not None:
            live.record(given["output"], force=given["force"], durable=given["durable"])
        service = Service()
        with live:
            service.ready()
            try:
                while live.running and running() and not (sinks and all(sink.ended for sink in sinks)):
                    service.alive(_status(live), live.stuck_s)
            finally:
                service.stopping()  # before the disk is waited for
    if running():  # it was read to its end
        warn_of_cut(source)
    if live.late:
        kept = "; the recording has them, and `tacstrip replay` finds their shapes" if given["output"] else ""
        note(f"{live.late} of {live.frames} scan(s) have no shapes, for the computer was behind{kept}")
    if live.untracked:
        note(_not_known(live, given["output"] or (files[-1] if files else None)))
    for one in sorted(live.known.values(), key=lambda one: one.id):
        note(_line(one))
    # The reader of the lines may close them at any time.
    sink_failed = any(sink.error and not isinstance(sink.error, BrokenPipeError) for sink in sinks)
    return sink_failed or live.recording_failed or live.error is not None


def _status(live: Live) -> str:
    """Say in a line how the stream is."""
    rate_hz, recorder = live.meter.rate_hz, live.recording
    text = f"{figures(rate_hz, 3)} scans/s" if rate_hz else "no scans come"
    return text if recorder is None else f"{text}; recording to {recorder.path}"


def _not_known(live: Live, path: Path | str | None) -> str:
    """Say of how many frames tracks were not known, and what finds them."""
    processed = live.frames - live.late - live.unreadable
    why = "the search had not ended, or the computer was behind" if live.tracking else "tracking ended"
    text = f"{live.untracked} of {processed} frame(s) have no tracks (null): {why}"
    return text if path is None else f"{text}; `tacstrip track` finds them in {path}"


def _line(one: LiveTrack) -> str:
    """Say what the scans told of an object over time."""
    text = f"object {one.id}: {one.status}"
    if len(one.outline):
        text += "; if its outline is right, " if one.status == "doubtful" else ", "
        text += f"{len(one.outline)} corners, {one.area_mm2:.6g} mm2 +- {figures(one.area_deviation_mm2)}"
        text += f", corners known to {figures(one.corner_deviation_mm)} mm from {one.scans} scans"
    return f"{text}. {one.advice}" if one.advice else text


def _sinks(live: Live, given: dict[str, Any]) -> Iterator[Sink]:
    if given["lines"]:
        yield json_sink(live, sys.stdout)
    if given["osc"]:
        yield tuio_sink(live, given["osc"])
    if given["ros2"]:
        chosen = {key: given[option] for option, key in _ROS2.items() if given[option] is not None}
        yield ros2_sink(live, **chosen)
        name = chosen.get("name", "tacstrip")
        here = "" if "interface" in chosen else _LOCAL_READERS
        note(f"ROS 2: topics below /{name}, on {chosen.get('interface', 'this computer alone')}{here}")
    if given["foxglove"] is not None:
        host = given["foxglove_host"]
        sink, port = foxglove_sink(live, host, given["foxglove"])
        note(f"Foxglove and Lichtblick: open a connection to ws://{_reachable(host)}:{port}")
        if (layout := given["foxglove_layout"]) is not None:
            write_text(layout, layout_text(live.source.sensor))
            note(f'{layout}: choose it there by "Import from file" in the menu of layouts')
        yield sink


def _reachable(host: str) -> str:
    """Return the name under which others reach a server that listens on a host."""
    return socket.gethostname() if host in ("0.0.0.0", "::") else f"[{host}]" if ":" in host else host


@contextmanager
def _page(live: Live, simulator: Simulator | None, given: dict[str, Any]) -> Iterator[None]:
    with background_process() as executor:
        server = Server(Controller(live, executor, simulator), Access(given["host"]), given["http"])
        urls = server.urls
        note(f"the page is at {urls.pop('control')}")
        for url in urls.values():
            note(f"view only: {url}")
        with contextlib.closing(server):
            yield
