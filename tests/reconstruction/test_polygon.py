"""The polygon fit as a user sees it: right corners, honest uncertainty, a word for everything else."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from polygons import CONVEX, DRAWN, SURE
from strategies import FIXED, sensors
from tacstrip.arrays import FloatArray
from tacstrip.contact.noise import Noise
from tacstrip.contact.shape import Contact
from tacstrip.core.polygon_fit import PolygonFit, refine
from tacstrip.core.problem import FitProblem
from tacstrip.errors import OptionError, ReadingError
from tacstrip.geometry.metrics import mismatch
from tacstrip.geometry.outline import Outline
from tacstrip.reconstruction.cramer_rao import reading_sigma, vertex_covariance
from tacstrip.reconstruction.polygon.estimate import fit_polygon, fit_polygons, fitted_transitions
from tacstrip.reconstruction.polygon.run import fit_run
from tacstrip.reconstruction.posterior.assessment import Effort
from tacstrip.reconstruction.result import RecoveredObject
from tacstrip.scan import Scan
from tacstrip.sensor.spec import Sensor
from tacstrip.simulation import simulate

CRS = Sensor(construction="crs-crs", strips=100, pitch_mm=10.0, length_mm=1000.0, adc_bits=12)
METAL = Sensor(construction="crs-m", strips=100, pitch_mm=10.0, length_mm=1000.0, adc_bits=12)
UNLIKE = Sensor(
    construction="crs-crs", strips=100, pitch_mm=10.0, length_mm=1000.0, adc_bits=12, resistivity_ratio=4.0,
    contact_lambda_mm=5.0,
)  # fmt: skip
TUBE = Sensor(
    construction="cyl-crs-m", strips=100, pitch_mm=10.0, length_mm=1000.0, radius_mm=200.0, adc_bits=12
)
SENSORS = (CRS, METAL, UNLIKE, TUBE)
PENTAGON = np.array([(103.0, 300.0), (400.0, 150.0), (905.0, 400.0), (700.0, 700.0), (300.0, 600.0)])
NOISE = Noise(quantisation=0.005)


def _names(sensor: Sensor) -> str:
    return f"{sensor.construction}-{sensor.resistivity_ratio:g}"


def _only(
    scan: Scan,
    sensor: Sensor,
    noise: Noise | None = NOISE,
    bounded: bool = True,
    assessment: Effort = "thorough",
) -> RecoveredObject:
    found = fit_polygon(scan, sensor, noise, bounded=bounded, assessment=assessment)
    assert found.method == "polygon"
    assert len(found.objects) == 1
    return found.objects[0]


def _scan(readings: Mapping[str, FloatArray]) -> Scan:
    return Scan(kh=readings.get("kh"), kl=readings.get("kl"), k=readings.get("k"))


def _single(scan: Scan, name: str) -> Scan:
    return _scan({name: scan[name]})


def _away(found: RecoveredObject, truth: FloatArray) -> FloatArray:
    """Return each vertex' distance from the truth in standard deviations (2 N,)."""
    assert found.covariance is not None
    assert found.vertices.shape == truth.shape
    return np.asarray(np.abs(found.vertices - truth).ravel() / np.sqrt(found.covariance.diagonal()))


@pytest.mark.parametrize("noise", [NOISE, None], ids=["known", "unknown"])
@pytest.mark.parametrize("sensor", SENSORS, ids=_names)
def test_a_pentagon_comes_back_within_its_own_uncertainty(sensor: Sensor, noise: Noise | None) -> None:
    found = _only(simulate(sensor, Contact.polygon(PENTAGON), NOISE, rng=1), sensor, noise)
    assert (found.status, found.advice) == (("ok", "") if len(sensor.signatures) > 1 else (SURE, CONVEX))
    assert _away(found, PENTAGON).max() < 4.0
    assert found.profile is not None
    assert np.all(found.profile[1] <= found.profile[2])


@pytest.mark.parametrize("name", ["kh", "kl"])
def test_one_signature_of_two_is_enough(name: str) -> None:
    scan = _single(simulate(CRS, Contact.polygon(PENTAGON), NOISE, rng=2), name)
    assert _away(_only(scan, CRS, assessment="none"), PENTAGON).max() < 4.0


@pytest.mark.parametrize("sensor", [CRS, UNLIKE], ids=_names)
def test_without_noise_both_signatures_give_the_polygon(sensor: Sensor) -> None:
    exact = Sensor(**{**{k: getattr(sensor, k) for k in sensor.__annotations__}, "adc_bits": None})
    found = _only(simulate(exact, Contact.polygon(PENTAGON)), exact, Noise())
    np.testing.assert_allclose(found.vertices, PENTAGON, atol=0.02)
    assert found.status == "ok"


