"""How common phantoms are in a digital array without isolation: random patterns, from few closed switches to many."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from tacstrip.arrays import FloatArray
from tacstrip.network.devices.digital_array import phantoms
from tacstrip.network.grid import check_count
from tacstrip.plot.theme import OTHERS, TRUE, add_axes, legend, new_figure

FILLS = np.linspace(0.01, 0.3, 16)


def figure_phantoms() -> Figure:
    """Phantoms of random patterns without isolation: they break out where 1 / n of the switches is closed."""
    figure = new_figure(5.6, 4.0)
    axes = add_axes(figure, 1, 1, 1)
    for n, colour, marker in zip((8, 16, 32), OTHERS, "os^", strict=False):
        share = phantoms_over_fill(n)
        axes.plot(FILLS, share, marker + "-", color=colour, markersize=4.0, label=f"n = {n}")
        axes.axvline(1.0 / n, color=colour, linewidth=0.8, linestyle=":")
    axes.set(xlim=(0.0, FILLS[-1]), ylim=(-0.02, 1.02))
    axes.set(xlabel="share of switches that are closed", ylabel="share of open switches read as closed")
    axes.text(0.995, 0.04, "dotted: 1 / n", transform=axes.transAxes, ha="right", color=TRUE, fontsize=8.0)
    legend(axes, loc="center right")
    return figure


def phantoms_over_fill(
    n: int, fills: Sequence[float] | FloatArray = FILLS, patterns: int = 24, seed: int = 2
) -> FloatArray:
    """Return the mean share of open switches that read closed without isolation (fills,), over random patterns."""
    share, patterns = np.zeros(len(fills)), check_count("patterns", patterns, 1_000_000)
    for at, fill in enumerate(fills):
        random = np.random.default_rng([seed, n, at])
        drawn = [random.random((n, n)) < fill for _ in range(patterns)]
        share[at] = np.mean([phantoms(p) / max(1, np.sum(~p)) for p in drawn])
    return share
