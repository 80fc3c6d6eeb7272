"""Recovered objects with the number, colour and legend entry that distinguish them in a picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import matplotlib as mpl
from matplotlib.colors import to_hex

from tacstrip.plot.theme import OTHERS, RECOVERED
from tacstrip.reconstruction.result import Reconstruction, RecoveredObject
from tacstrip.sensor.spec import Sensor

_MOST_NAMED = 8  # objects with an entry of their own in the legend


@dataclass(frozen=True)
class LabelledObject:
    """One object to draw.

    Attributes
    ----------
    found
        The object.
    number
        What is written on it: its number from 1, left to right; with several scans the scan's, as "3" or "3.1". Empty
        for a single object.
    colour
        Its own; its scan's if there are several; its method's if methods are compared.
    label
        Its entry in the legend; None where an entry with the same text exists.
    """

    found: RecoveredObject
    number: str
    colour: str
    label: str | None

    def place(self, sensor: Sensor) -> tuple[float, float]:
        """Return where the number stands [mm]."""
        if self.found.found:
            x, y = self.found.centroid
            return float(x), float(y)
        strips = self.found.strips
        return 0.5 * (strips.start + strips.stop) * sensor.pitch_mm, 0.5 * sensor.length_mm


def labelled_objects(
    results: Mapping[str, Sequence[Reconstruction]],
    shown: Sequence[int],
    numbers: Sequence[int] | None = None,
) -> list[LabelledObject]:
    """Return the objects of the scans that are shown, method by method.

    `numbers` are the objects' own where they were followed from frame to frame; else they count from left to right.
    """
    palette = (RECOVERED, *OTHERS)
    several = len(shown) > 1
    every = [
        (method, name, order, i, k if numbers is None else numbers[k], found)
        for method, (name, reconstructions) in enumerate(results.items())
        for order, i in enumerate(shown)
        for k, found in enumerate(reconstructions[i].objects)
    ]
    labelled: list[LabelledObject] = []
    labels: set[str] = set()
    for method, name, order, i, k, found in every:
        if len(results) > 1:
            colour = palette[method % len(palette)]
        elif several:  # from dark to light over time; the lightest would be invisible
            colour = to_hex(mpl.colormaps["viridis"](0.85 * order / (len(shown) - 1)))
        else:
            colour = palette[k % len(palette)]
        own = f"{k + 1}" if len(results[name][i].objects) > 1 else ""
        number = (f"{i}.{own}" if own else f"{i}") if several else own
        named = f"{name} {own}" if own and not several and len(every) <= _MOST_NAMED else name
        strips = ", strip by strip" if not found.found and found.profile is not None else ""
        label = f"{named}: {found.status}{strips}"
        labelled.append(LabelledObject(found, number, colour, None if label in labels else label))
        labels.add(label)
    return labelled
