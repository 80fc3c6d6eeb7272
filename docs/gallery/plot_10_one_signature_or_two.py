"""
One signature or two?
=====================

The same press read with k_h alone and with k_h and k_l. One voltage a strip takes every shape for convex,
and nothing in the readings contradicts it: the shape is wrong. It is ``doubtful`` only because the convex outline needs
six corners, as blunt and rounded objects do. Two voltages take any shape.
"""

import matplotlib.pyplot as plt

import tacstrip as ts
from tacstrip import plot

sensor = ts.Sensor(construction="crs-crs", strips=40, pitch_mm=2.5, length_mm=100.0)
contact = ts.Contact.polygon([(20, 30), (50, 48), (80, 28), (74, 74), (30, 78)])  # an inward corner below
noise = ts.Noise(positional=0.003)
both = ts.simulate(sensor, contact, noise, rng=5)

results = {"k_h alone": ts.Scan(kh=both.kh), "k_h and k_l": both}
figure, axes = plt.subplots(1, 2, figsize=(7, 3.3), layout="constrained")
for ax, (name, scan) in zip(axes, results.items(), strict=True):
    found = ts.reconstruct(scan, sensor, noise)
    shape = found.objects[0].vertices
    overlap = ts.mismatch(contact.vertices, shape).iou
    print(f"{name}: {found.status}, IoU {overlap:.2f}")
    plot.result(found, sensor, truth=contact, ax=ax)
    ax.set_title(f"{name}: IoU {overlap:.2f}")
