"""Sound units of other shapes and movements: the doctor names nothing on those on which it once did."""

from __future__ import annotations

import numpy as np
import pytest

from studies.sound_scenes import recording
from tacstrip.diagnose.doctor import diagnose

# What was named there: a dead strip in the gap of two objects; hum of a motion; strips exchanged at a gap that stays;
# noise of one strip, and of a sheet, by motion; shorts of contacts that roll, rock and go to and fro; ends exchanged by
# an angle in three presses; pressure by an angle's leg; noise of motion again, twice; a limit by a corner; noise of
# motion beside strips whose own is not known; an open end by a corner at one height; a limit of strips that are covered
# wholly; a short where no other pair bends; a Vref of its own by a ring that circles; joints by a
# cross's arm at the edges.
SEEDS = (2, 28, 69, 124, 188, 222, 254, 317, 324, 414, 457, 520, 644, 661, 920, 948, 1242, 2230, 2245)


@pytest.mark.parametrize("seed", SEEDS)
def test_no_fault_is_named(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tacstrip.network.crp.mesh._MOST", 100)  # rows of a sheet, in a fifth of the time
    log, about = recording(seed)
    assert [(f.fault, f.strips) for f in diagnose(log).findings] == [], about


def test_a_recording_is_drawn_alike_again() -> None:
    one, two = recording(5)[0], recording(5)[0]
    assert all(np.array_equal(one.raw[name], two.raw[name], equal_nan=True) for name in one.raw)
