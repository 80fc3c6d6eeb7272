"""The study of noise as it is: what a common offset leaves when the corners have given way."""

from __future__ import annotations

import numpy as np

import tacstrip as ts
from studies.noise import COUNTS, RUBBERS, SHAPES, coverage, least_offset


def test_an_offset_of_a_percent_looks_like_another_polygon() -> None:
    """One signature never tells it, two only a large one: a fit takes it for a contact that lies elsewhere."""
    sensor = ts.Sensor(construction="crs-crs", strips=40, pitch_mm=2.5, length_mm=100.0)
    scan = ts.simulate(sensor, ts.Contact.polygon(SHAPES[0]), ts.Noise(offset=0.01), rng=1)
    shift = float(np.nanmean(scan["kh"] - ts.simulate(sensor, ts.Contact.polygon(SHAPES[0]))["kh"]))
    found = ts.fit_polygon(scan, sensor, ts.Noise(white=0.001)).objects[0]
    assert found.status == "ok"
    moved = found.centroid[1] - ts.Contact.polygon(SHAPES[0]).centroid[1]
    assert abs(shift) > 0.003
    assert 50.0 < moved / shift < 110.0  # mm over Vref
    assert least_offset(40, SHAPES[0], ("kh", "kl")) > 0.015
    assert least_offset(40, SHAPES[0], ("kh",)) > 0.2
    assert least_offset(10, SHAPES[0], ("kh",)) == np.inf


def test_the_tables_can_be_made() -> None:
    for corners, areas, status in coverage(RUBBERS["1/f, strays and edges"], 1, 3).values():
        assert 0.5 < corners <= 1.0
        assert 0.3 < areas <= 1.0
        assert status.total() == 3
    assert COUNTS == (1, 16, 64)
