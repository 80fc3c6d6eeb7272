"""Vertex Reconstruction: exact without noise, and never a wrong polygon without a word."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import tacstrip as ts
from polygons import convex_polygon, from_left
from tacstrip.reconstruction.implausible import SCALE
from tacstrip.reconstruction.vertex.blocks import blocks, linear_system
from tacstrip.reconstruction.vertex.estimate import judge

CRS = ts.Sensor(construction="crs-crs", strips=1000, pitch_mm=1.0, length_mm=1000.0)
METAL = ts.Sensor(construction="crs-m", strips=1000, pitch_mm=1.0, length_mm=1000.0)
UNEQUAL = ts.Sensor(
    construction="crs-crs", strips=1000, pitch_mm=1.0, length_mm=1000.0, resistivity_ratio=0.3
)
TUBE = ts.Sensor(construction="cyl-crs-m", strips=1000, pitch_mm=1.0, length_mm=1000.0, radius_mm=200.0)
CASES = [(CRS, "kh"), (CRS, "kl"), (METAL, "k"), (UNEQUAL, "kh"), (UNEQUAL, "kl"), (TUBE, "k")]
IDS = ["equal kh", "equal kl", "metal k", "unequal kh", "unequal kl", "tube k"]


@pytest.mark.parametrize(("sensor", "signature"), CASES, ids=IDS)
@given(seed=st.integers(0, 10**9), corners=st.integers(3, 12))
@settings(max_examples=25, deadline=None, derandomize=True)
def test_vertices_come_back_without_noise(sensor: ts.Sensor, signature: str, seed: int, corners: int) -> None:
    polygon = convex_polygon(seed, corners)
    scan = ts.simulate(sensor, ts.Contact.polygon(polygon))
    found = ts.vertex_reconstruction(scan, sensor, signature=signature, transitions=np.sort(polygon[:, 0]))
    assert found.status == "ok" or SCALE in found.advice, (
        found.advice
    )  # what is low and flat may be another scale's
    np.testing.assert_allclose(found.objects[0].vertices, from_left(polygon), rtol=0.0, atol=1e-6)


@pytest.mark.parametrize(("sensor", "signature"), CASES, ids=IDS)
def test_nearest_strip_is_exact_where_vertices_lie_on_strips(sensor: ts.Sensor, signature: str) -> None:
    corners = np.array([(300.5, 500.0), (420.5, 380.0), (610.5, 430.0), (700.5, 520.0), (540.5, 640.0)])
    scan = ts.simulate(sensor, ts.Contact.polygon(corners))
    found = ts.vertex_reconstruction(
        scan, sensor, signature=signature, transitions=np.sort(corners[:, 0]), reading="strip"
    )
    assert found.status == "ok", found.advice
    np.testing.assert_allclose(found.objects[0].vertices, corners, rtol=0.0, atol=1e-8)


@pytest.mark.parametrize("signature", ["kh", "kl"])
def test_contact_resistance_is_undone(signature: str) -> None:
    """Readings of [l + T, u - T] give the true corners back where they lie on strips."""
    sensor = ts.Sensor(
        construction="crs-crs", strips=200, pitch_mm=1.0, length_mm=300.0, contact_lambda_mm=2.0
    )
    corners = np.array([(40.5, 150.0), (80.5, 110.0), (150.5, 140.0), (120.5, 190.0)])
    scan = ts.simulate(sensor, ts.Contact.polygon(corners))
    found = ts.vertex_reconstruction(
        scan, sensor, signature=signature, transitions=np.sort(corners[:, 0]), reading="strip"
    )
    np.testing.assert_allclose(found.objects[0].vertices, corners, rtol=0.0, atol=1e-6)
    ideal = ts.Sensor(construction="crs-crs", strips=200, pitch_mm=1.0, length_mm=300.0)
    naive = ts.vertex_reconstruction(
        scan, ideal, signature=signature, transitions=np.sort(corners[:, 0]), reading="strip"
    )
    assert np.abs(naive.objects[0].vertices - corners).max() > 1.0  # the test would notice no correction


def test_the_printed_system() -> None:
    """(4.34): a hexagon whose vertices are up, down, up, down, row by row over the opposite weight."""
    x = np.array([0.0, 1.0, 2.5, 3.0, 4.5, 6.0])
    k = np.array([0.30, 0.42, 0.25, 0.5, 0.37, 0.33])
    upper = np.array([False, True, False, True, False, False])
    sensor = ts.Sensor(construction="crs-crs", strips=7, pitch_mm=1.0, length_mm=100.0)
    y1, y6 = k[0] * 100.0, k[5] * 100.0
    matrix, right = linear_system(x, k, upper, (y1, y6), sensor, "kh")
    opposite = np.where(upper, 1.0 - k, 1.0 + k)[1:-1] / 2.0
    k2, k3, k4, k5 = k[1:-1]

    def run(a: int, b: int) -> float:
        return float(x[b - 1] - x[a - 1])

    expected = [
        [(1 + k2) / (1 - k2), run(1, 2) / run(1, 3), 0.0, 0.0],
        [run(3, 4) / run(2, 4), (1 - k3) / (1 + k3), run(2, 3) / run(2, 4), 0.0],
        [0.0, run(4, 5) / run(3, 5), (1 + k4) / (1 - k4), run(3, 4) / run(3, 5)],
        [0.0, 0.0, run(5, 6) / run(4, 6), (1 - k5) / (1 + k5)],
    ]
    rhs = [
        2 * k2 * 100 / (1 - k2) - run(2, 3) / run(1, 3) * y1,
        2 * k3 * 100 / (1 + k3),
        2 * k4 * 100 / (1 - k4),
        2 * k5 * 100 / (1 + k5) - run(4, 5) / run(4, 6) * y6,  # print: garbled
    ]
    np.testing.assert_allclose(matrix / opposite[:, None], expected, rtol=1e-12)
    np.testing.assert_allclose(right / opposite, rhs, rtol=1e-12)


@pytest.mark.parametrize(
    ("sides", "expected"),
    [
        ("lll", [(0, 4)]),  # type II: from end to end
        ("ul", [(0, 2), (1, 3)]),  # I, III
        ("ulu", [(0, 2), (1, 3), (2, 4)]),  # I, IV, III
        ("uulu", [(0, 3), (2, 4), (3, 5)]),
        ("uullu", [(0, 3), (2, 5), (4, 6)]),
    ],
)
def test_neighbouring_blocks_share_one_section(sides: str, expected: list[tuple[int, int]]) -> None:
    assert blocks(np.array([False, *(s == "u" for s in sides), False])) == expected


def test_several_objects_in_one_scan() -> None:
    left, right = convex_polygon(3, 5, 400.0), convex_polygon(8, 4, 400.0) + np.array([500.0, 300.0])
    scan = ts.simulate(CRS, ts.Contact.polygon(left) + ts.Contact.polygon(right))
    x = np.sort(np.concatenate([left[:, 0], right[:, 0]]))
    found = ts.vertex_reconstruction(scan, CRS, signature="kh", transitions=x)
    assert [o.status for o in found.objects] == ["ok", "ok"]
    for recovered, polygon in zip(found.objects, (left, right), strict=True):
        np.testing.assert_allclose(recovered.vertices, from_left(polygon), atol=1e-6)


def test_default_signature_is_the_last_that_the_scan_has() -> None:
    polygon = convex_polygon(5, 5)
    scan = ts.simulate(CRS, ts.Contact.polygon(polygon), ts.Noise(positional=0.001))
    by_default = ts.vertex_reconstruction(scan, CRS, transitions=np.sort(polygon[:, 0]))
    by_name = ts.vertex_reconstruction(scan, CRS, signature="kl", transitions=np.sort(polygon[:, 0]))
    np.testing.assert_array_equal(by_default.objects[0].vertices, by_name.objects[0].vertices)


TRIANGLE = np.array([(300.5, 500.0), (500.5, 400.0), (700.5, 550.0)])


def _triangle(x: object, reading: str = "section", noise: ts.Noise | None = None) -> ts.Reconstruction:
    scan = ts.simulate(CRS, ts.Contact.polygon(TRIANGLE), noise or ts.Noise())
    return ts.vertex_reconstruction(scan, CRS, signature="kh", transitions=x, reading=reading)  # type: ignore[arg-type]


def test_status_shared_x() -> None:
    square = ts.Contact.polygon([(300.5, 300.0), (600.5, 300.0), (600.5, 600.0), (300.5, 600.0)])
    found = ts.vertex_reconstruction(
        ts.simulate(CRS, square), CRS, signature="kh", transitions=[300.5, 300.5, 600.5, 600.5]
    )
    assert found.status == "shared x"
    assert not found.objects[0].found
    assert "two vertices share x = 300.5 mm" in found.advice
    assert "turn the object a little" in found.advice


def test_status_too_few_transitions() -> None:
    found = _triangle([300.5, 700.5])
    assert found.status == "too few transitions"
    assert "2 transitions are a line at most, and a polygon needs 3" in found.advice


def test_status_too_few_strips() -> None:
    sensor = ts.Sensor(construction="crs-crs", strips=4, pitch_mm=10.0, length_mm=100.0)
    scan = ts.simulate(sensor, ts.Contact.polygon([(4.0, 50.0), (20.0, 30.0), (36.0, 45.0), (22.0, 70.0)]))
    found = ts.vertex_reconstruction(scan, sensor, signature="kh", transitions=[4.0, 12.0, 20.0, 22.0, 36.0])
    assert found.status == "too few strips"
    assert "4 strips are touched, and 5 vertices need as many readings" in found.advice
    one = ts.Scan(kh=np.array([np.nan, 0.4, np.nan, np.nan]))
    assert ts.vertex_reconstruction(one, sensor, transitions=[1.0, 2.0, 3.0]).status == "too few strips"


def test_status_same_strip() -> None:
    found = _triangle([300.5, 500.2, 500.4, 700.5], reading="strip")
    assert found.status == "too few strips"
    assert "the vertices at x = 500.2 and 500.4 mm are nearest to the same strip" in found.advice


def test_status_no_contact() -> None:
    found = ts.vertex_reconstruction(ts.Scan(kh=np.full(1000, np.nan)), CRS)
    assert (found.status, found.objects) == ("no contact", ())
    assert "no strip reads a contact" in found.advice


def test_status_too_noisy_and_doubtful() -> None:
    """Near the top a lower vertex hardly shows in k_h: noise must lead to a word, not to a silent shape."""
    near_top = ts.Contact.polygon([(300.5, 970.0), (350.5, 900.0), (420.5, 965.0), (400.5, 985.0)])
    x = [300.5, 350.5, 400.5, 420.5]
    seen = set()
    for seed in range(40):
        scan = ts.simulate(CRS, near_top, ts.Noise(positional=0.01), rng=seed)
        found = ts.vertex_reconstruction(scan, CRS, signature="kh", transitions=x)
        seen.add(found.status)
        if found.status == "ok":  # then it must be near
            assert ts.mismatch(near_top.vertices, found.objects[0].vertices).ape < 50.0
        else:
            assert found.advice
    assert {"too noisy", "doubtful"} <= seen


def test_a_concave_shape_comes_back_as_another_one() -> None:
    """Figure 5.19: a convex polygon nearly makes the same signature; without noise, "nearly" can be told."""
    dented = np.array([(300.5, 500.0), (500.5, 430.0), (600.5, 350.0), (700.5, 500.0), (450.5, 600.0)])
    scan = ts.simulate(CRS, ts.Contact.polygon(dented))
    found = ts.vertex_reconstruction(scan, CRS, signature="kl", transitions=np.sort(dented[:, 0]))
    assert found.status == "doubtful"
    assert "the object is not convex" in found.advice
    assert ts.mismatch(dented, found.objects[0].vertices).iou < 0.9


def test_a_missing_corner_is_doubted() -> None:
    """Sixteen strips, a tetragon, the transition of one corner left out, or all of them searched for."""
    sensor = ts.Sensor(construction="crs-crs", strips=16, pitch_mm=5.0, length_mm=200.0)
    tetragon = ts.Contact.polygon([(8, 90), (45, 50), (72, 110), (28, 150)])
    scans = [ts.simulate(sensor, tetragon, ts.Noise(positional=0.002), rng=seed) for seed in range(40)]

    def ok(x: object) -> int:
        found = [ts.vertex_reconstruction(scan, sensor, signature="kl", transitions=x) for scan in scans]  # type: ignore[arg-type]
        return sum(f.status == "ok" for f in found)

    assert ok([8.0, 28.0, 45.0, 72.0]) >= 38
    assert ok([8.0, 45.0, 72.0]) <= 2
    assert ok("gradient") <= 2  # its transitions are half a pitch off, or one is missing


def test_transitions_beside_the_contact_are_doubted() -> None:
    found = _triangle([250.5, 500.5, 700.5])
    assert found.status == "doubtful"
    assert "the vertex at x = 250.5 mm lies beside the touched strips (300.5 to 700.5 mm)" in found.advice


@pytest.mark.parametrize(
    ("corners", "weak", "status", "words"),
    [
        ([(0, 50), (20, 20), (60, 50), (30, 80)], [], "ok", ""),
        (
            [(0, 50), (20, 20), (60, 50), (30, 80)],
            [20.0],
            "doubtful",
            "the kink at x = 20 mm hides in the noise",
        ),
        (
            [(0, 50), (20, 20), (40, 25), (50, 10), (60, 50), (30, 80)],
            [],
            "doubtful",
            "the corner at x = 40, y = 25",
        ),
        ([(0, 50), (20, 60), (60, 50), (30, 30)], [], "too noisy", "upper and lower sides cross"),
        (
            [(0, 50), (20, -1), (60, 50), (30, 80)],
            [],
            "too noisy",
            "falls off the sensor, at x = 20, y = -1 mm",
        ),
        (
            [(0, 50), (20, 20), (60, 50), (30, 101)],
            [],
            "too noisy",
            "falls off the sensor, at x = 30, y = 101 mm",
        ),
    ],
)
def test_judging_a_polygon(
    corners: list[tuple[float, float]], weak: list[float], status: str, words: str
) -> None:
    sensor = ts.Sensor(construction="crs-crs", strips=60, pitch_mm=1.0, length_mm=100.0)
    found, advice = judge(sensor, np.array(corners, dtype=float), np.array(weak))
    assert found == status
    assert words in advice


def test_a_vertex_off_the_sensor_is_refused() -> None:
    """Readings that fall towards the ground faster than any contact can."""
    k = np.full(1000, np.nan)
    k[300:401] = np.concatenate([np.linspace(0.5, 0.02, 50), np.linspace(0.02, 0.5, 51)])
    found = ts.vertex_reconstruction(ts.Scan(kh=k), CRS, signature="kh", transitions=[300.5, 350.0, 400.5])
    assert found.status == "too noisy"
    assert "falls off the sensor" in found.advice


@pytest.mark.parametrize(
    ("keywords", "error", "message"),
    [
        ({"signature": "k"}, ts.SignatureError, "a crs-crs sensor has no signature 'k'; it has: kh, kl"),
        ({"signature": "kx"}, ts.SignatureError, "signature 'kx' does not exist; choose one of: kh, kl, k"),
        ({"reading": "mean"}, ts.OptionError, "reading 'mean' does not exist; choose one of: section, strip"),
        (
            {"transitions": "magic"},
            ts.OptionError,
            "transitions 'magic' does not exist; choose one of: auto, gradient",
        ),
        ({"transitions": [3.0, 2.0]}, ts.OptionError, "in ascending order"),
        ({"transitions": [1.0, np.nan, 2.0]}, ts.OptionError, "finite x"),
        ({"transitions": [1.0, 2.0, 1001.0]}, ts.OptionError, "the transition at 1001 mm is off the sensor"),
    ],
)
def test_options_that_cannot_be(keywords: dict[str, object], error: type[Exception], message: str) -> None:
    scan = ts.simulate(CRS, ts.Contact.polygon(TRIANGLE))
    with pytest.raises(error, match=message):
        ts.vertex_reconstruction(scan, CRS, **keywords)  # type: ignore[arg-type]


def test_a_scan_of_another_sensor_is_refused() -> None:
    with pytest.raises(ts.ReadingError, match="the scan has 5 strips and the sensor has 1000"):
        ts.vertex_reconstruction(ts.Scan(kh=np.full(5, 0.5)), CRS)
    with pytest.raises(ts.SignatureError, match="the scan has no 'kl'; it has: kh"):
        ts.vertex_reconstruction(ts.Scan(kh=np.full(1000, 0.5)), CRS, signature="kl")


@given(seed=st.integers(0, 10**9))
@settings(max_examples=60, deadline=None, derandomize=True)
def test_any_readings_give_a_shape_on_the_sensor_or_a_status(seed: int) -> None:
    random = np.random.default_rng(seed)
    sensor = ts.Sensor(construction="crs-m", strips=40, pitch_mm=2.0, length_mm=100.0)
    k = (
        random.uniform(0.0, 1.0, 40)
        if seed % 2
        else np.clip(0.5 + 0.1 * random.normal(size=40).cumsum(), 0.0, 1.0)
    )
    k[random.random(40) < 0.1] = np.nan
    x: object = "gradient" if seed % 3 else np.sort(random.uniform(0.0, 80.0, 6))
    for reading in ("section", "strip"):
        found = ts.vertex_reconstruction(ts.Scan(k=k), sensor, signature="k", transitions=x, reading=reading)  # type: ignore[arg-type]
        for recovered in found.objects:
            assert recovered.found == (recovered.status in ("ok", "doubtful"))
            assert recovered.found or recovered.advice
            if recovered.found:
                assert np.all(np.isfinite(recovered.vertices))
                assert recovered.vertices[:, 1].min() >= 0.0
                assert recovered.vertices[:, 1].max() <= 100.0
                assert recovered.area > 0.0
