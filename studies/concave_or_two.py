"""Two objects or a concave one: the least false doubt of a rule that lets 1 % of pairs pass as one object.

Run: python -m studies.concave_or_two [--cases 12000] [--seed 1]

Contacts of both signatures on 12 strips or more, drawn as the hold-out's `--set pairs` draws them: concave shapes, and
pairs that no convex outline explains. Networks, of which the
mean counts, learn from three quarters of them, by l and u that the readings give,
which are pairs; nothing is fitted to an outline. On the rest a line says how many concave shapes look more like a pair
than the pairs that make up the least 1 % (2 %, 4 %) do:

- "as drawn": they know all families of the hold-out, and how large it draws what;
- "by size alone": strips, height over breadth, and height over the strips' length are all that others see;
- "sizes alike": contacts weigh so much that these three are as frequent among pairs as among concave shapes;
- "new family": concave shapes of each family by networks that saw the others (all pairs).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import expit

from studies.holdout import cases
from studies.holdout.cases import Case
from studies.holdout.convexity import best_convex
from studies.holdout.score import LEAST_P
from studies.holdout.shapes import CONCAVE, Array
from studies.options import of_cases
from tacstrip.arrays import BoolArray
from tacstrip.reconstruction.contact_ends import closed_ends, end_deviations
from tacstrip.reconstruction.pieces.run import noise_level

_STRIPS, _NOISE = (12, 101), (0.0005, 0.02)
_COLUMNS, _FEWEST = 32, 12  # places at which ends are seen; strips in touch
_SIZES = 3  # the first features: strips, height over breadth, height over L
_HIDDEN, _EPOCHS, _BATCH, _RATE, _SHRINK = (96, 48), 40, 128, 2e-3, 1e-4  # of the network and of Adam
_MOMENTS, _SMALL, _FAR = (0.9, 0.999), 1e-8, 6.0
_NETWORKS = 3  # whose mean counts
_MISSED = (0.01, 0.02, 0.04)  # of pairs
_LAYER = 2  # arrays of a layer: weights, offsets


class Contacts(NamedTuple):
    """Features (N, M), whether a contact is a pair (N,), and families (N,)."""

    features: Array
    two: BoolArray
    family: npt.NDArray[np.str_]


def drawn(random: np.random.Generator, family: str) -> Case:
    """Return a contact of a family, or a "pair", as `cases.pairs` draws it on 12 strips or more."""
    strips = 20 if random.random() < 0.47 else int(cases.log_uniform(random, *_STRIPS))
    half_width = cases.log_uniform(random, *_NOISE)
    if family == "pair":
        return cases.pair(random, strips, ("kh", "kl"), half_width)
    return cases.single(random, family, strips, ("kh", "kl"), half_width)


def features(case: Case) -> Array | None:
    """Return what is seen of a contact; None of few strips, where readings have no ends, or where none tell."""
    unit, on = case.unit, np.isfinite(case.low)
    read, told = unit.digitised(case.read)[:, on], unit.sigma(case.half_width)
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.stack(closed_ends(unit.sensor, *read))
    if on.sum() < _FEWEST or not np.isfinite(ends).all():
        return None
    convex = best_convex(unit, np.clip(case.read, 0.0, 1.0), told, case.low, case.high)
    if case.group == "pair" and convex.p >= LEAST_P:
        return None
    sigma = told if case.told else noise_level(read, unit.sensor)
    noise = np.stack(end_deviations(unit.sensor, ends[0], ends[1], sigma))
    chains = ends * [[1.0], [-1.0]]
    deep = chains - [_below(chain) for chain in chains]  # within the hull
    if deep[1].max() > deep[0].max():  # seen from above or below, and from left or right: one contact
        chains, deep, noise = chains[::-1], deep[::-1], noise[::-1]
    if deep[0] @ (np.arange(deep.shape[1]) - 0.5 * (deep.shape[1] - 1)) > 0.0:
        chains, deep, noise = chains[:, ::-1], deep[:, ::-1], noise[:, ::-1]
    strips, height = deep.shape[1], float(np.ptp(ends))
    at = np.linspace(0, strips - 1, _COLUMNS)
    shown = [np.interp(at, np.arange(strips), y) / height for y in (*(chains - chains[0].min()), *deep)]
    sizes = np.log([strips, height / (strips * unit.pitch), height / unit.length])
    errors = np.log(np.median(noise, axis=1) / height)
    jumps = [np.sort(np.abs(np.diff(y)))[-2:] / height for y in chains]
    clear = np.log1p([convex.chi_square * (told / sigma) ** 2, *(deep / noise).max(axis=1)])
    return np.concatenate([sizes, errors, [case.told], clear, *jumps, *shown])


def _below(y: Array) -> Array:
    """Return the lower convex hull (n,) of a chain."""
    kept: list[int] = []
    for i in range(len(y)):
        while len(kept) > 1 and (y[kept[-1]] - y[kept[-2]]) * (i - kept[-2]) >= (y[i] - y[kept[-2]]) * (
            kept[-1] - kept[-2]
        ):
            kept.pop()
        kept.append(i)
    return np.asarray(np.interp(np.arange(len(y)), kept, y[kept]))


def contacts(count: int, seed: int) -> Contacts:
    """Draw as many pairs as concave shapes, and keep what is seen of each."""
    found = []
    for number in range(count):
        family = CONCAVE[number // 2 % len(CONCAVE)] if number % 2 else "pair"
        seen = features(drawn(np.random.default_rng([seed, number]), family))
        if seen is not None:
            found.append((seen, family))
    families = np.array([family for _, family in found])
    return Contacts(np.stack([seen for seen, _ in found]), families == "pair", families)


def network(x: Array, two: BoolArray, weight: Array, random: np.random.Generator) -> list[Array]:
    """Return layers fitted to which of x (N, M) are two objects, by Adam."""
    widths = (x.shape[1], *_HIDDEN, 1)
    layers: list[Array] = []
    for a, b in pairwise(widths):
        layers += [random.normal(size=(a, b)) * np.sqrt(2.0 / a), np.zeros(b)]
    first, second = ([np.zeros_like(part) for part in layers] for _ in range(2))
    steps = _EPOCHS * (len(x) // _BATCH)
    for step in range(1, steps + 1):
        some = random.integers(len(x), size=_BATCH)
        rate = _RATE * 0.5 * (1.0 + np.cos(np.pi * step / steps))
        for part, slope, mean, square in zip(
            layers, _slopes(layers, x[some], two[some], weight[some]), first, second, strict=True
        ):
            mean += (1.0 - _MOMENTS[0]) * (slope - mean)
            square += (1.0 - _MOMENTS[1]) * (slope**2 - square)
            off = (mean / (1.0 - _MOMENTS[0] ** step)) / (
                np.sqrt(square / (1.0 - _MOMENTS[1] ** step)) + _SMALL
            )
            part -= rate * (off + _SHRINK * part)
    return layers


def log_odds(layers: Sequence[Array], x: Array) -> Array:
    """Return log odds (N,) of two objects."""
    return _forward(layers, x)[-1][:, 0]


def _forward(layers: Sequence[Array], x: Array) -> list[Array]:
    found = [x]
    for i in range(0, len(layers), _LAYER):
        out = found[-1] @ layers[i] + layers[i + 1]
        found.append(np.maximum(out, 0.0) if i + _LAYER < len(layers) else out)
    return found


def _slopes(layers: Sequence[Array], x: Array, two: BoolArray, weight: Array) -> list[Array]:
    """Return derivatives of the mean log loss by each part of the layers."""
    found = _forward(layers, x)
    back = ((expit(found[-1][:, 0]) - two) * weight / len(x))[:, None]
    slopes: list[Array] = []
    for i in range(len(layers) - _LAYER, -1, -_LAYER):
        inward = found[i // _LAYER]
        slopes = [inward.T @ back, back.sum(axis=0), *slopes]
        back = back @ layers[i].T * (inward > 0.0)
    return slopes


def doubted(odds: Array, two: BoolArray, weight: Array, missed: float) -> float:
    """Return the share of concave shapes at or above the log odds that so many pairs stay below, by weight."""
    order = np.argsort(odds[two])
    least = odds[two][order][np.searchsorted(np.cumsum(weight[two][order]), missed * weight[two].sum())]
    return float(weight[~two][odds[~two] >= least].sum() / weight[~two].sum())


def table(count: int, seed: int) -> list[str]:
    """Return the shares of concave shapes that each network doubts."""
    whole, random = contacts(count, seed), np.random.default_rng(seed)
    spread = np.maximum(whole.features.std(axis=0), _SMALL)
    x, two = np.clip((whole.features - whole.features.mean(axis=0)) / spread, -_FAR, _FAR), whole.two
    learns = np.arange(len(x)) % 4 > 0
    tested, every = ~learns, np.ones(len(x))
    title = "missed"
    lines = [
        f"{learns.sum()} contacts to learn from, {tested.sum()} others to ask",
        f"{title:30}" + "".join(f"{100.0 * m:6.0f} %" for m in _MISSED),
    ]

    def learned(seen: Array, which: BoolArray, weight: Array) -> Array:
        some = [network(seen[which], two[which], weight[which], random) for _ in range(_NETWORKS)]
        return np.asarray(np.mean([log_odds(layers, seen) for layers in some], axis=0))

    def line(name: str, odds: Array, which: BoolArray, weight: Array) -> str:
        shares = [doubted(odds[which], two[which], weight[which], m) for m in _MISSED]
        return f"{name:30}" + "".join(f"{100.0 * share:6.1f} %" for share in shares)

    by_size = learned(x[:, :_SIZES], learns, every)
    other = np.clip(expit(np.where(two, -by_size, by_size)), 0.02, 0.98)
    alike = other / other.mean()  # by how likely another of this size is of the other kind
    lines.append(line("as drawn", learned(x, learns, every), tested, every))
    lines.append(line("by size alone", by_size, tested, every))
    lines.append(line("sizes alike", learned(x, learns, alike), tested, alike))
    for family in CONCAVE:
        own = whole.family == family
        odds = learned(x, learns & ~own, every)
        lines.append(line(f"new family: {family}", odds, (tested & two) | own, every))
    return lines


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table that the command line asks for."""
    asked = of_cases("studies.concave_or_two", __doc__, 12000).parse_args(arguments)
    print("\n".join(table(asked.cases, asked.seed)))  # noqa: T201


if __name__ == "__main__":
    main()
