"""What contradicts itself or jumps without a word is asked; forms that logs of other tools have are read."""

from __future__ import annotations

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.io.log_import.guess import propose
from tacstrip.io.log_import.jumps import jump_of_all
from tacstrip.io.log_import.questions import Unanswered
from tacstrip.io.log_import.table import Table
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
    starts, speeds = rng.uniform(0.5, 1.0, many)[n % many], rng.uniform(0.1, 0.24, many)[n % many]
    way = starts + speeds * n / many
    at = np.where(n % many % 2, 3.5 - way, way)
    both = at[:, None, None] + np.array([[[0.3, 0.0], [0.5, 0.2]]])
    return np.asarray(both + noise * rng.standard_normal(both.shape))


@pytest.mark.parametrize("seed", range(12))
def test_sensors_in_turn_are_seen_though_both_contacts_move(seed: int) -> None:
    v = sensors(2, seed, 0.01)
    assert turns(v, np.linspace(0.0, 1.0, len(v))) == 2


@pytest.mark.parametrize("seed", range(40))
def test_one_contact_that_moves_is_no_two_sensors(seed: int) -> None:
    rng = np.random.default_rng(seed)
    steps = rng.normal(0.0, 0.1, (30, 1, 1))
    v = 2.0 + np.cumsum(np.cumsum(0.1 * steps, axis=0), axis=0) + rng.normal(0.0, 0.05, (30, 2, 2))
    assert turns(v, np.linspace(0.0, 1.0, 30)) == 0
    assert turns(2.0 + np.cumsum(steps, axis=0) + np.zeros((30, 2, 2)), np.linspace(0.0, 1.0, 30)) == 0


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


def strips(word: str, n: int, between: str, low: float = 0.0) -> str:
    """Return the lines of three scans in which each strip's number stands with their total."""
    lines = [
        f"{word} {s}{between}{n} open"
        if s == 1
        else f"{word} {s}{between}{n} hi {1400 + 50 * k + s} mV lo {800 + s} mV"
        for k in range(4)
        for s in range(1, n + 1)
    ]
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("key", ["n", "nr", "idx", "id", "number"])
@pytest.mark.parametrize("head", ["I ({ms}) skin: ", "", "[{ms}] "])
def test_the_number_within_records_of_strips_is_theirs(key: str, head: str) -> None:
    lines = ["# 4 strips, numbered 1..4"] + [
        head.format(ms=1000 + 20 * n)
        + f'{{"ms": {1000 + 20 * n}, "strips": ['
        + ", ".join(
            f'{{"{key}": {s}, "hi": {1300 + 30 * n + s}, "lo": {700 + s}}}' for s in (2, 3)[: 1 + (n > 3)]
        )
        + "]}"
        for n in range(8)
    ]
    text = "\n".join(lines) + "\n"
    v = values(text, unit="code")
    assert v.shape == (8, 4, 2)
    assert v[5, 1].tolist() == [1452.0, 702.0]
    assert v[5, 2].tolist() == [1453.0, 703.0]
    assert np.isnan(v[0, 2]).all()


def test_an_answer_may_name_the_last_part_of_one_column() -> None:
    rows = [[f"{20 * (n // 2)}", f"{n % 2}", "1300", "700"] for n in range(8)]
    table = Table(("ms", "pads.q", "pads.hi", "pads.lo"), rows, list(range(1, 9)))
    found = propose(table, PAD, {"unit": "code", "q": "strip", "missing": "untouched", "strip_base": "0"})
    assert found.mapping.strip == "pads.q"
    two = Table((*table.names, "other.q"), [[*row, "7"] for row in table.rows], table.lines)
    with pytest.raises(ts.OptionError, match="no column is called so"):
        propose(two, PAD, {"q": "strip"})


