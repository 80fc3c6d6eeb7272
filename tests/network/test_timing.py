"""Settling: the limit of a scan's rate."""

from __future__ import annotations

import math

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.network import Readout
from tacstrip.network.nodal import Factored
from tacstrip.network.strips.measurements import measurements
from tacstrip.network.timing import fastest_scan_hz, settling_s, source_ohm

CRS = ts.Sensor(
    construction="crs-crs", strips=10, pitch_mm=6.5, length_mm=325.0, adc_bits=12, resistivity_ratio=0.4
)
METAL = ts.Sensor(construction="crs-m", strips=10, pitch_mm=6.5, length_mm=325.0, adc_bits=10)
BLOCK = ts.Contact.polygon([(0, 120), (65, 120), (65, 200), (0, 200)])


@pytest.mark.parametrize("sensor", [CRS, METAL], ids=["rubber", "metal"])
def test_source_resistance_is_that_of_the_network(sensor: ts.Sensor) -> None:
    """Feed 1 A into the node that is read, supplies at 0: its potential is the source's resistance."""
    readout = Readout(strip_ohm=8000.0, mux_ohm=150.0)
    for l, u in ((120.0, 200.0), (120.0, 120.0), (10.0, 40.0), (290.0, 325.0)):
        contact = (
            ts.Contact.polygon([(0, l), (65, l), (65, u), (0, u)]) if u > l else ts.Contact.points([22.75, l])
        )
        measurement = measurements(sensor, contact, readout=readout)[3]
        factored = Factored(measurement.network, list(measurement.held))
        seen = []
        for node in measurement.read.values():
            amperes = np.zeros(measurement.network.nodes)
            amperes[node] = 1.0
            seen.append(factored.solve(np.zeros(len(measurement.held)), amperes)[node])
        assert max(seen) == pytest.approx(
            float(source_ohm(sensor, readout, np.array(l), np.array(u))), rel=1e-9
        )


def test_settling_reaches_half_a_step() -> None:
    time_s = settling_s(5000.0, 100e-12, 12)
    assert math.exp(-time_s / (5000.0 * 100e-12)) == pytest.approx(0.5 / 2**12)


def test_the_fastest_scan() -> None:
    readout = Readout(strip_ohm=10_000.0)
    worst = source_ohm(METAL, readout, np.array(162.5), np.array(162.5))
    assert worst == pytest.approx(2500.0)
    rate = fastest_scan_hz(METAL, readout, farad=50e-12, conversion_s=10e-6)
    assert rate == pytest.approx(1.0 / (10 * (2500.0 * 50e-12 * math.log(2.0**11) + 10e-6)), rel=1e-6)
    assert fastest_scan_hz(CRS, readout, 50e-12, 10e-6) < rate / 2  # twice the samples, and rubber in series
    with pytest.raises(ts.NetworkError, match="the spec has no adc_bits"):
        fastest_scan_hz(
            ts.Sensor(construction="crs-m", strips=3, pitch_mm=1.0, length_mm=9.0), readout, 1e-12
        )
    with pytest.raises(ts.NetworkError, match=r"farad = -1\.0"):
        fastest_scan_hz(METAL, readout, -1.0)
