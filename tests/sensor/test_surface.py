"""The `[surface]` table, and y on a tapering strip as the closed forms know it, against a ladder of its own."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.arrays import FloatArray
from tacstrip.errors import SpecError
from tacstrip.sensor.resistance import electrical_ends, electrical_slopes, ends_from_electrical
from tacstrip.sensor.surface import Surface

TIP = Surface(kind="sphere", radius_mm=10.0)
CONE = Surface(kind="cone", radius_mm=28.0, end_radius_mm=45.0, height_mm=180.0, around_deg=300.0)
VASE = Surface(kind="revolution", profile_mm=((5.0, 0.0), (12.0, 10.0), (12.0, 18.0), (8.0, 30.0)))
STRAIGHT = Surface(kind="cone", radius_mm=20.0, end_radius_mm=30.0, height_mm=50.0, tapered=False)
RINGS = Surface(kind="sphere", radius_mm=10.0, along="parallels", around_deg=350.0)


def sensor_on(surface: Surface, strips: int = 16, **more: Any) -> ts.Sensor:
    keys: dict[str, Any] = {"format": 1, "construction": "crs-crs", "strips": strips, "surface": {}} | more
    made = surface.from_dict(
        {k: v for k, v in tomllib.loads(surface.to_toml())["surface"].items() if v is not None}
    )
    assert made == surface
    if not surface.tapered:
        keys["strip_width_mm"] = 5.0
    return ts.Sensor(
        **{k: v for k, v in keys.items() if k != "surface"},
        pitch_mm=surface.pitch_mm(strips), length_mm=surface.length_mm(strips), surface=surface,
    )  # fmt: skip


def ladder(
    sensor: ts.Sensor, l: float, u: float, width: Any, length: float, cells: int
) -> tuple[float, float]:
    """Return k_h and k_l of a contact from l to u: nodes and resistors, the width in the middle of every cell."""
    y = np.concatenate(
        [np.linspace(a, b, n + 1)[:-1] for a, b, n in ((0, l, cells), (l, u, cells), (u, length, cells))]
        + [[length]]
    )
    r = np.diff(y) / width(0.5 * (y[1:] + y[:-1]))
    inner = slice(cells, 2 * cells)
    ratio, lam = sensor.sensing_ratio, sensor.contact_lambda_mm
    if lam == 0.0:  # both layers in parallel
        parts = [r[:cells].sum(), r[inner].sum() * ratio / (1.0 + ratio), r[2 * cells :].sum()]
        return (parts[0] + parts[1]) / sum(parts), parts[0] / sum(parts)
    nodes = cells + 1
    size = 2 * nodes
    matrix, drive = np.zeros((size, size)), np.zeros(size)
    for layer, factor in ((0, 1.0), (nodes, ratio)):
        for i, each in enumerate(r[inner]):
            a, b, g = layer + i, layer + i + 1, 1.0 / (factor * each)
            matrix[[a, b], [a, b]] += g
            matrix[[a, b], [b, a]] -= g
    step = np.full(nodes, (u - l) / cells)
    step[[0, -1]] *= 0.5
    contact = width(y[cells : 2 * cells + 1]) * step / ((1.0 + ratio) * lam**2)
    for i, g in enumerate(contact):
        matrix[[i, nodes + i], [i, nodes + i]] += g
        matrix[[i, nodes + i], [nodes + i, i]] -= g
    below, above = 1.0 / r[:cells].sum(), 1.0 / r[2 * cells :].sum()
    matrix[0, 0] += below
    matrix[cells, cells] += above
    drive[cells] = above
    potential = np.linalg.solve(matrix, drive)
    return float(potential[-1]), float(potential[nodes])


@pytest.mark.parametrize(
    ("surface", "strip", "l", "u"),
    [(TIP, 0, 1.0, 7.0), (CONE, 3, 20.0, 90.0), (VASE, 0, 6.0, 25.0), (RINGS, 5, 4.0, 11.0)],
    ids=["meridians", "cone", "profile", "parallels"],
)  # fmt: skip
def test_closed_forms_in_s_are_the_ladder_of_a_tapering_strip(
    surface: Surface, strip: int, l: float, u: float
) -> None:
    sensor = sensor_on(surface, resistivity_ratio=1.7)
    length = float(surface.lengths_mm(16)[strip])

    def width(y: FloatArray) -> FloatArray:
        return surface.meridian(y)[0] if surface.along == "meridians" else np.ones_like(y)

    at = np.full((2, 16), np.nan)
    at[:, strip] = l, u
    read = ts.signatures(sensor, *at)
    exact = np.array([read["kh"][strip], read["kl"][strip]])
    off = [np.abs(ladder(sensor, l, u, width, length, n) - exact).max() for n in (20, 40, 80, 160)]
    if surface is RINGS:  # even strips: exact at any cell
        assert max(off) < 1e-9
    elif surface is VASE:  # its corners fall within cells
        assert off[-1] < 3e-6
    else:
        assert off[-1] < 1e-6
        np.testing.assert_allclose(np.log2(np.divide(off[:-1], off[1:])), 2.0, atol=0.05)


def test_contact_resistance_on_a_tapering_strip() -> None:
    def width(y: FloatArray) -> FloatArray:
        return TIP.meridian(y)[0]

    for l, u, lam, allowed in (
        (1.0, 7.0, 0.3, 5e-6),
        (5.0, 6.0, 0.3, 3e-7),
        (2.0, 2.5, 0.3, 1e-6),
        (5.0, 6.0, 1.0, 4e-6),
    ):
        sensor = sensor_on(TIP, contact_lambda_mm=lam)
        two = [np.array(ladder(sensor, l, u, width, TIP.meridian_mm, n)) for n in (100, 200)]
        limit = two[1] + (two[1] - two[0]) / 3.0  # of second order
        lost = lam * np.tanh((u - l) / (2.0 * lam))  # taken off in y and then mapped, as on even strips
        off, naive = (
            np.abs(limit - [k["kh"][0], k["kl"][0]]).max()
            for k in (
                ts.signatures(sensor, np.array([l]), np.array([u])),
                ts.signatures(
                    replace(sensor, contact_lambda_mm=0.0), np.array([l + lost]), np.array([u - lost])
                ),
            )
        )
        assert off < allowed
        assert naive > 3.0 * off


@pytest.mark.parametrize(
    "surface", [TIP, CONE, VASE, STRAIGHT, RINGS], ids=["sphere", "cone", "profile", "straight", "rings"]
)
@pytest.mark.parametrize("lam", [0.0, 0.05, 0.5])
def test_ends_come_back(surface: Surface, lam: float) -> None:
    sensor = sensor_on(surface, contact_lambda_mm=lam)
    share = np.linspace(0.02, 0.7, 16)
    l, u = (s * surface.lengths_mm(16) for s in (share, share + np.linspace(0.05, 0.29, 16)))
    low, high, left = electrical_ends(sensor, l, u)
    assert left == 0.0
    back = ends_from_electrical(sensor, low, high)
    np.testing.assert_allclose(back, [l, u], atol=1e-7 * sensor.length_mm)
    step = 1e-5
    moved = electrical_ends(sensor, l + step, u)[0]
    np.testing.assert_allclose(
        electrical_slopes(sensor, l, u)[0, 0], (moved - low) / step, rtol=1e-3, atol=1e-6
    )


def test_a_spec_says_it_in_a_few_keys_and_comes_back() -> None:
    text = 'format = 1\nconstruction = "crs-crs"\nstrips = 16\n[surface]\nkind = "sphere"\nradius_mm = 10.0\n'
    sensor = ts.Sensor.from_dict(tomllib.loads(text))
    assert (round(sensor.pitch_mm, 4), round(sensor.length_mm, 4), sensor.closed) == (3.927, 13.6136, True)
    assert replace(ts.Sensor.load("fingertip"), surface=TIP) == sensor
    for name in ("fingertip", "forearm"):
        shipped = ts.Sensor.load(name)
        assert ts.Sensor.from_dict(tomllib.loads(shipped.to_toml())) == shipped


@pytest.mark.parametrize(
    ("keys", "text"),
    [
        ({}, "surface.kind is missing; it is one of: sphere, cylinder, cone, revolution"),
        ({"kind": "torus"}, "surface.kind 'torus' does not exist; choose one of: sphere, cylinder, cone, revolution"),
        ({"kind": "sphere", "radius": 1.0}, "unknown key 'radius' in [surface]; the keys are: kind, along, radius_mm"),
        ({"kind": "sphere", "radius_mm": 0.0}, "surface.radius_mm = 0.0: must be a number above 0"),
        ({"kind": "sphere", "radius_mm": "9"}, "surface.radius_mm = '9': must be a number above 0"),
        ({"kind": "sphere"}, "surface.radius_mm is missing: a sphere needs it"),
        ({"kind": "sphere", "radius_mm": 10.0, "rim_deg": 10.0}, "must be 0 < tip_deg < rim_deg < 180"),
        ({"kind": "sphere", "radius_mm": 10.0, "height_mm": 1.0}, "surface.height_mm does not belong to a sphere"),
        ({"kind": "sphere", "radius_mm": 10.0, "around_deg": 400.0}, "must not exceed 360, or strips overlap"),
        ({"kind": "sphere", "radius_mm": 10.0, "along": "parallels"}, "which must not touch: at most 359"),
        ({"kind": "sphere", "radius_mm": 2.0}, "surface.thickness_mm = 3.0: must be below the surface's radius, 2 mm"),
        ({"kind": "sphere", "radius_mm": 10.0, "tapered": False}, "strips of 3.927 mm overlap where 16 meridians come"),
        ({"kind": "revolution", "profile_mm": [[5, 0], [0, 5]]}, "r = 0 at point 2; strips need a radius above 0"),
        ({"kind": "revolution", "profile_mm": [[5, 0], [5, 0]]}, "two points after each other are the same"),
        ({"kind": "revolution", "profile_mm": 3}, "surface.profile_mm: give points, [[r, z], [r, z], ...]"),
        ({"kind": "sphere", "radius_mm": 10.0, "inside": 1}, "surface.inside = 1: must be true or false"),
    ],
)  # fmt: skip
def test_what_cannot_be_gets_a_sentence(keys: dict[str, Any], text: str) -> None:
    with pytest.raises(SpecError) as caught:
        ts.Sensor.from_dict({"format": 1, "construction": "crs-crs", "strips": 16, "surface": keys})
    assert text in str(caught.value)


def test_a_surface_and_its_strips_must_agree() -> None:
    base = {
        "format": 1,
        "construction": "crs-crs",
        "strips": 16,
        "surface": {"kind": "sphere", "radius_mm": 10.0},
    }
    for more, text in (
        ({"length_mm": 20.0}, "length_mm = 20.0: on this surface 16 strips have 13.6136"),
        (
            {"construction": "cyl-crs-m", "radius_mm": 10.0},
            "[surface] is not for a cyl-crs-m sensor, which has",
        ),
        ({"construction": "crs-crp", "contact_lambda_mm": 0.1}, "[surface] is not for a crs-crp sensor"),
    ):
        with pytest.raises(SpecError) as caught:
            ts.Sensor.from_dict(base | more)
        assert text in str(caught.value)


def test_what_cannot_take_a_curved_skin_yet_says_so() -> None:
    sensor = ts.Sensor.load("fingertip")
    scan = ts.simulate(sensor, ts.Contact.polygon([(3, 2), (30, 4), (8, 11)]))
    stretched = "a sphere does not unroll to a rectangle: follow a solid .* ts.track_solid"
    for call, why in (
        (lambda: ts.vertex_reconstruction(scan, sensor), r"cannot take a sensor with a \[surface\] yet: "),
        (
            lambda: ts.fit_polygon(scan, sensor, area_mm2=10.0),
            r"cannot take a sensor with a \[surface\] yet: ",
        ),
        (lambda: ts.track([scan], sensor), stretched),
        (lambda: ts.LiveTracks(sensor), stretched),
        (lambda: ts.fit_object(scan, sensor, [(0, 0), (5, 0), (0, 5)]), stretched),
    ):
        with pytest.raises(ts.OptionError, match=why):
            call()
    with pytest.raises(ts.OptionError, match="strips along parallels"):
        ts.simulate(sensor_on(RINGS), ts.Contact.polygon([(3, 2), (9, 4), (8, 11)]))
