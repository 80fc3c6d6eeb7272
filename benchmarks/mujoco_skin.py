"""Steps a second of a fingertip on a body of a MuJoCo model: a finger that rolls a pen, or a pen as a mesh.

Run: python benchmarks/mujoco_skin.py [--steps 200]
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import mujoco
import numpy as np
import trimesh

import tacstrip as ts

MODEL = """<mujoco><option timestep=".001" cone="elliptic" impratio="20"/>
  <default><geom solref=".004 1"/></default>{asset}<worldbody><geom type="plane" size=".1 .1 .01"/>
  <body pos="-.003 0 .004"><freejoint/><geom name="pen" {pen} euler="90 0 0"/></body>
  <body pos="-.006 0 .0167"><joint name="x" type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>
    <geom size=".009" mass=".1"/><site name="tip" euler="0 140 0"/></body></worldbody>
  <actuator><position joint="x" kp="200" kv="5"/></actuator></mujoco>"""


def main() -> None:
    """Print milliseconds of processor time a step: of MuJoCo, of the patch, of reading."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\\n")[0])
    options.add_argument("--steps", type=int, default=200)
    steps = options.parse_args().steps
    rod = (
        trimesh.creation.cylinder(radius=0.004, height=0.14, sections=160).subdivide().subdivide().subdivide()
    )
    points, faces = (" ".join(map(str, v.ravel())) for v in (rod.vertices, rod.faces))
    pens = {
        "capsule": ("", 'type="capsule" size=".004 .07"'),
        f"mesh of {len(rod.faces)} faces": (
            f'<asset><mesh name="rod" vertex="{points}" face="{faces}"/></asset>', 'type="mesh" mesh="rod"',
        ),
    }  # fmt: skip
    print(
        "| pen | 10 steps of MuJoCo ms | patch ms | reading ms | all, a second |\n| --- | --- | --- | --- | --- |"
    )
    for name, (asset, pen) in pens.items():
        spent = _spent(MODEL.format(asset=asset, pen=pen), steps)
        print(
            f"| {name} |",
            " | ".join(f"{1e3 * s:.2f}" for s in spent),
            f"| {1.0 / spent.sum():.0f} |",
            flush=True,
        )


def _spent(xml: str, steps: int) -> Any:
    """Return processor time [s] a step of what is done (3,), medians."""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    skin = ts.mujoco_skin(model, ts.Sensor.load("fingertip"), site="tip", geoms=["pen"])
    times = []
    for step in range(steps):
        data.ctrl = 0.012 * step / steps
        at = [time.process_time()]
        mujoco.mj_step(model, data, 10)
        at.append(time.process_time())
        patch = skin.press(data)
        at.append(time.process_time())
        skin.read(data, patch)
        at.append(time.process_time())
        times.append(np.diff(at))
    return np.median(times, axis=0)


if __name__ == "__main__":
    main()
