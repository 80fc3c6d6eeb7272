"""The health of a sensor in one picture: faults, readings and noise, strip by strip."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator, MaxNLocator

from tacstrip.arguments import takes
from tacstrip.arrays import FloatArray, IntArray
from tacstrip.diagnose.faults import Report
from tacstrip.diagnose.log import Log
from tacstrip.diagnose.noise import PROFILE_I, PROFILE_II
from tacstrip.plot.theme import COLOURS, MARKERS, axes_or_new, legend, new_figure, themed
from tacstrip.sensor.constructions import SIGNATURES

# Colour and hatch: distinguishable without colour too, from light to dark.
CONDITIONS = {
    "ok": ("#b7dcf0", ""),
    "degraded": ("#e69f00", "//"),
    "broken": ("#b3400a", "xx"),
    "asked": ("#f0e442", "\\\\"),
    "unchecked": ("#eeeeee", ".."),
}
_MOST_FAULTS = 12  # kinds with a row of their own
_THINNEST = 0.004  # of the picture's width: a single strip of many is drawn so wide at least
_ROW_INCH = 0.28
_MOST_NUMBERED = 20  # strips with a number each; of more, every second, fifth ...


@takes(report=Report)
def health(report: Report, *, ax: Axes | None = None) -> Axes:
    """Draw what is wrong with each strip: its condition on top, a row below for each kind of fault that was found.

    Parameters
    ----------
    report
        What `tacstrip.diagnose.diagnose` returned.
    ax
        Axes to draw into; None: new ones on a figure of their own.

    Returns
    -------
    Axes
        x is the strip's number, as the readings file counts.

    Examples
    --------
    >>> import tacstrip as ts
    >>> from tacstrip import plot
    >>> from tacstrip.diagnose import Log, diagnose
    >>> sensor = ts.Sensor(construction="crs-m", strips=8, pitch_mm=10.0, length_mm=100.0)
    >>> rod = ts.Contact.polygon([(0, 30), (40, 30), (40, 60), (0, 60)])
    >>> scans = [ts.simulate(sensor, rod.moved(2 * i, 0), time_s=0.01 * i) for i in range(20)]
    >>> ax = plot.health(diagnose(Log.of_scans(sensor, scans)))
    >>> ax.get_yticklabels()[0].get_text()
    'condition'
    """
    rows = _rows(report)
    axes = axes_or_new(ax, 7.0, _ROW_INCH * (len(rows) + 1) + 1.4)
    strips = np.arange(len(report.touched_scans)) + report.strip_base
    width = max(0.9, _THINNEST * len(strips))
    conditions = [report.condition(i) for i in range(len(strips))]
    for condition in CONDITIONS:
        _bars(axes, 0.0, strips[[c == condition for c in conditions]], condition, width)
    for row, (_, severity, which) in enumerate(rows, 1):
        _bars(axes, float(row), strips[which], severity, width)
        axes.axhline(row - 0.5, color="#dddddd", linewidth=0.5, zorder=0)
    axes.set_yticks(range(len(rows) + 1), ["condition", *(title for title, _, _ in rows)])
    axes.tick_params(axis="y", length=0.0)
    axes.set(xlim=(strips[0] - 0.6, strips[-1] + 0.6), ylim=(len(rows) + 0.5, -0.5), xlabel="strip")
    _number(axes, strips)
    found = len({f.fault for f in report.findings})
    if found > len(rows):
        axes.set_title(f"{len(rows)} of {found} kinds of fault")
    patches = [
        Patch(facecolor=colour, hatch=hatch, edgecolor="white", linewidth=0.0, label=name)
        for name, (colour, hatch) in CONDITIONS.items()
        if name in {*conditions, *(severity for _, severity, _ in rows)}
    ]
    # Above the strips, in a row of its own, for all of them may be full.
    legend(axes, handles=patches, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=5, borderaxespad=0.1)
    return axes


def health_figure(log: Log, report: Report) -> Figure:
    """Draw what is wrong with each strip, what it read, and how noisy it is.

    Parameters
    ----------
    log, report
        A recording, and the findings of `diagnose`.
    """
    above = 0.12 * len(_rows(report))
    figure = new_figure(9.0, 6.4 + _ROW_INCH * len(_rows(report)))
    grid = figure.add_gridspec(3, 1, height_ratios=(0.35 + 2.0 * above, 1.0, 1.0))
    with themed():
        axes, readings, noise = (figure.add_subplot(grid[row]) for row in range(3))
    health(report, ax=axes)
    strips = np.arange(log.sensor.strips) + log.sensor.strip_base
    for name, values in log.raw.items():
        known = np.where(log.touched, values, np.nan)
        shift = 0.12 * (list(log.raw).index(name) - 0.5 * (len(log.raw) - 1))
        _draw_ranges(readings, np.asarray(strips + shift, dtype=float), known, name)
    readings.set(ylabel="raw readings\n[parts of Vref]")
    legend(readings, loc="center left", bbox_to_anchor=(1.0, 0.5))
    half = 100.0 * np.sqrt(3.0) * report.quality.strips
    noise.stairs(np.nan_to_num(half), np.append(strips, strips[-1] + 1) - 0.5, fill=True, color="#8ea6c4")
    for number, level in (("I", PROFILE_I), ("II", PROFILE_II)):
        noise.axhline(100.0 * level, color="#555555", linewidth=0.8, linestyle="--")
        at = noise.get_yaxis_transform()  # x in parts of the axes
        noise.text(1.005, 100.0 * level, f"profile {number}", transform=at, fontsize="small", va="center")
    median = report.quality.half_width_percent
    if np.isfinite(half).any():
        noise.axhline(median, color="#b3400a", linewidth=1.0, label=f"median channel: +-{median:.2g} %")
        legend(noise, loc="lower right")
    else:
        why = "not measured: it needs scans\nthat follow each other closely"
        noise.text(0.5, 0.22, why, transform=noise.transAxes, ha="center", va="center", fontsize="small")
    noise.set(ylabel="noise [+-% of Vref],\nnoisier channel", xlabel="strip")
    for panel in (readings, noise):
        panel.set_xlim(strips[0] - 0.6, strips[-1] + 0.6)
        _number(panel, strips)
    return figure


def _number(axes: Axes, strips: IntArray) -> None:
    """Write the strips' numbers on the x axis, each where there is room."""
    few = len(strips) <= _MOST_NUMBERED
    axes.xaxis.set_major_locator(FixedLocator(strips.tolist()) if few else MaxNLocator(integer=True))


