"""Skins on the bodies of a MuJoCo model: what geometry lies in them at each step, and what they read.

MuJoCo's own contacts are a few points each, so patches come from `contact.press`: the depth of every place of the skin
in the geoms of other bodies. MuJoCo is in metres, skins and patches are in millimetres.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self

import numpy as np

from tacstrip.arguments import takes
from tacstrip.arrays import FloatArray
from tacstrip.contact.noise import Noise, NoiseProcess, Rng
from tacstrip.contact.press.patch import Patch, patch_at, strip_ends
from tacstrip.contact.press.solid import Solid
from tacstrip.errors import ContactError, OptionError, one_of
from tacstrip.scan import Scan
from tacstrip.sensor.left_out import leave_out
from tacstrip.sensor.spec import Sensor
from tacstrip.simulation import readings
from tacstrip.surface.skin import Skin, skin_of

_MM = 1000.0  # per metre
# MuJoCo's mjtGeom.
_KINDS = {0: "plane", 2: "sphere", 3: "capsule", 4: "ellipsoid", 5: "cylinder", 6: "box", 7: "mesh"}
_SEGMENTS = 64  # round a cylinder or capsule that is a mesh
_GRID = 33  # of the skin's extent
_MARGIN_MM = 0.5  # beside the skin, within which an end is no longer far
_IDEAL = Noise()


@takes(sensor=Sensor, noise=Noise)
def mujoco_skin(
    model: Any,
    sensor: Sensor,
    *,
    site: str | None = None,
    body: str | None = None,
    geoms: Sequence[str] | None = None,
    noise: Noise = _IDEAL,
    rng: Rng = 0,
) -> MujocoSkin:
    """Attach a skin to a body of a MuJoCo model; needs `tacstrip[mujoco]`, and `tacstrip[press]` for meshes.

    Parameters
    ----------
    model
        A `mujoco.MjModel`.
    sensor
        Whose skin it is: its frame [mm] is that of the site or body.
    site, body
        Name of the one or the other.
    geoms
        Names of what can touch it; None: all that collide, of bodies that are not welded to the skin's.
    noise, rng
        Of its readings, and a seed or a NumPy generator; errors that last go on from step to step.

    Raises
    ------
    OptionError
        The model has no such name, or both or neither of `site` and `body` are given.
    ContactError
        A geom is of a kind that cannot be pressed (height field, signed distance field).

    Examples
    --------
    >>> import mujoco
    >>> import tacstrip as ts
    >>> model = mujoco.MjModel.from_xml_string(
    ...     '''<mujoco><worldbody>
    ...       <body name="finger"><geom size=".009"/></body>
    ...       <body pos=".0092 0 .0092"><freejoint/><geom name="ball" size=".004"/></body>
    ...     </worldbody></mujoco>''')
    >>> data = mujoco.MjData(model)
    >>> mujoco.mj_forward(model, data)
    >>> skin = ts.mujoco_skin(model, ts.Sensor.load("fingertip"), body="finger")
    >>> patch = skin.press(data)
    >>> patch.touched.nonzero()[0].tolist(), round(patch.max_indentation_mm, 3), int(skin.read(data).touched.sum())
    ([0, 15], 0.988, 2)
    """
    if (site is None) == (body is None):
        raise OptionError("give one of site and body, the name of what the skin lies on")
    kind, name = ("site", site) if body is None else ("body", body)
    names = _names(model, kind)
    if name not in names:
        raise OptionError(one_of(kind, name, [n for n in names if n]))
    at = names.index(name)
    own = int(model.body_weldid[model.site_bodyid[at] if kind == "site" else at])
    every = _names(model, "geom")
    if geoms is None:
        touching = [
            i for i in range(model.ngeom)
            if int(model.body_weldid[model.geom_bodyid[i]]) != own
            and (model.geom_contype[i] or model.geom_conaffinity[i])
        ]  # fmt: skip
    else:
        if missing := [g for g in geoms if g not in every]:
            raise OptionError(one_of("geoms", missing[0], [n for n in every if n]))
        touching = [every.index(g) for g in geoms]
    found = tuple(_Geom.of(model, i, every[i] or f"number {i}") for i in touching)
    return MujocoSkin(sensor, kind, at, found, NoiseProcess(noise, sensor, rng))


def _names(model: Any, kind: str) -> list[str]:
    """Return the names of all that the model has of a kind, "" where one has none."""
    count = {"site": model.nsite, "body": model.nbody, "geom": model.ngeom}[kind]
    return [str(getattr(model, kind)(i).name) for i in range(count)]


@dataclass(frozen=True, eq=False)
class MujocoSkin:
    """A skin on a body of a MuJoCo model; make one with `mujoco_skin`.

    Attributes
    ----------
    sensor
        Whose skin it is.
    kind, at
        What it lies on, "site" or "body", and which one.
    geoms
        What can touch it.

    Examples
    --------
    >>> import mujoco
    >>> import tacstrip as ts
    >>> model = mujoco.MjModel.from_xml_string(
    ...     '''<mujoco><worldbody><geom type="plane" size="1 1 1"/><body pos="0 0 .0095"><joint/>
    ...       <geom size=".008"/><site name="tip" euler="140 0 0"/></body></worldbody></mujoco>''')
    >>> data = mujoco.MjData(model)
    >>> mujoco.mj_step(model, data)
    >>> scan = ts.mujoco_skin(model, ts.Sensor.load("fingertip"), site="tip").read(data)
    >>> scan.touched.nonzero()[0].tolist(), scan.time_s
    ([11, 12], 0.002)
    """

    sensor: Sensor
    kind: str
    at: int
    geoms: tuple[_Geom, ...]
    process: NoiseProcess = field(repr=False)

    @cached_property
    def _skin(self) -> Skin:
        return skin_of(self.sensor)

    @cached_property
    def _ball(self) -> tuple[FloatArray, float]:
        """Centre (3,) and radius [mm] of a ball round the skin."""
        skin = self._skin
        points = skin.points(np.linspace(*skin.across, _GRID)[:, None], np.linspace(*skin.up, _GRID)).reshape(
            -1, 3
        )
        centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
        return centre, float(np.linalg.norm(points - centre, axis=1).max())

    def pose(self, data: Any) -> tuple[FloatArray, FloatArray]:
        """Return where the skin's frame is (3,) [mm], and its axes (3, 3), a row each, in a `mujoco.MjData`."""
        if self.kind == "site":
            place, turn = data.site_xpos[self.at], data.site_xmat[self.at]
        else:
            place, turn = data.xpos[self.at], data.xmat[self.at]
        return _MM * np.array(place), np.array(turn).reshape(3, 3).T

    def solids(self, data: Any) -> list[tuple[str, Solid]]:
        """Return names and objects of all geoms near the skin, in the skin's frame [mm]."""
        origin, axes = self.pose(data)
        centre, radius = self._ball
        found = []
        for geom in self.geoms:
            place = axes @ (_MM * np.array(data.geom_xpos[geom.number]) - origin)
            turn = axes @ np.array(data.geom_xmat[geom.number]).reshape(3, 3)  # columns: the geom's axes
            if geom.near(place, turn, centre, radius):
                found.append((geom.name, geom.solid(place, turn, centre, radius)))
        return found

    def press(self, data: Any) -> Patch:
        """Return the patch of all geoms that lie in the skin: area, force and outline of all of them together.

        `force_n` is the length of `force_xyz`, `solid` the object that presses most, and `depth_mm` NaN. Where objects
        touch the same strip, l and u are the outer ends.

        Raises
        ------
        ContactError
            A geom lies deeper in the skin than that is thick.
        """
        patches = []
        for name, solid in self.solids(data):
            try:
                patch = patch_at(self.sensor, solid)
            except ContactError as error:
                raise ContactError(f"geom {name} at {float(data.time):.6g} s: {error}") from None
            patches.append(patch)
        return _together(self.sensor, patches)

    def read(self, data: Any, patch: Patch | None = None) -> Scan:
        """Return what the skin reads, with the time of the simulation; of a patch that `press` has given, faster."""
        l, u = np.full(self.sensor.strips, np.nan), np.full(self.sensor.strips, np.nan)
        own = (strip_ends(self._skin, solid) for _, solid in self.solids(data))
        for low, high in own if patch is None else [(patch.l, patch.u)]:
            l, u = np.fmin(l, low), np.fmax(u, high)
        read = readings(self.sensor, l, u, process=self.process, time_s=float(data.time))
        return Scan(**leave_out(self.sensor, read), time_s=float(data.time))


