"""How sure an outline's corners and its poses are: the bound that all scans together leave."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.contact.shape import Contact
from tacstrip.core.rigid import Equations, RigidScans, equations, linearised_blocks, loss, reduced
from tacstrip.errors import ContactError
from tacstrip.sensor.spec import Sensor
from tacstrip.simulation import simulate

FREE = 12.0  # pitches^-2: what strips that touch tell of a pose anywhere within a gap between them
UPRIGHT = 300.0  # slope of an edge that counts as upright
# Deviations of what neighbouring scans leave over alike; scans that are looked back.
_FOLLOWING, _LAGS = 3.0, 20
NEVER = 1e6  # pitches: what touched strips tell of the ends is left out, for inside the gap it is nothing


def covariances(
    found: Equations,
    corners: FloatArray,
    poses: FloatArray,
    basis: FloatArray | None = None,
    beside: FloatArray | float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Return the covariance of corners (N, 2) about their mean, (2 N, 2 N) [mm^2], and of the poses (T, 3, 3).

    The frame lies where the corners' errors neither move nor turn them as a whole; the poses take that up. With a
    basis (T, K) the poses are a spline. The equations may have offsets of channels after the corners. `beside`
    (2 N, 2 N) is what else is known of the corners, of their shape alone.
    """
    matrix, _, inverse, follow = without_poses(found, basis)
    size = corners.size
    of_offsets = np.linalg.inv(matrix[size:, size:])  # were the corners known
    along = np.vstack(
        [np.eye(size), -of_offsets @ matrix[size:, :size]]
    )  # how corners and offsets follow the corners
    value, vector = np.linalg.eigh(matrix[:size] @ along + beside)
    anywhere = float(np.ptp(corners, axis=0).max()) ** 2  # what the readings do not hold at all
    pinned = vector / np.maximum(value, 1.0 / anywhere) @ vector.T
    rigid = rigid_motions(corners)
    as_motion = np.linalg.pinv(rigid)  # (3, 2 N): of a change of the corners
    inner, whole = np.eye(size) - rigid @ as_motion, np.zeros((3, len(matrix)))
    whole[:, :size] = as_motion
    turned = np.zeros((len(poses), 3, 3))
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    turned[:, 0, 0], turned[:, 0, 1], turned[:, 1, 0], turned[:, 1, 1], turned[:, 2, 2] = (
        cos,
        -sin,
        sin,
        cos,
        1.0,
    )
    by_both = turned @ whole - follow
    by_corners, by_offsets = by_both @ along, by_both[..., size:]
    of_poses = inverse + by_corners @ pinned @ by_corners.transpose(0, 2, 1)
    of_poses += by_offsets @ of_offsets @ by_offsets.transpose(0, 2, 1)
    return np.asarray(inner @ pinned @ inner.T), np.asarray(of_poses)


def poses_of_shape(found: Equations, shape: FloatArray, pitch_mm: float) -> FloatArray:
    """Return the covariances (T, 3, 3) of free poses that follow corners whose covariance is given (2 N, 2 N).

    Where the readings leave x free, the outermost corners still lie anywhere within the gaps that end at strips they
    do not touch.
    """
    pose = found.pose.copy()
    pose[:, 0, 0] += FREE / pitch_mm**2
    _, _, inverse = reduced(replace(found, pose=pose), pinned=0.0)  # the corners' own frame, fixed to no scan
    follow = inverse @ found.mixed
    return np.asarray(inverse + follow @ shape @ follow.transpose(0, 2, 1))


def information(scans: RigidScans, corners: FloatArray, poses: FloatArray) -> Equations:
    """Return the equations that `covariances` are of: without the ends, for inside a gap they tell nothing.

    And without readings where an upright edge passes their strip: no straight line through them holds for long.
    """
    how = loss(scans, end=NEVER)
    found = equations(scans, corners, poses, how)
    steepest = UPRIGHT / scans.sensor.length_mm
    if (found.pose[:, 0, 0] > (steepest / scans.sigma) ** 2).any():
        k = scans.k.copy()
        for some, part, here in linearised_blocks(scans, corners, poses):
            k[some] = np.where(np.abs(here.rows[..., 0]) > steepest, np.nan, part.k)
        found = equations(replace(scans, k=k), corners, poses, how)
    return found


def of_numbers(found: Equations, by: FloatArray) -> Equations:
    """Return the equations of numbers that the corners follow, `by` (2 N, P), in place of those of the corners.

    Offsets of channels after the corners stay.
    """
    size, numbers = by.shape
    linear = np.zeros((len(found.shape), len(found.shape) - size + numbers))
    linear[:size, :numbers], linear[size:, numbers:] = by, np.eye(len(found.shape) - size)
    return replace(
        found,
        mixed=found.mixed @ linear,
        shape=linear.T @ found.shape @ linear,
        shape_slope=linear.T @ found.shape_slope,
    )


