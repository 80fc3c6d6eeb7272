"""Fetch the uv that uv.lock pins into .tools/, with Python's standard library alone.

Problem: a fresh clone on a machine without uv, whose Python may lack pip and ensurepip.
Solution: a wheel is a zip file, and uv.lock names one per platform with its address and hash.
"""

import hashlib
import http.client
import io
import os
import platform
import re
import struct
import subprocess
import sys
import tempfile
import tomllib
import urllib.parse
import urllib.request
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

TIMEOUT_S = 60
MISFIT = (-1, -1)  # below every version
BY_HAND = "Install uv by hand, have it on PATH, and run make again."


class FetchError(Exception):
    """A way to get uv that did not work out; the text says why."""


@dataclass(frozen=True)
class Wheel:
    """One wheel as the lock names it."""

    url: str
    sha256: str

    @property
    def name(self) -> str:
        """The file name."""
        return urllib.parse.unquote(urllib.parse.urlsplit(self.url).path).rpartition("/")[2]

    @property
    def version(self) -> str:
        """The version, out of the file name."""
        return self.name.split("-")[1]

    @property
    def tags(self) -> list[str]:
        """The platform tags, the last part of the file name."""
        return self.name.removesuffix(".whl").rpartition("-")[2].split(".")


class Platform(NamedTuple):
    """What platform tags speak of: `version` is that of the C library or of macOS."""

    family: str  # "manylinux" (glibc), "musllinux", "macosx", "win", or a system without wheels
    machine: str
    version: tuple[int, int] = (0, 0)

    def __str__(self) -> str:
        """Return the name as messages give it."""
        return f"{self.family} {self.machine}"


def this_platform() -> Platform:
    """Return the platform of the running Python."""
    system, machine = platform.system().lower(), platform.machine().lower()
    if system == "windows":
        return Platform("win", {"x86_64": "amd64", "aarch64": "arm64"}.get(machine, machine))
    if system == "darwin":
        major, minor = (*platform.mac_ver()[0].split("."), "0")[:2]
        return Platform("macosx", machine, (int(major), int(minor)))
    if system != "linux":
        return Platform(system, machine)
    if struct.calcsize("P") == 4:  # a 32-bit system may run on a 64-bit kernel: Raspberry Pi OS does
        machine = {"x86_64": "i686", "aarch64": "armv7l", "armv8l": "armv7l"}.get(machine, machine)
    try:
        glibc = re.search(r"(\d+)\.(\d+)", os.confstr("CS_GNU_LIBC_VERSION") or "")
    except (OSError, ValueError):
        glibc = None
    if glibc:
        return Platform("manylinux", machine, (int(glibc[1]), int(glibc[2])))
    return Platform("musllinux", machine, (1, 2))  # no Python >= 3.11 comes with an older musl


def pinned_wheels(lock_text: str) -> list[Wheel]:
    """Return the wheels of the uv that the lock pins."""
    packages = tomllib.loads(lock_text).get("package", [])
    wheels = [
        Wheel(entry["url"], entry["hash"].removeprefix("sha256:"))
        for package in packages
        if package["name"] == "uv"
        for entry in package.get("wheels", [])
        if "url" in entry and entry.get("hash", "").startswith("sha256:")
    ]
    if not wheels:
        raise FetchError("uv.lock names no wheel of uv")
    return wheels


def pick_wheel(wheels: Sequence[Wheel], platform: Platform) -> Wheel:
    """Return the wheel made for the newest system that `platform` still satisfies."""
    fitting = [
        (needs, wheel)
        for wheel in wheels
        if (needs := max(_needs(tag, platform) for tag in wheel.tags)) != MISFIT
    ]
    if not fitting:
        raise FetchError(f"uv.lock has no wheel of uv for {platform}")
    return max(fitting, key=lambda pair: pair[0])[1]


def _needs(tag: str, platform: Platform) -> tuple[int, int]:
    """Return the version of the platform that `tag` asks for, `MISFIT` if `platform` will not do."""
    family, machine, version = platform
    if family in {"manylinux", "musllinux"} and tag == f"linux_{machine}":
        return (0, 0)
    if family == "win" and tag == ("win32" if machine == "x86" else f"win_{machine}"):
        return (0, 0)
    versioned = re.fullmatch(r"(manylinux|musllinux|macosx)_(\d+)_(\d+)_(\w+)", tag)
    if versioned and versioned[1] == family and versioned[4] == machine:
        needs = (int(versioned[2]), int(versioned[3]))
        if needs <= version:
            return needs
    return MISFIT


