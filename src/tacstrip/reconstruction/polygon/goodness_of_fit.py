"""Does the outline explain the readings, and do they determine it? Advice in words."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.core.ellipse import Ellipse
from tacstrip.core.outline_model import OutlineModel
from tacstrip.core.polygon_fit import PolygonFit
from tacstrip.core.search import PAST, most_vertices
from tacstrip.geometry.moments import moments
from tacstrip.geometry.outline import Outline
from tacstrip.reconstruction.contact_ends import closed_ends, end_deviations
from tacstrip.reconstruction.noise_covariance import CorrelatedErrors
from tacstrip.reconstruction.pieces.beside import pair_beside
from tacstrip.reconstruction.pieces.chain import Cut
from tacstrip.reconstruction.pieces.pair import Ends, Pair, likeliest_pair, pair_at_the_ends
from tacstrip.reconstruction.pieces.run import RunPieces, split_run
from tacstrip.reconstruction.polygon.chi_square import ALARM, squares_score
from tacstrip.reconstruction.polygon.convexity import (
    OneConvex,
    deviation,
    explained_by_convex,
    fit_convex,
    inward_corners,
    like,
    nearly,
    scatter,
)
from tacstrip.reconstruction.polygon.faulty_channel import contradictory, one_end_off
from tacstrip.reconstruction.polygon.run import MOST_SIGMA, RunFit, residual_sums
from tacstrip.reconstruction.posterior.family_outline import ROUNDED, FamilyOutline
from tacstrip.sensor.spec import Sensor

_LOOSE = 0.2  # of the contact's width: a vertex less certain in x is hardly one
_EQUAL = 3  # counts that fit as well as the best one
_RIVAL = -6.0  # an ellipse whose criterion is worse by less than this is a rival
_REFLEX = 3.0  # standard deviations by which a corner turns inwards
_FAINT = 0.01  # of sigma^2
_APART = 3.0  # standard deviations of their distance in x by which two corners are told apart
_NEAR_CORNER = 2  # strips from an inward corner to where an object may begin or end
# Inward corners far from each other: where two objects begin and end they have two, and what noise adds.
_EVENTS = 4
# Of an outline, behind an overhang: more, and the shape is not known; and where two objects apart might read so,
# or no polygon does.
_HIDDEN, _HIDDEN_OPEN = 0.55, 0.35
IF_ONE = "if you know that it is one object, say so (`reconstruct --one-object`)"
NOTED = 0.05  # probability of two objects: less is not told
_NOISIER = 3.0  # times the noise given: neighbours that differ by so much are noise, not jumps
# Of what a polygon leaves over: neighbours that differ so little say that it follows them badly.
_SMOOTHED = 0.7


def chi_square_score(residuals: FloatArray, freedom: int, distribution: str) -> float:
    """Return how many standard deviations the squared residuals exceed what sigma allows."""
    return squares_score(float((residuals**2).sum()), freedom, distribution)


def autocorrelation_score(residuals: FloatArray, readings: int) -> float:
    """Return how many standard deviations neighbouring residuals are more alike than chance makes them.

    0 where they are far below the noise, or all rounding.
    """
    return _autocorrelation_score(*residual_sums(residuals), readings)


def _autocorrelation_score(squares: float, pairs: float, readings: int) -> float:
    return 0.0 if squares < _FAINT * readings else math.sqrt(readings) * pairs / squares


def explains(run: RunFit, distribution: str, outline: Outline) -> bool:
    """Whether an outline that is not the least-squares one leaves no more of a run's readings than noise does."""
    sums, readings = (
        residual_sums(PolygonFit.of(outline, run.problem).residuals(run.problem)),
        run.problem.readings,
    )
    # It follows the noise less than least squares does, so that nothing is taken off the freedom.
    score = squares_score(sums[0], readings, distribution)
    return max(score, _autocorrelation_score(*sums, readings)) <= ALARM


