"""The search for the shape of a contact of which scans come one by one: off the way of the scans, in any executor."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.core.rigid import fit_poses, loss
from tacstrip.geometry.pose import placed
from tacstrip.reconstruction.result import Alternative, Status
from tacstrip.scan import Scan
from tacstrip.sensor.left_out import left_out_wholly
from tacstrip.sensor.spec import Sensor
from tacstrip.tracking.episodes import Episode
from tacstrip.tracking.objects import Readings, Skin
from tacstrip.tracking.rigid.corners import Fit
from tacstrip.tracking.rigid.fixed_lag import FixedLag
from tacstrip.tracking.rigid.found import content
from tacstrip.tracking.rigid.recognition import recognised
from tacstrip.tracking.stretches import searched
from tacstrip.tracking.summary import summarised

_COMPARED = 24  # scans of a known object, and of a contact, that tell whether it is the same
_MOVED = 2.0  # standard deviations that readings must vary by, over time


@dataclass(frozen=True, eq=False)
class KnownShape:
    """A shape that was tracked before.

    Attributes
    ----------
    id
        Its number.
    lag
        What is known of it.
    k, poses
        Scans that showed it (T, S, n), and its poses there (T, 3).
    status, advice, alternatives
        As of the search that found it.
    explains
        Whether it explains the scans.
    again
        Whether it is one that was known before.
    """

    id: int
    lag: FixedLag
    k: FloatArray
    poses: FloatArray
    status: Status
    advice: str = ""
    alternatives: tuple[Alternative, ...] = ()
    explains: bool = True
    again: bool = False


@dataclass(frozen=True, eq=False)
class Contact:
    """What is known of a contact.

    Attributes
    ----------
    id
        Its number.
    sensor, names, k
        Its scans (T, S, n), in the order of time.
    sigma, distribution
        Of the readings; None: not known.
    lag
        How many scans keep free poses.
    angle
        That the outline has in the last scan [rad]; NaN: none yet.
    known
        Objects that it may be.
    """

    id: int
    sensor: Sensor
    names: tuple[str, ...]
    k: FloatArray
    sigma: float | None
    distribution: str
    lag: int
    angle: float
    known: tuple[KnownShape, ...]


def moved(k: FloatArray, sigma: float) -> bool:
    """Whether the readings (T, S, n) of a contact vary by more than noise does."""
    there = np.isfinite(k)
    always = there.all(axis=0)
    if (there.any(axis=0) != always).any() or not always.any():
        return True
    return bool(k[:, always].var(axis=0).mean() > (_MOVED * sigma) ** 2)


def find_shape(contact: Contact) -> KnownShape | None:
    """Return a known object where the contact is one, else what a search finds; None where its scans are too few."""
    for known in contact.known:
        if (found := _recognised(known, contact)) is not None:
            return found
    total = len(contact.k)
    whole = Episode(list(range(total)), [slice(0, contact.sensor.strips)] * total)
    skin = Skin(contact.sensor, slice(0, contact.sensor.strips), left_out_wholly(contact.sensor))
    # The scans to come have what channels are off, too: the shape must explain them as they are.
    read = Readings(contact.k, skin, contact.names, contact.sigma, contact.distribution)
    one = searched(whole, read, offsets=False)
    if one is None:
        return None
    scans = [Scan(**dict(zip(contact.names, row, strict=True))) for row in contact.k]
    track = summarised(one, scans, read, None)
    turn = 0.0 if np.isnan(contact.angle) else float(track.poses[-1, 2] - contact.angle)
    frame = np.array([0.0, 0.0, turn])
    lag = FixedLag(
        contact.sensor,
        contact.names,
        one.scans.sigma * one.noise_found(contact.sigma),
        placed(track.outline, frame),
        contact.lag,
        contact.distribution,
    )
    poses = track.poses - frame
    lag.begin(contact.k, poses)
    if track.covariance is not None:
        spin = np.kron(np.eye(len(track.outline)), placed(np.eye(2), frame).T)
        lag.widen(np.asarray(spin @ track.covariance @ spin.T))
    others = tuple(replace(a, vertices=placed(a.vertices, frame)) for a in track.alternatives)
    explains = content(one.scans, one.found.fit, contact.distribution)
    return KnownShape(contact.id, lag, contact.k, poses, track.status, track.advice, others, explains)


def _recognised(known: KnownShape, contact: Contact) -> KnownShape | None:
    """Return the known object with the contact's scans too, where its shape explains them; else None."""
    lag = copy(known.lag)
    before, now = (_spread(len(k)) for k in (known.k, contact.k))
    scans, more = lag.of(known.k[before]), lag.of(contact.k[now])
    poses, costs = fit_poses(scans, lag.corners, known.poses[before][:, None], loss(scans))
    fit = Fit(lag.corners, poses[:, 0], costs[:, 0])
    together = recognised(scans, fit, more, contact.distribution)
    if together is None or together.corners.shape != lag.corners.shape:  # another shape explains both
        return None
    # The joint fit has a frame of its own: its poses become those of the shape as it was known.
    own, theirs = lag.corners.mean(axis=0), together.corners.mean(axis=0)
    turned = ((together.corners - theirs) @ [1, -1j]) * ((lag.corners - own) @ [1, 1j])
    start = together.poses[-len(now) :] - (0.0, 0.0, float(np.angle(turned.sum())))
    for row, pose in zip(start, together.poses[-len(now) :], strict=True):
        row[:2] = placed(theirs[None], pose)[0] - placed(own[None], np.array([0.0, 0.0, row[2]]))[0]
    start = fit_poses(more, lag.corners, start[:, None], loss(more))[0][:, 0]
    lag.begin(more.k, start)
    k, poses = np.concatenate([known.k, more.k]), np.concatenate([known.poses, start])
    return replace(known, lag=lag, k=k, poses=poses, again=True)


def _spread(count: int) -> IntArray:
    """Return some of so many scans, evenly."""
    return np.unique(np.linspace(0, count - 1, min(count, _COMPARED)).astype(int))
