"""Pictures of a calibration: the thesis' calibration graphs (figures 6.2-6.4, 6.24-6.26, 6.34), and its residuals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tacstrip.arrays import FloatArray
from tacstrip.calibrate.residuals import expected
from tacstrip.calibrate.unit import Calibrated
from tacstrip.plot.style import COLOURS, TRUE, add_axes, legend_above, new_figure, save
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
    largest = np.max(
        [np.nanmax(np.where(result.counted, np.abs(v), 0.0), axis=0) for v in result.after.values()], axis=0
    )
    return sorted(int(strip) for strip in np.argsort(-largest, kind="stable")[:_MOST_STRIPS])


def calibration_graphs(result: Calibrated, strip: int) -> Figure:
    """Draw measured, corrected and expected voltages of a strip over l: a row per signature, a column per length w."""
    sensor, runs = result.uncalibrated, result.runs
    lengths = _lengths(runs.w_mm[:, strip])
    names = runs.signatures
    figure = new_figure(3.6 * len(lengths), 2.9 * len(names))
    truth = expected(result.sensor, runs)
    number = 0
    for name in names:
        for w in lengths:
            number += 1
            axes = add_axes(figure, len(names), len(lengths), number)
            here = np.flatnonzero(runs.w_mm[:, strip] == w)
            here = here[np.argsort(runs.l_mm[here, strip], kind="stable")]
            l = runs.l_mm[here, strip]
            vref = sensor.vref_volt
            fitted = truth[name][here, strip]
            axes.plot(l, vref * fitted, "o-", color=TRUE, label="expected", ms=6.0, mfc="none", mew=0.7)
            axes.plot(
                l, vref * runs.raw[name][here, strip], "x", color=COLOURS[name], label="measured", ms=5.0
            )
            corrected = vref * (fitted + result.after[name][here, strip])
            axes.plot(l, corrected, ".", color="k", label="corrected", ms=3.0)
            axes.set(
                title=f"strip {strip + sensor.strip_base}, {SIGNATURES[name].volt_column}, w = {w:g} mm",
                xlabel="l [mm]",
                ylabel=f"{SIGNATURES[name].volt_column} [V]",
            )
            low, high = axes.get_ylim()
            missing = max(_LEAST_SPAN * vref - (high - low), 0.0)
            axes.set(
                ylim=(low - 0.5 * missing, high + 0.5 * missing),
                xlim=(-0.03 * sensor.length_mm, 1.03 * sensor.length_mm),
            )
            if number == 1:
                legend_above(axes)
    return figure


def residuals_by_strip(result: Calibrated) -> Figure:
    """Draw every row's error by strip: raw, after the thesis' mean offsets, after this calibration."""
    figure = new_figure(11.0, 3.6)
    stages = {"raw": result.before, "mean offsets (6.1)-(6.5)": result.mean, result.model: result.after}
    for number, (title, off) in enumerate(stages.items(), start=1):
        axes = add_axes(figure, 1, 3, number)
        for i, (name, values) in enumerate(off.items()):
            strips, percent = _counted(result, values)
            shift = 0.3 * (i - 0.5 * (len(off) - 1))
            axes.plot(strips + shift, percent, "_", color=COLOURS[name], ms=5.0, label=name)
        axes.set(
            title=f"{title}: {result.rms_percent(off):.2f} % rms", xlabel="strip", ylabel="error [% of Vref]"
        )
        if number > 1:
            _bands(axes)
        legend_above(axes)
    return figure


def residuals_along_strips(result: Calibrated) -> Figure:
    """Draw the residuals of mean offsets and of this calibration over the contact's middle, by its length."""
    figure = new_figure(9.0, 3.6)
    middle = result.runs.l_mm + 0.5 * result.runs.w_mm
    for number, (title, off) in enumerate(
        (("mean offsets", result.mean), (result.model, result.after)), start=1
    ):
        axes = add_axes(figure, 1, 2, number)
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


def _counted(result: Calibrated, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    strips = np.nonzero(result.counted)[1]
    return strips.astype(np.float64) + result.uncalibrated.strip_base, 100.0 * values[result.counted]


def _bands(axes: Axes) -> None:
    """Draw the half-widths of P.U. profiles I and II."""
    for name, half in _PROFILES.items():
        alpha = 0.2 if half == min(_PROFILES.values()) else 0.08
        axes.axhspan(-half, half, color=TRUE, alpha=alpha, label=f"P.U. profile {name}", zorder=0)
