"""What is known of an object in the end, as a track with its status and advice."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.contact.noise import Noise
from tacstrip.errors import figures
from tacstrip.geometry.moments import area
from tacstrip.geometry.pose import placed
from tacstrip.reconstruction.result import Alternative, Status
from tacstrip.scan import Scan
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.spec import Sensor
from tacstrip.tracking.episodes import Episode
from tacstrip.tracking.objects import TOLD, Object, Readings, Skin
from tacstrip.tracking.result import Track
from tacstrip.tracking.rigid.corners import FIRST, Fit, explained, posed, reflex
from tacstrip.tracking.rigid.covariance import (
    covariances,
    following,
    information,
    poses_of_shape,
    shared_by_strips,
)
from tacstrip.tracking.rigid.curved import DISC, ROUNDED, RigidCurve
from tacstrip.tracking.rigid.found import content
from tacstrip.tracking.rigid.offsets import not_ruled_out, with_offsets
from tacstrip.tracking.rigid.posterior import over_all_poses
from tacstrip.tracking.rigid.rivals import (
    beside_rivals,
    notch_gain,
    poses_beside_rivals,
    with_a_corner_cut,
)
from tacstrip.tracking.rigid.search import FEW_STRIPS, LEAST_STRIPS, freer_spline
from tacstrip.tracking.rigid.strain import strain_gain
from tacstrip.tracking.rigid.unseen_corner import unread_tips_mm, unseen_corner_mm
from tacstrip.tracking.scan_noise import correlation_of_strips
from tacstrip.tracking.single_scans import SingleScans

_OF_SIZE = 0.01  # beside TOLD: of the outline's extent, and ...
_TELLING = 4.0  # ... deviations of the least certain corner: shapes that differ by more are not the same
_MAY_BE_OFF = 0.05  # of the extent, by which no corner may be off ...
DEVIATIONS = 2.0  # ... within so many deviations
# Squared errors of outlines with offsets over their covariance, as measured: so loose, their cost has small minima at
# kinks, of which the readings prefer none.
_KINKED = 1.2
_MISSED = 0.05  # probability of another outline, up to which a track is believed
_COUNTED = 0.05  # pitches, by which an outline of another count is off, for the count to matter
_OPEN = 9.0  # chi square, three deviations: what costs less beside a kink may be far more of what is likely
_UNREAD = 0.5  # pitches of a corner that no strip reads
_MOVED = 0.5  # pitches that corners must move where few strips are touched
_LEFT_OVER = (
    "a {kind} explains the readings best, and leaves {times} times their noise: is the noise larger than given, or "
    "the object hardly round?"
)
_NOT_RIGID = (
    "no rigid outline explains all scans: {times} times the noise is left over; {unit}the object deforms or rolls, two "
    "are taken for one, a channel is faulty (`tacstrip doctor`), or the noise is larger than given: read the scans one "
    "by one (`single`)"
)
_BENT = (
    "no rigid outline explains all scans: {times} times the noise is left over, and one that strains more and more "
    "explains most of it: {unit}the object deforms or rolls; read the scans one by one (`single`)"
)
_MANY_STRAYS, _NAMED = 0.05, 4  # of the readings: more make a track likely at best; how many are named
_STRAINED = 16.3  # chi square of three degrees of freedom, which noise exceeds in one of 1000 tracks
_STRAINS = (
    "a rigid outline explains the scans, but one that strains more and more explains them better, by {gain} in chi "
    "square: {unit}the object deforms or rolls; read the scans one by one (`single`)"
)
_FAR_OFF = 0.005  # of Vref
_UNCALIBRATED = (
    "channels seem off by up to {percent} % of Vref: calibrate the unit first (`tacstrip calibrate`); else "
)
_NOT_TOLD = (
    "the motion does not tell the shape: outlines that differ by {spread} mm explain all scans; turn the object, "
    "or slide it across the strips by more than half a pitch"
)
_OTHERS = "another outline explains the scans, too, and is right with {percent} % (`alternatives`)"
_COUNT = (
    "the number of corners is open: an outline of {n} explains the scans nearly as well; turn the object further, or "
    "take more scans"
)
_TIP = (
    "no scan reads the last {far} mm of a corner, which may be cut off: turn the object, or slide it across the "
    "strips by more than half a pitch"
)
_NOTCH = (
    "how deep a notch is, the scans do not tell: its corner may lie {far:.2g} mm further along an edge; turn the "
    "object further"
)
_UNSEEN = (
    "one corner more, by which the outline changes by up to {far} mm (`unseen_corner_mm`), would not show in the "
    "scans: turn the object further, or take more scans"
)
_HARDLY_MOVED = (
    "its corners stay over the same strips in all {n} scans, which so tell little more of the shape than one: turn the "
    "object further, or slide it across the strips by more than half a pitch"
)
_SMALL = (
    "most scans touch no more than two strips, which tell hardly more than where it lies: the outline is one of many; "
    "finer strips would tell it"
)
_LOOSE = (
    "the scans leave a corner uncertain by {far} mm (two standard deviations): {both}turn the object "
    "further, or slide it across the strips"
)
_CONCAVE = "the outline is concave: one object, or several that keep together"
_SMOOTH = (
    "one signature on few strips tells the shape only as far as the motion is smooth: corners and poses may be off by "
    "more than their regions say"
)
_NO_PATH = (
    "one signature on few strips, and no smooth motion explains the scans: the poses take up most of what the scans "
    "tell of the shape; read both signatures, or move the object smoothly"
)
_KINKS = (
    "the outline that explains the scans best needs poses that are hardly likely, at strips beside upright sides: this "
    "is the mean of those that are likely; turn the object, to be sure of it"
)
_CURVED = (
    "an outline of {n} corners stands for a curve, and with one signature on few strips a wrong motion may look like "
    "one: read both signatures"
)
_WANDERS = (
    "errors of channels follow each other from scan to scan: many scans are worth fewer, and a corner may be made of "
    "such errors; regions of the shape are {times} times as wide. Calibrate, or let the unit warm up"
)
_LOUDER = (
    "the readings are {times} times as noisy as given, from scan to scan and about a rigid outline alike: regions "
    "are of that noise"
)
_STRAYS = "{n} of {total} readings do not fit the others and were left out ({named}): run the doctor if that goes on"
_SHORT = "{n} scans show it, too few for a shape over time: the outline is that of the scan that tells most"
_LOOKS_ALIKE = "another that it shared strips with looks like it: after they parted each may be the other"


@dataclass(frozen=True, eq=False)
class _Estimate:
    """A rigid outline over time, in the frame in which its track tells it.

    corners (V, 2) [mm] about their mean, as the first scan shows them, and their covariance (2 V, 2 V) [mm^2]; poses
    (T, 3) and their covariances `spreads` (T, 3, 3) in all scans, NaN where it is not seen. fit: in its own frame, from
    which `middle` and `angle` lead here. `alone`: the covariance of the fit
    alone, in its frame; deviation: of channels' offsets [Vref] that are not ruled out. Times by which
    deviations are larger: `wider` for errors that hang together from scan to scan, `scale` for noise and kinks too.
    """

    fit: Fit
    corners: FloatArray
    covariance: FloatArray
    alone: FloatArray
    poses: FloatArray
    spreads: FloatArray
    middle: FloatArray
    angle: float
    deviation: float
    wider: float
    scale: float

    @property
    def loosest_mm(self) -> float:
        """The standard deviation of the least certain corner."""
        return math.sqrt(float(self.covariance.diagonal().reshape(-1, 2).sum(axis=1).max()))

    def loosest_beside_mm(self, one: Object, apart: list[int]) -> float:
        """Return the same without the rivals `apart`: two deviations of all would be those of none."""
        near = beside_rivals(one.scans, one.found.without(apart), self.alone, self.deviation)
        return self.scale * math.sqrt(float(near.diagonal().reshape(-1, 2).sum(axis=1).max()))

    @property
    def concave(self) -> bool:
        return bool(reflex(self.corners).any())


def summarised(one: Object, scans: list[Scan], read: Readings, noise: Noise | None) -> Track:
    """Return what is known of an object over time."""
    if one.curve is not None:
        return _curve_over_time(one, one.curve, len(scans), read)
    sensor, estimate = read.skin.sensor, _estimated(one, len(scans), read)
    fit, few = estimate.fit, one.scans.strips_touched < FEW_STRIPS
    refuted, rigid = _refuted(one, fit, read)
    alone = None
    if not rigid:
        alone = SingleScans(scans, dict(zip(one.shown, one.runs, strict=True)), sensor, noise)
    unsure, loosest = tolerated_mm(sensor, estimate.corners), estimate.loosest_mm
    size = float(np.ptp(estimate.corners, axis=0).max())
    apart = one.found.apart(max(TOLD * sensor.pitch_mm, _OF_SIZE * size, min(_TELLING * loosest, unsure)))
    odds = one.found.likely(apart)
    believed = odds <= _MISSED
    if apart and believed:
        loosest = estimate.loosest_beside_mm(one, apart)
    differ = "" if believed else _NOT_TOLD.format(spread=figures(one.found.spread_mm(apart)))
    advice = refuted or differ or _not_told(one, estimate)
    some, own = one.scans.of(one.found.chosen), fit.of(one.found.chosen)
    unseen = unseen_corner_mm(some, own, estimate.deviation, estimate.scale)
    loose = DEVIATIONS * loosest > unsure
    if not advice and not loose and not one.likely and (estimate.concave or few) and fit.basis is None:
        off, likely = over_all_poses(some, own)
        if likely and not one.shared:
            return summarised(one.with_likely(likely), scans, read, noise)
        loosest = max(loosest, off)
    if not advice:
        advice, one = _left_open(one, estimate, loosest, unsure)
    # scans that it shares strips in tell more, and are not among these
    hides = [_UNSEEN.format(far=figures(unseen.max()))] * bool(unseen.max() > unsure and not one.shared)
    rivals = [_OTHERS.format(percent=figures(100.0 * odds))] * bool(apart)
    notes = [] if advice else [*_notes(one, estimate, rivals), *hides]
    told = believed and bool(refuted or not advice)
    parted = bool(one.joint) and max(one.shown) > min(one.joint)
    more_advice = (
        [_LOOKS_ALIKE] if one.alike and parted and not one.shared else [m.advice for m in one.shared]
    )
    advice = "; ".join(dict.fromkeys(filter(None, [advice, *more_advice])))
    status, said = _judged(advice, notes, one, read)
    shown = apart if told else range(len(one.found.rivals))
    others = tuple(
        Alternative(float(weight), _turned(one.found.outlines[i] - estimate.middle, estimate.angle))
        for i, weight in zip(shown, one.found.weights(shown), strict=True)
    )
    joint = tuple(sorted({*one.joint, *(s for more in one.shared for s in more.joint)}))
    return Track(
        0, estimate.corners, estimate.covariance, estimate.poses, estimate.spreads, np.empty(0), np.empty(0),
        status, said, others, joint, _motion(fit), _offsets(one, read.skin), alone,
        unseen_corner_mm=unseen,
    )  # fmt: skip


def _estimated(one: Object, total: int, read: Readings) -> _Estimate:
    """Return the outline and its poses in all scans, with their covariances."""
    fit, skin = one.found.fit, read.skin
    if area(fit.corners) < 0.0:
        fit = replace(fit, corners=fit.corners[::-1])
    corners, first = fit.corners, int(np.argmin(one.shown))
    middle, angle = corners.mean(axis=0), float(fit.poses[first, 2])
    spin = _turned(np.eye(2), angle)
    equations = without = information(one.scans, corners, fit.poses)
    offsets = one.found.offsets
    deviation = offsets.upper if offsets else not_ruled_out(one.scans, fit)
    if deviation:
        equations = with_offsets(one.scans, fit, equations, deviation)
    shape, of_poses = covariances(equations, corners, fit.poses, freer_spline(fit.basis))
    if one.likely:
        by_offsets = shape - covariances(without, corners, fit.poses)[0] if deviation else 0.0
        shape = one.likely.covariance + by_offsets
        of_poses = poses_of_shape(without, shape, skin.sensor.pitch_mm)
    order = np.argsort(one.shown)
    wider = following(one.scans.of(order), corners, fit.poses[order])
    found_noise = one.noise_found(read.sigma) ** 2
    of_poses = poses_beside_rivals(one.scans, one.found, of_poses)
    of_poses = found_noise * (of_poses + _shared_by_strips(one, fit, order))
    kinked = _KINKED if offsets and fit.basis is None and one.scans.strips_touched < FEW_STRIPS else 1.0
    own_shape, scale = shape, wider * math.sqrt(found_noise * kinked)
    shape = found_noise * kinked * wider**2 * beside_rivals(one.scans, one.found, own_shape, deviation)
    all_spin = np.kron(np.eye(len(corners)), spin.T)
    shape = np.asarray(all_spin @ shape @ all_spin.T)
    poses, spreads = np.full((total, 3), np.nan), np.full((total, 3, 3), np.nan)
    poses[one.shown], spreads[one.shown] = _reframed(fit.poses, of_poses, middle, angle)
    for more in one.shared:
        poses[more.scans], spreads[more.scans] = _reframed(more.poses, more.covariances, middle, angle)
    poses[:, 0] += skin.span.start * skin.sensor.pitch_mm
    poses[:, 2] = less_than_half_turns(poses[:, 2])
    outline = _turned(corners - middle, angle)
    return _Estimate(fit, outline, shape, own_shape, poses, spreads, middle, angle, deviation, wider, scale)


def _refuted(one: Object, fit: Fit, read: Readings) -> tuple[str, bool]:
    """Return advice, or none, on an object of too few strips or one that deforms, and whether it is rigid."""
    sensor = read.skin.sensor
    rigid = bool(one.likely) or content(one.scans, fit, read.distribution)
    if one.scans.strips_touched < LEAST_STRIPS and not one.shared:
        return _SMALL, rigid
    if not rigid:
        times = math.sqrt(fit.cost / fit.freedom(one.scans))
        why = _BENT if one.found.strains else _NOT_RIGID
        return why.format(times=figures(times, 3), unit=_uncalibrated(one, sensor)), False
    if not one.likely and (gain := _strain_gain(one)) > _STRAINED:
        return _STRAINS.format(gain=figures(gain, 3), unit=_uncalibrated(one, sensor)), False
    return "", True


def _not_told(one: Object, estimate: _Estimate) -> str:
    """Return advice, or none, on motion that does not tell the shape."""
    fit, few = estimate.fit, one.scans.strips_touched < FEW_STRIPS
    if _hardly_moved(one, estimate.corners, estimate.poses[np.isfinite(estimate.poses[:, 0])]):
        return _HARDLY_MOVED.format(n=len(one.shown))
    if fit.basis is None and len(one.scans.read) == 1 and few:
        return _NO_PATH
    if fit.basis is not None and few and len(estimate.corners) >= FIRST:
        return _CURVED.format(n=len(estimate.corners))
    return ""


def _left_open(one: Object, estimate: _Estimate, loosest: float, unsure: float) -> tuple[str, Object]:
    """Return advice, or none, on what scans leave open of a shape, and the object with the rival that they leave.

    loosest: the standard deviation of its least certain corner [mm]; unsure: what is tolerated of two of them.
    """
    pitch_mm, few = one.scans.sensor.pitch_mm, one.scans.strips_touched < FEW_STRIPS
    some, own = one.scans.of(one.found.chosen), estimate.fit.of(one.found.chosen)
    if DEVIATIONS * loosest > unsure:
        return _loose(loosest, one), one
    if other := one.found.of_other_count(_COUNTED * pitch_mm):
        return _COUNT.format(n=other), one
    if estimate.concave and notch_gain(some, own, unsure) < _OPEN:
        return _NOTCH.format(far=unsure), one
    if few and not estimate.concave and (tip := unread_tips_mm(some, own).max()) > _UNREAD * pitch_mm:
        return _TIP.format(far=figures(tip)), one
    if cut := _with_a_corner_cut(one):
        return _COUNT.format(n=len(estimate.corners) + 1), cut
    return "", one


def _loose(loosest: float, one: Object) -> str:
    """Return advice on a corner of some standard deviation [mm]: a second signature helps where there is one only."""
    both = "read both signatures, " * (len(one.scans.read) < 2)
    return _LOOSE.format(far=figures(DEVIATIONS * loosest), both=both)


def _notes(one: Object, estimate: _Estimate, rivals: list[str]) -> list[str]:
    """Return what is to be known of a shape that nothing speaks against; `rivals`: that others may be right."""
    tied = estimate.fit.basis is not None and one.scans.strips_touched < FEW_STRIPS
    wander = [_WANDERS.format(times=figures(estimate.wider))] * (estimate.wider > 1.0)
    return [*[_CONCAVE] * estimate.concave, *[_SMOOTH] * tied, *[_KINKS] * bool(one.likely), *rivals, *wander]


def tolerated_mm(sensor: Sensor, outline: FloatArray) -> float:
    """Return by how much a corner may be uncertain [mm], at `DEVIATIONS`, for an outline not to be doubted."""
    return max(TOLD * sensor.pitch_mm, _MAY_BE_OFF * float(np.ptp(outline, axis=0).max()))


def _curve_over_time(one: Object, curve: RigidCurve, total: int, read: Readings) -> Track:
    """Return what is known of a curved object: a disc has no angle, and half a turn is none of an ellipse."""
    skin, order, fit = read.skin, np.argsort(one.shown), curve.fit
    found_noise = one.noise_found(read.sigma) ** 2
    shape, of_poses = curve.covariances(one.scans, one.found.offsets)
    shape, of_poses = found_noise * shape, found_noise * (of_poses + _shared_by_strips(one, fit, order))
    wider = following(one.scans.of(order), fit.corners, fit.poses[order])
    turns = fit.poses[order, 2]
    turns = (
        np.zeros(len(turns))
        if curve.kind == DISC
        else np.unwrap(turns, period=np.pi * (1 + (curve.kind == ROUNDED)))
    )
    middle, first, own = fit.corners.mean(axis=0), float(turns[0]), fit.poses.copy()
    own[order, 2] = turns
    poses, spreads = np.full((total, 3), np.nan), np.full((total, 3, 3), np.nan)
    poses[one.shown], spreads[one.shown] = _reframed(own, of_poses, middle, first)
    poses[:, 0] += skin.span.start * skin.sensor.pitch_mm
    outline = _turned(fit.corners - middle, first)
    spin = np.kron(np.eye(len(outline)), _turned(np.eye(2), first).T)
    shape = np.asarray(wider**2 * spin @ shape @ spin.T)
    loosest = math.sqrt(float(shape.diagonal().reshape(-1, 2).sum(axis=1).max()))
    unsure = tolerated_mm(skin.sensor, outline)
    advice = ""
    if one.scans.strips_touched < LEAST_STRIPS:
        advice = _SMALL
    elif not curve.explains(one.scans, read.distribution):
        times = math.sqrt(float(curve.costs.sum()) / curve.freedom(one.scans))
        advice = _LEFT_OVER.format(kind=curve.kind, times=figures(times, 3))
    elif DEVIATIONS * loosest > unsure:
        advice = _loose(loosest, one)
    elif _hardly_moved(one, outline, poses[np.isfinite(poses[:, 0])]):
        advice = _HARDLY_MOVED.format(n=len(one.shown))
    status, said = _judged(advice, [_WANDERS.format(times=figures(wider))] * (wider > 1.0), one, read)
    return Track(
        0, outline, shape, poses, spreads, np.empty(0), np.empty(0), status, said, (), tuple(one.joint),
        offsets=_offsets(one, skin), kind=curve.kind,
    )  # fmt: skip


def _shared_by_strips(one: Object, fit: Fit, order: IntArray) -> FloatArray:
    """Return what errors that neighbouring strips share add to the covariances of free poses (T, 3, 3)."""
    correlation = 0.0 if fit.basis is not None else correlation_of_strips(one.scans.k[order], one.left_over)
    if not correlation:
        return np.zeros((len(fit.poses), 3, 3))
    return shared_by_strips(one.scans, fit.corners, fit.poses, correlation)


def _judged(advice: str, notes: list[str], one: Object, read: Readings) -> tuple[Status, str]:
    """Return the status, and in words what makes it so, with readings that were set aside."""
    strays, many = _strays(one, read)
    louder = one.left_over / read.sigma if read.sigma and one.scans.sigma > read.sigma else 1.0
    said = [_LOUDER.format(times=figures(louder, 3))] * (louder > 1.0)
    note = "; ".join(filter(None, [*notes, *said, strays * many]))
    status: Status = "doubtful" if advice else "likely" if note else "ok"
    return status, "; ".join(filter(None, [advice or note, "" if many else strays]))


def _strays(one: Object, read: Readings) -> tuple[str, bool]:
    """Name the readings that were set aside with which no pose explains a scan; whether they are too many."""
    fit, skin = one.curve.fit if one.curve else one.found.fit, read.skin
    k = Episode(one.shown, one.runs).readings(read.k, skin.span)
    out = np.argwhere(np.isfinite(k) & ~np.isfinite(one.scans.k))
    if not len(out):
        return "", False
    scan, one_by_one, offsets = out[:, 0], one.scans.of(out[:, 0]), one.found.offsets
    one_by_one.k[np.arange(len(out)), out[:, 1], out[:, 2]] = (k - (offsets.values if offsets else 0.0))[
        *out.T
    ]
    put_back = posed(one_by_one, Fit(fit.corners, fit.poses[scan], fit.costs[scan]))
    out = out[~explained(put_back.costs, one_by_one.readings)]
    named = []
    for t, s, i in out:
        strip = (i + skin.span.start) % skin.sensor.strips + skin.sensor.strip_base
        named.append(f"scan {one.shown[t]}: {SIGNATURES[one.scans.names[s]].symbol} of strip {strip}")
    total = int(np.isfinite(k).sum())
    which = ", ".join(named[:_NAMED]) + ", ..." * (len(named) > _NAMED)
    words = _STRAYS.format(n=len(named), total=total, named=which) if named else ""
    return words, len(named) > _MANY_STRAYS * total


def _strain_gain(one: Object) -> float:
    chosen, fit = one.found.chosen, one.found.fit
    basis = None if fit.basis is None else fit.basis[chosen]
    some = Fit(fit.corners, fit.poses[chosen], fit.costs[chosen], basis)
    return strain_gain(one.scans.of(chosen), some, one.found.offsets, np.array(one.shown)[chosen])


def _with_a_corner_cut(one: Object) -> Object | None:
    """Return the object with the rival of which a corner is two, where few strips or one signature allow that."""
    fit, chosen = one.likely.best if one.likely else one.found.fit, one.found.chosen
    few = one.scans.strips_touched < FEW_STRIPS or len(one.scans.read) == 1
    part = fit.basis is not None and len(chosen) < len(fit.poses)
    shared = bool(one.shared)  # scans that it shares strips in have sharpened it, and are not among these
    if shared or not few or part or len(fit.corners) + 1 >= FIRST or reflex(fit.corners).any():
        return None
    some, fit = one.scans.of(chosen), fit if one.likely else fit.of(chosen)
    cut = with_a_corner_cut(some, fit, _COUNTED * some.sensor.pitch_mm)
    if cut is None:
        return None
    rival = (cut, cut.criterion(some) - fit.criterion(some))
    return replace(one, found=replace(one.found, rivals=(*one.found.rivals, rival)))


def _reframed(
    poses: FloatArray, spreads: FloatArray, middle: FloatArray, angle: float
) -> tuple[FloatArray, FloatArray]:
    """Return poses (M, 3) and their covariances of a frame about a point of the old one, turned."""
    where = np.array([placed(middle[None], p)[0] for p in poses]).reshape(-1, 2)
    by = np.tile(np.eye(3), (len(poses), 1, 1))
    by[:, 0, 2], by[:, 1, 2] = poses[:, 1] - where[:, 1], where[:, 0] - poses[:, 0]
    moved = np.column_stack([where, poses[:, 2] - angle])
    return moved, np.asarray(by @ spreads @ by.transpose(0, 2, 1))


def _hardly_moved(one: Object, outline: FloatArray, poses: FloatArray) -> bool:
    """Whether few strips read the outline at always the same places."""
    x = np.stack([placed(outline, pose)[:, 0] for pose in poses])
    few = one.scans.strips_touched < FEW_STRIPS
    return bool(few and np.median(np.ptp(x, axis=0)) < _MOVED * one.scans.sensor.pitch_mm)


def _motion(fit: Fit) -> str:
    """Say what is taken for granted of the motion."""
    if fit.basis is None:
        return "free"
    return (
        f"smooth: x, y and angle are cubic splines of {fit.basis.shape[1]} knots over {len(fit.poses)} scans"
    )


def _uncalibrated(one: Object, sensor: Sensor) -> str:
    """Say that an uncalibrated unit's channels are off by so much that it is to be calibrated before all else."""
    offsets = one.found.offsets
    most = 0.0 if offsets is None or sensor.calibration is not None else float(np.abs(offsets.values).max())
    return _UNCALIBRATED.format(percent=figures(100.0 * most)) if most > _FAR_OFF else ""


