"""The public pictures: Axes in, Axes out, nothing global, and no text over another, whatever there is to draw."""

from __future__ import annotations

import functools
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import tacstrip as ts
from drawn import check_texts, draw
from tacstrip import plot
from tacstrip.calibrate.unit import Calibrated
from tacstrip.design.limits import limit_map, limits, outline_of
from tacstrip.diagnose import FAULTS, Finding, Log, Question, Report
from tacstrip.diagnose.faults import Quality
from tacstrip.plot.bounds import limits_figure
from tacstrip.plot.layers import layers_figure
from tacstrip.plot.results import reconstruction_figure
from tacstrip.plot.skins import press_figure
from tacstrip.plot.strip_health import health_figure
from tacstrip.plot.tracks import track_figure
from tacstrip.reconstruction.result import Reconstruction, RecoveredObject

NAN = float("nan")
SQUARE = np.array([(30.0, 40.0), (60.0, 35.0), (70.0, 60.0), (40.0, 70.0)])
NOISE = ts.Noise(positional=0.005)


def _sensor(strips: int, **keys: Any) -> ts.Sensor:
    return ts.Sensor(construction="crs-crs", strips=strips, pitch_mm=100.0 / strips, length_mm=100.0, **keys)


SENSOR = _sensor(20, strip_base=1)
LAYERS = ts.LayeredSensor.crossed(SENSOR)
SENSORS = {
    "one strip": _sensor(1),
    "twenty": SENSOR,
    "a thousand": _sensor(1000),
    "narrow": ts.Sensor.load("prototype-crs-crs"),
    "wide": ts.Sensor(construction="crs-m", strips=60, pitch_mm=5.0, length_mm=60.0, strip_base=1),
    "tube": ts.Sensor.load("prototype-cyl-crs-m"),
    "fingertip": ts.Sensor.load("fingertip"),
}


def _found(status: str = "ok", shift: float = 0.0, spread: float = 1.0) -> Reconstruction:
    covariance = np.eye(8) * spread**2
    one = RecoveredObject(slice(6, 14), SQUARE + np.array([shift, 0.0]), None, covariance, status)  # type: ignore[arg-type]
    return Reconstruction("polygon", (one,), time_s=0.1 * shift)


def _report(strips: int, faults: dict[str, tuple[int, ...]]) -> Report:
    quality = Quality(NAN, np.full(strips, NAN), NAN, "", NAN, steady=False)
    findings = tuple(Finding(name, where, "measured") for name, where in faults.items())
    return Report(findings, (), (), (), quality, np.ones(strips, dtype=np.int64), 1.0, 10, 1)


def _asked() -> Report:
    every = _report(6, {"stuck": (1,), "hum": (2,)})
    return replace(
        every, questions=(Question((3,), ("stuck",), "read"),), touched_scans=np.array([1, 1, 1, 1, 1, 0])
    )


def _track(number: int) -> ts.Track:
    poses = np.array([(20.0 + 5.0 * i, 30.0 + 8.0 * number, 0.1 * i) for i in range(8)] + [(NAN,) * 3])
    times = np.linspace(0.0, 0.8, len(poses))
    outline = 0.3 * (SQUARE - SQUARE.mean(axis=0))
    return ts.Track(number, outline, np.eye(8), poses, np.zeros((9, 3, 3)), times, 0.0 * poses, "ok")


def _calibrated(strips: int) -> Calibrated:
    sensor = _sensor(strips, strip_base=1)
    l_mm = np.repeat([[20.0], [50.0], [80.0]], strips, axis=1)
    error = 0.0005 * np.array([[1.0], [0.0], [-1.0]]) * (1.0 + np.arange(strips) / strips)
    raw = {name: k + error + 0.02 for name, k in ts.signatures(sensor, l_mm, l_mm).items()}
    lines = np.arange(2, 2 + l_mm.size).reshape(l_mm.shape)
    return ts.calibrate_unit(sensor, ts.Runs(l_mm, 0.0 * l_mm, raw, lines, {}), model="mean")


def _read(sensor: ts.Sensor, k: float = 0.5) -> ts.Scan:
    read: dict[str, Any] = {name: np.full(sensor.strips, k) for name in sensor.signatures}
    return ts.Scan(**read)


@functools.cache
def _patch() -> ts.Patch:
    return ts.press(SENSORS["fingertip"], ts.Solid.sphere(4.0).at((20, 0, 20), (-1, 0, -1)), depth_mm=1.0)


