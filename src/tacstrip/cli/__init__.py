"""The command line. Verbs load when they are called, so that `--help` is quick."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import click

from tacstrip.errors import OptionError, TacstripError

# Verb: what it is for, as `tacstrip --help` says it. Each verb is `command` in the module of its name.
VERBS = {
    "init": "Write a commented sensor spec to start from.",
    "demo": "Recover a rectangle from packaged (synthetic) volts of the ten-strip prototype.",
    "simulate": "Press a contact on a sensor and write the readings.",
    "reconstruct": "Recover shapes from readings.",
    "calibrate": "Fit a unit's constants to contacts of known place; plan them, learn rest, take drift out.",
    "record": "Record codes and shapes from a simulated sensor, readings or another recording.",
    "replay": "Give a recording's scans again, at their pace or faster.",
    "recover": "Make a cut or damaged recording whole again.",
    "convert": "Turn recordings into CSV, NumPy or GeoJSON, and readings into recordings.",
    "live": "Show, record and pass on what touches the sensor, from a device, a virtual one or a file.",
    "doctor": "Say from readings what is wrong with the hardware.",
    "spice": "Write the sensor and its contact as a netlist for ngspice.",
    "limits": "Say how well a sensor can tell a contact's corners, and which designs reach a wanted error.",
    "reproduce": "Make chapters 2 to 6 of the thesis again, beside its printed figures.",
}


class _Verbs(click.Group):
    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(VERBS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in VERBS:
            return None
        command = importlib.import_module(f"tacstrip.cli.{cmd_name}").command
        assert isinstance(command, click.Command)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(list(VERBS.items()))


@click.group(cls=_Verbs, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="tacstrip", message="tacstrip %(version)s")
def cli() -> None:
    """From the voltages of a resistive hybrid tactile sensor to the shape that touches it.

    Exit code 0: done; 1: could not do it; 2: bad input. `tacstrip VERB --help` shows an example.
    """


def protect(output: Path | None, *inputs: str | Path | None) -> None:
    """Refuse to write over a file that is read: `OptionError` names it."""
    if output is not None and output.exists():
        for file in inputs:
            if file is not None and Path(file).exists() and output.samefile(file):
                raise OptionError(f"{output} is read here and would be written over; choose another name")


def new_file(output: Path, force: bool, *inputs: str | Path) -> None:
    """Refuse to write over a file that is read, and without `force` over any: `OptionError` names it."""
    protect(output, *inputs)
    if output.exists() and not force:
        raise OptionError(f"{output} exists already; choose another name, or add --force to write over it")


def main() -> None:
    """Run the command line; a known error becomes one clear line and exit code 2."""
    try:
        cli(standalone_mode=True)
    except TacstripError as error:
        click.echo(f"Error: {error}", err=True)
        sys.exit(2)
    except OSError as error:
        missing = " (is there such a folder?)" if isinstance(error, FileNotFoundError) else ""
        place = "the output" if error.filename is None else error.filename
        click.echo(f"Error: {place}: {error.strerror}{missing}", err=True)
        sys.exit(2)
