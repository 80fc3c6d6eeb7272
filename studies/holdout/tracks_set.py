"""Rigid outlines over many scans, and what is none: `python -m studies.holdout.tracks_set -h`."""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import shapely
from scipy.interpolate import CubicSpline
from scipy.special import chdtr

import tacstrip as ts
from studies.holdout.readings import Unit, white
from studies.holdout.score import CLAIMS, FINAL, RIGHT
from studies.holdout.shapes import Array, counter_clockwise
from studies.holdout.tracks_bound import Told, at
from tacstrip.arrays import IntArray
from tacstrip.errors import one_of

_SIDE = 100.0  # of the sensor [mm]
_APART_S = 0.01  # from scan to scan
_OFFSET = 0.003  # of a channel, over Vref: standard deviation
_WANDER = 10.0  # scans: time of the errors that follow each other
_ALIKE = 0.5  # correlation of the errors of neighbouring strips
_GAIN = 0.01  # of one strip's channels
_SOFT, _SOFT_ALIKE = (
    0.3,
    0.4,
)  # ends of a contact with soft edges: deviation [mm], correlation of neighbouring strips
# Pitches, of the size, stated deviations: right is below the largest.
_TOLD, _OF_SIZE, _SIGMAS = 0.1, 0.01, 4.0
LEVEL = 0.95  # of the regions


@dataclass(frozen=True)
class Row:
    """One kind of scene; a scene draws one of each."""

    strips: int = 10
    names: tuple[str, ...] = ("kh", "kl")
    level: float = 0.005
    scans: int | tuple[int, ...] = 50
    shapes: tuple[str, ...] = ("convex",)
    motions: tuple[str, ...] = ("slide", "turn", "both")
    noises: tuple[str, ...] = ("uniform", "normal")
    body: str = "rigid"
    any_strips: tuple[int, ...] = ()  # a scene draws one of these in the place of `strips`, and of `level`
    any_level: tuple[float, ...] = ()


