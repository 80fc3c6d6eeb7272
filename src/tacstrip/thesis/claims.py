"""A conclusion of the thesis with the verdict of our tables."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_CLEARLY = 0.9  # share of the cases that makes a claim hold


@dataclass(frozen=True)
class Claim:
    """A conclusion of the thesis, and whether our tables support it.

    Attributes
    ----------
    verdict
        "holds" (in at least 90 % of the cases it is about), "holds in part" (in more than half), "fails".
    evidence
        The count behind the verdict, in words.
    section
        Where the thesis states it.
    """

    claim: str
    verdict: str
    evidence: str
    section: str = "5.6"


def counted(claim: str, good: float, total: float, evidence: str, section: str = "5.6") -> Claim:
    """Return a claim with the verdict for `good` supporting cases out of `total`."""
    share = good / total
    verdict = "holds" if share >= _CLEARLY else "holds in part" if share > 0.5 else "fails"
    return Claim(claim, verdict, evidence, section)


def checked(claim: str, true: bool | np.bool_, evidence: str, section: str = "5.6") -> Claim:
    """Return a claim that holds or fails as a whole."""
    return Claim(claim, "holds" if true else "fails", evidence, section)
