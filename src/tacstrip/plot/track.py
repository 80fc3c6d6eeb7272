"""Objects over time: their ways over the sensor, the shapes that all scans give, and their poses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from tacstrip.geometry.region import regions
from tacstrip.plot.scene import draw_polygon, draw_sensor, x_label
from tacstrip.plot.style import OTHERS, RECOVERED, SENSOR, legend, new_panels
from tacstrip.sensor.spec import Sensor
from tacstrip.tracking.track import Track

_DRAWN = 6  # outlines on each way


def track_figure(sensor: Sensor, tracks: Sequence[Track]) -> Figure:
    """Draw tracks: where they went, what they look like, and how they turned."""
    figure, (way, shape, pose) = new_panels(12.0, 4.6, 1, 3)
    draw_sensor(way, sensor)
    way.set(xlabel=x_label(sensor), ylabel="y [mm]", title="ways over the sensor")
    shape.set(xlabel="x [mm]", ylabel="y [mm]", title="shapes in their own frames, 95 % regions")
    shape.set_aspect("equal", adjustable="datalim")
    pose.set(xlabel="time [s]", ylabel="[mm], and [deg] dashed", title="x, y and angle")
    shared, marked = np.zeros(len(tracks[0].times_s) if tracks else 0, dtype=bool), False
    for track, colour in zip(tracks, [RECOVERED, *OTHERS] * len(tracks), strict=False):
        seen, doubtful = np.flatnonzero(track.present), track.status not in ("ok", "likely")
        if not len(track.outline) or not len(seen):
            continue
        way.plot(*track.poses[:, :2].T, color=colour, linewidth=0.9)
        for i in seen[np.unique(np.linspace(0, len(seen) - 1, _DRAWN).astype(int))]:
            draw_polygon(way, track.placed(int(i)), colour, doubtful=doubtful)
        draw_polygon(shape, track.outline, colour, f"{track.id}: {track.status}", doubtful=doubtful)
        for other in track.alternatives:
            ring = np.concatenate([other.vertices, other.vertices[:1]])
            shape.plot(*ring.T, color=colour, linestyle="--", linewidth=0.8, label=f"or: {other.weight:.2f}")
        if track.covariance is not None:
            for region in regions(track.outline, track.covariance):
                shape.fill(*region.T, color=colour, alpha=0.25)
        time = track.times_s if np.diff(track.times_s).any() else np.arange(len(track.times_s))
        together = np.zeros(len(time), dtype=bool)
        together[list(track.joint)] = True
        way.plot(*track.poses[together, :2].T, "o", color=colour, markersize=2.5, fillstyle="none")
        shared |= together
        pose.plot(time, track.poses[:, 0], color=colour, label=f"{track.id}: x")
        pose.plot(time, track.poses[:, 1], color=colour, alpha=0.5, label=f"{track.id}: y")
        pose.plot(
            time, np.rad2deg(track.poses[:, 2]), color=colour, linestyle="--", label=f"{track.id}: angle"
        )
    for run in np.split(np.flatnonzero(shared), np.flatnonzero(np.diff(np.flatnonzero(shared)) > 1) + 1):
        if len(run):
            pose.axvspan(
                time[run[0]], time[run[-1]], color=SENSOR, zorder=0, label=None if marked else "strips shared"
            )
            marked = True
    for axes in (shape, pose):
        if axes.get_legend_handles_labels()[1]:
            legend(axes)
    return figure
