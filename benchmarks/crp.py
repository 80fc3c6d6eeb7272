"""A whole CRS-CRP scan in units of factoring a sheet of one column a pitch, its growth, and what an inversion takes.

All strips are touched: a disc of 90 % of the length, the worst case of many contact nodes, and a band of a fifth.
The scan lays the resistors out, assembles, factors, solves for every strip and reads all electrodes.
Run: python benchmarks/crp.py
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import partial

import numpy as np
from _timing import median_seconds
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu
from sheet import in_turns

import tacstrip as ts
from studies import crp_spans
from tacstrip.arrays import FloatArray
from tacstrip.network.crp import inversion as crp
from tacstrip.network.crp.factored import FactoredScan
from tacstrip.network.nodal import Factored, Network

LENGTH = 100.0
# design.md's factorisation, the unit of what a scan may take; ours (`nodal`) is some 25 % faster.
OPTIONS = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}


def a_sensor(strips: int) -> ts.Sensor:
    """Return a square sensor."""
    return ts.Sensor(
        construction="crs-crp",
        strips=strips,
        pitch_mm=LENGTH / strips,
        length_mm=LENGTH,
        resistivity_ratio=100.0,
        contact_lambda_mm=2.0,
    )


def disc(sensor: ts.Sensor) -> tuple[FloatArray, FloatArray]:
    """Return l and u of a disc that touches all strips."""
    half = 45.0 * np.sqrt(1.0 - ((sensor.x_mm - 50.0) / 50.0) ** 2)
    return 50.0 - half, 50.0 + half


def band(sensor: ts.Sensor) -> tuple[FloatArray, FloatArray]:
    """Return l and u of a band over all strips."""
    return np.full(sensor.strips, 40.0), np.full(sensor.strips, 60.0)


def one_column(scan: FactoredScan, l: FloatArray, u: FloatArray) -> Network:
    """Return the same contact on a sheet of one column a pitch, which was the mesh before: the unit."""
    mesh, strip = scan.mesh, scan.resistors.strip
    lengths = np.maximum(mesh.hat_lengths(l[strip], u[strip]), 0.0)
    sheet = np.arange(mesh.strips * (mesh.rows + 1)).reshape(mesh.strips, -1)
    has = lengths > 0.0
    has[:, [0, -1]] = True
    node = np.full(has.shape, -1)
    node[has] = sheet.size + np.arange(has.sum())
    chain, at = node[has], np.nonzero(has)[0]
    same, touching = at[1:] == at[:-1], lengths > 0.0
    pairs = (
        (sheet[:, :-1], sheet[:, 1:]),
        (sheet[:-1], sheet[1:]),
        (chain[:-1][same], chain[1:][same]),
        (node[touching], sheet[strip][touching]),
    )
    start, end = (np.concatenate([pair[i].ravel() for pair in pairs]) for i in (0, 1))
    return Network(sheet.size + len(chain), start, end, np.ones(len(start)))  # the pattern makes the time


def superlu(net: Network) -> Callable[[], object]:
    """Return the job that factors a network, assembled beforehand, with the options of design.md; node 0 is held."""
    free = np.arange(net.nodes) > 0
    number = np.cumsum(free) - 1
    inside = free[net.start] & free[net.end]
    i, j, g = number[net.start[inside]], number[net.end[inside]], net.siemens[inside]
    diagonal = np.bincount(net.start, net.siemens, net.nodes) + np.bincount(net.end, net.siemens, net.nodes)
    every = np.arange(free.sum())
    entries = np.concatenate([diagonal[free], -g, -g])
    where = np.concatenate([every, i, j]), np.concatenate([every, j, i])
    matrix = coo_array((entries, where), shape=(len(every), len(every))).tocsc()

    def job() -> object:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return splu(matrix, **OPTIONS)

    return job


def main() -> None:
    """Print a scan's time over one factorisation for several meshes, then an inversion's."""
    print(
        "anew: the network assembled and factored by `nodal.Factored`; LU: SuperLU alone, one column a pitch"
    )
    print(
        f"{'contact':>8} {'strips':>6} {'rows':>5} {'nodes':>6}  anew [ms]  LU [ms]  scan [ms]  scan / anew  scan / LU"
    )
    for shape in (disc, band):
        for strips, rows in ((20, 100), (25, 100), (50, 100), (100, 50), (100, 100), (100, 200), (200, 100)):
            sensor = a_sensor(strips)
            l, u = shape(sensor)
            scan = crp_spans.factored_span(sensor, l, u, rows)
            jobs = (
                partial(Factored, scan.resistors.network, scan.factored.held),
                superlu(one_column(scan, l, u)),
                partial(crp_spans.all_electrodes, sensor, l, u, rows),
            )
            anew, lu, whole = in_turns(jobs, 9)
            print(
                f"{shape.__name__:>8} {strips:6d} {rows:5d} {scan.resistors.network.nodes:6d} {1e3 * anew:10.1f} "
                f"{1e3 * lu:8.1f} {1e3 * whole:10.1f} {whole / anew:12.2f} {whole / lu:10.2f}"
                + ("  (wanted: 8)" if strips == 100 else "")
            )
    print("inversion of the disc at 0.1 % noise, default mesh of 200 rows")
    for strips in (20, 50):
        sensor, each = a_sensor(strips), np.arange(strips)
        readings = crp_spans.all_electrodes(sensor, *disc(sensor))
        readings += 1e-3 * np.random.default_rng(0).normal(size=readings.shape)
        own = readings[each, strips + each], readings[each, each]
        for name, job in (
            ("own electrodes", partial(crp.invert, sensor, *own)),
            ("all electrodes", partial(crp.invert_all, sensor, readings)),
        ):
            print(f"{strips} strips, {name}: {median_seconds(job, 5):.3f} s, {job().iterations} networks")


if __name__ == "__main__":
    main()
