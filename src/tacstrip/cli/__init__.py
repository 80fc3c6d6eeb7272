"""The command line. Verbs load when they are called, so that `--help` is quick."""

from __future__ import annotations

import contextlib
import difflib
import errno
import importlib
import itertools
import os
import shlex
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tacstrip.errors import OptionError, ReadingError, RecordingError, TacstripError
from tacstrip.interrupt import all_as_ctrl_c

if TYPE_CHECKING:
    from tacstrip.contact.shape import Contact
    from tacstrip.diagnose.log import Log
    from tacstrip.reconstruction.result import Reconstruction
    from tacstrip.scan import Scan
    from tacstrip.sensor.layers import AnySensor
    from tacstrip.sensor.spec import Sensor
    from tacstrip.stream.source import RawScan, Source

# Verb: what it is for, as `tacstrip --help` says it. Each verb is `command` in the module of its name.
VERBS = {
    "init": "Write a commented sensor spec to start from.",
    "demo": "Recover a rectangle from packaged (synthetic) volts of the ten-strip prototype.",
    "simulate": "Press a contact on a sensor and write the readings.",
    "press": "Press a solid object into a curved or flat skin and write the readings.",
    "import": "Turn a log of your own form into readings.",
    "reconstruct": "Recover shapes from readings.",
    "track": "Recover objects over time, one rigid shape each, from a whole recording.",
    "generate": "Write a labelled data set of simulated scans, for learning.",
    "sweep": "Measure many designs: bounds, accuracy, right counts and speed; on many machines too.",
    "calibrate": "Fit a unit's constants to known contacts; plan them, learn the rest level, remove drift.",
    "record": "Record codes and shapes from a simulated sensor, readings or another recording.",
    "replay": "Play back a recording's scans, at their pace or faster.",
    "recover": "Recover the undamaged part of a cut or damaged recording.",
    "convert": "Turn recordings into CSV, NumPy or GeoJSON, and readings into recordings.",
    "live": "Show, record and pass on what touches the sensor, from a device, a virtual one or a file.",
    "doctor": "Find faults of the hardware in readings.",
    "noise": "Learn a sensor's noise from a recording of a still press, for its spec.",
    "spice": "Write the sensor and its contact as a netlist for ngspice.",
    "limits": "Compute how well a sensor can locate corners, and which designs reach a wanted error.",
    "reproduce": "Reproduce chapters 2 to 6 of the thesis, with the printed figures.",
}


# The verbs that take a sensor of two layers.
_TWO_LAYERS = ("init", "simulate", "reconstruct", "limits", "record", "replay", "convert", "recover", "live")
_LOOK_SCANS = 10_000  # of a recording, for a warning
_THREADS = (
    "OPENBLAS_NUM_THREADS",
    "GOTO_NUM_THREADS",
    "OMP_NUM_THREADS",
)  # where OpenBLAS looks for a number of threads, in its order
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_COULD_NOT = (*_FULL, errno.EIO, errno.ENOMEM, errno.EMFILE, errno.ENFILE)  # whatever the input


