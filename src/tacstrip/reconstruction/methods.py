"""The methods by name, for whoever lets a user choose one."""

from __future__ import annotations

from collections.abc import Callable

from tacstrip.contact.noise import Noise
from tacstrip.errors import OptionError, one_of
from tacstrip.reconstruction.profile import profile_reconstruction
from tacstrip.reconstruction.result import Reconstruction
from tacstrip.reconstruction.vertex.estimate import vertex_reconstruction
from tacstrip.scan import Scan
from tacstrip.sensor.spec import Sensor


def _polygon(scan: Scan, sensor: Sensor, noise: Noise | None) -> Reconstruction:
    from tacstrip.reconstruction.polygon.estimate import fit_polygon  # late: other methods do without it

    return fit_polygon(scan, sensor, noise)


def _vertex(scan: Scan, sensor: Sensor, noise: Noise | None) -> Reconstruction:
    return vertex_reconstruction(scan, sensor, noise=noise)


METHODS: dict[str, Callable[[Scan, Sensor, Noise | None], Reconstruction]] = {
    "polygon": _polygon,
    "vertex": _vertex,
    "profile": profile_reconstruction,
}


def best_method(sensor: Sensor) -> str:
    """Return the name of the method to take where the user does not say."""
    return "polygon" if sensor.kind.closed_form else "profile"


def recover(
    scan: Scan, sensor: Sensor, method: str | None = None, noise: Noise | None = None
) -> Reconstruction:
    """Recover shapes by the method of that name, by default the best for this sensor.

    Raises
    ------
    OptionError
        There is no such method, or it is not for this construction.
    SignatureError, ReadingError
        The scan lacks what the method needs, or is not of this sensor.
    """
    name = best_method(sensor) if method is None else method
    if name not in METHODS:
        raise OptionError(one_of("method", name, METHODS))
    return METHODS[name](scan, sensor, noise)
