"""`tacstrip init`."""

from __future__ import annotations

from pathlib import Path

import click
from click.core import ParameterSource

from tacstrip.data import spec_names
from tacstrip.errors import SpecError
from tacstrip.sensor.constructions import CONSTRUCTIONS
from tacstrip.sensor.spec import Sensor

_GIVEN = ParameterSource.COMMANDLINE


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
@click.option("--like", metavar="SPEC", help="Copy a shipped spec instead: " + ", ".join(spec_names()) + ".")
@click.option("--force", is_flag=True, help="Write over a file that exists.")
def command(
    file: Path,
    construction: str,
    strips: int,
    pitch_mm: float,
    length_mm: float,
    radius_mm: float | None,
    like: str | None,
    force: bool,
) -> None:
    """Write a commented sensor spec to FILE (sensor.toml by default), to edit by hand.

    Example: tacstrip init mysensor.toml --construction crs-m --strips 9 --pitch 4.5 --length 250
    """
    if file.exists() and not force:
        raise SpecError(f"{file} exists already; choose another name, or write over it with --force")
    source = click.get_current_context().get_parameter_source
    shape = [
        n for n in ("construction", "strips", "pitch_mm", "length_mm", "radius_mm") if source(n) is _GIVEN
    ]
    if like is not None and shape:
        raise SpecError("--like copies a whole spec; leave the other options out and edit the file")
    if like is not None:
        sensor = Sensor.load(like)
    else:
        sensor = Sensor(
            construction=construction,
            strips=strips,
            pitch_mm=pitch_mm,
            length_mm=length_mm,
            radius_mm=radius_mm,
        )
    sensor.save(file)
    click.echo(f"{file} written. Edit it, then: tacstrip simulate {file} CONTACT.wkt -o readings.csv")
