"""A skin on a body of a MuJoCo model reads what the same solid pressed into it reads."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.contact.press.patch import patch_at
from tacstrip.errors import ContactError, OptionError

TIP = ts.Sensor.load("fingertip")
OUT, X = np.array([0.6, 0.0, 0.8]), np.array([0.8, 0.0, -0.6])
Y = np.cross(OUT, X)


def stepped(*geoms: str) -> tuple[Any, Any]:
    """Return a model of a finger, moved and turned, and of things about it, told in the finger's frame."""
    mujoco: Any = pytest.importorskip("mujoco")
    place = 'pos=".3 -.2 .5" euler="20 50 -70"'
    xml = f"""<mujoco><worldbody><frame {place}>{"".join(geoms)}</frame>
      <body {place}><body name="finger"><joint/>
        <geom name="bone" size=".008"/><site name="tip" pos="0 0 .001"/></body></body></worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def told(at: np.ndarray, z: np.ndarray = OUT, x: np.ndarray = X) -> str:
    """Return a geom's place [mm] and axes as MuJoCo has them."""
    return f'pos="{" ".join(map(str, 1e-3 * at))}" xyaxes="{" ".join(map(str, [*x, *np.cross(z, x)]))}"'


def posed(solid: ts.Solid, depth: float = 1.0) -> ts.Solid:
    return replace(solid, position_mm=(10.0 - depth) * OUT, axes=np.stack([X, Y, OUT]))


@pytest.mark.parametrize(
    ("geom", "solid", "near_mm"),
    [
        (f'<geom type="sphere" size=".005" {told(14.0 * OUT)}/>', ts.Solid.sphere(5.0), 1e-6),
        (f'<geom type="plane" size="1 1 1" {told(9.0 * OUT, -OUT)}/>', ts.Solid.plane(), 1e-6),
        (f'<geom type="box" size=".004 .003 .002" {told(11.0 * OUT)}/>', ts.Solid.box((8.0, 6.0, 4.0)), 1e-6),
        (f'<geom type="capsule" size=".004 .05" {told(13.0 * OUT, X, Y)}/>', ts.Solid.cylinder(4.0), 1e-6),
        (f'<geom type="capsule" size=".004 .007" {told(13.0 * OUT, X, Y)}/>', ts.Solid.cylinder(4.0), 0.02),
        (f'<geom type="cylinder" size=".004 .007" {told(13.0 * OUT, X, Y)}/>', ts.Solid.cylinder(4.0), 0.02),
        (f'<geom type="ellipsoid" size=".005 .005 .005" {told(14.0 * OUT)}/>', ts.Solid.sphere(5.0), 0.02),
    ],
    ids=["sphere", "plane", "box", "rod", "short rod", "short cylinder", "ellipsoid"],
)
def test_a_geom_is_the_solid_that_is_pressed(geom: str, solid: ts.Solid, near_mm: float) -> None:
    model, data = stepped(geom)
    skin = ts.mujoco_skin(model, TIP, body="finger")
    patch, right = skin.press(data), patch_at(TIP, posed(solid))
    np.testing.assert_allclose(patch.l, right.l, atol=near_mm)
    np.testing.assert_allclose(patch.u, right.u, atol=near_mm)
    np.testing.assert_allclose(patch.force_xyz, right.force_xyz, atol=0.01 * right.force_n)
    read, right_scan = skin.read(data), ts.simulate(TIP, patch)
    np.testing.assert_allclose(read["kh"], right_scan["kh"], atol=1e-9)
    assert read.time_s == data.time


def test_all_that_touches_counts_and_the_own_body_does_not() -> None:
    ball = '<geom name="{}" type="sphere" size=".005" {}/>'
    other = np.array([-OUT[0], 0.0, OUT[2]])
    model, data = stepped(
        ball.format("a", told(14.0 * OUT)),
        ball.format("b", told(13.5 * other)),
        ball.format("far", told(40.0 * OUT)),
    )
    whole = ts.mujoco_skin(model, TIP, body="finger").press(data)
    one, two = (ts.mujoco_skin(model, TIP, body="finger", geoms=[name]).press(data) for name in "ab")
    np.testing.assert_array_equal(whole.touched, one.touched | two.touched)
    assert whole.area_mm2 == pytest.approx(one.area_mm2 + two.area_mm2)
    np.testing.assert_allclose(whole.force_xyz, one.force_xyz + two.force_xyz)
    assert np.isnan(whole.outline_xyz).any(axis=1).sum() == 1
    none = ts.mujoco_skin(model, TIP, body="finger", geoms=["far"])
    assert none.press(data).area_mm2 == 0.0
    assert not none.read(data).touched.any()
    higher = ts.mujoco_skin(model, TIP, site="tip", geoms=["a"]).press(data)  # the site is 1 mm further out
    assert higher.max_indentation_mm > one.max_indentation_mm + 0.5


def test_what_cannot_be_gets_a_sentence() -> None:
    model, data = stepped(f'<geom name="ball" type="sphere" size=".005" {told(11.5 * OUT)}/>')
    with pytest.raises(ContactError, match=r"geom ball at 0 s: the object sinks 3.5 mm into a skin of 3 mm"):
        ts.mujoco_skin(model, TIP, body="finger").press(data)
    for words, text in (
        ({"body": "fingre"}, "body.*fingre.*finger"),
        ({"site": "tip", "body": "finger"}, "give one of site and body"),
        ({"body": "finger", "geoms": ["bal"]}, "geoms.*bal.*ball"),
    ):
        with pytest.raises(OptionError, match=text):
            ts.mujoco_skin(model, TIP, **words)
