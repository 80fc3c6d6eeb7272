"""A bare resistive sheet on a grid, its edges free, and contacts on it.

Two ways, one answer. `by_factor` factors sheet and contact anew. `by_green` solves for the contact's currents alone:
with G the bare sheet's Green block at the touched nodes, R the resistances of the contact, v what it is joined to
and c the sheet's mean potential, (G + R) i + c = v and sum i = 0. G comes from one table for all contacts: a free
edge is a mirror half a cell outside the last node, so the sheet is a quarter of a torus of twice its size, whose
Green function one FFT gives, and G is the sum of four of its entries. The DCT-II, which has the same mirrors, then
spreads the currents' potentials over the sheet. `solve` takes the way that was measured to be faster.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.errors import ContactError, NetworkError
from tacstrip.network.nodal import Factored, Network

# Nodes, measured by benchmarks/sheet.py. On a quiet machine dense work pays up to 250 nodes on a sheet of 30 x 30, 700
# on 100 x 100 and 1,700 on 200 x 200; but from 200 or so BLAS spreads it over threads, which on a busy machine wait for
# each other and take 100 times as long. Factoring is not threaded.
MOST_BY_GREEN = 128


@dataclass(frozen=True, eq=False)
class Touch:
    """A contact: sheet nodes that are joined, each over a resistance, to held potentials.

    Attributes
    ----------
    column, row
        The touched nodes (K,), each once.
    ohm
        Resistance of each node's contact (K,); 0 holds the node itself.
    volt
        What the other sides are held at (K,), or (K, sets) for many at once [Vref].
    """

    column: IntArray
    row: IntArray
    ohm: FloatArray
    volt: FloatArray


@dataclass(frozen=True)
class Sheet:
    """A rectangle of nodes with equal resistors between neighbours; nothing else is joined to it.

    Attributes
    ----------
    columns, rows
        Number of nodes across and along.
    across, along
        Conductance between neighbours of a row, and of a column [S], or in any one unit.

    Raises
    ------
    NetworkError
        There are no nodes, or a conductance is not a finite number above 0.
    """

    columns: int
    rows: int
    across: float = 1.0
    along: float = 1.0

    def __post_init__(self) -> None:
        if self.columns < 1 or self.rows < 1:
            raise NetworkError(f"a sheet of {self.columns} x {self.rows} nodes: give 1 x 1 or more")
        for name in ("across", "along"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise NetworkError(
                    f"{name} = {getattr(self, name)}: a conductance must be finite and above 0"
                )

    @cached_property
    def _mirrored(self) -> FloatArray:
        """Green function of the torus of twice the size, for a source at its first node (2 columns, 2 rows)."""
        size = 2 * self.columns, 2 * self.rows
        stiff = self._stiffness(size, (2.0 * np.pi / size[0], 2.0 * np.pi / size[1]))
        return np.ascontiguousarray(np.fft.ifft2(stiff).real)

    @cached_property
    def _modes(self) -> FloatArray:
        """One over the eigenvalues that belong to the DCT-II's cosines (columns, rows); 0 for the constant."""
        return self._stiffness((self.columns, self.rows), (np.pi / self.columns, np.pi / self.rows))

    def _stiffness(self, size: tuple[int, int], angle: tuple[float, float]) -> FloatArray:
        p, q = (4.0 * np.sin(0.5 * a * np.arange(n)) ** 2 for a, n in zip(angle, size, strict=True))
        value = self.across * p[:, None] + self.along * q
        value[0, 0] = np.inf  # no current can be fed into all nodes alike
        return np.asarray(1.0 / value)

    def green(self, column: IntArray, row: IntArray) -> FloatArray:
        """Return the bare sheet's Green block: potential at node a over current into node b (K, K).

        The current leaves evenly over all nodes, and the sheet's mean potential is 0: a block of the
        pseudo-inverse of its Laplacian.
        """
        n, m = 2 * self.columns, 2 * self.rows
        table = self._mirrored.ravel()
        across = (column[:, None] - column) % n * m, (column[:, None] + column + 1) % n * m
        along = (row[:, None] - row) % m, (row[:, None] + row + 1) % m
        return np.asarray(
            table[across[0] + along[0]]
            + table[across[0] + along[1]]
            + table[across[1] + along[0]]
            + table[across[1] + along[1]]
        )

    def network(self, touch: Touch) -> tuple[Network, IntArray]:
        """Return sheet and contact as resistors, node = column rows + row, and the held nodes (K,)."""
        node = np.arange(self.columns * self.rows).reshape(self.columns, self.rows)
        touched = node[touch.column, touch.row]
        real = touch.ohm > 0.0
        held = np.where(real, node.size + np.arange(len(touched)), touched)
        start = np.concatenate([node[:-1].ravel(), node[:, :-1].ravel(), touched[real]])
        end = np.concatenate([node[1:].ravel(), node[:, 1:].ravel(), held[real]])
        siemens = np.concatenate(
            [
                np.full((self.columns - 1) * self.rows, self.across),
                np.full(self.columns * (self.rows - 1), self.along),
                1.0 / touch.ohm[real],
            ]
        )
        return Network(node.size + len(touched), start, end, siemens), held


