"""Time of one scan of a fingertip simulated from a pressed solid, analytic or a mesh of 20,480 faces.

Beside it, where they are installed, what others take to say how deep the same 3,072 points of the skin lie in the same
ball: libigl's signed distance to the mesh (pip install libigl), and MuJoCo's tactile sensor, to the analytic ball.

Run: python benchmarks/press.py [--rounds 30]
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import time
from collections.abc import Callable
from typing import Any

import numpy as np

import tacstrip as ts
from tacstrip.arrays import FloatArray
from tacstrip.contact.press.patch import samples
from tacstrip.surface.skin import skin_of

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
    found = depths(ts.press(sensor, ts.Solid.from_mesh(ball).at(*POSE), depth_mm=1.0).solid, ball, rounds)
    print("| solid | least ms | median ms |\n| --- | --- | --- |")
    for name, times in spent.items():
        warm = sorted(times[1:])
        print(f"| {name} | {warm[0]:.2f} | {warm[len(warm) // 2]:.2f} |")
    print(
        "\n| depth of 3,072 points in the ball | least ms | off by at most mm, where in touch |\n| --- | --- | --- |"
    )
    for name, (least, off) in found.items():
        print(f"| {name} | {least:.2f} | {off:.4f} |")


def depths(solid: ts.Solid, ball: Any, rounds: int) -> dict[str, tuple[float, float]]:
    """Return the least time [ms] and the largest error [mm] of how deep the skin lies in the ball, by who says it."""
    _, _, points, normals = samples(skin_of(ts.Sensor.load("fingertip")))
    points, normals = points.reshape(-1, 3), normals.reshape(-1, 3)
    local = (points - solid.position_mm) @ solid.axes.T
    ways: dict[str, Callable[[], FloatArray]] = {
        "tacstrip, rays along the normals at the mesh": lambda: solid.touch(points, normals, 3.0),
    }
    right = ts.Solid.sphere(5.0).at(solid.position_mm, solid.toward)
    along = right.yields(points, normals, 3.0)[1]
    nearest = right.depth(points)
    ways["tacstrip, analytic ball"] = lambda: right.touch(points, normals, 3.0)
    if importlib.util.find_spec("igl"):
        igl: Any = importlib.import_module("igl")
        vertices, faces = np.asarray(ball.vertices, float), np.asarray(ball.faces, np.int64)
        ways["libigl, signed distance to the mesh"] = lambda: -igl.signed_distance(local, vertices, faces)[0]
    if importlib.util.find_spec("mujoco"):
        ways["MuJoCo, tactile sensor, analytic ball"] = _tactile(points, right)
    found = {}
    for name, ask in ways.items():
        depth, times = ask(), []
        for _ in range(rounds):
            began = time.perf_counter()
            ask()
            times.append(1e3 * (time.perf_counter() - began))
        truth = along if "rays" in name else nearest
        found[name] = min(times), float(np.abs(depth - truth)[nearest > 0.02].max())
    return found


def _tactile(points: FloatArray, ball: ts.Solid) -> Callable[[], FloatArray]:
    """Return what asks MuJoCo how deep points (N, 3) [mm] lie in a ball: a step of its forward kinematics."""
    mujoco: Any = importlib.import_module("mujoco")
    from scipy.spatial import ConvexHull

    faces = ConvexHull(points).simplices
    corners = points[faces]
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inwards = np.einsum("ij,ij->i", outward, corners.mean(axis=1) - points.mean(axis=0)) < 0.0
    faces[inwards] = faces[inwards, ::-1]
    text = {name: " ".join(map(str, v.ravel())) for name, v in (("vertex", points / 1000.0), ("face", faces))}
    x, y, z = (ball.position_mm + ball.size[0] * ball.axes[2]) / 1000.0
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><asset><mesh name="tip" vertex="{text["vertex"]}" face="{text["face"]}"/></asset>
        <worldbody><body><geom name="tip" type="mesh" mesh="tip"/></body>
        <body pos="{x} {y} {z}"><freejoint/><geom type="sphere" size="{ball.size[0] / 1000.0}"/></body></worldbody>
        <sensor><tactile geom="tip" mesh="tip"/></sensor></mujoco>"""
    )
    data = mujoco.MjData(model)

    def ask() -> FloatArray:
        mujoco.mj_forward(model, data)
        return np.asarray(1000.0 * data.sensordata.reshape(3, -1)[0])

    return ask


if __name__ == "__main__":
    main()