def _offsets(one: Object, skin: Skin) -> dict[str, FloatArray]:
    """Return the offsets of the sensor's channels by signature, where there are any."""
    if one.found.offsets is None:
        return {}
    found = {}
    own = np.arange(skin.span.start, skin.span.stop) % skin.sensor.strips
    for name, values in zip(one.scans.names, one.found.offsets.values, strict=True):
        found[name] = np.zeros(skin.sensor.strips)
        np.add.at(found[name], own, values)
    return found


def of_one_scan(one: Episode, scans: list[Scan], sensor: Sensor, noise: Noise | None) -> Track:
    """Return the track of an object that too few scans show: the shape of the one in which it touches most strips."""
    widest = max(range(len(one.scans)), key=lambda i: one.runs[i].stop - one.runs[i].start)
    alone = SingleScans(scans, dict(zip(one.scans, one.runs, strict=True)), sensor, noise)
    shape = alone[one.scans[widest]]
    assert shape is not None
    poses, spreads = np.full((len(scans), 3), np.nan), np.full((len(scans), 3, 3), np.nan)
    outline = shape.vertices
    if len(outline):
        middle = outline.mean(axis=0)
        outline, poses[one.scans[widest]] = outline - middle, (*middle, 0.0)
    advice = "; ".join(filter(None, [_SHORT.format(n=len(one.scans)), shape.advice]))
    return Track(
        0, outline, shape.covariance, poses, spreads, np.empty(0), np.empty(0), shape.status, advice,
        shape.alternatives, tuple(one.joint), by_scan=alone,
    )  # fmt: skip


def less_than_half_turns(angles: FloatArray) -> FloatArray:
    """Return angles (T,) [rad], NaN where absent, that go on by less than half a turn from one scan to the next."""
    found, present = angles.copy(), np.isfinite(angles)
    found[present] = np.unwrap(angles[present])
    return found


def _turned(corners: FloatArray, angle: float) -> FloatArray:
    return placed(corners, np.array([0.0, 0.0, angle]))
