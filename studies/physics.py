"""What a real strip sensor does that the closed forms do not know: the pictures of docs/science/physics.md."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from matplotlib.figure import Figure

from tacstrip.arrays import FloatArray
from tacstrip.contact.footprint import footprint
from tacstrip.contact.shape import Contact
from tacstrip.contact.signature import signatures
from tacstrip.network.imperfections import Readout
from tacstrip.network.nodal import solve_measurement
from tacstrip.network.strips.measurements import make_mesh, measurement_of, network_readings
from tacstrip.plot.scene import draw_contact, draw_sensor
from tacstrip.plot.theme import COLOURS, OTHERS, add_axes, legend, new_axes, new_figure
from tacstrip.sensor.closed_form import lower_and_width, transfer_length
from tacstrip.sensor.spec import Sensor

_STRIP = 4


def _pair(contact_lambda_mm: float) -> Sensor:
    return Sensor(
        construction="crs-crs", strips=10, pitch_mm=6.5, length_mm=325.0, contact_lambda_mm=contact_lambda_mm
    )


def potentials() -> Figure:
    """Potentials along both strips of a pair: contact resistance bends them apart at the contact's ends."""
    figure = new_figure(7.0, 3.6)
    block = Contact.polygon([(0, 120), (65, 120), (65, 200), (0, 200)])
    for i, lam in enumerate((0.0, 5.0, 20.0)):
        axes = add_axes(figure, 1, 3, i + 1)
        axes.axvspan(120.0, 200.0, color="#eeeeee", label="contact")
        along = potentials_along(_pair(lam), block, _STRIP)
        for layer, colour in (("energised", "black"), ("sensing", COLOURS["kh"])):
            y, volts = along[layer]
            axes.plot(y, volts, color=colour, label=f"{layer} strip")
        for name, y_end in (("kh", 325.0), ("kl", 0.0)):
            axes.plot(
                y_end,
                network_readings(_pair(lam), block)[name][_STRIP],
                "o",
                color=COLOURS[name],
                clip_on=False,
            )
        axes.set_title("ideal contact" if lam == 0.0 else f"lambda = {lam:.0f} mm", fontsize=9.0)
        axes.set_xlabel("y along the strip [mm]")
        if i == 0:
            axes.set_ylabel("potential over Vref")
            legend(axes, loc="upper left")
    return figure


def potentials_along(sensor: Sensor, contact: Contact, strip: int) -> dict[str, FloatArray]:
    """Return the potentials along one touched strip and its sensing strip: layer to y [mm] and Vref (2, nodes)."""
    mesh = make_mesh(sensor, contact, None, None, None)
    read = solve_measurement(measurement_of(mesh, strip, along=True))
    along: dict[str, list[tuple[float, float]]] = {"energised": [], "sensing": []}
    for name, volts in read.items():
        layer, _, y = name.partition(" ")
        if y:
            along[layer].append((float(y), volts))
    return {layer: np.array(sorted(places)).T for layer, places in along.items()}


def contact_transfer_length() -> Figure:
    """Contact resistance shortens what is read: each end by T = lambda tanh(w / 2 lambda)."""
    figure, axes = new_axes(5.6, 3.8)
    looks = zip((2.0, 5.0, 20.0), (COLOURS["kh"], *OTHERS[:2]), ("-", "--", "-."), "os^", strict=True)
    for lam, colour, dashes, marker in looks:
        w = np.linspace(0.0, 100.0, 201)
        axes.plot(w, transfer_length(w, lam), dashes, color=colour, label=f"lambda = {lam:.0f} mm")
        for width in (5.0, 20.0, 60.0, 95.0):
            read = network_readings(
                _pair(lam), Contact.polygon([(0, 100), (65, 100), (65, 100 + width), (0, 100 + width)])
            )
            l, _ = lower_and_width(read["kh"][_STRIP], read["kl"][_STRIP], 325.0)
            axes.plot(width, l - 100.0, marker, color=colour, markersize=4.0)
    axes.plot([0.0, 40.0], [0.0, 20.0], color="#999999", linestyle=":", label="w / 2: nothing is left")
    axes.set_xlabel("true length of the contact w [mm]")
    axes.set_ylabel("transfer length T at either end [mm]")
    axes.set_title("lines: closed form; dots: network, read as an ideal sensor", fontsize=9.0)
    legend(axes)
    return figure


def tied_grounds() -> Figure:
    """Ground ends tied together: the touched strips load the sheet, and every reading is far too low."""
    sensor = Sensor.load("prototype-crs-m")
    contact = Contact.polygon([(4, 90), (30, 70), (38, 130), (12, 150)])
    figure = new_figure(7.0, 4.0)
    left, right = add_axes(figure, 1, 2, 1), add_axes(figure, 1, 2, 2)
    draw_sensor(left, sensor)
    draw_contact(left, contact)
    ideal = signatures(sensor, *footprint(sensor, contact))["k"]
    tied = network_readings(sensor, contact, readout=Readout(tied_grounds=True))["k"]
    right.plot(sensor.x_mm, ideal, ".-", color=COLOURS["k"], label="ends switched alone: (3.8)")
    right.plot(sensor.x_mm, tied, ".--", color=COLOURS["kh"], label="ground ends tied")
    right.set_xlabel("x [mm]")
    right.set_ylabel("k")
    right.set_ylim(0.0, 0.6)
    legend(right, loc="upper left")
    return figure


FIGURES: dict[str, Callable[[], Figure]] = {
    "potentials": potentials,
    "transfer_length": contact_transfer_length,
    "tied_grounds": tied_grounds,
}
