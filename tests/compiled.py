"""Builds of the core for tests: tools/build_core.py, and the same sources by other compilers and options."""

from __future__ import annotations

import ctypes
import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from tacstrip.core.library import BASELINE

ROOT = Path(__file__).parents[1]


def _load() -> ModuleType:
    spec = importlib.util.spec_from_file_location("build_core", ROOT / "tools" / "build_core.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["build_core"] = module  # dataclasses look their module up here
    spec.loader.exec_module(module)
    return module


build_core = _load()
needs_compiler = pytest.mark.skipif(build_core.cc() is None, reason="no C compiler that works")


def compiler(name: str) -> Any:
    """Return the compiler of a name, or skip the test that asks for it."""
    path = shutil.which(name)
    if path is None:
        pytest.skip(f"{name} is not installed")
    return build_core.compiler_at(path)


def runs_v3() -> bool:
    """Whether this processor runs x86-64-v3, as the core that is installed says."""
    return BASELINE.exists() and bool(ctypes.CDLL(str(BASELINE)).tacstrip_core_v3_runs())


def python(code: str, core: str | Path | None) -> subprocess.CompletedProcess[str]:
    """Run Python code beside the tests with TACSTRIP_CORE set, or with whatever core is found."""
    env = {k: v for k, v in os.environ.items() if k != "TACSTRIP_CORE"}
    if core is not None:
        env["TACSTRIP_CORE"] = str(core)
    command = [sys.executable, "-c", code]
    return subprocess.run(command, env=env, cwd=ROOT / "tests", capture_output=True, text=True, check=False)
