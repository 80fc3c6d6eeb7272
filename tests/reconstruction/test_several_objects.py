"""Both signatures: one concave object, or several on the same strips; a faulty channel, or a second object."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from shapely import Point, Polygon, affinity

import tacstrip as ts
from polygons import DRAWN
from tacstrip.core.problem import FitProblem
from tacstrip.reconstruction.polygon.convexity import fit_convex

SENSOR = ts.Sensor(construction="crs-crs", strips=40, pitch_mm=2.5, length_mm=100.0)
NOISE = ts.Noise(positional=0.002)
ELL = Polygon([(0, 0), (50, 0), (50, 20), (22, 20), (22, 45), (0, 45)])
DART = Polygon([(-35, 30), (0, 0), (35, 30), (0, 14)])
ABOVE = Polygon([(20, 55), (65, 60), (65, 80), (20, 75)])


def _placed(shape: Polygon, degrees: float) -> Polygon:
    turned = affinity.rotate(shape, degrees, origin="centroid")
    return affinity.translate(turned, 50.0 - turned.centroid.x, 50.0 - turned.centroid.y)


def _fitted(
    *shapes: Polygon,
    told: bool = True,
    sensor: ts.Sensor = SENSOR,
    noise: ts.Noise = NOISE,
    one_object: bool = False,
) -> ts.RecoveredObject:
    scan = ts.simulate(sensor, ts.Contact(shapes), noise, rng=1)
    result = ts.fit_polygon(scan, sensor, noise if told else None, assessment="fast", one_object=one_object)
    assert len(result.objects) == 1
    return result.objects[0]


@pytest.mark.parametrize("told", [True, False])
@pytest.mark.parametrize(
    "below",
    [
        [(35, 20), (80, 15), (80, 40), (36, 38)],  # begins later and ends later
        [(30, 50), (45, 20), (60, 22), (45, 52)],  # begins and ends under the other one
        [(34.9, 57), (42, 30), (90, 30)],  # so steep at its begin that a strip lies on its edge
    ],
)
def test_two_objects_on_the_same_strips_are_never_one_ok(
    below: list[tuple[float, float]], told: bool
) -> None:
    found = _fitted(ABOVE, Polygon(below), told=told)
    assert found.status == "doubtful"
    assert "several objects" in found.advice or "two objects" in found.advice


@pytest.mark.parametrize(
    ("shape", "degrees"), [(ELL, 70.0), (ELL, 160.0), (ELL, 340.0), (DART, 0.0), (DART, 120.0)]
)
def test_a_concave_object_is_ok_where_no_two_convex_ones_read_alike(shape: Polygon, degrees: float) -> None:
    truth = _placed(shape, degrees)
    found = _fitted(truth)
    assert found.status == "ok", found.advice
    assert ts.mismatch(np.asarray(truth.exterior.coords)[:-1], found.vertices).iou >= 0.8


def test_an_upright_ell_reads_as_two_rectangles_and_is_doubted_with_the_height_of_the_jump() -> None:
    found = _fitted(_placed(ELL, 0.0))
    assert found.status == "doubtful"
    assert "concave or at least two objects" in found.advice
    step = float(found.advice.split("jumps by ")[1].split(" mm")[0])
    assert step == pytest.approx(25.0, abs=0.5)


def test_an_upright_ell_that_is_known_to_be_one_object_is_ok() -> None:
    truth = _placed(ELL, 0.0)
    found = _fitted(truth, one_object=True)
    assert found.status == "ok", found.advice
    assert not any(other.others for other in found.alternatives)
    assert ts.mismatch(np.asarray(truth.exterior.coords)[:-1], found.vertices).iou >= 0.9


def test_a_curved_notch_that_no_polygon_follows_to_the_noise_is_one_object() -> None:
    fine = ts.Sensor(construction="crs-crs", strips=100, pitch_mm=1.0, length_mm=100.0)
    truth = Point(50, 40).buffer(35, 64).difference(Point(50, 66).buffer(28, 64))
    found = _fitted(Polygon(truth.exterior), told=False, sensor=fine, noise=ts.Noise(positional=0.001))
    assert found.status == "ok", found.advice
    assert ts.mismatch(np.asarray(truth.exterior.coords)[:-1], found.vertices).iou >= 0.9


@pytest.mark.parametrize("one_object", [False, True])
def test_what_an_overhang_may_hide_is_said(one_object: bool) -> None:
    # Opens to the side: strips read the hull of both arms.
    found = _fitted(_placed(DART, 85.0), one_object=one_object)
    truth = np.asarray(_placed(DART, 85.0).exterior.coords)[:-1]
    assert ts.mismatch(truth, found.vertices).iou < 0.8
    assert found.status == "doubtful"
    assert "overhang" in found.advice


def test_a_star_is_no_ellipse_of_noise_that_neighbouring_strips_do_not_show() -> None:
    star = [(28, 19), (20, 18), (21, 25), (16, 19), (11, 23), (11, 16), (5, 14), (11, 12), (9, 5), (15, 9)]
    sensor = ts.Sensor(construction="crs-crs", strips=35, pitch_mm=0.9, length_mm=100.0)
    found = _fitted(Polygon([*star, (17, 3), (20, 9), (27, 10), (23, 13)]), told=False, sensor=sensor)
    assert found.status == "doubtful"
    assert "of which neighbouring strips show" in found.advice


@pytest.mark.parametrize(("degrees", "status"), [(-8.0, "doubtful"), (8.0, "ok")])
def test_what_may_hide_between_two_arms_lowers_confidence(degrees: float, status: str) -> None:
    """The shorter arm's end leans inwards, and all of its jump is seen; or outwards, on a strip."""
    arms = [(0, 0), (60, 0), (60, 12), (12, 12), (12, 38), (30, 38), (30, 50), (0, 50)]
    truth = _placed(Polygon(arms), degrees)
    found = _fitted(truth, one_object=True)
    assert ts.mismatch(np.asarray(truth.exterior.coords)[:-1], found.vertices).iou < 0.8
    assert found.status == status
    assert found.confidence is not None
    assert found.confidence < 0.85
    assert "behind such an overhang" in found.advice


