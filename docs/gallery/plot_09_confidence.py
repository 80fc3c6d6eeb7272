"""
How sure is the fit?
====================

With one voltage a strip several outlines can explain the same readings. ``confidence`` says how probable the shown
one is, ``alternatives`` shows the others.
"""

import matplotlib.pyplot as plt

import tacstrip as ts
from tacstrip import plot

sensor = ts.Sensor(construction="crs-m", strips=24, pitch_mm=4.0, length_mm=100.0)
contact = ts.Contact.polygon([(16, 46), (30, 24), (76, 30), (70, 70), (24, 66)])
noise = ts.Noise(positional=0.005)
found = ts.reconstruct(ts.simulate(sensor, contact, noise, rng=3), sensor, noise)
shape = found.objects[0]

print(found.status, f"confidence {shape.confidence:.2f}")
print(shape.advice)
for other in shape.alternatives:
    print(f"weight {other.weight:.2f}:", other.vertices.round().tolist())

# %%
# Dotted: outlines that explain the readings as well. Two voltages a strip, as on rubber,
# leave less doubt.

figure, axes = plt.subplots(figsize=(6, 5), layout="constrained")
plot.uncertainty(found, sensor, truth=contact, ax=axes)