def test_concave_shapes_and_vertical_edges_come_back_from_both_signatures() -> None:
    concave = np.array([(105.0, 300.0), (500.0, 450.0), (905.0, 300.0), (700.0, 700.0), (300.0, 600.0)])
    assert _away(_only(simulate(CRS, Contact.polygon(concave), NOISE, rng=3), CRS), concave).max() < 4.0
    upright = np.array([(120.0, 200.0), (700.0, 300.0), (700.0, 800.0), (120.0, 500.0)])
    found = _only(simulate(CRS, Contact.polygon(upright), NOISE, rng=3), CRS)
    assert _away(found, upright).max() < 4.0
    assert found.vertices[0, 0] == found.vertices[3, 0]  # one x: a vertical edge


def test_the_covariance_is_the_bound() -> None:
    for sensor, names in ((CRS, ("kh", "kl")), (CRS, ("kl",)), (METAL, ("k",)), (UNLIKE, ("kh", "kl"))):
        scan = simulate(sensor, Contact.polygon(PENTAGON), NOISE, rng=4)
        found = _only(_scan({n: scan[n] for n in names}), sensor, bounded=False, assessment="none")
        assert found.covariance is not None
        bound = vertex_covariance(Outline.of(found.vertices), sensor, reading_sigma(NOISE, sensor), names)
        np.testing.assert_allclose(found.covariance, bound, rtol=1e-4, atol=1e-6 * bound.max())


def test_an_outline_in_units_of_a_signal_and_back() -> None:
    square = Outline.of([(200.0, 100.0), (600.0, 100.0), (600.0, 500.0), (200.0, 700.0)])
    scan = simulate(CRS, Contact.polygon(square.vertices))
    run = scan.runs()[0]
    problem = FitProblem.of(CRS, CRS.x_mm[run], {"kh": scan["kh"][run], "kl": scan["kl"][run]}, 0.001)
    fit = PolygonFit.of(square, problem)
    assert fit.vertical_ends.tolist() == [1, 1]
    for back, chain in zip(fit.chains_mm(problem), (square.lower, square.upper), strict=True):
        np.testing.assert_allclose(back, chain, atol=1e-9)
    assert fit.information_root(problem).shape == (8, 8)
    np.testing.assert_allclose(fit.readings(problem), problem.k, atol=2e-4)


def test_tracking_goes_on_from_the_polygon_before() -> None:
    before = simulate(CRS, Contact.polygon(PENTAGON), NOISE, rng=5)
    moved = PENTAGON + np.array([4.0, 7.0])
    after = simulate(CRS, Contact.polygon(moved), NOISE, rng=6)
    found = _only(before, CRS)
    run = after.runs()[0]
    problem = FitProblem.of(
        CRS, CRS.x_mm[run], {n: after[n][run] for n in ("kh", "kl")}, reading_sigma(NOISE, CRS)
    )
    warm = refine(PolygonFit.of(Outline.of(found.vertices), problem), problem)
    lower, upper = warm.chains_mm(problem)
    cold = _only(after, CRS, bounded=False)
    np.testing.assert_allclose(Outline(lower, upper).vertices, cold.vertices, atol=0.2)


def _stuck(k: dict[str, FloatArray]) -> None:
    next(iter(k.values()))[40] = 0.95


def _stuck_twice(k: dict[str, FloatArray]) -> None:
    next(iter(k.values()))[40:42] = 0.0


def _first(k: dict[str, FloatArray]) -> None:
    next(iter(k.values()))[10] = 0.9


def _slightly_off(k: dict[str, FloatArray]) -> None:
    next(iter(k.values()))[40] += 0.03


def _dead(k: dict[str, FloatArray]) -> None:
    for values in k.values():
        values[55] = np.nan


def _three_dead(k: dict[str, FloatArray]) -> None:
    for values in k.values():
        values[55:58] = np.nan


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        (_stuck, "strip 40 ("),
        (_stuck_twice, "= 0), 41 ("),
        (_first, "strip 10 ("),
        (_slightly_off, "strip 40 ("),
        (_dead, "strip 55 reads nothing inside the contact"),
        (_three_dead, "strip 55, 56, 57 reads nothing"),
    ],
)
@pytest.mark.parametrize(
    ("sensor", "noise"), [(CRS, NOISE), (METAL, None)], ids=["both, known noise", "metal, unknown noise"]
)
def test_faulty_strips_are_named_and_do_no_harm(
    sensor: Sensor, noise: Noise | None, fault: Callable[[dict[str, FloatArray]], None], said: str
) -> None:
    scan = simulate(sensor, Contact.polygon(PENTAGON), NOISE, rng=3)
    readings = {name: scan[name].copy() for name in scan.signatures}
    fault(readings)
    found = _only(_scan(readings), sensor, noise, assessment="fast" if sensor is CRS else "none")
    assert said in found.advice
    assert found.status == ("ok" if sensor is CRS else "likely")
    assert _away(found, PENTAGON).max() < 4.5


