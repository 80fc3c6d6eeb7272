"""The page's messages, field by field as the reference describes them."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import aiohttp
import numpy as np
import pytest

import tacstrip as ts
from live_devices import SENSOR
from tacstrip.reconstruction.result import Alternative, RecoveredObject
from tacstrip.stream import RawScan
from tacstrip.stream.codes import with_converter
from tacstrip.stream.live.pipeline import Live
from tacstrip.tracking.tracker import LiveObject
from tacstrip.view.controller import Controller
from tacstrip.view.frame_json import frame_json, sensor_json
from tacstrip.view.health import examined
from tacstrip.view.server import Access, Server
from tacstrip.view.simulator import Settings, Simulator
from waiting import HANG_S

PAGE = (Path(__file__).parents[2] / "docs/reference/protocol-page.md").read_text(encoding="utf-8")
ROW = re.compile(r"^\| (.+?) \| (.+) \|$", re.MULTILINE)
SPAN = re.compile(r"`([^`{]+)`")
CORNERS = np.array([(20.0, 20.0), (40.0, 20.0), (30.0, 40.0)])


def documented(section: str) -> dict[str, set[str]]:
    """Return the fields that a section of the page has tables of, and the names that each row's words have."""
    text = PAGE.split(f"### {section}\n")[1].split("\n##")[0]
    fields: dict[str, set[str]] = {}
    for table in re.split(r"\n\n", text):
        prefix = ""
        for name, words in ROW.findall(table):
            if name.startswith("field"):
                prefix = f"{spans[0]}." if (spans := SPAN.findall(name)) else ""
                continue
            for one in SPAN.findall(name):
                fields[prefix + one] = set(SPAN.findall(words))
    return fields


def names_in(told: Any, at: str = "") -> Iterator[str]:
    """Give the fields of a message, `[]` for those of a list's elements."""
    if isinstance(told, dict):
        for name, value in told.items():
            path = f"{at}.{name}" if at else name
            yield path
            yield from names_in(value, path)
    elif isinstance(told, list) and told and isinstance(told[0], dict):
        for one in told:
            yield from names_in(one, f"{at}[]")


def described(path: str, fields: dict[str, set[str]]) -> bool:
    """Say whether a table has a field, itself or its elements, or the row of what it is part of names it."""
    if path in fields or f"{path}[]" in fields:
        return True
    whole, _, name = path.rpartition(".")
    return any(name in fields.get(row, ()) for row in (whole, whole.removesuffix("[]")))


@pytest.fixture(scope="module")
def sent(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[dict[str, Any]]]:
    """What a server sends to a client that asks for all there is, by kind."""
    simulator = Simulator(Settings(SENSOR, 100.0, ts.Noise(positional=0.002)))
    stream = Live(simulator.source(), next_source=simulator.source, tracks=False)
    scans = ts.SimulatedSource(SENSOR, lambda time_s: ts.Contact.polygon(CORNERS + time_s), 100.0, 5)
    report = examined(SENSOR, list(scans))
    heard: dict[str, list[dict[str, Any]]] = {}

    async def listen(url: str) -> None:
        requests = [
            {"do": "record"}, {"do": "method", "method": "none", "field": "method"},
            {"do": "set", "settings": {"noise": 0.001}}, {"do": "place", "objects": [CORNERS.tolist()]},
        ]  # fmt: skip
        async with aiohttp.ClientSession() as session, session.ws_connect(url) as socket:
            while True:
                message = await socket.receive_json(timeout=HANG_S)
                heard.setdefault(message["kind"], []).append(message)
                if message["kind"] == "frame":
                    await socket.send_json({"drawn": message["number"]})
                    if controller.health.report is None:  # its kind alone counts
                        controller.health.report = report
                    if requests:
                        await socket.send_json(requests.pop(0))
                states = heard.get("state", [])
                done = any(s["health"].get("strips") for s in states) and any(s["recording"] for s in states)
                found = any(o.get("regions") for frame in heard.get("frame", ()) for o in frame["objects"])
                if done and found and {"refused", "notice"} <= heard.keys() and not requests:
                    return

    with stream, ThreadPoolExecutor(1) as executor:
        controller = Controller(stream, executor, simulator, tmp_path_factory.mktemp("recordings"))
        server = Server(controller, Access("127.0.0.1"))
        try:
            asyncio.run(listen(f"http://127.0.0.1:{server.port}/ws"))
        finally:
            server.close()
    return heard


def _all_fields() -> dict[str, Any]:
    """Return a frame whose objects and tracks have all that they may have."""
    scan = ts.simulate(SENSOR, ts.Contact.polygon(CORNERS))
    shape = RecoveredObject(
        slice(2, 5), CORNERS, (CORNERS[:, 0], CORNERS[:, 1], CORNERS[:, 1] + 1.0), 0.1 * np.eye(6),
        confidence=0.9, alternatives=(Alternative(0.1, CORNERS, others=(CORNERS,)),),
        hidden_edges=np.array([True, False, False]), bounds=(CORNERS, CORNERS),
    )  # fmt: skip
    track = ts.LiveTrack(
        1, CORNERS, np.zeros(3), np.zeros(3), 0.0, 9, "ok", alternatives=(Alternative(0.2, CORNERS),)
    )
    raw = RawScan(0.0, {}, scan.touched)
    return frame_json(ts.Frame(3, raw, SENSOR, scan, (LiveObject(1, shape),), 0.0, 0.0, tracks=(track,)))


def test_the_reference_has_every_field_that_is_sent_and_no_other(
    sent: dict[str, list[dict[str, Any]]],
) -> None:
    tip = with_converter(ts.Sensor.load("fingertip"))
    curved = {"sensor": sensor_json(tip)}
    pressed = {"truth": Simulator(Settings(tip, 100.0)).truth}
    both = documented("hello")
    tables = {
        "hello": (both, [*sent["hello"], curved]),
        "state": (both | documented("state"), [*sent["state"], curved]),
        "frame": (documented("frame"), [*sent["frame"], _all_fields(), pressed]),
    }
    for kind, (fields, messages) in tables.items():
        found = {name for message in messages for name in names_in(message)} - {"kind"}
        assert not (lacking := {name for name in found if not described(name, fields)}), (kind, lacking)
        once = {"version", "control", "session"} if kind == "state" else set()  # of a hello alone
        gone = {name for name in fields if name.removesuffix("[]") not in found} - once
        assert not gone, (kind, gone)
    for kind, names in (("refused", {"kind", "text", "field"}), ("notice", {"kind", "text"})):
        assert {name for message in sent[kind] for name in message} == names
        assert all(f"`{name}`" in PAGE for name in names)
    assert set(sent) == {"hello", "state", "frame", "refused", "notice"}
    assert sent["hello"][0]["version"] == 1
    assert sent["refused"][0]["field"] == "method"
