"""
How thick a pen is, by rolling it
=================================

One scan of a pressed pen tells its radius to a percent or two; scans in which it lies in other ways tell more, for
it is one pen.
"""

import matplotlib.pyplot as plt
import numpy as np

import tacstrip as ts

fingertip, noise = ts.Sensor.load("fingertip"), ts.Noise(positional=0.005)
pen, scans = ts.Solid.cylinder(radius_mm=4.5), []
for i in range(8):
    polar, around = 0.45 + 0.02 * i, 0.3 + 0.05 * i
    out = np.array([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)])
    patch = ts.press(fingertip, pen.at(10.0 * out, toward=-out, turn_rad=0.5 + 0.05 * i), depth_mm=1.4)
    scans.append(ts.simulate(fingertip, patch, noise, rng=i, time_s=0.02 * i))

# %%
# The search begins at another radius. `radius_sigmas_mm` is how well the scans up to each one tell it.
film = ts.track_solid(scans, fingertip, ts.Solid.cylinder(radius_mm=7.0), noise)
low, high = film.radius_interval_mm
print(f"{film.status}: {film.radius_mm:.2f} mm, with 95 % from {low:.2f} to {high:.2f}; it is 4.5")

# %%
# Every scan has its pose: here how hard the pen presses, with two deviations.
figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3), layout="constrained")
left.plot(np.arange(1, 9), film.radius_sigmas_mm, "o-")
left.set(xlabel="scans", ylabel="deviation of the radius [mm]", ylim=(0, None))
right.errorbar(film.times_s, film.force_n, 2.0 * film.force_sigma_n, fmt="o")
right.set(xlabel="time [s]", ylabel="force [N]")
