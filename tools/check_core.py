"""Checks of the core in addition to the tests: no compiler warning, no finding of the sanitizers.

Those watch tests/core/, and tests/core/core_driver.c as a program of its own.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import build_core

ROOT = Path(__file__).resolve().parent.parent
WARNINGS = ("-Wall", "-Wextra", "-Wpedantic", "-Wvla", "-Werror", "-fsyntax-only")
SANITIZED = (
    "-O1",
    "-g",
    "-fno-omit-frame-pointer",
    "-fsanitize=address,undefined,float-cast-overflow",
    "-fno-sanitize-recover=all",
    "-DTACSTRIP_DEBUG",
)
# Python itself frees nothing at its end.
OPTIONS = {"ASAN_OPTIONS": "detect_leaks=0", "UBSAN_OPTIONS": "print_stacktrace=1"}


def warnings() -> None:
    """Refuse any warning of the compilers that are here."""
    for name in ("gcc", "clang"):
        if shutil.which(name):
            options = (*WARNINGS, *build_core.SAME_BITS, "-O2")
            command = [name, *options, *(str(f) for f in build_core.sources())]
            subprocess.run(command, cwd=build_core.CORE, check=True)


def sanitized(folder: Path) -> str:
    """Run the core's tests on a sanitized build; return why not, empty where they ran."""
    if sys.platform != "linux":
        return "sanitizers are tried on Linux only"
    if shutil.which("gcc") is None:
        return "there is no gcc"
    preload = subprocess.check_output(["gcc", "-print-file-name=libasan.so"], text=True).strip()
    if not Path(preload).is_absolute():
        return "gcc has no libasan.so"
    gcc = build_core.compiler_at("gcc")
    library, driver = folder / "core.so", folder / "driver"
    same = (*SANITIZED, *build_core.SAME_BITS)
    gcc.compile(library, build_core.sources(), (*same, *build_core.SHARED, *build_core.defined()))
    gcc.compile(
        driver,
        [ROOT / "tests" / "core" / "core_driver.c", *build_core.sources()],
        (*same, f"-I{build_core.CORE}"),
    )
    subprocess.run([driver], env=os.environ | OPTIONS, stdout=subprocess.DEVNULL, check=True)

    env = os.environ | OPTIONS | {"TACSTRIP_CORE": str(library), "LD_PRELOAD": preload}
    says = [sys.executable, "-c", "from tacstrip.core.library import description; print(description())"]
    used = subprocess.check_output(says, env=env, text=True).strip()
    print(f"The core's tests with {used}", flush=True)
    if "sanitized" not in used:
        raise SystemExit("these are not the sanitized build")
    tests = sorted(str(f) for f in (ROOT / "tests" / "core").glob("test_[cl]*.py"))
    pytest = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-m", "not slow"]
    subprocess.run([*pytest, *tests], env=env, cwd=ROOT, check=True)
    return ""


def main() -> int:
    """Run both; return the exit code."""
    try:
        warnings()
        with tempfile.TemporaryDirectory() as folder:
            if why := sanitized(Path(folder)):
                print(f"The core is not run under sanitizers: {why}.")
    except (subprocess.CalledProcessError, build_core.BuildError) as error:
        print(f"The core's checks: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
