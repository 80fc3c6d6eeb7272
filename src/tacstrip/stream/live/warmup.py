"""Run the reconstruction once before a stream begins, so that the first scan does not wait for imports."""

from __future__ import annotations

from tacstrip.contact.noise import Noise
from tacstrip.contact.shape import Contact
from tacstrip.sensor.spec import Sensor
from tacstrip.simulation import simulate
from tacstrip.tracking.tracker import Tracker

_SCANS = 3


def warm_up(sensor: Sensor, method: str | None = None) -> None:
    """Reconstruct a simulated quadrangle in the middle of the sensor; errors as of `Tracker`."""
    w, h = sensor.width_mm, sensor.length_mm
    contact = Contact.polygon(
        [(0.2 * w, 0.4 * h), (0.6 * w, 0.3 * h), (0.8 * w, 0.5 * h), (0.5 * w, 0.7 * h)]
    )
    tracker = Tracker(sensor, method)
    for number in range(_SCANS if sensor.kind.closed_form else 1):
        scan = simulate(sensor, contact, Noise(positional=0.002), rng=number, time_s=number * 1e-3)
        tracker.update(scan, detail=True)
