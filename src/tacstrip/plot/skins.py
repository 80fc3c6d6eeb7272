"""An object pressed into a skin: in space, and the skin unrolled."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from tacstrip.arguments import takes
from tacstrip.arrays import FloatArray, finite_runs
from tacstrip.contact.press.patch import Patch
from tacstrip.contact.press.solid import Solid
from tacstrip.plot.scene import draw_sensor, number_strips, x_label
from tacstrip.plot.theme import (
    OTHERS,
    RECOVERED,
    SENSOR,
    TRUE,
    add_axes,
    axes_or_new,
    legend_above,
    legend_below,
    new_figure,
)
from tacstrip.sensor.spec import Sensor
from tacstrip.surface.skin import Skin, skin_of

_GRID = (49, 25)  # of the skin as it is drawn
_REACH = 0.9  # of the skin's size: how far an endless object is drawn
_MOST_FACES = 4000
_MOST_STRIPS = 60  # drawn one by one
_ZOOM = 0.66  # that the axes' names fit in
_LABEL_PAD = 9.0  # of the axes' names [points]
_FRAMES = 6  # of a film strip
_AZIM = -60.0  # from where a skin is seen that nothing touches [deg]


@takes(sensor=Sensor, patch=Patch)
def skin(sensor: Sensor, patch: Patch | None = None, *, ax: Axes | None = None) -> Axes:
    """Draw a skin in space, and what is pressed into it: touched strips thick, the patch outlined.

    Parameters
    ----------
    sensor
        Flat, round a tube, or on a surface of its own.
    patch
        What `ts.press` returned; None: the skin alone.
    ax
        Axes in space, as `fig.add_subplot(projection="3d")` makes them; None: new ones on a figure of their own.

    Returns
    -------
    Axes
        x, y and z of space [mm].

    Raises
    ------
    ArgumentError
        The axes are flat.

    Examples
    --------
    >>> import tacstrip as ts
    >>> from tacstrip import plot
    >>> fingertip = ts.Sensor.load("fingertip")
    >>> pen = ts.Solid.cylinder(4.0).at((20, 0, 20), (-1, 0, -1))
    >>> ax = plot.skin(fingertip, ts.press(fingertip, pen, depth_mm=1.5))
    >>> ax.get_zlabel()
    'z [mm]'
    """
    axes = axes_or_new(ax, 5.0, 4.6, projection="3d")
    _draw_space(axes, skin_of(sensor), patch)
    return axes


def press_figure(sensor: Sensor, patch: Patch) -> Figure:
    """Return the picture of a patch: skin, object and patch in space, and l, u and outline on the unrolled skin."""
    figure = new_figure(9.5, 4.8)
    skin(sensor, patch, ax=add_axes(figure, 1, 2, 1, projection="3d"))
    flat = add_axes(figure, 1, 2, 2)
    _draw_flat(flat, sensor, skin_of(sensor), patch)
    if flat.get_legend_handles_labels()[1]:
        legend_above(flat, 3)
    return figure


def film_figure(sensor: Sensor, times_s: Sequence[float], patches: Sequence[Patch]) -> Figure:
    """Return a film strip of patches: six of them at most, in space above and on the unrolled skin below."""
    shown = np.unique(np.linspace(0, len(patches) - 1, min(len(patches), _FRAMES)).round().astype(int))
    figure, n = new_figure(wide := 2.9 * len(shown) + 0.5, 5.6, widest=wide), len(shown)
    normals = np.nan_to_num([p.normal for p in patches]).sum(axis=0)
    azim = float(np.degrees(np.arctan2(normals[1], normals[0]))) + 50.0 if normals.any() else _AZIM
    for column, i in enumerate(shown, 1):
        space: Any = skin(sensor, patches[i], ax=add_axes(figure, 2, n, column, projection="3d"))
        space.view_init(elev=25.0, azim=azim)  # all from one side
        space.set_title(f"{times_s[i]:.4g} s")
        flat = add_axes(figure, 2, n, n + column)
        _draw_flat(flat, sensor, skin_of(sensor), patches[i])
        if column > 1:
            flat.set_ylabel("")
        handles, labels = flat.get_legend_handles_labels()
    legend_below(figure, dict(zip(labels, handles, strict=True)))
    return figure


def _draw_flat(flat: Axes, sensor: Sensor, skin: Skin, patch: Patch) -> None:
    """Draw what is touched of each strip, and the patch's outline, on the unrolled skin."""
    draw_sensor(flat, sensor)
    number_strips(flat, sensor)
    flat.set_aspect("auto")
    on = np.flatnonzero(patch.touched)
    flat.vlines(
        sensor.x_mm[on], patch.l[on], patch.u[on], color=RECOVERED, linewidth=3.0, label="touched: l to u"
    )
    lengths = skin.lengths_mm
    if lengths.min() < lengths.max():
        flat.plot(sensor.x_mm, lengths, ".", color=TRUE, markersize=3.0, label="end of the strip")
    for i, ring in enumerate(finite_runs(patch.outline_xyz, 2)):
        flat.plot(*skin.unrolled(ring).T, color=OTHERS[0], linewidth=1.2, label=None if i else "outline")
    if sensor.closed:
        for x in (0.0, sensor.width_mm):
            flat.axvline(x, color=TRUE, linewidth=0.8, linestyle=":", label=None if x else "seam")
    flat.set(xlabel=x_label(sensor, "unrolled: strip times pitch [mm]"))
    flat.set_title(f"{patch.area_mm2:.4g} mm$^2$, {patch.force_n:.3g} N")


