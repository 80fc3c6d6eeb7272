"""
Two layers
==========

A second layer of strips across the first sees the gap between objects that share strips in one of them.
"""

import matplotlib.pyplot as plt

import tacstrip as ts
from tacstrip import plot

sensor = ts.Sensor.load("layered-crs-crs")
noise = ts.Noise(positional=0.005)
contact = ts.Contact.polygon([(20, 20), (45, 25), (30, 50)]) + ts.Contact.polygon(
    [(35, 60), (70, 55), (60, 80)]
)
scan = ts.simulate(sensor, contact, noise, rng=1)

both = ts.reconstruct(scan, sensor, noise)
print("both layers:", [thing.status for thing in both.objects])

lower = sensor.layers[0].sensor  # what one layer alone makes of it
alone = ts.reconstruct(scan.split(sensor)[0], lower, noise)
print("one layer:", [thing.status for thing in alone.objects], alone.objects[0].advice)

# %%
# Left one layer alone, right both.

figure, (left, right) = plt.subplots(1, 2, figsize=(7, 3.5), layout="constrained")
plot.result(alone, lower, truth=contact, ax=left)
left.set_title("one layer")
plot.result(both, sensor, truth=contact, ax=right)
right.set_title("two layers")
