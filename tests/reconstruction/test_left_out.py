"""Channels that are left out, and dead, stuck and saturated ones that are not."""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from matplotlib.text import Annotation

import tacstrip as ts
from polygons import SURE, WHY
from tacstrip.cli import cli
from tacstrip.errors import ReadingError, SpecError
from tacstrip.geometry.moments import area
from tacstrip.geometry.outline import Outline
from tacstrip.io import feature_collection
from tacstrip.plot.results import reconstruction_figure
from tacstrip.reconstruction.cramer_rao import vertex_covariance, vertex_jacobian
from tacstrip.sensor.calibration import Calibration
from tacstrip.sensor.channel import Channel
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.left_out import channel_name, leave_out, left_out
from tacstrip.sensor.raw import apply_calibration, touched
from tacstrip.sensor.surface import Surface
from tacstrip.stream import decode, encode

SENSOR = ts.Sensor(construction="crs-crs", strips=10, pitch_mm=10.0, length_mm=100.0, strip_base=1)
TRUTH = [(12.0, 38.0), (48.0, 12.0), (93.0, 45.0), (60.0, 88.0)]
NOISE = ts.Noise(positional=0.005)


def scan_with(value: float, strip: int = 5, name: str = "kh", seed: int = 1) -> ts.Scan:
    """Return a scan whose one channel reads a value of its own."""
    scan = ts.simulate(SENSOR, ts.Contact.polygon(TRUTH), NOISE, rng=seed)
    k = {n: scan[n].copy() for n in ("kh", "kl")}
    k[name][strip] = value
    return ts.Scan(kh=k["kh"], kl=k["kl"])


@pytest.mark.parametrize("seed", range(3))
def test_an_object_that_may_go_on_under_strips_left_out_is_doubted(seed: int) -> None:
    fine = replace(SENSOR, strips=20, pitch_mm=5.0)
    contact, few = ts.Contact.polygon([(22, 35), (50, 18), (70, 62), (40, 70)]), ts.Noise(positional=0.002)
    scan = ts.simulate(fine, contact, few, rng=seed)
    assert ts.fit_polygon(scan, fine, few).status == SURE
    last = int(np.flatnonzero(scan.touched)[-1]) + 1  # as the file counts
    hidden = replace(fine, without=tuple(str(last - n) for n in range(3)))
    for find in (ts.fit_polygon, ts.profile_reconstruction):
        (found,) = find(scan, hidden).objects
        assert ts.mismatch(contact.vertices, found.vertices).iou < 0.8
        assert found.status == "doubtful"
        assert f"strip {last - 2}, {last - 1}, {last} beside it is left out" in found.advice
    assert [piece.status for piece in ts.pieces(scan, hidden, few)] == ["doubtful"]
    (beyond,) = ts.fit_polygon(scan, replace(fine, without=("1", "20")), few).objects
    assert (beyond.status, beyond.advice) == (SURE, WHY)


def test_deviations_count_what_may_lie_under_one_strip_left_out_beside_an_object() -> None:
    """The fit took it to end before that strip: it was ok, with an area 4 stated deviations too small."""
    fine, few = replace(SENSOR, strips=20, pitch_mm=5.0), ts.Noise(positional=0.002)
    corners = np.array([(22.0, 35.0), (50.0, 18.0), (76.0, 42.0), (76.0, 62.0), (40.0, 70.0)])
    scan = ts.simulate(fine, ts.Contact.polygon(corners), few, rng=32)
    last = int(np.flatnonzero(scan.touched)[-1]) + 1  # as the file counts
    whole, found, apart = (
        ts.fit_polygon(scan, replace(fine, without=names), few).objects[0]
        for names in ((), (f"{last}",), (f"{last + 2}",))
    )
    assert whole.deviations is not None
    assert found.deviations is not None
    assert apart.deviations is not None
    short = area(corners) - found.area
    assert 4.0 * whole.deviations[0] < short < 2.0 * found.deviations[0]
    assert (found.status, found.guaranteed) == (SURE, None)
    assert f"strip {last}, left out, may be touched: there the outline is open" in found.advice
    # The next strip is read, and tells where the object ends.
    assert whole.guaranteed is not None
    assert apart.guaranteed is not None
    assert (apart.deviations[0], apart.advice) == (whole.deviations[0], whole.advice)


