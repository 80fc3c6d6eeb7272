"""One picture of a reconstruction: the sensor with the shapes, and the signatures they came from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tacstrip.arrays import FloatArray
from tacstrip.contact.shape import Contact
from tacstrip.plot.scene import draw_contact, draw_polygon, draw_sensor, draw_signatures, zoom
from tacstrip.plot.style import OTHERS, RECOVERED, add_axes, legend, new_figure
from tacstrip.reconstruct.region import regions
from tacstrip.reconstruct.result import Reconstruction
from tacstrip.scan import Scan
from tacstrip.sensor.spec import Sensor

_MOST_SIGNATURES = 6  # more scans than this overlap beyond reading


def reconstruction_figure(
    sensor: Sensor,
    scans: Sequence[Scan],
    results: Mapping[str, Sequence[Reconstruction]],
    truth: Sequence[Contact] = (),
) -> Figure:
    """Draw scans and what was recovered from them.

    Parameters
    ----------
    sensor, scans
        What was measured, with what.
    results
        Reconstructions to compare, one per scan, by the name for the legend.
    truth
        What touched, where that is known.
    """
    figure = new_figure(9.5, 5.2)
    left, middle, right = (add_axes(figure, 1, 3, i) for i in (1, 2, 3))
    draw_sensor(left, sensor)
    left.set_title("sensor")
    for axes in (left, middle):
        _draw_shapes(axes, sensor, results, truth)
    points = _points(results, truth)
    if len(points):
        middle.set_aspect("equal")
        zoom(middle, points, sensor)
    middle.set_title("shapes")
    middle.set_xlabel("x [mm]")
    middle.set_ylabel("y [mm]")
    if results or truth:
        handles, labels = middle.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False)
    _draw_readings(right, sensor, scans)
    return figure


def _draw_shapes(
    axes: Axes, sensor: Sensor, results: Mapping[str, Sequence[Reconstruction]], truth: Sequence[Contact]
) -> None:
    for i, contact in enumerate(truth):
        draw_contact(axes, contact, label=None if i else "true shape")
    colours = (RECOVERED, *OTHERS)
    said: set[str] = set()
    for number, (name, reconstructions) in enumerate(results.items()):
        colour = colours[number % len(colours)]
        for recovered in (o for r in reconstructions for o in r.objects):
            doubtful = recovered.status != "ok"
            if recovered.found:
                told = f"{name}: {recovered.status}"
                draw_polygon(axes, recovered.vertices, colour, told if told not in said else None, doubtful)
                for region in regions(recovered.vertices, recovered.covariance):
                    axes.fill(*region.T, facecolor=colour, alpha=0.25, edgecolor=colour, linewidth=0.6)
                said.add(told)
            elif recovered.profile is not None:
                told = f"{name}: {recovered.status}, strip by strip"
                x, l, u = recovered.profile
                axes.vlines(x, l, u, color=colour, linewidth=2.0, label=told if told not in said else "")
                axes.plot(x, l, "_", color=colour)
                said.add(told)
            else:
                x = sensor.x_mm[recovered.strips]
                told = f"{name}: {recovered.status}"
                axes.axvspan(x[0], x[-1], color=colour, alpha=0.12, label=told if told not in said else None)
                said.add(told)


def _points(results: Mapping[str, Sequence[Reconstruction]], truth: Sequence[Contact]) -> FloatArray:
    corners = [o.vertices for rs in results.values() for r in rs for o in r.objects if o.found]
    corners += [shapely.get_coordinates(list(c.shapes)) for c in truth]
    return np.concatenate(corners) if corners else np.empty((0, 2))


def _draw_readings(axes: Axes, sensor: Sensor, scans: Sequence[Scan]) -> None:
    touched = [s for s in scans if s.touched.any()]
    for i, scan in enumerate(touched[:_MOST_SIGNATURES]):
        draw_signatures(axes, sensor, scan)
        if i == 0:
            legend(axes)
    more = f"\nfirst {_MOST_SIGNATURES} of {len(touched)} scans" if len(touched) > _MOST_SIGNATURES else ""
    axes.set_title("pseudo-signatures" + more, fontsize=10.0)
    axes.set_xlabel("x [mm]")
    axes.set_ylabel("k L [mm]")
