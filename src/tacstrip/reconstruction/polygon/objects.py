"""From the fit of one contact to an object: outline, covariance, what bounded noise leaves of it, and advice."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.contact.noise import Noise
from tacstrip.core.outline_model import OutlineModel
from tacstrip.core.polygon_fit import PolygonFit
from tacstrip.core.search import fit_counts
from tacstrip.fisher import positive_part
from tacstrip.geometry.moments import deviations, moments
from tacstrip.geometry.outline import Outline
from tacstrip.reconstruction.contact_ends import closed_ends
from tacstrip.reconstruction.cramer_rao import reading_sigma
from tacstrip.reconstruction.noise_covariance import (
    Averaging,
    CorrelatedErrors,
    averaging_advice,
    correlated,
    signature_advice,
)
from tacstrip.reconstruction.pieces.pair import Pair
from tacstrip.reconstruction.polygon.faulty_channel import contradictory
from tacstrip.reconstruction.polygon.goodness_of_fit import (
    explains,
    misfit,
    one_convex,
    second_look,
    weakness,
)
from tacstrip.reconstruction.polygon.lone_fault import at_a_rail, beyond_outline
from tacstrip.reconstruction.polygon.run import MOST_SIGMA, ModelInMm, RunFit
from tacstrip.reconstruction.polygon.wide_fit import contradicted_by_outer_strip
from tacstrip.reconstruction.posterior.assessment import (
    ENOUGH,
    ENOUGH_OF_FEW,
    ENOUGH_OF_ONE,
    ENOUGH_STRIPS,
    HELD_STRIPS,
    PROMISED_IOU,
    Assessment,
    Effort,
    assess,
    few_strips,
)
from tacstrip.reconstruction.result import Alternative, Profile, RecoveredObject, Status
from tacstrip.reconstruction.set_membership.edge_lines import ReadingBounds
from tacstrip.reconstruction.set_membership.estimate import Bounded, fewest
from tacstrip.scan import Scan
from tacstrip.sensor.closed_form import lower_from_width
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.left_out import channel_name, left_out_wholly
from tacstrip.sensor.spec import Sensor

_THIN = 1e-6  # of the strip length: thinner is a line
_UNIFORM = 3.0  # of sigma^2: the largest square of an error that is uniform
_ANYWHERE = 0.9  # of the variance within a pitch
_WORSE, _FEWER = 20.0, 0.0  # of the criterion: so much worse, more vertices, or fewer, are not tried
_CORNERS = 12  # at most: the search for a set grows with them
_FAR_AREA = 3.0  # deviations between an area that was given and the one that the readings say
_NEVER = (
    2.0  # confidence that is enough: of few strips with one signature 1 in 10 is wrong even of the surest
)
_NAMED = 5  # strips that advice names
# Probability of two objects where convex ends explain the readings of few strips, and no polygon of as many corners as
# these hold does: among drawn contacts, of which one object is four times as frequent as two.
_TWO_OF_FEW = 0.2
# Probability of two objects: that the outline overlaps less than "ok" promises, and is doubted; less is not told.
_OTHER, _NOTED = 0.14, 0.05
_FAINT = "no corner could be distinguished from noise: a line fits as well as the triangle that is given; {}"
_EMPTY = (
    "no polygon stays within the noise's bound on every strip: the noise is larger than given, or the contact is no "
    "polygon of these vertices; the outline is that of least squares"
)
_MANY = (
    f"an outline of more than {_CORNERS} vertices is not held against the noise's bound: this one, of least squares, "
    "may be of a contact that no such outline explains; bounded=False judges it by chi square alone"
)
_FEW_TELL = (
    "{} strips do not tell this outline, the commonest of one object, from two objects on the same strips, which "
    "it is with a probability of {:.2g}: use finer strips, or slide the contact and track it"
)
_TWICE = (
    "strips read nothing inside the contact, and other readings do not fit: that is seldom one object, and rather two; "
    "slide the contact along the row of strips, or leave out what is broken (--without, or the spec)"
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


def reconstruct_object(
    scan: Scan,
    sensor: Sensor,
    contact: FittedContact,
    noise: Noise | None,
    bounded: bool,
    around: int,
    effort: Effort = "none",
    area_mm2: tuple[float, float] | None = None,
) -> RecoveredObject:
    """Return the object that a contact's fit stands for.

    Parameters
    ----------
    scan, sensor
        What was measured, with what.
    contact
        One contact's strips and fits.
    noise, bounded
        The readings' errors if known, and whether to use that they have a bound.
    around
        Strips after which their numbers begin again, for `unrolled` ones.
    effort
        Of assessing how sure the shape is.
    area_mm2
        Mean and standard deviation of the contact's area, where that is known.
    """
    strips, run = contact.strips, contact.run
    notes = _notes(scan, sensor, contact, around, noise is not None)
    x = sensor.x_mm[strips]
    if run.selection is None:
        few = f"{strips.stop - strips.start} strips are touched, too few for a polygon: use finer strips"
        if scan.signatures == ("k",):
            return _places(scan, sensor, strips, noise, notes)
        raw = _raw_profile(scan, sensor, strips)
        return RecoveredObject(strips, profile=raw, status="too few strips", advice="; ".join([few, *notes]))
    fit, faint = _chosen(run, noise is not None)
    model: OutlineModel = fit
    if run.model is not None and not isinstance(run.model, PolygonFit):
        model, faint = run.model, False
    in_mm = run.model_mm if model is run.model else ModelInMm.of(model, run.problem)
    if in_mm.height <= _THIN * sensor.length_mm:
        line = "neither a corner nor a width could be distinguished from noise: a line, given as its profile"
        profile = (x, np.interp(x, *in_mm.lower.T), np.interp(x, *in_mm.upper.T))
        return RecoveredObject(
            strips, profile=profile, status="too few transitions", advice="; ".join([line, *notes])
        )
    given, unbounded = _Estimate.of(contact, sensor, scan, noise, model, in_mm), ""
    if bounded and noise is not None and model is fit:
        given, unbounded = given.within_bound(contact, sensor, scan, noise, faint)
    distribution = None if noise is None else noise.distribution if noise.independent else "normal"
    wrong = misfit(run, distribution, given.slopes, given.errors) or unbounded
    asked = wrong or np.count_nonzero(run.excluded)
    convex = one_convex(run, distribution, given.outline, sensor, contact.readings) if asked else None
    assessing = partial(
        assess, sensor=sensor, sigma_known=noise is not None, effort=effort, area_mm2=area_mm2,
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
        other = None if drawn.better is None else _Estimate.of(whole, sensor, scan, noise, drawn.better)
        if other is not None and convex.like(other.outline, sensor):
            run, contact, given, assessed, two = convex.run, whole, other, drawn, _TWO_OF_FEW
        else:
            convex = None
    wrong, pair = second_look(run, distribution, given.outline, sensor, wrong, contact.readings, convex)
    beyond = beyond_outline(run, contact.readings)
    if assessed is None:
        assessed = assessing(
            run, outline=given.outline, covariance=given.covariance, faults=int(np.count_nonzero(beyond))
        )
        if assessed.better is not None:
            faint, given = False, _Estimate.of(contact, sensor, scan, noise, assessed.better)
    outline, covariance = given.outline, given.propagated()
    second = signature_advice(sensor) if len(run.problem.k) == 1 else ""
    never = bool(second) and few_strips(run)
    averaging = "" if never else averaging_advice(noise, sensor, Averaging.of(scan))
    weak = (
        _FAINT.format(", or ".join(filter(None, (averaging, second or "use finer strips"))))
        if faint
        else weakness(run, given.model, outline.vertices, covariance, averaging, second, noise is not None)
    )
    uncounted = _uncounted(contact, fit, assessed, noise is not None, second)
    if assessed.explained and second and (contact.known_count is None or assessed.better is not None):
        # Outlines that the fit did not find explain the readings, and the confidence counts them: for what it is
        # worth where nobody knows the noise.
        remedies = ", ".join(filter(None, (second, averaging)))
        others = uncounted or _OTHERS.format(100.0 * run.sigma, remedies)
        wrong = "" if noise is not None or assessed.better_explains else others
    wrong = wrong or uncounted
    if second and effort != "none" and not wrong:  # with both signatures the others tell an outline's ends
        wrong = contradicted_by_outer_strip(
            scan, sensor, strips, contact.fitted, outline, covariance, run.sigma
        )
    if area_mm2 is not None and not wrong:
        wrong = _other_area(outline, covariance, area_mm2, (len(x) + 1) * sensor.pitch_mm * sensor.length_mm)
    # A confidence takes the readings for explained, if by others than the fit.
    explained = not wrong or (wrong == uncounted and assessed.better is not None)
    confidence, alternatives = assessed.confidence if explained else None, assessed.alternatives
    note = ""
    if pair is not None:
        confidence, alternatives, sure = _beside_pair(pair, confidence, alternatives)
        if not wrong:
            right = pair.overlap(outline.vertices) >= PROMISED_IOU
            wrong, note = _two_objects(pair.probability, right, sure)
    if two and not wrong:
        wrong = _FEW_TELL.format(run.problem.x.size, two)
        confidence = None if confidence is None else (1.0 - two) * confidence
    faulty = np.zeros_like(run.excluded) if convex is None else convex.run.excluded
    if convex is None and not wrong:  # else it may be the outline
        faulty = contradictory(run, sensor, contact.readings)
        if beyond.any():
            faulty = faulty | beyond & at_a_rail(run, contact.readings)
    if faulty.any() and not wrong and _bridged(contact, sensor, around):
        wrong, confidence = _TWICE, None
    if convex is not None or faulty.any():
        notes = _notes(scan, sensor, contact, around, noise is not None, faulty, convex=convex is not None)
    status, advice = _verdict(
        wrong,
        weak,
        assessed,
        effort,
        second,
        averaging,
        area_mm2 is not None,
        *_enough(run, effort, second),
    )
    return RecoveredObject(
        strips,
        outline.vertices.copy(),
        (x, np.interp(x, *outline.lower.T), np.interp(x, *outline.upper.T)),
        covariance,
        status,
        "; ".join(filter(None, [*advice, note, *notes])),
        guarantee=given.guarantee,
        uniform=_upright(outline, covariance, sensor) if isinstance(given.model, PolygonFit) else (),
        model=None if isinstance(given.model, PolygonFit) else type(given.model),
        kind=given.model.kind,
        confidence=confidence,
        alternatives=alternatives,
        faulty=tuple(
            channel_name((i + contact.fitted.start) % around, scan.signatures[s], sensor.strip_base)
            for s, i in np.argwhere(faulty)
        ),
    )


@dataclass(frozen=True, eq=False)
class _Estimate:
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
    ) -> _Estimate:  # fmt: skip
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
    ) -> tuple[_Estimate, str]:
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
        return _Estimate(self.model, outline, covariance, errors, covariance, guarantee), ""

    def propagated(self) -> FloatArray:
        """Return the covariance of the readings' errors, whether independent or not."""
        if self.errors is None:
            return self.covariance
        with np.errstate(invalid="ignore"):  # what nothing tells is infinite in both
            off = np.nan_to_num(self.covariance - self.slopes, nan=0.0, posinf=0.0, neginf=0.0)
        return self.errors.propagated(self.slopes) + positive_part(off)


