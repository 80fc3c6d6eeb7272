"""What a design of a sensor is measured by: bounds, and what each method makes of simulated scans."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import TypeAlias

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.contact.noise import Noise
from tacstrip.dataset.batches import simulate_many
from tacstrip.dataset.scans import Scans
from tacstrip.dataset.shapes import Shapes
from tacstrip.design.candidates import CONVERSION_S, FARAD
from tacstrip.design.limits import checked_noise
from tacstrip.errors import TacstripError
from tacstrip.geometry.metrics import mismatch
from tacstrip.geometry.outline import Outline
from tacstrip.network.imperfections import Readout
from tacstrip.network.timing import fastest_scan_hz
from tacstrip.reconstruction.cramer_rao import vertex_covariance, vertex_rms
from tacstrip.reconstruction.methods import METHODS, quick_options, reconstruct
from tacstrip.reconstruction.result import RecoveredObject
from tacstrip.sensor.spec import Sensor

Row: TypeAlias = dict[str, float | str | None]

PROBLEM = "problem"  # the column that says what could not be measured, and why
BOUND, RIGHT, COVERAGE, SPEED = "bound", "right", "coverage", "speed"
MEASURES = (BOUND, *METHODS, RIGHT, COVERAGE, SPEED)
_OF_POLYGON = (RIGHT, COVERAGE)  # they judge the polygon fit
COST_S = {BOUND: 1e-3, "polygon": 3e-2, "vertex": 5e-3, "profile": 2e-3}  # roughly, of a scan
DEFINITIONS = 2  # one more where a column's meaning changes: no batch of before is then taken for one of now
_WITHIN = 1.96  # standard deviations that hold 95 %


@dataclass(frozen=True)
class Case:
    """A design, and what it is tried with."""

    sensor: Sensor
    shapes: Shapes
    noise: Noise


def columns(measures: tuple[str, ...]) -> list[str]:
    """Return the names of what `measure` finds, as numbers."""
    found = ["strips", "connectors", "rate_hz"]
    if BOUND in measures:
        found += ["bound_mm", "bound_p90_mm"]
    for method in _methods(measures):
        found += [f"{method}_{name}" for name in ("mm", "p90_mm", "iou", "found")]
        found += [f"{method}_ms"] if SPEED in measures else []
    return found + [name for name in _OF_POLYGON if name in measures]


def measure(case: Case, measures: tuple[str, ...], seed: int) -> Row:
    """Return what a design reaches.

    Parameters
    ----------
    case
        The design; its shapes are drawn from `seed`, for all designs the same numbers.
    measures
        Some of `MEASURES`.
    seed
        Of shapes and errors.

    Returns
    -------
    dict
        Numbers by the names of `columns`; None where there is none. Errors are medians over the objects, p90 is
        reached by nine of ten [mm]: of the bound the root mean square over vertices, of methods the Hausdorff distance
        of the outlines, and `iou` their overlap. All objects count: one without an outline has the distance infinity
        and the overlap 0. `found` is the share of objects that a method gives an outline for, `right` that of scans
        whose objects and corners the polygon fit counts right, `coverage` that of areas and centroids within the 95 %
        that it promises. `rate_hz` is the fastest settled scan, `connectors` what the wiring costs. `problem` says
        what could not be measured.
    """
    sensor = case.sensor
    scans = simulate_many(sensor, case.shapes, case.noise, rng=seed, workers=1)
    row: Row = dict.fromkeys(columns(measures))
    row |= {"strips": float(sensor.strips), "connectors": float(sensor.kind.connectors(sensor.strips))}
    if sensor.adc_bits is not None:
        row["rate_hz"] = fastest_scan_hz(sensor, Readout(), FARAD, CONVERSION_S)
    parts: dict[str, Callable[[], Row]] = {}
    if BOUND in measures:
        parts[BOUND] = lambda: _quantiles(BOUND, list(_bounds(scans, case)))
    parts |= {name: partial(_accuracy, scans, case, name, measures) for name in _methods(measures)}
    problems = []
    for name, part in parts.items():
        try:
            row |= part()
        except TacstripError as error:  # such as a method that is not for this construction
            problems.append(f"{name}: {error}")
    return row | {PROBLEM: "; ".join(problems) or None}


def _methods(measures: tuple[str, ...]) -> list[str]:
    wanted = {*measures, *(["polygon"] if {*_OF_POLYGON, SPEED} & {*measures} else [])}
    return [name for name in METHODS if name in wanted]


def _truths(scans: Scans, i: int) -> list[FloatArray]:
    """Return the corners of a scan's objects from left to right, curves as polygons of many."""
    if scans.labels is None or not scans.labels.kind[i].any():
        return []
    shapes = scans.contact(i).shapes
    return sorted((np.asarray(s.exterior.coords)[:-1] for s in shapes), key=lambda v: float(v[:, 0].mean()))


