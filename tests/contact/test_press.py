"""Solids pressed into skins, against what geometry says of them, and meshes against solids."""

from __future__ import annotations

import logging
import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.contact.press import mesh as meshes
from tacstrip.contact.press.patch import Patch
from tacstrip.errors import ContactError, OptionError

TIP = ts.Sensor.load("fingertip")
TUBE = ts.Sensor(
    construction="cyl-crs-m", strips=24, pitch_mm=2.0 * math.pi * 9.0 / 24, length_mm=60.0, radius_mm=9.0
)
FLAT = ts.Sensor(construction="crs-crs", strips=24, pitch_mm=3.0, length_mm=80.0)
RADIUS, STIFFNESS = 10.0, 0.1
POSE = ((10.0, 3.0, 10.0), (-1.0, -0.3, -1.0))


@pytest.mark.parametrize("depth", [0.1, 1.0, 2.5])
@pytest.mark.parametrize("toward", [(-1, 0, -1), (-0.5, 0.7, -1), (0, 0, -1)])
def test_a_plane_on_a_sphere_makes_a_cap(depth: float, toward: tuple[float, float, float]) -> None:
    patch = ts.press(TIP, ts.Solid.plane().at((0, 0, 20), toward), depth_mm=depth)
    out = -np.array(toward) / np.linalg.norm(toward)
    assert patch.area_mm2 == pytest.approx(2.0 * math.pi * RADIUS * depth, rel=3e-3)
    assert patch.force_n == pytest.approx(STIFFNESS * math.pi * RADIUS * depth**2, rel=3e-3)
    assert math.degrees(math.acos(min(1.0, patch.normal @ out))) < 0.03
    assert patch.max_indentation_mm == pytest.approx(depth, rel=5e-3)
    np.testing.assert_allclose(
        patch.moment_xyz, 0.0, atol=2e-3 * RADIUS * patch.force_n
    )  # all pass the centre
    # On the meridian at phi the plane passes where out . p = R - depth.
    phi = (np.arange(16) + 0.5) * math.pi / 8.0
    flat = out[0] * np.cos(phi) + out[1] * np.sin(phi)
    share = (1.0 - depth / RADIUS) / np.hypot(out[2], flat)
    touched = share < 1.0
    half = np.arccos(np.where(touched, share, 1.0))
    l, u = ((np.arctan2(flat, out[2]) + s * half - math.radians(12.0)) * RADIUS for s in (-1.0, 1.0))
    l, u = np.clip(l, 0.0, TIP.length_mm), np.clip(u, 0.0, TIP.length_mm)
    touched &= u > l
    np.testing.assert_array_equal(patch.touched, touched)
    np.testing.assert_allclose(patch.l[touched], l[touched], atol=1e-4)
    np.testing.assert_allclose(patch.u[touched], u[touched], atol=1e-4)
    ring = patch.outline_xyz[np.isfinite(patch.outline_xyz).all(axis=1)]
    if toward != (0, 0, -1) and depth < 2.5:
        np.testing.assert_allclose(ring @ out, RADIUS - depth, atol=5e-3)


@pytest.mark.parametrize("depth", [0.3, 1.0, 2.0])
def test_a_box_on_a_tube_covers_the_arc(depth: float) -> None:
    patch = ts.press(TUBE, ts.Solid.box((20, 30, 5)).at((20, 0, 30), toward=(-1, 0, 0)), depth_mm=depth)
    arc = 18.0 * math.acos(1.0 - depth / 9.0)
    angle = np.arctan2(patch.outline_xyz[:, 1], patch.outline_xyz[:, 0])
    assert 18.0 * np.nanmax(angle) == pytest.approx(arc, abs=0.01)  # across the seam, either way
    assert -18.0 * np.nanmin(angle) == pytest.approx(arc, abs=0.01)
    on = patch.touched
    np.testing.assert_allclose(
        [patch.l[on], patch.u[on]], np.array([[20.0], [40.0]]) * np.ones(on.sum()), atol=1e-3
    )
    assert patch.area_mm2 == pytest.approx(20.0 * arc, rel=0.01)
    assert set(np.flatnonzero(on)) <= {0, 1, 2, 21, 22, 23}


