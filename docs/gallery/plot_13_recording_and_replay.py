"""
Recording and replay
====================

A recording holds the codes, the sensor's spec and the shapes in one MCAP file that ROS 2 tools open too. It plays back
as the device did.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt

import tacstrip as ts
from tacstrip import plot
from tacstrip.stream import decode

sensor = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0, adc_bits=12)
block = ts.Contact.polygon([(-14, -12), (16, -14), (18, 12), (-10, 14)])
source = ts.SimulatedSource(sensor, lambda time_s: block.placed(25 + 50 * time_s, 50), rate_hz=50.0, scans=50)

with tempfile.TemporaryDirectory() as folder:
    file = Path(folder) / "session.mcap"
    with ts.Recorder(file, source.sensor, source.names, source.origin_ns) as recorder:
        ts.record(source, recorder)
    recording = ts.Recording(file)
    scans = [decode(raw, recording.sensor) for raw in recording]
    print(f"{len(scans)} scans in {file.stat().st_size} bytes")

# %%
# ``tacstrip record``, ``tacstrip replay`` and ``tacstrip live session.mcap`` are the same at the command line.

figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
plot.scan(scans, sensor, ax=axes)
