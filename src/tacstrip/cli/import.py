"""`tacstrip import`."""  # noqa: N999, the module of a verb has its name

from __future__ import annotations

import itertools
import shlex
import tempfile
import tomllib
from pathlib import Path

import click
import numpy as np

from tacstrip.cli import load_sensor, note, options, protect, warn, warn_of_log
from tacstrip.cli.record import save_recording
from tacstrip.diagnose.log import read_log
from tacstrip.errors import OptionError, ReadingError, TacstripError, one_of
from tacstrip.files import read_text, replacing
from tacstrip.io.input_checks import half_read, one_reading
from tacstrip.io.log_import.containers import read_table
from tacstrip.io.log_import.doubts import backwards
from tacstrip.io.log_import.ends import ends_exchanged, refuse_split_ends
from tacstrip.io.log_import.guess import Proposal, left_out, propose, settled
from tacstrip.io.log_import.mapping import ColumnMapping
from tacstrip.io.log_import.named_strips import in_ends_of_strips
from tacstrip.io.log_import.scans import scans
from tacstrip.io.log_import.table import Table
from tacstrip.io.log_import.write import at_rest, in_volts, rows, touched, write_log
from tacstrip.io.readings import read_unchecked
from tacstrip.sensor.left_out import left_out as left_out_of
from tacstrip.sensor.rest_level import all_read_hint, rest_hint
from tacstrip.sensor.spec import Sensor
from tacstrip.stream.replay import open_source

_NAME_A_SENSOR = (
    "name a SENSOR, for its strips, signatures and Vref tell what columns may be: tacstrip import {log} sensor.toml -o "
    "{output}"
)
_SHOWN_SCANS, _SHOWN_STRIPS = 2, 6


@click.command("import")
@click.argument("log", type=options.FILE)
@click.argument("spec", metavar="[SENSOR]", required=False)
@options.output("New file: readings (.csv) or a recording (.mcap).")
@options.file("--mapping", "given", metavar="MAP.toml",
              help="Read the log as an earlier one; else it is guessed, and written.")  # fmt: skip
@options.ANSWERS
@options.option("--sheet", help="Of a workbook with several.")
@options.FORCE
def command(
    log: Path,
    spec: str | None,
    output: Path,
    given: Path | None,
    answers: tuple[str, ...],
    sheet: str | None,
    force: bool,
) -> None:
    """Turn a LOG of your own form into readings: any separator, columns and units, spreadsheets, serial text.

    What each column is is guessed, with the reason, and the mapping written beside the output, to be used again. What
    the log does not tell is asked (exit code 1), and answered with --answer.

    Example: tacstrip import bench.txt sensor.toml -o readings.csv --answer time_unit=ms
    """
    kind = output.suffix.lower()
    if kind not in (".csv", ".mcap"):
        raise OptionError(f"-o {output}: " + one_of("ending", kind, (".csv", ".mcap")))
    if kind == ".mcap" and spec is None:
        raise OptionError(
            f"-o {output}: a recording holds its sensor; name the spec: tacstrip import {log} sensor.toml -o {output}"
        )
    if given and answers:
        raise OptionError("--mapping says everything; leave --answer out, or edit the mapping")
    beside = None if given else output.with_suffix(".mapping.toml")
    protect(output, log, spec, given, force=force)
    protect(beside, log, spec, force=True)  # for now: whether it would change shows later
    sensor = load_sensor(spec) if spec else None
    told = options.answered(answers)
    without = (
        "" if spec else _NAME_A_SENSOR.format(log=shlex.quote(str(log)), output=shlex.quote(str(output)))
    )
    with options.asked_of(log):  # a file that is empty or cut is so whatever sensor it is of
        table = read_table(log, sheet or told.get("sheet"))
    with options.asked_of(log, without):
        found = _mapped(table, given, sensor) if given else propose(table, sensor, told, _stated(spec))
        for reason in found.reasons:
            note(f"  {reason}")
    protect(beside, log, spec, force=force or _is_as_before(beside, found.mapping))
    warn(*found.doubts, _all_touched(found, sensor), file=log)
    _write(log, found, sensor, spec, output, force)
    _show(found, sensor)
    if beside is not None:
        found.mapping.save(beside)
        note(f"{beside}: how it was read; use it for logs of the same form with --mapping")


def _is_as_before(beside: Path | None, mapping: ColumnMapping) -> bool:
    """Return whether a mapping that is there already is the one that would be written."""
    try:
        return beside is not None and beside.exists() and ColumnMapping.load(beside) == mapping
    except (TacstripError, OSError):
        return False


def _stated(spec: str | None) -> frozenset[str] | None:
    """Return the keys that a spec's file states; None for one of the package's own."""
    return frozenset(tomllib.loads(read_text(spec))) if spec and Path(spec).is_file() else None


