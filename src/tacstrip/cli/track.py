"""`tacstrip track`."""

from __future__ import annotations

import contextlib
import sys
from pathlib import Path

import click
import numpy as np

from tacstrip.cli import load_sensor, note, options, protect
from tacstrip.contact.noise import Noise
from tacstrip.errors import OptionError, ReadingError
from tacstrip.io.readings import read_readings
from tacstrip.scan import Scan
from tacstrip.sensor.spec import Sensor
from tacstrip.stream.codes import decode
from tacstrip.stream.replay import Recording
from tacstrip.tracking.geojson import write_tracks
from tacstrip.tracking.track import Track, track


@click.command()
@options.sensor_and_input("[SENSOR] RECORDING")
@options.output("GeoJSON file; left out: only what is printed.", required=False)
@options.noise
@options.plot()
def command(files: tuple[str, ...], output: Path | None, noise: Noise, plot: Path | None) -> None:
    """Recover objects over time from RECORDING: readings (CSV, with SENSOR before them) or a recording (.mcap).

    Each is one rigid shape, fitted to all scans that show it, with its place and angle in every scan. Exit code 1: no
    shape could be recovered.

    Example: tacstrip track session.mcap -o tracks.geojson --plot tracks.png
    """
    protect(output, *files)
    protect(plot, *files, output)
    spec, scans = _scans(files)
    if not any(scan.touched.any() for scan in scans):
        raise ReadingError(f"{files[-1]}: no strip is touched in any of {len(scans)} scan(s)")
    tracks = track(scans, spec, noise if options.given("quantisation", "positional") else None)
    for one in tracks:
        note(_line(one))
    note(f"{len(scans)} scan(s), {len(tracks)} object(s)")
    if output is not None:
        write_tracks(output, tracks)
        note(f"{output} written")
    if plot is not None:
        from tacstrip.plot.style import save
        from tacstrip.plot.track import track_figure

        note(f"{save(track_figure(spec, tracks), plot)} written")
    if not any(len(one.outline) for one in tracks):
        sys.exit(1)


def _scans(files: tuple[str, ...]) -> tuple[Sensor, list[Scan]]:
    """Return the sensor, and all scans of the input."""
    name = files[-1]
    if Path(name).suffix.lower() == ".mcap":
        with contextlib.closing(Recording(name, load_sensor(files[0]) if len(files) > 1 else None)) as source:
            return source.sensor, [decode(raw, source.sensor) for raw in source]
    if len(files) < 2:
        raise OptionError(f"{name} does not say what sensor it is of: tacstrip track SENSOR {name}")
    sensor = load_sensor(files[0])
    return sensor, read_readings(name, sensor)


def _line(one: Track) -> str:
    """Say what is known of an object."""
    seen = np.flatnonzero(one.present)
    text = f"object {one.id}: {one.status}"
    if len(seen):
        text += f", {len(seen)} scans, {one.times_s[seen[0]]:.4g} to {one.times_s[seen[-1]]:.4g} s"
    if one.joint:
        text += f", {len(one.joint)} of them on strips shared with others"
    if len(one.outline):
        text += f", {len(one.outline)} corners, {one.area_mm2:.6g} mm2"
        if np.isfinite(one.area_deviation_mm2):
            text += f" +- {one.area_deviation_mm2:.2g}"
        way = np.ptp(one.poses[seen], axis=0)
        text += f", moved {way[0]:.3g} mm across and {way[1]:.3g} mm along the strips"
        text += f", turned {np.rad2deg(way[2]):.3g} deg"
    return f"{text}. {one.advice}" if one.advice else text
