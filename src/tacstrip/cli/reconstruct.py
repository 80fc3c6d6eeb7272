"""`tacstrip reconstruct`."""

from __future__ import annotations

import json
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import click
import numpy as np
from click.core import ParameterSource

from tacstrip.cli import check_method, load_sensor, protect, warn
from tacstrip.contact.noise import Noise
from tacstrip.contact.shape import Contact
from tacstrip.errors import OptionError, ReadingError, number
from tacstrip.geometry.metrics import mismatch
from tacstrip.io.geometry import feature_collection, read_contact, write_geojson
from tacstrip.io.input_checks import exchanged, half_read, largest, over_vref
from tacstrip.io.readings import read_readings
from tacstrip.reconstruction.methods import chosen_method, reconstruct
from tacstrip.reconstruction.result import Reconstruction
from tacstrip.scan import Scan
from tacstrip.sensor.raw import invert_calibration
from tacstrip.sensor.rest_level import rest_hint
from tacstrip.sensor.spec import Sensor

_MOST_LINES = 20


@click.command()
@click.argument("sensor", metavar="SENSOR")
@click.argument("readings", metavar="READINGS", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), help="GeoJSON file; printed if left out.")
@click.option("--method", help="polygon (all strips, the default), vertex or profile (the thesis').")
@click.option("--signature", help="Use one only, for polygon or vertex: kh, kl or k.")
@click.option("--quantisation", type=float, help="C.Q.E. of the readings if known, half-width over Vref.")
@click.option("--positional", type=float, help="P.U. of the readings if known, half-width over Vref.")
@click.option(
    "--distribution", default="uniform", show_default=True, help="Of these errors: uniform or normal."
)
@click.option(
    "--average", type=click.IntRange(1), default=1, metavar="N", help="Reconstruct means of every N scans."
)
@click.option("--vertices", type=int, help="Of each contact, for polygon, where that is known; else found.")
@click.option(
    "--wide", is_flag=True, help="For polygon: strips as wide as the spec says, as in measured readings."
)
@click.option("--transitions", default="auto", show_default=True, metavar="RULE|X,X,..",
              help="For vertex: auto, gradient, or the x of all vertices [mm].")  # fmt: skip
@click.option("--convex", is_flag=True, help="For profile of CRS-CRP: every contact is convex.")
@click.option("--reading", default="section", show_default=True, help="For vertex: section or strip.")
@click.option(
    "--truth",
    type=click.Path(path_type=Path),
    help="What touched (.wkt, .geojson): prints the mismatch, against the nearest polygon.",
)
@click.option("--plot", type=click.Path(path_type=Path), help="Picture to write (.png, .svg, .pdf).")
def command(
    sensor: str,
    readings: Path,
    output: Path | None,
    method: str | None,
    signature: str | None,
    quantisation: float | None,
    positional: float | None,
    distribution: str,
    average: int,
    vertices: int | None,
    wide: bool,
    transitions: str,
    convex: bool,
    reading: str,
    truth: Path | None,
    plot: Path | None,
) -> None:
    """Recover the shapes that touched SENSOR (a spec file or a shipped spec) from READINGS (CSV).

    Writes GeoJSON in mm, a Feature per object, with its status. Exit code 1: no shape could be recovered.

    Example: tacstrip reconstruct sensor.toml readings.csv -o shapes.geojson --plot shapes.png
    """
    protect(output, sensor, readings, truth)
    protect(plot, sensor, readings, truth, output)
    if plot is not None:
        from tacstrip.plot.style import check_picture

        check_picture(plot)
    spec = load_sensor(sensor)
    scans = read_readings(readings, spec)
    if not any(s.touched.any() for s in scans):
        raise ReadingError(
            f"{readings}: no strip is touched in any of {len(scans)} scan(s): every reading is empty, or within "
            "touch_volt of rest_volt. Check the wiring and the spec"
        )
    if average > len(scans):
        raise OptionError(f"--average {average}: {readings} has {len(scans)} scan(s)")
    if average > 1:
        scans = [Scan.mean(scans[i : i + average]) for i in range(0, len(scans) - average + 1, average)]
    given = click.get_current_context().get_parameter_source
    for_vertex = [o for o in ("transitions", "reading") if given(o) is ParameterSource.COMMANDLINE]
    chosen = chosen_method(method or ("vertex" if for_vertex else None), spec)
    if chosen != "vertex" and for_vertex:
        raise OptionError(f"--{for_vertex[0]} is for --method vertex; leave it out for {chosen}")
    check_method("--method", chosen, spec, scans[0].signatures)
    if chosen == "profile" and signature is not None:
        raise OptionError(
            "--signature is for --method polygon or vertex; leave it out: profile needs both k_h and k_l"
        )
    if vertices is not None and chosen != "polygon":
        raise OptionError(f"--vertices is for --method polygon; leave it out for {chosen}")
    if wide and chosen != "polygon":
        raise OptionError(f"--wide is for --method polygon; leave it out for {chosen}")
    if convex and chosen != "profile":
        raise OptionError("--convex is for --method profile; leave it out")
    halves = {"quantisation": quantisation or 0.0, "positional": positional or 0.0}
    noise = Noise(**halves, distribution=distribution)  # type: ignore[arg-type]
    known = noise if (quantisation, positional) != (None, None) else None
    where = _transitions(transitions)
    swapped = exchanged(scans, known)
    stacked = {name: np.stack([s[name] for s in scans]) for name in scans[0].signatures}
    unset = rest_hint(spec, invert_calibration(spec, stacked))
    warn(
        half_read(readings, spec, scans[0].signatures) if signature is None else "",
        over_vref(readings, spec, largest(scans)),
        f"{readings}: {unset}" if unset else "",
        f"{swapped} (`tacstrip doctor {readings} --sensor {sensor}` says more)" if swapped else "",
    )
    by_method: dict[str, dict[str, Any]] = {
        "polygon": {"vertices": vertices, "wide": wide},
        "vertex": {"signature": signature, "transitions": where, "reading": reading},
        "profile": {"convex": convex},
    }
    used = scans if chosen != "polygon" or signature is None else [_only(scan, signature) for scan in scans]
    results = [reconstruct(scan, spec, known, method=chosen, **by_method[chosen]) for scan in used]
    contact = read_contact(truth) if truth else None
    if contact is not None and not _polygons(contact):
        raise OptionError(
            f"--truth {truth}: holds no polygon to compare with; a line or a point has no outline"
        )
    _report(results, contact)
    if output is None:
        click.echo(json.dumps(feature_collection(results), indent=1))
    else:
        write_geojson(output, results)
        click.echo(f"{output} written", err=True)
    if plot is not None:
        _plot(spec, scans, results, chosen, contact, plot)
    if not any(o.found for r in results for o in r.objects):
        sys.exit(1)


