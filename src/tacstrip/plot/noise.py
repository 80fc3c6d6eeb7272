"""The Allan deviation of a sensor's channels: how far averaging helps."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from tacstrip.diagnose.learned_noise import LearnedNoise
from tacstrip.plot.theme import OTHERS, RECOVERED, TRUE, legend, new_axes


def allan_figure(found: LearnedNoise) -> Figure:
    """Draw each channel's Allan deviation over the time averaged, white noise's line, and the least that is left."""
    figure, axes = new_axes(6.0, 4.2)
    time_s = found.counts * found.period_s
    middle = np.nanmedian(found.allan, axis=1)
    for i, channel in enumerate(found.allan.T):
        label = f"{len(found.channels)} channels" if i == 0 else None
        axes.loglog(time_s, 100.0 * channel, color=TRUE, alpha=0.3, linewidth=0.7, label=label)
    axes.loglog(time_s, 100.0 * middle, "o-", color=RECOVERED, markersize=3.0, label="median")
    white = found.noise.white or float(middle[0])
    averaged = 100.0 * white / np.sqrt(found.counts)
    axes.loglog(time_s, averaged, "--", color=OTHERS[0], label="white noise alone")
    least = float(100.0 * np.nanmin(middle))
    axes.axhline(least, color=OTHERS[1], linewidth=0.8, label=f"least: {least:.2g} %")
    axes.set_xlabel("time averaged [s]")
    axes.set_ylabel("Allan deviation [% of Vref]")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        minor = FuncFormatter(lambda value, _: f"{value:.2g}" if f"{value:.0e}"[0] in "25" else "")
        axis.set_minor_formatter(minor)
    legend(axes)
    return figure
