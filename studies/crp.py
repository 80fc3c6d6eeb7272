"""How well a CRS-CRP sensor (3.3) knows the ends of a contact, and its sheet: pictures of docs/science/physics.md."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from studies import crp_spans
from tacstrip.arrays import FloatArray
from tacstrip.contact.footprint import footprint
from tacstrip.contact.shape import Contact
from tacstrip.network.crp.cramer_rao import Electrodes
from tacstrip.plot.scene import draw_contact, draw_sensor
from tacstrip.plot.theme import COLOURS, add_axes, legend, new_figure
from tacstrip.sensor.spec import Sensor

SIGMA = 1e-3  # of Vref: the noise of a reading
SHAPES = {
    "hexagon": Contact.polygon([(12, 15), (30, 5), (70, 10), (90, 40), (60, 85), (20, 70)]),
    "triangle": Contact.polygon([(10, 20), (90, 30), (50, 90)]),
    "slanted band": Contact.polygon([(15, 20), (85, 60), (85, 85), (15, 45)]),
}  # 14 to 16 of 20 strips wide
_WIDE, _LONG = 10, 20.0  # the standard contact of the map: strips, and % of their length
_ENERGISED = 7


def a_sensor(**changed: Any) -> Sensor:
    """Return the sensor of the studies: 20 strips of 100 mm at 5 mm, sheet 100 times as resistive, lambda 2 mm."""
    spec = {"strips": 20, "pitch_mm": 5.0, "length_mm": 100.0}
    electric = {"resistivity_ratio": 100.0, "contact_lambda_mm": 2.0}
    return Sensor(construction="crs-crp", **(spec | electric | changed))


def end_bounds(
    sensor: Sensor, l: FloatArray, u: FloatArray, electrodes: Electrodes, rows: int | None = None
) -> FloatArray:
    """Return the Cramer-Rao bound of l and of u (2, strips) at 0.1 % noise [% of L]; NaN where untouched."""
    spread = np.sqrt(np.diag(crp_spans.covariance(sensor, l, u, SIGMA, electrodes, rows)))
    return 100.0 * spread.reshape(2, -1) / sensor.length_mm


@dataclass(frozen=True, eq=False)
class ErrorMap:
    """How well an end of the standard contact is known, by where on the sensor it lies.

    Attributes
    ----------
    y_percent
        Middles of the contact (places,) [% of L].
    l, u
        Bound of the lower and the upper end, by strip and middle (strips, places) [% of L]: the root mean square
        over all positions across the strips in which the contact lies wholly on the sensor and on this strip.
    """

    y_percent: FloatArray
    l: FloatArray
    u: FloatArray


def error_map(
    electrodes: Electrodes,
    sensor: Sensor | None = None,
    wide: int = _WIDE,
    long_percent: float = _LONG,
    places: int = 17,
    rows: int | None = 100,
) -> ErrorMap:
    """Move a level rectangle over the whole sensor and return the bound of its ends on every strip.

    Parameters
    ----------
    electrodes
        Which electrodes are read: each strip's "own" two, or "all".
    sensor
        By default `a_sensor()`.
    wide, long_percent
        The rectangle: strips, and % of their length.
    places
        Of its middle along the strips, from one edge of the sensor to the other.
    rows
        Of the mesh.
    """
    sensor = sensor or a_sensor()
    low = np.linspace(0.0, 100.0 - long_percent, places)
    squares = np.zeros((2, sensor.strips, places))
    times = np.zeros(sensor.strips)
    for first in range(sensor.strips - wide + 1):
        strips = slice(first, first + wide)
        times[strips] += 1
        for j, end in enumerate(low):
            l, u = np.full((2, sensor.strips), np.nan)
            l[strips] = end / 100.0 * sensor.length_mm
            u[strips] = (end + long_percent) / 100.0 * sensor.length_mm
            squares[:, strips, j] += end_bounds(sensor, l, u, electrodes, rows)[:, strips] ** 2
    mean = np.sqrt(squares / times[:, None])
    return ErrorMap(low + 0.5 * long_percent, mean[0], mean[1])


def error_map_figure() -> Figure:
    """Map where on the sensor the ends of a contact are known well: from own electrodes, and from all."""
    sensor = a_sensor()
    maps = {"own electrodes": error_map("own"), "all electrodes": error_map("all")}
    values = [getattr(m, end) for m in maps.values() for end in ("l", "u")]
    shades = LogNorm(min(v.min() for v in values), max(v.max() for v in values))
    figure = new_figure(7.0, 7.0)
    drawn: list[Axes] = []
    for row, (end, half, name) in enumerate((("u", 0.5, "upper"), ("l", -0.5, "lower"))):
        for column, (title, found) in enumerate(maps.items()):
            axes = add_axes(figure, 2, 2, 2 * row + column + 1)
            y = (found.y_percent + half * _LONG) / 100.0 * sensor.length_mm
            image = axes.pcolormesh(sensor.x_mm, y, getattr(found, end).T, norm=shades, cmap="viridis_r")
            axes.set_xlim(0.0, sensor.width_mm)
            axes.set_ylim(0.0, sensor.length_mm)
            axes.set_aspect("equal")
            axes.set_title(f"{name} end, {title}")
            axes.set_xlabel("digital dimension x [mm]")
            axes.set_ylabel(f"y of the {name} end [mm]")
            drawn.append(axes)
    bar = figure.colorbar(image, ax=drawn, shrink=0.7)
    ticks = [0.03, 0.05, 0.1, 0.2, 0.3, 0.5]
    bar.set_ticks(ticks, labels=[f"{t:g}" for t in ticks])
    bar.ax.minorticks_off()
    bar.set_label("standard error of that end: Cramer-Rao bound at 0.1 % noise [% of L]")
    return figure


def strip_bounds_figure() -> Figure:
    """Draw how well each strip's ends of one contact are known, from its own electrodes and from all."""
    sensor, contact = a_sensor(), SHAPES["hexagon"]
    l, u = footprint(sensor, contact)
    figure = new_figure(7.0, 3.9)
    left, right = add_axes(figure, 1, 2, 1), add_axes(figure, 1, 2, 2)
    draw_sensor(left, sensor)
    draw_contact(left, contact)
    schemes: tuple[Electrodes, ...] = ("own", "all")
    for electrodes, style, strong, shift in zip(schemes, ("-", "--"), (1.0, 0.5), (-0.8, 0.8), strict=True):
        bound = end_bounds(sensor, l, u, electrodes)
        for y, error, colour, name in zip((l, u), bound, (COLOURS["kl"], COLOURS["kh"]), "lu", strict=True):
            label = f"{name}, {electrodes} electrodes"
            bars = 10.0 * error / 100.0 * sensor.length_mm
            left.errorbar(sensor.x_mm + shift, y, bars, fmt="none", ecolor=colour, alpha=strong)
            right.semilogy(
                sensor.x_mm,
                error,
                {"l": "s", "u": "o"}[name] + style,
                color=colour,
                label=label,
                markersize=3.0,
            )
    left.set_title("errors, drawn 10 times as large", fontsize=9.0)
    right.set_xlabel("digital dimension x [mm]")
    right.set_ylabel("Cramer-Rao bound at 0.1 % noise [% of L]")
    right.set_ylim(0.01, 4.0)
    legend(right)
    return figure


