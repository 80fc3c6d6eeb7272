"""
Import a messy log
==================

A logger's file with a title, semicolons, decimal commas, German names and strips from 1: ``tacstrip import`` reads it,
says what it understood, and asks what the file does not say.
"""

import subprocess
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt

import tacstrip as ts
from tacstrip import plot

sensor = ts.Sensor(construction="crs-crs", strips=10, pitch_mm=10.0, length_mm=100.0, strip_base=1)
folder = Path(tempfile.mkdtemp())
sensor.save(folder / "bench.toml")
contact = ts.Contact.polygon([(18, 30), (75, 22), (82, 60), (30, 70)])
lines = ["Messung 3, Pruefstand B", "", "Zeit [ms];Streifen;U_h [V];U_l [V]"]
for i in range(4):
    scan = ts.simulate(sensor, contact.moved(3.0 * i, 2.0 * i), ts.Noise(positional=0.003), rng=i)
    for strip, (high, low) in enumerate(zip(5 * scan.kh, 5 * scan.kl, strict=True), 1):
        volts = f"{high:.3f};{low:.3f}" if high == high else ";"
        lines.append(f"{20 * i};{strip};{volts}".replace(".", ","))
(folder / "bench.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
print("\n".join(lines[:6]))

# %%
# The import, as typed at the command line:

command = ["tacstrip", "import", "bench.csv", "bench.toml", "-o", "readings.csv"]
done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=folder)
print(done.stderr, done.stdout)
scans = ts.read_readings(folder / "readings.csv", sensor)
figure, axes = plt.subplots(figsize=(6, 4.6), layout="constrained")
plot.result([ts.reconstruct(scan, sensor) for scan in scans], sensor, truth=contact, ax=axes)