@dataclass(frozen=True, eq=False)
class _Geom:
    """A geom of a model: its number and name, kind, size [mm], radius of a ball round it, and mesh."""

    number: int
    name: str
    kind: str
    size: FloatArray
    reach: float
    shape: Solid | None

    @classmethod
    def of(cls, model: Any, number: int, name: str) -> Self:
        """Read it; `ContactError` where it cannot be pressed."""
        kind = _KINDS.get(int(model.geom_type[number]))
        if kind is None:
            raise ContactError(
                f"geom {name}: of its kind no patch can be told, only of: {', '.join(_KINDS.values())}; leave it out "
                "(geoms=...)"
            )
        size = _MM * np.array(model.geom_size[number])
        reach = _MM * float(model.geom_rbound[number])
        shape = None
        if kind in ("mesh", "ellipsoid"):
            shape = _mesh(model, number, name, kind, size)
        return cls(number, name, kind, size, reach, shape)

    def near(self, place: FloatArray, turn: FloatArray, centre: FloatArray, radius: float) -> bool:
        """Whether it can touch what lies in a ball (3,), radius."""
        if self.kind == "plane":
            return bool(turn[:, 2] @ (centre - place) < radius + _MARGIN_MM)
        return bool(np.linalg.norm(place - centre) < self.reach + radius + _MARGIN_MM)

    def solid(self, place: FloatArray, turn: FloatArray, centre: FloatArray, radius: float) -> Solid:
        """Return it at a pose (3,), (3, 3) in the skin's frame; rods whose ends are off the skin have no ends."""
        x, y, z = turn.T
        if self.kind == "plane":
            return replace(Solid.plane(), position_mm=place, axes=np.stack([x, -y, -z]))
        if self.kind == "sphere":
            return replace(
                Solid.sphere(float(self.size[0])), position_mm=place - self.size[0] * z, axes=turn.T
            )
        if self.kind == "box":
            return replace(Solid.box(2.0 * self.size), position_mm=place - self.size[2] * z, axes=turn.T)
        if self.kind in ("capsule", "cylinder"):
            if abs(float((centre - place) @ z)) + radius + _MARGIN_MM < self.size[1]:
                return replace(
                    Solid.cylinder(float(self.size[0])),
                    position_mm=place - self.size[0] * y,
                    axes=np.stack([z, x, y]),
                )
            return replace(self._rod, position_mm=place, axes=turn.T)
        assert self.shape is not None
        return replace(self.shape, position_mm=place, axes=turn.T)

    @cached_property
    def _rod(self) -> Solid:
        """A cylinder or capsule with its ends."""
        creation = _trimesh().creation
        radius, length = float(self.size[0]), 2.0 * float(self.size[1])
        if self.kind == "cylinder":
            made = creation.cylinder(radius=radius, height=length, sections=_SEGMENTS)
        else:
            made = creation.capsule(radius=radius, height=length, count=(_SEGMENTS, _SEGMENTS))
            made.apply_translation(-made.bounds.mean(axis=0))
        return Solid.from_mesh(made)


