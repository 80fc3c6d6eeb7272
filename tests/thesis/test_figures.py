from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from tacstrip.contact.footprint import footprint
from tacstrip.contact.shape import Contact
from tacstrip.errors import OptionError
from tacstrip.geometry.metrics import mismatch, mismatch_coefficient
from tacstrip.reconstruction.vertex.blocks import blocks, linear_system
from tacstrip.reconstruction.vertex.estimate import vertex_reconstruction
from tacstrip.sensor.closed_form import k_h, k_l, k_metal
from tacstrip.sensor.spec import Sensor
from tacstrip.simulation import simulate
from tacstrip.surface.cylinder import strip_angle, strips_under_flat
from tacstrip.thesis import chapter2, chapter3, chapter4
from tacstrip.thesis.captions import by_number
from tacstrip.thesis.chapter5 import figures as chapter5
from tacstrip.thesis.shapes import SIMULATED

MODULES = (chapter2, chapter3, chapter4, chapter5)
NUMBERED = {number: draw for module in MODULES for number, draw in by_number(vars(module)).items()}
FIGURES = {number: cache(draw) for number, draw in NUMBERED.items()}  # drawn once
L = 1000.0
OWNER = {name: sensor for sensor in SIMULATED.values() for name in sensor.signatures}


def test_the_figures_are_those_asked_for() -> None:
    assert list(chapter2.FIGURES) == ["2.3", "2.4"]
    assert list(chapter3.FIGURES) == ["3.3", "3.4", "3.7", "3.10"]
    assert list(chapter4.FIGURES) == [f"4.{n}" for n in range(1, 11)]
    assert sorted(chapter5.FIGURES) == ["5.1", "5.14", "5.19", "5.2", "5.3", "5.32", "5.4", "5.61", "5.9"]


@pytest.mark.parametrize("number", FIGURES)
def test_a_figure_has_a_caption(number: str) -> None:
    """test_reproduce.py draws it, and sees that its axes are named."""
    caption = (FIGURES[number].__doc__ or "").splitlines()[0]
    assert len(caption) > 30
    assert caption.endswith(".")


@pytest.mark.parametrize("n", [10, 100, 1000])
def test_the_comparison_is_that_of_the_thesis(n: int) -> None:
    rows = {row["sensor"]: row for row in chapter2.comparison_table(n, sample_us=50.0)}
    costs = {name: (row["samples"], row["connectors"]) for name, row in rows.items()}
    assert costs == {
        "analog four-wire": (2, 4),
        "hybrid CRS-CRS, k_h or k_l": (n, n + 2),
        "hybrid CRS-M, k": (n, 2 * n + 2),
        "hybrid CRS-CRS, k_h and k_l": (2 * n, 2 * n + 2),
        "digital": (n * n, 2 * n),
    }
    assert rows["digital"]["scan_ms"] == pytest.approx(0.05 * n * n)
    with pytest.raises(OptionError, match="n = 0: must be a whole number"):
        chapter2.comparison_table(0)


@pytest.mark.parametrize(("model", "at_full_length"), [(k_h, 1.0), (k_l, 0.0), (k_metal, None)])
def test_a_surface_covers_the_legal_triangle(model: chapter3.Model, at_full_length: float | None) -> None:
    l, w, k = chapter3.surface_net(model)
    assert np.all((l + w <= 1.0 + 1e-12) & (l >= 0.0) & (w >= 0.0))
    assert np.all((k >= 0.0) & (k <= 1.0 + 1e-12))
    np.testing.assert_allclose(k[0], l[0])  # a point contact divides the strip
    assert w.max() > 0.99
    if at_full_length is None:
        np.testing.assert_allclose([k[-1].min(), k[-1].max()], [0.0, 1.0], atol=1e-9)
    else:
        np.testing.assert_allclose(k[-1], at_full_length, atol=0.01)


def test_3_10_a_strip_count_is_that_of_the_picture() -> None:
    """Turned all the way over the middle strips, a flat touches the counted fewest and most, never others."""
    sensor = Sensor.load("prototype-cyl-crs-m")
    pitch = float(np.diff(strip_angle(sensor, np.array([0.0, 1.0])))[0])
    middle = float(strip_angle(sensor, np.array(2.0)))
    for depth in (0.05, 0.2, 0.6, 1.0):
        angles = np.linspace(middle - 0.5 * pitch, middle + 0.5 * pitch, 401)
        counts = {int(chapter3.strips_touched_by_flat(sensor, float(a), depth).sum()) for a in angles}
        assert counts == set(strips_under_flat(sensor, depth)), depth
    assert strips_under_flat(sensor, 0.6) == (2, 3)
    assert chapter3.strips_touched_by_flat(sensor, middle, 0.6).tolist() == [False, True, True, True, False]


