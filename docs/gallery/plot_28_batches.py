"""
Many scans at once
==================

Random shapes are drawn, simulated and reconstructed in three calls, on all cores, the same on every machine; a million
work as well.
"""

import matplotlib.pyplot as plt
import numpy as np

import tacstrip as ts

sensor = ts.Sensor(construction="crs-crs", strips=32, pitch_mm=3.0, length_mm=96.0)
noise = ts.Noise(positional=0.005)
scans = ts.simulate_many(sensor, ts.Shapes(n=120, corners=(3, 6), size_mm=(30.0, 60.0)), noise, rng=1)
found = ts.fit_many(scans, sensor, noise, assessment="fast")

overlap = []
for i, result in enumerate(found):
    shape = result.objects[0] if result.objects else None
    if shape is not None and len(shape.vertices) > 2:
        overlap.append(ts.mismatch(scans.contact(i).vertices, shape.vertices).iou)
good = np.array(overlap) >= 0.8
print(f"{len(overlap)} shapes, {100 * good.mean():.1f} % with an IoU of 0.8 or more")

figure, axes = plt.subplots(figsize=(6.5, 4), layout="constrained")
axes.hist(overlap, bins=np.linspace(0.5, 1.0, 41), color="#cc5500")
axes.set(
    xlabel="overlap with the true shape (IoU)", ylabel="shapes", title="120 random polygons on 32 strips"
)