def solve(sheet: Sheet, touch: Touch) -> FloatArray:
    """Return the sheet's potentials (columns, rows) or (columns, rows, sets) [Vref].

    Raises
    ------
    ContactError
        Nothing is touched, a node is off the sheet or named twice, or a resistance is not 0 or more.
    """
    _check(sheet, touch)
    return (by_green if len(touch.column) <= MOST_BY_GREEN else by_factor)(sheet, touch)


def by_factor(sheet: Sheet, touch: Touch) -> FloatArray:
    """Solve by factoring sheet and contact anew: the plain way; arguments and errors as for `solve`."""
    _check(sheet, touch)
    network, held = sheet.network(touch)
    potentials = Factored(network, held).solve(touch.volt)[: sheet.columns * sheet.rows]
    return np.asarray(potentials.reshape(sheet.columns, sheet.rows, *touch.volt.shape[1:]))


def by_green(sheet: Sheet, touch: Touch) -> FloatArray:
    """Solve for the contact's currents by the bare sheet's Green block; arguments and errors as for `solve`."""
    from scipy.fft import dctn, idctn
    from scipy.linalg import cho_factor, cho_solve

    _check(sheet, touch)
    system = sheet.green(touch.column, touch.row)
    # The currents' sum is 0, so that a constant added everywhere changes nothing; it makes the system definite.
    system += max(np.trace(system) / len(system), 1.0 / (sheet.across + sheet.along))
    system[np.diag_indices_from(system)] += touch.ohm
    volt = touch.volt.reshape(len(system), -1)
    factor = cho_factor(system, lower=True, overwrite_a=True, check_finite=False)
    unit = cho_solve(factor, np.column_stack([volt, np.ones(len(system))]), check_finite=False)
    mean = unit[:, :-1].sum(axis=0) / unit[:, -1].sum()
    fed = np.zeros((sheet.columns, sheet.rows, volt.shape[1]))
    fed[touch.column, touch.row] = unit[:, :-1] - unit[:, -1:] * mean
    spread = dctn(fed, axes=(0, 1), norm="ortho", overwrite_x=True) * sheet._modes[:, :, None]
    potentials = idctn(spread, axes=(0, 1), norm="ortho", overwrite_x=True) + mean
    return np.asarray(potentials.reshape(sheet.columns, sheet.rows, *touch.volt.shape[1:]))


def _check(sheet: Sheet, touch: Touch) -> None:
    column, row, ohm, volt = touch.column, touch.row, touch.ohm, touch.volt
    if not len(column):
        raise ContactError("the contact touches no node: the sheet floats; check the contact's place")
    if not column.shape == row.shape == ohm.shape == volt.shape[:1]:
        raise ContactError(
            f"column, row, ohm and volt have shapes {column.shape}, {row.shape}, {ohm.shape} and {volt.shape}; "
            "give one value of each per touched node"
        )
    off = np.flatnonzero((column < 0) | (column >= sheet.columns) | (row < 0) | (row >= sheet.rows))
    if len(off):
        raise ContactError(
            f"node ({column[off[0]]}, {row[off[0]]}) is off the sheet: columns 0 to {sheet.columns - 1}, "
            f"rows 0 to {sheet.rows - 1}"
        )
    if len(np.unique(column * sheet.rows + row)) != len(column):
        raise ContactError("a node is touched twice; name each once, with one resistance")
    bad = np.flatnonzero(~((ohm >= 0.0) & (ohm < np.inf)))
    if len(bad):
        raise ContactError(
            f"ohm = {ohm[bad[0]]:.6g} at node ({column[bad[0]]}, {row[bad[0]]}): must be 0 (ideal) or more, and finite"
        )
    if not np.isfinite(volt).all():
        raise ContactError("volt has values that are not finite: every touched node needs a potential")
