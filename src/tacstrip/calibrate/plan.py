"""Which contacts to make: as few as give a wanted accuracy (sequential G-optimal design).

Contacts run across all strips, so one press informs every strip's own parameters and the shared ones, and its place is
off by the same on all of them. The next contact is always the one after which the worst predicted error of a corrected
reading is least.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import ndtr

from tacstrip.arrays import FloatArray
from tacstrip.calibrate.linearised import jacobian, jacobian_of_places
from tacstrip.calibrate.model import PARTS, Constants, Model, initial_constants, pooled_precision, predict
from tacstrip.calibrate.model_selection import parse_model, planned_model
from tacstrip.calibrate.unit import require_closed_form
from tacstrip.contact.noise import Noise
from tacstrip.errors import OptionError
from tacstrip.sensor.calibration import TYPICAL_LENGTHS
from tacstrip.sensor.spec import Sensor

_MOST = 400  # contacts; more than five times the thesis' 81 and a long day
_TOP = 14.0 / 15.0  # of the length
_SLANT = (0.15, 0.85)  # of the length, on the first strip and on the last
_CLEAR = 0.025  # over Vref: lower readings an offset may take to 0
_LENGTHS = (0, 5, 10)  # units, as in 6.1.1
_OTHER_LENGTHS = (0, 5, 10, 15)  # units: of contacts that shall be read well
# Readings of a strip for each parameter, at least: a spoilt row then stands out from the others.
_REDUNDANT = 2
# Parameters known to so much of what no press removes are known well enough: errors add in squares, a fifth to it.
_BESIDE = 0.7
_UNEVEN = 0.06  # spread of the resistivity along y that `uneven` is planned for, over its mean


@dataclass(frozen=True)
class Plan:
    """Contacts across all strips, and what they are predicted to give.

    Attributes
    ----------
    contacts
        Lower end, length [mm] and how many times, from the lowest up, short ones first.
    worst_percent
        Twice the predicted standard deviation of the least accurate corrected reading [% of Vref], as far as presses
        reduce it.
    floor_percent
        What 95 % of corrected readings keep were all parameters exact [% of Vref]: one signature does not tell a
        contact's length, and what uneven rubber does to a reading depends on that. 0 for all else.
    sigma
        Predicted standard deviation of each parameter, as fitted: over Vref or L, or of a logarithm.
    model
        The model that they are for.
    slanted_mm
        Lower ends of one more contact without length, slanted across the strips (strips,) [mm]: it shows strips whose
        wires are exchanged, which bars that lie straight cannot. Empty on curved surfaces and on fewer than three.
    reached
        Whether `promise_percent` is as small as was wanted.
    """

    contacts: tuple[tuple[float, float, int], ...]
    worst_percent: float
    floor_percent: float
    sigma: dict[str, float]
    model: str
    reached: bool
    slanted_mm: tuple[float, ...] = ()

    @property
    def promise_percent(self) -> float:
        """What 95 % of corrected readings of other contacts keep [% of Vref], their own noise not counted."""
        return float(np.hypot(self.worst_percent, self.floor_percent))

    @property
    def count(self) -> int:
        """How many contacts there are, repeats counted."""
        return sum(times for _, _, times in self.contacts)


def plan(
    sensor: Sensor,
    wanted_percent: float,
    noise: Noise,
    model: str = "",
    unit_mm: float | None = None,
    *,
    uneven: bool = False,
    place_mm: float = 0.1,
) -> Plan:
    """Return the contacts to make.

    Parameters
    ----------
    sensor
        The design is made for its spec's ratio and lambda.
    wanted_percent
        Twice the standard deviation that no corrected reading shall exceed [% of Vref]; the reading's own noise is
        not counted, as no calibration removes it.
    noise
        Of a reading.
    model
        Parts to be fitted; by default offset, gain, lambda, and the ratio of two layers of rubber.
    unit_mm
        Step of the places, the thesis' unit; by default about a thirtieth of the length, to .1 mm (below 1 mm to .01).
    uneven
        Whether the rubber may vary along y, by some 6 %: the default model with a warp.
    place_mm
        Half-width of the error of a contact's l and w, the same on all strips [mm].

    Raises
    ------
    OptionError
        A value that cannot be, or a construction without a closed form.
    """
    require_closed_form(sensor)
    if sensor.surface is not None and sensor.surface.along == "parallels":
        raise OptionError(
            "strips along parallels are each of their own length, and no contact lies alike on all of them: press "
            "where you can, and give the runs to the calibration"
        )
    parts = parse_model(model or planned_model(sensor, uneven).name, sensor, sensor.signatures)
    usual = sensor.length_mm / 32.5
    step = round(usual, 1 if usual >= 1.0 else 2 if usual >= 0.1 else 4) if unit_mm is None else unit_mm
    if not 0.0 < wanted_percent < 100.0:
        raise OptionError(f"--wanted {wanted_percent}: a percentage of Vref above 0, such as 0.2")
    if not 0.0 < step <= sensor.length_mm / 4.0 or sensor.length_mm / step > 1000.0:
        raise OptionError(f"--unit-mm {step:g}: must divide the length into 4 to 1000 units")
    sigma = np.sqrt((noise.quantisation**2 + noise.positional**2) / 3.0)
    if not sigma > 0.0:
        raise OptionError("--noise must be above 0: readings without noise need no plan")
    if not 0.0 <= place_mm < sensor.length_mm / 4.0:
        raise OptionError(f"--place-mm {place_mm:g}: must be from 0 to a quarter of the length")
    one, constants = _one_strip(sensor, parts)
    places, other = _places(sensor, step), _places(sensor, step, _OTHER_LENGTHS)
    least = np.min([v[:, 0] for v in predict(constants, one, *_columns(places)).values()], axis=0)
    places = places[least >= min(_CLEAR, least.max())]
    moves = jacobian_of_places(one, constants, *_columns(places))[:, :, 0]  # (signatures, places, 2)
    moves = moves * [[[1.0, 0.0]]] + moves * [[[0.0, 1.0]]] * (places[:, 1:] > 0.0)  # a point has no length
    design = _Design(
        by=_reading_jacobian(one, constants, places) / sigma,
        moves=np.moveaxis(moves, 0, 1) * place_mm / (np.sqrt(3.0) * sigma),
        other=_reading_jacobian(one, constants, other) / sigma,
        corrected=_correction_jacobian(one, constants, other) / sigma,
        shared=len(parts.shared),
        strips=sensor.strips,
        prior=_prior_information(parts, sensor),
    )
    counts = design.press(0.01 * wanted_percent / sigma)
    worst, spread = design.predicted(counts)
    contacts = tuple((float(l), float(w), counts[i]) for i, (l, w) in enumerate(places) if counts[i])
    names = (*parts.shared, *parts.own(sensor.signatures))
    return Plan(
        contacts, float(100.0 * worst * sigma), float(100.0 * design.floor * sigma),
        dict(zip(names, spread, strict=True)), parts.name,
        bool(np.hypot(worst, design.floor) * sigma <= 0.01 * wanted_percent),
        _slanted(sensor),
    )  # fmt: skip


def _slanted(sensor: Sensor) -> tuple[float, ...]:
    """Return the lower ends of a contact that lies slanted across flat strips (strips,) [mm]."""
    if sensor.surface is not None or sensor.strips < 3:
        return ()
    settable = 1 if sensor.length_mm >= 30.0 else 4  # digits, as the places have
    return tuple(np.round(np.linspace(*_SLANT, sensor.strips) * sensor.length_mm, settable).tolist())


def _columns(places: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return l and w of places (places, 2) on one strip, each (places, 1) [mm]."""
    return places[:, :1], places[:, 1:]