def test_strips_are_named_as_the_user_counts_them() -> None:
    one = Sensor(construction="crs-m", strips=100, pitch_mm=10.0, length_mm=1000.0, adc_bits=12, strip_base=1)
    k = simulate(one, Contact.polygon(PENTAGON), NOISE, rng=3)["k"].copy()
    k[40] = 0.95
    assert "strip 41 (k = 0.95)" in _only(Scan(k=k), one).advice


@pytest.mark.parametrize("sensor", [CRS, METAL], ids=_names)
def test_two_contacts_side_by_side_stay_two(sensor: Sensor) -> None:
    left = Contact.polygon([(103, 300), (300, 150), (405, 400)])
    right = Contact.polygon([(420, 300), (600, 150), (805, 400), (600, 600)])
    found = fit_polygon(simulate(sensor, left + right, NOISE, rng=1), sensor, NOISE, assessment="none")
    assert [len(o.vertices) for o in found.objects] == [3, 4]


@pytest.mark.parametrize("name", ["kh", "k", "both"])
def test_a_round_contact_gets_its_outline(name: str) -> None:
    sensor = METAL if name == "k" else CRS
    angle = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    oval = np.stack([500.0 + 350.0 * np.cos(angle), 400.0 + 200.0 * np.sin(angle + 0.2)], axis=1)
    scan = simulate(sensor, Contact.polygon(oval), NOISE, rng=1)
    found = _only(scan if name in ("both", "k") else _single(scan, name), sensor)
    assert found.status == ("ok" if DRAWN or name == "both" else "doubtful")
    assert "round" in found.advice
    assert mismatch(oval, found.vertices).iou > 0.97
    assert found.covariance is not None
    assert found.covariance.shape == (found.vertices.size, found.vertices.size)


def test_what_no_polygon_makes_is_doubted() -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    wavy = np.stack([500 + 350 * np.cos(angle), 500 + (200 + 40 * np.cos(9 * angle)) * np.sin(angle)], axis=1)
    scan = simulate(CRS, Contact.polygon(wavy), Noise(quantisation=0.0005), rng=1)
    assert fit_polygon(scan, CRS, Noise(quantisation=0.0005)).status == "doubtful"
    too_noisy = simulate(CRS, Contact.polygon(PENTAGON), Noise(quantisation=0.02), rng=1)
    said = fit_polygon(too_noisy, CRS, Noise(quantisation=0.005))
    assert said.status == "doubtful"
    assert "the noise larger than given" in said.advice


@pytest.mark.parametrize("sensor", [CRS, METAL], ids=_names)
def test_small_contacts_have_a_status(sensor: Sensor) -> None:
    point = _only(simulate(sensor, Contact.points([(500.0, 500.0)]), NOISE, rng=1), sensor)
    assert point.status == ("too few strips" if sensor is CRS else "points")
    assert ("2 strips" if sensor is CRS else "too few strips for a shape") in point.advice
    assert point.profile is not None
    nothing = _scan({name: np.full(100, np.nan) for name in sensor.signatures})
    assert fit_polygon(nothing, sensor).status == "no contact"


def test_a_line_is_a_line() -> None:
    x = METAL.x_mm
    k = np.where((x > 200.0) & (x < 800.0), 0.2 + 0.0005 * x, np.nan)
    found = _only(Scan(k=k), METAL, None)
    assert found.status == "too few transitions"
    assert found.profile is not None
    np.testing.assert_allclose(found.profile[1], 1000.0 * k[found.strips], atol=0.5)


def test_contacts_at_the_ends_of_the_strips_stay_on_them() -> None:
    for shape in ([(100, 0), (800, 0), (800, 500), (100, 300)], [(100, 1000), (800, 1000), (450, 500)]):
        truth = np.array(shape, dtype=float)
        found = _only(simulate(CRS, Contact.polygon(truth), NOISE, rng=1), CRS)
        assert found.vertices[:, 1].min() >= 0.0
        assert found.vertices[:, 1].max() <= 1000.0
        assert mismatch(truth, found.vertices).iou > 0.97


def test_transitions_of_one_signature() -> None:
    scan = simulate(CRS, Contact.polygon(PENTAGON), NOISE, rng=7)
    (x,) = fitted_transitions(scan, CRS, "kh", NOISE)
    np.testing.assert_allclose(x, np.sort(PENTAGON[:, 0]), atol=12.0)
    (few,) = fitted_transitions(simulate(CRS, Contact.points([(500.0, 500.0)])), CRS, "kh")
    assert len(few) == 2


