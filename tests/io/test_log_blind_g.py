"""What contradicts itself or jumps without a word is asked; forms that logs of other tools have are read."""

from __future__ import annotations

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.io.log_import.guess import propose
from tacstrip.io.log_import.jumps import jump_of_all
from tacstrip.io.log_import.questions import Unanswered
from tacstrip.io.log_import.text import of_text
from tacstrip.io.log_import.turns import turns

PAD = ts.Sensor(construction="crs-crs", strips=4, pitch_mm=6.0, length_mm=80.0, vref_volt=3.3, adc_bits=12)


def asked(text: str, sensor: ts.Sensor = PAD, **answers: str) -> dict[str, tuple[str, ...]]:
    """Return the keys of what is asked, and the answers that are offered."""
    with pytest.raises(Unanswered) as error:
        propose(of_text(text), sensor, answers)
    return {q.key: q.choices for q in error.value.questions}


def values(text: str, sensor: ts.Sensor = PAD, **answers: str) -> np.ndarray:
    """Return the readings, by scan, strip and channel."""
    return np.stack([s.values for s in propose(of_text(text), sensor, answers).scans])


def pressed(factor: float, drift: float, noise: float, note: str = "", seed: int = 1) -> str:
    """Return a log in volts of a press on two strips, all times a factor from scan 8 on."""
    rng = np.random.default_rng(seed)
    lines = ["t,h0,l0,h1,l1,h2,l2,h3,l3"]
    for n in range(16):
        v = np.array([1.31, 1.18, 1.75, 1.14]) + drift * n + noise * rng.standard_normal(4)
        v = v * (factor if n >= 8 else 1.0)
        lines += [note] if note and n == 8 else []
        lines.append(f"{0.05 * n:.2f},,," + ",".join(f"{x:.4f}" for x in v) + ",,")
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("factor", [1.0 / 3.3, 0.5, 2.4 / 1.5])
@pytest.mark.parametrize("note", ["", "# k", "# ok"])
@pytest.mark.parametrize("drift", [0.0, 0.002])
def test_all_readings_that_jump_by_one_factor_are_asked_of(factor: float, note: str, drift: float) -> None:
    text = pressed(factor, drift, 0.004, note)
    offered = asked(text)["part"]
    assert len(offered) == 3
    above, below = (values(text, part=part, unit="V") for part in offered[:2])
    assert len(above) == len(below) == 8
    assert np.nanmedian(below[0] / above[-1]) == pytest.approx(factor, rel=0.03)
    assert len(values(text, part="skip", unit="V")) == 16


def test_readings_that_move_are_no_jump() -> None:
    rng = np.random.default_rng(3)
    for _ in range(50):
        at = np.cumsum(rng.normal(0.0, 0.15, (20, 1, 1)), axis=0) + rng.uniform(0.5, 3.0, (1, 3, 2))
        scans = propose(of_text(pressed(1.0, 0.03, 0.01)), PAD, {"unit": "V"}).scans
        made = [type(scans[0])(0.1 * n, np.abs(v), n + 2) for n, v in enumerate(at)]
        assert jump_of_all(made, 3.3) == (0, 1.0)


def sensors(many: int, seed: int, noise: float) -> np.ndarray:
    """Return scans of sensors in turn, whose contacts move and meet."""
    rng = np.random.default_rng(seed)
    n = np.arange(8 * many)
    starts, speeds = rng.uniform(0.5, 1.0, many), rng.uniform(0.05, 0.12, many)
    at = np.where(n % many % 2, 3.5 - starts[n % many] - speeds[n % many] * n / many * 2, starts[n % many] + speeds[n % many] * n / many * 2)  # fmt: skip
    both = at[:, None, None] + np.array([[[0.3, 0.0], [0.5, 0.2]]])
    return np.asarray(both + noise * rng.standard_normal(both.shape))


@pytest.mark.parametrize("seed", range(12))
def test_sensors_in_turn_are_seen_though_both_contacts_move(seed: int) -> None:
    v = sensors(2, seed, 0.01)
    assert turns(v, 0.05 * np.arange(len(v))) == 2


@pytest.mark.parametrize("seed", range(40))
def test_one_contact_that_moves_is_no_two_sensors(seed: int) -> None:
    rng = np.random.default_rng(seed)
    steps = rng.normal(0.0, 0.1, (30, 1, 1))
    v = 2.0 + np.cumsum(np.cumsum(0.1 * steps, axis=0), axis=0) + rng.normal(0.0, 0.05, (30, 2, 2))
    assert turns(v, 0.05 * np.arange(30)) == 0
    assert turns(2.0 + np.cumsum(steps, axis=0) + np.zeros((30, 2, 2)), 0.05 * np.arange(30)) == 0


CODES = "t,strip,upper (mV),lower (mV)\n" + "".join(
    f"{0.02 * n:.2f},{s},{'' if s == 0 else 400 + 20 * n + 9 * s},{'' if s == 0 else 200 + 9 * n}\n"
    for n in range(6)
    for s in range(4)
)


@pytest.mark.parametrize(
    "said",
    [
        "analogRead() values, straight from the sketch",
        "raw ADC counts",
        "ADC values",
        "Rohwerte",
        "adc codes",
    ],
)
def test_a_unit_in_the_names_against_codes_in_words_is_asked(said: str) -> None:
    text = f"# {said}\n{CODES}"
    assert asked(text)["unit"] == ("mV", "code")
    assert propose(of_text(text), PAD, {"unit": "code"}).mapping.unit == "code"
    assert propose(of_text(text), PAD, {"unit": "mV"}).mapping.unit == "mV"


@pytest.mark.parametrize(
    "said", ["ADC values converted to mV", "12 bit ADC", "analogRead() * 3300 / 4095", "raw readings in mV"]
)
def test_codes_that_were_converted_are_no_contradiction(said: str) -> None:
    assert propose(of_text(f"# {said}\n{CODES}"), PAD).mapping.unit == "mV"
