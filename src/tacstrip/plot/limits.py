"""The Cramer-Rao bound as a picture: regions of the vertices, and the error over the surface."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from tacstrip.design.limits import ErrorMap, Limit
from tacstrip.geometry.outline import Outline
from tacstrip.geometry.region import regions
from tacstrip.plot.scene import draw_polygon, draw_sensor, zoom
from tacstrip.plot.style import COLOURS, RECOVERED, TRUE, new_panels, plain_ticks
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.spec import Sensor


def limits_figure(sensor: Sensor, outline: Outline, found: list[Limit], over: ErrorMap) -> Figure:
    """Draw a contact's 95 % regions, and the RMS vertex error with its centroid at each place of the sensor.

    Parameters
    ----------
    sensor, outline
        What touches what.
    found
        The bounds, a colour each.
    over
        The map; places where the readings do not determine the vertices stay grey.
    """
    figure, (left, right) = new_panels(9.5, 4.6, 1, 2)
    draw_sensor(left, sensor)
    draw_polygon(left, outline.vertices, TRUE)
    for limit in found:
        colour = COLOURS[limit.signatures[0]] if len(limit.signatures) == 1 else COLOURS["profile"]
        symbols = ", ".join(f"${SIGNATURES[name].symbol}$" for name in limit.signatures)
        label: str | None = f"{symbols}: {limit.rms:.3g} mm RMS"
        for ring in regions(outline.vertices, limit.covariance):
            left.plot(*np.vstack([ring, ring[:1]]).T, color=colour, linewidth=1.0, label=label, zorder=5)
            label = None
    zoom(left, outline.vertices, sensor)
    left.set_title("95 % regions of the best estimate")
    handles, labels = left.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)
    draw_sensor(right, sensor)
    finite = over.rms_mm[np.isfinite(over.rms_mm)]
    if len(finite):
        span = LogNorm(float(finite.min()), float(max(finite.max(), 1.001 * finite.min())))
        shown = np.where(np.isfinite(over.rms_mm), over.rms_mm, np.nan)
        look: dict[str, Any] = {"norm": span, "cmap": "viridis", "shading": "nearest", "zorder": 2}
        mesh = right.pcolormesh(over.x_mm, over.y_mm, shown, **look)
        bar = figure.colorbar(mesh, ax=right, label="RMS vertex error [mm]")
        plain_ticks(bar.ax.yaxis)
    right.plot(*over.centroid, "o", color=RECOVERED, markersize=4.0, zorder=5)
    right.set_title("with the contact's centroid here")
    return figure
