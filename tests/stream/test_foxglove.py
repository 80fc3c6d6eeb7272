"""Foxglove and Lichtblick: what their viewers get, by a client of our own that decodes as they do."""

from __future__ import annotations

import asyncio
import json
import math
import sys
from collections import defaultdict
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import aiohttp
import numpy as np
import pytest
from click.testing import CliRunner

import tacstrip as ts
from foxglove_viewer import SUBPROTOCOL, Viewer
from live_devices import SENSOR
from tacstrip.cli.live import command
from tacstrip.stream.bridges.foxglove.bridge import _as_json
from tacstrip.stream.bridges.foxglove.server import PROTOCOLS, Channel, FoxgloveServer
from tacstrip.stream.live.pipeline import Live
from tacstrip.stream.live.sinks import foxglove_sink
from waiting import HANG_S, wait_until

pytest.importorskip("foxglove", reason="needs foxglove-sdk, of the group dev", exc_type=ImportError)

ORIGIN_NS = 1_700_000_000_123_456_789
SCANS = 40
NONSENSE = (
    "{", "[]", '{"op": "subscribe"}', '{"op": "fly"}',
    '{"op": "subscribe", "subscriptions": [{"id": -1, "channelId": 1}]}',
    '{"op": "subscribe", "subscriptions": [{"id": 1, "channelId": 99}]}',
)  # fmt: skip
TWO = ts.Contact.polygon([(12, 20), (38, 25), (30, 60)]) + ts.Contact.polygon([(60, 40), (90, 50), (72, 85)])


def _talk(port: int, work: Callable[[Viewer], Awaitable[Any]]) -> Any:
    async def run() -> Any:
        async with aiohttp.ClientSession() as session:
            url = f"ws://127.0.0.1:{port}"
            async with session.ws_connect(url, protocols=[SUBPROTOCOL], max_msg_size=0) as socket:
                return await work(Viewer(socket))

    return asyncio.run(run())


def test_a_viewer_gets_every_scan_as_it_was_at_the_time_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tacstrip.stream.bridges.foxglove.server._LAST_S", HANG_S)  # it is slow, and it reads
    source = ts.SimulatedSource(
        SENSOR, lambda time_s: TWO, 200.0, SCANS, ts.Noise(positional=0.001), origin_ns=ORIGIN_NS
    )
    told: list[str] = []
    stream = Live(source, speed=math.inf, on_message=told.append)
    box = stream.subscribe(SCANS)
    sink, port = foxglove_sink(stream, "127.0.0.1", 0)

    async def watch(viewer: Viewer) -> dict[str, list[tuple[int, Any]]]:
        await viewer.subscribe()
        got: dict[str, list[tuple[int, Any]]] = defaultdict(list)
        (
            topic,
            time_ns,
            health,
        ) = await viewer.message()  # every quarter of a second, also before the first scan
        assert topic == "/tacstrip/health"
        assert health["frames"] == 0
        stream.notify("a message for the user")
        stream.start()
        scans = [got[f"/tacstrip/{name}"] for name in ("signatures", "shapes", "objects")]
        log = got["/tacstrip/log"]
        while min(map(len, scans)) < SCANS or "a message for the user" not in [m["message"] for _, m in log]:
            topic, time_ns, content = await viewer.message()
            got[topic].append((time_ns, content))
        assert viewer.info["name"] == "tacstrip"
        names = {
            c["topic"]: (c["encoding"], c["schemaName"], c["schemaEncoding"])
            for c in viewer.channels.values()
        }
        assert names["/tacstrip/objects"] == ("protobuf", "foxglove.SceneUpdate", "protobuf")
        assert names["/tacstrip/log"] == ("protobuf", "foxglove.Log", "protobuf")
        assert names["/tacstrip/signatures"][::2] == ("json", "jsonschema")
        return got

    try:
        got = _talk(port, watch)
    finally:
        stream.stop()
        sink.close()
    assert (told, sink.error) == (["a message for the user"], None)
    frames = box.get_all()
    assert [frame.number for frame in frames] == list(range(SCANS))
    for frame, (time_ns, signatures), (_, shapes), (objects_ns, scene) in zip(
        frames, *(got[f"/tacstrip/{name}"] for name in ("signatures", "shapes", "objects")), strict=True
    ):
        assert time_ns == objects_ns == frame.time_ns == ORIGIN_NS + round(5_000_000 * frame.number)
        assert signatures["timestamp"] == dict(zip(("sec", "nsec"), divmod(time_ns, 10**9), strict=True))
        for name in ("kh", "kl"):
            values = np.array(signatures[name], dtype=float)
            np.testing.assert_allclose(values, frame.scan[name], atol=1e-5)
        assert signatures["x_mm"] == SENSOR.x_mm.tolist()
        assert [one["id"] for one in shapes["objects"]] == [one.id for one in frame.objects] == [1, 2]
        assert ("tracks" in shapes, shapes["searching"]) == (frame.tracks is not None, frame.searching)
        assert shapes["objects"][0]["area_mm2"] == pytest.approx(frame.objects[0].shape.area)
        (entity,) = scene["entities"]
        stamp = entity["timestamp"]
        assert (entity["frame_id"], entity["id"]) == ("tacstrip", "objects")
        assert stamp["seconds"] * 10**9 + stamp["nanos"] == time_ns
        for line, text, one in zip(entity["lines"], entity["texts"], frame.objects, strict=True):
            assert (line["type"], text["text"].partition(",")[0]) == (1, str(one.id))  # a line loop
            corners = [(p["x"], p["y"]) for p in line["points"]]
            np.testing.assert_allclose(corners, 1e-3 * one.shape.vertices, atol=1e-9)
    ((_, sensor),) = got["/tacstrip/sensor"]
    border = [(p["x"], p["y"]) for p in sensor["entities"][0]["lines"][0]["points"]]
    assert border == [(0.0, 0.0), (0.1, 0.0), (0.1, 0.1), (0.0, 0.1)]
    region = got["/tacstrip/regions"][-1][1]["entities"][0]["lines"]
    assert len(region) == sum(len(one.shape.vertices) for one in frames[-1].objects)
    log = [(m["level"], m["message"]) for _, m in got["/tacstrip/log"]]
    assert (3, "a message for the user") in log
    assert any(text.startswith("object 1: ") for _, text in log), log


