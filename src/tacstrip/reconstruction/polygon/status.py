"""Status of an outline, and the advice that goes with it: what to do, what was left out, what else it may be."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.core.polygon_fit import PolygonFit
from tacstrip.geometry.moments import deviations, moments
from tacstrip.geometry.outline import Outline
from tacstrip.reconstruction.pieces.overhang import Overhang
from tacstrip.reconstruction.pieces.pair import Pair
from tacstrip.reconstruction.polygon.goodness_of_fit import IF_ONE, NOTED
from tacstrip.reconstruction.polygon.outline_estimate import FittedContact
from tacstrip.reconstruction.polygon.run import RunFit
from tacstrip.reconstruction.posterior.assessment import (
    ENOUGH,
    ENOUGH_OF_FEW,
    ENOUGH_OF_FEWEST,
    ENOUGH_OF_ONE,
    ENOUGH_STRIPS,
    FEWEST_STRIPS,
    PROMISED_IOU,
    Assessment,
    Effort,
    few_strips,
)
from tacstrip.reconstruction.result import Alternative, Status
from tacstrip.scan import Scan
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.left_out import left_out_wholly
from tacstrip.sensor.spec import Sensor

_FAR_AREA = 3.0  # deviations between an area that was given and the one that the readings say
# Confidence that is enough: of few strips with one signature 1 in 10 is wrong even of the surest.
_NEVER = 2.0
_NAMED = 5  # strips that advice names
# Probability of two objects: where the outline is concave and overlaps them less than "ok" promises it is doubted, and
# as any other outline that is less sure.
_OTHER = 0.07
OTHERS = (
    "the best outline of few corners is off by {:.2g} % of Vref, and others explain the readings too: {}, or give the "
    "noise"
)
_CONVEX = "taken for convex: one signature does not tell a notch or a gap"
_FEW = (
    f'; "ok" promises more, and from fewer than {ENOUGH_STRIPS} strips with one signature even outlines as sure as '
    "that are wrong in 1 of 10"
)


def enough_of(run: RunFit, effort: Effort, second: str) -> tuple[float, float]:
    """Return the least confidence of an "ok", and that of one signature on more strips.

    `second` is what to do about a second signature, "" where both are read.
    """
    of_one = ENOUGH_OF_ONE.get(effort, ENOUGH)
    if second:
        return (_NEVER if few_strips(run) else of_one), of_one
    if run.problem.x.size < FEWEST_STRIPS:
        return ENOUGH_OF_FEWEST, of_one
    return (ENOUGH_OF_FEW if few_strips(run) else ENOUGH), of_one


def uncounted_vertices(
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


def other_area(outline: Outline, covariance: FloatArray, area_mm2: tuple[float, float], most: float) -> str:
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


def beside_pair(
    pair: Pair, confidence: float | None, alternatives: tuple[Alternative, ...]
) -> tuple[float | None, tuple[Alternative, ...]]:
    """Return the confidence and the alternatives beside two objects."""
    one = 1.0 - pair.probability
    rest = (replace(a, weight=a.weight * one) for a in alternatives)
    ordered = tuple(sorted((pair.alternative, *rest), key=lambda a: -a.weight))
    return None if confidence is None else one * confidence, ordered


def two_objects(pair: Pair, right: bool, before: float, enough: float) -> tuple[str, str]:
    """Return advice that doubts an outline which two objects explain too, or, where it stays, a note of that.

    `right` is whether the outline overlaps both together as `ok` promises: then only their number is open. `before` is
    the confidence without them, `enough` the least one of an "ok": what is not sure enough anyway is not for them.
    """
    slide = "slide or turn the contact and track it, or add a second layer, to tell"
    meet = ""
    if pair.meeting_mm is not None:
        between = "x = {:.4g} and {:.4g} mm".format(*pair.meeting_mm)
        meet = f", which would meet between {between}, where the ends of each are not seen"
    chance = f"with a probability of {pair.probability:.2f} (see the alternatives){meet}: {slide}"
    where = "on the same strips" if pair.shared else "beside each other"
    told = (
        f"{pair.advice}; it is two {chance}"
        if pair.advice
        else f"two objects {where} explain the readings too, {chance}; {IF_ONE}"
    )
    parted = before >= enough > before * (1.0 - pair.probability)
    if parted or (pair.probability >= _OTHER and not right and not pair.one_convex):
        return told, ""
    if pair.probability < NOTED:
        return "", ""
    return "", told + ("; the outline holds either way" if right else "")


def behind_overhang(overhang: Overhang) -> str:
    """Say what of an outline may not be touched behind an overhang."""
    return (
        f"an end jumps by {overhang.rise:.3g} mm from one strip to the next: behind such an overhang up to "
        f"{100.0 * min(overhang.share, 1.0):.0f} % of the outline may not be touched, with a probability of "
        f"{overhang.probability:.2g} more than is promised; turn the object"
    )


def unlike_few(unlike: float, sound: float, strips: int, one_object: bool) -> str:
    """Say that few strips may read what their outline is unlike.

    Parameters
    ----------
    unlike, sound
        Probabilities that they do, and that a channel left out is not faulty.
    strips
        How many there are.
    one_object
        Whether it is known that there are no two.
    """
    what = "a concave one" if one_object else "a concave one or two objects on the same strips"
    read = "this outline"
    remedy = "use finer strips, or slide or turn the contact and track it" + (
        "" if one_object else f"; {IF_ONE}"
    )
    if sound > unlike:
        read = "a faulty channel, whose reading was left out,"
        remedy = "press elsewhere, or if the channel is faulty leave it out by name (--without)"
    other = either(unlike, sound)
    return f"{strips} strips hardly tell {read} from {what}, which it is with a probability of {other:.2g}: {remedy}"


def either(one: float, other: float) -> float:
    """Return the probability of one of two that have nothing to do with each other, or of both."""
    return 1.0 - (1.0 - one) * (1.0 - other)


def lowered(
    told: str, probability: float, confidence: float | None, enough: float
) -> tuple[str, str, float | None]:
    """Return what is `told` as advice that doubts an outline, or as a note, and the confidence that is left.

    `probability` is that the outline is wrong for this; it doubts one that would be "ok", from `enough` on, without it.
    """
    before = 1.0 if confidence is None else confidence
    left = (1.0 - probability) * before
    doubted = before >= enough > left
    noted = not doubted and probability >= NOTED
    return told if doubted else "", told if noted else "", None if confidence is None else left


def status_of(
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


def bridged(contact: FittedContact, sensor: Sensor, around: int) -> list[int]:
    """Return the strips inside a contact that read nothing, and that nobody said to leave out."""
    named = left_out_wholly(sensor)
    return [i % around for i in contact.missing if not named[i % around]]


def notes_of(
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

    if missing := bridged(contact, sensor, around):
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
