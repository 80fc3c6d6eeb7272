"""The page's server: who may look and touch, what pages are told, and pages that are slow or go."""

from __future__ import annotations

import asyncio
import itertools
import json
import socket
from collections.abc import Awaitable, Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import aiohttp
import numpy as np
import pytest

import tacstrip as ts
from live_devices import SENSOR
from tacstrip.interrupt import worker_processes
from tacstrip.reconstruction.result import Alternative
from tacstrip.stream import RawScan
from tacstrip.stream.live.bounded_queue import BoundedQueue
from tacstrip.stream.live.pipeline import Live
from tacstrip.tracking import Tracker
from tacstrip.view.controller import Controller
from tacstrip.view.frame_json import frame_json
from tacstrip.view.server import PAGE, Access, Server
from tacstrip.view.simulator import Settings, Simulator, sensor_of
from waiting import HANG_S, wait_until


@pytest.fixture
def simulator(request: pytest.FixtureRequest) -> Simulator:
    return Simulator(Settings(SENSOR, getattr(request, "param", 500.0), ts.Noise(positional=0.002)))


@pytest.fixture
def live(simulator: Simulator) -> Iterator[Live]:
    stream = Live(simulator.source(), next_source=simulator.source, tracks=False)
    with stream:
        yield stream


@pytest.fixture
def controller(live: Live, simulator: Simulator, tmp_path: Path) -> Iterator[Controller]:
    # As `background_process`, but not of low priority: on a busy computer its turn may never come.
    with worker_processes(1, start_method="spawn") as executor:
        yield Controller(live, executor, simulator, tmp_path)


@pytest.fixture
def server(controller: Controller) -> Iterator[Server]:
    made = Server(controller, Access("127.0.0.1"))
    yield made
    made.close()


def _base(server: Server) -> str:
    return f"http://127.0.0.1:{server.port}"


def _talk(work: Callable[[aiohttp.ClientSession], Awaitable[Any]]) -> Any:
    async def run() -> Any:
        async with aiohttp.ClientSession(timeout=aiohttp.ClientTimeout(HANG_S)) as session:
            return await work(session)

    return asyncio.run(run())


async def _until(socket: aiohttp.ClientWebSocketResponse, kind: str, drawn: bool = True) -> dict[str, Any]:
    while True:
        message = await socket.receive_json(timeout=HANG_S)
        if message["kind"] == "frame" and drawn:
            await socket.send_json({"drawn": message["number"]})
        if message["kind"] == kind:
            found: dict[str, Any] = message
            return found


def _status(url: str, **headers: str) -> tuple[int, str]:
    async def ask(session: aiohttp.ClientSession) -> tuple[int, str]:
        async with session.get(url, headers=headers) as answer:
            return answer.status, await answer.text()

    found: tuple[int, str] = _talk(ask)
    return found


def test_the_page_and_its_files_come_from_here_alone(server: Server) -> None:
    for file in PAGE.iterdir():
        status, text = _status(f"{_base(server)}/{file.name}")
        assert (status, text) == (200, file.read_text(encoding="utf-8"))
        assert "http://" not in text.replace("http://www.w3.org", "")
        assert "https://" not in text
    assert _status(f"{_base(server)}/")[1].startswith("<!doctype html>")
    for missing in ("server.py", "..%2Fserver.py", "%2e%2e/server.py", "page"):
        assert _status(f"{_base(server)}/{missing}")[0] == 404


def test_another_origin_and_another_name_are_refused(server: Server) -> None:
    for path in ("/", "/ws", "/app.js"):
        status, text = _status(_base(server) + path, Origin="https://evil.example")
        assert (status, text) == (403, "a page of https://evil.example may not use this server")
        status, text = _status(_base(server) + path, Host="evil.example")
        assert status == 403
        assert "not to evil.example" in text
    assert _status(f"{_base(server)}/", Origin=_base(server))[0] == 200
    assert _status(f"{_base(server)}/", Host=f"localhost:{server.port}")[0] == 200


