"""Build the readings that `tacstrip demo` reads: synthetic, and said so.

Nobody has measured hardware for this project. The volts are what the ten-strip CRS-CRS prototype of section
6.1 would give for the 5 x 3.5 cm rectangle, placed as in its twin (`thesis/chapter6/twin.py`): the closed forms (3.3)
and (3.4), plus the residual errors printed for the middle of the sensor (tables 6.8 and 6.9, figures 6.7 and
6.13), plus the printed offsets (table 6.1), rounded to a millivolt.

Run: python tools/build_demo.py (writes src/tacstrip/data/demo_readings.csv and demo_contact.wkt).
"""

from __future__ import annotations

import csv

from tacstrip.data import data_path
from tacstrip.thesis.chapter6.twin import PLACINGS, raw_scan, region_errors, twin


def main() -> None:
    """Write both files."""
    sensor = twin("CRS-CRS")
    contact = PLACINGS["CRS-CRS"]["tilted"].contact(sensor, "middle")
    scan = raw_scan(sensor, contact, region_errors("CRS-CRS", "middle"))
    volts = {name: scan[name] * sensor.vref_volt for name in scan.signatures}
    with data_path("demo_readings.csv").open("w", encoding="utf-8", newline="") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow(["scan", "time_s", "strip", "v_h", "v_l"])
        for strip in range(sensor.strips):
            out.writerow([0, 0, strip + sensor.strip_base, *(f"{volts[n][strip]:.3f}" for n in ("kh", "kl"))])
    corners = [*contact.vertices.tolist(), contact.vertices[0].tolist()]
    text = ", ".join(f"{x:.6f} {y:.6f}" for x, y in corners)
    data_path("demo_contact.wkt").write_text(f"POLYGON (({text}))\n", encoding="utf-8")


if __name__ == "__main__":
    main()
