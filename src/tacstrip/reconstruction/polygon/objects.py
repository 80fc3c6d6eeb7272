"""From the fit of one contact to an object: outline, covariance, status and advice."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.contact.noise import Noise
from tacstrip.core.outline_model import OutlineModel
from tacstrip.core.polygon_fit import PolygonFit
from tacstrip.core.search import fit_counts
from tacstrip.geometry.outline import Outline
from tacstrip.reconstruction.contact_ends import closed_ends
from tacstrip.reconstruction.cramer_rao import reading_sigma
from tacstrip.reconstruction.noise_covariance import (
    Averaging,
    averaging_advice,
    signature_advice,
)
from tacstrip.reconstruction.pieces.overhang import Overhang
from tacstrip.reconstruction.pieces.pair import Pair
from tacstrip.reconstruction.polygon.convexity import OneConvex, explained_by_convex
from tacstrip.reconstruction.polygon.faulty_channel import contradictory
from tacstrip.reconstruction.polygon.few_strips import no_fault_probability, unlike_probability, unlike_terms
from tacstrip.reconstruction.polygon.goodness_of_fit import (
    misfit,
    one_convex,
    second_look,
    weakness,
)
from tacstrip.reconstruction.polygon.lone_fault import at_a_rail, beyond_outline
from tacstrip.reconstruction.polygon.outline_estimate import THIN, Estimate, FittedContact
from tacstrip.reconstruction.polygon.run import MOST_SIGMA, ModelInMm, RunFit
from tacstrip.reconstruction.polygon.status import (
    OTHERS,
    behind_overhang,
    beside_pair,
    bridged,
    either,
    enough_of,
    lowered,
    notes_of,
    other_area,
    status_of,
    two_objects,
    uncounted_vertices,
    unlike_few,
)
from tacstrip.reconstruction.polygon.wide_fit import contradicted_by_outer_strip
from tacstrip.reconstruction.posterior.assessment import (
    HELD_STRIPS,
    PROMISED_IOU,
    Assessment,
    Effort,
    assess,
    few_strips,
)
from tacstrip.reconstruction.result import Alternative, Profile, RecoveredObject, Status
from tacstrip.scan import Scan
from tacstrip.sensor.closed_form import lower_from_width
from tacstrip.sensor.left_out import channel_name
from tacstrip.sensor.spec import Sensor

_ANYWHERE = 0.9  # of the variance within a pitch
# Probability of two objects where convex ends explain the readings of few strips, and no polygon of as many corners as
# these hold does: among drawn contacts, of which one object is four times as frequent as two.
_TWO_OF_FEW = 0.2
_FAINT = "no corner could be distinguished from noise: a line fits as well as the triangle that is given; {}"
_FEW_TELL = (
    "{} strips do not tell this outline, the commonest of one object, from two objects on the same strips, which "
    "it is with a probability of {:.2g}: use finer strips, or slide the contact and track it"
)
_TWICE = (
    "strips read nothing inside the contact, and other readings do not fit: that is seldom one object, and rather two; "
    "slide the contact along the row of strips, or leave out what is broken (--without, or the spec)"
)


@dataclass(frozen=True, eq=False)
class Asked:
    """What contacts are judged by.

    Attributes
    ----------
    sensor
        What measured them.
    noise, bounded
        The readings' errors if known, and whether to use that they have a bound.
    around
        Strips after which their numbers begin again, for `unrolled` ones.
    effort
        Of assessing how sure a shape is.
    area_mm2
        Mean and standard deviation of the contact's area, where that is known.
    one_object
        Whether it is known that a contact is one object.
    """

    sensor: Sensor
    noise: Noise | None
    bounded: bool
    around: int
    effort: Effort = "none"
    area_mm2: tuple[float, float] | None = None
    one_object: bool = False

    @property
    def distribution(self) -> str | None:
        """Of the errors; None where nobody knows their size."""
        if self.noise is None:
            return None
        return self.noise.distribution if self.noise.independent else "normal"


@dataclass(frozen=True, eq=False)
class _Choice:
    """The outline that a contact is given, and what the search for it told.

    Attributes
    ----------
    contact, estimate
        What was fitted, perhaps with readings that a first fit left out, and the outline.
    faint
        Whether it is a triangle that one signature cannot tell from a line.
    wrong
        What the outline does not explain; "" where it explains all.
    convex
        One convex object that explains all readings, where the outline alone does not tell.
    two, pair
        Probability that so few readings are of two objects, and the likeliest two where readings tell.
    overhang
        Behind which most of one object may not be touched; None: no end jumps.
    beyond
        Readings (S, n) that no outline can have.
    assessed
        What other outlines that explain the readings say.
    """

    contact: FittedContact
    estimate: Estimate
    faint: bool
    wrong: str
    convex: OneConvex | None
    two: float
    pair: Pair | None
    overhang: Overhang | None
    beyond: BoolArray
    assessed: Assessment


@dataclass(frozen=True, eq=False)
class _Verdict:
    """How far a chosen outline is to be trusted: fields of the same names of a `RecoveredObject`; `faulty` (S, n)."""

    status: Status
    advice: str
    confidence: float | None
    alternatives: tuple[Alternative, ...]
    faulty: BoolArray


def reconstruct_object(scan: Scan, contact: FittedContact, asked: Asked) -> RecoveredObject:
    """Return the object that a contact's fit stands for; `scan` is what was measured."""
    sensor, strips, run = asked.sensor, contact.strips, contact.run
    notes = notes_of(scan, sensor, contact, asked.around, asked.noise is not None)
    x = sensor.x_mm[strips]
    if run.selection is None:
        few = f"{strips.stop - strips.start} strips are touched, too few for a polygon: use finer strips"
        if scan.signatures == ("k",):
            return _places(scan, sensor, strips, asked.noise, notes)
        raw = _raw_profile(scan, sensor, strips)
        return RecoveredObject(strips, profile=raw, status="too few strips", advice="; ".join([few, *notes]))
    fit, faint = _selected(run, asked.noise is not None)
    model: OutlineModel = fit
    if run.model is not None and not isinstance(run.model, PolygonFit):
        model, faint = run.model, False
    in_mm = run.model_mm if model is run.model else ModelInMm.of(model, run.problem)
    if in_mm.height <= THIN * sensor.length_mm:
        line = "neither a corner nor a width could be distinguished from noise: a line, given as its profile"
        profile = (x, np.interp(x, *in_mm.lower.T), np.interp(x, *in_mm.upper.T))
        return RecoveredObject(
            strips, profile=profile, status="too few transitions", advice="; ".join([line, *notes])
        )
    given = Estimate.of(contact, sensor, scan, asked.noise, model, in_mm)
    choice = _choice(scan, contact, asked, given, within=model is fit, faint=faint)
    verdict = _verdict(scan, asked, choice, fit)
    estimate, outline = choice.estimate.among(choice.assessed.mixed), choice.estimate.outline
    covariance, polygon = estimate.propagated(), isinstance(estimate.model, PolygonFit)
    return RecoveredObject(
        strips,
        outline.vertices.copy(),
        (x, np.interp(x, *outline.lower.T), np.interp(x, *outline.upper.T)),
        covariance,
        verdict.status,
        verdict.advice,
        guarantee=estimate.guarantee,
        uniform=_upright(outline, covariance, sensor) if polygon else (),
        model=None if polygon else type(estimate.model),
        kind=estimate.model.kind,
        confidence=verdict.confidence,
        alternatives=verdict.alternatives,
        faulty=tuple(
            channel_name((i + contact.fitted.start) % asked.around, scan.signatures[s], sensor.strip_base)
            for s, i in np.argwhere(verdict.faulty)
        ),
    )


