"""`tacstrip convert`."""

from __future__ import annotations

import contextlib
from pathlib import Path

import click

from tacstrip.cli import load_layers, options, protect, warn_of_input
from tacstrip.cli.record import save_recording
from tacstrip.cli.replay import warn_of_cut
from tacstrip.errors import OptionError, one_of
from tacstrip.files import replacing
from tacstrip.stream.export import write_csv, write_npz, write_shapes
from tacstrip.stream.replay import Recording, open_source
from tacstrip.stream.source import Source

_KINDS = (".mcap", ".csv", ".npz", ".geojson", ".toml")


@click.command()
@options.sensor_and_input()
@options.output("New file: .csv, .npz, .geojson, .mcap or .toml.")
@options.flag("--codes", help="A/D codes instead of volts in a .csv.")
@options.FORCE
def command(files: tuple[str, ...], output: Path, codes: bool, force: bool) -> None:
    """Convert INPUT, a recording (.mcap) or readings (.csv), to another format.

    Readings need their SENSOR (a spec file or a shipped spec); a recording is decoded with its own spec where none
    is named. Scans go to .csv, .npz and .mcap; shapes to .npz and .geojson, from recordings that hold
    some; the spec to .toml.

    Example: tacstrip convert session.mcap -o session.npz
    """
    kind = output.suffix.lower()
    if kind not in _KINDS:
        raise OptionError(f"-o {output}: " + one_of("ending", kind, _KINDS))
    options.belong(kind == ".csv", f"is for a .csv, and {output} is none", "codes")
    protect(output, *files, force=force)
    source = open_source(files[-1], load_layers(files[0]) if len(files) == 2 else None)
    if kind == ".mcap":
        with replacing(output) as part:
            save_recording(files, source, output, force=force, part=part)
        return
    warn_of_input(files[-1], source)
    with contextlib.closing(source):
        contents = _convert(files[-1], source, output, codes)
    click.echo(f"{output}: {contents}")
    if kind != ".toml":
        warn_of_cut(source)


def _convert(name: str, source: Source, output: Path, codes: bool) -> str:
    """Write a file by its ending; return a description of its contents."""
    match output.suffix.lower():
        case ".geojson":
            if not isinstance(source, Recording):
                raise OptionError(f"{name} holds no shapes; `tacstrip reconstruct` makes them from readings")
            return f"{write_shapes(output, source)} shape(s)"
        case ".toml":
            source.sensor.save(output)
            return f"the spec of a {source.sensor.construction} sensor of {source.sensor.strips} strips"
        case ".csv":
            many = write_csv(output, source, codes)
        case _:
            many = write_npz(output, source)
    return f"{many} scan(s) of {source.sensor.strips} strips"
