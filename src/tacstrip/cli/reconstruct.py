"""`tacstrip reconstruct`."""

from __future__ import annotations

import json
import math
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np

from tacstrip.cli import check_method, load_layers, note, options, protect, save_picture, warn, warn_of_order
from tacstrip.cli.progress import followed
from tacstrip.contact.noise import Noise
from tacstrip.contact.shape import Contact
from tacstrip.diagnose.log import Log
from tacstrip.errors import OptionError, ReadingError, number, one_of
from tacstrip.io.geojson import feature_collection, read_contact, write_geojson
from tacstrip.io.input_checks import readings_suspicions, unlikely_contact
from tacstrip.io.readings import read_unchecked
from tacstrip.io.table import nearest_mismatch, object_records, write_table
from tacstrip.reconstruction.implausible import doubt_scale, doubt_strips
from tacstrip.reconstruction.known_object.fit import fit_object
from tacstrip.reconstruction.methods import chosen_method, reconstruct
from tacstrip.reconstruction.result import Reconstruction
from tacstrip.scan import Scan
from tacstrip.sensor.layers import AnySensor, LayeredSensor, unit_of
from tacstrip.sensor.left_out import left_out_wholly
from tacstrip.sensor.spec import Sensor

_MOST_LINES, _MOST_WEIGHTS = 20, 6
_LAMBDA_MM, _LONG = 2.0, 20.0  # of rubber that nobody measured; times as long, its two ends are a tenth
_ENDINGS = (".geojson", ".json", ".csv")
_NOISELESS = ("vertex", "profile")  # methods that take no account of noise
_OF_METHODS = {  # option: the methods that have it
    "signature": ("polygon", "vertex"),
    "vertices": ("polygon",),
    "assessment": ("polygon",),
    "area_mm2": ("polygon",),
    "one_object": ("polygon",),
    "transitions": ("vertex",),
    "reading": ("vertex",),
    "convex": ("profile",),
}


@click.command()
@options.SENSOR
@click.argument("readings", metavar="READINGS", type=options.FILE)
@options.output(
    "GeoJSON file, or a table (.csv: a row per object and scan); GeoJSON is printed if left out.",
    required=False,
)
@options.FORCE
@options.option("--method", help="polygon (all strips, the default), vertex or profile (the thesis'), or pieces: "
                "several objects on the same strips.")  # fmt: skip
@options.option("--signature", help="Use one only, for polygon or vertex: kh, kl or k.")
@options.noise
@options.WITHOUT
@options.option("--average", type=options.WholeRange(1), default=1, metavar="N", show_default=False,
                help="Reconstruct means of every N scans.")  # fmt: skip
@options.whole("--vertices", help="Of each contact, for polygon, where that is known; else found.")
@options.option("--assessment", default="thorough",
                help="For polygon, of how sure a shape is: thorough, fast or none.")  # fmt: skip
@options.option("--area", "area_mm2", metavar="MM2[,SIGMA]",
                help="For polygon: area of each contact if known, to 20 % or SIGMA [mm2].")  # fmt: skip
@options.flag(
    "--one-object", help="For polygon: no two objects touch the same strips, whatever may read alike."
)
@options.file("--object", "known_object",
              help="A known rigid object's outline (.wkt, .geojson): its pose is fitted.")  # fmt: skip
@options.option("--transitions", default="auto", metavar="RULE|X,X,..",
                help="For vertex: auto, gradient, or the x of all vertices [mm].")  # fmt: skip
@options.flag("--convex", help="For profile of CRS-CRP: every contact is convex.")
@options.option("--reading", default="section", help="For vertex: section or strip.")
@options.file("--truth",
              help="What touched (.wkt, .geojson): prints the mismatch, against the nearest polygon.")  # fmt: skip
