"""
Network or closed form?
=======================

The closed forms know ideal strips. A network of resistors knows bad contact, broken strips and loads: here what a
1 megohm input and a decay length of 2 mm do to the readings.
"""

import matplotlib.pyplot as plt

import tacstrip as ts
from tacstrip.network import Imperfections, Readout

sensor = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0)
contact = ts.Contact.polygon([(22, 18), (70, 34), (62, 72), (30, 66)])
ideal = ts.simulate(sensor, contact)
lossy = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0, contact_lambda_mm=2.0)
units = {
    "network, ideal": ts.simulate(sensor, contact, model="network"),
    "input of 1 megohm": ts.simulate(sensor, contact, model="network", readout=Readout(adc_ohm=1e6)),
    "decay length 2 mm": ts.simulate(lossy, contact, model="network"),
    "sensing strips 10 % more resistive": ts.simulate(
        sensor, contact, model="network", imperfections=Imperfections(sensing=1.1)
    ),
}

# %%
# Differences from the closed form; at 0.5 % of Vref they are as large as the thesis' noise profile I.

figure, axes = plt.subplots(figsize=(7, 3.7), layout="constrained")
for mark, (name, scan) in zip("ov^s", units.items(), strict=True):
    axes.plot(100 * (scan.kh - ideal.kh), mark, label=name, markersize=5, fillstyle="none")
    print(f"{name}: up to {100 * abs(scan.kh - ideal.kh)[scan.touched].max():.2g} % of Vref")
axes.set(xlabel="strip", ylabel="k_h minus the closed form [% of Vref]")
axes.legend(frameon=False)
