"""The polygon fit on the noisy cells of tables 5.2-5.14, beside its Cramer-Rao bound.

The fit gets the readings that the table's method gets: one signature where the table is Vertex Reconstruction's, both
where it is Profile Reconstruction's. It finds vertices and their number itself; the errors' half-widths are known to
it. Vertex Reconstruction is handed the transitions, and so their number: the fit is shown with that number told, too.
The bound is shown in the same measures: those of polygons drawn with the bound's covariance about the true one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.contact.noise import Noise
from tacstrip.contact.shape import Contact
from tacstrip.data.published import METRICS, Row
from tacstrip.errors import ContactError
from tacstrip.geometry.metrics import mismatch
from tacstrip.geometry.outline import Outline
from tacstrip.reconstruction.cramer_rao import reading_sigma, vertex_covariance
from tacstrip.scan import Scan
from tacstrip.simulation import simulate
from tacstrip.thesis.shapes import SHAPES, SIMULATED

_DRAWS = 100  # of the bound
WITHIN = 1.15  # of the bound's median counts as reaching it


@dataclass(frozen=True)
class Fitted:
    """One scan fitted.

    Attributes
    ----------
    measures
        M.C. [rad], A.O.E. [rad], A.P.E. [mm] (3,); NaN without a shape.
    vertices
        Found; 0 without a shape.
    told
        The same measures of the fit that is told how many there are.
    """

    measures: FloatArray
    vertices: int
    told: FloatArray


def fitted(row: Row, position: int, noise: Noise, random: np.random.Generator) -> Fitted:
    """Simulate and fit one scan of a cell, with the signatures that the row's method uses.

    Both ends of the shape are put anywhere within a pitch of their place, the rest stretched along: ours have their
    vertices on strips, and an end there lies at the limit of what the touched strips tell of it.
    """
    from tacstrip.reconstruction.polygon.estimate import fit_polygon  # in the workers only

    sensor, contact = SIMULATED[row.construction], SHAPES[row.shape].contact(position)
    x, y = contact.vertices.T
    ends = np.array([x.min(), x.max()])
    contact = Contact.polygon(
        np.stack([np.interp(x, ends, ends + sensor.pitch_mm * random.uniform(-0.5, 0.5, 2)), y], 1)
    )
    scan = simulate(sensor, contact, noise, rng=random)
    if row.signature is not None:
        scan = Scan(time_s=0.0, **{row.signature: scan[row.signature]})

    def of(count: int | None) -> tuple[FloatArray, int]:
        objects = [o for o in fit_polygon(scan, sensor, noise, vertices=count).objects if o.found]
        if not objects:
            return np.full(3, np.nan), 0
        largest = max(objects, key=lambda o: o.area)
        return _measures(contact.vertices, largest.vertices), len(largest.vertices)

    measures, found = of(None)
    return Fitted(
        measures, found, measures if found == len(contact.vertices) else of(len(contact.vertices))[0]
    )


def bound_medians(row: Row, position: int, noise: Noise) -> FloatArray:
    """Return the medians (3,) of M.C., A.O.E. and A.P.E. at the bound; inf where a vertex is not told at all."""
    sensor = SIMULATED[row.construction]
    outline = Outline.of(SHAPES[row.shape].contact(position).vertices)
    names = None if row.signature is None else (row.signature,)
    covariance = vertex_covariance(outline, sensor, reading_sigma(noise, sensor), names)
    if not np.isfinite(covariance).all():
        return np.full(3, np.inf)
    true = outline.vertices
    random = np.random.default_rng([position, 5])
    error = random.multivariate_normal(np.zeros(true.size), covariance, _DRAWS, method="eigh")
    # The x of an end, which the touched strips tell to within a pitch, errs uniformly; the rest follows from it.
    ends = 2 * np.array([true[:, 0].argmin(), true[:, 0].argmax()])
    wide = np.sqrt(3.0 * covariance[ends, ends])
    lean = covariance[:, ends] @ np.linalg.inv(covariance[np.ix_(ends, ends)])
    error += (random.uniform(-wide, wide, (_DRAWS, 2)) - error[:, ends]) @ lean.T
    drawn = true + error.reshape(_DRAWS, -1, 2)
    return np.asarray(np.nanmedian([_measures(true, polygon) for polygon in drawn], axis=0))


def beaten(row: Row, medians: FloatArray, bound: FloatArray, position: int) -> list[tuple[bool, bool] | None]:
    """Compare a cell's medians (3,) with the printed values and with the bound's: (below print, at the bound).

    None where nothing is printed.
    """
    verdicts: list[tuple[bool, bool] | None] = []
    for metric, ours, best in zip(METRICS, medians, bound, strict=True):
        printed = row.printed[metric]
        if printed is None or np.isnan(printed[position]):
            verdicts.append(None)
        else:
            verdicts.append((bool(ours < printed[position]), bool(ours <= WITHIN * best)))
    return verdicts


def _measures(true: FloatArray, vertices: FloatArray) -> FloatArray:
    try:
        m = mismatch(true, vertices)
    except ContactError:  # sides that cross
        return np.full(3, np.nan)
    return np.array([m.mc, m.aoe, m.ape])