def _only(scan: Scan, signature: str) -> Scan:
    """Leave the scan's other signatures out."""
    return Scan(
        **{signature: scan[signature]}, time_s=scan.time_s, averaged=scan.averaged, span_s=scan.span_s
    )


def _transitions(text: str) -> str | list[float]:
    if text.isalpha():
        return text
    try:
        return [number(part) for part in text.split(",")]
    except ValueError:
        raise OptionError(
            f"--transitions {text}: give auto, gradient, or numbers such as 12,20.5,31"
        ) from None


def _report(results: list[Reconstruction], truth: Contact | None) -> None:
    """Say on standard error what was found: scan by scan, or counted where there are many."""
    lines = [
        _line(number, result, k, truth)
        for number, result in enumerate(results)
        for k in range(len(result.objects))
    ]
    for line in lines[:_MOST_LINES]:
        click.echo(line, err=True)
    if len(lines) > _MOST_LINES:
        click.echo(f"... and {len(lines) - _MOST_LINES} objects more", err=True)
    counts = Counter(o.status for r in results for o in r.objects)
    counts["no contact"] = sum(not r.objects for r in results)
    told = ", ".join(f"{status}: {count}" for status, count in counts.most_common() if count)
    click.echo(f"{len(results)} scan(s), {len(lines)} object(s); {told}", err=True)


def _line(number: int, result: Reconstruction, at: int, truth: Contact | None) -> str:
    """Say what was found of one object; several are numbered from 1, left to right, as in the picture."""
    found = result.objects[at]
    which = f" {at + 1}" if len(result.objects) > 1 else ""
    text = f"scan {number}, {result.method}{which}: {found.status}"
    if found.found:
        x, y = found.centroid
        text += f", {len(found.vertices)} corners, {found.area:.6g} mm2 at x = {x:.5g}, y = {y:.5g} mm"
    text += f". {found.advice}" if found.advice else ""
    if truth is None or not found.found:
        return text
    near = min(_polygons(truth), key=lambda c: float(np.hypot(*(c.centroid - found.centroid))))
    m = mismatch(near.vertices, found.vertices)
    numbers = f"M.C. {m.mc:.4g} rad, A.O.E. {m.aoe:.4g} rad, A.P.E. {m.ape:.4g} mm, IoU {m.iou:.3f}"
    return f"{text}\n    against the truth: {numbers}"


def _polygons(truth: Contact) -> list[Contact]:
    """Return the polygons of a contact, each on its own."""
    return [Contact((shape,)) for shape in truth.shapes if shape.area > 0.0]


def _plot(
    spec: Sensor,
    scans: list[Scan],
    results: list[Reconstruction],
    method: str,
    truth: Contact | None,
    path: Path,
) -> None:
    from tacstrip.plot.result import reconstruction_figure
    from tacstrip.plot.style import save

    figure = reconstruction_figure(spec, scans, {method: results}, [truth] if truth else [])
    click.echo(f"{save(figure, path)} written", err=True)
