"""
Noise, averaged
===============

Every scan has new errors; a mean of sixteen scans of a still press has a quarter of them, and so have the corners.
"""

import matplotlib.pyplot as plt
import numpy as np

import tacstrip as ts

sensor = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0)
contact = ts.Contact.polygon([(22, 18), (70, 34), (62, 72), (30, 66)])
noise = ts.Noise(white=0.01)  # 1 % of Vref, normal

counts, errors, bound = (1, 2, 4, 8, 16, 32), [], []
for count in counts:
    off = []
    for trial in range(6):
        scans = [ts.simulate(sensor, contact, noise, rng=1000 * trial + i) for i in range(count)]
        fit = ts.fit_polygon(ts.Scan.mean(scans), sensor, noise, vertices=4, assessment="none")
        off.append(ts.mismatch(contact.vertices, fit.objects[0].vertices).hausdorff)
    errors.append(np.median(off))
    outline = ts.Outline.of(contact.vertices)
    bound.append(ts.vertex_rms(ts.vertex_covariance(outline, sensor, sigma=0.01 / np.sqrt(count))))

# %%
# The dashed line is the least error that any unbiased method can have (the Cramer-Rao bound).

figure, axes = plt.subplots(figsize=(6, 4), layout="constrained")
axes.loglog(counts, errors, "o-", color="#cc5500", label="furthest point of the outline, median of 6")
axes.loglog(counts, bound, "--", color="#555555", label="bound of a corner, root mean square")
axes.set(
    xlabel="scans averaged", ylabel="error [mm]", title="Error falls with the root of the number of scans"
)
axes.legend(frameon=False)
