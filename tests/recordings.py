"""Small recordings for several test files."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import tacstrip as ts
from tacstrip.stream.recording.recorder import Recorder, record, with_shapes
from tacstrip.stream.simulated import Drag, SimulatedSource
from tacstrip.stream.source import RawScan

ORIGIN = 1_700_000_000_123_456_789


def sensor(construction: str = "crs-crs", strips: int = 30) -> ts.Sensor:
    """Return a sensor of 1 mm strips, 100 mm long, with 12 bits."""
    return ts.Sensor(
        construction=construction,
        strips=strips,
        pitch_mm=1.0,
        length_mm=100.0,
        radius_mm=40.0 if construction == "cyl-crs-m" else None,
        contact_lambda_mm=2.0 if construction == "crs-crp" else 0.0,
        adc_bits=12,
    )


def source(
    spec: ts.Sensor, scans: int = 60, rate_hz: float = 200.0, electrodes: Literal["own", "all"] = "own"
) -> SimulatedSource:
    """Return a kite that is dragged over two thirds of the strips, with noise."""
    middle, reach = spec.width_mm / 2.0, spec.width_mm / 3.0
    kite = ts.Contact.polygon([(0, -15), (reach, 0), (0, 15), (-reach, 0)])
    drag = Drag(kite, [(middle, 40.0), (middle, 60.0)], scans / rate_hz, 1.0)
    noise = ts.Noise(positional=0.002)
    return SimulatedSource(
        spec,
        drag,
        rate_hz,
        scans,
        noise,
        3,
        electrodes=electrodes,
        origin_ns=ORIGIN,
    )


def make(path: Path, spec: ts.Sensor, scans: int = 60, method: str | None = "profile") -> list[RawScan]:
    """Record to a file and return what was recorded."""
    made = source(spec, scans)
    raws = list(with_shapes(made, spec, method) if method else made)
    with Recorder(path, spec, made.names, ORIGIN, {"source": "test"}) as recorder:
        record(raws, recorder)
    return raws
