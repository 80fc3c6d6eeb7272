"""Readings strip by strip."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes

from tacstrip.arguments import takes
from tacstrip.plot.scene import draw_signatures, number_strips, x_label
from tacstrip.plot.theme import TRUE, axes_or_new, legend_above
from tacstrip.scan import Scan
from tacstrip.sensor.layers import AnySensor, LayeredSensor, unit_of
from tacstrip.sensor.spec import Sensor

MOST_SCANS = 6  # more lines than these hide each other


@takes(scan=(Scan, Scan), sensor=Sensor | LayeredSensor)
def scan(scan: Scan | Sequence[Scan], sensor: AnySensor, *, ax: Axes | None = None) -> Axes:
    """Draw what each strip read, one line a signature; of many scans six, spread over all, earlier ones paler.

    Parameters
    ----------
    scan
        A scan, or several in the order of time, of which the title says how many are drawn.
    sensor
        That made them.
    ax
        Axes to draw into; None: new ones on a figure of their own.

    Returns
    -------
    Axes
        x across the strips [mm], with the strips' numbers above; readings over Vref.

    Raises
    ------
    ReadingError, SignatureError
        The sensor cannot have made the scan.

    Examples
    --------
    >>> import tacstrip as ts
    >>> from tacstrip import plot
    >>> sensor = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0)
    >>> coin = ts.Contact.polygon([(30, 40), (60, 35), (70, 60), (40, 70)])
    >>> ax = plot.scan(ts.simulate(sensor, coin), sensor)
    >>> [text.get_text() for text in ax.get_legend().get_texts()]
    ['$k_h$, upper end', '$k_l$, lower end']
    """
    scans = [scan] if isinstance(scan, Scan) else list(scan)
    unit = unit_of(sensor)
    for one in scans:
        one.check(unit)
    touched = [i for i, one in enumerate(scans) if one.touched.any()]
    shown = spread(touched, MOST_SCANS)
    axes = axes_or_new(ax, 5.0, 3.4)
    entries = None
    for order, i in enumerate(shown):
        faint = 1.0 if len(shown) == 1 else 0.3 + 0.7 * order / (len(shown) - 1)
        draw_signatures(axes, unit, scans[i], of_vref=True, alpha=faint)
        entries = entries or axes.get_legend_handles_labels()
    if entries and shown:
        handles, labels = axes.get_legend_handles_labels()
        # Of the last scan, which is not pale.
        entries = (handles[-len(entries[0]) :], labels[: len(entries[0])])
    axes.set(xlabel=x_label(unit), ylabel="reading [parts of Vref]", xlim=(0.0, unit.width_mm))
    if isinstance(sensor, LayeredSensor):
        border = sensor.slices[1].start * unit.pitch_mm
        axes.axvline(border, color=TRUE, linewidth=0.8, linestyle=":")
        axes.set_xlabel("strips of layer 0, then of layer 1, times the pitch [mm]")
    number_strips(axes, unit)
    if not shown:
        say_nothing(axes, "no strip is touched")
    elif entries:
        legend_above(axes, handles=entries[0], labels=entries[1])
    if why := how_many_drawn(shown, touched, scans):
        axes.set_title(why)
    return axes


def spread(numbers: Sequence[int], most: int) -> list[int]:
    """Return at most so many of the numbers, evenly spread, the first and the last among them."""
    count = min(most, len(numbers))
    return [numbers[round(i * (len(numbers) - 1) / max(count - 1, 1))] for i in range(count)]


def how_many_drawn(shown: Sequence[int], touched: Sequence[int], scans: Sequence[object]) -> str:
    """Say how many of the scans are drawn; "" where all are."""
    if len(shown) == len(touched):
        return ""
    return f"{len(shown)} of {len(touched)} scans{'' if len(touched) == len(scans) else ' in contact'}"


def say_nothing(axes: Axes, why: str) -> None:
    """Write in the middle of axes why nothing is drawn."""
    axes.text(0.5, 0.5, why, transform=axes.transAxes, ha="center", va="center", color=TRUE)
