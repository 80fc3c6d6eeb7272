from dataclasses import replace

import numpy as np
import pytest
import shapely

import tacstrip as ts
from layered_scenes import NOISE, TRIANGLES, contact_of, square


def overlaps(found: ts.Reconstruction, outlines: tuple[list[tuple[float, float]], ...]) -> list[float]:
    """Return the best overlap of each outline with an object."""
    shapes = [shapely.Polygon(o.vertices) for o in found.objects]
    return [
        max(s.intersection(t).area / s.union(t).area for s in shapes) for t in map(shapely.Polygon, outlines)
    ]


def test_two_objects_on_shared_strips_are_told_and_placed() -> None:
    sensor = square()
    scan = ts.simulate(sensor, contact_of(*TRIANGLES), NOISE, rng=1)
    assert len(scan.split(sensor)[0].runs()) == 1  # one layer alone sees one object
    for noise in (NOISE, None):  # None: estimated
        found = ts.reconstruct(scan, sensor, noise)
        assert (found.status, found.advice, len(found.objects)) == ("ok", "", 2)
        assert min(overlaps(found, TRIANGLES)) > 0.93
    for thing, true in zip(found.objects, TRIANGLES, strict=True):
        assert len(thing.vertices) == 3
        assert thing.hidden is not None
        assert thing.covariance is not None
        assert not thing.hidden.any()
        off = thing.vertices - np.array(true)
        deviation = np.sqrt(np.diag(thing.covariance)).reshape(-1, 2)
        assert (np.abs(off) < 4.0 * deviation + 0.1).all()
    assert ts.reconstruct(scan, sensor, NOISE, assessment="fast").status == "likely"


def test_readings_put_aside_for_the_search_and_put_back_leave_as_many_objects() -> None:
    outlines = (
        [(86.5, 49.5), (69.1, 32.3), (75.1, 26.0), (90.0, 27.4)],
        [(61.2, 39.5), (74.4, 50.3), (66.6, 56.6), (60.0, 55.2)],
        [(16.7, 53.0), (32.0, 45.5), (36.1, 54.1), (33.8, 58.3), (26.0, 61.4)],
    )
    sensor = square()
    found = ts.reconstruct(ts.simulate(sensor, contact_of(*outlines), NOISE, rng=2), sensor, NOISE)
    assert (len(found.objects), found.status) == (3, "ok")  # the third was two once
    assert min(overlaps(found, outlines)) > 0.85


def test_a_scene_turned_with_its_layers_is_the_same_scene() -> None:
    sensor, contact = square(), contact_of(*TRIANGLES)
    turn = 0.5
    moved = contact.turned(turn, (0.0, 0.0)).moved(300.0, -40.0)
    layers = []
    for layer in sensor.layers:
        c, s = np.cos(turn), np.sin(turn)
        x, y = np.array([[c, -s], [s, c]]) @ layer.origin_mm + (300.0, -40.0)
        layers.append(replace(layer, angle_deg=layer.angle_deg + np.rad2deg(turn), x_mm=x, y_mm=y))
    whole = ts.LayeredSensor(layers=tuple(layers))
    here, there = ts.simulate(sensor, contact), ts.simulate(whole, moved)
    np.testing.assert_allclose(here["kh"], there["kh"], atol=1e-9)
    found = ts.reconstruct(there, whole, ts.Noise(positional=0.001))
    truth = tuple(shapely.get_coordinates(s)[:-1].tolist() for s in moved.shapes)
    assert min(overlaps(found, truth)) > 0.98


def test_metal_strips_dead_channels_and_scenes_that_are_none() -> None:
    metal = square(construction="crs-m")
    found = ts.reconstruct(ts.simulate(metal, contact_of(TRIANGLES[0]), NOISE, rng=1), metal, NOISE)
    assert len(found.objects) == 1
    sensor = square()
    scan = ts.simulate(sensor, contact_of(*TRIANGLES), NOISE, rng=2)
    kh = scan["kh"].copy()
    kh[12] = 0.9
    found = ts.reconstruct(ts.Scan(kh=kh, kl=scan["kl"]), sensor, NOISE)
    assert "strip 12 of layer 0 (k_h) does not fit" in found.advice
    assert min(overlaps(found, TRIANGLES)) > 0.85
    first_kh, first_kl = (np.where(np.arange(64) < 32, scan[name], np.nan) for name in ("kh", "kl"))
    lone = ts.reconstruct(ts.Scan(kh=first_kh, kl=first_kl), sensor, NOISE)
    assert lone.status == "too few strips"
    assert "no strip of layer 1 is touched" in lone.advice
    assert (
        ts.reconstruct(ts.Scan(kh=first_kh * np.nan, kl=first_kl * np.nan), sensor, NOISE).status
        == "no contact"
    )
    with pytest.raises(ts.ReadingError, match="has 32 strips and the sensor has 64"):
        ts.reconstruct(scan.split(sensor)[0], sensor, NOISE)
    with pytest.raises(ts.OptionError, match="two layers are reconstructed by"):
        ts.reconstruct(scan, sensor, NOISE, method="vertex")


def test_a_corner_that_may_pass_a_strip_is_as_uncertain_as_its_other_places() -> None:
    """The second corner lies 1.8 mm from its place, where the minimum's own curvature says .1 mm."""
    outlines = (
        [(24.1, 33.3), (41.8, 13.2), (50.6, 19.0), (50.4, 38.0)],
        [(33.7, 67.1), (49.1, 68.6), (46.5, 79.6), (40.0, 82.0)],
    )
    sensor = square()
    found = ts.reconstruct(ts.simulate(sensor, contact_of(*outlines), NOISE, rng=1), sensor, NOISE)
    for thing, true in zip(found.objects, outlines, strict=True):
        assert thing.covariance is not None
        off = np.hypot(*(thing.vertices - np.array(true)).T)
        deviation = np.sqrt(np.diag(thing.covariance).reshape(-1, 2).sum(axis=1))
        assert (off < 3.0 * deviation).all()
    assert found.objects[1].hidden is not None
    assert found.objects[1].hidden.tolist() == [False, True, False, False]