def _dull(max_waiting: int, told: list[str]) -> tuple[FoxgloveServer, Channel]:
    channel = Channel.of_json("/a", "A", {})
    return FoxgloveServer([channel], "127.0.0.1", 0, told.append, max_waiting=max_waiting), channel


def test_a_viewer_that_does_not_read_costs_nothing_and_gets_the_newest() -> None:
    told: list[str] = []
    sent, payload = 1500, b"[" + 20_000 * b" " + b"%d]"  # more than any buffer of the system
    server, channel = _dull(10, told)

    async def stall(viewer: Viewer) -> list[int]:
        await viewer.subscribe()
        await asyncio.to_thread(wait_until, lambda: server.wanted(channel))
        for i in range(sent):
            server.publish(i, (channel, payload % i))
        await asyncio.to_thread(wait_until, lambda: server.dropped and told)
        numbers: list[int] = []
        while not numbers or numbers[-1] != sent - 1:
            _, time_ns, (number,) = await viewer.message()
            assert time_ns == number
            numbers.append(number)
        server.publish(sent, (channel, payload % sent))
        while not viewer.status:
            server.publish(sent, (channel, payload % sent))
            await viewer.message()
        missed = int(viewer.status[0]["message"].split()[-2])
        assert 0 < missed <= sent - len(numbers)
        return numbers

    numbers = _talk(server.port, stall)
    assert numbers == sorted(set(numbers))
    assert server.dropped == sent - len(numbers) > 0
    wait_until(lambda: len(told) == 2)
    assert told == [
        "Foxglove: a viewer reads too slowly and misses messages",
        f"Foxglove: a viewer that left had missed {server.dropped} messages",
    ]
    server.close()