PICTURES: dict[str, Callable[[], Axes | tuple[Axes, ...]]] = {
    **{f"sensor: {name}": functools.partial(plot.sensor, SENSORS[name])
       for name in ("one strip", "a thousand", "narrow", "tube", "fingertip")},
    "a strip alone": lambda: plot.scan(_read(SENSORS["one strip"]), SENSORS["one strip"]),
    "a thousand strips": lambda: plot.scan(_read(SENSORS["a thousand"]), SENSORS["a thousand"]),
    "sensor of two layers": lambda: plot.sensor(LAYERS),
    "contact": lambda: plot.contact(ts.Contact.polygon(SQUARE), SENSOR),
    "contact alone": lambda: plot.contact(ts.Contact.points([(3, 3)])),
    "untouched": lambda: plot.scan(_read(SENSOR, NAN), SENSOR),
    "a thousand scans": lambda: plot.scan([_read(SENSOR)] * 1000, SENSOR),
    "result": lambda: plot.result(_found(), SENSOR, truth=ts.Contact.polygon(SQUARE)),
    "doubtful, on a narrow one": lambda: plot.result(_found("doubtful", -20.0), SENSORS["narrow"]),
    "no result": lambda: plot.result(Reconstruction("polygon", ()), SENSOR),
    "results": lambda: plot.result([_found(shift=0.03 * i) for i in range(1000)], SENSOR),
    "two layers": lambda: plot.result(_found(), LAYERS),
    "uncertainty": lambda: plot.uncertainty(_found(spread=0.01), SENSOR, truth=ts.Contact.polygon(SQUARE)),
    "no shape": lambda: plot.uncertainty(Reconstruction("polygon", ()), SENSOR),
    "film": lambda: plot.film_strip([_found(shift=0.03 * i) for i in range(1000)], SENSOR, most=3),
    "one frame": lambda: plot.film_strip([_found()], SENSOR, truth=ts.Contact.polygon(SQUARE)),
    "limits": lambda: plot.limits(SENSOR, ts.Contact.polygon(SQUARE), NOISE, grid=2),
    "calibration": lambda: plot.calibration(_calibrated(100)),
    "calibration of one strip": lambda: plot.calibration(_calibrated(1)),
    "healthy": lambda: plot.health(_report(3, {})),
    "all is wrong": lambda: plot.health(_report(1000, dict.fromkeys(FAULTS, (7, 500)))),
    "in question": lambda: plot.health(_asked()),
    "tracks": lambda: plot.track([_track(i) for i in range(1, 8)], SENSOR),
    "no tracks": lambda: plot.track([], SENSOR),
    "skin": lambda: plot.skin(SENSOR),
    "pressed": lambda: plot.skin(SENSORS["fingertip"], _patch()),
}  # fmt: skip


@pytest.mark.parametrize("name", PICTURES)
def test_axes_come_back_and_no_text_hides_another(name: str) -> None:
    before = dict(mpl.rcParams)
    axes = PICTURES[name]()
    axes = axes if isinstance(axes, tuple) else (axes,)
    assert all(isinstance(one, Axes) for one in axes)
    assert isinstance(axes[0].figure, Figure)
    check_texts(axes[0].figure)
    assert dict(mpl.rcParams) == before


def test_axes_of_ones_own_are_drawn_into_and_others_refused() -> None:
    figure = Figure()
    flat, space = figure.add_subplot(121), figure.add_subplot(122, projection="3d")
    assert plot.scan(_read(SENSOR), SENSOR, ax=flat) is flat
    assert plot.skin(SENSOR, ax=space) is space
    assert figure.axes == [flat, space]
    with pytest.raises(ts.ArgumentError, match="ax is a Figure, not Matplotlib's Axes; write fig, ax = plt"):
        plot.sensor(SENSOR, ax=figure)  # type: ignore[arg-type]
    with pytest.raises(ts.ArgumentError, match="ax is flat; write ax = "):
        plot.skin(SENSOR, ax=flat)
    with pytest.raises(ts.ArgumentError, match="contact: contact and sensor are exchanged"):
        plot.contact(SENSOR, ts.Contact.polygon(SQUARE))  # type: ignore[arg-type]
    with pytest.raises(ts.ArgumentError, match="magnify = 0: must be a number above 0"):
        plot.uncertainty(_found(), SENSOR, magnify=0)
    with pytest.raises(ts.ArgumentError, match="report is a Sensor, not a Report; write tacstrip"):
        plot.health(SENSOR)  # type: ignore[arg-type]
    with pytest.raises(ts.ReadingError, match="the scan has 20 strips and the sensor has 1"):
        plot.scan(_read(SENSOR), SENSORS["one strip"])


def test_limits_of_the_callers_axes_stay() -> None:
    sensor = ts.Sensor(construction="crs-crs", strips=10, pitch_mm=10.0, length_mm=100.0)
    contact = ts.Contact.polygon([(22, 18), (70, 34), (62, 72), (30, 66)])
    found = ts.reconstruct(ts.simulate(sensor, contact), sensor)
    axes = Figure().subplots()
    axes.set(xlim=(20.0, 50.0), ylim=(10.0, 40.0))
    plot.result(found, sensor, truth=contact, ax=axes)
    assert (axes.get_xlim(), axes.get_ylim()) == ((20.0, 50.0), (10.0, 40.0))