def test_names_are_strip_and_channel_as_the_file_counts() -> None:
    sensor = replace(SENSOR, without=("7:v_h", "1"))
    out = left_out(sensor)
    assert np.flatnonzero(out["kh"]).tolist() == [0, 6]
    assert np.flatnonzero(out["kl"]).tolist() == [0]
    assert ts.Sensor.from_dict(tomllib.loads(sensor.to_toml())) == sensor
    assert '# without = ["2"]' in SENSOR.to_toml()


@pytest.mark.parametrize(
    ("without", "told"),
    [
        ("7:v_h", "must be a list"),
        (["0:v_h"], "there is no strip 0; strips are 1 to 10"),
        (["11"], "there is no strip 11"),
        (["7:v_out"], "channel 'v_out' does not exist; choose one of: v_h, v_l"),
        (["v_h"], "give strip:channel, such as 7:v_h"),
        ([7], "give strip:channel"),
    ],
)
def test_what_names_no_channel_is_refused(without: Any, told: str) -> None:
    with pytest.raises(SpecError, match=told):
        replace(SENSOR, without=without)


def test_a_sheet_solves_all_strips_together() -> None:
    with pytest.raises(SpecError, match="solves all strips together"):
        ts.Sensor(
            construction="crs-crp",
            strips=4,
            pitch_mm=5.0,
            length_mm=50.0,
            contact_lambda_mm=2.0,
            without=("1:v_h",),
        )


@pytest.mark.parametrize("method", ["polygon", "profile", "vertex"])
@pytest.mark.parametrize("value", [0.0, 1.0, 0.4])
def test_every_method_takes_what_is_left(method: str, value: float) -> None:
    sensor = replace(SENSOR, without=("6:v_h",))
    with_value, without = (
        ts.reconstruct(s, sensor, NOISE, method=method) for s in (scan_with(value), scan_with(np.nan))
    )
    assert with_value.status == without.status
    np.testing.assert_array_equal(with_value.objects[0].vertices, without.objects[0].vertices)
    if method != "vertex":
        assert ts.mismatch(TRUTH, with_value.objects[0].vertices).iou > 0.85


def test_a_strip_with_one_reading_counts_with_that_one() -> None:
    """The bound with one reading lies between that of both and that of none, and the fit's covariance says the same."""
    outline, sigma = Outline.of(TRUTH), 0.005 / np.sqrt(3.0)
    both, one, none = (
        np.trace(vertex_covariance(outline, replace(SENSOR, without=w), sigma))
        for w in ((), ("6:v_h",), ("6",))
    )
    assert both < one < none
    rows = [len(vertex_jacobian(outline, replace(SENSOR, without=w))) for w in ((), ("6:v_h",), ("6",))]
    assert rows == [rows[0], rows[0] - 1, rows[0] - 2]
    scan = scan_with(np.nan)
    assert scan.touched[5]
    assert scan.half_read.tolist() == [i == 5 for i in range(10)]
    assert len(scan.runs()) == 1
    found = ts.fit_polygon(scan, SENSOR, NOISE, bounded=False, vertices=4).objects[0]
    assert found.covariance is not None
    assert 0.5 * one < np.trace(found.covariance) < 2.0 * one


def test_a_faulty_channel_is_found_where_its_partner_shows_it() -> None:
    """No k_h lies on ground below its k_l; before, neighbours of such a channel were left out with it."""
    for seed in range(3):
        for name, value in (("kh", 0.0), ("kl", 1.0)):
            found = ts.fit_polygon(scan_with(value, 4, name, seed), SENSOR, NOISE)
            left = ts.fit_polygon(scan_with(np.nan, 4, name, seed), SENSOR, NOISE)
            assert found.status == left.status
            assert "strip 5 (" in found.advice
            np.testing.assert_allclose(found.objects[0].vertices, left.objects[0].vertices, atol=1e-6)


@pytest.mark.parametrize("noise", [NOISE, None], ids=["told", "unknown"])
@pytest.mark.parametrize(
    ("strip", "name", "value"),
    [(5, "kh", 0.0), (3, "kh", 0.95), (6, "kl", 0.1), (2, "kl", 0.5), (5, "kh", 0.35)],
)
def test_a_faulty_channel_that_nobody_named_costs_its_own_reading(
    strip: int, name: str, value: float, noise: ts.Noise | None
) -> None:
    """Where noise is estimated it passed for noise, and the result was a line."""
    (found,) = ts.fit_polygon(scan_with(value, strip, name), SENSOR, noise).objects
    (left,) = ts.fit_polygon(scan_with(np.nan, strip, name), SENSOR, noise).objects
    assert (found.status, left.status) == (SURE, SURE)
    assert found.faulty == (channel_name(strip, name, 1),)
    assert f"strip {strip + 1} ({SIGNATURES[name].symbol} = {value:.3g})" in found.advice
    assert "press elsewhere and run the doctor" in found.advice
    assert ts.mismatch(left.vertices, found.vertices).iou > 0.95


