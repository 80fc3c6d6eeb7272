"""Figures 5.5-5.61: recovered shapes, two noisy signatures, and Vertex Reconstruction of a concave shape."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tacstrip.arrays import FloatArray
from tacstrip.data.published import Row
from tacstrip.plot.scene import draw_contact, draw_polygon, draw_sensor
from tacstrip.plot.theme import COLOURS, legend, new_axes
from tacstrip.reconstruction.vertex.transitions import by_gradient
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.simulation import simulate
from tacstrip.thesis.captions import captioned
from tacstrip.thesis.chapter5.ambiguity import AMBIGUOUS, CONCAVE, recoveries
from tacstrip.thesis.chapter5.tables import NOISES
from tacstrip.thesis.shapes import SHAPES, SIMULATED

# Figure: (shape, position, signature) whose noisy signature defeats the search for transitions.
NOISY = {"5.9": ("triangle", 4, "kh"), "5.14": ("tetragon", 3, "kh")}


def recovery_caption(row: Row) -> str:
    """Return the caption of a row's figure."""
    method = "P.R." if row.algorithm == "profile" else f"V.R. with ${SIGNATURES[row.signature or ''].symbol}$"
    return f"{row.shape}, {row.construction.upper()}, {method}; {row.noise}"


def recovery(row: Row, samples: Sequence[FloatArray]) -> Figure:
    """Draw the five placed shapes and one recovery of each (N, 2) [mm], empty where it failed."""
    figure, axes = _sensor_axes(SIMULATED[row.construction].construction)
    colour = COLOURS[row.signature or "profile"]
    for position, sample in enumerate(samples):
        _draw_pair(axes, row.shape, position, sample, colour)
    axes.set_title(textwrap.fill(f"Figure {row.figure}: {recovery_caption(row)}", 52))
    legend(axes, loc="upper left")
    return figure


def _noisy_caption(figure: str) -> str:
    shape, position, name = NOISY[figure]
    symbol = SIGNATURES[name].symbol
    return f"${symbol}$-signature of {shape} {position + 1}, noise-free and with P.U. profile II"


def noisy_signature(figure: str) -> Figure:
    """Draw a noise-free and a noisy signature, the true transitions, and those that the gradient rule finds."""
    shape, position, name = NOISY[figure]
    sensor, contact = SIMULATED["crs-crs"], SHAPES[shape].contact(position)
    noises = NOISES["ideal"], NOISES["quantisation + profile II"]
    clean, noisy = (simulate(sensor, contact, noise, rng=0) for noise in noises)
    run = clean.runs()[0]
    x = sensor.x_mm[run]
    drawing, axes = new_axes(6.0, 4.0)
    axes.plot(x, noisy[name][run], color=COLOURS[name], linewidth=0.7, alpha=0.7, label="profile II")
    axes.plot(x, clean[name][run], color="black", linewidth=1.4, label="noise-free")
    for i, true in enumerate(SHAPES[shape].transitions(position)):
        axes.axvline(true, color="#888888", linestyle=":", label=None if i else "true transitions")
    found = by_gradient(x, noisy[name][run], sensor.pitch_mm)[1:-1]
    low = axes.get_ylim()[0]
    axes.plot(found, np.full(len(found), low), "^", color=COLOURS[name], clip_on=False,
              label=f"found by the gradient rule: {len(found)}")  # fmt: skip
    axes.set_title(textwrap.fill(f"Figure {figure}: {_noisy_caption(figure)}", 60))
    axes.set(xlabel="x [mm]", ylabel=f"${SIGNATURES[name].symbol}$")
    legend(axes)
    return drawing


def ambiguity(figure: str) -> Figure:
    """Draw V.R.'s result for the concave tetragon from ideal readings."""
    construction, name = AMBIGUOUS[figure]
    drawing, axes = _sensor_axes(construction)
    for position, (_, found) in enumerate(recoveries(figure)):
        _draw_pair(axes, CONCAVE.name, position, found.vertices, COLOURS[name])
    axes.set_title(textwrap.fill(f"Figure {figure}: {_ambiguity_caption(figure)}", 52))
    legend(axes, loc="upper left")
    return drawing


def _ambiguity_caption(figure: str) -> str:
    construction, name = AMBIGUOUS[figure]
    symbol = SIGNATURES[name].symbol
    return f"concave tetragon, ideal {construction.upper()}, V.R. with ${symbol}$: another shape"


def _sensor_axes(construction: str) -> tuple[Figure, Axes]:
    figure, axes = new_axes(5.2, 5.2)
    draw_sensor(axes, SIMULATED[construction])
    return figure, axes


def _draw_pair(axes: Axes, shape: str, position: int, recovered: FloatArray, colour: str) -> None:
    contact = SHAPES[shape].contact(position)
    draw_contact(axes, contact, label=None if position else "original")
    x, y = contact.centroid
    axes.text(x, y, str(position + 1), fontsize=8.0, ha="center", va="center", zorder=5)
    if len(recovered):
        draw_polygon(axes, recovered, colour, label=None if position else "recovered")
    else:
        below = (contact.centroid[0], contact.vertices[:, 1].min())
        axes.annotate("not recovered", below, fontsize=7.0, ha="center", va="top", color=colour)


FIGURES = {f: captioned(_noisy_caption(f), noisy_signature, f) for f in NOISY}
FIGURES |= {f: captioned(_ambiguity_caption(f), ambiguity, f) for f in AMBIGUOUS}
