"""What objects show of themselves in a notebook: well-formed, small, and never an error."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.notebook import Drawn

SENSOR = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0)
COIN = ts.Contact.polygon([(30, 40), (60, 35), (70, 60), (40, 70)], holes=[[(45, 50), (50, 50), (50, 55)]])
SCAN = ts.simulate(SENSOR, COIN)
FOUND = ts.profile_reconstruction(SCAN, SENSOR)
NAN = float("nan")
_TRACK = ts.Track(1, np.array([(0.0, 0.0), (9.0, 0.0), (0.0, 9.0)]), None, np.array([(20.0, 30.0, 0.0), (NAN,) * 3]),
                  np.zeros((2, 3, 3)), np.array([0.0, 0.1]), np.zeros((2, 3)), "ok")  # fmt: skip
SHOWN = {
    "sensor": (SENSOR, 1 + 20),
    "a thousand strips": (ts.Sensor.load("simulated-crs-crs"), 1),
    "two layers": (ts.LayeredSensor.crossed(SENSOR), 2 * (1 + 20)),
    "contact": (COIN + ts.Contact.points([(80, 80)]) + ts.Contact.line([(10, 80), (30, 90)]), 3),
    "scan": (SCAN, 1 + 2),
    "an untouched scan": (ts.Scan(k=np.full(3, NAN)), 1),
    "one strip": (ts.Scan(k=np.array([0.5])), 2),
    "scans": (ts.simulate_many(SENSOR, [COIN] * 20, ts.Noise(), rng=0), 1 + 6 * 2),
    "result": (FOUND, 1),
    "object": (FOUND.objects[0], 1),
    "track": (_TRACK, 2),
    "nothing": (ts.Reconstruction("profile", ()), 0),
}


@pytest.mark.parametrize("name", SHOWN)
def test_it_draws_itself(name: str) -> None:
    one, count = SHOWN[name]
    assert isinstance(one, Drawn)
    picture = ET.fromstring(str(one._repr_svg_()))
    assert len(picture.findall("{*}path")) == count
    assert picture.attrib["aria-label"] == repr(one)
    for path in picture.findall("{*}path"):
        assert "nan" not in path.attrib["d"]
    page = str(one._repr_html_())
    assert ET.fromstring(page.replace("<br>", "<br/>")).find("code").text == repr(one)  # type: ignore[union-attr]
    assert len(page) < 40_000


def test_what_cannot_be_drawn_shows_its_text(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(self: ts.Scan) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(ts.Scan, "_paths", fail)
    assert SCAN._repr_svg_() is None
    assert SCAN._repr_html_() is None
    assert repr(_TRACK) == "<Track 1: ok, 3 corners, 40.5 mm2, in 1 of 2 scans>"
