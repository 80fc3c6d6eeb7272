"""What one signature can tell at best: the posterior of somebody who knows how the hold-out's outlines are drawn.

Run: python -m studies.one_signature_limit [--cases 60] [--seed 1] [--rows FILE]

Contacts are drawn as `studies/holdout` does, but without weak corners and hulls over a border, with known normal noise
of .05 to 1 %; where they have more than 32 strips, 32 with so much less noise stand for them. Each family of the
generator (hulls of m corners, ellipses, ..., inside or over a border) has a sequential Monte Carlo of its own, begun
from how the generator draws it, which gives the family's evidence: none is lost while particles are resampled. The
probability of an IoU of .8 under this posterior is the best that any rule can go by.

Printed: the share of wrong `ok` ("silent") at each share of false doubts, for the package's confidence, for the best
confidence of its outline, and for the best outline, as the posterior tells and as counted. Then what checks the
posterior: what it said and what was, the true family's share, ranks of the true area and top among those drawn.
"""

from __future__ import annotations

import pickle
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from unittest import mock

import numpy as np
import numpy.typing as npt
import shapely
from scipy.special import logsumexp

import tacstrip as ts
from studies.holdout import cases, shapes
from studies.holdout.readings import Unit
from studies.holdout.score import GOOD, RIGHT
from studies.holdout.shapes import CONVEX, PLAIN
from studies.options import of_cases
from tacstrip.geometry.metrics import column_iou

Array = npt.NDArray[np.float64]

KINDS = tuple(kind for kind in CONVEX if kind != "weak corner")
OVER = tuple(kind for kind in PLAIN if kind != "hull")  # what crosses a border
INSIDE, LEFT, RIGHT_SIDE, BELOW, ABOVE = range(5)  # where an outline lies on the sensor
# Numbers uniform in 0 to 1 after the corners': what makes the outline (5), whether mirrored, and where it lies (4).
_HEIGHT, _TURN, _A, _B, _QUARTER, _MIRRORED, _BEGIN, _END, _OUTSIDE, _ALONG = range(10)
_UNIFORM = 10
_CORNERS = range(3, 8)  # of hulls: one in 90 has more
_HULLS = 40_000
_PRIOR, _PARTICLES, _MOST_LEVELS = 3_000, 500, 150
_NEAR = 20  # particles on either side
_HOT = 0.02  # inverse temperature; sweeps a level while it is less, and then: of few numbers, and of hulls
_SWEEPS, _OF_HULLS = (4, 12), (2, 7)
_HOPELESS = 7.0  # log of the evidence by which a family is given up
_STRIPS, _COLUMNS, _KEPT = 32, 48, 120
_FALSE_DOUBTS = (0.05, 0.10, 0.17, 0.18, 0.25, 0.35, 0.5)
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(5)
_BOX = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])


@dataclass(frozen=True)
class Family:
    """Outlines that are drawn alike: category, where they lie, corners of a hull (0: none), and how often."""

    shape: str
    place: int
    corners: int
    share: float


@dataclass(frozen=True)
class Seen:
    """What is known: the unit, the first and last strip touched, readings there, and their sigma."""

    unit: Unit
    first: int
    last: int
    read: Array
    sigma: float

    @property
    def strips(self) -> int:
        """How many are touched."""
        return self.last - self.first + 1


@dataclass
class Particles:
    """Numbers that make outlines (P, 2 m + 10), the log density by which these are drawn wrongly often, and misfit.

    Misfit is half the squared residuals over sigma^2.
    """

    latent: Array
    log_prior: Array
    misfit: Array

    def take(self, at: npt.NDArray[np.int64]) -> Particles:
        """Return those at some indices."""
        return Particles(self.latent[at], self.log_prior[at], self.misfit[at])


