"""The live page's server: aiohttp in a thread of its own, and who has access to it.

This computer may view and control the page, others need a token.
"""

from __future__ import annotations

import asyncio
import hmac
import json
import secrets
import socket
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from aiohttp import WSMsgType, web

from tacstrip.errors import TacstripError
from tacstrip.stream.http_server import HttpServer, close_socket, is_loopback
from tacstrip.view.controller import Controller

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


PAGE = Path(__file__).parent / "page"
_FILES = {".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}
_DRAW_S = 0.012  # slightly less than the period of a screen
_STATE_S = 0.25
_MAX_UNDRAWN = 2  # frames that were sent to a page and are not drawn yet
_MAX_PAGES = 32
_MAX_MESSAGE_BYTES = 2**16  # from a page


class Server(HttpServer):
    """Serves the page until it is closed.

    Parameters
    ----------
    controller
        The controller that answers the page.
    access
        The address that it listens on, and who may do what.
    port
        Its port; 0: any free one.

    Attributes
    ----------
    port
        The port in use.
    pages
        The open pages.

    Raises
    ------
    OptionError
        It cannot listen on this address; the message says why and what to do.
    """

    def __init__(self, controller: Controller, access: Access, port: int = 0) -> None:
        self.controller, self.access = controller, access
        self.pages: set[_Page] = set()
        super().__init__(access.host, port, "the page", ("--http", "--host"))

    @property
    def urls(self) -> dict[str, str]:
        """The page's addresses by what they permit."""
        host = socket.gethostname() if self.access.host in ("0.0.0.0", "::") else self.access.host
        base = f"http://{host}:{self.port}/"
        if self.access.local:
            return {"control": base}
        return {"control": f"{base}?token={self.access.control}", "look": f"{base}?token={self.access.look}"}

    def _add_routes(self, router: web.UrlDispatcher) -> None:
        router.add_get("/", self._file)
        router.add_get("/ws", self._connect)
        router.add_get("/{name}", self._file)

    def _refused(self, request: web.Request) -> str:
        return self.access.refused(request.headers.get("Host"), request.headers.get("Origin"))

    async def _close_sockets(self) -> None:
        await asyncio.gather(*(close_socket(page.socket, page.transport) for page in self.pages))

    async def _file(self, request: web.Request) -> web.StreamResponse:
        path = PAGE / (request.match_info.get("name") or "index.html")
        kind = _FILES.get(path.suffix)
        if kind is None or path.parent != PAGE or not path.is_file():
            return web.Response(status=404, text="no such file")
        if path.suffix == ".html" and not self.access.may(request.query.get("token"))[0]:
            reason = "the address needs the token that `tacstrip live` printed: ...?token=..."
            return web.Response(status=403, text=reason)
        return web.Response(body=path.read_bytes(), content_type=kind, charset="utf-8")

    async def _connect(self, request: web.Request) -> web.StreamResponse:
        look, control = self.access.may(request.query.get("token"))
        if not look:
            return web.Response(status=403, text="the address needs a token")
        if len(self.pages) >= _MAX_PAGES:
            return web.Response(status=503, text=f"{_MAX_PAGES} pages are open already; close one")
        socket = web.WebSocketResponse(max_msg_size=_MAX_MESSAGE_BYTES, heartbeat=20.0)
        await socket.prepare(request)
        page = _Page(socket, request.transport, control)
        self.pages.add(page)
        try:
            await socket.send_str(json.dumps(self.controller.hello(control)))
            async for message in socket:
                if message.type == WSMsgType.TEXT:
                    await self._receive(page, message.data)
        except ConnectionResetError:
            pass  # the page was closed
        finally:
            self.pages.discard(page)
        return socket

    async def _receive(self, page: _Page, text: str) -> None:
        """Handle a page's message: `{"drawn": n}` after each picture, else a request."""
        try:
            request = json.loads(text)
            if not isinstance(request, dict):
                raise TypeError
        except (ValueError, TypeError, RecursionError):
            return
        if "drawn" in request:
            page.sent = max(0, page.sent - 1)
            return
        answer: dict[str, Any] | None = None
        refused = ""
        if not page.control:
            refused = "this address is for viewing only; use the other one to change things"
        else:
            try:
                answer = await asyncio.to_thread(self.controller.do, request)
            except TacstripError as error:
                refused = str(error)
            except (TypeError, ValueError, KeyError, AttributeError):
                refused = "the request is malformed"
        if refused:
            answer = {"kind": "refused", "text": refused, "field": request.get("field")}
        if answer:
            await page.send(json.dumps(answer))

    async def _work(self) -> None:
        """Send the newest frame to each page that has drawn the previous ones; slow pages get fewer."""
        state_s = 0.0
        while True:
            await asyncio.sleep(_DRAW_S)
            self.controller.watched(bool(self.pages))
            text = self.controller.picture()
            now_s = self._loop.time()
            state = json.dumps(self.controller.state()) if now_s - state_s >= _STATE_S else ""
            state_s = now_s if state else state_s
            for page in list(self.pages):
                page.offer(text, state)


class _Page:
    """An open page."""

    def __init__(
        self, socket: web.WebSocketResponse, transport: asyncio.Transport | None, control: bool
    ) -> None:
        self.socket, self.transport, self.control = socket, transport, control
        self.sent = 0  # frames that it has not drawn yet
        self._task: asyncio.Task[None] | None = None

    def offer(self, text: str, state: str) -> None:
        """Send a frame and the state, unless the page is still busy with earlier ones."""
        if self._task is not None and not self._task.done():
            return
        parts = [state] if state else []
        if text and self.sent < _MAX_UNDRAWN:
            self.sent += 1
            parts.append(text)
        if parts:
            self._task = asyncio.ensure_future(self._send_all(parts))

    async def send(self, text: str) -> None:
        """Send a text, unless the page was closed."""
        if not self.socket.closed:
            with suppress(ConnectionResetError):  # closed meanwhile
                await self.socket.send_str(text)

    async def _send_all(self, parts: list[str]) -> None:
        for part in parts:
            await self.send(part)
