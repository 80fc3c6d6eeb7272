"""The figures of chapter 3 that a model stands behind: 3.3, 3.4, 3.7 and 3.10, reproduced."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Wedge

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.plot.theme import COLOURS, SENSOR, STRIP, TRUE, add_axes, legend, new_figure, new_panels
from tacstrip.sensor.closed_form import k_h, k_l, k_metal
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.spec import Sensor
from tacstrip.surface.cylinder import strip_angle, strips_under_flat, tube_radius
from tacstrip.thesis.captions import by_number

Model: TypeAlias = Callable[[FloatArray, FloatArray, float], FloatArray]  # of l, w and L

_LINES = 21  # of the net drawn on a surface, each way
_FULL = 0.998  # longest contact drawn, over L: at w = L (3.8) is 0 / 0
_VIEW = (22.0, -112.0)  # elevation and azimuth [deg]: the corners w = L and l = L stand apart
_DEPTH_MM = 0.6  # how far the flat object of 3.10 sinks in, in the picture
_THICK_MM = 1.0  # of the rubber, in the picture only


def figure_3_3() -> Figure:
    """Signature k_h of a strip (CRS-CRS) over the contact's lower end l and length w, for l + w up to L."""
    return _surface("kh", k_h)


def figure_3_4() -> Figure:
    """Signature k_l of a strip (CRS-CRS) over the contact's lower end l and length w, for l + w up to L."""
    return _surface("kl", k_l)


def figure_3_7() -> Figure:
    """Signature k of a strip over metal (CRS-M) over l and w: all its values meet where w nears L."""
    return _surface("k", k_metal)


def figure_3_10() -> Figure:
    """Flat object on the Cyl-CRS-M prototype, and how many strips it touches at the depth it sinks in."""
    sensor = Sensor.load("prototype-cyl-crs-m")
    figure, (left, right) = new_panels(7.0, 3.6, 1, 2)
    _cross_section(left, sensor)
    _strips_over_depth(right, sensor)
    return figure


def surface_net(model: Model) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return l, w and a signature over the legal triangle, l + w up to L = 1, (lines, lines) each."""
    along, across = np.meshgrid(np.linspace(0.0, 1.0, _LINES), np.linspace(0.0, _FULL, _LINES))
    l = along * (1.0 - across)  # the net ends on l + w = L
    return l, across, model(l, across, 1.0)


def strips_touched_by_flat(sensor: Sensor, angle_rad: float, depth_mm: float) -> BoolArray:
    """Tell which strips of a tube (strips,) a flat object touches that is pressed on at an angle [rad]."""
    radius = tube_radius(sensor)
    off_axis = strip_angle(sensor, np.arange(sensor.strips, dtype=float)) - angle_rad
    reach = np.arccos(1.0 - depth_mm / radius) + 0.5 * sensor.strip_width / radius
    return np.asarray(np.abs(off_axis) <= reach + 1e-12)


def depth_limit(sensor: Sensor, most: int) -> float:
    """Return the greatest depth [mm], to 1/1000 of the radius, at which at most `most` strips are touched."""
    depths = np.linspace(0.0, tube_radius(sensor), 1001)
    return float(max(d for d in depths if strips_under_flat(sensor, float(d))[1] <= most))


def _surface(name: str, model: Model) -> Figure:
    """Draw one signature over the legal triangle, in units of L: a net of lines of equal w."""
    colours = LinearSegmentedColormap.from_list(name, ["#f4f1ea", COLOURS[name]])
    figure = new_figure(5.2, 4.4)
    axes: Any = add_axes(figure, 1, 1, 1, projection="3d")
    axes.plot_surface(
        *surface_net(model), cmap=colours, vmin=-0.2, vmax=1.0, edgecolor=TRUE, linewidth=0.25,
        rcount=_LINES, ccount=_LINES,
    )  # fmt: skip
    axes.plot([0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 0], color=TRUE, linewidth=1.0)
    axes.set(xlim=(0, 1), ylim=(0, 1), zlim=(0, 1), xlabel="l / L", ylabel="w / L")
    axes.set_zlabel(f"${SIGNATURES[name].symbol}$, over Vref", labelpad=4.0)
    axes.view_init(*_VIEW)
    axes.set_box_aspect((1.0, 1.0, 0.75), zoom=0.98)
    return figure


def _cross_section(axes: Axes, sensor: Sensor) -> None:
    """Draw the tube from its end, a flat object above it, and shade the strips that it touches."""
    radius, up = tube_radius(sensor), 0.5 * np.pi
    middle = float(strip_angle(sensor, np.array(0.5 * (sensor.strips - 1))))
    turn = up - middle  # the middle strip is drawn on top
    touched = strips_touched_by_flat(sensor, middle, _DEPTH_MM)
    axes.add_patch(Wedge((0, 0), radius - _THICK_MM, 0, 360, width=0.8, facecolor=SENSOR, edgecolor=TRUE))
    half = np.rad2deg(0.5 * sensor.strip_width / radius)
    for i in range(sensor.strips):
        angle = np.rad2deg(strip_angle(sensor, np.array(float(i))) + turn)
        colour = COLOURS["k"] if touched[i] else STRIP
        axes.add_patch(Wedge((0, 0), radius, angle - half, angle + half, width=_THICK_MM, facecolor=colour))
        x, y = 0.66 * radius * np.array([np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))])
        axes.text(x, y, f"{i + sensor.strip_base}", ha="center", va="center")
    bottom, side = radius - _DEPTH_MM, 0.95 * radius
    block = [(-side, bottom), (side, bottom), (side, bottom + 3.0), (-side, bottom + 3.0)]
    axes.add_patch(Polygon(block, facecolor=TRUE, alpha=0.25, edgecolor="none"))
    axes.plot([-side, side], [bottom, bottom], color=TRUE, linewidth=1.2)
    axes.text(0.0, bottom + 1.5, f"sunk in by {_DEPTH_MM} mm", ha="center", va="center")
    axes.text(0.0, 0.0, "tube", ha="center", va="center", color=TRUE)
    axes.set(xlim=(-1.15 * radius, 1.15 * radius), ylim=(-1.1 * radius, 1.35 * radius), aspect="equal")
    axes.set(xlabel="across the tube [mm]", ylabel="height above the axis [mm]")
    axes.set_title(f"green: the {touched.sum()} of {sensor.strips} strips in touch", fontsize=9.0)


def _strips_over_depth(axes: Axes, sensor: Sensor) -> None:
    """Plot the fewest and the most strips that can be touched over the depth."""
    depth = np.linspace(0.0, 2.0, 801)
    fewest, most = np.array([strips_under_flat(sensor, float(d)) for d in depth]).T
    axes.fill_between(depth, fewest, most, step="post", color=COLOURS["k"], alpha=0.15, linewidth=0.0)
    axes.step(depth, most, where="post", color=COLOURS["k"], label="most")
    axes.step(depth, fewest, "--", where="post", color=COLOURS["k"], label="fewest")
    limit = depth_limit(sensor, 2)
    axes.axvline(limit, ymax=0.88, color=TRUE, linewidth=0.8, linestyle=":")
    axes.text(limit + 0.03, 0.15, f"up to {limit:.2f} mm: two at most", color=TRUE, va="center")
    axes.set(xlim=(0.0, 2.0), ylim=(-0.15, sensor.strips + 0.6), yticks=range(sensor.strips + 1))
    axes.set(xlabel="depth that the object sinks in [mm]", ylabel="strips touched")
    legend(axes, loc="upper left", ncols=2)


FIGURES = by_number(globals())