def _rows(report: Report) -> list[tuple[str, str, IntArray]]:
    """Return kinds of fault, severity and strips of each (count,); a fault of the whole sensor is on all strips."""
    every = np.arange(len(report.touched_scans))
    found: dict[str, set[int]] = {}
    for finding in report.findings:
        found.setdefault(finding.fault, set()).update(finding.strips or every.tolist())
    kinds = {f.fault: f.kind for f in report.findings}
    return [
        (kinds[fault].title, kinds[fault].severity, np.array(sorted(strips), dtype=np.int64))
        for fault, strips in list(found.items())[:_MOST_FAULTS]
    ]


def _bars(axes: Axes, row: float, strips: IntArray, condition: str, width: float) -> None:
    """Draw a condition of strips in one row."""
    colour, hatch = CONDITIONS[condition]
    spans = [(strip - 0.5 * width, width) for strip in strips.tolist()]
    axes.broken_barh(
        spans, (row - 0.4, 0.8), facecolor=colour, hatch=hatch, edgecolor="white", linewidth=0.0, zorder=2
    )


def _draw_ranges(axes: Axes, at: FloatArray, read: FloatArray, name: str) -> None:
    """Draw the least, the median and the largest of each strip's readings."""
    some = np.isfinite(read).any(axis=0)
    low, middle, high = (
        np.nanpercentile(read[:, some], [0.0, 50.0, 100.0], axis=0) if some.any() else ([],) * 3
    )
    axes.vlines(at[some], low, high, color=COLOURS[name], linewidth=1.6)
    label = f"${SIGNATURES[name].symbol}$"
    axes.plot(at[some], middle, MARKERS[name], color=COLOURS[name], markersize=3.0, label=label)
