"""One look for all pictures: headless figures, colours, how a figure is saved.

Figures are made without pyplot, so that no display, no global state and no leak of open figures is involved.
"""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator, NullFormatter, NullLocator

from tacstrip.errors import OptionError
from tacstrip.files import replacing

ENDINGS = (".png", ".svg", ".pdf")
TRUE = "#555555"  # the shape that touched
SENSOR = "#e6e2d8"
STRIP = "#cfc8b8"
COLOURS = {"kh": "#c1440e", "kl": "#1f5fa8", "k": "#2a7f3f", "profile": "#7a3e9d", "geometric": "#333333"}
RECOVERED = "#c1440e"
OTHERS = ("#1f5fa8", "#2a7f3f", "#7a3e9d", "#b8860b")

_RC: dict[Any, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.7,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "lines.linewidth": 1.2,
}


def new_figure(width_inch: float = 5.0, height_inch: float = 4.2) -> Figure:
    """Return an empty figure in the project's style, drawn by Agg."""
    with mpl.rc_context(_RC):
        figure = Figure(figsize=(width_inch, height_inch), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def new_axes(width_inch: float = 5.0, height_inch: float = 4.2) -> tuple[Figure, Axes]:
    """Return a figure with one set of axes."""
    figure = new_figure(width_inch, height_inch)
    return figure, add_axes(figure, 1, 1, 1)


def new_panels(
    width_inch: float, height_inch: float, rows: int, columns: int
) -> tuple[Figure, tuple[Axes, ...]]:
    """Return a figure with a grid of axes, row by row."""
    figure = new_figure(width_inch, height_inch)
    return figure, tuple(add_axes(figure, rows, columns, i + 1) for i in range(rows * columns))


def add_axes(figure: Figure, rows: int, columns: int, index: int | tuple[int, int], **options: Any) -> Axes:
    """Add axes in the project's style to a grid of a figure, over one or more cells, as `Figure.add_subplot` does."""
    with mpl.rc_context(_RC):
        axes = figure.add_subplot(rows, columns, index, **options)
    assert isinstance(axes, Axes)
    return axes


def check_picture(path: str | Path) -> None:
    """Refuse a picture's file whose ending is no known kind, before any work is done for it.

    Raises
    ------
    OptionError
        The message lists the endings.
    """
    if Path(path).suffix.lower() not in ENDINGS:
        raise OptionError(f"{path}: a picture is a file that ends in {', '.join(ENDINGS)}")


def save(figure: Figure, path: str | Path, dpi: int = 110) -> Path:
    """Write a figure, its format by the file's ending, and make the folder if it is missing."""
    check_picture(path)
    file = Path(path)
    file.parent.mkdir(parents=True, exist_ok=True)
    kind = file.suffix[1:].lower()
    with mpl.rc_context(_RC), warnings.catch_warnings(), replacing(file) as part:
        warnings.simplefilter("ignore", UserWarning)  # a layout too tight for its labels is still a picture
        if (
            kind == "png"
        ):  # laid out here and printed, for `savefig` would draw the whole figure once more for it
            figure.set_dpi(dpi)
            if layout := figure.get_layout_engine():
                layout.execute(figure)
                figure.set_layout_engine("none")
            FigureCanvasAgg(figure).print_png(part, metadata={"Software": None})  # type: ignore[no-untyped-call]
        else:
            figure.savefig(part, dpi=dpi, format=kind)
    return file


def legend(axes: Axes, **options: Any) -> None:
    """Add a legend without a frame; options as for `Axes.legend`."""
    axes.legend(**{"frameon": False, "fontsize": 8.0, "loc": "best"} | options)


def legend_above(axes: Axes, columns: int = 2, **options: Any) -> None:
    """Add a legend inside the axes above all that is drawn, in room made for it; options as for `legend`."""
    entries = len(options.get("labels") or axes.get_legend_handles_labels()[1])
    assert isinstance(axes.figure, Figure)
    height = axes.get_position().height * axes.figure.get_size_inches()[1]
    share = min((0.2 * math.ceil(entries / columns) + 0.1) / height, 0.6)
    scale = axes.yaxis.get_transform()  # a logarithmic axis too
    low, high = scale.transform(axes.get_ylim())
    axes.set_ylim(top=float(scale.inverted().transform(low + (high - low) / (1.0 - share))))
    legend(axes, loc="upper left", ncols=columns, **options)


def plain_ticks(axis: Axis) -> None:
    """Write 0.34, not 3.4 x 10^-1, and thin the ticks between the powers of ten where they would touch."""
    plain = FuncFormatter(lambda value, _: f"{value:.6g}")
    low, high = axis.get_view_interval()
    if high < 10.0 * low:  # no more than one power of ten within: even steps read better
        axis.set_major_locator(MaxNLocator(6))
        axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(plain)
    axis.set_minor_formatter(NullFormatter())