def _bounds(scans: Scans, case: Case) -> Iterator[float]:
    assert scans.labels is not None
    sigma = checked_noise(case.sensor, case.noise)
    for i in range(len(scans)):
        if (scans.labels.kind[i] > 1).any():
            continue  # curves have no corners
        for corners in _truths(scans, i):
            yield vertex_rms(vertex_covariance(Outline.of(corners), case.sensor, sigma))


def _accuracy(scans: Scans, case: Case, method: str, measures: tuple[str, ...]) -> Row:
    distances: list[float] = []
    overlaps: list[float] = []
    within: list[bool] = []
    right, outlined, objects, took_s = 0, 0, 0, 0.0
    assert scans.labels is not None
    for i, scan in enumerate(scans):
        begun = time.perf_counter()
        result = reconstruct(scan, case.sensor, case.noise, method=method, **quick_options(method))
        took_s += time.perf_counter() - begun
        truths = _truths(scans, i)
        found = sorted((o for o in result.objects if o.found), key=lambda o: float(o.vertices[:, 0].mean()))
        objects += len(truths)
        if len(found) != len(truths):
            distances += [np.inf] * len(truths)
            overlaps += [0.0] * len(truths)
            continue
        outlined += len(truths)
        curved = scans.labels.kind[i] > 1
        right += not curved.any() and all(
            len(o.vertices) == len(t) for o, t in zip(found, truths, strict=True)
        )
        for one, truth in zip(found, truths, strict=True):
            compared = mismatch(truth, one.vertices)
            distances.append(compared.hausdorff)
            overlaps.append(compared.iou)
            within += _within(one, truth)
    row = _quantiles(method, distances)
    row[f"{method}_iou"] = float(np.median(overlaps)) if overlaps else None
    row[f"{method}_found"] = outlined / objects if objects else None
    if SPEED in measures:
        row[f"{method}_ms"] = 1e3 * took_s / len(scans)
    if method == "polygon" and RIGHT in measures:
        row[RIGHT] = right / len(scans)
    if method == "polygon" and COVERAGE in measures:
        row[COVERAGE] = float(np.mean(within)) if within else None
    return row


def _within(found: RecoveredObject, truth: FloatArray) -> list[bool]:
    """Whether area and centroid lie within what the deviations promise; none where there are no deviations."""
    deviations = found.deviations
    if deviations is None:
        return []
    true = RecoveredObject(found.strips, vertices=truth)
    off = [found.area - true.area, *(found.centroid - true.centroid)]
    promised = [deviations[0], *deviations[1]]
    return [bool(abs(a) <= _WITHIN * s) for a, s in zip(off, promised, strict=True)]


def _quantiles(name: str, values: list[float]) -> Row:
    if not values:
        return {f"{name}_mm": None, f"{name}_p90_mm": None}
    ordered = np.sort(values)  # of bounds some may be infinite
    places = (len(ordered) // 2, min(int(0.9 * len(ordered)), len(ordered) - 1))
    middle, most = (float(ordered[i]) for i in places)
    return {f"{name}_mm": middle, f"{name}_p90_mm": most}
