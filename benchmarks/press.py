"""Time of one scan of a fingertip simulated from a pressed solid, analytic or a mesh of 20,480 faces.

Run: python benchmarks/press.py [--rounds 30]
"""

from __future__ import annotations

import argparse
import importlib
import time
from typing import Any

import tacstrip as ts

POSE = (10.0, 3.0, 10.0), (-1.0, -0.3, -1.0)


def main() -> None:
    """Print the least and the median time for every solid, taken in turn."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--rounds", type=int, default=30)
    rounds = options.parse_args().rounds
    trimesh: Any = importlib.import_module("trimesh")
    ball = trimesh.creation.icosphere(subdivisions=5, radius=5.0)
    ball.apply_translation((0.0, 0.0, 5.0))
    solids = {
        "plane": ts.Solid.plane(), "sphere": ts.Solid.sphere(5.0), "cylinder": ts.Solid.cylinder(4.0),
        "edge": ts.Solid.edge(), "box": ts.Solid.box((12.0, 6.0, 8.0)),
        f"mesh of {len(ball.faces)} faces": ts.Solid.from_mesh(ball),
    }  # fmt: skip
    sensor = ts.Sensor.load("fingertip")
    spent: dict[str, list[float]] = {name: [] for name in solids}
    for _ in range(rounds + 1):
        for name, solid in solids.items():
            began = time.perf_counter()
            ts.simulate(sensor, ts.press(sensor, solid.at(*POSE), depth_mm=1.0))
            spent[name].append(1e3 * (time.perf_counter() - began))
    print("| solid | least ms | median ms |\n| --- | --- | --- |")
    for name, times in spent.items():
        warm = sorted(times[1:])
        print(f"| {name} | {warm[0]:.2f} | {warm[len(warm) // 2]:.2f} |")


if __name__ == "__main__":
    main()
