"""
How good can it get?
====================

The Cramer-Rao bound: the least error of the corners that any unbiased method can reach, here for one contact at each
place of the sensor.
"""

import matplotlib.pyplot as plt

import tacstrip as ts
from tacstrip import plot

contact = ts.Contact.polygon([(-16, -14), (14, -18), (18, 12), (-8, 18)]).placed(50, 50)
noise = ts.Noise(positional=0.005)
figure, axes = plt.subplots(1, 2, figsize=(7, 3.5), layout="constrained")
for ax, construction in zip(axes, ("crs-crs", "crs-m"), strict=True):
    sensor = ts.Sensor(construction=construction, strips=20, pitch_mm=5.0, length_mm=100.0)
    bound = ts.vertex_covariance(ts.Outline.of(contact.vertices), sensor, noise)
    print(f"{construction}: {ts.vertex_rms(bound):.2f} mm in the middle")
    plot.limits(sensor, contact, noise, grid=9, ax=ax)
    ax.set_title(construction.upper())