def _places(sensor: Sensor, step: float, lengths: tuple[int, ...] = _LENGTHS) -> FloatArray:
    """Return the contacts that may be made (places, 2), l and w [mm]: unit marks, 0, 5 and 10 units long.

    None ends within a fifteenth of the length from the end at Vref, where an offset may take readings to Vref.
    """
    last = _TOP * sensor.length_mm / step + 1e-9
    return np.round([(i * step, n * step) for n in lengths for i in range(1, int(last - n) + 1)], 9)


def _one_strip(sensor: Sensor, model: Model) -> tuple[Sensor, Constants]:
    """Return one strip of the sensor, and the constants that a plan is made for."""
    surface = sensor.surface
    if surface is not None:  # as narrow as one strip; even ones read as flat ones do
        surface = None if surface.even else replace(surface, around_deg=surface.around_deg / sensor.strips)
    one = replace(sensor, strips=1, surface=surface, calibration=None)
    return one, initial_constants(model, one, sensor.signatures)


def _reading_jacobian(one: Sensor, constants: Constants, places: FloatArray) -> FloatArray:
    """Return the derivatives of one strip's readings by its parameters (places, signatures, parameters)."""
    return np.asarray(np.moveaxis(jacobian(one, constants, *_columns(places))[:, :, 0], 0, 1))


def _correction_jacobian(one: Sensor, constants: Constants, places: FloatArray) -> FloatArray:
    """Return the same of what the correction takes away: one signature's warp as for `TYPICAL_LENGTHS`."""
    by = _reading_jacobian(one, constants, places)
    if len(constants.signatures) > 1 or not constants.model.has("warp"):
        return by
    length = one.length_mm
    k = places[:, 0] / (length - places[:, 1])
    alike = [np.stack([k * (1.0 - w), np.full_like(k, w)], axis=1) * length for w in TYPICAL_LENGTHS]
    names = (*constants.model.shared, *constants.names)
    warp = np.array([name.startswith("warp") for name in names])
    return np.where(warp, np.mean([_reading_jacobian(one, constants, p) for p in alike], axis=0), by)


