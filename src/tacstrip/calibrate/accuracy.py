"""Accuracy: how far corrected readings of other contacts may be off."""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.calibrate.fit import ModelFit, jacobian
from tacstrip.calibrate.model import predict
from tacstrip.calibrate.residuals import residuals
from tacstrip.io.runs import Runs
from tacstrip.sensor.spec import Sensor

_PLACES = 24  # along a strip
_LENGTHS = (0.0, 0.15, 0.3, 0.45)  # of a strip
_SIGMAS, _ONE_SIDE = 2.0, 1.64  # that hold 95 %: of an error about 0, of one about something large
_MOST = 0.95  # of the readings


def accuracy_percent(sensor: Sensor, calibrated: Sensor, fit: ModelFit) -> float:
    """Return what 95 % of corrected readings of other contacts keep, with 95 % [% of Vref].

    The readings' own noise is not counted. To the parameters' deviations comes what the correction leaves were they
    exact: one signature does not tell a contact's length, and what uneven rubber does to it depends on that.

    Parameters
    ----------
    sensor, calibrated
        Without and with the fit's constants.
    fit
        Its covariance counts.
    """
    l, w = (np.broadcast_to(v[:, None], (len(v), sensor.strips)) for v in _contacts(sensor.length_mm))
    constants = fit.constants
    raw = predict(constants, sensor, l, w)
    others = Runs(l, w, raw, line=np.zeros(l.shape, int), rest={})
    bias = np.abs(np.stack(list(residuals(calibrated, others).values())))  # (signatures, contacts, strips)
    # Own before shared parameters, as in the covariance.
    by = np.roll(jacobian(sensor, constants, l, w), -len(constants.shared), axis=-1)
    gain = np.stack([np.broadcast_to(1.0 + constants.value(f"gain {s}"), sensor.strips) for s in raw])
    variance = np.einsum("scnp,npq,scnq->scn", by, fit.covariance, by)
    sigma = np.sqrt(np.maximum(variance, 0.0)) / gain[:, None, :]
    off = np.maximum(_SIGMAS * sigma, bias + _ONE_SIDE * sigma)
    read = np.stack([(v > 0.0) & (v < 1.0) for v in raw.values()]) & (fit.weight > 0.0).any(axis=0)
    return float(100.0 * np.quantile(off[read], _MOST)) if read.any() else np.nan


def _contacts(length_mm: float) -> tuple[FloatArray, FloatArray]:
    """Return contacts of all places and of lengths up to half a strip's: l and w [mm] (contacts,)."""
    shares = np.linspace(0.02, 0.98, _PLACES)
    l, w = (v.ravel() for v in np.meshgrid(shares, _LENGTHS))
    inside = l + w <= shares[-1]
    return l[inside] * length_mm, w[inside] * length_mm
