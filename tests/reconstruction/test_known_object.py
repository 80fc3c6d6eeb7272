"""The pose of a known rigid object."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from click.testing import CliRunner

import tacstrip as ts
from tacstrip.arrays import FloatArray
from tacstrip.cli import cli
from tacstrip.io.geojson import feature_collection
from tacstrip.reconstruction.known_object.fit import pose_covariance
from tacstrip.reconstruction.known_object.readings import PoseFit, corners_of, posed_at, turned_alike
from tacstrip.reconstruction.known_object.rivals import has_axis

SENSOR = ts.Sensor(construction="crs-crs", strips=10, pitch_mm=10.0, length_mm=100.0)
SHAPES = {
    "square": [(0, 0), (45, 0), (45, 45), (0, 45)],
    "triangle": [(0, 0), (50, 0), (30, 40)],
    "angle": [(0, 0), (50, 0), (50, 20), (20, 20), (20, 50), (0, 50)],
    "five": [(0, 0), (40, -5), (60, 25), (35, 50), (5, 35)],
}
NOISE = ts.Noise(positional=0.005)
SIGMA = 0.005 / math.sqrt(3.0)


def iou(a: FloatArray, b: FloatArray) -> float:
    one, other = shapely.Polygon(a), shapely.Polygon(b)
    return float(one.intersection(other).area / one.union(other).area)


def pressed(name: str, angle: float, x: float = 50.0, y: float = 47.0) -> ts.Contact:
    return ts.Contact.polygon(SHAPES[name]).turned(angle).placed(x, y)


@pytest.mark.parametrize("name", SHAPES)
def test_errors_are_at_the_bound_and_the_covariance_holds(name: str) -> None:
    """Concave ones too; of a square's four poses the one counts that was meant."""
    random = np.random.default_rng(3)
    squares, inside, overlap = [], [], []
    for _ in range(12):
        angle, x, y = random.uniform(-3.0, 3.0), *random.uniform(40.0, 60.0, 2)
        truth = pressed(name, angle, x, y)
        found = ts.fit_object(ts.simulate(SENSOR, truth, NOISE, rng=random), SENSOR, SHAPES[name], NOISE)
        (o,) = found.objects
        assert o.pose is not None
        poses = [p for p in (o.pose, *(a.pose for a in o.alternatives)) if p is not None]
        off = [
            np.array([p.x_mm - x, p.y_mm - y, math.remainder(p.angle - angle, 2.0 * math.pi)]) for p in poses
        ]
        bound = pose_covariance(SENSOR, SHAPES[name], (x, y, angle), SIGMA)
        nearest = int(np.argmin([(e**2 / np.diag(bound)).sum() for e in off]))
        squares.append(off[nearest] ** 2 / np.diag(bound))
        weighted = np.linalg.pinv(poses[nearest].covariance)
        inside.append(off[nearest] @ weighted @ off[nearest] < 7.815)
        overlap.append(iou(o.vertices, truth.vertices))
    assert np.sqrt(np.mean(squares)) < 1.25
    assert np.mean(inside) >= 0.85
    assert np.median(overlap) > 0.97


def test_regions_hold_where_soft_edges_err_alike_on_neighbouring_strips() -> None:
    """Errors of .7 mm that fall to 1/e over 16 mm, ten strips; the correlation is told."""
    random, rho, inside, overlap = np.random.default_rng(5), math.exp(-10.0 / 16.0), [], []
    for i in range(24):
        name = list(SHAPES)[i % 4]
        angle, x, y = random.uniform(-3.0, 3.0), *random.uniform(42.0, 58.0, 2)
        truth = pressed(name, angle, x, y)
        soft = random.normal(size=(2, 10))
        for strip in range(1, 10):
            soft[:, strip] = rho * soft[:, strip - 1] + math.sqrt(1.0 - rho**2) * soft[:, strip]
        l, u = (end + 0.7 * off for end, off in zip(ts.footprint(SENSOR, truth), soft, strict=True))
        k = ts.signatures(SENSOR, l, u)
        kh, kl = (k[name] + random.normal(0.0, 0.003, 10) for name in ("kh", "kl"))
        scan = ts.Scan(kh=kh, kl=kl)
        noise = ts.Noise(white=0.003, edge_mm=0.7, edge_correlation_mm=16.0)
        (o,) = ts.fit_object(scan, SENSOR, SHAPES[name], noise, edge_mm=0.7).objects
        poses = [p for p in (o.pose, *(a.pose for a in o.alternatives)) if p is not None]
        off = [
            np.array([p.x_mm - x, p.y_mm - y, math.remainder(p.angle - angle, 2.0 * math.pi)]) for p in poses
        ]
        chi_square = [e @ np.linalg.pinv(p.covariance) @ e for e, p in zip(off, poses, strict=True)]
        inside.append(min(chi_square) < 7.815)
        overlap.append(iou(o.vertices, truth.vertices))
    assert np.mean(inside) > 0.9  # .875 with each end by itself
    assert np.median(overlap) > 0.95


