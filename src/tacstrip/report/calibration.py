"""A calibration as one self-contained HTML page: errors before and after, models, excluded rows, graphs, parameters."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.calibrate.unit import Calibrated
from tacstrip.plot.calibrations import draw_all, graphed_strips, strip_errors
from tacstrip.report.page import Picture, write_page


@dataclass(frozen=True)
class ErrorSummary:
    """Errors of all readings [% of Vref], and shares of readings within P.U. profiles I and II [%]."""

    name: str
    rms: float
    largest: float
    within_i: float
    within_ii: float


def error_summaries(result: Calibrated) -> list[ErrorSummary]:
    """Return the errors of raw readings, after the thesis' mean offsets, and after this calibration."""
    made = []
    for name, off in _errors(result).items():
        percent = 100.0 * np.abs(np.concatenate([v[result.counted] for v in off.values()]))
        inside = [float(100.0 * np.mean(percent <= half)) for half in (0.5, 1.0)]
        made.append(ErrorSummary(name, result.rms_percent(off), float(percent.max()), *inside))
    return made


def write_report(result: Calibrated, folder: Path) -> Path:
    """Write report.html and its pictures into a folder, which is made if it is missing; return the page."""
    pictures = [Picture("", caption, file) for caption, file in draw_all(result, folder / "figures")]
    file = folder / "report.html"
    write_page(
        file, "calibration.html.j2", result=result, sensor=result.sensor, calibration=result.sensor.calibration,
        equivalent_noise=equivalent_noise(result), summaries=error_summaries(result), strips=_strips(result),
        wrongest=(wrongest(result), wrongest(result, after=True)), pictures=pictures,
        graphs=len(graphed_strips(result)),
    )  # fmt: skip
    return file


def wrongest(result: Calibrated, most: int = 5, *, after: bool = False) -> list[tuple[int, float]]:
    """Return the strips whose raw readings were furthest off, as files number them, and how far [% of Vref].

    With `after`, those with the largest residuals: what the calibration leaves of the runs that it counts.
    """
    errors, which = (
        (result.after, result.counted) if after else (result.before, np.isfinite(result.runs.l_mm))
    )
    off = np.nan_to_num(strip_errors(errors, which))
    order = np.argsort(-off, kind="stable")[:most]
    return [(int(i) + result.sensor.strip_base, float(off[i])) for i in order]


def equivalent_noise(result: Calibrated) -> str:
    """Say which uniform error has the same standard deviation as the residuals, and which P.U. profile it is."""
    half = np.sqrt(3.0) * max(result.rms_percent({name: off}) for name, off in result.after.items())
    profile = "P.U. profile I" if half <= 0.5 else f"{'' if half <= 1.0 else 'more than '}P.U. profile II"
    return f"The residuals amount to a uniform error of +-{half:.2f} % of Vref: {profile}."


def _errors(result: Calibrated) -> dict[str, dict[str, FloatArray]]:
    return {"raw": result.before, "mean offsets (6.1)-(6.5)": result.mean, "this calibration": result.after}


def _strips(result: Calibrated) -> list[dict[str, object]]:
    """Return the rows of the table of strips, the worst strips first."""
    rows: list[dict[str, object]] = []
    worst = strip_errors(result.after, np.isfinite(result.runs.l_mm))
    for strip in np.argsort(-np.nan_to_num(worst, nan=-1.0), kind="stable").tolist():
        there = result.counted[:, strip]
        for name in result.runs.signatures:
            cells = [_cell(100.0 * off[name][there, strip]) for off in _errors(result).values()]
            rows.append({"strip": strip + result.sensor.strip_base, "signature": name, "cells": cells})
    return rows


def _cell(percent: FloatArray) -> tuple[float, float]:
    if not len(percent):
        return float("nan"), float("nan")
    return float(np.sqrt(np.mean(percent**2))), float(percent[np.abs(percent).argmax()])
