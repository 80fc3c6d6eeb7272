"""Summarise a recording in a few lines."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Iterable
from datetime import UTC, datetime

from tacstrip.stream.recording.messages import NANO
from tacstrip.stream.replay import Recording
from tacstrip.stream.source import RawScan


def summary(source: Recording, scans: Iterable[RawScan]) -> list[str]:
    """Read all scans of a recording and return its summary, line by line."""
    count = lost = touched = unread = unknown = 0
    shapes: Counter[str] = Counter()
    tracks: Counter[int] = Counter()
    first: RawScan | None = None
    last: RawScan | None = None
    for raw in scans:
        first = first or raw
        lost += max(0, raw.sequence - last.sequence - 1) if last else 0
        last = raw
        count += 1
        touched += bool(raw.touched.any())
        shapes.update(shape.status for shape in raw.shapes or ())
        unread += raw.shapes is None
        tracks.update(track.id for track in raw.tracks or ())
        unknown += raw.tracks is None
    sensor, file = source.sensor, shlex.quote(str(source.path))
    began = datetime.fromtimestamp(source.origin_ns / NANO, UTC).isoformat(timespec="seconds")
    lines = [
        f"{source.path}: {sensor.construction}, {sensor.strips} strips, codes {', '.join(source.names)} of "
        f"{sensor.adc_bits} bits, time 0 is {began}",
        f"{count} scan(s), {touched} of them touched, {lost} lost on the way to the recorder",
    ]
    if first is not None and last is not None and (seconds := last.time_s - first.time_s) > 0.0:
        lines.append(f"{seconds:.6g} s, {(count - 1) / seconds:.6g} scans a second")
    by_status = ", ".join(f"{number} {status}" for status, number in shapes.most_common())
    lines.append(f"shapes: {by_status or 'none'}")
    if unread:
        why = "the computer was behind, or they could not be used"
        why = why if source.about.get("method") else "nothing was reconstructed"
        lines.append(
            f"shapes are not known of {unread} scan(s): {why}; "
            f"`tacstrip record {file} -o NEW.mcap --reconstruct METHOD` adds them"
        )
    if tracks:
        by_number = ", ".join(f"object {number} in {scans} scans" for number, scans in sorted(tracks.items()))
        lines.append(f"objects over time: {by_number}")
    if unknown:
        lines.append(
            f"objects over time were not known yet in {unknown} scan(s): `tacstrip track {file}` finds them"
        )
    shown = ("source", "sensor", "method", "made")
    return lines + [f"{key}: {text}" for key, text in source.about.items() if key in shown and text]
