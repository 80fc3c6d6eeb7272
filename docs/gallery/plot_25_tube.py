"""
A tube
======

Strips round a metal tube, with a contact across the seam: x goes on beyond the circumference, and the shape is whole.
"""

import matplotlib.pyplot as plt

import tacstrip as ts
from tacstrip import plot

tube = ts.Sensor(construction="cyl-crs-m", strips=24, pitch_mm=5.0, length_mm=200.0, radius_mm=19.1)
print("closed:", tube.closed, "- circumference", tube.width_mm, "mm")
contact = ts.Contact.polygon([(102, 60), (138, 80), (150, 120), (120, 150)])  # beyond x = 120 it goes round
noise = ts.Noise(positional=0.003)
scan = ts.simulate(tube, contact, noise, rng=1)
print("strips touched:", scan.touched.nonzero()[0].tolist())

found = ts.reconstruct(scan, tube, noise)
shape = found.objects[0]
print(found.status, shape.advice)
print(f"IoU {ts.mismatch(contact.vertices, shape.vertices, around_mm=tube.width_mm).iou:.2f}")

# %%
# The part beyond the seam is drawn on the other side, too.

figure, (left, right) = plt.subplots(1, 2, figsize=(7, 3.6), layout="constrained")
plot.scan(scan, tube, ax=left)
plot.result(found, tube, truth=contact, ax=right)
