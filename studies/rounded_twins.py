"""Rounded contacts of one signature: whether readings tell the wrong outlines that are `ok` from the true ones.

Run: python -m studies.rounded_twins [--cases 300] [--seed 1]

Contacts of the hold-out's `rounded` set with one signature on 12 strips or more, thorough. Of each outline that is
`ok`, how much more chi square it leaves of the readings than the true one does. Where a wrong one leaves no more than
that, or than noise does (chi square below its mean and 3.5 deviations), no test of the readings tells the two apart:
only knowing beforehand which shapes are met would. Of the others, those whose noise was told: the readings would tell.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from studies.holdout import cases
from studies.holdout.cases import Case
from studies.holdout.score import CLAIMS, RIGHT, best_object, fit, told_noise
from studies.holdout.shapes import Array
from studies.options import of_cases

_ENOUGH_STRIPS, _ALARM = 12, 3.5


@dataclass(frozen=True)
class Trusted:
    """An outline that is `ok`.

    Attributes
    ----------
    kind, iou
        Of the contact; overlap with it.
    surplus
        Chi square that it leaves, less the true outline's.
    explained, told
        Whether it leaves no more than noise does, and whether the estimator knew that noise.
    """

    kind: str
    iou: float
    surplus: float
    explained: bool
    told: bool


def trusted(case: Case) -> Trusted | None:
    """Return the outline of a case, if it is `ok`."""
    result = fit(case.unit, case.unit.scan(case.read), told_noise(case), assessment="thorough")
    iou, found = best_object(case.unit, result, case.outlines[0])
    if found is None or found.status not in CLAIMS:
        return None
    own, true = _chi_square(case, found.vertices), _chi_square(case, case.outlines[0])
    explained = own < case.strips + _ALARM * np.sqrt(2.0 * case.strips)
    return Trusted(case.group, iou, own - true, bool(explained), case.told)


def _chi_square(case: Case, outline: Array) -> float:
    """Return that of the strips that an outline touches; the outermost it may miss."""
    read = case.unit.read(*case.unit.touched([outline]))
    return float(np.nansum(((case.read - read) / case.unit.sigma(case.half_width)) ** 2))


def _told_apart(one: Trusted) -> bool:
    return one.told and one.surplus > 0.0 and not one.explained


def table(count: int, seed: int) -> list[str]:
    """Return how many `ok` are right and wrong, and how many of these the readings do not tell from the truth."""
    found = list[Trusted | None]()
    for number in range(count):
        case = cases.rounded(cases.rng("rounded", seed, number))
        if len(case.unit.names) == 1 and case.strips >= _ENOUGH_STRIPS:
            found.append(trusted(case))
    ok = [f for f in found if f is not None]
    heads = ("ok", "wrong", "as near as the truth", "explained by noise", "neither, noise told")
    lines = [f"{len(found)} contacts", f"{'':18}" + "".join(f"  {h}" for h in heads)]
    for kind in (*sorted({f.kind for f in ok}), "all"):
        some = [f for f in ok if kind in (f.kind, "all")]
        wrong = [f for f in some if f.iou < RIGHT]
        near, explained = sum(f.surplus <= 0.0 for f in wrong), sum(f.explained for f in wrong)
        numbers = len(some), len(wrong), near, explained, sum(_told_apart(f) for f in wrong)
        lines.append(f"{kind:18}" + "".join(f"  {n:{len(h)}}" for h, n in zip(heads, numbers, strict=True)))
    return lines


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table that the command line asks for."""
    asked = of_cases("studies.rounded_twins", __doc__, 300).parse_args(arguments)
    print("\n".join(table(asked.cases, asked.seed)))  # noqa: T201


if __name__ == "__main__":
    main()