def _choice(
    scan: Scan, contact: FittedContact, asked: Asked, given: Estimate, within: bool, faint: bool
) -> _Choice:
    """Return the outline to give: that of least squares, what the noise's bound leaves (`within`), or a drawn one."""
    sensor, noise, distribution = asked.sensor, asked.noise, asked.distribution
    run, unbounded = contact.run, ""
    if asked.bounded and noise is not None and within:
        given, unbounded = given.within_bound(contact, sensor, scan, noise, faint)
    wrong = misfit(run, distribution, given.slopes, given.errors, asked.one_object) or unbounded
    doubtful = wrong or np.count_nonzero(run.excluded)
    convex = one_convex(run, distribution, given.outline, sensor, contact.readings) if doubtful else None
    assessing = partial(
        assess, sensor=sensor, sigma_known=noise is not None, effort=asked.effort, area_mm2=asked.area_mm2,
        known_count=contact.known_count,
    )  # fmt: skip
    two, assessed = 0.0, None
    if convex is not None and convex.like(given.outline, sensor):
        noisy = noise is None and run.sigma >= MOST_SIGMA
        two = _TWO_OF_FEW if noisy and run.problem.x.size < HELD_STRIPS else 0.0
    elif convex is not None:
        # Few readings tell few corners, which do not follow what they say together; outlines of more that are drawn do.
        whole = replace(contact, run=convex.run)
        drawn = assessing(convex.run, outline=given.outline, covariance=given.covariance, misses=True)
        other = None if drawn.better is None else Estimate.of(whole, sensor, scan, noise, drawn.better)
        if other is not None and convex.like(other.outline, sensor):
            run, contact, given, assessed, two = convex.run, whole, other, drawn, _TWO_OF_FEW
        else:
            convex = None
    wrong, pair, overhang = second_look(
        run, distribution, given.outline, sensor, wrong, contact.readings, convex, asked.one_object
    )
    if asked.one_object:
        two, pair = 0.0, None
    beyond = beyond_outline(run, contact.readings)
    if assessed is None:
        assessed = assessing(
            run, outline=given.outline, covariance=given.covariance, faults=int(np.count_nonzero(beyond))
        )
        if assessed.better is not None:
            faint, given = False, Estimate.of(contact, sensor, scan, noise, assessed.better)
    return _Choice(contact, given, faint, wrong, convex, two, pair, overhang, beyond, assessed)


