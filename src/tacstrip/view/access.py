"""Access to the page: this computer may view and control it, others need a token."""

from __future__ import annotations

import hmac
import secrets
from dataclasses import dataclass, field
from urllib.parse import urlsplit

from tacstrip.stream.http_server import is_loopback

LOCAL = ("127.0.0.1", "localhost", "::1")


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
        return is_loopback(self.host)

    def refused(self, host: str | None, origin: str | None) -> str:
        """Return why a request is refused, by its headers Host and Origin; empty where it is accepted.

        A page of another site can send requests here with its own Origin; a foreign name that resolves to this address
        (DNS rebinding) arrives as Host.
        """
        try:
            name = urlsplit(f"//{host or ''}").hostname or ""
            same_page = origin is None or urlsplit(origin).netloc == host
        except ValueError:
            return "the header Host or Origin is malformed"
        if self.local and name not in LOCAL and name != self.host:
            return f"this server answers to {', '.join(LOCAL)}, not to {name or 'a request without Host'}"
        return "" if same_page else f"a page of {origin} may not use this server"

    def may(self, token: str | None) -> tuple[bool, bool]:
        """Return whether the holder of a token may view, and whether they may control."""
        if self.local:
            return True, True
        given = (token or "").encode(errors="surrogatepass")
        control = hmac.compare_digest(given, self.control.encode())
        return control or hmac.compare_digest(given, self.look.encode()), control