def _enough(run: RunFit, effort: Effort, second: str) -> tuple[float, float]:
    """Return the least confidence of an "ok", and that of one signature on more strips.

    `second` is what to do about a second signature, "" where both are read.
    """
    of_one = ENOUGH_OF_ONE.get(effort, ENOUGH)
    if second:
        return (_NEVER if few_strips(run) else of_one), of_one
    return (ENOUGH_OF_FEW if few_strips(run) else ENOUGH), of_one


_OTHERS = (
    "the best outline of few corners is off by {:.2g} % of Vref, and others explain the readings too: {}, or give the "
    "noise"
)


def _uncounted(
    contact: FittedContact, fit: PolygonFit, assessed: Assessment, noise_given: bool, second: str
) -> str:
    """Say that the readings do not hold as many vertices as were given; "" where they do."""
    given = contact.known_count
    if given is None or fit.n_vertices >= given:
        return ""
    held = f"the readings hold {fit.n_vertices} vertices, not the {given} that were given"
    noise = "" if noise_given else "give the noise, too: they may hold more then"
    if assessed.better is None:
        return "; ".join(filter(None, [held, noise]))
    remedies = ", or ".join(filter(None, [noise, second]))
    return (
        f"{held}: other outlines with {given} explain them as well, and the one shown overlaps the true one by an IoU "
        f"of {PROMISED_IOU} or more with a probability of {assessed.confidence:.2f}: {remedies}"
    )


