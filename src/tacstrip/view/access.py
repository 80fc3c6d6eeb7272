"""Access to the page: this computer may view and control it, others need a token."""

from __future__ import annotations

import errno
import hmac
import ipaddress
import secrets
from contextlib import suppress
from dataclasses import dataclass, field
from urllib.parse import urlsplit

from tacstrip.errors import OptionError

LOCAL = ("127.0.0.1", "localhost", "::1")


def check_port(port: int, what: str = "port") -> None:
    """Raise `OptionError` where a port is not 0 to 65535; `what` names it in the message."""
    if not 0 <= port <= 65535:
        raise OptionError(f"{what} {port}: must be 0 to 65535; 0: any free one")


def listen_error(error: OSError | UnicodeError, host: str) -> str:
    """Return why a server cannot listen on a host, and what to do."""
    match getattr(error, "errno", None):
        case errno.EADDRINUSE:
            return (
                "the port is in use, perhaps by another `tacstrip live`; choose another --http, or --http 0"
            )
        case errno.EACCES:
            return "only an administrator may listen there; choose another --http, above 1023"
        case _:
            return f"{host!r} is no address of this computer; choose another --host, or leave it out"


@dataclass(frozen=True)
class Access:
    """The access rules of a server.

    Attributes
    ----------
    host
        The address that it listens on; tokens are needed unless it is local to this computer.
    look, control
        The tokens: to view, and to control as well.
    """

    host: str
    look: str = field(default_factory=lambda: secrets.token_urlsafe(12))
    control: str = field(default_factory=lambda: secrets.token_urlsafe(12))

    @property
    def local(self) -> bool:
        """Whether only this computer can reach the server."""
        with suppress(ValueError):  # a name
            return ipaddress.ip_address(self.host).is_loopback
        return self.host == "localhost"

    def refused(self, host: str | None, origin: str | None) -> str:
        """Return why a request is refused, by its headers Host and Origin; empty where it is accepted.

        A page of another site can send requests here with its own Origin; a foreign name that resolves to this address
        (DNS rebinding) arrives as Host.
        """
        name = urlsplit(f"//{host or ''}").hostname or ""
        if self.local and name not in LOCAL and name != self.host:
            return f"this server answers to {', '.join(LOCAL)}, not to {name or 'a request without Host'}"
        if origin is not None and urlsplit(origin).netloc != host:
            return f"a page of {origin} may not use this server"
        return ""

    def may(self, token: str | None) -> tuple[bool, bool]:
        """Return whether the holder of a token may view, and whether they may control."""
        if self.local:
            return True, True
        given = (token or "").encode()
        control = hmac.compare_digest(given, self.control.encode())
        return control or hmac.compare_digest(given, self.look.encode()), control
