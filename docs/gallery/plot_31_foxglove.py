"""
Watch in Foxglove
=================

``tacstrip live --foxglove`` serves Foxglove and Lichtblick, and whatever else speaks their protocol: here a client of
ten lines. Where the extra ``foxglove`` is missing it shows what an earlier run read.
"""

import asyncio
import json
import subprocess
from importlib.util import find_spec
from pathlib import Path

import aiohttp
import matplotlib.pyplot as plt

COMMAND = ["tacstrip", "live", "--simulate", "--no-view", "--foxglove", "0", "--seconds", "2"]


async def readings(url):
    """Subscribe to the readings; keep what comes until the stream ends."""
    async with aiohttp.ClientSession() as web, web.ws_connect(url, protocols=["foxglove.sdk.v1"]) as viewer:
        async for message in viewer:
            if message.type == aiohttp.WSMsgType.BINARY:  # 13 bytes: kind, subscription, time [ns]
                seen.update(json.loads(message.data[13:]))
                continue
            for channel in json.loads(message.data).get("channels", ()):
                if channel["topic"] == "/tacstrip/signatures":
                    wanted = [{"id": 1, "channelId": channel["id"]}]
                    await viewer.send_json({"op": "subscribe", "subscriptions": wanted})


seen = json.loads(Path("foxglove.json").read_text(encoding="utf-8"))
if find_spec("foxglove"):
    with subprocess.Popen(COMMAND, stderr=subprocess.PIPE, text=True) as live:
        asyncio.run(readings(next(w for line in live.stderr for w in line.split() if w.startswith("ws://"))))
figure, axes = plt.subplots(figsize=(6.5, 3.6), layout="constrained")
axes.plot(seen["x_mm"], seen["kh"], "o", seen["x_mm"], seen["kl"], "s")
axes.set(xlabel="x [mm]", ylabel="k_h (dots), k_l (squares)", title="/tacstrip/signatures")