def _draw_space(axes: Any, skin: Skin, patch: Patch | None) -> None:
    across = np.linspace(*_covered(skin), _GRID[0])
    up = np.linspace(*skin.up, _GRID[1])
    surface = skin.points(across[:, None], up)
    axes.plot_surface(
        *np.moveaxis(surface, -1, 0), color=SENSOR, alpha=0.55, linewidth=0.0, rstride=1, cstride=1
    )
    if skin.strips <= _MOST_STRIPS:
        y = np.linspace(0.0, 1.0, 40)
        on = np.zeros(skin.strips, dtype=bool) if patch is None else patch.touched
        for strip, (length, touched) in enumerate(zip(skin.lengths_mm, on, strict=True)):
            line = skin.points(*skin.places(np.array(float(strip)), length * y))
            axes.plot(*line.T, color=RECOVERED if touched else TRUE, linewidth=1.4 if touched else 0.5)
    if patch is not None:
        _draw_object(axes, patch.solid, float(np.ptp(surface.reshape(-1, 3), axis=0).max()))
        for ring in finite_runs(patch.outline_xyz, 2):
            axes.plot(*ring.T, color=OTHERS[0], linewidth=2.0, zorder=10)
    points = surface.reshape(-1, 3)
    low, high = points.min(axis=0), points.max(axis=0)
    half = 0.65 * np.maximum(high - low, 0.4 * (high - low).max())
    for name, at, reach in zip("xyz", 0.5 * (low + high), half, strict=True):
        getattr(axes, f"set_{name}lim")(at - reach, at + reach)
        getattr(axes, f"set_{name}label")(f"{name} [mm]", labelpad=_LABEL_PAD)
        getattr(axes, f"{name}axis").set_major_locator(MaxNLocator(4))
    axes.set_box_aspect(half / half.max(), zoom=_ZOOM)
    azim = _AZIM
    if patch is not None:
        out = patch.normal if np.isfinite(patch.normal).all() else -patch.solid.toward
        azim = float(np.degrees(np.arctan2(out[1], out[0]))) + 50.0
    axes.view_init(elev=25.0, azim=azim)


def _covered(skin: Skin) -> tuple[float, float]:
    """Return the span across that strips cover."""
    return skin.across if skin.surface is None or not skin.round else (0.0, skin.surface.around)


def _draw_object(axes: Any, solid: Solid, size: float) -> None:
    """Draw the object about the place where it is pressed, as far as the skin is large."""
    style = {"color": OTHERS[1], "alpha": 0.25, "linewidth": 0.0}
    if solid.mesh is not None:
        mesh = solid.mesh.mesh
        faces = mesh.faces[:: max(1, len(mesh.faces) // _MOST_FACES)]
        x, y, z = (mesh.vertices @ solid.axes + solid.position_mm).T
        axes.plot_trisurf(x, y, z, triangles=faces, **style)
        return
    reach = _REACH * size
    for grid in _sheets(solid, reach):
        points = grid @ solid.axes + solid.position_mm
        axes.plot_surface(*np.moveaxis(points, -1, 0), rstride=1, cstride=1, **style)


def _sheets(solid: Solid, reach: float) -> list[FloatArray]:
    """Return an object's surface as grids (A, B, 3) in its own frame."""
    line, turn = np.linspace(-0.5 * reach, 0.5 * reach, 9), np.linspace(0.0, 2.0 * np.pi, 33)
    u, v = np.meshgrid(line, line, indexing="ij")
    if solid.kind == "plane":
        return [np.stack([u, v, np.zeros_like(u)], axis=-1)]
    if solid.kind == "edge":
        side = 0.5 * (v + 0.5 * reach)
        half = 0.5 * solid.size[0]
        return [np.stack([u, s * side * np.sin(half), side * np.cos(half)], axis=-1) for s in (1.0, -1.0)]
    if solid.kind == "cone":
        u, v = np.meshgrid(0.5 * (line + 0.5 * reach), turn, indexing="ij")
        wide = u * np.sin(0.5 * solid.size[0])
        return [np.stack([wide * np.cos(v), wide * np.sin(v), u * np.cos(0.5 * solid.size[0])], axis=-1)]
    if solid.kind == "box":
        a, b, c = solid.size
        corners = [
            np.array([x, y, z]) for z in (0.0, c) for y in (-0.5 * b, 0.5 * b) for x in (-0.5 * a, 0.5 * a)
        ]
        sides = ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 4, 5), (2, 3, 6, 7), (0, 2, 4, 6), (1, 3, 5, 7))
        return [np.array([corners[i] for i in side]).reshape(2, 2, 3) for side in sides]
    radius = solid.size[0]
    if solid.kind == "cylinder":
        u, v = np.meshgrid(line, turn, indexing="ij")
        return [np.stack([u, radius * np.sin(v), radius * (1.0 - np.cos(v))], axis=-1)]
    u, v = np.meshgrid(np.linspace(0.0, np.pi, 17), turn, indexing="ij")
    return [radius * np.stack([np.sin(u) * np.cos(v), np.sin(u) * np.sin(v), 1.0 - np.cos(u)], axis=-1)]
