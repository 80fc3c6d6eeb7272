"""A server of the Foxglove WebSocket protocol, subprotocols foxglove.sdk.v1 and foxglove.websocket.v1.

The SDK's own server (0.30) does not end while a viewer is connected that does not read, and does not tell what it
dropped for one; so the SDK encodes the messages, and this sends them.
"""

from __future__ import annotations

import asyncio
import base64
import json
import math
import struct
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from socket import SO_SNDBUF, SOL_SOCKET
from typing import Any
from urllib.parse import urlsplit

from aiohttp import WSMsgType, web

from tacstrip.stream.http_server import HttpServer, close_socket, is_loopback

PROTOCOLS = ("foxglove.sdk.v1", "foxglove.websocket.v1")  # the same, under its new and its old name
_DATA = 0x01  # opcode of a message
_MAX_WAITING = 8000  # messages for a viewer: two seconds of 1,000 scans/s
_BINARY = 0x82  # first byte of a whole binary frame (RFC 6455)
_BATCH = 64  # messages that are taken together to be sent
_GATHER_S = 0.004  # from one batch to the next: a wake-up and a system call for several scans
_BUFFER_BYTES, _POLL_S = 2**18, 0.005  # of more that the system has not taken, no more is sent until it has
_MAX_VIEWERS = 8
_MAX_REQUEST_BYTES = 2**20
_STALLED_S = 1.0  # without anything read
_TELL_S = 1.0  # between two messages to a viewer about what it has missed
_TICK_S = 0.25
_LAST_S = 0.5  # for viewers to take what waits when the server ends
_WARNING = 1  # level of a status message


@dataclass(frozen=True, eq=False)
class Channel:
    """A topic with messages of one type.

    Attributes
    ----------
    topic, encoding, schema_name, schema, schema_encoding
        As the protocol names them; a binary schema is in base64.
    kept
        The newest messages, which a new viewer gets at once.
    """

    topic: str
    encoding: str
    schema_name: str
    schema: str
    schema_encoding: str
    kept: deque[tuple[int, bytes]] = field(default_factory=lambda: deque(maxlen=0))

    @classmethod
    def of_json(cls, topic: str, name: str, properties: dict[str, Any]) -> Channel:
        """Return a channel of JSON objects with these properties, as of JSON Schema."""
        schema = {"title": name, "type": "object", "properties": properties}
        return cls(topic, "json", name, json.dumps(schema), "jsonschema")

    @classmethod
    def of_protobuf(cls, topic: str, schema: Any, keep: int = 0) -> Channel:
        """Return a channel of one of Foxglove's own messages, of which new viewers get the newest `keep`."""
        data = base64.b64encode(schema.data).decode()
        return cls(topic, "protobuf", schema.name, data, "protobuf", deque(maxlen=keep))


