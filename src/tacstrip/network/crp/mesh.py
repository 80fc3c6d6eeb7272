"""CRS-CRP (3.3) as resistors: strips over one uniform resistive sheet, n pitches wide and L long.

The sheet is cut into columns across (`spectral`: two or four a strip, as lambda asks for) and has nodes every h = L
/ rows along, the edges included. Potentials depend on ratios only, so an energised strip has r0 = 1 per [mm]. With
the sheet's square resistance Rs = resistivity_ratio r0 b (b: strip width), a column that stands for a width c has Rs
/ c per [mm]. A contact conducts g = 1 / ((r0 + r1) lambda^2) per [mm] over [l, u], r1 = Rs / pitch, spread evenly
over the strip's width.

Smoothness. The contact is lumped at the nodes by linear hat functions: node j gets g times the integral of its hat
over [l, u]. So the conductances' first derivative in l and u is continuous and piecewise linear, the second jumps
where an end passes a node; readings inherit this. Giving a node its cell's overlap instead would make the first
derivative jump.

A lumped contact takes its current up over a length shorter than the real one's. With d = e^(-y / lambda) the energy
integral of d'^2 + (d / lambda)^2 is 1 / lambda; linear pieces add -h^2 / 24 lambda^3 to its first term and lumping adds
4 h^2 / 24 lambda^3 to its second, so that lambda counts as lambda - h^2 / (8 lambda). Both ends are moved inwards by
what that shifts them, for the transfer length T = lambda tanh(w / 2 lambda) by h^2 / (8 lambda) dT / dlambda.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.errors import ContactError, NetworkError, SpecError, one_of
from tacstrip.network.crp.spectral import PitchElements
from tacstrip.network.nodal import Network
from tacstrip.sensor.spec import Sensor

Others: TypeAlias = Literal["floating", "tied grounds", "grounded"]
_OTHERS = ("floating", "tied grounds", "grounded")

_FEWEST, _MOST = 100, 400
_CELLS_PER_LAMBDA = 3.0
_MOST_INWARDS = 1.5  # lambda: no end passes the middle of its contact, however few the rows
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


@dataclass(frozen=True, eq=False)
class SheetMesh:
    """The sensor cut into cells; [mm], and conductances for r0 = 1 per [mm].

    Attributes
    ----------
    lambda_mm
        Decay length of the contact resistance.
    square
        Square resistance Rs of the sheet.
    contact
        Conductance g of a contact per [mm].
    pitch
        The columns of one pitch.
    wiring
        What the other strips and the sheet's edges are joined to.
    """

    strips: int
    rows: int
    length_mm: float
    lambda_mm: float
    square: float
    contact: float
    pitch: PitchElements
    wiring: Wiring

    @classmethod
    def of(
        cls, sensor: Sensor, rows: int | None = None, wiring: Wiring | None = None, coarse: bool = False
    ) -> SheetMesh:
        """Cut a sensor into `rows` cells over its length; by default 3 per lambda, 100 to 400.

        A coarse mesh has as few columns across as can be, whatever lambda is.

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
        g = 1.0 / ((1.0 + square / sensor.pitch_mm) * lam**2)
        decay = math.sqrt(sensor.strip_width / (square * g))  # lambda, across: the strip itself is one node
        pitch = PitchElements.of(sensor.pitch_mm, sensor.strip_width, decay, coarse)
        return cls(sensor.strips, rows, sensor.length_mm, lam, square, g, pitch, wiring or Wiring())

    @property
    def h(self) -> float:
        """Distance of two nodes of a column [mm]."""
        return self.length_mm / self.rows

    @property
    def error_mm(self) -> float:
        """Standard deviation of what the cut into cells moves the ends of a contact by [mm].

        Of the columns .003 lambda, of the rows .02 lambda (h / lambda)^2: `studies/crp_sheet.py`.
        """
        return self.lambda_mm * float(np.hypot(0.003, 0.02 * (self.h / self.lambda_mm) ** 2))

    def moved_inwards(self, l: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return where intervals [l, u] (P,) are lumped [mm], and d move / d u = - d move / d l (P,)."""
        z = 0.5 * (u - l) / self.lambda_mm
        tanh = np.tanh(z)
        steep = 1.0 - tanh**2
        most = min(self.h**2 / (8.0 * self.lambda_mm), _MOST_INWARDS * self.lambda_mm)
        move = most * (tanh - z * steep)
        return l + move, u - move, most * z * steep * tanh / self.lambda_mm

    def hat_lengths(self, l: FloatArray, u: FloatArray) -> FloatArray:
        """Integrate every node's hat function over the intervals [l, u] (P,), moved inwards: (P, rows + 1) [mm]."""
        node = np.arange(self.rows + 1.0)
        low, high, _ = self.moved_inwards(l, u)
        below_high, below_low = (_hat_integral(end[:, None] / self.h - node) for end in (high, low))
        return np.asarray(self.h * (below_high - below_low))

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
        Either side of the contact at every row (T, rows + 1) and, of the sheet, column (T, K, rows + 1); -1 where a
        strip has no node.
    centre_node
        The sheet's nodes on the strips' centre lines (strips, rows + 1).
    line
        All nodes as lines along the strips, across: of each pitch the sheet's columns and its strip, then the last
        column (strips (columns a pitch + 1) + 1, rows + 1); -1 where there is none.
    """

    network: Network
    strip: IntArray
    bottom: IntArray
    top: IntArray
    electrode: IntArray
    strip_node: IntArray = field(repr=False)
    sheet_node: IntArray = field(repr=False)
    centre_node: IntArray = field(repr=False)
    line: IntArray = field(repr=False)


def contact_network(mesh: SheetMesh, strip: IntArray, lengths: FloatArray) -> ContactNetwork:
    """Join sheet, touched strips (T,) and contact, whose length at each node is (T, rows + 1) [mm]."""
    pitch, last = mesh.pitch, mesh.rows
    per = len(pitch.widths) - 1
    # Of each strip: the outer ones are shared.
    column = np.arange(mesh.strips)[:, None] * per + np.arange(per + 1)
    columns = mesh.strips * per + 1
    width = np.bincount(column.ravel(), np.tile(pitch.widths, mesh.strips), columns)
    sheet = np.arange(columns * (last + 1)).reshape(columns, last + 1)  # column, row
    rowed = np.arange(last + 1)
    first = np.argmax(lengths > 0.0, axis=1)[:, None]
    final = last - np.argmax(lengths[:, ::-1] > 0.0, axis=1)[:, None]
    # Beside its contact a strip is one resistor: it has nodes at its ends and along the contact only.
    has = (rowed == 0) | (rowed == last) | ((rowed >= first) & (rowed <= final))
    node = np.full(has.shape, -1)
    node[has] = sheet.size + np.arange(has.sum())
    cell = np.full(last + 1, mesh.h)
    cell[[0, -1]] *= 0.5
    at, row = np.nonzero(has)
    same = at[1:] == at[:-1]
    chain = node[has]
    beneath = np.flatnonzero(pitch.under)
    under = sheet[column[strip][:, beneath]]  # (T, K, rows + 1)
    touching = np.broadcast_to((lengths > 0.0)[:, None], under.shape)
    shared = mesh.contact * pitch.under[beneath][:, None] * lengths[:, None]  # (T, K, rows + 1)
    joined = np.outer(pitch.stiffness, cell) / mesh.square
    parts = (
        (sheet[:, :-1].ravel(), sheet[:, 1:].ravel(), np.repeat(width / (mesh.square * mesh.h), last)),
        (
            sheet[column[:, pitch.first]].ravel(),
            sheet[column[:, pitch.second]].ravel(),
            np.tile(joined.ravel(), mesh.strips),
        ),
        (chain[:-1][same], chain[1:][same], 1.0 / (mesh.h * (row[1:] - row[:-1])[same])),
        (np.broadcast_to(node[:, None], under.shape)[touching], under[touching], shared[touching]),
    )
    start, end, siemens = (np.concatenate(part) for part in zip(*parts, strict=True))
    label = np.arange(sheet.size + len(chain))  # nodes that are one node have one label
    if mesh.wiring.common_bars:
        label[sheet[:, 0]], label[sheet[:, -1]] = sheet[0, 0], sheet[0, -1]
    if mesh.wiring.others == "tied grounds":
        label[node[:, 0]] = node[0, 0]
    real = label[start] != label[end]
    network = Network(len(label), label[start][real], label[end][real], siemens[real], signed=True)
    centre = label[sheet[column[:, pitch.middle]]]
    electrode, strip_node = np.concatenate([centre[:, 0], centre[:, -1]]), np.where(has, label[node], -1)
    ends = label[node[:, 0]], node[:, -1]
    line = np.full((mesh.strips, per + 1, last + 1), -1)
    line[:, :per], line[strip, per] = label[sheet[column[:, :-1]]], strip_node
    lines = np.concatenate([line.reshape(-1, last + 1), label[sheet[-1:]]])
    return ContactNetwork(network, strip, *ends, electrode, strip_node, label[under], centre, lines)
