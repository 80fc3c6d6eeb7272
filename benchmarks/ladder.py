"""A full scan of a CRS-CRS network, 2,000 nodes a pair, on one core: tridiagonal ladders against general networks.

Run: python benchmarks/ladder.py
"""

from __future__ import annotations

from functools import partial

from _timing import median_seconds

import tacstrip as ts
from tacstrip.network.strips.ladder import fast_readings
from tacstrip.network.strips.measurements import network_readings

TALL = ts.Contact.polygon([(0, 20), (50, 5), (100, 30), (100, 80), (40, 95), (0, 60)])


def main() -> None:
    """Print scans a second, and how time grows with nodes and strips."""
    print(
        "strips  nodes a pair   ladder       general network   ratio   (wanted: 100 scans/s at 100 strips, 2,000 nodes)"
    )
    for strips, cells in ((100, 250), (100, 500), (100, 1000), (25, 1000), (50, 1000), (200, 1000)):
        sensor = ts.Sensor(
            construction="crs-crs",
            strips=strips,
            pitch_mm=100.0 / strips,
            length_mm=100.0,
            contact_lambda_mm=2.0,
        )
        fast = median_seconds(partial(fast_readings, sensor, TALL, cells=cells))
        slow = median_seconds(partial(network_readings, sensor, TALL, cells=cells), 3)
        print(
            f"{strips:6d}  {2 * cells:12d}   {1 / fast:6.0f} scans/s  {1 / slow:6.1f} scans/s   {slow / fast:6.0f}"
        )


if __name__ == "__main__":
    main()
