"""How sure a shape is, what else it may be, and whether an outline drawn is the better estimate."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias, get_args

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.core.ellipse import Ellipse
from tacstrip.core.outline_model import OutlineModel
from tacstrip.core.posterior import vertex_counts
from tacstrip.core.swept_area import NEARLY_ALL, swept_areas, swept_share
from tacstrip.errors import OptionError, one_of
from tacstrip.geometry.metrics import column_iou, pairwise_column_iou
from tacstrip.geometry.moments import moments
from tacstrip.geometry.outline import Outline
from tacstrip.reconstruction.polygon.run import MOST_SIGMA, RunFit
from tacstrip.reconstruction.posterior.draws import Draws, column_ends, columns, draw
from tacstrip.reconstruction.posterior.family_outline import FamilyOutline
from tacstrip.reconstruction.posterior.regular.draws import RegularDraws, draw_regular
from tacstrip.reconstruction.posterior.rounded import RoundedDraws, draw_rounded
from tacstrip.reconstruction.result import Alternative
from tacstrip.sensor.spec import Sensor

Effort: TypeAlias = Literal["thorough", "fast", "none"]
_EFFORTS = get_args(Effort)

PROMISED_IOU = 0.8  # of an outline that is "ok" with the true one
ENOUGH = 0.77  # confidence of the least certain "ok": all of them together are right in 95 of 100 cases
# With both signatures on fewer than `ENOUGH_STRIPS`, where many are hardly surer; on fewer than `FEWEST_STRIPS` by the
# promise itself, for there one in ten that are less sure is concave, or two objects.
ENOUGH_OF_FEW, ENOUGH_OF_FEWEST, FEWEST_STRIPS = 0.87, 0.95, 6
# With one signature, where many are hardly surer than that.
ENOUGH_OF_ONE: Mapping[Effort, float] = {"thorough": 0.76, "fast": 0.73}
_EVALUATIONS = {"thorough": 300_000, "fast": 14_000}
# Both signatures on fewer strips leave outlines of more corners open, which so few draws would miss.
HELD_STRIPS, _EVALUATIONS_OF_FEW = 5, 56_000
_KEPT = {"thorough": 240, "fast": 100}
_RATHER_WRONG, _BETTER = 0.5, 0.1  # an estimate less sure than this is given up for one that is so much surer
_ROUNDED_BETTER = 0.3  # likewise a polygon for a rounded outline, for the vertices are lost with it
_REGULAR_BETTER = 4.5  # times the odds, likewise for a regular outline
# Of regular outlines that are given so many convex ones are right, however much less is said of them: most are upright
# rectangles, of which the readings leave any height, and the likeliest height is as often near.
_REGULAR_LEAST = 0.3
# With one signature: log odds of being right, by kind of `doubts`, whose terms these go with. `studies/confidence.py`
# fits them, but for that of an ellipse at the border (the fourth of its kinds). Fast, and of few strips, the first ones
# are of convex contacts alone.
_FEW, _POLYGON, _ELLIPSE, _RIVALS = "few strips", "polygon", "ellipse", ", rivals"
_ROUNDED, _REGULAR = "rounded", "regular"
_ODDS: dict[str, dict[str, tuple[float, ...]]] = {
    "thorough": {
        _FEW: (-2.0, 1.368, 0.4, -0.211),
        _POLYGON + _RIVALS: (
            *(-3.495, 0.751, -0.324, -1.119, -21.43, 0.127, 0.337, -0.174, 1.344, -0.229, 0.247, -0.045),
            -1.257,
        ),
        _ELLIPSE + _RIVALS: (-2.464, -0.016, 0.514, -0.893, -2.197, 1.718, 0.318, -0.238, 1.321, 0.620),
        _REGULAR: (-4.146, 1.234, -0.276, 0.434, 0.872, -0.519, -0.074, -6.301, -0.273, 0.150),
        _ROUNDED: (-2.722, 0.194, -0.300, 1.014, 0.210, 0.618, 1.678, 0.328),
        _POLYGON: (-1.957, 1.436, -0.346, -1.141, -30.5),
        _ELLIPSE: (-8.726, 2.087, 1.242, -3.0, -1.243),
    },
    "fast": {
        _FEW: (-2.390, 1.194, 0.522, -0.233),
        _POLYGON + _RIVALS: (-0.591, 1.047, -0.499, -0.455, -20.336, 0.447, 0.751, 0.286),
        _ELLIPSE + _RIVALS: (-0.833, -0.083, 0.455, -3.6, -1.408, 0.577, 1.419, -0.122, 0.315),
        _POLYGON: (-2.374, 1.453, -0.418, -0.276, -28.86),
        _ELLIPSE: (-8.863, 2.089, 1.232, -3.0, -1.293),
    },
}
_AS_WELL = 0.03  # of the expected IoU
_PLAIN, _MANY = 5, 7  # corners that are no doubt, and how many more of them count
_LEAST = 0.02  # expected IoU that none counts as
_MISFITS = (0.5, 300.0)  # of the best rounded outline, beyond which it tells no more
_SLENDEREST = 0.01  # ratio of the axes, below which it tells no more
_DISC = (-2.0, 6.0)  # evidence that an ellipse is a disc, beyond which it tells no more
_WORST = -60.0  # advantage of regular outlines, below which it tells no more
_SQUARES = (0.3, 3.0)  # of the residuals a degree of freedom, likewise
# At most, where the readings hold another count than was given: a third of the surer ones are right.
_SHORT = 0.4
_ALARM = 3.5
_LIGHTEST, _MOST = 0.05, 4  # weight of an alternative, and how many are told
# IoU of nearly all outlines that the covariance allows: nothing to sample, and what it is worth.
_FIRM, _SURE = 0.9, 0.995
ENOUGH_STRIPS = 12  # of fewer "ok" asks for more, and with one signature no outline is sure enough
_SWEPT = 1.0 - _FIRM  # of the area: what differs by no more overlaps as much


@dataclass(frozen=True, eq=False)
class Assessment:
    """What outlines that explain the readings say of an estimate.

    Attributes
    ----------
    confidence
        Probability that the estimate overlaps the true outline by `PROMISED_IOU` or more; None: not assessed.
    alternatives
        Other outlines, the likeliest first.
    explained
        Whether outlines drawn leave no more of the readings than noise does, even if the estimate does.
    better
        An outline that overlaps what the true one may be better than the estimate does; then `confidence` is its.
    better_explains
        Whether that one leaves no more of the readings than noise does, or, where nobody knows the noise, than the fit.
    mixed
        The outlines drawn, where they are enough to tell how a polygon's vertices scatter.
    """

    confidence: float | None = None
    alternatives: tuple[Alternative, ...] = ()
    better: OutlineModel | None = None
    explained: bool = False
    better_explains: bool = False
    mixed: Draws | None = None


def check_effort(assessment: str) -> None:
    """Refuse an unknown effort: `OptionError`."""
    if assessment not in _EFFORTS:
        raise OptionError(one_of("assessment", assessment, _EFFORTS))


def assess(
    run: RunFit,
    sensor: Sensor,
    outline: Outline,
    covariance: FloatArray,
    sigma_known: bool,
    effort: Effort,
    area_mm2: tuple[float, float] | None = None,
    known_count: int | None = None,
    faults: int = 0,
    misses: bool = False,
) -> Assessment:
    """Compare an estimate with outlines drawn from the posterior.

    Parameters
    ----------
    run, sensor
        The fit, of what.
    outline, covariance
        The estimate [mm], and the covariance of its vertices [mm^2].
    sigma_known
        Whether the readings' sigma was given.
    effort
        "thorough", "fast", or "none": not at all.
    area_mm2
        Mean and standard deviation of the contact's area, where that is known.
    known_count
        Its vertices, where that is known.
    faults
        Readings left out that are surely of faulty channels.
    misses
        Whether both signatures tell a convex contact that the estimate does not follow: it is given up for a draw.
    """
    if effort == "none":
        return Assessment()
    if len(run.problem.k) > 1 and area_mm2 is None and _firm(run, outline, covariance):
        return Assessment(_SURE)
    evaluations = _EVALUATIONS[effort]
    if len(run.problem.k) > 1 and run.problem.x.size < HELD_STRIPS:
        evaluations = max(evaluations, _EVALUATIONS_OF_FEW)
    drawn = draw(run, sensor, sigma_known, evaluations, _KEPT[effort], area_mm2, known_count)
    if drawn is None:
        return Assessment()
    told_area = area_mm2 is not None
    short = known_count is not None and len(outline.vertices) != known_count
    chosen = _Chosen.of(run.model, outline, drawn)
    one, every = len(run.problem.k) == 1, pairwise_column_iou(drawn.ends)
    rounded = regular = None
    if one and not told_area and known_count is None and not few_strips(run):
        rounded = draw_rounded(drawn.problem, drawn.window, drawn.x, chosen.ends, quick=effort == "fast")
        if effort == "thorough":
            regular = draw_regular(drawn.problem, drawn.window, drawn.x, drawn.misfit)
    # What the fit does not know, or does not keep to.
    told = told_area or short or misses
    if (one or misses) and (chosen.confidence < _RATHER_WRONG or told):
        chosen = _drawn_instead(chosen, run, drawn, every, known_count, told, short, misses)
    if one:
        chosen = _judged_by_rivals(chosen, run, drawn, rounded, regular, effort, short, faults)
    explained, itself = _explained(run, drawn, sigma_known)
    better_explains = chosen.misfit * drawn.problem.readings < itself
    # What is not the estimate's is theirs, at most; and of a rounded or regular one the draws know nothing.
    unlike = 1.0 if isinstance(chosen.better, FamilyOutline) else float(drawn.weight[~chosen.own].sum())
    rest = min(1.0, (1.0 - chosen.confidence) / unlike) if unlike > 0.0 else 0.0
    others = _alternatives(drawn, every >= PROMISED_IOU, chosen.own, rest)
    # The fast mode's fewer draws do not mix, nor do those of two signatures.
    mixed = drawn if one and effort == "thorough" else None
    return Assessment(
        chosen.confidence, others, chosen.better, explained or better_explains, better_explains, mixed
    )


@dataclass(frozen=True, eq=False)
class _Chosen:
    """The outline that is assessed: the fit's, or a better one.

    Attributes
    ----------
    model, corners, ends
        It, its vertices, and l and u in the draws' columns (2, G).
    own
        Which draws overlap it by `PROMISED_IOU` or more (K,).
    confidence
        That it is right.
    better
        It, where it is not the fit's.
    misfit
        What it leaves of the readings, where it is a regular one.
    """

    model: OutlineModel | None
    corners: int
    ends: FloatArray
    own: BoolArray
    confidence: float
    better: OutlineModel | None = None
    misfit: float = math.inf

    @classmethod
    def of(cls, model: OutlineModel | None, outline: Outline, drawn: Draws) -> _Chosen:
        """Return the fit's outline."""
        ends = drawn.ends_of(outline.lower, outline.upper)
        own = drawn.overlap(ends) >= PROMISED_IOU
        return cls(model, len(outline.vertices), ends, own, drawn.share(own))