SAFE = ("Content-Security-Policy", "X-Content-Type-Options", "Referrer-Policy", "Cache-Control")
MALFORMED = [
    ("GET / HTTP/1.1\r\nHost: [", 403),
    ("GET / HTTP/1.1\r\nHost: \xff\xfe", 403),
    ("GET / HTTP/1.1", 400),
    ("GET / HTTP/1.1\r\n{host}\r\nOrigin: http://[", 403),
    ("GET / HTTP/1.1\r\n{host}\r\nX: " + 9000 * "x", 400),
    ("GET /%00 HTTP/1.1\r\n{host}", 404),
    ("GET /%ff%fe HTTP/1.1\r\n{host}", 404),
    ("GET http://[ HTTP/1.1\r\n{host}", 400),
    ("GET /a/b HTTP/1.1\r\n{host}", 404),
    ("POST / HTTP/1.1\r\n{host}\r\nContent-Length: 0", 405),
    ("GET /ws HTTP/1.1\r\n{host}", 400),
    ("nonsense", 400),
    ("\x16\x03\x01", 400),
]


def _raw(server: Server, text: str) -> tuple[int, dict[str, str]]:
    """Send bytes that a client of HTTP would not, and return status and headers of the answer."""
    with socket.create_connection(("127.0.0.1", server.port)) as line:
        line.settimeout(HANG_S)
        line.sendall((text.format(host=f"Host: 127.0.0.1:{server.port}") + "\r\n\r\n").encode("latin-1"))
        answer = b""
        while b"\r\n\r\n" not in answer:
            part = line.recv(65536)
            assert part, "closed without an answer"
            answer += part
    first, *lines = answer.partition(b"\r\n\r\n")[0].decode("latin-1").split("\r\n")
    return int(first.split()[1]), dict(part.split(": ", 1) for part in lines)


def test_what_is_no_request_gets_one_line_and_the_headers_of_all(
    server: Server, caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str]
) -> None:
    for text, status in MALFORMED:
        found, headers = _raw(server, text)
        assert (found, [name for name in SAFE if name not in headers]) == (status, []), text

    async def speak(session: aiohttp.ClientSession) -> None:
        async with session.ws_connect(f"{_base(server)}/ws") as line:
            await line.send_frame(b"\xff\xfe", aiohttp.WSMsgType.TEXT)  # no UTF-8
            while (message := await line.receive(HANG_S)).type == aiohttp.WSMsgType.TEXT:
                pass
            assert message.data == aiohttp.WSCloseCode.INVALID_TEXT

    _talk(speak)
    assert _status(f"{_base(server)}/")[0] == 200
    assert caplog.text == ""
    assert "Traceback" not in "".join(capfd.readouterr())


def test_many_connections_that_ask_for_nothing_shut_nobody_out(server: Server) -> None:
    idle = [socket.create_connection(("127.0.0.1", server.port)) for _ in range(200)]
    idle[-1].sendall(b"GET / HTTP/1.1\r\nHost: ")  # and ends there
    assert _status(f"{_base(server)}/")[0] == 200
    wait_until(lambda: len(server._idle) <= 64)
    idle[0].settimeout(HANG_S)
    assert idle[0].recv(100) == b""  # the oldest go
    for line in idle:
        line.close()


def test_on_the_network_a_token_is_needed_and_the_looking_one_changes_nothing(
    controller: Controller, simulator: Simulator
) -> None:
    server = Server(controller, Access("0.0.0.0"))
    access, base = server.access, _base(server)
    try:
        assert set(server.urls) == {"look", "control"}
        for wrong in ("", "?token=", "?token=x", f"?token={access.look}x"):
            assert _status(f"{base}/{wrong}")[0] == 403
            assert _status(f"{base}/ws{wrong}")[0] == 403

        async def look(session: aiohttp.ClientSession) -> None:
            for token, control in ((access.look, False), (access.control, True)):
                async with session.get(f"{base}/?token={token}") as answer:
                    assert answer.status == 200
                async with session.ws_connect(f"{base}/ws?token={token}") as socket:
                    assert (await socket.receive_json())["control"] is control
                    await socket.send_json({"do": "place", "objects": []})
                    if not control:
                        told = await _until(socket, "refused")
                        assert told["text"].startswith("this address is for viewing only")
                        assert len(simulator.objects) == 1
                    else:
                        await asyncio.to_thread(wait_until, lambda: not simulator.objects)

        _talk(look)
    finally:
        server.close()


