"""The figures of chapter 4, reproduced: signatures, their ambiguity, their kinks, the blocks of sections."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tacstrip.arrays import FloatArray
from tacstrip.contact.footprint import footprint
from tacstrip.contact.shape import Contact
from tacstrip.contact.signature import geometric_centre
from tacstrip.geometry.outline import close_chains
from tacstrip.plot.scene import draw_contact, draw_polygon, draw_sensor, draw_signatures, zoom
from tacstrip.plot.theme import COLOURS, OTHERS, TRUE, add_axes, legend, new_axes, new_figure, new_panels
from tacstrip.reconstruction.sections import fit_sections
from tacstrip.reconstruction.vertex.blocks import blocks, linear_system
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.spec import Sensor
from tacstrip.simulation import simulate
from tacstrip.thesis.captions import by_number
from tacstrip.thesis.shapes import SIMULATED

TETRAGON = Contact.polygon([(-150, 30), (60, -135), (150, -20), (-40, 125)])  # [mm]
PLACES = {"low": (170.0, 150.0), "middle": (500.0, 500.0), "high": (830.0, 860.0)}  # its centroid [mm]
UPPER_VERTEX = Contact.polygon([(200, 470), (800, 400), (520, 760)])
LOWER_VERTEX = Contact.polygon([(200, 530), (520, 240), (800, 600)])
FORK = Contact.polygon([(180, 200), (560, 130), (860, 260), (420, 390), (800, 620), (520, 800), (240, 640)])
HEXAGON = Contact.polygon([(100, 450), (400, 200), (750, 260), (900, 520), (620, 780), (250, 700)])
HEPTAGON = Contact.polygon([(90, 230), (450, 95), (600, 150), (910, 460), (760, 620), (320, 560), (190, 440)])

_CRS = SIMULATED["crs-crs"]
_OWNER = {name: sensor for sensor in SIMULATED.values() for name in sensor.signatures}


def figure_4_1() -> Figure:
    """Object of any shape on a sensor of 40 strips: its geometric signature and its pseudo-signatures."""
    angle = np.linspace(0.0, 2.0 * np.pi, 180, endpoint=False)
    radius = 245.0 * (1.0 + 0.22 * np.cos(2.0 * angle - 0.5) + 0.09 * np.sin(3.0 * angle))
    contact = Contact.polygon(np.stack([520.0 + radius * np.cos(angle), 480.0 + radius * np.sin(angle)], 1))
    size: dict[str, Any] = {"strips": 40, "pitch_mm": 25.0, "length_mm": 1000.0, "strip_width_mm": 17.0}
    return _all_signatures([Sensor(construction=name, **size) for name in SIMULATED], contact)[0]


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
    figure = new_figure(7.0, 4.0)
    axes = add_axes(figure, 1, 2, 1)
    draw_sensor(axes, _CRS)
    pair = same_kh_pair()
    scans = [simulate(_CRS, Contact.polygon(corners)) for corners in pair]
    for i, (name, colour, line, width) in enumerate((("X", TRUE, "-", 1.0), ("Y", OTHERS[2], ":", 3.5))):
        draw_polygon(axes, pair[i], colour, name, dashed=i == 1)
        y = scans[i]["kh"] * _CRS.length_mm
        axes.plot(_CRS.x_mm, y, line, color=COLOURS["kh"], linewidth=width, label=f"$k_h L$ of {name}")
    h, l = (float(np.nanmax(np.abs(scans[0][name] - scans[1][name]))) for name in ("kh", "kl"))
    title = f"(a) $k_h$ of X and Y: the same to {h:.0e}\nof Vref; $k_l$: up to {l:.0%} apart"
    axes.set_title(title, fontsize=9.0)
    legend(axes, loc="upper right", ncols=2)
    axes, touch = add_axes(figure, 1, 2, 2), footprint(_CRS, FORK)
    twice = touch.pieces > 1
    _draw_scene(axes, _CRS, FORK, [])
    axes.fill_between(_CRS.x_mm[twice], touch.l[twice], touch.u[twice], fc="none", ec=OTHERS[3], hatch="///")
    for end in touch:
        axes.plot(_CRS.x_mm, end, color=COLOURS["profile"], label="outer hull, l and u")
    title = f"(b) {twice.sum()} strips meet the object\ntwice (hatched); they read its hull"
    axes.set_title(title, fontsize=9.0)
    legend(axes, handles=axes.get_lines()[:2], loc="upper right", ncols=2)
    return figure


def figure_4_6() -> Figure:
    """Tetragon, its geometric signature and pseudo-signatures; two interior vertices make three sections."""
    contact = TETRAGON.placed(*PLACES["middle"])
    figure, axes = _all_signatures(list(SIMULATED.values()), contact)
    zoom(axes, contact.vertices, _CRS)
    x, top = np.sort(contact.vertices[:, 0]), contact.vertices[:, 1].max() + 50.0
    axes.vlines(x, axes.get_ylim()[0], top + 35.0, TRUE, "dotted", linewidth=0.8)
    for number, middle in enumerate(0.5 * (x[:-1] + x[1:]), start=1):
        axes.text(middle, top, f"section {number}", ha="center")
    return figure


def figure_4_7() -> Figure:
    """Kink of each signature where a vertex lies at the top: the slope drops."""
    return _kinks(UPPER_VERTEX, "213")


def figure_4_8() -> Figure:
    """Kink of each signature where a vertex lies at the bottom: the slope rises."""
    return _kinks(LOWER_VERTEX, "465")


def figure_4_9() -> Figure:
    """Blocks of a hexagon: a vertex, its reading k_h and the edge opposite it (thick) give one equation."""
    corners, k, slopes = at_vertices("kh", HEXAGON)
    x, y, upper = corners[:, 0], k * _CRS.length_mm, np.pad(slopes[:, 1] < slopes[:, 0], 1)
    matrix, right = linear_system(x, k, upper, (float(y[0]), float(y[-1])), _CRS, "kh")
    figure = new_figure(8.4, 8.0)
    for number, (start, end) in enumerate(blocks(upper), start=1):
        axes = add_axes(figure, 2, 2, number)
        _draw_scene(axes, _CRS, HEXAGON, ["kh"])
        edge = corners[[start, end]].T
        axes.plot(*edge, color=OTHERS[2], linewidth=3.5, solid_capstyle="round", zorder=3)
        for i in range(start + 1, end):
            axes.plot([x[i], x[i]], [corners[i, 1], np.interp(x[i], *edge)], color=OTHERS[2], zorder=3)
            axes.plot(x[i], y[i], "o", color=COLOURS["kh"], zorder=5)
            equation = " + ".join(f"{a:.2f} $y_{j}$" for j, a in enumerate(matrix[i - 1], start=2) if a)
            title = f"vertex {i + 1} and the edge from {start + 1} to {end + 1}:\n{equation}"
            axes.set_title(f"{title} = {right[i - 1]:.0f} mm", fontsize=9.0)
        for i, (at, height) in enumerate(corners):
            axes.text(at, height + (45.0 if upper[i] else -45.0), f"{i + 1}", ha="center", va="center")
    return figure


def figure_4_10() -> Figure:
    """Signature with three blocks of sections: in a block it bends one way; neighbours share a section."""
    corners, k, slopes = at_vertices("kh", HEPTAGON)
    x, y = corners[:, 0], k * _CRS.length_mm
    upper, lower = np.pad(slopes[:, 1] < slopes[:, 0], 1), np.pad(slopes[:, 1] > slopes[:, 0], 1)
    figure, axes = new_axes(6.6, 4.0)
    draw_signatures(axes, _CRS, simulate(_CRS, HEPTAGON), ["kh"], "-")
    axes.plot(x[upper], y[upper], "v", color=COLOURS["kh"], label="slope drops: upper vertex")
    axes.plot(x[lower], y[lower], "^", color=COLOURS["kh"], label="slope rises: lower vertex")
    axes.vlines(x, 0.0, y, TRUE, "dotted", linewidth=0.8)
    for number, (start, end) in enumerate(blocks(upper)):
        low, colour = 120.0 - 45.0 * number, OTHERS[number]
        axes.plot(x[[start, end]], [low, low], "|-", color=colour, markersize=9.0)
        axes.text(x[[start, end]].mean(), low + 6.0, f"block {number + 1}", ha="center", color=colour)
    axes.set(xlim=(0, 1000), ylim=(0, 640), xlabel="digital dimension x [mm]", ylabel="$k_h L$ [mm]")
    legend(axes, loc="upper left")
    return figure


def same_kh_pair() -> tuple[FloatArray, FloatArray]:
    """Return polygons with one and the same k_h: X (4, 2), convex, and Y (8, 2) [mm], with a waist.

    With A = L + l and B = L - u, (3.3) is k_h = (A - B) / (A + B): it knows A / B only. Where that changes
    along x, another polygon has the same k_h only as A' = f A, B' = f B with a constant f, and f = 1 at end
    vertices, l = u. Where A / B stands still, A' may be any straight line. So X has A = 3 B, k_h = 1/2,
    between its interior vertices, and Y leaves it there: f falls from 1.15 at its waist to 1 on both sides.
    """
    length, f = _CRS.length_mm, 1.15
    x = np.array([150.0, 400.0, 525.0, 650.0, 850.0])
    l = 0.6 * x - 90.0
    u = length - (length + l) / 3.0  # A = 3 B
    l[0], u[-1] = u[0], l[-1]
    convex = np.array([(x[0], l[0]), (x[1], l[1]), (x[4], l[4]), (x[3], u[3])])
    l[2], u[2] = f * (length + l[2]) - length, length - f * (length - u[2])
    return convex, close_chains(np.stack([x, l], axis=1), np.stack([x, u], axis=1))


def at_vertices(signature: str, contact: Contact) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return a polygon's corners, left to right (N, 2), k there (N,), slopes on both sides of inner ones (N - 2, 2)."""
    sensor, corners = _OWNER[signature], contact.vertices[np.argsort(contact.vertices[:, 0])]
    k, x = simulate(sensor, contact)[signature], corners[:, 0]
    touched = ~np.isnan(k)
    sections = [s for s in fit_sections(sensor.x_mm[touched], k[touched], x, sensor.sensing_ratio) if s]
    values = [s.reading(at)[0] for s, at in zip([sections[0], *sections], x, strict=True)]
    inner = zip(sections[:-1], sections[1:], x[1:-1], strict=True)
    return corners, np.array(values), np.array([(a.slope(at)[0], b.slope(at)[0]) for a, b, at in inner])


