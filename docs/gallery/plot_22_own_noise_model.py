"""
My own noise model
==================

A scan is plain numbers, so any law of errors can be added. Here: errors that grow with the reading, as of a converter
with a poor reference. Tell the fit their size, or let it find out.
"""

import matplotlib.pyplot as plt
import numpy as np

import tacstrip as ts
from tacstrip import plot

sensor = ts.Sensor(construction="crs-crs", strips=30, pitch_mm=3.0, length_mm=90.0)
contact = ts.Contact.polygon([(16, 20), (66, 14), (76, 58), (40, 76), (22, 60)])
clean = ts.simulate(sensor, contact)
rng = np.random.default_rng(7)


def worn(k):
    """Return readings with errors of 0.1 % of Vref and 1 % of the reading."""
    return np.clip(k + rng.normal(0.0, np.hypot(0.001, 0.01 * k)), 0.0, 1.0)


scan = ts.Scan(kh=worn(clean.kh), kl=worn(clean.kl))
guessed = ts.reconstruct(scan, sensor)  # the noise is estimated from the residuals
rms = np.sqrt(np.nanmean(np.square([scan.kh, scan.kl])))  # of the readings over Vref
told = ts.reconstruct(scan, sensor, ts.Noise(white=np.hypot(0.001, 0.01 * rms)))  # its typical size

# %%
# The parts that :class:`tacstrip.Noise` knows by name need no code: white noise, wander, hum, strays, soft edges. For
# errors that are not independent their size is not enough: :doc:`what to tell the fit </guide/noise>`.

figure, axes = plt.subplots(1, 2, figsize=(7, 3.3), layout="constrained")
for ax, found, title in zip(axes, (guessed, told), ("noise estimated", "noise given"), strict=True):
    plot.uncertainty(found, sensor, truth=contact, ax=ax)
    ax.set_title(f"{title}: {found.status}")
