"""`tacstrip record`."""

from __future__ import annotations

import contextlib
import itertools
import math
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click

from tacstrip.cli import check_method, load_layers, note, options, protect, warn, warn_of_input
from tacstrip.cli.replay import warn_of_cut
from tacstrip.errors import OptionError, TacstripError
from tacstrip.interrupt import deferred_interrupt
from tacstrip.io.geojson import read_contact
from tacstrip.io.input_checks import unlikely_contact
from tacstrip.sensor.layers import unit_of
from tacstrip.sensor.spec import Sensor
from tacstrip.stream.codes import UNSET_BITS, top_code
from tacstrip.stream.recording.recorder import Recorder, record, with_shapes
from tacstrip.stream.replay import ReadingsSource, Recording, open_source
from tacstrip.stream.simulated import Drag, SimulatedSource
from tacstrip.stream.source import RawScan, Source

_CONTACTS = (".wkt", ".geojson", ".json")
_LONG_S = 60.0  # of work; more is announced before it begins
_SAMPLE, _SAMPLE_S = 64, 0.5  # most scans, and longest time, to estimate the time per scan
_WRITE_S = 6e-5  # per scan
# Bytes on disk of a scan, of a touched strip's code, of a shape, of its vertex.
_SCAN_BYTES, _CODE_BYTES, _SHAPE_BYTES, _CORNER_BYTES = 40.0, 1.2, 50.0, 3.0
_TEXT_ROUNDING = 0.01  # steps of the converter by which the rounding of a text file may move a reading


@click.command()
@options.sensor_and_input()
@options.output("Recording (.mcap).")
@options.option("--reconstruct", "method", metavar="METHOD",
                help="Store reconstructed shapes too: polygon, pieces, vertex or profile.")  # fmt: skip
@options.flag("--paced", help="In real time; otherwise as fast as possible.")
@options.FORCE
@options.DURABLE
@options.AT
@options.TURN
@options.option("--drag", type=options.POINT, multiple=True, metavar="X Y",
                help="Contact: move it to here; repeat for a path.")  # fmt: skip
@options.number("--turn-rate", default=0.0, metavar="DEG/S", help="Contact: keep turning it.")
@options.number("--rate", default=100.0, callback=options.rate, help="Contact: scan rate [Hz].")
@options.number("--seconds", default=1.0, callback=options.finite_above_0,
                help="Contact: duration, from the path's start to its end.")  # fmt: skip
@options.noise
@options.MODEL
@options.ELECTRODES
@options.SEED
def command(
    files: tuple[str, ...],
    output: Path,
    method: str | None,
    paced: bool,
    force: bool,
    durable: bool,
    **simulation: Any,
) -> None:
    """Record A/D codes, and shapes if wanted, to one MCAP file with the sensor's spec.

    INPUT is a contact (.wkt, .geojson) on a simulated SENSOR, readings of SENSOR (.csv), or another recording (.mcap),
    which keeps its own spec where no SENSOR is named. Ctrl-C ends the recording. Exit code 1: writing failed, as on a
    full disk; the scans saved until then are a complete recording.

    Example: tacstrip record prototype-crs-crs object.wkt -o session.mcap --at 32 160 --drag 32 250 --rate 1000 --paced
    """
    if output.suffix.lower() != ".mcap":
        raise OptionError(f"-o {output}: a recording is a file that ends in .mcap")
    protect(output, *files, force=force)
    count = 0
    if Path(files[-1]).suffix.lower() in _CONTACTS:
        source: Source = _simulated(files, simulation)
        count = _count(simulation)
    else:
        alone = f"is for a contact, and {files[-1]} is none"
        options.belong(False, alone, *simulation, "quantisation", "positional", "distribution")
        source = open_source(files[-1], load_layers(files[0]) if len(files) == 2 else None)
    save_recording(files, source, output, method, 1.0 if paced else math.inf, force, count, durable=durable)


def _simulated(files: tuple[str, ...], given: dict[str, Any]) -> SimulatedSource:
    if len(files) != 2:
        raise OptionError(f"{files[0]}: a contact needs a SENSOR to touch; name its spec before it")
    shape = read_contact(files[1]).turned(math.radians(given["turn"]))
    start = given["at"] or tuple(shape.centroid)
    motion = Drag(shape, [start, *given["drag"]], given["seconds"], math.radians(given["turn_rate"]))
    sensor = load_layers(files[0])
    warn(unlikely_contact(shape, sensor if isinstance(sensor, Sensor) else sensor.layers[0].sensor))
    return SimulatedSource(
        sensor, motion, given["rate"], _count(given), given["noise"], given["seed"], given["model"],
        given["electrodes"],
    )  # fmt: skip


