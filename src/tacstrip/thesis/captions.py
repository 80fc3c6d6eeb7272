"""Figures by their number in the thesis, each a function without arguments whose docstring is its caption."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, TypeAlias

from matplotlib.figure import Figure

Draw: TypeAlias = Callable[[], Figure]


def by_number(names: Mapping[str, Any]) -> dict[str, Draw]:
    """Return a module's functions that are named as `figure_2_3` by the figure's number, here "2.3"."""
    own = {name.removeprefix("figure_"): f for name, f in names.items() if name.startswith("figure_")}
    return {number.replace("_", "."): f for number, f in own.items()}


def captioned(text: str, draw: Callable[..., Figure], *subjects: Any) -> Draw:
    """Return `draw` of these subjects, with a caption."""
    drawing = partial(draw, *subjects)
    drawing.__doc__ = text
    return drawing


def caption(draw: Draw) -> str:
    """Return a figure's caption, the first line of its docstring."""
    return (draw.__doc__ or "").partition("\n")[0]
