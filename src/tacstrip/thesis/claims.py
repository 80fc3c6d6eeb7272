"""A conclusion of the thesis with the verdict of our tables."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TypeAlias

import numpy as np

# "claim"; "verdict": "holds" (in at least 90 % of the cases it is about), "holds in part" (in more than half) or
# "fails"; "evidence", the count behind the verdict in words; "section", where the thesis states it.
Claim: TypeAlias = dict[str, str]

_CLEARLY = 0.9  # share of the cases that makes a claim hold


def counted(claim: str, good: float, total: float, evidence: str, section: str = "5.6") -> Claim:
    """Return a claim with the verdict for `good` supporting cases out of `total`."""
    share = good / total
    verdict = "holds" if share >= _CLEARLY else "holds in part" if share > 0.5 else "fails"
    return {"claim": claim, "verdict": verdict, "evidence": evidence, "section": section}


def checked(claim: str, true: bool | np.bool_, evidence: str, section: str = "5.6") -> Claim:
    """Return a claim that holds or fails as a whole."""
    return counted(claim, bool(true), 1, evidence, section)


def passing(
    pairs: Iterable[tuple[float | None, float | None]], test: Callable[[float, float], bool]
) -> tuple[int, int]:
    """Count the pairs of medians that pass a test, and those that are there."""
    passed = [test(one, other) for one, other in pairs if one is not None and other is not None]
    return sum(passed), len(passed)
