"""What one signature can tell at best: the posterior of somebody who knows how the hold-out's outlines are drawn.

Run: python -m studies.one_signature_limit [--cases 60] [--seed 1]

Contacts are drawn as `studies/holdout` does, but without weak corners, on 12 to 40 strips, with known normal noise of
.2 to 1 %. Sequential Monte Carlo over that generator's own random numbers gives outlines as often as the readings make
them likely, so that the probability of an IoU of .8 is the best that any rule can go by. Printed: the share of wrong
`ok` ("silent") at each share of false doubts, for the package's confidence, for the best confidence of its outline, and
for the best outline. Last, what the posterior said and what was: where these part, particles have missed the family.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import ndtri

import tacstrip as ts
from studies.holdout import cases
from studies.holdout.readings import Unit, white
from studies.holdout.score import GOOD, RIGHT
from studies.holdout.shapes import CONVEX, PLAIN
from tacstrip.geometry.metrics import column_iou

Array = npt.NDArray[np.float64]

KINDS = tuple(kind for kind in CONVEX if kind != "weak corner")
SHAPES = tuple(kind for kind in KINDS if not kind.startswith("over"))
INSIDE, LEFT, RIGHT_SIDE, BELOW, ABOVE = range(5)  # where an outline lies on the sensor
_LATENTS = 32  # numbers uniform in 0 to 1 that make one outline
_POINTS = 12  # of which a hull is made at most
_PRIOR, _PARTICLES, _SWEEPS, _MOST_LEVELS = 16_000, 1_000, 4, 120
_COLUMNS = 64
_FALSE_DOUBTS = (0.05, 0.10, 0.17, 0.25, 0.35, 0.5)
_PAIRS = np.triu_indices(_POINTS, 1)


@dataclass
class Particles:
    """Outlines by the numbers that make them: shape and place, uniform numbers (P, `_LATENTS`), log of the weight."""

    shape: npt.NDArray[np.int64]
    place: npt.NDArray[np.int64]
    latent: Array
    log_prior: Array
    misfit: Array  # half the squared residuals over sigma^2

    def take(self, at: npt.NDArray[np.int64]) -> Particles:
        """Return those at some indices."""
        return Particles(self.shape[at], self.place[at], self.latent[at], self.log_prior[at], self.misfit[at])


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


def _points(shape: int, z: Array) -> tuple[Array, bool]:
    """Return points (P, N, 2) of which an outline is the hull, of latents (P, 28), and whether they are in order."""
    name, height = SHAPES[shape], np.exp(-1.0 + 1.7 * z[:, 0])
    turn = 0.06 + (0.5 * np.pi - 0.12) * z[:, 1]
    one, zero = np.ones_like(height), np.zeros_like(height)
    if name == "triangle":
        return ndtri(z[:, 4:10]).reshape(-1, 3, 2), True
    if name in ("hull", "one upright side"):
        flat = np.exp(-0.7 + 1.4 * z[:, 0])
        points = ndtri(z[:, 4:28]).reshape(-1, _POINTS, 2) * np.stack([one, flat], axis=1)[:, None]
        used = np.arange(_POINTS) < (4 + np.floor(9.0 * z[:, 2]))[:, None]
        return _turned(np.where(used[..., None], points, points[:, :1]), np.pi * z[:, 1]), False
    if name in ("ellipse", "circle"):
        angle = 2.0 * np.pi * np.arange(48) / 48
        flat = one if name == "circle" else height
        ring = np.stack([np.cos(angle) * one[:, None], np.sin(angle) * flat[:, None]], axis=2)
        return _turned(ring, turn if name == "ellipse" else zero), True
    if name == "trapezoid":
        top = 0.15 + 0.7 * z[:, 2]
        start = -0.3 + (1.6 - top) * z[:, 3]
        ring = np.stack(
            [
                np.stack(p, axis=1)
                for p in ((zero, zero), (one, zero), (start + top, height), (start, height))
            ],
            axis=1,
        )
        quarters = np.floor(4.0 * z[:, 4])
        return _turned(ring, np.where(quarters < 3.0, 0.5 * np.pi * quarters, 4.0 * turn)), True
    box = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
    size = np.stack([one, height], axis=1)[:, None]
    if name == "rounded":
        radius = (0.1 + 0.35 * z[:, 2]) * np.minimum(1.0, height)
        angle = np.pi * (1.0 + 0.5 * np.repeat(np.arange(4), 8) + 0.5 * np.tile(np.arange(8) / 7.0, 4))
        arc = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        inner = radius[:, None, None] + np.repeat(box, 8, axis=0) * (size - 2.0 * radius[:, None, None])
        return _turned(inner + radius[:, None, None] * arc, np.where(z[:, 3] < 0.5, 0.0, turn)), True
    return _turned(box * size, turn if name == "rotated rectangle" else zero), True


def _turned(points: Array, angle: Array) -> Array:
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    return np.stack(
        [c * points[..., 0] - s * points[..., 1], s * points[..., 0] + c * points[..., 1]], axis=2
    )


def _ends(points: Array, ordered: bool, x: Array) -> tuple[Array, Array]:
    """Return the lowest and highest y (P, G) of hulls at x (P, G); inf and -inf outside."""
    count = points.shape[1]
    i, j = (np.arange(count), np.roll(np.arange(count), -1)) if ordered else _PAIRS
    low, high = np.full(x.shape, np.inf, np.float32), np.full(x.shape, -np.inf, np.float32)
    p, at = points.astype(np.float32), x.astype(np.float32)
    with np.errstate(divide="ignore", invalid="ignore"):
        for a, b in zip(i, j, strict=True):
            part = (at - p[:, a, None, 0]) / (p[:, b, None, 0] - p[:, a, None, 0])
            y = p[:, a, None, 1] + part * (p[:, b, None, 1] - p[:, a, None, 1])
            out = ~((part >= 0.0) & (part <= 1.0))
            y[out] = np.inf
            np.minimum(low, y, out=low)
            y[out] = -np.inf
            np.maximum(high, y, out=high)
    return low.astype(np.float64), high.astype(np.float64)


def laid(
    seen: Seen, shape: int, place: npt.NDArray[np.int64], z: Array, at: Array
) -> tuple[Array, Array, Array]:
    """Return l and u over the strip length (P, G) at `at` (G,) in pitches, and the log density of place and unit."""
    unit, n = seen.unit, seen.strips
    points, ordered = _points(shape, z)
    x, y = points[..., 0], points[..., 1]
    left, right, low, high = x.min(axis=1), x.max(axis=1), y.min(axis=1), y.max(axis=1)
    good, mirrored = np.ones(len(z), dtype=bool), np.zeros(len(z), dtype=bool)
    if ordered:  # no slivers; of hulls hardly any is one
        area = 0.5 * np.abs((x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)).sum(axis=1))
        good = area > 0.25 * (right - left) * (high - low)
    if SHAPES[shape] == "one upright side":
        left = left + (0.15 + 0.35 * z[:, 3]) * (right - left)
        cut = _ends(points, ordered, left[:, None])
        low = np.minimum(np.where(x >= left[:, None], y, np.inf).min(axis=1), cut[0][:, 0])
        high = np.maximum(np.where(x >= left[:, None], y, -np.inf).max(axis=1), cut[1][:, 0])
        mirrored = z[:, 28] < 0.5
    # Where it begins and ends, in pitches.
    cut_off = place >= BELOW
    begin = seen.first + 0.5 - z[:, 29] * np.where(cut_off, n, 1)
    end = seen.last + 0.5 + z[:, 30] * np.where(cut_off, n, 1)
    outside = 0.1 + 0.4 * z[:, 31]
    begin = np.where(place == LEFT, -outside * end / (1.0 - outside), begin)
    end = np.where(place == RIGHT_SIDE, (unit.strips - outside * begin) / (1.0 - outside), end)
    extent = end - begin
    visible = np.where((place == LEFT) | (place == RIGHT_SIDE), extent * (1.0 - outside), extent)
    asked = np.ceil(visible + 0.1)  # strips, of which the generator took .1 to .9 away
    room = unit.strips - extent
    good &= (asked - visible > 0.1) & (asked - visible < 0.9) & (asked <= unit.strips)
    good &= unit.strips < asked + asked // 2 + 3
    log = -np.log((asked // 2 + 3.0) * asked) + np.where(cut_off, 2.0 * np.log(n), 0.0)
    free = (place == INSIDE) | cut_off
    good &= ~free | ((room > 0.0) & (begin > 0.02 * room) & (begin < 0.98 * room))
    log -= np.where(free, np.log(np.maximum(room, 1e-9)), 0.0)
    tall = (high - low) / (right - left) * extent  # in pitches
    part = tall * unit.pitch / unit.length
    least = np.minimum(0.85, np.maximum(0.08, tall / (6.0 * asked)))
    good &= (part > least) & (part < 0.9)
    log -= np.log(np.log(0.9 / least))
    over = np.where(place == BELOW, -outside * part, 1.0 - part + outside * part)
    along = np.where(place == INSIDE, z[:, 31], z[:, 28])
    bottom = np.where(cut_off, over, (0.02 + 0.96 * along) * (1.0 - part))
    # Back to the outline's own coordinates.
    scale = (right - left) / extent
    own = np.where(mirrored[:, None], end[:, None] - at, at - begin[:, None]) * scale[:, None] + left[:, None]
    l, u = _ends(points, ordered, own)
    beyond = (own < left[:, None]) | (own > right[:, None])
    per = (unit.pitch / unit.length / scale)[:, None]
    l, u = (np.where(beyond, np.nan, bottom[:, None] + (v - low[:, None]) * per) for v in (l, u))
    l, u = np.maximum(l, 0.0), np.minimum(u, 1.0)
    touched = u >= l
    return np.where(touched, l, np.nan), np.where(touched, u, np.nan), np.where(good, log, -np.inf)


def _weigh(seen: Seen, some: Particles) -> None:
    """Set log density and misfit."""
    at: Array = np.arange(seen.first - 1, seen.last + 2, dtype=np.float64) + 0.5
    for shape in np.unique(some.shape):
        here = np.flatnonzero(some.shape == shape)
        l, u, log = laid(seen, int(shape), some.place[here], some.latent[here], at)
        there = np.isfinite(l)
        full = there[:, 1:-1].all(axis=1)
        full &= ~(there[:, 0] & (seen.first > 0)) & ~(there[:, -1] & (seen.last < seen.unit.strips - 1))
        with np.errstate(invalid="ignore"):
            read = seen.unit.read(l[:, 1:-1] * seen.unit.length, u[:, 1:-1] * seen.unit.length)[0]
        off = ((read - seen.read) ** 2).sum(axis=1) / (2.0 * seen.sigma**2)
        some.log_prior[here] = np.where(full, log, -np.inf)
        some.misfit[here] = np.where(full, off, np.inf)


def _from_prior(seen: Seen, random: np.random.Generator) -> Particles:
    kind = random.integers(len(KINDS), size=_PRIOR)
    names = np.array(KINDS)[kind]
    plain = random.integers(len(PLAIN), size=_PRIOR)
    over_x, over_y = names == "over left or right", names == "over top or bottom"
    name = np.where(over_x | over_y, np.array(PLAIN)[plain], names)
    shape = np.array([SHAPES.index(n) for n in name])
    place = np.where(over_x, LEFT, np.where(over_y, BELOW, INSIDE))
    place += ((place > INSIDE) & (random.random(_PRIOR) < 0.5)).astype(np.int64)
    some = Particles(
        shape, place, random.random((_PRIOR, _LATENTS)), np.full(_PRIOR, -np.inf), np.full(_PRIOR, np.inf)
    )
    impossible = (place == LEFT) & (seen.first > 0) | (place == RIGHT_SIDE) & (
        seen.last < seen.unit.strips - 1
    )
    some = some.take(np.flatnonzero(~impossible))
    _weigh(seen, some)
    return some.take(np.flatnonzero(np.isfinite(some.log_prior)))


def posterior(seen: Seen, random: np.random.Generator) -> Particles:
    """Return outlines as often as the readings make them likely, by tempering from the generator's own distribution."""
    some, heat = _from_prior(seen, random), 0.0  # inverse temperature
    weight = some.log_prior - some.log_prior.max(initial=-np.inf)
    if not len(weight):
        return some
    for _ in range(_MOST_LEVELS):
        step = _next(weight, some.misfit, 1.0 - heat)
        heat += step
        w = weight - step * (some.misfit - some.misfit.min())
        share = np.exp(w - w.max())
        share /= share.sum()
        at = np.searchsorted(np.cumsum(share), (np.arange(_PARTICLES) + random.random()) / _PARTICLES)
        some = some.take(np.minimum(at, len(share) - 1))
        weight = np.zeros(_PARTICLES)
        for _ in range(_SWEEPS * (3 if heat >= 1.0 else 1)):
            _move(seen, some, heat, random)
        if heat >= 1.0:
            break
    return some