def families(seen: Seen) -> Iterator[Family]:
    """Yield the families that can touch the strips seen."""
    places = [(INSIDE, kind, 1.0) for kind in KINDS if not kind.startswith("over")]
    places += [(place, kind, 0.5 / len(OVER)) for place in (LEFT, RIGHT_SIDE, BELOW, ABOVE) for kind in OVER]
    # What has few numbers comes first: its evidence gives the others up early.
    for place, kind, share in sorted(places, key=lambda p: (p[1] in ("hull", "one upright side"), p[0])):
        if (place == LEFT and seen.first > 0) or (place == RIGHT_SIDE and seen.last < seen.unit.strips - 1):
            continue
        if kind in ("hull", "one upright side"):
            for corners in _CORNERS:
                yield Family(kind, place, corners, share / len(KINDS) * len(_hulls()[corners]) / _HULLS)
        else:
            yield Family(kind, place, 3 if kind == "triangle" else 0, share / len(KINDS))


@cache
def _hulls() -> dict[int, Array]:
    """Return hulls (K, 2 m + 2) as the generator draws them, by corners: these, then the height and turn of `_points`.

    Corners are those of the points' normal distribution, before it is flattened and turned.
    """
    random = np.random.default_rng(0)
    found: dict[int, list[Array]] = {m: [] for m in _CORNERS}
    for _ in range(_HULLS):
        ring = shapely.get_coordinates(
            shapely.MultiPoint(random.normal(size=(random.integers(4, 13), 2))).convex_hull.exterior
        )[:-1]
        if len(ring) in found:
            found[len(ring)].append(np.append(ring[::-1].ravel(), random.random(2)))
    return {m: np.array(some) for m, some in found.items()}


def _from_prior(family: Family, random: np.random.Generator) -> Array:
    latent = random.random((_PRIOR, 2 * family.corners + _UNIFORM))
    if family.shape == "triangle":
        latent[:, :6] = random.normal(size=(_PRIOR, 6))
    elif family.corners:
        pool = _hulls()[family.corners]
        latent[:, : pool.shape[1]] = pool[random.integers(len(pool), size=_PRIOR)]
    return latent


def _corners(family: Family, latent: Array) -> tuple[Array, Array, Array]:
    """Return corners (P, N, 2) of an outline, the radius of discs about them, and the log density of hulls."""
    m, z = family.corners, latent[:, 2 * family.corners :]
    none = np.zeros(len(z))
    height, turn = np.exp(-1.0 + 1.7 * z[:, _HEIGHT]), 0.06 + (0.5 * np.pi - 0.12) * z[:, _TURN]
    if m:
        p = latent[:, : 2 * m].reshape(-1, m, 2)
        log = -0.5 * (p**2).sum(axis=(1, 2))
        if family.shape == "triangle":
            return p, none, log
        a, b = p, np.roll(p, -1, axis=1)
        step = b - a
        ahead = np.roll(step, -1, axis=1)
        turns = step[..., 0] * ahead[..., 1] - step[..., 1] * ahead[..., 0]
        # Of n points the others lie within, in the normal distribution's measure of the hull.
        square = sum(
            w * _mean_exponential(((a + (0.5 + 0.5 * t) * step) ** 2).sum(axis=2))
            for t, w in zip(_NODES, _WEIGHTS, strict=True)
        )
        cross = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
        inside = np.clip((0.25 * cross * square).sum(axis=1) / (2.0 * np.pi), 1e-300, 1.0)
        ways = np.zeros(len(z))
        for n in range(max(m, 4), 13):
            ways += np.prod(np.arange(n - m + 1, n + 1.0)) * inside ** (n - m)
        convex = (turns > 0.0).all(axis=1)
        winding = np.arctan2(turns, (step * ahead).sum(axis=2)).sum(axis=1)
        log += np.where(convex & (winding < 7.0), np.log(ways), -np.inf)
        flat = np.stack([np.ones(len(z)), np.exp(-0.7 + 1.4 * z[:, _HEIGHT])], axis=1)
        return _turned(p * flat[:, None], np.pi * z[:, _TURN]), none, log
    one = np.ones(len(z))
    if family.shape == "trapezoid":
        top = 0.15 + 0.7 * z[:, _A]
        start = -0.3 + (1.6 - top) * z[:, _B]
        x = np.stack([none, one, start + top, start], axis=1)
        y = np.stack([none, none, height, height], axis=1)
        quarter = np.floor(4.0 * z[:, _QUARTER])
        at = np.where(quarter < 3.0, 0.5 * np.pi * quarter, 4.0 * turn)
        return _turned(np.stack([x, y], axis=2), at), none, none
    size = np.stack([one, height], axis=1)[:, None]
    if family.shape == "rounded":
        radius = (0.1 + 0.35 * z[:, _A]) * np.minimum(1.0, height)
        at = np.where(z[:, _B] < 0.5, 0.0, turn)
        return _turned(_BOX * (size - 2.0 * radius[:, None, None]), at), radius, none
    return _turned(_BOX * size, turn if family.shape == "rotated rectangle" else none), none, none


