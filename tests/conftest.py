"""One thread a process, for on a busy machine the threads of linear algebra wait for each other; one reproduction."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """What `tacstrip reproduce --seeds 20` makes: its folder and its tables."""
    from tacstrip.studies.thesis.reproduce import reproduce

    out = tmp_path_factory.mktemp("reproduction")
    seen: list[tuple[int, int]] = []
    tables = reproduce(out, seeds=20, workers=2, progress=lambda done, total: seen.append((done, total)))
    assert seen[-1][0] == seen[-1][1]  # every task came back
    return out, tables