def _drawn_instead(
    chosen: _Chosen, run: RunFit, drawn: Draws, every: FloatArray, known_count: int | None, told: bool,
    short: bool, misses: bool,
) -> _Chosen:  # fmt: skip
    """Return the draw that overlaps the others best where that is surer; their mean would be none of them."""
    fitting = drawn.fitting(known_count)
    if not fitting.any():
        return chosen
    among = np.where(fitting, every @ drawn.weight, 0.0)
    if misses:  # many overlap nearly as well: take no corners that no reading asks for
        counts = vertex_counts(drawn.samples.outlines)
        few = counts == counts[among >= among.max() - _AS_WELL].min()
        among = np.where(few, among, 0.0)
    at = int(np.argmax(among))
    near = every[at] >= PROMISED_IOU
    surer = 0.0 if told else _BETTER
    if not (short or misses or drawn.share(near) > chosen.confidence + surer):
        return chosen
    better = drawn.model(at, run.problem)
    outline = Outline(*better.chains_mm(run.problem))
    ends = drawn.ends_of(outline.lower, outline.upper)
    return _Chosen(better, len(outline.vertices), ends, near, drawn.share(near), better)


def _judged_by_rivals(
    chosen: _Chosen, run: RunFit, drawn: Draws, rounded: RoundedDraws | None, regular: RegularDraws | None,
    effort: Effort, short: bool, faults: int,
) -> _Chosen:  # fmt: skip
    """Return an outline of one signature with its confidence by `doubts`, or a rounded or regular one that is surer."""
    corners = float(chosen.corners)
    if regular is not None:  # long chains: their counts tell more
        corners = float(vertex_counts(drawn.samples.outlines).mean())
    expected = float(drawn.overlap(chosen.ends) @ drawn.weight)
    told_by = doubts(expected, run, chosen.model, corners, chosen.ends, drawn, rounded, regular, faults)
    confidence = told_by.probability(effort)
    judged = replace(chosen, confidence=min(confidence, _SHORT) if short else confidence)
    if rounded is None or regular is None:
        return judged
    best = regular.commonest()
    sure = doubts_of_regular(regular, best, run, chosen.ends, rounded, corners, faults).probability(effort)
    if not isinstance(chosen.model, Ellipse):
        middle = rounded.commonest()
        surer = doubts_of_rounded(rounded, middle, drawn, corners, regular).probability(effort)
        if surer > max(judged.confidence + _ROUNDED_BETTER, sure):
            own = drawn.overlap(rounded.ends[middle]) >= PROMISED_IOU
            outline = rounded.outline(middle, drawn.problem.lam)
            judged = replace(judged, confidence=surer, better=outline, own=own)
    confidence = judged.confidence
    if sure * (1.0 - confidence) > _REGULAR_BETTER * confidence * (1.0 - sure):
        own = drawn.overlap(regular.ends[best]) >= PROMISED_IOU
        outline = regular.outline(best)
        sure = max(sure, _REGULAR_LEAST)
        judged = replace(judged, confidence=sure, better=outline, own=own, misfit=regular.misfit)
    return judged


