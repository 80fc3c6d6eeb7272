"""The demonstration: synthetic volts of the ten-strip prototype, before and after the printed calibration."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from tacstrip.contact.shape import Contact
from tacstrip.data import data_path
from tacstrip.geometry.metrics import Mismatch, mismatch
from tacstrip.geometry.region import regions
from tacstrip.io.geometry import read_contact
from tacstrip.io.readings import read_readings
from tacstrip.plot.scene import draw_contact, draw_polygon, draw_regions, draw_sensor, draw_signatures, zoom
from tacstrip.plot.theme import COLOURS, TRUE, add_axes, legend_above, new_figure
from tacstrip.reconstruction.polygon.estimate import fit_polygon
from tacstrip.reconstruction.profile import profile_reconstruction
from tacstrip.reconstruction.result import RecoveredObject
from tacstrip.reconstruction.vertex.estimate import vertex_reconstruction
from tacstrip.scan import Scan
from tacstrip.sensor.spec import Sensor
from tacstrip.thesis.chapter6.twin import twin

FIT = "Polygon fit"
_COLOURS = {FIT: COLOURS["k"], "P.R.": COLOURS["profile"]}
_COLOURS |= {"V.R. k_h": COLOURS["kh"], "V.R. k_l": COLOURS["kl"]}


@dataclass(frozen=True)
class Trial:
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
    trials: list[Trial]


def run() -> Demo:
    """Read the packaged volts without and with the calibration of table 6.1, (6.3), (6.4), and reconstruct."""
    sensor = Sensor.load("prototype-crs-crs")
    contact = read_contact(data_path("demo_contact.wkt"))
    volts = data_path("demo_readings.csv")
    units = {"before": sensor, "after": twin("CRS-CRS")}
    scans = {name: read_readings(volts, unit)[0] for name, unit in units.items()}
    trials = [t for name, scan in scans.items() for t in _trials(name, scan, sensor, contact)]
    return Demo(sensor, contact, scans, trials)


def _trials(name: str, scan: Scan, sensor: Sensor, contact: Contact) -> list[Trial]:
    true_x = np.sort(contact.vertices[:, 0])
    lines = replace(sensor, strip_width_mm=None)  # as the volts were made
    found = [(FIT, "", fit_polygon(scan, lines)), ("P.R.", "", profile_reconstruction(scan, sensor))]
    for signature, method in (("kh", "V.R. k_h"), ("kl", "V.R. k_l")):
        for how, x in (("given", true_x), ("found", "auto")):
            shape = vertex_reconstruction(scan, sensor, signature=signature, transitions=x)
            found += [(method, how, shape)]
    return [
        Trial(name, method, how, o, mismatch(contact.vertices, o.vertices) if o.found else None)
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
    """Draw sensor, true shape and signatures, the polygon fit before and after, and the thesis' methods."""
    figure = new_figure(9.5, 7.4)
    axes = add_axes(figure, 2, 3, (1, 4))
    draw_sensor(axes, demo.sensor)
    _draw_shapes(axes, demo, "after", [FIT])
    axes.set_title("Prototype, 10 strips")
    panels = {2: ("before", [FIT]), 3: ("after", [FIT]), 5: ("after", ["P.R.", "V.R. k_h", "V.R. k_l"])}
    for place, (name, methods) in panels.items():
        axes = add_axes(figure, 2, 3, place)
        _draw_shapes(axes, demo, name, methods)
        axes.set_aspect("equal")
        zoom(axes, np.concatenate([t.recovered.vertices for t in demo.trials if _shown(t)]), demo.sensor, 0.1)
        axes.set(xlabel="x [mm]", ylabel="y [mm]")
        if methods == [FIT]:
            fits = [t for t in demo.trials if (t.readings, t.method) == (name, FIT)]
            axes.set_title(f"{FIT} {name}\ncalibration: {', '.join(t.recovered.status for t in fits)}")
        else:
            axes.set_title(f"The thesis' methods {name} calibration\n(V.R.: true transitions given)")
    _explain(figure, demo)
    axes = add_axes(figure, 2, 3, 6)
    for name, style in (("before", ":"), ("after", ".-")):
        draw_signatures(axes, demo.sensor, demo.scans[name], style=style)
    axes.set(title="Pseudo-signatures\n(dotted: before calibration)", xlabel="x [mm]", ylabel="k L [mm]")
    handles, labels = axes.get_legend_handles_labels()
    legend_above(axes, handles=handles[2:], labels=labels[2:])
    made = "closed forms + printed offsets and residual errors; no hardware was measured"
    figure.suptitle(f"Synthetic readings: {made}")
    return figure


def _shown(trial: Trial) -> bool:
    """Tell whether a trial is in the picture: all after calibration, and the fit before; given transitions only."""
    return trial.transitions != "found" and (trial.readings == "after" or trial.method == FIT)


def _draw_shapes(axes: Axes, demo: Demo, name: str, methods: list[str]) -> None:
    draw_contact(axes, demo.contact, label="true shape")
    for t in demo.trials:
        if t.readings == name and t.method in methods and _shown(t):
            colour, o = _COLOURS[t.method], t.recovered
            draw_regions(axes, demo.sensor, regions(o.vertices, o.covariance), colour)
            draw_polygon(axes, o.vertices, colour, t.method, doubtful=o.status not in ("ok", "likely"))


def _explain(figure: Figure, demo: Demo) -> None:
    """Add one legend for all shapes."""
    entries: dict[str, Artist] = {}
    for axes in figure.axes:
        handles, labels = axes.get_legend_handles_labels()
        entries |= {str(label): h for h, label in zip(handles, labels, strict=True)}
    entries["95 % region of a corner"] = Patch(facecolor=TRUE, alpha=0.25)
    figure.legend(entries.values(), entries.keys(), loc="outside lower center", ncols=6, frameon=False)