def test_nothing_is_cut_where_a_legend_stands_above() -> None:
    one = _track(1)
    figure = track_figure(SENSOR, [one])
    draw(figure)
    for axes, low, high in (
        (figure.axes[0], (0.0, 0.0), (SENSOR.width_mm, SENSOR.length_mm)),
        (figure.axes[1], one.outline.min(axis=0), one.outline.max(axis=0)),
    ):
        (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
        assert (x0 <= low[0], y0 <= low[1], x1 >= high[0], y1 >= high[1]) == (True,) * 4


def test_strips_have_the_numbers_that_files_give_them() -> None:
    for base in (0, 1):
        axes = plot.sensor(_sensor(4, strip_base=base))
        draw(axes.figure)  # type: ignore[arg-type]
        (top,) = axes.child_axes
        shown = [int(text.get_text()) for text in top.get_xticklabels()]
        assert shown == list(range(base, base + 4))
        assert top.get_xticks() == pytest.approx(shown)
        at = axes.transData.inverted().transform(top.transData.transform([(base, 0.0), (base + 3, 0.0)]))
        assert at[:, 0] == pytest.approx([12.5, 87.5], abs=0.01)


def test_a_style_ends_with_its_block() -> None:
    before = dict(mpl.rcParams)
    with plot.style("print"):
        printed = plot.scan(_read(SENSOR), SENSOR)
        assert mpl.rcParams["savefig.dpi"] == 300
    shown = plot.scan(_read(SENSOR), SENSOR)
    assert dict(mpl.rcParams) == before
    assert float(printed.xaxis.label.get_fontsize()) < float(shown.xaxis.label.get_fontsize())
    assert printed.figure.get_size_inches()[0] == pytest.approx(85.0 / 25.4, abs=0.01)  # type: ignore[union-attr]
    check_texts(printed.figure)  # type: ignore[arg-type]
    with (
        pytest.raises(ts.OptionError, match="style 'poster' does not exist; choose one of: screen, print"),
        plot.style("poster"),
    ):
        pass


def test_colours_differ_in_grey_or_by_marker() -> None:
    scan = plot.scan(_read(SENSOR), SENSOR)
    assert len({line.get_marker() for line in scan.lines}) == 2
    many = plot.scan(_read(SENSORS["a thousand"]), SENSORS["a thousand"])
    assert len({line.get_linestyle() for line in many.lines}) == 2
    found = Reconstruction("polygon", _found().objects + _found("doubtful", 20.0).objects)
    lines = [line for line in plot.result(found, SENSOR).lines if not str(line.get_label()).startswith("_")]
    assert [line.get_linestyle() for line in lines] == ["-", "--"]
    track = plot.track([_track(i) for i in range(1, 4)], SENSOR)
    assert len({line.get_marker() for line in track.lines if line.get_markersize() == 5.0}) == 3


def test_pyplot_is_left_alone() -> None:
    code = """
import sys, tacstrip as ts
assert "matplotlib" not in sys.modules
ts.plot.sensor(ts.Sensor.load("simulated-crs-m"))
assert "matplotlib.pyplot" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", code], check=True)


def _limits(sensor: ts.Sensor) -> Figure:
    outline = outline_of(sensor, ts.Contact.polygon(0.5 * SQUARE))
    return limits_figure(
        sensor, outline, limits(sensor, outline, NOISE), limit_map(sensor, outline, NOISE, 2, 2)
    )


def _healths() -> Figure:
    raw = {name: np.full((3, 1000), 0.5) for name in ("kh", "kl")}
    log = Log.of(SENSORS["a thousand"], np.arange(3.0), raw)
    return health_figure(log, _report(1000, dict.fromkeys(FAULTS, (7, 500))))


FIGURES: dict[str, Callable[[], Figure]] = {
    "methods": lambda: reconstruction_figure(
        SENSOR, [_read(SENSOR)], {"polygon": [_found("doubtful")], "profile": [_found("likely", 5.0)]},
        [ts.Contact.polygon(SQUARE)],
    ),
    "scans": lambda: reconstruction_figure(
        SENSOR, [_read(SENSOR)] * 40, {"polygon": [_found(shift=0.5 * i) for i in range(40)]}
    ),
    "a narrow film": lambda: reconstruction_figure(
        SENSORS["narrow"], [_read(SENSORS["narrow"])] * 6, {"polygon": [_found(shift=-20.0)] * 6}
    ),
    "nothing": lambda: reconstruction_figure(
        SENSOR, [_read(SENSOR, NAN)], {"polygon": [Reconstruction("polygon", ())]}
    ),
    "limits of a wide one": lambda: _limits(SENSORS["wide"]),
    "limits of a narrow one": lambda: _limits(SENSORS["narrow"]),
    "health": _healths,
    "tracks": lambda: track_figure(SENSOR, [_track(i) for i in range(1, 6)]),
    "press": lambda: press_figure(SENSORS["fingertip"], _patch()),
    "two layers": lambda: layers_figure(LAYERS, [_read(LAYERS.unit)], [_found()]),
}  # fmt: skip


@pytest.mark.parametrize("name", FIGURES)
def test_no_text_of_a_verb_s_picture_hides_another(name: str) -> None:
    check_texts(FIGURES[name]())
