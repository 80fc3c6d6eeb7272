"""
A known object
==============

If you know what touches, only its place and angle are unknown: six strips are enough, and a wrong object is refused.
"""

import math

import matplotlib.pyplot as plt

import tacstrip as ts
from tacstrip import plot

sensor = ts.Sensor(construction="crs-crs", strips=8, pitch_mm=12.0, length_mm=100.0)
noise = ts.Noise(positional=0.005)
key = ts.Contact.polygon([(0, 0), (50, 0), (50, 10), (30, 26), (0, 18)])
pressed = key.turned(0.5).placed(48, 52)
scan = ts.simulate(sensor, pressed, noise, rng=2)

found = ts.fit_object(scan, sensor, key, noise)
pose = found.objects[0].pose
print(found.status, f"x {pose.x_mm:.2f} mm, y {pose.y_mm:.2f} mm, {math.degrees(pose.angle):.1f} degrees")

wrong = ts.fit_object(scan, sensor, ts.Contact.polygon([(0, 0), (40, 0), (20, 40)]), noise)
print(wrong.status, "-", wrong.objects[0].advice)

# %%
# Left the pose of the known outline; right the outline that eight strips give without knowing it.

free = ts.reconstruct(scan, sensor, noise)
figure, axes = plt.subplots(1, 2, figsize=(7, 3.3), layout="constrained")
for ax, result, title in zip(axes, (found, free), ("known outline, fitted pose", "unknown"), strict=True):
    plot.result(result, sensor, truth=pressed, ax=ax)
    ax.set_title(title)