def _other_area(outline: Outline, covariance: FloatArray, area_mm2: tuple[float, float], most: float) -> str:
    """Say that the readings and the area that was given contradict each other; "" where they do not.

    `most`: what the touched strips hold, and half the gap to the next ones [mm^2].
    """
    (mean, sigma), area = area_mm2, moments(outline.vertices)[0]
    if mean > most:
        return f"the area given, {mean:.4g} mm2, is more than the touched strips hold, {most:.4g} mm2: check both"
    own = deviations(outline.vertices, covariance)[0]
    if abs(area - mean) <= _FAR_AREA * math.hypot(sigma, own):
        return ""
    return f"the area given, {mean:.4g} mm2, contradicts the readings, which say {area:.4g} mm2: check both"


def _beside_pair(
    pair: Pair, confidence: float | None, alternatives: tuple[Alternative, ...]
) -> tuple[float | None, tuple[Alternative, ...], float]:
    """Return the confidence and the alternatives beside two objects, and how sure it is one object that overlaps."""
    one = 1.0 - pair.probability
    sure = one if confidence is None else one * confidence
    two = Alternative(pair.probability, pair.lower, others=(pair.upper,))
    rest = (replace(a, weight=a.weight * one) for a in alternatives)
    ordered = tuple(sorted((two, *rest), key=lambda a: -a.weight))
    return None if confidence is None else sure, ordered, sure


