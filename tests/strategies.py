"""Hypothesis strategies that several test files share; every draw is the same in every run."""

from __future__ import annotations

import numpy as np
import shapely
from hypothesis import settings
from hypothesis import strategies as st

from tacstrip.arrays import FloatArray
from tacstrip.contact.shape import Contact
from tacstrip.sensor.constructions import CONSTRUCTIONS
from tacstrip.sensor.spec import Sensor

FIXED = settings(derandomize=True, deadline=None, max_examples=50)


def texts(max_size: int | None = None) -> st.SearchStrategy[str]:
    """Any text. Not `st.text()`: its first use in a process encodes every character there is, for seconds."""
    beyond = st.integers(0x80, 0x10FFFF - 0x800).map(
        lambda code: code + 0x800 * (code >= 0xD800)
    )  # no surrogates
    return st.lists(st.integers(0, 0x7F).map(chr) | beyond.map(chr), max_size=max_size).map("".join)


def ratios() -> st.SearchStrategy[float]:
    """Resistivity ratios over four decades, equal strips among them."""
    return st.one_of(st.just(1.0), st.floats(-2.0, 2.0).map(lambda e: 10.0**e))


@st.composite
def spans(draw: st.DrawFn, length: float, margin: float = 0.0) -> tuple[float, float]:
    """Draw (l, w) of a contact on a strip, `margin` away from both ends."""
    room = length - 2.0 * margin
    w = draw(st.floats(0.0, 1.0)) * room
    return margin + draw(st.floats(0.0, 1.0)) * (room - w), w


@st.composite
def sensors(draw: st.DrawFn, construction: str | None = None, most_strips: int = 10_000) -> Sensor:
    """Draw any sensor that may be, with every key that its construction has set or unset."""
    name = construction or draw(st.sampled_from(sorted(CONSTRUCTIONS)))
    kind = CONSTRUCTIONS[name]
    size = st.floats(1e-3, 1e4)
    strips, pitch, vref = draw(st.integers(1, most_strips)), draw(size), draw(st.floats(0.1, 48.0))
    length = draw(size)
    decay = st.floats(1e-3, 1.0).map(lambda part: part * length)
    width = draw(st.none() | st.floats(0.01, 1.0).map(lambda part: part * pitch))
    rest = draw(st.none() | st.floats(0.0, 1.0).map(lambda part: part * vref))
    around = draw(st.floats(1.0, 4.0))  # the tube's circumference over the strips' extent
    return Sensor(
        construction=name,
        strips=strips,
        pitch_mm=pitch,
        length_mm=length,
        strip_width_mm=width,
        radius_mm=around * strips * pitch / (2.0 * np.pi) if "radius_mm" in kind.keys else None,
        resistivity_ratio=draw(ratios()) if "resistivity_ratio" in kind.keys else 1.0,
        contact_lambda_mm=draw(decay if "contact_lambda_mm" in kind.required else st.just(0.0) | decay),
        vref_volt=vref,
        adc_bits=draw(st.none() | st.integers(1, 32)),
        rest_volt=rest,
        touch_volt=None if rest is None else draw(st.floats(1e-6, 0.5)) * vref,
        strip_base=draw(st.integers(0, 1)),
    )


@st.composite
def star_polygons(
    draw: st.DrawFn, centre: tuple[float, float], radius: float, most: int = 9, step: float = 0.0
) -> FloatArray:
    """Draw corners (N, 2) of a polygon about a centre, convex or not; on a grid of `step` if given."""
    n = draw(st.integers(3, most))
    part = st.lists(st.integers(0, 996), min_size=n, max_size=n).map(lambda parts: np.array(parts) / 997.0)
    angle = (np.arange(n) + 0.9 * draw(part)) * 2.0 * np.pi / n
    reach = radius * (0.1 + 0.9 * draw(part))
    corners = np.stack((centre[0] + reach * np.cos(angle), centre[1] + reach * np.sin(angle)), axis=1)
    return np.round(corners / step) * step if step else corners


@st.composite
def areas(
    draw: st.DrawFn,
    box: tuple[float, float, float, float],
    most_shapes: int = 3,
    step: float = 0.0,
    convex: bool = False,
) -> Contact:
    """Draw a contact of one to several polygons with centres in a box, which may overlap one another."""
    x0, y0, x1, y1 = box
    contact: Contact | None = None
    for _ in range(draw(st.integers(1, most_shapes))):
        cx, cy, radius = (draw(st.integers(0, 1000)) / 1009.0 for _ in range(3))
        centre = (x0 + cx * (x1 - x0), y0 + cy * (y1 - y0))
        corners = draw(star_polygons(centre, (0.1 + 0.5 * radius) * min(x1 - x0, y1 - y0), step=step))
        polygon = shapely.Polygon(corners)
        if convex or not polygon.is_valid:  # rounding to a grid can make sides cross
            polygon = shapely.convex_hull(polygon)
        if polygon.area == 0.0:
            polygon = shapely.box(*np.floor(centre), *(np.floor(centre) + 4.0))
        shape = Contact.polygon(shapely.get_coordinates(polygon))
        contact = shape if contact is None else contact + shape
    assert contact is not None
    return contact