@pytest.mark.parametrize("noise", [NOISE, None], ids=["told", "unknown"])
@pytest.mark.parametrize(
    ("strip", "name", "value"), [(4, "kl", 0.55), (5, "kh", 0.2), (4, "kh", 0.0), (5, "kl", 0.1)]
)
def test_a_faulty_channel_is_singled_out_on_six_strips(
    strip: int, name: str, value: float, noise: ts.Noise | None
) -> None:
    """Eleven readings are left for eight numbers and a little: the others, left out in turn, explain nothing."""
    corners = [(21, 45), (44, 21), (79, 40), (56, 78)]
    scan = ts.simulate(SENSOR, ts.Contact.polygon(corners), ts.Noise(positional=0.003), rng=1)
    assert scan.touched.sum() == 6
    read = {n: scan[n].copy() for n in ("kh", "kl")}
    read[name][strip] = value
    scan = ts.Scan(kh=read["kh"], kl=read["kl"])
    (found,) = ts.fit_polygon(scan, SENSOR, noise).objects
    assert (found.status, found.faulty) == (SURE, (channel_name(strip, name, 1),))
    assert ts.mismatch(corners, found.vertices).iou > 0.95


def test_a_faulty_channel_says_nothing_of_untouched_strips() -> None:
    """An untouched strip with readings contradicts the others in both."""
    contact = ts.Contact.polygon([(1, 38), (48, 12), (99, 45), (60, 88)])
    scan = ts.simulate(SENSOR, contact, NOISE, rng=1)
    assert scan.touched.all()
    kh = scan["kh"].copy()
    kh[5] = 1.0
    scan = ts.Scan(kh=kh, kl=scan["kl"])
    result = ts.fit_polygon(scan, SENSOR, NOISE)
    (found,) = result.objects
    assert (found.status, found.faulty) == (SURE, ("6:v_h",))
    assert "every strip has a reading" not in found.advice
    (feature,) = feature_collection([result])["features"]
    assert feature["properties"]["faulty"] == ["6:v_h"]
    readings = reconstruction_figure(SENSOR, [scan], {"polygon": [result]}).axes[-1]
    (note,) = (t for t in readings.texts if isinstance(t, Annotation))
    assert (note.get_text(), note.xy) == ("6:v_h not used", (SENSOR.x_mm[5], 1.0))


def test_a_faulty_channel_is_no_border_of_strips_at_rest() -> None:
    """Four strips under a thin end of the contact read about one level, up to where a channel is saturated."""
    contact = ts.Contact.polygon([(1, 48), (60, 46), (99, 30), (99, 70), (60, 51)])
    scan = ts.simulate(SENSOR, contact, NOISE, rng=1)
    kl = scan["kl"].copy()
    kl[4] = 1.0
    (found,) = ts.fit_polygon(ts.Scan(kh=scan["kh"], kl=kl), SENSOR, NOISE, one_object=True).objects
    assert found.faulty == ("5:v_l",)
    assert "rest_volt" not in found.advice
    # Other concave outlines explain its ten strips, too: it is not sure enough for "ok".
    assert found.confidence is not None
    assert found.confidence > 0.8


def test_a_stuck_channel_that_hardly_moves_the_other_end_is_named() -> None:
    """It moves one end by 19 deviations and the other by 3.5; the strip's other reading agrees with all strips."""
    kh = [np.nan, 0.5686, 0.5706, 0.6748, 0.666, 0.7127, 0.7567, 0.7981, 0.8385, 0.887]
    kl = [np.nan, 0.5488, 0.3832, 0.4238, 0.5081, 0.5873, 0.6595, 0.7297, 0.8089, 0.8819]
    sensor = replace(SENSOR, pitch_mm=1.66511, length_mm=23.4406, resistivity_ratio=1.97737)
    scan = ts.Scan(kh=np.array(kh), kl=np.array(kl))
    (found,) = ts.fit_polygon(scan, sensor, assessment="fast").objects
    assert (found.status, found.faulty) == ("ok", ("4:v_h",))
    assert ts.mismatch(np.array([(4.45, 7.5), (16.24, 20.94), (2.32, 13.31)]), found.vertices).iou > 0.95


