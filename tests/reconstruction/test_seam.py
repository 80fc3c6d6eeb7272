"""Round a closed tube the last strip lies beside the first: contacts across the seam, and points."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import tacstrip as ts
from polygons import SURE
from tacstrip.arrays import FloatArray
from tacstrip.io import feature_collection
from tacstrip.plot.results import reconstruction_figure
from tacstrip.reconstruction.result import RecoveredObject
from tacstrip.reconstruction.seam import unrolled
from tacstrip.stream.bridges.tuio import blob
from tacstrip.tracking import Tracker

N, PITCH = 32, 4.0
AROUND = N * PITCH
TUBE = ts.Sensor(
    construction="cyl-crs-m", strips=N, pitch_mm=PITCH, length_mm=200.0, radius_mm=AROUND / (2.0 * math.pi)
)
SHAPE = np.array([(40.0, 50.0), (90.0, 40.0), (100.0, 90.0), (60.0, 130.0)])
NOISE = ts.Noise(positional=0.002)


def contact(turned_mm: float) -> ts.Contact:
    return ts.Contact.polygon(SHAPE).moved(turned_mm, 0.0)


def test_a_tube_is_closed_where_its_strips_go_all_round() -> None:
    assert TUBE.closed
    assert replace(
        TUBE, radius_mm=math.ceil(100.0 * AROUND / (2.0 * math.pi)) / 100.0
    ).closed  # a rounded radius
    assert not replace(TUBE, strips=N - 1).closed
    assert not ts.Sensor(construction="crs-m", strips=N, pitch_mm=PITCH, length_mm=200.0).closed


@pytest.mark.parametrize("strips", [3, 9, 20, -12])
def test_a_footprint_goes_on_at_the_other_side_of_the_seam(strips: int) -> None:
    here, there = ts.footprint(TUBE, contact(0.0)), ts.footprint(TUBE, contact(strips * PITCH))
    np.testing.assert_allclose(there.l, np.roll(here.l, strips), atol=1e-9)
    np.testing.assert_allclose(there.u, np.roll(here.u, strips), atol=1e-9)
    assert not there.clipped
    assert (there.pieces <= 1).all()
    beyond = ts.footprint(TUBE, ts.Contact.points([(AROUND, 70.0)]))
    assert np.flatnonzero(np.isfinite(beyond.l)).tolist() == [0, N - 1]  # their sides meet there
    assert ts.footprint(TUBE, ts.Contact.polygon([(120, -10), (140, -10), (140, 20), (120, 20)])).clipped


@pytest.fixture(scope="module")
def away() -> tuple[FloatArray, RecoveredObject]:
    """Readings of a contact away from the seam, and its polygon."""
    k = ts.simulate(TUBE, contact(0.0), NOISE, rng=1)["k"]
    (found,) = ts.fit_polygon(ts.Scan(k=k), TUBE, NOISE).objects
    return k, found


@pytest.mark.parametrize("turn", range(0, N, 5))
def test_across_the_seam_is_as_good_as_away_from_it(
    away: tuple[FloatArray, RecoveredObject], turn: int
) -> None:
    k, here = away
    there = ts.Scan(k=np.roll(k, turn))
    found = [of.objects for of in (ts.vertex_reconstruction(there, TUBE), ts.fit_polygon(there, TUBE, NOISE))]
    for (one,), status in zip(found, ("ok", SURE), strict=True):
        assert one.status == status
        assert 0 <= one.strips.start < N
        assert one.strips.start % N == (here.strips.start + turn) % N
    rounds = AROUND * round((here.centroid[0] + turn * PITCH - one.centroid[0]) / AROUND)
    moved = np.array([turn * PITCH - rounds, 0.0])
    np.testing.assert_allclose(one.vertices, here.vertices + moved, atol=1e-6)
    truth = contact(turn * PITCH).vertices
    assert ts.mismatch(truth, one.vertices, around_mm=AROUND).iou == pytest.approx(
        ts.mismatch(SHAPE, here.vertices).iou, abs=1e-6
    )


def test_a_tube_with_a_gap_keeps_its_ends() -> None:
    scan = ts.simulate(TUBE, contact(50.0), NOISE, rng=1)
    gap = replace(TUBE, radius_mm=1.05 * AROUND / (2.0 * math.pi))
    assert unrolled(scan, gap) == (scan, gap)
    assert [o.strips.start for o in ts.fit_polygon(scan, gap, NOISE).objects] == [0, 22]
    with pytest.raises(ts.errors.ContactError, match="outside the sensor"):
        ts.footprint(gap, contact(AROUND))


def test_a_strip_that_reads_nothing_at_the_seam_is_bridged_and_named() -> None:
    scan = ts.simulate(TUBE, contact(64.0), NOISE, rng=1)
    k = np.array(scan.k)
    k[0] = np.nan
    (found,) = ts.fit_polygon(ts.Scan(k=k), TUBE, NOISE).objects
    assert "strip 0 reads nothing inside the contact" in found.advice
    assert ts.mismatch(contact(64.0).vertices, found.vertices, around_mm=AROUND).iou > 0.85


def test_an_object_near_the_seam_stays_on_its_side() -> None:
    k = np.full(N, np.nan)
    k[[2, N - 2]] = 0.3, 0.6
    found = ts.fit_polygon(ts.Scan(k=k), TUBE, NOISE)
    assert [o.strips for o in found.objects] == [slice(2, 3), slice(N - 2, N - 1)]


def test_a_tracked_object_keeps_its_number_across_the_seam() -> None:
    tracker, seen = Tracker(TUBE, noise=NOISE), set()
    for i in range(24):
        scan = ts.simulate(TUBE, contact(4.0 * i), NOISE, rng=i, time_s=0.01 * i)
        (one,) = tracker.update(scan)
        seen.add(one.id)
        away = (one.shape.centroid[0] - contact(4.0 * i).centroid[0] + AROUND / 2.0) % AROUND - AROUND / 2.0
        assert abs(away) < 3.0
        sent = blob(one, TUBE)
        assert sent is not None
        assert 0.0 <= sent.x < 1.0
    assert seen == {1}
    assert tracker.searches <= 4


def test_pictures_and_geojson_hold_it_in_one_piece() -> None:
    scan = ts.simulate(TUBE, contact(50.0), NOISE, rng=1)
    found = ts.fit_polygon(scan, TUBE, NOISE)
    (feature,) = feature_collection([found])["features"]
    x = np.array(feature["geometry"]["coordinates"][0])[:, 0]
    assert np.ptp(x) == pytest.approx(60.0, abs=2.0 * PITCH)
    assert feature["properties"]["centroid_mm"][0] > AROUND - 10.0
    figure = reconstruction_figure(TUBE, [scan], {"fit": [found]})
    outlines = [line.get_xdata() for line in figure.axes[0].lines]
    again = [np.asarray(o) for o in outlines if np.min(o) < 0.0 < np.max(o)]
    assert len(again) == 1  # what lies beyond the seam, from the other side


def test_two_points_come_back_as_their_places() -> None:
    """Section 6.3: on metal a contact without width reads its own place, y = k L."""
    thesis = ts.Sensor.load("prototype-cyl-crs-m")
    scan = ts.simulate(thesis, ts.Contact.points([(6.0, 30.0), (14.0, 80.0)]))
    found = ts.fit_polygon(scan, thesis, NOISE).objects
    assert [o.status for o in found] == ["points", "points"]
    np.testing.assert_allclose(
        np.concatenate([o.points for o in found]), [(6.0, 30.0), (14.0, 80.0)], atol=1e-9
    )
    sigma = found[0].point_deviations[0]
    np.testing.assert_allclose(sigma, [3.0 / math.sqrt(12.0), 0.002 / math.sqrt(3.0) * 100.0])
    feature = feature_collection([ts.fit_polygon(scan, thesis)])["features"][1]
    assert feature["geometry"] == {"type": "MultiPoint", "coordinates": [[14.0, 80.0]]}
    assert feature["properties"]["point_sigma_mm"][0][1] is None  # no noise was given


@pytest.mark.parametrize("l", [0.0, 20.0, 60.0])
@pytest.mark.parametrize("w", [0.0, 5.0, 30.0])
def test_the_place_lies_within_the_contact_whatever_its_width(l: float, w: float) -> None:
    (found,) = ts.fit_polygon(ts.Scan(k=np.array([np.nan, l / (100.0 - w), np.nan, np.nan, np.nan])),
                              ts.Sensor.load("prototype-cyl-crs-m")).objects  # fmt: skip
    assert l - 1e-9 <= found.points[0, 1] <= l + w + 1e-9


def test_wide_strips_read_across_the_seam_as_anywhere_else() -> None:
    """What lay beyond it was cut away."""
    tube = ts.Sensor(construction="cyl-crs-m", strips=24, pitch_mm=5.0, length_mm=100.0, strip_width_mm=3.0,
                     radius_mm=60.0 / np.pi)  # fmt: skip
    contact = ts.Contact.polygon([(102, 30), (141, 35), (133, 70), (110, 62)])
    across, elsewhere = (ts.simulate(tube, c)["k"] for c in (contact, contact.moved(-60.0, 0.0)))
    assert np.flatnonzero(np.isfinite(across)).tolist() == [0, 1, 2, 3, 20, 21, 22, 23]
    np.testing.assert_allclose(across, np.roll(elsewhere, 12), atol=1e-9)
