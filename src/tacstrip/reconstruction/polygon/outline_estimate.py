"""The outline of one contact, how well it is known, and what bounded noise leaves of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.contact.noise import Noise
from tacstrip.core.ellipse import Ellipse
from tacstrip.core.outline_model import OutlineModel
from tacstrip.core.polygon_fit import PolygonFit
from tacstrip.fisher import positive_part
from tacstrip.geometry.outline import Outline
from tacstrip.reconstruction.noise_covariance import (
    Averaging,
    CorrelatedErrors,
    correlated,
)
from tacstrip.reconstruction.polygon.goodness_of_fit import (
    explains,
)
from tacstrip.reconstruction.polygon.run import ModelInMm, RunFit
from tacstrip.reconstruction.posterior.draws import Draws
from tacstrip.reconstruction.posterior.vertex_scatter import vertex_scatter
from tacstrip.reconstruction.set_membership.edge_lines import ReadingBounds
from tacstrip.reconstruction.set_membership.estimate import Bounded, fewest
from tacstrip.scan import Scan
from tacstrip.sensor.spec import Sensor

THIN = 1e-6  # of the strip length: thinner is a line
_UNIFORM = 3.0  # of sigma^2: the largest square of an error that is uniform
_WORSE, _FEWER = 20.0, 0.0  # of the criterion: so much worse, more vertices, or fewer, are not tried
_CORNERS = 12  # at most: the search for a set grows with them
_EMPTY = (
    "no polygon stays within the noise's bound on every strip: the noise is larger than given, or the contact is no "
    "polygon of these vertices; the outline is that of least squares"
)
_MANY = (
    f"an outline of more than {_CORNERS} vertices is not held against the noise's bound: this one, of least squares, "
    "may be of a contact that no such outline explains; bounded=False judges it by chi square alone"
)


@dataclass(frozen=True, eq=False)
class FittedContact:
    """One contact and its fit.

    Attributes
    ----------
    strips
        That belong to it.
    missing
        Of these, the ones that read nothing.
    fitted
        The strips that the fit was made of: all, or without those that may be covered in part.
    readings
        That were fitted, signature to (fitted,): as measured, or without what the strips' width added.
    margin_mm
        How much further out the ends lie than within half a pitch of the strips fitted.
    known_count
        Vertices that there are, where that is known.
    run
        The fit.
    """

    strips: slice
    missing: tuple[int, ...]
    fitted: slice
    readings: dict[str, FloatArray]
    margin_mm: float
    known_count: int | None
    run: RunFit


@dataclass(frozen=True, eq=False)
class Estimate:
    """An outline of a contact, and how well it is known.

    Attributes
    ----------
    model, outline
        In strips and lengths, and in mm.
    covariance
        Of its vertices, as of independent errors.
    errors
        Those of the readings, where they are not independent.
    slopes
        The covariance of which such errors are propagated: by slopes at the estimate, as they are.
    guarantee
        What the noise's bound leaves, which took the place of least squares.
    """

    model: OutlineModel
    outline: Outline
    covariance: FloatArray
    errors: CorrelatedErrors | None
    slopes: FloatArray
    guarantee: Bounded | None = None

    @classmethod
    def of(
        cls, contact: FittedContact, sensor: Sensor, scan: Scan, noise: Noise | None, model: OutlineModel,
        in_mm: ModelInMm | None = None,
    ) -> Estimate:  # fmt: skip
        """Return the estimate of least squares, or another outline that was drawn."""
        run = contact.run
        if in_mm is None:
            outline, scaled = Outline(*model.chains_mm(run.problem)), None
        else:
            outline, scaled = Outline.held(in_mm.lower, in_mm.upper), in_mm.covariance
        covariance = model.covariance(run.problem, sensor) if scaled is None else scaled
        errors = _errors(scan, sensor, contact, noise, outline)
        slopes = covariance if errors is None else _by_slopes(model, run, sensor, covariance)
        return cls(model, outline, covariance, errors, slopes)

    def within_bound(
        self, contact: FittedContact, sensor: Sensor, scan: Scan, noise: Noise, faint: bool
    ) -> tuple[Estimate, str]:
        """Return what the noise's bound leaves, or the same; and why the latter, where that is a doubt."""
        if isinstance(self.model, PolygonFit) and self.model.n_vertices > _CORNERS:
            return self, _MANY
        if faint:
            return self, ""
        guarantee, empty = _bounded(scan, sensor, contact, noise, self.outline, self.covariance)
        if guarantee is None:
            return self, _EMPTY if empty else ""
        outline, covariance = guarantee.outline, guarantee.region_covariance
        errors = _errors(scan, sensor, contact, noise, outline)
        return Estimate(self.model, outline, covariance, errors, covariance, guarantee), ""

    def among(self, drawn: Draws | None) -> Estimate:
        """Return a polygon with what outlines `drawn` say of its covariance; else, and within a bound, the same."""
        if drawn is None or self.guarantee is not None or not isinstance(self.model, PolygonFit):
            return self
        return replace(self, covariance=vertex_scatter(self.outline, self.covariance, drawn))

    def propagated(self) -> FloatArray:
        """Return the covariance of the readings' errors, whether independent or not."""
        if self.errors is None:
            return self.covariance
        with np.errstate(invalid="ignore"):  # what nothing tells is infinite in both
            off = np.nan_to_num(self.covariance - self.slopes, nan=0.0, posinf=0.0, neginf=0.0)
        return self.errors.propagated(self.slopes) + positive_part(off)


