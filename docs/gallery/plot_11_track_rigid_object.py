"""
Track a rigid object
====================

An object slides over ten coarse strips. Each scan alone knows little; all together know its outline to a tenth of a
millimetre, and where it was in each.
"""

import matplotlib.pyplot as plt

import tacstrip as ts
from tacstrip import plot

sensor = ts.Sensor(construction="crs-crs", strips=10, pitch_mm=10.0, length_mm=100.0)
noise = ts.Noise(positional=0.005)
shape = ts.Contact.polygon([(-25, -18), (22, -20), (26, 8), (0, 25), (-20, 14)])
places = [shape.turned(0.03 * i).placed(38 + 0.5 * i, 50) for i in range(40)]
scans = [ts.simulate(sensor, place, noise, rng=i, time_s=0.02 * i) for i, place in enumerate(places)]

(track,) = ts.track(scans, sensor, noise)
print(track.status, f"area {track.area_mm2:.0f} +- {track.area_deviation_mm2:.0f} mm2")
print("pose in scan 10 (x, y, angle):", track.poses[10].round(3))
print("speed there (mm/s, mm/s, rad/s):", track.velocities[10].round(2))

# %%
# Left the last scan alone, right what all scans know.

alone = ts.reconstruct(scans[-1], sensor, noise)
figure, (left, right) = plt.subplots(1, 2, figsize=(7, 3.3), layout="constrained")
plot.result(alone, sensor, truth=places[-1], ax=left)
left.set_title("one scan alone")
plot.track(track, sensor, ax=right)
