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
CALLED = [n for n in dir(tacstrip) if not (n.startswith("__") or n.endswith("Error"))]


@pytest.mark.parametrize("module", WITH_EXAMPLES)
def test_examples_run(module: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        result = doctest.testmod(importlib.import_module(module), optionflags=doctest.ELLIPSIS)
    assert result.failed == 0


@pytest.mark.parametrize("name", CALLED)
def test_every_public_name_has_an_example(name: str) -> None:
    assert ">>> " in (getattr(tacstrip, name).__doc__ or ""), f"{name} has no example"
