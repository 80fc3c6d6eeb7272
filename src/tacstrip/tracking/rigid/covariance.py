"""How sure an outline's corners and its poses are: the bound that all scans together leave."""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.contact.shape import Contact
from tacstrip.core.rigid import RigidScans, equations, loss, reduced
from tacstrip.errors import ContactError
from tacstrip.sensor.spec import Sensor
from tacstrip.simulation import simulate

NEVER = 1e6  # pitches: what touched strips tell of the ends is left out, for inside the gap it is nothing


def covariances(
    scans: RigidScans, corners: FloatArray, poses: FloatArray, beside: FloatArray | float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Return the covariance of corners (N, 2) about their mean, (2 N, 2 N) [mm^2], and of the poses (T, 3, 3).

    The frame lies where the corners' errors neither move nor turn them as a whole; the poses take that up. `beside`
    (2 N, 2 N) is what else is known of the corners, of their shape alone.
    """
    found = equations(scans, corners, poses, loss(scans, end=NEVER))
    matrix, _, inverse = reduced(found)
    value, vector = np.linalg.eigh(matrix + beside)
    anywhere = float(np.ptp(corners, axis=0).max()) ** 2  # what the readings do not hold at all
    pinned = vector / np.maximum(value, 1.0 / anywhere) @ vector.T
    rigid = rigid_motions(corners)
    as_motion = np.linalg.pinv(rigid)  # (3, 2 N): of a change of the corners
    inner = np.eye(corners.size) - rigid @ as_motion
    turned = np.zeros((len(poses), 3, 3))
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    turned[:, 0, 0], turned[:, 0, 1], turned[:, 1, 0], turned[:, 1, 1], turned[:, 2, 2] = (
        cos,
        -sin,
        sin,
        cos,
        1.0,
    )
    by_corners = turned @ as_motion - inverse @ found.mixed
    of_poses = inverse + by_corners @ pinned @ by_corners.transpose(0, 2, 1)
    return np.asarray(inner @ pinned @ inner.T), np.asarray(of_poses)


def rigid_motions(corners: FloatArray) -> FloatArray:
    """Return how corners (N, 2) move as a whole, in x, in y and in angle (2 N, 3)."""
    found = np.zeros((corners.size, 3))
    found[::2, 0] = found[1::2, 1] = 1.0
    found[::2, 2], found[1::2, 2] = -corners[:, 1], corners[:, 0]
    return found


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
    return covariances(RigidScans(sensor, names, k, sigma), own, poses)[0]


def _posed(contact: Contact, middle: FloatArray, pose: FloatArray) -> Contact:
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    corners = (contact.vertices - middle) @ np.array([[cos, sin], [-sin, cos]]) + pose[:2]
    return Contact.polygon(corners)