def _draw_scene(axes: Axes, sensor: Sensor, contact: Contact, names: list[str]) -> None:
    draw_sensor(axes, sensor)
    draw_contact(axes, contact, "object")
    draw_signatures(axes, sensor, simulate(sensor, contact), names, "-")


def _draw_geometric(axes: Axes, sensor: Sensor, contact: Contact) -> FloatArray:
    y = geometric_centre(*footprint(sensor, contact))
    axes.plot(sensor.x_mm, y, "--", color=COLOURS["geometric"], linewidth=1.0, label="geometric", zorder=3)
    return y


def _all_signatures(sensors: list[Sensor], contact: Contact) -> tuple[Figure, Axes]:
    """Draw a contact on sensors of one size, with every signature that they measure."""
    figure, axes = new_axes(5.2, 5.3)
    for sensor in sensors:
        draw_signatures(axes, sensor, simulate(sensor, contact))
    _draw_geometric(axes, sensors[0], contact)
    _draw_scene(axes, sensors[0], contact, [])
    figure.legend(loc="outside upper center", ncols=5, frameon=False, fontsize=8.0)
    return figure, axes


def _at_places(signature: str) -> Figure:
    """Draw a signature at three places, and how far it lies from the geometric signature."""
    sensor, symbol = _OWNER[signature], SIGNATURES[signature].symbol
    figure, (left, right) = new_panels(7.0, 3.6, 1, 2)
    for (place, at), style in zip(PLACES.items(), ("-", "--", "-."), strict=True):
        contact = TETRAGON.placed(*at)
        _draw_scene(left, sensor, contact, [signature])
        centre = _draw_geometric(left, sensor, contact)
        off = simulate(sensor, contact)[signature] * sensor.length_mm - centre
        right.plot(sensor.x_mm - at[0], off, style, color=COLOURS[signature], label=place)
    legend(left, handles=left.get_lines()[:3], loc="upper left")
    right.axhline(0.0, color=COLOURS["geometric"], linewidth=1.0, linestyle="--")
    right.set(xlabel="x from the centroid [mm]", ylabel=f"${symbol} L$ above the geometric centre [mm]")
    right.margins(y=0.2)
    legend(right, loc="upper right", ncols=3)
    return figure


