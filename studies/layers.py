"""Pictures of two layers for docs/guide/two-layers.md; the figures there are from `studies/holdout/layers.py`."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

import tacstrip as ts
from tacstrip.plot.layers import draw_layers, draw_object, layers_figure
from tacstrip.plot.scene import draw_contact, labelled_objects
from tacstrip.plot.theme import new_panels

_NOISE = ts.Noise(positional=0.005)
_SQUARE = ts.Sensor(construction="crs-crs", strips=32, pitch_mm=3.0, length_mm=96.0)


def _contact(*outlines: npt.ArrayLike) -> ts.Contact:
    parts = [ts.Contact.polygon(outline) for outline in outlines]
    return ts.Contact(tuple(shape for part in parts for shape in part.shapes))


def figure_three() -> Figure:
    """Draw three objects that share strips of both layers, found from one scan."""
    sensor = ts.LayeredSensor.crossed(_SQUARE)
    contact = _contact(
        [(20, 20), (45, 25), (30, 50)],
        [(35, 60), (70, 55), (60, 80)],
        [(60, 20), (85, 25), (80, 48), (62, 40)],
    )
    scan = ts.simulate(sensor, contact, _NOISE, rng=1)
    return layers_figure(sensor, [scan], [ts.reconstruct(scan, sensor, _NOISE)], [contact])


def counter_examples() -> dict[str, ts.Contact]:
    """Return what two layers do not tell, or tell in part only."""
    ring = [
        np.array([48.0, 48.0]) + 27.0 * np.array([np.cos(a), np.sin(a)])
        for a in np.pi / 2.0 * np.arange(4) + 0.4
    ]
    disc = [(np.cos(a), np.sin(a)) for a in np.linspace(0.0, 2.0 * np.pi, 7)[:-1]]
    outer = [(20, 20), (76, 20), (76, 76), (20, 76)]
    return {
        "a ring of four": _contact(*[[tuple(c + 9.0 * np.array(d)) for d in disc] for c in ring]),
        "one more, hidden": _contact(
            [(20, 20), (62, 20), (62, 28), (20, 28)],
            [(68, 20), (76, 20), (76, 62), (68, 62)],
            [(34, 68), (76, 68), (76, 76), (34, 76)],
            [(20, 34), (28, 34), (28, 76), (20, 76)],
            [tuple(np.array([48.0, 48.0]) + 8.0 * np.array(d)) for d in disc],
        ),
        "a hole": ts.Contact.polygon(outer, holes=[[(36, 36), (60, 36), (60, 60), (36, 60)]]),
        "parallel bars": _contact(
            *[[(20, y), (76, y + 6), (76, y + 14), (20, y + 8)] for y in (20.0, 40.0, 60.0)]
        ),
    }


def figure_counter_examples() -> Figure:
    """Draw what touched, and what two layers make of it without noise worth speaking of."""
    sensor, noise = ts.LayeredSensor.crossed(_SQUARE), ts.Noise(positional=0.001)
    cases = counter_examples()
    figure, panels = new_panels(7.0, 7.4, 2, 2)
    for axes, (name, contact) in zip(panels, cases.items(), strict=True):
        found = ts.reconstruct(ts.simulate(sensor, contact, noise, rng=1), sensor, noise)
        draw_layers(axes, sensor)
        draw_contact(axes, contact)
        for drawn in labelled_objects({"recovered": [found]}, [0]):
            draw_object(axes, drawn)
        axes.set_title(f"{name}: {len(found.objects)} found, {found.status}", fontsize=9.0)
    return figure


FIGURES: dict[str, Callable[[], Figure]] = {
    "two_layers": figure_three,
    "two_layers_untold": figure_counter_examples,
}
