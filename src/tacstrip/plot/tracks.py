"""Objects over time: their paths over the sensor, the shapes that all scans give, and their poses."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tacstrip.arguments import takes
from tacstrip.arrays import FloatArray
from tacstrip.geometry.region import regions
from tacstrip.plot.scans import say_nothing
from tacstrip.plot.scene import draw_polygon, fill_sheet
from tacstrip.plot.sensors import axes_with_sensor
from tacstrip.plot.theme import OTHERS, RECOVERED, SENSOR, add_axes, legend_above, new_figure
from tacstrip.sensor.spec import Sensor
from tacstrip.tracking.result import Track

_DRAWN = 6  # outlines on each path
_PALER = 0.72  # from one outline to that before
_MOST_NAMED = 8  # objects with an entry of their own in a legend
_MARKERS = "os^Dv"
_NORMAL_95 = 1.96  # standard deviations that hold 95 % of a normal distribution
_LONG = 1.6  # times as long as wide, or as wide as long
# The sheet [inch], rows and columns, and the cells of way, shape, places and angles: by the sensor's own form.
_PANELS: dict[str, tuple[tuple[float, float], tuple[int, int], tuple[int | tuple[int, int], ...]]] = {
    "square": ((7.0, 6.6), (2, 2), (1, 2, 3, 4)),
    "long": ((7.0, 8.0), (3, 3), ((1, 7), (2, 3), (5, 6), (8, 9))),
    "wide": ((9.5, 6.6), (2, 3), ((1, 3), 4, 5, 6)),
}


@takes(tracks=(Track, Track), sensor=Sensor)
def track(tracks: Track | Sequence[Track], sensor: Sensor, *, ax: Axes | None = None) -> Axes:
    """Draw the paths of the centroids with six outlines on each, earlier ones paler, dashed where doubtful.

    Parameters
    ----------
    tracks
        What `ts.track` returned, or one of them.
    sensor
        That made the scans.
    ax
        Axes to draw into; None: new ones on a figure of their own.

    Returns
    -------
    Axes
        x across the strips and y along them [mm]; a mark stands where a path begins, rings where objects share strips.

    Examples
    --------
    >>> import tacstrip as ts
    >>> from tacstrip import plot
    >>> sensor = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0)
    >>> shape = ts.Contact.polygon([(-25, -20), (20, -25), (25, 20), (-10, 25)])
    >>> noise = ts.Noise(positional=0.002)
    >>> moved = [shape.turned(0.05 * i).placed(40 + i, 50) for i in range(20)]
    >>> scans = [ts.simulate(sensor, one, noise, rng=i, time_s=0.01 * i) for i, one in enumerate(moved)]
    >>> ax = plot.track(ts.track(scans, sensor, noise), sensor)
    >>> [text.get_text() for text in ax.get_legend().get_texts()]
    ['object 1: ok']
    """
    axes = axes_with_sensor(sensor, ax)
    any_drawn = False
    for one, colour, marker in _coloured([tracks] if isinstance(tracks, Track) else tracks):
        label = f"object {one.id}: {one.status}" if one.id <= _MOST_NAMED else None
        path, seen = one.centroids, np.flatnonzero(one.present)
        axes.plot(*path.T, color=colour, linewidth=0.9, zorder=4)
        axes.plot(*path[seen[0]], marker, color=colour, markersize=5.0, zorder=5)
        drawn = seen[np.unique(np.linspace(0, len(seen) - 1, _DRAWN).astype(int))]
        # The last one first: it is in full, and in the legend.
        for order, i in enumerate(reversed(drawn.tolist())):
            draw_polygon(axes, one.placed(i), colour, label, status=one.status, alpha=_PALER**order)
            label = None
        axes.plot(*path[list(one.joint)].T, "o", color=colour, markersize=2.5, fillstyle="none")
        any_drawn = True
    if any_drawn:
        legend_above(axes)
    else:
        say_nothing(axes, "no object was tracked")
    fill_sheet(axes)
    return axes


def track_figure(sensor: Sensor, tracks: Sequence[Track]) -> Figure:
    """Draw tracks: where they went, what they look like, and how they turned."""
    kind = "long" if _LONG * sensor.width_mm < sensor.length_mm else "square"
    kind = "wide" if sensor.width_mm > _LONG * sensor.length_mm else kind
    size, grid, cells = _PANELS[kind]
    figure = new_figure(*size)
    way, shape, place, turn = (add_axes(figure, *grid, cell) for cell in cells)
    track(tracks, sensor, ax=way)
    way.set_title("paths over the sensor")
    shape.set(xlabel="x [mm]", ylabel="y [mm]", title="shapes, 95 % regions")
    place.set(xlabel="time [s]", ylabel="x, y of the centroid [mm]", title="places, 95 % ranges")
    turn.set(xlabel="time [s]", ylabel="angle [deg]", title="angles, 95 % ranges")
    shared = np.zeros(len(tracks[0].times_s) if tracks else 0, dtype=bool)
    bands: list[tuple[Axes, tuple[Any, FloatArray, FloatArray], str]] = []
    look: dict[str, Any]
    for one, colour, marker in _coloured(tracks):
        what = one.status if one.kind == "polygon" else f"{one.status}, {one.kind}"
        draw_polygon(shape, one.outline, colour, f"{one.id}: {what}", status=one.status)
        for other in one.alternatives:
            ring = np.concatenate([other.vertices, other.vertices[:1]])
            shape.plot(*ring.T, color=colour, linestyle="--", linewidth=0.8, label=f"or: {other.weight:.2f}")
        if one.covariance is not None:
            for region in regions(one.outline, one.covariance):
                shape.fill(*region.T, color=colour, alpha=0.25)
        time = one.times_s if np.diff(one.times_s).any() else np.arange(len(one.times_s))
        shared[list(one.joint)] = True
        values = (*one.centroids.T, np.rad2deg(one.poses[:, 2]))
        far = _NORMAL_95 * np.sqrt(np.einsum("tii->it", one.pose_covariances))
        ranges = far * np.array([1.0, 1.0, np.rad2deg(1.0)])[:, None]
        panels = zip((place, place, turn), ("x", "y", "angle"), values, ranges, ("-", "--", "-"), strict=True)
        for axes, name, value, off, dashes in panels:
            if name == "angle" and (one.by_scan is not None or one.kind == "disc"):
                continue  # no rigid outline explains the scans, none that turned; or it has no angle
            look = {"color": colour, "linestyle": dashes, "marker": marker, "markersize": 3.0}
            axes.plot(time, value, markevery=max(len(time) // 8, 1), label=f"{one.id}: {name}", **look)
            bands.append((axes, (time, value - off, value + off), colour))
    _draw_bands(bands)
    for axes in (
        (place, turn) if shared.any() else ()
    ):  # as high as what is drawn, not up into the legend's room
        axes.set_ylim(axes.get_ylim())
        look = {"color": SENSOR, "linewidth": 0.0, "zorder": 0, "label": "strips shared"}
        axes.fill_between(time, *axes.get_ylim(), where=shared, **look)
    if tracks and not turn.lines:
        say_nothing(turn, "no angle is known")
    for axes in (shape, place, turn):
        handles, labels = axes.get_legend_handles_labels()
        if labels:
            legend_above(axes, 3, handles=handles[: 3 * _MOST_NAMED], labels=labels[: 3 * _MOST_NAMED])
    fill_sheet(shape)
    return figure


def _coloured(tracks: Sequence[Track]) -> Iterator[tuple[Track, str, str]]:
    """Give the tracks that have an outline and a place, with a colour and a marker each."""
    palette = (RECOVERED, *OTHERS)
    for number, one in enumerate(tracks):
        if len(one.outline) and one.present.any():
            yield one, palette[number % len(palette)], _MARKERS[number % len(_MARKERS)]


def _draw_bands(bands: list[tuple[Axes, tuple[Any, FloatArray, FloatArray], str]]) -> None:
    """Draw ranges of values over time, cut where they reach further than the values' own span."""
    spans = {axes: axes.get_ylim() for axes, _, _ in bands}
    for axes, (time, low, high), colour in bands:
        axes.fill_between(time, low, high, color=colour, alpha=0.2, linewidth=0.0, zorder=1)
    for axes, (bottom, top) in spans.items():
        lowest, highest = axes.get_ylim()
        axes.set_ylim(max(lowest, 2.0 * bottom - top), min(highest, 2.0 * top - bottom))
