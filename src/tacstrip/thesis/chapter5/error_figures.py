"""Figures 5.1-5.4, reproduced: where errors come from, and what the mismatch coefficient measures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.transforms import Affine2D

from tacstrip.arrays import FloatArray
from tacstrip.contact.footprint import footprint
from tacstrip.contact.shape import Contact
from tacstrip.geometry.metrics import clean_polygon, mismatch_coefficient
from tacstrip.plot.scene import draw_contact, draw_polygon, draw_sensor
from tacstrip.plot.theme import (
    COLOURS,
    OTHERS,
    RECOVERED,
    TRUE,
    add_axes,
    legend,
    new_axes,
    new_figure,
    new_panels,
)
from tacstrip.sensor.spec import Sensor
from tacstrip.simulation import simulate
from tacstrip.thesis.captions import by_number

SENSOR = Sensor(construction="crs-crs", strips=16, pitch_mm=10.0, length_mm=160.0, strip_width_mm=7.0)
OBJECT = Contact.polygon([(18, 62), (92, 21), (141, 88), (70, 134)])
PRESSED = Contact.polygon([(18, 62), (92, 21), (138.5, 85), (104, 109.5), (70, 134)])  # an edge hovers
SKEW_RAD = np.deg2rad(3.0)  # of the upper strips over the lower ones
A = np.array([(0.0, 0.0), (60.0, 0.0), (60.0, 40.0), (0.0, 40.0)])
B = np.array([(85.0, 0.0), (155.0, 8.0), (143.0, 46.0), (105.0, 52.0), (79.0, 30.0)])
_SIDES = {"A": (A, OTHERS[0], "-"), "B": (B, RECOVERED, "--")}
SHADE = "#dcdcdc"
_PROFILE_II = 0.01  # of Vref: P.U. profile II (table 5.1)


@dataclass(frozen=True)
class Alignment:
    """Two turning functions in the alignment of the mismatch coefficient.

    Attributes
    ----------
    s
        Where pieces begin and end, in parts of the perimeter, from 0 to 1 (P + 1,).
    theta_a, theta_b
        The turning functions on the pieces (P,) [rad].
    mc
        The area between them [rad].
    """

    s: FloatArray
    theta_a: FloatArray
    theta_b: FloatArray
    mc: float


def figure_5_1() -> Figure:
    """Edge of a contact as strips of finite width read it: a stair, as each reads on its centre line."""
    l, u = footprint(SENSOR, OBJECT)
    figure, axes = new_axes(5.4, 4.6)
    draw_sensor(axes, SENSOR)
    half = 0.5 * SENSOR.pitch_mm
    for x, low, high in zip(SENSOR.x_mm, l, u, strict=True):
        box = Rectangle((x - half, low), 2.0 * half, high - low, facecolor=COLOURS["profile"], alpha=0.25)
        axes.add_patch(box)
    x = np.append(SENSOR.x_mm - half, SENSOR.width_mm)
    for end, label in ((l, "read: l and u of each strip"), (u, None)):
        axes.stairs(end, x, baseline=None, color=COLOURS["profile"], label=label)
    draw_contact(axes, OBJECT, "object")
    run, rise = (np.roll(OBJECT.vertices, -1, axis=0) - OBJECT.vertices).T
    off = half * np.abs(rise / run).max()
    axes.set_title(f"an edge's stair leaves it by up to {off:.1f} mm", fontsize=9.0)
    legend(axes, loc="upper right", frameon=True, framealpha=1.0)
    return figure


def figure_5_2() -> Figure:
    """Imperfect contacts and what they do to k_h: upper strips askew, and an edge that is not pressed down.

    Where strips cross at an angle, each pair is read about along the line midway between the two.
    """
    figure = new_figure(7.0, 6.2)
    skewed = OBJECT.turned(-0.5 * SKEW_RAD, (0.5 * SENSOR.width_mm, 0.5 * SENSOR.length_mm))
    top = [add_axes(figure, 2, 2, i, anchor="S") for i in (1, 2)]
    for axes in top:
        draw_sensor(axes, SENSOR)
        draw_contact(axes, OBJECT, "object")
    _draw_skewed_strips(top[0])
    top[0].set_title(f"(a) upper strips (green) {np.rad2deg(SKEW_RAD):.0f} degrees askew", fontsize=9.0)
    draw_contact(top[1], PRESSED, "in touch", COLOURS["profile"])
    top[1].set_title("(b) touched (purple) but for an edge", fontsize=9.0)
    ideal, below = simulate(SENSOR, OBJECT)["kh"], add_axes(figure, 2, 2, 3)
    for axes, contact in ((below, skewed), (add_axes(figure, 2, 2, 4, sharey=below), PRESSED)):
        off = simulate(SENSOR, contact)["kh"] - ideal
        axes.bar(SENSOR.x_mm, 100.0 * off, SENSOR.strip_width, color=COLOURS["kh"], zorder=2)
        axes.axhspan(-100.0 * _PROFILE_II, 100.0 * _PROFILE_II, color=SHADE, label="P.U. profile II")
        axes.set(xlabel="digital dimension x [mm]", ylabel="error of $k_h$ [% of Vref]")
        axes.set_xlim(top[0].get_xlim())
        legend(axes, loc="lower left")
    return figure


def figure_5_3() -> Figure:
    """Two polygons A and B, and their turning functions over the perimeter's parts."""
    figure, (left, right) = new_panels(7.0, 3.2, 1, 2)
    for name, (corners, colour, line) in _SIDES.items():
        draw_polygon(left, corners, colour, name, dashed=line == "--")
        left.plot(*corners[0], "o", color=colour, markersize=8.0, fillstyle="none")
        s, theta = turning_function(corners)
        right.stairs(theta, s, baseline=None, color=colour, linestyle=line, label=f"$\\theta_{name}$")
    left.set(aspect="equal", xlabel="x [mm]", ylabel="y [mm]", ylim=(-10.0, 80.0))
    left.set_title("a ring marks the start, s = 0", fontsize=9.0)
    _name_turning_axes(right)
    legend(left, loc="upper left", ncols=2)
    return figure