@options.plot()
def command(
    sensor: str,
    readings: Path,
    output: Path | None,
    force: bool,
    method: str | None,
    noise: Noise,
    without: tuple[str, ...],
    known_object: Path | None,
    average: int,
    truth: Path | None,
    plot: Path | None,
    **given: Any,
) -> None:
    """Recover the shapes that touched SENSOR (a spec file or a shipped spec) from READINGS (CSV).

    Writes GeoJSON in mm, a Feature per object, with its status, or a table. Exit code 1: no shape could be recovered.

    Example: tacstrip reconstruct sensor.toml readings.csv -o shapes.geojson --plot shapes.png
    """
    # A device or a pipe has no ending.
    if output and (output.is_file() or not output.exists()) and output.suffix.lower() not in _ENDINGS:
        raise OptionError(f"-o {output}: " + one_of("ending", output.suffix.lower(), _ENDINGS))
    options.belong(output, "is for a file: -o FILE", "force")
    protect(output, sensor, readings, truth, known_object, force=force)
    protect(plot, sensor, readings, truth, known_object, output)
    why = "is not for a known object; leave it or --object out"
    options.belong(known_object is None, why, "method", *(o for o in _OF_METHODS if o != "signature"))
    spec = load_layers(sensor, without)
    unit, layered = unit_of(spec), isinstance(spec, LayeredSensor)
    only = (name for name in _OF_METHODS if name != "assessment")
    options.belong(not layered, "is for a sensor of one layer", "known_object", *only)
    scans = _means(_touched(readings, spec), average, readings)
    chosen = _method(method, unit, scans[0])
    given["transitions"] = _transitions(given["transitions"])
    given["area_mm2"] = None if given["area_mm2"] is None else _area(given["area_mm2"])
    known = noise if options.given("quantisation", "positional") else None
    warn(*readings_suspicions(readings, spec, scans, one_signature=given["signature"] is not None))
    astray = warn_of_order(readings, Log.of_scans(spec, scans)) if isinstance(spec, Sensor) else ((), "")
    own = {name: given[name] for name, methods in _OF_METHODS.items() if chosen in methods}
    if layered:
        own = {"assessment": given["assessment"], "signature": None}
    signature = own.pop("signature") if chosen == "polygon" else None
    used = [_only(scan, signature) for scan in scans] if signature else scans
    if known_object is not None:
        outline, chosen = read_contact(known_object), "object"
        results = [fit_object(scan, unit, outline, known) for scan in followed(used, "scans")]
    else:
        results = [reconstruct(scan, spec, known, method=chosen, **own) for scan in followed(used, "scans")]
    if not layered:
        results = doubt_strips(doubt_scale(results, used, unit), *astray, unit)
    contact = _truth(truth, unit) if truth else None
    source = "" if chosen in _NOISELESS else options.noise_source(known, unit)
    around_mm = unit.width_mm if unit.closed else None
    _report(results, contact, around_mm, source)
    if not layered and known_object is None:
        _note_what_is_not_seen(results, unit)
    if output is not None:
        _write(output, results, contact, around_mm)
    if plot is not None:
        truths = [contact] if contact else []
        note(f"{save_picture(plot, spec, scans, {chosen: results}, truths)} written")
    if output is None:  # last: whoever reads it may stop
        click.echo(json.dumps(feature_collection(results), indent=1))
    if not any(o.found for r in results for o in r.objects):
        sys.exit(1)


def _method(given: str | None, sensor: Sensor, scan: Scan) -> str:
    """Return the method that was asked for, by name or by its options, once nothing speaks against it."""
    chosen = chosen_method(given or ("vertex" if options.given("transitions", "reading") else None), sensor)
    check_method("--method", chosen, sensor, scan.signatures)
    for name, methods in _OF_METHODS.items():
        why = f"is for --method {' or '.join(methods)}; leave it out for {chosen}"
        options.belong(chosen in methods, why, name)
    return chosen


def _touched(readings: Path, spec: AnySensor) -> list[Scan]:
    """Return a file's scans, in some of which anything touches."""
    scans = read_unchecked(readings, spec)
    if not any(s.touched.any() for s in scans):
        raise ReadingError(
            f"{readings}: no strip is touched in any of {len(scans)} scan(s): every reading is empty, or within "
            "touch_volt of rest_volt. Check the wiring and the spec"
        )
    return scans


def _means(scans: list[Scan], average: int, readings: Path) -> list[Scan]:
    """Return means of every `average` scans."""
    if average > len(scans):
        raise OptionError(f"--average {average}: {readings} has {len(scans)} scan(s)")
    if over := len(scans) % average:
        warn(
            f"--average {average}: the last {over} of {len(scans)} scans are too few for a mean, and left out"
        )
    if average == 1:
        return scans
    return [Scan.mean(scans[i : i + average]) for i in range(0, len(scans) - average + 1, average)]


def _truth(path: Path, sensor: Sensor) -> Contact:
    """Return what touched, with a warning where that is unlikely."""
    contact = read_contact(path)
    if not any(shape.area > 0.0 for shape in contact.shapes):
        raise OptionError(
            f"--truth {path}: holds no polygon to compare with; a line or a point has no outline"
        )
    warn(unlikely_contact(contact, sensor), file=path)
    return contact


def _write(
    output: Path, results: list[Reconstruction], truth: Contact | None, around_mm: float | None
) -> None:
    if output.suffix.lower() == ".csv":
        write_table(output, object_records(results, truth, around_mm=around_mm))
    else:
        write_geojson(output, results)
    note(f"{output} written")


