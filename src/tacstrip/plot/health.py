"""The health of a sensor in one picture: faults, readings and noise, strip by strip."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tacstrip.arrays import IntArray
from tacstrip.diagnose.faults import FAULTS, Report
from tacstrip.diagnose.log import Log
from tacstrip.diagnose.noise import PROFILE_I, PROFILE_II
from tacstrip.plot.style import COLOURS, legend, new_panels
from tacstrip.sensor.constructions import SIGNATURES

# Colour and hatch: distinguishable without colour too.
CONDITIONS = {
    "ok": ("#7fb069", ""),
    "degraded": ("#e6a23c", "//"),
    "broken": ("#c1440e", "xx"),
    "unchecked": ("#d9d9d9", ".."),
}


def health_figure(log: Log, report: Report) -> Figure:
    """Draw what is wrong with each strip, what it read, and how noisy it is.

    Parameters
    ----------
    log, report
        A recording, and the findings of `diagnose`.
    """
    figure, (health, readings, noise) = new_panels(9.0, 6.4, 3, 1)
    strips = np.arange(log.sensor.strips) + log.sensor.strip_base
    _draw_health(health, report, strips)
    for name, values in log.raw.items():
        known = np.where(log.touched, values, np.nan)
        shift = 0.12 * (list(log.raw).index(name) - 0.5 * (len(log.raw) - 1))
        for strip, column in zip(strips, known.T, strict=True):
            read = column[np.isfinite(column)]
            if len(read):
                low, middle, high = np.percentile(read, [0.0, 50.0, 100.0])
                readings.plot([strip + shift] * 2, [low, high], color=COLOURS[name], linewidth=1.6)
                readings.plot(strip + shift, middle, "o", color=COLOURS[name], markersize=3.0)
        readings.plot([], [], color=COLOURS[name], label=f"${SIGNATURES[name].symbol}$")
    readings.set_ylabel("raw readings\n[Vref]")
    legend(readings, loc="center left", bbox_to_anchor=(1.0, 0.5))
    half = 100.0 * np.sqrt(3.0) * report.quality.strips
    noise.bar(strips, np.nan_to_num(half), width=0.8, color="#8ea6c4")
    for number, level in (("I", PROFILE_I), ("II", PROFILE_II)):
        noise.axhline(100.0 * level, color="#555555", linewidth=0.8, linestyle="--")
        at = noise.get_yaxis_transform()  # x in parts of the axes
        noise.text(1.0, 100.0 * level, f"profile {number}", transform=at, fontsize=8.0, va="center")
    noise.set(ylabel="P.U. [+-% of Vref]", xlabel="strip")
    for axes in (health, readings, noise):
        axes.set_xlim(strips[0] - 0.6, strips[-1] + 0.6)
    return figure


def _draw_health(axes: Axes, report: Report, strips: IntArray) -> None:
    in_legend = set()
    for i, strip in enumerate(strips):
        condition = report.condition(i)
        colour, hatch = CONDITIONS[condition]
        label = None if condition in in_legend else condition
        style: dict[str, Any] = {"color": colour, "hatch": hatch, "edgecolor": "white", "linewidth": 0.0}
        axes.bar(strip, 1.0, width=0.9, label=label, **style)
        in_legend.add(condition)
        names = "\n".join(sorted({FAULTS[f.fault].title for f in report.of_strip(i)}))
        if names:
            box = {"facecolor": "white", "edgecolor": "none", "boxstyle": "square,pad=0.2"}
            axes.text(strip, 0.5, names, rotation=90, ha="center", va="center", fontsize=7.5, bbox=box)
    axes.set(ylim=(0.0, 1.0), yticks=[])
    whole = sorted({FAULTS[f.fault].title for f in report.findings if not f.strips})
    axes.set_title("all strips: " + ", ".join(whole) if whole else "health")
    legend(axes, loc="center left", bbox_to_anchor=(1.0, 0.5))