def test_an_address_that_is_taken_is_named(server: Server, controller: Controller) -> None:
    with pytest.raises(
        ts.OptionError,
        match=rf"cannot be served on 127.0.0.1:{server.port}: the port is in use, .* choose another",
    ):
        Server(controller, Access("127.0.0.1"), server.port)


def test_a_page_is_told_the_frames_and_the_numbers(server: Server, simulator: Simulator) -> None:
    async def watch(session: aiohttp.ClientSession) -> None:
        async with session.ws_connect(f"{_base(server)}/ws") as socket:
            hello = await socket.receive_json()
            assert hello["sensor"]["strips"] == 20
            assert hello["control"] is True
            while True:
                frame = await _until(socket, "frame")
                if frame["objects"] and frame["objects"][0].get("regions"):
                    break
            (one,) = frame["objects"]
            assert len(frame["readings"]["kh"]) == 20
            assert frame["truth"] == [[list(p) for p in ring] for ring in simulator.objects]
            truth = np.array(frame["truth"][0])
            assert ts.mismatch(truth, np.array(one["vertices"])).iou > 0.95
            assert len(one["regions"]) == len(one["vertices"])
            state = await _until(socket, "state")
            assert state["running"] is True
            assert state["wire"]["lost"] == 0

    _talk(watch)


def _newest(box: BoundedQueue[ts.Frame]) -> int:
    frame = box.get(HANG_S)
    assert frame is not None
    return frame.number


def test_a_slow_page_gets_the_newest_and_a_page_that_goes_is_forgotten(server: Server, live: Live) -> None:
    async def watch(session: aiohttp.ClientSession) -> list[int]:
        async with session.ws_connect(f"{_base(server)}/ws") as socket:
            numbers = []
            for _ in range(3):
                frame = await _until(socket, "frame", drawn=False)
                numbers.append(frame["number"])
                if len(numbers) == 2:  # two are under way, and no third comes
                    await asyncio.to_thread(wait_until, lambda: _newest(box) > numbers[1] + 100)
                    await socket.send_json({"drawn": 0})
            assert len(server.pages) == 1
            return numbers

    box = live.subscribe(detailed=True)
    _, second, third = _talk(watch)
    assert third > second + 100
    wait_until(lambda: not server.pages)
    assert live.running


@pytest.mark.parametrize(
    ("text", "answer"),
    [
        ('{"do": "fly"}', "unknown request"),
        ('{"do": "place", "objects": [[[0, 0], [1, 1]]]}', "a polygon needs at least 3 points"),
        ('{"do": "place", "objects": [[[0, 0], [9, 9], [9, 0], [0, 9]]]}', "crosses itself"),
        ('{"do": "place", "objects": 5}', "is malformed"),
        ('{"do": "place", "objects": [[[0, 0], [1, null], [3, 4]]]}', "number"),
        ('{"do": "set", "settings": {"strips": 1}}', "strips = 1: must be 2 to 1000"),
        ('{"do": "set", "settings": {"strips": "x"}}', "strips = x: must be 2 to 1000"),
        ('{"do": "set", "settings": {"construction": "crs-x"}}', "construction 'crs-x' does not exist"),
        ('{"do": "set", "settings": {"noise": 7}}', "positional = 7: a fraction of Vref"),
        ('{"do": "set", "settings": {"rate_hz": 0}}', "rate_hz = 0: must be 1 to 5000"),
        ('{"do": "set", "settings": {"colour": 1}}', "setting 'colour' does not exist"),
        ('{"do": "method", "method": "magic"}', "method 'magic' does not exist"),
        ('{"do": "examine"}', "too few to examine"),
    ],
)
def test_what_cannot_be_done_is_said(server: Server, text: str, answer: str) -> None:
    async def ask(session: aiohttp.ClientSession) -> str:
        async with session.ws_connect(f"{_base(server)}/ws") as socket:
            for nonsense in ("{", "[1]", "null"):
                await socket.send_str(nonsense)
            await socket.send_str(text)
            return str((await _until(socket, "refused"))["text"])

    assert answer in _talk(ask)