def download(wheel: Wheel) -> bytes:
    """Return the bytes of `wheel`, whose hash was found right."""
    try:
        with urllib.request.urlopen(wheel.url, timeout=TIMEOUT_S) as response:
            content: bytes = response.read()
    except (OSError, http.client.HTTPException) as error:
        raise FetchError(f"download: {error}") from error
    if hashlib.sha256(content).hexdigest() != wheel.sha256:
        raise FetchError(f"download: {wheel.name} does not have the sha256 that uv.lock gives")
    return content


def extract(content: bytes, target: Path) -> None:
    """Put the program called `target.name` out of the wheel at `target`, at once or not at all."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        wanted = f".data/scripts/{target.name}"
        member = next((name for name in archive.namelist() if name.endswith(wanted)), None)
        if member is None:
            raise FetchError(f"download: the wheel holds no program {target.name}")
        program = archive.read(member)
    with tempfile.TemporaryDirectory(dir=target.parent) as folder:
        fresh = Path(folder, target.name)
        fresh.write_bytes(program)
        _put(fresh, target)


def install_by_pip(wheels: Sequence[Wheel], target: Path) -> None:
    """Let pip, with whatever mirror it is set up for, fetch the same uv under the same hashes."""
    hashes = " ".join(f"--hash=sha256:{wheel.sha256}" for wheel in wheels)
    with tempfile.TemporaryDirectory(dir=target.parent) as folder:
        wanted = Path(folder, "requirements.txt")
        wanted.write_text(f"uv=={wheels[0].version} {hashes}\n", encoding="utf-8")
        pip = [
            sys.executable,
            "-m",
            "pip",
            "install",
            "-q",
            "--no-deps",
            "--only-binary=:all:",
            "--require-hashes",
        ]
        run = subprocess.run(
            [*pip, "-t", str(Path(folder, "pip")), "-r", str(wanted)],
            env=os.environ | {"PIP_USER": "0", "PIP_REQUIRE_VIRTUALENV": "0"},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
        found = next((path for path in Path(folder).rglob(target.name) if path.is_file()), None)
        if run.returncode != 0 or found is None:
            lines = [line for line in run.stderr.splitlines() if line.strip()] or ["it brought no uv"]
            reason = next((line for line in lines if line.startswith("ERROR:")), lines[-1])
            raise FetchError(f"pip: {reason.removeprefix('ERROR: ')}")
        _put(found, target)


def _put(program: Path, target: Path) -> None:
    program.chmod(0o755)
    program.replace(target)


def version_of(program: Path) -> str | None:
    """Return the version that `program` tells, None if it does not run."""
    try:
        run = subprocess.run([program, "--version"], capture_output=True, text=True, check=False)
    except OSError:
        return None
    words = run.stdout.split()
    return words[1] if run.returncode == 0 and len(words) > 1 else None


def get_uv(lock: Path, target: Path) -> None:
    """Have the uv of `lock` at `target`."""
    wheels = pinned_wheels(lock.read_text(encoding="utf-8"))
    version = wheels[0].version
    if version_of(target) == version:
        target.touch()  # the lock changed elsewhere: tell make that this is up to date
        return
    wheel = pick_wheel(wheels, this_platform())
    print(f"Fetching uv {version} into {target.parent.name}/", flush=True)
    target.parent.mkdir(exist_ok=True)
    try:
        extract(download(wheel), target)
    except FetchError as no_download:
        try:
            install_by_pip(wheels, target)
        except FetchError as no_pip:
            raise FetchError(f"uv {version} could not be fetched ({no_download}; {no_pip})") from no_pip
    if version_of(target) != version:
        target.unlink()
        raise FetchError(f"uv {version} was fetched but does not run on this machine ({this_platform()})")


def main(root: Path) -> int:
    """Fetch uv for the checkout at `root`; return the exit code."""
    target = root / ".tools" / ("uv.exe" if os.name == "nt" else "uv")
    try:
        get_uv(root / "uv.lock", target)
    except FetchError as error:
        print(f"{error}. {BY_HAND}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(__file__).resolve().parent.parent))
