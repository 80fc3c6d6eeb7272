"""
A row of a table of the thesis, run again: M.C. under profile I
===============================================================

Table 5.5: Vertex Reconstruction of a triangle from k_l, with the errors of 5.1. Printed values beside a dozen draws;
``tacstrip reproduce --table 5.5`` prints the whole table, all noises and measures.
"""

import matplotlib.pyplot as plt
import numpy as np

from tacstrip.data.published import rows
from tacstrip.thesis.chapter5.tables import run_cell
from tacstrip.thesis.shapes import POSITIONS

number, row = next((n, r) for n, r in enumerate(rows()) if r.table == "5.5" and "profile I" in r.noise)
print(row.table, row.shape, row.algorithm, row.signature, row.noise)

figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
for position in range(POSITIONS):
    known = run_cell(
        number, position, 12
    ).known  # a row per draw with a shape: M.C. [rad], A.O.E. [rad], A.P.E. [mm]
    ours = known[:, 0]
    axes.plot(np.full(len(ours), position + 1), ours, "_", color="#999999", markersize=18)
    print(f"position {position + 1}: printed {row.printed['mc'][position]:.3f}, ours {np.median(ours):.3f}")

# %%
# Every table is on the pages of :doc:`the reproduction </reproduction/index>`.

axes.plot(range(1, POSITIONS + 1), row.printed["mc"], "o", color="#cc5500", label="printed")
axes.plot([], [], "_", color="#999999", markersize=12, label="our draws")
axes.set(
    xlabel="position",
    ylabel="mismatch coefficient M.C. [rad]",
    xticks=range(1, 6),
    title="Table 5.5, profile I",
)
axes.legend(frameon=False)