def test_recording_from_the_page(server: Server, tmp_path: Path) -> None:
    async def record(session: aiohttp.ClientSession) -> int:
        async with session.ws_connect(f"{_base(server)}/ws") as socket:
            await socket.send_json({"do": "record"})
            assert (await _until(socket, "notice"))["text"].startswith("recording to ")
            while not ((state := await _until(socket, "state"))["recording"] or {}).get("scans"):
                pass
            await socket.send_json({"do": "stop recording"})
            while (await _until(socket, "state"))["recording"] is not None:
                pass
            return int(state["recording"]["scans"])

    scans = _talk(record)
    (file,) = tmp_path.glob("*.mcap")
    assert len(list(ts.Recording(file))) >= scans > 0


def test_recording_from_the_page_leaves_that_of_the_command_alone(
    controller: Controller, live: Live, tmp_path: Path
) -> None:
    live.record(tmp_path / "command.mcap")
    controller.do({"do": "record"})
    with pytest.raises(ts.OptionError, match="recording already"):
        controller.do({"do": "record"})
    wait_until(lambda: (controller.state()["recording"] or {}).get("scans"))
    assert controller.state()["command_records"] == [str(tmp_path / "command.mcap")]
    controller.do({"do": "stop recording"})
    assert controller.state()["recording"] is None
    (command,) = live.recordings
    scans = command.scans
    wait_until(lambda: command.scans > scans)
    live.stop()
    assert not live.recording_failed
    own, page = (list(ts.Recording(file)) for file in sorted(tmp_path.glob("*.mcap")))
    assert {raw.sequence for raw in page} <= {raw.sequence for raw in own}
    assert len(own) > len(page) > 0


def test_a_sheet_gives_back_what_it_could_not_have(simulator: Simulator) -> None:
    simulator.change({"construction": "crs-crp"})
    now = simulator.settings
    assert (now.sensor.strips, now.rate_hz) == (20, 20.0)
    for wrong, words in (({"strips": 50}, "2 to 24"), ({"rate_hz": 100}, "1 to 20")):
        with pytest.raises(ts.OptionError, match=words):
            simulator.change(wrong)
    simulator.change({"construction": "crs-m"})
    assert (simulator.settings.sensor.strips, simulator.settings.rate_hz) == (20, 500.0)
    simulator.change({"strips": 50})
    simulator.change({"construction": "crs-crp"})
    assert simulator.settings.sensor.strips == 24
    simulator.change({"construction": "crs-crs"})
    assert simulator.settings.sensor.strips == 50


@pytest.mark.parametrize("construction", ["crs-m", "cyl-crs-m", "crs-crp"])
def test_the_simulator_changes_its_sensor(
    controller: Controller, live: Live, simulator: Simulator, construction: str
) -> None:
    assert controller.do({"do": "set", "settings": {"construction": construction, "strips": 16}}) is None
    box = live.subscribe()
    while True:
        frame = box.get(HANG_S)
        assert frame is not None
        if frame.sensor.construction == construction and frame.objects:
            break
    assert (frame.sensor.strips, frame.sensor.width_mm) == (16, 100.0)
    assert live.error is None


def test_two_layers_are_shown_where_they_lie_and_keep_their_strips(tmp_path: Path) -> None:
    simulator = Simulator(Settings(ts.Sensor.load("layered-crs-crs"), 50.0))
    with Live(simulator.source(), tracks=False) as live, ThreadPoolExecutor(1) as executor:
        controller = Controller(live, executor, simulator, tmp_path)
        about = controller.hello(control=True)
        controller.watched(True)
        frame: dict[str, Any] = {}

        def has_shapes() -> bool:
            text = controller.picture()
            frame.update(json.loads(text) if text else {})
            return '"vertices": [[' in text

        wait_until(has_shapes)
        with pytest.raises(ts.OptionError, match="of two layers, construction and strips are the spec's"):
            controller.do({"do": "set", "settings": {"strips": 10}})
        with pytest.raises(ts.OptionError, match='two layers are reconstructed by "polygon"'):
            controller.do({"do": "method", "method": "profile"})
        assert controller.state()["method"] == "polygon"
    assert [layer["strips"] for layer in about["sensor"]["layers"]] == [32, 32]
    assert about["sensor"]["layers"][1]["corners"] == [[96.0, 0.0], [96.0, 96.0], [0.0, 96.0], [0.0, 0.0]]
    assert (about["methods"], about["constructions"]) == (["polygon"], ["crs-crs"])
    assert len(frame["readings"]["kh"]) == 64
    assert [len(one["vertices"]) for one in frame["objects"]] == [3, 3]