def without_poses(
    found: Equations, basis: FloatArray | None, damping: float = 0.0
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the corners' equations without the poses, which are a spline where there is a basis (T, K).

    Returns
    -------
    tuple
        Matrix and slope, the poses' covariance (T, 3, 3) were the corners known, and how the poses follow the corners
        (T, 3, 2 N).
    """
    if basis is None:
        matrix, slope, inverse = reduced(found, damping)
        return matrix, slope, inverse, inverse @ found.mixed
    many, knots = basis.shape
    own = np.einsum("tk,tij,tl->kilj", basis, found.pose, basis, optimize=True).reshape(3 * knots, -1)
    own = np.linalg.inv(own + damping * np.diag(own.diagonal()) + 1e-9 * np.eye(len(own)))
    mixed = (basis.T @ found.mixed.reshape(many, -1)).reshape(3 * knots, -1)
    by = np.einsum("tk,ij->tikj", basis, np.eye(3)).reshape(many, 3, -1)  # of poses by knots
    slope = found.shape_slope - mixed.T @ own @ (basis.T @ found.pose_slope).ravel()
    matrix = found.shape - mixed.T @ own @ mixed + damping * np.diag(found.shape.diagonal())
    return matrix, slope, np.asarray(by @ own @ by.transpose(0, 2, 1)), np.asarray(by @ (own @ mixed))


def rigid_motions(corners: FloatArray) -> FloatArray:
    """Return how corners (N, 2) move as a whole, in x, in y and in angle (2 N, 3)."""
    found = np.zeros((corners.size, 3))
    found[::2, 0] = found[1::2, 1] = 1.0
    found[::2, 2], found[1::2, 2] = -corners[:, 1], corners[:, 0]
    return found


def following(scans: RigidScans, corners: FloatArray, poses: FloatArray) -> float:
    """Return how many times as far off errors that follow each other from scan to scan leave the shape; 1: none do.

    That is the square root of their integrated autocorrelation, as for the mean of a series. Scans in order of time.
    """
    left, alike = scans.k.copy(), 0.0
    for some, _, here in linearised_blocks(scans, corners, poses):
        left[some] -= here.model
    for lag in range(1, min(_LAGS, len(left) // 2)):
        a, b = left[:-lag], left[lag:]
        both = np.isfinite(a) & np.isfinite(b)
        a, b = a[both], b[both]
        r = float((a * b).sum() / max(np.sqrt(float((a * a).sum() * (b * b).sum())), 1e-300))
        if r <= 0.0 or (lag == 1 and r * np.sqrt(len(a)) < _FOLLOWING):
            break
        alike += r
    return float(np.sqrt(1.0 + 2.0 * alike))


def shared_by_strips(
    scans: RigidScans, corners: FloatArray, poses: FloatArray, correlation: float
) -> FloatArray:
    """Return what errors that neighbouring strips share add to the covariances of poses (T, 3, 3), the corners known.

    The poses are those of least squares, which takes errors for independent; from strip to strip they are correlated,
    from one to the next but one by the square of that, and so on.
    """
    added = np.zeros((len(poses), 3, 3))
    for some, part, here in linearised_blocks(scans, corners, poses):
        rows = here.rows.reshape(*part.k.shape, -1)[..., :3] / scans.sigma
        there = np.isfinite(part.k) & (np.abs(rows[..., 0]) <= UPRIGHT / scans.sensor.length_mm / scans.sigma)
        rows = np.where(there[..., None], rows, 0.0)
        own = np.linalg.pinv(np.einsum("tsip,tsiq->tpq", rows, rows), hermitian=True)
        for lag in range(1, rows.shape[2]):
            both = correlation**lag * np.einsum("tsip,tsiq->tpq", rows[:, :, lag:], rows[:, :, :-lag])
            added[some] += own @ (both + both.transpose(0, 2, 1)) @ own
    return added


def joint_bound(
    sensor: Sensor, corners: FloatArray, scans: int, slide_mm: float, turn: float, sigma: float
) -> FloatArray:
    """Return the Cramer-Rao bound (2 N, 2 N) [mm^2] of a shape's corners from many scans, wherever it lies.

    Parameters
    ----------
    sensor, corners
        What touches what: (N, 2) [mm] on the sensor, in the middle of its way.
    scans, slide_mm, turn
        How many, over how long a way across the strips [mm], turned by how much [rad] on it.
    sigma
        Standard deviation of a reading [Vref].

    Raises
    ------
    ContactError
        On this way the contact leaves the sensor.
    """
    t = np.linspace(-0.5, 0.5, scans) if scans > 1 else np.zeros(1)
    middle = corners.mean(axis=0)
    poses = np.stack([middle[0] + slide_mm * t, np.full(scans, middle[1]), turn * t], axis=1)
    own, contact = corners - middle, Contact.polygon(corners)
    posed = [_posed(contact, middle, pose) for pose in poses]
    reach = np.array([(c.vertices[:, 0].min(), c.vertices[:, 0].max()) for c in posed])
    if reach.min() < 0.0 or reach.max() > sensor.width_mm:
        raise ContactError(
            f"on this way the contact reaches from x = {reach.min():.4g} to {reach.max():.4g} mm, off the sensor "
            f"of {sensor.width_mm:.4g} mm: take a shorter way, or put the contact into the middle"
        )
    read = [simulate(sensor, contact) for contact in posed]
    names = read[0].signatures
    k = np.stack([np.stack([scan[name] for name in names]) for scan in read])
    return covariances(information(RigidScans(sensor, names, k, sigma), own, poses), own, poses)[0]


def _posed(contact: Contact, middle: FloatArray, pose: FloatArray) -> Contact:
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    corners = (contact.vertices - middle) @ np.array([[cos, sin], [-sin, cos]]) + pose[:2]
    return Contact.polygon(corners)
