"""Tables 5.2-5.14: the errors of each method on noisy scans, compared with the printed values.

A cell is one row of a table at one position. Each of its seeds draws the errors of 5.1 anew: readings get
C.Q.E. and P.U., and the true transitions get T.E. before Vertex Reconstruction gets them, which
reads the nearest strip, as the thesis does. Rows with P.U. are run a second time with transitions found by
the gradient rule: a shape that fails there, or comes back with another number of vertices, counts as the
thesis' "-". Profiles are compared as polygons at the original's vertex columns (`profile_at`).

The polygon fit is run on the same cells and gets the readings that the table's method gets: one signature where the
table is Vertex Reconstruction's, both where it is Profile Reconstruction's. It finds vertices and their number itself;
the errors' half-widths are known to it. As Vertex Reconstruction is given the transitions, and so their number, the
fit is run with that number known, too. The Cramer-Rao bound is given in the same measures: those of polygons drawn
with the bound's covariance about the true one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.contact.noise import Noise, add_transition_errors
from tacstrip.contact.shape import Contact
from tacstrip.data.published import METRICS, Row, rows
from tacstrip.geometry.metrics import errors_of_many, mismatch
from tacstrip.geometry.outline import Outline
from tacstrip.reconstruction.cramer_rao import reading_sigma, vertex_covariance
from tacstrip.reconstruction.profile import profile_at, profile_reconstruction
from tacstrip.reconstruction.result import RecoveredObject
from tacstrip.reconstruction.vertex.estimate import vertex_reconstruction
from tacstrip.scan import Scan
from tacstrip.simulation import simulate
from tacstrip.thesis.ranges import POINTS, is_inside, ranges
from tacstrip.thesis.shapes import POSITIONS, SHAPES, SIMULATED

Verdict: TypeAlias = tuple[bool, bool]  # below the printed value, at the bound's median
_DRAWS = 100  # of the bound
WITHIN = 1.15  # of the bound's median counts as reaching it
_SEEDS_PER_FIT = 4  # the polygon fit takes much longer


@dataclass(frozen=True)
class FitErrors:
    """Errors of the polygon fit on one scan.

    Attributes
    ----------
    measures
        M.C. [rad], A.O.E. [rad], A.P.E. [mm] (3,); NaN without a shape.
    vertices
        Their number; 0 without a shape.
    known_count
        The same measures of the fit that knows the number of vertices.
    """

    measures: FloatArray
    vertices: int
    known_count: FloatArray


def fit_errors(row: Row, position: int, noise: Noise, random: np.random.Generator) -> FitErrors:
    """Simulate and fit one scan of a cell, with the signatures that the row's method uses.

    Both ends of the shape are moved at random within a pitch and the rest stretched with them: ours have their
    vertices on strips, and an end there lies at the limit of what the touched strips say about it.
    """
    from tacstrip.reconstruction.polygon.estimate import fit_polygon  # in the workers only

    sensor, contact = SIMULATED[row.construction], SHAPES[row.shape].contact(position)
    x, y = contact.vertices.T
    ends = np.array([x.min(), x.max()])
    shifted = ends + sensor.pitch_mm * random.uniform(-0.5, 0.5, 2)
    contact = Contact.polygon(np.stack([np.interp(x, ends, shifted), y], 1))
    scan = simulate(sensor, contact, noise, rng=random)
    if row.signature is not None:
        scan = Scan(time_s=0.0, **{row.signature: scan[row.signature]})

    def of(count: int | None) -> tuple[FloatArray, int]:
        found = fit_polygon(scan, sensor, noise, vertices=count, assessment="none")
        objects = [o for o in found.objects if o.found]
        if not objects:
            return np.full(3, np.nan), 0
        largest = max(objects, key=lambda o: o.area)
        return errors_of_many(contact.vertices, largest.vertices[np.newaxis])[0], len(largest.vertices)

    count = len(contact.vertices)
    measures, found = of(None)
    return FitErrors(measures, found, measures if found == count else of(count)[0])


def bound_medians(row: Row, position: int, noise: Noise) -> FloatArray:
    """Return the medians (3,) of M.C., A.O.E. and A.P.E. at the bound; inf where a vertex is undetermined."""
    sensor = SIMULATED[row.construction]
    outline = Outline.of(SHAPES[row.shape].contact(position).vertices)
    names = None if row.signature is None else (row.signature,)
    covariance = vertex_covariance(outline, sensor, reading_sigma(noise, sensor), names)
    if not np.isfinite(covariance).all():
        return np.full(3, np.inf)
    true = outline.vertices
    random = np.random.default_rng([position, 5])
    error = random.multivariate_normal(np.zeros(true.size), covariance, _DRAWS, method="eigh")
    # The touched strips give the x of an end to within a pitch: a uniform error. The rest is conditional on it.
    ends = 2 * np.array([true[:, 0].argmin(), true[:, 0].argmax()])
    wide = np.sqrt(3.0 * covariance[ends, ends])
    lean = covariance[:, ends] @ np.linalg.inv(covariance[np.ix_(ends, ends)])
    error += (random.uniform(-wide, wide, (_DRAWS, 2)) - error[:, ends]) @ lean.T
    drawn = true + error.reshape(_DRAWS, -1, 2)
    return np.asarray(np.nanmedian(errors_of_many(true, drawn), axis=0))


def reached(row: Row, medians: FloatArray, bound: FloatArray, position: int) -> list[Verdict | None]:
    """Compare a cell's medians (3,) with print and bound: (below the printed value, at the bound's median).

    None where nothing is printed.
    """
    printed = [row.printed[metric][position] for metric in METRICS]
    verdicts = zip((medians < printed).tolist(), (medians <= WITHIN * bound).tolist(), strict=True)
    return [None if np.isnan(value) else verdict for value, verdict in zip(printed, verdicts, strict=True)]


NOISES = {
    "ideal": Noise(),
    "quantisation": Noise(quantisation=0.001, transition_mm=5.0),
    "quantisation + profile I": Noise(quantisation=0.001, positional=0.005, transition_mm=5.0),
    "quantisation + profile II": Noise(quantisation=0.001, positional=0.01, transition_mm=5.0),
}


@dataclass(frozen=True)
class Cell:
    """All seeds of one row at one position.

    Attributes
    ----------
    known, detected
        M.C. [rad], A.O.E. [rad], A.P.E. [mm] of the shapes recovered (shapes, 3), with known transitions
        and with detected ones; detected is None for rows that are run with known ones only.
    known_failed, detected_failed
        Shares of the seeds without a shape; detected counts a wrong number of vertices too.
    fitted
        Errors of the polygon fit on every fourth seed; empty for an ideal row.
    bound
        Medians (3,) of the same measures at the Cramer-Rao bound.
    sample
        The shape of the first seed that has one (N, 2) [mm], for the figure; empty where all failed. For
        a profile it is the raw one, every strip.
    """

    known: FloatArray
    known_failed: float
    detected: FloatArray | None
    detected_failed: float | None
    fitted: list[FitErrors]
    bound: FloatArray
    sample: FloatArray


def run_cell(number: int, position: int, seeds: int) -> Cell:
    """Run one cell: row `number` of `rows()`, position 0 to 4."""
    row = rows()[number]
    noise = NOISES[row.noise]
    corners = SHAPES[row.shape].contact(position).vertices
    with_found = noise.positional > 0.0 and row.algorithm == "vertex"
    known: list[RecoveredObject] = []
    detected: list[RecoveredObject] = []
    fits: list[FitErrors] = []
    for seed in range(1 if noise == Noise() else seeds):
        random = np.random.default_rng([number, position, seed])
        scan = simulate(SIMULATED[row.construction], SHAPES[row.shape].contact(position), noise, rng=random)
        x = add_transition_errors(SHAPES[row.shape].transitions(position), noise, random)
        known.append(_recover(row, scan, x))
        if with_found:
            detected.append(_recover(row, scan, "gradient"))
        if noise != Noise() and seed % _SEEDS_PER_FIT == 0:
            fits.append(fit_errors(row, position, noise, random))
    good = [r for r in known if r.found]
    right = [r for r in detected if len(r.vertices) == len(corners)]
    return Cell(
        known=_measure(row, corners, good),
        known_failed=1.0 - len(good) / len(known),
        detected=_measure(row, corners, right) if with_found else None,
        detected_failed=1.0 - len(right) / len(detected) if with_found else None,
        fitted=fits,
        bound=bound_medians(row, position, noise) if fits else np.full(3, np.nan),
        sample=good[0].vertices if good else np.empty((0, 2)),
    )


def summarise(number: int, cells: list[Cell]) -> dict[str, Any]:
    """Return a row's `ours`: median, 5 % and 95 % points, share of failures, which printed values are inside.

    A printed value is inside where it lies between our 5 % and 95 % points, give or take half its last
    digit. `failed` is with detected transitions where the row has them, `failed_known` with known ones;
    `detected` has the points of the former. None stands for what does not exist.
    """
    row = rows()[number]
    ours: dict[str, Any] = _points([c.known for c in cells])
    ours["failed_known"] = [c.known_failed for c in cells]
    ours["failed"] = [c.known_failed if c.detected_failed is None else c.detected_failed for c in cells]
    found = [c.detected for c in cells if c.detected is not None]
    ours["detected"] = _points(found) if found else None
    ours["polygon"] = _polygon(row, cells) if cells[0].fitted else None
    ours["inside"] = {m: _inside(row.printed[m], ours[m]) for m in METRICS}
    return ours


def _polygon(row: Row, cells: list[Cell]) -> dict[str, Any]:
    """Return the polygon fit's points, shares without a shape and with the right vertices, and the bound's medians.

    `reached` has, per metric and position, whether our median is below the printed value, and whether it is within
    1.15 of the bound's; None where nothing is printed. `known_count` has the same of the fit with a known vertex count.
    """
    corners = len(SHAPES[row.shape].contact(0).vertices)
    points: dict[str, Any] = _points([_found(c.fitted, "measures") for c in cells])
    points["failed"] = [float(np.mean([f.vertices == 0 for f in c.fitted])) for c in cells]
    points["right"] = [float(np.mean([f.vertices == corners for f in c.fitted])) for c in cells]
    bound = np.array([c.bound for c in cells])
    finite = [[b if np.isfinite(b) else None for b in column] for column in bound.T.tolist()]
    points["bound"] = dict(zip(METRICS, finite, strict=True))
    points["known_count"] = _points([_found(c.fitted, "known_count") for c in cells])
    for of in (points, points["known_count"]):
        medians = np.array([of[m]["median"] for m in METRICS], dtype=float)
        judged = [reached(row, medians[:, p], bound[p], p) for p in range(POSITIONS)]
        of["reached"] = {m: [judged[p][i] for p in range(POSITIONS)] for i, m in enumerate(METRICS)}
    return points


def _found(fits: list[FitErrors], which: str) -> FloatArray:
    """Return the measures (shapes, 3) of the fits that found a shape."""
    return np.array([getattr(f, which) for f in fits if f.vertices]).reshape(-1, 3)


def _recover(row: Row, scan: Scan, x: FloatArray | str) -> RecoveredObject:
    sensor = SIMULATED[row.construction]
    if row.algorithm == "profile":
        return profile_reconstruction(scan, sensor).objects[0]
    options: dict[str, Any] = {"signature": row.signature, "transitions": x, "reading": "strip"}
    return vertex_reconstruction(scan, sensor, **options).objects[0]


def _measure(row: Row, corners: FloatArray, shapes: list[RecoveredObject]) -> FloatArray:
    polygons = [profile_at(r, corners) if row.algorithm == "profile" else r.vertices for r in shapes]
    measured = [mismatch(corners, v) for v in polygons]
    return np.array([(m.mc, m.aoe, m.ape) for m in measured]).reshape(-1, 3)


def _points(values: list[FloatArray]) -> dict[str, dict[str, list[float | None]]]:
    """Return metric to median, p05 and p95, a list over positions each."""
    at = [ranges(v, METRICS) for v in values]
    return {m: {point: [r[m][point] for r in at] for point in POINTS} for m in METRICS}


def _inside(printed: FloatArray, ours: dict[str, list[float | None]]) -> list[bool | None]:
    return [is_inside(*value) for value in zip(printed, ours["p05"], ours["p95"], strict=True)]
