"""Whether a confidence is what happens: statuses and confidences of drawn contacts against the truth.

Run: python -m studies.confidence [--signatures one|both] [--assessment thorough|fast] [--cases 330] [--seed 1]
    [--kinds concave] [--strips 5 11] [--area] [--families [--scored 905 906]]
Prints how many `ok` are wrong ("silent"), how many right ones are doubted, what was right of each tenth of confidence,
and the log odds by `assessment.doubts` that fit these cases best. `--families`: one signature on 12 strips or
more, as many cases of each of `FAMILIES`, each reported by itself, and the log odds of all of them together: as the
package's were found, but for an ellipse at the border. `--scored`: with the contacts of one signature, also on few
strips, of `studies.holdout.score --set convex --cases 600`, of each of these seeds.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any
from unittest import mock

import numpy as np
import numpy.typing as npt
import shapely

import tacstrip as ts
from studies.holdout import cases as holdout
from studies.holdout import shapes
from studies.holdout.score import told_noise
from studies.options import of_cases
from studies.outlines import CONVEX, Case, case
from studies.outlines import ONE as KINDS
from tacstrip.arrays import FloatArray
from tacstrip.core.outline_model import OutlineModel
from tacstrip.geometry.outline import Outline
from tacstrip.reconstruction.polygon.run import RunFit
from tacstrip.reconstruction.posterior import assessment
from tacstrip.reconstruction.posterior.assessment import (
    ENOUGH_STRIPS,
    PROMISED_IOU,
    Doubts,
    Effort,
    doubts,
    doubts_of_regular,
    doubts_of_rounded,
)
from tacstrip.reconstruction.posterior.draws import Draws
from tacstrip.reconstruction.posterior.regular.draws import RegularDraws
from tacstrip.reconstruction.posterior.rounded import RoundedDraws

ONE = ("kh", "kl", "k")
# Of outlines, by how much a case of each counts: nobody knows how often people press what is not convex.
FAMILIES = {"convex": 1.0, "own": 1.0, "rounded": 0.5, "concave": 0.25, "own concave": 0.25}
_KINDS = {"convex": shapes.CONVEX, "rounded": shapes.ROUNDED, "concave": shapes.CONCAVE}
_NEWTON, _PULL = 30, 0.1
CLEARLY_RIGHT = 0.9  # IoU of an outline whose doubt is a false one


@dataclass(frozen=True)
class Judged:
    """One case: its kind, strips, status, confidence (NaN: none) and IoU with the truth."""

    kind: str
    strips: int
    status: str
    confidence: float
    iou: float
    # Of one signature where the confidence is what decides: doubts of the polygon or ellipse, and of its rounded
    # and regular rivals, each with the IoU of that outline.
    doubts: tuple[tuple[Doubts, float], ...] = ()

    @property
    def trusted(self) -> bool:
        """Whether the status says that it can be relied on."""
        return self.status in ("ok", "likely")


def cases(
    seed: int,
    count: int,
    signatures: str,
    strips: tuple[int, int] = (12, 1000),
    noises: tuple[float, ...] = (0.0005, 0.001, 0.002, 0.005, 0.01),
    kinds: Sequence[str] = CONVEX,
) -> list[Case]:
    """Draw contacts of all kinds in turn, on a log-uniform number of strips; of 60 % the noise is known."""
    random, found = np.random.default_rng(seed), []
    for i in range(count):
        n = round(float(np.exp(random.uniform(*np.log(strips)))))
        name = signatures if signatures != "one" else ONE[int(random.integers(len(ONE)))]
        noise, known = float(random.choice(noises)), bool(random.random() < 0.6)
        found.append(case(random, kinds[i % len(kinds)], n, noise, name, known))
    return found


def of_family(family: str, seed: int, count: int) -> list[Case]:
    """Draw contacts of a family on 12 strips or more, with one signature and noise of .05 to 1 %: own, or hold-out."""
    if family not in _KINDS:
        return cases(seed, count, "one", (12, 300), kinds=("concave",) if "concave" in family else CONVEX)
    found: list[Case] = []
    random = np.random.default_rng([list(FAMILIES).index(family), seed])
    while len(found) < count:
        strips = int(holdout.log_uniform(random, 12, 301 if family == "convex" else 101))
        kind, name = str(random.choice(_KINDS[family])), ONE[int(random.integers(len(ONE)))]
        drawn = holdout.single(random, kind, strips, (name,), holdout.log_uniform(random, 0.0005, 0.01))
        if drawn.strips >= strips - 1 >= ENOUGH_STRIPS:
            found.append(_case(drawn))
    return found


def scored(seed: int, count: int = 600) -> Iterator[Case]:
    """Draw the hold-out's convex contacts of one signature, of any strips and noise."""
    for number in range(count):
        drawn = holdout.convex(holdout.rng("convex", seed, number))
        if len(drawn.unit.names) == 1:
            yield _case(drawn)