def test_many_scans_give_what_each_gives() -> None:
    scans = [simulate(CRS, Contact.polygon(PENTAGON), NOISE, rng=i) for i in range(60)]
    for many, scan in zip(fit_polygons(scans, CRS, NOISE, workers=2), scans, strict=True):
        np.testing.assert_array_equal(many.objects[0].vertices, _only(scan, CRS).vertices)
    with pytest.raises(ReadingError, match="3 strips"):  # and the other thread does not wait for ever
        fit_polygons(
            [*scans[:3], Scan(kh=np.full(3, 0.5), kl=np.full(3, 0.4)), *scans[:4]], CRS, NOISE, workers=2
        )


def test_errors_name_what_is_wrong() -> None:
    with pytest.raises(ReadingError, match="3 strips"):
        fit_polygon(Scan(k=np.array([0.1, 0.2, 0.3])), METAL)
    sheet = Sensor(construction="crs-crp", strips=3, pitch_mm=1.0, length_mm=9.0, contact_lambda_mm=0.1)
    scan = Scan(kh=np.array([0.5, 0.5, 0.5]), kl=np.array([0.4, 0.4, 0.4]))
    with pytest.raises(OptionError, match="closed form"):
        fit_polygon(scan, sheet)


@st.composite
def _garbage(draw: st.DrawFn) -> tuple[Sensor, Scan, Noise | None]:
    sensor = draw(sensors(draw(st.sampled_from(["crs-crs", "crs-m", "cyl-crs-m"])), most_strips=60))
    random = np.random.default_rng(draw(st.integers(0, 10_000)))
    n = sensor.strips
    kinds: dict[str, Callable[[], FloatArray]] = {
        "white": lambda: random.uniform(size=n),
        "flat": lambda: np.full(n, random.choice([0.0, 1.0, 0.4])),
        "bits": lambda: random.integers(0, 2, n).astype(float),
        "walk": lambda: np.clip(0.5 + np.cumsum(random.normal(0.0, 0.03, n)), 0.0, 1.0),
        "tent": lambda: 1.0 - np.abs(np.linspace(-1.0, 1.0, n)),
        "step": lambda: np.where(np.arange(n) < n // 2, 0.2, 0.9),
    }
    gap = random.uniform(size=n) < draw(st.sampled_from([0.0, 0.05, 0.5]))
    names = sensor.signatures[: draw(st.integers(1, len(sensor.signatures)))]
    kind = kinds[draw(st.sampled_from(sorted(kinds)))]
    normal = Noise(quantisation=0.01, distribution="normal")
    noise = draw(st.sampled_from([None, Noise(), *(Noise(quantisation=q) for q in (0.005, 1.0)), normal]))
    return sensor, _scan({name: np.where(gap, np.nan, kind()) for name in names}), noise


@settings(FIXED, max_examples=80)
@given(_garbage())
def test_garbage_gets_a_status_and_never_a_polygon_off_the_sensor(
    case: tuple[Sensor, Scan, Noise | None],
) -> None:
    sensor, scan, noise = case
    found = fit_polygon(scan, sensor, noise, assessment="fast")
    for o in found.objects:
        assert o.status in ("ok", "likely") or o.advice
        if o.found:
            x, y = o.vertices.T
            assert y.min() >= 0.0
            assert y.max() <= sensor.length_mm * (1.0 + 1e-12)
            touched = (
                np.array([o.strips.start, o.strips.stop - 1]) + 0.5
            ) * sensor.pitch_mm  # on, across the seam
            assert x.min() >= touched[0] - 1.001 * sensor.pitch_mm
            assert x.max() <= touched[-1] + 1.001 * sensor.pitch_mm
            assert o.area >= 0.0
            assert o.covariance is not None
            assert o.covariance.shape == (o.vertices.size, o.vertices.size)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e300, -7.0])
def test_readings_that_are_none_are_left_out(bad: float) -> None:
    scan = simulate(CRS, Contact.polygon(PENTAGON), NOISE, rng=3)
    run = scan.runs()[0]
    readings = {name: scan[name][run].copy() for name in ("kh", "kl")}
    readings["kh"][[5, 30, 31]] = bad
    found = fit_run(CRS, CRS.x_mm[run], readings, reading_sigma(NOISE, CRS))
    assert found.selection is not None
    assert found.selection.chosen.n_interior == 3
    readings["kh"][:], readings["kl"][:] = bad, bad
    assert fit_run(CRS, CRS.x_mm[run], readings).selection is None
