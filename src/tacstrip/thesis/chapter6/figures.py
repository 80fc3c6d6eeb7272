"""Figures of chapter 6: the prototypes, calibration graphs, shapes recovered by the twins, points on the tube."""

from __future__ import annotations

import textwrap
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tacstrip.arrays import FloatArray
from tacstrip.contact.footprint import footprint
from tacstrip.contact.shape import Contact
from tacstrip.contact.signature import signatures
from tacstrip.data.published import Experiment, experiments, offsets_volt
from tacstrip.geometry.metrics import mismatch
from tacstrip.plot.scene import draw_contact, draw_polygon, draw_sensor, zoom
from tacstrip.plot.theme import COLOURS, OTHERS, SENSOR, STRIP, TRUE, add_axes, legend, new_axes, new_figure
from tacstrip.reconstruction.profile import profile_reconstruction
from tacstrip.scan import Scan
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.spec import Sensor
from tacstrip.surface.cylinder import strip_angle, to_cartesian, tube_radius
from tacstrip.thesis.captions import by_number, captioned
from tacstrip.thesis.chapter6.tables import (
    UNIT_MM,
    Variant,
    at_nominal,
    calibration_runs,
    line_contact,
    recovered_points,
)
from tacstrip.thesis.chapter6.twin import LINES, PLACINGS, REGIONS, nearest_strips, twin

_TUBE = "Cyl-CRS-M"
_RUBBER = "#b9b09b"
_VOLT_NAMES = {"kh": "$V_h$", "kl": "$V_l$", "k": "$V_{out}$"}
_ELEVATION = 22.0  # of the eye above the tube's middle [degrees]
_CALIBRATED = "calibration graphs of the {} twin's first strip, w = {} units"
_RAW_PROFILES = {"6.18": "6.17", "6.20": "6.19", "6.22": "6.21"}


def figure_6_1() -> Figure:
    """Prototype of the CRS-CRS sensor with ten sensing elements; the rectangle where the twin has it."""
    return _plane("CRS-CRS")


def figure_6_23() -> Figure:
    """Prototype of the CRS-M sensor with nine sensing elements; the rectangle, both readings of the text."""
    return _plane("CRS-M")


def figure_6_33() -> Figure:
    """Prototype of the Cyl-CRS-M sensor with five sensing elements (the printed caption says nine)."""
    figure = new_figure(5.6, 4.6)
    sensor = twin(_TUBE)
    axes = _tube(figure, sensor, 1, 1)
    strips = f"{sensor.strips} strips of {sensor.strip_width:g} mm"
    axes.set_title(f"{strips} round a tube of {2 * tube_radius(sensor):g} mm")
    return figure


def calibration_graph(name: str, w_units: int) -> Figure:
    """Draw what a twin's first strip reads at the unit marks, and the closed form."""
    sensor, width = twin(name), w_units * UNIT_MM
    runs = calibration_runs(sensor, np.random.default_rng([6, 0]))
    now = runs.w_mm[:, 0] == width
    l = np.linspace(0.0, sensor.length_mm - width, 100, endpoint=width == 0.0)
    line = signatures(sensor, *(np.repeat(v[:, None], sensor.strips, axis=1) for v in (l, l + width)))
    figure = new_figure(3.5 * len(runs.raw), 3.3)
    for column, (signature, raw) in enumerate(runs.raw.items(), start=1):
        axes = add_axes(figure, 1, len(runs.raw), column)
        colour, volt = COLOURS[signature], sensor.vref_volt
        expected = line[signature][:, 0] * volt
        axes.plot(l / UNIT_MM, expected, "-", color=TRUE, label="expected")
        axes.plot(runs.l_mm[now, 0] / UNIT_MM, raw[now, 0] * volt, "x", color=colour, label="twin")
        offset = offsets_volt(name, signature)[0]
        axes.plot(l / UNIT_MM, expected + offset, ":", color=colour, label=f"+ {offset:.3f} V")
        axes.axhline(volt, color=STRIP, linewidth=1.0)
        axes.annotate("Vref", (0.0, volt), va="bottom", fontsize=8.0, color=TRUE)
        axes.set(xlabel="lower end l [units of 1 cm]", ylim=(-0.1, 6.5))
        axes.set_ylabel(f"{_VOLT_NAMES[signature]} [V]")
        legend(axes, loc="lower right")
    figure.suptitle(f"{name}, first strip, w = {w_units} units", fontsize=10.0)
    return figure


