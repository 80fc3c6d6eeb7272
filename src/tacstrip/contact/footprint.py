"""Where a contact touches each strip: l and u [mm].

An area touches a strip along the strip's centre line; a line or a point touches the strip's whole width.
Coordinates across the strips are counted in pitches from the first centre line, so that strip i is the
integer i, and what lies within 1e-9 pitches of a centre line is taken to lie on it (contacts are closed).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np
import shapely

from tacstrip.arguments import takes
from tacstrip.arrays import BoolArray, FloatArray, IntArray, extent, touched_strips
from tacstrip.contact.shape import Contact
from tacstrip.core.binding import at, exported
from tacstrip.sensor.spec import Sensor

Intervals: TypeAlias = tuple[IntArray, FloatArray, FloatArray]

_ON_LINE = 1e-9  # pitches


@dataclass(frozen=True)
class Footprint:
    """The contact on each strip; iterates as (l, u).

    Attributes
    ----------
    l, u
        Lower and upper end of the contact [mm], (strips,) for one contact or (contacts, strips) for
        many; NaN where a strip is not touched. Where a contact meets a strip in several pieces they
        are the ends of the outer hull: see `pieces`.
    clipped
        Whether a part of the contact lay off the sensor and was cut away.

    Examples
    --------
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-crs", strips=4, pitch_mm=10.0, length_mm=50.0)
    >>> l, u = ts.footprint(sensor, ts.Contact.polygon([(10, 10), (30, 10), (30, 30), (10, 30)]))
    >>> l.tolist(), u.tolist()
    ([nan, 10.0, 10.0, nan], [nan, 30.0, 30.0, nan])
    """

    l: FloatArray
    u: FloatArray
    clipped: bool
    _sensor: Sensor
    _contacts: tuple[Contact, ...]

    def __repr__(self) -> str:
        strips = touched_strips(np.asarray(np.isfinite(np.atleast_2d(self.l)).any(axis=0)))
        many = f" of {len(self._contacts)} contacts" if self.l.ndim > 1 else ""
        cut = ", clipped" if self.clipped else ""
        return f"<Footprint{many}: {strips}, l {extent(self.l)}, u {extent(self.u)} mm{cut}>"

    def __iter__(self) -> Iterator[FloatArray]:
        return iter((self.l, self.u))

    @cached_property
    def intervals(self) -> list[Intervals]:
        """The separate pieces themselves, for each contact: strip (P,), low and high end (P,) [mm]."""
        return [_intervals(self._sensor, contact) for contact in self._contacts]

    @cached_property
    def pieces(self) -> IntArray:
        """Number of separate pieces on each strip, shape of `l`; above 1 means that l, u is a hull."""
        counts = [np.bincount(strip, minlength=self._sensor.strips) for strip, _, _ in self.intervals]
        return np.stack(counts).reshape(self.l.shape)


@takes(sensor=Sensor, contact=(Contact, Sequence))
def footprint(sensor: Sensor, contact: Contact | Sequence[Contact]) -> Footprint:
    """Find l and u of one contact on every strip, or of many contacts at once.

    Parameters
    ----------
    sensor
        Its strips, pitch, length and strip width count.
    contact
        One contact, or a sequence of them. Round a closed tube x counts modulo the circumference.

    Returns
    -------
    Footprint
        l and u [mm], (strips,) for one contact, (contacts, strips) for a sequence; NaN where nothing touches.

    Raises
    ------
    ContactError
        A contact lies wholly outside the sensor.

    Examples
    --------
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-crs", strips=4, pitch_mm=10.0, length_mm=100.0)
    >>> l, u = ts.footprint(sensor, ts.Contact.polygon([(10, 20), (30, 20), (30, 50), (10, 50)]))
    >>> u.tolist()
    [nan, 50.0, 50.0, nan]
    """
    contacts = [contact] if isinstance(contact, Contact) else list(contact)
    outside, l, u = _hulls(sensor, contacts)
    if isinstance(contact, Contact):
        l, u = l[0], u[0]
    cut = outside[:, 1:] if sensor.closed else outside
    return Footprint(l, u, bool(cut.any()), sensor, tuple(contacts))


def contact_ends(sensor: Sensor, contact: Contact) -> tuple[FloatArray, FloatArray]:
    """Return l and u of `footprint` alone, of one contact (strips,) [mm]."""
    _, l, u = _hulls(sensor, [contact])
    return l[0], u[0]


def _hulls(sensor: Sensor, contacts: list[Contact]) -> tuple[BoolArray, FloatArray, FloatArray]:
    """Clip contacts in place; return which reached beyond (contacts, 2), and l and u (contacts, strips) [mm]."""
    outside = _sticks_out(sensor, contacts)
    for number in np.flatnonzero(outside.any(axis=1)) if outside.any() else ():
        contacts[number] = on_sensor(sensor, contacts[number])
    l, u = _area_ends(sensor, contacts)
    if any(s.geom_type != "Polygon" for c in contacts for s in c.shapes):
        index, y0, y1 = _thin_touches(sensor, contacts)
        np.fmin.at(l.reshape(-1), index, np.minimum(y0, y1))
        np.fmax.at(u.reshape(-1), index, np.maximum(y0, y1))
    return outside, l, u


def _area_ends(sensor: Sensor, contacts: Sequence[Contact]) -> tuple[FloatArray, FloatArray]:
    """Return l and u of the areas alone (contacts, strips) [mm], NaN where none touches."""
    shape = (len(contacts), sensor.strips)
    if (core := exported("footprint")) is not None:
        points, ring, owner = _points(contacts, "Polygon")
        if len(contacts) == 1:
            begin = np.array((0, len(points)), dtype=np.int64)
        else:
            begin = owner.searchsorted(np.arange(len(contacts) + 1))
        size = math.prod(shape)
        ends = np.empty((2, size + 4))
        low, high = at(ends), at(ends) + ends.strides[0]
        core(at(points), at(ring), at(begin), len(contacts), sensor.pitch_mm, sensor.strips, low, high)
        l, u = ends[:, :size].reshape(2, *shape)
        return l, u
    l, u = np.full(shape, np.nan), np.full(shape, np.nan)
    area = _area_crossings(sensor, contacts)
    index = area.owner * sensor.strips + area.strip
    np.fmin.at(l.reshape(-1), index, area.y)
    np.fmax.at(u.reshape(-1), index, area.y)
    return l, u


def on_sensor(sensor: Sensor, contact: Contact) -> Contact:
    """Return what of a contact lies on the sensor; round a closed tube x goes on at the other side of the seam.

    Raises
    ------
    ContactError
        It lies wholly outside.
    """
    if sensor.closed:
        around = sensor.width_mm
        x = shapely.bounds(np.array(contact.shapes))[:, [0, 2]]
        rounds = np.arange(np.ceil(x.min() / around) - 1.0, np.floor(x.max() / around) + 1.0)
        contact = Contact(tuple(s for r in rounds for s in contact.moved(-r * around, 0.0).shapes))
    return contact.clipped(sensor.width_mm, sensor.length_mm, "sensor")


def _sticks_out(sensor: Sensor, contacts: Sequence[Contact]) -> BoolArray:
    """Tell which contacts reach beyond the sensor in x and in y (contacts, 2)."""
    shapes = [s for c in contacts for s in c.shapes]
    if len(shapes) == 1 and not sensor.closed:
        x0, y0, x1, y1 = shapely.bounds(shapes[0]).tolist()
        return np.array([[x0 < 0.0 or x1 > sensor.width_mm, y0 < 0.0 or y1 > sensor.length_mm]])
    bounds = shapely.bounds(shapes)  # (shapes, 4)
    out = (bounds[:, :2] < 0.0) | (bounds[:, 2:] > (sensor.width_mm, sensor.length_mm))
    if sensor.closed:  # what only reaches the seam touches the strips on both sides
        out[:, 0] = (bounds[:, 0] <= 0.0) | (bounds[:, 2] >= sensor.width_mm)
    if len(shapes) == len(contacts):
        return np.asarray(out)
    owner = np.repeat(np.arange(len(contacts)), [len(c.shapes) for c in contacts])
    return np.stack([np.bincount(owner, weights=o, minlength=len(contacts)) > 0 for o in out.T], axis=1)


def _edges(contacts: Sequence[Contact], kind: str) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return starts (E, 2), ends (E, 2) and owners (E,) of all edges of the shapes of one kind."""
    xy, line, owner = _points(contacts, kind)
    if kind == "Point":
        return xy, xy, owner
    joined = np.flatnonzero(line[1:] == line[:-1])
    return xy[joined], xy[joined + 1], owner[joined]


