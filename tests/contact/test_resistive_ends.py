"""Contact resistance on wide strips: where a thin strip's contact would end that reads the same, and the slopes."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

import tacstrip as ts
from tacstrip.arrays import FloatArray
from tacstrip.contact.resistive_ends import ResistiveEnds, edges_on
from tacstrip.contact.resolved_ends import resolved_ends
from tacstrip.network.strips.resolved import mesh_limit, wide_readings

L = 20.0  # of the strips, over their width
SLANTED = np.array([(0.0, 5.0), (1.0, 6.0), (1.0, 9.0), (0.0, 8.5)])
CORNER = np.array([(0.0, 5.0), (0.4, 4.0), (1.0, 6.0), (1.0, 9.0), (0.7, 10.0), (0.0, 8.5)])
PART = np.array([(0.55, 5.0), (1.0, 5.0), (1.0, 9.0), (0.55, 8.0)])
LEVEL = np.array([(0.0, 5.0), (1.0, 5.0), (1.0, 7.0), (0.5, 7.0), (0.5, 6.0), (0.0, 6.0)])
SHAPES = {"slanted": SLANTED, "corner": CORNER, "in part": PART, "steps": LEVEL}


def solved(*shapes: FloatArray, decay: float = 0.3) -> ResistiveEnds:
    return ResistiveEnds.on(edges_on([shapely.Polygon(s) for s in shapes]), L, decay)


@pytest.mark.parametrize("decay", [0.05, 0.3, 2.0])
def test_level_edges_read_as_on_a_thin_strip(decay: float) -> None:
    """Over the whole length between the bars too, and where the contact covers a bar."""
    places = np.array([(5.0, 6.0), (5.0, 5.05), (0.0, 3.0), (12.0, L), (0.01, L - 0.01)])
    blocks = [np.array([(0, l), (1, l), (1, u), (0, u)]) for l, u in places]
    np.testing.assert_allclose(solved(*blocks, decay=decay).ends.T, places, atol=2e-6)


@pytest.mark.parametrize("name", SHAPES)
def test_readings_are_the_limit_of_networks(name: str) -> None:
    """Of strips 5 % of L wide, on rubber and on metal, to 1e-5 of Vref; of a contact with a hole as well."""
    shape = shapely.Polygon(5.0 * SHAPES[name])
    if name == "slanted":
        shape = shape.difference(shapely.box(1.0, 32.0, 3.5, 38.0))
    for construction in ("crs-crs", "crs-m"):
        sensor = ts.Sensor(
            construction=construction, strips=1, pitch_mm=5.0, length_mm=100.0, contact_lambda_mm=1.5,
            strip_width_mm=5.0,
        )  # fmt: skip
        contact = ts.Contact((shape,))
        every = [wide_readings(sensor, contact, across=n) for n in (12, 24, 48)]
        for signature, k in wide_readings(sensor, contact).items():
            limit = mesh_limit(*(each[signature] for each in every))
            np.testing.assert_allclose(k, limit, atol=2e-5)


@pytest.mark.parametrize("name", SHAPES)
def test_slopes_are_those_of_differences(name: str) -> None:
    shape, step = SHAPES[name], 1e-3
    found, edges = solved(shape), edges_on([shapely.Polygon(shape)])
    by_edges = found.slopes()[:, 0]
    for vertex in shape:
        for way in np.eye(2):
            if way[0] and vertex[0] in (0.0, 1.0):
                continue  # it stays on its side
            move = step * way * (np.abs(edges[0] - vertex).max(axis=-1) < 1e-9)[..., None]
            ends = [ResistiveEnds.on(edges + sign * move, L, 0.3).ends[:, 0] for sign in (-1.0, 1.0)]
            expected = (ends[1] - ends[0]) / (2.0 * step)
            told = (by_edges * move / step).sum(axis=(1, 2, 3))
            np.testing.assert_allclose(told, expected, atol=4e-3)


def test_many_strips_are_solved_as_one_by_one() -> None:
    shapes = [*SHAPES.values()] * 7
    together = solved(*shapes)
    for i, shape in enumerate(shapes[:4]):
        alone = solved(shape)
        np.testing.assert_allclose(together.ends[:, i::4], np.tile(alone.ends, 7), atol=1e-9)
        own = together.slopes()[:, i]
        np.testing.assert_allclose(own[:, : len(shape)], alone.slopes()[:, 0], atol=1e-9)
        assert not own[:, len(shape) :].any()


def test_fewer_cosines_err_by_less_than_a_thousandth_of_the_width(monkeypatch: pytest.MonkeyPatch) -> None:
    decays = (0.03, 0.2, 1.0)
    usual = [solved(CORNER, PART, decay=decay).ends for decay in decays]
    monkeypatch.setattr("tacstrip.contact.resistive_ends._COSINES", 12.0)
    monkeypatch.setattr("tacstrip.contact.resistive_ends._ELEMENT", 0.6)
    for decay, ends in zip(decays, usual, strict=True):
        np.testing.assert_allclose(ends, solved(CORNER, PART, decay=decay).ends, atol=1e-3)


def test_with_little_lambda_ends_are_between_ideal_ones_and_others() -> None:
    """Where elements would have to be too many; the slopes likewise."""
    ideal = resolved_ends([shapely.Polygon(CORNER)], 0.5, 1.0, L)
    assert ideal is not None
    small, none = (solved(CORNER, decay=decay) for decay in (0.01, 1e-9))
    np.testing.assert_allclose(none.ends[:, 0], ideal, atol=1e-6)
    between = solved(CORNER, decay=0.02).ends[:, 0] + ideal
    np.testing.assert_allclose(small.ends[:, 0], 0.5 * between, atol=1e-6)
    np.testing.assert_allclose(small.slopes()[..., 1].sum(axis=(2, 3)), 1.0, atol=0.01)


@pytest.mark.parametrize("size", [1e-3, 1e-8])
def test_specks_read_where_they_are(size: float) -> None:
    """Of a conductance that rounding would lose, too."""
    specks = [
        np.array([(0.5, 5.0), (0.5 + size, 5.0), (0.5, 5.0 + size)]),
        np.array([(0, 5), (1, 5), (0, 5.0 + size)]),
    ]
    found = solved(*specks, decay=2.0)
    np.testing.assert_allclose(found.ends, 5.0, atol=0.3)
    np.testing.assert_allclose(found.ends.mean(axis=0), 5.0, atol=2e-3)
    assert np.isfinite(found.slopes()).all()
