"""What every build of the core must compute to the same bits. Add a case: a function without arguments, under `@case`,
that calls the core as the package does and returns arrays or numbers, always of the same input.

As a program it prints a checksum of each, of the core that TACSTRIP_CORE names.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from hashlib import sha256

import numpy as np
from numpy.typing import ArrayLike

from tacstrip.core.library import library

Case = Callable[[], Iterable[ArrayLike]]
CASES: dict[str, Case] = {}


def case(function: Case) -> Case:
    """Add a case."""
    CASES[function.__name__] = function
    return function


@case
def version() -> Iterable[ArrayLike]:
    core = library()
    assert core is not None
    return [core.tacstrip_core_version()]


def checksums() -> dict[str, str]:
    """Return a checksum of the bytes of each case's results."""
    return {
        name: sha256(b"".join(np.ascontiguousarray(part).tobytes() for part in function())).hexdigest()
        for name, function in CASES.items()
    }


if __name__ == "__main__":
    print(json.dumps(checksums()))  # noqa: T201
