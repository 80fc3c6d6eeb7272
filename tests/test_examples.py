"""Every example of a docstring runs, and every public name has one."""

import doctest
import importlib
import warnings
from pathlib import Path

import pytest

import tacstrip

ROOT = Path(tacstrip.__file__).parent
WITH_EXAMPLES = sorted(
    ".".join(file.relative_to(ROOT.parent).with_suffix("").parts)
    for file in ROOT.rglob("*.py")
    if ">>> " in file.read_text("utf-8")
)
ROOMS = ("tacstrip", "tacstrip.io", "tacstrip.plot", "tacstrip.stream", "tacstrip.tracking")


@pytest.mark.parametrize("module", WITH_EXAMPLES)
def test_examples_run(module: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        result = doctest.testmod(importlib.import_module(module), optionflags=doctest.ELLIPSIS)
    assert result.failed == 0


@pytest.mark.parametrize("room", ["network", "diagnose", "calibrate"])
def test_every_name_of_a_room_has_an_example(room: str) -> None:
    module = importlib.import_module(f"tacstrip.{room}")
    names = [n for n in module.__all__ if callable(getattr(module, n)) and n != "Wiring"]
    assert [n for n in names if ">>> " not in (getattr(module, n).__doc__ or "")] == []


@pytest.mark.parametrize("room", ROOMS)
def test_every_public_name_has_an_example(room: str) -> None:
    shown = importlib.import_module(room)
    names = [name for name in dir(shown) if not name.startswith("__")]
    assert [name for name in names if "Examples\n" not in (getattr(shown, name).__doc__ or "")] == []