def _kinks(contact: Contact, edges: str) -> Figure:
    """Draw a triangle, its edges numbered, and each signature at its inner corner with both slopes."""
    figure = new_figure(7.6, 6.0)
    axes = add_axes(figure, 2, 2, 1)
    _draw_scene(axes, _CRS, contact, [])
    zoom(axes, contact.vertices, _CRS, 0.1)
    for panel, (name, sensor) in enumerate(_OWNER.items(), start=2):
        corners, k, slopes = at_vertices(name, contact)
        symbol, close = SIGNATURES[name].symbol, add_axes(figure, 2, 2, panel)
        draw_signatures(close, sensor, simulate(sensor, contact), [name], "-")
        x = corners[1, 0] + np.array([-120.0, 120.0])
        before, after = slopes[0] * sensor.length_mm
        for side, slope, line in (("left", before, "--"), ("right", after, ":")):
            y = k[1] * sensor.length_mm + slope * (x - corners[1, 0])
            close.plot(x, y, line, color=TRUE, linewidth=0.9, label=f"{side} slope {slope:.2f}")
        close.set(xlim=x, xlabel="digital dimension x [mm]", ylabel=f"${symbol} L$ [mm]")
        legend(close)
    for number, ends in zip(edges, ([0, 1], [0, 2], [1, 2]), strict=True):
        at = corners[ends].mean(axis=0)
        axes.text(at[0], at[1], f"$l_{number}$", backgroundcolor="w", ha="center", va="center")
    return figure


FIGURES = by_number(globals())
