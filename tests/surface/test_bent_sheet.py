"""A sheet bent along a path: a tube where the path is a circle, a plane where it is straight."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.errors import SpecError
from tacstrip.surface.skin import skin_of

CIRCLE = [[20.0 * math.cos(a), 20.0 * math.sin(a)] for a in np.linspace(0.3, 2.8, 21)]


def sheet(path: Any, strips: int = 10, height: float = 30.0, **keys: Any) -> ts.Sensor:
    surface = {"kind": "sheet", "path_mm": path, "height_mm": height} | keys
    return ts.Sensor.from_dict({"format": 1, "construction": "crs-crs", "strips": strips, "surface": surface})


@pytest.mark.parametrize("along", ["path", "extrusion"])
@pytest.mark.parametrize("inside", [False, True])
def test_places_come_back_and_normals_are_square_to_the_skin(along: str, inside: bool) -> None:
    sensor = sheet([[0, 0], [20, 5], [40, 0], [55, -15]], along=along, inside=inside)
    skin = skin_of(sensor)
    assert (sensor.length_mm == 30.0) is (along == "extrusion")
    strip, y = np.meshgrid(np.linspace(-0.4, 9.4, 7), np.linspace(0.5, sensor.length_mm - 0.5, 9))
    place = skin.places(strip, y)
    points, normals = skin.points(*place), skin.normals(*place)
    np.testing.assert_allclose(
        skin.strip_places(*skin.places_near(points + 0.2 * normals)), [strip, y], atol=1e-3
    )
    step = 1e-4
    for aside in ((step, 0.0), (0.0, step)):
        moved = skin.points(place[0] + aside[0], place[1] + aside[1]) - points
        np.testing.assert_allclose(
            np.linalg.norm(moved, axis=-1) / step, 1.0, atol=1e-3
        )  # it bends and nothing else
        np.testing.assert_allclose((moved / step * normals).sum(axis=-1), 0.0, atol=1e-3)


def test_round_a_circle_it_is_a_tube_and_straight_it_is_flat() -> None:
    tube = ts.Sensor.from_dict({
        "format": 1, "construction": "crs-crs", "strips": 200,
        "surface": {"kind": "cylinder", "radius_mm": 20.0, "height_mm": 30.0},
    })  # fmt: skip
    for solid, bent in (
        (ts.Solid.box((12.0, 8.0, 6.0)), sheet(CIRCLE)),
        (ts.Solid.sphere(9.0), sheet(CIRCLE[::-1], inside=True)),
    ):
        posed = solid.at((0, 30, 15), toward=(0, -1, 0))
        right, found = (ts.press(one, posed, depth_mm=1.0) for one in (tube, bent))
        assert found.area_mm2 == pytest.approx(right.area_mm2, rel=2e-3)
        assert found.force_n == pytest.approx(right.force_n, rel=2e-3)
        np.testing.assert_allclose(found.centroid_xyz, right.centroid_xyz, atol=0.02)
    flat = ts.Sensor(construction="crs-crs", strips=10, pitch_mm=3.0, length_mm=50.0)
    like = sheet([[0, 0], [20, 0], [50, 0]])
    contact = ts.Contact.polygon([(4, 10), (25, 14), (18, 40)])
    for name in ("kh", "kl"):
        np.testing.assert_allclose(
            ts.simulate(like, contact)[name], ts.simulate(flat, contact)[name], atol=1e-12
        )
    ball = ts.Solid.sphere(9.0)
    on_flat = ts.press(flat, ball.at((14, 21, 30), toward=(0, 0, -1)), depth_mm=1.2)
    on_sheet = ts.press(like, ball.at((21, -30, 14), toward=(0, 1, 0)), depth_mm=1.2)
    np.testing.assert_allclose(on_sheet.l, on_flat.l, atol=1e-3)
    np.testing.assert_allclose(on_sheet.u, on_flat.u, atol=1e-3)
    assert on_sheet.force_n == pytest.approx(on_flat.force_n, rel=1e-3)
    fit = ts.fit_solid(ts.simulate(like, on_sheet), like, ts.Solid.sphere(9.0), ts.Noise(positional=0.001))
    assert abs(fit.area_mm2 - on_sheet.area_mm2) < 3.0 * fit.area_sigma_mm2


def test_a_flat_outline_is_followed_on_what_unrolls_to_a_rectangle() -> None:
    outline, noise = (
        ts.Contact.polygon([(-25, -20), (20, -25), (25, 20), (-10, 25)]),
        ts.Noise(positional=0.002),
    )
    round_it = {"kind": "cylinder", "radius_mm": 100.0 / math.pi, "height_mm": 100.0}
    tube = ts.Sensor.from_dict({"format": 1, "construction": "crs-crs", "strips": 20, "surface": round_it})
    flat = ts.Sensor(construction="crs-crs", strips=10, pitch_mm=10.0, length_mm=100.0)
    straight = sheet([[0, 0], [40, 20], [90, 0]], height=100.0)
    bent = replace(straight, surface=replace(straight.surface, along="extrusion"), length_mm=100.0,
                   pitch_mm=straight.surface.path_length_mm / 10) if straight.surface else straight  # fmt: skip
    for sensor, start, step in (
        (flat, 40.0, 0.5),
        (bent, 40.0, 0.5),
        (tube, 185.0, 1.0),
    ):  # and across the seam
        # Turned so that no corner stays between two strips: an edge may hide there.
        moved = [outline.turned(-0.03 * i).placed(start + step * i, 50.0) for i in range(20)]
        scans = [ts.simulate(sensor, c, noise, rng=i, time_s=0.01 * i) for i, c in enumerate(moved)]
        (one,) = ts.track(scans, sensor, noise)
        assert (one.status, len(one.outline)) == ("ok", 4)
        assert one.poses[-1, 2] - one.poses[0, 2] == pytest.approx(-0.57, abs=0.02)
        assert one.poses[-1, 0] - one.poses[0, 0] == pytest.approx(19 * step, abs=0.8)
        placed = ts.fit_object(scans[-1], sensor, outline, noise).objects[0]
        assert placed.pose is not None
        assert [placed.pose.x_mm, placed.pose.y_mm] == pytest.approx([start + 19 * step, 50.0], abs=0.5)


@pytest.mark.parametrize(
    ("keys", "text"),
    [
        ({"path_mm": [[0, 0]]}, "surface.path_mm: needs two points [x, y] or more"),
        ({"path_mm": [[0, 0], [30, 0], [30, 30], [10, -20]]}, "surface.path_mm: the sheet crosses itself"),
        ({"thickness_mm": 20.0}, "must be below the radius to which the sheet is bent, 19.8 mm"),
        ({"along": "meridians"}, "along"),
        ({"radius_mm": 5.0}, "surface.radius_mm does not belong to a sheet"),
    ],
)
def test_what_cannot_be_gets_a_sentence(keys: dict[str, Any], text: str) -> None:
    with pytest.raises(SpecError) as caught:
        sheet(**{"path": CIRCLE} | {k if k != "path_mm" else "path": v for k, v in keys.items()})
    assert text in str(caught.value)
