"""The polygon fit on strips as wide as they are, resolved by networks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.arrays import FloatArray
from tacstrip.contact.signature import signatures
from tacstrip.contact.strip_width import wide_ends
from tacstrip.geometry.outline import Outline
from tacstrip.network.strips.resolved import wide_readings
from tacstrip.reconstruction.cramer_rao import reading_sigma, vertex_covariance, vertex_jacobian
from tacstrip.reconstruction.polygon.estimate import fit_polygon
from tacstrip.reconstruction.polygon.wide_fit import contradicted_by_outer_strip
from tacstrip.reconstruction.strip_width import OnWideStrips, equivalent_ends, has_corner, remove_width_effect
from tacstrip.tracking.tracker import Tracker

SIZE = {"strips": 40, "pitch_mm": 3.25, "length_mm": 130.0, "strip_width_mm": 3.0, "contact_lambda_mm": 2.0}
SENSORS = {name: ts.Sensor(construction=name, **SIZE) for name in ("crs-crs", "crs-m")}  # type: ignore[arg-type]
TRUTH = np.array([(14.0, 60.0), (55.0, 22.0), (117.0, 48.0), (80.0, 96.0), (35.0, 88.0)])


@pytest.fixture(scope="module", params=SENSORS)
def unit(request: pytest.FixtureRequest) -> tuple[ts.Sensor, dict[str, FloatArray]]:
    sensor = SENSORS[request.param]
    return sensor, wide_readings(sensor, ts.Contact.polygon(TRUTH), across=6)


def test_the_closed_form_of_a_wide_strip_is_the_networks(
    unit: tuple[ts.Sensor, dict[str, FloatArray]],
) -> None:
    """But for strips that are covered in part, or have a corner on them."""
    sensor, read = unit
    outline, x = Outline.of(TRUTH), sensor.x_mm
    wide = signatures(sensor, *equivalent_ends(sensor, outline, x))
    thin = signatures(sensor, *(np.interp(x, *c.T) for c in (outline.lower, outline.upper)))
    far = np.abs(x[:, None] - TRUTH[:, 0]).min(axis=1) > sensor.strip_width
    inside = np.isfinite(next(iter(read.values()))) & far
    assert np.count_nonzero(inside) > 15
    for name, k in read.items():
        off, plainly = (np.abs(model[name] - k)[inside].max() for model in (wide, thin))
        assert off < 5e-4
        assert off < 0.2 * plainly


def test_without_noise_the_vertices_come_back() -> None:
    sensor = SENSORS["crs-crs"]
    read = wide_readings(sensor, ts.Contact.polygon(TRUTH), across=6)
    wide, thin = (
        fit_polygon(ts.Scan(time_s=0.0, **read), replace(sensor, strip_width_mm=w), None, vertices=5).objects[
            0
        ]
        for w in (3.0, None)
    )
    error, plainly = (np.sqrt(((o.vertices - Outline.of(TRUTH).vertices) ** 2).mean()) for o in (wide, thin))
    assert error < 0.1 * plainly
    assert error < 0.01 * sensor.pitch_mm


def test_noisy_readings_are_used_up_to_the_bound_and_regions_hold(
    unit: tuple[ts.Sensor, dict[str, FloatArray]],
) -> None:
    sensor, read = unit
    noise, truth = ts.Noise(positional=0.003), Outline.of(TRUTH).vertices
    bound = np.trace(vertex_covariance(Outline.of(TRUTH), sensor, reading_sigma(noise, sensor)))
    random = np.random.default_rng(2)
    squares, inside = [], []
    for _ in range(60):
        noisy = {name: k + random.uniform(-0.003, 0.003, len(k)) for name, k in read.items()}
        o = fit_polygon(
            ts.Scan(time_s=0.0, **noisy), sensor, noise, bounded=False, vertices=5, assessment="none"
        ).objects[0]
        assert o.covariance is not None
        error = o.vertices - truth
        squares.append((error**2).sum())
        for i, e in enumerate(error):
            inside.append(e @ np.linalg.pinv(o.covariance[2 * i : 2 * i + 2, 2 * i : 2 * i + 2]) @ e < 5.991)
    assert np.sqrt(np.median(squares) / bound) < 1.25
    assert np.mean(inside) > 0.85


def test_bounds_and_bridges_know_of_the_width() -> None:
    sensor = SENSORS["crs-crs"]
    read = wide_readings(sensor, ts.Contact.polygon(TRUTH), across=6)
    random = np.random.default_rng(3)
    noisy = {name: k + random.uniform(-0.005, 0.005, len(k)) for name, k in read.items()}
    for k in noisy.values():
        k[20] = np.nan
    o = fit_polygon(
        ts.Scan(time_s=0.0, **noisy), sensor, ts.Noise(positional=0.005), assessment="fast"
    ).objects[0]
    assert o.strips == slice(4, 36)
    assert "20 reads nothing inside" in o.advice or "21 reads nothing inside" in o.advice
    assert o.guarantee is not None
    assert ts.mismatch(TRUTH, o.vertices).iou > 0.96


def test_what_the_width_adds_vanishes_with_it() -> None:
    sensor = replace(SENSORS["crs-crs"], strip_width_mm=1e-6)
    readings = {"kh": np.array([0.5, 0.6]), "kl": np.array([0.4, 0.5])}
    thin = remove_width_effect(sensor, Outline.of(TRUTH), np.array([50.0, 70.0]), readings)
    for name, k in readings.items():
        np.testing.assert_allclose(thin[name], k, atol=1e-7)


def _shape(seed: int) -> ts.Contact:
    random = np.random.default_rng(seed)
    angle = np.sort(random.uniform(0.0, 2.0 * np.pi, 7)) + random.uniform(0.0, 6.0)
    return ts.Contact.polygon(np.stack([65.0 + 45.0 * np.cos(angle), 62.0 + 40.0 * np.sin(angle)], axis=1))


@pytest.mark.parametrize(("name", "lam"), [("crs-crs", 2.0), ("crs-m", 0.0)])
def test_a_given_width_simulates_the_resolved_strip(name: str, lam: float) -> None:
    """Corners on strips and strips covered in part too; a width that is not given changes nothing."""
    sensor = ts.Sensor(
        construction=name,
        strips=10,
        pitch_mm=13.0,
        length_mm=325.0,
        strip_width_mm=3.0,
        contact_lambda_mm=lam,
    )
    contact = _shape(1).moved(0.0, 100.0)
    read, scan = wide_readings(sensor, contact), ts.simulate(sensor, contact)
    for signature, k in read.items():
        np.testing.assert_array_equal(np.isnan(scan[signature]), np.isnan(k))
        assert np.nanmax(np.abs(scan[signature] - k)) < 1e-4
    plain = replace(sensor, strip_width_mm=None)
    l, u = ts.footprint(plain, contact)
    for signature, k in signatures(plain, l, u).items():
        np.testing.assert_array_equal(ts.simulate(plain, contact)[signature], k)


def test_what_is_simulated_is_the_limit_of_fine_cells() -> None:
    """Ideal contact on strips of 5 % of L: 32 cells across are off by 1e-4 of Vref."""
    sensor = ts.Sensor(construction="crs-crs", strips=4, pitch_mm=5.0, length_mm=100.0, strip_width_mm=5.0)
    contact = ts.Contact.polygon([(0, 12), (7.5, 54), (20, 70), (20, 85), (0, 56)])
    scan = ts.simulate(sensor, contact)
    coarse, middle, fine = (wide_readings(sensor, contact, across=n)["kh"] for n in (16, 32, 64))
    limit = fine + (fine - middle) ** 2 / (2.0 * middle - coarse - fine)
    assert np.abs(middle - scan["kh"]).max() > 8e-5
    assert np.abs(limit - scan["kh"]).max() < 3e-5


def test_corners_on_wide_strips_are_in_the_fit() -> None:
    """Ideal contact, strips as wide as the pitch, noise of .03 %: the corners come back, and their regions hold."""
    sensor = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0, strip_width_mm=5.0)
    truth = np.array([(13.0, 48.0), (47.0, 15.0), (88.0, 52.0), (56.0, 86.0)])
    noise, read = ts.Noise(positional=0.0003), wide_readings(sensor, ts.Contact.polygon(truth))
    for seed in range(3):
        errors = np.random.default_rng(seed).uniform(-3e-4, 3e-4, (2, 20))
        scan = ts.Scan(kh=read["kh"] + errors[0], kl=read["kl"] + errors[1])
        found = fit_polygon(scan, sensor, noise, bounded=False, vertices=4, assessment="none").objects[0]
        assert found.covariance is not None
        for i, off in enumerate(found.vertices - truth):
            own = found.covariance[2 * i : 2 * i + 2, 2 * i : 2 * i + 2]
            assert off @ np.linalg.pinv(own) @ off < 13.8  # 99.9 %
        assert np.abs(found.vertices - truth).max() < 0.1


def test_a_given_width_is_simulated_in_closed_form_for_streams() -> None:
    """Exact on strips under straight edges; with a corner or in part within 2e-3 of Vref."""
    sensor = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=6.5, length_mm=325.0, strip_width_mm=3.0)
    contact = _shape(1).moved(0.0, 100.0)
    read, ends = wide_readings(sensor, contact), wide_ends(sensor, [contact])
    assert ends.exact.sum() >= 3
    closed = signatures(sensor, ends.l[0], ends.u[0])
    for signature, k in read.items():
        off = np.abs(closed[signature] - k)
        assert off[ends.exact[0]].max() < 1e-4
        assert np.nanmax(off) < 4e-3
    source = ts.SimulatedSource(replace(sensor, adc_bits=16), lambda time_s: contact, scans=3)
    codes = [raw.codes["kh"] / 65535.0 for raw in source]
    assert np.abs(codes[2] - np.nan_to_num(closed["kh"])).max() < 1e-5


def test_the_bound_is_that_of_the_resolved_strip() -> None:
    """Slopes of readings by the vertices, against differences of the network, on strips under straight edges."""
    sensor = replace(SENSORS["crs-crs"], contact_lambda_mm=0.0)
    outline, step = Outline.of(TRUTH), 0.2
    slopes = vertex_jacobian(outline, sensor, ["kh"])
    x = sensor.x_mm[outline.touches(sensor.x_mm - 1.5) | outline.touches(sensor.x_mm + 1.5)]
    far = np.flatnonzero(np.abs(x[:, None] - TRUTH[:, 0]).min(axis=1) > sensor.strip_width)[::6]
    strips = [int(np.argmin(np.abs(sensor.x_mm - x[i]))) for i in far]
    for place in (2, 3, 5, 9):
        moved = [np.array(outline.vertices) for _ in range(2)]
        moved[0].flat[place] -= step
        moved[1].flat[place] += step
        low, high = (
            wide_readings(sensor, ts.Contact.polygon(v), across=16, strips=strips)["kh"][strips]
            for v in moved
        )
        np.testing.assert_allclose(slopes[far, place], (high - low) / (2.0 * step), rtol=0.02, atol=1e-4)


def test_the_tracker_knows_of_the_width() -> None:
    sensor = replace(SENSORS["crs-crs"], contact_lambda_mm=0.0)
    contacts = [ts.Contact.polygon(TRUTH).moved(0.2 * i, 0.3 * i) for i in range(4)]
    errors = {}
    for width in (3.0, None):
        tracker = Tracker(replace(sensor, strip_width_mm=width))
        for contact in contacts:
            found = tracker.update(ts.Scan(**wide_readings(sensor, contact, across=6)))  # type: ignore[arg-type]
        shape = found[0].shape
        errors[width] = 1.0 - ts.mismatch(contacts[-1].vertices, shape.vertices).iou
    assert errors[3.0] < 0.6 * errors[None]


def test_slopes_on_strips_with_corners_are_exact() -> None:
    """By the vertices, of an outline with an upright and a pointed end, against differences."""
    sensor = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0, strip_width_mm=5.0)
    outline = Outline.of([(13.0, 48.0), (47.0, 15.0), (88.0, 40.0), (88.0, 52.0), (56.0, 86.0)])
    x, step = sensor.x_mm, 2e-3
    cornered = np.asarray(has_corner(sensor, outline.vertices, x).any(axis=1))
    slopes = OnWideStrips(sensor, outline, x).slopes()[:, cornered].reshape(2, -1, 5, 2)
    for vertex in range(5):
        ways = (
            [(0.0, 1.0)] if vertex in (2, 3) else [(1.0, 0.0), (0.0, 1.0)]
        )  # the upright end keeps its one x
        for way in ways:
            ends = []
            for by in (-step, step):
                moved = outline.vertices.copy()
                moved[vertex] += by * np.array(way)
                ends.append(OnWideStrips(sensor, Outline.of(moved), x).ends[:, cornered])
            expected = (ends[1] - ends[0]) / (2.0 * step)
            np.testing.assert_allclose(slopes[:, :, vertex] @ way, expected, atol=2e-3)


@pytest.mark.parametrize("lam", [0.0, 0.5, 2.5])
@pytest.mark.parametrize("construction", ["crs-crs", "crs-m"])
def test_fits_and_simulation_read_as_resolved_strips(construction: str, lam: float) -> None:
    """Edges slanted by 1.5, some widths apart, near the border, with corners: closed forms are off by 5e-3 of Vref."""
    sensor = ts.Sensor(
        construction=construction, strips=20, pitch_mm=5.0, length_mm=100.0, strip_width_mm=4.9, contact_lambda_mm=lam
    )  # fmt: skip
    for shape in (
        [(21, 12), (62, 71), (62, 90), (21, 40)],
        [(21, 30), (74, 44), (74, 56), (21, 35)],
        [(21, 1), (74, 9), (74, 30), (21, 20)],
        [(23, 40), (48, 15), (71, 55), (40, 80)],
    ):
        contact, outline = ts.Contact.polygon(shape), Outline.of(shape)
        made, scan = wide_readings(sensor, contact), ts.simulate(sensor, contact)
        on = np.isfinite(next(iter(made.values())))
        of_fit = signatures(sensor, *OnWideStrips(sensor, outline, sensor.x_mm[on]).ends)
        for name, k in made.items():
            np.testing.assert_allclose(of_fit[name], k[on], atol=5e-5)
            np.testing.assert_allclose(scan[name][on], k[on], atol=5e-5)


@pytest.mark.parametrize("construction", ["crs-crs", "crs-m"])
def test_bars_for_calibration_read_as_on_centre_lines(construction: str) -> None:
    """Level ones and such as lie askew by 4 degrees, which is what `calibrate` takes them for."""
    sensor = ts.Sensor(
        construction=construction, strips=20, pitch_mm=5.0, length_mm=100.0, strip_width_mm=4.9, contact_lambda_mm=2.0
    )  # fmt: skip
    for rise in (0.0, 7.0):
        bar = ts.Contact.polygon([(0, 40), (100, 40 + rise), (100, 50 + rise), (0, 50)])
        made = signatures(sensor, *ts.footprint(sensor, bar))
        for name, k in wide_readings(sensor, bar).items():
            np.testing.assert_allclose(made[name], k, atol=1e-4)


def test_few_strips_and_garbage() -> None:
    sensor, random = SENSORS["crs-crs"], np.random.default_rng(5)
    for strips in range(1, 40, 3):
        k = np.full((2, 40), np.nan)
        k[:, 40 - strips :] = random.uniform(size=(2, strips))
        for o in fit_polygon(ts.Scan(kh=k[0], kl=k[1]), sensor, assessment="fast").objects:
            assert o.status == "ok" or o.advice
            if o.found:
                assert o.vertices[:, 1].min() >= 0.0
                assert o.vertices[:, 1].max() <= sensor.length_mm


def test_a_wide_strip_that_is_covered_by_a_sliver_is_no_faulty_channel() -> None:
    sensor = ts.Sensor(
        construction="crs-crs",
        strips=10,
        pitch_mm=6.5,
        length_mm=325.0,
        strip_width_mm=6.0,
        contact_lambda_mm=0.0,
    )
    contact = ts.Contact.polygon([(12, 100), (50, 110), (45, 190), (18, 170)])
    noise = ts.Noise(positional=0.003)
    for seed in range(6):
        (found,) = ts.reconstruct(ts.simulate(sensor, contact, noise, rng=seed), sensor, noise).objects
        overlap = ts.mismatch(contact.vertices, found.vertices).iou
        assert overlap >= 0.8 or found.status != "ok"


def test_the_count_is_right_and_corners_are_within_their_regions() -> None:
    """Forty strips of 2 % of L, noise of .1 %: taking the width away by turns may end in too many corners."""
    sensor = ts.Sensor(construction="crs-crs", strips=40, pitch_mm=2.0, length_mm=100.0, strip_width_mm=2.0)
    truth, noise = (
        Outline.of([(11.0, 48.0), (33.5, 17.0), (69.0, 52.0), (40.5, 83.0)]),
        ts.Noise(positional=0.001),
    )
    ideal, random = ts.simulate(sensor, ts.Contact.polygon(truth.vertices)), np.random.default_rng(4)
    noisy = {name: ideal[name] + random.uniform(-1e-3, 1e-3, 40) for name in ideal.signatures}
    found = fit_polygon(ts.Scan(**noisy), sensor, noise, bounded=False, assessment="none").objects[0]  # type: ignore[arg-type]
    assert found.covariance is not None
    assert found.vertices.shape == truth.vertices.shape
    for i, off in enumerate(found.vertices - truth.vertices):
        assert (
            off @ np.linalg.inv(found.covariance[2 * i : 2 * i + 2, 2 * i : 2 * i + 2]) @ off < 13.8
        )  # 99.9 %
    assert np.abs(found.vertices - truth.vertices).max() < 0.15


def test_the_outer_strips_tell_where_a_pointed_end_is() -> None:
    """By the others alone its x is within a pitch, 5 mm."""
    sensor = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0, strip_width_mm=5.0)
    truth, noise = (
        Outline.of([(16.0, 41.0), (52.0, 18.0), (84.0, 55.0), (47.0, 78.0)]),
        ts.Noise(positional=0.001),
    )
    ideal = ts.simulate(sensor, ts.Contact.polygon(truth.vertices))
    found = fit_polygon(ideal, sensor, noise, bounded=False, vertices=4, assessment="none").objects[0]
    assert found.covariance is not None
    ends = [0, 4]
    np.testing.assert_allclose(found.vertices.ravel()[ends], truth.vertices.ravel()[ends], atol=0.1)
    assert np.sqrt(np.diag(found.covariance)[ends]).max() < 0.3


def test_an_outline_that_ends_otherwise_on_the_outer_strips_is_contradicted() -> None:
    """Upright ends and pointed ones may read alike on all strips between."""
    sensor, x = replace(SENSORS["crs-m"], contact_lambda_mm=0.0), (20.5, 40.0)
    upright = np.array([(x[0], 30.0), (x[1], 30.0), (x[1], 70.0), (x[0], 70.0)])
    pointed = np.array([(19.8, 68.0), (24.0, 30.0), (x[1], 30.0), (x[1], 70.0), (24.0, 70.0)])
    scan = ts.Scan(time_s=0.0, **wide_readings(sensor, ts.Contact.polygon(upright)))
    (touched,) = scan.runs()
    inner = slice(touched.start + 1, touched.stop - 1)
    said = [
        contradicted_by_outer_strip(scan, sensor, touched, inner, Outline.of(v), known * np.eye(v.size), 1e-3)
        for v, known in ((upright, 1e-4), (pointed, 1e-4), (pointed, 100.0))
    ]
    assert said[0] == said[2] == ""
    assert said[1].startswith(f"strip {touched.start}, which the contact covers in part, reads ")
