"""A number that the C and the Python of the core both have has one name and one value."""

from __future__ import annotations

import importlib
import re
from pathlib import Path

import pytest

from compiled import build_core

TWINS = {
    "bounded.c": (
        "reconstruction.set_membership.estimate",
        "reconstruction.set_membership.feasible_set",
        "core.polytope",
    ),
    "closed_form.h": ("core.problem", "core.cost"),
    "core.h": ("core.binding", "core.score_test", "core.swept_area"),
    "descent.c": ("core.descent", "core.polygon_fit"),
    "feasible_set.c": ("reconstruction.set_membership.feasible_set",),
    "internal.h": ("core.problem",),
    "rigid.h": ("core.rigid",),
    "philox.h": ("core.batch",),
    "outlines.c": ("reconstruction.set_membership.outlines", "geometry.moments"),
    "search.c": ("core.search", "core.problem"),
    "run.c": ("reconstruction.polygon.run", "robust"),
}
# How C works, not what it computes.
OWN = {
    "BLOCK",
    "COARSEST",
    "LOW_HALF",
    "ROUNDING",
    "LANES",
    "TINY",
    "WIDTH",
    "TACSTRIP_FINGERPRINT",
    "TACSTRIP_VERSION",  # tests/core/test_library.py
    "polygon_fit.c FIRM",  # where NumPy decomposes instead
    "outlines.c FLAT",  # np.linalg.pinv's own
    "rigid.h AT_A_TIME",
    "rigid.h LARGE",
}
# Without a NumPy version: test_posterior.py holds one to importance sampling, test_hull.py another to simulate, and
# reconstruction/test_regular.py the third to readings and a grid.
COMPILED_ONLY = ("hull.c", "posterior.c", "regular.c")
FILES = sorted(
    p for p in build_core.CORE.iterdir() if p.suffix in (".c", ".h") and p.name not in COMPILED_ONLY
)


@pytest.mark.parametrize("file", FILES, ids=lambda p: p.name)
def test_numbers_of_c_are_those_of_python(file: Path) -> None:
    modules = TWINS.get(file.name, (f"core.{file.stem}",))
    defined = re.findall(
        r"^#define ([A-Z_0-9]+) +([0-9][^\s)]*)", file.read_text(encoding="utf-8"), re.MULTILINE
    )
    for name, value in defined:
        if name in OWN or f"{file.name} {name}" in OWN:
            continue
        named = (
            getattr(importlib.import_module(f"tacstrip.{module}"), prefix + name, None)
            for module in modules
            for prefix in ("", "_")
        )
        found = [number for number in named if number is not None]
        assert found, f"{file.name}: {name} has no twin in {modules}"
        assert all(number == float(value) for number in found), f"{file.name}: {name} is {value}, not {found}"
