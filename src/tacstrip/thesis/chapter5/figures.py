"""Figures of chapter 5: where errors come from, what the mismatch coefficient measures, and shapes recovered."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from operator import itemgetter

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.transforms import Affine2D

from tacstrip.arrays import FloatArray
from tacstrip.contact.footprint import footprint
from tacstrip.contact.shape import Contact
from tacstrip.data.published import Row
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
from tacstrip.reconstruction.vertex.transitions import by_gradient
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.spec import Sensor
from tacstrip.simulation import simulate
from tacstrip.thesis.captions import by_number, captioned
from tacstrip.thesis.chapter5.ambiguity import AMBIGUOUS, CONCAVE, recoveries
from tacstrip.thesis.chapter5.tables import NOISES
from tacstrip.thesis.shapes import SHAPES, SIMULATED

# Figure: (shape, position, signature) whose noisy signature defeats the search for transitions.
NOISY = {"5.9": ("triangle", 4, "kh"), "5.14": ("tetragon", 3, "kh")}


def recovery_caption(row: Row) -> str:
    """Return the caption of a row's figure."""
    method = "P.R." if row.algorithm == "profile" else f"V.R. with ${SIGNATURES[row.signature or ''].symbol}$"
    return f"{row.shape}, {row.construction.upper()}, {method}; {row.noise}"


def recovery(row: Row, samples: Sequence[FloatArray]) -> Figure:
    """Draw the five placed shapes and one recovery of each (N, 2) [mm], empty where it failed."""
    figure, axes = _sensor_axes(SIMULATED[row.construction].construction)
    colour = COLOURS[row.signature or "profile"]
    for position, sample in enumerate(samples):
        _draw_pair(axes, row.shape, position, sample, colour)
    axes.set_title(textwrap.fill(f"Figure {row.figure}: {recovery_caption(row)}", 52))
    legend(axes, loc="upper left")
    return figure


def _noisy_caption(figure: str) -> str:
    shape, position, name = NOISY[figure]
    symbol = SIGNATURES[name].symbol
    return f"${symbol}$-signature of {shape} {position + 1}, noise-free and with P.U. profile II"


def noisy_signature(figure: str) -> Figure:
    """Draw a noise-free and a noisy signature, the true transitions, and those that the gradient rule finds."""
    shape, position, name = NOISY[figure]
    sensor, contact = SIMULATED["crs-crs"], SHAPES[shape].contact(position)
    noises = NOISES["ideal"], NOISES["quantisation + profile II"]
    clean, noisy = (simulate(sensor, contact, noise, rng=0) for noise in noises)
    run = clean.runs()[0]
    x = sensor.x_mm[run]
    drawing, axes = new_axes(6.0, 4.0)
    axes.plot(x, noisy[name][run], color=COLOURS[name], linewidth=0.7, alpha=0.7, label="profile II")
    axes.plot(x, clean[name][run], color="black", linewidth=1.4, label="noise-free")
    for i, true in enumerate(SHAPES[shape].transitions(position)):
        axes.axvline(true, color="#888888", linestyle=":", label=None if i else "true transitions")
    found = by_gradient(x, noisy[name][run], sensor.pitch_mm)[1:-1]
    low = axes.get_ylim()[0]
    axes.plot(found, np.full(len(found), low), "^", color=COLOURS[name], clip_on=False,
              label=f"found by the gradient rule: {len(found)}")  # fmt: skip
    axes.set_title(textwrap.fill(f"Figure {figure}: {_noisy_caption(figure)}", 60))
    axes.set(xlabel="x [mm]", ylabel=f"${SIGNATURES[name].symbol}$")
    legend(axes)
    return drawing


def ambiguity(figure: str) -> Figure:
    """Draw V.R.'s result for the concave tetragon from ideal readings."""
    construction, name = AMBIGUOUS[figure]
    drawing, axes = _sensor_axes(construction)
    for position, (_, found) in enumerate(recoveries(figure)):
        _draw_pair(axes, CONCAVE.name, position, found.vertices, COLOURS[name])
    axes.set_title(textwrap.fill(f"Figure {figure}: {_ambiguity_caption(figure)}", 52))
    legend(axes, loc="upper left")
    return drawing


def _ambiguity_caption(figure: str) -> str:
    construction, name = AMBIGUOUS[figure]
    symbol = SIGNATURES[name].symbol
    return f"concave tetragon, ideal {construction.upper()}, V.R. with ${symbol}$: another shape"


