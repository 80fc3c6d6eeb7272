"""The [noise] table of a spec."""

from __future__ import annotations

from pathlib import Path

import pytest

import tacstrip as ts
from tacstrip.errors import SpecError
from tacstrip.sensor.spec import with_noise

NOISE = ts.Noise(
    white=0.0066, wander=(0.001, 0.002), wander_s=(5.0, 600.0), wander_shared=0.1, distribution="normal"
)
SENSOR = ts.Sensor(construction="crs-crs", strips=4, pitch_mm=5.0, length_mm=100.0, noise=NOISE)


def test_a_spec_keeps_its_noise(tmp_path: Path) -> None:
    SENSOR.save(tmp_path / "sensor.toml")
    assert ts.Sensor.load(tmp_path / "sensor.toml") == SENSOR
    assert "noise known" in repr(SENSOR)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("[noise]\nwhyte = 0.1\n", "unknown key 'whyte' in [noise]; the keys are: quantisation, positional"),
        ("[noise]\nwhite = -0.1\n", "noise.white = -0.1: must be 0 or more"),
        ('[noise]\nwhite = "0.1"\n', "noise.white = '0.1': must be 0 or more"),
        ("noise = 3\n", "noise: must be a table"),
    ],
)
def test_a_wrong_table_gets_a_sentence(tmp_path: Path, table: str, message: str) -> None:
    text = ts.Sensor(construction="crs-crs", strips=4, pitch_mm=5.0, length_mm=100.0).to_toml()
    (tmp_path / "sensor.toml").write_text(text + table)
    with pytest.raises(SpecError) as caught:
        ts.Sensor.load(tmp_path / "sensor.toml")
    assert message in str(caught.value)


def test_the_table_is_exchanged_and_all_else_stays() -> None:
    plain = "# mine\n" + ts.Sensor(construction="crs-crs", strips=4, pitch_mm=5.0, length_mm=100.0).to_toml()
    once = with_noise(plain, NOISE)
    assert once.startswith(plain.rstrip())
    between = once + '\n[calibration]\nmade = "today [noise]"\n'
    again = with_noise(between, ts.Noise(white=0.003))
    assert again.count("[noise]\n") == 1
    assert '[calibration]\nmade = "today [noise]"' in again
    assert "0.0066" not in again
    with pytest.raises(SpecError, match="by hand"):
        with_noise(plain.replace("# mine\n", "noise = {white = 0.1}\n"), NOISE)
    with pytest.raises(SpecError, match="readable"):
        with_noise("construction = ", NOISE)
