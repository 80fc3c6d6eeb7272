"""
Ten thousand designs
====================

Pitch, converter, noise and construction of a sensor of 100 by 100 mm, varied at once: what does half a millimetre
cost? A small sweep runs here; the ten thousand were measured once.
"""

import subprocess
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
from pyarrow import csv, parquet

STUDY = """seed = 1
sensor = {construction = "crs-crs", strips = 20, pitch_mm = 5.0, length_mm = 100.0}
shapes.size_mm = [30.0, 50.0]
vary.sensor = {width_mm = [100.0], construction = ["crs-crs", "crs-m"]}
latin.samples = 10  # 5000 for the picture
latin.sensor = {pitch_mm = {from = 1, to = 10, log = true}, adc_bits = {from = 8, to = 16}}
latin.noise = {positional = {from = 0.0005, to = 0.01, log = true}}
measure = {what = ["bound"], scans = 2}"""
folder = Path(tempfile.mkdtemp())
(folder / "study.toml").write_text(STUDY, encoding="utf-8")
subprocess.run(["tacstrip", "sweep", "study.toml", "--out", "designs"], check=True, cwd=folder)
# %%
# Each point is a design; the dashed line is half a millimetre. Without :download:`the ten thousand
# <../gallery/ten_thousand_designs.csv>` in the folder, the small sweep's are drawn.

many = Path("ten_thousand_designs.csv")
table = csv.read_csv(many) if many.exists() else parquet.read_table(folder / "designs/results.parquet")
rows = table.rename_columns([name.split(".")[-1] for name in table.column_names]).to_pylist()
figure, axes = plt.subplots(figsize=(7, 4.3), layout="constrained")
for kind, colour in (("crs-m", "#8ea6c4"), ("crs-crs", "#cc5500")):
    x, y = ([r[key] for r in rows if r["construction"] == kind] for key in ("strips", "bound_mm"))
    axes.loglog(x, y, ".", color=colour, markersize=2 if len(rows) > 99 else 6, alpha=0.6, label=kind.upper())
axes.axhline(0.5, color="#555555", linestyle="--")
axes.set(xlabel="strips", ylabel="least error of a corner [mm]", ylim=(0.02, 30))
axes.legend(frameon=False, markerscale=6 if len(rows) > 99 else 2)