def _bounded(
    scan: Scan,
    sensor: Sensor,
    contact: FittedContact,
    noise: Noise,
    outline: Outline,
    covariance: FloatArray,
) -> tuple[Bounded | None, bool]:
    """Return what the noise's bound leaves of the fits where the readings agree, and whether it leaves nothing.

    `outline` and `covariance` are the chosen fit's.
    """
    refined = _refined(scan, sensor, contact, noise, (outline, covariance))
    options = [] if refined is None else [refined, refined.of_least_squares()]
    y = outline.vertices[:, 1] / sensor.length_mm
    if y.min() <= THIN or y.max() >= 1.0 - THIN:
        del options[:1]  # held to the strips, the mean lies inside of what passes over the border
    for option in options:
        # Least squares has the count that its own criterion chose.
        if option.fallback is None and len(option.outline.vertices) != len(outline.vertices):
            continue
        if explains(contact.run, noise.distribution, option.outline):
            return option, False
    return None, refined is None


def _errors(
    scan: Scan, sensor: Sensor, contact: FittedContact, noise: Noise | None, outline: Outline
) -> CorrelatedErrors | None:
    """Return the errors of a contact's readings where they are known not to be independent."""
    if noise is None or not correlated(noise, Averaging.of(scan)):
        return None
    run = contact.run
    residuals, used = run.residuals * run.sigma, run.problem.weight > 0.0
    return CorrelatedErrors.of(
        noise, sensor, outline, sensor.x_mm[contact.fitted], scan, residuals, used, run.sigma
    )


def _by_slopes(model: OutlineModel, run: RunFit, sensor: Sensor, covariance: FloatArray) -> FloatArray:
    """Return the covariance of which errors are propagated: by slopes at the estimate, as they are."""
    if not isinstance(model, PolygonFit | Ellipse) or sensor.strip_width_mm is not None:
        return covariance
    return model.linear_covariance(run.problem, sensor)


def _refined(
    scan: Scan,
    sensor: Sensor,
    contact: FittedContact,
    noise: Noise,
    chosen: tuple[Outline, FloatArray],
) -> Bounded | None:
    """Return what the noise's bound leaves of the fits, fewest vertices first; None where it leaves none."""
    run = contact.run
    assert run.selection is not None
    # And both ends: no outline leaves more.
    if run.residual_sums[0] > _UNIFORM * (run.problem.readings + 2):
        return None
    readings = contact.readings
    if np.count_nonzero(run.excluded):
        readings = {
            name: np.where(out, np.nan, readings[name])
            for name, out in zip(scan.signatures, run.excluded, strict=True)
        }
    band = ReadingBounds.of(sensor, sensor.x_mm[contact.fitted], readings, noise, contact.margin_mm)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):  # rubbish readings leave rubbish sets
        found = fewest(_candidates(run, sensor, chosen), band)
    return None if found is None else found[1]


def _candidates(
    run: RunFit, sensor: Sensor, chosen: tuple[Outline, FloatArray]
) -> Iterator[tuple[Outline, FloatArray]]:
    """Yield the outlines, and their covariances, of the fits that the noise's bound may leave something of."""
    selection = run.selection
    assert selection is not None
    for number, score in enumerate(selection.scores):
        if number == selection.best:
            yield chosen
        elif score <= selection.scores[selection.best] + (_FEWER if number < selection.best else _WORSE):
            fit = selection.fits[number]
            in_mm = ModelInMm.of(fit, run.problem)
            if in_mm.height > THIN * sensor.length_mm:
                yield Outline.held(in_mm.lower, in_mm.upper), fit.covariance(run.problem, sensor)
