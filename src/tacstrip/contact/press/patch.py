"""An object pressed into a skin: where they touch, with what pressure, and what each strip has of it.

The skin is an elastic foundation: where it yields by d along its normal, it presses back with stiffness times d, and
its neighbourhood does not know of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from tacstrip.arguments import takes
from tacstrip.arrays import BoolArray, FloatArray, extent, touched_strips
from tacstrip.contact.press.solid import Solid
from tacstrip.core.solid import patch_sums
from tacstrip.errors import ContactError, OptionError
from tacstrip.sensor.spec import Sensor
from tacstrip.surface.skin import Skin, skin_of

_COARSE = (48, 32)  # the whole skin's grid, across and up
_FINE, _TIGHT = 64, 33  # of the grid over the patch; of the one that finds where it is
_ALONG = 192  # samples along a strip
# Of the search for the first touch: points a side, grids, and how much smaller each is; where gaps have sharp valleys.
_ZOOM, _SHARP_ZOOM = (33, 3, 0.0625), (17, 6, 0.2)
_SHORT_MM = 1e-3  # of differences
_PARTS, _ROUNDS = 32, 2  # that place an end between two samples: to so many parts, so often
_FEW = 12  # touched places of the coarse grid, fewer of which may miss some of a mesh
_FORCE_STEPS, _FORCE_TOLERANCE = 40, 1e-6
_SLACK = 1e-9


@dataclass(frozen=True, eq=False)
class Patch:
    """Where an object touches a skin; from `press`.

    Attributes
    ----------
    l, u
        Lower and upper end of the contact on each strip's centre line (strips,) [mm along the strip]; NaN untouched.
        Where a strip is touched in several places they are the outer ends.
    area_mm2
        Of the skin in touch, strips or not.
    force_n
        Force along the way that the object was pressed [N], by the skin's stiffness.
    force_xyz
        All of the force on the skin (3,) [N].
    moment_xyz
        Its moment about the origin (3,) [N mm].
    centroid_xyz, normal
        Mean of the skin's points in touch (3,) [mm], and their mean normal, a unit vector (3,).
    outline_xyz
        The outline (N, 3) [mm]; several are parted by a row of NaN. At the skin's border it may be open.
    depth_mm
        How far the object was pressed on from its first touch; NaN of an object that was not moved.
    max_indentation_mm
        How far the skin yields where it yields most.
    solid
        The object where it is now.

    Examples
    --------
    >>> import tacstrip as ts
    >>> fingertip = ts.Sensor.load("fingertip")
    >>> pen = ts.Solid.cylinder(4.0).at((20, 0, 20), toward=(-1, 0, -1), turn_rad=0.5)
    >>> patch = ts.press(fingertip, pen, force_n=2.0)
    >>> patch.touched.nonzero()[0].tolist(), round(patch.force_n, 3)
    ([0, 14, 15], 2.0)
    """

    l: FloatArray
    u: FloatArray
    area_mm2: float
    force_n: float
    force_xyz: FloatArray
    moment_xyz: FloatArray
    centroid_xyz: FloatArray
    normal: FloatArray
    outline_xyz: FloatArray
    depth_mm: float
    max_indentation_mm: float
    solid: Solid

    def __repr__(self) -> str:
        size = f"{self.area_mm2:.4g} mm2, {self.force_n:.4g} N"
        return f"<Patch of {size}: {touched_strips(self.touched)}, l {extent(self.l)}, u {extent(self.u)} mm>"

    @property
    def touched(self) -> BoolArray:
        """Whether each strip is touched (strips,)."""
        return np.asarray(~np.isnan(self.l))


@takes(sensor=Sensor, solid=Solid)
def press(
    sensor: Sensor, solid: Solid, *, depth_mm: float | None = None, force_n: float | None = None
) -> Patch:
    """Press an object into a sensor's skin, the way that it is meant to go, by a depth from its first touch or a force.

    Parameters
    ----------
    sensor
        Flat, a tube, or with a `[surface]`, which says how thick and how stiff the skin is; others have 3 mm and .1
        N/mm3. Objects come from the normals' side: the outside, or with `inside` the inside.
    solid
        The object at its pose: what counts is its direction and where beside it it is, not how far from the skin.
    depth_mm, force_n
        How far it is pressed on [mm], or how hard [N]; one of both.

    Returns
    -------
    Patch
        What is touched, with force and moment, and l and u for `simulate`.

    Raises
    ------
    ContactError
        The object does not meet the skin, or would sink in deeper than the skin is thick.
    OptionError
        Neither depth nor force is given, or both, or not above 0.

    Examples
    --------
    >>> import tacstrip as ts
    >>> fingertip = ts.Sensor.load("fingertip")
    >>> table = ts.Solid.plane().at((0, 0, 20), toward=(-1, 0, -1))
    >>> patch = ts.press(fingertip, table, depth_mm=1.0)
    >>> round(patch.area_mm2, 1), round(patch.force_n, 2)
    (62.8, 3.14)
    """
    wanted = _one_of(depth_mm, force_n)
    skin = skin_of(sensor)
    touching = solid.moved(first_touch(skin, solid))
    if force_n is None:
        try:
            found: Patch | None = patch_at(sensor, touching.moved(wanted), wanted)
        except ContactError:
            if wanted <= skin.thickness_mm:
                raise
            found = None
        if found is None or (wanted > skin.thickness_mm and not found.area_mm2 > 0.0):
            raise ContactError(
                f"the object sinks {wanted:g} mm into a skin of {skin.thickness_mm:g} mm: press less deep, or mend "
                "surface.thickness_mm"
            )
        return found
    low, high, over = 0.0, skin.thickness_mm, math.inf
    depth = 0.1 * high
    for _ in range(_FORCE_STEPS):  # regula falsi, halving where that is slow
        try:
            force = patch_load(skin, touching.moved(depth)).force_n
        except ContactError:
            force = math.inf
        if abs(force - wanted) <= _FORCE_TOLERANCE * wanted:
            return patch_at(sensor, touching.moved(depth), depth)
        if force < wanted:
            low, under = depth, force
        else:
            high, over = depth, force
        step = (wanted / force) ** 0.5 if 0.0 < force < math.inf else 2.0 if force == 0.0 else 0.5
        depth = depth * step if low < depth * step < high else 0.5 * (low + high)
        if high - low < _SLACK:
            break
    if over == math.inf:
        raise ContactError(
            f"force_n = {force_n}: {under:.3g} N press the object in by the skin's thickness, {skin.thickness_mm:g} mm"
        )
    return patch_at(sensor, touching.moved(depth), depth)


def _one_of(depth_mm: float | None, force_n: float | None) -> float:
    given = {name: v for name, v in (("depth_mm", depth_mm), ("force_n", force_n)) if v is not None}
    if len(given) != 1:
        raise OptionError("press needs one of depth_mm, how far [mm], and force_n, how hard [N]")
    ((name, value),) = given.items()
    number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
    if not number or not 0.0 < value < math.inf:
        raise OptionError(f"{name} = {value!r}: must be above 0")
    return float(value)


def patch_at(sensor: Sensor, solid: Solid, depth_mm: float = math.nan) -> Patch:
    """Return the patch of an object where it is; errors as of `press`."""
    skin = skin_of(sensor)
    load = patch_load(skin, solid)
    l, u = strip_ends(skin, solid)
    return Patch(
        l, u, load.area_mm2, load.force_n, load.force_xyz, load.moment_xyz, load.centroid_xyz, load.normal,
        load.outline(skin), depth_mm, load.deepest_mm, solid,
    )  # fmt: skip


def first_touch(skin: Skin, solid: Solid) -> float:
    """Return how far an object must be moved on to touch the skin [mm], below 0 where it lies in it: `ContactError`."""
    across, up, points, normals = _whole(skin)
    gaps = solid.gap(points, normals, 1e-3)
    if not np.isfinite(gaps.min(initial=np.inf)):
        x, y, z = solid.toward
        raise ContactError(
            f"pressed along ({x:.3g}, {y:.3g}, {z:.3g}) the object does not meet the skin: mend position or direction"
        )
    at = np.unravel_index(int(gaps.argmin()), gaps.shape)
    a, t, best = float(across[at[0]]), float(up[at[1]]), float(gaps[at])
    reach = max(float(np.abs(skin.stretch(up)).max()) * (across[1] - across[0]), up[1] - up[0])
    sharp = solid.kind in ("edge", "box", "cone")
    side, grids, smaller = _SHARP_ZOOM if sharp else _ZOOM
    i = np.linspace(-1.0, 1.0, side)
    j = i[:, None]
    for _ in range(grids):
        per = max(float(np.abs(skin.stretch(np.array(t)))), _SHORT_MM)
        ca, ct = _directions(skin, solid, a, t, per) if sharp else (1.0, 0.0)
        near_a = a + reach / per * (ca * i - ct * j if sharp else i)
        near_t = np.clip(t + reach * (ct * i + ca * j if sharp else j), *skin.up)
        if not skin.round:
            near_a = np.clip(near_a, *skin.across)
        near = solid.gap(skin.points(near_a, near_t), skin.normals(near_a, near_t))
        here = int(near.argmin())
        if near.flat[here] <= best:
            best = float(near.flat[here])
            a, t = (float(np.broadcast_to(v, near.shape).flat[here]) for v in (near_a, near_t))
        reach *= smaller
    return best


def _directions(skin: Skin, solid: Solid, across: float, up: float, per: float) -> tuple[float, float]:
    """Return cosine and sine of the object's x on the skin: the gap of an edge is a sharp valley along that."""
    places = ((0.0, 0.0), (_SHORT_MM / per, 0.0), (0.0, _SHORT_MM))
    here, aside, on = (skin.points(np.array(across + a), np.array(up + t)) for a, t in places)
    cos, sin = (aside - here) @ solid.axes[0], (on - here) @ solid.axes[0]
    long = math.hypot(cos, sin)
    return (float(cos / long), float(sin / long)) if long > 1e-3 * _SHORT_MM else (1.0, 0.0)


