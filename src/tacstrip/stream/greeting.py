"""The first words with a device: who it is, and whether that is what was asked for."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

from tacstrip.data import spec_names
from tacstrip.errors import PortError, SpecError
from tacstrip.sensor.spec import Sensor
from tacstrip.stream.port import Port
from tacstrip.stream.wire import Decoder
from tacstrip.stream.wire_commands import Command
from tacstrip.stream.wire_frames import Kind
from tacstrip.stream.wire_messages import Hello

_ASK_S = 0.5  # between two questions who it is
_READ_S = 0.1


class OtherDeviceError(PortError):
    """What is plugged in is not what the stream is of."""


def greet(port: Port, decoder: Decoder, wait_s: float, given_up: Callable[[], bool]) -> Hello:
    """Ask a device who it is until it answers.

    Parameters
    ----------
    port, decoder
        The line, and what has read it so far.
    wait_s
        How long to ask [s].
    given_up
        Whether somebody no longer wants to know.

    Raises
    ------
    PortError
        Nothing answers that speaks the protocol; the message says what came instead.
    OSError
        The device is gone.
    """
    heard, asked_s, start_s = 0, -_ASK_S, time.monotonic()
    while (now_s := time.monotonic() - start_s) < wait_s and not given_up():
        if now_s - asked_s >= _ASK_S:
            asked_s = now_s
            port.write(Command(Kind.IDENTIFY).encode())
        data = port.read(_READ_S)
        heard += len(data)
        for message in decoder.feed(data):
            if isinstance(message, Hello):
                return message
    counts = decoder.counts
    if not heard:
        why = "nothing came: is the firmware on it, and is this its port?"
    elif counts.unknown:
        why = "its frames are of another version of the protocol: flash the firmware of this tacstrip"
    elif counts.frames:
        why = "it sends, but does not say who it is: is its receiving line connected?"
    else:
        why = f"{heard} bytes came and no frame among them: another device, or another --baud"
    raise PortError(f"no tacstrip device answered within {wait_s:g} s; {why}")


def check_device(hello: Hello, sensor: Sensor) -> None:
    """Refuse a device that is not of this spec: `PortError` names both sides."""
    device = {"construction": hello.construction, "strips": hello.strips, "adc_bits": hello.adc_bits}
    for key, found in device.items():
        wanted = getattr(sensor, key)
        if wanted is not None and wanted != found:
            raise OtherDeviceError(
                f"the device has {key} = {found} and the spec {wanted}: name the right spec with --sensor, or flash "
                "the firmware for it"
            )
    if unknown := [name for name in hello.signatures if name not in sensor.signatures]:
        raise OtherDeviceError(
            f"the device measures {unknown[0]}, which a {sensor.construction} sensor does not have"
        )


def check_unit(hello: Hello, first: Hello) -> None:
    """Refuse a device that is not the one that the stream began with: `OtherDeviceError` names both."""
    for key in ("unit_name", "construction", "strips", "signatures", "adc_bits"):
        now, before = getattr(hello, key), getattr(first, key)
        if now != before:
            raise OtherDeviceError(
                f"another device is on the port: it has {key} = {now!r}, and the stream began with {before!r}, whose "
                "spec and calibration are not its own; start again with those of the new one"
            )


def sensor_of(hello: Hello, sensor: Sensor | None) -> Sensor:
    """Return the sensor of a device, with its A/D bits: of this spec or a fitting shipped one; else `PortError`."""
    if sensor is None:
        for name in spec_names():
            shipped = Sensor.load(name)
            if (shipped.construction, shipped.strips) == (hello.construction, hello.strips):
                sensor = replace(shipped, adc_bits=None)
                break
        else:
            raise PortError(
                f"the device is a {hello.construction} sensor of {hello.strips} strips, and no shipped spec has that: "
                "write one with `tacstrip init sensor.toml` and name it with --sensor"
            )
    check_device(hello, sensor)
    try:
        return replace(sensor, adc_bits=hello.adc_bits)
    except SpecError as error:
        raise PortError(f"the device and the spec do not go together: {error}") from None