def _sensor_axes(construction: str) -> tuple[Figure, Axes]:
    figure, axes = new_axes(5.2, 5.2)
    draw_sensor(axes, SIMULATED[construction])
    return figure, axes


def _draw_pair(axes: Axes, shape: str, position: int, recovered: FloatArray, colour: str) -> None:
    contact = SHAPES[shape].contact(position)
    draw_contact(axes, contact, label=None if position else "original")
    x, y = contact.centroid
    axes.text(x, y, str(position + 1), fontsize=8.0, ha="center", va="center", zorder=5)
    if len(recovered):
        draw_polygon(axes, recovered, colour, label=None if position else "recovered")
    else:
        below = (contact.centroid[0], contact.vertices[:, 1].min())
        axes.annotate("not recovered", below, fontsize=7.0, ha="center", va="top", color=colour)


SENSOR = Sensor(construction="crs-crs", strips=16, pitch_mm=10.0, length_mm=160.0, strip_width_mm=7.0)
OBJECT = Contact.polygon([(18, 62), (92, 21), (141, 88), (70, 134)])
PRESSED = Contact.polygon([(18, 62), (92, 21), (138.5, 85), (104, 109.5), (70, 134)])  # an edge hovers
SKEW_RAD = np.deg2rad(3.0)  # of the upper strips over the lower ones
A = np.array([(0.0, 0.0), (60.0, 0.0), (60.0, 40.0), (0.0, 40.0)])
B = np.array([(85.0, 0.0), (155.0, 8.0), (143.0, 46.0), (105.0, 52.0), (79.0, 30.0)])
_SIDES = {"A": (A, OTHERS[0], "-"), "B": (B, RECOVERED, "--")}
SHADE = "#dcdcdc"
_PROFILE_II = 0.01  # of Vref: P.U. profile II (table 5.1)


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
    area, s, theta_a, theta_b = best_alignment(A, B)
    figure, axes = new_axes(6.0, 3.8)
    axes.stairs(theta_a, s, baseline=theta_b, fill=True, color=TRUE, alpha=0.3)
    for theta, name in ((theta_a, "A"), (theta_b, "B")):
        _, colour, line = _SIDES[name]
        axes.stairs(theta, s, baseline=None, color=colour, linestyle=line, label=f"$\\theta_{name}$")
    _name_turning_axes(axes)
    coefficient = mismatch_coefficient(A, B)
    axes.set_title(f"shaded: {area:.4f} rad; M.C. = {coefficient:.4f} rad", fontsize=9.0)
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


def best_alignment(a: npt.ArrayLike, b: npt.ArrayLike) -> tuple[float, FloatArray, FloatArray, FloatArray]:
    """Find the start and rotation with the least area between two turning functions.

    Returns that area [rad], where pieces begin and end, in parts of the perimeter, from 0 to 1 (P + 1,), and both
    functions on the pieces (P,) [rad].

    For a start the best turn is the median difference, and the area has its least where a corner of one meets
    a corner of the other: all such starts are tried. `metrics.mismatch_coefficient` gives the area alone.
    """
    first, second = clean_polygon(a), clean_polygon(b)
    starts = ((i, j) for i in range(len(first)) for j in range(len(second)))
    aligned = (_align(np.roll(first, -i, axis=0), np.roll(second, -j, axis=0)) for i, j in starts)
    return min(aligned, key=itemgetter(0))


def _align(a: FloatArray, b: FloatArray) -> tuple[float, FloatArray, FloatArray, FloatArray]:
    """Align the turning functions of two polygons that both start at their first corner."""
    (s_a, theta_a), (s_b, theta_b) = turning_function(a), turning_function(b)
    s = np.union1d(s_a, s_b)
    middle, part = 0.5 * (s[:-1] + s[1:]), np.diff(s)
    on_a, on_b = (t[np.searchsorted(e, middle) - 1] for e, t in ((s_a, theta_a), (s_b, theta_b)))
    order = np.argsort(on_a - on_b)
    median = (on_a - on_b)[order][np.searchsorted(np.cumsum(part[order]), 0.5)]
    return float(part @ np.abs(on_a - on_b - median)), s, on_a, on_b + median


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
FIGURES |= {f: captioned(_noisy_caption(f), noisy_signature, f) for f in NOISY}
FIGURES |= {f: captioned(_ambiguity_caption(f), ambiguity, f) for f in AMBIGUOUS}
