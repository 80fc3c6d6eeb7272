"""
Which pitch?
============

How fine must the strips be for corners to be known to half a millimetre? The Cramer-Rao bound answers before anything
is built.
"""

import matplotlib.pyplot as plt
import numpy as np

import tacstrip as ts

wanted_mm, width_mm = 0.5, 120.0
coin = ts.Outline.of([(14, 55), (50, 15), (106, 48), (66, 100)])
pitches = np.array([1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0, 15.0, 20.0, 24.0])

figure, axes = plt.subplots(figsize=(6.5, 4), layout="constrained")
for positional, look in ((0.002, "s-"), (0.005, "o--"), (0.01, "^:")):
    errors = []
    for pitch in pitches:
        strips = int(width_mm / pitch)
        sensor = ts.Sensor(construction="crs-crs", strips=strips, pitch_mm=pitch, length_mm=120.0)
        errors.append(ts.vertex_rms(ts.vertex_covariance(coin, sensor, ts.Noise(positional=positional))))
    axes.loglog(pitches, errors, look, label=f"readings within {100 * positional:g} % of Vref")
    good = pitches[np.array(errors) <= wanted_mm]
    print(f"{100 * positional:g} %: the coarsest that does is {good.max():g} mm" if len(good) else "none")

# %%
# This is for one contact at one place; smaller ones need finer strips. The command line takes many places,
# constructions, lengths and converters: ``tacstrip limits sensor.toml object.wkt --positional 0.005 --wanted-mm 0.5``.

axes.axhline(wanted_mm, color="#555555", linestyle="--")
axes.text(1.0, wanted_mm * 1.08, "wanted: 0.5 mm", color="#555555")
axes.set(xlabel="pitch [mm]", ylabel="error of a corner, root mean square [mm]", title="Least error by pitch")
axes.legend(frameon=False)