def strip_ends(skin: Skin, solid: Solid) -> tuple[FloatArray, FloatArray]:
    """Return l and u (strips,) [mm] of an object where it is; NaN where it does not touch a strip."""
    strip, y, points, normals = samples(skin)
    g = solid.touch(points, normals, skin.thickness_mm)  # (strips, samples)
    l, u = np.full(len(g), np.nan), np.full(len(g), np.nan)
    on = g > 0.0
    (touched,) = np.nonzero(on.any(axis=1))
    if not len(touched):
        return l, u
    first, last = on[touched].argmax(axis=1), on.shape[1] - 1 - on[touched, ::-1].argmax(axis=1)
    # Between the first sample that touches and the one before it; at a strip's end there is none.
    inner = np.concatenate([first, last])
    outer = np.clip(np.concatenate([first - 1, last + 1]), 0, on.shape[1] - 1)
    rows = np.concatenate([touched, touched])
    l[touched], u[touched] = np.split(_ends(skin, solid, strip[rows], y[rows, inner], y[rows, outer]), 2)
    return l, u


def _ends(skin: Skin, solid: Solid, strip: FloatArray, inner: FloatArray, outer: FloatArray) -> FloatArray:
    """Return where touch ends (N,) [mm] on strips, between y touched and y not touched."""
    rows, share = np.arange(len(strip)), np.linspace(0.0, 1.0, _PARTS + 1)
    y_in, y_out, g_in, g_out = inner, outer, np.ones(len(strip)), np.zeros(len(strip))
    for _ in range(_ROUNDS):  # in parts, for there may be jumps, as at a box's side
        y = y_in[:, None] + share * (y_out - y_in)[:, None]
        place = skin.places(strip[:, None], y)
        g = solid.touch(skin.points(*place), skin.normals(*place), skin.thickness_mm)
        off = g <= 0.0
        off[:, 0], off[:, -1] = False, True
        at = off.argmax(axis=1)
        (y_in, y_out), (g_in, g_out) = ((v[rows, at - 1], v[rows, at]) for v in (y, g))
    with np.errstate(divide="ignore", invalid="ignore"):
        part = np.clip(np.nan_to_num(g_in / (g_in - g_out)), 0.0, 1.0)
    return np.where(inner == outer, inner, y_in + part * (y_out - y_in))


