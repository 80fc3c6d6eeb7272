"""The demonstration: synthetic volts of the ten-strip prototype, before and after the printed calibration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tacstrip.arrays import FloatArray
from tacstrip.contact.shape import Contact
from tacstrip.data import data_path
from tacstrip.io.geometry import read_contact
from tacstrip.io.readings import read_readings
from tacstrip.metrics import Mismatch, mismatch
from tacstrip.plot.scene import draw_contact, draw_polygon, draw_sensor, draw_signatures, zoom
from tacstrip.plot.style import COLOURS, OTHERS, add_axes, legend, new_figure
from tacstrip.reconstruct.profile import profile_reconstruction
from tacstrip.reconstruct.result import RecoveredObject
from tacstrip.reconstruct.vertex import vertex_reconstruction
from tacstrip.scan import Scan
from tacstrip.sensor.spec import Sensor
from tacstrip.studies.twin import calibrated, twin

_COLOURS = {"P.R.": COLOURS["profile"], "V.R. k_h": COLOURS["kh"], "V.R. k_l": COLOURS["kl"]}


@dataclass(frozen=True)
class Trial:
    """One method on one set of readings."""

    readings: str  # "before" or "after" the offsets were subtracted
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
    trials: list[Trial]


def run() -> Demo:
    """Read the packaged volts, subtract the offsets of table 6.1 as in (6.3), (6.4), and reconstruct."""
    sensor = Sensor.load("prototype-crs-crs")
    contact = read_contact(data_path("demo_contact.wkt"))
    before = read_readings(data_path("demo_readings.csv"), sensor)[0]
    scans = {"before": before, "after": calibrated(twin("CRS-CRS"), before)}
    trials = [t for name, scan in scans.items() for t in _trials(name, scan, sensor, contact)]
    return Demo(sensor, contact, scans, trials)


def _trials(name: str, scan: Scan, sensor: Sensor, contact: Contact) -> list[Trial]:
    true_x: FloatArray = np.sort(contact.vertices[:, 0])
    found = [("P.R.", "", profile_reconstruction(scan, sensor))]
    for signature, method in (("kh", "V.R. k_h"), ("kl", "V.R. k_l")):
        found.append((method, "given", vertex_reconstruction(scan, sensor, signature, true_x)))
        found.append((method, "found", vertex_reconstruction(scan, sensor, signature)))
    return [
        Trial(name, method, how, o, mismatch(contact.vertices, o.vertices) if o.found else None)
        for method, how, result in found
        for o in result.objects
    ]


def table(demo: Demo) -> str:
    """Return the mismatch table as text."""
    lines = [
        "readings  method     transitions   M.C.    M.C.     A.O.E.   A.P.E.   IoU    status",
        "                                   [rad]  [rad cm]  [rad]     [mm]",
    ]
    for t in demo.trials:
        m = t.mismatch
        numbers = (
            f"{m.mc:6.3f}  {m.mc_length / 10.0:7.2f}  {m.aoe:7.3f}  {m.ape:7.2f}  {m.iou:5.2f}"
            if m
            else f"{'-':>6}" + " " * 34
        )
        lines.append(f"{t.readings:<9} {t.method:<10} {t.transitions:<12} {numbers}   {t.recovered.status}")
    return "\n".join(lines)


def picture(demo: Demo) -> Figure:
    """Draw sensor, true shape, recovered shapes and signatures, before and after."""
    figure = new_figure(11.0, 6.2)
    axes = add_axes(figure, 1, 4, 1)
    draw_sensor(axes, demo.sensor)
    draw_contact(axes, demo.contact)
    for t in demo.trials:
        if t.readings == "after" and t.method == "P.R.":
            draw_polygon(axes, t.recovered.vertices, _COLOURS["P.R."])
    axes.set_title("prototype, 10 strips")
    for column, name in enumerate(("before", "after"), start=2):
        _draw_shapes(add_axes(figure, 1, 4, column), demo, name)
    axes = add_axes(figure, 1, 4, 4)
    for name, style in (("before", ":"), ("after", ".-")):
        draw_signatures(axes, demo.sensor, demo.scans[name], style=style)
    axes.set_title("pseudo-signatures\n(dotted: before calibration)")
    axes.set_xlabel("x [mm]")
    axes.set_ylabel("k L [mm]")
    handles, labels = axes.get_legend_handles_labels()
    legend(axes, handles=handles[2:], labels=labels[2:])
    figure.suptitle(
        "Synthetic readings: closed forms + printed offsets and residual errors; no hardware was measured"
    )
    return figure


def _draw_shapes(axes: Axes, demo: Demo, name: str) -> None:
    draw_contact(axes, demo.contact, label="true shape")
    for t in demo.trials:
        if t.readings == name and t.recovered.found and t.transitions != "found":
            label = f"{t.method}: {t.recovered.status}"
            colour = _COLOURS.get(t.method, OTHERS[0])
            draw_polygon(axes, t.recovered.vertices, colour, label, dashed=t.recovered.status != "ok")
    axes.set_aspect("equal")
    zoom(axes, demo.contact.vertices, demo.sensor, share=0.6)
    axes.set_title(f"{name} calibration")
    axes.set_xlabel("x [mm]")
    axes.set_ylabel("y [mm]")
    legend(axes, loc="upper left", fontsize=7.0)
