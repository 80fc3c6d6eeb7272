"""Curved skins in space: points, normals, and back."""

from __future__ import annotations

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.sensor.surface import Surface
from tacstrip.surface.cylinder import to_cartesian
from tacstrip.surface.skin import skin_of

TUBE = ts.Sensor(construction="cyl-crs-m", strips=8, pitch_mm=4.0, length_mm=60.0, radius_mm=9.0)


def on(surface: Surface, strips: int = 12) -> ts.Sensor:
    return ts.Sensor(
        construction="crs-crs", strips=strips, pitch_mm=surface.pitch_mm(strips), length_mm=surface.length_mm(strips),
        surface=surface,
    )  # fmt: skip


SKINS = {
    "plane": ts.Sensor(construction="crs-crs", strips=12, pitch_mm=3.0, length_mm=40.0),
    "tube": TUBE,
    "sphere": ts.Sensor.load("fingertip"),
    "rings": on(Surface(kind="sphere", radius_mm=10.0, along="parallels", around_deg=340.0)),
    "cone": ts.Sensor.load("forearm"),
    "hollow": on(Surface(kind="cylinder", radius_mm=20.0, height_mm=30.0, inside=True)),
    "vase": on(Surface(kind="revolution", profile_mm=((6.0, 0.0), (12.0, 9.0), (9.0, 20.0)))),
}


@pytest.mark.parametrize("name", SKINS)
def test_normals_are_square_to_the_skin_and_places_come_back(name: str) -> None:
    skin = skin_of(SKINS[name])
    rng = np.random.default_rng(0)
    strip = rng.uniform(-0.4, skin.strips - 0.6, 50)
    y = rng.uniform(0.02, 0.98, 50) * np.interp(strip, np.arange(skin.strips), skin.lengths_mm)
    across, up = skin.places(strip, y)
    normal, step = skin.normals(across, up), 1e-6
    for da, dt in ((step, 0.0), (0.0, step)):
        tangent = (skin.points(across + da, up + dt) - skin.points(across - da, up - dt)) / (2.0 * step)
        assert np.abs(np.einsum("ij,ij->i", tangent, normal)).max() < 1e-3 * max(1.0, np.abs(tangent).max())
        if da:
            np.testing.assert_allclose(np.linalg.norm(tangent, axis=1), skin.stretch(up), rtol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1.0, rtol=1e-12)
    back = skin.strip_places(*skin.places_near(skin.points(across, up) + 0.2 * normal))
    np.testing.assert_allclose(back[0], strip, atol=1e-6)
    assert np.abs(back[1] - y).max() < (0.1 if name == "vase" else 1e-6)  # whose kinks have no one normal


def test_normals_point_where_objects_come_from() -> None:
    for name in ("tube", "sphere", "rings", "cone", "hollow"):
        skin = skin_of(SKINS[name])
        place = np.array(0.7), np.array(5.0)
        out = float(skin.points(*place)[:2] @ skin.normals(*place)[:2])
        assert (out > 0.0) == (name != "hollow")
    assert skin_of(SKINS["sphere"]).normals(np.array(0.0), np.array(0.0))[2] > 0.9  # the pole is up


def test_a_tube_lies_as_it_always_did() -> None:
    strip, y = np.array([0.0, 3.0, 7.0]), np.array([0.0, 20.0, 60.0])
    skin = skin_of(TUBE)
    np.testing.assert_allclose(skin.points(*skin.places(strip, y)), to_cartesian(TUBE, strip, y), atol=1e-9)