def misfit(
    run: RunFit,
    distribution: str | None,
    covariance: FloatArray,
    errors: CorrelatedErrors | None = None,
    one_object: bool = False,
) -> str:
    """Return advice where the outline does not explain the readings, else nothing.

    Parameters
    ----------
    run
        What was fitted to what.
    distribution
        Of the noise, "uniform" or "normal"; None where its level was not known.
    covariance
        Of the outline's vertices (2 V, 2 V) [mm^2]; of independent errors.
    errors
        Of the readings, where they are not independent.
    one_object
        Whether it is known that there are no two.
    """
    or_two = "" if one_object else " or two objects on the same strips"
    (squares, pairs), freedom = run.residual_sums, run.freedom
    if errors is not None:
        residuals, freedom = errors.whitened(covariance)
        squares, pairs = residual_sums(residuals)
    if distribution is not None and squares_score(squares, freedom, distribution) > ALARM:
        times = math.sqrt(squares / freedom)
        return (
            f"the readings are {times:.3g} times as far from the best outline as the noise explains: the contact "
            f"may {_more(run)}be concave{or_two}, or the noise larger than given"
        )
    # Noise that nobody gave, less than the outline leaves: see `noise_beside_jumps`.
    if distribution is None and squares_score(squares, run.problem.readings) > ALARM:
        return (
            f"lines along both ends explain the readings by noise of {100.0 * run.sigma:.2g} % of Vref, no outline of "
            f"one object does: the contact may {_more(run)}be concave{or_two}; or give the noise"
        )
    if _autocorrelation_score(squares, pairs, run.problem.readings) > ALARM:
        return (
            "what the best outline leaves over hangs together from strip to strip: the contact may be concave, "
            f"curved,{or_two or ' or have more corners'}"
        )
    if distribution is None and run.sigma == MOST_SIGMA:  # see `estimate`
        return (
            f"{run.problem.readings} readings do not tell corners from noise nobody gave; the outline is for noise "
            f"of {100.0 * MOST_SIGMA:g} % of Vref, more than a sensor that works has: give the noise"
        )
    if distribution is None and run.sigma > MOST_SIGMA:
        return (
            f"the readings are off by {100.0 * run.sigma:.2g} % of Vref from the best outline, more than noise of "
            f"a sensor that works: the contact may {_more(run)}be concave{or_two}; or give the noise"
        )
    return ""


def _more(run: RunFit) -> str:
    """Say that there may be more corners, where the readings are too few to have tried some more."""
    return f"have more corners than {run.problem.readings} readings can tell, " if hides_corners(run) else ""


def hides_corners(run: RunFit) -> bool:
    """Whether the readings are too few to have tried some more corners."""
    return run.selection is not None and run.selection.chosen.n_interior + PAST > most_vertices(run.problem)


def one_convex(
    run: RunFit,
    distribution: str | None,
    outline: Outline,
    sensor: Sensor,
    readings: Mapping[str, FloatArray],
) -> OneConvex | None:
    """Return the convex object that explains all readings, or all but one of a faulty channel; else None.

    One that the outline is like comes first; others count where no outline of more corners was tried, for the readings
    are too few. Arguments as of `second_look`.
    """
    whole = explained_by_convex(run, distribution, outline, sensor, readings, np.zeros_like(run.excluded))
    if whole is not None and whole.like(outline, sensor):
        return whole
    whole = whole if hides_corners(run) else None
    faulty = contradictory(run, sensor, readings)
    if np.count_nonzero(faulty) != 1 or one_end_off(replace(run, excluded=faulty), sensor, readings):
        return whole
    others = explained_by_convex(run, distribution, outline, sensor, readings, faulty)
    return others if others is not None and others.like(outline, sensor) else whole


