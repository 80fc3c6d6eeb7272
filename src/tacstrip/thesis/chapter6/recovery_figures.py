"""Figures 6.5-6.22 and 6.27-6.32: the rectangle recovered from the twins' readings, and signatures not calibrated."""

from __future__ import annotations

import textwrap
from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tacstrip.arrays import FloatArray
from tacstrip.contact.footprint import footprint
from tacstrip.contact.shape import Contact
from tacstrip.contact.signature import signatures
from tacstrip.data.published import Experiment, experiments
from tacstrip.geometry.metrics import mismatch
from tacstrip.plot.scene import draw_contact, draw_polygon, draw_sensor, zoom
from tacstrip.plot.theme import COLOURS, OTHERS, TRUE, add_axes, legend, new_axes, new_figure
from tacstrip.reconstruction.profile import profile_reconstruction
from tacstrip.scan import Scan
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.spec import Sensor
from tacstrip.thesis.captions import captioned
from tacstrip.thesis.chapter6.tables import Variant, at_nominal
from tacstrip.thesis.chapter6.twin import PLACINGS, nearest_strips, twin

_POLYGON = OTHERS[3]
_BY_FIGURE = {e.figure: e for e in experiments()}
# Profiles of readings that were not calibrated; no figures are printed for them.
_RAW_PROFILES = {"6.18": "6.17", "6.20": "6.19", "6.22": "6.21"}
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


FIGURES = {f: captioned(_caption(f), recovery, f) for f in RECOVERIES}
FIGURES |= {f: captioned(_caption(f), noisy, f) for f in NOISY}
