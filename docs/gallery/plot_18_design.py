"""
Design a sensor
===============

Which sensors locate the corners of an object to 1 or 2 mm, and how many strips do they need? Every candidate is judged
by its bound and by what its electronics can do.
"""

import matplotlib.pyplot as plt

import tacstrip as ts
from tacstrip.design.candidates import candidates, designs

base = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0)
part = ts.Outline.of([(30, 45), (45, 25), (70, 35), (72, 60), (45, 70)])
wanted = (1.0, 2.0)

tried = list(candidates(base, pitches_mm=(3.0, 5.0)))
figure, axes = plt.subplots(figsize=(7, 4.4), layout="constrained")
for mark, wanted_mm in zip("os", wanted, strict=True):
    good = [d for d in designs(tried, part, ts.Noise(positional=0.005), wanted_mm) if d.noise > 0.0]
    print(
        f"{wanted_mm} mm: {len(good)} designs; fewest strips: {min((d.sensor.strips for d in good), default='-')}"
    )
    axes.plot([d.sensor.strips for d in good], [100 * d.noise for d in good], mark, label=f"{wanted_mm:g} mm")

# %%
# Fewer strips demand better readings. ``tacstrip limits --wanted-mm`` prints the list with the requirements that each
# design fails.

axes.set(
    xlabel="strips",
    ylabel="readings must be within [% of Vref]",
    yscale="log",
    title="Designs that reach ...",
)
axes.legend(frameon=False)
