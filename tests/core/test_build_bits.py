"""Every build of the core computes the same bits: whatever compiler, options, processor and C library."""

from __future__ import annotations

import json
import platform
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from compiled import ROOT, build_core, compiler, needs_compiler, python, runs_v3

pytestmark = [needs_compiler, pytest.mark.builds]
DRIVER = ROOT / "tests" / "core" / "core_driver.c"
NATIVE = {
    "gcc -O0": ["-O0"],
    "gcc -O3": ["-O3"],
    "gcc -O2 v3": ["-O2", *build_core.V3],
    "gcc -O3 -march=native": ["-O3", "-march=native"],
    "clang -O2": ["-O2"],
    "clang -O3 -march=native": ["-O3", "-march=native"],
    "tcc": [],
}
FOREIGN = {"aarch64-linux-gnu-gcc": "qemu-aarch64", "musl-gcc": ""}


def _checksums(folder: Path, by: Any, *options: str) -> dict[str, str]:
    """Compile the core and return the checksums of tests/core/core_cases.py."""
    library = folder / f"core{build_core.SUFFIX}"
    options = (*options, *build_core.SAME_BITS, *build_core.SHARED, *build_core.defined())
    by.compile(library, build_core.sources(), options)
    ran = python(
        "import json; from core import core_cases; print(json.dumps(core_cases.checksums()))", library
    )
    assert ran.returncode == 0, ran.stderr
    sums: dict[str, str] = json.loads(ran.stdout)
    return sums


def _driven(folder: Path, by: Any, *options: str, under: str = "") -> list[str]:
    """Compile the core and core_driver.c to a program; return what that prints, maybe under an emulator."""
    program = folder / "driver"
    options = ("-O2", *build_core.SAME_BITS, *options, f"-I{build_core.CORE}")
    by.compile(program, [DRIVER, *build_core.sources()], options)
    return subprocess.check_output([*([under] if under else []), program], text=True).splitlines()


@pytest.fixture(scope="module")
def usual(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Return the checksums of the build that users get."""
    return _checksums(tmp_path_factory.mktemp("usual"), build_core.cc(), *build_core.FAST)


@pytest.fixture(scope="module")
def usual_driven(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Return the driver's output of the build that users get."""
    return _driven(tmp_path_factory.mktemp("driven"), build_core.cc())


@pytest.mark.parametrize("build", NATIVE)
def test_every_build_computes_the_same_bits(build: str, usual: dict[str, str], tmp_path: Path) -> None:
    if build.endswith("v3") and not runs_v3():
        pytest.skip("this processor has no x86-64-v3")
    assert _checksums(tmp_path, compiler(build.split()[0]), *NATIVE[build]) == usual


@pytest.mark.parametrize("name", FOREIGN)
def test_another_processor_and_another_c_library_compute_the_same_bits(
    name: str, usual_driven: list[str], tmp_path: Path
) -> None:
    by, under = compiler(name), FOREIGN[name]
    if under and shutil.which(under) is None:
        pytest.skip(f"{under} is not installed")
    assert _driven(tmp_path, by, "-static", under=under) == usual_driven


@pytest.mark.skipif(platform.machine() != "x86_64", reason="the option for fused multiply-add is of x86-64")
def test_a_contracted_sum_would_be_seen(usual_driven: list[str], tmp_path: Path) -> None:
    if not runs_v3():
        pytest.skip("this processor has no x86-64-v3")
    other = _driven(tmp_path, compiler("gcc"), "-std=gnu99", "-ffp-contract=fast", "-mfma")
    assert other[0] == usual_driven[0]
    assert other != usual_driven
