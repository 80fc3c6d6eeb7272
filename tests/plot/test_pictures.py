"""Pictures of reconstructions: what they say, and that nothing hides behind something else."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

import tacstrip as ts
from drawn import check_above, draw, legend_of
from recordings import sensor
from tacstrip import plot
from tacstrip.design.limits import ErrorMap, Limit
from tacstrip.geometry.outline import Outline
from tacstrip.plot.bounds import limits_figure
from tacstrip.plot.results import reconstruction_figure
from tacstrip.plot.theme import legend_above, new_axes
from tacstrip.reconstruction.profile import profile_reconstruction
from tacstrip.reconstruction.result import Reconstruction, RecoveredObject

SENSOR = ts.Sensor(construction="crs-crs", strips=24, pitch_mm=4.0, length_mm=120.0)
TRIANGLE = np.array([(20.0, 30.0), (70.0, 40.0), (45.0, 90.0)])
SMALL = np.array([(20.0, 20.0), (36.0, 24.0), (28.0, 40.0)])


def _scan(sensor: ts.Sensor, *corners: np.ndarray) -> ts.Scan:
    return ts.simulate(sensor, ts.Contact(tuple(ts.Contact.polygon(c).shapes[0] for c in corners)))


def _found(corners: np.ndarray, status: str = "ok", spread: float | None = None) -> RecoveredObject:
    covariance = None if spread is None else np.eye(2 * len(corners)) * spread**2
    return RecoveredObject(slice(3, 9), corners, None, covariance, status)  # type: ignore[arg-type]


def _titles(figure: Figure) -> list[str]:
    return [axes.get_title() for axes in figure.axes]


def test_objects_are_told_apart() -> None:
    right = SMALL + np.array([50.0, 10.0])
    result = Reconstruction("polygon", (_found(SMALL, spread=1.0), _found(right, "doubtful", 1.0)))
    figure = reconstruction_figure(SENSOR, [_scan(SENSOR, SMALL, right)], {"polygon": [result]})
    assert legend_of(figure) == ["polygon 1: ok", "polygon 2: doubtful", "95 % region of a corner"]
    axes = figure.axes[0]
    assert [t.get_text() for t in axes.texts] == ["1", "2"]
    first, second = (line for line in axes.lines if not str(line.get_label()).startswith("_"))
    assert first.get_linestyle() == "-"
    assert second.get_linestyle() == "--"
    assert first.get_color() != second.get_color()
    assert second.get_markerfacecolor() == "white"


def test_one_object_needs_no_number() -> None:
    result = Reconstruction("polygon", (_found(SMALL),))
    figure = reconstruction_figure(SENSOR, [_scan(SENSOR, SMALL)], {"polygon": [result]})
    assert legend_of(figure) == ["polygon: ok"]
    assert not figure.axes[0].texts


def test_what_failed_is_drawn_as_wide_as_its_strips() -> None:
    failed = RecoveredObject(slice(5, 6), status="too few strips")
    figure = reconstruction_figure(
        SENSOR, [_scan(SENSOR, SMALL)], {"vertex": [Reconstruction("vertex", (failed,))]}
    )
    assert legend_of(figure) == ["vertex: too few strips"]
    band = figure.axes[0].patches[-1].get_extents().transformed(figure.axes[0].transData.inverted())
    assert band.width == pytest.approx(4.0)


def test_a_closer_view_only_where_it_is_closer() -> None:
    for corners, titles in ((SMALL, ["sensor", "shapes"]), (TRIANGLE, ["shapes"])):
        result = Reconstruction("polygon", (_found(corners),))
        figure = reconstruction_figure(SENSOR, [_scan(SENSOR, corners)], {"polygon": [result]})
        assert _titles(figure) == [*titles, "readings"]


def test_regions_end_with_the_sensor() -> None:
    result = Reconstruction("polygon", (_found(SMALL, spread=1000.0),))
    figure = reconstruction_figure(SENSOR, [_scan(SENSOR, SMALL)], {"polygon": [result]})
    for axes in figure.axes[:2]:
        regions = [p for p in axes.patches if isinstance(p, Polygon)]
        assert len(regions) == 3
        for region in regions:
            assert (region.get_xy() >= 0.0).all()
            assert (region.get_xy() <= (SENSOR.width_mm, SENSOR.length_mm)).all()
            assert to_rgba(region.get_edgecolor())[3] == 0.0  # its edge would be a ray across the sensor
    draw(figure)
    assert {axes.get_position().height > 0.3 for axes in figure.axes} == {True}


def test_many_scans_are_a_film_strip_of_some() -> None:
    many, result = 1000, Reconstruction("polygon", (_found(SMALL, spread=1.0),))
    scan = _scan(SENSOR, SMALL)
    results = {"polygon": [result] * many}
    start = time.process_time()
    figure = reconstruction_figure(SENSOR, [scan] * many, results)
    assert time.process_time() - start < 3.0
    assert figure.get_suptitle() == "shapes of 12 of 1000 scans"
    *frames, readings = _titles(figure)
    assert (len(frames), frames[0], frames[-1]) == (12, "scan 0", "scan 999")
    assert readings == "readings of 6 of 1000 scans"
    assert np.ptp(np.diff([int(n.removeprefix("scan ")) for n in frames])) <= 1
    assert legend_of(figure) == ["polygon: ok", "95 % region of a corner"]
    nothing = replace(scan, kh=np.full(24, np.nan), kl=np.full(24, np.nan))
    half = reconstruction_figure(
        SENSOR, [scan, nothing] * 20, {"polygon": [result, Reconstruction("polygon", ())] * 20}
    )
    assert half.get_suptitle() == "shapes of 12 of 20 scans in contact"


def test_places_of_a_drag_without_results() -> None:
    contacts = [ts.Contact.polygon(SMALL + i) for i in range(30)]
    figure = reconstruction_figure(SENSOR, [ts.simulate(SENSOR, c) for c in contacts], {}, contacts)
    assert legend_of(figure) == ["true shape"]
    assert [len(axes.lines) for axes in figure.axes[:-1]] == [1] * 12


def test_x_runs_along_the_arc_of_a_tube() -> None:
    tube = sensor("cyl-crs-m")
    corners = SMALL - 10.0
    scan = _scan(tube, corners)
    figure = reconstruction_figure(tube, [scan], {"polygon": [Reconstruction("polygon", (_found(corners),))]})
    assert {axes.get_xlabel() for axes in figure.axes} == {"arc length x [mm]"}


def test_a_legend_lies_above_the_data() -> None:
    for result in ({}, {"profile": [profile_reconstruction(_scan(SENSOR, TRIANGLE), SENSOR)]}):
        figure = reconstruction_figure(SENSOR, [_scan(SENSOR, TRIANGLE)], result)
        check_above(figure)
    figure, axes = new_axes(3.6, 3.0)
    for i in range(6):
        axes.plot([0, 1], [i, 5.0], label=f"a label of some length {i}")
    legend_above(axes)
    check_above(figure)


def test_the_colour_bar_of_limits_reads_plain_numbers() -> None:
    outline = Outline(TRIANGLE[[0, 1]], TRIANGLE[[0, 2, 1]])
    for low, high in ((0.30, 0.34), (0.3, 40.0)):
        over = ErrorMap(
            np.array([20.0, 40.0]), np.array([30.0, 50.0]), np.array([[low, high], [low, high]]), np.zeros(2)
        )
        figure = limits_figure(SENSOR, outline, [Limit(("kh",), np.eye(6))], over)
        draw(figure)
        labels = [t.get_text() for t in figure.axes[-1].get_yticklabels()]
        shown = [float(text) for text in labels if text]
        assert len([v for v in shown if low <= v <= high]) >= 2


def test_an_object_keeps_its_colour_through_a_film() -> None:
    def at(x: float, y: float) -> RecoveredObject:
        return RecoveredObject(slice(0, 4), np.array([(x, y), (x + 8, y), (x, y + 8)]), None, None, "ok")

    ways = [
        ((10, 20), (70, 70)),
        ((30, 70), (40, 20)),
    ]  # the two change sides: counted from the left they swap
    sensor = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0)
    film = plot.film_strip([Reconstruction("pieces", (at(*a), at(*b))) for a, b in ways], sensor)
    outlines = [[one for one in axes.lines if len(np.asarray(one.get_ydata())) == 4] for axes in film]
    colours = [
        {float(np.asarray(one.get_ydata())[0]): one.get_color() for one in frame} for frame in outlines
    ]
    assert colours[0] == colours[1]
    assert len(set(colours[0].values())) == 2
