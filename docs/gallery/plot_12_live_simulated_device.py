"""
Live, from a simulated device
=============================

The loop that reads a device, here with a simulated one: each frame has the objects, their numbers and the delay.
"""

import math

import matplotlib.pyplot as plt

import tacstrip as ts

sensor = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0)
block = ts.Contact.polygon([(-14, -12), (16, -14), (18, 12), (-10, 14)])


def touching(time_s):
    """Return what touches at that time: a block on a circle."""
    return block.turned(time_s).placed(50 + 20 * math.cos(2 * time_s), 50 + 20 * math.sin(2 * time_s))


source = ts.SimulatedSource(sensor, touching, rate_hz=100.0, scans=150, noise=ts.Noise(positional=0.005))
way = []
with ts.live(source=source, speed=math.inf, tracks=False) as stream:  # a device: ts.live("/dev/ttyACM0")
    frames = stream.subscribe(
        1000
    )  # a queue; `for frame in stream` gives the newest frame, and may miss some
    while (frame := frames.get(10.0)) is not None:
        way += [(one.id, *one.shape.centroid) for one in frame.objects or () if one.shape.status == "ok"]
print(f"{len(way)} places of object {way[0][0]}")

# %%
# The same with a page in the browser: ``tacstrip live --simulate``.

figure, axes = plt.subplots(figsize=(5, 5), layout="constrained")
axes.plot([x for _, x, _ in way], [y for *_, y in way], ".", color="#cc5500", markersize=4)
axes.set(
    aspect="equal", xlim=(0, 100), ylim=(0, 100), xlabel="x [mm]", ylabel="y [mm]", title="Its centroid, live"
)