def test_the_end_does_not_wait_for_a_viewer_that_does_not_read() -> None:
    server, channel = _dull(10, [])

    async def stall(viewer: Viewer) -> None:
        await viewer.subscribe()
        await asyncio.to_thread(wait_until, lambda: server.wanted(channel))
        for i in range(1500):
            server.publish(i, (channel, 20_000 * b" "))
        await asyncio.to_thread(server.close)

    _talk(server.port, stall)


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_who_may_connect_and_what_is_asked_that_is_no_request(protocol: str) -> None:
    server, channel = _dull(10, [])
    url = f"ws://127.0.0.1:{server.port}"

    async def ask() -> None:
        async with aiohttp.ClientSession(timeout=aiohttp.ClientTimeout(HANG_S)) as session:
            for origin in ("https://evil.example", "http://foxglove.dev.evil.example", "http://["):
                with pytest.raises(aiohttp.WSServerHandshakeError, match="403"):
                    await session.ws_connect(url, protocols=[protocol], headers={"Origin": origin})
            async with session.get(f"http://127.0.0.1:{server.port}") as answer:
                assert answer.status == 400
                assert "Lichtblick" in await answer.text()
                assert answer.headers["X-Content-Type-Options"] == "nosniff"
            for origin in ("https://app.foxglove.dev", "http://localhost:8080", "file://", ""):
                async with session.ws_connect(
                    url, protocols=[protocol], headers={"Origin": origin}
                ) as socket:
                    assert socket.protocol == protocol
                    for nonsense in NONSENSE:
                        await socket.send_str(nonsense)
                    viewer = Viewer(socket)
                    await viewer.subscribe("/a")
                    await asyncio.to_thread(wait_until, lambda: server.wanted(channel))
                    await socket.send_json({"op": "unsubscribe", "subscriptionIds": [1001]})
                    await asyncio.to_thread(wait_until, lambda: not server.wanted(channel))

    asyncio.run(ask())
    server.close()


def test_the_verb_serves_viewers_and_writes_a_layout_of_topics_that_exist(tmp_path: Path) -> None:
    readings, spec, layout = tmp_path / "r.csv", tmp_path / "s.toml", tmp_path / "layout.json"
    SENSOR.save(spec)
    ts.write_readings(readings, SENSOR, [ts.simulate(SENSOR, TWO)])
    given = [str(spec), str(readings), "--speed", "inf", "--no-view"]
    done = CliRunner().invoke(command, [*given, "--foxglove", "0", "--foxglove-layout", str(layout)])
    assert done.exit_code == 0, done.output
    assert "open a connection to ws://127.0.0.1:" in done.output
    panels = json.loads(layout.read_text(encoding="utf-8"))["configById"]
    topics = {"sensor", "objects", "regions", "tracks", "signatures", "shapes", "health", "log"}
    paths = [path["value"] for panel in panels.values() for path in panel.get("paths", ())]
    named = {
        *panels["3D!sensor"]["topics"],
        panels["RosOut!log"]["topicToRender"],
        *(p.split(".")[0] for p in paths),
    }
    assert named == {f"/tacstrip/{name}" for name in topics}
    for wrong, words in (
        (["--foxglove", "99999"], "--foxglove 99999: must be 0 to 65535"),
        (["--foxglove", "session.mcap"], "'session.mcap' is not a number"),
        (["--foxglove-host", "0.0.0.0"], "give that as well"),
        (["--foxglove", "0", "--foxglove-layout", str(layout)], "exists already"),
        (["--foxglove", "0", "--foxglove-host", "no.such.host"], "choose another --foxglove-host"),
    ):
        done = CliRunner().invoke(command, [*given, *wrong])
        assert (done.exit_code, words in (done.output + str(done.exception))) in {(1, True), (2, True)}, (
            done.output
        )


def test_without_the_sdk_the_command_to_install_it_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "foxglove", None)
    stream = Live(ts.SimulatedSource(SENSOR, lambda time_s: TWO, scans=1))
    with pytest.raises(ts.OptionError, match=r"pip install 'tacstrip\[foxglove\]'"):
        foxglove_sink(stream, "127.0.0.1", 0)
    stream.stop()


def test_readings_beyond_the_scale_are_written_as_they_are_and_only_untouched_as_null() -> None:
    values = [-0.20001, -0.2, -0.20002, 0.5, 1.2, 1.20001, math.nan]
    for some in ([v] for v in values):
        assert json.loads(f"[{_as_json(np.array(some))}]") == [None if math.isnan(v) else v for v in some]
