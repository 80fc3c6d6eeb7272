"""Objects over time on strips of some width: what the width adds is taken away, or the track says that it is not."""

from __future__ import annotations

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.arrays import FloatArray

SHAPE = ts.Contact.polygon([(-24.0, -16.0), (22.0, -20.0), (16.0, 24.0)])
NOISE = ts.Noise(positional=0.003)


def scans_of(sensor: ts.Sensor, many: int = 16) -> tuple[list[ts.Scan], FloatArray]:
    """Return scans of a triangle that slides until strips have read all its corners, and these in the last one."""
    contacts = [SHAPE.turned(0.05 * i).placed(40.0 + 1.6 * i, 50.0) for i in range(many)]
    scans = [ts.simulate(sensor, c, NOISE, rng=i, time_s=0.02 * i) for i, c in enumerate(contacts)]
    return scans, contacts[-1].vertices


def sensor_of(width_mm: float | None) -> ts.Sensor:
    return ts.Sensor(
        construction="crs-crs", strips=10, pitch_mm=10.0, length_mm=100.0, strip_width_mm=width_mm
    )


def off_mm(found: FloatArray, true: FloatArray) -> float:
    """Return the largest distance of a true corner from the nearest one found."""
    return float(np.hypot(*(found[:, None] - true).T).min(axis=1).max())


def test_narrow_strips_are_fitted_as_wide_as_they_are() -> None:
    scans, true = scans_of(sensor_of(1.0))
    (one,) = ts.track(scans, sensor_of(1.0), NOISE)
    (as_lines,) = ts.track(scans, sensor_of(None), NOISE)
    assert one.status == "likely"
    assert "1 mm wide" in one.advice
    assert off_mm(one.placed(-1), true) < 0.5 * off_mm(as_lines.placed(-1), true)


def test_what_strips_nearly_as_wide_as_their_pitch_add_is_not_passed_over() -> None:
    scans, _ = scans_of(sensor_of(8.0))
    (one,) = ts.track(scans, sensor_of(8.0), NOISE)
    assert one.status == "doubtful"
    assert "8 mm wide" in one.advice
    single = one.single[-1]
    assert single is not None
    assert single.found


@pytest.mark.parametrize(("width_mm", "status"), [(None, "likely"), (1.0, "likely"), (8.0, "doubtful")])
def test_a_stream_says_what_it_leaves_out(width_mm: float | None, status: str) -> None:
    live = ts.LiveTracks(sensor_of(width_mm), NOISE)
    scans, _ = scans_of(sensor_of(width_mm), 12)
    for scan in scans:
        tracks = live.update(scan)
    assert [t.status for t in tracks] == [status] or (width_mm == 8.0 and not tracks)
    if width_mm != 8.0:  # of which no shape is known
        assert ["mm wide" in t.advice for t in tracks] == [width_mm is not None]


def test_a_concave_object_is_doubted() -> None:
    arrow = ts.Contact.polygon([(-20.0, -20.0), (25.0, 0.0), (-20.0, 20.0), (-5.0, 0.0)])
    sensor = sensor_of(1.0)
    scans = [
        ts.simulate(sensor, arrow.turned(0.06 * i).placed(40.0 + i, 50.0), NOISE, rng=i, time_s=0.02 * i)
        for i in range(12)
    ]
    assert {t.status for t in ts.track(scans, sensor, NOISE)} <= {"doubtful"}
