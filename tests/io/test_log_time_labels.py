"""Lines above blocks that say their time in whichever words: a number and a unit of time; heartbeats are none."""

from __future__ import annotations

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.io.log_import.guess import propose
from tacstrip.io.log_import.text import of_text

_SENSOR = ts.Sensor(construction="crs-crs", strips=3, pitch_mm=8.0, length_mm=60.0, vref_volt=5.0)
_MV = np.array([[[1500 + 50 * n + 30 * s, 900 + 40 * n + 20 * s] for s in range(3)] for n in range(5)])


@pytest.mark.parametrize("mark", [",", "."])
@pytest.mark.parametrize("names_again", [True, False])
@pytest.mark.parametrize(
    "label",
    [
        "Mesure n\u00b0 {n} \u00e0 t = {t} s", "Messung Nr. {n} bei t = {t} s", "Messung {n} nach {t} s",
        "pomiar {n} po {t} s", "Medida {n}: {t} s",
        "Medici\u00f3n n\u00ba {n} ({t} s)", "{t} s apr\u00e8s le d\u00e9but", "*** {t} s ***",
        "\u6e2c\u5b9a {n} \u56de\u76ee t = {t} s",
    ],
)  # fmt: skip
def test_a_label_with_a_time_in_words(label: str, names_again: bool, mark: str) -> None:
    text, names = "Relev\u00e9 du capteur\n\n", "strip;v_h (mV);v_l (mV)\n"
    for n in range(5):
        text += label.format(n=n + 1, t=f"{0.15 * n:.2f}".replace(".", mark)) + "\n"
        text += names * (names_again or not n)
        text += "".join(f"{s + 1};{high};{low}\n" for s, (high, low) in enumerate(_MV[n])) + "\n"
    found = propose(of_text(text), _SENSOR)
    np.testing.assert_allclose(np.stack([s.values for s in found.scans]), _MV)
    assert [s.time_s for s in found.scans] == pytest.approx([0.15 * n for n in range(5)], abs=1e-6)


@pytest.mark.parametrize("line", ["uptime {t} s", "late by {t} ms", "running since {t} s, ok", "cycle {t} s"])
@pytest.mark.parametrize("timed", [True, False])
def test_heartbeats_between_scans_are_no_times_of_these(line: str, timed: bool) -> None:
    rows = ["t_s," * timed + "h0,l0,h1,l1,h2,l2"]
    for n in range(20):
        rows += [line.format(t=f"{12.5 + 0.1 * n:.2f}")] * (n % 5 == 0)
        rows.append(f"{0.02 * n:.2f}," * timed + ",".join(f"{v / 1000:.3f}" for v in (_MV[0] + n).ravel()))
    found = propose(of_text("\n".join(rows) + "\n"), _SENSOR, {} if timed else {"rate_hz": "50"})
    assert [s.time_s for s in found.scans] == pytest.approx([0.02 * n for n in range(20)], abs=1e-6)
    np.testing.assert_allclose(found.scans[7].values, (_MV[0] + 7) / 1000, atol=1e-3)