def _points(contacts: Sequence[Contact], kind: str) -> tuple[FloatArray, IntArray, IntArray]:
    """Return the points (P, 2) [mm] of the shapes of one kind, which line or ring each is of, and which contact."""
    if len(contacts) == 1 and len(contacts[0].shapes) == 1:
        only = contacts[0].shapes[0]
        if only.geom_type == kind and not (kind == "Polygon" and len(only.interiors)):
            xy = shapely.get_coordinates(only)
            return xy, (none := np.zeros(len(xy), dtype=np.int64)), none
    pairs = [(s, i) for i, c in enumerate(contacts) for s in c.shapes if s.geom_type == kind]
    lines = np.array([s for s, _ in pairs])
    owner = np.array([i for _, i in pairs], dtype=np.int64)
    if kind == "Polygon" and shapely.get_num_interior_rings(lines).any():
        lines, part = shapely.get_rings(lines, return_index=True)
        owner = owner[part]
    xy, line = shapely.get_coordinates(lines, return_index=True)
    return xy, line, owner[line]


def _strip_coordinate(sensor: Sensor, x_mm: FloatArray) -> FloatArray:
    s = x_mm / sensor.pitch_mm - 0.5
    nearest = np.round(s)
    return np.where(np.abs(s - nearest) < _ON_LINE, nearest, s)


