"""
Is my strip 7 broken?
=====================

Drag something over all strips, turn it, and ask the doctor. Here strip 7 has lost its wire at the supply's end.
"""

import math

import matplotlib.pyplot as plt
import numpy as np

import tacstrip as ts
from tacstrip import plot
from tacstrip.diagnose import Log, diagnose

sensor = ts.Sensor(construction="crs-crs", strips=12, pitch_mm=5.0, length_mm=100.0)
block = ts.Contact.polygon([(-15, -14), (15, -12), (15, 14), (-15, 10)])

times, raw = 0.02 * np.arange(300), {"kh": [], "kl": []}
for i, time_s in enumerate(times):
    x, y = 30.0 + 38.0 * math.sin(1.9 * time_s), 50.0 + 46.0 * math.sin(2.7 * time_s + 0.4)
    pressed = block.turned(0.4 * math.sin(time_s)).placed(x, y)
    scan = ts.simulate(sensor, pressed, ts.Noise(positional=0.002), rng=i, time_s=time_s)
    for name, values in raw.items():
        values.append(np.where(np.arange(12) == 7, 0.0 * scan[name], scan[name]))  # strip 7 stays on ground

report = diagnose(Log.of(sensor, times, {name: np.array(values) for name, values in raw.items()}))
for finding in report.findings:
    print(report.where(finding), "-", finding.kind.title)
    print(" ", finding.evidence)

# %%
# From a file: ``tacstrip doctor readings.csv --sensor sensor.toml --plot health.png``.

figure, axes = plt.subplots(figsize=(7, 2.6), layout="constrained")
plot.health(report, ax=axes)
