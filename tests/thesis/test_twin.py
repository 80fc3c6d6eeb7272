"""The digital twins: what the text allows for the rectangle, and that the printed figures go in and come out."""

from __future__ import annotations

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.data import data_path
from tacstrip.data.published import offsets_volt, published, residuals
from tacstrip.sensor.closed_form import k_metal
from tacstrip.thesis.chapter6.twin import (
    LINES,
    PLACINGS,
    PROTOTYPES,
    REGIONS,
    calibrated,
    centred,
    line_errors,
    nearest_strips,
    raw_scan,
    region_errors,
    twin,
)

CASES = [(name, how) for name, placings in PLACINGS.items() for how in placings]
TILTS = np.arange(0.0, 90.0, 0.25)


def _touches_all(sensor: ts.Sensor, contact: ts.Contact) -> bool:
    return bool(np.isfinite(ts.footprint(sensor, contact).l).all())


def _fits(sensor: ts.Sensor, contact: ts.Contact) -> bool:
    return not ts.footprint(sensor, contact).clipped


def test_errors_on_all_ten_strips_need_a_tilt_of_18_to_52_degrees() -> None:
    sensor = twin("CRS-CRS")
    tilts = [t for t in TILTS if _touches_all(sensor, centred(sensor, "middle", -t))]
    assert (round(min(tilts)), round(max(tilts))) == (18, 52)
    named = [t for t in tilts if nearest_strips(sensor, centred(sensor, "middle", -t).vertices)[1] == 3]
    assert [min(named), max(named)] == pytest.approx([30.0, 43.0], abs=0.5)


def test_on_crs_crs_the_seventh_strip_has_a_lower_vertex_whose_kink_fades_upwards() -> None:
    """The text finds the transition there "not distinctive" in the middle and the upper region, with k_h."""
    sensor, placing = twin("CRS-CRS"), PLACINGS["CRS-CRS"]["tilted"]
    bends = {}
    for region in REGIONS:
        contact = placing.contact(sensor, region)
        lowest = contact.vertices[contact.vertices[:, 1].argmin()]
        assert nearest_strips(sensor, lowest[None])[0] == 6
        kh = ts.signatures(sensor, *ts.footprint(sensor, contact))["kh"]
        bends[region] = kh[9] - 2.0 * kh[6] + kh[3], kh[6] - 2.0 * kh[3] + kh[0]  # at strips 7 and 4
    low, middle, high = (bends[region][0] for region in REGIONS)
    assert low > 1.5 * middle > 2.0 * high > 0.0
    assert all(abs(at_4) > 1.5 * at_7 for at_7, at_4 in (bends["middle"], bends["upper"]))


def test_on_crs_m_the_rectangle_fits_within_6_degrees_of_upright_and_then_misses_strip_7() -> None:
    sensor = twin("CRS-M")
    leans = [t for t in TILTS if _fits(sensor, centred(sensor, "middle", 90.0 - t))]
    assert 5.5 <= max(leans) <= 6.0
    for lean in leans:
        corners = centred(sensor, "middle", 90.0 - lean).vertices
        assert nearest_strips(sensor, corners[corners[:, 1].argmin()][None])[0] + 1 in (8, 9)


def test_the_other_reading_has_the_vertex_on_strip_7_and_hangs_over_both_edges() -> None:
    sensor, placing = twin("CRS-M"), PLACINGS["CRS-M"]["overhanging"]
    corners = placing.contact(sensor, "middle").vertices
    assert sensor.x_mm[6] == pytest.approx(corners[corners[:, 1].argmin(), 0], abs=0.1)
    assert -corners[:, 0].min() == pytest.approx(4.4, abs=0.1)
    assert corners[:, 0].max() - sensor.width_mm == pytest.approx(4.4, abs=0.1)


@pytest.mark.parametrize(("name", "how"), CASES)
@pytest.mark.parametrize("region", REGIONS)
def test_places_are_those_the_text_allows(name: str, how: str, region: str) -> None:
    sensor, placing = twin(name), PLACINGS[name][how]
    drawn = [placing.drawn(sensor, region, np.random.default_rng(seed)) for seed in range(20)]
    for contact in [placing.contact(sensor, region), *drawn]:
        corners = contact.vertices
        assert placing.allows(sensor, corners)
        assert _touches_all(sensor, contact)
        assert np.ptp(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1)) == pytest.approx(15.0)
        assert REGIONS[int(3.0 * contact.centroid[1] / sensor.length_mm)] == region
        assert _fits(sensor, contact) == placing.whole
    again = placing.drawn(sensor, region, np.random.default_rng(0))
    np.testing.assert_array_equal(again.vertices, drawn[0].vertices)
    assert len({c.centroid[1] for c in drawn}) == len(drawn)