def figure_6_35() -> Figure:
    """Two-point contacts on the tube: where they are, and where raw and calibrated readings put them."""
    sensor = twin(_TUBE)
    true, raw, good = recovered_points()
    figure = new_figure(7.0, 4.2)
    space, flat = _tube(figure, sensor, 2, 1), add_axes(figure, 1, 2, 2)
    draw_sensor(flat, sensor)
    kinds = (
        ("touched", true, "o-", TRUE),
        ("not calibrated", raw, "x:", OTHERS[3]),
        ("calibrated", good, "+--", COLOURS["k"]),
    )
    for i, line in enumerate(LINES):
        strips = np.array([float(strip) for strip, _ in line])
        draw_contact(flat, line_contact(sensor, i))
        for label, y, style, colour in kinds:
            options: dict[str, Any] = {"color": colour, "markersize": 5.0 if style == "o-" else 8.0}
            flat.plot(sensor.x_mm[strips.astype(int)], y[i], style, label=None if i else label, **options)
            steps = np.linspace(strips[0], strips[1], 9)  # a straight line on the unrolled tube
            points = to_cartesian(sensor, steps, np.interp(steps, strips, y[i]))
            space.plot(*points.T, style, markevery=[0, 8], zorder=10, **options)
        flat.annotate(f"line {i + 1}", (sensor.x_mm[line[1][0]] + 1.2, true[i, 1]), fontsize=8.0, va="center")
    worst = np.abs(raw - true).max(), np.abs(good - true).max()
    title = f"unrolled; largest error\n{worst[0]:.1f} mm raw, {worst[1]:.1f} mm calibrated"
    flat.set(title=title, aspect="auto")
    flat.legend(loc="upper left", frameon=False, fontsize=8.0)
    return figure


def _plane(name: str) -> Figure:
    """Draw a flat prototype for each placing of the rectangle, with its sizes."""
    sensor = twin(name)
    placings = PLACINGS[name]
    figure = new_figure(3.4 * len(placings) + 0.6, 6.2)
    for column, (how, placing) in enumerate(placings.items(), start=1):
        axes = add_axes(figure, 1, len(placings), column)
        draw_sensor(axes, sensor)
        for region in REGIONS:
            contact = placing.contact(sensor, region)
            draw_contact(axes, contact)
            axes.annotate(region, tuple(contact.centroid), ha="center", va="center", fontsize=8.0)
        _label_ends(axes, sensor)
        low, high = min(contact.vertices[:, 0].min(), 0.0), max(contact.vertices[:, 0].max(), sensor.width_mm)
        axes.set_xlim(low - 4.0, high + 4.0)
        axes.set_title(f"rectangle {how}: {_tilt(placing.tilt_deg)}", fontsize=9.0)
    strips = f"{sensor.strips} strips of {sensor.strip_width:g} mm, {10.0 / sensor.pitch_mm:.2f} per cm"
    size = f"{sensor.width_mm / 10.0:g} cm x {sensor.length_mm / 10.0:g} cm"
    figure.suptitle(f"{name} twin: {strips},\n{size}", fontsize=10.0)
    return figure


def _tilt(tilt_deg: float) -> str:
    turned = "clockwise" if tilt_deg < 0.0 else "counter-clockwise"
    return f"5 cm side\n{abs(tilt_deg):g} degrees {turned} from x"


def _label_ends(axes: Axes, sensor: Sensor) -> None:
    """Write the first and the last strip's numbers above them."""
    for i in (0, sensor.strips - 1):
        at = (sensor.x_mm[i], sensor.length_mm + 2.0)
        axes.annotate(str(i + sensor.strip_base), at, ha="center", va="bottom", fontsize=8.0)
    axes.set_ylim(-6.0, sensor.length_mm + 16.0)