def test_a_symmetric_object_has_poses_that_look_alike() -> None:
    found = ts.fit_object(ts.simulate(SENSOR, pressed("square", 0.3), NOISE), SENSOR, SHAPES["square"], NOISE)
    (o,) = found.objects
    assert o.pose is not None
    assert found.status == "ok"
    assert len(o.alternatives) == 3
    angles = [a.pose.angle for a in o.alternatives if a.pose is not None]
    turns = sorted(math.remainder(a - o.pose.angle, 2.0 * math.pi) / (0.5 * math.pi) for a in angles)
    np.testing.assert_allclose(np.abs(turns), [1.0, 1.0, 2.0], atol=0.02)
    assert all(abs(p.weight - 0.25) < 0.02 for p in o.alternatives)
    assert all(iou(p.vertices, o.vertices) > 0.98 for p in o.alternatives)
    assert o.confidence is not None
    assert o.confidence > 0.95
    (feature,) = feature_collection([found])["features"]
    assert [set(a) for a in feature["properties"]["alternatives"]] == [{"weight", "vertices_mm", "pose"}] * 3


@pytest.mark.parametrize(
    ("true", "given"), [("triangle", "square"), ("square", "triangle"), ("angle", "five")]
)
def test_another_object_is_doubted(true: str, given: str) -> None:
    for noise, angle in ((NOISE, 0.2), (NOISE, 1.1), (None, 1.1), (None, 2.5)):
        scan = ts.simulate(SENSOR, pressed(true, angle), NOISE, rng=1)
        found = ts.fit_object(scan, SENSOR, SHAPES[given], noise)
        assert found.status == "doubtful"


@pytest.mark.parametrize(("x", "y"), [(12.0, 50.0), (88.0, 50.0), (50.0, 10.0), (50.0, 92.0)])
def test_an_object_may_lie_over_the_border(x: float, y: float) -> None:
    truth = pressed("five", 0.8, x, y)
    found = ts.fit_object(ts.simulate(SENSOR, truth, NOISE), SENSOR, SHAPES["five"], NOISE)
    assert found.status == "ok" or found.objects[0].alternatives
    assert iou(found.objects[0].vertices, truth.vertices) > 0.85


@pytest.mark.parametrize("signature", ["kh", "kl"])
def test_one_signature_does(signature: str) -> None:
    truth = pressed("five", 2.0)
    scan = ts.simulate(SENSOR, truth, NOISE)
    alone = ts.Scan(kh=scan.kh) if signature == "kh" else ts.Scan(kl=scan.kl)
    found = ts.fit_object(alone, SENSOR, SHAPES["five"], NOISE)
    assert found.status == "ok"
    assert iou(found.objects[0].vertices, truth.vertices) > 0.9


def test_a_drawing_that_is_flipped_is_told() -> None:
    """An L with y down: no pose explains its readings, and its mirror image does."""
    flipped = [(x, -y) for x, y in SHAPES["angle"][:4]] + [(20, -30), (0, -30)]
    truth = ts.Contact.polygon([(x, -y) for x, y in flipped]).turned(0.6).placed(50.0, 47.0)
    scan = ts.simulate(SENSOR, truth, NOISE, rng=1)
    for noise in (NOISE, None):
        (found,) = ts.fit_object(scan, SENSOR, flipped, noise).objects
        assert found.status == "doubtful"
        assert "is the drawing flipped" in found.advice
        assert (found.confidence, found.alternatives) == (None, ())


