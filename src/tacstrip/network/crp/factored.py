"""The network of a CRS-CRP contact: one factor serves a whole scan, and how its readings change with l and u.

While strip i is energised all others float, so every strip is measured on one network: no strip held, one
node of the sheet grounded. A unit current from the strip's end at Vref to its grounded end is one right-hand side;
shifted and scaled so that these ends are at 0 and 1, the potentials are those of the energised strip.

The Jacobian is the adjoint one: with phi the potentials of a unit current into the strip and psi those of a unit
current from where a potential is read to where it is compared with, d reading / d conductance = - (delta phi)
(delta psi), deltas taken over the contact's resistor. These right-hand sides share the factor too.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.network.crp.dissection import elimination_order
from tacstrip.network.crp.mesh import SheetMesh, contact_network
from tacstrip.network.nodal import Factored


class FactoredScan:
    """The network of one contact, factored once.

    Parameters
    ----------
    mesh
        The sensor cut into cells.
    strip
        The touched strips (T,).
    lengths
        Length of contact that each node stands for (T, rows + 1) [mm].
    """

    def __init__(self, mesh: SheetMesh, strip: IntArray, lengths: FloatArray) -> None:
        self.mesh = mesh
        self.resistors = resistors = contact_network(mesh, strip, np.maximum(lengths, 0.0))
        self.by_voltage = mesh.wiring.others == "grounded"
        one = resistors.bottom if mesh.wiring.others == "tied grounds" else resistors.electrode
        held = np.concatenate([resistors.top, resistors.bottom]) if self.by_voltage else one[:1]
        self._ports = np.unique(np.concatenate([resistors.electrode, resistors.bottom, resistors.top]))
        order = elimination_order(resistors.line, len(mesh.pitch.widths), self._ports)
        self.factored = Factored(resistors.network, held, order)
        # Potentials are kept where slopes of readings need them; all of them would not stay in the cache.
        self._kept = np.unique(self._beside_ends(lengths))

    def _beside_ends(self, lengths: FloatArray) -> IntArray:
        """Return the nodes in the rows beside the outer ends of the contact, and one row further."""
        touched = lengths > 0.0
        last = touched.shape[1] - 1
        outer = np.stack([touched.argmax(axis=1), last - touched[:, ::-1].argmax(axis=1)], axis=1)
        rows = np.clip(outer[:, :, None] + np.array([-1, 0, 1]), 0, last).reshape(len(touched), -1)
        each = np.arange(len(touched))[:, None]
        strip, sheet = self.resistors.strip_node[each, rows], self.resistors.sheet_node[each, :, rows]
        return np.concatenate([strip[strip >= 0], sheet.ravel()])

    def _place(self, node: IntArray) -> IntArray:
        """Return where nodes stand among those whose potentials are kept."""
        return np.searchsorted(self._kept, node)

    def _energised(self, at: IntArray) -> FloatArray:
        """Return potentials (at, T) while each touched strip carries 1, or, others grounded, is put on Vref."""
        return self.factored.fed(self.resistors.top, self.resistors.bottom, at)

    @cached_property
    def _at_ports(self) -> FloatArray:
        return self._energised(self._ports)

    def readings(self) -> FloatArray:
        """Return what all electrodes read while each touched strip is energised (T, 2 strips) [Vref]."""
        read = self._at_ports[np.searchsorted(self._ports, self.resistors.electrode)]
        ground, drop = self._ends()
        return np.asarray((read.T - ground[:, None]) / drop[:, None])

    def all_readings(self) -> FloatArray:
        """Return the readings of all strips (strips, 2 strips) [Vref], NaN where nothing touches."""
        readings = np.full((self.mesh.strips, 2 * self.mesh.strips), np.nan)
        readings[self.resistors.strip] = self.readings()
        return readings

    def _ends(self) -> tuple[FloatArray, FloatArray]:
        """Return the potential of each energised strip's grounded end, and of its other end over that (T,)."""
        touched = np.arange(len(self.resistors.strip))
        bottom, top = (np.searchsorted(self._ports, n) for n in (self.resistors.bottom, self.resistors.top))
        ground = self._at_ports[bottom, touched]
        return ground, self._at_ports[top, touched] - ground

    def jacobian(self, ends: FloatArray, electrodes: IntArray) -> FloatArray:
        """Return d readings / d (l, u).

        Parameters
        ----------
        ends
            The l of the touched strips that this network was built for, then their u (2 T,) [mm].
        electrodes
            Columns of the readings (T, E) that are wanted of each touched strip.

        Returns
        -------
        ndarray
            (T, E, 2 T) [1/mm]: the last axis has l of the touched strips, then u.
        """
        # Each (2 T, K): both rows beside each moving end.
        above, below, change, passed_on = self._moving(ends)
        strip, sheet = self._place(above), self._place(below)
        used, column = np.unique(electrodes, return_inverse=True)
        column = column.reshape(electrodes.shape)
        phi = self._energised(self._kept)
        d_phi = phi[strip] - phi[sheet]  # (2 T, K, T)
        psi = self.factored.fed(self.resistors.electrode[used], at=self._kept)
        d_read = psi[strip] - psi[sheet]  # (2 T, K, used)
        readings = np.take_along_axis(self.readings(), electrodes, axis=1)
        result = np.empty((*electrodes.shape, len(strip)))
        if not self.by_voltage:
            psi = self.factored.fed(self.resistors.bottom, at=self._kept)
            d_ground = psi[strip] - psi[sheet]
            _, drop = self._ends()
        for t, columns in enumerate(column):
            weighted = -change * d_phi[:, :, t]  # (2 T, K)
            read = np.einsum("pr,pre->ep", weighted, d_read[:, :, columns])
            if self.by_voltage:
                result[t] = read
                continue
            ground = (weighted * d_ground[:, :, t]).sum(axis=1)
            whole = (weighted * d_phi[:, :, t]).sum(axis=1)
            result[t] = (read - ground - readings[t][:, None] * whole) / drop[t]
        # An end moves where both are lumped.
        other = np.roll(result, len(strip) // 2, axis=-1)
        return np.asarray(result + passed_on * (other - result))

    def _moving(self, ends: FloatArray) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
        """Return the resistors that a lumped end's motion changes, and d conductance / d it, each (2 T, K).

        And how far the other end of a contact, and less far the one itself, moves with an end (2 T,).
        """
        mesh, count = self.mesh, len(ends) // 2
        low, high, passed_on = mesh.moved_inwards(*np.split(ends, 2))
        row, hats = mesh.hats_at(np.concatenate([low, high]))
        touched, beside = np.tile(np.arange(count), 2)[:, None], np.stack([row, row + 1], axis=1)
        share = mesh.pitch.under[np.flatnonzero(mesh.pitch.under)]
        change = (hats * mesh.contact * np.repeat([-1.0, 1.0], count)[:, None])[:, :, None] * share
        sheet = self.resistors.sheet_node[touched, :, beside]  # (2 T, 2, columns)
        strip = np.broadcast_to(self.resistors.strip_node[touched, beside][:, :, None], sheet.shape)
        # A row that an end only grazes, within rounding, has no node: nothing there moves.
        strip, change = np.where(strip < 0, sheet, strip), np.where(strip < 0, 0.0, change)
        flat = 2 * count, -1
        return strip.reshape(flat), sheet.reshape(flat), change.reshape(flat), np.tile(passed_on, 2)