def test_a_ball_on_a_plane_and_in_a_hollow() -> None:
    ball = ts.Solid.sphere(20.0).at((30, 40, 9), toward=(0, 0, -1))
    flat = ts.press(FLAT, ball, depth_mm=1.0)
    assert flat.area_mm2 == pytest.approx(math.pi * (2.0 * 20.0 - 1.0), rel=2e-3)
    assert flat.force_n == pytest.approx(STIFFNESS * math.pi * (20.0 - 1.0 / 3.0), rel=3e-3)
    surface = ts.Surface(kind="cylinder", radius_mm=25.0, height_mm=60.0, inside=True)
    hollow = ts.Sensor(
        construction="crs-crs", strips=24, pitch_mm=surface.pitch_mm(24), length_mm=60.0, surface=surface
    )
    inside = ts.press(hollow, ball.at((0, 0, 30), toward=(1, 0, 0)), depth_mm=1.0)
    assert inside.area_mm2 > 1.5 * flat.area_mm2  # it fits the hollow better
    np.testing.assert_allclose(inside.normal, (-1, 0, 0), atol=1e-3)
    assert inside.force_n > 0.0


@pytest.mark.parametrize(
    "solid", [ts.Solid.sphere(5), ts.Solid.cylinder(4), ts.Solid.edge(1.5)], ids=lambda s: s.kind
)
def test_a_force_gives_the_depth_that_makes_it(solid: ts.Solid) -> None:
    posed = solid.at(*POSE, 0.4)
    deep = ts.press(TIP, posed, depth_mm=1.2)
    again = ts.press(TIP, posed, force_n=deep.force_n)
    assert again.depth_mm == pytest.approx(1.2, abs=1e-4)
    np.testing.assert_allclose(again.solid.position_mm, deep.solid.position_mm, atol=1e-4)
    scan = ts.simulate(TIP, deep)
    back = ts.profile_reconstruction(scan, TIP).objects
    found = np.sort(np.concatenate([o.profile[1] for o in back if o.profile]))
    np.testing.assert_allclose(found, np.sort(deep.l[deep.touched]), atol=1e-6)


@pytest.fixture(name="trimesh")
def _trimesh() -> Any:
    """Late: it takes half a second to import, in every process that collects this file."""
    return pytest.importorskip("trimesh")


@pytest.fixture
def pairs(trimesh: Any) -> dict[str, tuple[ts.Solid, Any]]:
    """Return solids and their meshes, lowest place at the origin."""
    ball = trimesh.creation.icosphere(subdivisions=5, radius=5.0)
    ball.apply_translation((0, 0, 5))
    box = trimesh.creation.box((12, 6, 8))
    box.apply_translation((0, 0, 4))
    pen = trimesh.creation.cylinder(radius=4.0, height=60.0, sections=256)
    pen.apply_transform(trimesh.transformations.rotation_matrix(0.5 * math.pi, (0, 1, 0)))
    pen.apply_translation((0, 0, 4))
    tip = trimesh.creation.cone(radius=8.0 * math.tan(1.3), height=8.0, sections=256)
    tip.apply_transform(trimesh.transformations.rotation_matrix(math.pi, (1, 0, 0)))
    tip.apply_translation((0, 0, 8))
    return {
        "cone": (ts.Solid.cone(2.6), tip),
        "sphere": (ts.Solid.sphere(5.0), ball), "box": (ts.Solid.box((12, 6, 8)), box),
        "cylinder": (ts.Solid.cylinder(4.0), pen),
    }  # fmt: skip


@pytest.mark.parametrize("kind", ["sphere", "box", "cylinder", "cone"])
def test_a_mesh_is_pressed_as_the_solid_that_it_is(
    pairs: dict[str, tuple[ts.Solid, Any]], kind: str, tmp_path: Path
) -> None:
    solid, mesh = pairs[kind]
    file = tmp_path / "thing.stl"
    mesh.export(file)
    one, two = (ts.press(TIP, s.at(*POSE, 0.4), depth_mm=1.2) for s in (solid, ts.Solid.from_mesh(file)))
    np.testing.assert_array_equal(one.touched, two.touched)
    assert one.touched.sum() >= 2
    np.testing.assert_allclose(two.l, one.l, atol=0.05)
    np.testing.assert_allclose(two.u, one.u, atol=0.05)
    assert two.force_n == pytest.approx(one.force_n, rel=0.01)
    assert two.area_mm2 == pytest.approx(one.area_mm2, rel=0.02)


