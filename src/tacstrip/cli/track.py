"""`tacstrip track`."""

from __future__ import annotations

import contextlib
import sys
from dataclasses import replace
from pathlib import Path

import click
import numpy as np
import numpy.typing as npt

from tacstrip.cli import (
    load_sensor,
    note,
    one_layer,
    options,
    protect,
    some_scans,
    warn,
    warn_of_input,
    warn_of_order,
)
from tacstrip.cli.replay import warn_of_cut
from tacstrip.contact.noise import Noise
from tacstrip.diagnose.log import Log
from tacstrip.errors import OptionError, ReadingError, figures
from tacstrip.files import replacing
from tacstrip.io.columns import BEGIN_SPEC
from tacstrip.io.input_checks import readings_suspicions
from tacstrip.io.readings import read_unchecked
from tacstrip.io.table import write_table
from tacstrip.scan import time_goes_back
from tacstrip.stream.codes import decode
from tacstrip.stream.recording.recorder import Recorder
from tacstrip.stream.replay import ReadingsSource, Recording, open_source
from tacstrip.stream.source import RawScan, TrackedShape
from tacstrip.tracking.geojson import track_records, write_tracks
from tacstrip.tracking.result import Track
from tacstrip.tracking.track import track

_OPEN_DEG = 30.0  # standard deviation of a turn from which on it is not said


@click.command()
@options.sensor_and_input("[SENSOR] RECORDING")
@options.output(
    "New file: .geojson, .mcap, or a table (.csv: a row per object and scan); left out: only what is printed.",
    required=False,
)
@options.FORCE
@options.noise
@options.WITHOUT
@options.plot()
def command(
    files: tuple[str, ...],
    output: Path | None,
    force: bool,
    noise: Noise,
    without: tuple[str, ...],
    plot: Path | None,
) -> None:
    """Recover objects over time from RECORDING: readings (CSV, with SENSOR before them) or a recording (.mcap).

    Each is one rigid shape, fitted to all scans that show it, with its place and angle in every scan. Exit code 1: no
    shape could be recovered. Into a .mcap go the scans too, each with its objects' outlines and poses.

    Example: tacstrip track session.mcap -o tracks.geojson --plot tracks.png
    """
    protect(output, *files, force=force)
    protect(plot, *files, output)
    recorded = output is not None and output.suffix.lower() == ".mcap"
    if output is not None and output.suffix.lower() not in (".mcap", ".geojson", ".json", ".csv"):
        raise OptionError(
            f"-o {output}: objects over time go into a file that ends in .geojson, .csv or .mcap"
        )
    options.belong(output, "is for a file: -o FILE", "force")
    source, raws = _opened(files, recorded)
    spec = source.sensor if source else load_sensor(files[0])
    spec = replace(spec, without=(*spec.without, *without))
    decoded = [decode(raw, spec) for raw in raws] if isinstance(source, Recording) else None
    scans = read_unchecked(files[-1], spec) if decoded is None else decoded
    if not any(scan.touched.any() for scan in scans):
        raise ReadingError(f"{files[-1]}: no strip is touched in any of {len(scans)} scan(s)")
    if told := time_goes_back(np.array([scan.time_s for scan in scans])):
        raise ReadingError(f"{files[-1]}: {told}")
    if source is None:
        warn(*readings_suspicions(files[-1], spec, scans))
        warn_of_order(files[-1], Log.of_scans(spec, scans))
    else:
        warn_of_input(files[-1], source)
        warn_of_cut(source)
    known = noise if options.given("quantisation", "positional") else None
    tracks = track(scans, spec, known)
    for one in tracks:
        note(_line(one))
    note(f"{len(scans)} scan(s), {len(tracks)} object(s); noise: {options.noise_source(known, spec)}")
    if output is not None:
        if source is not None and recorded:
            _record(output, files, source, raws, tracks)
        elif output.suffix.lower() == ".csv":
            write_table(output, track_records(tracks))
        else:
            write_tracks(output, tracks)
        note(f"{output} written")
    if plot is not None:
        from tacstrip.plot.theme import save
        from tacstrip.plot.tracks import track_figure

        note(f"{save(track_figure(spec, tracks), plot)} written")
    if not any(len(one.outline) for one in tracks):
        sys.exit(1)


