"""
Ten minutes, as a notebook
==========================

The tutorial in Python: describe a sensor, press something, read it, recover the shape, see how certain it is.
:doc:`Ten minutes </start/ten-minutes>` is the same at the command line.
"""

import matplotlib.pyplot as plt

import tacstrip as ts
from tacstrip import plot

# %%
# **Describe the sensor.** Twenty strips of conductive rubber on rubber, 5 mm apart and 100 mm long; in a notebook
# ``sensor`` on a line of its own draws it.
sensor = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0, adc_bits=12)
print(f"{sensor.width_mm:g} mm wide, signatures: {sensor.signatures}")

# %%
# **Press something**, in millimetres on the sensor. With a sensor of your own,
# ``scan = ts.read_readings("readings.csv", sensor)[0]`` takes the place of the simulation. NaN: nothing touches.
contact = ts.Contact.polygon([(22, 18), (70, 34), (62, 72), (30, 66)])
noise = ts.Noise(positional=0.005)  # readings are off by at most 0.5 % of the supply voltage
scan = ts.simulate(sensor, contact, noise, rng=1)
print(scan.kh.round(3))

# %%
# **Recover the shape.** ``ok``: in 95 of 100 such cases it overlaps the true one by 0.8 or more.
found = ts.reconstruct(scan, sensor, noise)
shape = found.objects[0]
print(found.status, shape.vertices.round(1).tolist(), f"area {shape.area:.0f} mm2")

# %%
# **How certain?** The regions hold the true corners in 95 of 100 cases. Change the noise, the pitch, the contact.
figure, (left, right) = plt.subplots(1, 2, figsize=(7, 3.2), layout="constrained")
plot.scan(scan, sensor, ax=left)
plot.uncertainty(found, sensor, truth=contact, ax=right)