def test_a_reading_left_out_that_moves_one_end_alone_may_be_a_second_object_s() -> None:
    """A small object under the contact's first two strips: no outline of few corners follows, a reading is left out."""
    sensor = ts.Sensor(construction="crs-crs", strips=8, pitch_mm=10.0, length_mm=100.0)
    found = _fitted(
        Polygon([(2, 60), (78, 50), (78, 85), (2, 80)]),
        Polygon([(2, 20), (17, 20), (17, 30), (2, 30)]),
        sensor=sensor,
    )
    assert found.status == "doubtful", found


@pytest.mark.parametrize("told", [True, False])
@pytest.mark.parametrize(("turned", "error"), [(0.0, 0.001), (0.0, 0.005), (5.0, 0.002)])
def test_a_leg_on_the_outermost_strip_is_not_taken_for_a_faulty_channel(
    turned: float, error: float, told: bool
) -> None:
    """The other end goes straight on there; a fault, which moves both, would hardly leave it so."""
    sensor = ts.Sensor(construction="crs-crs", strips=16, pitch_mm=6.0, length_mm=120.0)
    leg = Polygon([(15, 50), (72.5, 50), (72.5, 15), (78, 15), (78, 70), (15, 70)])
    shape = affinity.rotate(leg, turned, origin=(75.0, 50.0))
    found = _fitted(shape, told=told, sensor=sensor, noise=ts.Noise(positional=error))
    assert found.status == "doubtful"
    assert not found.faulty


@pytest.mark.parametrize("strip", [3, 4, 6])
def test_a_stem_on_one_strip_is_not_taken_for_two_faulty_channels(strip: int) -> None:
    sensor = ts.Sensor(construction="crs-crs", strips=10, pitch_mm=8.0, length_mm=90.0)
    middle = 8.0 * strip + 4.0
    cross = Polygon([(12, 25), (68, 25), (68, 45), (12, 45)]).union(
        Polygon([(middle - 3.6, 12), (middle + 3.6, 12), (middle + 3.6, 68), (middle - 3.6, 68)])
    )
    found = _fitted(cross, sensor=sensor)
    assert found.status == "doubtful"
    assert "may be of a second object, or of an overhang" in found.advice