def _explained(run: RunFit, drawn: Draws, sigma_known: bool) -> tuple[bool, float]:
    """Return whether draws leave no more than noise does, even if the estimate does; and what a better one may leave.

    By chi square of the better half of the draws; that of normal errors exceeds its mean by 3.5 deviations in .02 %.
    """
    readings = drawn.problem.readings
    allowed = readings + _ALARM * np.sqrt(2.0 * readings)
    itself = allowed
    if not sigma_known:  # a fit that is off by more than any noise is no likeness, where draws are one
        itself = readings * min(MOST_SIGMA / run.sigma, 1.0) ** 2
        allowed = itself if run.sigma > MOST_SIGMA else 0.0
    counted = drawn.weight[: len(drawn.samples.outlines)] > 0.0
    squares = drawn.samples.squares[counted] if counted.any() else drawn.samples.squares
    return float(np.median(squares)) < allowed, itself


@dataclass(frozen=True, eq=False)
class Doubts:
    """What tells whether an outline from one signature is right.

    Attributes
    ----------
    kind
        Of `_ODDS`: which terms there are.
    terms
        1, the log odds of the expected IoU, and doubts (T,).
    """

    kind: str
    terms: FloatArray

    def probability(self, effort: Effort) -> float:
        """Return how often outlines of such doubts are right."""
        return float(1.0 / (1.0 + np.exp(-(self.terms @ _ODDS[effort][self.kind]))))