def _mean_exponential(square: Array) -> Array:
    """Return (1 - exp(-s / 2)) / (s / 2) of squared radii."""
    half = np.maximum(0.5 * square, 1e-9)
    return np.asarray(-np.expm1(-half) / half)


def _turned(points: Array, angle: Array) -> Array:
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    x, y = points[..., 0], points[..., 1]
    return np.stack([c * x - s * y, s * x + c * y], axis=2)


def _ends(points: Array, radius: Array, x: Array) -> tuple[Array, Array]:
    """Return the lowest and highest y (P, G) at x (P, G) of polygons swept by discs; inf and -inf outside."""
    p, at = points.astype(np.float32), x.astype(np.float32)
    q = np.roll(p, -1, axis=1)
    r = radius.astype(np.float32)[:, None]
    if rounded := bool(radius.any()):
        step = q - p
        normal = (
            np.stack([step[..., 1], -step[..., 0]], axis=2) / np.hypot(step[..., 0], step[..., 1])[..., None]
        )
        centre, p, q = p, p + r[..., None] * normal, q + r[..., None] * normal
    low, high = np.full(x.shape, np.inf, np.float32), np.full(x.shape, -np.inf, np.float32)
    with np.errstate(divide="ignore", invalid="ignore"):
        for e in range(p.shape[1]):
            x0, x1, y0 = p[:, e, None, 0], q[:, e, None, 0], p[:, e, None, 1]
            slope = (q[:, e, None, 1] - y0) / (x1 - x0)
            y = y0 + slope * (at - x0)
            out = (at < np.minimum(x0, x1)) | (at > np.maximum(x0, x1)) | (x0 == x1)
            np.minimum(low, np.where(out, np.inf, y), out=low)
            np.maximum(high, np.where(out, -np.inf, y), out=high)
            if rounded:
                half = np.sqrt(r**2 - (at - centre[:, e, None, 0]) ** 2)
                np.fmin(low, centre[:, e, None, 1] - half, out=low)
                np.fmax(high, centre[:, e, None, 1] + half, out=high)
    return low.astype(np.float64), high.astype(np.float64)


