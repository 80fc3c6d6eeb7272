"""Strips that do not disturb each other, fast: one tridiagonal system for many of them.

With d the potential of the energised strip over the sensing layer at the contact's nodes, and the current I through
both together fixed, Kirchhoff's laws leave d alone as the unknown: with s = 1 / (r0 + r1) for each cell,

    -s[j-1] d[j-1] + (s[j-1] + s[j] + g[j]) d[j] - s[j] d[j+1] = I (s[j-1] r0[j-1] - s[j] r0[j])

The strips' ends outside the contact are two resistors in series. Strips stand one after another in one system, with
s = 0 between them. `network.strips` solves the same mesh node by node,
with faults and loads too; a test holds the two together.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.contact.shape import Contact
from tacstrip.network.imperfections import Imperfections, Readout
from tacstrip.network.strips.measurements import StripMesh, make_mesh, network_readings
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.spec import Sensor

_CACHED = 4096  # nodes


def fast_readings(
    sensor: Sensor,
    contact: Contact,
    imperfections: Imperfections | None = None,
    readout: Readout | None = None,
    cells: int | None = None,
) -> dict[str, FloatArray]:
    """Return what every strip reads over Vref, signature to (strips,), NaN where nothing touches.

    As `network.strips.network_readings`, which it calls where strips disturb each other or a fault or a load
    makes more than a ladder of one; errors as there.
    """
    mesh = make_mesh(sensor, contact, imperfections, readout, cells)
    if not _independent(mesh):
        return network_readings(sensor, contact, imperfections, readout, cells)
    result = {name: np.full(sensor.strips, np.nan) for name in sensor.signatures}
    for strips in _groups(mesh):
        low, high = _ends(mesh, strips)
        for name, values in result.items():
            values[list(strips)] = high if SIGNATURES[name].at_upper_end else low
    return result


def _independent(mesh: StripMesh) -> bool:
    imperfections, readout = mesh.imperfections, mesh.readout
    ladders = not (imperfections.breaks or imperfections.shorts or readout.adc_ohm < np.inf)
    shorted = any(p[0, 0] <= 0.0 and p[-1, 1] >= mesh.sensor.length_mm for p in mesh.pieces.values())
    return ladders and not (mesh.metal and (readout.tied_grounds or shorted))


def _groups(mesh: StripMesh) -> Iterator[dict[int, list[FloatArray]]]:
    """Yield the touched strips with their nodes, in groups that stay in the processor's cache."""
    group: dict[int, list[FloatArray]] = {}
    size = 0
    for strip in mesh.pieces:
        group[strip] = mesh.nodes(strip)
        size += sum(len(piece) for piece in group[strip])
        if size > _CACHED:
            yield group
            group, size = {}, 0
    if group:
        yield group


def _ends(mesh: StripMesh, strips: dict[int, list[FloatArray]]) -> tuple[FloatArray, FloatArray]:
    """Return the potentials of the strips' sensing layers, lower and upper end (strips,) [Vref]."""
    y = [np.concatenate(pieces) for pieces in strips.values()]
    first = np.concatenate(([0], np.cumsum([len(part) for part in y])))  # of each strip's nodes
    length = mesh.sensor.length_mm
    whole_y = [np.concatenate(([0.0], part, [length])) for part in y]
    energised = [mesh.ohm(n, "energised", whole) for n, whole in zip(strips, whole_y, strict=True)]
    # Between the last node of a strip and the first of the next there is a cell of 1 ohm that does not conduct.
    gap = first[1:-1] - 1
    r0 = _row([whole[1:-1] for whole in energised])
    r1 = np.zeros_like(r0)
    if not mesh.metal:
        r1 = _row([mesh.ohm(n, "sensing", part) for n, part in zip(strips, y, strict=True)])
    s = 1.0 / (r0 + r1)
    s[gap] = 0.0
    share = r0 * s  # of the current that the sensing layer takes where d does not change
    siemens = [mesh.siemens(piece) for pieces in strips.values() for piece in pieces]
    if mesh.sensor.contact_lambda_mm == 0.0:  # both carry their share, in a gap between pieces too
        d, through = np.zeros(first[-1]), share
    else:  # a point is ideal: so good a contact that no potential is left over it
        best = 1e12 * s.max(initial=1.0)
        d = _differences(s, share, np.concatenate([np.array([best]) if g is None else g for g in siemens]))
        through = share - np.diff(d) * s
    drops = np.concatenate(([0.0], np.cumsum(r0 * (1.0 - through))))
    drop = drops[first[1:] - 1] - drops[first[:-1]]
    switch, supply = mesh.readout.mux_ohm, mesh.readout.supply_ohm
    if mesh.sensor.kind.common_supply:
        switch = supply = 0.0
    below = np.array([whole[0] for whole in energised]) + switch
    above = np.array([whole[-1] for whole in energised]) + switch + supply
    total = below + drop + above
    return (below - d[first[:-1]]) / total, (below + drop - d[first[1:] - 1]) / total


def _row(parts: list[FloatArray]) -> FloatArray:
    """Put the cells of all strips in a row, with one cell of 1 between them."""
    between = np.ones(1)
    return np.concatenate([array for part in parts for array in (between, part)][1:])


def _differences(s: FloatArray, share: FloatArray, g: FloatArray) -> FloatArray:
    """Solve the tridiagonal system above for d (N,), for a current of 1; s r0 is the cells' share (N - 1,)."""
    from scipy.linalg.lapack import dptsv

    diagonal = g.copy()
    diagonal[:-1] += s
    diagonal[1:] += s
    drive = np.zeros_like(g)
    drive[1:] += share
    drive[:-1] -= share
    return np.asarray(dptsv(diagonal, -s, drive)[2]) if len(g) > 1 else drive
