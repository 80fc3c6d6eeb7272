"""Nodal analysis: resistors between nodes, some nodes held at a potential, the others solved for.

`Network` and `Measurement` describe, `Factored` prepares what does not change, `solve_measurement` does all at once.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.errors import NetworkError

# Symmetric positive definite: order for fill-in, never pivot (measured in design.md, Parts). Columns one by one are
# 10 to 30 % faster than SuperLU's panels on meshes of 1,500 to 40,000 nodes.
_SPLU = {
    "permc_spec": "MMD_AT_PLUS_A",
    "diag_pivot_thresh": 0.0,
    "panel_size": 1,
    "options": {"SymmetricMode": True},
}
# Right-hand sides at once: more of them fall out of the cache, and from 8 on BLAS takes threads, which wait for each
# other for long on a busy machine.
_TOGETHER = 4
# The last rows of the factors are solved alone: at most so many times the nodes asked for, and this part of all.
_LITTLE_MORE, _PART = 2, 0.25


@dataclass(frozen=True, eq=False)
class Network:
    """Resistors between numbered nodes.

    Attributes
    ----------
    nodes
        Number of nodes.
    start, end
        The resistors' nodes (R,).
    siemens
        Their conductances (R,), in [S] or any one unit: potentials depend on ratios only.
    signed
        Whether some may be negative, as finite elements of a higher degree have them; the network as a whole
        must take power up all the same.

    Raises
    ------
    NetworkError
        A conductance is not a finite number above 0 (`signed`: other than 0), or a resistor ends at a node that does
        not exist.
    """

    nodes: int
    start: IntArray
    end: IntArray
    siemens: FloatArray
    signed: bool = False

    def __post_init__(self) -> None:
        size = np.abs(self.siemens) if self.signed else self.siemens
        bad = np.flatnonzero(~((size > 0.0) & (size < np.inf)))
        if len(bad):
            i = bad[0]
            raise NetworkError(
                f"the resistor between nodes {self.start[i]} and {self.end[i]} has a conductance of "
                f"{self.siemens[i]:.6g}: resistances must be finite and above 0 ohm; join nodes for 0, leave it out "
                "for an open one"
            )
        ends = np.concatenate([self.start, self.end])
        if len(ends) and not 0 <= ends.min() <= ends.max() < self.nodes:
            raise NetworkError(
                f"a resistor ends at node {ends.min()} or {ends.max()}: nodes are 0 to {self.nodes - 1}"
            )

    def floating(self, held: IntArray) -> BoolArray:
        """Tell which nodes no resistor joins, over others, to a held one (nodes,)."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        pairs = coo_array((self.siemens, (self.start, self.end)), shape=(self.nodes, self.nodes))
        _, island = connected_components(pairs, directed=False)
        return ~np.isin(island, island[held])


@dataclass(frozen=True, eq=False)
class Measurement:
    """One measurement on a network: which nodes are held at which potential, and what is read.

    Attributes
    ----------
    network
        The resistors.
    held
        Node to its potential [Vref].
    read
        Name of a reading to its node: its potential.
    metered
        Name of a reading to a held node: the current that leaves the network there, in [Vref] times the
        conductances' unit.
    """

    network: Network
    held: dict[int, float]
    read: dict[str, int]
    metered: dict[str, int] = field(default_factory=dict)


