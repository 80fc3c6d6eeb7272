"""Many scans at once: the readings of one by one, the distributions that are documented, threads, files, fits."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.errors import ArgumentError, ContactError, OptionError, ReadingError

SIZE: dict[str, Any] = {"strips": 40, "pitch_mm": 5.0, "length_mm": 200.0}
SENSORS = {
    "crs-crs": ts.Sensor(construction="crs-crs", adc_bits=12, **SIZE),
    "unequal strips, contact resistance, channels left out": ts.Sensor(
        construction="crs-crs", resistivity_ratio=4.0, contact_lambda_mm=3.0, without=("3:v_h", "5"), **SIZE
    ),
    "crs-m": ts.Sensor(construction="crs-m", **SIZE),
    "closed tube": ts.Sensor(construction="cyl-crs-m", radius_mm=100.0 / np.pi, **SIZE),
}
SHAPES = ts.Shapes(n=30, objects=(1, 3), size_mm=(20.0, 60.0), apart=False)


def _same(scans: ts.Scans, one: ts.Scan, i: int) -> None:
    assert scans.signatures == one.signatures
    for name in scans.signatures:
        np.testing.assert_allclose(scans[name][i], one[name], rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("name", SENSORS)
def test_readings_are_those_of_simulate(name: str) -> None:
    """Drawn shapes, and the same ones given: contacts that share strips too."""
    sensor = SENSORS[name]
    scans = ts.simulate_many(sensor, SHAPES, rng=1)
    contacts = [scans.contact(i) for i in range(len(scans))]
    given = ts.simulate_many(sensor, contacts)
    for i, contact in enumerate(contacts):
        one = ts.simulate(sensor, contact)
        _same(scans, one, i)
        _same(given, one, i)
        _same(given, given[i], i)
    assert given.l is not None
    assert given.u is not None
    np.testing.assert_array_equal(given.l, scans.l)
    np.testing.assert_array_equal(given.u, scans.u)


def test_round_objects_are_read_as_polygons_of_many_corners() -> None:
    """An edge of the polygon lies up to r (1 - cos(pi / 256)) inside."""
    sensor = SENSORS["crs-crs"]
    scans = ts.simulate_many(sensor, ts.Shapes(n=20, kinds={"circle": 1, "ellipse": 2}, size_mm=60.0), rng=2)
    assert scans.l is not None
    assert scans.labels is not None
    assert set(np.unique(scans.labels.kind)) == {2, 3}
    for i in range(len(scans)):
        l, _ = ts.footprint(sensor, scans.contact(i))
        both = np.isfinite(l) & np.isfinite(scans.l[i])
        assert both.sum() >= 5
        across = np.abs(sensor.x_mm - scans.labels.pose[i, 0, 0])  # near its ends an ellipse is steep
        inside = both & (across < across[both].max() - 2.0 * sensor.pitch_mm)
        np.testing.assert_allclose(l[inside], scans.l[i][inside], atol=0.02)


def test_other_constructions_widths_and_lasting_errors_go_the_long_way() -> None:
    crp = ts.Sensor(
        construction="crs-crp",
        strips=5,
        pitch_mm=5.0,
        length_mm=40.0,
        contact_lambda_mm=1.0,
        resistivity_ratio=10.0,
    )
    scans = ts.simulate_many(crp, ts.Shapes(n=2, size_mm=18.0), rng=1)
    _same(scans, ts.simulate(crp, scans.contact(1)), 1)
    wide = ts.Sensor(construction="crs-crs", strip_width_mm=4.0, **SIZE)
    scans = ts.simulate_many(wide, ts.Shapes(n=3, size_mm=60.0), rng=1, model="closed")
    _same(scans, ts.simulate(wide, scans.contact(2), model="closed"), 2)
    noise, sensor = ts.Noise(offset=0.01, white=0.001), SENSORS["crs-m"]
    shapes = ts.Shapes(n=12, frames=4, travel=0.0, size_mm=60.0)
    still = ts.simulate_many(sensor, shapes, noise, rng=1)
    ideal = ts.simulate_many(sensor, shapes, rng=1)
    offset = np.nanmean(still["k"] - ideal["k"], axis=1).reshape(3, 4)
    assert (
        np.ptp(offset, axis=1).max() < 0.002 < np.ptp(offset[:, 0])
    )  # it lasts for a scene, and differs between them
    later = ts.simulate_many(
        sensor, ts.Shapes(n=5, frames=4, travel=0.0, size_mm=60.0), noise, rng=1, first=7
    )
    np.testing.assert_array_equal(later["k"], still["k"][7:])


def test_numbers_do_not_depend_on_threads_or_parts() -> None:
    sensor, noise = SENSORS["crs-crs"], ts.Noise(positional=0.004, white=0.001)
    whole = ts.simulate_many(sensor, ts.Shapes(n=3000, frames=7), noise, rng=9, workers=1, dtype="float32")
    threads = ts.simulate_many(sensor, ts.Shapes(n=3000, frames=7), noise, rng=9, workers=3, dtype="float32")
    part = ts.simulate_many(sensor, ts.Shapes(n=1000, frames=7), noise, rng=9, first=2000, dtype="float32")
    double = ts.simulate_many(sensor, ts.Shapes(n=100, frames=7), noise, rng=9)
    other = ts.simulate_many(sensor, ts.Shapes(n=100, frames=7), noise, rng=10)
    for name in ("kh", "kl"):
        assert whole[name].dtype == np.float32
        np.testing.assert_array_equal(whole[name], threads[name])
        np.testing.assert_array_equal(whole[name][2000:], part[name])
        np.testing.assert_array_equal(whole[name][:100], double[name].astype(np.float32))
        assert not np.array_equal(double[name], other[name], equal_nan=True)


def test_distributions_are_those_documented() -> None:
    """Ends, means and shares of what is drawn; 4,000 scenes, deviations within 4 standard errors."""
    sensor, n = SENSORS["crs-crs"], 4000
    shapes = ts.Shapes(
        n=n, corners=(3, 6), kinds={"polygon": 3, "circle": 1}, size_mm=(20.0, 60.0), aspect=0.5
    )
    labels = ts.simulate_many(sensor, shapes, rng=3).labels
    assert labels is not None
    polygons = labels.kind[:, 0] == 1
    assert abs(polygons.mean() - 0.75) < 4.0 * np.sqrt(0.75 * 0.25 / n)
    counts = np.bincount(labels.corners[polygons, 0], minlength=7)[3:]
    assert np.abs(counts / polygons.sum() - 0.25).max() < 4.0 * np.sqrt(0.25 * 0.75 / polygons.sum())
    size = 2.0 * labels.axes[:, 0, 0]
    assert size.min() >= 20.0
    assert size.max() <= 60.0
    assert abs(size.mean() - 40.0) < 4.0 * 40.0 / np.sqrt(12.0 * n)
    np.testing.assert_allclose(labels.axes[:, 0, 1] / labels.axes[:, 0, 0], np.where(polygons, 0.5, 1.0))
    x, radius = labels.pose[:, 0, 0], 0.5 * size
    across = (x - radius) / (sensor.width_mm - size)  # uniform where the object has room
    assert np.abs(np.quantile(across, [0.25, 0.5, 0.75]) - [0.25, 0.5, 0.75]).max() < 4.0 * 0.5 / np.sqrt(n)
    inside = labels.vertices[polygons, 0]
    assert np.nanmin(inside) >= 0.0
    assert np.nanmax(inside) <= 200.0
    first = ts.Contact.polygon(inside[0, : labels.corners[polygons, 0][0]])
    np.testing.assert_allclose(first.vertices, inside[0, : len(first.vertices)])  # counter-clockwise
    noise = ts.Noise(positional=0.003, distribution="normal", white=0.004)
    ideal, noisy = (
        ts.simulate_many(SENSORS["crs-m"], ts.Shapes(n=2000), e, rng=3)["k"] for e in (None, noise)
    )
    errors = (noisy - ideal)[np.isfinite(ideal)]
    sigma = np.sqrt(0.003**2 / 3.0 + 0.004**2)
    assert abs(errors.std() / sigma - 1.0) < 4.0 / np.sqrt(2.0 * len(errors))
    assert abs(np.mean(np.abs(errors) > 1.96 * sigma) - 0.05) < 4.0 * np.sqrt(0.05 * 0.95 / len(errors))


def test_objects_apart_have_strips_of_their_own_also_while_they_move() -> None:
    sensor = SENSORS["crs-crs"]
    shapes = ts.Shapes(n=600, objects=3, frames=6, gap_mm=12.0, size_mm=(20.0, 50.0), spin_rad=1.0)
    scans = ts.simulate_many(sensor, shapes, rng=4)
    assert all(len(scan.runs()) == 3 for scan in scans)
    assert scans.labels is not None
    pose = scans.labels.pose.reshape(100, 6, 3, 3)
    steps = np.diff(pose, axis=1)
    np.testing.assert_allclose(steps, steps[:, :1].repeat(5, axis=1), atol=1e-9)  # straight, evenly
    assert np.abs(steps[..., :2]).max() > 5.0
    assert np.array_equal(scans.labels.scene, np.arange(600) // 6)


def test_scans_come_apart_and_together_and_from_files(tmp_path: Path) -> None:
    scans = ts.simulate_many(
        SENSORS["crs-crs"], ts.Shapes(n=5), ts.Noise(positional=0.01), rng=1, dtype="float32"
    )
    again = ts.Scans.of(list(scans))
    with pytest.raises(ts.ReadingError, match="scan 0 is a mean of several"):
        ts.Scans.of([ts.Scan.mean(list(scans)), scans[0]])
    np.testing.assert_array_equal(again["kh"], scans["kh"])
    assert (len(scans[1:3]), len(scans[np.asarray(scans.touched.any(axis=1))])) == (2, 5)
    scans.save(tmp_path / "scans.npz")
    loaded = ts.Scans.load(tmp_path / "scans.npz")
    assert loaded.labels is not None
    assert scans.labels is not None
    np.testing.assert_array_equal(loaded.labels.vertices, scans.labels.vertices)
    np.testing.assert_array_equal(loaded[3:].kl, scans[3:].kl)
    (tmp_path / "scans.npz").write_bytes(b"none")
    for broken in ("scans.npz", "absent.npz"):
        with pytest.raises(ReadingError, match=broken):
            ts.Scans.load(tmp_path / broken)


@pytest.mark.parametrize(
    ("error", "words", "given"),
    [
        (ContactError, "room for 200", {"size_mm": 300.0}),
        (ContactError, "with its centre from 30", {"size_mm": 60.0, "x_mm": 5.0}),
        (OptionError, "choose one of: polygon", {"kinds": "star"}),
        (OptionError, "the least and the greatest", {"corners": (6, 4)}),
        (OptionError, "whole number, 3 to 16", {"corners": 20}),
        (OptionError, "unknown key 'colour'", {"colour": 3}),
        (OptionError, "give apart=False too", {"objects": 2, "x_mm": (20.0, 50.0)}),
        (OptionError, "must be 0 to 1", {"travel": 2.0}),
    ],
)
def test_what_cannot_be_drawn_is_named(error: type[Exception], words: str, given: dict[str, Any]) -> None:
    with pytest.raises(error, match=words):
        ts.simulate_many(SENSORS["crs-crs"], ts.Shapes.from_dict({"n": 3, **given}))


def test_wrong_arguments_are_told() -> None:
    sensor = SENSORS["crs-m"]
    with pytest.raises(ArgumentError, match="a list of Contacts, or shapes to draw"):
        ts.simulate_many(sensor, [])
    full = ts.Contact.polygon([(0, 0), (20, 0), (20, 200), (0, 200)])
    with pytest.raises(ContactError, match="in scan 1 a contact covers strip 0 from end to end"):
        ts.simulate_many(sensor, [full.moved(0.0, 60.0), full])
    with pytest.raises(OptionError, match="give a seed"):
        ts.simulate_many(sensor, ts.Shapes(n=1), rng=-1)


def test_fits_in_processes_are_those_of_one_after_the_other() -> None:
    sensor, noise = SENSORS["crs-crs"], ts.Noise(positional=0.002)
    scans = ts.simulate_many(sensor, ts.Shapes(n=9, corners=4, size_mm=100.0), noise, rng=1)
    done: list[int] = []
    together = ts.fit_many(scans, sensor, noise, workers=2, progress=done.append)
    apart = [ts.reconstruct(scan, sensor, noise, assessment="fast") for scan in scans]
    assert done[-1] == 9
    assert done == sorted(done)
    for a, b in zip(together, apart, strict=True):
        assert a.status == b.status
        np.testing.assert_array_equal(a.objects[0].vertices, b.objects[0].vertices)
