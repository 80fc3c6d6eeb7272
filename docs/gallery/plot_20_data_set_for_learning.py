"""
A data set for learning
=======================

``tacstrip generate`` writes labelled scans in Parquet or Zarr. Here two thousand, and a linear
model that learns the touched area from sixteen strips.
"""

import subprocess
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pyarrow.parquet as parquet

STUDY = """
seed = 1
sensor = {construction = "crs-crs", strips = 16, pitch_mm = 6.0, length_mm = 96.0}
shapes = {n = 2000, size_mm = [20.0, 70.0]}
noise.positional = 0.005
dataset = {formats = ["parquet"], split = {train = 0.8, test = 0.2}}
"""
folder = Path(tempfile.mkdtemp())
(folder / "study.toml").write_text(STUDY, encoding="utf-8")
subprocess.run(["tacstrip", "generate", "study.toml", "--out", "areas"], check=True, cwd=folder)

sets = {}
for name in ("train", "test"):
    table = parquet.read_table(folder / "areas" / name)
    kh, kl, l, u = (np.stack(table[s].to_numpy()) for s in ("kh", "kl", "l", "u"))
    k = np.hstack([kh, kl, kh**2, kl**2, np.ones((len(kh), 1))])
    sets[name] = np.nan_to_num(k), 6.0 * np.nansum(u - l, axis=1)
# %%
# The data card has examples for PyTorch and JAX.

weights, *_ = np.linalg.lstsq(*sets["train"], rcond=None)
figure, axes = plt.subplots(figsize=(5, 5), layout="constrained")
axes.plot(sets["test"][1], sets["test"][0] @ weights, ".", color="#cc5500", markersize=4)
axes.set(xlabel="touched area [mm2]", ylabel="learned from readings [mm2]", aspect="equal")
