"""What is given besides the readings may contradict them, and errors may be shared by all readings alone."""

import numpy as np
import pytest

import tacstrip as ts
from polygons import SURE

SENSOR = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=150.0)
PENTAGON = [(18, 40), (62, 25), (84, 70), (55, 110), (27, 95)]  # 3609 mm2
NOISE = ts.Noise(positional=0.003)


@pytest.mark.parametrize("area", [1000.0, 10000.0, (3000.0, 20.0)])
def test_an_area_that_the_readings_contradict_is_said(area: float | tuple[float, float]) -> None:
    scan = ts.simulate(SENSOR, ts.Contact.polygon(PENTAGON), NOISE, rng=1)
    found = ts.fit_polygon(scan, SENSOR, NOISE, area_mm2=area).objects[0]
    assert found.status == "doubtful"
    assert found.confidence is None
    assert "contradicts the readings" in found.advice
    assert ts.fit_polygon(scan, SENSOR, NOISE, area_mm2=3600.0).status == SURE


@pytest.mark.parametrize(
    "noise",
    [
        ts.Noise(hum=0.01),
        ts.Noise(offset=0.005),
        ts.Noise(gain=0.01),
        ts.Noise(blur_mm=0.3),
        ts.Noise(white=0.005, white_shared=1.0),
        ts.Noise(wander=(0.002,), wander_s=(10.0,), wander_shared=1.0),
    ],
)
def test_noise_of_one_part_alone_has_a_covariance(noise: ts.Noise) -> None:
    scan = ts.simulate(SENSOR, ts.Contact.polygon(PENTAGON), noise, rng=2)
    found = ts.fit_polygon(scan, SENSOR, noise).objects[0]
    assert found.covariance is not None
    assert np.isfinite(found.covariance).all()


def test_a_known_object_across_the_seam_of_a_tube_is_one() -> None:
    tube = ts.Sensor(
        construction="cyl-crs-m", strips=24, pitch_mm=5.0, length_mm=150.0, radius_mm=120.0 / (2.0 * np.pi)
    )
    shape = [(-22, 40), (20, 30), (25, 80), (-5, 110)]
    scan = ts.simulate(tube, ts.Contact.polygon(shape), NOISE, rng=3)
    (found,) = ts.fit_object(scan, tube, shape, NOISE).objects
    assert found.status == "ok"
    assert ts.mismatch(shape, found.vertices, around_mm=120.0).iou > 0.9


def test_an_area_above_what_the_touched_strips_hold_is_said() -> None:
    scan = ts.simulate(SENSOR, ts.Contact.polygon([(27, 40), (48, 60), (43, 90)]), NOISE, rng=1)
    one = ts.Scan(kh=scan.kh)  # which alone tells too little of the area to contradict any
    found = ts.fit_polygon(one, SENSOR, NOISE, area_mm2=9000.0, assessment="fast").objects[0]
    assert found.status == "doubtful"
    assert "more than the touched strips hold, 4500 mm2" in found.advice


@pytest.mark.parametrize("area", [1e12, 1e-6, -3.0, 0.0, float("nan"), (700.0, float("nan")), (700.0, 1e9)])
def test_an_area_that_no_contact_has_is_refused_with_the_limits(area: float | tuple[float, float]) -> None:
    scan = ts.simulate(SENSOR, ts.Contact.polygon(PENTAGON), NOISE, rng=1)
    with pytest.raises(ts.OptionError, match=r"is 0\.075 to 15000 mm2"):
        ts.fit_polygon(scan, SENSOR, NOISE, area_mm2=area)


def test_correlated_errors_leave_no_variance_below_0() -> None:
    """Some heights are identified by nothing, which cuts what the others covary with."""
    sensor = ts.Sensor(
        construction="crs-m", strips=32, pitch_mm=3.0, length_mm=40.0, strip_width_mm=1.6, adc_bits=12
    )
    flat, noise = (
        ts.Contact.polygon([(0.7, 16.3), (2.5, 11.9), (89.4, 9.4), (94.1, 15.3)]),
        ts.Noise(gain=0.002),
    )
    for seed in (1, 3, 11):
        scan = ts.simulate(sensor, flat, noise, rng=seed)
        (found,) = ts.fit_polygon(scan, sensor, noise, assessment="none").objects
        assert found.covariance is not None
        assert (found.covariance.diagonal() >= 0.0).all()


@pytest.mark.parametrize("given", [{"area_mm2": "3000"}, {"area_mm2": (1.0, 2.0, 3.0)}, {"vertices": 5.5}])
def test_values_of_other_kinds_get_a_sentence(given: dict[str, object]) -> None:
    scan = ts.simulate(SENSOR, ts.Contact.polygon(PENTAGON), NOISE, rng=1)
    with pytest.raises(ts.OptionError, match="give a"):
        ts.fit_polygon(scan, SENSOR, NOISE, **given)  # type: ignore[arg-type]