def second_look(
    run: RunFit,
    distribution: str | None,
    outline: Outline,
    sensor: Sensor,
    wrong: str,
    readings: Mapping[str, FloatArray],
    convex: OneConvex | None,
    one_object: bool = False,
) -> tuple[str, Pair | None]:
    """Return advice, or none, on an outline of two signatures, of which `wrong` was said, and two objects it may be.

    Two signatures tell l and u of every strip. Where convex ones explain them that the outline hardly differs from, it
    is curved, and no polygon need explain it (`convex`: what `one_convex` says of it). Where none do, it is concave, or
    there are several objects, unless it is known to be one (`one_object`).
    """
    selection = run.selection
    if len(run.problem.k) == 1 or selection is None:
        return wrong, None
    problem, fit = run.problem, selection.chosen
    told = run.model_mm.inward
    inward = any(inward_corners(fit)) if told is None else told
    sigma = deviation(run, distribution, sensor, readings)
    if convex is not None:
        return "", _pair_at_the_ends(convex.run, sensor, readings, sigma)
    if one_end_off(run, sensor, readings):
        wrong = wrong or (
            "what was left out may be of a second object, or of an overhang: one end of the contact goes on there as "
            "on the other strips; if a channel is faulty, leave it out by name (--without)"
        )
        return wrong, None
    if wrong and distribution is not None and scatter(sensor, readings) > _NOISIER * sigma:
        return wrong, None  # of readings that scatter more than the noise given, jumps tell nothing
    open_ = np.count_nonzero(run.excluded & ~contradictory(run, sensor, readings))
    unlike = wrong or open_ or inward or sigma < _SMOOTHED * run.sigma
    if not unlike or (distribution is None and run.sigma >= MOST_SIGMA):
        return wrong, None if wrong else _pair_at_the_ends(run, sensor, readings, sigma)
    if not np.isfinite(sum(readings.values())).any():
        return wrong, None  # no strip has both its ends: nothing tells pieces
    pieces = _pieces_of(run, sensor, readings, sigma)
    apart = pieces.apart
    ends = fit.ends(problem.x)
    if not apart and (nearest := fit_convex(problem, *ends)).explains:
        if wrong and not like(outline, nearest, run, sensor):
            return wrong, None
        return "", _pair_at_the_ends(run, sensor, readings, sigma)
    if wrong and (apart or not _follows(outline, pieces)):
        more = f"; at least {pieces.count} convex pieces explain the readings"
        return wrong if one_object or pieces.count == 1 else wrong + more, None
    jumps = [cut for _, cut in pieces.cuts if cut.kind != "corner"]
    pairs = _pair_of(run, pieces, inward_corners(fit)), _beside(run, sensor, readings, sigma)
    pair = max(filter(None, pairs), key=lambda pair: pair.probability, default=None)
    step = max((cut.rise for cut in jumps), default=0.0)
    jump = f"an end jumps by {step:.3g} mm from one strip to the next"
    at = jump if jumps else "a gap may hide in an inward corner"
    if apart and not one_object:
        several = (
            f"the contact is concave or at least two objects on the same strips: {at}; at least {pieces.count} convex "
            f"pieces (`--method pieces`, ts.pieces) explain the readings; {IF_ONE}"
        )
        if pair is None or pieces.count > 2:
            return several, pair
        pair = replace(pair, advice=several)
    area = moments(outline.vertices)[0]
    hidden = max((_behind(cut, pieces.read.x) / area for cut in jumps), default=0.0)
    likely_two = not one_object and pair is not None and pair.probability >= 0.5
    if hidden > (_HIDDEN_OPEN if wrong or apart else _HIDDEN) and not likely_two:
        share = f"{100.0 * min(hidden, 1.0):.0f} % of the outline or more may not be touched"
        if one_object or pair is None or pair.probability < NOTED:
            return f"{at}: behind such an overhang {share}; turn the object", pair
        return (
            f"the contact is concave, or several objects on the same strips: {at}, and behind such an overhang "
            f"{share}; turn the object"
        ), pair
    return "", pair


def _follows(outline: Outline, pieces: RunPieces) -> bool:
    """Whether an outline hardly differs from several convex stretches, curved ones too, that explain the readings."""
    read = pieces.read
    own = np.stack([np.interp(read.x, *chain.T) for chain in (outline.lower, outline.upper)])
    return pieces.count > 1 and pieces.explains and nearly(own, np.stack([read.l, read.u]))