def _next(weight: Array, misfit: Array, most: float) -> float:
    """Return the step of inverse temperature that leaves half of the particles."""

    def left(step: float) -> float:
        w = weight - step * (misfit - misfit.min())
        share = np.exp(w - w.max())
        return float(share.sum() ** 2 / (share**2).sum())

    wanted = min(0.5 * _PARTICLES, 0.9 * left(0.0))
    if left(most) >= wanted:
        return most
    low, high = 0.0, most
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if left(middle) > wanted else (low, middle)
    return max(low, 1e-9)


def _move(seen: Seen, some: Particles, heat: float, random: np.random.Generator) -> None:
    """One Metropolis step of every particle: along the difference of two others alike, or of a few numbers."""
    count = len(some.shape)
    trial = Particles(some.shape, some.place, some.latent.copy(), some.log_prior.copy(), some.misfit.copy())
    group = some.shape * 5 + some.place
    jump = np.empty_like(some.latent)
    for g in np.unique(group):
        here = np.flatnonzero(group == g)
        a, b = random.integers(len(here), size=(2, len(here)))
        jump[here] = some.latent[here[a]] - some.latent[here[b]]
    size = np.exp(random.uniform(np.log(0.03), np.log(1.2), (count, 1)))
    jump = size * jump + 1e-4 * random.normal(size=jump.shape)
    few = random.random((count, _LATENTS)) < 0.15
    fine = (
        few * np.exp(random.uniform(np.log(1e-3), np.log(0.5), (count, 1))) * random.normal(size=jump.shape)
    )
    trial.latent += np.where(random.random((count, 1)) < 0.6, jump, fine)
    trial.latent = np.abs(trial.latent) % 2.0
    trial.latent = np.clip(np.where(trial.latent > 1.0, 2.0 - trial.latent, trial.latent), 1e-12, 1.0 - 1e-12)
    _weigh(seen, trial)
    with np.errstate(invalid="ignore"):
        gain = trial.log_prior - some.log_prior - heat * (trial.misfit - some.misfit)
    taken = np.log(random.random(count)) < gain
    some.latent[taken] = trial.latent[taken]
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
    """

    kind: str
    iou: float
    best_iou: float
    said: float
    right: tuple[float, float]
    good: tuple[float, float]


def draw(random: np.random.Generator) -> tuple[cases.Case, Seen]:
    """Draw a contact of the hold-out's kinds, and what is seen of it."""
    noise = cases.log_uniform(random, 0.002, 0.01)
    name = str(random.choice(["kh", "kl", "k"], p=[0.36, 0.28, 0.36]))
    strips = int(cases.log_uniform(random, 12, 41))
    case = cases.single(random, str(random.choice(KINDS)), strips, (name,), noise)
    at = np.flatnonzero(np.isfinite(case.low))
    ideal, sigma = case.unit.read(case.low, case.high), noise / np.sqrt(3.0)
    read = ideal + white(ideal.shape, noise, "normal", random)
    return case, Seen(case.unit, int(at[0]), int(at[-1]), read[0, at], sigma)


