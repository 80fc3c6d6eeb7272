"""Log the objects on the sensor to a pandas table, indexed by absolute time, until Ctrl-C or the stream's end.

Run: python examples/log_to_pandas.py touches.csv [PORT]; without a port with a simulated sensor. Needs pandas.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from contextlib import suppress
from typing import Any

import tacstrip as ts
from tacstrip.stream import Drag

SENSOR = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0, adc_bits=12)
SHAPE = ts.Contact.polygon([(-16, -12), (18, -14), (12, 15), (-14, 12)])


def rows(frames: Iterable[ts.Frame]) -> list[dict[str, Any]]:
    """Return a row for each object of each frame, until the frames end or Ctrl-C."""
    found = []
    with suppress(KeyboardInterrupt):
        for frame in frames:
            for one in frame.objects:
                x, y = one.shape.centroid
                found.append(
                    {
                        "time": frame.time_ns,
                        "clock": frame.clock,
                        "scan": frame.number,
                        "object": one.id,
                        "status": one.shape.status,
                        f"area_{frame.unit}2": one.shape.area,
                        f"x_{frame.unit}": x,
                        f"y_{frame.unit}": y,
                    }
                )
    return found


def main(file: str, port: str | None = None) -> None:
    """Log to a CSV file."""
    import pandas as pd

    if port is not None:
        stream = ts.live(port)
    else:
        drag = Drag(SHAPE, [(30, 50), (70, 50)], seconds=2.0)
        stream = ts.live(source=ts.SimulatedSource(SENSOR, drag, 200.0, 400), tracks=False)
    with stream:
        box = stream.subscribe(1000)  # every scan, while the table keeps up within 1000 scans
        table = pd.DataFrame(rows(box))
    table["time"] = pd.to_datetime(table["time"], utc=True)
    table.set_index("time").to_csv(file)
    print(f"{file}: {len(table)} rows, {box.dropped} scans missed")


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    main(*sys.argv[1:3])