@pytest.mark.parametrize("noise", [NOISE, None], ids=["told", "unknown"])
@pytest.mark.parametrize("strip", [1, 2, 3, 5])
@pytest.mark.parametrize(("low", "high"), [(70, 75), (92, 98), (2, 6)])
def test_a_second_object_on_one_strip_is_no_faulty_channel(
    strip: int, low: float, high: float, noise: ts.Noise | None
) -> None:
    x = float(SENSOR.x_mm[strip])
    one = ts.Contact.polygon([(2, 48), (48, 22), (99, 45), (60, 66)])
    other = ts.Contact.polygon([(x - 4, low), (x + 4, low), (x + 4, high), (x - 4, high)])
    scan = ts.simulate(SENSOR, one + other, NOISE, rng=strip)
    (found,) = ts.fit_polygon(scan, SENSOR, noise, assessment="fast").objects
    assert found.faulty == ()
    told = "two objects" in found.advice and "the outline holds either way" in found.advice
    assert found.status == "doubtful" or told


def test_a_whole_signature_may_be_missing() -> None:
    scan = scan_with(0.3)
    half = ts.Scan(kh=np.full(10, np.nan), kl=scan.kl)
    alone = ts.fit_polygon(ts.Scan(kl=scan.kl), SENSOR, NOISE)
    np.testing.assert_array_equal(
        ts.fit_polygon(half, SENSOR, NOISE).objects[0].vertices, alone.objects[0].vertices
    )


def test_a_stuck_channel_does_not_touch_its_strip() -> None:
    """With rest_volt a channel stuck far from rest makes its strip touched for ever, unless it is left out."""
    sensor = replace(SENSOR, rest_volt=0.0, touch_volt=0.1, without=("2:v_h",))
    raw = {"kh": np.zeros(10), "kl": np.zeros(10)}
    raw["kh"][1] = 0.6
    assert not touched(sensor, raw).any()
    assert touched(replace(sensor, without=()), raw).tolist() == [i == 1 for i in range(10)]


def test_codes_keep_what_the_spec_leaves_out_and_refuse_other_gaps() -> None:
    sensor = replace(SENSOR, adc_bits=12, without=("6:v_h",))
    scan = ts.simulate(sensor, ts.Contact.polygon(TRUTH), NOISE)
    again = decode(encode(scan, sensor), sensor)
    np.testing.assert_array_equal(np.isnan(again["kh"]), np.isnan(scan["kh"]))
    with pytest.raises(ReadingError, match=r'without = \["6:v_h"\]'):
        encode(scan_with(np.nan), replace(SENSOR, adc_bits=12))


def test_a_calibration_corrects_a_strip_with_one_reading() -> None:
    channel = Channel(signature="kl", offset=tuple(np.full(10, 0.01)))
    sensor = replace(SENSOR, calibration=Calibration(channels=(channel,)))
    raw = {"kh": np.full(10, 0.6), "kl": np.full(10, 0.41)}
    raw["kh"][3] = np.nan
    np.testing.assert_allclose(apply_calibration(sensor, raw)["kl"], 0.40)
    assert leave_out(sensor, raw).keys() == raw.keys()


def test_the_command_line_leaves_channels_out(tmp_path: Path) -> None:
    spec, file, out = tmp_path / "sensor.toml", tmp_path / "readings.csv", tmp_path / "shapes.geojson"
    SENSOR.save(spec)
    ts.write_readings(file, SENSOR, [scan_with(0.35)])
    run = CliRunner().invoke(
        cli,
        ["reconstruct", str(spec), str(file), "-o", str(out), "--positional", "0.005", "--without", "6:v_h"],
    )
    assert run.exit_code == 0, run.output
    assert "Warning" not in run.output
    ring = json.loads(out.read_text())["features"][0]["geometry"]["coordinates"][0]
    assert ts.mismatch(TRUTH, ring[:-1]).iou > 0.85
    ts.write_readings(file, SENSOR, [scan_with(np.nan)])
    run = CliRunner().invoke(cli, ["reconstruct", str(spec), str(file), "-o", str(out), "--force"])
    assert "6:v_h is empty where the strip's other channel has a reading" in run.output