@lru_cache(maxsize=16)
def samples(skin: Skin, count: int = _ALONG) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return strips (strips,), and y, points and normals of samples along their centre lines (strips, count, ...)."""
    strip = np.arange(skin.strips, dtype=float)
    y = skin.lengths_mm[:, None] * np.linspace(0.0, 1.0, count)
    place = skin.places(strip[:, None], y)
    return strip, y, skin.points(*place), skin.normals(*place)


@lru_cache(maxsize=16)
def _whole(skin: Skin) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return a coarse grid of the whole skin: across (A,), up (U,), points and normals (A, U, 3)."""
    count = _COARSE if skin.round else (_COARSE[0] + 1, _COARSE[1])
    across = np.linspace(*skin.across, count[0], endpoint=not skin.round)
    up = np.linspace(*skin.up, count[1])
    return across, up, skin.points(across[:, None], up), skin.normals(across[:, None], up)


@dataclass(frozen=True, eq=False)
class Load:
    """What an object does to the skin: integrals over the patch, and the grid they come from."""

    area_mm2: float
    force_n: float
    force_xyz: FloatArray
    moment_xyz: FloatArray
    centroid_xyz: FloatArray
    normal: FloatArray
    deepest_mm: float
    across: FloatArray
    up: FloatArray
    depth: FloatArray

    def outline(self, skin: Skin) -> FloatArray:
        """Return the outline (N, 3) [mm], pieces parted by NaN."""
        from contourpy import contour_generator

        lines = contour_generator(self.up, self.across, self.depth).lines(0.0)
        rings = [skin.points(line[:, 1], line[:, 0]) for line in lines]  # type: ignore[call-overload]
        parted = [part for ring in rings for part in (np.full((1, 3), np.nan), ring)]
        return np.concatenate(parted[1:]) if parted else np.empty((0, 3))