def test_meshes_that_are_not_as_they_should_be(pairs: dict[str, tuple[ts.Solid, Any]]) -> None:
    _, good = pairs["sphere"]
    right = ts.press(TIP, ts.Solid.from_mesh(good).at(*POSE), depth_mm=1.0)

    def pressed(mesh: Any, unit: str = "mm") -> Patch:
        return ts.press(TIP, ts.Solid.from_mesh(mesh, unit).at(*POSE), depth_mm=1.0)

    inverted, metres, holed = good.copy(), good.copy(), good.copy()
    inverted.invert()
    metres.apply_scale(0.001)
    holed.update_faces(np.arange(len(holed.faces)) % 50 > 0)
    assert pressed(inverted).force_n == pytest.approx(right.force_n)
    assert pressed(metres, "m").force_n == pytest.approx(right.force_n, rel=1e-4)
    for sense in range(2):
        assert pressed(holed).force_n == pytest.approx(right.force_n, rel=0.1), sense
        holed.invert()
    with pytest.raises(
        ContactError, match=r"is 0.01 mm large by unit='mm'; is it in metres\? Units are: mm, cm, m, inch"
    ):
        pressed(metres)
    with pytest.raises(OptionError, match="unit 'ft' does not exist; choose one of: mm, cm, m, inch"):
        pressed(good, "ft")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("vertex 6.0", "vertex 1e999", "corners that are not finite numbers"),
        ("vertex 6.0", "vertex nan", "corners that are not finite numbers"),
    ],
)
def test_corners_that_are_no_numbers_are_not_passed_over(
    trimesh: Any, old: str, new: str, said: str, tmp_path: Path
) -> None:
    text = trimesh.creation.box((12, 6, 8)).export(file_type="stl_ascii")
    assert old in text
    (tmp_path / "box.stl").write_text(text.replace(old, new, 1))
    with pytest.raises(ContactError, match=said):
        ts.Solid.from_mesh(tmp_path / "box.stl")


