"""What systemd asks of a service: to say when it is ready, how it is, that it lives, and that it ends."""

from __future__ import annotations

import os
import socket
import time
from contextlib import suppress

_STATUS_S = 2.0  # between two lines of status, least


class Service:
    """Tells the service manager of this process how it is; without one (no NOTIFY_SOCKET) it does nothing."""

    def __init__(self) -> None:
        address = os.environ.get("NOTIFY_SOCKET", "")
        # An address that begins with @ is one of Linux's abstract sockets, which have no file.
        self._address = "\0" + address[1:] if address.startswith("@") else address
        own = os.environ.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
        allowed_us = os.environ.get("WATCHDOG_USEC", "") if own else ""
        self._alive_s = 0.5e-6 * int(allowed_us) if allowed_us.isdecimal() else 0.0  # twice as often as asked
        self._alive_at_s = self._status_at_s = 0.0
        self._status = ""

    def ready(self) -> None:
        """Say that the service has started."""
        self._send("READY=1")

    def stopping(self) -> None:
        """Say that the service ends."""
        self._send("STOPPING=1")

    def alive(self, status: str, stuck_s: float = 0.0) -> None:
        """Say that the service lives, as often as it is asked for, and how it is, in one line, where that is new.

        `stuck_s`: how long the scan in hand has been worked on [s]; who does not get on with it does not live.
        """
        now_s = time.monotonic()
        said = []
        if stuck_s < self._alive_s and now_s - self._alive_at_s >= self._alive_s:
            self._alive_at_s = now_s
            said.append("WATCHDOG=1")
        if status != self._status and now_s - self._status_at_s >= _STATUS_S:
            self._status, self._status_at_s = status, now_s
            said.append(f"STATUS={status}")
        if said:
            self._send("\n".join(said))

    def _send(self, text: str) -> None:
        if not self._address:
            return
        with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as line:
            line.sendto(text.encode(), self._address)