def _over_strips(sensor: Sensor, low: FloatArray, high: FloatArray) -> tuple[IntArray, IntArray]:
    """List, for ranges [low, high] in strip coordinates, each range's index with each strip in it."""
    first = np.maximum(np.ceil(low), 0).astype(np.int64)
    last = np.minimum(np.floor(high), sensor.strips - 1).astype(np.int64)
    count = np.maximum(last - first + 1, 0)
    which = np.repeat(np.arange(len(count)), count)
    return which, np.arange(count.sum()) - np.repeat(np.cumsum(count) - count - first, count)


@dataclass(frozen=True)
class _Crossings:
    """Where polygon edges cross centre lines, one entry per edge and strip."""

    owner: IntArray
    strip: IntArray
    y: FloatArray
    s0: FloatArray  # strip coordinates of the edge's ends
    s1: FloatArray


def _area_crossings(sensor: Sensor, contacts: Sequence[Contact]) -> _Crossings:
    start, end, owner = _edges(contacts, "Polygon")
    s0, s1 = _strip_coordinate(sensor, start[:, 0]), _strip_coordinate(sensor, end[:, 0])
    edge, strip = _over_strips(sensor, np.minimum(s0, s1), np.maximum(s0, s1))
    # An edge along a centre line adds its start; its neighbours add the rest.
    run = np.where(s1 == s0, 1.0, s1 - s0)[edge]
    t = (strip - s0[edge]) / run
    y = (1.0 - t) * start[edge, 1] + t * end[edge, 1]
    return _Crossings(owner[edge], strip, y, s0[edge], s1[edge])


def _thin_touches(sensor: Sensor, contacts: Sequence[Contact]) -> tuple[IntArray, FloatArray, FloatArray]:
    """Cut lines and points to the strips' bands: flat (contact, strip) index and both ends' y."""
    both = [_edges(contacts, kind) for kind in ("LineString", "Point")]
    start, end, owner = (np.concatenate([b[i] for b in both]) for i in range(3))
    s0, s1 = start[:, 0] / sensor.pitch_mm - 0.5, end[:, 0] / sensor.pitch_mm - 0.5
    half = 0.5 * sensor.strip_width / sensor.pitch_mm
    reach = half + _ON_LINE
    edge, strip = _over_strips(sensor, np.minimum(s0, s1) - reach, np.maximum(s0, s1) + reach)
    run = (s1 - s0)[edge]
    safe = np.where(run == 0.0, 1.0, run)
    a, b = (strip - half - s0[edge]) / safe, (strip + half - s0[edge]) / safe
    t0 = np.where(run == 0.0, 0.0, np.clip(np.minimum(a, b), 0.0, 1.0))
    t1 = np.where(run == 0.0, 1.0, np.clip(np.maximum(a, b), 0.0, 1.0))
    y0, rise = start[edge, 1], (end - start)[edge, 1]
    return owner[edge] * sensor.strips + strip, y0 + t0 * rise, y0 + t1 * rise


def _intervals(sensor: Sensor, contact: Contact) -> Intervals:
    """Find the separate intervals of one contact, strip by strip and upwards."""
    touches = [_thin_touches(sensor, [contact])]
    # Shape by shape: areas that overlap are one piece.
    c = _area_crossings(sensor, [Contact((shape,)) for shape in contact.shapes])
    # On a centre line the contact is what lies just left of it and just right of it, both closed.
    for beside in (np.less, np.less_equal):
        crossing = beside(c.s0, c.strip) != beside(c.s1, c.strip)
        order = np.lexsort((c.y[crossing], c.owner[crossing], c.strip[crossing]))
        ends, where = c.y[crossing][order], c.strip[crossing][order]
        touches.append((where[::2], ends[::2], ends[1::2]))
    strips, y0, y1 = (np.concatenate([t[i] for t in touches]) for i in range(3))
    low, high = np.minimum(y0, y1), np.maximum(y0, y1)
    order = np.lexsort((low, strips))
    merged: list[tuple[int, float, float]] = []
    for i in order:
        if merged and merged[-1][0] == strips[i] and low[i] <= merged[-1][2] + _ON_LINE * sensor.pitch_mm:
            merged[-1] = (merged[-1][0], merged[-1][1], max(merged[-1][2], high[i]))
        else:
            merged.append((int(strips[i]), float(low[i]), float(high[i])))
    where, first, last = (np.array(c) for c in zip(*merged, strict=True)) if merged else (np.empty(0),) * 3
    return where.astype(np.int64), first, last
