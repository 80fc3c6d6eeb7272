"""CRS-CRP (3.3) as resistors: strips over one uniform resistive sheet, n pitches wide and L long.

One column of the sheet lies under each strip, with nodes every h = L / rows over the length, the edges included.
Potentials depend on ratios only, so an energised strip has r0 = 1 per [mm]. With the sheet's square resistance
Rs = resistivity_ratio r0 b (b: strip width), a column has r1 = Rs / pitch per [mm], and neighbouring columns are
joined by 1 / (Rs pitch) per [mm]. A contact conducts g = 1 / ((r0 + r1) lambda^2) per [mm] over [l, u].

Smoothness. The contact is lumped at the nodes by linear hat functions: node j gets g times the integral of its hat
over [l, u]. So the conductances' first derivative in l and u is continuous and piecewise linear, the second jumps
where an end passes a node; readings inherit this. Giving a node its cell's overlap instead would make the first
derivative jump.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.errors import ContactError, NetworkError, SpecError, one_of
from tacstrip.network.nodal import Network
from tacstrip.sensor.spec import Sensor

Others: TypeAlias = Literal["floating", "tied grounds", "grounded"]
_OTHERS = ("floating", "tied grounds", "grounded")

_FEWEST, _MOST = 100, 400
_CELLS_PER_LAMBDA = 4.0
# A point conducts nothing; for so short a contact [L] the readings are those of a point to better than 1e-6.
SHORTEST = 1e-6


@dataclass(frozen=True)
class Wiring:
    """How a CRS-CRP sensor is resistors; the prototype of design.md by default.

    Attributes
    ----------
    others
        The strips that are not energised: "floating"; "tied grounds": all ground ends are one node;
        "grounded": both ends of all others lie on ground.
    common_bars
        Either edge of the sheet is one metal bar, so that all its electrodes read alike.
    """

    others: Others = "floating"
    common_bars: bool = False

    def __post_init__(self) -> None:
        if self.others not in _OTHERS:
            raise NetworkError(one_of("others", self.others, _OTHERS))


@dataclass(frozen=True)
class SheetMesh:
    """The sensor cut into cells; [mm], and conductances for r0 = 1 per [mm].

    Attributes
    ----------
    along, across
        Conductance of the sheet between two nodes of a column, and between two of a row.
    contact
        Conductance g of a contact per [mm].
    """

    strips: int
    rows: int
    length_mm: float
    along: float
    across: float
    contact: float

    @classmethod
    def of(cls, sensor: Sensor, rows: int | None = None) -> SheetMesh:
        """Cut a sensor into `rows` cells over its length; by default 4 per lambda, 100 to 400.

        Raises
        ------
        SpecError
            The sheet is not of rubber, lambda is 0, or `rows` is below 2.
        """
        ratio, lam = sensor.sensing_ratio, sensor.contact_lambda_mm
        if not ratio > 0.0:
            raise SpecError(
                f"resistivity_ratio = {ratio}: a CRS-CRP sheet of rubber must have one above 0 "
                "(100 or so reads best); metal is a CRS-M sensor"
            )
        if not lam > 0.0:
            raise SpecError(
                f"contact_lambda_mm = {lam}: the network of a CRS-CRP sensor needs a contact resistance; "
                "set it above 0 (a tenth of the shortest contact stands for an ideal one)"
            )
        if rows is None:
            rows = int(np.clip(np.ceil(_CELLS_PER_LAMBDA * sensor.length_mm / lam), _FEWEST, _MOST))
        if rows < 2:
            raise SpecError(f"rows = {rows}: a mesh needs 2 cells or more over the length")
        square = ratio * sensor.strip_width
        h, r1 = sensor.length_mm / rows, square / sensor.pitch_mm
        g = 1.0 / ((1.0 + r1) * lam**2)
        return cls(sensor.strips, rows, sensor.length_mm, 1.0 / (r1 * h), h / (square * sensor.pitch_mm), g)

    @property
    def h(self) -> float:
        """Distance of two nodes of a column [mm]."""
        return self.length_mm / self.rows

    def hat_lengths(self, l: FloatArray, u: FloatArray) -> FloatArray:
        """Integrate every node's hat function over the intervals [l, u] (P,): (P, rows + 1) [mm]."""
        node = np.arange(self.rows + 1.0)
        return np.asarray(
            self.h * (_hat_integral(u[:, None] / self.h - node) - _hat_integral(l[:, None] / self.h - node))
        )

    def hats_at(self, y: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return the two rows beside each y (P,) and their hats there: row of the lower (P,), hats (P, 2)."""
        row = np.clip(np.floor(y / self.h), 0, self.rows - 1).astype(np.int64)
        upper = y / self.h - row
        return row, np.stack([1.0 - upper, upper], axis=-1)


def _hat_integral(t: FloatArray) -> FloatArray:
    t = np.clip(t, -1.0, 1.0)
    return np.asarray(np.where(t < 0.0, 0.5 * (1.0 + t) ** 2, 1.0 - 0.5 * (1.0 - t) ** 2))


def checked_span(mesh: SheetMesh, l: FloatArray, u: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return the touched strips (T,) and their l and u (T,), no shorter than 1e-6 L.

    Raises
    ------
    ContactError
        Nothing is touched, or l and u are not two ends of a contact on the sensor.
    """
    l, u = np.asarray(l, dtype=float), np.asarray(u, dtype=float)
    if l.shape != (mesh.strips,) or u.shape != (mesh.strips,):
        raise ContactError(f"l and u have shapes {l.shape} and {u.shape}; give two of ({mesh.strips},)")
    on = np.isfinite(l) & np.isfinite(u)
    if not np.array_equal(on, ~(np.isnan(l) & np.isnan(u))):
        raise ContactError("l and u must be NaN on the same strips, and finite elsewhere")
    bad = np.flatnonzero(on & ~((l >= 0.0) & (l <= u) & (u <= mesh.length_mm)))
    if len(bad):
        i = bad[0]
        raise ContactError(
            f"strip {i}: a contact from {l[i]:.6g} to {u[i]:.6g} mm is not on the sensor "
            f"(0 <= l <= u <= {mesh.length_mm:.6g} mm)"
        )
    strip = np.flatnonzero(on)
    if not len(strip):
        raise ContactError(
            "nothing touches a strip: the sheet floats and reads nothing; check the contact's place"
        )
    shortest = SHORTEST * mesh.length_mm
    low = np.minimum(l[strip], mesh.length_mm - shortest)
    return strip, low, np.maximum(u[strip], low + shortest)


@dataclass(frozen=True, eq=False)
class ContactNetwork:
    """The resistors of one contact.

    Attributes
    ----------
    network
        Sheet, touched strips and contacts.
    strip
        The touched strips (T,).
    bottom, top
        Nodes of their ends (T,): to be put on ground and on Vref.
    electrode
        Nodes of the electrodes (2 strips,): at y = 0 in the order of the strips, then at y = L.
    strip_node, sheet_node
        Either side of the contact at every row (T, rows + 1); -1 where a strip has no node.
    """

    network: Network
    strip: IntArray
    bottom: IntArray
    top: IntArray
    electrode: IntArray
    strip_node: IntArray = field(repr=False)
    sheet_node: IntArray = field(repr=False)


def contact_network(mesh: SheetMesh, strip: IntArray, lengths: FloatArray, wiring: Wiring) -> ContactNetwork:
    """Join sheet, touched strips (T,) and contact, whose length at each node is (T, rows + 1) [mm]."""
    n, last = mesh.strips, mesh.rows
    sheet = np.arange(n * (last + 1)).reshape(n, last + 1)  # column, row
    rowed = np.arange(last + 1)
    first = np.argmax(lengths > 0.0, axis=1)[:, None]
    final = last - np.argmax(lengths[:, ::-1] > 0.0, axis=1)[:, None]
    # Beside its contact a strip is one resistor: it has nodes at its ends and along the contact only.
    has = (rowed == 0) | (rowed == last) | ((rowed >= first) & (rowed <= final))
    node = np.full(has.shape, -1)
    node[has] = sheet.size + np.arange(has.sum())
    across = np.full(last + 1, mesh.across)
    across[[0, -1]] *= 0.5  # half a cell
    at, row = np.nonzero(has)
    same = at[1:] == at[:-1]
    chain = node[has]
    touching = lengths > 0.0
    under = sheet[strip]
    parts = (
        (sheet[:, :-1].ravel(), sheet[:, 1:].ravel(), np.full(n * last, mesh.along)),
        (sheet[:-1].ravel(), sheet[1:].ravel(), np.tile(across, n - 1)),
        (chain[:-1][same], chain[1:][same], 1.0 / (mesh.h * (row[1:] - row[:-1])[same])),
        (node[touching], under[touching], mesh.contact * lengths[touching]),
    )
    start, end, siemens = (np.concatenate(column) for column in zip(*parts, strict=True))
    label = np.arange(sheet.size + len(chain))  # nodes that are one node have one label
    if wiring.common_bars:
        label[sheet[:, 0]], label[sheet[:, -1]] = sheet[0, 0], sheet[0, -1]
    if wiring.others == "tied grounds":
        label[node[:, 0]] = node[0, 0]
    real = label[start] != label[end]
    network = Network(len(label), label[start][real], label[end][real], siemens[real])
    electrode = label[np.concatenate([sheet[:, 0], sheet[:, -1]])]
    return ContactNetwork(
        network,
        strip,
        label[node[:, 0]],
        node[:, -1],
        electrode,
        np.where(has, label[node], -1),
        label[under],
    )
