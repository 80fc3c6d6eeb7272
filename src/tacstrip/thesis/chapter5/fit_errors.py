"""The polygon fit on the noisy cells of tables 5.2-5.14, and its Cramer-Rao bound.

The fit gets the readings that the table's method gets: one signature where the table is Vertex Reconstruction's, both
where it is Profile Reconstruction's. It finds vertices and their number itself; the errors' half-widths are known to
it. Vertex Reconstruction is given the transitions, and so their number: the fit is run with that number known, too.
The bound is given in the same measures: those of polygons drawn with the bound's covariance about the true one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.contact.noise import Noise
from tacstrip.contact.shape import Contact
from tacstrip.data.published import METRICS, Row
from tacstrip.geometry.metrics import errors_of_many
from tacstrip.geometry.outline import Outline
from tacstrip.reconstruction.cramer_rao import reading_sigma, vertex_covariance
from tacstrip.scan import Scan
from tacstrip.simulation import simulate
from tacstrip.thesis.shapes import SHAPES, SIMULATED

Verdict: TypeAlias = tuple[bool, bool]  # below the printed value, at the bound's median
_DRAWS = 100  # of the bound
WITHIN = 1.15  # of the bound's median counts as reaching it


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