def test_a_strip_left_out_by_name_neither_splits_its_contact_nor_is_asked_about() -> None:
    noise = ts.Noise(positional=0.005)
    scan = ts.simulate(SENSOR, ts.Contact.polygon(TRUTH), noise, rng=1)
    kh, kl = scan["kh"].copy(), scan["kl"].copy()
    kh[5] = kl[5] = np.nan
    assert (
        len(ts.fit_polygon(ts.Scan(kh=kh, kl=kl), SENSOR, noise).objects) == 2
    )  # an empty strip is untouched
    named = ts.fit_polygon(ts.Scan(kh=kh, kl=kl), replace(SENSOR, without=("6",)), noise)
    assert len(named.objects) == 1
    assert "broken" not in named.advice
    assert ts.mismatch(TRUTH, named.objects[0].vertices).iou > 0.85


def test_an_object_on_strips_of_one_signature_is_as_by_itself_beside_one_that_has_both() -> None:
    sensor = ts.Sensor(
        construction="crs-crs",
        strips=40,
        pitch_mm=2.5,
        length_mm=100.0,
        without=tuple(f"{i}:v_l" for i in range(22)),
    )
    noise = ts.Noise(positional=0.003)
    one = ts.Contact.polygon([(40.4, 58.9), (25.6, 68.0), (17.2, 33.8), (30.2, 32.8)])
    both = one + ts.Contact.polygon([(70, 40), (95, 45), (80, 70)])
    alone, beside = (ts.simulate(sensor, contact, noise, rng=2) for contact in (one, both))
    polygon, known = partial(ts.fit_polygon, assessment="none"), partial(ts.fit_object, outline=one)
    for fit in (polygon, known):
        (by_itself,), (first, _) = (fit(scan, sensor, noise=noise).objects for scan in (alone, beside))
        assert first.status == by_itself.status
        np.testing.assert_allclose(first.vertices, by_itself.vertices, atol=1e-6)
    with pytest.raises(ts.SignatureError, match="one channel is left out"):
        ts.pieces(beside, sensor, noise)


@pytest.mark.parametrize("around_deg", [180.0, 360.0], ids=["half", "tube"])
def test_strips_left_out_count_on_a_curved_skin_too(around_deg: float) -> None:
    """They hid half of the object there, and what was read of it was ok."""
    skin = Surface(kind="cylinder", radius_mm=20.0, height_mm=60.0, around_deg=around_deg)
    pitch = skin.pitch_mm(24)
    sensor = ts.Sensor(
        construction="crs-crs", strips=24, pitch_mm=pitch, length_mm=skin.length_mm(24), surface=skin
    )
    contact = ts.Contact.polygon([(7 * pitch, 15), (17 * pitch, 15), (17 * pitch, 45), (7 * pitch, 45)])
    noise = ts.Noise(positional=0.002)
    scan = ts.simulate(sensor, contact, noise, rng=1)
    beside, within = (replace(sensor, without=names) for names in (("14", "15", "16"), ("11", "12")))
    (found,) = ts.reconstruct(scan, beside, method="profile").objects
    assert (found.status, found.advice[:12]) == ("doubtful", "strip 14, 15")
    assert [o.status for o in ts.reconstruct(scan, within, method="profile").objects] == ["doubtful"] * 2
    (found,) = ts.fit_polygon(scan, within, noise, assessment="none").objects
    assert (found.status, found.advice) == ("likely", "")


def test_strips_left_out_beyond_a_curved_tube_s_seam_count() -> None:
    skin = Surface(kind="cylinder", radius_mm=20.0, height_mm=60.0)
    pitch = skin.pitch_mm(24)
    sensor = ts.Sensor(construction="crs-crs", strips=24, pitch_mm=pitch, length_mm=skin.length_mm(24),
                       surface=skin, without=("21", "22", "23"))  # fmt: skip
    contact = ts.Contact.polygon([(-3 * pitch, 15), (6 * pitch, 15), (6 * pitch, 45), (-3 * pitch, 45)])
    (found,) = ts.reconstruct(ts.simulate(sensor, contact), sensor, method="profile").objects
    assert (found.strips, found.status) == (slice(0, 6), "doubtful")
    assert found.advice.startswith("strip 23, 22, 21 beside it is left out")