@pytest.mark.parametrize(("signature", "seed", "weight"), [("kl", 1, 0.9), ("kh", 5, 0.3)])
def test_a_mirror_image_that_explains_one_signature_too_is_weighed(
    signature: str, seed: int, weight: float
) -> None:
    shape = [(0, 0), (45, 0), (30, 22)]
    random = np.random.default_rng(seed)
    truth = ts.Contact.polygon(shape).turned(random.uniform(-3, 3)).placed(*random.uniform(42, 58, 2))
    k = ts.simulate(SENSOR, truth, NOISE, rng=random)[signature]
    scan = ts.Scan(kh=k) if signature == "kh" else ts.Scan(kl=k)
    (right,), (wrong,) = (
        ts.fit_object(scan, SENSOR, named, NOISE).objects for named in (shape, [(-x, y) for x, y in shape])
    )
    assert right.status == "ok"
    assert right.advice.startswith("its size is taken as drawn")
    assert wrong.status == "doubtful"
    mirrored = [a for a in wrong.alternatives if a.pose is None]
    assert sum(a.weight for a in mirrored) > weight
    assert iou(mirrored[0].vertices, truth.vertices) > 0.8


def test_a_symmetric_outline_has_no_mirror_image_of_its_own() -> None:
    angle = 2.0 * np.pi * np.arange(40) / 40
    oval = np.column_stack([3.0 * np.cos(angle), np.sin(angle)])
    for outline in (SHAPES["square"], SHAPES["angle"], SHAPES["triangle"], oval):
        assert has_axis(corners_of(outline))
    for outline in (SHAPES["five"], [(0, 0), (40, 0), (40, 12), (14, 12), (14, 30), (0, 30)]):
        assert not has_axis(corners_of(outline))


def test_another_size_is_not_taken_for_noise_that_nobody_knows() -> None:
    """The readings are 1 % of Vref from the triangle's, below any ceiling of noise, and on five strips."""
    random = np.random.default_rng(5)
    larger = ts.Contact.polygon(1.1 * np.array(SHAPES["triangle"]))
    truth = larger.turned(random.uniform(-3, 3)).placed(*random.uniform(42, 58, 2))
    scan = ts.simulate(SENSOR, truth, ts.Noise(positional=0.0005), rng=random)
    (found,) = ts.fit_object(scan, SENSOR, SHAPES["triangle"]).objects
    assert found.status == "doubtful"
    assert "1.1 times as large it explains them" in found.advice
    assert ts.fit_object(scan, SENSOR, larger).status == "ok"


def test_an_outline_in_centimetres_is_told() -> None:
    scan = ts.simulate(SENSOR, pressed("five", 0.6), NOISE, rng=1)
    (found,) = ts.fit_object(scan, SENSOR, 0.1 * np.array(SHAPES["five"]), NOISE).objects
    assert found.status == "doubtful"
    size = re.search(
        r"; ([\d.]+) times as large it explains them: check its size, and that its unit is mm", found.advice
    )
    assert size is not None
    assert float(size[1]) == pytest.approx(10.0, rel=0.02)


def test_few_strips_say_that_they_are_few() -> None:
    """Two strips under a square leave every angle but those that are too wide."""
    narrow = ts.Sensor(construction="crs-crs", strips=3, pitch_mm=30.0, length_mm=100.0)
    noisy = ts.Noise(positional=0.02)
    truth = ts.Contact.polygon(SHAPES["angle"]).turned(0.7).placed(50.0, 47.0)
    found = ts.fit_object(ts.simulate(narrow, truth, noisy, rng=2), narrow, SHAPES["angle"], noisy)
    assert found.status == "doubtful"
    assert "probability" in found.advice


def test_soft_edges_add_to_what_is_not_known() -> None:
    """An outline that grew by 2 mm, as a low threshold makes it: hard edges alarm, soft ones hold."""
    truth = pressed("five", 0.5)
    grown = ts.Contact((truth.shapes[0].buffer(2.0, join_style="mitre"),))
    scan = ts.simulate(SENSOR, grown, NOISE, rng=4)
    hard, soft = (ts.fit_object(scan, SENSOR, SHAPES["five"], NOISE, edge_mm=e) for e in (0.0, 2.0))
    assert hard.status == "doubtful"
    assert soft.status == "ok"
    (a,), (b,) = hard.objects, soft.objects
    assert a.pose is not None
    assert b.pose is not None
    assert np.trace(b.pose.covariance) > np.trace(a.pose.covariance)
    assert iou(b.vertices, truth.vertices) > 0.9