ROWS = {
    "ten": Row(),
    "ten, .2 %": Row(level=0.002),
    "ten, 1 %": Row(level=0.01),
    "20 scans": Row(scans=20),
    "200 scans": Row(scans=200),
    "32 strips": Row(strips=32),
    "100 strips": Row(strips=100),
    "presses": Row(motions=("presses",)),
    "two presses": Row(motions=("two presses",), scans=40),
    "full turns": Row(motions=("full turns",), scans=60),
    "border": Row(motions=("border",)),
    "concave": Row(shapes=("L", "T", "arrow")),
    "curved": Row(shapes=("rounded", "ellipse")),
    "small": Row(shapes=("small",)),
    "along": Row(motions=("along",), shapes=("convex", "ellipse", "small")),
    "still": Row(motions=("still",), shapes=("convex", "rounded", "small")),
    "wander": Row(noises=("wander",)),
    "offsets": Row(noises=("offsets",)),
    "offsets, 100": Row(noises=("offsets",), strips=100),
    "kh, ten": Row(names=("kh",)),
    "kh, 100": Row(names=("kh",), strips=100),
    "kh, presses": Row(names=("kh",), motions=("presses", "two presses")),
    "metal": Row(names=("k",)),
    "two as one": Row(body="two"),
    "two, 100": Row(body="two", strips=100),
    "grows": Row(body="grows"),
    "shears": Row(body="shears"),
    "rolls": Row(body="rolls"),
    "any": Row(
        shapes=("convex", "random", "long", "rounded", "ellipse", "disc", "L", "T", "arrow"),
        motions=("slide", "turn", "both", "presses", "stops", "jumps", "full turns"),
        scans=(20, 30, 50),
        noises=("uniform", "normal", "alike", "gain", "offset", "soft", "told 1.15", "told 1.5", "told 2", "unknown"),
    ),
    "creeps": Row(body="creeps"),
    "blunt": Row(shapes=("random",)),
    "upright sides": Row(
        scans=(30, 60), shapes=("upright",), motions=("across",),
        any_strips=(8, 10, 12, 16, 24), any_level=(0.002, 0.005, 0.01),
    ),
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Scene:
    """Scans of something.

    Attributes
    ----------
    outline, poses
        Of a rigid one, or of one that hardly deforms on the whole (N, 2) [mm] and (T, 3), else None.
    kind, motion, noise
        Of `Row.shapes`, `Row.motions` and `Row.noises`.
    read
        Readings (T, S, n) over Vref, NaN untouched.
    """

    unit: Unit
    row: Row
    outline: Array | None
    curved: bool
    poses: Array
    read: Array
    kind: str
    motion: str
    noise: str

    @property
    def told(self) -> ts.Noise | None:
        """What the package is told of the noise; None: nothing."""
        if self.noise == "unknown":
            return None
        times = float(self.noise.removeprefix("told ")) if self.noise.startswith("told ") else 1.0
        return ts.Noise(positional=self.row.level / times)

    @property
    def scans(self) -> list[ts.Scan]:
        """What the package gets."""
        return [
            ts.Scan(time_s=_APART_S * i, **dict(zip(self.unit.names, k, strict=True)))
            for i, k in enumerate(self.unit.digitised(self.read))
        ]


@dataclass
class Verdict:
    """Of a track."""

    status: str = "no track"
    claims: bool = False
    right: bool = False
    counted: bool = False
    rms: float = math.nan
    bound: float = math.nan
    iou: float = 0.0
    far: float = math.nan  # in the median scan: Hausdorff's distance of the outlines, beside what is stated
    beyond: bool = False
    unsaid: bool = (
        False  # of another count, and some of the true outline farther from it than a corner unseen may be
    )
    shape_square: float = math.nan  # probability of chi square below the shape's error
    pose_squares: list[float] = field(default_factory=list)
    place_squares: list[float] = field(default_factory=list)  # likewise of the centroids, of any outline
    ms: float = 0.0
    advice: str = ""


def scene(name: str, seed: int, number: int, noises: tuple[str, ...] = ()) -> Scene:
    """Return a scene of `ROWS`, with other noises where some are named."""
    row = replace(ROWS[name], noises=noises) if noises else ROWS[name]
    random = np.random.default_rng([77, list(ROWS).index(name), seed, number])
    if row.any_strips:
        row = replace(row, strips=int(random.choice(row.any_strips)))
    if row.any_level:
        row = replace(row, level=float(random.choice(row.any_level)))
    unit = Unit(row.names, row.strips, _SIDE / row.strips, _SIDE)
    count = row.scans if isinstance(row.scans, int) else int(random.choice(row.scans))
    while True:
        kind, motion = str(random.choice(row.shapes)), str(random.choice(row.motions))
        size = random.uniform(18.0, 30.0) if row.strips <= 10 else random.uniform(12.0, 22.0)
        if row.body == "two":
            bodies = [drawn_outline("convex", random, random.uniform(11.0, 15.0)) for _ in range(2)]
            lanes = np.array([[50.0, 28.0, 0.0], [50.0, 72.0, 0.0]])  # they share strips, and never touch
            ways = [
                lane + (drawn_way("both", count, random, lane[1]) - lane) * [0.5, 0.5, 1.0] for lane in lanes
            ]
        elif kind == "upright":
            bodies, ways = [_upright(random, size, unit.pitch)], [drawn_way(motion, count, random)]
        elif kind == "small":
            bodies = [drawn_outline("convex", random, unit.pitch * random.uniform(0.5, 1.0))]
            ways = [drawn_way(motion, count, random)]
        else:
            bodies, ways = [drawn_outline(kind, random, size)], [drawn_way(motion, count, random)]
        placed = [_posed(_changing(b, row.body, count, random), w) for b, w in zip(bodies, ways, strict=True)]
        reach = [(min(o.min() for o in p), max(o.max() for o in p)) for p in placed]
        inside = all(low > 1.0 and high < _SIDE - 1.0 for low, high in reach)
        if motion == "border":
            inside = not inside and all(_shares(o, 0.5) for o in placed[0]) and _all_seen(placed[0])
        if row.body == "two":
            inside &= all(a[:, 1].max() < b[:, 1].min() - 1.0 for a, b in zip(*placed, strict=True))
            inside &= all(_overlap(a, b) > 5.0 for a, b in zip(*placed, strict=True))
        if not inside:
            continue
        low, high = (
            np.stack(v) for v in zip(*(unit.touched(o) for o in zip(*placed, strict=True)), strict=True)
        )
        touched = np.isfinite(low).sum(axis=1)
        if kind == "small" or touched[touched > 0].min() >= 3 or motion == "border":
            break
    if motion == "two presses":
        low[count // 2 - 1 : count // 2 + 1] = np.nan
    noise = str(random.choice(row.noises))
    if noise == "soft":
        off = _SOFT * _alike((2, *low.shape), _SOFT_ALIKE, random)
        low, high = np.clip(low + off[0], 0.0, high), np.clip(high + off[1], low, _SIDE)
    read = np.stack([unit.read(a, b) for a, b in zip(low, high, strict=True)])
    read = np.clip(read + _errors(read, noise, row.level, random), 0.0, 1.0)
    rigid = row.body in ("rigid", "creeps")
    curved = kind in ("rounded", "ellipse", "disc")
    return Scene(unit, row, bodies[0] if rigid else None, curved, ways[0], read, kind, motion, noise)


def _errors(read: Array, kind: str, level: float, random: np.random.Generator) -> Array:
    shape, sigma = read.shape, level / math.sqrt(3.0)
    if kind == "wander":
        keep, new = math.exp(-1.0 / _WANDER), random.normal(size=shape)
        for i in range(1, len(new)):
            new[i] = keep * new[i - 1] + math.sqrt(1.0 - keep**2) * new[i]
        return np.asarray(sigma * math.sqrt(0.5) * (new + random.normal(size=shape)))
    if kind == "alike":
        return sigma * _alike(shape, _ALIKE, random)
    errors = white(shape, level, "normal" if kind == "normal" else "uniform", random)
    if kind in ("gain", "offset"):
        touched = np.isfinite(read[:, 0]).sum(axis=0)
        strip = int(random.choice(np.flatnonzero(touched == touched.max())))
        errors[..., strip] += _GAIN * read[..., strip] if kind == "gain" else 0.0
        errors[:, 0, strip] += _OFFSET * (kind == "offset")
    return errors + (random.normal(0.0, _OFFSET, shape[1:]) if kind == "offsets" else 0.0)


def _alike(shape: tuple[int, ...], correlation: float, random: np.random.Generator) -> Array:
    """Return normal errors of deviation 1 that are correlated from each strip, the last axis, to the next."""
    new = random.normal(size=shape)
    for i in range(1, shape[-1]):
        new[..., i] = correlation * new[..., i - 1] + math.sqrt(1.0 - correlation**2) * new[..., i]
    return np.asarray(new)


def drawn_outline(kind: str, random: np.random.Generator, size: float) -> Array:
    """Return an outline about its centroid, `size` [mm] from there to its farthest corner, of clear corners."""
    a, b = random.uniform(0.3, 0.55, 2)
    slender = random.uniform(0.65, 1.0)
    match kind:
        case "L":
            outline = np.array(
                [(0, 0), (1, 0), (1, a * slender), (b, a * slender), (b, slender), (0, slender)]
            )
        case "T":
            outline = np.array(
                [(-1, 0), (1, 0), (1, 0.7), (a, 0.7), (a, 1.7), (-a, 1.7), (-a, 0.7), (-1, 0.7)]
            )
        case "arrow":
            outline = np.array([(0, 0), (0.3 + a, 0.55), (0, 1.1), (1.5, 0.55)])
        case "ellipse" | "disc":
            angle = np.linspace(0.0, 2.0 * np.pi, 180, endpoint=False)
            half = random.uniform(0.5, 0.85) if kind == "ellipse" else 1.0
            outline = np.stack([np.cos(angle), half * np.sin(angle)], axis=1)
        case "long":
            c, d = random.uniform(0.12, 0.3, 2)
            outline = np.array([(-1, -c), (1, -d), (1 + a - 0.4, d), (-1, c)])
        case "random":
            outline = _convex(random, clear=False)
        case "rounded":
            core = shapely.box(0.0, 0.0, 1.0, slender).buffer(-0.2).buffer(0.2, quad_segs=16)
            outline = np.array(core.exterior.coords)[:-1]
        case _:
            outline = _convex(random)
    outline = counter_clockwise(outline)
    outline = outline - shapely.get_coordinates(shapely.Polygon(outline).centroid)
    return np.asarray(outline * size / np.hypot(*outline.T).max())


def _convex(random: np.random.Generator, clear: bool = True) -> Array:
    """Return a convex polygon of 3 to 8 corners; clear ones turn by 20 degrees or more, with edges of some length."""
    corners = int(random.integers(3, 9))
    while True:
        points = random.normal(size=(40, 2))
        hull = np.array(
            shapely.MultiPoint(points / (0.6 + np.hypot(*points.T)[:, None])).convex_hull.exterior.coords
        )[:-1]
        if len(hull) < corners:
            continue
        outline = counter_clockwise(hull[np.sort(random.choice(len(hull), corners, replace=False))])
        edge = np.roll(outline, -1, axis=0) - outline
        heading = np.arctan2(edge[:, 1], edge[:, 0])
        turns = (np.roll(heading, -1) - heading) % (2.0 * np.pi)
        extent = np.linalg.eigvalsh(np.cov(outline.T))
        sharp = turns.min() > np.radians(20.0) and turns.max() < 2.6 and np.hypot(*edge.T).min() > 0.35
        if (sharp or not clear) and extent[0] > 0.2 * extent[1]:
            return np.asarray(outline)


def _upright(random: np.random.Generator, size: float, pitch: float) -> Array:
    """Return a triangle or quadrilateral about its centroid with one or two sides that lean by up to two pitches."""
    half = 0.5 * min(pitch * random.uniform(3.0, 8.0), 2.2 * size)
    high = size * random.uniform(0.5, 0.9)
    leans, slopes = random.uniform(-1.0, 1.0, 2), high * random.uniform(-0.25, 0.25, 2)
    leans *= pitch * np.abs(leans)  # half of them by less than half a pitch
    kind = random.choice(["any", "parallelogram", "trapezoid", "rectangle", "triangle"])
    if kind in ("parallelogram", "rectangle"):
        leans[1], slopes[1] = leans[0], slopes[0]
    if kind == "trapezoid":
        slopes[1] = slopes[0] = 0.0
    if kind == "rectangle":
        slopes[:] = -leans[0] * half / high
    (a, b), (p, q) = leans, slopes
    outline = np.array(
        [(-half - a, -high - p), (half - b, -high + p), (half + b, high + q), (-half + a, high - q)]
    )
    if kind == "triangle":
        outline = np.delete(outline, int(random.integers(4)), axis=0)
    outline = counter_clockwise(outline)
    return np.asarray(outline - shapely.get_coordinates(shapely.Polygon(outline).centroid))


def drawn_way(motion: str, scans: int, random: np.random.Generator, middle_y: float = 50.0) -> Array:
    """Return poses (T, 3) [mm, mm, rad]."""
    t = np.linspace(0.0, 1.0, scans)
    centre = np.array([50.0, middle_y, random.uniform(0.0, 2.0 * np.pi)])
    centre[:2] += random.uniform(-6.0, 6.0, 2)
    go = random.choice([-1.0, 1.0]) * random.uniform(6.0, 25.0)
    turn = random.choice([-1.0, 1.0]) * np.radians(random.uniform(25.0, 100.0))

    def smooth(x: float, y: float, angle: float) -> Array:
        """From one place to another at a speed that changes, with small detours."""
        at = np.sort(random.uniform(0.15, 0.85, 2))
        pace = CubicSpline([0.0, 0.5, 1.0], [-0.5, random.uniform(-0.12, 0.12), 0.5])(t)
        detour = CubicSpline([0.0, *at, 1.0], random.normal(0.0, [0.8, 0.8, 0.015], (4, 3)))(t)
        return np.asarray(centre + np.outer(pace, [x, y, angle]) + detour)

    match motion:
        case "slide":
            return smooth(go, random.uniform(-12.0, 12.0), 0.0)
        case "across":  # hardly turned
            centre[2] = 0.0
            way = smooth(math.copysign(random.uniform(10.0, 25.0), go), random.uniform(-2.0, 2.0), 0.0)
            way[:, 2] = (t - 0.5) * random.choice([0.0, 1.0]) * random.uniform(-0.05, 0.05)
            return way
        case "turn":
            return smooth(0.0, 0.0, turn)
        case "both" | "border":
            way = smooth(go, random.uniform(-8.0, 8.0), turn)
            if motion == "border":
                way[:, random.integers(2)] += random.choice([-1.0, 1.0]) * random.uniform(20.0, 45.0)
            return way
        case "full turns":
            return smooth(
                random.uniform(-8.0, 8.0), random.uniform(-8.0, 8.0), np.sign(turn) * random.uniform(6.3, 9.5)
            )
        case "stops":
            way = smooth(go, random.uniform(-8.0, 8.0), turn)
            begin = int(random.integers(scans // 4, scans // 2))
            return np.asarray(
                way[np.concatenate([np.arange(begin), np.full(scans // 4, begin), _rest(begin, scans)])]
            )
        case "jumps":
            way = smooth(go, random.uniform(-8.0, 8.0), turn)
            for at in random.integers(3, scans - 3, 2):
                way[at:] += random.normal(0.0, [3.0, 3.0, 0.2])
            return way
        case "along":
            along = CubicSpline([0.0, 0.5, 1.0], [-0.5, random.uniform(-0.12, 0.12), 0.5])(t)
            return np.asarray(centre + np.outer(along, [0.0, random.uniform(6.0, 25.0), 0.0]))
        case "still":
            return np.tile(centre, (scans, 1))
        case "presses":
            return np.column_stack(
                [random.uniform(36.0, 64.0, (scans, 2)), random.uniform(0.0, 2.0 * np.pi, scans)]
            )
    first, then = smooth(go, random.uniform(-8.0, 8.0), turn), smooth(-go, random.uniform(-8.0, 8.0), -turn)
    then += [*random.uniform(-6.0, 6.0, 2), random.uniform(0.0, 2.0 * np.pi)]
    return np.vstack([first[: scans // 2], then[: scans - scans // 2]])


def _rest(begin: int, scans: int) -> Array:
    """Return the scans of a way from `begin` to its end, that take a quarter of it less time than it has."""
    return np.linspace(begin, scans - 1, scans - begin - scans // 4).round().astype(int)


def _changing(outline: Array, body: str, scans: int, random: np.random.Generator) -> list[Array]:
    """Return the outline in each scan, in its frame."""
    t = np.linspace(-0.5, 0.5, scans)
    match body:
        case "grows":
            return [outline * (1.0 + s) for s in random.uniform(0.15, 0.3) * t]
        case "creeps":
            return [outline * (1.0 + s) for s in random.uniform(0.03, 0.1) * t]
        case "shears":
            return [outline @ np.array([[1.0, 0.0], [s, 1.0]]) for s in random.uniform(0.3, 0.6) * t]
        case "rolls":  # over its edges: what is in touch goes from one face to another
            other = drawn_outline("convex", random, float(np.hypot(*outline.T).max()))
            a, b = _by_angle(outline), _by_angle(other)
            return [(0.5 - s) * a + (0.5 + s) * b for s in t]
    return [outline] * scans


def _by_angle(outline: Array, places: int = 180) -> Array:
    """Return where rays from the origin leave an outline."""
    angle = np.linspace(0.0, 2.0 * np.pi, places, endpoint=False)
    found = []
    for c, s in zip(np.cos(angle), np.sin(angle), strict=True):
        ray = shapely.LineString([(0.0, 0.0), (200.0 * c, 200.0 * s)]).intersection(shapely.Polygon(outline))
        found.append(ray.length * np.array([c, s]))
    return np.array(found)


def _posed(outlines: list[Array], way: Array) -> list[Array]:
    return [at(o, pose) for o, pose in zip(outlines, way, strict=True)]


def _shares(outline: Array, least: float) -> bool:
    """Whether so much of an outline lies on the sensor."""
    shape = shapely.Polygon(outline)
    return bool(shape.intersection(shapely.box(0.0, 0.0, _SIDE, _SIDE)).area > least * shape.area)


def _all_seen(outlines: list[Array]) -> bool:
    """Whether every corner is well on the sensor in a fifth of the scans at least: else no one can count them."""
    on = (np.stack(outlines) > 2.0).all(axis=2) & (np.stack(outlines) < _SIDE - 2.0).all(axis=2)
    return bool(on.mean(axis=0).min() > 0.2)


def _overlap(a: Array, b: Array) -> float:
    return float(min(a[:, 0].max(), b[:, 0].max()) - max(a[:, 0].min(), b[:, 0].min()))


def told(of: Scene) -> Told:
    """Return what a rigid scene tells: poses of one signature are known to be cubics in time, if they are, else free.

    No motion is smoother; two presses have a cubic each.
    """
    assert of.outline is not None
    t, basis = np.linspace(-1.0, 1.0, len(of.poses)), np.eye(len(of.poses))
    if len(of.unit.names) == 1 and of.motion not in ("presses", "along", "still"):
        parts = [t < 0.0, t >= 0.0] if of.motion == "two presses" else [np.full(len(t), True)]
        basis = np.hstack([np.vander(t, 4) * part[:, None] for part in parts])
    shown, offset = ~np.isnan(of.read.reshape(len(t), -1)), _OFFSET * ("offsets" in of.row.noises)
    return Told(of.unit, of.outline, of.poses, shown, of.row.level / math.sqrt(3.0), offset, basis)


def limits(name: str, scenes: list[Scene], mm: float, draws: int = 120) -> str:
    """Return a row of the table of what scenes allow: bounds, and errors that no estimator is below on the whole."""
    random, bounds, errors = np.random.default_rng(5), list[float](), list[Array]()
    for of in (of for of in scenes if of.outline is not None and not of.curved):
        known = told(of)
        bounds.append(math.sqrt(known.cramer_rao().trace() / len(known.outline)))
        off = known.draws(random, draws)
        errors.append(np.sqrt(np.square(off - off.mean(axis=0)).sum(axis=2).mean(axis=1)))
    cells = [name, str(len(bounds))]
    for values, least in (
        (np.array(bounds), np.array(bounds)),
        (np.concatenate(errors), np.sqrt(np.square(errors).mean(axis=1))),
    ):
        cells += [f"{np.quantile(values, q):.3f}" for q in (0.5, 0.9)] + [f"{(least > mm).mean():.2f}"]
    return "| " + " | ".join(cells) + " |"


def judged(of: Scene) -> Verdict:
    """Return what the package makes of a scene."""
    scans, noise = of.scans, of.told
    begun = time.thread_time()
    tracks = ts.track(scans, of.unit.sensor, noise)
    spent = 1e3 * (time.thread_time() - begun) / len(scans)
    if not tracks:
        return Verdict(ms=spent)
    one = max(tracks, key=lambda t: int(t.present.sum()))
    found = Verdict(one.status, any(t.status in CLAIMS for t in tracks), advice=one.advice, ms=spent)
    if of.outline is None:
        return found
    shown = np.flatnonzero(one.present)
    overlaps = [
        _iou(one.placed(int(i)), at(of.outline, of.poses[i])) for i in shown[:: max(1, len(shown) // 12)]
    ]
    found.iou = float(np.median(overlaps)) if overlaps else 0.0
    found.far = _median_distance(one, of, shown)
    size = float(np.ptp(of.outline, axis=0).max())
    corner = 0.0 if one.covariance is None else _loosest(one)
    found.beyond = found.far > max(_SIGMAS * corner, _TOLD * of.unit.pitch, _OF_SIZE * size)
    if one.covariance is not None and one.by_scan is None:
        found.place_squares = [_place_square(one, of, int(i)) for i in shown]
    found.counted = of.curved or len(one.outline) == len(of.outline)
    found.unsaid = not found.counted and _unsaid(one, of, shown)
    found.right = found.iou >= RIGHT and found.counted
    if of.curved or not found.counted:
        return found
    shift, moved = _onto(one.outline, of.outline)
    off = moved - (of.outline - of.outline.mean(axis=0))
    found.rms, found.bound = (
        math.sqrt((off**2).sum() / len(off)),
        math.sqrt(told(of).cramer_rao().trace() / len(off)),
    )
    stated = 0.0 if one.covariance is None else math.sqrt(one.covariance.trace() / len(off))
    found.right &= found.rms <= max(_SIGMAS * stated, _TOLD * of.unit.pitch, _OF_SIZE * size)
    if one.covariance is not None and one.by_scan is None:
        found.shape_square = _shape_square(one, of.outline, shift)
        first = int(shown[0])
        true, own = at(of.outline, of.poses[first]), one.placed(first)
        # a half turn may bring an outline onto itself
        shift = min(range(len(own)), key=lambda by: float(((np.roll(own, by, axis=0) - true) ** 2).sum()))
        found.pose_squares = [_pose_square(one, of, shift, int(i)) for i in shown]
    return found


def _median_distance(one: ts.Track, of: Scene, shown: IntArray) -> float:
    assert of.outline is not None
    few = [int(i) for i in shown[:: max(1, len(shown) // 12)]]
    if not len(one.outline):
        return math.inf
    apart = [hausdorff_mm(at(one.outline, one.poses[i]), at(of.outline, of.poses[i])) for i in few]
    return float(np.median(apart))


def _unsaid(one: ts.Track, of: Scene, shown: IntArray) -> bool:
    """Whether a corner lies farther from the other outline than the track says that one more unseen may change it."""
    assert of.outline is not None
    if len(one.unseen_corner_mm) != len(one.outline):
        return True
    poses, back = one.poses[shown], []
    for pose, own in zip(poses, of.poses[shown], strict=True):
        away = at(of.outline, own) - pose[:2]
        back.append(at(away, np.array([0.0, 0.0, -pose[2]])))
    true, said = np.median(back, axis=0), one.unseen_corner_mm
    apart, edge = _from_edges(true, one.outline)
    missing, _ = _from_edges(one.outline, true)
    return bool((apart > said[edge]).any() or (missing > np.maximum(said, np.roll(said, 1))).any())


def _from_edges(points: Array, outline: Array) -> tuple[Array, IntArray]:
    """Return how far points (M, 2) are from an outline [mm], and from which edge each (M,)."""
    along = np.roll(outline, -1, axis=0) - outline
    from_begin = points[:, None] - outline
    share = np.clip((from_begin * along).sum(axis=2) / (along**2).sum(axis=1), 0.0, 1.0)
    apart = np.hypot(*(from_begin - share[..., None] * along).transpose(2, 0, 1))
    return apart.min(axis=1), apart.argmin(axis=1)


def hausdorff_mm(a: Array, b: Array) -> float:
    """Return Hausdorff's distance of two outlines (N, 2) [mm]."""
    return float(shapely.Polygon(a).buffer(0).hausdorff_distance(shapely.Polygon(b)))


def _loosest(one: ts.Track) -> float:
    """Return the stated deviation of the corner that is known least [mm], in the median scan."""
    assert one.covariance is not None
    moved = np.nanmedian(one.pose_covariances[:, :2, :2].trace(axis1=1, axis2=2))
    return math.sqrt(float(one.covariance.diagonal().reshape(-1, 2).sum(axis=1).max() + moved))


def _iou(a: Array, b: Array) -> float:
    board = shapely.box(0.0, 0.0, _SIDE, _SIDE)
    p, q = (shapely.Polygon(v).buffer(0.0).intersection(board) for v in (a, b))
    return float(p.intersection(q).area / max(p.union(q).area, 1e-9))


def _onto(found: Array, true: Array) -> tuple[int, Array]:
    """Return by how many corners to roll what was found, and it moved onto the true corners about their mean."""
    b, best = true - true.mean(axis=0), (math.inf, 0, true)
    for shift in range(len(true)):
        a = np.roll(found - found.mean(axis=0), shift, axis=0)
        turn = -math.atan2((a[:, 0] * -b[:, 1] + a[:, 1] * b[:, 0]).sum(), (a * b).sum())
        moved = at(a, np.array([0.0, 0.0, turn]))
        best = min(best, (float(((moved - b) ** 2).sum()), shift, moved), key=lambda p: p[0])
    return best[1], best[2]


def _shape_square(one: ts.Track, true: Array, shift: int) -> float:
    """Return the probability that chi square is below the shape's error over its stated covariance."""
    assert one.covariance is not None
    a = np.roll(one.outline - one.outline.mean(axis=0), shift, axis=0)
    _, back = _onto(true, a)  # the truth, in the track's frame
    off = (a - back).ravel()
    covariance = np.roll(np.roll(one.covariance, 2 * shift, axis=0), 2 * shift, axis=1)
    value, vector = np.linalg.eigh(covariance)
    off, value = (off @ vector)[3:], value[3:]
    return float(chdtr(len(value), (off**2 / value).sum()))


def _pose_square(one: ts.Track, of: Scene, shift: int, scan: int) -> float:
    """Return that of a pose: where the true outline lies in the track's frame."""
    assert of.outline is not None
    true, own = at(of.outline, of.poses[scan]), np.roll(one.placed(scan), shift, axis=0)
    a, b = own - own.mean(axis=0), true - true.mean(axis=0)
    turned = math.atan2((b[:, 0] * a[:, 1] - b[:, 1] * a[:, 0]).sum(), (a * b).sum())
    error = np.array([*(own.mean(axis=0) - true.mean(axis=0)), turned])
    return float(chdtr(3, error @ np.linalg.solve(one.pose_covariances[scan], error)))


def _place_square(one: ts.Track, of: Scene, scan: int) -> float:
    """Return that of the place of an outline's centroid."""
    assert of.outline is not None
    true = at(shapely.get_coordinates(shapely.Polygon(of.outline).centroid), of.poses[scan])[0]
    x, y = one.centroids[scan] - one.poses[scan, :2]
    by = np.array([[1.0, 0.0, -y], [0.0, 1.0, x]])
    error = one.centroids[scan] - true
    return float(chdtr(2, error @ np.linalg.solve(by @ one.pose_covariances[scan] @ by.T, error)))


def claims(scenes: list[Scene], found: list[Verdict]) -> str:
    """Return a table of what tracks claim and what holds, by what was drawn."""
    keys: dict[str, Callable[[Scene, Verdict], str]] = {
        "all": lambda s, v: "all",
        "status": lambda s, v: v.status,
        "shape": lambda s, v: s.kind,
        "motion": lambda s, v: s.motion,
        "noise": lambda s, v: s.noise,
        "scans": lambda s, v: str(len(s.poses)),
    }
    lines = [CLAIMS_HEAD]
    for what, key in keys.items():
        of_each = [key(s, v) for s, v in zip(scenes, found, strict=True)]
        for value in dict.fromkeys(of_each):
            some = [v for v, own in zip(found, of_each, strict=True) if own == value]
            said = [v for v in some if v.claims]
            status = [v.status for v in some]
            cells = [f"{what}: {value}", str(len(some)), *(str(status.count(s)) for s in ("ok", "likely"))]
            cells += [str(sum(wrong)) for wrong in ([v.beyond for v in said], [v.iou < RIGHT for v in said])]
            cells += [str(sum(wrong)) for wrong in ([not v.counted for v in said], [v.unsaid for v in said])]
            cells.append(f"{sum(not v.claims and not v.beyond and v.counted for v in some)}")
            for part in (said, some):
                held = [v.shape_square < LEVEL for v in part if np.isfinite(v.shape_square)]
                cells.append(f"{np.mean(held):.2f} of {len(held)}" if held else "-")
                for squares in ([v.pose_squares for v in part], [v.place_squares for v in part]):
                    every = [p < LEVEL for of_one in squares for p in of_one]
                    cells.append(f"{np.mean(every):.3f}" if every else "-")
            lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def line(name: str, found: list[Verdict]) -> str:
    """Return a row of the table."""
    rigid = ROWS[name].body in ("rigid", "creeps")
    status = [v.status for v in found]
    rms = np.array([v.rms for v in found if np.isfinite(v.rms)])
    over = np.array([v.rms / v.bound for v in found if np.isfinite(v.rms)])
    wrong = sum(v.claims and not v.right for v in found)
    shape = [v.shape_square < LEVEL for v in found if np.isfinite(v.shape_square) and v.right]
    poses = [p < LEVEL for v in found if v.right for p in v.pose_squares]
    cells = [name, str(len(found)), *(str(status.count(s)) for s in ("ok", "likely", "doubtful")), str(wrong)]
    cells.append(str(sum(v.right and v.status == "doubtful" for v in found)) if rigid else "-")
    cells.append(f"{np.mean([v.counted for v in found]):.2f}" if rigid else "-")
    numbers: list[tuple[Callable[[], float], str]] = [
        (lambda: float(np.median(rms)), ".3f"), (lambda: float(np.quantile(rms, 0.9)), ".3f"),
        (lambda: float(np.median(over)), ".2f"), (lambda: float(np.quantile(over, 0.9)), ".2f"),
    ]  # fmt: skip
    cells += [format(number(), how) if len(rms) else "-" for number, how in numbers]
    cells += [f"{np.mean(part):.2f}" if part else "-" for part in (shape, poses)]
    return "| " + " | ".join([*cells, f"{np.median([v.ms for v in found]):.1f}"]) + " |"


HEAD = (
    "| row | scenes | ok | likely | doubtful | silent wrong | right, doubted | count | RMS | p90 | over bound | p90 | "
    "95 % shape | poses | ms a scan |\n" + "| --- " * 15 + "|"
)
CLAIMS_HEAD = (
    "| drawn | scenes | ok | likely | claimed: beyond | IoU < .8 | count | and unsaid | right, doubted "
    "| claimed: 95 % shape | poses | places | all: 95 % shape | poses | places |\n" + "| --- " * 15 + "|"
)
LIMITS = (
    "| row | scenes | bound of the readings, median | p90 | above {mm:g} mm "
    "| least error with touched strips, median | p90 | above {mm:g} mm |\n" + "| --- " * 8 + "|"
)


def scene_options(description: str, scenes: int) -> argparse.ArgumentParser:
    """Return a parser of how many scenes, by default `scenes`, of which seed."""
    options = argparse.ArgumentParser(description=description)
    options.add_argument("--scenes", type=int, default=scenes)
    options.add_argument(
        "--seed", type=int, default=0, help=f"0 to 9 to tune; from {FINAL} on: once, at the end"
    )
    options.add_argument("--final", action="store_true", help=f"unlocks seeds from {FINAL} on")
    return options


def unlocked(options: argparse.ArgumentParser) -> argparse.Namespace:
    """Return the options given; ends the program at a seed that decides, where nobody said so."""
    given = options.parse_args()
    if given.seed >= FINAL and not given.final:
        options.error(f"seeds from {FINAL} on decide: --final")
    return given


def main() -> None:
    """Print a row of a table for each kind of scene."""
    options = scene_options("Tracks of rigid outlines, and of what is none, beside the truth.", scenes=25)
    options.add_argument("--rows", help="names, separated by semicolons; left out: all")
    options.add_argument(
        "--limits",
        type=float,
        metavar="MM",
        help="no tracks: what the scenes allow, and how often it is above so much",
    )
    options.add_argument("--noises", help="in place of the rows' own, separated by semicolons")
    options.add_argument("--claims", action="store_true", help="a table by shape, motion, noise and scans")
    options.add_argument("--verbose", action="store_true", help="a line for every scene")
    given = unlocked(options)
    rows = given.rows.split(";") if given.rows else list(ROWS)
    if unknown := [name for name in rows if name not in ROWS]:
        options.error(one_of("--rows", unknown[0], ROWS))
    noises = tuple(given.noises.split(";")) if given.noises else ()
    print(HEAD if given.limits is None else LIMITS.format(mm=given.limits), flush=True)  # noqa: T201
    for name in rows:
        if given.limits is not None:
            scenes = [scene(name, given.seed, number, noises) for number in range(given.scenes)]
            print(limits(name, scenes, given.limits), flush=True)  # noqa: T201
            continue
        scenes, found = list[Scene](), list[Verdict]()
        for number in range(given.scenes):
            scenes.append(of := scene(name, given.seed, number, noises))
            found.append(one := judged(of))
            if given.verbose:
                corners = 0 if of.outline is None or of.curved else len(of.outline)
                print(  # noqa: T201
                    f"{number:3d} {of.kind} {of.motion} {of.noise} {len(of.poses)} {corners} {one.status:9s} "
                    f"{'right' if one.right else 'wrong'} count {one.counted} far {one.far:.2f} "
                    f"{'beyond ' * one.beyond}{'unsaid ' * one.unsaid}rms {one.rms:.3f} "
                    f"bound {one.bound:.3f} iou {one.iou:.3f} "
                    f"shape {one.shape_square:.3f} poses {np.mean(np.array(one.pose_squares) < LEVEL):.2f} "
                    f"places {np.mean(np.array(one.place_squares) < LEVEL):.2f} {one.ms:.1f} ms {one.advice[:120]}",
                    flush=True,
                )
        print(line(name, found), flush=True)  # noqa: T201
        if given.claims:
            print(claims(scenes, found), flush=True)  # noqa: T201


if __name__ == "__main__":
    main()
