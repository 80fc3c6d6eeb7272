"""Many poses of an object in a skin at once: what each would read, and how far that is from a scan.

A pose is a place on the skin, the depth there, how the object is turned about the skin's normal, along which it came,
and the logarithm of a radius. Places are those of a plane that touches the skin where the readings are, so that
nothing is singular where meridians meet.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Self, TypeAlias

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.contact.noise import Noise
from tacstrip.contact.press.patch import samples
from tacstrip.contact.press.solid import Solid
from tacstrip.contact.signature import signatures
from tacstrip.core.solid import solid_touch
from tacstrip.reconstruction.noise_covariance import Averaging, reading_covariance
from tacstrip.scan import Scan
from tacstrip.sensor.closed_form import lower_and_width
from tacstrip.sensor.left_out import left_out_wholly
from tacstrip.sensor.resistance import ends_from_electrical
from tacstrip.sensor.spec import Sensor
from tacstrip.surface.skin import Skin, skin_of

TURNS = {"cylinder": math.pi, "edge": math.pi, "box": math.pi, "mesh": 2.0 * math.pi}  # until it is alike
GUESS = 0.005  # of Vref: sigma where the noise is not known and too few readings are left to tell it
TOUCH_MM = 0.03  # standard deviation of the depth from which a strip reads
_SAMPLES, _ROOTS = 64, 5  # along a strip; steps that place an end between two of them
_FEW_SAMPLES, _ROUGH_MM, _BORDER = 16, 0.1, 0.01  # of what starts are compared by; share of a strip's length
_TOGETHER = 48  # poses; more at once are no faster
_WIDTH_MM, _SHORT_MM = 0.3, 1e-3  # that a strip reads over, about; of differences
_LINE_MM = 0.05  # depth of a strip below which descents on the way do not take it for its centre line
_LOG_RADIUS = 1.5  # how far, as a logarithm, the radius may be from the one given: hardly a prior
_FLATTER = 4.0  # times a spherical skin's radius: caps of balls that large need the least depth
_CHART_STEPS = 8  # from a place on the skin to the tangent plane, where a step leaves a tenth
_RADII = (-5.0, 8.0)  # of the logarithm
_OPENINGS = (0.1, 3.1)  # of an edge's or cone's angle [rad]
_BEND_MM, _MOST_BENT = 10.0, 3.0  # over which radius a bend is 1; how far it may be from 0: hardly a prior

_Touch: TypeAlias = Callable[[FloatArray, Callable[[], FloatArray]], FloatArray]


@dataclass(frozen=True, eq=False)
class Poses:
    """One scan's readings k (S, n), which of them count, and the family of objects.

    Attributes
    ----------
    white
        What makes the errors of all readings independent, of variance 1 (R, R).
    names
        Of the parameters (P,).
    origin, tangents
        Place on the skin about which poses are told (3,) [mm]; two directions along it (2, 3).
    ends_read
        About where contacts end on strips: l and u (strips,) [mm].
    sigma
        Standard deviations of the readings' errors (R,).
    """

    sensor: Sensor
    skin: Skin
    solid: Solid
    k: FloatArray
    touched: BoolArray
    silent: BoolArray
    white: FloatArray
    read: tuple[str, ...]
    names: tuple[str, ...]
    origin: FloatArray
    tangents: FloatArray
    ends_read: tuple[FloatArray, FloatArray]
    noise: Noise | None
    sigma: FloatArray

    @classmethod
    def of(cls, scan: Scan, sensor: Sensor, solid: Solid, noise: Noise | None, known_size: bool) -> Self:
        """Prepare the poses that a scan is compared with."""
        skin, k = skin_of(sensor), np.stack([scan[name] for name in scan.signatures])
        ends = _ends_read(sensor, scan)
        origin, tangents = _middle(skin, scan, ends)
        names = ["across_mm", "along_mm", "depth_mm"]
        if solid.kind in ("sphere", "cylinder") and not known_size:
            if solid.kind == "sphere" and cap(skin) and skin.surface is not None:
                if not skin.surface.inside:
                    solid = replace(
                        solid, size=(max(solid.size[0], _FLATTER * float(skin.surface.radius_mm or 0.0)),)
                    )
            else:
                names.append("log_radius")
        names += ["turn_rad"] * (solid.kind in TURNS)
        read = ~np.isnan(k)
        count = int(read.sum())
        white, sigma = np.eye(count) / GUESS, np.full(count, GUESS)
        if noise is not None:
            errors = reading_covariance(
                noise, sensor, sensor.x_mm, ends, scan.signatures, Averaging.of(scan)
            )[np.ix_(read.ravel(), read.ravel())]  # fmt: skip
            white, sigma = np.linalg.inv(np.linalg.cholesky(errors)), np.sqrt(np.diag(errors))
        silent = ~scan.touched & ~left_out_wholly(sensor)
        return cls(
            sensor, skin, solid, k, scan.touched, silent, white, scan.signatures, tuple(names), origin, tangents,
            ends, noise, sigma,
        )  # fmt: skip

    def column(self, name: str) -> int | None:
        """Return which parameter is called so; None where the family has none."""
        return self.names.index(name) if name in self.names else None

    @cached_property
    def readings(self) -> int:
        """How many readings are compared."""
        return len(self.white)

    @property
    def pull(self) -> float:
        """One over how far the logarithm of the radius may be from the one given."""
        return 1.0 / _LOG_RADIUS

    def _value(self, values: FloatArray, name: str, otherwise: float) -> FloatArray:
        at = self.column(name)
        return np.full(len(values), otherwise) if at is None else values[:, at]

    def radii(self, values: FloatArray) -> FloatArray:
        """Return the radii (M,) [mm] of parameters (M, P); 1 where the family has none."""
        if self.solid.kind not in ("sphere", "cylinder"):
            return np.ones(len(values))
        return np.exp(np.clip(self._value(values, "log_radius", math.log(self.solid.size[0])), *_RADII))

    def _bases(self, near: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return places on the skin (M, 3), normals and first directions there, of points near it (M, 3)."""
        across, up = self.skin.places_near(near)
        if self.skin.surface is not None and self.skin.round:  # also beyond the skin's border
            r, z = np.hypot(near[:, 0], near[:, 1]), near[:, 2]
            for _ in range(2):
                mr, mz, dr, dz = self.skin.surface.meridian(up)
                up = up + (r - mr) * dr + (z - mz) * dz
        normal = self.skin.normals(across, up)
        first = self.tangents[0] - (normal @ self.tangents[0])[:, None] * normal
        return self.skin.points(across, up), normal, first / np.linalg.norm(first, axis=1, keepdims=True)

    def frames(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return where the objects of parameters (M, P) are (M, 3) [mm], and their axes (M, 3, 3)."""
        place, normal, first = self._bases(self.origin + values[:, :2] @ self.tangents)
        turn = self._value(values, "turn_rad", 0.0)[:, None]
        x = np.cos(turn) * first + np.sin(turn) * np.cross(normal, first)
        return place - values[:, 2:3] * normal, np.stack([x, np.cross(normal, x), normal], axis=1)

    def values_of(self, solid: Solid) -> FloatArray:
        """Return the parameters (P,) of an object in the skin, the inverse of `solids`."""
        (place,), (normal,), (first,) = self._bases(solid.position_mm[None])
        aside = (place - self.origin) @ self.tangents.T
        for _ in range(_CHART_STEPS):
            (found,), _, _ = self._bases((self.origin + aside @ self.tangents)[None])
            aside = aside + (place - found) @ self.tangents.T
        known = {
            "across_mm": aside[0], "along_mm": aside[1], "depth_mm": (place - solid.position_mm) @ normal,
            "log_radius": math.log(solid.size[0]) if solid.size else 0.0,
            "turn_rad": math.atan2(solid.axes[0] @ np.cross(normal, first), solid.axes[0] @ first),
        }  # fmt: skip
        return np.array([known[name] for name in self.names])

    def solids(self, values: FloatArray) -> list[Solid]:
        """Return the objects of parameters (M, P)."""
        sizes = [self.solid.size] * len(values)
        if self.solid.kind in ("sphere", "cylinder"):
            sizes = [(float(radius),) for radius in self.radii(values)]
        elif (at := self.column("opening")) is not None:
            sizes = [(float(angle),) for angle in np.clip(values[:, at], *_OPENINGS)]
        return [
            replace(self.solid, position_mm=place, axes=axes, size=size)
            for place, axes, size in zip(*self.frames(values), sizes, strict=True)
        ]

    def residuals(self, values: FloatArray, touch_mm: float = TOUCH_MM, smooth: bool = False) -> FloatArray:
        """Return what is left at parameters (M, P): of whitened readings, of touch and silence, of what hardly counts.

        Half their squares is minus the logarithm of the likelihood: a strip reads where the object is as deep as a
        depth that is known to `touch_mm`. `smooth`: by a rule for strips hardly touched that descents can follow.
        """
        return np.concatenate([
            self._residuals(values[i : i + _TOGETHER], touch_mm, smooth) for i in range(0, len(values), _TOGETHER)
        ])  # fmt: skip

    def _residuals(self, values: FloatArray, touch_mm: float, smooth: bool) -> FloatArray:
        touch, here = self._touch(values), ~np.isnan(self.k)
        read = np.flatnonzero(here.any(axis=0))
        ends, deepest, y_top = self._ends(touch, touch_mm, read)
        k = self._readings(ends, read)
        if smooth:
            spread = np.repeat(
                (_LINE_MM / np.maximum(deepest, 0.2 * _LINE_MM))[:, None], len(self.k), axis=1
            )[:, here]
        else:  # strips are no lines
            beside = self._readings(self._aside(touch, ends, deepest, y_top, read), read)
            spread = np.nan_to_num(beside - k) / self.sigma
        off, looser = self.k[here] - k, 1.0 + np.square(spread)
        left = (np.nan_to_num(off, nan=1.0) / np.sqrt(looser)) @ self.white.T
        sign = np.where(self.touched, 1.0, -1.0)
        lost = np.where(self.touched | self.silent, _misfit(sign * deepest / touch_mm), 0.0)
        return np.concatenate([left, lost, np.sqrt(np.log(looser)), self._hardly(values)], axis=1)

    def _readings(self, ends: FloatArray, strips: IntArray) -> FloatArray:
        """Return what is read (M, R) of ends (M, E, 2) [mm] on strips (E,)."""
        l, u = np.full((2, len(ends), self.k.shape[1]), np.nan)
        l[:, strips], u[:, strips] = ends[..., 0], ends[..., 1]
        read = signatures(self.sensor, l, u)
        return np.stack([read[name] for name in self.read], axis=1)[:, ~np.isnan(self.k)]

    def _hardly(self, values: FloatArray) -> FloatArray:
        """Return residuals of what is known beforehand: hardly anything, but how thick the skin is."""
        depth, thick = values[:, 2], self.skin.thickness_mm
        hardly = [(np.maximum(depth - thick, 0.0) + np.maximum(-depth, 0.0)) / TOUCH_MM]
        reach = max(self.sensor.length_mm, self.sensor.width_mm)
        hardly += [values[:, 0] / reach, values[:, 1] / reach]
        if (at := self.column("log_radius")) is not None:
            hardly.append((values[:, at] - math.log(self.solid.size[0])) * self.pull)
        if (at := self.column("turn_rad")) is not None:
            hardly.append(values[:, at] / (2.0 * TURNS.get(self.solid.kind, math.pi)))
        if (at := self.column("bend")) is not None:
            hardly.append(values[:, at] / _MOST_BENT)
        return np.stack(hardly, axis=1)

    def _touch(self, values: FloatArray) -> _Touch:
        """Return what gives the touch (M, ...) of objects (M, P) at points (M or 1, ..., 3), of normals where asked."""
        solids, thick, bend = self.solids(values), self.skin.thickness_mm, self.column("bend")
        frames, kind = np.stack([solid.frame for solid in solids]), self.solid.kind
        # Only objects that go deeper than they are thick reach under places beside the patch.
        round_ = kind in ("sphere", "cylinder")
        reaches = kind != "plane" and not (round_ and (values[:, 2] <= 0.8 * self.radii(values)).all())
        straight = np.concatenate(
            [np.tile([1.0, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0], (len(frames), 1)), frames[:, 12:]], axis=1
        )

        def touch(points: FloatArray, normals: Callable[[], FloatArray]) -> FloatArray:
            shape = points.shape[1:-1]
            if self.solid.mesh is not None:  # in its frame, all rays at once
                axes = frames[:, :9].reshape(-1, 3, 3).swapaxes(1, 2)
                q = (points.reshape(len(points), -1, 3) - frames[:, None, 9:12]) @ axes
                out = normals().reshape(len(points), -1, 3) @ axes
                found = self.solid.mesh.indentation(q, out, thick)
                return np.minimum(found, thick).reshape(len(values), *shape)
            p, n = (
                None if v is None else v.transpose(-1, *range(v.ndim - 1)).reshape(3, len(v), -1)
                for v in (points, normals() if reaches else None)
            )
            assert p is not None
            if bend is not None:
                p, n = _bent(frames, values[:, bend], p, n)
                return solid_touch(kind, straight, p, n, thick).reshape(len(values), *shape)
            return solid_touch(kind, frames, p, n, thick).reshape(len(values), *shape)

        return touch

    def depth_residuals(self, values: FloatArray) -> FloatArray:
        """Return how deep the places where contacts were read to end lie in objects (M, P), which should be 0; rough.

        In between they should lie in it, and silent strips should not. Slopes lead there from far, as those of
        readings, which know nothing of strips that are not touched, do not.
        """
        touch, (l, u) = self._touch(values), self.ends_read
        on, off = np.flatnonzero(self.touched), np.flatnonzero(self.silent)
        length = self.skin.lengths_mm[on]
        y = np.stack([l[on], u[on], 0.5 * (l + u)[on]], axis=1)
        place = self.skin.places(on[:, None].astype(float), y)
        g = touch(self.skin.points(*place)[None], lambda: self.skin.normals(*place)[None])
        open_ = np.stack([l[on] < _BORDER * length, u[on] > (1.0 - _BORDER) * length, on >= 0], axis=1)
        left = [np.where(open_, np.minimum(g, 0.0), g).reshape(len(values), -1)]
        if len(off):
            _, _, points, normals = samples(self.skin, _FEW_SAMPLES)
            deepest = touch(points[None, off], lambda: normals[None, off]).max(axis=2)
            left.append(np.maximum(deepest, 0.0))
        return np.concatenate([*(part / _ROUGH_MM for part in left), self._hardly(values)], axis=1)

    def ends(self, values: FloatArray, touch_mm: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return l and u (M, strips) [mm] of parameters (M, P), and how deep the object is on each strip at most."""
        ends, deepest, _ = self._ends(self._touch(values), touch_mm, np.arange(self.skin.strips))
        return ends[..., 0], ends[..., 1], deepest

    def _ends(
        self, touch: _Touch, touch_mm: float, strips: IntArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return ends on strips (M, E, 2) [mm], how deep objects are on every one at most (M, n), and there y (M, E).

        Of a strip that is not touched, or less deep than a tenth of `touch_mm`, ends are those of what lies so much
        higher at most, so that they move as the object does.
        """
        strip, y, points, normals = samples(self.skin, _SAMPLES)
        g = touch(points[None], lambda: normals[None])  # (M, n, S)
        last, rows = _SAMPLES - 1, np.arange(len(strip))
        step = y[:, 1] - y[:, 0]
        at_top = np.clip(g.argmax(axis=2), 1, last - 1)
        a, b, c = (np.take_along_axis(g, at_top[..., None] + i, axis=2)[..., 0] for i in (-1, 0, 1))
        with np.errstate(divide="ignore", invalid="ignore"):  # the top of a parabola through three samples
            top = np.clip(np.nan_to_num(0.5 * (a - c) / (a - 2.0 * b + c)), -1.0, 1.0)
        y_top = y[rows, at_top] + top * step
        g_top = self._touch_at(touch, strip[:, None], y_top[..., None])[..., 0]
        highest = g.max(axis=2)
        y_top = np.where(g_top >= highest, y_top, y[rows, g.argmax(axis=2)])
        every = np.maximum(highest, g_top)
        g, y, y_top, highest, deepest = (v[:, strips] for v in (g, y[None], y_top, highest, every))
        (y,), step, rows = y, step[strips], np.arange(len(strips))
        touch_at = partial(self._touch_at, touch, strip[strips, None])
        level = np.minimum(deepest - 0.1 * touch_mm, 0.0)
        on = g > level[..., None]
        any_on = on.any(axis=2)
        first, final = on.argmax(axis=2), last - on[..., ::-1].argmax(axis=2)
        before = np.where(any_on, first - 1, np.floor(y_top / step).astype(int))
        after = np.where(any_on, final + 1, np.floor(y_top / step).astype(int) + 1)
        inner = np.stack(
            [np.where(any_on, y[rows, first], y_top), np.where(any_on, y[rows, final], y_top)], axis=2
        )
        outer = np.stack([y[rows, np.clip(before, 0, last)], y[rows, np.clip(after, 0, last)]], axis=2)
        border = outer
        # The top may lie beyond the outermost sample that touches.
        inner[..., 0] = np.where(deepest > highest, np.minimum(inner[..., 0], y_top), inner[..., 0])
        inner[..., 1] = np.where(deepest > highest, np.maximum(inner[..., 1], y_top), inner[..., 1])
        high, low = (touch_at(v) - level[..., None] for v in (inner, outer))
        beyond, was = low >= 0.0, np.zeros(low.shape)  # the strip ends first; the side of the last step
        now = outer
        for _ in range(_ROOTS):  # regula falsi, by Illinois
            with np.errstate(divide="ignore", invalid="ignore"):
                share = high / (high - low)
            now = inner + np.clip(np.where(np.isnan(share), 0.5, share), 0.0, 1.0) * (outer - inner)
            here = touch_at(now) - level[..., None]
            inside = here > 0.0
            side = np.where(inside, 1.0, -1.0)
            again = np.where(side == was, 0.5, 1.0)
            inner, outer, was = np.where(inside, now, inner), np.where(inside, outer, now), side
            high, low = np.where(inside, here, again * high), np.where(inside, again * low, here)
        return np.where(beyond, border, now), every, y_top

    def _touch_at(self, touch: _Touch, strip: FloatArray, y: FloatArray) -> FloatArray:
        """Return touch at strip coordinates and y (M, n, S)."""
        place = self.skin.places(strip, y)
        return touch(self.skin.points(*place), lambda: self.skin.normals(*place))

    def _aside(
        self, touch: _Touch, ends: FloatArray, deepest: FloatArray, y_top: FloatArray, strips: IntArray
    ) -> FloatArray:
        """Return other ends (M, E, 2) [mm] than centre lines', as far off as those of strips of a width may be.

        A strip is no line: of one that is touched on one side, or at its border, places in touch lie beside its middle.
        """
        strip, lengths_mm = strips[:, None].astype(float), self.skin.lengths_mm[strips]
        y = np.concatenate([ends, y_top[..., None]], axis=2)
        here, beside = (self._touch_at(touch, strip + step, y) for step in (0.0, _SHORT_MM))
        on = self._touch_at(touch, strip, ends + _SHORT_MM)
        side = (self.skin.points(*self.skin.places(strip + step, y)) for step in (0.0, _SHORT_MM))
        across = (beside - here) / np.linalg.norm(np.subtract(*side), axis=-1)
        along, half = (on - here[..., :2]) / _SHORT_MM, 0.5 * _WIDTH_MM
        # From the centre line to where the strip is no longer touched; by how much ends at its sides differ from there.
        free = np.clip(deepest[:, strips] / np.maximum(np.abs(across[..., 2]), 1e-9), -half, half)[..., None]
        with np.errstate(divide="ignore", invalid="ignore"):
            slope = np.nan_to_num(np.abs(across[..., :2] / along))
            beyond = np.nan_to_num(np.abs(here[..., :2] / along))
        most = np.maximum(ends[..., 1] - ends[..., 0], _WIDTH_MM)[..., None]
        border = np.stack([ends[..., 0], lengths_mm - ends[..., 1]], axis=-1)
        aside = np.minimum(slope * half, most)
        cut = np.square(np.maximum(aside - np.where(border > 0.0, border, beyond), 0.0)) / (
            4.0 * aside + 1e-9
        )
        part = np.where(border > 0.0, 0.5 * aside * (1.0 - free / half), 0.0)
        outward = np.array([-1.0, 1.0])
        return np.asarray(np.clip(ends + (part - cut) * outward, 0.0, lengths_mm[:, None]))


def _bent(
    frames: FloatArray, bend: FloatArray, points: FloatArray, normals: FloatArray | None
) -> tuple[FloatArray, FloatArray | None]:
    """Return points and normals (3, M or 1, K) in the frames of objects bent along their x, as if these were straight.

    `bend` (M,) is the curvature of the line that was their x axis, above 0 away from the skin, times `_BEND_MM`.
    """
    axes, at = frames[:, :9].reshape(-1, 3, 3), frames[:, 9:12]
    k = bend[:, None] / _BEND_MM
    k = np.where(np.abs(k) < 1e-9, 1e-9, k)
    x, y, z = np.einsum(
        "mac,cmk->amk", axes, np.broadcast_to(points, (3, len(k), points.shape[2])) - at.T[..., None]
    )
    far = np.hypot(k * x, 1.0 - k * z)
    cos, sin = (1.0 - k * z) / far, k * x / far
    found = np.stack([np.arctan2(k * x, 1.0 - k * z) / k, y, (1.0 - far) / k])
    if normals is None:
        return found, None
    nx, ny, nz = np.einsum("mac,cmk->amk", axes, np.broadcast_to(normals, found.shape))
    return found, np.stack([cos * nx + sin * nz, ny, cos * nz - sin * nx])


def cap(skin: Skin) -> bool:
    """Whether every patch of a ball or a plane is a cap, whatever the radius: on a spherical skin."""
    return skin.surface is not None and skin.surface.kind == "sphere"


def _misfit(depth: FloatArray) -> FloatArray:
    """Return the root of minus twice the logarithm of how likely a strip reads, by its depth in standard deviations."""
    from scipy.special import log_ndtr

    return np.sqrt(-2.0 * np.asarray(log_ndtr(depth)))


def _ends_read(sensor: Sensor, scan: Scan) -> tuple[FloatArray, FloatArray]:
    """Return about where contacts end on strips: l and u (n,) [mm]; of one reading both where it alone puts them."""
    k = np.stack([scan[name] for name in scan.signatures])
    with np.errstate(all="ignore"):
        middle = np.where(scan.touched, np.nansum(k, axis=0) / np.sum(~np.isnan(k), axis=0), np.nan)
    low = high = middle * sensor.length_mm
    if len(k) == 2:  # kh and kl; of a strip with one of them left out as above
        lam = sensor.contact_lambda_mm if sensor.surface is None else 0.0  # which a surface's map takes off
        l, w = lower_and_width(scan["kh"], scan["kl"], sensor.length_mm, sensor.sensing_ratio, lam)
        half, both = 0.5 * np.maximum(w, 0.0), ~np.isnan(w)
        low, high = (np.where(both, l + 0.5 * w + side * half, low) for side in (-1.0, 1.0))
    if sensor.surface is not None:
        low, high = ends_from_electrical(sensor, low, high)
    low, high = (np.clip(v, 0.0, skin_of(sensor).lengths_mm) for v in (low, high))
    return low, np.maximum(high, low)


def _middle(skin: Skin, scan: Scan, ends: tuple[FloatArray, FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Return the place on the skin that the readings are about (3,), and two directions along the skin there (2, 3)."""
    on = np.flatnonzero(scan.touched)
    across, up = skin.places_near(
        skin.points(*skin.places(on.astype(float), 0.5 * (ends[0] + ends[1])[on])).mean(axis=0)
    )
    normal = skin.normals(across, up)
    first = np.eye(3)[np.abs(normal).argmin()]
    first = first - (first @ normal) * normal
    first /= np.linalg.norm(first)
    return skin.points(across, up), np.stack([first, np.cross(normal, first)])
