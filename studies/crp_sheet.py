"""CRS-CRP against a sheet of nine columns a pitch, laid out with SciPy alone.

`python benchmarks/crp_accuracy.py sheet` prints the table of docs/science/physics.md.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse
from scipy.sparse.linalg import splu
from shapely import MultiPoint

import tacstrip as ts
from tacstrip.arrays import BoolArray, FloatArray

L, STRIPS, PITCH, RATIO = 100.0, 20, 5.0, 100.0
COLUMNS = 9  # a pitch, each in the middle of its cell


def a_sensor(contact_lambda_mm: float) -> ts.Sensor:
    """Return the square sensor of docs/science/physics.md."""
    return ts.Sensor(
        construction="crs-crp",
        strips=STRIPS,
        pitch_mm=PITCH,
        length_mm=L,
        resistivity_ratio=RATIO,
        contact_lambda_mm=contact_lambda_mm,
    )


def fine_sheet(lam: float, l: FloatArray, u: FloatArray, rows: int) -> FloatArray:
    """Return all electrodes (strips, 2 strips), from conductances on a grid; contacts lie under a whole pitch."""
    n, h, c = rows + 1, L / rows, PITCH / COLUMNS
    square, many = RATIO * PITCH, STRIPS * COLUMNS
    g = 1.0 / ((1.0 + square / PITCH) * lam**2)
    cell = np.r_[0.5, np.ones(rows - 1), 0.5] * h

    def chain(conductances: FloatArray) -> scipy.sparse.sparray:
        d = scipy.sparse.diags_array([-np.ones(len(conductances)), np.ones(len(conductances))], offsets=[0, 1],
                                     shape=(len(conductances), len(conductances) + 1))  # fmt: skip
        return d.T @ scipy.sparse.diags_array(conductances) @ d

    sheet = scipy.sparse.kron(scipy.sparse.eye_array(many), chain(np.full(rows, c / (square * h))))
    sheet = sheet + scipy.sparse.kron(
        chain(np.full(many - 1, 1.0 / (c * square))), scipy.sparse.diags_array(cell)
    )
    touched = np.flatnonzero(np.isfinite(l))
    strips = scipy.sparse.kron(scipy.sparse.eye_array(len(touched)), chain(np.full(rows, 1.0 / h)))
    # What of a contact lies within half a cell of a node; rows are so many that this is as good as any rule.
    y = np.arange(n) * h
    share = np.clip(
        np.minimum(u[touched, None], y + h / 2) - np.maximum(l[touched, None], y - h / 2), 0.0, None
    )
    joint = g / COLUMNS * share.ravel()
    under = (touched[:, None, None] * COLUMNS + np.arange(COLUMNS)[:, None]) * n + np.arange(n)  # (T, 9, n)
    each = np.broadcast_to(np.arange(len(touched) * n).reshape(-1, 1, n), under.shape).ravel()
    weight, under = np.broadcast_to(joint.reshape(-1, 1, n), under.shape).ravel(), under.ravel()
    size = (len(touched) * n, many * n)
    across = scipy.sparse.coo_array((weight, (each, under)), shape=size)
    on_strip, on_sheet = (
        np.bincount(at, weight, many_at) for at, many_at in zip((each, under), size, strict=True)
    )
    matrix = scipy.sparse.block_array(
        [
            [strips + scipy.sparse.diags_array(on_strip), -across],
            [-across.T, sheet + scipy.sparse.diags_array(on_sheet)],
        ],
        format="csc",
    )
    factor = splu(
        matrix[:-1, :-1], permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )
    centre = size[0] + (np.arange(STRIPS) * COLUMNS + COLUMNS // 2) * n
    read = np.full((STRIPS, 2 * STRIPS), np.nan)
    for t, strip in enumerate(touched):
        bottom, top = t * n, t * n + rows
        current = np.zeros(sum(size) - 1)
        current[[top, bottom]] = 1.0, -1.0
        potential = np.append(factor.solve(current), 0.0)
        electrodes = potential[np.r_[centre, centre + rows]]
        read[strip] = (electrodes - potential[bottom]) / (potential[top] - potential[bottom])
    return read


def spans(sensor: ts.Sensor, count: int, seed: int) -> list[tuple[FloatArray, FloatArray]]:
    """Draw convex polygons over ten strips or more, as l and u."""
    random = np.random.default_rng(seed)
    found: list[tuple[FloatArray, FloatArray]] = []
    while len(found) < count:
        points = random.uniform(0.05, 0.95, (random.integers(3, 9), 2)) * (sensor.width_mm, L)
        l, u = ts.footprint(sensor, ts.Contact((MultiPoint(points).convex_hull,)))
        if (u - l >= 0.05 * L).sum() >= STRIPS // 2:
            found.append((l, u))
    return found


def wide_ends(l: FloatArray, u: FloatArray) -> BoolArray:
    """Tell which ends belong to contacts of 5 % of L or more: l of all strips, then u (2 strips,)."""
    return np.tile(u - l >= 0.05 * L, 2)
