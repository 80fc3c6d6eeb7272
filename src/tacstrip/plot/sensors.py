"""A sensor from above, and what touches it."""

from __future__ import annotations

import shapely
from matplotlib.axes import Axes

from tacstrip.arguments import takes
from tacstrip.contact.shape import Contact
from tacstrip.plot.layers import draw_layers
from tacstrip.plot.scene import draw_contact, draw_sensor, fill_sheet, number_strips
from tacstrip.plot.theme import axes_or_new, legend_above
from tacstrip.sensor.layers import AnySensor, LayeredSensor
from tacstrip.sensor.spec import Sensor

_WIDE, _SLIM = 5.0, 3.4  # of a picture [inch], the latter ...
_NARROW = 1.6  # ... of a sensor so many times as long as wide
_HIGH = (2.6, 5.6)
_MARGIN = 0.15  # of a contact's extent


@takes(sensor=Sensor | LayeredSensor)
def sensor(sensor: AnySensor, *, ax: Axes | None = None) -> Axes:
    """Draw a sensor from above, its strips numbered as its files number them; a curved skin unrolled.

    Parameters
    ----------
    sensor
        The sensor, of one layer or two.
    ax
        Axes to draw into; None: new ones on a figure of their own (`ax.figure`), which pyplot does not know of.

    Returns
    -------
    Axes
        x runs across the strips, y along them [mm]; of two layers both are those of the whole.

    Examples
    --------
    >>> import tacstrip as ts
    >>> from tacstrip import plot
    >>> ax = plot.sensor(ts.Sensor.load("prototype-crs-crs"))
    >>> ax.get_xlabel()
    'across the strips x [mm]'
    """
    axes = axes_with_sensor(sensor, ax)
    fill_sheet(axes)
    return axes


@takes(contact=Contact, sensor=Sensor | LayeredSensor)
def contact(contact: Contact, sensor: AnySensor | None = None, *, ax: Axes | None = None) -> Axes:
    """Draw what touches: areas shaded, lines and points in full.

    Parameters
    ----------
    contact
        What touches.
    sensor
        The sensor to draw below it; None: the contact alone, or on what the axes show already.
    ax
        Axes to draw into; None: new ones on a figure of their own.

    Returns
    -------
    Axes
        x across the strips and y along them [mm].

    Examples
    --------
    >>> import tacstrip as ts
    >>> from tacstrip import plot
    >>> pen = ts.Contact.line([(12, 20), (48, 90)])
    >>> ax = plot.contact(pen, ts.Sensor(construction="crs-m", strips=12, pitch_mm=5.0, length_mm=120.0))
    >>> [text.get_text() for text in ax.get_legend().get_texts()]
    ['what touches']
    """
    if sensor is not None:
        axes = axes_with_sensor(sensor, ax)
    else:
        axes = axes_or_new(ax)
        if ax is None or not ax.has_data():
            x0, y0, x1, y1 = shapely.GeometryCollection(list(contact.shapes)).bounds
            margin = _MARGIN * max(x1 - x0, y1 - y0) or 1.0
            axes.set(xlim=(x0 - margin, x1 + margin), ylim=(y0 - margin, y1 + margin))
            axes.set(xlabel="x [mm]", ylabel="y [mm]")
    draw_contact(axes, contact, label="what touches")
    legend_above(axes)
    fill_sheet(axes)
    return axes


def axes_with_sensor(sensor: AnySensor, ax: Axes | None) -> Axes:
    """Return axes with a sensor in them, to draw more into."""
    axes = axes_or_new(ax, *_sheet(sensor))
    if isinstance(sensor, LayeredSensor):
        draw_layers(axes, sensor)
    else:
        draw_sensor(axes, sensor)
        number_strips(axes, sensor)
    return axes


def _sheet(sensor: AnySensor) -> tuple[float, float]:
    """Return how wide and high a picture of a sensor is [inch]."""
    first = sensor.layers[0].sensor if isinstance(sensor, LayeredSensor) else sensor
    wide = _WIDE if first.length_mm < _NARROW * first.width_mm else _SLIM
    low, high = _HIGH
    return wide, float(min(max(wide * first.length_mm / first.width_mm, low), high))
