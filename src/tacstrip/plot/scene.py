"""The sensor from above: its strips, what touched it, what was recovered (numbered, coloured), and the signatures."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
import shapely
from matplotlib.axes import Axes
from matplotlib.colors import to_hex, to_rgba
from matplotlib.patches import Polygon, Rectangle
from matplotlib.ticker import MaxNLocator

from tacstrip.arrays import FloatArray
from tacstrip.contact.shape import Contact
from tacstrip.plot.theme import COLOURS, DASHES, MARKERS, OTHERS, RECOVERED, SENSOR, STRIP, TRUE, themed
from tacstrip.reconstruction.result import Reconstruction, RecoveredObject
from tacstrip.scan import Scan
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.spec import Sensor

_MOST_STRIPS = 120  # more are drawn as one area
_TICK_INCH, _DIGIT_INCH = 0.1, 0.08  # between two strips' numbers, at least
_MOST_MARKED = 150  # touched strips that have a marker each
_MEANT = {"kh": "upper end", "kl": "lower end", "k": "metal sheet"}
_MOST_NAMED = 8  # objects with an entry of their own in the legend


def draw_sensor(axes: Axes, sensor: Sensor) -> None:
    """Draw the sensor's outline and strips, and name the axes."""
    width, length = sensor.width_mm, sensor.length_mm
    axes.add_patch(Rectangle((0.0, 0.0), width, length, facecolor=SENSOR, edgecolor="none", zorder=0))
    if sensor.strips <= _MOST_STRIPS and sensor.strip_width == sensor.pitch_mm:
        sides = np.arange(1, sensor.strips) * sensor.pitch_mm
        axes.vlines(sides, 0.0, length, color=STRIP, linewidth=0.6, zorder=0.5)
    elif sensor.strips <= _MOST_STRIPS:
        for x in sensor.x_mm:
            corner, wide = (x - sensor.strip_width / 2.0, 0.0), sensor.strip_width
            axes.add_patch(Rectangle(corner, wide, length, facecolor=STRIP, edgecolor="none", zorder=0.5))
    margin = 0.02 * max(width, length)
    axes.set(xlim=(-margin, width + margin), ylim=(-margin, length + margin), aspect="equal")
    axes.set(xlabel=x_label(sensor), ylabel="along the strips y [mm]")