def _mapped(table: Table, file: Path, sensor: Sensor | None) -> Proposal:
    mapping = ColumnMapping.load(file)

    def read(found: Table) -> Proposal:
        told: tuple[str, ...] = ()
        if not {*mapping.columns} <= {*found.names}:
            found, _, told = in_ends_of_strips(found, mapping.strips)
        dropped: list[int] = []
        rough = scans(found, mapping, dropped)
        doubts = [
            *told,
            *left_out(found, dropped),
            *backwards(found, mapping),
            *ends_exchanged(rough, mapping, None),
        ]
        return Proposal(mapping, at_rest(rough, mapping, sensor), (), tuple(doubts))

    return settled(table, read, mapping.strips, len(mapping.channels))


def _write(
    log: Path, found: Proposal, sensor: Sensor | None, spec: str | None, output: Path, force: bool
) -> None:
    vref = sensor.vref_volt if sensor else found.mapping.vref_volt
    base = sensor.strip_base if sensor else found.mapping.strip_base
    if sensor and found.mapping.strips != sensor.strips:
        raise OptionError(f"the mapping is of {found.mapping.strips} strips, and {spec} has {sensor.strips}")
    many = f"{len(found.scans)} scan(s) of {found.mapping.strips} strips"
    with tempfile.TemporaryDirectory() as folder:
        readings = Path(folder) / f"{log.stem}.csv"
        try:
            write_log(readings, found.scans, found.mapping, vref, base)
        except OSError as error:
            raise OSError(error.errno, error.strerror, f"{tempfile.gettempdir()} (TMPDIR)") from error
        if sensor is not None and spec is not None:
            try:
                made = read_unchecked(readings, sensor)
                one_end = one_reading(output, sensor, made)
                if one_end:
                    out = sum(int(lost.sum()) for lost in left_out_of(sensor).values())
                    refuse_split_ends(found.scans, out)
                warn(half_read(output, sensor, made[0].signatures), one_end)
                warn_of_log(output, read_log(readings, sensor))
            except ReadingError as error:
                why = str(error).removeprefix(f"{readings}: ")
                raise ReadingError(
                    f"{log}: read as the reasons say, it gives no readings of {spec}: {why}"
                ) from None
            if one_end and output.suffix.lower() == ".mcap":
                raise ReadingError(
                    f"{output}: a recording holds codes, which cannot say that one reading of a strip is missing; save "
                    "as .csv, or leave the channel out (without = [...] in the spec)"
                )
        with replacing(output) as part:
            if output.suffix.lower() == ".mcap":
                assert sensor is not None
                assert spec is not None
                save_recording(
                    (spec, str(readings)), open_source(str(readings), sensor), output, force=force, part=part
                )
            else:
                part.write_bytes(readings.read_bytes())
    click.echo(f"{output}: {many}")


def _all_touched(found: Proposal, sensor: Sensor | None) -> str:
    """Return a warning where every strip has a reading in every scan, so that untouched ones may have some, too."""
    if sensor is None or found.mapping.strips != sensor.strips or not found.scans:
        return ""
    over_vref = in_volts(found.mapping, sensor.vref_volt, sensor.adc_bits) / sensor.vref_volt
    values = over_vref * np.stack([scan.values for scan in found.scans])
    raw = {channel: values[:, :, n] for n, channel in enumerate(found.mapping.channels)}
    return rest_hint(sensor, raw) or all_read_hint(sensor, raw)


def _show(found: Proposal, sensor: Sensor | None) -> None:
    """Show the first scans that something touches as a table, and the range of readings, on standard error."""
    strips = touched(found.scans, found.mapping, sensor)
    some = [n for n, there in enumerate(strips) if there.any()]
    shown = set(some[:_SHOWN_SCANS]) or {*range(min(_SHOWN_SCANS, len(found.scans)))}
    base = sensor.strip_base if sensor else found.mapping.strip_base  # as in the output
    note(
        "  scan  time_s  strip  "
        + "  ".join(f"{c:>8}" for c in found.mapping.channels)
        + f"   [{found.mapping.unit}]"
        + (f" (to be multiplied by {found.mapping.scale:g})" if found.mapping.scale != 1.0 else "")
        + ("   (strips are numbered as in the output)" if base != found.mapping.strip_base else "")
    )
    upto = rows(found.scans[: max(shown) + 1], base, timed=found.mapping.timed)
    for number, lines in itertools.groupby(upto, key=lambda row: row[0]):
        if int(number) not in shown:
            continue
        for n, row in enumerate(lines):
            if n < _SHOWN_STRIPS:
                readings = "  ".join(f"{v or '-':>8}" for v in row[3:])
                note(f"  {number:>4}  {row[1]:>6}  {row[2]:>5}  {readings}")
            elif n == _SHOWN_STRIPS:
                note("   ...")
    values = np.concatenate([s.values[there].ravel() for s, there in zip(found.scans, strips, strict=True)])
    values = values[np.isfinite(values)]
    told = ", ".join(f"{v:.6g}" for v in np.quantile(values, (0.0, 0.5, 1.0))) if len(values) else "none"
    note(
        f"  {len(some)} of {len(found.scans)} scans touched; readings (least, median, greatest): {told} "
        f"{found.mapping.unit}"
    )