def _read_ends(
    run: RunFit, sensor: Sensor, readings: Mapping[str, FloatArray]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return x, l and u [mm] of a run's strips, NaN where a reading was left out."""
    x = run.problem.x * run.problem.width_mm + run.problem.origin_mm
    used = [
        np.where(out, np.nan, readings[name]) for name, out in zip(("kh", "kl"), run.excluded, strict=True)
    ]
    with np.errstate(divide="ignore", invalid="ignore"):
        return x, *closed_ends(sensor, used[0], used[1])


def _pieces_of(run: RunFit, sensor: Sensor, readings: Mapping[str, FloatArray], sigma: float) -> RunPieces:
    """Return the pieces that a run's readings hold, also those that no polygon of one object follows."""
    return split_run(sensor, *_read_ends(run, sensor, readings), sigma)


def _pair_of(run: RunFit, pieces: RunPieces, inward: tuple[list[float], list[float]]) -> Pair | None:
    """Return the two objects that may be taken for one concave one, of which corners turn inwards."""
    read = pieces.known
    x = run.problem.x[read]
    right = [np.searchsorted(x, corners).tolist() for corners in inward]
    every = sorted(i for at in right for i in at)
    if sum(after - before > 2 * _NEAR_CORNER for before, after in pairwise([-math.inf, *every])) > _EVENTS:
        return None
    strips = np.cumsum(read) - 1
    near = []
    for side, at in enumerate(right):
        close = {i + off for i in at for off in range(-_NEAR_CORNER, _NEAR_CORNER + 1)}
        close |= {int(strips[cut.strip]) for of, cut in pieces.cuts if of == side} | {1, len(x) - 1}
        near.append(sorted(i for i in close if 0 < i < len(x)))
    return likeliest_pair(pieces.ends, near, right, pieces.seen)


def _beside(run: RunFit, sensor: Sensor, readings: Mapping[str, FloatArray], sigma: float) -> Pair | None:
    """Return the two objects beside each other that one concave one may be, by all readings, also those left out."""
    ends, read = _ends(replace(run, excluded=np.zeros_like(run.excluded)), sensor, readings, sigma)
    assert run.selection is not None
    x = run.problem.x[read]
    right = [np.searchsorted(x, corners).tolist() for corners in inward_corners(run.selection.chosen)]
    out = np.flatnonzero(np.asarray(run.excluded.any(axis=0))[read]).tolist()
    return pair_beside(ends, right, out) if any(right) else None


def _pair_at_the_ends(
    run: RunFit, sensor: Sensor, readings: Mapping[str, FloatArray], sigma: float
) -> Pair | None:
    """Return the two objects that a convex outline may be, of which one reaches an outermost strip further."""
    return pair_at_the_ends(_ends(run, sensor, readings, sigma)[0])


def _ends(
    run: RunFit, sensor: Sensor, readings: Mapping[str, FloatArray], sigma: float
) -> tuple[Ends, BoolArray]:
    """Return what strips read that have both ends, and which these are (n,)."""
    x, l, u = _read_ends(run, sensor, readings)
    read = np.isfinite(l + u)
    x, l, u = x[read], l[read], u[read]
    noise = np.stack(end_deviations(sensor, l, u, sigma))
    return Ends(x, np.stack([l, u]), noise, sensor.pitch_mm), read


def _behind(cut: Cut, x: FloatArray) -> float:
    """Return how much of an outline [mm^2] may not be touched behind the overhang that a jump may be.

    The least that an opening as high as the jump leaves: a triangle to the run's other end.
    """
    return 0.5 * cut.rise * float(x[-1] - x[cut.strip] if cut.kind == "begins" else x[cut.strip - 1] - x[0])


def weakness(
    run: RunFit,
    model: OutlineModel,
    vertices: FloatArray,
    covariance: FloatArray,
    averaging: str = "average more scans",
    second: str = "use both signatures",
    noise_given: bool = False,
) -> str:
    """Return advice on what the readings leave open of an outline, else nothing.

    Parameters
    ----------
    run, model
        What was fitted to what, and what the outline is of.
    vertices, covariance
        Of the outline, counter-clockwise (V, 2) [mm], (2 V, 2 V) [mm^2].
    averaging
        What advice says of averaging scans, from `averaging_advice`; "" where that cannot help.
    second
        What it says of a second signature, from `signature_advice`.
    noise_given
        Whether the noise is known, not estimated.
    """
    if isinstance(model, Ellipse):
        return "this contact looks round: the outline is the ellipse that explains the readings better than corners"
    if isinstance(model, FamilyOutline):
        article = "an" if model.kind[0] in "aeiou" else "a"
        like = model.kind if model.kind == ROUNDED else f"like {article} {model.kind}"
        return (
            f"this contact looks {like}: the outline is the commonest of such that explain the readings; "
            "take the outline, not the vertices"
        )
    assert isinstance(model, PolygonFit)
    selection = run.selection
    if run.ellipse_advantage > _RIVAL:
        return "this contact looks round: an ellipse fits as well; take the outline, not the vertices"
    if selection is not None and selection.equal >= _EQUAL:
        why = (
            "the contact is round, or its number of vertices is open: take the outline, not the vertices. Or it is two "
            "objects on the same strips: then take neither"
            if noise_given
            else "the contact is round, or say what is known, the noise or the number of vertices; take the outline, "
            "not the vertices"
        )
        return f"{selection.equal} vertex counts fit equally well: {why}"
    x_sigma = np.sqrt(covariance.diagonal()[::2])
    at = int(np.argmax(x_sigma))
    if x_sigma[at] > _LOOSE * run.problem.width_mm:
        more = averaging if len(run.problem.k) > 1 else ", or ".join(filter(None, (averaging, second)))
        if x_sigma[at] > run.problem.width_mm:
            return (
                f"the readings do not tell where along its edges the vertex {_where(vertices[at])} lies; is it one? "
                f"Else {more}"
            )
        return f"the vertex {_where(vertices[at])} is uncertain by {x_sigma[at]:.3g} mm in x; {more}"
    if len(run.problem.k) == 1 and (pair := _opposite(vertices, covariance)) is not None:
        return (
            f"the corners {_where(vertices[pair[0]])} and y = {vertices[pair[1], 1]:.6g} mm hardly differ in x: their "
            f"kinks hide each other, and both heights may be wrong; turn the object a little, or {second}"
        )
    if len(run.problem.k) == 1 and (inward := _reflex(vertices, covariance)) is not None:
        return (
            f"the corner {_where(vertices[inward])} turns inwards, which one signature cannot tell from other shapes; "
            f"{second}"
        )
    return ""


def _where(vertex: FloatArray) -> str:
    return f"at x = {vertex[0]:.6g}, y = {vertex[1]:.6g} mm"


def _opposite(vertices: FloatArray, covariance: FloatArray) -> tuple[int, int] | None:
    """Return two corners, one on either chain, whose x cannot be told apart."""
    x = vertices[:, 0]
    right = int(x.argmax())
    for i in range(1, right):
        for j in range(right + 1, len(x)):
            variance = covariance[2 * i, 2 * i] + covariance[2 * j, 2 * j] - 2.0 * covariance[2 * i, 2 * j]
            if not abs(x[i] - x[j]) > _APART * math.sqrt(max(variance, 0.0)):
                return i, j
    return None


def _reflex(vertices: FloatArray, covariance: FloatArray) -> int | None:
    """Return the corner that turns inwards most surely, if one does."""
    n = len(vertices)
    edge = np.roll(vertices, -1, axis=0) - vertices
    before, after = np.roll(edge, 1, axis=0), edge
    turn = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    slope = np.zeros((n, n, 2))
    i = np.arange(n)
    by_before = np.stack([after[:, 1], -after[:, 0]], axis=1)
    by_after = np.stack([-before[:, 1], before[:, 0]], axis=1)
    slope[i, i - 1] -= by_before
    slope[i, i] += by_before - by_after
    slope[i, (i + 1) % n] += by_after
    flat = slope.reshape(n, -1)
    sigma = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", flat, np.nan_to_num(covariance), flat), 0.0))
    sure = turn < -_REFLEX * sigma
    return int(np.where(sure, turn, 0.0).argmin()) if sure.any() else None
