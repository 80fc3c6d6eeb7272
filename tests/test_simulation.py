"""One scan: what it holds and refuses; and the scan that a sensor makes of a contact."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from strategies import FIXED, areas
from tacstrip.arrays import FloatArray
from tacstrip.contact.footprint import footprint
from tacstrip.contact.noise import Noise
from tacstrip.contact.shape import Contact
from tacstrip.errors import ContactError, OptionError, ReadingError, SignatureError
from tacstrip.scan import Scan
from tacstrip.sensor.constructions import CONSTRUCTIONS
from tacstrip.sensor.spec import Sensor
from tacstrip.simulation import readings, simulate

NAN = float("nan")


def sensor_of(construction: str, **keys: Any) -> Sensor:
    """Return a sensor of 24 strips, 48 mm by 80 mm, of any construction."""
    if construction.startswith("cyl"):
        keys = {"radius_mm": 9.0} | keys
    if construction == "crs-crp":
        keys = {"resistivity_ratio": 100.0, "contact_lambda_mm": 1.5} | keys
    return Sensor(construction=construction, strips=24, pitch_mm=2.0, length_mm=80.0, **keys)


CLOSED = sorted(name for name, kind in CONSTRUCTIONS.items() if kind.closed_form)
RUBBER, METAL = sensor_of("crs-crs"), sensor_of("crs-m")

# Scans.


def test_a_scan_holds_what_was_measured() -> None:
    scan = Scan(kh=[0.5, NAN, 1.0], kl=[0.25, NAN, 0.0], time_s=2.5)  # type: ignore[arg-type]
    assert scan.signatures == ("kh", "kl")
    assert scan.k is None
    assert scan.time_s == 2.5
    np.testing.assert_array_equal(scan["kl"], [0.25, NAN, 0.0])
    np.testing.assert_array_equal(scan.touched, [True, False, True])  # 0 is a reading


def test_a_scan_keeps_a_copy_that_cannot_be_written() -> None:
    mine = np.array([0.5, 0.6])
    scan = Scan(k=mine)
    mine[0] = 0.9
    assert scan["k"][0] == 0.5
    with pytest.raises(ValueError, match="read-only"):
        scan["k"][0] = 0.9


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Scan(), "a scan needs at least one signature: kh, kl or k"),
        (
            lambda: Scan(kh=np.array([0.1, 1.01, 2.0])),
            "kh of strip 1 is 1.01, outside 0..1: it is a voltage over Vref",
        ),
        (
            lambda: Scan(kh=np.array([0.5, NAN]), kl=np.array([-0.001, NAN])),
            "kl of strip 0 is -0.001, outside 0..1: it is a voltage over Vref",
        ),
        (lambda: Scan(k=np.array([np.inf])), "k of strip 0 is inf, outside 0..1: it is a voltage over Vref"),
        (lambda: Scan(kh=np.zeros(3), kl=np.zeros(4)), "kh has 3 strips and kl has 4"),
        (
            lambda: Scan(k=np.array([0.5]), time_s=NAN),
            "time_s = nan: must be a time in seconds, a finite number",
        ),
        (
            lambda: Scan(k=np.array([0.5]), time_s="now"),  # type: ignore[arg-type]
            "time_s = 'now': must be a time in seconds, a finite number",
        ),
        (lambda: Scan(k=np.zeros((2, 3))), "k needs one value per strip, not an array of shape (2, 3)"),
        (lambda: Scan(k=np.zeros(0)), "k needs one value per strip, not an array of shape (0,)"),
        (lambda: Scan(k=np.array(0.5)), "k needs one value per strip, not an array of shape ()"),
        (
            lambda: Scan(kl=["a", "b"]),  # type: ignore[arg-type]
            "kl needs one number per strip, NaN where nothing touches",
        ),
        (
            lambda: Scan(kl=[[0.1], [0.2, 0.3]]),  # type: ignore[arg-type]
            "kl needs one number per strip, NaN where nothing touches",
        ),
    ],
)
def test_impossible_scans(make: Callable[[], Scan], message: str) -> None:
    with pytest.raises(ReadingError) as caught:
        make()
    assert str(caught.value) == message


@pytest.mark.parametrize("name", ["k", "k_h", "time_s", "signatures"])
def test_a_signature_that_is_not_there(name: str) -> None:
    with pytest.raises(SignatureError) as caught:
        Scan(kh=np.zeros(2), kl=np.zeros(2))[name]
    assert str(caught.value) == f"the scan has no {name!r}; it has: kh, kl"


@FIXED
@given(st.lists(st.booleans(), min_size=1, max_size=30))
def test_runs_are_the_strips_touched_side_by_side(touched: list[bool]) -> None:
    runs = Scan(k=np.where(touched, 0.5, NAN)).runs()
    covered = [i for run in runs for i in range(run.start, run.stop)]
    assert covered == [i for i, here in enumerate(touched) if here]
    for run in runs:
        assert run.start < run.stop
    for before, after in pairwise(runs):
        assert before.stop < after.start


def test_runs_by_hand() -> None:
    scan = Scan(k=np.array([0.1, 0.2, NAN, 0.0, NAN, NAN, 1.0]))
    assert scan.runs() == [slice(0, 2), slice(3, 4), slice(6, 7)]
    assert Scan(k=np.array([NAN, NAN])).runs() == []


def test_a_scan_is_checked_against_its_sensor() -> None:
    good = Scan(k=np.full(24, 0.5))
    good.check(METAL)
    with pytest.raises(ReadingError) as caught:
        Scan(k=np.full(23, 0.5)).check(METAL)
    assert str(caught.value) == "the scan has 23 strips and the sensor has 24"
    with pytest.raises(SignatureError) as refused:
        good.check(RUBBER)
    assert str(refused.value) == "a crs-crs sensor has no signature 'k'; it has: kh, kl"


# Simulated scans.


def closed_form(sensor: Sensor, l: FloatArray, u: FloatArray) -> dict[str, FloatArray]:
    """Return (3.3), (3.4) and (3.8) as they are printed, for the signatures of a sensor."""
    w, length = u - l, sensor.length_mm
    kh, kl, k = (l + w / 2.0) / (length - w / 2.0), l / (length - w / 2.0), l / (length - w)
    return {name: {"kh": kh, "kl": kl, "k": k}[name] for name in sensor.signatures}


@pytest.mark.parametrize("construction", CLOSED)
def test_a_scan_is_the_closed_form_on_the_footprint(construction: str) -> None:
    sensor = sensor_of(construction)

    @settings(FIXED, max_examples=40)
    @given(areas((12.0, 20.0, 36.0, 60.0)))
    def equal(contact: Contact) -> None:
        scan = simulate(sensor, contact, time_s=0.25)
        l, u = footprint(sensor, contact)
        assert scan.signatures == sensor.signatures
        assert scan.time_s == 0.25
        scan.check(sensor)
        for name, expected in closed_form(sensor, l, u).items():
            np.testing.assert_allclose(scan[name], expected, atol=1e-12)

    equal()


def test_a_scan_of_a_contact_between_strips_is_empty() -> None:
    scan = simulate(METAL, Contact.polygon([(5.1, 10.0), (6.9, 10.0), (6.0, 20.0)]))
    assert not scan.touched.any()


def test_a_contact_at_the_edges_reads_nought_and_one() -> None:
    scan = simulate(RUBBER, Contact.polygon([(0, 0), (48, 0), (48, 80), (0, 80)]))
    np.testing.assert_array_equal(scan["kh"], 1.0)
    np.testing.assert_array_equal(scan["kl"], 0.0)


@pytest.mark.parametrize(("strip_base", "strip"), [(0, 3), (1, 4)])
@pytest.mark.parametrize("construction", ["crs-m", "cyl-crs-m"])
def test_a_short_on_metal_is_refused_with_the_number_of_its_strip(
    construction: str, strip_base: int, strip: int
) -> None:
    sensor = sensor_of(construction, strip_base=strip_base)
    contact = Contact.polygon([(4.0, 5.0), (6.0, -1.0), (9.0, -1.0), (9.0, 81.0), (6.0, 81.0), (4.0, 5.0)])
    with pytest.raises(ContactError) as caught:
        simulate(sensor, contact)
    assert str(caught.value) == (
        f"the contact covers strip {strip} from end to end: on metal that shorts Vref to ground, "
        "and nothing can be read"
    )


def test_an_unknown_model_is_refused() -> None:
    with pytest.raises(OptionError) as caught:
        simulate(METAL, Contact.points((5.0, 5.0)), model="spice")  # type: ignore[arg-type]
    assert str(caught.value).startswith("model 'spice' does not exist; choose one of: closed")


# Many scans at once, noise and seeds.


def some_contacts(sensor: Sensor, scans: int = 5) -> tuple[FloatArray, FloatArray]:
    """Return l and u (scans, strips) with gaps."""
    rng = np.random.default_rng(9)
    l = rng.uniform(0.0, 40.0, (scans, sensor.strips))
    l[rng.uniform(size=l.shape) < 0.3] = NAN
    return l, l + rng.uniform(0.0, 39.0, l.shape)


@pytest.mark.parametrize("construction", CLOSED)
@pytest.mark.parametrize("bits", [None, 10])
def test_many_scans_are_their_rows_one_by_one(construction: str, bits: int | None) -> None:
    sensor = sensor_of(construction, adc_bits=bits, contact_lambda_mm=1.5)
    l, u = some_contacts(sensor)
    together = readings(sensor, l, u)
    assert tuple(together) == sensor.signatures
    for scan in range(len(l)):
        for name, k in readings(sensor, l[scan], u[scan]).items():
            np.testing.assert_array_equal(together[name][scan], k)
    for k in together.values():
        np.testing.assert_array_equal(np.isnan(k), np.isnan(l))


def test_the_converter_of_the_spec_reads() -> None:
    l, u = some_contacts(RUBBER)
    ideal, read = readings(RUBBER, l, u), readings(sensor_of("crs-crs", adc_bits=10), l, u)
    for name in RUBBER.signatures:
        np.testing.assert_allclose(read[name], np.round(ideal[name] * 1023.0) / 1023.0, rtol=1e-15)
        assert np.nanmax(np.abs(read[name] - ideal[name])) > 0.4 / 1023.0


CONTACT = Contact.polygon([(8.0, 20.0), (40.0, 10.0), (30.0, 60.0)])
NOISE = Noise(quantisation=0.01, positional=0.02)


@pytest.mark.parametrize("construction", sorted(CONSTRUCTIONS))
def test_a_seed_returns_its_scan(construction: str) -> None:
    sensor = sensor_of(construction)
    ideal = simulate(sensor, CONTACT)
    first, again, other = (simulate(sensor, CONTACT, NOISE, rng=seed) for seed in (1, 1, 2))
    here = ideal.touched
    for name in sensor.signatures:
        np.testing.assert_array_equal(first[name], again[name])
        assert (first[name][here] != other[name][here]).all()
        assert (first[name][here] != ideal[name][here]).all()
        assert np.abs(first[name] - ideal[name])[here].max() <= 0.03
        np.testing.assert_array_equal(first.touched, here)


def test_a_generator_goes_on() -> None:
    rng = np.random.default_rng(1)
    first, second = simulate(METAL, CONTACT, NOISE, rng=rng), simulate(METAL, CONTACT, NOISE, rng=rng)
    np.testing.assert_array_equal(first["k"], simulate(METAL, CONTACT, NOISE, rng=1)["k"])
    assert (first["k"] != second["k"])[first.touched].all()


def test_both_ends_of_a_strip_have_errors_of_their_own() -> None:
    l, u = np.full((400, 24), 20.0), np.full((400, 24), 60.0)
    ideal, noisy = readings(RUBBER, l, u), readings(RUBBER, l, u, NOISE, rng=3)
    of_kh, of_kl = ((noisy[name] - ideal[name]).ravel() for name in ("kh", "kl"))
    assert abs((of_kh * of_kl).mean()) < 0.05 * of_kh.std() * of_kl.std()
    for error in (of_kh, of_kl):
        assert error.var() == pytest.approx((0.01**2 + 0.02**2) / 3.0, rel=0.05)


def test_noise_cannot_push_a_scan_out_of_range() -> None:
    touching_the_ground = Contact.polygon([(0, 0), (48, 0), (48, 0.5), (0, 0.5)])
    k = simulate(METAL, touching_the_ground, Noise(positional=0.5), rng=4)["k"]
    assert (k == 0.0).any()
    assert (k > 0.3).any()


def test_transition_error_does_not_show_in_a_scan() -> None:
    noisy = simulate(METAL, CONTACT, Noise(transition_mm=50.0), rng=5)
    np.testing.assert_array_equal(noisy["k"], simulate(METAL, CONTACT)["k"])


@pytest.mark.parametrize("text", ["0.5", "1_0", "٠", b"0.5"])
def test_a_text_is_no_number_whatever_numpy_takes_it_for(text: str | bytes) -> None:
    t: Any = text
    for k in ([t, t], [t, 0.5], [0.5, t, None], np.array([t])):
        with pytest.raises(ReadingError, match="kh needs one number per strip"):
            Scan(kh=k)  # type: ignore[arg-type]
    for points in ([(t, t)], [(t, 1.0), (2.0, 3.0)], np.array([[t, t]])):
        with pytest.raises(ContactError, match="needs numbers"):
            Contact.points(points)
    read: Any = [0.5, None, True]
    np.testing.assert_array_equal(Scan(kh=read)["kh"], [0.5, np.nan, 1.0])


def test_a_reading_beyond_0_or_1_by_rounding_is_none() -> None:
    scan = Scan(kh=np.array([np.nextafter(1.0, 2.0), np.nan]), kl=np.array([-1e-16, np.nan]))
    np.testing.assert_array_equal(scan["kh"], [1.0, np.nan])
    np.testing.assert_array_equal(scan["kl"], [0.0, np.nan])
    with pytest.raises(ReadingError, match=r"outside 0\.\.1"):
        Scan(kh=np.array([1.0 + 1e-4]))
    assert Scan(kh=np.array([np.float32(1.0) + np.finfo(np.float32).eps]))["kh"] == 1.0
