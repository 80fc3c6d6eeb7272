"""What a drawn figure shows, for several test files."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
import shapely
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text
from numpy.typing import NDArray
from shapely.affinity import rotate, translate


def draw(figure: Figure) -> NDArray[np.uint8]:
    """Lay a figure out and return its pixels (height, width, 4), the top row first."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # type: ignore[no-untyped-call]
    return np.asarray(canvas.buffer_rgba())  # type: ignore[no-untyped-call]


def legend_of(figure: Figure) -> list[str]:
    """Return the lines of a figure's own legend."""
    return [text.get_text() for text in figure.legends[0].get_texts()]


def drawn_texts(figure: Figure) -> list[tuple[str, shapely.Polygon]]:
    """Draw a figure and return the texts in it, with their places [px]; ticks outside of the view are not drawn."""
    found: list[tuple[str, shapely.Polygon]] = []
    drawing = Text.draw

    def record(self: Text, renderer: Any) -> None:
        if self.get_visible() and self.get_text().strip():
            turned = self.get_rotation()
            middle = shapely.box(*self.get_window_extent(renderer).extents).centroid
            self.set_rotation(0.0)
            x0, y0, x1, y1 = self.get_window_extent(renderer).extents
            self.set_rotation(turned)
            flat = translate(
                shapely.box(x0, y0, x1, y1), middle.x - 0.5 * (x0 + x1), middle.y - 0.5 * (y0 + y1)
            )
            found.append((self.get_text(), rotate(flat, turned)))
        drawing(self, renderer)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Text, "draw", record)
        figure.draw_without_rendering()
    return found


def check_texts(figure: Figure) -> None:
    """Check that no text lies over another, and that none is cut off by the figure's edge."""
    texts = drawn_texts(figure)
    sheet = shapely.box(*figure.bbox.extents).buffer(1.0)
    for text, place in texts:
        assert sheet.contains(place), f"{text!r} is cut off"
    within = [(text, place.buffer(-0.5)) for text, place in texts]
    for (one, a), (other, b) in itertools.combinations(within, 2):
        assert not a.intersects(b), f"{one!r} over {other!r}"


def check_above(figure: Figure, axes: Axes | None = None) -> None:
    """Check that the legend of axes, by default of the last ones, lies above all lines."""
    figure.draw_without_rendering()
    axes = figure.axes[-1] if axes is None else axes
    legend = axes.get_legend()
    assert legend is not None
    top = max(np.nanmax(axes.transData.transform(line.get_xydata())[:, 1]) for line in axes.lines)
    assert legend.get_window_extent().y0 > top