def test_3_10_two_strips_at_most_need_a_shallow_dent() -> None:
    """Most is 2 while the arc and a strip's width stay below two pitches: arc < 5 mm on a radius of 9 mm."""
    sensor = Sensor.load("prototype-cyl-crs-m")
    limit = chapter3.depth_limit(sensor, 2)
    assert limit == pytest.approx(9.0 * (1.0 - np.cos(2.5 / 9.0)), abs=0.01)
    assert strips_under_flat(sensor, limit)[1] == 2
    assert strips_under_flat(sensor, limit + 0.02)[1] == 3


@pytest.mark.parametrize(("number", "name"), [("4.2", "kh"), ("4.3", "kl"), ("4.4", "k")])
def test_4_2_to_4_4_draw_what_the_sensor_reads(number: str, name: str) -> None:
    """(4.1), (4.2), (4.3): how far the pseudo-centre lies from l + w / 2."""
    lines = FIGURES[number]().axes[1].get_lines()
    assert [line.get_label() for line in lines[:3]] == list(chapter4.PLACES)
    for line, place in zip(lines, chapter4.PLACES.values(), strict=False):
        contact = chapter4.TETRAGON.placed(*place)
        k, (l, u) = simulate(OWNER[name], contact)[name], footprint(OWNER[name], contact)
        above = {"kh": 0.5 * k, "kl": 0.5 * (k - 1.0), "k": k - 0.5}[name] * (u - l)
        np.testing.assert_allclose(np.asarray(line.get_ydata(), dtype=float), above, atol=1e-9)


def test_4_5_two_different_shapes_have_one_and_the_same_k_h() -> None:
    x, y = chapter4.same_kh_pair()
    scans = [simulate(SIMULATED["crs-crs"], Contact.polygon(p)) for p in (x, y)]
    np.testing.assert_array_equal(scans[0].touched, scans[1].touched)
    assert scans[0].touched.sum() == 700
    np.testing.assert_allclose(scans[0]["kh"], scans[1]["kh"], rtol=0.0, atol=1e-15)
    assert np.nanmax(np.abs(scans[0]["kl"] - scans[1]["kl"])) > 0.1
    compared = mismatch(x, y)
    assert compared.mc > 0.25
    assert compared.iou < 0.85
    assert _turns(x).min() > 0.0
    assert _turns(y).min() < 0.0


def test_4_5_vertex_reconstruction_finds_the_convex_one_from_either() -> None:
    x, y = chapter4.same_kh_pair()
    for corners in (x, y):
        scan = simulate(SIMULATED["crs-crs"], Contact.polygon(corners))
        found = vertex_reconstruction(
            scan, SIMULATED["crs-crs"], signature="kh", transitions=np.sort(x[:, 0])
        )
        assert found.status == "ok"
        np.testing.assert_allclose(found.objects[0].vertices, x, atol=1e-6)


def test_4_5_the_fork_is_met_in_two_pieces_from_notch_to_tip() -> None:
    sensor = SIMULATED["crs-crs"]
    touch = footprint(sensor, chapter4.FORK)
    np.testing.assert_array_equal(touch.pieces > 1, (sensor.x_mm > 420.0) & (sensor.x_mm < 800.0))
    assert touch.pieces.max() == 2


@pytest.mark.parametrize("name", ["kh", "kl", "k"])
@pytest.mark.parametrize(("contact", "sign"), [(chapter4.UPPER_VERTEX, -1.0), (chapter4.LOWER_VERTEX, 1.0)])
def test_4_7_and_4_8_a_slope_drops_at_an_upper_vertex_and_rises_at_a_lower_one(
    contact: Contact, sign: float, name: str
) -> None:
    """The jump is the edge's jump times the derivative of the closed form: the table of the design."""
    p, k, slopes = chapter4.at_vertices(name, contact)
    edge = np.diff(p[:, 1]) / np.diff(p[:, 0])
    straight = p[0, 1] + (p[2, 1] - p[0, 1]) * (p[1, 0] - p[0, 0]) / (p[2, 0] - p[0, 0])
    l, u = sorted((p[1, 1], straight))
    d = (L if name == "k" else 2.0 * L) - (u - l)
    factor = {
        ("kh", -1.0): 2.0 * (L + l), ("kh", 1.0): 2.0 * (L - u), ("kl", -1.0): 2.0 * l,
        ("kl", 1.0): 2.0 * (2.0 * L - u), ("k", -1.0): l, ("k", 1.0): L - u,
    }[name, sign] / d**2  # fmt: skip
    jump = slopes[0, 1] - slopes[0, 0]
    assert np.sign(jump) == sign
    assert jump == pytest.approx(factor * (edge[1] - edge[0]), rel=1e-6)
    assert k[[0, 2]] * L == pytest.approx(p[[0, 2], 1])  # l = u at the ends


