"""Scans of one rigid outline that slides and turns."""

from __future__ import annotations

import math

import numpy as np

import tacstrip as ts
from tacstrip.arrays import FloatArray
from tacstrip.core.rigid import RigidScans

CORNERS = np.array([(-25.0, -18.0), (22.0, -20.0), (26.0, 8.0), (0.0, 25.0), (-20.0, 14.0)])


def sliding(scans: int, across_mm: float = 15.0, along_mm: float = 10.0, turn: float = 1.0) -> FloatArray:
    """Return poses (T, 3) of a smooth way over the middle of a 100 mm sensor."""
    t = np.linspace(0.0, 1.0, scans)
    return np.stack(
        [50 + across_mm * (t - 0.5), 50 + along_mm * np.sin(2.0 * t - 1.0), 0.3 + turn * t], axis=1
    )


def at(corners: FloatArray, pose: FloatArray) -> FloatArray:
    """Return corners (N, 2) of a frame at a pose x, y, angle on the sensor."""
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    return np.asarray(corners @ np.array([[cos, sin], [-sin, cos]]) + pose[:2])


def pressed(
    sensor: ts.Sensor, corners: FloatArray, poses: FloatArray, noise: ts.Noise, seed: int = 0
) -> list[ts.Scan]:
    """Return a scan of an outline at each pose, 10 ms apart."""
    found = []
    for i, pose in enumerate(poses):
        contact = ts.Contact.polygon(at(corners, pose))
        found.append(ts.simulate(sensor, contact, noise, rng=1000 * seed + i, time_s=0.01 * i))
    return found


def ten_strips(construction: str = "crs-crs", lam: float = 0.0, strips: int = 10) -> ts.Sensor:
    """Return a sensor of 100 mm by 100 mm."""
    return ts.Sensor(
        construction=construction,
        strips=strips,
        pitch_mm=100.0 / strips,
        length_mm=100.0,
        contact_lambda_mm=lam,
    )


def rigid_scene(construction: str, lam: float, scans: int = 20) -> tuple[RigidScans, FloatArray, FloatArray]:
    """Return readings with noise, and corners and poses about the true ones."""
    sensor, poses = ten_strips(construction, lam), sliding(scans)
    noise, random = ts.Noise(positional=0.005), np.random.default_rng(1)
    read = pressed(sensor, CORNERS, poses, noise)
    names = read[0].signatures
    k = np.stack([np.stack([scan[name] for name in names]) for scan in read])
    start = poses + random.normal(0.0, (1.0, 1.0, 0.05), poses.shape)
    return (
        RigidScans(sensor, names, k, 0.005 / math.sqrt(3.0)),
        CORNERS + random.normal(0.0, 1.0, CORNERS.shape),
        start,
    )


def distance(found: FloatArray, true: FloatArray) -> float:
    """Return the RMS distance of corners from the true ones, moved and turned onto them; inf for another count."""
    if len(found) != len(true):
        return math.inf
    best = math.inf
    for shift in range(len(true)):
        a, b = np.roll(found, shift, axis=0), true
        a, b = a - a.mean(axis=0), b - b.mean(axis=0)
        u, _, v = np.linalg.svd(a.T @ b)
        turn = u @ np.diag([1.0, np.sign(np.linalg.det(u @ v))]) @ v
        best = min(best, math.sqrt(float(((a @ turn - b) ** 2).sum(axis=1).mean())))
    return best
