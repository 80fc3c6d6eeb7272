"""How far one signature can be trusted by somebody who knows of a contact that it is a convex polygon, and no more.

Run: python -m studies.polygon_limit [--cases 150] [--seed 1]

Contacts are the hold-out's polygons that have no regular proportions, inside the sensor, their noise known. The
package's chains draw polygons as often as the readings make them likely; the one that most others overlap by .8 is the
estimate, and that share its probability of being right. Printed: whether what was said is what was; whether chains
begun at the true outline, four times as long, say the same; how well the true outline and those drawn explain the
readings where the estimate is wrong; and which share of `ok` is wrong at each share of doubted good ones, by that
probability.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from itertools import pairwise
from typing import Any
from unittest import mock

import numpy as np

import tacstrip as ts
from studies.holdout import cases
from studies.holdout.cases import Case
from studies.one_signature_limit import silent
from studies.options import of_cases
from tacstrip.arrays import FloatArray
from tacstrip.core.polygon_fit import PolygonFit
from tacstrip.core.posterior import outline_record
from tacstrip.geometry.metrics import column_iou, pairwise_column_iou
from tacstrip.geometry.outline import Outline
from tacstrip.reconstruction.posterior import assessment, draws

KINDS = ("hull", "triangle", "weak corner", "one upright side")
RIGHT, GOOD = 0.8, 0.9  # IoU that `ok` promises; whose doubt is a false one
_STRIPS, _NOISE = (12, 101), (0.0005, 0.01)
_LONGER = 4
_SAID = (0.0, 0.6, 0.8, 0.9, 0.97, 1.01)
_DOUBTS = (0.05, 0.10, 0.17, 0.25)


@dataclass(frozen=True)
class Judged:
    """One contact.

    Attributes
    ----------
    kind, iou
        Of the contact; of the estimate with it.
    said, near
        Share of the outlines drawn that overlap the estimate by .8, and that overlap the true outline so.
    said_from_truth, near_from_truth
        Likewise of longer chains begun at the true outline; NaN where the prior allows no such outline.
    chi_square
        A reading: that the true outline leaves, and the outlines drawn in the median (2,).
    """

    kind: str
    iou: float
    said: float
    near: float
    said_from_truth: float
    near_from_truth: float
    chi_square: tuple[float, float]


def drawn(random: np.random.Generator, kind: str) -> Case:
    """Return a polygon inside the sensor, read by one signature."""
    while True:
        strips, half_width = int(cases.log_uniform(random, *_STRIPS)), cases.log_uniform(random, *_NOISE)
        name = str(random.choice(["kh", "kl", "k"]))
        case = cases.single(random, kind, strips, (name,), half_width)
        if case.strips >= _STRIPS[0]:
            return case


def judge(case: Case) -> Judged | None:
    """Draw polygons that explain a contact's readings; None where none are drawn of one whole contact."""
    noted: list[tuple[Any, draws.Draws]] = []

    def note(*given: Any) -> draws.Draws | None:
        if (some := draws.draw(*given)) is not None:
            noted.append((given, some))
        return some

    scan, noise = case.unit.scan(case.read), ts.Noise(positional=case.half_width, distribution="normal")
    with mock.patch.object(assessment, "draw", note):
        ts.fit_polygon(scan, case.unit.sensor, noise)
    if len(noted) != 1:
        return None
    (run, sensor, known, evaluations, *rest), some = noted[0]
    truth = Outline.of(case.outlines[0])
    true_ends, problem = some.ends_of(truth.lower, truth.upper), some.problem
    polygons = _polygons(some)
    share = (pairwise_column_iou(polygons) >= RIGHT).mean(axis=1)
    estimate = polygons[int(np.argmax(share))]
    scale, origin = (problem.width_mm, problem.length_mm), (problem.origin_mm, 0.0)
    start = outline_record(*((chain - origin) / scale for chain in (truth.lower, truth.upper)))
    with mock.patch.object(draws, "_starts", return_value=[start]):
        again = draws.draw(run, sensor, known, _LONGER * evaluations, *rest)
    nothing = np.full((1, *estimate.shape), np.nan)
    longer = nothing if again is None else _polygons(again)
    left = PolygonFit.of(truth, problem).residuals(problem)
    return Judged(
        case.group,
        float(column_iou(estimate, true_ends)),
        float(share.max()),
        _near(polygons, true_ends),
        _near(longer, estimate),
        _near(longer, true_ends),
        (
            float((left**2).sum()) / problem.readings,
            float(np.median(some.samples.squares)) / problem.readings,
        ),
    )


def _polygons(some: draws.Draws) -> FloatArray:
    return some.ends[: len(some.samples.outlines)]


def _near(ends: FloatArray, one: FloatArray) -> float:
    return float((column_iou(ends, one) >= RIGHT).mean()) if np.isfinite(ends).all() else np.nan


def report(found: list[Judged]) -> str:
    """Return the figures as text."""
    iou, said = np.array([(f.iou, f.said) for f in found]).T
    right, good = iou >= RIGHT, iou >= GOOD
    lines = [f"{len(found)} contacts, mean IoU {iou.mean():.3f}"]
    for low, high in pairwise(_SAID):
        if (here := (said >= low) & (said < high)).any():
            lines += [f"  said {said[here].mean():.2f}, was {right[here].mean():.2f} of {here.sum()}"]
    again = np.array([(f.said_from_truth, f.near, f.near_from_truth) for f in found])
    told = np.isfinite(again[:, 0])
    off, near = again[told, 0] - said[told], again[told, 2] - again[told, 1]
    lines += [
        f"begun at the true outline ({told.sum()}): estimate's share {off.mean():+.3f} +- {off.std():.3f}, the true "
        f"outline's {near.mean():+.3f} +- {near.std():.3f}"
    ]
    wrong = (said >= RIGHT) & ~right
    chi = np.array([f.chi_square for f in found])[wrong]
    if wrong.any():
        lines += [
            f"said .8 or more and wrong ({wrong.sum()}): the true outline leaves {chi[:, 0].mean():.2f} a reading, "
            f"those drawn {chi[:, 1].mean():.2f}; {np.sum(chi[:, 0] >= chi[:, 1])} true ones leave no less"
        ]
    kinds = np.array([f.kind for f in found])
    for title, some in (("all", kinds != ""), *((kind, kinds == kind) for kind in KINDS)):
        at = "".join(
            f"{100.0 * silent(said[some], right[some], good[some], d):7.1f} ({d:.0%})" for d in _DOUBTS
        )
        lines += [f"{title:18}{some.sum():5}, good {(some & good).sum():4}: wrong of `ok`, %, (doubts):{at}"]
    return "\n".join(lines)


def main() -> None:
    """Print the figures of the command line's contacts."""
    asked = of_cases("studies.polygon_limit", __doc__, 150).parse_args()
    random = np.random.default_rng(asked.seed)
    found = [judge(drawn(random, KINDS[i % len(KINDS)])) for i in range(asked.cases)]
    sys.stdout.write(report([f for f in found if f is not None]) + "\n")


if __name__ == "__main__":
    main()