def _count(given: dict[str, Any]) -> int:
    """Return the number of scans of a contact."""
    return max(1, round(float(given["seconds"]) * float(given["rate"])))


def save_recording(
    files: tuple[str, ...],
    source: Source,
    output: Path,
    method: str | None = None,
    speed: float = math.inf,
    force: bool = False,
    count: int = 0,
    part: Path | None = None,
    durable: bool = False,
) -> None:
    """Record a source, opened from the command line's files, and print what was saved; exit code 1 if writing fails.

    `count`: the number of scans, where it is known, so that long work is announced. `part`: write to this file, all
    scans or none; the caller then moves it to `output`.
    """
    check_method("--reconstruct", method, unit_of(source.sensor), source.names)
    warn_of_input(files[-1], source)
    about = {"source": Path(files[-1]).name, "sensor": Path(files[0]).name, "method": method or ""}
    if isinstance(source, Recording) and not method:
        about["method"] = source.about.get("method", "")
    with contextlib.closing(source), deferred_interrupt() as stop:
        scans = stop.until(with_shapes(source, source.sensor, method) if method else source)
        first = list(itertools.islice(scans, 1))  # errors of the method come before a file is made
        if count > _SAMPLE:
            first += _announce(scans, count)
        recorder = Recorder(
            part or output, source.sensor, source.names, source.origin_ns, about, force, durable
        )
        try:
            with recorder:
                record(itertools.chain(first, scans), recorder, speed, stop)
        except TacstripError:  # of the source: the rest of it is lost, and this file would not say so
            recorder.path.unlink(missing_ok=True)
            raise
        except OSError as error:
            if part is not None:
                raise
            note(
                f"Error: {error.filename}: {error.strerror}. {recorder.saved_scans} scan(s) are saved in it; "
                "make room, or record to another disk"
            )
            sys.exit(1)
    if part is not None and stop():
        raise KeyboardInterrupt
    stopped = "stopped: " if stop() else ""
    shapes = f", {recorder.polygons} shape(s)" if recorder.polygons else ""
    click.echo(
        f"{output}: {stopped}{recorder.scans} scan(s) of {source.sensor.strips} strips{shapes}, "
        f"{recorder.size_bytes / 1e6:.3g} MB"
    )
    _warn_of_changes(files, source)
    if not stop():
        warn_of_cut(source)


def _announce(scans: Iterator[RawScan], count: int) -> list[RawScan]:
    """Take a few scans, and print the time and size of all of them where that is much."""
    began = time.monotonic()
    taken: list[RawScan] = []
    for raw in itertools.islice(scans, _SAMPLE):
        taken.append(raw)
        if time.monotonic() - began > _SAMPLE_S:
            break
    work_s = count * ((time.monotonic() - began) / max(len(taken), 1) + _WRITE_S)
    if taken and work_s > _LONG_S:
        size = count / len(taken) * sum(map(_disk_bytes, taken))
        note(
            f"{count} scans: some {_duration(work_s)} of work and {size / 1e6:.0f} MB. Ctrl-C ends it, and the "
            "recording is then complete as far as it goes"
        )
    return taken


def _disk_bytes(raw: RawScan) -> float:
    """Return the approximate size of a scan with its shapes in a recording."""
    codes = sum(values[raw.touched].size for values in raw.codes.values())
    shapes = sum(_SHAPE_BYTES + _CORNER_BYTES * len(shape.vertices) for shape in raw.shapes or ())
    return _SCAN_BYTES + _CODE_BYTES * codes + shapes


def _duration(seconds: float) -> str:
    """Return a time in minutes, hours or days."""
    minutes = seconds / 60.0
    if minutes < 120.0:
        return f"{minutes:.3g} min"
    return f"{minutes / 60.0:.3g} h" if minutes < 2880.0 else f"{minutes / 1440.0:.3g} days"


def _warn_of_changes(files: tuple[str, ...], source: Source) -> None:
    """Warn of readings that were rounded, and of assumed A/D bits."""
    if isinstance(source, ReadingsSource) and source.rounded_steps > _TEXT_ROUNDING:
        step_volt = unit_of(source.sensor).vref_volt / top_code(source.sensor)
        warn(
            f"{files[-1]} has readings between the codes of {source.sensor.adc_bits} bits; they are rounded, by up to "
            f"{source.rounded_steps:.2g} of a step ({step_volt:.3g} V)"
        )
    if len(files) == 2 and Sensor.load(files[0]).adc_bits is None:
        warn(f"{files[0]} has no adc_bits: the recording holds codes of {UNSET_BITS} bits")
