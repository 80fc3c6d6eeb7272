"""Which contacts to make: as few as give a wanted accuracy (sequential G-optimal design).

Contacts run across all strips, so one press informs every strip's own parameters and the shared ones. The next
contact is always the one after which the worst predicted error of a corrected reading is least.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.calibrate.fit import jacobian
from tacstrip.calibrate.model import PARTS, Model, initial_constants, pooled_precision
from tacstrip.calibrate.model_selection import parse_model, planned_model
from tacstrip.calibrate.unit import require_closed_form
from tacstrip.contact.noise import Noise
from tacstrip.errors import OptionError
from tacstrip.sensor.spec import Sensor

_MOST = 400  # contacts; more than five times the thesis' 81 and a long day
_TOP = 14.0 / 15.0  # of the length
_LENGTHS = (0, 5, 10)  # units, as in 6.1.1
_OTHER_LENGTHS = (0, 5, 10, 15)  # units: of contacts that shall be read well
# Readings of a strip for each parameter, at least: a spoilt row then stands out from the others.
_REDUNDANT = 2
_UNEVEN = 0.06  # spread of the resistivity along y that `uneven` is planned for, over its mean


@dataclass(frozen=True)
class Plan:
    """Contacts across all strips, and what they are predicted to give.

    Attributes
    ----------
    contacts
        Lower end, length [mm] and how many times, from the lowest up, short ones first.
    worst_percent
        Twice the predicted standard deviation of the least accurate corrected reading [% of Vref].
    sigma
        Predicted standard deviation of each parameter, as fitted: over Vref or L, or of a logarithm.
    model
        The model that they are for.
    reached
        Whether `worst_percent` is as small as was wanted.
    """

    contacts: tuple[tuple[float, float, int], ...]
    worst_percent: float
    sigma: dict[str, float]
    model: str
    reached: bool

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
    places = _places(sensor, step)
    by, other = (
        _reading_jacobian(sensor, parts, p) / sigma  # (places, signatures, parameters)
        for p in (places, _places(sensor, step, _OTHER_LENGTHS))
    )
    wanted, prior = 0.01 * wanted_percent / sigma, _prior_information(parts, sensor)
    counts, worst, spread = _design(by, other, len(parts.shared), sensor.strips, wanted, prior)
    names = (*parts.shared, *parts.own(sensor.signatures))
    contacts = tuple((float(l), float(w), counts[i]) for i, (l, w) in enumerate(places) if counts[i])
    return Plan(
        contacts, float(100.0 * worst * sigma), dict(zip(names, spread, strict=True)), parts.name,
        bool(worst * sigma <= 0.01 * wanted_percent),
    )  # fmt: skip


def _places(sensor: Sensor, step: float, lengths: tuple[int, ...] = _LENGTHS) -> FloatArray:
    """Return the contacts that may be made (places, 2), l and w [mm]: unit marks, 0, 5 and 10 units long.

    None ends within a fifteenth of the length from the end at Vref, where an offset may take readings to Vref.
    """
    last = _TOP * sensor.length_mm / step + 1e-9
    return np.round([(i * step, n * step) for n in lengths for i in range(1, int(last - n) + 1)], 9)


def _reading_jacobian(sensor: Sensor, model: Model, places: FloatArray) -> FloatArray:
    """Return the derivatives of one strip's readings by its parameters (places, signatures, parameters)."""
    surface = sensor.surface
    if surface is not None:  # as narrow as one strip; even ones read as flat ones do
        surface = None if surface.even else replace(surface, around_deg=surface.around_deg / sensor.strips)
    one = replace(sensor, strips=1, surface=surface, calibration=None)
    constants = initial_constants(model, one, sensor.signatures)
    l, w = places[:, :1], places[:, 1:]
    return np.asarray(np.moveaxis(jacobian(sensor, constants, l, w)[:, :, 0], 0, 1))


def _prior_information(model: Model, sensor: Sensor) -> FloatArray:
    """Return what is known of the parameters before any contact (parameters, parameters): the inverse covariance."""
    names = (*model.shared, *model.own(sensor.signatures))
    known = np.diag([PARTS[name.split()[0]].prior ** -2.0 for name in names])
    if model.has("warp"):
        at = [i for i, name in enumerate(names) if name.startswith("warp")]
        root = pooled_precision(model, "warp") / _UNEVEN
        known[np.ix_(at, at)] = root.T @ root
    return known


def _design(
    by: FloatArray, other: FloatArray, shared: int, strips: int, wanted: float, prior: FloatArray
) -> tuple[Counter[int], float, FloatArray]:
    """Return how often each place is pressed, the worst 2 sigma over a reading's noise, and parameters' sigmas.

    `by` and `other`: derivatives of contacts that may be pressed, and of those that shall be read well.
    """
    each = np.einsum("csp,csq->cpq", by, by)  # (places, P, P): Fisher information of a contact
    # A prior of the shared parameters belongs to all strips together: a part of it to each.
    part = np.where(np.arange(len(prior)) < shared, 1.0 / np.sqrt(strips), 1.0)
    now = prior * part * part[:, None]
    counts: Counter[int] = Counter()
    worst, least = np.inf, _REDUNDANT * len(prior) / by.shape[1]
    rows = other.reshape(-1, other.shape[2])
    while (worst > wanted or counts.total() < least) and counts.total() < _MOST:
        spread = _covariance(now + each, shared, strips)  # (places, P, P)
        variance = ((rows @ spread) * rows).sum(axis=2).max(axis=1)
        best = int(variance.argmin())
        worst = float(2.0 * np.sqrt(variance[best]))
        counts[best] += 1
        now = now + each[best]
    return counts, worst, np.sqrt(np.diag(_covariance(now[None], shared, strips)[0]))


def _covariance(information: FloatArray, shared: int, strips: int) -> FloatArray:
    """Return the covariance of shared and one strip's parameters (n, P, P), all strips with the same information."""
    s, o = slice(None, shared), slice(shared, None)
    total = information.copy()
    own = np.linalg.solve(information[:, o, o], information[:, o, s])
    total[:, s, s] += (strips - 1) * (information[:, s, s] - information[:, s, o] @ own)
    return np.asarray(np.linalg.inv(total))
