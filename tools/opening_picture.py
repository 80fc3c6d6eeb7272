"""The picture that the README opens with: a hand on the skin, what each strip feels, and the shape that comes back."""

from __future__ import annotations

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, Polygon

import tacstrip as ts
from tacstrip.arrays import FloatArray
from tacstrip.plot.scene import fill_sheet
from tacstrip.plot.theme import OTHERS, RECOVERED, SENSOR, STRIP, TRUE, new_figure, themed

# Fingers from root to tip [mm], and their width; the thumb first.
_FINGERS = (
    ((62.0, 62.0), (31.0, 98.0), 19.0),
    ((75.0, 100.0), (66.0, 168.0), 16.0),
    ((94.0, 105.0), (92.0, 182.0), 17.0),
    ((112.0, 102.0), (117.0, 172.0), 16.0),
    ((127.0, 92.0), (140.0, 146.0), 14.0),
)
_PALM = ((66.0, 34.0), (128.0, 34.0), (136.0, 62.0), (132.0, 100.0), (72.0, 102.0), (60.0, 62.0))
_SKIN_TONE, _OUTLINE = "#e0ac86", "#8a5a3a"
_LIFT = 26.0  # of the hand over the skin in the first panel [mm]


def opening_figure() -> Figure:
    """Return the picture; the readings are simulated, with noise, and the shape is recovered from them."""
    sensor = ts.Sensor(construction="crs-crs", strips=80, pitch_mm=2.2, length_mm=200.0)
    hand = _hand()
    noise = ts.Noise(positional=0.003)
    scan = ts.simulate(sensor, ts.Contact((hand,)), noise, rng=1)
    found = ts.profile_reconstruction(scan, sensor)
    figure = new_figure(9.6, 3.3, widest=9.6)  # three short titles above pictures, legible at 600 pixels
    with themed():
        panels = figure.subplots(1, 3, width_ratios=(1.3, 1.0, 1.0))
    _draw_press(panels[0], sensor, hand)
    _draw_felt(panels[1], sensor, found)
    _draw_shape(panels[2], sensor, found)
    titles = ("A hand presses the skin", "Each strip feels its part", "Its shape is recovered")
    for number, (axes, title) in enumerate(zip(panels, titles, strict=True), 1):
        axes.set_title(f"{number}. {title}", fontsize=13.0)
        axes.set_axis_off()
        fill_sheet(axes)
    return figure


def _hand() -> shapely.Polygon:
    palm = shapely.buffer(shapely.Polygon(_PALM), 9.0)
    fingers = [shapely.buffer(shapely.LineString([a, b]), 0.5 * width) for a, b, width in _FINGERS]
    whole = shapely.union_all([palm, *fingers])
    # A little closing rounds the webs between the fingers.
    return shapely.simplify(shapely.buffer(shapely.buffer(whole, 2.0), -2.0), 0.3)


def _oblique(xy: FloatArray, z: float = 0.0) -> FloatArray:
    """Return points (N, 2) on the skin, or z above it, as seen from the front and above."""
    x, y = np.asarray(xy, dtype=float).T
    depth = 1.0 / (1.0 + 0.0016 * y)  # what is further away is smaller
    return np.stack([(x - 88.0) * depth, 0.62 * y * depth + 0.9 * z], axis=1)


def _draw_press(axes: Axes, sensor: ts.Sensor, hand: shapely.Polygon) -> None:
    """Draw the skin in perspective, strips over a sheet, and the hand that comes down on it."""
    wide, long = sensor.width_mm, sensor.length_mm
    sheet = np.array([(-6.0, -6.0), (wide + 6.0, -6.0), (wide + 6.0, long + 6.0), (-6.0, long + 6.0)])
    axes.add_patch(Polygon(_oblique(sheet, -5.0), facecolor="#9a9484", edgecolor="none"))
    every = 4  # strips: so many as one, to be seen
    for i in range(0, sensor.strips, every):
        x0, x1 = i * sensor.pitch_mm, (i + 0.78 * every) * sensor.pitch_mm
        strip = np.array([(x0, 0.0), (x1, 0.0), (x1, long), (x0, long)])
        axes.add_patch(Polygon(_oblique(strip), facecolor="#d9d2c0", edgecolor=TRUE, linewidth=0.3))
    ring = shapely.get_coordinates(hand)
    axes.add_patch(Polygon(_oblique(ring), facecolor="black", alpha=0.28, edgecolor="none"))
    for z in np.linspace(0.0, 7.0, 8):  # its thickness
        axes.add_patch(Polygon(_oblique(ring, _LIFT + z), facecolor="#c98f66", edgecolor="none"))
    axes.add_patch(
        Polygon(_oblique(ring, _LIFT + 7.0), facecolor=_SKIN_TONE, edgecolor=_OUTLINE, linewidth=1.2)
    )
    down = _oblique(np.array([(158.0, 30.0)]))[0]
    arrow = FancyArrowPatch(
        down + np.array([0.0, 40.0]),
        down,
        arrowstyle="-|>",
        mutation_scale=22.0,
        linewidth=3.0,
        color=RECOVERED,
    )
    axes.add_patch(arrow)
    axes.autoscale_view()


def _draw_skin(axes: Axes, sensor: ts.Sensor) -> None:
    wide, long = sensor.width_mm, sensor.length_mm
    axes.fill([0.0, wide, wide, 0.0], [0.0, 0.0, long, long], color=SENSOR)
    axes.vlines(np.arange(1, sensor.strips) * sensor.pitch_mm, 0.0, long, color=STRIP, linewidth=0.5)
    axes.set(xlim=(-2.0, wide + 2.0), ylim=(-2.0, long + 2.0))


def _draw_felt(axes: Axes, sensor: ts.Sensor, found: ts.Reconstruction) -> None:
    """Draw on each touched strip from where to where it is touched."""
    _draw_skin(axes, sensor)
    for one in found.objects:
        assert one.profile is not None
        x, l, u = one.profile
        axes.vlines(x, l, u, color=OTHERS[0], linewidth=1.7)
        axes.plot(np.concatenate([x, x]), np.concatenate([l, u]), "o", color=OTHERS[0], markersize=2.2)


def _draw_shape(axes: Axes, sensor: ts.Sensor, found: ts.Reconstruction) -> None:
    """Draw what was recovered."""
    _draw_skin(axes, sensor)
    for one in found.objects:
        axes.fill(*one.vertices.T, facecolor=RECOVERED, alpha=0.25)
        axes.plot(*np.concatenate([one.vertices, one.vertices[:1]]).T, color=RECOVERED, linewidth=2.2)
