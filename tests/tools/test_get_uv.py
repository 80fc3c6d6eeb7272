"""The bootstrap of uv: the right wheel of the lock, its hash, and what it says when it cannot."""

import hashlib
import importlib.util
import io
import os
import platform
import struct
import sys
import zipfile
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parent.parent.parent
SAYS_ITS_VERSION = "#!/bin/sh\necho uv 9.9.9\n"
posix = pytest.mark.skipif(os.name == "nt", reason="the stand-in programs are shell scripts")


def _load() -> ModuleType:
    spec = importlib.util.spec_from_file_location("get_uv", ROOT / "tools" / "get_uv.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["get_uv"] = module
    spec.loader.exec_module(module)
    return module


get_uv = _load()


@cache
def _locked() -> Any:
    """Return the wheels that uv.lock pins; it is long, so it is not read where these tests are only collected."""
    return get_uv.pinned_wheels((ROOT / "uv.lock").read_text(encoding="utf-8"))


def _wheel(*members: str, text: str = SAYS_ITS_VERSION) -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        for member in members:
            archive.writestr(member, text)
    return content.getvalue()


UV_WHEEL = _wheel("uv/__init__.py", "uv-9.9.9.data/scripts/uvx", "uv-9.9.9.data/scripts/uv")


def _checkout(root: Path, wheel: bytes | None, sha256: str | None = None) -> Path:
    """Return a checkout whose lock pins one wheel, a file that is there unless `wheel` is None."""
    here = get_uv.this_platform()
    tag = f"linux_{here.machine}"
    if here.family == "macosx":
        tag = f"macosx_11_0_{here.machine}"
    file = root / f"uv-9.9.9-py3-none-{tag}.whl"
    if wheel is not None:
        file.write_bytes(wheel)
    sha256 = sha256 or hashlib.sha256(wheel or b"").hexdigest()
    (root / "uv.lock").write_text(
        f'[[package]]\nname = "uv"\nwheels = [{{ url = "{file.as_uri()}", hash = "sha256:{sha256}" }}]\n',
        encoding="utf-8",
    )
    return root


def _python_stand_in(folder: Path, script: str) -> str:
    program = folder / "python"
    program.write_text(f"#!/bin/sh\n{script}\n", encoding="utf-8")
    program.chmod(0o755)
    return str(program)


def test_no_address_is_written_into_the_script() -> None:
    assert "://" not in (ROOT / "tools" / "get_uv.py").read_text(encoding="utf-8")


def test_the_lock_names_one_version_with_full_hashes() -> None:
    assert len({wheel.version for wheel in _locked()}) == 1
    assert all(len(wheel.sha256) == 64 for wheel in _locked())
    assert all(wheel.name.endswith(".whl") for wheel in _locked())


@pytest.mark.parametrize(
    ("family", "machine", "version", "ending"),
    [
        ("manylinux", "x86_64", (2, 36), "manylinux2014_x86_64"),
        ("manylinux", "x86_64", (2, 17), "manylinux2014_x86_64"),
        ("manylinux", "aarch64", (2, 36), "manylinux_2_28_aarch64"),
        ("manylinux", "aarch64", (2, 26), "manylinux2014_aarch64.musllinux_1_1_aarch64"),
        ("manylinux", "armv6l", (2, 36), "linux_armv6l"),
        ("manylinux", "i686", (2, 36), "manylinux2014_i686"),
        ("manylinux", "riscv64", (2, 36), "riscv64"),
        ("musllinux", "x86_64", (1, 2), "musllinux_1_1_x86_64"),
        ("musllinux", "aarch64", (1, 2), "musllinux_1_1_aarch64"),
        ("musllinux", "armv7l", (1, 2), "musllinux_1_1_armv7l"),
        ("macosx", "arm64", (15, 1), "macosx_11_0_arm64"),
        ("macosx", "x86_64", (12, 6), "macosx_10_12_x86_64"),
        ("win", "amd64", (0, 0), "win_amd64"),
        ("win", "arm64", (0, 0), "win_arm64"),
        ("win", "x86", (0, 0), "win32"),
    ],
)
def test_every_platform_gets_its_wheel(
    family: str, machine: str, version: tuple[int, int], ending: str
) -> None:
    wheel = get_uv.pick_wheel(_locked(), get_uv.Platform(family, machine, version))
    assert wheel.name.removesuffix(".whl").endswith(ending)


def test_a_32_bit_raspberry_gets_an_armv7_wheel() -> None:
    wheel = get_uv.pick_wheel(_locked(), get_uv.Platform("manylinux", "armv7l", (2, 36)))
    assert "manylinux2014_armv7l" in wheel.tags


@pytest.mark.parametrize(
    ("family", "machine", "version"),
    [
        ("freebsd", "amd64", (0, 0)),
        ("manylinux", "sparc64", (2, 36)),
        ("manylinux", "x86_64", (2, 12)),
        ("musllinux", "s390x", (1, 2)),
        ("macosx", "x86_64", (10, 9)),
    ],
)
def test_a_platform_without_a_wheel_is_named(family: str, machine: str, version: tuple[int, int]) -> None:
    with pytest.raises(get_uv.FetchError, match=rf"^uv\.lock has no wheel of uv for {family} {machine}$"):
        get_uv.pick_wheel(_locked(), get_uv.Platform(family, machine, version))


@pytest.mark.parametrize(
    ("system", "machine", "pointer_bytes", "glibc", "expected"),
    [
        ("Linux", "x86_64", 8, "glibc 2.36", ("manylinux", "x86_64", (2, 36))),
        ("Linux", "x86_64", 4, "glibc 2.36", ("manylinux", "i686", (2, 36))),
        ("Linux", "aarch64", 4, "glibc 2.36", ("manylinux", "armv7l", (2, 36))),
        ("Linux", "aarch64", 8, None, ("musllinux", "aarch64", (1, 2))),
        ("Darwin", "arm64", 8, None, ("macosx", "arm64", (15, 1))),
        ("Windows", "AMD64", 8, None, ("win", "amd64", (0, 0))),
        ("FreeBSD", "amd64", 8, None, ("freebsd", "amd64", (0, 0))),
    ],
)
def test_the_platform_is_recognised(
    monkeypatch: pytest.MonkeyPatch,
    system: str,
    machine: str,
    pointer_bytes: int,
    glibc: str | None,
    expected: tuple[str, str, tuple[int, int]],
) -> None:
    def confstr(_name: str) -> str:
        if glibc is None:
            raise ValueError("unrecognized configuration name")
        return glibc

    monkeypatch.setattr(platform, "system", lambda: system)
    monkeypatch.setattr(platform, "machine", lambda: machine)
    monkeypatch.setattr(platform, "mac_ver", lambda: ("15.1", ("", "", ""), machine))
    monkeypatch.setattr(struct, "calcsize", lambda _format: pointer_bytes)
    monkeypatch.setattr(os, "confstr", confstr, raising=False)
    assert get_uv.this_platform() == expected


def test_a_lock_without_uv_is_said_to_have_none() -> None:
    with pytest.raises(get_uv.FetchError, match=r"^uv\.lock names no wheel of uv$"):
        get_uv.pinned_wheels('[[package]]\nname = "numpy"\n')


def test_a_wrong_hash_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "uv-9.9.9-py3-none-any.whl"
    file.write_bytes(UV_WHEEL)
    good = hashlib.sha256(UV_WHEEL).hexdigest()
    assert get_uv.download(get_uv.Wheel(file.as_uri(), good)) == UV_WHEEL
    with pytest.raises(get_uv.FetchError, match=r"does not have the sha256 that uv\.lock gives$"):
        get_uv.download(get_uv.Wheel(file.as_uri(), "0" * 64))


def test_only_the_program_is_extracted(tmp_path: Path) -> None:
    target = tmp_path / "uv"
    get_uv.extract(UV_WHEEL, target)
    assert target.read_text(encoding="utf-8") == SAYS_ITS_VERSION
    assert os.access(target, os.X_OK)
    assert list(tmp_path.iterdir()) == [target]


def test_a_wheel_without_the_program_leaves_the_old_one(tmp_path: Path) -> None:
    target = tmp_path / "uv"
    target.write_text("old", encoding="utf-8")
    with pytest.raises(get_uv.FetchError, match=r"holds no program uv$"):
        get_uv.extract(_wheel("uv-9.9.9.data/scripts/uvx"), target)
    assert target.read_text(encoding="utf-8") == "old"
    assert list(tmp_path.iterdir()) == [target]


@posix
def test_main_fetches_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root = _checkout(tmp_path, UV_WHEEL)
    target = root / ".tools" / "uv"
    assert get_uv.main(root) == 0
    assert get_uv.version_of(target) == "9.9.9"
    assert capsys.readouterr().out == "Fetching uv 9.9.9 into .tools/\n"
    os.utime(target, (0, 0))
    assert get_uv.main(root) == 0
    assert capsys.readouterr().out == ""
    assert target.stat().st_mtime > 0  # make now sees it newer than the lock


@posix
def test_main_replaces_another_version(tmp_path: Path) -> None:
    root = _checkout(tmp_path, UV_WHEEL)
    target = root / ".tools" / "uv"
    target.parent.mkdir()
    target.write_text(SAYS_ITS_VERSION.replace("9.9.9", "0.0.1"), encoding="utf-8")
    target.chmod(0o755)
    assert get_uv.main(root) == 0
    assert get_uv.version_of(target) == "9.9.9"


@posix
def test_main_says_that_a_program_does_not_run_here(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root = _checkout(tmp_path, _wheel("uv-9.9.9.data/scripts/uv", text="#!/no/such/loader\n"))
    assert get_uv.main(root) == 1
    assert "uv 9.9.9 was fetched but does not run on this machine" in capsys.readouterr().err
    assert not (root / ".tools" / "uv").exists()


@posix
def test_pip_takes_over_with_the_pinned_version_and_hash(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = _checkout(tmp_path, None, sha256="5" * 64)
    (tmp_path / "mirrored").write_bytes(UV_WHEEL)
    script = f"""
while [ "$1" != "-d" ]; do shift; done
cp "$4" '{tmp_path}/asked'
cp '{tmp_path}/mirrored' "$2/uv-9.9.9-py3-none-any.whl"
"""
    monkeypatch.setattr(sys, "executable", _python_stand_in(tmp_path, script))
    assert get_uv.main(root) == 0
    assert (tmp_path / "asked").read_text(encoding="utf-8") == f"uv==9.9.9 --hash=sha256:{'5' * 64}\n"
    assert get_uv.version_of(root / ".tools" / "uv") == "9.9.9"
    assert [path.name for path in (root / ".tools").iterdir()] == ["uv"]


@posix
@pytest.mark.parametrize(
    ("stderr", "reason"),
    [
        ("python: No module named pip", "python: No module named pip"),
        ("WARNING: retrying\nERROR: No matching distribution\nmore", "No matching distribution"),
        ("", "it downloaded no wheel of uv"),
    ],
)
def test_without_pip_too_one_sentence_tells_what_to_do(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    stderr: str,
    reason: str,
) -> None:
    root = _checkout(tmp_path, None)
    monkeypatch.setattr(
        sys, "executable", _python_stand_in(tmp_path, f"cat >&2 <<'END'\n{stderr}\nEND\nexit 1")
    )
    assert get_uv.main(root) == 1
    message = capsys.readouterr().err
    assert message.startswith("uv 9.9.9 could not be fetched (download: ")
    assert message.endswith(f"; pip: {reason}). Install uv by hand, have it on PATH, and run make again.\n")
    assert list((root / ".tools").iterdir()) == []
