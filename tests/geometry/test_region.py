"""95 % regions of vertices, and shapes as SVG."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.geometry.region import ellipse, outline_paths, regions
from tacstrip.notebook import drawing

SQUARE = np.array([(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)])


@pytest.mark.parametrize("level", [0.5, 0.95])
def test_an_ellipse_holds_its_share_of_normal_errors(level: float) -> None:
    covariance = np.array([(4.0, 1.5), (1.5, 1.0)])
    errors = np.random.default_rng(3).multivariate_normal(np.zeros(2), covariance, 40_000)
    outline = ellipse(np.array([5.0, 7.0]), covariance, level) - (5.0, 7.0)
    inverse = np.linalg.inv(covariance)
    edge = np.einsum("ij,jk,ik->i", outline, inverse, outline)
    np.testing.assert_allclose(edge, edge[0], rtol=1e-9)
    inside = np.einsum("ij,jk,ik->i", errors, inverse, errors) <= edge[0]
    assert inside.mean() == pytest.approx(level, abs=0.01)


def test_what_is_not_known_has_no_region() -> None:
    covariance = np.eye(8)
    covariance[2, 2] = np.inf
    assert len(regions(SQUARE, covariance)) == 3
    assert regions(SQUARE, None) == []


def test_a_result_draws_itself() -> None:
    drawn = ET.fromstring(drawing(outline_paths([(SQUARE, np.eye(8)), (SQUARE + 20.0, None)]), "two squares"))
    assert len(list(drawn)) == 2 + 4
    sensor = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=1, length_mm=50)
    scan = ts.simulate(sensor, ts.Contact.polygon([(3, 10), (15, 12), (9, 40)]))
    result = ts.profile_reconstruction(scan, sensor, ts.Noise(positional=0.005))
    for picture in (result._repr_svg_(), result.objects[0]._repr_svg_()):
        assert picture is not None
        assert "<path" in picture
        ET.fromstring(picture)
    assert "no shape" in str(ts.Reconstruction("profile", ())._repr_svg_())


def test_a_profile_with_noise_says_how_exact_its_area_is() -> None:
    sensor = ts.Sensor(construction="crs-crs", strips=40, pitch_mm=1, length_mm=100)
    contact, noise = ts.Contact.polygon([(3, 20), (35, 30), (20, 80)]), ts.Noise(positional=0.002)
    found = [
        ts.profile_reconstruction(ts.simulate(sensor, contact, noise, rng=s), sensor, noise).objects[0]
        for s in range(200)
    ]
    assert found[0].deviations is not None
    area, centroid, _ = found[0].deviations
    assert np.std([o.area for o in found]) == pytest.approx(area, rel=0.15)
    np.testing.assert_allclose(np.std([o.centroid for o in found], axis=0), centroid, rtol=0.15)
