"""Whether a confidence is what happens: statuses and confidences of drawn contacts against the truth.

Run: python -m studies.confidence [--signatures one|both] [--assessment thorough|fast] [--cases 330] [--seed 1]
    [--kinds concave] [--area]
Prints how many `ok` are wrong ("silent"), how many right ones are doubted, each tenth of confidence with the share that
was right, and the log odds by `assessment.doubts` that fit these cases best. Seed 11 is what the package's are from.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any
from unittest import mock

import numpy as np
import numpy.typing as npt

import tacstrip as ts
from studies.outlines import CONVEX, Case, case
from studies.outlines import ONE as KINDS
from tacstrip.arrays import FloatArray
from tacstrip.reconstruction.posterior import assessment
from tacstrip.reconstruction.posterior.assessment import PROMISED_IOU, Effort, doubts

ONE = ("kh", "kl", "k")
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
    doubts: FloatArray | None = None  # of one signature, where it was assessed

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


def judge(one: Case, effort: Effort, area: bool = False) -> Judged:
    """Fit a case and compare; `area`: knowing the object's area within 20 %."""
    told: list[FloatArray] = []

    def noted(*given: Any) -> FloatArray:
        told.append(doubts(*given))
        return told[-1]

    with mock.patch.object(assessment, "doubts", noted):
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
        told[0] if len(told) == 1 else None,
    )


def fitted_odds(of: FloatArray, right: npt.NDArray[np.bool_]) -> FloatArray:
    """Return the log odds (T,) by doubts (N, T) under which what happened is likeliest, but for a slight pull to 0."""
    odds = np.zeros(of.shape[1])
    for _ in range(_NEWTON):
        share = 1.0 / (1.0 + np.exp(-of @ odds))
        curvature = (of * (share * (1.0 - share))[:, None]).T @ of + _PULL * np.eye(len(odds))
        odds += np.linalg.solve(curvature, of.T @ (right - share) - _PULL * odds)
    return odds


def report(found: list[Judged]) -> str:
    """Return the figures as text."""
    iou, sure = np.array([f.iou for f in found]), np.array([f.confidence for f in found])
    trusted, right = np.array([f.trusted for f in found]), iou >= PROMISED_IOU
    clear = iou >= CLEARLY_RIGHT
    lines = [
        f"{len(found)} cases: trusted {trusted.mean():.3f}, silently wrong of these {1 - right[trusted].mean():.4f}, "
        f"false doubt {(~trusted & clear).sum() / max(clear.sum(), 1):.3f}, mean IoU {iou.mean():.3f}"
    ]
    for level in (0.7, 0.75, 0.8, 0.85, 0.9):
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
    noted = [i for i, f in enumerate(found) if f.doubts is not None]
    if noted:
        odds = fitted_odds(np.array([found[i].doubts for i in noted]), right[noted])
        lines += [f"  log odds: {', '.join(f'{o:.3f}' for o in odds)}"]
    return "\n".join(lines)


def main() -> None:
    """Print the figures of the command line's cases."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--signatures", default="one")
    parser.add_argument("--assessment", default="thorough", choices=("thorough", "fast"))
    parser.add_argument("--cases", type=int, default=330)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kinds", nargs="+", default=CONVEX, choices=KINDS)
    parser.add_argument("--area", action="store_true", help="tell it the area")
    asked = parser.parse_args()
    drawn = cases(asked.seed, asked.cases, asked.signatures, kinds=asked.kinds)
    sys.stdout.write(report([judge(one, asked.assessment, asked.area) for one in drawn]) + "\n")


if __name__ == "__main__":
    main()
