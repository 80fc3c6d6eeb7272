"""The files that ship with the package, found by name."""

from __future__ import annotations

from pathlib import Path

_HERE = Path(__file__).parent


def data_path(name: str) -> Path:
    """Return the path of a packaged file."""
    return _HERE / name


def spec_path(name: str) -> Path:
    """Return the path of a shipped sensor spec, for example `prototype-crs-crs`."""
    return _HERE / "specs" / f"{name}.toml"


def spec_names() -> list[str]:
    """Return the names of the shipped sensor specs."""
    return sorted(p.stem for p in (_HERE / "specs").glob("*.toml"))
