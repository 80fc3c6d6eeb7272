"""The drawings of "What is this sensor?", from the closed forms: the directive `{drawing} cross-section`."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import numpy as np
from docutils import nodes
from docutils.parsers.rst import directives
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, Polygon, Rectangle
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

import tacstrip as ts
from docs_site.legible import refuse_small_letters
from tacstrip.plot.scene import draw_contact, draw_sensor
from tacstrip.plot.theme import COLOURS, new_axes, new_panels, save

_RUBBER, _SENSING, _OBJECT, _LIVE = "#8a8577", "#c9c2b0", "#7fa6c9", "#c1440e"
_L, _U, _LENGTH = 30.0, 60.0, 100.0


def _layers(axes: Axes, pressed: bool = True) -> None:
    """Draw the two strips of one pair from the side, and what presses them together."""
    axes.add_patch(Rectangle((-4, -7), 108, 5, facecolor="#eeeae0", edgecolor="none"))
    axes.add_patch(Rectangle((0, -2), _LENGTH, 5, facecolor=_RUBBER, edgecolor="none"))
    y = np.linspace(0.0, _LENGTH, 401)
    lifted = (
        4.0 * (1.0 - np.clip(np.minimum(y - _L + 8.0, _U + 8.0 - y) / 8.0, 0.0, 1.0))
        if pressed
        else 4.0 + 0.0 * y
    )
    low = 3.0 + lifted
    axes.fill_between(y, low, low + 5.0, color=_SENSING, linewidth=0)
    if pressed:
        axes.add_patch(Rectangle((_L, 8.0), _U - _L, 32.0, facecolor=_OBJECT, edgecolor="none"))
        axes.plot([_L, _U], [3.0, 3.0], color=_LIVE, linewidth=3.0, solid_capstyle="butt")
    axes.set(xlim=(-26, 128), aspect="equal")
    axes.axis("off")


def cross_section() -> Figure:
    """Return one pair of strips from the side, with its wires."""
    figure, axes = new_axes(7.0, 3.1)
    _layers(axes)
    for x, name, align in ((0.0, "ground, 0 V", "right"), (_LENGTH, "supply, Vref", "left")):
        axes.plot([x], [0.5], "o", color="black", markersize=5)
        side = -3.0 if align == "right" else 3.0
        axes.text(x + side, 0.5, name, ha=align, va="center")
    for x, name, align, key in (
        (0.0, "read here: v_l", "right", "kl"),
        (_LENGTH, "read here: v_h", "left", "kh"),
    ):
        axes.plot([x], [9.5], "o", color=COLOURS[key], markersize=6)
        side = -3.0 if align == "right" else 3.0
        axes.text(x + side, 9.5, name, ha=align, va="center", color=COLOURS[key])
    for x, name in ((_L, "l"), (_U, "u")):
        axes.plot([x, x], [-8.5, 3.0], color=_LIVE, linewidth=0.9, linestyle="--")
        axes.text(x, -12.0, name, ha="center", color=_LIVE, fontsize=12, style="italic")
    axes.text(45, 25, "object", ha="center", va="center")
    for xy, at, name in (
        ((80, 0.5), (92, -13.5), "energised strip: conductive rubber"),
        ((80, 9.5), (96, 24), "sensing strip: conductive rubber,\nheld off until something presses"),
    ):
        axes.annotate(name, xy, at, ha="center", va="center", arrowprops={"arrowstyle": "-", "lw": 0.7})
    axes.text(45, -5.0, "base", ha="center", va="center", fontsize=8)
    axes.add_patch(FancyArrowPatch((0, -19.0), (_LENGTH, -19.0), arrowstyle="<->", mutation_scale=9, lw=0.8))
    axes.text(
        50, -22.5, "strip length L; places y are counted from the grounded end", ha="center", va="center"
    )
    axes.set_ylim(-25, 46)
    return figure


def three_steps() -> Figure:
    """Return a press in three steps: from above, from the side, and as voltages."""
    figure, (above, side, volts) = new_panels(7.0, 3.2, 1, 3)
    sensor = ts.Sensor(construction="crs-crs", strips=10, pitch_mm=10.0, length_mm=100.0)
    contact = ts.Contact.polygon([(22, 18), (70, 34), (62, 72), (30, 66)])
    draw_sensor(above, sensor)
    draw_contact(above, contact)
    touched = ts.footprint(sensor, contact)
    strip = 4
    low, high = float(np.ravel(touched.l)[strip]), float(np.ravel(touched.u)[strip])
    x = sensor.x_mm
    for i in range(sensor.strips):
        ends = float(np.ravel(touched.l)[i]), float(np.ravel(touched.u)[i])
        if np.isfinite(ends[0]):
            above.plot([x[i], x[i]], ends, color=_LIVE, linewidth=3.0 if i == strip else 1.3)
    above.text(x[strip] + 2.0, low - 1.0, "l", color=_LIVE, va="top", style="italic", fontsize=11)
    above.text(x[strip] + 2.0, high + 1.0, "u", color=_LIVE, va="bottom", style="italic", fontsize=11)
    above.set(
        title="1  Ten strips, from above",
        xlabel="across the strips, x [mm]",
        ylabel="along them, y [mm]",
    )
    _layers(side)
    side.set(title="2  One, from the side", xlim=(-6, 106), ylim=(-62, 60))
    for at, name in ((_L, "l"), (_U, "u")):
        side.plot([at, at], [-9.0, 3.0], color=_LIVE, linewidth=0.9, linestyle="--")
        side.text(at, -11.0, name, ha="center", va="top", color=_LIVE, style="italic", fontsize=11)
    side.text(50, -44, "between l and u\nboth strips carry\nthe current", ha="center", va="center")
    kl, kh = _L / (_LENGTH - (_U - _L) / 2.0), (_L + (_U - _L) / 2.0) / (_LENGTH - (_U - _L) / 2.0)
    volts.plot([0, _LENGTH], [0, 1], color="#999999", linewidth=0.8, linestyle=":", label="untouched")
    volts.plot([0, _L, _U, _LENGTH], [0, kl, kh, 1], color="black", label="energised strip")
    volts.axvspan(_L, _U, color=_LIVE, alpha=0.12, linewidth=0)
    volts.plot([0, _L], [kl, kl], color=COLOURS["kl"], linestyle="--", linewidth=1.2)
    volts.plot([_U, _LENGTH], [kh, kh], color=COLOURS["kh"], linestyle="--", linewidth=1.2)
    volts.text(-2, kl + 0.02, "$k_l$", color=COLOURS["kl"], va="bottom")
    volts.text(99, kh - 0.03, "$k_h$", color=COLOURS["kh"], va="top", ha="right")
    volts.set(title="3  Its voltages", xlabel="along the strip, y [mm]", ylabel="voltage over Vref")
    volts.set_ylim(-0.03, 1.3)
    volts.legend(loc="upper left", frameon=False)
    return figure


def pipeline() -> Figure:
    """Return the way from readings to a shape as three pictures of the same press."""
    figure, (readings, ends, shape) = new_panels(7.0, 2.9, 1, 3)
    sensor = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0)
    contact = ts.Contact.polygon([(22, 18), (70, 34), (62, 72), (30, 66)])
    noise = ts.Noise(positional=0.005)
    scan = ts.simulate(sensor, contact, noise, rng=3)
    for name in ("kh", "kl"):
        readings.plot(range(sensor.strips), scan[name], "o", color=COLOURS[name], markersize=3.5)
    readings.set(title="two voltages a strip", xlabel="strip", ylabel="voltage over Vref")
    readings.text(13.6, 0.6, "$k_h$", color=COLOURS["kh"])
    readings.text(13.6, 0.34, "$k_l$", color=COLOURS["kl"])
    readings.set(xlim=(-0.5, sensor.strips - 0.5), ylim=(0.0, 1.0), xticks=range(0, sensor.strips, 4))
    profile = ts.profile_reconstruction(scan, sensor).objects[0].vertices
    found = ts.reconstruct(scan, sensor, noise).objects[0].vertices
    for axes in (ends, shape):
        draw_sensor(axes, sensor)
        axes.set(xlabel="x [mm]", ylabel="y [mm]")
    ends.plot(*profile.T, "o", color=_LIVE, markersize=3.0)
    ends.set_title("both ends on each")
    draw_contact(shape, contact)
    shape.add_patch(Polygon(found, closed=True, fill=False, edgecolor=_LIVE, linewidth=1.6))
    shape.set_title("the outline of all")
    return figure


DRAWINGS = {"cross-section": cross_section, "three-steps": three_steps, "pipeline": pipeline}


class _Drawing(SphinxDirective):
    required_arguments = 1
    option_spec: ClassVar = {"alt": directives.unchanged_required}

    def run(self) -> list[nodes.Node]:
        name = self.arguments[0]
        folder = Path(self.env.srcdir) / "_drawn"
        folder.mkdir(exist_ok=True)
        save(figure := DRAWINGS[name](), folder / f"{name}.png", dpi=120)
        refuse_small_letters(figure, name)
        return [nodes.image(uri=f"/_drawn/{name}.png", alt=self.options["alt"])]


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("drawing", _Drawing)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
