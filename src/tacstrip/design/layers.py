"""What a second layer buys: the Cramer-Rao bound of several objects' corners, from both layers and from each alone."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import shapely

from tacstrip.arrays import FloatArray
from tacstrip.contact.noise import Noise
from tacstrip.contact.shape import Contact
from tacstrip.core.scene import Scene, SceneProblem
from tacstrip.errors import ContactError
from tacstrip.fisher import checked_sigma, covariance
from tacstrip.reconstruction.layered.estimate import scene_problem
from tacstrip.reconstruction.noise_covariance import Averaging, common_variance, fit_sigma, signature_variance
from tacstrip.sensor.layers import LayeredSensor
from tacstrip.simulation import simulate


@dataclass(frozen=True, eq=False)
class LayerLimit:
    """The bound from some of the layers.

    Attributes
    ----------
    layers
        Their numbers.
    sigma
        Standard errors of x and y of every corner of every object (M, 2) [mm]; inf where no strip sees it.
    """

    layers: tuple[int, ...]
    sigma: FloatArray


def outlines_of(contact: Contact) -> list[FloatArray]:
    """Return the outlines (N, 2) [mm] of a contact's polygons; `ContactError` where it has none."""
    polygons = [Contact((shape,)).vertices for shape in contact.shapes if shape.area > 0.0]
    if not polygons:
        raise ContactError(
            "limits are those of a polygon's corners, and the contact holds lines or points only"
        )
    return polygons


def layer_limits(sensor: LayeredSensor, contact: Contact, noise: Noise) -> list[LayerLimit]:
    """Return the bounds of the corners of a contact's polygons: from both layers, then from each alone.

    Raises
    ------
    ContactError
        The contact holds no polygon, or lies beside both layers.
    ReadingError
        The noise is none.

    Examples
    --------
    >>> import tacstrip as ts
    >>> from tacstrip.design.layers import layer_limits
    >>> sensor = ts.Sensor.load("layered-crs-crs")
    >>> pair = ts.Contact.polygon([(20, 20), (45, 25), (30, 50)])
    >>> both, first, second = layer_limits(sensor, pair, ts.Noise(positional=0.005))
    >>> bool((both.sigma <= first.sigma).all())
    True
    """
    outlines = outlines_of(contact)
    scene = Scene.of(outlines)
    averaging = Averaging()
    sigma = checked_sigma(max(fit_sigma(noise, layer.sensor, averaging) for layer in sensor.layers))
    areas = Contact(tuple(shapely.Polygon(outline) for outline in outlines))
    problem = scene_problem(simulate(sensor, areas), sensor, sigma)
    every = tuple(range(len(problem.layers)))
    shared = common_variance(noise, averaging) + signature_variance(noise, averaging)
    return [
        LayerLimit(which, _sigma(problem, which, scene, shared)) for which in (every, *((k,) for k in every))
    ]


def _sigma(problem: SceneProblem, layers: tuple[int, ...], scene: Scene, shared: float) -> FloatArray:
    """Return the standard errors; `shared` is the variance of the error that all readings have alike [Vref^2]."""
    own = replace(problem, layers=tuple(problem.layers[k] for k in layers))
    fitted = own.fitted(scene)
    information = fitted.information + own.end_information(scene)
    pull = own.of_offset(fitted)  # what an offset, fitted along with a prior, takes away
    information -= shared / (1.0 + shared * own.readings / own.sigma**2) * np.outer(pull, pull)
    value, vector = np.linalg.eigh(information)
    found = covariance(np.sqrt(np.maximum(value, 0.0))[:, None] * vector.T)
    sigma = np.sqrt(np.diag(found)).reshape(-1, 2)
    return np.where(sigma > problem.length_mm, np.inf, sigma)  # rounding