def patch_load(skin: Skin, solid: Solid, limited: bool = True) -> Load:
    """Integrate over the patch: errors as of `press`, but not `limited` by the skin's thickness none."""
    across, up = _box(skin, solid)
    points, normals = skin.points(across[:, None], up), skin.normals(across[:, None], up)
    depth, yields = solid.yields(points, normals, skin.thickness_mm)
    deepest = float(yields.max(initial=0.0))
    if limited and deepest > skin.thickness_mm * (1.0 + 1e-9):
        sinks = "deeper than" if deepest == math.inf else f"{deepest:.3g} mm into"
        raise ContactError(
            f"the object sinks {sinks} a skin of {skin.thickness_mm:g} mm: press less, or mend surface.thickness_mm"
        )
    by_across = np.zeros(len(across))
    by_across[1:] = 0.5 * np.diff(across)
    by_across[:-1] += by_across[1:]
    by_up = np.abs(skin.stretch(0.5 * (up[1:] + up[:-1]))) * np.diff(up)
    sums = patch_sums(depth, yields, points, normals, by_across, by_up)
    total, point, normal = float(sums[0]), sums[1:4], sums[4:7]
    force, moment = skin.stiffness_n_per_mm3 * sums[7:].reshape(2, 3)
    length = float(np.linalg.norm(normal))
    return Load(
        total, float(force @ solid.toward), force, moment, point / total if total else np.full(3, np.nan),
        normal / length if length else np.full(3, np.nan), deepest, across, up, depth,
    )  # fmt: skip


def _box(skin: Skin, solid: Solid) -> tuple[FloatArray, FloatArray]:
    """Return a fine grid over what an object touches: across (A,) and up (U,), closer towards its borders."""
    across, up, points, normals = _whole(skin)
    # A patch may lie between the grid's points: those near it count, by how far apart they are.
    apart = max(float(np.abs(skin.stretch(up)).max()) * (across[1] - across[0]), up[1] - up[0])
    near = solid.touch(points, normals, skin.thickness_mm) > (-0.75 * apart if solid.mesh is None else 0.0)
    if solid.mesh is not None and near.sum() < _FEW:
        gaps = solid.gap(points, normals)
        near |= np.abs(gaps) <= 0.25 * apart
        near.flat[int(gaps.argmin())] = True
    if not near.any():
        return across, up
    a, t = _around(skin, across, _any(near, 1), _TIGHT), _within(up, _any(near, 0), _TIGHT)
    near = solid.touch(skin.points(a[:, None], t), skin.normals(a[:, None], t), skin.thickness_mm) > 0.0
    if near.any():
        all_round = a[-1] - a[0] > 2.0 * np.pi - 1e-9 and skin.round
        a = a if all_round else _within(a, _any(near, 1), _TIGHT)
        t = _within(t, _any(near, 0), _TIGHT)
        if all_round:
            return np.linspace(a[0], a[-1], 2 * _FINE), _closer(t)
    return _closer(a), _closer(t)


def _any(on: BoolArray, axis: int) -> BoolArray:
    return np.asarray(on.any(axis=axis))


def _closer(grid: FloatArray) -> FloatArray:
    """Return a grid over the same range that is closer towards both ends."""
    share = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, _FINE))
    return np.asarray(grid[0] + (grid[-1] - grid[0]) * share)


def _within(grid: FloatArray, on: BoolArray, count: int) -> FloatArray:
    """Return a grid over the places that are on, and their neighbours."""
    there = np.flatnonzero(on)
    return np.linspace(grid[max(there[0] - 1, 0)], grid[min(there[-1] + 1, len(grid) - 1)], count)


def _around(skin: Skin, across: FloatArray, on: BoolArray, count: int) -> FloatArray:
    """Return a grid over the places across that are on, also over the seam; all round where they are."""
    if not skin.round:
        return _within(across, on, count)
    there, step = np.flatnonzero(on), across[1] - across[0]
    gaps = np.diff(np.concatenate([there, there[:1] + len(across)]))
    widest = int(gaps.argmax())
    if gaps[widest] <= 3:
        return np.linspace(0.0, 2.0 * np.pi, 2 * count)
    start, length = across[there[(widest + 1) % len(there)]], len(across) - gaps[widest]
    return np.linspace(start - step, start + (length + 1) * step, count)