def _case(drawn: holdout.Case) -> Case:
    unit, noise = drawn.unit, told_noise(replace(drawn, told=True))
    on = shapely.box(0.0, 0.0, unit.strips * unit.pitch, unit.length)
    truth, scan = shapely.Polygon(drawn.outlines[0]).intersection(on), unit.scan(drawn.read)
    assert noise is not None
    return Case(drawn.group, truth, unit.sensor, scan, noise, drawn.told, drawn.strips)


def judge(one: Case, effort: Effort, area: bool = False) -> Judged:
    """Fit a case and compare; `area`: knowing the object's area within 20 %."""
    told: list[tuple[Doubts, float]] = []

    def note(doubt: Doubts, chains: tuple[FloatArray, FloatArray]) -> Doubts:
        told.append((doubt, one.iou(Outline.held(*chains).vertices)))
        return doubt

    def noted(expected: float, run: RunFit, model: OutlineModel, *given: Any) -> Doubts:
        return note(doubts(expected, run, model, *given), model.chains_mm(run.problem))

    def noted_rounded(rounded: RoundedDraws, best: int, drawn: Draws, *given: Any) -> Doubts:
        outline = rounded.outline(best, drawn.problem.lam)
        return note(doubts_of_rounded(rounded, best, drawn, *given), outline.chains_mm(drawn.problem))

    def noted_regular(regular: RegularDraws, best: int, run: RunFit, *given: Any) -> Doubts:
        chains = regular.outline(best).chains_mm(run.problem)
        return note(doubts_of_regular(regular, best, run, *given), chains)

    with mock.patch.multiple(
        assessment, doubts=noted, doubts_of_rounded=noted_rounded, doubts_of_regular=noted_regular
    ):
        known = float(one.truth.area) if area else None
        found = ts.fit_polygon(one.scan, one.sensor, one.told, assessment=effort, area_mm2=known).objects
    largest = max(found, key=lambda o: o.strips.stop - o.strips.start)
    sure = np.nan if largest.confidence is None else largest.confidence
    return Judged(
        one.kind,
        one.touched,
        largest.status,
        sure,
        one.iou(largest.vertices),
        tuple(told) if len(found) == 1 and np.isfinite(sure) else (),
    )


def fitted_odds(of: FloatArray, right: npt.NDArray[np.bool_], weight: FloatArray | float = 1.0) -> FloatArray:
    """Return the log odds (T,) by doubts (N, T) under which what happened is likeliest, but for a slight pull to 0."""
    odds = np.zeros(of.shape[1])
    size = np.maximum(np.abs(of).max(axis=0), 1e-9)  # a pull on what is a share is one on what is a number
    of = of / size
    for _ in range(_NEWTON):
        share = 1.0 / (1.0 + np.exp(-of @ odds))
        curvature = (of * (weight * share * (1.0 - share))[:, None]).T @ of + _PULL * np.eye(len(odds))
        odds += np.linalg.solve(curvature, of.T @ (weight * (right - share)) - _PULL * odds)
    return np.asarray(odds / size)