def _verdict(scan: Scan, asked: Asked, choice: _Choice, fit: PolygonFit) -> _Verdict:
    """Return what speaks against the outline chosen; `fit` is the polygon of least squares."""
    sensor, noise, effort = asked.sensor, asked.noise, asked.effort
    contact, assessed, convex = choice.contact, choice.assessed, choice.convex
    run, outline = contact.run, choice.estimate.outline
    covariance = choice.estimate.propagated()
    second = signature_advice(sensor) if len(run.problem.k) == 1 else ""
    enough, of_one = enough_of(run, effort, second)
    never = bool(second) and few_strips(run)
    averaging = "" if never else averaging_advice(noise, sensor, Averaging.of(scan))
    weak = (
        _FAINT.format(", or ".join(filter(None, (averaging, second or "use finer strips"))))
        if choice.faint
        else weakness(
            run, choice.estimate.model, outline.vertices, covariance, averaging, second, noise is not None
        )
    )
    wrong, uncounted = (
        choice.wrong,
        uncounted_vertices(contact, fit, assessed, noise is not None, second),
    )
    if assessed.explained and second and (contact.known_count is None or assessed.better is not None):
        # Outlines that the fit did not find explain the readings, and the confidence counts them: for what it is
        # worth where nobody knows the noise.
        remedies = ", ".join(filter(None, (second, averaging)))
        others = uncounted or OTHERS.format(100.0 * run.sigma, remedies)
        wrong = "" if noise is not None or assessed.better_explains else others
    wrong = wrong or uncounted
    if second and effort != "none" and not wrong:  # with both signatures the others tell an outline's ends
        wrong = contradicted_by_outer_strip(
            scan, sensor, contact.strips, contact.fitted, outline, covariance, run.sigma
        )
    if asked.area_mm2 is not None and not wrong:
        most = (contact.strips.stop - contact.strips.start + 1) * sensor.pitch_mm * sensor.length_mm
        wrong = other_area(outline, covariance, asked.area_mm2, most)
    # A confidence takes the readings for explained, if by others than the fit.
    explained = not wrong or (wrong == uncounted and assessed.better is not None)
    confidence, alternatives = assessed.confidence if explained else None, assessed.alternatives
    note = ""
    if choice.pair is not None:
        before = 1.0 if confidence is None else confidence
        confidence, alternatives = beside_pair(choice.pair, confidence, alternatives)
        if not wrong:
            right = choice.pair.overlap(outline.vertices) >= PROMISED_IOU
            wrong, note = two_objects(choice.pair, right, before, enough)
    if choice.overhang is not None:
        told, probability = behind_overhang(choice.overhang), choice.overhang.probability
        hidden, also, confidence = lowered(told, probability, confidence, enough)
        note = "; ".join(filter(None, (note, also or (hidden if wrong else ""))))
        wrong = wrong or hidden
    if choice.two and not wrong:
        told = _FEW_TELL.format(run.problem.x.size, choice.two)
        wrong, also, confidence = lowered(told, choice.two, confidence, enough)
        note = "; ".join(filter(None, (note, also)))
    faulty = np.zeros_like(run.excluded) if convex is None else convex.run.excluded
    if convex is None and not wrong:  # else it may be the outline
        faulty = contradictory(run, sensor, contact.readings)
        if choice.beyond.any():
            faulty = faulty | choice.beyond & at_a_rail(run, contact.readings)
    if faulty.any() and not wrong and bridged(contact, sensor, asked.around):
        wrong, confidence = _TWICE, None
    if not wrong and not second and few_strips(run):
        left_out = run.excluded if convex is None else faulty
        wrong, of_few, confidence = _of_few(choice, asked, left_out, faulty, confidence)
        note = "; ".join(filter(None, (note, of_few)))
    notes = notes_of(scan, sensor, contact, asked.around, noise is not None, faulty, convex is not None)
    area_known = asked.area_mm2 is not None
    assessed = replace(assessed, confidence=confidence)
    status, advice = status_of(wrong, weak, assessed, effort, second, averaging, area_known, enough, of_one)
    return _Verdict(
        status, "; ".join(filter(None, [*advice, note, *notes])), confidence, alternatives, faulty
    )


