"""
A concave shape of chapter 5
============================

The thesis' concave tetragon: Profile Reconstruction takes each strip by itself, the polygon fit all together. Vertex
Reconstruction assumes a convex shape; from one signature it gives one, and calls it ``ok``.
"""

import matplotlib.pyplot as plt

import tacstrip as ts
from tacstrip import plot
from tacstrip.thesis.shapes import SHAPES

sensor = ts.Sensor.load("simulated-crs-crs")  # 1000 x 1000, as in the thesis
contact = SHAPES["concave tetragon"].contact(2)
noise = ts.Noise(positional=0.005)
scan = ts.simulate(sensor, contact, noise, rng=1)

figure, axes = plt.subplots(1, 3, figsize=(7, 3), layout="constrained")
for ax, method in zip(axes, ("profile", "polygon", "vertex"), strict=True):
    found = ts.reconstruct(scan, sensor, noise, method=method)
    plot.result(found, sensor, truth=contact, ax=ax)
    ax.set(title=f"{method}: {found.status}", xlim=(300, 700), ylim=(380, 640), adjustable="box")
    print(method, found.status, f"IoU {ts.mismatch(contact.vertices, found.objects[0].vertices).iou:.2f}")
