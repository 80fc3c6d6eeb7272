"""A small HTTP server in a thread of its own: what the live page and the viewers' server have in common.

Every answer has the same headers, and connections that ask for nothing are closed: after ten seconds, or, where there
are many, at once and the oldest first.
"""

from __future__ import annotations

import asyncio
import errno
import ipaddress
import threading
from contextlib import suppress
from typing import Any

from aiohttp import web

from tacstrip.errors import OptionError, in_words
from tacstrip.stream.source import LOGGER

_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
SAFE = {
    "Content-Security-Policy": _POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}
_IDLE_S = 10.0  # without a whole request
_MAX_IDLE = 64  # connections
_CLOSE_S = 0.5  # for the other end to say goodbye


def check_port(port: int, what: str = "port") -> None:
    """Raise `OptionError` where a port is not 0 to 65535; `what` names it in the message."""
    if not 0 <= port <= 65535:
        raise OptionError(f"{what} {port}: must be 0 to 65535; 0: any free one")


def is_loopback(host: str) -> bool:
    """Return whether only this computer can reach a server that listens on a host."""
    with suppress(ValueError):  # a name
        return ipaddress.ip_address(host).is_loopback
    return host == "localhost"


async def close_socket(socket: web.WebSocketResponse, transport: asyncio.Transport | None) -> None:
    """Close a WebSocket; one whose other end does not read is cut off."""
    with suppress(Exception):  # whatever the other end does, this one ends
        await asyncio.wait_for(socket.close(), _CLOSE_S)
    if transport is not None:
        transport.abort()


class HttpServer:
    """Serves until it is closed; a subclass gives the routes.

    Parameters
    ----------
    host, port
        The address that it listens on; port 0: any free one.
    what
        What it serves, for messages.
    options
        The options of the command line that choose port and host, for messages.

    Attributes
    ----------
    port
        The port in use.

    Raises
    ------
    OptionError
        It cannot listen on this address; the message says why and what to do.
    """

    def __init__(self, host: str, port: int, what: str, options: tuple[str, str]) -> None:
        check_port(port)
        self._host, self._what = host, what
        self.port = port
        self._loop = asyncio.new_event_loop()
        self._idle: dict[asyncio.BaseProtocol, None] = {}  # connections without a request in progress
        self._ready = threading.Event()
        self._failed: OSError | UnicodeError | None = None
        self._end: asyncio.Event | None = None
        self._thread = threading.Thread(target=self._run, name=f"tacstrip {what}", daemon=True)
        self._thread.start()
        self._ready.wait()
        if self._failed is not None:
            reason = _listen_error(self._failed, host, *options)
            raise OptionError(f"{what} cannot be served on {host}:{port}: {reason}")

    def close(self) -> None:
        """End the server; may be called twice."""
        if self._end is not None and self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._end.set)
            self._thread.join()

    def _add_routes(self, router: web.UrlDispatcher) -> None:
        """Add what is served."""

    def _refused(self, request: web.Request) -> str:
        """Return why a request is refused; empty where it is accepted."""
        return ""

    async def _work(self) -> None:
        """Run beside the requests; cancelled at the end."""

    async def _close_sockets(self) -> None:
        """Close the connections that would stay open."""

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
        app.on_response_prepare.append(_make_safe)
        self._add_routes(app.router)
        runner = web.AppRunner(app, shutdown_timeout=_CLOSE_S)
        await runner.setup()
        server = None
        try:
            server = await self._loop.create_server(
                lambda: _Connection(runner.server, self._idle), self._host, self.port, reuse_address=True
            )
            self.port = server.sockets[0].getsockname()[1]
            self._ready.set()
            work = asyncio.ensure_future(self._work())
            work.add_done_callback(self._note_failure)
            await self._end.wait()
            work.cancel()
            await self._close_sockets()
        except (OSError, UnicodeError) as error:  # UnicodeError: an impossible host name
            self._failed = error
        finally:
            if server is not None:
                server.close()
            for connection in list(self._idle):
                connection.force_close()  # type: ignore[attr-defined]
            await runner.cleanup()

    def _note_failure(self, work: asyncio.Future[None]) -> None:
        if not work.cancelled() and (error := work.exception()) is not None:
            LOGGER.error("%s: its server works no more: %s", self._what, in_words(error))

    @web.middleware
    async def _guard(self, request: web.Request, handler: Any) -> web.StreamResponse:
        connection = request.protocol
        self._idle.pop(connection, None)
        try:
            if reason := self._refused(request):
                # A header may have had bytes that are no text.
                return web.Response(
                    status=403, body=reason.encode(errors="replace"), content_type="text/plain"
                )
            answer: web.StreamResponse = await handler(request)
            return answer
        except (web.HTTPException, ConnectionResetError):
            raise  # no such page; the other end is gone
        except Exception as error:
            LOGGER.error("%s: a request of %s failed: %s", self._what, request.remote, in_words(error))
            return web.Response(status=500, text="the request failed")
        finally:
            if request.transport is not None:  # it is open
                self._idle[connection] = None


class _Connection(web.RequestHandler):
    """A connection that is closed where no whole request comes on it, and answers nonsense in one line."""

    __slots__ = ("_waiting",)

    def __init__(self, manager: Any, waiting: dict[asyncio.BaseProtocol, None]) -> None:
        # keepalive_timeout counts from the beginning, too: headers that never end are closed with it.
        super().__init__(
            manager, loop=asyncio.get_running_loop(), access_log=None,  # type: ignore[arg-type]
            keepalive_timeout=_IDLE_S,
            lingering_time=1.0,
        )  # fmt: skip
        self._waiting = waiting

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        self._waiting[self] = None
        if len(self._waiting) > _MAX_IDLE:
            oldest: Any = next(iter(self._waiting))
            del self._waiting[oldest]
            oldest.force_close()

    def connection_lost(self, error: BaseException | None) -> None:
        self._waiting.pop(self, None)
        super().connection_lost(error)

    def handle_error(self, request: Any, status: int = 500, *_: Any, **__: Any) -> web.StreamResponse:
        """Answer what is no request; anybody can send that, and nobody needs to be told."""
        answer = web.Response(status=status, text="this is no request that can be answered", headers=SAFE)
        answer.force_close()
        return answer


async def _make_safe(_: web.Request, answer: web.StreamResponse) -> None:
    answer.headers.update(SAFE)


def _listen_error(error: OSError | UnicodeError, host: str, port_option: str, host_option: str) -> str:
    """Return why a server cannot listen on a host, and what to do."""
    match getattr(error, "errno", None):
        case errno.EADDRINUSE:
            return (
                f"the port is in use, perhaps by another `tacstrip live`; choose another {port_option}, or "
                f"{port_option} 0"
            )
        case errno.EACCES:
            return f"only an administrator may listen there; choose another {port_option}, above 1023"
        case _:
            return f"{host!r} is no address of this computer; choose another {host_option}, or leave it out"
