"""`tacstrip replay`."""

from __future__ import annotations

import contextlib
import math
from pathlib import Path

import click

from tacstrip.cli import check_method, load_layers, note, options, protect, save_picture, warn, warn_of_input
from tacstrip.errors import OptionError
from tacstrip.interrupt import deferred_interrupt
from tacstrip.sensor.layers import unit_of
from tacstrip.sensor.spec import Sensor
from tacstrip.stream.codes import decode
from tacstrip.stream.export import as_reconstruction, json_line
from tacstrip.stream.recording.recorder import with_shapes
from tacstrip.stream.recording.summary import summary
from tacstrip.stream.replay import Recording
from tacstrip.stream.source import RawScan, Source, paced


@click.command()
@click.argument("recording", type=options.FILE)
@options.number("--speed", default=1.0, callback=options.above_0,
                help="Speed relative to the recorded times.")  # fmt: skip
@options.flag("--fast", help="As fast as possible.")
@options.option("--sensor", metavar="SENSOR", help="Decode with this spec, not with the recorded one.")
@options.option("--reconstruct", "method", metavar="METHOD",
                help="Reconstruct anew: polygon, pieces, vertex or profile; otherwise recorded shapes are "
                "printed.")  # fmt: skip
@options.flag("--summary", "short", help="Print a summary only.")
@options.plot("Picture of the last scan in contact (.png, .svg, .pdf).")
def command(
    recording: Path,
    speed: float,
    fast: bool,
    sensor: str | None,
    method: str | None,
    short: bool,
    plot: Path | None,
) -> None:
    """Play back the scans of a recording in real time, one line of JSON each.

    A line has the scan's readings over Vref, null where nothing touches, and its shapes in mm.

    Example: tacstrip replay session.mcap --speed 0.5 | head -n 3
    """
    options.belong(not (fast or short), "is the pace of scans; leave it or --fast and --summary out", "speed")
    if short and plot is not None:
        raise OptionError("--summary prints no scans; leave --plot out")
    protect(plot, recording)
    source = Recording(recording, load_layers(sensor) if sensor else None)
    check_method("--reconstruct", method, unit_of(source.sensor), source.names)
    warn_of_input(recording, source)
    touched: RawScan | None = None
    with contextlib.closing(source), deferred_interrupt() as stop:
        scans = stop.until(with_shapes(source, source.sensor, method) if method else source)
        if short:
            lines = summary(source, scans)
            if stop():
                raise KeyboardInterrupt
            click.echo("\n".join(lines))
        else:
            for number, raw in enumerate(paced(scans, math.inf if fast else speed, stop)):
                scan = decode(raw, source.sensor)
                touched = raw if scan.touched.any() else touched
                click.echo(json_line(number, raw, scan))
    if not stop():
        warn_of_cut(source)
    if plot is not None:
        _plot(source.sensor, touched, method or source.about.get("method") or "shape", plot)


def warn_of_cut(source: Source) -> None:
    """Warn where a recording, read to its end, was cut."""
    if isinstance(source, Recording) and not source.condition.whole:
        lost = source.condition.lost_bytes
        rest = f"{lost} bytes after its last whole chunk are lost" if lost else "it ends after a whole chunk"
        warn(f"{source.path} was cut: {rest}; `tacstrip recover` makes a complete file of the rest")


def _plot(sensor: Sensor, raw: RawScan | None, method: str, path: Path) -> None:
    if raw is None:
        warn(f"no strip is touched in any scan; {path} is not written")
        return
    results = {method: [as_reconstruction(raw, method)]} if raw.shapes else {}
    note(f"{save_picture(path, sensor, [decode(raw, sensor)], results)} written")
