"""The figures of chapter 4, made again: signatures, their ambiguity, their kinks, the blocks of sections."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.contact.footprint import footprint
from tacstrip.contact.shape import Contact
from tacstrip.contact.signature import geometric_centre
from tacstrip.plot.scene import draw_contact, draw_polygon, draw_sensor, draw_signatures, zoom
from tacstrip.plot.style import COLOURS, OTHERS, TRUE, add_axes, new_axes, new_figure
from tacstrip.reconstruct.result import close_chains
from tacstrip.reconstruct.sections import Section, fit_sections
from tacstrip.reconstruct.vertex import blocks, linear_system
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.spec import Sensor
from tacstrip.simulate import simulate
from tacstrip.studies.thesis.shapes import SIMULATED

Polygon = tuple[tuple[float, float], ...]

TETRAGON: Polygon = ((-150, 30), (60, -135), (150, -20), (-40, 125))
PLACES = {"lower": (170.0, 150.0), "middle": (500.0, 500.0), "upper": (830.0, 860.0)}  # centroids [mm]
UPPER_VERTEX: Polygon = ((200, 470), (800, 400), (520, 760))
LOWER_VERTEX: Polygon = ((200, 530), (520, 240), (800, 600))
HEXAGON: Polygon = ((100, 450), (400, 200), (750, 260), (900, 520), (620, 780), (250, 700))
OCTAGON: Polygon = (
    (90, 380), (440, 250), (570, 300), (910, 610), (830, 750), (700, 800), (290, 690), (190, 590)
)  # fmt: skip
FORK: Polygon = (
    (180, 200), (560, 130), (860, 260), (640, 330), (420, 390), (600, 520), (800, 620), (520, 800), (240, 640)
)  # fmt: skip

_CRS = SIMULATED["crs-crs"]
_OF = {name: sensor for sensor in SIMULATED.values() for name in sensor.signatures}  # who measures what
_LEGEND: dict[str, Any] = {"frameon": False, "fontsize": 8.0}
_TITLE: dict[str, Any] = {"fontsize": 9.0}
_FAINT: dict[str, Any] = {"color": TRUE, "linewidth": 0.8, "linestyle": ":"}


def figure_4_1() -> Figure:
    """Object of any shape on a sensor of 40 strips: its geometric signature and its pseudo-signatures."""
    angle = np.linspace(0.0, 2.0 * np.pi, 180, endpoint=False)
    radius = 245.0 * (1.0 + 0.22 * np.cos(2.0 * angle - 0.5) + 0.09 * np.sin(3.0 * angle))
    contact = Contact.polygon(np.stack([520.0 + radius * np.cos(angle), 480.0 + radius * np.sin(angle)], 1))
    coarse = {n: Sensor(construction=n, strips=40, pitch_mm=25, length_mm=1000, strip_width_mm=17) for n in SIMULATED}
    figure, axes = new_axes(6.2, 4.8)
    for sensor in coarse.values():
        draw_signatures(axes, sensor, simulate(sensor, contact))
    draw_sensor(axes, coarse["crs-crs"])
    draw_contact(axes, contact, "object")
    _draw_geometric(axes, coarse["crs-crs"], contact)
    figure.legend(loc="outside right upper", **_LEGEND)
    return figure


def figure_4_2() -> Figure:
    """Pseudo-signature k_h L of one tetragon low, in the middle and high on the sensor."""
    return _at_places("kh")


def figure_4_3() -> Figure:
    """Pseudo-signature k_l L of one tetragon low, in the middle and high on the sensor."""
    return _at_places("kl")


def figure_4_4() -> Figure:
    """Pseudo-signature k L of one tetragon low, in the middle and high on the sensor."""
    return _at_places("k")


def figure_4_5() -> Figure:
    """Two ambiguities: (a) polygons X and Y with the very same k_h, (b) a shape that strips meet twice."""
    figure = new_figure(9.0, 4.6)
    _draw_pair(add_axes(figure, 1, 2, 1))
    _draw_hull(add_axes(figure, 1, 2, 2))
    return figure


def same_kh_pair() -> tuple[FloatArray, FloatArray]:
    """Return two polygons with the same k_h at every x: a convex tetragon (4, 2), a concave octagon (8, 2) [mm].

    (3.3) reads k_h = (A - B) / (A + B) with A = L + l and B = L - u: it knows only A / B. Where l and u are
    straight, another polygon can have its k_h only by A' = f A, B' = f B with one number f, and f = 1 at the
    end vertices, where l = u; but where A / B is constant, A' may be any straight line. So X is a tetragon
    with A / B = 3, k_h = 1/2, between its two interior vertices, and Y has a waist there.
    """
    L, a, b, waist, f = _CRS.length_mm, 400.0, 650.0, 525.0, 1.1
    l = np.array([150.0, 300.0])  # of X at a and b
    u = L - (L + l) / 3.0
    left, right = (150.0, np.interp(0.0, [0, 1], [0, 1])), (850.0, 0.0)
    upper_slope, lower_slope = np.diff(u)[0] / (b - a), np.diff(l)[0] / (b - a)
    left, right = (150.0, u[0] + upper_slope * (150.0 - a)), (850.0, l[1] + lower_slope * (850.0 - b))
    x = np.array([left, (a, l[0]), right, (b, u[1])])
    waist_l, waist_u = f * (L + l.mean()) - L, L - f * (L - u.mean())
    lower = np.array([left, (a, l[0]), (waist, waist_l), (b, l[1]), right])
    upper = np.array([left, (a, u[0]), (waist, waist_u), (b, u[1]), right])
    return x, close_chains(lower, upper)
