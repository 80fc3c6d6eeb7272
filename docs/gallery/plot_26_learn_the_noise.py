"""
Learn the noise
===============

A minute of a still press tells what the errors of a unit are made of, and how many scans are worth averaging.
"""

import matplotlib.pyplot as plt
import numpy as np

import tacstrip as ts
from tacstrip.contact.noise import NoiseProcess
from tacstrip.diagnose import Log, learn_noise

sensor = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0)
contact = ts.Contact.polygon([(22, 38), (62, 22), (80, 55), (45, 76)])
true = ts.Noise(white=0.004, wander=0.002, wander_s=15.0)
process, times = NoiseProcess(true, sensor, 1), 0.5 * np.arange(120)
scans = [ts.simulate(sensor, contact, process=process, time_s=t) for t in times]

learned = learn_noise(Log.of(sensor, times, {n: np.stack([s[n] for s in scans]) for n in ("kh", "kl")}))
print(f"white noise {100 * learned.noise.white:.2f} % of Vref, {100 * true.white:.2f} % is right")
print(learned.noise.to_toml())

# %%
# The Allan deviation: averaging helps until the wander takes over. From a file: ``tacstrip noise still.csv --write
# sensor.toml --plot allan.png``.

figure, axes = plt.subplots(figsize=(6.5, 4), layout="constrained")
axes.loglog(learned.counts * learned.period_s, 100 * learned.allan, color="#cc5500", alpha=0.4, linewidth=0.8)
axes.set(xlabel="time averaged [s]", ylabel="Allan deviation [% of Vref]", title="One line per channel")
