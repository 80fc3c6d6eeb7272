"""`tacstrip init`."""

from __future__ import annotations

from pathlib import Path

import click
from click.core import ParameterSource

from tacstrip.cli import protect, warn
from tacstrip.data import spec_names
from tacstrip.errors import SpecError
from tacstrip.io.input_checks import in_metres
from tacstrip.sensor.constructions import CONSTRUCTIONS
from tacstrip.sensor.constructions import construction as construction_named
from tacstrip.sensor.spec import Sensor

_GIVEN = ParameterSource.COMMANDLINE
# Where CRS-CRP reads well (docs/physics.md), for a spec that is still to be edited.
_SHEET_RATIO = 100.0
_LAMBDA = 0.01  # of the strip length
_LAYERS = ("resistivity_ratio", "contact_lambda_mm")


@click.command()
@click.argument("file", type=click.Path(path_type=Path), default="sensor.toml")
@click.option("--construction", default="crs-crs", show_default=True, help=", ".join(CONSTRUCTIONS) + ".")
@click.option("--strips", type=int, default=10, show_default=True, help="Number of strips.")
@click.option(
    "--pitch", "pitch_mm", type=float, default=6.5, show_default=True, help="Centre to centre [mm]."
)
@click.option(
    "--length", "length_mm", type=float, default=325.0, show_default=True, help="Strip length [mm]."
)
@click.option("--radius", "radius_mm", type=float, help="Radius of the tube [mm], for cyl-crs-m.")
@click.option(
    "--ratio", "resistivity_ratio", type=float, help="Resistivity of the second layer over the strips'."
)
@click.option(
    "--lambda", "contact_lambda_mm", type=float, help="Decay length of the contact resistance [mm]."
)
@click.option("--like", metavar="SPEC", help="Copy a shipped spec instead: " + ", ".join(spec_names()) + ".")
@click.option("--force", is_flag=True, help="Write over a file that exists.")
def command(
    file: Path,
    construction: str,
    strips: int,
    pitch_mm: float,
    length_mm: float,
    radius_mm: float | None,
    resistivity_ratio: float | None,
    contact_lambda_mm: float | None,
    like: str | None,
    force: bool,
) -> None:
    """Write a commented sensor spec to FILE (sensor.toml by default, - for the output), to edit by hand.

    Example: tacstrip init mysensor.toml --construction crs-m --strips 9 --pitch 4.5 --length 250
    """
    printed = str(file) == "-"
    protect(None if printed else file)
    if file.exists() and not force and not printed:
        raise SpecError(f"{file} exists already; choose another name, or write over it with --force")
    source = click.get_current_context().get_parameter_source
    shape = [
        n
        for n in ("construction", "strips", "pitch_mm", "length_mm", "radius_mm", *_LAYERS)
        if source(n) is _GIVEN
    ]
    if like is not None and shape:
        raise SpecError("--like copies a whole spec; leave the other options out and edit the file")
    if like is not None:
        sensor = Sensor.load(like)
    else:
        kind = construction_named(construction)
        needs_lambda = "contact_lambda_mm" in kind.required and contact_lambda_mm is None
        if resistivity_ratio is None:
            resistivity_ratio = 1.0 if kind.closed_form else _SHEET_RATIO
        sensor = Sensor(
            construction=construction,
            strips=strips,
            pitch_mm=pitch_mm,
            length_mm=length_mm,
            radius_mm=radius_mm,
            resistivity_ratio=resistivity_ratio,
            contact_lambda_mm=_LAMBDA * length_mm if needs_lambda else contact_lambda_mm or 0.0,
        )
        if needs_lambda:
            click.echo(
                f"contact_lambda_mm is set to {sensor.contact_lambda_mm:.4g}, a guess: put your rubber's there, it "
                "matters most (docs/physics.md)",
                err=True,
            )
    warn(in_metres(sensor))
    if printed:
        click.echo(sensor.to_toml(), nl=False)
        return
    sensor.save(file)
    click.echo(f"{file} written. Edit it, then: tacstrip simulate {file} CONTACT.wkt -o readings.csv")