def test_a_stuck_channel_is_still_left_out() -> None:
    truth = [(20.0, 30.0), (80.0, 20.0), (85.0, 60.0), (30.0, 75.0)]
    scan = ts.simulate(SENSOR, ts.Contact.polygon(truth), NOISE, rng=2)
    kl = scan["kl"].copy()
    kl[20] = 0.05
    found = ts.fit_polygon(ts.Scan(kh=scan["kh"], kl=kl), SENSOR, NOISE, assessment="fast").objects[0]
    assert found.status == "ok"
    assert "strip 20 (k_l = 0.05)" in found.advice


# One triangle above another, on 20 strips: a polygon follows both with two steep edges.
_TWENTY = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0)
_PAIR = Polygon([(20, 20), (45, 25), (30, 50)]), Polygon([(35, 60), (70, 55), (60, 80)])


@pytest.mark.parametrize("assessment", ["none", "fast"])
def test_a_concave_outline_of_two_triangles_is_doubted_with_both_as_the_alternative(assessment: Any) -> None:
    noise = ts.Noise(positional=0.005)
    scan = ts.simulate(_TWENTY, ts.Contact(_PAIR), noise, rng=1)
    (found,) = ts.fit_polygon(scan, _TWENTY, noise, assessment=assessment).objects
    assert found.status == "doubtful"
    assert "two objects on the same strips explain the readings too" in found.advice
    likeliest = found.alternatives[0]
    assert likeliest.weight > 0.2  # they nearly touch, hardly higher than broad: of drawn ones 1 in 5 is two
    assert (found.confidence is not None) == (assessment == "fast" and DRAWN)
    assert (found.confidence or 0.0) < 1.0 - likeliest.weight + 0.01
    for shown, truth in zip((likeliest.vertices, *likeliest.others), _PAIR, strict=True):
        assert Polygon(shown).difference(truth.buffer(4.0)).area < 0.02 * truth.area
        assert Polygon(shown).area > 0.4 * truth.area  # what other strips show of it


def test_both_objects_of_an_alternative_are_written_and_drawn() -> None:
    from matplotlib.figure import Figure

    from tacstrip.io import feature_collection

    noise = ts.Noise(positional=0.005)
    scan = ts.simulate(_TWENTY, ts.Contact(_PAIR), noise, rng=1)
    found = ts.fit_polygon(scan, _TWENTY, noise, assessment="fast")
    other = found.objects[0].alternatives[0]
    written = feature_collection([found])["features"][0]["properties"]["alternatives"][0]
    np.testing.assert_allclose(written["others_mm"], other.others, atol=1e-5)
    axes = Figure().add_subplot()
    ts.plot.result(found, _TWENTY, ax=axes)
    labels = [line.get_label() for line in axes.lines]
    assert labels.count(f"alternative 1: {other.weight:.2f}") == 1
    drawn = [np.column_stack(line.get_data())[:-1] for line in axes.lines]
    assert any(line.shape == other.others[0].shape and np.allclose(line, other.others[0]) for line in drawn)


# Two objects that point at each other and share no strip, or two: one with a waist reads so, too.
_BESIDE = {
    "beside each other": ([(15, 25), (49.5, 52), (15, 75)], [(50.6, 48), (86, 20), (86, 80)]),
    "on the same strips": ([(15, 25), (52, 58), (15, 75)], [(48, 44), (86, 20), (86, 80)]),
}


@pytest.mark.parametrize("told", [True, False])
@pytest.mark.parametrize("where", _BESIDE)
def test_two_objects_beside_each_other_are_never_one_ok(where: str, told: bool) -> None:
    left, right = map(Polygon, _BESIDE[where])
    found = _fitted(left, right, told=told)
    assert found.status == "doubtful"
    assert "which would meet between x = 4" in found.advice
    likeliest = found.alternatives[0]
    assert likeliest.weight > 0.3
    shown = sorted((likeliest.vertices, *likeliest.others), key=lambda outline: float(outline[0, 0]))
    for outline, truth in zip(shown, (left, right), strict=True):
        own = Polygon(outline)
        assert own.intersection(truth).area > 0.8 * own.union(truth).area


