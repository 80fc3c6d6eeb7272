from pathlib import Path

import numpy as np
import pytest

import tacstrip as ts
from polygons import SURE

SPEC = """format = 1
construction = "crs-crs"
adc_bits = 12
[[layer]]
strips = 8
pitch_mm = 5.0
length_mm = 40.0
[[layer]]
"""


def test_two_tables_give_a_sensor_whose_second_layer_lies_across_the_first(tmp_path: Path) -> None:
    file = tmp_path / "two.toml"
    file.write_text(SPEC)
    sensor = ts.Sensor.load(file)
    assert isinstance(sensor, ts.LayeredSensor)
    first, second = sensor.layers
    assert (second.sensor, second.angle_deg) == (first.sensor, 90.0)
    assert {tuple(c) for c in second.corners_mm.round(9)} == {tuple(c) for c in first.corners_mm.round(9)}
    np.testing.assert_allclose(
        second.to_whole(second.to_layer(first.corners_mm)), first.corners_mm, atol=1e-9
    )
    assert sensor.strips == sensor.unit.strips == 16
    assert sensor.unit.adc_bits == 12
    assert sensor.where(9) == "strip 1 of layer 1"
    sensor.save(file)
    assert ts.Sensor.load(file) == sensor
    assert ts.Sensor.load("layered-crs-crs").strips == 64


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ("vref_volt = 3.3", "layer 1: vref_volt = 3.3, and layer 0 has 5.0: one unit reads both"),
        ("angle_deg = 4", "its strips run along those of layer 0"),
        ("angle_deg = true", "angle_deg = True: must be a finite number"),
        ("x_mm = 500", "layer 1: x_mm and y_mm put it beside layer 0"),
        ("angle = 90", "layer 1: unknown key 'angle'; the keys are: construction,"),
        ("pitch_mm = -1", "layer 1: pitch_mm = -1.0: must be above 0"),
        ('construction = "crs-crp"', "layer 1:"),
        ("[[layer]]", "3 [[layer]] table(s): give two"),
        ("[noise]\nwhite = 0.1\n[calibration]", "unknown key 'calibration' beside [[layer]] tables"),
    ],
)
def test_impossible_layers_get_a_sentence(tmp_path: Path, more: str, says: str) -> None:
    file = tmp_path / "two.toml"
    file.write_text(SPEC + more + "\n")
    with pytest.raises(ts.SpecError) as caught:
        ts.Sensor.load(file)
    assert says in str(caught.value)
    assert str(file) in str(caught.value)


def test_what_takes_one_layer_says_so() -> None:
    sensor = ts.Sensor.load("layered-crs-crs")
    assert isinstance(sensor, ts.LayeredSensor)
    scan = ts.simulate(sensor, ts.Contact.polygon([(20, 30), (50, 30), (30, 60)]))
    with pytest.raises(ts.ArgumentError, match=r"fit_polygon: sensor is a LayeredSensor.*one layer"):
        ts.fit_polygon(scan, sensor)
    one, other = sensor.layers[0].sensor, scan.split(sensor)[0]
    assert ts.fit_polygon(other, one).status == SURE
