"""Convex pieces from one scan: counted, outlined where they are seen, bounded where they are hidden."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from shapely import Polygon

import tacstrip as ts
from drawn import legend_of
from tacstrip.core.convex_chain import straight_lines
from tacstrip.io import feature_collection
from tacstrip.plot.results import reconstruction_figure
from tacstrip.reconstruction.pieces.chain import split_chain
from tacstrip.stream import encode
from tacstrip.stream.live.frame import Frame
from tacstrip.tracking import LiveObject
from tacstrip.view.frame_json import frame_json

SENSOR = ts.Sensor(construction="crs-crs", strips=100, pitch_mm=1.0, length_mm=100.0)
NOISE = ts.Noise(positional=0.005)
LOW = Polygon([(20, 30), (35, 12), (60, 18), (58, 36), (40, 40)])
HIGH = Polygon([(40, 60), (62, 48), (84, 62), (70, 85), (48, 80)])
MIDDLE = Polygon([(58, 22), (75, 5), (92, 20), (85, 38)])


def _scan(*shapes: Polygon, sensor: ts.Sensor = SENSOR, noise: ts.Noise = NOISE, rng: int = 1) -> ts.Scan:
    return ts.simulate(sensor, ts.Contact(shapes), noise, rng=rng)


def _nearest(piece: ts.Piece, shapes: tuple[Polygon, ...]) -> Polygon:
    return max(shapes, key=lambda shape: shape.intersection(Polygon(piece.outline)).area)


@pytest.mark.parametrize("noise", [NOISE, None])
@pytest.mark.parametrize("shapes", [(LOW,), (LOW, HIGH), (LOW, HIGH, MIDDLE)])
def test_pieces_that_share_strips_are_counted_and_seen_corners_lie_on_them(
    shapes: tuple[Polygon, ...], noise: ts.Noise | None
) -> None:
    scan = _scan(*shapes)
    found = ts.pieces(scan, SENSOR, noise)
    assert len(found) == len(shapes)
    assert len({_nearest(p, shapes).wkt for p in found}) == len(shapes)
    for piece in found:
        truth = _nearest(piece, shapes)
        # What is seen lies on the shape's outline, but for noise (.3 mm on a strip) and the ends' half pitch.
        seen = shapely.points(piece.outline[~piece.hidden])
        assert shapely.distance(truth.exterior, seen).max() < 1.5
        assert Polygon(piece.smallest).difference(truth.buffer(1.0)).area < 0.02 * truth.area
        assert truth.difference(Polygon(piece.largest).buffer(1.0)).area < 0.02 * truth.area
        x, y = piece.outline.T
        assert x @ np.roll(y, -1) > y @ np.roll(x, -1)  # counter-clockwise
        assert piece.hidden.any() == (len(shapes) > 1)
        within = np.mean([_iou(piece.outline, bound) for bound in (piece.smallest, piece.largest)])
        assert piece.status == ("ok" if len(shapes) == 1 else "likely" if within >= 0.8 else "doubtful")
        assert ("at least" in piece.advice) == (len(shapes) > 1)


def test_a_jump_between_few_strips_is_not_taken_for_noise_that_nobody_gave() -> None:
    sensor = ts.Sensor(construction="crs-crs", strips=10, pitch_mm=8.0, length_mm=100.0)
    low, high = (
        Polygon([(13, 22), (40, 22), (38, 34), (2, 32)]),
        Polygon([(34, 49), (72, 55), (62, 81), (44, 81)]),
    )
    noise = ts.Noise(positional=0.004)
    scan = _scan(low, high, sensor=sensor, noise=noise)
    assert len(ts.pieces(scan, sensor, noise)) == len(ts.pieces(scan, sensor)) == 2


def _iou(a: np.ndarray, b: np.ndarray) -> float:
    return float(Polygon(a).intersection(Polygon(b)).area / Polygon(a).union(Polygon(b)).area)


@pytest.mark.parametrize("half_width", [0.0005, 0.005])
def test_few_strips_leave_the_true_piece_within_the_largest_outline(half_width: float) -> None:
    # Its top edges are shown by one strip each: their slopes are open.
    low, high = Polygon([(20, 15), (45, 20), (30, 45)]), Polygon([(35, 60), (70, 55), (60, 80)])
    sensor = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0)
    noise = ts.Noise(positional=half_width)
    for seed in range(4):
        found = ts.pieces(_scan(low, high, sensor=sensor, noise=noise, rng=seed), sensor, noise)
        first = min(found, key=lambda p: p.outline[:, 1].min())
        assert low.difference(Polygon(first.largest).buffer(0.5)).is_empty
        assert Polygon(first.smallest).difference(low.buffer(1.0)).is_empty
        for piece in found:
            if piece.status != "doubtful":
                assert max(_iou(piece.outline, np.array(s.exterior.coords)) for s in (low, high)) >= 0.8


def test_one_piece_that_two_objects_may_be_is_doubtful() -> None:
    # Either end shows one of them alone on one strip: a convex hull explains all.
    low = Polygon([(42.0, 28), (58, 9), (65, 12), (77.8, 16.3), (62.4, 42.7)])
    high = Polygon([(44.8, 71.4), (58.4, 62.1), (75.0, 71.0), (74.2, 80.2), (65.1, 86.1)])
    sensor = ts.Sensor(construction="crs-crs", strips=40, pitch_mm=2.5, length_mm=100.0)
    (one,) = ts.pieces(_scan(low, high, sensor=sensor), sensor, NOISE)
    assert one.status == "doubtful"
    assert "two objects" in one.advice
    (whole,) = ts.pieces(_scan(LOW, sensor=sensor), sensor, NOISE)
    assert whole.status == "ok"


def test_one_piece_is_two_objects_as_probably_as_the_polygon_fit_says() -> None:
    """Both lie on the same strips, but for one that the lower one reaches further."""
    sensor = ts.Sensor(construction="crs-crs", strips=10, pitch_mm=7.0, length_mm=120.0)
    low = Polygon([(10, 15), (60, 20), (55, 40), (15, 38)])
    high = Polygon([(12, 65), (58, 62), (60, 95), (14, 100)])
    noise = ts.Noise(positional=0.003)
    scan = _scan(low, high, sensor=sensor, noise=noise)
    fitted = ts.fit_polygon(scan, sensor, noise).objects[0]
    found = ts.reconstruct(scan, sensor, noise, method="pieces").objects
    assert [p.status for p in found] == ["doubtful"]
    assert found[0].alternatives[0].weight == pytest.approx(fitted.alternatives[0].weight, abs=0.1)
    assert "two objects on the same strips" in found[0].advice


def test_the_covariance_covers_what_is_seen_and_says_nothing_of_what_is_hidden() -> None:
    score = []
    for seed in range(12):
        for piece in ts.pieces(_scan(LOW, HIGH, rng=seed), SENSOR, NOISE):
            unseen = np.repeat(piece.hidden, 2)
            assert piece.covariance is not None
            assert np.isnan(piece.covariance[unseen]).all()
            corners = shapely.get_coordinates(_nearest(piece, (LOW, HIGH)))[:-1]
            inner = ~piece.hidden & (abs(piece.outline[:, 0] - piece.outline[:, 0].min()) > 2.0)
            inner &= abs(piece.outline[:, 0] - piece.outline[:, 0].max()) > 2.0
            for i in np.flatnonzero(inner):
                off = (piece.outline[i] - corners)[np.hypot(*(piece.outline[i] - corners).T).argmin()]
                own = piece.covariance[2 * i : 2 * i + 2, 2 * i : 2 * i + 2]
                score.append(off @ np.linalg.solve(own, off))
    # Of two numbers chi square is below 5.99 in 95 of 100 cases.
    assert np.mean(np.array(score) < 5.99) > 0.85


def test_runs_apart_are_pieces_of_their_own_and_seen_whole() -> None:
    right = shapely.affinity.translate(MIDDLE, 5.0, 30.0)
    found = ts.pieces(_scan(shapely.affinity.translate(LOW, -15.0), right), SENSOR, NOISE)
    assert [p.status for p in found] == ["ok", "ok"]
    assert not any(p.hidden.any() or p.joined or p.advice for p in found)
    assert ts.pieces(_scan(Polygon([(0, 0), (0.1, 0), (0.1, 1)])), SENSOR) == []


def test_hidden_on_all_its_strips_nothing_tells() -> None:
    inside = Polygon([(45, 42), (52, 42), (50, 46)])
    one, two = (ts.pieces(_scan(LOW, HIGH, *more), SENSOR, NOISE) for more in ((), (inside,)))
    assert len(one) == len(two) == 2
    assert np.array_equal(one[0].outline, two[0].outline)


def test_a_notch_is_one_object_of_two_pieces_that_meet_and_stays_ok() -> None:
    notch = Polygon([(20, 40), (35, 15), (50, 32), (66, 14), (80, 40), (50, 80)])
    found = ts.pieces(_scan(notch), SENSOR, NOISE)
    assert len(found) == 2
    assert found[0].joined == (1,)
    assert "meet: one concave object" in found[0].advice
    assert ts.fit_polygon(_scan(notch), SENSOR, NOISE, assessment="fast").status in ("ok", "likely")


def test_the_alarm_of_the_fit_names_the_pieces() -> None:
    found = ts.fit_polygon(_scan(LOW, HIGH), SENSOR, NOISE, assessment="fast").objects[0]
    assert found.status == "doubtful"
    assert "at least 2 convex pieces" in found.advice


def test_a_faulty_channel_is_no_piece() -> None:
    scan = _scan(LOW, HIGH)
    kl = scan["kl"].copy()
    kl[50] = 0.9
    found = ts.pieces(ts.Scan(kh=scan["kh"], kl=kl), SENSOR, NOISE)
    assert len(found) == 2
    assert any("strip 50 fits none of its neighbours" in p.advice for p in found)
    assert {p.status for p in found} == {"doubtful"}


@pytest.mark.parametrize(
    ("options", "count"),
    [
        ({"strip_width_mm": 0.8}, 2),  # the outer strips of a piece are covered in part
        ({"contact_lambda_mm": 2.0, "resistivity_ratio": 1.4}, 2),
        ({"without": ("45:v_l", "45:v_h")}, 2),
    ],
)
def test_wide_strips_soft_contacts_and_channels_left_out(options: dict[str, object], count: int) -> None:
    sensor = ts.Sensor(construction="crs-crs", strips=100, pitch_mm=1.0, length_mm=100.0, **options)  # type: ignore[arg-type]
    assert len(ts.pieces(_scan(LOW, HIGH, sensor=sensor), sensor, NOISE)) == count


def test_one_signature_gives_runs_and_doubts_jumps() -> None:
    metal = ts.Sensor(construction="crs-m", strips=100, pitch_mm=1.0, length_mm=100.0)
    (piece,) = ts.pieces(_scan(LOW, HIGH, sensor=metal), metal, NOISE)
    assert piece.status == "doubtful"
    assert "k jumps before strip" in piece.advice
    (piece,) = ts.pieces(_scan(LOW, sensor=metal), metal, NOISE)
    assert "jumps" not in piece.advice
    assert piece.status in ("likely", "doubtful")
    sheet = ts.Sensor(
        construction="crs-crp", strips=10, pitch_mm=10.0, length_mm=100.0, contact_lambda_mm=3.0
    )
    with pytest.raises(ts.TacstripError, match="closed form"):
        ts.pieces(ts.Scan(kh=np.full(10, 0.5), kl=np.full(10, 0.4)), sheet)


def test_every_door_hands_on_what_is_hidden() -> None:
    scan = _scan(LOW, HIGH)
    result = ts.reconstruct(scan, SENSOR, NOISE, method="pieces")
    for thing, piece in zip(result.objects, ts.pieces(scan, SENSOR, NOISE), strict=True):
        assert np.array_equal(thing.vertices, piece.outline)
        assert thing.deviations is None  # of what is hidden nothing is known
        assert thing.hidden_edges is not None
        # Both edges of a corner that nothing shows are hidden.
        hidden = np.flatnonzero(piece.hidden & np.roll(piece.hidden_edges, 1))
        assert piece.hidden_edges[hidden].any()
    properties = feature_collection([result])["features"][0]["properties"]
    assert properties["hidden"] == result.objects[0].hidden.tolist()  # type: ignore[union-attr]
    sigmas = properties["vertex_sigma_mm"]
    assert [None in sigma for sigma in sigmas] == properties["hidden"]
    assert {"hidden_edges", "smallest_mm", "largest_mm"} <= set(properties)
    figure = reconstruction_figure(SENSOR, [scan], {"pieces": [result]})
    styles = [line.get_linestyle() for line in figure.axes[0].lines]
    assert {"-", "--", ":"} <= set(styles)
    assert "hidden behind another piece" in legend_of(figure)
    live = LiveObject(1, result.objects[0])
    drawn = frame_json(Frame(0, encode(scan, SENSOR), SENSOR, scan, (live,), 0.0, 0.0))["objects"][0]
    assert drawn["hidden_edges"] == result.objects[0].hidden_edges.tolist()  # type: ignore[union-attr]
    assert len(drawn["bounds"]) == 2


def test_lines_and_cuts_of_a_chain() -> None:
    x = np.arange(40.0)
    y = np.where(x < 15, 60.0 - x, np.where(x < 28, 30.0 + 0.5 * x, 70.0 - 0.2 * x))
    assert straight_lines(x, y, np.full(40, 100.0)).tolist() == [0, 15, 28, 40]
    chain = split_chain(x, y, np.full(40, 0.1), 1.0)
    assert [(s.start, s.stop) for s in chain.stretches] == [(0, 15), (15, 28), (28, 40)]
    cuts = [s.before for s in chain.stretches[1:]]
    assert [c.kind for c in cuts if c is not None] == ["begins", "ends"]
    y[20] += 8.0
    chain = split_chain(x, y, np.full(40, 0.1), 1.0)
    assert np.flatnonzero(chain.left_out).tolist() == [20]
    assert len(chain.stretches) == 3


def test_a_contact_on_one_strip() -> None:
    sensor = ts.Sensor(construction="crs-crs", strips=10, pitch_mm=10.0, length_mm=100.0)
    scan = ts.simulate(sensor, ts.Contact.polygon([(45, 30), (47, 30), (47, 60), (45, 60)]))
    assert scan.touched.sum() == 1
    (one,) = ts.pieces(scan, sensor, ts.Noise(positional=0.005))
    assert one.status != "ok"
