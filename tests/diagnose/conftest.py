"""What several files of the doctor's tests share."""

from __future__ import annotations

import pytest


@pytest.fixture
def no_outline(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fit no outline: it takes most of the time, and knows of drift and wander alone."""
    monkeypatch.setattr("tacstrip.diagnose.rigid_contact._FEWEST_PLACES", 1_000)
