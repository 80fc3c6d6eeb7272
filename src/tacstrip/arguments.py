"""Arguments of the wrong type: a sentence that says what to write, in place of an error about internals."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import UnionType
from typing import Any, ParamSpec, TypeAlias, TypeVar

from tacstrip.errors import ArgumentError

Kind: TypeAlias = type | UnionType | tuple[type, ...]

_P = ParamSpec("_P")
_T = TypeVar("_T")
_SHOWN = 40  # letters of a value in a message
# How to make one of each type, by its name, for whoever gave something else.
_MAKE = {
    "Sensor": 'ts.Sensor.load("sensor.toml") or ts.Sensor(construction=..., strips=..., pitch_mm=..., length_mm=...)',
    "Scan": "ts.Scan(kh=..., kl=...), or one of ts.read_readings(file, sensor)",
    "Contact": "ts.Contact.polygon([(x, y), ...]), .line, .points, or ts.read_contact(file)",
    "Path": '"runs.csv", the name of a file; a table is first written to one: table.to_csv("runs.csv", index=False)',
    "Noise": "ts.Noise(positional=0.005)",
    "Footprint": "ts.footprint(sensor, contact)",
    "Runs": "ts.read_runs(file, sensor)",
    "RawScan": "tacstrip.stream.encode(scan, sensor)",
    "Reconstruction": "ts.fit_polygon(scan, sensor)",
    "RecoveredObject": "ts.fit_polygon(scan, sensor).objects[0]",
    "Outline": "ts.Outline.of(vertices)",
    "Track": "ts.track(scans, sensor)[0]",
    "Patch": "ts.press(sensor, solid, depth_mm=1.0)",
    "Calibrated": "ts.calibrate_unit(sensor, runs)",
    "Report": "tacstrip.diagnose.diagnose(log)",
    "Solid": "ts.Solid.plane().at(position_mm, toward), .sphere, .cylinder, .edge, .box or .from_mesh",
}


def takes(**kinds: Kind) -> Callable[[Callable[_P, _T]], Callable[_P, _T]]:
    """Refuse arguments of other types than these, by name, with an `ArgumentError` that says what to write instead.

    A union is one of its types; a tuple of one type stands for a sequence of such, of two for one of it or a sequence;
    None passes where it is the argument's default. Two exchanged arguments are named.
    """

    def decorate(function: Callable[_P, _T]) -> Callable[_P, _T]:
        parameters = inspect.signature(function).parameters
        places = list(parameters)
        optional = {name for name in kinds if parameters[name].default is None}
        checked = [(places.index(name), name, kind) for name, kind in kinds.items()]

        @functools.wraps(function)
        def call(*args: _P.args, **kwargs: _P.kwargs) -> _T:
            for at, name, kind in checked:
                value = args[at] if at < len(args) else kwargs.get(name, call)
                if value is call or _fits(value, kind) or (value is None and name in optional):
                    continue
                given = dict(zip(places, args, strict=False)) | kwargs
                needed = [n for n in places if n in kinds or parameters[n].default is inspect.Parameter.empty]
                raise ArgumentError(_explanation(function.__qualname__, needed, name, kind, given, kinds))
            return function(*args, **kwargs)

        return call

    return decorate


def refuse_positional(what: str, values: Sequence[object], example: str) -> None:
    """Refuse arguments without a name where only a name says what they mean: `ArgumentError`, with an example."""
    if values:
        raise ArgumentError(f"{what}({_shown(values[0])}) does not say what it means: write {example}")


def _fits(value: object, kind: Kind) -> bool:
    if isinstance(kind, type | UnionType):
        return isinstance(value, kind)
    one = kind[0]
    if len(kind) > 1 and isinstance(value, one):
        return True
    if isinstance(value, str | bytes | Mapping) or not hasattr(value, "__iter__"):
        return False
    # An iterator must not be used up.
    return not hasattr(value, "__len__") or all(isinstance(v, one) for v in value)


def _explanation(
    function: str, needed: Sequence[str], name: str, kind: Kind, given: Mapping[str, Any],
    kinds: Mapping[str, Kind],
) -> str:  # fmt: skip
    function = function.removesuffix(".__init__")
    value, one = given[name], _first(kind)
    many = isinstance(kind, tuple) and len(kind) == 1
    for other in given:
        if other != name and _fits(given[other], kind) and (other not in kinds or _fits(value, kinds[other])):
            order = ", ".join(n for n in needed if n != "self")
            return f"{function}: {name} and {other} are exchanged; write {function}({order}, ...)"
    wanted = f"a list of {one.__name__}s" if many else _with_article(one.__name__)
    return f"{function}: {name} is {_shown(value)}, not {wanted}; write {_instead(value, one, many)}"


def _first(kind: Kind) -> type:
    """Return the type that a message names."""
    first: type = kind if isinstance(kind, type) else kind[0] if isinstance(kind, tuple) else kind.__args__[0]
    return first


def _instead(value: object, kind: type, many: bool) -> str:
    """Say what to write in place of a value; with the value itself where that is plain."""
    name = kind.__name__
    make = _MAKE.get(name, f"ts.{name}(...)")
    if many:
        return "[it], a list" if isinstance(value, kind) else f"a list of them, each as {make}"
    if name == "Sensor" and isinstance(value, str | Path):
        return f"ts.Sensor.load({str(value)!r})"
    if name == "Sensor" and type(value).__name__ == "LayeredSensor":
        return "sensor.layers[0].sensor, one layer, with scan.split(sensor)[0], what it read"
    if name == "Contact" and isinstance(value, str | Path):
        return f"ts.read_contact({str(value)!r})"
    if name == "Noise" and isinstance(value, int | float):
        return f"ts.Noise(positional={value!r}), half-width over Vref"
    if isinstance(value, list | tuple) and value and isinstance(value[0], kind):
        return f"one {name} at a time"
    if name == "Sensor" and isinstance(value, Mapping):
        return "ts.Sensor(**keys), or ts.Sensor.from_dict(keys) for those of a spec file"
    return make


def _shown(value: object) -> str:
    """Show a value by its type, a short one as it is written."""
    text = repr(value)
    kind = type(value).__name__
    if isinstance(value, int | float | str | type(None)) and len(text) <= _SHOWN:
        return text
    if isinstance(value, list | tuple | dict):
        return f"a {kind}"
    return _with_article(kind)


def _with_article(name: str) -> str:
    return f"{'an' if name[0] in 'aeiouAEIO' else 'a'} {name}"