def _of_few(
    choice: _Choice, asked: Asked, left_out: BoolArray, faulty: BoolArray, confidence: float | None
) -> tuple[str, str, float | None]:
    """Return what speaks against the outline of few strips, or a note, and the confidence that is left."""
    contact, estimate, convex, one_object = choice.contact, choice.estimate, choice.convex, asked.one_object
    run, distribution = contact.run, asked.distribution
    sound = no_fault_probability(run, left_out, faulty, contact.readings)
    if convex is None:  # a corner that hardly turns inwards may be the noise's
        none = np.zeros_like(run.excluded)
        convex = explained_by_convex(
            run, distribution, estimate.outline, asked.sensor, contact.readings, none
        )
    terms = unlike_terms(run, estimate.model, estimate.outline, distribution, convex, one_object)
    unlike = unlike_probability(terms)
    told = unlike_few(unlike, sound, run.problem.x.size, one_object)
    enough, _ = enough_of(run, asked.effort, "")
    return lowered(told, either(unlike, sound), confidence, enough)


def _places(
    scan: Scan, sensor: Sensor, strips: slice, noise: Noise | None, notes: list[str]
) -> RecoveredObject:
    """Return a place on each strip of metal: y = k L lies within [l, u] whatever the width, and is a point's own."""
    x, k = sensor.x_mm[strips], scan["k"][strips]
    known = np.isfinite(k)
    y = lower_from_width(k[known], np.zeros(known.sum()), sensor.length_mm)
    sigma = sensor.adc_step / np.sqrt(12.0) if noise is None else reading_sigma(noise, sensor)
    deviation = sensor.strip_width / np.sqrt(12.0), sigma * sensor.length_mm if sigma > 0.0 else np.nan
    points = np.stack([x[known], y], axis=1)
    where = ", ".join(f"({a:.4g}, {b:.4g})" for a, b in points)
    advice = f"too few strips for a shape; touched at (x, y) = {where} mm, or around there if it has a width"
    return RecoveredObject(
        strips,
        profile=(x[known], y, y),
        status="points",
        advice="; ".join([advice, *notes]),
        points=points,
        point_deviations=np.tile(deviation, (len(points), 1)),
    )


def _upright(outline: Outline, covariance: FloatArray, sensor: Sensor) -> tuple[int, ...]:
    """Return the places in `vertices.ravel()` of x of vertical ends of which no more than a pitch is known."""
    if len(outline.vertices) == len(outline.lower) + len(outline.upper) - 2:  # both ends are points
        return ()
    lower, upper = outline.indices
    places = [2 * int(lower[end]) for end in (0, -1) if lower[end] != upper[end]]
    return tuple(i for i in places if covariance[i, i] > _ANYWHERE * sensor.pitch_mm**2 / 12.0)


def _selected(run: RunFit, known: bool) -> tuple[PolygonFit, bool]:
    """Return the fit to give, and whether it is a triangle that one signature cannot tell from a line."""
    assert run.selection is not None
    if run.selection.chosen.n_interior or len(run.problem.k) > 1:
        return run.selection.chosen, False
    triangles = [f for f in fit_counts(run.problem, known, 1, every=True).fits if f.n_interior]
    return (triangles[0], True) if triangles else (run.selection.chosen, False)


def _raw_profile(scan: Scan, sensor: Sensor, strips: slice) -> Profile | None:
    """Return the contact strip by strip, which needs both signatures."""
    if not {"kh", "kl"} <= set(scan.signatures):
        return None
    with np.errstate(divide="ignore", invalid="ignore"):  # k_l far above k_h: no contact makes it
        l, u = closed_ends(sensor, scan["kh"][strips], scan["kl"][strips])
    return (sensor.x_mm[strips], l, u) if np.isfinite(l + u).all() else None