class FoxgloveServer(HttpServer):
    """Serves messages to viewers until it is closed; those that read slowly miss some.

    Parameters
    ----------
    channels
        What is served.
    host, port
        The address that it listens on; port 0: any free one.
    on_message
        Called with messages for the user.
    max_waiting
        Largest number of messages that wait for a viewer.

    Attributes
    ----------
    port
        The port in use.
    dropped
        Number of messages that viewers have missed.
    on_tick
        Called four times a second.
    """

    def __init__(
        self,
        channels: Sequence[Channel],
        host: str,
        port: int,
        on_message: Callable[[str], None],
        max_waiting: int = _MAX_WAITING,
    ) -> None:
        self._numbers = {channel: number for number, channel in enumerate(channels, 1)}
        self._channels = {number: channel for channel, number in self._numbers.items()}
        self._on_message = on_message
        self.on_tick: Callable[[], None] = lambda: None
        self._max_waiting = max_waiting
        self._session = str(time.time_ns())
        self._lock = threading.Lock()
        # Never changed, only replaced: other threads go through it.
        self._viewers: frozenset[_Viewer] = frozenset()
        self.dropped = 0
        super().__init__(host, port, "Foxglove", ("--foxglove PORT", "--foxglove-host"))

    @property
    def viewers(self) -> int:
        """Number of viewers."""
        return len(self._viewers)

    @property
    def waiting(self) -> int:
        """Number of messages that wait for viewers."""
        return sum(len(viewer.waiting) for viewer in self._viewers)

    def wanted(self, channel: Channel) -> bool:
        """Return whether a viewer that reads has subscribed to a channel."""
        number = self._numbers[channel]
        return any(number in viewer.subscriptions and not viewer.full for viewer in self._viewers)

    def takes(self, channel: Channel) -> bool:
        """Return whether a message is worth making, as `wanted`; those whose queue is full miss one that is not."""
        number = self._numbers[channel]
        full = 0
        for viewer in self._viewers:
            if number in viewer.subscriptions:
                if not viewer.full:
                    return True
                full += 1
                viewer.dropped += 1
        self.dropped += full
        return False

    def publish(self, time_ns: int, *messages: tuple[Channel, bytes]) -> None:
        """Send messages to the viewers that want them; never waits for a viewer."""
        idle = []
        with self._lock:
            for channel, payload in messages:
                number = self._numbers[channel]
                if channel.kept.maxlen:
                    channel.kept.append((time_ns, payload))
                for viewer in self._viewers:
                    if (subscription := viewer.subscriptions.get(number)) is not None:
                        self.dropped += viewer.put(_frame(subscription, time_ns, payload))
                        if viewer.idle:
                            viewer.idle = False
                            idle.append(viewer)
        for viewer in idle:
            with suppress(RuntimeError):  # the server has ended
                self._loop.call_soon_threadsafe(viewer.wake.set)

    def _add_routes(self, router: web.UrlDispatcher) -> None:
        router.add_get("/", self._connect)

    def _refused(self, request: web.Request) -> str:
        """Refuse what a web page that the user happens to visit asks for."""
        origin = request.headers.get("Origin", "")
        try:
            page = urlsplit(origin)
            name = page.hostname or ""
        except ValueError:
            return "the header Origin is malformed"
        if page.scheme not in ("http", "https") or not is_loopback(self._host):
            return ""  # a program, or a network that the user let in
        if is_loopback(name) or name == "foxglove.dev" or name.endswith(".foxglove.dev"):
            return ""
        reason = (
            f"a page of {origin!r} may not connect; pages of foxglove.dev and of this computer may, and others "
            "where --foxglove-host lets the network in"
        )
        self._on_message(f"Foxglove: {reason}")
        return reason

    async def _connect(self, request: web.Request) -> web.StreamResponse:
        asked = [name.strip() for name in request.headers.get("Sec-WebSocket-Protocol", "").split(",")]
        if not any(name in PROTOCOLS for name in asked):
            text = f"this is for viewers: Foxglove or Lichtblick, which speak {' or '.join(PROTOCOLS)}"
            return web.Response(status=400, text=text)
        if len(self._viewers) >= _MAX_VIEWERS:
            return web.Response(status=503, text=f"{_MAX_VIEWERS} viewers are connected already")
        # A viewer that neither reads nor answers for 30 s is gone. Compressing would cost more than sending.
        socket = web.WebSocketResponse(
            protocols=PROTOCOLS, max_msg_size=_MAX_REQUEST_BYTES, heartbeat=20.0, compress=False
        )
        await socket.prepare(request)
        if request.transport is not None and (below := request.transport.get_extra_info("socket")):
            # Else the system takes seconds of messages for a viewer that does not read, before that is noticed.
            below.setsockopt(SOL_SOCKET, SO_SNDBUF, _BUFFER_BYTES)
        viewer = _Viewer(socket, request.transport, self._max_waiting)
        with self._lock:
            self._viewers |= {viewer}
        sending = asyncio.ensure_future(self._send(viewer))
        try:
            hello = {"op": "serverInfo", "name": "tacstrip", "capabilities": [], "supportedEncodings": []}
            await socket.send_json({**hello, "metadata": {}, "sessionId": self._session})
            await socket.send_json({"op": "advertise", "channels": [*map(self._about, self._channels)]})
            async for message in socket:
                if message.type == WSMsgType.TEXT:
                    self._receive(viewer, message.data)
        except ConnectionResetError:
            pass  # the viewer was closed
        finally:
            sending.cancel()
            with self._lock:
                self._viewers -= {viewer}
            if viewer.dropped:
                self._on_message(f"Foxglove: a viewer that left had missed {viewer.dropped} messages")
        return socket

    def _about(self, number: int) -> dict[str, Any]:
        channel = self._channels[number]
        return {
            "id": number,
            "topic": channel.topic,
            "encoding": channel.encoding,
            "schemaName": channel.schema_name,
            "schema": channel.schema,
            "schemaEncoding": channel.schema_encoding,
        }

    def _receive(self, viewer: _Viewer, text: str) -> None:
        """Carry out a request of a viewer; what is none of the protocol's is left alone."""
        with suppress(ValueError, TypeError, KeyError, RecursionError, AttributeError):
            request = json.loads(text)
            if request["op"] == "subscribe":
                for one in request["subscriptions"]:
                    self._subscribe(viewer, int(one["id"]), int(one["channelId"]))
            elif request["op"] == "unsubscribe":
                gone = {int(number) for number in request["subscriptionIds"]}
                with self._lock:
                    viewer.subscriptions = {c: s for c, s in viewer.subscriptions.items() if s not in gone}

    def _subscribe(self, viewer: _Viewer, subscription: int, number: int) -> None:
        if number not in self._channels or not 0 <= subscription < 2**32:
            return
        with self._lock:
            viewer.subscriptions = {**viewer.subscriptions, number: subscription}
            for time_ns, payload in self._channels[number].kept:
                viewer.put(_frame(subscription, time_ns, payload))
            viewer.idle = False
        viewer.wake.set()

    async def _send(self, viewer: _Viewer) -> None:
        """Send what waits for a viewer; while it does not read, this waits, and the oldest is dropped."""
        told, told_s, transport = 0, 0.0, viewer.transport
        with suppress(ConnectionResetError):  # the viewer was closed
            while transport is not None and not transport.is_closing():
                await viewer.wake.wait()
                with self._lock:
                    batch = [viewer.waiting.popleft() for _ in range(min(_BATCH, len(viewer.waiting)))]
                    if not batch:
                        viewer.idle = True
                        viewer.wake.clear()
                if batch:
                    transport.write(b"".join(batch))
                    await asyncio.sleep(_GATHER_S if len(batch) < _BATCH else 0)
                viewer.blocked_s = self._loop.time()
                while transport.get_write_buffer_size() > _BUFFER_BYTES and not transport.is_closing():
                    await asyncio.sleep(_POLL_S)
                viewer.blocked_s = math.inf
                now_s = self._loop.time()
                if viewer.dropped != told and now_s - told_s > _TELL_S:
                    told, told_s = viewer.dropped, now_s
                    text = f"this viewer reads too slowly and has missed {told} messages"
                    status = {"op": "status", "level": _WARNING, "message": text, "id": "dropped"}
                    await viewer.socket.send_json(status)

    async def _work(self) -> None:
        while True:
            self.on_tick()
            for viewer in [v for v in self._viewers if v.dropped and not v.slow]:
                viewer.slow = True
                self._on_message("Foxglove: a viewer reads too slowly and misses messages")
            await asyncio.sleep(_TICK_S)

    async def _close_sockets(self) -> None:
        end_s = self._loop.time() + _LAST_S
        while self.waiting and self._loop.time() < end_s:
            await asyncio.sleep(_POLL_S)
        ends = [close_socket(viewer.socket, viewer.transport) for viewer in self._viewers]
        await asyncio.gather(*ends)


