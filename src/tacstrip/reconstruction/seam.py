"""A contact across the seam of a closed tube: the strips are laid out so that it lies in one piece.

Strips 0 to n - 1 are followed by n to 2 n - 1, which are the same ones again; each touched strip counts once, in the
first or in the second round. So x of what reaches across the seam goes on beyond the circumference, and modulo the
circumference it is x on the tube.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from tacstrip.arrays import BoolArray
from tacstrip.scan import Scan
from tacstrip.sensor.spec import Sensor

BRIDGED = 3  # strips that may be missing inside a contact
_OPEN = 2.0  # times the circumference: rounds are laid out on a tube that is not closed


def opened(sensor: Sensor, strips: int) -> Sensor:
    """Return a sensor of so many strips like a closed one's, which is not closed."""
    if sensor.radius_mm is None:  # a tube of even strips
        return replace(sensor, strips=strips, surface=None, calibration=None)
    radius = _OPEN * sensor.radius_mm * strips / sensor.strips
    return replace(sensor, strips=strips, radius_mm=radius, calibration=None)


def unrolled(scan: Scan, sensor: Sensor, bridged: int = 0, turn: int | None = None) -> tuple[Scan, Sensor]:
    """Return scan and sensor laid out over two rounds, (2 strips,); those of a sensor that is not closed as they are.

    Strips from 0 on that belong to a contact across the seam, at most `bridged` missing in between, come in the
    second round; or the first `turn` strips.
    """
    if not sensor.closed:
        return scan, sensor
    return rounds(scan, bridged, turn), opened(sensor, 2 * sensor.strips)


def rounds(scan: Scan, bridged: int = 0, turn: int | None = None) -> Scan:
    """Return a scan of a closed sensor laid out over two rounds (2 strips,); arguments as of `unrolled`."""
    n = len(scan.touched)
    turn = _beyond_seam(scan.touched, bridged) if turn is None else turn
    parts = np.arange(n) >= turn, np.arange(n) < turn
    laid_out: dict[str, Any] = {
        name: np.concatenate([np.where(part, scan[name], np.nan) for part in parts])
        for name in scan.signatures
    }
    return replace(scan, **laid_out)


def _beyond_seam(touched: BoolArray, bridged: int) -> int:
    """Return how many strips after the seam belong to a contact that reaches across it; 0 where none does."""
    on = np.flatnonzero(touched)
    if not len(on) or on[0] + len(touched) - 1 - on[-1] > bridged:
        return 0
    gaps = np.diff(on) - 1
    wide = np.flatnonzero(gaps > bridged)
    if not len(wide) and gaps.max(initial=0) <= on[0] + len(touched) - 1 - on[-1]:
        return 0  # no gap is wider than that at the seam
    return int(on[wide[0] if len(wide) else gaps.argmax()] + 1)
