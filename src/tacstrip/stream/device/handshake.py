"""The handshake with a device: identify it, and check that it is the one that the spec describes."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

from tacstrip.data import spec_names
from tacstrip.errors import PortError, SpecError
from tacstrip.sensor.layers import AnySensor, LayeredSensor, unit_of
from tacstrip.sensor.spec import Sensor
from tacstrip.stream.device.port import Port
from tacstrip.stream.device.protocol.decoder import Decoder
from tacstrip.stream.device.protocol.frames import Kind
from tacstrip.stream.device.protocol.messages import Command, Hello, is_name

_ASK_S = 0.5  # between two requests to identify itself
_READ_S = 0.1
_BOTH_S = 0.2  # between identifications of two units: nobody changes a plug so fast


class WrongDeviceError(PortError):
    """The device is not the one that the spec or the stream is for."""


def handshake(port: Port, decoder: Decoder, wait_s: float, cancelled: Callable[[], bool]) -> Hello:
    """Ask a device to identify itself until it answers.

    Parameters
    ----------
    port, decoder
        The line, and the decoder of what comes from it.
    wait_s
        Longest time to wait for the answer [s].
    cancelled
        Whether the caller has given up.

    Raises
    ------
    PortError
        No device that speaks the protocol answers; the message says what came instead.
    OSError
        The device was unplugged.
    """
    n_bytes, asked_s, start_s = 0, -_ASK_S, time.monotonic()
    while (now_s := time.monotonic() - start_s) < wait_s and not cancelled():
        if now_s - asked_s >= _ASK_S:
            asked_s = now_s
            port.write(Command(Kind.IDENTIFY).encode())
        data = port.read(_READ_S)
        n_bytes += len(data)
        hellos = [message for message in decoder.feed(data) if isinstance(message, Hello)]
        for hello in hellos:
            check_alone(hello, hellos[0], 0.0)
        if hellos:
            return hellos[-1]
    counts = decoder.counts
    if not n_bytes:
        reason = "nothing came: is the firmware on it, and is this its port?"
    elif counts.unknown:
        reason = "its frames are of another version of the protocol: flash the firmware of this tacstrip"
    elif counts.frames:
        reason = "it sends, but does not say who it is: is its receiving line connected?"
    else:
        reason = f"{n_bytes} bytes came and no frame among them: another device, or another --baud"
    raise PortError(f"no tacstrip device answered within {wait_s:g} s; {reason}")


def check_device(hello: Hello, sensor: Sensor) -> None:
    """Raise `WrongDeviceError` where the device is not the one of this spec; it names both values."""
    device = {"construction": hello.construction, "strips": hello.strips, "adc_bits": hello.adc_bits}
    for key, found in device.items():
        wanted = getattr(sensor, key)
        if wanted is not None and wanted != found:
            raise WrongDeviceError(
                f"the device has {key} = {found} and the spec {wanted}: name the right spec with --sensor, or flash "
                "the firmware for it"
            )
    if unknown := [name for name in hello.signatures if name not in sensor.signatures]:
        raise WrongDeviceError(
            f"the device measures {unknown[0]}, which a {sensor.construction} sensor does not have"
        )
    unit = "" if sensor.calibration is None else sensor.calibration.unit
    if is_name(unit) and unit != hello.unit_name:
        raise WrongDeviceError(
            f"the spec's calibration is of the unit {unit!r}, and the device is {hello.unit_name!r}: name that unit's "
            f"own spec with --sensor, or calibrate it (tacstrip calibrate --unit {hello.unit_name})"
        )


def check_unit(hello: Hello, first: Hello) -> None:
    """Raise `WrongDeviceError` where the device is not the one that the stream began with; it names both."""
    for key in ("unit_name", "construction", "strips", "signatures", "adc_bits"):
        now, before = getattr(hello, key), getattr(first, key)
        if now != before:
            raise WrongDeviceError(
                f"another device is on the port: it has {key} = {now!r}, and the stream began with {before!r}, whose "
                "spec and calibration are not its own; start again with those of the new one"
            )


def check_alone(hello: Hello, first: Hello, since_s: float) -> None:
    """Raise `WrongDeviceError` where another unit answers so soon after the stream's own that both are on the line.

    Parameters
    ----------
    hello, first
        The latest identification, and that of the device that the stream began with.
    since_s
        Since the latter's last one [s].
    """
    if since_s < _BOTH_S and hello.unit_name != first.unit_name:
        raise WrongDeviceError(
            f"two units answer on one line, {first.unit_name!r} and {hello.unit_name!r} (or were exchanged just "
            "now): which scan is whose cannot be told; take one of them off the line and start again"
        )


def sensor_of(hello: Hello, sensor: AnySensor | None) -> AnySensor:
    """Return the sensor of a device, with its A/D bits: this spec, or a matching shipped one; else `PortError`."""
    if sensor is None:
        wanted = hello.construction, hello.strips
        for name in spec_names():
            shipped = Sensor.load(name)
            if isinstance(shipped, Sensor) and (shipped.construction, shipped.strips) == wanted:
                sensor = replace(shipped, adc_bits=None)
                break
        else:
            raise PortError(
                f"the device is a {hello.construction} sensor of {hello.strips} strips, and no shipped spec has that: "
                "write one with `tacstrip init sensor.toml` and name it with --sensor"
            )
    check_device(hello, unit_of(sensor))
    try:
        if isinstance(sensor, LayeredSensor):
            return sensor.changed(adc_bits=hello.adc_bits)
        return replace(sensor, adc_bits=hello.adc_bits)
    except SpecError as error:
        raise PortError(f"the device and the spec do not go together: {error}") from None
