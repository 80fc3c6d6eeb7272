"""
Calibrate my unit
=================

Press a bar at known places; the fit finds each strip's offset and gain, and writes a spec that corrects every reading.
"""

import matplotlib.pyplot as plt
import numpy as np

import tacstrip as ts
from tacstrip import plot

sensor = ts.Sensor(construction="crs-crs", strips=10, pitch_mm=6.5, length_mm=325.0)
rng = np.random.default_rng(4)

# Six presses of two bars, 10 and 40 mm wide, across all strips: (presses, strips).
l_mm = np.repeat([[20.0], [120.0], [220.0], [290.0], [60.0], [180.0]], 10, axis=1)
w_mm = np.repeat([[10.0], [10.0], [10.0], [10.0], [40.0], [40.0]], 10, axis=1)
offset, gain = rng.normal(0.0, 0.02, 10), rng.normal(1.0, 0.01, 10)
exact = ts.signatures(sensor, l_mm, l_mm + w_mm)
raw = {name: gain * k + offset + rng.uniform(-0.002, 0.002, k.shape) for name, k in exact.items()}

runs = ts.Runs(l_mm, w_mm, raw, line=np.arange(2, 62).reshape(6, 10), rest={})
result = ts.calibrate_unit(sensor, runs, model="offset+gain")
print(result.status, result.advice)
print(
    f"off by {result.rms_percent(result.before):.2f} % of Vref, after it {result.rms_percent(result.after):.2f} %"
)
print(np.round(result.sensor.calibration.channel("kh").offset, 3), "is", offset.round(3))

# %%
# ``result.sensor`` is the calibrated sensor; ``result.sensor.save("calibrated.toml")`` writes its spec.
#
# ``tacstrip calibrate --plan sensor.toml -o runs.csv`` says which contacts to make, ``tacstrip calibrate sensor.toml
# runs.csv -o calibrated.toml --report report`` does the rest and writes a report.

figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
plot.calibration(result, ax=axes)