def test_4_9_the_equations_of_the_blocks_give_the_hexagon_back() -> None:
    p, k, slopes = chapter4.at_vertices("kh", chapter4.HEXAGON)
    upper = np.pad(slopes[:, 1] < slopes[:, 0], 1)
    assert upper.tolist() == [False, True, False, True, False, False]
    assert blocks(upper) == [(0, 2), (1, 3), (2, 4), (3, 5)]
    matrix, right = linear_system(p[:, 0], k, upper, (k[0] * L, k[-1] * L), SIMULATED["crs-crs"], "kh")
    np.testing.assert_allclose(np.linalg.solve(matrix, right), p[1:-1, 1], atol=1e-6)
    assert len(FIGURES["4.9"]().axes) == 4


def test_4_10_has_three_blocks_that_share_a_section_each() -> None:
    _, _, slopes = chapter4.at_vertices("kh", chapter4.HEPTAGON)
    assert blocks(np.pad(slopes[:, 1] < slopes[:, 0], 1)) == [(0, 3), (2, 5), (4, 6)]


def test_5_1_draws_the_ends_that_strips_read() -> None:
    l, u = footprint(chapter5.SENSOR, chapter5.OBJECT)
    stairs = [p.get_data().values for p in _stairs(FIGURES["5.1"]())]
    np.testing.assert_array_equal(stairs, [l, u])


def test_5_2_errors_are_of_the_size_of_the_thesis_profiles() -> None:
    for axes in FIGURES["5.2"]().axes[2:]:
        heights = np.array([bar.get_height() for bar in axes.containers[0]])
        assert 0.5 < np.nanmax(np.abs(heights)) < 5.0


def test_5_3_a_turning_function_goes_round_once() -> None:
    s, theta = chapter5.turning_function(chapter5.A)
    np.testing.assert_allclose(s, [0.0, 0.3, 0.5, 0.8, 1.0])
    np.testing.assert_allclose(theta, [0.0, 0.5 * np.pi, np.pi, 1.5 * np.pi])


def test_5_4_the_shaded_area_is_the_mismatch_coefficient() -> None:
    a, b = chapter5.A, chapter5.B
    shaded, first, second = (p.get_data() for p in _stairs(FIGURES["5.4"]()))
    area = float(np.diff(shaded.edges) @ np.abs(shaded.values - shaded.baseline))
    assert area == pytest.approx(mismatch_coefficient(a, b), abs=1e-12)
    assert area > 0.1
    np.testing.assert_array_equal(shaded.values, first.values)
    np.testing.assert_array_equal(shaded.baseline, second.values)


def test_best_alignment_agrees_with_the_metric_on_many_pairs() -> None:
    rng = np.random.default_rng(5)
    for _ in range(20):
        a, b = (_star(rng, int(rng.integers(3, 8))) for _ in range(2))
        area, *_ = chapter5.best_alignment(a, b)
        assert area == pytest.approx(mismatch_coefficient(a, b), abs=1e-12)


def _star(rng: np.random.Generator, corners: int) -> Any:
    angle = 2.0 * np.pi * (np.arange(corners) + rng.uniform(0.0, 0.8, corners)) / corners
    return np.stack([np.cos(angle), np.sin(angle)], axis=1) * rng.uniform(0.6, 1.0, (corners, 1))


def _turns(corners: Any) -> Any:
    side = np.roll(corners, -1, axis=0) - corners
    after = np.roll(side, -1, axis=0)
    return side[:, 0] * after[:, 1] - side[:, 1] * after[:, 0]


def _stairs(figure: Any) -> list[Any]:
    return [p for p in figure.axes[-1].patches if hasattr(p, "get_data")]
