"""A triangle mesh that is pressed: what rays from the skin meet of it first. Needs `tacstrip[press]`: trimesh.

Rays are embreex' where that is installed, else trimesh's own, which are slower; that is said once.
"""

from __future__ import annotations

import importlib
import logging
import warnings
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.errors import ContactError, OptionError, one_of
from tacstrip.files import why_unreadable

_UNITS_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "inch": 25.4}
_SMALLEST_MM, _LARGEST_MM = 0.5, 5e3  # of an object: beyond, the unit is another
_MISS = -0.05  # mm: indentation where a ray meets nothing: not touched, and not far from it
_told: set[str] = set()
_NOWHERE = (
    logging.NullHandler()
)  # of what trimesh cannot read and does not need, such as normals, it logs tracebacks


@dataclass(frozen=True, eq=False)
class Mesh:
    """A mesh in the frame of its file [mm], outward normals where it has an inside.

    Attributes
    ----------
    mesh
        The `trimesh.Trimesh`.
    name
        Of its file.
    """

    mesh: Any
    name: str

    @classmethod
    def load(cls, path: str | Path | Any, unit: str) -> Self:
        """Read a file, or take a `trimesh.Trimesh`; errors as of `Solid.from_mesh`."""
        if unit not in _UNITS_MM:
            raise OptionError(one_of("unit", unit, _UNITS_MM))
        try:
            trimesh: Any = importlib.import_module("trimesh")
        except ImportError:
            raise ContactError('meshes need trimesh: pip install "tacstrip[press]"') from None
        name = str(path) if isinstance(path, str | Path) else "the mesh"
        if isinstance(path, str | Path):
            if why := why_unreadable(path):
                raise ContactError(f"{path}: {why}")
            if not Path(path).is_file():
                raise ContactError(f"{path}: no such file; give a mesh (.stl, .obj, .ply)")
            logging.getLogger("trimesh").addHandler(_NOWHERE)
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    found = trimesh.load(path, force="mesh", process=False)
            except Exception as error:  # each format's reader has errors of its own
                raise ContactError(f"{path}: cannot be read as a mesh (.stl, .obj, .ply): {error}") from None
        else:
            found = path.copy() if isinstance(path, trimesh.Trimesh) else None
        if not isinstance(found, trimesh.Trimesh) or not len(found.faces):
            raise ContactError(f"{name}: holds no triangles; give a mesh (.stl, .obj, .ply)")
        if not np.isfinite(found.vertices).all():
            raise ContactError(f"{name}: has corners that are not finite numbers")
        with np.errstate(over="ignore"):
            size = _UNITS_MM[unit] * float(np.ptp(found.bounds, axis=0).max())
        if not _SMALLEST_MM <= size <= _LARGEST_MM:
            other = "metres" if size < _SMALLEST_MM else "another unit"
            raise ContactError(
                f"{name}: is {size:.3g} mm large by unit={unit!r}; is it in {other}? Units "
                f"are: {', '.join(_UNITS_MM)}"
            )
        found.process()
        found.apply_scale(_UNITS_MM[unit])
        found.merge_vertices()
        if found.is_watertight:
            try:
                found.fix_normals()  # a mesh may be inside out
            except ImportError:
                raise ContactError(
                    f"{name}: its triangles are wound in different ways; repair it where it was made, "
                    "or pip install networkx, by which it is repaired here"
                ) from None
        return cls(found, name)

    @cached_property
    def _embree(self) -> Any:
        """The mesh for embreex' rays; None where it is not installed."""
        try:
            from embreex import rtcore_scene
            from embreex.mesh_construction import TriangleMesh
        except ImportError:
            if "slow" not in _told:
                _told.add("slow")
                logging.getLogger("tacstrip").warning(
                    "embreex is not installed: meshes are pressed by trimesh's own rays, which take long"
                )
            return None
        scene = rtcore_scene.EmbreeScene()
        TriangleMesh(scene, np.asarray(self.mesh.triangles, dtype=np.float32))
        return scene

    def _first(self, origins: FloatArray, directions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the distance to what rays (N, 3) meet first, inf for nothing, and the cosine to its normal."""
        low, high = self.mesh.bounds
        # Only rays that pass the mesh's box.
        with np.errstate(divide="ignore", invalid="ignore"):
            a, b = (low - origins) / directions, (high - origins) / directions
        near, far = np.fmin(a, b).max(axis=1), np.fmax(a, b).min(axis=1)
        asked = np.flatnonzero(far >= np.maximum(near, 0.0) - 1e-6)
        distance, cosine = np.full(len(origins), np.inf), np.zeros(len(origins))
        if len(asked):
            hit, far_off, face = self._hits(origins[asked], directions[asked])
            rows = asked[hit]
            distance[rows] = far_off
            cosine[rows] = np.einsum("ij,ij->i", self.mesh.face_normals[face], directions[rows])
        return distance, cosine

    def _hits(self, origins: FloatArray, directions: FloatArray) -> tuple[IntArray, FloatArray, IntArray]:
        """Return which rays meet the mesh, at what distance, and which face."""
        if (scene := self._embree) is not None:
            found = scene.run(origins.astype(np.float32), directions.astype(np.float32), output=True)
            hit = np.flatnonzero(found["primID"] >= 0)
            return hit, found["tfar"][hit].astype(float), found["primID"][hit].astype(np.int64)
        try:
            slow: Any = importlib.import_module("trimesh.ray.ray_triangle")
            rays = slow.RayMeshIntersector(self.mesh)
            place, ray, face = rays.intersects_location(origins, directions, multiple_hits=False)
        except ImportError:
            raise ContactError(
                'rays on meshes need embreex or rtree: pip install "tacstrip[press]"'
            ) from None
        off = np.reshape(place, (-1, 3)) - origins[ray]
        return ray, np.einsum("ij,ij->i", off, directions[ray]), face

    def indentation(self, points: FloatArray, normals: FloatArray, thickness_mm: float) -> FloatArray:
        """Return how far the skin yields (...) [mm], as `Solid.indentation`, in the mesh's frame."""
        p, n = points.reshape(-1, 3), normals.reshape(-1, 3)
        distance, cosine = self._first(p - thickness_mm * n, n)
        found = np.where(np.isfinite(distance), thickness_mm - distance, _MISS)
        if self.mesh.is_watertight:  # a ray that first comes out of the mesh began in it
            found[np.isfinite(distance) & (cosine > 0.0)] = np.inf
        elif (on := found > 0.0).any() and self.name not in _told:
            # Its faces may all be inside out: what looks the other way than those in touch is seen through a hole.
            within = np.isfinite(distance) & (cosine * cosine[on].sum() < 0.0)
            off = np.linalg.norm(p - p[on].mean(axis=0), axis=1)  # from the middle of what is touched
            if off[within].min(initial=np.inf) < off[on].max():
                _told.add(self.name)
                logging.getLogger("tacstrip").warning(
                    "%s is not closed, and the skin meets a hole in it, where nothing is touched: area and force are "
                    "too small; close the mesh",
                    self.name,
                )
        return np.asarray(found.reshape(points.shape[:-1]))

    def lowest(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the least z of the mesh over places [mm], of any shape; inf beside it."""
        low = self.mesh.bounds[0, 2] - 1.0
        origins = np.stack([x.ravel(), y.ravel(), np.full(x.size, low)], axis=1)
        distance, _ = self._first(origins, np.broadcast_to([0.0, 0.0, 1.0], origins.shape))
        return np.asarray((low + distance).reshape(x.shape))
