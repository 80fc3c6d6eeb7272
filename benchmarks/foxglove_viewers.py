"""Foxglove's bridge at 1,000 scans/s of 100 strips and two objects: messages lost, processor time a scan.

Frames are made before; the bridge sends them, paced, to a viewer in another process that subscribes to everything and
counts. What the processor did in this process (both threads of the bridge) is divided by the scans: without a viewer,
with one, and with one that does not read. Wanted: none lost, .5 ms a scan at most, and a viewer that does not read
costs no more than one that reads.

Run: python benchmarks/foxglove_viewers.py [--seconds 10] [--node FOLDER with @foxglove/ws-protocol and ws of npm]
"""

from __future__ import annotations

import argparse
import asyncio
import json
import math
import shutil
import subprocess
import sys
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

import aiohttp
import numpy as np

import tacstrip as ts
from tacstrip.stream.bridges.foxglove.bridge import Foxglove
from tacstrip.stream.live.pipeline import Live

RATE_HZ, MADE, CHUNK = 1000.0, 300, 500
SENSOR = ts.Sensor(construction="crs-crs", strips=100, pitch_mm=1.0, length_mm=100.0, adc_bits=12)
TWO = ts.Contact.polygon([(8, 30), (40, 22), (44, 60), (15, 74)]) + ts.Contact.polygon(
    [(55, 40), (92, 55), (70, 85)]
)
PER_SCAN = ("signatures", "shapes", "objects")


def frames() -> list[ts.Frame]:
    """Return frames of two objects that move, with covariances in 80 of 1,000."""
    source = ts.SimulatedSource(
        SENSOR, lambda time_s: TWO.moved(2.0 * math.sin(time_s), 3.0 * math.cos(time_s)), RATE_HZ, MADE,
        ts.Noise(positional=0.002),
    )  # fmt: skip
    live = Live(
        source, speed=0.5
    )  # so that frames with covariances come about as often as they do at 1,000 scans/s
    live.want_detail("benchmark", True)
    box = live.subscribe(MADE)
    with live:
        for _ in live:
            pass
    return [frame if i % 12 == 0 else _without_covariances(frame) for i, frame in enumerate(box.get_all())]


def _without_covariances(frame: ts.Frame) -> ts.Frame:
    objects = tuple(replace(one, shape=replace(one.shape, covariance=None)) for one in frame.objects)
    return replace(frame, objects=objects)


async def count(url: str, reads: bool) -> None:
    """Be a viewer that subscribes to everything: count messages by topic until no scan comes for two seconds."""
    async with (
        aiohttp.ClientSession() as session,
        session.ws_connect(url, protocols=["foxglove.sdk.v1"], max_msg_size=0) as socket,
    ):
        topics: dict[int, str] = {}
        while not topics:
            told = json.loads((await socket.receive()).data)
            topics = {c["id"]: c["topic"] for c in told.get("channels", ())}
        await socket.send_json(
            {"op": "subscribe", "subscriptions": [{"id": i, "channelId": i} for i in topics]}
        )
        print("ready", flush=True)
        if not reads:
            await asyncio.to_thread(sys.stdin.read)
            return
        counts: Counter[str] = Counter()
        last_s = math.inf  # of a scan; health goes on
        while time.monotonic() - last_s < 2.0:
            message = await socket.receive()
            if message.type == aiohttp.WSMsgType.BINARY:
                counts[topic := topics[int.from_bytes(message.data[1:5], "little")]] += 1
                last_s = time.monotonic() if topic.endswith(PER_SCAN) else last_s
        print(json.dumps(counts), flush=True)


def run(what: str, client: list[str], made: list[ts.Frame], seconds: float) -> None:
    """Send frames for some seconds and say how it went."""
    scans = round(RATE_HZ * seconds)
    numbered = [replace(made[i % len(made)], number=i, raw=replace(made[i % len(made)].raw, time_s=i / RATE_HZ))
                for i in range(scans)]  # fmt: skip
    told: list[str] = []
    live = Live(ts.SimulatedSource(SENSOR, lambda time_s: TWO), on_message=told.append)
    bridge = Foxglove(live, port=0)
    viewer = None
    if client:
        line = [*client, f"ws://127.0.0.1:{bridge.server.port}"]
        viewer = subprocess.Popen(line, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert viewer.stdout is not None
        assert viewer.stdout.readline() == "ready\n"
        while not bridge.server.wanted(bridge._signatures):
            time.sleep(0.01)
    start, behind, used = time.perf_counter(), [], []
    for i, frame in enumerate(numbered):
        if i % CHUNK == 0:
            used.append(time.process_time())
        wait_s = start + i / RATE_HZ - time.perf_counter()
        if wait_s > 0.0:
            time.sleep(wait_s)
        behind.append(-wait_s)
        bridge.send(frame)
    while bridge.server.waiting and not told:
        time.sleep(0.01)
    mean = (time.process_time() - used[0]) / scans
    least = min(np.diff(used)) / CHUNK
    text = (
        f"{what}: {1e3 * mean:.3f} ms of processor time a scan ({1e3 * least:.3f} in the best half second), "
    )
    text += f"{bridge.server.dropped} messages dropped"
    if viewer is not None:
        out, _ = viewer.communicate()
        if out:
            counts = json.loads(out)
            lost = {name: scans - counts[f"/tacstrip/{name}"] for name in PER_SCAN}
            text += f"; of {scans} scans lost: {lost}; {counts}"
    print(f"{text}; behind by {1e3 * np.quantile(behind, 0.99):.2f} ms (99 %)")
    for message in told:
        print(f"  {message}")
    bridge.close()
    live.stop()


def main() -> None:
    """Run with several viewers."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--node", type=Path)
    parser.add_argument("--viewer", choices=("reads", "stalls"))
    parser.add_argument("url", nargs="?")
    given = parser.parse_args()
    if given.viewer:
        asyncio.run(count(given.url, given.viewer == "reads"))
        return
    made = frames()
    own = [sys.executable, __file__, "--viewer"]
    run("no viewer", [], made, given.seconds)
    run("one viewer", [*own, "reads"], made, given.seconds)
    run("one that does not read", [*own, "stalls"], made, given.seconds)
    if given.node:
        script = shutil.copy(Path(__file__).with_name("foxglove_client.mjs"), given.node)
        run("Foxglove's own client library", ["node", script], made, given.seconds)


if __name__ == "__main__":
    main()