@pytest.mark.parametrize(
    "ends", ["oben_V unten_V", "haut bas", "top_mV bottom_mV", "gora dol", "upper lower"]
)
@pytest.mark.parametrize("empty", ["", "NaN", "-"])
@pytest.mark.parametrize("turned", [False, True])
def test_elements_without_readings_are_strips_that_nothing_touches(
    ends: str, empty: str, turned: bool
) -> None:
    first, second = ends.split()[::-1] if turned else ends.split()
    factor = 1000.0 if "mV" in ends else 1.0

    def of(n: int, s: int) -> tuple[float, float]:
        high, low = factor * (1.9 + 0.1 * n + 0.01 * s), factor * (1.0 + 0.1 * n)
        return (low, high) if turned else (high, low)

    rows = [
        f'<scan t_s="{0.1 * n:.1f}">'
        + "".join(
            f'<strip nr="{s}" {first}="{a if there else empty}" {second}="{b if there else empty}"/>'
            for s in range(1, 5)
            for there in [s in (2, 3) and n > 0]
            for a, b in [[f"{x:.3f}" for x in of(n, s)]]
        )
        + "</scan>"
        for n in range(5)
    ]
    v = values("<log>\n" + "\n".join(rows) + "\n</log>\n")
    assert v.shape == (5, 4, 2)
    assert np.isnan(v[0]).all()
    assert v[2, 2] == pytest.approx([factor * 2.13, factor * 1.2])


def test_a_temperature_with_decimal_commas_is_no_name_of_sensors() -> None:
    rows = [
        f"{0.5 * n:.1f};---;---;2,{n}1;1,{n}0;2,{n}5;1,{n}4;---;---;21,{n % 3}".replace(".", ",")
        for n in range(8)
    ]
    text = "t (s);S1o;S1u;S2o;S2u;S3o;S3u;S4o;S4u;Temp. [°C]\n" + "\n".join(rows) + "\n"
    assert values(text)[3, 1] == pytest.approx([2.31, 1.30])


@pytest.mark.parametrize("word", ["brak", "rien", "nada", "niente", "keine", "geen", "yok", "нет", "なし"])
def test_words_for_nothing_are_known_in_many_languages(word: str) -> None:
    pad = ts.Sensor(construction="crs-m", strips=4, pitch_mm=6.0, length_mm=80.0, vref_volt=3.3)
    rows = [
        f"{50 * n},{s},{word if s in (1, 4) else 1400 + 60 * n + s}" for n in range(6) for s in range(1, 5)
    ]
    v = values("time [ms],strip,v [mV]\n" + "\n".join(rows) + "\n", pad)
    assert np.isnan(v[:, [0, 3]]).all()
    assert v[1, 1, 0] == 1462.0


def test_other_words_in_a_reading_are_still_asked() -> None:
    pad = ts.Sensor(construction="crs-m", strips=4, pitch_mm=6.0, length_mm=80.0, vref_volt=3.3)
    rows = [f"{50 * n},{s},{'sat' if s == 1 else 1400 + 60 * n + s}" for n in range(6) for s in range(1, 5)]
    assert "untouched" in asked("time [ms],strip,v [mV]\n" + "\n".join(rows) + "\n", pad)


@pytest.mark.parametrize("form", ["## Press {n}: {what}", "# {what}", "== {what} =="])
def test_a_heading_above_each_scan_tells_no_change(form: str) -> None:
    highs = [[1.83, 1.63], [1.94, 2.24], [3.11, 2.80], [3.22, 3.01]]
    blocks = [
        form.format(n=n, what=what)
        + "\n\n| strip | upper end (V) | lower end (V) |\n|---|---|---|\n"
        + "".join(
            f"| {s} | {h:.2f} | {h - 0.5:.2f} |\n" if s in (2, 3) else f"| {s} | - | - |\n"
            for s, h in zip(range(1, 5), [0.0, *high, 0.0], strict=True)
        )
        for n, (what, high) in enumerate(zip(["coin", "pen cap", "thumb", "eraser"], highs, strict=True), 1)
    ]
    assert values("\n".join(blocks), rate_hz="50").shape == (4, 4, 2)