def test_a_stuck_channel_is_left_out() -> None:
    truth = pressed("five", 0.5)
    scan = ts.simulate(SENSOR, truth, NOISE)
    kh = scan["kh"].copy()
    kh[5] = 0.95
    found = ts.fit_object(ts.Scan(kh=kh, kl=scan.kl), SENSOR, SHAPES["five"], NOISE)
    assert found.status == "ok"
    assert "strip 5 does not fit" in found.advice
    assert iou(found.objects[0].vertices, truth.vertices) > 0.9


FINE = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0)
PENTAGON = [(-14, -12), (12, -14), (16, 6), (0, 14), (-13, 8)]


def placed(shape: Sequence[tuple[float, float]], seed: int) -> tuple[ts.Contact, ts.Scan]:
    """Return a shape somewhere on the fine sensor, and what that reads."""
    random = np.random.default_rng(seed)
    truth = ts.Contact.polygon(shape).turned(random.uniform(-3.0, 3.0)).placed(*random.uniform(30.0, 70.0, 2))
    return truth, ts.simulate(FINE, truth, NOISE, rng=random)


@pytest.mark.parametrize(
    ("other", "seed"),
    [
        ([(-x, y) for x, y in PENTAGON[::-1]], 1),
        ([(-x, y) for x, y in PENTAGON[::-1]], 10),
        ([(-15, -10), (14, -9), (10, 13), (-12, 11)], 30),
    ],
)
def test_a_strip_that_disproves_the_object_is_not_taken_for_faulty(
    other: Sequence[tuple[float, float]], seed: int
) -> None:
    """Without that strip the others pass for the object's."""
    (found,) = ts.fit_object(placed(other, seed)[1], FINE, PENTAGON, NOISE).objects
    assert found.status == "doubtful"
    assert found.confidence is None
    assert "was left out: another object, or a faulty channel" in found.advice


def test_a_channel_that_is_off_by_5_percent_is_told_from_another_object() -> None:
    statuses = []
    for seed in range(6):
        truth, scan = placed(PENTAGON, seed)
        k = {name: scan[name].copy() for name in ("kh", "kl")}
        at = int(np.flatnonzero(scan.touched)[2])
        k["kh" if seed % 2 else "kl"][at] += 0.05
        (found,) = ts.fit_object(ts.Scan(kh=k["kh"], kl=k["kl"]), FINE, PENTAGON, NOISE).objects
        statuses.append(found.status)
        if found.status == "ok":
            assert f"strip {at} does not fit" in found.advice
            assert iou(found.vertices, truth.vertices) > 0.9
    assert statuses.count("ok") >= 5


def test_no_strip_is_left_out_for_an_upright_edge_on_its_wrong_side() -> None:
    kh = np.pad([0.4175, 0.4327, 0.2936, 0.3014, 0.2525], (2, 3), constant_values=np.nan)
    kl = np.pad([0.1565, 0.1648, 0.1513, 0.1612, 0.1653], (2, 3), constant_values=np.nan)
    angle = [(18.6, 11.5), (66.2, 15.4), (64.3, 39.6), (38.8, 37.5), (37.3, 55.3), (15.2, 53.5)]
    (found,) = ts.fit_object(ts.Scan(kh=kh, kl=kl), SENSOR, angle, NOISE).objects
    assert (found.status, found.advice) == ("ok", "")
    assert iou(found.vertices, np.array(angle)) > 0.95


