"""The house: names do not drift, and importing is quick. Layers of imports: `.importlinter`, by `make check`."""

from __future__ import annotations

import ast
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

import tacstrip
from tacstrip.cli import VERBS
from tacstrip.sensor.constructions import CONSTRUCTIONS

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "tacstrip"


def _modules() -> list[tuple[str, Path]]:
    found = []
    for file in sorted(SOURCE.rglob("*.py")):
        parts = file.relative_to(SOURCE).with_suffix("").parts
        name = ".".join(p for p in parts if p != "__init__")
        if name:
            found.append((name, file))
    return found


def test_nobody_else_compares_the_construction() -> None:
    """Only the table knows constructions by name; shipped data and command-line defaults name one."""
    for name, file in _modules():
        if name == "sensor.constructions":
            continue
        text = file.read_text(encoding="utf-8")
        if not any(construction in text for construction in CONSTRUCTIONS):
            continue
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Compare):
                texts = {n.value for n in ast.walk(node) if isinstance(n, ast.Constant)}
                assert not texts & set(CONSTRUCTIONS), f"{file.name}:{node.lineno} compares the construction"


def test_every_name_of_the_stub_is_there() -> None:
    names = dir(tacstrip)
    assert "vertex_reconstruction" in names
    for name in names:
        assert getattr(tacstrip, name) is not None
        assert getattr(tacstrip, name).__doc__


def test_verbs_are_the_modules_of_cli() -> None:
    assert sorted(VERBS) == sorted(
        f.stem for f in (SOURCE / "cli").glob("*.py") if f.stem not in ("__init__", "options", "progress")
    )


@pytest.mark.parametrize("code", ["import tacstrip", "import tacstrip.cli; tacstrip.cli.cli"])
def test_importing_loads_nothing_heavy(code: str) -> None:
    check = f"{code}; import sys; print([m for m in ('numpy', 'shapely', 'matplotlib', 'scipy') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", check], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_name_that_moved_says_where_to() -> None:
    for name, room in {"Short": "network", "Tracker": "tracking", "k_of_nobody": ""}.items():
        with pytest.raises(AttributeError) as error:
            getattr(tacstrip, name)
        assert not room or f"write `from tacstrip.{room} import {name}`" in str(error.value)
    for room, names in vars(tacstrip)["_MOVED"].items():
        for name in names.split():
            assert getattr(importlib.import_module(f"tacstrip.{room}"), name).__doc__
