"""A viewer as Foxglove is one: it subscribes, and decodes messages by the schemas that the server advertises."""

from __future__ import annotations

import base64
import json
import struct
from typing import Any

import aiohttp

from waiting import HANG_S

SUBPROTOCOL = "foxglove.sdk.v1"
_DOUBLE, _STRING, _MESSAGE = 1, 9, 11  # types of fields in a descriptor


class Viewer:
    """A client of the Foxglove WebSocket protocol on an open socket."""

    def __init__(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        self.socket = socket
        self.channels: dict[int, dict[str, Any]] = {}
        self.info: dict[str, Any] = {}
        self.status: list[dict[str, Any]] = []

    async def subscribe(self, *topics: str) -> None:
        """Take the greeting, and subscribe to topics; without any to all."""
        while not self.channels:
            await self._take(await self.socket.receive(HANG_S))
        wanted = [
            {"id": 1000 + i, "channelId": i}
            for i, c in self.channels.items()
            if c["topic"] in topics or not topics
        ]
        await self.socket.send_json({"op": "subscribe", "subscriptions": wanted})

    async def message(self) -> tuple[str, int, Any]:
        """Return the next message: its topic, its time [ns] and its content."""
        while True:
            if (found := await self._take(await self.socket.receive(HANG_S))) is not None:
                return found

    async def _take(self, message: aiohttp.WSMessage) -> tuple[str, int, Any] | None:
        if message.type == aiohttp.WSMsgType.BINARY:
            opcode, subscription, time_ns = struct.unpack_from("<BIQ", message.data)
            assert opcode == 1
            channel = self.channels[subscription - 1000]
            data = message.data[13:]
            if channel["encoding"] == "json":
                return channel["topic"], time_ns, json.loads(data)
            types = _types(base64.b64decode(channel["schema"]))
            return channel["topic"], time_ns, _decoded(data, channel["schemaName"], types)
        assert message.type == aiohttp.WSMsgType.TEXT, message
        told = json.loads(message.data)
        match told["op"]:
            case "serverInfo":
                self.info = told
            case "advertise":
                self.channels = {channel["id"]: channel for channel in told["channels"]}
            case "status":
                self.status.append(told)
        return None


def _fields(data: bytes) -> list[tuple[int, Any]]:
    """Return the fields of a protobuf message: numbers and values, which are whole numbers or bytes."""
    at = 0
    found: list[tuple[int, Any]] = []

    def varint() -> int:
        nonlocal at
        value, shift = 0, 0
        while True:
            byte = data[at]
            value, at, shift = value | (byte & 0x7F) << shift, at + 1, shift + 7
            if byte < 0x80:
                return value

    while at < len(data):
        key = varint()
        if key & 7 == 0:
            found.append((key >> 3, varint()))
            continue
        size = {1: 8, 5: 4}.get(key & 7) or varint()
        found.append((key >> 3, data[at : at + size]))
        at += size
    return found


def _types(descriptors: bytes) -> dict[str, dict[int, tuple[str, int, str, bool]]]:
    """Return name, type, type's name and whether it repeats, of each field by number, of each message by name."""
    types: dict[str, dict[int, tuple[str, int, str, bool]]] = {}
    for _, file in _fields(descriptors):
        inside = _fields(file)
        package = next(value.decode() for number, value in inside if number == 2)
        for message in (value for number, value in inside if number == 4):
            parts = _fields(message)
            fields = [dict(_fields(value)) for number, value in parts if number == 2]
            types[f"{package}.{dict(parts)[1].decode()}"] = {
                f[3]: (f[1].decode(), f[5], f.get(6, b"").decode().removeprefix("."), f[4] == 3)
                for f in fields
            }
    return types


def _decoded(
    data: bytes, name: str, types: dict[str, dict[int, tuple[str, int, str, bool]]]
) -> dict[str, Any]:
    defaults = {_DOUBLE: 0.0, _STRING: "", _MESSAGE: None}
    message: dict[str, Any] = {
        f: [] if many else defaults.get(kind, 0) for f, kind, _, many in types[name].values()
    }
    for number, value in _fields(data):
        field, kind, inner, many = types[name][number]
        if kind == _MESSAGE:
            value = _decoded(value, inner, types)
        elif kind == _DOUBLE:
            (value,) = struct.unpack("<d", value)
        elif kind == _STRING:
            value = value.decode()
        if many:
            message[field].append(value)
        else:
            message[field] = value
    return message
