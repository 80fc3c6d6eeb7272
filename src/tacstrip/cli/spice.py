"""`tacstrip spice`."""

from __future__ import annotations

from pathlib import Path

import click

from tacstrip.cli import load_sensor, options, protect, warn
from tacstrip.errors import OptionError
from tacstrip.files import write_text
from tacstrip.io.geojson import read_contact
from tacstrip.io.input_checks import unlikely_contact
from tacstrip.network.crp.readings import contact_measurements
from tacstrip.network.imperfections import Readout
from tacstrip.network.spice import deck
from tacstrip.network.strips.measurements import measurements


@click.command()
@options.SENSOR
@options.CONTACT
@options.output("Netlist to write (.cir).")
@options.FORCE
@options.option("--cells", type=options.WholeRange(1), help="Cells over each piece of contact, by default 40 per "
                "lambda; CRS-CRP: rows of the sheet, by default 4.")  # fmt: skip
@options.number("--strip-ohm", default=10_000.0, help="A strip from end to end.")
@options.number("--mux-ohm", default=0.0, show_default=True, help="On-resistance of a switch.")
@options.number("--adc-ohm", default=float("inf"), help="Input resistance.")
@options.flag("--tied-grounds", help="CRS-M with all ground ends joined for good.")
def command(
    sensor: str,
    contact: Path,
    output: Path,
    force: bool,
    cells: int | None,
    tied_grounds: bool,
    **ohms: float,
) -> None:
    """Write SENSOR touched by CONTACT as a netlist for ngspice, a circuit of its own per touched strip.

    `ngspice -b deck.cir` prints vh_<strip> and vl_<strip>, or vout_<strip>, in volts. Every circuit of a CRS-CRP
    sensor has the whole sheet.

    Example: tacstrip spice prototype-crs-crs object.wkt -o deck.cir
    """
    protect(output, sensor, contact, force=force)
    spec = load_sensor(sensor)
    if tied_grounds and spec.kind.common_supply:
        raise OptionError(
            f"--tied-grounds is for strips that are switched in turn; a {spec.construction} sensor's never are"
        )
    unlike = f"is not for a {spec.construction} sensor"
    options.belong(spec.kind.closed_form, unlike, "mux_ohm", "adc_ohm", "tied_grounds", "strip_ohm")
    shape = read_contact(contact)
    if spec.kind.closed_form:
        asked = measurements(spec, shape, readout=Readout(**ohms, tied_grounds=tied_grounds), cells=cells)
    else:
        asked = contact_measurements(spec, shape, cells)
    named = {str(strip + spec.strip_base): measurement for strip, measurement in asked.items()}
    title = f"{spec.construction}, {spec.strips} strips, {contact.name}, written by tacstrip"
    write_text(output, deck(title, named, spec.vref_volt))
    click.echo(f"{output}: {len(named)} touched strip(s). Run it with: ngspice -b {output}")
    warn("" if named else "no strip is touched: there is nothing to print", unlikely_contact(shape, spec))
