"""One picture of what two layers read: the scene from above, and the signatures of both."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon

from tacstrip.arrays import FloatArray
from tacstrip.contact.shape import Contact
from tacstrip.plot.scene import LabelledObject, draw_contact, draw_signatures, labelled_objects, number_strips
from tacstrip.plot.theme import SENSOR, STRIP, add_axes, legend_above, legend_below, new_figure
from tacstrip.reconstruction.result import Reconstruction
from tacstrip.scan import Scan
from tacstrip.sensor.layers import Layer, LayeredSensor

_MOST_SCANS = 12  # more shapes than these overlap beyond reading
_MOST_SIGNATURES = 4
_MOST_STRIPS = 120  # more are drawn as one area
_MARGIN = 0.03
_OTHER = "#999999"


def layers_figure(
    sensor: LayeredSensor,
    scans: Sequence[Scan],
    found: Sequence[Reconstruction] = (),
    truth: Sequence[Contact] = (),
) -> Figure:
    """Draw scans of two layers, and what was recovered from them.

    Edges between corners that no reading determines are dashed, a doubtful object's all; other scenes that explain the
    readings too are grey.

    Parameters
    ----------
    sensor, scans
        What was measured, with what.
    found
        A reconstruction per scan, or none.
    truth
        What touched, where that is known: one for all scans, or one per scan.
    """
    touched = [i for i, scan in enumerate(scans) if scan.touched.any()]
    shown = touched[:: max(1, -(-len(touched) // _MOST_SCANS))]
    truth = [truth[i] for i in shown] if len(truth) == len(scans) else truth
    figure, count = new_figure(7.0, 7.0), len(sensor.layers)
    scene = add_axes(figure, 2, count, (1, count))
    panels = [add_axes(figure, 2, count, count + 1 + i) for i in range(count)]
    draw_layers(scene, sensor)
    for i, contact in enumerate(truth):
        draw_contact(scene, contact, label=None if i else "true shape")
    objects = labelled_objects({"recovered": found}, shown) if found else []
    for drawn in objects:
        if drawn.found.found:
            draw_object(scene, drawn)
    handles = scene.get_legend_handles_labels()[0]
    if any(o.found.hidden is not None and o.found.hidden.any() for o in objects):
        handles.append(Line2D([], [], color=_OTHER, linestyle="--", marker="o", markerfacecolor="white"))
        handles[-1].set_label("hidden corner, and its edges")
    if len(shown) == 1 and found and found[shown[0]].alternatives:
        _draw_rivals(scene, found[shown[0]].alternatives)
        handles.append(
            Line2D([], [], color=_OTHER, linestyle=":", label="other scenes that explain the readings")
        )
    scene.set_title("both layers")
    legend_below(figure, {str(one.get_label()): one for one in handles}, 2)
    parts = [scans[i].split(sensor) for i in shown[:_MOST_SIGNATURES]]
    for number, (axes, layer) in enumerate(zip(panels, sensor.layers, strict=True)):
        for k, part in enumerate(parts):
            draw_signatures(axes, layer.sensor, part[number], of_vref=True)
            if k == 0:
                entries = axes.get_legend_handles_labels()
        turned = "" if layer.angle_deg == 0.0 else f", turned by {layer.angle_deg:g} deg"
        axes.set_title(f"layer {number}{turned}")
        axes.set(xlabel="across its strips [mm]", ylabel="reading [parts of Vref]")
        number_strips(axes, layer.sensor)
        if parts:
            legend_above(axes, handles=entries[0], labels=entries[1])
    return figure


def draw_layers(axes: Axes, sensor: LayeredSensor) -> None:
    """Draw both layers' outlines and the lines between their strips."""
    for layer in sensor.layers:
        axes.add_patch(Polygon(layer.corners_mm, facecolor=SENSOR, edgecolor=STRIP, alpha=0.5, zorder=0))
        if layer.sensor.strips <= _MOST_STRIPS:
            for ends in _strip_lines(layer):
                axes.plot(*ends.T, color=STRIP, linewidth=0.4, zorder=0.5)
    corners = np.concatenate([layer.corners_mm for layer in sensor.layers])
    low, high = corners.min(axis=0), corners.max(axis=0)
    margin = _MARGIN * float((high - low).max())
    axes.set(
        xlim=(low[0] - margin, high[0] + margin), ylim=(low[1] - margin, high[1] + margin), aspect="equal"
    )
    axes.set(xlabel="x [mm]", ylabel="y [mm]")


def _strip_lines(layer: Layer) -> FloatArray:
    """Return the lines between neighbouring strips (strips - 1, 2, 2) [mm]."""
    x = np.arange(1, layer.sensor.strips) * layer.sensor.pitch_mm
    ends = np.stack(
        [np.stack([x, np.full(len(x), y)], axis=1) for y in (0.0, layer.sensor.length_mm)], axis=1
    )
    return layer.to_whole(ends)


def draw_object(axes: Axes, drawn: LabelledObject) -> None:
    """Draw an outline: edges at hidden corners dashed and these corners hollow; all of them where it is doubtful."""
    found, colour = drawn.found, drawn.colour
    hidden = np.zeros(len(found.vertices), dtype=bool) if found.hidden is None else found.hidden
    doubtful = found.status not in ("ok", "likely")
    label = drawn.label
    following = np.roll(found.vertices, -1, axis=0)
    uncertain = hidden | np.roll(hidden, -1)
    for edge, dashed in zip(np.stack([found.vertices, following], axis=1), uncertain, strict=True):
        if dashed or doubtful:
            axes.plot(*edge.T, color="white", linewidth=2.6, zorder=3.9)
        style = "--" if dashed else "-." if doubtful else "-"
        axes.plot(*edge.T, color=colour, linestyle=style, linewidth=1.3, label=label, zorder=4)
        label = None
    for at, face in ((~hidden, colour), (hidden, "white")):
        axes.plot(*found.vertices[at].T, "o", color=colour, markerfacecolor=face, markersize=4.0, zorder=4.1)
    if drawn.number:
        x, y = found.centroid
        axes.annotate(drawn.number, (x, y), color=colour, ha="center", va="center", fontsize=8.0, zorder=6)


def _draw_rivals(axes: Axes, scenes: Sequence[Sequence[FloatArray]]) -> None:
    for outline in (shapely.LinearRing(ring) for scene in scenes for ring in scene):
        axes.plot(*shapely.get_coordinates(outline).T, color=_OTHER, linestyle=":", linewidth=1.3, zorder=3.5)