def _tube(figure: Figure, sensor: Sensor, columns: int, column: int) -> Any:
    """Add 3-D axes with the tube and its strips, as `to_cartesian` lays them."""
    axes: Any = add_axes(figure, 1, columns, column, projection="3d", computed_zorder=False)
    around = np.linspace(-0.5, 2.0 * np.pi * tube_radius(sensor) / sensor.pitch_mm - 0.5, 60)
    flat: dict[str, Any] = {"linewidth": 0.0, "shade": False}
    axes.plot_surface(*_surface(sensor, around), color=SENSOR, alpha=0.6, zorder=0, **flat)
    half = 0.5 * sensor.strip_width / sensor.pitch_mm
    for i in range(sensor.strips):
        across = np.linspace(i - half, i + half, 8)
        axes.plot_surface(*_surface(sensor, across), color=_RUBBER, antialiased=False, zorder=1, **flat)
        below = to_cartesian(sensor, np.array(float(i)), np.array(-6.0))
        axes.text(*below, str(i + sensor.strip_base), ha="center", fontsize=8.0, zorder=12)
    side = 1.02 * tube_radius(sensor)
    for y, text in ((0.0, "0, ground"), (sensor.length_mm, f"{sensor.length_mm:g} mm, Vref")):
        edge = to_cartesian(sensor, np.array(-0.9), np.array(y))
        axes.text(*edge, f"y = {text}  ", ha="right", fontsize=8.0)
    axes.set(xlim=(-side, side), ylim=(-side, side), zlim=(-8.0, sensor.length_mm))
    axes.set_box_aspect((2.0 * side, 2.0 * side, sensor.length_mm + 8.0), zoom=0.95)
    axes.view_init(_ELEVATION, np.rad2deg(strip_angle(sensor, np.array(0.5 * (sensor.strips - 1)))))
    axes.set_axis_off()
    return axes


def _surface(sensor: Sensor, strips: Any) -> Any:
    net = to_cartesian(sensor, strips[:, None], np.array([0.0, sensor.length_mm])[None, :])
    return net[..., 0], net[..., 1], net[..., 2]


_GRAPHS = {
    "6.2": ("CRS-CRS", 0), "6.3": ("CRS-CRS", 5), "6.4": ("CRS-CRS", 10), "6.24": ("CRS-M", 0),
    "6.25": ("CRS-M", 5), "6.26": ("CRS-M", 10), "6.34": (_TUBE, 0),
}  # fmt: skip


_POLYGON = OTHERS[3]
_BY_FIGURE = {e.figure: e for e in experiments()}
# Profiles of readings that were not calibrated; no figures are printed for them.
RECOVERIES: dict[str, Experiment] = _BY_FIGURE | {
    raw: replace(_BY_FIGURE[good], figure=raw, calibrated=False, printed={})
    for raw, good in _RAW_PROFILES.items()
}
# Signatures that were not calibrated, of the same experiment as these figures.
NOISY = {"6.8": "6.7", "6.12": "6.11", "6.14": "6.13", "6.16": "6.15", "6.28": "6.27"}


def recovery(figure: str) -> Figure:
    """Draw the results of V.R. or P.R. and of the polygon fit for the twin's readings, and the readings."""
    e = RECOVERIES[figure]
    placings = list(PLACINGS[e.sensor])
    several = len(placings) > 1  # then their readings lie below, over the whole width
    drawing = new_figure(7.0, 7.0 if several else 4.6)
    own = Variant(raw=not e.calibrated)
    for column, name in enumerate(placings, start=1):
        axes = add_axes(drawing, 1 + several, 2, column)
        _draw_shapes(axes, e, replace(own, placing=name))
        if several:
            axes.set_title(f"rectangle {name}", fontsize=9.0)
    axes = add_axes(drawing, 1 + several, 2, (3, 4) if several else 2)
    for name, line in zip(placings, ("-", "--"), strict=False):
        _draw_readings(axes, e, replace(own, placing=name), line, name if several else "")
    legend(axes)
    drawing.suptitle(textwrap.fill(f"Figure {figure}: {_caption(figure)}", 105), fontsize=10.0)
    return drawing


def noisy(figure: str) -> Figure:
    """Draw a signature as read, as calibrated, and without errors; the strips of the true vertices are marked."""
    e = _BY_FIGURE[NOISY[figure]]
    name, sensor = e.signature or "", twin(e.sensor)
    drawing, axes = new_axes(5.6, 3.9)
    contact, good, _ = at_nominal(e, Variant())
    raw = at_nominal(e, Variant(raw=True))[1]
    axes.plot(sensor.x_mm, raw[name], "o-", color=COLOURS[name], label="as read")
    axes.plot(sensor.x_mm, good[name], ".:", color=COLOURS[name], label="calibrated")
    _draw_true(axes, sensor, contact, name, "--", "without errors")
    axes.set_title(textwrap.fill(f"Figure {figure}: {_caption(figure)}", 62))
    _name_axes(axes, name)
    legend(axes)
    return drawing


