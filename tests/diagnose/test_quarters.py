"""A finding stands without any quarter of the recording, or of its own strips' contacts."""

import numpy as np
import pytest
from test_workshop import METAL, dragged_off_both_ends

from tacstrip.diagnose import Log, diagnose

_OPEN = 3


@pytest.mark.usefixtures("no_outline")
@pytest.mark.parametrize(("scans", "finding"), [(140, True), (12, False)])
def test_an_open_strip_that_is_touched_in_one_quarter_of_the_recording(scans: int, finding: bool) -> None:
    """Its contacts show it without any quarter of them if they are many, and not if they are few."""
    log = dragged_off_both_ends()
    k = log.raw["k"].copy()
    k[:, _OPEN] = np.where(log.touched[:, _OPEN], 0.0, np.nan)
    over = np.flatnonzero(log.touched[:, _OPEN])
    kept = over[np.linspace(0, len(over) - 1, scans).astype(int)]
    rows = np.concatenate([np.flatnonzero(~log.touched[:, _OPEN]), kept])
    report = diagnose(Log.of(METAL, log.time_s[: len(rows)], {"k": k[rows]}))
    found = [(f.fault, f.strips) for f in report.findings]
    asked = [(q.causes, q.strips) for q in report.questions]
    assert found == [("open-strip", (_OPEN,))] * finding
    assert asked == [(("open-strip",), (_OPEN,))] * (not finding)