class _Verbs(click.Group):
    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(VERBS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in VERBS:
            return None
        command = importlib.import_module(f"tacstrip.cli.{cmd_name}").command
        assert isinstance(command, click.Command)
        return command

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        """Find the verb, or name the one that is nearly written so."""
        if args[0] not in VERBS and (near := difflib.get_close_matches(args[0], VERBS, 1)):
            ctx.fail(f"No such command {args[0]!r}. Did you mean {near[0]!r}?")
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the verb; whoever reads its output may stop, as `| head` does, and that is no error.

        Where something is missing the verb's example shows how it is given.
        """
        try:
            return super().invoke(ctx)
        except click.MissingParameter as error:
            verb = error.ctx.command if error.ctx else self
            _, _, example = " ".join((verb.help or "").split()).partition("Example: ")
            raise click.UsageError(f"{error.format_message()} For example: {example}", error.ctx) from None
        except BrokenPipeError:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, sys.stdout.fileno())  # what is still to be flushed at the end
            ctx.exit(0)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(list(VERBS.items()))


def _show_version(ctx: click.Context, _: click.Parameter, asked: bool) -> None:
    if asked and not ctx.resilient_parsing:
        from importlib.metadata import version  # late, as all that `--help` does without

        from tacstrip.core.library import description

        click.echo(f"tacstrip {version('tacstrip')} (core: {description()})")
        ctx.exit()


@click.group(cls=_Verbs, context_settings={"help_option_names": ["-h", "--help"]})
@click.option(
    "--version",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_show_version,
    help="Show the version and which core is in use, and exit.",
)
def cli() -> None:
    """From the voltages of a resistive hybrid tactile sensor to the shape that touches it.

    Where to begin: without a sensor `tacstrip demo`, or `tacstrip live --simulate`; with a log of your own `tacstrip
    init --from LOG` begins the sensor's spec, and says how to go on.

    Exit code 0: done; 1: could not do it; 2: bad input. `tacstrip VERB --help` shows an example.
    """


def protect(
    output: Path | None, *inputs: str | Path | None, force: bool = False, flag: str = "--force"
) -> None:
    """Refuse, before any work is done, to write over a file that is read, or into a folder that is not there.

    Without `force`, refuse any file that is there, too, but what can be made again; `flag` is the option that says so.
    Every verb calls it for every file that it is told to write.

    Raises
    ------
    OptionError, FileNotFoundError
        They name the output.
    """
    from tacstrip.files import replaceable

    if output is None:
        return
    if not output.parent.exists():
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(output))
    if output.is_dir():
        raise OptionError(f"{output} is a folder; name a file, such as {output / 'new'}")
    if output.exists():
        for file in inputs:
            if file is not None and Path(file).exists() and output.samefile(file):
                raise OptionError(f"{output} is read here and would be written over; choose another name")
        if not force and not replaceable(output):
            raise OptionError(f"{output} exists already; choose another name, or add {flag} to write over it")


def own_folder(out: Path, *marks: str) -> None:
    """Refuse a folder to write to that holds files, but none of those that the verb itself has written there.

    `marks` are patterns of their names, which no other program gives.

    Raises
    ------
    OptionError
        It names the folder.
    """
    if not out.exists():
        return
    if not out.is_dir():
        raise OptionError(f"{out} is a file; name a folder")
    if any(not path.is_dir() for path in out.rglob("*")) and not any(any(out.glob(mark)) for mark in marks):
        raise OptionError(f"{out} holds files that are not of this verb; name a new or an empty folder")


def note(text: str) -> None:
    """Say on standard error what is not the verb's output."""
    click.echo(text, err=True)


def warn(*texts: str, file: object = "") -> None:
    """Say on standard error what is probably not meant, of a file; empty texts say nothing."""
    for text in filter(None, texts):
        note(f"Warning: {file}: {text}" if file else f"Warning: {text}")


def load_sensor(spec: str | Path, without: Sequence[str] = ()) -> Sensor:
    """Load a spec file or a shipped spec, and warn where it looks like metres; errors as of `Sensor.load`.

    `without` names channels to leave out, besides those of the spec. One with two layers is refused.
    """
    return one_layer(spec, load_layers(spec, without))


def one_layer(name: str | Path, sensor: AnySensor) -> Sensor:
    """Return the sensor of a spec or a recording, or raise `OptionError` where it has two layers."""
    from tacstrip.sensor.spec import Sensor

    if not isinstance(sensor, Sensor):
        verb = click.get_current_context().info_name
        raise OptionError(
            f"{name}: is of two layers, and `tacstrip {verb}` takes a sensor of one; two take: {', '.join(_TWO_LAYERS)}"
        )
    return sensor


def load_layers(spec: str | Path, without: Sequence[str] = ()) -> AnySensor:
    """Load a spec as `load_sensor` does, also one with two layers."""
    from tacstrip.files import other_kind
    from tacstrip.io.input_checks import unlikely_lengths  # late, as all that loads NumPy
    from tacstrip.sensor.spec import Sensor

    if (kind := other_kind(spec, ".toml")) and Path(spec).is_file():
        ctx = click.get_current_context()
        order = " ".join(p for p in ctx.command.collect_usage_pieces(ctx) if not p.startswith("[OPTIONS"))
        raise OptionError(
            f"{spec}: is {kind}, where the sensor's spec (.toml) belongs: tacstrip {ctx.info_name} {order}"
        )
    sensor: AnySensor = Sensor.load(spec)
    if isinstance(sensor, Sensor):
        sensor = replace(sensor, without=(*sensor.without, *without))
    elif without:
        raise OptionError(
            f"--without {without[0]}: of two layers write it into the spec: without = {list(without)!r} in a [[layer]]"
        )
    warn(unlikely_lengths(sensor), file=spec)
    return sensor


def load_log(file: Path, spec: str | None, call: str = "--sensor sensor.toml") -> Log:
    """Read readings (.csv) of the sensor of a spec, or a recording; `call` is how the verb is told the spec.

    What is misread is told.
    """
    from tacstrip.diagnose.log import Log, read_log
    from tacstrip.io.columns import BEGIN_SPEC
    from tacstrip.io.input_checks import half_read, misread, unlikely_times
    from tacstrip.stream.replay import Recording

    if file.suffix.lower() == ".mcap":
        source = Recording(file, load_sensor(spec) if spec else None)
        with contextlib.closing(source):
            log = Log.of_codes(one_layer(file, source.sensor), some_scans(file, source))
            if source.condition.whole:
                return log
            lost = f"{source.condition.lost_bytes} bytes of {source.condition.total_bytes}"
            return replace(log, missing=f"the recording is cut: {lost} lie after its last whole part")
    if spec is None:
        raise OptionError(f"{file} does not say what sensor it is of; name its spec: {call} ({BEGIN_SPEC})")
    log = read_log(file, load_sensor(spec))
    told = (half_read(file, log.sensor, tuple(log.raw)), unlikely_times(file, log.time_s))
    warn(*told, *misread(file, log.sensor, log.raw))
    return log


def some_scans(name: str | Path, source: Source) -> Iterator[RawScan]:
    """Yield the scans of a source, of which there has to be one.

    Raises
    ------
    ReadingError, OptionError
        There is none; the latter where it is a recording that was cut before its first.
    """
    from tacstrip.stream.replay import Recording

    there = False
    for raw in source:
        there = True
        yield raw
    if not there:
        if isinstance(source, Recording) and not source.condition.whole:
            cut = "it was cut before its first whole chunk, and nothing can be recovered"
            raise OptionError(f"{name}: there is no scan in it: {cut}")
        raise ReadingError(f"{name}: there is no scan in it")


def warn_of_input(name: str | Path, source: Source) -> None:
    """Warn of what is probably not meant in a source that is a file, as far as it can be read."""
    from tacstrip.diagnose.log import Log
    from tacstrip.io.input_checks import clock_back, half_read, misread, unlikely_times
    from tacstrip.sensor.spec import Sensor
    from tacstrip.stream.replay import ReadingsSource, Recording

    if not isinstance(source, ReadingsSource | Recording) or not isinstance(source.sensor, Sensor):
        return
    try:  # a recording is iterated once: another look at it
        scans = source if isinstance(source, ReadingsSource) else Recording(name, source.sensor)
        with contextlib.closing(scans):
            log = Log.of_codes(scans.sensor, itertools.islice(some_scans(name, scans), _LOOK_SCANS))
    except (ReadingError, RecordingError):
        return
    if isinstance(source, ReadingsSource):
        told = (half_read(name, source.sensor, source.names), unlikely_times(name, log.time_s))
        warn(*told, *misread(name, log.sensor, log.raw))
    warn(clock_back(name, log.time_s))
    warn_of_log(name, log)


def warn_of_log(name: str | Path, log: Log) -> None:
    """Warn of what is probably not meant in the readings of a file."""
    import numpy as np

    from tacstrip.io.input_checks import implausible, other_scale

    raw = {n: np.where(log.touched, values, np.nan) for n, values in log.raw.items()}
    hint = other_scale(log.sensor, raw)
    warn(*implausible(name, log.sensor, raw), f"{name}: {hint}" if hint else "")
    warn_of_order(name, log)


def warn_of_order(name: str | Path, log: Log) -> tuple[tuple[int, ...], str]:
    """Warn where strips read as if their cables were exchanged; return them, and in a few words that they do."""
    from tacstrip.diagnose.doctor import exchanged_strips

    if (found := exchanged_strips(log)) is None:
        return (), ""
    strips, sure = found
    numbers = [str(i + log.sensor.strip_base) for i in strips]
    doubt = "read as if they were exchanged" if sure else "may be exchanged"
    told = f"strips {', '.join(numbers[:-1])} and {numbers[-1]} {doubt}"
    if len(numbers) == 1:
        told = f"strip {numbers[0]} and another {doubt}"
    sensor = "" if str(name).lower().endswith(".mcap") else " --sensor SENSOR"
    warn(
        f"{told}: each fits where the other should be. Check their cables, or the order of the log's columns; "
        f"`tacstrip doctor {shlex.quote(str(name))}{sensor}` says more",
        file=name,
    )
    return strips, told


def save_picture(
    path: Path,
    sensor: AnySensor,
    scans: Sequence[Scan],
    results: dict[str, list[Reconstruction]],
    contacts: Sequence[Contact] = (),
) -> Path:  # fmt: skip
    """Draw scans, what was reconstructed of them by each method, and the contacts that touched; return the file."""
    from tacstrip.plot.layers import layers_figure
    from tacstrip.plot.results import reconstruction_figure
    from tacstrip.plot.theme import save
    from tacstrip.sensor.spec import Sensor

    if isinstance(sensor, Sensor):
        return save(reconstruction_figure(sensor, scans, results, contacts), path)
    (found,) = results.values() or [[]]
    return save(layers_figure(sensor, scans, found, contacts), path)


def check_method(option: str, method: str | None, sensor: Sensor, signatures: Sequence[str]) -> None:
    """Refuse a method that this sensor, or what was read of it, cannot have, and name one that it can.

    Parameters
    ----------
    option
        The option that the user gives a method by, such as "--method".
    method
        The name of one, also one that does not exist: that is for others to say.
    sensor, signatures
        The sensor, and the names of what was read.

    Raises
    ------
    OptionError
    """
    if method in ("polygon", "vertex", "pieces") and not sensor.kind.closed_form:
        raise OptionError(
            f"{option} {method} is not for a {sensor.construction} sensor, whose strips shift each other's readings "
            f"(3.3); take {option} profile"
        )
    if method == "profile" and len(have := [n for n in signatures if n in sensor.signatures]) == 1:
        raise OptionError(
            f"{option} profile needs both k_h and k_l, and here is {have[0]} alone; take {option} polygon"
        )


def main() -> None:
    """Run the command line; a known error becomes one clear line and exit code 2, a full disk or the like 1.

    Linear algebra has one thread, unless the environment says how many: matrices are small here, and threads wait for
    each other. OpenBLAS counts them as it loads, with NumPy, which is later; workers have the same environment.
    """
    if not any(os.environ.get(name) for name in _THREADS):
        os.environ[_THREADS[0]] = "1"
    try:
        with all_as_ctrl_c():
            cli(standalone_mode=True)
    except TacstripError as error:
        note(f"Error: {error}")
        sys.exit(2)
    except OSError as error:
        missing = " (is there such a folder?)" if isinstance(error, FileNotFoundError) else ""
        place = "the output" if error.filename is None else error.filename
        then = "; nothing is written there: make room, or choose another disk" if error.errno in _FULL else ""
        note(f"Error: {place}: {error.strerror}{missing}{then}")
        sys.exit(1 if error.errno in _COULD_NOT else 2)