def odds_report(found: list[Judged], weight: Sequence[float]) -> list[str]:
    """Return the log odds that fit, by kind of doubts, as text."""
    noted = [(d, iou >= PROMISED_IOU, w) for f, w in zip(found, weight, strict=True) for d, iou in f.doubts]
    lines = []
    for kind in dict.fromkeys(d.kind for d, *_ in noted):
        some = [(d.terms, right, w) for d, right, w in noted if d.kind == kind]
        of, right, weights = (np.array(v) for v in zip(*some, strict=True))
        odds = ", ".join(f"{o:.3f}" for o in fitted_odds(of, right, weights))
        lines += [f"  log odds, {kind} ({len(some)}): {odds}"]
    return lines


def report(found: list[Judged]) -> str:
    """Return the figures as text."""
    iou, sure = np.array([f.iou for f in found]), np.array([f.confidence for f in found])
    trusted, right = np.array([f.trusted for f in found]), iou >= PROMISED_IOU
    clear = iou >= CLEARLY_RIGHT
    lines = [
        f"{len(found)} cases: trusted {trusted.mean():.3f}, silently wrong of these {1 - right[trusted].mean():.4f}, "
        f"false doubt {(~trusted & clear).sum() / max(clear.sum(), 1):.3f}, mean IoU {iou.mean():.3f}"
    ]
    for level in (0.5, 0.6, 0.7, 0.8, 0.9):
        if (from_here := sure >= level).any():
            wrong, doubted = 1.0 - right[from_here].mean(), (clear & ~from_here).sum() / max(clear.sum(), 1)
            lines += [f"  trusted from {level:.2f}: wrong {wrong:.3f}, doubted {doubted:.3f}"]
    told = np.isfinite(sure)
    tenth = np.minimum((10 * sure[told]).astype(int), 9)
    lines += [
        f"  confidence {sure[told][here].mean():.2f}: right {right[told][here].mean():.2f} of {here.sum()}"
        for here in (tenth == t for t in range(10))
        if here.any()
    ]
    return "\n".join(lines)


def main() -> None:
    """Print the figures of the command line's cases."""
    parser = of_cases("studies.confidence", __doc__, 330)
    parser.add_argument("--signatures", default="one")
    parser.add_argument("--assessment", default="thorough", choices=("thorough", "fast"))
    parser.add_argument("--kinds", nargs="+", default=CONVEX, choices=KINDS)
    parser.add_argument("--strips", type=int, nargs=2, default=(12, 1000), help="touched, about: from, to")
    parser.add_argument("--area", action="store_true", help="tell it the area")
    parser.add_argument(
        "--families", action="store_true", help="each of FAMILIES by itself, and all together"
    )
    parser.add_argument("--scored", type=int, nargs="*", default=(), help="with it: seeds of the hold-out's")
    asked = parser.parse_args()
    if asked.families:
        every, weights = list[Judged](), list[float]()
        drawn_of = {family: of_family(family, asked.seed, asked.cases) for family in FAMILIES}
        drawn_of["scored"] = [one for seed in asked.scored for one in scored(seed)]
        for family, some in drawn_of.items():
            found = [judge(one, asked.assessment) for one in some]
            sys.stdout.write(f"{family}: {report(found)}\n" if found else "")
            every, weights = every + found, weights + [FAMILIES.get(family, 1.0)] * len(found)
        lines = odds_report(every, weights)
        sys.stdout.write("\n".join(lines) + "\n")
        return
    drawn = cases(asked.seed, asked.cases, asked.signatures, asked.strips, kinds=asked.kinds)
    found = [judge(one, asked.assessment, asked.area) for one in drawn]
    sys.stdout.write("\n".join([report(found), *odds_report(found, [1.0] * len(found))]) + "\n")


if __name__ == "__main__":
    main()
