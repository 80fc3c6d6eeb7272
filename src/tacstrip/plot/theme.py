"""The look of all pictures: palette, styles, headless figures, how a figure is saved.

Figures are made without pyplot, so that no display, no global state and no leak of open figures is involved.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator, NullFormatter, NullLocator

from tacstrip.errors import ArgumentError, OptionError, one_of
from tacstrip.files import replacing

ENDINGS = (".png", ".svg", ".pdf")
# Okabe and Ito's colours, which all kinds of colour vision tell apart, darkened where lines would be faint on the skin;
# markers and dashes tell them apart in grey.
_BLUE, _VERMILION, _GREEN, _PURPLE, _ORANGE = "#0072b2", "#cc5500", "#007d5c", "#aa4499", "#806000"
TRUE = "#555555"  # the shape that touched
SENSOR = "#e6e2d8"
STRIP = "#cfc8b8"
COLOURS = {"kh": _VERMILION, "kl": _BLUE, "k": _GREEN, "profile": _PURPLE, "geometric": "#333333"}
MARKERS = {"kh": "o", "kl": "s", "k": "^"}
DASHES = {"kh": "-", "kl": "--", "k": "-."}
RECOVERED = _VERMILION
OTHERS = (_BLUE, _GREEN, _PURPLE, _ORANGE)
SCREEN_DPI = 120
# Shown 600 pixels wide, as on a page, the smallest letters (8 points) of a figure of this width are 9 pixels high.
WIDEST = 7.0  # inch

_SCREEN: dict[Any, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.7,
    "figure.dpi": SCREEN_DPI,
    "savefig.dpi": SCREEN_DPI,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "lines.linewidth": 1.2,
}
STYLES: dict[str, dict[Any, Any]] = {
    "screen": _SCREEN,
    # A journal's column is 85 mm wide and wants 7 to 8 points, fonts embedded, and 300 dots an inch or more.
    "print": _SCREEN
    | {
        "font.size": 7.5,
        "axes.titlesize": 8.0,
        "axes.linewidth": 0.5,
        "figure.dpi": 300,
        "savefig.dpi": 300,
        "legend.fontsize": 7.0,
        "lines.linewidth": 1.0,
        "pdf.fonttype": 42,
    },
}
_ON_WHITE = {
    "frameon": True,
    "facecolor": "white",
    "edgecolor": "none",
    "framealpha": 0.75,
    "fancybox": False,
}
_WIDTH = {"screen": 1.0, "print": 0.67}  # of a figure, by style
_current: ContextVar[str] = ContextVar("tacstrip_plot_style", default="screen")


@contextmanager
def style(name: str = "screen") -> Iterator[None]:
    """Draw in one of two styles as long as the block lasts.

    Within it, axes that you make with Matplotlib have the style too. After it Matplotlib's settings are as before.

    Parameters
    ----------
    name
        "screen", as without a `with`; or "print": one column of a paper (85 mm), smaller letters, finer lines, 300
        dots an inch, fonts embedded.

    Raises
    ------
    OptionError
        There is no such style.

    Examples
    --------
    >>> import tacstrip as ts
    >>> from tacstrip import plot
    >>> with plot.style("print"):
    ...     ax = plot.sensor(ts.Sensor.load("simulated-crs-crs"))
    >>> round(float(ax.figure.get_size_inches()[0]), 2)
    3.35
    """
    if name not in STYLES:
        raise OptionError(one_of("style", name, STYLES))
    token = _current.set(name)
    try:
        with themed():
            yield
    finally:
        _current.reset(token)


def themed() -> Any:
    """Return a context in which Matplotlib makes artists in the current style."""
    return mpl.rc_context(STYLES[_current.get()])


def new_figure(width_inch: float = 5.0, height_inch: float = 4.2, widest: float = WIDEST) -> Figure:
    """Return an empty figure in the current style, drawn by Agg, and not wider than the letters allow."""
    scale = _WIDTH[_current.get()]
    with themed():
        figure = Figure(figsize=(scale * min(width_inch, widest), scale * height_inch), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def new_axes(width_inch: float = 5.0, height_inch: float = 4.2) -> tuple[Figure, Axes]:
    """Return a figure with one set of axes."""
    figure = new_figure(width_inch, height_inch)
    return figure, add_axes(figure, 1, 1, 1)


def axes_or_new(ax: Axes | None, width_inch: float = 5.0, height_inch: float = 4.2, **options: Any) -> Axes:
    """Return the axes that a caller gave, or new ones on a figure of their own; options as of `Figure.add_subplot`.

    Raises
    ------
    ArgumentError
        It is no Axes, or not of the projection that the options want.
    """
    if ax is None:
        return add_axes(new_figure(width_inch, height_inch), 1, 1, 1, **options)
    if not isinstance(ax, Axes):
        raise ArgumentError(
            f"ax is a {type(ax).__name__}, not Matplotlib's Axes; write fig, ax = plt.subplots() and ax=ax"
        )
    wanted = options.get("projection")
    if wanted is not None and ax.name != wanted:
        raise ArgumentError(f'ax is flat; write ax = fig.add_subplot(projection="{wanted}")')
    return ax


def new_panels(
    width_inch: float, height_inch: float, rows: int, columns: int
) -> tuple[Figure, tuple[Axes, ...]]:
    """Return a figure with a grid of axes, row by row."""
    figure = new_figure(width_inch, height_inch)
    return figure, tuple(add_axes(figure, rows, columns, i + 1) for i in range(rows * columns))


def add_axes(figure: Figure, rows: int, columns: int, index: int | tuple[int, int], **options: Any) -> Axes:
    """Add axes in the current style to a grid of a figure, over one or more cells, as `Figure.add_subplot` does."""
    with themed():
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


def save(figure: Figure, path: str | Path, dpi: int | None = None) -> Path:
    """Write a figure, its format by the file's ending, and make the folder if it is missing.

    `dpi` is the dots an inch; None: the figure's own, by its style.
    """
    check_picture(path)
    file = Path(path)
    file.parent.mkdir(parents=True, exist_ok=True)
    kind = file.suffix[1:].lower()
    dpi = int(figure.dpi) if dpi is None else dpi
    with themed(), warnings.catch_warnings(), replacing(file) as part:
        warnings.simplefilter("ignore", UserWarning)  # a layout too tight for its labels is still a picture
        if kind == "png":
            # Laid out here and printed, for `savefig` would draw the whole figure once more for it.
            figure.set_dpi(dpi)
            if layout := figure.get_layout_engine():
                layout.execute(figure)
                figure.set_layout_engine("none")
            FigureCanvasAgg(figure).print_png(part, metadata={"Software": None})  # type: ignore[no-untyped-call]
        else:  # in memory first: on a full disk Matplotlib's PDF ends in an error of its own
            figure.savefig(made := io.BytesIO(), dpi=dpi, format=kind)
            part.write_bytes(made.getvalue())
    return file


def save_axes(axes: Axes, path: str | Path) -> Path:
    """Write the figure that axes lie on, as `save` does."""
    assert isinstance(axes.figure, Figure)
    return save(axes.figure, path)


def legend(axes: Axes, **options: Any) -> None:
    """Add a legend in the current style, on white that what lies below shines through; options as for `Axes.legend`."""
    with themed():
        axes.legend(**_ON_WHITE | {"loc": "best"} | options)


def legend_above(axes: Axes, columns: int = 2, **options: Any) -> None:
    """Add a legend inside the axes above all that is drawn, in room made for it; options as for `legend`.

    It has as many columns as fit, `columns` at most; without entries there is none.
    """
    options = {"loc": "upper left", "borderaxespad": 0.2} | options
    if not options.get("labels") and not axes.get_legend_handles_labels()[1]:
        return
    across = axes.bbox.width
    for ncols in range(columns, 0, -1):
        legend(axes, ncols=ncols, **options)
        made = axes.get_legend()
        assert made is not None
        size = made.get_window_extent()
        if size.width <= across:
            break
    share = min((size.height + 0.05 * axes.figure.dpi) / axes.bbox.height, 0.6)
    scale = axes.yaxis.get_transform()  # a logarithmic axis too
    low, high = scale.transform(axes.get_ylim())
    axes.set_ylim(top=float(scale.inverted().transform(low + (high - low) / (1.0 - share))))


def legend_below(figure: Figure, entries: Mapping[str, Artist], columns: int = 4) -> None:
    """Add one legend for all of a figure below its axes, in as many columns as fit, `columns` at most."""
    if not entries:
        return
    for ncols in range(columns, 0, -1):
        look: dict[str, Any] = {"loc": "outside lower center", "ncols": ncols, "frameon": False}
        made = figure.legend(list(entries.values()), list(entries), **look)
        if made.get_window_extent().width <= figure.bbox.width or ncols == 1:
            return
        made.remove()


def plain_ticks(axis: Axis) -> None:
    """Write 0.34, not 3.4 x 10^-1, and thin the ticks between the powers of ten where they would touch."""
    plain = FuncFormatter(lambda value, _: f"{value:.6g}")
    low, high = axis.get_view_interval()
    if high < 10.0 * low:  # no more than one power of ten within: even steps read better
        axis.set_major_locator(MaxNLocator(6))
        axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(plain)
    axis.set_minor_formatter(NullFormatter())
