"""`tacstrip init`."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from tacstrip.cli import note, options, protect, warn
from tacstrip.data import spec_names
from tacstrip.errors import ReadingError, SpecError
from tacstrip.files import write_text
from tacstrip.io.input_checks import unlikely_lengths
from tacstrip.sensor.constructions import CONSTRUCTIONS, SIGNATURES
from tacstrip.sensor.constructions import construction as construction_named
from tacstrip.sensor.spec import UNKNOWN, Sensor
from tacstrip.surface.skin import skin_of

if TYPE_CHECKING:
    from tacstrip.io.log_import.questions import Question

# Where CRS-CRP reads well (docs/science/physics.md), for a spec that is still to be edited.
_WITHOUT_LOG = (
    "else write the spec by options (tacstrip init --help), and read the log by it: tacstrip import {log} sensor.toml "
    "-o readings.csv"
)
_SHEET_RATIO = 100.0
_LAMBDA = 0.01  # of the strip length
_BITS = (8, 10, 12, 14, 16, 24)  # that converters have


@click.command()
@click.argument("file", type=options.FILE, default="sensor.toml")
@options.option("--construction", default="crs-crs", help=", ".join(CONSTRUCTIONS) + ".")
@options.whole("--strips", default=10, help="Number of strips.")
@options.number("--pitch", "pitch_mm", default=6.5, help="Strip to strip [mm].")
@options.number("--length", "length_mm", default=325.0, help="Of a strip [mm].")
@options.number("--radius", "radius_mm", help="Radius of the tube [mm], for cyl-crs-m.")
@options.number("--ratio", "resistivity_ratio", help="Resistivity of the second layer over the strips'.")
@options.number("--lambda", "contact_lambda_mm", help="Decay length of the contact resistance [mm].")
@options.number("--vref", "vref_volt", help="Reference voltage [V].")
@options.whole("--bits", "adc_bits", help="Resolution of the A/D converter.")
@options.option("--like", metavar="SPEC",
                help="Copy a shipped spec instead: " + ", ".join(spec_names()) + ".")  # fmt: skip
@options.file("--from", "log", metavar="LOG",
              help="Begin with what a log of any form says; what it does not is '?', to be filled in.")  # fmt: skip
@options.ANSWERS
@options.FORCE
def command(
    file: Path, like: str | None, log: Path | None, answers: tuple[str, ...], force: bool, **keys: Any
) -> None:
    """Write a commented sensor spec to FILE (sensor.toml by default, - for the output), to edit by hand.

    Example: tacstrip init mysensor.toml --construction crs-m --strips 9 --pitch 4.5 --length 250
    """
    printed = str(file) == "-"
    protect(None if printed else file, log, force=force)
    if like is not None and options.given("log", *keys):
        raise SpecError("--like copies a whole spec; leave the other options out and edit the file")
    options.belong(log, "answers questions of a log; name it with --from", "answers")
    then = f"simulate {file} CONTACT.wkt"
    if log is not None:
        told = "".join(f" --answer {shlex.quote(answer)}" for answer in answers)
        then = f"import {shlex.quote(str(log))} {shlex.quote(str(file))}{told}"
        text, unknown, asked = _begun(log, answers, keys)
    else:
        sensor = _made(keys) if like is None else Sensor.load(like)
        warn(unlikely_lengths(sensor))
        text, unknown, asked = sensor.to_toml(), [], ()
        curved = isinstance(sensor, Sensor) and sensor.surface is not None
        then = f"press {file} {_first_press(sensor)}" if curved else then
    if printed:
        click.echo(text, nl=False)
        return
    write_text(file, text)
    call = f"tacstrip {then} -o readings.csv"
    if unknown:
        click.echo(f"{file} begun. Fill in what stands as {UNKNOWN!r}: {', '.join(unknown)}; then: {call}")
    else:
        click.echo(f"{file} written. Edit it, then: {call}")
    for question in asked:
        click.echo(f"The log does not say, so add to that command: {question}")


def _first_press(sensor: Sensor) -> str:
    """Return a press into the middle of a curved skin, as `press` takes it."""
    skin, strip = skin_of(sensor), sensor.strips // 2
    place = skin.places(np.array(float(strip)), np.array(0.5 * skin.lengths_mm[strip]))
    pose = " ".join(f"{v:.3g}" for v in (*skin.points(*place), *(0.0 - skin.normals(*place))))
    return f"plane --pose {pose} --depth {0.4 * skin.thickness_mm:.2g}"


def _made(keys: dict[str, Any]) -> Sensor:
    """Return the sensor of the options; what its construction needs and is not given is guessed, and said."""
    kind = construction_named(keys["construction"])
    guessed = "contact_lambda_mm" in kind.required and keys["contact_lambda_mm"] is None
    wanted: dict[str, Any] = {
        "resistivity_ratio": 1.0 if kind.closed_form else _SHEET_RATIO,
        "contact_lambda_mm": _LAMBDA * keys["length_mm"] if guessed else 0.0,
    }
    sensor = Sensor(**wanted | {key: value for key, value in keys.items() if value is not None})
    if guessed:
        note(
            f"contact_lambda_mm is set to {sensor.contact_lambda_mm:.4g}, a guess: put your rubber's there, it "
            "matters most (docs/science/physics.md)"
        )
    return sensor


def _begun(
    log: Path, answers: tuple[str, ...], keys: dict[str, Any]
) -> tuple[str, list[str], tuple[Question, ...]]:
    """Return a spec begun from a log and options, the keys still unknown, and what else `import` will ask."""
    # Late: only this option needs them.
    from tacstrip.io.log_import.containers import read_table
    from tacstrip.io.log_import.facts import sensor_facts
    from tacstrip.io.log_import.guess import propose
    from tacstrip.io.log_import.questions import Unanswered

    told = options.answered(answers)
    with options.asked_of(log):
        table = read_table(log, told.get("sheet"))
    with options.asked_of(log, _WITHOUT_LOG.format(log=shlex.quote(str(log)))):
        facts = sensor_facts(table, told)
    names = {key for key in keys if options.given(key)}
    kinds = [
        kind.name
        for kind in CONSTRUCTIONS.values()
        if {SIGNATURES[s].volt_column for s in kind.signatures} == {f"v_{c}" for c in facts.channels}
    ]
    fits = [bits for bits in _BITS if facts.largest <= 2**bits - 1] or [32]
    codes = facts.unit == "code" or (not facts.unit and facts.whole)
    hints = {
        "construction": f"one of: {', '.join(kinds)}, with {len(facts.channels)} reading(s) of a strip",
        "strips": f"number of strips; the log names {facts.strip_base} to {facts.highest}",
        "pitch_mm": "from centre line to centre line", "length_mm": "strip length L",
        "vref_volt": "reference voltage" + (f"; readings reach {facts.largest:.4g} V" if facts.unit == "V" else ""),
        "adc_bits": f"resolution of the A/D converter: codes reach {facts.largest:g}, so {fits[0]} or more",
    }  # fmt: skip
    known = {"strip_base": facts.strip_base} | {key: keys[key] for key in names}
    if facts.strips is not None:
        known.setdefault("strips", facts.strips)
    unknown = [key for key in hints if key not in known and (key != "adc_bits" or codes)]
    chosen = known.get("construction", kinds[0])
    # A sensor that could be, whose keys are then marked as unknown.
    filled = {"construction": chosen, "strips": 10, "pitch_mm": 6.5, "length_mm": 325.0} | known
    sensor = _made({"contact_lambda_mm": None, "resistivity_ratio": None} | filled)
    if len(facts.channels) != len(sensor.signatures):
        raise SpecError(
            f"{log} has {len(facts.channels)} reading(s) of a strip, and {chosen} {len(sensor.signatures)}"
        )
    text = sensor.to_toml(strip_base=True)  # as the log counts
    for key in unknown:
        line = f'{key} = "{UNKNOWN}"'
        text = re.sub(
            rf"(?m)^(?:# )?{key} = .*$", f"{line:<32} # TO BE FILLED IN: {hints[key]}", text, count=1
        )
    for reason in facts.reasons:
        note(f"  {reason}")
    asked: tuple[Question, ...] = ()
    if not unknown:
        try:
            propose(table, sensor, told, frozenset(known))
        except Unanswered as open_:
            asked = tuple(open_.questions)
        except ReadingError:
            pass  # import says what is wrong
    return text, unknown, asked
