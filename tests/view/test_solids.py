"""Solids that the page presses into the simulated fingertip."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.stream.codes import with_converter
from tacstrip.stream.simulated import SimulatedSource
from tacstrip.surface.skin import skin_of
from tacstrip.view.frame_json import sensor_json
from tacstrip.view.simulator import Settings, Simulator
from tacstrip.view.solids import Pressed

TIP = with_converter(ts.Sensor.load("fingertip"))
BALL: dict[str, Any] = {"solid": "sphere", "x_mm": 20.0, "y_mm": 6.0, "depth_mm": 1.0, "size_mm": 5.0}


def test_what_is_placed_is_pressed_read_and_drawn() -> None:
    simulator = Simulator(Settings(TIP, 100.0, ts.Noise()))
    (first,) = simulator.truth
    assert first["solid"] == "cylinder"
    pen = BALL | {"solid": "cylinder", "x_mm": 61.0, "turn_deg": 80.0}  # across the seam
    simulator.place([BALL, pen])
    ball, over = simulator.truth
    assert len(ball["rings"]) == 1 < len(over["rings"])
    right = Pressed.of(BALL).press(TIP)
    assert ball["area_mm2"] == pytest.approx(right.area_mm2, abs=0.01)
    middle = np.mean(ball["rings"][0], axis=0)
    assert middle.tolist() == pytest.approx([20.0, 6.0], abs=0.4)
    alone = simulator.truth[0]
    simulator.place([BALL])
    raw, again = itertools.islice(SimulatedSource(TIP, simulator._now, 100.0, ahead=4), 2)
    ideal = ts.simulate(TIP, right)
    for name in ("kh", "kl"):
        np.testing.assert_allclose(raw.codes[name] / 65535, np.nan_to_num(ideal[name], nan=0.0), atol=1e-4)
        np.testing.assert_array_equal(raw.codes[name], again.codes[name])
    simulator.place([BALL | {"solid": "cone"}])
    assert [len(line) for line in simulator.truth[0]["lines"]] == [25, 2, 2, 2, 2]
    simulator.place([])
    assert simulator.truth == []
    assert alone["lines"]
    simulator.place([BALL])
    assert simulator.change({"strips": 24}) is True
    now = simulator.settings.sensor
    assert isinstance(now, ts.Sensor)
    assert (now.strips, now.surface) == (24, TIP.surface)
    assert len(simulator.truth) == 1


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"solid": "wedge"}, "solid 'wedge' does not exist"),
        ({"x_mm": float("nan")}, "x_mm = nan: must be a number"),
        ({"depth_mm": True}, "depth_mm = True: must be a number"),
        ({"depth_mm": 9.0}, "the object sinks .* a skin of 3 mm: press less"),
        ({"depth_mm": 0.0}, "depth_mm = 0.0: must be above 0"),
        ({"size_mm": -1.0}, "radius_mm = -1.0: must be above 0"),
        ({"colour": 1}, "a solid has solid, x_mm"),
    ],
)
def test_what_cannot_be_pressed_changes_nothing(change: dict[str, Any], words: str) -> None:
    simulator = Simulator(Settings(TIP, 100.0), [BALL])
    with pytest.raises(ts.TacstripError, match=words):
        simulator.place([BALL | change])
    assert simulator.objects == [Pressed(**BALL)]
    for wrong in ("cyl-crs-m", "crs-crp"):
        with pytest.raises(ts.OptionError, match=rf"construction = {wrong}: the skin has a \[surface\]"):
            simulator.change({"construction": wrong})


def test_the_page_is_told_where_the_skin_is_in_space() -> None:
    about = sensor_json(TIP)
    points, skin = np.array(about["skin"]["points"]), skin_of(TIP)
    np.testing.assert_allclose(np.linalg.norm(points, axis=2), 10.0, atol=0.02)
    rows = np.linspace(0.0, TIP.length_mm, points.shape[1])
    np.testing.assert_allclose(points[0], skin.points(*skin.places(np.array(-0.5), rows)), atol=0.01)
    aside, up = points[1, 1] - points[0, 1], points[0, 2] - points[0, 1]
    assert about["skin"]["outward"] * (np.cross(aside, up) @ points[0, 1]) > 0.0
    assert "sphere" in about["presses"]
    flat = sensor_json(ts.Sensor(construction="crs-crs", strips=4, pitch_mm=1.0, length_mm=9.0))
    assert (flat["skin"], flat["presses"]) == (None, None)