def _opened(
    files: tuple[str, ...], recorded: bool
) -> tuple[Recording | ReadingsSource | None, list[RawScan]]:
    """Return the input as a source and its codes; of readings only where they are to be recorded."""
    name = files[-1]
    if Path(name).suffix.lower() != ".mcap":
        if len(files) < 2:
            raise OptionError(
                f"{name} does not say what sensor it is of: tacstrip track sensor.toml {name} ({BEGIN_SPEC})"
            )
        if not recorded:
            return None, []
    with contextlib.closing(open_source(name, load_sensor(files[0]) if len(files) > 1 else None)) as source:
        one_layer(name, source.sensor)
        return source, list(some_scans(name, source))


def _record(
    output: Path,
    files: tuple[str, ...],
    source: Recording | ReadingsSource,
    raws: list[RawScan],
    tracks: list[Track],
) -> None:
    """Write the scans with the objects that each of them shows."""
    about = {"source": Path(files[-1]).name, "sensor": Path(files[0]).name}
    if isinstance(source, Recording):
        about["method"] = source.about.get("method", "")
    with (
        replacing(output) as part,
        Recorder(part, source.sensor, source.names, source.origin_ns, about, force=True) as recorder,
    ):
        for i, raw in enumerate(raws):
            shown = [
                TrackedShape(
                    t.id, t.status, t.outline, t.poses[i], int(t.present.sum()), t.advice, t.covariance,
                    t.pose_covariances[i],
                )
                for t in tracks
                if t.present[i]
            ]  # fmt: skip
            recorder.add(replace(raw, tracks=tuple(shown), searching=0))


def _way(one: Track, seen: npt.NDArray[np.int_]) -> str:
    """Say how far an object moved and turned; how far at most only where that is more than errors of poses make."""
    path = np.column_stack([one.centroids[seen], np.rad2deg(one.poses[seen, 2])])
    net, most = path[-1] - path[0], np.ptp(path, axis=0)
    spread = np.sqrt(one.pose_covariances[seen][:, range(3), range(3)]) * (1.0, 1.0, np.rad2deg(1.0))
    off = float(np.hypot(spread[0, 2], spread[-1, 2]))
    if off > 180.0:  # a scan at the border tells no angle
        off = float(np.sqrt(2.0) * np.nanmedian(spread[:, 2]))
    ways = [
        f"{figures(way, 3)} mm" + (f" +- {figures(sigma)}" if np.isfinite(sigma) and sigma > 0.0 else "")
        for way, sigma in zip(net[:2], np.hypot(spread[0], spread[-1])[:2], strict=True)
    ]
    text = f"its centroid moved {ways[0]} across and {ways[1]} along the strips from first to last"
    if one.by_scan is not None:
        return f"{text}; how far it turned is not known"
    if off > _OPEN_DEG:
        return f"{text}; how far it turned is not known (+- {figures(off)} deg)"
    text += f", {'perhaps ' if one.status == 'doubtful' else ''}turned {net[2]:.3g} deg"
    if off > 0.0:
        text += f" +- {figures(off)}"
    more = most > np.abs(net) + 6.0 * np.nan_to_num(np.nanmedian(spread, axis=0)) + (0.1, 0.1, 0.1)
    if more.any():
        across, along, turned = (figures(value, 3) for value in most)
        text += f" (at most {across} mm, {along} mm and {turned} deg apart between two scans)"
    return text


def _line(one: Track) -> str:
    """Say what is known of an object."""
    seen = np.flatnonzero(one.present)
    text = f"object {one.id}: {one.status}"
    if len(seen):
        text += f", {len(seen)} scans, {one.times_s[seen[0]]:.4g} to {one.times_s[seen[-1]]:.4g} s"
    if one.joint:
        text += f", {len(one.joint)} of them on strips shared with others"
    if len(one.outline):
        area, off = one.area_mm2, one.area_deviation_mm2
        spread = f" +- {figures(off)}" if np.isfinite(off) else ""
        what = f"{len(one.outline)} corners" if one.kind == "polygon" else one.kind
        text += f", {what}, " + ("an area that is not known" if off > area else f"{area:.6g} mm2{spread}")
        text += f", {_way(one, seen)}"
    if one.motion != "free":
        text += f"; taken for {one.motion}"
    if one.offsets:
        most = max(float(np.abs(values).max()) for values in one.offsets.values())
        text += f"; channels are off by up to {100.0 * most:.2g} % of Vref"
    return f"{text}. {one.advice}" if one.advice else text
