"""One picture of a reconstruction: the sensor with the shapes, and the signatures they came from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from tacstrip.arrays import FloatArray
from tacstrip.contact.shape import Contact
from tacstrip.geometry.region import regions
from tacstrip.plot.labels import LabelledObject, labelled_objects
from tacstrip.plot.scene import (
    draw_contact,
    draw_piece,
    draw_polygon,
    draw_regions,
    draw_sensor,
    draw_signatures,
    neighbourhood,
    x_label,
    zoom,
)
from tacstrip.plot.style import TRUE, legend_above, new_panels
from tacstrip.reconstruction.result import Reconstruction
from tacstrip.scan import Scan
from tacstrip.sensor.spec import Sensor

_MOST_SCANS = 12  # more shapes than these overlap beyond reading
_MOST_SIGNATURES = 6
_MOST_WITH_REGIONS = 3  # scans
_NEARLY_ALL = 0.5  # of the sensor: a closer view of so much shows nothing more


def reconstruction_figure(
    sensor: Sensor,
    scans: Sequence[Scan],
    results: Mapping[str, Sequence[Reconstruction]],
    truth: Sequence[Contact] = (),
) -> Figure:
    """Draw scans and what was recovered from them: of many scans some, spread over all that are in contact.

    Parameters
    ----------
    sensor, scans
        What was measured, with what.
    results
        Reconstructions to compare, one per scan, by the name for the legend.
    truth
        What touched, where that is known: one for all scans, or one per scan.
    """
    touched = [i for i, scan in enumerate(scans) if scan.touched.any()]
    shown = _spread(touched, _MOST_SCANS)
    truth = [truth[i] for i in shown] if len(truth) == len(scans) else truth
    objects = labelled_objects(results, shown)
    points = _points(objects, truth)
    with_regions = len(shown) <= _MOST_WITH_REGIONS
    closer = len(points) > 0 and not _nearly_all(sensor, points)
    figure, panels = new_panels(9.5, 5.2, 1, 2 + closer)
    draw_sensor(panels[0], sensor)
    for axes in panels[:-1]:
        _draw_shapes(axes, sensor, objects, truth, with_regions)
    if closer:
        panels[1].set_aspect("equal")
        zoom(panels[1], points, sensor)
        panels[1].set(xlabel=x_label(sensor), ylabel="y [mm]")
        panels[0].set_title("sensor", fontsize=10.0)
    panels[-2].set_title(_titled("shapes", shown, touched, scans), fontsize=10.0)
    _draw_readings(panels[-1], sensor, scans, touched)
    if objects or truth:
        with_regions &= any(regions(o.found.vertices, o.found.covariance) for o in objects)
        hidden = any(o.found.bounds is not None for o in objects)
        _explain(figure, panels[0], with_regions, len(shown) > 1 and len(objects) > 0, hidden)
    return figure


def _draw_shapes(
    axes: Axes, sensor: Sensor, objects: list[LabelledObject], truth: Sequence[Contact], with_regions: bool
) -> None:
    for i, contact in enumerate(truth):
        draw_contact(axes, contact, label=None if i else "true shape")
    for drawn in objects:
        found, colour = drawn.found, drawn.colour
        if found.found:
            doubtful = found.status not in ("ok", "likely")
            if found.hidden is None:
                draw_polygon(axes, found.vertices, colour, drawn.label, doubtful=doubtful)
            else:
                draw_piece(axes, found, colour, drawn.label)
            for k, other in enumerate(found.alternatives if with_regions else ()):
                ring = np.concatenate([other.vertices, other.vertices[:1]])
                label = f"alternative: {other.weight:.2f}"
                dashes = (0, (4, 2 + 2 * k))
                axes.plot(*ring.T, color=colour, linestyle=dashes, linewidth=1.0, label=label, zorder=3.5)
            if sensor.closed and found.vertices[:, 0].max() > sensor.width_mm:  # it goes on beyond the seam
                again = found.vertices - (sensor.width_mm, 0.0)
                draw_polygon(axes, again, colour, doubtful=doubtful)
            if with_regions:
                draw_regions(axes, sensor, regions(found.vertices, found.covariance), colour)
        elif found.profile is not None:
            x, l, u = found.profile
            axes.vlines(x, l, u, color=colour, linewidth=2.0, label=drawn.label or "")
            axes.plot(x, l, "_", color=colour)
        else:
            ends = np.array([found.strips.start, found.strips.stop]) * sensor.pitch_mm
            axes.axvspan(*ends, color=colour, alpha=0.12, label=drawn.label)
        if drawn.number:
            axes.annotate(
                drawn.number, drawn.place(sensor), color=colour, ha="center", va="center", zorder=6, clip_on=True,
                fontsize=8.0, bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.6, "pad": 0.5},
            )  # fmt: skip


def _explain(figure: Figure, axes: Axes, with_regions: bool, several: bool, hidden: bool) -> None:
    """Add the legend of the shapes."""
    handles, labels = axes.get_legend_handles_labels()
    if with_regions:
        handles.append(Patch(facecolor=TRUE, alpha=0.25))
        labels.append("95 % region of a corner")
    if hidden:
        handles += [Line2D([], [], color=TRUE, linestyle=style) for style in ("--", ":")]
        labels += ["hidden behind another piece", "smallest and largest"]
    if several:
        handles.append(Patch(alpha=0.0))
        labels.append("numbers: scans")
    figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False)


def _points(objects: Sequence[LabelledObject], truth: Sequence[Contact]) -> FloatArray:
    corners = [o.found.vertices for o in objects if o.found.found]
    corners += [shapely.get_coordinates(list(c.shapes)) for c in truth]
    return np.concatenate(corners) if corners else np.empty((0, 2))


def _nearly_all(sensor: Sensor, points: FloatArray) -> bool:
    """Tell whether a closer view of points would show most of the sensor."""
    x, y = neighbourhood(points, sensor)
    seen = (min(x[1], sensor.width_mm) - max(x[0], 0.0)) * (min(y[1], sensor.length_mm) - max(y[0], 0.0))
    return seen > _NEARLY_ALL * sensor.width_mm * sensor.length_mm


def _draw_readings(axes: Axes, sensor: Sensor, scans: Sequence[Scan], touched: Sequence[int]) -> None:
    shown = _spread(touched, _MOST_SIGNATURES)
    for i in shown:
        draw_signatures(axes, sensor, scans[i])
        if i == shown[0]:
            handles, labels = axes.get_legend_handles_labels()
    axes.set_title(_titled("pseudo-signatures", shown, touched, scans), fontsize=10.0)
    axes.set(xlabel=x_label(sensor), ylabel="k L [mm]")
    if shown:
        legend_above(axes, handles=handles, labels=labels)


def _spread(numbers: Sequence[int], most: int) -> list[int]:
    """Return at most so many of the numbers, evenly spread, the first and the last among them."""
    places = np.linspace(0, len(numbers) - 1, min(most, len(numbers))).round().astype(int)
    return [numbers[i] for i in places]


def _titled(what: str, shown: Sequence[int], touched: Sequence[int], scans: Sequence[Scan]) -> str:
    """Say in a title how many of the scans are drawn, where that is not all."""
    if len(shown) == len(touched):
        return what
    which = "" if len(touched) == len(scans) else " in contact"
    return f"{what}\n{len(shown)} of {len(touched)} scans{which}"
