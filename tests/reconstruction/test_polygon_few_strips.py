"""The polygon fit on the few strips that a maker's sensor has."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from polygons import many_fits
from tacstrip.contact.noise import Noise
from tacstrip.contact.shape import Contact
from tacstrip.geometry.metrics import mismatch
from tacstrip.reconstruction.polygon.estimate import fit_polygon
from tacstrip.reconstruction.posterior.assessment import Effort
from tacstrip.scan import Scan
from tacstrip.sensor.spec import Sensor
from tacstrip.simulation import simulate

FEW = Sensor(construction="crs-crs", strips=24, pitch_mm=4.0, length_mm=120.0)
TRIANGLE = Contact.polygon([(20, 30), (70, 40), (45, 90)])


@many_fits
@pytest.mark.parametrize("half_width", [0.0002, 0.002])
@pytest.mark.parametrize("known", [True, False])
def test_a_sharp_corner_is_no_stuck_channel_and_no_curve(half_width: float, known: bool) -> None:
    """Sections of 13 strips are curved, so that beside the apex no line predicts a reading."""
    noise, doubtful = Noise(positional=half_width), 0
    for i in range(40):
        contact = TRIANGLE.placed(46.5 + 0.05 * i, 55.0 + 0.05 * i)
        scan = simulate(FEW, contact, noise, rng=np.random.default_rng(i))
        (found,) = fit_polygon(scan, FEW, noise if known else None).objects
        assert "left out" not in found.advice
        doubtful += found.status != "ok"
        assert mismatch(contact.vertices, found.vertices).iou > 0.9
    assert doubtful <= 3


def test_a_channel_that_is_off_is_still_found() -> None:
    noise = Noise(positional=0.002)
    scan = simulate(FEW, TRIANGLE, noise, rng=np.random.default_rng(1))
    kh = scan["kh"].copy()
    kh[14] += 0.05
    scan = Scan(kh=kh, kl=scan["kl"])
    (found,) = fit_polygon(scan, FEW, noise).objects
    assert "strip 14 (k_h" in found.advice
    assert mismatch(TRIANGLE.vertices, found.vertices).iou > 0.9


def test_an_upright_step_is_uncertain_by_a_pitch_not_without_end() -> None:
    step = Contact.polygon([(16, 20), (76, 20), (76, 50), (46, 50), (46, 95), (16, 95)])
    noise = Noise(positional=0.002)
    (found,) = fit_polygon(
        simulate(FEW, step, noise, rng=np.random.default_rng(3)), FEW, noise, bounded=False
    ).objects
    assert found.covariance is not None
    assert np.sqrt(np.diag(found.covariance)[::2]).max() < 2.0 * FEW.pitch_mm
    assert mismatch(step.vertices, found.vertices).iou > 0.9


def _turned_oval(radius: float, flat: float, x: float) -> Contact:
    angle = 2.0 * np.pi * np.arange(120) / 120
    points = radius * np.column_stack([np.cos(angle), flat * np.sin(angle)])
    c, s = np.cos(0.5), np.sin(0.5)
    return Contact.polygon((x, 50.0) + points @ np.array([[c, s], [-s, c]]))


@pytest.mark.parametrize("flat", [1.0, 0.6])
def test_curves_between_six_strips_are_no_faults_and_no_second_object(flat: float) -> None:
    """No polygon of as many corners as so few readings tell follows a curve: convex l and u explain them all."""
    sensor = Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0, adc_bits=12)
    noise = Noise(positional=0.001)
    doubtful = 0
    for i in range(12):
        contact = _turned_oval(15.0, flat, 50.0 + 0.4 * i)
        scan = simulate(sensor, contact, noise, rng=np.random.default_rng(i))
        (found,) = fit_polygon(scan, sensor, noise, assessment="fast").objects
        assert mismatch(contact.vertices, found.vertices).iou > 0.9
        assert "stuck" not in found.advice
        assert not found.faulty
        doubtful += found.status not in ("ok", "likely")
    assert doubtful <= 1


def test_corners_on_few_strips_do_not_pass_for_noise_no_sensor_has() -> None:
    """Six strips of a pentagon gave a line with noise of 19 % of Vref; corners explain them, uncertain as they are."""
    sensor = Sensor(construction="crs-crs", strips=10, pitch_mm=8.0, length_mm=90.0)
    shape = Contact.polygon([(15.5, 20.8), (51.5, 12.8), (67.5, 40.8), (53.5, 70.8), (21.5, 62.8)])
    for seed in range(3):
        found = fit_polygon(simulate(sensor, shape, Noise(white=0.001), rng=seed), sensor).objects[0]
        assert mismatch(shape.vertices, found.vertices).iou > 0.85
        assert found.status == "ok"  # for convex l and u explain all readings, without noise of any size
        assert found.confidence is not None


@pytest.mark.parametrize("known", [True, False])
def test_corners_between_three_strips_are_drawn_where_no_polygon_follows_them(known: bool) -> None:
    """Six readings are too few to try a corner: an upright trapezoid was 50 deviations off, or a line."""
    sensor = Sensor(construction="crs-crs", strips=10, pitch_mm=10.0, length_mm=100.0, adc_bits=10)
    shape = Contact.polygon([(57.4, 9.7), (90.3, 46.4), (74.0, 60.9)])
    noise = Noise(positional=0.003)
    for seed in range(2):
        scan = simulate(sensor, shape, noise, rng=seed)
        (found,) = fit_polygon(scan, sensor, noise if known else None, assessment="fast").objects
        assert mismatch(shape.vertices, found.vertices).iou > 0.75
        assert found.status == "doubtful"
        assert "from two objects on the same strips" in found.advice
        assert found.confidence is not None
        assert found.confidence <= 0.8


@pytest.mark.parametrize(
    ("radius", "flat", "named", "least"),
    [(20.0, 1.0, True, 6), (20.0, 0.6, True, 6), (20.0, 0.6, False, 6), (25.0, 0.6, False, 6)],
)
def test_a_faulty_channel_under_a_curve_costs_its_own_reading(
    radius: float, flat: float, named: bool, least: int
) -> None:
    sensor = Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0)
    noise, sure = Noise(positional=0.001), 0
    told = replace(sensor, without=("10:v_l",)) if named else sensor
    for i in range(6):
        contact = _turned_oval(radius, flat, 50.0 + 0.4 * i)
        scan = simulate(sensor, contact, noise, rng=np.random.default_rng(i))
        kl = scan["kl"].copy()
        kl[10] = 0.9
        (found,) = fit_polygon(Scan(kh=scan["kh"], kl=kl), told, noise, assessment="fast").objects
        if found.status in ("ok", "likely"):
            assert mismatch(contact.vertices, found.vertices).iou > 0.9
            assert found.faulty == (() if named else ("10:v_l",))
            sure += 1
    assert sure >= least


@pytest.mark.parametrize(
    ("kh", "kl", "pitch", "length", "half_width"),
    [
        # What convex ends leave over, 2.7 % of Vref, is more than any noise, whatever these few readings scatter.
        pytest.param(
            [0.5991, 0.6111, 0.6268, 0.5898, 0.5644, 0.5588, 0.5725, 0.5868],
            [0.5734, 0.5371, 0.5227, 0.3405, 0.241, 0.2249, 0.2739, 0.324],
            3.8264,
            122.935,
            None,
            id="noise not given",
        ),
        # An object of two strips below the other is no pair of faulty channels.
        pytest.param(
            [0.7457, 0.7789, 0.8239, 0.8364, 0.8469, 0.8552, 0.7933, 0.7436],
            [0.7449, 0.7672, 0.7864, 0.4598, 0.4784, 0.7997, 0.7717, 0.7475],
            4.76523,
            192.569,
            0.0019,
            id="two strips",
        ),
    ],
)
def test_two_objects_that_no_convex_one_reads_as_are_doubted(
    kh: list[float], kl: list[float], pitch: float, length: float, half_width: float | None
) -> None:
    sensor = Sensor(construction="crs-crs", strips=len(kh), pitch_mm=pitch, length_mm=length)
    noise = None if half_width is None else Noise(positional=half_width, distribution="normal")
    (found,) = fit_polygon(Scan(kh=np.array(kh), kl=np.array(kl)), sensor, noise, assessment="fast").objects
    assert found.status == "doubtful"


def _read_on(length_mm: float, kh: list[float], kl: list[float]) -> tuple[Scan, Sensor]:
    """Return a scan of strips amid ten of 10 mm, and the sensor."""
    sensor = Sensor(construction="crs-crs", strips=10, pitch_mm=10.0, length_mm=length_mm)
    read = np.full((2, 10), np.nan)
    read[:, 1 : 1 + len(kh)] = kh, kl
    return Scan(kh=read[0], kl=read[1]), sensor


@pytest.mark.parametrize("assessment", ["fast", "none"])
def test_two_objects_whose_ends_an_ellipse_follows_are_not_sure(assessment: Effort) -> None:
    """One lies above the other; nothing in four strips tells, but that they are few, and the contact is high."""
    scan, sensor = _read_on(101.67, [0.7536, 0.8714, 0.9445, 0.8748], [0.3123, 0.3614, 0.5197, 0.7032])
    noise = Noise(positional=0.002)
    (found,) = fit_polygon(scan, sensor, noise, assessment=assessment).objects
    assert found.status == "doubtful"
    assert "4 strips hardly tell this outline from a concave one or two objects" in found.advice
    assert "--one-object" in found.advice
    assert (found.confidence is None) == (assessment == "none")
    (one,) = fit_polygon(scan, sensor, noise, assessment="fast", one_object=True).objects
    assert one.status == "ok"
    assert one.confidence is not None
    assert one.confidence > (found.confidence or 0.9) + 0.05


@pytest.mark.parametrize(
    ("length_mm", "half_width", "kh", "kl"),
    [
        (73.88, 0.002, [0.9595, 0.9746, 0.7698, 0.7825], [0.6607, 0.5333, 0.6541, 0.668]),
        (153.0, 0.002, [0.7628, 0.76, 0.8267, 0.7812, 0.7387], [0.7272, 0.7297, 0.7229, 0.7297, 0.7361]),
        (107.61, 0.01, [0.6477, 0.6458, 0.7887, 0.7866, 0.6579], [0.5512, 0.5451, 0.4594, 0.4588, 0.5545]),
    ],
    ids=["T", "arrow", "plus"],
)
def test_a_concave_object_is_no_faulty_channel_for_sure(
    length_mm: float, half_width: float, kh: list[float], kl: list[float]
) -> None:
    """Without one reading an oval, or a few corners, explain all others of these."""
    scan, sensor = _read_on(length_mm, kh, kl)
    (found,) = fit_polygon(scan, sensor, Noise(positional=half_width), assessment="fast").objects
    assert found.status == "doubtful"
    assert found.faulty
    assert "strips hardly tell a faulty channel, whose reading was left out, from a concave" in found.advice


def test_plain_shapes_on_few_strips_stay_sure() -> None:
    """Four corners on five strips, also of a bar along them on six."""
    sensor, noise = replace(FEW, pitch_mm=10.0), Noise(positional=0.002)
    for corners in [(6, 30), (43, 22), (51, 60), (12, 66)], [(8, 15), (61, 20), (60, 105), (7, 102)]:
        scan = simulate(sensor, Contact.polygon(corners), noise, rng=1)
        (found,) = fit_polygon(scan, sensor, noise, assessment="fast").objects
        assert found.status == "ok"
        assert mismatch(corners, found.vertices).iou > 0.9
