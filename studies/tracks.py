"""Pictures of shapes over time: paths, shape and poses; and how the shape sharpens with the scans."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from matplotlib.figure import Figure

import tacstrip as ts
from tacstrip.arrays import FloatArray
from tacstrip.geometry.region import regions
from tacstrip.plot.scene import draw_polygon
from tacstrip.plot.theme import OTHERS, RECOVERED, TRUE, new_panels
from tacstrip.plot.tracks import track_figure

_CORNERS = np.array([(-25.0, -18.0), (22.0, -20.0), (26.0, 8.0), (0.0, 25.0), (-20.0, 14.0)])
_SENSOR = ts.Sensor(construction="crs-crs", strips=10, pitch_mm=10.0, length_mm=100.0)
_NOISE = ts.Noise(positional=0.005)
_COUNTS = (1, 5, 12, 50)


def _scans(count: int) -> list[ts.Scan]:
    return [ts.simulate(_SENSOR, _pressed(i), _NOISE, rng=i, time_s=0.02 * i) for i in range(count)]


def _pressed(scan: int) -> ts.Contact:
    t = scan / 49.0
    return (
        ts.Contact.polygon(_CORNERS)
        .turned(0.3 + 1.2 * t)
        .placed(42.0 + 16.0 * t, 50.0 + 6.0 * math.sin(3.0 * t))
    )


def way() -> Figure:
    """Draw what `tacstrip track` finds of fifty scans."""
    return track_figure(_SENSOR, ts.track(_scans(50), _SENSOR, _NOISE))


def sharpening() -> Figure:
    """Draw the shape known from one scan and from more, with 95 % regions of its corners."""
    figure, panels = new_panels(7.0, 6.8, 2, 2)
    for axes, count in zip(panels, _COUNTS, strict=True):
        scans = _scans(count)
        if count == 1:
            one = ts.fit_polygon(scans[0], _SENSOR, _NOISE).objects[0]
            shape, covariance = one.vertices, one.covariance
        else:
            (found,) = ts.track(scans, _SENSOR, _NOISE)
            shape, covariance = found.outline, found.covariance
        true = _pressed(0).vertices if count == 1 else _onto(shape)
        axes.fill(*true.T, color=TRUE, alpha=0.25, label="true shape")
        draw_polygon(axes, shape, RECOVERED, "recovered")
        for region in regions(shape, covariance):
            axes.fill(*region.T, color=OTHERS[0], alpha=0.25)
        middle = true.mean(axis=0)
        axes.set(aspect="equal", xlim=(middle[0] - 42, middle[0] + 42), ylim=(middle[1] - 42, middle[1] + 42))
        axes.set_title(f"{count} scan" + ("s" if count > 1 else ""), fontsize=10.0)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2, frameon=False)
    return figure


def _onto(found: FloatArray) -> FloatArray:
    """Return the true corners, moved and turned to where the found ones are: nearest over all turns."""
    best, least = _CORNERS, math.inf
    middle = found.mean(axis=0)
    for angle in np.radians(np.arange(0.0, 360.0, 0.25)):
        cos, sin = math.cos(angle), math.sin(angle)
        placed = (_CORNERS - _CORNERS.mean(axis=0)) @ np.array([[cos, sin], [-sin, cos]]) + middle
        far = float(np.linalg.norm(found[:, None] - placed, axis=2).min(axis=1).sum())
        if far < least:
            best, least = placed, far
    return np.asarray(best)


FIGURES: dict[str, Callable[[], Figure]] = {"tracks": way, "tracks_sharpening": sharpening}