class Factored:
    """A network with its held nodes, factored once.

    Nodes that no resistor joins, over others, to a held node float: their potential is not determined. Nodes are
    eliminated in an `order` (nodes,) that is known beforehand, or by minimum degree.
    """

    def __init__(self, network: Network, held: npt.ArrayLike, order: IntArray | None = None) -> None:
        from scipy.sparse import coo_array
        from scipy.sparse.linalg import splu

        self.network = network
        self.held = np.asarray(held, dtype=np.int64)
        if len(np.unique(self.held)) != len(self.held) or not len(self.held):
            raise NetworkError("hold at least one node, and each only once")
        n, (a, b, g) = network.nodes, (network.start, network.end, network.siemens)
        self.floating = network.floating(self.held)
        free = ~self.floating
        free[self.held] = False
        self._free = np.flatnonzero(free) if order is None else order[free[order]]
        self._number = number = np.full(n, -1)
        number[self._free] = np.arange(len(self._free))
        place = np.full(n, -1)
        place[self.held] = np.arange(len(self.held))
        i, j, w = np.concatenate([a, b]), np.concatenate([b, a]), np.concatenate([g, g])
        rows = number[i] >= 0
        diagonal = np.bincount(number[i[rows]], weights=w[rows], minlength=len(self._free))
        inside, border = rows & (number[j] >= 0), rows & (place[j] >= 0)
        size = len(self._free)
        every = np.arange(size)
        matrix = coo_array(
            (
                np.concatenate([diagonal, -w[inside]]),
                (np.concatenate([every, number[i[inside]]]), np.concatenate([every, number[j[inside]]])),
            ),
            shape=(size, size),
        )
        to_held = (w[border], (number[i[border]], place[j[border]]))
        self._to_held = coo_array(to_held, shape=(size, len(self.held))).tocsr()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            by = {} if order is None else {"permc_spec": "NATURAL"}
            self._factor = splu(matrix.tocsc(), **(_SPLU | by)) if size else None

    def solve(self, volts: npt.ArrayLike, amperes: FloatArray | None = None) -> FloatArray:
        """Return the potentials (nodes,) or, for many measurements at once, (nodes, measurements).

        Parameters
        ----------
        volts
            Potentials of the held nodes (held,) or (held, measurements).
        amperes
            Currents fed into the nodes (nodes,) or (nodes, measurements); none by default.

        Returns
        -------
        ndarray
            NaN where a node floats.
        """
        held = np.asarray(volts, dtype=float)
        right = self._to_held @ held
        if amperes is not None:
            right = right + amperes[self._free]
        potentials = np.full((self.network.nodes, *held.shape[1:]), np.nan)
        potentials[self.held] = held
        if self._factor is not None:
            potentials[self._free] = self._factor.solve(right)
        return potentials

    def fed(self, into: IntArray, out: IntArray | None = None, at: IntArray | None = None) -> FloatArray:
        """Return potentials while a current of 1 flows into each of K nodes, and out of each of K others.

        All held nodes are on ground, but for a node of `into` that is held: it is put on Vref instead of being fed.
        No node may float. The potentials (P, K) are those of the nodes `at` (P,), by default of all.
        """
        at = np.arange(self.network.nodes) if at is None else at
        number = self._number
        inner = number[at] >= 0
        place, solved = self._solver(into, np.concatenate([at, at[:0] if out is None else out]))
        rows = place[number[at[inner]]]
        potentials = np.zeros((len(at), len(into)), order="F")
        for first in range(0, len(into), _TOGETHER):
            part = slice(first, first + _TOGETHER)
            right = np.zeros((place.max(initial=-1) + 1, len(into[part])), order="F")
            for k, node in enumerate(into[part]):
                if number[node] >= 0:
                    right[place[number[node]], k] = 1.0
                else:
                    right[:, k] = self._to_held[:, self.held == node].toarray()[:, 0]
                    potentials[at == node, first + k] = 1.0
                if out is not None and number[out[first + k]] >= 0:
                    right[place[number[out[first + k]]], k] -= 1.0
            potentials[inner, part] = solved(right)[rows]
        return potentials

    def _solver(
        self, into: IntArray, others: IntArray
    ) -> tuple[IntArray, Callable[[FloatArray], FloatArray]]:
        """Return the place of each free node among the unknowns, and what solves for these, with currents `into` nodes.

        Where these and the others are nearly all of the factors' last rows, these alone are solved.
        """
        from scipy.linalg.blas import dtrsm

        factor, size = self._factor, len(self._free)
        if factor is None:
            return np.arange(size), np.copy
        rows = np.unique(self._number[np.concatenate([into, others])])
        first = int(factor.perm_c[rows[rows >= 0]].min(initial=size))
        if size - first > min(_LITTLE_MORE * len(rows), _PART * size) or (self._number[into] < 0).any():
            return np.arange(size), factor.solve
        lower, upper = (np.asfortranarray(f[:, first:][first:].toarray()) for f in (factor.L, factor.U))
        return factor.perm_c - first, lambda b: np.asarray(
            dtrsm(1.0, upper, dtrsm(1.0, lower, b, lower=1, diag=1))
        )


def solve(measurement: Measurement) -> FloatArray:
    """Return all potentials (nodes,) [Vref]; NaN where a node that is not read floats.

    Raises
    ------
    NetworkError
        Nothing is held, or a node that is read floats.
    """
    held = measurement.held
    potentials = Factored(measurement.network, list(held)).solve(list(held.values()))
    for name, node in measurement.read.items():
        if np.isnan(potentials[node]):
            raise NetworkError(
                f"{name} floats: no resistor joins node {node} to one that is held at a potential"
            )
    return potentials


def solve_measurement(measurement: Measurement) -> dict[str, float]:
    """Return every reading of a measurement, by its name; errors as for `solve`."""
    potentials, network = solve(measurement), measurement.network
    result = {name: float(potentials[node]) for name, node in measurement.read.items()}
    if measurement.metered:
        flow = currents(network, potentials)
        for name, node in measurement.metered.items():
            result[name] = float(flow[network.end == node].sum() - flow[network.start == node].sum())
    return result


def currents(network: Network, potentials: FloatArray) -> FloatArray:
    """Return the current through each resistor, from its start to its end (R,)."""
    return np.asarray(network.siemens * (potentials[network.start] - potentials[network.end]))
