"""An ellipse's outline is drawn with corners; its moments are the ellipse's own."""

import numpy as np
import pytest

import tacstrip as ts

SENSOR = ts.Sensor(construction="crs-crs", strips=100, pitch_mm=1.0, length_mm=100.0)


@pytest.mark.parametrize("ratio", [1.1, 1.6])
@pytest.mark.parametrize("angle", [-0.5, 0.9])
def test_the_drawn_outline_has_the_area_and_orientation_of_the_ellipse(ratio: float, angle: float) -> None:
    turn = np.linspace(0.0, 2.0 * np.pi, 2000, endpoint=False)
    a, b = 25.0 * np.sqrt(ratio) * np.cos(turn), 25.0 / np.sqrt(ratio) * np.sin(turn)
    rotation = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    contact = ts.Contact.polygon(np.stack([a, b], axis=1) @ rotation + 50.0)
    noise = ts.Noise(positional=1e-3)
    found = ts.fit_polygon(ts.simulate(SENSOR, contact), SENSOR, noise, bounded=False).objects[0]
    assert found.model is not None
    assert found.orientation == pytest.approx(angle, abs=1e-3)  # .012-.019 with corners moved in y alone
    assert found.area == pytest.approx(np.pi * 625.0, rel=1e-4)
    assert repr(found).startswith("<RecoveredObject: ok, ellipse, ")
    (record,) = ts.object_records([ts.Reconstruction("polygon", (found,))])
    assert (record["kind"], record["corners"]) == ("ellipse", None)