def _note_what_is_not_seen(results: list[Reconstruction], sensor: Sensor) -> None:
    """Say which objects may reach beyond the sensor, or be longer than they read."""
    if over_edge := _at_the_border(results, sensor):
        note(
            f"{over_edge} object(s) reach the sensor's outermost strips: they may hang over its edge, and area and "
            "outline are of what lies on the sensor"
        )
    if shorter := _shortened(results, sensor):
        note(shorter)


def _area(text: str) -> float | tuple[float, float]:
    try:
        mean, *sigma = [number(part) for part in text.split(",", 1)]
    except ValueError:
        raise OptionError(
            f"--area {text}: give the area in mm2, or area and standard deviation: 900,50"
        ) from None
    return (mean, sigma[0]) if sigma else mean


def _only(scan: Scan, signature: str) -> Scan:
    """Leave the scan's other signatures out."""
    scan[signature]  # which names those that there are
    others: dict[str, Any] = dict.fromkeys(name for name in scan.signatures if name != signature)
    return replace(scan, **others)


def _transitions(text: str) -> str | list[float]:
    if text.isalpha():
        return text
    try:
        return [number(part) for part in text.split(",")]
    except ValueError:
        raise OptionError(
            f"--transitions {text}: give auto, gradient, or numbers such as 12,20.5,31"
        ) from None


def _report(
    results: list[Reconstruction], truth: Contact | None, around_mm: float | None, noise: str
) -> None:
    """Say on standard error what was found, scan by scan or counted where there are many, and with which noise."""
    lines = [
        _line(number, result, k, truth, around_mm)
        for number, result in enumerate(results)
        for k in range(len(result.objects))
    ]
    for line in lines[:_MOST_LINES]:
        note(line)
    if len(lines) > _MOST_LINES:
        note(f"... and {len(lines) - _MOST_LINES} objects more")
    counts = Counter(o.status for r in results for o in r.objects)
    counts["no contact"] = sum(not r.objects for r in results)
    by_status = ", ".join(f"{status}: {count}" for status, count in counts.most_common() if count)
    of_noise = f"; noise: {noise}" if noise else ""
    note(f"{len(results)} scan(s), {len(lines)} object(s); {by_status}{of_noise}")


def _at_the_border(results: list[Reconstruction], sensor: Sensor) -> int:
    """Return how many objects reach the outermost strips that are not left out; none where the strips close a ring."""
    read = np.flatnonzero(~left_out_wholly(sensor))
    if sensor.closed or not len(read):
        return 0
    strips = (o.strips for r in results for o in r.objects if o.found)
    return sum(s.start <= read[0] or s.stop > read[-1] for s in strips)


def _shortened(results: list[Reconstruction], sensor: Sensor) -> str:
    """Say what contact resistance takes off both ends, where it matters and the spec says nothing of it; else ""."""
    if sensor.contact_lambda_mm > 0.0 or sensor.calibration is not None:
        return ""
    profiles = (o.profile for r in results for o in r.objects if o.found and o.profile is not None)
    least_mm = min((float(np.nanmedian(u - l)) for _, l, u in profiles), default=math.inf)
    if least_mm > _LONG * _LAMBDA_MM:
        return ""
    return (
        "contact_lambda_mm is 0 (ideal contact) and nothing is calibrated: contact resistance takes its decay length "
        f"off both ends of a contact, and readings do not show it; with {_LAMBDA_MM:g} mm the smallest object here, "
        f"{least_mm:.3g} mm along the strips, is {2.0 * _LAMBDA_MM:g} mm longer (`tacstrip calibrate`)"
    )


def _line(
    number: int, result: Reconstruction, at: int, truth: Contact | None, around_mm: float | None
) -> str:
    """Say what was found of one object; several are numbered from 1, left to right, as in the picture."""
    found = result.objects[at]
    which = f" {at + 1}" if len(result.objects) > 1 else ""
    text = f"scan {number}, {result.method}{which}: {found.status}"
    if found.found:
        x, y = found.centroid
        text += "" if found.pose is None else f", turned by {np.rad2deg(found.pose.angle):.4g} deg"
        text += f", {found.outlined}, {found.area:.6g} mm2 at x = {x:.5g}, y = {y:.5g} mm"
        text += "" if found.confidence is None else f", confidence {found.confidence:.2f}"
        weights = [f"{a.weight:.2f}" for a in found.alternatives]
        others = ", ".join(weights[:_MOST_WEIGHTS]) + (", ..." if len(weights) > _MOST_WEIGHTS else "")
        text += f", alternatives {others}" if others else ""
    text += f". {found.advice}" if found.advice else ""
    if truth is None or not found.found:
        return text
    m = nearest_mismatch(found, truth, around_mm)
    numbers = f"M.C. {m.mc:.4g} rad, A.O.E. {m.aoe:.4g} rad, A.P.E. {m.ape:.4g} mm, IoU {m.iou:.3f}"
    return f"{text}\n    against the truth: {numbers}"