def _two_objects(probability: float, right: bool, confidence: float) -> tuple[str, str]:
    """Return advice that doubts an outline which two objects explain too, or, where it stays, a note of that.

    `right` is whether the outline overlaps both together as `ok` promises: then only their number is open.
    """
    told = (
        f"two objects on the same strips explain the readings too, with a probability of {probability:.2f} (see the "
        "alternatives): slide or turn the contact and track it, or add a second layer, to tell"
    )
    if confidence < ENOUGH or (probability >= _OTHER and not right):
        return told, ""
    return "", told + ("; the outline holds either way" if right else "") if probability >= _NOTED else ""


def _verdict(
    wrong: str,
    weak: str,
    assessed: Assessment,
    effort: Effort,
    second: str,
    averaging: str,
    area: bool,
    enough: float,
    of_one: float,
) -> tuple[Status, list[str]]:
    """Return the status, and advice: what the outline does not explain, what is left open, how sure it is.

    `second` is what to do about a second signature, "" where both are read; `averaging` "" where neither that nor the
    area can make it "ok"; `enough` the least confidence of an "ok", `of_one` that of one signature on more strips.
    """
    if wrong:
        return "doubtful", [wrong]
    if assessed.confidence is None:
        why = "" if effort == "none" else "how sure this is was not assessed: the compiled core is missing"
        return ("doubtful" if weak else "likely"), [weak, why]
    if assessed.confidence >= enough:
        return ("likely" if effort == "fast" and second else "ok"), [weak, _CONVEX if second else ""]
    more = ", ".join(filter(None, (second, averaging))) if second else f"{averaging}, or use finer strips"
    others = "others explain the readings too" + (
        "" if assessed.alternatives else ", though none of them is likely"
    )
    narrower = "" if area or not averaging else ", or give the contact's area"
    likely = enough == _NEVER and assessed.confidence >= of_one
    why = _FEW if likely else f", for {others}"
    only = "" if likely else " only"
    sure = (
        f"with a probability of {assessed.confidence:.2f}{only} it overlaps the true outline by an IoU of "
        f"{PROMISED_IOU} or more{why}: {more}{narrower}"
    )
    return "doubtful", [sure, weak]


_CONVEX = "taken for convex: one signature does not tell a notch or a gap"
_FEW = (
    f'; "ok" promises more, and from fewer than {ENOUGH_STRIPS} strips with one signature even outlines as sure as '
    "that are wrong in 1 of 10"
)


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
    if y.min() <= _THIN or y.max() >= 1.0 - _THIN:
        del options[:1]  # held to the strips, the mean lies inside of what passes over the border
    for option in options:
        # Least squares has the count that its own criterion chose.
        if option.fallback is None and len(option.outline.vertices) != len(outline.vertices):
            continue
        if explains(contact.run, noise.distribution, option.outline):
            return option, False
    return None, refined is None


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
    if not isinstance(model, PolygonFit) or sensor.strip_width_mm is not None:
        return covariance
    return model.linear_covariance(run.problem, sensor)


