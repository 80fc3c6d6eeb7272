"""The demonstration: synthetic volts of the ten-strip prototype, before and after the printed calibration."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from tacstrip import plot
from tacstrip.contact.shape import Contact
from tacstrip.data import data_path
from tacstrip.geometry.metrics import Mismatch, mismatch
from tacstrip.geometry.region import regions
from tacstrip.io.geojson import read_contact
from tacstrip.io.readings import read_unchecked
from tacstrip.plot.scene import (
    draw_contact,
    draw_polygon,
    draw_regions,
    draw_sensor,
    draw_signatures,
    fill_sheet,
    number_strips,
    zoom,
)
from tacstrip.plot.theme import OTHERS, RECOVERED, TRUE, legend, legend_above, new_figure, themed
from tacstrip.reconstruction.polygon.estimate import fit_polygon
from tacstrip.reconstruction.profile import profile_reconstruction
from tacstrip.reconstruction.result import RecoveredObject
from tacstrip.reconstruction.vertex.estimate import vertex_reconstruction
from tacstrip.scan import Scan
from tacstrip.sensor.spec import Sensor
from tacstrip.thesis.chapter6.twin import twin

FIT = "Polygon fit"
_COLOURS = {"before": OTHERS[0], "after": RECOVERED}


@dataclass(frozen=True)
class Attempt:
    """One method on one set of readings."""

    readings: str  # "before" or "after" calibration
    method: str
    transitions: str  # "", "given" or "found"
    recovered: RecoveredObject
    mismatch: Mismatch | None


@dataclass(frozen=True)
class Demo:
    """Everything that the demonstration shows."""

    sensor: Sensor
    contact: Contact
    scans: dict[str, Scan]
    trials: list[Attempt]


def run() -> Demo:
    """Read the packaged volts without and with the calibration of table 6.1, (6.3), (6.4), and reconstruct."""
    sensor = Sensor.load("prototype-crs-crs")
    contact = read_contact(data_path("demo_contact.wkt"))
    volts = data_path("demo_readings.csv")
    units = {"before": sensor, "after": twin("CRS-CRS")}
    scans = {name: read_unchecked(volts, unit)[0] for name, unit in units.items()}
    trials = [t for name, scan in scans.items() for t in _attempts(name, scan, sensor, contact)]
    return Demo(sensor, contact, scans, trials)


def _attempts(name: str, scan: Scan, sensor: Sensor, contact: Contact) -> list[Attempt]:
    true_x = np.sort(contact.vertices[:, 0])
    lines = replace(sensor, strip_width_mm=None)  # as the volts were made
    found = [(FIT, "", fit_polygon(scan, lines)), ("P.R.", "", profile_reconstruction(scan, sensor))]
    for signature, method in (("kh", "V.R. k_h"), ("kl", "V.R. k_l")):
        for how, x in (("given", true_x), ("found", "auto")):
            shape = vertex_reconstruction(scan, sensor, signature=signature, transitions=x)
            found += [(method, how, shape)]
    return [
        Attempt(name, method, how, o, mismatch(contact.vertices, o.vertices) if o.found else None)
        for method, how, result in found
        for o in result.objects
    ]


def table(demo: Demo) -> str:
    """Return the mismatch table as text."""
    lines = [
        "readings  method      transitions   M.C.    M.C.     A.O.E.   A.P.E.   IoU    status",
        "                                    [rad]  [rad cm]  [rad]     [mm]",
    ]
    for t in demo.trials:
        m = t.mismatch
        numbers = f"{'-':>6}" + " " * 34
        if m:
            numbers = f"{m.mc:6.3f}  {m.mc_length / 10.0:7.2f}  {m.aoe:7.3f}  {m.ape:7.2f}  {m.iou:5.2f}"
        lines.append(f"{t.readings:<9} {t.method:<11} {t.transitions:<12} {numbers}   {t.recovered.status}")
    return "\n".join(lines)


def picture(demo: Demo) -> Figure:
    """Draw what touched, what the strips read, and what the polygon fit recovers before and after calibration."""
    figure = new_figure(7.0, 7.0)
    with themed():
        touched, read, key, recovered = figure.subplot_mosaic(
            "trr;tks", width_ratios=(1.0, 0.8, 1.2)
        ).values()
    plot.contact(demo.contact, demo.sensor, ax=touched)
    touched.set_title("1. A block lies\non ten strips")
    plot.scan(demo.scans["after"], demo.sensor, ax=read)
    handles, labels = read.get_legend_handles_labels()
    draw_signatures(read, demo.sensor, demo.scans["before"], style=":", of_vref=True, zorder=2)
    handles.append(Line2D([], [], color=TRUE, linestyle=":"))
    read.autoscale(axis="y")
    legend_above(read, handles=handles, labels=[*labels, "before calibration"])
    read.set_title("2. Each strip reads two voltages")
    fits = {t.readings: t.recovered for t in demo.trials if t.method == FIT}
    draw_sensor(recovered, demo.sensor)
    number_strips(recovered, demo.sensor)
    draw_contact(recovered, demo.contact, label="true shape")
    for name, colour in _COLOURS.items():
        found = fits[name]
        draw_regions(recovered, demo.sensor, regions(found.vertices, found.covariance), colour)
        label = f"{name} calibration: {found.status}"
        draw_polygon(recovered, found.vertices, colour, label, status=found.status)
    corners = [demo.contact.vertices, *(found.vertices for found in fits.values())]
    zoom(recovered, np.concatenate(corners), demo.sensor, 0.1)
    handles, labels = recovered.get_legend_handles_labels()
    handles.append(Patch(facecolor=TRUE, alpha=0.25))
    fill_sheet(recovered)
    key.axis("off")
    labels = [*(label.replace(": ", ":\n") for label in labels), "95 % region\nof a corner"]
    legend(key, handles=handles, labels=labels, loc="upper left")
    recovered.set_title("3. From these: its shape")
    about = "Simulated: closed forms, printed offsets and residual errors; no hardware was measured"
    figure.suptitle(about, fontsize="small")
    return figure
