"""The line to a device, such as a serial port."""

from __future__ import annotations

from typing import Any, Protocol

from tacstrip.errors import PortError

BAUD = 500_000


class Port(Protocol):
    """Bytes to and from a device. Reading and writing raise `OSError` once it is gone."""

    def read(self, wait_s: float) -> bytes:
        """Return the bytes that have come, after waiting for the first for at most `wait_s` [s]."""

    def write(self, data: bytes) -> None:
        """Send bytes."""

    def close(self) -> None:
        """Close it; may be called twice."""


class SerialPort:
    """A serial port, opened exclusively.

    Raises
    ------
    PortError
        The port does not exist, is in use, or may not be opened; the message says what to do.
    """

    def __init__(self, path: str, baud: int = BAUD) -> None:
        import serial

        try:
            self._serial: Any = serial.Serial(path, baud, timeout=0.0, write_timeout=1.0, exclusive=True)
        except (OSError, ValueError) as error:
            raise PortError(_open_error(path, baud, error)) from None

    def read(self, wait_s: float) -> bytes:
        """Return the bytes that have come."""
        # Setting it configures the port anew, which one that is gone refuses.
        if self._serial.timeout != wait_s:
            self._serial.timeout = wait_s
        data: bytes = self._serial.read(1)
        return data + self._serial.read(self._serial.in_waiting) if data else data

    def write(self, data: bytes) -> None:
        """Send bytes."""
        self._serial.write(data)

    def close(self) -> None:
        """Close the port."""
        self._serial.close()


def ports() -> list[str]:
    """Return the names of the serial ports of this computer."""
    from serial.tools.list_ports import comports

    return sorted(port.device for port in comports())


def _open_error(path: str, baud: int, error: Exception) -> str:
    text = str(error)
    if "Permission" in text or "Access is denied" in text:
        return f"{path}: you may not open it. On Linux add yourself to the group dialout and log in again"
    if "exclusively lock" in text or "busy" in text:
        return f"{path}: another program has it open; close that one"
    if "No such file" in text or "FileNotFoundError" in text or "could not find" in text:
        return f"{path}: no such port. There are: {', '.join(ports()) or 'none; is the cable in?'}"
    return f"{path}: cannot be opened at {baud} baud ({text})"
