"""A virtual device on a pseudo-terminal, as a serial port for other programs; Linux and macOS."""

from __future__ import annotations

import os
import select
import threading
from contextlib import suppress
from typing import Self

from tacstrip.errors import PortError
from tacstrip.stream.device.virtual import VirtualDevice

_WAIT_S = 0.05
_BYTES = 4096


class PtyDevice:
    """Serves a virtual device on a pseudo-terminal until it is closed; use it in `with`.

    Parameters
    ----------
    device
        The device.

    Attributes
    ----------
    path
        Name of the port.

    Raises
    ------
    PortError
        This system has no pseudo-terminals.
    """

    def __init__(self, device: VirtualDevice) -> None:
        try:
            import tty
        except ImportError:
            raise PortError("virtual serial ports need Linux or macOS; use --simulate instead") from None
        self.device = device
        self._master, self._slave = os.openpty()  # the slave stays open here, so that a host may come and go
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.path = os.ttyname(self._slave)
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._run, name="tacstrip device", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Unplug it; may be called twice."""
        if self._closed.is_set():
            return
        self._closed.set()
        self._thread.join()
        for end in (self._master, self._slave):
            os.close(end)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _run(self) -> None:
        out = b""
        while not self._closed.is_set():
            wait = 0.0 if out else min(_WAIT_S, self.device.wait_s())
            readable, _, _ = select.select([self._master], [], [], wait)
            if readable:
                out += self.device.receive(os.read(self._master, _BYTES))
            out += self.device.send()
            if out:
                select.select([], [self._master], [], _WAIT_S)
                # Where the host does not read, this does not wait for it, as a device would not.
                with suppress(BlockingIOError):
                    out = out[os.write(self._master, out) :]
            if len(out) > 64 * _BYTES:
                out = b""
