"""
A pen on a fingertip
====================

A skin on a sphere, as on a robot's finger. A pen of unknown radius is pressed into it, and one scan tells where it
lies, how thick it is and how hard it presses.
"""

import tacstrip as ts
from tacstrip import plot

fingertip, noise = ts.Sensor.load("fingertip"), ts.Noise(positional=0.005)
pen = ts.Solid.cylinder(4.0).at((20, 0, 20), toward=(-1, 0, -1), turn_rad=0.5)
patch = ts.press(fingertip, pen, depth_mm=1.5)
print(f"true: {patch.area_mm2:.0f} mm2, {patch.force_n:.1f} N, {patch.touched.sum()} strips touched")

scan = ts.simulate(fingertip, patch, noise, rng=1)
found = ts.fit_solid(scan, fingertip, ts.Solid.cylinder(6.0), noise)  # "a cylinder, some 6 mm"
print(found.status, f"radius {found.radius_mm:.2f} +- {found.radius_sigma_mm:.2f} mm")
print(f"area {found.area_mm2:.0f} +- {found.area_sigma_mm2:.0f} mm2, force {found.force_n:.1f} N")

# %%
# The skin in space, the strips that are touched, and the patch.

axes = plot.skin(fingertip, patch)
figure = axes.figure
