"""What words around the readings say in whichever language, and sensors that take turns: asked, or no question."""

from __future__ import annotations

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.io.log_import.guess import Proposal, propose
from tacstrip.io.log_import.questions import Unanswered
from tacstrip.io.log_import.text import of_text

PAD = ts.Sensor(construction="crs-crs", strips=3, pitch_mm=6.0, length_mm=80.0, vref_volt=5.0)
SCANS = range(10)


def log(*said: str, by: int = 1, step: float = 0.02) -> str:
    """Return a log in volts of as many boards in turn, with comments above it."""
    lines = [*said, "t,strip,high,low"]
    for n in SCANS:
        for board in range(by):
            high = 2.0 + 0.9 * board + 0.02 * n
            t = by * step * n + 0.004 * board if step > 0.05 else step * (by * n + board)
            lines += [f"{t:.3f},{s},{high + 0.1 * s:.3f},{high - 0.7:.3f}" for s in range(3)]
    return "\n".join(lines) + "\n"


def asked(text: str, **answers: str) -> dict[str, tuple[str, ...]]:
    """Return the keys of what is asked, and the answers that are offered."""
    with pytest.raises(Unanswered) as error:
        propose(of_text(text), PAD, answers)
    return {q.key: q.choices for q in error.value.questions}


def read(text: str, **answers: str) -> Proposal:
    """Return what the log is read as."""
    return propose(of_text(text), PAD, answers)


@pytest.mark.parametrize(
    "said",
    [
        "# Versorgung nachgemessen: 4,62 V (USB-Hub)", "# alimentation mesurée 4.62 V", "# zmierzono 4,62 V",
        "# 電源電圧 4.62V", "# alimentación: 4620 mV", "# Speisung 3,3 V", "// besleme 3.3V",
        "# volts were computed for a reference of 3.3 V, the board ran on 5 V", "# Vref = 5 V; readings assume 3.3 V",
        "# mit 3,3 V umgerechnet, das Board hat 5 V", "# 5 V pad, reference 2.5 V",
    ],
)  # fmt: skip
def test_volts_of_another_supply_are_asked(said: str) -> None:
    choices = asked(log(said))["vref_volt"]
    assert choices[1] == "5"
    assert read(log(said), vref_volt="5").mapping.vref_volt == 0.0
    assert read(log(said), vref_volt=choices[0]).mapping.vref_volt == float(choices[0])


@pytest.mark.parametrize(
    "said",
    [
        "# Vref = 5,00 V, USB 4,9 V", "# Akku 3,7 V", "# Bereich 10 V", "# threshold 4.2 V", "# 5 V, 21 C",
        "# +/- 0,5 mV", "# 0-10 V input", "# strip 4 V", "# resolution 4.88 mV",
        "# computed for 5 V", "# converted with Vref = 5.0 V, v_h up to 4.5 V", "# default threshold 0.05 V",
        "# v_h up to 4.5 V", "# readings reach 4.5 V", "# bis zu 4,5 V", "# V_H = 4.5 V at full press",
    ],
)  # fmt: skip
def test_other_volts_are_no_question(said: str) -> None:
    assert not read(log(said)).doubts


def test_a_usual_supply_without_a_word_of_it_is_a_doubt() -> None:
    assert any("3,3 V" in d for d in read(log("# Platine mit 3,3 V")).doubts)


@pytest.mark.parametrize(
    "said",
    [
        "# Spannungsteiler 1:2", "# partitore 1:2", "# diviseur de tension 1/2", "# dzielnik napięcia 1:2",
        "# 電圧は分圧抵抗(1/2)の後で測定", "# za odporem 1:2", "# 分压 1/2",
    ],
)  # fmt: skip
def test_a_ratio_is_asked_in_whichever_language(said: str) -> None:
    assert asked(log(said))["scale"] == ("1", "2")
    assert read(log(said), scale="2").mapping.scale == 2.0


@pytest.mark.parametrize("said", ["# Verstärkung 2", "# guadagno 2", "# 放大倍数 2", "# wzmocnienie 2"])
def test_a_gain_is_asked_in_whichever_language(said: str) -> None:
    assert asked(log(said))["scale"] == ("1", "0.5")


