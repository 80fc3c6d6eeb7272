"""Ways to find the kinks of a signature: the polygon fit, and what a user would pick instead."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import redirect_stdout
from importlib import import_module
from io import StringIO

import numpy as np
from _protocol import SIGNATURES, Cell, Trial

import tacstrip as ts
from tacstrip.arrays import FloatArray
from tacstrip.core.problem import FitProblem
from tacstrip.core.search import fit_counts
from tacstrip.reconstruction.cramer_rao import reading_sigma

Finder = Callable[[Cell, Trial], FloatArray]


def problem_of(cell: Cell, of: Trial) -> FitProblem:
    """Return the readings of the strips in contact, with the noise known."""
    readings = {name: of.scan[name][of.scan.touched] for name in SIGNATURES[cell.kind]}
    return FitProblem.of(
        cell.sensor, of.x, readings, reading_sigma(ts.Noise(quantisation=cell.noise), cell.sensor)
    )


def by_fit(cell: Cell, of: Trial) -> FloatArray:
    """Find transitions by the polygon fit alone, as `fit_polygon` does before it judges."""
    problem = problem_of(cell, of)
    return np.asarray(fit_counts(problem).chosen.transitions[1:-1] * problem.width_mm + problem.origin_mm)


def by_savgol(cell: Cell, of: Trial) -> FloatArray:
    """Take the peaks of a Savitzky-Golay second derivative, as high as three deviations of its noise."""
    from scipy.signal import find_peaks, savgol_coeffs, savgol_filter

    n = len(of.x)
    window = max(n // 12 * 2 + 1, 5)
    sigma = reading_sigma(ts.Noise(quantisation=cell.noise), cell.sensor)
    height = 3.0 * sigma * np.sqrt((savgol_coeffs(window, 2, deriv=2) ** 2).sum())
    bend = sum(
        np.abs(savgol_filter(of.scan[s][of.scan.touched], window, 2, deriv=2)) for s in SIGNATURES[cell.kind]
    )
    return np.asarray(of.x[find_peaks(bend, height=height, distance=n // 20)[0]])


def by_piecewise(cell: Cell, of: Trial) -> FloatArray:
    """Fit straight pieces; their count by the library's BIC."""
    library = import_module("piecewise_regression")
    k = of.scan[SIGNATURES[cell.kind][0]][of.scan.touched]
    with redirect_stdout(StringIO()):  # it prints a table
        chosen = library.ModelSelection(of.x, k, max_breakpoints=5, n_boot=5, verbose=False)
    scores = [m["bic"] if m["converged"] else np.inf for m in chosen.model_summaries]
    count = int(chosen.model_summaries[int(np.argmin(scores))]["n_breakpoints"])
    if count == 0:
        return np.empty(0)
    found = library.Fit(of.x, k, n_breakpoints=count, n_boot=5, verbose=False).get_results()["estimates"]
    return np.array([found[f"breakpoint{i + 1}"]["estimate"] for i in range(count)]) if found else np.empty(0)


def by_skchange(cell: Cell, of: Trial) -> FloatArray:
    """Find changes of slope with skchange's continuous piecewise linear score."""
    detectors, scorers = import_module("skchange.detectors"), import_module("skchange.interval_scorers")
    k = of.scan[SIGNATURES[cell.kind][0]][of.scan.touched] / reading_sigma(
        ts.Noise(quantisation=cell.noise), cell.sensor
    )
    detector = detectors.SeededBinarySegmentation(scorers.ContinuousLinearTrendScore())
    return np.asarray(of.x[np.asarray(detector.fit_predict(k[:, None]), dtype=int)])


def by_ruptures(cell: Cell, of: Trial) -> FloatArray:
    """Find changes of slope with ruptures' continuous linear cost and dynamic programming's penalised twin."""
    ruptures = import_module("ruptures")
    k = of.scan[SIGNATURES[cell.kind][0]][of.scan.touched]
    step = max(len(k) // 50, 1)
    detector = ruptures.Pelt(custom_cost=ruptures.costs.CostCLinear(), min_size=2 * step, jump=step).fit(
        k[:, None]
    )
    variance = reading_sigma(ts.Noise(quantisation=cell.noise), cell.sensor) ** 2
    ends = detector.predict(pen=variance * 3.0 * np.log(len(k)))
    return np.asarray(of.x[np.array(ends[:-1], dtype=int)])


FINDERS: dict[str, tuple[Finder, str]] = {
    "polygon": (by_fit, ""),
    "savgol": (by_savgol, "scipy"),
    "piecewise-regression": (by_piecewise, "piecewise_regression"),
    "skchange": (by_skchange, "skchange"),
    "ruptures": (by_ruptures, "ruptures"),
}
