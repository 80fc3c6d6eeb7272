"""Whether a confidence is what happens: statuses and confidences of drawn contacts against the truth.

Run: python -m studies.confidence [--signatures one|both] [--assessment thorough|fast] [--cases 330] [--seed 1]
Prints how many `ok` are wrong ("silent"), how many right ones are doubted, each tenth of confidence with the share that
was right, and the monotone table (pooled neighbours) that would turn confidences into shares.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

import tacstrip as ts
from studies.outlines import CONVEX, Case, case
from tacstrip.arrays import FloatArray
from tacstrip.reconstruction.posterior.assessment import PROMISED_IOU, Effort

ONE = ("kh", "kl", "k")
CLEARLY_RIGHT = 0.9  # IoU of an outline whose doubt is a false one


@dataclass(frozen=True)
class Judged:
    """One case: its kind, strips, status, confidence (NaN: none) and IoU with the truth."""

    kind: str
    strips: int
    status: str
    confidence: float
    iou: float

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
) -> list[Case]:
    """Draw convex contacts of all kinds in turn, on a log-uniform number of strips; of 60 % the noise is known."""
    random, found = np.random.default_rng(seed), []
    for i in range(count):
        n = round(float(np.exp(random.uniform(*np.log(strips)))))
        name = signatures if signatures != "one" else ONE[int(random.integers(len(ONE)))]
        noise, known = float(random.choice(noises)), bool(random.random() < 0.6)
        found.append(case(random, CONVEX[i % len(CONVEX)], n, noise, name, known))
    return found


def judge(one: Case, assessment: Effort) -> Judged:
    """Fit a case and compare."""
    objects = ts.fit_polygon(one.scan, one.sensor, one.told, assessment=assessment).objects
    found = max(objects, key=lambda o: o.strips.stop - o.strips.start)
    sure = np.nan if found.confidence is None else found.confidence
    return Judged(one.kind, one.touched, found.status, sure, one.iou(found.vertices))


def monotone(
    confidence: FloatArray, right: npt.NDArray[np.bool_], groups: int = 12
) -> list[tuple[float, float]]:
    """Return mean confidence and share right of groups of cases, neighbours pooled until shares ascend."""
    pools: list[list[float]] = []
    for part in np.array_split(np.argsort(confidence), groups):
        pools.append([float(len(part)), float(confidence[part].sum()), float(right[part].sum())])
        while len(pools) > 1 and pools[-2][2] * pools[-1][0] >= pools[-1][2] * pools[-2][0]:
            last = pools.pop()
            pools[-1] = [a + b for a, b in zip(pools[-1], last, strict=True)]
    return [(c / n, r / n) for n, c, r in pools]


def report(found: list[Judged]) -> str:
    """Return the figures as text."""
    iou, sure = np.array([f.iou for f in found]), np.array([f.confidence for f in found])
    trusted, right = np.array([f.trusted for f in found]), iou >= PROMISED_IOU
    clear = iou >= CLEARLY_RIGHT
    lines = [
        f"{len(found)} cases: trusted {trusted.mean():.3f}, silently wrong of these {1 - right[trusted].mean():.4f}, "
        f"false doubt {(~trusted & clear).sum() / max(clear.sum(), 1):.3f}, mean IoU {iou.mean():.3f}"
    ]
    told = np.isfinite(sure)
    tenth = np.minimum((10 * sure[told]).astype(int), 9)
    lines += [
        f"  confidence {sure[told][here].mean():.2f}: right {right[told][here].mean():.2f} of {here.sum()}"
        for here in (tenth == t for t in range(10))
        if here.any()
    ]
    table = ", ".join(f"({a:.3f}, {b:.3f})" for a, b in monotone(sure[told], right[told]))
    return "\n".join([*lines, f"  monotone: {table}"])


def main() -> None:
    """Print the figures of the command line's cases."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--signatures", default="one")
    parser.add_argument("--assessment", default="thorough", choices=("thorough", "fast"))
    parser.add_argument("--cases", type=int, default=330)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    drawn = cases(asked.seed, asked.cases, asked.signatures)
    sys.stdout.write(report([judge(one, asked.assessment) for one in drawn]) + "\n")


if __name__ == "__main__":
    main()
