"""What a drawn figure shows, for several test files."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray


def draw(figure: Figure) -> NDArray[np.uint8]:
    """Lay a figure out and return its pixels (height, width, 4), the top row first."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # type: ignore[no-untyped-call]
    return np.asarray(canvas.buffer_rgba())  # type: ignore[no-untyped-call]


def legend_of(figure: Figure) -> list[str]:
    """Return the lines of a figure's own legend."""
    return [text.get_text() for text in figure.legends[0].get_texts()]


def check_above(figure: Figure, axes: Axes | None = None) -> None:
    """Check that the legend of axes, by default of the last ones, lies above all lines."""
    draw(figure)
    axes = figure.axes[-1] if axes is None else axes
    legend = axes.get_legend()
    assert legend is not None
    top = max(np.nanmax(axes.transData.transform(line.get_xydata())[:, 1]) for line in axes.lines)
    assert legend.get_window_extent().y0 > top