class _Viewer:
    """A connected viewer, what it has subscribed to, and what waits for it."""

    def __init__(
        self, socket: web.WebSocketResponse, transport: asyncio.Transport | None, max_waiting: int
    ) -> None:
        self.socket, self.transport, self._max_waiting = socket, transport, max_waiting
        self.subscriptions: dict[int, int] = {}  # its own number by the channel's
        self.waiting: deque[bytes] = deque()
        self.idle = True
        self.wake = asyncio.Event()
        self.dropped = 0
        self.blocked_s = math.inf  # since when the system takes no more for it
        self.slow = False  # which was told

    @property
    def full(self) -> bool:
        """Whether as many messages wait as may, or nothing was read for a while: more are not worth making."""
        return len(self.waiting) >= self._max_waiting or time.monotonic() - self.blocked_s > _STALLED_S

    def put(self, message: bytes) -> int:
        """Let a message wait; return how many older ones were dropped for it."""
        self.waiting.append(message)
        if len(self.waiting) <= self._max_waiting:
            return 0
        self.waiting.popleft()
        self.dropped += 1
        return 1


def _frame(subscription: int, time_ns: int, payload: bytes) -> bytes:
    """Return a message as a frame of a WebSocket: a system call for many costs less than one for each."""
    size = 13 + len(payload)
    if size < 126:
        head = struct.pack(">BB", _BINARY, size)
    elif size < 2**16:
        head = struct.pack(">BBH", _BINARY, 126, size)
    else:
        head = struct.pack(">BBQ", _BINARY, 127, size)
    return head + struct.pack("<BIQ", _DATA, subscription, time_ns) + payload
