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
from pathlib import Path
from typing import NamedTuple

TIMEOUT_S = 60
INCOMPATIBLE = (-1, -1)  # below every version
BY_HAND = "Install uv by hand, have it on PATH, and run make again."


class FetchError(Exception):
    """A way to get uv that failed; the text says why."""


class Wheel(NamedTuple):
    """One wheel as the lock names it."""

    url: str
    sha256: str

    @property
    def name(self) -> str:
        """The file name."""
        return urllib.parse.unquote(urllib.parse.urlsplit(self.url).path).rpartition("/")[2]

    @property
    def version(self) -> str:
        """The version, from the file name."""
        return self.name.split("-")[1]

    @property
    def tags(self) -> list[str]:
        """The platform tags, the last part of the file name."""
        return self.name.removesuffix(".whl").rpartition("-")[2].split(".")


class Platform(NamedTuple):
    """A platform as wheel tags describe it; `version` is that of the C library or of macOS."""

    family: str  # "manylinux" (glibc), "musllinux", "macosx", "win", or a system without wheels
    machine: str
    version: tuple[int, int] = (0, 0)


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
    """Return the wheel for the newest system version that `platform` still satisfies."""
    needs = {wheel: max(_required_version(tag, platform) for tag in wheel.tags) for wheel in wheels}
    best = max(wheels, key=lambda wheel: needs[wheel])
    if needs[best] == INCOMPATIBLE:
        raise FetchError(f"uv.lock has no wheel of uv for {platform.family} {platform.machine}")
    return best


def _required_version(tag: str, platform: Platform) -> tuple[int, int]:
    """Return the version of the platform that `tag` asks for, `INCOMPATIBLE` for another platform."""
    family, machine, version = platform
    windows = "win32" if machine == "x86" else f"win_{machine}"
    if tag == {"manylinux": f"linux_{machine}", "musllinux": f"linux_{machine}", "win": windows}.get(family):
        return (0, 0)
    versioned = re.fullmatch(rf"{family}_(\d+)_(\d+)_{machine}", tag)
    needs = (int(versioned[1]), int(versioned[2])) if versioned else INCOMPATIBLE
    return needs if needs <= version else INCOMPATIBLE


def download(wheel: Wheel) -> bytes:
    """Return the bytes of `wheel` after checking their hash."""
    try:
        with urllib.request.urlopen(wheel.url, timeout=TIMEOUT_S) as response:
            content: bytes = response.read()
    except (OSError, http.client.HTTPException) as error:
        raise FetchError(f"download: {error}") from error
    if hashlib.sha256(content).hexdigest() != wheel.sha256:
        raise FetchError(f"download: {wheel.name} does not have the sha256 that uv.lock gives")
    return content


def download_by_pip(wheels: Sequence[Wheel]) -> bytes:
    """Return the bytes of the wheel that pip, with its own mirror settings, fetches under the same hashes."""
    hashes = " ".join(f"--hash=sha256:{wheel.sha256}" for wheel in wheels)
    options = ["-q", "--no-deps", "--only-binary=:all:", "--require-hashes"]
    with tempfile.TemporaryDirectory() as folder:
        requirements = Path(folder, "requirements.txt")
        requirements.write_text(f"uv=={wheels[0].version} {hashes}\n", encoding="utf-8")
        run = subprocess.run(
            [sys.executable, "-m", "pip", "download", *options, "-d", folder, "-r", str(requirements)],
            env=os.environ | {"PIP_REQUIRE_VIRTUALENV": "0"},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
        files = list(Path(folder).glob("*.whl"))
        if run.returncode != 0 or not files:
            lines = [line for line in run.stderr.splitlines() if line.strip()] or [
                "it downloaded no wheel of uv"
            ]
            reason = next((line for line in lines if line.startswith("ERROR:")), lines[-1])
            raise FetchError(f"pip: {reason.removeprefix('ERROR: ')}")
        return files[0].read_bytes()


def extract(content: bytes, target: Path) -> None:
    """Put the program called `target.name` from the wheel at `target`, whole or not at all."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        suffix = f".data/scripts/{target.name}"
        member = next((name for name in archive.namelist() if name.endswith(suffix)), None)
        if member is None:
            raise FetchError(f"download: the wheel holds no program {target.name}")
        with tempfile.TemporaryDirectory(dir=target.parent) as folder:
            program = Path(folder, target.name)
            program.write_bytes(archive.read(member))
            program.chmod(0o755)
            program.replace(target)


def version_of(program: Path) -> str | None:
    """Return the version that `program` prints, None if it does not run."""
    try:
        run = subprocess.run([program, "--version"], capture_output=True, text=True, check=False)
    except OSError:
        return None
    words = run.stdout.split()
    return words[1] if run.returncode == 0 and len(words) > 1 else None


def get_uv(lock: Path, target: Path) -> None:
    """Put the uv that `lock` pins at `target`, unless it is there already."""
    wheels = pinned_wheels(lock.read_text(encoding="utf-8"))
    version = wheels[0].version
    if version_of(target) == version:
        target.touch()  # the lock changed elsewhere: tell make that this is up to date
        return
    wheel = pick_wheel(wheels, this_platform())
    print(f"Fetching uv {version} into {target.parent.name}/", flush=True)
    target.parent.mkdir(exist_ok=True)
    try:
        content = download(wheel)
    except FetchError as no_download:
        try:
            content = download_by_pip(wheels)
        except FetchError as no_pip:
            raise FetchError(f"uv {version} could not be fetched ({no_download}; {no_pip})") from no_pip
    extract(content, target)
    if version_of(target) != version:
        target.unlink()
        raise FetchError(f"uv {version} was fetched but does not run on this machine ({wheel.name})")


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
