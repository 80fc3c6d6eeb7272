"""One object scan by scan: what is left where no rigid outline explains all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from tacstrip.contact.noise import Noise
from tacstrip.reconstruction.polygon.estimate import fit_polygon
from tacstrip.reconstruction.result import RecoveredObject
from tacstrip.scan import Scan
from tacstrip.sensor.spec import Sensor


@dataclass(frozen=True, eq=False)
class SingleScans:
    """Scans of one object, each to be reconstructed by itself once it is asked for.

    Attributes
    ----------
    scans
        All of them.
    runs
        Strips of the object, by the number of each scan that shows it.
    sensor, noise
        As for `tacstrip.fit_polygon`.
    """

    scans: Sequence[Scan]
    runs: dict[int, slice]
    sensor: Sensor
    noise: Noise | None
    found: dict[int, RecoveredObject] = field(default_factory=dict)

    def __getitem__(self, number: int) -> RecoveredObject | None:
        """Return the object of one scan; None where it is absent."""
        if number not in self.runs:
            return None
        if number not in self.found:
            scan, run = self.scans[number], self.runs[number]
            own = np.isin(np.arange(self.sensor.strips), np.arange(run.start, run.stop) % self.sensor.strips)
            kept: dict[str, Any] = {name: np.where(own, scan[name], np.nan) for name in scan.signatures}
            alone = replace(scan, **kept)
            fit = fit_polygon(alone, self.sensor, self.noise, bounded=False, assessment="fast")
            self.found[number] = fit.objects[0]
        return self.found[number]

    def all(self) -> tuple[RecoveredObject | None, ...]:
        """Return the object of every scan."""
        return tuple(self[i] for i in range(len(self.scans)))
