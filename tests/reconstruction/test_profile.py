"""Profile Reconstruction, and what every reconstruction returns."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

import tacstrip as ts
from polygons import convex_polygon, from_left
from tacstrip.reconstruction import profile_at
from tacstrip.reconstruction.contact_ends import closed_ends

SENSOR = ts.Sensor(construction="crs-crs", strips=1000, pitch_mm=1.0, length_mm=1000.0)
DART = np.array([(300.5, 480.0), (420.5, 500.0), (560.5, 470.0), (500.5, 610.0)])


@given(seed=st.integers(0, 10**9), corners=st.integers(3, 12), ratio=st.sampled_from([1.0, 0.2, 7.0]))
@settings(max_examples=60, deadline=None, derandomize=True)
def test_profile_comes_back_without_noise(seed: int, corners: int, ratio: float) -> None:
    sensor = ts.Sensor(
        construction="crs-crs", strips=1000, pitch_mm=1.0, length_mm=1000.0, resistivity_ratio=ratio
    )
    contact = ts.Contact.polygon(convex_polygon(seed, corners))
    found = ts.profile_reconstruction(ts.simulate(sensor, contact), sensor).objects[0]
    l, u = ts.footprint(sensor, contact)
    assert found.profile is not None
    x, low, high = found.profile
    np.testing.assert_array_equal(x, sensor.x_mm[found.strips])
    np.testing.assert_allclose(low, l[found.strips], rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(high, u[found.strips], rtol=0.0, atol=1e-9)


def test_a_concave_shape_comes_back_too() -> None:
    contact = ts.Contact.polygon(DART)
    found = ts.profile_reconstruction(ts.simulate(SENSOR, contact), SENSOR)
    assert found.status == "ok"
    recovered = found.objects[0]
    assert ts.mismatch(DART, profile_at(recovered, DART)).mc < 1e-9
    assert ts.mismatch(DART, recovered.vertices).iou > 0.999


def test_profile_at_keeps_the_originals_order() -> None:
    polygon = convex_polygon(11, 6)
    polygon[:, 0] = np.floor(polygon[:, 0]) + 0.5
    recovered = ts.profile_reconstruction(ts.simulate(SENSOR, ts.Contact.polygon(polygon)), SENSOR).objects[0]
    np.testing.assert_allclose(profile_at(recovered, polygon), polygon, atol=1e-9)
    np.testing.assert_allclose(profile_at(recovered, polygon[::-1]), polygon[::-1], atol=1e-9)
    with pytest.raises(ts.SignatureError, match="the object has no profile"):
        profile_at(ts.RecoveredObject(slice(0, 3)), polygon)


def test_contact_resistance_is_undone() -> None:
    lossy = ts.Sensor(
        construction="crs-crs", strips=200, pitch_mm=1.0, length_mm=300.0, contact_lambda_mm=5.0
    )
    ideal = ts.Sensor(construction="crs-crs", strips=200, pitch_mm=1.0, length_mm=300.0)
    contact = ts.Contact.polygon([(40.5, 150.0), (80.5, 110.0), (150.5, 140.0), (120.5, 190.0)])
    l, u = ts.footprint(lossy, contact)
    scan = ts.simulate(lossy, contact)
    assert scan.kh is not None
    assert scan.kl is not None
    low, high = closed_ends(lossy, scan.kh, scan.kl)
    np.testing.assert_allclose(low, l, atol=1e-6)
    np.testing.assert_allclose(high, u, atol=1e-6)
    low, high = closed_ends(ideal, scan.kh, scan.kl)  # eroded at both ends by up to lambda
    wide = u - l > 40.0
    np.testing.assert_allclose((low - l)[wide], 5.0, atol=0.01)
    np.testing.assert_allclose((u - high)[wide], 5.0, atol=0.01)


def test_noise_never_leaves_the_sensor() -> None:
    contact = ts.Contact.polygon([(300.5, 2.0), (500.5, 0.0), (700.5, 6.0), (600.5, 12.0)])
    for seed in range(20):
        found = ts.profile_reconstruction(
            ts.simulate(SENSOR, contact, ts.Noise(positional=0.02), rng=seed), SENSOR
        )
        assert found.objects[0].profile is not None
        _, l, u = found.objects[0].profile
        assert np.all((l >= 0.0) & (l <= u) & (u <= 1000.0))


def test_what_it_cannot_do_is_said() -> None:
    metal = ts.Sensor(construction="crs-m", strips=3, pitch_mm=1.0, length_mm=10.0)
    with pytest.raises(ts.SignatureError, match=r"needs kh and kl; this crs-m scan has only k. Use Vertex"):
        ts.profile_reconstruction(ts.Scan(k=np.array([0.1, 0.2, 0.3])), metal)
    small = ts.Sensor(construction="crs-crs", strips=3, pitch_mm=1.0, length_mm=10.0)
    with pytest.raises(ts.SignatureError, match="has only kh"):
        ts.profile_reconstruction(ts.Scan(kh=np.array([0.1, 0.2, 0.3])), small)
    one = ts.simulate(small, ts.Contact.points([1.5, 5.0]))
    found = ts.profile_reconstruction(one, small)
    assert found.status == "too few strips"
    assert "one strip is touched, at x = 1.5 mm, from y = 5 to 5 mm" in found.advice
    line = ts.simulate(small, ts.Contact.points([(0.5, 5.0), (1.5, 5.0), (2.5, 5.0)]))
    assert "a line, given as its profile" in ts.profile_reconstruction(line, small).advice
    empty = ts.Scan(kh=np.full(3, np.nan), kl=np.full(3, np.nan))
    assert ts.profile_reconstruction(empty, small).status == "no contact"


@given(seed=st.integers(0, 10**9), corners=st.integers(3, 9))
@settings(max_examples=50, deadline=None, derandomize=True)
def test_area_centroid_and_orientation_against_shapely(seed: int, corners: int) -> None:
    polygon = from_left(convex_polygon(seed, corners))
    found = ts.RecoveredObject(slice(0, 1), polygon)
    reference = shapely.Polygon(polygon)
    assert found.area == pytest.approx(reference.area, rel=1e-9)
    np.testing.assert_allclose(found.centroid, [reference.centroid.x, reference.centroid.y], rtol=1e-9)
    # Turning the shape until its long axis lies along x leaves no mixed moment.
    level = ts.Contact.polygon(polygon).turned(-found.orientation).vertices
    assert abs(np.remainder(ts.RecoveredObject(slice(0, 1), level).orientation + 1.0, np.pi) - 1.0) < 1e-6
    spread = np.ptp(level - level.mean(axis=0), axis=0)
    assert -np.pi / 2 < found.orientation <= np.pi / 2
    assert spread.min() > 0.0


def test_orientation_of_a_turned_rectangle() -> None:
    for degrees in (-80.0, -30.0, 0.0, 45.0, 85.0):
        rectangle = ts.Contact.polygon([(0, 0), (50, 0), (50, 20), (0, 20)]).turned(np.deg2rad(degrees))
        assert ts.RecoveredObject(slice(0, 1), rectangle.vertices).orientation == pytest.approx(
            np.deg2rad(degrees)
        )


def test_no_shape_has_no_numbers() -> None:
    nothing = ts.RecoveredObject(slice(0, 1), status="singular", advice="turn it")
    assert (nothing.found, nothing.area) == (False, 0.0)
    assert np.isnan(nothing.orientation)
    assert np.isnan(nothing.centroid).all()
    both = ts.Reconstruction("vertex", (ts.RecoveredObject(slice(0, 1), convex_polygon(1, 3)), nothing))
    assert (both.status, both.advice) == ("singular", "turn it")


def test_exchanged_wires_are_noticed() -> None:
    """The current flows down the strip: k_h is never below k_l."""
    scan = ts.simulate(SENSOR, ts.Contact.polygon(DART), ts.Noise(positional=0.005))
    assert ts.profile_reconstruction(scan, SENSOR).status == "ok"
    every = ts.profile_reconstruction(ts.Scan(kh=scan.kl, kl=scan.kh), SENSOR)
    assert every.status == "doubtful"
    assert "are v_h and v_l exchanged there" in every.advice
    kh, kl = np.array(scan["kh"]), np.array(scan["kl"])
    kh[450], kl[450] = kl[450], kh[450]
    one = ts.profile_reconstruction(ts.Scan(kh=kh, kl=kl), SENSOR)
    assert one.status == "doubtful"
    assert "k_h is below k_l on 1 of 261 strips (x = 450.5 mm)" in one.advice


def test_ten_thousand_strips_fit_into_memory() -> None:
    """A matrix over all ends would take 3.2 GB, one of the vertices 1 GB; smaller profiles have theirs."""
    noise = ts.Noise(positional=0.002)
    for strips, known in ((10_000, False), (1000, True)):
        sensor = ts.Sensor(
            construction="crs-crs", strips=strips, pitch_mm=1000.0 / strips, length_mm=1000.0, adc_bits=16
        )
        scan = ts.simulate(sensor, ts.Contact.polygon([(200, 300), (800, 200), (500, 800)]), noise)
        tracemalloc.start()
        found = ts.profile_reconstruction(scan, sensor, noise).objects[0]
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < 80e6
        assert len(found.vertices) > strips
        assert (found.covariance is not None) == known
        if found.covariance is not None:
            assert found.covariance.shape == (2 * len(found.vertices),) * 2
            assert np.linalg.eigvalsh(found.covariance[1:200:2, 1:200:2]).min() > 0.0