def doubts(
    expected: float,
    run: RunFit,
    model: OutlineModel | None,
    corners: float,
    ends: FloatArray,
    drawn: Draws | None = None,
    rounded: RoundedDraws | None = None,
    regular: RegularDraws | None = None,
    faults: int = 0,
) -> Doubts:
    """Return what tells whether an outline from one signature is right.

    Draws and estimate share a prior of polygons and ellipses, and what is rounded or concave has no likeness among
    them. Such an object takes many corners, or an ellipse that is hardly better than a polygon or leaves more than
    noise; readings at its inward corners are left out, and the outline is rather too high than too low. Rounded and
    regular ones that explain the readings as well, and lie elsewhere, say so too. An ellipse at the sensor's border may
    be cut off.

    Parameters
    ----------
    expected
        IoU of the outline with the draws, on average.
    run, model
        The fit, and the outline's model.
    corners
        Of the outlines drawn, on average, where there are `regular` ones; else of the outline.
    ends
        l and u of the outline over the strip in the draws' columns (2, G), both 0 outside.
    drawn
        The draws: whether the contact may go on beyond the first strip or the last one, and what polygons leave.
    rounded, regular
        Such outlines that explain the readings best, where they were drawn: regular ones only beside rounded ones.
    faults
        Readings left out that are surely of faulty channels, and so of no inward corner.
    """
    odds, ellipse = _log_odds(expected), isinstance(model, Ellipse)
    if few_strips(run):
        many = 0.0 if ellipse else max(_many(corners), 0.0)
        return Doubts(_FEW, np.array([1.0, odds, float(ellipse), many]))
    if ellipse:
        kind, better = _ELLIPSE, math.log1p(max(run.ellipse_advantage, 0.0))
        left = run.residual_sums[0] / max(run.freedom, 1)
        border = float(drawn is not None and drawn.at_border)
        of = [1.0, odds, better, border, math.log(min(max(left, _SQUARES[0]), _SQUARES[1]))]
    else:
        kind, there = _POLYGON, ends[1] > ends[0]
        height = float(ends[1, there].max() - ends[0, there].min()) if there.any() else 0.0
        of = [1.0, odds, _many(corners), height, _left_out(run, faults)]
    if rounded is not None:
        kind += _RIVALS
        overlap = float(rounded.weight @ rounded.overlap(ends))
        of += [_misfit(rounded.misfit), _log_odds(overlap), math.log(run.sigma)]
        if regular is None and isinstance(model, Ellipse):  # else regular ones tell discs
            of.append(min(max(model.disc_evidence(run.problem), _DISC[0]), _DISC[1]))
    if drawn is not None and regular is not None:
        alike, unexplained = _likeness(regular, ends)
        of += [alike, _advantage(regular)]
        # Where no regular one explains them, few corners are a polygon's, and many those of what is rounded; and where
        # no polygon does, the outline is concave.
        if not ellipse:
            of += [unexplained, unexplained * _many(corners), max(_misfit(drawn.misfit), 0.0)]
    return Doubts(kind, np.array(of))