def judge(case: cases.Case, seen: Seen, random: np.random.Generator) -> Judged | None:
    """Fit a case, and compare with its posterior; None where no outline drawn touches these strips only."""
    unit = seen.unit
    read = np.full((1, unit.strips), np.nan)
    read[0, seen.first : seen.last + 1] = np.clip(seen.read, 0.0, 1.0)
    noise = ts.Noise(positional=seen.sigma * float(np.sqrt(3.0)), distribution="normal")
    found = ts.fit_polygon(ts.Scan(**{unit.names[0]: read[0]}), unit.sensor, noise).objects[0]
    at = np.linspace(max(seen.first - 0.5, 0.0), min(seen.last + 1.5, unit.strips), 2 * _COLUMNS + 1)[1::2]
    some = posterior(seen, random)
    if not len(some.shape):
        return None
    ends = np.zeros((len(some.shape), 2, _COLUMNS))
    for shape in np.unique(some.shape):
        here = np.flatnonzero(some.shape == shape)
        l, u, _ = laid(seen, int(shape), some.place[here], some.latent[here], at)
        ends[here] = np.nan_to_num(np.stack([l, u], axis=1))
    truth = _columns(case.outlines[0] / [unit.pitch, unit.length], at)
    own = _columns(found.vertices / [unit.pitch, unit.length], at)
    few = ends[:: max(1, len(ends) // 200)]
    alike = column_iou(few[:, None], ends[None])
    best = few[int(np.argmax((alike >= RIGHT).mean(axis=1)))]
    overlaps = [column_iou(ends, one) for one in (own, best)]
    right, good = ([float((o >= level).mean()) for o in overlaps] for level in (RIGHT, GOOD))
    said = found.confidence or 0.0
    return Judged(
        case.group,
        float(column_iou(own, truth)),
        float(column_iou(best, truth)),
        said,
        (right[0], right[1]),
        (good[0], good[1]),
    )


def _columns(vertices: Array, at: Array) -> Array:
    l, u = (v[0] for v in _ends(vertices[None], True, at[None]))
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
    for low in (0.0, 0.2, 0.4, 0.6, 0.8):
        here = (right[0] >= low) & (right[0] < low + 0.2 + (low > 0.7))
        if here.any():
            was = (iou[0][here] >= RIGHT).mean()
            lines += [f"  posterior said {right[0][here].mean():.2f}, was {was:.2f} of {here.sum()}"]
    return "\n".join(lines)


def main() -> None:
    """Print the figures of the command line's cases."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cases", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    random, judged = np.random.default_rng(asked.seed), []
    for _ in range(asked.cases):
        case, seen = draw(random)
        judged.append(judge(case, seen, random))
    sys.stdout.write(report([one for one in judged if one is not None]) + "\n")


if __name__ == "__main__":
    main()
