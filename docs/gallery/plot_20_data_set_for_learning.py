"""
A data set for learning
=======================

``tacstrip generate`` writes labelled scans in Parquet or Zarr. Here two thousand of them, and a linear model that
learns the touched area from the readings of sixteen strips.
"""

import subprocess
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pyarrow.parquet as parquet

STUDY = """
name = "areas"
seed = 1
sensor = {construction = "crs-crs", strips = 16, pitch_mm = 6.0, length_mm = 96.0}
shapes = {n = 2000, size_mm = [20.0, 70.0]}
noise = {positional = 0.005}
dataset = {formats = ["parquet"], split = {train = 0.8, test = 0.2}}
"""
folder = Path(tempfile.mkdtemp())
(folder / "study.toml").write_text(STUDY, encoding="utf-8")
command = ["tacstrip", "generate", "study.toml", "--out", "areas"]
print(subprocess.run(command, capture_output=True, text=True, check=True, cwd=folder).stdout)

sets = {}
for name in ("train", "test"):
    table = parquet.read_table(folder / "areas" / name)
    kh, kl, l, u = (np.stack(table[s].to_numpy()) for s in ("kh", "kl", "l", "u"))
    k = np.nan_to_num(np.hstack([kh, kl]))
    sets[name] = np.hstack([k, k**2, np.ones((len(k), 1))]), 6.0 * np.nansum(u - l, axis=1)

# %%
# A neural network would do better; the data card in the folder has examples for PyTorch and JAX.

weights, *_ = np.linalg.lstsq(*sets["train"])
figure, axes = plt.subplots(figsize=(5, 5), layout="constrained")
axes.plot(sets["test"][1], sets["test"][0] @ weights, ".", color="#c1440e", markersize=4)
axes.set(xlabel="touched area [mm2]", ylabel="learned from readings [mm2]", aspect="equal")