def doubts_of_rounded(
    rounded: RoundedDraws, best: int, drawn: Draws, corners: float, regular: RegularDraws
) -> Doubts:
    """Return what tells whether one of the rounded outlines is right.

    How well others overlap it, what they leave of the readings, whether polygons and ellipses drawn overlap it, and how
    many `corners` these take on average: what is rounded takes many. How slender it is; and whether regular outlines,
    where they explain the readings, overlap it.
    """
    one = rounded.ends[best]
    overlaps = (rounded.overlap(one) @ rounded.weight, drawn.overlap(one) @ drawn.weight)
    among, across = (_log_odds(float(o)) for o in overlaps)
    of = [1.0, among, _misfit(rounded.misfit), across, _many(corners), _log_axis_ratio(one, drawn)]
    return Doubts(_ROUNDED, np.array([*of, *_likeness(regular, one)]))


def doubts_of_regular(
    regular: RegularDraws,
    best: int,
    run: RunFit,
    ends: FloatArray,
    rounded: RoundedDraws,
    corners: float,
    faults: int = 0,
) -> Doubts:
    """Return what tells whether one of the regular outlines is right.

    How well others, the estimate with its `ends` and rounded outlines overlap it, how likely regular outlines make the
    readings, what these leave of them, how large the noise is, and which readings are left out. The likelier they make
    the readings, the less does the estimate tell; and polygons take many `corners` for what is curved.
    """
    one = regular.ends[best]
    overlaps = (regular.overlap(one).mean(), column_iou(one, ends), rounded.weight @ rounded.overlap(one))
    among, estimate, across = (_log_odds(float(o)) for o in overlaps)
    advantage = _advantage(regular)
    of = [1.0, among, estimate, across, advantage, math.log(run.sigma), _misfit(regular.misfit)]
    return Doubts(_REGULAR, np.array([*of, _left_out(run, faults), advantage * estimate, _many(corners)]))


