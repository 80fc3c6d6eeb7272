"""Collecting a network: nodes as they come, some of which turn out to be the same one."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.errors import NetworkError
from tacstrip.network.nodal import Measurement, Network


@dataclass
class Wires:
    """Resistors as they are collected; nodes are numbered as they come, and may turn out to be one."""

    nodes: int = 0
    resistors: list[tuple[IntArray, IntArray, FloatArray]] = field(default_factory=list)
    same: list[tuple[IntArray, IntArray]] = field(default_factory=list)

    def new(self, count: int = 1) -> IntArray:
        """Return the numbers of new nodes (count,)."""
        self.nodes += count
        return np.arange(self.nodes - count, self.nodes)

    def join(self, start: IntArray, end: IntArray, siemens: FloatArray) -> None:
        """Add resistors, all of shape (R,)."""
        self.resistors.append((start, end, siemens))

    def measurement(self, held: dict[int, float], read: dict[str, int], strip: int) -> Measurement:
        """Return the measurement on the network: nodes that are the same become one, resistors on one node go.

        Raises
        ------
        NetworkError
            Nodes held at different potentials are the same.
        """
        network, label = self.merged()
        potentials: dict[int, float] = {}
        for node, volt in held.items():
            if potentials.setdefault(int(label[node]), volt) != volt:
                raise NetworkError(
                    f"strip {strip}: the contact joins both ends of the strip to the metal, which shorts Vref to "
                    "ground; make it shorter than the strip"
                )
        return Measurement(network, potentials, {name: int(label[node]) for name, node in read.items()})

    def merged(self) -> tuple[Network, IntArray]:
        """Return the network without resistors on one node, and the number there of each node (nodes,)."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        pairs = [np.broadcast_arrays(*pair) for pair in self.same]
        a, b = (np.concatenate(c) for c in zip(*pairs, (np.empty(0, dtype=int),) * 2, strict=True))
        joined = coo_array((np.ones(len(a)), (a, b)), shape=(self.nodes, self.nodes))
        count, label = connected_components(joined, directed=False)
        start, end, siemens = (np.concatenate(column) for column in zip(*self.resistors, strict=True))
        start, end = label[start], label[end]
        real = start != end
        return Network(int(count), start[real], end[real], siemens[real]), label

    def tie(self, a: int, b: int, ohm: float) -> None:
        """Join two nodes by a resistor, or for good where it has 0 ohm."""
        if ohm > 0.0:
            self.join(np.array([a]), np.array([b]), np.array([1.0 / ohm]))
        else:
            self.same.append((np.array([a]), np.array([b])))
