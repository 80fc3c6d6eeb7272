"""Run the reconstruction once before a stream begins, so that the first scan does not wait for imports."""

from __future__ import annotations

import numpy as np

from tacstrip.contact.noise import Noise
from tacstrip.contact.shape import Contact
from tacstrip.sensor.layers import AnySensor, Layer, LayeredSensor
from tacstrip.simulation import simulate
from tacstrip.tracking.layered import tracker_of

_SCANS = 3


def warm_up(sensor: AnySensor, method: str | None = None) -> None:
    """Reconstruct a simulated quadrangle in the middle of the sensor; errors as of `Tracker`."""
    corners = np.array([(0.2, 0.4), (0.6, 0.3), (0.8, 0.5), (0.5, 0.7)])
    layers = sensor.layers if isinstance(sensor, LayeredSensor) else (Layer(sensor=sensor),)
    first = layers[0].sensor
    contact = Contact.polygon(layers[0].to_whole(corners * (first.width_mm, first.length_mm)))
    tracker = tracker_of(sensor, method)
    for number in range(_SCANS if first.kind.closed_form else 1):
        scan = simulate(sensor, contact, Noise(positional=0.002), rng=number, time_s=number * 1e-3)
        tracker.update(scan, detail=True)