def sheet_potentials(strip: int, l: FloatArray, u: FloatArray, sensor: Sensor | None = None) -> FloatArray:
    """Return the sheet's potentials (strips, rows + 1) [Vref] while one strip is energised, the others floating."""
    scan = crp_spans.factored_span(sensor or a_sensor(), l, u)
    nodes, t = scan.resistors, scan.resistors.strip == strip
    sheet = np.concatenate([nodes.top[t], nodes.bottom[t], nodes.centre_node.ravel()])
    top, ground, *potentials = scan.factored.fed(nodes.top[t], nodes.bottom[t], sheet)[:, 0]
    return np.reshape((np.array(potentials) - ground) / (top - ground), nodes.centre_node.shape)


def sheet_figure() -> Figure:
    """Draw the sheet while one strip is energised: with the other strips' contacts, and as if it lay alone."""
    sensor = a_sensor()
    l, u = footprint(sensor, SHAPES["hexagon"])
    alone = np.where(np.arange(sensor.strips) == _ENERGISED, 0.0, np.nan)
    both = [sheet_potentials(_ENERGISED, *ends, sensor) for ends in ((l, u), (l + alone, u + alone))]
    x = sensor.x_mm[_ENERGISED]
    figure = new_figure(7.0, 6.4)
    drawn: list[Axes] = []
    for at, (sheet, title) in enumerate(
        zip(both, ("all strips of the contact", "this strip alone"), strict=True)
    ):
        drawn.append(axes := add_axes(figure, 2, 2, at + 1))
        y = np.linspace(0.0, sensor.length_mm, sheet.shape[1])
        image = axes.pcolormesh(sensor.x_mm, y, sheet.T, vmin=0.1, vmax=0.7, cmap="coolwarm")
        axes.contour(
            sensor.x_mm, y, sheet.T, levels=np.arange(0.05, 1.0, 0.05), colors="white", linewidths=0.5
        )
        if at == 0:
            draw_contact(axes, SHAPES["hexagon"])
        axes.plot([x, x], [l[_ENERGISED], u[_ENERGISED]], color="black", linewidth=3.0)
        axes.set_aspect("equal")
        axes.set_title(title)
        axes.set_xlabel("digital dimension x [mm]")
        axes.set_ylabel("analog dimension y [mm]")
    figure.colorbar(image, ax=drawn, label="potential of the sheet over Vref")
    axes = add_axes(figure, 2, 2, (3, 4))
    looks = zip(both, ("black", COLOURS["kl"]), ("all strips", "alone"), "-:", strict=True)
    for sheet, colour, label, line in looks:
        axes.plot(
            y, sheet[_ENERGISED], line, color=colour, label=f"{label}: k_h = {sheet[_ENERGISED, -1]:.3f}"
        )
    axes.axvspan(l[_ENERGISED], u[_ENERGISED], color="#eeeeee")
    axes.set_title("along the energised strip")
    axes.set_xlabel("y [mm]")
    axes.set_ylabel("potential of the sheet over Vref")
    legend(axes)
    return figure


FIGURES: dict[str, Callable[[], Figure]] = {
    "crp_error_map": error_map_figure,
    "crp_strip_bounds": strip_bounds_figure,
    "crp_sheet": sheet_figure,
}
