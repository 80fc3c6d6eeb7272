"""
Drift
=====

Electronics warm up and readings shift. Strips that nothing touches show it, and it is taken out while streaming.
"""

import matplotlib.pyplot as plt
import numpy as np

import tacstrip as ts
from tacstrip.calibrate import DriftEstimator

sensor = ts.Sensor(construction="crs-m", strips=4, pitch_mm=6.5, length_mm=325.0)
rng = np.random.default_rng(0)
at_rest = ts.learn_touch(sensor, {"k": 0.02 + rng.normal(0.0, 0.001, (50, 4))})

times = np.arange(0.0, 60.0, 0.1)
true = 0.015 * (1.0 - np.exp(-times[:, None] / 20.0)) * np.array([1.0, 0.6, -0.4, 0.2])  # warming up
estimator, followed = DriftEstimator(at_rest, time_constant_s=1.0), []
for time_s, now in zip(times, true, strict=True):
    estimator.update({"k": 0.02 + now + rng.normal(0.0, 0.001, 4)}, time_s=time_s)
    followed.append(estimator.drift["k"])

# %%
# ``tacstrip live`` does this by itself where the calibration knows the rest level; ``tacstrip calibrate --rezero``
# does it once, from a file.

figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
for strip, mark in enumerate("os^v"):
    axes.plot(
        times,
        100 * np.array(followed)[:, strip],
        marker=mark,
        markevery=60 + 5 * strip,
        label=f"strip {strip}",
    )
    axes.plot(times, 100 * true[:, strip], "--", color="black", linewidth=0.8)
axes.set(xlabel="time [s]", ylabel="drift [% of Vref]", title="Drift as estimated; dashed: as it is")
axes.legend(frameon=False, ncols=2)
