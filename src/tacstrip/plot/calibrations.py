"""Pictures of a calibration: the thesis' calibration graphs (figures 6.2-6.4, 6.24-6.26, 6.34), and its residuals."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from itertools import product
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tacstrip.arguments import takes
from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.calibrate.residuals import expected
from tacstrip.calibrate.unit import Calibrated
from tacstrip.errors import ArgumentError
from tacstrip.plot.theme import (
    COLOURS,
    OTHERS,
    RECOVERED,
    STRIP,
    TRUE,
    axes_or_new,
    legend_above,
    new_panels,
    plain_ticks,
    save,
)
from tacstrip.sensor.constructions import SIGNATURES

_PROFILES = {"I": 0.5, "II": 1.0}  # half-widths of the thesis' P.U. profiles [% of Vref] (5.1.3)
_MOST_LENGTHS = 3
_MOST_STRIPS = 12  # with graphs: nobody looks through more
_LEAST_SPAN = 0.2  # of Vref, in a graph: the error of a single point must not be exaggerated


@takes(result=Calibrated)
def calibration(result: Calibrated, *, most: int = 24, ax: Axes | None = None) -> Axes:
    """Draw the error of each strip before and after calibration, the worst strips first.

    Parameters
    ----------
    result
        What `ts.calibrate_unit` returned.
    most
        Strips that are drawn; of more the title says how many there are.
    ax
        Axes to draw into; None: new ones on a figure of their own.

    Returns
    -------
    Axes
        Strips from the worst to the best, by their numbers in files; root mean square error of their readings
        [% of Vref], on a logarithmic axis. Rows that do not count have a cross of their own.

    Examples
    --------
    >>> import numpy as np
    >>> import tacstrip as ts
    >>> from tacstrip import plot
    >>> sensor = ts.Sensor(construction="crs-m", strips=3, pitch_mm=6.5, length_mm=325.0, strip_base=1)
    >>> l_mm = np.repeat([[50.0], [150.0], [250.0]], 3, axis=1)  # (contacts, strips)
    >>> error = np.array([[0.02, -0.01, 0.010], [0.02, -0.01, 0.012], [0.02, -0.01, 0.008]])
    >>> runs = ts.Runs(l_mm, 0.0 * l_mm, {"k": ts.signatures(sensor, l_mm, l_mm)["k"] + error},
    ...                line=np.arange(2, 11).reshape(3, 3), rest={})
    >>> ax = plot.calibration(ts.calibrate_unit(sensor, runs, model="offset"))
    >>> ax.get_xticklabels()[0].get_text()
    '3'
    """
    if not isinstance(most, int) or most < 1:
        raise ArgumentError(f"most = {most!r}: draw 1 strip or more")
    every = np.isfinite(result.runs.l_mm)
    worst = strip_errors(result.after, every)
    order = [int(i) for i in np.argsort(-worst, kind="stable") if np.isfinite(worst[i])]
    shown = order[:most]
    axes = axes_or_new(ax, max(4.0, 0.26 * len(shown) + 1.6), 3.4)
    at = np.arange(len(shown))
    least = 0.001  # % of Vref: finer than any converter
    before, done, left_out = (
        np.maximum(strip_errors(off, which)[shown], least)
        for off, which in (
            (result.before, result.counted),
            (result.after, result.counted),
            (result.after, every & ~result.counted),
        )
    )
    axes.vlines(at, done, before, color=STRIP, linewidth=2.0, zorder=1)
    axes.plot(at, before, "o", color=OTHERS[0], markerfacecolor="white", markersize=5.0, label="as it was")
    axes.plot(at, done, "o", color=RECOVERED, markersize=5.0, label="calibrated")
    if np.isfinite(left_out).any():
        axes.plot(at, left_out, "x", color="black", markersize=4.0, label="rows that do not count")
    for name, half in _PROFILES.items():
        sigma = half / np.sqrt(3.0)
        label, dashes = f"error of P.U. profile {name}", "--" if name == "I" else ":"
        axes.axhline(sigma, color=TRUE, linewidth=0.8, linestyle=dashes, zorder=0, label=label)
    axes.set_yscale("log")
    axes.set_xticks(at, [str(i + result.uncalibrated.strip_base) for i in shown])
    axes.set(xlabel="strip, the worst first", ylabel="error, RMS [% of Vref]", xlim=(-0.7, len(shown) - 0.3))
    legend_above(axes, 3)
    plain_ticks(axes.yaxis)
    if len(shown) < len(order):
        axes.set_title(f"the worst {len(shown)} of {len(order)} strips")
    return axes


def strip_errors(off: Mapping[str, FloatArray], which: BoolArray) -> FloatArray:
    """Return each strip's root mean square error over signatures and contacts (strips,) [% of Vref]; NaN without.

    `off` are errors by signature over Vref, `which` the rows that are meant, both (contacts, strips).
    """
    squares = [np.where(which, np.square(values), np.nan) for values in off.values()]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # strips without such a row
        return np.asarray(100.0 * np.sqrt(np.nanmean(np.concatenate(squares), axis=0)))


def draw_all(result: Calibrated, folder: Path) -> list[tuple[str, Path]]:
    """Write all pictures into a folder and return caption and file of each."""
    folder.mkdir(parents=True, exist_ok=True)
    worst = calibration(result).figure
    assert isinstance(worst, Figure)
    figures = {
        "worst": ("Error of each strip before and after calibration, the worst strips first", worst),
        "errors": ("Errors of readings of known contacts, strip by strip", residuals_by_strip(result)),
        "residuals": ("Residuals along the strips, all strips together", residuals_along_strips(result)),
    }
    made = [(caption, save(figure, folder / f"{name}.png")) for name, (caption, figure) in figures.items()]
    for strip in graphed_strips(result):
        number = strip + result.uncalibrated.strip_base
        file = save(calibration_graphs(result, strip), folder / f"strip-{number}.png")
        made.append((f"Calibration graphs of strip {number}", file))
    return made


def graphed_strips(result: Calibrated) -> list[int]:
    """Return the strips that get graphs, from 0: all, or of many those with the largest residuals."""
    off = [np.where(result.counted, np.abs(v), 0.0) for v in result.after.values()]
    largest = np.nanmax(off, axis=(0, 1))
    return sorted(int(strip) for strip in np.argsort(-largest, kind="stable")[:_MOST_STRIPS])


def calibration_graphs(result: Calibrated, strip: int) -> Figure:
    """Draw measured, corrected and expected voltages of a strip over l: a row per signature, a column per length w."""
    sensor, runs = result.uncalibrated, result.runs
    lengths = _lengths(runs.w_mm[:, strip])
    names = runs.signatures
    figure, panels = new_panels(3.6 * len(lengths), 2.9 * len(names), len(names), len(lengths))
    truth, vref = expected(result.sensor, runs), sensor.vref_volt
    for axes, (name, w) in zip(panels, product(names, lengths), strict=True):
        here = np.flatnonzero(runs.w_mm[:, strip] == w)
        here = here[np.argsort(runs.l_mm[here, strip], kind="stable")]
        l, fitted = runs.l_mm[here, strip], vref * truth[name][here, strip]
        axes.plot(l, fitted, "o-", color=TRUE, label="expected", ms=6.0, mfc="none", mew=0.7)
        axes.plot(l, vref * runs.raw[name][here, strip], "x", color=COLOURS[name], label="measured", ms=5.0)
        off = vref * result.after[name][here, strip]
        axes.plot(l, fitted + off, ".", color="k", label="corrected", ms=3.0)
        volt = SIGNATURES[name].volt_column
        axes.set_title(f"strip {strip + sensor.strip_base}, w = {w:g} mm", fontsize="medium")
        low, high = axes.get_ylim()
        missing = max(_LEAST_SPAN * vref - (high - low), 0.0)
        axes.set(ylim=(low - 0.5 * missing, high + 0.5 * missing), xlabel="l [mm]", ylabel=f"{volt} [V]")
        axes.set_xlim(-0.03 * sensor.length_mm, 1.03 * sensor.length_mm)
    legend_above(panels[0])
    return figure


def residuals_by_strip(result: Calibrated) -> Figure:
    """Draw every row's error by strip: raw, after the thesis' mean offsets, after this calibration."""
    figure, panels = new_panels(7.0, 7.2, 3, 1)
    strip, counted = np.nonzero(result.counted)[1] + result.uncalibrated.strip_base, result.counted
    stages = {"raw": result.before, "mean offsets (6.1)-(6.5)": result.mean, result.model: result.after}
    for axes, (title, off) in zip(panels, stages.items(), strict=True):
        for i, (name, values) in enumerate(off.items()):
            shift = 0.3 * (i - 0.5 * (len(off) - 1))
            axes.plot(strip + shift, 100.0 * values[counted], "_", color=COLOURS[name], ms=5.0, label=name)
        axes.set_title(f"{title}: {result.rms_percent(off):.2f} % rms")
        axes.set(xlabel="strip", ylabel="error [% of Vref]")
        if title != "raw":
            _bands(axes)
        legend_above(axes)
    return figure


def residuals_along_strips(result: Calibrated) -> Figure:
    """Draw the residuals of mean offsets and of this calibration over the contact's middle, by its length."""
    figure, panels = new_panels(7.0, 3.6, 1, 2)
    middle = result.runs.l_mm + 0.5 * result.runs.w_mm
    stages = (("mean offsets", result.mean), (result.model, result.after))
    for axes, (title, off) in zip(panels, stages, strict=True):
        for i, w in enumerate(_lengths(result.runs.w_mm.ravel())):
            here = result.counted & (result.runs.w_mm == w)
            colour = list(COLOURS.values())[i]
            for j, values in enumerate(off.values()):
                label = f"w = {w:g} mm" if j == 0 else None
                axes.plot(middle[here], 100.0 * values[here], ".", color=colour, ms=2.0, label=label)
        _bands(axes)
        axes.set_title(title, fontsize="medium")  # a model of many parts is long
        axes.set(xlabel="middle of the contact [mm]", ylabel="error [% of Vref]")
        legend_above(axes)
    return figure


def _lengths(w_mm: FloatArray) -> list[float]:
    """Return the lengths that most contacts have, ascending."""
    lengths, counts = np.unique(w_mm[np.isfinite(w_mm)], return_counts=True)
    return sorted(float(w) for w in lengths[np.argsort(-counts, kind="stable")[:_MOST_LENGTHS]])


def _bands(axes: Axes) -> None:
    """Draw the half-widths of P.U. profiles I and II."""
    for name, half in _PROFILES.items():
        alpha = 0.2 if half == min(_PROFILES.values()) else 0.08
        axes.axhspan(-half, half, color=TRUE, alpha=alpha, label=f"P.U. profile {name}", zorder=0)
