"""Sensor + contact + noise -> scan."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Literal

import numpy as np
import numpy.typing as npt
import shapely

from tacstrip.arguments import takes
from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.contact.footprint import contact_ends, footprint, on_sensor
from tacstrip.contact.noise import Noise, NoiseProcess, Rng, digitise
from tacstrip.contact.press.patch import Patch
from tacstrip.contact.shape import Contact
from tacstrip.contact.signature import signatures
from tacstrip.contact.strip_width import wide, wide_ends
from tacstrip.core.batch import closed_forms
from tacstrip.errors import ContactError, OptionError, one_of
from tacstrip.network.crp.mesh import Wiring
from tacstrip.network.crp.readings import contact_electrodes
from tacstrip.network.imperfections import Imperfections, Readout
from tacstrip.network.strips.ladder import fast_readings
from tacstrip.network.strips.resolved import wide_readings
from tacstrip.scan import Scan
from tacstrip.sensor.constructions import check_closed_form
from tacstrip.sensor.layers import AnySensor, Layer, LayeredSensor
from tacstrip.sensor.left_out import leave_out
from tacstrip.sensor.spec import Sensor

_MODELS = ("closed", "network")
_ELECTRODES = ("own", "all")
_IDEAL = Noise()


@takes(sensor=Sensor | LayeredSensor, contact=Contact | Patch, noise=Noise)
def simulate(
    sensor: AnySensor,
    contact: Contact | Patch,
    noise: Noise = _IDEAL,
    *,
    rng: Rng = 0,
    model: Literal["closed", "network"] | None = None,
    time_s: float = 0.0,
    imperfections: Imperfections | None = None,
    readout: Readout | None = None,
    wiring: Wiring | None = None,
    electrodes: Literal["own", "all"] = "own",
    process: NoiseProcess | None = None,
) -> Scan:
    """Return the scan that the sensor makes of a contact, without channels that its spec leaves out.

    Parameters
    ----------
    sensor, contact
        What touches what: a contact flat on the skin, in strip coordinates, or the patch of a pressed solid (`press`).
        On a sensor of two layers the contact lies in the frame of the whole.
    noise
        Errors on the readings; ideal by default. Its transition error does not show in a scan.
    rng
        A seed, or a NumPy generator to go on with.
    model
        "closed": the closed forms of chapter 3. "network": the sensor as a network of resistors, each
        separate piece of the contact on its own. By default closed where there is one, so not for CRS-CRP; of strips
        as wide as `strip_width_mm` those that no closed form fits (a corner on them, covered in part) are resolved.
    time_s
        The scan's time [s].
    imperfections, readout
        With the network: the unit's imperfections, its wiring and electronics; ideal by default.
    wiring, electrodes
        CRS-CRP: what strips and sheet edges are joined to, nothing by default; and whether the scan keeps each
        strip's own two electrodes or "all" of them, each with its own error.
    process
        In place of `noise` and `rng`: errors that last from scan to scan, `NoiseProcess(noise, sensor, rng)`; of a
        sensor of two layers `NoiseProcess(noise, sensor.unit, rng)`.

    Raises
    ------
    ContactError
        The contact lies outside the sensor, or ties a strip's both ends to a metal sheet.
    OptionError
        There is no such model, or the closed forms were given imperfections or a readout.
    NetworkError
        The network cannot be: a fault off the sensor, a sensing strip cut off, a resistance of 0 or less.

    Examples
    --------
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-crs", strips=4, pitch_mm=10.0, length_mm=100.0)
    >>> ts.simulate(sensor, ts.Contact.line([(12, 30), (28, 30)])).touched.tolist()
    [False, True, True, False]
    """
    if model is not None and model not in _MODELS:
        raise OptionError(one_of("model", model, _MODELS))
    if electrodes not in _ELECTRODES:
        raise OptionError(one_of("electrodes", electrodes, _ELECTRODES))
    if isinstance(sensor, LayeredSensor):
        if (model, imperfections, readout, wiring, electrodes) != (None, None, None, None, "own"):
            raise OptionError(
                "a sensor of two layers is simulated by closed forms; leave model and wiring out"
            )
        if isinstance(contact, Patch):
            raise OptionError("a patch is of a sensor of one layer: press into that (ts.press)")
        process = process or NoiseProcess(noise, sensor.unit, rng)
        return _layered(sensor, contact, process, time_s)
    process = process or NoiseProcess(noise, sensor, rng)
    if isinstance(contact, Patch):
        if model == "network" or not sensor.kind.closed_form or imperfections or readout or wiring:
            raise OptionError("a patch needs closed forms: it is not for a network, nor for a crs-crp sensor")
        return _of_patch(process, sensor, contact, time_s)
    if sensor.surface is not None and sensor.surface.along == "parallels":
        raise OptionError(
            "strips along parallels are each of their own length, and take no flat contact: press a solid (ts.press)"
        )
    if not sensor.kind.closed_form:
        if model == "closed":
            check_closed_form(sensor.kind, 'model="closed"')
        if imperfections is not None or readout is not None:
            raise OptionError(
                f"imperfections and readout are not for a {sensor.construction} sensor; it has a wiring"
            )
        strips = np.arange(sensor.strips)
        every = np.full((sensor.strips, 2 * sensor.strips), np.nan)
        if np.isfinite(footprint(sensor, contact).l).any():
            every = contact_electrodes(sensor, contact, wiring)
        if electrodes == "all":
            return Scan.of_electrodes(_measured(process, {"all": every}, time_s)["all"], time_s)
        own = {"kh": every[strips, sensor.strips + strips], "kl": every[strips, strips]}
        return Scan(**_measured(process, own, time_s), time_s=time_s)
    if wiring is not None or electrodes == "all":
        raise OptionError(
            f"wiring and electrodes are for crs-crp sensors; a {sensor.construction} sensor has no sheet electrodes"
        )
    if model == "network":
        ideal = fast_readings(sensor, contact, imperfections, readout)
        soft = footprint(sensor, contact) if process.noise.soft else None
        ends = None if soft is None else (soft.l, soft.u)
        return Scan(**leave_out(sensor, _measured(process, ideal, time_s, ends)), time_s=time_s)
    if imperfections is not None or readout is not None:
        raise OptionError(
            'imperfections and readout need model="network": the closed forms know ideal units only'
        )
    return _scan(process, sensor, *_closed(sensor, contact, resolved=model is None), time_s)


def _of_patch(process: NoiseProcess, sensor: Sensor, patch: Patch, time_s: float) -> Scan:
    """Return the scan of a pressed solid: `ContactError` where its patch is of another sensor."""
    if len(patch.l) != sensor.strips:
        raise ContactError(f"the patch has {len(patch.l)} strips and the sensor has {sensor.strips}")
    ends = patch.l, patch.u
    return _scan(process, sensor, patch.touched, ends, signatures(sensor, *ends), time_s)


def _scan(
    process: NoiseProcess,
    sensor: Sensor,
    touch: BoolArray,
    ends: tuple[FloatArray, FloatArray],
    ideal: dict[str, FloatArray],
    time_s: float,
) -> Scan:
    """Return readings with their errors as a scan: `ContactError` where metal shorts Vref to ground."""
    scan = _measured(process, ideal, time_s, ends)
    if sensor.sensing_ratio == 0.0:
        _check_shorted(scan, touch, lambda strip: f"strip {strip + sensor.strip_base}")
    return Scan.of_readings(leave_out(sensor, scan), time_s)


def _layered(sensor: LayeredSensor, contact: Contact, process: NoiseProcess, time_s: float) -> Scan:
    """Return what the layers read, each in its own frame, one after another."""
    parts = [_of_layer(layer, contact) for layer in sensor.layers]
    if all(part is None for part in parts):
        lies = ", ".join(f"({x:.4g}, {y:.4g})" for x, y in sensor.layers[0].corners_mm)
        raise ContactError(f"the contact lies beside both layers; layer 0 has its corners at {lies} mm")
    blank = [(np.zeros(x.sensor.strips, dtype=bool), np.full(x.sensor.strips, np.nan)) for x in sensor.layers]
    seen = [
        (touch, (nan, nan), dict.fromkeys(sensor.signatures, nan)) if part is None else part
        for part, (touch, nan) in zip(parts, blank, strict=True)
    ]
    l, u = (np.concatenate([ends[i] for _, ends, _ in seen]) for i in range(2))
    ideal = {name: np.concatenate([k[name] for _, _, k in seen]) for name in sensor.signatures}
    scan = _measured(process, ideal, time_s, (l, u))
    _check_shorted(scan, np.concatenate([touch for touch, _, _ in seen]), sensor.where)
    return Scan(**leave_out(sensor.unit, scan), time_s=time_s)


def _of_layer(
    layer: Layer, contact: Contact
) -> tuple[BoolArray, tuple[FloatArray, FloatArray], dict[str, FloatArray]] | None:
    """Return what one layer reads; None where the contact lies beside it."""
    own = Contact(tuple(shapely.transform(shape, layer.to_layer) for shape in contact.shapes))
    surface = shapely.box(0.0, 0.0, layer.sensor.width_mm, layer.sensor.length_mm)
    if not shapely.intersects(surface, shapely.GeometryCollection(list(own.shapes))):
        return None
    return _closed(layer.sensor, own, resolved=True)


def _check_shorted(scan: Mapping[str, FloatArray], touch: BoolArray, name_of: Callable[[int], str]) -> None:
    """Refuse a contact that ties both ends of a strip to a metal sheet: `ContactError`."""
    for values in scan.values():
        if (shorted := np.isnan(values) & touch).any():
            raise ContactError(
                f"the contact covers {name_of(int(shorted.argmax()))} from end to end: on metal that shorts Vref to "
                "ground, and nothing can be read"
            )


def _closed(
    sensor: Sensor, contact: Contact, resolved: bool
) -> tuple[BoolArray, tuple[FloatArray, FloatArray], dict[str, FloatArray]]:
    """Return which strips are touched, l and u [mm], and ideal readings; strips without closed form may be resolved."""
    if not wide(sensor, [contact]):
        l, u = contact_ends(sensor, contact)
        return ~np.isnan(l), (l, u), closed_forms(sensor, l, u) or signatures(sensor, l, u)
    contact = on_sensor(sensor, contact)
    ends = wide_ends(sensor, [contact])
    touch, ideal = ~np.isnan(ends.l[0]), signatures(sensor, ends.l[0], ends.u[0])
    bounds = shapely.bounds(np.array(contact.shapes))[:, [0, 2], None]  # (shapes, 2, 1)
    beyond = np.abs(sensor.x_mm - np.clip(sensor.x_mm, bounds[:, 0], bounds[:, 1])).min(axis=0)
    near = beyond <= 0.5 * sensor.strip_width
    if resolved and (inexact := np.flatnonzero(near & ~ends.exact[0])).size:
        for name, values in wide_readings(sensor, contact, strips=inexact).items():
            ideal[name][inexact] = values[inexact]
        touch = ~np.isnan(next(iter(ideal.values())))
    return touch, (ends.l[0], ends.u[0]), ideal


def readings(
    sensor: Sensor,
    l_mm: FloatArray,
    u_mm: FloatArray,
    noise: Noise = _IDEAL,
    rng: Rng = 0,
    *,
    process: NoiseProcess | None = None,
    time_s: npt.ArrayLike = 0.0,
) -> dict[str, FloatArray]:
    """Return the readings of contacts from l to u, name to array over Vref.

    l and u [mm] have the shape (strips,) for one scan or (scans, strips) for many, NaN where nothing
    touches; so have the results. Errors that last from scan to scan need the scans' times [s], and come from
    `process` in place of `noise` and `rng` where they go on from earlier scans.
    """
    process = process or NoiseProcess(noise, sensor, rng)
    return _measured(process, signatures(sensor, l_mm, u_mm), time_s, (l_mm, u_mm))


def _measured(
    process: NoiseProcess,
    ideal: dict[str, FloatArray],
    time_s: npt.ArrayLike,
    ends_mm: tuple[FloatArray, FloatArray] | None = None,
) -> dict[str, FloatArray]:
    noisy = process.add(ideal, time_s, ends_mm)
    sensor = process.sensor
    digital = digitise(np.array([*noisy.values()]), sensor.adc_bits, sensor.converter)
    return dict(zip(noisy, digital, strict=True))
