"""When constants must not be used: what they leave against the noise."""

from __future__ import annotations

import numpy as np
import pytest

from tacstrip.calibrate.goodness import Goodness


@pytest.mark.parametrize(
    ("noise", "repeated", "residual", "doubted"),
    [
        (0.0008, True, 0.0094, True),  # strips shifted by one: eleven times the repeats' noise
        (0.0008, True, 0.0045, False),  # uneven rubber
        (0.002, True, 0.015, False),  # eight times
        (0.003, False, 0.0094, False),  # nothing was repeated: the noise is a guess
        (0.003, False, 0.025, True),
        (0.01, True, 0.03, False),
    ],
)
def test_what_is_left_is_held_against_the_noise(
    noise: float, repeated: bool, residual: float, doubted: bool
) -> None:
    assert bool(Goodness(noise, repeated, residual, np.full(8, residual)).doubt) == doubted
