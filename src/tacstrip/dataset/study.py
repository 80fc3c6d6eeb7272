"""Study files: TOML with a sensor, shapes, noise and what is to be made of them."""

from __future__ import annotations

import hashlib
import importlib
import json
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, TypeAlias

from tacstrip.contact.noise import Noise
from tacstrip.errors import OptionError, SpecError, TacstripError
from tacstrip.files import read_text, why_unreadable
from tacstrip.sensor.spec import Sensor

Table: TypeAlias = Mapping[str, Any]

_EXTRAS = {"pyarrow": "data", "zarr": "data", "distributed": "dask"}


@dataclass(frozen=True)
class Study:
    """A study file's tables, and where it lies."""

    path: Path
    tables: dict[str, Any]

    @classmethod
    def load(cls, path: Path, known: tuple[str, ...]) -> Study:
        """Read a study file whose keys and tables are among `known`.

        Raises
        ------
        SpecError
            The file is missing, is not TOML, or has an unknown key.
        """
        try:
            if why := why_unreadable(path):
                raise SpecError(f"{path}: {why}")
            tables = tomllib.loads(read_text(path))
        except FileNotFoundError:
            raise SpecError(f"{path}: no such file") from None
        except (OSError, ValueError, RecursionError) as error:
            raise SpecError(f"{path}: not a readable TOML study ({error})") from None
        if unknown := [key for key in tables if key not in known]:
            raise SpecError(f"{path}: unknown key {unknown[0]!r}; the keys are: {', '.join(known)}")
        return cls(path, tables)

    def table(self, name: str, known: tuple[str, ...] | None = None, needed: bool = False) -> dict[str, Any]:
        """Return one of its tables, empty where it is not there; `SpecError` names what is wrong."""
        if needed and name not in self.tables:
            raise SpecError(f"{self.path}: the table [{name}] is missing")
        found = self.tables.get(name, {})
        if not isinstance(found, dict):
            raise SpecError(f"{self.path}: {name} must be a table: [{name}]")
        if known is not None and (unknown := [key for key in found if key not in known]):
            raise SpecError(
                f"{self.path}: unknown key {unknown[0]!r} in [{name}]; the keys are: {', '.join(known)}"
            )
        return found

    def sensor(self) -> Sensor:
        """Return the sensor: a table with a spec's keys, or the name of a spec file, beside the study, or shipped."""
        given = self.tables.get("sensor")
        if given is None:
            raise SpecError(
                f'{self.path}: the sensor is missing; write sensor = "sensor.toml", or a table [sensor]'
            )
        if isinstance(given, str):
            beside = self.path.parent / given
            return Sensor.load(beside if beside.exists() else given)
        with self.naming("sensor"):
            return Sensor.from_dict({"format": 1, **self.table("sensor")})

    def noise(self, sensor: Sensor) -> Noise:
        """Return the errors: the table, else the spec's, else none."""
        if "noise" not in self.tables:
            return sensor.noise or Noise()
        with self.naming("noise"):
            return Noise.from_dict(self.table("noise"))

    def whole(self, name: str, default: int) -> int:
        """Return a whole number from 0 on of the study's own keys."""
        value = self.tables.get(name, default)
        if not isinstance(value, int) or isinstance(value, bool) or value < 0:
            raise SpecError(f"{self.path}: {name} = {value!r}: must be a whole number, 0 or more")
        return value

    def text(self, name: str, default: str) -> str:
        """Return a text of the study's own keys."""
        value = self.tables.get(name, default)
        if not isinstance(value, str):
            raise SpecError(f"{self.path}: {name} = {value!r}: must be a text")
        return value

    def naming(self, table: str) -> _Naming:
        """Name the file and the table in errors of the block."""
        return _Naming(f"{self.path}: [{table}]")


@dataclass(frozen=True)
class _Naming:
    where: str

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: object, error: BaseException | None, _: object) -> None:
        if isinstance(error, TacstripError):
            raise SpecError(f"{self.where}: {error}") from None


def fingerprint(content: Any) -> str:
    """Return a name for what a JSON text of `content` says, 16 hexadecimal digits."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def optional(name: str) -> ModuleType:
    """Import a package that tacstrip does without; `OptionError` says how to install it where it is missing."""
    try:
        return importlib.import_module(name)
    except ImportError:
        root = name.partition(".")[0]
        raise OptionError(
            f"{root} is not installed; install it: pip install 'tacstrip[{_EXTRAS[root]}]', or pip install {root}"
        ) from None