def fill_sheet(axes: Axes, sensor: Sensor | None = None) -> None:
    """Show millimetres across and along alike, and as much around the limits as the sheet has room for.

    To be called when all is drawn and the limits are set. What is shown besides lies on the sensor, as far as it goes.
    """
    _ = axes.viewLim  # what autoscaling was asked for by artists is done with
    if sensor is not None:
        (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
        spare = (y1 - y0) * axes.bbox.width / axes.bbox.height - (x1 - x0)
        if spare > 0.0:
            left = min(max(x0 - 0.5 * spare, -sensor.pitch_mm), x0)
            right = max(min(left + x1 - x0 + spare, sensor.width_mm + sensor.pitch_mm), x1)
            axes.set_xlim(max(min(left, right - (x1 - x0) - spare), -sensor.pitch_mm), right)
    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    # Else what lies beyond the data (a legend) may be cut.
    axes.dataLim.set_points(np.array([(x0, y0), (x1, y1)]))
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_autoscale_on(True)  # else Matplotlib warns that it widens limits


def number_strips(axes: Axes, sensor: Sensor) -> None:
    """Write the strips' numbers, as the user counts them, above axes whose x is in mm."""
    base, pitch = sensor.strip_base, sensor.pitch_mm

    def number(x_mm: Any) -> Any:
        return x_mm / pitch - 0.5 + base

    def place(strip: Any) -> Any:
        return (strip - base + 0.5) * pitch

    with themed():
        top = axes.secondary_xaxis("top", functions=(number, place))
        top.xaxis.set_major_locator(_Strips(base, base + sensor.strips - 1))
        top.set_xlabel("strip", labelpad=2.0)
        top.tick_params(length=2.0, pad=1.0)
        top.spines["top"].set_visible(False)


class _Strips(MaxNLocator):
    """Ticks at whole numbers from the first strip to the last, as many as fit."""

    def __init__(self, first: int, last: int) -> None:
        super().__init__(nbins=8, integer=True, min_n_ticks=1)
        self.first, self.last = first, last

    def tick_values(self, vmin: float, vmax: float) -> Sequence[float]:
        """Return those within the view that are strips."""
        low, high = max(vmin, self.first), min(vmax, self.last)
        axes: Any = self.axis.axes  # type: ignore[union-attr]
        inches = axes.bbox.width / axes.figure.dpi * (high - low) / max(vmax - vmin, 1e-9)
        least = _TICK_INCH + _DIGIT_INCH * len(str(self.last))
        self.set_params(nbins=int(min(max(inches / least, 1), 8)))
        return [at for at in super().tick_values(low, high) if self.first <= at <= self.last]


def x_label(sensor: Sensor, flat: str = "across the strips x [mm]") -> str:
    """Name the x axis: on a tube x runs along the arc."""
    return "arc length x [mm]" if sensor.kind.cylindrical else flat


def draw_contact(axes: Axes, contact: Contact, label: str | None = None, colour: str = TRUE) -> None:
    """Draw what touches: areas shaded, lines and points in full."""
    for shape in contact.shapes:
        xy = shapely.get_coordinates(shape)
        if shape.geom_type == "Polygon":
            for ring in shapely.get_rings(shape):
                outline = shapely.get_coordinates(ring)
                axes.add_patch(Polygon(outline, facecolor=colour, alpha=0.18, edgecolor="none", zorder=1))
                axes.plot(*outline.T, color=colour, linewidth=1.0, label=label, zorder=2)
                label = None
        else:
            axes.plot(*xy.T, "o-", color=colour, markersize=3.0, linewidth=1.0, label=label, zorder=2)
        label = None


def draw_polygon(
    axes: Axes,
    vertices: npt.ArrayLike,
    colour: str,
    label: str | None = None,
    dashed: bool = False,
    status: str = "ok",
    alpha: float = 1.0,
) -> None:
    """Draw a recovered polygon's outline and corners; a raw profile's many corners stay unmarked.

    A doubtful one is dashed on white, with hollow corners: dashes alone vanish on the true shape's line.
    """
    ring, doubtful = np.asarray(vertices, dtype=float), status not in ("ok", "likely")
    ring = np.concatenate([ring, ring[:1]])
    marker = "o" if len(ring) < 25 else ""
    axes.plot(
        *ring.T, color=colour, linestyle="--" if dashed or doubtful else "-", marker=marker,
        markersize=4.5 if doubtful else 3.0, markerfacecolor="white" if doubtful else colour, linewidth=1.3,
        label=label, zorder=4, alpha=alpha,
    )  # fmt: skip
    if doubtful:  # a whole white line lies under the dashes
        axes.plot(*ring.T, color="white", linewidth=2.6, zorder=3.9)


def draw_piece(axes: Axes, piece: RecoveredObject, colour: str, label: str | None = None) -> None:
    """Draw a piece: edges that are seen in full, hidden ones dashed with hollow corners, its bounds dotted."""
    assert piece.hidden is not None
    assert piece.hidden_edges is not None
    for bound in piece.bounds or ():
        axes.plot(*np.concatenate([bound, bound[:1]]).T, ":", color=colour, linewidth=0.8, zorder=3.5)
    ring = np.concatenate([piece.vertices, piece.vertices[:1]])
    for i, unseen in enumerate(piece.hidden_edges):
        axes.plot(
            *ring[i : i + 2].T, "--" if unseen else "-", color=colour, linewidth=1.3, label=label, zorder=4
        )
        label = None
    if len(ring) < 25:
        for unseen, face in ((False, colour), (True, "white")):
            at = piece.vertices[piece.hidden == unseen]
            axes.plot(*at.T, "o", color=colour, markersize=3.5, markerfacecolor=face, zorder=4.1)


def draw_regions(axes: Axes, sensor: Sensor, found: Iterable[FloatArray], colour: str) -> None:
    """Draw the regions (K, 2) [mm] of corners, convex, as far as they lie on the sensor."""
    surface = shapely.box(0.0, 0.0, sensor.width_mm, sensor.length_mm)
    for region in found:
        # One larger than the sensor says only that nothing is known: its edges would be rays across the picture.
        large = bool((np.ptp(region, axis=0) > (sensor.width_mm, sensor.length_mm)).any())
        seen = shapely.intersection(shapely.convex_hull(shapely.MultiPoint(region)), surface)
        if seen.geom_type == "Polygon" and not seen.is_empty:
            face = to_rgba(colour, 0.08 if large else 0.25)
            edge = "none" if large else to_rgba(colour, 0.5)  # paler than an outline: a thin one is no edge
            xy = shapely.get_coordinates(seen)
            axes.add_patch(Polygon(xy, facecolor=face, edgecolor=edge, linewidth=0.6, zorder=3))


def draw_signatures(
    axes: Axes,
    sensor: Sensor,
    scan: Scan,
    names: Iterable[str] | None = None,
    style: str | None = None,
    of_vref: bool = False,
    **options: Any,
) -> None:
    """Draw the pseudo-signatures k L [mm] of a scan over x (4.1), or the readings k over Vref.

    Without a `style` each signature has a marker of its own or, where many strips are touched, dashes.
    """
    many = int(scan.touched.sum()) > _MOST_MARKED
    for name in scan.signatures if names is None else names:
        symbol = SIGNATURES[name].symbol
        label = f"${symbol}$, {_MEANT[name]}" if of_vref else f"${symbol} L$"
        look: dict[str, Any] = {"color": COLOURS[name], "markersize": 3.0, "linewidth": 0.9, "zorder": 3}
        if style is None:
            face = "white" if name == "kl" else COLOURS[name]
            look |= (
                {"linestyle": DASHES[name]} if many else {"marker": MARKERS[name], "markerfacecolor": face}
            )
        k = scan[name] if of_vref else scan[name] * sensor.length_mm
        axes.plot(sensor.x_mm, k, *([style] if style else []), label=label, **look | options)


def zoom(axes: Axes, points: npt.ArrayLike, sensor: Sensor, share: float = 0.25) -> None:
    """Show the neighbourhood of points (N, 2) [mm] instead of the whole sensor."""
    x, y = neighbourhood(points, sensor, share)
    axes.set_xlim(*x)
    axes.set_ylim(*y)


def neighbourhood(
    points: npt.ArrayLike, sensor: Sensor, share: float = 0.25
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the spans of x and y that `zoom` shows [mm]."""
    xy = np.asarray(points, dtype=float).reshape(-1, 2)
    xy = xy[np.isfinite(xy).all(axis=1)]
    low, high = xy.min(axis=0), xy.max(axis=0)
    margin = share * (high - low).max() + 2.0 * sensor.pitch_mm
    return (
        (max(low[0] - margin, -sensor.pitch_mm), min(high[0] + margin, sensor.width_mm + sensor.pitch_mm)),
        (low[1] - margin, high[1] + margin),
    )


@dataclass(frozen=True)
class LabelledObject:
    """One object to draw.

    Attributes
    ----------
    found
        The object.
    number
        What is written on it: its number from 1, left to right; with several scans the scan's, as "3" or "3.1". Empty
        for a single object.
    colour
        Its own; its scan's if there are several; its method's if methods are compared.
    label
        Its entry in the legend; None where an entry with the same text exists.
    """

    found: RecoveredObject
    number: str
    colour: str
    label: str | None

    def place(self, sensor: Sensor) -> tuple[float, float]:
        """Return where the number stands [mm]."""
        if self.found.found:
            x, y = self.found.centroid
            return float(x), float(y)
        strips = self.found.strips
        return 0.5 * (strips.start + strips.stop) * sensor.pitch_mm, 0.5 * sensor.length_mm


def labelled_objects(
    results: Mapping[str, Sequence[Reconstruction]],
    shown: Sequence[int],
    numbers: Sequence[int] | None = None,
) -> list[LabelledObject]:
    """Return the objects of the scans that are shown, method by method.

    `numbers` are the objects' own where they were followed from frame to frame; else they count from left to right.
    """
    palette = (RECOVERED, *OTHERS)
    several = len(shown) > 1
    every = [
        (method, name, order, i, k if numbers is None else numbers[k], found)
        for method, (name, reconstructions) in enumerate(results.items())
        for order, i in enumerate(shown)
        for k, found in enumerate(reconstructions[i].objects)
    ]
    labelled: list[LabelledObject] = []
    labels: set[str] = set()
    for method, name, order, i, k, found in every:
        if len(results) > 1:
            colour = palette[method % len(palette)]
        elif several:  # from dark to light over time; the lightest would be invisible
            colour = to_hex(mpl.colormaps["viridis"](0.85 * order / (len(shown) - 1)))
        else:
            colour = palette[k % len(palette)]
        own = f"{k + 1}" if len(results[name][i].objects) > 1 else ""
        number = (f"{i}.{own}" if own else f"{i}") if several else own
        named = f"{name} {own}" if own and not several and len(every) <= _MOST_NAMED else name
        strips = ", strip by strip" if not found.found and found.profile is not None else ""
        label = f"{named}: {found.status}{strips}"
        labelled.append(LabelledObject(found, number, colour, None if label in labels else label))
        labels.add(label)
    return labelled
