"""The Cramer-Rao bound as a picture: regions of the vertices, and the error over the surface."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from tacstrip.arguments import takes
from tacstrip.contact.noise import Noise
from tacstrip.contact.shape import Contact
from tacstrip.design.limits import ErrorMap, Limit, limit_map, outline_of
from tacstrip.geometry.outline import Outline
from tacstrip.geometry.region import regions
from tacstrip.plot.scene import draw_polygon, fill_sheet, zoom
from tacstrip.plot.sensors import axes_with_sensor
from tacstrip.plot.theme import (
    COLOURS,
    RECOVERED,
    TRUE,
    legend_above,
    legend_below,
    new_figure,
    plain_ticks,
    themed,
)
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.spec import Sensor

_WIDE = 1.6  # times as wide as long: the two pictures of such a sensor lie one above the other
_SHEET = 9.5  # inch


@takes(sensor=Sensor, contact=Contact, noise=Noise)
def limits(
    sensor: Sensor, contact: Contact, noise: Noise | None = None, *, grid: int = 16, ax: Axes | None = None
) -> Axes:
    """Draw how well the corners of a contact can be located at best, with its centroid at each place of the sensor.

    Parameters
    ----------
    sensor, contact
        What touches what; one x-monotone polygon.
    noise
        Of the readings; None: the spec's `[noise]`.
    grid
        Places a side; 16 take a second.
    ax
        Axes to draw into, which give some room to a bar of colours; None: new ones on a figure of their own.

    Returns
    -------
    Axes
        x across the strips and y along them [mm]; the colour is the root mean square error of a corner [mm], places
        where the readings do not determine the corners stay without.

    Raises
    ------
    ContactError
        The contact is not one x-monotone polygon, or not wholly on the sensor.
    OptionError
        No noise limits the readings.

    References
    ----------
    The Cramer-Rao bound.

    Examples
    --------
    >>> import tacstrip as ts
    >>> from tacstrip import plot
    >>> sensor = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0)
    >>> coin = ts.Contact.polygon([(30, 40), (60, 35), (70, 60), (40, 70)])
    >>> ax = plot.limits(sensor, coin, ts.Noise(positional=0.005), grid=4)
    >>> ax.figure.axes[-1].get_ylabel()
    'error of a corner, RMS [mm]'
    """
    outline = outline_of(sensor, contact)
    noise = sensor.noise or Noise() if noise is None else noise
    over = limit_map(sensor, outline, noise, grid, grid)
    axes = axes_with_sensor(sensor, ax)
    _draw_map(axes, sensor, outline, over)
    return axes


def limits_figure(sensor: Sensor, outline: Outline, found: Sequence[Limit], over: ErrorMap) -> Figure:
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
    wide = sensor.width_mm > _WIDE * sensor.length_mm
    high = _SHEET * sensor.length_mm / sensor.width_mm
    figure = new_figure(_SHEET, min(max(2.0 * high + 1.6, 4.6), 9.5) if wide else 5.2)
    with themed():
        if wide:
            left, right = figure.subplots(2, 1)
        else:  # a narrow sensor leaves its room to the closer view
            left, right = figure.subplots(
                1, 2, width_ratios=(1.0, max(sensor.width_mm / sensor.length_mm, 0.55))
            )
    axes_with_sensor(sensor, left)
    draw_polygon(left, outline.vertices, TRUE)
    for number, limit in enumerate(found):
        colour = COLOURS[limit.signatures[0]] if len(limit.signatures) == 1 else COLOURS["profile"]
        symbols = ", ".join(f"${SIGNATURES[name].symbol}$" for name in limit.signatures)
        label: str | None = f"{symbols}: {limit.rms:.3g} mm RMS"
        for ring in regions(outline.vertices, limit.covariance):
            closed = np.vstack([ring, ring[:1]]).T
            left.plot(*closed, color=colour, linestyle=("-", "--", ":")[number % 3], label=label, zorder=5)
            label = None
    zoom(left, outline.vertices, sensor)
    left.set_title("95 % regions\nof the best estimate")
    handles, labels = left.get_legend_handles_labels()
    legend_below(figure, dict(zip(labels, handles, strict=True)), 3)  # within, it would lie on a long sensor
    fill_sheet(left, sensor)
    axes_with_sensor(sensor, right)
    _draw_map(right, sensor, outline, over)
    right.set_title("error with the\ncontact's centroid here")
    return figure


def _draw_map(axes: Axes, sensor: Sensor, outline: Outline, over: ErrorMap) -> None:
    """Draw the error at each place of the centroid, a bar of its colours, and the contact where it lies."""
    look: dict[str, Any]
    known = np.isfinite(over.rms_mm)
    if known.any():
        finite = over.rms_mm[known]
        span = LogNorm(float(finite.min()), float(max(finite.max(), 1.001 * finite.min())))
        shown = np.where(known, over.rms_mm, np.nan)
        look = {"norm": span, "cmap": "viridis", "shading": "nearest", "zorder": 2}
        with themed():
            mesh = axes.pcolormesh(over.x_mm, over.y_mm, shown, **look)
            # Half a cell reaches over the edge.
            mesh.set_clip_path(
                Rectangle((0.0, 0.0), sensor.width_mm, sensor.length_mm, transform=axes.transData)
            )
            bar = axes.figure.colorbar(mesh, ax=axes, label="error of a corner, RMS [mm]")
        plain_ticks(bar.ax.yaxis)
    ring = np.concatenate([outline.vertices, outline.vertices[:1]])
    axes.plot(*ring.T, color="white", linewidth=2.4, zorder=4.9)
    axes.plot(*ring.T, color=TRUE, linewidth=1.0, zorder=5, label="the contact")
    look = {"markerfacecolor": RECOVERED, "markeredgecolor": "white", "label": "its centroid"}
    axes.plot(*over.centroid, "o", markersize=5.0, zorder=5, **look)
    legend_above(axes)
    fill_sheet(axes)
