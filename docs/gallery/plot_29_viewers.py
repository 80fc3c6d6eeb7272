"""
The live page
=============

``tacstrip live --simulate`` opens this page; ``--port /dev/ttyACM0`` fills it from a device. The picture is stored,
because a page needs a browser; frames for other programs come as JSON lines, as here.
"""

import json
import subprocess
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt

import tacstrip as ts

sensor = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0)
block = ts.Contact.polygon([(30, 30), (60, 34), (56, 70), (26, 60)])
noise = ts.Noise(positional=0.003)
scans = [ts.simulate(sensor, block.moved(i, 0.0), noise, rng=i, time_s=0.01 * i) for i in range(5)]
folder = Path(tempfile.mkdtemp())
sensor.save(folder / "sensor.toml")
ts.write_readings(folder / "readings.csv", sensor, scans)

command = ["tacstrip", "live", "sensor.toml", "readings.csv", "--no-view", "--json", "--noise", "0.003"]
lines = subprocess.run(command, capture_output=True, text=True, check=True, cwd=folder).stdout.splitlines()
frame = json.loads(lines[-1])
print(len(lines), "frames; the last one:", json.dumps(frame["objects"])[:200], "...")

# %%
# :doc:`The page's functions </guide/live>`: dragging simulated objects, recording, health of every strip. Where this
# file was downloaded alone, without the repository's picture, the last outline is drawn.

figure, axes = plt.subplots(figsize=(7, 4.5), layout="constrained")
if (picture := Path("../pictures/live.png")).exists():
    axes.imshow(plt.imread(picture))
    axes.axis("off")
else:
    axes.fill(*zip(*frame["objects"][0]["vertices_mm"], strict=True), fill=False)
