"""The netlist: ngspice reads the same circuit and finds the same voltages."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tacstrip as ts
from studies import crp_spans
from studies.digital_array import array_measurements
from tacstrip.network import ArrayWiring, Imperfections, Readout, Short, scan_array
from tacstrip.network.crp.mesh import Wiring
from tacstrip.network.crp.readings import measurements as sheet_measurements
from tacstrip.network.devices.digital_array import ISOLATIONS
from tacstrip.network.nodal import Measurement, Network, solve_measurement
from tacstrip.network.spice import deck
from tacstrip.network.strips.measurements import measurements, network_readings
from tacstrip.network.strips.resolved import wide_measurements, wide_readings
from waiting import HANG_S

needs_ngspice = pytest.mark.skipif(
    shutil.which("ngspice") is None, reason="ngspice is not installed; apt install ngspice"
)
CONTACT = ts.Contact.polygon([(2, 120), (60, 100), (50, 160)])
FLAT: dict[str, Any] = {"strips": 10, "pitch_mm": 6.5, "length_mm": 325.0, "vref_volt": 6.05}


def _run(folder: Path, text: str) -> dict[str, float]:
    (folder / "deck.cir").write_text(text)
    done = subprocess.run(
        ["ngspice", "-b", "deck.cir"], cwd=folder, capture_output=True, text=True, check=False, timeout=HANG_S
    )
    return {
        name: float(value) for name, value in re.findall(r"^([vi]\w+) = (\S+)$", done.stdout, re.MULTILINE)
    }


@needs_ngspice
@pytest.mark.parametrize(
    ("sensor", "keywords"),
    [
        (ts.Sensor(construction="crs-crs", **FLAT), {}),
        (
            ts.Sensor(construction="crs-crs", contact_lambda_mm=2.0, resistivity_ratio=0.3, **FLAT),
            {"cells": 200},
        ),
        (ts.Sensor(construction="crs-m", contact_lambda_mm=2.0, **FLAT), {"cells": 100}),
        (
            ts.Sensor(construction="crs-m", **FLAT),
            {"readout": Readout(1e4, 100.0, 1e6, tied_grounds=True)},
        ),
        (
            ts.Sensor(construction="crs-crs", **FLAT),
            {"imperfections": Imperfections(shorts=[Short(3, 130.0, 500.0, "sensing")])},
        ),
    ],
    ids=["ideal", "unequal, lambda", "metal, lambda", "tied grounds, loaded", "short"],
)
def test_ngspice_finds_the_same_voltages(
    tmp_path: Path, sensor: ts.Sensor, keywords: dict[str, object]
) -> None:
    ours = network_readings(sensor, CONTACT, **keywords)  # type: ignore[arg-type]
    asked = measurements(sensor, CONTACT, **keywords)  # type: ignore[arg-type]
    printed = _run(tmp_path, deck("test", {str(s): q for s, q in asked.items()}, sensor.vref_volt))
    names = {"kh": "vh", "kl": "vl", "k": "vout"}
    assert len(printed) == len(ours) * len(asked)
    for signature, values in ours.items():
        for strip in asked:
            volts = printed[f"{names[signature]}_{strip}"]
            assert volts / sensor.vref_volt == pytest.approx(values[strip], abs=1e-6)


@needs_ngspice
def test_ngspice_finds_the_closed_forms_of_a_hemisphere(tmp_path: Path) -> None:
    tip = ts.Sensor.load("fingertip")
    contact = ts.Contact.polygon([(3, 2), (30, 4), (8, 11)])
    asked = measurements(tip, contact)
    printed = _run(tmp_path, deck("tip", {str(s): q for s, q in asked.items()}, tip.vref_volt))
    ideal = ts.simulate(tip, contact)
    assert len(asked) == ideal.touched.sum() > 4
    for strip in asked:
        for name, volts in (("kh", "vh"), ("kl", "vl")):
            assert printed[f"{volts}_{strip}"] / tip.vref_volt == pytest.approx(ideal[name][strip], abs=1e-6)


@needs_ngspice
def test_ngspice_agrees_on_a_sheet_of_50_by_50(tmp_path: Path) -> None:
    n = 50
    node = np.arange(n * n).reshape(n, n)
    start = np.concatenate([node[:, :-1].ravel(), node[:-1].ravel()])
    end = np.concatenate([node[:, 1:].ravel(), node[1:].ravel()])
    siemens = np.random.default_rng(0).uniform(0.5, 2.0, len(start))
    read = {f"p{i}": int(node[i, 3 * i % n]) for i in range(0, n, 7)}
    measurement = Measurement(Network(n * n, start, end, siemens), {0: 1.0, n * n - 1: 0.0, 77: 0.25}, read)
    ours = solve_measurement(measurement)
    printed = _run(
        tmp_path, deck("sheet", {"s": measurement}).replace("print p", "print vp").replace("let p", "let vp")
    )
    assert {name: printed[f"v{name}_s"] for name in read} == pytest.approx(ours, abs=1e-6)


@needs_ngspice
@pytest.mark.parametrize("wire_ohm", [0.0, 1.0])
@pytest.mark.parametrize("isolation", ISOLATIONS)
def test_ngspice_agrees_on_the_digital_array(tmp_path: Path, isolation: str, wire_ohm: float) -> None:
    """All rows of a random pattern; a row without a contact floats, and its wire is left out."""
    pattern = np.random.default_rng(3).random((12, 9)) < 0.25
    pattern[5] = False
    wiring = ArrayWiring(wire_ohm=wire_ohm)
    ours = scan_array(pattern, isolation=isolation, wiring=wiring).volts
    unit = wiring.contact_ohm if isolation == "zero-potential" else 1.0
    kind = "i" if isolation == "zero-potential" else "v"
    asked = array_measurements(pattern, isolation, wiring)
    printed = _run(tmp_path, deck("array", {str(row): measurement for row, measurement in asked.items()}))
    for row, measurement in asked.items():
        names = [f"{kind}column{j}" for j in range(9)]
        plain, spice = solve_measurement(measurement), [printed[f"{name}_{row}"] for name in names]
        np.testing.assert_allclose(np.array(spice) * unit, ours[row], rtol=0, atol=1e-6)
        np.testing.assert_allclose([plain[name] * unit for name in names], ours[row], rtol=0, atol=1e-9)
    assert ours.max() > 0.9
    assert (ours > 0.5).sum() > pattern.sum() or isolation != "none"


@needs_ngspice
@pytest.mark.parametrize(
    "wiring",
    [Wiring(), Wiring("grounded", common_bars=True)],  # the others are the plain solver's, as these are
    ids=lambda wiring: f"{wiring.others}, bars {wiring.common_bars}",
)
def test_ngspice_agrees_on_strips_over_a_resistive_sheet(tmp_path: Path, wiring: Wiring) -> None:
    sensor = ts.Sensor(
        construction="crs-crp",
        strips=6,
        pitch_mm=5.0,
        length_mm=60.0,
        strip_width_mm=4.0,
        resistivity_ratio=100.0,
        contact_lambda_mm=2.0,
        vref_volt=6.05,
    )
    contact = ts.Contact.polygon([(3, 12), (26, 20), (20, 50), (6, 40)])
    l, u = ts.footprint(sensor, contact)
    kh, kl = crp_spans.own_electrodes(sensor, l, u, 18, wiring)
    touched = np.flatnonzero(~np.isnan(l))
    asked = sheet_measurements(crp_spans.factored_span(sensor, l, u, 18, wiring).resistors, wiring)
    printed = _run(tmp_path, deck("crs-crp", {str(s): m for s, m in asked.items()}, sensor.vref_volt))
    assert len(printed) == 2 * len(touched) > 6
    for name, values in (("vh", kh), ("vl", kl)):
        spice = [printed[f"{name}_{strip}"] / sensor.vref_volt for strip in touched]
        np.testing.assert_allclose(spice, values[touched], rtol=0, atol=1e-6)


@needs_ngspice
@pytest.mark.parametrize("lam", [0.0, 3.0])
def test_ngspice_agrees_on_a_strip_resolved_across_its_width(tmp_path: Path, lam: float) -> None:
    sensor = ts.Sensor(construction="crs-crs", contact_lambda_mm=lam, resistivity_ratio=0.3, **FLAT)
    asked = wide_measurements(sensor, CONTACT, 6)
    printed = _run(tmp_path, deck("wide", {str(s): q for s, q in asked.items()}))
    for name, values in wide_readings(sensor, CONTACT, across=6).items():
        spice = [printed[f"v{name[1]}_{strip}"] for strip in asked]
        np.testing.assert_allclose(spice, values[list(asked)], rtol=0, atol=1e-6)


@needs_ngspice
def test_the_command_writes_a_deck_that_runs(tmp_path: Path) -> None:
    from click.testing import CliRunner

    from tacstrip.cli.spice import command

    (tmp_path / "t.wkt").write_text("POLYGON ((2 120, 60 100, 50 160, 2 120))")
    out = tmp_path / "deck.cir"
    done = CliRunner().invoke(command, ["prototype-crs-m", str(tmp_path / "t.wkt"), "-o", str(out)])
    assert done.exit_code == 0, done.output
    sensor = ts.Sensor.load("prototype-crs-m")
    printed = _run(tmp_path, out.read_text())
    lines = replace(sensor, strip_width_mm=None)  # the deck's strips are their centre lines
    k = ts.simulate(lines, ts.read_contact(tmp_path / "t.wkt"))["k"]
    expected = {f"vout_{i + 1}": v * 6.05 for i, v in enumerate(k) if not np.isnan(v)}
    assert printed == pytest.approx(expected, abs=1e-6)


def test_a_deck_meters_currents_and_leaves_out_what_floats() -> None:
    start, end, siemens = np.array([0, 1, 3]), np.array([1, 2, 4]), np.array([0.5, 0.25, 1.0])
    network = Network(5, start, end, siemens)
    measurement = Measurement(network, {0: 1.0, 2: 0.0}, {}, {"i": 2})
    assert solve_measurement(measurement)["i"] == pytest.approx(1.0 / 6.0, abs=1e-15)
    text = deck("current", {"1": measurement})
    assert "V0_2 n0_2 0 DC 0\n" in text
    assert "let i_1 = i(V0_2)\nprint i_1\n" in text
    assert "R0_1 n0_1 n0_2 4\n" in text
    assert "R0_2" not in text
    with pytest.raises(ts.NetworkError, match="kh of 7 floats: no resistor joins it to a held node"):
        deck("floating", {"7": Measurement(network, {0: 1.0, 2: 0.0}, {"kh": 3})})


def test_a_deck_names_its_parts() -> None:
    network = Network(3, np.array([0, 1]), np.array([1, 2]), np.array([0.5, 0.25]))
    text = deck("two resistors", {"1": Measurement(network, {0: 1.0, 2: 0.0}, {"k": 1})}, 5.0)
    assert "V0_0 n0_0 0 DC 5\n" in text
    assert "R0_0 n0_0 n0_1 2\n" in text
    assert "R0_1 n0_1 0 4\n" in text
    assert "let vout_1 = v(n0_1)\nprint vout_1\n" in text