def test_sensors_of_the_simulator() -> None:
    assert sensor_of("crs-crp", 500, SENSOR).strips == 24
    assert sensor_of("crs-crs", 20, SENSOR) == SENSOR
    with pytest.raises(ts.OptionError):
        sensor_of("crs-crs", 2.5, SENSOR)


def test_a_contact_off_the_sensor_is_told_and_does_not_end_the_stream(
    controller: Controller, live: Live
) -> None:
    controller.do({"do": "place", "objects": [[[500, 0], [510, 0], [505, 9]]]})
    box = live.subscribe()
    while (frame := box.get(HANG_S)) is not None and frame.objects:
        pass
    assert frame is not None
    wait_until(lambda: "outside the sensor" in controller.state()["problem"])
    assert live.running


# Twice as often as the doctor keeps a scan: more cost their reconstruction while its process starts.
@pytest.mark.parametrize("simulator", [100.0], indirect=True, ids=[""])
def test_the_doctor_looks_at_what_was_measured(controller: Controller, live: Live) -> None:
    ring = SENSOR.x_mm[[2, 12, 12, 2]]
    places = itertools.cycle(range(0, 60, 3))
    controller.watched(True)

    def examined() -> bool:
        if not controller.health.examining:
            x, y = next(places), np.array([20.0, 30.0, 70.0, 50.0])
            outline = np.stack([ring * 0.6 + x, y + 0.3 * x], axis=1).tolist()
            controller.do({"do": "place", "objects": [outline]})
            controller.picture()
            controller.health.examine()
        return controller.health.report is not None

    wait_until(examined)
    assert controller.health.problem == ""
    told = controller.state()["health"]
    assert len(told["strips"]) == 20
    assert "broken" not in told["strips"]
    assert told["strips"].count("ok") > 5


def test_a_picture_is_json_with_no_nan() -> None:
    contact = ts.Contact.polygon([(22, 38), (62, 22), (80, 55), (45, 76)])
    scan = ts.simulate(SENSOR, contact, ts.Noise(positional=0.002))
    objects = Tracker(SENSOR).update(scan)
    raw = RawScan(0.0, {}, scan.touched)
    told = frame_json(ts.Frame(3, raw, SENSOR, scan, objects, 0.0, 0.0))
    text = json.dumps(told, allow_nan=False)
    assert json.loads(text)["readings"]["kh"][0] is None
    assert len(text) < 4000


def test_other_outlines_that_explain_all_scans_are_told_where_they_lie() -> None:
    square = np.array([(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)])
    pose, nowhere = np.array([30.0, 40.0, np.pi / 2.0]), np.full(3, np.nan)
    others = (Alternative(0.25, 2.0 * square),)
    shown = ts.LiveTrack(1, square, pose, nowhere, 0.0, 20, "doubtful", "open", others)
    scan = ts.simulate(SENSOR, ts.Contact.polygon(square + 30.0))
    tracks, raw = (shown, replace(shown, pose=nowhere)), RawScan(0.0, {}, scan.touched)
    told = frame_json(ts.Frame(3, raw, SENSOR, scan, (), 0.0, 0.0, tracks=tracks))["tracks"]
    assert told[0]["alternatives"] == [{"weight": 0.25, "vertices": [[30, 40], [30, 60], [10, 60], [10, 40]]}]
    assert (told[1]["vertices"], told[1]["alternatives"]) == ([], [])