def _prior_information(model: Model, sensor: Sensor) -> FloatArray:
    """Return what is known of the parameters before any contact (parameters, parameters): the inverse covariance."""
    names = (*model.shared, *model.own(sensor.signatures))
    known = np.diag([PARTS[name.split()[0]].prior ** -2.0 for name in names])
    if model.has("warp"):
        at = [i for i, name in enumerate(names) if name.startswith("warp")]
        root = pooled_precision(model, "warp") / _UNEVEN
        known[np.ix_(at, at)] = root.T @ root
    return known


@dataclass(frozen=True, eq=False)
class _Design:
    """What contacts tell; all errors are over a reading's noise.

    All strips are pressed alike, so what is known of them splits into two independent parts: the mean over the
    strips, with the shared parameters and the errors of places, and each strip's own deviation from it.

    Attributes
    ----------
    by, moves
        Derivatives of readings of contacts that may be pressed by the parameters, and by the errors of places over
        their deviations (places, signatures, parameters or 2).
    other, corrected
        Of contacts that shall be read well: derivatives of what they read, and of what the correction takes away.
    prior
        Information before any contact.
    """

    by: FloatArray
    moves: FloatArray
    other: FloatArray
    corrected: FloatArray
    shared: int
    strips: int
    prior: FloatArray

    @cached_property
    def information(self) -> tuple[FloatArray, FloatArray]:
        """Information of each contact on the mean of the strips, and on a strip's deviation from it."""
        size = self.by.shape[1]
        noise = np.eye(size) / self.strips + self.moves @ np.swapaxes(self.moves, 1, 2)
        transposed, own = np.swapaxes(self.by, 1, 2), self.by[..., self.shared :]
        return transposed @ np.linalg.solve(noise, self.by), np.swapaxes(own, 1, 2) @ own

    @cached_property
    def before(self) -> tuple[FloatArray, FloatArray]:
        """The same before any contact: strips' own parameters are independent."""
        many = np.where(np.arange(len(self.prior)) < self.shared, 1.0, np.sqrt(self.strips))
        return self.prior * many * many[:, None], self.prior[self.shared :, self.shared :]

    @cached_property
    def floor(self) -> float:
        """What 95 % of other readings keep were all parameters exact."""
        left = (self.other - self.corrected).reshape(-1, len(self.prior))
        sigma = np.sqrt(((left @ np.linalg.inv(self.prior)) * left).sum(axis=1))
        if not sigma.any():
            return 0.0
        tried = np.linspace(0.0, 4.0 * sigma.max(), 1000)
        beyond = 2.0 * ndtr(-tried[:, None] / np.maximum(sigma, 1e-9)).mean(axis=1)
        return float(tried[np.argmax(beyond <= 0.05)])

    def covariance(self, mean: FloatArray, own: FloatArray) -> FloatArray:
        """Return the covariance of shared and one strip's parameters (n, P, P) from information."""
        found = np.linalg.inv(mean)
        found[:, self.shared :, self.shared :] += (1.0 - 1.0 / self.strips) * np.linalg.inv(own)
        return np.asarray(found)

    def variances(self, covariance: FloatArray) -> FloatArray:
        """Return the variances of other readings (n, readings) that follow from the parameters'."""
        rows = self.other.reshape(-1, len(self.prior))
        return np.asarray(((rows @ covariance) * rows).sum(axis=2))

    def press(self, wanted: float) -> Counter[int]:
        """Return how often each place is pressed, until the worst two sigma are as wanted or below the floor."""
        counts: Counter[int] = Counter()
        worst, least = np.inf, _REDUNDANT * len(self.prior) / self.by.shape[1]
        enough = max(wanted, _BESIDE * self.floor)
        mean, own = self.before
        while (worst > enough or counts.total() < least) and counts.total() < _MOST:
            of_mean, of_own = self.information
            variance = self.variances(self.covariance(mean + of_mean, own + of_own)).max(axis=1)
            best = int(variance.argmin())
            worst = float(2.0 * np.sqrt(variance[best]))
            counts[best] += 1
            mean, own = mean + of_mean[best], own + of_own[best]
        return counts

    def predicted(self, counts: Counter[int]) -> tuple[float, FloatArray]:
        """Return the worst two sigma of other readings, and the parameters' sigmas, after these contacts."""
        mean, own = (
            now + sum(times * each[i] for i, times in counts.items())
            for now, each in zip(self.before, self.information, strict=True)
        )
        covariance = self.covariance(mean[None], own[None])
        worst = 2.0 * np.sqrt(self.variances(covariance).max())
        return float(worst), np.sqrt(np.diag(covariance[0]))