def few_strips(run: RunFit) -> bool:
    """Whether the fit is of so few strips that "ok" asks for more."""
    return run.problem.x.size < ENOUGH_STRIPS


def _misfit(of_readings: float) -> float:
    return math.log(min(max(of_readings, _MISFITS[0]), _MISFITS[1]))


def _many(corners: float) -> float:
    return min(corners - _PLAIN, _MANY)


def _likeness(regular: RegularDraws, ends: FloatArray) -> tuple[float, float]:
    """Return how well regular outlines overlap another one, as log odds, and how much of the readings they leave.

    An overlap with outlines that hardly explain the readings tells little.
    """
    unexplained = max(_misfit(regular.misfit), 0.0)
    return math.exp(-0.5 * unexplained) * _log_odds(float(regular.overlap(ends).mean())), unexplained


def _log_axis_ratio(ends: FloatArray, drawn: Draws) -> float:
    """Return the logarithm of the shorter principal axis over the longer one of l and u (2, G) in the columns."""
    there, problem = ends[1] > ends[0], drawn.problem
    x, (lower, upper) = drawn.x[there] * problem.width_mm, ends[:, there] * problem.length_mm
    chains = (np.stack([x, lower], axis=1), np.stack([x, upper], axis=1)[::-1])
    xx, yy, xy = moments(np.concatenate(chains))[2]
    whole, apart = xx + yy, math.hypot(xx - yy, 2.0 * xy)
    ratio = (whole - apart) / (whole + apart) if whole > 0.0 else 0.0
    return 0.5 * math.log(max(ratio, _SLENDEREST**2))


def _advantage(regular: RegularDraws) -> float:
    return 0.1 * min(max(regular.advantage, _WORST), 0.0)


def _left_out(run: RunFit, faults: int) -> float:
    return float((np.count_nonzero(run.excluded) - faults) / run.problem.x.size)


def _log_odds(share: float) -> float:
    return math.log((share + _LEAST) / (1.0 + _LEAST - share))


def _alternatives(drawn: Draws, alike: np.ndarray, own: np.ndarray, weight: float) -> tuple[Alternative, ...]:
    """Return the outlines that most others are like, of those unlike the estimate; `weight`: of all draws."""
    found: list[Alternative] = []
    left = weight * drawn.weight * ~own
    while len(found) < _MOST:
        share = alike @ left
        at = int(np.argmax(np.where(left > 0.0, share, -1.0)))
        if share[at] < _LIGHTEST:
            break
        found.append(Alternative(float(share[at]), drawn.outline(at).vertices))
        left = left * ~alike[at]
    return tuple(found)


def _firm(run: RunFit, outline: Outline, covariance: FloatArray) -> bool:
    """Whether the covariance leaves hardly any other outline."""
    if run.problem.x.size < ENOUGH_STRIPS:
        return False
    told = run.model_mm
    if covariance is told.covariance and told.swept <= _SWEPT:
        return True
    if not np.isfinite(covariance).all():
        return False
    if swept_share(outline.vertices, covariance) <= _SWEPT:
        return True
    moved = outline.vertices + swept_areas(outline.vertices, covariance)[0]
    at, (lower, upper) = columns(run.problem), outline.indices
    own = column_ends(run.problem, at, outline.lower, outline.upper)
    drawn = column_ends(run.problem, at, moved[:, lower], moved[:, upper])
    return bool(np.mean(column_iou(drawn, own) >= _FIRM) > NEARLY_ALL)
