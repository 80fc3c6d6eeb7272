"""Objects that are pressed: plane, sphere, cylinder, edge, box, or a triangle mesh, at a pose.

In an object's own frame its lowest place, which touches first, is the origin; z points from the skin into the object;
a cylinder's axis and an edge's ridge are x.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
import numpy.typing as npt

from tacstrip.arrays import FloatArray
from tacstrip.contact.press.mesh import Mesh
from tacstrip.errors import ContactError

_FAR = 1e6  # mm
_PARALLEL = 1e-9  # cosine of a normal and a face's, below which they never meet
_UNDER_MM = 0.05  # depth that a point counts with which the object reaches under


@dataclass(frozen=True, eq=False)
class Solid:
    """An object and where it is; make one with `plane`, `sphere`, `cylinder`, `edge`, `box` or `from_mesh`, then `at`.

    Attributes
    ----------
    kind
        "plane", "sphere", "cylinder", "edge", "box" or "mesh".
    size
        Radius [mm]; angle [rad]; or the box's three sides [mm].
    position_mm
        Where its lowest place is (3,) [mm].
    axes
        Its x, y and z in space (3, 3), unit vectors a row each. x, `axes[0]`, is a cylinder's axis, an edge's ridge,
        a box's first side; -z is the way that it is pressed.
    mesh
        Of a mesh, else None.

    Examples
    --------
    >>> import tacstrip as ts
    >>> ball = ts.Solid.sphere(5.0).at((0, 0, 10), toward=(0, 0, -1))
    >>> ball.depth([[0, 0, 11.0], [0, 0, 9.0]]).round(6).tolist()
    [1.0, -1.0]
    """

    kind: Literal["plane", "sphere", "cylinder", "edge", "box", "mesh"]
    size: tuple[float, ...] = ()
    position_mm: FloatArray = field(default_factory=lambda: np.zeros(3))
    axes: FloatArray = field(default_factory=lambda: np.eye(3))
    mesh: Mesh | None = None

    def __repr__(self) -> str:
        size = "" if not self.size else " of " + " x ".join(f"{s:.4g}" for s in self.size)
        unit = " rad" if self.kind == "edge" else " mm" if self.size else ""
        at, toward = (", ".join(f"{v:.4g}" for v in vector) for vector in (self.position_mm, self.toward))
        return f"<Solid: {self.kind}{size}{unit} at ({at}) mm toward ({toward})>"

    @classmethod
    def plane(cls) -> Self:
        """Make a half-space: a table, a wall, anything flat and larger than the patch."""
        return cls("plane")

    @classmethod
    def sphere(cls, radius_mm: float) -> Self:
        """Make a sphere."""
        return cls("sphere", (_size("radius_mm", radius_mm),))

    @classmethod
    def cylinder(cls, radius_mm: float) -> Self:
        """Make a cylinder without ends, which lies along its x."""
        return cls("cylinder", (_size("radius_mm", radius_mm),))

    @classmethod
    def edge(cls, angle_rad: float = 0.5 * math.pi) -> Self:
        """Make the edge of a body, by the angle [rad] between its two sides, which lies along its x."""
        if not 0.0 < _size("angle_rad", angle_rad) < math.pi:
            raise ContactError(
                f"angle_rad = {angle_rad}: an edge has between 0 and pi, and is not in degrees"
            )
        return cls("edge", (float(angle_rad),))

    @classmethod
    def box(cls, size_mm: npt.ArrayLike) -> Self:
        """Make a box of three sides, along its x, y and z, that lies on its face; of one number a cube."""
        try:
            size = np.broadcast_to(np.asarray(size_mm, dtype=float), 3)
        except (TypeError, ValueError):
            raise ContactError(
                f"size_mm = {size_mm!r}: a box has one side or three, such as (20, 10, 5)"
            ) from None
        return cls("box", tuple(_size("size_mm", float(s)) for s in size))

    @classmethod
    def from_mesh(cls, path: str | Path | Any, unit: str = "mm") -> Self:
        """Make it from a triangle mesh in a file (STL, OBJ, PLY) or of trimesh; needs `tacstrip[press]`.

        Parameters
        ----------
        path
            The file, or a `trimesh.Trimesh`.
        unit
            What its numbers are: mm, cm, m or inch.

        Raises
        ------
        ContactError
            It cannot be read, is no mesh, or is of a size that says that its unit is another.
        """
        return cls("mesh", mesh=Mesh.load(path, unit))

    def at(self, position_mm: npt.ArrayLike, toward: npt.ArrayLike, turn_rad: float = 0.0) -> Self:
        """Return it with its lowest place at `position_mm` (3,), to be pressed along `toward` (3,).

        `turn_rad` turns it about that: at 0 its x is the direction in which the angle of -toward from the z axis grows.

        Raises
        ------
        ContactError
            A vector is not three numbers, or `toward` has no length.
        """
        up = -_vector("toward", toward)
        length = float(np.linalg.norm(up))
        if length == 0.0:
            raise ContactError("toward = (0, 0, 0): give the direction in which the object is pressed")
        if not isinstance(turn_rad, int | float | np.number) or not math.isfinite(turn_rad):
            raise ContactError(f"turn_rad = {turn_rad!r}: must be a number")
        up = up / length
        flat = math.hypot(up[0], up[1])
        cos, sin = (up[0] / flat, up[1] / flat) if flat > 1e-12 else (1.0, 0.0)
        south = np.array([up[2] * cos, up[2] * sin, -flat])
        east = np.cross(up, south)
        x = math.cos(turn_rad) * south + math.sin(turn_rad) * east
        axes = np.stack([x, np.cross(up, x), up])
        return replace(self, position_mm=_vector("position_mm", position_mm), axes=axes)

    @property
    def axis(self) -> FloatArray | None:
        """Unit vector (3,) along a cylinder's axis or an edge's ridge, to either side; None of others."""
        return self.axes[0] if self.kind in ("cylinder", "edge") else None

    @property
    def toward(self) -> FloatArray:
        """The way that it is pressed, a unit vector (3,)."""
        return np.asarray(-self.axes[2])

    def moved(self, distance_mm: float) -> Self:
        """Return it moved on, the way that it is pressed."""
        return replace(self, position_mm=self.position_mm + distance_mm * self.toward)

    def _local(self, points: npt.ArrayLike) -> FloatArray:
        return np.asarray((np.asarray(points, dtype=float) - self.position_mm) @ self.axes.T)

    def _faces(self) -> tuple[FloatArray, FloatArray]:
        """Return what half-spaces a plane, edge or box is made of: slack = offset + normal . point >= 0 within."""
        if self.kind == "edge":
            sin, cos = math.sin(0.5 * self.size[0]), math.cos(0.5 * self.size[0])
            return np.array([[0.0, cos, sin], [0.0, -cos, sin]]), np.zeros(2)
        if self.kind == "plane":
            return np.array([[0.0, 0.0, 1.0]]), np.zeros(1)
        a, b, c = self.size
        half = np.array([0.5 * a, 0.5 * a, 0.5 * b, 0.5 * b, 0.0, c])
        return np.repeat(np.eye(3), 2, axis=0) * np.tile([1.0, -1.0], 3)[:, None], half

    def _round(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return vectors from a sphere's centre or a cylinder's axis, and what of a direction counts."""
        counted = np.array([0.0 if self.kind == "cylinder" else 1.0, 1.0, 1.0])
        return (q - [0.0, 0.0, self.size[0]]) * counted, counted

    def depth(self, points: npt.ArrayLike) -> FloatArray:
        """Return how deep points (..., 3) lie in it [mm], below 0 outside; not of a mesh."""
        if self.mesh is not None:
            raise ContactError("a mesh has no depth of its own; press it into a skin")
        return self._depth(self._local(points))

    def _depth(self, q: FloatArray) -> FloatArray:
        if self.kind in ("sphere", "cylinder"):
            e = self._round(q)[0]
            return np.asarray(self.size[0] - np.sqrt(np.einsum("...i,...i->...", e, e)))
        normals, offsets = self._faces()
        return np.asarray((q @ normals.T + offsets).min(axis=-1))

    def indentation(self, points: FloatArray, normals: FloatArray, thickness_mm: float) -> FloatArray:
        """Return how far the skin at points (..., 3) yields along its normals [mm]; 0 or below where it is not touched.

        It is touched where the object is met on the way in. A skin that would have to yield by more than its thickness
        yields inf.
        """
        return self._indentation(self._local(points), normals @ self.axes.T, thickness_mm)

    def _indentation(self, q: FloatArray, n: FloatArray, thickness_mm: float | FloatArray) -> FloatArray:
        if self.mesh is not None:
            return self.mesh.indentation(q, n, float(np.max(thickness_mm)))
        if self.kind in ("sphere", "cylinder"):
            e, counted = self._round(q)
            n = n * counted
            along, square = np.einsum("...i,...i->...", e, n), np.einsum("...i,...i->...", n, n)
            beyond = np.einsum("...i,...i->...", e, e) - self.size[0] ** 2
            half = np.sqrt(np.maximum(along**2 - square * beyond, 0.0))
            met = (half > 0.0) & (along - half < thickness_mm * square)
            with np.errstate(divide="ignore", invalid="ignore"):  # the further root, without cancellation
                out = np.where(along >= 0.0, (along + half) / square, beyond / (along - half))
            return np.asarray(np.where(met, out, -_FAR))
        faces, offsets = self._faces()
        slack, steep = q @ faces.T + offsets, n @ faces.T
        with np.errstate(divide="ignore", invalid="ignore"):
            cut = slack / steep
        out = np.where(steep > _PARALLEL, cut, np.inf).min(axis=-1)
        into = np.where(
            steep < -_PARALLEL, cut, np.where((slack < 0.0) & (steep <= _PARALLEL), np.inf, -np.inf)
        )
        into = into.max(axis=-1)
        return np.asarray(np.where((into <= out) & (into < thickness_mm), out, -_FAR))

    def touch(self, points: FloatArray, normals: FloatArray, thickness_mm: float) -> FloatArray:
        """Return what is above 0 where the skin at points (..., 3) is touched, and changes as steadily as it can.

        That is the depth, but where the object reaches under a point beside it, as a box's corner does.
        """
        return self.touch_in_own_frame(self._local(points), normals @ self.axes.T, thickness_mm)

    def touch_in_own_frame(
        self, q: FloatArray, n: FloatArray, thickness_mm: float | FloatArray
    ) -> FloatArray:
        """Return `touch` at points and normals (..., 3) in its own frame; thickness (...) may be each point's own."""
        if self.mesh is not None:
            return np.minimum(self._indentation(q, n, thickness_mm), thickness_mm)
        found = self._depth(q)
        thickness = np.broadcast_to(thickness_mm, found.shape)
        beside = (found <= 0.0) & (found > -thickness)
        if self.kind != "plane" and beside.any():
            found[beside] = under(found[beside], self._indentation(q[beside], n[beside], thickness[beside]))
        return found

    def gap(self, points: FloatArray) -> FloatArray:
        """Return how far it must be moved on to touch each of the points (..., 3) [mm]; inf where it never does."""
        q = self._local(points)
        x, y, z = np.moveaxis(q, -1, 0)
        if self.mesh is not None:
            return np.asarray(self.mesh.lowest(x, y) - z)
        radius = self.size[0] if self.size else 0.0
        if self.kind == "plane":
            lead = np.zeros_like(z)
        elif self.kind == "edge":
            lead = np.abs(y) / math.tan(0.5 * radius)
        elif self.kind == "box":
            lead = np.where(
                (np.abs(x) <= 0.5 * self.size[0]) & (np.abs(y) <= 0.5 * self.size[1]), 0.0, np.inf
            )
        else:
            square = y**2 + (x**2 if self.kind == "sphere" else 0.0)
            lead = np.where(
                square <= radius**2, radius - np.sqrt(np.maximum(radius**2 - square, 0.0)), np.inf
            )
        return np.asarray(lead - z)


def under(depth: FloatArray, yields: FloatArray) -> FloatArray:
    """Return depths, of points that the object reaches under a little above 0."""
    return np.where((depth <= 0.0) & (yields > 0.0), np.minimum(yields, _UNDER_MM), depth)


def _size(name: str, value: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not 0.0 < value < _FAR:
        raise ContactError(f"{name} = {value!r}: must be above 0 and below {_FAR:g}")
    return float(value)


def _vector(name: str, values: npt.ArrayLike) -> FloatArray:
    try:
        vector = np.array(values, dtype=float)
    except (TypeError, ValueError):
        vector = np.empty(0)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise ContactError(f"{name} = {values!r}: give three numbers, (x, y, z)")
    return vector