@pytest.mark.parametrize(
    "said", ["# Seite 1/2", "# Versuch 1:3", "# 第1/2回", "# i=1:6", "# 10:15:02", "# 1:1"]
)
def test_other_ratios_are_no_question(said: str) -> None:
    assert read(log(said)).mapping.scale == 1.0


@pytest.mark.parametrize(("many", "step"), [(2, 0.02), (2, 0.1), (3, 0.02), (3, 0.1)])
def test_sensors_in_turn_are_asked(many: int, step: float) -> None:
    text = log(by=many, step=step)
    assert asked(text)["turn"] == (*(f"{n + 1}/{many}" for n in range(many)), "all")
    for n in range(many):
        scans = read(text, turn=f"{n + 1}/{many}").scans
        assert [s.values[0, 0] for s in scans] == pytest.approx([2.0 + 0.9 * n + 0.02 * i for i in SCANS])
        assert scans[0].time_s == 0.0
    assert len(read(text, turn="all").scans) == many * len(SCANS)


@pytest.mark.parametrize("pause", [0.02, 0.1])
def test_sensors_in_turn_that_cross_are_told_by_their_times(pause: float) -> None:
    lines = ["t,strip,high,low"]
    for n in SCANS:
        for board, high in enumerate((2.0 + 0.2 * n, 4.0 - 0.2 * n)):
            t = n * pause + 0.004 * board
            lines += [f"{t:.3f},{s},{high + 0.1 * s:.3f},{high - 0.7:.3f}" for s in range(3)]
    assert "turn" in asked("\n".join(lines) + "\n")