def _caption(figure: str) -> str:
    e = RECOVERIES.get(figure) or _BY_FIGURE[NOISY[figure]]
    where = f"in the {e.region} region of the {e.sensor} twin"
    symbol = f"${SIGNATURES[e.signature].symbol}$" if e.signature else ""
    if figure in NOISY:
        return f"{symbol}-signature of the rectangle {where}, not calibrated"
    method = f"V.R. with {symbol}" if symbol else "P.R."
    return f"{method} {where}, {'calibrated' if e.calibrated else 'not calibrated'}"


def _draw_shapes(axes: Axes, e: Experiment, variant: Variant) -> None:
    sensor = twin(e.sensor)
    contact, scan, vertices = at_nominal(e, variant)
    fitted = at_nominal(e, replace(variant, method="polygon"))[2]
    draw_sensor(axes, sensor)
    draw_contact(axes, contact, "original")
    name = e.signature or "profile"
    method = f"V.R. with ${SIGNATURES[name].symbol}$" if e.signature else "P.R., at the vertices' strips"
    _draw_one(axes, contact, vertices, COLOURS[name], method)
    if e.signature is None:
        outline = profile_reconstruction(scan, sensor).objects[0].vertices
        draw_polygon(axes, outline, OTHERS[1], "P.R., every strip", alpha=0.5)
    _draw_one(axes, contact, fitted, _POLYGON, "polygon fit", dashed=True)
    shown = [v for v in (contact.vertices, vertices, fitted) if len(v)]
    zoom(axes, np.concatenate(shown), sensor, share=0.12)
    low, high = axes.get_ylim()
    axes.set_ylim(max(low, -4.0), min(high, sensor.length_mm + 4.0))
    if e.printed:
        axes.plot([], [], " ", label=f"in print: {e.printed['aoe']:.3f}, {e.printed['ape']:.3f}")
    axes.set(xlabel="x [mm]", ylabel="y [mm]")
    axes.legend(
        loc="upper center", bbox_to_anchor=(0.5, -0.2), frameon=False, fontsize=8.0,
        title="A.O.E. [rad], A.P.E. [cm]", title_fontsize=8.0,
    )  # fmt: skip


def _draw_one(
    axes: Axes, contact: Contact, vertices: FloatArray, colour: str, label: str, dashed: bool = False
) -> None:
    """Draw a recovered shape with its A.O.E. and A.P.E. in the legend, or say there that there is none."""
    if not len(vertices):
        axes.plot([], [], color=colour, label=f"{label}: no shape")
        return
    m = mismatch(contact.vertices, vertices)
    draw_polygon(axes, vertices, colour, f"{label}: {m.aoe:.3f}, {m.ape / 10.0:.3f}", dashed=dashed)


def _draw_readings(axes: Axes, e: Experiment, variant: Variant, line: str, label: str) -> None:
    sensor = twin(e.sensor)
    contact, scan, _ = at_nominal(e, variant)
    strips = nearest_strips(sensor, contact.vertices)
    for name in scan.signatures:
        symbol = f"${SIGNATURES[name].symbol}$ {label}".rstrip()
        axes.plot(sensor.x_mm, scan[name], f".{line}", color=COLOURS[name], label=f"{symbol}, read")
        axes.plot(sensor.x_mm[strips], scan[name][strips], "o", color=COLOURS[name], mfc="none", ms=8.0)
        _draw_true(axes, sensor, contact, name, ":", f"{symbol}, without errors")
    _name_axes(axes, scan.signatures[0])
    if len(scan.signatures) > 1:
        axes.set_ylabel("over Vref")


def _draw_true(axes: Axes, sensor: Sensor, contact: Contact, name: str, line: str, label: str) -> None:
    ideal: Scan | dict[str, FloatArray] = signatures(sensor, *footprint(sensor, contact))
    axes.plot(sensor.x_mm, ideal[name], line, color=TRUE, linewidth=1.0, label=label)


def _name_axes(axes: Axes, name: str) -> None:
    axes.set(xlabel="x [mm]", ylabel=f"${SIGNATURES[name].symbol}$, over Vref")


FIGURES = by_number(globals())
FIGURES |= {f: captioned(_CALIBRATED.format(*what), calibration_graph, *what) for f, what in _GRAPHS.items()}
FIGURES |= {f: captioned(_caption(f), recovery, f) for f in RECOVERIES}
FIGURES |= {f: captioned(_caption(f), noisy, f) for f in NOISY}
