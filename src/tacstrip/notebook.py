"""How objects draw themselves in notebooks: small SVGs, made without Matplotlib, and their text below."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import FloatArray, finite_runs

SKIN, STRIP, GREY = "#e6e2d8", "#b9b19d", "#555555"
VERMILION, BLUE, GREEN = "#cc5500", "#0072b2", "#007d5c"
SIGNATURE_COLOURS = {"kh": VERMILION, "kl": BLUE, "k": GREEN}
_SIZE = 320.0  # of the picture's longer side [px]
_MARGIN = 0.06
_MOST_STRIPS = 120  # drawn one by one


@dataclass(frozen=True)
class SvgPath:
    """A line through points (N, 2), y upwards, or an area; NaN parts it, and a point alone is a dot."""

    points: FloatArray
    stroke: str = "none"
    fill: str = "none"
    opacity: float = 0.15  # of the area
    width: float = 1.5  # of the line [px]
    closed: bool = True


def drawing(paths: Sequence[SvgPath], title: str) -> str:
    """Return paths as one SVG; its title is what a reader who does not see it hears."""
    paths = [path for path in paths if np.isfinite(path.points).any()]
    head = f'<svg xmlns="http://www.w3.org/2000/svg" role="img" aria-label="{html.escape(title)}" '
    if not paths:
        return f'{head}width="90" height="24"><text x="4" y="16">no shape</text></svg>'
    every = np.concatenate([path.points for path in paths])
    low, high = np.nanmin(every, axis=0), np.nanmax(every, axis=0)
    margin = _MARGIN * max(float((high - low).max()), 1e-9)
    low, high = low - margin, high + margin
    width, height = (float(part) for part in high - low)
    scale = _SIZE / max(width, height)
    lines = []
    for path in paths:
        look = f'fill="{path.fill}" fill-opacity="{path.opacity:g}" stroke="{path.stroke}" stroke-linecap="round"'
        pieces = "".join(
            "M" + " ".join(f"{x - low[0]:.6g},{high[1] - y:.6g}" for x, y in piece) + _end(piece, path.closed)
            for piece in finite_runs(path.points)
        )
        lines.append(
            f'<path d="{pieces}" {look} stroke-width="{path.width / scale:.6g}" fill-rule="evenodd"/>'
        )
    return (
        f'{head}width="{width * scale:.0f}" height="{height * scale:.0f}" '
        f'viewBox="0 0 {width:.6g} {height:.6g}">{"".join(lines)}</svg>'
    )


class Drawn:
    """What draws itself in notebooks; a class says in `_paths` how."""

    __slots__ = ()

    def _paths(self) -> list[SvgPath]:
        raise NotImplementedError

    def _repr_svg_(self) -> str | None:
        """Draw it in a notebook; None, and its text is shown, where it cannot be drawn."""
        try:
            return drawing(self._paths(), repr(self))
        except Exception:  # a picture must not hide what a cell has computed
            return None

    def _repr_html_(self) -> str | None:
        """Draw it in a notebook, its text below."""
        picture = self._repr_svg_()
        return None if picture is None else f"<div>{picture}<br><code>{html.escape(repr(self))}</code></div>"


def signature_paths(scans: Sequence[Mapping[str, FloatArray]]) -> list[SvgPath]:
    """Return the lines of readings over Vref (strips,) by signature, later scans thicker, in a frame of 0 to 1."""
    wide, high = _SIZE, 0.4 * _SIZE
    frame = np.array([(0.0, 0.0), (wide, 0.0), (wide, high), (0.0, high)])
    paths = [SvgPath(frame, fill=SKIN, opacity=1.0)]
    for number, scan in enumerate(scans, 1):
        for name, k in scan.items():
            x = (np.arange(len(k)) + 0.5) * wide / len(k)
            line = np.stack([np.where(np.isnan(k), np.nan, x), k * high], axis=1)
            width = 0.5 + 1.5 * number / len(scans)
            paths.append(SvgPath(line, stroke=SIGNATURE_COLOURS[name], width=width, closed=False))
    return paths


def strip_paths(strips: int, pitch_mm: float, strip_width_mm: float, length_mm: float) -> list[SvgPath]:
    """Return a sensor's surface and its strips."""
    right = strips * pitch_mm
    surface = np.array([(0.0, 0.0), (right, 0.0), (right, length_mm), (0.0, length_mm)])
    drawn = [SvgPath(surface, fill=SKIN, opacity=1.0)]
    if strips <= _MOST_STRIPS:
        # Else all would be one area.
        half = 0.4 * pitch_mm if strip_width_mm == pitch_mm else 0.5 * strip_width_mm
        sides = (-half, half, half, -half)
        for x in (np.arange(strips) + 0.5) * pitch_mm:
            corners = zip(sides, (0.0, 0.0, length_mm, length_mm), strict=True)
            drawn.append(SvgPath(np.array([(x + side, y) for side, y in corners]), fill=STRIP, opacity=0.6))
    return drawn


def _end(piece: FloatArray, closed: bool) -> str:
    return "Z" if closed else "h0" if len(piece) == 1 else ""
