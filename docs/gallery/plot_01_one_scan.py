"""
One scan
========

A quadrangle on twenty strips, read once with errors of up to 0.5 % of the supply voltage, and the shape that comes
back.
"""

import matplotlib.pyplot as plt

import tacstrip as ts
from tacstrip import plot

sensor = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0)
contact = ts.Contact.polygon([(22, 18), (70, 34), (62, 72), (30, 66)])
noise = ts.Noise(positional=0.005)
scan = ts.simulate(sensor, contact, noise, rng=1)

found = ts.reconstruct(scan, sensor, noise)
shape = found.objects[0]
print(found.status, shape.vertices.round(1).tolist())
print(f"overlap with the true shape (IoU): {ts.mismatch(contact.vertices, shape.vertices).iou:.3f}")

# %%
# Left what the sensor reads, right what that means. The grey shape is the true one, which only a simulation knows.

figure, (left, right) = plt.subplots(1, 2, figsize=(7, 3), layout="constrained")
plot.scan(scan, sensor, ax=left)
plot.result(found, sensor, truth=contact, ax=right)