def test_an_egg_the_other_way_round_is_among_the_poses() -> None:
    """Three strips hardly tell its ends apart; descents from angles all round end in one of the two poses only."""
    t = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
    egg = np.stack([1.73 * np.cos(t) * (1.0 - 0.16 * np.sin(t)), 2.25 * np.sin(t)], axis=1)
    sensor = ts.Sensor(construction="crs-crs", strips=4, pitch_mm=1.6878, length_mm=20.655)
    kh, kl = np.array([0.1941, 0.2383, 0.2457, np.nan]), np.array([0.1875, 0.1262, 0.1956, np.nan])
    noise = ts.Noise(positional=0.003522)
    (found,) = ts.fit_object(ts.Scan(kh=kh, kl=kl), sensor, egg, noise, edge_mm=0.069).objects
    (other,) = found.alternatives
    assert found.pose is not None
    assert other.pose is not None
    turned = math.remainder(found.pose.angle - other.pose.angle, 2.0 * math.pi)
    assert abs(turned) == pytest.approx(math.pi, abs=0.2)
    assert other.weight > 0.2


def test_poses_are_tried_turned_to_where_the_outline_is_like_itself() -> None:
    """A triangle whose sides are nearly alike, by thirds and by half a circle, in the box that it lies in."""
    corners = corners_of([(0, 0), (40, 0), (20, 35)])
    x = SENSOR.x_mm
    fit = PoseFit(SENSOR, corners, slice(2, 6), x[2:6], ("kh", "kl"), np.zeros((2, 4)), np.ones((2, 4)), 0.0,
                  np.zeros(len(x), dtype=bool))  # fmt: skip
    pose = np.array([[40.0, 50.0, 0.3, 0.0]])
    turned = turned_alike(fit, pose)
    np.testing.assert_allclose(np.sort(turned[:, 2] - 0.3), np.array([-2, 2, 3]) * np.pi / 3)
    (box,), boxes = (posed_at(corners, p) for p in (pose, turned))
    middle, middles = box.min(axis=0) + box.max(axis=0), boxes.min(axis=1) + boxes.max(axis=1)
    np.testing.assert_allclose(middles, np.tile(middle, (3, 1)))


@pytest.mark.parametrize("log_size", [0.0, 0.1])
def test_slopes_are_those_of_differences(log_size: float) -> None:
    k = np.full((2, 4), 0.4)
    fit = PoseFit(
        SENSOR,
        corners_of(SHAPES["angle"]),
        slice(3, 7),
        SENSOR.x_mm[3:7],
        ("kh", "kl"),
        k,
        np.full_like(k, 100.0),
        0.0 if log_size else 1.0,
        np.zeros(SENSOR.strips, dtype=bool),
        log_size=log_size,
    )
    at = np.array([[50.3, 47.0, 0.37, 0.2]])
    slope = fit.rows(at)[1][0]
    for i in range(4):
        step = np.zeros((1, 4))
        step[0, i] = 1e-5
        numeric = (fit.rows(at - step)[0] - fit.rows(at + step)[0])[0] / 2e-5
        np.testing.assert_allclose(slope[:, i], numeric, atol=2e-3)


@pytest.mark.parametrize(
    "outline", [[(0, 0), (1, 1)], [(0, 0), (2, 2), (2, 0), (0, 2)], [(0, 0), (1, 1), (2, 2)]]
)
def test_what_is_no_outline_is_refused(outline: list[tuple[float, float]]) -> None:
    scan = ts.simulate(SENSOR, pressed("five", 0.0))
    with pytest.raises(ts.ContactError, match="outline"):
        ts.fit_object(scan, SENSOR, outline)


def test_the_command_line_places_a_known_object(tmp_path: Path) -> None:
    spec, file, known, out, plot = (
        tmp_path / name for name in ("sensor.toml", "readings.csv", "known.wkt", "out.geojson", "out.png")
    )
    truth = pressed("triangle", 0.4)
    SENSOR.save(spec)
    known.write_text(ts.Contact.polygon(SHAPES["triangle"]).shapes[0].wkt)
    ts.write_readings(file, SENSOR, [ts.simulate(SENSOR, truth, NOISE)])
    options = ["--object", str(known), "--positional", "0.005"]
    run = CliRunner().invoke(
        cli, ["reconstruct", str(spec), str(file), "-o", str(out), *options, "--plot", str(plot)]
    )
    assert run.exit_code == 0, run.output
    assert "turned by" in run.output
    (feature,) = json.loads(out.read_text())["features"]
    assert feature["properties"]["method"] == "object"
    assert feature["properties"]["pose"]["angle_rad"] == pytest.approx(0.4, abs=0.1)
    assert iou(np.array(feature["geometry"]["coordinates"][0][:-1]), truth.vertices) > 0.9
    assert plot.stat().st_size > 0
    run = CliRunner().invoke(cli, ["reconstruct", str(spec), str(file), *options, "--method", "polygon"])
    assert run.exit_code == 2 or isinstance(run.exception, ts.OptionError)