def _trimesh() -> Any:
    try:
        import trimesh
    except ImportError:
        raise ContactError(
            'meshes, ellipsoids and ends of rods need trimesh: pip install "tacstrip[press]"'
        ) from None
    return trimesh


def _mesh(model: Any, number: int, name: str, kind: str, size: FloatArray) -> Solid:
    """Return a mesh or ellipsoid in its geom's frame [mm]."""
    trimesh = _trimesh()
    if kind == "ellipsoid":
        ball = trimesh.creation.icosphere(subdivisions=5)
        ball.apply_scale(size)
        return Solid.from_mesh(ball)
    which = int(model.geom_dataid[number])
    first, count = int(model.mesh_vertadr[which]), int(model.mesh_vertnum[which])
    face, faces = int(model.mesh_faceadr[which]), int(model.mesh_facenum[which])
    made = trimesh.Trimesh(
        _MM * np.array(model.mesh_vert[first : first + count]), np.array(model.mesh_face[face : face + faces]),
        process=False,
    )  # fmt: skip
    try:
        return Solid.from_mesh(made)
    except ContactError as error:
        raise ContactError(f"geom {name}: {error}") from None


def _together(sensor: Sensor, patches: list[Patch]) -> Patch:
    """Return several patches as one."""
    patches = [p for p in patches if p.area_mm2 > 0.0 or p.touched.any()]
    nothing, nowhere = np.full(sensor.strips, np.nan), np.full(3, np.nan)
    if not patches:
        return Patch(
            nothing, nothing, 0.0, 0.0, np.zeros(3), np.zeros(3), nowhere, nowhere, np.empty((0, 3)), math.nan, 0.0,
            _NONE,
        )  # fmt: skip
    l, u, parted = nothing, nothing, [patches[0].outline_xyz]
    for patch in patches:
        l, u = np.fmin(l, patch.l), np.fmax(u, patch.u)
    for patch in patches[1:]:
        parted += [np.full((1, 3), np.nan), patch.outline_xyz]
    area = np.array([p.area_mm2 for p in patches])
    share = area / area.sum() if area.sum() else np.full(len(area), 1.0 / len(area))
    force, moment = (
        sum((getattr(p, name) for p in patches), np.zeros(3)) for name in ("force_xyz", "moment_xyz")
    )
    most = max(patches, key=lambda p: p.force_n)
    centroid, normal = (sum((s * getattr(p, name) for s, p in zip(share, patches, strict=True)), np.zeros(3))
                        for name in ("centroid_xyz", "normal"))  # fmt: skip
    return Patch(
        l, u, float(area.sum()), float(np.linalg.norm(force)), force, moment, centroid,
        normal / np.linalg.norm(normal), np.concatenate(parted), math.nan,
        max(p.max_indentation_mm for p in patches), most.solid,
    )  # fmt: skip


_NONE = Solid.plane().at((0.0, 0.0, 1e6), toward=(0.0, 0.0, -1.0))