def _beside(points: Array, above: Array) -> tuple[Array, Array]:
    """Return the least and greatest x (P,) of polygons' parts where `above` (P, N) of the corners is not negative."""
    x, other, next_x = points[..., 0], np.roll(above, -1, axis=1), np.roll(points[..., 0], -1, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        crossed = x + (next_x - x) * above / (above - other)
    x = np.concatenate(
        [np.where(above >= 0.0, x, np.nan), np.where(above * other < 0.0, crossed, np.nan)], axis=1
    )
    return np.nanmin(x, axis=1), np.nanmax(x, axis=1)


def laid(seen: Seen, family: Family, latent: Array, at: Array) -> tuple[Array, Array, Array]:
    """Return l and u over the strip length (P, G) at `at` (G,) in pitches, and the log density of outline and unit."""
    unit, z = seen.unit, latent[:, 2 * family.corners :]
    place, oval = family.place, family.shape in ("ellipse", "circle")
    if oval:
        height = np.exp(-1.0 + 1.7 * z[:, _HEIGHT]) if family.shape == "ellipse" else np.ones(len(z))
        turn = 0.06 + (0.5 * np.pi - 0.12) * z[:, _TURN]
        c, s = np.cos(turn), np.sin(turn)
        xx, xy, yy = c**2 + (height * s) ** 2, c * s * (1.0 - height**2), s**2 + (height * c) ** 2
        right, high = np.sqrt(xx), np.sqrt(yy)
        left, low, good, log = -right, -high, np.ones(len(z), dtype=bool), np.zeros(len(z))
    else:
        points, radius, log = _corners(family, latent)
        x, y = points[..., 0], points[..., 1]
        left, right = x.min(axis=1) - radius, x.max(axis=1) + radius
        low, high = y.min(axis=1) - radius, y.max(axis=1) + radius
        cross = x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)
        good = 0.5 * np.abs(cross.sum(axis=1)) > 0.25 * (right - left) * (high - low)  # no slivers
        good |= radius > 0.0
    mirrored = np.zeros(len(z), dtype=bool)
    if family.shape == "one upright side":
        left = left + (0.15 + 0.35 * z[:, _A]) * (right - left)
        cut, kept = _ends(points, radius, left[:, None]), x >= left[:, None]
        low = np.minimum(np.where(kept, y, np.inf).min(axis=1), cut[0][:, 0])
        high = np.maximum(np.where(kept, y, -np.inf).max(axis=1), cut[1][:, 0])
        mirrored = z[:, _MIRRORED] < 0.5
    # Where it begins and ends, in pitches.
    cut_off, outside = place >= BELOW, 0.1 + 0.4 * z[:, _OUTSIDE]
    begin, end = seen.first + 0.5 - z[:, _BEGIN], seen.last + 0.5 + z[:, _END]
    if cut_off:  # these are where the part begins and ends that lies on the sensor
        border = (low + outside * (high - low)) if place == BELOW else high - outside * (high - low)
        side = 1.0 if place == BELOW else -1.0
        if oval:
            far = np.stack([-right, right], axis=1)
            half = height / np.sqrt(yy) * np.sqrt(1.0 - border**2 / yy)
            crossed = (border * xy / yy)[:, None] + half[:, None] * [-1.0, 1.0]
            onto = side * (far * (xy / xx)[:, None] - border[:, None]) >= 0.0
            first, last = np.where(onto, far, crossed).T
        else:
            first, last = _beside(points, side * (y - border[:, None]))
        stretch = (right - left) / (last - first)
        begin -= (first - left) / (last - first) * (end - begin)
        end = begin + stretch * (seen.strips - 1.0 + z[:, _BEGIN] + z[:, _END])
        log = log + np.log(stretch)
    if place == LEFT:
        begin = -outside * end / (1.0 - outside)
    if place == RIGHT_SIDE:
        end = (unit.strips - outside * begin) / (1.0 - outside)
    extent = end - begin
    over_x = place in (LEFT, RIGHT_SIDE)
    visible = extent * (1.0 - outside) if over_x else extent
    asked = np.ceil(visible + 0.1)  # strips, of which the generator took .1 to .9 away
    room = unit.strips - extent
    good &= (asked - visible > 0.1) & (asked - visible < 0.9) & (asked <= unit.strips)
    good &= unit.strips < asked + asked // 2 + 3
    log = log - np.log((asked // 2 + 3.0) * asked)
    if not over_x:
        good &= (room > 0.0) & (begin > 0.02 * room) & (begin < 0.98 * room)
        log -= np.log(np.maximum(room, 1e-9))
    else:  # one end is known by the other one and the part outside
        log += np.log(extent / (1.0 - outside))
    tall = (high - low) / (right - left) * extent  # in pitches
    part = tall * unit.pitch / unit.length
    least = np.minimum(0.85, np.maximum(0.08, tall / (6.0 * asked)))
    good &= (part > least) & (part < 0.9)
    log -= np.log(np.log(0.9 / least))
    over = -outside * part if place == BELOW else 1.0 - part + outside * part
    along = z[:, _ALONG]
    bottom = over if cut_off else (0.02 + 0.96 * along) * (1.0 - part)
    # Back to the outline's own coordinates.
    scale = (right - left) / extent
    own = np.where(mirrored[:, None], end[:, None] - at, at - begin[:, None]) * scale[:, None] + left[:, None]
    if oval:
        with np.errstate(invalid="ignore"):
            half = np.sqrt(xx[:, None] - own**2) * (height / xx)[:, None]
        l, u = (own * (xy / xx)[:, None] + side * half for side in (-1.0, 1.0))
    else:
        l, u = _ends(points, radius, own)
    beyond = (own < left[:, None]) | (own > right[:, None])
    per = (unit.pitch / unit.length / scale)[:, None]
    l, u = (np.where(beyond, np.nan, bottom[:, None] + (v - low[:, None]) * per) for v in (l, u))
    l, u = np.maximum(l, 0.0), np.minimum(u, 1.0)
    touched = u >= l
    return np.where(touched, l, np.nan), np.where(touched, u, np.nan), np.where(good, log, -np.inf)


def _weigh(seen: Seen, family: Family, latent: Array) -> Particles:
    at: Array = np.arange(seen.first - 1, seen.last + 2, dtype=np.float64) + 0.5
    l, u, log = laid(seen, family, latent, at)
    there = np.isfinite(l)
    full = there[:, 1:-1].all(axis=1)
    full &= ~(there[:, 0] & (seen.first > 0)) & ~(there[:, -1] & (seen.last < seen.unit.strips - 1))
    with np.errstate(invalid="ignore"):
        read = seen.unit.read(l[:, 1:-1] * seen.unit.length, u[:, 1:-1] * seen.unit.length)[0]
    off = ((read - seen.read) ** 2).sum(axis=1) / (2.0 * seen.sigma**2)
    return Particles(latent, np.where(full, log, -np.inf), np.where(full, off, np.inf))


def posterior(
    seen: Seen, family: Family, random: np.random.Generator, least: float
) -> tuple[Particles, float]:
    """Return a family's outlines as often as the readings make them likely, and the log of its evidence.

    -inf and no outlines where the evidence falls below `least` while the readings come to count.
    """
    some = _weigh(seen, family, _from_prior(family, random))
    drawn = _density(family, some.latent)
    weight = some.log_prior - drawn  # those of hulls are drawn as often as they should be
    none = some.take(np.zeros(0, dtype=np.int64)), -np.inf
    possible = np.flatnonzero(np.isfinite(weight))
    if len(possible) < 4:
        return none
    evidence = np.log(family.share) + float(logsumexp(weight)) - np.log(_PRIOR)
    some, weight, heat = some.take(possible), weight[possible], 0.0  # heat: inverse temperature
    sweeps = _OF_HULLS if family.corners > 3 else _SWEEPS
    for _ in range(_MOST_LEVELS):
        step = _next(weight, some.misfit, 1.0 - heat)
        heat += step
        w = weight - step * some.misfit
        evidence += float(logsumexp(w) - logsumexp(weight))
        if evidence < least:
            return none
        share = np.exp(w - w.max())
        share /= share.sum()
        at = np.searchsorted(np.cumsum(share), (np.arange(_PARTICLES) + random.random()) / _PARTICLES)
        some, weight = some.take(np.minimum(at, len(share) - 1)), np.zeros(_PARTICLES)
        for _ in range(sweeps[heat > _HOT] * (2 if heat >= 1.0 else 1)):
            _move(seen, family, some, heat, random)
        if heat >= 1.0:
            break
    return some, evidence


def _density(family: Family, latent: Array) -> Array:
    return _corners(family, latent)[2] if family.corners else np.zeros(len(latent))


def _next(weight: Array, misfit: Array, most: float) -> float:
    """Return the step of inverse temperature that leaves half of the particles."""

    def left(step: float) -> float:
        w = weight - step * (misfit - misfit.min())
        share = np.exp(w - w.max())
        return float(share.sum() ** 2 / (share**2).sum())

    wanted = min(0.5 * _PARTICLES, 0.7 * left(0.0))
    if left(most) >= wanted:
        return most
    low, high = 0.0, most
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if left(middle) > wanted else (low, middle)
    return max(low, 1e-9)


def _move(seen: Seen, family: Family, some: Particles, heat: float, random: np.random.Generator) -> None:
    """One Metropolis step of every particle: along the difference of two others, or of a few numbers."""
    count, numbers = some.latent.shape
    # Posteriors are thin and bent: the difference of two that lie near by along the longest direction points along it.
    scaled = some.latent - some.latent.mean(axis=0)
    scaled /= scaled.std(axis=0) + 1e-12
    along = scaled @ np.linalg.eigh(scaled.T @ scaled)[1][:, -1 - int(random.integers(min(3, numbers)))]
    order = np.argsort(along)
    rank = np.empty(count, dtype=np.int64)
    rank[order] = np.arange(count)
    near = order[np.clip(rank + random.integers(-_NEAR, _NEAR + 1, (2, count)), 0, count - 1)]
    a, b = np.where(random.random(count) < 0.6, near, random.integers(count, size=(2, count)))
    size = np.exp(random.uniform(np.log(0.03), np.log(2.5), (count, 1)))
    jump = size * (some.latent[a] - some.latent[b]) + 1e-5 * random.normal(size=(count, numbers))
    few = random.random((count, numbers)) < 0.2
    fine = few * np.exp(random.uniform(np.log(1e-4), np.log(0.5), (count, 1))) * random.normal(size=few.shape)
    latent = some.latent + np.where(random.random((count, 1)) < 0.75, jump, fine)
    flat = np.abs(latent[:, 2 * family.corners :]) % 2.0
    latent[:, 2 * family.corners :] = np.where(flat > 1.0, 2.0 - flat, flat)
    trial = _weigh(seen, family, latent)
    with np.errstate(invalid="ignore"):
        gain = trial.log_prior - some.log_prior - heat * (trial.misfit - some.misfit)
    taken = np.log(random.random(count)) < gain
    some.latent[taken] = latent[taken]
    some.log_prior[taken], some.misfit[taken] = trial.log_prior[taken], trial.misfit[taken]


@dataclass(frozen=True)
class Judged:
    """One case: IoU of the package's outline and of the best one, and what is said of them.

    Attributes
    ----------
    kind, iou, best_iou
        What was drawn; overlap of the package's outline, and of the best one, with it.
    said
        The package's confidence; 0 where its status is doubtful for another reason.
    right, good
        Probability of an IoU of .8, and of .9, by the posterior (2,): of the package's outline and of the best.
    family
        Share of the true family, where it lies included, in the posterior.
    ranks
        Parts of the outlines drawn whose area, and whose lowest end, are below the true one's (2,).
    shares, package
        Of each category; the package's status.
    """

    kind: str
    strips: int
    noise: float
    iou: float
    best_iou: float
    said: float
    right: tuple[float, float]
    good: tuple[float, float]
    family: float
    ranks: tuple[float, float]
    shares: dict[str, float]
    package: str


def draw(random: np.random.Generator) -> tuple[cases.Case, Seen]:
    """Draw a contact of the hold-out's kinds, and what is seen of it."""
    noise = cases.log_uniform(random, 0.0005, 0.01)
    name = str(random.choice(["kh", "kl", "k"], p=[0.36, 0.28, 0.36]))
    strips = int(
        cases.log_uniform(random, 12, 101)
        if random.random() < 5 / 7
        else cases.log_uniform(random, 100, 1001)
    )
    few = min(strips, _STRIPS)
    noise *= np.sqrt(few / strips)
    kind = str(random.choice(KINDS))
    with mock.patch.object(shapes, "PLAIN", OVER):
        case = cases.single(random, kind, few, (name,), noise)
    at = np.flatnonzero(np.isfinite(case.low))
    ideal, sigma = case.unit.read(case.low, case.high), noise / np.sqrt(3.0)
    read = ideal + random.normal(0.0, sigma, ideal.shape)
    return case, Seen(case.unit, int(at[0]), int(at[-1]), read[0, at], sigma)


def sampled(seen: Seen, at: Array, random: np.random.Generator) -> tuple[list[Family], Array, Array]:
    """Return families, their shares in the posterior (F,), and l and u (F, K, 2, G) of outlines drawn of each."""
    found: list[tuple[Family, float, Array]] = []
    best = -np.inf
    for family in families(seen):
        some, evidence = posterior(seen, family, random, best - _HOPELESS)
        if not np.isfinite(evidence):
            continue
        best = max(best, evidence)
        l, u, _ = laid(seen, family, some.latent[random.permutation(_PARTICLES)[:_KEPT]], at)
        found.append((family, evidence, np.nan_to_num(np.stack([l, u], axis=1))))
    share = np.exp(np.array([f[1] for f in found]) - best)
    return [f[0] for f in found], share / share.sum(), np.array([f[2] for f in found])


def judge(case: cases.Case, seen: Seen, random: np.random.Generator) -> Judged:
    """Fit a case, and compare with its posterior."""
    unit = seen.unit
    read = np.full((1, unit.strips), np.nan)
    read[0, seen.first : seen.last + 1] = np.clip(seen.read, 0.0, 1.0)
    noise = ts.Noise(positional=seen.sigma * float(np.sqrt(3.0)), distribution="normal")
    found = ts.fit_polygon(ts.Scan(**{unit.names[0]: read[0]}), unit.sensor, noise).objects[0]
    at = np.linspace(max(seen.first - 0.5, 0.0), min(seen.last + 1.5, unit.strips), 2 * _COLUMNS + 1)[1::2]
    kinds, share, ends = sampled(seen, at, random)
    weight = np.repeat(share / _KEPT, _KEPT)
    every = ends.reshape(-1, 2, _COLUMNS)
    truth = _columns(case.outlines[0] / [unit.pitch, unit.length], at)
    own = (
        _columns(found.vertices / [unit.pitch, unit.length], at)
        if found.vertices is not None and len(found.vertices) > 2
        else np.zeros_like(truth)
    )
    few = every[random.choice(len(every), 240, p=weight)]
    few = np.concatenate([few, np.einsum("k,kcg->cg", weight, every)[None]])
    alike = column_iou(few[:, None], every[None])
    best = few[int(np.argmax((alike >= RIGHT) @ weight + 0.01 * (alike @ weight)))]
    overlaps = [column_iou(every, one) for one in (own, best)]
    right, good = ([float(weight @ (o >= level)) for o in overlaps] for level in (RIGHT, GOOD))
    same = [_category(f) == case.group for f in kinds]
    shares: dict[str, float] = {}
    for f, part in zip(kinds, share, strict=True):
        shares[_category(f)] = shares.get(_category(f), 0.0) + float(part)
    seen_sizes, true_sizes = _sizes(every), _sizes(truth)
    ranks = [float(weight @ (some < one)) for some, one in zip(seen_sizes, true_sizes, strict=True)]
    return Judged(
        case.group,
        len(seen.read),
        seen.sigma,
        float(column_iou(own, truth)),
        float(column_iou(best, truth)),
        found.confidence or 0.0,
        (right[0], right[1]),
        (good[0], good[1]),
        float(share[same].sum()),
        (ranks[0], ranks[1]),
        shares,
        found.status,
    )


def _category(family: Family) -> str:
    if family.place == INSIDE:
        return family.shape
    return "over left or right" if family.place in (LEFT, RIGHT_SIDE) else "over top or bottom"


def _sizes(ends: Array) -> tuple[Array, Array]:
    """Return area and highest point of l and u (..., 2, G)."""
    return np.asarray((ends[..., 1, :] - ends[..., 0, :]).sum(axis=-1)), np.asarray(
        ends[..., 1, :].max(axis=-1)
    )


def _columns(vertices: Array, at: Array) -> Array:
    l, u = (v[0] for v in _ends(vertices[None], np.zeros(1), at[None]))
    return np.where(u >= l, np.clip(np.stack([l, u]), 0.0, 1.0), 0.0)


def silent(sure: Array, right: Array, good: Array, doubt: float) -> float:
    """Return which share of `ok` is wrong where a share `doubt` of good outlines is not `ok`: the least sure ones."""
    order = np.argsort(-sure)
    kept = np.cumsum(good[order]) <= (1.0 - doubt) * good.sum() + 1e-9
    return float(1.0 - right[order][kept].mean()) if kept.any() else 0.0


def report(found: list[Judged]) -> str:
    """Return the figures as text."""
    said = np.array([f.said for f in found])
    right, good = np.array([f.right for f in found]).T, np.array([f.good for f in found]).T
    iou = np.array([(f.iou, f.best_iou) for f in found]).T
    lines = [f"{len(found)} cases; mean IoU {iou[0].mean():.3f}, of the best outline {iou[1].mean():.3f}"]
    lines += [f"{'silent, % of ok, at false doubts of':48}" + "".join(f"{d:7.0%}" for d in _FALSE_DOUBTS)]
    for title, sure, one in (
        ("package's outline and confidence", said, 0),
        ("package's outline, posterior's confidence", right[0], 0),
        ("posterior's outline and confidence", right[1], 1),
    ):
        told = [silent(sure, right[one], good[one], d) for d in _FALSE_DOUBTS]
        was = [silent(sure, iou[one] >= RIGHT, iou[one] >= GOOD, d) for d in _FALSE_DOUBTS]
        lines += [f"{title:48}" + "".join(f"{100.0 * v:7.1f}" for v in told)]
        lines += [f"{'  as counted':48}" + "".join(f"{100.0 * v:7.1f}" for v in was)]
    for one, title in enumerate(("package's outline", "best outline")):
        for low in (0.0, 0.2, 0.4, 0.6, 0.8):
            here = (right[one] >= low) & (right[one] < low + 0.2 + (low > 0.7))
            if here.any():
                was = (iou[one][here] >= RIGHT).mean()
                lines += [f"  {title}: said {right[one][here].mean():.2f}, was {was:.2f} of {here.sum()}"]
    ranks = np.array([f.ranks for f in found])
    counted = [np.histogram(ranks[:, i], bins=5, range=(0.0, 1.0))[0].tolist() for i in (0, 1)]
    lines += [f"true area, highest point among the draws', fifths: {counted[0]}, {counted[1]}"]
    lines += [f"share of the true family: mean {np.mean([f.family for f in found]):.2f}"]
    for kind in sorted({f.kind for f in found}):
        here = np.array([f.kind == kind for f in found])
        part = np.mean([f.family for f in found if f.kind == kind])
        got = np.mean([f.shares.get(kind, 0.0) for f in found]) * len(found)
        lines += [
            f"  {kind:20}{here.sum():4} (posterior {got:5.1f}), share {part:.2f}, "
            f"IoU {iou[0][here].mean():.2f} {iou[1][here].mean():.2f}"
        ]
    return "\n".join(lines)


def main() -> None:
    """Print the figures of the command line's cases."""
    parser = of_cases("studies.one_signature_limit", __doc__, 60)
    parser.add_argument("--rows", type=Path, help="where to keep what was found of each case")
    asked = parser.parse_args()
    found = []
    for number in range(asked.cases):
        random = np.random.default_rng([asked.seed, number])
        found.append(judge(*draw(random), random))
        if asked.rows:
            asked.rows.write_bytes(pickle.dumps(found))
    sys.stdout.write(report(found) + "\n")


if __name__ == "__main__":
    main()