def test_one_object_with_a_waist_is_ok_where_it_is_known_to_be_one() -> None:
    found = _fitted(*map(Polygon, _BESIDE["beside each other"]), one_object=True)
    assert found.status == "ok"


def test_a_reading_that_an_outline_passes_by_may_be_where_two_objects_meet() -> None:
    left = [(8.9, 67.8), (40.1, 48.2), (51.1, 69.6), (48.0, 71.2), (17.0, 77.2)]
    right = [(52.9, 59.9), (54.9, 55.9), (72.3, 27.1), (89.1, 37.6), (63.0, 66.3), (58.0, 64.5)]
    sensor = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=6.0, length_mm=110.0)
    found = _fitted(Polygon(left), Polygon(right), sensor=sensor, noise=ts.Noise(positional=0.008))
    assert found.status == "doubtful"


def test_inward_corners_without_a_jump_are_hardly_two_objects() -> None:
    for degrees in (0.0, 120.0):
        found = _fitted(_placed(DART, degrees))
        assert found.confidence is not None
        assert found.confidence > 0.9
        assert sum(other.weight for other in found.alternatives if other.others) < 0.1


_U = Polygon([(6, 20), (81, 20), (81, 80), (63, 80), (63, 45), (24, 45), (24, 80), (6, 80)])
_T = Polygon([(40, 0), (50, 0), (50, 40), (90, 40), (90, 60), (0, 60), (0, 40), (40, 40)])


def test_the_ends_of_a_convex_contact_do_not_cross() -> None:
    """Convex l and u that cross far beyond each other explain nearly all readings of few strips."""
    sensor = ts.Sensor(construction="crs-crs", strips=7, pitch_mm=10.0, length_mm=100.0)
    l = np.array([0.622, 0.622, 0.630, 0.638, 0.646, 0.654, 0.662])
    u = np.array([0.645, 0.990, 0.990, 0.990, 0.990, 0.666, 0.670])
    clear = 1.0 - 0.5 * (u - l)
    readings = {"kh": (l + 0.5 * (u - l)) / clear, "kl": l / clear}
    problem = FitProblem.of(sensor, sensor.x_mm, readings, 0.008)
    convex = fit_convex(problem, l, u)
    assert not convex.explains
    assert (convex.ends[1] >= convex.ends[0] - 1e-3).all()


def test_a_second_object_beside_one_on_the_border_is_no_stuck_channel() -> None:
    """Where the contact reaches the strips' upper end k_h is 1, whatever the other end does."""
    sensor = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=4.7, length_mm=234.0)
    border = Polygon([(21.5, 155.3), (90.3, 155.3), (90.3, 234.0), (21.5, 234.0)])
    truth = ts.Contact((border, Polygon([(87.3, 40.7), (34.5, 78.4), (45.9, 34.5)])))
    noise = ts.Noise(positional=0.013)
    for seed in range(4):
        scan = ts.simulate(sensor, truth, noise, rng=seed)
        found = ts.fit_polygon(scan, sensor, noise, assessment="fast").objects[0]
        assert found.status == "doubtful", (seed, found.advice)


def test_a_second_object_does_not_pass_for_noise_that_nobody_gave() -> None:
    """A polygon of four corners took its jumps for noise ten times as large, and was `ok`."""
    sensor = ts.Sensor(construction="crs-crs", strips=10, pitch_mm=5.0, length_mm=100.0)
    triangle, second = (
        Polygon([(4, 13), (20, 70), (40, 31)]),
        Polygon([(24, 71), (42, 72), (41, 82), (24, 73)]),
    )
    found = _fitted(triangle, second, told=False, sensor=sensor)
    assert found.status == "doubtful"
    assert "two objects" in found.advice or "second object" in found.advice


