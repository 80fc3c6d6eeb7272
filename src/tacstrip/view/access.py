"""Where the page may be served, who may look, and who may also touch: this computer both, others by their token."""

from __future__ import annotations

import errno
import hmac
import ipaddress
import secrets
from dataclasses import dataclass, field
from urllib.parse import urlsplit

from tacstrip.errors import OptionError

LOCAL = ("127.0.0.1", "localhost", "::1")


def is_local(host: str) -> bool:
    """Whether a server on this address is reached from this computer alone."""
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def check_port(port: int, what: str = "port") -> None:
    """Refuse a port that is not 0 to 65535: `OptionError` calls it `what`."""
    if not 0 <= port <= 65535:
        raise OptionError(f"{what} {port}: must be 0 to 65535; 0 takes any that is free")


def why_not_there(error: OSError | UnicodeError, host: str) -> str:
    """Say why a server cannot listen on a host, and what to do."""
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
    """The rules of one server.

    Attributes
    ----------
    host
        The address that it listens on. On one of this computer alone nobody needs a token; on others everybody does.
    look, control
        The tokens: to look, and to change things too.
    """

    host: str
    look: str = field(default_factory=lambda: secrets.token_urlsafe(12))
    control: str = field(default_factory=lambda: secrets.token_urlsafe(12))

    @property
    def local(self) -> bool:
        """Whether only this computer reaches the server."""
        return is_local(self.host)

    def refused(self, host: str | None, origin: str | None) -> str:
        """Return why a request is refused, by its Host and Origin; empty where it is not.

        A page of another site can send requests here, with its own Origin; a name that its owner makes point here
        comes with that name as Host.
        """
        name = urlsplit(f"//{host or ''}").hostname or ""
        if self.local and name not in LOCAL and name != self.host:
            return f"this server answers to {', '.join(LOCAL)}, not to {name or 'a request without Host'}"
        if origin is not None and urlsplit(origin).netloc != host:
            return f"a page of {origin} may not use this server"
        return ""

    def may(self, token: str | None) -> tuple[bool, bool]:
        """Return whether a bearer of this token may look, and whether they may control."""
        if self.local:
            return True, True
        given = (token or "").encode()
        control = hmac.compare_digest(given, self.control.encode())
        return control or hmac.compare_digest(given, self.look.encode()), control
