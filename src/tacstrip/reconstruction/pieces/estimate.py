"""How many convex pieces touch the strips, at least, and what one scan shows of each."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product

import numpy as np

from tacstrip.arguments import takes
from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.contact.noise import Noise
from tacstrip.core.convex_overlap import convex_overlap
from tacstrip.geometry.moments import area
from tacstrip.geometry.region import outline_paths
from tacstrip.notebook import Drawn, SvgPath
from tacstrip.reconstruction.contact_ends import closed_ends
from tacstrip.reconstruction.implausible import goes_on, implausible_hint
from tacstrip.reconstruction.noise_covariance import Averaging, fit_sigma
from tacstrip.reconstruction.on_surface import refuse_surface
from tacstrip.reconstruction.pieces.bounds import Bounds, piece_bounds
from tacstrip.reconstruction.pieces.cover import Part
from tacstrip.reconstruction.pieces.outline import PieceOutline, shown_hull, trace
from tacstrip.reconstruction.pieces.run import FEW_STRIPS, GAP, LEAST_SIGMA, RunPieces, noise_level, split_run
from tacstrip.reconstruction.polygon.faulty_channel import MOST_STRIPS
from tacstrip.reconstruction.polygon.status import two_objects
from tacstrip.reconstruction.polygon.unknown_noise import ONE, log_probability
from tacstrip.reconstruction.posterior.assessment import ENOUGH, PROMISED_IOU
from tacstrip.reconstruction.result import Alternative, Reconstruction, RecoveredObject, Status
from tacstrip.reconstruction.seam import BRIDGED
from tacstrip.scan import Scan
from tacstrip.sensor.constructions import check_closed_form
from tacstrip.sensor.left_out import left_out_wholly
from tacstrip.sensor.spec import Sensor

_FEW = 3  # strips: fewer show no shape
_STEP = 0.7  # from one noise by which pieces are looked for to the next
_WEAK = 30.0  # of chi square: a cut by which the fit gains less may be chance
_NO_AREA = 1e-9  # mm2
_OVERLAP = 0.05  # of the smaller of two hulls
_ALIKE = 0.8  # of the mean absolute error over its deviation, of a normal error
_SHOWN = 5  # strips that advice names


@dataclass(frozen=True, eq=False)
class Piece(Drawn):
    """A convex piece of what touches the sensor, as far as one scan shows it.

    Attributes
    ----------
    outline
        Corners (N, 2) [mm], counter-clockwise. Where another piece hides it, halfway between `smallest` and `largest`.
    hidden
        Which corners the readings do not show (N,).
    strips
        On which it is seen or must be, a slice of the scan.
    status
        "ok": it is seen whole, of an IoU of .8 or more; "likely": parts are hidden, behind which there may be more, or
        the strips are few; "doubtful": read the advice. Of one that shares strips "ok" and "likely" say, too, that
        `outline` overlaps `smallest` and `largest` by an IoU of .8 on average.
    advice
        In words.
    covariance
        Of `outline.ravel()` (2N, 2N) [mm^2], NaN where hidden; None from one signature.
    smallest, largest
        Outlines (M, 2) [mm] between which the piece lies, where these are all the pieces. It holds the ends that are
        surely its own, wherever the readings would allow the cuts, `smallest`; empty where none is. Every place that a
        convex piece could reach, without a contradiction of 3 deviations to a reading or to what other pieces surely
        hold, is in `largest`. That need not be convex: no piece reaches all of these places.
    joined
        Indices of the pieces that this one may be one concave object with.
    hidden_edges
        Which edges, from each corner to the next one, the readings do not show (N,).
    alternatives
        Two objects that a single piece may be instead, with their probability.

    Examples
    --------
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-crs", strips=100, pitch_mm=1.0, length_mm=100.0)
    >>> contact = ts.Contact.from_wkt("MULTIPOLYGON (((20 20, 60 10, 55 35, 20 20)), ((40 50, 85 60, 45 80, 40 50)))")
    >>> low, high = ts.pieces(ts.simulate(sensor, contact), sensor)
    >>> high.outline[~high.hidden].round(0).tolist()
    [[40.0, 50.0], [85.0, 60.0], [45.0, 80.0]]
    """

    outline: FloatArray
    hidden: BoolArray
    strips: slice
    status: Status
    advice: str
    covariance: FloatArray | None
    smallest: FloatArray
    largest: FloatArray
    joined: tuple[int, ...] = ()
    hidden_edges: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    alternatives: tuple[Alternative, ...] = ()

    def __repr__(self) -> str:
        seen = f"{int((~self.hidden).sum())} corners seen, {int(self.hidden.sum())} hidden"
        return f"<Piece: {self.status}, {seen}, strips {self.strips.start} to {self.strips.stop - 1}>"

    def _paths(self) -> list[SvgPath]:
        return outline_paths([(self.outline, None)])


@takes(scan=Scan, sensor=Sensor, noise=Noise)
def pieces(scan: Scan, sensor: Sensor, noise: Noise | None = None) -> list[Piece]:
    """Return the convex pieces, the fewest that explain one scan, with what the readings show of each.

    A strip reads the hull of all that touches it, [min l, max u]. Where several objects share strips, l and u jump
    where one begins or ends; between jumps both are convex. So at least as many convex pieces touch as are needed for
    that. There may be more: nothing tells of an object that is hidden on all of its strips, of holes, nor of a gap
    between bars that begin and end together. A concave object reads as several convex ones do.

    Parameters
    ----------
    scan, sensor
        What was measured, with what. With k_h and k_l strips are looked at one by one. With one signature only
        separate runs of strips are separate pieces, and jumps are doubts.
    noise
        Of the readings; None: the spec's, else estimated from the scan.

    Returns
    -------
    list of Piece
        From left to right; empty without contact.

    Raises
    ------
    ReadingError, OptionError
        The scan is not of this sensor, or the construction has no closed form.

    Examples
    --------
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-crs", strips=100, pitch_mm=1.0, length_mm=100.0)
    >>> contact = ts.Contact.from_wkt("MULTIPOLYGON (((20 20, 60 10, 55 35, 20 20)), ((40 50, 85 60, 45 80, 40 50)))")
    >>> noise = ts.Noise(positional=0.002)
    >>> [(p.strips.start, p.hidden.any().item()) for p in ts.pieces(ts.simulate(sensor, contact, noise, rng=1), sensor)]
    [(20, True), (40, True)]
    """
    scan = scan.checked(sensor)
    check_closed_form(sensor.kind, "pieces")
    refuse_surface(sensor, "pieces", 'take the method "polygon"')
    if len(scan.signatures) == 1:
        from tacstrip.reconstruction.pieces.one_signature import pieces_of_runs  # late: it fits polygons

        return pieces_of_runs(scan, sensor, noise)
    noise = sensor.noise if noise is None else noise
    found: list[Piece] = []
    for strips, run in _runs(scan, sensor, noise):
        found += _of_run(run, sensor, strips, len(found))
    hint = implausible_hint(
        scan, sensor, any(p.status == "doubtful" for p in found), [p.outline for p in found]
    )
    told = [(p, goes_on(p.outline, p.strips, sensor)) for p in found]
    return [
        replace(p, status="doubtful", advice="; ".join(filter(None, (p.advice, beside, hint))))
        if beside or hint
        else p
        for p, beside in told
    ]


def _runs(scan: Scan, sensor: Sensor, noise: Noise | None) -> list[tuple[slice, RunPieces]]:
    """Return the runs of touched strips and their pieces; where strips are left out, or may be broken, it goes on."""
    found: list[tuple[slice, RunPieces]] = []
    named = left_out_wholly(sensor)
    for strips in scan.runs():
        run = _split(scan, sensor, strips, noise)
        if found and strips.start - found[-1][0].stop <= BRIDGED:
            whole = slice(found[-1][0].start, strips.stop)
            joint = _split(scan, sensor, whole, noise)
            if named[found[-1][0].stop : strips.start].all() or (joint.count == 1 and joint.explains):
                strips, run = whole, joint
                found.pop()
        found.append((strips, run))
    return found


def _split(scan: Scan, sensor: Sensor, strips: slice, noise: Noise | None) -> RunPieces:
    kh, kl = scan["kh"][strips], scan["kl"][strips]
    averaging = Averaging.of(scan)
    sigma = noise_level(np.stack([kh, kl]), sensor) if noise is None else fit_sigma(noise, sensor, averaging)
    with np.errstate(divide="ignore", invalid="ignore"):
        l, u = closed_ends(sensor, kh, kl)
    run = split_run(sensor, sensor.x_mm[strips], l, u, sigma)
    if noise is None and run.count == 1 and len(kh) <= MOST_STRIPS:
        return _less_noise(run, sigma, partial(split_run, sensor, sensor.x_mm[strips], l, u), sensor.adc_step)
    return run


def _less_noise(run: RunPieces, sigma: float, split: Callable[[float], RunPieces], step: float) -> RunPieces:
    """Return a run's pieces by less noise where they are likelier: jumps between few strips pass for noise.

    `run` is one piece by noise of `sigma` [Vref], which nobody gave; `split` what it is by another one; `step` of the
    converter.
    """
    least = max(LEAST_SIGMA, step / math.sqrt(12.0))

    def likely(found: RunPieces, at: float) -> float:
        chi_square, n, numbers = found.left_over
        return log_probability(chi_square * at**2, max(n - numbers, 1), numbers, least)[1]

    best, at = (run, likely(run, sigma) + math.log(ONE)), _STEP * sigma
    while at >= least:
        found = split(at)
        _, n, numbers = found.left_over
        if numbers >= n:  # so many lines explain readings of any noise
            break
        best, at = max(best, (found, likely(found, at)), key=lambda each: each[1]), _STEP * at
    return best[0]


def _of_run(run: RunPieces, sensor: Sensor, strips: slice, before: int) -> list[Piece]:
    """Return the pieces of a run, `before` others being to its left."""
    parts = run.cover.parts
    groups = sorted(
        ([parts[i] for i in piece] for piece in run.cover.pieces),
        key=lambda group: min((p.stretch.start, p.side) for p in group),
    )
    hulls = [shown_hull(group, run.read) for group in groups]
    every = piece_bounds(groups, run.chains, run.read, sensor.pitch_mm, sensor.length_mm)
    alternatives = () if run.pair is None else (run.pair.alternative,)
    found = []
    for i, (group, bounds) in enumerate(zip(groups, every, strict=True)):
        traced = trace(group, run.read, hulls[:i] + hulls[i + 1 :], sensor.pitch_mm)
        start = min(p.stretch.start for p in group) + strips.start
        stop = max(p.stretch.stop for p in group) + strips.start
        others = tuple(
            before + j
            for j, other in enumerate(groups)
            if j != i and (not run.apart or _meet(group, other, GAP * sensor.length_mm))
        )
        crossed = run.apart and any(_overlap(hulls[i], h) > _OVERLAP for j, h in enumerate(hulls) if j != i)
        status, advice = _verdict(run, traced, bounds, sensor, strips, crossed)
        found.append(
            Piece(
                traced.vertices, traced.hidden, slice(start, stop), status, advice, traced.covariance, bounds.smallest,
                bounds.largest, others, traced.hidden_edges, alternatives,
            )
        )  # fmt: skip
    return found


def _meet(group: list[Part], other: list[Part], least: float) -> bool:
    """Whether two pieces meet in an inward corner that hides no gap."""
    return any(
        a.side == b.side
        and a.stretch.after is not None
        and a.stretch.after is b.stretch.before
        and a.stretch.after.kind == "corner"
        and a.stretch.after.rise < least
        for a, b in [*product(group, other), *product(other, group)]
    )


def _verdict(
    run: RunPieces, traced: PieceOutline, bounds: Bounds, sensor: Sensor, strips: slice, crossed: bool
) -> tuple[Status, str]:
    """Return status and advice of a piece."""
    n, count = len(run.read.x), run.count
    base = strips.start + sensor.strip_base
    doubts, notes = [], []
    if count > 1:
        kind = "or a concave object, which reads the same" if run.apart else "which meet: one concave object"
        more = "; more may lie hidden behind these" if run.apart else ""
        notes.append(f"at least {count} convex pieces on strips {base} to {base + n - 1}, {kind}{more}")
    if n < _FEW:
        doubts.append(
            f"{n} strip{'s are' if n > 1 else ' is'} touched, too few for a shape: use finer strips"
        )
    if not run.explains:
        doubts.append(
            "the noise does not explain what these pieces leave over of the readings: is it larger than given?"
        )
    if run.cover.fewest is not None:
        doubts.append(
            "the ends jump so often that it was not found out what belongs together: is the noise larger than given?"
        )
    left_out = np.flatnonzero(run.chains[0].left_out | run.chains[1].left_out)
    if len(left_out):
        named = ", ".join(str(i + base) for i in left_out[:_SHOWN]) + (
            ", ..." if len(left_out) > _SHOWN else ""
        )
        doubts.append(
            f"strip {named} fits none of its neighbours: a faulty channel, or a piece on that strip alone"
        )
    weak = [cut for _, cut in run.cuts if cut.gain < _WEAK]
    if weak:
        at = weak[0].strip + base
        doubts.append(f"the cut between strips {at - 1} and {at} hardly shows in the noise: average scans")
    if run.may_be_two:
        doubts.append(
            "two objects, of which the outer strips show one alone, read the same: a second layer, or scans while it "
            "moves, would tell"
        )
    if run.cover.others:
        doubts.append("what is shown can be paired to as many pieces in another way")
    if run.pair is not None:
        right = run.pair.overlap(traced.vertices) >= PROMISED_IOU
        doubt, note = two_objects(run.pair, right, 1.0, ENOUGH)
        doubts += [doubt] if doubt else []
        notes += [note] if note else []
    if crossed:
        doubts.append("what is seen of the pieces overlaps: there are more, or one concave object")
    if (off := _error(run, traced, sensor)) > 1.0 - PROMISED_IOU:
        doubts.append(f"noise and strips leave about {100.0 * off:.0f} % of its area open: use finer strips")
    if traced.hidden.any():
        notes.append(
            f"{int(traced.hidden.sum())} of its {len(traced.hidden)} corners are hidden behind other pieces"
        )
    if count > 1:
        own, least, both = convex_overlap(traced.vertices, bounds.smallest)
        _, most, shared = convex_overlap(traced.vertices, bounds.largest)
        notes.append(
            f"its smallest and largest outline overlap by an IoU of {least / max(most, _NO_AREA):.2f}"
        )
        # Of a piece that is a line nothing is known.
        overlaps = both / max(own + least - both, _NO_AREA), shared / max(own + most - shared, _NO_AREA)
        if 0.5 * sum(overlaps) < PROMISED_IOU:
            doubts.append(
                "between the two its shape is open: a second layer, or scans while it moves, would tell"
            )
    status: Status = "doubtful" if doubts else "likely" if traced.hidden.any() or n < FEW_STRIPS else "ok"
    return status, "; ".join([*notes, *doubts])


def _overlap(a: FloatArray, b: FloatArray) -> float:
    """Return how much two hulls, lower and upper ends (2, n), share, over the smaller one."""
    shared = np.minimum(a[1], b[1]) - np.maximum(a[0], b[0])
    if not (shared > 0.0).any():
        return 0.0
    sizes = [float(np.nansum(hull[1] - hull[0])) for hull in (a, b)]
    return float(np.nansum(np.maximum(shared, 0.0))) / max(min(sizes), 1e-300)


def _error(run: RunPieces, traced: PieceOutline, sensor: Sensor) -> float:
    """Return the share of a piece's area that noise, and ends between two strips, leave open on average."""
    size = abs(area(traced.vertices))
    if not size > 0.0:
        return 1.0
    width = float(np.ptp(traced.vertices[:, 0]))
    return float(_ALIKE * run.open_mm * width / size + 0.5 * sensor.pitch_mm / width)


@takes(scan=Scan, sensor=Sensor, noise=Noise)
def piece_reconstruction(scan: Scan, sensor: Sensor, noise: Noise | None = None) -> Reconstruction:
    """Return `pieces` as the objects of a reconstruction, the method "pieces"; arguments and errors as there."""
    objects = tuple(
        RecoveredObject(
            p.strips,
            p.outline,
            covariance=p.covariance,
            status=p.status,
            advice=p.advice,
            alternatives=p.alternatives,
            hidden=p.hidden,
            hidden_edges=p.hidden_edges,
            bounds=(p.smallest, p.largest) if p.hidden.any() and len(p.smallest) else None,
        )
        for p in pieces(scan, sensor, noise)
    )
    return Reconstruction("pieces", objects, scan.time_s)