def test_times_in_pairs_alone_are_no_turns() -> None:
    """A serial monitor stamps two lines at once where it reads these together."""
    lines = ["t,strip,high,low"]
    for n in range(16):
        t = 0.04 * (n // 2) + 0.001 * (n % 2)
        lines += [f"{t:.3f},{s},{2.0 + 0.05 * n + 0.1 * s:.3f},{1.0 + 0.04 * n:.3f}" for s in range(3)]
    assert len(read("\n".join(lines) + "\n").scans) == 16


def test_a_turn_that_is_none_is_refused() -> None:
    with pytest.raises(ts.OptionError, match="turn = '3/2'"):
        read(log(by=2), turn="3/2")


def test_noise_at_rest_is_no_turns() -> None:
    rng = np.random.default_rng(7)
    for _ in range(50):
        lines = ["t,strip,high,low"]
        for n in range(12):
            lines += [
                f"{0.02 * n:.3f},{s},{2 + rng.normal(0, 0.01):.3f},{1 + rng.normal(0, 0.01):.3f}"
                for s in range(3)
            ]
        assert len(read("\n".join(lines) + "\n").scans) == 12


def test_presses_and_the_pauses_between_them_are_no_turns() -> None:
    """One sensor that is touched in every other scan, or in two of four."""
    for many in (1, 2):
        rows = ["t,strip,v_h,v_l"]
        for n in range(24):
            high = f"{3.0 + 0.05 * n:.3f},{2.0 + 0.04 * n:.3f}" if n // many % 2 == 0 else ","
            rows += [f"{0.1 * n:.1f},{s},{high}" for s in range(3)]
        assert len(propose(of_text("\n".join(rows)), PAD).scans) == 24


def test_comments_that_come_again_after_a_restart_ask_nothing() -> None:
    head = "# Vref = 5.00\n# unit: V\n"
    rows = [
        f"{0.1 * n:.1f},{s},{3.0 + 0.02 * n:.3f},{2.0 + 0.01 * n:.3f}\n" for n in range(8) for s in range(3)
    ]
    text = head + "t,strip,v_h,v_l\n" + "".join(rows[:16]) + head + "".join(rows[16:])
    assert len(propose(of_text(text), PAD).scans) == 8


def _swinging(period: float, turns: bool = False) -> str:
    """Return a log of one object that swings with so many scans a period, or of sensors in turn, each with a drift."""
    rng = np.random.default_rng(3)
    lines = ["t,strip,high,low"]
    for n in range(40):
        places = (0.0, 0.5, -0.3, 0.4)[n % round(period)] + 0.002 * n
        at = places if turns else 0.5 * np.sin(2.0 * np.pi * n / period + 0.4)
        for s in range(3):
            high, low = (v + 0.1 * s + at + rng.normal(0.0, 0.003) for v in (3.0, 2.0))
            lines.append(f"{0.02 * n:.2f},{s},{high:.3f},{low:.3f}")
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("many", [2, 3, 4])
def test_sensors_in_turn_that_drift_are_asked_beside_swings(many: int) -> None:
    assert "turn" in asked(_swinging(many, turns=True))


@pytest.mark.parametrize(
    "said",
    [
        "# strip 0 is the rightmost", "# strips are numbered from right to left", "# Streifen von rechts gezählt",
        "# strip 2 = far left", "# bande 0 à droite", "# order: R -> L", "# pad mounted mirrored, strip 0 right",
    ],
)  # fmt: skip
def test_strips_from_the_right_are_asked_and_turned_round(said: str) -> None:
    assert asked(log(said))["strip_order"] == ("descending", "ascending")
    plain = np.stack([s.values for s in read(log()).scans])
    turned = np.stack([s.values for s in read(log(said), strip_order="descending").scans])
    np.testing.assert_array_equal(turned, plain[:, ::-1])


@pytest.mark.parametrize(
    "said",
    [
        "# strips from left to right", "# strip 2 at the right",
        "# pad of the right hand, 3 strips",
        "# strip 2 left open",        "# finger slid from right to left over the strips",
        "# h measured from the right end of the strip",
    ],
)  # fmt: skip
def test_what_says_nothing_of_the_strips_order_is_no_question(said: str) -> None:
    assert read(log(said)).mapping.strip_order == "ascending"


def test_a_column_that_counts_from_the_right_is_asked_about() -> None:
    assert "strip_order" in asked(log().replace("strip,", "strip_from_right,"))


def test_columns_as_many_as_those_of_the_one_end_are_asked_about() -> None:
    text = "".join(f"{0.02 * n:.2f}s R->L H:- 2.1 2.2 L:- 1.{n} 1.7\n" for n in SCANS)
    assert asked(text)["L H[0]"] == ("h", "skip")
    assert read(text, **{"L H[0]": "h"}).mapping.channels == ("h", "l")


@pytest.mark.parametrize(
    "text",
    [
        ",s0_V,s1_V,s2_V\n"
        + "".join(f"2026-11-24T09:41:{17 + n // 2}.{n % 2 * 5}00+01:00,1.{n},1.4,\n" for n in range(6)),
        "; Acquisition with 3/3 channels at 2 Hz\ns0_V,s1_V,s2_V\n"
        + "".join(f"1.{n},1.4,\n" for n in range(6)),
        "\u30b5\u30f3\u30d7\u30ea\u30f3\u30b0\u5468\u671f,500ms,\ns0_V,s1_V,s2_V\n"
        + "".join(f"1.{n},1.4,\n" for n in range(6)),
    ],
)
def test_times_without_a_name_and_rates_above(text: str) -> None:
    sensor = ts.Sensor(construction="crs-m", strips=3, pitch_mm=6.0, length_mm=80.0, vref_volt=5.0)
    read = propose(of_text(text), sensor, {})
    assert [s.time_s - read.scans[0].time_s for s in read.scans] == pytest.approx([0.5 * n for n in range(6)])


def test_a_comment_of_ranges_names_columns_in_runs() -> None:
    rows = "".join(f"{n}00 2{n}00 2{n}10 0 | 1{n}00 1{n}10 0\n" for n in range(1, 7))
    table = of_text(f"# pad fw 0.3 order: t, H0..H2 | L0..L2, 0 = open\n{rows}")
    assert table.names == ("t", "H0", "H1", "H2", "L0", "L1", "L2")
    assert table.rows[1] == ["200", "2200", "2210", "0", "1200", "1210", "0"]
