"""Whether the letters of a picture can be read where it is shown 600 pixels wide."""

from __future__ import annotations

from matplotlib.figure import Figure
from matplotlib.text import Text

_SHOWN_PX = 600.0
_LEAST_PX = 9.0  # nearly seven points on a screen of 96 dots an inch


def small_letters(figure: Figure) -> list[str]:
    """Return the texts of a figure that was drawn whose letters are too small where it is shown, with their heights."""
    point_px = min(_SHOWN_PX / figure.get_figwidth(), 96.0) / 72.0  # a small figure is not enlarged
    texts = [t for t in figure.findobj(Text) if t.get_visible() and t.get_text().strip()]
    heights = {t.get_text(): point_px * float(t.get_fontsize()) for t in texts}
    return [f"{text!r} ({height:.1f} pixels)" for text, height in heights.items() if height < _LEAST_PX]


def refuse_small_letters(figure: Figure, name: str) -> None:
    """Raise where letters of a figure that was drawn are too small; make the figure narrower, or the letters larger.

    Raises
    ------
    ValueError
        The message lists the texts.
    """
    if small := small_letters(figure):
        raise ValueError(f"{name}: too small where it is shown 600 pixels wide: {', '.join(small)}")
