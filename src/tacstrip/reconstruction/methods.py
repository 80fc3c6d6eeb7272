"""The one door to all methods, by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tacstrip.arguments import takes
from tacstrip.contact.noise import Noise
from tacstrip.errors import OptionError, one_of
from tacstrip.reconstruction.profile import profile_reconstruction
from tacstrip.reconstruction.result import Reconstruction
from tacstrip.reconstruction.vertex.estimate import vertex_reconstruction
from tacstrip.scan import Scan
from tacstrip.sensor.layers import AnySensor, LayeredSensor, unit_of
from tacstrip.sensor.spec import Sensor


def _polygon(scan: Scan, sensor: Sensor, noise: Noise | None, **options: Any) -> Reconstruction:
    from tacstrip.reconstruction.polygon.estimate import fit_polygon  # late: other methods do without it

    return fit_polygon(scan, sensor, noise, **options)


def _pieces(scan: Scan, sensor: Sensor, noise: Noise | None) -> Reconstruction:
    from tacstrip.reconstruction.pieces.estimate import (
        piece_reconstruction,  # late: other methods do without it
    )

    return piece_reconstruction(scan, sensor, noise)


_LAYERED = "polygon"  # the method of two layers
METHODS: dict[str, Callable[..., Reconstruction]] = {
    "polygon": _polygon,
    "vertex": vertex_reconstruction,
    "profile": profile_reconstruction,
    "pieces": _pieces,
}


def quick_options(method: str) -> dict[str, Any]:
    """Return the options by which a method keeps up with a stream."""
    return {"assessment": "fast"} if method == "polygon" else {}


def best_method(sensor: Sensor) -> str:
    """Return the name of the method to take where the user does not say."""
    return "polygon" if sensor.kind.closed_form else "profile"


def methods_of(sensor: AnySensor) -> tuple[str, ...]:
    """Return the names of all methods; of two layers, of the only one."""
    return (_LAYERED,) if isinstance(sensor, LayeredSensor) else tuple(METHODS)


def chosen_method(method: str | None, sensor: AnySensor) -> str:
    """Return the name of a method that exists: the given one, or for None and "auto" the best for this sensor.

    Raises
    ------
    OptionError
        There is no such method, or it is not for two layers.
    """
    name = best_method(unit_of(sensor)) if method is None or method == "auto" else method
    if isinstance(sensor, LayeredSensor) and name != _LAYERED:
        raise OptionError(f'method = {method!r}: two layers are reconstructed by "{_LAYERED}"')
    if name not in METHODS:
        raise OptionError(one_of("method", name, METHODS))
    return name


@takes(scan=Scan, sensor=Sensor | LayeredSensor, noise=Noise)
def reconstruct(
    scan: Scan, sensor: AnySensor, noise: Noise | None = None, *, method: str | None = "auto", **options: Any
) -> Reconstruction:
    """Reconstruct what touches the sensor from one scan.

    Parameters
    ----------
    scan, sensor
        What was measured, with what; of two layers, polygons are fitted to both layers' readings together.
    noise
        The errors of the readings, if they are known; None: estimated from the readings where the method needs them.
    method
        "polygon" (`fit_polygon`), "vertex" (`vertex_reconstruction`), "profile" (`profile_reconstruction`), "pieces"
        (`pieces`: several objects on the same strips), or "auto", the best for this sensor.
    **options
        Of that method's function.

    Returns
    -------
    Reconstruction
        An object per contact, each with a status and advice.

    Raises
    ------
    OptionError
        There is no such method, or it is not for this construction.
    SignatureError, ReadingError
        The scan lacks what the method needs, or is not of this sensor.

    Examples
    --------
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-crs", strips=100, pitch_mm=1.0, length_mm=100.0)
    >>> contact = ts.Contact.polygon([(20, 40), (55, 20), (80, 50), (45, 75)])
    >>> noise = ts.Noise(positional=0.002)
    >>> found = ts.reconstruct(ts.simulate(sensor, contact, noise, rng=1), sensor, noise)
    >>> found.status, len(found.objects[0].vertices)
    ('ok', 4)
    """
    name = chosen_method(method, sensor)
    if isinstance(sensor, LayeredSensor):
        from tacstrip.reconstruction.layered.estimate import fit_layers  # late: one layer does without it

        return fit_layers(scan, sensor, noise, **options)
    return METHODS[name](scan, sensor, noise=noise, **options)
