"""The three prototypes of chapter 6 as digital twins: closed forms, printed offsets and printed residual errors.

Nobody has measured hardware for this project. A twin's raw reading is the closed form, plus the error that tables
6.8-6.11 print for an experiment (taken as measured minus true), plus the offset of table 6.1, 6.5 or 6.7, as
far as 0 and Vref allow.

Where the 5 cm x 3.5 cm rectangle lay is not printed. What the text allows is a `Placing`:

- CRS-CRS: errors are printed for all ten strips, so it was tilted by 18 to 52 degrees. Strips 4 and 7 are named as
  transitions, which leaves 30 to 43. The kink at 7 fades in k_h in the middle and above: it was a lower vertex's,
  so that the rectangle was turned clockwise. Nominal: 34 degrees.
- CRS-M, 4 cm wide, is a contradiction. Errors are printed for all nine strips, and between the edges the rectangle
  fits only within 6 degrees of upright; but then its lower right vertex is on strip 8, not on "the seventh" (6.2.2).
  "upright" believes the edges. "overhanging" believes strip 7: centred, 18 degrees from upright, the left and the
  right corner 4 mm over the edges, where a signature does not start with l = u as Vertex Reconstruction needs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.contact.footprint import footprint
from tacstrip.contact.shape import Contact
from tacstrip.contact.signature import signatures
from tacstrip.data.published import offsets_volt, region_residuals, residuals
from tacstrip.scan import Scan
from tacstrip.sensor.calibration import Calibration
from tacstrip.sensor.channel import Channel
from tacstrip.sensor.raw import apply_calibration, invert_calibration
from tacstrip.sensor.spec import Sensor

PROTOTYPES = {"CRS-CRS": "prototype-crs-crs", "CRS-M": "prototype-crs-m", "Cyl-CRS-M": "prototype-cyl-crs-m"}
REGIONS = ("lower", "middle", "upper")  # thirds of the strips
RECTANGLE = np.array([(-25.0, -17.5), (25.0, -17.5), (25.0, 17.5), (-25.0, 17.5)])  # [mm]

# Two-point contacts on the tube: strips from 0 and y [mm] of both points. Not printed; with w = 0 the error of a
# reading moves a point by as much of L wherever it lies.
LINES = tuple(((i, 15.0 + 20.0 * i), (i + 1, 25.0 + 20.0 * i)) for i in range(4))


@dataclass(frozen=True)
class Placing:
    """How the rectangle may have lain across the strips.

    Attributes
    ----------
    tilt_deg, least_deg, most_deg
        Nominal angle of its 5 cm side from x, and its bounds.
    strips
        The strips nearest to its corners, left to right, numbered from 1 as in the thesis.
    whole
        Whether all of it lay on the sensor.
    """

    tilt_deg: float
    least_deg: float
    most_deg: float
    strips: tuple[int, int, int, int]
    whole: bool

    def contact(self, sensor: Sensor, region: str) -> Contact:
        """Return the rectangle at its nominal tilt, centred in a region."""
        return centred(sensor, region, self.tilt_deg)

    def drawn(self, sensor: Sensor, region: str, random: np.random.Generator) -> Contact:
        """Return the rectangle at a random place in a region, among those that the text allows."""
        low = REGIONS.index(region)
        while True:
            x = (0.5 + random.uniform(-0.1, 0.1)) * sensor.width_mm
            y = (low + random.uniform()) / len(REGIONS) * sensor.length_mm
            corners = _corners(random.uniform(self.least_deg, self.most_deg), x, y)
            if self.allows(sensor, corners):
                return Contact.polygon(corners)

    def allows(self, sensor: Sensor, corners: FloatArray) -> bool:
        """Tell whether all strips are touched, and the corners (4, 2) lie at the right strips and on the sensor."""
        (left, low), (right, high) = corners.min(axis=0), corners.max(axis=0)
        return bool(
            left <= sensor.x_mm[0]
            and right >= sensor.x_mm[-1]
            and tuple(nearest_strips(sensor, corners) + 1) == self.strips
            and (not self.whole or (left >= 0.0 and right <= sensor.width_mm))
            and low >= 0.0
            and high <= sensor.length_mm
        )


PLACINGS: dict[str, dict[str, Placing]] = {
    "CRS-CRS": {"tilted": Placing(-34.0, -52.0, -18.0, (1, 4, 7, 10), whole=True)},
    "CRS-M": {
        "upright": Placing(85.0, 84.0, 90.0, (1, 2, 8, 9), whole=True),
        "overhanging": Placing(72.0, 60.0, 84.0, (1, 3, 7, 9), whole=False),
    },
}


def centred(sensor: Sensor, region: str, tilt_deg: float) -> Contact:
    """Return the rectangle in the middle of a region, its 5 cm side at an angle from x [degrees]."""
    y = (REGIONS.index(region) + 0.5) / len(REGIONS) * sensor.length_mm
    return Contact.polygon(_corners(tilt_deg, 0.5 * sensor.width_mm, y))


@cache
def twin(name: str) -> Sensor:
    """Return a prototype, named as in the thesis, with its printed offsets as its calibration."""
    sensor = Sensor.load(PROTOTYPES[name])
    offsets = {s: tuple(offsets_volt(name, s) / sensor.vref_volt) for s in sensor.signatures}
    channels = tuple(Channel(signature=s, offset=offset) for s, offset in offsets.items())
    note = "closed forms and the printed calibration factors; no hardware was measured"
    return replace(sensor, calibration=Calibration(channels=channels, source=note))


@cache
def region_errors(name: str, region: str) -> dict[str, FloatArray]:
    """Return the printed errors (strips,) of a prototype's signatures in a region, over Vref."""
    return {s: region_residuals(name, s, region) for s in twin(name).signatures}


def line_errors() -> FloatArray:
    """Return the printed errors of both points of each line on the tube (4, 2), over Vref (table 6.11)."""
    rows = [residuals(f"6.35 line {i}") for i in range(1, len(LINES) + 1)]
    return np.array([row[np.isfinite(row)] for row in rows])


def raw_scan(sensor: Sensor, contact: Contact, errors: dict[str, FloatArray]) -> Scan:
    """Return a twin's raw readings, as its meter shows them, of a contact that may hang over the edges."""
    ideal = signatures(sensor, *footprint(sensor, contact))
    read = {name: k + errors[name] for name, k in ideal.items()}
    return Scan(time_s=0.0, **invert_calibration(sensor, read))


def calibrated(sensor: Sensor, raw: Scan) -> Scan:
    """Return raw readings with the printed offsets subtracted: (6.3), (6.4)."""
    return Scan(time_s=0.0, **apply_calibration(sensor, {name: raw[name] for name in raw.signatures}))


def nearest_strips(sensor: Sensor, corners: FloatArray) -> IntArray:
    """Return the strips, from 0, nearest to corners (N, 2) [mm], left to right."""
    x = np.sort(corners[:, 0])
    return np.asarray(np.abs(sensor.x_mm[:, None] - x).argmin(axis=0))


def _corners(tilt_deg: float, x_mm: float, y_mm: float) -> FloatArray:
    c, s = np.cos(np.deg2rad(tilt_deg)), np.sin(np.deg2rad(tilt_deg))
    return np.asarray(RECTANGLE @ np.array([[c, s], [-s, c]]) + (x_mm, y_mm))
