"""`tacstrip init`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from tacstrip.cli import note, options, protect, warn
from tacstrip.data import spec_names
from tacstrip.errors import SpecError
from tacstrip.io.input_checks import unlikely_lengths
from tacstrip.sensor.constructions import CONSTRUCTIONS
from tacstrip.sensor.constructions import construction as construction_named
from tacstrip.sensor.spec import Sensor

# Where CRS-CRP reads well (docs/science/physics.md), for a spec that is still to be edited.
_SHEET_RATIO = 100.0
_LAMBDA = 0.01  # of the strip length


@click.command()
@click.argument("file", type=options.FILE, default="sensor.toml")
@click.option("--construction", default="crs-crs", show_default=True, help=", ".join(CONSTRUCTIONS) + ".")
@click.option("--strips", type=options.WHOLE, default=10, show_default=True, help="Number of strips.")
@click.option(
    "--pitch", "pitch_mm", type=options.NUMBER, default=6.5, show_default=True, help="Strip to strip [mm]."
)
@click.option(
    "--length", "length_mm", type=options.NUMBER, default=325.0, show_default=True, help="Of a strip [mm]."
)
@click.option("--radius", "radius_mm", type=options.NUMBER, help="Radius of the tube [mm], for cyl-crs-m.")
@click.option("--ratio", "resistivity_ratio", type=options.NUMBER,
              help="Resistivity of the second layer over the strips'.")  # fmt: skip
@click.option("--lambda", "contact_lambda_mm", type=options.NUMBER,
              help="Decay length of the contact resistance [mm].")  # fmt: skip
@click.option("--like", metavar="SPEC", help="Copy a shipped spec instead: " + ", ".join(spec_names()) + ".")
@options.FORCE
def command(file: Path, like: str | None, force: bool, **keys: Any) -> None:
    """Write a commented sensor spec to FILE (sensor.toml by default, - for the output), to edit by hand.

    Example: tacstrip init mysensor.toml --construction crs-m --strips 9 --pitch 4.5 --length 250
    """
    printed = str(file) == "-"
    protect(None if printed else file)
    if file.exists() and not force and not printed:
        raise SpecError(f"{file} exists already; choose another name, or write over it with --force")
    if like is not None and options.given(*keys):
        raise SpecError("--like copies a whole spec; leave the other options out and edit the file")
    sensor = _made(keys) if like is None else Sensor.load(like)
    warn(unlikely_lengths(sensor))
    if printed:
        click.echo(sensor.to_toml(), nl=False)
        return
    sensor.save(file)
    click.echo(f"{file} written. Edit it, then: tacstrip simulate {file} CONTACT.wkt -o readings.csv")


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
