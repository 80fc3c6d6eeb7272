"""
A SPICE deck
============

Sensor and contact as a netlist for ngspice, to add amplifiers, filters and leakage of your own.
"""

import subprocess
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt

import tacstrip as ts
from tacstrip import plot

sensor = ts.Sensor(construction="crs-crs", strips=4, pitch_mm=10.0, length_mm=100.0)
folder = Path(tempfile.mkdtemp())
sensor.save(folder / "small.toml")
(folder / "bar.wkt").write_text("POLYGON ((8 30, 32 40, 32 60, 8 60, 8 30))\n", encoding="utf-8")
command = ["tacstrip", "spice", "small.toml", "bar.wkt", "-o", "bar.cir"]
print(subprocess.run(command, capture_output=True, text=True, check=True, cwd=folder).stdout)

deck = (folder / "bar.cir").read_text(encoding="utf-8").splitlines()
print(f"{len(deck)} lines, of which {sum(line.startswith('R') for line in deck)} are resistors")
print("\n".join(deck[:12]))

# %%
# ``ngspice -b bar.cir`` prints the readings of these strips.

figure, axes = plt.subplots(figsize=(5, 4.6), layout="constrained")
plot.contact(ts.read_contact(folder / "bar.wkt"), sensor, ax=axes)
