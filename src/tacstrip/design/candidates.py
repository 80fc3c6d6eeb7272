"""Which designs reach a wanted error of corners or of the area, and which of Harmon's requirements they fail.

A design is a construction, a pitch, a length and a converter. Over a grid of places of the contact the Cramer-Rao
bound gives the largest noise that still reaches the wanted error at nine places of ten.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tacstrip.contact.noise import Noise
from tacstrip.core.vertex_covariance import covariance_with_x_priors
from tacstrip.data.published import published
from tacstrip.design.area import area_bound, is_round
from tacstrip.design.limits import places
from tacstrip.errors import OptionError
from tacstrip.geometry.outline import Outline
from tacstrip.network.imperfections import Readout
from tacstrip.network.timing import fastest_scan_hz
from tacstrip.reconstruction.cramer_rao import reading_sigma, vertex_jacobian, vertex_rms
from tacstrip.sensor.constructions import CONSTRUCTIONS, construction
from tacstrip.sensor.spec import Sensor

BITS = (8, 10, 12, 14, 16)
PITCHES = (0.25, 0.5, 1.0, 2.0)  # of the sensor's own
LENGTHS = (0.5, 1.0, 2.0)
FARAD = 100e-12  # at the converter, wires included
CONVERSION_S = 5e-6

_COLUMNS, _ROWS = 3, 7  # places of the contact
_MOST_PLACES = 0.9  # of them, where the wanted error must be reached
_NOISE = (1e-8, 1.0)  # of Vref, where the largest noise is sought
_HALVINGS = 14  # to 0.1 %
_MOST_STRIPS = 1_000_000


@dataclass(frozen=True)
class Design:
    """One design, judged.

    Attributes
    ----------
    sensor
        The design.
    error_mm
        RMS vertex error with the given noise, reached at nine places of ten [mm]; inf where the readings do not
        determine the vertices.
    area_percent
        Standard error of the area in %, likewise (`design.area`).
    noise
        Largest half-width of a reading's error [Vref] that reaches the wanted error; 0 where none does.
    unmet
        Harmon's requirements (table 2.1) that it fails, with the smaller of the given and the largest noise.
    """

    sensor: Sensor
    error_mm: float
    area_percent: float
    noise: float
    unmet: tuple[str, ...]


def candidates(
    sensor: Sensor,
    constructions: Iterable[str] | None = None,
    pitches_mm: Sequence[float] | None = None,
    lengths_mm: Sequence[float] | None = None,
) -> Iterator[Sensor]:
    """Yield a sensor of the same width for each construction, pitch and length.

    By default: the constructions with a closed form that are as flat, or as round, as the sensor, and its own;
    pitches of a quarter to twice its own; lengths of half to twice its own.

    Raises
    ------
    SpecError, OptionError
        There is no such construction, or a design cannot be; the sensor has a `[surface]`.
    """
    if sensor.surface is not None:
        raise OptionError("designs are sought for flat sensors and tubes, and this sensor has a [surface]")
    if constructions is None:
        alike = [c for c in CONSTRUCTIONS.values() if c.cylindrical == sensor.kind.cylindrical]
        kinds = [c for c in alike if c.closed_form]
        kinds += [] if sensor.kind in kinds else [sensor.kind]
    else:
        kinds = [construction(name) for name in constructions]
    for kind in kinds:
        ratio = sensor.resistivity_ratio if "resistivity_ratio" in kind.keys else 1.0
        radius = sensor.radius_mm if "radius_mm" in kind.keys else None
        for pitch in pitches_mm or [p * sensor.pitch_mm for p in PITCHES]:
            strips = min(max(1, int(sensor.width_mm / pitch + 1e-9)), _MOST_STRIPS) if pitch > 0.0 else 1
            for length in lengths_mm or [part * sensor.length_mm for part in LENGTHS]:
                yield replace(
                    sensor, construction=kind.name, strips=strips, pitch_mm=pitch, length_mm=length,
                    strip_width_mm=None, resistivity_ratio=ratio, radius_mm=radius, without=(),
                    calibration=None, converter=None,
                )  # fmt: skip


def designs(
    sensors: Iterable[Sensor],
    outline: Outline,
    noise: Noise,
    wanted_mm: float | None,
    bits: Sequence[int] = BITS,
    farad: float = FARAD,
    conversion_s: float = CONVERSION_S,
    *,
    area_percent: float | None = None,
) -> list[Design]:
    """Judge every sensor with every converter.

    First come those that reach the wanted error with the given noise, then those that do with less; among them
    those that fail fewest requirements, then those that allow most noise. A sensor that the contact does not fit
    on is skipped.

    Parameters
    ----------
    sensors
        Candidates; their own converters do not count.
    outline
        The contact; it is moved over each sensor.
    noise
        What is expected on a reading.
    wanted_mm
        The RMS vertex error that is wanted [mm]; None: any, where `area_percent` is wanted.
    bits
        Converters to try.
    farad, conversion_s
        Input capacitance [F] and conversion time [s], for the sampling frequency.
    area_percent
        The standard error of the area that is wanted, in % of it; None: any.

    Raises
    ------
    OptionError
        The wanted error is not a finite number above 0, or none is.
    """
    wanted = (
        math.inf if wanted_mm is None else wanted_mm,
        math.inf if area_percent is None else area_percent,
    )
    for value, unit in zip((wanted_mm, area_percent), ("mm", "% of the area"), strict=True):
        if value is not None and not 0.0 < value < math.inf:
            raise OptionError(f"wanted error {value} {unit}: must be a finite number above 0")
    if wanted == (math.inf, math.inf):
        raise OptionError("no error is wanted: give wanted_mm or area_percent")
    found = []
    size = np.ptp(outline.vertices, axis=0)
    for sensor in sensors:
        if size[0] > sensor.width_mm or size[1] > sensor.length_mm:
            continue
        bounds = _BoundsOverSensor(sensor, outline)
        largest = bounds.largest_sigma(wanted)
        for resolution in bits:
            design = replace(sensor, adc_bits=resolution)
            steps = reading_sigma(Noise(), design)
            room = math.sqrt(3.0 * max(largest**2 - steps**2, 0.0))
            given = math.sqrt(3.0) * reading_sigma(noise, replace(sensor, adc_bits=None))
            errors = bounds.errors(math.hypot(given / math.sqrt(3.0), steps))
            unmet = requirements_unmet(design, min(given, room), farad, conversion_s)
            found.append(Design(design, *errors, room, unmet))
    met = [d.error_mm <= wanted[0] and d.area_percent <= wanted[1] for d in found]
    order = sorted(
        zip(met, found, strict=True),
        key=lambda m: (m[1].noise == 0.0, not m[0], len(m[1].unmet), -m[1].noise),
    )
    return [d for _, d in order]


def requirements_unmet(
    sensor: Sensor, noise: float, farad: float = FARAD, conversion_s: float = CONVERSION_S
) -> tuple[str, ...]:
    """Return those of Harmon's requirements that a design fails, in words with the figure.

    Surface, sensitivity and stability are not in the model; the response is monotonic in l and in u.

    Parameters
    ----------
    sensor
        The design, with `adc_bits`.
    noise
        Half-width of a reading's error [Vref].
    farad, conversion_s
        As for `network.timing.fastest_scan_hz`.
    """
    asked = published()["requirements"]
    error = 2.0 * noise + sensor.adc_step  # full width, of Vref
    coarsest = asked["spatial_resolution_mm"][1]
    least, most = asked["sensing_elements"]
    rate = fastest_scan_hz(sensor, Readout(), farad, conversion_s)
    rules = (
        (sensor.pitch_mm <= coarsest, f"resolution across {sensor.pitch_mm:.3g} mm"),
        (error * sensor.length_mm <= coarsest, f"resolution along {error * sensor.length_mm:.3g} mm"),
        (least <= sensor.strips <= most, f"{sensor.strips} elements"),
        (rate > asked["sampling_frequency_hz"], f"{rate:.3g} Hz"),
        (1.0 / error >= asked["dynamic_range"], f"range {1.0 / error:.3g}:1"),
    )
    return tuple(said for met, said in rules if not met)


class _BoundsOverSensor:
    """Cramer-Rao bounds of an outline at all its places on a sensor, for any noise."""

    def __init__(self, sensor: Sensor, outline: Outline) -> None:
        self.sensor, self.round = sensor, is_round(outline)
        # How a round object lies to the strips tells most of how well it is known; at an edge a strip just touches it.
        grid = (2 * _ROWS + 1, _COLUMNS) if self.round else (_COLUMNS, _ROWS)
        across, along = places(sensor, outline, *grid)
        across = across[1::2] if self.round else across
        moved = [outline.moved(dx, dy) for dx in across for dy in along]
        self.at = [(o, np.asarray(np.linalg.qr(vertex_jacobian(o, sensor), mode="r"))) for o in moved]

    def errors(self, sigma: float, wanted: tuple[float, float] = (0.0, 0.0)) -> tuple[float, float]:
        """Return the RMS vertex error [mm] and the area's [%] that are reached at nine places of ten.

        One of which any is wanted, inf, is not computed, and 0; a round outline has no corners: inf.
        """
        mm, percent = [math.inf if self.round else 0.0], [0.0]
        if wanted[0] < math.inf and not self.round:
            mm = [vertex_rms(covariance_with_x_priors(o, self.sensor, s / sigma)) for o, s in self.at]
        if wanted[1] < math.inf:
            percent = [100.0 * area_bound(o, self.sensor, s / sigma) for o, s in self.at]
        at = math.ceil(_MOST_PLACES * len(self.at)) - 1
        return sorted(mm)[min(at, len(mm) - 1)], sorted(percent)[min(at, len(percent) - 1)]

    def largest_sigma(self, wanted: tuple[float, float]) -> float:
        """Return the largest noise [Vref] that reaches the errors; 0 where none does."""

        def reached(log_sigma: float) -> bool:
            mm, percent = self.errors(math.exp(log_sigma), wanted)
            return mm <= wanted[0] and percent <= wanted[1]

        low, high = (math.log(s) for s in _NOISE)
        if not reached(low):
            return 0.0
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if reached(middle) else (low, middle)
        return math.exp(low)
