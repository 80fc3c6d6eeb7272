"""A calibration as one self-contained HTML page: errors before and after, models, rows left out, graphs, parameters."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.calibrate.unit import Calibrated
from tacstrip.data import data_path
from tacstrip.files import write_text
from tacstrip.plot.calibration import draw_all, graphed_strips
from tacstrip.report.page import Picture


@dataclass(frozen=True)
class Stage:
    """Errors of all readings at one stage [% of Vref], and shares of readings [%]."""

    name: str
    rms: float
    largest: float
    in_1: float
    in_2: float


def stages(result: Calibrated) -> list[Stage]:
    """Return the errors of raw readings, after the thesis' mean offsets, and after this calibration."""
    made = []
    for name, off in _stages(result).items():
        percent = 100.0 * np.abs(np.concatenate([v[result.counted] for v in off.values()]))
        inside = [float(100.0 * np.mean(percent <= half)) for half in (0.5, 1.0)]
        made.append(Stage(name, result.rms_percent(off), float(percent.max()), *inside))
    return made


def write_report(result: Calibrated, folder: Path) -> Path:
    """Write report.html and its pictures into a folder, which is made if it is missing; return the page."""
    import jinja2

    pictures = [Picture("", caption, file) for caption, file in draw_all(result, folder / "figures")]
    template = data_path("calibration.html.j2").read_text(encoding="utf-8")
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    file = folder / "report.html"
    page = environment.from_string(template).render(
        sensor=result.sensor, calibration=result.sensor.calibration, count=result.runs.count, bad=result.bad,
        model=result.model, verdict=verdict(result), stages=stages(result), strips=_strips(result),
        trials=result.trials, status=result.status, advice=result.advice, pictures=pictures,
        parameters=result.parameters, graphs=len(graphed_strips(result)),
    )  # fmt: skip
    write_text(file, page)
    return file


def verdict(result: Calibrated) -> str:
    """Say in the thesis' terms how good the readings are now."""
    half = (
        100.0
        * float(np.sqrt(3.0))
        * max(float(np.sqrt(np.mean(v[result.counted] ** 2))) for v in result.after.values())
    )
    profile = (
        "P.U. profile I" if half <= 0.5 else "P.U. profile II" if half <= 1.0 else "more than P.U. profile II"
    )
    return f"What is left is as a uniform error of +-{half:.2f} % of Vref: {profile}."


def _stages(result: Calibrated) -> dict[str, dict[str, FloatArray]]:
    return {"raw": result.before, "mean offsets (6.1)-(6.5)": result.mean, "this calibration": result.after}


def _strips(result: Calibrated) -> list[dict[str, object]]:
    rows: list[dict[str, object]] = []
    for strip in range(result.sensor.strips):
        there = result.counted[:, strip]
        for name in result.runs.signatures:
            cells = [_cell(100.0 * off[name][there, strip]) for off in _stages(result).values()]
            rows.append({"strip": strip + result.sensor.strip_base, "signature": name, "cells": cells})
    return rows


def _cell(percent: FloatArray) -> tuple[float, float]:
    if not len(percent):
        return float("nan"), float("nan")
    return float(np.sqrt(np.mean(percent**2))), float(percent[np.abs(percent).argmax()])