def test_triangles_that_are_wound_in_different_ways_are_mended_or_named(
    trimesh: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    box = trimesh.creation.box((12, 6, 8))
    box.faces[0] = box.faces[0][::-1]
    missing = trimesh.exceptions.ExceptionWrapper(ImportError("networkx"))
    monkeypatch.setattr(trimesh.repair, "nx", missing)
    with pytest.raises(ContactError, match="wound in different ways; repair it"):
        ts.Solid.from_mesh(box)


def test_normals_that_cannot_be_read_are_not_needed_and_cost_no_traceback(
    trimesh: Any, tmp_path: Path
) -> None:
    text = trimesh.creation.box((12, 6, 8)).export(file_type="stl_ascii")
    file = tmp_path / "box.stl"
    file.write_text(text.replace("facet normal -1.0", "facet normal one", 1))
    program = (
        f"import tacstrip as ts; ts.Solid.from_mesh({str(file)!r})"  # pytest's own handlers would take it
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stderr == ""


def test_without_embreex_it_is_said_once_and_reads_the_same(
    pairs: dict[str, tuple[ts.Solid, Any]], monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    pytest.importorskip("rtree")
    _, mesh = pairs["box"]
    quick, slow = (meshes.Mesh(mesh, "box") for _ in range(2))
    start = np.array([[0.0, 0.0, 1.0], [1.0, 2.0, 7.0], [50.0, 0.0, 1.0]])
    up = np.broadcast_to([0.0, 0.0, 1.0], start.shape)
    expected = quick.indentation(start, up, 5.0)
    assert expected[0] == pytest.approx(1.0)
    assert expected[1] == math.inf  # its column begins within the box: deeper than the skin is thick
    assert expected[2] < 0.0
    monkeypatch.setattr(meshes, "_told", set())
    monkeypatch.setitem(__import__("sys").modules, "embreex", None)
    with caplog.at_level(logging.WARNING, "tacstrip"):
        found = [slow.indentation(start, up, 5.0) for _ in range(2)]
        meshes.Mesh(mesh, "box").lowest(np.zeros(1), np.zeros(1))
    np.testing.assert_array_equal(found[0], expected)
    assert sum("embreex is not installed" in r.message for r in caplog.records) == 1


@pytest.mark.parametrize("turned", [False, True], ids=["right", "inside out"])
def test_a_hole_that_the_skin_meets_is_said_once_and_one_that_it_does_not_is_not(
    trimesh: Any, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, turned: bool
) -> None:
    ball = trimesh.creation.icosphere(subdivisions=3, radius=5.0)
    monkeypatch.setattr(meshes, "_told", set())
    said = []
    for name, kept in (
        ("front", ball.triangles_center[:, 2] < 2.0),
        ("holes", np.arange(len(ball.faces)) % 7 > 0),
    ):
        part = ball.copy()
        part.update_faces(kept)
        if turned:
            part.invert()
        solid = ts.Solid("mesh", mesh=meshes.Mesh(part, name))
        with caplog.at_level(logging.WARNING, "tacstrip"):
            patches = [ts.press(TIP, solid.at(*POSE), depth_mm=1.0) for _ in range(2)]
        said += [patches[0].area_mm2]
    whole = ts.press(TIP, ts.Solid("mesh", mesh=meshes.Mesh(ball, "ball")).at(*POSE), depth_mm=1.0).area_mm2
    assert said[0] == pytest.approx(whole, rel=1e-6)
    assert said[1] < 0.95 * whole
    assert [r.getMessage().split(",")[0] for r in caplog.records] == ["holes is not closed"]


PLANE = ts.Solid.plane().at(*POSE)


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda: ts.press(TIP, PLANE), "press needs one of depth_mm, how far [mm], and force_n, how hard [N]"),
        (lambda: ts.press(TIP, PLANE, depth_mm=1.0, force_n=1.0), "press needs one of"),
        (lambda: ts.press(TIP, PLANE, depth_mm=0.0), "depth_mm = 0.0: must be above 0"),
        (lambda: ts.press(TIP, PLANE, force_n=math.inf), "force_n = inf: must be above 0"),
        (lambda: ts.press(TIP, PLANE, depth_mm=4.0), "the object sinks 4 mm into a skin of 3 mm: press less"),
        (lambda: ts.press(TIP, ts.Solid.sphere(4.0).at(*POSE), depth_mm=40.0), "the object sinks 40 mm into a skin"),
        (lambda: ts.press(TIP, PLANE, force_n=900.0), "N press the object in by the skin's thickness, 3 mm"),
        (lambda: ts.press(TIP, ts.Solid.sphere(2.0).at((30, 0, 50), (0, 0, -1)), depth_mm=1.0), "does not meet"),
        (lambda: ts.press(TIP, PLANE.at((0, 0, 0), (0, 0, 0)), depth_mm=1.0), "toward = (0, 0, 0): give the direction"),
        (lambda: PLANE.at((0, 0, 0), (1.7e308, 0, -1.7e308)), "toward = (1.7e+308, 0, -1.7e+308): give the direction"),
        (lambda: PLANE.at((0, 0), (0, 0, 1)), "position_mm = (0, 0): give three numbers, (x, y, z)"),
        (lambda: ts.Solid.sphere(0.0), "radius_mm = 0.0: must be above 0"),
        (lambda: ts.Solid.edge(90.0), "angle_rad = 90.0: an edge has between 0 and pi, and is not in degrees"),
        (lambda: ts.Solid.box((1, 2)), "a box has one side or three"),
        (lambda: ts.Solid.from_mesh("no.stl"), "no.stl: no such file; give a mesh (.stl, .obj, .ply)"),
        (lambda: ts.Solid.from_mesh(__file__), "cannot be read as a mesh"),
        (lambda: ts.Solid.from_mesh(3), "holds no triangles"),
        (lambda: ts.press(TIP, cast("Any", "plane"), depth_mm=1.0), "solid is 'plane', not a Solid; write ts.Solid"),
        (lambda: ts.simulate(FLAT, ts.press(TIP, PLANE, depth_mm=1.0)), "has 16 strips and the sensor has 24"),
        (lambda: ts.simulate(TIP, ts.press(TIP, PLANE, depth_mm=1.0), model="network"), "a patch needs closed forms"),
    ],
)  # fmt: skip
def test_what_cannot_be_pressed_gets_a_sentence(call: Callable[[], object], text: str) -> None:
    with pytest.raises(ts.TacstripError) as caught:
        call()
    assert text in str(caught.value)
