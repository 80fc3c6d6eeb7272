"""The live page's server: aiohttp in a thread of its own."""

from __future__ import annotations

import asyncio
import json
import socket
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from aiohttp import WSMsgType, web

from tacstrip.errors import OptionError, TacstripError
from tacstrip.view.access import Access, check_port, listen_error
from tacstrip.view.controller import Controller

PAGE = Path(__file__).parent / "page"
_FILES = {".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_SAFE = {
    "Content-Security-Policy": _POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}
_DRAW_S = 0.012  # slightly less than the period of a screen
_STATE_S = 0.25
_MAX_UNDRAWN = 2  # frames that were sent to a page and are not drawn yet
_MAX_MESSAGE_BYTES = 2**16  # from a page


class Server:
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
        check_port(port)
        self.controller, self.access, self.port = controller, access, port
        self._loop = asyncio.new_event_loop()
        self.pages: set[_Page] = set()
        self._ready = threading.Event()
        self._failed: OSError | UnicodeError | None = None
        self._end: asyncio.Event | None = None
        self._thread = threading.Thread(target=self._run, name="tacstrip view", daemon=True)
        self._thread.start()
        self._ready.wait()
        if self._failed is not None:
            reason = listen_error(self._failed, access.host)
            raise OptionError(f"the page cannot be served on {access.host}:{port}: {reason}")

    @property
    def urls(self) -> dict[str, str]:
        """The page's addresses by what they permit."""
        host = socket.gethostname() if self.access.host in ("0.0.0.0", "::") else self.access.host
        base = f"http://{host}:{self.port}/"
        if self.access.local:
            return {"control": base}
        return {"control": f"{base}?token={self.access.control}", "look": f"{base}?token={self.access.look}"}

    def close(self) -> None:
        """End the server; may be called twice."""
        if self._end is not None and self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._end.set)
            self._thread.join()

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._serve())
        finally:
            self._ready.set()
            self._loop.close()

    async def _serve(self) -> None:
        self._end = asyncio.Event()
        app = web.Application(middlewares=[self._guard])
        app.router.add_get("/", self._file)
        app.router.add_get("/ws", self._connect)
        app.router.add_get("/{name}", self._file)
        runner = web.AppRunner(app, access_log=None)
        await runner.setup()
        try:
            site = web.TCPSite(runner, self.access.host, self.port)
            await site.start()
            self.port = runner.addresses[0][1]
            self._ready.set()
            drawing = asyncio.ensure_future(self._draw())
            await self._end.wait()
            drawing.cancel()
            for page in list(self.pages):
                await page.socket.close()
        except (OSError, UnicodeError) as error:  # UnicodeError: an impossible host name
            self._failed = error
        finally:
            await runner.cleanup()

    @web.middleware
    async def _guard(self, request: web.Request, handler: Callable[[web.Request], Any]) -> web.StreamResponse:
        if reason := self.access.refused(request.headers.get("Host"), request.headers.get("Origin")):
            return web.Response(status=403, text=reason, headers=_SAFE)
        answer: web.StreamResponse = await handler(request)
        return answer

    async def _file(self, request: web.Request) -> web.StreamResponse:
        path = PAGE / (request.match_info.get("name") or "index.html")
        kind = _FILES.get(path.suffix)
        if kind is None or path.parent != PAGE or not path.is_file():
            return web.Response(status=404, text="no such file", headers=_SAFE)
        if path.suffix == ".html" and not self.access.may(request.query.get("token"))[0]:
            reason = "the address needs the token that `tacstrip live` printed: ...?token=..."
            return web.Response(status=403, text=reason, headers=_SAFE)
        return web.Response(body=path.read_bytes(), content_type=kind, charset="utf-8", headers=_SAFE)

    async def _connect(self, request: web.Request) -> web.StreamResponse:
        look, control = self.access.may(request.query.get("token"))
        if not look:
            return web.Response(status=403, text="the address needs a token", headers=_SAFE)
        socket = web.WebSocketResponse(max_msg_size=_MAX_MESSAGE_BYTES, heartbeat=20.0)
        await socket.prepare(request)
        page = _Page(socket, control)
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
            answer = {"kind": "refused", "text": refused}
        if answer:
            await page.send(json.dumps(answer))

    async def _draw(self) -> None:
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

    def __init__(self, socket: web.WebSocketResponse, control: bool) -> None:
        self.socket, self.control = socket, control
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