def test_confidence_and_weights_are_probabilities_of_different_things() -> None:
    """Together they are 1 at most, whatever touches: convex, concave, two objects; one signature or both."""
    random, several = np.random.default_rng(5), 0
    for number in range(40):
        upright = number % 2 == 0
        shape = [_T, ELL, DART, _U][number // 2 % 4]
        placed = [_placed(shape, 90.0 * number if upright else float(random.uniform(0.0, 360.0)))]
        if number % 3 == 0:
            placed.append(affinity.translate(_PAIR[1], 10.0, float(random.uniform(-20.0, 15.0))))
        metal = number % 5 == 4
        sensor = replace(_TWENTY, construction="crs-m" if metal else "crs-crs")
        noise = ts.Noise(positional=float(random.uniform(0.002, 0.02)))
        scan = ts.simulate(sensor, ts.Contact(tuple(placed)), noise, rng=number)
        for found in ts.fit_polygon(scan, sensor, noise, assessment="fast").objects:
            weights = [other.weight for other in found.alternatives]
            several += any(other.others for other in found.alternatives)
            assert all(0.0 < weight <= 1.0 for weight in weights)
            assert sum(weights) + (found.confidence or 0.0) <= 1.0 + 1e-9, (number, found)
    assert several >= 3


TWENTY = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0)


@pytest.mark.parametrize("told", [True, False])
def test_a_tip_on_the_outermost_strip_may_be_of_a_second_object(told: bool) -> None:
    """A convex outline explains it too, by an edge that crosses just that strip: the corner is cut off there."""
    lower, tip = [(31, 20), (50, 15), (66, 20), (66, 33), (31, 35)], [(31, 68), (69, 66), (69, 69), (40, 74)]
    found = _fitted(Polygon(lower), Polygon(tip), told=told, sensor=TWENTY, noise=ts.Noise(positional=0.003))
    assert found.status == "doubtful"
    assert "two objects" in found.advice
    assert any(other.others for other in found.alternatives)


@pytest.mark.parametrize("degrees", [0.0, 10.0, 25.0, 40.0])
def test_a_convex_object_that_narrows_at_both_ends_is_ok(degrees: float) -> None:
    found = _fitted(_placed(Polygon([(0, 0), (60, 0), (60, 30), (0, 30)]), degrees))
    assert found.status == "ok"
    assert not found.advice


def test_a_narrow_strip_behind_a_notch_is_no_faulty_channel() -> None:
    notched = Polygon([(26.5, 71), (33, 84), (75, 45), (41, 12), (32, 16), (30.8, 66)])
    found = _fitted(notched, told=False, sensor=TWENTY, noise=ts.Noise(positional=0.003))
    assert found.status == "doubtful"
    assert not found.faulty
    assert "may be of a second object, or of an overhang" in found.advice


TEN = ts.Sensor(construction="crs-crs", strips=10, pitch_mm=10.0, length_mm=100.0)


@pytest.mark.parametrize("shift_mm", [0.0, 3.0])
@pytest.mark.parametrize("silent", [1, 2, 3])
def test_two_objects_beside_each_other_on_few_strips_are_two(silent: int, shift_mm: float) -> None:
    left = Polygon([(4, 30 + shift_mm), (36, 20), (34, 55), (18, 70)])
    right = Polygon([(0, 60), (30, 45 - shift_mm), (28, 85), (8, 80)])
    apart = affinity.translate(right, 46.0 + 10.0 * (silent - 1), 0.0)
    contact = ts.Contact((left, apart))
    noise = ts.Noise(positional=0.003)
    scan = ts.simulate(TEN, contact, noise, rng=1)
    assert np.count_nonzero(np.diff(np.flatnonzero(scan.touched)) == silent + 1) == 1
    found = ts.fit_polygon(scan, TEN, noise, assessment="fast")
    assert len(found.objects) == 2


def test_one_object_with_a_broken_strip_is_one_and_with_a_wrong_reading_besides_doubted() -> None:
    whole = ts.Contact.polygon([(6, 50), (40, 15), (92, 40), (70, 85), (30, 80)])
    noise = ts.Noise(positional=0.003)
    scan = ts.simulate(TEN, whole, noise, rng=2)
    kh, kl = np.array(scan.kh), np.array(scan.kl)
    kh[4] = kl[4] = np.nan
    (one,) = ts.fit_polygon(ts.Scan(kh=kh, kl=kl), TEN, noise, assessment="fast").objects
    assert one.status == "ok"
    assert "strip 4 reads nothing inside the contact" in one.advice
    kh[6] += 0.2
    (one,) = ts.fit_polygon(ts.Scan(kh=kh, kl=kl), TEN, noise, assessment="fast").objects
    assert one.status == "doubtful"
    assert one.confidence is None