def _upright(outline: Outline, covariance: FloatArray, sensor: Sensor) -> tuple[int, ...]:
    """Return the places in `vertices.ravel()` of x of vertical ends of which no more than a pitch is known."""
    if len(outline.vertices) == len(outline.lower) + len(outline.upper) - 2:  # both ends are points
        return ()
    lower, upper = outline.indices
    places = [2 * int(lower[end]) for end in (0, -1) if lower[end] != upper[end]]
    return tuple(i for i in places if covariance[i, i] > _ANYWHERE * sensor.pitch_mm**2 / 12.0)


def _chosen(run: RunFit, known: bool) -> tuple[PolygonFit, bool]:
    """Return the fit to give, and whether it is a triangle that one signature cannot tell from a line."""
    assert run.selection is not None
    if run.selection.chosen.n_interior or len(run.problem.k) > 1:
        return run.selection.chosen, False
    triangles = [f for f in fit_counts(run.problem, known, 1, every=True).fits if f.n_interior]
    return (triangles[0], True) if triangles else (run.selection.chosen, False)


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
            if in_mm.height > _THIN * sensor.length_mm:
                yield Outline.held(in_mm.lower, in_mm.upper), fit.covariance(run.problem, sensor)


def _raw_profile(scan: Scan, sensor: Sensor, strips: slice) -> Profile | None:
    """Return the contact strip by strip, which needs both signatures."""
    if not {"kh", "kl"} <= set(scan.signatures):
        return None
    with np.errstate(divide="ignore", invalid="ignore"):  # k_l far above k_h: no contact makes it
        l, u = closed_ends(sensor, scan["kh"][strips], scan["kl"][strips])
    return (sensor.x_mm[strips], l, u) if np.isfinite(l + u).all() else None


def _bridged(contact: FittedContact, sensor: Sensor, around: int) -> list[int]:
    """Return the strips inside a contact that read nothing, and that nobody said to leave out."""
    named = left_out_wholly(sensor)
    return [i % around for i in contact.missing if not named[i % around]]


def _notes(
    scan: Scan,
    sensor: Sensor,
    contact: FittedContact,
    around: int,
    known: bool,
    faulty: BoolArray | None = None,
    convex: bool = False,
) -> list[str]:
    """Name the strips that were bridged, and the readings (S, n) that were left out, some as of `faulty` channels.

    `convex`: whether none contradicts the others, for convex ends explain them all.
    """
    notes, base, out = [], sensor.strip_base, contact.run.excluded

    def listed(which: BoolArray) -> str:
        names = []
        for s, i in np.argwhere(which):
            signature, strip = scan.signatures[s], i + contact.fitted.start
            read = f"{SIGNATURES[signature].symbol} = {scan[signature][strip]:.3g}"
            names.append(f"{strip % around + base} ({read})")
        return _list(names)

    if missing := _bridged(contact, sensor, around):
        names = _list([str(i + base) for i in missing])
        notes.append(
            f"strip {names} reads nothing inside the contact and was bridged: is it broken, or are there two objects?"
        )
    if faulty is not None and np.count_nonzero(faulty):
        out = out & ~faulty
        notes.append(
            f"strip {listed(faulty)} does not fit its neighbours and was left out: no contact that the others agree on "
            "reads so, but a faulty channel does; press elsewhere and run the doctor"
        )
    if np.count_nonzero(out) and convex:
        notes.append(
            f"the outline passes by strip {listed(out)}: there it may have one more corner, or a curve"
        )
    elif np.count_nonzero(out):
        others = [
            "a corner, for strips so few? Call the channel stuck only if other scans do, too."
            if not contact.run.checked
            else "",
            "" if known else "noise? Then give the noise, which is only estimated here",
        ]
        guessed = "".join(f" Or is that {other}" for other in others if other)
        notes.append(
            f"strip {listed(out)} does not fit its neighbours and was left out: is a channel stuck?{guessed}"
        )
    return notes


def _list(names: list[str]) -> str:
    return ", ".join(names[:_NAMED]) + (", ..." if len(names) > _NAMED else "")