def test_another_object_is_not_taken_for_one_in_unknown_noise() -> None:
    """Its residuals would pass for noise, but a free polygon leaves far fewer."""
    sensor = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0)
    other, statuses = [(0, 0), (50, 0), (50, 45), (0, 45)], []
    for seed in range(4):
        scan = ts.simulate(sensor, pressed("five", 0.4 + seed), ts.Noise(positional=0.002), rng=seed)
        kh = ts.Scan(kh=scan["kh"])
        statuses.append(ts.fit_object(kh, sensor, other).status)
        assert ts.fit_object(kh, sensor, SHAPES["five"]).status == "ok"
    assert statuses.count("doubtful") == 4


def test_noise_that_strips_share_is_in_the_pose_s_covariance() -> None:
    """95 % regions of y hold the truth of 8 presses; counted as if independent, they would hold a third."""
    noise, held, plain = ts.Noise(positional=0.001, offset=0.004), 0, 0
    spec = ts.Sensor(construction="crs-crs", strips=10, pitch_mm=10.0, length_mm=100.0, noise=noise)
    for seed in range(8):
        scan = ts.simulate(spec, pressed("five", 0.4), noise, rng=seed)
        found = ts.fit_object(scan, spec, SHAPES["five"]).objects[0]
        alone = ts.fit_object(scan, spec, SHAPES["five"], ts.Noise(positional=0.001)).objects[0]
        assert found.pose is not None
        assert alone.pose is not None
        held += abs(found.pose.y_mm - 47.0) <= 1.96 * math.sqrt(found.pose.covariance[1, 1])
        plain += abs(alone.pose.y_mm - 47.0) <= 1.96 * math.sqrt(alone.pose.covariance[1, 1])
    assert held >= 7
    assert plain < 5


def test_the_orientation_of_a_rigid_object_is_as_sure_as_its_angle() -> None:
    """A square has no longer axis, whose direction a covariance could tell."""
    scan = ts.simulate(SENSOR, pressed("square", 0.3), NOISE, rng=1)
    found = ts.fit_object(scan, SENSOR, SHAPES["square"], NOISE)
    thing = found.objects[0]
    assert thing.pose is not None
    sigma = math.sqrt(thing.pose.covariance[2, 2])
    assert thing.deviations is not None
    assert thing.deviations[2] == pytest.approx(sigma)
    feature = feature_collection([found])["features"][0]
    assert feature["properties"]["orientation_sigma_rad"] == pytest.approx(sigma, rel=1e-4)


def test_a_contact_that_is_no_polygon_is_named() -> None:
    two = ts.Contact.polygon(SHAPES["square"]) + ts.Contact.polygon(SHAPES["triangle"]).moved(60.0, 0.0)
    for outline, named in ((two, "2 polygons"), (ts.Contact.points([(1, 2)]), "1 point")):
        with pytest.raises(ts.ContactError, match=f"must be one polygon, and not <Contact: {named}"):
            ts.fit_object(ts.simulate(SENSOR, pressed("five", 0.0)), SENSOR, outline)


@pytest.mark.parametrize("outline", ["abc", {"a": 1}, 5, None])
def test_an_outline_of_the_wrong_type_gets_a_sentence(outline: object) -> None:
    with pytest.raises(ts.ContactError, match="known object's outline needs"):
        ts.fit_object(ts.simulate(SENSOR, pressed("five", 0.0)), SENSOR, outline)  # type: ignore[arg-type]
    with pytest.raises(ts.OptionError, match="edge_mm = 'x'"):
        ts.fit_object(ts.simulate(SENSOR, pressed("five", 0.0)), SENSOR, SHAPES["five"], edge_mm="x")  # type: ignore[arg-type]