@pytest.mark.parametrize(("name", "how"), CASES)
@pytest.mark.parametrize("region", REGIONS)
def test_printed_errors_and_offsets_come_back_out(name: str, how: str, region: str) -> None:
    sensor = twin(name)
    contact = PLACINGS[name][how].contact(sensor, region)
    ideal = ts.signatures(sensor, *ts.footprint(sensor, contact))
    raw = raw_scan(sensor, contact, region_errors(name, region))
    good = calibrated(sensor, raw)
    for signature in sensor.signatures:
        offset = offsets_volt(name, signature) / 6.05
        np.testing.assert_allclose(raw[signature] - good[signature], offset, atol=1e-12)
        errors = region_errors(name, region)[signature]
        np.testing.assert_allclose(good[signature] - ideal[signature], errors, atol=1e-12)


def test_errors_are_those_of_the_right_figures() -> None:
    upper = region_errors("CRS-CRS", "upper")
    np.testing.assert_array_equal(upper["kh"], residuals("6.9"))
    np.testing.assert_array_equal(upper["kl"], residuals("6.15"))
    np.testing.assert_array_equal(region_errors("CRS-M", "middle")["k"], residuals("6.29"))
    np.testing.assert_allclose(line_errors()[0], [-0.005, -0.009])
    assert line_errors().shape == (len(LINES), 2)


def test_a_reading_that_would_leave_the_scale_stops_at_vref() -> None:
    sensor = twin("CRS-CRS")
    raw = raw_scan(
        sensor, ts.Contact.line([(0.0, 320.0), (65.0, 320.0)]), dict.fromkeys(("kh", "kl"), np.zeros(10))
    )
    assert raw["kh"].max() == 1.0
    assert raw["kh"].min() < 1.0


def test_twins_have_the_printed_geometry() -> None:
    for printed in published()["prototype"]:
        sensor = twin(printed["sensor"])
        assert sensor.strips == printed["strips"]
        assert sensor.length_mm == pytest.approx(10.0 * printed["strip_length_cm"])
        assert sensor.strip_width == pytest.approx(10.0 * printed["strip_width_cm"])
        assert sensor.width_mm == pytest.approx(10.0 * printed.get("digital_extent_cm", 2.0))
        assert 10.0 / sensor.pitch_mm == pytest.approx(printed["elements_per_cm"], abs=0.05)
        assert sensor.radius_mm == (pytest.approx(9.0) if "radius_cm" in printed else None)
        assert sensor.vref_volt == 6.05
    assert len(PROTOTYPES) == len(published()["prototype"])


def test_points_on_the_tube_read_their_height() -> None:
    sensor = twin("Cyl-CRS-M")
    (first, y), _ = LINES[0]
    contact = ts.Contact.points([(sensor.x_mm[first], y)])
    raw = raw_scan(sensor, contact, {"k": np.zeros(5)})
    expected = k_metal(np.array(y), np.array(0.0), sensor.length_mm) + 0.345 / 6.05
    assert raw["k"][first] == pytest.approx(float(expected))
    assert np.isnan(raw["k"][1:]).all()


def test_the_demo_reads_the_twin_in_the_middle() -> None:
    sensor = twin("CRS-CRS")
    contact = PLACINGS["CRS-CRS"]["tilted"].contact(sensor, "middle")
    np.testing.assert_allclose(
        ts.read_contact(data_path("demo_contact.wkt")).vertices, contact.vertices, atol=1e-5
    )
    plain = ts.Sensor.load(PROTOTYPES["CRS-CRS"])
    read = ts.read_readings(data_path("demo_readings.csv"), plain)[0]
    raw = raw_scan(sensor, contact, region_errors("CRS-CRS", "middle"))
    for signature in ("kh", "kl"):
        np.testing.assert_allclose(read[signature], raw[signature], atol=0.0005 / 6.05 + 1e-9)