def figure_5_4() -> Figure:
    """Mismatch coefficient of A and B: the area left between the turning functions at best start and turn."""
    best = best_alignment(A, B)
    figure, axes = new_axes(6.0, 3.8)
    axes.stairs(best.theta_a, best.s, baseline=best.theta_b, fill=True, color=TRUE, alpha=0.3)
    for theta, name in ((best.theta_a, "A"), (best.theta_b, "B")):
        _, colour, line = _SIDES[name]
        axes.stairs(theta, best.s, baseline=None, color=colour, linestyle=line, label=f"$\\theta_{name}$")
    _name_turning_axes(axes)
    coefficient = mismatch_coefficient(A, B)
    axes.set_title(f"shaded: {best.mc:.4f} rad; M.C. = {coefficient:.4f} rad", fontsize=9.0)
    return figure


def turning_function(corners: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return where a polygon's sides begin and end, in parts of the perimeter (N + 1,), and their angles.

    The first side begins at the first corner, at s = 0; angles (N,) [rad] grow counter-clockwise from there.
    """
    z = clean_polygon(corners) @ np.array([1.0, 1.0j])
    side = np.append(z[1:], z[0]) - z
    angle = np.angle(side[0]) + np.append(0.0, np.cumsum(np.angle(side[1:] / side[:-1])))
    s = np.append(0.0, np.cumsum(np.abs(side)))
    return s / s[-1], angle


def best_alignment(a: npt.ArrayLike, b: npt.ArrayLike) -> Alignment:
    """Find the start and rotation with the least area between two turning functions.

    For a start the best turn is the median difference, and the area has its least where a corner of one meets
    a corner of the other: all such starts are tried. `metrics.mismatch_coefficient` gives the area alone.
    """
    first, second = clean_polygon(a), clean_polygon(b)
    starts = ((i, j) for i in range(len(first)) for j in range(len(second)))
    aligned = (_align(np.roll(first, -i, axis=0), np.roll(second, -j, axis=0)) for i, j in starts)
    return min(aligned, key=lambda alignment: alignment.mc)


def _align(a: FloatArray, b: FloatArray) -> Alignment:
    """Align the turning functions of two polygons that both start at their first corner."""
    (s_a, theta_a), (s_b, theta_b) = turning_function(a), turning_function(b)
    s = np.union1d(s_a, s_b)
    middle, part = 0.5 * (s[:-1] + s[1:]), np.diff(s)
    on_a, on_b = (t[np.searchsorted(e, middle) - 1] for e, t in ((s_a, theta_a), (s_b, theta_b)))
    order = np.argsort(on_a - on_b)
    median = (on_a - on_b)[order][np.searchsorted(np.cumsum(part[order]), 0.5)]
    return Alignment(s, on_a, on_b + median, float(part @ np.abs(on_a - on_b - median)))


def _draw_skewed_strips(axes: Axes) -> None:
    """Draw the upper strips over the lower ones, turned about the sensor's middle."""
    x, y = 0.5 * SENSOR.width_mm, 0.5 * SENSOR.length_mm
    turn = Affine2D().rotate_around(x, y, SKEW_RAD) + axes.transData
    for at in SENSOR.x_mm:
        corner = (at - 0.5 * SENSOR.strip_width, 0.0)
        strip = Rectangle(corner, SENSOR.strip_width, SENSOR.length_mm, fill=False, edgecolor=COLOURS["k"])
        strip.set(linewidth=0.6, transform=turn)
        axes.add_patch(strip)


def _name_turning_axes(axes: Axes) -> None:
    axes.set(xlim=(0.0, 1.0), xlabel="s, part of the perimeter", ylabel="turning function $\\theta$ [rad]")
    legend(axes, loc="upper left")


FIGURES = by_number(globals())
