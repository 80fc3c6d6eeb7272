"""Pictures of a calibration: the thesis' calibration graphs (figures 6.2-6.4, 6.24-6.26, 6.34), and its residuals."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tacstrip.arrays import FloatArray
from tacstrip.calibrate.residuals import expected
from tacstrip.calibrate.unit import Calibrated
from tacstrip.plot.style import COLOURS, TRUE, legend_above, new_panels, save
from tacstrip.sensor.constructions import SIGNATURES

_PROFILES = {"I": 0.5, "II": 1.0}  # half-widths of the thesis' P.U. profiles [% of Vref] (5.1.3)
_MOST_LENGTHS = 3
_MOST_STRIPS = 12  # with graphs: nobody looks through more
_LEAST_SPAN = 0.2  # of Vref, in a graph: the error of a single point must not be exaggerated


def draw_all(result: Calibrated, folder: Path) -> list[tuple[str, Path]]:
    """Write all pictures into a folder and return caption and file of each."""
    folder.mkdir(parents=True, exist_ok=True)
    figures = {
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
        axes.set_title(f"strip {strip + sensor.strip_base}, {volt}, w = {w:g} mm")
        low, high = axes.get_ylim()
        missing = max(_LEAST_SPAN * vref - (high - low), 0.0)
        axes.set(ylim=(low - 0.5 * missing, high + 0.5 * missing), xlabel="l [mm]", ylabel=f"{volt} [V]")
        axes.set_xlim(-0.03 * sensor.length_mm, 1.03 * sensor.length_mm)
    legend_above(panels[0])
    return figure


def residuals_by_strip(result: Calibrated) -> Figure:
    """Draw every row's error by strip: raw, after the thesis' mean offsets, after this calibration."""
    figure, panels = new_panels(11.0, 3.6, 1, 3)
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
    figure, panels = new_panels(9.0, 3.6, 1, 2)
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
        axes.set(title=title, xlabel="middle of the contact [mm]", ylabel="error [% of Vref]")
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
