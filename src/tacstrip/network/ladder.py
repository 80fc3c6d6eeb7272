"""Strips that do not disturb each other, fast: one tridiagonal system a strip.

With d the potential of the energised strip over the sensing layer at the contact's nodes, and the current I through
both together fixed, Kirchhoff's laws leave d alone as the unknown: with s = 1 / (r0 + r1) for each cell,

    -s[j-1] d[j-1] + (s[j-1] + s[j] + g[j]) d[j] - s[j] d[j+1] = I (s[j-1] r0[j-1] - s[j] r0[j])

The strip's ends outside the contact are two resistors in series. `network.strips` solves the same mesh node by node,
with faults and loads too; a test holds the two together.
"""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.contact.shape import Contact
from tacstrip.network.build import Build, Readout
from tacstrip.network.mesh import Mesh, make_mesh
from tacstrip.network.strips import network_readings
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.spec import Sensor


def fast_readings(
    sensor: Sensor,
    contact: Contact,
    build: Build | None = None,
    readout: Readout | None = None,
    cells: int | None = None,
) -> dict[str, FloatArray]:
    """Return what every strip reads over Vref, signature to (strips,), NaN where nothing touches.

    As `network.strips.network_readings`, which it calls where strips disturb each other or a fault or a load
    makes more than a ladder of one; errors as there.
    """
    mesh = make_mesh(sensor, contact, build, readout, cells)
    if not _independent(mesh):
        return network_readings(sensor, contact, build, readout, cells)
    result = {name: np.full(sensor.strips, np.nan) for name in sensor.signatures}
    for strip in mesh.pieces:
        low, high = _read(mesh, strip)
        for name, values in result.items():
            values[strip] = high if SIGNATURES[name].at_upper_end else low
    return result


def _independent(mesh: Mesh) -> bool:
    build, readout = mesh.build, mesh.readout
    ladders = not (build.breaks or build.shorts or readout.adc_ohm < np.inf)
    shorted = any(p[0, 0] <= 0.0 and p[-1, 1] >= mesh.sensor.length_mm for p in mesh.pieces.values())
    return ladders and not (mesh.metal and (readout.tied_grounds or shorted))


def _read(mesh: Mesh, strip: int) -> tuple[float, float]:
    """Return the potentials of the sensing layer's lower and upper end [Vref]."""
    pieces = mesh.nodes(strip)
    y = np.concatenate([[0.0], *pieces, [mesh.sensor.length_mm]])
    whole = mesh.ohm(strip, "energised", y)
    switch = 0.0 if mesh.sensor.kind.common_supply else mesh.readout.mux_ohm
    below, r0, above = float(whole[0]) + switch, whole[1:-1], float(whole[-1]) + switch
    r1 = np.zeros_like(r0) if mesh.metal else mesh.ohm(strip, "sensing", y[1:-1])
    both = r0 + r1
    share = r0 / both  # of the current that the sensing layer takes where d does not change
    siemens = [mesh.siemens(p) for p in pieces]
    if all(g is not None for g in siemens):
        d = _differences(1.0 / both, share, np.concatenate([g for g in siemens if g is not None]))
        through = share - np.diff(d) / both
    else:  # ideal: both carry their share, in a gap between pieces too
        d, through = np.zeros(len(r0) + 1), share
    drop = float((r0 * (1.0 - through)).sum())
    total = below + drop + above
    return (below - float(d[0])) / total, (below + drop - float(d[-1])) / total


def _differences(s: FloatArray, share: FloatArray, g: FloatArray) -> FloatArray:
    """Solve the tridiagonal system above for d (N,), for a current of 1; s r0 is the cells' share (N - 1,)."""
    from scipy.linalg.lapack import dptsv

    diagonal = g.copy()
    diagonal[:-1] += s
    diagonal[1:] += s
    drive = np.zeros_like(g)
    drive[1:] += share
    drive[:-1] -= share
    return np.asarray(dptsv(diagonal, -s, drive)[2])
