"""
Two objects on the same strips
==============================

A strip reads from the lowest to the highest place that is touched. Where a second object begins or ends the readings
jump, and that parts the two; edges that nothing shows are dashed.
"""

import matplotlib.pyplot as plt

import tacstrip as ts
from tacstrip import plot

sensor = ts.Sensor(construction="crs-crs", strips=100, pitch_mm=1.0, length_mm=100.0)
noise = ts.Noise(positional=0.005)
contact = ts.Contact.from_wkt(
    "MULTIPOLYGON (((15 30, 32 12, 60 16, 58 34, 15 30)), ((36 62, 62 48, 86 60, 72 86, 36 62)))"
)
scan = ts.simulate(sensor, contact, noise, rng=1)

for piece in ts.pieces(scan, sensor, noise):
    print(piece.status, piece.outline.round(1).tolist(), "hidden corners:", int(piece.hidden.sum()))

# %%
# One polygon around both would be wrong, and says so: it is ``doubtful``.

together = ts.reconstruct(scan, sensor, noise)
parted = ts.reconstruct(scan, sensor, noise, method="pieces")
print(together.status, "-", together.objects[0].advice)

figure, axes = plt.subplots(1, 2, figsize=(7, 3.3), layout="constrained")
for ax, found, title in zip(axes, (together, parted), ("taken for one", "parted"), strict=True):
    plot.result(found, sensor, truth=contact, ax=ax)
    ax.set_title(title)
