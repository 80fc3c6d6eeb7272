"""Objects that are pressed: plane, sphere, cylinder, edge, box, cone, or a triangle mesh, at a pose.

In an object's own frame its lowest place, which touches first, is the origin; z points from the skin into the object;
a cylinder's axis and an edge's ridge are x.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
import numpy.typing as npt

from tacstrip.arrays import FloatArray
from tacstrip.contact.press.mesh import Mesh
from tacstrip.core.solid import solid_gap, solid_touch, solid_yields
from tacstrip.errors import ContactError

_FAR = 1e6  # mm
_ANGLED = ("edge", "cone")  # whose size is an angle


@dataclass(frozen=True, eq=False)
class Solid:
    """An object and where it is; make one with `plane`, `sphere`, ... or `from_mesh`, then `at`.

    Attributes
    ----------
    kind
        "plane", "sphere", "cylinder", "edge", "box", "cone" or "mesh".
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

    kind: Literal["plane", "sphere", "cylinder", "edge", "box", "cone", "mesh"]
    size: tuple[float, ...] = ()
    position_mm: FloatArray = field(default_factory=lambda: np.zeros(3))
    axes: FloatArray = field(default_factory=lambda: np.eye(3))
    mesh: Mesh | None = None

    def __repr__(self) -> str:
        size = "" if not self.size else " of " + " x ".join(f"{s:.4g}" for s in self.size)
        unit = " rad" if self.kind in _ANGLED else " mm" if self.size else ""
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
        return cls("edge", (_angle("an edge", angle_rad),))

    @classmethod
    def cone(cls, angle_rad: float = 0.5 * math.pi) -> Self:
        """Make a cone without base, which touches with its tip, by the angle [rad] there between opposite sides."""
        return cls("cone", (_angle("a cone", angle_rad),))

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
        given = _vector("toward", toward)
        length = math.hypot(*given)  # whose squares may be too large for a float
        if not 0.0 < length < math.inf:
            shown = ", ".join(f"{v:.6g}" for v in given)
            raise ContactError(f"toward = ({shown}): give the direction in which the object is pressed")
        if not isinstance(turn_rad, int | float | np.number) or not math.isfinite(turn_rad):
            raise ContactError(f"turn_rad = {turn_rad!r}: must be a number")
        up = -given / length
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

    def _turned(self, vectors: npt.ArrayLike) -> FloatArray:
        """Return vectors (..., 3) in its own frame."""
        return np.asarray(np.asarray(vectors, dtype=float) @ self.axes.T)

    @cached_property
    def frame(self) -> FloatArray:
        """What `core.solid` knows of it (15,)."""
        half = 0.5 * self.size[0] if self.kind in _ANGLED else 0.0
        shape = (math.sin(half), math.cos(half)) if half else self.size
        return np.concatenate([self.axes.ravel(), self.position_mm, shape, np.zeros(3 - len(shape))])

    def depth(self, points: npt.ArrayLike) -> FloatArray:
        """Return how deep points (..., 3) lie in it [mm], below 0 outside; not of a mesh."""
        if self.mesh is not None:
            raise ContactError("a mesh has no depth of its own; press it into a skin")
        p = components(np.asarray(points, dtype=float))
        return solid_touch(self.kind, self.frame[None], p, None, 0.0).reshape(np.shape(points)[:-1])

    def touch(self, points: FloatArray, normals: FloatArray, thickness_mm: float) -> FloatArray:
        """Return what is above 0 where the skin at points (..., 3) is touched, and changes as steadily as it can.

        That is the depth, but where the object reaches under a point beside it, as a box's corner does.
        """
        if self.mesh is not None:
            return np.minimum(self._yields_to_mesh(points, normals, thickness_mm), thickness_mm)
        p, n = components(points), components(normals)
        return solid_touch(self.kind, self.frame[None], p, n, thickness_mm).reshape(points.shape[:-1])

    def yields(
        self, points: FloatArray, normals: FloatArray, thickness_mm: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return `touch`, and how far the skin at points (..., 3) yields along its normals [mm]: 0 or below untouched.

        It is touched where the object is met on the way in. A skin that would have to yield by more than its thickness
        yields inf.
        """
        if self.mesh is not None:
            found = self._yields_to_mesh(points, normals, thickness_mm)
            return found, found
        p, n = components(points), components(normals)
        touch, found = solid_yields(self.kind, self.frame[None], p, n, thickness_mm)
        return touch.reshape(points.shape[:-1]), found.reshape(points.shape[:-1])

    def _yields_to_mesh(self, points: FloatArray, normals: FloatArray, thickness_mm: float) -> FloatArray:
        assert self.mesh is not None
        return self.mesh.indentation(
            self._turned(points - self.position_mm), self._turned(normals), thickness_mm
        )

    def gap(self, points: FloatArray, normals: FloatArray, steepest: float = 0.0) -> FloatArray:
        """Return how far it must be moved on to touch the skin at points (..., 3) [mm].

        inf where it never does, or where the cosine between the skin's normal and its way out is not above `steepest`.
        """
        if self.mesh is not None:
            x, y, z = np.moveaxis(self._turned(points - self.position_mm), -1, 0)
            return np.where(normals @ self.axes[2] > steepest, self.mesh.lowest(x, y) - z, np.inf)
        p, n = components(points)[:, 0], components(normals)[:, 0]
        return solid_gap(self.kind, self.frame, p, n, steepest).reshape(points.shape[:-1])


def components(vectors: FloatArray) -> FloatArray:
    """Return vectors (..., 3) with components first (3, 1, K), as `core.solid` takes them."""
    return vectors.transpose(-1, *range(vectors.ndim - 1)).reshape(3, 1, -1)


def _size(name: str, value: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not 0.0 < value < _FAR:
        raise ContactError(f"{name} = {value!r}: must be above 0 and below {_FAR:g}")
    return float(value)


def _angle(what: str, angle_rad: float) -> float:
    if not 0.0 < _size("angle_rad", angle_rad) < math.pi:
        raise ContactError(f"angle_rad = {angle_rad}: {what} has between 0 and pi, and is not in degrees")
    return float(angle_rad)


def _vector(name: str, values: npt.ArrayLike) -> FloatArray:
    try:
        vector = np.array(values, dtype=float)
    except (TypeError, ValueError):
        vector = np.empty(0)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise ContactError(f"{name} = {values!r}: give three numbers, (x, y, z)")
    return vector