@pytest.mark.parametrize("out", [(-1, -2), (0,), (2, 3, 4, 5, 6)])
def test_strips_that_are_left_out_do_not_make_it_another_object(out: tuple[int, ...]) -> None:
    """At an end it may go on beneath them, by so many pitches more; in the middle they do not make two of it."""
    sensor = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0)
    truth = pressed("five", 0.9)
    scan = ts.simulate(sensor, truth, NOISE, rng=2)
    strips = [int(np.flatnonzero(scan.touched)[i]) for i in out]
    left = replace(sensor, without=tuple(map(str, strips)))
    kept = {n: np.where(np.isin(np.arange(20), strips), np.nan, scan[n]) for n in scan.signatures}
    beside = ts.Scan(kh=kept["kh"], kl=kept["kl"])
    (found,) = ts.fit_object(beside, left, SHAPES["five"]).objects
    assert found.status == "ok", found.advice
    assert iou(found.vertices, truth.vertices) > 0.9
    (other,) = ts.fit_object(beside, left, SHAPES["triangle"]).objects
    assert other.status == "doubtful"


def test_one_signature_of_few_strips_in_unknown_noise_does_not_tell_the_object() -> None:
    statuses = []
    for seed in range(6):
        scan = ts.simulate(SENSOR, pressed("triangle", 0.4 + seed), ts.Noise(positional=0.002), rng=seed)
        statuses.append(ts.fit_object(ts.Scan(kh=scan["kh"]), SENSOR, SHAPES["five"]).status)
    assert set(statuses) == {"doubtful"}


def test_a_strip_left_out_across_the_seam_has_its_own_number() -> None:
    tube = ts.Sensor(
        construction="cyl-crs-m", strips=24, pitch_mm=5.0, length_mm=100.0, radius_mm=60.0 / math.pi
    )
    shape = ts.Contact.polygon([(100, 30), (140, 35), (135, 70), (105, 60)])
    k = ts.simulate(tube, shape)["k"].copy()
    k[1] = 0.95
    (found,) = ts.fit_object(ts.Scan(k=k), tube, shape, ts.Noise(positional=0.002)).objects
    assert found.advice.startswith("strip 1 does not fit")


def test_wide_strips_are_read_over_their_width_and_never_for_sure() -> None:
    wide, noise = replace(SENSOR, strip_width_mm=9.0), ts.Noise(positional=0.002)
    off = []
    for turn in (0.4, 1.0, 2.0, 2.9):
        scan = ts.simulate(wide, pressed("triangle", turn), noise, rng=1)
        thin, found = (
            ts.fit_object(scan, sensor, SHAPES["triangle"], noise).objects[0] for sensor in (SENSOR, wide)
        )
        assert found.status in ("likely", "doubtful")
        assert "strip" in found.advice
        off.append([np.abs(o.vertices - pressed("triangle", turn).vertices[:, None]).sum(-1).min(0).max()
                    for o in (thin, found)])  # fmt: skip
    assert np.median(off, axis=0)[1] < 0.5 * np.median(off, axis=0)[0]


@pytest.mark.parametrize(("seed", "edge_mm"), [(0, 0.0), (1, 0.0), (1, 0.02)])
def test_x_is_uncertain_where_a_strip_may_just_graze_an_upright_edge(seed: int, edge_mm: float) -> None:
    """The best fit grazes it, the truth is .36 mm off: by the slopes alone that was 45 deviations."""
    sensor = ts.Sensor(construction="crs-crs", strips=6, pitch_mm=8.0, length_mm=40.0)
    shape = ts.Contact.polygon([(0, 0), (17.5, 0), (17.5, 8.1), (0, 8.1)])
    scan = ts.simulate(sensor, shape.turned(-0.06).placed(12.1, 20.0), NOISE, rng=seed)
    (found,) = ts.fit_object(scan, sensor, shape, NOISE, edge_mm=edge_mm).objects
    chi_square = []
    for pose in (found.pose, *(a.pose for a in found.alternatives)):
        if pose is not None:
            off = [pose.x_mm - 12.1, pose.y_mm - 20.0, math.remainder(pose.angle + 0.06, 2.0 * math.pi)]
            chi_square.append(float(off @ np.linalg.solve(pose.covariance, off)))
    assert found.status == "ok"
    assert min(chi_square) < 7.8
