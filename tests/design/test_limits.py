"""`tacstrip limits`: the bound as numbers and a map, designs that reach an error, and what a user gets wrong."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.core.binding import exported
from tacstrip.dataset.measures import Case
from tacstrip.dataset.sweep import changed
from tacstrip.design.area import area_limit, circle
from tacstrip.design.candidates import candidates, designs, requirements_unmet
from tacstrip.design.check import check
from tacstrip.design.layers import layer_limits
from tacstrip.design.limits import limit_map, limits, outline_of
from tacstrip.errors import ContactError, OptionError, SpecError
from tacstrip.geometry.moments import moment_jacobian, moments
from tacstrip.geometry.outline import Outline
from tacstrip.plot.bounds import limits_figure
from tacstrip.reconstruction.cramer_rao import vertex_covariance, vertex_rms
from tacstrip.sensor.calibration import Calibration
from tacstrip.sensor.channel import Channel
from tacstrip.sensor.converter import Converter
from verbs import run

KITE = np.array([(10.2, 50.0), (30.4, 22.0), (70.9, 60.0), (48.3, 85.0)])
OUTLINE = Outline.of(KITE)
NOISE = ts.Noise(positional=0.005)


def a_sensor(construction: str = "crs-crs", **changed: Any) -> ts.Sensor:
    return ts.Sensor(
        construction=construction, **({"strips": 100, "pitch_mm": 1.0, "length_mm": 100.0} | changed)
    )


# Numbers and map


def test_limits_of_each_signature_and_of_all() -> None:
    found = limits(a_sensor(), OUTLINE, NOISE)
    assert [limit.signatures for limit in found] == [("kh",), ("kl",), ("kh", "kl")]
    np.testing.assert_array_equal(
        found[2].covariance, vertex_covariance(OUTLINE, a_sensor(), 0.005 / np.sqrt(3))
    )
    assert found[0].sigma.shape == (4, 2)
    assert found[2].rms == pytest.approx(np.sqrt((found[2].sigma ** 2).sum() / 4))
    assert found[2].rms < min(found[0].rms, found[1].rms)
    assert [limit.signatures for limit in limits(a_sensor("crs-m"), OUTLINE, NOISE)] == [("k",)]


def test_the_map_has_the_bound_of_every_place() -> None:
    sensor = a_sensor(strips=200)
    over = limit_map(sensor, OUTLINE, NOISE, columns=3, rows=4)
    assert over.rms_mm.shape == (4, 3)
    np.testing.assert_allclose(over.centroid, ts.Contact.polygon(KITE).centroid)
    placed = ts.Contact.polygon(KITE).placed(over.x_mm[2], over.y_mm[1])
    there = vertex_covariance(outline_of(sensor, placed), sensor, 0.005 / np.sqrt(3))
    assert over.rms_mm[1, 2] == pytest.approx(vertex_rms(there), rel=1e-6)
    right_most = placed.vertices[:, 0].max()
    assert right_most == pytest.approx(sensor.width_mm)


def test_a_contact_must_lie_on_the_sensor_as_one_polygon() -> None:
    with pytest.raises(ContactError, match=r"x = -89.8 to .* not wholly on the sensor of 100 x 100 mm.*--at"):
        outline_of(a_sensor(), ts.Contact.polygon(KITE - (100.0, 0.0)))
    with pytest.raises(ContactError, match="not exactly one polygon"):
        outline_of(a_sensor(), ts.Contact.line([(1, 1), (2, 2)]))


def test_without_noise_there_is_no_limit() -> None:
    with pytest.raises(OptionError, match="set quantisation, positional or bits"):
        limits(a_sensor(), OUTLINE, ts.Noise())
    assert limits(a_sensor(adc_bits=8), OUTLINE, ts.Noise())[0].rms > 0.0


def test_the_picture_shows_what_can_be_told() -> None:
    sensor = a_sensor(strips=12, pitch_mm=8.0)
    over = limit_map(sensor, OUTLINE, NOISE, 3, 3)
    assert np.isfinite(over.rms_mm).all()
    figure = limits_figure(sensor, OUTLINE, limits(sensor, OUTLINE, NOISE), over)
    assert len(figure.axes[0].lines) == 1 + 12  # the contact, and three regions a corner
    assert len(figure.axes) == 3
    blind = a_sensor(strips=1, pitch_mm=102.0)
    none = limit_map(blind, OUTLINE, NOISE, 2, 2)
    assert not np.isfinite(none.rms_mm).any()
    assert len(limits_figure(blind, OUTLINE, limits(blind, OUTLINE, NOISE), none).axes) == 2


# Designs


def test_candidates_keep_the_width() -> None:
    found = list(candidates(a_sensor(), pitches_mm=[1.0, 3.0], lengths_mm=[90.0]))
    assert {s.construction for s in found} == {"crs-crs", "crs-m"}
    assert {(s.strips, s.pitch_mm, s.length_mm) for s in found} == {(100, 1.0, 90.0), (33, 3.0, 90.0)}
    tube = a_sensor("cyl-crs-m", radius_mm=20.0)
    assert {s.construction for s in candidates(tube)} == {"cyl-crs-m"}
    assert {s.construction for s in candidates(a_sensor(), ["crs-m"])} == {"crs-m"}
    with pytest.raises(SpecError, match="construction 'x' does not exist"):
        list(candidates(a_sensor(), ["x"]))
    with pytest.raises(SpecError, match="pitch_mm"):
        list(candidates(a_sensor(), pitches_mm=[0.0]))


def test_a_calibrated_unit_s_designs_are_of_others_and_a_curved_skin_has_none() -> None:
    unit = a_sensor()
    offsets = tuple(Channel(signature=name, offset=(0.01,) * 100) for name in unit.signatures)
    unit = replace(unit, calibration=Calibration(channels=offsets, sensor=unit.fingerprint))
    assert all(one.calibration is None for one in candidates(unit))
    assert changed(Case(unit, ts.Shapes(n=1), NOISE), {"sensor.pitch_mm": 2.0}).sensor.calibration is None
    with pytest.raises(OptionError, match=r"has a \[surface\]"):
        next(candidates(ts.Sensor.load("fingertip")))


def test_a_design_reaches_the_error_with_its_largest_noise() -> None:
    sensors = [a_sensor(length_mm=150.0), a_sensor(length_mm=50.0)]
    (coarse, fine) = sorted(
        designs(sensors, OUTLINE, NOISE, 1.0, bits=[10, 14]), key=lambda d: d.sensor.adc_bits or 0
    )
    assert (coarse.sensor.adc_bits, fine.sensor.adc_bits) == (10, 14)  # the kite does not fit on 50 mm
    assert 0.0 < coarse.noise < fine.noise
    (again,) = designs(sensors[:1], OUTLINE, ts.Noise(positional=fine.noise), 1.0, bits=[14])
    assert again.error_mm == pytest.approx(1.0, rel=2e-3)
    (worse,) = designs(sensors[:1], OUTLINE, ts.Noise(positional=2.0 * fine.noise), 1.0, bits=[14])
    assert worse.error_mm > 1.5


def test_designs_that_hold_with_the_given_noise_come_first() -> None:
    few = candidates(a_sensor(), pitches_mm=[2.0, 6.0], lengths_mm=[150.0])
    found = designs(few, OUTLINE, ts.Noise(positional=0.001), 0.5)
    holds = [d.error_mm <= 0.5 for d in found if d.noise > 0.0]
    assert holds == sorted(holds, reverse=True)
    assert len(set(holds)) == 2
    assert [d.noise > 0.0 for d in found] == sorted([d.noise > 0.0 for d in found], reverse=True)


def test_what_cannot_be_reached_has_no_noise() -> None:
    (found,) = designs([a_sensor(strips=3, pitch_mm=34.0)], OUTLINE, NOISE, 1.0, bits=[12])
    assert found.noise == 0.0
    assert found.error_mm == np.inf
    with pytest.raises(OptionError, match="wanted error"):
        designs([a_sensor()], OUTLINE, NOISE, 0.0)


def test_harmon_s_requirements() -> None:
    good = a_sensor(adc_bits=14)
    assert requirements_unmet(good, 0.0004) == ()
    assert requirements_unmet(good, 0.02) == ("resolution along 4.01 mm", "range 25:1")
    assert requirements_unmet(a_sensor(strips=300, pitch_mm=2.5, adc_bits=14), 0.0) == (
        "resolution across 2.5 mm",
        "300 elements",
    )
    (slow,) = requirements_unmet(good, 0.0, conversion_s=1e-4)
    assert slow.endswith("Hz")
    assert float(slow.split()[0]) < 50.0


# The verb


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    corners = ", ".join(f"{x} {y}" for x, y in np.vstack([KITE, KITE[:1]]))
    (tmp_path / "kite.wkt").write_text(f"POLYGON (({corners}))")
    a_sensor().save(tmp_path / "s.toml")
    return tmp_path


def test_the_verb_writes_numbers_and_a_picture(folder: Path) -> None:
    words = [
        "--positional",
        0.005,
        "--grid",
        3,
        "--wanted-mm",
        2,
        "--pitch",
        1,
        "--pitch",
        2,
        "--length",
        100,
    ]
    done = run(folder, "limits", "s.toml", "kite.wkt", *words, "--plot", "p.png", "-o", "n.json")
    assert done.returncode == 0, done.stderr
    record = json.loads((folder / "n.json").read_text())
    rms = limits(a_sensor(), OUTLINE, NOISE)[2].rms
    assert record["limits"][2]["rms_mm"] == pytest.approx(rms)
    assert f"{rms:.3g}" in done.stdout.split("RMS over vertices")[1].splitlines()[0]
    assert np.shape(record["map"]["rms_mm"]) == (3, 3)
    assert len(record["designs"]) == 2 * 2 * 5
    assert "designs reach 2 mm" in done.stdout
    reach = [d for d in record["designs"] if d["error_mm"] is not None and d["error_mm"] <= 2.0]
    assert (
        f"The coarsest that does, by the bound: pitch {max(d['pitch_mm'] for d in reach):g} mm" in done.stdout
    )
    assert (folder / "p.png").read_bytes()[:4] == b"\x89PNG"


def test_the_verb_without_an_answer_ends_with_1(folder: Path) -> None:
    done = run(folder, "limits", "s.toml", "kite.wkt", "--bits", 12, "--grid", 2, "--wanted-mm", 1e-7, "--pitch", 5,
                "--length", 100, "-o", "n.json")  # fmt: skip
    assert done.returncode == 1
    assert "0 of 10 designs reach" in done.stdout
    noisy = run(folder, "limits", "s.toml", "kite.wkt", "--positional", 0.2, "--grid", 2, "--wanted-mm", 0.5,
                "--pitch", 1, "--length", 100)  # fmt: skip
    assert noisy.returncode == 1
    assert "0 of 10 designs reach 0.5 mm" in noisy.stdout
    assert "more reach it with less noise" in noisy.stdout
    done = run(
        folder, "limits", "s.toml", "kite.wkt", "--bits", 12, "--at", 50, 50, "--turn", 10, "--grid", 2
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["s.toml", "kite.wkt"], "there is no limit"),
        (["s.toml", "kite.wkt", "--positional", "2"], "a fraction of Vref"),
        (["s.toml", "kite.wkt", "--positional", "0.01", "--pitch", "1"], "--pitch is for designs"),
        (["s.toml", "kite.wkt", "--positional", "0.01", "--at", "5", "5"], "not wholly on the sensor"),
        (["s.toml", "kite.wkt", "--bits", "99"], "adc_bits = 99"),
        (["s.toml", "kite.wkt", "--bits", "8", "--wanted-mm", "-1"], "wanted error"),
        (["s.toml", "kite.wkt", "--bits", "8", "--plot", "p.doc"], "a picture is a file"),
        (["s.toml", "kite.wkt", "--bits", "8", "-o", "kite.wkt"], "would be written over"),
        (["s.toml", "none.wkt", "--bits", "8"], "none.wkt"),
    ],
)
def test_what_a_user_gets_wrong(folder: Path, words: list[str], said: str) -> None:
    done = run(folder, "limits", *words)
    assert done.returncode == 2
    assert said in done.stderr
    assert "Traceback" not in done.stderr


def test_a_sensor_without_a_closed_form(folder: Path) -> None:
    a_sensor("crs-crp", strips=10, pitch_mm=10.0, resistivity_ratio=100.0, contact_lambda_mm=5.0).save(
        folder / "p.toml"
    )
    done = run(folder, "limits", "p.toml", "kite.wkt", "--positional", 0.001, "--grid", 2)
    assert done.returncode == 0, done.stderr
    assert "from kh, kl, kh+kl" in done.stdout


def test_what_all_readings_share_counts_under_two_layers_as_under_one() -> None:
    layers = ts.LayeredSensor.crossed(
        ts.Sensor(construction="crs-crs", strips=32, pitch_mm=3.0, length_mm=96.0, adc_bits=12)
    )
    contact = ts.Contact.polygon([(20, 40), (55, 20), (80, 50), (45, 75)])
    noise = ts.Noise(positional=0.005, offset=0.02)
    first = layer_limits(layers, contact, noise)[1]
    (*_, alone) = limits(layers.layers[0].sensor, Outline.of(contact.vertices), noise)
    assert math.sqrt(2.0 * float(np.mean(first.sigma**2))) == pytest.approx(alone.rms, rel=1e-6)


def test_designs_have_a_converter_of_their_own() -> None:
    pico = Converter(wide_codes=(512, 3584), widths_lsb=(9.5, 8.5))
    sensor = ts.Sensor(
        construction="crs-crs", strips=10, pitch_mm=10.0, length_mm=100.0, adc_bits=12, converter=pico
    )
    (made,) = candidates(sensor, ["crs-crs"], [10.0], [100.0])
    assert made.converter is None


def test_a_circle_is_judged_by_its_area(folder: Path) -> None:
    """Its corners are not sought; the bound of its area is about what fits reach."""
    sensor = ts.Sensor(construction="crs-crs", strips=16, pitch_mm=5.0, length_mm=90.0)
    sensor.save(folder / "disc.toml")
    words = ("limits", "disc.toml", "circle:15", "--positional", 0.01)
    done = run(folder, *words, "--area-error", "8%", "--construction", "crs-crs", "--length", 90, "--try-bits", 12,
               "--pitch", 5, "--pitch", 12, "--check", 4)  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "By the bound 1 of 2 designs reach 8 % of the area" in done.stdout
    assert "The coarsest that does, by the bound: pitch 5 mm" in done.stdout
    assert "Nine fits of ten are within what is wanted on pitch 5 mm" in done.stdout
    assert "Bounds: a fit misses them" in done.stdout
    checked = check(sensor, circle(15.0), ts.Noise(positional=0.01), 8)
    assert checked.ok.all() or exported("sample_outlines") is None  # without the core none is assessed
    (bound,) = [d.area_percent for d in designs([sensor], circle(15.0), ts.Noise(positional=0.01), None, [12],
                                                area_percent=8.0)]  # fmt: skip
    assert 0.3 * bound < np.sqrt(np.mean(checked.area_percent**2)) < 2.0 * bound
    assert np.isnan(checked.rms_mm).all()
    for more, sentence in (
        (("--wanted-mm", 1), "--wanted-mm is of corners, and this outline is round"),
        (("--area-error", "much"), "--area-error much: give a number of % above 0"),
    ):
        wrong = run(folder, *words, *more)
        assert wrong.returncode == 2
        assert sentence in wrong.stderr
    assert (
        "give the radius in mm"
        in run(folder, "limits", "disc.toml", "circle:big", "--positional", 0.01).stderr
    )


def test_the_area_of_a_polygon_is_that_of_its_corners() -> None:
    (*_, both) = limits(a_sensor(), OUTLINE, NOISE)
    relative = area_limit(a_sensor(), OUTLINE, NOISE, both)
    whole, slopes = moments(OUTLINE.vertices)[0], moment_jacobian(OUTLINE.vertices)[0]
    assert relative == pytest.approx(np.sqrt(slopes @ both.covariance @ slopes) / whole)
    (found,) = designs([a_sensor()], OUTLINE, NOISE, None, bits=[16], area_percent=50.0)
    assert 0.3 < found.area_percent / (100.0 * relative) < 3.0
    with pytest.raises(ts.OptionError, match="no error is wanted"):
        designs([a_sensor()], OUTLINE, NOISE, None)


def test_fits_are_checked_beside_the_bound(folder: Path) -> None:
    """The same scans as a user's own: errors are those of the fits, not of the bound."""
    sensor = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0)
    outline, noise = ts.Outline.of([(22, 18), (70, 34), (62, 72), (30, 66)]), ts.Noise(positional=0.005)
    found = check(sensor, outline, noise, 4)
    assert (found.rms_mm > 0.3 * found.bound_mm).all()
    assert np.median(found.rms_mm) < 3.0 * np.median(found.bound_mm)
    sensor.save(folder / "five.toml")
    (folder / "four.wkt").write_text("POLYGON ((22 18, 70 34, 62 72, 30 66, 22 18))")
    done = run(folder, "limits", "five.toml", "four.wkt", "--positional", 0.005, "--grid", 2, "--check", 4)
    assert done.returncode == 0, done.stderr
    last = done.stdout.splitlines()[-1].split()
    rms = [np.sqrt(np.mean(np.square(v))) for v in (found.bound_mm, found.rms_mm)]
    assert [float(v) for v in last[3:5]] == pytest.approx(rms, rel=0.01)
    assert last[-1] == (f"{100 * found.ok.mean():.0f}%" if exported("sample_outlines") else "?")
    found = check(replace(sensor, adc_bits=12), outline, noise, 4)
    rms, nine = np.sqrt(np.mean(np.square(found.rms_mm))), found.rms_mm.max()  # nine of ten of four are all
    wanted = 0.5 * (rms + nine)
    done = run(folder, "limits", "five.toml", "four.wkt", "--positional", 0.005, "--grid", 2, "--wanted-mm", wanted,
               "--construction", "crs-crs", "--length", 100, "--try-bits", 12, "--pitch", 5, "--check", 4)  # fmt: skip
    first, second = done.stdout.splitlines()[-2:]
    assert first.startswith("On none of these are nine fits of ten within what is wanted")
    figures = f"{rms:.3g} mm (nine of ten: {nine:.3g})"
    assert second == f"The RMS of the fits is within it on pitch 5 mm, crs-crs: {figures}"


def test_why_no_pitch_does_is_named(folder: Path) -> None:
    """Twelve corners against strips that leave edges without two of them; not a matter of noise or length."""
    ring = [(40 + 15 * np.cos(t), 45 + 15 * np.sin(t) * (1.0 if i % 2 else 0.6)) for i, t in
            enumerate(2.0 * np.pi * np.arange(12) / 12)]  # fmt: skip
    text = ", ".join(f"{x} {y}" for x, y in (*ring, ring[0]))
    (folder / "star.wkt").write_text(f"POLYGON (({text}))")
    done = run(folder, "limits", "s.toml", "star.wkt", "--positional", 0.01, "--grid", 2, "--wanted-mm", 2,
               "--pitch", 10, "--pitch", 8, "--construction", "crs-crs", "--length", 100, "--try-bits", 12)  # fmt: skip
    assert done.returncode == 1
    assert (
        "No noise is small enough: the 12 corners are known where each edge crosses two strips" in done.stdout
    )
    assert "a pitch of 1 mm or less does" in done.stdout
    assert "Try a longer" not in done.stdout
